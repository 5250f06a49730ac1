"""The firmware: vehicle and watchdog on this host, and the images of all targets in QEMU."""

import cmath
import csv
import json
import math
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from noslip.checks.guarantees.vehicle import HOLD, PERIOD, ROOT, RUN, STOP, Firmware, FirmwareLoop, change
from noslip.cli.main import main
from noslip.codegen.runtime import RUNTIME
from noslip.codegen.targets import makefile
from noslip.readers.robots import find_robot, system_of
from noslip.simulation.controllers.targets import QUIET, TARGETS
from noslip.simulation.plant import Plant
from noslip.tests.runtime_c.test_motor import REFUSED, TORQUE, VOLTAGE, motor_does
from noslip.tests.tools import need

FIRMWARE, GENERATED = ROOT / "firmware", ROOT / "generated/labmate"
TURN = 2 * math.pi
NAN, INF = math.nan, math.inf

SETTINGS = {  # a change of the settings that must be refused -> the status
    "period": (("period",), (0.0, -PERIOD, NAN, INF, 1e-45)),
    "counts per turn": (("counts_per_turn", 1), (0.0, 0.5, NAN, INF)),
    # 12: half a round is less than four ticks at the fastest
    "counter bits": (("counter_bits",), (1, 33, -16, 12)),
    "smoothing": (("smoothing",), (-0.01, -PERIOD / 2, NAN, INF)),
    # 130 rad/s: half a round in less than four ticks
    "fastest": (("fastest",), (0.0, -1.0, NAN, INF, 1e30, 130.0)),
    "start": (("start", "x"), (NAN, INF)),
    "heading": (("start", "heading"), (NAN, 1e5)),
    "no path": (("count",), (0, -1)),
    "speed": (("path", "speed"), (0.0, -1.0, NAN, INF)),
    "wrong side": (("path", "reversing"), (0, 7)),
    "another point": (("path", "ahead"), (0.29, NAN)),
    "a point aside": (("path", "W"), (0.2, -0.01, NAN)),
    "mass": (("params", "m_c"), (0.0, -1.0, NAN)),
    "radius": (("params", "r"), (0.0, -0.15, NAN, INF)),
    "on the axle": (("params", "d"), (0.0, 0.6, NAN)),
    "gain": (("gains", "kv_speed"), (0.0, -1.0, NAN, INF)),
    "limit": (("limits", "limit", 0), (-1.0, NAN, INF)),
    "on limit": (("limits", "on_limit"), (2, -1)),
    "motor": (("motors", 1, "supply"), (0.0, NAN)),
    "astray": (("astray",), (0.0, -1.0, NAN, INF)),
    "approach": (("approach",), (-1.0, NAN, INF, 0.5)),  # 0.5: without a settling time
    "drive": (("drive",), (1, 2, -1)),  # 1: without limits of velocities
    "stuck torque": (("stuck_torque",), (-1.0, NAN, INF)),
    "tolerated": (("watchdog", "tolerated"), (-1, 100000)),
    "forgiven": (("watchdog", "forgiven"), (-1,)),
    "stuck": (("watchdog", "stuck"), (-1,)),
}


@pytest.fixture(scope="module")
def c(tmp_path_factory) -> Firmware:
    return Firmware(tmp_path_factory.mktemp("headers"))


# -- the watchdog --------------------------------------------------------------------------------------------


class Rules:
    """What noslip_watchdog.h says, in Python."""

    def __init__(self, tolerated: int, forgiven: int, stuck: int, passing: tuple):
        self.tolerated, self.forgiven, self.stuck, self.passing = tolerated, forgiven, stuck, passing
        self.state, self.strikes, self.good, self.stood, self.status = RUN, 0, 0, 0, 0

    def tick(self, status: int, missed: int, standing: int) -> int:
        if self.state == STOP:
            return STOP
        self.stood = self.stood + 1 if standing else 0
        bad = missed + (status < 0)
        stuck = self.stuck and self.stood > self.stuck
        self.status = status if status < 0 and not stuck else self.status
        if stuck or (status < 0 and status not in self.passing):
            self.state = STOP
        elif self.strikes + bad > self.tolerated:
            self.state = STOP
        else:
            self.strikes, self.state = self.strikes + bad, HOLD if status < 0 else RUN
            self.good = 0 if bad or not self.strikes else self.good + 1
            if self.forgiven and self.good == self.forgiven:
                self.strikes, self.good = self.strikes - 1, 0
        return self.state


