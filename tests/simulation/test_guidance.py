"""Composite paths, sensors, corrections, limits and reversing in closed loop,
and what is said before a run about its start."""

import dataclasses
import math
import re

import numpy as np
import pytest
from noslip.analysis.certification.safety import certify
from noslip.checks.verification.sampling import random_plants
from noslip.cli.main import main
from noslip.model.segments import Segment
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_laws, find_robot, law_of, system_of
from noslip.simulation.closed_loop import simulate, why_singular
from noslip.simulation.controllers.backends import make_controller
from noslip.simulation.guidance import ShortWay
from noslip.simulation.loop import make_loop
from noslip.simulation.specification.spec import (
    Correction,
    LimitsSection,
    NoiseSection,
    PathSection,
    Reference,
    Sensors,
    Spec,
    spec_of,
)
from noslip.simulation.specification.vary import read_varied
from noslip.tests.simulation.test_simulate import CIRCLE, LINE, SPECS, beside_line, changed

AHEAD = 0.30  # m, of the axle lies the centre of mass
SPEED = 1.414


def chain(*pieces: tuple[float, float], start=(0.0, 0.0, 0.0)) -> tuple[Segment, ...]:
    """Segments of (curvature, length), each where the last one ends."""
    made, place = [], start
    for curvature, length in pieces:
        made.append(Segment(*place, curvature, length))
        place = made[-1].end
    return tuple(made)


ARC_LINE_ARC = chain((1 / 5, 5 * math.pi / 2), (0.0, 6.0), (-1 / 3, 3 * math.pi / 2))


def composite(segments, duration: float = 12.0, **output) -> Spec:
    """Along a composite path at 1.414 m/s from its start."""
    path = PathSection(kind="composite", segments=tuple(segments))
    first = segments[0]
    initial = dataclasses.replace(LINE.initial, point=(first.x, first.y), heading=first.heading, speed=SPEED)
    return changed(
        LINE,
        output={"path": path, **output},
        initial=initial,
        simulation={"duration": duration, "output_step": 0.05},
    )


def distance_from(path, points: np.ndarray) -> np.ndarray:
    """Distance of each point from the nearest of many points on the path, m: by brute force,
    without the path's formulas."""
    places = np.vstack([[piece.pose(s)[:2] for s in np.linspace(0, piece.length, 4000)] for piece in path])
    return np.array([np.min(np.hypot(*(places - point).T)) for point in points])


def test_arc_line_arc_is_followed():
    """Continuous, the path error stays at the tolerance of the integration through both joins;
    the torque jumps there."""
    run = simulate(composite(ARC_LINE_ARC))
    assert run.stopped is None and list(np.unique(run.piece)) == [0, 1, 2]
    assert np.abs(run.error[:, 0]).max() < 1e-8
    assert np.abs(np.diff(run.tau, axis=0)).max() > 1.0
    casadi = simulate(composite(ARC_LINE_ARC), "casadi")
    assert np.abs(run.x - casadi.x).max() < 1e-8 and np.array_equal(run.piece, casadi.piece)
    # Points of the path are 2 mm apart, so that the nearest one is at most this much farther than the path.
    assert distance_from(ARC_LINE_ARC, run.q[::10, :2]).max() < 0.002


def test_arc_line_arc_in_steps_of_10_ms():
    run = simulate(changed(composite(ARC_LINE_ARC), simulation={"period": 0.01, "output_step": 0.01}))
    assert 1e-5 < np.abs(run.error[:, 0]).max() < 5e-3
    assert np.abs(run.x - simulate(run.spec, "casadi").x).max() < 1e-8


def test_invariants_hold_on_a_composite_path():
    run = simulate(composite(ARC_LINE_ARC))
    turned = 0.15 / 1.5 * (run.q[:, 3] - run.q[:, 4])
    assert np.abs(run.q[:, 2] - turned).max() < 1e-11
    assert np.abs(run.plant.slip(run.x)).max() < 1e-12


def test_a_lap_of_a_closed_path_leads_into_the_next():
    straight, half_turn = (0.0, 4.0), (1 / 2, 2 * math.pi)
    path = chain(straight, half_turn, straight, half_turn)
    spec = composite(path, duration=2.1 * (8 + 4 * math.pi) / SPEED)
    spec = changed(spec, output={"path": dataclasses.replace(spec.output.path, closed=True)})
    run = simulate(spec)
    changes = run.piece[1:][np.diff(run.piece) != 0]
    assert list(changes) == [1, 2, 3, 0, 1, 2, 3, 0]
    assert np.abs(run.error[:, 0]).max() < 1e-8 and run.stopped is None


