"""Flatness: verdicts as in the literature, flat outputs and chained forms against motions that are
integrated."""

import random
from collections.abc import Callable

import casadi as ca
import mpmath
import numpy as np
import pytest
import sympy as sp
from noslip import linearize, output_map, reduce
from noslip.analysis.answers import analyse, as_json
from noslip.analysis.distributions.distribution import distribution, part
from noslip.analysis.exact.functions import Functions
from noslip.analysis.exact.half_ratios import HalfRatios, exact_quotient
from noslip.analysis.exact.symbolic import written
from noslip.analysis.flatness import flatness as room
from noslip.analysis.flatness.chained import flat_pair
from noslip.analysis.flatness.flatness import Flatness, flatness
from noslip.analysis.text import as_text
from noslip.model import Mechanism
from noslip.model.robots import ROBOTS
from noslip.model.rolling.kinematics import Kinematics
from noslip.readers.robots import find_robot
from noslip.tests.analysis.test_verdicts import (
    bicycle,
    car_and_trailer,
    falling_disk,
    hitched,
    kingpins,
    snake,
    two_steered,
)
from noslip.tests.reference.kinematic_systems import (
    angle,
    car,
    knife_edge,
    labmate_with_trailers,
    length,
    trailers,
    vertical_disk,
)
from scipy.optimize import fsolve

YES, NO = True, False
FLAG = "Martin, Rouchon 1994"
TRAILERS = "Rouchon, Fliess, Levine, Martin 1993; O. J. Sordalen 1993: the middle of the last axle"
ENGEL = "Sekhavat, Rouchon, Hermosillo 2001: flat; the outputs are no elementary functions of low degree"
CODIMENSION = "Martin, Rouchon, CDC 1995"

# robot: (verdict, outputs are found) with all coordinates, and without the angles of wheels, None if there
# are none; source
Expected = tuple[tuple[bool, bool], tuple[bool, bool] | None, str]
SHIPPED: dict[str, Expected] = {
    "knife_edge": ((YES, YES), None, FLAG),
    "labmate": ((YES, YES), (YES, YES), FLAG),
    "pioneer_3dx": ((YES, YES), (YES, YES), FLAG),
    "rolling_disk": ((YES, YES), (YES, YES), FLAG),
    "car": ((YES, YES), (YES, YES), TRAILERS),
    "tricycle": ((NO, NO), (YES, YES), f"{FLAG}: flag (2, 3, 5) with the angle of the wheel"),
    "forklift": ((NO, NO), (YES, YES), f"{FLAG}, as the tricycle"),
    "bus": ((NO, NO), (YES, NO), ENGEL),
    "four_wheel": ((NO, NO), (YES, NO), f"{FLAG}: four dimensions without the wheels"),
    "castor_platform": ((NO, NO), (NO, NO), f"{FLAG}: each castor adds an angle as an off-axle trailer"),
    "ball_plate": ((NO, NO), (YES, YES), f"{FLAG}: a rolling ball has the flag (2, 3, 5)"),
    "mecanum": ((YES, NO), (YES, YES), CODIMENSION),
    "mobile_manipulator": ((YES, YES), (YES, YES), CODIMENSION),
    "geared_arm": ((YES, YES), None, "as many inputs as dimensions"),
    "tractor_trailer": ((NO, NO), (YES, YES), TRAILERS),
}
UNSEEN: dict[str, tuple[Callable[[], Kinematics], Expected]] = {
    "unicycle": (knife_edge, ((YES, YES), None, FLAG)),
    "coin": (vertical_disk, ((YES, YES), (YES, YES), FLAG)),
    "car": (car, ((YES, YES), None, TRAILERS)),
    "bicycle": (bicycle, ((YES, YES), None, TRAILERS)),
    "unicycle with a trailer": (lambda: trailers(1), ((YES, YES), None, TRAILERS)),
    "unicycle with two trailers": (lambda: trailers(2), ((YES, YES), None, TRAILERS)),
    "platform with a trailer": (lambda: labmate_with_trailers(1), ((NO, NO), (YES, YES), TRAILERS)),
    "car with a trailer": (lambda: car_and_trailer(0.0), ((YES, YES), None, TRAILERS)),
    "trailer with a kingpin": (
        hitched,
        ((YES, NO), None, "Rouchon et al. 1993: flat by elliptic functions of the hitch angle"),
    ),
    "trailers with kingpins": (kingpins, ((NO, NO), None, f"{FLAG}; Rouchon et al. 1993")),
    "three links with wheels": (snake, ((NO, NO), None, FLAG)),
    "bicycle with two steered wheels": (two_steered, ((YES, NO), None, CODIMENSION)),
    "disk that may fall": (falling_disk, ((YES, YES), (YES, YES), CODIMENSION)),
}
LONG = (
    "car with a trailer",
    "unicycle with two trailers",
    "trailer with a kingpin",
    "trailers with kingpins",
)


