"""Beyond the paper: would the robot still roll? What its runs ask of friction."""

import math

import matplotlib.figure
import numpy as np
from matplotlib.axes import Axes

from ....readers.robots import find_robot
from ....simulation.contact import GRAVITY, Grip
from ....simulation.drawing import COLOURS, FAINT, STOP, legend_below, over_time, panels, say
from ..framework import Case, Claim, Figure, Runs
from . import circle, line

LINES = {f"line {name}": line.LINE[f"IV {name}"] for name in line.SPEEDS}
CIRCLES = {label: case for label, case in circle.FIGURES[0].cases.items() if not case.singular}
GENTLE, PAPERS, ROUND = "line C, gentle gains", "line C", "+90°"
MU = 0.7
SHOWN = {
    PAPERS: "line, case C (figure 1)",
    ROUND: "circle, heading 90° (figure 8 a)",
    GENTLE: "line C, gentle gains",
}
STEADY_SPEEDS = (3.0, 5.0, 9.0)  # m/s, beside those just below and above the limit


def needed_on_circle(v: float) -> float:
    """Friction coefficient that the worse wheel needs at a steady speed v on the circle, L = 0, in closed
    form.

    P_o runs on sqrt(R^2 - d^2) with yaw rate w. Each wheel bears half of the side force m v w; P_c, d ahead,
    is pulled back by m_c d w^2, and turning its velocity takes the moment m_c d v w, which the wheels'
    forward forces give.
    """
    p = {q.name: q.default for q in find_robot("labmate").parameters}
    w = v / math.sqrt(circle.RADIUS**2 - p["d"] ** 2)
    side = (p["m_c"] + 2 * p["m_w"]) * v * w / 2
    forward = p["m_c"] * p["d"] * (w**2 / 2 + v * w / (2 * p["b"]))
    return math.hypot(side, forward) / ((p["m_c"] + 2 * p["m_w"]) / 2 * GRAVITY)


FASTEST = math.sqrt(MU / needed_on_circle(1.0))  # m/s: what is needed goes with v^2


def _steady(v: float) -> Case:
    """On the circle at speed v, in the steady state from the start: s = d / R,
    yaw rate v / sqrt(R^2 - d^2)."""
    p = {q.name: q.default for q in find_robot("labmate").parameters}
    turn = p["b"] * v / math.sqrt(circle.RADIUS**2 - p["d"] ** 2)
    x, y = (float(c) for c in circle.CENTRE)
    q = [x + circle.RADIUS, y, math.pi / 2 - math.asin(p["d"] / circle.RADIUS), 0.0, 0.0]
    nu = [(v + turn) / p["r"], (v - turn) / p["r"]]
    return Case(
        "figure_8.toml", {"initial": {"q": q, "nu": nu}, "reference.speed": v, "simulation.duration": 1.0}
    )


STEADY = {f"{v:.2f} m/s": _steady(v) for v in sorted((*STEADY_SPEEDS, 0.99 * FASTEST, 1.01 * FASTEST))}


def needs(grip: Grip) -> np.ndarray:
    """The friction coefficient that the worse contact needs, (N,)."""
    return np.max([contact.needs for contact in grip.contacts], axis=0)


def draw_rolling(runs: Runs) -> matplotlib.figure.Figure:
    """Friction use over time, the forces against it; what the headings of figure 8 (a) need,
    and how fast it can go round."""
    figure, axes = panels(
        "friction use, worse wheel",
        "forces / (μ load)",
        "figure 8 (a): friction needed",
        "round the circle, steadily",
        height=4.8,
    )
    for (label, name), colour in zip(SHOWN.items(), (COLOURS[1], COLOURS[3], COLOURS[0]), strict=True):
        grip = runs[label].grip
        axes[0].plot(
            grip.t, needs(grip) / MU, color=colour, label=f"{name}: up to {needs(grip).max() / MU:.2f}"
        )
        for contact, style in zip(grip.contacts, ("-", "--"), strict=True):
            limit = contact.mu * contact.load
            axes[1].plot(contact.lateral / limit, contact.longitudinal / limit, style, color=colour)
            axes[1].plot(
                contact.lateral[0] / limit[0],
                contact.longitudinal[0] / limit[0],
                "o",
                color=colour,
                markersize=5,
            )
    axes[0].axhspan(1.0, 2.6, color=STOP, alpha=0.08)
    axes[0].axhline(1.0, color=STOP, linewidth=1.2)
    over_time(axes[0], "|F| / (μ load)")
    axes[0].set(xlim=(0, 4), ylim=(0, 2.6))
    legend_below(axes[0])
    friction_circle(axes[1], 2.9, (-3.2, 2.6))
    axes[1].text(1.0, 0.8, "rolls\ninside", color=COLOURS[2], ha="right")
    say(axes[1], "solid: right wheel\ndashed: left wheel\ndots: at the start", (0.03, 0.03))
    _draw_headings(axes[2], runs)
    v = np.linspace(0.0, 10.0, 101)
    axes[3].plot(v, [needed_on_circle(x) for x in v], color=FAINT, label="closed form")
    for label in STEADY:
        speed, needed = float(runs[label].speed[0]), float(needs(runs[label].grip).max())
        axes[3].plot(speed, needed, "o", color=STOP if needed > MU else COLOURS[0], markersize=6)
    axes[3].axhline(MU, color=STOP, linewidth=1.2)
    axes[3].text(0.2, MU + 0.015, f"μ = {MU:g}", color=STOP)
    axes[3].axvline(FASTEST, color=STOP, linestyle=":", linewidth=1.2)
    axes[3].text(FASTEST - 0.15, 0.05, f"{FASTEST:.2f} m/s", color=STOP, ha="right")
    axes[3].set(xlabel="speed (m/s)", ylabel="friction coefficient needed", xlim=(0, 10), ylim=(0, 1.2))
    axes[3].plot([], [], "o", color=COLOURS[0], label="runs that roll")
    axes[3].plot([], [], "o", color=STOP, label="runs that would slip")
    axes[3].legend(loc="upper left", fontsize=8)
    return figure


