"""The shipped robots against independent derivations, against the laws of mechanics,
and against what is known of them."""

import json
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from casadi import cos, sin
from noslip.analysis.answers import analyse
from noslip.analysis.outer.motion import steady_motion
from noslip.analysis.outer.setting import setting_of
from noslip.cli.main import main
from noslip.model import Mechanism, ModelError, config, reduce
from noslip.model.algebra.entries import by_addition_theorems
from noslip.model.algebra.exact import canonical
from noslip.model.contacts import combination
from noslip.model.reduction import ReducedSystem
from noslip.model.robots import ROBOTS
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_laws, find_robot, law_of, system_of
from noslip.simulation.closed_loop import simulate
from noslip.simulation.loop import make_loop
from noslip.simulation.specification.spec import Initial, Reference, read_spec
from noslip.tests.reference.independent import DERIVATIONS, Motion, motion
from scipy.integrate import solve_ivp

NAMES = tuple(DERIVATIONS)
VEHICLES = ("knife_edge", "rolling_disk", "car", "tricycle", "slope_platform", "bus", "castor_platform")
STATES = 25
SPECS = Path(__file__).parents[2] / "examples/specs" / "robots"


@dataclass(frozen=True)
class State:
    """Numbers in the orders of q, nu, the inputs and the parameters."""

    q: np.ndarray
    nu: np.ndarray
    tau: np.ndarray
    p: np.ndarray


@cache
def system(name: str) -> ReducedSystem:
    return system_of(find_robot(name))


@cache
def reduced(name: str) -> ca.Function:
    """From a state: qdot, qddot, Mbar, A S, energy and its rate, and the power of the inputs."""
    model = system(name)
    robot, tau = model.mechanism, ca.SX.sym("tau", len(model.mechanism.inputs))
    nudot = model.acceleration(tau)
    qddot = model.S @ nudot + model.Sdot @ model.nu
    rate = ca.jtimes(robot.energy(), ca.vertcat(robot.q, robot.qdot), ca.vertcat(robot.qdot, qddot))
    energies = [ca.substitute(e, robot.qdot, model.qdot) for e in (robot.energy(), rate)]
    power = ca.dot(tau, robot.E.T @ model.qdot)
    answers = [model.qdot, qddot, model.Mbar, robot.A @ model.S, *energies, power]
    return ca.Function(
        "reduced", [robot.q, model.nu, tau, robot.p], [ca.densify(answer) for answer in answers]
    )


def answers(name: str, state: State) -> list[np.ndarray]:
    return [value.full() for value in reduced(name)(state.q, state.nu, state.tau, state.p)]


def states(name: str, count: int = STATES) -> list[State]:
    """Random ones, in reach of every coordinate patch; parameters around their defaults."""
    robot, random = system(name).mechanism, np.random.default_rng(8)
    defaults = np.array([parameter.default for parameter in robot.parameters])
    sizes = len(robot.coordinates), system(name).dof, len(robot.inputs)
    return [
        State(
            random.uniform(-1.2, 1.2, sizes[0]),
            *(random.uniform(-2.0, 2.0, size) for size in sizes[1:]),
            defaults * random.uniform(0.7, 1.3, len(defaults)),
        )
        for _ in range(count)
    ]


def by_name(name: str, state: State) -> tuple[Motion, list[np.ndarray]]:
    """The independent motion, and q, tau and parameters in its order."""
    robot, other = system(name).mechanism, motion(name)
    pairs = (
        (robot.coordinates, state.q, other.coordinates),
        (robot.inputs, state.tau, other.inputs),
        (robot.parameters, state.p, other.parameters),
    )
    groups = []
    for quantities, values, names in pairs:
        value_of = {quantity.name: value for quantity, value in zip(quantities, values, strict=True)}
        assert sorted(value_of) == sorted(names)
        groups.append(np.array([value_of[each] for each in names]))
    return other, groups


def close(value, expected, tolerance: float) -> bool:
    """To `tolerance` of the largest entry expected."""
    value, expected = np.ravel(value), np.ravel(expected)
    return bool(np.abs(value - expected).max() <= tolerance * np.abs(expected).max())


def test_every_derivation_is_of_a_shipped_robot():
    assert set(NAMES) <= set(ROBOTS) and all(ROBOTS[name]().name == name for name in ROBOTS)


