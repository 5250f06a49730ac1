"""model/ against an independent derivation, against the laws of mechanics, and against wrong input."""

import math
from collections.abc import Callable
from fractions import Fraction
from functools import cache

import casadi as ca
import mpmath
import numpy as np
import pytest
import sympy as sp
from casadi import cos, sin
from noslip.model import (
    ControlLaw,
    Linearization,
    Mechanism,
    ModelError,
    OutputMap,
    OutputRow,
    ReducedSystem,
    control_law,
    linearize,
    reduce,
)
from noslip.model.algebra.exact import canonical
from noslip.model.algebra.expression import fold
from noslip.model.algebra.ratios import factored, in_lowest_terms
from noslip.model.outputs import OUTPUTS, type_iv
from noslip.model.paths import config, implicit
from noslip.model.robots.labmate import labmate
from noslip.tests.reference import closed_forms
from sympy import GF, QQ, ZZ, ring
from sympy.polys.rings import PolyElement, PolyRing

LAWS = tuple(OUTPUTS)
STATES = 200
TOLERANCE = 1e-12  # of the largest entry: about 1e4 roundings


# -- what the tests are made of ------------------------------------------------------------------------------


def close(value, expected, tolerance: float = TOLERANCE, scale: float | None = None) -> bool:
    """Equal to `tolerance` of the largest expected entry (or of `scale`), in absolute value."""
    value, expected = np.asarray(value, dtype=float), np.asarray(expected, dtype=float)
    size = np.abs(expected).max(initial=0.0) if scale is None else scale
    return bool(np.all(np.abs(value.reshape(expected.shape) - expected) <= tolerance * size))


@cache
def labmate_system() -> ReducedSystem:
    return reduce(labmate())


@cache
def labmate_law(name: str) -> ControlLaw:
    return control_law(labmate_system(), OUTPUTS[name](labmate_system()))


RANGES = {
    **{"b": (0.3, 1.2), "d": (-0.5, 0.5), "r": (0.05, 0.3), "m_c": (5, 60), "m_w": (0.2, 3)},
    **{"I_c": (2, 30), "I_w": (0.001, 0.05), "I_m": (0.0005, 0.02)},
    **{"x_c": (-20, 20), "y_c": (-20, 20), "phi": (-10, 10), "theta_r": (-10, 10), "theta_l": (-10, 10)},
    **{"thetadot_r": (-10, 10), "thetadot_l": (-10, 10)},
    **{"config.L": (-1, 1), "config.A": (-2, 2), "config.B": (-2, 2), "config.C": (-5, 5)},
    **{
        "config.x_f": (-20, 20),
        "config.y_f": (-20, 20),
        "config.R": (1, 15),
        "config.a": (1, 6),
        "config.b": (1, 6),
    },
    **{
        "config.x_s": (-20, 20),
        "config.y_s": (-20, 20),
        "config.direction": (-10, 10),
        "config.curvature": (-0.5, 0.5),
    },
}


def random_values(seed: int) -> list[dict[str, float]]:
    """Random states, robots and paths."""
    rng = np.random.default_rng(seed)
    return [{name: rng.uniform(*bounds) for name, bounds in RANGES.items()} for _ in range(STATES)]


def arguments(law: ControlLaw, values: dict[str, float], gains, reference) -> list[list[float]]:
    """Of law.function: params, config, gains, state, reference."""
    of_kind = dict(zip(("kp", "kd", "kv"), gains, strict=True))
    pairs = zip(law.linearization.relative_degree, reference, strict=True)
    return [
        [values[p.name] for p in law.parameters],
        [values[f"config.{p.name}"] for p in law.config],
        [of_kind[g.name[:2]] for g in law.gains],
        [values[s.name] for s in law.state],
        [number for degree, row in pairs for number in (row if degree == 2 else row[[0, 2]])],
    ]


def edge(name: str = "edge", quasi: bool = True) -> Mechanism:
    """A knife edge on an incline, with a damper and a spring: two inputs, n - m = 2."""
    robot = Mechanism(name)
    x, y, heading = (robot.coordinate(q, unit) for q, unit in (("x", "m"), ("y", "m"), ("heading", "rad")))
    mass, inertia = robot.parameter("mass", 2.0, "kg"), robot.parameter("inertia", 0.5, "kg m^2")
    weight, damping, spring = (
        robot.parameter(p, 1.5, "1", sign="any") for p in ("weight", "damping", "spring")
    )
    forward = cos(heading) * robot.rate(x) + sin(heading) * robot.rate(y)
    robot.kinetic_energy(mass * (robot.rate(x) ** 2 + robot.rate(y) ** 2) / 2)
    robot.kinetic_energy(inertia * robot.rate(heading) ** 2 / 2)
    robot.potential_energy(weight * y + spring * x**2 / 2)
    robot.force(-damping * forward, on=forward)
    robot.rolls("blade", cos(heading) * robot.rate(y) - sin(heading) * robot.rate(x))
    robot.input("push", "N", on=forward)
    robot.input("turn", "N m", on=robot.rate(heading))
    if quasi:
        robot.quasi_velocity("v", "m/s", forward)
        robot.quasi_velocity("w", "rad/s", robot.rate(heading))
    robot.moves_in_plane(x, y, heading)
    return robot


def swinging() -> Mechanism:
    """A bead on a rod of variable slope: one holonomic constraint from `holds`,
    nothing said about quasi-velocities."""
    robot = Mechanism("swinging")
    x, y = robot.coordinate("x", "m"), robot.coordinate("y", "m")
    mass, weight, k = (
        robot.parameter("mass", 2.0, "kg"),
        robot.parameter("weight", 20.0, "N"),
        robot.parameter("k", 0.7, "1/m"),
    )
    robot.kinetic_energy(mass * (robot.rate(x) ** 2 + robot.rate(y) ** 2) / 2)
    robot.potential_energy(weight * y)
    robot.holds("parabola", y - k * x**2)
    robot.input("push", "N", on=robot.rate(x))
    return robot


def tractor() -> Mechanism:
    """Knife edge with an independent arm that takes a third, redundant input: state-dependent E,
    r = 4 > n - m = 3."""
    robot = edge("tractor")
    arm = robot.coordinate("arm", "rad")
    x, y, heading = (c.symbol for c in robot.coordinates[:3])
    robot.kinetic_energy(0.3 * (robot.rate(heading) + robot.rate(arm)) ** 2 / 2)
    robot.quasi_velocity("swing", "rad/s", robot.rate(arm))
    robot.input("motor", "N m", on=robot.rate(arm))
    robot.input(
        "rope", "N", on=robot.rate(x) * (1 + arm**2 / 4) + sin(arm) * robot.rate(y) + robot.rate(arm) / 2
    )
    return robot


ROBOTS: dict[str, Callable[[], Mechanism]] = {
    "labmate": labmate,
    "edge": edge,
    "swinging": swinging,
    "tractor": tractor,
}


@cache
def system_of(name: str) -> ReducedSystem:
    return labmate_system() if name == "labmate" else reduce(ROBOTS[name]())


def samples(system: ReducedSystem, expressions: list[ca.SX], *more: ca.SX, count: int = STATES):
    """The expressions' values at seeded random q, nu and `more`, parameters around their defaults."""
    robot = system.mechanism
    evaluate = ca.Function("f", [robot.q, system.nu, robot.p, *more], [ca.densify(e) for e in expressions])
    rng = np.random.default_rng(22)
    for _ in range(count):
        p = [parameter.default * rng.uniform(0.5, 2) for parameter in robot.parameters]
        others = [rng.uniform(-3, 3, s.numel()) for s in more]
        yield [
            np.asarray(value)
            for value in evaluate.call(
                [rng.uniform(-3, 3, robot.q.numel()), rng.uniform(-3, 3, system.dof), p, *others]
            )
        ]


# -- the LABMATE ---------------------------------------------------------------------------------------------


def test_the_closed_forms_are_mechanics():
    """The oracle itself: the paper's matrices follow from Lagrange's equations and from the rolling
    wheels."""
    cf = closed_forms
    M, V = cf.lagrange_equations()
    differences = {
        "M": M - cf.M,
        "V": V - cf.V_OF_RATES,
        "A": cf.rolling_rows() - cf.A,
        "A S": cf.A * cf.S,
        "Mbar": cf.S.T * cf.M * cf.S - cf.MBAR,
        "bias": cf.S.T * (cf.M * cf.along_motion(cf.S) * cf.nu + cf.V) - cf.BIAS,
        "Phi": cf.OUTPUTS["type_i"].Phi - cf.TYPE_I_PHI,
    }
    assert {
        name for name, left in differences.items() if not left.applyfunc(sp.simplify).is_zero_matrix
    } == set()


