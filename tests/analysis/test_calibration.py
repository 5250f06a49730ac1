"""Geometry from logs of angles and poses: against logs made by the exact arcs of two wheels,
and by our own simulation."""

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest
from noslip.analysis.identification.geometry import _check_motions, _Geometry, _windows, calibrate, pose_names
from noslip.analysis.identification.log import PoseLog
from noslip.analysis.identification.output_error import OutputError
from noslip.cli.main import main
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot, system_of
from noslip.simulation.closed_loop import simulate
from noslip.simulation.specification.spec import read_spec

SYSTEM = system_of(find_robot("labmate"))
TRUE = {"r": 0.152, "b": 0.361, "d": 0.3}
DEFAULT = {p.name: p.default for p in SYSTEM.mechanism.parameters} | {"r": 0.15}
PERIOD = 0.05  # s
NOISE = np.array([0.005, 0.005, 0.004])  # m, m, rad


def reckoned(right: np.ndarray, left: np.ndarray, start=(1.0, -2.0, 0.4)) -> np.ndarray:
    """Poses (N, 3) of the axle's middle from distances of the wheels between rows: chords of arcs,
    by hand."""
    x, y, heading = start
    poses = [start]
    for a, b in zip(right, left, strict=True):
        turn, way = (a - b) / (2 * TRUE["b"]), (a + b) / 2
        chord = way * np.sinc(turn / (2 * math.pi))
        x, y = x + chord * math.cos(heading + turn / 2), y + chord * math.sin(heading + turn / 2)
        heading += turn
        poses.append((x, y, heading))
    return np.array(poses)


def of_center(axle: np.ndarray) -> np.ndarray:
    """The pose of the centre of mass, d ahead of the axle."""
    return axle + TRUE["d"] * np.column_stack([np.cos(axle[:, 2]), np.sin(axle[:, 2]), np.zeros(len(axle))])


