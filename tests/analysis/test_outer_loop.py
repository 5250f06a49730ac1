"""The outer loop on the robot: linear prediction against full runs of the generated C,
python-control systems, the command."""

import json
import math
import runpy
from dataclasses import replace
from pathlib import Path

import control
import noslip
import numpy as np
import pytest
from noslip.analysis.outer import robustness
from noslip.analysis.outer.channel import Channel, Required
from noslip.analysis.outer.design import Gains
from noslip.analysis.outer.interop import (
    ControllerRefused,
    Moving,
    closed_loop_system,
    command,
    controller_system,
    hold,
    robot_system,
)
from noslip.analysis.outer.margins import margins
from noslip.analysis.outer.motion import SteadyMotion, steady_motion
from noslip.analysis.outer.pictures import draw_period
from noslip.analysis.outer.report import OuterLoopReport
from noslip.analysis.outer.robustness import (
    Loops,
    corners,
    errors_of,
    one_by_one,
    ranking,
    search,
    with_errors,
    wrong,
)
from noslip.analysis.outer.setting import default_spec, setting_of
from noslip.cli.main import main
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot, law_of
from noslip.simulation.closed_loop import simulate
from noslip.simulation.controllers.angles import nearest_angle
from noslip.simulation.controllers.runtime import runtime
from noslip.simulation.guidance import ShortWay
from noslip.simulation.loop import Loop, make_loop
from noslip.simulation.specification.spec import (
    Initial,
    OutputSection,
    Reference,
    Simulation,
    Spec,
    read_spec,
)
from noslip.simulation.specification.spec import PathSection as Curve
from noslip.simulation.specification.vary import read_varied
from noslip.tests.runtime_c.test_runtime import FLAGS, INCLUDE, STRICT, compilers, each_level, run
from noslip.tests.tools import HOST_CC, need
from scipy.linalg import expm

ROOT = Path(noslip.__file__).parent
SPECS = ROOT / "examples/specs"
BESIDE_THE_LINE = {"initial": {"point": [0.0, 2.0], "heading": math.pi / 2, "speed": 0.0}}
LINE, CIRCLE = read_varied(SPECS / "line.toml", BESIDE_THE_LINE), read_spec(SPECS / "circle.toml")
DOUBLED = {"m_c": 60.0, "m_w": 2.0}
EXACT = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-12}
NAN, INF = math.nan, math.inf
LAWS = (
    "type_i",
    "type_ii",
    "type_iii",
    "type_iv_line",
    "type_iv_circle",
    "type_iv_segment",
    "type_iv_line_offset",
)


def with_run(spec: Spec, **entries) -> Spec:
    return replace(spec, simulation=replace(spec.simulation, **entries))


def motion_of(spec: Spec, **entries) -> SteadyMotion:
    return steady_motion(setting_of(replace(spec, **entries)))


def default_motion(name: str) -> SteadyMotion:
    return steady_motion(setting_of(default_spec("labmate", law_of(find_robot("labmate"), name))))


def near(
    motion: SteadyMotion, spec: Spec, deviation: np.ndarray, backend: str = "c"
) -> tuple[Moving, Loop, np.ndarray]:
    """The motion's systems and loop, and a state that lies `deviation` off it."""
    loop = make_loop(with_run(spec, backend=backend))
    moving = Moving(motion, loop.guidance.leg.controller)
    return moving, loop, moving.state(motion.rho + deviation)


def grows(motion: SteadyMotion, spec: Spec, period: float, delay: bool) -> bool:
    """Does a deviation from the motion grow, the generated C called at a period,
    the torque held (and a call late)?"""
    loop = make_loop(spec)
    moving = Moving(motion, loop.guidance.leg.controller)
    x, before, sizes = moving.state(motion.rho + 1e-6 * np.arange(1, len(motion.rho) + 1)), motion.torque, []
    for _ in range(120):
        tau = command(loop.guidance.leg.controller, x, motion.setting.reference)
        x = hold(loop.plant, x, before if delay else tau, period, 1e-12)
        before = tau
        sizes.append(np.abs(moving.coordinates(x) - motion.rho).max())
        if sizes[-1] > 1e-2:
            return True
    return max(sizes[-10:]) > max(sizes[40:50])


# -- linear channels against full runs on the generated C ----------------------------------------------------


def test_step_of_the_position():
    """Type I from rest to a point 0.3 m ahead and 0.2 m aside: both outputs step as the channel does,
    to 1e-6."""
    spec = Spec(
        robot="labmate",
        output=OutputSection(type="I", L=0.5),
        reference=Reference(position=(0.3, 0.2)),
        initial=Initial(point=(0.0, 0.0), heading=0.4, speed=0.0),
        simulation=Simulation(duration=8.0, output_step=0.05),
    )
    simulated = simulate(spec)
    response = control.step_response(
        Channel("x_l", "m", Gains(2, 1.0, 2.5)).closed(), simulated.t, squeeze=False
    ).outputs[0, 0]
    assert np.abs(simulated.y - np.outer(response, [0.3, 0.2])).max() < 1e-6


@pytest.mark.parametrize("spec", [LINE, CIRCLE], ids=["line", "circle"])
def test_step_of_distance_and_speed(spec):
    """From beside the path, along it, at the wrong speed: what is left is 1 - step, to 1e-6."""
    start = {"line": ((1.0, 0.5), math.pi / 4), "circle": ((30.4, 20.0), math.pi / 2)}[spec.output.path.kind]
    speed = 0.8 * spec.reference.speed
    spec = replace(spec, initial=Initial(point=start[0], heading=start[1], speed=speed))
    simulated = simulate(with_run(spec, duration=6.0, output_step=0.05))
    gains = {gain.name[:2]: spec.gains[gain.name[:2]] for gain in simulated.law.gains}
    channels = (
        Channel("distance", "m", Gains(2, gains["kp"], gains["kd"])),
        Channel("speed", "m/s", Gains(1, gains["kv"])),
    )
    for k, channel in enumerate(channels):
        response = control.step_response(channel.closed(), simulated.t, squeeze=False).outputs[0, 0]
        assert np.abs(simulated.error[:, k] - simulated.error[0, k] * (1 - response)).max() < 1e-6


