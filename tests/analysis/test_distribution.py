"""model/ distributions against the literature, against numerical brackets,
and against input that must be refused."""

import itertools
import math
from collections.abc import Callable
from functools import cache

import casadi as ca
import mpmath
import numpy as np
import pytest
import sympy as sp
from casadi import cos, sin, sqrt
from noslip.analysis.distributions.analysis import Analysis, analyse
from noslip.analysis.distributions.distribution import distribution
from noslip.analysis.distributions.places import places
from noslip.analysis.distributions.properties import LEAF, SPACE, linearization_steps
from noslip.analysis.exact.half_angles import expression as half_angles
from noslip.analysis.exact.half_angles import factors
from noslip.analysis.exact.symbolic import recognized
from noslip.model import Mechanism, ModelError, reduce
from noslip.model.mechanism import Quantity, quantity
from noslip.model.robots.labmate import labmate
from noslip.model.rolling.contact import PlanarContact, RollingContact
from noslip.model.rolling.kinematics import Kinematics, kinematics
from noslip.model.rolling.surfaces import circle, cylinder, ellipsoid, line, plane, sphere, torus
from noslip.tests.reference import kinematic_systems as systems

SYSTEMS: dict[str, Callable[[], Kinematics]] = {
    "labmate": lambda: kinematics(labmate()),
    "knife_edge": systems.knife_edge,
    "vertical_disk": systems.vertical_disk,
    "car": systems.car,
    **{f"unicycle_{n}": lambda n=n: systems.trailers(n) for n in (0, 1, 2, 3, 4)},
    **{f"labmate_{n}": lambda n=n: systems.labmate_with_trailers(n) for n in (1, 2, 3)},
    "pendulum": systems.pendulum,
    "slider_crank": systems.slider_crank,
}

# Growth vector and k, as known:
KNOWN = {
    # N. Sarkar, X. Yun, V. Kumar, MS-CIS-92-44, 1992; G. Campion, G. Bastin, B. d'Andrea-Novel, IEEE Trans.
    # Robotics Autom. 12(1), 1996: robots of type (2, 0).
    "labmate": ((2, 3, 4), 1),
    # Ju. I. Neimark, N. A. Fufaev, Dynamics of Nonholonomic Systems, 1972 (Chaplygin's sleigh: contact
    # structure).
    "knife_edge": ((2, 3), 0),
    # R. M. Murray, Z. Li, S. S. Sastry, A Mathematical Introduction to Robotic Manipulation, 1994, ch. 7:
    # disk and car.
    "vertical_disk": ((2, 3, 4), 0),
    "car": ((2, 3, 4), 0),
    # J.-P. Laumond, Controllability of a multibody mobile robot, IEEE Trans. Robotics Autom. 9(6), 1993; F.
    # Jean, The car with N trailers: characterisation of the singular configurations, ESAIM COCV 1, 1996: N +
    # 2 steps at regular points.
    **{f"unicycle_{n}": (tuple(range(2, n + 4)), 0) for n in range(5)},
    # The unicycle with trailers and the path length (theta_r + theta_l) r/2, a function of it that only s_2
    # moves: one more dimension in the third step, since [s_1, [s_1, s_2]] is -s_2 without it. k = 1 as for
    # the LABMATE alone.
    "labmate_1": ((2, 3, 5), 1),
    "labmate_2": ((2, 3, 5, 6), 1),
    "labmate_3": ((2, 3, 5, 6, 7), 1),
    # By Frobenius: both come from positions.
    "pendulum": ((2,), 1),
    "slider_crank": ((1,), 2),
}


@cache
def analysed(name: str) -> Analysis:
    return analyse(SYSTEMS[name]())


@pytest.mark.parametrize("name", KNOWN)
def test_growth_is_the_known_one(name):
    Delta = distribution(SYSTEMS[name]())
    assert (Delta.growth, Delta.holonomic) == KNOWN[name]
    assert Delta.functions.n - Delta.holonomic == Delta.growth[-1]


# -- an independent derivation of the growth: numerical brackets ---------------------------------------------


DIGITS, STEP, SMALL = 100, mpmath.mpf(10) ** -20, mpmath.mpf(10) ** -12


def numerical_fields(name: str, parameters: dict[str, float]) -> list[Callable]:
    """The columns of S at a point, by the numbers given, with DIGITS digits."""
    Delta = distribution(SYSTEMS[name]())
    S = Delta.S.subs({p: sp.Rational(parameters[str(p)]) for p in Delta.functions.parameters})
    return [sp.lambdify([Delta.functions.coordinates], list(S.col(k)), "mpmath") for k in range(S.cols)]