def test_what_can_be_bought_is_as_its_sources_say():
    """Total masses, and the loads on wheels that their centres of mass give, in kg."""
    for name, mass, loads in (
        ("pioneer_3dx", 9.0, [(9.0 - (6.73 * 0.06 + 0.21 * 0.211) / 0.211) / 2] * 2),
        ("f1tenth", 3.74, [3.74 * 0.15875 / 0.3302, 3.74 * 0.17145 / 0.3302]),
        ("forklift", 600.0, [600 * 0.4225 / 1.3725, 600 * 0.95 / 1.3725]),
    ):
        robot = find_robot(name)
        f = ca.Function(
            "f",
            [robot.q, robot.p],
            [robot.M[0, 0], ca.vertcat(*[contact.mass for contact in robot.contacts])],
        )
        found = [value.full().ravel() for value in f(np.zeros(5), robot.parameter_values({}))]
        assert found[0] == pytest.approx([mass], rel=1e-12) and found[1] == pytest.approx(loads, rel=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_accelerations_are_those_of_kane_and_lagrange(name):
    """qddot of all coordinates at random states, inputs and parameters."""
    assert [q.name for q in system(name).mechanism.coordinates] == list(motion(name).coordinates)
    for state in states(name):
        other, (q, tau, p) = by_name(name, state)
        qdot, qddot, *_ = answers(name, state)
        assert close(qddot, other.acceleration(q, qdot[:, 0], tau, p), 1e-10)


@pytest.mark.parametrize("name", NAMES)
def test_what_touches_does_not_move(name):
    """A S = 0, and the velocities at the contacts vanish as bodies and frames give them,
    rotation matrices for the ball."""
    for state in states(name):
        other, (q, tau, p) = by_name(name, state)
        qdot, _, _, AS, *_ = answers(name, state)
        assert np.abs(AS).max() < 1e-12
        slip = np.ravel(other.slip(q, qdot[:, 0], tau, p))
        assert len(slip) == system(name).mechanism.A.shape[0]
        assert np.abs(slip).max() < 1e-12 * max(1.0, np.abs(qdot).max())
        moved = np.ravel(other.slip(q, qdot[:, 0] + 1.0, tau, p))
        assert np.abs(moved).max() > 1e-3  # so that the test can fail


@pytest.mark.parametrize("name", NAMES)
def test_the_reduced_mass_matrix_is_symmetric_and_positive(name):
    for state in states(name):
        Mbar = answers(name, state)[2]
        assert close(Mbar, Mbar.T, 1e-13) and np.linalg.eigvalsh(Mbar).min() > 0.0


@pytest.mark.parametrize("name", NAMES)
def test_the_rate_of_energy_is_the_power_of_the_inputs_less_friction(name):
    """At random states; energy and power are those of the independent derivation too."""
    for state in states(name):
        other, (q, tau, p) = by_name(name, state)
        qdot, *_ = answers(name, state)
        energy, rate, power = (value.item() for value in answers(name, state)[-3:])
        parameters = {
            quantity.name: value
            for quantity, value in zip(system(name).mechanism.parameters, state.p, strict=True)
        }
        friction = parameters["c"] * np.sum(qdot[3:, 0] ** 2) if name == "slope_platform" else 0.0
        size = abs(power) + friction + abs(energy)
        assert abs(rate - (power - friction)) < 1e-11 * size
        assert abs(energy - float(other.energy(q, qdot[:, 0], tau, p))) < 1e-11 * size
        assert abs(power - friction - float(other.power(q, qdot[:, 0], tau, p))) < 1e-11 * size


@pytest.mark.parametrize("name", NAMES)
def test_energy_is_conserved_without_inputs_and_friction(name):
    state = replace(states(name, 1)[0], tau=np.zeros(len(system(name).mechanism.inputs)))
    names = [parameter.name for parameter in system(name).mechanism.parameters]
    if name == "slope_platform":
        state.p[names.index("c")] = 0.0
    n, model = len(state.q), system(name)
    robot, tau = model.mechanism, ca.DM(state.tau)
    rate = ca.Function(
        "rate", [robot.q, model.nu, robot.p], [ca.vertcat(model.qdot, model.acceleration(tau))]
    )

    def motion_of(_: float, x: np.ndarray) -> np.ndarray:
        return rate(x[:n], x[n:], state.p).full()[:, 0]

    # slow: a ball that comes to a pole of its coordinates tells nothing
    start = np.concatenate([state.q, 0.3 * state.nu])
    solution = solve_ivp(motion_of, (0.0, 2.0), start, "DOP853", rtol=1e-12, atol=1e-13)
    energies = [answers(name, State(x[:n], x[n:], state.tau, state.p))[4].item() for x in solution.y.T]
    kinetic = energies[0] - answers(name, State(state.q, 0 * state.nu, state.tau, state.p))[4].item()
    assert solution.success and np.ptp(solution.y, axis=1).max() > 0.1
    assert np.ptp(energies) < 1e-10 * max(kinetic, np.abs(energies).max())


def test_the_arm_hangs_still_only_where_gravity_lets_it():
    """Torques that hold it: N tau = gradient of the weight's potential, by hand."""
    arm = system("geared_arm")
    p = {parameter.name: parameter.default for parameter in arm.mechanism.parameters}
    q_1, q_2 = 0.4, -0.9
    second = p["m_2"] * p["g"] * p["c_2"] * np.cos(q_1 + q_2)
    first = second + p["g"] * np.cos(q_1) * (p["m_1"] * p["c_1"] + p["m_2"] * p["l_1"])
    state = State(
        np.array([q_1, q_2, 0, 0]),
        np.zeros(2),
        np.array([first, second]) / p["N"],
        np.array(list(p.values())),
    )
    assert np.abs(answers("geared_arm", state)[1]).max() < 1e-12


# -- contacts ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*VEHICLES, "mobile_manipulator", "mecanum"])
def test_contacts_stand_still_and_carry_the_weight(name):
    robot = system(name).mechanism
    defaults = {parameter.name: parameter.default for parameter in robot.parameters}
    carried = ca.Function(
        "carried", [robot.q, robot.p], [sum(c.mass for c in robot.contacts), combination(robot)]
    )
    mass, C = (
        value.full() for value in carried(np.full(len(robot.coordinates), 0.3), list(defaults.values()))
    )
    weights = {
        "slope_platform": (defaults.get("m_c", 0) + 2 * defaults.get("m_w", 0))
        * np.cos(defaults.get("slope", 0)),
        "mobile_manipulator": sum(defaults.get(m, 0) for m in ("m_c", "m_w", "m_w", "m_1", "m_2")),
        "castor_platform": sum(defaults.get(m, 0) for m in ("m", "m_k", "m_k")),
    }
    assert abs(mass.item() - weights.get(name, defaults.get("m"))) < 1e-12 * mass.item() and np.all(
        np.isfinite(C)
    )


# -- what is known of them -----------------------------------------------------------------------------------

# Bloch (2003), 1.6 and 1.4; Murray, Li, Sastry (1994), 7 and 8 for car (2, 3, 4) and ball; each with the
# angle of a driven wheel here, which is one dimension more.
GROWTH = {
    "knife_edge": (2, 3),
    "rolling_disk": (2, 3, 4),
    "car": (2, 3, 4, 5),
    "tricycle": (2, 3, 5),
    "ball_plate": (2, 3, 5),
    "mobile_manipulator": (4, 5, 6),
    "geared_arm": (2,),
    "slope_platform": (2, 3, 4),
    "bus": (2, 3, 5),
    "castor_platform": (2, 3, 5, 7, 8),
    "mecanum": (3, 5),
}


@cache
def analysed(name: str):
    return analyse(find_robot(name))


@pytest.mark.parametrize("name", NAMES)
def test_growth_is_what_is_known_and_what_brackets_give(name):
    """Ranks of numeric brackets at a random state, by the derivatives of S alone."""
    constraints = analysed(name).constraints
    assert constraints.growth == GROWTH[name] and constraints.k == constraints.n - GROWTH[name][-1]
    robot, S = system(name).mechanism, system(name).S
    state, levels, fields = states(name, 1)[0], [], ca.horzsplit(ca.densify(S))
    first, last = fields, fields
    for _ in GROWTH[name]:
        spanned = ca.Function("spanned", [robot.q, robot.p], [ca.horzcat(*fields)])(state.q, state.p).full()
        levels.append(np.linalg.matrix_rank(spanned / np.linalg.norm(spanned, axis=0).clip(1e-9), tol=1e-9))
        last = [ca.jtimes(b, robot.q, a) - ca.jtimes(a, robot.q, b) for a in first for b in last]
        fields = [*fields, *last]
    assert tuple(levels) == GROWTH[name]


@pytest.mark.nightly
def test_integrals_are_the_gears_and_the_plates():
    """q that never leaves a level set: each integral's rate vanishes along every column of S."""
    for name, count in (
        ("geared_arm", 2),
        ("ball_plate", 2),
        ("mobile_manipulator", 1),
        ("slope_platform", 1),
        ("mecanum", 2),
    ):
        robot, S = system(name).mechanism, system(name).S
        texts = analysed(name).constraints.json["integrals"]
        symbol_of = {q.name: q.symbol for q in (*robot.coordinates, *robot.parameters)}
        assert len(texts) == count
        for text in texts:
            left, right = text.split(" = ")
            integral = eval(
                f"{left} - ({right.removesuffix('const').removesuffix(' + ') or 0})",
                {"__builtins__": {}, "sin": ca.sin, "cos": ca.cos},
                symbol_of,
            )
            assert canonical(ca.jacobian(integral, robot.q) @ S).is_zero(), text


SINGULAR = {
    ("knife_edge", "type_i"): "L",
    ("rolling_disk", "type_i"): "L*R",
    ("car", "type_i"): "L*r/cos(delta)",
    ("tricycle", "type_i"): "L*r",
    ("tricycle", "type_ii"): "r*cos(phi + delta)",
    ("bus", "type_i"): "L*r*cos(k*delta)/cos(delta)",
    ("geared_arm", "tip"): "l_1*l_2*sin(q_2)",
    ("geared_arm", "joints"): "1",
    ("ball_plate", "ball"): "1",
}


@pytest.mark.parametrize(("name", "law"), SINGULAR)
def test_determinants_in_closed_form(name, law):
    """Derived by hand: a steered wheel moves as a unicycle does,
    at r theta' / cos(delta) behind a driven rear axle."""
    determinant = sp.sympify(analysed(name).outputs[law].decoupling.det_in_full)
    names = {str(s): s for s in determinant.free_symbols}
    expected = sp.sympify(SINGULAR[name, law], {"I": sp.Symbol("I"), **names})
    assert sp.simplify(sp.expand_trig(determinant**2 - expected**2)) == 0


def rates_of(name: str, state: State) -> dict[str, float]:
    """The rates of the coordinates, and the quasi-velocities, by name."""
    model = system(name)
    found = {
        q.name: rate
        for q, rate in zip(model.mechanism.coordinates, answers(name, state)[0][:, 0], strict=True)
    }
    return {**found, **{q.name: rate for q, rate in zip(model.quasi_velocities, state.nu, strict=True)}}


def test_mecanum_wheels_turn_as_in_the_literature():
    """Inverse kinematics: (v_x -+ v_y -+ (l_x + l_y) w) / r for rollers at 45 degrees (Lynch, Park,
    Modern Robotics, 13.2)."""
    for state in states("mecanum"):
        p = dict(zip([q.name for q in system("mecanum").mechanism.parameters], state.p, strict=True)) | {
            "gamma": np.pi / 4
        }
        moved = rates_of("mecanum", replace(state, p=np.array(list(p.values()))))
        arm = (p["l_x"] + p["l_y"]) * moved["yaw_rate"]
        for at, aside, turned in (("fl", -1, -1), ("fr", 1, 1), ("rl", 1, -1), ("rr", -1, 1)):
            expected = (moved["forward"] + aside * moved["left"] + turned * arm) / p["r"]
            assert abs(moved[f"theta_{at}"] - expected) < 1e-12 * max(1.0, abs(expected))


def test_a_bus_turns_about_the_point_where_its_axles_meet():
    """Of a body with both axles steered, by d and -k d: yaw rate = v (tan d + tan k d) / l at the speed v
    along its heading; with an axle that is not steered it is the car.
    """
    bus_of, car_of = ([q.name for q in system(name).mechanism.parameters] for name in ("bus", "car"))
    for state in states("bus"):
        p = dict(zip(bus_of, state.p, strict=True))
        moved, (phi, delta) = rates_of("bus", state), state.q[2:4]
        along = np.cos(phi) * moved["x"] + np.sin(phi) * moved["y"]
        assert along == pytest.approx(p["r"] * moved["thetadot"] * np.cos(p["k"] * delta), rel=1e-12)
        assert moved["phi"] == pytest.approx(
            along * (np.tan(delta) + np.tan(p["k"] * delta)) / p["l"], rel=1e-11
        )
        fixed = p | {"k": 0.0, "I_r": 0.0}
        one = answers("bus", replace(state, p=np.array(list(fixed.values()))))
        other = answers("car", replace(state, p=np.array([fixed[name] for name in car_of])))
        assert all(close(a, b, 1e-12) for a, b in zip(one[:3], other[:3], strict=True))


def test_castors_swing_behind_their_pins():
    """Pulled straight ahead by s, tan(beta / 2) decays as exp(-s / trail),
    whichever way a castor lies at first."""
    model = system("castor_platform")
    parameters, start = model.mechanism.parameter_values({}), np.array([0, 0, 0, 0, 0, 2.0, 0, -1.5, 0.0])
    p = {q.name: q.default for q in model.mechanism.parameters}
    qdot = ca.Function("qdot", [model.mechanism.q, model.nu, model.mechanism.p], [model.qdot])
    run = solve_ivp(
        lambda _, q: qdot(q, [1.0, 0.0], parameters).full()[:, 0],
        (0, 0.1),
        start,
        "DOP853",
        rtol=1e-11,
        atol=1e-12,
    )
    assert run.y[0, -1] == pytest.approx(0.1, abs=1e-12)  # at 1 m/s
    for k in (5, 7):
        assert np.tan(run.y[k, -1] / 2) == pytest.approx(
            np.tan(start[k] / 2) * np.exp(-0.1 / p["c"]), rel=1e-8
        )


def test_a_vehicle_starts_with_its_wheels_straight():
    """Point and heading are those of the steered wheel: the body takes the heading,
    the steering angle stays zero."""
    spec = replace(read_spec(SPECS / "car.toml"), initial=Initial(point=(17.0, 0.0), heading=1.0, speed=3.0))
    start = make_loop(replace(spec, simulation=replace(spec.simulation, backend="casadi"))).start
    front = np.array([17.0, 0.0]) - 1.0 * np.array([np.cos(1.0), np.sin(1.0)])
    rear = front - 2.6 * np.array([np.cos(1.0), np.sin(1.0)])
    assert np.abs(start - [*rear, 1.0, 0.0, 0.0, 3.0 / 0.3, 0.0]).max() < 1e-9


def test_a_steered_wheel_in_a_steady_turn():
    """About a circle of radius R its steering angle is asin(l / R_f),
    with R_f^2 = R^2 - L^2 where the front wheel goes."""
    spec = read_spec(SPECS / "car.toml")
    steady = steady_motion(setting_of(spec))
    turn = dict(zip(steady.names, steady.rho, strict=True))
    front = np.sqrt(15.0**2 - 1.0)
    assert abs(turn["delta"] - np.arcsin(2.6 / front)) < 1e-9
    assert abs(turn["thetadot"] - 5.0 * np.cos(turn["delta"]) / 0.3) < 1e-8 and steady.decay() > 0


def test_the_loop_of_an_own_output_is_what_its_gains_say():
    """At rest, with the exact model: kp 9, kd 6 give -3 four times;
    an output moving where gravity matters is refused."""
    spec = read_spec(SPECS / "geared_arm.toml")
    still = replace(spec, reference=Reference(position=spec.reference.position))
    steady = steady_motion(setting_of(still))
    assert np.abs(np.poly(steady.closed()) - np.poly([-3.0] * 4)).max() < 1e-6
    with pytest.raises(BadInput, match="no steady motion"):
        steady_motion(setting_of(spec))


def test_the_platform_follows_its_arm_where_both_can_move():
    """det Phi of the end point in the plane and on the platform:
    the arm's own Jacobian times how far ahead of the axle it is."""
    law = law_of(find_robot("mobile_manipulator"), "end_point")
    function = law.function({"Phi": law.linearization.Phi})
    p = {parameter.name: parameter.default for parameter in law.parameters}
    for state in states("mobile_manipulator"):
        q_1, q_2 = state.q[5:]
        Phi = function(
            list(p.values()), [], [k.default for k in law.gains], [*state.q, *state.nu], np.zeros(12)
        ).full()
        ahead = p["d"] + p["a"] + p["l_1"] * np.cos(q_1) + p["l_2"] * np.cos(q_1 + q_2)
        wheels = p["r"] ** 2 / (2 * p["b"])
        assert abs(abs(np.linalg.det(Phi)) - abs(p["l_1"] * p["l_2"] * np.sin(q_2) * ahead * wheels)) < 1e-13


@pytest.mark.parametrize("name", NAMES)
def test_analyse_answers_as_json(name, capsys):
    assert (
        main(
            [
                "analyse",
                name,
                "--json",
                *([] if name in ("geared_arm", "ball_plate") else ["--output", OWN[name]]),
            ]
        )
        == 0
    )
    answer = json.loads(capsys.readouterr().out)
    assert tuple(answer["growth"]) == GROWTH[name] and answer["outputs"]


OWN = {**dict.fromkeys(VEHICLES, "type_i"), "mobile_manipulator": "end_point", "mecanum": "pose"}


# -- one robot that this method cannot have ------------------------------------------------------------------

BALANCER = '''
"""Two wheels and an inverted pendulum on their axle: three freedoms, two motors."""
from casadi import cos, sin
from noslip.model import Mechanism


def balancer():
    robot = Mechanism("balancer")
    x, y, phi, tilt = (robot.coordinate(n, u) for n, u in (("x", "m"), ("y", "m"), ("phi", "rad"),
        ("tilt", "rad")))
    right, left = robot.coordinate("right", "rad"), robot.coordinate("left", "rad")
    m, l, b, r = (robot.parameter(n, v, u) for n, v, u in (("m", 5, "kg"), ("l", 0.3, "m"), ("b", 0.2,
        "m"), ("r", 0.1, "m")))
    forward = cos(phi) * robot.rate(x) + sin(phi) * robot.rate(y)
    along = forward + l * cos(tilt) * robot.rate(tilt)
    up, turning = -l * sin(tilt) * robot.rate(tilt), robot.rate(phi)
    robot.kinetic_energy(m * (along**2 + up**2 + (l * sin(tilt) * turning) ** 2) / 2 + 0.01 * turning**2)
    robot.potential_energy(m * 9.81 * l * cos(tilt))
    robot.rolls("no side slip", cos(phi) * robot.rate(y) - sin(phi) * robot.rate(x))
    for name, wheel, side in (("right rolls", right, 1), ("left rolls", left, -1)):
        robot.rolls(name, r * robot.rate(wheel) - forward - side * b * turning)
        robot.input(f"tau_{name[:-6]}", "N m", on=robot.rate(wheel) - robot.rate(tilt))
    robot.moves_in_plane(x, y, phi)
    return robot
'''


@pytest.mark.nightly
def test_an_underactuated_robot_is_refused_with_what_would_help(tmp_path, bad_input, capsys):
    file = tmp_path / "balancer.py"
    file.write_text(BALANCER)
    for command in (
        ["generate", f"{file}:balancer", "-o", str(tmp_path / "c")],
        ["check", "--robot", f"{file}:balancer"],
    ):
        line = bad_input(command)
        assert (
            "2 inputs" in line
            and "n - m = 3" in line
            and "underactuated" in line
            and "input or " in line.lower()
        )
    assert main(["analyse", f"{file}:balancer", "--json"]) == 0  # its constraints can be told all the same
    answer = json.loads(capsys.readouterr().out)
    assert answer["growth"] == [3, 4, 5] and not answer["outputs"] and "underactuated" in answer["no_outputs"]


def test_a_ball_on_one_plate_that_moves_has_too_few_inputs():
    """Why the shipped one is between two plates: 4 velocities, 2 forces."""
    robot = Mechanism("tray")
    coordinates = [robot.coordinate(name, "m") for name in ("x", "y", "x_p", "y_p")]
    turning = [robot.coordinate(name, "rad") for name in ("a", "b")]
    rates = [robot.rate(c) for c in (*coordinates, *turning)]
    robot.kinetic_energy(sum(rate**2 for rate in rates) / 2)
    robot.rolls("x", rates[0] - rates[2] - 0.05 * rates[4])
    robot.rolls("y", rates[1] - rates[3] - 0.05 * rates[5])
    robot.input("f_x", "N", on=rates[2])
    robot.input("f_y", "N", on=rates[3])
    with pytest.raises(ModelError, match="2 inputs for n - m = 4"):
        reduce(robot)


# -- outputs of a robot's own --------------------------------------------------------------------------------


def cart(**more) -> Mechanism:
    robot = ROBOTS["knife_edge"]()
    for name, (rows, parameters) in more.items():
        robot.output(name, "a test", rows(robot), parameters)
    return robot


@pytest.mark.nightly
def test_rates_in_an_output_become_quasi_velocities():
    """The speed along x and the yaw rate by rates of coordinates: relative degree 1,
    and h = (v cos(phi), omega)."""
    robot = cart(
        way=(
            lambda r: [
                ("v_x", "m/s", r.rate(r["x"]), "speed"),
                ("omega", "rad/s", r.rate(r["phi"]), "yaw rate"),
            ],
            (),
        )
    )
    law = law_of(robot, "way")
    assert law.linearization.relative_degree == (1, 1)
    x, y, phi, v, omega = (q.symbol for q in law.state)
    assert canonical(law.linearization.h - ca.vertcat(v * cos(phi), omega)).is_zero()
    assert find_laws(system_of(robot))[-1] == "way" and find_laws(system_of(robot))[0] == "type_i"


def test_an_output_brings_its_own_parameters():
    """A point ahead by a parameter of the output is Type I again."""
    L = config("L", 0.4, "m", "distance ahead")
    rows = [
        lambda r: ("x_a", "m", r["x"] + L.symbol * cos(r["phi"]), "x ahead"),
        lambda r: ("y_a", "m", r["y"] + L.symbol * sin(r["phi"]), "y ahead"),
    ]
    robot = cart(point=(lambda r: [row(r) for row in rows], [L]))
    own, type_i = law_of(robot, "point"), law_of(robot, "type_i")
    assert [c.name for c in own.config] == ["L"] and own.config[0].default == 0.4
    groups = [*(ca.vertcat(*[q.symbol for q in group]) for group in (own.parameters, own.config, own.state))]
    arguments = np.random.default_rng(3).uniform(0.3, 1.3, sum(g.numel() for g in groups))
    Phi = [
        ca.Function(
            "Phi",
            [ca.vertcat(law.system.mechanism.p, law.config[0].symbol, own.system.mechanism.q, own.system.nu)],
            [law.linearization.Phi],
        )
        for law in (own, type_i)
    ]
    assert close(Phi[0](arguments).full(), Phi[1](arguments).full(), 1e-15)


PLACES = ("x_l", "m"), ("y_l", "m")
REFUSED = {
    "twice": (lambda r: r.output("ball", "", []), "'ball' is used twice"),
    "a type": (lambda r: r.output("type_v", "", []), "has a meaning already"),
    "taken in C": (lambda r: r.output("params", "", []), "has a meaning already"),
    "no name in C": (lambda r: r.output("end point", "", []), "cannot be used in C"),
    "no row": (lambda r: r.output("tip", "", [("x_b", "m")]), "row 1 must be"),
    "no scalar": (lambda r: r.output("tip", "", [("x_b", "m", r.q)]), "must be a scalar"),
    "no expression": (
        lambda r: r.output("tip", "", [("x_b", "m", "x")]),
        "'tip', x_b is not an expression: 'x'",
    ),
    "no parameter": (lambda r: r.output("tip", "", [("x_b", "m", r["x"])], [1.0]), "config"),
    "unknown name": (lambda r: r["z"], "no coordinate or parameter 'z'"),
}


@pytest.mark.parametrize("why", REFUSED)
def test_a_wrong_output_is_refused_where_it_is_written(why):
    make, message = REFUSED[why]
    with pytest.raises(ModelError, match=message):
        make(ROBOTS["ball_plate"]())


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (lambda r: [("x_b", "m", r["x"])], "1 output"),
        (lambda r: [("x_b", "m", r["x"]), ("y_b", "m", ca.SX.sym("stranger"))], "stranger"),
        (
            lambda r: [("x_b", "m", r["x"]), ("x_c", "m", 2 * r["x"])],
            "no output depends on the input along yaw_rate",
        ),
    ],
)
def test_outputs_that_cannot_be_controlled_are_refused_with_the_reason(rows, message):
    robot = cart(own=(rows, ()))
    with pytest.raises(ModelError, match=message):
        law_of(robot, "own")
    assert "own" not in find_laws(system_of(robot))


