"""No pole in S, the reduced equations and the law where the robot with its quasi-velocities is regular."""

import math

import casadi as ca
import mpmath
import numpy as np
import pytest
from casadi import cos, sin
from noslip.cli.main import main
from noslip.codegen.graph import Node
from noslip.codegen.program import compile_law
from noslip.model import Mechanism, ModelError, control_law, reduce, reduction
from noslip.model.algebra import exact, linear, poles
from noslip.model.algebra.exact import canonical
from noslip.model.algebra.linear import eliminate
from noslip.model.algebra.poles import added_pole, denominators, quotient, without_pole
from noslip.model.linearization import linearize
from noslip.model.outputs import output_map
from noslip.model.recursion import Reduced
from noslip.model.reduction import ReducedSystem, warnings
from noslip.model.robots import ROBOTS
from noslip.tests.codegen_tools import evaluate, in_c, random_leaves, relative_error
from noslip.tests.model.test_known import Texts

PLACES = 40


def ball_in_a_cylinder() -> Mechanism:
    """A ball that rolls inside an upright cylinder, its orientation by Euler angles (z, x, z):
    singular at sin(beta) = 0 only."""
    robot = Mechanism("ball")
    R, a = robot.parameter("R", 1.0, "m", "", "positive"), robot.parameter("a", 0.2, "m", "", "positive")
    m, inertia = robot.parameter("m", 2.0, "kg"), robot.parameter("I_b", 0.03, "kg m^2")
    theta, z = robot.coordinate("theta", "rad"), robot.coordinate("z", "m")
    alpha, beta, gamma = (robot.coordinate(name, "rad") for name in ("alpha", "beta", "gamma"))
    rate = robot.rate
    x_rate = rate(beta) * cos(alpha) + rate(gamma) * sin(alpha) * sin(beta)
    y_rate = rate(beta) * sin(alpha) - rate(gamma) * cos(alpha) * sin(beta)
    z_rate = rate(alpha) + rate(gamma) * cos(beta)
    robot.kinetic_energy(m * (((R - a) * rate(theta)) ** 2 + rate(z) ** 2) / 2)
    robot.kinetic_energy(inertia * (x_rate**2 + y_rate**2 + z_rate**2) / 2)
    robot.potential_energy(m * 9.81 * z)
    robot.rolls("around", (R - a) * rate(theta) + a * z_rate)
    robot.rolls("upward", rate(z) + a * (x_rate * sin(theta) - y_rate * cos(theta)))
    spin = x_rate * cos(theta) + y_rate * sin(theta)
    for name, unit, velocity in (
        ("around", "rad/s", rate(theta)),
        ("up", "m/s", rate(z)),
        ("spin", "rad/s", spin),
    ):
        robot.quasi_velocity(f"{name}_rate", unit, velocity)
        robot.input(f"push_{name}", "", on=velocity)
    robot.output("place", "", [("theta_out", "rad", theta), ("z_out", "m", z), ("spin_out", "rad/s", spin)])
    return robot


def square_of(system: ReducedSystem) -> tuple[ca.SX, ca.SX]:
    """[A; Gamma] and [0; 1], of which S is the quotient."""
    A, gamma = system.mechanism.A, system.mechanism.quasi_velocity_rows
    return ca.vertcat(A, gamma), ca.vertcat(ca.SX(A.shape[0], gamma.shape[0]), ca.SX.eye(gamma.shape[0]))


def test_the_ball_has_no_pole_of_its_own():
    """Beside alpha - theta = pi/2, and there: S and S'MS are what numbers give."""
    system = reduce(ball_in_a_cylinder())
    assert system.S[1, 2].is_zero()
    mechanism = system.mechanism
    functions = ca.Function(
        "f", [mechanism.q, mechanism.p], [system.S, system.Mbar, *square_of(system), mechanism.M]
    )
    random = np.random.default_rng(4)
    for k in range(PLACES):
        q = random.uniform(0.3, 1.2, 5)
        q[2] = q[0] + math.pi / 2 + random.choice((-1, 1)) * (10.0 ** random.uniform(-12, -3) if k else 0.0)
        S, Mbar, matrix, right, M = (each.full() for each in functions(q, [1.0, 0.2, 2.0, 0.03]))
        truth = np.linalg.solve(matrix, right)
        assert np.abs(S - truth).max() <= 1e-12 * np.abs(truth).max()
        assert np.abs(Mbar - truth.T @ M @ truth).max() <= 1e-12 * np.abs(Mbar).max()


