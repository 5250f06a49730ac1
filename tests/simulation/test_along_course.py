"""Laws of Type IV along a course: a P_l on the axle, whose distance has the poles that were placed wherever
the curve bends."""

import json
import math
from pathlib import Path

import noslip
import numpy as np
import pytest
from noslip.analysis.answers import analyse
from noslip.cli.main import main
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot, law_of
from noslip.simulation.closed_loop import simulate
from noslip.simulation.controllers.backends import make_controller
from noslip.simulation.planning.points import read_reference
from noslip.simulation.specification.spec import read_spec, spec_of
from noslip.simulation.specification.vary import read_varied
from scipy.integrate import cumulative_simpson
from scipy.linalg import expm

BACKING = Path(noslip.__file__).parent / "examples/specs" / "backing"
AXLE = """
robot = "labmate"
[output]
type = "IV"
L = -0.3
extension = true
path = { kind = "course" }
[reference]
position = [0.0, 0.0]
speed = SPEED
[reference.course]
speed = 0.5
lengths = [1.0, 1.0, 2.0]
curvatures = [0.0, 0.8, -0.6, 0.0]
[initial]
point = [0.0, 0.1]
heading = HEADING
speed = SPEED
extension = [0.0]
[simulation]
duration = 7.0
output_step = 0.25
backend = "casadi"
"""


def along(speed: float, text: str = AXLE) -> str:
    """The SPEC at a speed; in reverse the vehicle faces against the course."""
    return text.replace("SPEED", str(speed)).replace("HEADING", "0.0" if speed > 0 else str(math.pi))


@pytest.mark.parametrize("speed", [pytest.param(0.5, marks=pytest.mark.nightly), -0.5])
def test_the_distance_has_the_poles_that_were_placed(speed):
    """Of the chain of three integrators, from 0.1 m beside a curve with ends of different curvature:
    (s + 0.5)(s + 2)^2."""
    run = simulate(spec_of(along(speed), "spec"))
    assert run.stopped is None
    chain = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-2.0, -6.0, -4.5]])
    expected = np.array([(expm(chain * t) @ [0.1, 0.0, 0.0])[0] for t in run.t])
    assert np.abs(run.y[:, 0] - expected).max() < 1e-6
    assert np.abs(run.y[:, 1] - speed).max() < 1e-9
    assert np.ptp(run.config[:, 3]) > 1.3  # the curvature has taken all its values


def test_the_c_is_the_model():
    """Random points of random courses: C in double and float against CasADi,
    and the same law at a point given later."""
    law = law_of(find_robot("labmate"), "type_iv_course_extended")
    assert law.linearization.relative_degree == (3, 2)
    assert [c.name for c in law.config] == ["x_s", "y_s", "direction", "curvature", "curvature_1"]
    assert main(["check", "--robot", "labmate", "--output", law.name, "--states", "40"]) == 0
    params, gains = [q.default for q in law.parameters], [q.default for q in law.gains]
    there = np.array([0.3, -0.2, 0.4, 0.5, -0.7])
    state, reference = np.linspace(0.1, 1.0, len(law.state)), np.linspace(-0.2, 0.3, len(law.reference))
    for backend in ("c", "cf", "casadi"):
        placed = make_controller(backend, law, params, np.zeros(5), gains)
        placed.place(there)
        status, tau = placed.step(state, reference)
        assert (
            status == "ok"
            and (tau == make_controller(backend, law, params, there, gains).step(state, reference)[1]).all()
        )
        placed.place(np.array([0.0, 0.0, math.nan, 0.0, 0.0]))
        assert placed.step(state, reference)[0] != "ok" and not placed.step(state, reference)[1].any()


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("speed", "backend", "period", "tolerance"),
    [(0.5, "c", 0.0, 1e-6), (3.0, "c", 0.0, 1e-6), (0.5, "cf", 0.01, 1e-2), (3.0, "cf", 0.01, 1e-2)],
)
def test_a_rear_axle_on_lines_clothoids_and_an_arc(speed, backend, period, tolerance):
    changes = {
        "simulation.backend": backend,
        "simulation.period": period,
        "simulation.duration": 18.0 / speed,
    }
    changes |= {"reference.speed": speed, "initial.speed": speed, "initial.point": [0.0, 0.0]}
    run = simulate(read_varied(BACKING / "car_course.toml", changes))
    assert run.stopped is None and np.abs(run.y[:, 0]).max() < tolerance


