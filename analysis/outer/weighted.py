"""Frequency-weighted mixed sensitivity of a channel, with the gains of the generated law as the controller.

The largest singular value over all frequencies of [W_S S; W_T T] is made small, with S = 1/(1 + L), T =
L/(1 + L) of the loop broken at v, and the usual weights (S. Skogestad, I. Postlethwaite, Multivariable
Feedback Control, 2.7)

    W_S = (s/M + w) / (s + A w)      S below A at low frequencies, small up to about w, nowhere above M
    W_T = (s/w_T + 1/M) / (A s/w_T + 1)      T nowhere above M, small from about w_T on

Below 1 all of this holds. A controller by Riccati equations (`control.mixsyn`) would have the order of chain
and weights together, which the law does not have: it has static gains on errors, derivatives and integral.
These are found directly, by a search over them (as P. Apkarian, D. Noll, Nonsmooth H-infinity synthesis, IEEE
TAC 51(1), 2006, for such controllers), and the norm by a bisection with the Hamiltonian matrix (S. Boyd, V.
Balakrishnan, P. Kabamba, 1989), which no peak between the frequencies of a grid escapes.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from ...readers.errors import BadInput
from ...readers.reading import positive
from .channel import Channel
from .design import Gains, gains_of

LOW = 1e-3  # A: what S and T come down to, far from their bands
ACCURACY = 1e-6  # relative, of a norm
GRID = 200  # frequencies at which a search computes the response
SLOWEST, WORST = 0.3, 1e6  # slowest pole allowed, beside the band of S; size of gains that have a slower one
STARTS = (0.5, 1.0, 2.0, 4.0)  # poles of the first gains, times the band of S


@dataclass(frozen=True)
class Weights:
    """S is small up to about `band` (rad/s), T from about `roll_off` (rad/s) on,
    and neither is above `peak` anywhere."""

    band: float
    roll_off: float
    peak: float = 2.0

    def check(self, where: str = "channel") -> "Weights":
        """Return itself. Raises BadInput for numbers that are not positive, a peak of 1 or less,
        and bands in the wrong order."""
        for name in ("band", "roll_off", "peak"):
            positive(name.replace("_", "-"), getattr(self, name), where)
        if not self.peak > 1:
            raise BadInput(f"{where}: peak = {self.peak:g} must be above 1: S and T add up to 1")
        if not self.band < self.roll_off:
            raise BadInput(
                f"{where}: the band of S, {self.band:g} rad/s, must be below the roll-off of T, "
                f"{self.roll_off:g} rad/s"
            )
        return self

    def filters(self) -> list[tuple[float, float, float, float]]:
        """Return a, b, c, d of dx/dt = a x + b u, y = c x + d u for W_S and W_T."""
        w, M = self.band, self.peak
        pole = self.roll_off / LOW
        return [(-LOW * w, 1.0, w - LOW * w / M, 1 / M), (-pole, 1.0, pole * (1 / M - 1 / LOW), 1 / LOW)]


def weighted(gains: Gains, weights: Weights) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return A, B, C, D from a signal added at v to W_S S and W_T T of it, of the continuous channel."""
    broken = Channel("channel", "1", gains).broken()
    A, B, K = broken.A, broken.B, broken.C
    n = len(A)
    made = np.zeros((n + 2, n + 2))
    made[:n, :n] = A - B @ K
    enter, leave, through = np.vstack([B, np.zeros((2, 1))]), np.zeros((2, n + 2)), np.zeros((2, 1))
    for k, ((a, b, c, d), of_state, direct) in enumerate(
        zip(weights.filters(), (-K, K), (1.0, 0.0), strict=True)
    ):
        made[n + k, n + k], made[n + k, :n], enter[n + k] = a, b * of_state[0], b * direct
        leave[k, :n], leave[k, n + k], through[k] = d * of_state[0], c, d * direct
    return made, enter, leave, through


def weighted_norm(gains: Gains, weights: Weights) -> float:
    """Return the H-infinity norm of [W_S S; W_T T] of the continuous channel. Raises BadInput for gains that
    are not stable.

    By bisection of g: where the size of the response passes g, the Hamiltonian matrix of g has eigenvalues on
    the imaginary axis. As rounding may move them off it, the response itself is computed at all their
    frequencies and between them.
    """
    A, B, C, D = weighted(gains, weights)
    largest = _on_grid(A, B, C, D)

    def exceeded(g: float) -> bool:
        R = g**2 - float((D.T @ D)[0, 0])
        if R <= 0:
            return True
        F = A + B @ D.T @ C / R
        H = np.block([[F, B @ B.T / R], [-C.T @ (np.eye(2) + D @ D.T / R) @ C, -F.T]])
        at = np.unique(np.abs(np.linalg.eigvals(H).imag))
        return bool(_sizes(A, B, C, D, np.append(at, np.sqrt(at[1:] * at[:-1]))).max() >= g)

    low, high = largest, 2 * largest
    while exceeded(high):
        low, high = high, 2 * high
    while high - low > ACCURACY * high:
        middle = (low + high) / 2
        low, high = (middle, high) if exceeded(middle) else (low, middle)
    return high


def _sizes(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Return the size of the response at each frequency (rad/s)."""
    response = C @ np.linalg.solve(1j * omega[:, None, None] * np.eye(len(A)) - A, B[None]) + D
    return np.linalg.norm(response[:, :, 0], axis=1)


def _on_grid(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray) -> float:
    """Return the largest size of the response on a grid of frequencies, a lower bound of the norm."""
    rates = np.abs(np.linalg.eigvals(A))
    return float(_sizes(A, B, C, D, np.geomspace(rates.min() / 10, 10 * rates.max(), GRID)).max())


def from_mixed(
    degree: int, weights: Weights, integral: bool = False, where: str = "channel"
) -> tuple[Gains, float]:
    """Return the gains of a continuous channel with the least norm that a search found, and that norm; below
    1 the weights are met. No pole is slower than SLOWEST times the band of S.

    Raises BadInput as `Weights.check`, and for a norm above 1, with what it is.
    """
    weights.check(where)
    order = degree + integral

    def gains(logarithms: np.ndarray) -> Gains:
        numbers = np.exp(np.clip(logarithms, -50, 50)).tolist()
        return gains_of(degree, numbers[integral:], numbers[0] if integral else 0.0)

    def size(logarithms: np.ndarray) -> float:
        tried = gains(logarithms)
        slowest = -tried.poles.real.max() / (SLOWEST * weights.band)
        return _on_grid(*weighted(tried, weights)) if slowest >= 1 else WORST - slowest

    firsts = [np.log(np.poly([-factor * weights.band] * order)[:0:-1]) for factor in STARTS]
    options = {"maxiter": 150 * order, "xatol": 1e-5, "fatol": 1e-6}
    found = [minimize(size, first, method="Nelder-Mead", options=options) for first in firsts]
    best = gains(min(found, key=lambda each: each.fun).x).check(where)
    if not (reached := weighted_norm(best, weights)) < 1:
        raise BadInput(
            f"{where}: no gains were found that keep S and T within these weights, the norm is "
            f"{reached:.3g}; lower the band, or raise the roll-off or the peak"
        )
    return best, reached