def friction_circle(axes: Axes, wide: float, high: tuple[float, float] | None = None) -> None:
    """The circle within which a force over (μ load) rolls, in a panel from `wide` on the left to -wide."""
    angle = np.linspace(0, 2 * np.pi, 361)
    axes.fill(np.cos(angle), np.sin(angle), color=COLOURS[2], alpha=0.12, linewidth=0)
    axes.plot(np.cos(angle), np.sin(angle), color=STOP, linewidth=1.2)
    axes.set(
        xlim=(wide, -wide),
        ylim=high or (-wide, wide),
        aspect="equal",
        xlabel="sideways, left positive",
        ylabel="forward",
    )


def _draw_headings(axes: Axes, runs: Runs) -> None:
    """What each heading of figure 8 (a) needs, as dots: the scale is logarithmic,
    where a bar would begin nowhere."""
    needed = [float(needs(runs[label].grip).max()) for label in CIRCLES]
    axes.scatter(
        needed, list(CIRCLES), color=[STOP if value > MU else COLOURS[0] for value in needed], zorder=3
    )
    for k, value in enumerate(needed):
        axes.annotate(f"{value:.1f}", (value, k), (8, 0), textcoords="offset points", va="center", fontsize=9)
    axes.axvline(MU, color=STOP, linewidth=1.2)
    axes.text(MU * 1.08, len(CIRCLES) - 0.45, f"μ = {MU:g}", color=STOP, va="bottom")
    axes.set(xscale="log", xlim=(0.5, 100), ylim=(-0.7, len(CIRCLES) + 0.1), xlabel="friction coefficient")
    axes.set_ylabel("initial heading")
    axes.set_xticks([1, 10, 100], ["1", "10", "100"])


def claims_rolling(runs: Runs) -> list[Claim]:
    """Where the assumption of no slip would break, a start for which it holds,
    and the fastest way round the circle."""
    grips = {label: run.grip for label, run in runs.items()}
    needed = {label: float(needs(grip).max()) for label, grip in grips.items()}
    until = {
        label: float(grip.t[np.flatnonzero(needs(grip) > MU)[-1]])
        for label, grip in grips.items()
        if needed[label] > MU
    }
    least = min(needed[label] for label in CIRCLES)
    unlike = max(abs(needed[label] - needed_on_circle(float(runs[label].speed[0]))) for label in STEADY)
    steady = {label: grips[label].rolls for label in STEADY}
    right = all(rolls == (runs[label].speed[0] < FASTEST) for label, rolls in steady.items())
    return [
        Claim(
            f"the paper's start of the line from rest would slip on friction {MU:g}, at each speed",
            "; ".join(
                f"{label}: needs {needed[label]:.2f}, until {until.get(label, 0):.2f} s" for label in LINES
            ),
            all(needed[label] > MU for label in LINES),
            note="gains, start and speeds A and B are assumed; the distance of 1.4 m and all the speed are "
            "asked for at once. The paper does not look at contact forces",
        ),
        Claim(
            "the starts of figure 8 (a) would slip as well, from every heading, the mildest needing "
            f"{least:.2f}",
            ", ".join(f"{label}: {needed[label]:.1f}" for label in CIRCLES),
            all(needed[label] > MU for label in CIRCLES),
            note="no rubber gives much more than 1: figures 8 show the law, not what such a vehicle would do "
            "at first",
        ),
        Claim(
            "from the same place on the line gentler gains (poles −0.25, −1; kv 0.5) roll all the way",
            f"needs {needed[GENTLE]:.2f} at most; distance "
            f"{abs(float(line.distance(runs[GENTLE].P_l)[-1])) * 1e3:.1f} mm at {runs[GENTLE].t[-1]:g} s",
            grips[GENTLE].rolls,
        ),
        Claim(
            "steadily round the circle a wheel needs what the closed form says, to 1e-6",
            f"difference {unlike:.1e}; at 5 m/s {needed['5.00 m/s']:.3f}",
            unlike <= 1e-6,
        ),
        Claim(
            f"the circle can be driven at up to {FASTEST:.2f} m/s before it slips",
            "; ".join(f"{label} {'rolls' if rolls else 'would slip'}" for label, rolls in steady.items()),
            right and len(set(steady.values())) == 2,
            note=f"v²/R = μ g alone would give {math.sqrt(MU * GRAVITY * circle.RADIUS):.2f} m/s; P_c ahead "
            "of the axle has to be turned too, with opposite forces of the two wheels",
        ),
    ]


FIGURES = (
    Figure(
        "rolling",
        "Beyond the paper: does it still roll?",
        "The whole method rests on rolling without slip. The constraint forces of the runs tell what the "
        "ground must give.",
        "friction coefficient 0.7 (the paper names none), the whole weight on the driven wheels, no load "
        "transfer; wheels of an axle share its side force by load at rest; gains, starts and the circle as "
        "in figures 1 and 8; wheel radius 0.15 m",
        {**LINES, **CIRCLES, GENTLE: Case("rolling.toml"), **STEADY},
        draw_rolling,
        claims_rolling,
    ),
)
