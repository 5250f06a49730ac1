"""A LABMATE whose coordinates are another point of the body than the vehicle's point: all that reckons does
what it does for the LABMATE, whose coordinates are the vehicle's point.

Both describe one robot, so that every number that does not name the coordinates is the same.
"""

import cmath
import json
from dataclasses import replace

import numpy as np
import pytest
from noslip.cli.main import main
from noslip.model.vehicle import point_on_body
from noslip.readers.robots import find_robot, system_of
from noslip.simulation.closed_loop import simulate
from noslip.simulation.firmware.run import runs_as_firmware
from noslip.simulation.specification.spec import read_spec
from noslip.simulation.sweeping.batch import Batch
from noslip.simulation.telemetry.vehicle import follower_in_c

ROBOT = '''
from casadi import cos, sin
from noslip import Mechanism


def twin() -> Mechanism:
    """(x, y) is on the axle, g to the right of its middle; the vehicle's point is d ahead of the axle."""
    robot = Mechanism("twin", "LABMATE, placed by a point of its axle")
    units = {"x": "m", "y": "m", "phi": "rad", "theta_r": "rad", "theta_l": "rad"}
    x, y, phi, *theta = (robot.coordinate(name, unit) for name, unit in units.items())
    sizes = {"b": 0.75, "d": 0.30, "r": 0.15, "m_c": 30.0, "m_w": 1.0, "I_c": 15.625, "I_w": 0.005,
        "I_m": 0.0025, "g": 0.2}
    b, d, r, m_c, m_w, I_c, I_w, I_m, g = (robot.parameter(name, value, "1") for name, value in sizes.items())
    turning = robot.rate(phi)
    forward = cos(phi) * robot.rate(x) + sin(phi) * robot.rate(y) - g * turning
    left = cos(phi) * robot.rate(y) - sin(phi) * robot.rate(x)
    robot.kinetic_energy(m_c * (forward**2 + (left + d * turning) ** 2) / 2 + I_c * turning**2 / 2)
    robot.rolls("axle", left)
    for side, angle, aside in zip(("right", "left"), theta, (-b, b)):
        speed, rate = forward - aside * turning, robot.rate(angle)
        robot.kinetic_energy(m_w * (speed**2 + left**2) / 2 + I_m * turning**2 / 2 + I_w * rate**2 / 2)
        robot.rolls(f"{side} wheel rolls", speed - r * rate)
        robot.contact(f"{side} wheel", (m_c + 2 * m_w) / 2, along=speed - r * rate, across=left, left=aside)
        robot.input(f"tau_{side[0]}", "N m", on=rate)
        robot.quasi_velocity(f"thetadot_{side[0]}", "rad/s", rate)
    robot.moves_in_plane(x + d * cos(phi) - g * sin(phi), y + d * sin(phi) + g * cos(phi), phi)
    return robot
'''
SPEC = """
robot = "{robot}"
gains = {{ kp = 1.0, kd = 2.5, kv = 2.0 }}
[output]
type = "IV"
L = 0.1
path = {path}
[reference]
speed = 1.0
[initial]
point = [0.2, 0.3]
heading = 0.1
speed = 0.5
[simulation]
duration = 3.0
period = 0.01
"""
LINE = '{ kind = "line", A = 0.0, B = 1.0, C = 0.0 }'
ROUTE = """{ kind = "composite", segments = [
    { kind = "line", from = [0.0, 0.0], to = [1.5, 0.0] }, { kind = "arc", radius = 2.0, angle = 1.5 } ] }"""
NOISE = '[sensors]\npose = "{pose}"\nnoise = {{ sd = 0.02 }}\ngyro = {{ noise = 0.001, bias = 0.001 }}\n'
# Not known to the controller; it moves the vehicle's point, not the twin's coordinates
OTHER_D = "[plant]\nd = 0.33\n"
CORRECTED = OTHER_D + NOISE.format(pose="reckoned") + '[correction]\nrate = 2.0\nmode = "bumpless"\n'
FILTERED = (
    OTHER_D
    + NOISE.format(pose="reckoned")
    + ("[estimator]\nnoise = 0.01\npose = { rate = 5.0, sd = 0.01, heading_sd = 0.01, delay = 0.05 }\n")
)
NOTICED = (
    OTHER_D
    + NOISE.format(pose="reckoned")
    + (
        '[contact]\nmu = 0.7\n[limits]\ntorque = 50.0\nmode = "grip"\nnotice_slip = { window = 0.2, least = '
        "0.1 }\n"
    )
)


@pytest.fixture(scope="module")
def twin(tmp_path_factory) -> str:
    file = tmp_path_factory.mktemp("twin") / "twin.py"
    file.write_text(ROBOT)
    return f"{file}:twin"


def both(twin: str, folder, extra: str = "", path: str = ROUTE):
    """The SPECs of the twin and of the LABMATE."""
    for robot, name in ((twin, "twin"), ("labmate", "labmate")):
        file = folder / f"{name}.toml"
        file.write_text(SPEC.format(robot=robot, path=path) + extra)
        yield read_spec(str(file))


def motion(run) -> np.ndarray:
    """Heading and angles, their rates, torques and outputs in each row."""
    return np.hstack([run.q[:, 2:], run.nu, run.tau, run.y, run.seen[:, 2:]])


def test_the_vehicles_point_is_found_on_its_body(twin):
    point = point_on_body(system_of(find_robot(twin)))
    assert point and point.pose == (0, 1, 2) and str(point.arm) == "[d, g]"
    for name in ("labmate", "turtlebot3_burger", "four_wheel", "slope_platform"):
        point = point_on_body(system_of(find_robot(name)))
        assert point and point.arm.is_zero(), name
    assert point_on_body(system_of(find_robot("car"))) is None  # its heading is a sum of two coordinates


