"""Beyond the paper: from pose to pose with cusps, and through waypoints,
on planned paths of lines and arcs."""

import itertools
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
    say,
    start,
    to_follow,
)
from ....simulation.planning.curves import sampled, through
from ..framework import Case, Claim, Figure, FigureRun, Runs
from ..vehicle import draw_vehicle
from .rolling import friction_circle

FORWARD, BACKWARD = COLOURS[0], COLOURS[1]
DRIVEN = "driven"

# -- pose to pose --------------------------------------------------------------------------------------------

GOAL = np.array([0.0, 4.0, 0.0])  # x, y (m), heading (rad), as in the spec
CREEP, KV = 0.002, 2.0  # m/s, 1/s: as in the spec


def _segments(run: FigureRun) -> tuple[Segment, ...]:
    return run.spec.output.segments


def backward(run: FigureRun) -> np.ndarray:
    """Is the piece followed driven in reverse? (N,)"""
    return np.array([segment.backward for segment in _segments(run)])[run.piece]


def hand_overs(run: FigureRun) -> list[int]:
    """First rows after a cusp."""
    return [int(k) + 1 for k in np.flatnonzero(np.diff(backward(run).astype(int)))]


def normal_sine(run: FigureRun) -> np.ndarray:
    """s at the foot of P_l on the piece followed, (N,); a straight extension counts as what it extends."""
    sines = []
    for place, heading, piece in zip(run.P_l, run.heading, run.piece, strict=True):
        segment = _segments(run)[piece]
        along = min(segment.progress(*place, segment.length / 2), segment.length)
        sines.append(math.sin(heading - segment.pose(along)[2]))
    return np.array(sines)


def _draw_segments(axes: Axes, segments: tuple[Segment, ...], label: str) -> None:
    for k, segment in enumerate(segments):
        x, y = np.transpose(segment.places(100))
        to_follow(axes, x, y, label if k == 0 else None)


def _mark_sides(axes: Axes, run: FigureRun) -> None:
    """The hand-overs, and between them where P_l is; shaded when it is behind the axle."""
    for k in hand_overs(run):
        axes.axvline(run.t[k], color=STOP, linestyle=":", linewidth=1.2)
    for begin, end in itertools.pairwise([0, *hand_overs(run), len(run.t) - 1]):
        ahead = run.place[begin, 0] + run.ahead
        if ahead < 0:
            axes.axvspan(run.t[begin], run.t[end], color=BACKWARD, alpha=0.1, linewidth=0)
        text = f"$P_l$\n{'ahead' if ahead > 0 else 'behind'}"
        middle = (run.t[begin] + run.t[end]) / 2
        axes.text(
            middle,
            0.98,
            text,
            ha="center",
            va="top",
            fontsize=8,
            color=FAINT,
            transform=axes.get_xaxis_transform(),
        )


def draw_cusp(runs: Runs) -> matplotlib.figure.Figure:
    """The path with its cusps and the robot there; speed, L and distance over time."""
    run = runs[DRIVEN]
    titles = (
        "path of the axle's middle",
        "forward speed",
        "distance of $P_l$ from the path",
        "s, sine of the angle to it",
    )
    figure, axes = panels(*titles, height=5.4, widths=(1.25, 1, 1, 1))
    _draw_segments(axes[0], _segments(run), "planned: shortest, radius ≥ 2.5 m")
    for reverse, colour, label in ((False, FORWARD, "driven forward"), (True, BACKWARD, "driven in reverse")):
        places = np.where((backward(run) == reverse)[:, None], run.P_o, np.nan)
        axes[0].plot(*places.T, color=colour, label=label)
    cusps = hand_overs(run)
    for k, colour in ((0, FAINT), *((k, STOP) for k in cusps), (-1, "black")):
        draw_vehicle(axes[0], run, k, colour, 0.06)
    axes[0].plot(
        *run.P_o[cusps].T,
        "X",
        color=STOP,
        markersize=9,
        label="cusp: direction and $P_l$ change sides",
        zorder=5,
    )
    start(axes[0], run.P_o[0])
    axes[0].annotate("goal", GOAL[:2], (14, 40), textcoords="offset points")
    axes[0].plot(*GOAL[:2], "+", color="black", markersize=12, markeredgewidth=2, zorder=6)
    axes[0].update_datalim([[-2.3, -1.7], [3.0, 5.4]])  # room for the robots
    plane(axes[0], axes[0].dataLim.get_points())
    legend_below(axes[0])
    axes[1].plot(run.t, run.y_d[:, 1], color=FAINT, linewidth=3, alpha=0.5, label="desired")
    axes[1].plot(run.t, run.speed, color=FORWARD, label="driven")
    axes[2].plot(run.t, run.y[:, 0] * 1e3, color=FORWARD)
    axes[3].plot(run.t, normal_sine(run), color=FORWARD)
    shown = (
        ("speed (m/s)", (-0.6, 0.8)),
        ("distance (mm), left of travel positive", (-6, 8)),
        ("s", (-0.08, 0.11)),
    )
    for panel, (quantity, limits) in zip(axes[1:], shown, strict=True):
        over_time(panel, quantity)
        panel.set_ylim(limits)
        panel.axhline(0.0, color="black", linewidth=0.8)
        _mark_sides(panel, run)
    for k in cusps:
        text = f"{run.speed[k] * 1e3:+.1f} mm/s".replace("-", "−")
        axes[1].annotate(
            text,
            (run.t[k], 0.0),
            (4, 6 if backward(run)[k] else -12),
            textcoords="offset points",
            color=STOP,
            fontsize=8,
        )
    legend_below(axes[1])
    return figure