@pytest.mark.nightly
@pytest.mark.parametrize("N", [1, 2, 3])
def test_trailers_back_along_an_s(N):
    """From on the course: the last axle stays on it, and no hitch folds."""
    q = [0.0] * (5 + N)
    changes = {"robot": f"train.py:train:{N}", "simulation.backend": "casadi", "initial.q": q}
    run = simulate(read_varied(BACKING / "s_path.toml", changes))
    assert run.stopped is None and np.abs(run.y[:, 0]).max() < 1e-5
    assert np.abs(run.q[:, 3 : 3 + N]).max() < math.radians(45)


def test_a_course_from_a_file(tmp_path):
    """As `noslip plan course` writes it, and points; beside the SPEC; its place may be given anew."""
    planned = read_reference(BACKING / "points.json")
    spec = read_spec(BACKING / "through_points.toml")
    assert (
        spec.reference.course is not None
        and list(spec.reference.course.lengths) == planned["course"]["lengths"]
    )
    assert spec.desired_speed == 0.5 and list(spec.reference.position or ()) == planned["position"]
    (tmp_path / "points.csv").write_text((BACKING / "points.csv").read_text())
    text = (
        (BACKING / "through_points.toml")
        .read_text()
        .replace("points.json", "points.csv")
        .replace("[initial]", "position = [1, 2]\n[initial]")
    )
    (tmp_path / "spec.toml").write_text(text)
    moved = read_spec(tmp_path / "spec.toml")
    assert moved.desired_speed == 1.0 and moved.reference.position == (1.0, 2.0)
    assert moved.reference.course is not None and sum(moved.reference.course.lengths) == pytest.approx(
        9.0, abs=0.1
    )


WRONG = {
    "no file": ('course = "absent.json"', "absent.json: No such file"),
    "other kind": (
        'course = "points.xml"',
        "points.xml: the name of a course ends in .json or .toml or .csv",
    ),
    "not JSON": ('course = "bad.json"', "bad.json: not JSON"),
    "no course": ('course = "empty.json"', r"empty.json has no \[reference\]"),
    "a circle": ("circle = { radius = 1.0, rate = 1.0 }", "requires .reference. course"),
    "nothing": ("speed = 1.0", "requires .reference. course"),
    "three numbers": (
        "position = [0, 0, 0]\ncourse = { speed = 1, lengths = [1], curvatures = [0, 0] }",
        "a position that is no point",
    ),
    "far": (
        "position = [9, 0]\ncourse = { speed = 1, lengths = [1], curvatures = [0.111112, 0.111112], heading "
        "= 1.5707963 }",
        "centre of its curvature",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_course_that_is_wrong_is_refused(name, tmp_path):
    given, says = WRONG[name]
    (tmp_path / "bad.json").write_text("{")
    (tmp_path / "empty.json").write_text("{}")
    text = along(0.5)
    begin, end = text.index("[reference]"), text.index("[initial]")
    with pytest.raises(BadInput, match=says):
        simulate(spec_of(f"{text[:begin]}[reference]\n{given}\n{text[end:]}", tmp_path / "spec.toml"))


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("extension = true", 'near_singular = "damped"', "does not go with .output. path = { kind"),
        ("[simulation]", '[simulation]\nbackend = "m4f"', "backend"),
        ("L = -0.3", "L = 0.0", "is for a P_l on the axle"),
        ('kind = "course"', 'kind = "course", A = 1.0', "A"),
        ("[simulation]", "[limits]\ntorque = 5.0\n[simulation]", 'set mode = "cut"'),
    ],
)
def test_what_does_not_go_with_a_course(old, new, says):
    with pytest.raises(BadInput, match=says):
        simulate(spec_of(along(0.5).replace('backend = "casadi"', "").replace(old, new, 1), "spec"))


def test_a_sweep_runs_each_sample_by_simulation(tmp_path):
    """Two masses of the robot, of which the law knows: the distance has the same poles with both."""
    text = (
        along(0.5)
        .replace("[simulation]", "[simulation]\nperiod = 0.02")
        .replace('"casadi"', '"c"')
        .replace("7.0", "1.0")
    )
    (tmp_path / "spec.toml").write_text(
        text + "[sweep]\nseed = 1\n[sweep.parameters]\nm_c = { uniform = [80.0, 120.0] }\n"
    )
    table = tmp_path / "table.parquet"
    assert main(["sweep", str(tmp_path / "spec.toml"), "--samples", "2", "-o", str(table)]) == 0
    assert table.stat().st_size > 0


