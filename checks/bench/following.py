"""Path following compared with what mobile robots usually have: pure pursuit, regulated pure pursuit, and
cascaded PID.

All drive the Pioneer 3-DX in the physics engine on the same path, floors, torque limits and period, from the
same start, and see the true pose and the rates of the wheels. The usual ones give velocities, which a PI
controller of each wheel turns into torques; the law of noslip is the generated C. Each has its parameters by
the same search: of SAMPLES points of Sobol's sequence in its box, those with the least `cost` on the tuning
run. Distances are those of the middle of the axle. Writes following.json and following.png.

- Pure pursuit: R. C. Coulter, Implementation of the pure pursuit path tracking algorithm, CMU-RI-TR-92-01
  (1992).
- Regulated pure pursuit: S. Macenski et al., Regulated pure pursuit for robot path tracking, Autonomous
  Robots 47 (2023); its limits of radius and speed are its authors' defaults.
- Cascaded PID: distance -> heading -> yaw rate -> wheels, with the yaw rate of the path's curvature fed
  forward.
"""

import argparse
import json
import math
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from noslip.model.mechanism import Mechanism
from noslip.readers.files import write_whole
from noslip.readers.robots import find_robot
from noslip.simulation.closed_loop import simulate
from noslip.simulation.drawing import COLOURS, panels, pictures
from noslip.simulation.engine.engine import FloorEngine
from noslip.simulation.integrate import Refused
from noslip.simulation.loop import make_loop
from noslip.simulation.specification.floor import Floor
from noslip.simulation.specification.spec import ContactSection, Spec
from noslip.simulation.specification.vary import read_varied
from scipy.stats import qmc

PERIOD, TORQUE = 0.01, 1.5  # s; N m, assumed
OFFSET = 0.1  # m, of the start from the path
SPEEDS, FLOORS = (0.3, 0.5, 0.7, 0.9, 1.1), (0.7, 0.3)  # m/s, of 1.2 that the robot can do; friction
TUNING, SAMPLES = (0.7, 0.7), 32  # speed and friction of the tuning run
# Length (m), curvature (1/m)
PATH = ((1.5, 0.0), (math.pi / 2, 1.0), (1.0, 0.0), (1.57, -1 / 0.75), (1.0, 0.0))
TAIL = 1.5  # m beyond the path, where nothing is measured
SPACING = 0.005  # m
ROUGH = 0.05  # m per N m: what a change of the torques costs in tuning, against the distance
# m, m/s: defaults of regulated pure pursuit
REGULATED = {"radius": 0.9, "least": 0.25, "nearest": 0.3, "furthest": 0.9}
SLIPS = 0.01  # m/s


# -- the path ------------------------------------------------------------------------------------------------


def path_points() -> np.ndarray:
    """Places, headings and curvatures along the path and its tail, (N, 4), m, rad, 1/m, every SPACING."""
    pieces = [*PATH[:-1], (PATH[-1][0] + TAIL, 0.0)]
    curvature = np.concatenate([np.full(round(length / SPACING), kappa) for length, kappa in pieces])
    heading = np.concatenate([[0.0], np.cumsum(curvature * SPACING)])
    middle = (heading[1:] + heading[:-1]) / 2
    places = np.vstack(
        [[0.0, 0.0], np.cumsum(SPACING * np.column_stack([np.cos(middle), np.sin(middle)]), axis=0)]
    )
    return np.column_stack([places, heading, np.append(curvature, 0.0)])


POINTS = path_points()
LENGTH = sum(round(length / SPACING) * SPACING for length, _ in PATH)


class Nearest:
    """Finds the nearest point of the path, going forward along it."""

    def __init__(self) -> None:
        self.k = 0

    def __call__(self, place: np.ndarray) -> tuple[int, float]:
        """Return the nearest point and the distance to the left of it, m."""
        window = POINTS[self.k : self.k + 200]
        self.k += int(np.argmin(((window[:, :2] - place) ** 2).sum(axis=1)))
        x, y, heading, _ = POINTS[self.k]
        return self.k, float(-np.sin(heading) * (place[0] - x) + np.cos(heading) * (place[1] - y))


# -- the usual controllers: from pose and wheel rates to forward speed and yaw rate --------------------------


@dataclass(frozen=True)
class Pose:
    """The middle of the axle, m, its heading, rad, the nearest point of the path and the distance to its
    left, m."""

    place: np.ndarray
    heading: float
    nearest: int
    distance: float


