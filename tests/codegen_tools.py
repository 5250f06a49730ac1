"""Evaluates expression graphs apart from any C: exactly (in mpmath),
or rounded as C in double or float rounds."""

import random
from collections.abc import Callable, Mapping, Sequence
from functools import cache

import mpmath
import numpy as np
from casadi import cos, sin
from noslip.codegen.graph import Applied, Constant, Group, Leaf, Node, Operation, reachable
from noslip.model import Mechanism, OutputMap, OutputRow, control_law
from noslip.model.outputs import OUTPUTS, at_point, body_point, type_iv
from noslip.model.paths import config, implicit
from noslip.model.reduction import ReducedSystem, reduce

mpmath.mp.dps = 50

EXACT = {
    **{
        "sqrt": mpmath.sqrt,
        "sin": mpmath.sin,
        "cos": mpmath.cos,
        "abs": abs,
        "exp": mpmath.exp,
        "log": mpmath.log,
    },
    **{
        "sinh": mpmath.sinh,
        "cosh": mpmath.cosh,
        "tanh": mpmath.tanh,
        "pow": mpmath.power,
        "atan2": mpmath.atan2,
    },
    **{
        "atan": mpmath.atan,
        "asin": mpmath.asin,
        "acos": mpmath.acos,
        "sign": mpmath.sign,
        "min": min,
        "max": max,
    },
    **{
        "less": lambda a, b: mpmath.mpf(a < b),
        "not": lambda a: mpmath.mpf(not a),
        "if": lambda a, b: b if a else mpmath.mpf(0),
    },
}


def evaluate(
    roots: Sequence[Node], leaf: Callable[[Node], object], number=mpmath.mpf, functions: Mapping = EXACT
) -> list:
    """The roots' values."""
    value: dict[Node, object] = {}
    for node in reachable(roots):
        a = [value[argument] for argument in node.arguments]
        match node:
            case Constant():
                value[node] = number(node.value)
            case Leaf():
                value[node] = leaf(node)
            case Applied(Operation.ADD):
                value[node] = a[0] + a[1]
            case Applied(Operation.SUB):
                value[node] = a[0] - a[1]
            case Applied(Operation.MUL):
                value[node] = a[0] * a[1]
            case Applied(Operation.DIV):
                value[node] = a[0] / a[1]
            case Applied(Operation.NEG):
                value[node] = -a[0]
            case Applied(operation):
                value[node] = functions[operation](*a)
    return [value[root] for root in roots]


def random_leaves(seed: int) -> Callable[[Node], mpmath.mpf]:
    """A value for every leaf, by its group and name: 0.5 to 2,
    of either sign where it is part of state or reference."""

    @cache
    def value(group: str, name: str) -> mpmath.mpf:
        source = random.Random(f"{seed} {group} {name}")
        size = source.uniform(0.5, 2)
        return mpmath.mpf(size if group in ("params", "config", "gains") else size * source.choice((-1, 1)))

    return with_foot(lambda node: value(node.group, node.name))


def with_foot(leaf: Callable[[Node], mpmath.mpf], offset: bool = False) -> Callable[[Node], mpmath.mpf]:
    """The same leaves, and the foot of the LABMATE's P_l on the arc that they describe, from the arc's
    centre.

    `offset`: whether P_l lies W to the left of the axis.
    """

    def at(group: str, name: str) -> mpmath.mpf:
        return leaf(Leaf(0, (), Group(group), name))

    def foot(name: str) -> mpmath.mpf:
        curvature, direction, heading = (
            at("config", "curvature"),
            at("config", "direction"),
            at("state", "phi"),
        )
        ahead = mpmath.mpc(at("config", "L"), at("config", "W") if offset else 0)
        point = mpmath.mpc(at("state", "x_c"), at("state", "y_c")) + ahead * mpmath.expj(heading)
        centre = (
            mpmath.mpc(at("config", "x_s"), at("config", "y_s"))
            + mpmath.mpc(0, 1) * mpmath.expj(direction) / curvature
        )
        # From the centre, or towards it where the arc turns right
        out = (point - centre) / curvature * abs(curvature)
        turned = mpmath.expj(heading) / (mpmath.mpc(0, 1) * out / abs(out))
        distance = (1 / abs(curvature) - abs(out)) * mpmath.sign(curvature)
        found = {
            "distance": distance,
            "cosine": turned.real,
            "sine": turned.imag,
            "curvature": mpmath.sign(curvature) / abs(out),
        }
        return found[name]

    return lambda node: foot(node.name) if node.group == "foot" else leaf(node)


