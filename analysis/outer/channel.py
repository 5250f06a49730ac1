"""One linear channel of the outer loop: its poles, loop, response, and longest sampling period."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import Polynomial
from scipy.optimize import brentq

from ...model.mechanism import derivative_name
from ...readers.errors import BadInput
from ...readers.reading import positive
from .design import Gains, by_speed, chain, sampled_chain, show
from .drive import DriveLoop, sampled_late
from .margins import Broken, Margins, margins, norm

if TYPE_CHECKING:
    import control  # slow to import

# Relative degree up to which the longest period is a root of a polynomial; above, it is searched for
MOST_EXACT = 2
SCAN = 30  # periods tried before the one at which a margin is lost is refined
SHORTEST = 1e-4  # of the stability limit: at shorter periods the margins are those of the continuous channel
# Periods tried: the first and the last of 1 / fastest pole, and by what they grow
FIRST, GROWTH, LONGEST = 0.02, 1.1, 1e3


@dataclass(frozen=True)
class Required:
    """Required margins of a loop: gain (factor), phase (rad), peak of |S|."""

    gain: float = 2.0
    phase: float = math.radians(45)
    Ms: float = 2.0

    def slack(self, margins: Margins) -> float:
        """Return a value that is positive if all margins are kept, and zero where the first is lost."""
        return min(
            math.log(margins.gain / self.gain), margins.phase - self.phase, math.log(self.Ms / margins.Ms)
        )


@dataclass(frozen=True)
class Channel:
    """An output and its gains. `period` (s) between calls, with v held in between; None: continuous.

    `delay`: v is applied one period after the state from which it was computed was measured. `drive`: v acts
    through velocity-controlled drives, which requires a period.
    """

    name: str
    unit: str
    gains: Gains
    period: float | None = None
    delay: bool = False
    drive: DriveLoop | None = None

    def __post_init__(self):
        self.gains.check(self.name)
        if self.period is not None:
            positive("period", self.period, self.name)
        elif self.delay:
            raise BadInput(f"{self.name}: a delay of one sample requires a period")
        elif self.drive:
            raise BadInput(f"{self.name}: {self.drive} require a period: commands are given at calls")
        if self.drive and self.gains.observer:
            raise BadInput(
                f"{self.name}: a disturbance observer does not go with {self.drive}: v acts later than it is "
                "given"
            )

    @property
    def ideal(self) -> "Channel":
        """The continuous channel, with v applied at once."""
        return replace(self, period=None, delay=False, drive=None)

    @property
    def poles(self) -> np.ndarray:
        """Poles of the closed loop: s (1/s), or z if it is sampled."""
        A, B, K = self._matrices()
        return by_speed(np.linalg.eigvals(A - B @ K))

    @property
    def dt(self) -> float:
        """The period as in python-control: 0 for continuous time."""
        return self.period or 0.0

    @property
    def _names(self) -> list[str]:
        """Names of y and its derivatives below the relative degree."""
        return [derivative_name(self.name, order) for order in range(self.gains.degree)]

    def plant(self) -> "control.StateSpace":
        """The chain of integrators from v to y and its derivatives below the relative degree;
        its signals have names."""
        import control

        A, B = (
            chain(self.gains.degree) if self.period is None else sampled_chain(self.gains.degree, self.period)
        )
        names = self._names
        signals = {"states": names, "inputs": [f"v_{self.name}"], "outputs": names}
        return control.ss(A, B, np.eye(len(A)), 0, self.dt, name=f"{self.name}_plant", **signals)

    def broken(self) -> Broken:
        """L, broken at v, negative feedback."""
        return Broken(*self._matrices(), self.dt)

    def loop(self) -> "control.StateSpace":
        """Return the same with names."""
        import control

        A, B, K = self._matrices()
        v = f"v_{self.name}"
        return control.ss(
            A, B, K, 0, self.dt, inputs=[v], outputs=[f"{v}_returned"], name=f"{self.name}_loop"
        )

    def margins(self) -> Margins:
        """Return the margins at v. Raises BadInput if the sampled channel is not stable."""
        self.check_stable()
        return margins(self.broken())

    def disturbed(self, largest: Sequence[float]) -> Broken:
        """Return the system from a disturbance of v, held between calls, to error, derivatives, integral and
        v; each relative to its largest value, in the order of `from_hinf`. Raises BadInput behind drives.
        """
        if self.drive:
            raise BadInput(
                f"{self.name}: what a disturbance does behind {self.drive} is not computed; leave out --hinf"
            )
        A, B, K = self._matrices()
        degree, integral = self.gains.degree, bool(self.gains.integral)
        order = [*range(integral, integral + degree), *range(integral)]
        C = np.vstack([np.eye(len(A))[order], -K]) / np.array(largest[:-1])[:, None]
        enters = np.zeros((len(A), 1))
        enters[: degree + integral] = self._chain()[1]
        return Broken(A - B @ K, enters * largest[-1], C, self.dt)

    def norm(self, largest: Sequence[float]) -> float:
        """Return the H-infinity norm of that system: at most 1 if a steady or oscillating disturbance of at
        most its largest value keeps all others within theirs. Raises BadInput if the sampled channel is not
        stable.
        """
        self.check_stable()
        return norm(self.disturbed(largest))

    def check_stable(self) -> None:
        """Raise BadInput for a period beyond stability."""
        fastest = max(self.poles, key=abs)
        if self.period is not None and not abs(fastest) < 1:
            limit = self.longest_period(self.delay)
            late = ", with a delay of one sample," if self.delay else ""
            behind = f", behind {self.drive}," if self.drive else ""
            slower = f", or with poles {self.fastest():.4g} times as fast" if self.drive else ""
            raise BadInput(
                f"{self.name}: period {self.period:g} s{late}{behind} is beyond stability, z = "
                f"{show(fastest)}; the channel is stable below {limit:.6g} s{slower}"
            )

    def longest_period(self, delay: bool) -> float:
        """Return the period (s) at which the channel loses stability, with or without a delay of one sample;
        0 if it is not stable at the shortest one tried.
        """
        if self.drive is None and self.gains.degree <= MOST_EXACT and not self.gains.observer:
            return longest_period(self.gains, delay)
        unit = 1 / max(self.gains.rates)
        first = max(FIRST, self.drive.shortest / unit) if self.drive else FIRST
        # An observer may be much faster than what ends stability
        last = LONGEST / unit / np.abs(self.gains.poles).max()
        return first_unstable(lambda T: replace(self, period=T, delay=delay)._excess(), unit, first, last)

    def fastest(self) -> float:
        """Return the factor by which all poles of the continuous channel may be faster until this sampled one
        loses stability."""
        if self.period is None:
            return math.inf
        unit = 1 / (self.period * max(self.gains.rates))
        return first_unstable(
            lambda factor: replace(self, gains=self.gains.faster(factor))._excess(), unit, 1e-4
        )

    def _excess(self) -> float:
        return float(abs(self.poles).max() - 1)

    def closed(self) -> "control.StateSpace":
        """Return the system from the desired y alone, with its derivatives zero, to y, its derivatives and v:
        for step responses.
        """
        import control

        A, B, K = self._matrices()
        size, degree = len(A), self.gains.degree
        first = int(bool(self.gains.integral))  # where y is
        reference = self.gains.error * B
        if self.gains.integral:  # z counts y - y_d
            reference[0, 0] -= self.period or 1.0
        if self.gains.observer:
            reference[degree + first, 0] -= self.gains.error * self._follows
        C = np.vstack([np.eye(size)[first : first + degree], -K])
        D = np.zeros((degree + 1, 1))
        D[-1, 0] = self.gains.error
        names = [*self._names, f"v_{self.name}"]
        signals = {"inputs": [f"{self.name}_d"], "outputs": names}
        return control.ss(A - B @ K, reference, C, D, self.dt, name=f"{self.name}_closed", **signals)

    def _matrices(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A, B of the chain [z,] y [, ydot] [, m of the observer] [, e of the drive] [, the v of the calls
        before], and K with v = -K state.

        The estimate is l y^(r-1) + m, with dm/dt = -l v without the estimate; or m - l T of that v at each
        call, l of which is the part of a change that the estimate follows, over T.
        """
        K = self.gains.vector[None, :]
        if self.drive and self.period:
            return self._behind(self.drive, self.period, K)
        A, B = self._chain()
        if self.gains.observer:
            part = self._follows
            A = np.block(
                [[A, np.zeros((len(A), 1))], [part * K, np.eye(1) if self.period else np.zeros((1, 1))]]
            )
            B = np.vstack([B, [[0.0]]])
            K = np.append(K + part / (self.period or 1.0) * np.eye(len(K[0]))[-1:], [[1.0]], axis=1)
        if not self.delay:
            return A, B, K
        return *delayed(A, B), np.hstack([K, [[0.0]]])

    @property
    def _follows(self) -> float:
        """The part of a change of the disturbance that the estimate follows in a period;
        in continuous time in 1 s."""
        rate, period = self.gains.observer, self.period
        return rate if period is None else rate * period / (1 + rate * period)

    def _chain(self) -> tuple[np.ndarray, np.ndarray]:
        """A, B of the chain [z,] y [, ydot ...], driven by v."""
        degree, integral = self.gains.degree, bool(self.gains.integral)
        return (
            chain(degree + integral) if self.period is None else sampled_chain(degree, self.period, integral)
        )

    def _behind(
        self, drive: DriveLoop, period: float, K: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        between = drive.between_samples(*chain(self.gains.degree), period)
        A, B = sampled_late(*between, period, drive.delay + period * self.delay)
        if self.gains.integral:  # z + period y, at each call
            row = np.eye(len(A) + 1)[:1] + period * np.eye(len(A) + 1)[1:2]
            A, B = np.vstack([row, np.hstack([np.zeros((len(A), 1)), A])]), np.vstack([[[0.0]], B])
        return A, B, np.hstack([K, np.zeros((1, len(A) - K.shape[1]))])


def delayed(A: np.ndarray, B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return A, B with the inputs applied one call later; those of the previous call are additional states,
    the last ones."""
    n, r = B.shape
    return np.block([[A, B], [np.zeros((r, n + r))]]), np.vstack([np.zeros((n, r)), np.eye(r)])


def longest_period(gains: Gains, delay: bool = False) -> float:
    """The period (s) at which the sampled channel, of relative degree 1 or 2, loses stability; it is stable
    at all shorter ones.

    Exact: with w = (z - 1) / (z + 1) stability ends where the first or last coefficient of the characteristic
    polynomial, or Hurwitz's last determinant but one, vanishes; all three are polynomials in the period.
    """
    unit = 1 / max(abs(gains.poles))  # the period is counted in this, for polynomials of good scale
    coefficients = _characteristic(gains, unit, delay)
    ends = [coefficients[0], coefficients[-1], _determinant(_hurwitz_matrix(coefficients))]
    positive_roots = [root for polynomial in ends for root in _positive_roots(polynomial)]
    return min(positive_roots, default=math.inf) * unit


def first_unstable(
    excess: Callable[[float], float], unit: float, first: float = FIRST, last: float = LONGEST
) -> float:
    """Return the first zero of a function of the period that is negative at short ones; 0 if the shortest
    tried is not, inf if all are. The periods tried, from `first` to `last` times `unit`, grow by a tenth; the
    zero is refined to rounding.
    """
    before, period = 0.0, first * unit
    while period < last * unit:
        if excess(period) >= 0:
            return float(brentq(excess, before, period, rtol=1e-13)) if before else 0.0
        before, period = period, GROWTH * period
    return math.inf


def longest_period_with(channel: Channel, required: Required) -> float:
    """Return the longest period (s) up to which the sampled channel keeps the required margins at all shorter
    ones; 0 if at none.

    Found between two of SCAN periods, and refined to rounding.
    """
    return last_kept(
        lambda period: required.slack(replace(channel, period=period).margins()),
        channel.longest_period(channel.delay),
        channel.drive.shortest if channel.drive else 0.0,
    )


def last_kept(slack: Callable[[float], float], limit: float, shortest: float = 0.0) -> float:
    """Return the first zero below `limit` of a function of the period that is positive at short ones, from
    `shortest` on; 0 if it is not.
    """
    before = 0.0
    if limit <= shortest:
        return 0.0
    for period in np.geomspace(max(shortest, SHORTEST * limit), (1 - 1e-6) * limit, SCAN):
        if slack(period) <= 0:
            return float(brentq(slack, before, period, rtol=1e-12)) if before else 0.0
        before = period
    return limit


def _characteristic(gains: Gains, unit: float, delay: bool) -> list[Polynomial]:
    """Coefficients, lowest power of w first, of the characteristic polynomial, each a polynomial in the
    period over `unit`.

    It is z^delay (z - 1)^N plus a term for each gain, in powers of z - 1 = 2w / (1 - w). The transfer
    functions from the held v are T / (z - 1) to the rate, T^2 (z + 1) / 2 (z - 1)^2 to the error, and T /
    (z - 1) times the latter to the integral.
    """
    order, w = len(gains.vector), Polynomial([0.0, 1.0])
    terms = [(0, (1 + w) ** delay * (2 * w) ** order)]
    for k, gain in enumerate(gains.of_errors[::-1], start=1):
        terms.append((k, gain * unit**k * (2 * w) ** (order - k) * (1 - w) ** (delay + 1)))
    if gains.integral:
        terms.append((order, gains.integral * unit**order * (1 - w) ** (delay + 2)))
    coefficients = np.zeros((order + delay + 1, order + 1))
    for power, polynomial in terms:
        coefficients[: len(polynomial.coef), power] += np.asarray(polynomial.coef, float)
    return [Polynomial(row) for row in coefficients]


def _hurwitz_matrix(coefficients: list[Polynomial]) -> list[list[Polynomial]]:
    """Hurwitz's matrix of order n - 1."""
    n, zero = len(coefficients) - 1, Polynomial([0.0])
    falling = coefficients[::-1]

    def entry(row: int, column: int) -> Polynomial:
        k = 2 * column - row + 1
        return falling[k] if 0 <= k <= n else zero

    return [[entry(row, column) for column in range(n - 1)] for row in range(n - 1)]


def _determinant(matrix: list[list[Polynomial]]) -> Polynomial:
    if not matrix:
        return Polynomial([1.0])
    total = Polynomial([0.0])
    for column, value in enumerate(matrix[0]):
        rest = [row[:column] + row[column + 1 :] for row in matrix[1:]]
        total = total + (-1) ** column * value * _determinant(rest)
    return total


def _positive_roots(polynomial: Polynomial) -> list[float]:
    coefficients = polynomial.coef.copy()
    coefficients[np.abs(coefficients) < 1e-12 * np.abs(coefficients).max()] = 0.0
    roots: np.ndarray = Polynomial(np.trim_zeros(coefficients)).roots()
    return [float(root.real) for root in roots if root.real > 0 and abs(root.imag) < 1e-7 * abs(root)]