def test_platform_matrices():
    system, robot = labmate_system(), labmate_system().mechanism
    matrices = {
        "M": robot.M,
        "V": system.V,
        "A": robot.A,
        "S": system.S,
        "Sdot": system.Sdot,
        "Mbar": system.Mbar,
        "bias": system.bias,
    }
    evaluate = ca.Function("f", [robot.p, robot.q, system.nu], [ca.densify(e) for e in matrices.values()])
    groups = [
        [s.name for s in group] for group in (robot.parameters, robot.coordinates, system.quasi_velocities)
    ]
    for values in random_values(1):
        results = evaluate.call([[values[name] for name in group] for group in groups])
        expected = closed_forms.platform(values)
        wrong = [k for k, got in zip(matrices, results, strict=True) if not close(got, expected[k])]
        assert not wrong, values


@pytest.mark.parametrize("name", LAWS)
def test_law(name):
    """h, ydot, Phi, Phidot, det to TOLERANCE; u, tau, lambda to TOLERANCE times the conditioning of Phi."""
    law, oracle = labmate_law(name), closed_forms.OUTPUTS[name]
    linear = law.linearization
    assert linear.relative_degree == oracle.relative_degree
    assert [p.name for p in law.config] == [str(s).removeprefix("config.") for s in oracle.config]
    quantities = {
        "h": linear.h,
        "ydot": linear.rate,
        "Phi": linear.Phi,
        "Phidot": linear.Phidot,
        "det": linear.determinant,
    }
    quantities |= {"u": law.u, "tau": law.tau, "lam": law.system.constraint_forces(law.tau, law.u)}
    evaluate = law.function(quantities)
    rng = np.random.default_rng(3)
    for values in random_values(2):
        gains, reference = tuple(rng.uniform(0.5, 8, 3)), rng.uniform(-5, 5, (2, 3))
        results = dict(zip(quantities, evaluate.call(arguments(law, values, gains, reference)), strict=True))
        expected = closed_forms.law(name, values, gains, reference)
        sine = abs(expected["det"]) / np.prod(np.linalg.norm(expected["Phi"], axis=1))
        for key, value in expected.items():
            conditioning = 1 / sine if key in ("u", "tau", "lam") else 1.0
            assert close(results[key], value, TOLERANCE * conditioning), (key, values)


def test_a_segment_without_curvature_is_a_line():
    """Where the centre is infinitely far the formula by the centre fails; the law does not."""
    law, line = labmate_law("type_iv_segment"), closed_forms.OUTPUTS["type_iv_line"]
    evaluate = law.function({"h": law.linearization.h, "tau": law.tau})
    rng = np.random.default_rng(4)
    for values in random_values(5):
        gains, reference = tuple(rng.uniform(0.5, 8, 3)), rng.uniform(-5, 5, (2, 3))
        sine, cosine = math.sin(values["config.direction"]), math.cos(values["config.direction"])
        left = cosine * values["config.y_s"] - sine * values["config.x_s"]
        values |= {"config.curvature": 0.0, "config.A": -sine, "config.B": cosine, "config.C": -left}
        results = evaluate.call(arguments(law, values, gains, reference))
        expected = closed_forms.law("type_iv_line", values, gains, reference)
        assert line.relative_degree == law.linearization.relative_degree
        sharp = abs(expected["det"]) / np.prod(np.linalg.norm(expected["Phi"], axis=1))
        assert close(results[0], expected["h"]) and close(results[1], expected["tau"], TOLERANCE / sharp), (
            values
        )


def test_determinant_is_found_in_closed_form():
    """The heading drops out of det Phi of Type I; of Types II and III everything but the heading."""
    system = labmate_system()
    for name, gone in (
        ("type_i", ["x_c", "y_c", "phi"]),
        ("type_ii", ["x_c", "y_c"]),
        ("type_iii", ["x_c", "y_c"]),
    ):
        left = {s.name() for s in ca.symvar(labmate_law(name).linearization.determinant)}
        assert left.isdisjoint(gone), name
    assert system.input_map.is_constant()


def test_reduced_equations_do_not_contain_the_pose():
    system = labmate_system()
    assert not ca.depends_on(ca.densify(system.Mbar), ca.vertcat(system.mechanism.q, system.nu))
    assert not ca.depends_on(ca.densify(system.bias), system.mechanism.q)


def test_the_heading_need_not_be_a_coordinate():
    """With phi = c (theta_r - theta_l) used up front, two constraints remain; Mbar,
    bias and det Phi are the same."""
    robot = Mechanism("labmate4")
    x, y = robot.coordinate("x_c", "m"), robot.coordinate("y_c", "m")
    right, left = robot.coordinate("theta_r", "rad"), robot.coordinate("theta_l", "rad")
    b, d, r, m_c, m_w, I_c, I_w, I_m = (
        robot.parameter(p.name, p.default, p.unit, sign=p.sign) for p in labmate().parameters
    )
    phi = r / (2 * b) * (right - left)
    turn = robot.rate(phi)

    def body(point):
        x_dot, y_dot = robot.rate(point[0]), robot.rate(point[1])
        return x_dot * cos(phi) + y_dot * sin(phi), y_dot * cos(phi) - x_dot * sin(phi)

    robot.kinetic_energy(m_c * (robot.rate(x) ** 2 + robot.rate(y) ** 2) / 2 + I_c * turn**2 / 2)
    for side, angle in ((-1, right), (1, left)):
        wheel = body((x - d * cos(phi) - side * b * sin(phi), y - d * sin(phi) + side * b * cos(phi)))
        robot.kinetic_energy(
            m_w * (wheel[0] ** 2 + wheel[1] ** 2) / 2 + I_m * turn**2 / 2 + I_w * robot.rate(angle) ** 2 / 2
        )
    robot.rolls("side", body((x - d * cos(phi), y - d * sin(phi)))[1])
    robot.rolls("forward", body((x, y))[0] - r * (robot.rate(right) + robot.rate(left)) / 2)
    for name, angle in (("thetadot_r", right), ("thetadot_l", left)):
        robot.input(f"tau_{name}", "N m", on=robot.rate(angle))
        robot.quasi_velocity(name, "rad/s", robot.rate(angle))
    robot.moves_in_plane(x, y, phi)
    system = reduce(robot)
    law = control_law(system, OUTPUTS["type_i"](system))
    evaluate = law.function({"Mbar": system.Mbar, "bias": system.bias, "det": law.linearization.determinant})
    for values in random_values(4):
        Mbar, bias, det = evaluate.call(arguments(law, values, (1, 2, 3), np.zeros((2, 3))))
        expected = closed_forms.platform(values)
        assert close(Mbar, expected["Mbar"]) and close(bias, expected["bias"])
        assert close(det, -(values["r"] ** 2) * (values["config.L"] + values["d"]) / (2 * values["b"]))


# -- the laws of mechanics, for any robot --------------------------------------------------------------------

any_robot = pytest.mark.parametrize("name", ROBOTS)


@any_robot
def test_null_space_and_mass(name):
    """A S = 0, S of full rank; M and S'MS symmetric, positive definite."""
    system = system_of(name)
    robot = system.mechanism
    assert canonical(robot.A @ system.S).is_zero()
    for A, S, M, Mbar in samples(system, [robot.A, system.S, robot.M, system.Mbar]):
        assert np.abs(A @ S).max() <= 1e-13 * max(1.0, np.abs(A).max() * np.abs(S).max())
        assert np.linalg.matrix_rank(S) == system.dof
        for mass in (M, Mbar):
            assert np.array_equal(mass, mass.T) or close(mass, mass.T, 1e-15)
            assert np.linalg.eigvalsh(mass).min() > 0


