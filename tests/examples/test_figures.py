"""Figures: their specs, what they are measured by, the claims that can fail, the report, the command line."""

import base64
import csv
import dataclasses
import hashlib
import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import noslip
import numpy as np
import pytest
from noslip.cli.main import main
from noslip.codegen.runtime import runtime_files
from noslip.examples.evidence import catalogue, production
from noslip.examples.evidence.catalogue import FIGURES
from noslip.examples.evidence.figures import beyond, circle, line, masses, robots
from noslip.examples.evidence.figures.beyond import true_distance
from noslip.examples.evidence.framework import SPECS, Case, Claim, Figure, carry_out
from noslip.examples.evidence.measures import overshoot, sign_changes, time_to_stay_within
from noslip.examples.evidence.production import Made, produce
from noslip.examples.evidence.report import by_whom, report, summary
from noslip.readers.errors import BadInput
from noslip.readers.files import MARK
from noslip.simulation.drawing import over_time, panels, plotted
from noslip.simulation.specification.spec import read_spec
from noslip.simulation.specification.vary import change, read_varied
from noslip.tests.figures_made import figure_of, runs_here
from noslip.tests.tools import NOSLIP
from scipy.optimize import minimize_scalar

ROOT = Path(noslip.__file__).parent
SHORT = {"simulation.duration": 0.2}


# -- specs with entries changed ------------------------------------------------------------------------------


def test_changed_entries_are_as_if_the_file_said_so(tmp_path):
    file = SPECS / "figure_8.toml"
    text = file.read_text().replace("heading = 0.0", "heading = 0.5").replace("R = 10.0", "R = 12.0")
    (tmp_path / "changed.toml").write_text(text + "[contact]\nmu = 0.5\n")
    changes = {"initial.heading": 0.5, "output.path.R": 12, "contact.mu": 0.5}
    assert read_varied(file, changes) == read_spec(tmp_path / "changed.toml")
    assert read_varied(file, {}) == read_spec(file)


def test_a_table_takes_the_place_of_the_whole_table():
    spec = read_varied(
        SPECS / "figure_9a.toml", {"plant": {}, "output.path": {"kind": "ellipse", "a": 3.0, "b": 2.0}}
    )
    assert spec.plant == {} and spec.output.path.parameters == {"a": 3.0, "b": 2.0}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"initial.headin": 1.0}, "unknown key 'headin'; did you mean 'heading'?"),
        ({"initial.heading": "north"}, "'north' is not a number"),
        ({"initial.heading": math.nan}, "not finite"),
        ({"robot.name": "labmate"}, "robot is not a table"),
        ({"simulation.tolerance": 1.0}, "must be at most 0.01"),
    ],
)
def test_changes_are_checked(changes, said):
    with pytest.raises(BadInput, match="figure_8.toml with .* changed") as raised:
        read_varied(SPECS / "figure_8.toml", changes)
    assert said in str(raised.value)


def test_key_and_value():
    assert change("initial.heading=-0.5") == ("initial.heading", -0.5)
    assert change(' output.type = "I"') == ("output.type", "I")
    assert change("plant = { m_c = 60.0 }") == ("plant", {"m_c": 60.0})


@pytest.mark.parametrize("text", ["initial.heading", "=1", "a=", "a=north pole", "a=1\nb=2", ""])
def test_what_is_no_key_and_value(text):
    with pytest.raises(BadInput, match="KEY=VALUE"):
        change(text)


# -- specs of the figures ------------------------------------------------------------------------------------

FILES = sorted(path.name for path in SPECS.glob("*.toml"))


def test_every_spec_is_used_and_every_name_is_once():
    used = {case.file for figure in FIGURES for case in figure.cases.values()}
    assert {file for file in used if "/" not in file} == set(FILES)  # those elsewhere are specs of robots
    names = [figure.name for figure in FIGURES]
    assert len(set(names)) == len(names)
    for name in ("1", "6", "7", "8a", "8b", "9a", "9b"):
        assert name in names


