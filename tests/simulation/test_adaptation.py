"""Learning parameters that change: beside recursive least squares in numpy, in runs with another mass,
and bad input."""

import csv
import math
import re
from dataclasses import replace
from itertools import product
from pathlib import Path

import noslip
import numpy as np
import pyarrow.parquet as pq
import pytest
from noslip.cli.main import main
from noslip.codegen.files import shared_files
from noslip.codegen.runtime import runtime_files
from noslip.readers.errors import BadInput
from noslip.readers.printing import toml
from noslip.readers.robots import find_robot, system_of
from noslip.simulation.closed_loop import as_json, simulate, summary
from noslip.simulation.controllers.estimation import adaptation
from noslip.simulation.controllers.estimation.adaptation import Adaptation, AdaptationOptions
from noslip.simulation.controllers.runtime import runtime
from noslip.simulation.plot import draw
from noslip.simulation.specification.spec import spec_of_table, toml_table
from noslip.simulation.specification.vary import read_varied
from noslip.simulation.sweeping.batch import Batch
from noslip.simulation.sweeping.runner import Processes, engine_of, run_table
from noslip.simulation.sweeping.simulated import Simulated
from noslip.simulation.sweeping.study import study_of

HEADER, DOCUMENT = "noslip_adaptation.h", Path(noslip.__file__).parent / "docs/identify.md"
OPTIONS = {"sd": 0.3, "noise": 0.4, "dead_zone": 0.02, "forgetting": 2.0, "window": 0.05, "rate": 0.5}
SPEC = {
    "robot": "labmate",
    "plant": {"m_c": 80.0, "I_c": 13.0},
    "gains": {"kp": 1.0, "kd": 2.5, "kv": 2.0},
    "output": {"type": "IV", "L": 0.1, "path": {"kind": "circle", "x_f": 0.0, "y_f": 0.0, "R": 3.0}},
    "reference": {"speed": 1.0},
    "initial": {"point": [3.4, 0.0], "heading": 1.3, "speed": 0.2},
    "simulation": {"duration": 10.0, "period": 0.01, "backend": "c"},
}
BOTH = {"m_c": [30.0, 100.0], "I_c": [5.0, 20.0]}


class Core:
    """The C without a robot."""

    def __init__(self, start, rows: int, scalar: str = "double", **changed):
        self.c, self.scalar = runtime(HEADER), scalar
        self.self = self.c.new("noslip_adaptation", scalar)
        options = self.c.new("noslip_adaptation_options", scalar, {**OPTIONS, **changed})
        self.status = self._call("init", options, self.c.array(scalar, start), len(start), rows)

    def _call(self, name: str, *arguments) -> str:
        return self.c.status(self.c.function(f"noslip_adaptation_{name}", self.scalar)(self.self, *arguments))

    def step(self, regressor, target, dt: float) -> str:
        return self._call(
            "step", self.c.array(self.scalar, np.ravel(regressor)), self.c.array(self.scalar, target), dt
        )

    @property
    def variance(self) -> np.ndarray:
        factors = self.c.function("noslip_factors_variance", self.scalar)
        return np.array([factors(self.self.factors, self.self.count, k) for k in range(self.self.count)])


class Reference:
    """The same with the full covariance."""

    def __init__(self, start, rows: int):
        self.estimate = np.array(start, float)
        self.used = self.estimate.copy()
        self.P = OPTIONS["sd"] ** 2 * np.eye(len(start))
        self.Y, self.y = np.zeros((rows, len(start))), np.zeros(rows)

    def step(self, regressor, target, dt: float) -> None:
        keeps = OPTIONS["window"] / (OPTIONS["window"] + dt)
        self.Y, self.y = keeps * self.Y + (1 - keeps) * regressor, keeps * self.y + (1 - keeps) * target
        if np.abs(self.y - self.Y @ self.estimate).max() > OPTIONS["dead_zone"]:
            older = self.P * (OPTIONS["forgetting"] + dt) / OPTIONS["forgetting"]
            self.P = older if np.diag(older).max() <= OPTIONS["sd"] ** 2 else self.P
            S = self.Y @ self.P @ self.Y.T + OPTIONS["noise"] ** 2 * np.eye(len(self.y))
            K = self.P @ self.Y.T @ np.linalg.inv(S)
            self.estimate = self.estimate + K @ (self.y - self.Y @ self.estimate)
            self.P = self.P - K @ S @ K.T
        self.estimate = np.clip(self.estimate, 0, 1)
        self.used = self.used + np.clip(
            self.estimate - self.used, -OPTIONS["rate"] * dt, OPTIONS["rate"] * dt
        )


