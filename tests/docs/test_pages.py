"""Each block of code in the pages is run, compiled or read by a test:
by one that a comment before it names, or by one here."""

import re
import subprocess
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import noslip
import pytest
from noslip import Mechanism
from noslip.cli.main import main
from noslip.codegen.runtime import RUNTIME
from noslip.simulation.specification.vary import read_varied

ROOT = Path(noslip.__file__).parent
FURTHER = (ROOT / "checks/guarantees/README.md", ROOT / "examples/playground/README.md")
PAGES = [ROOT / "README.md", *sorted(ROOT.glob("docs/*.md")), *FURTHER]
# Run as a whole by test_tutorial, test_api and test_agv
WHOLE = {"docs/your_robot.md", "docs/api.md", "docs/agv.md"}
# Commands besides noslip in sh blocks
OTHERS = r"make\b|cmake\b|pip |dask |platformio |west |idf.py |\.venv/bin/|cc |cd |sh "
DECLARED = {  # what a piece of C takes for granted
    "docs/estimator.md": """#include "labmate_ekf_f.h"
        extern labmate_ekf_f ekf; extern float turned[2], gyro, dt; extern noslip_pose_f pose;
            extern noslip_fix_f fix;""",
    "docs/extension.md": """#include "labmate_type_i_extended.h"
        extern labmate_params params; extern labmate_type_i_extended_config config;
            extern labmate_type_i_extended_gains gains;
        extern labmate_options options; extern labmate_state state;
            extern labmate_type_i_extended_reference reference;
        extern double tau[2];""",
    "docs/underactuated.md": '#include "balancer_lqr.h"',
    "docs/grip.md": """#include "labmate_type_iv_line_f.h"
        extern labmate_type_iv_line_f law; extern labmate_state_f state; extern float v[2];""",
}
GENERATED = {  # by `noslip generate`
    "docs/estimator.md": "labmate --output ekf --scale thetadot_r --scale thetadot_l",
    "docs/extension.md": "labmate --output type_i_extended",
    "docs/underactuated.md": "balancer --lqr pitch=10 x=40 phi=20 speed=1 pitch_rate=0.1 yaw_rate=0.5",
}

FENCED = re.compile(
    r"(?:<!-- (?:run|compiled) by (tests/\w+/\w+\.py) -->\n)?^```(\w*)\n(.*?)^```$", re.S | re.M
)


class Block(NamedTuple):
    """A block of code of a page."""

    page: str  # from the root
    line: int
    language: str
    test: str | None  # that a comment before it names
    text: str

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"


def blocks() -> Iterator[Block]:
    for path in PAGES:
        page = path.read_text()
        for match in re.finditer(
            r"(?:<!-- (?:run|compiled) by (tests/\w+/\w+\.py) -->\n)?^```(\w*)\n(.*?)^```$", page, re.S | re.M
        ):
            line = page[: match.start(2)].count("\n") + 1
            yield Block(str(path.relative_to(ROOT)), line, match[2], match[1], match[3])


BLOCKS = list(blocks())
HERE = [block for block in BLOCKS if block.test is None and block.page not in WHOLE]


def settings(table: dict[str, Any]) -> dict[str, Any]:
    """The entries of the tables of a SPEC, as dotted key -> value."""
    return {f"{name}.{key}": value for name, entries in table.items() for key, value in entries.items()}


def of(*languages: str) -> list[Any]:
    return [pytest.param(block, id=str(block)) for block in HERE if block.language in languages]


def test_every_block_has_a_test():
    """None is of a language that nothing here runs; a test that a comment names mentions the page."""
    assert len(BLOCKS) > 50
    assert {block.language for block in HERE} <= {"sh", "toml", "c", "python", "bibtex", "text"}
    for block in BLOCKS:
        if block.test:
            assert Path(block.page).name in (ROOT / block.test).read_text(), block


@pytest.mark.parametrize("block", of("sh"))
def test_commands_are_of_noslip_or_known(block):
    """tests/cli/test_package.py runs those of noslip."""
    text = re.sub(r"'[^']*'|\"[^\"]*\"", "''", block.text.replace("\\\n", ""))  # strings may have lines
    for line in text.splitlines():
        assert not line or re.match(rf"noslip |#|{OTHERS}", line), line


@pytest.mark.parametrize("block", of("toml"))
def test_settings_are_valid(block):
    """A SPEC, or tables that change one, after those that the page has shown before."""
    table = tomllib.loads(block.text)
    if "robot" in table:
        assert read_varied("line", table)
        return
    before = [
        tomllib.loads(other.text) for other in HERE if (other.page, other.language) == (block.page, "toml")
    ]
    shown = before[: before.index(table) + 1]
    changes = {key: value for each in shown for key, value in settings(each).items()}
    assert read_varied("waypoints", changes)


@pytest.mark.nightly
@pytest.mark.parametrize("page", DECLARED)
def test_c_compiles(page, tmp_path):
    """Each piece as the body of a function, after declarations of what it uses."""
    if page in GENERATED:
        assert main(["generate", *GENERATED[page].split(), "-o", str(tmp_path)]) == 0
    pieces = [block for block in HERE if (block.page, block.language) == (page, "c")]
    assert pieces
    for number, piece in enumerate(pieces):
        file = tmp_path / f"page{number}.c"
        declared = "" if "int status" in piece.text else "int status = 0;\n"
        file.write_text(
            f"{DECLARED[page]}\nint page(void);\nint page(void)\n{{\n{declared}{piece.text}return "
            "status;\n}\n"
        )
        folders = [
            f"-I{folder}"
            for folder in (tmp_path / "labmate", tmp_path / "balancer", ROOT / "generated/labmate", RUNTIME)
        ]
        run = subprocess.run(
            ["cc", "-std=c99", "-Wall", "-Wno-unused", "-Werror", "-fsyntax-only", *folders, file],
            capture_output=True,
        )
        assert run.returncode == 0, f"{piece}\n{run.stderr.decode()}"


@pytest.mark.parametrize("block", of("python"))
def test_statements_about_a_robot(block):
    """On a robot that has what the piece names."""
    robot = Mechanism("page", "a body with a wheel")
    names: dict[str, Any] = {name: robot.coordinate(name, "m") for name in ("x", "y", "theta_f")}
    names |= {
        name: robot.parameter(name, 1.0, "kg", "a mass or a length")
        for name in ("mass", "mass_on_castor", "b")
    }
    names |= {"robot": robot, "slip": robot.rate(names["x"]), "sideways": robot.rate(names["y"])}
    before = [len(robot.inputs), len(robot.contacts), len(robot.outputs)]
    exec(block.text, names)
    assert [len(robot.inputs), len(robot.contacts), len(robot.outputs)] != before