@pytest.mark.parametrize("file", FILES)
def test_every_spec_runs_by_itself(file, tmp_path, capsys):
    text = re.sub(r"^duration = \S+", "duration = 0.1", (SPECS / file).read_text(), flags=re.M)
    (tmp_path / file).write_text(text)
    assert main(["simulate", str(tmp_path / file), "-o", str(tmp_path / "run.csv")]) == 0


@pytest.mark.parametrize("figure", FIGURES, ids=lambda figure: figure.name)
def test_every_case_is_a_spec(figure):
    for case in figure.cases.values():
        assert case.spec().simulation.backend == "c"
    assert figure.title and figure.paper


# -- measures ------------------------------------------------------------------------------------------------


def test_sign_changes():
    t = np.linspace(0, 2 * np.pi, 1001)
    assert sign_changes(np.sin(t[:-1])) == 1 and sign_changes(np.cos(t)) == 2
    assert sign_changes(np.array([0.0, 1e-9, -1e-9, 1.0])) == 0  # standing, then forward
    assert sign_changes(np.array([1.0, 0.0, 0.0, -1.0])) == 1
    assert sign_changes(np.array([1.0, 0.0, 1.0])) == 0


def test_overshoot_and_settling():
    t = np.arange(6.0)
    assert overshoot(np.array([-1.0, -0.5, 0.2, 0.1, 0.0, 0.0])) == 0.2
    assert overshoot(np.array([1.0, 0.5, 0.0])) == 0.0
    assert time_to_stay_within(t, np.array([1.0, 0.0, -1.0, 0.1, 0.0, 0.1]), 0.5) == 3.0
    assert time_to_stay_within(t, np.array([1.0, 0.0, 0.0, 0.0, 0.0, 1.0]), 0.5) == math.inf
    assert time_to_stay_within(t, np.zeros(6), 0.5) == 0.0


def test_true_distance_from_an_ellipse():
    random, a, b = np.random.default_rng(1992), 6.0, 3.0
    angle, beside = random.uniform(0, 2 * np.pi, 40), random.uniform(0.7, 1.5, 40)
    points = beside[:, None] * np.column_stack([a * np.cos(angle), b * np.sin(angle)])
    for point, found in zip(points, true_distance(points, a, b), strict=True):

        def far(s, point=point):
            return np.hypot(a * np.cos(s) - point[0], b * np.sin(s) - point[1])

        coarse = min(np.linspace(0, 2 * np.pi, 400), key=far)
        least = minimize_scalar(
            far, bounds=(coarse - 0.02, coarse + 0.02), method="bounded", options={"xatol": 1e-12}
        ).fun
        assert abs(abs(found) - least) < 1e-9 and (found > 0) == (
            (point[0] / a) ** 2 + (point[1] / b) ** 2 > 1
        )


def test_the_points_of_the_robot_move_as_their_velocities_say():
    spec = read_varied(SPECS / "figure_8.toml", {"simulation.output_step": 1e-3, "output.L": 0.2, **SHORT})
    run = carry_out(spec)
    for points, velocity in ((run.P_l, run.velocity), (run.P_o, run.speed[:, None] * run.forward)):
        found = (points[2:] - points[:-2]) / (run.t[2:] - run.t[:-2])[:, None]
        assert np.abs(found - velocity[1:-1]).max() < 1e-2
    assert np.allclose(run.P_l - run.P_o, 0.5 * run.forward, atol=1e-14)
    assert np.abs(np.gradient(run.heading, run.t)[1:-1] - run.yaw_rate[1:-1]).max() < 1e-2


# -- runs ----------------------------------------------------------------------------------------------------


def test_a_run_tells_what_it_is_made_of():
    run = carry_out(Case("figure_8.toml", SHORT).spec())
    assert run.slip < 1e-12 and run.integral < 1e-12 and 0 < run.agreement < 1e-10
    assert run.stopped is None and len(run.t) == len(run.tau) == len(run.forces)
    for name, digest in run.sources.items():
        text = runtime_files().get(name) or (ROOT / "generated/labmate" / name).read_text()
        assert hashlib.sha256(text.encode()).hexdigest() == digest
    assert {"labmate.c", "labmate_type_iv_circle.c", "noslip_trig.h"} <= set(run.sources)
    with pytest.raises(AttributeError, match="no array 'nothing'"):
        _ = run.nothing


