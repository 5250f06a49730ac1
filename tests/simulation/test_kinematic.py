"""Kinematic laws: commands nu = Phi^-1 (v - drift), their limits, the runs behind drives,
and the outer loop about them."""

import itertools
import math
import re
import struct
import subprocess
from dataclasses import replace
from pathlib import Path

import casadi as ca
import control
import noslip
import numpy as np
import pytest
from noslip.analysis.outer.channel import Channel, Required
from noslip.analysis.outer.design import Gains
from noslip.analysis.outer.drive import DriveLoop
from noslip.analysis.outer.motion import steady_motion
from noslip.analysis.outer.report import OuterLoopReport
from noslip.analysis.outer.robustness import Loops
from noslip.analysis.outer.setting import default_spec, setting_of
from noslip.checks.verification.verify import differences
from noslip.codegen.files import law_program, law_text, robot_files
from noslip.codegen.printing.scalar import SCALARS as C_SCALARS
from noslip.codegen.runtime import RUNTIME
from noslip.model.errors import ModelError
from noslip.model.mechanism import Mechanism
from noslip.model.names import LawName
from noslip.model.outputs import OUTPUTS
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot, law_of, system_of
from noslip.simulation.closed_loop import simulate
from noslip.simulation.controllers.backends import make_controller
from noslip.simulation.controllers.compiled import library
from noslip.simulation.controllers.controller import Limits
from noslip.simulation.controllers.odometry import vehicle_wheels
from noslip.simulation.controllers.runtime import runtime
from noslip.simulation.controllers.velocity import (
    CompiledVelocity,
    ReferenceVelocity,
    VehicleLimits,
    VelocityLimits,
)
from noslip.simulation.specification.spec import DriveSection, Initial, Simulation, Spec, read_spec, spec_of
from noslip.tests.tools import HOST_CC

ROOT = Path(noslip.__file__).parent
HEADER = "noslip_velocity.h"
PERIOD = 0.01  # s
TOLERANCE = {"casadi": 1e-7, "c": 1e-7, "cf": 2e-3}
LABMATE = dict(zip(("r", "b", "d"), (0.15, 0.3, 0.3), strict=True))


def law(robot: str = "labmate", name: str = "type_iv_line"):
    return law_of(find_robot(robot), f"{name}_kinematic")


def controller(law, backend="c", limits=None, **config):
    """A controller with the defaults of robot and law, but for entries of config."""
    chosen = [config.get(q.name, q.default) for q in law.config]
    return make_controller(
        backend,
        law,
        [p.default for p in law.parameters],
        chosen,
        [2.0 + k for k in range(len(law.gains))],
        limits,
    )


def rolled(law, q: np.ndarray, nu: np.ndarray) -> np.ndarray:
    """The rates of the LABMATE's coordinates as a unicycle, by hand: x_c, y_c, phi, theta_r, theta_l."""
    p = {each.name: each.default for each in law.parameters}
    speed, turning = p["r"] * (nu[0] + nu[1]) / 2, p["r"] * (nu[0] - nu[1]) / (2 * p["b"])
    c, s = math.cos(q[2]), math.sin(q[2])
    return np.array([speed * c - p["d"] * turning * s, speed * s + p["d"] * turning * c, turning, *nu])


CONFIG = {
    "L": 0.4,
    "W": -0.2,
    "A": 1.0,
    "B": -2.0,
    "C": 0.3,
    "R": 2.0,
    "a": 3.0,
    "b": 1.5,
    "curvature": 0.3,
    "x_f": 0.2,
}


