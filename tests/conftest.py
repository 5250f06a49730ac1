"""What several test files use."""

import gc
import os
from functools import cache

import pytest
from noslip.harness.cli import main

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy comes: the tests have all cores busy without its threads

# File -> group: tests of a group run in one process, which makes once what they share. A file not named is a group of its own.
GROUPS = {
    "test_battery": "robots",
    "test_bits": "test_runtime",
    "test_dynamics": "robots",
    "test_figures_more": "test_figures",
    "test_follow": "robots",
    "test_redundancy": "robots",
    "test_robot_figures": "robots",
    "test_robots": "robots",
}
LONGEST = (  # begin, so that no process is left with one of them at the end
    "robots",
    "test_figures",
    "test_runtime",
    "test_codegen",
    "test_guarantees",
    "test_package",
    "test_large",
    "test_tracking",
    "test_sweep",
    "test_evaluate",
    "test_outer_loop",
    "test_firmware",
    "test_rolling",
    "test_integral",
)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Puts tests into groups, the longest first."""
    order = {group: k for k, group in enumerate(LONGEST)}
    of = {item: GROUPS.get(item.path.stem, item.path.stem) for item in items}
    for item, group in of.items():
        item.add_marker(pytest.mark.xdist_group(group))
    items.sort(key=lambda item: order.get(of[item], len(order)))


def pytest_collection_finish():
    """What has been imported stays: the garbage collector need not look through it again and again."""
    gc.freeze()
    gc.set_threshold(10_000)


@pytest.fixture(scope="session")
def built(tmp_path_factory):
    """Objects of all sources by compiler and level, made once: without a warning, for a shared library, without a library."""
    from noslip.tests.test_runtime import STRICT, objects

    @cache
    def built(cc: str, level: str) -> list[str]:
        more = ["-Wstack-usage=256"] if (cc, level) == ("gcc", "-O2") else []
        return objects(cc, [level, "-ffreestanding", "-fPIC", *STRICT, *more], tmp_path_factory.mktemp("built"))

    return built


@pytest.fixture
def bad_input(capsys, tmp_path):
    """Runs a command line that must be refused: exit 2, one line on stderr, nothing on stdout, no new file. Answers the line."""

    def bad_input(argv: list[str]) -> str:
        before = sorted(tmp_path.rglob("*"))
        capsys.readouterr()
        assert main(argv) == 2
        out, err = capsys.readouterr()
        assert out == ""
        assert err.startswith("noslip") and err.endswith("\n") and err.count("\n") == 1 and "Traceback" not in err
        assert sorted(tmp_path.rglob("*")) == before
        return err

    return bad_input
