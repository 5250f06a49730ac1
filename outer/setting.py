"""The steady motion that a SPEC, or a law with its defaults, asks for."""

import math
from dataclasses import replace

import numpy as np

from ..model.law import ControlLaw
from ..model.mechanism import values_of
from ..model.names import TYPE
from ..model.outputs import OFFSET
from ..readers.errors import BadInput
from ..readers.robots import find_robot
from ..simulation.loop import make_loop
from ..simulation.specification.spec import Initial, Output, Path, Reference, Simulation, Spec
from ..verification.cases import gain_entries, integral_entries
from .motion import Setting, path_frame

SPEED = 1.0  # m/s, where nothing else is said
KINDS = ("line", "circle", "segment")  # paths of constant curvature


def default_spec(robot: str, law: ControlLaw, speed: float = SPEED) -> Spec:
    """A SPEC of the law with the defaults of robot, path and gains, following at a speed (m/s); Types I to III along x or y.

    Raises BadInput for an output of the robot's own: where it is regular, no default tells.
    """
    if not law.name.startswith(TYPE):
        raise BadInput(f"{law.name} is the robot's own output: say with --spec SPEC.toml where the robot is and what is wanted")
    config = {c.name: c.default for c in law.config}
    L, W = config.pop("L"), config.pop("W", 0.0)
    if law.output.path:
        output = Output(type="IV", L=L, W=W, path=Path(kind=law.output.path.kind, parameters=config))
        reference = Reference(speed=speed)
    else:
        output = Output(type=law.name.removesuffix(OFFSET).removeprefix("type_").upper(), L=L, W=W)
        position = (0.0, math.pi / 2 if output.type == "III" else 0.0)
        reference = Reference(position=position, velocity=(speed, 0.0))
    initial, simulation = _on_the_way(output, reference), Simulation(duration=10.0, backend="casadi")
    return Spec(robot=robot, output=output, reference=reference, initial=initial, simulation=simulation)


def setting_of(spec: Spec) -> Setting:
    """The numbers of the SPEC's loop, its start moved onto the way. Raises BadInput where nothing there moves steadily."""
    path = spec.output.path
    if path is not None and path.kind not in KINDS:
        raise BadInput(
            f"[output] path of kind {path.kind}: its curvature changes, there is no steady motion; take {', '.join(KINDS)}"
        )
    if spec.sensors or spec.limits:
        spec = replace(spec, sensors=None, correction=None, limits=None)
    spec = replace(spec, simulation=replace(spec.simulation, backend="casadi"))
    given = _setting(spec)
    if spec.output.own:  # the steady motion is looked for near the start
        return given
    initial = _on_the_way(spec.output, spec.reference, spec.initial)
    moved = _setting(replace(spec, initial=initial))
    if path is None or _along(given) == _along(moved):
        return moved
    opposite = replace(spec, initial=replace(initial, heading=(initial.heading or 0.0) + math.pi))
    return _setting(opposite)


def _setting(spec: Spec) -> Setting:
    """The numbers of the SPEC's loop as it is. Raises BadInput as `make_loop` does."""
    loop = make_loop(spec)
    law, ki = loop.law, integral_entries(loop.law, spec.gains)
    return Setting(
        law=law,
        true=loop.plant.parameters,
        believed=np.array(find_robot(spec.robot).parameter_values(spec.parameters)),
        config=loop.guidance.leg.config,
        gains=np.array(values_of(list(law.gains), gain_entries(law, spec.gains, "gains"), "gains")),
        reference=loop.guidance.reference(0.0, loop.start),
        start=loop.start,
        integral=tuple(ki.get(f"ki_{row.name}", 0.0) for row in law.output.rows),
    )


def _along(setting: Setting) -> bool:
    """Does the vehicle head along the path's direction, or against it?"""
    direction = setting.law.at_state(path_frame(setting.law)[1])
    return float(direction(setting.start, setting.believed, setting.config)) > 0


def _on_the_way(output: Output, reference: Reference, initial: Initial | None = None) -> Initial:
    """A start on the path or the reference, heading along it, at the wanted speed; at rest with the heading of `initial`."""
    if output.path is None:
        return _with_the_reference(output.type, reference, initial)
    p = output.path.parameters
    if output.path.kind == "line":
        square = p["A"] ** 2 + p["B"] ** 2 or 1.0  # no line at all is refused later, with the reason
        point, heading = (-p["A"] * p["C"] / square, -p["B"] * p["C"] / square), math.atan2(p["A"], -p["B"])
    elif output.path.kind == "circle":
        point, heading = (p["x_f"] + p["R"], p["y_f"]), math.pi / 2
    elif output.path.kind == "segment":
        point, heading = (p["x_s"], p["y_s"]), p["direction"]
    else:  # refused later, with the reason
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


def with_speed(spec: Spec, speed: float) -> Spec:
    """The SPEC at another speed, m/s: of its path, or of its reference, which keeps its direction."""
    if spec.output.type == "IV":
        return replace(spec, reference=replace(spec.reference, speed=speed))
    velocity = np.array(spec.reference.velocity or (0.0, 0.0))
    if not velocity.any():
        raise BadInput("[reference] velocity is zero: it has no direction in which to go at --speed")
    return replace(spec, reference=replace(spec.reference, velocity=tuple(speed * velocity / np.linalg.norm(velocity))))
