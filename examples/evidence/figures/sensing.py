"""Figures 13 to 16: noisy wheel rates, dead reckoning from them, and setting the pose right now and then."""

from collections.abc import Sequence
from typing import Any

import matplotlib.figure
import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import NullLocator

from ....simulation.drawing import COLOURS, STOP, legend_below, over_time, panels, plane, start
from ..framework import Case, Claim, Figure, FigureRun, Runs
from . import circle

LEFT_MEANS = {"left mean 0.5": 0.5, "left mean 5": 5.0}  # rad/s: the scan leaves both readings open
RIGHT_MEAN, SD = 5.0, 3.0  # rad/s
FIRST, SECOND = LEFT_MEANS
SETTLED = 4.0  # s: without noise the circle is reached by then
TRUE, SENSED = COLOURS[0], COLOURS[1]
NOISE = (
    "noise drawn anew every 10 ms; the mean of the left wheel's is 0.5 or 5 rad/s in the scan: both are shown"
)
ASSUMED = f"{NOISE}; heading 90° at the start; {circle.ASSUMED} (what the noise does depends on it)"


def _noise(mean: float) -> dict[str, Any]:
    return {"sensors.noise": {"mean": [RIGHT_MEAN, mean], "sd": SD}}


def sensed_distance(run: FigureRun) -> np.ndarray:
    """Distance of P_l from the circle as the controller believes it, m, positive outside (L = 0)."""
    return np.hypot(*(run.seen[:, :2] - circle.CENTRE).T) - circle.RADIUS


def _late(run: FigureRun) -> np.ndarray:
    return run.t >= SETTLED


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))


# -- 13: the noise itself ------------------------------------------------------------------------------------


def draw_13(runs: Runs) -> matplotlib.figure.Figure:
    """Sensed and true rate of either wheel."""
    figure, axes = panels(
        "(a) right wheel",
        *(
            f"({'bc'[k]}) left wheel, its mean read as {mean:g} rad/s"
            for k, mean in enumerate(LEFT_MEANS.values())
        ),
        height=4.0,
    )
    for panel, (label, wheel) in zip(axes, ((FIRST, 0), (FIRST, 1), (SECOND, 1)), strict=True):
        run = runs[label]
        sensed, true = run.seen[:, 5 + wheel], run.nu[:, wheel]
        panel.plot(run.t, sensed, color=SENSED, linewidth=0.5, label="sensed")
        panel.plot(run.t, true, color=TRUE, linewidth=2.2, label="true")
        mean = (sensed - true).mean()
        panel.axhline(
            true.mean() + mean,
            color="black",
            linestyle="--",
            linewidth=1.2,
            label=f"mean of the sensed: {mean:+.2f} rad/s off",
        )
        over_time(panel, "wheel rate (rad/s)")
        panel.set_ylim(20, 62)
        panel.legend(loc="upper left")
    return figure


def claims_13(runs: Runs) -> list[Claim]:
    """The noise is the one asked for, fresh at every sample; the motion is uniform."""
    wheels = [(label, wheel, mean) for label, means in _means().items() for wheel, mean in enumerate(means)]
    noise = [runs[label].seen[:, 5 + wheel] - runs[label].nu[:, wheel] for label, wheel, _ in wheels]
    count = len(noise[0])
    means = max(abs(n.mean() - mean) for n, (_, _, mean) in zip(noise, wheels, strict=True))
    sds = max(abs(n.std() - SD) for n in noise)
    neighbours = max(abs(float(np.corrcoef(n[1:], n[:-1])[0, 1])) for n in noise)
    uniform = max(float(np.abs(run.nu - run.nu[0]).max()) for run in runs.values())
    return [
        Claim(
            "the sensed rates are the true ones plus Gaussian noise of the means and standard deviation "
            "stated",
            "; ".join(
                f"{('right', 'left')[w]} {n.mean():.2f} ± {n.std():.2f} rad/s"
                for n, (_, w, _) in zip(noise, wheels, strict=True)
            ),
            means < 4 * SD / count**0.5 and sds < 4 * SD / (2 * count) ** 0.5,
            note=f"means and deviations of {count} samples each, to four standard errors",
            paper=True,
        ),
        Claim(
            "the noise is fresh at every sample: neighbours are not correlated",
            f"correlation at most {neighbours:.3f} (four standard errors: {4 / count**0.5:.3f})",
            neighbours < 4 / count**0.5,
        ),
        Claim(
            "the true motion is a uniform straight one, to 1e-9 rad/s",
            f"{uniform:.1e} rad/s",
            uniform <= 1e-9,
            note="the motors are limited to nothing; under control the robot would answer the noise and "
            "leave the line",
        ),
    ]


