"""Velocity-controlled drives: the C of the commands, the drives in the simulation,
and the outer loop behind them."""

import itertools
import math
import re
import struct
import subprocess
from dataclasses import replace
from pathlib import Path

import control
import noslip
import numpy as np
import pytest
from noslip.analysis.outer.channel import Channel, Required
from noslip.analysis.outer.design import Gains
from noslip.analysis.outer.drive import DriveLoop, sampled_late
from noslip.analysis.outer.motion import steady_motion
from noslip.analysis.outer.report import OuterLoopReport
from noslip.analysis.outer.robustness import Loops
from noslip.analysis.outer.setting import default_spec, setting_of
from noslip.codegen.runtime import RUNTIME
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot, law_of
from noslip.simulation.closed_loop import as_json, simulate, summary
from noslip.simulation.controllers.odometry import vehicle_wheels
from noslip.simulation.controllers.runtime import runtime
from noslip.simulation.controllers.velocity import (
    CompiledVelocity,
    ReferenceVelocity,
    VelocityLimits,
    make_acceleration,
)
from noslip.simulation.drive import whole_periods
from noslip.simulation.guidance import vehicle_motion
from noslip.simulation.specification.spec import DriveSection, Initial, Simulation, Spec, spec_of
from noslip.simulation.sweeping.batch import Batch
from noslip.tests.tools import HOST_CC

ROOT = Path(noslip.__file__).parent
HEADER = "noslip_velocity.h"
SCALARS = {"double": (float, "<d", 1e-12), "float": (np.float32, "<f", 1e-4)}
PERIOD = 0.01  # s

LINE = """
robot = "labmate"
[output]
type = "IV"
L = 0.0
path = { kind = "line", A = 1.0, B = -1.0, C = 0.0 }
[reference]
speed = 1.4
[initial]
point = [0.0, 0.5]
heading = 0.7853981633974483
speed = 0.5
[simulation]
duration = 3.0
period = 0.01
backend = "casadi"
"""
VELOCITY = (
    '[drive]\nkind = "velocity"\nbandwidth = 5.0\ndelay = 0.02\nmost_speed = 40.0\nmost_acceleration = 60.0\n'
)


def limits(random: np.random.Generator, count: int) -> VelocityLimits:
    return VelocityLimits(*(tuple(random.uniform(low, 10 * low, count)) for low in (2.0, 5.0, 0.3)))


# -- the C ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("scalar", SCALARS)
@pytest.mark.parametrize("count", [1, 2, 5, 8])
def test_c_is_the_reference(count, scalar):
    """Beside the reference implementation, along random motions: within all limits, beyond each,
    and with errors of the law."""
    random, seen = np.random.default_rng(count), set()
    for _ in range(12):
        given, nu = limits(random, count), random.uniform(-1, 1, count)
        both = [CompiledVelocity(given, PERIOD, scalar), ReferenceVelocity(given, PERIOD)]
        for one in both:
            one.reset(nu)
        size = random.choice([0.1, 1.0, 20.0])
        for k in range(60):
            u, dt = size * random.normal(0, 8, count), random.uniform(0.1, 2.0) * PERIOD
            status = "singular" if k % 20 == 19 else "grip" if k % 7 == 0 else "ok"
            (found, command), (wanted, reference) = (one.step(u, nu, status, dt) for one in both)
            if status == "singular":  # over the period, not over dt
                both[1]._command = np.array(command)
                assert found == "singular"
                continue
            assert np.abs(command - reference).max() <= SCALARS[scalar][2] * 20
            assert found == wanted or scalar == "float"
            both[1]._command = np.array(command)
            seen.add(found)
            nu = nu + 0.3 * (command - nu) + random.normal(0, 0.05, count)
    assert seen == {"ok", "saturated", "grip"}


def commands(self, u, nu, status=0, dt=PERIOD, scalar="double", count=None):
    """Call the C with numbers as they are; return status and commands."""
    made = runtime(HEADER)
    count = count or self.count
    out = made.array(scalar, [math.nan] * count)
    given = [made.array(scalar, each) if each is not None else made.ffi.NULL for each in (u, nu)]
    status = made.function("noslip_velocity_step", scalar)(self, *given, status, dt, out)
    return made.status(status), np.array(list(out))