def along(function: Callable, point: list, direction: list) -> list:
    """Directional derivative by central differences."""
    ahead, behind = ([x + sign * STEP * v for x, v in zip(point, direction, strict=True)] for sign in (1, -1))
    return [(a - b) / (2 * STEP) for a, b in zip(function(ahead), function(behind), strict=True)]


def bracket(x: Callable, y: Callable) -> Callable:
    return lambda q: [a - b for a, b in zip(along(y, q, x(q)), along(x, q, y(q)), strict=True)]


def numerical_rank(rows: list[list]) -> int:
    singular = mpmath.svd_r(mpmath.matrix([list(map(mpmath.mpf, row)) for row in rows]), compute_uv=False)
    return sum(1 for value in singular if value > SMALL * singular[0])


def numerical_growth(fields: list[Callable], point: list, steps: int) -> tuple[int, ...]:
    """Ranks of all right-normed brackets up to each length."""
    level, brackets, growth = fields, list(fields), [numerical_rank([f(point) for f in fields])]
    for length in range(2, steps + 1):
        pairs = itertools.combinations(fields, 2) if length == 2 else itertools.product(fields, level)
        level = [bracket(x, y) for x, y in pairs]
        brackets += level
        growth.append(numerical_rank([f(point) for f in brackets]))
    return tuple(growth)


def random_point(Delta, seed: int) -> tuple[list, dict[str, float]]:
    rng = np.random.default_rng(seed)
    values = [mpmath.mpf(v) for v in rng.uniform(0.3, 1.2, Delta.functions.n)]
    return values, {
        str(p): float(v) for p, v in zip(Delta.functions.parameters, rng.uniform(0.5, 2, 9), strict=False)
    }


def satisfies_constraints(
    model: Kinematics, fields: list[Callable], point: list, parameters: dict[str, float]
) -> bool:
    """A S = 0 to rounding, A by CasADi; S alone is taken as it is."""
    if model.A is None:
        return True
    symbols = [ca.vertcat(*[q.symbol for q in group]) for group in (model.coordinates, model.parameters)]
    A = np.array(
        ca.Function("A", symbols, [model.A])(
            list(map(float, point)), [parameters[p.name] for p in model.parameters]
        )
    )
    S = np.array([list(map(float, f(point))) for f in fields]).T
    return bool(np.abs(A @ S).max() < 1e-12 * max(1.0, np.abs(S).max()))


@pytest.mark.parametrize("name", [n for n in KNOWN if n not in ("unicycle_4", "labmate_2", "labmate_3")])
def test_growth_agrees_with_numerical_brackets(name):
    expected = KNOWN[name][0]
    with mpmath.workdps(DIGITS):
        for seed in range(2):
            point, parameters = random_point(distribution(SYSTEMS[name]()), seed)
            fields = numerical_fields(name, parameters)
            assert satisfies_constraints(SYSTEMS[name](), fields, point, parameters)
            growth = numerical_growth(fields, point, min(len(expected) + 1, 5))
            assert growth == (*expected, *[expected[-1]] * 5)[: len(growth)]


@pytest.mark.parametrize("joint, growth", [(0, (2, 3, 4, 4, 5)), (1, (2, 3, 4, 5, 5))])
def test_growth_at_a_right_angle_agrees_with_numerical_brackets(joint, growth):
    """Jean 1996 (as above): it is slower where a trailer is at a right angle to the one before,
    except the last."""
    with mpmath.workdps(DIGITS):
        point, parameters = random_point(distribution(systems.trailers(2)), 3)
        point[3 + joint] = point[2 + joint] + mpmath.pi / 2
        assert numerical_growth(numerical_fields("unicycle_2", parameters), point, 5) == growth


# -- the certificate, checked by differentiation with SymPy --------------------------------------------------


def lie(x: sp.Matrix, y: sp.Matrix, q: list[sp.Symbol]) -> sp.Matrix:
    return y.jacobian(q) * x - x.jacobian(q) * y


def named(name: str, S: sp.Matrix, q: list[sp.Symbol]) -> sp.Matrix:
    """The bracket of this name."""
    columns = {f"s{k + 1}": S.col(k) for k in range(S.cols)}
    if name in columns:
        return columns[name]
    left, right = name[1:-1].split(",", 1)
    return lie(columns[left], named(right, S, q), q)