def test_the_ball_s_law_has_no_pole_of_its_own():
    """In double, beside the same place, against the plain law with 50 digits."""
    system = reduce(ball_in_a_cylinder())
    law = control_law(system, output_map(system, "place"))
    plain, staged = (
        next(
            body.quantities["tau"]
            for entry, body in compile_law(law, optimize=each).entries.items()
            if entry.name == "step"
        )
        for each in (False, True)
    )
    functions = in_c(np.float64, lambda angle: (math.sin(angle), math.cos(angle)))
    for seed in range(PLACES):
        values = random_leaves(seed)
        offset = 10.0 ** -(seed % 13)

        def leaf(node: Node, values=values, offset=offset) -> mpmath.mpf:
            at = (
                0.7
                if node.name == "theta"
                else 0.7 + math.pi / 2 + offset
                if node.name == "alpha"
                else values(node)
            )
            return mpmath.mpf(float(at))

        truth = evaluate([n for row in plain for n in row], leaf)
        ours = evaluate(
            [n for row in staged for n in row],
            lambda n, leaf=leaf: np.float64(leaf(n)),
            np.float64,
            functions,
        )
        assert relative_error([mpmath.mpf(float(x)) for x in ours], truth) <= 1e-11


@pytest.mark.parametrize("name", ROBOTS)
def test_shipped_robots_have_no_pole_of_their_own(name):
    system = reduce(ROBOTS[name]())
    assert added_pole(system.S, square_of(system), quotient, system.mechanism.q) is None


def with_divisor(value: ca.SX, divisor: ca.SX) -> ca.SX:
    """The value, except where the divisor vanishes."""
    return (value * divisor + 1) / divisor - 1 / divisor


def test_a_pole_that_is_added_is_found():
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    one, other, both = ca.SX(1), x - y, ca.vertcat(x, y)
    assert added_pole(with_divisor(other, sin(x + y)), (one, other), quotient, both) is not None
    assert added_pole(with_divisor(other, 2 + sin(x)), (one, other), quotient, both) is None
    assert added_pole(1 / other, (other, one), quotient, both) is None  # the matrix is singular there
    assert added_pole(with_divisor(other, x + y), (one, other), quotient, y) is not None
    # Positive, both
    assert added_pole(with_divisor(other, x + y), (one, other), quotient, ca.SX(0, 1)) is None
    assert {str(each) for each in denominators(1 / (2 * x * ca.sqrt(y)))} == {"x", "y"}


def test_what_another_run_found_free_of_poles(monkeypatch):
    """Is not searched again; another formula, other moving symbols and a pole are."""
    monkeypatch.setattr(exact, "_stores", [Texts()])
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    one, other, both = ca.SX(1), x - y, ca.vertcat(x, y)
    free, pole = with_divisor(other, 2 + sin(x)), with_divisor(other, x + y)
    for _ in range(2):
        assert without_pole("cart", "f", free, (one, other), quotient, both) is free
        with pytest.raises(ModelError, match="without a division by"):
            without_pole("cart", "f", pole, (one, other), quotient, both)
    searched = []
    monkeypatch.setattr(poles, "added_pole", lambda *given: searched.append(given))
    assert without_pole("cart", "f", free, (one, other), quotient, both) is free and not searched
    for change in ((free, (one, x - 2 * y), both), (free, (one, other), x), (2 * free, (one, other), both)):
        without_pole("cart", "f", change[0], change[1], quotient, change[2])
    assert len(searched) == 3