def initialized(speed, acceleration, band, scalar="double", period=PERIOD):
    made = runtime(HEADER)
    self = made.new("noslip_velocity", scalar)
    kind = made.ffi.typeof(made.new("noslip_velocity_limits", scalar)).item.cname
    rows = made.ffi.new(f"{kind}[]", list(zip(speed, acceleration, band, strict=True)))
    return self, made.status(made.function("noslip_velocity_init", scalar)(self, rows, len(speed), period))


@pytest.mark.parametrize("scalar", SCALARS)
def test_any_bits_in_limited_out(scalar):
    """Random bit patterns, infinities and NaN: commands stay finite, within speed,
    and change by at most acceleration x dt."""
    kind, form, _ = SCALARS[scalar]
    random, eps = np.random.default_rng(3), float(np.finfo(kind).eps)
    speed, acceleration = np.array([3.0, 7.0, 0.5]), np.array([9.0, 4.0, 30.0])
    self, status = initialized(speed, acceleration, [0.4, 1.0, 0.1], scalar)
    assert status == "ok"

    def wild() -> float:
        if random.random() < 0.6:
            return float(random.normal(0, 5))
        return float(struct.unpack(form, random.bytes(struct.calcsize(form)))[0])

    before, statuses = np.zeros(3), set()
    for _ in range(6000):
        u, nu = ([wild() for _ in range(3)] for _ in range(2))
        dt = PERIOD if random.random() < 0.8 else wild()
        law = int(random.choice([0, 0, 0, 1, 3, -5, -2, 99]))
        status, command = commands(self, u, nu, law, dt, scalar)
        used = dt if 0 < dt <= 2 * PERIOD else PERIOD
        statuses.add(status)
        assert np.isfinite(command).all() and (np.abs(command) <= speed).all()
        assert (np.abs(command - before) <= acceleration * used * (1 + 8 * eps) + 4 * eps * speed).all(), (
            u,
            nu,
            law,
            dt,
        )
        before = command
    assert {"ok", "saturated", "nonfinite", "range", "singular"} <= statuses


def test_on_an_error_the_wheels_stop_together():
    """The ramp keeps the proportion of the commands, the steepest one with the largest acceleration,
    and it ends at zero."""
    self, _ = initialized([20.0] * 3, [5.0, 10.0, 10.0], [50.0] * 3)
    made = runtime(HEADER)
    start = np.array([4.0, -6.0, 1.0])
    assert made.lib.noslip_velocity_reset(self, made.array("double", start)) == 0
    steps = math.ceil(max(np.abs(start) / [5.0, 10.0, 10.0]) / PERIOD)
    before = start
    for k in range(1, steps + 3):
        status, command = commands(self, [1e3] * 3, [math.nan] * 3, -5)
        assert status == "singular"
        assert command == pytest.approx(start * max(0.0, 1 - k / steps), abs=1e-12)
        rates = np.abs((command - before) / PERIOD / [5.0, 10.0, 10.0])
        assert rates.max() == pytest.approx(1.0 if k <= steps else 0.0, abs=1e-5)
        before = command
    for given, status in (
        ((None, [0.0] * 3), "null"),
        (([0.0] * 3, None), "null"),
        (([math.inf, 0, 0], [0.0] * 3), "nonfinite"),
    ):
        made.lib.noslip_velocity_reset(self, made.array("double", start))
        found, command = commands(self, *given)
        assert found == status and (np.abs(command) < np.abs(start)).all()


def test_a_blocked_wheel_is_not_given_an_ever_larger_command():
    """Anti-windup: the command stops a band away from the measured velocity,
    and turns back at once when u does."""
    self, _ = initialized([20.0] * 2, [10.0] * 2, [0.5, 0.5])
    for _ in range(200):
        status, command = commands(self, [8.0, 8.0], [0.0, 0.0])
    assert status == "saturated" and command == pytest.approx([0.5, 0.5], abs=1e-15)
    status, command = commands(self, [-8.0, 8.0], [0.0, 0.0])
    assert command == pytest.approx([0.42, 0.5], abs=1e-12)


