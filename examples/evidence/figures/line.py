"""Figures 1, 6 and 7: a point of the robot tracks a moving point on the line y = x (Type I) or follows the
line (Type IV)."""

import math

import matplotlib.figure
import numpy as np
from matplotlib.axes import Axes

from ....simulation.drawing import COLOURS, STOP, over_time, panels, plane, say, start, to_follow, zoom
from ..framework import Case, Claim, Figure, FigureRun, Runs
from ..measures import cusps, overshoot, sign_changes, time_to_stay_within

SPEEDS = {"A": 0.5, "B": 1.0, "C": 1.414}  # m/s
BOTH = {"I": "(a) trajectory tracking (Type I)", "IV": "(b) path following (Type IV)"}
GAINS, WHEEL = "gains kp 1, kd 2.5 (poles −0.5, −2), kv 2", "wheel radius 0.15 m (no effect here)"
START = f"start P_l (0, 2) m, heading 90°; {GAINS}"


def _case(kind: str, speed: float) -> Case:
    if kind == "IV":
        return Case("figure_1_type_iv.toml", {"reference.speed": speed})
    return Case("figure_1_type_i.toml", {"reference.velocity": [speed / math.sqrt(2)] * 2})


LINE = {f"{kind} {name}": _case(kind, speed) for kind in BOTH for name, speed in SPEEDS.items()}


def distance(points: np.ndarray) -> np.ndarray:
    """Signed distance from y = x, m, positive below it."""
    return (points[:, 0] - points[:, 1]) / math.sqrt(2)


def along(vectors: np.ndarray) -> np.ndarray:
    """Components along y = x."""
    return vectors.sum(axis=1) / math.sqrt(2)


def _loci(axes: Axes, runs: Runs, kind: str, locus: str) -> None:
    """The loci of one point of the robot for the three speeds beside the line."""
    to_follow(axes, np.array([-3.0, 9.0]), np.array([-3.0, 9.0]), "line y = x")
    for (name, speed), colour in zip(SPEEDS.items(), COLOURS, strict=False):
        axes.plot(*getattr(runs[f"{kind} {name}"], locus).T, color=colour, label=f"{name}: {speed:g} m/s")


def draw_1(runs: Runs) -> matplotlib.figure.Figure:
    """Loci of P_o, Type I beside Type IV, the first centimetres magnified."""
    figure, axes = panels(*(f"{title}: locus of $P_o$" for title in BOTH.values()), height=5.2)
    for panel, kind in zip(axes, BOTH, strict=True):
        first = runs[f"{kind} C"].P_o[0]
        _loci(panel, runs, kind, "P_o")
        start(panel, first, "start of $P_o$")
        plane(panel, np.array([[-0.8, 0.2], [4.2, 4.2]]))
        panel.legend(loc="lower right")
        inset = zoom(panel, (0.03, 0.6, 0.34, 0.38), first - (0, 0.03), 0.15)
        _loci(inset, runs, kind, "P_o")
        start(inset, first)
        for name, colour in zip(SPEEDS, COLOURS, strict=False):
            run = runs[f"{kind} {name}"]
            for k in cusps(run):
                inset.plot(*run.P_o[k], "o", color=STOP, markersize=4, zorder=6)
                inset.annotate(
                    f"cusp of {name}",
                    run.P_o[k],
                    (8, -9),
                    textcoords="offset points",
                    color=colour,
                    fontsize=9,
                )
    return figure


def claims_1(runs: Runs) -> list[Claim]:
    """Cusps of P_o in Type I, none in Type IV."""
    turns = {label: len(cusps(run)) for label, run in runs.items()}
    slowest = {label: run.speed.min() for label, run in runs.items()}
    jumps = {label: _sharpest_turn(run) for label, run in runs.items()}
    smooth = all(turns[f"IV {name}"] == 0 and slowest[f"IV {name}"] >= 0 for name in SPEEDS)
    error = max(
        np.abs(runs[f"IV {name}"].speed - speed * -np.expm1(-2.0 * runs[f"IV {name}"].t)).max()
        for name, speed in SPEEDS.items()
    )
    return [
        Claim(
            "trajectory tracking often puts a discontinuity of slope (a cusp) into the path of P_o: at A and "
            "B",
            "cusps "
            + "; ".join(
                f"{name}: {turns[f'I {name}']}, speed down to {slowest[f'I {name}']:+.3f} m/s"
                for name in SPEEDS
            ),
            all(turns[f"I {name}"] >= 1 and slowest[f"I {name}"] < -1e-3 for name in "AB"),
            note=f"the direction of motion turns by {jumps['I A']:.1f}° (A) and {jumps['I B']:.1f}° (B) from "
            "one moment to the next; from this start the fastest, C, just has none",
            paper=True,
        ),
        Claim(
            "path following gives a smooth path of P_o: it never reverses",
            "; ".join(f"{name}: {turns[f'IV {name}']} cusps" for name in SPEEDS),
            smooth,
            paper=True,
        ),
        Claim(
            "under path following the forward speed is v_d (1 − exp(−kv t)) at every speed, to 1e-9 m/s",
            f"{error:.1e} m/s",
            error <= 1e-9,
        ),
    ]