def test_only_a_singular_start_that_is_expected_is_no_error():
    heading = -math.atan2(1, 2)
    case = Case("figure_8.toml", {"initial.heading": heading}, singular=True)
    assert "singular" in carry_out(case.spec(), singular=True).refused
    with pytest.raises(BadInput, match="singular"):
        carry_out(case.spec())
    with pytest.raises(BadInput, match="unknown key"):
        carry_out(Case("figure_8.toml", {"plant.mass": 1.0}).spec(), singular=True)


def test_a_stopped_run_is_compared_as_far_as_it_goes():
    changes = {"output.path.C": -8.0, "initial.heading": math.pi / 4, "initial.speed": 1.414}
    run = carry_out(read_varied(SPECS / "figure_1_type_iv.toml", changes))
    assert run.stopped == "singular" and run.agreement < 1e-8


# -- all figures, and claims that can fail -------------------------------------------------------------------


FOUND_WRONG = {  # the sentence of the paper, by figure: how it begins
    "9a": "it converges later than without error: robot has double the mass",
    "10": "the second transition involves a smaller change",
    "12": "at the second transition there is almost no deviation",
}
# The others are in test_robot_figures and test_floor_figures.
LABMATES = [figure.name for figure in FIGURES if figure not in robots.FIGURES and not figure.engine]


@pytest.mark.parametrize("name", LABMATES)
def test_every_claim_is_as_expected(name):
    claims = figure_of(name).claims
    assert [claim.text for claim in claims if not claim.as_expected] == []
    wrong = [claim.text for claim in claims if not claim.holds]
    assert len(wrong) == (name in FOUND_WRONG) and all(text.startswith(FOUND_WRONG[name]) for text in wrong)
    assert all(claim.paper and claim.note for claim in claims if not claim.expected)


def with_arrays(run, **changed):
    """A run with other arrays; refused ones stay."""
    if run.refused:
        return run
    return dataclasses.replace(
        run, arrays={**run.arrays, **{name: value(run) for name, value in changed.items()}}
    )


def beside(run):
    """Half a metre to the side."""
    return with_arrays(run, q=lambda r: r.q + [0.5, 0, 0, 0, 0], y=lambda r: r.y + [0.5, 0.0])


def trembling(run):
    """A centimetre to and fro, and in speed."""
    wave = 0.01 * np.sin(40 * np.arange(len(run.t)) if not run.refused else 0)
    return with_arrays(run, q=lambda r: r.q + wave[:, None], nu=lambda r: r.nu + 10 * wave[:, None])


def away(run):
    """Leaves for good half-way."""
    return with_arrays(
        run, q=lambda r: r.q + np.maximum(0, r.t - r.t[-1] / 2)[:, None] * [1.0, -2.0, 0, 0, 0]
    )


def backward(run):
    """Drives the other way."""
    return with_arrays(run, nu=lambda r: -r.nu)


def still(run):
    """Never starts."""
    return with_arrays(run, q=lambda r: np.tile(r.q[0], (len(r.t), 1)), nu=lambda r: 0 * r.nu)


def across(run):
    """Comes from the other side of y = x."""
    return with_arrays(run, q=lambda r: r.q[:, [1, 0, 2, 3, 4]])


def slow(run):
    """Takes three times as long."""
    return with_arrays(run, t=lambda r: 3 * r.t)


def weak(run):
    """A tenth of the torque, and of the motion."""
    return with_arrays(run, tau=lambda r: r.tau / 10, nu=lambda r: r.nu / 10)


def wrong(run):
    """Slips, and the C is not the model."""
    return dataclasses.replace(run, slip=1e-6, integral=1e-6, agreement=1e-6)


def other(run):
    """A start that was refused for another reason."""
    return dataclasses.replace(run, refused="no such path") if run.refused else run