def test_a_pole_that_only_zero_shows():
    """What cancels without an error is wrong at exactly 0 alone, where joints often are."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    ratio = sin(x) * y / (sin(x) * (2 + cos(y))) * (2 + cos(y))
    assert added_pole(ratio, (ca.SX(1), y), quotient, x) is not None
    assert added_pole(ratio, (ca.SX(1), y), quotient, y) is None
    assert added_pole(ratio, (sin(x), sin(x) * y), quotient, x) is None


def test_no_pole_of_elimination_at_zero():
    """A robot whose S keeps sin(q) / sin(q) when it is found by elimination."""
    q, p = ca.SX.sym("q", 3), ca.SX.sym("p")
    s, c = sin(q), cos(q)
    matrix = ca.vertcat(
        ca.horzcat(c[1] + 1.1, s[1], 0, 0),
        ca.horzcat(0, 0.1 * c[0], p / (2.5 + sin(q[0] - q[1])), p),
        ca.horzcat(s[2], p, c[2], 0),
        ca.horzcat(0, c[0], 0, 0),
    )
    inverse = eliminate(matrix, ca.SX.eye(4), q, "robot")
    at = ca.Function("at", [q, p], [inverse, ca.densify(matrix)])
    for place in ([0.0, 0.0, 0.0], [0.3, 0.0, -0.4], [0.3, 0.2, 0.0]):
        value, A = (each.full() for each in at(place, 0.7))
        assert np.abs(value @ A - np.eye(4)).max() < 1e-13


def test_a_pole_that_stays_is_refused(monkeypatch):
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    for way in ("_by_pivots", "_by_cofactors"):
        monkeypatch.setattr(linear, way, lambda matrix, right: with_divisor(right, sin(x + y)))
    with pytest.raises(
        ModelError, match=r"cart: no expression for S was found without a division by sin\(\(x\+y\)\)"
    ):
        eliminate(ca.SX.eye(1), x - y, ca.vertcat(x, y), "cart")


@pytest.mark.parametrize("name", ["S'MS", "the bias", "S'E", "a row of Phi"])
def test_a_pole_of_the_equations_is_refused(name, monkeypatch):
    """As if the simplification of one quantity left a removable pole that the robot does not have."""
    simplified = ReducedSystem.simplified

    def with_pole(self, quantity, expression, parts, combined):
        if quantity != name:
            return simplified(self, quantity, expression, parts, combined)
        steering = self.mechanism.coordinates[3].symbol
        with monkeypatch.context() as patch:
            patch.setattr(reduction, "canonical", lambda entry: with_divisor(entry, sin(steering + 0.3)))
            return simplified(self, quantity, expression, parts, combined)

    monkeypatch.setattr(ReducedSystem, "simplified", with_pole)
    with pytest.raises(ModelError, match=f"no expression for {name} was found without a division by sin"):
        system = reduce(ROBOTS["car"]())
        control_law(system, output_map(system, "type_i"))


@pytest.mark.parametrize("name", ["S", "S'MS", "the bias"])
def test_a_pole_of_the_equations_by_bodies_is_refused(name, monkeypatch):
    """These are written out from steps, each simplified by itself."""
    original, attribute = Reduced.written_out, {"S": "S", "S'MS": "Mbar", "the bias": "bias"}[name]

    def written_out(self, expression):
        written = original(self, expression)
        if expression is not getattr(self, attribute):
            return written
        angle = next(symbol for symbol in ca.symvar(written) if str(symbol).startswith("phi"))
        return with_divisor(written, sin(angle))

    monkeypatch.setattr(Reduced, "written_out", written_out)
    with pytest.raises(ModelError, match=f"no expression for {name} was found without a division by sin"):
        system = reduce(ROBOTS["tractor_trailer"]())
        assert system.by_bodies and system.Mbar is not None and system.bias is not None


def test_a_pole_of_the_weighted_inverse_is_refused(monkeypatch):
    """Of more inputs than degrees of freedom; and of the acceleration,
    which is solved for in the same way."""
    system = reduce(ROBOTS["four_wheel"]())
    assert system.redundant and system.input_inverse() is not None
    q, original = system.mechanism.coordinates[2].symbol, reduction.solve_symmetric
    monkeypatch.setattr(
        reduction, "solve_symmetric", lambda *arguments: with_divisor(original(*arguments), sin(q))
    )
    with pytest.raises(
        ModelError, match=r"no expression for \(S'E\)\^\+ was found without a division by sin"
    ):
        system.input_inverse()
    with pytest.raises(ModelError, match="no expression for nudot was found without a division by sin"):
        system.acceleration(ca.vertcat(*[tau.symbol for tau in system.mechanism.inputs]))


@pytest.mark.parametrize("rest", ["coordinate", "velocity"])
def test_a_pole_of_the_second_feedback_is_refused(rest, monkeypatch):
    """u (20), and with it tau: beside zeros of an angle, and where a velocity is exactly zero."""
    system = reduce(ROBOTS["car"]())
    linearization = linearize(system, output_map(system, "type_i"))
    at = system.mechanism.coordinates[3].symbol if rest == "coordinate" else system.nu[0]
    v = ca.SX.sym("v", 2)
    assert linearization.second_feedback(v) is not None
    determinant = linearization.determinant * sin(at) * (1 + at**2) / (sin(at) + sin(at) * at**2)
    monkeypatch.setitem(vars(linearization), "determinant", determinant)
    with pytest.raises(ModelError, match="no expression for u was found without a division by"):
        linearization.second_feedback(v)


def test_a_long_denominator_is_named_by_its_symbols():
    """What CasADi prints with numbers for parts that appear twice tells nobody anything."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    shared = sin(x - y)
    for pole, text in ((shared + shared**3, "an expression in x, y"), (shared, "sin((x-y))")):
        with pytest.raises(ModelError) as refused:
            without_pole("cart", "S", with_divisor(x, pole), (ca.SX(1), x), quotient, ca.vertcat(x, y))
        assert f"cart: no expression for S was found without a division by {text}, which vanishes" in str(
            refused.value
        )


