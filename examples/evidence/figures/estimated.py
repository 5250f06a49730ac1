"""Figures 15 and 16 again with the extended Kalman filter in place of dead reckoning and resets."""

from typing import Any

import matplotlib.figure
import numpy as np

from ....simulation.drawing import COLOURS, legend_below, over_time, panels, plane
from ..framework import Case, Claim, Figure, FigureRun, Runs
from . import circle
from .sensing import ASSUMED, FIRST, LEFT_MEANS, RIGHT_MEAN, SD, SETTLED

RESET, FILTER = "reset", "filter"
RATES = (1.0, 2.0)  # Hz, of figures 15 and 16
TOLD: dict[str, Any] = {
    "noise": 0.055,  # sqrt(rad): 3 rad/s over 10 ms, at 33 rad/s
    "scales": {"thetadot_r": 0.2, "thetadot_l": 0.2},
}
POSE = {"sd": 0.05, "heading_sd": 0.02}  # m, rad


def _label(kind: str, rate: float, left: str) -> str:
    return f"{kind} at {rate:g} Hz, {left}"


def _cases() -> dict[str, Case]:
    cases = {}
    for left, mean in LEFT_MEANS.items():
        noise = {"sensors.noise": {"mean": [RIGHT_MEAN, mean], "sd": SD}}
        for rate in RATES:
            estimator = {"estimator": {**TOLD, "pose": {"rate": rate, **POSE}}}
            cases[_label(RESET, rate, left)] = Case("figure_14.toml", {**noise, "correction": {"rate": rate}})
            cases[_label(FILTER, rate, left)] = Case("figure_14.toml", {**noise, **estimator})
    return cases


def rms(run: FigureRun) -> float:
    """RMS distance of P_l from the circle after it has settled, m."""
    off = circle.distance(run)[run.t >= SETTLED]
    return float(np.sqrt((off**2).mean()))


def draw(runs: Runs) -> matplotlib.figure.Figure:
    """Paths and distances at 1 Hz, RMS distances of all runs."""
    figure, axes = panels(
        f"paths, 1 Hz, {FIRST} rad/s", "distance from the circle, 1 Hz", "rms distance", height=5.2
    )
    for kind, colour in ((RESET, COLOURS[1]), (FILTER, COLOURS[0])):
        run = runs[_label(kind, RATES[0], FIRST)]
        axes[0].plot(*run.P_l.T, color=colour, label=f"$P_l$, {kind}")
        axes[1].plot(
            run.t,
            circle.distance(run),
            color=colour,
            label=f"{kind}: rms {rms(run):.2f} m from {SETTLED:g} s on",
        )
    turn = np.linspace(0, 2 * np.pi, 200)
    circled = np.array(circle.CENTRE) + circle.RADIUS * np.column_stack([np.cos(turn), np.sin(turn)])
    axes[0].plot(*circled.T, "--", color="black", linewidth=1.0, label="circle")
    plane(axes[0], run.P_l, runs[_label(RESET, RATES[0], FIRST)].P_l)
    legend_below(axes[0], 3)
    over_time(axes[1], "distance (m), outside positive")
    axes[1].axhline(0.0, color="black", linewidth=0.8)
    legend_below(axes[1], 1)
    names = [(rate, left) for rate in RATES for left in LEFT_MEANS]
    for k, (kind, colour) in enumerate(((RESET, COLOURS[1]), (FILTER, COLOURS[0]))):
        values = [rms(runs[_label(kind, *name)]) for name in names]
        bars = axes[2].bar(np.arange(len(names)) + 0.4 * k, values, 0.38, color=colour, label=kind)
        axes[2].bar_label(bars, [f"{value:.2f}" for value in values], fontsize=8.5)
    axes[2].set_xticks(
        np.arange(len(names)) + 0.2, [f"{rate:g} Hz\n{left}" for rate, left in names], fontsize=8.5
    )
    axes[2].set_ylabel(f"rms distance from {SETTLED:g} s on (m)")
    axes[2].legend(loc="upper right")
    return figure


def claims(runs: Runs) -> list[Claim]:
    """The filter stays nearer to the circle, although its poses have errors and those of the resets have
    none."""
    names = [(rate, left) for rate in RATES for left in LEFT_MEANS]
    pairs = {name: [rms(runs[_label(kind, *name)]) for kind in (RESET, FILTER)] for name in names}
    return [
        Claim(
            "with the filter the vehicle stays nearer to the circle than with resets",
            "; ".join(
                f"{rate:g} Hz, {left}: {reset:.2f} m, {ours:.2f} m"
                for (rate, left), (reset, ours) in pairs.items()
            ),
            all(ours < reset for reset, ours in pairs.values()),
            note="its poses have errors (5 cm, 0.02 rad), those of the resets have none; it estimates the "
            "scale of each wheel's rate, by which the rates that the controller uses are corrected too",
        ),
    ]


FIGURES = (
    Figure(
        "estimated",
        "Beyond the paper: figures 15 and 16 with an extended Kalman filter",
        "The same noise; the pose is estimated from the wheels and from poses with errors, with the scale of "
        "each wheel's rate.",
        f"{ASSUMED}; measured poses have errors of 5 cm and 0.02 rad",
        _cases(),
        draw,
        claims,
    ),
)