def test_it_comes_to_stand_at_the_end():
    """sqrt(2 a remaining) is followed exactly, and the path ends where it ends."""
    path = chain((0.0, 6.0))
    run = simulate(changed(composite(path, duration=10.0), reference={"deceleration": 0.5, "creep": 0.005}))
    assert np.abs(run.nu[-1]).max() < 1e-4 and abs(run.q[-1, 0] - 6.0) < 0.01
    braking = (run.t > 4) & (run.y[:, 1] > 0.01)
    expected = np.sqrt(2 * 0.5 * (6.0 - run.q[braking, 0]))
    assert np.abs(run.y[braking, 1] - expected).max() < 1e-6


@pytest.mark.nightly
def test_at_a_cusp_direction_and_reference_point_change_while_it_stands():
    """Forward on a line, back on an arc: P_l lies ahead of the axle, then behind it; the axle ends at the
    arc's end.

    Python and C agree as well as the integrator knows the instant at which the vehicle stands: the speed v,
    known to its tolerance, crosses the creep at the rate kv creep, and what changes then changes at most at
    the run's largest rate.
    """
    forward, back = Segment(0, 0, 0, 0, 5), Segment(5, 0, math.pi, -1 / 4, 6, backward=True)
    spec = composite((forward, back), duration=20.0, reversing="switch")
    path = dataclasses.replace(spec.output.path, stop="axle")
    creep, tolerance = 0.005, 1e-12
    spec = changed(spec, output={"path": path}, initial=None, reference={"deceleration": 0.4, "creep": creep})
    spec = changed(spec, simulation={"tolerance": tolerance})
    run = simulate(spec)
    at = np.flatnonzero(np.diff(run.piece))[0] + 1
    levers = run.config[:, [c.name for c in run.law.config].index("L")] + AHEAD
    assert np.allclose(levers[:at], AHEAD) and np.allclose(levers[at + 1 :], -AHEAD)
    assert abs(run.y[at, 1]) < 0.01 and run.y[at + 20 :, 1].max() < 1e-3 and run.y[:, 1].min() < -1.0
    axle = run.q[:, :2] - AHEAD * np.column_stack([np.cos(run.q[:, 2]), np.sin(run.q[:, 2])])
    x, y, heading = back.end
    assert np.hypot(*(axle[-1] - (x, y))) < 0.02 and abs(run.q[-1, 2] - (heading - math.pi)) < 0.03
    speed_error = tolerance * (1 + np.abs(run.nu).max()) * spec.parameters["r"]
    instant_error = speed_error / (spec.gains["kv"] * creep)
    largest_rate = max(np.abs(run.plant.rate(x, tau)).max() for x, tau in zip(run.x, run.tau, strict=True))
    assert np.abs(run.x - simulate(spec, "casadi").x).max() < 10 * largest_rate * instant_error < 1e-7


@pytest.mark.parametrize("backend", ["c", "casadi"])
@pytest.mark.parametrize("name", find_laws(system_of(find_robot("labmate"))))
def test_whole_turns_change_nothing(name, backend):
    """Of the heading, and any angles of the wheels: the same torques,
    where a wanted heading goes the short way round."""
    law = law_of(find_robot("labmate"), name)
    names = [q.name for q in law.state]
    heading, wheels = names.index("phi"), [names.index("theta_r"), names.index("theta_l")]
    for plant in random_plants(law, 20, seed=18):
        controller = make_controller(backend, law, plant.params, plant.config, plant.gains)
        prepare = ShortWay(law, np.array(plant.params), np.array(plant.config))
        for point in plant.points:
            status, tau = controller.step(point.state, prepare(point.state, point.reference))
            for turns in (-40, 1, 1000):
                state = point.state.copy()
                state[heading] += 2 * math.pi * turns
                state[wheels] += 1000.0 * turns
                again, wound = controller.step(state, prepare(state, point.reference))
                assert again == status == "ok"
                assert np.abs(wound - tau).max() < 1e-8 * max(1.0, np.abs(tau).max())


