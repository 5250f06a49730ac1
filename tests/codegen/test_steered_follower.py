"""The follower of vehicles with a steered wheel, beside `noslip simulate` on the same SPEC,
and what it refuses."""

import json
import math
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from noslip.analysis.identification.dynamics import Dynamics, pose_names
from noslip.cli.main import main
from noslip.model import Mechanism, reduce
from noslip.model.robots import ROBOTS
from noslip.model.vehicle import steered_axle
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot, system_of
from noslip.simulation.closed_loop import simulate
from noslip.simulation.controllers.runtime import runtime
from noslip.simulation.plant import Plant
from noslip.simulation.specification.spec import read_spec
from noslip.simulation.telemetry.vehicle import follower_in_c

SUFFIX = {"double": "", "float": "_f"}
COUNTS, STRAIGHT = 400_000, 1000
GAINS = {"kp_distance": 0.25, "kd_distance": 1.0, "kv_speed": 0.5}
START = (-3.6, 0.5, 0.0)  # of the rear axle
SPEED, TURN = 2.0, math.pi / 2
SPEC = """
robot = "car"
gains = {{ kp = 0.25, kd = 1.0, kv = 0.5 }}
[output]
type = "IV"
L = 1.0
path = {{ kind = "composite", segments = [
    {{ kind = "line", from = [0.0, 0.0], to = [4.0, 0.0] }},
    {{ kind = "arc", radius = 10.0, angle = {turn} }},
    {{ kind = "line", length = 9.0 }} ] }}
[reference]
speed = 2.0
[initial]
q = [-3.6, 0.5, 0.0, 0.0, 0.0]
nu = [0.0, 0.0]
[simulation]
duration = 12.0
period = {period}
output_step = 0.02
"""


class SteeredLoop:
    """The follower of a car or a tricycle on the path of SPEC, and the robot that it drives."""

    def __init__(self, robot: str = "car", scalar: str = "double", period: float = 0.01, **changes: Any):
        self.c, self.period = follower_in_c(robot, scalar), period
        ffi = self.c.ffi
        line = {"heading": TURN, "x": 14.0, "y": 10.0, "length": 9.0}
        arc = {"x": 4.0, "curvature": 0.1, "length": 10 * TURN}
        self.segments = ffi.new(f"noslip_segment{SUFFIX[scalar]}[3]", [{"length": 4.0}, arc, line])
        self.config, self.follower = self.c.new("config"), self.c.new("")
        config = self.config
        config.period, config.counts_per_turn, config.counter_bits, config.straight = (
            period,
            [COUNTS, -COUNTS],
            24,
            STRAIGHT,
        )
        config.steering, config.fastest, config.start = (
            1.2,
            [100.0, 20.0],
            dict(zip(("x", "y", "heading"), START, strict=True)),
        )
        config.segments, config.count, config.path.speed, config.path.L, config.astray = (
            self.segments,
            3,
            SPEED,
            [1.0, 0.0],
            2.0,
        )
        config.gains, config.limits.limit, config.watchdog.tolerated = GAINS, [1e4, 1e4], 3
        config.velocity = [{"speed": 100.0, "acceleration": 50.0, "band": 10.0}] * 2
        for name, value in changes.items():
            place, *inner = name.split("__")
            setattr(getattr(config, place) if inner else config, inner[-1] if inner else place, value)
        self.status = self.c.status(self.c.call("init", self.follower, config))
        system = self.c.law.system
        self.steered = steered_axle(system)
        self.plant = Plant(system, [p.default for p in system.mechanism.parameters])
        self.x = np.array([*START, 0.0, 0.0, 0.0, 0.0])  # x, y, phi, delta, theta, thetadot, deltadot
        self.command, self.turned, self.counts = self.c.reals(2), self.c.reals(2), ffi.new("uint32_t[2]")
        self.rolled = 0.0

    def by_angles(self, angle: float | None = None) -> str:
        self.turned[0], self.turned[1] = self.x[4] - self.rolled, self.x[3] if angle is None else angle
        self.rolled = self.x[4]
        return self.c.status(
            self.c.call("tick_angles", self.follower, self.turned, self.period, self.command)
        )

    def by_counts(self, angle: float | None = None) -> str:
        at = self.x[4], self.x[3] if angle is None else angle
        rolled, angle = (round(a / (2 * math.pi) * COUNTS) for a in at)
        self.counts[0], self.counts[1] = rolled % 2**24, (STRAIGHT - angle) % 2**24
        return self.c.status(self.c.call("tick", self.follower, self.counts, 0, self.command))

    def move(self) -> None:
        """The robot, with the last torques held for a period."""
        tau = np.array(list(self.command))
        self.x = self.plant.step(self.x, tau, self.period, 1e-9)[0]

    def roll(self) -> None:
        """The robot with drives that follow their commands at once."""
        h, x = self.period / 20, self.x
        for _ in range(20):
            x[5:] = list(self.command)
            x[:5] += h * self.plant.rate(x, np.zeros(2))[:5]

    @property
    def reckoned(self) -> np.ndarray:
        pose = self.follower.odometry.pose
        return np.array([pose.x, pose.y, pose.heading])

    @property
    def distance(self) -> float:
        return self.follower.path.guide.foot.distance