def _sharpest_turn(run: FigureRun) -> float:
    """Largest angle, degrees, between the directions of motion of P_o at neighbouring rows; 180 is a cusp."""
    moving = run.speed != 0
    directions = (np.sign(run.speed)[:, None] * run.forward)[moving]
    cosines = (directions[1:] * directions[:-1]).sum(axis=1)
    return float(np.degrees(np.arccos(np.clip(cosines, -1, 1))).max(initial=0.0))


def draw_6(runs: Runs) -> matplotlib.figure.Figure:
    """Loci of P_l, and its distance from the line over time."""
    figure, axes = panels(
        *(f"{title}: locus of $P_l$" for title in BOTH.values()),
        "(c) distance of $P_l$ from the line: six runs",
        height=4.4,
    )
    for panel, kind in zip(axes, BOTH, strict=False):
        _loci(panel, runs, kind, "P_l")
        start(panel, runs[f"{kind} C"].P_l[0], "start of $P_l$")
        plane(panel, np.array([[-0.4, 0.3], [4.0, 4.2]]))
        panel.legend(loc="lower right")
    for k, (label, run) in enumerate(runs.items()):  # all on one curve: a mark of each run in turn
        marks = {
            "marker": "os^"[k % 3],
            "markevery": (20 * k, 120),
            "markersize": 5,
            "fillstyle": "none" if k < 3 else "full",
        }
        axes[2].plot(run.t, distance(run.P_l), color=COLOURS[k % 3], linewidth=1.0, label=label, **marks)
    over_time(axes[2], "distance (m)")
    axes[2].set_xlim(0, 12)
    axes[2].axhline(0.0, color="black", linewidth=0.8)
    axes[2].legend(loc="lower right", ncols=2)
    say(axes[2], "all six coincide: the same approach at\nevery speed and in both types", (0.3, 0.55))
    return figure


def claims_6(runs: Runs) -> list[Claim]:
    """Both reach the line and stay; Type IV without overshoot, alike at every speed;
    Type I is pushed the wrong way."""
    off = {label: distance(run.P_l) for label, run in runs.items()}
    end = max(abs(d[-1]) for d in off.values())
    settled = max(time_to_stay_within(runs[label].t, d, 0.01) for label, d in off.items())
    over = max(overshoot(off[f"IV {name}"]) for name in SPEEDS)
    rise = max(np.diff(np.abs(off[f"IV {name}"])).max() for name in SPEEDS)
    alike = max(np.abs(off[f"IV {name}"] - off["IV C"]).max() for name in SPEEDS)
    kinds = max(np.abs(off[f"I {name}"] - off[f"IV {name}"]).max() for name in SPEEDS)
    way = {label: _way_along(run) for label, run in runs.items()}
    exact = max(run.exact for run in runs.values())
    return [
        Claim(
            "in both cases the reference point reaches the path and stays on it",
            f"within 1 cm from {settled:.2f} s on, {end * 1e3:.2f} mm off at 20 s (worst of six)",
            end < 1e-3 and settled < 15,
            paper=True,
        ),
        Claim(
            "path following merges gradually, without overshoot",
            f"overshoot {over:.1e} m; |distance| never grows (largest step {rise:+.1e} m)",
            over <= exact and rise <= exact + 1e-9,
            paper=True,
        ),
        Claim(
            "path following approaches in the same way at every speed, to 1e-9 m",
            f"{alike:.1e} m",
            alike <= 1e-9,
        ),
        Claim(
            "trajectory tracking reacts more quickly",
            "metres made along the line until within 10 cm of it: "
            + "; ".join(f"{name} {way[f'I {name}']:.2f} against {way[f'IV {name}']:.2f}" for name in SPEEDS),
            all(way[f"I {name}"] < way[f"IV {name}"] for name in SPEEDS),
            note="in the plane; over time the distance from the line is the same function in both, "
            f"to {kinds:.0e} m (equal gains)",
            paper=True,
        ),
    ]


def _way_along(run: FigureRun) -> float:
    """Metres made along the line by P_l until it stays within 10 cm of it; infinite when it does not."""
    there = time_to_stay_within(run.t, distance(run.P_l), 0.1)
    if math.isinf(there):
        return math.inf
    return float(along(run.P_l)[np.searchsorted(run.t, there)] - along(run.P_l)[0])