# The others are doctored in test_figures_more
OURS = [*line.FIGURES, *circle.FIGURES, *masses.FIGURES, *beyond.FIGURES]
DOCTORED = [beside, trembling, away, backward, still, across, slow, weak, wrong, other]


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("name", [figure.name for figure in OURS])
def test_every_claim_can_fail(name):
    """Of runs that were tampered with, or that stand under one another's labels,
    some make each claim come out otherwise."""
    made = figure_of(name)
    labels = list(made.runs)
    first = made.runs[labels[0]]
    variants = [{label: doctor(run) for label, run in made.runs.items()} for doctor in DOCTORED]
    variants += [
        {label: doctor(run) if k % 2 else run for k, (label, run) in enumerate(made.runs.items())}
        for doctor in DOCTORED
    ]
    variants += [dict(zip(labels, reversed(made.runs.values()), strict=True)), dict.fromkeys(labels, first)]
    otherwise = {claim.text: 0 for claim in made.claims}
    for runs in variants:
        for claim, doctored in zip(made.claims, made.figure.all_claims(runs), strict=True):
            otherwise[claim.text] += claim.holds != doctored.holds
    assert [text for text, count in otherwise.items() if not count] == []


# -- making figures, and the report --------------------------------------------------------------------------


def draw_tiny(runs):
    figure, (axes,) = panels("speed", height=2.0)
    for label, run in runs.items():
        axes.plot(run.t, run.speed, label=label)
    over_time(axes, "speed (m/s)")
    return figure


def claims_tiny(runs):
    fast = max(float(run.speed.max()) for run in runs.values())
    return [Claim("it <moves> & more", f"{fast:.2f} m/s", fast > 0.1, paper=True)]


def claims_of_a_wrong_sentence(runs):
    return [
        Claim("it flies", "no", False, note="it has wheels", paper=True, expected=False),
        *claims_tiny(runs),
    ]


def claims_that_fail(runs):
    return [Claim("it is fast", "no", False)]


def claims_found_wrong_that_hold(runs):
    return [Claim("it rolls", "yes", True, expected=False)]


def tiny(claims=claims_tiny, name="tiny", **cases) -> Figure:
    cases = cases or {
        "slow": Case("figure_8.toml", SHORT),
        "fast": Case("figure_8.toml", {**SHORT, "initial.speed": 6.0}),
    }
    return Figure(
        name, f"{name}: a <small> one", "Says & shows little.", "nearly all", cases, draw_tiny, claims
    )


@pytest.mark.nightly
def test_the_same_bytes_each_time_and_each_spec_once(monkeypatch):
    done = []
    # What the file says
    figures = [tiny(), tiny(name="again", one=Case("figure_8.toml", {**SHORT, "initial.speed": 5.0}))]
    with runs_here():
        first = produce(figures, 1, done.append)
    second = produce(figures, 2, done.append)  # in two other processes
    assert [made.figure.name for made in done] == ["tiny", "again"] * 2
    assert first[0].runs["slow"] is first[1].runs["one"]
    assert [made.pictures for made in first] == [made.pictures for made in second]
    assert report(first) == report(second)
    assert first[0].pictures["png"].startswith(b"\x89PNG") and b"<svg" in first[0].pictures["svg"]
    assert b"<dc:date>" not in first[0].pictures["svg"]
    comment, *lines = first[0].pictures["csv"].decode().splitlines()
    assert comment == f"# {MARK}"
    table = list(csv.DictReader(lines))
    for label, run in first[0].runs.items():
        rows = [row for row in table if row["curve"] == label]
        assert {(row["panel"], row["y_label"]) for row in rows} == {("speed", "speed (m/s)")}
        points = np.array([[row["x"], row["y"]] for row in rows], float)
        assert points == pytest.approx(np.stack([run.t, run.speed], axis=1), rel=1e-8)


def test_data_of_all_kinds_of_plots():
    """Lines, scatters and bars; what is placed relative to the panel is no data."""
    figure, (axes,) = panels("all")
    axes.plot([1.0, 2.0], [3.0, 4.0], label="line")
    axes.axhline(5.0)
    axes.scatter([6.0], [7.0], label="scatter")
    axes.bar([8.0], [9.0], label="bar")
    axes.barh([10.0], [11.0], label="lying")
    rows = csv.DictReader(plotted(figure).splitlines()[1:])
    found = [(row["curve"], float(row["x"]), float(row["y"])) for row in rows]
    assert found == [("line", 1, 3), ("line", 2, 4), ("scatter", 6, 7), ("bar", 8, 9), ("lying", 11, 10)]