def relative_error(values: Sequence[mpmath.mpf], truth: Sequence[mpmath.mpf]) -> float:
    """The largest difference, relative to the largest true value."""
    largest = max((abs(t) for t in truth), default=0)
    worst = max((abs(a - t) for a, t in zip(values, truth, strict=True)), default=0)
    return float(worst / largest if largest else worst)


def in_c(scalar: type, sincos: Callable[[float], tuple[float, float]]) -> dict[str, Callable]:
    """What a graph's functions are in C, `scalar` being np.float32 or np.float64."""
    return {
        "sqrt": np.sqrt,
        "abs": np.abs,
        "sin": lambda x: scalar(sincos(x)[0]),
        "cos": lambda x: scalar(sincos(x)[1]),
    }


# -- robots and laws that the LABMATE's do not cover ---------------------------------------------------------


def unicycle(name: str = "unicycle", mass: str = "m", arm: bool = False) -> Mechanism:
    """Pushed forward and turned; with an arm that turns about the same axle, n - m = 3."""
    robot = Mechanism(name, "a unicycle")
    x, y, heading = robot.coordinate("x", "m"), robot.coordinate("y", "m"), robot.coordinate("heading", "rad")
    m, inertia = robot.parameter(mass, 12.0, "kg"), robot.parameter("I_z", 0.8, "kg m^2")
    forward = cos(heading) * robot.rate(x) + sin(heading) * robot.rate(y)
    robot.kinetic_energy(
        m * (robot.rate(x) ** 2 + robot.rate(y) ** 2) / 2 + inertia * robot.rate(heading) ** 2 / 2
    )
    robot.rolls("no side slip", cos(heading) * robot.rate(y) - sin(heading) * robot.rate(x))
    robot.input("push", "N", on=forward)
    robot.input("turn", "N m", on=robot.rate(heading))
    robot.quasi_velocity("v", "m/s", forward)
    robot.quasi_velocity("omega", "rad/s", robot.rate(heading))
    if arm:
        angle, length = robot.coordinate("arm", "rad"), robot.parameter("c", 0.4, "m")
        tip = (x + length * cos(heading + angle), y + length * sin(heading + angle))
        robot.kinetic_energy(0.3 * (robot.rate(tip[0]) ** 2 + robot.rate(tip[1]) ** 2) / 2)
        robot.input("lift", "N m", on=robot.rate(angle))
        robot.quasi_velocity("arm_rate", "rad/s", robot.rate(angle))
    robot.moves_in_plane(x, y, heading)
    return robot


def wave_law(system: ReducedSystem):
    """Type IV on y = s sin(x / w), an implicit path whose slope has a sine."""
    s, w = (
        config("s", 0.7, "m", "height of the wave", "positive"),
        config("w", 1.3, "m", "length of the wave", "positive"),
    )
    return control_law(
        system,
        type_iv(system, implicit("wave", "wave", (s, w), lambda x, y: y - s.symbol * sin(x / w.symbol))),
    )


def arm_law(system: ReducedSystem):
    """Position of P_l and the arm's angle: three outputs."""
    point = body_point()
    rows = [
        at_point(system, point, "x_l", "x", lambda x, y: x),
        at_point(system, point, "y_l", "y", lambda x, y: y),
    ]
    angle = OutputRow("angle", "rad", "angle of the arm", system.mechanism.q[3])
    return control_law(system, OutputMap("arm", "position and arm", (*rows, angle), point))


@cache
def laws() -> dict[str, object]:
    """Every LABMATE law, and others: name -> law."""
    from noslip.readers.robots import find_robot, law_of

    labmate = find_robot("labmate")
    found = {name: law_of(labmate, name) for name in OUTPUTS}
    plain, armed = reduce(unicycle()), reduce(unicycle("armed", arm=True))
    return found | {
        "unicycle type_i": law_of(plain, "type_i"),
        "unicycle wave": wave_law(plain),
        "arm": arm_law(armed),
    }


NAMES = (*OUTPUTS, "unicycle type_i", "unicycle wave", "arm")
