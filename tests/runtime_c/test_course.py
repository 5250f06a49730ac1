"""Courses in C, noslip_course.h: against the curve that simulations use, closed forms,
and what is refused."""

import math

import numpy as np
import pytest
from noslip.readers.errors import BadInput
from noslip.simulation.controllers.runtime import runtime
from noslip.simulation.planning import course
from noslip.simulation.planning.course import SmoothCurve

HEADER = "noslip_course.h"
CLOTHOID = SmoothCurve(1.0, 2.0, 0.3, 0.7, (2.0, 4.0, 5.0), (0.0, 0.0, 0.2, 0.2), 0.2)


class CourseInC:
    """A course of the C in one scalar, with the numbers of a SmoothCurve; `status` is that of init."""

    def __init__(self, curve: SmoothCurve, scalar: str = "double", room: int | None = None):
        self._c, self._scalar, self._speed = runtime(HEADER), scalar, curve.speed
        count = len(curve.lengths)
        self._lengths, self._curvatures = (
            self._c.array(scalar, values) for values in (curve.lengths, curve.curvatures)
        )
        place = {
            "x": curve.x,
            "y": curve.y,
            "heading": curve.heading,
            "rounding": curve.rounding,
            "count": count,
        }
        arrays = {"lengths": self._lengths, "curvatures": self._curvatures}
        self.options = self._c.new("noslip_course_options", scalar, place | arrays)
        kind = "noslip_stretch" + ("_f" if scalar == "float" else "")
        self.room = 2 * count + 1 if room is None else room
        self._stretches = self._c.ffi.new(f"{kind}[]", max(self.room, 1))
        self.self, self._point = (
            self._c.new("noslip_course", scalar),
            self._c.new("noslip_course_point", scalar),
        )
        self._length = self._c.array(scalar, [0.0])
        self.status = self.call("init", self._stretches, self.room, self.options)

    def call(self, name: str, *arguments) -> str:
        return self._c.status(self._c.function(f"noslip_course_{name}", self._scalar)(self.self, *arguments))

    def derivatives(self, length: float, speed: float | None = None) -> tuple[str, np.ndarray]:
        status = self.call("at", length, self._speed if speed is None else speed, self._point)
        return status, np.array(list(self._point.x)) + 1j * np.array(list(self._point.y))

    def nearest(self, point: complex, near: float) -> tuple[str, float]:
        self._length[0] = near
        return self.call("nearest", point.real, point.imag, self._length), self._length[0]


def random_curve(random: np.random.Generator) -> SmoothCurve:
    """A curve of one to five parts, half of them rounded, some of them lines and arcs."""
    count = int(random.integers(1, 6))
    lengths = tuple(random.uniform(0.5, 5.0, count))
    curvatures = random.choice([0.0, 0.0, 0.3, *random.uniform(-0.6, 0.6, 4)], count + 1)
    rounding = random.choice([0.0, random.uniform(0.05, 1.0) * min(lengths)])
    place = random.uniform(-3.0, 3.0, 3)
    return SmoothCurve(*place, random.uniform(0.2, 2.0), lengths, tuple(curvatures), rounding)


@pytest.mark.parametrize(("scalar", "place", "rates"), [("double", 2e-14, 1e-13), ("float", 1e-4, 2e-3)])
def test_the_c_is_the_curve_of_simulations(scalar, place, rates):
    """Position, and six derivatives relative to their largest values, before, on and after random courses."""
    random = np.random.default_rng(21)
    for _ in range(20):
        curve = random_curve(random)
        course, end = CourseInC(curve, scalar), curve.stretches[-1].begin
        largest = np.abs(
            [curve.derivatives(length / curve.speed, 6) for length in np.linspace(-0.3, end + 3.0, 40)]
        ).max(axis=0)
        for length in random.uniform(-0.3, end + 3.0, 8):
            status, found = course.derivatives(length)
            off = np.abs(found - curve.derivatives(length / curve.speed, 6))
            assert course.status == status == "ok" and off[0] < place * end
            assert (off[1:] < rates * np.maximum(1.0, largest[1:])).all()


@pytest.mark.parametrize(("scalar", "place", "rates"), [("double", 1e-13, 1e-13), ("float", 2e-5, 2e-5)])
def test_before_its_beginning_the_first_curvature_stays(scalar, place, rates):
    """Random courses are there the line or arc in closed form, in C and in simulations;
    also as far behind as they are long."""
    random = np.random.default_rng(5)
    for rounding in (0.0, 0.3, 0.5):
        for length in -(10.0 ** random.uniform(-6.0, 1.3, 8)):
            curvatures = (random.choice([0.0, random.uniform(-0.6, 0.6)]), *random.uniform(-0.6, 0.6, 2))
            curve = SmoothCurve(
                *random.uniform(-3.0, 3.0, 3), random.uniform(0.2, 2.0), (0.5, 2.0), curvatures, rounding
            )
            turn, speed = 1j * curvatures[0], curve.speed
            moved = np.expm1(turn * length) / turn if turn else length
            status, found = CourseInC(curve, scalar).derivatives(length)
            expected = np.exp(1j * curve.heading) * np.array(
                [moved, *[speed**n * turn ** (n - 1) * np.exp(turn * length) for n in range(1, 7)]]
            )
            expected[0] += complex(curve.x, curve.y)
            for each in (found, curve.derivatives(length / speed, 6)):
                off = np.abs(each - expected)
                assert status == "ok" and off[0] < place and off[1:].max() < rates