def claims_cusp(runs: Runs) -> list[Claim]:
    """What the hand-over is, and where the robot ends."""
    run = runs[DRIVEN]
    cusps, levers = hand_overs(run), run.place[:, 0] + run.ahead
    planned = [
        k for k, (a, b) in enumerate(itertools.pairwise(_segments(run)), 1) if a.backward != b.backward
    ]
    speeds = [abs(float(run.speed[k])) for k in cusps]
    fitting = bool(np.all(np.sign(levers) == np.where(backward(run), -1, 1)))
    distance = [(float(run.y[k - 1, 0]), float(run.y[k, 0])) for k in cusps]
    beside = levers[0] ** 2 / 2 * max(abs(segment.curvature) for segment in _segments(run))
    off = float(np.hypot(*(run.P_o[-1] - GOAL[:2])))
    along = float((run.P_o[-1] - GOAL[:2]) @ np.array([math.cos(GOAL[2]), math.sin(GOAL[2])]))
    turned = math.remainder(float(run.heading[-1] - GOAL[2]), 2 * math.pi)
    closest = [
        float(np.hypot(*(run.P_o[k] - (_segments(run)[at].x, _segments(run)[at].y))))
        for k, at in zip(cusps, planned, strict=False)
    ]
    largest = float(np.abs(normal_sine(run)).max())
    order = bool(np.all(np.diff(run.piece) >= 0) and set(run.piece) == set(range(len(_segments(run)))))
    return [
        Claim(
            "the planned path has two cusps, and each is a hand-over; every piece is followed once, in its "
            "order",
            f"{len(planned)} cusps, {len(cusps)} hand-overs, {len(_segments(run))} pieces",
            len(cusps) == len(planned) == 2 and order,
        ),
        Claim(
            f"hand-over: it happens when the robot stands (speed within creep, {CREEP * 1e3:g} mm/s)",
            ", ".join(
                f"{speed * 1e3:.1f} mm/s at {run.t[k]:.2f} s" for speed, k in zip(speeds, cusps, strict=True)
            ),
            max(speeds, default=math.inf) <= CREEP * (1 + 1e-9),
        ),
        Claim(
            "direction and side of P_l change in one step: at no row do they disagree",
            ", ".join(
                f"L {run.place[k - 1, 0]:g} to {run.place[k, 0]:g} m at {run.t[k]:.2f} s" for k in cusps
            ),
            fitting,
        ),
        Claim(
            "the distance jumps, being that of the new P_l then, but stays below 1 cm throughout",
            ", ".join(f"{a * 1e3:+.2f} to {b * 1e3:+.2f} mm" for a, b in distance),
            float(np.abs(run.y[:, 0]).max()) <= 0.01,
            note="on an arc a P_l as far on the other side of an axle that stands on the path is l²/(2R) = "
            f"{beside * 1e3:.0f} mm beside it; the rest is due to the angle to the path. It decays with "
            "the loop's poles",
        ),
        Claim(
            "the heading stays far from normal to the path",
            f"|s| at most {largest:.3f}, l/R = "
            f"{abs(levers[0]) * max(abs(s.curvature) for s in _segments(run)):.3f}",
            largest < 0.5 and run.stopped is None,
        ),
        Claim(
            "the axle's middle ends at the goal, 4 m to the left of where it began, to 1 mm and 0.005 rad",
            f"{off * 1e3:.2f} mm ({along * 1e3:+.2f} mm along) and {turned:+.4f} rad off at {run.t[-1]:g} s; "
            "at the cusps " + " and ".join(f"{d * 1e3:.1f}" for d in closest) + " mm off",
            off <= 1e-3 and abs(turned) <= 0.005 and abs(float(run.speed[-1])) < 1e-4,
            note="off the path at the cusps because only P_l is kept on it: the axle cuts the arc's end, "
            "and what is left there of the angle to the path turns into distance. It comes in at "
            f"creep, and runs on by at most creep/kv = {CREEP / KV * 1e3:g} mm",
        ),
    ]


