"""The follower: one struct from encoders to commands, beside its parts,
and what each of its functions promises."""

import math
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from noslip.checks.guarantees.vehicle import (
    HOLD,
    PERIOD,
    ROOT,
    RUN,
    STOP,
    Firmware,
    FirmwareLoop,
    SettingsRefused,
)
from noslip.codegen.files import has_follower, robot_files
from noslip.codegen.follower.follower import LAW, _has_wheels, why_no_follower
from noslip.codegen.runtime import RUNTIME, runtime_files
from noslip.readers.files import write_folder
from noslip.readers.robots import find_robot, law_of, system_of
from noslip.tests.tools import COMPILERS, HOST_CC

FLAGS = (
    "-std=c99 -O2 -pedantic -Wall -Wextra -Wconversion -Wsign-conversion -Wfloat-conversion "
    "-Wfloat-equal -Wshadow -Werror"
)
STRICT = [
    *FLAGS.split(),
    "-Wdouble-promotion",
    "-Wundef",
    "-Wcast-qual",
    "-Wstrict-prototypes",
    "-Wmissing-prototypes",
    "-Wvla",
]
INCLUDE = [f"-I{RUNTIME}", f"-I{ROOT / 'generated/labmate'}"]
SCALARS = {"float": "_f", "double": ""}


@pytest.fixture(scope="module")
def c(tmp_path_factory) -> Firmware:
    return Firmware(tmp_path_factory.mktemp("headers"))


def laps(
    folder: Path, scalar: str, ticks: int, speed: float, planted: tuple[str, str] = ("", "")
) -> list[list[float]]:
    """The numbers that tests/c/follower_laps.c prints for torque and for velocity drives;
    `planted` changes the follower."""
    suffix, generated = SCALARS[scalar], ROOT / "generated/labmate"
    names = [f"labmate{part}{suffix}" for part in ("", "_dynamics", "_type_iv_segment")]
    (folder / "follower.c").write_text(
        (generated / f"labmate_follower{suffix}.c").read_text().replace(*planted)
    )
    sources = [generated / f"{name}.c" for name in names] + [
        RUNTIME / f"noslip_path{suffix}.c",
        folder / "follower.c",
    ]
    sources += [RUNTIME / f"noslip_{name}.c" for name in ("status", "watchdog")]
    defines = {
        "REAL": scalar,
        "SUFFIX": suffix,
        "HEADER": f'"labmate_follower{suffix}.h"',
        "TICKS": ticks,
        "SPEED": speed,
    }
    flags = [
        "-std=c99",
        "-O2",
        "-ffp-contract=off",
        *INCLUDE,
        *(f"-D{name}={value}" for name, value in defines.items()),
    ]
    program = folder / "laps"
    subprocess.run(
        [HOST_CC, *flags, ROOT / "tests/c/follower_laps.c", *sources, "-lm", "-o", program], check=True
    )
    printed = subprocess.run([program], capture_output=True, text=True, check=True).stdout
    return [[float(number) for number in line.split()] for line in printed.splitlines()]


@pytest.mark.parametrize("scalar", SCALARS)
def test_commands_are_those_of_the_parts(tmp_path, scalar):
    """10 minutes of laps: each bit of command and pose is that of the loop assembled from the parts;
    no tick is refused."""
    for refused, different, astray, error in laps(tmp_path, scalar, 60_000, 1.0):
        assert (
            (refused, different) == (0, 0) and astray < 0.04 and error < (1e-3 if scalar == "float" else 1e-9)
        )


@pytest.mark.nightly
def test_another_law_shows_in_the_bits(tmp_path):
    planted = ("self->reference.speed = guide", "self->reference.speed = (1.0f + FLT_EPSILON) * guide")
    assert all(different > 20 for _, different, *_ in laps(tmp_path, "float", 2000, 1.0, planted))


@pytest.mark.nightly
def test_a_day_of_laps(tmp_path):
    """24 h at 100 Hz in float, 43 and 86 km: nothing is refused,
    and rounding moves the pose by 10 mm at most."""
    for speed in (0.5, 1.0):
        for refused, different, _, error in laps(tmp_path, "float", 8_640_000, speed):
            assert (refused, different) == (0, 0) and error < 0.010


