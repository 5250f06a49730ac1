"""Robots that are not shipped: their C against projected Newton-Euler, inputs that lose a direction, C that compiles."""

import re

import casadi as ca
import numpy as np
import pytest
from noslip.analysis.answers import analyse, singular_when
from noslip.codegen.files import has_follower, robot_files
from noslip.controllers.backends import make_controller
from noslip.controllers.build import DoesNotCompile, check_links
from noslip.controllers.controller import BACKENDS
from noslip.model import control_law, reduce
from noslip.model.algebra.expression import largest
from noslip.model.outputs import output_map
from noslip.readers.robots import law_of, system_of
from noslip.tests import robots_of_users
from noslip.tests.random_robots import mechanism, states, truth
from noslip.tests.unshipped import DESCRIBED, trident
from noslip.verification.generate import rejected

PARALLEL = (np.pi, np.pi / 3, 5 * np.pi / 3)  # rad, legs of the trident that all trail


# -- the equations ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("described", DESCRIBED)
def test_the_equations_are_those_of_newton_and_euler(described):
    """S'MS, the bias, S'E and, where a robot has outputs of its own, Phi and tau, in 40 digits without noslip."""
    robot = described()
    system = reduce(mechanism(robot), partially=True)
    groups = [system.mechanism.q, system.nu, system.mechanism.p]
    names = ("Mbar", "bias", "input_map")
    function = ca.Function("f", groups, [ca.densify(getattr(system, name)) for name in names])
    for state in states(robot, 3):
        right = truth(robot, state, [q.name for q in system.quasi_velocities])
        for name, value in zip(names, function(state.q, state.nu, state.p), strict=True):
            exact = right[name]
            np.testing.assert_allclose(value.full().reshape(exact.shape), exact, atol=1e-12 * max(1.0, np.abs(exact).max()))


# -- inputs that lose a direction ---------------------------------------------------------------------------------------


def statuses(law, state: np.ndarray) -> list[str]:
    """The status of a step in each backend."""
    params, gains = ([q.default for q in group] for group in (law.parameters, law.gains))
    reference = np.linspace(0.1, 0.9, len(law.reference))
    return [make_controller(backend, law, params, [], gains).step(state, reference)[0] for backend in BACKENDS]


@pytest.mark.parametrize("a", [np.pi / 2, -np.pi / 2, 3 * np.pi / 2])
def test_a_crank_at_its_dead_centre_is_singular(a):
    """The force acts by cos(a): it would have to be infinite, though Phi is the identity."""
    law = control_law(system := reduce(robots_of_users.crank()), output_map(system, "place"))
    for off, status in ((0.0, "singular"), (1e-3, "ok"), (-1e-3, "ok")):
        assert statuses(law, np.array([0.3, a + off, 0.0, 0.2, 0.1])) == [status] * 3


def test_legs_that_trail_until_they_lose_a_direction_are_singular():
    """S'E has rank 2 there by its singular values, and 3 where one leg is turned a little."""
    law = control_law(system := reduce(mechanism(trident())), output_map(system, "own"))
    S_E = ca.Function("S_E", [system.mechanism.q, system.mechanism.p], [system.input_map])
    for turned, status in ((0.0, "singular"), (1e-2, "ok")):
        state = np.array([0.3, -0.2, 0.4, PARALLEL[0], PARALLEL[1] + turned, PARALLEL[2], 0.1, 0.2, 0.3])
        sizes = np.linalg.svd(S_E(state[:6], [p.default for p in law.parameters]).full(), compute_uv=False)
        assert (sizes[-1] < 1e-14 * sizes[0]) == (status == "singular") and sizes[1] > 0.1 * sizes[0]
        assert statuses(law, state) == [status] * 3


def test_analyse_says_where_inputs_lose_a_direction():
    assert singular_when(analyse(robots_of_users.crank(), ["place"]).outputs["place"]) == [
        "inputs lose a direction: a is an odd multiple of 90 degrees (cos(a) = 0)"
    ]
    (condition,) = analyse(mechanism(trident()), ["own"]).outputs["own"].decoupling.conditions
    assert condition.confirmed and condition.words == "inputs lose a direction"
    assert {str(s) for s in condition.formula.free_symbols} == {"p_0", "p_1", "leg_1", "leg_2", "leg_3"}  # not the heading

    def formula(leg_2: float) -> float:
        values = dict(p_0=0.4, p_1=0.6, leg_1=PARALLEL[0], leg_2=leg_2, leg_3=PARALLEL[2])
        return float(condition.formula.evalf(subs={s: values[str(s)] for s in condition.formula.free_symbols}))

    assert abs(formula(PARALLEL[1])) < 1e-12 < 0.01 < abs(formula(PARALLEL[1] + 0.1))


def test_a_bound_of_an_expression_is_one():
    """At random points the entries are within it, and a sine counts as 1."""
    x = ca.SX.sym("x", 3)
    expression = ca.vertcat(x[0] * ca.sin(x[1]) - x[2], ca.cos(x[0]) / (2 + x[1] ** 2), ca.sqrt(x[2] ** 2 + 1) - 3)
    function = ca.Function("f", [x], [expression, largest(expression)])
    for point in np.random.default_rng(3).uniform(-2, 2, (50, 3)):
        value, bound = (part.full().ravel() for part in function(point))
        assert (np.abs(value) <= bound + 1e-15).all()
        np.testing.assert_allclose(bound[0], abs(point[0]) + abs(point[2]), atol=1e-14)


# -- C that is handed out compiles --------------------------------------------------------------------------------------


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