def pure_pursuit(
    pose: Pose, speed: float, p: Mapping[str, float], least: float = 0.05, most: float = math.inf
) -> float:
    """The yaw rate of the arc through the point a lookahead distance ahead on the path."""
    lookahead = min(max(p["lookahead"] * speed, least), most)
    ahead = POINTS[pose.nearest :, :2] - pose.place
    k = int(np.argmax((ahead**2).sum(axis=1) >= lookahead**2))
    left = -math.sin(pose.heading) * ahead[k, 0] + math.cos(pose.heading) * ahead[k, 1]
    return 2 * speed * left / float(ahead[k] @ ahead[k])


class PurePursuit:
    """Lookahead proportional to the speed."""

    box = {"lookahead": (0.1, 1.5), "bandwidth": (1.0, 10.0)}  # s, Hz

    def __init__(self, p: Mapping[str, float]):
        self.p = p

    def __call__(self, pose: Pose, speed: float) -> tuple[float, float]:
        """Return forward speed (m/s) and yaw rate (rad/s)."""
        return speed, pure_pursuit(pose, speed, self.p)


class RegulatedPurePursuit(PurePursuit):
    """It slows down where the arc is narrow."""

    def __call__(self, pose: Pose, speed: float) -> tuple[float, float]:
        """Return forward speed (m/s) and yaw rate (rad/s)."""
        rate = pure_pursuit(pose, speed, self.p, REGULATED["nearest"], REGULATED["furthest"])
        radius = abs(speed / rate) if rate else math.inf
        slow = max(min(1.0, radius / REGULATED["radius"]), REGULATED["least"] / speed)
        return speed * min(slow, 1.0), rate * min(slow, 1.0)


class CascadedPid:
    """The distance asks for a heading, at most 60 degrees from the path, and the heading for a yaw rate."""

    box = {
        "distance": (0.3, 6.0),
        "heading": (1.0, 12.0),
        "integral": (0.0, 6.0),
        "rate": (0.0, 0.3),
        "bandwidth": (1.0, 10.0),
    }

    def __init__(self, p: Mapping[str, float]):
        self.p, self.sum = p, 0.0
        self.last: float | None = None

    def __call__(self, pose: Pose, speed: float) -> tuple[float, float]:
        """Return forward speed (m/s) and yaw rate (rad/s)."""
        wanted = POINTS[pose.nearest, 2] - float(
            np.clip(self.p["distance"] * pose.distance, -math.pi / 3, math.pi / 3)
        )
        error = math.remainder(wanted - pose.heading, 2 * math.pi)
        slope = 0.0 if self.last is None else (error - self.last) / PERIOD
        self.last, self.sum = error, float(np.clip(self.sum + error * PERIOD, -1.0, 1.0))
        fed = speed * POINTS[pose.nearest, 3]
        return speed, fed + self.p["heading"] * error + self.p["integral"] * self.sum + self.p["rate"] * slope


class Wheels:
    """A PI controller of each wheel's rate, its gains from a bandwidth (Hz) and half the robot's inertia."""

    def __init__(self, robot: Mapping[str, float], bandwidth: float):
        self.robot, self.sum = robot, np.zeros(2)
        inertia = (robot["m_c"] / 2 + robot["m_w"]) * robot["r"] ** 2 + robot["I_w"]
        self.kp = 2 * math.pi * bandwidth * inertia
        self.ki = self.kp * 2 * math.pi * bandwidth / 4  # critically damped

    def __call__(self, v: float, w: float, rates: np.ndarray) -> np.ndarray:
        """Return the torques, N m, right and left."""
        error = (v + w * self.robot["b"] * np.array([1.0, -1.0])) / self.robot["r"] - rates
        free = self.kp * error + self.ki * self.sum
        torque = np.clip(free, -TORQUE, TORQUE)
        self.sum = self.sum + np.where(torque == free, error * PERIOD, 0.0)  # it stops at the limits
        return torque


# -- runs ----------------------------------------------------------------------------------------------------

ROBOT: Mechanism = find_robot("pioneer_3dx")
SIZES = {parameter.name: parameter.default for parameter in ROBOT.parameters}
# 1/s^2, 1/s, 1/s; m, of P_l from the axle
OURS = {"kp": (0.5, 12.0), "kd": (1.0, 8.0), "kv": (0.5, 6.0), "ahead": (0.05, 0.4)}
USUAL: dict[str, type[PurePursuit] | type[CascadedPid]] = {
    "pure pursuit": PurePursuit,
    "regulated pure pursuit": RegulatedPurePursuit,
    "cascaded PID": CascadedPid,
}
NOSLIP = {"noslip, Type IV": "cut", "noslip, Type IV, grip limiter": "grip"}


