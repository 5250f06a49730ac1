"""Beyond the paper: the other shipped robots, each in the run of its own SPEC, drawn to scale."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import casadi as ca
import matplotlib.figure
import numpy as np
from matplotlib.axes import Axes
from scipy.interpolate import CubicSpline

from ...model.law import symbols
from ...model.outputs import OutputMap, output_map
from ...readers.robots import find_robot, system_of
from ...simulation.drawing import COLOURS, FAINT, STOP, WANTED, over_time, panels, plane, start, to_follow
from ..framework import Case, Claim, Figure, Outcome, Runs

LEFT_OVER, LEFT_OVER_WRONG = 0.03, 0.2  # of what an output was off at most, at the end; where the plant is believed another
BALANCE = 1e-6  # of the most that the energy differs from its start: what it may differ from the work done
DRAWN = 5  # times that a robot is drawn on its way
FINE = 200  # places each way between which the path is drawn
RUN = "run"

Parts = list[np.ndarray]  # lines (N, 2), m
Point = np.ndarray | tuple[float, float]  # x, y, m
Shape = Callable[[Mapping[str, float]], Parts]


def place(at: Point, heading: float, points: Sequence[tuple[float, float]]) -> np.ndarray:
    """Points given ahead of and left of a place, in the plane."""
    cosine, sine = np.cos(heading), np.sin(heading)
    return np.array(points) @ np.array([[cosine, sine], [-sine, cosine]]) + at


def box(at: Point, heading: float, behind: float, ahead: float, half: float) -> np.ndarray:
    """A body as a closed line."""
    return place(at, heading, [(-behind, -half), (ahead, -half), (ahead, half), (-behind, half), (-behind, -half)])


def wheels(at: Point, heading: float, half: float, r: float) -> Parts:
    """Two wheels on an axle."""
    return [place(at, heading, [(-r, side), (r, side)]) for side in (-half, half)]


def knife_edge(q: Mapping[str, float]) -> Parts:
    """The blade, 0.4 m long, with its point."""
    return [place((q["x"], q["y"]), q["phi"], [(-0.2, 0), (0.2, 0), (0.1, 0.05), (0.1, -0.05), (0.2, 0)])]


def rolling_disk(q: Mapping[str, float]) -> Parts:
    """From above, 0.03 m thick."""
    return [box((q["x"], q["y"]), q["phi"], q["R"], q["R"], 0.015)]


def steered(q: Mapping[str, float], half: float) -> Parts:
    """Body, rear wheels and what is steered."""
    front = place((q["x"], q["y"]), q["phi"], [(q["l"], 0)])[0]
    return [
        box((q["x"], q["y"]), q["phi"], 0.2 * q["l"], 1.15 * q["l"], half),
        *wheels((q["x"], q["y"]), q["phi"], half, q["r"]),
        place(front, q["phi"] + q["delta"], [(-1.3 * q["r"], 0), (1.3 * q["r"], 0)]),
    ]


def platform(q: Mapping[str, float]) -> Parts:
    """The LABMATE's body, drawn 1.2 m long, with its axle d behind P_c."""
    axle = place((q["x_c"], q["y_c"]), q["phi"], [(-q["d"], 0)])[0]
    return [box(axle, q["phi"], 0.5, 0.7, 0.8 * q["b"]), *wheels(axle, q["phi"], q["b"], q["r"])]


def mobile_manipulator(q: Mapping[str, float]) -> Parts:
    """The platform and the two links."""
    base = place((q["x_c"], q["y_c"]), q["phi"], [(q["a"], 0)])[0]
    elbow = place(base, q["phi"] + q["q_1"], [(q["l_1"], 0)])[0]
    end = place(elbow, q["phi"] + q["q_1"] + q["q_2"], [(q["l_2"], 0)])[0]
    return [*platform(q), np.array([base, elbow, end])]


def geared_arm(q: Mapping[str, float]) -> Parts:
    """The two links."""
    elbow = place((0, 0), q["q_1"], [(q["l_1"], 0)])[0]
    return [np.array([(0, 0), elbow, place(elbow, q["q_1"] + q["q_2"], [(q["l_2"], 0)])[0]])]


def ball_plate(q: Mapping[str, float]) -> Parts:
    """The ball from above, and the plate's frame, drawn 0.1 m wide."""
    angle = np.linspace(0, 2 * np.pi, 41)
    ball = (q["x"], q["y"]) + q["R"] * np.column_stack([np.cos(angle), np.sin(angle)])
    return [ball, box((q["x_p"], q["y_p"]), 0.0, 0.05, 0.05, 0.05)]


