"""Functions beyond sine and cosine: what a robot's file may use, its C beside CasADi,
and what is refused where it is written."""

from functools import cache, partial

import casadi as ca
import mpmath
import numpy as np
import pytest
from noslip.codegen.files import law_program, robot_files
from noslip.codegen.graph import FROM_CASADI, FUNCTIONS, Graph, from_casadi
from noslip.codegen.program import EntryBody, compile_law, hidden_inputs
from noslip.model import Mechanism, control_law
from noslip.model.algebra.operations import SUPPORTED, kinks
from noslip.model.errors import ModelError
from noslip.model.outputs import output_map, type_iv
from noslip.model.paths import implicit
from noslip.model.reduction import reduce
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot
from noslip.simulation.controllers.compiled import CompiledController
from noslip.simulation.controllers.symbolic import CasadiController
from noslip.tests.codegen_tools import evaluate, random_leaves, relative_error

EXACT = 1e-35  # of numbers with 50 digits
DOUBLE, FLOAT = 1e-12, 2e-4  # of the largest quantity; found are 2e-14 and 2e-6
EPSILON = 1e-6  # between a state and one beside it

SMOOTH = {
    "tanh": lambda x, y: ca.tanh(3 * x + y),
    "exp": lambda x, y: ca.exp(-x * x) * y,
    "log": lambda x, y: ca.log(1 + x * x) + y,
    "atan": lambda x, y: ca.atan(x - 2 * y),
    "atan2": lambda x, y: ca.atan2(x, 1 + y * y),
    "asin": lambda x, y: ca.asin(ca.sin(x) / 2) + y,
    "acos": lambda x, y: ca.acos(ca.cos(y) / 2) * x,
    "sinh": lambda x, y: ca.sinh(x / 2) - y,
    "cosh": lambda x, y: ca.cosh(x / 2) * y,
    "tan": lambda x, y: ca.tan(x / 4) + y,
    "power": lambda x, y: (1 + x * x) ** 1.25 + y,
    "root": lambda x, y: (2 + x) ** -0.75 * y,
    "hypot": lambda x, y: ca.hypot(x, 1 + y),
}
BENT = {
    "fabs": lambda x, y: ca.fabs(x) * (2 + y),
    "fmin": lambda x, y: ca.fmin(x, y / 2) + 2 * x,
    "fmax": lambda x, y: ca.fmax(x, 0.1) ** 2 + y,
}
JUMPING = {
    "sign": lambda x, y: ca.sign(x),
    "sign of a multiple": lambda x, y: ca.sign(-3 * x) * ca.fabs(-2 * y),
    "if_else": lambda x, y: ca.if_else(x > y, x * x, -y),
    "both": lambda x, y: ca.if_else(ca.logic_and(x > 0, y <= 0.3), x, 2),
    "either": lambda x, y: ca.if_else(ca.logic_or(x >= 0, ca.logic_not(y < 0.3)), x, 2),
    "equal": lambda x, y: ca.if_else(ca.sign(x) == 1, y, 3) + ca.if_else(ca.sign(y) != 1, x, 1),
}


def rover(name: str, force=None, rows=None, preferred=0.0) -> Mechanism:
    """A unicycle with a force of forward speed and yaw rate on each motion; `rows`:
    an output map of its own."""
    robot = Mechanism(name, "a unicycle with friction")
    x, y, heading = robot.coordinate("x", "m"), robot.coordinate("y", "m"), robot.coordinate("heading", "rad")
    m, inertia = robot.parameter("m", 12.0, "kg"), robot.parameter("I_z", 0.8, "kg m^2")
    c = robot.parameter("c", 1.5, "N")
    forward, turn = ca.cos(heading) * robot.rate(x) + ca.sin(heading) * robot.rate(y), robot.rate(heading)
    robot.kinetic_energy(m * (robot.rate(x) ** 2 + robot.rate(y) ** 2) / 2 + inertia * turn**2 / 2)
    robot.rolls("no side slip", ca.cos(heading) * robot.rate(y) - ca.sin(heading) * robot.rate(x))
    if force is not None:
        robot.force(-c * force(forward, turn), on=forward)
        robot.force(-c * force(turn, forward), on=turn)
    robot.input("push", "N", on=forward)
    robot.input("turn", "N m", on=turn, preferred=preferred)
    robot.quasi_velocity("v", "m/s", forward)
    robot.quasi_velocity("omega", "rad/s", turn)
    robot.moves_in_plane(x, y, heading)
    if rows is not None:
        robot.output("own", "", [("a", "m", rows(x, heading)), ("b", "rad", rows(heading, y))])
    return robot


def law_of(robot: Mechanism, name: str):
    system = reduce(robot)
    return control_law(system, output_map(system, name))