def _means() -> dict[str, tuple[float, float]]:
    return {label: (RIGHT_MEAN, mean) for label, mean in LEFT_MEANS.items()}


# -- 14: a circle followed by dead reckoning -----------------------------------------------------------------


def _draw_paths(axes: Axes, run: FigureRun, sensed: str = "sensed path of $P_l$") -> None:
    circle.draw_circle(axes)
    axes.plot(*run.seen[:, :2].T, color=SENSED, linewidth=1.2, label=sensed)
    axes.plot(*run.P_l.T, color=TRUE, label="true path of $P_l$")
    start(axes, run.P_l[0])


def draw_14(runs: Runs) -> matplotlib.figure.Figure:
    """True and sensed path for both readings of the left mean, and the distances."""
    figure, axes = panels(f"(a) {FIRST} rad/s", f"(b) {SECOND} rad/s", "distance from the circle", height=5.2)
    for panel, label in zip(axes, LEFT_MEANS, strict=False):
        _draw_paths(panel, runs[label])
        plane(panel, runs[label].P_l, np.array([[9.0, 9.0], [31.0, 31.0]]))
        legend_below(panel, 2)
    for label, style in zip(LEFT_MEANS, ("-", "--"), strict=True):
        run = runs[label]
        axes[2].plot(
            run.t,
            circle.distance(run),
            style,
            color=TRUE,
            label=f"true, {label}: {_worst(circle.distance(run))}",
        )
        axes[2].plot(run.t, sensed_distance(run), style, color=SENSED, label=f"sensed, {label}")
    over_time(axes[2], "distance (m), outside positive")
    axes[2].set_ylim(-8, 45)
    legend_below(axes[2])
    return figure


def _worst(values: np.ndarray) -> str:
    """The value of largest size, m, as text."""
    return f"up to {values[np.abs(values).argmax()]:+.2f} m".replace("-", "−")


def claims_14(runs: Runs) -> list[Claim]:
    """The robot leaves the circle and does not know."""
    left = {label: circle.distance(runs[label]) for label in LEFT_MEANS}
    believed = {label: sensed_distance(runs[label])[_late(runs[label])] for label in LEFT_MEANS}
    same = max(
        float(np.abs(getattr(runs[AGAIN], name) - getattr(runs[FIRST], name)).max())
        for name in ("q", "nu", "tau", "seen")
    )
    differs = float(np.abs(runs[OTHER_SEED].P_l[-1] - runs[FIRST].P_l[-1]).max())
    agreement = max(run.agreement for run in runs.values())
    return [
        Claim(
            "the vehicle's path diverges from the desired one",
            "; ".join(f"{label}: up to {np.abs(d).max():.2f} m off" for label, d in left.items()),
            all(np.abs(d[_late(runs[label])]).max() > 1.0 for label, d in left.items()),
            note="a difference of the means turns the sensed heading, a common mean lets it believe to be "
            "faster than it is",
            paper=True,
        ),
        Claim(
            "it believes to be close to the path: the sensed path stays on it",
            "; ".join(f"{label}: within {np.abs(d).max() * 100:.1f} cm" for label, d in believed.items())
            + f" from {SETTLED:g} s on",
            all(np.abs(d).max() < 0.15 for d in believed.values()),
            paper=True,
        ),
        Claim(
            "the same seed gives the same run, bit for bit; another seed another run",
            f"largest difference {same:g}; another seed ends {differs:.2f} m away",
            same == 0.0 and differs > 1e-3,
            note="the repeated run has another [contact] mu, by which runs are judged and not made",
        ),
        Claim(
            "with the same noise the dead reckoning in C and that in Python lead to the same run, to 1e-8",
            f"{agreement:.1e}",
            agreement <= 1e-8,
        ),
    ]


# -- 15, 16: recalibration -----------------------------------------------------------------------------------

AGAIN, OTHER_SEED = "the same once more", "another seed"