@pytest.mark.parametrize("scalar, tolerance", [("double", 1e-11), ("float", 1e-4)])
def test_each_step_is_least_squares(scalar, tolerance):
    """1 to 4 parameters and equations; the truth drifts, and leaves its bounds now and then."""
    random = np.random.default_rng(20)
    for count, rows in ((1, 1), (2, 2), (3, 2), (4, 4)):
        start = random.uniform(0.2, 0.8, count)
        ours, reference = Core(start, rows, scalar), Reference(start, rows)
        quiet = 0
        for k in range(60):
            truth = 0.5 + 0.7 * np.sin(0.1 * k + np.arange(count))
            regressor = np.float32(random.normal(size=(rows, count)) * (k % 20 > 3)).astype(float)
            target = np.float32(regressor @ truth + 0.1 * random.normal(size=rows) * (k % 20 > 3)).astype(
                float
            )
            before = reference.P
            reference.step(regressor, target, 0.0625)
            quiet += reference.P is before
            assert ours.step(regressor, target, 0.0625) == "ok"
            assert np.array(list(ours.self.estimate)[:count]) == pytest.approx(
                reference.estimate, abs=tolerance
            )
            assert np.array(list(ours.self.used)[:count]) == pytest.approx(reference.used, abs=tolerance)
            assert ours.variance == pytest.approx(np.diag(reference.P), rel=10 * tolerance)
        assert set(np.round(reference.estimate, 12)) - {0.0, 1.0}


def test_nothing_is_forgotten_while_nothing_is_learned():
    """Neither in the dead zone, nor what the motion does not show: no variance grows beyond that at first."""
    ours = Core([0.5, 0.5], 2)
    for _ in range(100):
        ours.step(np.eye(2), [0.6, 0.4], 0.01)
    before = ours.variance
    for _ in range(1000):
        ours.step(np.zeros((2, 2)), [0.0, 0.0], 0.01)
    assert np.array_equal(ours.variance, before)
    for k in range(5000):  # only the sum of both is shown
        ours.step(np.ones((2, 2)), [1.0 + 0.2 * math.sin(k)] * 2, 0.01)
    assert ours.variance.max() <= OPTIONS["sd"] ** 2 * (1 + 1e-12) and ours.variance.min() > 0


def run(**changed):
    return simulate(spec_of_table({**SPEC, **changed}, Path("none.toml")))


def test_a_mass_that_is_twice_as_large_is_learned():
    (document,) = re.findall(
        r"tests/simulation/test_adaptation.py -->\n```toml\n(.*?)^```", DOCUMENT.read_text(), re.S | re.M
    )
    learning, without = run(adaptation=toml_table(document)["adaptation"]), run()
    used = learning.learned
    assert used[-1] == pytest.approx([80.0, 13.0], rel=0.02) and learning.columns[-2:] == [
        "learned_m_c",
        "learned_I_c",
    ]
    assert (np.abs(np.diff(used, axis=0)) <= np.array([70.0, 15.0]) * 0.1 * 0.01 * (1 + 1e-9)).all()
    final = {"m_c": ("kg", 80.0), "I_c": ("kg m^2", 13.0)}
    assert as_json(learning)["learned"] == {
        name: {"unit": unit, "final": value, "true": true}
        for (name, (unit, true)), value in zip(final.items(), used[-1], strict=True)
    }
    assert f"  learned m_c: {used[-1, 0]:.4g} kg, true 80 kg\n" in summary(
        learning
    ) and "learned" not in summary(without)
    *_, panel = draw(learning).axes
    assert [line.get_ydata()[-1] for line in panel.lines[::2]] == pytest.approx(
        (used[-1] - [30.0, 5.0]) / [70.0, 15.0]
    )
    assert [line.get_ydata()[0] for line in panel.lines[1::2]] == pytest.approx([5 / 7, 8 / 15])
    off = [
        math.hypot(x + 0.1 * math.cos(phi), y + 0.1 * math.sin(phi)) - 3.0 for x, y, phi in learning.q[:, :3]
    ]
    assert abs(without.error[-1, 0]) > 0.05 and abs(off[-1]) < abs(without.error[-1, 0]) / 10


def test_in_use_is_never_beyond_the_bounds():
    used = run(adaptation={"bounds": {"m_c": [25.0, 60.0]}, "noise": 0.2, "rate": 10.0}).learned
    assert used.max() == 60.0 and used.min() >= 25.0
    m_c = next(p.default for p in find_robot("labmate").parameters if p.name == "m_c")
    assert used[0, 0] == pytest.approx(m_c, rel=1e-12) and 25.0 < m_c < 60.0, (
        "it begins with what was believed"
    )


