"""Beyond the paper: sampled control, the lost wheel radius, damping, an ellipse and its true distance."""

import math

import matplotlib.figure
import numpy as np

from ....simulation.drawing import COLOURS, STOP, over_time, panels, plane, say, start, to_follow
from ..framework import Case, Claim, Figure, FigureRun, Runs
from ..measures import overshoot, time_to_stay_within
from . import line

# -- sampled control -----------------------------------------------------------------------------------------

CONTINUOUS = "continuous"
PERIODS = {"1 ms": 1e-3, "10 ms": 1e-2, "100 ms": 0.1}  # s
# m: position, across, found before
SHIFTS = {"1 ms": (0.7e-3, 0.46e-3), "10 ms": (7e-3, 4.5e-3), "100 ms": (66e-3, 41e-3)}
SHIFT_TOLERANCE = 0.1


def _shifts(run: FigureRun, continuous: FigureRun) -> tuple[np.ndarray, np.ndarray]:
    """How far P_l is from where it would be under continuous control, m,
    and the part of it across the line, over time."""
    shift = run.P_l - continuous.P_l
    return np.hypot(*shift.T), np.abs(line.distance(shift))


def draw_sampled(runs: Runs) -> matplotlib.figure.Figure:
    """Shift from continuous control, in all and across the path; the held torque of the first second."""
    figure, axes = panels(
        "shift of $P_l$ from continuous control",
        "the part of it across the path",
        "right wheel's torque, first 0.8 s",
    )
    for (label, run), colour in zip(runs.items(), COLOURS, strict=False):
        begin = run.t <= 0.8
        held = run.spec.simulation.period >= 0.1
        axes[2].plot(
            run.t[begin],
            run.tau[begin, 0],
            color="black" if label == CONTINUOUS else colour,
            drawstyle="steps-post" if held else "default",
            linestyle="--" if label == CONTINUOUS else "-",
            label=label,
            zorder=3 if label == CONTINUOUS else 2,
        )
        if label == CONTINUOUS:
            continue
        for panel, shift in zip(axes, _shifts(run, runs[CONTINUOUS]), strict=False):
            panel.semilogy(
                run.t, shift * 1e3, color=colour, label=f"{label}: up to {shift.max() * 1e3:.2g} mm"
            )
    for panel in axes[:2]:
        over_time(panel, "shift (mm)")
        panel.set(ylim=(1e-3, 5e3), xlim=(0, 16))
        panel.legend(loc="upper right")
    over_time(axes[2], "torque (N m)")
    axes[2].legend()
    return figure


def claims_sampled(runs: Runs) -> list[Claim]:
    """How much holding the torque shifts the run, and that the line is reached all the same."""
    found = {label: tuple(s.max() for s in _shifts(runs[label], runs[CONTINUOUS])) for label in PERIODS}
    near = [abs(a / b - 1) for label in PERIODS for a, b in zip(found[label], SHIFTS[label], strict=True)]
    slope = [
        np.log10(found[b][k] / found[a][k])
        for a, b in (("1 ms", "10 ms"), ("10 ms", "100 ms"))
        for k in (0, 1)
    ]
    end = max(abs(line.distance(runs[label].P_l)[-1]) for label in PERIODS)
    shown = "; ".join(f"{label}: {a * 1e3:.2f} and {b * 1e3:.2f} mm" for label, (a, b) in found.items())
    return [
        Claim(
            "holding the torque for 1, 10, 100 ms shifts P_l by at most 0.7, 7, 66 mm, across the path "
            f"0.46, 4.5, 41 mm (to {SHIFT_TOLERANCE:.0%})",
            shown,
            max(near) < SHIFT_TOLERANCE,
        ),
        Claim(
            "the shift grows in proportion to the period (first order)",
            f"exponents between {min(slope):.2f} and {max(slope):.2f}",
            all(abs(s - 1) < 0.1 for s in slope),
        ),
        Claim(
            "the line is reached all the same", f"{end * 1e3:.2f} mm off at 20 s (worst of three)", end < 1e-3
        ),
    ]


# -- wheel radius --------------------------------------------------------------------------------------------

SMALL, LARGE = "r = 0.10 m", "r = 0.15 m"


