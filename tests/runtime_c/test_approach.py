"""The approach of a path: bounded acceleration, no overshoot, as fast as any;
C as the reference implementation."""

import math
import re

import numpy as np
import pytest
from noslip.readers.errors import BadInput
from noslip.simulation.closed_loop import simulate
from noslip.simulation.controllers.approach import (
    SETTLING,
    CompiledApproach,
    ReferenceApproach,
    make_approach,
)
from noslip.simulation.controllers.runtime import runtime
from noslip.simulation.guidance import approached_from
from noslip.simulation.integrate import sampled
from noslip.simulation.loop import make_loop
from noslip.simulation.specification.spec import spec_of
from noslip.tests.runtime_c.test_grip import SPEC
from scipy.optimize import linprog

STEP = 0.01  # s


def led(generator, distance: float, rate: float, speed: float, final: float, seconds: float) -> np.ndarray:
    """What is desired from a start on, a row for each step."""
    generator.start(distance, rate, speed)
    return np.array([generator.step(STEP if k else 0.0, final) for k in range(round(seconds / STEP))])


def starts(count: int):
    random = np.random.default_rng(7)
    for _ in range(count):
        yield random.uniform(0.1, 3.0), *random.uniform(-5, 5, 1), *random.uniform(-1.5, 1.5, 3)


def fastest(distance: float, rate: float, acceleration: float) -> float:
    """The shortest time to rest at 0, by bisection of the time at which braking begins: x'' = -s a,
    then s a."""
    side = math.copysign(1.0, distance + rate * abs(rate) / (2 * acceleration))
    x, v = side * distance, side * rate
    turn = v / acceleration + math.sqrt(v**2 / (2 * acceleration**2) + x / acceleration)
    return 2 * turn - v / acceleration


def test_acceleration_is_bounded_and_the_end_is_at_rest():
    for acceleration, distance, rate, speed, final in starts(60):
        time = fastest(distance, rate, acceleration)
        rows = led(
            ReferenceApproach(acceleration, SETTLING),
            distance,
            rate,
            speed,
            final,
            time + 12 * SETTLING + 6 / acceleration,
        )
        y, y_rate, y_acceleration, v, v_rate = rows.T
        assert (np.abs(y_acceleration) <= acceleration).all() and (np.abs(v_rate) <= acceleration).all()
        assert np.abs(np.diff(y) - STEP * y_rate[:-1] - STEP**2 * y_acceleration[:-1] / 2).max() < 1e-12
        assert np.abs(np.diff(y_rate) - STEP * y_acceleration[:-1]).max() < 1e-12
        assert np.abs(np.diff(v) - STEP * v_rate[:-1]).max() < 1e-12
        zone = acceleration * SETTLING**2
        late = round((time + 2 * SETTLING) / STEP)
        assert np.abs(y[late:]).max() < 1.5 * zone, "not as fast as any, up to the linear zone"
        assert np.abs(rows[-1] - [0, 0, 0, final, 0]).max() < 1e-3 * (1 + acceleration)


def test_from_rest_it_does_not_overshoot_and_brakes_once():
    for acceleration, distance, *_ in starts(40):
        y, y_rate, y_acceleration, *_ = led(
            ReferenceApproach(acceleration, SETTLING), distance, 0.0, 0.0, 1.0, 20.0
        ).T
        side = math.copysign(1.0, distance)
        assert (side * y).min() > -1e-2 * acceleration * SETTLING**2
        pushes = np.sign(np.where(np.abs(y_acceleration) > 0.02 * acceleration, side * y_acceleration, 0.0))
        assert np.count_nonzero(np.diff(pushes[pushes != 0])) <= 1, "it chatters"


