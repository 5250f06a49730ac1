"""`noslip sweep`: distributions, designs, files that depend on nothing but SPEC and number of samples,
statistics, figures."""

import dataclasses
import errno
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from noslip.cli.main import main
from noslip.simulation.closed_loop import simulate
from noslip.simulation.specification.distributions import Margin
from noslip.simulation.specification.vary import change, varied
from noslip.simulation.sweeping.designs import points
from noslip.simulation.sweeping.results import figures, statistics
from noslip.simulation.sweeping.results.verify import _differences
from noslip.simulation.sweeping.results.worst import find_worst
from noslip.simulation.sweeping.store import IDENTITY, Parts, open_sweep, part_size, sample_of
from noslip.simulation.sweeping.study import STOPPED, sample_spec, study_of
from scipy import stats

ROOT = Path(__file__).parents[2]
# In motion, the worst start is the singular one: straight away from the line
AT_REST = ("speed = 0.5 ", "speed = 0.0 ")
LINE = (
    (ROOT / "examples/specs/line.toml")
    .read_text()
    .replace("duration = 15.0", "duration = 1.0")
    .replace(*AT_REST)
)
SWEPT = """
[sweep]
seed = 7
fails = { final = 1.2 }
[sweep.plant]
m_c = { normal = [30.0, 6.0], within = [10.0, 60.0] }
[sweep.initial]
point = [0.0, { uniform = [1.5, 2.5] }]
heading = { normal = [1.6, 0.3] }
"""
SENSED = """
[sensors]
noise = { sd = 0.1 }
[correction]
rate = 5.0
"""


def text_of(swept: str = SWEPT, **changes: str) -> str:
    """A SPEC, lines `key = ...` of it changed."""
    lines = LINE.splitlines()
    for key, value in changes.items():
        lines = [f"{key} = {value}" if line.startswith(f"{key} = ") else line for line in lines]
    return "\n".join(lines) + swept


@pytest.fixture
def spec(tmp_path):
    """Writes a SPEC and answers its name."""

    def spec(swept: str = SWEPT, name: str = "s.toml", **changes: str) -> str:
        (tmp_path / name).write_text(text_of(swept, **changes))
        return str(tmp_path / name)

    return spec


def sweep(spec: str, samples: int, output: Path, *more: str) -> bytes:
    assert main(["sweep", spec, "--samples", str(samples), "-o", str(output), *more]) == 0
    return output.read_bytes()


# -- distributions and designs -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "margin, known",
    [
        (Margin("normal", 3.0, 0.5), stats.norm(3.0, 0.5)),
        (Margin("normal", 3.0, 0.5, (2.8, 9.0)), stats.truncnorm(-0.4, 12.0, 3.0, 0.5)),
        (Margin("uniform", -2.0, 5.0), stats.uniform(-2.0, 7.0)),
        (Margin("log_uniform", 0.1, 20.0), stats.loguniform(0.1, 20.0)),
    ],
)
def test_a_distribution_has_the_quantiles_of_scipys(margin, known):
    u = np.random.default_rng(1).uniform(1e-6, 1 - 1e-6, 1000)
    assert np.abs(margin.quantile(u) - known.ppf(u)).max() < 1e-9


@pytest.mark.parametrize("design", ["random", "sobol", "latin"])
@pytest.mark.parametrize("dimensions", [1, 3, 6])
def test_a_sample_is_a_function_of_its_number_alone(design, dimensions):
    whole = points(design, 5, 777, dimensions, 0, 777)
    assert whole.min() > 0 and whole.max() < 1
    for first, count in ((0, 1), (1, 5), (400, 377), (776, 1)):
        assert np.array_equal(points(design, 5, 777, dimensions, first, count), whole[first : first + count])
    assert not np.array_equal(points(design, 6, 777, dimensions, 0, 777), whole)
    for column in whole.T:
        assert stats.kstest(column, "uniform").pvalue > 1e-4
    for i, j in zip(*np.triu_indices(dimensions, 1), strict=True):
        assert abs(stats.spearmanr(whole[:, i], whole[:, j]).statistic) < 0.15  # 4 standard deviations


@pytest.mark.parametrize("samples", [1, 2, 5, 64, 1000])
def test_a_latin_hypercube_has_one_sample_in_each_part(samples):
    found = points("latin", 3, samples, 4, 0, samples)
    for column in found.T:
        assert sorted(np.floor(column * samples).astype(int)) == list(range(samples))