def winding(rows: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Distances (m) of both wheels between rows, constant in each: curves both ways, and some straight."""
    t = np.arange(rows) * PERIOD
    speed, yaw = 0.6 + 0.3 * np.sin(0.7 * t), 0.8 * np.sin(0.9 * t) * (t > 3)
    return PERIOD * (speed + yaw * TRUE["b"]), PERIOD * (speed - yaw * TRUE["b"])


def log_of(
    right,
    left,
    noise=0.0,
    seed=0,
    every=1,
    scale_left=1.0,
    late=0.0,
    offset=(0.0, 0.0, 0.0),
    start=(1.0, -2.0, 0.4),
    counts=0,
) -> PoseLog:
    """A log with a pose in every so many rows; the left wheel's radius is r / scale_left times what it should
    be. `counts` of each encoder per turn, which begin anywhere; 0: exact angles.
    """
    random = np.random.default_rng(seed)
    axle = reckoned(right, left, start)
    pose = of_center(axle)
    if late:  # on the arc before each row, for the first on its own arc backwards
        part = -late / PERIOD
        before = [np.concatenate([each[:1], each]) for each in (np.asarray(right), np.asarray(left))]
        ends = zip(part * before[0], part * before[1], axle, strict=True)
        pose = of_center(np.array([reckoned([a], [b], place)[1] for a, b, place in ends]))
    cosine, sine = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    x, y, turned = offset
    pose = pose + np.column_stack([x * cosine - y * sine, x * sine + y * cosine, np.full(len(pose), turned)])
    pose = pose + noise * NOISE * random.normal(size=pose.shape)
    pose[np.arange(len(pose)) % every != 0] = math.nan
    turned_by = [np.concatenate([[0.0], np.cumsum(each)]) / TRUE["r"] for each in (right, left)]
    angles = np.column_stack([turned_by[0], turned_by[1] / scale_left])
    if counts:
        count = 2 * math.pi / counts
        angles = count * np.floor(angles / count + random.uniform(size=2))
    return PoseLog(
        np.arange(len(pose)) * PERIOD, ("theta_r", "theta_l"), angles, pose, (range(len(pose)),), ()
    )


def values(result) -> dict[str, float]:
    return {name: each.value for name, each in result.estimates.items()}


def test_exact_poses_give_exact_numbers():
    result = calibrate([log_of(*winding())], SYSTEM, None, DEFAULT)
    assert values(result) == {name: pytest.approx(value, rel=1e-7) for name, value in TRUE.items()}
    assert result.residual.max() < 1e-7 and not result.unidentifiable


def test_wheels_of_different_size_and_a_sensor_beside():
    place = (0.07, -0.04, 0.02)
    log = log_of(*winding(), scale_left=1.013, offset=place)
    fitted = values(
        calibrate(
            [log], SYSTEM, ["r", "b", "scale_theta_l", "offset_x", "offset_y", "offset_heading"], DEFAULT
        )
    )
    expected = {"r": TRUE["r"], "b": TRUE["b"], "scale_theta_l": 1.013}
    expected |= dict(zip(("offset_x", "offset_y", "offset_heading"), place, strict=True))
    assert fitted == {name: pytest.approx(value, abs=1e-7) for name, value in expected.items()}


def test_late_poses():
    """To second order."""
    fitted = values(
        calibrate([log_of(*winding(), late=0.04)], SYSTEM, ["r", "delay"], DEFAULT | {"b": TRUE["b"]})
    )
    assert fitted == {"r": pytest.approx(TRUE["r"], rel=1e-5), "delay": pytest.approx(0.04, rel=1e-3)}


def test_end_poses_of_squares_driven_both_ways():
    """UMBmark: three squares each way, only the first and the last pose of each measured;
    dead reckoning is ten times better."""
    side, corner = [PERIOD] * 40, [PERIOD * TRUE["b"]] * round(math.pi / 2 / PERIOD)
    logs = []
    for run in range(6):
        sign = 1.0 if run % 2 else -1.0
        right = np.array(([*side, *(sign * np.array(corner))]) * 4)
        left = np.array(([*side, *(-sign * np.array(corner))]) * 4)
        log = log_of(right, left, noise=0.4, seed=run, scale_left=1.006, start=(0.0, 0.0, 0.0))
        log.pose[1:-1] = math.nan
        logs.append(log)
    result = calibrate(logs, SYSTEM, ["b", "scale_theta_l"], DEFAULT | {"r": TRUE["r"], "b": 0.355})
    for name, value in (("b", TRUE["b"]), ("scale_theta_l", 1.006)):
        assert abs(result.estimates[name].value - value) < 4 * result.estimates[name].sd < 0.02 * value

    def error(b: float, scale: float) -> float:
        """Distance (m) between the reckoned and the true end, at most."""
        worst = 0.0
        for log in logs:
            right, left = np.diff(log.angles, axis=0).T * TRUE["r"]
            true = dict(TRUE)
            TRUE["b"] = b
            try:
                end = of_center(reckoned(right, scale * left, (0.0, 0.0, 0.0)))[-1]
            finally:
                TRUE.update(true)
            worst = max(worst, float(np.hypot(*(end - log.pose[-1])[:2])))
        return worst

    fitted = values(result)
    assert error(fitted["b"], fitted["scale_theta_l"]) < error(0.355, 1.0) / 10


def test_sparse_poses_are_not_compared_with_the_motion_between_them():
    """A circle and a half between two poses: the line between these says nothing about signs."""
    right, left = np.full(120, 0.03), np.full(120, 0.01)
    logs = [
        log_of(*pair, every=120, scale_left=1.004) for pair in ((right, left), (left, right), (right, right))
    ]
    result = calibrate(logs, SYSTEM, ["b", "scale_theta_l"], DEFAULT | {"r": TRUE["r"], "b": 0.355})
    assert values(result) == {
        "b": pytest.approx(TRUE["b"], rel=1e-6),
        "scale_theta_l": pytest.approx(1.004, rel=1e-6),
    }


def test_poses_that_are_wrong_have_little_weight():
    log = log_of(*winding(), noise=1.0, seed=3)
    log.pose[50::40, 0] += 1.0
    result = calibrate([log], SYSTEM, ["r", "b"], DEFAULT)
    for name, each in result.estimates.items():
        assert abs(each.value - TRUE[name]) < 5 * each.sd < 0.03 * TRUE[name]


SENSED = {"scale_left": 1.006, "late": 0.04, "counts": 4096}
FITTED = {"r": TRUE["r"], "b": TRUE["b"], "scale_theta_l": 1.006, "delay": 0.04}


def deviations(count: int, drift: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the fitted numbers, and the halves of their intervals, of logs with encoder counts and late,
    noisy poses in every second row; `drift`: by how much each wheel slips in each row, m, at random.
    """
    errors, within = [], []
    for seed in range(count):
        right, left = winding()
        slip = drift * np.random.default_rng([seed, 1]).normal(size=(2, len(right)))
        log = log_of(right + slip[0], left + slip[1], 1.0, seed, 2, **SENSED)
        log.angles[:] = log_of(right, left, 1.0, seed, 2, **SENSED).angles
        estimates = calibrate([log], SYSTEM, list(FITTED), DEFAULT).estimates
        errors.append([estimates[name].value - value for name, value in FITTED.items()])
        within.append([estimates[name].within for name in FITTED])
    return np.array(errors), np.array(within)


@pytest.mark.parametrize("drift", [0.0, 4e-4])
def test_values_lie_in_their_intervals(drift):
    """Also if the wheels slip by 1 % of their way, which the errors of the poses hide."""
    errors, within = deviations(6, drift)
    assert np.abs(errors / within).max() < 2.0 and 0.2 < (errors / within).std() < 0.9


@pytest.mark.nightly
def test_a_pose_that_two_windows_share_has_one_error():
    """Poses so far apart that each window has two: with errors independent in both,
    deviations would be twice as large."""
    off = []
    for seed in range(16):
        estimates = calibrate([log_of(*winding(200), 1.0, seed, 20)], SYSTEM, ["r", "b"], DEFAULT).estimates
        off.append([(each.value - TRUE[name]) / each.sd for name, each in estimates.items()])
    sizes = np.sqrt(np.mean(np.square(off), axis=0))
    assert (sizes > 0.7).all() and (sizes < 1.6).all()


def bound() -> np.ndarray:
    """Standard deviations of least squares, if the poses are all that is not exact."""
    geometry = _Geometry.of(SYSTEM, ("theta_r", "theta_l"))
    quantities = (*SYSTEM.mechanism.parameters, *geometry.sensors)
    values = np.array([(DEFAULT | FITTED).get(q.name, q.default) for q in quantities])
    log = log_of(*winding(), 0.0, 0, 2, scale_left=SENSED["scale_left"], late=SENSED["late"])
    fit = OutputError(
        geometry.prediction(quantities, list(FITTED)),
        _windows([log], SYSTEM, pose_names(SYSTEM)),
        quantities,
        values,
    )
    expected = fit.expected_deviations(NOISE)
    return np.array([expected[name] for name in FITTED])


@pytest.mark.nightly
def test_values_lie_in_their_intervals_in_most_logs():
    """In 93 to 97 % of 1000 logs, with errors within 1.2 times those of least squares, about windows of which
    each has a pose of its own at first. Were the whole log one window, which drift does not allow, they could
    be 2 to 12 times smaller.
    """
    errors, within = deviations(1000)
    inside, size = np.mean(np.abs(errors) < within, axis=0), np.sqrt(np.mean(errors**2, axis=0))
    print(dict(zip(FITTED, zip(inside, size / bound(), strict=True), strict=True)))
    assert (inside > 0.93).all() and (inside < 0.97).all() and (size < 1.2 * bound()).all()


@pytest.mark.nightly
@pytest.mark.parametrize("drift", [1.5e-4, 4e-4])
def test_drift_is_in_the_intervals(drift):
    """In 91 % or more of 300 logs: 95 less three standard deviations of the count."""
    errors, within = deviations(300, drift)
    inside = np.mean(np.abs(errors) < within, axis=0)
    print(dict(zip(FITTED, inside, strict=True)))
    assert (inside > 0.91).all()


def few_poses(count: int) -> PoseLog:
    log = log_of(*winding(), noise=1.0, seed=5)
    log.pose[np.setdiff1d(np.arange(401), np.linspace(0, 400, count).astype(int))] = math.nan
    return log


def test_poses_that_leave_nothing_are_refused():
    """Two poses, of which the first is fitted too, and three parameters."""
    with pytest.raises(BadInput, match="6 measured numbers for 6 unknown ones"):
        calibrate([few_poses(2)], SYSTEM, ["r", "b", "scale_theta_l"], DEFAULT)
    result = calibrate([few_poses(2)], SYSTEM, ["r", "b"], DEFAULT)
    assert result.remarks == (
        "only 1 number measured beyond the unknowns: standard deviations are rough; measure more poses",
    )
    assert all(abs(each.value - TRUE[name]) < each.within for name, each in result.estimates.items())


def test_parameters_of_sensors_explain_a_log():
    """Angles of motors with a gear, a pose sensor that looks aside, beside the point, and late."""
    log = log_of(*winding(), scale_left=0.02, late=0.04, offset=(0.3, -0.2, math.pi / 2))
    log.angles[:, 0] /= 0.02
    sensors = {"offset_x": 0.3, "offset_y": -0.2, "offset_heading": math.pi / 2, "delay": 0.04}
    gears = {"scale_theta_r": 0.02, "scale_theta_l": 0.02}
    expected = {"r": pytest.approx(TRUE["r"], rel=1e-4), "b": pytest.approx(TRUE["b"], rel=1e-3)}
    assert values(calibrate([log], SYSTEM, ["r", "b"], DEFAULT | sensors | gears)) == expected
    _check_motions(log, SYSTEM, list(gears), DEFAULT | sensors)
    with pytest.raises(BadInput, match="theta_r, theta_l in deg"):
        _check_motions(log, SYSTEM, ["r", "b"], DEFAULT | sensors)


def test_a_direction_of_the_sensor_explains_a_log():
    """On a short arc to the north-east a quarter of a turn looks like the opposite sign of x."""
    log = log_of(
        np.full(60, 0.05), np.full(60, 0.045), offset=(0.0, 0.0, math.pi / 2), start=(0.0, 0.0, math.pi / 4)
    )
    with pytest.raises(BadInput, match="opposite sign of x_c"):
        _check_motions(log, SYSTEM, ["r"], DEFAULT)
    _check_motions(log, SYSTEM, ["r"], DEFAULT | {"offset_heading": math.pi / 2})
    _check_motions(log, SYSTEM, ["r", "offset_heading"], DEFAULT)


def test_what_no_log_and_what_this_log_does_not_tell():
    fitted = ["r", "scale_theta_r", "scale_theta_l", "m_c", "offset_x", "d"]
    with pytest.raises(BadInput, match="contradicts the robot's motion|explain this log"):
        calibrate([log_of(*winding())], SYSTEM, fitted, DEFAULT)  # with the track of another robot
    result = calibrate([log_of(*winding())], SYSTEM, fitted, DEFAULT | {"b": TRUE["b"]})
    assert not {"r", "scale_theta_r", "scale_theta_l", "m_c", "offset_x", "d"} & set(result.estimates) - {
        "scale_theta_l"
    }
    reasons = " | ".join(result.unidentifiable)
    assert (
        "m_c: no motion depends on it" in reasons
        and "offset_x, d: any motion shows only offset_x + 1 d" in reasons
    )
    straight = np.full(200, 0.03)
    result = calibrate([log_of(straight, straight)], SYSTEM, ["r", "b"], DEFAULT)
    assert list(result.estimates) == ["r"] and result.unidentifiable[0].startswith(
        "b: this log does not show it"
    )


@pytest.mark.parametrize(
    "spec, robot, fitted",
    [
        ("robots/car", "car", {"r": 0.3, "l": 2.6}),
        ("robots/four_wheel", "four_wheel", {"r": 0.2, "l_f": 0.5, "l_r": 0.7, "b": 0.4}),
    ],
)
def test_other_robots(spec, robot, fitted, tmp_path, capsys):
    """From the CSV of `noslip simulate`; what remains is that angles are taken as linear between rows."""
    file = Path(__file__).resolve().parents[2] / "examples/specs" / f"{spec}.toml"
    rows = simulate(read_spec(str(file)), "c").csv()
    (tmp_path / "run.csv").write_text(rows)
    assert main(["calibrate", str(tmp_path / "run.csv"), "--robot", robot, "--json", "--fit", *fitted]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert {name: printed["parameters"][name]["value"] for name in fitted} == {
        name: pytest.approx(value, rel=5e-3) for name, value in fitted.items()
    }


@pytest.fixture
def write(tmp_path):
    def write(log: PoseLog, **changed) -> str:
        head = ["t", *log.names, "x_c", "y_c", "phi"]
        rows = [
            [repr(float(e)) if e == e else "" for e in row]
            for row in np.column_stack([log.t, log.angles, log.pose])
        ]
        table = {name: [row[k] for row in rows] for k, name in enumerate(head)} | changed
        with (tmp_path / "log.csv").open("w", newline="") as stream:
            csv.writer(stream).writerows([list(table), *zip(*table.values(), strict=True)])
        return str(tmp_path / "log.csv")

    return write


def test_the_command(write, capsys):
    """Angles within one turn, as some encoders report them; poses in one row of five."""
    log = log_of(*winding(), every=5)
    wrapped = [repr(math.remainder(each, 2 * math.pi)) for each in log.angles[:, 0]]
    file = write(log, theta_r=wrapped)
    assert main(["calibrate", file, "--robot", "labmate", "--fit", "r", "b", "--set", "d=0.3"]) == 0
    printed = capsys.readouterr().out
    assert "in a SPEC: parameters = { r = 0.152, b = 0.361 }" in printed.replace("0.36099999", "0.361")
    assert "it is continued over the turns" in printed


BAD = {
    "no pose": ({"x_c": None}, [], "column 'x_c' is missing"),
    "no angle": ({"theta_r": None, "theta_l": None}, [], "no column with an angle"),
    "one angle": ({"theta_l": None}, [], "theta_r alone cannot tell"),
    "empty": ({"x_c": "", "y_c": "", "phi": ""}, [], "has no heading"),
    "heading alone": ({"x_c": ""}, [], "shows only b - 5 r: choose what to fit"),
    "text": ({"phi": "north"}, [], "column 'phi' row 2: 'north' is not a number"),
    "parameter": ({}, ["--fit", "radius"], "not a parameter of this robot"),
    "mass": ({}, ["--fit", "m_c"], "does not depend on m_c"),
    "sign": ({}, ["--set", "r=-0.1"], "must be positive"),
    "no heading": ({"phi": ""}, ["--fit", "r", "b"], "has no heading, phi"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input(case, write, bad_input):
    changed, options, message = BAD[case]
    log = log_of(*winding(40))
    rows = {name: [value] * len(log.t) for name, value in changed.items() if value is not None}
    file = Path(write(log, **rows))
    left = [name for name, value in changed.items() if value is None]
    table = list(csv.reader(file.open(encoding="utf-8")))
    keep = [k for k, name in enumerate(table[0]) if name not in left]
    with file.open("w", encoding="utf-8", newline="") as stream:
        csv.writer(stream).writerows([[row[k] for k in keep] for row in table])
    assert message in bad_input(["calibrate", str(file), "--robot", "labmate", *options])


def test_robots_without_a_pose_or_wheels(tmp_path, bad_input):
    (tmp_path / "log.csv").write_text("t,x,y,phi,theta\n0,0,0,0,0\n1,1,0,0,1\n")
    for robot, message in (
        ("geared_arm", "a pose of three coordinates"),
        ("knife_edge", "has none"),
        ("rolling_disk", "theta alone"),
    ):
        assert message in bad_input(["calibrate", str(tmp_path / "log.csv"), "--robot", robot])