def test_every_command_knows_an_output_by_its_name(tmp_path, bad_input, capsys):
    assert main(["analyse", "geared_arm", "--output", "tip", "--json"]) == 0
    assert list(json.loads(capsys.readouterr().out)["outputs"]) == ["tip"]
    assert "did you mean 'tip'" in bad_input(["analyse", "geared_arm", "--output", "tib"])
    assert "--spec" in bad_input(["outer-loop", "geared_arm", "--output", "tip"])
    case = {
        "params": {},
        "output": {"type": "tip"},
        "q": [0.3, 0.5, 15, 25],
        "nu": [0.1, 0.2],
        "gains": {"kp": 1, "kd": 2},
    }
    case["params"] = {p.name: p.default for p in find_robot("geared_arm").parameters}
    case["reference"] = {"y": [0.5, 0.1], "yd": [0, 0], "ydd": [0, 0]}
    file, out = tmp_path / "cases.json", tmp_path / "out.json"
    file.write_text(json.dumps({"robot": "geared_arm", "cases": [case]}))
    assert main(["evaluate", str(file), "--backend", "casadi", "-o", str(out)]) == 0
    h = json.loads(out.read_text())["cases"][0]["h"]
    assert close(h, [0.5 * np.cos(0.3) + 0.4 * np.cos(0.8), 0.5 * np.sin(0.3) + 0.4 * np.sin(0.8)], 1e-15)
    spec = tmp_path / "spec.toml"
    for change, message in (
        ('type = "tipp"', "type: unknown output 'tipp'; did you mean 'tip'?"),
        ('type = "tip"\nL = 0.3', "is not one of I, II, III, IV, which have these"),
        ('type = "tip"\nparameters = { a = 1 }', "unknown name 'a'"),
        ('type = "I"\nparameters = { a = 1 }', "requires an output of the robot's own"),
    ):
        start = (
            "[initial]\nq = [-0.9, 1.4, -45, 70]\n[reference]\nposition = [0.6, "
            "0.1]\n[simulation]\nduration = 1"
        )
        spec.write_text(f'robot = "geared_arm"\n[output]\n{change}\n{start}\nbackend = "casadi"')
        assert message in bad_input(["simulate", str(spec), "-o", str(tmp_path / "run.csv")])
    spec.write_text(
        spec.read_text()
        .replace("q = [-0.9, 1.4, -45, 70]", "point = [0, 0]")
        .replace('"I"', '"tip"')
        .replace("a = 1", "")
    )
    assert "give q and nu" in bad_input(["simulate", str(spec), "-o", str(tmp_path / "run.csv")])


