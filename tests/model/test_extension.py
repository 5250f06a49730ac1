"""Dynamic extension: the middle of the axle of a unicycle and of a car, and the last axle of a train,
against closed forms."""

import dataclasses
import json
import math
import subprocess
from pathlib import Path

import casadi as ca
import control
import noslip
import numpy as np
import pytest
import sympy as sp
from casadi import cos, sin
from noslip.analysis.outer.design import from_discrete_poles, from_lqr, from_poles, sampled_chain
from noslip.analysis.outer.interop import closed_loop_system
from noslip.analysis.outer.motion import steady_motion
from noslip.analysis.outer.setting import setting_of
from noslip.analysis.outputs import normal_form
from noslip.analysis.outputs.decoupling import decouple
from noslip.checks.verification.evaluate import evaluate_cases
from noslip.cli.main import main
from noslip.codegen.derivation import stages
from noslip.codegen.files import law_program
from noslip.model import Mechanism, ModelError, control_law, reduce
from noslip.model.law import ControlLaw, default_gains
from noslip.model.mechanism import values_of
from noslip.model.outputs import output_map
from noslip.model.robots.mobile_manipulator import mobile_manipulator
from noslip.model.robots.steered import car
from noslip.model.robots.tractor_trailer import tractor_trailer
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot, law_of
from noslip.simulation.closed_loop import simulate
from noslip.simulation.controllers.backends import make_controller
from noslip.simulation.controllers.compiled import CompiledController, library
from noslip.simulation.controllers.controller import Limits
from noslip.simulation.controllers.integral import hurwitz
from noslip.simulation.loop import make_loop
from noslip.simulation.planning.course import SmoothCurve
from noslip.simulation.run import Run
from noslip.simulation.specification.cases import read_cases
from noslip.simulation.specification.spec import Initial, spec_of
from noslip.simulation.specification.vary import read_varied
from noslip.simulation.sweeping.batch import Batch
from noslip.tests.tools import need
from scipy.integrate import cumulative_simpson
from scipy.linalg import expm
from scipy.special import fresnel

AXLE = """
robot = "labmate"
output = { type = "I", L = -0.3, extension = true }
reference = { position = [0.0, 0.0], velocity = [0.6, 0.1] }
initial = { point = [-0.1, 0.05], heading = 0.1, speed = 0.5 }
simulation = { duration = 6.0, output_step = 0.5 }
"""
CIRCLE = AXLE.replace("velocity = [0.6, 0.1]", "circle = { radius = 2.0, rate = 0.3, angle = -1.5 }").replace(
    "0.05]", "-1.9]"
)
PATH = """
robot = "labmate"
output = { type = "IV", L = -0.3, extension = true, path = { kind = "circle", x_f = 0.0, y_f = 0.0, R = 2.0 \
} }
reference = { speed = 0.5 }
initial = { point = [2.1, 0.0], heading = 1.7, speed = 0.45 }
simulation = { duration = 6.0, output_step = 0.5 }
"""
CAR = """
robot = "robots.py:car"
output = { type = "rear", extension = true }
reference = { position = [0.0, 0.0], velocity = [2.0, 0.0] }
initial = { q = [-0.1, 0.2, 0.05, 0.0, 0.0], nu = [6.0, 0.0] }
simulation = { duration = 6.0, output_step = 0.5 }
"""
TRAIN = """
robot = "robots.py:train"
output = { type = "end", extension = true }
reference = { position = [0.0, 0.0], velocity = [-0.5, 0.0] }
initial = { q = [1.2, 0.3, 0.1, 0.0, 0.0, 0.2], nu = [-2.0, -2.0] }
simulation = { duration = 20.0, output_step = 1.0 }
"""
ARM = """
robot = "robots.py:arm"
output = { type = "axle", extension = true }
reference = { position = [0.0, 0.0, 0.4, 0.6], velocity = [0.6, 0.1, 0.1, -0.1] }
initial = { q = [0.2, 0.05, 0.1, 0.0, 0.0, 0.5, 0.5], nu = [3.5, 3.5, 0.0, 0.0] }
simulation = { duration = 6.0, output_step = 0.5 }
"""
BACKING = Path(noslip.__file__).parent / "examples/specs" / "backing"
ROBOTS = """
from noslip.tests.model.test_extension import car_by_its_rear_axle as car, train_by_its_last_axle as train, \
arm_on_its_axle as arm
from noslip.tests.tools import need
"""


def car_by_its_rear_axle() -> Mechanism:
    robot = car()
    robot.output("rear", "middle of the rear axle", [("x_r", "m", robot["x"]), ("y_r", "m", robot["y"])])
    return robot


def train_by_its_last_axle() -> Mechanism:
    robot = tractor_trailer(1)
    x, y = (robot[axis] - robot["l_1"] * turned(robot["phi_1"]) for axis, turned in (("x", cos), ("y", sin)))
    robot.output("end", "middle of the trailer's axle", [("x_e", "m", x), ("y_e", "m", y)])
    return robot


SPECS = {"line": AXLE, "circle": CIRCLE, "path": PATH, "car": CAR, "train": TRAIN, "arm": ARM}
DEGREES = {
    "line": (3, 3),
    "circle": (3, 3),
    "path": (3, 2),
    "car": (4, 4),
    "train": (4, 4),
    "arm": (3, 3, 2, 2),
}


def arm_on_its_axle() -> Mechanism:
    """Only the outputs that depend on each other are extended: the joints keep relative degree 2."""
    robot = mobile_manipulator()
    place = [robot[axis] - robot["d"] * turned(robot["phi"]) for axis, turned in (("x_c", cos), ("y_c", sin))]
    rows = zip(
        ("x_o", "y_o", "link_1", "link_2"),
        ("m", "m", "rad", "rad"),
        (*place, robot["q_1"], robot["q_2"]),
        strict=True,
    )
    robot.output("axle", "middle of the axle, and the joints", list(rows))
    return robot


def run_of(text: str, tmp_path, **simulation) -> Run:
    (tmp_path / "robots.py").write_text(ROBOTS)
    spec = spec_of(text, tmp_path / "spec.toml")
    return simulate(dataclasses.replace(spec, simulation=dataclasses.replace(spec.simulation, **simulation)))


def axle_law() -> ControlLaw:
    return law_of(find_robot("labmate"), "type_i_extended")


def chain(gains: list[float]) -> np.ndarray:
    """The matrix of e^(k) + ... + gains[1] e' + gains[0] e = 0."""
    return np.vstack([np.eye(len(gains))[1:], -np.array(gains)])


@pytest.mark.parametrize("backend", ["c", "casadi"])
@pytest.mark.parametrize("name", SPECS)
def test_errors_have_the_poles_that_were_placed(name, backend, tmp_path):
    """Of a train in reverse too: with its last axle as output nothing is left that could fold."""
    run, degrees = run_of(SPECS[name], tmp_path, backend=backend), DEGREES[name]
    law = run.law
    assert law.linearization.relative_degree == degrees and run.stopped is None
    loop = make_loop(run.spec)
    start = np.append(run.x[0], loop.extension)
    reference = loop.guidance.reference(0, run.x[0])
    evaluation = make_controller("casadi", law, loop.believed, run.config[0], loop.gains).evaluate(
        start, reference
    )
    desired, rates = iter(reference), iter(evaluation.values["ydot"])
    gains = iter(loop.gains)
    for k, degree in enumerate(degrees):
        actual = [evaluation.values["h"][k], *[next(rates) for _ in range(1, degree)]]
        error = np.array([next(desired) - y for y in actual])
        next(desired)
        A = chain([next(gains) for _ in range(degree)])
        expected = [(expm(A * t) @ error)[0] for t in run.t]
        np.testing.assert_allclose(run.y_d[:, k] - run.y[:, k], expected, rtol=0, atol=1e-6)