def drive(loop: SteeredLoop, seconds: float, tick: str = "by_angles") -> tuple[np.ndarray, float]:
    """The states at all ticks, and the largest error of the reckoned pose."""
    rows, error = [], 0.0
    for _ in range(round(seconds / loop.period)):
        assert getattr(loop, tick)() == "ok"
        error = max(error, np.abs(loop.reckoned - loop.x[:3]).max())
        rows.append(loop.x)
        loop.move()
    return np.array(rows), error


def simulated(tmp_path: Path, period: float) -> np.ndarray:
    (tmp_path / "spec.toml").write_text(SPEC.format(turn=TURN, period=period))
    return simulate(read_spec(tmp_path / "spec.toml")).x


def test_it_drives_as_simulate_does(tmp_path):
    """The same path, but for the rates, which are means over a tick: the difference is of first order in the
    period.

    At the ends of segments, which are noticed at a tick, it is not smooth in the period.
    """
    first, largest = [], []
    for period in (0.02, 0.01):
        (rows, error), reference = drive(SteeredLoop(period=period), 12.0), simulated(tmp_path, period)
        every = rows[:: round(0.02 / period)]
        apart = np.abs(every[:, :4] - reference[: len(every), :4]).max(1)
        first.append(apart[:100].max())
        largest.append(apart.max())
        # Of the second order: the axle moves at the mean of two steering angles
        assert error < 0.4 * period**2
    assert largest[1] < 0.012 and first[0] / first[1] == pytest.approx(2.0, abs=0.1)


def test_reverse_is_refused(tmp_path):
    """The body would fold onto the steered wheel."""
    text = SPEC.format(turn=TURN, period=0.01).replace("length = 9.0", "length = 9.0, backward = true")
    (tmp_path / "spec.toml").write_text(text.replace("L = 1.0", 'L = 1.0\nreversing = "switch"'))
    with pytest.raises(BadInput, match="segments in reverse does not go with a steered wheel"):
        simulate(read_spec(tmp_path / "spec.toml"))


def test_counts_are_angles():
    """Within their resolution, with a steering counter that counts backwards from any count straight ahead,
    in float too."""
    for scalar in SUFFIX:
        loop = SteeredLoop(scalar=scalar)
        _, error = drive(loop, 12.0, "by_counts")
        assert error < 1e-3 and abs(loop.distance) < 0.02
        assert loop.follower.steering.angle == pytest.approx(loop.x[3], abs=0.02)


