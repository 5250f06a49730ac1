"""Figures 10, 11 and 12: a path of arcs and a line, its curvature jumping where they join."""

import math

import matplotlib.figure
import numpy as np
from matplotlib.axes import Axes

from ....model.segments import Segment
from ....simulation.drawing import (
    COLOURS,
    FAINT,
    STOP,
    legend_below,
    over_time,
    panels,
    plane,
    start,
    to_follow,
    zoom,
)
from ..framework import Case, Claim, Figure, FigureRun, Runs
from ..vehicle import draw_vehicle

NAMES, JOINS = "ABC", ("A to B", "B to C")
SPEED, PERIOD = 1.414, 0.01  # m/s; s between controller calls
RADIUS = 5.0  # m, of A, as in the spec
PHASES = 5
CONTINUOUS = "continuous"
# s after a join within which its effect is looked for; s before and after it that are magnified
AFTER, NEAR = 3.0, 2.2
ASSUMED = (
    "radii 5 and 3 m, angles and lengths, which way C turns; start at rest on A; gains kp 1, kd 2.5 (poles "
    "−0.5, −2), kv 2; wheel radius 0.15 m (torques depend on it)"
)


def _case(phase: int) -> Case:
    """Controller called every 10 ms, the start moved along A by a part of what is driven in one period."""
    angle = phase / PHASES * SPEED * PERIOD / RADIUS
    place = [RADIUS * math.sin(angle), RADIUS * (1 - math.cos(angle))]
    return Case(
        "figure_11.toml",
        {"simulation.period": PERIOD, "initial": {"point": place, "heading": angle, "speed": 0.0}},
    )


SAMPLED = [f"10 ms, start {phase / PHASES * SPEED * PERIOD * 1e3:.1f} mm on" for phase in range(PHASES)]
CASES = {CONTINUOUS: Case("figure_11.toml"), **{label: _case(phase) for phase, label in enumerate(SAMPLED)}}


def _segments(runs: Runs) -> tuple[Segment, ...]:
    return runs[CONTINUOUS].spec.output.segments


def _joins(run: FigureRun) -> list[int]:
    """Last rows before the next piece."""
    return [int(k) for k in np.flatnonzero(np.diff(run.piece))]


def _time(run: FigureRun, k: int) -> float:
    """When P_l passes the join between rows k and k + 1, s."""
    before, after = (run.spec.output.segments[run.piece[row]] for row in (k, k + 1))
    left, beyond = (
        before.length - before.progress(*run.P_l[k], before.length),
        after.progress(*run.P_l[k + 1]),
    )
    return float(run.t[k] + (run.t[k + 1] - run.t[k]) * left / (left + beyond))


def torque_jump(run: FigureRun, k: int) -> float:
    """Jump of tau_r at the join between rows k and k + 1, N m:
    parabolas through three rows on either side, continued to it."""
    t = _time(run, k)
    before, after = (
        np.polyfit(run.t[rows] - t, run.tau[rows, 0], 2)[-1]
        for rows in (slice(k - 2, k + 1), slice(k + 1, k + 4))
    )
    return float(after - before)


def expected_jump(parameters, speed: float, step: float, s: float) -> float:
    """Jump of tau_r (N m) where the curvature jumps by `step` (1/m), the speed (m/s) and s = l / R being
    steady before.

    P_l, at speed / cos(alpha) with s = sin(alpha), needs the acceleration speed^2 / cos^2(alpha) step across
    the path, and gets it from l cos(alpha) times the angular acceleration, which the two torques give to the
    inertia about P_o with the wheels'.
    """
    p = parameters
    inertia = (
        p["I_c"]
        + p["m_c"] * p["d"] ** 2
        + 2 * (p["m_w"] * p["b"] ** 2 + p["I_m"] + p["I_w"] * (p["b"] / p["r"]) ** 2)
    )
    return p["r"] / (2 * p["b"]) * inertia * speed**2 * step / (p["d"] * (1 - s**2) ** 1.5)  # l = d, as L = 0