@pytest.mark.nightly
def test_sampled_path_shift():
    """Holding the torque moves the position on the line of case C by about 0.7, 7, 66 mm at 1, 10, 100 ms."""
    exact = simulate(LINE)
    across = np.array([1.0, -1.0]) / math.sqrt(2)
    for period, moved, aside in ((1e-3, 0.7e-3, 0.46e-3), (1e-2, 7e-3, 4.5e-3), (1e-1, 66e-3, 41e-3)):
        shift = (simulate(with_run(LINE, period=period)).q - exact.q)[:, :2]
        assert np.linalg.norm(shift, axis=1).max() == pytest.approx(moved, rel=0.06)
        assert np.abs(shift @ across).max() == pytest.approx(aside, rel=0.02)


# -- the whole loop, linearized ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", LAWS)
def test_eigenvalues_are_poles_and_zero_dynamics(name):
    """With the exact model: those of the channels, and -v/l of the heading where it is no output."""
    expected = [-0.5, -2.0]
    if name in ("type_i", "type_ii", "type_iii"):
        expected = 2 * expected + ([-1 / 0.3] if name == "type_i" else [])
    else:
        expected = [*expected, -2.0, -1 / 0.3]
    assert np.sort(default_motion(name).eigenvalues().real) == pytest.approx(sorted(expected), abs=1e-6)


def test_steady_motion_on_the_circle():
    """P_l on R with s = l/R; the axle on sqrt(R^2 - l^2), which says how fast the wheels turn."""
    motion = motion_of(CIRCLE)
    distance, angle, right, left = motion.rho
    assert abs(distance) < 1e-12 and abs(math.sin(angle)) == pytest.approx(0.03, abs=1e-12)
    assert 0.15 * (right + left) / 2 == pytest.approx(5.0, abs=1e-10)
    assert 0.1 * (right - left) == pytest.approx(5 / math.sqrt(100 - 0.09), abs=1e-10)


@pytest.mark.parametrize("A, B, C", [(1.0, 0.0, 3.0), (-0.3, 0.7, 1.0), (0.2, 5.0, -8.0), (-1.0, 1.0, 0.0)])
def test_direction_of_the_line_does_not_matter(A, B, C):
    path = Curve(kind="line", parameters={"A": A, "B": B, "C": C})
    motion = motion_of(LINE, output=replace(LINE.output, path=path), plant=DOUBLED)
    assert np.abs(motion.eigenvalues() - motion_of(LINE, plant=DOUBLED).eigenvalues()).max() < 1e-7


def test_way_of_travel_is_the_specs():
    """The same circle the other way round, and a line backwards.

    There three poles are at -2, which rounding moves by its root or more: their polynomial is compared.
    """
    opposite = replace(CIRCLE, initial=replace(CIRCLE.initial, heading=-math.pi / 2))
    there, back = (steady_motion(setting_of(spec)) for spec in (CIRCLE, opposite))
    assert there.rho[2] > there.rho[3] and back.rho[2] < back.rho[3]
    assert np.abs(there.eigenvalues() - back.eigenvalues()).max() < 1e-7
    backwards = motion_of(LINE, reference=Reference(speed=-1.0), output=replace(LINE.output, L=-0.8))
    assert np.poly(backwards.closed()) == pytest.approx(np.poly([-0.5, -2.0, -2.0, -2.0]), abs=1e-11)
    assert backwards.decay() == pytest.approx(0.5, abs=1e-8)


@pytest.mark.parametrize("spec", [LINE, CIRCLE], ids=["line", "circle"])
@pytest.mark.parametrize("plant", [{}, DOUBLED, {"r": 0.17, "b": 0.6}])
def test_linearized_as_the_generated_c_does(spec, plant):
    """A, B, K against control.linearize of the true robot and of the generated C."""
    spec = replace(spec, plant=plant)
    motion = steady_motion(setting_of(spec))
    moving, _, _ = near(motion, spec, 0.0)
    robot = control.linearize(moving.robot_system(), motion.rho, motion.torque, eps=1e-5)
    answer = control.linearize(moving.controller_system(), [], motion.rho, eps=1e-5)
    assert np.abs(robot.A - motion.A).max() < 2e-4 * np.abs(motion.A).max()
    assert np.abs(robot.B - motion.B).max() < 2e-4 * np.abs(motion.B).max()
    assert np.abs(answer.D - motion.K).max() < 2e-4 * np.abs(motion.K).max()


@pytest.mark.parametrize("spec", [LINE, CIRCLE], ids=["line", "circle"])
@pytest.mark.parametrize("plant", [{}, {"m_c": 60.0, "r": 0.16}])
def test_map_over_a_period(spec, plant):
    """Its eigenvalues against central differences of the generated C with the torque held."""
    spec, period = replace(spec, plant=plant), 0.05
    motion = steady_motion(setting_of(spec))
    moving, loop, _ = near(motion, spec, 0.0)

    def after(rho: np.ndarray) -> np.ndarray:
        x = moving.state(rho)
        tau = command(loop.guidance.leg.controller, x, motion.setting.reference)
        return moving.coordinates(hold(loop.plant, x, tau, period, 1e-13))

    h = 1e-5
    differences = np.array(
        [(after(motion.rho + h * e) - after(motion.rho - h * e)) / (2 * h) for e in np.eye(4)]
    ).T
    expected = motion.closed(period)
    assert np.abs(differences - expected).max() < 1e-6 * np.abs(expected).max()
    assert np.abs(after(motion.rho) - motion.rho).max() < 1e-10  # steady with the torque held


@pytest.mark.parametrize("delay", [False, True], ids=["prompt", "late"])
@pytest.mark.parametrize(
    ("spec", "plant"),
    [(LINE, {}), (CIRCLE, {}), (CIRCLE, DOUBLED), (LINE, {"r": 0.18}), (CIRCLE, {"r": 0.18, "b": 0.6})],
    ids=["line", "circle", "heavy", "wheel", "both"],
)
def test_limit_of_the_period(spec, plant, delay):
    """The period at which full runs on the generated C turn from dying out to growing is the one predicted,
    within 5 %."""
    spec = replace(spec, plant=plant)
    motion = steady_motion(setting_of(spec))
    predicted = motion.longest_period(delay)
    for part, growing in ((0.8, False), (0.95, False), (1.05, True), (1.25, True)):
        assert grows(motion, spec, part * predicted, delay) == growing


