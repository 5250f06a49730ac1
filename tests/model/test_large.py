"""Laws of robots that are not the LABMATE: dof 1 to 5, more inputs than motions, gravity, damping,
no angle, no parameter."""

import math
import re
import subprocess
from functools import cache

import casadi as ca
import numpy as np
import pytest
from casadi import cos, sin
from noslip.checks.verification.sampling import random_plants
from noslip.codegen.files import shared_files
from noslip.codegen.printing.scalar import SCALARS
from noslip.codegen.runtime import runtime_files
from noslip.model import Mechanism, ModelError, OutputMap, OutputRow, control_law, reduce
from noslip.model.algebra.direct import Direct
from noslip.model.algebra.exact import canonical
from noslip.model.algebra.linear import condition, solve, solve_symmetric
from noslip.model.law import symbols
from noslip.model.linearization import linearize
from noslip.model.outputs import at_point, body_point, type_iv
from noslip.model.paths import circle
from noslip.readers.robots import find_robot
from noslip.readers.robots import law_of as robots_law
from noslip.simulation.controllers.compiled import CompiledController, library
from noslip.simulation.controllers.controller import Limits
from noslip.simulation.controllers.runtime import runtime
from noslip.simulation.controllers.symbolic import CasadiController
from noslip.tests.runtime_c.test_runtime import FLAGS, STRICT
from scipy.optimize import brentq

# -- robots --------------------------------------------------------------------------------------------------


def row(name: str, unit: str, expression) -> OutputRow:
    return OutputRow(name, unit, name, ca.SX(expression))


def law_of(robot: Mechanism, name: str, rows, parameters=(), **more):
    return control_law(reduce(robot), OutputMap(name, name, tuple(rows), tuple(parameters), **more))


def bare():
    """No angle, no parameter, no configuration; its one output is a speed."""
    robot = Mechanism("bare", "a bead on a line")
    x, y = robot.coordinate("x", "m"), robot.coordinate("y", "m")
    robot.kinetic_energy((robot.rate(x) ** 2 + robot.rate(y) ** 2) / 2)
    robot.rolls("line", robot.rate(y) - 2 * robot.rate(x))
    robot.input("push", "N", on=robot.rate(x))
    system = reduce(robot)
    return control_law(system, OutputMap("speed", "speed", (row("speed", "m/s", 3 * system.nu[0]),)))


def sledge():
    """Holonomic, on a curve, with gravity and damping."""
    robot = Mechanism("sledge", "a sledge on a curved slope")
    x, z = robot.coordinate("x", "m"), robot.coordinate("z", "m")
    m, b, k = (
        robot.parameter("m", 3.0, "kg"),
        robot.parameter("b", 2.0, "kg/s"),
        robot.parameter("k", 0.4, "", sign="any"),
    )
    robot.kinetic_energy(m * (robot.rate(x) ** 2 + robot.rate(z) ** 2) / 2)
    robot.potential_energy(9.81 * m * z)
    robot.holds("slope", z - k * x - 0.1 * x**3)
    robot.force(-b * robot.rate(x), on=robot.rate(x))
    robot.input("push", "N", on=robot.rate(x))
    robot.quasi_velocity("v", "m/s", robot.rate(x))
    return law_of(robot, "height", [row("height", "m", x + z)])


def car(ahead: bool = True):
    """Front-steered, drive and steering torque; outputs a point ahead of the steered wheel,
    or one on the rear axle."""
    robot = Mechanism("car", "a front-steered car")
    x, y, h, s = (
        robot.coordinate(n, u) for n, u in (("x", "m"), ("y", "m"), ("heading", "rad"), ("steer", "rad"))
    )
    m, inertia, J = (
        robot.parameter("m", 500.0, "kg"),
        robot.parameter("I_z", 400.0, "kg m^2"),
        robot.parameter("J", 2.0, "kg m^2"),
    )
    length, lead = robot.parameter("l", 2.5, "m"), robot.parameter("lead", 1.0, "m")
    rate, front = robot.rate, (x + length * cos(h), y + length * sin(h))
    centre = (x + 1.2 * cos(h), y + 1.2 * sin(h))
    robot.kinetic_energy(m * (rate(centre[0]) ** 2 + rate(centre[1]) ** 2) / 2 + inertia * rate(h) ** 2 / 2)
    robot.kinetic_energy(J * rate(h + s) ** 2 / 2)
    robot.rolls("rear", cos(h) * rate(y) - sin(h) * rate(x))
    robot.rolls("front", cos(h + s) * rate(front[1]) - sin(h + s) * rate(front[0]))
    robot.input("drive", "N", on=cos(h) * rate(x) + sin(h) * rate(y))
    robot.input("torque", "N m", on=rate(s))
    robot.quasi_velocity("v", "m/s", cos(h + s) * rate(front[0]) + sin(h + s) * rate(front[1]))
    robot.quasi_velocity("steering", "rad/s", rate(s))
    place = (front[0] + lead * cos(h + s), front[1] + lead * sin(h + s)) if ahead else (x, y)
    return law_of(robot, "lead", [row("x_p", "m", place[0]), row("y_p", "m", place[1])])