INTEGRAL = "gains = { ki = 0.5, ki_x_l = 0.25 }\n"


@pytest.mark.parametrize(("backend", "period"), [("c", 0.0), ("casadi", 0.0), ("cf", 0.001)])
def test_integral_action_adds_a_pole(backend, period, tmp_path):
    """The error beside a line and its integral: a chain whose characteristic polynomial is s^4 + ka s^3 + kd
    s^2 + kp s + ki."""
    run = run_of(AXLE + INTEGRAL, tmp_path, backend=backend, period=period)
    loop = make_loop(run.spec)
    start, reference = np.append(run.x[0], loop.extension), loop.guidance.reference(0, run.x[0])
    found = (
        make_controller("casadi", run.law, loop.believed, run.config[0], loop.gains)
        .evaluate(start, reference)
        .values
    )
    for k, (ki, gains) in enumerate(zip((0.25, 0.5), np.reshape(loop.gains, (2, 3)), strict=True)):
        actual = [found["h"][k], *found["ydot"][2 * k : 2 * k + 2]]
        z = np.append(0.0, reference[4 * k : 4 * k + 3] - actual)
        expected = np.array([expm(chain([ki, *gains]) * t) @ z for t in run.t])
        tolerance = 2e-3 if period else 1e-5
        np.testing.assert_allclose(-run.error[:, k], expected[:, 1], rtol=0, atol=tolerance)
        np.testing.assert_allclose(run.integral[:, k], expected[:, 0], rtol=0, atol=tolerance)


def test_a_point_on_a_circle_has_all_its_derivatives():
    spec = spec_of(CIRCLE, "")
    guidance = make_loop(spec).guidance
    circle, x = spec.reference.circle, make_loop(spec).start
    for t in (0.0, 0.7, 11.0):
        turned = (
            circle.radius * np.exp(1j * (circle.angle + circle.rate * t)) * (1j * circle.rate) ** np.arange(4)
        )
        np.testing.assert_allclose(guidance.reference(t, x), [*turned.real, *turned.imag], atol=1e-14)


# rad; the law is singular at 90 degrees. Three trailers reach 45 while the tractor corrects 10 cm
FOLDED = 1.0
TURN = "course = { speed = SPEED, lengths = [2.0, 4.0, 5.0], curvatures = [0.0, 0.0, 0.2, 0.2] }"


@pytest.mark.parametrize(
    ("speed", "backend", "period", "tolerance"),
    [
        (1.5, "casadi", 0.0, 1e-6),
        pytest.param(0.5, "c", 0.0, 1e-6, marks=pytest.mark.nightly),
        pytest.param(3.0, "c", 0.0, 1e-6, marks=pytest.mark.nightly),
        pytest.param(0.5, "cf", 0.01, 0.01, marks=pytest.mark.nightly),
        pytest.param(3.0, "cf", 0.01, 0.01, marks=pytest.mark.nightly),
    ],
)
def test_the_rear_axle_of_a_car_follows_a_course(speed, backend, period, tolerance, tmp_path):
    """Line, a bend whose curvature grows, arc, and beyond the end;
    the direction turns by the integral of the curvature."""
    text = CAR.replace("velocity = [2.0, 0.0]", TURN.replace("SPEED", str(speed)))
    rate = speed / car().parameter_values({})[[q.name for q in car().parameters].index("r")]
    text = text.replace("[-0.1, 0.2, 0.05, 0.0, 0.0]", "[0.0, 0.0, 0.0, 0.0, 0.0]").replace(
        "[6.0, 0.0]", f"[{rate}, 0.0]"
    )
    run = run_of(
        text, tmp_path, backend=backend, period=period, duration=12.0 / speed, output_step=0.5 / speed
    )
    assert run.stopped is None and np.abs(run.error).max() <= tolerance
    heading = run.q[-1, [c.name for c in run.law.system.mechanism.coordinates].index("phi")]
    assert heading == pytest.approx(0.2 * (4.0 / 2 + 5.0 + 1.0), abs=max(tolerance, 1e-6))


@pytest.mark.parametrize(
    ("speed", "backend", "period", "tolerance"),
    [
        (1.5, "c", 0.0, 1e-6),
        (3.0, "cf", 0.01, 0.01),
        pytest.param(0.5, "c", 0.0, 1e-6, marks=pytest.mark.nightly),
        pytest.param(3.0, "c", 0.0, 1e-6, marks=pytest.mark.nightly),
        pytest.param(0.5, "cf", 0.01, 0.01, marks=pytest.mark.nightly),
        pytest.param(1.5, "cf", 0.01, 0.01, marks=pytest.mark.nightly),
    ],
)
def test_the_rear_axle_of_a_car_follows_a_clothoid(speed, backend, period, tolerance, tmp_path):
    """Line, clothoid, arc, rounded over 0.2 m where they meet;
    without rounding off the steering torque would have no bound."""
    turn = TURN.replace("SPEED", str(speed)).replace("0.2] }", "0.2], rounding = 0.2 }")
    text = CAR.replace("velocity = [2.0, 0.0]", turn).replace(
        "[-0.1, 0.2, 0.05, 0.0, 0.0]", "[0.0, 0.0, 0.0, 0.0, 0.0]"
    )
    rate = speed / car().parameter_values({})[[q.name for q in car().parameters].index("r")]
    text = text.replace("[6.0, 0.0]", f"[{rate}, 0.0]")
    run = run_of(
        text, tmp_path, backend=backend, period=period, duration=12.0 / speed, output_step=0.05 / speed
    )
    assert run.stopped is None and np.abs(run.error).max() <= tolerance
    # Of the clothoid: the steering angle is that of its curvature
    middle = (run.t * speed > 2.2) & (run.t * speed < 5.8)
    delta = run.q[middle, [c.name for c in run.law.system.mechanism.coordinates].index("delta")]
    np.testing.assert_allclose(
        np.tan(delta) / 2.6, 0.05 * (run.t[middle] * speed - 2.0), atol=max(tolerance, 1e-6)
    )


def test_a_rounded_course_is_near_lines_clothoids_and_arcs():
    """Against the integrals of Fresnel: less than 0.2 mm off with a rounding of 0.2 m,
    a quarter of it with half the rounding."""
    rate, length, off = 0.05, 4.0, {}

    def sharp(s: float) -> complex:
        if s <= 2.0:
            return complex(s)
        along, scale = min(s - 2.0, length), np.sqrt(np.pi / rate)
        sine, cosine = fresnel(along / scale)
        place = 2.0 + scale * complex(cosine, sine)
        kappa, turned = rate * length, np.exp(0.5j * rate * length**2)
        return (
            place
            if s <= 2.0 + length
            else place + turned * (np.exp(1j * kappa * (s - 2.0 - length)) - 1) / (1j * kappa)
        )

    for rounding in (0.2, 0.1):
        course = SmoothCurve(
            0.0, 0.0, 0.0, 1.0, (2.0, length, 5.0), (0.0, 0.0, rate * length, rate * length), rounding
        )
        off[rounding] = max(abs(course.position(s) - sharp(s)) for s in np.linspace(0.0, 11.0, 111))
        assert course.position(1.85) == pytest.approx(1.85, abs=1e-14)
    assert 1e-5 < off[0.2] < 2e-4 and off[0.2] / off[0.1] == pytest.approx(4.0, rel=0.02)


