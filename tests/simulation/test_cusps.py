"""Courses with cusps: the curve and the tracker in C, and runs of a car and of trailers,
against paths integrated here."""

import json
import math
from dataclasses import replace
from pathlib import Path

import noslip
import numpy as np
import pytest
from noslip.cli.main import main
from noslip.codegen.runtime import runtime_files
from noslip.readers.errors import BadInput
from noslip.simulation.closed_loop import simulate
from noslip.simulation.controllers.runtime import SOURCE, Runtime, load, runtime
from noslip.simulation.planning import course_tracker, reeds_shepp
from noslip.simulation.planning.course import SmoothCurve
from noslip.simulation.planning.course_tracker import CourseOptions, CourseTracker
from noslip.simulation.planning.points import read_reference
from noslip.simulation.planning.ramps import with_ramps
from noslip.simulation.specification.spec import read_spec, spec_of
from noslip.simulation.specification.vary import read_varied
from noslip.tests.runtime_c.test_course import CourseInC
from scipy.integrate import cumulative_simpson, solve_ivp

BACKING = Path(noslip.__file__).parent / "examples/specs" / "backing"
TURN = SmoothCurve(1.0, -0.5, 0.3, 1.0, (1.0, 2.0, -1.5, -2.0, 1.0), (0.0, 0.3, 0.25, -0.4, -0.4, 0.0))