def test_page(tmp_path):
    """The program of docs/firmware.md compiles without a warning."""
    page = (ROOT / "docs/firmware.md").read_text()
    (block,) = re.findall(r"tests/codegen/test_follower.py -->\n```c\n(.*?)^```", page, re.S | re.M)
    body = block.split("int main(void)\n{\n", 1)[1].rsplit("\n}", 1)[0].splitlines()
    assert len(body) <= 12
    (tmp_path / "main.c").write_text(block)
    (tmp_path / "board.h").write_text(
        '#include <stdint.h>\n#include "noslip_path.h"\nuint32_t board_wait(void);\nvoid board_read(uint32_t '
        "*counts);\n"
        "void board_drive(const float *command);\nextern const noslip_segment_f path[3];\n"
    )
    command = [
        HOST_CC,
        *STRICT,
        f"-I{tmp_path}",
        *INCLUDE,
        "-c",
        tmp_path / "main.c",
        "-o",
        tmp_path / "main.o",
    ]
    subprocess.run([each for each in command if each != "-Wmissing-prototypes"], check=True)


def test_followers_are_there_for_two_wheels():
    names = ("labmate", "turtlebot3_burger", "car", "four_wheel", "knife_edge", "rolling_disk")
    assert [name for name in names if _has_wheels(system_of(find_robot(name)))] == [
        *("labmate", "turtlebot3_burger"),
        "car",  # a wheel that rolls and a steered one: tests/codegen/test_steered_follower.py
        "rolling_disk",  # rolled and turned
    ]
    trailer = system_of(find_robot("tractor_trailer:1"))
    assert not has_follower(law_of(trailer, LAW)) and "depends on phi_1" in why_no_follower(trailer)
    assert has_follower(law_of(system_of(find_robot("labmate")), LAW))
    assert not has_follower(law_of(system_of(find_robot("labmate")), "type_i"))


@pytest.mark.nightly
@pytest.mark.parametrize("scalar", SCALARS)
@pytest.mark.parametrize("robot", ["turtlebot3_burger", "car", "forklift"])
def test_follower_of_another_robot_compiles(tmp_path, robot, scalar):
    """As strictly as that of the LABMATE."""
    system = system_of(find_robot(robot))
    files = {**runtime_files(), **robot_files(system, [law_of(system, LAW)], (scalar,))}
    write_folder(tmp_path / "c", files)
    source = tmp_path / f"c/{robot}_follower{SCALARS[scalar]}.c"
    flags = [flag for flag in STRICT if flag != "-Wdouble-promotion"] if scalar == "double" else STRICT
    for compiler in COMPILERS:
        subprocess.run(
            [compiler, *flags, f"-I{tmp_path / 'c'}", "-c", source, "-o", tmp_path / "o"], check=True
        )


def test_command_line(tmp_path, bad_input):
    from noslip.cli.main import main

    assert (
        main(["export", "labmate", "--output", "follower", "--scalar", "float", "-o", str(tmp_path / "c")])
        == 0
    )
    assert {"labmate_follower_f.c", "labmate_dynamics_f.c", "noslip_watchdog.c"} <= {
        p.name for p in (tmp_path / "c").iterdir()
    }
    assert "two driven wheels" in bad_input(
        ["generate", "four_wheel", "--output", "follower", "-o", str(tmp_path / "d")]
    )


HARNESS = """
#include <stdio.h>
#include <stdlib.h>
#include "labmate_follower_f.h"
int control_loop(void);
uint32_t wait_for_tick(void);
void read_counters(uint32_t counts[2]);
void set_commands(const float command[2]);
static double rate[2], angle[2], most;
static int ticks;
uint32_t wait_for_tick(void) { return 0; }
void read_counters(uint32_t counts[2])
{
    int i;
    for (i = 0; i < 2; i++) {
        angle[i] += 0.01 * rate[i];
        counts[i] = (uint32_t)(int64_t)(angle[i] / 6.283185307179586 * 40000) & 0xffff;
    }
}
void set_commands(const float command[2])
{
    int i;
    for (i = 0; i < 2; i++) {
        rate[i] += 0.01 * (double)command[i] / 0.4;
        most = (double)command[i] > most ? (double)command[i] : most;
    }
    if (++ticks == 1500) {
        printf("%.3f %.3f %.3f\\n", 0.075 * (angle[0] + angle[1]), 0.075 * (rate[0] + rate[1]), most);
        exit(0);
    }
}
int main(void) { return control_loop(); }
"""