def test_sobols_points_are_spread_evenly():
    found = points("sobol", 3, 256, 2, 0, 256)
    for bits in ((8, 0), (4, 4), (0, 8)):  # one in each box of 2^-8
        boxes = np.floor(found * 2.0 ** np.array(bits)).astype(int)
        assert len(np.unique(boxes, axis=0)) == 256


@pytest.mark.parametrize("design", ["random", "sobol", "latin"])
def test_correlated_numbers_keep_their_distributions(design):
    swept = SWEPT.replace(
        "seed = 7", f'seed = 7\ndesign = "{design}"\ncorrelation = [["initial.heading", "plant.m_c", -0.8]]'
    )
    plan = study_of(text_of(swept), "s", 4096).plan
    columns = plan.columns(plan.table(0, 4096))
    assert list(columns) == ["plant.m_c", "initial.point[1]", "initial.heading"]
    assert (
        abs(
            stats.spearmanr(columns["plant.m_c"], columns["initial.heading"]).statistic
            - 6 / np.pi * np.arcsin(-0.4)
        )
        < 0.02
    )
    assert abs(stats.spearmanr(columns["plant.m_c"], columns["initial.point[1]"]).statistic) < 0.07
    for name, known in (
        ("plant.m_c", stats.truncnorm(-20 / 6, 5, 30, 6)),
        ("initial.point[1]", stats.uniform(1.5, 1)),
        ("initial.heading", stats.norm(1.6, 0.3)),
    ):
        assert stats.kstest(columns[name], known.cdf).pvalue > 1e-4


def test_what_the_controller_believes_is_true_unless_said_otherwise():
    swept = "\n[sweep.parameters]\nm_c = { uniform = [20.0, 40.0] }\n"
    table = study_of(text_of(swept), "s", 9).plan
    inputs = table.inputs.names
    rows = table.table(0, 9)
    assert np.array_equal(rows[:, inputs.index("plant.m_c")], rows[:, inputs.index("parameters.m_c")])
    assert np.ptp(rows[:, inputs.index("plant.m_c")]) > 1


@pytest.mark.nightly
def test_the_documents_example_is_a_sweep():
    """docs/sweep.md, of a SPEC with sensors."""
    block = re.search(r"```toml\n(.*?)```", (ROOT / "docs/sweep.md").read_text(), re.DOTALL)[1]
    sampled = text_of(SENSED + block.replace("period = 0.01 ", "# "), period="0.01")
    study = study_of(sampled, "docs/sweep.md", 8)
    assert study.criterion.limits == {"final.distance": 0.1, "effort.tau_r": 40.0}
    assert len(study.plan.names) == 5 and study.plan.spec.sweep.correlation
    assert np.all(study.batch.run(study.plan.table(0, 8))[:, 0] >= 0)


def test_the_headline_has_the_range_of_varied_periods_and_durations(spec, tmp_path, capsys):
    """And of fewer than 20 runs there are no rank correlations,
    whose errors would be as large as themselves."""
    varied = (
        "\n[sweep.simulation]\nperiod = { uniform = [0.005, 0.02] }\nduration = { uniform = [0.5, 1.0] }\n"
    )
    sweep(spec(SWEPT + varied, period="0.01"), 19, tmp_path / "a.parquet", "--json")
    found, said = pq.read_table(tmp_path / "a.parquet"), json.loads(capsys.readouterr().out)
    periods, durations = (found[f"simulation.{name}"].to_numpy() for name in ("period", "duration"))
    assert said["period"] == [periods.min(), periods.max()] and said["rank_correlations"] == {}
    sweep(spec(SWEPT + varied, period="0.01"), 19, tmp_path / "a.parquet")
    head = capsys.readouterr().out.splitlines()[0]
    assert f"called every {periods.min():.3g} to {periods.max():.3g} s" in head
    assert head.endswith(f", {durations.min():.3g} to {durations.max():.3g} s")


# -- the file ------------------------------------------------------------------------------------------------


