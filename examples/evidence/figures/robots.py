"""Beyond the paper: the other shipped robots, each in the run of its own SPEC, drawn to scale."""

from collections.abc import Sequence
from typing import Any

import casadi as ca
import matplotlib.figure
import numpy as np
from matplotlib.axes import Axes
from scipy.interpolate import CubicSpline

from ....model.outputs import output_map
from ....readers.robots import system_of
from ....simulation import drawing
from ....simulation.drawing import (
    COLOURS,
    DESIRED,
    FAINT,
    STOP,
    legend_below,
    over_time,
    panels,
    plane,
    start,
    to_follow,
)
from ..framework import Case, Claim, Figure, FigureRun, Runs

# Of what an output was off at most, at the end; where the plant is believed another
LEFT_OVER, LEFT_OVER_WRONG = 0.03, 0.2
BALANCE = 1e-6  # of the most that the energy differs from its start: what it may differ from the work done
DRAWN = 5  # times that a robot is drawn on its way
FINE = 200  # places each way between which the path is drawn
RUN = "run"
PARTS = {  # lines of a robot's drawing that its figure names, by their place in `Mechanism.lines`
    "ball_plate": {0: "ball", 1: "middle of the plate above"},
    "mobile_manipulator": {0: "platform", 3: "arm"},
}

TITLES = {  # name -> title, why it is here
    "knife_edge": ("Knife edge round a circle", "The smallest robot that rolls."),
    "rolling_disk": (
        "Rolling disk to a line",
        "A coordinate more than the knife edge has: its rolling angle.",
    ),
    "car": ("Car round a circle", "Steered in front, driven behind: P_l is ahead of the steered wheel."),
    "tricycle": ("Tricycle to a line", "Driven and steered in front, so that it can turn on the spot."),
    "tractor_trailer": ("Tractor with three trailers", "A chain: its reduced equations come body by body."),
    "ball_plate": (
        "Ball between two plates",
        "Rolling in space: the plate above rolls the ball along a line.",
    ),
    "turntable_ball": ("Ball across a turntable", "Constraints that move: the turntable drives the ball."),
    "four_wheel": (
        "Jointed platform with four motors",
        "Four torques for two degrees of freedom, shared by weights.",
    ),
    "mobile_manipulator": (
        "Platform with an arm",
        "Four outputs: the arm's end point follows a line, the platform the arm.",
    ),
    "geared_arm": ("Geared arm", "Holonomic constraints only: gears between motors and joints; and gravity."),
    "slope_platform": (
        "Platform on a slope",
        "Gravity and friction; the slope is steeper than the controller believes.",
    ),
    "turtlebot3_burger": (
        "TurtleBot3 Burger to a line",
        "A robot that can be bought, with the numbers of its description.",
    ),
    "turtlebot3_waffle_pi": ("TurtleBot3 Waffle Pi round a circle", "A wider one of the same maker."),
    "pioneer_3dx": ("Pioneer 3-DX to a line", "The usual platform of laboratories."),
    "f1tenth": ("Car of F1TENTH round a circle", "A car's geometry, small and fast."),
    "bus": ("Bus round a circle", "Both axles steered: the rear one against the front one."),
    "castor_platform": (
        "Platform with castors to a line",
        "The paper's platform with what it ignores: castors as bodies.",
    ),
    "mecanum": (
        "Platform on mecanum wheels",
        "Rollers at 45 degrees: four wheels, three degrees of freedom.",
    ),
    "forklift": ("Forklift to a line", "A tricycle with its load on the wheels behind."),
}


SOURCED = (
    "bus",
    "mecanum",
    "turtlebot3_burger",
    "turtlebot3_waffle_pi",
    "pioneer_3dx",
    "f1tenth",
    "forklift",
)  # not all numbers are assumed