def draw_radius(runs: Runs) -> matplotlib.figure.Figure:
    """Path, wheel rates and torques with either radius."""
    figure, axes = panels("path of $P_l$: the same", "wheel rates: not the same", "torques: not the same")
    to_follow(axes[0], np.array([-3.0, 16.0]), np.array([-3.0, 16.0]), "line y = x")
    for (label, run), colour, style, width in zip(
        runs.items(), COLOURS, ("-", "--"), (4.0, 1.6), strict=False
    ):
        axes[0].plot(*run.P_l.T, style, color=colour, linewidth=width, alpha=0.8, label=label)
        for k, (wheel, line_style) in enumerate((("right", "-"), ("left", ":"))):
            axes[1].plot(run.t, run.nu[:, k], line_style, color=colour, label=f"{label}, {wheel}")
            axes[2].plot(run.t, run.tau[:, k], line_style, color=colour, label=f"{label}, {wheel}")
    start(axes[0], run.P_l[0], "start (0, 2) m")
    plane(axes[0], np.array([[0.0, 0.5], [5.0, 5.5]]))
    axes[0].legend(loc="lower right")
    for panel, quantity in zip(axes[1:], ("wheel rate (rad/s)", "torque (N m)"), strict=True):
        over_time(panel, quantity)
        panel.set_xlim(0, 6)
        panel.legend(loc="lower right" if panel is axes[1] else "upper right")
    return figure


def claims_radius(runs: Runs) -> list[Claim]:
    """The path does not depend on the wheel radius; wheel rates and torques do."""
    small, large = runs[SMALL], runs[LARGE]
    same = max(np.abs(small.P_l - large.P_l).max(), np.abs(small.heading - large.heading).max())
    scaled = np.abs(small.nu - 1.5 * large.nu).max()
    peaks = [float(np.abs(run.tau).max()) for run in (small, large)]
    moving = np.abs(large.tau) > 0.01 * peaks[1]
    ratio = (small.tau[moving] / large.tau[moving]).min(), (small.tau[moving] / large.tau[moving]).max()
    return [
        Claim(
            "path and heading do not depend on the wheel radius, to 1e-9 m and rad",
            f"{same:.1e}",
            same <= 1e-9,
        ),
        Claim(
            "wheel rates are inversely proportional to it, to 1e-8 rad/s",
            f"{scaled:.1e} rad/s",
            scaled <= 1e-8,
        ),
        Claim(
            "torques depend on it, nearly in proportion",
            f"peak {peaks[0]:.2f} N m against {peaks[1]:.2f}; ratio {peaks[0] / peaks[1]:.3f}, 0.667 if it "
            "were proportional",
            0.6 < peaks[0] / peaks[1] < 0.75 and peaks[0] < peaks[1],
            note="not quite, because the wheels' own inertia I_w counts more in a smaller wheel (ratio "
            f"{ratio[0]:.3f} to {ratio[1]:.3f} where the torque is over 1 % of its peak)",
        ),
    ]


# -- damping -------------------------------------------------------------------------------------------------

OVER, CRITICAL = "overdamped (poles −0.5, −2)", "critically damped (double pole −1)"
STARTS = {
    "at speed": "(a) coming in at 1.1 m/s, 0.6 m away",
    "from rest": "(b) starting at rest, 1.41 m away",
}


def draw_damping(runs: Runs) -> matplotlib.figure.Figure:
    """Distance from the line for both dampings and both starts."""
    figure, axes = panels(*STARTS.values(), height=4.2)
    for panel, begin in zip(axes, STARTS, strict=True):
        for damping, colour in zip((OVER, CRITICAL), COLOURS, strict=False):
            run = runs[f"{damping}, {begin}"]
            off, over = line.distance(run.P_l), overshoot(line.distance(run.P_l))
            beyond = f"overshoots by {over * 100:.1f} cm" if over > 1e-4 else "does not overshoot"
            settled = f"within 1 cm from {time_to_stay_within(run.t, off, 0.01):.2f} s"
            panel.plot(run.t, off, color=colour, label=f"{damping}\n{beyond}; {settled}")
        over_time(panel, "distance of $P_l$ from the line (m)")
        panel.axhline(0.0, color=STOP, linewidth=1.5)
        panel.axhspan(0.0, 0.25, color=STOP, alpha=0.08)
        panel.set(xlim=(0, 10), ylim=(None, 0.25))
        say(panel, "the wall's side", (0.98, 0.96), STOP, ha="right", va="top")
        panel.legend(loc="lower right")
    return figure