def test_limit_of_the_period_by_simulate():
    """The same by `noslip simulate` itself, 5 % below and above."""
    predicted = motion_of(LINE).longest_period()
    start = replace(LINE, initial=Initial(point=(0.0, 1e-4), heading=math.pi / 4, speed=1.414))
    for part, settles in ((0.95, True), (1.05, False)):
        simulated = simulate(
            with_run(start, period=part * predicted, duration=60.0, output_step=part * predicted)
        )
        rates = np.abs(simulated.nu[:, 0] - simulated.nu[:, 1])
        assert (rates[-5:].max() < 0.5 * rates[20:25].max()) == settles


@pytest.mark.parametrize("spec", [LINE, CIRCLE], ids=["line", "circle"])
@pytest.mark.parametrize(
    "plant", [DOUBLED, {"m_c": 15.0}, {"r": 0.17}, {"b": 0.6}, {"d": 0.36}, {"I_c": 25.0, "m_w": 3.0}]
)
def test_wrong_model_against_nonlinear_runs(spec, plant):
    """Where it ends up, and how a small deviation dies out: rho - rho* is exp(A t) times it,
    to second order."""
    spec = replace(spec, plant=plant)
    motion = steady_motion(setting_of(spec))
    deviation = np.array([1e-3, -1e-3, 2e-3, 1e-3])
    moving, loop, start = near(motion, spec, deviation)
    n = len(loop.law.system.mechanism.coordinates)
    run = simulate(
        with_run(
            replace(spec, initial=Initial(q=tuple(start[:n]), nu=tuple(start[n:]))),
            duration=12.0,
            output_step=0.5,
        )
    )
    assert run.y[-1, 0] == pytest.approx(
        motion.rho[0], abs=1e-4 * math.exp(-12 * motion.decay()) / 1e-3 + 1e-5
    )
    for t, x in zip(run.t, run.x, strict=True):
        predicted = expm(motion.closed() * t) @ deviation
        assert np.abs(moving.coordinates(x) - motion.rho - predicted).max() < 1e-4


def test_offset_of_the_papers_figure():
    """9b: 8.7 cm at 5 m/s with the true masses twice what is believed, outwards; none on the line."""
    assert abs(motion_of(CIRCLE, plant=DOUBLED).rho[0] - 0.087) < 0.0005
    assert abs(motion_of(LINE, plant=DOUBLED).rho[0]) < 1e-12
    simulated = simulate(with_run(replace(CIRCLE, plant=DOUBLED), duration=20.0, output_step=0.5))
    assert simulated.y[-1, 0] == pytest.approx(motion_of(CIRCLE, plant=DOUBLED).rho[0], abs=1e-6)


def test_wrong_heading_in_closed_form():
    """On a line, a compass off by e: kp h1 = -+ kd v sin e, and the vehicle really goes along the line."""
    motion = motion_of(LINE)
    for bias in (-0.1, 0.02, 0.2):
        case = with_errors(motion, {"heading": bias})
        assert abs(case.offset) == pytest.approx(2.5 * 1.414 * math.sin(abs(bias)), abs=1e-9)
        assert abs(case.motion.rho[1]) < 1e-9


def test_wrong_speed_is_another_speed():
    motion = with_errors(motion_of(CIRCLE), {"speed": 0.3}).motion
    assert (
        np.abs(motion.eigenvalues() - motion_of(CIRCLE, reference=Reference(speed=6.5)).eigenvalues()).max()
        < 1e-8
    )


def test_wrong_L_moves_the_zero_dynamics():
    """The law's point is 0.1 l farther ahead: -v / (1.1 l), and the true one cuts the circle."""
    on_line = with_errors(motion_of(LINE), {"L": 0.1})
    assert on_line.eigenvalues[-1] == pytest.approx(-1.414 / 0.33, abs=1e-7)
    on_circle = with_errors(motion_of(CIRCLE), {"L": 0.1})
    assert on_circle.offset == pytest.approx(math.sqrt(100 - 0.33**2 + 0.3**2) - 10, abs=1e-9)


def test_ranking():
    """A compass hurts most, which leaves decimetres of offset; the wheel radius takes most of the longest
    period. Each row is the worse of its two errors.
    """
    motion = motion_of(CIRCLE)
    compass, *rows = ranking(motion, 0.2)
    assert compass.name == "heading" and abs(compass.offset) > 0.1 > compass.loss
    assert max(rows, key=lambda harm: harm.loss).name == "r"
    assert sorted([compass.name, *[harm.name for harm in rows]]) == sorted(errors_of(motion.setting))
    hurt = [max(harm.loss, abs(harm.offset) / 0.1) for harm in (compass, *rows)]
    assert hurt == sorted(hurt, reverse=True)
    radius = next(harm for harm in rows if harm.name == "r")
    both = [motion_of(CIRCLE, plant={"r": 0.15 * part}) for part in (0.8, 1.2)]
    assert radius.decay == pytest.approx(min(motion.decay() for motion in both), rel=1e-9)
    assert radius.longest_period == pytest.approx(min(motion.longest_period() for motion in both), rel=1e-9)
    assert radius.disk == pytest.approx(min(margins(motion.loop()).disk for motion in both), rel=1e-9)


def test_search_for_the_worst_errors(monkeypatch):
    """With a wrong heading the slowest loop is not at an end of the range: a scan finds it,
    and the search does."""
    monkeypatch.setattr(robustness, "POPULATION", 12)
    monkeypatch.setattr(robustness, "GENERATIONS", 8)
    motion = default_motion("type_iv_circle")
    names = ("heading", "speed")
    ends = list(corners(motion, 0.3, names=names))
    scan = [
        with_errors(motion, {"heading": amount, "speed": 0.3}).decay for amount in np.linspace(-0.3, 0.3, 61)
    ]
    found = search(motion, 0.3, begun=ends, names=names)
    assert (
        found.worst.decay <= found.slowest_drawn and found.tried == 12 * 9 and found.drawn == robustness.DRAWN
    )
    assert min(scan) - 1e-5 < found.worst.decay < min(case.decay for case in ends) - 1e-3
    assert found.worst.decay == with_errors(motion, found.worst.amounts).decay
    assert all(abs(amount) <= 0.3 for amount in found.worst.amounts.values())