@pytest.mark.parametrize("backend", TOLERANCE)
@pytest.mark.parametrize("name", [*OUTPUTS, "type_iv_circle_offset", "type_i_offset"])
def test_the_commands_move_the_outputs_as_desired(name, backend):
    """Differences of h along the motion of a unicycle, without Phi: each output moves with ydot_d + k (y_d -
    y), and the speed is the desired one. At random states and references; the velocities of the state do not
    matter.
    """
    made, random, seen = law(name=name), np.random.default_rng(3), 0
    one = controller(made, backend, **CONFIG)
    h = ca.Function(
        "h",
        [*[ca.vertcat(*[q.symbol for q in made.groups[g]]) for g in ("state", "params", "config")]],
        [made.linearization.h],
    )
    numbers = [[p.default for p in made.parameters], [CONFIG.get(q.name, q.default) for q in made.config]]
    degrees, gains = made.linearization.relative_degree, iter(2.0 + k for k in range(len(made.gains)))
    gain = [next(gains) if degree else 0.0 for degree in degrees]
    for _ in range(25):
        q, reference = random.uniform(-2, 2, 5), random.uniform(-1, 1, len(made.reference))
        status, command = one.step(np.concatenate([q, random.uniform(-9, 9, 2)]), reference)
        if status == "singular":
            continue
        assert status == "ok"
        moving, eps = rolled(made, q, command), 1e-5
        either = [
            h(np.concatenate([q + sign * eps * moving, command]), *numbers).full().ravel() for sign in (1, -1)
        ]
        y = h(np.concatenate([q, command]), *numbers).full().ravel()
        rate, place = (either[0] - either[1]) / (2 * eps), 0
        size = 1 + np.abs(command).max()
        for k, degree in enumerate(degrees):
            if degree:
                desired = reference[place + 1] + gain[k] * (reference[place] - y[k])
                assert abs(rate[k] - desired) <= TOLERANCE[backend] * size * 10, (name, k)
            else:
                assert abs(y[k] - reference[place]) <= TOLERANCE[backend] * size
            place += degree + 1
        seen += 1
    assert seen > 15


@pytest.mark.parametrize(
    "robot, name",
    [
        ("car", "type_iv_segment"),
        *(
            pytest.param(*each, marks=pytest.mark.nightly)
            for each in (
                ("mobile_manipulator", "end_point"),
                ("four_wheel", "type_iv_circle"),
                ("slope_platform", "type_ii"),
            )
        ),
    ],
)
def test_c_is_the_reference(robot, name, tmp_path):
    """The comparison that `noslip generate` makes, for robots that steer, with more quasi-velocities and more
    inputs; it finds a planted sign.
    """
    made, system = law(robot, name), system_of(find_robot(robot))
    files = robot_files(system, [made], dynamics=False)
    assert list(differences(system, [made], files)) == []
    source = f"{robot}_{made.name}.c"
    text = files[source]
    line = next(
        x
        for x in text[text.index("_step_law(") :].splitlines()
        if "command[0] =" in x and ("-" in x or "+" in x)
    )
    planted = line.replace("-", "+", 1) if "-" in line else line.replace("+", "-", 1)
    wrong = files | {source: text.replace(line, planted, 1)}
    assert list(differences(system, [made], wrong)) != []


def test_all_that_a_law_says():
    """Name, degrees, gains, references and units; no masses; the names of the parts of a law's name."""
    made = law(name="type_iv_circle")
    assert made.linearization.relative_degree == (1, 0) and made.kinematic and made.speed_row == 1
    assert [q.name for q in made.gains] == ["kv_distance"]
    assert [q.name for q in made.reference] == ["distance", "distance_rate", "speed"]
    assert [(q.name, q.unit) for q in made.inputs] == [
        ("command_thetadot_r", "rad/s"),
        ("command_thetadot_l", "rad/s"),
    ]
    masses = ca.vertcat(*[p.symbol for p in made.parameters if p.name not in LABMATE])
    assert not ca.depends_on(made.tau, masses) and not ca.depends_on(made.tau, made.system.nu)
    assert law_of(find_robot("labmate"), "type_iv_circle").tau.shape == made.tau.shape
    for name in ("type_i_kinematic", "type_iv_line_offset_kinematic", "type_iii"):
        assert str(LawName.parse(name)) == name and LawName.parse(name).kinematic == name.endswith(
            "kinematic"
        )
    for entry in law_program(made).entries:
        assert "ground" not in entry.name and entry.name not in ("rate", "decoupling_rate")


def test_refused():
    robot = find_robot("labmate")
    with pytest.raises(BadInput, match="a kinematic law has no dynamic extension"):
        law_of(robot, "type_i_extended_kinematic")
    with pytest.raises(BadInput, match="unknown output"):
        law_of(robot, "type_v_kinematic")
    with pytest.raises(BadInput, match="for laws that give torques"):
        controller(law(), limits=Limits((1.0, 1.0), "grip"))
    own = Mechanism("own", "a wheel")
    x, y, phi = (own.coordinate(name, unit, "") for name, unit in (("x", "m"), ("y", "m"), ("phi", "rad")))
    assert x is not None and y is not None and phi is not None
    with pytest.raises(ModelError, match="_kinematic ends those of kinematic laws"):
        own.output("tip_kinematic", "", [])