def claims_damping(runs: Runs) -> list[Claim]:
    """Critically damped is quicker; overdamped does not overshoot where critically damped does."""
    off = {label: line.distance(run.P_l) for label, run in runs.items()}
    over = {label: overshoot(d) for label, d in off.items()}
    time = {label: time_to_stay_within(runs[label].t, d, 0.01) for label, d in off.items()}
    overdamped, critical = ([f"{damping}, {begin}" for begin in STARTS] for damping in (OVER, CRITICAL))
    # e = (e_0 + (e_0' + e_0) t) exp(-t), largest where its rate is zero
    exact = (-0.6 + 0.5 * 2.2) * math.exp(-2.2)
    coming = over[critical[0]]
    return [
        Claim(
            "an overdamped distance loop does not overshoot the path, so it fits beside a wall",
            "overshoot "
            + ", ".join(
                f"{begin} {over[label]:.1e} m" for begin, label in zip(STARTS, overdamped, strict=True)
            ),
            max(over[label] for label in overdamped) <= 1e-12,
            note="as long as it comes in slower than the fast pole times the distance, here 2 × 0.6 "
            "= 1.2 m/s",
            paper=True,
        ),
        Claim(
            "critically damped from the same approach overshoots, by 5.5 cm as its closed form says (to 0.1 "
            "mm)",
            f"{coming * 100:.3f} cm, closed form {exact * 100:.3f} cm",
            abs(coming - exact) < 1e-4,
        ),
        Claim(
            "starting at rest, neither overshoots and critically damped settles sooner",
            f"within 1 cm from {time[critical[1]]:.2f} s against {time[overdamped[1]]:.2f} s",
            over[critical[1]] <= 1e-12 and time[critical[1]] < time[overdamped[1]],
            note=f"coming in at speed it settles later, {time[critical[0]]:.2f} s against "
            f"{time[overdamped[0]]:.2f} s, because it has to come back",
        ),
    ]


# -- ellipse -------------------------------------------------------------------------------------------------


def true_distance(points: np.ndarray, a: float, b: float) -> np.ndarray:
    """Signed distance (m, positive outside) of points (N, 2) from the ellipse (x/a)^2 + (y/b)^2 = 1:
    Newton to the foot point."""
    angle = np.linspace(0, 2 * np.pi, 721)
    curve = np.column_stack([a * np.cos(angle), b * np.sin(angle)])
    t = angle[np.argmin(((points[:, None] - curve) ** 2).sum(axis=2), axis=1)]
    for _ in range(20):
        foot = np.column_stack([a * np.cos(t), b * np.sin(t)])
        first = np.column_stack([-a * np.sin(t), b * np.cos(t)])
        t = t - ((foot - points) * first).sum(axis=1) / (
            (first**2).sum(axis=1) - ((foot - points) * foot).sum(axis=1)
        )
    outside = (points[:, 0] / a) ** 2 + (points[:, 1] / b) ** 2 - 1
    return np.sign(outside) * np.hypot(*(points - np.column_stack([a * np.cos(t), b * np.sin(t)])).T)


def _axes_of(run: FigureRun) -> tuple[float, float]:
    path = run.spec.output.path
    assert path, "every run is along the ellipse"
    return path.parameters["a"], path.parameters["b"]


def draw_ellipse(runs: Runs) -> matplotlib.figure.Figure:
    """Path, both distances over time, and what the approximation is off by against the true distance."""
    figure, axes = panels(
        "path of $P_l$, 1 m/s", "distance from the ellipse", "error of f/‖∇f‖", widths=(1.5, 1, 1)
    )
    angle = np.linspace(0, 2 * np.pi, 361)
    a, b = _axes_of(next(iter(runs.values())))
    to_follow(axes[0], a * np.cos(angle), b * np.sin(angle), "ellipse to follow")
    for (label, run), colour in zip(runs.items(), COLOURS, strict=False):
        true, used = true_distance(run.P_l, a, b), run.y[:, 0]
        axes[0].plot(*run.P_l.T, color=colour, label=f"from {label}")
        start(axes[0], run.P_l[0], "start" if colour == COLOURS[0] else None)
        axes[1].plot(run.t, used, color=colour, label=f"f/‖∇f‖, from {label}")
        axes[1].plot(run.t, true, "--", color=colour, label="true distance")
        seen = np.abs(true) > 1e-4
        axes[2].loglog(np.abs(true[seen]), np.abs(used - true)[seen], color=colour, label=f"from {label}")
    plane(axes[0], np.array([[-6.2, -3.4], [7.6, 4.6]]))
    axes[0].legend(loc="center")
    over_time(axes[1], "distance (m)")
    axes[1].set_xlim(0, 12)
    axes[1].legend(loc="upper right")
    d = np.array([1e-3, 1.0])
    axes[2].loglog(d, d**2 / 4, ":", color="black", label="∝ distance²")
    axes[2].set(xlabel="true distance (m)", ylabel="|f/‖∇f‖ − true distance| (m)")
    axes[2].legend(loc="upper left")
    return figure


