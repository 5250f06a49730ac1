"""The ticks of a dump as a run, as if they had been simulated, and as a table."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...codegen.follower.follower import placed_names
from ...codegen.project.vehicle import places
from ...model.reduction import ReducedSystem
from ...model.segments import Segment
from ...model.vehicle import SteeredAxle, steered_axle
from ...readers.tables import Written
from ..contact import contact_forces
from ..controllers.odometry import arm_function, has_arm
from ..plant import Plant
from ..run import Run
from ..specification.spec import (
    ContactSection,
    DriveSection,
    Initial,
    OutputSection,
    PathSection,
    Reference,
    Simulation,
    Spec,
)
from .dump import Start
from .vehicle import FollowerInC

WATCHDOG = ("run", "hold", "stop")
TURN = 2 * math.pi


def run_of(start: Start, vehicle: FollowerInC, where: str) -> Run:
    """Return the ticks of a start as a run: dead reckoning for the pose, angles from the counters, the
    follower's own outputs.

    The rates of the wheels are differences of their angles, not delayed; `seen` has the filtered ones that
    the law was given. Coordinates that the follower does not know are 0. With velocity drives `tau` is the
    law's torque, which the drives need not supply. Raises BadInput if the config cannot be used.
    """
    config, segments = vehicle.config(start.image, where)
    law, records = vehicle.law, start.records
    system = law.system
    spec = _spec(start, vehicle, config, segments)
    t = times(start, config.period)
    q = np.zeros((len(t), len(system.mechanism.coordinates)))
    index = {c.name: k for k, c in enumerate(system.mechanism.coordinates)}
    plant = Plant(system, [getattr(config.params, p.in_c) for p in system.mechanism.parameters])
    x, y, heading = (np.array(records[f"pose.{each}"], float) for each in ("x", "y", "heading"))
    if has_arm(system):
        place = (
            x
            + 1j * y
            - complex(*arm_function(system)(plant.parameters).full().ravel()) * np.exp(1j * heading)
        )
        x, y = place.real, place.imag
    for name, values in zip(placed_names(system), (x, y, heading), strict=True):
        q[:, index[name]] = values
    turned = angles(start, config, steered_axle(system))
    for name, values in zip(angle_names(system), turned.T, strict=True):
        if name:
            q[:, index[name]] = values
    nu, tau = rates(turned, t), np.array(records["torque"], float)
    x = np.hstack([q, nu])
    velocity = bool(spec.drive and spec.drive.takes_velocity)
    empty = np.empty((len(t), 0))
    return Run(
        spec=spec,
        law=law,
        plant=plant,
        t=t,
        q=q,
        nu=nu,
        tau=tau,
        y=np.column_stack([records["distance"], records["speed"]]).astype(float),
        y_d=np.column_stack([records["desired_distance"][:, 0], records["desired_speed"]]).astype(float),
        status=np.array([vehicle.status(number) for number in records["status"].tolist()]),
        forces=plant.constraint_forces(x, tau),
        seen=np.hstack([q, records["rate"]]),
        piece=np.array(records["segment"]),
        config=np.array(places(law, segments, _directions(spec.output)))[
            np.clip(records["segment"], 0, len(segments) - 1)
        ],
        integral=empty,
        extension=empty,
        noticed=empty,
        learned=empty,
        integral_rows=(),
        command=np.array(records["command"], float) if velocity else empty,
        use={c.name: c.use for c in contact_forces(plant, x, tau, spec.contact)}
        if spec.contact and not velocity
        else {},
    )


def times(start: Start, period: float) -> np.ndarray:
    """Return the time of each tick since the start, s."""
    dt = np.array(start.records["dt"], float)
    ticks = start.records["tick"].astype(float)
    if not dt.any():
        return ticks * round(period, 9)
    periods = np.diff(ticks, prepend=-1)
    spans = np.where(dt > 0, dt, periods * period)
    return np.cumsum(spans) - spans[0]


def angle_names(system: ReducedSystem) -> list[str]:
    """Return for each wheel the coordinate whose rate its quasi-velocity is; "" if there is none."""
    names = [c.name for c in system.mechanism.coordinates]
    return [names[places[0]] if places else "" for places in system.coordinates_by_velocity]


def angles(start: Start, config: Any, steered: SteeredAxle | None) -> np.ndarray:
    """Return the angles of the wheels since the first tick, rad, (N, 2): counters that wrap around, or the
    angles of ticks.

    That of a steering is not from the first tick but from straight ahead.
    """
    counts = start.records["counts"].astype(np.int64)
    per_count = TURN / np.array([config.counts_per_turn[0], config.counts_per_turn[1]])
    by_angles = np.array(start.records["dt"])[:, None] > 0
    given = start.records["turned"].astype(float)
    turned = np.cumsum(
        np.where(
            by_angles,
            given,
            _wrapped(np.diff(counts, axis=0, prepend=counts[:1]), config.counter_bits) * per_count,
        ),
        axis=0,
    )
    if steered:
        angle = np.where(
            by_angles, given, _wrapped(counts - config.straight, config.counter_bits) * per_count
        )
        turned[:, steered.steers] = angle[:, steered.steers]
    return turned


def _wrapped(counts: np.ndarray, bits: int) -> np.ndarray:
    """Return changes of counters of so many bits, within half their range."""
    size = 1 << bits
    return (counts + size // 2) % size - size // 2


def rates(turned: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return the rates of the wheels, rad/s, (N, 2): at each tick the mean of those over the intervals before
    and after it."""
    if len(t) < 2:
        return np.zeros(turned.shape)
    between = np.diff(turned, axis=0) / np.diff(t)[:, None]
    return (np.vstack([between[:1], between]) + np.vstack([between, between[-1:]])) / 2