def plate():
    """Three freedoms, three forces, no rolling."""
    robot = Mechanism("plate", "a plate on a table")
    x, y, z, turn = (robot.coordinate(n, u) for n, u in (("x", "m"), ("y", "m"), ("z", "m"), ("turn", "rad")))
    m, inertia, c = (
        robot.parameter("m", 2.0, "kg"),
        robot.parameter("I_z", 0.3, "kg m^2"),
        robot.parameter("c", 0.4, "m"),
    )
    rate = robot.rate
    robot.kinetic_energy(m * (rate(x) ** 2 + rate(y) ** 2 + rate(z) ** 2) / 2 + inertia * rate(turn) ** 2 / 2)
    robot.holds("on the table", z)
    ahead, left = (cos(turn) * rate(x) + sin(turn) * rate(y), cos(turn) * rate(y) - sin(turn) * rate(x))
    for name, velocity in (("f_1", ahead), ("f_2", left + c * rate(turn)), ("f_3", left - c * rate(turn))):
        robot.input(name, "N", on=velocity)
    for name, unit, velocity in (("v", "m/s", ahead), ("w", "m/s", left), ("omega", "rad/s", rate(turn))):
        robot.quasi_velocity(name, unit, velocity)
    robot.moves_in_plane(x, y, turn)
    system, point = reduce(robot), body_point(True)
    places = [
        at_point(system, point, "x_l", "x", lambda x, y: x),
        at_point(system, point, "y_l", "y", lambda x, y: y),
    ]
    return control_law(system, OutputMap("place", "place", (*places, row("angle", "rad", turn)), point))


def manipulator():
    """A platform with two links, six inputs for four motions; the end point tracks,
    the platform keeps to a circle."""
    robot = Mechanism("manipulator", "a platform with an arm")
    x, y, h = robot.coordinate("x", "m"), robot.coordinate("y", "m"), robot.coordinate("heading", "rad")
    a, b = robot.coordinate("a", "rad"), robot.coordinate("b", "rad")
    m, inertia = robot.parameter("m", 20.0, "kg"), robot.parameter("I_z", 1.5, "kg m^2")
    l_1, l_2, c = (
        robot.parameter("l_1", 0.5, "m"),
        robot.parameter("l_2", 0.4, "m"),
        robot.parameter("c", 0.3, "m"),
    )
    rate, elbow = robot.rate, (x + c * cos(h) + l_1 * cos(h + a), y + c * sin(h) + l_1 * sin(h + a))
    end = (elbow[0] + l_2 * cos(h + a + b), elbow[1] + l_2 * sin(h + a + b))
    for mass, turning, place, angle in (
        (m, inertia, (x, y), h),
        (2.0, 0.05, elbow, h + a),
        (1.0, 0.02, end, h + a + b),
    ):
        robot.kinetic_energy(
            mass * (rate(place[0]) ** 2 + rate(place[1]) ** 2) / 2 + turning * rate(angle) ** 2 / 2
        )
    robot.rolls("no side slip", cos(h) * rate(y) - sin(h) * rate(x))
    forward = cos(h) * rate(x) + sin(h) * rate(y)
    robot.input("push", "N", on=forward)
    robot.input("wheel", "N", on=forward + 0.3 * rate(h))
    for name, velocity in (("turn", rate(h)), ("shoulder", rate(a)), ("elbow", rate(b))):
        robot.input(name, "N m", on=velocity)
    robot.input("cable", "N", on=rate(a) + 0.2 * cos(b) * rate(b))
    for name, unit, velocity in (
        ("v", "m/s", forward),
        ("omega", "rad/s", rate(h)),
        ("w_a", "rad/s", rate(a)),
    ):
        robot.quasi_velocity(name, unit, velocity)
    robot.quasi_velocity("w_b", "rad/s", rate(b))
    robot.moves_in_plane(x, y, h)
    system = reduce(robot)
    path = type_iv(system, circle())
    rows = (*path.rows, row("x_e", "m", end[0]), row("y_e", "m", end[1]))
    return control_law(
        system, OutputMap("follow", "end point and path", rows, path.parameters, path.conditions, path.path)
    )