GOOD = ARC_LINE_ARC
BAD_PATHS = {
    "gap": ((GOOD[0], dataclasses.replace(GOOD[1], x=GOOD[1].x + 0.01), GOOD[2]), r"segment 2.*0\.01"),
    "no length": ((GOOD[0], dataclasses.replace(GOOD[1], length=0.0)), r"segment 2"),
    "kink": ((GOOD[0], dataclasses.replace(GOOD[1], heading=GOOD[1].heading + 0.1)), r"segment 2.*0\.1"),
    "tight": (chain((1 / 0.29, 1.0)), r"segment 1"),
    "as tight as the lever": (chain((1 / 0.3, 1.0)), r"segment 1"),
    "backward": ((dataclasses.replace(GOOD[0], backward=True),), r"segment 1.*revers"),
}


@pytest.mark.parametrize("name", BAD_PATHS)
@pytest.mark.parametrize("backend", ["c", "casadi", "cf"])
def test_bad_paths_are_refused_before_anything_moves(name, backend):
    path, said = BAD_PATHS[name]
    with pytest.raises(BadInput, match=said):
        make_loop(changed(composite(path), simulation={"backend": backend}))


@pytest.mark.parametrize(
    ("start", "said"),
    [
        ({"point": (0.0, 5.0)}, "centre"),
        ({"heading": 2e6}, "subtract whole turns"),
        ({"point": (1e300, 0.0)}, "far"),
    ],
)
@pytest.mark.parametrize("backend", ["c", "casadi"])
def test_a_start_that_the_tracker_cannot_place_is_refused(backend, start, said):
    with pytest.raises(BadInput, match=said):
        make_loop(changed(composite(ARC_LINE_ARC), initial=start, simulation={"backend": backend}))


def test_a_start_against_the_direction_of_travel_is_said():
    loop = make_loop(changed(composite(ARC_LINE_ARC), initial={"heading": 3.0}))
    assert "against the direction of travel" in loop.warnings[0]
    assert not make_loop(composite(ARC_LINE_ARC)).warnings


NOISE = Sensors(noise=NoiseSection(mean=(5.0, 0.5), sd=(3.0, 3.0)), seed=7)


def noisy(sensors: Sensors = NOISE, correction: Correction | None = None, duration: float = 4.0) -> Spec:
    """The paper's circle with noise on the wheels' rates, the controller called every 10 ms."""
    spec = changed(CIRCLE, simulation={"period": 0.01, "duration": duration})
    return dataclasses.replace(spec, sensors=sensors, correction=correction)


def test_noise_is_the_same_for_the_same_seed_in_c_and_in_python():
    spec = noisy(correction=Correction(rate=2.0))
    runs = [simulate(spec), simulate(spec), simulate(spec, "casadi")]
    assert runs[0].csv() == runs[1].csv()
    assert np.abs(runs[0].x - runs[2].x).max() < 1e-8 and np.abs(runs[0].seen - runs[2].seen).max() < 1e-8
    other = simulate(dataclasses.replace(spec, sensors=dataclasses.replace(NOISE, seed=8)))
    assert np.abs(runs[0].x - other.x).max() > 1e-3


def test_noise_has_no_negative_spread():
    with pytest.raises(BadInput, match=r"sd\[0\] = -1"):
        NoiseSection(sd=(-1.0,))


def test_noise_has_the_stated_mean_and_spread():
    run = simulate(noisy(duration=20.0))
    added = (run.seen - run.x)[:, 5:]  # rows and calls fall together
    count = len(added)
    assert np.all(np.abs(added.mean(axis=0) - (5.0, 0.5)) < 4 * 3 / math.sqrt(count))
    assert np.all(np.abs(added.std(axis=0) - 3.0) < 4 * 3 / math.sqrt(2 * count))


def test_without_noise_dead_reckoning_finds_the_true_pose():
    """Between calls the rates change a little, which a reckoning from angles cannot know:
    1e-5 m in 4 s at 5 m/s."""
    run = simulate(noisy(Sensors()))
    assert np.abs(run.seen - run.x)[::1, :5].max() < 0.0001
    coarse = simulate(noisy(Sensors(counts=1000)))
    assert 1e-4 < np.abs(coarse.seen - coarse.x)[:, :2].max() < 0.1


