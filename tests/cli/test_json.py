"""`--json` on every command, warnings stated once, progress on a terminal only,
and answers kept between runs."""

import csv
import io
import json
import sys

import numpy as np
import pytest
from noslip.cli import COMMANDS
from noslip.cli.commands import parser_of
from noslip.cli.main import main
from noslip.codegen.explain import explain
from noslip.model.robots import ROBOTS, UNDERACTUATED
from noslip.readers import progress
from noslip.readers.files import SHIPPED
from noslip.readers.robots import law_of

CASES = "examples/specs/reference/labmate_paper.json"


def printed(capsys, argv: list[str], code: int = 0):
    """What a command prints with --json, and what it says on stderr."""
    assert main([*argv, "--json"]) == code
    out, err = capsys.readouterr()
    return json.loads(out), err


@pytest.fixture
def slippery(tmp_path):
    """A SPEC whose left wheel alone would slip at its start, a little later also the right one."""
    file = tmp_path / "slippery.toml"
    text = (SHIPPED / "line.toml").read_text().replace("duration = 15.0", "duration = 2.0")
    file.write_text(f"{text}\n[contact]\nmu = 0.2\n")
    return str(file)


def test_every_command_has_it():
    _, commands = parser_of(COMMANDS)
    for name in COMMANDS:
        if name != "plan":
            assert "--json" in commands.choices[name].options
    arguments = parser_of(["plan"])[0].parse_args(
        ["plan", "waypoints", "a.csv", "--tolerance", "1", "--json"]
    )
    assert arguments.json


def test_of_a_run(tmp_path, capsys, slippery):
    """Every number is that of the table, and only what is not finite is null."""
    target = tmp_path / "run.csv"
    data, err = printed(capsys, ["simulate", slippery, "-o", str(target)])
    rows = list(csv.DictReader(io.StringIO(target.read_text())))
    assert not err and data["files"] == [str(target)]
    assert (data["status"], data["rows"], data["duration"]) == ("ok", len(rows), float(rows[-1]["t"]))
    distance = np.array([float(row["y1"]) for row in rows])
    assert data["errors"]["distance"] == {"unit": "m", "final": distance[-1], "peak": np.abs(distance).max()}
    for name in ("tau_r", "tau_l"):
        assert data["inputs"][name]["peak"] == max(abs(float(row[name])) for row in rows)
    contacts = data["rolling"]["contacts"]
    assert not data["rolling"]["rolls"] and data["rolling"]["assumed"]["mu"] == 0.2
    left = contacts["left wheel"]
    assert left["verdict"] == "would slip" and left["first"] == 0.0 and left["friction_required"] > 0.2
    assert left["friction_use"] == pytest.approx(left["friction_required"] / 0.2, rel=1e-12)
    assert contacts["right wheel"]["verdict"] == "rolls" and contacts["right wheel"]["first"] is None


def test_of_a_run_that_stops(tmp_path, capsys):
    argv = [
        "simulate",
        "line",
        "-o",
        str(tmp_path / "run.csv"),
        "--set",
        "output.L=-0.5",
        "--set",
        "initial.heading=1.0",
    ]
    data, err = printed(capsys, argv, 1)
    assert (
        data["status"] == "singular"
        and 0 < data["duration"] < 15
        and "stopped at" in err
        and err.count("\n") == 1
    )


def test_slipping_is_stated_once(tmp_path, capsys, slippery):
    assert main(["simulate", slippery, "-o", str(tmp_path / "run.csv")]) == 0
    out, err = capsys.readouterr()
    assert out.count("would slip") == 1 and not err


@pytest.mark.nightly
def test_analyse_and_simulate_agree_about_slipping(tmp_path, capsys, slippery):
    run, _ = printed(capsys, ["simulate", slippery, "-o", str(tmp_path / "run.csv")])
    argv = ["analyse", "labmate", "--output", "type_iv_line", "--start", slippery]
    data, _ = printed(capsys, argv)
    for rolling in (data["starts"][slippery]["rolling"], data["rolling"]):
        assert rolling["rolls"] is False and rolling["assumed"] == run["rolling"]["assumed"]
        for name, contact in run["rolling"]["contacts"].items():
            assert rolling["contacts"][name] == {
                k: pytest.approx(v, rel=1e-6) if k != "verdict" else v for k, v in contact.items()
            }
    assert main(argv) == 0
    text_of_analyse = " ".join(capsys.readouterr().out.split())
    assert text_of_analyse.count("would slip: left wheel, first at t = 0 s") == 1
    # what is kept of a SPEC is not taken for another's
    with open(slippery, encoding="utf-8") as file:
        text = file.read()
    with open(slippery, "w", encoding="utf-8") as file:
        file.write(text.replace("mu = 0.2", "mu = 0.9"))
    assert printed(capsys, argv)[0]["rolling"]["rolls"] is True


