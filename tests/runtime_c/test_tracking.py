"""Composite paths: the C in double and float against the reference in Python,
and both against what a path is."""

import ctypes
import math
import re
import subprocess
from collections.abc import Iterator
from dataclasses import fields, replace
from itertools import pairwise
from pathlib import Path

import mpmath
import noslip
import numpy as np
import pytest
from noslip.codegen.runtime import RUNTIME
from noslip.codegen.targets import STANDARD, flags
from noslip.model.segments import Segment
from noslip.simulation.controllers.controller import STATUS
from noslip.simulation.controllers.runtime import runtime
from noslip.simulation.controllers.tracking import (
    CompiledTracker,
    Guide,
    PathFault,
    Tracker,
    TrackerOptions,
    make_tracker,
)
from noslip.tests.tools import COMPILERS, HOST_CC, need

ROOT = Path(noslip.__file__).parent
DRIVERS = ROOT / "tests" / "c"
INCLUDE = [f"-I{folder}" for folder in (RUNTIME, DRIVERS)]
FLAGS = list(STANDARD)
TURN = 2 * math.pi
BACKENDS = ("casadi", "c", "cf")
# m, rad, m/s; of numbers above 1 relative to them. Coordinates are up to some 50 m, where a float is rounded
# by 2e-6 m.
CLOSE = {"casadi": 1e-11, "c": 1e-11, "cf": 2e-4}

each_backend = pytest.mark.parametrize("backend", BACKENDS)
each_seed = pytest.mark.parametrize("seed", range(60))


# -- paths ---------------------------------------------------------------------------------------------------


def chain(start: tuple[float, float, float], parts: list[tuple]) -> list[Segment]:
    """Segments joined end to start, from (curvature, length[, backward]) each;
    travel turns round where backward changes."""
    segments: list[Segment] = []
    x, y, heading = start
    for curvature, length, *rest in parts:
        backward = bool(rest and rest[0])
        if segments and segments[-1].backward != backward:
            heading += math.pi
        segments.append(Segment(x, y, heading, curvature, length, backward))
        x, y, heading = segments[-1].end
    return segments


def there_and_back(segments: list[Segment]) -> list[Segment]:
    """A closed path with two stops."""
    x, y, heading = segments[-1].end
    parts = [(-s.curvature, s.length, not s.backward) for s in reversed(segments)]
    return segments + chain((x, y, heading + math.pi), parts)


def random_path(rng: np.random.Generator) -> tuple[list[Segment], bool]:
    """Lines and arcs, some of several turns, some short; with cusps or without, open or closed,
    crossing itself or not."""

    def parts(count: int, cusps: float) -> Iterator[tuple]:
        backward = bool(rng.integers(2))
        for _ in range(count):
            curvature = 0.0 if rng.random() < 0.4 else float(rng.choice([-1, 1]) / rng.uniform(1.0, 8.0))
            length = float(rng.choice([rng.uniform(0.02, 0.3), rng.uniform(0.5, 6.0)], p=[0.2, 0.8]))
            if curvature and rng.random() < 0.15:
                length = rng.uniform(0.5, 2.5) * TURN / abs(curvature)
            yield curvature, length, backward
            backward ^= rng.random() < cusps

    start = tuple(rng.uniform(-3, 3, 3))
    kind = rng.integers(6)
    if kind == 0:  # a circle, cut anywhere
        cuts = np.diff([0, *np.sort(rng.uniform(0, 1, rng.integers(0, 5))), 1])
        radius = rng.uniform(1, 5) * rng.choice([-1, 1])
        return chain(start, [(1 / radius, cut * TURN * abs(radius)) for cut in cuts]), True
    if kind == 1:  # a figure of eight
        radius = rng.uniform(1, 5)
        return chain(start, [(1 / radius, TURN * radius), (-1 / radius, TURN * radius)]), True
    if kind == 2:  # a stadium
        line, radius = rng.uniform(0.5, 4), rng.uniform(1, 3)
        return chain(start, [(0, line), (1 / radius, math.pi * radius)] * 2), True
    if kind == 3:
        return there_and_back(chain(start, list(parts(rng.integers(1, 5), 0.2)))), True
    return chain(start, list(parts(rng.integers(1, 12), 0.3 * (kind == 4)))), False


def random_options(rng: np.random.Generator, closed: bool) -> TrackerOptions:
    ahead = rng.uniform(0, 0.3)
    return TrackerOptions(
        speed=rng.uniform(0.3, 2),
        deceleration=float(rng.choice([0, rng.uniform(0.1, 1)])),
        creep=float(rng.choice([0, rng.uniform(0.005, 0.1)])),
        L=(rng.uniform(0.05, 0.6) - ahead, -rng.uniform(0.05, 0.6) - ahead),
        W=float(rng.choice([0, rng.uniform(-0.3, 0.3)])),
        ahead=ahead,
        reversing="switch",
        stop=str(rng.choice(["point", "axle"])),
        closed=closed,
    )


def random_case(seed: int) -> tuple[np.random.Generator, list[Segment], TrackerOptions]:
    """A path that can be followed, and how."""
    rng = np.random.default_rng(seed)
    segments, closed = random_path(rng)
    options = random_options(rng, closed)
    try:
        make_tracker("casadi", segments, options)
    except PathFault as fault:
        assert fault.kind == "short", fault
        options = replace(options, stop="axle")
    return rng, segments, options


def vehicle_at(
    point: tuple[float, float, float], L: float, W: float, backward: bool, turned: float = 0.0
) -> tuple:
    """Pose of the vehicle's point that puts P_l at a point,
    the heading `turned` from the direction of travel there."""
    x, y, heading = point
    heading += turned + math.pi * backward
    cosine, sine = math.cos(heading), math.sin(heading)
    return x - L * cosine + W * sine, y - L * sine - W * cosine, heading


def start_of(segments: list[Segment], options: TrackerOptions) -> tuple:
    """The pose with P_l where the path begins."""
    backward = segments[0].backward
    return vehicle_at(segments[0].pose(0.0), options.L[backward], options.W, backward)


def beside(shape: Segment, s: float, offset: float) -> tuple[float, float, float]:
    """The point s along and `offset` to the left, and the direction of travel there."""
    x, y, heading = shape.pose(s)
    return x - offset * math.sin(heading), y + offset * math.cos(heading), heading


def shape_of(guide: Guide) -> Segment:
    """The piece that a guide says to follow."""
    return Segment(
        guide.x, guide.y, guide.heading, guide.curvature, guide.progress + guide.left, guide.backward
    )


def step_on(
    guide: Guide, options: TrackerOptions, step: float, offset: float = 0.0, turned: float = 0.0
) -> tuple:
    """The pose with P_l so much farther on the piece than a guide says, and so far beside it."""
    point = beside(shape_of(guide), guide.progress + step, offset)
    return vehicle_at(point, guide.L, options.W, guide.backward, turned)


