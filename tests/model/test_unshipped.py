"""Robots that are not shipped: their C against projected Newton-Euler, inputs that lose a direction,
and verdicts."""

import math
import re
from dataclasses import replace
from functools import partial

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from noslip.analysis.answers import analyse, singular_when
from noslip.analysis.distributions.actuation import actuation
from noslip.analysis.exact.readable import readable
from noslip.analysis.outputs import normal_form as forms
from noslip.analysis.outputs.confirmation import confirm
from noslip.analysis.outputs.decoupling import OWN, decouple
from noslip.checks.verification.generate import rejected
from noslip.codegen.files import has_follower, robot_files
from noslip.model import Mechanism, control_law, linearize, reduce
from noslip.model.algebra.expression import largest
from noslip.model.outputs import output_map
from noslip.readers.errors import Contradiction
from noslip.readers.robots import find_laws, law_of, system_of
from noslip.simulation.controllers.backends import make_controller
from noslip.simulation.controllers.build import DoesNotCompile, check_links
from noslip.simulation.controllers.controller import BACKENDS
from noslip.tests import robots_of_users
from noslip.tests.random_robots import mechanism, states, truth
from noslip.tests.unshipped import (
    AT,
    DESCRIBED,
    PHI,
    castor,
    castor_wheel,
    loader,
    off_axle,
    pendulum_disk,
    rear_of_loader,
    rotor,
    trailer_of_off_axle,
    trident,
    two_steered,
    with_output,
)

later = partial(pytest.param, marks=pytest.mark.nightly)
PARALLEL = (np.pi, np.pi / 3, 5 * np.pi / 3)  # rad, legs of the trident that all trail


# -- the equations -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "described", [later(each) if each in (trident, castor) else each for each in DESCRIBED]
)
def test_the_equations_are_those_of_newton_and_euler(described):
    """S'MS, the bias, S'E and, where a robot has outputs of its own, Phi and tau,
    in 40 digits without noslip."""
    robot = described()
    system = reduce(mechanism(robot), partially=True)
    groups = [system.mechanism.q, system.nu, system.mechanism.p]
    names = ("Mbar", "bias", "input_map")
    function = ca.Function("f", groups, [ca.densify(getattr(system, name)) for name in names])
    for state in states(robot, 3):
        right = truth(robot, state, [q.name for q in system.quasi_velocities])
        for name, value in zip(names, function(state.q, state.nu, state.p), strict=True):
            exact = right[name]
            np.testing.assert_allclose(
                value.full().reshape(exact.shape), exact, atol=1e-12 * max(1.0, np.abs(exact).max())
            )


# -- inputs that lose a direction ----------------------------------------------------------------------------


def status(backend: str, law, state: np.ndarray) -> str:
    """Of a step."""
    params, gains = ([q.default for q in group] for group in (law.parameters, law.gains))
    reference = np.linspace(0.1, 0.9, len(law.reference))
    return make_controller(backend, law, params, [], gains).step(state, reference)[0]


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_crank_at_its_dead_centre_is_singular(backend):
    """The force acts by cos(a): it would have to be infinite, though Phi is the identity."""
    law = control_law(system := reduce(robots_of_users.crank()), output_map(system, "place"))
    for a in (np.pi / 2, -np.pi / 2, 3 * np.pi / 2):
        for off, right in ((0.0, "singular"), (1e-3, "ok"), (-1e-3, "ok")):
            assert status(backend, law, np.array([0.3, a + off, 0.0, 0.2, 0.1])) == right


@pytest.mark.parametrize("backend", ["casadi", later("c"), later("cf")])
def test_legs_that_trail_until_they_lose_a_direction_are_singular(backend):
    """S'E has rank 2 there by its singular values, and 3 where one leg is turned a little."""
    law = control_law(system := reduce(mechanism(trident())), output_map(system, "own"))
    S_E = ca.Function("S_E", [system.mechanism.q, system.mechanism.p], [system.input_map])
    for turned, right in ((0.0, "singular"), (1e-2, "ok")):
        state = np.array([0.3, -0.2, 0.4, PARALLEL[0], PARALLEL[1] + turned, PARALLEL[2], 0.1, 0.2, 0.3])
        sizes = np.linalg.svd(S_E(state[:6], [p.default for p in law.parameters]).full(), compute_uv=False)
        assert (sizes[-1] < 1e-14 * sizes[0]) == (right == "singular") and sizes[1] > 0.1 * sizes[0]
        assert status(backend, law, state) == right


def test_analyse_says_where_inputs_lose_a_direction():
    assert singular_when(analyse(robots_of_users.crank(), ["place"]).outputs["place"]) == [
        "inputs lose a direction: a is an odd multiple of 90 degrees (cos(a) = 0)"
    ]