@pytest.mark.parametrize("extra", [CORRECTED, FILTERED, NOTICED], ids=["corrected", "filtered", "noticed"])
def test_a_run_is_that_of_the_labmate(twin, tmp_path, extra):
    one, other = map(simulate, both(twin, tmp_path, extra))
    assert len(one.t) == len(other.t) == 301 and one.stopped is other.stopped is None
    np.testing.assert_allclose(motion(one), motion(other), rtol=0, atol=1e-8)
    assert np.abs(motion(other)).max() > 10  # the wheels turn


@pytest.mark.parametrize(
    "extra",
    [pytest.param(CORRECTED, id="corrected"), pytest.param(NOTICED, id="noticed", marks=pytest.mark.nightly)],
)
def test_a_sweep_is_that_of_the_labmate(twin, tmp_path, extra):
    outcomes = []
    for spec in both(twin, tmp_path, extra):
        batch = Batch(spec)
        table = np.tile([batch.nominal[name] for name in batch.inputs], (3, 1))
        table[:, batch.inputs.index("plant.d")] = 0.25, 0.3, 0.35
        of_both = [
            k
            for k, name in enumerate(batch.outcomes)
            if not name.startswith(("end.x", "end.y", "integration"))
        ]
        outcomes.append(batch.run(table)[:, of_both])
    np.testing.assert_allclose(*outcomes, rtol=0, atol=1e-7)
    assert not np.isclose(outcomes[0][0], outcomes[0][1], atol=1e-3).all()


@pytest.mark.nightly
def test_certificate_is_that_of_the_labmate(twin, tmp_path, capsys):
    found = []
    for spec in both(twin, tmp_path, path=LINE):
        name = "twin" if spec.robot == twin else "labmate"
        main(["analyse", spec.robot, "--start", str(tmp_path / f"{name}.toml"), "--json"])
        found.append(json.loads(capsys.readouterr().out))
    assert found[0]["verdict"] == found[1]["verdict"] == "safe"
    assert found[0]["margin"] == pytest.approx(found[1]["margin"], rel=1e-9)


@pytest.mark.parametrize("scalar", ["double", pytest.param("float", marks=pytest.mark.nightly)])
def test_a_follower_is_that_of_the_labmate(twin, scalar):
    """The same counts give the same torques, and its state has the coordinates at the pose that is
    reckoned."""
    suffix, runs = "" if scalar == "double" else "_f", []
    random = np.random.default_rng(1992)
    steps = np.cumsum(random.integers(0, 9, (300, 2)), axis=0)
    for robot in (twin, "labmate"):
        c = follower_in_c(robot, scalar)
        config, follower, command, counts = c.new("config"), c.new(""), c.reals(2), c.ffi.new("uint32_t[2]")
        arc = {"x": 1.5, "curvature": 0.5, "length": 3.0}
        segments = c.ffi.new(f"noslip_segment{suffix}[2]", [{"length": 1.5}, arc])
        config.period, config.counts_per_turn, config.counter_bits, config.fastest = (
            0.01,
            [4096, 4096],
            24,
            50.0,
        )
        config.segments, config.count, config.path.speed, config.path.L, config.astray = (
            segments,
            2,
            0.5,
            [0.1, 0.0],
            9.0,
        )
        config.gains, config.limits.limit = (
            {"kp_distance": 1.0, "kd_distance": 2.5, "kv_speed": 2.0},
            [1e3, 1e3],
        )
        config.start = {"x": 0.2, "y": 0.3, "heading": 0.1}
        assert c.call("init", follower, config) == 0
        rows = []
        for count in steps:
            counts[0], counts[1] = map(int, count)
            assert c.call("tick", follower, counts, 0, command) >= 0
            state, pose = follower.state, follower.odometry.pose
            rows.append([*command, pose.x, pose.y, pose.heading])
            if robot is twin:
                away, turned = complex(pose.x - state.x, pose.y - state.y), cmath.rect(1.0, pose.heading)
                assert away == pytest.approx((0.3 + 0.2j) * turned, abs=1e-6)
        runs.append(rows)
    np.testing.assert_allclose(*runs, rtol=0, atol=1e-9 if scalar == "double" else 1e-2)


def test_firmware_is_that_of_the_labmate(twin, tmp_path):
    """The place that its rows show as seen is that of the coordinates, near the true one;
    the arm is 0.36 m long."""
    counted = '[sensors]\npose = "reckoned"\ncounts = 8192\n[limits]\ntorque = 20.0\n'
    specs = [
        replace(spec, simulation=replace(spec.simulation, backend="cf"))
        for spec in both(twin, tmp_path, counted)
    ]
    assert all(map(runs_as_firmware, specs))
    one, other = map(simulate, specs)
    assert len(one.t) == len(other.t) == 301 and one.stopped is other.stopped is None
    np.testing.assert_allclose(one.q[:, 2:], other.q[:, 2:], rtol=0, atol=1e-3)
    for run in (one, other):
        assert np.linalg.norm(run.seen[:, :2] - run.q[:, :2], axis=1).max() < 2e-3


def test_reckoned_columns_are_coordinates_on_a_floor(twin, tmp_path):
    """Without noise dead reckoning in the engine ends where the coordinates are,
    not at the vehicle's point 0.36 m away."""
    pytest.importorskip("mujoco")
    spec, _ = both(twin, tmp_path, path=LINE)
    run = simulate(spec, engine="mujoco")
    assert np.abs(run.floor.reckoned - run.q[:, :3]).max() < 0.01