def numbers(law) -> list[list[float]]:
    """Defaults, with P_l ahead of the axle."""
    values = [[q.default for q in law.groups[g]] for g in ("params", "config", "gains")]
    values[1] = [0.3 if q.name == "L" else q.default for q in law.config]
    return values


def states(count: int = 40):
    random = np.random.default_rng(7)
    return random.uniform(-1.2, 1.2, (count, 5)), random.uniform(-1, 1, (count, 6))


def agree(law) -> None:
    """The C, in both precisions, beside CasADi at random states;
    and the steps beside the model's own expressions, exactly."""
    controllers = [CompiledController(law, *numbers(law), scalar=scalar) for scalar in ("double", "float")]
    truth = CasadiController(law, *numbers(law))
    compared = 0
    for state, reference in zip(*states(), strict=True):
        right = truth.evaluate(state, reference[: len(law.reference)])
        for controller, tolerance in zip(controllers, (DOUBLE, FLOAT), strict=True):
            own = controller.evaluate(state, reference[: len(law.reference)])
            if "ok" != own.status:
                assert own.status == right.status
                continue
            compared += 1
            for quantity in ("h", "ydot", "Phi", "Phidot", "u", "tau"):
                size = max(1.0, np.abs(right.values[quantity]).max())
                assert (
                    np.abs(own.values[quantity].ravel() - right.values[quantity].ravel()).max()
                    <= tolerance * size
                ), quantity
    assert compared > 40
    short, plain = law_program(law), compile_law(law, optimize=False)
    for entry, body in plain.entries.items():
        values = [
            evaluate(
                program.entries[entry].roots[len(b.singular) + (b.margin is not None) :], random_leaves(3)
            )
            for program, b in ((short, short.entries[entry]), (plain, body))
        ]
        assert relative_error(*values) <= EXACT, entry.name


@pytest.mark.parametrize("name", [*SMOOTH, *BENT, *JUMPING])
def test_in_a_force(name):
    """Coulomb's sign has a derivative of zero wherever it has one: nothing may take it for a constant."""
    force = {**SMOOTH, **BENT, **JUMPING}[name]
    agree(law_of(rover("braked", force), "type_i"))


@pytest.mark.parametrize("name", [*SMOOTH, *BENT])
def test_in_outputs(name):
    """Phi, Phidot and the drift have first and second derivatives."""
    agree(law_of(rover("seen", rows={**SMOOTH, **BENT}[name]), "own"))


@pytest.mark.parametrize("name", ["tanh", "power", "atan2", "fabs"])
def test_in_a_path(name):
    system = reduce(rover("led"))
    curve = lambda x, y: y - {**SMOOTH, **BENT}[name](x, ca.SX(0.25))  # noqa: E731
    agree(control_law(system, type_iv(system, implicit("odd", "odd", (), curve))))


def test_in_the_dynamics():
    """The plant's C beside the model's own bias."""
    from noslip.codegen.dynamics import compile_dynamics

    def force(x, y):
        return sum((each(x, y) for each in {**SMOOTH, **BENT, **JUMPING}.values()), start=ca.SX(0))

    system = reduce(rover("braked", force))
    plain, short = compile_dynamics(system, optimize=False), compile_dynamics(system)
    files = robot_files(system, [], ("double", "float"))
    assert '#include "noslip_functions.h"' in files["braked_dynamics.c"]
    leaf, biases = random_leaves(11), {}
    for program in (plain, short):
        entry = next(e for e in program.entries if e.name == "evaluate")
        body, values = program.entries[entry], {}
        value = partial(lambda values, node: values[node] if node in values else leaf(node), values)
        for step in body.steps:
            (values[step.leaf],) = evaluate([step.node], value)
        biases[program] = evaluate([node for row in body.quantities["bias"] for node in row], value)
    symbols = [*system.mechanism.parameters, *system.state]
    groups = ["params"] * len(system.mechanism.parameters) + ["state"] * len(system.state)
    bias = ca.Function("bias", [ca.vertcat(*[q.symbol for q in symbols])], [system.bias])
    truth = np.asarray(
        bias([float(leaf_value(leaf, g, q.name)) for g, q in zip(groups, symbols, strict=True)])
    ).ravel()
    assert relative_error(biases[plain], biases[short]) <= EXACT
    assert np.abs(truth - np.array([float(v) for v in biases[short]])).max() <= DOUBLE * np.abs(truth).max()


def leaf_value(leaf, group: str, name: str) -> mpmath.mpf:
    return leaf(Graph().leaf(group, name))


# -- outside a domain ----------------------------------------------------------------------------------------