def test_a_speed_must_be_affine():
    """An output that is a square of a velocity has no kinematic law."""
    from noslip.model.law import control_law
    from noslip.model.outputs import output_map

    system = system_of(find_robot("labmate"))
    made = output_map(system, "type_iv_line_kinematic")
    squared = replace(made.rows[1], expression=made.rows[1].expression ** 2 + made.rows[1].expression)
    with pytest.raises(ModelError, match="not affine in the quasi-velocities"):
        control_law(system, replace(made, rows=(made.rows[0], squared)))


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_any_bits_in_finite_out(scalar):
    """Random bit patterns, infinities and NaN in state and reference:
    finite commands within their limits, zeros on an error."""
    made, form = law(name="type_iv_circle"), "<f" if scalar == "float" else "<d"
    random, statuses = np.random.default_rng(5), set()
    one = controller(
        made, "cf" if scalar == "float" else "c", Limits((60.0, 40.0), "slow"), R=2.0, x_f=0.0, y_f=0.0
    )

    def wild() -> float:
        if random.random() < 0.95:
            return float(random.normal(0, 1.5))
        return float(struct.unpack(form, random.bytes(struct.calcsize(form)))[0])

    for _ in range(4000):
        state, reference = (np.array([wild() for _ in group]) for group in (made.state, made.reference))
        with np.errstate(all="ignore"):
            status, command = one.step(state, reference)
        statuses.add(status)
        assert np.isfinite(command).all() and (np.abs(command) <= [60.0, 40.0]).all()
        assert status in ("ok", "saturated") or (command == 0).all()
    assert {"ok", "saturated", "nonfinite", "range"} <= statuses


def test_singular_is_said_and_held():
    """With the heading normal to the path the distance cannot be commanded: an error,
    zeros or the held command."""
    made = law()
    state, reference = np.array([0, 1.0, 0.0, 0, 0, 0, 0]), np.array([0.0, 0.0, 1.0])
    state[2] = math.atan2(-1.0, 1.0)  # the normal of y = x
    for backend in TOLERANCE:
        status, command = controller(made, backend, A=1.0, B=-1.0).step(state, reference)
        assert status == "singular" and (command == 0).all()
    compiled = library(made, "double")
    assert (
        "NOSLIP_SLOW" in compiled.text.declarations()
        and "friction is not used" in compiled.text.declarations()
    )


def test_slow_keeps_the_path():
    """With NOSLIP_SLOW the command is within its limits, and the distance still moves as desired;
    in the C and the reference."""
    made, q = law(), np.array([0.3, 1.0, 0.6, 0, 0])
    reference = np.array([0.0, 0.0, 3.0])
    free = controller(made, A=0.0, B=1.0).step(np.append(q, [0, 0]), reference)[1]
    for backend in TOLERANCE:
        slow = controller(made, backend, Limits((0.5 * free.max(),) * 2, "slow"), A=0.0, B=1.0)
        status, command = slow.step(np.append(q, [0, 0]), reference)
        assert status == "saturated" and np.abs(command).max() == pytest.approx(0.5 * free.max(), rel=1e-5)
        assert rolled(made, q, command)[1] == pytest.approx(rolled(made, q, free)[1], rel=1e-4)


# -- limits of the commands ----------------------------------------------------------------------------------

VEHICLE = VehicleLimits((0.075, 0.075), (0.25, -0.25), 1.2, 1.6)
UNEVEN = VehicleLimits((0.08, 0.07), (0.26, -0.22), 1.2, 1.6)  # wheels of two sizes
WIDE = VelocityLimits((40.0, 40.0), (60.0, 60.0), (1e3, 1e3), VEHICLE)