def test_errors_that_are_too_large_are_seen():
    """Stability lost at a period: no margin left; all together are worse than each alone."""
    motion, loops = motion_of(CIRCLE), Loops(period=0.08)
    worst = ranking(motion, 0.2, loops)[0]
    assert worst.loss == 1.0 and worst.disk == 0.0 and worst.decay < 0
    alone = min(case.decay for case in one_by_one(motion, (-0.1, 0.1)))
    together = list(corners(motion, 0.1))
    assert len(together) == 256 and min(case.decay for case in together) < alone
    assert (
        not with_errors(motion, {"r": 0.2}, loops).stable
        or not with_errors(motion, {"r": -0.2}, loops).stable
    )


def test_disk_margin_of_the_whole_loop():
    """Factors inside the disk on both torques keep it stable;
    some just outside do not (found by a search over phases)."""
    motion, period = motion_of(CIRCLE, plant={"r": 0.17}), 0.03
    loop = motion.loop(period)
    alpha = margins(loop).disk

    def radius(size: float, angles: np.ndarray) -> float:
        delta = size * np.exp(1j * angles)
        factors = np.diag((1 + delta / 2) / (1 - delta / 2))
        return float(np.abs(np.linalg.eigvals(loop.A - loop.B @ factors @ loop.C)).max())

    random = np.random.default_rng(6)
    angles = random.uniform(0, 2 * np.pi, (1500, 2))
    assert max(radius(0.999 * alpha, each) for each in angles) < 1
    assert max(radius(1.05 * alpha, each) for each in angles) > 1


def test_no_steady_motion():
    with pytest.raises(BadInput, match="curvature changes"):
        setting_of(default_spec("labmate", law_of(find_robot("labmate"), "type_iv_ellipse")))
    spec = default_spec("labmate", law_of(find_robot("labmate"), "type_ii"))
    turning = replace(spec, reference=Reference(position=(0.0, 0.0), velocity=(1.0, 0.5)))
    with pytest.raises(BadInput, match="no steady motion"):
        steady_motion(setting_of(turning))
    with pytest.raises(BadInput, match="nothing named 'mass'"):
        wrong(motion_of(LINE).setting, "mass", 0.1)


# -- python-control ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", ["c", "casadi"])
@pytest.mark.parametrize("spec", [replace(LINE, plant=DOUBLED), CIRCLE], ids=["line", "circle"])
def test_same_trajectory_as_simulate(spec, backend):
    """States and torques to 1e-8, of the generated C and of CasADi, inside python-control."""
    spec = with_run(spec, duration=4.0, tolerance=1e-12, output_step=0.05, backend=backend)
    ours, loop = simulate(spec), make_loop(spec)
    system = closed_loop_system(loop)
    reference = list(map(float, loop.guidance.reference(0.0, loop.start)))
    response = control.input_output_response(system, ours.t, reference, loop.start, solve_ivp_kwargs=EXACT)
    assert system.state_labels == [f"labmate_{q.name}" for q in loop.law.state]
    assert system.input_labels == [q.name for q in loop.law.reference]
    assert (
        np.abs(response.outputs[:7].T - ours.x).max() < 1e-8
        and np.abs(response.outputs[7:].T - ours.tau).max() < 1e-8
    )


def test_same_sampled_trajectory_as_simulate():
    spec = with_run(CIRCLE, duration=3.0, tolerance=1e-12, output_step=0.02, period=0.02)
    ours, loop = simulate(spec), make_loop(spec)
    reference = list(map(float, loop.guidance.reference(0.0, loop.start)))
    system = closed_loop_system(loop, period=0.02)
    response = control.input_output_response(system, 0.02 * np.arange(len(ours.t)), reference, loop.start)
    assert system.dt == 0.02 and np.abs(response.outputs[:7].T - ours.x).max() < 1e-8


def test_joined_by_hand():
    """The parts by their names alone, as in a user's own diagram."""
    loop = make_loop(LINE)
    parts = [robot_system(loop.plant), controller_system(loop.guidance.leg.controller)]
    assert parts[0].input_labels == parts[1].output_labels == ["tau_r", "tau_l"]
    joined = control.interconnect(parts, inputs=[q.name for q in loop.law.reference], outputs=["x_c", "y_c"])
    reference = list(map(float, loop.guidance.reference(0.0, loop.start)))
    response = control.input_output_response(
        joined, [0, 5, 15], reference, loop.start, solve_ivp_kwargs={"rtol": 1e-8}
    )
    assert abs(response.outputs[0, -1] - response.outputs[1, -1]) < 0.002


def test_operating_point_and_linearization():
    """python-control finds the steady motion on the wrong robot by itself, with the generated C,
    and our eigenvalues there."""
    spec = replace(CIRCLE, plant=DOUBLED)
    motion = steady_motion(setting_of(spec))
    system = near(motion, spec, 0.0)[0].closed_loop_system()
    guess = motion_of(CIRCLE).rho
    point = control.find_operating_point(system, guess, np.zeros(2))
    assert np.abs(point.states - motion.rho).max() < 1e-7
    assert np.abs(control.find_eqpt(system, guess, np.zeros(2))[0] - motion.rho).max() < 1e-7
    poles = control.linearize(system, point.states, np.zeros(2)).poles()
    assert np.abs(np.sort_complex(poles) - np.sort_complex(motion.eigenvalues())).max() < 1e-4


@pytest.mark.parametrize("period", [None, 0.02])
def test_integral_action_removes_the_offset(period):
    """9b's 8.7 cm go below 1e-6 m; the eigenvalues say how fast, and the motion that it is steady at 0."""
    spec = replace(CIRCLE, plant=DOUBLED, gains={**CIRCLE.gains, "ki_distance": 2.0})
    loop = make_loop(spec)
    reference = list(map(float, loop.guidance.reference(0.0, loop.start)))
    motion = steady_motion(setting_of(spec))
    end = 45.0
    system = closed_loop_system(loop, period)
    assert "distance_acceleration_d" in system.input_labels
    times = np.array([0, end]) if period is None else period * np.arange(round(end / period) + 1)
    options = {"solve_ivp_kwargs": {"method": "DOP853", "rtol": 1e-9, "atol": 1e-9}} if period is None else {}
    response = control.input_output_response(system, times, reference, np.append(loop.start, 0.0), **options)
    assert abs(np.hypot(*(response.outputs[:2, -1] - 20)) - 10) < 1e-6
    assert response.states[-1, -1] == pytest.approx(motion.z[0], abs=1e-4) and abs(motion.rho[0]) < 1e-12
    assert abs(motion.decay(period) - 0.433) < 0.01