@pytest.mark.parametrize(
    ("backend", "most", "near"), [("casadi", 2**20, 1e-6), ("c", 2**20, 1e-6), ("cf", 2**13, 5e-3)]
)
@pytest.mark.parametrize("mode", ["reset", "bumpless"])
def test_a_sensed_run_may_turn_for_ever(mode, backend, most, near):
    """From a heading at the end of the range of sine and cosine the run goes on as from that heading without
    its whole turns."""
    spec = noisy(
        Sensors(), Correction(rate=5.0, mode=mode, release=0.1 if mode == "bumpless" else 0.0), duration=12.0
    )
    turns = 2 * math.pi * math.floor((most - 0.5 - spec.initial.heading) / (2 * math.pi))
    spec = changed(spec, simulation={"backend": backend})
    plain, far = (
        simulate(changed(spec, initial={"heading": spec.initial.heading + more})) for more in (0.0, turns)
    )
    assert far.stopped is None and far.q[-1, 2] > most and np.abs(far.seen[1:, 2]).max() < 4.1
    assert (
        np.abs(far.q[:, :2] - plain.q[:, :2]).max() < near
        and np.abs(far.q[:, 2] - turns - plain.q[:, 2]).max() < near
    )


def test_a_reset_makes_the_believed_pose_true_and_a_bumpless_one_gets_there_without_a_jump():
    jumps = {}
    for mode in ("reset", "bumpless"):
        run = simulate(noisy(correction=Correction(rate=1.0, mode=mode, release=0.5)))
        wrong = np.hypot(*(run.seen - run.x)[:, :2].T)
        jumps[mode] = np.abs(np.diff(wrong)).max()
        assert wrong.max() > 0.3
        if mode == "reset":
            assert all(wrong[np.isclose(run.t, k)] < 1e-12 for k in (1, 2, 3))
        # The true one never jumps: 10 ms at 5 m/s and a bit
        assert np.hypot(*np.diff(run.q[:, :2], axis=0).T).max() < 0.06
    assert jumps["reset"] > 0.3 > 0.1 > jumps["bumpless"]


def test_limits_slow_down_and_keep_the_path():
    """Starting on a bend with more than the motors have: cut, both push alike and it leaves the bend;
    slow, it stays on it."""
    path = chain((1 / 4, 4 * math.pi / 2))
    errors = {}
    for mode in ("cut", "slow"):
        spec = dataclasses.replace(
            composite(path, duration=4.0), limits=LimitsSection(torque=(6.0,), mode=mode)
        )
        spec = changed(spec, reference={"speed": 2.0}, initial={"speed": 0.0})
        run = simulate(spec)
        assert np.abs(run.tau).max() <= 6.0 and "saturated" in run.status
        errors[mode] = np.abs(run.error[:, 0]).max()
        assert np.abs(run.x - simulate(spec, "casadi").x).max() < 1e-8
    assert errors["slow"] < 1e-8 < 1e-2 < errors["cut"]


def test_reversing():
    """v / (L + d) < 0 diverges; refused, or P_l goes to the other side and it converges."""
    spec = beside_line(0.2, -1.0)
    spec = changed(spec, reference={"speed": -1.0}, simulation={"output_step": 0.05})
    free = simulate(spec)
    assert free.stopped == "singular" and "opposite signs" in free.warnings[0]
    with pytest.raises(BadInput, match="opposite signs"):
        simulate(changed(spec, output={"reversing": "refuse"}))
    switched = simulate(changed(spec, output={"reversing": "switch"}))
    assert switched.stopped is None and not switched.warnings and abs(switched.error[-1, 0]) < 0.001
    assert math.isclose(switched.spec.output.L, 0.0) and np.allclose(switched.config[:, 0] + AHEAD, -AHEAD)
    with pytest.raises(BadInput, match="same side"):
        simulate(changed(spec, output={"reversing": "switch", "L_backward": 1.0}))


def test_a_reference_point_beside_the_axis():
    """P_l anywhere on the vehicle follows the path just so:
    distance and speed obey the same linear equations."""
    line = changed(LINE, simulation={"output_step": 0.05})
    plain, aside = simulate(line), simulate(changed(line, output={"W": -0.4, "L": 0.5}))
    assert aside.law.name == "type_iv_line_offset"
    assert np.abs(plain.y - aside.y).max() < 1e-8
    assert np.abs(plain.q[-1, :2] - aside.q[-1, :2]).max() > 0.3
    assert np.abs(aside.x - simulate(aside.spec, "casadi").x).max() < 1e-8


@pytest.mark.parametrize(
    ("speed", "offset", "kind", "time"),
    [
        (1.414, 5.0, "singular", 0.845097),
        (0.0, 5.0, "singular", 0.540893),
        (1.414, 4.6, "safe", None),
        (1.414, 1.0, "safe", None),
    ],
)
def test_a_start_is_judged_as_stated(speed, offset, kind, time):
    """Figures of the mathematics, section 4; and the run agrees. The times are those at which the sine s of
    the heading off the path is 1: (L + d) s' = y' - v s, where distance y and speed v are linear motions.
    """
    spec = changed(beside_line(offset, speed), simulation={"duration": 8.0, "output_step": 0.05})
    verdict = certify(make_loop(spec), spec)
    assert verdict.kind == kind and (time is None or abs(verdict.t - time) < 5e-5)
    run = simulate(spec)
    assert (run.stopped == "singular") == (kind == "singular")
    assert time is None or abs(run.t[-1] - verdict.t) < 1e-4