def test_the_watchdog_keeps_its_rules(c):
    random, lib = np.random.default_rng(4), c.lib
    passing = (lib.NOSLIP_NONFINITE, lib.NOSLIP_RANGE, lib.NOSLIP_SINGULAR)
    statuses = (
        [lib.NOSLIP_OK] * 12
        + [lib.NOSLIP_SATURATED, lib.NOSLIP_ARRIVED, *passing] * 2
        + [lib.NOSLIP_UNSTABLE]
    )
    seen = set()
    for _ in range(400):
        tolerated, forgiven, stuck = (int(n) for n in random.integers(0, [5, 6, 4]))
        watchdog, rules = c.used("noslip_watchdog"), Rules(tolerated, forgiven, stuck, passing)
        assert (
            lib.noslip_watchdog_init(
                watchdog, c.new("noslip_watchdog_settings", (tolerated, forgiven, stuck))
            )
            == 0
        )
        for _ in range(60):
            status, missed = int(random.choice(statuses)), int(random.choice([0, 0, 0, 0, 0, 0, 1, 9]))
            standing = int(random.random() < 0.3)
            wanted = rules.tick(status, missed, standing)
            assert lib.noslip_watchdog_step(watchdog, status, missed, standing) == wanted == watchdog.state
            assert watchdog.status == rules.status
            seen.add((wanted, watchdog.reason))
        assert lib.noslip_watchdog_reset(watchdog) == 0 and lib.noslip_watchdog_step(watchdog, 0, 0, 0) == RUN
        assert (watchdog.status, watchdog.reason, watchdog.strikes, watchdog.good, watchdog.stood) == (0,) * 5
    assert seen == {(RUN, 0), (HOLD, 0), (STOP, 1), (STOP, 2), (STOP, 3)}


def test_a_watchdog_that_is_not_ready_stops(c):
    watchdog = c.new("noslip_watchdog")
    assert (
        c.lib.noslip_watchdog_step(c.ffi.NULL, 0, 0, 0)
        == STOP
        == c.lib.noslip_watchdog_step(watchdog, 0, 0, 0)
    )
    assert c.lib.noslip_watchdog_reset(watchdog) == c.lib.NOSLIP_NOT_READY
    missed = 2**32 - 1
    assert c.lib.noslip_watchdog_init(watchdog, c.new("noslip_watchdog_settings", (5, 0, 0))) == 0
    assert c.lib.noslip_watchdog_step(watchdog, c.lib.NOSLIP_RANGE, missed, 0) == STOP


# -- the vehicle ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SETTINGS)
def test_bad_settings_are_refused(c, name):
    place, values = SETTINGS[name]
    told, counts = c.ffi.new("float[2]"), c.ffi.new("uint32_t[2]")
    for value in values:
        settings, vehicle = c.settings(), c.used("labmate_follower_f")
        change(settings, place, value)
        assert c.lib.labmate_follower_init_f(vehicle, settings) < 0, value
        told[0] = told[1] = NAN
        assert c.lib.labmate_follower_tick_f(vehicle, counts, 0, told) == c.lib.NOSLIP_NOT_READY and list(
            told
        ) == [0, 0]
        assert c.lib.labmate_follower_reset_f(vehicle) == c.lib.NOSLIP_NOT_READY


def test_null_is_refused(c):
    null, settings = c.ffi.NULL, c.settings()
    vehicle, told, counts = c.vehicle(settings), c.ffi.new("float[2]", [NAN, NAN]), c.ffi.new("uint32_t[2]")
    init, tick = c.lib.labmate_follower_init_f, c.lib.labmate_follower_tick_f
    assert init(null, settings) == init(c.new("labmate_follower_f"), null) == c.lib.NOSLIP_NULL
    assert tick(null, counts, 0, told) == tick(vehicle, null, 0, told) == c.lib.NOSLIP_NULL
    assert list(told) == [0, 0] and tick(vehicle, counts, 0, null) == c.lib.NOSLIP_NULL
    settings.segments = null
    assert c.lib.labmate_follower_init_f(c.new("labmate_follower_f"), settings) < 0


def test_null_parts_are_refused(c):
    null, lib = c.ffi.NULL, c.lib
    init = lib.noslip_watchdog_init
    assert (
        init(null, c.new("noslip_watchdog_settings"))
        == init(c.used("noslip_watchdog"), null)
        == lib.NOSLIP_NULL
    )
    assert lib.noslip_watchdog_reset(null) == lib.labmate_follower_reset_f(null) == lib.NOSLIP_NULL


def feed(c, vehicle, counts) -> np.ndarray:
    """The filtered rates after each pair of counts that the encoders have come to."""
    at, told, rates = c.ffi.new("uint32_t[2]"), c.ffi.new("float[2]"), []
    for row in counts:
        at[0], at[1] = (int(n) & 0xFFFF for n in row)
        c.lib.labmate_follower_tick_f(vehicle, at, 0, told)
        rates.append((vehicle.state.thetadot_r, vehicle.state.thetadot_l))
    return np.array(rates)


