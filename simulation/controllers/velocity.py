"""Commands for drives that take velocities: the integral of the law's accelerations, or the velocities of a
kinematic law, within limits; by the C (noslip_velocity.h), or by a reference implementation of the same.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import lru_cache
from threading import Lock
from typing import TYPE_CHECKING, Protocol

import casadi as ca
import numpy as np

from ...model.algebra.direct import Direct
from ...model.algebra.portable import portable
from ...model.reduction import ReducedSystem
from . import ON_TARGET, SCALAR
from .backends import runtime_of
from .controller import RUNNING, Numbers

if TYPE_CHECKING:
    from ...model.law import ControlLaw
    from .runtime import Runtime

HEADER = "noslip_velocity.h"
MOST = 8  # quasi-velocities, as NOSLIP_VELOCITIES


@dataclass(frozen=True)
class VehicleLimits:
    """Forward speed (m/s) and yaw rate (rad/s) of a vehicle by its two quasi-velocities, and the largest
    accelerations (m/s^2), both positive: of the forward speed (`along`), and speed times yaw rate
    (`lateral`).
    """

    forward: tuple[float, ...]
    turn: tuple[float, ...]
    along: float
    lateral: float


@dataclass(frozen=True)
class VelocityLimits:
    """Limits of each quasi-velocity, all positive: of the command (`speed`), of its rate of change
    (`acceleration`), and of its difference from the measured velocity (`band`), in the unit of the
    quasi-velocity and its rate. `vehicle`: of its motion.
    """

    speed: tuple[float, ...]
    acceleration: tuple[float, ...]
    band: tuple[float, ...]
    vehicle: VehicleLimits | None = None


class Velocity(Protocol):
    """Commands for velocity-controlled drives. Velocities and accelerations in the order of the
    quasi-velocities, SI."""

    def reset(self, nu: np.ndarray) -> None:
        """Begin at the measured velocities."""

    def step(self, u: np.ndarray, nu: np.ndarray, status: str, dt: float) -> tuple[str, np.ndarray]:
        """Return the status and the commands until the next call, dt (s) later, from the accelerations u, the
        measured velocities and the status of the law's step.
        """

    def follow(self, desired: np.ndarray, nu: np.ndarray, status: str, dt: float) -> tuple[str, np.ndarray]:
        """Return the same from desired velocities."""


class ReferenceVelocity:
    """The reference implementation, in double."""

    def __init__(self, limits: VelocityLimits, period: float):
        self._speed, self._acceleration = np.array(limits.speed), np.array(limits.acceleration)
        self._band, self._vehicle = np.array(limits.band), limits.vehicle
        self._period, self._command = period, np.zeros(len(limits.speed))

    def reset(self, nu: np.ndarray) -> None:
        """See Velocity."""
        self._command = np.clip(nu, -self._speed, self._speed)

    def step(self, u: np.ndarray, nu: np.ndarray, status: str, dt: float) -> tuple[str, np.ndarray]:
        """See Velocity."""
        desired = self._command + u * dt
        return self._made(desired, self._step(desired, dt), nu, status, dt)

    def follow(self, desired: np.ndarray, nu: np.ndarray, status: str, dt: float) -> tuple[str, np.ndarray]:
        """See Velocity."""
        return self._made(desired, desired, nu, status, dt)

    def _made(
        self, desired: np.ndarray, target: np.ndarray, nu: np.ndarray, status: str, dt: float
    ) -> tuple[str, np.ndarray]:
        if status not in RUNNING:
            return status, self._towards(np.zeros(len(nu)), self._period)
        if not (np.isfinite(desired).all() and np.isfinite(nu).all()):
            return "nonfinite", self._towards(np.zeros(len(nu)), self._period)
        slower = max(1.0, (np.abs(target) / self._speed).max())
        curved = np.sqrt(self._lateral(target)) > slower
        target = target / max(slower, np.sqrt(self._lateral(target)))
        target = np.clip(np.clip(target, nu - self._band, nu + self._band), -self._speed, self._speed)
        target, beyond = self._rolled(target, dt)
        target, held = self._held(self._step(target, dt), dt)
        scale = 1e-12 * (1 + np.abs(desired).max() + np.abs(self._command).max())
        limited = np.abs(target - desired).max() > scale
        self._command = target
        found = held or ("grip" if curved or beyond else "saturated" if limited else "ok")
        return found if status == "ok" else status, target.copy()

    def _twist(self, nu: np.ndarray) -> np.ndarray:
        vehicle = self._vehicle
        return np.array([vehicle.forward, vehicle.turn]) @ nu if vehicle else np.zeros(2)

    def _lateral(self, nu: np.ndarray) -> float:
        """Speed times yaw rate as a part of its limit."""
        return abs(float(np.prod(self._twist(nu)))) / self._vehicle.lateral if self._vehicle else 0.0

    def _with_twist(self, speed: float, yaw: float) -> np.ndarray:
        assert self._vehicle
        (a, b), (c, d) = self._vehicle.forward, self._vehicle.turn
        return np.array([d * speed - b * yaw, a * yaw - c * speed]) / (a * d - b * c)

    def _rolled(self, target: np.ndarray, dt: float) -> tuple[np.ndarray, bool]:
        """Return the target with the speed that can be reached, the desired curvature and a yaw rate within
        the lateral limit; whether that was beyond it.
        """
        if self._vehicle is None:
            return target, False
        (before, _), (speed, yaw) = self._twist(self._command), self._twist(target)
        most = self._vehicle.along * dt
        after = before + np.clip(speed - before, -most, most)
        turned = yaw * abs(after / speed) if abs(after) < abs(speed) else yaw
        beyond = bool(abs(after * turned) > self._vehicle.lateral)
        turned = (
            np.clip(turned, *[sign * self._vehicle.lateral / abs(after) for sign in (-1, 1)])
            if beyond
            else turned
        )
        return self._with_twist(after, turned), beyond

    def _held(self, target: np.ndarray, dt: float) -> tuple[np.ndarray, str]:
        """Return the target within the lateral limit, and the status if it was changed for that."""
        if self._vehicle is None or self._lateral(target) <= 1 + 1e-9:
            return target, ""
        (before, yaw), (after, turned) = self._twist(self._command), self._twist(target)
        if abs(after) <= abs(before):
            changed = self._with_twist(after, yaw)
        else:
            changed = self._with_twist(before, turned if abs(turned) <= abs(yaw) else yaw)
        target = self._step(changed, dt)
        return (
            (target, "grip")
            if self._lateral(target) <= 1 + 1e-9
            else (self._step(np.zeros(2), dt), "will_slip")
        )

    def _step(self, target: np.ndarray, dt: float) -> np.ndarray:
        change = target - self._command
        most = max(1.0, (np.abs(change) / (self._acceleration * dt)).max())
        if self._vehicle:
            most = max(most, abs(self._twist(change)[0]) / (self._vehicle.along * dt))
        return self._command + change / most

    def _towards(self, target: np.ndarray, dt: float) -> np.ndarray:
        self._command = self._step(target, dt)
        return self._command.copy()


class CompiledVelocity:
    """The C, in double or float. Raises BadInput for limits or a period that init refuses."""

    def __init__(
        self, limits: VelocityLimits, period: float, scalar: str = "double", c: Runtime | None = None
    ):
        from .runtime import runtime  # slow to import

        self._runtime, self._scalar, self._lock = c or runtime(HEADER), scalar, Lock()
        rows = list(zip(limits.speed, limits.acceleration, limits.band, strict=True))
        self._count = len(rows)
        rows += [(0.0, 0.0, 0.0)] * (MOST - self._count)  # arrays of this length are sent to a processor
        kind = self._runtime.new("noslip_velocity_limits", scalar)
        given = self._runtime.ffi.new(f"{self._runtime.ffi.typeof(kind).item.cname}[]", rows)
        self._self, self._command = self._runtime.new("noslip_velocity", scalar), self._array([])
        self._checked("init", given, self._count, float(period))
        if limits.vehicle:
            self._checked(
                "set_vehicle", self._runtime.new("noslip_velocity_vehicle", scalar, asdict(limits.vehicle))
            )

    def reset(self, nu: np.ndarray) -> None:
        """See Velocity."""
        self._checked("reset", self._array(nu))

    def step(self, u: np.ndarray, nu: np.ndarray, status: str, dt: float) -> tuple[str, np.ndarray]:
        """See Velocity."""
        return self._made("step", u, nu, status, dt)

    def follow(self, desired: np.ndarray, nu: np.ndarray, status: str, dt: float) -> tuple[str, np.ndarray]:
        """See Velocity."""
        return self._made("follow", desired, nu, status, dt)

    def _made(
        self, name: str, first: np.ndarray, nu: np.ndarray, status: str, dt: float
    ) -> tuple[str, np.ndarray]:
        given = [self._array(values) for values in (first, nu)]
        function = self._runtime.function(f"noslip_velocity_{name}", self._scalar)
        with self._lock:
            number = function(self._self, *given, self._runtime.number(status), float(dt), self._command)
            return self._runtime.status(number), np.array(list(self._command))[: self._count]

    def _array(self, values: Numbers):
        return self._runtime.array(self._scalar, [*values, *[0.0] * (MOST - len(values))])

    def _checked(self, name: str, *arguments) -> None:
        self._runtime.call("[drive]", f"noslip_velocity_{name}", self._scalar, self._self, *arguments)


def make_velocity(backend: str, limits: VelocityLimits, period: float, law: ControlLaw) -> Velocity:
    """Return the generator of commands for a backend: casadi in Python, the others by the C,
    where they run `law`."""
    if backend == "casadi":
        return ReferenceVelocity(limits, period)
    c, scalar = runtime_of(backend, HEADER, law)
    return CompiledVelocity(limits, period, scalar, c)


Acceleration = Callable[[np.ndarray, np.ndarray], tuple[str, np.ndarray]]  # from [q; nu] and tau


def make_acceleration(backend: str, law: ControlLaw, parameters: Numbers) -> Acceleration:
    """Return the function from [q; nu] and tau to the status and nudot (11), with the parameters that the
    controller believes: by the model, or by the generated C of the robot's dynamics, where the backend runs
    `law`.
    """
    system = law.system
    n = len(system.mechanism.coordinates)
    if backend == "casadi":
        function, given = Direct(acceleration_function(system)), np.array(parameters, float)
        return lambda x, tau: ("ok", function(x, tau, given)[0])
    from ...codegen.derivation.stages import Result
    from ...codegen.dynamics import ENTRIES  # slow to import
    from .compiled import CompiledDynamics, dynamics_library

    entry = next(each for each in ENTRIES if each.name == "acceleration")
    if backend in ON_TARGET:
        from .pil import target_dynamics

        dynamics = CompiledDynamics(target_dynamics(law, backend), parameters)
    else:
        dynamics = CompiledDynamics(dynamics_library(system, SCALAR[backend]), parameters)

    def acceleration(x: np.ndarray, tau: np.ndarray) -> tuple[str, np.ndarray]:
        found = dynamics.entry(entry, x, tau)
        return found.status, found.values.get(Result.VELOCITY_RATES, np.zeros(len(x) - n))

    return acceleration


@lru_cache(maxsize=16)
def acceleration_function(system: ReducedSystem) -> ca.Function:
    """Return the function from [q; nu], tau and parameters to nudot (11)."""
    mechanism = system.mechanism
    tau = ca.SX.sym("tau", len(mechanism.inputs))
    given = [ca.vertcat(mechanism.q, system.nu), tau, mechanism.p]
    return portable(ca.Function("acceleration", given, [ca.densify(system.acceleration(tau))]))
