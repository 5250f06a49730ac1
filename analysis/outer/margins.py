"""Stability margins of a loop: classical margins, disk margins, peaks of the sensitivities; norms; continuous
and sampled loops.

L is the loop's transfer function where it is broken, negative feedback: S = (1 + L)^-1, T = L (1 + L)^-1.
Everything is found on a grid of frequencies and refined between its points, which does not require slycot and
allows delays (poles at z = 0).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from scipy.optimize import brentq, minimize_scalar

POINTS = 600  # frequencies
BELOW, ABOVE = 1e-3, 1e2  # the grid reaches so far below the slowest closed-loop pole and above the fastest
SCALINGS, STEP, STEP_SHRINKS = 60, 1.0, 0.1  # of the search for the scaling of a structured singular value
SURE = 2  # inputs up to which the disk margin for all at once is exact, not a lower bound


@dataclass(frozen=True)
class Broken:
    """A loop broken at its inputs, negative feedback, as matrices A, B and C; `dt` is the period (s),
    0 in continuous time."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    dt: float

    @property
    def D(self) -> np.ndarray:
        """Zero: nothing passes through at once."""
        return np.zeros((len(self.C), self.B.shape[1]))

    @property
    def ninputs(self) -> int:
        """The number of inputs."""
        return self.B.shape[1]


if TYPE_CHECKING:
    import control

    Linear: TypeAlias = Broken | control.StateSpace


@dataclass(frozen=True)
class Margins:
    """Margins of a stable loop, broken at one place or at several at once; factors and rad, inf if there is
    no limit.

    At one place: the gain may increase by the factor `gain` and decrease by `gain_down` (0: to zero), the
    phase by `phase` at the crossover frequency (rad/s), where an additional dead time of `delay` (s) has the
    same effect. At several places these are nan. `Ms`, `Mt`: peaks of the largest singular values of S, T.
    Any factors, one at each place, in the disk through 1 / disk_gain and disk_gain, which contains phases up
    to `disk_phase`, keep it stable; `disk` is the disk margin alpha, for more than SURE places a lower bound
    of it.
    """

    gain: float
    gain_down: float
    phase: float
    crossover: float
    delay: float
    Ms: float
    Mt: float
    disk: float
    disk_gain: float
    disk_phase: float


def margins(loop: "Linear") -> Margins:
    """Margins of a square loop that is stable when closed."""
    omega, response = frequencies(loop), Response(loop)
    values = response(omega)
    Ms, Mt, balanced = (_peak(response, omega, values, measure) for measure in (_of_S, _of_T, _of_balanced))
    disk = 1 / balanced
    one = _classical(response, omega, values[:, 0, 0]) if loop.ninputs == 1 else (math.nan,) * 5
    return Margins(*one, Ms, Mt, disk, *disk_interval(disk))


def norm(system: "Linear") -> float:
    """Return the H-infinity norm of a stable system: the largest singular value of its frequency response."""
    omega = np.append(0.0, _grid(np.linalg.eigvals(system.A), system.dt))
    response = Response(system)
    return _peak(response, omega, response(omega), _largest)


def disk_interval(disk: float) -> tuple[float, float]:
    """Largest factor, and largest phase (rad), in the disk of the balanced disk margin alpha."""
    bounded = disk < 2 - 1e-9  # at 2 any factor that does not turn the sign is in the disk
    return (1 + disk / 2) / (1 - disk / 2) if bounded else math.inf, 2 * math.atan(min(disk, 2.0) / 2)


class Response:
    """L at frequencies omega (rad/s), (N, r, r); inf is allowed in continuous time."""

    def __init__(self, loop: "Linear"):
        self._A, self._B, self._C, self._dt = loop.A, loop.B[None], loop.C, loop.dt
        self._D, self._one = loop.D.astype(complex)[None], np.eye(len(loop.A))

    def __call__(self, omega: np.ndarray) -> np.ndarray:
        """Solves (s - A) X = B at each frequency."""
        omega = np.atleast_1d(np.asarray(omega, float))
        finite = np.isfinite(omega)
        at = np.exp(1j * omega[finite] * self._dt) if self._dt else 1j * omega[finite]
        values = self._D.repeat(len(omega), axis=0)
        values[finite] += self._C @ np.linalg.solve(at[:, None, None] * self._one - self._A, self._B)
        return values


def frequencies(loop: "Linear") -> np.ndarray:
    """Return the grid, rad/s: around the closed loop's poles, up to half the sampling rate,
    or inf in continuous time."""
    return _grid(
        np.linalg.eigvals(loop.A - loop.B @ np.linalg.solve(np.eye(len(loop.D)) + loop.D, loop.C)), loop.dt
    )


def _grid(poles: np.ndarray, dt: float) -> np.ndarray:
    poles = poles.astype(complex)
    rates = np.abs(np.log(poles[poles != 0]) / dt if dt else poles)
    rates = rates[rates > 1e-9 * max(rates, default=1.0)]
    slowest, fastest = min(rates, default=1.0), max(rates, default=1.0)
    end = np.pi / dt if dt else ABOVE * fastest
    grid = np.geomspace(min(BELOW * slowest, end / 10), end, POINTS)
    return grid if dt else np.append(grid, np.inf)


def _of_S(L: np.ndarray) -> np.ndarray:
    return _largest(_sensitivity(L))


