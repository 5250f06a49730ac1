"""The structure of the package: imports go one way between rooms,
no module imports itself by way of others."""

import ast
import os
from collections import Counter, defaultdict
from pathlib import Path

import noslip
import pytest
from noslip.tests.mutation import files_of

ROOT = Path(noslip.__file__).parent
# Each room imports from those before it only. Imports inside functions count as well.
ROOMS = (*("model", "readers", "codegen", "simulation", "analysis", "examples", "checks", "cli"),)
MOST_FILES = 16  # in one folder
MOST_TESTS = 40  # files in one folder of tests
LARGEST_SHARE = 0.3  # of all lines, in one room


def modules(root: Path = ROOT) -> dict[tuple[str, ...], Path]:
    """The modules of all rooms, by their names below the package."""
    files = [
        Path(folder, name) for room in ROOMS for folder, _, names in os.walk(root / room) for name in names
    ]
    python = [file for file in files if file.suffix == ".py" and "__pycache__" not in file.parts]
    return {file.relative_to(root).with_suffix("").parts: file for file in python}


def imported(name: tuple[str, ...], source: str, paths: dict[tuple[str, ...], Path]) -> set[tuple[str, ...]]:
    """The modules of `paths` that a module imports, at its top or inside a function."""
    targets = set()
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.ImportFrom):
            continue
        if node.level:
            base = name[: len(name) - node.level]
        elif (node.module or "").split(".")[0] == "noslip":
            base = ()
        else:
            continue
        own = (node.module or "").split(".") if node.module else []
        base = (*base, *(own if node.level else own[1:]))
        for alias in node.names:
            candidates = ((*base, alias.name), base, (*base, "__init__"))
            targets.update(next(([c] for c in candidates if c in paths), []))
    return targets - {name}


def arrows(paths: dict[tuple[str, ...], Path]) -> dict[tuple[str, ...], set[tuple[str, ...]]]:
    """Module -> modules that it imports."""
    return {name: imported(name, file.read_text(), paths) for name, file in paths.items()}


def circle(graph: dict[tuple[str, ...], set[tuple[str, ...]]]) -> list[str]:
    """Modules that import each other in turn; empty where there are none."""
    left = {name: set(targets) for name, targets in graph.items()}
    while leaves := [name for name, targets in left.items() if not targets & left.keys()]:
        for name in leaves:
            del left[name]
    return sorted("/".join(name) for name in left)


def upward(graph: dict[tuple[str, ...], set[tuple[str, ...]]]) -> list[str]:
    """Imports from a room that comes later."""
    return [
        f"{'/'.join(name)} imports {'/'.join(target)}"
        for name, targets in graph.items()
        for target in targets
        if ROOMS.index(target[0]) > ROOMS.index(name[0])
    ]


def test_imports_go_one_way():
    graph = arrows(modules())
    assert circle(graph) == []
    assert upward(graph) == []


@pytest.mark.parametrize(
    "name, line",
    [
        (("model", "law"), "from ..cli.main import main"),
        (("simulation", "controllers", "compiled"), "from .backends import x"),
    ],
)
def test_a_planted_import_is_found(name, line):
    """Upward, or in a circle, and inside a function."""
    paths = modules()
    graph = arrows(paths)
    graph[name] = imported(name, f"{paths[name].read_text()}\ndef planted():\n    {line}\n", paths)
    assert circle(graph) + upward(graph)


def test_every_room_is_named_and_of_a_size_to_walk_through():
    paths = modules()
    folders = Counter(file.parent.relative_to(ROOT) for file in paths.values() if file.name != "__init__.py")
    assert max(folders.values()) <= MOST_FILES, folders.most_common(3)
    lines = defaultdict(int)
    for name, file in paths.items():
        lines[name[0]] += len(file.read_text().splitlines())
    assert max(lines.values()) <= LARGEST_SHARE * sum(lines.values()), lines
    for folder in folders:
        text = ROOT.joinpath(folder, "__init__.py")
        described = text.is_file() and ast.get_docstring(ast.parse(text.read_text()))
        assert described or ROOT.joinpath(folder, "README.md").is_file(), (
            f"{folder} says nowhere what it holds"
        )


def test_tests_are_in_the_folders_of_what_they_test():
    """A folder at the top with Python in it is a room; each folder of tests has the name of one at the top,
    but for two."""
    top = {Path(name).parts[0] for name in files_of(ROOT) if "/" in name and name[0] != "."}
    python = {
        path.relative_to(ROOT).parts[0] for path in ROOT.glob("*/**/*.py") if "__pycache__" not in path.parts
    }
    assert (python & top) - {"tests", "docs"} == set(ROOMS)
    tested = {path.parent.name for path in ROOT.glob("tests/*/test_*.py")}
    assert tested - top == {"repository"} and set(ROOMS) <= tested
    files = Counter(path.parent for path in ROOT.glob("tests/**/*.py"))
    assert max(files.values()) <= MOST_TESTS, files.most_common(3)


def test_one_name_is_one_class():
    places = defaultdict(list)
    for name, file in modules().items():
        for node in ast.parse(file.read_text()).body:
            if isinstance(node, ast.ClassDef):
                places[node.name].append("/".join(name))
    assert {name: where for name, where in places.items() if len(where) > 1} == {}