def draw_7(runs: Runs) -> matplotlib.figure.Figure:
    """Forward speed of P_o over time, Type I beside Type IV."""
    figure, axes = panels(*BOTH.values(), height=3.9)
    for panel, kind in zip(axes, BOTH, strict=True):
        run = runs[kind]
        panel.axhline(SPEEDS["C"], color=STOP, linestyle=":", linewidth=1.2)
        panel.text(9.9, SPEEDS["C"] + 0.06, "desired 1.414 m/s", color=STOP, ha="right", fontsize=9)
        panel.axhline(0.0, color="black", linewidth=0.8)
        panel.plot(run.t, run.speed, color=COLOURS[0])
        over_time(panel, "forward speed of $P_o$ (m/s)")
        panel.set_ylim(-0.7, 3.0)
    run = runs["I"]
    marked = [*((k, f"stop {n + 1}: {run.t[k]:.2f} s") for n, k in enumerate(cusps(run)))]
    marked += [(int(k), f"{run.speed[k]:+.2f} m/s") for k in (run.speed.argmax(), run.speed.argmin())]
    for (k, text), offset in zip(marked, ((-58, -20), (10, 5), (10, -4), (10, -10)), strict=False):
        axes[0].plot(run.t[k], run.speed[k], "o", color=STOP, markersize=5, zorder=5)
        axes[0].annotate(text, (run.t[k], run.speed[k]), offset, textcoords="offset points", color=STOP)
    t = runs["IV"].t[::40]
    axes[1].plot(
        t,
        SPEEDS["C"] * -np.expm1(-2.0 * t),
        "o",
        color=COLOURS[1],
        markersize=4,
        label="$v_d\\,(1 - e^{-k_v t})$",
    )
    axes[1].legend(loc="lower right")
    return figure


def claims_7(runs: Runs) -> list[Claim]:
    """Two stops in Type I, an exponential in Type IV."""
    tracking, following = runs["I"], runs["IV"]
    last = cusps(tracking)[-1] if cusps(tracking) else 0
    rising = np.diff(tracking.speed[last:]).min()
    error = np.abs(following.speed - SPEEDS["C"] * -np.expm1(-2.0 * following.t)).max()
    back = along(tracking.P_l - tracking.P_l[0]).min()
    return [
        Claim(
            "trajectory tracking accelerates and comes to a stop twice",
            f"{sign_changes(tracking.speed)} changes of sign, speed down to {tracking.speed.min():+.3f} m/s",
            sign_changes(tracking.speed) == 2 and tracking.speed.min() < -0.1,
            paper=True,
        ),
        Claim(
            "then its speed rises monotonically to the desired one",
            f"after {tracking.t[last]:.2f} s least step {rising:+.1e} m/s, {tracking.speed[-1]:.4f} m/s at "
            f"{tracking.t[-1]:g} s",
            rising > -1e-9 - tracking.exact and abs(tracking.speed[-1] - SPEEDS["C"]) < 0.01,
            paper=True,
        ),
        Claim(
            "path following: a smooth exponential rise as of a first-order system, v_d (1 − exp(−kv t)), to "
            "1e-9 m/s",
            f"{error:.1e} m/s",
            error <= 1e-9 + following.exact,
            paper=True,
        ),
        Claim(
            "depending on the gains, trajectory tracking even forces the reference point in the wrong "
            "direction",
            f"P_l goes {-back:.2f} m back along the line before it goes on",
            back < -0.1,
            note="path following does not say which way: from a heading of −90° it follows the line towards "
            f"−x, at {along(following.velocity)[-1]:+.3f} m/s along it",
            paper=True,
        ),
    ]


FIGURES = (
    Figure(
        "1",
        "Figure 1: locus of the axle's middle at three desired speeds",
        "Introduces the difference: tracking a moving point makes the vehicle turn back on itself, following "
        "the path does not.",
        f"{START}; speeds A and B; {WHEEL}",
        LINE,
        draw_1,
        claims_1,
    ),
    Figure(
        "6",
        "Figure 6: trajectory and path of the reference point",
        "The reference point (the centre of mass, L = 0) starts at rest beside the line; both algorithms "
        "have equal gains.",
        f"{START}; speeds A and B; {WHEEL}",
        LINE,
        draw_6,
        claims_6,
    ),
    Figure(
        "7",
        "Figure 7: forward speed of the middle of the axle, case C",
        "Tracking stops the vehicle twice before it reaches its speed; path following is a first-order "
        "response.",
        "start P_l (5, 4) m, heading −90°, at rest, where the paper's two stops occur; gains kp 4, kd 5 "
        "(poles −1, −4), kv 2; " + WHEEL,
        {"I": Case("figure_7_type_i.toml"), "IV": Case("figure_7_type_iv.toml")},
        draw_7,
        claims_7,
    ),
)