@pytest.mark.parametrize("name", ["labmate", "vertical_disk", "car", "unicycle_2", "labmate_1", "pendulum"])
def test_certificate(name):
    """The minor of the named brackets is the one said, and each identity holds,
    at random numbers to 1e-25."""
    Delta, analysis = distribution(SYSTEMS[name]()), analysed(name)
    q, certificate = list(Delta.functions.coordinates), analysis.certificate
    brackets = sp.Matrix.hstack(*[named(b, Delta.S, q) for b in certificate.basis])
    minor = brackets.extract(
        [[str(x) for x in q].index(row) for row in certificate.rows], list(range(brackets.cols))
    )
    texts = {f"e_{k + 1}": field for k, field in enumerate(certificate.fields)}
    texts |= {f"g_{k + 1}": field for k, field in enumerate(certificate.generators)}
    symbols = {str(s): s for s in (*q, *Delta.functions.parameters)}
    for seed in range(3):
        rng = np.random.default_rng(seed)
        at = {s: sp.Rational(int(rng.integers(2, 90)), 61) for s in symbols.values()}
        assert abs((minor.subs(at).evalf(40).det() - certificate.minor.subs(at)).evalf(40)) < 1e-25
        for identity in certificate.identities:
            pair, right = identity.split(" = ")
            left = lie(*[texts[key] for key in pair.strip("[]").split(", ")], q)
            total = sp.zeros(*left.shape)
            for term in right.split(" + (") if right != "0" else []:
                coefficient, field = term.removeprefix("(").rsplit(")*", 1)
                total += sp.sympify(coefficient, symbols) * texts[field]
            assert max(abs(entry) for entry in (left - total).subs(at).evalf(40)) < 1e-25


def test_every_bracket_is_in_the_certificate():
    """Of a closure that is not everything: each [generator,
    basis field] is in the basis or has its identity."""
    for name in ("labmate", "labmate_2"):
        Delta = distribution(SYSTEMS[name]())
        columns = len(Delta.fields)
        pairs = math.comb(columns, 2) + columns * (len(Delta.filtration.basis) - columns)
        assert len(Delta.filtration.dependences) + len(Delta.filtration.basis) - columns == pairs


# -- the holonomic part --------------------------------------------------------------------------------------


def test_integral_of_the_labmate():
    """phi - c (theta_r - theta_l), c = r/(2b), is constant: paper.md section 4."""
    holonomic = analysed("labmate").holonomic
    (integral,) = holonomic.integrals
    assert integral.text() == "phi = r*(theta_r - theta_l)/(2*b) + const"
    assert holonomic.could_go == (("phi",), ("theta_r",), ("theta_l",))


@pytest.mark.parametrize("name", ["labmate", "labmate_1", "labmate_2", "pendulum", "slider_crank"])
def test_integrals_are_constant_and_independent(name):
    """dC S = 0, all k of them, at random numbers with 40 digits."""
    Delta, analysis = distribution(SYSTEMS[name]()), analysed(name)
    functions = [integral.function for integral in analysis.holonomic.integrals]
    assert len(functions) == analysis.k
    symbols = (*Delta.functions.coordinates, *Delta.functions.parameters)
    gradient = sp.Matrix(functions).jacobian(list(Delta.functions.coordinates))
    rng = np.random.default_rng(5)
    at = {s: sp.Rational(int(rng.integers(2, 90)), 61) for s in symbols}
    assert max(abs(entry) for entry in (gradient * Delta.S).subs(at).evalf(40)) < 1e-30
    assert gradient.subs(at).evalf(40).rank() == analysis.k


@pytest.mark.parametrize("name, text", [("pendulum", ["x**2 + y**2 + z**2 = const"])])
def test_integrals_read_well(name, text):
    assert [integral.text() for integral in analysed(name).holonomic.integrals] == text


def coordinates(*names: str) -> tuple[Quantity, ...]:
    return tuple(quantity(name, "m") for name in names)