@any_robot
def test_reduced_equations(name):
    """S'MS, the bias and S'E are what (10) says."""
    system = system_of(name)
    robot = system.mechanism
    parts = [robot.M, system.S, system.Sdot, system.V, robot.E, system.Mbar, system.bias, system.input_map]
    for (M, S, Sdot, V, E, Mbar, bias, input_map), (nu,) in zip(
        samples(system, parts), samples(system, [system.nu]), strict=True
    ):
        assert close(Mbar, S.T @ M @ S, scale=np.abs(M).max() * np.abs(S).max() ** 2)
        size = np.abs(S).max() * max(
            np.abs(V).max(), np.abs(M).max() * np.abs(Sdot).max() * np.abs(nu).max(), 1e-9
        )
        assert close(bias, S.T @ (M @ Sdot @ nu + V), scale=size)
        assert close(input_map, S.T @ E, scale=np.abs(S).max() * np.abs(E).max())


@any_robot
def test_power_balance(name):
    """d/dt (T + U) = tau' E' qdot + power of the forces: the constraints do no work."""
    system = system_of(name)
    robot, tau = system.mechanism, ca.SX.sym("tau", len(system.mechanism.inputs))
    acceleration = system.S @ system.acceleration(tau) + system.Sdot @ system.nu
    energy = robot.energy()
    # the two parts of dE/dt and the powers that they must sum to
    terms = [
        ca.jtimes(energy, robot.q, system.qdot),
        ca.jtimes(energy, robot.qdot, acceleration),
        -tau.T @ robot.E.T @ system.qdot,
    ]
    if name in ("edge", "tractor"):
        damping = next(p.symbol for p in robot.parameters if p.name == "damping")
        terms.append(damping * system.nu[0] ** 2)  # -damping v on v
    terms = ca.substitute(ca.vertcat(*terms), robot.qdot, system.qdot)
    for (values,) in samples(system, [terms], tau):
        assert abs(values.sum()) <= 1e-11 * np.abs(values).sum()


@any_robot
def test_equations_of_motion_hold_with_the_constraint_forces(name):
    """M qddot + V - E tau + A' lambda = 0 (8), for any tau."""
    system = system_of(name)
    robot, tau = system.mechanism, ca.SX.sym("tau", len(system.mechanism.inputs))
    nudot = system.acceleration(tau)
    qddot = system.S @ nudot + system.Sdot @ system.nu
    terms = [robot.M @ qddot, system.V, -robot.E @ tau, robot.A.T @ system.constraint_forces(tau, nudot)]
    for (values,) in samples(system, [ca.horzcat(*terms)], tau):
        assert np.abs(values.sum(axis=1)).max() <= 1e-11 * np.abs(values).max()


@any_robot
def test_first_feedback(name):
    """tau (12) makes nudot = u (13)."""
    system = system_of(name)
    u = ca.SX.sym("u", system.dof)
    nudot = system.acceleration(system.first_feedback(u))
    for expected, actual, input_map in samples(system, [u, nudot, system.input_map], u):
        assert close(actual, expected, 1e-11 * np.linalg.cond(input_map))


def outputs_of(system: ReducedSystem) -> list[OutputMap]:
    """Maps with relative degrees 2 and 1 for the small robots."""
    q, nu = system.mechanism.q, system.nu
    rows = (
        [OutputRow("position", "m", "", q[0] + q[1] ** 2 / 8), OutputRow("turn", "rad", "", q[2])]
        if q.numel() > 2
        else []
    )
    mixed = (
        [
            OutputRow("distance", "m", "", sin(q[2]) + q[2]),
            OutputRow("speed", "m/s", "", nu[0] * (2 + cos(q[0]))),
        ]
        if rows
        else []
    )
    rows, mixed = (
        rows or [OutputRow("place", "m", "", q[0] + q[0] ** 3)],
        mixed or [OutputRow("rate", "m/s", "", nu[0] * (1 + q[0] ** 2))],
    )
    if system.dof == 3:
        rows, mixed = ([*row, OutputRow("arm", "rad", "", q[3])] for row in (rows, mixed))
    return [OutputMap("positions", "", tuple(rows)), OutputMap("mixed", "", tuple(mixed))]


def linearizations(name: str) -> list[Linearization]:
    if name == "labmate":
        return [labmate_law(law).linearization for law in LAWS]
    return [linearize(system_of(name), output) for output in outputs_of(system_of(name))]


@pytest.mark.parametrize(
    ("name", "degrees"),
    [
        ("edge", [(2, 2), (2, 1)]),
        ("swinging", [(2,), (1,)]),
        ("tractor", [(2, 2, 2), (2, 1, 2)]),
        ("labmate", [(2, 2)] * 3 + [(2, 1)] * 4),
    ],
)
def test_relative_degrees(name, degrees):
    assert [linear.relative_degree for linear in linearizations(name)] == degrees


def test_relative_degree_does_not_hang_on_a_default_of_zero():
    robot = edge()
    lag = robot.parameter("lag", 0.0, "s", sign="any")
    system = reduce(robot)
    output = (
        OutputRow("ahead", "m", "", place(system) + lag * system.nu[0]),
        OutputRow("turn", "rad", "", heading(system)),
    )
    assert linearize(system, OutputMap("mine", "", output)).relative_degree == (1, 2)


@any_robot
def test_second_feedback_gives_the_wanted_derivatives(name):
    """Along qdot = S nu, nudot = u(v): the derivative of ydot (degree 2), of y (degree 1) is v;
    det Phi is Phi's."""
    system = system_of(name)
    state = ca.vertcat(system.mechanism.q, system.nu)
    for linear in linearizations(name):
        v = ca.SX.sym("v", system.dof)
        rates = iter(ca.vertsplit(linear.rate)) if linear.rate.numel() else iter(())
        lower = ca.vertcat(
            *[
                next(rates) if k == 2 else h
                for k, h in zip(linear.relative_degree, ca.vertsplit(linear.h), strict=True)
            ]
        )
        closed = ca.jtimes(lower, state, ca.vertcat(system.qdot, linear.second_feedback(v)))
        parameters = ca.vertcat(*[c.symbol for c in linear.output.parameters])
        parts = [v, closed, linear.Phi, linear.drift, linear.determinant]
        for expected, got, Phi, drift, det in samples(system, parts, v, parameters, count=50):
            size = (np.abs(expected).max() + np.abs(drift).max()) * np.linalg.cond(Phi)
            assert close(got, expected, scale=size)
            assert close(det, np.linalg.det(Phi), scale=np.prod(np.linalg.norm(Phi, axis=1)))


@any_robot
def test_phidot_is_the_derivative_of_phi(name):
    """Against five-point differences along the motion, step 1e-3:
    truncation below 1e-9 of the largest entries seen."""
    system = system_of(name)
    robot, step = system.mechanism, 1e-3
    for linear in linearizations(name):
        Phi = [
            ca.substitute(
                linear.Phi, robot.q, robot.q + k * step * system.qdot / (1 + ca.norm_2(system.qdot))
            )
            for k in (-2, -1, 1, 2)
        ]
        parameters = ca.vertcat(*[c.symbol for c in linear.output.parameters])
        expected = linear.Phidot / (1 + ca.norm_2(system.qdot))
        for left2, left, right, right2, exact in samples(system, [*Phi, expected], parameters, count=20):
            difference = (left2 - 8 * left + 8 * right - right2) / (12 * step)
            assert close(exact, difference, 1e-8, scale=np.abs([left, right, exact]).max()), (
                linear.output.name
            )


# -- more inputs than dof ------------------------------------------------------------------------------------


def test_redundant_inputs_share_by_weight():
    """tau is the weighted least-norm solution of (12): the one that a Lagrange multiplier gives,
    other weights another."""
    system = system_of("tractor")
    u = ca.SX.sym("u", 3)
    weights = [(1, 1, 1, 1), (1, 2, 3, 4), (1, 1, 1, 1e3)]
    parts = [system.input_map, system.Mbar @ u + system.bias, *[system.first_feedback(u, w) for w in weights]]
    for input_map, effort, *taus in samples(system, parts, u):
        for weight, tau in zip(weights, taus, strict=True):
            limit = 1e-12 * np.linalg.cond(input_map) ** 2 * np.sqrt(max(weight)) * np.abs(tau).max()
            assert np.abs(input_map @ tau - effort).max() <= limit * max(1.0, np.abs(input_map).max())
            null = np.linalg.svd(input_map)[2][3]
            assert abs(null @ np.diag(weight) @ tau) <= limit * max(weight), "not the least"
        assert np.abs(taus[0] - taus[1]).max() > 1e-6 * np.abs(taus[0]).max()
        assert abs(taus[2][3, 0]) <= abs(taus[0][3, 0])


