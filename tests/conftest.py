"""What several test files use."""

import gc
import os
from functools import cache
from pathlib import Path
from weakref import WeakSet

import pytest
from noslip.cli.main import main
from noslip.simulation.controllers.targets import missing
from noslip.tests.nightly import faults, is_nightly
from noslip.tests.tools import lacking, skip_without

# Before NumPy comes: the tests have all cores busy without its threads
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# File -> group: tests of a group run in one process, which makes once what they share. A file not named is a
# group of its own.
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
LONGEST = """
    robots test_runtime test_figures test_guarantees test_analyse test_codegen test_outer_loop test_sweep
    test_guidance test_package test_rolling test_large test_tracking test_dialects test_distribution
    test_functions test_integral test_project test_files test_model test_planning test_limits test_verify
    test_extension test_contact test_engine test_grip test_firmware
    test_mutation test_evaluate test_batch test_calibration test_odometry
""".split()  # begin, so that no process is left with one of them at the end


def pytest_addoption(parser):
    parser.addoption(
        "--margins",
        metavar="FILE",
        help="write the part of each tolerance that is needed; fail above a tenth",
    )


def pytest_configure(config):
    if path := config.getoption("--margins"):
        from noslip.tests.margins import Margins

        config.pluginmanager.register(Margins(Path(path)))


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Puts tests into groups, the longest first; leaves to the night what by_day.json does not keep."""
    if not any("::" in argument for argument in config.args) and (
        wrong := faults((i.path.stem, i.name) for i in items)
    ):
        raise pytest.UsageError("tests/by_day.json: " + "; ".join(wrong))
    order = {group: k for k, group in enumerate(LONGEST)}
    of = {item: GROUPS.get(item.path.stem, item.path.stem) for item in items}
    for item, group in of.items():
        item.add_marker(pytest.mark.xdist_group(group))
        if is_nightly(item.path.stem, item.name):
            item.add_marker(pytest.mark.nightly)
            item.add_marker(pytest.mark.left)
    items.sort(key=lambda item: order.get(of[item], len(order)))


def pytest_runtest_setup(item):
    """A test with a compiler as its parameter is skipped where that compiler is not installed."""
    if parameters := getattr(item, "callspec", None):
        skip_without(missing(*(parameters.params.get(name, "") for name in ("cc", "cxx", "compiler"))))


def pytest_terminal_summary(terminalreporter):
    """Say in one line which packages would bring what was skipped."""
    if line := lacking(str(report.longrepr[2]) for report in terminalreporter.stats.get("skipped", ())):
        terminalreporter.write_line(line)


def pytest_collection_finish():
    """What has been imported stays: the garbage collector need not look through it again and again."""
    gc.freeze()
    gc.set_threshold(10_000)


@pytest.fixture(scope="session", autouse=True)
def legible():
    """Every figure that a test of this process writes to a file has text that can be read."""
    import matplotlib.figure
    from noslip.tests.legible import unreadable

    write, seen = matplotlib.figure.Figure.savefig, WeakSet()

    def checked(figure, *args, **options):
        write(figure, *args, **options)
        if figure not in seen:  # it is the same in each kind of file
            seen.add(figure)
            hidden = unreadable(figure)
            assert not hidden, hidden

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(matplotlib.figure.Figure, "savefig", checked)
        yield


@pytest.fixture(scope="session")
def built(tmp_path_factory):
    """Objects of all sources by compiler and level, made once: without a warning,
    for a shared library, without a library."""
    from noslip.tests.runtime_c.test_runtime import STRICT, objects

    @cache
    def built(cc: str, level: str) -> list[str]:
        more = ["-Wstack-usage=480"] if (cc, level) == ("gcc", "-O2") else []
        return objects(
            cc, [level, "-ffreestanding", "-fPIC", *STRICT, *more], tmp_path_factory.mktemp("built")
        )

    return built


@pytest.fixture
def bad_input(capsys, tmp_path):
    """Runs a command line that must be refused: exit 2, one line on stderr, nothing on stdout,
    no new file. Answers the line."""

    def bad_input(argv: list[str]) -> str:
        before = sorted(tmp_path.rglob("*"))
        capsys.readouterr()
        assert main(argv) == 2
        out, err = capsys.readouterr()
        assert out == ""
        assert (
            err.startswith("noslip")
            and err.endswith("\n")
            and err.count("\n") == 1
            and "Traceback" not in err
        )
        assert sorted(tmp_path.rglob("*")) == before
        return err

    return bad_input
