"""The law in the frame of P_l's foot on the path: what the path tells (FOOT) in place of the vehicle's position and heading.

A vehicle that moves alike wherever it stands and whichever way it points needs no more of a path than is to be seen from the
foot: one law for all pieces, and no sine or cosine where something else has taken them already.
"""

from dataclasses import replace

import casadi as ca

from ...model.algebra.exact import canonical
from ...model.algebra.expression import fold, operate
from ...model.law import ControlLaw
from ...model.outputs import FOOT, body_offsets
from .stages import Result, Stages, inner_velocities, staged

AT_FOOT = (Result.INPUTS, Result.SLOPE, Result.SINGULAR, Result.REGULAR)  # the quantities that there are by FOOT
DISTANCE, COSINE, SINE, CURVATURE = (q.symbol for q in FOOT)


def has_foot_form(law: ControlLaw) -> bool:
    """Is there a path that FOOT describes, and a vehicle that moves alike wherever it stands and whichever way it points?

    A slope, for one, is not the same in all directions. What its dynamics, its other outputs and its motion, seen from itself,
    depend on is looked at.
    """
    if law.output.at_foot is None:
        return False
    vehicle, inner = law.system.mechanism.required_vehicle, inner_velocities(law.system)[0]
    place = ca.vertcat(vehicle.x, vehicle.y, vehicle.heading)
    if not all(part.is_symbolic() for part in ca.vertsplit(place)):
        return False
    x_rate, y_rate, turning = (inner.along_motion(part) for part in ca.vertsplit(place))
    cosine, sine = ca.cos(vehicle.heading), ca.sin(vehicle.heading)
    motion = [cosine * x_rate + sine * y_rate, cosine * y_rate - sine * x_rate, turning]
    others = [row.expression for row in law.output.rows if row.through is None]
    dynamics = ca.vertcat(ca.vec(inner.Mbar), inner.bias, ca.vec(inner.input_map), inner.preferred, *others, *motion)
    return not ca.depends_on(canonical(dynamics), place)


def place_names(law: ControlLaw) -> frozenset[str]:
    """The coordinates that a law which is told the foot does without."""
    vehicle = law.system.mechanism.required_vehicle
    return frozenset(str(part) for part in (vehicle.x, vehicle.y, vehicle.heading))


def staged_at_foot(law: ControlLaw) -> Stages:
    """As `staged`, by FOOT, of the quantities AT_FOOT."""
    stages = staged(law, law.output.at_foot)
    heading = law.system.mechanism.required_vehicle.heading
    stages.steps = [replace(step, expression=_told(step.expression, heading)) for step in stages.steps]
    stages.quantities = {name: _told(stages.quantities[name], heading) for name in AT_FOOT}
    return stages


def plain_at_foot(law: ControlLaw, quantity: ca.SX) -> ca.SX:
    """A quantity of the law as the model has it, by FOOT: with the path put where the foot is, along x."""
    vehicle, config = law.system.mechanism.required_vehicle, {q.name: q.symbol for q in law.config}
    ahead, left = body_offsets(law.config)
    place = -ahead * COSINE + left * SINE, DISTANCE - ahead * SINE - left * COSINE
    path = law.output.required_path
    here = [(config[q.name], value) for q, value in zip(path.parameters, path.from_foot(DISTANCE, CURVATURE), strict=True)]
    told = [(vehicle.x, place[0]), (vehicle.y, place[1]), *here]
    moved = ca.substitute([quantity], *[[ca.SX(one) for one in side] for side in zip(*told, strict=True)])[0]
    return _told(moved, vehicle.heading)


def _told(expression: ca.SX, heading: ca.SX) -> ca.SX:
    """The expression with FOOT's cosine and sine of the heading."""
    symbols = ca.symvar(expression)

    def apply(code: int, arguments: tuple[ca.SX, ...]) -> ca.SX:
        if code in (ca.OP_COS, ca.OP_SIN) and ca.is_equal(arguments[0], heading):
            return COSINE if code == ca.OP_COS else SINE
        return operate(code, *arguments)

    entries = fold(expression, symbols, lambda k: symbols[k], ca.SX, apply)
    return ca.reshape(ca.vertcat(*entries), expression.shape) if entries else expression
