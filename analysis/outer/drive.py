"""Velocity-controlled drives in the linear loop: their own loop of first order, and dead time, between
samples.

With c the integral of the desired acceleration u, and e = c - nu, such a drive gives

    nudot = omega e,        e+ = e + T u(t - delay) at each call,        de/dt = -nudot in between

that is, the acceleration follows u with the time constant 1 / omega. With feed-forward of the torque that
causes u, nudot = u(t - delay) + omega e: e only has to remove the error. With a kinematic law c is its
command, held over each period:

    nudot = omega (c(t - delay) - nu)
"""

import math
from dataclasses import dataclass

import numpy as np

from ...readers.reading import positive
from ...simulation.drive import whole_periods
from .exponential import exponential

MOST_PERIODS = 30  # in the delay of a drive, when the longest period is searched for


@dataclass(frozen=True)
class DriveLoop:
    """The loop of a drive: its bandwidth `omega` (rad/s), `delay` (s) until a command acts, whether it is fed
    the torque, and whether its commands are those of a kinematic law.
    """

    omega: float
    delay: float = 0.0
    feeds: bool = False
    kinematic: bool = False

    def __post_init__(self):
        positive("bandwidth", self.omega, "drive")
        if not (math.isfinite(self.delay) and self.delay >= 0):
            positive("delay", self.delay, "drive")

    @property
    def shortest(self) -> float:
        """The shortest period (s) to examine: at shorter ones the loop is nearly continuous,
        and the delay too many periods."""
        return self.delay / MOST_PERIODS

    def __str__(self) -> str:
        kind = "kinematic" if self.kinematic else "velocity+torque" if self.feeds else "velocity"
        return f"{kind} drives of {self.omega / (2 * math.pi):.6g} Hz, delay {self.delay:g} s"

    def between_samples(
        self, A: np.ndarray, B: np.ndarray, period: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return F, G, J of [x, e] for a plant dx/dt = A x + B nudot: d/dt = F [x, e] + G u held, and + J u
        once at a call.

        Of a kinematic law, with dx/dt = A x + B nu, that of [x, nu], with its command in place of u.
        """
        n, r = B.shape
        if self.kinematic:
            F = np.block([[A, B], [np.zeros((r, n)), -self.omega * np.eye(r)]])
            return F, np.vstack([np.zeros((n, r)), self.omega * np.eye(r)]), np.zeros((n + r, r))
        F = np.block([[A, self.omega * B], [np.zeros((r, n)), -self.omega * np.eye(r)]])
        G = float(self.feeds) * np.vstack([B, -np.eye(r)])
        return F, G, np.vstack([np.zeros((n, r)), period * np.eye(r)])


def sampled_late(
    F: np.ndarray, G: np.ndarray, J: np.ndarray, period: float, delay: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return A, B from call to call of dx/dt = F x + G w, w held over `period` s, with x increased by J w
    when w begins to act, `delay` s after the call. Exact. The w of former calls that still matter are
    additional states, the last ones, latest first.
    """
    n, r = G.shape
    whole, rest = whole_periods(delay, period)
    (before, by_old), (after, by_new) = _moved(F, G, rest), _moved(F, G, period - rest)
    new, old = after @ J + by_new, after @ by_old
    waiting = whole + 1 if rest else 0
    A, B = np.zeros((n + waiting * r, n + waiting * r)), np.zeros((n + waiting * r, r))
    A[:n, :n] = after @ before
    for k, part in ((whole, new), (whole + 1, old)):  # acts on the w of so many calls ago
        if k:
            A[:n, n + (k - 1) * r : n + k * r] = part if waiting else 0.0
        else:
            B[:n] = part
    if waiting:
        B[n : n + r] = np.eye(r)
        A[n + r :, n:-r] = np.eye((waiting - 1) * r)
    return A, B


def _moved(F: np.ndarray, G: np.ndarray, duration: float) -> tuple[np.ndarray, np.ndarray]:
    """Return exp(F t) and its integral times G."""
    n, r = G.shape
    transition = exponential(duration * np.block([[F, G], [np.zeros((r, n + r))]]))
    return transition[:n, :n], transition[:n, n:]