# -- waypoints -----------------------------------------------------------------------------------------------

# m, as in the spec
POINTS = np.array([[0.0, 0.0], [4.0, 1.0], [7.0, 4.0], [11.0, 4.5], [13.0, 1.5], [17.0, 0.0]])
TOLERANCE = 0.05  # m
CONTINUOUS, HELD = "continuous", "every 10 ms"


def from_curve() -> np.ndarray:
    """Places on the smooth curve through the waypoints, (N, 2), close to one another."""
    places = sampled(through(POINTS.tolist(), None, False, TOLERANCE)[0], 1e-3).places
    return np.column_stack([places.real, places.imag])


def off_path(points: np.ndarray, segments: tuple[Segment, ...]) -> np.ndarray:
    """Distance (m) of points (N, 2) from the nearest place of the path."""
    best = np.full(len(points), np.inf)
    for segment in segments:
        for k, (x, y) in enumerate(points):
            along = min(max(segment.progress(x, y, segment.length / 2), 0.0), segment.length)
            best[k] = min(best[k], math.dist((x, y), segment.pose(along)[:2]))
    return best


def draw_waypoints(runs: Runs) -> matplotlib.figure.Figure:
    """Curve, path and what was driven; curvature; distance."""
    run = runs[HELD]
    figure, axes = panels(
        "waypoints, path of arcs, $P_l$",
        "curvature of the path",
        "distance from the path, every 10 ms",
        height=4.8,
        widths=(1.7, 1, 1),
    )
    _draw_segments(
        axes[0],
        _segments(run),
        f"{len(_segments(run))} arcs, within {TOLERANCE * 100:g} cm of a smooth curve",
    )
    axes[0].plot(*run.P_l.T, color=FORWARD, label="path of $P_l$")
    joins = np.array([(segment.x, segment.y) for segment in _segments(run)[1:]])
    axes[0].plot(*joins.T, "|", color="black", markersize=9, label="join")
    axes[0].plot(
        *POINTS.T,
        "o",
        color=STOP,
        markersize=9,
        fillstyle="none",
        markeredgewidth=1.8,
        label="waypoint (given)",
    )
    for k in np.searchsorted(run.t, (0.0, 3.5, 6.5, 10.5, 20.0)):
        draw_vehicle(axes[0], run, min(int(k), len(run.t) - 1), FAINT, 0.06)
    plane(axes[0], POINTS, np.array([[-1.0, -1.5], [18.0, 6.0]]))
    legend_below(axes[0], 2)
    ends = np.cumsum([0.0, *(segment.length for segment in _segments(run))])
    axes[1].stairs(
        [segment.curvature for segment in _segments(run)], ends, baseline=None, color=FORWARD, linewidth=1.8
    )
    axes[1].axhline(0.0, color="black", linewidth=0.8)
    axes[1].set(xlabel="length along the path (m)", ylabel="curvature (1/m), left positive")
    axes[2].plot(run.t, run.y[:, 0] * 1e3, color=FORWARD)
    axes[2].axhline(0.0, color="black", linewidth=0.8)
    for n, k in enumerate(np.flatnonzero(np.diff(run.piece))):
        axes[2].axvline(run.t[k], color=STOP, linestyle=":", linewidth=0.8, label="" if n else "join")
    over_time(axes[2], "distance (mm), left positive")
    legend_below(axes[2])
    return figure