def test_the_file_holds_the_samples_whatever_the_jobs(spec, tmp_path, capsys):
    file = spec()
    one = sweep(file, 150, tmp_path / "one.parquet", "--jobs", "1")
    assert sweep(file, 150, tmp_path / "three.parquet", "--jobs", "3") == one
    assert not list(tmp_path.glob("*.parts"))
    out = capsys.readouterr().out
    assert "called every 0.01 s ([sweep] period; the SPEC is continuous)" in out
    study = study_of(text_of(), "s", 150)
    table = study.plan.table(0, 150)
    outcomes = study.batch.run(table)
    found = pq.read_table(tmp_path / "one.parquet")
    assert found["sample"].to_pylist() == list(range(150))
    for name, values in study.plan.columns(table).items():
        assert np.array_equal(found[name], values)
    for name, values in zip(study.batch.outcomes, outcomes.T, strict=True):
        if name != "status":
            assert np.array_equal(found[name], values, equal_nan=True)
    assert set(found["status"].to_pylist()) == {"ok"}
    wrong = np.abs(found["final.distance"].to_numpy()) > 1.2
    assert np.array_equal(found["failed"].to_numpy(), wrong) and 0 < wrong.sum() < 150
    assert found.schema.metadata[b"noslip.spec"].decode() == text_of()


def test_a_finished_sweep_is_not_run_again(spec, tmp_path, capsys):
    file, output = spec(), tmp_path / "a.parquet"
    sweep(file, 40, output)
    before = capsys.readouterr().out, output.stat().st_mtime_ns
    sweep(file, 40, output)
    assert (capsys.readouterr().out, output.stat().st_mtime_ns) == before


def test_another_sweep_of_the_same_name_is_refused(spec, tmp_path, bad_input):
    file, output = spec(), tmp_path / "a.parquet"
    sweep(file, 40, output)
    other = spec(SWEPT.replace("6.0", "7.0"), "other.toml")
    command = ["--samples", "40", "-o", str(output)]
    assert "its SPEC is not this one; remove it or change -o" in bad_input(["sweep", other, *command])
    assert "samples 40, not 41" in bad_input(["sweep", file, "--samples", "41", "-o", str(output)])
    text, row, outcome = sample_of(output, 3)
    older = {key: value for key, value in study_of(text, file, 40).identity.items() if key != "format"}
    found = pq.read_table(output)
    metadata = found.schema.metadata | {IDENTITY: json.dumps(older).encode()}
    pq.write_table(found.replace_schema_metadata(metadata), output, row_group_size=part_size(40))
    assert "format 1, not 2; remove it or change -o" in bad_input(["sweep", file, *command])
    assert sample_of(output, 3) == (text, row, outcome), "results of another format can be read"
    output.write_text("mine")
    assert "is not a finished noslip sweep, or is damaged; remove it or change -o" in bad_input(
        ["sweep", file, *command]
    )
    assert output.read_text() == "mine"
    output.unlink()
    with Parts(output, study_of(Path(other).read_text(encoding="utf-8"), other, 40)).held():
        pass
    assert "has parts of another sweep" in bad_input(["sweep", file, *command])


def test_two_processes_do_not_write_one_sweep(spec, tmp_path, bad_input):
    file, output = spec(), tmp_path / "a.parquet"
    with Parts(output, study_of(Path(file).read_text(encoding="utf-8"), file, 40)).held():
        assert "is in use by another noslip sweep" in bad_input(
            ["sweep", file, "--samples", "40", "-o", str(output)]
        )


def test_a_sweep_that_was_stopped_or_killed_goes_on_and_gives_the_same_bytes(spec, tmp_path):
    file, output = spec(duration="15.0"), tmp_path / "killed.parquet"
    folder = tmp_path / "killed.parquet.parts"
    command = [sys.executable, "-c", "from noslip.cli.main import main; raise SystemExit(main())"]
    command += ["sweep", file, "--samples", "700", "-o", str(output), "--jobs", "1"]

    def finished() -> set[str]:
        return {part.name for part in folder.glob("0*")}

    before: set[str] = set()
    for stop, code in ((signal.SIGINT, 130), (signal.SIGKILL, -signal.SIGKILL)):
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        while not finished() - before and process.poll() is None:
            time.sleep(0.002)
        process.send_signal(stop)
        _, err = process.communicate()
        assert process.returncode == code
        assert "Traceback" not in err
        assert not output.exists() and before < finished()
        before = finished()
    times = {name: (folder / name).stat().st_mtime_ns for name in before}
    torn = folder / sorted(before)[0]
    torn.write_bytes(torn.read_bytes()[:-8])  # as after a power cut
    parts = Parts(output, study_of(Path(file).read_text(encoding="utf-8"), file, 700))
    assert set(range(parts.count)) - set(parts.missing()) == {
        int(name) for name in before if name != torn.name
    }
    assert times
    whole = sweep(file, 700, tmp_path / "whole.parquet")
    assert sweep(file, 700, output) == whole