@pytest.mark.nightly
def test_runs_stay_stable_with_any_of_these_options():
    """Masses from a half to twice, used slowly and fast, forgotten or not, smoothed by little and by much,
    with noisy rates: the path is followed better than without.
    """
    for mass, rate, forgetting, window in product((25.0, 100.0), (0.02, 0.2, 5.0), (0.0, 2.0), (0.1, 1.0)):
        noisy = {
            "sensors": {"noise": {"sd": 0.02}, "pose": "true", "seed": 3},
            "plant": {"m_c": mass, "I_c": 13.0},
        }
        noisy["simulation"] = {**SPEC["simulation"], "duration": 20.0}
        options = {
            "bounds": {"m_c": [20.0, 120.0]},
            "noise": 2.0,
            "rate": rate,
            "forgetting": forgetting,
            "window": window,
        }
        runs = [
            simulate(spec_of_table({**SPEC, **noisy, **more}, Path("none.toml")))
            for more in ({}, {"adaptation": options})
        ]
        error = [np.abs(each.error[-300:, 0]).max() for each in runs]
        assert set(runs[1].status) == {"ok"} and error[1] < error[0]


PAYLOAD = Path(noslip.__file__).parent / "examples/specs/payload.toml"


def sample(spec, **columns) -> dict[str, float]:
    """Outcomes of one run of a sweep of this SPEC, which differs in these numbers."""
    runs = Simulated(spec, 0.05)
    return dict(zip(runs.outcomes, runs.run(runs.table(columns, 1))[0].tolist(), strict=True))


@pytest.mark.parametrize("changed", [{}, {"initial": {"point": [3.4, 0.0], "heading": -1.9, "speed": 0.2}}])
def test_outcomes_of_simulate_are_those_of_the_c(changed):
    """Of a SPEC without adaptation, which both can run; facing the other way it is refused or stops."""
    spec = spec_of_table({**SPEC, **changed, "limits": {"torque": 20.0}}, Path("none.toml"))
    batch = Batch(spec, band=0.05, instants=(1.0, 3.0))
    ours = Simulated(spec, 0.05, (1.0, 3.0))
    columns = {"plant.m_c": np.array([40.0, 90.0])}
    left, right = (runs.run(runs.table(columns, 2)) for runs in (ours, batch))
    assert ours.status(left[0, 0]) == batch.status(right[0, 0])
    for k, name in enumerate(ours.outcomes):
        if name not in ("status", "integration_error"):
            assert left[:, k] == pytest.approx(right[:, batch.outcomes.index(name)], abs=1e-7, nan_ok=True), (
                name
            )


def test_a_sweep_of_a_payload_and_of_a_filter(tmp_path, capsys):
    """By the command, in processes of their own; each run is that of `simulate`."""
    estimator = {"noise": [0.02], "gyro_noise": 0.001, "pose": {"rate": 2.0, "sd": 0.02, "heading_sd": 0.02}}
    sections = {"estimator": estimator, "sensors": {"noise": {"sd": 0.01}, "pose": "reckoned", "seed": 1}}
    time = {"duration": 1.0, "period": 0.02, "output_step": 0.02}
    vary = {
        "seed": 3,
        "estimator": {"pose": {"rate": {"uniform": [1.0, 5.0]}}},
        "plant": {"m_c": {"uniform": [30.0, 90.0]}},
    }
    table = {**SPEC, **sections, "simulation": time, "sweep": vary}
    filtered = "\n".join(f"{name} = {toml(value)}" for name, value in table.items())
    for text, name in (
        (PAYLOAD.read_text().replace("duration = 20.0", "duration = 1.0"), "outside"),
        (filtered, "off"),
    ):
        (tmp_path / "swept.toml").write_text(text)
        table = tmp_path / f"{name}.parquet"
        assert (
            main(["sweep", str(tmp_path / "swept.toml"), "--samples", "3", "--jobs", "2", "-o", str(table)])
            == 0
        )
        rows = pq.read_table(table).to_pylist()
        assert len(rows) == 3 and f"\n{name} " in capsys.readouterr().out
        assert main(["simulate", str(table), "--sample", "1", "-o", str(tmp_path / "run.csv")]) == 0
        with (tmp_path / "run.csv").open() as stream:
            *_, last = csv.DictReader(stream)
        capsys.readouterr()
        for state in ("x_c", "phi", "thetadot_r"):
            assert float(last[state]) == rows[1][f"end.{state}"]


