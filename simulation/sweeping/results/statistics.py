"""Statistics of a finished sweep: probability of failure, quantiles of the outcomes,
and rank correlations."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.special import betaincinv
from scipy.stats import rankdata, sobol_indices

from ....readers.errors import BadInput
from ....readers.progress import Reported, silent
from ..designs import points
from ..runner import run_table
from ..store import open_sweep
from ..study import Study

LEVELS = (0.5, 0.9, 0.95, 0.99)  # of the quantiles
CONFIDENCE = 0.95
MOST = 2**22  # samples that quantiles are taken of
RANKED = 2**17  # and rank correlations: of the first ones, so that memory stays constant
WORST = 3
RESAMPLES = 100
FEWEST = 20  # runs to the end of which rank correlations are taken: of fewer, chance alone gives 0.5 and more
TIMES = ("simulation.period", "simulation.duration")
ENDED = ("ok", "saturated", "arrived")  # statuses of runs that went to their end
INDICES_SEED = 2**21  # the indices' samples are no part of any sweep


@dataclass(frozen=True)
class SweepSummary:
    """`statuses`: how often each; `failed` of `samples`; `sizes`: quantiles at LEVELS and largest of
    |outcome| of the runs that went to their end; `ranks`: Spearman's correlation of |outcome| with what
    varies; `worst`: samples, the worst first; `integration_error`: the largest of the runs that went to their
    end. Where one stops singular the acceleration has no bound, and neither has its error; `ranges`: least
    and largest of those of TIMES that vary, s.
    """

    samples: int
    statuses: Mapping[str, int]
    failed: int
    sizes: Mapping[str, tuple[float, ...]]
    ranks: Mapping[str, Mapping[str, float]]
    worst: tuple[int, ...]
    integration_error: float
    ranges: Mapping[str, tuple[float, float]]

    @property
    def interval(self) -> tuple[float, float]:
        """Clopper and Pearson's confidence interval of the probability of failure:
        exact for independent samples."""
        return clopper_pearson(self.failed, self.samples)


def clopper_pearson(failed: int, samples: int) -> tuple[float, float]:
    """Two-sided, at CONFIDENCE."""
    tail = (1 - CONFIDENCE) / 2
    low = betaincinv(failed, samples - failed + 1, tail) if failed else 0.0
    high = betaincinv(failed + 1, samples - failed, 1 - tail) if failed < samples else 1.0
    return float(low), float(high)


def summarize(file: Path | str, study: Study) -> SweepSummary:
    """Of a finished sweep, read a row group or a column at a time."""
    found = open_sweep(file)[0]
    counts: dict[str, int] = {}
    failed, largest_error = 0, 0.0
    worst: list[tuple[float, int]] = []
    first = 0
    names = list(dict.fromkeys(["t_end", *study.criterion.limits]))
    durations = "simulation.duration" in study.plan.names
    extra = ["simulation.duration"] if durations else []
    for group in range(found.num_row_groups):
        part = found.read_row_group(group, columns=["status", "failed", "integration_error", *names, *extra])
        statuses = part["status"].to_numpy(zero_copy_only=False)
        for name, count in zip(*np.unique(statuses, return_counts=True), strict=True):
            counts[str(name)] = counts.get(str(name), 0) + int(count)
        failed += int(part["failed"].to_numpy(zero_copy_only=False).sum())
        errors = part["integration_error"].to_numpy()[np.isin(statuses, ENDED)]
        largest_error = np.fmax(largest_error, np.fmax.reduce(errors, initial=0.0))
        outcomes = np.full((len(statuses), len(study.batch.outcomes)), np.nan)
        for name in names:
            outcomes[:, study.batch.outcomes.index(name)] = part[name].to_numpy()
        outcomes[:, study.batch.outcomes.index("status")] = np.where(np.isin(statuses, ENDED), 0, -1)
        duration = part["simulation.duration"].to_numpy() if durations else study.spec.simulation.duration
        severity = study.criterion.severity(outcomes, duration)
        for k in np.argsort(-severity, kind="stable")[:WORST]:
            worst.append((-float(severity[k]), first + int(k)))
        worst = sorted(worst)[:WORST]
        first += len(statuses)
    ended = np.isin(_column(found, "status", MOST), ENDED)
    sizes = {name: _sizes(np.abs(_column(found, name, MOST))[ended]) for name in study.shown}
    return SweepSummary(
        study.samples,
        counts,
        failed,
        sizes,
        _ranks(found, study, ended[:RANKED]),
        tuple(k for _, k in worst),
        float(largest_error),
        {name: _range(found, name) for name in TIMES if name in study.plan.names},
    )


def _column(found, name: str, most: int) -> np.ndarray:
    """The first numbers of a column."""
    rows, groups = 0, list[int]()
    while rows < most and len(groups) < found.num_row_groups:
        rows += found.metadata.row_group(len(groups)).num_rows
        groups.append(len(groups))
    return found.read_row_groups(groups, columns=[name])[name].to_numpy()[:most]


def _range(found, name: str) -> tuple[float, float]:
    values = _column(found, name, MOST)
    return float(values.min()), float(values.max())


def _sizes(values: np.ndarray) -> tuple[float, ...]:
    if not len(values):
        return (float("nan"),) * (len(LEVELS) + 1)
    return (*map(float, np.quantile(values, LEVELS)), float(values.max()))


def _ranks(found, study: Study, ended: np.ndarray) -> dict[str, dict[str, float]]:
    if ended.sum() < FEWEST:
        return {}
    inputs = {name: rankdata(_column(found, name, RANKED)[ended]) for name in study.plan.names}
    made: dict[str, dict[str, float]] = {}
    for outcome in study.shown:
        ranks = rankdata(np.abs(_column(found, outcome, RANKED)[ended]))
        if np.ptp(ranks):
            made[outcome] = {
                name: float(np.corrcoef(values, ranks)[0, 1])
                for name, values in inputs.items()
                if np.ptp(values)
            }
    return made


@dataclass(frozen=True)
class Indices:
    """Sobol's indices of each outcome, by what varies: first order, total,
    and half the widths of their intervals."""

    runs: int
    values: Mapping[str, Mapping[str, tuple[float, float, float, float]]]


def check_indices(study: Study, base: int) -> None:
    """Raises BadInput for correlated numbers and a base that is no power of 2."""
    if base < 2 or base & (base - 1):
        raise BadInput(f"--indices {base} must be a power of 2, for example 1024")
    if study.plan.sweep.correlation:
        raise BadInput("--indices: Sobol indices require independent numbers; remove [sweep] correlation")


def indices(study: Study, base: int, jobs: int, progress: Reported = silent) -> Indices:
    """First and total indices by Saltelli's design of `base` points, (D + 2) base runs, beside the samples.

    Of the size of each outcome, a run that stopped having what it had then, and of failure (1 or 0).
    """
    names = study.plan.names
    u = points("sobol", INDICES_SEED + study.plan.sweep.seed, base, 2 * len(names), 0, base)
    one, other = u[:, : len(names)], u[:, len(names) :]
    mixed = [np.where(np.arange(len(names)) == j, other, one) for j in range(len(names))]
    tables = [study.plan.rows(rows, seeds) for rows, seeds in _seeded(one, other, mixed)]
    answers: list[np.ndarray] = []
    for table in tables:

        def finished(rows: int, before: int = base * len(answers)) -> None:
            progress(before + rows, base * len(tables), "runs for the indices")

        answers.append(_answers(study, table, jobs, finished))
    shown = [*study.shown, "failed"]
    made = {}
    for k, outcome in enumerate(shown):
        progress(k, len(shown), "outcomes")
        values = np.array([answer[k] for answer in answers])
        if np.ptp(values[:2]):  # else it is the same whatever varies
            made[outcome] = dict(zip(names, _first_and_total(values, study.plan.sweep.seed), strict=True))
    return Indices(base * (len(names) + 2), made)


def _first_and_total(values: np.ndarray, seed: int) -> list[tuple[float, float, float, float]]:
    """For each number that varies: index of first order, in total, half the width of their intervals, by
    resampling.

    `values` (D + 2, N): at the first points, at the second, at the first with one number of the second.
    """
    random, n = np.random.default_rng(seed), len(values[0])

    def found(k: np.ndarray | slice) -> np.ndarray:
        A, B, *AB = values[:, None, k]
        result = sobol_indices(func={"f_A": A, "f_B": B, "f_AB": np.array(AB)}, n=n)
        return np.array([result.first_order.ravel(), result.total_order.ravel()])

    tails = 50 * (1 - CONFIDENCE), 50 * (1 + CONFIDENCE)
    with np.errstate(invalid="ignore", divide="ignore"):  # a resample in which nothing differs
        again = [found(random.integers(n, size=n)) for _ in range(RESAMPLES)]
    low, high = np.nanpercentile(again, tails, axis=0)
    rows = np.vstack([found(slice(None)), (high - low) / 2]).T.tolist()
    return [(first, total, first_half, total_half) for first, total, first_half, total_half in rows]


def _seeded(one: np.ndarray, other: np.ndarray, mixed: list[np.ndarray]):
    """Noise belongs to the first or the second set as one more number."""
    k = np.arange(len(one))
    return [(one, k), (other, len(one) + k), *((rows, k) for rows in mixed)]


def _answers(study: Study, table: np.ndarray, jobs: int, finished: Callable[[int], None]) -> np.ndarray:
    """Size of each outcome shown, and failure, (outcomes, N)."""
    outcomes = run_table(study, table, jobs, finished)
    found = [np.nan_to_num(np.abs(outcomes[:, study.batch.outcomes.index(name)])) for name in study.shown]
    return np.array([*found, study.severity(table, outcomes) > 1], float)