def judged(system: Mechanism | Kinematics) -> tuple[Flatness, ...]:
    names = [q.name for q in system.quasi_velocities] if isinstance(system, Mechanism) else []
    return flatness(distribution(system), names)


def summed_up(verdicts: tuple[Flatness, ...]) -> tuple[tuple[bool | None, bool], ...]:
    return tuple((each.check.verdict, each.found is not None) for each in verdicts)


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_robots_are_flat_as_in_the_literature(name):
    whole, without, _ = SHIPPED[name]
    assert summed_up(judged(find_robot(name))) == ((whole, without) if without else (whole,))


@pytest.mark.parametrize(
    "name", [pytest.param(each, marks=pytest.mark.nightly) if each in LONG else each for each in UNSEEN]
)
def test_unseen_robots_are_flat_as_in_the_literature(name):
    make, (whole, without, _) = UNSEEN[name]
    assert summed_up(judged(make())) == ((whole, without) if without else (whole,))


# -- outputs -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name, whole, outputs, singular",
    [
        ("labmate", False, ["x_c - d*cos(phi)", "y_c - d*sin(phi)"], ["thetadot_l + thetadot_r = 0"]),
        (
            "labmate",
            True,
            ["phi", "x_c*cos(phi) + y_c*sin(phi) - r*theta_r"],
            ["thetadot_l - thetadot_r = 0"],
        ),
        ("car", False, ["x", "y"], ["thetadot = 0", "delta is an odd multiple of 90 degrees"]),
        (
            "tractor_trailer",
            False,
            ["x - l_1*cos(phi_1)", "y - l_1*sin(phi_1)"],
            ["thetadot_l + thetadot_r = 0", "phi - phi_1 is an odd multiple of 90 degrees"],
        ),
    ],
)
def test_outputs_are_the_points_of_the_literature(name, whole, outputs, singular):
    found = judged(find_robot(name))[0 if whole else 1].found
    assert [written(output.expression) for output in found.outputs] == outputs
    assert list(found.singular) == singular


@pytest.mark.parametrize("count", [1, 2])
def test_the_last_trailer_has_the_output(count):
    found = judged(trailers(count))[0].found
    names = {str(s) for output in found.outputs for s in output.expression.free_symbols}
    assert f"theta_{count}" in names and "theta_0" not in names
    assert any(
        f"theta_{count - 1} - theta_{count} is an odd multiple of 90 degrees" == each
        for each in found.singular
    )


def with_flat_law(name: str, which: int) -> Mechanism:
    """The robot with the line of the analysis in its file."""
    robot, found = ROBOTS[name](), judged(find_robot(name))[which].found
    known = {q.name: q.symbol for q in (*robot.coordinates, *robot.parameters)}
    exec(found.line, {"robot": robot, "sin": ca.sin, "cos": ca.cos, **known})
    return robot


@pytest.mark.parametrize(
    "name, which, rest",
    [
        ("labmate", 0, [0, 0, 0.3, 2.0, 0, 1.5, 1.5]),
        ("labmate", 1, [0, 0, 0.3, 0, 0, 1.5, -1.5]),
        ("car", 1, None),
    ],
)
def test_the_line_is_a_law_without_zero_dynamics(name, which, rest):
    """Dynamic extension leaves nothing: the degrees are all states that are judged, and those that were
    added. Where the outputs are said to rest its Phi is singular, at random states it is regular."""
    robot = with_flat_law(name, which)
    system = reduce(robot)
    law = linearize(system, output_map(system, "flat_extended"))
    dropped = {0: 0, 1: len(judged(find_robot(name))[1].without)}[which]
    holonomic = 1 if name == "labmate" and which == 0 else 0
    states = len(robot.coordinates) - dropped - holonomic + system.dof
    assert sum(law.relative_degree) == states + len(law.extension)
    inputs = [
        ca.vertcat(*[q.symbol for q in system.state]),
        ca.vertcat(*[q.symbol for q in law.extension]),
        robot.p,
    ]
    determinant = ca.Function("det", inputs, [ca.det(law.Phi)])
    draw, p = np.random.default_rng(3), [q.default for q in robot.parameters]
    xi = draw.uniform(0.5, 1.0, len(law.extension))
    sizes = [abs(float(determinant(draw.uniform(0.2, 1.0, len(system.state)), xi, p))) for _ in range(5)]
    assert min(sizes) > 1e-6
    resting = draw.uniform(0.2, 1.0, len(system.state)) if rest is None else np.array(rest, float)
    if rest is None:
        resting[[q.name for q in system.state].index("thetadot")] = 0.0
    assert abs(float(determinant(resting, xi, p))) < 1e-9 * min(sizes)