def spec_of(speed: float, mu: float, p: Mapping[str, float], mode: str) -> Spec:
    """The run as a SPEC: the middle of the axle starts OFFSET beside the path, at its speed."""
    first, *rest = (
        {"kind": "arc", "radius": abs(1 / k), "angle": length * k}
        if k
        else {"kind": "line", "length": length}
        for length, k in (*PATH[:-1], (PATH[-1][0] + TAIL + 1.0, 0.0))
    )
    first = {"kind": "line", "from": [0.0, 0.0], "to": [PATH[0][0], 0.0]}
    return read_varied(
        "pioneer_3dx",
        {
            "gains": {name: p[name] for name in ("kp", "kd", "kv")},
            "output": {
                "type": "IV",
                "L": p["ahead"] - SIZES["d"],
                "path": {"kind": "composite", "segments": [first, *rest]},
            },
            "reference": {"speed": speed},
            "initial": {"point": [p["ahead"], OFFSET], "heading": 0.0, "speed": speed},
            "simulation": {
                "duration": 1.5 * LENGTH / speed,
                "period": PERIOD,
                "output_step": PERIOD,
                "backend": "c",
            },
            "limits": {"torque": [TORQUE], "mode": mode},
            "contact": {"mu": mu},
            "floor": {"mu": mu},
        },
    )


def run(controller: str, speed: float, mu: float, p: Mapping[str, float]) -> dict[str, Any]:
    """Carry out a run; return what `measured` does."""
    if controller in NOSLIP:
        done = simulate(spec_of(speed, mu, p, NOSLIP[controller]), engine="mujoco")
        assert done.floor
        return measured(done.t, done.q, done.tau, done.floor.slip.max(axis=1), done.stopped)
    made = USUAL[controller](p)
    start = dict.fromkeys(("kp", "kd", "kv"), 1.0) | {"ahead": 0.1}
    loop = make_loop(spec_of(speed, mu, start, "cut"))
    engine = FloorEngine(loop.plant, ContactSection(mu=mu), Floor(mu=mu), loop.start)
    wheels, nearest, stopped = Wheels(SIZES, p["bandwidth"]), Nearest(), None
    rows: list[tuple[float, np.ndarray, np.ndarray, float]] = []
    while len(rows) * PERIOD < 1.5 * LENGTH / speed and nearest.k * SPACING < LENGTH:
        x = engine.state()
        place = axle(x[None])[0]
        k, distance = nearest(place)
        v, w = made(Pose(place, x[2], k, distance), speed)
        torque = wheels(v, w, x[5:])
        t = len(rows) * PERIOD
        rows.append((t, x[:5], torque, engine.look()[0].max()))
        try:
            engine.hold(t, x, torque, PERIOD)
        except Refused as refused:
            stopped = refused.status
            break
    t_of, q, tau, slip = (np.array(column) for column in zip(*rows, strict=True))
    return measured(t_of, q, tau, slip, stopped)


def axle(q: np.ndarray) -> np.ndarray:
    """The middle of the axle, (N, 2), m."""
    return q[:, :2] - SIZES["d"] * np.column_stack([np.cos(q[:, 2]), np.sin(q[:, 2])])


def measured(
    t: np.ndarray, q: np.ndarray, tau: np.ndarray, slip: np.ndarray, stopped: str | None
) -> dict[str, Any]:
    """RMS and, after the first metre, largest distance of the axle's middle from the path (m); RMS torque and
    its RMS change between calls (N m); largest slip (m/s) and how long a wheel slips (s); the mean speed
    (m/s); None where it did not arrive.
    """
    nearest = Nearest()
    found = [nearest(place) for place in axle(q)]
    s, off = np.array([k * SPACING for k, _ in found]), np.array([distance for _, distance in found])
    on = s < LENGTH
    if stopped or on.all() and s[-1] < LENGTH - 0.05:
        return {"rms": None, "stopped": stopped or "late"}
    return {
        "rms": float(np.sqrt((off[on] ** 2).mean())),
        "largest": float(np.abs(off[on & (s > 1.0)]).max()),
        "torque": float(np.sqrt((tau[on] ** 2).mean())),
        "change": float(np.sqrt((np.diff(tau[on], axis=0) ** 2).mean())),
        "slip": float(slip[on].max()),
        "slips_for": float((slip[on] > SLIPS).sum() * PERIOD),
        "speed": float(s[on][-1] / t[on][-1]),
        "stopped": None,
    }


# -- tuning, table, picture ----------------------------------------------------------------------------------


