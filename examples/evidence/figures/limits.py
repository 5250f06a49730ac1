"""Beyond the paper: motors that cannot give what is asked for,
each cut by itself or the robot slowed down."""

import matplotlib.figure
import numpy as np

from ....simulation.drawing import (
    COLOURS,
    FAINT,
    STOP,
    legend_below,
    over_time,
    panels,
    plane,
    say,
    start,
    to_follow,
    zoom,
)
from ..framework import Case, Claim, Figure, FigureRun, Runs

RADIUS, SPEED, LIMIT, TOO_LOW = 5.0, 5.0, 6.0, 4.5  # m, m/s, N m, N m
UNLIMITED, CUT, SLOW, LOW = "no limits", "cut", "slow", f"slow, {TOO_LOW:g} N m"
NAMES = {UNLIMITED: UNLIMITED, CUT: "each motor cut at 6 N m", SLOW: "slowed down at 6 N m"}
HUGE = 1e6  # N m: no limit in effect


def _off(run: FigureRun) -> np.ndarray:
    """Distance of P_l from the circle, m."""
    return np.hypot(*run.P_l.T) - RADIUS


def draw_limits(runs: Runs) -> matplotlib.figure.Figure:
    """Path, distance, speed, torques."""
    titles = ("path of $P_l$", "distance from the circle", "forward speed", "larger torque of both motors")
    figure, axes = panels(*titles, height=5.0, widths=(1.25, 1, 1, 1))
    angle = np.linspace(0, 2 * np.pi, 361)
    x, y = circle = RADIUS * np.array([np.cos(angle), np.sin(angle)])
    to_follow(axes[0], x, y, "circle to follow")
    worst = int(np.abs(_off(runs[CUT])).argmax())
    inset = zoom(axes[0], (0.32, 0.4, 0.34, 0.3), runs[CUT].P_l[worst], 0.5)
    to_follow(inset, x, y)
    for (label, name), colour, style in zip(
        NAMES.items(), (FAINT, COLOURS[1], COLOURS[0]), (":", "-", "--"), strict=True
    ):
        run = runs[label]
        lap = run.t < 7.0
        if label != UNLIMITED:
            for panel in (axes[0], inset):
                panel.plot(*run.P_l[lap].T, style, color=colour, label=name)
            axes[1].plot(
                run.t,
                _off(run) * 100,
                style,
                color=colour,
                label=f"{label}: up to {np.abs(_off(run)).max() * 100:.1g} cm"
                if label == SLOW
                else f"{label}: up to {np.abs(_off(run)).max() * 100:.1f} cm",
            )
        axes[2].plot(run.t, run.speed, style, color=colour, label=label)
        axes[3].plot(run.t, np.abs(run.tau).max(axis=1), style, color=colour, label=label)
    start(axes[0], np.array([RADIUS, 0.0]), "start, at rest")
    plane(axes[0], 1.1 * circle.T)
    legend_below(axes[0])
    over_time(axes[1], "distance (cm), outside positive")
    over_time(axes[2], "speed (m/s)")
    over_time(axes[3], "torque (N m), absolute")
    axes[3].axhspan(LIMIT, 30, color=STOP, alpha=0.08)
    axes[3].axhline(LIMIT, color=STOP, linewidth=1.2)
    say(axes[3], "more than the motors give", (0.98, 0.66), STOP, ha="right")
    for panel, top in zip(axes[1:], (17, 5.5, 27), strict=True):
        panel.set_xlim(0, 5)
        panel.set_ylim(top=top)
        legend_below(panel)
    return figure


def claims_limits(runs: Runs) -> list[Claim]:
    """Slow keeps the path, cut does not; below what the path itself asks for nothing does."""
    off = {label: float(np.abs(_off(run)).max()) for label, run in runs.items()}
    asked = float(np.abs(runs[UNLIMITED].tau).max())
    bitten = {
        label: float(
            np.diff(runs[label].t, append=runs[label].t[-1])[runs[label].status == "saturated"].sum()
        )
        for label in (CUT, SLOW)
    }
    over = max(float(np.abs(runs[label].tau).max()) for label in (CUT, SLOW))
    first = {label: float(run.t[np.argmax(run.speed >= 0.98 * SPEED)]) for label, run in runs.items()}
    steady = float(np.abs(runs[UNLIMITED].tau[-1]).max())
    return [
        Claim(
            f"the limit bites: {LIMIT:g} N m where {asked:.1f} N m are asked for, and is kept",
            f"saturated for {bitten[CUT]:.2f} s (cut) and {bitten[SLOW]:.2f} s (slow), torques at most "
            f"{over:.3f} N m",
            asked > 2 * LIMIT and over <= LIMIT * (1 + 1e-12) and min(bitten.values()) > 0.2,
        ),
        Claim(
            "cutting each motor by itself leaves the path", f"up to {off[CUT] * 100:.1f} cm", off[CUT] > 0.05
        ),
        Claim(
            "slowing down keeps the path: the same as without limits, to 1e-9 m",
            f"off by {off[SLOW]:.1e} m, without limits by {off[UNLIMITED]:.1e} m",
            max(off[SLOW], off[UNLIMITED]) <= 1e-9,
        ),
        Claim(
            "and costs no time against cutting",
            "98 % of the speed after "
            + ", ".join(f"{first[label]:.2f} s ({label})" for label in (UNLIMITED, CUT, SLOW)),
            first[UNLIMITED] < first[SLOW] <= first[CUT] + 0.05,
        ),
        Claim(
            f"a limit below what the path needs at the desired speed ({steady:.2f} N m steadily) cannot be "
            "made good by slowing",
            f"at {TOO_LOW:g} N m up to {off[LOW]:.2f} m off",
            steady > TOO_LOW and off[LOW] > 0.1,
            note="it gives up acceleration, not speed already gained: the desired speed has to suit the "
            "path's curvature",
        ),
    ]


FIGURES = (
    Figure(
        "limits",
        "Beyond the paper: torque limits, cut or slowed down",
        "Motors have limits. Cut one by one, the torques no longer steer as asked; with less acceleration "
        "asked for they do.",
        "wheel radius 0.15 m (torques depend on it)",
        {
            UNLIMITED: Case("limits.toml", {"limits.torque": HUGE}),
            CUT: Case("limits.toml", {"limits.mode": "cut"}),
            SLOW: Case("limits.toml"),
            LOW: Case("limits.toml", {"limits.torque": TOO_LOW}),
        },
        draw_limits,
        claims_limits,
    ),
)