@pytest.mark.parametrize(
    "weight", [[1, 1, 1], [1, 1, 1, 0], [1, 1, 1, -2], [1, 1, 1, np.nan], ["1", 1, 1, 1], 1]
)
def test_weights_must_be_positive(weight):
    with pytest.raises(ModelError, match="weights must be 4 positive numbers"):
        system_of("tractor").first_feedback(ca.SX.sym("u", 3), weight)


# -- the three ways to S -------------------------------------------------------------------------------------


def test_null_space_given_outright():
    chosen = system_of("edge")
    robot = edge(quasi=False)
    heading = robot.coordinates[2].symbol
    robot.null_space(ca.blockcat([[cos(heading), 0], [sin(heading), 0], [0, 1]]), {"v": "m/s", "w": "rad/s"})
    other = reduce(robot)
    assert [v.name for v in other.quasi_velocities] == ["v", "w"] and other.dof == 2
    pairs = zip(
        samples(chosen, [chosen.S, chosen.Mbar, chosen.bias]),
        samples(other, [other.S, other.Mbar, other.bias]),
        strict=True,
    )
    for first, second in pairs:
        assert all(close(a, b, scale=np.abs(b).max() + 1) for a, b in zip(first, second, strict=True))


def test_null_space_computed():
    """The motion does not depend on the choice of S: qddot under the same inputs is the same."""
    chosen, computed = system_of("edge"), reduce(edge(quasi=False))
    assert computed.S.shape == (3, 2) and canonical(computed.mechanism.A @ computed.S).is_zero()
    qddot = []
    for system in (chosen, computed):
        q, p, tau, qdot = system.mechanism.q, system.mechanism.p, ca.SX.sym("tau", 2), ca.SX.sym("qdot", 3)
        nu = ca.pinv(system.S) @ qdot
        acceleration = system.S @ system.acceleration(tau) + system.Sdot @ system.nu
        qddot.append(
            ca.Function("f", [q, p, qdot, tau], [ca.substitute(acceleration, system.nu, nu), system.S @ nu])
        )
    rng = np.random.default_rng(5)
    for _ in range(STATES):
        q, p, tau = rng.uniform(-3, 3, 3), rng.uniform(0.5, 2, 5), rng.uniform(-3, 3, 2)
        speed, turn = rng.uniform(-3, 3, 2)
        qdot = [speed * np.cos(q[2]), speed * np.sin(q[2]), turn]
        (first, moved), (second, rates) = (f(q, p, qdot, tau) for f in qddot)
        assert close(moved, qdot) and close(rates, qdot) and close(second, first)


def test_computed_null_space_is_finite_everywhere():
    system = reduce(edge(quasi=False))
    S = ca.Function("S", [system.mechanism.q], [ca.densify(system.S)])
    assert all(np.abs(np.asarray(S([1, 2, angle]))).max() < 10 for angle in (0.0, np.pi / 2))


def test_tangent_does_not_hinder_elimination():
    """A car steered by tan(steer): with v, w given S = [cos; sin; tan(steer)/length],
    without a division by cos(heading)."""
    robot = plain(inputs="")
    x_dot, y_dot, h_dot = (v.symbol for v in robot.velocities)
    h, steer = robot.coordinates[2].symbol, robot.coordinate("steer", "rad")
    forward = cos(h) * x_dot + sin(h) * y_dot
    robot.kinetic_energy(robot.rate(steer) ** 2 / 2)
    robot.rolls("front", h_dot - forward * ca.tan(steer) / 2)
    for name, rate in (("v", forward), ("w", robot.rate(steer))):
        robot.input(f"f_{name}", "N", on=rate)
        robot.quasi_velocity(name, "m/s", rate)
    system = reduce(robot)
    assert ca.is_equal(canonical(system.S[0, 0]), cos(h), 2) and not ca.depends_on(system.S[2, 0], h)


def test_holonomic_constraint_from_its_position():
    """A bead on y = k x^2: m (1 + 4k^2x^2) xddot + 4 m k^2 x xdot^2 + 2 k x weight = push."""
    system = system_of("swinging")
    robot = system.mechanism
    x = robot.q[0]
    mass, weight, k = ca.vertsplit(robot.p)
    (nu,) = ca.vertsplit(system.nu)
    assert system.quasi_velocities[0].name == "x_rate"
    expected = [
        mass * (1 + 4 * k**2 * x**2),
        4 * mass * k**2 * x * nu**2 + 2 * k * x * weight,
        ca.vertcat(1, 2 * k * x),
    ]
    for *actual, Mbar, bias, S in samples(system, [system.Mbar, system.bias, system.S, *expected]):
        assert close(actual[0], Mbar) and close(actual[1], bias, scale=40.0) and close(actual[2], S)


def test_light_rotor_on_a_heavy_truck():
    robot = Mechanism("truck")
    place, roll, rotor = (robot.rate(robot.coordinate(name, "m")) for name in ("place", "roll", "rotor"))
    robot.kinetic_energy(4e4 * place**2 / 2 + 1e-6 * rotor**2 / 2)
    robot.rolls("wheel", place - roll / 2)
    robot.input("drive", "N", on=place)
    robot.input("motor", "N m", on=rotor)
    assert reduce(robot).dof == 2


def test_energy_added_after_a_look_at_M_counts():
    robot = plain()
    before = robot.M
    robot.kinetic_energy(5 * robot.velocities[0].symbol ** 2)
    assert not ca.is_equal(robot.M[0, 0], before[0, 0], 5)


def test_constant_matrices():
    """Everything linear: nothing to differentiate, Phidot and bias are zero."""
    robot = Mechanism("sledge")
    x, y = robot.coordinate("x", "m"), robot.coordinate("y", "m")
    robot.kinetic_energy((robot.rate(x) ** 2 + robot.rate(y) ** 2) / 2)
    robot.rolls("rail", robot.rate(x) - 2 * robot.rate(y))
    robot.input("push", "N", on=robot.rate(x))
    system = reduce(robot)
    law = control_law(system, OutputMap("place", "", (OutputRow("place", "m", "", x),)))
    assert close(ca.DM(system.S), [[1], [0.5]]) and close(ca.DM(system.Mbar), [[1.25]])
    assert system.bias.is_zero() and law.linearization.Phidot.is_zero() and law.linearization.drift.is_zero()


# -- paths ---------------------------------------------------------------------------------------------------


def test_user_defined_curve():
    """y = k sin(w x) with its own parameters: zero on the curve, unit slope across it,
    Phi singular where it should be."""
    k, w = config("k", 2.0, "m", "amplitude"), config("w", 0.3, "1/m", "wave number", "positive")
    path = implicit("wave", "sine wave", (k, w), lambda x, y: y - k.symbol * sin(w.symbol * x))
    system = labmate_system()
    law = control_law(system, type_iv(system, path))
    linear = law.linearization
    assert law.name == "type_iv_wave" and linear.relative_degree == (2, 1)
    assert [p.name for p in law.config] == ["L", "k", "w"]
    slope = ca.gradient(linear.h[0], system.mechanism.q)[:2]
    evaluate = law.function({"h": linear.h, "slope": slope, "det": linear.determinant})
    rng = np.random.default_rng(6)
    for values in random_values(7):
        values = values | {"config.k": rng.uniform(-3, 3), "config.w": rng.uniform(0.1, 1)}
        k_, w_, L, phi = (values[name] for name in ("config.k", "config.w", "config.L", "phi"))
        x_l = values["x_c"] + L * np.cos(phi)
        on_curve = values | {"y_c": k_ * np.sin(w_ * x_l) - L * np.sin(phi)}
        h, slope, det = (
            np.asarray(x) for x in evaluate.call(arguments(law, on_curve, (1, 2, 3), np.zeros((2, 3))))
        )
        normal = np.array([-k_ * w_ * np.cos(w_ * x_l), 1.0])
        normal /= np.linalg.norm(normal)
        lever = values["r"] ** 2 * (L + values["d"]) / (2 * values["b"])
        assert abs(h[0, 0]) <= 1e-13 * (abs(k_) + 1)
        assert h[1, 0] == pytest.approx(
            values["r"] * (values["thetadot_r"] + values["thetadot_l"]) / 2, rel=0, abs=1e-13
        )
        assert close(slope.ravel(), normal)
        assert close(det, lever * (normal[1] * np.cos(phi) - normal[0] * np.sin(phi)), scale=abs(lever))