def twist(command: np.ndarray) -> np.ndarray:
    return np.array([VEHICLE.forward, VEHICLE.turn]) @ command


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_follow_is_the_reference(scalar):
    """Beside the reference implementation, with desired velocities that jump,
    with limits of the vehicle and without."""
    random, seen = np.random.default_rng(4), set()
    for count, vehicle in itertools.product((2, 2, 2), (VEHICLE, UNEVEN, None)):
        limits = VelocityLimits((30.0, 20.0), (40.0, 90.0), tuple(random.uniform(0.5, 50, count)), vehicle)
        both = [CompiledVelocity(limits, PERIOD, scalar), ReferenceVelocity(limits, PERIOD)]
        nu, desired = np.zeros(count), np.zeros(count)
        for k in range(300):
            desired = random.normal(0, 15, count) if k % 25 == 0 else desired
            status = "singular" if k % 90 == 80 else "ok"
            (found, command), (expected, reference) = (
                one.follow(desired, nu, status, PERIOD) for one in both
            )
            assert np.abs(command - reference).max() <= (1e-11 if scalar == "double" else 1e-4)
            assert found == expected or scalar == "float"
            both[1]._command = np.array(command)
            nu = nu + 0.3 * (command - nu)
            seen.add(found)
    assert {"ok", "saturated", "grip", "singular"} <= seen


@pytest.mark.parametrize("scalar, slack", [("double", 1e-12), ("float", 1e-5)])
def test_accelerations_of_the_vehicle_are_kept(scalar, slack):
    """Along the way and across it, each at most its limit, together at most friction;
    and the desired motion is reached."""
    random = np.random.default_rng(6)
    one, before = CompiledVelocity(WIDE, PERIOD, scalar), np.zeros(2)
    one.reset(before)
    for _ in range(60):
        speed, yaw = random.uniform(-2, 2), random.uniform(-2, 2)
        desired = np.linalg.solve([VEHICLE.forward, VEHICLE.turn], [speed, yaw])
        for _ in range(400):
            status, command = one.follow(desired, before, "ok", PERIOD)
            (v, w), (v_before, _) = twist(command), twist(before)
            assert (
                abs(v * w) <= VEHICLE.lateral * (1 + slack)
                and abs(v - v_before) <= VEHICLE.along * PERIOD * (1 + slack) + slack
            )
            assert np.hypot(v * w, (v - v_before) / PERIOD) <= 2.0 * (1 + slack) + 100 * slack
            before = command
        scale = min(1.0, math.sqrt(VEHICLE.lateral / abs(speed * yaw)))
        assert twist(command) == pytest.approx([scale * speed, scale * yaw], abs=1e-3), (speed, yaw)
        assert status == ("grip" if scale < 1 else "ok")


def test_too_fast_in_a_curve_brakes_and_says_so():
    """Commands that begin beyond the lateral limit come down to it, as fast as the accelerations allow."""
    one = CompiledVelocity(WIDE, PERIOD)
    start = np.linalg.solve([VEHICLE.forward, VEHICLE.turn], [1.5, 1.5])
    one.reset(start)
    statuses, products = [], [2.25]
    for _ in range(60):
        status, command = one.follow(start, start, "ok", PERIOD)
        statuses.append(status)
        products.append(float(np.prod(twist(command))))
    assert statuses[0] == "will_slip" and statuses[-1] == "grip" and products[-1] <= 1.6 * (1 + 1e-9)
    assert products[1] < 2.25 and max(products[2:]) <= max(products[1], 1.6 * (1 + 1e-9))
    one.reset(start)
    _, command = one.follow(start, start, "ok", PERIOD)
    assert command == pytest.approx(start * command[0] / start[0], rel=1e-12), "both go to zero together"
    assert twist(start - command)[0] == pytest.approx(VEHICLE.along * PERIOD, rel=1e-9), (
        "as fast as they may, no faster"
    )