def walk(rng: np.random.Generator, guide: Guide, options: TrackerOptions, jumps: bool) -> tuple:
    """The next pose and speed: mostly forward near the path, sometimes far, back, or somewhere else;
    often standing."""
    step = rng.choice([rng.exponential(0.3), rng.exponential(3), -rng.exponential(0.5)], p=[0.8, 0.1, 0.1])
    pose = step_on(guide, options, step, rng.normal(0, 0.1), rng.normal(0, 0.2))
    if jumps and rng.random() < 0.05:
        pose = pose[0] + rng.normal(0, 3), pose[1] + rng.normal(0, 3), rng.uniform(-10, 10)
    return *map(float, pose), float(rng.choice([0, 0.005, -0.05, rng.uniform(-2, 2)]))


def along(tracker: Tracker, start: tuple, steps: int, step: float) -> list[Guide]:
    """The guides of small steps along the path, standing at the cusps."""
    guides = [tracker.update(*start, 0.0)]
    for _ in range(steps):
        guides.append(tracker.update(*step_on(guides[-1], tracker.options, step), 0.0))
    return guides


NUMBERS = ("L", "x", "y", "heading", "curvature", "progress", "left", "remaining", "speed", "speed_rate")
NUMBERS += ("distance", "cosine", "sine", "foot_curvature")
REST = tuple(field.name for field in fields(Guide) if field.name not in NUMBERS)


def assert_same(guide: Guide, truth: Guide, close: float) -> None:
    assert [getattr(guide, name) for name in REST] == [getattr(truth, name) for name in REST]
    for name in NUMBERS:
        value, true = getattr(guide, name), getattr(truth, name)
        assert value == true or abs(value - true) <= close * max(1.0, abs(true)), (name, value, true)


# -- the C against the reference -----------------------------------------------------------------------------


@each_seed
def test_double_against_the_reference(seed):
    """Five paths a seed, 150 updates and as many looks elsewhere each."""
    for k in range(5):
        rng, segments, options = random_case(1000 * seed + k)
        reference, c = (make_tracker(backend, segments, options) for backend in ("casadi", "c"))
        pose = (*start_of(segments, options), 0.0)
        for _ in range(150):
            guide = reference.update(*pose)
            assert guide.status in ("ok", "arrived")
            assert_same(c.update(*pose), guide, CLOSE["c"])
            pose = walk(rng, guide, options, jumps=True)
            assert_same(c.look(*pose), reference.look(*pose), CLOSE["c"])


@pytest.mark.parametrize("seed", range(30))
def test_float_against_the_reference(seed):
    """Near the path, where no turn can be mistaken. The speed falls with the root of the way that remains:
    its square is compared."""
    for k in range(5):
        rng, segments, options = random_case(1000 * seed + k)
        reference, single = (make_tracker(backend, segments, options) for backend in ("casadi", "cf"))
        pose = (*start_of(segments, options), 0.5)
        for _ in range(100):
            guide, found = reference.update(*pose), single.update(*pose)
            assert abs(found.speed**2 - guide.speed**2) <= CLOSE["cf"] * max(1, 2 * options.deceleration)
            assert_same(replace(found, speed=guide.speed, speed_rate=guide.speed_rate), guide, CLOSE["cf"])
            pose = walk(rng, guide, options, jumps=False)


@each_seed
def test_never_back(seed):
    """However the vehicle is moved, the piece followed is the same or a later one; an arrival is for good."""
    rng, segments, options = random_case(seed)
    c = make_tracker("c", segments, options)
    last, arrived = -1, False
    pose = (*start_of(segments, options), 0.0)
    for _ in range(300):
        guide = c.update(*pose)
        assert guide.segment >= last or options.closed
        assert guide.arrived or not arrived
        assert not arrived or (guide.speed == 0 and not guide.changed and guide.status == "arrived")
        last, arrived = guide.segment, guide.arrived
        pose = walk(rng, guide, options, jumps=True)


# -- both against what a path is -----------------------------------------------------------------------------


@each_backend
@each_seed
def test_follows_the_path_from_beginning_to_end(backend, seed):
    """Small steps along the path: every segment in its turn, P_l no farther from it than a step leads off at
    a join. At a cusp P_l may change sides over the short ones."""
    _, segments, options = random_case(seed)
    tracker = make_tracker(backend, segments, options)
    length = sum(segment.length for segment in segments)
    guides = along(tracker, start_of(segments, options), int(length / 0.01) + 500, 0.01)
    order = [0, *(guide.segment for before, guide in pairwise(guides) if guide.segment != before.segment)]
    assert guides[0].segment == 0 and (options.closed or guides[-1].arrived)
    assert set(order) >= {k for k, segment in enumerate(segments) if segment.length > 1.2}
    if len({segment.backward for segment in segments}) == 1:
        assert all((after - before) % len(segments) == 1 for before, after in pairwise(order))
        assert max(abs(guide.distance) for guide in guides) < 0.01**2 + CLOSE[backend]


@each_backend
def test_foot_on_arcs_of_several_turns(backend):
    """Walking round: progress and distance are those that the point was made from,
    up to 3.7 turns of either sense."""
    rng = np.random.default_rng(5)
    for curvature in (0.0, 1e-9, 1e-4, -0.02, 0.3, -0.8):
        length = 3.7 * TURN / abs(curvature) if abs(curvature) > 0.01 else 40.0
        arc = Segment(*rng.uniform(-3, 3, 3), curvature, length)
        options = TrackerOptions(speed=1, L=(0.3, 0))
        tracker = make_tracker(backend, [arc], options)
        for s in np.linspace(0, 0.999 * length, 60):
            offset = float(rng.uniform(-0.5, 0.5))
            guide = tracker.update(*vehicle_at(beside(arc, s, offset), 0.3, 0.0, False, rng.normal()), 1.0)
            close = CLOSE[backend] * max(1, length / 30)
            assert abs(guide.progress - s) <= close and abs(guide.distance - offset) <= close
            assert abs(guide.left - (length - s)) <= close and abs(guide.remaining - (length - s)) <= close


@each_backend
def test_laps(backend):
    """Two hundred rounds of a circle cut in three: progress does not drift,
    and nothing remains because nothing stops."""
    circle = chain((1.0, 2.0, 0.5), [(0.5, TURN * 2 / 3)] * 3)
    tracker = make_tracker(backend, circle, TrackerOptions(speed=1, L=(0.5, 0), closed=True))
    seen = []
    for k in range(200 * 40 + 1):
        whole = k * TURN * 2 / 40
        guide = tracker.update(*vehicle_at(circle[0].pose(whole), 0.5, 0, False), 1.0)
        assert guide.remaining == math.inf and guide.speed == 1 and guide.status == "ok"
        assert (
            abs((guide.segment * TURN * 2 / 3 + guide.progress - whole + 1) % (2 * TURN) - 1) < CLOSE[backend]
        )
        seen.append(guide.segment)
    assert [a for a, b in pairwise(seen) if a != b][:6] == [0, 1, 2, 0, 1, 2]
    assert sum(a != b for a, b in pairwise(seen)) in (599, 600)


@each_backend
def test_a_path_that_crosses_itself(backend):
    """On a figure of eight, both circles meet where they begin; each is followed to its end,
    then the other."""
    eight = chain((0.0, 0.0, 0.0), [(0.5, TURN * 2), (-0.5, TURN * 2)])
    tracker = make_tracker(backend, eight, TrackerOptions(speed=1, L=(0.3, 0), closed=True))
    guides = along(tracker, vehicle_at(eight[0].pose(0.0), 0.3, 0, False), 1000, 0.1)
    for before, guide in pairwise(guides):
        if guide.segment != before.segment:
            assert (
                before.left < 0.1 + CLOSE[backend]
                and 0 <= guide.progress + CLOSE[backend] < 0.1 + 2 * CLOSE[backend]
            )
    assert sum(guide.changed for guide in guides) == 8