def test_limits_keep_the_curve():
    """Accelerations are divided by one number, and so are speeds:
    the quotient of the wheels stays what the law wants."""
    self, _ = initialized([20.0] * 2, [10.0] * 2, [50.0, 50.0])
    assert commands(self, [100.0, 60.0], [0.0, 0.0])[1] == pytest.approx([0.1, 0.06], abs=1e-15)
    for _ in range(400):
        status, command = commands(self, [100.0, 60.0], [0.0, 0.0])
    assert status == "saturated" and command == pytest.approx([20.0, 12.0], rel=1e-6)


@pytest.mark.parametrize("scalar", SCALARS)
def test_misuse(scalar):
    made, good = runtime(HEADER), ([1.0], [1.0], [1.0])
    init = made.function("noslip_velocity_init", scalar)
    step, reset = (made.function(f"noslip_velocity_{name}", scalar) for name in ("step", "reset"))
    one, NULL = made.array(scalar, [7.0]), made.ffi.NULL
    for place, bad in itertools.product(range(3), (0.0, -1.0, math.nan, math.inf)):
        self, status = initialized(*[[bad] if k == place else each for k, each in enumerate(good)], scalar)
        assert status == "bad_parameter"
        assert made.status(step(self, one, one, 0, PERIOD, one)) == "not_ready" and one[0] == 7.0
        assert made.status(reset(self, one)) == "not_ready"
    again, _ = initialized(*good, scalar)
    assert (
        made.status(init(again, NULL, 1, PERIOD)) == "null" and made.status(reset(again, one)) == "not_ready"
    )
    for period in (0.0, -0.1, math.nan, math.inf):
        assert initialized(*good, scalar, period)[1] == "bad_parameter"
    for count in (0, 9):
        assert initialized(*[[1.0] * count] * 3, scalar)[1] == "bad_parameter"
    self, status = initialized(*good, scalar)
    assert status == "ok"
    assert (
        made.status(init(NULL, NULL, 1, PERIOD))
        == "null"
        == made.status(init(made.new("noslip_velocity", scalar), NULL, 1, 1.0))
    )
    assert (
        made.status(reset(self, NULL)) == "null"
        and made.status(reset(self, made.array(scalar, [math.nan]))) == "nonfinite"
    )
    assert made.status(reset(self, made.array(scalar, [5.0]))) == "ok" and self.command[0] == 1.0
    assert (
        made.status(step(NULL, one, one, 0, PERIOD, one))
        == "null"
        == made.status(step(self, one, one, 0, PERIOD, NULL))
    )
    for dt in (0.0, -PERIOD, 2.1 * PERIOD, 1e9):
        assert commands(self, [0.0], [0.0], 0, dt, scalar)[0] == "range"


def test_the_acceleration_is_the_one_that_the_law_wants():
    """Without limits, the acceleration that tau causes is u of the law: in all backends, at random states."""
    from noslip.simulation.controllers.backends import make_controller

    law = law_of(find_robot("labmate"), "type_iv_line")
    parameters = np.array([p.default for p in law.parameters])
    config, gains = ([q.default for q in group] for group in (law.config, law.gains))
    random = np.random.default_rng(2)
    for backend, tolerance in (("casadi", 1e-12), ("c", 1e-12), ("cf", 1e-4)):
        controller = make_controller(backend, law, parameters, config, gains)
        caused = make_acceleration(backend, law, parameters)
        for _ in range(20):
            x, reference = random.uniform(-1, 1, len(law.state)), random.uniform(-1, 1, len(law.reference))
            found = controller.evaluate(x, reference)
            if found.status != "ok":
                continue
            status, u = caused(x, found.values["tau"])
            assert status == "ok" and np.abs(u - found.values["u"]).max() <= tolerance * (1 + np.abs(u).max())