def test_what_a_step_says():
    """A limit of the vehicle alone says so; the law's own word goes before it;
    a time too short for any change is refused."""
    one = CompiledVelocity(WIDE, PERIOD)
    straight, curve = (
        np.linalg.solve([VEHICLE.forward, VEHICLE.turn], each) for each in ([0.5, 0.0], [1.5, 1.5])
    )
    assert one.follow(straight, np.zeros(2), "ok", PERIOD)[0] == "saturated", (
        "60 rad/s^2 are more than the 1.2 m/s^2"
    )
    assert one.follow(curve, np.zeros(2), "ok", PERIOD)[0] == "grip"
    assert one.follow(curve, np.zeros(2), "saturated", PERIOD)[0] == "saturated"
    even = CompiledVelocity(replace(WIDE, vehicle=VehicleLimits((0.5, 0.5), (0.5, -0.5), 1.2, 1.0)), PERIOD)
    even.reset(np.array([2.0, 0.0]))  # 1 m/s and 1 rad/s: at the limit, not beyond it
    assert even.follow(np.array([2.0, 0.0]), np.array([2.0, 0.0]), "ok", PERIOD)[0] == "ok"
    status, command = CompiledVelocity(replace(WIDE, vehicle=None), PERIOD).follow(
        curve, np.zeros(2), "ok", 1e-311
    )
    assert status == "nonfinite" and np.all(command == 0)


def test_misuse_of_the_vehicle():
    made = runtime(HEADER)
    one = made.new("noslip_velocity", "double")
    rows = made.ffi.new("noslip_velocity_limits[]", [(1.0, 1.0, 1.0)] * 2)
    good = {"forward": VEHICLE.forward, "turn": VEHICLE.turn, "along": 1.0, "lateral": 1.0}
    pair = made.array("double", [7.0, 7.0])

    def put(self, **changes) -> str:
        return made.status(
            made.lib.noslip_velocity_set_vehicle(
                self, made.new("noslip_velocity_vehicle", "double", good | changes)
            )
        )

    assert (
        put(one) == "not_ready"
        and made.status(made.lib.noslip_velocity_twist(one, pair)) == "not_ready"
        and pair[0] == 0
    )
    assert made.lib.noslip_velocity_init(one, rows, 2, PERIOD) == 0
    assert made.status(made.lib.noslip_velocity_twist(one, pair)) == "not_ready"
    for name in ("along", "lateral"):
        for bad in (0.0, -1.0, math.nan, math.inf):
            assert put(one, **{name: bad}) == "bad_parameter"
    assert put(one, along=5e-324) == "bad_parameter", "of which a period makes no speed"
    assert put(one, turn=VEHICLE.forward) == put(one, turn=(math.nan, 0.0)) == "bad_parameter"
    assert (
        put(made.ffi.NULL) == "null" == made.status(made.lib.noslip_velocity_set_vehicle(one, made.ffi.NULL))
    )
    assert put(one) == "ok" and made.status(made.lib.noslip_velocity_twist(one, made.ffi.NULL)) == "null"
    assert made.lib.noslip_velocity_reset(one, made.array("double", [0.5, 0.25])) == 0
    assert made.lib.noslip_velocity_twist(one, pair) == 0 and list(pair) == pytest.approx(
        twist(np.array([0.5, 0.25])), rel=1e-12
    )
    assert made.lib.noslip_velocity_init(one, rows, 1, PERIOD) == 0 and put(one) == "bad_parameter"


@pytest.mark.parametrize("scalar, form", [("double", "<d"), ("float", "<f")])
def test_any_bits_of_desired_velocities(scalar, form):
    """Commands stay finite, within speed and accelerations, the lateral one too, whatever bits come in."""
    random, one, before = np.random.default_rng(8), CompiledVelocity(WIDE, PERIOD, scalar), np.zeros(2)
    eps = float(np.finfo(np.float32 if scalar == "float" else float).eps)

    def wild() -> float:
        if random.random() < 0.6:
            return float(random.normal(0, 9))
        return float(struct.unpack(form, random.bytes(struct.calcsize(form)))[0])

    for _ in range(5000):
        desired, nu = ([wild() for _ in range(2)] for _ in range(2))
        with np.errstate(all="ignore"):
            status, command = one.follow(np.array(desired), np.array(nu), "ok", PERIOD)
        assert np.isfinite(command).all() and (np.abs(command) <= 40).all(), (desired, nu)
        assert (np.abs(command - before) <= 60 * PERIOD * (1 + 8 * eps) + 160 * eps).all()
        v, w = twist(command)
        assert abs(v * w) <= VEHICLE.lateral * (1 + 64 * eps) or status == "will_slip"
        before = command


# -- runs ----------------------------------------------------------------------------------------------------