@each_backend
def test_one_update_passes_many_short_segments(backend):
    """To the one that P_l is on; at most once round a closed path."""
    short = chain((0.0, 0.0, 0.0), [(0.2 * (-1) ** k, 0.05) for k in range(100)])
    tracker = make_tracker(backend, short, TrackerOptions(speed=1, L=(0.2, 0)))
    for k in (0, 1, 3, 50, 98):
        guide = tracker.update(*vehicle_at(short[k].pose(0.025), 0.2, 0, False), 1.0)
        assert guide.segment == k and abs(guide.progress - 0.025) < CLOSE[backend] and guide.changed
        assert abs(guide.remaining - (99 - k) * 0.05 - 0.025) < CLOSE[backend]
    assert not tracker.update(*vehicle_at(short[98].pose(0.03), 0.2, 0, False), 1.0).changed


@each_backend
def test_an_update_passes_a_bounded_number_of_segments(backend):
    """After a jump of 10 m over pieces of 5 cm: 64 of them in each update, in order, and then the last."""
    pieces = chain((0.0, 0.0, 0.0), [(0.0, 0.05)] * 200)
    tracker = make_tracker(backend, pieces, TrackerOptions(speed=1, L=(0.2, 0)))
    found = [tracker.update(9.62, 0.01, 0.0, 1.0) for _ in range(5)]
    assert [guide.segment for guide in found] == [64, 128, 192, 196, 196]
    assert [guide.changed for guide in found] == [True, True, True, True, False]
    assert all(abs(guide.distance - 0.01) < 1e-5 and guide.status == "ok" for guide in found)


@each_backend
def test_the_way_to_the_stop_does_not_drift(backend):
    """A line of 30 m, cut into a thousand pieces: what remains is right to the rounding of the place,
    on every one of them."""
    cuts = np.sort(np.random.default_rng(6).uniform(0, 30, 999)).tolist()
    cuts = [cut for k, cut in enumerate(cuts) if k == 0 or cut > cuts[k - 1]]
    pieces = [Segment(a, 0, 0, 0, b - a) for a, b in pairwise([0.0, *cuts, 30.0])]
    tracker = make_tracker(backend, pieces, TrackerOptions(speed=1, L=(0.25, 0)))
    for k, piece in enumerate(pieces):
        x = piece.x + 0.3 * piece.length
        guide = tracker.update(x - 0.25, 0.0, 0.0, 1.0)
        assert (guide.segment == k or piece.length < 1e-4) and abs(guide.remaining - (30 - x)) < CLOSE[
            backend
        ]


@each_backend
def test_pushed_back(backend):
    """A segment that was left is not followed again; where the vehicle comes forward again,
    the way goes on."""
    path = chain((0.0, 0.0, 0.0), [(0, 2), (0.5, 2), (0, 5)])
    tracker = make_tracker(backend, path, TrackerOptions(speed=1, L=(0.3, 0)))
    assert [tracker.update(x, 0, 0, 1).segment for x in (0, 1.6, 1.8, 1.0, -3.0, 1.0)] == [0, 0, 1, 1, 1, 1]
    assert tracker.update(-3.0, 0, 0, 1).progress < 0
    end = path[2].pose(1.0)
    assert tracker.update(*vehicle_at(end, 0.3, 0, False), 1).segment == 2
    assert tracker.update(0, 0, 0, 1).segment == 2


@each_backend
def test_start_beside_the_path(backend):
    """The branch nearest to the beginning: behind it progress is negative,
    also on an arc that is almost closed."""
    arc = chain((0.0, 0.0, 0.0), [(0.5, 0.95 * TURN * 2)])
    for s in (-1.0, 3.0):
        tracker = make_tracker(backend, arc, TrackerOptions(speed=1, L=(0.3, 0)))
        guide = tracker.update(*vehicle_at(beside(arc[0], s, 0.4), 0.3, 0, False), 0.0)
        assert abs(guide.progress - s) < CLOSE[backend] and abs(guide.distance - 0.4) < CLOSE[backend]


# -- stops ---------------------------------------------------------------------------------------------------

CUSP = chain((0.0, 0.0, 0.0), [(0, 3), (0.2, 2, True)])
SWITCH = TrackerOptions(speed=1, deceleration=0.5, creep=0.02, L=(0.2, -0.9), ahead=0.3, reversing="switch")


@each_backend
def test_who_passes_the_end_has_arrived(backend):
    """Where P_l is to stop at the end itself, it is there when the arc says so,
    however the line beyond is rounded."""
    random, arrived = np.random.default_rng(222), []
    for _ in range(200):
        (arc,) = chain(
            tuple(random.uniform(-3, 3, 3)),
            [(random.choice([-1, 1]) / random.uniform(1, 4), random.uniform(0.5, 3))],
        )
        tracker = make_tracker(backend, [arc], TrackerOptions(speed=1, L=(0.2, 0)))
        guide = tracker.update(
            *vehicle_at(beside(arc, arc.length, random.uniform(-0.5, 0.5)), 0.2, 0, False), 0.5
        )
        assert guide.arrived == (guide.curvature == 0)
        arrived.append(guide.arrived)
    assert 20 < sum(arrived) < 180


@each_backend
@pytest.mark.parametrize(("stop", "run_on"), [("point", 0.0), ("axle", 0.5)])
def test_hand_over_at_a_cusp(backend, stop, run_on):
    """Drives to the stop, is told to stand, and only then to reverse with the other P_l;
    at the end of that the same."""
    close = CLOSE[backend]
    path = [replace(s, length=s.length + 0.5 * (stop == "point")) if s.backward else s for s in CUSP]
    tracker = make_tracker(backend, path, replace(SWITCH, stop=stop))
    at = lambda point: vehicle_at((point, 0.0, 0.0), 0.2, 0, False)  # noqa: E731 - P_l on the x axis
    assert tracker.update(*at(1.0), 1.0).changed
    guide = tracker.update(*at(2.9), 1.0)
    assert abs(guide.remaining - 0.1 - run_on) < close and guide.L == pytest.approx(0.2) and not guide.waiting
    if run_on:
        guide = tracker.update(*at(3.1), 0.6)
        assert guide.changed and guide.curvature == 0 and guide.segment == 0 and abs(guide.left - 0.4) < close
        assert abs(guide.x - 3) < close and abs(guide.progress - 0.1) < close and not guide.waiting
        assert (
            abs(guide.speed - math.sqrt(0.4)) < close
            and abs(guide.speed_rate + 0.5 * 0.6 / math.sqrt(0.4)) < close
        )
    guide = tracker.update(*at(3.01 + run_on), -0.05)
    assert (
        guide.waiting and not guide.backward and guide.segment == 0 and guide.speed == guide.speed_rate == 0
    )
    assert abs(guide.left - 0.03) < 1e-6 and abs(guide.remaining + 0.01) < close and guide.status == "ok"
    assert tracker.update(*at(1.0), -0.021).waiting  # moved back: the stop was reached
    looked = tracker.look(*at(3.01 + run_on), 0.02)
    assert looked.waiting and looked.left <= 1e-8 and not looked.backward
    guide = tracker.update(*at(3.0 + run_on), 0.02)
    assert guide.changed and guide.backward and guide.segment == 1 and guide.L == pytest.approx(-0.9)
    assert guide.speed < 0 and not guide.waiting
    behind = 1.1 - run_on  # P_l has moved by L[0] - L[1], and lies so far along the tangent of the next run
    assert abs(guide.progress - 5 * math.atan(behind / 5)) < close
    assert abs(guide.distance - (5 - math.hypot(5, behind))) < close
    rest = path[1].length
    assert abs(guide.remaining - (rest + (0.6 if run_on else 0) - guide.progress)) < close
    end = Segment(*path[1].end, 0.0, 1.0, True)
    guide = tracker.update(*vehicle_at(end.pose(0.6 if run_on else 0.0), -0.9, 0, True), -0.3)
    guide = tracker.update(*vehicle_at(end.pose(0.601 if run_on else 0.001), -0.9, 0, True), -0.3)
    assert guide.arrived and guide.status == "arrived" and guide.speed == 0 and guide.left == math.inf
    assert abs(guide.remaining + 0.001) < close
    assert tracker.update(*vehicle_at(path[1].pose(0.0), -0.9, 0, True), 0.0).status == "arrived"
    assert tracker.look(0, 0, 0, 0).status == "arrived"