def test_page(tmp_path):
    """The C of docs/drives.md compiles without a warning; its twist is the vehicle's forward speed and yaw
    rate."""
    page = (ROOT / "docs/drives.md").read_text()
    (block,) = re.findall(r"tests/simulation/test_drives.py -->\n```c\n(.*?)^```", page, re.S | re.M)
    source = tmp_path / "tick.c"
    prototypes = re.findall(r"^(?:int|void) [^{]*?\)(?=\n\{)", block, re.M)
    includes = "".join(line + "\n" for line in block.splitlines() if line.startswith("#"))
    source.write_text(includes + "".join(f"{each};\n" for each in prototypes) + block)
    flags = (
        "-std=c99 -O2 -pedantic -Wall -Wextra -Wconversion -Wdouble-promotion -Wfloat-equal -Wshadow "
        "-Wstrict-prototypes -Werror"
    )
    folders = [f"-I{RUNTIME}", f"-I{ROOT / 'generated/labmate'}"]
    subprocess.run([HOST_CC, *flags.split(), *folders, "-c", source, "-o", tmp_path / "tick.o"], check=True)
    assert len(prototypes) == 3
    system = law_of(find_robot("labmate"), "type_iv_line").system
    motion, parameters = vehicle_motion(system), find_robot("labmate").parameter_values({})
    x = np.random.default_rng(1).uniform(-2, 2, len(system.state))
    forward, turn, _ = vehicle_wheels(system, parameters)
    made = runtime("noslip_odometry.h")
    wheels = made.new("noslip_odometry_options", "double", {"forward": list(forward), "turn": list(turn)})
    found = [
        sum(w * rate for w, rate in zip(row, x[-2:], strict=True)) for row in (wheels.forward, wheels.turn)
    ]
    assert found == pytest.approx(motion(x, parameters).full().ravel()[3:5], rel=1e-12)


# -- simulation ----------------------------------------------------------------------------------------------


def test_torque_drives_change_nothing():
    """The same CSV with and without the section, for delays up to a period,
    at which the drives' queue could differ."""
    for more in ("", "delay = 0.01\n", "delay = 0.004\noutput_step = 0.003\n"):
        text = LINE.replace("duration = 3.0", "duration = 0.5") + more
        assert (
            simulate(spec_of(text, "test")).csv()
            == simulate(spec_of(text + '[drive]\nkind = "torque"\n', "test")).csv()
        )


@pytest.mark.parametrize("kind", ["velocity", "velocity+torque"])
def test_backends_agree_and_reach_the_line(kind):
    """The C follows the model, in double and float; behind fast drives the path is the one of torque
    control."""
    text = LINE + VELOCITY.replace('"velocity"', f'"{kind}"')
    model, double, single = (simulate(spec_of(text, "test"), backend) for backend in ("casadi", "c", "cf"))
    assert model.stopped is None and np.abs(model.error[-1]).max() < 0.12 < np.abs(model.error[0]).max()
    assert np.abs(double.x - model.x).max() < 1e-9 and np.abs(single.x - model.x).max() < 1e-3
    assert np.abs(double.command - model.command).max() < 1e-9
    fast = text.replace("bandwidth = 5.0", "bandwidth = 50.0").replace("delay = 0.02", "delay = 0.0")
    by_torque = simulate(spec_of(LINE, "test"))
    assert np.abs(simulate(spec_of(fast, "test")).y - by_torque.y).max() < 0.006
    assert np.abs(model.y - by_torque.y).max() > 0.01


def test_the_drive_is_of_first_order_within_its_acceleration():
    """nudot from the rows is clip(omega (c - nu)) of the columns,
    and the torques are those of the inverse dynamics."""
    text = LINE.replace("duration = 3.0", "duration = 1.0\noutput_step = 0.0025") + VELOCITY.replace(
        "60.0", "4.0"
    )
    run = simulate(spec_of(text, "test"))
    columns, law = run.columns, run.law
    assert columns[-2:] == ["command_thetadot_r", "command_thetadot_l"] and run.command.shape == (
        len(run.t),
        2,
    )
    nudot = np.clip(2 * np.pi * 5 * (run.command - run.nu), -4.0, 4.0)
    caused = np.array([run.plant.rate(x, tau)[-2:] for x, tau in zip(run.x, run.tau, strict=True)])
    assert np.abs(caused - nudot).max() < 1e-9 and np.abs(nudot).max() == 4.0
    inside = np.abs(nudot).max(axis=1) < 3.9
    held = (run.command[1:] == run.command[:-1]).all(axis=1) & inside[1:] & inside[:-1]
    decay = math.exp(-2 * math.pi * 5 * 0.0025)
    gap = run.command - run.nu
    assert held.sum() > 25 and np.abs(gap[1:] - decay * gap[:-1])[held].max() < 1e-8
    assert len(law.system.quasi_velocities) == 2
    assert (run.command[run.t < 0.0199] == run.nu[0]).all() and (
        run.command[run.t > 0.021] != run.nu[0]
    ).any(), "delay"
    assert "velocity drives of 5 Hz" in summary(run) and as_json(run)["drive"]["kind"] == "velocity"


