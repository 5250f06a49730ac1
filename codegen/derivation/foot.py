"""The law in the frame of the foot of P_l on the path: it reads the group FOOT instead of the vehicle's
position and heading.

If the dynamics of a vehicle do not depend on its position and heading, the law depends on the path only
through the distance, the relative heading and the curvature at the foot. One law then serves all segments,
and computes no sine or cosine.
"""

from dataclasses import replace

import casadi as ca

from ...model.algebra.exact import canonical
from ...model.algebra.expression import fold, operate
from ...model.law import ControlLaw
from ...model.outputs import FOOT, body_offsets
from ...model.vehicle import point_on_body, required_point
from .stages import Result, Stages, inner_velocities, staged

DISTANCE, COSINE, SINE, CURVATURE = (q.symbol for q in FOOT)


def at_foot_of(law: ControlLaw) -> tuple[Result, ...]:
    """Return the quantities that are derived as functions of FOOT."""
    return (Result.COMMAND if law.kinematic else Result.INPUTS, Result.SLOPE, Result.SINGULAR, Result.REGULAR)


def has_foot_form(law: ControlLaw) -> bool:
    """Whether FOOT describes the path, and the vehicle's dynamics do not depend on its position and heading.

    The dynamics, the other outputs and the motion in the vehicle's frame are examined; on an inclined plane,
    for example, they depend on the heading.
    """
    if law.output.at_foot is None or law.system.mechanism.carried:
        return False
    point, inner = point_on_body(law.system), inner_velocities(law.system)[0]
    if point is None:
        return False
    vehicle, place = law.system.mechanism.required_vehicle, law.system.mechanism.q[list(point.pose)]
    x_rate, y_rate, turning = (inner.along_motion(part) for part in ca.vertsplit(place))
    cosine, sine = ca.cos(vehicle.heading), ca.sin(vehicle.heading)
    motion = [cosine * x_rate + sine * y_rate, cosine * y_rate - sine * x_rate, turning]
    others = [row.expression for row in law.output.rows if row.through is None]
    dynamics = (
        [] if law.kinematic else [ca.vec(inner.Mbar), inner.bias, ca.vec(inner.input_map), inner.preferred]
    )
    return not ca.depends_on(canonical(ca.vertcat(*dynamics, *others, *motion)), place)


def place_names(law: ControlLaw) -> frozenset[str]:
    """Return the names of the coordinates that FOOT replaces."""
    point = point_on_body(law.system)
    return frozenset(law.system.mechanism.coordinates[k].name for k in point.pose) if point else frozenset()


def staged_at_foot(law: ControlLaw) -> Stages:
    """Return the steps of the quantities `at_foot_of` the law as functions of FOOT; see `staged`."""
    stages = staged(law, law.output.at_foot)
    heading = law.system.mechanism.required_vehicle.heading
    stages.steps = [replace(step, expression=_with_foot(step.expression, heading)) for step in stages.steps]
    given = (*at_foot_of(law), *([Result.BAND] if stages.near else []))
    stages.quantities = {name: _with_foot(stages.quantities[name], heading) for name in given}
    stages.near = {name: _with_foot(stages.near[name], heading) for name in at_foot_of(law) if stages.near}
    return stages


def plain_at_foot(law: ControlLaw, quantity: ca.SX) -> ca.SX:
    """Return a quantity of the reference law as a function of FOOT: the path is placed at the foot,
    along x."""
    point, config = required_point(law.system), {q.name: q.symbol for q in law.config}
    x, y, heading = ca.vertsplit(law.system.mechanism.q[list(point.pose)])
    ahead, left = (
        offset + arm for offset, arm in zip(body_offsets(law.config), ca.vertsplit(point.arm), strict=True)
    )
    place = -ahead * COSINE + left * SINE, DISTANCE - ahead * SINE - left * COSINE
    path = law.output.required_path
    here = [
        (config[q.name], value)
        for q, value in zip(path.parameters, path.from_foot(DISTANCE, CURVATURE), strict=True)
    ]
    placed = [(x, place[0]), (y, place[1]), *here]
    moved = ca.substitute([quantity], *[[ca.SX(one) for one in side] for side in zip(*placed, strict=True)])[
        0
    ]
    return _with_foot(moved, heading)


def _with_foot(expression: ca.SX, heading: ca.SX) -> ca.SX:
    """Return the expression with the cosine and sine of the heading replaced by those of FOOT."""
    symbols = ca.symvar(expression)

    def apply(code: int, arguments: tuple[ca.SX, ...]) -> ca.SX:
        if code in (ca.OP_COS, ca.OP_SIN) and ca.is_equal(arguments[0], heading):
            return COSINE if code == ca.OP_COS else SINE
        return operate(code, *arguments)

    entries = fold(expression, symbols, lambda k: symbols[k], ca.SX, apply)
    return ca.reshape(ca.vertcat(*entries), expression.shape) if entries else expression
