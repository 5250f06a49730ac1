"""The generated extended Kalman filter: beside one in 50 digits, its statistics, missed,
late and wrong measurements."""

import json
import math
import re
from pathlib import Path

import mpmath as mp
import noslip
import numpy as np
import pytest
from noslip.cli.main import main
from noslip.codegen.ekf.filter import _FilterBuilder
from noslip.codegen.files import filter_program, filter_text
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot, system_of
from noslip.simulation.closed_loop import simulate
from noslip.simulation.controllers.estimation.ekf import Filter, FilterOptions
from noslip.simulation.specification.spec import read_spec
from scipy.stats import chi2

from ..reference.ekf_reference import Reference

OPTIONS = {
    "noise": (0.01, 0.02), "start": (1.0, -2.0, 0.5), "start_sd": (0.02, 0.03, 0.01),
    "gyro_noise": 1e-3, "bias_sd": 0.01, "bias_walk": 1e-4,
}  # fmt: skip
SCALED = {"thetadot_r": 0.01, "thetadot_l": 0.02, "b": 0.03}
DT = 0.01
ROOT = Path(noslip.__file__).parent
DOCUMENT, SPEC = ROOT / "docs/estimator.md", ROOT / "examples/specs/figures/figure_14.toml"
KINDS = ("pose", "position", "heading", "range")


def labmate():
    return system_of(find_robot("labmate"))


def parameters(**changed) -> list[float]:
    return [changed.get(p.name, p.default) for p in labmate().mechanism.parameters]


def sizes() -> dict[str, float]:
    return {p.name: p.default for p in labmate().mechanism.parameters if p.name in "rbd"}


def make(scalar: str = "double", **changed) -> Filter:
    return Filter(labmate(), parameters(), FilterOptions(**{**OPTIONS, **changed}), scalar)