@each_backend
@pytest.mark.parametrize("backward", [False, True])
def test_profile(backend, backward):
    """v^2 = 2 a s on the way to a stop, cruise before, creep at the end;
    the rate is the derivative along the motion."""
    path, sign = [Segment(0, 0, 0, 0, 10, backward)], -1 if backward else 1
    options = replace(SWITCH, deceleration=0.4, speed=1.2)

    def look(s: float, v: float = 0.0, **changes) -> Guide:
        tracker = make_tracker(backend, path, replace(options, **changes))
        return tracker.look(*vehicle_at((s, 0, 0), options.L[backward], 0, backward), sign * v)

    for s in (0.0, 5.0, 8.19, 8.21, 9.0, 9.9, 9.9999, 9.99999):
        wanted = math.sqrt(2 * 0.4 * (10 - s))
        close = CLOSE[backend] / min(1, wanted)
        assert abs(look(s).speed - sign * min(1.2, max(0.02, wanted))) < close
        for share in (-1.0, 0.0, 0.3, 1.0, 1.9, 3.0):
            v, h = share * wanted, 1e-7
            slope = -0.4 * min(2.0, max(0.0, share)) if 0.02 < wanted < 1.2 else 0
            assert abs(look(s, v).speed_rate - sign * slope) < 10 * close / min(1, wanted)
            if 0 < share < 2 and s < 9.99 and backend != "cf":  # a moment later
                difference = (look(s + h * v).speed - look(s - h * v).speed) / (2 * h)
                assert abs(difference - look(s, v).speed_rate) < 1e-6
    tracker = make_tracker(backend, path, options)
    found = [
        tracker.update(*vehicle_at((s, 0, 0), options.L[backward], 0, backward), sign) for s in (9.0, 5.0)
    ]
    assert found[0].speed_rate * sign < -0.1 and found[1].speed_rate == 0, "pushed back, it cruises again"
    assert look(9.9999, deceleration=0.0).speed == pytest.approx(sign * 1.2)
    assert look(9.9999, speed=0.001).speed == pytest.approx(sign * 0.001)
    assert look(10.5, creep=0.0).speed == pytest.approx(sign * 0.01)


@each_backend
def test_comes_to_stand_at_the_stop(backend):
    """The law's speed channel, v' = rate + kv (wanted - v), from rest, from cruise and too fast: it arrives
    at a creep, and the error of the speed dies out with kv."""
    for start, speed in ((0.0, 0.0), (8.5, 0.0), (0.0, 1.5), (9.0, 1.5)):
        tracker = make_tracker(backend, [Segment(0, 0, 0, 0, 10)], replace(SWITCH, speed=1.2, creep=0.02))
        s, v, dt = start, speed, 1e-3
        for _ in range(40_000):
            guide = tracker.update(*vehicle_at((s, 0, 0), 0.2, 0, False), v)
            if guide.arrived:
                break
            v += dt * (guide.speed_rate + 2.0 * (guide.speed - v))
            s += dt * v
        assert guide.arrived and 0 < v < (0.05 if start < 9 else 0.7) and abs(s - 10) < 1e-3


@each_backend
def test_left_is_smooth(backend):
    """The zero of `left` in `look` is where update goes on: found by bisection,
    it is the end of the segment."""
    path = chain((0.0, 0.0, 0.0), [(0.4, 3), (-0.4, 3)])
    tracker = make_tracker(backend, path, TrackerOptions(speed=1, L=(0.3, 0)))
    tracker.update(*vehicle_at(path[0].pose(0.0), 0.3, 0, False), 1)
    low, high = 2.0, 4.0
    for _ in range(60):
        middle = (low + high) / 2
        before = tracker.look(*vehicle_at(path[0].pose(middle), 0.3, 0, False), 1).left > 0
        low, high = (middle, high) if before else (low, middle)
    assert abs(high - 3) < CLOSE[backend]
    assert tracker.update(*vehicle_at(path[0].pose(high + CLOSE[backend]), 0.3, 0, False), 1).segment == 1


# -- errors --------------------------------------------------------------------------------------------------

BAD = [(k, value) for k in range(4) for value in (math.nan, math.inf, -math.inf)]


@each_backend
def test_errors_change_nothing(backend):
    """All zeros, and the next good update answers as if there had been none:
    also when a hand-over had begun."""
    path = chain((0.0, 0.0, 0.0), [(0, 2), (0.5, 2), (0, 3), (0.4, 2, True)])
    huge = 1e30 if backend == "cf" else 1e200
    tracker, undisturbed = (make_tracker(backend, path, replace(SWITCH, stop="axle")) for _ in range(2))
    wrong = [[value if i == k else 0.1 for i in range(4)] for k, value in BAD]
    wrong += [
        [huge, 0.0, 0.0, 0.0],
        [huge, huge, 0.0, 0.0],
        [2.0 - 0.2, 0.0, 1e30, 0.0],
        [0.0, 0.0, -2e6, 0.0],
    ]
    statuses = set()
    for s in (0.0, 1.0, 1.99, 2.5, 4.5, 6.9, 7.2, 7.51, 7.52):
        for pose in wrong:
            guides = [tracker.update(*pose), tracker.look(*pose)]
            assert guides[0] == Guide(guides[0].status)
            # a line is looked at from anywhere
            assert guides[1] == Guide(guides[1].status) or abs(pose[0]) > 1e20
            statuses.add(guides[0].status)
        where = path[0].pose(s) if s < 2 else path[1].pose(s - 2) if s < 4 else path[2].pose(s - 4)
        pose = (*vehicle_at(where, 0.2, 0, False), 0.3 if s < 7.52 else 0.0)
        assert tracker.update(*pose) == undisturbed.update(*pose)
    assert undisturbed.look(*pose).backward and statuses == {"nonfinite", "range"}


