"""The mutation test itself: it says which changes no test sees, and takes up what is there."""

import subprocess
import sys
from pathlib import Path

import pytest
from noslip.tests.mutation import ROOT, SOURCES, Mutant, c_mutants, equivalent, mutants, python_mutants

C = """\
/* 1 if x > 3, which no mutant in a comment changes. */
static inline int beyond(int x)
{
    return x > 3;
}
"""
PYTHON = '''\
def beyond(x: int, other: int = 3) -> bool:
    """x > 3."""
    return x > 3
'''
LOOKS = """\
from noslip.codegen.beyond import beyond


def test_beyond():
    assert [beyond(x) for x in ({})] == [x > 3 for x in ({})]
"""
COMPILES = """\
import ctypes
import os
import subprocess
from pathlib import Path


def test_beyond(tmp_path):
    (tmp_path / "all.c").write_text('#include "beyond.h"\\nint all(int x); int all(int x) { return \
beyond(x); }')
    here = Path(__file__).parents[1] / "runtime_c"
    command = [os.environ["CC"], "-shared", "-fPIC", f"-I{here}", str(tmp_path / "all.c"), "-o", \
str(tmp_path / "all.so")]
    subprocess.run(command, check=True)
    all = ctypes.CDLL(str(tmp_path / "all.so")).all
    assert [all(x) for x in (-5, 0, 3, 4, 9)] == [0, 0, 0, 1, 1]
"""
RUN = """\
import sys
from pathlib import Path
from noslip.tests.mutation import Source, run
source = {"codegen/beyond.py": Source(("tests/test_looks.py",)), "runtime_c/beyond.h": \
Source(("tests/test_compiles.py",))}
sys.exit(run(Path(sys.argv[1]), source, everything=True, jobs=1, ready=("pytest",)))
"""


def found(folder: Path, points: str, listed: str = "") -> tuple[int, str]:
    """Exit code of a mutation test of a small tree, whose test of Python looks at these points,
    and what it says."""
    tree = {
        "__init__.py": "",
        "codegen/__init__.py": "",
        "codegen/beyond.py": PYTHON,
        "runtime_c/beyond.h": C,
    }
    tree |= {"tests/test_looks.py": LOOKS.format(points, points), "tests/test_compiles.py": COMPILES}
    for name, text in {**tree, "tests/mutation_equivalent.toml": listed}.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    done = subprocess.run(
        [sys.executable, "-c", RUN, str(folder)], capture_output=True, text=True, timeout=300
    )
    assert (folder / "codegen/beyond.py").read_text() == PYTHON and (
        folder / "runtime_c/beyond.h"
    ).read_text() == C
    return done.returncode, done.stdout + done.stderr


@pytest.mark.nightly
def test_a_mutant_that_survives_is_reported(tmp_path):
    """A test that does not look at the border, nor at the other argument."""
    code, said = found(tmp_path, "-5, 9")
    assert code == 1 and said.count("survived") == 3
    for after in ("return x >= 3", "return x > (3 + 1)", "def beyond(x: int, other: int = (3 + 1)) -> bool:"):
        assert f"  + {after}\n" in said
    assert "runtime_c/beyond.h: 3 of 3 killed" in said and "codegen/beyond.py: 1 of 4 killed" in said


@pytest.mark.nightly
def test_mutants_that_are_killed_or_equivalent(tmp_path):
    """One that no test can find is listed and does not count."""
    before = "def beyond(x: int, other: int = 3) -> bool:"
    listed = (
        f'[["codegen/beyond.py"]]\nbefore = "{before}"\nafter = "{before.replace("3", "(3 + 1)")}"\nwhy '
        '= "not used"\n'
    )
    code, said = found(tmp_path, "-5, 3, 4, 9", listed)
    assert code == 0 and "survived" not in said and "6 of 6 killed, 100.0%" in said


@pytest.mark.nightly
def test_tests_that_fail_anyway_are_reported(tmp_path):
    code, said = found(tmp_path, "-5, 9, None")
    assert code == 2 and "codegen/beyond.py: its tests fail" in said, said


def changed(text: str, made: list[Mutant]) -> set[str]:
    """The changed lines."""
    return {mutant.lines(text)[1] for mutant in made}


def test_mutants_of_c():
    text = """int f(const float a[2], int n)
{
    float b[3];
    if (!(a[0] < -1.5f) && n >= 2) {
        b[1] += a[1] * n;
    }
}
"""
    after = changed(text, c_mutants(text, set(range(1, 8))))
    condition = "if (!(a[0] < -1.5f) && n >= 2) {"
    for old, new in (
        ("<", "<="),
        ("<", ">="),
        ("!(", "("),
        ("-1", "1"),
        ("1.5f", "(2 * 1.5f)"),
        ("&&", "||"),
        (">=", ">"),
        ("2", "(2 + 1)"),
        ("[0]", "[(0 + 1)]"),
    ):
        assert condition.replace(old, new) in after
    assert {"if (0 && (!(a[0] < -1.5f) && n >= 2)) {", ";", "b[1] -= a[1] * n;", "b[1] += a[1] / n;"} <= after
    assert not any("float b" in line or "int f" in line for line in after)
    assert not c_mutants(text, set())


def test_mutants_of_python():
    text = (
        'def f(a: "1" = True):\n    "2 + 3"\n    if a and not a < -2:\n        a += 1  # 7 + 8\n    '
        'return [a * 2 - 1, "4"]\n'
    )
    after = changed(text, python_mutants(text))
    assert {
        'def f(a: "1" = False):',
        "if a or not a < -2:",
        "if a and a < -2:",
        "if a and not a <= -2:",
    } <= after
    assert {
        "if a and not a < 2:",
        "pass  # 7 + 8",
        'return [a / 2 - 1, "4"]',
        'return [a * 2 + 1, "4"]',
    } <= after
    assert not any("+ 8 + 1" in line or "3 + 1" in line or "4 + 1" in line for line in after)


@pytest.mark.parametrize("path", SOURCES)
def test_what_is_listed_is_there(path):
    """Sources, their tests, and mutants listed as equivalent, each with a reason."""
    assert all(
        (ROOT / name).is_file()
        for name in SOURCES[path].tests
        if name.startswith("tests/") and "::" not in name
    )
    text = (ROOT / path).read_text()
    made = {mutant.lines(text) for mutant in mutants(ROOT, path)}
    assert len(made) > 10 and equivalent(ROOT).get(path, set()) <= made


def test_every_equivalent_has_a_source():
    assert set(equivalent(ROOT)) <= set(SOURCES)
