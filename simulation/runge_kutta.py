"""The method of Dormand and Prince of order 8, with its two error estimates (Hairer, Norsett, Wanner, Solving ODEs I, II.10).

Sums are formed term by term and powers by square roots: no BLAS and no libm, whose last bits differ by processor.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import casadi as ca
import numpy as np

from ..readers.errors import BadInput
from .dop853 import E3, E5, A, B, C

Vector = TypeVar("Vector", np.ndarray, ca.SX)
Scalar = TypeVar("Scalar", float, ca.SX)
Rate = Callable[[float, np.ndarray], np.ndarray]

SAFETY = 0.9
SHRINK, GROW = 0.2, 10.0  # least and largest factor between the lengths of one step and the next
FIRST = 1e-3  # s, the first step tried


def step(
    rate: Callable[[Scalar, Vector], Vector], t: Scalar, x: Vector, slope: Vector, h: Scalar, tolerance: Scalar
) -> tuple[Vector, Scalar]:
    """State after one step of h seconds from x, where the slope is rate(t, x), and the norm of its error, at most 1 within
    `tolerance`, relative and absolute. Of arrays, or as CasADi expressions."""
    numbers = ca if isinstance(x, ca.SX) else np
    slopes = [slope]
    for share, weights in zip(C, A, strict=True):
        slopes.append(rate(t + share * h, x + h * _weighted(weights, slopes)))
    after = x + h * _weighted(B, slopes)
    scale = tolerance * (1 + numbers.fmax(numbers.fabs(x), numbers.fabs(after)))
    fifth, third = (_sum_of_squares(_weighted(weights, slopes) / scale) for weights in (E5, E3))
    tiny = np.finfo(float).tiny  # both estimates vanish at rest
    return after, h * fifth / numbers.sqrt((fifth + 0.01 * third) * x.shape[0] + tiny)


def resize(error: float) -> float:
    """Factor by which the next step is longer, given the norm of this one's error."""
    return min(GROW, max(SHRINK, SAFETY / math.sqrt(math.sqrt(math.sqrt(error))))) if error else GROW


@dataclass(frozen=True, eq=False)
class AcceptedStep:
    """A step within the tolerance from `begin` to `end` (s), the state and the slope after it, and the length (s) to try next.

    `within` is the state as a function of the seconds since the beginning, up to the end.
    """

    begin: float
    end: float
    after: np.ndarray
    slope: np.ndarray
    following: float
    within: Callable[[float], np.ndarray]


class Integrator:
    """Integrates dx/dt = rate(t, x) with steps as long as the tolerance permits. `t` (s), `x`: where it is; `h` (s): the length
    of the next step to be tried."""

    def __init__(self, rate: Rate, t: float, x: np.ndarray, tolerance: float):
        self._rate, self._tolerance = rate, tolerance
        self.restart(t, x)

    def restart(self, t: float, x: np.ndarray) -> None:
        """Go on from here, where the rate may have changed."""
        self.t, self.x, self.h = t, x, FIRST
        self._slope: np.ndarray | None = None

    def step(self, bound: float) -> AcceptedStep:
        """A step from where it is, at most to `bound` (s); not yet taken.

        Raises BadInput where the tolerance cannot be met, and what `rate` raises.
        """
        t, x = self.t, self.x
        slope = self._slope = self._rate(t, x) if self._slope is None else self._slope

        def tried(seconds: float) -> tuple[np.ndarray, float]:
            return step(self._rate, t, x, slope, seconds, self._tolerance)

        grow, least = GROW, 10 * math.ulp(t)
        self.h = max(self.h, least)
        while True:
            end = min(t + self.h, bound)
            after, error = tried(end - t)
            if error < 1:
                following = (end - t) * min(grow, resize(error))
                return AcceptedStep(t, end, after, self._rate(end, after), following, lambda seconds: tried(seconds)[0])
            self.h, grow = (end - t) * resize(error), 1.0
            if self.h < least:
                raise BadInput(f"[simulation] tolerance = {self._tolerance:g} cannot be met at t = {t:.9g} s; loosen it")

    def take(self, step: AcceptedStep) -> None:
        """Go on from the end of a step."""
        self.t, self.x, self.h, self._slope = step.end, step.after, step.following, step.slope


def _weighted(weights: Mapping[int, float], slopes: Sequence[Vector]) -> Vector:
    terms = [weight * slopes[k] for k, weight in weights.items()]
    return sum(terms[1:], terms[0])


def _sum_of_squares(v: np.ndarray | ca.SX) -> Any:
    return sum(v[k] * v[k] for k in range(1, v.shape[0])) + v[0] * v[0]