def test_the_beginning_is_smooth():
    """Six derivatives on both sides of it, without a rounding and with one if an arc begins;
    else all but those of the rate."""
    for rounding, curvatures, smooth in (
        (0.0, (0.1, 0.5), 6),
        (0.4, (0.3, 0.3, -0.2), 6),
        (0.4, (0.1, 0.5), 2),
    ):
        course = CourseInC(
            SmoothCurve(1.0, 2.0, 0.3, 1.0, (2.0,) * (len(curvatures) - 1), curvatures, rounding)
        )
        (_, before), (_, after) = (course.derivatives(length) for length in (-1e-11, 1e-11))
        same = np.abs(after - before) < 1e-7
        assert same[: smooth + 1].all() and same.all() == (smooth == 6)


def test_positions_are_those_of_clothoids_and_arcs():
    """The shape that Fresnel's integrals give is that of test_extension;
    here the arc's end in closed form, and its turn."""
    course = CourseInC(CLOTHOID)
    _, (at, rate, *_) = course.derivatives(2.0 + 4.0 + 0.1)
    _, (end, later, *_) = course.derivatives(2.0 + 4.0 + 0.1 + 7.0)
    assert np.angle(later / rate) == pytest.approx(0.2 * 7.0, abs=1e-14)
    assert end == pytest.approx(at + rate / abs(rate) * (np.exp(1.4j) - 1) / 0.2j, abs=1e-13)
    status, point = course.derivatives(3.0, -0.5)
    assert status == "ok" and abs(point[1]) == pytest.approx(0.5, abs=1e-15)


@pytest.mark.parametrize(
    ("length", "curvatures", "rounding"),
    [
        (1.0, (0.0, 8.0, 0.0), 0.0),
        (1.0, (3.0, -9.0, 2.0), 0.3),
        (1.0, (0.0, 12.0, 12.0), 1.0),
        (3.0, (-5.0, 5.0, -5.0), 3.0),
        # 0 at both ends of what is rounded: an error of 0.14 mm without what is in between
        (3.0, (-20.0, 20.0, -20.0), 3.0),
    ],
)
def test_places_where_the_curvature_is_largest_within_a_stretch(length, curvatures, rounding):
    """Against steps of a millimetre, each an arc of the curvature in its middle:
    an error of about 1e-6 of them, extrapolated."""
    curve = SmoothCurve(0.0, 0.0, 0.0, 1.0, (length, length), curvatures, rounding)
    in_c = CourseInC(curve)
    # It turns too far for the C
    assert in_c.status == ("bad_parameter" if max(curvatures) * rounding > 16.0 else "ok")

    def stepped(length: float, count: int) -> complex:
        h, place, heading = length / count, 0j, 0.0
        for k in range(count):
            at = (k + 0.5) * h
            stretch = max((s for s in curve.stretches if s.begin <= at), key=lambda s: s.begin)
            turn = h * stretch.curvature(at - stretch.begin)
            place += h * np.sinc(turn / 2 / np.pi) * np.exp(1j * (heading + turn / 2))
            heading += turn
        return place

    for along in length * np.array([0.5, 0.85, 1.0, 1.2, 1.5, 2.0]):
        dense = (4 * stepped(along, 4000) - stepped(along, 2000)) / 3
        assert abs(curve.position(along) - dense) < 2e-8
        assert in_c.status != "ok" or abs(in_c.derivatives(along)[1][0] - dense) < 2e-8


def test_the_c_and_the_simulation_find_the_same_places():
    """Also beyond the centre of curvature, where neither finds one, and from places farther away."""
    random, found, refused = np.random.default_rng(6), 0, 0
    for _ in range(40):
        curve = random_curve(random)
        in_c = CourseInC(curve)
        for _ in range(20):
            at = random.uniform(-1.0, curve.stretches[-1].begin + 1.0)
            point, rate = curve.derivatives(at / curve.speed, 1)
            point += 1j * rate / abs(rate) * random.uniform(-6.0, 6.0)
            near = at + random.uniform(-0.5, 0.5)
            (status, there), here = in_c.nearest(point, near), curve.nearest(point, near)
            assert status == ("singular" if math.isnan(here) else "ok")
            assert math.isnan(here) or here == pytest.approx(there, abs=1e-10)
            found, refused = found + (status == "ok"), refused + (status != "ok")
    assert found > 300 and refused > 30


