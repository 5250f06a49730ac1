"""Encloses all motions of a closed loop from one start that differ by the robot's parameters, about a nominal
motion.

About the nominal motion x(t) the deviation of any other is e = S pi + G b: pi the deviations of the
parameters, at most `spread`, S the sensitivity of the motion to them, and b unknown numbers in [-1, 1]. S and
G are carried along by the loop's tangent; what the tangent leaves out (`Enclosure`), the error of each step
of integration and what a limit or the next segment of a path makes uncertain become further columns of G. A
step is good when a box is found that no motion leaves during it (Picard).

Each step adds the error that the embedded method estimates, which is no bound, and an allowance for rounding;
the tangent itself is taken to be exact along the nominal motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.integrate import RK45

from .enclosure import Bounds

STAGES, WEIGHTS, ERROR = RK45.A, RK45.B, RK45.E  # Dormand and Prince, of order 5(4)
TOLERANCE = 1e-9  # of a step's error, absolute and relative
ROUNDING = 1e-13  # of a step, relative and absolute
SHORTEST, TRIES = 1e-6, 8  # s; attempts at a box for a step
COLUMNS = 8  # times the dimension: largest number of columns of G
GROW, SHRINK = 2.0, 0.5
NARROW = 0.03  # relative to the radius: a box that grows by less is accepted
FOLD = 0.12  # of a time constant: the boxes of longer steps are too wide


class Lost(Exception):
    """No box was found for a step, however short."""


@dataclass
class Tube:
    """`centre` (n), `S` (n, parameters), `G` (n, columns) and the parameters' `spread`:
    the set of states at an instant."""

    centre: np.ndarray
    S: np.ndarray
    G: np.ndarray
    spread: np.ndarray

    @property
    def rest(self) -> np.ndarray:
        """The part of `radius` that is not linear in the parameters."""
        return np.abs(self.G).sum(axis=1)

    @property
    def radius(self) -> np.ndarray:
        """Bounds of the deviation of a state from the centre, by entry."""
        return np.abs(self.S) @ self.spread + self.rest

    def map(self, centre: np.ndarray, A: np.ndarray, B: np.ndarray, rest: np.ndarray) -> Tube:
        """Return the tube of all centre + A e + B pi + anything within `rest`."""
        columns = np.hstack([A @ self.G, np.diag(rest)[:, rest > 0]])
        return Tube(centre, A @ self.S + B, _reduced(columns), self.spread)


def _reduced(G: np.ndarray) -> np.ndarray:
    """Return G with its smallest columns replaced by a box (Girard 2005)."""
    n = len(G)
    if G.shape[1] <= 2 * COLUMNS * n:
        return G
    scale = np.abs(G).max(axis=1, keepdims=True)
    size = np.abs(G / np.where(scale, scale, 1.0)).sum(axis=0)
    order = np.argsort(-size)
    keep, box = order[: COLUMNS * n], order[COLUMNS * n :]
    return np.hstack([G[:, keep], np.diag(np.abs(G[:, box]).sum(axis=1))])


@dataclass(frozen=True)
class TubeStep:
    """`h` s, and the tube behind it. In between the nominal motion was within `moved` of `centre`, the others
    within `radius` of that; `rate`: bounds of their rates of change.
    """

    h: float
    tube: Tube
    centre: np.ndarray
    moved: np.ndarray
    radius: np.ndarray
    rate: Bounds


class RateOfChange(Protocol):
    """A rate of change x' = f(x, p)."""

    def tangent(self, x: np.ndarray, bounds: Bounds | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return f and its derivatives by x and p, which may use the bounds of f in the step."""

    def bounds(self, tube: Tube, moved: np.ndarray, growth: np.ndarray) -> Bounds:
        """Return the bounds of f near the tube: the nominal motion is within `moved` of its centre, the
        deviations differ by at most `growth` from those there. The slope is not needed.
        """


class Flow:
    """Integrates a RateOfChange with an enclosure of all motions near the nominal one."""

    def __init__(self, field: RateOfChange):
        self._field, self._h, self._longest = field, np.inf, np.inf
        self._speeds: tuple[np.ndarray, np.ndarray] | None = None  # rates of growth of the last box

    def step(self, tube: Tube, longest: float) -> TubeStep:
        """Advance by at most `longest` s. Raises Lost."""
        h = min(self._h, self._longest, longest)
        if longest - h < SHORTEST:
            h = longest
        while True:
            box = self._box(tube, h)
            advanced = None if box is None else self._step(tube, h, box)
            if box is not None and advanced is not None:
                after, error = advanced
                if error <= 1 or h <= 10 * SHORTEST:
                    cut = self._h if h == longest else 0.0  # no information on the next step
                    self._h = max(cut, h * min(GROW, 0.9 * max(error, 1e-8) ** -0.2))
                    return TubeStep(h, after, tube.centre, *box)
                h *= max(SHRINK, 0.9 * error**-0.2)
            else:
                h *= SHRINK
            if h < SHORTEST:
                raise Lost

    def _box(self, tube: Tube, h: float) -> tuple[np.ndarray, np.ndarray, Bounds] | None:
        """Return a box that no motion leaves within h, and the bounds of f in it; None if none is found."""
        radius = tube.radius
        if self._speeds is None:
            self._speeds = np.abs(self._field.tangent(tube.centre, None)[0]), 0 * radius
        moved, growth = (1.2 * h * speed + ROUNDING for speed in self._speeds)
        growth += 1e-6 * radius
        for tried in range(TRIES):
            rate = self._field.bounds(tube, moved, growth)
            if not rate.finite:
                return None
            farthest, grown = h * (np.abs(rate.value) + rate.moved), h * rate.radius
            if (farthest <= moved).all() and (grown <= growth).all():
                self._speeds = farthest / h, grown / h
                if (growth > NARROW * radius).any():  # once more, in the new box
                    moved, growth = farthest, grown
                    rate = self._field.bounds(tube, moved, growth)
                return moved, radius + growth, rate
            if tried >= 3 and max((farthest / moved).max(), (grown / growth).max()) > 1.5:
                return None  # it continues to grow
            moved = np.maximum(moved, 1.1 * farthest + ROUNDING)
            growth = np.maximum(growth, 1.1 * grown + ROUNDING)
        return None

    def _step(
        self, tube: Tube, h: float, box: tuple[np.ndarray, np.ndarray, Bounds]
    ) -> tuple[Tube, float] | None:
        """Return the tube after h, and the error of the nominal motion relative to the tolerance."""
        n, (_, _, rate) = len(tube.centre), box
        slopes: list[np.ndarray] = []
        tangents: list[np.ndarray] = []
        size = np.zeros((n, n))
        start = np.hstack([np.eye(n), np.zeros((n, len(tube.spread)))])
        for row in STAGES:
            x, X = tube.centre, start
            for weight, k, K in zip(row, slopes, tangents, strict=False):
                if weight:
                    x, X = x + h * weight * k, X + h * weight * K
            k, A, B = self._field.tangent(x, rate)
            K = A @ X
            K[:, n:] += B
            slopes.append(k)
            tangents.append(K)
            size = np.maximum(size, np.abs(A))
        after = tube.centre + h * sum(w * k for w, k in zip(WEIGHTS, slopes, strict=True))
        X = start + h * sum(w * K for w, K in zip(WEIGHTS, tangents, strict=True))
        if not (np.isfinite(after).all() and np.isfinite(X).all()):
            return None
        if 4 * h * size.sum(axis=1).max() > FOLD:
            self._longest = FOLD / max(1e-9, np.abs(np.linalg.eigvals(size)).max())
        last = self._field.tangent(after, rate)[0]
        error = np.abs(h * sum(w * k for w, k in zip(ERROR, [*slopes, last], strict=True)))
        term = rest = 1.01 * h * rate.rest
        for order in range(2, 7):  # exp(h |A|) propagates terms that are omitted early in the step
            term = h / order * (size @ term)
            rest = rest + term
        rest = rest + error + ROUNDING * (1 + np.abs(after))
        return tube.map(after, X[:, :n], X[:, n:], rest), float(
            (error / (TOLERANCE * (1 + np.abs(after)))).max()
        )
