"""C of the follower of a vehicle: odometry, path, law, limits, motors or velocity commands, and watchdog, in
one struct.

The vehicle has two driven wheels, or one that rolls and a steered wheel.
"""

import re
from collections.abc import Iterable, Sequence
from typing import Any

import casadi as ca

from ...model.algebra.exact import canonical
from ...model.errors import ModelError
from ...model.law import ControlLaw
from ...model.mechanism import Quantity
from ...model.reduction import ReducedSystem
from ...model.vehicle import point_ahead, point_on_body, required_velocity_map, steered_axle
from ...readers.templates import render
from ..graph import Graph, Group, Leaf, Node, from_casadi
from ..printing.layout import WIDTH, aside, body, fill, table
from ..printing.program_c import init_given
from ..printing.scalar import Scalar
from ..printing.statements import Statements

NAME = "follower"
LAW = "type_iv_segment"
ANGLE = "angle"  # the steering angle in the functions of the follower


def is_followers(law: ControlLaw) -> bool:
    """Return whether a law is that of a follower, of lines and arcs, and its vehicle has the wheels of one.

    The vehicle has two driven wheels, or a driven and a steered one (SteeredAxle): the quasi-velocities are
    their rates, on which the two inputs act. Forward speed and yaw rate of two driven wheels must be fixed
    combinations of the rates.
    """
    return law.name == LAW and not law.extension and _has_wheels(law.system) and not _unknown(law.system)


def why_no_follower(system: ReducedSystem) -> str:
    """Return why there is no follower for any law of a robot that has none."""
    why = system.mechanism.why_carried or "it is not a vehicle with two driven wheels or a steered one"
    if _has_wheels(system) and (unknown := _unknown(system)):
        why = f"its motion depends on {', '.join(c.name for c in unknown)}, which no wheel shows"
    elif not system.mechanism.carried and _has_wheels(system):
        why = (
            "its law, or the load on its wheels, depends on position or heading, of which a follower knows "
            "those to a path"
        )
    return f"{system.mechanism.name}: {why}"


def _has_wheels(system: ReducedSystem) -> bool:
    mechanism = system.mechanism
    if len(mechanism.inputs) != 2 or {q.unit for q in system.quasi_velocities} != {"rad/s"}:
        return False
    if not canonical(system.input_map - ca.SX.eye(2)).is_zero():
        return False
    if steered_axle(system):
        return True
    try:
        point_ahead(system)
    except ModelError:
        return False
    return bool(placed_names(system))


def _unknown(system: ReducedSystem) -> list[Quantity]:
    """Return the coordinates on which the motion depends and that are neither the pose nor the angle of a
    wheel, as trailers'."""
    pose, angles = placed_names(system), [k for places in system.coordinates_by_velocity for k in places]
    motion = ca.vertcat(ca.vec(system.Mbar), system.bias, ca.vec(system.input_map))
    others = [c for k, c in enumerate(system.mechanism.coordinates) if c.in_c not in pose and k not in angles]
    return [c for c in others if ca.depends_on(motion, c.symbol)]


def follower_files(law: ControlLaw, scalar: Scalar, banner: Sequence[str]) -> dict[str, str]:
    """Return file name -> text of header and source of the follower for a law that has one."""
    system = law.system
    robot = system.mechanism.name
    own = scalar.name(f"{robot}_{NAME}")
    values = {
        "robot": robot,
        "law": f"{robot}_{law.name}",
        "own": scalar.name,
        "real": scalar.real,
        "suffix": scalar.suffix,
        "banner": banner,
        "inputs": system.mechanism.inputs,
        "wheels": measured_names(system),
        "state": [q.in_c for q in system.state],
        "params": [q.in_c for q in system.mechanism.parameters],
        "coordinates": len(system.mechanism.coordinates),
        "place": placed_names(system),
        "gains": [q.in_c for q in law.gains],
        "literal": scalar.literal,
        **_kinematics(system, scalar),
    }
    texts = {f"{own}.{kind}": render(__file__, f"follower.{kind}", **values) for kind in "hc"}
    return {name: fitted(text) for name, text in texts.items()}