def lever() -> Mechanism:
    """A constraint x ydot = 0, which says nothing at x = 0."""
    robot = Mechanism("lever")
    x, y, z = (robot.coordinate(name, "m") for name in "xyz")
    rate = robot.rate
    robot.kinetic_energy((rate(x) ** 2 + rate(y) ** 2 + rate(z) ** 2) / 2)
    robot.rolls("lever", x * rate(y))
    for name, place in (("u", x), ("w", z)):
        robot.input(f"force_{name}", "N", on=rate(place))
        robot.quasi_velocity(name, "m/s", rate(place))
    robot.output("place", "", [("x_out", "m", x), ("z_out", "m", z)])
    return robot


WARNINGS = {
    "lever": (lever, ["lever: the constraints lose rank where x = 0"]),
    "ball": (
        ball_in_a_cylinder,
        ["ball: the quasi-velocities do not determine the motion where sin(beta) = 0"],
    ),
    "car": (ROBOTS["car"], ["car: the quasi-velocities do not determine the motion where cos(delta) = 0"]),
    "labmate": (ROBOTS["labmate"], []),
    "tricycle": (ROBOTS["tricycle"], []),
}


@pytest.mark.parametrize("name", WARNINGS)
def test_where_rank_is_lost(name):
    build, expected = WARNINGS[name]
    lines = warnings(reduce(build()))
    assert len(lines) == len(expected) and all(
        line.startswith(start) for line, start in zip(lines, expected, strict=True)
    )


@pytest.mark.parametrize(
    "command",
    [["generate"], ["generate", "--check"], ["export"], ["export", "--firmware", "generic"]],
    ids=" ".join,
)
def test_the_commands_say_once_where_rank_is_lost(command, tmp_path, capsys):
    main([*command, f"{__file__}:lever", "-o", str(tmp_path / "c"), "--scalar", "double"])
    assert capsys.readouterr().err.count("warning: lever: the constraints lose rank where x = 0;") == 1


def test_a_quotient_of_quotients_has_a_derivative():
    """1 / (b / c) is 0 where c is, and its derivative c' / b; as written it is 0 / 0."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    b, c = cos(x + y) + 0.1, sin(x + y)
    written, simple = 1 / ((2 - sin(x)) * (b / c)), canonical(1 / ((2 - sin(x)) * (b / c)))
    rate = [ca.Function("rate", [x, y], [ca.jacobian(each, ca.vertcat(x, y))]) for each in (written, simple)]
    assert not np.isfinite(rate[0](0, 0).full()).all()
    assert rate[1](0, 0).full() == pytest.approx(1 / 2.2, abs=1e-15)
    below = 1 / (1 / (x + 1) / x)
    assert added_pole(below, [x * (x + 1)], lambda a: a, x) is not None
    assert added_pole(x * (x + 1), [x * (x + 1)], lambda a: a, x) is None
