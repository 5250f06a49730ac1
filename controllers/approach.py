"""Desired distance and speed that lead a vehicle to its path with bounded acceleration: the C (noslip_approach.h), or a reference
implementation of the same.
"""

from __future__ import annotations

import math
from threading import Lock
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ..readers.errors import BadInput
from .backends import runtime_of
from .runtime import Runtime, runtime

if TYPE_CHECKING:
    from ..model.law import ControlLaw

HEADER = "noslip_approach.h"
SETTLING = 0.25  # s, at least; the time constant with which the distance ends
PERIODS = 2.0  # and at least so many periods of the controller


class Approach(Protocol):
    """A generator of [distance, its rate and acceleration, speed, its rate], SI, for a law of path following."""

    def start(self, distance: float, rate: float, speed: float) -> None:
        """Begin at the vehicle's distance from the path (m), the rate of that and its speed (m/s)."""

    def step(self, dt: float, speed: float) -> np.ndarray:
        """Advance by dt (s) and return what is desired until the next call; `speed` (m/s) is the final one."""

    def within(self, speed: float, speed_rate: float) -> np.ndarray:
        """Keep the desired speed from 0 to `speed` (m/s), which changes by `speed_rate` (m/s^2); return what is desired."""


class ReferenceApproach:
    """The generator in double, by Python."""

    def __init__(self, acceleration: float, settling: float):
        self._most, self._settling = acceleration, settling
        self._desired = np.zeros(5)

    def start(self, distance: float, rate: float, speed: float) -> None:
        """See Approach."""
        self._desired = np.array([distance, rate, 0.0, speed, 0.0])

    def step(self, dt: float, speed: float) -> np.ndarray:
        """See Approach."""
        y, rate, acceleration, v, v_rate = self._desired
        y, rate, v = y + dt * rate + acceleration * dt**2 / 2, rate + dt * acceleration, v + dt * v_rate
        end = np.clip((speed - v) / self._settling, -self._most, self._most)
        self._desired = np.array([y, rate, self._acceleration(y, rate), v, end])
        return self._desired.copy()

    def within(self, speed: float, speed_rate: float) -> np.ndarray:
        """See Approach."""
        led = self._desired[3]
        if (speed >= 0 and led > speed) or (speed <= 0 and led < speed):
            self._desired[3:] = speed, speed_rate
        return self._desired.copy()

    def _acceleration(self, y: float, rate: float) -> float:
        """Brake where the rate exceeds that of the parabola through 0, drawn one settling time ahead."""
        zone = self._most * self._settling**2
        place = y + self._settling * rate
        aim = place if abs(place) <= zone else math.copysign((math.sqrt(zone**2 + 8 * zone * abs(place)) - zone) / 2, place)
        return -self._most * float(np.clip((self._settling * rate + aim) / zone, -1.0, 1.0))


class CompiledApproach:
    """The generator by the C, in double or float."""

    def __init__(self, acceleration: float, settling: float, scalar: str = "double", c: Runtime | None = None):
        self._runtime, self._scalar, self._lock = c or runtime(HEADER), scalar, Lock()
        self._self = self._runtime.new("noslip_approach", scalar)
        self._desired = self._runtime.new("noslip_approached", scalar)
        self._call("init", float(acceleration), float(settling), 0.0)

    def start(self, distance: float, rate: float, speed: float) -> None:
        """See Approach."""
        self._call("start", float(distance), float(rate), float(speed))

    def step(self, dt: float, speed: float) -> np.ndarray:
        """See Approach."""
        return self._called("step", float(dt), float(speed))

    def within(self, speed: float, speed_rate: float) -> np.ndarray:
        """See Approach."""
        return self._called("within", float(speed), float(speed_rate))

    def _called(self, name: str, *arguments: float) -> np.ndarray:
        with self._lock:
            self._call(name, *arguments, self._desired)
            y = self._desired
            return np.array([y.distance, y.distance_rate, y.distance_acceleration, y.speed, y.speed_rate])

    def _call(self, name: str, *arguments) -> None:
        status = self._runtime.function(f"noslip_approach_{name}", self._scalar)(self._self, *arguments)
        if status < 0:
            raise BadInput(f"approach: {name} returns {self._runtime.status(status)!r}")


def make_approach(backend: str, acceleration: float, period: float, law: ControlLaw | None = None) -> Approach:
    """Return a generator called every `period` seconds, in Python ("casadi"), or the C as run by a backend; see `runtime_of`."""
    settling = max(SETTLING, PERIODS * period)
    if backend == "casadi":
        return ReferenceApproach(acceleration, settling)
    c, scalar = runtime_of(backend, HEADER, law)
    return CompiledApproach(acceleration, settling, scalar, c)