def test_exported_project_drives(tmp_path):
    """Its own commands build it without a warning and pass its test. Its loop, with a timer, counters and
    wheels, stands at the end of the path, 5 m ahead of where the vehicle's point was, P_l being 0.25 m ahead
    of that.
    """
    from noslip.cli.main import main

    folder = tmp_path / "project"
    assert (
        main(["export", "labmate", "--output", "follower", "--firmware", "generic", "-o", str(folder)]) == 0
    )
    commands = re.findall(r"^make(?: \w+)?(?= +#)", (folder / "README.md").read_text(), re.M)
    assert commands[:2] == ["make", "make test"]
    for command in commands[:2]:
        done = subprocess.run(command.split(), cwd=folder, capture_output=True, text=True, check=True)
        assert "warning" not in done.stderr + done.stdout
    (tmp_path / "main.c").write_text(HARNESS)
    objects = [folder / "loop.o", folder / "vehicle.c", folder / "liblabmate.a"]
    program = [tmp_path / "main.c", *objects, "-o", tmp_path / "run"]
    subprocess.run([HOST_CC, "-std=c99", f"-I{folder / 'noslip'}", f"-I{folder}", *program], check=True)
    way, speed, most = map(
        float, subprocess.run([tmp_path / "run"], capture_output=True, check=True).stdout.split()
    )
    assert abs(way - 4.75) < 0.1 and abs(speed) < 0.02 and most == 1.0


# -- config --------------------------------------------------------------------------------------------------


def test_zeros_are_refused_or_safe(c):
    """A torque without any limit is refused; with a motor's model its own is one."""
    driver = {"motors__0__mode": 0, "motors__1__mode": 0}
    no_limit = {"limits__limit__0": 0.0, "limits__limit__1": 0.0}
    for changes in (
        {**driver, **no_limit},
        {**driver, "limits__limit__1": 0.0},
        {"motors__1__mode": 0, "limits__limit__1": 0.0},
    ):
        with pytest.raises(SettingsRefused, match="bad_parameter"):
            FirmwareLoop(c, **changes)
    FirmwareLoop(c, **driver, limits__limit__0=0.5, limits__limit__1=0.5)  # any positive one will do
    loop = FirmwareLoop(c, **no_limit)
    assert loop.tick() >= 0
    motor = loop.settings.motors[0]
    standing = motor.current * motor.torque_constant * motor.gear * motor.efficiency  # N m
    assert list(loop.vehicle.law.limit) == pytest.approx([standing] * 2, rel=1e-6)


@pytest.mark.parametrize(
    "motor, supply, least, most", [(0, 12.5, 5, 1500), (1, 12.5, 5, 1500), (0, 24.0, 0, 0)]
)
def test_one_motor_that_cannot_is_said(c, motor, supply, least, most):
    """A supply that one motor's back EMF exceeds: the tick is saturated where the law is within its limits,
    too."""
    loop, alone = FirmwareLoop(c, **{f"motors__{motor}__supply": supply}), 0
    for _ in range(1500):
        status = loop.tick()
        alone += status == c.lib.NOSLIP_SATURATED and loop.vehicle.last == c.lib.NOSLIP_OK
    assert least <= alone <= most


def test_counters_wide_enough_are_taken(c):
    """Half the range, 0.643 rad, must be more than what a wheel turns in the ticks tolerated and one more,
    at most."""
    narrow = {
        "counter_bits": 13,
        "counts_per_turn__0": 40000.0,
        "counts_per_turn__1": -40000.0,
        "watchdog__tolerated": 3,
    }
    assert c.vehicle(FirmwareLoop(c, **narrow, fastest=15.0).settings).ready  # 4 ticks: 0.6 rad
    with pytest.raises(SettingsRefused, match="bad_parameter"):
        FirmwareLoop(c, **narrow, fastest=17.0)


