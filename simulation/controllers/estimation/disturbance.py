"""Disturbance observers of outputs, whose estimates are subtracted from the virtual input: in Python,
and by the C."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from threading import Lock
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ....model.law import gain_names
from ....readers.errors import BadInput
from ..controller import Evaluation
from ..integral import ActingRows

if TYPE_CHECKING:
    from ....model.law import ControlLaw
    from ..runtime import Runtime

HEADER = "noslip_disturbance.h"
MOST_DEGREE = 2  # above, a derivative that is observed is computed from the model


class OutputObserver(Protocol):
    """Observer of one output, y^(r) = v + d. `estimate` is that of d, in the unit of v. It is thread-safe."""

    @property
    def estimate(self) -> float: ...

    def step(self, measured: float, v: float, dt: float, status: str) -> float:
        """Return minus the estimate, for y^(r-1) and v without the estimate now, dt (s) after the previous
        step.

        The estimate stays unless `status`, the result of the previous step of the law, is ok.
        """


class Observer:
    """The reference implementation."""

    def __init__(self, rate: float, limit: float = 0.0):
        """`rate`: 1/s; `limit`: maximum of the |estimate|; 0: none."""
        self.estimate, self._rate, self._limit = 0.0, float(rate), float(limit) or math.inf
        self._last: tuple[float, float] | None = None  # y^(r-1) and v
        self._lock = Lock()

    def step(self, measured: float, v: float, dt: float, status: str) -> float:
        """See OutputObserver.step."""
        with self._lock:
            if self._last and status == "ok" and dt > 0:
                before, acted = self._last
                follows = self._rate * dt / (1 + self._rate * dt)
                found = self.estimate + follows * ((measured - before) / dt - acted - self.estimate)
                self.estimate = min(max(found, -self._limit), self._limit)
            self._last = measured, v - self.estimate
            return -self.estimate


class CompiledObserver:
    """The same by the C, in double or float. Raises BadInput if the C returns an error."""

    def __init__(self, rate: float, limit: float = 0.0, scalar: str = "double", c: Runtime | None = None):
        from ..runtime import runtime  # slow to import

        self._runtime, self._scalar, self._lock = c or runtime(HEADER), scalar, Lock()
        self._self, self._add = (
            self._runtime.new("noslip_disturbance", scalar),
            self._runtime.array(scalar, [-0.0]),
        )
        self._call("init", float(rate), float(limit))

    @property
    def estimate(self) -> float:
        """Of the disturbance."""
        return -self._add[0]

    def step(self, measured: float, v: float, dt: float, status: str) -> float:
        """See OutputObserver.step."""
        with self._lock:
            self._call("step", float(measured), float(v), float(dt), self._runtime.number(status), self._add)
            return self._add[0]

    def _call(self, name: str, *arguments) -> None:
        self._runtime.call(
            "disturbance observer", f"noslip_disturbance_{name}", self._scalar, self._self, *arguments
        )


def make_observer(
    backend: str, rate: float, limit: float = 0.0, law: ControlLaw | None = None
) -> OutputObserver:
    """Return an observer for a backend: casadi in Python, the others by the C; see `runtime_of`.

    Raises BadInput for an unknown backend.
    """
    if backend == "casadi":
        return Observer(rate, limit)
    from ..backends import runtime_of  # slow to import

    c, scalar = runtime_of(backend, HEADER, law)
    return CompiledObserver(rate, limit, scalar, c)


class DisturbanceObservers(ActingRows):
    """The outputs of a law that have an observer, and how the estimates are subtracted.

    `ko` (K): their rates, 1/s. Minus the estimate is added. `limit` (K) is that of the |estimate|.
    """

    def __init__(
        self,
        law: ControlLaw,
        gains: Sequence[float],
        ko: Mapping[str, float],
        limit: Sequence[float] = (0.0,),
    ):
        """`gains` in the order of law.gains; `ko` by name (ko_distance, ...), 0: none; `limit` of the
        |estimate|, one, or one for each row that has an observer.

        Raises BadInput for rates that are negative, a wrong number of limits, and outputs whose last
        derivative below the relative degree is not measured.
        """
        super().__init__(law, gains, "ko", ko)
        self.ko, self._law = self._own, law
        for k, value in zip(self.acting, self.ko.tolist(), strict=True):
            self._check(law, k, value)
        self._set_limits(limit, "disturbance", "a disturbance observer: give a gain ko")
        named = zip(self.rows, self.acting, strict=True)
        self._gains = [
            [self._known[f"{gain}_{row}"] for gain in gain_names(self._degree[k])] for row, k in named
        ]
        # Where ydot has that of the row
        self._rates = [sum(degree > 1 for degree in self._degree[:k]) for k in self.acting]

    def _check(self, law: ControlLaw, k: int, ko: float) -> None:
        name = law.output.rows[k].name
        if not (math.isfinite(ko) and ko > 0):
            raise BadInput(f"gains: ko_{name} = {ko:g} must be nonnegative and finite")
        if law.extension or self._degree[k] > MOST_DEGREE:
            raise BadInput(
                f"gains: ko_{name}: with a dynamic extension the derivative that an observer compares is not "
                "measured; give ki"
            )

    def observers(self, backend: str) -> list[OutputObserver]:
        """Return one observer for each of the rows, with an estimate of 0."""
        return [
            make_observer(backend, ko, limit, self._law)
            for ko, limit in zip(self.ko, self.limit, strict=True)
        ]

    def seen(self, found: Evaluation, reference: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return y^(r-1) (K) as the law evaluates it, and v (K) without the estimates, as it computes it;
        zeros if it returns an error, as it then does for the inputs too.
        """
        if found.status != "ok":
            return np.zeros(len(self.rows)), np.zeros(len(self.rows))
        measured, v = [], []
        for i, k in enumerate(self.acting):
            y = [
                found.values["h"][k],
                *([found.values["ydot"][self._rates[i]]] if self._degree[k] > 1 else []),
            ]
            errors = reference[self.desired[i] : self.highest[i]] - y
            if self._angles[i]:
                errors[0] = math.remainder(errors[0], 2 * math.pi)
            measured.append(y[-1])
            v.append(reference[self.highest[i]] + errors @ self._gains[i])
        return np.array(measured), np.array(v)
