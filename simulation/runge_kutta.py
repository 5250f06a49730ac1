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

# Between the ends of a step a polynomial of order 7 is used (ibid., II.6). It takes three more slopes, after
# that at the end, at these parts of the step, and its highest four coefficients weigh all sixteen.
WITHIN_C = (0.1, 0.2, 0.7777777777777778)
WITHIN_A: tuple[dict[int, float], ...] = (
    {
        0: 0.056167502283047954,
        6: 0.25350021021662483,
        7: -0.2462390374708025,
        8: -0.12419142326381637,
        9: 0.15329179827876568,
        10: 0.00820105229563469,
        11: 0.007567897660545699,
        12: -0.008298,
    },
    {
        0: 0.03183464816350214,
        5: 0.028300909672366776,
        6: 0.053541988307438566,
        7: -0.05492374857139099,
        10: -0.00010834732869724932,
        11: 0.0003825710908356584,
        12: -0.00034046500868740456,
        13: 0.1413124436746325,
    },
    {
        0: -0.42889630158379194,
        5: -4.697621415361164,
        6: 7.683421196062599,
        7: 4.06898981839711,
        8: 0.3567271874552811,
        12: -0.0013990241651590145,
        13: 2.9475147891527724,
        14: -9.15095847217987,
    },
)
WITHIN_D: tuple[dict[int, float], ...] = (
    {
        0: -8.428938276109013,
        5: 0.5667149535193777,
        6: -3.0689499459498917,
        7: 2.38466765651207,
        8: 2.117034582445028,
        9: -0.871391583777973,
        10: 2.2404374302607883,
        11: 0.6315787787694688,
        12: -0.08899033645133331,
        13: 18.148505520854727,
        14: -9.194632392478356,
        15: -4.436036387594894,
    },
    {
        0: 10.427508642579134,
        5: 242.28349177525817,
        6: 165.20045171727028,
        7: -374.5467547226902,
        8: -22.113666853125306,
        9: 7.733432668472264,
        10: -30.674084731089398,
        11: -9.332130526430229,
        12: 15.697238121770845,
        13: -31.139403219565178,
        14: -9.35292435884448,
        15: 35.81684148639408,
    },
    {
        0: 19.985053242002433,
        5: -387.0373087493518,
        6: -189.17813819516758,
        7: 527.8081592054236,
        8: -11.57390253995963,
        9: 6.8812326946963,
        10: -1.0006050966910838,
        11: 0.7777137798053443,
        12: -2.778205752353508,
        13: -60.19669523126412,
        14: 84.32040550667716,
        15: 11.99229113618279,
    },
    {
        0: -25.69393346270375,
        5: -154.18974869023643,
        6: -231.5293791760455,
        7: 357.6391179106141,
        8: 93.40532418362432,
        9: -37.45832313645163,
        10: 104.0996495089623,
        11: 29.8402934266605,
        12: -43.53345659001114,
        13: 96.32455395918828,
        14: -39.17726167561544,
        15: -149.72683625798564,
    },
)


def _column(weights: Mapping[int, float]) -> np.ndarray:
    """Return the weights of the slopes from the first one on, (k, 1)."""
    return np.array([[weights.get(k, 0.0)] for k in range(max(weights) + 1)])


STAGES, RESULT, ERRORS = [_column(row) for row in A], _column(B), [_column(E5), _column(E3)]
WITHIN_STAGES, WITHIN = [_column(row) for row in WITHIN_A], [_column(row) for row in WITHIN_D]


def step(
    rate: Callable[[Scalar, Vector], Vector],
    t: Scalar,
    x: Vector,
    slope: Vector,
    h: Scalar,
    tolerance: Scalar,
) -> tuple[Vector, Scalar, Any]:
    """State after one step of h seconds from x, where the slope is rate(t, x), the norm of its error, at
    most 1 within `tolerance`, relative and absolute, and the slopes. Of arrays, or as CasADi expressions."""
    numbers = ca if isinstance(x, ca.SX) else np
    slopes = [slope] * (len(C) + 1) if isinstance(x, ca.SX) else np.array([slope] * (len(C) + 1))
    for k, share in enumerate(C):
        slopes[k + 1] = rate(t + share * h, x + h * _weighted(STAGES[k], slopes))
    after = x + h * _weighted(RESULT, slopes)
    scale = tolerance * (1 + numbers.fmax(numbers.fabs(x), numbers.fabs(after)))
    fifth, third = (_sum_of_squares(_weighted(weights, slopes) / scale) for weights in ERRORS)
    tiny = np.finfo(float).tiny  # both estimates vanish at rest
    return after, h * fifth / numbers.sqrt((fifth + 0.01 * third) * x.shape[0] + tiny), slopes


def resize(error: float) -> float:
    """Factor by which the next step is longer, given the norm of this one's error."""
    return min(GROW, max(SHRINK, SAFETY / math.sqrt(math.sqrt(math.sqrt(error))))) if error else GROW


@dataclass(frozen=True, eq=False)
class AcceptedStep:
    """A step within the tolerance from `begin` to `end` (s): state and slope after it, and the length (s) to
    try next."""

    begin: float
    end: float
    after: np.ndarray
    slope: np.ndarray
    following: float
    _coefficients: Sequence[np.ndarray]

    def within(self, t: np.ndarray | float) -> np.ndarray:
        """Return the state at t (s), from the beginning up to the end; a row for each of several times."""
        part = (np.asarray(t)[..., None] - self.begin) / (self.end - self.begin)
        state = np.zeros(1)
        for k, coefficient in reversed([*enumerate(self._coefficients)]):
            state = coefficient + (1 - part if k % 2 else part) * state
        return state


def _within(
    rate: Rate, t: float, x: np.ndarray, after: np.ndarray, slopes: np.ndarray, last: np.ndarray, h: float
) -> list[np.ndarray]:
    """Return the coefficients of the polynomial within a step of h seconds from x at t, with its slopes and
    the `last` one, after it."""
    known, way = len(slopes) + 1, after - x
    slopes = np.concatenate([slopes, [last] * (1 + len(WITHIN_C))])
    for k, (share, weights) in enumerate(zip(WITHIN_C, WITHIN_STAGES, strict=True), known):
        slopes[k] = rate(t + share * h, x + h * _weighted(weights, slopes))
    highest = [h * _weighted(weights, slopes) for weights in WITHIN]
    return [x, way, h * slopes[0] - way, 2 * way - (h * slopes[0] + h * last), *highest]


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
        grow, least = GROW, 10 * math.ulp(t)
        self.h = max(self.h, least)
        while True:
            end = min(t + self.h, bound)
            after, error, slopes = step(self._rate, t, x, slope, end - t, self._tolerance)
            if error < 1:
                last = self._rate(end, after)
                within = _within(self._rate, t, x, after, slopes, last, end - t)
                return AcceptedStep(t, end, after, last, (end - t) * min(grow, resize(error)), within)
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
