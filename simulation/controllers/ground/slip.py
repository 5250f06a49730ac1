"""Noticing that wheels slip, and the friction that may then be believed: the C (noslip_slip.h),
or a reference implementation."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, fields
from threading import Lock
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ..backends import runtime_of
from ..controller import Numbers
from ..runtime import Runtime, runtime

if TYPE_CHECKING:
    from ....model.law import ControlLaw

HEADER = "noslip_slip.h"


@dataclass(frozen=True)
class SlipOptions:
    """What is known of the sensors, and what is done where wheels slip, as in the C struct
    noslip_slip_options, SI: `count` are the angles of one count of the wheels' encoders.
    """

    window: float
    count: tuple[float, float]
    wheel_noise: float
    gyro_noise: float
    gyro_bias: float
    acceleration_noise: float
    acceleration_bias: float
    geometry: float
    deviations: float
    mu: float
    least: float
    lower: float
    pause: float
    rise: float
    hold: float


@dataclass(frozen=True)
class Noticed:
    """What a call notices: `status` "ok" or "slipping"; the friction that may be believed, and the factor of
    a desired speed along a path; by how much dead reckoning may be wrong because of slip, rad and m;
    differences between gyro and wheels (rad) and accelerations and wheels (m/s), with the thresholds beyond
    which they slip.
    """

    status: str
    mu: float
    slower: float
    uncertain_heading: float
    uncertain_way: float
    heading_difference: float
    heading_threshold: float
    speed_difference: float
    speed_threshold: float


class SlipNotice(Protocol):
    """Notices slip from what sensors measured between two calls."""

    options: SlipOptions

    def step(self, angle: Numbers, yaw_rate: float, acceleration: float | None, dt: float) -> Noticed:
        """Take the angles by which the wheels turned (rad) within dt (s), mean yaw rate (rad/s) and mean
        acceleration (m/s^2) or None.
        """

    def trust(self) -> None:
        """Forget the uncertainty, after the pose was corrected."""


class ReferenceSlip:
    """The same in double, by Python."""

    def __init__(self, options: SlipOptions, forward: Numbers, turn: Numbers):
        self.options = options
        self._wheels = np.array([turn, forward], float)  # heading (rad) and way (m) per angle
        self._rate: np.ndarray | None = None
        self._frequency, self._mu, self._quiet = 0.0, options.mu, options.hold
        self._uncertain = np.zeros(2)  # rad, m
        self._clear()

    def _clear(self) -> None:
        self._time, self._measured, self._square = 0.0, np.zeros(2), np.zeros(2)
        self._moved = np.zeros((2, 2))  # angles, and changes of the rates, of the wheels

    def step(self, angle: Numbers, yaw_rate: float, acceleration: float | None, dt: float) -> Noticed:
        """See SlipNotice.step."""
        o, turned = self.options, np.asarray(angle, float)
        keeps, rate = o.window / (o.window + dt), np.asarray(angle, float) / dt
        before = rate if self._rate is None else self._rate
        frequency = self._frequency or 1 / dt
        self._time = keeps * (self._time + dt)
        self._moved = keeps * (self._moved + [turned, rate - before])
        self._measured = keeps * (self._measured + dt * np.array([yaw_rate, acceleration or 0.0]))
        wheel = (o.wheel_noise * dt * self._wheels[0]) ** 2
        noise = (np.array([o.gyro_noise, o.acceleration_noise]) * dt) ** 2 + [wheel.sum(), 0.0]
        self._square = keeps * keeps * (self._square + noise)
        self._rate, self._frequency = rate, keeps * frequency + (1 - keeps) / dt
        square = self._square + [0.0, np.sum((o.wheel_noise * self._wheels[1]) ** 2)]
        coarse = np.array([1.0, keeps * (1 / dt + frequency)])[:, None] * np.array(o.count)
        bounds = np.sum(np.abs(self._wheels) * (coarse + o.geometry * np.abs(self._moved)), axis=1)
        threshold = (
            bounds
            + self._time * np.array([o.gyro_bias, o.acceleration_bias])
            + o.deviations * np.sqrt(square)
        )
        difference = self._measured - np.sum(self._wheels * self._moved, axis=1)
        if acceleration is None:
            difference[1] = 0.0
        self._quiet = min(self._quiet + dt, o.hold)
        slips = self._quiet >= o.pause and bool((np.abs(difference) > threshold).any())
        if slips:
            self._uncertain += [abs(difference[0]), np.sum(np.abs(self._wheels[1] * self._moved[0]))]
            self._mu, self._quiet = max(self._mu * o.lower, o.least), 0.0
            self._clear()
        elif self._quiet >= o.hold:
            self._mu = min(self._mu + o.rise * dt, o.mu)
        status = "slipping" if slips or self._quiet < o.hold else "ok"
        pairs = [float(value) for pair in zip(difference, threshold, strict=True) for value in pair]
        return Noticed(status, self._mu, math.sqrt(self._mu / o.mu), *map(float, self._uncertain), *pairs)

    def trust(self) -> None:
        """See SlipNotice.trust."""
        self._uncertain = np.zeros(2)


class CompiledSlip:
    """The same by the C, in double or float."""

    def __init__(
        self,
        options: SlipOptions,
        forward: Numbers,
        turn: Numbers,
        scalar: str = "double",
        c: Runtime | None = None,
    ):
        """Raises BadInput for options that are not in their ranges."""
        self.options = options
        self._runtime, self._scalar, self._lock = c or runtime(HEADER), scalar, Lock()
        new = self._runtime.new
        self._self, self._reading = new("noslip_slip", scalar), new("noslip_slip_reading", scalar)
        self._noticed = new("noslip_noticed", scalar)
        vehicle = new("noslip_odometry_options", scalar, {"forward": list(forward), "turn": list(turn)})
        self._call("init", new("noslip_slip_options", scalar, asdict(options)), vehicle)

    def step(self, angle: Numbers, yaw_rate: float, acceleration: float | None, dt: float) -> Noticed:
        """See SlipNotice.step."""
        with self._lock:
            self._reading.angle = [float(value) for value in angle]
            self._reading.yaw_rate, self._reading.acceleration = float(yaw_rate), float(acceleration or 0.0)
            self._reading.accelerates = int(acceleration is not None)
            status = self._call("step", self._reading, float(dt), self._noticed)
            return Noticed(status, *(getattr(self._noticed, field.name) for field in fields(Noticed)[1:]))

    def trust(self) -> None:
        """See SlipNotice.trust."""
        with self._lock:
            self._call("trust")

    def _call(self, name: str, *arguments) -> str:
        return self._runtime.call(
            "noticing slip", f"noslip_slip_{name}", self._scalar, self._self, *arguments
        )


def make_slip(
    backend: str, options: SlipOptions, forward: Numbers, turn: Numbers, law: ControlLaw | None = None
) -> SlipNotice:
    """Return what notices slip, in Python ("casadi"), or the C as run by a backend; see `runtime_of`.

    `forward` (2,) m/rad and `turn` (2,) rad/rad are those of the wheels. Raises BadInput for invalid options.
    """
    if backend == "casadi":
        return ReferenceSlip(options, forward, turn)
    c, scalar = runtime_of(backend, HEADER, law)
    return CompiledSlip(options, forward, turn, scalar, c)