def test_names_of_the_path_do_not_meet_those_of_the_robot():
    """A robot that calls its parameters L, A, R, x_f: the path's are others, and the law tells them apart."""
    robot = edge()
    L, A = (robot.parameter(name, 1.0, "m") for name in ("L", "A"))
    robot.kinetic_energy(L * A * robot.rate(robot.coordinates[2].symbol) ** 2 / 2)
    system = reduce(robot)
    law = control_law(system, OUTPUTS["type_iv_line"](system))
    before, after = (
        np.asarray(
            law.function({"h": law.linearization.h})(
                [2, 0.5, 1, 1, 1, L_, A_], [0.3, 1, -1, 0], [1, 2, 3], [1, 2, 0.4, 1, 1], [0] * 5
            )
        )
        for L_, A_ in ((1.0, 1.0), (5.0, 7.0))
    )
    assert np.array_equal(before, after)
    assert not ca.depends_on(system.Mbar, ca.vertcat(*[c.symbol for c in law.config]))


# -- exact simplification ------------------------------------------------------------------------------------

VARIABLES = [ca.SX.sym(name) for name in "xyz"]


def random_expression(rng: np.random.Generator, depth: int, leaves: list, s: Callable, c: Callable):
    """The same random rational trigonometric expression in whatever algebra the leaves and s, c belong to."""
    if depth == 0:
        kind, k, number = rng.integers(4), rng.integers(len(leaves)), int(rng.integers(1, 5))
        angle = leaves[k] if rng.integers(2) else leaves[0] + leaves[1]
        return (leaves[k], number + 0 * leaves[k], s(angle), c(angle))[kind]
    kind = rng.integers(6)
    left = random_expression(rng, depth - 1, leaves, s, c)
    if kind == 5:
        return left * left
    right = random_expression(rng, depth - 1, leaves, s, c)
    return (left + right, left - right, left * right, left * right, left / (right * right + 2))[kind]


def high_precision(expression: ca.SX, point: list) -> mpmath.mpf:
    """The expression's value in 50 digits: canonical() must be exact, not merely close in double."""
    rules = {
        **{
            ca.OP_ASSIGN: lambda a: a,
            ca.OP_NEG: lambda a: -a,
            ca.OP_SQ: lambda a: a * a,
            ca.OP_TWICE: lambda a: 2 * a,
        },
        **{
            ca.OP_INV: lambda a: 1 / a,
            ca.OP_SIN: mpmath.sin,
            ca.OP_COS: mpmath.cos,
            ca.OP_ADD: lambda a, b: a + b,
        },
        **{ca.OP_SUB: lambda a, b: a - b, ca.OP_MUL: lambda a, b: a * b, ca.OP_DIV: lambda a, b: a / b},
    }
    (value,) = fold(
        expression, VARIABLES, lambda k: point[k], mpmath.mpf, lambda code, arguments: rules[code](*arguments)
    )
    return value


@pytest.mark.parametrize("depth", [2, 3])
def test_canonical_keeps_the_value(depth):
    with mpmath.workdps(50):
        for seed in range(100):
            points = [
                [mpmath.mpf(x) for x in np.random.default_rng([seed, k]).uniform(-3, 3, 3)] for k in range(3)
            ]
            expression = random_expression(np.random.default_rng(seed), depth, VARIABLES, ca.sin, ca.cos)
            simplified = canonical(expression)
            for point in points:
                expected = random_expression(
                    np.random.default_rng(seed), depth, point, mpmath.sin, mpmath.cos
                )
                # only a leading factor such as 1/3 is rounded to double
                assert abs(high_precision(simplified, point) - expected) <= 1e-13 * abs(
                    expected
                ) + mpmath.mpf("1e-40"), expression


x, y, z = VARIABLES
EQUAL = {
    "pythagoras": (sin(x) ** 2 + cos(x) ** 2, 1),
    "of an expression": (sin(x * y) ** 2 + cos(x * y) ** 2, 1),
    "in a denominator": (x / (sin(y) ** 2 + cos(y) ** 2), x),
    "cubes": (cos(x) * cos(x) * cos(x) + cos(x) * sin(x) ** 2, cos(x)),
    "two angles": ((sin(x) ** 2 + cos(x) ** 2) * y - (sin(z) ** 2 + cos(z) ** 2) * y, 0),
    "common factor": ((x * y + x * z) / (y + z), x),
    "inverse": (1 / (1 / x), x),
    "conjugate": (sin(x) / (1 - cos(x)) - (1 + cos(x)) / sin(x), 0),
    "sum of fractions": (x / (x + y) + y / (x + y), 1),
    "decimals": (0.1 * x + 0.2 * x - x * 0.1 - x * 0.2, 0),
}


@pytest.mark.parametrize("name", EQUAL)
def test_canonical_finds(name):
    expression, expected = EQUAL[name]
    assert ca.is_equal(canonical(expression), ca.SX(expected), 1) or (
        expected == 0 and canonical(expression).is_zero()
    )


@pytest.mark.parametrize("power", [2, 3])
def test_canonical_keeps_a_power_of_a_small_denominator(power):
    """Written out as a sum, the power of a denominator of 1e-4 of its terms has lost 8 or 12 digits in 16;
    as a power, 4."""
    one, other = 10 * y * cos(x) + y - 13 * z * sin(x) ** 2, cos(x) + 0.1 - sin(x) * (1.3 * (z * sin(x)) / y)
    simple = canonical(3 * (13 * (z * sin(x)) / one) ** power + 7 / other**power)
    rng = np.random.default_rng(271)
    for _ in range(100):
        a, b = rng.uniform(0.5, 1.2), rng.uniform(0.5, 2.0)
        c = b * (10 * math.cos(a) + 1) / (13 * math.sin(a) ** 2) * (1 + 1e-4 * rng.uniform(1, 2))
        with mpmath.workdps(50):
            X, Y, Z = map(mpmath.mpf, (a, b, c))
            d = 10 * Y * mpmath.cos(X) + Y - 13 * Z * mpmath.sin(X) ** 2
            expected = 3 * (13 * Z * mpmath.sin(X) / d) ** power + 7 * (10 * Y / d) ** power
        value = float(ca.Function("simple", VARIABLES, [simple])(a, b, c))
        assert abs(value - expected) <= 1e-9 * abs(expected)


@pytest.mark.parametrize(
    "expression", [ca.sqrt(x) + y, ca.tan(x) * y, ca.exp(x), ca.fabs(x), ca.if_else(x > 0, x, y)]
)
def test_canonical_leaves_what_is_not_rational(expression):
    assert ca.is_equal(canonical(expression), expression, 20)


@pytest.mark.parametrize(
    "expression",
    [
        sin(1.0000001 * x) - sin(1.0000002 * x),
        sin(x) - sin(ca.SX.sym("x")),
        cos(x + 100000.1) * y - cos(x + 100000.2) * y,
    ],
    ids=["close constants", "two symbols of one name", "close offsets"],
)
def test_canonical_tells_arguments_apart(expression):
    assert not canonical(expression).is_zero()


@pytest.mark.parametrize("expression", [x * ca.inf, (x * 1e200) * (y * 1e200)], ids=["infinite", "overflow"])
def test_canonical_survives_constants(expression):
    canonical(expression)


@pytest.mark.parametrize(
    "expression",
    [x**2 + (y - z) ** 2, x / (x + y) + y / (y + z) + z / (z + 2 * x)],
    ids=["difference squared", "fractions"],
)
def test_canonical_does_not_lengthen(expression):
    assert ca.n_nodes(canonical(expression)) <= ca.n_nodes(expression)


@pytest.mark.parametrize(
    "expression", [sin(x) ** 2 / sin(x), (1 - cos(x) ** 2) / sin(x)], ids=["square", "one minus square"]
)
def test_canonical_cancels_a_sine(expression):
    assert ca.is_equal(canonical(expression), sin(x), 1)