def claims_waypoints(runs: Runs) -> list[Claim]:
    """The path is near the curve, the robot on the path."""
    segments = _segments(runs[HELD])
    curve, places = float(off_path(from_curve(), segments).max()), float(off_path(POINTS, segments).max())
    joins = [
        (math.dist(a.end[:2], (b.x, b.y)), abs(math.remainder(a.end[2] - b.heading, 2 * math.pi)))
        for a, b in itertools.pairwise(segments)
    ]
    error = {label: float(np.abs(run.y[:, 0]).max()) for label, run in runs.items()}
    tightest = 1 / max(abs(segment.curvature) for segment in segments)
    lookahead = runs[HELD].ahead
    end = float(np.hypot(*(runs[HELD].P_l[-1] - POINTS[-1])))
    return [
        Claim(
            f"the lines and arcs stay within {TOLERANCE * 100:g} cm of the smooth curve, and of the "
            "waypoints",
            f"{curve * 100:.2f} cm and {places * 100:.2f} cm at most, {len(segments)} pieces",
            max(curve, places) <= TOLERANCE,
        ),
        Claim(
            "they join without gap or kink, and no arc is tighter than P_l can go",
            f"gaps up to {max(g for g, _ in joins):.0e} m, kinks up to {max(k for _, k in joins):.0e} rad; "
            f"radii from {tightest:.2f} m, l = {lookahead:g} m",
            max(max(j) for j in joins) < 1e-9 and tightest > lookahead,
        ),
        Claim(
            "they are followed within 5 mm at 10 ms and within 1e-6 m continuously",
            f"{error[HELD] * 1e3:.2f} mm; {error[CONTINUOUS]:.1e} m",
            error[HELD] <= 5e-3 and error[CONTINUOUS] <= 1e-6,
        ),
        Claim(
            "P_l stops at the last waypoint, to 1 cm",
            f"{end * 1e3:.1f} mm off at {runs[HELD].t[-1]:g} s",
            end <= 0.01,
        ),
    ]


# -- the fastest speed ---------------------------------------------------------------------------------------

FASTEST, ONE_SPEED = "fastest", "one speed"
# m/s: as much as friction allows where arcs begin; m/s^2
SLOWER = {"reference.speed": 1.4, "reference.deceleration": 1.5}
STANDS = 0.02  # m/s


def _standing(run: FigureRun) -> float:
    """When the vehicle stands at the end, s."""
    return float(run.t[np.flatnonzero(np.abs(run.speed) > STANDS)[-1]])


def _way(run: FigureRun) -> np.ndarray:
    """How far P_l is along the path, m, (N,)."""
    steps = np.linalg.norm(np.diff(run.P_l, axis=0), axis=1)
    x, y = run.P_l[0]
    return _segments(run)[0].progress(x, y) + np.concatenate([[0.0], np.cumsum(steps)])