AHEAD = 'course = { speed = 0.5, heading = 0.2, lengths = [], curvatures = [0.0], follow = "path" }'
BENDS = (
    "course = { speed = 0.5, lengths = [1.0, 2.0, 2.0], curvatures = [0.0, 0.0, 0.4, -0.2], rounding = "
    '0.5, follow = "path" }'
)


def test_a_course_that_waits_leaves_the_placed_poles_beside_it(tmp_path):
    """On a line: the distance has the placed poles, the speed those of the gains without kp,
    and the place no error at all."""
    run = run_of(
        AXLE.replace("velocity = [0.6, 0.1]", AHEAD).replace("speed = 0.5 }\ns", "speed = 0.3 }\ns"), tmp_path
    )
    assert run.stopped is None
    gains, along, xi = make_loop(run.spec).gains[:3], np.exp(0.2j), run.extension[:, 0]
    heading, speed = run.q[:, 2], 0.15 * run.nu.mean(axis=1)
    turning = 0.15 * (run.nu[:, 0] - run.nu[:, 1]) / 2 / {p.name: p.default for p in run.law.parameters}["b"]
    rates = np.exp(1j * heading) * np.array([speed, xi + 1j * speed * turning]) / along
    place = (run.y[:, 0] + 1j * run.y[:, 1]) / along
    error = np.array([place[0].imag, *rates[:, 0].imag])
    slower = np.array([rates[0, 0].real - 0.5, rates[1, 0].real])
    for t, y, ahead, rate in zip(
        run.t, place, (run.error[:, 0] + 1j * run.error[:, 1]) / along, rates.T, strict=True
    ):
        assert y.imag == pytest.approx((expm(chain(gains) * t) @ error)[0], abs=1e-8)
        assert rate[0].real - 0.5 == pytest.approx((expm(chain(gains[1:]) * t) @ slower)[0], abs=1e-8)
        assert abs(ahead.real) < 1e-12 and ahead.imag == pytest.approx(y.imag, abs=1e-12)


def test_a_robot_comes_back_to_a_course_that_waits(tmp_path):
    """From 0.7 m along it and beside it, through bends: it ends on the course at its speed,
    however late it is."""
    text = (
        AXLE.replace("velocity = [0.6, 0.1]", BENDS)
        .replace("[-0.1, 0.05]", "[0.7, 0.1]")
        .replace("6.0", "16.0")
    )
    run = run_of(text, tmp_path, backend="cf", period=0.02)
    assert run.stopped is None and np.abs(run.error[0]).max() < 0.11  # the desired point is beside it
    assert np.abs(run.error[-1]).max() < 1e-3 and np.abs(0.15 * run.nu[-1].mean() - 0.5) < 1e-3


def test_a_robot_begins_behind_a_course(tmp_path):
    """1 m behind it, on its first line: there it stays without torque,
    and then on a curve that begins without a jump."""
    bend = BENDS.replace("[1.0, 2.0, 2.0]", "[2.0]").replace(
        "[0.0, 0.0, 0.4, -0.2], rounding = 0.5", "[0.0, 0.4]"
    )
    text = AXLE.replace("velocity = [0.6, 0.1]", bend).replace(
        "[-0.1, 0.05], heading = 0.1", "[-1.0, 0.0], heading = 0.0"
    )
    run = run_of(text, tmp_path)
    before = run.t * 0.5 < 1.0
    assert run.stopped is None and np.abs(run.error).max() < 1e-8 and run.y[-1, 0] > 1.0
    assert (
        np.abs(run.y[before, 1]).max() < 1e-8
        and np.abs(run.tau[before]).max() < 1e-6 < np.abs(run.tau[~before]).max() < 5.0
    )


def test_a_start_at_the_centre_of_curvature_is_refused(tmp_path):
    arc = 'course = { speed = 0.5, lengths = [5.0], curvatures = [0.5, 0.5], follow = "path" }'
    text = AXLE.replace("velocity = [0.6, 0.1]", arc).replace("[-0.1, 0.05]", "[0.05, 1.95]")
    with pytest.raises(BadInput, match="as far from the course as the centre of its curvature"):
        run_of(text, tmp_path)


def test_the_nearest_place_of_a_course():
    """The foot of points beside it, of points before and beyond it,
    and of where only the centre of curvature is nearer."""
    course, random = (
        SmoothCurve(1.0, 2.0, 0.3, 0.7, (2.0, 3.0, 4.0), (0.1, 0.5, 0.5, -0.4), 0.5),
        np.random.default_rng(3),
    )
    for at, beside in zip(random.uniform(-1.0, 11.0, 50), random.uniform(-1.0, 1.0, 50), strict=True):
        place, rate = course.derivatives(at / 0.7, 1)
        point = place + 1j * rate / abs(rate) * beside
        assert course.nearest(point, at + random.uniform(-0.3, 0.3)) == pytest.approx(at, abs=1e-11)
    for at in (0.0, 3.3, 9.5):
        assert course.nearest(course.position(at)) == pytest.approx(at, abs=1e-11)


@pytest.mark.parametrize("rounding", [0.0, 0.5])
def test_a_course_is_its_curvature(rounding):
    """Position against a fine sum, derivatives against differences, up to the sixth;
    before its beginning it is a curve too."""
    course = SmoothCurve(1.0, 2.0, 0.3, 0.7, (2.0, 3.0, 4.0), (0.1, 0.5, 0.5, -0.4), rounding)
    steps = np.linspace(0.0, 10.0, 200_001)
    knots = [(p.begin, p.curvature(0.0)) for p in course.stretches]
    if not rounding:
        assert knots == [(0.0, 0.1), (2.0, 0.5), (5.0, 0.5), (9.0, -0.4)]
    assert course.stretches[-1].begin == pytest.approx(9.0 + rounding / 2) and knots[-1][1] == -0.4
    bends = [next(p for p in reversed(course.stretches) if p.begin <= s) for s in steps]
    kappa = np.array([p.curvature(s - p.begin) for p, s in zip(bends, steps, strict=True)])
    direction = 0.3 + cumulative_simpson(kappa, x=steps, initial=0.0)
    place = cumulative_simpson(np.cos(direction), x=steps, initial=0.0) + 1j * cumulative_simpson(
        np.sin(direction), x=steps, initial=0.0
    )
    for k in (0, 30_000, 99_999, 150_000, 200_000):
        assert abs(course.position(steps[k]) - complex(1.0, 2.0) - place[k]) < 1e-10
    for t in (-0.5, 1.0, 5.0, 9.0, 15.0):
        h = 1e-4
        difference = (course.derivatives(t + h, 6) - course.derivatives(t - h, 6)) / (2 * h)
        np.testing.assert_allclose(difference[:-1], course.derivatives(t, 6)[1:], rtol=0, atol=1e-6)
    meet = [p.begin for p in course.stretches[1:]]
    joints = [course.derivatives(at / 0.7 + side, 6) for at in meet for side in (-1e-9, 1e-9)]
    for before, after in zip(joints[::2], joints[1::2], strict=True):
        np.testing.assert_allclose(before, after, rtol=0, atol=1e-5)


