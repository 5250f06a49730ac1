"""A SPEC as the numbers of the firmware of its vehicle."""

import math
from collections.abc import Iterable
from dataclasses import asdict, replace

import casadi as ca
import numpy as np

from ...codegen.follower.follower import is_followers, why_no_follower
from ...codegen.loop.stages import check
from ...codegen.project.vehicle import FloorNumbers, NoiseNumbers, VehicleNumbers, VelocityDrives
from ...model.mechanism import Quantity
from ...model.vehicle import SteeredAxle, steered_axle
from ...readers.errors import BadInput
from ..controllers.controller import Limits
from ..controllers.odometry import vehicle_wheels
from ..controllers.tracking import TrackerOptions
from ..drive import command_limits, whole_periods
from ..guidance import Direct, vehicle_motion
from ..loop import Loop, make_loop
from ..plant import Plant
from ..specification.spec import ContactSection, Sensors, Spec

EXPORT = "export --firmware"  # in the table of stages
COUNTER_BITS = 16
FASTER = 3.0  # than a wheel turns on the path: what is faster is a misread counter
ASTRAY = 0.3  # m, from the path beyond the start
STEERING = 1.3  # rad, largest steering angle
OUTPUTS = ("distance", "speed")  # in the order of the follower's integral action


def vehicle_of(spec: Spec) -> tuple[Loop, VehicleNumbers]:
    """Return the loop of a SPEC in float, and the numbers of a follower for its vehicle, SI.

    Raises BadInput for options that a follower does not have, by the table of stages, for a robot that has
    none, and as `make_loop` does.
    """
    check(spec, EXPORT)
    loop = make_loop(replace(spec, simulation=replace(spec.simulation, backend="cf")))
    if not is_followers(loop.law):
        raise BadInput(f"--firmware: {why_no_follower(loop.law.system)}")
    return loop, _numbers(spec, loop)


def _numbers(spec: Spec, loop: Loop) -> VehicleNumbers:
    """Return the numbers of a follower for the vehicle of a SPEC, which has one, and its loop."""
    assert spec.sensors and spec.sensors.counts and spec.output.path, "by the table of stages"
    law, system = loop.law, loop.law.system
    route, period = loop.route, spec.simulation.period
    assert route is not None, "a composite path is followed"
    options = route.options
    axle = steered_axle(system)
    start = (
        loop.start[list(axle.pose)] if axle else Direct(vehicle_motion(system))(loop.start, loop.believed)[0]
    )
    off = abs(float(route.guide(loop.start).distance))
    path: dict[str, object] = {
        "speed": options.speed,
        "deceleration": options.deceleration,
        "creep": options.creep,
        "L": tuple(options.L),
        "reversing": f"NOSLIP_{options.reversing.upper()}",
        "stop": f"NOSLIP_STOP_{options.stop.upper()}",
        "closed": options.closed,
    }
    commands, follows = _drives(spec, loop)
    config = {
        "params": _named(law.parameters, loop.believed),
        "period": period,
        "counts_per_turn": (float(spec.sensors.counts),) * 2,
        "counter_bits": COUNTER_BITS,
        **(
            _fastest_steered(loop, axle, options)
            if axle
            else {"fastest": _fastest(loop, options.speed, spec)}
        ),
        "start": dict(zip(("x", "y", "heading"), map(float, start[:3]), strict=True)),
        "path": path,
        "astray": off + ASTRAY,
        "gains": _named(law.gains, loop.gains),
        **_integral(loop),
        "limits": _limits(loop.limits),
        **commands,
        "watchdog": {"tolerated": 3, "forgiven": 100},
    }
    assumed = [
        f"counters of {COUNTER_BITS} bits, which increase driving forward",
        f"a wheel that turns {FASTER:g} times as fast as on the path is misread",
        f"{ASTRAY:g} m farther from the path than at the start is astray",
        "the watchdog bridges 3 errors, each forgiven after 100 ticks, and does not look for wheels that are "
        "stuck",
        *(
            [f"a steering angle beyond {STEERING:g} rad is misread; its counter is 0 straight ahead"]
            if axle
            else []
        ),
    ]
    late = spec.simulation.delay + (spec.drive.delay if spec.drive and follows else 0.0)
    return VehicleNumbers(
        config=config,
        segments=spec.output.segments,
        plant=_named(law.parameters, loop.plant.parameters),
        start=_named(system.state, loop.start),
        duration=spec.simulation.duration,
        output_step=spec.simulation.output_step,
        tolerance=spec.simulation.tolerance,
        late=whole_periods(late, period),
        drives=follows,
        floor=_floor(spec.contact, loop.plant) if spec.contact else None,
        noise=_noise(spec.sensors),
        integrals=[OUTPUTS.index(name) for name in loop.integral.rows],
        assumed=assumed,
        warnings=loop.warnings,
    )