def arm(links: int):
    """A serial arm in a vertical plane, with damping; every output feels every joint,
    so that Phi has no blocks."""
    robot = Mechanism(f"arm_{links}", f"{links} links")
    joints, z = [robot.coordinate(f"q_{k}", "rad") for k in range(links)], robot.coordinate("z", "m")
    m, length, damping = (
        robot.parameter("m", 1.0, "kg"),
        robot.parameter("l", 0.5, "m"),
        robot.parameter("damping", 0.1, "N m s"),
    )
    robot.kinetic_energy(m * robot.rate(z) ** 2 / 2)
    robot.holds("in the plane", z)
    x, y, angle = 0, 0, 0
    for k, joint in enumerate(joints):
        angle = angle + joint
        x, y = x + length * cos(angle), y + length * sin(angle)
        robot.kinetic_energy(
            m * (robot.rate(x) ** 2 + robot.rate(y) ** 2) / 2 + 0.02 * robot.rate(angle) ** 2 / 2
        )
        robot.potential_energy(9.81 * m * y)
        robot.force(-damping * robot.rate(joint), on=robot.rate(joint))
        robot.input(f"tau_{k}", "N m", on=robot.rate(joint))
        robot.quasi_velocity(f"w_{k}", "rad/s", robot.rate(joint))
    rows = [row("x_e", "m", x), row("y_e", "m", y), row("angle", "rad", angle)]
    rows += [row(f"mix_{k}", "rad", joints[k] + 0.3 * sum(map(sin, joints))) for k in range(links - 3)]
    return law_of(robot, "reach", rows)


MADE = {"bare": bare, "sledge": sledge, "car": car, "plate": plate, "manipulator": manipulator}
MADE |= {"arm_4": lambda: arm(4), "arm_5": lambda: arm(5)}
each_law = pytest.mark.parametrize("name", MADE)
each_scalar = pytest.mark.parametrize("scalar", ["double", "float"])


@cache
def law(name: str):
    return MADE[name]()


@cache
def plants(name: str):
    return list(random_plants(law(name), 60, seed=3))


# -- the laws ------------------------------------------------------------------------------------------------

# of the largest entry of each quantity, at random states whose Phi is well inside the regular ones
ERROR = {"double": 1e-10, "float": 2e-4}


@each_scalar
@each_law
def test_c_is_the_model(name, scalar):
    """h, ydot, Phi, Phidot, u and tau by the generated C against the model's expressions;
    step answers evaluate's tau."""
    compared = 0
    for plant in plants(name):
        controller = CompiledController(law(name), plant.params, plant.config, plant.gains, scalar)
        for point in plant.points:
            evaluation = controller.evaluate(point.state, point.reference)
            assert evaluation.status == "ok"
            for quantity, value in evaluation.values.items():
                truth = point.truth.values[quantity]
                if truth.size:
                    assert np.abs(value - truth).max() <= ERROR[scalar] * np.abs(truth).max(), quantity
            status, tau = controller.step(point.state, point.reference)
            compared += status == "ok" and np.allclose(
                tau, evaluation.values["tau"], rtol=ERROR[scalar], atol=0
            )
    assert compared == 60