def tractor_trailer(q: Mapping[str, float]) -> Parts:
    """The tractor and its trailers, each on an axle, joined by bars."""
    at = np.array([q["x"], q["y"]])
    parts = [box(at, q["phi"], 0.35, 0.6, 0.8 * q["b"]), *wheels(at, q["phi"], q["b"], q["r"])]
    k = 1
    while f"phi_{k}" in q:
        heading, hitch = q[f"phi_{k}"], at
        at = hitch - q[f"l_{k}"] * np.array([np.cos(heading), np.sin(heading)])
        parts += [np.array([hitch, at]), box(at, heading, 0.35, 0.45, 0.4), *wheels(at, heading, 0.45, 0.2)]
        k += 1
    return parts


def four_wheel(q: Mapping[str, float]) -> Parts:
    """The two bodies and their joint."""
    at, heading = np.array([q["x"], q["y"]]), q["phi"] - q["gamma"]
    joint = place(at, q["phi"], [(-q["l_f"], 0)])[0]
    rear = place(joint, heading, [(-q["l_r"], 0)])[0]
    return [
        *(box(at, q["phi"], 0.3, 0.35, 0.8 * q["b"]), *wheels(at, q["phi"], q["b"], q["r"]), np.array([at, joint])),
        *(box(rear, heading, 0.35, 0.4, 0.8 * q["b"]), *wheels(rear, heading, q["b"], q["r"]), np.array([rear, joint])),
    ]


SHAPES: dict[str, Shape] = {
    "knife_edge": knife_edge,
    "rolling_disk": rolling_disk,
    "car": partial(steered, half=0.8),
    "tricycle": partial(steered, half=0.35),
    "tractor_trailer": tractor_trailer,
    "ball_plate": ball_plate,
    "four_wheel": four_wheel,
    "mobile_manipulator": mobile_manipulator,
    "geared_arm": geared_arm,
    "slope_platform": platform,
}
TITLES = {  # name -> title, why it is here
    "knife_edge": ("Knife edge round a circle", "The smallest robot that rolls."),
    "rolling_disk": ("Rolling disk to a line", "A coordinate more than the knife edge has: its rolling angle."),
    "car": ("Car round a circle", "Steered in front, driven behind: P_l is ahead of the steered wheel."),
    "tricycle": ("Tricycle to a line", "Driven and steered in front, so that it can turn on the spot."),
    "tractor_trailer": ("Tractor with three trailers", "A chain: its reduced equations come body by body."),
    "ball_plate": ("Ball between two plates", "Rolling in space: the plate above rolls the ball along a line."),
    "four_wheel": ("Jointed platform with four motors", "Four torques for two degrees of freedom, shared by weights."),
    "mobile_manipulator": (
        "Platform with an arm",
        "Four outputs: the arm's end point follows a line, the platform the arm.",
    ),
    "geared_arm": ("Geared arm", "Holonomic constraints only: gears between motors and joints; and gravity."),
    "slope_platform": ("Platform on a slope", "Gravity and friction; the slope is steeper than the controller believes."),
}


def draw(name: str, runs: Runs) -> matplotlib.figure.Figure:
    """The way with the robot on it, what the outputs are off, the inputs, and where the energy goes."""
    run = runs[RUN]
    robot = find_robot(run.spec.robot)
    figure, axes = panels("way", "outputs less what is wanted", "inputs", "energy", height=4.6, widths=(1.5, 1, 1, 1))
    _draw_way(axes[0], name, run)
    output = output_map(system_of(robot), run.spec.output.law)
    for row, error, colour in zip(output.rows, run.error.T, COLOURS, strict=False):
        axes[1].plot(run.t, error, color=colour, label=f"{row.name} ({row.unit})")
    units = ", ".join(dict.fromkeys(row.unit for row in output.rows))
    over_time(axes[1], f"error ({units})")
    for given, values, colour in zip(robot.inputs, run.tau.T, COLOURS, strict=False):
        axes[2].plot(run.t, values, color=colour, label=f"{given.name} ({given.unit})")
    over_time(axes[2], f"input ({', '.join(dict.fromkeys(given.unit for given in robot.inputs))})")
    axes[3].plot(run.t, run.energy - run.energy[0], color=COLOURS[0], linewidth=3.5, alpha=0.5, label="energy E − E(0)")
    axes[3].plot(run.t, work(run), color=STOP, linestyle="--", label="work of inputs and friction")
    over_time(axes[3], "energy (J)")
    for panel in axes[1:]:
        panel.axhline(0.0, color=FAINT, linewidth=0.8, zorder=0)
        panel.legend(loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=1)
    return figure