CIRCLE = """
robot = "labmate"
[output]
type = "IV"
L = 0.0
path = { kind = "circle", x_f = 0.0, y_f = 0.0, R = 3.0 }
[reference]
speed = 1.4
[initial]
point = [3.5, 0.0]
heading = 1.4
speed = 0.5
[drive]
kind = "kinematic"
bandwidth = 5.0
delay = 0.02
most_speed = 40.0
most_acceleration = 60.0
[simulation]
duration = 4.0
period = 0.01
backend = "casadi"
"""
GRIP = '[limits]\nmode = "grip"\n[contact]\nmu = 0.08\n'


@pytest.mark.nightly
def test_a_run_decays_as_the_gain_says():
    """Behind fast drives the distance decays as exp(-kv t), and the speed is the desired one;
    in all backends."""
    fast = (
        CIRCLE.replace("bandwidth = 5.0", "bandwidth = 400.0")
        .replace("delay = 0.02", "delay = 0.0")
        .replace("60.0", "1e5")
    )
    fast = fast.replace("period = 0.01", "period = 0.001\ngains = {}").replace("gains = {}", "")
    run = simulate(spec_of(fast, "test"), "c")
    assert (
        run.y[:, 0] == pytest.approx(0.5 * np.exp(-2.0 * run.t), abs=3e-3)
        and abs(run.y[50:, 1] - 1.4).max() < 1e-6
    )
    model, double, single = (simulate(spec_of(CIRCLE, "test"), backend) for backend in ("casadi", "c", "cf"))
    assert np.abs(double.x - model.x).max() < 1e-9 and np.abs(single.x - model.x).max() < 1e-3
    assert (
        model.columns[-2:] == ["command_thetadot_r", "command_thetadot_l"]
        and model.law.name == "type_iv_circle_kinematic"
    )
    heavier = CIRCLE.replace("[output]", "plant = { m_c = 120.0, I_c = 60.0 }\n[output]", 1)
    assert np.abs(simulate(spec_of(heavier, "test")).y - model.y).max() < 1e-9, "masses do not matter"


def test_a_run_keeps_grip():
    """With [limits] mode = "grip" the commands stay within friction: 1.4 m/s on 3 m needs 0.65 m/s^2,
    there are 0.60."""
    run = simulate(spec_of(CIRCLE + GRIP, "test"), "c")
    forward, turn, _ = vehicle_wheels(run.law.system, run.plant.parameters)
    v, w = run.command @ forward, run.command @ turn
    most = 0.08 * 0.95 * 9.81
    assert run.stopped is None and np.abs(v * w).max() <= 0.8 * most * (1 + 1e-9)
    assert np.abs(np.diff(v)).max() <= 0.6 * most * PERIOD * (1 + 1e-9)
    assert "grip" in run.status and run.y[-1, 1] < 1.35 and abs(run.y[-1, 0]) < 0.05
    free = simulate(spec_of(CIRCLE, "test"), "c")
    assert np.abs((free.command @ forward) * (free.command @ turn)).max() > most


@pytest.mark.nightly
@pytest.mark.parametrize("robot", ["car", "four_wheel", "mobile_manipulator"])
def test_other_robots_run(robot):
    spec = read_spec(ROOT / f"examples/specs/robots/{robot}.toml")
    drive = DriveSection(kind="kinematic", bandwidth=20.0, most_speed=(30.0,), most_acceleration=(60.0,))
    simulation = replace(spec.simulation, period=PERIOD, duration=3.0, output_step=0.05)
    run = simulate(replace(spec, drive=drive, limits=None, gains={}, simulation=simulation))
    assert run.stopped is None and np.abs(run.error[-1, 0]) < 0.2 * np.abs(run.error[:, 0]).max() + 1e-3


def test_a_composite_path_is_followed():
    """Lines and arcs with a cusp, with the kinematic law."""
    spec = read_spec(ROOT / "examples/specs/figures/figure_11.toml")
    drive = DriveSection(kind="kinematic", bandwidth=20.0)
    run = simulate(
        replace(spec, drive=drive, limits=None, gains={}, simulation=replace(spec.simulation, period=PERIOD)),
        "c",
    )
    assert (
        run.stopped is None
        and run.law.name.endswith("segment_kinematic")
        and np.abs(run.error[:, 0]).max() < 0.05
    )