@pytest.mark.nightly
@pytest.mark.parametrize("robot", ["four_wheel", "mobile_manipulator"])
def test_other_robots(robot):
    """More inputs than quasi-velocities, and more than two quasi-velocities:
    the torques cause what the drives do."""
    text = (ROOT / f"examples/specs/robots/{robot}.toml").read_text()
    drive = DriveSection(
        kind="velocity", bandwidth=5.0, delay=0.013, most_speed=(30.0,), most_acceleration=(60.0,)
    )
    spec = spec_of(text, ROOT / f"examples/specs/robots/{robot}.toml")
    simulation = replace(spec.simulation, period=PERIOD, duration=1.0, output_step=PERIOD)
    run = simulate(replace(spec, drive=drive, simulation=simulation))
    nudot = np.clip(2 * np.pi * 5 * (run.command - run.nu), -60.0, 60.0)
    caused = np.array([run.plant.rate(x, tau) for x, tau in zip(run.x, run.tau, strict=True)])[
        :, run.q.shape[1] :
    ]
    assert run.stopped is None and np.abs(caused - nudot).max() < 1e-8 and np.abs(nudot).max() > 0.1


def test_wrong_masses_matter_to_torques_only():
    """A velocity drive sees to the accelerations itself, whatever the controller believes of the masses."""
    heavier = LINE.replace("[output]", "plant = { m_c = 120.0 }\n[output]", 1)
    runs = {
        more: [simulate(spec_of(text + more, "test")).y for text in (LINE, heavier)]
        for more in ("", VELOCITY)
    }
    moved = {more: np.abs(found[0] - found[1]).max() for more, found in runs.items()}
    assert moved[VELOCITY] < 1e-9 and moved[""] > 0.01


@pytest.mark.parametrize(
    "change, said",
    [
        (("bandwidth = 5.0\n", ""), r'kind = "velocity" requires .drive. bandwidth'),
        (("bandwidth = 5.0", "bandwidth = -5.0"), "bandwidth"),
        (("bandwidth = 5.0", "bandwidth = nan"), "bandwidth"),
        (("most_speed = 40.0", "most_speed = 0.0"), "most_speed"),
        (("most_speed = 40.0", "most_speed = []"), "most_speed is empty"),
        (
            ("most_speed = 40.0", "most_speed = [1.0, 2.0, 3.0]"),
            "most_speed has 3 numbers; it must have 1 or 2: thetadot_r",
        ),
        (('"velocity"', '"speed"'), "kind"),
        (('"velocity"', '"torque"'), 'kind = "torque" does not go with .drive. bandwidth'),
        (("delay = 0.02", "delay = -0.02"), "delay"),
        (("delay = 0.02", "latency = 0.02"), "latency"),
        (("period = 0.01", "period = 0.0"), "requires .simulation. period > 0"),
    ],
)
def test_refused_specs(change, said):
    with pytest.raises(BadInput, match=said):
        simulate(spec_of((LINE + VELOCITY).replace(*change), "test"))


SWEPT = {
    "velocity": ("", VELOCITY),
    "velocity+torque, late": (
        "delay = 0.004\n",
        VELOCITY.replace('"velocity"', '"velocity+torque"').replace("0.02", "0.0237"),
    ),
    "kinematic": ("", VELOCITY.replace('"velocity"', '"kinematic"')),
    "kinematic, grip": (
        "",
        VELOCITY.replace('"velocity"', '"kinematic"') + '[limits]\nmode = "grip"\n[contact]\nmu = 0.1\n',
    ),
}