def _reset(mean: float, rate: float, mode: str = "reset") -> Case:
    return Case("figure_14.toml", {**_noise(mean), "correction": {"rate": rate, "mode": mode}})


def _corrections(run: FigureRun) -> np.ndarray:
    """Rows at which the pose was corrected, but for the last row."""
    rate = run.spec.correction.rate if run.spec.correction else 0.0
    count = np.floor(run.t[:-1] * rate + 1e-9)
    return np.flatnonzero(np.diff(count)) + 1


def steps(run: FigureRun) -> tuple[np.ndarray, np.ndarray]:
    """How far the sensed and the true P_l move between samples, m, each (N - 1,)."""
    return np.hypot(*np.diff(run.seen[:, :2], axis=0).T), np.hypot(*np.diff(run.P_l, axis=0).T)


def draw_reset(runs: Runs) -> matplotlib.figure.Figure:
    """True and sensed path, distances with the jumps, and how far P_l moves from sample to sample."""
    run = runs[FIRST]
    figure, axes = panels(
        f"paths, {FIRST} rad/s",
        "distance from the circle",
        "change of the position in 10 ms",
        height=5.2,
        widths=(1.1, 1, 1),
    )
    _draw_paths(axes[0], run)
    set_right = _corrections(run)
    axes[0].plot(
        *run.P_l[set_right].T, "o", color=STOP, markersize=4, label="pose set to the true one", zorder=5
    )
    plane(axes[0], run.P_l, run.seen[:, :2])
    legend_below(axes[0], 2)
    for label, style in zip(LEFT_MEANS, ("-", "--"), strict=True):
        other = runs[label]
        off = circle.distance(other)
        axes[1].plot(
            other.t, off, style, color=TRUE, label=f"true, {label}: rms {_rms(off[_late(other)]):.2f} m"
        )
        axes[1].plot(
            other.t, sensed_distance(other), style, color=SENSED, linewidth=1.0, label=f"sensed, {label}"
        )
    over_time(axes[1], "distance (m), outside positive")
    axes[1].set_ylim(-2.5, 5.5)
    axes[1].axhline(0.0, color="black", linewidth=0.8)
    axes[1].legend(loc="upper left", fontsize=8.5)
    for moved, colour, label in zip(steps(run), (SENSED, TRUE), ("sensed", "true"), strict=True):
        axes[2].semilogy(
            run.t[1:],
            moved,
            color=colour,
            linewidth=1.2,
            label=f"{label}: up to {moved[set_right[0] - 1 :].max():.3f} m",
        )
    over_time(axes[2], "change (m)")
    axes[2].legend(loc="upper right")
    _plain(axes[2], (0.02, 5), (0.02, 0.05, 0.1, 0.2, 0.5, 1, 2))
    return figure


def claims_reset(runs: Runs) -> list[Claim]:
    """The error is bounded; the sensed pose jumps, the true pose and speed do not."""
    off = {label: np.abs(circle.distance(runs[label])) for label in LEFT_MEANS}
    worst = {label: float(d[_late(runs[label])].max()) for label, d in off.items()}
    without = {label: float(np.abs(circle.distance(runs[f"never, {label}"])).max()) for label in LEFT_MEANS}
    growth = {label: _late_growth(runs[label]) for label in LEFT_MEANS}
    return [
        Claim(
            "the path is significantly better than without: the error stays bounded",
            "; ".join(
                f"{label}: up to {worst[label]:.2f} m (never corrected {without[label]:.2f} m)"
                for label in LEFT_MEANS
            )
            + f" from {SETTLED:g} s on",
            all(worst[label] < 0.5 * without[label] for label in LEFT_MEANS)
            and all(g < 1.5 for g in growth.values()),
            note="RMS distance of the second half of that time over that of the first: "
            + ", ".join(f"{label} {g:.2f}" for label, g in growth.items()),
            paper=True,
        ),
        *_continuity(runs[FIRST], FIRST),
    ]


def _late_growth(run: FigureRun) -> float:
    """RMS distance in the second half of the settled time over that in the first:
    1.7 where it grows evenly from the start."""
    off, half = circle.distance(run), (SETTLED + run.t[-1]) / 2
    return _rms(off[run.t > half]) / _rms(off[_late(run) & (run.t <= half)])