def velocity_loop(c, **changes) -> FirmwareLoop:
    """The vehicle with velocity drives."""
    wheel = {"speed": 20.0, "acceleration": 15.0, "band": 2.0}
    rows = {f"velocity__{k}__{name}": value for k in range(2) for name, value in wheel.items()}
    return FirmwareLoop(c, drive=1, **rows, **changes)


def test_velocity_drives_stop_together(c):
    """After an error the wheels slow down in proportion, with the largest acceleration;
    the twist is that of the commands."""
    loop = velocity_loop(c)
    counts, command, twist = c.ffi.new("float[2]"), loop.command, c.ffi.new("float[2]")
    for _ in range(300):  # drives that follow at once
        counts[0], counts[1] = command[0] * PERIOD, command[1] * PERIOD
        assert c.lib.labmate_follower_tick_angles_f(loop.vehicle, counts, PERIOD, command) >= 0
    assert loop.vehicle.speed == pytest.approx(1.0, abs=0.02)
    r, b = loop.settings.params.r, loop.settings.params.b
    assert c.lib.labmate_follower_twist_f(loop.vehicle, twist) == 0
    expected = [r * (command[0] + command[1]) / 2, r * (command[0] - command[1]) / (2 * b)]
    assert list(twist) == pytest.approx(expected, rel=1e-5, abs=1e-6)
    ratio, last = command[1] / command[0], command[0]
    ticks = 0
    while command[0] != 0:
        status = c.lib.labmate_follower_tick_angles_f(loop.vehicle, counts, math.nan, command)
        assert status < 0 and abs(command[1] - ratio * command[0]) < 1e-5
        assert max(abs(command[0] - last), 0.0) <= 15.0 * PERIOD * (1 + 1e-5)
        last, ticks = command[0], ticks + 1
        assert ticks < 100
    assert loop.state == STOP
    counts[0] = counts[1] = 2.0 * PERIOD
    for _ in range(100):  # somebody pushes it
        assert c.lib.labmate_follower_tick_angles_f(loop.vehicle, counts, PERIOD, command) < 0 and list(
            command
        ) == [0, 0]
    assert c.lib.labmate_follower_reset_f(loop.vehicle) == 0
    assert c.lib.labmate_follower_tick_angles_f(loop.vehicle, counts, PERIOD, command) >= 0
    assert abs(command[0] - 2.0) <= 15.0 * PERIOD * 1.01, "it goes on as fast as it rolls"
    assert c.lib.labmate_follower_twist_f(FirmwareLoop(c).vehicle, twist) == c.lib.NOSLIP_NOT_READY and list(
        twist
    ) == [0, 0]


def test_velocity_drives_say_what_the_law_says(c):
    """The torques of the law are limited, and so are the accelerations of the commands."""
    loop = velocity_loop(c, limits__limit__0=0.5, limits__limit__1=0.5)
    turned, command = c.ffi.new("float[2]"), loop.command
    assert (
        c.lib.labmate_follower_tick_angles_f(loop.vehicle, turned, PERIOD, command) == c.lib.NOSLIP_SATURATED
    )
    assert 0 < command[0] < 0.5 * 15.0 * PERIOD


def test_velocity_drives_keep_grip(c):
    """With `along` and `lateral` the commanded motion stays within them, on arcs too;
    one without the other is refused."""
    loop = velocity_loop(c, along=0.3, lateral=0.35)
    turned, command, twist, before = c.ffi.new("float[2]"), loop.command, c.ffi.new("float[2]"), 0.0
    statuses = set()
    for _ in range(1500):
        turned[0], turned[1] = command[0] * PERIOD, command[1] * PERIOD
        statuses.add(c.lib.labmate_follower_tick_angles_f(loop.vehicle, turned, PERIOD, command))
        assert c.lib.labmate_follower_twist_f(loop.vehicle, twist) == 0
        assert abs(twist[0] - before) <= 0.3 * PERIOD * (1 + 1e-4) + 1e-6 and abs(
            twist[0] * twist[1]
        ) <= 0.35 * (1 + 1e-4)
        before = twist[0]
    assert c.lib.NOSLIP_GRIP_LIMITED in statuses and min(statuses) >= 0
    for bad in ((0.3, 0.0), (0.0, 0.3), (-1.0, 0.3), (math.nan, 0.3), (0.3, math.inf)):
        with pytest.raises(SettingsRefused, match="bad_parameter"):
            velocity_loop(c, along=bad[0], lateral=bad[1])