@each_backend
def test_centre_of_an_arc(backend):
    """No progress there: singular, the old one is kept, and beside the centre it is found again."""
    arc = Segment(0, 0, 0, 0.5, 2 * TURN)
    tracker = make_tracker(backend, [arc], TrackerOptions(speed=1, L=(0.5, 0)))
    for s in np.arange(0, 9, 0.5):
        before = tracker.update(*vehicle_at(arc.pose(s), 0.5, 0, False), 1)
    assert tracker.update(-0.5, 2.0, 0.0, 1) == Guide("singular") == tracker.look(-0.5, 2.0, 0.0, 1)
    again = tracker.update(*vehicle_at(beside(arc, 8.5, 1.99), 0.5, 0, False), 1)
    assert abs(again.progress - before.progress) < (1e-3 if backend == "cf" else 1e-11)


@each_backend
def test_error_on_the_next_segment_after_a_cusp(backend):
    """Once the vehicle that waits has come to stand, P_l is in the centre of the arc in reverse. It goes on
    waiting."""
    tracker, undisturbed = (make_tracker(backend, CUSP, replace(SWITCH, stop="axle")) for _ in range(2))
    beyond, rolled_back = ((*vehicle_at(CUSP[0].pose(s), 0.2, 0, False), 0.5) for s in (3.6, 3.2))
    assert tracker.update(*beyond) == undisturbed.update(*beyond)
    assert tracker.update(*vehicle_at((3.0, -5.0, math.pi), -0.9, 0, True), 0.0) == Guide("singular")
    guide = tracker.update(*rolled_back)
    assert guide == undisturbed.update(*rolled_back) and guide.waiting and guide.speed == 0


@each_backend
def test_error_on_the_next_segment(backend):
    """P_l past the end of an arc and in the centre of the next: both are as before,
    the first one's turns too."""
    arc = Segment(0, 0, 0, 0.5, 9.0)
    x, y, heading = arc.end
    heading -= 0.5  # so that the next centre lies beyond the end
    centre = x - 2 * math.sin(heading), y + 2 * math.cos(heading), heading
    tracker = make_tracker(
        backend, [arc, Segment(x, y, heading, 0.5, 1)], TrackerOptions(speed=1, L=(0.5, 0), kink=1.0)
    )
    for s in np.arange(0, 9, 0.5):
        guide = tracker.update(*vehicle_at(arc.pose(s), 0.5, 0, False), 1)
    assert tracker.update(*vehicle_at(centre, 0.5, 0, False), 1) == Guide("singular")
    assert tracker.update(*vehicle_at(arc.pose(8.5), 0.5, 0, False), 1) == guide


def test_however_far_the_wanted_speed_is_finite():
    """Found by fuzzing: what is left times the deceleration overflowed, and its root was the wanted speed."""
    for backend, far, speed in (("cf", 3e38, 1e20), ("c", 1e308, 1e160)):
        tracker = make_tracker(
            backend, [Segment(0, 0, 0, 0, 1)], TrackerOptions(speed=speed, deceleration=5, L=(0.1, 0))
        )
        guide = tracker.update(-far, 0.0, 0.0, 0.0)
        assert (
            guide.status == "ok" and 0 < guide.speed <= speed * (1 + 1e-6) and math.isfinite(guide.speed_rate)
        )


def test_however_far_what_is_told_is_finite():
    """The way to a stop that there is not is the largest number,
    also where it is added to something large."""
    stadium = chain((0.0, 0.0, 0.0), [(0, 2), (1, math.pi)] * 2)
    for backend, far in (("cf", 1e33), ("c", 1e300)):
        tracker = make_tracker(backend, stadium, TrackerOptions(speed=1, L=(0.1, 0), closed=True))
        assert tracker.update(-far, 0.0, 0.0, 0.0).status == "ok" and math.isfinite(tracker._guide.remaining)


def test_too_many_turns():
    """Backwards round the first arc without end: a status, when the angle is beyond what sines are taken
    of."""
    arc = Segment(0, 0, 0, 1.0, 1.0)
    tracker = make_tracker("cf", [arc], TrackerOptions(speed=1, L=(0.5, 0)))
    statuses = [tracker.update(*vehicle_at(arc.pose(-3.0 * k), 0.5, 0, False), 1).status for k in range(2800)]
    assert statuses[:2700] == ["ok"] * 2700 and statuses[-1] == "range"


def state_of(c, path) -> bytes:
    """All of a path but what a step notes for itself."""
    kept, note = bytearray(c.ffi.buffer(path)), path.saved
    at = c.ffi.offsetof(c.ffi.typeof(path).item, "saved")
    kept[at : at + c.ffi.sizeof(note)] = bytes(c.ffi.sizeof(note))
    return bytes(kept)


@pytest.mark.parametrize("scalar", ["double", "float"])
@pytest.mark.parametrize("seed", range(20))
def test_a_step_is_an_update(scalar, seed):
    """noslip_path_step, given cosine and sine, leaves in the path what update answers; on an error,
    all as it was."""
    rng, segments, options = random_case(seed)
    c, (one, other) = runtime("noslip_path.h"), (CompiledTracker(segments, options, scalar) for _ in range(2))
    sine, cosine, direction = (c.array(scalar, [0.0] * count) for count in (1, 1, 2))
    path, told, fields = other._self, one._guide, one._fields
    guide = one.update(*start_of(segments, options), 0.5)
    c.function("noslip_path_update", scalar)(path, *start_of(segments, options), 0.5, other._guide)
    for k in range(150):
        pose = list(walk(rng, guide, options, jumps=True))
        if k % 10 == 9:
            pose[rng.integers(4)] = rng.choice([math.nan, math.inf, -math.inf])
        if k % 10 == 4:
            pose[rng.integers(2)] = 1e38
        c.function("noslip_sincos", scalar)(pose[2], sine, cosine)
        direction[0], direction[1] = cosine[0], sine[0]
        before = state_of(c, path)
        found = one.update(*pose)
        status = c.status(c.function("noslip_path_step", scalar)(path, pose[0], pose[1], direction, pose[3]))
        assert status == found.status
        if found.status in ("ok", "arrived"):
            guide = found
            assert [getattr(path.guide, field) for field in fields] == [
                getattr(told, field) for field in fields
            ]
            assert numbers_of(c, path.guide.foot) == numbers_of(c, told.foot)
        else:
            assert state_of(c, path) == before


def numbers_of(c, struct) -> list:
    """All that is in a struct and in the structs in it."""
    members = [
        getattr(struct, name)
        for name, _ in (
            c.ffi.typeof(struct).item if "*" in str(c.ffi.typeof(struct)) else c.ffi.typeof(struct)
        ).fields
    ]
    return [
        number
        for member in members
        for number in (numbers_of(c, member) if isinstance(member, c.ffi.CData) else [member])
    ]