@pytest.mark.parametrize(
    ("ticks", "bound"), [(20_000, 1e-3), pytest.param(8_640_000, 1e-2, marks=pytest.mark.nightly)]
)
def test_reckoning_in_float(ticks, bound):
    """Beside the same sums in double, on a way that winds: 10 mm after 24 h at 100 Hz,
    86 km. It goes on after a stop."""
    loop = SteeredLoop(scalar="float")
    function, follower, per_count = loop.c.lib.car_follower_tick_f, loop.follower, 2 * math.pi / COUNTS
    r, wheelbase, at = follower.params.r, follower.params.l, follower.odometry.now.at
    (x, y, heading), rolled, before = START, 0, 0.0
    for k in range(ticks):
        steered, step = int(6000 * math.sin(0.002 * k)), 2122 + k % 3  # counts
        rolled += step
        loop.counts[0], loop.counts[1] = rolled % 2**24, (STRAIGHT - steered) % 2**24
        function(follower, loop.counts, 0, loop.command)
        angle = steered * per_count
        if k:
            way = r * step * per_count
            turn = way * math.tan((angle + before) / 2) / wheelbase
            chord = way * (math.sin(turn / 2) / (turn / 2) if turn else 1.0)
            x, y = x + chord * math.cos(heading + turn / 2), y + chord * math.sin(heading + turn / 2)
            heading += turn
        before = angle
    assert (
        math.hypot(at[0] - x, at[1] - y) < bound and abs(math.remainder(at[2] - heading, 2 * math.pi)) < 1e-6
    )


@pytest.mark.nightly
def test_a_tricycle_drives():
    """Another robot, whose driven wheel is the steered one; it may turn it by more than a right angle."""
    loop = SteeredLoop("tricycle", "float", path__L=[0.3, 0.0], steering=1.7)
    loop.x[0] = loop.config.start.x = -1.0
    assert loop.c.call("init", loop.follower, loop.config) == 0
    _, error = drive(loop, 12.0)
    assert error < 2e-4 and abs(loop.distance) < 0.01


def test_velocity_drives():
    """Commands are rates of wheel and steering; the twist is that of the axle at the next steering angle."""
    loop = SteeredLoop(drive=1)
    twist = loop.c.reals(2)
    for _ in range(1100):
        assert loop.by_angles() == "ok"
        assert loop.c.call("twist", loop.follower, twist) == 0
        rate, angle = loop.command[0], loop.x[3] + loop.command[1] * loop.period
        r, wheelbase = loop.config.params.r or 0.3, 2.6
        assert list(twist) == pytest.approx(
            [r * rate, r * rate * math.tan(angle) / wheelbase], rel=1e-9, abs=1e-12
        )
        loop.roll()
    assert abs(loop.distance) < 0.02 and abs(loop.follower.speed - SPEED) < 0.05
    assert SteeredLoop().c.call("twist", SteeredLoop().follower, twist) < 0 and list(twist) == [0, 0]


def test_an_approach_is_bounded():
    loop = SteeredLoop(approach=0.1, settling=0.5)
    accelerations = []
    for _ in range(800):
        assert loop.by_angles() == "ok"
        accelerations.append(loop.follower.reference.distance_acceleration)
        loop.move()
    assert np.abs(accelerations).max() == pytest.approx(0.1, rel=1e-6) and abs(loop.distance) < 0.1


@pytest.mark.parametrize(
    "changes",
    [
        # Of a car: beyond a right angle its front wheel is locked
        *({"steering": bad} for bad in (0.0, -1.0, math.nan, 1.6)),
        *({"fastest": bad} for bad in ([0.0, 1.0], [1.0, 0.0], [1.0, math.inf])),
        {"stuck_torque": [-1.0, 0.0]},
        {"counter_bits": 16},  # half of its range is less than the steering angle
        {"path__W": 0.1},
        {"path__ahead": 0.1},
        {"path__reversing": 1},
        {"path__L": [0.0, 0.0]},
        {"limits__limit": [10.0, 0.0]},
    ],
)
def test_init_refuses(changes):
    assert SteeredLoop(**changes).status in ("bad_parameter", "bad_path", "singular")