def draw_fastest(runs: Runs) -> matplotlib.figure.Figure:
    """The path; speed and curvature over the way; forces of the wheels in their circles of friction."""
    titles = ("path of $P_l$", "speed along the path", "fastest: forces / (μ load)", "friction use")
    figure, axes = panels(*titles, height=4.8, widths=(1.2, 1.2, 1, 1))
    first = runs[FASTEST]
    _draw_segments(axes[0], _segments(first), "lines and arcs")
    axes[0].plot(*first.P_l.T, color=FORWARD, label="$P_l$, fastest")
    for k in np.searchsorted(first.t, (0.0, 1.8, 3.2, 5.0, 12.0)):
        draw_vehicle(axes[0], first, min(int(k), len(first.t) - 1), FAINT, 0.1)
    plane(axes[0], axes[0].dataLim.get_points())
    # a strip below the speed, with an axis of its own
    below = axes[1].inset_axes((0, 0, 1, 0.22), sharex=axes[1])
    ends = np.cumsum([0.0, *(segment.length for segment in _segments(first))])
    curvatures = [segment.curvature for segment in _segments(first)]
    below.stairs(curvatures, ends, fill=True, color=FAINT, alpha=0.25, linewidth=0)
    below.set(ylabel="1/m", ylim=(-0.8, 0.8), yticks=(-0.5, 0.0, 0.5), facecolor="none")
    below.yaxis.tick_right()
    below.yaxis.set_label_position("right")
    below.tick_params(labelbottom=False, bottom=False)
    say(axes[1], "curvature of the path, left positive", (0.02, 0.23))
    for (label, run), colour in zip(runs.items(), COLOURS, strict=False):
        axes[1].plot(
            _way(run), run.speed, color=colour, label=f"{label}: stands after {_standing(run):.1f} s"
        )
        worst = np.max([contact.use for contact in run.grip.contacts], axis=0)
        axes[3].plot(run.grip.t, worst, color=colour, label=f"{label}: at most {worst.max():.2f}")
    axes[1].plot(_way(first), first.y_d[:, 1], color="black", linestyle=":", linewidth=1.2, label="desired")
    axes[1].set(xlabel="way of $P_l$ (m)", ylabel="speed (m/s)", ylim=(-1.6, 4.2), yticks=range(5))
    limited = (first.status == "grip")[: len(first.grip.t)]
    friction_circle(axes[2], 1.25)
    for contact, colour in zip(first.grip.contacts, COLOURS, strict=False):
        across, along = (
            force / (contact.mu * contact.load) for force in (contact.lateral, contact.longitudinal)
        )
        axes[2].plot(across, along, color=colour, linewidth=0.9, label=contact.name)
        axes[2].plot(across[limited], along[limited], ".", color=colour, markersize=6)
    axes[2].plot([], [], ".", color=FAINT, markersize=6, label="limited, so that it rolls")
    over_time(axes[3], "friction use of the wheel with the most")
    axes[3].axhline(1.0, color=STOP)
    for panel in axes:
        legend_below(panel)
    return figure


def claims_fastest(runs: Runs) -> list[Claim]:
    """Sooner, on the path, rolling."""
    times = {label: _standing(run) for label, run in runs.items()}
    off = {label: float(np.abs(run.y[:, 0]).max()) for label, run in runs.items()}
    use = {
        label: max(float(contact.use.max()) for contact in run.grip.contacts) for label, run in runs.items()
    }
    end = max(float(np.hypot(*(run.P_o[-1] - _segments(run)[-1].end[:2]))) for run in runs.values())
    return [
        Claim(
            "it stands at the end 2 s sooner than at the one speed that friction allows where arcs begin",
            ", ".join(f"{label} after {time:.2f} s" for label, time in times.items()),
            times[FASTEST] < times[ONE_SPEED] - 2.0,
        ),
        Claim(
            "it stays within 1 cm of the path",
            ", ".join(f"{label} {distance * 1e3:.1f} mm" for label, distance in off.items()),
            max(off.values()) <= 0.01,
        ),
        Claim(
            "every wheel rolls, at every row",
            ", ".join(f"{label}: friction use at most {most:.3f}" for label, most in use.items()),
            max(use.values()) <= 1.0,
        ),
        Claim(
            "the axle's middle ends at the end of the path, to 2 cm",
            f"{end * 1e3:.1f} mm off at most",
            end <= 0.02,
        ),
    ]


FIGURES = (
    Figure(
        "cusp",
        "Beyond the paper: from pose to pose on a shortest path with cusps",
        "The paper rests on Dubins and Reeds and Shepp: arcs and lines reach any pose. Where a path "
        "reverses, v/(L + d) would change its sign; so P_l changes to the other side of the axle there, "
        "while the robot stands.",
        "",
        {DRIVEN: Case("cusp.toml")},
        draw_cusp,
        claims_cusp,
    ),
    Figure(
        "waypoints",
        "Beyond the paper: waypoints, as arcs and lines within a tolerance",
        "The paper argues that any path can be broken down into lines and arcs. Here a smooth curve through "
        "waypoints is.",
        "",
        {
            HELD: Case("waypoints.toml"),
            CONTINUOUS: Case("waypoints.toml", {"simulation.period": 0.0, "simulation.tolerance": 1e-12}),
        },
        draw_waypoints,
        claims_waypoints,
    ),
    Figure(
        "fastest",
        "Beyond the paper: the fastest speed along a path that friction allows",
        "The paper follows a path at one speed. Here the speed is the highest within the accelerations of "
        "friction.",
        "",
        {FASTEST: Case("fastest.toml"), ONE_SPEED: Case("fastest.toml", SLOWER)},
        draw_fastest,
        claims_fastest,
    ),
)