@pytest.mark.parametrize(
    "N", [1, pytest.param(2, marks=pytest.mark.nightly), pytest.param(3, marks=pytest.mark.nightly)]
)
def test_trailers_back_along_an_arc(N, tmp_path):
    """Type IV, P_l in the middle of the last axle: hitch angles in closed form,
    by the radii on which the axles move."""
    lengths, R, hitches = [1.2] * N, 6.0, []
    for length in lengths:
        hitches.append(np.arctan2(length, R))
        R = np.hypot(R, length)
    (tmp_path / "train.py").write_text((BACKING / "train.py").read_text())
    q = [6.1, 0.0, np.pi / 2 + 0.02, *([0.0] * N), 0.0, 0.0]
    text = f"""
robot = "train.py:train:{N}"
output = {{ type = "IV", extension = true, path = {{ kind = "circle", x_f = 0.0, y_f = 0.0, R = 6.0 }} }}
reference = {{ speed = -0.5 }}
initial = {{ q = {q}, nu = [-0.5, 0.0] }}
simulation = {{ duration = 40.0, output_step = 2.0, backend = "casadi", tolerance = 1e-9 }}
"""
    run = simulate(spec_of(text, tmp_path / "spec.toml"))
    assert run.stopped is None and np.abs(run.error[-1]).max() < 1e-5
    own = run.q[:, 3 : 3 + N]
    assert np.abs(own).max() < FOLDED
    np.testing.assert_allclose(own[-1], hitches[::-1], atol=1e-5)


@pytest.mark.parametrize(
    "N", [1, pytest.param(2, marks=pytest.mark.nightly), pytest.param(3, marks=pytest.mark.nightly)]
)
def test_trailers_back_along_an_s(N):
    """From beside it and from on it; with the curvature at rest the hitch angles are those of an arc,
    to either side."""
    spec = read_varied(
        BACKING / "s_curve.toml", {"robot": f"train.py:train:{N}", "simulation.backend": "casadi"}
    )
    course, on = spec.reference.course, np.array([0.0, 0.0, 0.0, *[0.0] * N, 0.0, 0.0])
    for offset, after, most in ((0.1, 35.0, 1e-5), (0.0, 0.0, 1e-9)):
        initial = dataclasses.replace(spec.initial, q=tuple(on + np.eye(len(on))[1] * offset))
        run = simulate(dataclasses.replace(spec, initial=initial))
        assert run.stopped is None and np.abs(run.error[run.t >= after]).max() <= most
        assert np.abs(run.q[:, 3 : 3 + N]).max() < FOLDED
    for begin, curvature in ((2.0 + 3.0, 0.15), (2.0 + 3.0 + 4.0 + 4.0, -0.15)):
        radii = [np.hypot(1 / 0.15, np.sqrt(k) * 1.2) for k in range(N)]  # of the axles, from the last
        expected = [np.arctan2(1.2, R) * np.sign(-curvature) for R in radii][::-1]
        row = np.searchsorted(run.t, (begin + 2.0) / course.speed - 1e-9)
        np.testing.assert_allclose(run.q[row, 3 : 3 + N], expected, atol=1e-8)


def test_a_car_backs_along_clothoids():
    """From beside the course and at half its speed; on the arc the steering angle is that of its radius."""
    run = simulate(read_varied(BACKING / "clothoids.toml", {"simulation.period": 0.02}))
    assert (
        run.stopped is None
        and np.abs(run.error[-1]).max() < 1e-4
        and run.nu[-1, 0] == pytest.approx(-1.0 / 0.3, abs=1e-4)
    )
    delta = run.q[:, [c.name for c in run.law.system.mechanism.coordinates].index("delta")]
    assert abs(delta.min() + np.arctan(0.2 * 2.6)) < 0.001  # rad: of a period


def test_the_train_is_the_tractor_with_trailers():
    """The same motion and inputs as the shipped robot, which has other coordinates and velocities."""
    other, own = (find_robot(name) for name in ("tractor_trailer:2", f"{BACKING / 'train.py'}:train:2"))
    theirs, ours, random = reduce(other), reduce(own), np.random.default_rng(1)
    functions = [
        ca.Function("f", [s.mechanism.q, s.nu, tau, s.mechanism.p], [s.qdot, s.acceleration(tau)])
        for s, tau in ((theirs, ca.SX.sym("tau", 2)), (ours, ca.SX.sym("tau", 2)))
    ]
    values = [{p.name: p.default for p in robot.parameters} for robot in (other, own)]
    assert values[0] == values[1]
    p = [list(value.values()) for value in values]
    names = [[c.name for c in robot.coordinates] for robot in (other, own)]
    for _ in range(20):
        phi, hitch = random.uniform(-3, 3), random.uniform(-1, 1, 2)
        heading = {"phi_2": phi, "phi_1": phi + hitch[1], "phi": phi + hitch.sum()}
        there = [heading.get(name, 0.0) for name in names[0]]
        here = [{"phi": phi, "hitch_1": hitch[0], "hitch_2": hitch[1]}.get(name, 0.0) for name in names[1]]
        nu, tau = random.uniform(-2, 2, 2), random.uniform(-2, 2, 2)
        rate, acceleration = (each.full().ravel() for each in functions[1](here, nu, tau, p[1]))
        wheels = rate[-2:]
        rate_there, faster = (each.full().ravel() for each in functions[0](there, wheels, tau, p[0]))
        turns = dict(zip(names[0], rate_there, strict=True))
        np.testing.assert_allclose(turns["phi"], nu[1], atol=1e-12)
        np.testing.assert_allclose(turns["phi_2"], rate[2], atol=1e-12)
        # The wheels' accelerations: of the shipped robot directly, of this one by differences along its
        # motion.
        h, S = 1e-6, ca.Function("S", [own.q, own.p], [ours.S])
        later = S(np.array(here) + h * rate, p[1]).full() @ (nu + h * acceleration)
        before = S(np.array(here) - h * rate, p[1]).full() @ (nu - h * acceleration)
        np.testing.assert_allclose((later - before)[-2:] / (2 * h), faster, atol=1e-7)