@pytest.mark.parametrize(
    "scaled, scalar, tolerance",
    [({}, "float", 2e-4), (SCALED, "double", 1e-12), ({}, "double", 1e-12), (SCALED, "float", 2e-4)],
    ids=["pose-float", "scales-double", "pose-double", "scales-float"],
)
def test_each_step_is_that_of_a_filter_in_50_digits(scaled, scalar, tolerance):
    """States, relative to their standard deviations, and the covariance, relative to its diagonal."""
    with mp.workdps(50):
        ours, truth = (
            make(scalar, scale_sd=scaled, gate=1e6),
            Reference(**sizes(), **OPTIONS, scale_sd=scaled),
        )
        random = np.random.default_rng(20)
        for k in range(8):
            turned = np.float32(random.normal(0.2, 0.3, 2)).astype(float)
            gyro = None if k % 5 == 3 else float(np.float32(random.normal(0.1, 0.5)))
            truth.tick(turned, float(np.float32(DT)), gyro)
            assert ours.tick(turned, float(np.float32(DT)), gyro) == "ok"
            _compare(ours, truth, tolerance)
            if k % 2:
                kind, fix = KINDS[k // 2 % 4], _fix(truth, KINDS[k // 2 % 4], random)
                nis = truth.correct(kind, **fix)
                assert ours.correct(kind, **fix) == "ok" and ours.nis == pytest.approx(
                    float(nis), rel=1000 * tolerance
                )
                _compare(ours, truth, tolerance)


def _fix(truth: Reference, kind: str, random: np.random.Generator) -> dict[str, float]:
    """A measurement about where the sensor is, in numbers that float has too."""
    x, y, heading = (float(v) for v in truth.x[:3])
    fix = {"ahead": 0.25, "left": -0.5, "sd": 0.0625, "heading_sd": 0.03125}
    place = np.array([x, y]) + np.array(
        [[math.cos(heading), -math.sin(heading)], [math.sin(heading), math.cos(heading)]]
    ) @ (
        0.25,
        -0.5,
    )
    error = random.normal(0, 0.05, 3)
    if kind == "range":
        fix |= {"x": x + 3, "y": y + 4}
        fix["range"] = math.hypot(*(np.float32([fix["x"], fix["y"]]).astype(float) - place)) + error[0]
    if kind in ("pose", "position"):
        fix |= {"x": place[0] + error[0], "y": place[1] + error[1]}
    if kind in ("pose", "heading"):
        fix["heading"] = heading + error[2]
    return {name: float(np.float32(value)) for name, value in fix.items()}


def _compare(ours: Filter, truth: Reference, tolerance: float) -> None:
    P = np.array(truth.P.tolist(), float)
    sd = np.sqrt(np.diag(P))
    assert np.abs(ours.state - np.array([float(v) for v in truth.x])).max() <= tolerance * 10
    assert (np.abs(ours.covariance - P) / np.outer(sd, sd)).max() <= tolerance * 100


@pytest.mark.parametrize("robot", ["car", "tricycle"])
def test_steered_vehicles(robot):
    """By hand, with c = cos delta: the rear axle rolls r theta (car) or r theta c (tricycle), and the body
    turns r theta tan(delta)/l or r theta sin(delta)/l. Poses show the wheel's true radius, 2 % smaller.
    """
    system = system_of(find_robot(robot))
    sizes = {p.name: p.default for p in system.mechanism.parameters}
    options = FilterOptions(noise=(1e-3, 1e-3), start_sd=(0.02, 0.02, 0.01), scale_sd={"thetadot": 0.03})
    ours = Filter(system, list(sizes.values()), options)
    x = y = heading = 0.0
    for k in range(400):
        delta, theta = 0.5 * math.sin(0.05 * k), 0.05
        rolled = 0.98 * sizes["r"] * theta
        forward = rolled * (math.cos(delta) if robot == "tricycle" else 1.0)
        turn = forward * math.tan(delta) / sizes["l"]
        x, y = x + forward * math.cos(heading + turn / 2), y + forward * math.sin(heading + turn / 2)
        heading += turn
        assert ours.tick((theta, 0.0), DT, measured=(delta,)) == "ok"
        if k % 20 == 19:
            assert ours.correct("pose", x=x, y=y, heading=heading, sd=1e-3, heading_sd=1e-3) == "ok"
    assert (
        ours.state[4] == pytest.approx(0.98, abs=4 * math.sqrt(ours.covariance[4, 4]))
        and abs(ours.state[4] - 0.98) < 1e-3
    )
    assert ours.pose == pytest.approx([x, y, heading], abs=1e-3)


# -- statistics ----------------------------------------------------------------------------------------------


class Drive:
    """A truth that the filter's model describes: errors of wheels and gyro,
    bias and scales are drawn from their deviations."""

    def __init__(self, seed: int, scaled: dict[str, float]):
        self.random, self.scaled = np.random.default_rng(seed), scaled
        start = np.array(OPTIONS["start"]) + self.random.normal(0, OPTIONS["start_sd"])
        scales = [1 + self.random.normal(0, sd) for sd in scaled.values()]
        self.x = np.array([*start, self.random.normal(0, OPTIONS["bias_sd"]), *scales])
        self.by = dict.fromkeys(SCALED, 1.0) | dict(zip(scaled, scales, strict=True))
        self.sizes = sizes()

    def tick(self, k: int) -> tuple[np.ndarray, float]:
        """Move along a winding path; return what the sensors tell."""
        turned = np.array([0.2 + 0.1 * math.sin(k / 15), 0.18 - 0.1 * math.sin(k / 25)])
        true = turned + np.array(OPTIONS["noise"]) * np.sqrt(np.abs(turned)) * self.random.normal(size=2)
        r, b, d = self.sizes["r"], self.sizes["b"] * self.by["b"], self.sizes["d"]
        right, left = r * self.by["thetadot_r"] * true[0], r * self.by["thetadot_l"] * true[1]
        distance, turn = (right + left) / 2, (right - left) / (2 * b)
        middle = self.x[2] + turn / 2
        self.x[0] += distance * math.cos(middle) - d * turn * math.sin(middle)
        self.x[1] += distance * math.sin(middle) + d * turn * math.cos(middle)
        self.x[2] += turn
        gyro = turn / DT + self.x[3] + OPTIONS["gyro_noise"] / math.sqrt(DT) * self.random.normal()
        self.x[3] += OPTIONS["bias_walk"] * math.sqrt(DT) * self.random.normal()
        return turned, gyro

    def fix(self, past: np.ndarray | None = None) -> dict[str, float]:
        """A measured pose of the vehicle, now or where it was."""
        x, y, heading = (self.x if past is None else past)[:3] + self.random.normal(0, (0.05, 0.05, 0.02))
        return {"x": x, "y": y, "heading": heading, "sd": 0.05, "heading_sd": 0.02}


def statistics(
    runs: int, scaled: dict[str, float], scalar: str, age: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """NIS of each measurement and NEES of each end, of runs with a pose every 20 ticks, `age` ticks late."""
    nis, nees = [], []
    for seed in range(runs):
        drive, ours, past = (
            Drive(seed, scaled),
            make(scalar, scale_sd=scaled, gate=1e6, memory=max(age, 1)),
            [],
        )
        for k in range(100):
            turned, gyro = drive.tick(k)
            assert ours.tick(turned, DT, gyro) == "ok"
            past.append(drive.x.copy())
            if k % 20 == 19:
                assert ours.correct("pose", **drive.fix(past[-1 - age]), age=age * DT) == "ok"
                nis.append(ours.nis)
        error = ours.state - drive.x
        nees.append(error @ np.linalg.solve(ours.covariance, error))
    return np.array(nis), np.array(nees)


def holds(values: np.ndarray, degrees: int) -> bool:
    """Whether the mean of independent values is within the 99.9 % bounds of chi-square with so many degrees
    of freedom."""
    least, most = chi2.ppf([0.0005, 0.9995], degrees * len(values)) / len(values)
    return least < values.mean() < most


def _consistent(runs: int, scaled: dict[str, float], scalar: str) -> None:
    nis, nees = statistics(runs, scaled, scalar)
    assert holds(nis, 3) and holds(nees, 4 + len(scaled)), (nis.mean(), nees.mean())


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_innovations_and_errors_are_as_large_as_the_filter_says(scalar):
    _consistent(60, SCALED, scalar)


@pytest.mark.nightly
@pytest.mark.parametrize("scaled", [{}, SCALED], ids=["pose", "scales"])
@pytest.mark.parametrize("scalar", ["double", "float"])
def test_a_thousand_runs_are_as_the_filter_says(scalar, scaled):
    _consistent(1000, scaled, scalar)


def test_a_filter_that_is_too_sure_is_found_by_these_statistics(monkeypatch):
    """One that is told half the standard deviations of the start."""
    told = OPTIONS["start_sd"]
    monkeypatch.setitem(OPTIONS, "start_sd", tuple(2 * each for each in told))
    drives = [Drive(seed, {}) for seed in range(20)]
    monkeypatch.setitem(OPTIONS, "start_sd", told)
    nees = []
    for drive in drives:
        ours = make()
        error = ours.state - drive.x
        nees.append(error @ np.linalg.solve(ours.covariance, error))
    assert not holds(np.array(nees), 4)


# -- measurements that are missed, late, wrong ---------------------------------------------------------------


def test_a_missed_pose_leaves_a_larger_covariance_and_the_next_one_a_small_error():
    ends = []
    for missed in ((), range(40, 200)):
        drive, ours = Drive(3, {}), make()
        for k in range(220):
            turned, gyro = drive.tick(k)
            ours.tick(turned, DT, gyro)
            if k % 20 == 19 and k not in missed:
                assert ours.correct("pose", **drive.fix()) == "ok"
            if k == 198:
                ends.append(math.sqrt(np.trace(ours.covariance[:2, :2])))
        assert np.linalg.norm(ours.pose[:2] - drive.x[:2]) < 4 * math.sqrt(np.trace(ours.covariance[:2, :2]))
    assert ends[1] > 1.5 * ends[0]


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_a_late_pose_is_used_at_its_time(scalar):
    """Compared with a filter that gets each pose in time; one that takes it for a new one is off by what was
    driven since."""
    drive, past, filters = Drive(5, {}), [], [make(scalar, memory=30) for _ in range(3)]
    worst = np.zeros(3)
    for k in range(400):
        turned, gyro = drive.tick(k)
        past.append(drive.x.copy())
        for ours in filters:
            ours.tick(turned, DT, gyro)
        if k % 40 == 9:
            fix = drive.fix()
            assert filters[0].correct("pose", **fix) == "ok"
        if k % 40 == 34:  # a quarter of a second late: 0.7 m
            assert filters[1].correct("pose", **fix, age=25 * DT) == "ok"
            filters[2].correct("pose", **fix)
        if k > 100 and k % 40 == 35:
            worst = np.maximum(
                worst, [np.linalg.norm(ours.pose[:2] - filters[0].pose[:2]) for ours in filters]
            )
    assert worst[1] < 0.01 and worst[2] > 0.05, worst
    sd = [np.sqrt(np.diag(ours.covariance)) for ours in filters[:2]]
    assert np.all(sd[1] > 0.97 * sd[0]) and np.all(sd[1] < 1.1 * sd[0])  # the bias over the age is neglected


def test_late_poses_are_as_the_filter_says_or_better():
    """Innovations and errors are not larger than chi-square allows, and not much smaller."""
    nis, nees = statistics(60, {}, "double", age=10)
    assert nis.mean() < chi2.ppf(0.9995, 3 * len(nis)) / len(nis) and 0.8 < nis.mean() / 3
    assert nees.mean() < chi2.ppf(0.9995, 4 * len(nees)) / len(nees) and 0.8 < nees.mean() / 4


def test_a_pose_that_is_too_old_is_refused():
    ours = make(memory=5)
    for _ in range(9):
        ours.tick((0.2, 0.2), DT, 0.0)
    fix = {"x": 0.0, "y": 0.0, "heading": 0.0, "sd": 0.05, "heading_sd": 0.02}
    assert ours.correct("pose", **fix, age=5.5 * DT) == "bad_parameter"
    assert make().correct("pose", **fix, age=DT) == "bad_parameter"
    assert (
        make(gate=1e6).correct("pose", **fix) == "ok"
        and ours.correct("pose", **fix, age=4.5 * DT) == "rejected"
    )


def test_a_late_pose_after_many_turns_is_refused():
    """In float an angle is known to 1e-3 rad at 8192 rad: what was driven before cannot be turned by that."""
    ours = make("float", memory=5, gate=1e6)
    for _ in range(5):
        ours.tick((0.2, 0.2), DT, 0.0)
    state, factors = ours.state, ours.self.filter.factors
    fix = {"x": state[0], "y": state[1], "heading": state[2], "sd": 0.05, "heading_sd": 0.02}
    ours.place([*state[:2], state[2] + 8300.0, *state[3:]], list(factors))
    before = ours.state
    assert ours.correct("position", **fix, age=2 * DT) == "range" and np.array_equal(ours.state, before)


def test_what_was_driven_before_a_late_pose_turns_with_the_heading():
    """Straight ahead at 0.5 rad; the heading then becomes 0.8 rad:
    a late position lies behind in that direction."""
    ours = make(memory=5, gate=1e6)
    for _ in range(5):
        ours.tick((0.2, 0.2), DT, 0.0)
    state, factors = ours.state, list(ours.self.filter.factors)
    ours.place([*state[:2], state[2] + 0.3, *state[3:]], factors)
    before, driven = ours.state, 0.2 * sizes()["r"] * 2.5
    x, y = before[0] - driven * math.cos(0.8), before[1] - driven * math.sin(0.8)
    fix = {"x": x, "y": y, "heading": 0.0, "sd": 0.01, "heading_sd": 0.02}
    assert ours.correct("position", **fix, age=2.5 * DT) == "ok"
    assert np.abs(ours.state - before).max() < 1e-10
    ours.correct("position", **{**fix, "x": x + 0.001}, age=2.5 * DT)
    assert np.abs(ours.state - before).max() > 1e-4


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_pose_and_covariance_are_those_of_the_filter(scalar):
    """What noslip_ekf_pose returns; zeros before init."""
    ours = make(scalar)
    ours.tick((0.2, 0.1), DT, 0.3)
    c, pose, covariance = (
        ours.c,
        ours.c.new("noslip_pose", [9.0, 9.0, 9.0]),
        ours.c.ffi.new(f"{ours.c.scalar.real}[9]", [9.0] * 9),
    )
    assert (
        c.status(c.function("noslip_ekf_pose")(c.ffi.addressof(ours.self, "filter"), pose, covariance))
        == "ok"
    )
    assert [pose.x, pose.y, pose.heading] == ours.pose.tolist()
    expected = ours.covariance[:3, :3]
    assert (
        np.abs(np.reshape(list(covariance), (3, 3)) - expected).max()
        < (1e-5 if scalar == "float" else 1e-14) * expected.max()
    )
    fresh = c.new(f"{c.robot}_ekf")
    assert (
        c.status(c.function("noslip_ekf_pose")(c.ffi.addressof(fresh, "filter"), pose, covariance))
        == "not_ready"
    )
    assert pose.x == pose.y == pose.heading == 0 and list(covariance) == [0.0] * 9


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_a_wrong_pose_is_rejected_and_many_are_told(scalar):
    """50 m off: not used; after `tolerated` in a row the filter says that it diverged,
    until a measurement fits or a reset."""
    drive, ours = Drive(7, {}), make(scalar, tolerated=2)
    for k in range(50):
        turned, gyro = drive.tick(k)
        ours.tick(turned, DT, gyro)
    before, wrong = ours.state, drive.fix()
    wrong["x"] += 50
    assert (
        ours.correct("pose", **wrong) == "rejected" and ours.nis > 1e4 and np.array_equal(ours.state, before)
    )
    assert ours.tick((0.2, 0.2), DT, 0.0) == "ok" and ours.correct("pose", **wrong) == "rejected"
    assert ours.correct("pose", **wrong) == ours.tick((0.2, 0.2), DT, 0.0) == "diverged"
    assert ours.pose[0] > before[0]  # it moves on
    assert ours.correct("position", **(drive.fix() | {"x": ours.pose[0], "y": ours.pose[1]})) == "ok"
    assert ours.tick((0.2, 0.2), DT, 0.0) == "ok"
    for _ in range(3):
        ours.correct("pose", **wrong)
    assert ours.reset((50, 0, 0), (1, 1, 1)) == ours.tick((0, 0), DT, 0.0) == "ok"
    assert ours.pose == pytest.approx([50, 0, 0], abs=1e-3) and np.diag(ours.covariance)[:2] == pytest.approx(
        [1, 1]
    )


def test_whole_turns_of_a_heading_do_not_matter():
    filters = make(), make()
    for k, ours in enumerate(filters):
        fix = {"heading": 0.51 + 2 * math.pi * 7 * k, "heading_sd": 0.1}
        assert ours.correct("heading", **fix) == "ok"
    assert filters[0].state == pytest.approx(filters[1].state, abs=1e-14)
    ours = make(start=(1, 2, 40.0))
    covariance = ours.covariance
    assert ours.unwind() == "ok" and ours.pose == pytest.approx([1, 2, 40 - 12 * math.pi], abs=1e-13)
    assert np.array_equal(ours.covariance, covariance)


# -- bad input -----------------------------------------------------------------------------------------------

REFUSED = {
    "noise of a wheel": {"noise": (0.0, 0.01)},
    "noise that is NaN": {"noise": (0.01, math.nan)},
    "gyro noise": {"gyro_noise": -1e-3},
    "gyro noise too small": {"gyro_noise": 1e-9},
    "bias": {"bias_sd": 0.0},
    "walk": {"bias_walk": -1.0},
    "start": {"start_sd": (0.1, 0.1, 0.0)},
    "infinite start": {"start_sd": (math.inf, 0.1, 0.1)},
    "gate": {"gate": -1.0},
    "tolerated": {"tolerated": -1},
    "scale": {"scale_sd": {"b": 0.0}},
}


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_init_refuses(scalar):
    for name, changed in REFUSED.items():
        with pytest.raises(BadInput, match="bad_parameter"):
            make(scalar, **changed)
            pytest.fail(name)
    with pytest.raises(BadInput, match="range"):
        make(scalar, start=(0, 0, 2e6))
    with pytest.raises(BadInput, match="nonfinite"):
        make(scalar, start=(math.nan, 0, 0))
    without = make(scalar, gyro_noise=0.0, bias_sd=0.0)
    assert without.tick((0.1, 0.1), DT) == "ok" and without.tick((0.1, 0.1), DT, 0.0) == "bad_parameter"


WRONG = {
    "no angle": (((math.nan, 0.1), DT, 0.0), "nonfinite"),
    "no rate": (((0.1, 0.1), DT, math.inf), "nonfinite"),
    "no time": (((0.1, 0.1), math.nan, 0.0), "nonfinite"),
    "back": (((0.1, 0.1), -DT, 0.0), "bad_parameter"),
    "at once": (((0.1, 0.1), 0.0, 0.0), "bad_parameter"),
    "too far": (((1e30, -1e30), DT, None), "range"),
}


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_a_tick_that_is_refused_changes_nothing(scalar):
    ours = make(scalar, memory=4)
    ours.tick((0.2, 0.1), DT, 0.1)
    before = bytes(ours.c.ffi.buffer(ours.self))
    for name, (arguments, status) in WRONG.items():
        assert ours.tick(*arguments) == status and bytes(ours.c.ffi.buffer(ours.self)) == before, name
    fix = {"x": 0.0, "y": 0.0, "heading": 0.0, "range": 1.0, "sd": 0.05, "heading_sd": 0.02}
    wrong = {
        "x": math.nan,
        "y": math.inf,
        "heading": math.nan,
        "sd": 0.0,
        "heading_sd": -1.0,
        "ahead": math.inf,
        "age": -1.0,
    }
    for name, value in wrong.items():
        assert ours.correct("pose", **(fix | {name: value})) in ("bad_parameter", "nonfinite"), name
    assert ours.correct("range", **(fix | {"range": -1.0})) == "bad_parameter"
    assert ours.correct("range", **(fix | {"x": ours.pose[0], "y": ours.pose[1]})) == "singular"
    assert ours.correct("heading", **(fix | {"heading": 3e6})) == "range"
    assert bytes(ours.c.ffi.buffer(ours.self)) == before


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_any_bits_in_finite_numbers_out(scalar):
    """Arbitrary bits as measurements: the estimate stays finite, D positive."""
    random = np.random.default_rng(3)
    size, kind = (4, np.float32) if scalar == "float" else (8, np.float64)

    def number(plain: float) -> float:
        if random.integers(4):
            return plain * random.normal()
        return float(np.frombuffer(random.bytes(size), kind)[0])

    ours, seen = make(scalar, memory=5, gate=1e30), set()
    for _ in range(400):
        seen.add(
            ours.tick(
                [number(0.2), number(0.2)], abs(number(DT)), number(1.0) if random.integers(2) else None
            )
        )
        fields = {
            "x": 1.0,
            "y": 1.0,
            "heading": 1.0,
            "range": 3.0,
            "sd": 0.1,
            "heading_sd": 0.1,
            "ahead": 0.3,
            "left": 0.3,
            "age": 0.02,
        }
        seen.add(
            ours.correct(KINDS[random.integers(4)], **{name: number(value) for name, value in fields.items()})
        )
        if abs(ours.pose[2]) > 10:
            assert ours.unwind() == "ok"
        _, D = ours.factors
        assert np.isfinite(ours.state).all() and np.isfinite(ours.covariance).all() and D.min() > 0
    assert {"ok", "bad_parameter", "nonfinite", "range"} <= seen


def test_float_keeps_the_covariance_positive():
    """Corrections with a variance 1e14 times smaller than that at first, which leave one direction unseen."""
    ours = make("float", start_sd=(1e3, 1e3, 3.0), gate=1e6)
    for k in range(2000):
        ours.tick((0.2, 0.2), DT, 0.0)
        assert (
            ours.correct(
                "range",
                x=100.0,
                y=1e-3 * k,
                range=float(np.hypot(100 - ours.pose[0], 1e-3 * k - ours.pose[1])),
                sd=1e-4,
            )
            == "ok"
        )
    _, D = ours.factors
    assert D.min() > 0 and np.linalg.eigvalsh(ours.covariance).min() > 0


# -- in a run, and at the command line -----------------------------------------------------------------------


def _simulated(tmp_path, estimator: str):
    text = SPEC.read_text().replace("mean = [5.0, 0.5], sd = 3.0", "mean = [0.1, 0.05], sd = 0.5")
    (tmp_path / "spec.toml").write_text(f"{text.replace('duration = 12.0', 'duration = 6.0')}\n{estimator}")
    return simulate(read_spec(tmp_path / "spec.toml"))


def test_the_controller_is_given_the_estimated_pose(tmp_path):
    """With the section of docs/estimator.md the pose seen stays near the true one;
    by dead reckoning it does not."""
    (documented,) = re.findall(
        r"tests/codegen/test_ekf.py -->\n```toml\n(.*?)^```", DOCUMENT.read_text(), re.S | re.M
    )
    runs = (_simulated(tmp_path, documented), _simulated(tmp_path, ""))
    off = [float(np.hypot(*(run.seen - run.x)[-1, :2])) for run in runs]
    assert off[0] < 0.2 and off[1] > 2 * off[0], off


BAD = {
    "nothing": ("[estimator]", "noise"),
    "with a correction": (
        "[correction]\nrate = 1.0\n[estimator]\nnoise = 0.1",
        "does not go with [correction]",
    ),
    "noise of three wheels": ("[estimator]\nnoise = [0.1, 0.1, 0.1]", "it must have 1 or 2"),
    "start": ("[estimator]\nnoise = 0.1\nstart_sd = [0.1]", "it must be [x, y, heading]"),
    "scale of a mass": ("[estimator]\nnoise = 0.1\nscales = { m_c = 0.1 }", "cannot be scaled"),
    "noise too small": ("[estimator]\nnoise = 1e-9", "1e-6 to 1e6"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_section_is_refused(tmp_path, name):
    section, message = BAD[name]
    with pytest.raises(BadInput) as error:
        _simulated(tmp_path, section)
    assert message in str(error.value) and "\n" not in str(error.value)


ASKED = {
    "a mass": (["labmate", "--output", "ekf", "--scale", "m_c"], "b, d, r, thetadot_r, thetadot_l can"),
    "too much": (
        ["labmate", "--output", "ekf", "--scale", "r", "--scale", "thetadot_r", "--scale", "thetadot_l"],
        "leave one out",
    ),
    "twice": (["labmate", "--output", "ekf", "--scale", "r", "--scale", "r"], "twice"),
    "without the filter": (["labmate", "--output", "type_i", "--scale", "r"], "--output ekf"),
    "no vehicle": (["ball_plate", "--output", "ekf"], "moves_in_plane"),
}


@pytest.mark.parametrize("name", ASKED)
def test_generate_refuses(tmp_path, capsys, name):
    arguments, message = ASKED[name]
    assert main(["generate", *arguments, "-o", str(tmp_path)]) == 2
    assert message in capsys.readouterr().err and not list(tmp_path.iterdir())


# -- compared with the model before it is written ------------------------------------------------------------


def _wrong_coupling(self, U, moved, by_others, original=_FilterBuilder._propagate):
    """Position turns with the heading, but by too much."""
    original(self, U, 1.001 * moved, by_others)


def _no_walk(self, name, U, D, vector, c, original=_FilterBuilder._add):
    original(self, name, U, D, vector, 0 * c if name == "walk" else c)


def _wrong_share(self, name, U, D, h, r, inverse, original=_FilterBuilder._measure):
    alpha, inverse, gain = original(self, name, U, D, h, r, inverse)
    return alpha, inverse, [1.001 * each for each in gain] if name == "wheels" else gain


DEFECTS = {
    "coupling": (_wrong_coupling, "_propagate", "variance of x by gyro"),
    "walk": (_no_walk, "_add", "variance of bias by gyro"),
    "share": (_wrong_share, "_measure", "x by gyro"),
}


@pytest.mark.parametrize("name", DEFECTS)
def test_a_filter_that_is_not_the_model_is_not_written(name, tmp_path, monkeypatch, capsys):
    wrong, place, quantity = DEFECTS[name]
    monkeypatch.setenv("NOSLIP_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(_FilterBuilder, place, wrong)
    for cached in (filter_text, filter_program):
        cached.cache_clear()
    folder = tmp_path / "made"
    try:
        code = main(
            [
                "generate",
                "labmate",
                "--output",
                "ekf",
                "--scale",
                "b",
                "--scalar",
                "double",
                "-o",
                str(folder),
            ]
        )
    finally:
        for cached in (filter_text, filter_program):
            cached.cache_clear()
    err = capsys.readouterr().err
    assert code == 1 and not folder.exists() and "nothing is written" in err
    assert (
        err.startswith(f"noslip: labmate, ekf, double: {quantity} differs: the C gives ")
        and "the model gives " in err
    )
    assert "sensed thetadot_r = " in err


def test_what_a_tick_costs():
    """On a Cortex-M4F in float, as the guarantees counted: 600 instructions without a pose,
    512 bytes of stack."""
    numbers = json.loads((ROOT / "checks/guarantees/budget.json").read_text())["cortex-m4f"]["modules"]
    assert max(numbers["noslip_ekf_f"][f"most {kind}"] for kind in ("gyro", "wheels")) <= 600
    stack = {name: size for name, size in numbers["runtime_f"].items() if "_ekf_" in name}
    assert len(stack) > 10 and max(stack.values()) <= 512