def _plain(axes: Axes, limits: tuple[float, float], levels: Sequence[float]) -> None:
    """Limits and ticks of a logarithmic axis, as plain numbers."""
    axes.set_yticks(levels, [f"{level:g}" for level in levels])
    axes.set_ylim(limits)
    axes.yaxis.set_minor_locator(NullLocator())


def _continuity(run: FigureRun, label: str) -> list[Claim]:
    """What jumps at the corrections and what does not."""
    rows = _corrections(run) - 1
    sensed, true = steps(run)
    others = np.setdiff1d(np.arange(rows[0], len(sensed) - 1), rows)  # the end may fall on a correction
    speed = np.abs(np.diff(run.speed))
    return [
        Claim(
            "the sensed position is discontinuous",
            f"jumps by {sensed[rows].min() * 100:.1f} to {sensed[rows].max() * 100:.1f} cm when set right, "
            f"moves by at most {sensed[others].max() * 100:.1f} cm between other samples ({label})",
            bool(sensed[rows].max() > 2 * sensed[others].max()),
            paper=True,
        ),
        Claim(
            "the actual position and velocity are not discontinuous",
            f"in the 10 ms after it is set right P_l moves {true[rows + 1].min() * 100:.2f} to "
            f"{true[rows + 1].max() * 100:.2f} cm, otherwise {true[others].min() * 100:.2f} to "
            f"{true[others].max() * 100:.2f} cm; the speed changes by at most {speed[rows + 1].max():.3f} "
            f"m/s, otherwise {speed[others].max():.3f} m/s",
            bool(
                true[rows + 1].max() < 1.1 * true[others].max()
                and speed[rows + 1].max() < 1.5 * speed[others].max()
            ),
            note="the torque, though, jumps with what is sensed",
            paper=True,
        ),
    ]


RATES = (1.0, 2.0, 10.0)  # Hz
BUMPLESS = "bumpless"
LEVELS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0)  # m, marked on the axis


def _rate(rate: float, mode: str, left: str) -> str:
    return f"{rate:g} Hz, {mode}, {left}"


def draw_rates(runs: Runs) -> matplotlib.figure.Figure:
    """Distance for the three rates, rms against the rate, and what either correction does to the sensed
    position."""
    figure, axes = panels(
        "distance from the circle, reset",
        "against the rate",
        "change of the sensed position in 10 ms",
        height=4.6,
    )
    for rate, colour in zip(RATES, (COLOURS[3], COLOURS[0], COLOURS[2]), strict=True):
        run = runs[_rate(rate, "reset", FIRST)]
        axes[0].plot(run.t, circle.distance(run), color=colour, label=f"{rate:g} Hz")
    over_time(axes[0], "true distance (m)")
    axes[0].set_ylim(-1, 4)
    axes[0].axhline(0.0, color="black", linewidth=0.8)
    axes[0].legend(loc="upper right", title=f"{FIRST} rad/s")
    for mode, style in (("reset", "-"), (BUMPLESS, "--")):
        for left, colour in zip(LEFT_MEANS, COLOURS, strict=False):
            rms = [
                _rms(circle.distance(run)[_late(run)])
                for run in (runs[_rate(rate, mode, left)] for rate in RATES)
            ]
            axes[1].loglog(RATES, rms, f"o{style}", color=colour, label=f"{mode}, {left}")
    axes[1].set(xlabel="rate of corrections (Hz)", ylabel=f"rms distance from {SETTLED:g} s on (m)")
    axes[1].set_xticks(RATES, [f"{rate:g}" for rate in RATES], minor=False)
    axes[1].xaxis.set_minor_locator(NullLocator())
    _plain(axes[1], (0.1, 12), LEVELS)
    axes[1].legend(loc="upper right")
    for mode, colour in (("reset", SENSED), (BUMPLESS, COLOURS[2])):
        run = runs[_rate(1.0, mode, FIRST)]
        axes[2].semilogy(
            run.t[1:],
            steps(run)[0],
            color=colour,
            linewidth=1.0,
            label=f"{mode}, 1 Hz: up to {steps(run)[0].max():.3f} m",
        )
    over_time(axes[2], "change (m)")
    _plain(axes[2], (0.01, 5), (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2))
    axes[2].legend(loc="upper right")
    return figure


