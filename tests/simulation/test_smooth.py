"""Courses fitted to points and splines: within the tolerance,
and followed by Type IV through `follow` and by an extended law."""

import json
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from noslip.cli.main import main
from noslip.codegen.program import FOLLOW
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot, law_of
from noslip.simulation.closed_loop import simulate
from noslip.simulation.controllers.backends import make_controller
from noslip.simulation.planning.smooth import fit_course
from noslip.simulation.plant import Plant
from noslip.simulation.specification.spec import spec_of
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

POINTS = [(0.0, 0.0), (2.0, 0.5), (4.0, 2.0), (6.0, 2.2), (8.0, 1.0)]
SPLINE = CubicSpline(np.linspace(0.0, 1.0, len(POINTS)), POINTS)


def far(course, dense: np.ndarray) -> float:
    """The largest distance of places of the course from a dense polygon, m; less what its chords cut off."""
    places = [course.position(s) for s in np.linspace(0.0, sum(course.lengths), 60)]
    a, b = dense[:-1], dense[1:]

    def nearest(place: complex) -> float:
        part = np.clip(((place - a) * (b - a).conj()).real / np.abs(b - a) ** 2, 0.0, 1.0)
        return float(np.abs(place - a - part * (b - a)).min())

    return max(nearest(place) for place in places)


@pytest.mark.parametrize("rounding", [0.0, 0.2])
@pytest.mark.parametrize("stated", [0.05, 0.01])
def test_the_course_is_within_the_stated_distance_and_smooth(stated, rounding):
    course = fit_course(SPLINE, stated, rounding=rounding)
    dense = SPLINE(np.linspace(0.0, 1.0, 5001)) @ [1, 1j]
    assert far(course, dense) < stated
    assert (
        abs(course.position(0.0) - dense[0]) < stated
        and abs(course.position(sum(course.lengths)) - dense[-1]) < stated
    )
    bends = [
        (one.curvature(one.length), other.curvature(0.0))
        for one, other in zip(course.stretches, course.stretches[1:], strict=False)
    ]
    assert max(abs(one - other) for one, other in bends) < 1e-9


def test_a_circle_is_one_arc():
    course = fit_course(lambda t: (3.0 * math.cos(t), 3.0 * math.sin(t)), 1e-3, domain=(0.0, 2.0))
    assert len(course.lengths) == 1
    assert course.curvatures == pytest.approx((1 / 3, 1 / 3), abs=1e-4) and sum(
        course.lengths
    ) == pytest.approx(6.0, abs=1e-3)


def test_what_cannot_be_fitted_is_refused():
    with pytest.raises(BadInput, match="corner"):
        fit_course(lambda t: (t, abs(t)), 0.01, domain=(-1.0, 1.3))
    with pytest.raises(BadInput, match="or rounding smaller"):
        fit_course(SPLINE, 1e-4, rounding=2.0)
    for name, values in {
        "rounding": (math.nan, math.inf, -1.0),
        "speed": (math.nan, math.inf, 0.0, -0.5),
    }.items():
        for value in values:
            with pytest.raises(BadInput, match=f"^{name} = {value:g} "):
                fit_course(POINTS, 0.01, **{name: value})


def test_a_course_is_printed_as_json_as_in_a_spec_and_drawn(tmp_path, capsys):
    points, picture = tmp_path / "points.csv", tmp_path / "course.png"
    points.write_text("".join(f"{x},{y}\n" for x, y in POINTS))
    command = ["plan", "course", str(points), "--tolerance", "0.5"]
    assert main(command) == 0
    spec = capsys.readouterr()
    assert spec.err.startswith("course: 1 part, ")
    assert main([*command, "--json", "--plot", str(picture)]) == 0
    assert json.loads(capsys.readouterr().out) == tomllib.loads(spec.out)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert main([*command, "--json", "-o", str(tmp_path / "course.json")]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["parts"] == 1 and said["files"] == [str(tmp_path / "course.json")]


@pytest.mark.parametrize(("L", "speed"), [(0.0, 1.0), (-0.6, -1.0)])
def test_type_iv_follows_a_spline_forward_and_in_reverse(L, speed):
    """`follow` with the foot on the course: the distance obeys its outer loop, here to 1e-6 m,
    as on a line."""
    course = fit_course(SPLINE, 0.01)
    law = law_of(find_robot("labmate"), "type_iv_segment")
    plant = Plant(law.system, [q.default for q in law.parameters])
    config = [{"L": L}.get(q.name, q.default) for q in law.config]
    controller = make_controller("c", law, plant.parameters, config, [q.default for q in law.gains])
    reference = np.array([{"speed": speed}.get(q.name, 0.0) for q in law.reference])
    heading = course.direction(0.3) + (math.pi if speed < 0 else 0.0)
    beside = 0.1
    P_l = course.position(0.3) + 1j * np.exp(1j * course.direction(0.3)) * beside
    start = np.array(
        [
            *(v := P_l - L * np.exp(1j * heading)).real.reshape(1),
            v.imag,
            heading,
            0.0,
            0.0,
            *[speed / 0.15] * 2,
        ]
    )
    near = [0.3]

    def foot(x: np.ndarray) -> tuple[float, ...]:
        P_l = complex(x[0], x[1]) + L * np.exp(1j * x[2])
        near[0] = course.nearest(P_l, near[0])
        direction = course.direction(near[0])
        stretch = course.stretches[course._part(near[0])]
        bend = stretch.curvature(near[0] - stretch.begin)
        distance = ((P_l - course.position(near[0])) * np.exp(-1j * direction)).imag
        angle = x[2] - direction
        return distance, math.cos(angle), math.sin(angle), bend / (1 - bend * distance)

    def rate(t: float, x: np.ndarray) -> np.ndarray:
        outcome = controller.entry(FOLLOW, x, foot(x), reference)
        assert outcome.status == "ok"
        return plant.rate(x, next(iter(outcome.values.values())).ravel())

    run = solve_ivp(rate, (0.0, 7.0), start, rtol=1e-9, atol=1e-11, t_eval=np.linspace(0.0, 7.0, 29))
    near[0] = 0.3
    distance = np.array([foot(x)[0] for x in run.y.T])
    a = 2.0 * beside / 1.5  # the heading is along the course there; poles -0.5 and -2
    expected = a * np.exp(-0.5 * run.t) + (beside - a) * np.exp(-2.0 * run.t)
    assert np.abs(distance - expected).max() < 1e-6


@pytest.mark.nightly
def test_an_extended_law_follows_a_fitted_course(tmp_path, capsys):
    """From the file of points to a run: the middle of the axle on the course that `noslip plan course`
    prints."""
    points, out = tmp_path / "points.csv", tmp_path / "reference.toml"
    points.write_text("x,y\n" + "".join(f"{x},{y}\n" for x, y in POINTS))
    assert main(["plan", "course", str(points), "--tolerance", "0.02", "--speed", "0.5", "-o", str(out)]) == 0
    assert "largest curvature" in capsys.readouterr().out
    text = 'robot = "labmate"\noutput = { type = "I", L = -0.3, extension = true }\n'
    text += (
        "initial = { point = [0.05, -0.05], heading = 0.1, speed = 0.5 }\nsimulation = { duration = 14.0 }\n"
        + out.read_text()
    )
    run = simulate(spec_of(text, Path(tmp_path / "spec.toml")))
    assert run.stopped is None and np.abs(run.error[-1]).max() < 1e-3