@pytest.mark.parametrize("name", SWEPT)
def test_a_sweep_runs_what_simulate_runs(name):
    """A sample with other bandwidth and limits is the run of its SPEC: states, torques of the drives,
    and status."""
    more, drive = SWEPT[name]
    text = LINE.replace("casadi", "c").replace("duration = 3.0", "duration = 1.0") + more + drive
    batch = Batch(spec_of(text, "test"))
    changed = {"drive.bandwidth": 7.0, "drive.most_acceleration[0]": 4000.0}
    (row,) = batch.table(changed, 1)
    run, trace = simulate(batch.spec_of(row)), batch.trace(row)
    (outcome,) = batch.run(row[None])
    found = dict(zip(batch.outcomes, outcome, strict=True))
    assert batch.status(found["status"]) == run.status[-1] and found["integration_error"] < 1e-6
    assert np.abs(trace["x"] - run.x).max() < 1e-8 and np.abs(trace["tau"] - run.tau).max() < 1e-6
    assert found["effort.tau_r"] == pytest.approx(np.abs(run.tau[:, 0]).max(), rel=1e-6)
    assert np.abs(simulate(spec_of(text, "test")).x - run.x).max() > 1e-4, "bandwidth and limit are used"


def test_what_a_sweep_does_not_have_is_said():
    text = (
        (ROOT / "examples/specs/robots/four_wheel.toml")
        .read_text()
        .replace("[simulation]", "[simulation]\nperiod = 0.01", 1)
    )
    with pytest.raises(BadInput, match="as many inputs as quasi-velocities"):
        Batch(spec_of(text + VELOCITY, "test"))


@pytest.mark.parametrize("kind", ["velocity", "velocity+torque", "kinematic"])
def test_drives_on_a_floor(kind):
    """In MuJoCo, with grip, the run is that of the robot that rolls, within the engine's step; the torques of
    the drives there are those that follow the commands. On ice the wheels follow their commands, and the
    robot does not.
    """
    pytest.importorskip("mujoco")
    text = (
        (LINE + VELOCITY)
        .replace('"velocity"', f'"{kind}"')
        .replace("casadi", "c")
        .replace("duration = 3.0", "duration = 2.0")
    )
    text = text.replace("most_acceleration = 60.0", "most_acceleration = 10.0") + "[contact]\nmu = 3.0\n"
    rolls, floor = simulate(spec_of(text, "test")), simulate(spec_of(text, "test"), engine="mujoco")
    assert (
        floor.stopped is None
        and np.abs(floor.y - rolls.y).max() < 0.01
        and np.abs(floor.command - rolls.command).max() < 0.3
    )
    ice = simulate(spec_of(text + "[floor]\nmu = 0.02\n", "test"), engine="mujoco")
    assert ice.stopped is None and ice.floor.slip.max() > 0.1 > floor.floor.slip.max()
    assert np.abs(ice.nu[-1] - ice.command[-1]).max() < 0.15 * np.abs(ice.command[-1]).max()


# -- outer loop ----------------------------------------------------------------------------------------------

GAINS = {"distance": Gains(2, 1.0, 2.5), "speed": Gains(1, 2.0)}


def report(law: str, drive: DriveLoop | None, gains=GAINS, period=PERIOD) -> OuterLoopReport:
    made = law_of(find_robot("labmate"), law)
    return OuterLoopReport(
        made, default_spec("labmate", made), gains, Loops(period, False, drive), Required(), 0.2
    )


def grown(spec: Spec, kind: str, gains: dict[str, float]) -> float:
    """By what a deviation of 1e-6 m from the steady motion has grown from the second to the third 1.5 s,
    simulated."""
    drive = DriveSection(
        kind=kind, bandwidth=5.0, delay=0.02, most_speed=(100.0,), most_acceleration=(1000.0,)
    )
    simulation = Simulation(duration=4.5, period=PERIOD, output_step=PERIOD, backend="casadi")
    spec = replace(spec, gains=gains, drive=drive, simulation=simulation)
    x = steady_motion(setting_of(spec)).state
    x[0] += 1e-6
    n = len(find_robot("labmate").coordinates)
    run = simulate(replace(spec, initial=Initial(q=tuple(x[:n]), nu=tuple(x[n:]))))
    error, third = np.abs(run.error[:, 0]), round(1.5 / PERIOD)
    return error[2 * third :].max() / error[third : 2 * third].max()