@pytest.mark.nightly
def test_a_planned_course_is_followed(tmp_path, capsys):
    """From the file of points to a run and its picture."""
    course, out = tmp_path / "course.json", tmp_path / "run.png"
    assert (
        main(
            [
                "plan",
                "course",
                str(BACKING / "points.csv"),
                "--tolerance",
                "0.1",
                "--speed",
                "0.5",
                "--json",
                "-o",
                str(course),
            ]
        )
        == 0
    )
    text = (
        (BACKING / "through_points.toml")
        .read_text()
        .replace("points.json", "course.json")
        .replace('"cf"', '"casadi"')
    )
    (tmp_path / "spec.toml").write_text(text)
    capsys.readouterr()
    assert (
        main(
            [
                "simulate",
                str(tmp_path / "spec.toml"),
                "-o",
                str(tmp_path / "run.csv"),
                "--plot",
                str(out),
                "--json",
            ]
        )
        == 0
    )
    errors = json.loads(capsys.readouterr().out)["errors"]
    assert abs(errors["distance"]["final"]) < 1e-3 and out.read_bytes().startswith(b"\x89PNG")


LONG = [pytest.param(speed, 7.0, 2.5, marks=pytest.mark.nightly) for speed in (0.5, -0.5)]


@pytest.mark.parametrize(("speed", "duration", "least"), [*LONG, (-0.5, 2.0, 0.5)])
def test_errors_along_the_way_have_poles_per_metre_from_rest(speed, duration, least):
    """From standstill 0.1 m beside a bending course: (d/ds + 1)(d/ds + 2) e = 0 in the way s along the
    parallel through P_l."""
    text = (
        along(speed)
        .replace("extension = true", "arclength = true\npoles = [-1.0, -2.0]")
        .replace("extension = [0.0]\n", "")
    )
    begin, end = text.index("[initial]"), text.index("[simulation]")
    text = (
        text[:begin]
        + text[begin:end].replace(f"speed = {speed}", "speed = 0.0")
        + text[end:].replace("0.25", "0.02")
    )
    text = text.replace("duration = 7.0", f"duration = {duration}")
    run = simulate(spec_of(text, "spec"))
    assert run.stopped is None and run.law.linearization.relative_degree == (1, 1)
    x_s, y_s, direction = run.config[:, :3].T
    x, y = (run.q[:, :2] - 0.3 * np.column_stack([np.cos(run.q[:, 2]), np.sin(run.q[:, 2])])).T
    distance = np.cos(direction) * (y - y_s) - np.sin(direction) * (x - x_s)
    way = cumulative_simpson(run.y[:, 1] * np.cos(run.q[:, 2] - direction), x=run.t, initial=0.0)
    assert way[-1] > least and np.ptp(run.config[:, 3]) > (1.2 if duration > 5.0 else 0.3)
    assert np.abs(distance - 0.1 * (2.0 * np.exp(-way) - np.exp(-2.0 * way))).max() < 1e-6
    assert np.abs(run.y[:, 1] - speed * (1.0 - np.exp(-2.0 * run.t))).max() < 1e-6


def test_a_stop_is_regular_and_reverse_leads_back():
    """At rest no motion is asked for across the course; backing along the reversed course,
    with the law of that."""
    law = law_of(find_robot("labmate"), "type_iv_course_arclength")
    params, gains = [q.default for q in law.parameters], [q.default for q in law.gains]
    given = [0.0, 0.0, 0.2, 0.5, -0.3, 2.0, 3.0]
    turned = [0.0, 0.0, 0.2 + math.pi, -0.5, -0.3, 2.0, 3.0]
    still = np.array([0.3, 0.1, 0.25, 0.0, 0.0, 0.0, 0.0])
    for config in (given, turned):
        controller = make_controller("casadi", law, params, config, gains)
        status, tau = controller.step(still, np.zeros(4))
        assert status == "ok" and np.abs(tau).max() == 0.0
        status, tau = controller.step(still, np.array([0.0, 0.0, 0.0, 0.5]))
        assert status == "ok" and np.isfinite(tau).all() and np.abs(tau).max() > 0.0


