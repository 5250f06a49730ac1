"""Constraints that move, A qdot = b: the ball on a turntable against closed forms, a vehicle on a belt,
what is refused."""

import dataclasses
import re

import casadi as ca
import numpy as np
import pytest
from casadi import cos, sin
from noslip.analysis.identification.geometry import _Geometry
from noslip.cli.main import main
from noslip.codegen.ekf.filter import why_no_filter
from noslip.model import Mechanism, ModelError, reduce
from noslip.model.robots.labmate import labmate
from noslip.model.robots.turntable_ball import turntable_ball
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot, law_of
from noslip.simulation.closed_loop import simulate, summary
from noslip.simulation.controllers.balance.steady import analyse_at_rest
from noslip.simulation.plant import Plant
from noslip.simulation.specification.spec import spec_of
from noslip.simulation.specification.vary import read_varied
from noslip.simulation.sweeping.batch import Batch
from noslip.simulation.sweeping.simulated import Simulated
from scipy.integrate import solve_ivp

BALL = """
robot = "turntable_ball"
output = { type = "ball" }
reference = { position = [0.3, 0.1, 0.0], velocity = [-0.05, 0.1, 0.0] }
initial = { q = [0.4, 0.0, 0.0, 0.0, 0.0], nu = [0.1, -0.2, 1.5] }
simulation = { duration = 4.0, output_step = 0.5 }
"""


def plant_of(robot: Mechanism, **values: float) -> Plant:
    return Plant(reduce(robot), robot.parameter_values(values))


@pytest.mark.parametrize(("shape", "ratio"), [(2 / 5, 7 / 2), (2 / 3, 5 / 2)], ids=["solid", "hollow"])
def test_a_free_ball_goes_round_a_circle_in_a_multiple_of_the_turntables_period(shape, ratio):
    """x'' = -Omega y' / ratio and y'' = Omega x' / ratio: a circle; its period over that of the turntable is
    ratio = 1 + 1/shape, with the inertia shape m R^2.
    """
    Omega, m, R = 2.0, 0.2, 0.03
    plant = plant_of(turntable_ball(), Omega=Omega, m=m, R=R, I=shape * m * R**2)
    x = start = np.array([0.4, 0.1, 0.3, -0.2, 0.1, 0.1, -0.2, 1.5])
    turning, steps = Omega / ratio, 200
    velocity, place = complex(*start[5:7]), complex(*start[:2])
    centre = place - velocity / (1j * turning)
    for k in range(1, steps + 1):
        x, error = plant.step(x, np.zeros(3), 2 * np.pi / turning / steps, 1e-11)
        assert error <= 1
        expected = centre + (place - centre) * np.exp(2j * np.pi * k / steps)
        assert abs(complex(*x[:2]) - expected) < 1e-8
    np.testing.assert_allclose(x[[0, 1, 5, 6, 7]], start[[0, 1, 5, 6, 7]], rtol=0, atol=1e-8)


def test_equations_are_newtons_and_eulers():
    """m v' = F + f and I w' = r x f + torque for the force f at the contact r = (0, 0, -R),
    v + w x r = Omega z x place."""
    random, plant = np.random.default_rng(7), plant_of(turntable_ball())
    m, R, I, Omega = plant.parameters  # noqa: E741
    for _ in range(50):
        x, tau = random.uniform(-2, 2, 8), random.uniform(-2, 2, 3)
        # Unknown: v' (2), w' (3), f (2).
        A, right = np.zeros((7, 7)), np.zeros(7)
        A[[0, 1], [0, 1]], A[0, 5], A[1, 6], right[:2] = m, -1, -1, tau[:2]
        A[[2, 3, 4], [2, 3, 4]] = I
        A[2, 6], A[3, 5], right[4] = -R, R, tau[2]  # r x f = (R f_y, -R f_x, 0)
        A[5, [0, 3]], right[5] = [1, -R], -Omega * x[6]
        A[6, [1, 2]], right[6] = [1, R], Omega * x[5]
        expected = np.linalg.solve(A, right)
        rate = plant.rate(x, tau)
        np.testing.assert_allclose(rate[5:], expected[[0, 1, 4]], rtol=0, atol=1e-10)
        np.testing.assert_allclose(
            rate[2:5], [(Omega * x[0] - x[6]) / R, (x[5] + Omega * x[1]) / R, x[7]], rtol=0, atol=1e-10
        )
        np.testing.assert_allclose(-plant.constraint_forces(x, tau)[0], expected[5:], rtol=0, atol=1e-10)
        assert np.abs(plant.slip(x)).max() < 1e-13