OUTSIDE = {  # a force of the forward speed that has no value at some speed
    "log": (lambda x, y: ca.log(x), -0.5),
    "log of zero": (lambda x, y: ca.log(x), 0.0),
    "asin": (lambda x, y: ca.asin(x), 1.5),
    "acos": (lambda x, y: ca.acos(x), -1.5),
    "sqrt": (lambda x, y: ca.sqrt(x), -0.5),
    "power": (lambda x, y: x**1.3, -0.5),
    "exp": (lambda x, y: ca.exp(x * 100), 8.0),
    "within a maximum": (lambda x, y: ca.fmax(ca.log(x), 1), -0.5),
    "within a minimum": (lambda x, y: ca.fmin(1, ca.log(x)), -0.5),
    "within a condition": (lambda x, y: ca.if_else(ca.log(x) > 0, 1, 2), -0.5),
    "within a sign": (lambda x, y: ca.sign(ca.log(x)), -0.5),
    "within tanh": (lambda x, y: ca.tanh(ca.asin(x)), 1.5),
    "within atan2": (lambda x, y: ca.atan2(ca.log(x), ca.log(x)), -0.5),
    "within not": (
        lambda x, y: ca.if_else(ca.logic_not(ca.logic_or(ca.log(x) == 1, ca.log(x) < 0)), 1, 2),
        -0.5,
    ),
}


@cache
def astray(name: str):
    force, _ = OUTSIDE[name]
    return law_of(rover("astray", lambda x, y: force(x, y) if "turn" not in str(x) else y), "type_i")


@pytest.mark.parametrize("scalar", ["double", "float"])
@pytest.mark.parametrize("name", OUTSIDE)
def test_outside_a_domain_is_a_status(name, scalar):
    law, (_, speed) = astray(name), OUTSIDE[name]
    controller = CompiledController(law, *numbers(law), scalar=scalar)
    state, reference = np.array([1.0, 0.5, 0.4, speed, 0.3]), np.arange(6) / 7
    status, tau = controller.step(state, reference)
    assert (
        status == "nonfinite"
        and not tau.any()
        and controller.evaluate(state, reference).status == "nonfinite"
    )
    state[3:] = 0.4, 0.5
    assert controller.step(state, reference)[0] == "ok"


def test_what_is_not_chosen_need_not_exist():
    law = law_of(rover("careful", lambda x, y: ca.if_else(x > 0, ca.log(x), y)), "type_i")
    controller = CompiledController(law, *numbers(law))
    assert controller.step(np.array([1.0, 0.5, 0.4, -0.5, 0.3]), np.zeros(6))[0] == "ok"


@pytest.mark.parametrize("hides", [f for f in FUNCTIONS if f != "if"])
def test_a_bounded_function_hides_its_argument(hides):
    graph = Graph()
    x, y = graph.leaf("state", "x"), graph.leaf("state", "y")
    node = graph.apply(hides, *((x, y) if hides in ("pow", "atan2", "min", "max", "less") else (x,)))
    assert x in hidden_inputs(EntryBody({"tau": [[node]]}, ()))


def test_an_angle_that_is_checked_shows_its_arguments():
    """The difference of two headings is in range only if both are finite;
    what a quotient divides by may be infinite."""
    graph = Graph()
    x, y, z = (graph.leaf("state", name) for name in "xyz")
    angle = graph.apply("sub", x, graph.apply("div", y, z))
    assert hidden_inputs(EntryBody({"tau": [[graph.apply("cos", angle)]]}, ())) == [z]


@pytest.mark.parametrize("value", [np.inf, -np.inf, np.nan])
def test_an_infinite_reference_in_tanh_is_noticed(value):
    law = law_of(rover("calm", lambda x, y: ca.tanh(x)), "type_i")
    controller = CompiledController(law, *numbers(law))
    for k in (3, 4):
        state = np.array([1.0, 0.5, 0.4, 0.2, 0.3])
        state[k] = value
        status, tau = controller.step(state, np.zeros(6))
        assert status == "nonfinite" and not tau.any()


# -- what is refused, and where ------------------------------------------------------------------------------


def test_every_supported_operation_has_c():
    assert SUPPORTED == FROM_CASADI.keys()
    graph, symbols = Graph(), ca.vertsplit(ca.SX.sym("x", 2))
    leaves = [graph.leaf("state", "x"), graph.leaf("state", "y")]
    for force in {**SMOOTH, **BENT, **JUMPING}.values():  # and so have their derivatives
        expression = ca.SX(force(*symbols))
        every = ca.vertcat(expression, ca.vec(ca.hessian(expression, ca.vertcat(*symbols))[0]))
        assert from_casadi(graph, every, symbols, leaves, "")


