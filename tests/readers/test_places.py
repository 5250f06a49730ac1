"""Robot files and SPECs wherever they lie, and commands as people type them: what is beside them,
locales, options, extras."""

import os
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest
from noslip.cli.main import main
from noslip.readers import errors
from noslip.readers.errors import BadInput, installing
from noslip.readers.robots import find_robot
from noslip.tests.tools import NOSLIP

CART = """from casadi import cos, sin
from noslip import Mechanism
{more}

def cart():
    robot = Mechanism("cart", "a cart on a knife edge: größer")
    x, y, phi = robot.coordinate("x", "m"), robot.coordinate("y", "m"), robot.coordinate("phi", "rad")
    m, J = robot.parameter("m", 12.0, "kg"), robot.parameter("J", 0.8, "kg m^2")
    robot.kinetic_energy(m * (robot.rate(x) ** 2 + robot.rate(y) ** 2) / 2 + J * robot.rate(phi) ** 2 / 2)
    robot.rolls("no side slip", cos(phi) * robot.rate(y) - sin(phi) * robot.rate(x))
    forward = cos(phi) * robot.rate(x) + sin(phi) * robot.rate(y)
    robot.input("push", "N", on=forward)
    robot.input("turn", "N m", on=robot.rate(phi))
    robot.quasi_velocity("v", "m/s", forward)
    robot.quasi_velocity("w", "rad/s", robot.rate(phi))
    robot.moves_in_plane(x, y, phi)
    return robot
"""
SPEC = """robot = "labmate"
gains = { kp = 1.0, kd = 2.5, kv = 2.0 }
[output]
type = "IV"
path = { kind = "line", A = 1.0, B = -1.0, C = 0.0 }
[reference]
speed = 1.0
[initial]
point = [0.0, 0.1]
heading = 0.8
speed = 1.0
[simulation]
duration = 0.1
period = 0.01
"""


def run(folder, *argv: str, **environment: str) -> subprocess.CompletedProcess:
    """The command, in a process of its own, in a folder."""
    return subprocess.run(
        [*NOSLIP, *argv], cwd=folder, capture_output=True, env={**os.environ, **environment}
    )


def test_what_lies_beside_a_robot_does_not_replace_a_library(tmp_path):
    """A control.py and others beside the file; a module of another name is found."""
    for name in ("control", "matplotlib", "casadi", "numpy", "types", "scipy", "cffi"):
        (tmp_path / f"{name}.py").write_text("raise RuntimeError('not the library')\n")
    (tmp_path / "helper_of_cart.py").write_text("MASS = 12.0\n")
    (tmp_path / "cart.py").write_text(CART.format(more="from helper_of_cart import MASS\n"), encoding="utf-8")
    done = run(
        tmp_path.parent, "outer-loop", f"{tmp_path}/cart.py:cart", "--output", "type_i", "--period", "10ms"
    )
    assert done.returncode == 0, done.stderr
    assert find_robot(f"{tmp_path}/cart.py:cart").name == "cart" and str(tmp_path) not in sys.path