def least_time(distance: float, rate: float, acceleration: float, jerk: float) -> tuple[float, float]:
    """Bounds of the shortest time to rest at 0 with both bounds, by linear programs: a jerk for each of the
    steps of equal length reaches it in the upper one; in the lower one, not even if the bound of the
    acceleration holds at the steps only and the jerk may be larger by what a step can hide.
    """
    count = 40
    before = np.tril(np.ones((count, count)))  # a after step i is h times the sum of the jerks until then

    def feasible(time: float, most: float) -> bool:
        h = time / count
        left = (count - 1 - np.arange(count)) * h  # s after each step
        final = np.array(
            [h * np.ones(count), h * (left + h / 2), h * (left**2 / 2 + left * h / 2 + h**2 / 6)]
        )
        wanted = -np.array([0.0, rate, distance + rate * time])
        A = np.vstack([h * before, -h * before])
        found = linprog(
            np.zeros(count), A, np.full(2 * count, acceleration), final, wanted, (-most, most), method="highs"
        )
        return found.status == 0

    low, high = (
        0.0,
        4 * (abs(rate) / acceleration + math.sqrt(abs(distance) / acceleration) + acceleration / jerk + 1),
    )
    assert feasible(high, jerk)
    while high - low > 1e-3 * high:
        middle = (low + high) / 2
        low, high = (low, middle) if feasible(middle, jerk) else (middle, high)
    return low, high


def test_with_bounded_jerk_it_is_the_fastest():
    """Not slower than any jerk that is constant for 1/40 of the time, and faster than that by 3 % at most."""
    for k, (acceleration, distance, rate, *_) in enumerate(starts(6)):
        jerk = acceleration * (1.0, 4.0, 0.5)[k % 3]
        generator = ReferenceApproach(acceleration, SETTLING, jerk)
        generator.start(distance, rate, 0.0)
        time, (low, high) = generator._plan[:, 0].sum(), least_time(distance, rate, acceleration, jerk)
        assert 0.97 * low < time < high * (1 + 1e-9), (time, low, high)


def test_jerk_is_bounded_and_the_end_is_at_rest():
    """Acceleration and jerk within their bounds, the derivatives those of the distance,
    for the distance and the speed."""
    for acceleration, distance, rate, speed, final in starts(40):
        jerk = acceleration * 3.0
        rows = led(
            CompiledApproach(acceleration, SETTLING, jerk=jerk),
            distance,
            rate,
            speed,
            final,
            30.0 / acceleration + 4.0,
        )
        y, y_rate, y_acceleration, v, v_rate = rows.T
        for a in (y_acceleration, v_rate):
            assert np.abs(a).max() <= acceleration * (1 + 1e-12) and np.abs(
                np.diff(a)
            ).max() <= STEP * jerk * (1 + 1e-9)
        for value, derivative, most in (
            (y, y_rate, acceleration),
            (y_rate, y_acceleration, jerk),
            (v, v_rate, jerk),
        ):
            assert (
                np.abs(np.diff(value) - STEP * (derivative[1:] + derivative[:-1]) / 2).max()
                < STEP**2 * most / 2
            )
        assert np.abs(rows[0, :3] - [distance, rate, 0.0]).max() < 1e-12 * (1 + abs(distance))
        assert (rows[-1, :3] == 0).all() and abs(v[-1] - final) < 1e-3 * (1 + acceleration)


@pytest.mark.parametrize("jerk", [0.0, 2.0])
@pytest.mark.parametrize("scalar", ["double", "float"])
def test_c_is_the_reference(scalar, jerk):
    tolerance = 1e-12 if scalar == "double" else 1e-3
    for acceleration, *start in starts(15):
        c, reference = (
            CompiledApproach(acceleration, SETTLING, scalar, jerk=jerk),
            ReferenceApproach(acceleration, SETTLING, jerk),
        )
        both = [led(generator, *start, 4.0) for generator in (c, reference)]
        assert np.abs(both[0] - both[1])[:, [0, 1, 3]].max() < tolerance * 10


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_refused(scalar):
    made = runtime("noslip_approach.h")
    self, desired = made.new("noslip_approach", scalar), made.new("noslip_approached", scalar)

    def call(name, *arguments):
        return made.status(made.function(f"noslip_approach_{name}", scalar)(self, *arguments))

    def refuses(status, name, *arguments):
        """The call returns the status, and what is desired is zero."""
        made.ffi.buffer(desired)[:] = b"\xff" * made.ffi.sizeof(desired[0])
        assert call(name, *arguments, desired) == status
        assert [getattr(desired, field) for field, _ in made.ffi.typeof(desired[0]).fields] == [0.0] * 5

    refuses("not_ready", "step", 0.01, 1.0)
    refuses("not_ready", "within", 1.0, 0.0)
    for acceleration, settling, jerk in (
        (0, 1, 0),
        (1, 0, 0),
        (math.nan, 1, 0),
        (1, math.inf, 0),
        (1, 1, -1),
        (1, 1, math.nan),
        (1, 1, math.inf),
        (1e10, *((1e10, 1e20) if scalar == "float" else (1e140, 1e40))),  # jerk settling^2 overflows
        (1e-36 if scalar == "float" else 1e-306, 1, 1e6),  # their quotient is denormalized
    ):
        assert (
            call("init", acceleration, settling, jerk) == "bad_parameter"
            and call("start", 1, 0, 0) == "not_ready"
        )
    assert call("init", 0.5, 0.25, 0.0) == "ok"
    assert [getattr(self.desired, name) for name, _ in made.ffi.typeof(desired[0]).fields] == [0.0] * 5
    assert call("start", math.nan, 0, 0) == "nonfinite" and call("start", 1, 0, 0) == "ok"
    for dt, speed, status in (
        (math.nan, 1, "nonfinite"),
        (0.01, math.inf, "nonfinite"),
        (-0.01, 1, "range"),
        (0.26, 1, "range"),
    ):
        refuses(status, "step", dt, speed)
    for speed, rate in ((-math.inf, 0.0), (math.nan, 0.0), (-1.0, math.nan)):
        refuses("nonfinite", "within", speed, rate)
        assert self.desired.speed == 0.0 and self.desired.speed_rate == 0.0
    assert call("step", 0.0, 1.0, desired) == "ok" and desired.distance == 1.0


