"""UMBmark (Borenstein and Feng 1996) on the engine: a square both ways by dead reckoning,
wheels of different size."""

import math
from pathlib import Path

import numpy as np
import pytest
from noslip.analysis.identification.geometry import calibrate
from noslip.analysis.identification.log import PoseLog
from noslip.readers.robots import find_robot, system_of
from noslip.simulation.closed_loop import simulate
from noslip.simulation.run import Run
from noslip.simulation.specification.spec import spec_of_table

ROBOT = Path(__file__).parent.parent / "uneven.py"
TRUE = {"r_r": 0.1505, "r_l": 0.1495, "b": 0.380}
SIDE, CORNER = 3.0, 0.5  # m


def square(turn: int, believed: dict[str, float], noise: float) -> Run:
    """A square of 4 m with round corners, to the left (1) or right (-1),
    where the controller sees a reckoned pose."""
    line = {"kind": "line", "length": SIDE}
    segments = [line, {"kind": "arc", "radius": CORNER, "angle": turn * math.pi / 2}] * 4
    segments[0] = {"kind": "line", "from": [0.0, 0.0], "to": [SIDE, 0.0]}
    table = {
        "robot": f"{ROBOT}:robot",
        "parameters": believed,
        "plant": TRUE,
        "gains": {"kp": 2.0, "kd": 3.0, "kv": 2.0},
        "output": {"type": "IV", "L": 0.1, "path": {"kind": "composite", "segments": segments}},
        "reference": {"speed": 0.4, "deceleration": 0.2},
        "sensors": {"noise": {"sd": noise}, "seed": 2 + turn},
        "contact": {"mu": 0.7},
        "floor": {"mu": 0.7},
        "simulation": {"duration": 44.0, "period": 0.01, "output_step": 0.05},
    }
    return simulate(spec_of_table(table, Path("none.toml")), engine="mujoco")


def error(run: Run) -> np.ndarray:
    """Where the robot stands at the end, beside where it reckons to stand; m."""
    return run.q[-1, :2] - run.seen[-1, :2]


@pytest.mark.nightly
def test_the_systematic_error_becomes_ten_times_smaller():
    """By the end poses alone, measured to 1 mm and 1 mrad; the larger distance of both ways."""
    pytest.importorskip("mujoco")
    random, system = np.random.default_rng(1), system_of(find_robot(f"{ROBOT}:robot"))
    nominal = {p.name: p.default for p in system.mechanism.parameters}
    before = [square(turn, {}, 0.0) for turn in (1, -1)]
    logs = []
    for run in before:
        pose = np.full((len(run.t), 3), math.nan)
        pose[[0, -1]] = run.q[[0, -1], :3] + random.normal(0, 1e-3, (2, 3))
        logs.append(PoseLog(run.t, ("theta_r", "theta_l"), run.q[:, 3:5], pose, (range(len(run.t)),), ()))
    estimates = calibrate(logs, system, ["r_l", "b"], nominal | {"r_r": TRUE["r_r"]}).estimates
    fitted = {name: e.value for name, e in estimates.items()} | {"r_r": TRUE["r_r"]}
    after = [square(turn, fitted, 0.0) for turn in (1, -1)]
    worst = [max(float(np.hypot(*error(run))) for run in runs) for runs in (before, after)]
    print({name: (e.value, e.sd) for name, e in estimates.items()}, worst)
    assert worst[1] < worst[0] / 10
    for name, e in estimates.items():
        assert abs(e.value - TRUE[name]) < 4 * e.sd < 0.004 * TRUE[name]