@pytest.mark.parametrize("locale", [{"LC_ALL": "POSIX", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"}])
def test_files_are_utf_8_whatever_the_locale(locale, tmp_path):
    (tmp_path / "cart.py").write_text(CART.format(more=""), encoding="utf-8")
    done = run(tmp_path, "generate", "cart.py:cart", "--output", "type_i", "-o", "c", **locale)
    assert done.returncode == 0, done.stderr
    assert "größer" in (tmp_path / "c/cart/cart.h").read_text(encoding="utf-8")
    for argv in (
        ("robots",),
        ("glossary", "Phi"),
        ("laws", "cart.py:cart"),
        ("analyse", "cart.py:cart", "--json"),
    ):
        done = run(tmp_path, *argv, **locale, PYTHONIOENCODING="ascii")
        assert done.returncode == 0 and b"Traceback" not in done.stderr, done.stderr


def test_a_byte_order_mark_is_read(tmp_path):
    (tmp_path / "line.toml").write_text(SPEC, encoding="utf-8-sig")
    assert main(["simulate", str(tmp_path / "line.toml"), "-o", str(tmp_path / "run.csv")]) == 0


@pytest.mark.parametrize(
    "typed",
    [
        "--poles -1,-2 --poles speed=-2 --period 10ms",
        pytest.param("--poles=-1,-2 --poles speed=-2 --speed 3.6km/h", marks=pytest.mark.nightly),
        pytest.param("--poles distance=-0.01+5j,-0.01-5j", marks=pytest.mark.nightly),
        pytest.param("--speed=1e-30", marks=pytest.mark.nightly),
    ],
)
def test_options_as_they_are_typed(typed, capsys):
    assert main(["outer-loop", "labmate", "--output", "type_iv_line", *typed.split()]) == 0


def test_settings_as_they_are_typed(tmp_path):
    for setting in ("simulation.backend=cf", "simulation.period=10ms", "simulation.period='10 ms'"):
        argv = [
            "simulate",
            "line",
            "--set",
            "simulation.duration=0.1",
            "--set",
            setting,
            "-o",
            str(tmp_path / "run.csv"),
        ]
        assert main(argv) == 0


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        ("analyse line", "is a SPEC, where a robot is expected"),
        ("generate examples/specs/line.toml -o c", "is a SPEC, where a robot is expected"),
        ("simulate labmate -o OUT", "labmate: a robot, where a file is expected"),
        ("export labmate --output type_i -o OUT", "is the name of a file, where a folder is expected"),
    ],
)
def test_one_thing_for_another_is_answered(argv, said, bad_input, tmp_path):
    assert said in bad_input([word.replace("OUT", str(tmp_path / "x.csv")) for word in argv.split()])


def test_a_drive_by_torque_is_told_how(bad_input, tmp_path):
    (tmp_path / "drive.toml").write_text(SPEC + '[drive]\nkind = "velocity"\nbandwidth = 5.0\n')
    argv = ["simulate", str(tmp_path / "drive.toml"), "-o", str(tmp_path / "run.csv")]
    said = bad_input([*argv, "--set", "drive.kind=torque"])
    assert "--set 'drive={kind=\"torque\"}'" in said
    assert main([*argv, "--set", 'drive={kind="torque"}']) == 0


def test_how_an_extra_is_installed(monkeypatch, tmp_path):
    """In a clone by make; from one, into another environment, by its path; of a wheel by its file,
    with pip or without."""
    root = Path(errors.__file__).resolve().parents[1]
    monkeypatch.setattr(sys, "prefix", str(root / ".venv"))
    assert installing("physics") == f"`make -C {root} setup` installs it"
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    assert installing("physics").endswith(f" install -e '{root}[physics]'` installs it")

    class Distribution:
        def read_text(self, name: str) -> str:
            return '{"url": "file:///home/a%20b/noslip-0.5.0-py3-none-any.whl"}'

    monkeypatch.setattr(errors, "__file__", str(tmp_path / "noslip/readers/errors.py"))
    monkeypatch.setattr(metadata, "distribution", lambda name: Distribution())
    assert "-m pip install '/home/a b/noslip-0.5.0-py3-none-any.whl[physics]'`" in installing("physics")
    monkeypatch.setattr(errors, "find_spec", lambda name: None)
    assert installing("physics").startswith(f"`uv pip install --python {sys.executable} '/home/a b/")


SYMBOLS = "q nu S A M V E tau lambda u v y h J_h Phi Phidot phi psi chi P_l L d b r kp kd kv kappa mu Φ ν"


@pytest.mark.parametrize("symbol", SYMBOLS.split())
def test_symbols_have_a_meaning(symbol, capsys):
    assert main(["glossary", symbol]) == 0 and symbol in capsys.readouterr().out.splitlines()[0].split(", ")


def test_no_robot_of_that_name():
    with pytest.raises(BadInput, match="neither a shipped name"):
        find_robot("lienar")