@pytest.mark.nightly
@pytest.mark.parametrize("heading", np.radians([-90, -40, -20, 0, 60, 90, 120, 150, 156, 180]))
def test_starts_on_the_circle_are_judged_as_they_run(heading):
    spec = changed(
        CIRCLE, initial={"heading": float(heading)}, simulation={"duration": 6.0, "output_step": 0.05}
    )
    verdict, run = certify(make_loop(spec), spec), simulate(spec)
    assert verdict.kind == ("singular" if run.stopped else "safe")
    if run.stopped:
        assert abs(verdict.t - run.t[-1]) < 1e-3


LOOPS = {
    "sampled, with a delay": changed(LINE, simulation={"period": 0.01, "delay": 0.004}),
    "other masses": dataclasses.replace(LINE, plant={"m_c": 60.0}),  # than the controller takes the robot for
    "integral action": dataclasses.replace(LINE, gains={"ki": 0.5}),
    "limits": dataclasses.replace(LINE, limits=LimitsSection(torque=(1e6,))),  # that never hold
    "sampled with integral action": dataclasses.replace(
        changed(LINE, simulation={"period": 0.01}), gains={"ki_distance": 0.3}
    ),
}


@pytest.mark.nightly
@pytest.mark.parametrize("loop", LOOPS)
def test_a_start_is_judged_in_the_loop_that_is_run(loop):
    assert certify(make_loop(LOOPS[loop]), LOOPS[loop]).kind == "safe"


def test_what_the_proof_does_not_cover_is_not_proved():
    noisy = dataclasses.replace(changed(LINE, simulation={"period": 0.01}), sensors=Sensors())
    verdict = certify(make_loop(noisy), noisy)
    assert verdict.kind == "not proved" and "true state" in verdict.reason


def test_a_spec_is_changed_on_the_command_line(tmp_path, capsys):
    target, line = tmp_path / "x.csv", str(SPECS / "line.toml")
    assert (
        main(
            [
                "simulate",
                line,
                "-o",
                str(target),
                "--set",
                "simulation.duration=0.5",
                "--set",
                "simulation.period=0.01",
            ]
        )
        == 0
    )
    assert len(target.read_text().splitlines()) == 52
    capsys.readouterr()
    for wrong in ("simulation.duration", "simulation.durration=1"):
        assert main(["simulate", line, "-o", str(target), "--set", wrong]) == 2
        assert capsys.readouterr().err.count("\n") == 1


def test_headings_are_taken_the_short_way_round():
    """Type II from heading 3.0 to -3.0: over pi, 0.28 rad, not 6 rad back;
    whole turns in the reference change nothing."""
    output = {"type": "II", "path": None}
    reference = Reference(position=(0.0, -3.0), velocity=(0.0, 0.0))
    spec = changed(LINE, output=output, reference=reference, initial={"point": (0.0, 0.0), "heading": 3.0})
    spec = changed(spec, simulation={"duration": 12.0, "output_step": 0.05})
    run = simulate(spec)
    assert abs(run.q[-1, 2] - (2 * math.pi - 3.0)) < 0.02 and run.q[:, 2].min() > 2.99
    turned = simulate(changed(spec, reference={"position": (0.0, -3.0 + 20 * math.pi)}))
    assert np.abs(run.x - turned.x).max() < 1e-9


BEND = """
robot = "labmate"
parameters = { b = 0.25, d = 0.1, r = 0.1, m_c = 60.0, I_c = 12.0 }
gains = { kp = 4.0, kd = 5.0, kv = 2.0 }
output = { type = "IV", L = 0.1, path = { kind = "composite", stop = "axle", segments = [
    { kind = "line", from = [0, 0], to = [3, 0] },
    { kind = "arc", radius = 1.5, angle = 1.5 },
    { kind = "line", length = 2 } ] } }
contact = { mu = 0.5, height = 0.3 }
limits = { torque = 1000.0, mode = "cut" }
initial = { point = [0.3, 0.0], heading = 0.0, speed = 1.8 }
reference = { speed = 1.8 }
simulation = { duration = 3.5, period = 0.01 }
"""