@pytest.mark.nightly
def test_the_formula_vanishes_where_all_legs_trail():
    (condition,) = analyse(mechanism(trident()), ["own"]).outputs["own"].decoupling.conditions
    assert condition.confirmed and condition.words == "inputs lose a direction"
    # Not the heading
    assert {str(s) for s in condition.formula.free_symbols} == {"p_0", "p_1", "leg_1", "leg_2", "leg_3"}

    def formula(leg_2: float) -> float:
        values = dict(p_0=0.4, p_1=0.6, leg_1=PARALLEL[0], leg_2=leg_2, leg_3=PARALLEL[2])
        return float(
            condition.formula.evalf(subs={s: values[str(s)] for s in condition.formula.free_symbols})
        )

    assert abs(formula(PARALLEL[1])) < 1e-12 < 0.01 < abs(formula(PARALLEL[1] + 0.1))


def test_a_bound_of_an_expression_is_one():
    """At random points the entries are within it, and a sine counts as 1."""
    x = ca.SX.sym("x", 3)
    expression = ca.vertcat(
        x[0] * ca.sin(x[1]) - x[2], ca.cos(x[0]) / (2 + x[1] ** 2), ca.sqrt(x[2] ** 2 + 1) - 3
    )
    function = ca.Function("f", [x], [expression, largest(expression)])
    for point in np.random.default_rng(3).uniform(-2, 2, (50, 3)):
        value, bound = (part.full().ravel() for part in function(point))
        assert (np.abs(value) <= bound + 1e-15).all()
        np.testing.assert_allclose(bound[0], abs(point[0]) + abs(point[2]), atol=1e-14)


# -- C that is handed out compiles ---------------------------------------------------------------------------


def law_of_follower(make):
    return law_of(system_of(make()), "type_iv_segment")


def test_a_robot_without_parameters_has_a_follower_that_compiles():
    law = law_of_follower(robots_of_users.two_wheels)
    files = robot_files(law.system, [law], ("float",))
    assert has_follower(law) and "two_wheels_follower_f.c" in files
    check_links(files)


def test_a_robot_whose_law_depends_on_its_place_has_no_follower():
    """Its law at the foot of a path would not know the place."""
    law = law_of_follower(robots_of_users.in_wind)
    assert not has_follower(law)
    assert not [name for name in robot_files(law.system, [law], ("double",)) if "follower" in name]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("int a(void)\n{\n    return b_follow();\n}\n", "b_follow"),
        ("int b_follow(void);\nint a(void)\n{\n    return b_follow();\n}\n", "b_follow"),
        ("int a(void)\n{\n    if () {\n        return 1;\n    }\n    return 0;\n}\n", "expected expression"),
    ],
)
def test_what_does_not_compile_or_link_is_refused(text, says):
    """Undeclared, declared but not defined, and no C."""
    check_links({"a.c": "int a(void)\n{\n    return 0;\n}\n"})
    with pytest.raises(DoesNotCompile, match=says):
        check_links({"a.c": text})
    assert re.search(says, rejected({"a.c": text}))


# -- zero dynamics of points of other bodies -----------------------------------------------------------------


def form_of(robot: Mechanism, law: str) -> forms.NormalForm:
    system = reduce(robot)
    return forms.normal_form(decouple(linearize(system, output_map(system, law))))


p_0, v = sp.Symbol("p_0", positive=True), sp.Symbol("v")
phi, psi, gamma, n_x = (sp.Symbol(name, real=True) for name in ("phi", "psi", "gamma", "n_x"))
# Robot, point, joint, its rate with the motion of the point held, by hand, the way it is stable, where it
# goes
HELD = {
    "loader": (loader, rear_of_loader, "gamma", sp.sin(gamma) / p_0, -1, "gamma -> 0"),
    "off_axle": (off_axle, trailer_of_off_axle, "phi", sp.sin(phi - psi) / p_0, -1, "phi -> psi_"),
    "castor": (castor, castor_wheel, "n_x", -sp.sin(n_x) / p_0, 1, "n_x -> 0"),
}


def held(name: str) -> tuple[Mechanism, str]:
    described, point, *_ = HELD[name]
    return with_output(described(), "point", *point()), "point_extended"


@pytest.mark.parametrize("name", ["loader", "off_axle", later("castor")])
def test_what_a_joint_does_while_another_body_moves_straight(name):
    """A body whose axle is p_0 from a joint that moves straight: its heading errs at +-v sin(error)/p_0,
    + where it is pushed."""
    *_, joint, rate, way, goes = HELD[name]
    form = form_of(*held(name))
    (each,) = form.shape.followers
    assert (each.name, each.way) == (joint, way)
    assert sp.simplify(each.course - rate) == 0
    (moving,) = form.moving
    assert moving.stable_when == ("V > 0" if way == 1 else "V < 0") and goes in moving.settles
    confirm(form)