@pytest.mark.parametrize(
    "row, text",
    [
        (lambda x, y, z: (1, -y, 0), "x = y**2/2 + const"),
        (lambda x, y, z: (y, -1, 0), "x - log(y) = const"),
        (lambda x, y, z: (-y, x, x * x + y * y), "z - atan(x/y) = const"),
        (lambda x, y, z: (sin(x), cos(x) * z, 0), None),
        (lambda x, y, z: (sqrt(1 + y**4), -1, 0), None),
    ],
)
def test_integration_of_one_form(row, text):
    """What is not found is said to exist; what is nonholonomic is not claimed."""
    q = coordinates("x", "y", "z")
    analysis = analyse(Kinematics("form", q, A=ca.horzcat(*row(*[c.symbol for c in q]))))
    lines = analysis.holonomic.text()
    if text is None and analysis.k:
        assert not analysis.holonomic.integrals and "exists but no closed form was found" in lines[0]
    elif text is None:
        assert analysis.growth == (2, 3) and not lines
    else:
        assert lines[0] == text


# -- places --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_places_of_the_trailers(count):
    """Jean 1996: singular where trailers 1 .. N-1 are at right angles to what pulls them;
    the last one does not matter."""
    singular = analysed(f"unicycle_{count}").places
    assert {place.words for place in singular.places} == {
        f"theta_{k} - theta_{k + 1} is an odd multiple of 90 degrees" for k in range(count - 1)
    }
    assert singular.complete


def test_growth_where_a_trailer_is_at_right_angles():
    growths = {place.words[:17]: place.growth for place in analysed("unicycle_2").places.places}
    assert growths == {"theta_0 - theta_1": (2, 3, 4, 4, 5)}


@pytest.mark.parametrize("name", ["labmate", "knife_edge", "vertical_disk", "car", "unicycle_1", "labmate_1"])
def test_no_place_where_the_growth_differs(name):
    singular = analysed(name).places
    assert not singular.places and singular.complete and singular.text() == ["nowhere, proved"]


def test_places_of_known_examples():
    """Grushin's plane and Martinet's distribution: R. Montgomery,
    A Tour of Subriemannian Geometries, 2002."""
    x, y, z = q = coordinates("x", "y", "z")
    grushin = analyse(Kinematics("grushin", (x, y), S=ca.horzcat(ca.vertcat(1, 0), ca.vertcat(0, x.symbol))))
    assert [(p.words, p.growth) for p in grushin.places.places] == [("x = 0", (1, 2))]
    martinet = analyse(Kinematics("martinet", q, A=ca.horzcat(-(y.symbol**2), 0, 1)))
    assert [(p.words, p.growth) for p in martinet.places.places] == [("y = 0", (2, 2, 3))]
    assert grushin.growth == (2,) and martinet.growth == (2, 3)


def test_places_where_constraints_depend_or_quasi_velocities_fail():
    x, y, z = q = coordinates("x", "y", "z")
    row = ca.horzcat(x.symbol * y.symbol, x.symbol, 0)
    (place,) = analyse(Kinematics("drop", q, A=row)).places.places
    assert place.words == "x = 0" and place.constraints_drop and not place.velocities_fail
    S = ca.horzcat(ca.vertcat(1 / x.symbol, -y.symbol / x.symbol, 0), ca.vertcat(0, 0, 1))
    (place,) = analyse(Kinematics("pole", q, A=ca.horzcat(y.symbol, 1, 0), S=S)).places.places
    assert place.words == "x = 0" and place.velocities_fail and not place.constraints_drop
    # A smaller set is not excluded: both rows of the slider crank depend where both rods stand upright.
    assert analysed("slider_crank").places.doubts == (("cos(crank)", "cos(rod)"),)


@pytest.mark.parametrize("by_constraints", [True, False])
def test_places_of_a_trailer_hitched_behind_the_axle(by_constraints):
    """C. Altafini, Int. J. Control 74(2), 2001 (general 1-trailer): with a hitch offset of the trailer's
    length the joint rate is (1 + cos) omega - sin v / L. It vanishes with the trailer folded onto the
    tractor, which no motion leaves; not when straight.
    """
    robot = systems.hitched(by_constraints)
    singular = analyse(robot).places
    (place,) = singular.places
    assert place.words == "t0 - t1 is an odd multiple of 180 degrees" and singular.complete
    assert place.growth[:3] == (2, 3, 3) and not place.whole and place.verified and place.at_defaults
    t0, t1 = sp.symbols("t0 t1")
    columns = [0, 0, 1, -sp.cos(t0 - t1)], [sp.cos(t0), sp.sin(t0), 0, sp.sin(t0 - t1)]
    fields = [sp.lambdify([sp.symbols("x y t0 t1")], column, "mpmath") for column in columns]
    with mpmath.workdps(DIGITS):
        for fold, growth in ((mpmath.mpf(0), (2, 3, 4)), (mpmath.pi, (2, 3, 3))):
            point = [mpmath.mpf("0.3"), mpmath.mpf("-0.7"), mpmath.mpf("1.1") + fold, mpmath.mpf("1.1")]
            assert numerical_growth(fields, point, 3) == growth