def test_a_speed_that_does_not_fit_is_said_with_one_that_does(tmp_path, capsys):
    """By the forces that rolling needs in a run: within friction at the speed that is said,
    beyond it at 1.15 times that."""
    file, out = tmp_path / "bend.toml", str(tmp_path / "out.csv")
    file.write_text(BEND)
    assert main(["simulate", str(file), "-o", out]) == 0
    (line,) = capsys.readouterr().err.splitlines()
    found = re.search(r"at most (\S+) m/s fits the join at \(\S+, \S+\) m", line)
    assert found and "speed = 1.8 m/s does not fit" in line
    for part, fits in ((1.0, True), (1.15, False)):
        speed = part * float(found[1])
        run = simulate(
            read_varied(
                file, {"reference.speed": speed, "initial.speed": speed, "simulation.duration": 6 / speed}
            )
        )
        assert (
            (max(use[run.t > 1 / speed].max() for use in run.use.values()) <= 1)
            == fits
            == (run.warnings == ())
        )
    pose = ["--from", "0", "0", "0", "--to", "4", "3", "90", "--degrees"]
    assert (
        main(
            ["plan", "dubins", *pose, "--radius", "1", "--spec", str(file), "-o", str(tmp_path / "path.toml")]
        )
        == 0
    )
    assert "does not fit" in capsys.readouterr().err
    assert main(["plan", "dubins", *pose, "--radius", "1", "--spec", str(tmp_path / "none.toml")]) == 2


def test_a_car_on_arcs_of_a_floor_runs_without_a_word_on_its_speed():
    """Its largest accelerations are not known from its wheels."""
    text = (
        BEND.replace('robot = "labmate"', 'robot = "car"')
        .replace("L = 0.1,", "L = 1.0,")
        .replace("duration = 3.5", "duration = 0.2")
    )
    text = re.sub(r"parameters = .*|limits = .*|, height = 0.3", "", text).replace(
        "radius = 1.5", "radius = 9.0"
    )
    run = simulate(spec_of(text, "test"))
    assert run.stopped is None and run.warnings == ()


SINGULAR = {
    "output.L": 0.0,
    "gains": {"kp": 1.0, "kd": 2.5, "kv": 2.0},
    "contact": {"mu": 0.5},
    "limits": {"mode": "grip"},
    "reference": {"speed": 0.3, "deceleration": 0.5, "approach": {"acceleration": 0.5}},
    "initial": {"point": [0.3, 0.9], "heading": 0.3, "speed": 0.0},
    "simulation.duration": 2.0,
}


def test_a_singular_run_says_where_and_what_helps(tmp_path):
    """What it says was tried is tried here again."""
    file = tmp_path / "bend.toml"
    file.write_text(BEND)
    run = simulate(read_varied(file, SINGULAR))
    assert run.stopped == "singular"
    said = why_singular(run)
    heading = float(re.search(r"heading (\S+) deg", said)[1])
    assert (
        abs(abs(heading) - 90) < 0.1
        and "inputs were limited in" in said
        and "det Phi of distance, speed is zero at (" in said
    )
    assert said.endswith('with near_singular = "damped" in [output] this run does not stop (tried)')
    damped = simulate(read_varied(file, {**SINGULAR, "output.near_singular": "damped"}))
    assert damped.stopped is None and abs(damped.y[-1, 0]) < abs(damped.y[0, 0])


@pytest.mark.parametrize("heading", [-0.6, 0.0, 0.6])
@pytest.mark.parametrize(("distance", "speed"), [(0.9, 0.3), (-1.5, 0.3), (0.5, 0.2)])
def test_an_approach_that_is_too_fast_across_the_path_is_said(tmp_path, distance, speed, heading):
    """With the acceleration that the warning names the path is reached, without a warning."""
    file = tmp_path / "bend.toml"
    file.write_text(BEND)
    start = {"point": [0.3, distance], "heading": heading, "speed": 0.0}
    approach = {"acceleration": 0.5}
    changes = {**SINGULAR, "initial": start, "simulation.duration": 25.0}
    changes["reference"] = {"speed": speed, "deceleration": 0.5, "approach": approach}
    (said,) = make_loop(read_varied(file, changes)).warnings
    approach["acceleration"] = float(re.search(r"give acceleration = (\S+),", said)[1])
    led = simulate(read_varied(file, changes))
    assert led.warnings == () and led.stopped is None and abs(led.y[-1, 0]) < 0.01, led.y[-1]