@pytest.mark.nightly
def test_kept_answers_are_those_found(monkeypatch, tmp_path, capsys):
    """As text and as JSON, with nothing kept, from what is kept, and where results cannot be kept."""
    argv = ["analyse", "knife_edge"]
    answers = []
    for cache in ("one", "one", "\0"):
        if cache == "\0":
            (tmp_path / "file").write_text("")
        monkeypatch.setenv("NOSLIP_CACHE", str(tmp_path / ("file/none" if cache == "\0" else cache)))
        answers.append((main(argv), capsys.readouterr().out, printed(capsys, argv)[0]))
    assert answers[0] == answers[1] == answers[2] and "knife_edge" in answers[0][1]


@pytest.mark.nightly
def test_of_other_commands(tmp_path, capsys):
    assert [robot["name"] for robot in printed(capsys, ["robots"])[0]] == [*ROBOTS, *UNDERACTUATED]
    assert printed(capsys, ["laws", "knife_edge"])[0].keys() >= {"type_i"}
    script = printed(capsys, ["completion", "bash"])[0]["script"]
    main(["completion", "bash"])
    assert capsys.readouterr().out == script + "\n"
    data, _ = printed(capsys, ["evaluate", CASES, "--backend", "casadi", "-o", str(tmp_path / "out.json")])
    with open(tmp_path / "out.json", encoding="utf-8") as file:
        assert data["statuses"] == [case["status"] for case in json.load(file)["cases"]]
    assert printed(capsys, ["evaluate", CASES, "--backend", "casadi"])[0].keys() == {"cases"}
    path = ["plan", "reeds-shepp", "--from", "0", "0", "0", "--to", "0", "4", "0", "--radius", "2.5"]
    segments = printed(capsys, path)[0]["segments"]
    data, err = printed(capsys, [*path, "-o", str(tmp_path / "path.json")])
    assert data["segments"] == len(segments) and data["smallest_radius"] == 2.5 and not err
    assert data["files"] == [str(tmp_path / "path.json")] and data["cusps"] == 2


def test_of_generated_files(tmp_path, capsys):
    argv = ["generate", "knife_edge", "--output", "type_i", "--scalar", "double", "-o", str(tmp_path)]
    data, _ = printed(capsys, argv)
    folder = tmp_path / "knife_edge"
    files = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    assert data == {"folder": str(folder), "files": files}
    data, _ = printed(capsys, [*argv, "--check"])
    assert data == {"ok": True, "folder": str(folder), "files": len(files), "different": []}
    (folder / "knife_edge.h").write_text("changed")
    data, err = printed(capsys, [*argv, "--check"], 1)
    assert not data["ok"] and data["different"] == ["knife_edge.h"] and "changed" in err
    data, _ = printed(capsys, [*argv, "--explain"])
    assert data == {"type_i": explain(law_of(ROBOTS["knife_edge"](), "type_i"))}
    exported = tmp_path / "exported"
    data, _ = printed(capsys, ["export", *argv[1:-1], str(exported)])
    assert set(data["files"]) == {path.name for path in exported.iterdir()} and data["laws"] == ["type_i"]


@pytest.mark.parametrize("terminal", [True, False])
def test_progress_on_a_terminal_only(terminal, monkeypatch, capsys):
    """The time left is in proportion to what was done since the first call;
    the line is cleared at the end."""
    now = iter([0.0, 10.0, 12.0, 20.0, 20.1, 30.0])
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(now))
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal)
    with progress.Progress() as report:
        for count in (4, 5, 6, 7):
            report(count, 10, "laws compared")
        report(1, 2, "files")
    out, err = capsys.readouterr()
    assert not out
    if not terminal:
        assert not err
        return
    assert err.split("\r\033[K") == [
        "",
        "4 of 10 laws compared",
        "5 of 10 laws compared, 0:00:10 left",
        "6 of 10 laws compared, 0:00:20 left",
        "1 of 2 files",
        "",
    ]
