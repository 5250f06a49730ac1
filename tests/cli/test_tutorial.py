"""docs/your_robot.md, run as it stands; a user's own robot in every command,
and her errors by file and line."""

import json
import re
import shlex
import subprocess
from pathlib import Path

import pytest
from noslip.cli.main import main
from noslip.readers.robots import beside, find_robot
from noslip.simulation.specification.spec import read_spec

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "your_robot.md").read_text()
FILES = {"python": ("forklift.py", "conveyor.py", "balancer.py", "variants.py"), "toml": ("lift.toml",)}


def blocks(kind: str) -> list[str]:
    return re.findall(rf"```{kind}\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture
def files(tmp_path, monkeypatch):
    """The page's files, in the current folder."""
    for kind, names in FILES.items():
        for name, text in zip(names, blocks(kind), strict=True):
            assert f"`{name}`" in PAGE
            (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    find_robot.cache_clear()  # names of files are relative here
    yield tmp_path
    find_robot.cache_clear()


def said(command: str, capsys) -> list[str]:
    """The lines that a command of the page prints."""
    words = shlex.split(command)
    if words[0] == "make":
        return subprocess.run(
            words, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=120
        ).stdout.splitlines()
    capsys.readouterr()
    code, (out, err) = main(words[1:]), capsys.readouterr()
    assert code == (2 if err else 0)
    return (out + err).splitlines()


def test_the_page_says_what_is_printed(files, capsys):
    """Every line of it, in its order; where there is no `…` between two lines,
    nothing else is printed there."""
    assert all(len(text.splitlines()) <= 40 for text in blocks("python"))
    for block in blocks("console"):
        for call in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
            command, *expected = call.splitlines()
            printed, place, gap = said(command, capsys), 0, False
            for line in expected:
                if line == "…":
                    gap = True
                    continue
                assert line in printed[place:], f"{command}: {line}\n" + "\n".join(printed)
                at = printed.index(line, place)
                assert gap or at == place, f"{command}: {printed[place]}"
                place, gap = at + 1, False
            assert gap or place == len(printed), f"{command}: {printed[place:]}"


# -- a robot of a file in every command ----------------------------------------------------------------------

CART = """
from casadi import SX, cos, sin
from noslip.model import Mechanism


def parts():
    robot = Mechanism("cart")
    x, y, phi = robot.coordinate("x", "m"), robot.coordinate("y", "m"), robot.coordinate("phi", "rad")
    m = robot.parameter("m", 12.0, "kg")
    forward = cos(phi) * robot.rate(x) + sin(phi) * robot.rate(y)
    robot.kinetic_energy(m * (robot.rate(x) ** 2 + robot.rate(y) ** 2) / 2 + robot.rate(phi) ** 2)
    robot.input("push", "N", on=forward)
    robot.input("turn", "N m", on=robot.rate(phi))
    robot.quasi_velocity("v", "m/s", forward)
    robot.quasi_velocity("omega", "rad/s", robot.rate(phi))
    robot.moves_in_plane(x, y, phi)
    return robot, cos(phi) * robot.rate(y) - sin(phi) * robot.rate(x)


def cart():
    robot, sideways = parts()
    robot.rolls("no side slip", sideways)
    return robot
"""
SPEC = """
robot = "cart.py:cart"
output = { type = "IV", L = 0.3, path = { kind = "line", A = 0.0, B = 1.0, C = 0.0 } }
reference = { speed = 0.5 }
initial = { q = [0.0, 0.2, 0.1] }
simulation = { duration = 0.2 }
"""
CASE = {
    "params": {"m": 12.0},
    "output": {"type": "I", "L": 0.3},
    "q": [0, 0, 0.1],
    "nu": [0, 0],
    "gains": {"kp": 1, "kd": 2},
}
CASE["reference"] = {"y": [0.5, 0.1], "yd": [0, 0], "ydd": [0, 0]}
COMMANDS = (
    "generate robots/cart.py:cart --output type_i --output dynamics -o c",
    "check --robot robots/cart.py:cart --output type_i --states 20",
    "analyse robots/cart.py:cart --output type_i --start robots/cart.toml",
    "evaluate robots/cases.json --backend c -o out.json",
    "simulate robots/cart.toml -o run.csv",
    "outer-loop robots/cart.py:cart --output type_iv_line --speed 0.5 --L 0.3",
    "outer-loop robots/cart.py:cart --spec robots/cart.toml",
    "export robots/cart.py:cart --output type_i -o exported",
    "export robots/cart.py:cart --output type_i --firmware generic -o firmware",
)


@pytest.fixture(scope="module")
def cart(tmp_path_factory):
    """A folder with a folder of the user's: robot, SPEC and cases."""
    folder = tmp_path_factory.mktemp("user")
    (folder / "robots").mkdir()
    (folder / "robots" / "cart.py").write_text(CART)
    (folder / "robots" / "cart.toml").write_text(SPEC)
    (folder / "robots" / "cases.json").write_text(json.dumps({"robot": "cart.py:cart", "cases": [CASE]}))
    return folder


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: " ".join(command.split()[:1]))
def test_a_robot_of_a_file_in_every_command(cart, monkeypatch, capsys, command):
    """SPEC and cases find it beside themselves."""
    monkeypatch.chdir(cart)
    assert main(command.split()) == 0, capsys.readouterr().err


def test_a_robot_is_looked_for_beside_the_spec_first(cart, monkeypatch):
    monkeypatch.chdir(cart)
    assert read_spec("robots/cart.toml").robot == "robots/cart.py:cart"
    assert beside("cart.py:cart:3", "robots/spec.toml") == "robots/cart.py:cart:3"
    for name in ("labmate", "tractor_trailer:4", "elsewhere.py:cart", str(cart / "robots" / "cart.py:cart")):
        assert beside(name, "robots/spec.toml") == name  # the current folder's, a shipped one, or where it is


# -- errors by file and line ---------------------------------------------------------------------------------

WRONG = {  # body of the function -> which of its lines is wrong, and what is said
    "raises": (["robot, s = parts()", "length = 1 / 0"], 2, "ZeroDivisionError: division by zero"),
    "python": (["robot, s = parts()", "robot.rolls('a', side)"], 2, "NameError: name 'side' is not defined"),
    "typo": (["robot, s = parts()", "robot.rols('a', s)"], 2, "did you mean 'rolls'?"),
    "unit": (["robot, s = parts()", "robot.parameter('k', 1.0, 5)"], 2, "k: unit 5 must be text"),
    "symbol": (
        ["robot, s = parts()", "k = 2", "robot.rolls('a', s + SX.sym('z'))", "return robot"],
        3,
        "uses z, which is no",
    ),
    "bent": (
        ["robot, s = parts()", "robot.rolls('a', s)", "robot.rolls('b', s * s)", "return robot"],
        3,
        "is not linear",
    ),
    "cubic": (
        ["robot, s = parts()", "robot.rolls('a', s)", "robot.kinetic_energy(s**3)", "return robot"],
        3,
        "is not quadratic",
    ),
    "return": (["robot, s = parts()", "robot.rolls('a', s)"], 0, "is `return` missing?"),
    "number": (["return 3"], 0, "it returns int"),
}


@pytest.mark.parametrize("why", WRONG)
def test_an_error_names_file_and_line(tmp_path, bad_input, why):
    body, line, message = WRONG[why]
    lines = [*CART.splitlines(), "", "", "def wrong():", *(f"    {each}" for each in body)]
    file = tmp_path / "wrong.py"
    file.write_text("\n".join(lines) + "\n")
    place = f"{file}:{len(lines) - len(body) + line}: "
    error = bad_input(["check", "--robot", f"{file}:wrong"])
    assert place in error and message in error
    if why != "cubic":  # what is known of constraints does not need it
        assert place in bad_input(["analyse", f"{file}:wrong"])


def test_an_error_in_a_users_output_names_its_line(tmp_path, bad_input):
    file = tmp_path / "wrong.py"
    more = [
        "",
        "def wrong():",
        "    robot = cart()",
        "    robot.output('one', 'x', [('a', 'm', robot['x'])])",
        "    return robot",
    ]
    file.write_text("\n".join([*CART.splitlines(), *more]) + "\n")
    error = bad_input(["check", "--robot", f"{file}:wrong", "--output", "one"])
    assert f"{file}:{len(CART.splitlines()) + 4}: cart, output one: 1 output for n - m = 2" in error