@pytest.mark.parametrize(
    "function, kind, words",
    [
        (lambda x: 2 * cos(x) + 3, systems.angle, []),
        (lambda x: x * x + x + 1, systems.length, []),
        (lambda x: x**4 + x + 1, systems.length, []),
        (lambda x: x**3 - 2, systems.length, ["x**3 - 2 = 0"]),
        (lambda x: 1 + cos(x), systems.angle, ["x is an odd multiple of 180 degrees"]),
        (lambda x: sin(x), systems.angle, ["x is a multiple of 180 degrees"]),
        (
            lambda x: 2 * sin(x) + cos(x) + 1,
            systems.angle,
            ["2*sin(x/2) + cos(x/2) = 0", "x is an odd multiple of 180 degrees"],
        ),
        (lambda x: x - 1000, systems.length, ["x - 1000 = 0"]),
    ],
)
def test_places_are_real(function, kind, words):
    """Only real zeros are places: f has them or not by its closed form; each is verified,
    and nothing else is left open."""
    singular = analyse(systems.grushin(function, kind)).places
    assert sorted(place.words for place in singular.places) == words and singular.complete
    for place in singular.places:
        double = (
            place.words.endswith("180 degrees")
            and function(math.pi) < 1e-9
            and abs(function(math.pi + 1e-4)) < 1e-7
        )
        assert place.growth == ((1, 1, 2) if double else (1, 2)) and place.verified and place.at_defaults


def test_a_place_for_other_parameters_only():
    """cos(x) + p with p = 2 is never zero; it is for p < 1."""
    p = quantity("p", "1", default=2.0, sign="positive")
    (place,) = analyse(systems.grushin(lambda x: cos(x) + p.symbol, systems.angle, p)).places.places
    assert place.verified and not place.at_defaults and "not for the default parameters" in place.text()


# -- theorems ------------------------------------------------------------------------------------------------


def verdicts(name: str) -> dict[tuple[str, str], bool | None]:
    return {(check.name, check.where): check.verdict for check in analysed(name).checks}


def test_theorems_for_the_labmate():
    """Theorems 1 to 3 on R^7, and on the leaf of dimension 6."""
    verdict = verdicts("labmate")
    for name in ("accessible", "controllable"):
        assert not verdict[name, SPACE] and verdict[name, LEAF]
    for name in ("asymptotically_stabilizable", "input_state_linearizable"):
        assert not verdict[name, SPACE] and not verdict[name, LEAF]
    assert verdict["lagrange_stable", SPACE]
    assert verdict["dynamic_feedback_linearizable", LEAF]  # Martin, Rouchon 1994: derived flag (2, 3, 4)
    assert [step.involutive for step in analysed("labmate").steps] == [True, False]
    assert "D_2 is not involutive" in analysed("labmate").check("input_state_linearizable").reason


def test_theorems_without_integrals():
    for name in ("knife_edge", "car", "unicycle_2"):
        verdict = verdicts(name)
        assert (
            verdict["accessible", SPACE]
            and verdict["controllable", SPACE]
            and verdict["dynamic_feedback_linearizable", SPACE]
        )
        assert (
            not verdict["asymptotically_stabilizable", SPACE]
            and not verdict["input_state_linearizable", SPACE]
        )
        assert all(where == SPACE for _, where in verdict)