def _after(run: FigureRun, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Seconds since a join, and what the distance from the path (m) has changed since,
    up to the next join."""
    rows = (run.t > run.t[k]) & (run.t <= run.t[k] + AFTER)
    return run.t[rows] - _time(run, k), run.y[rows, 0] - run.y[k, 0]


def deviations(runs: Runs) -> np.ndarray:
    """Largest change of the distance (m) after each join (columns) of each sampled run, with its sign."""
    found = [[_after(runs[label], k)[1] for k in _joins(runs[label])] for label in SAMPLED]
    return np.array([[change[np.abs(change).argmax()] for change in changes] for changes in found])


def _draw_path(axes: Axes, segments: tuple[Segment, ...], label: str = "path to follow") -> None:
    x, y = np.transpose([place for segment in segments for place in segment.places(200)])
    to_follow(axes, x, y, label)


def _mark_joins(axes: Axes, segments: tuple[Segment, ...]) -> None:
    """A dash across the path at each join."""
    for segment in segments[1:]:
        across = 0.35 * np.array([-math.sin(segment.heading), math.cos(segment.heading)])
        axes.plot(
            *(np.array([segment.x, segment.y]) + np.array([[-1], [1]]) * across).T, color=STOP, linewidth=2
        )


def draw_10(runs: Runs) -> matplotlib.figure.Figure:
    """The path with its segments, and its curvature along it."""
    figure, axes = panels("desired path: arc A, line B, arc C", "its curvature", widths=(1.3, 1), height=4.4)
    way, joins = 0.0, []
    for name, segment, colour in zip(NAMES, _segments(runs), COLOURS, strict=False):
        places = np.array(segment.places(200))
        axes[0].plot(*places.T, color=colour, linewidth=3)
        text = (
            f"{name}: arc, R = {1 / abs(segment.curvature):g} m"
            if segment.curvature
            else f"{name}: line, {segment.length:g} m"
        )
        offset = {"A": (-95, 14), "B": (10, -4), "C": (12, 6)}[name]
        axes[0].annotate(text, places[100], offset, textcoords="offset points", color=colour, fontsize=11)
        axes[1].plot([way, way + segment.length], [segment.curvature] * 2, color=colour, linewidth=3)
        axes[1].text(
            way + segment.length / 2, segment.curvature + 0.03, name, color=colour, fontsize=13, ha="center"
        )
        way += segment.length
        joins.append(way)
    _mark_joins(axes[0], _segments(runs))
    start(axes[0], np.zeros(2))
    plane(axes[0], np.array([[-0.5, -0.5], [9.5, 13.5]]))
    axes[0].legend(loc="upper left")
    steps = _steps(runs)
    axes[1].set(
        xlabel="length along the path (m)", ylabel="curvature (1/m), left positive", ylim=(-0.45, 0.35)
    )
    for segment, step, at in zip(_segments(runs), steps, joins, strict=False):
        axes[1].annotate(
            "",
            (at, segment.curvature + step),
            (at, segment.curvature),
            arrowprops={"arrowstyle": "-|>", "color": STOP},
        )
        axes[1].text(
            at + 0.3,
            segment.curvature + step / 2,
            f"step {abs(step):.3f} 1/m",
            color=STOP,
            fontsize=10,
            va="center",
        )
    return figure


def _steps(runs: Runs) -> list[float]:
    """Steps of the curvature at the joins, 1/m."""
    a, b, c = (segment.curvature for segment in _segments(runs))
    return [b - a, c - b]


def claims_10(runs: Runs) -> list[Claim]:
    """What the path is; the paper's sentence about its second join."""
    a, b, c = _segments(runs)
    steps = _steps(runs)
    turns = [
        abs(math.remainder(after.heading - before.end[2], 2 * math.pi)) for before, after in ((a, b), (b, c))
    ]
    gaps = [math.dist(before.end[:2], (after.x, after.y)) for before, after in ((a, b), (b, c))]
    return [
        Claim(
            "the path is continuous, and so is its direction; only the curvature jumps",
            f"gaps up to {max(gaps):.0e} m, kinks up to {max(turns):.0e} rad; steps {steps[0]:+.3f} and "
            f"{steps[1]:+.3f} 1/m",
            max(*gaps, *turns) < 1e-9 and all(steps),
            paper=True,
        ),
        Claim(
            "the second transition involves a smaller change of curvature, since arc C has the "
            "smaller radius",
            f"{abs(steps[1]):.3f} 1/m at the second join, {abs(steps[0]):.3f} 1/m at the first",
            abs(steps[1]) < abs(steps[0]),
            note="from a line to an arc the curvature steps by 1/R: the smaller the radius, the larger the "
            "step",
            paper=True,
            expected=False,
        ),
    ]


def draw_11(runs: Runs) -> matplotlib.figure.Figure:
    """The path driven, the distance from it, the torques."""
    figure, axes = panels(
        "path of $P_l$ at 1.414 m/s", "distance from the path", "torques, controller continuous", height=5.0
    )
    run = runs[CONTINUOUS]
    _draw_path(axes[0], _segments(runs))
    axes[0].plot(*run.P_l.T, color=COLOURS[0], label="path of $P_l$")
    axes[0].plot(*run.P_o.T, "--", color=COLOURS[1], linewidth=1.2, label="path of $P_o$")
    for t in (0.0, 3.2, 6.04, 8.3, 11.5, 14.5):
        draw_vehicle(axes[0], run, int(np.searchsorted(run.t, t - 1e-9)), FAINT)
    _mark_joins(axes[0], _segments(runs))
    plane(axes[0], np.array([[-1.0, -1.0], [10.5, 14.0]]))
    axes[0].legend(loc="upper left")
    inset = zoom(axes[0], (0.66, 0.06, 0.33, 0.4), run.P_l[np.searchsorted(run.t, 11.0)], 0.1)
    _draw_path(inset, _segments(runs))
    for points, style, colour in ((run.P_l, "-", COLOURS[0]), (run.P_o, "--", COLOURS[1])):
        inset.plot(*points.T, style, color=colour)
    for label in SAMPLED:
        axes[1].plot(
            runs[label].t,
            runs[label].y[:, 0] * 1e3,
            color=COLOURS[1],
            linewidth=1.0,
            label=f"every 10 ms: {PHASES} runs, which pass the joins\nat different moments of the 10 ms"
            if label == SAMPLED[0]
            else None,
        )
    worst = np.abs(run.y[:, 0]).max()
    axes[1].plot(
        run.t, run.y[:, 0] * 1e3, color=COLOURS[0], label=f"continuous: at most {worst * 1e3:.0e} mm"
    )
    over_time(axes[1], "distance (mm), left positive")
    axes[1].set_ylim(-1.2, 1.8)
    legend_below(axes[1])
    for k, (wheel, colour) in enumerate((("right", COLOURS[0]), ("left", COLOURS[3]))):
        axes[2].plot(run.t, run.tau[:, k], color=colour, label=wheel)
    over_time(axes[2], "torque (N m)")
    axes[2].set_ylim(-6, 8)
    axes[2].legend(loc="upper right")
    for k, join in zip(_joins(run), JOINS, strict=True):
        t, jump = _time(run, k), torque_jump(run, k)
        for panel, what in zip(axes[1:], ("", f"\n ∓{abs(jump):.2f} N m"), strict=True):
            panel.axvline(t, color=STOP, linestyle=":", linewidth=1.2)
            panel.text(t, panel.get_ylim()[0], f" {join}{what}", color=STOP, fontsize=9, va="bottom")
    return figure


def claims_11(runs: Runs) -> list[Claim]:
    """The path is kept through the joins; the torques jump as much as the curvature asks for."""
    continuous = np.abs(runs[CONTINUOUS].y[:, 0]).max()
    sampled = max(np.abs(runs[label].y[:, 0]).max() for label in SAMPLED)
    run = runs[CONTINUOUS]
    jumps = [torque_jump(run, k) for k in _joins(run)]
    lookahead = run.ahead  # L = 0
    before = [lookahead * segment.curvature for segment in _segments(runs)[:2]]
    expected = [expected_jump(run.parameters, SPEED, *at) for at in zip(_steps(runs), before, strict=True)]
    off = max(abs(jump / closed - 1) for jump, closed in zip(jumps, expected, strict=True))
    return [
        Claim(
            "discontinuities of the curvature are passed without difficulty: at 10 ms within 5 mm of "
            "the path",
            f"at most {sampled * 1e3:.2f} mm (worst of {PHASES})",
            sampled <= 5e-3,
            paper=True,
        ),
        Claim(
            "with a continuous controller within 1e-6 m of the path",
            f"{continuous:.1e} m",
            continuous <= 1e-6,
        ),
        Claim(
            "the torque jumps at each join by v²Δκ/(l cos³α) times the inertia it turns (closed "
            "form, to 1 %)",
            "; ".join(
                f"{join}: {j:+.3f} N m, closed form {w:+.3f}"
                for join, j, w in zip(JOINS, jumps, expected, strict=True)
            ),
            off < 0.01,
            note="right wheel; the left one's is the opposite. Where torques are limited that much has to be "
            "in reserve",
        ),
    ]


def draw_12(runs: Runs) -> matplotlib.figure.Figure:
    """The distance from the path along the way past either join,
    and over time what either join adds to it."""
    figure, axes = panels(
        "first join, A to B", "second join, B to C", "what a join adds to the distance", height=4.8
    )
    for panel, colour, number in zip(axes, COLOURS, (0, 1), strict=False):
        for label in SAMPLED:
            way, distance = _past(runs[label], _joins(runs[label])[number])
            said = f"{PHASES} runs, every 10 ms" if label == SAMPLED[0] else None
            panel.plot(way, distance * 1e3, color=colour, linewidth=1.0, label=said)
            t, change = _after(runs[label], _joins(runs[label])[number])
            axes[2].plot(
                t,
                change * 1e3,
                color=colour,
                linewidth=1.2,
                label=_name(number) if label == SAMPLED[0] else None,
            )
        way, distance = _past(runs[CONTINUOUS], _joins(runs[CONTINUOUS])[number])
        panel.plot(way, distance * 1e3, color="black", linewidth=1.2, label="continuous")
        panel.axvline(0.0, color=STOP, linestyle=":", linewidth=1.2, label="join")
        panel.set(
            xlabel="length along the path from the join (m)",
            ylabel="distance (mm), left positive",
            ylim=(-0.7, 1.6),
        )
        legend_below(panel)
    axes[2].axhline(0.0, color="black", linewidth=0.8)
    axes[2].set(xlabel="time since the join (s)", ylabel="change of the distance (mm)", xlim=(0, AFTER))
    legend_below(axes[2])
    return figure


def _name(number: int) -> str:
    return f"{('first', 'second')[number]} join, {JOINS[number]}"


def _past(run: FigureRun, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Way along the path from the join after row k, and distance from the path, m, near that join."""
    rows = np.flatnonzero(np.abs(run.t - run.t[k]) < NEAR)
    before, after = (run.spec.output.segments[run.piece[row]] for row in (k, k + 1))
    way = [
        before.progress(*run.P_l[row], before.length) - before.length
        if row <= k
        else after.progress(*run.P_l[row])
        for row in rows
    ]
    return np.array(way), run.y[rows, 0]


def claims_12(runs: Runs) -> list[Claim]:
    """Which join is the milder one, by torque and by what is left of it at 10 ms."""
    run = runs[CONTINUOUS]
    jumps = [abs(torque_jump(run, k)) for k in _joins(run)]
    found = deviations(runs) * 1e3
    mean, spread = np.abs(found).mean(axis=0), np.ptp(found, axis=0)
    ranges = [
        f"{low:+.2f} to {high:+.2f} mm"
        for low, high in zip(found.min(axis=0), found.max(axis=0), strict=True)
    ]
    milder = int((np.abs(found[:, 1]) < np.abs(found[:, 0])).sum())
    return [
        Claim(
            "the performance at the first transition is acceptable: it adds millimetres at most (10 ms)",
            ranges[0],
            bool(np.abs(found[:, 0]).max() < 5.0),
            paper=True,
        ),
        Claim(
            "at the second transition there is almost no deviation compared with the first, since it is the "
            "milder one",
            f"torque jumps {jumps[0]:.2f} and {jumps[1]:.2f} N m; at 10 ms deviations of {mean[0]:.2f} and "
            f"{mean[1]:.2f} mm on average over {PHASES} runs, {ranges[0]} and {ranges[1]}",
            bool(jumps[1] < jumps[0] and mean[1] < mean[0]),
            note="a join falls somewhere between two calls of the controller, and by where the deviation "
            f"changes, its sign too: in {milder} of these {PHASES} runs the second is the smaller one. "
            f"What they spread over goes with the step of the curvature: {spread[1] / spread[0]:.2f} "
            f"times as much at the second, the step being {_ratio(runs):.2f} times as large. With a "
            "continuous controller there is none at either",
            paper=True,
            expected=False,
        ),
        Claim(
            "what the deviations at 10 ms spread over is proportional to the step of the curvature, to 15 %",
            f"ratio {spread[1] / spread[0]:.3f}, steps {_ratio(runs):.3f}",
            abs(spread[1] / spread[0] / _ratio(runs) - 1) < 0.15,
        ),
    ]


def _ratio(runs: Runs) -> float:
    first, second = _steps(runs)
    return abs(second / first)


FIGURES = (
    Figure(
        "10",
        "Figure 10: desired composite path",
        "Shortest paths of wheeled carts are circular arcs and straight lines: continuous, but with jumps of "
        "the curvature. The paper's example has arcs A and C and a line B.",
        ASSUMED,
        {CONTINUOUS: CASES[CONTINUOUS]},
        draw_10,
        claims_10,
    ),
    Figure(
        "11",
        "Figure 11: the composite path followed",
        "The same path driven. The law of a line or arc is initialized at each join; a tracker in C "
        "determines when.",
        ASSUMED,
        CASES,
        draw_11,
        claims_11,
    ),
    Figure(
        "12",
        "Figure 12: the transitions magnified",
        "The paper magnifies the first transition and calls the second milder, C having the smaller radius.",
        ASSUMED,
        CASES,
        draw_12,
        claims_12,
    ),
)