@each_law
def test_outputs_do_what_the_outer_loop_asks(name):
    """Forward dynamics by Lagrange's equations with multipliers, outputs differentiated along them:
    no S and no Phi."""
    own = law(name)
    mechanism, system, output = own.system.mechanism, own.system, own.output
    q, qdot, n, m = mechanism.q, mechanism.qdot, mechanism.q.numel(), mechanism.A.shape[0]
    qddot, tau = ca.SX.sym("qddot", n), ca.SX.sym("tau", len(mechanism.inputs))
    A, motion = mechanism.A, lambda e: ca.jtimes(e, ca.vertcat(q, qdot), ca.vertcat(qdot, qddot))
    KKT = ca.blockcat([[mechanism.M, A.T], [A, ca.SX(m, m)]])
    right = ca.vertcat(mechanism.E @ tau - mechanism.V, -ca.jtimes(A @ qdot, q, qdot))
    to_nu = ca.solve(system.S.T @ system.S, system.S.T @ qdot)  # nu, as qdot = S nu
    derivatives = []
    for each, degree in zip(output.rows, own.linearization.relative_degree, strict=True):
        expression = ca.substitute(each.expression, system.nu, to_nu)
        derivatives.append(motion(motion(expression)) if degree == 2 else motion(expression))
    arguments = [symbols(own.parameters), symbols(own.config), q, qdot]
    dynamics = ca.Function("dynamics", [*arguments, tau], [KKT, right])
    outputs = ca.Function("outputs", [*arguments, qddot], [ca.vertcat(*derivatives)])
    virtual_input = own.function({"v": own.v, "qdot": system.qdot})
    for plant in plants(name)[:2]:
        for point in plant.points[:10]:
            v, speeds = virtual_input(plant.params, plant.config, plant.gains, point.state, point.reference)
            at = (plant.params, plant.config, point.state[:n], speeds)
            matrix, force = map(np.asarray, dynamics(*at, point.truth.values["tau"]))
            answered = np.asarray(outputs(*at, np.linalg.solve(matrix, force)[:n])).ravel()
            scale = np.abs(v).max() + np.abs(force).max() / np.abs(np.diag(matrix)[:n]).max()
            assert np.abs(answered - np.asarray(v).ravel()).max() <= 1e-8 * scale


@pytest.mark.parametrize("name", ["arm_4", "arm_5"])
def test_singular_exactly(name):
    """A stretched arm cannot move its end along itself: a row of Phi is zero,
    though rounding hides that from an inverse."""
    own, random = law(name), np.random.default_rng(8)
    for plant in plants(name)[:3]:
        for direction in (0.0, math.pi / 2, math.pi):
            state = np.zeros(len(own.state))
            state[0] = direction
            state[-own.system.nu.numel() :] = random.uniform(-2, 2, own.system.nu.numel())
            for controller in (CasadiController, CompiledController):
                compiled = controller(own, plant.params, plant.config, plant.gains)
                assert (
                    compiled.evaluate(state, random.uniform(-2, 2, len(own.reference))).status == "singular"
                )


def test_condition_numbers():
    """Against NumPy's; of matrices whose columns or rows depend on each other at least 1e12."""
    random = np.random.default_rng(4)
    for n in (2, 3, 4, 5, 7):
        matrix = ca.SX.sym("matrix", n, n)
        function = ca.Function("condition", [matrix], [condition(matrix)])
        for _ in range(50):
            value = random.normal(size=(n, n))
            assert function(value) == pytest.approx(np.linalg.cond(value, 1), rel=1e-9)
            row, other = random.permutation(n)[:2]
            for singular in (value.copy(), value.copy()):
                singular[row] = random.choice([0.0, 2.0]) * singular[other]
                for each in (singular, singular.T):
                    assert not function(each) < 1e12


def test_least_inputs():
    """With six inputs for four motions: no other inputs of the same effect have a smaller sum of squares."""
    own = law("manipulator")
    system = own.system
    model = own.function({"S": system.S, "E": system.mechanism.E, "Mbar": system.Mbar, "bias": system.bias})
    for plant in plants("manipulator")[:2]:
        for point in plant.points[:10]:
            values = point.truth.values
            found = model(plant.params, plant.config, plant.gains, point.state, point.reference)
            S, E, Mbar, bias = (value.full() for value in found)
            effect = S.T @ E
            assert effect.shape == (4, 6)
            least = np.linalg.pinv(effect) @ (Mbar @ values["u"].ravel() + bias.ravel())
            assert np.abs(values["tau"].ravel() - least).max() <= 1e-10 * np.abs(least).max()