@pytest.mark.parametrize(
    "robot, driven, dof, reached, controllable",
    [
        (lambda: systems.sleigh(0.3), 1, 2, 5, False),
        (lambda: systems.sleigh(0.0), 1, 2, 4, False),
        (systems.snakeboard, 2, 3, 8, True),
    ],
)
def test_underactuated_robots_are_judged_as_they_are_driven(robot, driven, dof, reached, controllable):
    """Chaplygin's sleigh: v' = d omega^2, so that with d = 0 no torque changes v (Neimark, Fufaev 1972). The
    snakeboard: locally accessible (J. Ostrowski, J. Burdick, Int. J. Robotics Research 17(7), 1998), and from
    rest small-time locally controllable (F. Bullo, A. D. Lewis, IEEE Trans. Robotics Autom. 19(3), 2003),
    which the sleigh is not. What feedback (12) would allow is not said, but that dynamic feedback does not
    linearize the sleigh, since static feedback does not and it has one input.
    """
    analysis = analyse(robot())
    assert (analysis.actuation.driven, analysis.actuation.dof, analysis.actuation.reached) == (
        driven,
        dof,
        reached,
    )
    assert analysis.check("accessible").verdict is (reached == 2 * analysis.n - analysis.m)
    assert analysis.check("controllable").verdict is controllable
    assert analysis.check("dynamic_feedback_linearizable").verdict is (False if driven == 1 else None)
    stable = analysis.check("lagrange_stable")
    assert stable.verdict is None and f"{driven} of {dof} quasi-velocities" in stable.reason
    assert "nu' = u" not in analysis.controlled and analysis.as_json()["properties_of"] == analysis.controlled


def test_a_robot_with_all_its_inputs_is_the_system_of_the_theorems():
    """Pushed too, the sleigh is (13) after feedback (12): accessible by numbers as by Theorem 1."""
    analysis = analyse(systems.sleigh(0.3, pushed=True))
    assert (
        analysis.actuation.full
        and analysis.actuation.reached == 5
        and analysis.controlled == "q' = S nu, nu' = u"
    )
    assert analysis.check("accessible").verdict and analysis.check("controllable").verdict


def test_theorems_with_only_holonomic_constraints():
    """On the leaf they are double integrators; on R^(2n-m) nothing moves the integrals."""
    for name in ("pendulum", "slider_crank"):
        verdict = verdicts(name)
        for question in (
            "accessible",
            "controllable",
            "asymptotically_stabilizable",
            "input_state_linearizable",
        ):
            assert not verdict[question, SPACE] and verdict[question, LEAF]
        assert all(step.involutive for step in analysed(name).steps)


@pytest.mark.parametrize("name", ["labmate", "knife_edge", "unicycle_1", "pendulum", "slider_crank"])
def test_second_step_is_involutive_as_said(name):
    """D_2 = span{g, [f, g]} of (13) on R^(2n-m), as a distribution of its own."""
    model = kinematics(SYSTEMS[name]())
    Delta = distribution(model)
    inputs = len(Delta.fields)
    S = model.S
    if S is None:
        symbols = (*Delta.functions.coordinates, *Delta.functions.parameters)
        entries = sp.lambdify(symbols, list(Delta.S.T), [{"sin": sin, "cos": cos}, "math"])
        S = ca.reshape(
            ca.vertcat(*entries(*[q.symbol for q in (*model.coordinates, *model.parameters)])),
            *Delta.S.T.shape[::-1],
        )
    extended = (*model.coordinates, *[quantity(f"nu_{k + 1}", "1/s") for k in range(inputs)])
    D2 = distribution(Kinematics("D2", extended, model.parameters, S=ca.diagcat(S, ca.SX.eye(inputs))))
    steps = linearization_steps(Delta)
    assert D2.growth[0] == steps[1].dimension and (len(D2.growth) == 1) == steps[1].involutive


# -- rolling contact: the same machinery on Montana's kinematics ---------------------------------------------


def rolling(contact: RollingContact | PlanarContact) -> Kinematics:
    q = tuple(Quantity(s.name(), "rad", symbol=s) for s in ca.vertsplit(contact.q))
    sizes = tuple(Quantity(s.name(), "m", sign="positive", symbol=s) for s in contact.parameters)
    return Kinematics(contact.name, q, sizes, contact.A, contact.basis)