@pytest.mark.parametrize(
    "change, said",
    [
        (
            ("[drive]", "[limits]\ntorque = 5.0\n[drive]"),
            "most_speed and most_acceleration limit its commands",
        ),
        (
            ("[drive]", '[contact]\nmu = 0.5\n[limits]\ntorque = 5.0\nmode = "grip"\n[drive]'),
            "its law gives velocities",
        ),
        (("[drive]", '[limits]\nmode = "grip"\n[drive]'), "requires .contact.: mu"),
        (
            (
                "[drive]",
                '[contact]\nmu = 0.5\n[limits]\nmode = "grip"\nnotice_slip = { window = 0.3 }\n[drive]',
            ),
            "notice_slip does not go with",
        ),
        (("speed = 1.4", "speed = 1.4\napproach = { acceleration = 0.5 }"), "approach does not go with"),
        (("bandwidth = 5.0\n", ""), 'kind = "kinematic" requires .drive. bandwidth'),
        (("period = 0.01", "period = 0.0"), "requires .simulation. period > 0"),
        (("robot =", "gains = { ki_speed = 1.0 }\nrobot ="), "ki_speed"),
        (("robot =", "gains = { kd_distance = 1.0 }\nrobot ="), "kd_distance"),
    ],
)
def test_refused_specs(change, said):
    with pytest.raises(BadInput, match=said):
        simulate(spec_of(CIRCLE.replace(*change, 1), "test"))


# -- outer loop ----------------------------------------------------------------------------------------------


def grown(spec: Spec, gain: float) -> float:
    """By what a deviation of 1e-6 m from the steady motion has grown from the second to the third 1.5 s,
    simulated."""
    drive = DriveSection(
        kind="kinematic", bandwidth=5.0, delay=0.02, most_speed=(100.0,), most_acceleration=(1000.0,)
    )
    simulation = Simulation(duration=4.5, period=PERIOD, output_step=PERIOD, backend="casadi")
    spec = replace(spec, gains={"kv_distance": gain}, drive=drive, simulation=simulation)
    x = steady_motion(replace(setting_of(spec), drive=DriveLoop(10 * math.pi, 0.02, False, True))).state
    x[0] += 1e-6
    run = simulate(replace(spec, initial=Initial(q=tuple(x[:5]), nu=tuple(x[5:]))))
    error, third = np.abs(run.error[:, 0]), round(1.5 / PERIOD)
    return error[2 * third :].max() / error[third : 2 * third].max()


@pytest.mark.parametrize("name", ["type_iv_line", "type_iv_circle"])
def test_the_stability_limit_is_that_of_the_simulation(name):
    """Behind 5 Hz and 20 ms: stable at 0.98, unstable at 1.02 of the predicted factor;
    another delay would give another one."""
    made, gain = law(name=name), 2.0
    found = [
        OuterLoopReport(
            made, default_spec("labmate", made), {"distance": Gains(1, gain)},
            Loops(PERIOD, False, DriveLoop(10 * math.pi, delay, False, True)), Required(), 0.2,
        )
        for delay in (0.02, 0.0)
    ]  # fmt: skip
    factor = found[0].fastest
    assert factor < found[0].channels["distance"].fastest() and found[1].fastest > 1.1 * factor
    assert (
        grown(found[0].spec, 0.98 * gain * factor) < 0.95
        and grown(found[0].spec, 1.02 * gain * factor) > 1.05
    )
    assert found[0].motion.inputs == ["command_thetadot_r", "command_thetadot_l"]


