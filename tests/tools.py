"""Tools that tests run, and what becomes of a test where one is not installed."""

import re
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

import pytest
from noslip.simulation.controllers.targets import PACKAGES, missing, required

ROOT = Path(__file__).resolve().parent.parent
COMPILERS = [name for name in ("gcc", "clang") if shutil.which(name)]  # for this host
HOST_CC = (*COMPILERS, "cc")[0]
# The command, in a process
NOSLIP = [sys.executable, "-c", "import sys; from noslip.cli.main import main; sys.exit(main())"]


def path_of(name: str) -> str:
    """Return where a test file is, from the repository's root: `test_model` is tests/model/test_model.py."""
    (path,) = ROOT.glob(f"tests/*/{name}.py")
    return path.relative_to(ROOT).as_posix()


def collected(marked: str, *chosen: str) -> list[str]:
    """Return the names of tests with these marks, among those that arguments of pytest choose."""
    command = [sys.executable, "-P", "-m", "pytest", "-n", "0", "--collect-only", "-m", marked, *chosen]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True).stdout
    return re.findall(r"^tests/\w+/test_\w+\.py::.+", listed, re.M)


def skip_without(absent: Sequence[str]) -> None:
    """Skip the test if tools are absent; where they are required, it fails."""
    if absent:
        (pytest.fail if required() else pytest.skip)(f"{', '.join(absent)} not installed")


def need(*tools: str) -> str:
    """The first of these tools. Skips the test if one is absent."""
    skip_without(missing(*tools))
    return tools[0]


def lacking(reasons: Iterable[str]) -> str:
    """Return in one line which packages would bring what tests were skipped for, and how many each; empty:
    none.

    `reasons`: those of the skipped tests, as `need`, `pytest.importorskip` and the checks of guarantees/ word
    them.
    """
    counts: Counter[str] = Counter()
    for reason in reasons:
        if words := re.search(r"(\S+(?:, \S+)*)(?: is)? not installed", reason):
            counts.update({PACKAGES.get(tool, tool) for tool in words[1].split(", ")})
        elif words := re.search(r"install (\S+)", reason):
            counts[words[1]] += 1
        elif words := re.search(r"could not import '([^'.]+)", reason):
            counts[f"{words[1]} (Python)"] += 1
    listed = ", ".join(f"{package}: {count}" for package, count in sorted(counts.items()))
    return f"skipped for want of a package: {listed}" if listed else ""
