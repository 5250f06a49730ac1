"""The steady motion of a SPEC, or of a law with its defaults."""

import math
from dataclasses import replace

import numpy as np

from ...codegen.loop.stages import check
from ...model.law import ControlLaw
from ...model.mechanism import values_of
from ...model.names import LawName
from ...model.outputs import BAND
from ...readers.errors import BadInput
from ...readers.robots import find_robot
from ...simulation.loop import axle_at, make_loop
from ...simulation.specification.cases import gain_entries, integral_entries, observer_entries
from ...simulation.specification.spec import (
    DriveSection,
    Initial,
    OutputSection,
    PathSection,
    Reference,
    Simulation,
    Spec,
)
from .motion import Setting, path_frame

SPEED = 1.0  # m/s, default
BANDWIDTH, PERIOD = 5.0, 0.01  # Hz and s, of a kinematic law in a SPEC that does not say


def default_spec(robot: str, law: ControlLaw, speed: float = SPEED) -> Spec:
    """Return a SPEC of the law with the defaults of robot, path and gains, at a speed (m/s); Types I to III
    along x or y.

    Raises BadInput for an output map of the robot's own, since no default pose is known to be regular.
    """
    name = LawName.parse(law.name)
    if name is None:
        raise BadInput(
            f"{law.name} is the robot's own output: give the pose and the reference in a SPEC, with --spec "
            "SPEC.toml"
        )
    if name.path == "course":
        raise BadInput(f"{law.name} has no default course: give one in a SPEC, with --spec SPEC.toml")
    config = {c.name: c.default for c in law.config}
    L = axle_at(law, {}) if name.extended else config.pop("L")
    W, extension = config.pop("W", 0.0), name.extended
    near, band = "damped" if name.damped else "refuse", config.pop("band", BAND)
    if law.output.path:
        path = PathSection(kind=law.output.path.kind, parameters=config)
        output = OutputSection(
            type="IV", L=L, W=W, near_singular=near, band=band, extension=extension, path=path
        )
        reference = Reference(speed=speed)
    else:
        output = OutputSection(type=name.type, L=L, W=W, extension=extension)
        position = (0.0, math.pi / 2 if output.type == "III" else 0.0)
        reference = Reference(position=position, velocity=(speed, 0.0))
    initial, simulation = _on_the_way(output, reference), Simulation(duration=10.0, backend="casadi")
    spec = Spec(robot=robot, output=output, reference=reference, initial=initial, simulation=simulation)
    return as_kinematic(spec, BANDWIDTH) if law.kinematic else spec


def as_kinematic(spec: Spec, bandwidth: float) -> Spec:
    """Return the SPEC with the kinematic law of its outputs, behind drives with a bandwidth (Hz)."""
    simulation = replace(spec.simulation, period=spec.simulation.period or PERIOD)
    return replace(spec, drive=DriveSection(kind="kinematic", bandwidth=bandwidth), simulation=simulation)


def setting_of(spec: Spec) -> Setting:
    """Return the numbers of the SPEC's loop, with its start moved onto the path. Raises BadInput if there is
    no steady motion."""
    check(spec, "noslip outer-loop")
    path = spec.output.path
    if spec.sensors or spec.limits or spec.drive:
        spec = replace(
            spec, sensors=None, correction=None, limits=None, drive=spec.drive if spec.kinematic else None
        )
    # Only what is held is used
    called = replace(spec.simulation, backend="casadi", period=spec.simulation.period or PERIOD)
    spec = replace(spec, simulation=called)
    setting = _setting(spec)
    if spec.output.own:  # the steady motion is searched for near the start
        return setting
    initial = _on_the_way(spec.output, spec.reference, spec.initial)
    moved = _setting(replace(spec, initial=initial))
    if path is None or _along(setting) == _along(moved):
        return moved
    opposite = replace(spec, initial=replace(initial, heading=(initial.heading or 0.0) + math.pi))
    return _setting(opposite)


