"""The method of Dormand and Prince of order 8, with its two error estimates (Hairer, Norsett, Wanner, Solving
ODEs I, II.10).

Sums are formed term by term and powers by square roots: no BLAS and no libm, whose last bits differ by
processor.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add
from typing import Any, TypeVar

import casadi as ca
import numpy as np

from ..readers.errors import BadInput

Vector = TypeVar("Vector", np.ndarray, ca.SX)
Scalar = TypeVar("Scalar", float, ca.SX)
Rate = Callable[[float, np.ndarray], np.ndarray]

SAFETY = 0.9
SHRINK, GROW = 0.2, 10.0  # least and largest factor between the lengths of one step and the next
FIRST = 1e-3  # s, the first step tried

# Twelve stages: C says at which part of the step each is taken, row k of A (stage -> weight) from which
# slopes, B weighs the slopes in the result, E5 and E3 in the differences from results of order 5 and 3.
# Weights of zero are left out (ibid., II.5).
C = (
    0.05260015195876773,
    0.0789002279381516,
    0.1183503419072274,
    0.2816496580927726,
    0.3333333333333333,
    0.25,
    0.3076923076923077,
    0.6512820512820513,
    0.6,
    0.8571428571428571,
    1.0,
)
A: tuple[dict[int, float], ...] = (
    {0: 0.05260015195876773},
    {0: 0.0197250569845379, 1: 0.0591751709536137},
    {0: 0.02958758547680685, 2: 0.08876275643042054},
    {0: 0.2413651341592667, 2: -0.8845494793282861, 3: 0.924834003261792},
    {0: 0.037037037037037035, 3: 0.17082860872947386, 4: 0.12546768756682242},
    {0: 0.037109375, 3: 0.17025221101954405, 4: 0.06021653898045596, 5: -0.017578125},
    {
        0: 0.03709200011850479,
        3: 0.17038392571223998,
        4: 0.10726203044637328,
        5: -0.015319437748624402,
        6: 0.008273789163814023,
    },
    {
        0: 0.6241109587160757,
        3: -3.3608926294469414,
        4: -0.868219346841726,
        5: 27.59209969944671,
        6: 20.154067550477894,
        7: -43.48988418106996,
    },
    {
        0: 0.47766253643826434,
        3: -2.4881146199716677,
        4: -0.590290826836843,
        5: 21.230051448181193,
        6: 15.279233632882423,
        7: -33.28821096898486,
        8: -0.020331201708508627,
    },
    {
        0: -0.9371424300859873,
        3: 5.186372428844064,
        4: 1.0914373489967295,
        5: -8.149787010746927,
        6: -18.52006565999696,
        7: 22.739487099350505,
        8: 2.4936055526796523,
        9: -3.0467644718982196,
    },
    {
        0: 2.273310147516538,
        3: -10.53449546673725,
        4: -2.0008720582248625,
        5: -17.9589318631188,
        6: 27.94888452941996,
        7: -2.8589982771350235,
        8: -8.87285693353063,
        9: 12.360567175794303,
        10: 0.6433927460157636,
    },
)
B = {
    0: 0.054293734116568765,
    5: 4.450312892752409,
    6: 1.8915178993145003,
    7: -5.801203960010585,
    8: 0.3111643669578199,
    9: -0.1521609496625161,
    10: 0.20136540080403034,
    11: 0.04471061572777259,
}
E5 = {
    0: 0.01312004499419488,
    5: -1.2251564463762044,
    6: -0.4957589496572502,
    7: 1.6643771824549864,
    8: -0.35032884874997366,
    9: 0.3341791187130175,
    10: 0.08192320648511571,
    11: -0.022355307863886294,
}
E3 = {
    0: -0.18980075407240762,
    5: 4.450312892752409,
    6: 1.8915178993145003,
    7: -5.801203960010585,
    8: -0.4226823213237919,
    9: -0.1521609496625161,
    10: 0.20136540080403034,
    11: 0.02265179219836082,
}


def _column(weights: Mapping[int, float]) -> np.ndarray:
    """Return the weights of the slopes from the first one on, (k, 1)."""
    return np.array([[weights.get(k, 0.0)] for k in range(max(weights) + 1)])


STAGES, RESULT, ERRORS = [_column(row) for row in A], _column(B), [_column(E5), _column(E3)]


def step(
    rate: Callable[[Scalar, Vector], Vector],
    t: Scalar,
    x: Vector,
    slope: Vector,
    h: Scalar,
    tolerance: Scalar,
) -> tuple[Vector, Scalar]:
    """State after one step of h seconds from x, where the slope is rate(t, x), and the norm of its error, at
    most 1 within `tolerance`, relative and absolute. Of arrays, or as CasADi expressions."""
    numbers = ca if isinstance(x, ca.SX) else np
    slopes = [slope] * (len(C) + 1) if isinstance(x, ca.SX) else np.array([slope] * (len(C) + 1))
    for k, share in enumerate(C):
        slopes[k + 1] = rate(t + share * h, x + h * _weighted(STAGES[k], slopes))
    after = x + h * _weighted(RESULT, slopes)
    scale = tolerance * (1 + numbers.fmax(numbers.fabs(x), numbers.fabs(after)))
    fifth, third = (_sum_of_squares(_weighted(weights, slopes) / scale) for weights in ERRORS)
    tiny = np.finfo(float).tiny  # both estimates vanish at rest
    return after, h * fifth / numbers.sqrt((fifth + 0.01 * third) * x.shape[0] + tiny)


def resize(error: float) -> float:
    """Factor by which the next step is longer, given the norm of this one's error."""
    return min(GROW, max(SHRINK, SAFETY / math.sqrt(math.sqrt(math.sqrt(error))))) if error else GROW


@dataclass(frozen=True, eq=False)
class AcceptedStep:
    """A step within the tolerance from `begin` to `end` (s), the state and the slope after it, and the length
    (s) to try next.

    `within` is the state as a function of the seconds since the beginning, up to the end.
    """

    begin: float
    end: float
    after: np.ndarray
    slope: np.ndarray
    following: float
    within: Callable[[float], np.ndarray]


class Integrator:
    """Integrates dx/dt = rate(t, x) with steps as long as the tolerance permits. `t` (s), `x`: where it is;
    `h` (s): the length of the next step to be tried."""

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
                return AcceptedStep(
                    t, end, after, self._rate(end, after), following, lambda seconds: tried(seconds)[0]
                )
            self.h, grow = (end - t) * resize(error), 1.0
            if self.h < least:
                raise BadInput(
                    f"[simulation] tolerance = {self._tolerance:g} cannot be met at t = {t:.9g} s; loosen it"
                )

    def take(self, step: AcceptedStep) -> None:
        """Go on from the end of a step."""
        self.t, self.x, self.h, self._slope = step.end, step.after, step.following, step.slope


def _weighted(weights: np.ndarray, slopes: Sequence[ca.SX] | np.ndarray) -> Any:
    """Return the sum of the first slopes by their weights, (k, 1);
    rows of an array are added one after the other."""
    if isinstance(slopes, np.ndarray):
        return np.add.reduce(weights * slopes[: len(weights)])
    return reduce(add, [weight * slopes[k] for k, weight in enumerate(weights.ravel().tolist()) if weight])


def _sum_of_squares(v: np.ndarray | ca.SX) -> Any:
    squares = ca.vertsplit(v * v) if isinstance(v, ca.SX) else (v * v).tolist()
    # Not by sum(), which compensates rounding from Python 3.12 on: the bits would depend on the version.
    return reduce(add, [*squares[1:], squares[0]])