def _noise(sensors: Sensors) -> NoiseNumbers | None:
    """Return the noise of the wheels' rates, None if there is none."""
    mean, sd = (np.broadcast_to(values, 2).tolist() for values in (sensors.noise.mean, sensors.noise.sd))
    return NoiseNumbers(sensors.seed % 2**64, mean, sd, sensors.period) if any((*mean, *sd)) else None


def _floor(contact: ContactSection, plant: Plant) -> FloorNumbers:
    """Return what the SPEC says of the floor, and the robot where it says nothing."""
    return FloorNumbers(contact.mu, contact.share, contact.height or plant.height)


def _named(quantities: Iterable[Quantity], values: Iterable[float]) -> dict[str, float]:
    """Return values by the members of the C of the quantities."""
    return {q.in_c: float(value) for q, value in zip(quantities, values, strict=True)}


def _fastest(loop: Loop, desired: float, spec: Spec) -> float:
    """Return an upper bound of the rate of a wheel, rad/s: FASTER times that on the path."""
    forward, turn, _ = vehicle_wheels(loop.law.system, loop.believed)
    speed = max(desired, abs(spec.initial.speed or 0.0) if spec.initial else 0.0)
    bends = [segment.curvature for segment in spec.output.segments]
    rates = np.linalg.solve(np.array([forward, turn]), speed * np.array([np.ones(len(bends)), bends]))
    return FASTER * float(np.abs(rates).max())


def _fastest_steered(loop: Loop, axle: SteeredAxle, options: TrackerOptions) -> dict[str, object]:
    """Return upper bounds of the rates of the rolling wheel and of steering, rad/s, and of the steering
    angle, rad: FASTER times what the path asks, for steering a right angle over the way that P_l is ahead.
    """
    mechanism = loop.law.system.mechanism
    motion = ca.Function("motion", [axle.angle, mechanism.p], [axle.motion])(0.0, loop.believed).full()
    rates = np.zeros(2)
    rates[1 - axle.steers] = options.speed / abs(motion[0, 1 - axle.steers])
    rates[axle.steers] = math.pi / 2 * options.speed / min(filter(None, map(abs, options.L)))
    return {"fastest": tuple(map(float, FASTER * rates)), "steering": STEERING}


def _integral(loop: Loop) -> dict[str, tuple[float, ...]]:
    """Return gains and limits of integral action, of distance and speed."""
    rows = loop.integral.rows
    if not rows:
        return {}
    values = [dict(zip(rows, each, strict=True)) for each in (loop.integral.ki.tolist(), loop.integral.limit)]
    ki, limit = (tuple(found.get(name, 0.0) for name in OUTPUTS) for found in values)
    return {"ki": ki, "ki_limit": limit}


def _limits(limits: Limits | None) -> dict[str, object]:
    """Return the options of the law."""
    if limits is None:
        return {}
    torque = tuple(value if math.isfinite(value) else 0.0 for value in limits.torque)
    friction = {"friction": asdict(limits.friction)} if limits.friction else {}
    return {"limit": torque, "on_limit": f"NOSLIP_{limits.mode.upper()}", **friction}


def _drives(spec: Spec, loop: Loop) -> tuple[dict[str, object], VelocityDrives | None]:
    """Return what the config says of drives that take velocities, and how they follow them;
    nothing of torques."""
    drive = spec.drive
    if drive is None or not drive.takes_velocity:
        return {}, None
    limits = command_limits(drive, loop.law.system, spec.simulation.period)
    members = zip(limits.speed, limits.acceleration, limits.band, strict=True)
    velocity = [dict(zip(("speed", "acceleration", "band"), each, strict=True)) for each in members]
    return {"drive": "NOSLIP_DRIVE_VELOCITY", "velocity": velocity}, VelocityDrives(
        drive.omega, limits.acceleration
    )
