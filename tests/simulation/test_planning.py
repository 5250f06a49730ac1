"""Paths of lines and arcs: Dubins and Reeds-Shepp, biarcs, tables, `noslip plan`."""

import cmath
import itertools
import json
import math
import re
import subprocess
import tomllib
from pathlib import Path

import noslip
import numpy as np
import pytest
from noslip.cli.main import main
from noslip.codegen.printing.scalar import SCALARS
from noslip.codegen.runtime import RUNTIME
from noslip.model.segments import Segment
from noslip.readers.errors import BadInput
from noslip.simulation.controllers.tracking import CompiledTracker, TrackerOptions
from noslip.simulation.planning import dubins, fit, reeds_shepp, segments_from_tables
from noslip.simulation.planning.tables import c_array, toml
from noslip.tests.tools import HOST_CC
from scipy.interpolate import CubicSpline, make_interp_spline
from scipy.spatial import cKDTree

ROOT = Path(noslip.__file__).parent
PI = math.pi
ORIGIN = (0.0, 0.0, 0.0)
CLOSE = 1e-9  # m, rad


def length(path: list[Segment]) -> float:
    return sum(segment.length for segment in path)


def drive(pose: tuple[float, float, float], curvature: float, way: float) -> tuple[float, float, float]:
    """The vehicle's pose after an arc about its centre, or a line; `way` is negative backward,
    curvature is the vehicle's."""
    place, heading = complex(pose[0], pose[1]), pose[2]
    if curvature:
        centre = place + 1j / curvature * cmath.exp(1j * heading)
        place = centre + (place - centre) * cmath.exp(1j * curvature * way)
    else:
        place += way * cmath.exp(1j * heading)
    return place.real, place.imag, heading + curvature * way


def apart(a, b) -> float:
    """The largest difference of two poses, m or rad."""
    return max(abs(a[0] - b[0]), abs(a[1] - b[1]), abs(math.remainder(a[2] - b[2], 2 * PI)))


