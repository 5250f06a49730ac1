"""Desired distance and speed that lead a vehicle to its path with bounded acceleration, and jerk: the C
(noslip_approach.h), or a reference implementation of the same.
"""

from __future__ import annotations

import math
from threading import Lock
from typing import TYPE_CHECKING, Protocol

import numpy as np

from .backends import runtime_of
from .runtime import Runtime, runtime

if TYPE_CHECKING:
    from ...model.law import ControlLaw

HEADER = "noslip_approach.h"
SETTLING = 0.25  # s, at least; the time constant with which the distance ends
PERIODS = 2.0  # and at least so many periods of the controller


class Approach(Protocol):
    """A generator of [distance, its rate and acceleration, speed, its rate], SI,
    for a law of path following."""

    def start(self, distance: float, rate: float, speed: float) -> None:
        """Begin at the vehicle's distance from the path (m), the rate of that and its speed (m/s)."""

    def step(self, dt: float, speed: float) -> np.ndarray:
        """Advance by dt (s) and return what is desired until the next call;
        `speed` (m/s) is the final one."""

    def within(self, speed: float, speed_rate: float) -> np.ndarray:
        """Keep the desired speed from 0 to `speed` (m/s), which changes by `speed_rate` (m/s^2);
        return what is desired."""


class ReferenceApproach:
    """The generator in double, by Python."""

    def __init__(self, acceleration: float, settling: float, jerk: float = 0.0):
        self._most, self._settling, self._jerk = acceleration, settling, jerk
        self._desired, self._plan, self._time = np.zeros(5), np.zeros((0, 2)), 0.0

    def start(self, distance: float, rate: float, speed: float) -> None:
        """See Approach."""
        self._desired, self._time = np.array([distance, rate, 0.0, speed, 0.0]), 0.0
        self._from, self._plan = (distance, rate), self._planned(distance, rate) if self._jerk else self._plan

    def step(self, dt: float, speed: float) -> np.ndarray:
        """See Approach."""
        if self._jerk:
            return self._jerked(dt, speed)
        y, rate, acceleration, v, v_rate = self._desired
        y, rate, v = y + dt * rate + acceleration * dt * dt / 2, rate + dt * acceleration, v + dt * v_rate
        end = np.clip((speed - v) / self._settling, -self._most, self._most)
        self._desired = np.array([y, rate, self._acceleration(y, rate, self._most), v, end])
        return self._desired.copy()

    def within(self, speed: float, speed_rate: float) -> np.ndarray:
        """See Approach."""
        led = self._desired[3]
        if (speed >= 0 and led > speed) or (speed <= 0 and led < speed):
            self._desired[3:] = speed, speed_rate
        return self._desired.copy()

    def _jerked(self, dt: float, speed: float) -> np.ndarray:
        """Advance along the plan; and the speed with the jerk as if it were the acceleration of a
        distance."""
        self._time += dt
        v, v_rate = self._desired[3:]
        changed = v_rate + dt * self._acceleration(v - speed, v_rate, self._jerk)
        end = float(np.clip(changed, -self._most, self._most))
        self._desired = np.array([*self._along(self._time), v + dt * (v_rate + end) / 2, end])
        return self._desired.copy()

    def _acceleration(self, y: float, rate: float, most: float) -> float:
        """Brake where the rate exceeds that of the parabola through 0, drawn one settling time ahead."""
        zone = most * self._settling * self._settling
        place = y + self._settling * rate
        aim = (
            place
            if abs(place) <= zone
            else math.copysign((math.sqrt(zone * zone + 8 * zone * abs(place)) - zone) / 2, place)
        )
        return -most * float(np.clip((self._settling * rate + aim) / zone, -1.0, 1.0))

    def _planned(self, distance: float, rate: float) -> np.ndarray:
        """Return the durations (s) and jerks of the fastest way from a distance and its rate to rest at 0,
        (6, 2)."""

        def change(size: float) -> list[tuple[float, float]]:
            most = self._most / self._jerk
            bend = min(math.sqrt(abs(size) / self._jerk), most)
            jerk = math.copysign(self._jerk, size)
            return [
                (bend, jerk),
                (abs(size) / self._most - most if bend == most else 0.0, 0.0),
                (bend, -jerk),
            ]

        def plan(peak: float) -> np.ndarray:
            return np.array([*change(peak - rate), *change(-peak)])

        def end(peak: float) -> float:
            first, second = (sum(part[0] for part in change(size)) for size in (peak - rate, -peak))
            return distance + (rate + peak) / 2 * first + peak / 2 * second

        reach = abs(rate) + math.sqrt(2 * self._most * abs(end(0.0)))
        low, high = (max(rate, 0.0), reach) if end(0.0) <= 0 else (-reach, min(rate, 0.0))
        while low < (middle := (low + high) / 2) < high:
            low, high = (middle, high) if end(middle) < 0 else (low, middle)
        return plan(high)

    def _along(self, time: float) -> tuple[float, float, float]:
        """Return distance, rate and acceleration at a time of the plan."""
        y, rate, acceleration = (*self._from, 0.0)
        if time >= self._plan[:, 0].sum():
            return 0.0, 0.0, 0.0
        for duration, jerk in self._plan:
            dt = min(duration, time)
            y += dt * (rate + dt * (acceleration / 2 + dt * jerk / 6))
            rate += dt * (acceleration + dt * jerk / 2)
            acceleration, time = acceleration + dt * jerk, time - dt
        return y, rate, acceleration


class CompiledApproach:
    """The generator by the C, in double or float."""

    def __init__(
        self,
        acceleration: float,
        settling: float,
        scalar: str = "double",
        c: Runtime | None = None,
        jerk: float = 0.0,
    ):
        self._runtime, self._scalar, self._lock = c or runtime(HEADER), scalar, Lock()
        self._self = self._runtime.new("noslip_approach", scalar)
        self._desired = self._runtime.new("noslip_approached", scalar)
        self._call("init", float(acceleration), float(settling), float(jerk))

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
        self._runtime.call("approach", f"noslip_approach_{name}", self._scalar, self._self, *arguments)


def make_approach(
    backend: str, acceleration: float, period: float, law: ControlLaw | None = None, jerk: float = 0.0
) -> Approach:
    """Return a generator called every `period` seconds, in Python ("casadi"), or the C as run by a backend;
    see `runtime_of`.

    `acceleration` (m/s^2) and `jerk` (m/s^3, 0: no bound) are the largest.
    """
    settling = max(SETTLING, PERIODS * period)
    if backend == "casadi":
        return ReferenceApproach(acceleration, settling, jerk)
    c, scalar = runtime_of(backend, HEADER, law)
    return CompiledApproach(acceleration, settling, scalar, c, jerk)