@pytest.mark.parametrize("smoothing", [0.0, 0.004, 0.02, 0.1])
def test_wheel_rates(c, smoothing):
    """Gain 1; behind an even growth by the time constant and half a tick; a count shows by its share,
    within the quantization."""
    settings = c.settings()
    settings.smoothing = smoothing
    count = TURN / settings.counts_per_turn[0]
    ticks = np.arange(600)
    even = feed(c, c.vehicle(settings), np.outer(ticks, (37, -91)))
    assert np.abs(even[-1] / (np.array([37, 91]) * count / PERIOD) - 1).max() < 1e-5

    growth = 3.0  # rad/s^2: 18 rad/s at the end
    grown = feed(
        c, c.vehicle(settings), np.outer(np.round(growth * (ticks * PERIOD) ** 2 / 2 / count), (1, -1))
    )
    lag = ticks[-100:] * PERIOD - grown[-100:].mean(axis=1) / growth
    assert abs(lag.mean() - (smoothing + PERIOD / 2)) < 1e-5 + count / PERIOD / growth / 100

    step = feed(c, c.vehicle(settings), np.outer(ticks > 300, (1, 0)))[:, 0]
    assert abs(step.max() - count / (smoothing + PERIOD)) < 1e-6 and step.argmax() == 301


def test_wheel_rates_over_missed_ticks(c):
    """The filter by the time that has passed, whatever it is."""
    random, settings = np.random.default_rng(7), c.settings()
    settings.watchdog.tolerated = 20
    settings.fastest = 10.0
    vehicle, told, at, count = (
        c.vehicle(settings),
        c.ffi.new("float[2]"),
        0,
        TURN / settings.counts_per_turn[0],
    )
    assert c.lib.labmate_follower_tick_f(vehicle, c.ffi.new("uint32_t[2]"), 0, told) >= 0
    rate = 0.0
    for _ in range(200):
        missed, turned = int(random.integers(0, 4)), int(random.integers(-600, 600))
        dt, at = (missed + 1) * PERIOD, (at + turned) & 0xFFFF
        possible = abs(turned) * count <= 10.0 * dt
        status = c.lib.labmate_follower_tick_f(vehicle, c.ffi.new("uint32_t[2]", (at, 0)), missed, told)
        assert (status == c.lib.NOSLIP_RANGE) != possible
        if not possible:  # as if it had not been; what the tick after it sees is another test's
            vehicle = c.vehicle(settings)
            c.lib.labmate_follower_tick_f(vehicle, c.ffi.new("uint32_t[2]", (at, 0)), 0, told)
            rate = 0.0
        else:
            rate += (turned * count / dt - rate) * dt / (settings.smoothing + dt)
            assert abs(vehicle.state.thetadot_r - rate) < 1e-5
            c.lib.labmate_follower_reset_f(vehicle)


def test_width_of_the_counters_does_not_matter(c):
    """The whole run, bit for bit."""
    runs = []
    for bits in (14, 16, 32):
        loop = FirmwareLoop(c, counter_bits=bits)
        c.lib.robot.counter_bits = bits
        rows = []
        while not rows or rows[-1][0] != c.lib.NOSLIP_ARRIVED:
            rows.append((loop.tick(), *loop.command, *loop.pose()))
        assert c.lib.counter[0] > 2**16  # it went round
        runs.append(rows)
    assert runs[0] == runs[1] == runs[2]


def test_it_stands_where_the_path_ends(c):
    """By the pose reckoned and by the simulated vehicle's own; the counters start anywhere."""
    loop = FirmwareLoop(c)
    first = [12345, 65000]

    def shifted(counts):
        counts[0], counts[1] = ((n + k) & 0xFFFF for n, k in zip(counts, first, strict=True))

    while loop.tick(shifted) != c.lib.NOSLIP_ARRIVED:
        assert loop.state == RUN
    for _ in range(600):
        assert loop.tick(shifted) == c.lib.NOSLIP_ARRIVED
    assert abs(c.lib.x - 2.0) + abs(c.lib.y - 0.5) < 0.01  # the end of the last segment in robot.c
    assert loop.drift() < 0.0002  # m
    assert abs(c.lib.rate[0]) + abs(c.lib.rate[1]) < 0.01


