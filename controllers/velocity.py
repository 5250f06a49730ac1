"""Commands for drives that take velocities: the integral of the law's accelerations, by the C (noslip_velocity.h), or by a
reference implementation of the same.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from threading import Lock
from typing import Protocol

import casadi as ca
import numpy as np

from ..model.algebra.portable import portable
from ..model.reduction import ReducedSystem
from ..readers.errors import BadInput
from . import SCALAR
from .controller import RUNNING, Numbers
from .direct import Direct

HEADER = "noslip_velocity.h"
MOST = 8  # quasi-velocities, as NOSLIP_VELOCITIES


@dataclass(frozen=True)
class VelocityLimits:
    """Limits of each quasi-velocity, all positive: of the command (`speed`), of its rate of change (`acceleration`), and of its
    difference from the measured velocity (`band`), in the unit of the quasi-velocity and its rate.
    """

    speed: tuple[float, ...]
    acceleration: tuple[float, ...]
    band: tuple[float, ...]


class Velocity(Protocol):
    """Commands for velocity-controlled drives. Velocities and accelerations in the order of the quasi-velocities, SI."""

    def reset(self, nu: np.ndarray) -> None:
        """Begin at the measured velocities."""

    def step(self, u: np.ndarray, nu: np.ndarray, status: str, dt: float) -> tuple[str, np.ndarray]:
        """Return the status and the commands until the next call, dt (s) later, from the accelerations u, the measured
        velocities and the status of the law's step.
        """


class ReferenceVelocity:
    """The reference implementation, in double."""

    def __init__(self, limits: VelocityLimits, period: float):
        self._speed, self._acceleration = np.array(limits.speed), np.array(limits.acceleration)
        self._band = np.array(limits.band)
        self._period, self._command = period, np.zeros(len(limits.speed))

    def reset(self, nu: np.ndarray) -> None:
        """See Velocity."""
        self._command = np.clip(nu, -self._speed, self._speed)

    def step(self, u: np.ndarray, nu: np.ndarray, status: str, dt: float) -> tuple[str, np.ndarray]:
        """See Velocity."""
        if status not in RUNNING:
            return status, self._towards(np.zeros(len(nu)), self._period)
        if not (np.isfinite(u).all() and np.isfinite(nu).all()):
            return "nonfinite", self._towards(np.zeros(len(nu)), self._period)
        before = self._command.copy()
        target = self._step(before + u * dt, dt)
        target = target / max(1.0, (np.abs(target) / self._speed).max())
        target = np.clip(np.clip(target, nu - self._band, nu + self._band), -self._speed, self._speed)
        made = self._towards(target, dt)
        limited = np.abs(made - (before + u * dt)).max() > 1e-12 * (1 + np.abs(u).max() * dt + np.abs(before).max())
        return "saturated" if limited and status == "ok" else status, made

    def _step(self, target: np.ndarray, dt: float) -> np.ndarray:
        change = target - self._command
        return self._command + change / max(1.0, (np.abs(change) / (self._acceleration * dt)).max())

    def _towards(self, target: np.ndarray, dt: float) -> np.ndarray:
        self._command = self._step(target, dt)
        return self._command.copy()


class CompiledVelocity:
    """The C, in double or float. Raises BadInput for limits or a period that init refuses."""

    def __init__(self, limits: VelocityLimits, period: float, scalar: str = "double"):
        from .runtime import runtime  # slow to import

        self._runtime, self._scalar, self._lock = runtime(HEADER), scalar, Lock()
        rows = list(zip(limits.speed, limits.acceleration, limits.band, strict=True))
        kind = self._runtime.new("noslip_velocity_limits", scalar)
        given = self._runtime.ffi.new(f"{self._runtime.ffi.typeof(kind).item.cname}[]", rows)
        self._self, self._command = self._runtime.new("noslip_velocity", scalar), self._runtime.array(scalar, [0.0] * len(rows))
        self._checked("init", given, len(rows), float(period))

    def reset(self, nu: np.ndarray) -> None:
        """See Velocity."""
        self._checked("reset", self._runtime.array(self._scalar, nu))

    def step(self, u: np.ndarray, nu: np.ndarray, status: str, dt: float) -> tuple[str, np.ndarray]:
        """See Velocity."""
        given = [self._runtime.array(self._scalar, values) for values in (u, nu)]
        with self._lock:
            made = self._call("step", *given, self._runtime.number(status), float(dt), self._command)
            return self._runtime.status(made), np.array(list(self._command))

    def _checked(self, name: str, *arguments) -> None:
        if (status := self._call(name, *arguments)) < 0:
            raise BadInput(f"[drive]: noslip_velocity_{name} returns {self._runtime.status(status)!r}")

    def _call(self, name: str, *arguments) -> int:
        return self._runtime.function(f"noslip_velocity_{name}", self._scalar)(self._self, *arguments)


def make_velocity(backend: str, limits: VelocityLimits, period: float) -> Velocity:
    """Return the generator of commands for a backend: casadi in Python, c and cf by the C. Raises BadInput for another."""
    if backend == "casadi":
        return ReferenceVelocity(limits, period)
    return CompiledVelocity(limits, period, _scalar(backend))


Acceleration = Callable[[np.ndarray, np.ndarray], tuple[str, np.ndarray]]  # from [q; nu] and tau


def make_acceleration(backend: str, system: ReducedSystem, parameters: Numbers) -> Acceleration:
    """Return the function from [q; nu] and tau to the status and nudot (11), with the parameters that the controller believes: by
    the model, or by the generated C of the robot's dynamics. Raises BadInput for a backend other than casadi, c and cf.
    """
    n = len(system.mechanism.coordinates)
    if backend == "casadi":
        function, given = Direct(acceleration_function(system)), np.array(parameters, float)
        return lambda x, tau: ("ok", function(x, tau, given)[0])
    from ..codegen.derivation.stages import Result
    from ..codegen.dynamics import ENTRIES  # slow to import
    from .compiled import CompiledDynamics, dynamics_library

    entry = next(each for each in ENTRIES if each.name == "acceleration")
    dynamics = CompiledDynamics(dynamics_library(system, _scalar(backend)), parameters)

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


def _scalar(backend: str) -> str:
    if backend not in SCALAR:
        raise BadInput(f"[drive] of kind velocity is there for the backends casadi, c and cf, not for {backend!r}")
    return SCALAR[backend]


def velocity_limits(speed: Sequence[float], acceleration: Sequence[float], lag: float) -> VelocityLimits:
    """Return limits with a band of twice what a drive that lags by `lag` (s) is behind at the largest acceleration."""
    return VelocityLimits(tuple(speed), tuple(acceleration), tuple(2 * a * lag for a in acceleration))