def test_impossible_angles_are_errors():
    """A steering angle beyond its limit or out of reach within a tick: held, then stopped;
    a single one is survived."""
    for wrong in (1.3, math.nan, 0.9):  # 0.9 rad: too far for 20 rad/s in 10 ms
        loop = SteeredLoop()
        drive(loop, 1.0)
        before, held = loop.reckoned, list(loop.command)
        assert loop.by_angles(wrong) == "range" and list(loop.command) == held
        assert list(loop.reckoned) == list(before)
        loop.move()
        drive(loop, 1.0)
    loop = SteeredLoop()
    drive(loop, 1.0)
    for period in (0.0, math.nan, 1e3, loop.period):  # times that are refused do not count
        loop.period = period
        assert loop.by_angles(0.9) == "range"
    loop = SteeredLoop()
    statuses = [loop.by_angles(1.3) for _ in range(10)]
    assert set(statuses) == {"range"} and loop.follower.watchdog.state == 2 and list(loop.command) == [0, 0]


@pytest.mark.parametrize("tick", ["by_angles", "by_counts"])
def test_an_impossible_angle_that_stays_is_never_followed(tick):
    """0.9 rad, within the limit but reached in no time: held as long as tolerated, then stopped,
    the pose unchanged."""
    loop = SteeredLoop()
    drive(loop, 1.0, tick)
    before, held = loop.reckoned, list(loop.command)
    for k in range(6):
        at = loop.reckoned
        assert getattr(loop, tick)(0.9) == "range"
        assert list(loop.command) == (held if k < loop.config.watchdog.tolerated else [0, 0])
        assert list(at) == list(before) or k > loop.config.watchdog.tolerated
        loop.move()
    assert loop.follower.watchdog.state == 2


def test_an_impossible_roll_that_stays_is_never_followed():
    """5 rad within each tick of 10 ms at no more than 100 rad/s."""
    loop = SteeredLoop()
    drive(loop, 1.0)
    before = loop.reckoned
    for _ in range(6):
        loop.rolled = loop.x[4] - 5.0
        assert loop.by_angles() == "range" and list(loop.reckoned) == list(before)
    assert list(loop.command) == [0, 0] and loop.follower.watchdog.state == 2


@pytest.mark.parametrize("late", [1, 2, 3])
def test_a_steering_angle_may_change_in_rejected_time(late):
    """At 20 rad/s it is 0.2 rad farther after each tick of 10 ms, rejected or not;
    no more. Its rate is the mean since then."""
    for beyond in (-1e-6, 1e-6):
        loop = SteeredLoop()
        drive(loop, 1.0)
        last, reach = loop.follower.steering.angle, 20 * loop.period * (late + 1)
        assert {loop.by_angles(1.3) for _ in range(late)} == {"range"}
        assert loop.by_angles(last + reach + beyond) == ("ok" if beyond < 0 else "range")
        if beyond < 0:
            assert loop.follower.rate[1] == pytest.approx(20.0, abs=1e-3) and loop.follower.waited == 0


def test_parameters_change_between_ticks():
    """The place of the steered wheel is that of the new wheelbase; without changes nothing changes."""
    loop, other = SteeredLoop(), SteeredLoop()
    null = loop.c.ffi.NULL
    drive(loop, 1.0), drive(other, 1.0)
    assert loop.c.call("update", loop.follower, null, null, null) == 0
    assert loop.by_angles() == other.by_angles() == "ok" and list(loop.command) == list(other.command)
    params = loop.c.ffi.new("car_params *", loop.follower.params)
    params.l = 2.5
    assert (
        loop.c.call("update", loop.follower, params, null, null) == 0 and loop.follower.steering.reach == 2.5
    )
    params.l = 0.0
    assert (
        loop.c.call("update", loop.follower, params, null, null) < 0 and loop.follower.steering.reach == 2.5
    )


