"""The worst combination that the distributions allow, looked for by scipy's differential evolution over the
same simulator."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import differential_evolution

from ....readers.progress import Reported, silent
from ..designs import points
from ..inputs import SEED
from ..runner import run_table
from ..study import Study

EDGE = 1e-3  # of the probability is left out at each end of each distribution: a normal one has no worst
POPULATION = 12  # points for each dimension
GENERATIONS = 60
ENOUGH = 1e-5  # spread of the severities, of their mean, at which the search ends


@dataclass(frozen=True)
class Worst:
    """What was found: its numbers by name, how bad it is (above 1 it fails), its outcomes by name,
    how many runs it took."""

    row: dict[str, float]
    severity: float
    outcomes: dict[str, float]
    status: str
    runs: int


def find_worst(study: Study, known: Sequence[int], jobs: int, progress: Reported = silent) -> Worst:
    """The largest severity between the EDGEs, with the noise of sample 0; something must vary besides.

    The search starts with the samples `known` to be bad among points spread evenly.
    """
    plan, runs = study.plan, 0
    sweep, dimensions = plan.sweep, len(plan.names)
    population = points(
        "sobol", sweep.seed, POPULATION * dimensions, dimensions, 0, max(POPULATION * dimensions, 5)
    )
    for place, sample in enumerate(known):
        population[place] = points(sweep.design, sweep.seed, study.samples, dimensions, sample, 1)

    def table_of(u: np.ndarray) -> np.ndarray:
        return plan.rows(np.atleast_2d(u), 0)

    def good(u: np.ndarray) -> np.ndarray:
        nonlocal runs
        table = table_of(u.T)
        before, most = runs, (1 + GENERATIONS) * len(table)

        def finished(rows: int) -> None:
            progress(before + rows, most, "runs of the search, or fewer,")

        runs += len(table)
        return -study.severity(table, run_table(study, table, jobs, finished))

    found = differential_evolution(
        good,
        [(EDGE, 1 - EDGE)] * dimensions,
        init=population.clip(EDGE, 1 - EDGE),
        maxiter=GENERATIONS,
        tol=ENOUGH,
        seed=np.random.default_rng(sweep.seed),
        # By finite differences, which see the noise of rounding and the edges of what is singular
        polish=False,
        vectorized=True,
        updating="deferred",
    )
    table = table_of(found.x)
    outcomes = study.batch.run(table)
    row = {name: float(values[0]) for name, values in plan.columns(table).items() if name != SEED}
    row |= {SEED: int(table[0, study.batch.inputs.index(SEED)])} if SEED in study.batch.inputs else {}
    named = dict(zip(study.batch.outcomes, outcomes[0].tolist(), strict=True))
    severity = float(study.severity(table, outcomes)[0])
    return Worst(row, severity, named, study.batch.status(named["status"]), runs)