def test_a_sweep_finds_bounds_that_are_no_use_and_c_without_bounds(monkeypatch):
    """Planted: bounds so wide that noise drives the robot off its path; a runtime that does not keep them."""
    wide = {"bounds": {"m_c": [1.0, 1000.0]}, "noise": 0.01, "window": 0.1, "forgetting": 0.2, "rate": 50.0}
    noisy = {"sensors": {"noise": {"sd": 0.2}, "pose": "true", "seed": 1}}
    assert abs(sample(read_varied(PAYLOAD, {"adaptation": wide, **noisy}))["final.distance"]) > 0.1
    heavy = {"plant.m_c": 150.0}
    good = sample(spec_of_table(toml_table(PAYLOAD.read_text()), PAYLOAD), **heavy)
    assert (
        abs(good["final.distance"]) < 0.1
        and good["outside"] == 0.0
        and good["learned.m_c"] == pytest.approx(120.0)
    )
    clamped = "estimate[i] > 0 ? (estimate[i] < 1 ? estimate[i] : 1) : 0"

    text = runtime_files()[HEADER]
    assert clamped in text and "value > most ? most : value" in text
    text = text.replace(clamped, "estimate[i]").replace("value > most ? most : value", "value")
    monkeypatch.setattr(adaptation, "shared_files", lambda *given: {**shared_files(*given), HEADER: text})
    adaptation.adaptation_library.cache_clear()
    try:
        assert sample(spec_of_table(toml_table(PAYLOAD.read_text()), PAYLOAD), **heavy)["outside"] > 0.1
    finally:
        adaptation.adaptation_library.cache_clear()


@pytest.mark.nightly
def test_no_payload_leads_astray():
    """200 runs of payload.toml: all go to their end, none beyond a bound,
    and the path is followed better than without."""
    study = study_of(PAYLOAD.read_text(), "payload", 200)
    table = study.plan.table(0, 200)
    outcomes = study.batch.run(table)
    names, inputs = study.batch.outcomes, study.batch.inputs
    without = Batch(replace(study.spec, adaptation=None), band=0.05)
    columns = {name: table[:, inputs.index(name)] for name in without.inputs}
    fixed = without.run(without.table(columns, 200))
    off = [
        np.abs(each[:, n.index("final.distance")])
        for each, n in ((outcomes, names), (fixed, without.outcomes))
    ]
    print([np.quantile(each, [0.5, 0.95, 1.0]) for each in off], np.mean(off[0] < off[1]))
    assert (outcomes[:, names.index("status")] >= 0).all() and outcomes[
        :, names.index("outside")
    ].max() == 0.0
    assert not (study.severity(table, outcomes) > 1).any() and off[0].max() < off[1].max() / 3


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_any_bits_in_finite_numbers_within_the_bounds_out(scalar):
    random, system = np.random.default_rng(21), system_of(find_robot("labmate"))
    parameters = [p.default for p in system.mechanism.parameters]
    options = AdaptationOptions(
        bounds={"m_c": (30.0, 100.0), "I_c": (1.0, 20.0)}, noise=0.2, rate=100.0, forgetting=1.0
    )
    ours = Adaptation(system, parameters, options, scalar)
    kind = np.uint64 if scalar == "double" else np.uint32
    good, places = 0, [[p.name for p in system.mechanism.parameters].index(name) for name in options.bounds]
    for k in range(2000):
        numbers = random.normal(size=10)
        if k % 2:
            place = random.integers(10)
            wild = random.integers(0, np.iinfo(kind).max, dtype=kind)
            with np.errstate(invalid="ignore"):
                numbers[place] = (
                    wild.view(f"f{wild.itemsize}")
                    if k % 4 == 1
                    else (math.inf, math.nan, 1e30, 1e308, -1e-300)[k % 5]
                )
        before = bytes(ours.c.ffi.buffer(ours.self))
        with np.errstate(over="ignore"):
            status, used = ours.step(numbers[:7], None if k % 16 == 7 else numbers[7:9], abs(numbers[9]) / 10)
        good += status == "ok"
        assert status == "ok" or bytes(ours.c.ffi.buffer(ours.self)) == before
        assert status in ("ok", "nonfinite", "bad_parameter", "range")
        assert np.isfinite(used).all() and 30 <= used[places[0]] <= 100 and 1 <= used[places[1]] <= 20
        assert np.isfinite(ours.covariance).all() and np.diag(ours.covariance).min() >= 0
    assert 900 < good < 1900