@pytest.mark.parametrize("period", [0.0, 0.02])
def test_integral_action_is_simulates(period):
    """Both outputs with it, as `noslip simulate` has it, to 1e-8."""
    spec = replace(
        CIRCLE, plant={"m_c": 60.0, "r": 0.16}, gains={**CIRCLE.gains, "ki_distance": 2.0, "ki_speed": 0.5}
    )
    spec = with_run(spec, duration=4.0, tolerance=1e-12, output_step=0.02, period=period)
    ours, loop = simulate(spec), make_loop(spec)
    reference = list(map(float, loop.guidance.reference(0.0, loop.start)))
    system, start = closed_loop_system(loop, period or None), np.append(loop.start, [0.0, 0.0])
    times = 0.02 * np.arange(len(ours.t)) if period else ours.t
    options = {} if period else {"solve_ivp_kwargs": EXACT}
    response = control.input_output_response(system, times, reference, start, **options)
    assert np.abs(response.outputs[:7].T - ours.x).max() < 1e-8


def test_refusal_of_the_controller_is_told():
    """Heading normal to the path: python-control's run ends with the controller's status."""
    loop = make_loop(LINE)
    state = loop.start.copy()
    state[2] = -math.pi / 4
    with pytest.raises(ControllerRefused, match="singular"):
        controller_system(loop.guidance.leg.controller).output(0, [], np.append(state, np.zeros(5)))


# -- headings ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("scalar", "tolerance"), [("double", 1e-15), ("float", 5e-7)])
def test_nearest_angle(scalar, tolerance):
    """Whole turns off the desired angle, within half a turn of the actual one; Python and C alike."""
    random = np.random.default_rng(5)
    compiled, largest = runtime("noslip_angle.h"), {"double": 1e5, "float": 8000.0}[scalar]
    function, answer = compiled.function("noslip_nearest_angle", scalar), compiled.array(scalar, [0.0])
    for size in (1.0, 10.0, 300.0, largest):
        for desired, actual in random.uniform(-size, size, (200, 2)).astype(np.float32).tolist():
            assert compiled.status(function(desired, actual, answer)) == "ok"
            nearest = answer[0]
            turns = (nearest - desired) / (2 * math.pi)
            assert abs(turns - round(turns)) * 2 * math.pi <= 8 * tolerance * size + tolerance
            assert abs(nearest - actual) <= math.pi + 8 * tolerance * size
            if abs(abs(nearest - actual) - math.pi) > 1e-3:
                assert nearest == pytest.approx(
                    nearest_angle(desired, actual), abs=8 * tolerance * size + tolerance
                )
            if abs(desired - actual) < 3.14:
                assert nearest == desired


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_nearest_angle_refused(scalar):
    compiled = runtime("noslip_angle.h")
    function, answer = compiled.function("noslip_nearest_angle", scalar), compiled.array(scalar, [7.0])
    beyond = {"double": 1.1e6, "float": 8193.0}[scalar]
    cases = [
        (NAN, 0.0, "nonfinite"),
        (0.0, INF, "nonfinite"),
        (beyond, 0.0, "range"),
        (0.0, -beyond, "range"),
    ]
    for desired, actual, status in cases:
        answer[0] = 7.0
        assert compiled.status(function(desired, actual, answer)) == status and answer[0] == 0.0
    assert compiled.status(function(0.0, 0.0, compiled.ffi.NULL)) == "null"


@compilers
@each_level
def test_angle_header_compiles_strictly(cc, level, tmp_path):
    need(cc)
    source = tmp_path / "angle.c"
    source.write_text(
        '#include "noslip_angle.h"\nint both(double w, double a, double *n, float *f);\n'
        "int both(double w, double a, double *n, float *f)\n"
        "{ return noslip_nearest_angle(w, a, n) | noslip_nearest_angle_f((float)w, (float)a, f); }\n"
    )
    run([cc, *FLAGS, *STRICT, level, *INCLUDE, "-c", str(source), "-o", str(tmp_path / "angle.o")])


@pytest.mark.parametrize("kind", ["II", "III"])
def test_heading_takes_the_short_way(kind):
    """A heading counted over three turns: prepared references lead to the same motion as without those
    turns."""
    name, heading = f"type_{kind.lower()}", 0.3 if kind == "II" else 1.2
    law = law_of(find_robot("labmate"), name)
    spec = replace(default_spec("labmate", law), reference=Reference(position=(0.2, heading)))
    loops = [
        make_loop(replace(spec, initial=Initial(q=(0.0, 0.0, heading - 0.5 + turns, 0.0, 0.0))))
        for turns in (0.0, 6 * math.pi)
    ]
    controllers = [loop.guidance.leg.controller for loop in loops]
    config, parameters = loops[0].guidance.leg.config, loops[0].plant.parameters
    prepare = ShortWay(law, parameters, config)
    reference = loops[0].guidance.reference(0.0, loops[0].start)
    x, wound = (loop.start for loop in loops)
    for _ in range(200):
        assert prepare(x, reference) == pytest.approx(reference, abs=0)
        tau, tau_wound = (
            command(c, s, prepare(s, reference)) for c, s in zip(controllers, (x, wound), strict=True)
        )
        assert np.abs(tau - tau_wound).max() < 1e-10
        x, wound = (hold(loops[0].plant, s, t, 0.02, 1e-12) for s, t in ((x, tau), (wound, tau_wound)))
    assert np.abs(wound - x - np.eye(7)[2] * 6 * math.pi).max() < 1e-9
    # The long way
    assert np.abs(command(controllers[1], wound, reference)).max() > 10 * np.abs(tau_wound).max()