def random_cases(count: int, seed: int):
    """Start, goal and radius; near and far goals."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        radius = 10 ** rng.uniform(-1, 1.5)
        start = np.array([*rng.uniform(-50, 50, 2), rng.uniform(-7, 7)])
        far = radius * rng.choice([0.1, 1, 3, 10])
        yield tuple(start), (*(start[:2] + rng.uniform(-far, far, 2)), rng.uniform(-7, 7)), radius


# -- Dubins and Reeds-Shepp ----------------------------------------------------------------------------------

PLANNERS = (dubins, reeds_shepp)
SIDES = (-1, 1)


def check_path(path, start, goal, radius, plan) -> None:
    """The vehicle drives it from start to goal in one go, on lines and arcs of the radius, none empty,
    none to be merged."""
    at = start
    for segment in path:
        sign = -1 if segment.backward else 1
        assert (
            apart((segment.x, segment.y, segment.heading), (at[0], at[1], at[2] + PI * segment.backward))
            <= CLOSE
        )
        assert segment.length > 0 and (
            segment.curvature == 0 or math.isclose(abs(segment.curvature) * radius, 1.0)
        )
        at = drive(at, sign * segment.curvature, sign * segment.length)
    assert apart(at, goal) <= CLOSE
    kinds = [(segment.backward, np.sign(segment.curvature)) for segment in path]
    assert all(a != b for a, b in itertools.pairwise(kinds))
    assert len(path) <= (5 if plan is reeds_shepp else 3)
    assert plan is reeds_shepp or not any(segment.backward for segment in path)


@pytest.mark.parametrize("plan", PLANNERS)
def test_leads_from_pose_to_pose(plan):
    for start, goal, radius in random_cases(300, 1):
        check_path(plan(start, goal, radius), start, goal, radius, plan)


def shortest_by_tangents(goal) -> float:
    """Length of the shortest Dubins path from the origin at radius 1, from the points where circles touch.

    All tangents and all middle circles are tried on all sides, driven, and those that arrive are measured.
    """
    place, end = complex(goal[0], goal[1]), goal[2]
    candidates = []
    for first, last in itertools.product(SIDES, SIDES):
        a, b = 1j * first, place + 1j * last * cmath.exp(1j * end)
        gap = abs(b - a)
        for lean in SIDES if gap >= 2 else [0]:
            along = cmath.phase(b - a) + (0 if first == last else lean * math.asin(2 / max(gap, 2)))
            line = abs(b - a + 1j * (first - last) * cmath.exp(1j * along))
            candidates.append([(first, first * along), (0, line), (last, last * (end - along))])
        if first == last and 0 < gap <= 4:
            for side in SIDES:
                centre = (a + b) / 2 + side * 1j * (b - a) / gap * math.sqrt(4 - gap**2 / 4)
                leave, arrive = (cmath.phase((c - centre) / (2j * first)) for c in (a, b))
                candidates.append(
                    [
                        (first, first * leave),
                        (-first, first * (leave - arrive)),
                        (last, last * (end - arrive)),
                    ]
                )
    lengths = []
    for pieces in candidates:
        pieces = [(steer, way % (2 * PI) if steer else way) for steer, way in pieces]
        at = ORIGIN
        for steer, way in pieces:
            at = drive(at, steer, way)
        if apart(at, goal) < 1e-6:
            lengths.append(sum(way for _, way in pieces))
    return min(lengths)


def test_dubins_is_the_shortest_of_all_words():
    rng = np.random.default_rng(2)
    for far in [1.0, 3.0, 10.0] * 100:
        goal = (*rng.uniform(-far, far, 2), rng.uniform(-PI, PI))
        assert math.isclose(length(dubins(ORIGIN, goal, 1.0)), shortest_by_tangents(goal), abs_tol=1e-8)


@pytest.mark.parametrize("plan", PLANNERS)
def test_no_detour_is_shorter(plan):
    """No path there is is shorter, whatever its pieces.

    Driving on from the goal by a line or an arc never makes the way from the start longer than by what was
    driven. Along any path, cut into such pieces, the length of the planned path thus grows by no more than
    that path's own, from 0 on.
    """
    rng = np.random.default_rng(3)
    moves = [(steer, sign) for steer in (-1, 0, 1) for sign in ((1, -1) if plan is reeds_shepp else (1,))]
    for far in [0.3, 2.0, 6.0] * 50:
        goal = (*rng.uniform(-far, far, 2), rng.uniform(-PI, PI))
        before = length(plan(ORIGIN, goal, 1.0))
        for steer, sign in moves:
            way = sign * 10 ** rng.uniform(-4, 0.5)
            assert length(plan(ORIGIN, drive(goal, steer, way), 1.0)) <= before + abs(way) + 1e-8


def test_no_random_path_is_shorter():
    rng = np.random.default_rng(4)
    for _ in range(200):
        pieces = [(rng.choice([-1, 0, 1]), rng.normal()) for _ in range(rng.integers(1, 7))]
        at = ORIGIN
        for steer, way in pieces:
            at = drive(at, steer, way)
        assert length(reeds_shepp(ORIGIN, at, 1.0)) <= sum(abs(way) for _, way in pieces) + 1e-8


@pytest.mark.parametrize(
    ("goal", "radius", "forward", "either_way"),
    [  # lengths by the Dubins and Reeds-Shepp state spaces of OMPL 2.0.1
        ((0.25, 0.48, 1.83), 1.0, 7.0440117436, 1.83),
        ((2.65, 1.44, 2.62), 2.5, 16.7639939707, 6.55),
        ((-7.54, -0.55, 2.75), 1.0, 10.8222541353, 8.6858475048),
        ((0.3, 0.8, -2.4), 2.5, 16.089323918, 6.0),
        ((-0.19, -1.52, 0.27), 1.0, 7.4989389161, 2.9360904974),
        ((1.18, -7.79, -1.76), 2.5, 9.3859904071, 9.3022843914),
        ((-0.44, 0.83, 1.65), 1.0, 6.644730629, 1.9646347349),
        ((-2.04, 1.78, -2.24), 2.5, 13.4534055407, 5.6),
        ((1.88, -5.97, -3.09), 1.0, 7.462027435, 7.3634341559),
        ((0.74, -0.58, -1.76), 2.5, 17.1217435634, 4.4),
        ((2.89, 2.23, -1.31), 1.0, 5.4269056251, 4.6737971805),
        ((7.38, 0.63, 1.1), 2.5, 7.956949626, 7.956949626),
        # by hand: three arcs that turn the vehicle round on its place; straight ahead and back; half a circle
        ((0.0, 0.0, PI), 1.0, 7 * PI / 3, PI),
        ((3.0, 0.0, 0.0), 1.0, 3.0, 3.0),
        ((-3.0, 0.0, 0.0), 1.0, 3.0 + 2 * PI, 3.0),
        ((0.0, 4.0, PI), 2.0, 2 * PI, 2 * PI),
    ],
)
def test_known_lengths(goal, radius, forward, either_way):
    assert length(dubins(ORIGIN, goal, radius)) == pytest.approx(forward, abs=1e-9)
    assert length(reeds_shepp(ORIGIN, goal, radius)) == pytest.approx(either_way, abs=1e-9)


def test_reeds_shepp_is_symmetric_and_no_longer_than_dubins():
    for start, goal, radius in random_cases(200, 5):
        there = length(reeds_shepp(start, goal, radius))
        assert there == pytest.approx(length(reeds_shepp(goal, start, radius)), abs=1e-8 * radius)
        assert there <= length(dubins(start, goal, radius)) + CLOSE


def test_reeds_shepp_is_continuous_in_the_goal():
    """Shifting a pose by e costs at most 2 sqrt(2) sqrt(e) and smaller terms,
    which is what pure side shift costs."""
    rng = np.random.default_rng(6)
    for e in [1e-2, 1e-4, 1e-6] * 50:
        goal = np.array([*rng.uniform(-3, 3, 2), rng.uniform(-PI, PI)])
        shifted = goal + e * rng.uniform(-1, 1, 3) / math.sqrt(2)
        change = abs(length(reeds_shepp(ORIGIN, goal, 1.0)) - length(reeds_shepp(ORIGIN, shifted, 1.0)))
        assert change <= 2 * math.sqrt(2 * e) + 3 * e


NEAR = [0.0, 1e-12, -1e-9, 1e-7, -1e-5]


@pytest.mark.parametrize("plan", PLANNERS)
def test_degenerate_poses(plan):
    """On and very near the borders between words: collinear, touching circles, half and full turns."""
    for x, y, turn in itertools.product(
        [-4, -2, -1, 0, 1, 2, 4], [-4, -2, 0, 1, 2], [-PI, -PI / 2, 0, PI / 2, PI, 2 * PI]
    ):
        for e in NEAR:
            goal = (x + e, y - e, turn + e)
            if apart(goal, ORIGIN) > 1e-10:
                check_path(plan(ORIGIN, goal, 1.0), ORIGIN, goal, 1.0, plan)


@pytest.mark.parametrize("plan", PLANNERS)
@pytest.mark.parametrize("radius", [0.1, 1.0, 20.0])
def test_rounding_costs_no_full_turn(plan, radius):
    """A goal straight ahead that is off by rounding is reached by one line,
    a goal on the circle by one arc."""
    for heading in np.linspace(-7, 7, 41):
        start = (31.7, -12.9, heading)
        for curvature in (0.0, 1 / radius, -1 / radius):
            goal = drive(start, curvature, 1.3 * radius)
            assert len(plan(start, goal, radius)) == 1
            assert length(plan(start, goal, radius)) == pytest.approx(1.3 * radius, abs=1e-9)


@pytest.mark.parametrize("plan", PLANNERS)
@pytest.mark.parametrize(
    ("start", "goal", "radius", "words"),
    [
        (ORIGIN, ORIGIN, 1.0, "same pose"),
        ((3.0, 4.0, PI), (3.0, 4.0, -PI), 1.0, "same pose"),
        (ORIGIN, (1.0, math.nan, 0.0), 1.0, "goal = 1 nan 0 is not finite"),
        ((math.inf, 0.0, 0.0), ORIGIN, 1.0, "start = inf 0 0 is not finite"),
        ((0.0, 0.0), ORIGIN, 1.0, "start = .* is not a pose; give"),
        (ORIGIN, (1.0, 1.0, 1.0), 0.0, "radius = 0"),
        (ORIGIN, (1.0, 1.0, 1.0), math.nan, "radius = nan"),
        (ORIGIN, (1.0, 1.0, 1.0), 1e12, "rounding leaves a gap"),
        (ORIGIN, (4.0, 4.0, 0.0), 1e200, "radius = .* is out of range"),
        (ORIGIN, (4.0, 4.0, 1.0), 1e-300, "radius = .* is out of range"),
        (ORIGIN, (1e160, 4.0, 1.0), 1.0, "too far apart"),
        ((-1e308, 0.0, 0.0), (1e308, 4.0, 1.0), 1.0, "too far apart"),
    ],
)
def test_no_plan(plan, start, goal, radius, words):
    with pytest.raises(BadInput, match=words):
        plan(start, goal, radius)


# -- biarcs --------------------------------------------------------------------------------------------------


def dense(path: list[Segment], step: float) -> np.ndarray:
    """Points along a path, (N, 2), no farther apart than step."""
    return np.array(
        [s.pose(r)[:2] for s in path for r in np.linspace(0, s.length, 2 + math.ceil(s.length / step))]
    )


def two_sided(path: list[Segment], curve: np.ndarray, step: float) -> float:
    """Largest distance of dense points of either from the other, m; too large by step / 2 at most."""
    points = dense(path, step)
    return max(cKDTree(points).query(curve)[0].max(), cKDTree(curve).query(points)[0].max())


def check_joins(path: list[Segment], closed: bool = False) -> None:
    for before, after in itertools.pairwise([*path, path[0]] if closed else path):
        assert apart(before.end, (after.x, after.y, after.heading)) <= CLOSE
        assert before.length > 0 and not before.backward


def random_waypoints(seed: int, count: int) -> np.ndarray:
    """A walk with turns below a right angle, or for every third seed points anywhere,
    so that the curve has sharp bends."""
    rng = np.random.default_rng(seed)
    if seed % 3 == 0:
        return rng.uniform(-5, 5, (count, 2))
    headings = np.cumsum(rng.uniform(-1.4, 1.4, count))
    return np.cumsum(rng.uniform(0.5, 3.0, count) * np.exp(1j * headings)).view(float).reshape(-1, 2)


CURVES = {
    "sine": (lambda t: (10 * t, math.sin(10 * t)), 10),
    "ellipse": (lambda t: (4 * math.cos(6 * t), 2 * math.sin(6 * t)), 24),
    "spiral": (lambda t: ((0.2 + t) * math.cos(20 * t), (0.2 + t) * math.sin(20 * t)), 25),
    "wiggles": (lambda t: (5 * t, 0.05 * math.sin(60 * t)), 6),
}


@pytest.mark.parametrize("stated", [0.1, 0.01, 0.002])
@pytest.mark.parametrize("name", CURVES)
def test_stays_within_the_stated_distance_of_a_function(name, stated):
    function, size = CURVES[name]
    path = fit(function, stated)
    step = stated / 20
    curve = np.array([function(t) for t in np.linspace(0, 1, math.ceil(2 * size / step))])
    check_joins(path)
    assert two_sided(path, curve, step) <= (1 + 1 / 20) * stated
    assert (
        np.hypot(*(curve[0] - [path[0].x, path[0].y])) <= CLOSE
        and np.hypot(*(curve[-1] - path[-1].end[:2])) <= CLOSE
    )


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize("seed", [2, 4, 5, 8, 10, 11, 18, 19, 24])  # without bends tighter than the tolerance
def test_stays_within_the_tolerance_of_the_curve_through_waypoints(seed, closed):
    """The curve: cubic Hermite, velocities from parabolas through neighbours, here by their Lagrange form."""
    points, stated = random_waypoints(seed, 12), 0.02
    path = fit(points, stated, closed=closed)
    check_joins(path, closed)
    ring = np.concatenate([points[-2:], points, points[:3]]) if closed else points
    times = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(ring, axis=0).T))])
    velocities = []
    for k in range(len(ring)):
        near = slice(j := min(max(k - 1, 0), len(ring) - 3), j + 3)
        velocities.append(
            [np.polyval(np.polyder(np.polyfit(times[near], ring[near, i], 2)), times[k]) for i in (0, 1)]
        )
    curve = []
    for k in range(2, len(points) + 2) if closed else range(len(points) - 1):
        h, t = times[k + 1] - times[k], np.linspace(0, 1, 3000)[:, None]
        curve.append((1 + 2 * t) * (1 - t) ** 2 * ring[k] + t**2 * (3 - 2 * t) * ring[k + 1])
        curve[-1] += h * t * (1 - t) * ((1 - t) * velocities[k] - t * np.array(velocities[k + 1]))
    assert two_sided(path, np.concatenate(curve), 1e-3) <= stated + 0.001
    assert cKDTree(dense(path, 1e-3)).query(points)[0].max() <= stated + 0.001


@pytest.mark.parametrize("spline", [CubicSpline, lambda t, p: make_interp_spline(t, p, k=5)])
def test_takes_splines_of_scipy_on_their_knots(spline):
    t = np.linspace(2, 9, 15)
    curve = spline(t, np.stack([t, np.cos(t)], axis=1))
    path = fit(curve, 1e-3)
    check_joins(path)
    assert two_sided(path, curve(np.linspace(2, 9, 200_000)), 1e-4) <= 0.0011
    heading = math.atan2(*curve(2.0, 1)[::-1])
    assert apart((path[0].x, path[0].y, path[0].heading), (*curve(2.0), heading)) <= CLOSE


def test_few_segments():
    """Halving the error of biarcs takes 2^(1/3) times as many: 1000 times less, ten times as many."""
    coarse, fine = (len(fit(CURVES["sine"][0], tolerance)) for tolerance in (1e-3, 1e-6))
    assert coarse <= 36 and fine <= 10 * coarse


@pytest.mark.parametrize("points", [[(0, 0), (1, 2)], [(0, 0), (0.1, 0.3), (1, 3), (2, 6), (700, 2100)]])
def test_collinear_waypoints_give_a_line(points):
    (line,) = fit(points, 1e-3)
    assert (
        line.curvature == 0
        and apart(line.end, (*points[-1], math.atan2(*np.subtract(points[-1], points[0])[::-1]))) <= 1e-9
    )


def test_straight_runs_between_waypoints_are_lines():
    path = fit([(0, 0), (5, 0), (10, 0), (10, 5), (10, 10)], 0.05)
    assert [segment.length for segment in path if not segment.curvature] == pytest.approx([5, 5])
    assert path[0].curvature == path[-1].curvature == 0


def test_circle_is_one_arc():
    turn = np.linspace(0, 1.5 * PI, 40)
    path = fit(CubicSpline(turn, 3 * np.stack([np.cos(turn), np.sin(turn)], axis=1)), 1e-2)
    assert len(path) <= 6 and all(segment.curvature == pytest.approx(1 / 3, rel=1e-2) for segment in path)


def test_headings_are_kept():
    points, headings = [(0, 0), (4, 0), (8, 1), (12, 0)], [0.3, None, -0.5, 1.0]
    path = fit(points, 1e-4, headings)
    assert path[0].heading == pytest.approx(0.3) and path[-1].end[2] == pytest.approx(1.0)
    at = min(
        (abs(complex(*s.pose(r)[:2]) - (8 + 1j)), s.pose(r)[2])
        for s in path
        for r in np.linspace(0, s.length, 500)
    )
    assert at[1] == pytest.approx(-0.5, abs=1e-2)
    fit([(0, 0), (4, 0), (0, 0.0)], 0.01, [0.0, PI / 2, PI])  # turning back is fine where a heading says how


def test_a_repeated_first_waypoint_closes_the_path():
    square = [(0, 0), (4, 0), (4, 4), (0, 4)]
    assert fit([*square, (0, 0)], 0.01, closed=True) == fit(square, 0.01, closed=True)


def test_smallest_radius():
    points = [(0, 0), (4, 0), (4, 4)]
    tightest = 1 / max(abs(segment.curvature) for segment in fit(points, 0.01))
    assert fit(points, 0.01, min_radius=0.9 * tightest)
    with pytest.raises(
        BadInput, match=r"radius .* m near \(.*\), between waypoints \d and \d, less than min_radius"
    ):
        fit(points, 0.01, min_radius=2 * tightest)


NAN = math.nan


@pytest.mark.parametrize(
    ("points", "options", "words"),
    [
        ([], {}, "0 given"),
        ([(0, 0)], {}, "1 given"),
        ([(0, 0), (1, 1), (0, 0)], {"closed": True}, "2 given"),
        (
            [(0, 0), (1, 0), (1, 0), (2, 1)],
            {"headings": [None, 0, 1, None]},
            "waypoints 2 and 3 are 0 m apart",
        ),
        ([(0, 0), (1e-4, 0), (2e-4, 1e-4)], {}, "0.000224 m from the first, less than the tolerance"),
        (
            [(0, 0), (1, 0), (0.9, 0.02), (2, 1)],
            {},
            "radius .* between waypoints 1 and 2, less than the tolerance, 0.1 m",
        ),
        (
            [(k, 0) for k in range(9)],
            {"headings": [1.0] * 9},
            "headings differ by 57 deg from the directions",
        ),
        ([(k, 0) for k in range(9)], {"headings": [math.pi] * 9}, "headings differ by 180 deg"),
        ([(0, 0), (1, 0), (NAN, 1)], {}, "waypoint 3 = .* two finite numbers"),
        ([(0, 0), (1, 0, 2)], {}, "waypoint 2"),
        ([(0, 0), (1, 0), (1e308, 1e308)], {}, "waypoint 3 = .* is too far away"),
        ([(0, 0), (1e99, 1), (0, 2e99)], {}, "make it larger"),
        ([(0, 0), (2, 2), (1, 1)], {}, "turns back at waypoint 2"),
        ([(0, 0), (1, 0), (2, 0)], {"closed": True}, "turns back at waypoint"),
        ([(0, 0), (1, 0)], {"headings": [0.0]}, "1 headings for 2 waypoints"),
        ([(0, 0), (1, 0)], {"headings": [None, NAN]}, "heading at waypoint 2 is nan"),
        ([(0, 0), (1, 0)], {"tolerance": 0.0}, "tolerance = 0"),
        ([(0, 0), (1, 0)], {"tolerance": NAN}, "tolerance = nan"),
        ([(0, 0), (1, 0)], {"min_radius": -1.0}, "min_radius = -1"),
        (lambda t: (t, NAN), {}, "must be finite"),
        (lambda t: (t, t, t), {}, "values of shape"),
        (lambda t: None, {}, "the curve"),
        (lambda t: (t, abs(t - 0.3)), {}, "corner near"),
        (lambda t: (1.0, 2.0), {}, "velocity of the curve vanishes"),
        (lambda t: (t, math.sin(t)), {"domain": (1.0, 1.0)}, "not an interval"),
        (lambda t: (100 * t, math.sin(100 * t)), {"tolerance": 1e-12}, "make it larger"),
    ],
)
def test_no_fit(points, options, words):
    with pytest.raises(BadInput, match=words):
        fit(points, **{"tolerance": 0.1, **options})


# -- tables --------------------------------------------------------------------------------------------------


def test_tables_are_read_back_as_they_were():
    for start, goal, radius in random_cases(100, 7):
        path = reeds_shepp(start, goal, radius)
        read = segments_from_tables(tomllib.loads(toml(path))["path"]["segments"], "path segments")
        assert len(read) == len(path)
        for a, b in zip(path, read, strict=True):
            assert a.backward == b.backward and apart((a.x, a.y, a.heading), (b.x, b.y, b.heading)) <= 2e-9
            assert math.isclose(a.curvature, b.curvature, rel_tol=1e-14) and math.isclose(
                a.length, b.length, abs_tol=1e-12
            )


def test_tables_go_on_from_the_one_before():
    tables = [
        {"kind": "line", "from": [1, 1], "to": [3, 1]},
        {"kind": "arc", "radius": 2.0, "angle": PI / 2},
        {"kind": "line", "length": 1.0},
        {"kind": "arc", "radius": 1, "angle": -PI / 2, "backward": True},
        {"kind": "line", "to": [6.0, 3.0], "backward": True},
    ]
    line, left, on, back, last = segments_from_tables(tables, "segments")
    assert line == Segment(1.0, 1.0, 0.0, 0.0, 2.0)
    assert (left.x, left.y, left.heading, left.curvature, left.length) == (3.0, 1.0, 0.0, 0.5, PI)
    assert apart((on.x, on.y, on.heading), (5, 3, PI / 2)) <= 1e-12 and on.length == 1.0
    assert (
        apart((back.x, back.y, back.heading), (5, 4, -PI / 2)) <= 1e-12
        and back.curvature == -1.0
        and back.backward
    )
    assert apart((last.x, last.y, last.heading), (4, 3, 0)) <= 1e-12 and last.length == pytest.approx(2.0)


LINE = {"kind": "line", "from": [0, 0], "to": [1, 0]}


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ("line", "is not a list"),
        ([], "is not a list"),
        ([LINE, 3], "segments 2 = 3 is not a table"),
        ([LINE, {"to": [1, 2]}], "segments 2 kind = None is not one of line, arc"),
        ([{**LINE, "kind": "curve"}], "segments 1 kind = 'curve'"),
        ([LINE, {**LINE, "angle": 1}], r"segments 2 \(line\): unknown key 'angle'"),
        ([{"kind": "line", "to": [1, 0]}], "segments 1, the first, requires from"),
        ([{"kind": "line", "from": [1, 0]}], "segments 1 requires to"),
        ([LINE, {"kind": "line"}], "segments 2 requires to"),
        (
            [LINE, {**LINE, "length": 1}],
            "segments 2 length is only for a line that continues .*; remove length, or from and to",
        ),
        ([{"kind": "line", "length": 1}], "segments 1, the first, requires from"),
        ([LINE, {**LINE, "to": [0, 0]}], "segments 2 has length 0"),
        ([LINE, {**LINE, "to": [0, math.inf]}], r"segments 2 to\[1\] = inf is not finite"),
        ([LINE, {**LINE, "to": [0, 1, 2]}], "segments 2 to has 3 numbers"),
        ([LINE, {**LINE, "backward": 1}], "segments 2 backward = 1 is not true or false"),
        (
            [{"kind": "arc", "from": [0, 0], "radius": 1, "angle": 1}],
            "segments 1, the first, requires heading",
        ),
        ([LINE, {"kind": "arc", "angle": 1}], "segments 2 requires radius"),
        ([LINE, {"kind": "arc", "radius": 1}], "segments 2 requires angle"),
        ([LINE, {"kind": "arc", "radius": -1, "angle": 1}], "segments 2 radius = -1 must be"),
        ([LINE, {"kind": "arc", "radius": 1, "angle": 0}], "segments 2 has length 0"),
        ([LINE, {"kind": "arc", "radius": 1, "length": 2}], r"segments 2 \(arc\): unknown key 'length'"),
    ],
)
def test_no_tables(tables, words):
    with pytest.raises(BadInput, match=words):
        segments_from_tables(tables, "segments")


# -- noslip plan ---------------------------------------------------------------------------------------------

DUBINS = ["plan", "dubins", "--from", "0", "0", "0", "--to", "-4", "-3e0", "-1e-3", "--radius", "1"]
PARK = ["plan", "reeds-shepp", "--from", "0", "0", "0", "--to", "0", "1.5", "0", "--radius", "1"]


def planned(capsys, argv: list[str]) -> str:
    capsys.readouterr()
    assert main(argv) == 0
    return capsys.readouterr().out


@pytest.fixture
def points(tmp_path) -> str:
    """A file of waypoints."""
    file = tmp_path / "points.csv"
    file.write_text("x, y, heading\n# a bend\n0, 0, 0\n5, 0\n\n10, 0,\n10, 5, 90\n")
    return str(file)


def test_prints_a_path_for_a_spec(capsys):
    segments = tomllib.loads(planned(capsys, DUBINS))["path"]
    assert segments["kind"] == "composite"
    assert segments_from_tables(segments["segments"], "path") == dubins(ORIGIN, (-4, -3, -1e-3), 1.0)
    assert segments == json.loads(planned(capsys, [*DUBINS, "--json"]))


def test_degrees(capsys):
    half = [
        "plan",
        "reeds-shepp",
        "--from",
        "0",
        "0",
        "-90",
        "--to",
        "1",
        "1",
        "180",
        "--radius",
        "1",
        "--degrees",
    ]
    tables = tomllib.loads(planned(capsys, half))["path"]["segments"]
    assert segments_from_tables(tables, "path") == reeds_shepp(
        (0, 0, -90 * PI / 180), (1, 1, 180 * PI / 180), 1.0
    )


def test_plans_through_waypoints(points, capsys, tmp_path):
    out = tmp_path / "path.toml"
    assert planned(
        capsys, ["plan", "waypoints", points, "--tolerance", "0.05", "--degrees", "-o", str(out)]
    ).startswith("waypoints")
    path = tomllib.loads(out.read_text())["path"]
    read = segments_from_tables(path["segments"], "path")
    expected = fit([(0, 0), (5, 0), (10, 0), (10, 5)], 0.05, [0, None, None, PI / 2])
    assert (
        all(apart(a.end, b.end) <= 1e-9 for a, b in zip(read, expected, strict=True)) and "closed" not in path
    )
    closed = ["plan", "waypoints", points, "--tolerance", "0.05", "--degrees", "--closed"]
    assert tomllib.loads(planned(capsys, closed))["path"]["closed"] is True


def test_a_spreadsheets_byte_order_mark_is_no_entry(capsys, tmp_path):
    file = tmp_path / "points.csv"
    for header in ("", "x,y\r\n"):
        file.write_bytes(f"\ufeff{header}0,0\r\n3,4\r\n".encode())
        assert "1 segment, 5 m" in planned(
            capsys, ["plan", "waypoints", str(file), "--tolerance", "0.05", "-o", str(tmp_path / "p")]
        )


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_c_is_read_back_and_compiles(scalar, capsys, tmp_path):
    text = planned(capsys, [*PARK, "--c", "--scalar", scalar])
    path = reeds_shepp(ORIGIN, (0, 1.5, 0), 1.0)
    rows = re.findall(r"\{(\.x = .*)\}", text)
    for row, segment in zip(rows, path, strict=True):
        values = [float(value.rstrip("f")) for value in re.findall(r"= ([^,]+)", row)]
        expected = [
            segment.x,
            segment.y,
            segment.heading,
            segment.curvature,
            segment.length,
            segment.backward,
        ]
        kind = np.float32 if scalar == "float" else np.float64
        assert [kind(value) for value in values] == [kind(value) for value in expected]
    suffix = "_f" if scalar == "float" else ""
    first = (
        f"const noslip_segment{suffix} *first(void);\nconst noslip_segment{suffix} *first(void) {{ "
        "return path; }\n"
    )
    (tmp_path / "path.c").write_text(f'#include "noslip_path.h"\n{text}{first}')
    flags = (
        "-std=c99 -pedantic -Wall -Wextra -Wconversion -Wdouble-promotion -Wfloat-conversion -Werror "
        "-fsyntax-only"
    )
    subprocess.run([HOST_CC, *flags.split(), f"-I{RUNTIME}", tmp_path / "path.c"], check=True)


@pytest.mark.parametrize("kind", ["png", "svg"])
def test_draws(kind, points, capsys, tmp_path):
    picture = tmp_path / f"path.{kind}"
    planned(capsys, [*PARK, "--plot", str(picture)])
    assert picture.stat().st_size > 10_000
    if kind == "svg":
        text = picture.read_text()
        assert all(
            f"<!-- {word} -->" in text
            for word in ("x (m)", "y (m)", "start", "goal", "cusp", "turning left, backward")
        )


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        (["plan"], "see noslip plan --help"),
        (["plan", "dubin"], "see noslip plan"),
        (DUBINS[:-1], "see noslip plan dubins --help"),
        ([*DUBINS[:-1], "0"], "radius = 0"),
        ([*DUBINS[:-1], "nan"], "radius = nan"),
        ([*DUBINS, "--c", "--json"], "not allowed with"),
        ([*DUBINS, "--scalar", "float"], "--scalar requires --c"),
        ([*DUBINS, "--plot", "path.bmp"], ".png or .pdf or .svg"),
        ([*DUBINS, "-o", "no/such/folder/path.toml"], "does not exist"),
        ([*DUBINS[:7], "0", "0", "0", "--radius", "1"], "same pose"),
        ([*DUBINS[:7], "1", "inf", "0", "--radius", "1"], "--to[1] = inf is not finite"),
        (["plan", "waypoints", "nowhere.csv", "--tolerance", "1"], "nowhere.csv: No such file"),
    ],
)
def test_bad_command_lines(argv, words, bad_input):
    assert words in bad_input(argv)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("0,0\n1,0\n2,zero\n", "points.csv column '2' row 3: 'zero' is not a number"),
        ("0,0\n1\n", "points.csv row 2: x and y are 1 and nan"),
        ("x,y\n0,0\n1,0\nx,y\n", "points.csv row 4 repeats the header"),
        ("0,0\n,3\n", "points.csv row 2: x and y are nan and 3"),
        ("0,0\n1,nan\n", "points.csv row 2: x and y are 1 and nan"),
        ("0,0\n", "points.csv: waypoints: 1 given"),
        ("x,y\n", "points.csv has a header but no rows"),
        ("", "points.csv is empty"),
        ("x,y,heading\n0,0,0\n1,0,nan\n", "column 'heading' row 3: nan is not finite"),
        (
            "x,y,heading\n0,0,0\n1,0,90\n",
            "row 3: 90 rad is more than a turn; did you mean degrees? Say --degrees",
        ),
        (
            "0,0,0\n1,0,0.5\n",
            "has 3 columns and no header, in its first row 0, 0, 0: say which are x and y (m)",
        ),
        ("0,0,0\n1,0,0.5\n", "by --columns x,y,heading"),
        (
            "east;north\n0;1\n2;3\n",
            "has the columns east, north, in its first row 0, 1: say which are x and y",
        ),
        (
            "lat,lon\n48.1,11.5\n48.2,11.5\n",
            "lat and lon are angles on the globe; project them to x and y in m",
        ),
        (
            "48.13700,11.57500\n48.13701,11.57502\n",
            "2.24e-05 m from the first, less than the tolerance, 0.1 m",
        ),
        ("\xff\xfe\x00", "points.csv: not a text file"),
    ],
)
def test_bad_waypoints(text, words, bad_input, tmp_path):
    file = tmp_path / "points.csv"
    file.write_bytes(text.encode("latin-1"))
    assert words in bad_input(["plan", "waypoints", str(file), "--tolerance", "0.1"])


# -- files of other programs, and far from the origin --------------------------------------------------------

BEND = [(0.0, 0.0), (5.0, 0.0), (10.0, 0.0), (12.0, 5.0), (12.0, 10.0)]


@pytest.mark.parametrize(
    ("content", "options"),
    [
        ("# x_m; y_m; w_tr_right_m; w_tr_left_m\n" + "".join(f"{x};{y};1.1;1.1\n" for x, y in BEND), []),
        ("X\tY\tspeed\r\n" + "".join(f"{x}\t{y}\t0.5\r\n" for x, y in BEND).replace(".", ","), []),
        ("".join(f"{x} {y} 0.5\r" for x, y in BEND), ["--columns", "x,y,v"]),
        ("".join(f"7,{y},{x}\n" for x, y in BEND), ["--columns", "-,y,x"]),
        (json.dumps([{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(BEND)]), []),
        ("x [mm],y [mm]\n" + "".join(f"{1000 * x},{1000 * y}\n" for x, y in BEND), []),
        (
            "x,y\n" + "".join(f"{x + 500000},{y + 5400000}\n" for x, y in BEND),
            ["--origin", "500000", "5400000"],
        ),
        ("x,y\n" + "".join(f"{x},{y}\n{x + 1e-6},{y}\n" for x, y in BEND[:-1]) + "12,10\n", []),
    ],
)
def test_points_of_other_programs_give_the_same_path(content, options, tmp_path, capsys):
    """Names with units, other columns, decimal commas, no header with --columns,
    points a micrometre behind others."""
    (tmp_path / "points.txt").write_text(content)
    out = planned(
        capsys, ["plan", "waypoints", str(tmp_path / "points.txt"), "--tolerance", "0.05", *options]
    )
    read = segments_from_tables(tomllib.loads(out)["path"]["segments"], "path")
    expected = fit(BEND, 0.05)
    assert len(read) == len(expected) and all(
        apart(a.end, b.end) < 0.01 for a, b in zip(read, expected, strict=True)
    )


@pytest.mark.parametrize("seed", range(6))
def test_waypoints_that_count_as_one_are_near_the_path(seed):
    """Crowds of points, all closer together than an eighth of the tolerance."""
    rng, allowed = np.random.default_rng(seed), 0.1
    base = rng.uniform(3.5, 4.5, 12) * np.exp(2j * PI / 12 * np.arange(12))
    points = np.repeat(base, 5) + 0.04 * allowed * (rng.uniform(-1, 1, 60) + 1j * rng.uniform(-1, 1, 60))
    points = points.view(float).reshape(-1, 2)
    for closed in (False, True):
        path = fit(points, allowed, closed=closed)
        assert cKDTree(dense(path, 1e-3)).query(points)[0].max() <= allowed + 0.001
        assert len(path) < 60
    assert np.hypot(*(points[-1] - fit(points, allowed)[-1].end[:2])) < CLOSE  # the last stays the end


def test_c_far_from_the_origin_is_accepted_or_refused(tmp_path, capsys, bad_input):
    """What is written in float is what noslip_path_init accepts;
    at 500 km it is relative to an origin that it states."""
    accepted = 0
    for distance in (100.0, 400.0, 900.0, 1500.0, 5000.0, 500000.0):
        path = fit([(x + distance, y - distance) for x, y in BEND], 0.05)
        try:
            text = c_array(path, SCALARS["float"])
        except BadInput as error:
            assert f"--origin {distance:.0f} -{distance:.0f}" in str(error)
            continue
        accepted += 1
        assert "path[" in text and CompiledTracker(path, TrackerOptions(1.0, L=(0.3, 0.3)), "float")
    assert accepted >= 2
    points = tmp_path / "points.csv"
    points.write_text("x,y\n" + "".join(f"{x + 500000},{y + 400000}\n" for x, y in BEND))
    command = ["plan", "waypoints", str(points), "--tolerance", "0.05", "--c", "--scalar", "float"]
    said = bad_input(command)
    assert "m leave a gap of 0.0" in said and "--origin 500000 400000" in said
    near = planned(capsys, [*command, "--origin", "500000", "400000"])
    assert "relative to (500000, 400000) m: subtract that from the pose, too" in near and ".x = 0.0f" in near


def test_columns_that_are_not_used_are_noted(tmp_path, capsys):
    (tmp_path / "points.csv").write_text("x,y,theta\n0,0,3\n2,1,3\n")
    assert main(["plan", "course", str(tmp_path / "points.csv"), "--tolerance", "0.1"]) == 0
    assert "note: not used: column theta" in capsys.readouterr().err
