"""The package's own names: documented, imported lazily, and the example of docs/api.md runs."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import noslip
import pytest
from noslip.checks.verification import generate as generation
from noslip.readers.robots import find_robot, law_of, system_of

ROOT = Path(noslip.__file__).parent
PAGE = (ROOT / "docs" / "api.md").read_text()


def test_the_example_runs(monkeypatch):
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    monkeypatch.chdir(ROOT)
    exec(compile(code, "docs/api.md", "exec"), {})


@pytest.mark.parametrize("name", noslip.__all__)
def test_a_name_is_there_and_documented(name):
    assert getattr(noslip, name).__doc__
    assert re.search(rf"^\| .*`{name}[`(]", PAGE, re.MULTILINE), f"docs/api.md does not describe {name}"


def test_type_checkers_see_what_is_imported():
    """The imports for type checkers and the table of modules name the same."""
    (block,) = (
        node for node in ast.parse((ROOT / "__init__.py").read_text()).body if isinstance(node, ast.If)
    )
    modules = {alias.name: statement.module for statement in block.body for alias in statement.names}
    assert modules == noslip._MODULES


def test_importing_the_package_loads_nothing_else():
    code = "import sys, noslip; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert "noslip" in loaded
    assert not [name for name in loaded if name.startswith(("noslip.", "casadi", "numpy", "sympy", "scipy"))]


def test_an_unknown_name():
    with pytest.raises(AttributeError, match="'reduec'"):
        noslip.reduec  # noqa: B018


def test_c_that_differs_is_not_returned(monkeypatch):
    """A sign changed in the text of a step."""
    robot = find_robot("knife_edge")
    system, law = system_of(robot), law_of(robot, "type_i")
    original = generation.robot_files

    def wrong(*arguments):
        files = original(*arguments)
        name = "knife_edge_type_i.c"
        changed = re.sub(r"(tau\[0\] = )", r"\1-", files[name])
        assert changed != files[name]
        return {**files, name: changed}

    monkeypatch.setattr(generation, "robot_files", wrong)
    with pytest.raises(generation.Mismatch, match="knife_edge, type_i, double"):
        generation.generate(system, [law], ["double"], dynamics=False)