# -- motions -------------------------------------------------------------------------------------------------


NODES = 16  # of the polynomials through the outputs
DIGITS = 40  # each derivative loses some two of them
MOTIONS: list[tuple[str, Callable[[], Mechanism | Kinematics], int]] = [
    ("labmate", lambda: find_robot("labmate"), 0),
    ("labmate without wheels", lambda: find_robot("labmate"), 1),
    ("car", lambda: find_robot("car"), 0),
    ("car without wheel", lambda: find_robot("car"), 1),
    ("trailer", lambda: find_robot("tractor_trailer"), 1),
    ("ball", lambda: find_robot("ball_plate"), 1),
    ("coin", vertical_disk, 0),
    ("bicycle", bicycle, 0),
]


def differentiation_matrix(nodes: list[mpmath.mpf]) -> np.ndarray:
    """Return the matrix that gives the derivatives of the polynomial through values at the nodes,
    by barycentric weights."""
    count = range(len(nodes))
    weights = [1 / mpmath.fprod(nodes[j] - nodes[k] for k in count if k != j) for j in count]
    D = np.array(
        [[weights[k] / weights[j] / (nodes[j] - nodes[k]) if j != k else 0 for k in count] for j in count],
        object,
    )
    D[np.diag_indices_from(D)] = -D.sum(axis=1)
    return D