def test_the_law_of_a_unicycle_is_that_of_a_pencil():
    """x' = v cos, v' = a, phi' = w: x''' = a' cos - 2 a w sin - v w' sin - v w^2 cos, and y''' likewise."""
    law = axle_law()
    q, nu, p = (law.system.mechanism.q, law.system.nu, law.system.mechanism.p)
    linear = law.linearization
    function = ca.Function(
        "f", [ca.vertcat(q, nu), linear.integrators.xi, p], [linear.rate, linear.Phi, linear.drift]
    )
    random, values = np.random.default_rng(5), {q.name: q.default for q in law.parameters}
    for _ in range(50):
        state, a = random.uniform(-2, 2, 7), random.uniform(-2, 2)
        c, s, r, b = np.cos(state[2]), np.sin(state[2]), values["r"], values["b"]
        v, w = r * (state[5] + state[6]) / 2, r * (state[5] - state[6]) / (2 * b)
        rate, Phi, drift = (each.full() for each in function(state, a, list(values.values())))
        np.testing.assert_allclose(
            rate.ravel(), [v * c, a * c - v * w * s, v * s, a * s + v * w * c], atol=1e-13
        )
        np.testing.assert_allclose(Phi, [[c, -v * s], [s, v * c]], atol=1e-13)
        expected = [-2 * a * w * s - v * w**2 * c, 2 * a * w * c - v * w**2 * s]
        np.testing.assert_allclose(drift.ravel(), expected, atol=1e-13)


CASE = {
    "params": {q.name: q.default for q in find_robot("labmate").parameters},
    "output": {"type": "type_i_extended"},
    "q": [0.2, 0.1, 0.1, 0.0, 0.0],
    "nu": [3.0, 4.0],
    "reference": {"y": [0.1, 0.0], "yd": [0.5, 0.1], "ydd": [0.2, 0.3], "yddd": [0.4, 0.5]},
    "gains": {"kp": 2.0, "kd": 6.0, "ka": 4.5},
    "extension": [0.3],
}


def evaluated(case: dict, tmp_path) -> str:
    (tmp_path / "cases.json").write_text(json.dumps({"cases": [case]}))
    return str(tmp_path / "cases.json")


@pytest.mark.parametrize(("backend", "tolerance"), [("casadi", 1e-12), ("c", 1e-12), ("cf", 1e-4)])
def test_evaluate_gives_what_a_pencil_does(backend, tolerance, tmp_path):
    """v = r (nu_1 + nu_2) / 2, a = 0.3: u = W^-1 (a, w'), the rate of a and w' from the virtual input."""
    (found,) = evaluate_cases(read_cases(evaluated(CASE, tmp_path)), backend)
    p, c, s, a = CASE["params"], np.cos(0.1), np.sin(0.1), 0.3
    v, w = p["r"] * 7.0 / 2, p["r"] * -1.0 / (2 * p["b"])
    y = np.array(
        [[0.2 - p["d"] * c, 0.1 - p["d"] * s], [v * c, v * s], [a * c - v * w * s, a * s + v * w * c]]
    )
    desired = np.array([CASE["reference"][name] for name in ("y", "yd", "ydd")])
    virtual = CASE["reference"]["yddd"] + np.array([2.0, 6.0, 4.5]) @ (desired - y)
    drift = [-2 * a * w * s - v * w**2 * c, 2 * a * w * c - v * w**2 * s]
    rate, turning = np.linalg.solve([[c, -v * s], [s, v * c]], virtual - drift)
    assert found.status == "ok"
    close = dict(rtol=tolerance, atol=tolerance)
    np.testing.assert_allclose(found.values["extension_rate"], [rate], **close)
    np.testing.assert_allclose(
        found.values["u"], [(a + p["b"] * turning) / p["r"], (a - p["b"] * turning) / p["r"]], **close
    )
    np.testing.assert_allclose(found.values["h"], y[0], **close)
    np.testing.assert_allclose(found.values["ydot"], [y[1, 0], y[2, 0], y[1, 1], y[2, 1]], **close)


def test_cases_of_extended_laws_that_are_wrong(tmp_path):
    without = {name: value for name, value in CASE.items() if name != "extension"}
    short = {name: value for name, value in CASE["reference"].items() if name != "yddd"}
    wrong = {
        "extension missing: type_i_extended has the states forward_speed_rate": without,
        "extension: must be a list of 1 numbers": CASE | {"extension": [0.1, 0.2]},
        "reference: yddd missing": CASE | {"reference": short},
        "unknown key 'ydddd'": CASE | {"reference": CASE["reference"] | {"ydddd": [0.0, 0.0]}},
    }
    for message, case in wrong.items():
        with pytest.raises(BadInput, match=message):
            read_cases(evaluated(case, tmp_path))
    (found,) = evaluate_cases(read_cases(evaluated(CASE | {"extension": ["nan"]}, tmp_path)), "c")
    assert found.status == "nonfinite" and not found.values


@pytest.mark.parametrize("degree", [1, 2, 3, 4, 5, 6])
def test_default_gains_have_the_stated_poles(degree):
    polynomial = np.polynomial.Polynomial([*default_gains(degree), 1.0])
    assert degree == 1 or polynomial(-0.5) == 0.0
    for order in range(max(degree - 1, 1)):
        assert polynomial.deriv(order)(-2.0) == 0.0


@pytest.mark.parametrize("name", ["type_i_extended", "type_iv_circle_extended", "type_i_offset_extended"])
def test_the_c_is_the_model(name, tmp_path, capsys):
    """`generate` compares 200 states in both scalars; `check` says how well they agree."""
    assert main(["generate", "labmate", "--output", name, "-o", str(tmp_path)]) == 0
    capsys.readouterr()
    assert main(["check", "--output", name, "--states", "200", "--json"]) == 0
    assert list(json.loads(capsys.readouterr().out)["laws"]) == [name]


def wrong_rate(self, v, original=stages._Feedback.extension_rate):
    return 1.001 * original(self, v)


def wrong_row(stages_, inner, output, integrators, original=stages._extended_rows):
    rows, added = original(stages_, inner, output, integrators)
    return [dataclasses.replace(rows[0], drift=-rows[0].drift), *rows[1:]], added