def test_angles_are_counts(c):
    """Ticks by angles give the commands of ticks by the counts, within rounding, over missed ticks too."""
    by_counts, other = FirmwareLoop(c), c.vehicle(c.settings())
    turned, command, before = c.ffi.new("float[2]"), c.ffi.new("float[2]"), np.zeros(2)
    for k in range(400):
        missed = 2 if k % 150 == 149 else 0
        status = by_counts.tick(missed=missed)
        now = np.array(
            [c.lib.counter[i] - (2**32 if c.lib.counter[i] >= 2**31 else 0) for i in range(2)], float
        )
        for i in range(2):
            turned[i] = (now - before)[i] * 2 * math.pi / by_counts.settings.counts_per_turn[i]
        before = now
        assert c.lib.labmate_follower_tick_angles_f(other, turned, PERIOD * (1 + missed), command) == status
        assert list(command) == pytest.approx(list(by_counts.command), abs=2e-3)
    assert other.watchdog.strikes == by_counts.vehicle.watchdog.strikes > 0
    once = c.vehicle(c.settings())
    assert (
        c.lib.labmate_follower_tick_angles_f(once, turned, 0.0, command) == c.lib.NOSLIP_RANGE
        and once.watchdog.strikes == 1
    )
    for dt in (0.0, -PERIOD, math.inf, 1e9 * PERIOD):
        assert c.lib.labmate_follower_tick_angles_f(other, turned, dt, command) == c.lib.NOSLIP_RANGE


def test_an_impossible_angle_that_stays_is_never_followed(c):
    """A counter 2 rad off, or a drive that reports 2 rad at each tick, where 0.2 rad are possible:
    no wheel moves by it."""
    off = round(2 / (2 * math.pi) * 40000)

    def misread(counts):
        counts[0] = (counts[0] + off) % 2**16

    loop = FirmwareLoop(c, watchdog__tolerated=3, fastest=20.0)
    by_angles, turned = c.vehicle(loop.settings), c.ffi.new("float[2]", [2.0, 0.0])
    command = c.ffi.new("float[2]")
    for _ in range(100):
        assert loop.tick() >= 0
    before = loop.pose()
    assert [loop.tick(misread) for _ in range(6)] == [c.lib.NOSLIP_RANGE] * 6 and list(loop.command) == [0, 0]
    assert np.abs(loop.pose() - before).max() < 0.02 and loop.state == STOP
    for _ in range(6):
        assert c.lib.labmate_follower_tick_angles_f(by_angles, turned, PERIOD, command) == c.lib.NOSLIP_RANGE
    assert (
        list(command) == [0, 0]
        and by_angles.watchdog.state == STOP
        and by_angles.odometry.pose.x == loop.settings.start.x
    )


def test_far_from_its_path_it_stops(c):
    """A wheel whose encoder counts backwards leads away from the path: astray, or a rate that cannot be."""
    loop = FirmwareLoop(c, counts_per_turn__0=-40000.0)
    for _ in range(3000):
        status = loop.tick()
        if loop.state == STOP:
            break
    assert loop.state == STOP and status < 0 and list(loop.command) == [0, 0]
    beside = FirmwareLoop(c, start__y=0.6)
    assert beside.tick() == c.lib.NOSLIP_ASTRAY and beside.state == STOP


