"""The reference for inputs that keep the wheels rolling: what noslip_grip.h computes,
with NumPy and another method."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache

import casadi as ca
import numpy as np

from ...codegen.derivation.grip import wheels_of
from ...model.algebra.direct import Direct
from ...model.algebra.linear_numbers import least_norm, least_squares
from ...model.algebra.portable import portable
from ...model.contacts import GRAVITY, ground
from ...model.law import ControlLaw, symbols
from .controller import Friction

# Entries of a direction below this part of the largest count as zero for the limits, as in the C runtime
FLAT = 1e-5
SLACK = 1024 * np.finfo(float).eps  # of friction, as in the C runtime
ROUNDING = 1e-10  # of friction use
FIRST, RISE, AFTER, ERROR, ASKED = 0.6, 0.5, 0.9, 0.5, 4  # see noslip_grip.h
# Weight of the inputs' changes beside the mean of their effects, for more than two inputs, as in the C
# runtime
CHANGE = 1e-4


@dataclass(frozen=True, eq=False)
class Cones:
    """At one state: force (c, 2) and mu load (c,) at each contact without inputs, and by each input, (r,
    c, 2) and (r, c)."""

    force: np.ndarray
    most: np.ndarray
    force_by: np.ndarray
    most_by: np.ndarray
    mass: np.ndarray

    def use(self, tau: np.ndarray) -> np.ndarray:
        """Return |F| / (mu load) at each contact, (c,); infinite without load."""
        size, most = _lengths(self.at(tau)), self.most_at(tau)
        return np.where(most > 0, size / np.where(most > 0, most, 1.0), np.inf)

    def excess(self, tau: np.ndarray) -> np.ndarray:
        """Return |F| - mu load at each contact, N, (c,): convex in the inputs."""
        return _lengths(self.at(tau)) - self.most_at(tau)

    def to_coasting(self, tau: np.ndarray) -> np.ndarray:
        """Return the change of the inputs to the smallest sum of (F / mass)^2;
        as `to_least` for more than two inputs."""
        if len(tau) > 2:
            return self.to_least(self.at(tau), np.eye(len(tau)))
        return -least_squares(self._effects(np.eye(2)), np.ravel(self.at(tau) / self.mass[:, None]))

    def to_least(self, force: np.ndarray, free: np.ndarray) -> np.ndarray:
        """Return the combination of the rows of `free` that added to the inputs of a force (c, 2) gives the
        smallest sum of (F / mass)^2, plus that of the squared coefficients times CHANGE and the mean effect.
        """
        effects = self._effects(free)
        change = np.sqrt(CHANGE * np.sum(effects**2) / len(free)) * np.eye(len(free))
        right = np.append(np.ravel(force / self.mass[:, None]), np.zeros(len(free)))
        coefficients = least_squares(np.vstack([effects, change]), right)
        return -(coefficients[:, None] * free).sum(axis=0)

    def forces_by(self, way: np.ndarray) -> np.ndarray:
        """Return the forces by the inputs `way` alone, (c, 2)."""
        return (way[:, None, None] * self.force_by).sum(axis=0)

    def _effects(self, free: np.ndarray) -> np.ndarray:
        """Return F / mass by each row of `free`, (2 c, .)."""
        return np.array([np.ravel(self.forces_by(row) / self.mass[:, None]) for row in free]).T

    def interval(self, k: int, tau: np.ndarray, way: np.ndarray) -> tuple[float, float, bool]:
        """Return the s from low to high for which contact k rolls with tau + s way, and whether there are
        any; if not, the s at which |F|^2 - (mu load)^2 is smallest, twice.
        """
        effects = np.column_stack([self.forces_by(way), (way[:, None] * self.most_by).sum(axis=0)])
        effects[np.abs(effects) <= SLACK * np.abs(effects).sum()] = 0.0  # rounding can make them
        force, by, most, most_by = self.at(tau)[k], effects[k, :2], self.most_at(tau)[k], effects[k, 2]
        square = (by * by).sum() - most_by * most_by
        slope, constant = 2 * ((force * by).sum() - most * most_by), (force * force).sum() - most * most
        inside = [s for s in _roots(square, slope, constant) if most + s * most_by >= 0]
        if square > 0:
            middle = -slope / (2 * square)
            return (min(inside), max(inside), True) if len(inside) == 2 else (middle, middle, False)
        if inside:
            return (inside[0], np.inf, True) if most_by > 0 else (-np.inf, inside[0], True)
        return -np.inf, np.inf, bool(constant <= 0 and most >= 0)

    def at(self, tau: np.ndarray) -> np.ndarray:
        """Return the forces with the inputs tau, (c, 2)."""
        return self.force + self.forces_by(tau)

    def most_at(self, tau: np.ndarray) -> np.ndarray:
        """Return the mu loads with the inputs tau, (c,)."""
        return self.most + (tau[:, None] * self.most_by).sum(axis=0)


def _lengths(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt((vectors * vectors).sum(axis=1))


def _roots(square: float, slope: float, constant: float) -> list[float]:
    """Return the real zeros of square s^2 + slope s + constant, a double one twice."""
    if square == 0:
        return [] if slope == 0 else [-constant / slope]
    discriminant = slope * slope - 4 * square * constant
    if discriminant < 0:
        return []
    half = -(slope + math.copysign(math.sqrt(discriminant), slope)) / 2
    return [half / square, constant / half if half else 0.0]


class Earned:
    """The friction `mu` that is believed, at most `most`: what noslip_earn computes,
    from whole arrays of wheels."""

    def __init__(self, law: ControlLaw, params: np.ndarray, friction: Friction):
        wheels, self._friction, self.params = wheels_of(law.system), friction, params
        self._contacts = [wheel.contact for wheel in wheels]
        self._velocities = [len(law.system.mechanism.coordinates) + wheel.velocity for wheel in wheels]
        self._wheels = Direct(_wheels_function(law))
        self._earns, self.most = bool(wheels) and friction.period > 0, friction.mu
        self.mu = (friction.known or FIRST * friction.mu) if self._earns else friction.mu
        self._rates: np.ndarray | None = None
        self._expected: tuple[np.ndarray, ...] | None = None
        self._away, self._steps, self._sign = np.zeros((3, len(wheels)))
        self._pause = 0.0

    def believe_at_most(self, most: float) -> None:
        """Believe no more than this, nor than what is given."""
        self.most = min(most, self._friction.mu)
        self.mu = min(self.mu, self.most) if self._earns else self.most

    def forget(self) -> None:
        """Compare no rates in the next step."""
        self._expected = None

    def expect(self, force: np.ndarray, most: np.ndarray, tau: np.ndarray) -> None:
        """Keep what the wheels do at forces (c, 2) and mu loads (c,) of the contacts, with the inputs tau."""
        drive, mass, radius = self._wheels(tau, self.params)
        force, most = force[self._contacts], most[self._contacts]
        expected = np.where(mass > 0, (drive - force[:, 0]) / np.where(mass > 0, mass, 1.0), 0.0)
        self._expected = force[:, 0], force[:, 1], most, mass, radius, expected

    def compare(self, state: np.ndarray) -> None:
        """Compare the rates of the wheels with what is expected: mu falls to what one shows, or rises."""
        if not self._earns:
            return
        friction, before, rates = self._friction, self._rates, state[self._velocities]
        self._rates, weight = rates, self.mu * (1 - friction.margin) * friction.share * GRAVITY
        if self._expected is None or before is None:
            self._away[:] = self._steps[:] = 0
            self.mu = min(self.mu + RISE * friction.mu * friction.period, self.most)
            return
        along, across, most, mass, radius, expected = self._expected
        bound = (friction.error or ERROR) * (np.abs(expected).max() + weight / 4)
        runs = radius * (rates - before) / friction.period - expected
        sign = np.where(along > 0, 1, -1)
        same = sign == self._sign
        away = np.where(same, self._away, 0.0) + sign * runs - bound
        suspected = (away > 0) & (self._pause <= 0) & (np.abs(along) * ASKED > most)
        self._steps = np.where(suspected, np.where(same, self._steps, 0.0) + 1, 0.0)
        self._away, self._sign = np.where(suspected, away, 0.0), sign
        slips = suspected & (mass > 0) & (most > 0)
        slips &= self._away * friction.period > 2 * radius * friction.coarse + friction.lag * weight
        if slips.any():
            rest = np.maximum(np.abs(along) - mass * (bound + self._away / np.maximum(self._steps, 1)), 0.0)
            shown = AFTER * (1 - friction.margin) * np.hypot(rest, across) / np.where(slips, most, 1.0)
            if (least := shown[slips].min()) < 1:
                self.mu, self._pause = self.mu * least, friction.lag
                self._away[:] = self._steps[:] = 0
                return
        self.mu = min(self.mu + (0 if self._away.any() else RISE * friction.mu * friction.period), self.most)
        self._pause -= friction.period if self._pause > 0 else 0.0


class GripReference:
    """The floor of a law with numerical parameters: limits inputs as the generated C does."""

    def __init__(self, law: ControlLaw, params: np.ndarray, friction: Friction, limits: np.ndarray):
        self._function, self.params = Direct(_ground_function(law)), params
        self._effort = Direct(_effort_function(law)) if law.system.redundant else None
        self._given, self.earned = friction, Earned(law, params, friction)
        self._limits = limits

    def cones(self, state: np.ndarray) -> Cones:
        """Return the friction cones at a state."""
        floor = replace(self._given, mu=self.earned.mu)
        force, mass, shift, force_by, shift_by = self._function(state, self.params)
        count = len(mass)
        mu = floor.mu * (1 - floor.margin)
        most = mu * (floor.share * GRAVITY * mass + floor.height * shift)
        by = force_by.reshape(-1, count, 2), mu * floor.height * shift_by.reshape(-1, count)
        return Cones(force.reshape(count, 2), most, *by, mass)

    def step(self, state: np.ndarray, tau: np.ndarray, slope: np.ndarray) -> tuple[str, np.ndarray]:
        """Return the same as a call, with the friction that is earned."""
        self.earned.compare(state)
        status, tau = self(state, tau, slope)
        cones = self.cones(state)
        self.earned.expect(cones.at(tau), cones.most_at(tau), tau)
        return status, tau

    def __call__(self, state: np.ndarray, tau: np.ndarray, slope: np.ndarray) -> tuple[str, np.ndarray]:
        """Return status and inputs; `slope` is the derivative of tau by the virtual input of the speed,
        empty without one."""
        cones = self.cones(state)
        if (np.abs(tau) <= self._limits).all() and (cones.excess(tau) <= 0).all():
            return "ok", tau
        below = Cones(
            cones.force, cones.most * (1 - SLACK), cones.force_by, cones.most_by * (1 - SLACK), cones.mass
        )
        found = False
        if self._effort:
            free = self._null_inputs(*self._effort(state, self.params))
            tau, found = self._towards(below, tau, below.to_least(below.at(tau), free))
            slope = slope + below.to_least(below.forces_by(slope), free) if len(slope) else slope
        if len(slope) and not found:
            low, high, found = self._steps(below, tau, slope)
            found = found and low <= high
            s = np.clip(0.0, low, high) if low <= high else (low + high) / 2
            tau = tau + s * slope
        if not found:
            tau, _ = self._towards(below, tau, below.to_coasting(tau))
        tau = np.clip(tau, -self._limits, self._limits)
        return "grip" if (cones.use(tau) <= 1 + ROUNDING).all() else "will_slip", tau

    def _towards(self, cones: Cones, tau: np.ndarray, way: np.ndarray) -> tuple[np.ndarray, bool]:
        """Return the inputs towards tau + way as little as needed, or that,
        and whether some on the way keep all cones."""
        low, high, found = self._steps(cones, tau, way)
        s = max(low, 0.0)
        found = found and s <= min(high, 1.0)
        return tau + (s if found else 1.0) * way, found

    @staticmethod
    def _null_inputs(effort: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Return a projection onto the inputs that do not change the motion, as rows: along the inputs of
        smallest weighted squares."""
        root = np.sqrt(weights.ravel())
        scaled = effort.reshape(len(root), -1).T / root
        kept = least_norm(np.repeat(scaled[None], len(root), axis=0), scaled.T)
        return (np.eye(len(root)) - kept) * root[:, None] / root

    def _steps(self, cones: Cones, tau: np.ndarray, way: np.ndarray) -> tuple[float, float, bool]:
        """Return the s with which tau + s way is within all cones and limits, from low to high;
        whether each has any."""
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
        ca.Function(
            "ground",
            [symbols(system.state), system.mechanism.p],
            [ca.densify(part) for part in (*at_rest, *by)],
        )
    )


@cache
def _wheels_function(law: ControlLaw) -> ca.Function:
    """Return the function (inputs, params) to drive, mass and radius of the wheels that show friction."""
    mechanism, wheels = law.system.mechanism, wheels_of(law.system)
    columns = [
        ca.vertcat(ca.SX(0, 1), *[getattr(wheel, name) for wheel in wheels])
        for name in ("drive", "mass", "radius")
    ]
    return portable(ca.Function("wheels", [symbols(mechanism.inputs), mechanism.p], columns))


@cache
def _effort_function(law: ControlLaw) -> ca.Function:
    """Return the function (state, params) to S'E and the weights of the inputs."""
    system = law.system
    answers = [ca.densify(part) for part in (system.input_map, system.mechanism.weights)]
    return portable(ca.Function("effort", [symbols(system.state), system.mechanism.p], answers))