def test_references_without_angles_stay():
    loop = make_loop(LINE)
    reference = np.arange(5.0)
    assert (
        ShortWay(loop.law, loop.plant.parameters, loop.guidance.leg.config)(loop.start, reference)
        is reference
    )


# -- the command ---------------------------------------------------------------------------------------------


def answer(capsys, *argv: str) -> dict:
    assert main(["outer-loop", *argv, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.nightly
def test_command_json(capsys):
    data = answer(capsys, "labmate", "--output", "type_iv_circle", "--period", "0.01")
    assert data["gains"] == {"kp_distance": 1.0, "kd_distance": 2.5, "kv_speed": 2.0}
    distance = data["channels"]["distance"]
    assert (
        distance["longest_period"]["stable"] == pytest.approx(0.8) and distance["continuous"]["gain"] is None
    )
    assert data["whole"]["eigenvalues"][-1] == pytest.approx([-1 / 0.3, 0.0], abs=1e-6)
    assert (
        0 < data["whole"]["longest_period"]["with_margins"] < data["whole"]["longest_period"]["stable"] < 0.8
    )
    assert data["robust"]["worst"] == data["robust"]["worst_offset"] == "heading"
    together = data["robust"]["together"]
    assert together["unstable"] == 0 and (together["tried"], together["combinations"]) == (
        256,
        2 ** len(data["robust"]["ranking"]),
    )


@pytest.mark.nightly
def test_command_design(capsys, tmp_path):
    """The gains designed go into the SPEC and into C as printed."""
    design = ["--settling", "distance=4", "--damping", "distance=1.25", "--poles", "speed=-2"]
    data = answer(
        capsys, "labmate", "--spec", str(SPECS / "circle.toml"), *design, "--period", "0.02", "--delay"
    )
    assert data["channels"]["distance"]["settling_time"] == pytest.approx(4.0)
    spec = (SPECS / "circle.toml").read_text().splitlines()
    changed = [data["spec"] if line.startswith("gains") else line for line in spec]
    (tmp_path / "designed.toml").write_text("\n".join(changed))
    assert dict(read_spec(tmp_path / "designed.toml").gains) == data["gains"]
    (tmp_path / "gains.c").write_text(
        f'#include "labmate_type_iv_circle.h"\nextern {data["c"].split("=")[0]};\n{data["c"]}\n'
    )
    run(
        [HOST_CC, *FLAGS, *STRICT, *INCLUDE, "-c", str(tmp_path / "gains.c"), "-o", str(tmp_path / "gains.o")]
    )


@pytest.mark.nightly
def test_command_integral(capsys):
    data = answer(capsys, "labmate", "--output", "type_iv_line", "--settling", "5", "--integral")
    assert data["gains"]["ki_distance"] > 0 and len(data["channels"]["distance"]["poles"]) == 3
    assert len(data["whole"]["eigenvalues"]) == 6
    assert "ki_distance = " in data["spec"] and "ki_" not in data["c"]


@pytest.mark.nightly
def test_command_search(capsys, monkeypatch):
    for name in ("POPULATION", "GENERATIONS", "DRAWN"):
        monkeypatch.setattr(robustness, name, 6)
    monkeypatch.setattr(robustness, "MOST_CORNERS", 16)
    data = answer(capsys, "labmate", "--output", "type_iv_line", "--search")["robust"]
    assert data["searched"]["slowest_decay"] <= min(
        data["together"]["slowest_decay"], data["searched"]["slowest_drawn"]
    )
    assert set(data["searched"]["amounts"]) == {harm["name"] for harm in data["ranking"]}
    assert main(["outer-loop", "labmate", "--output", "type_iv_line", "--search"]) == 0
    assert "worst found in the box, after 42 loops: decay 0." in capsys.readouterr().out


@pytest.mark.nightly
def test_command_observer(capsys):
    """The whole loop has a pole for each observer; in C they are beside the law."""
    data = answer(
        capsys,
        "labmate",
        "--output",
        "type_iv_line",
        "--observer",
        "distance=4",
        "--observer",
        "speed=6",
        "--period",
        "0.01",
    )
    assert data["gains"]["ko_distance"] == 4.0 and "ko_speed = 6.0" in data["spec"] and "ko_" not in data["c"]
    rates = [value[0] for value in data["whole"]["eigenvalues"]]
    assert all(min(abs(rate - expected) for rate in rates) < 1e-6 for expected in (-0.5, -2, -2, -4, -6))
    assert len(data["whole"]["discrete_eigenvalues"]) == 6


@pytest.mark.nightly
def test_command_hinf(capsys, tmp_path):
    """The norms that are stated are those of the gains that are printed,
    and of the channel that is called at the period."""
    options = ["--hinf", "distance=0.1,0.2,0.5,0.3", "--poles", "speed=-2", "--period", "0.05", "--delay"]
    data = answer(
        capsys, "labmate", "--output", "type_iv_ellipse", *options, "--figures", str(tmp_path / "figures")
    )
    gains = Gains(2, data["gains"]["kp_distance"], data["gains"]["kd_distance"])
    norms = data["channels"]["distance"]["norms"]
    assert norms["continuous"] == pytest.approx(Channel("y", "m", gains).norm([0.1, 0.2, 0.5, 0.3]))
    assert norms["continuous"] < norms["sampled"]
    assert data["channels"]["speed"]["norms"] is None
    assert (tmp_path / "figures" / "disturbances.png").read_bytes().startswith(b"\x89PNG")
    assert main(["outer-loop", "labmate", "--output", "type_iv_ellipse", *options]) == 0
    assert "norm from a disturbance/0.3 of v to error/0.1, rate/0.2, v/0.5: " in capsys.readouterr().out


@pytest.mark.parametrize("delay", [False, True])
def test_the_eigenvalues_drawn_over_the_period_are_those_of_the_loop_asked_for(delay):
    law = law_of(find_robot("labmate"), "type_iv_line")
    gains = {"distance": Gains(2, 1.0, 2.5), "speed": Gains(1, 2.0)}
    report = OuterLoopReport(law, default_spec("labmate", law), gains, Loops(0.05, delay), Required(), 0.2)
    plane, size = draw_period(report).axes[:2]
    upright = [
        line.get_xdata()[0]
        for line in size.get_lines()
        if len(line.get_xdata()) == 2 and len(set(line.get_xdata())) == 1
    ]
    assert upright == pytest.approx([800.0, 1000.0], rel=1e-6)
    assert size.get_xlim()[1] > 1000.0
    (dots,) = plane.collections
    drawn, periods = dots.get_offsets() @ [1, 1j], np.asarray(dots.get_array()) / 1e3
    own = drawn[periods == periods[-1]]
    assert (
        np.abs(np.sort_complex(own) - np.sort_complex(report.motion.eigenvalues(periods[-1], delay))).max()
        < 1e-9
    )


@pytest.mark.nightly
def test_a_law_that_is_singular_everywhere_offers_what_there_is(capsys):
    """An extension helps the labmate; the bus, whose axles both steer, has none."""
    for robot, L, offered in (("labmate", "-0.3", True), ("bus", "0", False)):
        assert main(["outer-loop", robot, "--output", "type_iv_line", f"--L={L}"]) == 0
        line = capsys.readouterr().out.splitlines()[-1]
        assert "--L" in line and ("extension = true" in line) == offered


@pytest.mark.nightly
def test_command_text_and_figures(capsys, tmp_path):
    folder = tmp_path / "figures"
    assert (
        main(
            [
                "outer-loop",
                "labmate",
                "--output",
                "type_iv_line",
                "--period",
                "0.05",
                "--figures",
                str(folder),
            ]
        )
        == 0
    )
    out = capsys.readouterr().out
    for words in (
        "poles -0.5, -2 1/s",
        "longest period",
        "both at once",
        "largest effect first",
        "gains = {",
        "a random sample of 256 of 2048",
    ):
        assert words in out
    names = ("loops", "period", "steps", "wrong")
    assert sorted(path.name for path in folder.iterdir()) == [
        f"{name}.{kind}" for name in names for kind in ("csv", "png")
    ]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in folder.glob("*.png"))


def test_command_without_a_steady_motion(capsys):
    """What can be said is said, and why the rest cannot."""
    data = answer(capsys, "labmate", "--output", "type_iv_ellipse", "--period", "0.02")
    assert (
        "curvature changes" in data["whole"]["refused"] and data["channels"]["distance"]["sampled"]["Ms"] > 1
    )


@pytest.mark.parametrize(
    ("argv", "reason"),
    [
        (["--output", "type_iv_line", "--period", "0"], "period = 0 must be positive"),
        (["--output", "type_iv_line", "--period", "-0.01"], "must be positive"),
        (["--output", "type_iv_line", "--period", "nan"], "is not finite"),
        (["--output", "type_iv_line", "--period", "x"], "invalid float value"),
        (["--output", "type_iv_line", "--period", "2"], "the channel is stable below 0.8 s"),
        (["--output", "type_iv_line", "--period", "0.5"], "the whole loop is stable below 0.372"),
        (
            ["--output", "type_iv_line", "--period", "0.3", "--delay"],
            "a delay of one sample, is beyond stability",
        ),
        (["--output", "type_iv_line", "--speed", "-1"], "unstable about its motion"),
        (["--output", "type_iv_line", "--speed", "0"], "must not be zero"),
        (["--output", "type_iv_line", "--speed", "inf"], "finite"),
        (["--output", "type_iv_line", "--L", "nan"], "not finite"),
        (["--output", "type_v"], "unknown output 'type_v'"),
        ([], "--output LAW or --spec"),
        (
            ["--output", "type_i", "--spec", str(SPECS / "line.toml")],
            "the SPEC has type_iv_line, but --output is type_i",
        ),
        (["--output", "type_i", "--poles", "x_l=1,-2"], "unstable"),
        (["--output", "type_i", "--poles", "x=-1,-2"], "unknown output 'x'"),
        (["--output", "type_i", "--poles", "-1,-2,-3"], "x_l: 3 poles make the controller improper"),
        (["--output", "type_i", "--poles=-1,-2,-3"], "improper"),
        (["--output", "type_i", "--poles=-1,b"], "are not numbers"),
        (["--output", "type_i", "--settling", "4", "--lqr", "1,1,1"], "choose one"),
        (["--output", "type_i", "--settling", "4,5"], "takes one number"),
        (["--output", "type_i", "--settling", "1j"], "must be real"),
        (["--output", "type_i", "--damping", "1"], "--damping requires --settling"),
        (["--output", "type_i", "--observer=-1"], "ko_x_l = -1 is negative"),
        (["--output", "type_i", "--observer", "1,2"], "--observer takes one number"),
        (
            [
                "--output",
                "type_i",
                "--observer",
                "3",
                "--drive",
                "velocity",
                "--bandwidth",
                "5",
                "--period",
                "0.01",
            ],
            "a disturbance observer does not go with velocity drives",
        ),
        (["--output", "type_i", "--integral"], "--integral requires a design"),
        (
            ["--output", "type_i", "--hinf", "0.1,0.2,0.5"],
            "requires 4 largest values (error, rate, v, disturbance), not 3",
        ),
        (["--output", "type_i", "--hinf", "0.1,0.2,0.5,0.5"], "must be below the largest v, 0.5"),
        (["--output", "type_i", "--hinf", "0.1,0.2,0.5,0.49", "--period", "0.2"], "only below 0.36"),
        (["--output", "type_i", "--hinf", "0.1,0.2,0.5,-0.3"], "largest disturbance = -0.3 must be positive"),
        (["--output", "type_i", "--delay"], "--delay needs --period"),
        (["--output", "type_i", "--discrete-poles", "0.9,0.8"], "--discrete-poles needs --period"),
        (["--output", "type_i", "--wrong", "1.5"], "--wrong = 1.5 must be below 1"),
        (["--output", "type_i", "--peak", "0"], "must be positive"),
    ],
)
def test_command_refuses(argv, reason, bad_input):
    assert reason in bad_input(["outer-loop", "labmate", *argv])


VECTORS = {  # section and entry of a SPEC of Type I -> how many numbers the law or the robot takes
    ("reference", "position"): (2,),
    ("reference", "velocity"): (2,),
    ("initial", "point"): (2,),
    ("initial", "q"): (5,),
    ("initial", "nu"): (2,),
    ("limits", "torque"): (1, 2),
    ("limits", "integral"): (1, 2),
    ("sensors", "noise.mean"): (1, 2),
    ("sensors", "noise.sd"): (1, 2),
}


@pytest.mark.parametrize("entry", VECTORS, ids=".".join)
def test_vectors_of_a_wrong_length_are_refused(entry, tmp_path, bad_input):
    """By each command that makes a loop of a SPEC, with the entry's name."""
    section, name = entry
    for length in {0, 1, 2, 3, 5, 7} - {*VECTORS[entry]}:
        tables = {
            "output": {"type": '"I"', "L": 1.0},
            "reference": {"position": [0.0, 0.0]},
            "gains": {"kp": 1.0, "ki": 0.1},
        }
        tables["initial"] = {"q": [0.0] * 5} if name in ("q", "nu") else {"point": [0.0, 0.0]}
        tables |= {
            "limits": {"torque": 5.0, "mode": '"cut"'},
            "simulation": {"duration": 0.1, "period": 0.01},
        }
        tables.setdefault(section, {})[name] = [0.1] * length
        lines = [
            line
            for key, table in tables.items()
            for line in (f"[{key}]", *(f"{k} = {v}" for k, v in table.items()))
        ]
        spec = tmp_path / "spec.toml"
        spec.write_text("\n".join(['robot = "labmate"', *lines]))
        for arguments in (
            ["simulate", str(spec), "-o", str(tmp_path / "o.csv")],
            ["outer-loop", "labmate", "--spec", str(spec)],
        ):
            message = bad_input(arguments)
            assert (
                str(spec) in message
                and section in message
                and name.partition(".")[0] in message
                and str(length) in message
            )


def test_command_refuses_unknown_robot(bad_input):
    assert "unknown robot" in bad_input(["outer-loop", "labmat", "--output", "type_i"])


@pytest.mark.nightly
def test_example_in_the_docs(capsys):
    """docs/outer_loop.py runs, and its assertions hold."""
    runpy.run_path(str(ROOT / "docs" / "outer_loop.py"))
    assert "the whole loop is stable up to 0.1032 s" in capsys.readouterr().out


@pytest.mark.nightly
def test_the_period_is_the_specs(capsys):
    """A SPEC whose controller is called at a period is judged as it is run; --period takes precedence."""
    for more, period in (([], 0.01), (["--period", "0.03"], 0.03)):
        argv = ["labmate", "--spec", str(SPECS / "figures" / "sampled.toml"), *more]
        assert answer(capsys, *argv)["period"] == period


@pytest.mark.nightly
def test_the_delay_is_the_specs(tmp_path, capsys):
    """That of a whole period counts as --delay does; that of a part of it is refused,
    unless --delay says a whole one."""
    text, file = (SPECS / "figures" / "sampled.toml").read_text(), tmp_path / "late.toml"
    assert "period = 0.01" in text and "delay" not in text
    asked = answer(capsys, "labmate", "--spec", str(SPECS / "figures" / "sampled.toml"), "--delay")
    file.write_text(text.replace("period = 0.01", "period = 0.01\ndelay = 0.01"))
    late = answer(capsys, "labmate", "--spec", str(file))
    assert late["delay"] is True and {**late, "spec": 0} == {**asked, "spec": 0}
    file.write_text(text.replace("period = 0.01", "period = 0.01\ndelay = 0.004"))
    assert main(["outer-loop", "labmate", "--spec", str(file)]) == 2
    assert "delay = 0.004 is a part of the period, 0.01 s" in capsys.readouterr().err
    assert answer(capsys, "labmate", "--spec", str(file), "--delay")["delay"] is True


@pytest.mark.nightly
def test_a_continuous_spec_at_a_period(tmp_path, capsys):
    """It is judged at the period of the command line, as the SPEC with that period is,
    also if it needs one."""
    text, files = (
        (SPECS / "line.toml").read_text(),
        [tmp_path / name for name in ("continuous.toml", "sampled.toml")],
    )
    assert "period = 0.0 " in text and "kv = 2.0 }" in text
    for file, period in zip(files, ("0.0", "0.02"), strict=True):
        file.write_text(text.replace("period = 0.0 ", f"period = {period} "))
    continuous = answer(capsys, "labmate", "--spec", str(files[0]), "--period", "0.02")
    assert continuous == answer(capsys, "labmate", "--spec", str(files[1])) and continuous["period"] == 0.02
    for file in files:
        file.write_text(file.read_text().replace("kv = 2.0 }", "kv = 2.0, ko_distance = 2.0 }"))
    observed = [
        {**answer(capsys, "labmate", "--spec", str(file), "--period", "0.02"), "spec": 0} for file in files
    ]
    assert observed[0] == observed[1] != {**continuous, "spec": 0}
    assert main(["outer-loop", "--spec", str(files[0])]) == 2
    assert "(gain ko) requires [simulation] period > 0" in capsys.readouterr().err


def test_a_composite_path_is_taken_at_its_tightest(capsys, tmp_path):
    """As a SPEC of that arc alone, and the robot is that of the SPEC."""
    segments = (
        'segments = [{ kind = "line", from = [0, 0], to = [2, 0] }, { kind = "arc", radius = 1.6, '
        "angle = -1.0 }, "
    )
    segments += '{ kind = "arc", radius = 4.0, angle = 0.5 }]'
    arc = 'kind = "segment", x_s = 2.0, y_s = 0.0, direction = 0.0, curvature = -0.625'
    text = 'robot = "labmate"\ngains = { kp = 2.0, kd = 3.0, kv = 2.0 }\n'
    text += 'output = { type = "IV", L = 0.3, path = { %s } }\nreference = { speed = 0.8 }\n'
    text += (
        "initial = { point = [0.0, 0.0], heading = 0.0 }\nsimulation = { duration = 5.0, period = 0.01 }\n"
    )
    answers = []
    for name, path in (("whole", f'kind = "composite", {segments}'), ("arc", arc)):
        file = tmp_path / f"{name}.toml"
        file.write_text(text % path)
        assert main(["outer-loop", "--spec", str(file), "--json"]) == 0
        answers.append(json.loads(capsys.readouterr().out))
    assert answers[0]["channels"] == answers[1]["channels"] and answers[0] == answers[1]
