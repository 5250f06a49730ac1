"""Gains of one channel of the outer loop: from poles, from settling time and damping, LQR, H-infinity;
continuous or sampled.

After the second feedback (20) each output is a chain of as many integrators as its relative degree, driven by
v. The law is

    relative degree 2:  v = yddot_d + kd (ydot_d - ydot) + kp (y_d - y) + ki z      s^3 + kd s^2 + kp s + ki
    relative degree 1:  v = ydot_d + kv (y_d - y) + ki z                            s^2 + kv s + ki

with z the integral of y_d - y; without integral action ki = 0 and the characteristic polynomial has one root
less. Longer chains, those of a dynamic extension, have gains on higher derivatives too: ka on that of the
second and so on. An observer of the disturbance d in y^(r) = v + d subtracts its estimate from v; it adds a
pole at -ko, and the others stay.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_continuous_are, solve_discrete_are
from scipy.optimize import brentq

from ...model.law import GAINS, ORDINAL, gain_names
from ...readers.errors import BadInput, naming
from ...readers.reading import positive
from .exponential import exponential

SETTLED = 0.02  # an error has settled if it stays within this part of its initial value
# Rate of an observer beside the fastest pole; a faster one is lost in the rounding of the poles
FASTEST = 1e3
DEGREES = range(1, len(GAINS) + 1)
SAMPLES = 4000  # instants at which an error is evaluated to find its settling time


@dataclass(frozen=True)
class Gains:
    """Gains of a channel: on the error (kp, or kv for relative degree 1), on its rate (kd), on its integral
    (ki), and on the errors of `higher` derivatives, from the second on (ka, kj, ...); the rate of its
    disturbance `observer` (ko); SI.
    """

    degree: int
    error: float
    rate: float = 0.0
    integral: float = 0.0
    higher: tuple[float, ...] = ()
    observer: float = 0.0

    @property
    def of_errors(self) -> list[float]:
        """The gains on the errors of the derivatives of order 0 to degree - 1."""
        return [self.error, self.rate, *self.higher][: self.degree]

    @property
    def vector(self) -> np.ndarray:
        """Feedback from the chain of integrators [z,] y [, ydot, ...]: v = -vector @ state."""
        return np.array([self.integral, *self.of_errors] if self.integral else self.of_errors)

    @property
    def poles(self) -> np.ndarray:
        """Closed-loop poles, 1/s, slowest first; that of the observer is not among them."""
        return by_speed(np.roots([1.0, *self.vector[::-1]]))

    @property
    def rates(self) -> np.ndarray:
        """Magnitudes of all poles, with that of the observer, 1/s."""
        return np.abs([*self.poles, *[self.observer] * bool(self.observer)])

    def named(self, row: str) -> dict[str, float]:
        """Return the gains by name as in the law: kp_distance, ... ; ki_distance,
        ko_distance only where there are any."""
        gains = {
            f"{name}_{row}": gain for name, gain in zip(gain_names(self.degree), self.of_errors, strict=True)
        }
        more = {f"ki_{row}": self.integral, f"ko_{row}": self.observer}
        return gains | {name: gain for name, gain in more.items() if gain}

    def faster(self, factor: float) -> "Gains":
        """Return the gains whose poles are `factor` times as fast."""
        d = self.degree
        errors = [gain * factor ** (d - order) for order, gain in enumerate(self.of_errors)]
        return replace(
            gains_of(d, errors, self.integral * factor ** (d + 1)), observer=self.observer * factor
        )

    def check(self, where: str = "gains") -> "Gains":
        """Return itself. Raises BadInput, with the reason, if a gain is negative or not finite,
        or the channel is not stable."""
        for name, value in self.named(where).items():
            if not math.isfinite(value):
                raise BadInput(f"{name} = {value} is not finite")
            if value < 0:
                remedy = "a rate of 0 or more" if name.startswith("ko_") else "other poles"
                raise BadInput(
                    f"{name} = {value:.6g} is negative, which the law does not allow; choose {remedy}"
                )
        worst = max(self.poles, key=lambda pole: pole.real)
        if not worst.real < -1e-12 * max(np.abs(self.poles)):
            raise BadInput(
                f"{where}: unstable, it has a pole at {show(worst)} 1/s; all must have a negative real part"
            )
        most = FASTEST * float(np.abs(self.poles).max())
        if self.observer > most:
            raise BadInput(
                f"{where}: the observer is too fast with {self.observer:g} 1/s: choose a rate of at most "
                f"{most:.4g} 1/s, {FASTEST:g} times that of the fastest pole"
            )
        return self


def from_poles(
    degree: int, poles: Sequence[complex], integral: bool = False, where: str = "channel"
) -> Gains:
    """Return the gains for these poles (1/s): as many as the degree, one more with integral action.

    Raises BadInput for a wrong number of poles, complex poles without their conjugates, and unstable ones.
    """
    polynomial = _polynomial(degree, poles, integral, where)
    _refuse(
        [p for p in poles if not complex(p).real < 0], "1/s is unstable; give a negative real part", where
    )
    return _gains(degree, polynomial[:0:-1], integral).check(where)


def from_settling(
    degree: int, settling: float, damping: float = 1.0, integral: bool = False, where: str = "channel"
) -> Gains:
    """Return gains with which an error that starts at rest stays within 2 % of its initial value after
    `settling` s.

    Degree 2: a pair of poles with the damping ratio given, 1 critically damped, larger overdamped (no
    overshoot near a wall); with integral action, and for each degree more, another pole at their natural
    frequency. Degree 1: one pole; a pair with integral action.
    Raises BadInput for numbers that are not positive.
    """
    positive("settling time", settling, where)
    positive("damping ratio", damping, where)
    split = np.emath.sqrt(damping**2 - 1)
    pair = [-damping - split, -damping + split]
    order = _order(degree, integral, where)
    shape = [-1.0] if order == 1 else [*pair, *[-1.0] * (order - 2)]
    unit = from_poles(degree, shape, integral, where)
    return from_poles(degree, [pole * (settling_time(unit) / settling) for pole in shape], integral, where)


def settling_time(gains: Gains) -> float:
    """Return the time (s) after which an error of 1 that starts at rest, with integral 0, stays within 2 %;
    exact up to rounding.
    """
    poles = gains.poles
    closed, start = chain(len(poles))[0], np.zeros(len(poles))
    closed[-1] -= gains.vector
    start[len(poles) - gains.degree] = 1.0
    error = start  # the row that reads y is the one that starts at 1

    def beyond(t: float) -> float:
        return abs(error @ exponential(closed * t) @ start) - SETTLED

    times = np.linspace(0.0, 40 / min(-poles.real), SAMPLES)
    step, state, outside = exponential(closed * times[1]), start, 0
    for k in range(SAMPLES):
        outside = k if abs(error @ state) > SETTLED else outside
        state = step @ state
    # Lost in rounding
    if outside + 1 == SAMPLES or not beyond(times[outside]) >= 0 >= beyond(times[outside + 1]):
        raise BadInput(
            f"poles {', '.join(f'{pole:.3g}' for pole in poles)} 1/s: the settling time cannot be computed; "
            "choose faster poles"
        )
    return float(brentq(beyond, times[outside], times[outside + 1], xtol=1e-14))


def from_lqr(
    degree: int,
    largest: Sequence[float],
    integral: bool = False,
    period: float | None = None,
    where: str = "channel",
) -> Gains:
    """Return the gains of a linear-quadratic regulator with Bryson's weights: 1 / largest^2 of error, its
    derivatives below the relative degree, integral, and v.

    `largest` are the largest acceptable values of these, SI, in this order. With a period (s), the sampled
    channel is regulated. Raises BadInput for a wrong number of values, or values that are not positive.
    """
    names = size_names(degree, integral)
    _check_sizes("LQR", names, largest, where)
    return _regulator(degree, largest, 1 / float(largest[-1]) ** 2, integral, period)[0].check(where)


def from_hinf(
    degree: int,
    largest: Sequence[float],
    integral: bool = False,
    period: float | None = None,
    where: str = "channel",
) -> Gains:
    """Return the gains of the central H-infinity state feedback against a disturbance d of the virtual input,
    y^(r) = v + d.

    `largest` are the values of `from_lqr` followed by the largest |d|, all SI. The H-infinity norm from d to
    error, derivatives, integral and v, each divided by its largest value, is below 1 (`Channel.norm`): a
    steady or oscillating disturbance of at most that size keeps all of them within theirs. As d enters where
    v does, the gains exist in continuous time if and only if d is smaller than v, and the Riccati equation is
    that of a regulator with v^2 - d^2 in place of v^2. With a period (s), the disturbance too is held over
    it, which v cannot answer before the next call: d must be smaller still.

    T. Basar and P. Bernhard, H-infinity-Optimal Control and Related Minimax Design Problems, theorems 4.8 and
    3.8. Raises BadInput for a wrong number of values, values that are not positive, and a disturbance that is
    too large.
    """
    _check_sizes("H-infinity", [*size_names(degree, integral), "disturbance"], largest, where)
    v, d = map(float, largest[-2:])
    if not d < v:
        raise BadInput(
            f"{where}: the largest disturbance, {d:g}, must be below the largest v, {v:g}, which has to "
            "compensate it"
        )

    def play(d: float) -> tuple[Gains, float]:
        gains, cost = _regulator(degree, largest[:-1], 1 / (v**2 - d**2), integral, period)
        return gains, d**2 * cost - 1

    gains, excess = play(d)
    if not excess < 0:
        bearable = brentq(lambda d: play(d)[1], 0.0, d, rtol=1e-9)
        raise BadInput(
            f"{where}: called every {period:g} s, no gains keep all within these values under a disturbance "
            f"of {d:g}, only below {bearable:.4g}; make the period shorter, the disturbance smaller, or the "
            "other values larger"
        )
    part = v**2 / (v**2 - d**2)  # of what the game's two players do together, v's share
    return gains_of(degree, [part * gain for gain in gains.of_errors], part * gains.integral).check(where)


def size_names(degree: int, integral: bool) -> list[str]:
    """Return what the largest values of LQR and H-infinity design are of, in their order."""
    _order(degree, integral, "channel")
    return ["error", *ORDINAL[1:degree], *["integral"] * int(integral), "v"]


def _check_sizes(design: str, names: Sequence[str], largest: Sequence[float], where: str) -> None:
    if len(largest) != len(names):
        raise BadInput(
            f"{where}: {design} requires {len(names)} largest values ({', '.join(names)}), not {len(largest)}"
        )
    for name, value in zip(names, largest, strict=True):
        positive(f"largest {name}", value, where)


def _regulator(
    degree: int, largest: Sequence[float], R: float, integral: bool, period: float | None
) -> tuple[Gains, float]:
    """Return the gains that minimize the sum of squares of `largest` without its last, v, and R v^2; and,
    with a period (s), the least cost from the state to which v = 1 leads, else 0.
    """
    of_chain = [*largest[degree : degree + integral], *largest[:degree]]
    Q = np.diag(1 / np.square(of_chain, dtype=float))
    if period is None:
        A, B = chain(degree + integral)
        return _gains(degree, (B.T @ solve_continuous_are(A, B, Q, R) / R)[0], integral), 0.0
    A, B = sampled_chain(degree, positive("period", period, "channel"), integral)
    X = solve_discrete_are(A, B, Q, R)
    cost = float((B.T @ X @ B)[0, 0])
    return _gains(degree, (B.T @ X @ A)[0] / (R + cost), integral), cost


def from_discrete_poles(
    degree: int, poles: Sequence[complex], period: float, integral: bool = False, where: str = "channel"
) -> Gains:
    """Return gains that give the sampled channel, with v held over each period (s), these poles z. Raises
    BadInput as `from_poles`.
    """
    positive("period", period, where)
    polynomial = _polynomial(degree, poles, integral, where)
    _refuse([p for p in poles if not abs(complex(p)) < 1], "is unstable; give |z| < 1", where)
    A, B = sampled_chain(degree, period, integral)
    size = len(A)
    free = np.poly(A)  # the characteristic polynomial is affine in the gains: one column each
    columns = [np.poly(A - B @ unit[None, :]) - free for unit in np.eye(size)]
    vector = np.linalg.solve(np.array(columns).T[1:], (polynomial - free)[1:])
    return _gains(degree, vector, integral).check(where)


def chain(size: int) -> tuple[np.ndarray, np.ndarray]:
    """A, B of a chain of integrators, the last of which is driven by v."""
    return np.eye(size, k=1), np.eye(size)[:, -1:]


def sampled_chain(degree: int, period: float, integral: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """A, B of the sampled chain, v held between calls: exact for y and its derivatives; z grows by period
    (y_d - y) at each call.
    """
    taylor = [period**order / math.factorial(order) for order in range(degree + 1)]
    A = sum(
        (taylor[order] * np.eye(degree, k=order) for order in range(degree)), start=np.zeros((degree, degree))
    )
    B = np.array(taylor[:0:-1])[:, None]
    if not integral:
        return A, B
    above = np.eye(degree + 1)[:1] + period * np.eye(degree + 1)[1:2]
    return np.vstack([above, np.hstack([np.zeros((degree, 1)), A])]), np.vstack([[[0.0]], B])


def by_speed(poles: np.ndarray) -> np.ndarray:
    """Poles sorted by magnitude, the upper one of a pair first."""
    return np.array(sorted(poles, key=lambda p: (round(abs(p), 12), -p.imag)), complex)


def show(pole: complex) -> str:
    """Return a pole with a few digits, the imaginary part only if it exceeds the rounding error of a triple
    pole."""
    pole = complex(pole)
    if abs(pole.imag) <= 3e-5 * abs(pole):
        return f"{pole.real:.4g}"
    return f"{pole.real:.4g}{pole.imag:+.4g}j"


def _gains(degree: int, vector: np.ndarray, integral: bool) -> Gains:
    """Return the gains from the feedback of the chain [z,] y [, ydot, ...]."""
    z, y = (float(vector[0]), vector[1:]) if integral else (0.0, vector)
    return gains_of(degree, y.tolist(), z)


def gains_of(degree: int, of_errors: Sequence[float], integral: float = 0.0) -> Gains:
    """Return the gains from those on the errors of the derivatives of order 0 to degree - 1."""
    error, rate, *higher = [*map(float, of_errors), *([0.0] if degree == 1 else [])]
    return Gains(degree, error, rate, integral, tuple(higher))


def _polynomial(degree: int, poles: Sequence[complex], integral: bool, where: str) -> np.ndarray:
    """Return the monic polynomial with these roots. Raises BadInput if a channel cannot have them."""
    count = _order(degree, integral, where)
    with naming(f"{where}: poles {poles!r} are not numbers", (TypeError, ValueError)):
        roots = np.array([complex(pole) for pole in poles])
    if len(roots) > count:
        better = ", or use integral action" if len(roots) == count + 1 and not integral else ""
        raise BadInput(
            f"{where}: {len(roots)} poles make the controller improper, it would require a derivative more "
            f"than is measured; give {count}{better}"
        )
    if len(roots) < count:
        raise BadInput(f"{where}: {len(roots)} poles for a channel that has {count}")
    if not np.all(np.isfinite(roots)):
        raise BadInput(f"{where}: a pole is not finite")
    polynomial = np.poly(roots)
    if np.abs(np.imag(polynomial)).max() > 1e-9 * np.abs(polynomial).max():
        raise BadInput(f"{where}: complex poles come in pairs; give the conjugate of each too")
    return np.real(polynomial)


def _refuse(poles: Sequence[complex], why: str, where: str) -> None:
    for pole in poles:
        raise BadInput(f"{where}: a pole at {show(pole)} {why}")


def _order(degree: int, integral: bool, where: str) -> int:
    """Return the number of poles of a channel. Raises BadInput for a relative degree that no law has."""
    if degree not in DEGREES:
        raise BadInput(f"{where}: relative degree {degree}; gains exist for {DEGREES[0]} to {DEGREES[-1]}")
    return degree + integral