@pytest.mark.nightly
def test_a_spec_that_cannot_be_run_is_bad_input():
    with pytest.raises(BadInput, match="unknown key 'mass'"):
        produce([tiny(one=Case("figure_8.toml", {"plant.mass": 1.0}))], 1, lambda made: None)
    with pytest.raises(BadInput, match="no such file|No such file"):
        produce([tiny(one=Case("figure_0.toml"))], 1, lambda made: None)


def test_a_process_that_dies_is_said(monkeypatch):
    monkeypatch.setattr(
        production, "WORKER", (sys.executable, "-c", "import sys; sys.stdin.buffer.read(1); sys.exit(3)")
    )
    with pytest.raises(RuntimeError, match="ended with code 3"):
        produce([tiny()], 1, lambda made: None)


@pytest.fixture(scope="module")
def small() -> list[Made]:
    """Three tiny figures: all holds, a sentence that was found wrong, claims that fail."""
    claims = (claims_tiny, claims_of_a_wrong_sentence, claims_that_fail, claims_found_wrong_that_hold)
    with runs_here():
        return produce([tiny(c, name=c.__name__) for c in claims], 1, lambda made: None)


@pytest.mark.nightly
def test_the_report_needs_no_other_file(small):
    text = report(small)
    pictures = re.findall(r'<img [^>]*src="data:image/svg\+xml;base64,([^"]+)">', text)
    assert [base64.b64decode(picture) for picture in pictures] == [made.pictures["svg"] for made in small]
    rest = re.sub(r"base64,[^\"]+", "", text)
    assert "http" not in rest and "<script" not in rest and "<link" not in rest and "url(" not in rest
    assert re.findall(r'(?:src|href)="(?!data:|#)', rest) == []
    ids = re.findall(r' id="([^"]+)"', rest)
    assert len(set(ids)) == len(ids) and set(re.findall(r'href="#([^"]+)"', rest)) <= set(ids)


def test_the_report_tells_everything(small):
    text = report(small)
    assert "it &lt;moves&gt; &amp; more" in text and "<moves>" not in text and "a &lt;small&gt; one" in text
    assert "initial.speed = 6.0" in text and "<mark>assumed</mark>" in text and "nearly all" in text
    for name, digest in small[0].runs["slow"].sources.items():
        assert f"<code>{name}</code></td>" in text and digest in text
    spec = (SPECS / "figure_8.toml").read_text().splitlines()[0]
    assert spec in text and noslip.__version__ in text and "m_c" in text


def test_claims_of_several_figures_are_folded_where_they_hold(small):
    def unfolded(*made):
        return re.sub(r"<details>.*?</details>", "", report(made), flags=re.S)

    assert "in every run" in unfolded(small[0]) and "in every run" not in unfolded(*small)
    assert "in every run" in report(small) and "it is fast" in unfolded(small[2], small[2])  # it fails


def test_outcomes_are_counted(small):
    own = [
        dataclasses.replace(made, claims=[c for c in made.claims if "every run" not in c.text])
        for made in small
    ]
    assert [summary([made]) for made in own] == [
        "1 claim holds",
        "1 claim holds, 1 does not (as found here)",
        "0 claims hold, 1 FAILS: it is fast",
        "0 claims hold, 1 FAILS: it rolls",
    ]
    assert summary([dataclasses.replace(small[0], claims=[])]) == "no claims"
    assert by_whom(own[1:3]) == [
        "claims of the paper: 1 claim holds, 1 does not (as found here)",
        "claims of this project: 0 claims hold, 1 FAILS: it is fast",
    ]
    top = report(small).split("<table>")[0]
    assert (
        "It flies" not in top
        and "it flies: does not hold (as found here)" in top
        and "it is fast: FAILS" in top
    )


# -- command line --------------------------------------------------------------------------------------------


@pytest.fixture
def catalogued(monkeypatch):
    """Puts other figures in the place of the real ones."""
    return lambda *figures: monkeypatch.setattr(catalogue, "FIGURES", figures)


