"""Figures 8 (a) and (b): a circle followed at 5 m/s from beside it,
from different headings and at different initial speeds."""

import math

import matplotlib.figure
import numpy as np
from matplotlib.axes import Axes

from ....simulation.drawing import COLOURS, STOP, legend_below, over_time, panels, plane, start, to_follow
from ..framework import Case, Claim, Figure, FigureRun, Runs
from ..measures import time_to_stay_within

CENTRE, RADIUS = np.array([20.0, 20.0]), 10.0  # m
NORMAL = math.degrees(-math.atan2(1, 2))  # degrees, of the circle at the start's foot point
HEADINGS = (-90.0, -45.0, 0.0, 45.0, 90.0, 135.0, 180.0)  # degrees
SPEEDS = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)  # m/s
FIRST = 4.0  # s, shown near the start
ASSUMED = (
    "the circle's place on x + 2y = 60, centre (20, 20) m, and its radius 10 m; gains kp 4, kd 5 (poles −1, "
    "−4), kv 2; wheel radius 0.15 m"
)


def distance(run: FigureRun) -> np.ndarray:
    """Signed distance of P_l from the circle, m, positive outside."""
    return np.hypot(*(run.P_l - CENTRE).T) - RADIUS


def draw_circle(axes: Axes) -> None:
    """The circle to follow."""
    angle = np.linspace(0, 2 * np.pi, 361)
    x, y = CENTRE[:, None] + RADIUS * np.array([np.cos(angle), np.sin(angle)])
    to_follow(axes, x, y, "circle to follow")


def _degrees(heading: float) -> str:
    return f"{heading:+.2f}°".replace(".00°", "°").replace("-", "−").replace("+0°", "0°")


def draw_8a(runs: Runs) -> matplotlib.figure.Figure:
    """Paths of P_l, whole and near the start, and the distance from the circle;
    the refused headings as arrows."""
    figure, axes = panels(
        "paths of $P_l$, 5 m/s",
        "near the start, arrows: initial heading",
        "distance from the circle",
        height=5.4,
    )
    done = {label: run for label, run in runs.items() if not run.refused}
    for panel in axes[:2]:
        draw_circle(panel)
    for (label, run), colour in zip(done.items(), COLOURS, strict=False):
        axes[0].plot(*run.P_l.T, color=colour, alpha=0.8)
        axes[1].plot(*run.P_l[run.t < FIRST].T, color=colour)
        _arrow(axes[1], run.P_l[0], run.heading[0], colour, "-")
        turn = "clockwise" if run.yaw_rate[-1] < 0 else "counterclockwise"
        axes[2].plot(run.t, distance(run), color=colour, label=f"{label}, {turn}")
    place = run.P_l[0]
    for label, run in runs.items():
        if run.refused and run.spec.initial:
            end = _arrow(axes[1], place, run.spec.initial.heading or 0.0, STOP, ":", 1.9)
            ahead = end[0] > place[0]
            axes[1].annotate(
                f"{label}:\nsingular,\nrefused",
                end,
                (4, 0) if ahead else (-4, 0),
                textcoords="offset points",
                color=STOP,
                ha="left" if ahead else "right",
                va="center",
            )
    for panel in axes[:2]:
        start(panel, place, "start (30, 15) m")
    plane(axes[0], np.array([[8.5, 8.5], [33.0, 31.5]]))
    plane(axes[1], np.array([[27.2, 11.8], [33.2, 19.5]]))
    legend_below(axes[0])
    over_time(axes[2], "distance (m), outside positive")
    axes[2].set_xlim(0, 6)
    axes[2].axhline(0.0, color="black", linewidth=0.8)
    axes[2].legend(loc="upper right", title="initial heading, sense of rotation")
    return figure


def _arrow(
    axes: Axes, place: np.ndarray, heading: float, colour: str, style: str, length: float = 1.2
) -> tuple[float, float]:
    """An arrow of some m; answers its end."""
    x, y = place
    end = x + length * math.cos(heading), y + length * math.sin(heading)
    drawn = {"arrowstyle": "-|>", "color": colour, "linestyle": style, "linewidth": 1.8}
    axes.annotate("", end, (x, y), arrowprops=drawn, zorder=4)
    return end