def test_kinks():
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    assert kinks(ca.fabs(x) + ca.sign(y), x) == ["fabs"] and kinks(ca.tanh(x), x) == []
    assert (
        kinks(ca.if_else(x > 1, y, 2), x) == ["<", "if_else", "not"]
        and kinks(ca.if_else(x > 1, y, 2), ca.SX()) == []
    )


HEAD = """import casadi as ca
from noslip.model import Mechanism, config


def robot():
    r = Mechanism("made")
    x, y, z = r.coordinate("x", "m"), r.coordinate("y", "m"), r.coordinate("z", "rad")
    p = r.parameter("p", 1.0, "kg")
"""
REFUSED = {  # a definition, and what is said of it
    "r.kinetic_energy(ca.floor(x) * r.rate(x)**2)": "kinetic energy: floor is not supported",
    "r.kinetic_energy(ca.sign(x) * r.rate(x)**2)": "kinetic energy: uses sign, which jumps",
    "r.kinetic_energy(r.rate(x)**2 + ca.fabs(r.rate(y)))": "kinetic energy uses fabs of a rate",
    "r.potential_energy(p * ca.erf(x))": "potential energy: erf is not supported",
    "r.potential_energy(ca.if_else(x > 0, x, 0))": "potential energy: uses <, which jumps",
    "r.potential_energy(p * x**y)": "potential energy: the exponent of a power must be a constant",
    "r.potential_energy(p * 2**x)": "potential energy: the exponent of a power must be a constant",
    "r.potential_energy(p * x**-40.5)": "the exponent of a power must be a constant between -32 and 32",
    "r.potential_energy(x / 0.0 * ca.DM(0) + ca.SX(float('inf')))": "potential energy: contains inf",
    "r.force(ca.fmod(x, 2), on=r.rate(x))": "force: fmod is not supported",
    "r.force(1, on=r.rate(x) + ca.sign(r.rate(x)))": "force's velocity: uses sign, which jumps",
    "r.rolls('edge', ca.copysign(r.rate(x), x))": "constraint 'edge': copysign is not supported",
    "r.rolls('edge', r.rate(x) + ca.sign(r.rate(y)))": "constraint 'edge': uses sign, which jumps",
    "r.rolls('edge', ca.fmax(r.rate(x), 0))": "constraint 'edge' uses fmax of a rate",
    "r.holds('edge', ca.ceil(x))": "constraint 'edge': ceil is not supported",
    "r.input('u', 'N', on=ca.asinh(x) * r.rate(x))": "input 'u': asinh is not supported",
    "r.input('u', 'N', on=r.rate(x), preferred=ca.floor(x))": "input 'u', preferred: floor is not supported",
    "r.input('u', 'N', on=r.rate(x), weight=ca.floor(p))": "input 'u', weight: floor is not supported",
    "r.quasi_velocity('v', 'm/s', ca.atanh(x) * r.rate(x))": "quasi-velocity 'v': atanh is not supported",
    "r.null_space(ca.vertcat(ca.floor(x), 1, 1), {'v': 'm/s'})": "S: floor is not supported",
    "r.moves_in_plane(x, y, ca.floor(z))": "the vehicle's heading: floor is not supported",
    "r.contact('tip', p, along=ca.floor(x) * r.rate(x))": "contact 'tip', velocity: floor is not supported",
    "r.output('o', '', [('a', 'm', ca.floor(x))])": "output 'o', a: floor is not supported",
    "r.output('o', '', [('a', 'm', ca.sign(x))])": "output 'o', a: uses sign, which jumps",
    "r.rolls('edge', r.rate(y - ca.floor(x)))": "rate of an expression: uses floor, which jumps",
    "r.kinetic_energy(p * r.rate(ca.if_else(x > 0, x, 0))**2)": "rate of an expression: uses <, which jumps",
    "r.body('b', p, p, ca.floor(x) * r.rate(x), r.rate(y), "
    "r.rate(z))": "body 'b', forward: floor is not supported",
}


@pytest.mark.parametrize("line", REFUSED)
def test_refused_where_it_is_written(line, tmp_path):
    """File, line, what and what to use instead, in one line."""
    file = tmp_path / "robots.py"
    file.write_text(f"{HEAD}    {line}\n    return r\n")
    with pytest.raises(BadInput) as error:
        find_robot(f"{file}:robot")
    text = str(error.value)
    assert (
        text.startswith(f"{file}:{HEAD.count(chr(10)) + 1}: made: ")
        and REFUSED[line] in text
        and "\n" not in text
    )


def test_a_force_may_jump_and_nothing_else():
    rover("free", lambda x, y: ca.sign(x), preferred=ca.if_else(ca.SX.sym("x") > 0, 1, 2))
    with pytest.raises(ModelError, match="jumps"):
        rover("free", rows=lambda x, y: ca.sign(x))