@pytest.mark.parametrize("law, kind", [("type_iv_line", "velocity"), ("type_iv_circle", "velocity+torque")])
def test_the_stability_limit_is_that_of_the_simulation(law, kind):
    """Behind 5 Hz and 20 ms: stable at 0.98, unstable at 1.02 of the predicted factor. Without the delay the
    prediction would be wrong by much more than that: the check would find it.
    """
    found = report(law, DriveLoop(10 * math.pi, 0.02, kind == "velocity+torque"))
    assert found.fastest < min(channel.fastest() for channel in found.channels.values())

    def at(factor: float) -> dict[str, float]:
        return {
            name: value
            for row, gains in GAINS.items()
            for name, value in gains.faster(factor).named(row).items()
        }

    assert (
        grown(found.spec, kind, at(0.98 * found.fastest)) < 0.95
        and grown(found.spec, kind, at(1.02 * found.fastest)) > 1.05
    )
    assert report(law, DriveLoop(10 * math.pi, 0.0, kind == "velocity+torque")).fastest > 1.1 * found.fastest


@pytest.mark.parametrize("kind", ["velocity", "velocity+torque"])
def test_the_speed_rises_as_python_control_says(kind):
    """A step of the speed along the line. The sampled channel predicts each row; a transfer function of
    continuous time with a Padé approximation of the delay, written here, predicts the rise time within 2 %.
    """
    kv, period, law = 6.0, 0.004, law_of(find_robot("labmate"), "type_iv_line")
    drive = DriveSection(
        kind=kind, bandwidth=5.0, delay=0.02, most_speed=(100.0,), most_acceleration=(1000.0,)
    )
    spec = default_spec("labmate", law)
    assert spec.initial
    spec = replace(
        spec,
        gains={"kv_speed": kv},
        drive=drive,
        initial=replace(spec.initial, speed=0.5),
        simulation=Simulation(duration=1.2, period=period, output_step=period, backend="casadi"),
    )
    run = simulate(spec)
    risen = 2 * (run.y[:, 1] - 0.5)
    loop = DriveLoop(drive.omega, drive.delay, drive.feeds)
    channel = Channel("speed", "m/s", Gains(1, kv), period, drive=loop)
    predicted = control.step_response(channel.closed(), run.t, squeeze=False).outputs[0, 0]
    assert np.abs(predicted - risen).max() < 1e-8
    lag = control.tf([1.0], [1.0]) if drive.feeds else control.tf([1.0], [1 / loop.omega, 1.0])
    late = control.tf(*control.pade(0.02, 8))
    t = np.linspace(0, 1.2, 4000)
    wanted = control.step_response(
        control.feedback(kv * control.tf([1.0], [1.0, 0.0]) * lag * late), t
    ).outputs

    def rise(t: np.ndarray, y: np.ndarray) -> float:
        up = np.argmax(y)
        return float(np.interp(0.9, y[: up + 1], t[: up + 1]) - np.interp(0.1, y[: up + 1], t[: up + 1]))

    assert abs(rise(run.t, risen) / rise(t, wanted) - 1) < 0.02
    wrong = control.step_response(control.feedback(kv * control.tf([1.0], [1.0, 0.0])), t).outputs
    assert rise(run.t, risen) != pytest.approx(rise(t, wrong), rel=0.1), "an ideal drive would pass too"


def test_sampled_late_is_the_exact_motion():
    """Against the motion integrated piece by piece, over random delays of up to 4 periods, whole ones too."""
    random = np.random.default_rng(5)
    for delay in (0.0, PERIOD, 3 * PERIOD, *random.uniform(0, 4 * PERIOD, 6)):
        F, G, J = random.normal(0, 20, (3, 3)), random.normal(0, 5, (3, 2)), random.normal(0, 1, (3, 2))
        A, B = sampled_late(F, G, J, PERIOD, delay)
        inputs, state = random.normal(0, 1, (9, 2)), np.zeros(len(A))
        for w in inputs:
            state = A @ state + B @ w
        x, fine = np.zeros(3), 1500
        at = [round((k * PERIOD + delay) / PERIOD * fine) for k in range(len(inputs))]
        h, held, k = PERIOD / fine, np.zeros(2), 0
        for step in range(len(inputs) * fine):
            if k < len(at) and step == at[k]:
                held, x, k = inputs[k], x + J @ inputs[k], k + 1
            middle = x + h / 2 * (F @ x + G @ held)
            x = x + h * (F @ middle + G @ held)
        if k < len(at) and at[k] == len(inputs) * fine:  # it begins to act at the last instant
            x = x + J @ inputs[k]
        scale = np.abs(x).max()
        assert np.abs(state[:3] - x).max() < 0.002 * scale, delay  # by steps of a 1500th of a period
    assert whole_periods(0.0, 0.01) == (0, 0.0) and whole_periods(0.01, 0.01) == (0, 0.01)
    assert whole_periods(0.025, 0.01) == (2, pytest.approx(0.005)) and whole_periods(0.03, 0.01) == (
        2,
        pytest.approx(0.01),
    )