def test_the_analysis_of_a_law_along_the_way_is_short():
    """det Phi is r^2 / (2 b cos^2) of the angle from the course to the heading, whatever the distance and the
    curvature; the polynomials on the way take a hundredth of the terms at which an analysis ends."""
    robot = find_robot("labmate")
    form = analyse(robot, ["type_iv_course_arclength"]).outputs["type_iv_course_arclength"]
    assert form.decoupling.functions.work < 200_000
    draw = np.random.default_rng(4)
    r, b = (next(p.default for p in robot.parameters if p.name == name) for name in ("r", "b"))
    for _ in range(5):
        values = {str(s): draw.uniform(0.2, 0.6) for s in form.decoupling.det_in_full.free_symbols} | {
            "r": r,
            "b": b,
        }
        expected = r**2 / (2 * b * np.cos(values["phi"] - values["direction"]) ** 2)
        found = form.decoupling.det_in_full.subs(
            {s: values[str(s)] for s in form.decoupling.det_in_full.free_symbols}
        )
        assert float(found) == pytest.approx(expected, rel=1e-12)


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["type_iv_course", "type_iv_course_arclength"])
def test_the_c_of_laws_without_extension_is_the_model(name):
    assert main(["check", "--robot", "labmate", "--output", name, "--states", "40"]) == 0


@pytest.mark.parametrize("name", ["type_iv_course_kinematic", "type_iv_course_arclength_kinematic"])
def test_the_c_of_kinematic_laws_is_the_model(name, capsys):
    """Of these the command is compared; the first does not depend on the curvature."""
    assert main(["check", "--robot", "labmate", "--output", name, "--states", "40"]) == 0
    assert "h, Phi, command compared" in capsys.readouterr().out


@pytest.mark.nightly
def test_the_rear_axle_along_the_way():
    """Three poles per metre, of a car: C against CasADi at points of random courses."""
    assert (
        main(
            [
                "check",
                "--robot",
                f"{BACKING / 'rear.py'}:rear",
                "--output",
                "type_iv_course_arclength",
                "--states",
                "20",
            ]
        )
        == 0
    )


@pytest.mark.parametrize(
    ("new", "says"),
    [
        ("arclength = true\nextension = true", "arclength does not go with .output. extension"),
        ("arclength = true\npoles = [1.0, -1.0]", "poles.0. = 1 must be below 0"),
        ("arclength = true\npoles = [-1.0]", "poles has 1 numbers"),
        ("poles = [-1.0]", "poles requires .output. arclength"),
    ],
)
def test_poles_along_the_way_that_are_wrong(new, says):
    with pytest.raises(BadInput, match=says):
        simulate(
            spec_of(along(0.5).replace("extension = true", new, 1).replace("extension = [0.0]\n", ""), "spec")
        )


ALONG, SPEC = "type_iv_course_arclength", str(BACKING / "through_points.toml")
NEEDS_THE_COURSE = {
    "FMU of the law": (["export", "labmate", "--output", ALONG, "--fmu", "controller"], "new at each step"),
    "FMU of the loop": (
        ["export", "labmate", "--output", "type_iv_course_extended", "--fmu", "loop"],
        "new at each step",
    ),
    "firmware": (["export", "labmate", "--output", ALONG, "--firmware", "rv32"], "new at each step"),
    "package": (
        ["export", "labmate", "--output", "follower", "--output", ALONG, "--package", "cmake"],
        "new at each step",
    ),
    "outer loop": (["outer-loop", "labmate", "--output", ALONG], "has no default course"),
    "kinematic outer loop": (
        ["outer-loop", "labmate", "--output", ALONG, "--drive", "kinematic"],
        "has no default course",
    ),
    "table": (["analyse", "labmate", "--start", SPEC, "--table"], "not supported"),
    "record": (["simulate", SPEC, "--record", "r"], "--record requires [simulation] backend"),
    "Cortex-M4F": (
        ["simulate", SPEC, "--set", 'simulation.backend="m4f"'],
        "emulated processors have no courses",
    ),
    "RISC-V": (
        ["simulate", SPEC, "--set", 'simulation.backend="rv32"'],
        "emulated processors have no courses",
    ),
}


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.nightly) if n == "table" else n for n in NEEDS_THE_COURSE]
)
def test_what_cannot_give_the_course_at_each_step_refuses(name, tmp_path, capsys):
    given, says = NEEDS_THE_COURSE[name]
    out = tmp_path / ("x.fmu" if "--fmu" in given else "x")
    assert main([*given, "-o", str(out)] if given[0] != "outer-loop" else given) == 2
    refusal = capsys.readouterr().err.strip()
    assert says in refusal and refusal.count("\n") == 0 and not out.exists()