@pytest.mark.parametrize("make, which", [pytest.param(*each, id=name) for name, *each in MOTIONS])
def test_the_outputs_along_a_motion_give_the_state(make, which):
    """q' = S nu with random nu(t) is integrated. From z_1(t) and z_N(t) alone, by derivatives of polynomials
    through them, the ratios of rates are the formulas z_k(q); where there are no integrals, the equations
    z(q) = z have the solution q."""
    system = make()
    Delta = distribution(system)
    verdict = judged(system)[which]
    kept = [k for k, q in enumerate(Delta.coordinates) if q.name not in verdict.without]
    parameters = list(Delta.functions.parameters)
    numbers = [q.default or 1.0 for q in Delta.parameters]
    draw = np.random.default_rng(5)
    speeds = draw.uniform(0.4, 0.9, (2, Delta.S.cols))
    variables = [*Delta.functions.coordinates, *parameters]
    S = sp.lambdify(variables, Delta.S, "mpmath")
    start = draw.uniform(0.3, 0.9, Delta.functions.n)
    end = 0.04 if Delta.name == "ball_plate" else 0.4  # s; the ball is small and turns fast
    with mpmath.workdps(DIGITS):

        def rates(t: mpmath.mpf, q: list[mpmath.mpf]) -> list[mpmath.mpf]:
            nu = [a + mpmath.sin(b * t + k) / 5 for k, (a, b) in enumerate(speeds.T.tolist())]
            return list(S(*q, *numbers) * mpmath.matrix(nu))

        nodes = [
            end / 2 * (1 - mpmath.cos(mpmath.pi * (k + mpmath.mpf("0.5")) / NODES)) for k in range(NODES)
        ]
        motion = mpmath.odefun(rates, 0, start.tolist(), tol=mpmath.mpf(10) ** -30)
        q = np.array([motion(t) for t in nodes], object).T
        z = [sp.lambdify(variables, each, "mpmath") for each in verdict.found.chained]
        formulas = np.array([[each(*column, *numbers) for column in q.T] for each in z])
        derivative = differentiation_matrix(nodes)
        first = derivative @ formulas[0]
        measured = [formulas[-1]]
        for _ in range(len(z) - 2):
            measured.append((derivative @ measured[-1]) / first)
    q, formulas, measured = q.astype(float), formulas.astype(float), [each.astype(float) for each in measured]
    middle = slice(NODES // 4, 3 * NODES // 4)
    for k, each in enumerate(measured[1:]):
        expected = formulas[-2 - k][middle]
        assert each[middle] == pytest.approx(expected, rel=1e-6, abs=1e-6)
    if Delta.holonomic or len(kept) != len(z):
        return
    t = NODES // 2
    target = np.array([formulas[0, t], *[each[t] for each in reversed(measured)]])

    def misses(part_of_q: np.ndarray) -> np.ndarray:
        state = q[:, t].copy()
        state[kept] = part_of_q
        return np.array([float(each(*map(mpmath.mpf, state), *numbers)) for each in z]) - target

    solved = fsolve(misses, q[kept, t] + draw.uniform(-0.02, 0.02, len(kept)), xtol=1e-13)
    assert solved == pytest.approx(q[kept, t], abs=1e-5)


# -- what is not proved --------------------------------------------------------------------------------------


AHEAD = "(cos(theta_0)*cos(theta_0 - theta_1) + sin(theta_0)*sin(theta_0 - theta_1))"  # cosine of theta_1
ASIDE = "(sin(theta_0)*cos(theta_0 - theta_1) - cos(theta_0)*sin(theta_0 - theta_1))"


def pair_of(Delta, first: str, last: str):
    symbols = {str(s): s for s in Delta.functions.symbols}
    return [Delta.functions.ratio(sp.sympify(text, locals=symbols)) for text in (first, last)]


@pytest.mark.parametrize(
    "make, first, last",
    [
        (knife_edge, "x", "phi"),
        # Ahead of the axle: all of the motion but the heading's start
        (knife_edge, "x + cos(phi)", "y + sin(phi)"),
        (knife_edge, "x", "x**2"),
        (car, "x + L*cos(phi)", "y + L*sin(phi)"),  # above the front wheel
        (car, "phi", "delta"),
        (lambda: trailers(1), "x", "y"),  # the tractor's axle: the trailer's angle is not determined
        (lambda: trailers(1), f"x - L_1/2*({AHEAD})", f"y - L_1/2*({ASIDE})"),  # half way to the axle
    ],
)
def test_other_outputs_are_not_proved(make, first, last):
    Delta = distribution(make())
    assert flat_pair(Delta, *pair_of(Delta, first, last)) is None


@pytest.mark.parametrize(
    "make, first, last",
    [
        (knife_edge, "phi", "x*sin(phi) - y*cos(phi)"),
        (knife_edge, "x + y", "y"),
        (car, "y", "x"),
        (lambda: trailers(1), f"x - L_1*({AHEAD})", f"y - L_1*({ASIDE})"),
    ],
)
def test_flat_outputs_are_proved(make, first, last):
    Delta = distribution(make())
    assert flat_pair(Delta, *pair_of(Delta, first, last)) is not None


def disguised(seed: int, generic: bool = False) -> Kinematics:
    """The chained form of dimension 5 in other coordinates: q = polynomials of z with a triangular Jacobian
    matrix, in an order that is not that of z. `generic`: a term is added with which the flag is (2, 3, 5)."""
    draw = random.Random(seed)
    q = [length(f"q_{k}") for k in range(5)]
    shifts = [0] + [sum(draw.choice([-1, 0, 1]) * q[j].symbol ** 2 for j in range(k)) for k in range(1, 5)]
    z = [each.symbol - shift for each, shift in zip(q, shifts, strict=True)]  # z as functions of q
    last = ca.horzcat(z[3], z[2] if generic else 0)
    rates = ca.vertcat(ca.horzcat(1, 0), ca.horzcat(0, 1), ca.horzcat(z[1], 0), ca.horzcat(z[2], 0), last)
    symbols = ca.vertcat(*[each.symbol for each in q])
    inverse = ca.inv(ca.jacobian(ca.vertcat(*z), symbols))
    order = draw.sample(range(5), 5)
    S = ca.simplify(inverse @ rates)
    return Kinematics("disguised", tuple(q[k] for k in order), S=S[order, :])


@pytest.mark.parametrize("seed", range(4))
def test_verdicts_do_not_depend_on_coordinates(seed):
    assert judged(disguised(seed))[0].check.verdict is True
    assert judged(disguised(seed, generic=True))[0].check.verdict is False


def test_what_is_not_found_within_the_bound_is_said(monkeypatch):
    monkeypatch.setattr(room, "WORK", 3000)
    Delta = distribution(trailers(1))
    assert Delta.derived.growth == (2, 3, 4)
    (verdict,) = flatness(Delta)
    assert verdict.check.verdict is True and verdict.found is None
    assert verdict.missing == "not found within 3,000 terms of polynomials"


# -- what users see ------------------------------------------------------------------------------------------


def test_text_and_json_of_an_analysis():
    answer = analyse(find_robot("labmate"), ["type_i"])
    said, values = as_text(answer), as_json(answer)
    assert "Flat outputs of q' = S nu" in said and "Martin, P. Rouchon" in " ".join(said.split())
    assert (
        'robot.output("flat", "flat outputs", [("flat_1", "m", x_c - d*cos(phi)), ("flat_2", "m", y_c - '
        "d*sin(phi))])" in " ".join(said.split())
    )
    assert [(each["without"], each["verdict"]) for each in values["flatness"]] == [
        ([], True),
        (["theta_r", "theta_l"], True),
    ]
    assert values["flat_outputs"][1]["outputs"] == ["x_c - d*cos(phi)", "y_c - d*sin(phi)"]
    assert values["flat_outputs"][1]["chained_form"][1] == "sin(phi)/cos(phi)"


def test_a_robot_with_fewer_inputs_has_no_verdict():
    answer = analyse(find_robot("sleigh"), [])
    assert (
        "no verdict: the theorems are about q' = S nu with all of nu driven, the inputs drive 1 of 2"
        in " ".join(as_text(answer).split())
    )
    assert as_json(answer)["flatness"] == []


# -- arithmetic ----------------------------------------------------------------------------------------------


def test_ratios_of_half_angles_are_the_functions():
    """Values and rates at random points, against SymPy's derivatives."""
    x, a, b, L = sp.symbols("x a b L", real=True)
    expressions = [
        sp.sin(a) * sp.cos(b) - L * x,
        (1 - sp.cos(a)) * (1 + sp.sin(b) ** 2),
        sp.sin(a) * (2 + sp.cos(a - b)),
    ]
    functions = Functions("ratios", [x, a, b], [L], expressions)
    half, draw = HalfRatios(functions), random.Random(2)
    field = [sp.cos(a), L * sp.sin(b), 1 + x * sp.cos(b)]
    rates = half.rates(tuple(functions.ratio(sp.sympify(entry))[0] for entry in field))
    at = {x: 0.4, a: 1.1, b: -0.7, L: 1.3}

    def value(ratio):
        return float(functions.quotient(*half.whole(ratio)).subs(at))

    for _ in range(4):
        one, other = draw.sample(expressions, 2)
        ratio = half.over(half.ratio(functions.ratio(one)), half.ratio(functions.ratio(other)))
        assert value(ratio) == pytest.approx(float((one / other).subs(at)), rel=1e-12)
        rate = sum(sp.diff(one / other, q) * entry for q, entry in zip((x, a, b), field, strict=True))
        assert value(half.rate(rates, ratio)) == pytest.approx(float(rate.subs(at)), rel=1e-10)
    plain = half.over(half.ratio(functions.ratio(sp.sin(a) ** 2)), half.ratio(functions.ratio(1 - sp.cos(a))))
    # (C^2 + S^2) only: no pole at a = 0
    assert value(plain) == pytest.approx(1 + np.cos(1.1)) and len(plain.below) == 1


def test_exact_quotients_are_those_of_sympy():
    R, *gens = sp.ring("x y z", sp.ZZ)
    draw = random.Random(1)

    def polynomial(terms: int):
        return sum(
            (draw.randint(-4, 4) or 1) * sp.prod([g ** draw.randint(0, 3) for g in gens])
            for _ in range(terms)
        ) + R(1)

    for _ in range(30):
        a, b = polynomial(6), polynomial(3)
        assert exact_quotient(a * b, b) == a
        assert exact_quotient(a * b + 1, b) == (None if (a * b + 1).rem(b) else (a * b + 1).exquo(b))


def test_a_part_has_its_own_coordinates():
    Delta = distribution(find_robot("labmate"))
    rest = part(Delta, [0, 1, 2], range(2))
    assert [q.name for q in rest.coordinates] == ["x_c", "y_c", "phi"] and rest.growth == (2, 3)
    assert angle("phi").unit == Delta.coordinates[2].unit