def _spec(start: Start, vehicle: FollowerInC, config: Any, segments: Sequence[Any]) -> Spec:
    """Return the SPEC that says what the config says."""
    law, lib, t = vehicle.law, vehicle.lib, times(start, config.period)
    path = [Segment(s.x, s.y, s.heading, s.curvature, s.length, bool(s.backward)) for s in segments]
    reversing = {lib.NOSLIP_REFUSE: "refuse", lib.NOSLIP_SWITCH: "switch", lib.NOSLIP_ALLOW: "allow"}[
        config.path.reversing
    ]
    friction, velocity = config.limits.friction, config.drive == lib.NOSLIP_DRIVE_VELOCITY
    period, backend = round(config.period, 9), "cf" if vehicle.scalar == "float" else "c"
    return Spec(
        robot=start.robot or law.system.mechanism.name,
        parameters={p.name: getattr(config.params, p.in_c) for p in law.system.mechanism.parameters},
        gains={g.name: getattr(config.gains, g.in_c) for g in law.gains},
        output=OutputSection(
            type="IV",
            L=config.path.L[0],
            path=PathSection(
                kind="composite",
                segments=tuple(path),
                stop="axle" if config.path.stop == lib.NOSLIP_STOP_AXLE else "point",
                closed=bool(config.path.closed),
            ),
            reversing=reversing,
            L_backward=config.path.L[1] if reversing == "switch" else None,
        ),
        reference=Reference(speed=config.path.speed),
        initial=_initial(law.system, config.start),
        contact=ContactSection(mu=friction.mu, share=friction.share or 1.0, height=friction.height)
        if friction.mu > 0
        else None,
        drive=DriveSection(kind="velocity", bandwidth=math.inf) if velocity else None,
        simulation=Simulation(
            duration=max(float(t[-1]), period), period=period, output_step=period, backend=backend
        ),
    )


def _initial(system: ReducedSystem, pose: Any) -> Initial:
    """Return a vehicle at rest at a pose of its follower."""
    if steered_axle(system) is None:
        return Initial(point=(pose.x, pose.y), heading=pose.heading)
    at = dict(zip(placed_names(system), (pose.x, pose.y, pose.heading), strict=True))
    return Initial(q=tuple(at.get(q.in_c, 0.0) for q in system.mechanism.coordinates), nu=(0.0,) * system.dof)


def _directions(output: OutputSection) -> tuple[float, float]:
    """Return L driving forward, and in reverse, m."""
    return output.L, output.L if output.L_backward is None else output.L_backward


def table(start: Start, run: Run) -> list[Written]:
    """Return the columns of a log: those of `noslip simulate` as far as there are such,
    then the other fields of a record."""
    system, records = run.law.system, start.records
    mechanism, rows = system.mechanism, run.law.output.rows
    place, wheels = placed_names(system), angle_names(system)
    measured = [k for k, c in enumerate(mechanism.coordinates) if c.name in place or c.name in wheels]
    columns = [Written("t", "s", "time since the first tick", run.t)]
    columns += [
        Written(c.name, c.unit, c.about, run.q[:, k])
        for k, c in enumerate(mechanism.coordinates)
        if k in measured
    ]
    columns += [Written(v.name, v.unit, v.about, run.nu[:, k]) for k, v in enumerate(system.quasi_velocities)]
    torque = "" if run.command.shape[1] == 0 else "law_"  # velocity drives need not supply it
    columns += [
        Written(torque + i.name, i.unit, i.about, run.tau[:, k]) for k, i in enumerate(mechanism.inputs)
    ]
    columns += [Written(f"y{k + 1}", r.unit, r.about, run.y[:, k]) for k, r in enumerate(rows)]
    columns += [Written("status", "", "of the tick", run.status)]
    columns += [
        Written(f"use_{name.replace(' ', '_')}", "1", f"friction use, {name}", use)
        for name, use in run.use.items()
    ]
    filtered = zip(system.quasi_velocities, records["rate"].T, strict=True)
    columns += [Written(f"seen_{v.name}", v.unit, f"filtered: {v.about}", rate) for v, rate in filtered]
    columns += [
        Written(f"desired_y{k + 1}", r.unit, f"desired {r.about}", run.y_d[:, k]) for k, r in enumerate(rows)
    ]
    driven = system.quasi_velocities if torque else mechanism.inputs
    columns += [
        Written(f"command_{d.name}", "", "to the drive", records["command"][:, k])
        for k, d in enumerate(driven)
    ]
    columns += [Written("piece", "", "segment of the path, from 0", run.piece)]
    columns += [
        Written(
            "watchdog",
            "",
            "run, hold or stop",
            [_watchdog(number) for number in records["watchdog"].tolist()],
        )
    ]
    columns += [
        Written(f"counter_{k + 1}", "", "counter of the encoder", records["counts"][:, k]) for k in range(2)
    ]
    columns += [Written("tick", "", "number of the tick", records["tick"])]
    return [*columns, Written("missed", "", "ticks left out before this one", records["missed"])]


def _watchdog(number: int) -> str:
    return WATCHDOG[number % 256] if number % 256 < len(WATCHDOG) else "unknown"
