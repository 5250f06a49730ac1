"""Integral action, added to the reference of a law to remove steady errors: in Python, and by the C."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from threading import Lock
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ...model.law import gain_names
from ...readers.errors import BadInput
from ...readers.reading import one_for_each
from .controller import Evaluation

if TYPE_CHECKING:
    from ...model.law import ControlLaw
    from .runtime import Runtime

HEADER = "noslip_integral.h"


class OutputIntegral(Protocol):
    """Integral action of one output. `z` is the integral of its error y_d - y, in the unit of the output
    times s.

    It is thread-safe.
    """

    @property
    def z(self) -> float: ...

    def step(self, error: float, dt: float, status: str) -> float:
        """Return ki z for an error now; the previous error is integrated over dt (s), `status` being the
        result of the previous step.

        |z| does not increase unless that status was ok, nor if ki |z| would exceed the limit.
        """


class Integral:
    """The reference implementation."""

    def __init__(self, ki: float, limit: float = 0.0):
        """`limit`: maximum of ki |z|; 0: none."""
        self.z, self._error = 0.0, 0.0
        self._ki, self._limit = float(ki), float(limit) or math.inf
        self._lock = Lock()

    def step(self, error: float, dt: float, status: str) -> float:
        """See OutputIntegral.step."""
        with self._lock:
            grown = self.z + self._error * dt
            if abs(grown) > abs(self.z) and not (status == "ok" and self._ki * abs(grown) <= self._limit):
                grown = 0.0 if grown * self.z < 0 else self.z
            self.z, self._error = grown, float(error)
            return self._ki * self.z


class CompiledIntegral:
    """The same by the C, in double or float. Raises BadInput if the C returns an error."""

    def __init__(self, ki: float, limit: float = 0.0, scalar: str = "double", c: Runtime | None = None):
        from .runtime import runtime  # slow to import

        self._runtime, self._scalar, self._lock = c or runtime(HEADER), scalar, Lock()
        self._self, self._add = (
            self._runtime.new("noslip_integral", scalar),
            self._runtime.array(scalar, [0.0]),
        )
        self._call("init", float(ki), float(limit))

    @property
    def z(self) -> float:
        """Integral of the error."""
        return self._self.z

    def step(self, error: float, dt: float, status: str) -> float:
        """See OutputIntegral.step."""
        with self._lock:
            self._call("step", float(error), float(dt), self._runtime.number(status), self._add)
            return self._add[0]

    def _call(self, name: str, *arguments) -> None:
        self._runtime.call("integral action", f"noslip_integral_{name}", self._scalar, self._self, *arguments)


def make_integral(
    backend: str, ki: float, limit: float = 0.0, law: ControlLaw | None = None
) -> OutputIntegral:
    """Return integral action for a backend: casadi in Python, the others by the C; see `runtime_of`.

    Raises BadInput for an unknown backend.
    """
    if backend == "casadi":
        return Integral(ki, limit)
    from .backends import runtime_of  # slow to import

    c, scalar = runtime_of(backend, HEADER, law)
    return CompiledIntegral(ki, limit, scalar, c)


class ActingRows:
    """The outputs of a law that have a gain beside the law's own, by which a number is added to the desired
    derivative of highest order, which the law adds to v.

    `rows` (K): their names. `acting` (K): indices of the rows among the outputs; `desired` and `highest`: the
    indices in the reference of their desired values and of the derivatives of highest order; `limit` (K): of
    what is added, 0 is none.
    """

    def __init__(self, law: ControlLaw, gains: Sequence[float], name: str, own: Mapping[str, float]):
        """`gains` in the order of law.gains; `own` by name and row (ki_distance, ...), 0: none."""
        rows, degree = law.output.rows, law.linearization.relative_degree
        by_row = [own.get(f"{name}_{row.name}", 0.0) for row in rows]
        self.acting = [k for k, value in enumerate(by_row) if value]
        self.rows = tuple(rows[k].name for k in self.acting)
        self.limit = [0.0] * len(self.rows)
        self._own, self._degree = np.array([by_row[k] for k in self.acting]), degree
        self._known = {gain.name: value for gain, value in zip(law.gains, gains, strict=True)}
        names = [q.name for q in law.reference]
        self.desired = [names.index(row) for row in self.rows]
        self.highest = [entry + degree[k] for entry, k in zip(self.desired, self.acting, strict=True)]
        self._angles = [rows[k].unit == "rad" for k in self.acting]

    def added(self, reference: np.ndarray, add: np.ndarray) -> np.ndarray:
        """Return the reference for the controller, in the order of law.reference, with `add` (K) added."""
        if not self.rows:
            return reference
        made = reference.copy()
        made[self.highest] += add
        return made

    def _set_limits(self, given: Sequence[float], where: str, requires: str) -> None:
        """Set the limits: one, or one for each of the rows. Raises BadInput if they are negative,
        or as many as neither."""
        if any(given) and not self.rows:
            raise BadInput(f"[limits] {where} requires {requires}")
        self.limit = list(one_for_each(given, self.rows, f"[limits] {where}"))
        for value in given:
            if not value >= 0:
                raise BadInput(f"[limits] {where} = {value:g} must be nonnegative; 0 means no limit")


class IntegralAction(ActingRows):
    """The outputs of a law that have integral action, and how it is added to the reference.

    `ki` (K): their gains, 1/s^(k + 1) for relative degree k. ki z is added: the characteristic polynomial of
    the output becomes s^2 + kv s + ki, s^3 + kd s^2 + kp s + ki, and likewise for longer chains. `limit` (K)
    is that of ki |z|.
    """

    def __init__(
        self,
        law: ControlLaw,
        gains: Sequence[float],
        ki: Mapping[str, float],
        limit: Sequence[float] = (0.0,),
    ):
        """`gains` in the order of law.gains; `ki` by name (ki_distance, ...), 0: none; `limit` of ki |z|,
        one, or one for each row that has integral action.

        Raises BadInput for gains that are negative or make an output unstable, and for a wrong number of
        limits.
        """
        super().__init__(law, gains, "ki", ki)
        self.ki, self._law = self._own, law
        for row, k, value in zip(self.rows, self.acting, self.ki.tolist(), strict=True):
            _check(row, self._degree[k], value, self._known)
        self._set_limits(limit, "integral", "integral action: give a gain ki")

    def integrators(self, backend: str) -> list[OutputIntegral]:
        """Return one integrator for each of the rows, at zero."""
        return [
            make_integral(backend, ki, limit, self._law)
            for ki, limit in zip(self.ki, self.limit, strict=True)
        ]

    def error(self, found: Evaluation, reference: np.ndarray) -> np.ndarray:
        """Return y_d - y (K), with y as the law evaluates it; of an angle the smallest difference.

        Zeros if the law returns an error, as it then does for the inputs too.
        """
        if found.status != "ok":
            return np.zeros(len(self.rows))
        errors = reference[self.desired] - found.values["h"][self.acting]
        return np.array(
            [math.remainder(e, 2 * math.pi) if a else e for e, a in zip(errors, self._angles, strict=True)]
        )


def hurwitz(coefficients: Sequence[float | np.ndarray]) -> np.ndarray:
    """Return whether all roots of a polynomial have negative real parts, by Routh's array; numbers, or arrays
    of them, the coefficient of the highest power first, which is positive.
    """
    above, below = list(coefficients[::2]), list(coefficients[1::2])
    stable = np.asarray(coefficients[0]) > 0.0
    with np.errstate(all="ignore"):
        while below:
            stable = stable & (np.asarray(below[0]) > 0.0)
            ratio, padded = np.divide(above[0], below[0]), [*below[1:], 0.0]
            above, below = below, [one - ratio * other for one, other in zip(above[1:], padded, strict=False)]
    return stable


def _check(row: str, degree: int, ki: float, gains: Mapping[str, float]) -> None:
    """Check that s^(k + 1) + ... + kp s + ki is stable. Raises BadInput if not."""
    if not (math.isfinite(ki) and ki > 0):
        raise BadInput(f"gains: ki_{row} = {ki:g} must be nonnegative and finite")
    if degree == 0:
        raise BadInput(f"gains: ki_{row}: a kinematic law commands {row} as it is; leave it out")
    own = [gains[f"{name}_{row}"] for name in gain_names(degree)]
    if hurwitz([1.0, *own[::-1], ki]):
        return
    if degree == 1:
        raise BadInput(f"gains: ki_{row} requires kv_{row} > 0: otherwise s^2 + kv s + ki is not stable")
    if degree == 2:
        raise BadInput(
            f"gains: ki_{row} = {ki:g} makes {row} unstable: s^3 + kd s^2 + kp s + ki requires ki < kp kd = "
            f"{own[0] * own[1]:g}"
        )
    terms = " + ".join(
        f"{name} s^{order}" for order, name in reversed(list(enumerate(gain_names(degree), 1)))
    )
    raise BadInput(
        f"gains: ki_{row} = {ki:g} makes {row} unstable: s^{degree + 1} + {terms} + ki; make it smaller"
    )