@pytest.mark.parametrize("wrong", ["sign", "rate"])
def test_a_verdict_that_runs_contradict_is_not_given(wrong, monkeypatch):
    """The derivation is planted with a wrong sign, and with a rate that is off by two per cent."""
    factor, right = -1 if wrong == "sign" else sp.Rational(102, 100), forms.shape_of_others

    def planted(decoupling, others):
        shape = right(decoupling, others)
        return replace(shape, followers=tuple(replace(e, rate=factor * e.rate) for e in shape.followers))

    monkeypatch.setattr(forms, "shape_of_others", planted)
    with pytest.raises(Contradiction, match="a run of the robot shows: rates "):
        confirm(form_of(*held("loader")))


def test_headings_of_outputs_that_are_regular_are_confirmed_too(monkeypatch):
    """The lever of Type I with the wrong sign, and the curvature of a circle's s."""
    robot = mechanism(off_axle())
    form = form_of(robot, "type_i")
    confirm(form)
    (moving,) = form.moving
    form.__dict__["moving"] = (replace(moving, rate=-moving.rate),)
    with pytest.raises(Contradiction, match="a run of the robot shows"):
        confirm(form)
    form = form_of(robot, "type_iv_circle")
    confirm(form)
    (moving,) = form.moving
    form.__dict__["moving"] = (replace(moving, lookahead=2 * moving.lookahead),)
    with pytest.raises(Contradiction, match="the two sides differ"):
        confirm(form)


def test_what_is_integrated_has_its_pole_among_the_singular_sets():
    """The speed of the trailer's axle, by that of the unicycle, has the factor 1 / cos(phi - psi)."""
    assert singular_when(form_of(*held("off_axle")))[1] == (
        "what is integrated has a pole: phi - psi is an odd multiple of 90 degrees (cos(phi - psi) = 0)"
    )


def test_a_robot_whose_outputs_need_an_extension_has_laws():
    robot = with_output(two_steered(), "pose", *AT, PHI)
    assert find_laws(system_of(robot)) == ("pose_extended",)


# -- names ---------------------------------------------------------------------------------------------------


def answers(heading: str, of_trailer: str) -> list[str]:
    """What is said of the motion of a unicycle with a trailer whose angles have these names,
    with the names of any other."""
    robot, plain = mechanism(replace(off_axle(), coordinates=("x", "y", heading, of_trailer))), []
    for law in ("type_i", "type_iv_circle", "type_i_extended", "type_iv_circle_extended"):
        form = form_of(robot, law)
        lines = [*form.shape.lines(), form.zero_dynamics, form.stability]
        for moving in form.moving:
            lines += [str(moving), *(f"{name}: {about}" for name, about in sorted(moving.symbols.items()))]
        mine = {heading: "ETA", of_trailer: "THETA"} | {
            form.decoupling.names[name]: f"<{name}>" for name in OWN
        }
        plain += [
            re.sub(r"\b[A-Za-z]\w*\b", lambda word, mine=mine: mine.get(word[0], word[0]), line)
            for line in lines
        ]
    return plain


@pytest.mark.parametrize(
    "names", [("psi", "V"), *[later(names) for names in (("s", "chi"), ("v", "n_x"), ("along_path", "n_y"))]]
)
def test_names_of_the_answers_differ_from_those_of_a_robot(names):
    """With coordinates that are called as symbols of the answers, all is the same but for names."""
    right = answers(*sorted(("eta", "theta"), reverse=names[0] > names[1]))  # terms are in the order of names
    assert answers(*names) == right and "<psi>" in "".join(right) and "<s>" in "".join(right)


# -- readable formulas ---------------------------------------------------------------------------------------


def test_readable_formulas_are_the_same_functions():
    """Sums that become one sine, with all signs, and long ones: equal at random points."""
    a, b, h, l = sp.symbols("a b h l", real=True)  # noqa: E741
    waves = [sp.sin(a), sp.cos(a), sp.sin(b), sp.cos(b)]
    sums = [
        s * x * y + t * z * w
        for s in (1, -1)
        for t in (1, -1)
        for x, y, z, w in [waves, [waves[k] for k in (0, 3, 1, 2)]]
    ]
    draw = np.random.default_rng(5)
    pairs = [(x, y) for x in waves for y in waves]
    long = sum(int(draw.integers(-3, 4)) * x * y * sp.Symbol(f"k_{k % 5}") for k, (x, y) in enumerate(pairs))
    for expression in [*(factor * each for each in sums for factor in (1, -1, h, -l)), h * sums[0] + l, long]:
        at = {symbol: draw.uniform(0.3, 1.4) for symbol in expression.free_symbols}
        assert abs(float((readable(expression) - expression).evalf(subs=at))) < 1e-12
    assert str(readable(h * sp.sin(a) * sp.sin(b) + h * sp.cos(a) * sp.cos(b) + l)) == "h*cos(a - b) + l"


