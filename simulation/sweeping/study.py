"""A sweep prepared for execution: its SPEC, the simulator, the plan of the samples,
and the criterion of failure."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from ... import __version__
from ...codegen.identity import fingerprint
from ...codegen.loop.stages import broken
from ...readers.errors import BadInput, check_named
from ...readers.robots import find_robot, law_of
from ..loop import make_loop
from ..specification.distributions import Sweep
from ..specification.spec import Spec, spec_of
from .batch import Batch
from .inputs import inputs_of
from .plan import Plan, as_sampled, sweep_of
from .simulated import Simulated

SHORT = ("final", "peak", "settling")  # of each output that is a position or an angle, not a speed
FORMAT = 2  # of the results: 1 had the integrator of order 6 alone, and no column `order`
# Severity of a run that stops early: larger than any other, and the larger the earlier it stops
STOPPED = 1e6


@dataclass(frozen=True)
class Criterion:
    """The criterion of failure: the run stopped early (`status`),
    or the absolute value of an outcome exceeds its limit."""

    status: bool
    limits: Mapping[str, float]
    outcomes: Sequence[str]

    def severity(self, outcomes: np.ndarray, duration: np.ndarray | float) -> np.ndarray:
        """Return the severity of rows of outcomes (N); above 1 they fail. `duration`:
        the intended duration, s."""
        status, t_end = (outcomes[:, self.outcomes.index(name)] for name in ("status", "t_end"))
        worst = np.zeros(len(outcomes))
        for name, limit in self.limits.items():
            size = np.abs(outcomes[:, self.outcomes.index(name)]) / limit
            worst = np.fmax(worst, np.where(np.isnan(size), STOPPED, size))
        if self.status:
            worst = np.where(status < 0, STOPPED * (2 - t_end / duration), np.minimum(worst, STOPPED))
        return worst

    def __str__(self):
        parts = ["it stops early"] if self.status else []
        return " or ".join([*parts, *(f"|{name}| > {limit:g}" for name, limit in self.limits.items())])


@dataclass(frozen=True, eq=False)
class Study:
    """The objects defined by the text of a SPEC and a number of samples. `spec` has a control period;
    `instants`: s, when outcomes include errors.
    """

    text: str
    spec: Spec
    batch: Batch | Simulated
    plan: Plan
    criterion: Criterion
    instants: tuple[float, ...] = ()

    @property
    def samples(self) -> int:
        """Number of samples."""
        return self.plan.samples

    @cached_property
    def identity(self) -> dict[str, str | int | float]:
        """All that the results depend on: sweeps with equal identity are the same."""
        sweep, law = self.plan.sweep, self.batch.law
        return {
            "samples": self.samples,
            "seed": sweep.seed,
            "design": sweep.design,
            "period": self.spec.simulation.period,
            "noslip": __version__,
            "format": FORMAT,
            "model_sha256": fingerprint(law.system, law),
            "spec_sha256": hashlib.sha256(self.text.encode()).hexdigest(),
        }

    @property
    def continuous(self) -> bool:
        """Whether the SPEC has no control period."""
        return not spec_of(self.text, "").simulation.period

    @property
    def shown(self) -> list[str]:
        """The outcomes that are printed: errors, outcomes with a limit, and inputs."""
        names = [long for name in SHORT for long in _in_full(name, self.batch)]
        limited = [
            name
            for name in ("saturated", "grip", "will_slip", "use")
            if self.spec.limits and name in self.batch.outcomes
        ]
        learned = [name for name in ("outside", "off") if name in self.batch.outcomes]
        return list(dict.fromkeys([*names, *self.criterion.limits, *limited, *learned]))

    def changes(self, row: dict[str, float]) -> list[str]:
        """Return the arguments KEY=VALUE of `noslip simulate SPEC --set` that give the SPEC of a row."""
        period = [f"simulation.period={self.spec.simulation.period!r}"] if self.continuous else []
        return period + self.plan.changes(row)

    def severity(self, table: np.ndarray, outcomes: np.ndarray) -> np.ndarray:
        """Return the severity of samples with their outcomes, (N)."""
        return self.criterion.severity(outcomes, table[:, self.batch.inputs.index("simulation.duration")])


def study_of(text: str, name: str, samples: int, instants: tuple[float, ...] = ()) -> Study:
    """A sweep of the SPEC `text`; with `instants` (s), the outcomes include the errors at these times. Raises
    BadInput with `name`."""
    try:
        spec = as_sampled(spec_of(text, name))
        sweep = sweep_of(spec)
        law = None if spec.feedback else law_of(find_robot(spec.robot), spec.law)
        runs = Simulated if broken(spec, "the C of a sweep", law) else Batch
        batch = runs(spec, band=sweep.band, instants=instants)
        return Study(
            text,
            spec,
            batch,
            Plan(spec, inputs_of(spec, batch.loop), samples),
            _criterion(sweep, batch),
            instants,
        )
    except BadInput as error:
        raise BadInput(str(error) if str(error).startswith(f"{name}: ") else f"{name}: {error}") from error


def outcomes_of(
    text: str, identity: Mapping[str, str | int | float], table: np.ndarray, instants: tuple[float, ...] = ()
) -> np.ndarray:
    """Return the outcomes of a table of a sweep, in another process, where the sweep is prepared anew. Raises
    BadInput if it is another one there.
    """
    study = _study(text, int(identity["samples"]), instants)
    if study.identity != identity:
        raise BadInput("a worker has another noslip or another robot; install the same version there")
    return study.batch.run(table)


@lru_cache(maxsize=4)
def _study(text: str, samples: int, instants: tuple[float, ...]) -> Study:
    return study_of(text, "SPEC", samples, instants)


def sample_spec(text: str, row: Mapping[str, float]) -> Spec:
    """Return the SPEC of one sample of a sweep of the SPEC `text`,
    given its columns. Raises BadInput if it cannot be run."""
    spec = as_sampled(spec_of(text, "[sweep]"))
    plan = Plan(spec, inputs_of(spec, make_loop(spec)), 1)
    varied = list(plan.columns(plan.table(0, 1)))
    if list(row) != varied or not all(isinstance(value, int | float) for value in row.values()):
        raise BadInput(f"a sample of this sweep has the numbers {', '.join(varied)}, not {', '.join(row)}")
    return plan.spec_of(dict(row))


def _criterion(sweep: Sweep, batch: Batch | Simulated) -> Criterion:
    """Return the given criterion; by default a run fails if it stops early or ends outside the band."""
    given = dict({"final": sweep.band} if sweep.fails is None else sweep.fails)
    status = bool(given.pop("status", True))
    limits = {long: limit for name, limit in given.items() for long in _in_full(name, batch)}
    for name in limits:
        outcomes = [each for each in batch.outcomes if each not in ("status", "steps", "order")]
        check_named(name, outcomes, "[sweep] fails: unknown outcome")
    return Criterion(status, limits, batch.outcomes)


def _in_full(name: str, batch: Batch | Simulated) -> list[str]:
    """Return the outcomes of a name: for a SHORT one those of each output of relative degree 2,
    or of all if there is none."""
    if name not in SHORT:
        return [name]
    rows = batch.law.output.rows
    places = [
        row.name
        for row, degree in zip(rows, batch.law.linearization.relative_degree, strict=True)
        if degree == 2
    ]
    return [f"{name}.{row}" for row in places or [row.name for row in rows]]