@pytest.mark.parametrize("name", NAMES)
def test_the_shipped_run_of_each_robot_comes_to_what_is_wanted(name):
    """specs/robots with CasADi: of what was off at most, 3 % are left,
    20 % where the controller believes in another plant."""
    spec = read_spec(SPECS / f"{name}.toml")
    run = simulate(
        replace(spec, simulation=replace(spec.simulation, tolerance=1e-6, output_step=0.5)), "casadi"
    )
    off = np.abs(run.error)
    assert run.stopped is None and run.t[-1] == spec.simulation.duration
    assert np.all(off[-1] < (0.2 if spec.plant else 0.03) * np.maximum(off.max(axis=0), 1e-9))


# -- sines of sums -------------------------------------------------------------------------------------------


def test_sums_of_angles_are_simplified_exactly():
    a, b, c = (ca.SX.sym(name) for name in "abc")
    assert canonical(sin(a + b) - sin(a) * cos(b) - cos(a) * sin(b)).is_zero()
    assert canonical(cos(2 * a) - 1 + 2 * sin(a) ** 2).is_zero()
    tangent = canonical(
        (sin(a + b) * cos(a) - cos(a + b) * sin(a)) / (cos(a + b) * cos(a) + sin(a + b) * sin(a))
    )
    assert str(tangent) == str(canonical(sin(b) / cos(b)))
    assert str(canonical(cos(a + b - c))) == str(cos(a + b - c))  # nothing is gained by the long form
    assert by_addition_theorems(sin(a * b) + cos(a)) is None


def test_addition_theorems_keep_the_value():
    a, b, c = symbols = [ca.SX.sym(name) for name in "abc"]
    entries = [
        sin(a - 2 * b),
        cos(-(a + b) + c),
        ca.tan(a + b),
        sin(cos(a + b) + c) * cos(a - c) ** 2,
        cos(a + (b - a)),
    ]
    for entry in entries:
        expanded = by_addition_theorems(entry)
        both = ca.Function(
            "both", [ca.vertcat(*symbols)], [entry, entry if expanded is None else expanded, canonical(entry)]
        )
        for point in np.random.default_rng(5).uniform(-3, 3, (20, 3)):
            values = [float(value) for value in both(point)]
            assert abs(values[0] - values[1]) < 1e-12 * max(1.0, abs(values[0]))
            assert abs(values[0] - values[2]) < 1e-12 * max(1.0, abs(values[0]))