@pytest.mark.parametrize("sign", [1, -1])
def test_canonical_gives_equals_one_expression(sign):
    """Equal entries, or one and its negative, come out as one expression,
    even where an entry's own form is kept."""
    first, second = x**2 + (y - z) ** 2, sign * (x**2 + y**2 - 2 * y * z + z**2)
    canonical_forms = canonical(ca.vertcat(first, second))
    assert ca.is_equal(sign * canonical_forms[0], canonical_forms[1], 2)


RADICALS = {
    "root squared": (ca.sqrt(x + y) ** 2, x + y),
    "inverse root": (ca.sqrt(x) / x, 1 / ca.sqrt(x)),
    "roots of equals": (ca.sqrt(x * y + x * z) - ca.sqrt(x * (y + z)), 0),
    "half powers": (x**1.5 * ca.sqrt(x), x**2),
    "tangent": (ca.tan(x) * cos(x), sin(x)),
    "angle written in two ways": (sin(x * y + x * z) - sin(x * (z + y)), 0),
    "root of a root": ((ca.sqrt(x + ca.sqrt(y)) ** 2 - x) ** 2, y),
    "root of a fraction": (ca.sqrt(x / y) ** 2 * y, x),
    "conjugate": (1 / (ca.sqrt(x) - 1) - (ca.sqrt(x) + 1) / (x - 1), 0),
    "unknown function": (ca.exp(x) * y / ca.exp(x), y),
    "sine below": (x / sin(y), x / sin(y)),
}


@pytest.mark.parametrize("name", RADICALS)
def test_canonical_knows_radicals(name):
    expression, expected = RADICALS[name]
    assert ca.is_equal(canonical(expression), ca.SX(expected), 5) or (
        expected == 0 and canonical(expression).is_zero()
    )


def test_canonical_cancels_a_removable_pole():
    """Even where the quotient is longer: a pivot that vanishes somewhere must not stay in a denominator."""
    f = ca.Function("f", [x], [canonical((x**5 - 1) / (x - 1))])
    assert float(f(1)) == 5.0


@pytest.mark.parametrize(
    "expression", [sum(VARIABLES) ** 40, 1 / sum(1 / (v + k) for k in range(9) for v in VARIABLES)]
)
def test_canonical_leaves_what_would_be_too_large(expression):
    assert ca.is_equal(canonical(expression), expression, 60)


@pytest.mark.parametrize("domain", [ZZ, QQ])
def test_ratios_are_in_lowest_terms_whatever_else_is_in_the_ring(domain):
    """As SymPy gives them in the whole ring, for random products of which few generators occur."""
    whole, *generators = ring([f"g{k}" for k in range(6)], domain)
    random = np.random.default_rng(3)

    def some(among) -> object:
        terms = (int(random.integers(-4, 5)) * g ** int(random.integers(1, 3)) for g in among)
        return sum(terms, start=whole(int(random.integers(1, 9))))

    for _ in range(40):
        among = [generators[k] for k in random.choice(6, random.integers(0, 4), replace=False)]
        common, above, below = (some(among) for _ in range(3))
        if not below * common:
            continue
        expected = (above * common).cancel(below * common)
        found = in_lowest_terms(above * common, below * common)
        assert found == expected and found[0].ring == found[1].ring == whole


def test_canonical_keeps_shape_and_drops_zeros():
    matrix = canonical(ca.blockcat([[x - x, y], [sin(x) ** 2 + cos(x) ** 2 - 1, z]]))
    assert matrix.shape == (2, 2) and matrix.nnz() == 2


# -- parameters and names ------------------------------------------------------------------------------------


@pytest.mark.parametrize("default", [2, 2.0, np.float64(2), np.float32(2), np.int64(2), Fraction(2)])
def test_defaults_may_be_any_real_number(default):
    robot = Mechanism("robot")
    robot.parameter("mass", default, "kg")
    assert robot.parameter_values({}) == [2.0] and type(robot.parameter_values({})[0]) is float


def test_parameter_values_fill_in_defaults():
    values = labmate().parameter_values({"r": 0.1, "d": -0.2, "m_w": 0})
    assert values == [0.75, -0.2, 0.1, 30.0, 0.0, 15.625, 0.005, 0.0025]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"r": 0.0}, "spec: r = 0 m must be positive (wheel radius"),
        ({"r": -1}, "spec: r = -1 m must be positive"),
        ({"m_w": -1.0}, "spec: m_w = -1 kg must be zero or positive"),
        ({"b": float("nan")}, "spec: b = nan is not finite"),
        ({"d": float("inf")}, "spec: d = inf is not finite"),
        ({"d": "0.3"}, "spec: d = '0.3' is not a number"),
        ({"d": True}, "spec: d = True is not a number"),
        ({"d": None}, "spec: d = None is not a number"),
        ({"d": 1j}, "spec: d = 1j is not a number"),
        ({"r": 10**400}, "spec: r = 100000000000... is too large"),
        (None, "spec: must be names with their values, not None"),
        ({"radius": 1.0}, "spec: unknown name 'radius'; known are I_c, I_m, I_w, b, d, m_c, m_w, r"),
    ],
)
def test_parameter_values_refused(values, message):
    with pytest.raises(ModelError) as error:
        labmate().parameter_values(values, "spec")
    assert message in str(error.value)


@pytest.mark.parametrize(
    "name",
    [
        "",
        "1st",
        "a-b",
        "a b",
        "_x",
        "x\n",
        "\u03b8",
        "\u00e9",
        "for",
        "int",
        "double",
        "lambda",
        "class",
        "register",
    ]
    + ["bool", "true", "NULL", "NAN", "template", "uint8_t", "int_fast16_t", None, 3],
)
def test_names_that_c_or_python_cannot_take(name):
    robot = Mechanism("robot")
    add = [
        Mechanism,
        lambda n: robot.coordinate(n, "m"),
        lambda n: robot.parameter(n, 1.0, "m"),
        lambda n: robot.input(n, "N", on=1),
    ]
    for make in (*add, lambda n: robot.quasi_velocity(n, "m", 1), lambda n: config(n, 0.0, "m", "")):
        with pytest.raises(
            ModelError, match="cannot be used in C: use letters, digits and _ only, no keyword of"
        ) as error:
            make(name)
        assert repr(name) in str(error.value)


@pytest.mark.parametrize("taken", ["x", "x_dot", "mass", "push", "v"])
def test_names_used_twice(taken):
    robot = edge()
    rate = robot.rate(robot.coordinates[0].symbol)
    for make in (
        lambda: robot.coordinate(taken, "m"),
        lambda: robot.parameter(taken, 1.0, "m"),
        lambda: robot.input(taken, "N", on=rate),
        lambda: robot.quasi_velocity(taken, "m/s", rate),
        lambda: robot.null_space(ca.SX(3, 2), {taken: "m/s"}),
    ):
        with pytest.raises(ModelError, match=f"edge: the name '{taken}' is used twice"):
            make()


def test_a_reduced_robot_takes_only_outputs():
    """What laws and plants have been made of does not change under them;
    a robot that cannot be reduced can be mended."""
    robot = edge()
    x, symbols = robot.coordinates[0].symbol, [q.symbol for q in robot.coordinates]
    assert not robot.reduced
    before = reduce(robot).Mbar
    changes = {
        "coordinate": ("s", "m"),
        "parameter": ("s", 1.0, "m"),
        "kinetic_energy": (robot.rate(x) ** 2,),
        "body": ("trailer", 1.0, 1.0, robot.rate(x), 0.0, 0.0),
        "potential_energy": (x,),
        "force": (1.0, robot.rate(x)),
        "rolls": ("another", robot.rate(x)),
        "holds": ("another", x),
        "input": ("more", "N", robot.rate(x)),
        "quasi_velocity": ("w", "m/s", robot.rate(x)),
        "null_space": (ca.SX(len(symbols), 1), {"w": "m/s"}),
        "moves_in_plane": (x, x, x),
        "contact": ("wheel", 1.0, robot.rate(x)),
    }
    for name, arguments_of_call in changes.items():
        with pytest.raises(
            ModelError, match=r"edge: \w+ was called after the robot was reduced, .* build a new Mechanism"
        ):
            getattr(robot, name)(*arguments_of_call)
    robot.output("place", "where it is", [(f"y{k}", "m", q) for k, q in enumerate(symbols[:2])])
    assert ca.is_equal(reduce(robot).Mbar, before, 20)


