"""Beyond the paper: driving in reverse with the reference point on the wrong side of the axle,
and on the right one."""

import math
from collections.abc import Callable

import matplotlib.figure
import numpy as np
from scipy.optimize import brentq

from ....simulation.drawing import COLOURS, STOP, over_time, panels, plane, say, start, to_follow
from ..framework import Case, Claim, Figure, FigureRun, Runs
from ..vehicle import draw_vehicle

WRONG, RIGHT, CONTINUOUS = "P_l ahead of the axle", "P_l behind the axle", "ahead, continuous"
POLES = (0.5, 2.0)  # 1/s, of the distance under kp 1, kd 2.5
LONGEST = 10.0  # s
UNTIL = 1.45  # s: shortly before the wrong side is singular


def sine(run: FigureRun) -> np.ndarray:
    """s = n . (cos phi, sin phi), n being (0, 1)."""
    return np.sin(run.heading)


def predicted(run: FigureRun) -> Callable[[np.ndarray | float], np.ndarray]:
    """s(t) in closed form from the start alone, for constant v: l ds/dt + v s = h1',
    h1 a sum of two exponentials."""
    v, lookahead, s = float(run.speed[0]), float(run.place[0, 0]) + run.ahead, float(sine(run)[0])
    h, rate = float(run.P_l[0, 1]), float(run.speed[0]) * s  # not turning
    a, b = POLES
    first = (rate + b * h) / (b - a)  # h1 = first exp(-a t) + (h - first) exp(-b t)
    driven = [(p, -p * size / (v - p * lookahead)) for p, size in ((a, first), (b, h - first))]
    own = s - sum(size for _, size in driven)
    return lambda t: own * np.exp(-v * t / lookahead) + sum(size * np.exp(-p * t) for p, size in driven)


def singular_at(run: FigureRun) -> float:
    """When |s| = 1 by the closed form, s; infinite when not within LONGEST."""
    s = predicted(run)
    return float(brentq(lambda t: 1 - abs(s(t)), 0.0, LONGEST)) if abs(s(LONGEST)) > 1 else float("inf")


def draw_reversing(runs: Runs) -> matplotlib.figure.Figure:
    """Where either robot goes; s over time with its closed form."""
    figure, axes = panels(
        "$P_l$ ahead of the axle (L = 0)",
        "$P_l$ behind the axle (L = −0.6 m)",
        "s, the sine of the angle to the path",
        height=3.8,
        widths=(1.1, 1.1, 1),
    )
    for panel, label, colour in zip(axes, (WRONG, RIGHT), (COLOURS[1], COLOURS[0]), strict=False):
        run = runs[label]
        to_follow(panel, np.array([-12.0, 3.0]), np.zeros(2), "line to follow, in reverse (to the left)")
        panel.plot(*run.P_o.T, color=colour, label="path of the axle's middle")
        panel.plot(*run.P_l.T, ":", color=colour, label="path of $P_l$")
        instants = (0.0, 1.35, run.t[-1]) if label == WRONG else (0.0, 2.5)
        for t in instants:
            draw_vehicle(
                panel,
                run,
                int(np.searchsorted(run.t, t - 1e-9)),
                STOP if run.stopped and t == run.t[-1] else colour,
            )
        start(panel, run.P_l[0], "start of $P_l$")
        plane(panel, np.array([[-3.6, -2.9], [1.2, 1.4]]))
        panel.legend(loc="lower left", fontsize=8.5)
        closed = predicted(run)
        t = run.t[run.t < 4.0]
        axes[2].semilogy(t, np.abs(sine(run))[: len(t)], color=colour, label=label.replace("P_l", "$P_l$"))
        dots = np.arange(0.0, min(4.0, run.t[-1]), 0.2)
        axes[2].semilogy(dots, np.abs(closed(dots)), "o", color=colour, markersize=4)
    stopped = runs[WRONG]
    say(axes[0], f"stopped after {stopped.t[-1]:.2f} s:\nnormal to the path,\nsingular", (0.03, 0.83), STOP)
    axes[2].semilogy([], [], "o", color="black", markersize=4, label="closed form")
    axes[2].axhline(1.0, color=STOP, linewidth=1.2)
    axes[2].plot(stopped.t[-1], 1.0, "X", color=STOP, markersize=9)
    axes[2].annotate(
        "singular: |s| = 1", (stopped.t[-1], 1.0), (8, 5), textcoords="offset points", color=STOP
    )
    over_time(axes[2], "|s|")
    axes[2].set_ylim(2e-3, 2)
    axes[2].legend(loc="lower left")
    return figure


def claims_reversing(runs: Runs) -> list[Claim]:
    """Wrong side: the heading runs away at v / l. Right side: it comes back at the same rate."""
    wrong, right, continuous = (runs[label] for label in (WRONG, RIGHT, CONTINUOUS))
    expected = singular_at(wrong)
    unlike = {
        label: float(np.abs(sine(runs[label]) - predicted(runs[label])(runs[label].t)).max())
        for label in (CONTINUOUS, RIGHT)
    }
    levers = [float(run.place[0, 0]) + run.ahead for run in (wrong, right)]
    end, angle = float(np.abs(right.P_l[-1, 1])), math.degrees(abs(right.heading[-1]))
    speed = float(np.abs(continuous.speed + 1.0).max())
    return [
        Claim(
            "with P_l on the wrong side (v and L + d of opposite signs) the heading runs away and the law "
            "becomes singular",
            f"L + d = {levers[0]:+.1f} m at −1 m/s: from {math.degrees(wrong.heading[0]):.1f}° off to normal "
            f"to the path, {wrong.stopped} at {wrong.t[-1]:.3f} s",
            wrong.stopped == "singular" and levers[0] > 0,
        ),
        Claim(
            "when, is known before: l ds/dt + v s = h1′ in closed form (to 1 %, called every 1 ms)",
            f"predicted {expected:.4f} s, stopped at {wrong.t[-1]:.4f} s",
            abs(wrong.t[-1] / expected - 1) < 0.01,
        ),
        Claim(
            "s(t) is that closed form on either side, to 1e-6 (controller continuous)",
            f"{unlike[CONTINUOUS]:.1e} ahead of the axle (to {UNTIL:g} s), {unlike[RIGHT]:.1e} behind it (to "
            f"{right.t[-1]:g} s)",
            max(unlike.values()) <= 1e-6 and continuous.stopped is None,
        ),
        Claim(
            'with reversing = "switch" P_l changes to the other side of the axle and the robot follows the '
            "path in reverse",
            f"L + d = {levers[1]:+.1f} m; {end * 1e3:.1f} mm and {angle:.3f}° off after {right.t[-1]:g} s",
            right.stopped is None and levers[1] < 0 and end < 5e-3 and angle < 0.2,
        ),
        Claim(
            "the outputs are controlled perfectly all the while, so that nothing warns: the speed to "
            "1e-9 m/s",
            f"{speed:.1e} m/s",
            speed <= 1e-9,
        ),
    ]


FIGURES = (
    Figure(
        "reversing",
        "Beyond the paper: in reverse, with the reference point on the wrong side and on the right one",
        "Where v / (L + d) is negative the zero dynamics are unstable: pushed from the wrong end, the robot "
        "jackknifes.",
        "",
        {
            WRONG: Case("reversing.toml", {"simulation.period": 1e-3}),
            RIGHT: Case("reversing.toml", {"output.reversing": "switch"}),
            CONTINUOUS: Case("reversing.toml", {"simulation.duration": UNTIL}),
        },
        draw_reversing,
        claims_reversing,
    ),
)
