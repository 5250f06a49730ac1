"""Logs with wrong signs, exchanged columns and wrong units:
each is refused in one line that names the column and the remedy."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import noslip
import numpy as np
import pytest
from noslip.analysis.identification.faults import saturated, standstills
from noslip.analysis.identification.geometry import calibrate as fit_geometry
from noslip.analysis.identification.output_error import solvable
from noslip.analysis.identification.plausibility import _Motion
from noslip.cli.main import main
from noslip.readers.errors import BadInput
from noslip.simulation.closed_loop import simulate
from noslip.simulation.specification.spec import read_spec
from noslip.tests.analysis import test_calibration as geometry
from noslip.tests.analysis import test_identification as dynamics

DRIVE = ["--fit", "m_c", "I_c", "--set", "r=0.15", "--inputs", "held"]
ROWS = 400


def driven() -> dict[str, np.ndarray]:
    """A run towards a circle: all columns of `noslip simulate`, noisy rates."""
    table = np.array(dynamics.table()[:ROWS])
    table[:, 6:8] += dynamics.NOISE * np.random.default_rng(1).normal(size=(ROWS, 2))
    return dict(zip(dynamics.columns(), table.T, strict=True))


def measured() -> dict[str, np.ndarray]:
    """Angles and noisy poses of a winding path, with geometry that is not quite that of the robot."""
    log = geometry.log_of(*geometry.winding(200), 1.0, 3)
    return {
        "t": log.t,
        **dict(
            zip((*log.names, "x_c", "y_c", "phi"), np.column_stack([log.angles, log.pose]).T, strict=True)
        ),
    }


def times(factor, *names):
    return lambda c: {**c, **{name: factor * c[name] for name in names}}


def swapped(*pairs):
    new = {**dict(pairs), **{b: a for a, b in pairs}}
    return lambda c: {**c, **{a: c[b] for a, b in new.items()}}


def only(change, *left_out):
    return lambda c: {name: each for name, each in change(c).items() if name not in left_out}


POSE, ANGLES, RATES = ("x_c", "y_c", "phi"), ("theta_r", "theta_l"), ("thetadot_r", "thetadot_l")
DEG, RPM = 180 / np.pi, 60 / (2 * np.pi)
BAD = {  # command, what happened to the log, what is said
    "right encoder": (measured, times(-1, "theta_r"), "--map theta_r=-theta_r"),
    "left encoder": (measured, times(-1, "theta_l"), "--map theta_l=-theta_l"),
    "encoders exchanged": (measured, swapped(ANGLES), "--map theta_r=theta_l --map theta_l=theta_r"),
    "heading clockwise": (measured, times(-1, "phi"), "--map phi=-phi"),
    "x and y exchanged": (measured, swapped(("x_c", "y_c")), "--map x_c=y_c --map y_c=x_c"),
    "x backwards": (measured, times(-1, "x_c"), "--map x_c=-x_c"),
    "heading in degrees": (measured, times(DEG, "phi"), "phi=phi [deg]"),
    "angles in degrees": (
        measured,
        times(DEG, *ANGLES),
        "--map 'theta_r=theta_r [deg]' --map 'theta_l=theta_l [deg]'",
    ),
    "one angle in turns": (measured, times(1 / (2 * np.pi), "theta_l"), "theta_l=theta_l [turn]"),
    "place in mm": (measured, times(1000, "x_c", "y_c"), "--map 'x_c=x_c [mm]' --map 'y_c=y_c [mm]'"),
    "x in mm": (measured, times(1000, "x_c"), "x_c=x_c [mm]"),
    "a wheel backwards": (
        driven,
        times(-1, "theta_r", "thetadot_r"),
        "--map theta_r=-theta_r --map thetadot_r=-thetadot_r",
    ),
    "wheels exchanged": (
        driven,
        swapped(ANGLES, RATES),
        "theta_r and theta_l exchanged and thetadot_r and thetadot_l exchanged",
    ),
    "a rate backwards": (driven, times(-1, "thetadot_r"), "--map thetadot_r=-thetadot_r"),
    "rates exchanged": (driven, swapped(RATES), "--map thetadot_r=thetadot_l"),
    "rates in rpm": (
        driven,
        times(RPM, *RATES),
        "--map 'thetadot_r=thetadot_r [rpm]' --map 'thetadot_l=thetadot_l [rpm]'",
    ),
    "rates in degrees": (driven, times(DEG, *RATES), "[deg/s]"),
    "time in ms": (driven, times(1000, "t"), "say --map 't=t [ms]'"),
    "right torque": (driven, only(times(-1, "tau_r"), *POSE, *ANGLES), "--map tau_r=-tau_r"),
    "left torque": (driven, times(-1, "tau_l"), "--map tau_l=-tau_l"),
    "both torques": (driven, times(-1, "tau_r", "tau_l"), "--map tau_r=-tau_r --map tau_l=-tau_l"),
    "torques exchanged": (driven, swapped(("tau_r", "tau_l")), "--map tau_r=tau_l --map tau_l=tau_r"),
    "a rate backwards, alone": (
        driven,
        only(times(-1, "thetadot_l"), *POSE, *ANGLES),
        "--map thetadot_l=-thetadot_l",
    ),
}


@pytest.fixture
def write(tmp_path):
    def write(columns) -> str:
        with (tmp_path / "log.csv").open("w", newline="") as stream:
            csv.writer(stream).writerows(
                [list(columns), *zip(*([repr(float(e)) for e in c] for c in columns.values()), strict=True)]
            )
        return str(tmp_path / "log.csv")

    return write


def arguments(log) -> list[str]:
    return (
        ["calibrate", "--robot", "labmate"] if log is measured else ["identify", "--robot", "labmate", *DRIVE]
    )


@pytest.mark.parametrize("case", BAD)
def test_it_is_found_which_column_is_wrong(case, write, bad_input):
    log, change, message = BAD[case]
    said = bad_input([*arguments(log), write(change(log()))])
    assert message in said
    print(said)


def test_the_remedy_is_one(write, capsys):
    """What is advised gives the result of the right log."""
    for log, change, options in (
        (driven, times(-1, "tau_l"), ["--map", "tau_l=-tau_l"]),
        (measured, times(DEG, "phi"), ["--map", "phi=phi [deg]"]),
    ):
        assert main([*arguments(log), write(log())]) == 0
        right = capsys.readouterr().out
        assert main([*arguments(log), write(change(log())), *options]) == 0
        assert capsys.readouterr().out.splitlines()[1:4] == right.splitlines()[1:4]


@pytest.mark.parametrize("spec", ["turntable_ball", "tractor_trailer"])
def test_right_logs_of_other_robots_are_not_refused(spec, write):
    """Robots on a moving surface and with joints: what `noslip simulate` writes agrees with itself within 1
    %."""
    run = simulate(read_spec(str(Path(noslip.__file__).parent / f"examples/specs/robots/{spec}.toml")), "c")
    system = run.law.system
    columns = dict(zip((q.name for q in system.state), run.x.T, strict=True))
    values = [float(value) for value in run.plant.parameters]
    motion = _Motion(system, values, list(columns), [])
    assert len(motion.compared) == len(system.mechanism.coordinates)
    assert motion.misfit({"t": run.t, **columns}, [range(len(run.t))]) < 0.01


def test_right_logs_of_other_numbers_are_not_refused(write, capsys):
    """Masses twice and lengths a third off are what is looked for, not a wrong sign."""
    assert main(["calibrate", "--robot", "labmate", write(measured()), "--set", "r=0.1"]) == 0
    assert main(["identify", "--robot", "labmate", *DRIVE[:3], "--set", "m_w=4", write(driven())]) in (0, 1)
    assert Path(write(driven())).exists() and capsys.readouterr().out


# -- what a log tells ----------------------------------------------------------------------------------------


def fitted(capsys, *argv) -> dict:
    capsys.readouterr()
    assert main([*argv, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def calibrate(file, *options) -> list[str]:
    return ["calibrate", file, "--robot", "labmate", *options]


def test_more_than_half_a_turn_from_row_to_row_is_refused(write, bad_input):
    """Angles within a turn in so few rows that a wheel may have turned either way,
    even by about whole turns in each."""
    columns = measured() | {
        name: np.remainder(each, 2 * np.pi) for name, each in measured().items() if name in ANGLES
    }
    for every in (20, 30, 32):
        said = bad_input(
            calibrate(write({name: each[::every] for name, each in columns.items()}), "--fit", "r", "b")
        )
        assert (
            "either way" in said
            and said.startswith("noslip: row ")
            and "this log can tell rates up to" in said
        )


def test_straight_driving_with_noise_does_not_tell_the_track(write, capsys):
    """Of a heading that is noise no sign can be wrong."""
    log = geometry.log_of(np.full(300, 0.03), np.full(300, 0.03), 1.0, 5)
    columns = {
        "t": log.t,
        **dict(zip((*log.names, *POSE), np.column_stack([log.angles, log.pose]).T, strict=True)),
    }
    for name in ANGLES:
        columns[name] = columns[name] + 1e-3 * np.random.default_rng(len(name)).normal(size=len(log.t))
    status = main(calibrate(write(columns), "--fit", "r", "b"))
    said = "".join(capsys.readouterr())
    assert status in (1, 2) and "opposite sign" not in said and " b" in said


def test_times_that_jitter_leave_intervals_as_they_are(write, capsys):
    """A gap in time is none of angles, which are integrated."""
    steps = 0.05 * np.where(np.arange(200) % 5 == 4, 1.7, 0.825)
    uneven = measured() | {"t": np.concatenate([[0.0], np.cumsum(steps)])}
    sd = [fitted(capsys, *calibrate(write(c), "--fit", "r", "b"))["parameters"] for c in (measured(), uneven)]
    assert all(sd[1][name]["sd"] < 1.5 * sd[0][name]["sd"] for name in ("r", "b"))


def test_a_heading_alone_tells_the_track(write, capsys, bad_input):
    """By hand: the heading turns by r (theta_r - theta_l) / (2 b)."""
    file = write(only(lambda c: c, "x_c", "y_c")(measured()))
    printed = fitted(capsys, *calibrate(file, "--fit", "b", "--set", f"r={geometry.TRUE['r']}"))
    assert (
        abs(printed["parameters"]["b"]["value"] - geometry.TRUE["b"])
        < 4 * printed["parameters"]["b"]["sd"]
        < 0.02
    )
    assert "shows only b - 5 r" in bad_input(calibrate(file))


@pytest.mark.parametrize("direction", [-3.0, 1.8, 3.1])
def test_a_sensor_that_looks_anywhere(direction):
    log = geometry.log_of(*geometry.winding(), 1.0, 2, offset=(0.1, 0.0, direction))
    estimates = fit_geometry(
        [log], geometry.SYSTEM, ["r", "b", "offset_heading", "offset_x"], geometry.DEFAULT
    ).estimates
    each = estimates["offset_heading"]
    assert (
        abs(each.value) <= np.pi
        and abs(np.remainder(each.value - direction + 1, 2 * np.pi) - 1) < 4 * each.sd < 0.02
    )


def test_angles_between_rows_are_linear_only_where_poses_say_so(write):
    """In few rows: rates that the rows beside show are used, as they explain the poses better;
    linear angles are found."""
    log, kept = geometry.log_of(*geometry.winding(800), 0.1), slice(None, None, 8)
    log = replace(
        log, t=log.t[kept], angles=log.angles[kept], pose=log.pose[kept], stretches=(range(len(log.t[kept])),)
    )
    bent, linear = (
        fit_geometry([log], geometry.SYSTEM, ["r", "b"], geometry.DEFAULT | given)
        for given in ({}, {"bend": 0.0})
    )
    assert all(
        abs(e.value - geometry.TRUE[name]) < 1e-3 * geometry.TRUE[name] for name, e in bent.estimates.items()
    )
    assert any("the errors look like bend = " in remark for remark in linear.remarks)


def test_poses_that_are_late_are_in_the_intervals():
    """A delay that is not fitted is found by the errors it leaves."""
    log = geometry.log_of(*geometry.winding(), 0.3, 4, late=0.12)
    result = fit_geometry([log], geometry.SYSTEM, ["r", "b"], geometry.DEFAULT)
    assert any("look like" in remark and "delay = 0.1" in remark for remark in result.remarks)
    assert all(abs(e.value - geometry.TRUE[name]) < 4 * e.sd for name, e in result.estimates.items())


@pytest.mark.parametrize("every", [2, 4])
def test_rates_that_are_held_are_thinned_out(every, write, capsys):
    columns = dict(zip(dynamics.columns(), np.array(dynamics.table()).T, strict=True))
    rows = np.arange(len(columns["t"])) // every * every
    held = only(lambda c: {**c, **{name: c[name][rows] for name in RATES}}, *POSE, *ANGLES)(columns)
    printed = fitted(capsys, "identify", "--robot", "labmate", *DRIVE, write(held))
    for name, value in dynamics.PLANT.items():
        assert printed["parameters"][name]["value"] == pytest.approx(value, rel=1e-6)
    assert any(f"thetadot_r is new in every {every}th row only" in remark for remark in printed["remarks"])


def test_a_jump_of_the_pose_is_named(write, capsys):
    jumped = measured()
    for name, size in (("x_c", 0.4), ("y_c", -0.2)):
        jumped[name] = jumped[name] + size * (np.arange(len(jumped["t"])) >= 120)
    printed = fitted(capsys, *calibrate(write(jumped), "--fit", "r", "b"))
    assert any("row 122 (t = 6 s)" in remark and "not connected" in remark for remark in printed["remarks"])
    for name, each in printed["parameters"].items():
        assert abs(each["value"] - geometry.TRUE[name]) < 4 * each["sd"]


def test_a_value_out_of_proportion_is_refused(write, bad_input):
    """Angles in gradians, which is no unit that is tried, of wheels that are then a sixtieth as large."""
    said = bad_input(
        calibrate(write(times(200 / np.pi, *ANGLES)(measured())), "--fit", "r", "--set", "b=0.361")
    )
    assert "where 0.15 was expected" in said or "explain this log" in said or "contradict" in said


def test_an_equation_without_a_solution_is_no_internal_error():
    for _ in range(2):
        with pytest.raises(BadInput, match="does not show"):
            solvable(np.linalg.inv)(np.zeros((2, 2)))


def test_a_sensor_at_the_end_of_its_range_is_told_from_a_profile_of_speeds():
    t, random = np.linspace(0, 10, 500), np.random.default_rng(4)
    noisy = 3 * np.sin(t) + 0.02 * random.normal(size=len(t))
    assert saturated(np.clip(noisy, -9, 2.0)) == np.flatnonzero(noisy >= 2.0).tolist()
    for sound in (
        noisy,
        np.clip(t, 0, 3),
        np.clip(6 - np.abs(t - 6), 0, 3),
        np.round(noisy, 1),
        np.tanh(20 * t),
        np.zeros(4),
    ):
        assert saturated(sound) == []


def test_a_sensor_that_stands_still_is_told_from_one_that_rests():
    t, random = np.linspace(0, 10, 500), np.random.default_rng(5)
    turning = 3 * t + 0.3 * np.sin(5 * t)
    stuck = np.where((t > 4) & (t < 4.5), turning[200], turning)
    (rows,) = standstills(stuck)
    assert set(rows) == set(np.flatnonzero(stuck == turning[200])[1:])
    rests = np.where(t < 4, 0, np.clip(t - 4, 0, 0.3))  # a steering angle that is turned
    for sound in (
        turning,
        rests,
        np.maximum(turning, 15),
        np.round(turning, 1),
        turning + 0.1 * random.normal(size=len(t)),
    ):
        assert standstills(sound) == []


def test_numbers_without_a_header_and_without_an_angle_are_refused(bad_input, tmp_path):
    file = tmp_path / "poses.csv"
    file.write_text("".join(f"{k / 10},{k / 20},{k * k / 5000},{k / 100}\n" for k in range(60)))
    named = [
        word for k, name in enumerate(("t", "x_c", "y_c", "phi"), 1) for word in ("--map", f"{name}={k}")
    ]
    assert "alone cannot tell how labmate moves" in bad_input(
        ["calibrate", str(file), "--robot", "labmate", *named]
    )
