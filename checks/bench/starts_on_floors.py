"""Slip of robots in the physics engine where friction is not what is believed: given, earned, and without
limiter.

    python checks/bench/starts_on_floors.py [--starts N] [--ratios R ...] [--seconds S]
        [--robot NAME|SPEC.toml ...]

Prints, for each robot, each ratio of the true friction to the believed one and each limiter, of all starts:
the largest slip of a wheel and for how long a run slips faster than SLIDES at most, the time from which on
all errors in m stay within REACHED (median of the runs that end so, and their number), the runs that stopped:
the wheels spin, or the loop is singular, and those of them that reach the path without limiter. The first
start is that of the SPEC; others move the place by up to 0.5 m, turn the heading by up to 0.8 rad and
multiply what the robot has of speed by up to 1. Starts that are singular are left out.
"""

import argparse
import math
import os
import random
import statistics
import tomllib
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import noslip
import numpy as np
from noslip.examples.evidence.figures.floor import (
    BARE,
    BELIEVED_MU,
    LIMITERS,
    PERIOD,
    ROBOTS,
    SLIDES,
    file_of,
    sliding,
)
from noslip.examples.evidence.framework import Case
from noslip.readers.errors import BadInput
from noslip.simulation.closed_loop import simulate

SPECS = Path(noslip.__file__).parent / "examples/specs/figures"
PLACE, HEADING = 0.5, 0.8  # m, rad
REACHED = 0.01  # m
COLUMNS = (
    "robot",
    "true / believed",
    "limiter",
    "slip, cm/s",
    f"above {100 * SLIDES:g} cm/s, s",
    "path reached, s",
    "reached",
    "stopped",
    "lost",
)


@dataclass(frozen=True)
class Slipped:
    """What a run shows: largest slip (m/s), time above SLIDES (s), when the path is reached (s; None:
    not), if it stopped."""

    slip: float
    slides: float
    reached: float | None
    stopped: bool


def moved(initial: dict, source: random.Random) -> dict:
    """Return a start near another one."""
    place = [source.uniform(-PLACE, PLACE) for _ in range(2)]
    turn, part = source.uniform(-HEADING, HEADING), source.uniform(0, 1)
    if "point" not in initial:
        x, y, heading, *rest = initial["q"]
        return {
            "q": [x + place[0], y + place[1], heading + turn, *rest],
            "nu": [part * rate for rate in initial["nu"]],
        }
    heading = initial["heading"]
    heading = math.radians(float(heading.split()[0])) if isinstance(heading, str) else heading
    point = [at + by for at, by in zip(initial["point"], place, strict=True)]
    return {"point": point, "heading": heading + turn, "speed": part * initial["speed"]}


def spec_of(robot: str) -> str:
    """Return the SPEC of a shipped robot, or that which is named, from the folder of those of figures."""
    return file_of(robot) if robot in ROBOTS else str(Path(robot).resolve())


def started(robot: str, initial: dict, ratio: float, limiter: str, seconds: float) -> Case:
    """Return the run of a robot's SPEC from a start, on a floor whose friction is `ratio` times the believed
    one."""
    times = {"simulation.period": PERIOD, "simulation.output_step": PERIOD, "simulation.duration": seconds}
    floor = {"contact": {"mu": BELIEVED_MU}, "floor": {"mu": ratio * BELIEVED_MU}}
    return Case(spec_of(robot), {"initial": initial, **times, **floor, **LIMITERS[limiter]}, engine="mujoco")


def outcome(case: Case) -> Slipped | None:
    """Run a case; None where the law is singular at the start."""
    try:
        run = simulate(case.spec(), "c", engine=case.engine)
    except BadInput as error:
        if "singular" not in str(error):
            raise
        return None
    assert run.floor is not None
    lengths = [k for k, row in enumerate(run.law.output.rows) if row.unit == "m"]
    away = np.flatnonzero((np.abs(run.error[:, lengths]) > REACHED).any(axis=1))
    last = int(away[-1]) + 1 if len(away) else 0
    reached = float(run.t[last]) if last < len(run.t) and not run.stopped else None
    return Slipped(float(run.floor.slip.max()), sliding(run), reached, bool(run.stopped))


def row(
    robot: str, ratio: float, limiter: str, found: Sequence[Slipped | None], without: Sequence[Slipped | None]
) -> str:
    """Return the row of a table for all starts; `without` are the same without limiter."""
    runs = [one for one in found if one is not None]
    lost = sum(
        bool(a and b and a.stopped and b.reached is not None) for a, b in zip(found, without, strict=True)
    )
    times, stopped = (
        [one.reached for one in runs if one.reached is not None],
        sum(one.stopped for one in runs),
    )
    slip, slides = max(one.slip for one in runs), max(one.slides for one in runs)
    median = f"{statistics.median(times):.2f}" if times else "-"
    counts = [f"{number} of {len(runs)}" for number in (len(times), stopped, lost)]
    numbers = [f"{ratio:g}", limiter, f"{100 * slip:.2g}", f"{slides:.2g}", median]
    return f"| {' | '.join([f'`{Path(robot).stem}`', *numbers, *counts])} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--starts", type=int, default=3, help="of each robot, the first is that of its SPEC")
    parser.add_argument("--ratios", type=float, nargs="*", default=[0.5, 0.8, 1.0, 1.3])
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--robot", nargs="*", default=list(ROBOTS))
    given = parser.parse_args()
    print(f"| {' | '.join(COLUMNS)} |\n{'|---' * len(COLUMNS)}|")
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for robot in given.robot:
            source = random.Random(f"18 {robot}")
            first = tomllib.loads((SPECS / spec_of(robot)).read_text(encoding="utf-8"))["initial"]
            starts = [first, *(moved(first, source) for _ in range(given.starts - 1))]
            for ratio in given.ratios:
                found = {
                    limiter: pool.map(
                        outcome, [started(robot, start, ratio, limiter, given.seconds) for start in starts]
                    )
                    for limiter in LIMITERS
                }
                runs = {limiter: list(each) for limiter, each in found.items()}
                for limiter, each in runs.items():
                    print(row(robot, ratio, limiter, each, runs[BARE]), flush=True)


if __name__ == "__main__":
    main()