def test_the_simulated_vehicle_is_the_model(c):
    """One short step from random states, against the plant that the Lagrangian gives."""
    random, lib = np.random.default_rng(5), c.lib
    lib.board_start(PERIOD)
    params = [getattr(lib.robot.params, name) for name in ("b", "d", "r", "m_c", "m_w", "I_c", "I_w", "I_m")]
    system = system_of(find_robot("labmate"))
    assert [p.name for p in system.mechanism.parameters] == ["b", "d", "r", "m_c", "m_w", "I_c", "I_w", "I_m"]
    plant, dt = Plant(system, params), 1e-3
    motor = {name: getattr(lib.robot.motors[0], name) for name in REFUSED}
    for _ in range(200):
        rates, volts = random.uniform(-8, 8, 2), random.uniform(-20, 20, 2)
        lib.x, lib.y, lib.heading = random.uniform(-3, 3, 3)
        for i in range(2):
            lib.rate[i], lib.command[i] = rates[i], volts[i]
        d, before = params[1], np.array([lib.x, lib.y, lib.heading, *lib.rate])
        tau = [motor_does(motor, lib.command[i], before[3 + i])[0] for i in range(2)]
        centre = before[:2] + d * np.array([math.cos(before[2]), math.sin(before[2])])
        wanted = plant.rate(np.array([*centre, before[2], 0, 0, *before[3:]]), np.array(tau))
        lib.move(dt)
        moved = (np.array([lib.x, lib.y, lib.heading, *lib.rate]) - before) / dt
        # Float differences over dt
        assert np.abs(moved[3:] - wanted[5:]).max() < 1e-2 + 1e-3 * np.abs(wanted[5:]).max()
        turning, forward = wanted[2], (rates @ [1, 1]) * params[2] / 2
        along = forward * np.array([math.cos(before[2]), math.sin(before[2])])
        accelerated = np.abs(wanted[5:]).max() * dt  # the step is midway
        assert np.abs(moved[:2] - along).max() < 2e-3 + params[2] * accelerated + abs(forward * turning) * dt
        assert abs(moved[2] - turning) < 2e-3 + accelerated * params[2] / params[0]


def test_the_speed_loop_is_the_linear_recursion(c):
    """On a straight line from rest: hold, mean rate of a tick, filter and gain;
    nothing else is between speed and torque."""
    loop = FirmwareLoop(c, smoothing=0.05, limits__on_limit=c.lib.NOSLIP_CUT)
    loop.settings.limits.limit = [1e6, 1e6]
    for motor in (*loop.settings.motors, *c.lib.robot.motors):
        motor.mode = TORQUE
    loop.vehicle = c.vehicle(loop.settings)
    gain, share = loop.settings.gains.kv_speed, PERIOD / (0.05 + PERIOD)
    speed = mean = seen = 0.0
    for tick in range(250):
        seen += share * (mean - seen) if tick else 0.0
        loop.tick()
        radius = loop.settings.params.r
        assert abs(c.lib.rate[0] * radius - speed) < 2e-3
        change_of_speed = gain * (loop.settings.path.speed - seen) * PERIOD
        speed, mean = speed + change_of_speed, speed + change_of_speed / 2
    assert 0.9 < speed < 1.1


def test_back_emf_made_up_for_late_feels_like_inertia(c):
    """With a voltage: e E^2 dt / R more than with a torque, as its header says.

    The simulated motor itself makes up for an eighth: in each of its four steps its rate is that of the
    step's beginning.
    """
    felt = []
    for mode in (TORQUE, VOLTAGE):
        loop = FirmwareLoop(c, limits__on_limit=c.lib.NOSLIP_CUT, gains__kv_speed=0.2)
        loop.settings.limits.limit = [1e6, 1e6]
        for motor in (*loop.settings.motors, *c.lib.robot.motors):
            motor.mode, motor.current, motor.supply, motor.friction = mode, 1e3, 1e3, 0.0
        loop.vehicle = c.vehicle(loop.settings)
        seen = []
        for _ in range(120):
            loop.tick()
            seen.append((c.lib.rate[0], loop.vehicle.torque[0]))
        rates, torques = np.array(seen).T
        felt.append(torques[61:111].mean() * 50 * PERIOD / (rates[111] - rates[61]))
    motor = loop.settings.motors[0]
    wanted = (motor.torque_constant * motor.gear) ** 2 * motor.efficiency * PERIOD / motor.resistance
    assert abs((felt[1] - felt[0]) / (7 / 8 * wanted) - 1) < 0.02 and wanted > 0.05 * felt[0]


# -- what goes wrong -----------------------------------------------------------------------------------------


def started(c, **changes) -> FirmwareLoop:
    """A vehicle under way, at 3 s."""
    loop = FirmwareLoop(c, **changes)
    for _ in range(300):
        assert loop.tick() >= 0
    return loop