def test_unknown_sign():
    with pytest.raises(ModelError, match="mass: sign 'negative' is not one of positive, nonnegative, any"):
        Mechanism("robot").parameter("mass", 1.0, "kg", sign="negative")


# -- robots that the method cannot take ----------------------------------------------------------------------


def plain(constraint: bool = True, inputs: str = "xh") -> Mechanism:
    """Knife edge without quasi-velocities; `inputs` act on the rates of x, y, h(eading)."""
    robot = Mechanism("plain")
    rate = {}
    for name in "xyh":
        rate[name] = robot.rate(robot.coordinate(name, "m"))
        robot.kinetic_energy(rate[name] ** 2 / 2)
    h = robot.coordinates[2].symbol
    if constraint:
        robot.rolls("blade", cos(h) * rate["y"] - sin(h) * rate["x"])
    for k, name in enumerate(inputs):
        robot.input(f"f{k}", "N", on=rate[name])
    return robot


def having(act: Callable[[Mechanism, dict[str, ca.SX]], object], **options) -> Callable[[], object]:
    """Build `plain`, let `act` spoil it, reduce."""

    def build():
        robot = plain(**options)
        names = {c.name: c.symbol for c in robot.coordinates} | {v.name: v.symbol for v in robot.velocities}
        act(robot, names)
        return reduce(robot)

    return build


def quasi(*rows: Callable[[dict[str, ca.SX]], ca.SX]) -> Callable:
    def act(robot, s):
        for k, row in enumerate(rows):
            robot.quasi_velocity(f"n{k}", "m/s", row(s))

    return act


def null_space(matrix: Callable[[dict[str, ca.SX]], ca.SX], *names: str) -> Callable:
    return lambda robot, s: robot.null_space(matrix(s), dict.fromkeys(names or ("n0", "n1"), "m/s"))


def massless() -> Mechanism:
    """A rotor whose kinetic energy was forgotten."""
    robot = plain(inputs="xh")
    rotor = robot.coordinate("rotor", "rad")
    robot.input("motor", "N m", on=robot.rate(rotor))
    return reduce(robot)


def unknown() -> ca.SX:
    return ca.SX.sym("stranger")


def negative_mass(robot: Mechanism, s: dict[str, ca.SX]) -> None:
    robot.kinetic_energy(-3 * (s["x_dot"] ** 2 + s["y_dot"] ** 2))


def both_ways(robot: Mechanism, s: dict[str, ca.SX]) -> None:
    quasi(lambda s: s["h_dot"])(robot, s)
    null_space(along, "n2", "n3")(robot, s)


def along(s: dict[str, ca.SX]) -> ca.SX:
    return ca.blockcat([[cos(s["h"]), 0], [sin(s["h"]), 0], [0, 1]])