@each_scalar
@pytest.mark.parametrize("name", ["bare", "manipulator"])
def test_slowing_down_within_limits(name, scalar):
    """One speed among the outputs: C and model give it up alike, with as many limits as there are inputs."""
    own, saturated = law(name), 0
    for plant in plants(name)[:1]:
        for point in plant.points:
            torque = tuple(
                0.95 * np.abs(point.truth.values["tau"]).max() for _ in own.system.mechanism.inputs
            )
            answers = []
            for kind in (CasadiController, CompiledController):
                more = {} if kind is CasadiController else {"scalar": scalar}
                controller = kind(
                    own, plant.params, plant.config, plant.gains, limits=Limits(torque, "slow"), **more
                )
                answers.append(controller.step(point.state, point.reference))
            (status, truth), (other, tau) = answers
            assert other == status == "saturated"
            saturated += np.abs(tau - truth).max() <= {"double": 1e-9, "float": 2e-3}[scalar] * max(torque)
            assert np.all(np.abs(tau) <= np.array(torque) * (1 + 1e-6))
    assert saturated == len(plants(name)[0].points) >= 10


# -- singular ------------------------------------------------------------------------------------------------

SINGULAR = 1e-5  # written out: the model's own number is what is tested
# Of SINGULAR: rounding of 1e-7 times a condition of 1e5
NEARLY = {"casadi": 1e-8, "double": 1e-8, "float": 0.05}


@pytest.mark.parametrize("name", ["plate", "manipulator", "arm_4", "arm_5"])
def test_singular_is_the_reciprocal_condition(name):
    """On both sides of the limit, found with NumPy, in all backends:
    1 / (|Phi| |Phi^-1|) in the 1-norm against 1e-5."""
    own = law(name)
    if name == "plate":  # never singular, but for a unit that makes rows unlike
        rows = [
            *own.output.rows[:2],
            row("angle", "rad", own.output.rows[2].expression * own.system.mechanism.q[3]),
        ]
        own = control_law(own.system, OutputMap("square", "", tuple(rows), own.config))
    plant = next(random_plants(own, 1, seed=5))
    point, fixed = plant.points[0], (plant.params, plant.config, plant.gains)
    Phi, size = Direct(own.function({"Phi": own.linearization.Phi})), len(own.output.rows)

    def rcond(state: np.ndarray) -> float:
        return 1 / np.linalg.cond(Phi(*fixed, state, point.reference)[0].reshape(size, size, order="F"), 1)

    state, moved = point.state.copy(), {"plate": 3, "manipulator": 4}.get(name, 2)
    places = np.linspace(-3, 3, 4001)
    measured = [rcond(np.where(np.arange(len(state)) == moved, place, state)) for place in places]
    low, high = places[int(np.argmin(measured))], places[int(np.argmin(measured))] + 0.01
    controllers = {"casadi": CasadiController(own, *fixed)}
    controllers |= {scalar: CompiledController(own, *fixed, scalar) for scalar in ("double", "float")}

    def at(place: float) -> np.ndarray:
        return np.where(np.arange(len(state)) == moved, place, state)

    centre = min(((low + k * 1e-4) for k in range(-40, 41)), key=lambda place: rcond(at(place)))
    for _ in range(40):  # towards the smallest
        centre = min(
            (centre + step * 0.7**_ * 1e-4 for step in (-1, 0, 1)), key=lambda place: rcond(at(place))
        )
    assert rcond(at(centre)) < SINGULAR / 2
    for backend, controller in controllers.items():
        for factor, expected in ((1 - NEARLY[backend], "singular"), (1 + NEARLY[backend], "ok")):
            inside, outside = centre, centre + high - low
            for _ in range(60):  # halving a number more often changes nothing
                middle = (inside + outside) / 2
                inside, outside = (
                    (middle, outside) if rcond(at(middle)) < factor * SINGULAR else (inside, middle)
                )
            assert controller.step(at(inside), point.reference)[0] == expected, (backend, factor)
        assert controller.evaluate(at(centre), point.reference).status == "singular"