def test_a_count_that_is_misread_costs_nothing(c):
    """The tick is an error, the torques are held, and the pose after it is as without."""
    loop = started(c)
    held, before = list(loop.vehicle.torque), loop.pose()
    assert loop.tick(lambda counts: counts.__setitem__(1, counts[1] ^ 0x4000)) == c.lib.NOSLIP_RANGE
    assert loop.state == HOLD and list(loop.vehicle.torque) == held and list(loop.pose()) == list(before)
    rates = list(loop.vehicle.rate)
    assert loop.tick() >= 0 and loop.state == RUN
    assert (
        loop.drift() < 1e-4 and np.abs(np.subtract(list(loop.vehicle.rate), rates)).max() < 0.1
    )  # rad/s: the mean over both ticks


@pytest.mark.parametrize("missed", [1, 2])
def test_a_misread_count_after_missed_ticks_costs_nothing(c, missed):
    """The tick that is misread waits with those that were missed:
    the next one has the way and the time of all of them."""
    loop = started(c)
    before = list(loop.pose())
    assert loop.tick(lambda counts: counts.__setitem__(0, counts[0] ^ 0x4000), missed) == c.lib.NOSLIP_RANGE
    assert loop.state == HOLD and list(loop.pose()) == before and loop.vehicle.waited == missed + 1
    assert loop.tick() >= 0 and loop.state == RUN and loop.vehicle.waited == 0
    assert loop.drift() < 0.0001 and loop.vehicle.watchdog.strikes == missed + 1
    way = loop.settings.params.r * sum(loop.vehicle.rate) / 2 * PERIOD * (missed + 2)
    assert abs(way - np.hypot(*(loop.pose() - before)[:2])) < 1e-4 and abs(loop.vehicle.speed - 0.99) < 0.02


def test_a_misread_count_too_long_after_the_last_good_one_is_where_it_goes_on(c):
    """With as many missed as are tolerated the tick is lost,
    and the pose goes on from the counts that it saw."""
    loop = started(c)
    lost = loop.pose()
    assert loop.tick(lambda counts: counts.__setitem__(0, counts[0] ^ 0x4000), 3) == c.lib.NOSLIP_RANGE
    assert loop.state == STOP and loop.vehicle.waited == 0 and list(loop.pose()) == list(lost)
    assert [encoder.last for encoder in loop.vehicle.encoders] == list(loop.counts)


def test_counts_misread_twice_are_given_up_together(c):
    """The ticks waited for add up; after that none are."""
    loop = started(c)
    assert loop.tick(lambda counts: counts.__setitem__(0, counts[0] ^ 0x4000), 1) == c.lib.NOSLIP_RANGE
    assert (loop.state, loop.vehicle.waited) == (HOLD, 2)
    assert loop.tick(lambda counts: counts.__setitem__(0, counts[0] ^ 0x4000), 1) == c.lib.NOSLIP_RANGE
    assert loop.vehicle.waited == 0 and [encoder.last for encoder in loop.vehicle.encoders] == list(
        loop.counts
    )


def test_init_forgets_what_the_memory_held(c):
    vehicle = c.used("labmate_follower_f")
    assert c.lib.labmate_follower_init_f(vehicle, c.settings()) == 0
    assert list(vehicle.torque) == [0, 0] == list(vehicle.rate) and vehicle.waited == 0 == vehicle.speed


def test_missed_ticks_are_made_up_for(c):
    """Pose and rates are right at once; one strike each."""
    loop = started(c)
    for missed in (1, 2):
        assert loop.tick(missed=missed) >= 0
        assert loop.drift() < 1e-4
        assert abs(loop.vehicle.speed - 0.99) < 0.02
    assert loop.vehicle.watchdog.strikes == 3 and loop.state == RUN
    assert loop.tick(missed=1) < 0 and loop.state == STOP and list(loop.command) == [0, 0]


def test_a_period_ten_times_too_long_stops(c):
    loop = started(c)
    assert loop.tick(missed=9) < 0
    assert (loop.state, loop.vehicle.watchdog.reason) == (STOP, c.lib.NOSLIP_WATCHDOG_STRIKES) and list(
        loop.command
    ) == [0, 0]


@pytest.mark.parametrize("wheel", [0, 1])
def test_an_encoder_that_does_not_count_stops(c, wheel):
    loop = started(c)
    at = loop.counts[wheel]
    ticks = 0
    while loop.state == RUN:
        loop.tick(lambda counts: counts.__setitem__(wheel, at))
        ticks += 1
        assert ticks < 200
    assert loop.vehicle.watchdog.reason == c.lib.NOSLIP_WATCHDOG_STUCK and list(loop.command) == [0, 0]


def test_wheels_that_turn_are_not_stuck(c):
    """Whatever their torque is."""
    loop = started(c, stuck_torque=1e-6, watchdog__stuck=1)
    for _ in range(20):
        assert loop.tick() >= 0
        assert min(map(abs, loop.vehicle.torque)) > 1e-6
    assert loop.state == RUN