@pytest.mark.nightly
def test_rolling_contacts():
    """Z. Li, J. Canny, IEEE Trans. Robotics Autom. 6(1), 1990 (spheres); A. Marigo, A. Bicchi,
    IEEE TAC 45(9), 2000."""
    R, r, a = (ca.SX.sym(name) for name in ("R", "r", "a"))
    contacts = {
        RollingContact(sphere(R), plane()): ((2, 3, 5), 0),
        RollingContact(sphere(R), sphere(r)): ((2, 3, 5), 0),
        RollingContact(sphere(R), sphere(R)): ((2,), 3),
        RollingContact(cylinder(R), cylinder(r)): ((2,), 3),
        RollingContact(torus(R, r), plane()): ((2, 3, 5), 0),
        RollingContact(ellipsoid(a, a, R), plane()): ((2, 3, 5), 0),
        RollingContact(ellipsoid(a, a, R), plane(), spin=True): ((3, 5), 0),
        PlanarContact(circle(R), line()): ((1,), 1),
    }
    for contact, expected in contacts.items():
        Delta = distribution(rolling(contact))
        assert (Delta.growth, Delta.holonomic) == expected, contact.name
    # Not flat: P. Martin, P. Rouchon 1994, the derived flag of two inputs would have to grow one by one.
    analysis = analyse(rolling(RollingContact(sphere(R), plane())))
    assert analysis.check("dynamic_feedback_linearizable").verdict is False
    (place,) = [
        p
        for p in places(distribution(rolling(RollingContact(torus(R, r), plane())))).places
        if not p.velocities_fail
    ]
    assert place.words == "u1 is an odd multiple of 90 degrees" and place.growth == (2, 2, 3, 5)


# -- what stands for what, and what is refused ---------------------------------------------------------------


@pytest.mark.parametrize(
    "value, exact",
    [
        (0.1, sp.Rational(1, 10)),
        (1 / 3, sp.Rational(1, 3)),
        (-9.80665, -sp.Rational(980665, 100000)),
        (1e-9, sp.Rational(1, 10**9)),
        (math.pi / 4, sp.pi / 4),
        (math.sqrt(2) / 2, sp.sqrt(2) / 2),
        (0.0, sp.Integer(0)),
        (0.12345678901234567, None),
    ],
)
def test_numbers(value, exact):
    assert recognized(value) == exact


def test_functions_of_angles_are_one():
    """Multiples, halves and shifts of an angle, constant roots, hyperbolic functions:
    what is zero is seen to be zero."""
    x, y, z = q = coordinates("x", "y", "z")
    zero = (
        (sin(2 * x.symbol) - 2 * sin(x.symbol) * cos(x.symbol))
        + (2 * cos(x.symbol / 2) ** 2 - cos(x.symbol) - 1)
        + (math.sqrt(2) * cos(x.symbol + math.pi / 4) - cos(x.symbol) + sin(x.symbol))
        + (ca.cosh(y.symbol) ** 2 - ca.sinh(y.symbol) ** 2 - 1)
        + (sqrt(z.symbol) * sqrt(x.symbol) - sqrt(x.symbol * z.symbol))
        + (sin(x.symbol - y.symbol) - sin(x.symbol) * cos(y.symbol) + cos(x.symbol) * sin(y.symbol))
    )
    analysis = analyse(Kinematics("zero", q, A=ca.horzcat(zero, 1, 0)))
    assert analysis.k == 1 and analysis.holonomic.integrals[0].text() == "y = const"


def test_sine_and_exponential_of_the_same_multiple():
    x, y, z = q = coordinates("x", "y", "z")
    a = x.symbol
    zero = ca.exp(2 * a) * sin(2 * a) - 2 * ca.exp(a) ** 2 * sin(a) * cos(a)
    assert (
        analyse(Kinematics("zero", q, A=ca.horzcat(zero, 1, 0))).holonomic.integrals[0].text() == "y = const"
    )


def test_root_of_a_square_is_taken_to_be_positive_and_said():
    x, y, z = q = coordinates("x", "y", "z")
    assert analyse(
        Kinematics("root", q, A=ca.horzcat(sqrt(1 - sin(z.symbol) ** 2), sin(z.symbol), 0))
    ).assumed == ("cos(z)",)


@pytest.mark.parametrize(
    "row, message",
    [
        (lambda x, y, z: (ca.atan(x), 1, 0), "cannot be treated exactly"),
        (lambda x, y, z: (sin(sin(x)), 1, 0), "not rational"),
        (lambda x, y, z: (0.12345678901234567 * x, 1, 0), "no simple fraction"),
        (lambda x, y, z: (1 / (x - x), 1, 0), "division by zero"),
        (lambda x, y, z: (sqrt(-1 - x**2), 1, 0), "negative"),
        (lambda x, y, z: (sqrt(1 - cos(z)), sqrt(1 + cos(z)), sin(z)), "without this root"),
        (lambda x, y, z: (0, 0, 0), "not independent: 'constraint 1'"),
        (lambda x, y, z: (ca.SX.sym("w"), 1, 0), "uses w"),
    ],
)
def test_refused_functions(row, message):
    q = coordinates("x", "y", "z")
    with pytest.raises(ModelError, match=message) as error:
        analyse(Kinematics("bad", q, A=ca.horzcat(*row(*[c.symbol for c in q]))))
    assert "\n" not in str(error.value)