def driven(curve: SmoothCurve, steps: int = 200) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return way (m), place x + i y and heading (rad) of a vehicle whose curvature is that of a course
    without rounding, integrated over its signed lengths: it turns by curvature times what it drives, forward
    and in reverse.
    """
    way, place, heading = [0.0], [complex(curve.x, curve.y)], [curve.heading]
    for length, first, last in zip(curve.lengths, curve.curvatures, curve.curvatures[1:], strict=False):

        def rate(u: float, pose: np.ndarray, length=length, first=first, last=last) -> list[float]:
            part = u**5 * (126.0 - 420.0 * u + 540.0 * u**2 - 315.0 * u**3 + 70.0 * u**4)
            bend = first + (last - first) * part
            return [length * math.cos(pose[2]), length * math.sin(pose[2]), length * bend]

        u = np.linspace(0.0, 1.0, steps + 1)
        run = solve_ivp(
            rate,
            (0.0, 1.0),
            [place[-1].real, place[-1].imag, heading[-1]],
            "DOP853",
            u,
            rtol=1e-12,
            atol=1e-14,
        )
        way += list(way[-1] + abs(length) * u[1:])
        place += list(run.y[0, 1:] + 1j * run.y[1, 1:])
        heading += list(run.y[2, 1:])
    return np.array(way), np.array(place), np.array(heading)


@pytest.mark.parametrize(("scalar", "tolerance"), [("double", 1e-10), ("float", 5e-5)])
def test_the_curve_is_what_a_vehicle_drives(scalar, tolerance):
    """In C and in Python; its direction is that of travel, and turns by half a turn at each cusp."""
    way, place, heading = driven(TURN, 40)
    course = CourseInC(TURN, scalar)
    assert course.status == "ok" and TURN.cusps == 2 and TURN.way == 7.5
    for s, at, angle in zip(way, place, heading, strict=True):
        if min(abs(s - 3.0), abs(s - 6.5)) > 1e-6:
            status, (found, rate, *_) = course.derivatives(s, 1.0)
            travel = np.exp(1j * angle) * (-1.0 if 3.0 < s < 6.5 else 1.0)
            assert status == "ok" and abs(found - at) < tolerance and abs(TURN.position(s) - at) < 1e-10
            assert abs(rate - travel) < 4 * tolerance and abs(np.exp(1j * TURN.direction(s)) - travel) < 1e-10
    ends = [piece.position(piece.way) for piece in TURN.pieces]
    assert np.abs(np.array(ends) - place[[80, 160, 200]]).max() < 1e-10


def test_the_curvature_of_a_vehicle_continues_at_a_cusp():
    """Seen against the direction it changes its sign, and so do its derivatives of even order."""
    for rounding in (0.0, 0.2):
        curve = replace(
            TURN, lengths=(2.0, 1.0, -1.5, -1.0), curvatures=(0.0, 0.3, 0.3, 0.3, -0.2), rounding=rounding
        )
        there, back = (curve.pieces[k] for k in (0, 1))
        assert there.bend(there.way - 1e-12) == pytest.approx(0.3, abs=1e-12) and back.bend(
            0.0
        ) == pytest.approx(-0.3, abs=1e-12)
        assert there.position(there.way) == pytest.approx(back.position(0.0), abs=1e-13)
        assert abs(back.direction(0.0) - there.direction(there.way)) == pytest.approx(math.pi, abs=1e-13)
        in_c = CourseInC(curve)
        for s in np.linspace(0.05, curve.way - 0.05, 40):
            assert abs(in_c.derivatives(s)[1][0] - curve.position(s)) < 1e-13


OPTIONS = CourseOptions(speed=0.5, deceleration=0.25, creep=0.02)


def march(tracker: CourseTracker, way: np.ndarray, place: np.ndarray, heading: np.ndarray, speeds) -> list:
    """The guides of a vehicle that drives along with these speeds."""
    pairs = zip(place, heading, speeds, strict=True)
    return [tracker.update(at.real, at.imag, angle, float(v)) for at, angle, v in pairs]


@pytest.mark.parametrize(("scalar", "tolerance"), [("double", 1e-9), ("float", 1e-4)])
def test_a_vehicle_on_the_course(scalar, tolerance):
    """The tracker is where the vehicle is, in every piece; it slows down, waits at cusps, and arrives."""
    way, place, heading = driven(TURN)
    tracker, found, stops = CourseTracker(TURN, OPTIONS, scalar), [], np.array([3.0, 6.5, 7.5])
    for s, at, angle in zip(way, place, heading, strict=True):
        piece, at_stop = int(sum(s > stops[:2] + 1e-6)), np.any(np.abs(stops - s) < 1e-6)
        # Of a vehicle that overshoots, and stands there
        beyond = at + 1e-3 * np.exp(1j * angle) * (-1.0) ** piece
        if at_stop:
            found.append(tracker.update(beyond.real, beyond.imag, angle, 0.3))
            assert (found[-1].waiting or s > 7.0) and not found[-1].changed and found[-1].speed == 0.0
            found.append(tracker.update(beyond.real, beyond.imag, angle, 0.0))
            assert found[-1].changed == (s < 7.0) and found[-1].arrived == (s > 7.0)
            continue
        guide = tracker.update(at.real, at.imag, angle, 0.3)
        left = stops[piece] - s
        assert guide.piece == piece and guide.backward == (piece == 1) and guide.status == "ok"
        assert guide.length == pytest.approx(s, abs=tolerance) and abs(guide.distance) < tolerance
        assert guide.left == pytest.approx(left, abs=tolerance)
        fastest = min(0.5, max(0.02, math.sqrt(2.0 * 0.25 * left)))
        assert guide.speed == pytest.approx(-fastest if piece == 1 else fastest, abs=math.sqrt(tolerance))
        forward = np.exp(1j * (guide.direction + math.pi * guide.backward))
        assert abs(forward - np.exp(1j * angle)) < 10 * tolerance
        found.append(guide)
    changes = [k for k, guide in enumerate(found) if guide.changed]
    assert [found[k].piece for k in changes] == [0, 1, 2] and found[-1].status == "arrived"


def test_double_and_float_agree_and_both_are_reproducible():
    way, place, heading = driven(TURN, 60)
    seen = [place + 0.05j, heading + 0.02, np.where(np.isin(way, (3.0, 6.5)), 0.0, 0.3)]
    double, again = (march(CourseTracker(TURN, OPTIONS), way, *seen) for _ in range(2))
    single = march(CourseTracker(TURN, OPTIONS, "float"), way, *seen)
    assert double == again
    for one, other in zip(double, single, strict=True):
        assert one.status == other.status
        if one.piece == other.piece and one.waiting == other.waiting:
            assert one.length == pytest.approx(other.length, abs=1e-4) and one.distance == pytest.approx(
                other.distance, abs=1e-4
            )


def test_p_l_changes_sides_at_a_cusp():
    """P_l 0.4 m ahead of the axle, and as far behind it in reverse; where the axle stops,
    it has moved on by as much."""
    line = SmoothCurve(0.0, 0.0, 0.0, 1.0, (3.0, -3.0), (0.0, 0.0, 0.0))
    for stop, at in (("point", 2.6), ("axle", 3.0)):
        tracker = CourseTracker(line, replace(OPTIONS, L=(0.4, -0.4), stop=stop))
        guide = tracker.update(1.0, 0.1, 0.0, 0.5)
        assert (guide.L, guide.length, guide.left) == pytest.approx(
            (0.4, 1.4, at - 1.0)
        ) and guide.distance == pytest.approx(0.1)
        assert (
            not tracker.update(at - 1e-3, 0.1, 0.0, 0.5).waiting
            and tracker.update(at + 1e-3, 0.1, 0.0, 0.5).waiting
        )
        assert tracker.look(at, 0.1, 0.0, 0.01).waiting
        guide = tracker.update(at, 0.1, 0.0, 0.01)
        assert guide.changed and guide.backward and guide.L == -0.4 and guide.speed == -0.5
        assert guide.length == pytest.approx(3.0 + (3.0 - at) + 0.4) and guide.distance == pytest.approx(-0.1)


def test_a_vehicle_that_faces_against_the_course():
    line = SmoothCurve(0.0, 0.0, 0.0, 1.0, (3.0, -2.0), (0.0, 0.0, 0.0))
    tracker = CourseTracker(line, replace(OPTIONS, speed=-0.5))
    assert (
        tracker.update(0.5, 0.0, math.pi, -0.5).backward
        and tracker.update(3.0, 0.0, math.pi, 0.0).speed == 0.5
    )


def test_what_a_tracker_refuses():
    """Options, poses, and courses; on an error nothing changes, and nothing is written."""
    for wrong in (
        *(
            replace(OPTIONS, **{name: value})
            for name in ("speed", "deceleration", "creep", "window")
            for value in (math.nan, math.inf)
        ),
        replace(OPTIONS, speed=0.0),
        replace(OPTIONS, deceleration=-1.0),
        replace(OPTIONS, L=(0.0, math.nan)),
    ):
        with pytest.raises(BadInput, match="too large"):
            CourseTracker(TURN, wrong)
    with pytest.raises(BadInput, match="diverges"):
        CourseTracker(TURN, replace(OPTIONS, L=(0.3, 0.3)))
    assert (
        CourseTracker(TURN, replace(OPTIONS, L=(0.3, 0.3), reversing="allow", stop="axle"))
        .update(1.0, -0.5, 0.3, 0.0)
        .L
        == 0.3
    )
    with pytest.raises(BadInput, match="too short"):
        CourseTracker(TURN, replace(OPTIONS, L=(0.6, -0.6)))
    CourseTracker(TURN, replace(OPTIONS, L=(0.6, -0.6), stop="axle"))
    tracker = CourseTracker(TURN, replace(OPTIONS, window=0.1))
    first = tracker.update(1.0, -0.5, 0.3, 0.0)
    for pose, status in (
        ((math.nan, 0.0, 0.0, 0.0), "nonfinite"),
        ((1.0, 0.0, math.inf, 0.0), "nonfinite"),
        ((1.0, 0.0, 0.0, math.nan), "nonfinite"),
        ((1.0, 0.0, 1e9, 0.0), "range"),
        ((1.0 + 0.3 * math.cos(0.3), -0.5 + 0.3 * math.sin(0.3), 0.3, 0.0), "singular"),  # beyond the window
    ):
        assert tracker.update(*pose).status == status
    assert replace(tracker.update(1.0, -0.5, 0.3, 0.0), changed=True) == first


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_null_and_not_ready(scalar):
    c, course = runtime("noslip_course.h"), CourseInC(TURN, scalar)
    options, tracker = (
        c.new("noslip_course_tracker_options", scalar, {"speed": 0.5}),
        c.new("noslip_course_tracker", scalar),
    )
    guide, null = c.new("noslip_course_guide", scalar), c.ffi.NULL

    def call(name: str, *arguments) -> str:
        return c.status(c.function(f"noslip_course_tracker_{name}", scalar)(*arguments))

    pose = (1.0, -0.5, 0.3, 0.0)
    assert call("init", null, course.self, options) == call("init", tracker, null, options) == "null"
    assert (
        call("init", tracker, course.self, null) == "null"
        and call("update", tracker, *pose, guide) == "not_ready"
    )
    assert call("init", tracker, c.new("noslip_course", scalar), options) == "not_ready"
    assert call("init", tracker, course.self, options) == "ok"
    for name in ("look", "update"):
        assert call(name, null, *pose, guide) == call(name, tracker, *pose, null) == "null"
        assert call(name, tracker, *pose, guide) == "ok"


def test_a_cusp_where_the_rate_would_jump_is_no_course():
    """With a rounding, parts that meet at a cusp must have the same constant curvature."""
    curve = replace(TURN, lengths=(2.0, 1.0, -1.5), curvatures=(0.0, 0.3, 0.3, 0.3), rounding=0.2)
    assert CourseInC(curve).status == "ok"
    for curvatures in ((0.0, 0.3, 0.2, 0.2), (0.0, 0.3, 0.3, 0.2)):
        assert CourseInC(replace(curve, curvatures=curvatures)).status == "bad_parameter"
        assert CourseInC(replace(curve, curvatures=curvatures, rounding=0.0)).status == "ok"


SPEC = """
robot = "labmate"
OUTPUT
[reference]
deceleration = 0.3
creep = 0.005
[reference.course]
speed = 0.5
lengths = [1.0, 1.0, -1.0, -1.0]
curvatures = [0.0, 0.5, 0.5, 0.0, -0.4]
[initial]
point = [0.0, 0.05]
heading = 0.0
speed = 0.0
[simulation]
duration = 14.0
output_step = 0.01
backend = "casadi"
"""
ON_AXLE = '[output]\ntype = "IV"\nL = -0.3\narclength = true\npath = { kind = "course" }'
BESIDE = '[output]\ntype = "IV"\nL = 0.0\nreversing = "switch"\npath = { kind = "course", stop = "axle" }'


@pytest.mark.nightly
def test_the_middle_of_the_axle_through_a_cusp():
    """From 5 cm beside the course, at rest: (d/ds + 1)^2 e = 0 in the way s of each piece. At the cusp left
    and right change, and an error that was on its way back leads away at first; that the law takes it over
    while the vehicle creeps costs 0.05 mm.
    """
    run = simulate(spec_of(SPEC.replace("OUTPUT", ON_AXLE), "spec"))
    assert run.stopped is None and list(np.unique(run.piece)) == [0, 1] and abs(run.y[-1, 1]) < 1e-3
    first = np.flatnonzero(run.piece == 1)[0]
    e, rate = 0.05, 0.0
    for piece, tolerance in ((slice(0, first), 1e-6), (slice(first, None), 5e-4)):
        along = run.y[piece, 1] * np.cos(run.q[piece, 2] - run.config[piece, 2])
        way = cumulative_simpson(along, x=run.t[piece], initial=0.0)
        expected = (e + (e + rate) * way) * np.exp(-way)
        assert way[-1] > 1.9 and np.abs(run.distance[piece] - expected).max() < tolerance
        e, rate = -expected[-1], (rate - (e + rate) * way[-1]) * math.exp(-way[-1])
    csv = run.csv().splitlines()
    assert csv[0].endswith("distance,piece") and csv[-1].endswith(",1")
    assert float(csv[-1].split(",")[-2]) == run.distance[-1]


@pytest.mark.nightly
def test_a_point_off_the_axle_changes_sides():
    """P_l 0.3 m ahead of the axle, behind it in reverse: the distance has the poles -0.5 and -2 1/s,
    also at a standstill."""
    run = simulate(spec_of(SPEC.replace("OUTPUT", BESIDE), "spec"))
    assert run.stopped is None and list(np.unique(run.piece)) == [0, 1] and abs(run.y[-1, 1]) < 1e-3
    L, first = run.config[:, [c.name for c in run.law.config].index("L")], np.flatnonzero(run.piece == 1)[0]
    assert (
        set(L[:first]) == {0.0}
        and set(L[first:]) == {-0.6}
        and np.abs(run.distance - run.y[:, 0]).max() < 1e-9
    )
    for piece in (slice(0, first), slice(first, None)):
        t, e = run.t[piece] - run.t[piece][0], run.distance[piece]
        rate = np.gradient(e, t, edge_order=2)[0]
        a = (2.0 * e[0] + rate) / 1.5
        expected = a * np.exp(-0.5 * t) + (e[0] - a) * np.exp(-2.0 * t)
        assert np.abs(e - expected).max() < 1e-4
    assert (
        np.abs(
            run.distance[:first] - 0.05 / 3.0 * (4.0 * np.exp(-0.5 * run.t) - np.exp(-2.0 * run.t))[:first]
        ).max()
        < 1e-6
    )


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("backend", "period", "tolerance"), [("cf", 0.01, 1e-3), ("c", 0.01, 1e-3), ("casadi", 0.0, 1e-8)]
)
def test_a_car_turns_in_three_points(backend, period, tolerance):
    """Its rear axle against the path that is integrated here, and its heading at the end."""
    spec = read_varied(
        BACKING / "three_point.toml", {"simulation.backend": backend, "simulation.period": period}
    )
    course = spec.reference.course
    assert course is not None
    curve = SmoothCurve(0.0, 0.0, course.heading, course.speed, course.lengths, course.curvatures)
    way, place, heading = driven(curve, 2000)
    run = simulate(spec)
    assert run.stopped is None and list(np.unique(run.piece)) == [0, 1, 2]
    at = run.q[:, 0] + 1j * run.q[:, 1]
    far = np.abs(at[:, None] - place[None, ::4]).min(axis=1)
    assert far.max() < tolerance + 3e-3 and np.abs(run.distance).max() < tolerance
    assert abs(at[-1] - place[-1]) < 0.02 and abs(run.q[-1, 2] - heading[-1]) < 0.02


@pytest.mark.nightly
def test_trailers_in_a_yard():
    """10 cm beside the course at first; stops, backs along an S, and ends on it."""
    run = simulate(read_spec(BACKING / "yard.toml"))
    assert run.stopped is None and list(np.unique(run.piece)) == [0, 1] and abs(run.distance[-1]) < 1e-6
    assert np.abs(run.q[:, 3:5]).max() < math.radians(45) and abs(run.y[-1, 1]) < 1e-6


REFUSED = {
    "zero": ("lengths = [1.0, 1.0", "lengths = [0.0, 1.0", "has a length of 0"),
    "rounding": (
        "speed = 0.5\nlengths",
        "rounding = 0.2\nspeed = 0.5\nlengths",
        "the parts at a cusp, after .2.",
    ),
    "extension": ("arclength = true", "extension = true", "singular at standstill"),
    "reversing": (
        'arclength = true\npath = { kind = "course" }',
        'path = { kind = "course" }',
        'requires .* or .output. reversing = "switch"',
    ),
    "arclength reversing": (
        "arclength = true",
        'arclength = true\nreversing = "switch"',
        "arclength does not go with .output. reversing",
    ),
    "lateral": ("creep = 0.005", "lateral = 1.0", "lateral requires a composite path"),
    "stop": ('kind = "course"', 'kind = "course", stop = "wheel"', "stop"),
    "closed": ('kind = "course"', 'kind = "course", closed = true', "closed"),
    "other output": (
        'type = "IV"\nL = -0.3\narclength = true\npath = { kind = "course" }',
        'type = "I"\nL = 0.0',
        "IV",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_a_spec_refuses(name):
    old, new, says = REFUSED[name]
    text = SPEC.replace("OUTPUT", ON_AXLE)
    assert old in text
    text = text.replace(old, new, 1)
    if name == "other output":
        text = text.replace("deceleration = 0.3\ncreep = 0.005\n", "position = [0.0, 0.0]\n")
    with pytest.raises(BadInput, match=says):
        simulate(spec_of(text, "spec"))


def test_planned_paths_become_courses():
    """Reeds and Shepp's between random poses, with ramps: driven here they end at the goal,
    and turn no more sharply."""
    random, made, cusps = np.random.default_rng(7), 0, 0
    for _ in range(20):
        goal = *random.uniform(-6.0, 6.0, 2), random.uniform(-3.0, 3.0)
        try:
            curve = with_ramps(reeds_shepp((0.5, -0.2, 0.4), goal, 2.0), 0.2, 0.7)
        except BadInput as error:
            assert "ramps of 0.2 m" in str(error)
            continue
        _, place, heading = driven(curve, 2)
        assert (
            abs(place[-1] - complex(*goal[:2])) < 1e-8
            and abs(np.exp(1j * (heading[-1] - goal[2])) - 1.0) < 1e-8
        )
        assert (curve.x, curve.y, curve.heading, curve.speed) == pytest.approx(
            (0.5, -0.2, 0.4, 0.7), abs=1e-12
        )
        assert (
            curve.curvatures[0] == curve.curvatures[-1] == 0.0
            and np.abs(curve.curvatures).max() < 0.5 + 1e-12
        )
        made, cusps = made + 1, cusps + curve.cusps
    assert made >= 8 and cusps >= 8


def test_the_command_writes_such_a_course(tmp_path, capsys):
    out, picture = tmp_path / "course.json", tmp_path / "course.png"
    command = [
        "plan",
        "reeds-shepp",
        "--from",
        "0",
        "0",
        "0",
        "--to",
        "0",
        "2",
        "180",
        "--degrees",
        "--radius",
        "3",
    ]
    assert (
        main(
            [*command, "--course", "0.5", "--speed", "0.4", "--json", "-o", str(out), "--plot", str(picture)]
        )
        == 0
    )
    said = json.loads(capsys.readouterr().out)
    assert said["cusps"] == 2 and said["parts"] == 9 and picture.read_bytes().startswith(b"\x89PNG")
    read = read_reference(out)["course"]
    assert (
        read["speed"] == 0.4
        and [length < 0.0 for length in read["lengths"]] == [False] * 3 + [True] * 3 + [False] * 3
    )
    for more, says in (
        (["--course", "5"], "ramps of 5 m"),
        (["--course", "-1"], "ramp = -1 must be positive"),
        (["--course", "0.5", "--c"], "--c prints lines and arcs"),
        (["--speed", "1"], "--speed requires --course"),
    ):
        assert main([*command, *more]) == 2
        refusal = capsys.readouterr().err.strip()
        assert says in refusal and refusal.count("\n") == 0


DEFECTS = {  # what is changed in the C, in double
    "no turn at a cusp": ("own->backward ? (double)NOSLIP_COURSE_BACK : -(double)NOSLIP_COURSE_BACK", "0.0"),
    "a curvature without its sign": ("own->backward ? -curvature[k] : curvature[k]", "curvature[k]"),
    "does not wait": ("noslip_abs(forward_speed) <= self->options.creep", "noslip_abs(forward_speed) < 1e9"),
    "forward in reverse": ("speed = backward ? -top : top,", "speed = top,"),
    "does not stop": ("now->stopped = now->stopped ||", "now->stopped = 0 &&"),
}


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.nightly) if n != "does not wait" else n for n in DEFECTS]
)
def test_a_planted_defect_is_found(name, monkeypatch):
    """By the walk along the course: it is given the changed C."""
    text = runtime_files()["noslip_course.h"]
    assert [old for old, _ in DEFECTS.values() if old not in text] == []
    old, new = DEFECTS[name]
    planted = Runtime.__new__(Runtime)
    planted.ffi = runtime("noslip_course.h").ffi
    planted.lib = load(
        planted.ffi, {"library.c": SOURCE.replace('#include "{header}"\n', "") + text.replace(old, new, 1)}
    )
    monkeypatch.setattr(course_tracker, "runtime", lambda header: planted)
    with pytest.raises((AssertionError, BadInput)):
        test_a_vehicle_on_the_course("double", 1e-9)
