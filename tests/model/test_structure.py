"""What is decided by the structure of an expression, for functions whose derivatives vanish almost
everywhere."""

import itertools
import math
from collections.abc import Callable
from fractions import Fraction

import casadi as ca
import numpy as np
import pytest
from casadi import cos, fabs, floor, fmax, fmin, sign, sin
from noslip.cli.main import main
from noslip.codegen.graph import Applied, Constant, Graph, Group, Leaf, Operation, reachable
from noslip.codegen.program import compile_law
from noslip.model import Mechanism, ModelError, control_law, reduce
from noslip.model.algebra.exact import canonical
from noslip.model.algebra.expression import degree
from noslip.model.algebra.ratios import exact
from noslip.model.outputs import output_map
from noslip.model.reduction import ReducedSystem
from noslip.model.robots import ROBOTS
from noslip.tests.codegen_tools import evaluate, in_c, random_leaves, relative_error

DEGREES = {
    "number": (lambda v, a: ca.SX(3), 0),
    "other symbol": (lambda v, a: sin(a) / a, 0),
    "linear": (lambda v, a: sin(a) * v / a - 2 * v, 1),
    "square": (lambda v, a: (v + a) ** 2, 2),
    "cube": (lambda v, a: v**3 - v, 3),
    "sixth": (lambda v, a: (v * v * a) ** 3, 6),
    "coefficient by cases": (lambda v, a: ca.if_else(a > 0, v, 2 * v), 1),
    "size": (lambda v, a: fabs(v), math.inf),
    "size in a product": (lambda v, a: v * fabs(v), math.inf),
    "direction": (lambda v, a: v + sign(v), math.inf),
    "step": (lambda v, a: floor(v), math.inf),
    "larger": (lambda v, a: fmax(v, 0), math.inf),
    "smaller": (lambda v, a: fmin(v, a), math.inf),
    "comparison": (lambda v, a: ca.if_else(v > 0, v, 2 * v), math.inf),
    "quotient": (lambda v, a: a / v, math.inf),
    "root": (lambda v, a: ca.sqrt(v), math.inf),
    "power of a symbol": (lambda v, a: v**a, math.inf),
}


@pytest.mark.parametrize("name", DEGREES)
def test_degree(name):
    build, expected = DEGREES[name]
    v, a = ca.SX.sym("v"), ca.SX.sym("a")
    assert degree(build(v, a), v) == expected


def sledge(act: Callable[[Mechanism, ca.SX, ca.SX], object] = lambda *_: None) -> Mechanism:
    """A blade that is pushed and turned, its outputs forward speed and yaw rate; `act` changes it."""
    robot = Mechanism("sledge")
    x, y, phi = robot.coordinate("x", "m"), robot.coordinate("y", "m"), robot.coordinate("phi", "rad")
    m, inertia = robot.parameter("m", 3.0, "kg"), robot.parameter("I_z", 0.4, "kg m^2")
    rate = robot.rate
    robot.kinetic_energy(m * (rate(x) ** 2 + rate(y) ** 2) / 2 + inertia * rate(phi) ** 2 / 2)
    forward = cos(phi) * rate(x) + sin(phi) * rate(y)
    robot.rolls("blade", cos(phi) * rate(y) - sin(phi) * rate(x))
    robot.input("push", "N", on=forward)
    robot.input("turn", "N m", on=rate(phi))
    robot.quasi_velocity("v", "m/s", forward)
    robot.quasi_velocity("omega", "rad/s", rate(phi))
    robot.output("speeds", "", [("speed", "m/s", forward), ("yaw", "rad/s", rate(phi))])
    act(robot, forward, rate(phi))
    return robot


DAMPERS = {
    "by direction": lambda v, w: -6 * v - 4 * fabs(v),
    "quadratic": lambda v, w: -2 * v * fabs(v),
    "of two motions": lambda v, w: -3 * fabs(v + w / 4) + v * w,
    "of the squares": lambda v, w: -ca.sqrt(v**2 + w**2) * v,
}