def test_the_energy_is_the_work_of_inputs_and_of_the_drive():
    plant, tau = plant_of(turntable_ball()), np.array([0.02, -0.01, 0.001])

    def rate(t: float, state: np.ndarray) -> np.ndarray:
        return np.append(plant.rate(state[:-1], tau), plant.power(state[:-1], tau)[0])

    start = np.array([0.4, 0.1, 0.0, 0.0, 0.0, 0.1, -0.2, 1.5, 0.0])
    end = solve_ivp(rate, (0, 5), start, "DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
    gained = plant.energy(end[:-1])[0] - plant.energy(start[:-1])[0]
    assert gained == pytest.approx(end[-1], abs=1e-9)
    by_inputs = tau @ np.array([0.1, -0.2, 1.5])  # the inputs act on the quasi-velocities
    assert abs(plant.power(start[:-1], tau)[0] - by_inputs) > 1e-3, "the drive works too"


@pytest.mark.parametrize("backend", ["c", "casadi"])
def test_the_ball_follows_a_reference_on_the_turntable(backend):
    """Double poles as the gains say: e'' + 2.5 e' + e = 0 for the position, e' + 2 e = 0 for the spin."""
    spec = spec_of(BALL, "")
    run = simulate(
        dataclasses.replace(spec, simulation=dataclasses.replace(spec.simulation, backend=backend))
    )
    assert run.stopped is None
    t = run.t
    for k, (error, rate) in enumerate([(-0.1, -0.05 - 0.1), (0.1, 0.1 + 0.2)]):
        slow, fast = -0.5, -2.0
        a = (rate - fast * error) / (slow - fast)
        np.testing.assert_allclose(
            run.y_d[:, k] - run.y[:, k], a * np.exp(slow * t) + (error - a) * np.exp(fast * t), atol=1e-8
        )
    np.testing.assert_allclose(run.y[:, 2], 1.5 * np.exp(-2 * t), atol=1e-8)
    assert np.abs(run.plant.slip(run.x)).max() < 1e-12


def test_the_c_is_the_model(tmp_path, capsys):
    assert (
        main(["generate", "turntable_ball", "--output", "ball", "--output", "dynamics", "-o", str(tmp_path)])
        == 0
    )
    assert main(["check", "--robot", "turntable_ball", "--output", "ball", "--states", "200"]) == 0
    assert "ball" in capsys.readouterr().out


def belt(speed_symbol: bool = True) -> Mechanism:
    """A unicycle on a belt that runs along x."""
    robot = Mechanism("belted", "a cart on a belt")
    x, y, heading = robot.coordinate("x", "m"), robot.coordinate("y", "m"), robot.coordinate("heading", "rad")
    m, I = robot.parameter("m", 12.0, "kg"), robot.parameter("I", 0.8, "kg m^2")  # noqa: E741
    belt_speed = robot.parameter("belt_speed", 0.4, "m/s", sign="any")
    v_x, v_y, turning = robot.rate(x), robot.rate(y), robot.rate(heading)
    robot.kinetic_energy(m * (v_x**2 + v_y**2) / 2 + I * turning**2 / 2)
    robot.rolls("no side slip", cos(heading) * v_y - sin(heading) * v_x, surface=-sin(heading) * belt_speed)
    forward = cos(heading) * v_x + sin(heading) * v_y
    robot.input("push", "N", on=forward)
    robot.input("turn", "N m", on=turning)
    robot.quasi_velocity("v", "m/s", forward)
    robot.quasi_velocity("omega", "rad/s", turning)
    robot.moves_in_plane(x, y, heading)
    return robot


def test_a_vehicle_on_a_belt_tracks_a_line_that_stands_still():
    """Type I, P_l ahead of the axle: with belt and vehicle at opposite speeds P_l stays where it is."""
    robot = belt()
    law = law_of(reduce(robot), "type_i")
    x = np.array([0.0, 0.0, 0.0, -0.4 + 0.4, 0.0])
    linear = law.linearization
    values = ca.Function(
        "f",
        [ca.vertcat(robot.q, law.system.nu), robot.p, ca.vertcat(*[c.symbol for c in law.config])],
        [linear.rate],
    )(x, robot.parameter_values({}), [0.5])
    np.testing.assert_allclose(values.full().ravel(), [0.0, 0.0], atol=1e-14)
    moving = np.array([0.1, -0.2, 0.7, 0.3, 0.5])
    side = -np.sin(0.7) * 0.4
    qdot = ca.Function("q", [ca.vertcat(robot.q, law.system.nu), robot.p], [law.system.qdot])(
        moving, robot.parameter_values({})
    )
    expected = [0.3 * np.cos(0.7) - side * np.sin(0.7), 0.3 * np.sin(0.7) + side * np.cos(0.7), 0.5]
    np.testing.assert_allclose(qdot.full().ravel(), expected, atol=1e-14)


def test_what_cannot_be_judged_is_refused(tmp_path, bad_input):
    assert "the robot with the surface at rest" in bad_input(["analyse", "turntable_ball"])
    engine = ["--engine", "mujoco", "--set", "simulation.period=0.01", "-o", str(tmp_path / "run.csv")]
    assert "turntable_ball: its ground moves" in bad_input(["simulate", "turntable_ball", *engine])
    robot = belt()
    robot.body("load", 1.0, 1.0, robot.rate(robot["x"]), robot.rate(robot["y"]), robot.rate(robot["heading"]))
    with pytest.raises(ModelError, match="body.* does not go with a moving surface"):
        reduce(robot)
    with pytest.raises(ModelError, match="ground_moves: unknown name 'z'; known are x, y, heading"):
        belt().ground_moves(z=1.0)


def test_the_ground_moves_what_is_added_before_and_after():
    """The same robot, whatever the order; a coordinate that is given or moved already is refused,
    before and after."""
    found = []
    for late in (False, True):
        robot = Mechanism("cart", "on a belt")
        x, y, heading = (
            robot.coordinate("x", "m"),
            robot.coordinate("y", "m"),
            robot.coordinate("heading", "rad"),
        )
        speed = robot.given("speed", "m/s")
        if late:
            robot.ground_moves(x=speed, heading=0.3)
        robot.rolls("no side slip", cos(heading) * robot.rate(y) - sin(heading) * robot.rate(x))
        if not late:
            robot.ground_moves(x=speed, heading=0.3)
        at = ca.Function("b", [robot.q], [robot.surface_velocity])
        found.append(at([0.1, 0.2, 0.7, 0.4, 0.05]).full().ravel())
        for name, says in (
            ("speed", "speed is given"),
            ("speed_rate", "speed_rate is given"),
            ("x", "x is moved already"),
        ):
            with pytest.raises(ModelError, match=f"ground_moves: {says}"):
                robot.ground_moves(**{name: 0.1})
    for b in found:  # of the speed, of its rate, of the wheel
        np.testing.assert_allclose(np.sort(b), np.sort([0.05, 0.0, -np.sin(0.7) * 0.4]), rtol=0, atol=1e-15)
    robot = labmate()
    robot.time()
    with pytest.raises(ModelError, match="t is given; the ground cannot move it"):
        robot.ground_moves(x_c=0.2, t=2.0)


@pytest.mark.nightly
def test_what_takes_the_motion_from_the_wheels_says_that_the_ground_moves(tmp_path, bad_input):
    """The filter, the follower, dead reckoning, a damped law, calibration;
    what is written by default is without the filter."""
    file = tmp_path / "conveyor.py"
    file.write_text(CONVEYOR)
    robot, reason = (
        f"{file}:conveyor",
        "its ground moves: the velocities of its wheels do not say how it moves",
    )
    for output in ("ekf", "follower", "type_iv_line_damped"):
        assert reason in bad_input(["generate", robot, "--output", output, "-o", str(tmp_path / "c")])
    sensors = "sensors = {{ pose = 'reckoned' }}\n"
    spec = ALONG.replace("output_step = 0.5", "output_step = 0.5, period = 0.01") + sensors
    with pytest.raises(BadInput, match=reason):
        simulate(spec_of(spec.format(file=file, backend="casadi"), ""))
    system = reduce(find_robot(robot))
    with pytest.raises(BadInput, match=reason):
        _Geometry.of(system, ["theta_r", "theta_l"])
    assert reason in why_no_filter(system) and not why_no_filter(reduce(labmate()))
    with pytest.raises(ModelError, match=reason):
        analyse_at_rest(find_robot(robot))
    clock = labmate()
    clock.time()
    assert "t changes with time" in why_no_filter(reduce(clock))
    robot = belt()
    with pytest.raises(ModelError, match="surface"):
        robot.rolls("a rate", robot.rate(robot["x"]), surface=robot.rate(robot["y"]))


# -- what moves as a known function of time ------------------------------------------------------------------


def plate(t):
    """How a plate moves: its displacement, velocity and acceleration along x and y."""
    place = ca.vertcat(0.3 * sin(1.7 * t), 0.2 * t**2 - 0.05 * t**3)
    rate = ca.jacobian(place, t)
    return place, rate, ca.jacobian(rate, t)


def on_plate() -> Mechanism:
    """The LABMATE, in the world, on a plate that moves as `plate`."""
    robot = labmate()
    _, (v_x, v_y), _ = (ca.vertsplit(part) for part in plate(robot.time()))
    robot.ground_moves(x_c=v_x, y_c=v_y)
    return robot


def beside_plate() -> Mechanism:
    """The same in axes that move with the plate: ordinary constraints,
    and the force -mass times acceleration."""
    robot = labmate()
    _, _, (a_x, a_y) = (ca.vertsplit(part) for part in plate(robot.time()))
    x, y, phi, d = (robot[name] for name in ("x_c", "y_c", "phi", "d"))
    for mass, point in ((robot["m_c"], (x, y)), (2 * robot["m_w"], (x - d * cos(phi), y - d * sin(phi)))):
        for place, a in zip(point, (a_x, a_y), strict=True):
            robot.force(-mass * a, on=robot.rate(place))
    return robot


def driven(robot: Mechanism, start: np.ndarray, duration: float) -> tuple[Plant, np.ndarray]:
    """The plant and its states with torques that change; the last column is the work done on it."""
    plant = plant_of(robot)

    def rate(t: float, state: np.ndarray) -> np.ndarray:
        tau = np.array([2.0 * np.sin(t), 1.0])
        return np.append(plant.rate(state[:-1], tau), plant.power(state[:-1], tau)[0])

    instants = np.linspace(0, duration, 11)
    run = solve_ivp(rate, (0, duration), np.append(start, 0.0), "DOP853", instants, rtol=1e-11, atol=1e-12)
    return plant, run.y.T


def test_a_vehicle_on_a_plate_that_accelerates_moves_as_in_axes_of_the_plate():
    """Change of frame: the place in the world is that on the plate and the plate's;
    energy is the work of motors and drive."""
    start = np.array([0.1, -0.2, 0.4, 0.0, 0.0, 0.0, 1.0, 2.0])  # on the plate at t = 0; wheel rates
    t = ca.SX.sym("t")
    displaced = ca.Function("displaced", [t], [plate(t)[0]])
    world, in_world = driven(on_plate(), start, 3.0)
    _, on_it = driven(beside_plate(), start, 3.0)
    moved = np.array([displaced(each).full().ravel() for each in in_world[:, 5]])
    assert np.ptp(moved, axis=0).min() > 0.2
    np.testing.assert_allclose(in_world[:, :2], on_it[:, :2] + moved, rtol=0, atol=1e-9)
    np.testing.assert_allclose(in_world[:, 2:8], on_it[:, 2:8], rtol=0, atol=1e-8)
    energy = world.energy(in_world[:, :-1])
    np.testing.assert_allclose(energy - energy[0], in_world[:, -1], rtol=0, atol=1e-8)
    assert np.abs(world.slip(in_world[:, :-1])).max() < 1e-12
    by_motors = world.power(in_world[:1, :-1], np.array([[0.0, 1.0]]))[0] - 1.0 * 2.0
    assert abs(by_motors) > 1e-2, "the drive of the plate works too"


def test_a_cylinder_on_a_plate_that_accelerates():
    """A third of the plate's acceleration if it is solid: a I / (I + m R^2);
    the drive pushes with m times that."""
    robot = Mechanism("cylinder", "on a plate")
    x, theta = robot.coordinate("x", "m"), robot.coordinate("theta", "rad")
    m, R, I = (  # noqa: E741
        robot.parameter("m", 2.0, "kg"),
        robot.parameter("R", 0.1, "m"),
        robot.parameter("I", 0.01, "kg m^2"),
    )
    robot.kinetic_energy(m * robot.rate(x) ** 2 / 2 + I * robot.rate(theta) ** 2 / 2)
    robot.rolls("rim", robot.rate(x) - R * robot.rate(theta))
    robot.ground_moves(x=robot.given("speed", "m/s"))
    robot.input("push", "N", on=robot.rate(x))
    robot.quasi_velocity("v", "m/s", robot.rate(x))
    # At the plate's speed, which grows at 1.2 m/s^2
    plant, state = plant_of(robot), np.array([0.0, 0.3, 0.5, 1.2, 0.5])
    np.testing.assert_allclose(
        plant.rate(state, np.zeros(1)), [0.5, 0.0, 1.2, 0.0, 1.2 / 3], rtol=0, atol=1e-13
    )
    assert plant.power(state, np.zeros(1))[0] == pytest.approx(2.0 * 0.4 * 0.5, abs=1e-12)
    after = plant.step(state, np.zeros(1), 2.0, 1e-10)[0]
    np.testing.assert_allclose(
        after, [0.5 * 2 + 0.2 * 4, 0.3 - 8.0 * 2, 2.9, 1.2, 0.5 + 0.8], rtol=0, atol=1e-9
    )


def test_a_ball_on_a_turntable_whose_speed_varies():
    """z' - 2/7 i Omega(t) z is constant for a solid ball; where it is zero,
    z = z_0 exp(2/7 i theta) with Omega = theta'."""
    robot = Mechanism("ball", "on a turntable")
    x, y = robot.coordinate("x", "m"), robot.coordinate("y", "m")
    turns = [robot.coordinate(f"turn_{axis}", "rad") for axis in "xyz"]
    v_x, v_y, *w = (robot.rate(each) for each in (x, y, *turns))
    m, R = 0.2, 0.03
    robot.kinetic_energy(m * (v_x**2 + v_y**2) / 2 + 0.4 * m * R**2 * sum(each**2 for each in w) / 2)
    robot.rolls("along x", v_x - R * w[1])
    robot.rolls("along y", v_y + R * w[0])
    t = robot.time()
    Omega = 1.0 + 0.8 * sin(3.0 * t)
    robot.ground_moves(x=-Omega * y, y=Omega * x, turn_z=Omega)
    for name, on in (("f_x", v_x), ("f_y", v_y), ("torque", w[2])):
        robot.input(name, "N", on=on)
        robot.quasi_velocity(f"v_{name}", "m/s", on)
    plant, place = plant_of(robot), 0.4 + 0.1j
    velocity = 2j / 7 * place
    state = np.array([0.4, 0.1, 0.0, 0.0, 0.0, 0.0, velocity.real, velocity.imag, 0.5])
    for k in range(1, 101):
        state, _ = plant.step(state, np.zeros(3), 0.05, 1e-12)
        turned = 0.05 * k + 0.8 / 3 * (1 - np.cos(0.15 * k))
        assert abs(complex(*state[:2]) - place * np.exp(2j / 7 * turned)) < 1e-9


CONVEYOR = """
from noslip.model.robots.labmate import labmate


def conveyor():
    robot = labmate()
    robot.ground_moves(x_c=robot.given("belt", "m/s", "speed of the conveyor along x"))
    return robot
"""
ALONG = """
robot = "{file}:conveyor"
output = {{ type = "IV", L = 0.5, path = {{ kind = "line", A = 0.0, B = 1.0, C = 0.0 }} }}
gains = {{ kp = 1.0, kd = 2.5, kv = 2.0 }}
reference = {{ speed = 0.8 }}
initial = {{ q = [0.0, 0.6, 1.2, 0.0, 0.0, 0.3, 0.2], nu = [2.0, 2.0] }}
simulation = {{ duration = 5.0, output_step = 0.5, backend = "{backend}" }}
"""


@pytest.mark.parametrize("backend", ["c", pytest.param("casadi", marks=pytest.mark.nightly)])
def test_the_labmate_on_a_conveyor_that_gains_speed_follows_a_line(backend, tmp_path):
    """Its law has the speed of the conveyor and its rate in the state, and compensates both: d'' + 2.5 d' +
    d = 0 in the world, speed' = -2 (speed - 0.8). The contacts are judged too.
    """
    file = tmp_path / "conveyor.py"
    file.write_text(CONVEYOR)
    run = simulate(spec_of(ALONG.format(file=file, backend=backend), ""))
    assert run.stopped is None
    t, (d, speed) = run.t, (run.y_d - run.y).T
    p = {q.name: q.default for q in labmate().parameters}
    forward, turning, phi, belt = 2.0 * p["r"], 0.0, 1.2, 0.3
    # Seen from the ground: the belt carries it along x; across its heading it moves as the belt does.
    along = forward + belt * np.cos(phi)
    rate = -(along * np.sin(phi) + -belt * np.sin(phi) * np.cos(phi) + 0.8 * turning * np.cos(phi))
    slow, fast = -0.5, -2.0
    a = (rate - fast * d[0]) / (slow - fast)
    np.testing.assert_allclose(d, a * np.exp(slow * t) + (d[0] - a) * np.exp(fast * t), rtol=0, atol=1e-8)
    np.testing.assert_allclose(speed, (0.8 - along) * np.exp(-2 * t), rtol=0, atol=1e-8)
    np.testing.assert_allclose(run.x[:, 5], 0.3 + 0.2 * t, rtol=0, atol=1e-10)
    assert np.abs(run.plant.slip(run.x)).max() < 1e-12


def test_the_c_of_a_law_takes_the_speed_of_the_ground_and_its_rate(tmp_path, capsys):
    file = tmp_path / "conveyor.py"
    file.write_text(CONVEYOR)
    robot = f"{file}:conveyor"
    assert (
        main(
            ["generate", robot, "--output", "type_iv_line", "--output", "dynamics", "-o", str(tmp_path / "c")]
        )
        == 0
    )
    header = next((tmp_path / "c").glob("*/labmate.h")).read_text()
    assert "double belt;" in header and "double belt_rate;" in header
    assert main(["check", "--robot", robot, "--output", "type_iv_line", "--states", "50"]) == 0


def test_a_surface_at_rest_changes_nothing():
    system = reduce(labmate())
    assert system.particular is None and not system.mechanism.carried and find_robot("turntable_ball").carried


@pytest.mark.parametrize("backend", ["c", pytest.param("casadi", marks=pytest.mark.nightly)])
def test_the_labmate_crosses_a_conveyor_whose_speed_swings(backend):
    """The shipped SPEC: d'' + 2.5 d' + d = 0 and speed' = -2 (speed - 1) in the world; the conveyor moves as
    [given] says, and what the robot gains is the work of its motors and of the conveyor's drive, which both
    count.
    """
    spec = read_varied(
        "examples/specs/moving/conveyor.toml", {"simulation.duration": 3.0, "simulation.backend": backend}
    )
    run = simulate(spec)
    t, (d, speed) = run.t, (run.y_d - run.y).T
    belt = 0.4 + 0.2 * np.sin(2 * np.pi * t / 5)
    np.testing.assert_allclose(run.q[:, 5], belt, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.q[:, 6], 0.08 * np.pi * np.cos(2 * np.pi * t / 5), rtol=0, atol=1e-9)
    np.testing.assert_allclose(speed, 0.5 * np.exp(-2 * t), rtol=0, atol=1e-8)
    # It heads along the line, and the conveyor carries it sideways towards it
    rate = -0.4 * np.sin(np.pi / 4)
    a = (rate + 2.0 * d[0]) / 1.5
    np.testing.assert_allclose(d, a * np.exp(-0.5 * t) + (d[0] - a) * np.exp(-2 * t), rtol=0, atol=1e-8)
    gained, inputs, ground = run.works
    np.testing.assert_allclose(gained, inputs + ground, rtol=0, atol=1e-5)
    assert min(np.ptp(inputs), np.ptp(ground)) > 1.0, "J, both work"
    assert "drive of the ground +3.318 J" in summary(run)


def test_a_known_function_in_loops_with_a_period_with_drives_and_in_sweeps(tmp_path):
    """The state follows it as well; works are stated where rows show all inputs;
    samples of a sweep are runs of `simulate`."""
    short = {
        "simulation.duration": 0.4,
        "simulation.output_step": 0.02,
        "simulation.period": 0.02,
        "given.belt": "0.1 + t**2/2",
    }
    drive = {"drive": {"kind": "velocity", "bandwidth": 5.0}}
    for more, balanced in ({}, True), (drive, False), ({"simulation.period": 0.01}, False):
        run = simulate(read_varied("examples/specs/moving/conveyor.toml", short | more))
        np.testing.assert_allclose(
            run.q[:, 5:7], np.column_stack([0.1 + run.t**2 / 2, run.t]), rtol=0, atol=1e-12
        )
        assert run.balanced == balanced == ("drive of the ground" in summary(run))
        if balanced:
            assert np.abs(run.works[0] - run.works[1] - run.works[2]).max() < 0.001, "J, of 6"
    spec = read_varied("examples/specs/moving/conveyor.toml", short)
    batch = Simulated(spec, band=0.1)
    (outcomes,) = batch.run(batch.table({"plant.m_c": np.array([33.0])}, 1))
    heavier = simulate(read_varied("examples/specs/moving/conveyor.toml", short | {"plant.m_c": 33.0}))
    found = dict(zip(batch.outcomes, outcomes, strict=True))
    assert found["final.speed"] == heavier.error[-1, 1] and found["end.belt"] == heavier.q[-1, 5]
    with pytest.raises(BadInput, match=r"\[given\] does not go with the C of a sweep"):
        Batch(spec, band=0.1)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"belt": "0.4 +"}, "is not an expression in t; use t"),
        ({"belt": "x + 1"}, "'x' is not understood; use t"),
        ({"belt": "__import__('os')"}, "is not understood"),
        ({"belt": "t**t"}, "is not understood"),
        ({"belt": "9**9**9**9"}, "is not understood"),
        ({"belt": "(" * 200 + "t" + ")" * 200 + "+t" * 60}, "nested more than 50 deep"),
        ({"belt": "t" * 2000}, "more than 1000 characters"),
        ({"belt": "sqrt(t)"}, "is not finite at t = 0 s"),
        ({"belt": "3 kg"}, "wrong dimension"),
        ({"belt": True}, "is not a number"),
        ({"bel": 0.1}, "unknown key 'bel'; did you mean 'belt'"),
        ({"belt_rate": 0.1}, "unknown key 'belt_rate'"),
    ],
)
def test_known_functions_that_are_refused(given, says):
    with pytest.raises(BadInput, match=re.escape(says)):
        simulate(read_varied("examples/specs/moving/conveyor.toml", {"given": given}))


def test_what_is_given_and_the_start_agree():
    with pytest.raises(BadInput, match="belt is 0.3, but 0.4 by"):
        simulate(
            read_varied(
                "examples/specs/moving/conveyor.toml", {"initial": {"q": [0.0, 0.6, 1.2, 0.0, 0.0, 0.3, 0.2]}}
            )
        )
    with pytest.raises(BadInput, match="labmate has nothing that is given"):
        simulate(read_varied("line", {"given": {"belt": 0.1}}))