def test_singular_of_two_outputs():
    """The LABMATE nearly square to a line: |det Phi| of the product of its row norms against 1e-5,
    from the paper's Phi."""
    robot = find_robot("labmate")
    own, params = robots_law(robot, "type_iv_line"), robot.parameter_values({})
    b, d, r = (params[[p.name for p in robot.parameters].index(name)] for name in ("b", "d", "r"))
    config, gains = {"A": 0.0, "B": 1.0, "C": 0.0, "L": 0.4}, [1.0] * len(own.gains)
    fixed = (params, [config[q.name] for q in own.config], gains)

    def measure(phi: float) -> float:
        across = r * (0.4 + d) / (2 * b) * np.cos(phi)
        Phi = np.array([[r / 2 * np.sin(phi) + across, r / 2 * np.sin(phi) - across], [r / 2, r / 2]])
        return abs(np.linalg.det(Phi)) / np.prod(np.linalg.norm(Phi, axis=1))

    controllers = {"casadi": CasadiController(own, *fixed)}
    controllers |= {scalar: CompiledController(own, *fixed, scalar) for scalar in ("double", "float")}
    for backend, controller in controllers.items():
        for factor, expected in ((1 - NEARLY[backend], "singular"), (1 + NEARLY[backend], "ok")):
            phi = brentq(
                lambda phi, factor=factor: measure(phi) - factor * SINGULAR,
                np.pi / 2 - 1e-3,
                np.pi / 2,
                xtol=1e-16,
            )
            state = np.array([0.0, 0.0, phi, 0.0, 0.0, 0.5, 0.5])
            assert controller.step(state, np.zeros(len(own.reference)))[0] == expected, (backend, factor)


def test_regular_where_a_rewritten_denominator_would_vanish():
    """1 / sin(a - b) must not become (..) / (cos^2 b - cos^2 a), which has no value at a = -b either."""
    a, b = ca.SX.sym("a"), ca.SX.sym("b")
    for expression in (
        cos(a) * sin(b) / (sin(a) * cos(b) - cos(a) * sin(b)),
        cos(a) / (1 + sin(a)),
        b / (a + ca.sqrt(a**2 + b**2)),
    ):
        f = ca.Function("f", [a, b], [expression, canonical(expression)])
        for place in ((0.7, -0.7), (np.pi / 2, 0.3), (0.4, 0.0)):
            truth, simplified = map(float, f(*place))
            assert abs(simplified - truth) <= 1e-12 * max(1, abs(truth))


# -- solving -------------------------------------------------------------------------------------------------


def matrix(n: int, condition: float, random: np.random.Generator, symmetric: bool = False) -> np.ndarray:
    U, _, V = np.linalg.svd(random.normal(size=(n, n)))
    return U @ np.diag(np.geomspace(1, 1 / condition, n)) @ (U.T if symmetric else V)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 6, 8])
def test_the_models_solutions(n):
    """As accurate as elimination with pivots, up to the condition at which Phi counts as singular."""
    M, b, random = ca.SX.sym("M", n, n), ca.SX.sym("b", n, 2), np.random.default_rng(n)
    f = ca.Function("f", [M, b], [solve(M, b), solve_symmetric(M, b)])
    for size in (1.0, 1e3, 1e5):
        for _ in range(20):
            x, A, P = (
                random.normal(size=(n, 2)),
                matrix(n, size, random),
                matrix(n, size, random, symmetric=True),
            )
            error = max(
                np.abs(np.asarray(f(A, A @ x)[0]) - x).max(), np.abs(np.asarray(f(P, P @ x)[1]) - x).max()
            )
            assert error <= 1e-14 * size * np.abs(x).max() * (100 if n == 3 else 1)  # cofactors lose more


def test_solutions_by_blocks():
    """Any pattern of zeros that leaves the matrix regular, rows and columns in any order."""
    random, sizes = np.random.default_rng(7), set()
    for _ in range(60):
        n = int(random.integers(4, 8))
        pattern = (random.random((n, n)) < 0.3) | np.eye(n, dtype=bool)
        A = (random.uniform(1, 2, (n, n)) * pattern + 3 * np.eye(n))[random.permutation(n)][
            :, random.permutation(n)
        ]
        M, b = ca.SX.sym("M", ca.sparsify(ca.DM(A)).sparsity()), ca.SX.sym("b", n, 2)
        sizes.add(M.sparsity().btf()[0])
        x = random.normal(size=(n, 2))
        solution = np.asarray(ca.Function("f", [M, b], [solve(M, b)])(A, A @ x))
        assert np.abs(solution - x).max() <= 1e-12 * np.linalg.cond(A)
    assert {1, 2, 3} <= sizes