def test_a_stop_is_for_good_until_somebody_resets(c):
    """It rolls out, the pose goes on being reckoned; after the reset it goes on to the end of its path."""
    loop = started(c)
    loop.tick(missed=9)
    assert list(loop.vehicle.torque) == [0, 0]
    law = bytes(c.ffi.buffer(c.ffi.addressof(loop.vehicle.law)))
    for _ in range(300):
        assert loop.tick() < 0 and list(loop.command) == [0, 0]
    assert bytes(c.ffi.buffer(c.ffi.addressof(loop.vehicle.law))) == law, "it is not called"
    assert abs(c.lib.rate[0]) < 0.01
    assert loop.drift() < 1e-4
    assert c.lib.labmate_follower_reset_f(loop.vehicle) == 0
    for _ in range(3000):
        status = loop.tick()
        assert status >= 0
    assert status == c.lib.NOSLIP_ARRIVED and abs(c.lib.x - 2.0) + abs(c.lib.y - 0.5) < 0.02


def test_whatever_it_sees_the_command_is_finite_and_within_the_supply(c):
    """Counters, missed ticks and the state at random, NaN and infinities too;
    each is an error or a good command."""
    random, stopped = np.random.default_rng(6), 0
    hard = [NAN, INF, -INF, 3e38, -1e30, 1e-45, 0.0]
    loop = started(c)
    for _ in range(3000):
        counts = (
            [int(n) for n in random.integers(0, 2**32, 2)] if random.random() < 0.2 else list(loop.counts)
        )
        state, place = (
            loop.vehicle.state,
            random.choice(["x_c", "y_c", "phi", "thetadot_r", "thetadot_l", "theta_r"]),
        )
        if random.random() < 0.2:
            setattr(state, place, hard[random.integers(len(hard))])
        missed = int(random.choice([0, 0, 0, 0, 1, 2**32 - 1]))
        loop.command[0] = loop.command[1] = NAN
        status = c.lib.labmate_follower_tick_f(
            loop.vehicle, c.ffi.new("uint32_t[2]", counts), missed, loop.command
        )
        assert max(map(abs, loop.command)) <= 24.0
        if loop.state == STOP:
            assert status < 0 and list(loop.command) == [0, 0]
            stopped += 1
            loop = FirmwareLoop(c)
            for _ in range(3):
                loop.tick()
    assert stopped > 100


def laps_exactly(settings, pieces, laps: int) -> tuple[complex, float]:
    """Where the axle's middle and the heading get: arcs, in double, from the numbers of the settings."""
    r, b = settings.params.r, settings.params.b
    right, left = (TURN / n for n in settings.counts_per_turn)
    place, heading = 0j, 0.0
    for counts_right, counts_left, ticks in pieces * laps:
        way = r * (counts_right * right + counts_left * left) / 2 * ticks
        turn = r * (counts_right * right - counts_left * left) / (2 * b) * ticks
        place += way * np.sinc(turn / TURN) * cmath.exp(1j * (heading + turn / 2))
        heading = math.remainder(heading + turn, TURN)
    return place, heading


# counts of the right and the left wheel in a tick, ticks; the left counter goes down forward. 1.2 m/s, 42 km.
EIGHT = [(800, -200, 667), (200, -800, 667)]  # two circles
ROUND = [(700, -300, 10000)]


@pytest.mark.parametrize("pieces", [EIGHT, ROUND], ids=["eight", "round"])
def test_ten_hours_of_dead_reckoning(c, pieces):
    """In float at 100 Hz, 42 km, beside the exact figure: off by 1.2e-7 of the way and of the turns (or 1
    rad) at most, 5 mm."""
    settings = c.settings()
    settings.counter_bits = 32
    vehicle = c.vehicle(settings)
    laps = 3_600_000 // sum(ticks for *_, ticks in pieces)
    assert c.lib.drive_laps(vehicle, c.ffi.new("int[][3]", pieces), len(pieces), laps) == 0
    place, heading = laps_exactly(settings, pieces, laps)
    count, r, b = TURN / settings.counts_per_turn[0], settings.params.r, settings.params.b
    way = laps * sum((right - left) / 2 * count * r * ticks for right, left, ticks in pieces)
    turns = laps * sum((right + left) / 2 / b * count * r * ticks for right, left, ticks in pieces)
    pose = vehicle.odometry.pose
    reckoned = pose.heading
    axle = complex(pose.x, pose.y) - settings.params.d * (cmath.exp(1j * reckoned) - 1)
    assert 42e3 < way < 43e3 and abs(axle - place) < 2**-23 * way
    assert abs(math.remainder(reckoned - heading, TURN)) <= 2**-23 * (abs(turns) + 1)
    assert abs(reckoned) < TURN  # it was unwound


# -- the images ----------------------------------------------------------------------------------------------


