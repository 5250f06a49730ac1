"""Where noslip is run, and with what around it: locales, closed streams,
folders with files that are named like libraries."""

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from noslip.cli.main import main

NOSLIP = [sys.executable, "-m", "noslip"]
SHELL = shlex.join(NOSLIP)
ASCII = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
ROBOT = '''"""Ein Wagen, Rad_größe."""
from casadi import cos, sin
from noslip import Mechanism
from numbers_beside import HALF


def wagen():
    from more_beside import MASS
    robot = Mechanism("wagen", "ein Wagen der Größe ½")
    x, y, phi = robot.coordinate("x", "m"), robot.coordinate("y", "m"), robot.coordinate("phi", "rad")
    m, J = robot.parameter("m", MASS, "kg", "Masse"), robot.parameter("J", HALF, "kg m^2", "Trägheit")
    robot.kinetic_energy(m * (robot.rate(x) ** 2 + robot.rate(y) ** 2) / 2 + J * robot.rate(phi) ** 2 / 2)
    robot.rolls("kein Gleiten", cos(phi) * robot.rate(y) - sin(phi) * robot.rate(x))
    forward = cos(phi) * robot.rate(x) + sin(phi) * robot.rate(y)
    robot.input("push", "N", on=forward)
    robot.input("turn", "N m", on=robot.rate(phi))
    robot.quasi_velocity("v", "m/s", forward)
    robot.quasi_velocity("w", "rad/s", robot.rate(phi))
    robot.moves_in_plane(x, y, phi)
    return robot
'''


@pytest.fixture
def folder(tmp_path) -> Path:
    """A folder with a robot's file, whose own modules are beside it."""
    place = tmp_path / "Räder und Wägen"
    place.mkdir()
    for name, text in {
        "größe": ROBOT,
        "numbers_beside": "HALF = 0.5\n",
        "more_beside": "MASS = 12.0\n",
    }.items():
        (place / f"{name}.py").write_text(text, encoding="utf-8")
    return place


def done(
    command: list[str], folder: Path, surroundings: dict[str, str] | None = None, **streams
) -> subprocess.CompletedProcess:
    """A command of noslip run in a folder."""
    streams = streams or {"capture_output": True}
    return subprocess.run(command, cwd=folder, env=os.environ | (surroundings or {}), timeout=60, **streams)


def said_in_one_line(process: subprocess.CompletedProcess) -> str:
    """What is said on stderr, which is one line, with exit code 2."""
    text = process.stderr.decode()
    assert process.returncode == 2 and text.startswith("noslip: ") and text.count("\n") == 1, text
    return text


def test_text_is_utf8_whatever_the_locale(folder):
    """What is printed, also of file names; what is written is the same, byte for byte."""
    shown = done([*NOSLIP, "glossary", "Phi"], folder, ASCII)
    assert shown.returncode == 0 and shown.stdout.decode().startswith("Φ, Phi\n")
    assert "größe.py: " in said_in_one_line(done([*NOSLIP, "analyse", "größe.py:karren"], folder, ASCII))
    written = {}
    for name, surroundings in {"a": {}, "ö": ASCII}.items():
        process = done(
            [*NOSLIP, "generate", "größe.py:wagen", "--output", "type_i", "-o", name], folder, surroundings
        )
        assert process.returncode == 0, process.stderr
        files = (path for path in (folder / name).rglob("*") if path.is_file())
        written[name] = {path.relative_to(folder / name): path.read_bytes() for path in files}
    assert written["a"] == written["ö"] and any("Größe ½".encode() in text for text in written["a"].values())


def test_files_named_like_libraries_replace_none(folder):
    """Though `python -m` searches the current folder first,
    except what Python itself has imported by then."""
    for name in ("control", "casadi", "numpy", "scipy", "sympy", "cffi", "cli", "model", "readers"):
        (folder / f"{name}.py").write_text(f"raise SystemExit('{name} is shadowed')\n", encoding="utf-8")
    process = done([*NOSLIP, "outer-loop", "größe.py:wagen", "--output", "type_i"], folder)
    assert process.returncode == 0 and "gains" in process.stdout.decode(), process.stderr


def test_modules_beside_two_robots_may_have_one_name(folder, tmp_path, capsys):
    """Each robot has its own; imported with the file and when the robot is made."""
    other = tmp_path / "other"
    other.mkdir()
    for file in folder.glob("*.py"):
        text = (
            file.read_text(encoding="utf-8")
            .replace("HALF = 0.5", "HALF = 0.7")
            .replace("MASS = 12.0", "MASS = 9.0")
        )
        (other / file.name).write_text(text, encoding="utf-8")
    known = set(sys.modules)
    for place, m, J in ((folder, "12.0", "0.5"), (other, "9.0", "0.7")):
        assert main(["generate", f"{place}/größe.py:wagen", "--output", "type_i", "-o", str(place)]) == 0
        text = (place / "wagen/wagen.c").read_text(encoding="utf-8")
        assert f"m = {m}" in text and f"J = {J}" in text
    assert not {"numbers_beside", "more_beside"} & (set(sys.modules) - known)


@pytest.mark.parametrize("closed", [">&-", "<&- >&- 2>&-"])
def test_closed_streams_are_silent(closed, tmp_path):
    """What is written is unharmed: no file takes the number of a stream."""
    command = f"{SHELL} simulate line --set simulation.duration=0.05 -o run.csv {closed}"
    assert subprocess.run(command, shell=True, cwd=tmp_path, capture_output=True, timeout=60).returncode == 0
    lines = (tmp_path / "run.csv").read_text(encoding="utf-8").splitlines()
    assert len(lines) == 7 and all(line.count(",") == lines[0].count(",") for line in lines)
    assert (
        subprocess.run(f"{SHELL} robot {closed}", shell=True, capture_output=True, timeout=60).returncode == 2
    )


def test_a_folder_that_is_gone(tmp_path):
    command = f"rmdir '{tmp_path}'; {SHELL} simulate line -o run.csv"
    process = subprocess.run(command, shell=True, cwd=tmp_path, capture_output=True, timeout=60)
    assert "the current folder no longer exists; change to one that does" in said_in_one_line(process)


def test_a_picture_needs_no_screen(tmp_path):
    (tmp_path / "matplotlib.py").write_text("raise SystemExit('shadowed')\n", encoding="utf-8")
    command = [
        *NOSLIP,
        "simulate",
        "line",
        "--set",
        "simulation.duration=0.05",
        "-o",
        "run.csv",
        "--plot",
        "run.png",
    ]
    assert (
        done(command, tmp_path, {"MPLBACKEND": "none_such"}).returncode == 0
        and (tmp_path / "run.png").exists()
    )


@pytest.mark.parametrize(
    ("command", "says"),
    [
        (["simulate", "line", "-o", ""], "the name of an output is empty"),
        (["simulate", "line", "-o", "run.csv", "--plot", ""], "the name of an output is empty"),
        (["simulate", "line", "-o", "file/run.csv"], "file/run.csv: file is not a folder; choose another"),
        (
            ["simulate", "line", "-o", "none/run.csv"],
            "none/run.csv: the folder none does not exist; create it first",
        ),
        (["analyse", "/dev/null"], "unknown robot '/dev/null'"),
        (["analyse", "*.toml"], "*.toml is a SPEC, where a robot is expected"),
    ],
)
def test_odd_places(command, says, tmp_path, monkeypatch, bad_input):
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    assert says in bad_input(command)