@each_scalar
def test_the_runtimes_inverse(scalar):
    """Against NumPy, zeros and repeated rows included; the reciprocal condition is NumPy's."""
    run, random = runtime("noslip_solve.h"), np.random.default_rng(4)
    invert, kind = run.function("noslip_invert", scalar), {"double": np.float64, "float": np.float32}[scalar]
    epsilon = float(np.finfo(kind).eps)
    regular = singular = 0
    for _ in range(400):
        n = int(random.integers(1, 9))
        A = (random.normal(size=(n, n)) * random.choice([0, 1, 1, 1], size=(n, n))).astype(kind).astype(float)
        if random.random() < 0.2 and n > 1:
            A[0] = 2 * A[n - 1]
        array, order = run.array(scalar, A.ravel()), run.ffi.new(f"int[{n}]")
        rcond = invert(array, order, n)
        rank = np.linalg.matrix_rank(A)
        condition = np.linalg.cond(A, 1) if rank == n else np.inf
        if condition * epsilon > 1e-3:
            singular += 1
            assert rcond <= 2e-3 / epsilon * epsilon
            continue
        regular += 1
        inverse = np.linalg.inv(A)
        assert (
            np.abs(np.array(list(array)).reshape(n, n) - inverse).max()
            <= 20 * epsilon * condition * np.abs(inverse).max()
        )
        assert abs(rcond * condition - 1) <= 20 * epsilon * condition
    assert regular > 150 and singular > 50


@each_scalar
def test_no_inverse(scalar):
    run = runtime("noslip_solve.h")
    for entries in (
        [0.0] * 4,
        [1.0, 2.0, 2.0, 4.0],
        [np.nan, 1.0, 1.0, 2.0],
        [1.0, 1.0, 1.0, np.nan],
        [np.inf, 0.0, 0.0, 1.0],
    ):
        array, order = run.array(scalar, entries), run.ffi.new("int[2]")
        assert run.function("noslip_invert", scalar)(array, order, 2) == 0


@each_scalar
def test_the_runtimes_symmetric_solution(scalar):
    run, random = runtime("noslip_solve.h"), np.random.default_rng(6)
    factor, back = run.function("noslip_ldl", scalar), run.function("noslip_ldl_solve", scalar)
    epsilon = float(np.finfo({"double": np.float64, "float": np.float32}[scalar]).eps)
    for _ in range(200):
        n, condition = int(random.integers(1, 9)), 10 ** random.uniform(0, 3)
        P, x = matrix(n, condition, random, symmetric=True), random.normal(size=n)
        lower = np.where(np.tri(n), P, np.nan)  # above the diagonal nothing is read
        factors, right = run.array(scalar, lower.ravel()), run.array(scalar, P @ x)
        assert factor(factors, n) == 0
        back(factors, right, n)
        assert np.abs(np.array(list(right)) - x).max() <= 50 * epsilon * condition * np.abs(x).max()
        P -= (np.linalg.eigvalsh(P)[0] + 1e-3) * np.eye(n)
        assert factor(run.array(scalar, P.ravel()), n) == -5


# -- the C ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("cc", ["gcc", "clang"])
@pytest.mark.parametrize("name", ["bare", "sledge", "arm_4"])
def test_no_warnings(name, cc, tmp_path):
    """No member at all, no angle, a matrix inverted by the runtime: all files, both scalars."""
    files = {}
    for scalar, kind in SCALARS.items():
        files |= {**shared_files(law(name).system, kind), **library(law(name), scalar).text.files()}
    for file, text in {**runtime_files(), **files}.items():
        (tmp_path / file).write_text(text)
    sources = [file for file in files if file.endswith(".c")]
    result = subprocess.run(
        [cc, *FLAGS, *STRICT, "-fsyntax-only", *sources], cwd=tmp_path, capture_output=True, text=True
    )
    assert result.returncode == 0 and result.stderr == "", result.stderr