def claims_8a(runs: Runs) -> list[Claim]:
    """Return the claims: all runs converge to the circle; the two headings normal to it are rejected as
    singular."""
    done = {label: run for label, run in runs.items() if not run.refused}
    refused = [label for label, run in runs.items() if run.refused]
    end = max(abs(distance(run)[-1]) for run in done.values())
    settled = max(time_to_stay_within(run.t, distance(run), 0.01) for run in done.values())
    speed = max(np.abs(run.speed - 5.0).max() for run in done.values())
    turns = [np.sign(run.yaw_rate[-1]) for run in done.values()]
    inner = max(
        abs(np.hypot(*(run.P_o[-1] - CENTRE)) - math.sqrt(RADIUS**2 - run.ahead**2)) for run in done.values()
    )
    singular = [label for label in refused if "singular" in runs[label].refused]
    return [
        Claim(
            "the response is satisfactory from every other heading: all settle on the circle",
            f"within 1 cm from {settled:.2f} s on, {end * 1e3:.3f} mm off at {run_end(done):g} s (worst of "
            f"{len(done)})",
            end < 1e-3 and settled < 10 and all(run.stopped is None for run in done.values()),
            note=f"{turns.count(1.0)} of them counterclockwise, {turns.count(-1.0)} clockwise: nothing says "
            "which way round",
            paper=True,
        ),
        Claim(
            "headings along the shortest line to the path, −26.6° and 153.4°, are singular",
            "refused before the start, in C and in CasADi: " + " and ".join(singular),
            len(singular) == 2 == len(refused),
            note=runs[singular[0]].refused if singular else "",
            paper=True,
        ),
        Claim("the forward speed stays 5 m/s throughout, to 1e-9 m/s", f"{speed:.1e} m/s", speed <= 1e-9),
        Claim(
            "in the end P_o runs on a circle of √(R² − d²), to 1 mm",
            f"{inner * 1e3:.4f} mm off",
            inner <= 1e-3,
        ),
    ]


def run_end(runs: Runs) -> float:
    """When the runs end, s."""
    return max(float(run.t[-1]) for run in runs.values())


def draw_8b(runs: Runs) -> matplotlib.figure.Figure:
    """Paths near the start and the distance from the circle, for every initial speed."""
    figure, axes = panels(
        "paths of $P_l$, heading 0°", "near the start", "distance from the circle", widths=(1, 1.1, 1)
    )
    for panel in axes[:2]:
        draw_circle(panel)
    for (label, run), colour in zip(runs.items(), COLOURS, strict=False):
        axes[0].plot(*run.P_l.T, color=colour, label=label)
        axes[1].plot(*run.P_l[run.t < FIRST].T, color=colour)
        off = distance(run)
        axes[2].plot(run.t, off, color=colour, label=f"{label}: up to {off.max():.2f} m")
    place = runs[label].P_l[0]
    for panel in axes[:2]:
        start(panel, place, "start (30, 15) m")
    plane(axes[0], np.array([[8.5, 8.5], [33.0, 31.5]]))
    plane(axes[1], np.array([[28.6, 14.6], [32.0, 19.0]]))
    legend_below(axes[0], 2, title="initial speed")
    over_time(axes[2], "distance (m)")
    axes[2].set_xlim(0, 6)
    axes[2].axhline(0.0, color="black", linewidth=0.8)
    axes[2].legend(loc="upper right")
    return figure


def claims_8b(runs: Runs) -> list[Claim]:
    """Return the claims: with lower initial speed the deviation is smaller."""
    furthest = {label: distance(run).max() for label, run in runs.items()}
    strays = [value - distance(runs[label])[0] for label, value in furthest.items()]
    end = max(abs(distance(run)[-1]) for run in runs.values())
    return [
        Claim(
            "heading away from the path, the system does better when the initial speed is less: it strays "
            "less",
            "furthest from the circle: "
            + ", ".join(f"{label} {value:.2f} m" for label, value in furthest.items()),
            bool(np.all(np.diff(strays) > 1e-3)),
            paper=True,
        ),
        Claim(
            "from every initial speed it settles on the circle",
            f"{end * 1e3:.3f} mm off at {run_end(runs):g} s",
            end < 1e-3,
        ),
    ]


FIGURES = (
    Figure(
        "8a",
        "Figure 8 (a): a circle followed from different initial headings",
        "From one point beside the circle, at the desired 5 m/s, every initial heading works except the two "
        "normal to the circle.",
        ASSUMED,
        {
            _degrees(heading): Case(
                "figure_8.toml", {"initial.heading": math.radians(heading)}, heading in (NORMAL, NORMAL + 180)
            )
            for heading in (*HEADINGS, NORMAL, NORMAL + 180)
        },
        draw_8a,
        claims_8a,
    ),
    Figure(
        "8b",
        "Figure 8 (b): a circle followed from different initial speeds",
        "The same start, heading 0°, away from the circle; the desired speed is 5 m/s.",
        ASSUMED + "; which initial speeds",
        {f"{speed:g} m/s": Case("figure_8.toml", {"initial.speed": speed}) for speed in SPEEDS},
        draw_8b,
        claims_8b,
    ),
)