def test_the_path_is_reached_sooner_and_the_wheels_roll():
    """The paper's start at mu 0.7, where the distance alone decides: 5 cm after 3 s instead of 7 s."""
    text = SPEC.replace("2.0, period", "9.0, period") + '[contact]\nmu = 0.7\n[limits]\nmode = "grip"\n'
    after = {}
    approach = "speed = 1.414, approach = { acceleration = 0.5 }"
    for name, given in {"without": text, "with": text.replace("speed = 1.414", approach)}.items():
        run = simulate(spec_of(given, "test"))
        far = np.abs(run.y[:, 0]) > 0.05
        after[name] = run.t[far].max()
        assert max(use.max() for use in run.use.values()) < 0.96
    assert after["with"] < 3.5 < 6.5 < after["without"], after


POINT = """
robot = "labmate"
output = { type = "I", L = 0.3 }
gains = { kp = 4.0, kd = 4.0 }
reference = { position = [1.0, 2.0], velocity = [0.3, 0.1], approach = { acceleration = 0.4 } }
initial = { point = [0.0, 0.0], heading = 0.5, speed = 0.5 }
contact = { mu = 0.5 }
simulation = { duration = 12.0, period = 0.01 }
"""
HEADING = (
    POINT.replace('"I"', '"II"').replace("[1.0, 2.0]", "[1.0, 7.0]").replace("0.4 }", "0.4, angular = 0.7 }")
)
HEADING = HEADING.replace("[0.3, 0.1]", "[0.3, 0.0]")
CUSP = """
robot = "labmate"
output = { type = "IV", L = 0.2, reversing = "switch", path = { kind = "composite", stop = "axle", segments \
= [
  { kind = "line", from = [0, 0], to = [3, 0] },
  { kind = "arc", heading = 3.141592653589793, radius = 2, angle = 1.5, backward = true },
  ] } }
gains = { kp = 4.0, kd = 4.0, kv = 2.0 }
reference = { speed = 1.0, deceleration = 0.5, approach = { acceleration = 0.4 } }
initial = { point = [0.5, 1.0], heading = 0.5, speed = 0.0 }
sensors = { noise = { mean = [0.05, -0.02] } }
correction = { rate = 0.3 }
contact = { mu = 0.5 }
simulation = { duration = 14.0, period = 0.01 }
"""