def claims_ellipse(runs: Runs) -> list[Claim]:
    """The ellipse is reached in truth though only f / |grad f| is controlled;
    what that differs by is of second order."""
    true = {label: true_distance(run.P_l, *_axes_of(run)) for label, run in runs.items()}
    end = max(abs(d[-1]) for d in true.values())
    first = {label: (float(true[label][0]), float(run.y[0, 0])) for label, run in runs.items()}
    orders = [_order(true[label], runs[label].y[:, 0]) for label in runs]
    forms = {
        label: run.y[0, 0] * (4 * np.exp(-run.t / 2) - np.exp(-2 * run.t)) / 3 for label, run in runs.items()
    }
    unlike = max(np.abs(run.y[:, 0] - forms[label]).max() for label, run in runs.items())
    return [
        Claim(
            "following f/‖∇f‖ = 0 brings the true distance to 0 as well",
            f"{end * 1e3:.4f} mm off at {max(run.t[-1] for run in runs.values()):g} s (worst of {len(runs)})",
            end < 1e-4,
        ),
        Claim(
            "f/‖∇f‖ differs from the true distance away from the curve",
            "; ".join(f"{label}: {u:.3f} m for a true {d:.3f} m" for label, (d, u) in first.items()),
            all(abs(u - d) > 0.01 for d, u in first.values()),
        ),
        Claim(
            "the difference is of second order in the distance",
            "fitted exponents " + ", ".join(f"{order:.2f}" for order in orders),
            all(abs(order - 2) < 0.25 for order in orders),
        ),
        Claim(
            "f/‖∇f‖ itself decays as the closed form of its poles −0.5 and −2, to 1e-9 m",
            f"{unlike:.1e} m",
            unlike <= 1e-9,
        ),
    ]


def _order(true: np.ndarray, used: np.ndarray) -> float:
    """Exponent p of |used - true| ~ |true|^p between 1 mm and 0.3 m; NaN when the run is never there."""
    rows = (np.abs(true) > 1e-3) & (np.abs(true) < 0.3)
    if rows.sum() < 2:
        return math.nan
    return float(np.polyfit(np.log(np.abs(true[rows])), np.log(np.abs(used - true)[rows]), 1)[0])


FIGURES = (
    Figure(
        "sampled",
        "Beyond the paper: control at 1, 10, 100 ms against continuous",
        "A firmware loop holds the torque between calls. How far that moves the robot on the line of case C.",
        f"{line.START}; wheel radius 0.15 m (the torque depends on it)",
        {
            label: Case("sampled.toml", {"simulation.period": period})
            for label, period in {**PERIODS, CONTINUOUS: 0.0}.items()
        },
        draw_sampled,
        claims_sampled,
    ),
    Figure(
        "radius",
        "Beyond the paper: wheel radius 0.10 m against 0.15 m",
        "The scan lost the wheel radius. The later literature has 0.15 m, the wheels' inertias suggest 0.10 "
        "m.",
        f"{line.START}; the wheel radius is what this figure is about",
        {LARGE: Case("radius.toml", {"parameters.r": 0.15}), SMALL: Case("radius.toml")},
        draw_radius,
        claims_radius,
    ),
    Figure(
        "damping",
        "Beyond the paper: overdamped against critically damped",
        "The paper takes an overdamped distance loop beside a wall and offers critical damping for the "
        "middle of a road.",
        f"kp 1 with kd 2.5 or 2, kv 2; {line.START.split(';')[0]} in (b); {line.WHEEL}",
        {
            f"{damping}, {begin}": Case("damping.toml", {"gains.kd": kd, **where})
            for begin, where in (
                ("at speed", {}),
                ("from rest", {"initial": {"point": [0.0, 2.0], "heading": math.pi / 2, "speed": 0.0}}),
            )
            for damping, kd in ((OVER, 2.5), (CRITICAL, 2.0))
        },
        draw_damping,
        claims_damping,
    ),
    Figure(
        "ellipse",
        "Beyond the paper: an ellipse followed by f/‖∇f‖, with the true distance beside it",
        "The exact distance from a general curve has no closed form; the paper proposes f/‖∇f‖. How good "
        "that is.",
        f"{line.GAINS}; {line.WHEEL}",
        {
            "its far end": Case("ellipse.toml"),
            "its flat side": Case("ellipse.toml", {"initial.point": [0.0, 4.5], "initial.heading": math.pi}),
        },
        draw_ellipse,
        claims_ellipse,
    ),
)
