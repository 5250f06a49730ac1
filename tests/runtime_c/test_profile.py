"""The fastest speed along a path: against a linear program over a fine grid,
and what its runs ask of the floor."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from noslip.model.segments import Segment
from noslip.readers.errors import BadInput
from noslip.simulation.closed_loop import simulate
from noslip.simulation.contact import contact_forces, friction_accelerations
from noslip.simulation.controllers.tracking import Guide, TrackerOptions
from noslip.simulation.loop import make_loop
from noslip.simulation.planning.profile import Accelerations, SpeedProfile
from noslip.simulation.specification.spec import spec_of
from scipy import sparse
from scipy.optimize import linprog

FACETS = 96  # of the ellipse, on the half with positive lateral acceleration


def joined(*shapes: tuple[float, float], backward: bool = False) -> list[Segment]:
    """Lines and arcs (length, curvature) one after the other."""
    made, place = [], (0.0, 0.0, 0.0)
    for length, curvature in shapes:
        made.append(Segment(*place, curvature, length, backward))
        place = made[-1].end
    return made


def fastest(
    segments: list[Segment], options: TrackerOptions, limits: Accelerations, begin: float, count: int
) -> np.ndarray:
    """Return the way of the middle of the axle and v^2 at the ends of `count` steps of each segment, from
    rest at `begin` (m) on the first segment, or before it on a line: the greatest for which each of the
    tangents of the ellipse holds; at the end it can stop within the extension.
    """
    lookahead = options.L[segments[0].backward] + options.ahead
    rows, columns, entries, right, ways = [], [], [], [], []
    n = count * len(segments) + 1
    for k, segment in enumerate(segments):
        bend = abs(segment.curvature)
        inward = math.copysign(options.W, segment.curvature) * (-1 if segment.backward else 1)
        radius = math.sqrt(1 / bend**2 - lookahead**2) + inward if bend else math.inf
        way = segment.length / count * (radius * bend if bend else 1.0)
        ways += [way] * count
        for i in range(k * count, (k + 1) * count):
            for angle in np.pi * np.arange(FACETS + 1) / FACETS - np.pi / 2:
                most = limits.acceleration if angle > 0 else limits.deceleration
                mean, change = np.cos(angle) / (limits.lateral * radius) / 2, np.sin(angle) / (2 * most * way)
                row = len(right)
                rows += [row, row]
                columns += [i, i + 1]
                entries += [mean - change, mean + change]
                right.append(1.0)
    along = np.concatenate([[0.0], np.cumsum(ways)])
    bounds = [(0.0, options.speed**2)] * n
    stop = 2 * limits.deceleration * (abs(lookahead) if options.stop == "axle" else 0.0)
    bounds[-1] = (0.0, min(stop, options.speed**2))
    for k, (one, other) in enumerate(zip(segments[:-1], segments[1:], strict=True), 1):
        change = abs(other.curvature - one.curvature)
        ratio = math.sqrt(1 - (lookahead * one.curvature) ** 2) + options.W * one.curvature
        if lookahead:
            most = min(bounds[k * count][1], limits.angular * lookahead * ratio**3 / change)
            bounds[k * count] = (0.0, most)
    for i in range(round(begin / segments[0].length * count) + 1):
        bounds[i] = (0.0, 0.0)
    if begin < 0:
        bounds[0] = (0.0, -2 * limits.acceleration * begin)
    matrix = sparse.csr_matrix((entries, (rows, columns)), (len(right), n))
    found = linprog(-np.ones(n), A_ub=matrix, b_ub=np.array(right), bounds=bounds, method="highs")
    assert found.status == 0, found.message
    return np.vstack([along, found.x])


PATHS = {  # name -> segments, options, where P_l is on the first when the vehicle starts
    "bend": (joined((3.0, 0.0), (2.0, 0.8), (4.0, 0.0)), TrackerOptions(speed=50.0), 0.0),
    "slalom": (
        joined((2.0, 0.0), (1.5, 0.5), (0.3, -2.0), (2.5, -0.2), (1.0, 0.0)),
        TrackerOptions(speed=1.6, L=(0.1, 0.0), ahead=0.2),
        0.0,
    ),
    "axle": (
        joined((1.0, 0.4), (1.0, -0.4), (2.0, 0.0)),
        TrackerOptions(speed=50.0, L=(0.2, -0.9), ahead=0.3, W=0.1, stop="axle"),
        0.5,
    ),
}
PATHS["near"] = (*PATHS["axle"][:2], 0.2)
PATHS["behind"] = (*PATHS["bend"][:2], -0.7)


LIMITS, STEPS = Accelerations(lateral=1.5, acceleration=0.8, deceleration=1.1, angular=4.0), 60


@cache
def linear_program(name: str) -> np.ndarray:
    """The way of the middle of the axle and v^2 of a path, at the ends of steps."""
    segments, options, begin = PATHS[name]
    return fastest(segments, options, LIMITS, begin, STEPS)


@pytest.mark.parametrize("scalar", ["double", "float"])
@pytest.mark.parametrize("name", PATHS)
def test_it_is_the_fastest(name, scalar):
    """The time along the path to 0.01 %, and the speed anywhere to 0.1 %,
    as of a linear program with 60 steps a segment."""
    segments, options, begin = PATHS[name]
    profile = SpeedProfile(segments, options, LIMITS, scalar, progress=begin)
    along, squares = linear_program(name)
    places = [(k, segment.length * i / STEPS) for k, segment in enumerate(segments) for i in range(STEPS)]
    places.append((len(segments) - 1, segments[-1].length))
    known, speeds = np.sqrt(squares), np.array([profile.along(*place) for place in places])
    if begin >= 0:
        assert abs(min(speeds) - 0.01) < 1e-8, "it creeps where it would stand"
    speeds[known == 0] = 0.0
    times = [
        np.sum(2 * np.diff(along[known > 0]) / (v[1:] + v[:-1]))
        for v in (speeds[known > 0], known[known > 0])
    ]
    assert abs(times[0] / times[1] - 1) < 0.0001
    assert np.abs(speeds - known).max() < 0.001 * known.max()


def test_fastest_on_a_line_in_pieces():
    """Pieces shorter than the way from which the axle starts change nothing."""
    options = TrackerOptions(speed=50.0, L=(0.2, -0.9), ahead=0.3, stop="axle")
    whole, pieces = (SpeedProfile(joined(*[(length, 0.0) for length in lengths]), options, LIMITS, "double")
                     for lengths in ([3.0], [0.2, 0.15, 2.65]))  # fmt: skip
    for k, begin, length in ((0, 0.0, 0.2), (1, 0.2, 0.15), (2, 0.35, 2.65)):
        for on in length * np.linspace(0.01, 0.99, 9):
            assert pieces.along(k, on) == pytest.approx(whole.along(0, begin + on), abs=1e-9), (k, on)


@pytest.mark.parametrize("name", PATHS)
def test_the_rate_of_the_speed_is_its_derivative(name):
    """By the way of the middle of the axle; times the speed of the vehicle,
    from 0 to twice the desired speed."""
    segments, options, _ = PATHS[name]
    profile, braking, speeding = SpeedProfile(segments, options, LIMITS, "double"), 0, 0
    for k, segment in enumerate(segments):
        lookahead = options.L[0] + options.ahead
        ratio = math.sqrt(1 - (lookahead * segment.curvature) ** 2) + options.W * segment.curvature
        for on in segment.length * np.linspace(0.013, 0.987, 40):
            near = [profile.along(k, on + step) for step in (-1e-5, 0.0, 1e-5)]
            sides = np.diff(near) / (1e-5 * ratio)
            if near[1] <= 0.011 or np.ptp(sides) > 1e-2 * (1 + np.abs(sides).max()):
                continue  # creeps, or the acceleration changes here
            place = {"x": segment.x, "y": segment.y, "curvature": segment.curvature, "progress": on}
            for direction in (1, -1):
                guide = Guide("ok", segment=k, speed=direction * 60.0, **place)
                for forward, share in (
                    (near[1], 1.0),
                    (near[1] / 3, 1 / 3),
                    (9 * near[1], 2.0),
                    (-near[1], 0.0),
                    (0.0, 0.0),
                ):
                    speed, rate = profile.speed(guide, direction * forward)
                    assert speed == direction * near[1]
                    assert rate == pytest.approx(direction * share * near[1] * sides.mean(), abs=1e-3), (
                        k,
                        on,
                        forward,
                    )
            braking, speeding = braking + (sides.mean() < -1e-3), speeding + (sides.mean() > 1e-3)
    assert braking > 5 and speeding > 5


SPEC = """
robot = "labmate"
gains = { kp = 4.0, kd = 4.0, kv = 3.0 }
reference = { speed = "fastest" }
contact = { mu = 0.5, height = 0.1 }
limits = { mode = "grip" }
simulation = { duration = 11.0, period = 0.01, tolerance = 1e-8 }
[output]
type = "IV"
L = 0.0
path = { kind = "composite", stop = "axle", segments = [
  { kind = "line", from = [0, 0], to = [4, 0] },
  { kind = "arc", radius = 1.5, angle = 3.0 },
  { kind = "arc", radius = 3.0, angle = -1.5 },
  { kind = "line", length = 2 },
] }
"""


def test_a_run_stays_on_the_path_and_keeps_rolling():
    """In each backend; sooner at the end than at the constant speed that friction allows at the joins."""
    runs = {
        backend: simulate(spec_of(SPEC.replace("11.0,", f'11.0, backend = "{backend}",'), "test"))
        for backend in ("c", "cf", "casadi")
    }
    constant = simulate(spec_of(SPEC.replace('"fastest"', "1.4, deceleration = 1.5"), "test"))
    for backend, made in runs.items():
        assert np.abs(made.error[:, 0]).max() < 0.01
        assert "will_slip" not in made.status and max(use.max() for use in made.use.values()) <= 0.951
        assert np.abs(made.x - runs["c"].x).max() < (1e-5 if backend != "cf" else 0.02)
        assert np.count_nonzero(made.status == "grip") < 100 and made.y[:, 1].max() > 3.0
    stands = [each.t[np.abs(each.y[:, 1]) > 0.02].max() for each in (runs["c"], constant)]
    assert stands[0] < stands[1] - 2.0, stands


def test_friction_gives_the_accelerations():
    """Of the LABMATE along a line: mu g; and each alone uses the friction asked for,
    in a run from that motion."""
    spec = spec_of(SPEC, "test")
    plant, floor = make_loop(spec).plant, replace(spec.contact, height=0.15)
    found = friction_accelerations(plant, floor, 0.8)
    assert found.acceleration == found.deceleration == pytest.approx(0.8 * floor.mu * 9.81, rel=1e-3)
    r, b = (
        plant.parameters[[p.name for p in plant.system.mechanism.parameters].index(name)]
        for name in ("r", "b")
    )
    names = [c.name for c in plant.system.mechanism.coordinates]
    for speed, yaw_rate, wanted in (
        (10.0, found.lateral / 10.0, [0.0, 0.0]),
        (0.0, 0.0, [found.acceleration, 0.0]),
        (0.0, 0.0, [0.0, found.angular]),
    ):
        rates = [[1 / r, b / r], [1 / r, -b / r]]
        x = np.concatenate([np.zeros(len(names)), rates @ np.array([speed, yaw_rate])])
        free = plant.rate(x, np.zeros(2))[-2:]
        by = np.transpose([plant.rate(x, tau)[-2:] - free for tau in np.eye(2)])
        tau = np.linalg.solve(by, rates @ np.array(wanted) - free)
        use = max(contact.use[0] for contact in contact_forces(plant, x[None], tau[None], floor))
        assert abs(use - 0.8) < (0.02 if speed else 1e-9)


def test_motors_bound_the_accelerations():
    """Inputs of 4 N m: 0.6 of each accelerates as Newton says,
    and the run on the first line stays below 4 N m."""
    text = SPEC.replace('mode = "grip"', 'mode = "grip", torque = 4.0').replace("11.0,", "4.0,")
    spec = spec_of(text, "test")
    plant = make_loop(spec).plant
    free, bound = (friction_accelerations(plant, spec.contact, 0.6, torque) for torque in ((), (4.0, 4.0)))
    assert bound.acceleration == bound.deceleration < 0.5 * free.acceleration and bound.angular < free.angular
    assert bound.lateral == free.lateral
    names = [p.name for p in plant.system.mechanism.parameters]
    m_c, m_w, I_w, r = (plant.parameters[names.index(name)] for name in ("m_c", "m_w", "I_w", "r"))
    assert bound.acceleration == pytest.approx(2 * 0.6 * 4.0 / r / (m_c + 2 * m_w + 2 * I_w / r**2), rel=1e-6)
    run = simulate(spec)
    assert set(run.status[run.piece == 0]) == {"ok"} and np.abs(run.tau[run.piece == 0]).max() < 4.0


@pytest.mark.parametrize(
    "changes, said",
    [
        (
            {"contact = { mu = 0.5, height = 0.1 }": "", 'limits = { mode = "grip" }': ""},
            "accelerations out requires .contact",
        ),
        (
            {'"fastest"': "1.0, angular = 1.0"},
            "angular requires a profile of the speed: give lateral, or speed",
        ),
        ({'"fastest"': "1.0, lateral = -1.0"}, "must be positive"),
        ({'"fastest"': '"slowest"'}, "slowest"),
    ],
)
def test_refused_specs(changes, said):
    text = SPEC
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    with pytest.raises(BadInput, match=said):
        simulate(spec_of(text, "test"))


START = "[initial]\npoint = [0.0, 1.0]\n"


@pytest.mark.parametrize("approach", ["", ", approach = { acceleration = 0.5 }"], ids=["at once", "led"])
@pytest.mark.parametrize(
    ("point", "heading"), [((-0.3, 0.3), 0.0), ((0.0, -0.6), 0.3), ((-0.4, -0.5), -0.2), ((0.2, 0.9), 0.0)]
)
def test_the_path_is_reached_from_rest_behind_and_beside_it(point, heading, approach):
    """As with a speed of 1 m/s from the start; it begins at once, and creeps nowhere."""
    start = f"[initial]\npoint = {list(point)}\nheading = {heading}\nspeed = 0.0\n"
    for speed in ('"fastest"', "1.0, deceleration = 1.0"):
        run = simulate(
            spec_of(SPEC.replace('"fastest"', speed + approach).replace("11.0", "6.0") + start, "test")
        )
        assert not run.stopped and abs(run.y[-1, 0]) < 5e-3, (speed, run.y[-1])
        assert run.y[run.t > 0.5, 1].min() > 0.05, speed


def test_other_paths_have_no_profile():
    with pytest.raises(BadInput, match="requires a composite path"):
        spec_of(
            SPEC[: SPEC.index("path = ")] + 'path = { kind = "line", A = 1.0, B = 0.0, C = 0.0 }\n' + START,
            "test",
        )


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_the_c_refuses(scalar):
    """Limits and places that are not finite, and what is not initialized."""
    segments, options, _ = PATHS["bend"]
    for changed in (
        {"lateral": 0.0},
        {"acceleration": math.nan},
        {"deceleration": math.inf},
        {"angular": -1.0},
    ):
        with pytest.raises(BadInput, match="accelerations must be finite"):
            SpeedProfile(segments, options, replace(LIMITS, **changed), scalar)
    profile = SpeedProfile(segments, options, LIMITS, scalar)
    for guide, speed in (
        (Guide("ok", progress=math.nan), 1.0),
        (Guide("ok"), math.inf),
        (Guide("ok", segment=3), 1.0),
    ):
        with pytest.raises(BadInput):
            profile.speed(guide, speed)
    assert LIMITS.top_speed(segments) > max(profile.along(k, 1.0) for k in range(3))
    beyond = Guide("ok", segment=2, x=9.0, speed=0.3, speed_rate=-0.1)
    assert profile.speed(beyond, 0.3) == pytest.approx((0.3, -0.1)), (
        "on the extension the path's own speed stays"
    )


def test_it_stands_at_a_cusp():
    """On lines: v^2 = 2 a s from rest and to rest on both runs; after the cusp P_l first changes sides."""
    there = joined((2.0, 0.0))
    segments = [*there, Segment(*there[0].end, 0.0, 3.0, True)]
    options = TrackerOptions(speed=50.0, L=(0.1, -0.9), ahead=0.3, reversing="switch")
    profile, sides = SpeedProfile(segments, options, LIMITS, "double"), 0.4 + 0.6
    for k, begin, length in ((0, 0.0, 2.0), (1, sides, 3.0)):
        for on in np.linspace(0.05, length - 0.05, 30):
            square = 2 * min(LIMITS.acceleration * max(on - begin, 0.0), LIMITS.deceleration * (length - on))
            assert profile.along(k, on) == pytest.approx(max(math.sqrt(square), 0.01), rel=1e-9), (k, on)


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_a_slow_line(scalar):
    """v^2 = 2 a s where that is small, too: a line has no arc's angle,
    which is v^2 over the largest number."""
    slow = replace(LIMITS, acceleration=1e-3, deceleration=1e-3)
    profile = SpeedProfile(joined((2.0, 0.0)), TrackerOptions(speed=1.0, L=(0.1, 0.1)), slow, scalar)
    for on in np.linspace(0.2, 1.8, 9):
        assert profile.along(0, on) == pytest.approx(math.sqrt(2e-3 * min(on, 2.0 - on)), rel=1e-5), on


def test_a_closed_path_repeats():
    """The laps of a stadium: its profile at the start is that at the end, and its bends limit it."""
    stadium = joined((2.0, 0.0), (math.pi, 1.0), (2.0, 0.0), (math.pi, 1.0))
    options = TrackerOptions(speed=50.0, L=(0.1, 0.0), ahead=0.2, closed=True)
    profile, open_path = (
        SpeedProfile(stadium, replace(options, closed=closed), LIMITS, "double") for closed in (True, False)
    )
    assert profile.along(0, 0.0) == pytest.approx(profile.along(3, math.pi), rel=1e-12)
    assert profile.along(0, -0.2) == profile.along(0, 0.0)
    assert profile.along(0, 1.0) == pytest.approx(profile.along(2, 1.0), rel=1e-12)
    axle = math.sqrt(1 - 0.3**2)
    assert profile.along(1, math.pi / 2) == pytest.approx(math.sqrt(LIMITS.lateral * axle), rel=1e-9)
    assert open_path.along(0, 0.0) == 0.01 and open_path.along(2, 1.0) == pytest.approx(
        profile.along(2, 1.0), rel=1e-12
    )


@pytest.mark.parametrize("scalar", ["double", "float"])
@pytest.mark.parametrize("progress", [-0.7, -1e-3, 0.0, 0.3, 0.5, 3.0])
def test_the_speed_rises_from_where_the_vehicle_is(progress, scalar):
    """v^2 = 2 a s from rest there, also behind the beginning of the path, but not later than from its
    beginning, where P_l is 0.5 m ahead of the axle."""
    options = TrackerOptions(speed=50.0, L=(0.2, -0.9), ahead=0.3, stop="axle")
    profile = SpeedProfile(joined((4.0, 0.0)), options, LIMITS, scalar, progress=progress)
    begin = min(progress, 0.5)
    for on in begin + np.linspace(-0.1, 2.0, 22):
        expected = math.sqrt(2 * LIMITS.acceleration * max(on - begin, 0.0))
        assert profile.along(0, float(on)) == pytest.approx(max(expected, 0.01), rel=1e-5), on
    slow = SpeedProfile(joined((4.0, 0.0)), replace(options, creep=0.05), LIMITS, scalar, progress=progress)
    assert slow.along(0, begin) == pytest.approx(0.05, rel=1e-6)