def test_refused_systems():
    x, y, z, w = q = coordinates("x", "y", "z", "w")
    a, b = x.symbol, y.symbol
    unit = ca.SX.eye(4)
    wrong = [
        (
            {"A": ca.vertcat(ca.horzcat(a, 1, b, 0), ca.horzcat(a, 1, b, 0) * sin(b) ** 2)},
            "'constraint 2' follows from the others",
        ),
        (
            {"A": ca.horzcat(1, 0, 0, 0), "S": unit[:, 1:] + ca.horzcat(unit[:, 0], ca.SX(4, 2))},
            "A S is not zero",
        ),
        ({"S": ca.horzcat(ca.vertcat(1, b, 0, 0), ca.vertcat(a, a * b, 0, 0))}, "columns of S depend"),
        ({"A": ca.horzcat(1, 0, 0)}, "must be m x n"),
        ({"A": ca.horzcat(1, 0, 0, 0), "S": unit[:, :2]}, "must be n x"),
        ({}, "neither"),
    ]
    for matrices, message in wrong:
        with pytest.raises(ModelError, match=message):
            distribution(Kinematics("bad", q, **matrices))
    with pytest.raises(ModelError, match="no coordinates"):
        Kinematics("bad", (), S=ca.SX(0, 1))
    with pytest.raises(ModelError, match="used twice"):
        Kinematics("bad", (x, y, quantity("x", "m")), S=unit[:3, :2])
    with pytest.raises(ModelError, match="requires coordinates and constraints"):
        analyse(Mechanism("empty"))


# -- mechanisms, output --------------------------------------------------------------------------------------


def test_a_mechanism_and_its_reduction_are_the_same_system():
    one, other = analyse(labmate()), analyse(reduce(labmate()))
    assert one.as_json() == other.as_json()


def test_a_mechanism_needs_no_energy_or_inputs():
    robot = Mechanism("blade")
    x, y, phi = robot.coordinate("x", "m"), robot.coordinate("y", "m"), robot.coordinate("phi", "rad")
    robot.rolls("across", cos(phi) * robot.rate(y) - sin(phi) * robot.rate(x))
    assert analyse(robot).growth == (2, 3)


def test_json_and_text():
    analysis = analysed("labmate")
    data = analysis.as_json()
    assert (data["constraints"], data["holonomic"], data["nonholonomic"], data["growth"]) == (
        3,
        1,
        2,
        [2, 3, 4],
    )
    assert data["integrals"] == ["phi = r*(theta_r - theta_l)/(2*b) + const"]
    assert data["input_state_linearizable"] is False
    text = analysis.text()
    assert "3 constraints: 1 holonomic, 2 nonholonomic" in text and text.isascii()
    for check in analysis.checks:
        assert check.hypotheses and check.text() in text


def test_factors_by_half_angles_are_the_function():
    """Each factor vanishes where its expression in coordinates does, and their product is the function,
    to 1e-12."""
    Delta = distribution(systems.grushin(lambda x: sin(x) * (2 * sin(x) + cos(x) + 1), systems.angle))
    (polynomial,) = [part for part in Delta.fields[1].below if not Delta.functions.is_constant(part)]
    forms = factors(Delta.functions, polynomial)
    assert sum(power for _, power in forms) == 4 and len(forms) == 3  # C^2 S (C + 2 S)
    x = Delta.functions.coordinates[0]
    product = sp.prod(half_angles(Delta.functions, form) ** power for form, power in forms)
    ratio = sp.lambdify(x, product / Delta.functions.expression(polynomial), "math")
    assert np.ptp([ratio(value) for value in np.random.default_rng(2).uniform(-3, 3, 9)]) < 1e-12


def test_analyse_leaves_no_progress_behind(monkeypatch):
    """What is asked of the functions after an analysis is not shown as its progress."""
    model = SYSTEMS[next(iter(SYSTEMS))]()
    used, told = [distribution(model)], []
    monkeypatch.setattr("noslip.analysis.distributions.analysis.distribution", lambda _: used[0])
    analyse(model, lambda *each: told.append(each))
    before = len(told)
    used[0].functions.progress(1, 2, "terms")
    assert len(told) == before
