"""The numbers of a vehicle in a follower's project, and its drive along its path in a test,
without hardware."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from ...model.law import ControlLaw
from ...model.segments import Segment
from ...model.vehicle import steered_axle
from ...readers.templates import render
from ..derivation.grip import can_grip
from ..follower.follower import placed_names
from ..printing.scalar import DOUBLE, Scalar
from .plant import PlantC

IN_A_LINE = 8  # names of columns


@dataclass(frozen=True)
class VelocityDrives:
    """Drives whose own loop follows velocities: `omega` (1/s),
    largest acceleration of each wheel (rad/s^2)."""

    omega: float
    acceleration: Sequence[float]


@dataclass(frozen=True)
class FloorNumbers:
    """What is known of the floor: friction, the part of the weight on the robot's contacts,
    height of the centre of mass (m)."""

    mu: float
    share: float
    height: float


@dataclass(frozen=True)
class NoiseNumbers:
    """Normal noise of the two wheels' rates, rad/s, drawn anew every `period` (s; 0: at every tick)."""

    seed: int
    mean: Sequence[float]
    deviation: Sequence[float]
    period: float


@dataclass(frozen=True)
class VehicleNumbers:
    """What a follower and its drive are given, SI.

    `config`: members of the follower's config by name, but for its segments: numbers, names of C, lists, and
    mappings by member. `plant`: the true parameters, `start`: [q; nu] at t = 0, both by member. `late`: the
    time from a tick until its command moves the robot, as whole periods and the rest (s). `integrals`: which
    of distance and speed have integral action. A row is recorded every `output_step`, s; `tolerance` is that
    of the robot's motion, relative and absolute. `assumed`: for the reader, which numbers are assumptions,
    and `warnings`.
    """

    config: Mapping[str, Any]
    segments: Sequence[Segment]
    plant: Mapping[str, float]
    start: Mapping[str, float]
    duration: float
    output_step: float
    tolerance: float = 1e-8
    late: tuple[int, float] = (0, 0.0)
    drives: VelocityDrives | None = None
    floor: FloorNumbers | None = None
    noise: NoiseNumbers | None = None
    integrals: Sequence[int] = ()
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
    return VehicleNumbers(config, [line], plant, {}, 15.0, 0.01, assumed=["all numbers: put in yours"])


def vehicle_files(law: ControlLaw, scalar: Scalar, vehicle: VehicleNumbers) -> dict[str, str]:
    """Return file name -> text of the config, and of the drive that tests it."""
    system, mechanism = law.system, law.system.mechanism
    state = [q.in_c for q in system.state]
    contacts = [each.name for each in mechanism.standing] if vehicle.floor else []
    placed = {
        name: state.index(name)
        for name in (*placed_names(system), *(v.in_c for v in system.quasi_velocities))
    }
    made, names = PlantC(law, vehicle.drives is not None), columns(law, vehicle)
    values = {
        "robot": mechanism.name,
        "own": scalar.name,
        "real": scalar.real,
        "exact": DOUBLE.literal,
        "members": {name: initializer(value, scalar) for name, value in _present(vehicle.config).items()},
        "segments": [initializer(asdict(segment), scalar) for segment in vehicle.segments],
        "count": len(vehicle.segments),
        "counts": _numbers(vehicle.config["counts_per_turn"]),
        "period": vehicle.config["period"],
        "duration": vehicle.duration,
        "output_step": vehicle.output_step,
        "rows": math.ceil(vehicle.duration / vehicle.output_step - 1e-9),
        "tolerance": vehicle.tolerance,
        "late": vehicle.late,
        "made": made,
        "parameters": [p.in_c for p in mechanism.parameters],
        "plant": initializer(vehicle.plant, DOUBLE)[1:-1],
        "start": _numbers(vehicle.start.get(name, 0.0) for name in state),
        "state": state,
        "inputs": [i.in_c for i in mechanism.inputs],
        "forces": len(mechanism.constraint_names),
        "angles": [places[0] for places in system.coordinates_by_velocity],
        "placed": placed,
        "config": [c.name for c in law.config],
        "places": [_numbers(place) for place in places(law, vehicle.segments, vehicle.config["path"]["L"])],
        "drives": vehicle.drives is not None,
        "omega": vehicle.drives.omega if vehicle.drives else 0.0,
        "most": _numbers(vehicle.drives.acceleration) if vehicle.drives else [],
        "noise": vehicle.noise,
        "mean": _numbers(vehicle.noise.mean) if vehicle.noise else [],
        "deviation": _numbers(vehicle.noise.deviation) if vehicle.noise else [],
        "contacts": contacts,
        "mu": vehicle.floor.mu if vehicle.floor else 0.0,
        "loads": made.loads(vehicle.floor.share, vehicle.floor.height) if vehicle.floor else "",
        "earned": "believed_mu" in names,
        "columns": [",".join(names[k : k + IN_A_LINE]) for k in range(0, len(names), IN_A_LINE)],
        "integrals": vehicle.integrals,
        "assumed": vehicle.assumed,
    }
    files = {"vehicle.h": "vehicle.h", "vehicle.c": "vehicle.c", "selftest/drive.c": "drive.c"}
    return {file: render(__file__, template, **values) for file, template in files.items()}


def columns(law: ControlLaw, vehicle: VehicleNumbers) -> list[str]:
    """Return the names of the columns that a drive prints: those of `noslip simulate` for the same
    vehicle."""
    system, outputs = law.system, law.output.rows
    mechanism, state = system.mechanism, [q.name for q in system.state]
    grips = can_grip(system) and "friction" in vehicle.config.get("limits", {})
    return [
        *("t", *state, *(i.name for i in mechanism.inputs)),
        *(*(f"y{k + 1}" for k in range(len(outputs))), "status"),
        *(f"lambda_{k + 1}" for k in range(len(mechanism.constraint_names))),
        *(f"use_{each.name.replace(' ', '_')}" for each in mechanism.standing if vehicle.floor),
        *(f"seen_{name}" for name in state),
        *(f"integral_{outputs[k].name}" for k in vehicle.integrals),
        *(f"command_{v.name}" for v in system.quasi_velocities if vehicle.drives),
        *(["believed_mu"] if grips else []),
        "piece",
    ]


def places(law: ControlLaw, segments: Sequence[Any], L: Sequence[float]) -> list[list[float]]:
    """Return the configuration of the law on each segment; `L` (m) is that of driving forward,
    and in reverse."""
    rows = [
        {"L": L[bool(s.backward)], "x_s": s.x, "y_s": s.y, "direction": s.heading, "curvature": s.curvature}
        for s in segments
    ]
    return [[float(row[c.name]) for c in law.config] for row in rows]


def _numbers(values: Iterable[float]) -> list[str]:
    return [DOUBLE.literal(float(value)) for value in values]


def initializer(value: Any, scalar: Scalar) -> str:
    """Return a value as the initializer of a C object: lists and mappings in braces,
    without members that are zero."""
    if isinstance(value, Mapping):
        members = [f".{name} = {initializer(each, scalar)}" for name, each in _present(value).items()]
        return f"{{{', '.join(members) or '0'}}}"
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