MEMBER = re.compile(r"    (\S.*;)(?: +/\* (.*) \*/)?$")


def fitted(text: str) -> str:
    """Return C with its lines broken to the width, and the comments of each struct in a column."""
    return "\n".join(_fitted(text.split("\n")))


def _fitted(lines: Iterable[str]) -> list[str]:
    fitted: list[str] = []
    members: list[tuple[str, str]] | None = None
    for line in lines:
        found = MEMBER.match(line) if members is not None else None
        if members is not None and found:
            members.append((found[1], found[2] or ""))
            continue
        fitted += table(members) if members else []
        members = [] if line.startswith("typedef struct") else None
        alone = line.startswith("/* ") and len(line) > WIDTH
        if alone:
            fitted += aside(line.removeprefix("/* ").removesuffix(" */"), WIDTH)
        else:
            fitted += fill(line, "") if len(line) > WIDTH else [line]
    return fitted


def measured_names(system: ReducedSystem) -> list[str]:
    """Return the members of the state with the filtered rates of the wheels."""
    return [q.in_c for q in system.quasi_velocities]


def placed_names(system: ReducedSystem) -> list[str]:
    """Return the members of the state that are position and heading of the vehicle's body or its fixed axle;
    none without one."""
    mechanism, steered, point = system.mechanism, steered_axle(system), point_on_body(system)
    body = steered or point
    return [mechanism.coordinates[k].in_c for k in body.pose] if body else []


def _kinematics(system: ReducedSystem, scalar: Scalar) -> dict[str, Any]:
    """Return what the templates need to know of how the wheels move the vehicle."""
    steered = steered_axle(system)
    if steered is None:
        places = [
            "wheels->forward[0]",
            "wheels->forward[1]",
            "wheels->turn[0]",
            "wheels->turn[1]",
            "wheels->ahead",
        ]
        found = ca.vertcat(ca.vec(required_velocity_map(system).T), point_ahead(system))
        point = point_on_body(system)
        arm = (
            _assigned(system, scalar, ["arm[0]", "arm[1]"], point.arm)
            if point and not point.arm.is_zero()
            else ""
        )
        return {
            "steering": False,
            "each": "",
            "odometry": _assigned(system, scalar, places, found),
            "arm": arm,
        }
    moves, turns = (
        [f"{name}[{k}]" for name in ("forward", "turn") for k in range(2)],
        ["moved[0]", "moved[1]"],
    )
    return {
        "steering": True,
        "arm": "",
        "each": "[2]",
        "steers": steered.steers,
        "rolls": 1 - steered.steers,
        "angle": system.mechanism.coordinates[system.mechanism.coordinate_numbers([steered.angle])[0]].in_c,
        "reach": _assigned(system, scalar, ["reach"], steered.reach),
        "moved": _assigned(system, scalar, turns, steered.moved, steered.angle),
        "motion": _assigned(system, scalar, moves, ca.vec(steered.motion.T), steered.angle),
    }


def _assigned(
    system: ReducedSystem, scalar: Scalar, places: Sequence[str], values: ca.SX, angle: ca.SX | None = None
) -> str:
    """Return the statements that assign values in `params`, and in the steering `angle`, to places.

    With an angle they leave the function with NOSLIP_SINGULAR where a value is not defined.
    """
    graph = Graph()
    parameters = system.mechanism.parameters
    nodes = [graph.leaf(Group.PARAMS, q.name) for q in parameters]
    symbols = [q.symbol for q in parameters]
    if angle is not None:
        nodes.append(graph.leaf(Group.STATE, ANGLE))
        symbols.append(angle)

    def given(node: Node) -> str | None:
        return ANGLE if isinstance(node, Leaf) and node.group is Group.STATE else init_given(node)

    def guard(condition: str) -> str:
        return f"if ({condition}) {{\n    return NOSLIP_SINGULAR;\n}}"

    roots: list[Node] = [row[0] for row in from_casadi(graph, values, symbols, nodes, system.mechanism.name)]
    writer = Statements(scalar, given, {}, None if angle is None else guard)
    writer.plan(roots)
    for place, node in zip(places, roots, strict=True):
        writer.assign(place, node)
    return body(writer.lines)