@pytest.mark.parametrize(
    ("place", "name", "wrong", "says"),
    [
        (stages._Feedback, "extension_rate", wrong_rate, "extension_rate by evaluate"),
        (stages, "_extended_rows", wrong_row, "tau by step"),
    ],
)
def test_a_wrong_generator_writes_nothing(place, name, wrong, says, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("NOSLIP_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(place, name, wrong)
    for cached in (law_program, library):
        cached.cache_clear()
    assert (
        main(
            [
                "generate",
                "labmate",
                "--output",
                "type_i_extended",
                "--scalar",
                "double",
                "-o",
                str(tmp_path / "made"),
            ]
        )
        == 1
    )
    for cached in (law_program, library):
        cached.cache_clear()
    assert says in capsys.readouterr().err and not (tmp_path / "made").exists()


def compiled(scalar: str, limits: Limits | None = None) -> tuple[CompiledController, np.ndarray, np.ndarray]:
    """The law in C, a state and a reference."""
    law = axle_law()
    values = [values_of(list(group), {}, "") for group in (law.parameters, law.config, law.gains)]
    state = np.array([0.2, 0.1, 0.1, 0.0, 0.0, 3.0, 4.0])
    reference = np.array([0.1, 0.5, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0])
    return CompiledController(law, *values, scalar, limits), state, reference


def step(controller: CompiledController, state, reference, dt: float) -> tuple[str, np.ndarray, float, float]:
    """One step of the C, with its memory: status, inputs, state of the extension and its rate."""
    compiled_law = controller._library
    controller._seen[0][:], controller._seen[1][:] = state, reference
    status = compiled_law.function("step")(
        controller._self, controller._state, controller._reference, dt, controller._tau
    )
    own = controller._self
    return (
        compiled_law.status(status),
        np.array(list(controller._tau)),
        own.extension[0],
        own.extension_rate[0],
    )


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_a_step_advances_the_extension_by_its_last_rate(scalar):
    (controller, state, reference), law = compiled(scalar), axle_law()
    model = make_controller(
        "casadi", law, *[values_of(list(g), {}, "") for g in (law.parameters, law.config, law.gains)]
    )
    xi, random = 0.0, np.random.default_rng(3)
    for k in range(20):
        dt = 0.0 if k == 0 else random.uniform(0.0, 0.02)
        xi += dt * (model.extension_rate[0] if k else 0.0)
        state = state + random.uniform(-0.01, 0.01, 7)
        status, tau, held, rate = step(controller, state, reference, dt)
        truth = model.step(np.append(state, xi), reference)
        tolerance = 1e-12 if scalar == "double" else 2e-4
        assert (status, truth[0]) == ("ok", "ok")
        np.testing.assert_allclose(
            [*tau, held, rate], [*truth[1], xi, model.extension_rate[0]], rtol=tolerance, atol=tolerance
        )
    compiled_law = controller._library
    assert compiled_law.function("reset")(controller._self) == 0
    assert step(controller, state, reference, 5.0)[2] == 0.0


def test_the_extension_is_held_while_inputs_are_limited():
    controller, state, reference = compiled("double", Limits((0.1, 0.1)))
    status, tau, xi, rate = step(controller, state, reference, 0.0)
    assert status == "saturated" and np.abs(tau).max() == 0.1 and (xi, rate) == (0.0, 0.0)
    assert step(controller, state, reference, 1.0)[2] == 0.0
    law = axle_law()
    values = [values_of(list(group), {}, "") for group in (law.parameters, law.config, law.gains)]
    model = make_controller("casadi", law, *values, Limits((0.1, 0.1)))
    assert model.step(np.append(state, 0.0), reference)[0] == "saturated" and not model.extension_rate.any()


@pytest.mark.parametrize(
    ("dt", "status"), [(-0.01, "bad_parameter"), (np.nan, "nonfinite"), (np.inf, "nonfinite")]
)
def test_a_wrong_time_is_refused_and_nothing_moves(dt, status):
    controller, state, reference = compiled("double")
    before = step(controller, state, reference, 0.0)
    assert before[0] == "ok" and before[3] != 0.0
    after = step(controller, state, reference, dt)
    assert after[0] == status and not after[1].any() and after[3] == 0.0


@pytest.mark.parametrize("backend", ["c", "cf", "casadi"])
def test_it_is_singular_at_standstill(backend):
    law = axle_law()
    values = [values_of(list(group), {}, "") for group in (law.parameters, law.config, law.gains)]
    controller = make_controller(backend, law, *values)
    for rates, status in (((2.0, -2.0), "singular"), ((0.0, 0.0), "singular"), ((2.0, -1.9), "ok")):
        returned, tau = controller.step(np.array([0.1, 0.2, 0.3, 0.0, 0.0, *rates, 0.4]), np.full(8, 0.1))
        assert returned == status and (status == "ok" or not tau.any())


def test_regular_outputs_get_no_integrator():
    law = law_of(find_robot("labmate"), "type_ii_extended")
    assert (
        not law.extension
        and law.linearization.relative_degree == (2, 2)
        and law.linearization.integrators is None
    )


def test_outputs_that_no_integrator_separates_are_refused():
    robot = car()
    robot.output("twice", "the same twice", [("x_1", "m", robot["x"]), ("x_2", "m", 2 * robot["x"])])
    system = reduce(robot)
    with pytest.raises(ModelError, match="twice.*or allow a dynamic extension"):
        control_law(system, output_map(system, "twice"))
    with pytest.raises(
        ModelError, match="twice_extended: no dynamic extension makes Phi regular: x_1, x_2 and their"
    ):
        control_law(system, output_map(system, "twice_extended"))


def test_a_name_of_an_extended_law_cannot_be_that_of_an_output():
    robot = car()
    with pytest.raises(ModelError, match="_extended ends those of laws with an extension"):
        robot.output("rear_extended", "", [("x_r", "m", robot["x"]), ("y_r", "m", robot["y"])])


def test_start_values_are_those_of_the_reference():
    """x' = v cos, y' = v sin: the forward acceleration that a point on a circle desires,
    along the heading; and numbers given."""
    spec = spec_of(CIRCLE, "")
    circle = spec.reference.circle
    toward = -circle.radius * circle.rate**2 * np.exp(1j * circle.angle)  # to the centre, m/s^2
    expected = (toward * np.exp(-1j * spec.initial.heading)).real
    np.testing.assert_allclose(make_loop(spec).extension, [expected], atol=1e-14)
    given = dataclasses.replace(spec, initial=dataclasses.replace(spec.initial, extension=(0.25,)))
    np.testing.assert_array_equal(make_loop(given).extension, [0.25])
    many = dataclasses.replace(spec, initial=dataclasses.replace(spec.initial, extension=(0.25, 0.0)))
    with pytest.raises(BadInput, match="extension has 2 numbers; it must have 1: forward_speed_rate"):
        make_loop(many)


@pytest.mark.parametrize(
    ("name", "backend"),
    [("line", "c"), ("integral", "c"), ("car", "cf"), ("path", "c"), ("train", "c"), ("arm", "c")],
)
def test_a_sweep_runs_the_same_loop(name, backend, tmp_path):
    """Also with other parameters, where the axle, and P_l with it, is somewhere else."""
    (tmp_path / "robots.py").write_text(ROBOTS)
    spec = spec_of((SPECS | {"integral": AXLE + INTEGRAL})[name], tmp_path / "spec.toml")
    simulation = dataclasses.replace(
        spec.simulation, period=0.02, backend=backend, tolerance=1e-12, duration=3.0
    )
    batch = Batch(dataclasses.replace(spec, simulation=simulation))
    first = next(name for name in batch.inputs if name.startswith("parameters."))
    moved = "parameters.d" if "parameters.d" in batch.inputs else first
    table = batch.table({moved: batch.nominal[moved] * np.array([1.0, 1.1])}, 2)
    for row, outcome in zip(table, batch.run(table), strict=True):
        run, found = simulate(batch.spec_of(row)), dict(zip(batch.outcomes, outcome, strict=True))
        end = [found[f"end.{q.name}"] for q in run.law.system.state]
        assert batch.status(found["status"]) == "ok" == run.status[-1] and found["integration_error"] < 1e-7
        np.testing.assert_allclose(end, run.x[-1], rtol=0, atol=found["integration_error"] + 1e-10)


@pytest.mark.parametrize("name", ["path", "train"])
def test_the_whole_loop_about_its_steady_motion(name, tmp_path):
    """Continuous: the poles that were placed. Sampled: the error of a run close to it satisfies the equation
    of the eigenvalues of the linearized loop, in which the states of the extension advance by Euler's steps,
    as in C.
    """
    (tmp_path / "robots.py").write_text(ROBOTS)
    spec = spec_of(SPECS[name], tmp_path / "spec.toml")
    motion = steady_motion(setting_of(spec))
    degrees = motion.setting.law.linearization.relative_degree
    placed = [
        p for degree in degrees for p in np.polynomial.polynomial.polyroots([*default_gains(degree), 1.0])
    ]
    if name == "path":
        placed.remove(max(placed, key=abs))  # none of them belongs to the place along the path
    for pole in motion.eigenvalues():
        assert min(abs(pole - each) for each in placed) < 2e-3, pole
    period = 0.1
    moved = motion.state.copy()
    moved[:2] += 1e-5
    count = len(motion.setting.law.system.mechanism.coordinates)
    initial = Initial(q=tuple(moved[:count]), nu=tuple(moved[count:]), extension=(0.0,) * len(motion.z))
    simulation = dataclasses.replace(
        spec.simulation, period=period, duration=4.0, output_step=period, tolerance=1e-13
    )
    run = simulate(dataclasses.replace(spec, initial=initial, simulation=simulation))
    equation = np.poly(motion.eigenvalues(period)).real
    residual = np.convolve(run.error[:, 0], equation, "valid")
    assert np.abs(residual).max() < 1e-5 * np.abs(run.error[:, 0]).max()


def test_systems_of_python_control_have_the_states_of_the_extension():
    loop = make_loop(spec_of(AXLE, ""))
    system = closed_loop_system(loop)
    assert system.state_labels[-1] == "forward_speed_rate"
    run = simulate(spec_of(AXLE, ""))
    desired = np.column_stack([loop.guidance.reference(t, loop.start) for t in run.t])
    options = {"solve_ivp_kwargs": {"rtol": 1e-9, "atol": 1e-11}}
    start = np.append(loop.start, loop.extension)
    response = control.input_output_response(system, run.t, desired, start, **options)
    np.testing.assert_allclose(response.states[:-1].T, run.x, rtol=0, atol=1e-6)
    np.testing.assert_allclose(response.states[-1], run.extension[:, 0], rtol=0, atol=1e-6)
    period = 0.1
    state = np.append(loop.start, loop.extension)
    after = closed_loop_system(loop, period).dynamics(0.0, state, loop.guidance.reference(0.0, loop.start))
    held = simulate(
        dataclasses.replace(run.spec, simulation=dataclasses.replace(run.spec.simulation, period=period))
    )
    at = list(np.round(held.t, 9)).index(0.5)
    for k in range(1, 5):
        after = closed_loop_system(loop, period).dynamics(
            k * period, after, loop.guidance.reference(k * period, loop.start)
        )
    np.testing.assert_allclose(after[:-1], held.x[at], rtol=0, atol=1e-9)


OUTER_LOOP = ["outer-loop", "labmate", "--output", "type_iv_circle_extended", "--period", "0.01", "--json"]


def test_poles_of_a_chain_with_integral_action():
    """(s + 1)(s + 2)(s + 3)(s + 4) = s^4 + 10 s^3 + 35 s^2 + 50 s + 24;
    LQR and discrete poles have as many."""
    gains = from_poles(3, [-1.0, -2.0, -3.0, -4.0], integral=True)
    named = gains.named("y")
    assert [named[f"{name}_y"] for name in ("ki", "kp", "kd", "ka")] == pytest.approx(
        [24.0, 50.0, 35.0, 10.0]
    )
    A, B = sampled_chain(3, 0.1, integral=True)
    placed = from_discrete_poles(3, [0.9, 0.8, 0.7, 0.6], 0.1, integral=True).vector
    np.testing.assert_allclose(
        sorted(np.linalg.eigvals(A - B * placed).real), [0.6, 0.7, 0.8, 0.9], atol=1e-9
    )
    assert len(from_lqr(4, [1.0] * 6, integral=True).poles) == 5


def test_rouths_array_is_where_the_roots_are():
    random = np.random.default_rng(9)
    for degree in range(1, 8):
        coefficients = random.uniform(-0.2, 2.0, (50, degree)) * [
            math.comb(degree, k + 1) for k in range(degree)
        ]
        expected = [bool(np.all(np.roots([1.0, *each]).real < 0)) for each in coefficients]
        assert [bool(hurwitz([1.0, *each])) for each in coefficients] == expected
        np.testing.assert_array_equal(hurwitz([np.ones(50), *coefficients.T]), expected)


@pytest.mark.nightly
def test_outer_loop_of_an_extended_law(capsys):
    assert main([*OUTER_LOOP, "--poles", "distance=-1,-2,-3", "--lqr", "speed=0.2,0.5,1"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert [report["gains"][f"{name}_distance"] for name in ("kp", "kd", "ka")] == pytest.approx(
        [6.0, 11.0, 6.0]
    )
    assert report["whole"]["decay"] > 0.9 and report["channels"]["distance"]["relative_degree"] == 3


def test_outer_loop_does_not_mix_an_extension_with_drives(bad_input):
    message = bad_input([*OUTER_LOOP, "--drive", "velocity", "--bandwidth", "5"])
    assert "does not go with velocity drives" in message


@pytest.mark.nightly
def test_exported_projects_test_the_extended_law(tmp_path, capsys):
    """The self-test compares with the model and the bits of this host;
    the loop and the package's example pass the time on."""
    project, package = tmp_path / "project", tmp_path / "package"
    assert (
        main(
            ["export", "labmate", "--output", "type_i_extended", "--firmware", "generic", "-o", str(project)]
        )
        == 0
    )
    said = subprocess.run(["make", "-C", project, "test"], capture_output=True, text=True).stdout
    assert "labmate_type_i_extended_f: pass, steps 13" in said and "selftest: pass" in said
    assert "&reference, dt, tau)" in (project / "loop.c").read_text()
    text = (project / "selftest" / "selftest.c").read_text()
    (project / "selftest" / "selftest.c").write_text(text.replace("= extension.value", "= -extension.value"))
    assert (
        "FAIL at step"
        in subprocess.run(["make", "-C", project, "test"], capture_output=True, text=True).stdout
    )
    assert (
        main(["export", "labmate", "--output", "type_i_extended", "--package", "arduino", "-o", str(package)])
        == 0
    )
    assert "&reference, dt, tau)" in (package / "examples" / "Step" / "Step.ino").read_text()


def test_an_emulated_processor_computes_the_same_bits():
    need("arm-none-eabi-gcc", "qemu-system-arm")
    runs = []
    for backend in ("cf", "m4f"):
        spec = spec_of(AXLE, "")
        simulation = dataclasses.replace(spec.simulation, backend=backend, period=0.05, duration=2.0)
        runs.append(simulate(dataclasses.replace(spec, simulation=simulation)))
    np.testing.assert_array_equal(runs[0].x, runs[1].x)
    np.testing.assert_array_equal(runs[0].extension, runs[1].extension)
    assert runs[0].extension.any()


COURSE = AXLE.replace(
    "velocity = [0.6, 0.1]", "course = { speed = 0.5, lengths = [2.0], curvatures = [0.0, 0.1] }"
)
REFUSED = {
    "course without its end": (
        COURSE.replace("[0.0, 0.1]", "[0.1]"),
        "1 lengths and 1 curvatures: give one curvature more",
    ),
    "course without a length": (
        COURSE.replace("lengths = [2.0]", "lengths = [0.0]"),
        "course: has a length of 0",
    ),
    "course that waits, and a velocity": (
        COURSE.replace("0.1] }", '0.1], follow = "path" }, velocity = [0.1, 0.0]'),
        "velocity does not go with .reference.course. follow",
    ),
    "course that waits, without damping": (
        COURSE.replace("0.1] }", '0.1], follow = "path" }') + "gains = { kd = 0.0 }",
        "gains of x_l other than kp must place poles",
    ),
    "rounding too long": (
        COURSE.replace("0.1] }", "0.1], rounding = 2.1 }"),
        "rounding = 2.1 must be at most the shortest of the lengths",
    ),
    "course that goes back": (COURSE.replace("speed = 0.5, l", "speed = -0.5, l"), "speed .*positive"),
    "course and circle": (
        COURSE.replace("course =", "circle = { radius = 1.0, rate = 0.1 }, course ="),
        "circle does not go with .reference. course",
    ),
    "course of a path": (
        PATH.replace(
            "speed = 0.5 }", "speed = 0.5, course = { speed = 1.0, lengths = [], curvatures = [0.0] } }"
        ),
        "course does not apply to type IV",
    ),
    "no extension": (AXLE.replace(", extension = true", ""), "extension = true"),
    "standstill": (AXLE.replace("speed = 0.5", "speed = 0.0"), "start with a speed"),
    "not on the axle": (AXLE.replace("L = -0.3", "L = 0.1"), "L = -0.3 m; L is 0.1"),
    "integral action": (AXLE + "gains = { ki_x_l = 12.5 }", "kp s.1 . ki; make it smaller"),
    "slow": (AXLE + 'limits = { torque = 3.0, mode = "slow" }', 'set mode = "cut"'),
    "drive": (
        AXLE.replace("output_step = 0.5 }", "period = 0.01 }")
        + 'drive = { kind = "velocity", bandwidth = 5.0 }',
        "use drives that take torques",
    ),
    "composite path": (
        'robot = "labmate"\noutput = { type = "IV", L = -0.3, extension = true, path = { kind = "waypoints", '
        "tolerance = 0.1, "
        "points = [[0, 0], [1, 0], [2, 1]] } }\nreference = { speed = 0.5 }\nsimulation = { duration = 1.0 }",
        "composite path: P_l on the axle cannot follow a curvature that jumps",
    ),
    "reversing": (AXLE.replace("L = -0.3", 'L = -0.3, reversing = "switch"'), "needs no reversing"),
    "approach": (
        PATH.replace("speed = 0.5 }", "speed = 0.5, approach = { acceleration = 0.3 } }"),
        "requires|no third derivative",
    ),
    "circle of a heading": (
        AXLE.replace('"I"', '"II"').replace("velocity = [0.6, 0.1]", "circle = { radius = 2.0, rate = 0.3 }"),
        "does not go with outputs that begin with no point",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_there_is_refused_with_the_reason(name):
    text, message = REFUSED[name]
    with pytest.raises(BadInput, match=message):
        simulate(spec_of(text, "spec.toml"))


STOOD, NORMAL = "the forward speed is zero", "the heading is normal to the path"
VERDICTS = {  # robot and law: what is said of the singular set, what is left, what its zero dynamics are
    (find_robot, "type_i_extended"): ([STOOD], ["theta_r", "theta_l"], "nothing is left that could diverge"),
    (find_robot, "type_iv_line_extended"): (
        [STOOD, NORMAL],
        ["theta_r", "theta_l", "along_path"],
        "nothing is left that could diverge",
    ),
    (car_by_its_rear_axle, "rear_extended"): ([STOOD], ["theta"], "nothing is left that could diverge"),
    (lambda: tractor_trailer(1), "type_i_extended"): (
        [STOOD],
        ["theta_r", "theta_l", "phi_1"],
        "stable while driving straight if and only if V > 0",
    ),
}


LONG = pytest.param(train_by_its_last_axle, "end_extended", marks=pytest.mark.nightly)


@pytest.mark.parametrize(("make", "name"), [*VERDICTS, LONG])
def test_analysis_of_an_extended_law(make, name):
    """The determinant is that of the law's Phi at random states;
    a trailer behind the axle that is steered may fold."""
    robot = make("labmate") if make is find_robot else make()
    form = normal_form.normal_form(decouple(law_of(robot, name).linearization))
    linear = form.decoupling.linearization
    groups = [*linear.system.state, *linear.extension, *robot.parameters, *linear.output.parameters]
    numeric = ca.Function("det", [ca.vertcat(*[q.symbol for q in groups])], [linear.determinant])
    formula = sp.lambdify([sp.Symbol(q.name) for q in groups], form.decoupling.det_in_full, "math")
    random = np.random.default_rng(7)
    for _ in range(20):
        values = random.uniform(0.3, 1.2, len(groups))
        assert formula(*values) == pytest.approx(float(numeric(values)), rel=1e-10)
    if (make, name) in VERDICTS:
        singular, left, stability = VERDICTS[make, name]
        assert [c.words for c in form.decoupling.conditions] == singular
        assert all(c.confirmed for c in form.decoupling.conditions)
        assert (list(form.T[2]), form.stability) == (left, stability)


def test_the_answer_about_an_extended_law(capsys, tmp_path):
    assert (
        main(
            [
                "analyse",
                "labmate",
                "--output",
                "type_i_extended",
                "--report",
                str(tmp_path / "page.html"),
                "--json",
            ]
        )
        == 0
    )
    (output,) = json.loads(capsys.readouterr().out)["outputs"].values()
    assert output["relative_degree"] == [3, 3] and STOOD in output["singular_when"]
    assert output["normal_form"]["z2"] == ["x_l_dot", "x_l_ddot", "y_l_dot", "y_l_ddot"]
    assert (
        "zero dynamics none" in output["zero_dynamics"]
        and "zero dynamics none" in (tmp_path / "page.html").read_text()
    )


def test_what_an_extension_leaves_undecided_is_said(monkeypatch):
    monkeypatch.setattr(normal_form, "posture_names", lambda system: ())
    with pytest.raises(
        ModelError, match="type_i_extended: the dynamic extension leaves 3 states .* not decided"
    ):
        normal_form.normal_form(decouple(law_of(tractor_trailer(1), "type_i_extended").linearization))


def test_a_sampled_run_integrates_between_its_calls(tmp_path):
    run = run_of(AXLE, tmp_path, period=0.01, duration=20.0)
    assert run.stopped is None and np.abs(run.error[-1]).max() < 1e-3
    assert (
        run.columns[-1] == "forward_speed_rate" and np.isfinite(run.extension).all() and run.extension.any()
    )


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_no_input_makes_a_step_return_what_is_not_finite(scalar):
    controller, state, reference = compiled(scalar)
    compiled_law, random = controller._library, np.random.default_rng(11)
    strange = [np.nan, np.inf, -np.inf, 1e308, -3e38, 1e30, 1e-40, 0.0]
    for _ in range(400):
        compiled_law.function("reset")(controller._self)
        step(controller, state, reference, 0.0)
        x, y = state.copy(), reference.copy()
        for values in (x, y):
            if random.random() < 0.5:
                values[random.integers(len(values))] = random.choice(strange)
        dt = random.choice([0.01, *strange]) if random.random() < 0.3 else 0.01
        with np.errstate(over="ignore"):
            status, tau, _, rate = step(controller, x, y, dt)
        assert np.isfinite([*tau, rate]).all()
        assert (status == "ok") or (not tau.any() and rate == 0.0)
