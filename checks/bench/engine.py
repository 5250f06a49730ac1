"""The physics engine: how far a path moves when its step is halved, how far it is from rolling and from that
of the same robot in a scene, and how long a run takes.

python checks/bench/engine.py
"""

import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import noslip
import numpy as np
from noslip.simulation.closed_loop import simulate
from noslip.simulation.engine.written import scene_of
from noslip.simulation.specification.floor import Floor
from noslip.simulation.specification.spec import ContactSection
from noslip.simulation.specification.vary import read_varied

SPECS = Path(noslip.__file__).parent / "examples/specs"
STEPS = (1e-3, 5e-4, 2.5e-4)  # s
START: dict[str, Any] = {
    "initial": {"point": [0.0, 2.0], "heading": np.pi / 2, "speed": 0.0},
    "simulation.period": 0.01,
}
SOFT: dict[str, Any] = START | {"gains": {"kp": 0.1, "kd": 0.8, "kv": 0.5}}
PAPER: dict[str, Any] = START | {"gains": {"kp": 1.0, "kd": 2.5, "kv": 2.0}}
# Changes of line.toml, and what the first halving may change, m
RUNS: Mapping[str, tuple[Mapping[str, Any], float]] = {
    "slowly (0.3 m/s), mu 5": (SOFT | {"reference.speed": 0.3, "contact": {"mu": 5.0}}, 2.5e-4),
    "paper's speed, mu 0.7, a castor with 30 %": (SOFT | {"contact": {"mu": 0.7, "share": 0.7}}, 1e-3),
    "the same, centre of mass 0.15 m high": (
        SOFT | {"contact": {"mu": 0.7, "share": 0.7, "height": 0.15}},
        1e-3,
    ),
    "paper's gains, torque cut at 4 N m": (
        PAPER | {"contact": {"mu": 0.7, "share": 0.7}, "limits": {"torque": [4.0], "mode": "cut"}},
        1e-3,
    ),
}
ROLLING = next(iter(RUNS))  # so slow and with so much friction that its path is that of the rolling model
CONTACT = {"mu": 0.7, "share": 0.7, "height": 0.15}
CASTOR: dict[str, Any] = {"simulation.period": 0.01, "contact": {"mu": 0.7, "share": 0.7}}
BROUGHT_BACK: Mapping[str, tuple[str, Mapping[str, Any]]] = {  # SPEC and changes
    "labmate, paper's speed": ("line", SOFT | {"contact": CONTACT}),
    "labmate, paper's gains, torque cut at 4 N m": (
        "line",
        PAPER | {"contact": CONTACT, "limits": {"torque": [4.0], "mode": "cut"}},
    ),
    "labmate, paper's gains, torque cut at 20 N m": (
        "line",
        PAPER | {"contact": CONTACT, "limits": {"torque": [20.0], "mode": "cut"}},
    ),
    "turtlebot3_burger": ("robots/turtlebot3_burger", {"simulation.period": 0.01, "contact": {"mu": 0.7}}),
    "pioneer_3dx": ("robots/pioneer_3dx", {"simulation.period": 0.01, "contact": {"mu": 0.7}}),
    "mobile_manipulator": ("robots/mobile_manipulator", CASTOR),
    "tractor_trailer:3": ("robots/tractor_trailer", CASTOR),
}
TIMED = ("labmate", "turtlebot3_burger", "car", "tractor_trailer", "mobile_manipulator")
REPEATS = 3  # the shortest time counts


def moved(changes: Mapping[str, Any]) -> list[float]:
    """Return by how much each halving of the step changes the path of P_c at most, m."""
    specs = [read_varied(SPECS / "line.toml", {**changes, "floor": {"step": step}}) for step in STEPS]
    paths = [simulate(spec, engine="mujoco").q[:, :2] for spec in specs]
    return [float(np.abs(b - a).max()) for a, b in zip(paths, paths[1:], strict=False)]


def from_rolling(changes: Mapping[str, Any]) -> float:
    """Return how far the path is from that of the rolling model at most, m."""
    spec = read_varied(SPECS / "line.toml", changes)
    return float(np.abs(simulate(spec, engine="mujoco").q[:, :2] - simulate(spec).q[:, :2]).max())


def brought_back(spec: str, changes: Mapping[str, Any], step: float) -> float:
    """Return how far the path of a robot that is written as a scene is from that in its own engine at most,
    in 5 s, m."""
    file, changes = SPECS / f"{spec}.toml", {**changes, "simulation.duration": 5.0, "floor": {"step": step}}
    own = simulate(read_varied(file, changes), engine="mujoco")
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "scene.xml"
        scene.write_text(scene_of(own.plant, own.spec.contact or ContactSection(), Floor()), encoding="utf-8")
        other = simulate(read_varied(file, {**changes, "scene": {"file": str(scene)}}), engine="mujoco")
    places = [
        k for k, coordinate in enumerate(own.law.system.mechanism.coordinates) if coordinate.unit == "m"
    ]
    return float(np.abs(own.q[:, places] - other.q[:, places]).max())


def seconds(robot: str) -> float:
    """Return the time of a processor (s) for a second of the robot's own run at 100 Hz,
    without what is made once."""
    file = SPECS / ("line.toml" if robot == "labmate" else f"robots/{robot}.toml")
    times = []
    for duration in (0.1, *(0.1, 2.1) * REPEATS):  # the first makes what is kept
        spec = read_varied(file, {"simulation.period": 0.01, "simulation.duration": duration})
        begin = time.process_time()
        simulate(spec, engine="mujoco")
        times.append(time.process_time() - begin)
    return (min(times[2::2]) - min(times[1::2])) / 2.0


def measure() -> dict[str, Any]:
    """Return `moved`, `from_rolling` and `brought_back`, mm, and `seconds` of some robots."""
    halved = {name: [round(1e3 * each, 3) for each in moved(changes)] for name, (changes, _) in RUNS.items()}
    return {
        "halving_mm": halved,
        "from_rolling_mm": round(1e3 * from_rolling(RUNS[ROLLING][0]), 3),
        "scene_mm": {
            name: [round(1e3 * brought_back(*run, step), 2) for step in (STEPS[0], STEPS[-1])]
            for name, run in BROUGHT_BACK.items()
        },
        "seconds_per_second": {robot: round(seconds(robot), 2) for robot in TIMED},
    }


def table(measured: Mapping[str, Any]) -> str:
    """Return what was measured, as text."""
    lines = ["physics engine: change of the path in mm when the step is halved, from 1 ms and from 0.5 ms"]
    lines += [
        f"  {name}: {first:.3f}, {second:.3f}" for name, (first, second) in measured["halving_mm"].items()
    ]
    lines.append(f"  from the rolling model ({ROLLING}): {measured['from_rolling_mm']:.3f} mm")
    lines.append(
        "from the same robot in a scene with MuJoCo's own friction, in mm, steps of 1 ms and of 0.25 ms"
    )
    lines += [f"  {name}: {coarse:.2f}, {fine:.2f}" for name, (coarse, fine) in measured["scene_mm"].items()]
    lines.append("seconds of a processor for a second of a run")
    lines += [f"  {robot}: {time_taken:.2f}" for robot, time_taken in measured["seconds_per_second"].items()]
    return "\n".join(lines)


if __name__ == "__main__":
    print(table(measure()))
