"""Slip of the shipped robots in the physics engine, from the start of their SPECs and from random ones, with and without limiter.

    python checks/bench/starts_on_floors.py [--starts N] [--seconds S] [--robot NAME ...]

Prints, for each robot and friction, the largest slip of a wheel and the largest error of dead reckoning at the end, of all
starts; "stopped": the wheels spin, or the loop is singular. Random starts move the place by up to 0.5 m and turn the heading by
up to 0.8 rad; what the robot has of speed is multiplied by up to 1.
"""

import argparse
import math
import random
import tomllib
from pathlib import Path

import noslip
import numpy as np
from noslip.examples.evidence.figures.floor import BARE, LIMITED, LIMITS, PERIOD, ROBOTS
from noslip.readers.errors import BadInput
from noslip.simulation.closed_loop import Run, simulate
from noslip.simulation.specification.vary import read_varied

SPECS = Path(noslip.__file__).parent / "examples/specs"
FLOORS = (0.7, 0.3)
PLACE, HEADING = 0.5, 0.8  # m, rad
COLUMNS = ("robot", "friction", "limits", "largest slip, m/s", "stopped", "`will_slip`, s at most", "dead reckoning off, m")


def moved(initial: dict, source: random.Random) -> dict:
    """Return a start near another one."""
    place = [source.uniform(-PLACE, PLACE) for _ in range(2)]
    turn, part = source.uniform(-HEADING, HEADING), source.uniform(0, 1)
    if "point" not in initial:
        x, y, heading, *rest = initial["q"]
        return {"q": [x + place[0], y + place[1], heading + turn, *rest], "nu": [part * rate for rate in initial["nu"]]}
    heading = initial["heading"]
    heading = math.radians(float(heading.split()[0])) if isinstance(heading, str) else heading
    point = [at + by for at, by in zip(initial["point"], place, strict=True)]
    return {"point": point, "heading": heading + turn, "speed": part * initial["speed"]}


def run(file: Path, initial: dict, mu: float, limits: str, seconds: float) -> Run | None:
    """Return the run of a SPEC from a start on a floor; None where the law is singular at the start."""
    changes = {"initial": initial, "simulation.period": PERIOD, "simulation.duration": seconds}
    changes |= {"contact": {"mu": mu}, "floor": {"mu": mu}, **LIMITS[limits]}
    try:
        return simulate(read_varied(file, changes), "c", engine="mujoco")
    except BadInput as error:
        if "singular" not in str(error):
            raise
        return None


def reckoning_error(run: Run) -> float:
    """Return how far the reckoned place is off at the end, m; 0 for a robot that does not reckon."""
    if run.floor is None or run.floor.reckoned is None:
        return 0.0
    places = [k for k, coordinate in enumerate(run.law.system.mechanism.coordinates) if coordinate.unit == "m"]
    return float(np.hypot(*(run.floor.reckoned[-1, :2] - run.q[-1, places])))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--starts", type=int, default=3, help="of each robot, the first is that of its SPEC")
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--robot", nargs="*", default=list(ROBOTS))
    given = parser.parse_args()
    print(f"| {' | '.join(COLUMNS)} |\n{'|---' * len(COLUMNS)}|")
    for name in given.robot:
        file = SPECS / ("line.toml" if name == "labmate" else f"robots/{name}.toml")
        source, first = random.Random(f"18 {name}"), tomllib.loads(file.read_text(encoding="utf-8"))["initial"]
        starts = [first, *(moved(first, source) for _ in range(given.starts - 1))]
        for mu in FLOORS:
            for limits in (BARE, LIMITED):
                runs = [each for start in starts if (each := run(file, start, mu, limits, given.seconds))]
                stopped = sum(bool(each.stopped) for each in runs)
                slides = max(PERIOD * sum(status == "will_slip" for status in each.status) for each in runs)
                off = max([reckoning_error(each) for each in runs if not each.stopped], default=math.nan)
                slip = max(float(each.floor.slip.max()) for each in runs if each.floor)
                row = (f"`{name}`", mu, limits, f"{slip:.2g}", f"{stopped} of {len(runs)}", f"{slides:.2g}", f"{off:.2g}")
                print(f"| {' | '.join(map(str, row))} |", flush=True)


if __name__ == "__main__":
    main()
