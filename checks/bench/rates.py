"""Times of generating laws and of simulating closed loops."""

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial

from counting import TIMEOUT
from noslip.readers.files import file_or_shipped
from noslip.simulation.closed_loop import simulate
from noslip.simulation.specification.spec import read_spec

RUNS = ("line", "circle")  # shipped SPECs
ROBOTS = ("labmate", "mobile_manipulator")  # generated without a cache
REPEATS = 3  # the shortest time counts


def generation(cold: bool) -> dict[str, float | dict[str, float]]:
    """Return the time (s) from the start of the process until all laws of the LABMATE are written, float and
    double; if `cold`, also the processor time (s) of ROBOTS with an empty cache, the C compiler's
    included."""
    with tempfile.TemporaryDirectory() as folder:
        seconds = round(_least(lambda: _checked(_generate("labmate", folder))), 2)
        return {"seconds": seconds} | (
            {"cold_processor_seconds": {robot: _cold(robot) for robot in ROBOTS}} if cold else {}
        )


def _generate(robot: str, folder: str) -> list[str]:
    start = "from noslip.cli.main import main; raise SystemExit(main())"
    return [sys.executable, "-c", start, "generate", robot, "-o", folder]


def _cold(robot: str) -> float:
    """Return the processor time (s) to generate the C of a robot,
    compare it with the model and write it, without a cache."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as folder:
        _checked(_generate(robot, folder), NOSLIP_CACHE=f"{folder}/cache")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return round(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, 1)


def simulation() -> dict[str, float]:
    """Return for shipped SPECs the time (s) that a second of their runs takes,
    imports and the compiler aside."""
    specs = {name: read_spec(file_or_shipped(name, ".toml")) for name in RUNS}
    return {
        name: round(_least(partial(simulate, spec)) / spec.simulation.duration, 4)
        for name, spec in specs.items()
    }


def _least(action: Callable[[], object]) -> float:
    """Return the time of an action, s, the shortest of several."""
    times = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        action()
        times.append(time.perf_counter() - begin)
    return min(times)


def _checked(command: list[str], **settings: str) -> None:
    subprocess.run(command, check=True, capture_output=True, timeout=TIMEOUT, env={**os.environ, **settings})