# Targets of firmware/Makefile -> of controllers.targets
PLATFORM = {"netduinoplus2": "cortex-m4f", "stm32f405": "cortex-m4f"}
MACHINE = {"netduinoplus2": "netduinoplus2", "stm32f405": "netduinoplus2"}  # of QEMU
# Time passes with the instructions, and at once while the processor sleeps
CLOCK = ("-icount", "shift=5,sleep=off")
CONSOLE = ("-chardev", "stdio,id=console", "-semihosting-config", "enable=on,target=native,chardev=console")


def build(
    folder: Path, target: str, compiler: str = "gcc", source: Path = FIRMWARE, defines: str = ""
) -> Path:
    """The image, by the firmware's own Makefile."""
    platform = TARGETS[PLATFORM.get(target, target)]
    need("make", *(["clang", "ld.lld"] if compiler == "clang" else [platform.compiler]), platform.machine[0])
    given = [f"TARGET={target}", f"COMPILER={compiler}", f"BUILD={folder}", f"DEFINES={defines}"]
    command = ["make", "-s", "-C", str(source), *given]
    done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=120)
    assert done.returncode == 0 and done.stderr == "", done.stdout + done.stderr
    return folder / f"{target}-{compiler}" / "firmware.elf"


def emulate(target: str, image: Path, dump: Path | None = None) -> tuple[int, str]:
    """QEMU's exit code, and what the image said; its telemetry goes into a dump."""
    command = [
        *TARGETS[PLATFORM.get(target, target)].machine,
        *QUIET,
        *CONSOLE,
        *CLOCK,
        "-kernel",
        str(image),
    ]
    if dump:
        command[command.index(CONSOLE[-1])] += f",arg=telemetry,arg={dump}"
    command[2] = MACHINE.get(target, command[2])
    done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=60)
    return done.returncode, done.stdout + done.stderr


@pytest.fixture(scope="module")
def built(tmp_path_factory) -> Path:
    """Where images are built."""
    return tmp_path_factory.mktemp("firmware")


IMAGES = [
    ("cortex-m4f", "gcc"),
    ("cortex-m4f", "clang"),
    ("netduinoplus2", "gcc"),
    ("rv32imafc", "gcc"),
    ("rv32imac", "gcc"),
]


@pytest.mark.parametrize(("target", "compiler"), IMAGES)
def test_an_image_arrives(built, target, compiler):
    """The whole path, on the target's instructions and its clock, by each compiler; all say the same."""
    code, said = emulate(target, build(built, target, compiler))
    assert code == 0, said
    assert re.match(
        r"status arrived, watchdog 0, ticks \d+, missed 0, x 2\.\d+, y 0\.\d+, "
        r".* error 0\.00\d, drift 0\.000\n$",
        said,
    )


def test_images_say_what_the_host_computes(c, built):
    """To the last digit that they print, ticks included."""
    loop, ticks, standing = FirmwareLoop(c), 0, 0
    while standing < 300:  # as in main.c
        standing += loop.tick() == c.lib.NOSLIP_ARRIVED
        ticks += 1
    x, y, heading = loop.pose()
    error = math.hypot(loop.vehicle.path.guide.remaining, loop.vehicle.path.guide.foot.distance)
    _, said = emulate("cortex-m4f", build(built, "cortex-m4f"))
    wanted = f"ticks {ticks}, missed 0, x {x:.3f}, y {y:.3f}, heading {heading:.3f}, error {error:.3f}"
    assert wanted in said


