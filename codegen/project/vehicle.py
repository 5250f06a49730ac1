"""The numbers of a vehicle in a follower's project, and its drive along its path with the dynamics as the floor."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from ...model.law import ControlLaw
from ...model.segments import Segment
from ...model.vehicle import steered_axle
from ...readers.templates import render
from ..printing.scalar import Scalar

STEPS = 10  # of the plant, by Runge and Kutta's method of order 4, in a period


@dataclass(frozen=True)
class VelocityDrives:
    """Drives whose own loop follows velocities: `omega` (1/s), `delay` (s), largest acceleration of each wheel (rad/s^2)."""

    omega: float
    delay: float
    acceleration: Sequence[float]


@dataclass(frozen=True)
class VehicleNumbers:
    """What a follower and its drive are given, SI.

    `config`: members of the follower's config by name, but for its segments: numbers, names of C, lists, and mappings by
    member. `plant`: the true parameters, `start`: [q; nu] at t = 0, both by member. `delay` (s) from a tick until its
    command reaches the drives, less than a period. `assumed`: for the reader, which numbers are assumptions, and `warnings`.
    """

    config: Mapping[str, Any]
    segments: Sequence[Segment]
    plant: Mapping[str, float]
    start: Mapping[str, float]
    duration: float
    delay: float = 0.0
    drives: VelocityDrives | None = None
    assumed: Sequence[str] = field(default_factory=tuple)
    warnings: Sequence[str] = field(default_factory=tuple)


def example(law: ControlLaw) -> VehicleNumbers:
    """Return numbers that a user replaces: a line of 5 m, from rest beside it."""
    steered = steered_axle(law.system) is not None
    fastest = {"fastest": (20.0, 5.0), "steering": 1.0} if steered else {"fastest": 20.0}
    config = {
        "period": 0.01,
        "counts_per_turn": (40000.0, 40000.0),
        "counter_bits": 16,
        **fastest,
        "path": {"speed": 0.5, "deceleration": 0.4, "L": (0.25, 0.25)},
        "astray": 0.3,
        "gains": {q.in_c: q.default for q in law.gains},
        "limits": {"limit": (1.0, 1.0), "on_limit": "NOSLIP_SLOW"},
        "watchdog": {"tolerated": 3, "forgiven": 100, "stuck": 50},
    }
    plant = {p.in_c: p.default for p in law.parameters}
    line = Segment(0.0, 0.0, 0.0, 0.0, 5.0)
    return VehicleNumbers(config, [line], plant, {}, 15.0, assumed=["all numbers: put in yours"])


def vehicle_files(law: ControlLaw, scalar: Scalar, vehicle: VehicleNumbers) -> dict[str, str]:
    """Return file name -> text of the config, and of the drive that tests it."""
    system = law.system
    coordinates = [q.in_c for q in system.mechanism.coordinates]
    angles = [system.mechanism.coordinates[places[0]].in_c for places in system.coordinates_by_velocity]
    period = vehicle.config["period"]
    lag = vehicle.delay + (vehicle.drives.delay if vehicle.drives else 0.0)
    values = {
        "robot": system.mechanism.name,
        "own": scalar.name,
        "real": scalar.real,
        "literal": scalar.literal,
        "members": {name: initializer(value, scalar) for name, value in _present(vehicle.config).items()},
        "counts": initializer(vehicle.config["counts_per_turn"], scalar),
        "segments": [initializer(asdict(segment), scalar) for segment in vehicle.segments],
        "count": len(vehicle.segments),
        "plant": initializer(vehicle.plant, scalar),
        "start": initializer(vehicle.start, scalar),
        "coordinates": coordinates,
        "velocities": [q.in_c for q in system.quasi_velocities],
        "angles": angles,
        "inputs": [i.in_c for i in system.mechanism.inputs],
        "drives": vehicle.drives is not None,
        "omega": scalar.literal(vehicle.drives.omega) if vehicle.drives else "",
        "most": initializer(list(vehicle.drives.acceleration), scalar) if vehicle.drives else "",
        "assumed": vehicle.assumed,
        "steps": STEPS,
        "ticks": math.ceil(vehicle.duration / period - 1e-9),
        "late": round(lag / period * STEPS),
    }
    names = {"vehicle.h": "vehicle.h", "vehicle.c": "vehicle.c", "selftest/drive.c": "drive.c"}
    return {file: render(__file__, template, **values) for file, template in names.items()}


def initializer(value: Any, scalar: Scalar) -> str:
    """Return a value as the initializer of a C object: lists and mappings in braces, without members that are zero."""
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'.{name} = {initializer(each, scalar)}' for name, each in _present(value).items()) or '0'}}}"
    if isinstance(value, int):
        return str(int(value))
    if isinstance(value, str):
        return value
    if isinstance(value, float):
        return scalar.literal(value)
    return f"{{{', '.join(initializer(each, scalar) for each in value)}}}"


def _present(members: Mapping[str, Any]) -> dict[str, Any]:
    """Return the members that are not zero."""
    return {name: value for name, value in members.items() if value}