def test_fast_drives_are_none():
    """Limits: a fed drive without bandwidth is the loop of torques,
    and a fast drive is the continuous loop."""
    law = law_of(find_robot("labmate"), "type_iv_circle")
    setting = setting_of(default_spec("labmate", law))
    by_torque = steady_motion(setting).eigenvalues(PERIOD)
    fed = steady_motion(replace(setting, drive=DriveLoop(1e-6, 0.0, True))).eigenvalues(PERIOD)
    for each in by_torque:  # with a loop of no bandwidth only the torque acts
        assert np.abs(fed - each).min() < 1e-6
    ideal = steady_motion(replace(setting, drive=DriveLoop(2e5))).eigenvalues(PERIOD / 10)
    continuous = np.exp(PERIOD / 10 * steady_motion(setting).eigenvalues())
    for each in continuous:  # within the time constant of the drive
        assert np.abs(ideal - each).min() < 0.0005


@pytest.mark.nightly
def test_report():
    """The whole report, as text and as JSON; errors of masses and inertias change nothing behind velocity
    drives."""
    found = report("type_iv_line", DriveLoop(10 * math.pi, 0.02))
    text, values = found.text(), found.as_json()
    assert (
        f"poles up to {found.fastest:.4g} times as fast" in text
        and "velocity drives of 5 Hz, delay 0.02 s" in text
    )
    assert values["whole"]["fastest"] == found.fastest and set(values["whole"]["margins"]) == {
        "u_thetadot_r",
        "u_thetadot_l",
    }
    assert values["drive"] == {"omega": 10 * math.pi, "delay": 0.02, "feeds": False, "kinematic": False}
    none = {harm.name: harm for harm in found.ranking}
    for name in ("m_c", "m_w", "I_c", "I_w", "I_m"):
        assert none[name].loss == pytest.approx(0.0, abs=1e-6) and abs(none[name].offset) < 1e-9
    fed = {harm.name: harm for harm in report("type_iv_line", DriveLoop(10 * math.pi, 0.02, True)).ranking}
    assert max(fed[name].loss for name in ("m_c", "I_c")) > 1e-3


def test_command_line(tmp_path, bad_input):
    given = ["outer-loop", "labmate", "--output", "type_iv_line", "--period", "0.01"]
    fast = [*given, "--settling", "0.2", "--drive", "velocity", "--bandwidth", "5", "--drive-delay", "0.02"]
    said = bad_input(fast)
    assert (
        "behind velocity drives of 5 Hz, delay 0.02 s, is beyond stability" in said
        and "times as fast" in said
    )
    assert "requires --drive" in bad_input([*given, "--bandwidth", "5"])
    assert "requires --bandwidth" in bad_input([*given, "--drive", "velocity"])
    assert "require a period" in bad_input([*given[:4], "--drive", "velocity", "--bandwidth", "5"])
    assert "must be positive" in bad_input([*given, "--drive", "velocity", "--bandwidth", "0"])
    assert "must be positive" in bad_input(
        [*given, "--drive", "velocity", "--bandwidth", "5", "--drive-delay", "-1"]
    )
    spec = tmp_path / "line.toml"
    spec.write_text(LINE + VELOCITY)
    of_spec = ["outer-loop", "labmate", "--spec", str(spec), "--period", "0.01", "--settling", "0.2"]
    assert bad_input(of_spec) == said
    assert "behind velocity drives of 50 Hz, delay 0.02 s" in bad_input([*of_spec, "--bandwidth", "50"])