@pytest.mark.parametrize("target", ["cortex-m4f", "rv32imac"])
def test_telemetry_of_an_image_is_repeated(c, built, target, tmp_path, capsys):
    """Every tick that the target has sent has the same bits on this host, and in the log."""
    dump = tmp_path / "run.dump"
    code, said = emulate(target, build(built, target), dump)
    assert code == 0, said
    assert main(["replay", str(dump), "--json"]) == 0
    replayed = json.loads(capsys.readouterr().out)
    ticks = int(re.search(r"ticks (\d+)", said)[1])
    assert (replayed["ticks"], replayed["remarks"]) == (ticks, [])
    assert main(["log", str(dump), "-o", str(tmp_path / "run.csv")]) == 0
    with open(tmp_path / "run.csv", encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == ticks and rows[-1]["status"] == "arrived"
    assert f"x {float(rows[-1]['x_c']):.3f}, y {float(rows[-1]['y_c']):.3f}" in said
    loop = FirmwareLoop(c)
    for row in rows[:500]:
        loop.tick()
        pose = loop.vehicle.odometry.pose
        assert np.array_equal(np.float32([row["x_c"], row["phi"]]), [pose.x, pose.heading])
        assert np.float32(row["command_tau_r"]) == loop.command[0]


BROKEN = {  # a change of robot.c -> the exit code
    "refused": (".smoothing = 0.02f", ".smoothing = -1.0f", 1),
    "stopped": (".fastest = 20.0f", ".fastest = 2.0f", 2),
    "late": (".kv_speed = 2.0f", ".kv_speed = 1e-3f", 3),
    "astray": (".stop = NOSLIP_STOP_AXLE", ".stop = NOSLIP_STOP_AXLE, .creep = 0.3f", 4),
    "fault": ("if (config == NULL)", "if (*(volatile int *)0xf0000000u == 0)", 255),
}


@pytest.mark.parametrize(
    ("target", "name"),
    [*(("cortex-m4f", name) for name in BROKEN), ("rv32imafc", "refused"), ("rv32imafc", "fault")],
)
def test_exit_codes(built, tmp_path, target, name):
    """An image that is broken ends with the code that says how."""
    old, new, wanted = BROKEN[name]
    whole = build(built, target).parent
    shutil.copytree(whole, tmp_path / "build" / whole.name)  # only robot.c is compiled anew
    source = tmp_path / "firmware"
    shutil.copytree(FIRMWARE, source)
    for name in ("runtime_c", "generated"):
        (tmp_path / name).symlink_to(ROOT / name)
    text = (source / "robot.c").read_text()
    assert old in text
    (source / "robot.c").write_text(text.replace(old, new))
    code, said = emulate(target, build(tmp_path / "build", target, source=source))
    assert code == wanted, said


@pytest.mark.nightly
def test_the_real_board_checks_itself(built):
    """QEMU has no encoders at the timers of an STM32F405: they count by themselves, or not,
    and the vehicle stops."""
    code, said = emulate("stm32f405", build(built, "stm32f405", defines="-DHAS_HOST"))
    assert code == 2, said


def test_the_makefile_has_the_targets_of_the_table(built):
    """firmware/targets.mk is current, and make uses it."""
    assert (FIRMWARE / "targets.mk").read_text() == makefile()
    for target in ("cortex-m4f", "cortex-m7", "rv32imafc", "rv32imac"):
        made = subprocess.run(
            ["make", "-n", "-B", "-C", str(FIRMWARE), "run", f"TARGET={target}"],
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for wanted in (TARGETS[target].flags, TARGETS[target].machine, CLOCK, (TARGETS[target].script,)):
            assert set(wanted) <= set(made.replace("boards/", "").split()), target


def test_no_heap_no_library_no_memory_of_its_own(built):
    """Follower and watchdog have no data, and call nothing but each other, the law,
    the dynamics and the path."""
    objects = build(built, "cortex-m4f").parent
    for name in ("labmate_follower_f", "noslip_watchdog"):
        command = ["arm-none-eabi-nm", str(objects / f"{name}.o")]
        rows = [
            line.split()[-2:]
            for line in subprocess.run(
                command, capture_output=True, text=True, check=True
            ).stdout.splitlines()
        ]
        assert not [symbol for kind, symbol in rows if kind in "DdBbCGgSs"]
        needed = [symbol for kind, symbol in rows if kind == "U"]
        ours = (
            r"(noslip_watchdog|noslip_path|labmate_(type_iv_segment|dynamics|check_params|default_params))_"
        )
        assert all(re.match(ours, symbol) for symbol in needed), needed


@pytest.mark.parametrize("cxx", ["g++", "clang++"])
def test_a_cpp_program_can_include_it(tmp_path, cxx):
    need(cxx)
    (tmp_path / "main.cc").write_text(
        '#include "robot.h"\n#include "robot.h"\n'
        "int main() { labmate_follower_f robot; return labmate_follower_reset_f(&robot); }\n"
    )
    include = [f"-I{folder}" for folder in (FIRMWARE, RUNTIME, GENERATED)]
    command = [
        cxx,
        "-std=c++11",
        "-Wall",
        "-Wextra",
        "-Wpedantic",
        "-Werror",
        "-Wno-uninitialized",
        *include,
        "-fsyntax-only",
        "main.cc",
    ]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0 and done.stderr == "", done.stderr


def test_what_a_tick_costs(built):
    """checks/bench/firmware.py counts every tick; the worst stack of a tick stays within 512 bytes."""
    need("make", "gcc", "arm-none-eabi-gcc", "qemu-system-arm")
    command = [sys.executable, str(ROOT / "checks/bench/firmware.py"), "--json", "--build", str(built)]
    result = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    tick = result["instructions"]["labmate_follower_tick_f"]
    assert 2000 < tick["calls"] < 2500 and 300 < tick["least"] <= tick["mean"] <= tick["most"]
    assert 0 < result["stack_bytes"]["labmate_follower_tick_f"] <= 512