@pytest.mark.parametrize(("scalar", "suffix"), [("double", ""), ("float", "_f")])
def test_null_and_never_made(scalar, suffix):
    c = runtime("noslip_path.h")
    null, segments = c.ffi.NULL, c.ffi.new(f"noslip_segment{suffix}[]", [{"length": 1}])
    options = c.new("noslip_path_options", scalar, {"speed": 1, "L": [0.1, 0]})
    path, guide, fault = (c.new(f"noslip_{kind}", scalar) for kind in ("path", "guide", "path_fault"))

    def call(name: str, *arguments) -> str:
        return c.status(c.function(f"noslip_path_{name}", scalar)(*arguments))

    for k in (0, 1, 3):
        assert call("init", path, segments, 1, options, null) == "ok"
        given = [path, segments, 1, options]
        given[k] = null
        assert call("init", *given, fault) == "null"
        assert call("update", path, 0, 0, 0, 0, guide) == ("not_ready" if k else "ok")
    assert call("init", path, segments, 1, options, fault) == "ok"
    assert (fault.kind, fault.segment, fault.size) == (0, -1, 0)
    for name in ("look", "update"):
        assert call(name, path, 0, 0, 0, 0, null) == "null"
        never = c.new("noslip_path", scalar)
        for wrong, status in (
            (null, "null"),
            *((content, "not_ready") for content in (b"\0", b"\xff", b"\x01")),
        ):
            if wrong != null:
                c.ffi.buffer(never)[:] = wrong * len(c.ffi.buffer(never))
            c.ffi.buffer(guide)[:] = b"\xff" * len(c.ffi.buffer(guide))
            assert call(name, null if wrong == null else never, 0, 0, 0, 0, guide) == status
            assert set(numbers_of(c, guide)) == {0}


def test_status_names():
    """Python's names are the C's."""
    header = (RUNTIME / "noslip_status.h").read_text()
    enumerators = re.findall(r"^    NOSLIP_(\w+) = (-?\d+)", header.split("};")[0], re.M)
    assert {name.lower().replace("grip_limited", "grip") for name, _ in enumerators} == set(STATUS)
    for name, number in enumerators:
        assert runtime("noslip_path.h").status(int(number)) == name.lower().replace("grip_limited", "grip")


# -- refused paths -------------------------------------------------------------------------------------------

LINE = Segment(0, 0, 0, 0, 1)
ON = TrackerOptions(speed=1, L=(0.2, -0.4), ahead=0.1, reversing="switch")
R = Segment(1, 0, math.pi, 0, 2, True)
REFUSED = {
    "empty": ([], ON, ("empty", -1, 0), "no segments"),
    "zero length": (
        [LINE, Segment(1, 0, 0, 0, 0)],
        ON,
        ("length", 1, 0),
        "segment 2: its length, 0 m, is not positive",
    ),
    "negative length": ([replace(LINE, length=-2)], ON, ("length", 0, -2), "segment 1: its length, -2 m"),
    "gap": (
        [LINE, Segment(1.03, 0.04, 0, 0, 1)],
        ON,
        ("gap", 1, 0.05),
        "segment 2 begins 0.05 m from the end of segment 1",
    ),
    "gap given": ([LINE, Segment(1.03, 0.04, 0, 0, 1)], replace(ON, gap=0.04), ("gap", 1, 0.05), "0.05 m"),
    "kink": (
        [LINE, Segment(1, 0, -0.02, 0, 1)],
        ON,
        ("kink", 1, 0.02),
        "differs by 0.02 rad from that at the end of segment 1",
    ),
    "turns round": ([LINE, Segment(1, 0, math.pi, 0, 1)], ON, ("kink", 1, math.pi), "3.14 rad"),
    "no cusp": ([LINE, replace(R, heading=0)], ON, ("cusp", 1, math.pi), "off a change by pi"),
    "half a cusp": (
        [LINE, replace(R, heading=3 * math.pi - 0.3)],
        ON,
        ("cusp", 1, 0.3),
        "0.3 rad off a change by pi",
    ),
    "tight": (
        [LINE, Segment(1, 0, 0, 4, 1)],
        ON,
        ("tight", 1, 0.05),
        "radius, 0.25 m, is not more than 0.3 m",
    ),
    "just tight": (
        [replace(LINE, curvature=-2)],
        replace(ON, L=(0.5, -1), ahead=0.0),
        ("tight", 0, 0),
        "0.5 m",
    ),
    "tight in reverse": (
        [replace(R, curvature=-4)],
        replace(ON, L=(0.2, -0.6)),
        ("tight", 0, 0.25),
        "0.25 m",
    ),
    "tight beside": (
        [replace(LINE, curvature=2)],
        replace(ON, W=-0.5),
        ("tight", 0, math.hypot(0.3, 0.5) - 0.5),
        "W",
    ),
    "tight on the right": (
        [replace(LINE, curvature=-2.5)],
        replace(ON, W=0.4),
        ("tight", 0, 0.1),
        "0.5 m, which L + d and W",
    ),
    "reversing": (
        [LINE, R],
        replace(ON, reversing="refuse"),
        ("reversing", 1, 0),
        'set reversing = "switch"',
    ),
    "lever": (
        [LINE],
        replace(ON, L=(-0.3, -1)),
        ("lever", 0, -0.2),
        "L + d = -0.2 m ahead of the axle, which must be positive",
    ),
    "no lever": ([LINE], replace(ON, L=(-0.1, -1)), ("lever", 0, 0), "change L"),
    "lever in reverse": (
        [LINE, R],
        replace(ON, L=(0.2, 0.2)),
        ("lever", 1, 0.3),
        "must be negative driving in reverse",
    ),
    "short": (
        [LINE, replace(R, length=0.5)],
        ON,
        ("short", 1, 0.1),
        "0.1 m too short for P_l to change sides",
    ),
    "not closed": (
        [LINE],
        replace(ON, closed=True),
        ("gap", 0, 1),
        "segment 1 begins 1 m from the end of segment 1",
    ),
    "kink where it closes": (
        [LINE, Segment(1, 0, 0, 0.5, 1)],
        replace(ON, closed=True, gap=10.0),
        ("kink", 0, 0.5),
        "at the end of segment 2",
    ),
    "short where it closes": (
        there_and_back([replace(LINE, length=0.5)]),
        replace(ON, closed=True),
        ("short", 1, 0.1),
        "segment 2",
    ),
    "large angle": ([replace(LINE, heading=2e6)], ON, ("nonfinite", 0, 2e6), "2e+06 rad is too large"),
    "many turns": (
        [replace(LINE, curvature=2.0, length=1e6)],
        ON,
        ("nonfinite", 0, 2e6),
        "subtract whole turns",
    ),
}
SIZE = {"casadi": 1e-12, "c": 1e-12, "cf": 5e-6}


@each_backend
@pytest.mark.parametrize("name", REFUSED)
def test_refused_paths(backend, name):
    segments, options, (kind, segment, size), sentence = REFUSED[name]
    with pytest.raises(PathFault) as refused:
        make_tracker(backend, segments, options)
    found = refused.value
    assert (found.kind, found.segment) == (kind, segment)
    assert abs(found.size - size) <= SIZE[backend] * max(1, abs(size))
    assert "\n" not in str(found)
    assert sentence in str(found) or backend == "cf"


@each_backend
@pytest.mark.parametrize("name", ["x", "y", "heading", "curvature", "length"])
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_not_finite_paths(backend, name, bad):
    with pytest.raises(PathFault, match="segment 2: .* not finite") as refused:
        make_tracker(backend, [LINE, replace(LINE, **{name: bad})], ON)
    assert (refused.value.kind, refused.value.segment, refused.value.size) == ("nonfinite", 1, 0)