def test_a_full_disk_is_one_line_and_loses_nothing(spec, tmp_path, monkeypatch, capsys):
    file, output = spec(), tmp_path / "a.parquet"
    calls, sync = [], os.fsync

    def full(handle):
        calls.append(handle)
        if len(calls) > 4:  # the manifest, one part, and the folder after each
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        sync(handle)

    monkeypatch.setattr(os, "fsync", full)
    assert main(["sweep", file, "--samples", "100", "-o", str(output), "--jobs", "1"]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1 and "No space left" in err and "free some space" in err
    monkeypatch.undo()
    assert len(list((tmp_path / "a.parquet.parts").glob("0*"))) == 1
    assert not list(tmp_path.rglob(".*"))
    assert sweep(file, 100, output) == sweep(file, 100, tmp_path / "b.parquet")


@pytest.mark.parametrize(
    "swept, message",
    [
        ("", "[sweep] is missing"),
        ("\n[sweep]\nseed = 1\n", "nothing varies"),
        ("\n[sweep]\nseeds = 1\n", "unknown key 'seeds'; did you mean 'seed'"),
        ("\n[sweep]\nseed = -1\n", "must be 0 or more"),
        ("\n[sweep.plants]\nm_c = { normal = [30.0, 6.0] }\n", "unknown key 'plants'"),
        (
            "\n[sweep.plant]\nm_d = { normal = [30.0, 6.0] }\n",
            "plant.m_d is not a number of this SPEC that can vary",
        ),
        ("\n[sweep.plant]\nm_c = { gauss = [30.0, 6.0] }\n", "unknown key 'gauss'"),
        ("\n[sweep.plant]\nm_c = { normal = [30.0, 0.0] }\n", "[1] = 0 must be positive"),
        ("\n[sweep.plant]\nm_c = { normal = [30.0] }\n", "has 1 numbers; it must be [mean, sd]"),
        ("\n[sweep.plant]\nm_c = { normal = [nan, 1.0] }\n", "is not finite"),
        ("\n[sweep.plant]\nm_c = { uniform = [3.0, 2.0] }\n", "[3, 2]: the first must be below"),
        ("\n[sweep.plant]\nm_c = { log_uniform = [0.0, 2.0] }\n", "0 must be positive"),
        ("\n[sweep.plant]\nm_c = { uniform = [1.0, 2.0], within = [0, 1] }\n", "within applies to normal"),
        ("\n[sweep.plant]\nm_c = { normal = [30.0, 1.0], within = [90, 91] }\n", "almost none"),
        ("\n[sweep.plant]\nm_c = { normal = [30.0, 1.0], uniform = [1.0, 2.0] }\n", "must be one of"),
        ("\n[sweep.plant]\nm_c = 30.0\n", "is no distribution"),
        ("\n[sweep.initial]\npoint = { normal = [30.0, 6.0] }\n", "give a list of 2"),
        (
            "\n[sweep]\nfails = { final = -1.0 }\n[sweep.plant]\nm_c = { normal = [30.0, 6.0] }\n",
            "must be positive",
        ),
        (
            "\n[sweep]\nfails = { fnal = 1.0 }\n[sweep.plant]\nm_c = { normal = [30.0, 6.0] }\n",
            "unknown outcome 'fnal'",
        ),
        (
            SWEPT.replace("seed = 7", 'correlation = [["plant.m_c", "plant.b", 0.5]]'),
            "no number that varies: 'plant.b'",
        ),
        (
            SWEPT.replace("seed = 7", 'correlation = [["plant.m_c", "initial.heading", 1.0]]'),
            "[0][2] = 1 must be below 1",
        ),
        (
            SWEPT.replace(
                "seed = 7",
                'correlation = [["plant.m_c", "initial.heading", 0.9], ["plant.m_c", "initial.point[1]", '
                '0.9], ["initial.heading", "initial.point[1]", -0.9]]',
            ),
            "not positive definite",
        ),
    ],
)
def test_a_bad_sweep_is_refused_in_one_line(spec, tmp_path, bad_input, swept, message):
    assert message in bad_input(["sweep", spec(swept), "--samples", "10", "-o", str(tmp_path / "a.parquet")])


def test_a_bad_command_is_refused_in_one_line(spec, tmp_path, bad_input):
    command = ["sweep", spec(), "-o", str(tmp_path / "a.parquet"), "--samples"]
    assert "--samples = 0 must be 1 or more" in bad_input([*command, "0"])
    assert "--jobs = 0" in bad_input([*command, "9", "--jobs", "0"])
    assert "power of 2" in bad_input([*command, "9", "--indices", "100"])
    assert "at most" in bad_input([*command, str(2**33)])
    assert "ends in .parquet" in bad_input(["sweep", spec(), "-o", str(tmp_path / "a.csv"), "--samples", "9"])
    assert "does not exist" in bad_input(
        ["sweep", spec(), "-o", str(tmp_path / "no/a.parquet"), "--samples", "9"]
    )
    sampled = spec(SWEPT.replace("seed = 7", "period = 0.02"), "p.toml", period="0.01")
    assert "period applies to a continuous SPEC" in bad_input(["sweep", sampled, *command[2:], "9"])
    assert "not a finished noslip sweep" in bad_input(
        ["simulate", sampled, "--sample", "1", "-o", str(tmp_path / "r.csv")]
    )


# -- single samples ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sensed", ["", SENSED])
def test_any_sample_can_be_run_again_by_simulate(spec, tmp_path, capsys, sensed):
    """The file and simulate agree within the stated error; so does the SPEC with what --set is told."""
    file, output = spec(sensed + SWEPT, period="0.01"), tmp_path / "a.parquet"
    sweep(file, 40, output)
    for sample in (0, 39):
        difference, same = _differences(str(output), sample)
        assert difference < 1e-9 and same
    text, row, outcome = sample_of(output, 39)
    study = study_of(text, file, 40)
    told = varied(text, file, dict(map(change, study.changes(row))))
    assert simulate(told).error[-1, 0] == pytest.approx(outcome["final.distance"], abs=1e-9)
    capsys.readouterr()
    assert main(["simulate", str(output), "--sample", "39", "-o", str(tmp_path / "r.csv")]) == 0
    last = (tmp_path / "r.csv").read_text().splitlines()[-1].split(",")
    assert float(last[1]) == pytest.approx(outcome["end.x_c"], abs=1e-9)
    if sensed:
        seeds = pq.read_table(output)["seed"].to_pylist()
        assert len(set(seeds)) == 40 and sample_spec(text, row).sensors.seed == seeds[39]


def test_a_spec_with_a_sweep_is_still_one_run(spec, tmp_path):
    """[sweep] changes nothing of it, and is checked."""
    assert main(["simulate", spec(), "-o", str(tmp_path / "a.csv")]) == 0
    assert main(["simulate", spec("", "bare.toml"), "-o", str(tmp_path / "b.csv")]) == 0
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    assert main(["simulate", spec("\n[sweep]\nseeds = 7\n"), "-o", str(tmp_path / "c.csv")]) == 2


# -- what comes out ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("failed, samples", [(0, 10), (3, 10), (10, 10), (1, 100000)])
def test_the_confidence_interval_is_clopper_and_pearsons(failed, samples):
    known = stats.binomtest(failed, samples).proportion_ci(0.95, method="exact")
    assert statistics.clopper_pearson(failed, samples) == pytest.approx((known.low, known.high), abs=1e-11)


def test_the_summary_is_that_of_the_rows(spec, tmp_path, capsys):
    output = tmp_path / "a.parquet"
    sweep(spec(), 200, output, "--json")
    told = json.loads(capsys.readouterr().out)
    rows = pq.read_table(output)
    failed = rows["failed"].to_numpy()
    size = np.abs(rows["final.distance"].to_numpy())
    assert told["failed"] == failed.sum() and told["failure_probability"] == failed.mean()
    assert told["quantiles"]["final.distance"]["0.9"] == np.quantile(size, 0.9)
    assert told["worst_samples"] == np.argsort(-size)[:3].tolist()
    for name in ("plant.m_c", "initial.point[1]"):
        known = stats.spearmanr(rows[name].to_numpy(), size).statistic
        assert told["rank_correlations"]["final.distance"][name] == pytest.approx(known, abs=1e-12)


class Formula:
    """Stands in for a batch: the final error of an additive and a product model,
    singular where heading > 2."""

    def __init__(self, batch):
        self.inputs, self.outcomes, self.law, self.status = (
            batch.inputs,
            batch.outcomes,
            batch.law,
            batch.status,
        )

    def run(self, table):
        m, y, heading = (
            table[:, self.inputs.index(name)] for name in ("plant.m_c", "initial.point[1]", "initial.heading")
        )
        found = np.zeros((len(table), len(self.outcomes)))
        found[:, self.outcomes.index("t_end")] = 1.0
        found[:, self.outcomes.index("final.distance")] = 10 + (m - 30) / 6 + 2 * np.sqrt(12) * (y - 2)
        found[:, self.outcomes.index("peak.distance")] = 10 + np.sqrt(12) * (y - 2) * (heading - 1.6) / 0.3
        return found


FORMULA = SWEPT.replace(", within = [10.0, 60.0]", "").replace("final = 1.2", "final = 16.0")


def test_sobols_indices_are_those_of_models_that_are_known():
    study = study_of(text_of(FORMULA), "s", 16)
    study = dataclasses.replace(study, batch=Formula(study.batch))
    found = statistics.indices(study, 2048, jobs=1)
    assert found.runs == 5 * 2048
    wanted = {
        "final.distance": {
            "plant.m_c": (0.2, 0.2),
            "initial.point[1]": (0.8, 0.8),
            "initial.heading": (0, 0),
        },
        "peak.distance": {"plant.m_c": (0, 0), "initial.point[1]": (0, 1), "initial.heading": (0, 1)},
    }
    for outcome, values in wanted.items():
        for name, both in values.items():
            assert np.abs(np.subtract(found.values[outcome][name][:2], both)).max() < 0.05


def test_the_worst_is_found_in_the_corner_where_it_is():
    study = study_of(text_of(FORMULA), "s", 16)
    worst = find_worst(dataclasses.replace(study, batch=Formula(study.batch)), (), jobs=1)
    highest = 10 + stats.norm.ppf(0.999) + 2 * np.sqrt(12) * 0.499
    assert worst.outcomes["final.distance"] == pytest.approx(highest, rel=1e-3)
    assert worst.severity == pytest.approx(highest / 16.0, rel=1e-3)


def test_a_run_that_stops_is_worse_than_any_that_ends():
    criterion = study_of(text_of(), "s", 1).criterion
    columns = {name: k for k, name in enumerate(criterion.outcomes)}
    outcomes = np.zeros((4, len(columns)))
    outcomes[:, columns["status"]] = (0, 0, -5, -5)
    outcomes[:, columns["t_end"]] = (1.0, 1.0, 0.9, 0.1)
    outcomes[:, columns["final.distance"]] = (0.6, -1e12, 0.0, 0.0)
    severity = criterion.severity(outcomes, 1.0)
    assert severity[0] == 0.5 and np.all(np.diff(severity) > 0) and severity[2] > STOPPED


@pytest.mark.parametrize(("law", "rows"), [("I", ("x_l", "y_l")), ("II", ("x_l", "heading"))])
def test_an_error_in_any_place_is_a_failure_by_default(law, rows):
    """Types I and II have two outputs of relative degree 2, Type IV one."""
    text = (
        (ROOT / "examples/specs/figures/figure_7_type_i.toml")
        .read_text()
        .replace('type = "I"', f'type = "{law}"')
    )
    text = re.sub(r"^heading = .*", "heading = 0.5", text, flags=re.MULTILINE)
    study = study_of(text + "\n[sweep.plant]\nm_c = { uniform = [25.0, 35.0] }\n", "s", 4)
    assert study.criterion.limits == {f"final.{row}": 0.05 for row in rows}
    assert study_of(text_of(SWEPT.replace("fails = { final = 1.2 }", "")), "s", 4).criterion.limits == {
        "final.distance": 0.05
    }


@pytest.mark.nightly
def test_worst_indices_and_figures_of_a_sweep(spec, tmp_path, capsys):
    """What is printed for the worst is at least as bad as the worst sample, when simulate runs it."""
    file, output = spec(), tmp_path / "a.parquet"
    more = ("--worst", "--indices", "16", "--figures", str(tmp_path / "f"), "--json")
    sweep(file, 60, output, *more)
    told = json.loads(capsys.readouterr().out)
    run = simulate(varied(text_of(), file, dict(map(change, told["worst"]["set"]))))
    assert run.error[-1, 0] == pytest.approx(told["worst"]["outcomes"]["final.distance"], abs=1e-9)
    assert abs(run.error[-1, 0]) > 0.98 * np.abs(pq.read_table(output)["final.distance"].to_numpy()).max()
    assert set(told["sobol_indices"]["final.distance"]) == {
        "plant.m_c",
        "initial.point[1]",
        "initial.heading",
    }
    names = sorted(path.name for path in (tmp_path / "f").iterdir())
    assert names == sorted(
        f"{name}.{kind}" for name in ("envelope", "cloud", "starts") for kind in ("csv", "png", "svg")
    )
    assert all(path.stat().st_size > 10_000 for path in (tmp_path / "f").glob("*.png"))


def test_the_map_of_starts_that_keep_rolling(spec, tmp_path, monkeypatch):
    """On the path, along it, at its speed, the robot rolls;
    1.5 rad off it would not. The limiter keeps more of the starts."""
    monkeypatch.setattr(figures, "GRID", (9, 3))
    kept = []
    for limits in ("", '[limits]\nmode = "grip"\n'):
        text = text_of(SWEPT.replace("[1.5, 2.5]", "[-0.5, 0.5]")) + "[contact]\nmu = 0.6\n" + limits
        study = study_of(text, "s", 4)
        ranges = {"initial.heading": (-0.7, 1.5), "initial.point[1]": (-0.5, 0.5)}
        x, y, (use, t_end) = figures._on_grid(study, ranges, 1, "use", "t_end")
        assert x.shape == (9,) and y.shape == (3,) and use.shape == t_end.shape == (3, 9)
        kept.append(int(np.sum((use <= 1.0) & (t_end > 0.0))))
    assert 0 < kept[0] < kept[1], kept


# -- a cluster -----------------------------------------------------------------------------------------------


def test_a_scheduler_that_is_not_there_is_refused(spec, tmp_path, bad_input, monkeypatch):
    pytest.importorskip("distributed", reason="the cluster extra is not installed")
    monkeypatch.setattr("noslip.simulation.sweeping.cluster.PATIENCE", "0.3s")
    command = ["sweep", spec(), "--samples", "10", "-o", str(tmp_path / "a.parquet"), "--scheduler"]
    for address in ("tcp://127.0.0.1:9", "nonsense://x", "127.0.0.1:port"):
        assert f"--scheduler {address}: no scheduler answers" in bad_input([*command, address])


@pytest.mark.nightly
def test_a_cluster_gives_the_same_bytes_though_a_worker_is_killed(spec, tmp_path):
    distributed = pytest.importorskip("distributed", reason="the cluster extra is not installed")
    file, output = spec(duration="15.0"), tmp_path / "killed.parquet"
    folder = tmp_path / "killed.parquet.parts"
    alone = sweep(file, 320, tmp_path / "alone.parquet")
    left = []

    def kill_one():
        while not list(folder.glob("0*")):
            time.sleep(0.002)
        workers[0].kill()
        left.append(len(list(folder.glob("0*"))))

    with distributed.LocalCluster(n_workers=0, dashboard_address=None, silence_logs="CRITICAL") as cluster:
        command = [
            sys.executable,
            "-m",
            "distributed.cli.dask_worker",
            cluster.scheduler_address,
            "--no-nanny",
            "--no-dashboard",
        ]
        command += ["--nthreads", "1", "--local-directory", str(tmp_path)]
        workers = [
            subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) for _ in range(2)
        ]
        try:
            with distributed.Client(cluster) as client:
                client.wait_for_workers(2, timeout=60)
            killer = threading.Thread(target=kill_one, daemon=True)
            killer.start()
            assert sweep(file, 320, output, "--scheduler", cluster.scheduler_address) == alone
            killer.join(10)
        finally:
            for worker in workers:
                worker.kill()
                worker.wait()
    assert left and left[0] < 320 / 32 - 1  # there was work left when it was killed


def test_a_file_without_a_sweep_is_refused(tmp_path):
    from noslip.readers.errors import BadInput

    with pytest.raises(BadInput, match="there is no such file"):
        open_sweep(tmp_path / "none.parquet")
