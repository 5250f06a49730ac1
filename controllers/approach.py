"""Desired distance and speed that lead a vehicle to its path with bounded acceleration: the C (noslip_approach.h), or a reference
implementation of the same.
"""

from __future__ import annotations

import math
from threading import Lock
from typing import Protocol

import numpy as np

from ..readers.errors import BadInput
from . import SCALAR

HEADER = "noslip_approach.h"
SETTLING = 0.25  # s, at least; the time constant with which the distance ends
PERIODS = 2.0  # and at least so many periods of the controller


class Approach(Protocol):
    """A generator of [distance, its rate and acceleration, speed, its rate], SI, for a law of path following."""

    def start(self, distance: float, rate: float, speed: float) -> None:
        """Begin at the vehicle's distance from the path (m), the rate of that and its speed (m/s)."""

    def step(self, dt: float, speed: float) -> np.ndarray:
        """Advance by dt (s) and return what is desired until the next call; `speed` (m/s) is the final one."""


class ReferenceApproach:
    """The generator in double, by Python."""

    def __init__(self, acceleration: float, settling: float):
        self._most, self._settling = acceleration, settling
        self._wanted = np.zeros(5)

    def start(self, distance: float, rate: float, speed: float) -> None:
        """See Approach."""
        self._wanted = np.array([distance, rate, 0.0, speed, 0.0])

    def step(self, dt: float, speed: float) -> np.ndarray:
        """See Approach."""
        y, rate, acceleration, v, v_rate = self._wanted
        y, rate, v = y + dt * rate + acceleration * dt**2 / 2, rate + dt * acceleration, v + dt * v_rate
        end = np.clip((speed - v) / self._settling, -self._most, self._most)
        self._wanted = np.array([y, rate, self._acceleration(y, rate), v, end])
        return self._wanted.copy()

    def _acceleration(self, y: float, rate: float) -> float:
        """Brake where the rate exceeds that of the parabola through 0, drawn one settling time ahead."""
        zone = self._most * self._settling**2
        place = y + self._settling * rate
        aim = place if abs(place) <= zone else math.copysign((math.sqrt(zone**2 + 8 * zone * abs(place)) - zone) / 2, place)
        return -self._most * float(np.clip((self._settling * rate + aim) / zone, -1.0, 1.0))


class CompiledApproach:
    """The generator by the C, in double or float."""

    def __init__(self, acceleration: float, settling: float, scalar: str = "double"):
        from .runtime import runtime  # slow to import

        self._runtime, self._scalar, self._lock = runtime(HEADER), scalar, Lock()
        self._self = self._runtime.new("noslip_approach", scalar)
        self._wanted = self._runtime.new("noslip_approached", scalar)
        self._call("init", float(acceleration), float(settling), 0.0)

    def start(self, distance: float, rate: float, speed: float) -> None:
        """See Approach."""
        self._call("start", float(distance), float(rate), float(speed))

    def step(self, dt: float, speed: float) -> np.ndarray:
        """See Approach."""
        with self._lock:
            self._call("step", float(dt), float(speed), self._wanted)
            w = self._wanted
            return np.array([w.distance, w.distance_rate, w.distance_acceleration, w.speed, w.speed_rate])

    def _call(self, name: str, *arguments) -> None:
        status = self._runtime.function(f"noslip_approach_{name}", self._scalar)(self._self, *arguments)
        if status < 0:
            raise BadInput(f"approach: {name} returns {self._runtime.status(status)!r}")


def make_approach(backend: str, acceleration: float, period: float) -> Approach:
    """Return a generator for a backend called every `period` seconds: casadi in Python, c and cf by the C.

    Raises BadInput for another backend.
    """
    settling = max(SETTLING, PERIODS * period)
    if backend == "casadi":
        return ReferenceApproach(acceleration, settling)
    if backend not in SCALAR:
        raise BadInput(f"[reference] approach is there for the backends casadi, c and cf, not for {backend!r}")
    return CompiledApproach(acceleration, settling, SCALAR[backend])