@each_backend
@pytest.mark.parametrize(
    "name", ["speed", "deceleration", "creep", "gap", "kink", "L", "W", "ahead", "reversing", "stop"]
)
def test_refused_options(backend, name):
    wrong = {"L": [(math.nan, 0), (0.1, math.inf)], "W": [math.nan, -math.inf], "ahead": [math.inf]}
    wrong |= {"speed": [0.0, -1.0, math.nan, math.inf], "reversing": ["allow"], "stop": ["wheel"]}
    for bad in wrong.get(name, [-1.0, math.nan, math.inf]):
        with pytest.raises(PathFault, match=f"^path: {name}.* = ") as refused:
            make_tracker(backend, [LINE], replace(ON, **{name: bad}))
        assert refused.value.kind == "options"


@each_backend
def test_largest_gap_and_kink(backend):
    """Just within what is given, and within the defaults."""
    make_tracker(backend, [LINE, Segment(1.03, 0.04, 0.09, 0, 1)], replace(ON, gap=0.0501, kink=0.0901))
    default = 0.9e-4 if backend == "cf" else 0.9e-6
    make_tracker(backend, [LINE, Segment(1 + default, 0, default, 0, 1)], ON)
    with pytest.raises(PathFault):
        make_tracker(backend, [LINE, Segment(1 + 2 * default, 0, 0, 0, 1)], ON)
    with pytest.raises(PathFault):
        make_tracker(backend, [LINE, Segment(1, 0, 2 * default, 0, 1)], ON)


@each_backend
def test_whole_turns_between_headings_are_no_kink(backend):
    turned = [
        Segment(0, 0, 100 * TURN, 0, 1),
        Segment(1, 0, 0, 0, 1),
        Segment(2, 0, -7 * math.pi, 0, 2, True),
    ]
    make_tracker(backend, turned, ON)


@each_backend
def test_tight_is_where_no_axle_can_go(backend):
    """P_l on an arc: the axle goes round the same centre at a radius that solves lever^2 + (radius -
    inward)^2 = R^2; there is a positive one just when the arc is taken. Forward and in reverse, to the left
    and to the right."""
    rng = np.random.default_rng(3)
    kinds = set()
    for _ in range(400):
        lever, W, radius = rng.uniform(0.05, 1), rng.uniform(-1, 1), rng.uniform(0.05, 2)
        backward, left = (bool(flag) for flag in rng.integers(2, size=2))
        options = TrackerOptions(speed=1, L=(lever - 0.1, -lever - 0.1), W=W, ahead=0.1, reversing="switch")
        # In the vehicle's frame (x ahead, y to the left) the axle turns about (0, c): left of it if it goes
        # left of travel.
        side = 1 if left != backward else -1
        roots = np.roots([1, -2 * W, W**2 + lever**2 - radius**2])  # (c - W)^2 + lever^2 = R^2
        possible = any(abs(root.imag) < 1e-12 and side * root.real > 0 for root in roots)
        segment = Segment(0, 0, 0, (1 if left else -1) / radius, 0.1, backward)
        try:
            make_tracker(backend, [segment], options)
            kinds.add((backward, left))
            assert possible
        except PathFault as fault:
            assert fault.kind == "tight" and not possible
    assert len(kinds) == 4


# -- the C by itself -----------------------------------------------------------------------------------------


def run(command: list[str], **options) -> str:
    result = subprocess.run(command, capture_output=True, text=True, timeout=120, **options)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def test_atan2_sweep(tmp_path):
    program = str(tmp_path / "trig_sweep")
    run([HOST_CC, *FLAGS, "-O2", *INCLUDE, str(DRIVERS / "trig_sweep.c"), "-lm", "-o", program])
    run([program, "atan2", "2000000", "1992"])


@pytest.fixture(scope="module")
def atan2(tmp_path_factory):
    """noslip_atan2 and noslip_atan2_f, callable."""
    folder = tmp_path_factory.mktemp("atan2")
    (folder / "a.c").write_text(
        '#include "noslip_trig.h"\n'
        "double wide(double y, double x) { return noslip_atan2(y, x); }\n"
        "float narrow(float y, float x) { return noslip_atan2_f(y, x); }\n"
    )
    run(
        [
            HOST_CC,
            *FLAGS,
            "-O2",
            *INCLUDE,
            "-shared",
            "-fPIC",
            str(folder / "a.c"),
            "-o",
            str(folder / "a.so"),
        ]
    )
    library = ctypes.CDLL(str(folder / "a.so"))
    for name, kind in (("wide", ctypes.c_double), ("narrow", ctypes.c_float)):
        function = getattr(library, name)
        function.restype, function.argtypes = kind, [kind, kind]
    return library


def test_atan2_against_mpmath(atan2):
    rng = np.random.default_rng(2)
    with mpmath.workdps(40):
        for _ in range(3000):
            y, x = (
                float(v) for v in rng.normal(size=2) * 10.0 ** rng.choice([rng.uniform(-30, 30, 2), [0, 0]])
            )
            assert abs(atan2.wide(y, x) - mpmath.atan2(y, x)) < 2 * np.finfo(float).eps
            y, x = float(np.float32(y)), float(np.float32(x))
            assert abs(atan2.narrow(y, x) - mpmath.atan2(y, x)) < 3 * np.finfo(np.float32).eps


def test_atan2_is_exact_on_the_axes(atan2):
    for size in (5e-324, 1e-310, 1e-30, 1.0, 1e30, 1.7e308):
        exact = {(0, 1): 0, (1, 0): math.pi / 2, (0, -1): math.pi, (-1, 0): -math.pi / 2, (1, 1): math.pi / 4}
        exact |= {(1, -1): 3 * math.pi / 4, (-1, -1): -3 * math.pi / 4, (-1, 1): -math.pi / 4}
        for (y, x), angle in exact.items():
            assert atan2.wide(y * size, x * size) == angle
    for function in (atan2.wide, atan2.narrow):
        assert function(0.0, 0.0) == function(-0.0, -0.0) == function(0.0, -0.0) == 0
        assert function(-0.0, -1.0) == function(0.0, -1.0) > 3.14  # the sign of a zero does not count
        assert (
            math.isnan(function(math.nan, 1))
            and math.isnan(function(1, math.nan))
            and math.isnan(function(math.nan, math.nan))
        )


@pytest.mark.parametrize(("scalar", "bound"), [("double", 7e-16), ("float", 4e-7)])
def test_angle_of_a_vector_of_known_length(scalar, bound):
    rng, function = np.random.default_rng(3), runtime("noslip_path.h").function("noslip_angle_of", scalar)
    kind = {"double": np.float64, "float": np.float32}[scalar]
    for k in range(4000):
        angle = (
            rng.uniform(-math.pi, math.pi)
            if k % 2
            else rng.integers(-4, 5) * math.pi / 4 + rng.normal(0, 1e-4)
        )
        y, x = (rng.uniform(0.001, 1000) * np.array([math.sin(angle), math.cos(angle)])).astype(kind)
        length = float(np.sqrt(x * x + y * y))
        found, true = function(float(y), float(x), length), math.atan2(float(y), float(x))
        assert abs(found - true) < bound and function(-float(y), float(x), length) == -found
    assert function(0.0, 1.0, 1.0) == 0 and function(0.0, -1.0, 1.0) == kind(math.pi)