@pytest.mark.parametrize("text", [POINT, HEADING, CUSP], ids=["point", "heading", "path"])
def test_references_lead_from_where_the_robot_is(text):
    """Of every output of relative degree 2: no jump but to the measured output,
    its rate and at most the acceleration."""
    loop, desired, found, jumps = make_loop(spec_of(text, "test")), [], [], []
    guidance, law = loop.guidance, loop.law
    update = guidance.update

    def watched(t: float, x: np.ndarray) -> None:
        update(t, x)
        desired.append(guidance.reference(t, x))
        found.append(approached_from(law)(x, loop.believed, guidance.leg.config).full().ravel())

    guidance.update = watched
    rows = list(sampled(loop, spec_of(text, "test").simulation))
    names = [q.name for q in law.reference]
    wanted, seen, outputs = np.array(desired), np.array(found), len(law.output.rows)
    units = [
        row.unit
        for row, degree in zip(law.output.rows, law.linearization.relative_degree, strict=True)
        if degree == 2
    ]
    most = [0.7 if unit == "rad" else 0.4 / math.sqrt(units.count("m")) for unit in units]
    for k, limit in enumerate(most):
        entry = names.index(law.output.rows[k].name)
        y, rate, acceleration = wanted[:, entry : entry + 3].T
        turns = np.round((y[1:] - y[:-1]) / (2 * math.pi)) if units[k] == "rad" else 0.0
        jumped = (
            np.abs(np.diff(y) - 2 * math.pi * turns - STEP * rate[:-1] - STEP**2 * acceleration[:-1] / 2)
            > 1e-9
        )
        again = np.flatnonzero(jumped) + 1
        assert np.abs(y[again] - seen[again, k]).max(initial=0.0) < 1e-12, (
            "it does not begin where the robot is"
        )
        assert np.abs(rate[again] - seen[again, outputs + k]).max(initial=0.0) < 1e-12
        assert np.abs(acceleration).max() <= limit * (1 + 1e-9)
        jumps.append(len(again))
    assert max(jumps) == (5 if text == CUSP else 0), "four corrections and a cusp"
    assert np.abs(rows[-1].reference[0] - wanted[-1, 0]) < 0.01
    if text == CUSP:
        speed, rate = wanted[:, 3], wanted[:, 4]
        rises = np.abs(speed[1:]) > np.abs(speed[:-1]) + 1e-12
        assert rows[-1].t == 14.0 and loop.guidance.arrived and 0.99 < np.abs(speed).max() <= 1.0
        assert (
            np.diff(np.abs(speed))[rises] <= STEP * 0.4 + 1e-12
        ).sum() >= rises.sum() - 5 and rises.sum() > 300


def test_points_and_headings_are_reached_with_less_friction():
    for text, far in ((POINT, 0.01), (HEADING, 0.01)):
        led = simulate(spec_of(text, "test"))
        bare = simulate(spec_of(re.sub(r", approach = {[^}]*}", "", text), "test"))
        assert np.abs(led.error[-1]).max() < far
        used = [max(use.max() for use in run.use.values()) for run in (led, bare)]
        assert used[0] < 0.5 * used[1], used


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_the_speed_stays_within_that_of_the_path(scalar):
    """From 0 to the speed of the path; a speed in the other direction stays."""
    for generator in (CompiledApproach(0.5, SETTLING, scalar), ReferenceApproach(0.5, SETTLING)):
        for speed, allowed, kept in (
            (1.0, 0.5, 0.5),
            (0.25, 0.5, 0.25),
            (-1.0, -0.5, -0.5),
            (-0.25, 0.5, -0.25),
            (-1, 0, 0),
        ):
            generator.start(2.0, 0.0, speed)
            before = generator.step(0.0, speed)
            found = generator.within(allowed, -3.0)
            assert found.tolist() == [*before[:3], kept, -3.0 if kept != speed else before[4]]


@pytest.mark.parametrize("text, said", [(POINT, "leave out angular"), (HEADING, "give angular")])
def test_the_acceleration_of_a_heading(text, said):
    changed = (
        text.replace(", angular = 0.7", "")
        if "angular" in text
        else text.replace("0.4 }", "0.4, angular = 1.0 }")
    )
    with pytest.raises(BadInput, match=said):
        simulate(spec_of(changed, "test"))


@pytest.mark.parametrize(
    "change, said",
    [
        (("speed = 1.414", "speed = 1.414, approach = { acceleration = 0.5, jerk = -1.0 }"), "jerk"),
        (("period = 0.01", "period = 0.0"), r"approach requires .* period > 0"),
    ],
)
def test_refused_specs(change, said):
    text = SPEC.replace("speed = 1.414", "speed = 1.414, approach = { acceleration = 0.5 }").replace(*change)
    text = text if "jerk" not in change[1] else SPEC.replace(*change)
    with pytest.raises(BadInput, match=said):
        simulate(spec_of(text, "test"))
    with pytest.raises(BadInput, match="unknown backend 'm4f'"):
        make_approach("m4f", 0.5, 0.01)