@pytest.mark.parametrize("name", DAMPERS)
def test_forces_that_are_no_polynomial_stay_in_the_law(name):
    """The law in steps is the plain law, and the reduced equations have the force that the robot was
    given."""
    system = reduce(sledge(lambda robot, v, w: robot.force(DAMPERS[name](v, w), on=v)))
    law = control_law(system, output_map(system, "speeds"))
    plain, staged = (compile_law(law, optimize=each) for each in (False, True))
    for seed in range(5):
        leaf = random_leaves(seed)
        for (entry, body), truth in zip(staged.entries.items(), plain.entries.values(), strict=True):
            for quantity, matrix in body.quantities.items():
                ours, expected = ([n for row in m for n in row] for m in (matrix, truth.quantities[quantity]))
                assert relative_error(evaluate(ours, leaf), evaluate(expected, leaf)) <= 1e-30, (
                    entry.name,
                    quantity,
                )
    forces = ca.Function("forces", [system.mechanism.q, system.nu], [system.bias])
    for *q, v, w in np.random.default_rng(5).normal(size=(20, 5)):
        expected = [-float(DAMPERS[name](ca.DM(v), ca.DM(w))), 0.0]
        assert np.allclose(
            forces(q, [v, w]).full().ravel(), expected, rtol=0, atol=1e-12 * (1 + abs(expected[0]))
        )