def candidates(controller: str) -> list[dict[str, float]]:
    """The points of a box that are tried: Sobol's sequence, the same for all."""
    box = OURS if controller in NOSLIP else USUAL[controller].box
    unit = qmc.Sobol(len(box), seed=1992).random(SAMPLES)
    return [
        dict(
            zip(
                box,
                (float(lo + u * (hi - lo)) for u, (lo, hi) in zip(row, box.values(), strict=True)),
                strict=True,
            )
        )
        for row in unit
    ]


def tuned(controller: str, carry_out: Callable) -> dict[str, float]:
    """The candidate with the least cost on the tuning run."""
    tried = candidates(controller)
    costs = [cost(result) for result in carry_out(partial(run, controller, *TUNING), tried)]
    return tried[int(np.argmin(costs))]


def cost(result: Mapping[str, Any]) -> float:
    """RMS distance and, so that nobody gets gains that rattle, RMS change of the torques;
    infinite if it did not arrive."""
    return math.inf if result["rms"] is None else result["rms"] + ROUGH * result["change"]


TITLE = "Path following on a floor: Pioneer 3-DX, arcs of 1 m and 0.75 m"
PANELS = (  # key of `measured`, factor, friction, title, label
    ("largest", 1e3, 0.7, "distance from the path, μ 0.7", "largest after the first metre (mm)"),
    ("largest", 1e3, 0.3, "distance from the path, μ 0.3", "largest after the first metre (mm)"),
    ("change", 1.0, 0.7, "roughness, μ 0.7", "change of torque per call (N m)"),
    ("slip", 1.0, 0.3, "peak slip of a wheel, μ 0.3", "slip (m/s)"),
)


def draw(found: list[dict[str, Any]]) -> Figure:
    """Error, roughness and slip over speed."""
    figure, axes = panels(*(title for *_, title, _ in PANELS), height=4.6)
    names = list(dict.fromkeys(one["controller"] for one in found))
    for panel, (key, factor, mu, _, label) in zip(axes, PANELS, strict=True):
        for name, colour in zip(names, COLOURS, strict=False):
            here = [
                one
                for one in found
                if (one["controller"], one["mu"]) == (name, mu) and one["rms"] is not None
            ]
            style = "--" if "limiter" in name else "-"
            values = [factor * one[key] for one in here]
            panel.plot(
                [one["desired"] for one in here],
                values,
                style,
                marker="o",
                markersize=4,
                color=colour,
                label=name,
            )
        panel.set(xlabel="desired speed (m/s)", ylabel=label, xlim=(SPEEDS[0] - 0.05, SPEEDS[-1] + 0.05))
        panel.set_ylim(bottom=0.0)
    axes[3].set(yscale="log", ylim=(1e-4, 2.0))
    axes[3].axhline(SLIPS, color="#444444", linestyle=":", linewidth=1.0)
    axes[3].text(SPEEDS[-1], SLIPS, "slips", ha="right", va="bottom", fontsize=9)
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(names), frameon=False
    )
    return figure


def main() -> int:
    """Tune, run, print the table, write the files; return 0."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "-o", dest="out", metavar="DIR", default="build", help="output folder (default: build)"
    )
    parser.add_argument("--jobs", type=int, metavar="N", default=2, help="number of processes (default: 2)")
    args = parser.parse_args()
    names, found = [*USUAL, *NOSLIP], []
    with ProcessPoolExecutor(args.jobs) as pool:
        parameters: dict[str, dict[str, float]] = {}
        for name in names:
            same = name == "noslip, Type IV, grip limiter"  # the limiter does not act on the tuning run
            parameters[name] = parameters["noslip, Type IV"] if same else tuned(name, pool.map)
            print(name, {key: round(value, 3) for key, value in parameters[name].items()}, flush=True)
        cases = [(name, speed, mu, parameters[name]) for name in names for mu in FLOORS for speed in SPEEDS]
        for (name, speed, mu, _), result in zip(cases, pool.map(run, *zip(*cases, strict=True)), strict=True):
            found.append({"controller": name, "desired": speed, "mu": mu, **result})
            print(
                name,
                speed,
                mu,
                {k: round(v, 4) if isinstance(v, float) else v for k, v in result.items()},
                flush=True,
            )
    out = Path(args.out)
    out.mkdir(parents=True, exist_ok=True)
    write_whole(out / "following.json", json.dumps({"parameters": parameters, "runs": found}, indent=1))
    write_whole(out / "following.png", pictures(lambda: draw(found), TITLE, "")["png"])
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