@pytest.mark.parametrize(
    ("name", "block"), [("manipulator", ""), ("arm_4", "inverse 4x4"), ("arm_5", "inverse 5x5")]
)
def test_what_the_runtime_inverts(name, block):
    """Only a block of Phi above 3 x 3; the count is in the header,
    and nothing else of the runtime is asked for."""
    text = library(law(name), "float").text
    source, header = text.source(), text.header()
    assert ("noslip_solve.h" in source) == ("noslip_invert_f" in source) == bool(block)
    assert not block or f"1 {block}" in header
    step = re.search(r"_step_f_law\(.*?^\}", source, re.S | re.M)[0]
    assert step.count("noslip_invert_f(") == bool(block)


# -- what is refused -----------------------------------------------------------------------------------------


def balancer():
    robot = Mechanism("balancer", "two wheels, a body that falls")
    x, y, tilt = robot.coordinate("x", "m"), robot.coordinate("y", "m"), robot.coordinate("tilt", "rad")
    robot.kinetic_energy(
        (robot.rate(x) ** 2 + robot.rate(y) ** 2) / 2
        + robot.rate(x + 0.5 * sin(tilt)) ** 2
        + robot.rate(tilt) ** 2
    )
    robot.holds("level", y)
    robot.input("wheels", "N", on=robot.rate(x))
    return robot


def outputs(name: str, *rows: OutputRow):
    return linearize(law(name).system, OutputMap("mine", "", rows))


def joint(k: int) -> ca.SX:
    return law("arm_4").system.mechanism.q[k]


REFUSED = {
    "underactuated": (
        lambda: reduce(balancer()),
        "balancer: 1 input for n - m = 2 degrees of freedom; an underactuated robot cannot be linearized as "
        "a whole. Declare outputs with 1 row, output(name, about, rows), which are linearized partially; or "
        "add 1 input or 1 constraint, or leave out what no input drives",
    ),
    "too few outputs": (
        lambda: outputs("arm_4", *[row(f"y_{k}", "rad", joint(k)) for k in range(2)]),
        "arm_4, output mine: 2 outputs for n - m = 4; add 2: y_0, y_1 must be as many as the "
        "quasi-velocities w_0, w_1, w_2, w_3",
    ),
    "too many outputs": (
        lambda: outputs("arm_4", *[row(f"y_{k}", "rad", joint(k % 4)) for k in range(5)]),
        "5 outputs for n - m = 4; drop 1: y_0, y_1, y_2, y_3, y_4 must be",
    ),
    "no input felt": (
        lambda: car(ahead=False),
        "car, output lead: Phi is singular everywhere: no output depends on the input along steering; "
        "replace one by steering itself or by an output whose rate depends on it, such as a point that "
        "steering moves (ahead of a steered wheel, not on its axle)",
    ),
    "two of four depend": (
        lambda: outputs(
            "arm_4",
            *[
                row(f"y_{k}", "", e)
                for k, e in enumerate((joint(0), joint(3) + joint(1), sin(joint(0)), joint(2)))
            ],
        ),
        "Phi is singular everywhere: the outputs y_0, y_2 depend on each other: they contain only 1 "
        "combination of w_0;",
    ),
    "three of four depend": (
        lambda: outputs(
            "arm_4",
            *[
                row(f"y_{k}", "", e)
                for k, e in enumerate((joint(0), joint(1), joint(0) * joint(1), joint(2) + joint(3)))
            ],
        ),
        "the outputs y_0, y_1, y_2 depend on each other: they contain only 2 combinations of w_0, w_1;",
    ),
    "units": (
        lambda: outputs("arm_4", *[row(f"y_{k}", "", joint(k) * 10.0 ** (2 * k)) for k in range(4)]),
        "Phi is singular everywhere: its reciprocal condition number is at most 1e-06, and values up to "
        "1e-05 count as singular; choose units of outputs and quasi-velocities in which they are of similar "
        "size",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused(case):
    build, message = REFUSED[case]
    with pytest.raises(ModelError) as error:
        build()
    assert message in str(error.value) and "\n" not in str(error.value)