REFUSED = {
    "kinetic energy with a corner": (
        lambda robot, v, w: robot.kinetic_energy(fabs(v)),
        "sledge: kinetic energy uses fabs of a rate; it must be a polynomial in the rates",
    ),
    "kinetic energy with a step": (
        lambda robot, v, w: robot.kinetic_energy(floor(v)),
        "kinetic energy: floor is not supported",
    ),
    "constraint with a step": (
        lambda robot, v, w: robot.rolls("ratchet", w + sign(w)),
        "constraint 'ratchet': uses sign, which jumps",
    ),
    "input on a step": (
        lambda robot, v, w: robot.input("more", "N", on=v + floor(v)),
        "input 'more': floor is not supported",
    ),
    "force on a step": (
        lambda robot, v, w: robot.force(1, on=v + floor(v)),
        "force's velocity: floor is not supported",
    ),
    "output of a step": (
        lambda robot, v, w: robot.output("other", "", [("steps", "m/s", floor(v)), ("yaw", "rad/s", w)]),
        "output 'other', steps: floor is not supported",
    ),
    "output that is flat": (
        lambda robot, v, w: robot.output(
            "other", "", [("fast", "m/s", fmax(v - 50, 0)), ("yaw", "rad/s", w)]
        ),
        "row 'fast' depends on the quasi-velocities, but its derivative by them vanishes",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused(name):
    act, message = REFUSED[name]
    with pytest.raises(ModelError) as error:
        system = reduce(sledge(act))
        control_law(system, output_map(system, "other"))
    assert message in str(error.value) and "\n" not in str(error.value)


# -- decimals ------------------------------------------------------------------------------------------------

NUMBERS = {
    0.2: Fraction(1, 5),
    0.1 * 2: Fraction(1, 5),
    0.1 + 0.2: Fraction(3, 10),
    1 / 3: Fraction(1, 3),
    -2 / 7: Fraction(-2, 7),
    1e-10: Fraction(1, 10**10),
    0.123456 * 7.89012: Fraction(123456 * 789012, 10**11),
    1e300: Fraction(10**300),
    math.pi: Fraction("3.141592653589793"),
}


@pytest.mark.parametrize("value", NUMBERS)
def test_numbers_that_are_meant(value):
    number = exact(value)  # of SymPy's type for rational numbers, which depends on what is installed
    assert (number.numerator, number.denominator) == (NUMBERS[value].numerator, NUMBERS[value].denominator)


def test_numbers_come_back_to_the_last_bit():
    """What is simplified beside a number leaves it as it is."""
    x = ca.SX.sym("x")
    random = np.random.default_rng(54)
    values = [
        *NUMBERS,
        *random.uniform(-1, 1, 200),
        *(10 ** random.uniform(-12, 12, 200)),
        *random.integers(1, 99, 50) / 7,
    ]
    for value in map(float, values):
        for simplified in (canonical(value * (x + 1) - value), canonical(value * x)):
            assert ca.Function("f", [x], [simplified])(1.0) == value, value


def numeric(name: str, change: Callable[[float], float], monkeypatch: pytest.MonkeyPatch) -> ReducedSystem:
    """A shipped robot that is written with plain numbers for its parameters."""
    with monkeypatch.context() as patch:
        patch.setattr(Mechanism, "parameter", lambda self, name, default, *_: ca.SX(change(default)))
        return reduce(ROBOTS[name]())


WRITTEN = {
    "short": lambda x: x,
    "long": lambda x: round(1.0371593 * x, 6),
    "computed": lambda x: x * math.pi / 3,
}


@pytest.mark.parametrize("written", WRITTEN)
@pytest.mark.parametrize("name", ["knife_edge", "car", "tricycle"])
def test_plain_numbers_give_the_law_of_parameters(name, written, monkeypatch):
    """The same torques, and constants of the size of what they are made of,
    so that float has no overflow and no zeros."""
    change = WRITTEN[written]
    by_name = reduce(ROBOTS[name]())
    values = [change(p.default) for p in by_name.mechanism.parameters]
    system = numeric(name, change, monkeypatch)
    truth, law = (control_law(each, output_map(each, "type_i")) for each in (by_name, system))
    body = next(body for entry, body in compile_law(law).entries.items() if entry.name == "step")
    roots = [node for row in body.quantities["tau"] for node in row]
    constants = {abs(node.value) for node in reachable(body.roots) if isinstance(node, Constant)} - {0.0}
    assert 1e-14 <= min(constants) and max(constants) <= 1e6
    groups = ("config", "gains", "state", "reference")
    expected = ca.Function(
        "tau",
        [ca.vertcat(*[q.symbol for q in truth.groups[group]]) for group in ("params", *groups)],
        [truth.tau],
    )
    for seed in range(5):
        leaf = random_leaves(seed)
        values_of_groups = [
            [float(leaf(Leaf(0, (), Group(group), q.name))) for q in truth.groups[group]] for group in groups
        ]
        torques = expected(values, *values_of_groups).full().ravel()
        double, single = (
            np.array(
                evaluate(
                    roots,
                    lambda node: kind(leaf(node)),  # noqa: B023
                    kind,
                    in_c(kind, lambda a: (math.sin(a), math.cos(a))),
                )
            )
            for kind in (np.float64, np.float32)
        )
        assert np.abs(double - torques).max() <= 1e-9 * np.abs(torques).max()
        assert np.abs(single - torques).max() <= 1e-3 * np.abs(torques).max()


@pytest.mark.parametrize("scalar", [np.float32, np.float64])
def test_powers_of_two_that_meet_are_one(scalar):
    """To the last bit, and none of them is left where they make 1."""
    graph, functions = Graph(), in_c(scalar, lambda angle: (math.sin(angle), math.cos(angle)))
    x, y = graph.leaf("state", "x"), graph.leaf("state", "y")
    powers = [graph.constant(c) for c in (0.5, 2, 0.25, 4, -8)]
    small = [x, *powers] + [
        graph.make(Applied, pair, Operation.MUL) for c in powers for pair in ((x, c), (c, y))
    ]
    values = {x: scalar(1.2345678), y: scalar(-7.6543211)}
    for operation in (Operation.MUL, Operation.DIV):
        for pair in itertools.product(small, small):
            simple, written = graph.apply(operation, *pair), graph.make(Applied, pair, operation)
            a, b = evaluate([simple, written], values.__getitem__, scalar, functions)
            assert a == b, (operation, pair)
    assert (
        graph.apply(Operation.MUL, graph.apply(Operation.MUL, graph.constant(0.5), x), graph.constant(2)) is x
    )


def test_a_number_that_no_float_can_hold_is_refused_with_its_line(tmp_path, capsys):
    text = (
        "from casadi import cos, sin\nfrom noslip.model import Mechanism\n\n\ndef heavy():\n    robot = "
        "Mechanism('heavy')\n    x, y, phi = robot.coordinate('x', 'm'), robot.coordinate('y', 'm'), "
        "robot.coordinate('phi', 'rad')\n    rate = robot.rate\n    robot.kinetic_energy(1e45 * (rate(x) ** "
        "2 + rate(y) ** 2) / 2 + rate(phi) ** 2)\n    robot.rolls('blade', cos(phi) * rate(y) - sin(phi) * "
        "rate(x))\n    robot.input('F', 'N', on=cos(phi) * rate(x) + sin(phi) * rate(y))\n    "
        "robot.input('T', 'N m', on=rate(phi))\n    robot.output('o', '', [('v', 'm/s', cos(phi) * rate(x) + "
        "sin(phi) * rate(y)), ('w', 'rad/s', rate(phi))])\n    return robot\n"
    )
    file = tmp_path / "robot.py"
    file.write_text(text)
    assert main(["generate", f"{file}:heavy", "-o", str(tmp_path / "c")]) == 2
    error = capsys.readouterr().err
    assert f"{file}:5: " in error and "does not fit into a float" in error and len(error.splitlines()) == 1
    assert main(["generate", f"{file}:heavy", "-o", str(tmp_path / "c"), "--scalar", "double"]) == 0