def _of_T(L: np.ndarray) -> np.ndarray:
    return _largest(np.eye(L.shape[-1]) - _sensitivity(L))


def _of_balanced(L: np.ndarray) -> np.ndarray:
    """Return the structured singular value of (S - T) / 2."""
    return structured(_sensitivity(L) - np.eye(L.shape[-1]) / 2)


def _sensitivity(L: np.ndarray) -> np.ndarray:
    return np.linalg.inv(np.eye(L.shape[-1]) + L)


def _largest(matrices: np.ndarray) -> np.ndarray:
    """Largest singular value of (N, p, r), in closed form for one column and 2 x 2."""
    if matrices.shape[-1] == 1:
        return np.sqrt((np.abs(matrices) ** 2).sum(axis=(1, 2)))
    if matrices.shape[1:] == (2, 2):
        return _greater(matrices, (np.abs(matrices) ** 2).sum(axis=(1, 2)))
    return np.linalg.norm(matrices, 2, axis=(1, 2))


def _greater(matrices: np.ndarray, squares: np.ndarray) -> np.ndarray:
    """The greater of two singular values, the sum of whose squares is given, and whose product is |det|."""
    rest = np.maximum(squares**2 - 4 * np.abs(np.linalg.det(matrices)) ** 2, 0.0)
    return np.sqrt((squares + np.sqrt(rest)) / 2)


def structured(matrices: np.ndarray) -> np.ndarray:
    """Structured singular value of (N, r, r) for complex factors, one on each place; from three places on an
    upper bound.

    It is at most the largest singular value of D M D^-1 for any diagonal D > 0. For two places the D that
    makes that least is known: the determinant and the diagonal do not change, so that it is least where both
    entries off the diagonal have the same size, and there it is the structured singular value, as for three.
    For more places than two D is searched for. A. Packard and J. Doyle, The complex structured singular
    value, 1993.
    """
    if matrices.shape[-1] > 2:
        return _scaled(matrices)
    if matrices.shape[-1] == 1:
        return _largest(matrices)
    diagonal = np.abs(matrices[:, 0, 0]) ** 2 + np.abs(matrices[:, 1, 1]) ** 2
    return _greater(matrices, diagonal + 2 * np.abs(matrices[:, 0, 1] * matrices[:, 1, 0]))


def _scaled(matrices: np.ndarray) -> np.ndarray:
    """Return the least of the largest singular values of D M D^-1, (N, r, r), over D that lead to the least.

    Where the largest singular value is simple, its logarithm grows with log d_i as |u_i|^2 - |v_i|^2, with u
    and v its vectors.
    """
    scale = np.zeros(matrices.shape[:2])
    least = np.full(len(matrices), np.inf)
    for k in range(SCALINGS):
        scaled = matrices * np.exp(scale[:, :, None] - scale[:, None, :])
        left, sizes, right = np.linalg.svd(scaled)
        least = np.minimum(least, sizes[:, 0])
        scale -= STEP / (1 + STEP_SHRINKS * k) * (np.abs(left[:, :, 0]) ** 2 - np.abs(right[:, 0, :]) ** 2)
    return least


def _peak(
    response: Response, omega: np.ndarray, values: np.ndarray, measure: Callable[[np.ndarray], np.ndarray]
) -> float:
    """Largest of a measure of L over all frequencies."""
    sizes = measure(values)
    k = int(np.argmax(sizes))
    low, high = omega[max(k - 1, 0)], omega[min(k + 1, len(omega) - 1)]
    if not np.isfinite(high):
        return float(sizes[k])
    options = {"xatol": 1e-9 * high}
    minimum = minimize_scalar(
        lambda w: -measure(response(w))[0], bounds=(low, high), method="bounded", options=options
    )
    return float(max(-minimum.fun, sizes[k]))


def _classical(
    response: Response, omega: np.ndarray, L: np.ndarray
) -> tuple[float, float, float, float, float]:
    finite = np.isfinite(omega)
    omega, L = omega[finite], L[finite]

    def value(w: float) -> complex:
        return complex(response(np.array([w]))[0, 0, 0])

    def crossings(of: Callable[[complex], float], sizes: np.ndarray) -> list[float]:
        where = np.flatnonzero(np.sign(sizes[:-1]) * np.sign(sizes[1:]) < 0)
        return [brentq(lambda w: of(value(w)), omega[k], omega[k + 1], rtol=1e-13) for k in where]

    real = [value(w).real for w in crossings(lambda z: z.imag, L.imag)]
    if response(omega[-1:])[0, 0, 0].real < 0 and abs(L[-1].imag) <= 1e-9 * abs(L[-1]):
        real.append(L[-1].real)  # half the sampling rate, where L is real
    factors = [-1 / x for x in real if x < 0]
    up, down = (
        min((f for f in factors if f > 1), default=math.inf),
        max((f for f in factors if f < 1), default=0.0),
    )
    at_gain = crossings(lambda z: abs(z) - 1, np.abs(L) - 1)
    phases = [abs(np.angle(-value(w))) for w in at_gain]
    if not phases:
        return up, down, math.inf, math.nan, math.inf
    delay = min(np.mod(np.angle(-value(w)), 2 * np.pi) / w for w in at_gain)
    return up, down, float(min(phases)), float(at_gain[int(np.argmin(phases))]), float(delay)
