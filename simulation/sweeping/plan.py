"""The samples of a sweep: a table of numbers for the batch simulator,
any part of which can be computed at any time."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.special import ndtr, ndtri

from ...readers.errors import BadInput, check_named
from ...readers.printing import toml
from ...readers.reading import MOST_ANGLE
from ...readers.robots import suggestion
from ..specification.distributions import PERIOD, Margin, Sweep
from ..specification.spec import Spec
from .designs import SOBOL_BITS, points
from .inputs import SEED, SampleInputs

MOST = {"random": 2**32, "latin": 2**32, "sobol": 2**SOBOL_BITS}


def sweep_of(spec: Spec) -> Sweep:
    """Return [sweep] of a SPEC. Raises BadInput if it is missing."""
    if spec.sweep is None:
        raise BadInput(
            "[sweep] is missing: seed = 0 and, for example, [sweep.plant] m_c = { normal = [30.0, 6.0] }"
        )
    return spec.sweep


def as_sampled(spec: Spec) -> Spec:
    """Return the SPEC with a control period: its own, or for a continuous SPEC that of [sweep]. Raises
    BadInput without [sweep]."""
    own, asked = spec.simulation.period, sweep_of(spec).period
    if own and asked:
        raise BadInput("[sweep] period applies to a continuous SPEC; here [simulation] period is given")
    return spec if own else replace(spec, simulation=replace(spec.simulation, period=asked or PERIOD))


@dataclass(frozen=True, eq=False)
class Plan:
    """`samples` samples of a SPEC, with the varied numbers by name. `inputs` are all numbers of a sample.

    Raises BadInput for unknown names, impossible correlations, and too many samples.
    """

    spec: Spec
    inputs: SampleInputs
    samples: int

    def __post_init__(self):
        design = self.sweep.design
        if self.samples > MOST[design]:
            raise BadInput(f"--samples {self.samples}: a {design} design has at most {MOST[design]}")
        for name in self.margins:
            if name == "sensors.seed":
                raise BadInput("[sweep.sensors] seed: every sample has its own seed already")
            if name not in self.inputs.names:
                lists = [known for known in self.inputs.names if known.startswith(f"{name}[")]
                hint = f"; give a list of {len(lists)}" if lists else suggestion(name, self.inputs.names)
                raise BadInput(f"[sweep] {name} is not a number of this SPEC that can vary{hint}")
        if not self.names and SEED not in self.inputs.names:
            raise BadInput(
                "[sweep]: nothing varies; for example [sweep.plant] m_c = { normal = [30.0, 6.0] }"
            )
        self._mixing  # noqa: B018, raises BadInput now

    @property
    def sweep(self) -> Sweep:
        """[sweep] of the SPEC."""
        return sweep_of(self.spec)

    @property
    def margins(self) -> dict[str, Margin]:
        """The distributions by name, including fixed values."""
        return self.sweep.margins

    @cached_property
    def names(self) -> list[str]:
        """Names of the varied numbers, the dimensions of the unit cube."""
        return [name for name, margin in self.margins.items() if margin.kind != "fixed"]

    def table(self, first: int, count: int) -> np.ndarray:
        """Return samples first to first + count - 1, (count, inputs), each with its own seed."""
        u = points(self.sweep.design, self.sweep.seed, self.samples, len(self.names), first, count)
        return self.rows(u, np.arange(first, first + count))

    def rows(self, u: np.ndarray, k: np.ndarray | int) -> np.ndarray:
        """Return rows of the table for points of the open unit cube (count, dimensions); `k`:
        numbers of the seeds."""
        u = self._correlated(u)
        columns = {
            name: margin.quantile(np.zeros(len(u)))
            for name, margin in self.margins.items()
            if margin.kind == "fixed"
        }
        columns |= {name: self.margins[name].quantile(u[:, j]) for j, name in enumerate(self.names)}
        if SEED in self.inputs.names:
            columns[SEED] = np.broadcast_to(self.sweep.seed * 2.0**32 + k, len(u))
        return self.inputs.table(columns, len(u))

    def columns(self, table: np.ndarray) -> dict[str, np.ndarray]:
        """Return the columns of a table that vary, and the seed if there is one."""
        names = [*self.names, *([SEED] if SEED in self.inputs.names else [])]
        return {name: table[:, self.inputs.names.index(name)] for name in names}

    def spec_of(self, row: dict[str, float]) -> Spec:
        """Return the SPEC of one sample, given its `columns`. Raises BadInput if it cannot be run."""
        fixed = {name: margin.a for name, margin in self.margins.items() if margin.kind == "fixed"}
        return self.inputs.spec_of(self.inputs.table(fixed | row, 1)[0])

    def changes(self, row: dict[str, float]) -> list[str]:
        """Return the same as arguments KEY=VALUE of `noslip simulate SPEC --set`."""
        spec, made = self.spec_of(row), {}
        for name in (*self.margins, *([SEED] if SEED in row else [])):
            for key in _keys(name, spec):
                made[key] = _value(spec, key)
        if abs(made.get("initial.heading", 0.0)) > MOST_ANGLE:
            made["initial.heading"] = f"{made['initial.heading']!r} rad"
        return [f"{key}={toml(value)}" for key, value in made.items()]

    @cached_property
    def _mixing(self) -> np.ndarray | None:
        """Return the Cholesky factor of the correlations, (dimensions, dimensions);
        None without correlations."""
        given = self.sweep.correlation
        if not given:
            return None
        matrix = np.eye(len(self.names))
        for one, other, rho in given:
            for name in (one, other):
                check_named(name, self.names, "[sweep] correlation: no number that varies:")
            i, j = self.names.index(one), self.names.index(other)
            if i == j or matrix[i, j]:
                raise BadInput(
                    f"[sweep] correlation of {one} and {other}: " + ("the same" if i == j else "given twice")
                )
            matrix[i, j] = matrix[j, i] = rho
        try:
            return np.linalg.cholesky(matrix)
        except np.linalg.LinAlgError as error:
            raise BadInput(
                "[sweep] correlation: no distribution has these (not positive definite); make them smaller"
            ) from error

    def _correlated(self, u: np.ndarray) -> np.ndarray:
        """Apply a Gaussian copula to u. The order of the sums does not depend on the number of rows."""
        if self._mixing is None:
            return u
        z, made = ndtri(u), u.copy()
        for i, row in enumerate(self._mixing):
            if np.any(row[:i]):
                made[:, i] = ndtr(sum(row[j] * z[:, j] for j in range(i + 1)))
        return np.clip(made, np.finfo(float).tiny, np.nextafter(1.0, 0.0))


def _keys(name: str, spec: Spec) -> Sequence[str]:
    """Return the entries of a SPEC to which a name belongs: for an item, the whole list."""
    if name == SEED:
        return ["sensors.seed"]
    if name.startswith("initial.") and spec.initial and spec.initial.q is not None:
        return ["initial.q", "initial.nu"]
    return [re.sub(r"\[\d+\]", "", name)]


def _value(spec: Spec, key: str) -> Any:
    found: Any = spec
    for part in key.split("."):
        if isinstance(found, dict):
            found = found[part]
        else:
            found = getattr(found, part) if hasattr(found, part) else found.parameters[part]
    return found