def test_an_approach_is_bounded(c):
    """The desired distance begins where the vehicle is, and its acceleration is bounded;
    it begins again after a correction."""
    loop = FirmwareLoop(c, start__y=0.4, approach=0.2, settling=0.5)
    rows = []
    for _ in range(500):
        assert loop.tick() >= 0
        reference = loop.vehicle.reference
        rows.append(
            (reference.distance, reference.distance_acceleration, loop.vehicle.path.guide.foot.distance)
        )
    distance, acceleration, seen = np.array(rows).T
    assert distance[0] == pytest.approx(0.4, abs=1e-3) and abs(distance[-1]) < 0.02
    assert np.abs(acceleration).max() == pytest.approx(0.2, rel=1e-5)
    assert np.abs(distance - seen).max() > 1e-4, "nor does it begin again each tick"
    pose = loop.vehicle.odometry.pose
    truth = c.new("noslip_pose_f", {"x": pose.x, "y": pose.y + 0.2, "heading": pose.heading})
    assert c.lib.labmate_follower_correct_f(loop.vehicle, truth, c.lib.NOSLIP_RESET) == 0
    assert loop.tick() >= 0 and loop.vehicle.reference.distance == pytest.approx(
        loop.vehicle.path.guide.foot.distance, abs=1e-6
    )


def test_parameters_left_out_are_those_of_the_model(c):
    """Zeros: the defaults; one that is missing among others is still an error."""
    settings = c.settings()
    parameters = {name: getattr(settings.params, name) for name, _ in c.ffi.typeof("labmate_params_f").fields}
    settings.params = dict.fromkeys(parameters, 0.0)
    vehicle = c.vehicle(settings)
    assert {name: getattr(vehicle.params, name) for name in parameters} == parameters
    settings.params = parameters | {"m_c": 0.0}
    with pytest.raises(SettingsRefused, match="bad_parameter"):
        c.vehicle(settings)


def test_path_and_law_have_the_same_point(c):
    """The path's own `ahead` is that of the parameters, or left out."""
    settings = c.settings()
    settings.path.ahead = settings.params.d
    assert c.vehicle(settings).ready
    settings.path.ahead = -settings.params.d
    with pytest.raises(SettingsRefused, match="bad_parameter"):
        c.vehicle(settings)


def test_what_is_not_driven_need_not_be_there(c):
    """A path without a segment in reverse does not need the L of that direction,
    which would be singular here."""
    line = c.ffi.new("noslip_segment_f[1]", [{"length": 5.0}])
    loop = FirmwareLoop(c, segments=line, count=1, path__L__1=-c.settings().params.d)
    assert loop.tick() >= 0
    both = {"params__d": 0.0, "path__L__0": 0.3}
    assert FirmwareLoop(c, **both, path__L__1=-0.2).tick() >= 0
    # a path in reverse needs the law of that direction, too
    with pytest.raises(SettingsRefused, match="singular"):
        FirmwareLoop(c, **both, path__L__1=-1e-38)


def test_integral_action_removes_a_steady_error(c):
    """A friction that the config does not know, of one wheel more than of the other:
    distance and speed stay off without ki."""
    unknown = {"motors__0__friction": 0.0, "segments": None, "count": 1}
    line = c.ffi.new("noslip_segment_f[1]", [{"length": 60.0}])
    unknown["segments"] = line
    errors = {}
    for name, ki in (("without", (0.0, 0.0)), ("with", (1.0, 1.0))):
        loop = FirmwareLoop(c, **unknown, ki__0=ki[0], ki__1=ki[1], ki_limit__0=3.0, ki_limit__1=3.0)
        for _ in range(3000):
            assert loop.tick() >= 0
        guide = loop.vehicle.path.guide
        errors[name] = abs(guide.foot.distance), abs(guide.speed - loop.vehicle.speed)
    assert errors["without"][0] > 0.005 and errors["without"][1] > 0.01
    assert errors["with"][0] < 0.2 * errors["without"][0] and errors["with"][1] < 0.2 * errors["without"][1]
    for bad in ((2.6, 0.0), (-1.0, 0.0), (0.0, -1.0), (math.nan, 0.0), (0.0, math.inf)):  # kp kd = 2.5
        with pytest.raises(SettingsRefused, match="bad_parameter"):
            FirmwareLoop(c, ki__0=bad[0], ki__1=bad[1])


# -- between ticks -------------------------------------------------------------------------------------------