def draw(runs: Runs) -> matplotlib.figure.Figure:
    """The way with the robot on it, what the outputs are off, the inputs, and where the energy goes."""
    run = runs[RUN]
    robot = run.robot
    figure, axes = panels(
        "path", "error: output − desired", "inputs", "energy", height=5.0, widths=(1.5, 1, 1, 1)
    )
    _draw_way(axes[0], run)
    output = output_map(system_of(robot), run.spec.output.law)
    for row, error, colour in zip(output.rows, run.error.T, COLOURS, strict=False):
        axes[1].plot(run.t, error, color=colour, label=f"{row.name} ({row.unit})")
    units = ", ".join(dict.fromkeys(row.unit for row in output.rows))
    over_time(axes[1], f"error ({units})")
    for given, values, colour in zip(robot.inputs, run.tau.T, COLOURS, strict=False):
        axes[2].plot(run.t, values, color=colour, label=f"{given.name} ({given.unit})")
    over_time(axes[2], f"input ({', '.join(dict.fromkeys(given.unit for given in robot.inputs))})")
    axes[3].plot(
        run.t, run.energy - run.energy[0], color=COLOURS[0], linewidth=3.5, alpha=0.5, label="energy E − E(0)"
    )
    axes[3].plot(run.t, work(run), color=STOP, linestyle="--", label="work of inputs and friction")
    over_time(axes[3], "energy (J)")
    for panel in axes[1:]:
        panel.axhline(0.0, color=FAINT, linewidth=0.8, zorder=0)
        legend_below(panel)
    return figure


def _draw_way(axes: Axes, run: FigureRun) -> None:
    """The desired path, where the vehicle's point or the controlled place went,
    and the robot at instants spread over its way."""
    robot = run.robot
    output = output_map(system_of(robot), run.spec.output.law)
    if output.path:
        point, label = run.P_l, "$P_l$"
    else:
        point, label = run.y[:, :2], ", ".join(row.name for row in output.rows[:2])
        x, y = run.y_d[:, :2].T
        to_follow(axes, x, y, "desired")
    axes.plot(*point.T, color=COLOURS[1], label=f"locus of {label}", zorder=2)
    start(axes, point[0])
    instants, everything = _apart(run, point), [point]
    named = PARTS.get(robot.name, {})
    for n, line in enumerate(drawing.outlines(robot, run.q[instants], run.plant)):
        style: dict[str, Any] = {
            "color": COLOURS[(0, 3)[n > 0]] if n in named else "#333333",
            "linewidth": 2.2 if n in named and n else 1.1,
        }
        for k, part in zip(instants, line, strict=True):
            axes.plot(*part.T, alpha=0.4 + 0.6 * (k / (len(point) - 1)), zorder=3, **style)
        axes.plot([], [], label=named.get(n), **style) if n in named else None
        everything += [*line]
    if output.path:
        path = drawing.implicit_path(output)
        everything.append(path(point[[0, -1]].T, run.config[0])[1].full().T)
        _draw_path(axes, path, run.config[0], everything)
    plane(axes, *everything)
    vertical = [row.about.split()[0] for row in output.rows[:2]] == ["x", "height"]
    axes.set(ylabel="height z (m)" if vertical else "y (m)")
    legend_below(axes, 2)


def _apart(run: FigureRun, point: np.ndarray) -> np.ndarray:
    """Instants at which the robot is drawn: as many up to DRAWN as fit along its way without covering one
    another."""
    across = float(
        np.ptp(
            np.vstack([line[0] for line in drawing.outlines(run.robot, run.q[:1], run.plant)]), axis=0
        ).max()
    )
    length = float(np.hypot(*np.diff(point, axis=0).T).sum())
    return np.unique(drawing.evenly_spread(point, int(np.clip(1 + length / across, 2, DRAWN))))


def _draw_path(axes: Axes, path: ca.Function, config: np.ndarray, shown: Sequence[np.ndarray]) -> None:
    """The curve that is followed, also some way beyond what is shown."""
    low, high = (
        np.min([part.min(axis=0) for part in shown], axis=0),
        np.max([part.max(axis=0) for part in shown], axis=0),
    )
    (x, y), half = (low + high) / 2, 1.5 * (high - low).max()
    places = np.linspace(x - half, x + half, FINE), np.linspace(y - half, y + half, FINE)
    drawing.draw_implicit(
        axes, path, config, *places, "path to follow", color=DESIRED, linewidth=5, alpha=0.45
    )


def work(run: FigureRun) -> np.ndarray:
    """Integral of the power of inputs and friction, J, (N,), by splines through the rows."""
    return CubicSpline(run.t, run.power).antiderivative()(run.t)


def claims(runs: Runs) -> list[Claim]:
    """Every output reaches its desired value, and the energy is the work done."""
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
        paper=f"Not in the paper. {why}" + " All numbers are assumed." * (name not in SOURCED),
        assumed="",
        cases={RUN: Case(f"../robots/{name}.toml")},
        draw=draw,
        claims=claims,
    )
    for name, (title, why) in TITLES.items()
)