def claims_rates(runs: Runs) -> list[Claim]:
    """The more often the better; bumpless takes the jumps away and costs accuracy."""
    rms = {label: _rms(circle.distance(run)[_late(run)]) for label, run in runs.items()}
    resets = {left: [rms[_rate(rate, "reset", left)] for rate in RATES] for left in LEFT_MEANS}
    smooth = {left: [rms[_rate(rate, BUMPLESS, left)] for rate in RATES] for left in LEFT_MEANS}
    run, reset = runs[_rate(1.0, BUMPLESS, FIRST)], runs[_rate(1.0, "reset", FIRST)]
    jumps = [float(steps(r)[0][_corrections(r) - 1].max()) for r in (reset, run)]
    others = float(np.delete(steps(run)[0], [*(_corrections(run) - 1), -1]).max())
    return [
        Claim(
            "the performance improves with the rate: 1, 2 and 10 Hz",
            "; ".join(
                f"{left}: rms {', '.join(f'{value:.2f}' for value in values)} m"
                for left, values in resets.items()
            ),
            all(bool(np.all(np.diff(values) < 0)) for values in resets.values()),
            note="what remains at 10 Hz no pose takes away: the sensed rates, which the controller uses too, "
            "are still off",
            paper=True,
        ),
        Claim(
            "a bumpless correction makes no jump in the sensed position",
            f"at the corrections it moves by at most {jumps[1] * 100:.1f} cm (reset: {jumps[0] * 100:.1f} "
            f"cm), otherwise {others * 100:.1f} cm",
            jumps[1] <= others,
        ),
        Claim(
            "and costs accuracy: it is farther off than a reset at the same rate",
            "; ".join(
                f"{left}: rms {', '.join(f'{value:.2f}' for value in values)} m"
                for left, values in smooth.items()
            ),
            all(s > r for left in LEFT_MEANS for s, r in zip(smooth[left], resets[left], strict=True)),
            note="it lets the correction in over a whole period, so that what is believed is always late",
        ),
    ]


def _reset_figure(number: str, rate: float) -> Figure:
    return Figure(
        number,
        f"Figure {number}: recalibration at {rate:g} Hz",
        f"End-point feedback at {rate:g} Hz, slow against the servo loop: the dead-reckoned pose is set to "
        "the true one.",
        ASSUMED,
        {
            **{label: _reset(mean, rate) for label, mean in LEFT_MEANS.items()},
            **{f"never, {label}": Case("figure_14.toml", _noise(mean)) for label, mean in LEFT_MEANS.items()},
        },
        draw_reset,
        claims_reset,
    )


FIGURES = (
    Figure(
        "13",
        "Figure 13: noise in the sensed wheel rates",
        "The rate of either wheel that the controller receives in a uniform straight motion, against the "
        "truth.",
        f"{NOISE}; the speed, 5 m/s; wheel radius 0.15 m",
        {label: Case("figure_13.toml", _noise(mean)) for label, mean in LEFT_MEANS.items()},
        draw_13,
        claims_13,
    ),
    Figure(
        "14",
        "Figure 14: the circle followed by dead reckoning from noisy wheel rates",
        "The controller's pose is what the sensed rates add up to. The vehicle leaves the circle and "
        "believes to be on it.",
        ASSUMED,
        {
            **{label: Case("figure_14.toml", _noise(mean)) for label, mean in LEFT_MEANS.items()},
            # By which it is judged, not made
            AGAIN: Case("figure_14.toml", {**_noise(LEFT_MEANS[FIRST]), "contact.mu": 0.8}),
            OTHER_SEED: Case("figure_14.toml", {**_noise(LEFT_MEANS[FIRST]), "sensors.seed": 2}),
        },
        draw_14,
        claims_14,
    ),
    _reset_figure("15", 1.0),
    _reset_figure("16", 2.0),
    Figure(
        "rates",
        "Beyond the paper: recalibration at 1, 2 and 10 Hz, at once or bumpless",
        "How the error goes with the rate of the corrections, and what letting them in slowly changes.",
        ASSUMED,
        {
            _rate(rate, mode, label): _reset(mean, rate, mode)
            for rate in RATES
            for mode in ("reset", BUMPLESS)
            for label, mean in LEFT_MEANS.items()
        },
        draw_rates,
        claims_rates,
    ),
)