def test_the_distance_falls_as_python_control_says():
    """A step of the desired distance of Type I along x: the sampled channel predicts each row, and a transfer
    function with a Padé approximation of delay and hold the rise time within 2 %.
    """
    kv, period = 6.0, 0.004
    made = law(name="type_i")
    drive = DriveSection(
        kind="kinematic", bandwidth=5.0, delay=0.02, most_speed=(100.0,), most_acceleration=(1e4,)
    )
    spec = default_spec("labmate", made)
    spec = replace(
        spec,
        gains={"kv": kv},
        drive=drive,
        reference=replace(spec.reference, position=(1.0, 0.0), velocity=(0.0, 0.0)),
        initial=Initial(point=(0.0, 0.0), heading=0.0, speed=0.0),
        simulation=Simulation(duration=1.2, period=period, output_step=period, backend="casadi"),
    )
    run = simulate(spec)
    channel = Channel(
        "x_l", "m", Gains(1, kv), period, drive=DriveLoop(drive.omega, drive.delay, False, True)
    )
    predicted = control.step_response(channel.closed(), run.t, squeeze=False).outputs[0, 0]
    assert np.abs(predicted - run.y[:, 0]).max() < 1e-8
    late = control.tf(*control.pade(0.02 + period / 2, 8))
    t = np.linspace(0, 1.2, 4000)
    integrator, lag = control.tf([1.0], [1.0, 0.0]), control.tf([1.0], [1 / drive.omega, 1.0])
    expected = control.step_response(control.feedback(kv * integrator * lag * late), t).outputs

    def rise(t: np.ndarray, y: np.ndarray) -> float:
        up = np.argmax(y)
        return float(np.interp(0.9, y[: up + 1], t[: up + 1]) - np.interp(0.1, y[: up + 1], t[: up + 1]))

    assert rise(run.t, run.y[:, 0]) == pytest.approx(rise(t, expected), rel=0.02)
    ideal = control.step_response(control.feedback(kv * integrator), t).outputs
    assert rise(run.t, run.y[:, 0]) != pytest.approx(rise(t, ideal), rel=0.1), "an ideal drive would pass too"


def test_command_line(tmp_path, bad_input, capsys):
    from noslip.cli.main import main

    given = ["outer-loop", "labmate", "--period", "0.01", "--bandwidth", "5", "--drive-delay", "0.02"]
    fast = [*given, "--settling", "0.1", "--drive", "kinematic"]
    said = bad_input([*fast, "--output", "type_iv_line"])
    assert "behind kinematic drives of 5 Hz, delay 0.02 s" in said
    assert bad_input([*fast, "--output", "type_iv_line_kinematic"]) == said
    assert "a kinematic law goes with --drive kinematic" in bad_input(
        [*given, "--output", "type_iv_line_kinematic", "--drive", "velocity"]
    )
    spec = tmp_path / "circle.toml"
    spec.write_text(CIRCLE)
    assert "a kinematic law goes with" in bad_input([*given, "--spec", str(spec), "--drive", "torque"])
    assert "unknown output 'speed'" in bad_input([*fast, "--output", "type_iv_line", "--poles", "speed=-1"])
    fmu = [
        "export",
        "labmate",
        "--output",
        "type_i_kinematic",
        "--fmu",
        "controller",
        "-o",
        str(tmp_path / "a.fmu"),
    ]
    assert "take type_i" in bad_input(fmu)
    out = tmp_path / "c"
    assert (
        main(["generate", "labmate", "--output", "type_i_kinematic", "--scalar", "float", "-o", str(out)])
        == 0
    )
    assert (out / "labmate/labmate_type_i_kinematic_f.c").exists() and not list(
        out.rglob("*kinematic_steps*")
    )


def test_page(tmp_path):
    """The C of docs/drives.md for a kinematic law compiles without a warning,
    with the law that noslip generates."""
    page = (ROOT / "docs/drives.md").read_text()
    (block,) = re.findall(r"tests/simulation/test_kinematic.py -->\n```c\n(.*?)^```", page, re.S | re.M)
    prototypes = re.findall(r"^(?:int|void) [^{]*?\)(?=\n\{)", block, re.M)
    includes = "".join(line + "\n" for line in block.splitlines() if line.startswith("#"))
    (tmp_path / "tick.c").write_text(includes + "".join(f"{each};\n" for each in prototypes) + block)
    text = law_text(law_program(law()), C_SCALARS["float"])
    for name, content in text.files().items():
        (tmp_path / name).write_text(content)
    flags = (
        "-std=c99 -O2 -pedantic -Wall -Wextra -Wconversion -Wdouble-promotion -Wfloat-equal -Wshadow "
        "-Wstrict-prototypes -Werror"
    )
    folders = [f"-I{tmp_path}", f"-I{RUNTIME}", f"-I{ROOT / 'generated/labmate'}"]
    for source in ("tick.c", "labmate_type_iv_line_kinematic_f.c"):
        subprocess.run(
            [HOST_CC, *flags.split(), *folders, "-c", tmp_path / source, "-o", tmp_path / "a.o"], check=True
        )
    assert len(prototypes) == 2