M4F = list(flags("cortex-m4f"))


def test_stack_and_symbols_on_the_target(tmp_path):
    """No function of the float side takes more than 128 bytes, of the double side 256;
    the float side calls nothing."""
    need("arm-none-eabi-gcc")
    for name, most in (("noslip_path_f", 128), ("noslip_path", 256)):
        made = tmp_path / f"{name}.o"
        run(
            [
                "arm-none-eabi-gcc",
                *M4F,
                *FLAGS,
                "-O2",
                "-fstack-usage",
                *INCLUDE,
                "-c",
                str(RUNTIME / f"{name}.c"),
                "-o",
                str(made),
            ]
        )
        used = [line.split("\t") for line in made.with_suffix(".su").read_text().splitlines()]
        assert used and all(int(size) <= most and kind == "static" for _, size, kind in used), used
        missing = {line.split()[-1] for line in run(["arm-none-eabi-nm", "-u", str(made)]).splitlines()}
        assert (
            not missing if name.endswith("_f") else all(symbol.startswith("__aeabi_") for symbol in missing)
        )


FUZZ = """
#include <stdio.h>
#include <string.h>
#include "noslip_path.h"
#include "trig_digest.h"

/* Ordinary numbers, special ones, and any bits. */
static REAL any(uint64_t *random, int tame)
{
    static const REAL special[] = {0, -0.0F, 1, -1, 1e-30F, 1e30F, 3e38F, -3e38F, 8192, -8193, 3.1415927F};
    const uint64_t kind = trig_random(random) >> 40, u = trig_random(random);
    REAL value;
    if (tame || kind % 16 > 1) {
        return (REAL)((double)(int64_t)(u >> 11) / 4503599627370496.0 - 1.0) * 3;
    }
    if (kind % 16 == 0) {
        return special[u % (sizeof special / sizeof *special)];
    }
    memcpy(&value, &u, sizeof value);
    return value;
}

int main(void)
{
    uint64_t random = 11, hash = 0;
    long status[12] = {0}, k;
    for (k = 0; k < N; k++) {
        NAME(noslip_segment) segments[4];
        NAME(noslip_path_options) options;
        NAME(noslip_path_fault) fault;
        NAME(noslip_path) path;
        NAME(noslip_guide) guide;
        const int tame = k % 4 > 0;
        int i, j, answer, count = 1 + (int)(k % 4);
        memset(&options, 0, sizeof options);
        options.speed = noslip_abs_REAL(any(&random, tame));
        options.deceleration = noslip_abs_REAL(any(&random, tame));
        options.L[0] = tame ? 0.1F : any(&random, 0);
        options.L[1] = tame ? -0.1F : any(&random, 0);
        options.W = tame ? 0 : any(&random, 0);
        options.reversing = 1;
        options.stop = 1;
        options.gap = options.kink = 1e30F; /* so that random segments make paths */
        options.closed = (int)(k / 4 % 2);
        for (i = 0; i < count; i++) {
            segments[i].x = any(&random, tame);
            segments[i].y = any(&random, tame);
            segments[i].heading = any(&random, tame);
            segments[i].curvature = any(&random, tame);
            segments[i].length = noslip_abs_REAL(any(&random, tame));
            segments[i].backward = tame ? (int)(k / 8 % 2) : (int)(trig_random(&random) >> 63);
        }
        answer = NAME(noslip_path_init)(&path, segments, count, &options, &fault);
        if (!IS_FINITE(fault.size) || (answer == 0) != (fault.kind == 0)) {
            return 1;
        }
        status[answer + 8]++;
        for (j = 0; answer == 0 && j < 40; j++) {
            const REAL x = any(&random, 0) * 4, y = any(&random, 0) * 4, heading = any(&random, 0),
                v = any(&random, 0);
            const REAL *value = &guide.L;
            int found;
            memset(&guide, 0xff, sizeof guide);
            found = j % 3 ? NAME(noslip_path_update)(&path, x, y, heading, v, &guide)
                          : NAME(noslip_path_look)(&path, x, y, heading, v, &guide);
            status[found + 8]++;
            for (i = 0; i < 11; i++) {
                NAME(noslip_bits) bits;
                bits.value = value[i];
                hash = trig_fnv(hash, bits.bits);
                if (!IS_FINITE(value[i]) || (found < 0 && (value[i] < 0 || value[i] > 0))) {
                    return 2;
                }
            }
            if (guide.segment < 0 || guide.segment >= count || guide.arrived + guide.waiting > 1) {
                return 3;
            }
        }
    }
    for (k = 0; k < 12; k++) {
        printf("%s %ld\\n", noslip_status_name((int)k - 8), status[k]);
    }
    printf("digest %016llx\\n", (unsigned long long)hash);
    return 0;
}
"""


@pytest.fixture(params=["double", "float"])
def fuzz(request, tmp_path):
    """Builds the program with a compiler and flags, and runs it: what it counted."""
    suffix = "_f" if request.param == "float" else ""
    text = FUZZ.replace("noslip_abs_REAL", f"noslip_abs{suffix}").replace(
        "IS_FINITE", f"noslip_is_finite{suffix}"
    )
    text = re.sub(r"NAME\((\w+)\)", rf"\1{suffix}", re.sub(r"\bREAL\b", request.param, text))
    (tmp_path / "fuzz.c").write_text(text)
    sources = [str(tmp_path / "fuzz.c"), *map(str, sorted(RUNTIME.glob("*.c")))]

    def build_and_run(compiler: str, *flags: str) -> dict[str, str]:
        run([need(compiler), *FLAGS, *flags, *INCLUDE, *sources, "-o", str(tmp_path / "fuzz")])
        return dict(line.split() for line in run([str(tmp_path / "fuzz")]).splitlines())

    return build_and_run


def test_random_input(fuzz, tmp_path):
    """Random paths and poses, also of any bits, under the sanitizers: a status, and every number finite,
    zero on an error."""
    (tmp_path / "probe.c").write_text("int main(void) { return 0; }\n")
    checks = "-fsanitize=address,undefined,float-cast-overflow"
    probe = subprocess.run(
        [HOST_CC, checks, str(tmp_path / "probe.c"), "-o", str(tmp_path / "probe")], capture_output=True
    )
    counted = fuzz(
        HOST_CC,
        "-DN=20000",
        "-O1",
        "-g",
        *([] if probe.returncode else [checks, "-fno-sanitize-recover=all"]),
    )
    for name in ("ok", "arrived", "nonfinite", "range", "bad_parameter", "bad_path"):
        assert int(counted[name]) > 20, counted


def test_same_bits(fuzz):
    """From both compilers, at the lowest and the highest level, and with fused operations at hand."""
    info = Path("/proc/cpuinfo")
    fused = ["-mfma"] if info.exists() and "fma" in info.read_text(encoding="utf-8").split() else []
    builds = [(compiler, level) for compiler in COMPILERS for level in ("-O0", "-O3")]
    counted = [
        fuzz(compiler, "-DN=2000", level, *(fused if level == "-O3" else [])) for compiler, level in builds
    ]
    assert counted and all(found == counted[0] for found in counted)