def test_telemetry_of_a_steered_vehicle(tmp_path, capsys):
    """A dump is replayed bit by bit, logged with the steering angle as an angle, and drawn."""
    loop, ring = SteeredLoop("car", "float"), runtime("noslip_telemetry.h")
    ffi, lib = ring.ffi, ring.lib
    memory, own, count = ffi.new("uint8_t[8192]"), ffi.new("noslip_telemetry *"), ffi.new("uint32_t *")
    assert lib.noslip_telemetry_init(own, memory, 8192) == 0
    telemetry = loop.c.ffi.cast("noslip_telemetry *", int(ffi.cast("uintptr_t", own)))
    assert loop.c.call("describe", loop.follower, telemetry, loop.c.ffi.new("uint8_t[2048]"), 2048) == 0
    record, _ = loop.c.records()
    sent = b""
    for _ in range(300):
        status = loop.c.lib.NOSLIP_OK if loop.by_counts() == "ok" else -1
        assert loop.c.call("record", loop.follower, loop.counts, 0, status, loop.command, record) == 0
        one = ffi.new("noslip_record_f *")
        ffi.buffer(one)[:] = loop.c.ffi.buffer(record)[:]
        assert lib.noslip_telemetry_record_f(own, one) == 0
        taken = ffi.new("uint8_t[8192]")
        assert lib.noslip_telemetry_read(own, taken, 8192, count) == 0
        sent += bytes(ffi.buffer(taken, count[0]))
        loop.move()
    dump = tmp_path / "run.dump"
    dump.write_bytes(sent)
    assert main(["replay", str(dump), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["ticks"] == 300
    assert main(["log", str(dump), "-o", str(tmp_path / "run.csv")]) == 0
    last = np.genfromtxt(tmp_path / "run.csv", delimiter=",", names=True, dtype=None, encoding=None)[-1]
    assert last["delta"] == pytest.approx(loop.follower.steering.angle, abs=1e-6)
    assert abs(last["x"] - loop.x[0]) < 0.05
    assert main(["view", str(dump), "-o", str(tmp_path / "run.svg")]) == 0
    assert len((tmp_path / "run.svg").read_text()) > 20_000


def test_which_vehicles_are_steered():
    names = (
        "car",
        "tricycle",
        "f1tenth",
        "forklift",
        "labmate",
        "tractor_trailer:1",
        "four_wheel",
        "rolling_disk",
    )
    assert [name for name in names if steered_axle(system_of(find_robot(name)))] == list(names[:4])


@pytest.mark.parametrize("name", ["car", "tricycle"])
def test_the_pose_is_found_in_any_order_of_the_coordinates(name, monkeypatch):
    """Turning the heading of the body turns the motion, the steering angle does not;
    the gyro measures the former."""
    declared = Mechanism.coordinate

    def at_the_front(robot: Mechanism, *given: str) -> ca.SX:
        symbol = declared(robot, *given)
        for each in (robot.coordinates, robot.velocities):
            each.insert(0, each.pop())
        return symbol

    monkeypatch.setattr(Mechanism, "coordinate", at_the_front)
    system = reduce(ROBOTS[name]())
    assert [q.name for q in system.mechanism.coordinates] == ["theta", "delta", "phi", "y", "x"]
    assert pose_names(system) == ("x", "y", "phi")
    steered = steered_axle(system)
    assert (
        steered
        and [system.mechanism.coordinates[k].name for k in steered.pose] == ["x", "y", "phi"]
        and str(steered.angle) == "delta"
    )
    gyro = Dynamics.of(system, "torque", ["gyro", *[q.name for q in system.quasi_velocities]]).measured[0]
    assert ca.is_equal(ca.jacobian(gyro, system.nu), ca.jacobian(system.qdot[2], system.nu), 9)


def test_a_pose_that_cannot_be_told_is_refused():
    """A wheel that turns freely under the point that it carries: which of the two angles is the heading,
    no motion tells."""
    robot = Mechanism("ambiguous")
    x, y = robot.coordinate("x", "m"), robot.coordinate("y", "m")
    body, wheel = robot.coordinate("body", "rad"), robot.coordinate("wheel", "rad")
    robot.kinetic_energy(sum(robot.rate(each) ** 2 for each in (x, y, body, wheel)) / 2)
    heading = body + wheel
    robot.rolls("no side slip", ca.cos(heading) * robot.rate(y) - ca.sin(heading) * robot.rate(x))
    for each in (body, wheel):
        robot.input(f"tau_{each}", "N m", on=robot.rate(each))
    robot.input("force", "N", on=ca.cos(heading) * robot.rate(x) + ca.sin(heading) * robot.rate(y))
    robot.moves_in_plane(x, y, heading)
    with pytest.raises(BadInput, match="no vehicle with a pose of three coordinates, or of several"):
        pose_names(reduce(robot))