@pytest.mark.parametrize(("scalar", "tolerance"), [("double", 1e-11), ("float", 1e-4)])
def test_the_nearest_place(scalar, tolerance):
    """From a place that is 0.3 m off; points as far as the centre of curvature have none."""
    random, course = np.random.default_rng(4), CourseInC(CLOTHOID, scalar)
    for at, beside in zip(random.uniform(-0.5, 14.0, 100), random.uniform(-1.0, 1.0, 100), strict=True):
        point, rate = CLOTHOID.derivatives(at / 0.7, 1)
        status, found = course.nearest(point + 1j * rate / 0.7 * beside, at + random.uniform(-0.3, 0.3))
        assert status == "ok" and found == pytest.approx(at, abs=tolerance)
    point, rate = CLOTHOID.derivatives(8.0 / 0.7, 1)
    assert course.nearest(point + 1j * rate / 0.7 * 4.8, 8.0) == ("singular", 8.0)
    assert course.nearest(complex(math.nan, 0.0), 8.0) == ("nonfinite", 8.0)
    assert course.nearest(complex(1.0, 2.0) - 1e30, 8.0)[0] in ("singular", "range")


WRONG = {  # what is changed, and what init returns
    "length": (dict(lengths=(2.0, 0.0, 5.0)), "bad_parameter"),
    "length not finite": (dict(lengths=(2.0, math.inf, 5.0)), "bad_parameter"),
    "curvature": (dict(curvatures=(0.0, math.nan, 0.2, 0.2)), "bad_parameter"),
    "rounding": (dict(rounding=2.1), "bad_parameter"),
    "rounding negative": (dict(rounding=-0.1), "bad_parameter"),
    "turn": (dict(curvatures=(0.0, 0.0, 5.0, 0.0)), "bad_parameter"),
    "heading": (dict(heading=1e9), "bad_parameter"),
}


@pytest.mark.parametrize("scalar", ["double", "float"])
@pytest.mark.parametrize("name", WRONG)
def test_what_is_no_course_is_refused(name, scalar):
    changed, status = WRONG[name]
    course = CourseInC(
        SmoothCurve(
            **{**vars(SmoothCurve(1.0, 2.0, 0.3, 0.7, (2.0, 4.0, 5.0), (0.0, 0.0, 0.2, 0.2), 0.2)), **changed}
        ),
        scalar,
    )
    assert course.status == status and course.self.ready == 0
    assert course.derivatives(1.0) == ("not_ready", pytest.approx(np.zeros(7))) and course.nearest(
        0j, 1.0
    ) == ("not_ready", 1.0)


def test_room_and_null():
    assert CourseInC(CLOTHOID, room=6).status == "full" and CourseInC(CLOTHOID, room=7).status == "ok"
    ok = CourseInC(CLOTHOID)
    assert ok.call("init", runtime(HEADER).ffi.NULL, 7, ok.options) == "null" and ok.self.ready == 0
    line = CourseInC(SmoothCurve(0.0, 0.0, 0.5, 1.0, (), (0.0,)))
    assert line.status == "ok" and line.derivatives(2.0)[1][0] == pytest.approx(2.0 * np.exp(0.5j), abs=1e-15)
    for length, status in ((math.nan, "nonfinite"), (1e300, "ok")):
        assert line.derivatives(length)[0] == status
    arc = CourseInC(SmoothCurve(0.0, 0.0, 0.5, 1.0, (), (1.0,)))
    assert arc.derivatives(2e6)[0] == "range" and arc.derivatives(2.0, math.inf)[0] == "nonfinite"


def meander(parts: int) -> SmoothCurve:
    """A course of parts of 2 m whose curvature goes to and fro."""
    return SmoothCurve(
        1.0, 2.0, 0.3, 1.0, (2.0,) * parts, tuple(0.4 * (-1) ** k for k in range(parts + 1)), 0.5
    )


def test_the_search_of_the_nearest_place_is_exhaustive(monkeypatch):
    """Among all places, over random points and curves; directions asked for grow as the length,
    and a limit is kept."""
    random = np.random.default_rng(21)
    for curve in [meander(12), *(random_curve(random) for _ in range(20))]:
        places = np.arange(2 + int(curve.stretches[-1].begin / course.NEAR)) * course.NEAR
        for _ in range(5):
            point = complex(*random.normal(scale=6.0, size=2))
            distances = [abs(point - curve.position(place)) for place in places]
            assert distances[round(curve._scanned(point) / course.NEAR)] == pytest.approx(
                min(distances), rel=0, abs=1e-12
            )

    asked, direction = [0], course.Stretch.direction

    def counted(stretch: course.Stretch, at: float) -> float:
        asked[0] += 1
        return direction(stretch, at)

    monkeypatch.setattr(course.Stretch, "direction", counted)
    works = []
    arcs = [SmoothCurve(0.0, 0.0, 0.0, 1.0, (length,), (1.0, 1.0)) for length in (50.0, 800.0)]
    for curve in (meander(25), meander(400), *arcs, SmoothCurve(0.0, 0.0, 0.0, 1.0, (1e6,), (0.0, 0.0))):
        asked[0] = 0
        curve.nearest(0.1 + 0.05j)
        works.append(asked[0])
    assert works[1] < 20 * works[0] and works[3] < 20 * works[2] and works[4] < 5000
    monkeypatch.setattr(course, "MOST", 1000)
    with pytest.raises(BadInput, match="800 m long.*1000 places"):
        arcs[1].nearest(0.1 + 0.05j)