def _setting(spec: Spec) -> Setting:
    """Return the numbers of the SPEC's loop. Raises BadInput as `make_loop` does."""
    loop = make_loop(spec)
    law, ki, ko = loop.law, integral_entries(loop.law, spec.gains), observer_entries(loop.law, spec.gains)
    return Setting(
        law=law,
        true=loop.plant.parameters,
        believed=np.array(find_robot(spec.robot).parameter_values(spec.parameters)),
        config=loop.guidance.leg.config,
        gains=np.array(values_of(list(law.gains), gain_entries(law, spec.gains, "gains"), "gains")),
        reference=loop.guidance.reference(0.0, loop.start),
        start=loop.start,
        integral=tuple(ki.get(f"ki_{row.name}", 0.0) for row in law.output.rows),
        observer=tuple(ko.get(f"ko_{row.name}", 0.0) for row in law.output.rows),
    )


def _along(setting: Setting) -> bool:
    """Return whether the vehicle heads along the path's direction or against it."""
    direction = setting.law.at_state(path_frame(setting.law)[1])
    state = np.append(setting.start, np.zeros(len(setting.law.extension)))
    return float(direction(state, setting.believed, setting.config)) > 0


def _on_the_way(output: OutputSection, reference: Reference, initial: Initial | None = None) -> Initial:
    """Return a start on the path or the reference, heading along it, at the desired speed; at rest with the
    heading of `initial`."""
    if output.path is None:
        return _with_the_reference(output.type, reference, initial)
    p = output.path.parameters
    if output.path.kind == "line":
        # a line without direction is rejected later, with the reason
        square = p["A"] ** 2 + p["B"] ** 2 or 1.0
        point, heading = (-p["A"] * p["C"] / square, -p["B"] * p["C"] / square), math.atan2(p["A"], -p["B"])
    elif output.path.kind == "circle":
        point, heading = (p["x_f"] + p["R"], p["y_f"]), math.pi / 2
    elif output.path.kind == "segment":
        point, heading = (p["x_s"], p["y_s"]), p["direction"]
    else:  # rejected later, with the reason
        point, heading = (0.0, 0.0), 0.0
    return Initial(point=point, heading=heading, speed=reference.speed)


def _with_the_reference(kind: str, reference: Reference, initial: Initial | None) -> Initial:
    position, velocity = reference.position or (0.0, 0.0), reference.velocity or (0.0, 0.0)
    if kind == "I":
        still = initial.heading or 0.0 if initial else 0.0
        heading = math.atan2(*velocity[::-1]) if any(velocity) else still
        return Initial(point=position, heading=heading, speed=math.hypot(*velocity))
    place, heading = position
    part = math.cos(heading) if kind == "II" else math.sin(heading)
    point = (place, 0.0) if kind == "II" else (0.0, place)
    return Initial(point=point, heading=heading, speed=velocity[0] / part if part else 0.0)


def on_tightest(spec: Spec) -> Spec:
    """Return the SPEC on the tightest segment of its composite path, without its end;
    another SPEC as it is."""
    if not spec.output.segments or spec.output.path is None:
        return spec
    tightest = max(spec.output.segments, key=lambda segment: abs(segment.curvature))
    place = {
        "x_s": tightest.x,
        "y_s": tightest.y,
        "direction": tightest.heading,
        "curvature": tightest.curvature,
    }
    output = replace(spec.output, path=PathSection(kind=spec.output.path.law, parameters=place))
    reference = replace(spec.reference, deceleration=None, creep=None)
    return replace(spec, output=output, reference=reference, initial=_on_the_way(output, reference))


def with_speed(spec: Spec, speed: float) -> Spec:
    """Return the SPEC with another speed, m/s: along its path, or of its reference in the same direction."""
    if spec.output.type == "IV":
        return replace(spec, reference=replace(spec.reference, speed=speed))
    velocity = np.array(spec.reference.velocity or (0.0, 0.0))
    if not velocity.any():
        raise BadInput("[reference] velocity is zero: it has no direction in which to go at --speed")
    return replace(
        spec, reference=replace(spec.reference, velocity=tuple(speed * velocity / np.linalg.norm(velocity)))
    )