# -- underactuated robots ------------------------------------------------------------------------------------


def verdict_of(robot: Mechanism, name: str):
    return next(check for check in analyse(robot).constraints.checks if check.name == name)


def test_a_momentum_that_no_input_changes_is_a_reason_against_lagrange_stability():
    """The rotor's reaction turns the body: 0.4 phi' + 0.1 (phi' + spin') is constant."""
    check = verdict_of(mechanism(rotor()), "lagrange_stable")
    assert check.verdict is False and "momentum of a common displacement of phi" in check.reason
    assert actuation(mechanism(pendulum_disk())).momentum == ()  # gravity


def test_whether_static_feedback_linearizes_an_underactuated_robot_is_decided():
    """A pendulum on a disk: [g, [f, g]] is outside D_2, whose dimension is that of random states."""
    check = verdict_of(mechanism(pendulum_disk()), "input_state_linearizable")
    assert check.verdict is False and "is not involutive" in check.reason


def chain() -> Mechanism:
    """Two masses on a line with a spring between them, of which the first is pushed: linear,
    and so linearizable."""
    robot = Mechanism("chain", "two carts and a wheel")
    a, b, c = robot.coordinate("a", "m"), robot.coordinate("b", "m"), robot.coordinate("c", "rad")
    robot.kinetic_energy((robot.rate(a) ** 2 + robot.rate(b) ** 2 + 0.1 * robot.rate(c) ** 2) / 2)
    robot.potential_energy((a - b) ** 2 / 2)
    robot.rolls("wheel", robot.rate(a) - 0.1 * robot.rate(c))
    robot.input("F", "N", on=robot.rate(a))
    robot.quasi_velocity("v_a", "m/s", robot.rate(a))
    robot.quasi_velocity("v_b", "m/s", robot.rate(b))
    robot.output("first", "", [("a", "m", a)])
    return robot


def cart(*, pendulum: bool) -> Mechanism:
    """A cart with a pole above it, or on a spring with an arm; its quasi-velocities are not chosen."""
    robot = Mechanism("cart", "a cart with a pole, or with an arm that is turned")
    x, a, b = robot.coordinate("x", "m"), robot.coordinate("a", "rad"), robot.coordinate("b", "rad")
    rate = robot.rate
    robot.rolls("wheel", rate(x) - 0.1 * rate(b))
    robot.kinetic_energy(rate(x) ** 2 / 2)
    robot.kinetic_energy(
        0.3 * ((rate(x) + 0.5 * ca.cos(a) * rate(a)) ** 2 + (0.5 * ca.sin(a) * rate(a)) ** 2) / 2
    )
    robot.potential_energy(0.3 * 9.81 * 0.5 * ca.cos(a) if pendulum else 52.0 * x**2 / 2)
    robot.input("tau", "N m", on=rate(b) if pendulum else rate(a))
    robot.output("held", "", [("h", "m", x) if pendulum else ("h", "rad", a)])
    return robot


@pytest.mark.parametrize(("robot", "linearizable"), [(chain, True), (partial(cart, pendulum=True), False)])
def test_with_one_input_dynamic_feedback_linearizes_what_static_feedback_does(robot, linearizable):
    """A linear robot is linearizable; a cart with a pole is not, by static feedback, as is known,
    nor by any other."""
    for name in ("input_state_linearizable", "dynamic_feedback_linearizable"):
        found = [check.verdict for check in analyse(robot()).constraints.checks if check.name == name]
        assert found[-1] is linearizable


@pytest.mark.parametrize(
    ("pendulum", "size"), [(True, math.sqrt(9.81 / 0.5)), (False, 1j * math.sqrt(52.0 / 1.3))]
)
def test_zero_dynamics_at_rest_are_those_of_the_body_that_is_left(pendulum, size):
    """With the cart held the pole falls, with the arm held both swing on the spring: rates by hand,
    confirmed by a run."""
    system = reduce(cart(pendulum=pendulum), partially=True)
    form = forms.normal_form(decouple(linearize(system, output_map(system, "held"))))
    confirm(form)
    assert sorted(form.modes, key=lambda rate: rate.real + rate.imag) == pytest.approx(
        [-size, 0, size], abs=1e-6
    )


@pytest.mark.nightly
def test_an_output_that_is_declared_may_be_flat():
    """Position and heading of a bicycle with two steered wheels give both steering angles;
    the search finds only pairs."""
    answer = analyse(with_output(two_steered(), "pose", *AT, PHI), ["pose_extended"])
    (flat,) = answer.constraints.flatness
    assert flat.check.verdict is True and flat.missing == "y_0, y_1, y_2, of pose"