REFUSED = {
    "no coordinates": (lambda: reduce(Mechanism("plain")), "plain: no coordinates; add them with coordinate"),
    "no constraints": (lambda: reduce(plain(constraint=False)), "plain: no constraints; add them with rolls"),
    "no inputs": (lambda: reduce(plain(inputs="")), "plain: no inputs; add them with input"),
    "no motion left": (
        having(lambda robot, s: [robot.rolls(name, s[f"{name}_dot"]) for name in "xh"]),
        "plain: 3 constraints allow no motion in 3 coordinates",
    ),
    "dependent constraints": (
        having(
            lambda robot, s: robot.rolls("again", 2 * sin(s["h"]) * s["x_dot"] - 2 * cos(s["h"]) * s["y_dot"])
        ),
        "plain: the constraints are not independent: 'again' follows from the others; remove it",
    ),
    "constraint that says nothing": (
        having(lambda robot, s: robot.rolls("nothing", 0)),
        "'nothing' follows from the others",
    ),
    "too few inputs": (
        lambda: reduce(plain(inputs="h")),
        "plain: 1 input for n - m = 2 degrees of freedom; an underactuated robot",
    ),
    "inputs on one motion": (
        lambda: reduce(plain(inputs="hh")),
        "plain: S'E has rank below n - m = 2: the inputs do not affect every motion",
    ),
    "massless": (massless, "plain: the mass matrix S'MS is singular: a motion without kinetic energy"),
    "constraint not linear": (
        having(lambda robot, s: robot.rolls("square", s["x_dot"] ** 2)),
        "not linear in the coordinates' rates",
    ),
    "constraint on a position": (
        having(lambda robot, s: robot.rolls("place", s["x"])),
        "not linear in the coordinates' rates",
    ),
    "constraint with a drift": (
        having(lambda robot, s: robot.rolls("belt", s["x_dot"] - 1)),
        "not linear in the coordinates' rates",
    ),
    "input not linear": (
        having(lambda robot, s: robot.input("f", "N", on=s["x_dot"] * s["y_dot"])),
        "not linear in the coordinates' rates",
    ),
    "quasi-velocity not linear": (
        having(quasi(lambda s: s["h_dot"] ** 2, lambda s: s["x_dot"])),
        "not linear in the coordinates' rates",
    ),
    "kinetic energy cubic": (
        having(lambda robot, s: robot.kinetic_energy(s["x_dot"] ** 3)),
        "plain: the kinetic energy is not quadratic in the rates",
    ),
    "kinetic energy of a stranger": (
        having(lambda robot, s: robot.kinetic_energy(unknown())),
        "plain: the kinetic energy uses stranger, which is no",
    ),
    "potential energy of a stranger": (
        having(lambda robot, s: robot.potential_energy(unknown())),
        "plain: the potential energy uses stranger",
    ),
    "constraint of a stranger": (
        having(lambda robot, s: robot.rolls("odd", unknown() * s["x_dot"])),
        "plain: constraint 'odd' uses stranger",
    ),
    "input of a stranger": (
        having(lambda robot, s: robot.input("f", "N", on=unknown() * s["x_dot"])),
        "plain: input 'f' uses stranger",
    ),
    "force of a stranger": (
        having(lambda robot, s: robot.force(unknown(), on=s["x_dot"])),
        "plain: a force uses stranger",
    ),
    "quasi-velocity of a stranger": (
        having(quasi(lambda s: unknown() * s["x_dot"])),
        "plain: a quasi-velocity uses stranger",
    ),
    "one quasi-velocity": (
        having(quasi(lambda s: s["h_dot"])),
        "plain: 1 quasi-velocities; there must be n - m = 2",
    ),
    "dependent quasi-velocities": (
        having(quasi(lambda s: s["h_dot"], lambda s: 2 * s["h_dot"])),
        "plain: the quasi-velocities do not determine the motion: they depend on the constraints or on each "
        "other",
    ),
    "S of the wrong shape": (
        having(null_space(lambda s: ca.SX.eye(3))),
        "plain: S is 3 x 3; it must be n x (n-m) = 3 x 2",
    ),
    "S with dependent columns": (
        having(null_space(lambda s: ca.SX(3, 2))),
        "plain: the columns of S are dependent",
    ),
    "S off the constraint": (
        having(null_space(lambda s: ca.blockcat([[sin(s["h"]), 0], [cos(s["h"]), 0], [0, 1]]))),
        "S does not satisfy constraint 'blade'",
    ),
    "matrix for a scalar": (
        having(lambda robot, s: robot.kinetic_energy(ca.SX(2, 1))),
        "plain: kinetic energy must be a scalar; it is 2 x 1",
    ),
    "MX energy": (
        having(lambda robot, s: robot.kinetic_energy(ca.MX.sym("a"))),
        "plain: kinetic energy is not an expression: MX(a)",
    ),
    "text for an expression": (
        having(lambda robot, s: robot.rolls("c", "x_dot")),
        "plain: constraint 'c' is not an expression: 'x_dot'",
    ),
    "MX rate": (
        having(lambda robot, s: robot.rate(ca.MX.sym("a"))),
        "plain: rate is not an expression: MX(a)",
    ),
    "potential energy of rates": (
        having(lambda robot, s: robot.potential_energy(s["x_dot"] ** 2)),
        "potential energy",
    ),
    "force on a position": (having(lambda robot, s: robot.force(-s["x"], on=s["x"])), "force"),
    "force on a square": (having(lambda robot, s: robot.force(1, on=s["x_dot"] ** 2)), "force"),
    "negative mass": (having(negative_mass), "positive"),
    "rate of a rate": (having(lambda robot, s: robot.rate(s["x_dot"])), "rate"),
    "constraint name twice": (
        having(lambda robot, s: robot.rolls("blade", s["x_dot"])),
        "'blade' is used twice",
    ),
    "which row is not linear": (having(lambda robot, s: robot.rolls("square", s["x_dot"] ** 2)), "'square'"),
    "S with a name missing": (having(null_space(along, "n0")), "1 quasi-velocities; there must be n - m = 2"),
    "S of a stranger": (having(null_space(lambda s: along(s) * unknown())), "stranger"),
    "S and quasi-velocities": (having(both_ways), "null_space"),
    "MX for S": (
        having(lambda robot, s: robot.null_space(ca.MX.sym("a", 3, 2), {"n0": "1", "n1": "1"})),
        "MX",
    ),
    "MX for the vehicle": (
        having(lambda robot, s: robot.moves_in_plane(ca.MX.sym("a"), s["y"], s["h"])),
        "MX",
    ),
    "vector for the vehicle": (
        having(lambda robot, s: robot.moves_in_plane(ca.SX(2, 1), s["y"], s["h"])),
        "2 x 1",
    ),
    "kinetic energy linear": (
        having(lambda robot, s: robot.kinetic_energy(s["x"] * s["y_dot"])),
        "plain: the kinetic energy is not quadratic in the rates",
    ),
    "constraint that holds a rate": (
        having(lambda robot, s: robot.holds("c", s["x_dot"])),
        "plain: constraint 'c' uses rates",
    ),
    "which input is not linear": (
        having(lambda robot, s: robot.input("f", "N", on=s["x_dot"] ** 2)),
        "input 'f' is not linear",
    ),
    "which quasi-velocity is not linear": (
        having(quasi(lambda s: s["x"])),
        "quasi-velocity 'n0' is not linear",
    ),
    "automatic name twice": (
        having(lambda robot, s: robot.parameter("x_rate", 1.0, "1")),
        "the name 'x_rate' is used twice: it is also that of an automatically chosen quasi-velocity",
    ),
    "rate's name twice": (
        having(lambda robot, s: [robot.parameter("z_dot", 1.0, "1"), robot.coordinate("z", "m")]),
        "'z_dot' is used",
    ),
    "null space twice": (
        having(lambda robot, s: [null_space(along, *names)(robot, s) for names in ("ab", "cd")]),
        "null_space after",
    ),
    "nothing for an expression": (
        having(lambda robot, s: robot.force(None, on=s["x_dot"])),
        "plain: force is not an expression: None",
    ),
    "unit that ends a comment": (
        having(lambda robot, s: robot.coordinate("z", "*/")),
        "z: unit '*/' must be text",
    ),
    "no name for a constraint": (
        having(lambda robot, s: robot.rolls(None, s["x_dot"])),
        "a constraint's name must be text",
    ),
    "not finite": (
        having(lambda robot, s: robot.rolls("c", s["x_dot"] * ca.sqrt(s["x"] - 5))),
        "plain: A: not finite at any of",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_robot_refused(case):
    build, message = REFUSED[case]
    with pytest.raises(ModelError) as error:
        build()
    assert message in str(error.value) and "\n" not in str(error.value)


# -- outputs that the method cannot take ---------------------------------------------------------------------


def rows(*expressions: Callable[[ReducedSystem], ca.SX]) -> OutputMap:
    system = system_of("edge")
    return OutputMap(
        "mine", "", tuple(OutputRow(f"row{k}", "m", "", make(system)) for k, make in enumerate(expressions))
    )


def place(system: ReducedSystem) -> ca.SX:
    return system.mechanism.q[0]


def heading(system: ReducedSystem) -> ca.SX:
    return system.mechanism.q[2]


def law_of(*expressions: Callable[[ReducedSystem], ca.SX], name: str = "mine") -> ControlLaw:
    outputs = rows(*expressions)
    return control_law(system_of("edge"), OutputMap(name, "", outputs.rows))


def same_names(first: str, second: str) -> ControlLaw:
    system = system_of("edge")
    both = (OutputRow(first, "m", "", place(system)), OutputRow(second, "rad", "", heading(system)))
    return control_law(system, OutputMap("mine", "", both))


OUTPUTS_REFUSED = {
    "too few": (
        lambda: linearize(system_of("edge"), rows(place)),
        "edge, output mine: 1 output for n - m = 2",
    ),
    "too many": (
        lambda: linearize(system_of("edge"), rows(place, heading, heading)),
        "edge, output mine: 3 outputs for n - m = 2",
    ),
    "does not move": (
        lambda: linearize(system_of("edge"), rows(place, lambda s: s.mechanism.p[0])),
        "row 'row1' of Phi vanishes identically",
    ),
    "kept by a constraint": (
        lambda: linearize(system_of("swinging"), OutputMap("mine", "", (kept(),))),
        "swinging, output mine: row 'kept' of Phi vanishes identically",
    ),
    "row name": (
        lambda: control_law(
            system_of("edge"),
            OutputMap("mine", "", (OutputRow("a b", "m", "", place(system_of("edge"))),) * 2),
        ),
        "'a b'",
    ),
    "no vehicle": (
        lambda: OUTPUTS["type_i"](system_of("swinging")),
        "swinging: Types I to IV require the pose of the vehicle",
    ),
    "path without a point": (
        lambda: type_iv(labmate_system(), implicit("flat", "", (), lambda x, y: ca.SX(1))),
        "path 'flat': f(x, y) does not depend on x or y",
    ),
    "Phi singular everywhere": (lambda: law_of(heading, lambda s: 2 * heading(s)), "singular"),
    "output in the robot's rates": (lambda: law_of(lambda s: s.mechanism.qdot[0], heading), "x_dot"),
    "output of a stranger": (lambda: law_of(lambda s: place(s) + unknown(), heading), "stranger"),
    "output not scalar": (lambda: law_of(lambda s: s.mechanism.q, heading), "3 x 1"),
    "output MX": (lambda: law_of(lambda s: ca.MX.sym("a"), heading), "row0"),
    "output map's name": (lambda: law_of(place, heading, name="a b"), "'a b'"),
    "two rows of one name": (lambda: same_names("p", "p"), "'p' is used twice"),
    "names of a row and of a rate": (
        lambda: same_names("p", "p_rate"),
        "edge, output mine, reference: the name 'p_rate' is used twice",
    ),
    "two parameters of one name": (
        lambda: linearize(
            system_of("edge"),
            OutputMap("mine", "", rows(place, heading).rows, (config("k", 1.0, "", ""),) * 2),
        ),
        "parameters: the name 'k' is used twice",
    ),
    "quasi-velocity not felt": (
        lambda: law_of(place, lambda s: s.nu[0]),
        "Phi is singular everywhere: no output depends on the input along w",
    ),
    "path of nothing": (
        lambda: type_iv(labmate_system(), implicit("flat", "", (), lambda x, y: None)),
        "path 'flat': f(x, y) is no",
    ),
}


def kept() -> OutputRow:
    system = system_of("swinging")
    (x, y), k = ca.vertsplit(system.mechanism.q), system.mechanism.p[2]
    return OutputRow("kept", "m", "", y - k * x**2)


@pytest.mark.parametrize("case", OUTPUTS_REFUSED)
def test_output_refused(case):
    build, message = OUTPUTS_REFUSED[case]
    with pytest.raises(ModelError) as error:
        build()
    assert message in str(error.value) and "\n" not in str(error.value)


def test_factors_are_those_of_sympy_in_its_order():
    """Of random products with up to four variables; and of a polynomial over a finite field."""
    R, random = PolyRing(list("abcd"), QQ, "lex"), np.random.default_rng(8)

    def drawn() -> PolyElement:
        powers, above, below = (
            random.integers(0, 3, (4, 4)),
            random.integers(-6, 7, 4),
            random.integers(1, 4, 4),
        )
        return R.from_dict(
            {
                tuple(map(int, p)): QQ(int(x), int(y))
                for p, x, y in zip(powers, above, below, strict=True)
                if x
            }
        )

    for _ in range(60):
        product = drawn() * drawn() * drawn() ** int(random.integers(1, 3))
        if product:
            content, factors = product.factor_list()
            assert factored(product) == (content, tuple(factors))
    (x,) = (finite := PolyRing(["x"], GF(7), "lex")).gens
    assert len(factored(x**2 - finite.one)[1]) == 2