def _draw_way(axes: Axes, name: str, run: Outcome) -> None:
    """What was wanted, where the vehicle's point or the controlled place went, and the robot at instants spread over its way."""
    robot, shape = find_robot(run.spec.robot), SHAPES[name]
    path = run.spec.output.path
    output = output_map(system_of(robot), run.spec.output.law)
    if path:
        vehicle = robot.required_vehicle
        went = _of_state(run, ca.vertcat(vehicle.x, vehicle.y))
        heading = _of_state(run, vehicle.heading)[:, 0]
        point = went + run.place[:, :1] * np.column_stack([np.cos(heading), np.sin(heading)])
        label = "$P_l$"
    else:
        point, label = run.y[:, :2], ", ".join(row.name for row in output.rows[:2])
        x, y = run.y_d[:, :2].T
        to_follow(axes, x, y, "wanted")
    axes.plot(*point.T, color=COLOURS[1], label=f"locus of {label}", zorder=2)
    start(axes, point[0])
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(point, axis=0).T))])
    instants = np.searchsorted(way, np.linspace(0.0, way[-1], DRAWN)).clip(max=len(way) - 1)
    everything = [point]
    names = [coordinate.name for coordinate in robot.coordinates]
    for k in instants:
        parts = shape({**run.parameters, **dict(zip(names, run.q[k], strict=True))})
        for part in parts:
            axes.plot(*part.T, color="#333333", linewidth=1.1, alpha=0.4 + 0.6 * (k / (len(way) - 1)), zorder=3)
        everything += parts
    if path:
        everything.append(_foot(run, output, point[[0, -1]]))
        _draw_path(axes, output, run, everything)
    plane(axes, *everything)
    vertical = [row.about.split()[0] for row in output.rows[:2]] == ["x", "height"]
    axes.set(ylabel="height z (m)" if vertical else "y (m)")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=3)


def _distance(output) -> tuple[ca.SX, ca.SX]:
    """A point, and its signed distance from the path."""
    point = ca.SX.sym("point", 2)
    return point, output.path.distance(point[0], point[1])


def _foot(run: Outcome, output: OutputMap, points: np.ndarray) -> np.ndarray:
    """The points of the path next to some points."""
    point, distance = _distance(output)
    foot = point - distance * ca.gradient(distance, point)
    return ca.Function("foot", [point, symbols(output.parameters)], [foot])(points.T, run.config[0]).full().T


def _draw_path(axes: Axes, output: OutputMap, run: Outcome, shown: Parts) -> None:
    """The curve that is followed, where the distance is zero, also some way beyond what is shown."""
    low, high = np.min([part.min(axis=0) for part in shown], axis=0), np.max([part.max(axis=0) for part in shown], axis=0)
    (x_0, y_0), half = (low + high) / 2, 1.5 * (high - low).max()
    x, y = np.meshgrid(np.linspace(x_0 - half, x_0 + half, FINE), np.linspace(y_0 - half, y_0 + half, FINE))
    point, distance = _distance(output)
    function = ca.Function("distance", [point, symbols(output.parameters)], [distance])
    values = function(np.vstack([x.ravel(), y.ravel()]), run.config[0]).full().reshape(x.shape)
    axes.contour(x, y, values, [0.0], colors=WANTED, linewidths=5, alpha=0.45, zorder=0)
    axes.plot([], [], color=WANTED, linewidth=5, alpha=0.45, label="path to follow")


def _of_state(run: Outcome, expression: ca.SX) -> np.ndarray:
    """An expression in coordinates and parameters at every row, (N, its entries)."""
    robot = find_robot(run.spec.robot)
    given = [run.parameters[parameter.name] for parameter in robot.parameters]
    return ca.Function("of_state", [robot.q, robot.p], [expression])(run.q.T, given).full().T


def work(run: Outcome) -> np.ndarray:
    """Integral of the power of inputs and friction, J, (N,), by splines through the rows."""
    return CubicSpline(run.t, run.power).antiderivative()(run.t)


def claims(runs: Runs) -> list[Claim]:
    """Every output comes to what is wanted, and the energy is the work done."""
    run = runs[RUN]
    most = LEFT_OVER_WRONG if run.spec.plant else LEFT_OVER
    peaks = np.abs(run.error).max(axis=0)
    left = float((np.abs(run.error[-1]) / np.maximum(peaks, 1e-9)).max())
    change = run.energy - run.energy[0]
    missing, size = float(np.abs(change - work(run)).max()), float(np.abs(change).max())
    return [
        Claim(
            f"of what an output was off at most, {100 * most:g} % are left at the end",
            f"{100 * left:.2g} %",
            run.stopped is None and left <= most,
        ),
        Claim(
            f"power in is dE/dt: the energy is the work done, to {BALANCE:g} of its largest change",
            f"{missing:.1e} J of {size:.3g} J",
            missing <= BALANCE * size,
        ),
    ]


FIGURES = tuple(
    Figure(
        name=name,
        title=title,
        paper=f"Not in the paper. {why} All numbers are assumed.",
        assumed="",
        cases={RUN: Case(f"../robots/{name}.toml")},
        draw=partial(draw, name),
        claims=claims,
    )
    for name, (title, why) in TITLES.items()
)
