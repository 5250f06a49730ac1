"""The reference for inputs that keep the wheels rolling: what noslip_grip.h computes, with NumPy and another method."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import casadi as ca
import numpy as np

from ..model.algebra.portable import portable
from ..model.contacts import GRAVITY, ground
from ..model.law import ControlLaw, symbols
from .controller import Friction
from .direct import Direct

FLAT = 1e-5  # entries of a direction below this part of the largest count as zero for the limits, as in the C runtime
SLACK = 1024 * np.finfo(float).eps  # of friction, as in the C runtime
ROUNDING = 1e-10  # of friction use


@dataclass(frozen=True, eq=False)
class Cones:
    """At one state: force (c, 2) and mu load (c,) at each contact without inputs, and by each input, (r, c, 2) and (r, c)."""

    force: np.ndarray
    most: np.ndarray
    force_by: np.ndarray
    most_by: np.ndarray
    mass: np.ndarray

    def use(self, tau: np.ndarray) -> np.ndarray:
        """Return |F| / (mu load) at each contact, (c,); infinite without load."""
        size, most = np.linalg.norm(self._force(tau), axis=1), self.most + tau @ self.most_by
        return np.where(most > 0, size / np.where(most > 0, most, 1.0), np.inf)

    def excess(self, tau: np.ndarray) -> np.ndarray:
        """Return |F| - mu load at each contact, N, (c,): convex in the inputs."""
        return np.linalg.norm(self._force(tau), axis=1) - self.most - tau @ self.most_by

    def coasting(self) -> np.ndarray:
        """Return the inputs with the smallest sum of (F / mass)^2."""
        weighted = np.reshape(self.force_by / self.mass[:, None], (len(self.force_by), -1)).T
        return -np.linalg.lstsq(weighted, np.ravel(self.force / self.mass[:, None]), rcond=None)[0]

    def interval(self, k: int, tau: np.ndarray, way: np.ndarray) -> tuple[float, float, bool]:
        """Return the s from low to high for which contact k rolls with tau + s way, and whether there are any; if not, the s
        at which |F|^2 - (mu load)^2 is smallest, twice.
        """
        force, by = self._force(tau)[k], way @ self.force_by[:, k]
        most, most_by = (self.most + tau @ self.most_by)[k], way @ self.most_by[:, k]
        quadratic = np.array([by @ by - most_by**2, 2 * (force @ by - most * most_by), force @ force - most**2])
        roots = np.roots(quadratic)
        inside = [s for s in np.real(roots[np.abs(np.imag(roots)) == 0]) if most + s * most_by >= 0]
        if quadratic[0] > 0:
            middle = -quadratic[1] / (2 * quadratic[0])
            return (min(inside), max(inside), True) if len(inside) == 2 else (middle, middle, False)
        if inside:
            return (inside[0], np.inf, True) if most_by > 0 else (-np.inf, inside[0], True)
        return -np.inf, np.inf, bool(quadratic[2] <= 0 and most >= 0)

    def _force(self, tau: np.ndarray) -> np.ndarray:
        return self.force + np.tensordot(tau, self.force_by, 1)


class GripReference:
    """The floor of a law with numerical parameters: limits inputs as the generated C does."""

    def __init__(self, law: ControlLaw, params: np.ndarray, friction: Friction, limits: np.ndarray):
        self._function, self._params = Direct(_ground_function(law)), params
        self._given = self._friction = friction
        self._limits = limits

    def believe(self, mu: float) -> None:
        """Keep the contacts within a friction `mu`, at most that of the start."""
        self._friction = replace(self._given, mu=min(mu, self._given.mu))

    def cones(self, state: np.ndarray) -> Cones:
        """Return the friction cones at a state."""
        floor = self._friction
        force, mass, shift, force_by, shift_by = self._function(state, self._params)
        count = len(mass)
        mu = floor.mu * (1 - floor.margin)
        most = mu * (floor.share * GRAVITY * mass + floor.height * shift)
        by = force_by.reshape(-1, count, 2), mu * floor.height * shift_by.reshape(-1, count)
        return Cones(force.reshape(count, 2), most, *by, mass)

    def __call__(self, state: np.ndarray, tau: np.ndarray, slope: np.ndarray) -> tuple[str, np.ndarray]:
        """Return status and inputs; `slope` is the derivative of tau by the virtual input of the speed, empty without one."""
        cones = self.cones(state)
        if (np.abs(tau) <= self._limits).all() and (cones.excess(tau) <= 0).all():
            return "ok", tau
        below = Cones(cones.force, cones.most * (1 - SLACK), cones.force_by, cones.most_by * (1 - SLACK), cones.mass)
        found = False
        if len(slope):
            low, high, found = self._steps(below, tau, slope)
            found = found and low <= high
            s = np.clip(0.0, low, high) if low <= high else (low + high) / 2
            tau = tau + s * slope
        if not found:
            way = below.coasting() - tau
            low, high, found = self._steps(below, tau, way)
            s = max(low, 0.0)
            tau = tau + (s if found and s <= min(high, 1.0) else 1.0) * way
        tau = np.clip(tau, -self._limits, self._limits)
        return "grip" if (cones.use(tau) <= 1 + ROUNDING).all() else "will_slip", tau

    def _steps(self, cones: Cones, tau: np.ndarray, way: np.ndarray) -> tuple[float, float, bool]:
        """Return the s with which tau + s way is within all cones and limits, from low to high; whether each has any."""
        parts = [cones.interval(k, tau, way) for k in range(len(cones.mass))]
        for one, by, limit in zip(tau, way, self._limits, strict=True):
            if abs(by) > FLAT * np.abs(way).max():
                parts.append((*sorted(((-limit - one) / by, (limit - one) / by)), True))
            elif abs(one) > limit:
                parts.append((-np.inf, np.inf, False))
        lows, highs, any_of_each = zip(*parts, strict=True)
        return max(lows), min(highs), all(any_of_each)


@cache
def _ground_function(law: ControlLaw) -> ca.Function:
    """Return the function (state, params) to forces, masses and shifts without inputs, and by each input."""
    system = law.system
    tau = symbols(system.mechanism.inputs)
    made = ground(system, system.acceleration(tau), tau)
    at_rest = ca.substitute([made.force, made.mass, made.shift], [tau], [ca.SX.zeros(tau.numel())])
    by = [ca.jacobian(part, tau) for part in (made.force, made.shift)]
    return portable(
        ca.Function("ground", [symbols(system.state), system.mechanism.p], [ca.densify(part) for part in (*at_rest, *by)])
    )