def test_update_is_an_init_that_forgets_nothing(c):
    """With the same values nothing changes; new ones give the law that init gives;
    a bad one changes nothing at all."""
    loop, lib = FirmwareLoop(c), c.lib
    for _ in range(300):
        loop.tick()
    vehicle, null = loop.vehicle, c.ffi.NULL
    spare = slice(
        c.ffi.offsetof("labmate_follower_f", "next"), c.ffi.offsetof("labmate_follower_f", "dynamics")
    )

    def whole() -> bytes:
        data = bytearray(c.ffi.buffer(vehicle))
        data[spare] = bytes(spare.stop - spare.start)
        return bytes(data)

    assert loop.state in (RUN, HOLD) and max(map(abs, vehicle.law.held)) > 0
    before = whole()
    params, gains, limits = (
        c.new("labmate_params_f"),
        c.new("labmate_type_iv_segment_gains_f"),
        c.new("labmate_options_f"),
    )
    for place, name, value in (
        *((params, name, bad) for name in ("m_c", "r", "b") for bad in (0.0, -1.0, math.nan)),
        *((params, "d", bad) for bad in (0.0, 0.31, math.nan)),  # 0.31: the pose is that of another point
        *((gains, "kv_speed", bad) for bad in (0.0, -1.0, math.inf)),
        *((limits, "on_limit", bad) for bad in (3, -1)),
    ):
        params[0], gains[0], limits[0] = vehicle.params, vehicle.gains, vehicle.limits
        setattr(place, name, value)
        assert lib.labmate_follower_update_f(vehicle, params, gains, limits) < 0 and whole() == before, (
            name,
            value,
        )
    assert lib.labmate_follower_update_f(vehicle, null, null, null) == 0
    held = list(vehicle.law.held)
    params[0], gains[0], limits[0] = vehicle.params, vehicle.gains, vehicle.limits
    params.m_c, params.r, gains.kv_speed, limits.limit = 45.0, 0.151, 1.5, [15.0, 15.0]
    assert lib.labmate_follower_update_f(vehicle, params, gains, limits) == 0
    law = c.new("labmate_type_iv_segment_f")
    assert lib.labmate_type_iv_segment_init_f(law, params, c.ffi.addressof(vehicle.place), gains, limits) == 0
    assert list(vehicle.law.held) == held
    law.held = held
    assert bytes(c.ffi.buffer(law)) == bytes(c.ffi.buffer(c.ffi.addressof(vehicle.law)))
    assert vehicle.odometry.options.forward[0] == np.float32(0.151) / 2 and loop.tick() >= 0
    assert lib.labmate_follower_update_f(null, null, null, null) == lib.NOSLIP_NULL
    assert (
        lib.labmate_follower_update_f(c.new("labmate_follower_f"), null, null, null) == lib.NOSLIP_NOT_READY
    )


def test_laws_are_limited_and_updated_between_steps(c):
    """set_limits holds at once, for held torques too; update takes constants and keeps what is held within
    the new limits."""
    lib, vehicle = c.lib, c.vehicle(c.settings())
    law, params, gains = c.ffi.addressof(vehicle.law), vehicle.params, vehicle.gains
    for bad in ([-1.0, 5.0], [5.0, math.nan], [math.inf, 5.0]):
        assert lib.labmate_type_iv_segment_set_limits_f(law, bad) == lib.NOSLIP_BAD_PARAMETER
    law.held = [9.0, -8.0]
    assert lib.labmate_type_iv_segment_set_limits_f(law, [5.0, 0.0]) == 0
    assert list(law.held) == [5.0, -8.0] and list(law.limit) == [5.0, np.finfo(np.float32).max] == list(
        law.clear
    )
    fresh, null = c.new("labmate_type_iv_segment_f"), c.ffi.NULL
    update = lib.labmate_type_iv_segment_update_f
    assert update(law, fresh) == update(fresh, law) == lib.NOSLIP_NOT_READY
    assert lib.labmate_type_iv_segment_set_limits_f(fresh, [1.0, 1.0]) == lib.NOSLIP_NOT_READY
    assert update(null, law) == update(law, null) == lib.NOSLIP_NULL
    options = c.new("labmate_options_f", {"limit": [3.0, 30.0]})
    place = c.ffi.addressof(vehicle.place)
    assert (
        lib.labmate_type_iv_segment_init_f(
            fresh, c.ffi.addressof(params), place, c.ffi.addressof(gains), options
        )
        == 0
    )
    assert update(law, fresh) == 0 and list(law.held) == [3.0, -8.0]