def test_figures_are_written(catalogued, tmp_path, capsys):
    catalogued(tiny(), tiny(claims_of_a_wrong_sentence, "wrong"))
    target = tmp_path / "new" / "figures"
    assert main(["figures", "-o", str(target), "--jobs", "1"]) == 0
    files = {f"figure_{name}.{kind}" for name in ("tiny", "wrong") for kind in ("csv", "png", "svg")} | {
        "report.html"
    }
    assert {path.name for path in target.iterdir()} == files
    out, err = capsys.readouterr()
    counted = (
        "claims of the paper: 2 claims hold, 1 does not (as found here); claims of this project: 6 "
        "claims hold"
    )
    assert out == f"{target}/report.html: 2 figures; {counted}\n"
    lines = err.splitlines()
    assert lines[0].startswith("[ 1/2] figure tiny: 4 claims hold") and lines[1].startswith(
        "[ 2/2] figure wrong: "
    )
    (target / "mine.txt").write_text("mine")
    with runs_here():
        assert main(["figures", "-o", str(target), "--only", "tiny", "--json"]) == 0
    assert {path.name for path in target.iterdir()} == files | {"mine.txt"}
    (answer,) = json.loads(capsys.readouterr().out)
    assert (
        answer["figure"] == "tiny"
        and answer["claims"][0]["holds"] is True
        and answer["runs"]["slow"]["slip"] < 1e-11
    )


@pytest.mark.parametrize("claims", [claims_that_fail, claims_found_wrong_that_hold])
def test_a_claim_that_fails_is_exit_1(claims, catalogued, tmp_path, capsys):
    catalogued(tiny(claims))
    with runs_here():
        assert main(["figures", "-o", str(tmp_path / "out"), "--jobs", "1"]) == 1
    assert "1 FAILS" in capsys.readouterr().out and (tmp_path / "out" / "report.html").exists()


def test_a_case_that_cannot_be_run_leaves_nothing(catalogued, tmp_path, bad_input):
    catalogued(tiny(one=Case("figure_8.toml", {"output.path.R": -1.0})))
    with runs_here():
        assert "R" in bad_input(["figures", "-o", str(tmp_path / "new" / "out")])


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["--only", "sampeld"], "did you mean 'sampled'?"),
        (["--only", "6", "8"], "unknown figure '8'"),
        (["--jobs", "0"], "must be 1 or more"),
        (["--jobs", "many"], "see noslip"),
        (["--all", "--only", "6"], "not allowed with"),
    ],
)
def test_wrong_options(argv, said, bad_input, tmp_path):
    assert said in bad_input(["figures", "-o", str(tmp_path / "out"), *argv])


@pytest.mark.parametrize("place", ["file", "file/inside", "loop"])
def test_places_that_are_no_folder(place, bad_input, tmp_path):
    (tmp_path / "file").write_text("mine")
    (tmp_path / "loop").symlink_to("loop")
    bad_input(["figures", "-o", str(tmp_path / place)])


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="no /proc here")
def test_where_nothing_can_be_written(bad_input):
    """/proc takes no files, whoever asks; that is known before anything runs."""
    bad_input(["figures", "-o", "/proc/noslip"])


@pytest.mark.parametrize("wait", [0.5, 2.0])
def test_ctrl_c_leaves_nothing(wait, tmp_path):
    process = subprocess.Popen(
        [*NOSLIP, "figures", "-o", str(tmp_path / "new" / "out")], stderr=subprocess.PIPE
    )
    time.sleep(wait)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode in (130, -signal.SIGINT)
    assert (
        err.decode().splitlines()[-1:] in (["noslip: interrupted"], []) or "KeyboardInterrupt" in err.decode()
    )
    assert not list(tmp_path.iterdir())


def test_make_knows_figures():
    asked = ["make", "-n", "-C", str(ROOT), "-o", "build/generated.stamp", "figures"]
    said = subprocess.run(asked, capture_output=True, text=True, env={**os.environ, "MAKEFLAGS": ""})
    assert said.returncode == 0, said.stderr