def test_init_refuses():
    for changed in (
        {"sd": 0.0},
        {"sd": 2.0},
        {"noise": 0.0},
        {"noise": math.nan},
        {"dead_zone": -1.0},
        {"forgetting": -1.0},
        {"window": math.inf},
        {"window": 0.0},
        {"rate": 0.0},
    ):
        assert Core([0.5], 1, **changed).status == "bad_parameter", changed
    assert {
        Core(start, rows).status
        for start, rows in (([1.5], 1), ([math.nan], 1), ([], 1), ([0.5], 0), ([0.5], 5))
    } == {"bad_parameter"}
    ours = Core([0.5], 1)
    assert [ours.step([[1.0]], [1.0], dt) for dt in (0.0, math.nan)] == ["bad_parameter", "nonfinite"]
    c = runtime(HEADER)
    assert (
        c.status(
            c.function("noslip_adaptation_step", "double")(
                c.new("noslip_adaptation", "double"), c.array("double", [1]), c.array("double", [1]), 0.1
            )
        )
        == "not_ready"
    )


BAD = {
    "nothing": ({"noise": 0.2}, "bounds"),
    "least above most": ({"bounds": {"m_c": [3.0, 2.0]}, "noise": 0.2}, "the first must be below the second"),
    "one bound": ({"bounds": {"m_c": [3.0]}, "noise": 0.2}, "[least, most]"),
    "empty": ({"bounds": {}, "noise": 0.2}, "is empty"),
    "not a parameter": (
        {"bounds": {"m": [1.0, 2.0]}, "noise": 0.2},
        "adaptation: unknown name 'm'; known are",
    ),
    "not affine": ({"bounds": {"d": [0.1, 0.2]}, "noise": 0.2}, "not affine in d"),
    "not told apart": (
        {"bounds": {"I_c": [1.0, 20.0], "I_m": [0.0, 1.0]}, "noise": 0.2},
        "no motion tells I_c, I_m",
    ),
    "not within": ({"bounds": {"m_c": [50.0, 60.0]}, "noise": 0.2}, "must lie within its bounds"),
    "not smoothed": (
        {"bounds": {"m_c": [20.0, 90.0]}, "noise": 0.2, "window": 0.01},
        "at least 5 times [simulation] period",
    ),
    "no noise": ({"bounds": {"m_c": [20.0, 90.0]}, "noise": 0.0}, "noise"),
}


def test_a_bad_section_is_refused():
    for name, (section, message) in BAD.items():
        with pytest.raises(BadInput, match=re.escape(message)) as error:
            simulate(spec_of_table({**SPEC, "adaptation": section}, Path("none.toml")))
            pytest.fail(name)
        assert "\n" not in str(error.value)
    section = {"bounds": {"m_c": [20.0, 90.0]}, "noise": 0.1}
    with pytest.raises(BadInput, match="requires .simulation. period > 0"):
        spec_of_table({**SPEC, "simulation": {"duration": 1.0}, "adaptation": section}, Path("none.toml"))


ASKED = {
    "--adapt": (["--output", "type_i", "--adapt", "m_c"], "--output adaptation learns: add it"),
    "nothing": (["--output", "adaptation"], "requires --adapt NAME"),
    "geometry": (["--output", "adaptation", "--adapt", "r"], "not affine in r"),
    "twice": (["--output", "adaptation", "--adapt", "m_c", "--adapt", "m_c"], "different parameters"),
}


@pytest.mark.parametrize("name", ASKED)
def test_generate_refuses(tmp_path, capsys, name):
    arguments, message = ASKED[name]
    assert main(["generate", "labmate", *arguments, "-o", str(tmp_path)]) == 2
    assert message in capsys.readouterr().err and not list(tmp_path.iterdir())


def test_tables_of_a_sweep_run_in_processes(tmp_path, capsys):
    """As in this process, also with instants and a second table;
    a sweep that simulate runs is not verified by simulate."""
    text = PAYLOAD.read_text().replace("duration = 20.0", "duration = 0.5")
    study, finished = study_of(text, "payload.toml", 5, (0.1, 0.4)), []
    table = study.plan.table(0, 5)
    assert isinstance(engine_of(study, 2), Processes)
    for rows in (table, table[3:]):
        assert np.array_equal(
            run_table(study, rows, 2, finished.append), study.batch.run(rows), equal_nan=True
        )
    assert finished == [1, 2, 3, 4, 5, 1, 2]
    (tmp_path / "swept.toml").write_text(text)
    argv = [
        "sweep",
        str(tmp_path / "swept.toml"),
        "--samples",
        "3",
        "-o",
        str(tmp_path / "swept.parquet"),
        "--verify",
        "1",
    ]
    assert main(argv) == 2 and "--verify: noslip simulate runs the samples" in capsys.readouterr().err
    assert not (tmp_path / "swept.parquet").exists()
