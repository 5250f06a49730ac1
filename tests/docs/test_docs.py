"""The pages that name functions and files name what is there."""

import ast
import re
import subprocess
import sys
import types
from functools import cache
from pathlib import Path
from textwrap import indent

import noslip
import pytest
from noslip.codegen import optimize

ROOT = Path(noslip.__file__).parent
FOLDERS = ("", "model", "codegen/derivation")  # where the pages' bare file names are
NAME = re.compile(r"`([A-Za-z_]\w*(?:\.\w+)?)`")
FILE = re.compile(r"(?<![\w/.])[a-z_][\w/]*\.(?:py|h|c|inc|toml)\b")


def file_of(name: str) -> Path:
    """The file a page names, from the root or in one of FOLDERS."""
    return next(path for folder in FOLDERS if (path := ROOT / folder / name).is_file())


@cache
def defined(path: Path) -> frozenset[str]:
    """Functions and classes of a Python file, methods and fields as Class.name;
    the words of any other file."""
    if path.suffix != ".py":
        return frozenset(re.findall(r"\w+", path.read_text(encoding="utf-8")))
    names = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        for item in node.body if isinstance(node, ast.ClassDef) else ():
            name = getattr(item, "name", getattr(getattr(item, "target", None), "id", None))
            names.add(f"{node.name}.{name}")
    return frozenset(names)


def rows(page: str) -> list[list[str]]:
    """The cells of the tables of a page, but for their heads."""
    lines = (ROOT / page).read_text().splitlines()
    return [
        [cell.strip() for cell in line.strip("|").split("|")] for line in lines if re.match(r"\|[^-]", line)
    ]


def missing(cell: str) -> list[str]:
    """Names of a cell that none of the files in the cell defines."""
    files = [file_of(name) for name in FILE.findall(cell)]
    names = set().union(*(defined(path) for path in files))
    return [name for name in NAME.findall(cell) if name not in names]


def test_the_table_of_equations():
    table = [row for row in rows("docs/method.md") if len(row) == 4 and ".py" in row[2]]
    assert len(table) == 19
    for row in table:
        reference, shipped = row[2], row[3]
        assert not missing(reference), row
        assert not FILE.search(shipped) or not missing(shipped), row


def test_quantities_are_followed_through_the_code():
    table = [row for row in rows("docs/method.md") if len(row) == 2 and ".py" in row[0]]
    assert len(table) >= 20
    for row in table:
        assert not missing(row[0]), row


def test_ideas_of_the_derivation():
    stages, taylor = file_of("stages.py"), file_of("taylor.py")
    for row in rows("codegen/derivation/README.md")[1:]:
        names = NAME.findall(row[1])
        assert names or "foot.py" in row[1] or "transmission.py" in row[1]
        assert set(names) <= defined(stages) | defined(taylor), row


@pytest.mark.parametrize(
    "page", [path.relative_to(ROOT) for path in (*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"))], ids=str
)
def test_links(page):
    """Relative links lead somewhere."""
    for target in re.findall(r"\]\(([\w./-]+)\)", (ROOT / page).read_text()):
        assert (ROOT / page).parent.joinpath(target).exists(), target


def test_the_recipe_for_a_pass(monkeypatch, capsys):
    """The pass that the recipe writes, entered in the file as it says,
    finds the root in the recipe's expression."""
    page = (ROOT / "docs/extending.md").read_text()
    blocks = re.findall(r"tests/docs/test_docs.py -->\n```python\n(.*?)^```", page, re.S | re.M)
    methods, entry, tried = blocks
    source = Path(optimize.__file__).read_text(encoding="utf-8")
    for place, text in ((r"^SIGNS = .*$", f"{indent(methods, ' ' * 4)}\n\n\\g<0>"), (r"^PASSES: .*$", entry)):
        source, found = re.subn(place, text, source, flags=re.M)
        assert found == 1
    edited = types.ModuleType(optimize.__name__)
    edited.__package__ = optimize.__package__
    monkeypatch.setitem(sys.modules, optimize.__name__, edited)  # its dataclasses look there
    exec(compile(source, optimize.__file__, "exec"), vars(edited))
    assert len(edited.PASSES) == len(optimize.PASSES) + 1
    exec(tried, {})
    before, after, *_ = capsys.readouterr().out.splitlines()
    assert before.startswith("sums of products [Applied") and after.startswith("squares of roots")
    assert after.endswith("(mul, #0, #1)]")


def test_the_layout_is_that_of_the_tree():
    """Every folder with files in git has a row, and every row a folder;
    no folder but the tests imports one of bench."""
    tracked = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True)
    if tracked.returncode:
        pytest.skip("no git checkout")
    folders = {
        name.split("/")[0] for name in tracked.stdout.splitlines() if "/" in name and not name.startswith(".")
    }
    table = (ROOT / "CONTRIBUTING.md").read_text().partition("## How it is laid out")[2].partition("## ")[0]
    rows = "".join(row.split("|")[1] for row in table.splitlines() if row.startswith("| `"))
    assert set(re.findall(r"`(\w+)/`", rows)) == folders
    imported = re.compile(r"^\s*from (?:noslip\.|\.\.)bench\b", re.M)
    names = [name for name in tracked.stdout.splitlines() if name.endswith(".py")]
    files = [ROOT / name for name in names if not name.startswith(("checks/bench/", "tests/"))]
    assert [path.name for path in files if imported.search(path.read_text())] == []


def test_the_operations_that_the_pages_name():
    """Of the circle's law: the model's, those after the derivation, and those of the C,
    as `generate --explain` prints them."""
    from noslip.codegen.explain import explain
    from noslip.readers.robots import find_robot, law_of

    explained = explain(law_of(find_robot("labmate"), "type_iv_circle"))
    sums = [int(number) for number in re.findall(r"^ +\D+?(?: +\d+){7} +(\d+)$", explained, re.M)]
    pages = ("docs/method.md", "codegen/derivation/README.md")
    method, derivation = (" ".join((ROOT / page).read_text().split()) for page in pages)
    assert f"takes {sums[0]} operations; the C that ships takes {sums[-1]}." in method
    assert (
        f"{sums[0]} operations for `type_iv_circle`; after this derivation there are {sums[1]}, and"
        in derivation
    )
    assert f"passes leave {sums[-1]}." in derivation
