"""Figures of an outer loop: Bode and Nyquist plots with margins, step responses, eigenvalues over the period
and for model errors.
"""

import math
from collections.abc import Sequence

import control
import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from ...simulation.drawing import COLOURS, FAINT, STOP, STYLE, legend_below, say, with_data
from .channel import Channel
from .design import settling_time, size_names
from .margins import Margins, Response, frequencies
from .report import OuterLoopReport
from .robustness import Loops, one_by_one

CONTINUOUS, SAMPLED = COLOURS[0], COLOURS[1]
AMOUNTS = 21  # plotted sizes of each error
PERIODS = 160
# Times the periods drawn: channels that alone are stable up to so much longer ones are in the view
WIDER = 4.0
SHOWN = 3.2  # range of the Nyquist plot
MARKERS = "osD^vP*X"
OUTLIERS = 0.02  # part of the fastest eigenvalues that may be left of the view


def pictures_of(report: OuterLoopReport) -> dict[str, bytes]:
    """Return files by name: png, and the plotted data as csv."""
    drawn = {"loops": draw_loops, "steps": draw_steps}
    if report.sizes:
        drawn["disturbances"] = draw_disturbances
    if not report.why_not:
        drawn |= {"period": draw_period, "wrong": draw_wrong}
    files: dict[str, bytes] = {}
    with matplotlib.rc_context(STYLE):
        for name, draw in drawn.items():
            files |= {f"{name}.{kind}": content for kind, content in with_data(draw(report), "png").items()}
    return files


def draw_loops(report: OuterLoopReport) -> Figure:
    """Bode plots and Nyquist plot of each channel, broken at v."""
    figure, rows = _grid(report, len(report.channels), 3, "the loop of each channel, broken at v", 4.8)
    for (magnitude, phase, nyquist), channel in zip(rows, report.channels.values(), strict=True):
        for each, colour, label in _versions(channel):
            loop, margins = each.loop(), each.margins()
            omega = frequencies(loop)
            omega = omega[np.isfinite(omega)]
            L = Response(loop)(omega)[:, 0, 0]
            of_gain, of_phase = _margins_text(margins)
            magnitude.semilogx(omega, 20 * np.log10(np.abs(L)), color=colour, label=f"{label}: {of_gain}")
            phase.semilogx(omega, np.degrees(_phase(L)), color=colour, label=f"{label}: {of_phase}")
            nyquist.plot(L.real, L.imag, color=colour, label=label)
            nyquist.plot(L.real, -L.imag, color=colour, linewidth=0.8, alpha=0.6)
            _mark_crossover(magnitude, phase, margins, colour)
            for axes in (magnitude, phase):
                axes.set_xlim(0.1 * min(abs(channel.gains.poles)), 40 * max(abs(channel.gains.poles)))
        _finish_bode(magnitude, phase, channel)
        _finish_nyquist(nyquist, channel)
    return figure


def draw_steps(report: OuterLoopReport) -> Figure:
    """Draw the response of each output to a unit step of its reference, and v."""
    figure, rows = _grid(
        report,
        len(report.channels),
        2,
        "response to a unit step of each reference, its derivatives zero",
        4.6,
    )
    for (output, effort), channel in zip(rows, report.channels.values(), strict=True):
        end = 1.6 * settling_time(channel.gains)
        for each, colour, label in _versions(channel):
            period = each.period
            times = np.linspace(0, end, 600) if period is None else period * np.arange(int(end / period) + 2)
            response = control.step_response(each.closed(), times, squeeze=False)
            y, v = response.outputs[0, 0], response.outputs[-1, 0]
            style = "-" if period is None else ".-"
            output.plot(
                times,
                y,
                style,
                color=colour,
                label=f"{label}: {_response(times, y)}",
                markersize=3,
                linewidth=1.2,
            )
            effort.plot(
                times,
                v,
                color=colour,
                label=label,
                linewidth=1.2,
                drawstyle="default" if period is None else "steps-post",
            )
        for edge in (0.98, 1.02):
            output.axhline(edge, color=FAINT, linewidth=0.8, linestyle=":")
        say(output, "dotted: within 2 %", (0.98, 0.08), ha="right")
        output.set(title=channel.name, xlabel="time t (s)", ylabel=f"{channel.name} ({channel.unit})")
        power = f"$^{channel.gains.degree}$" if channel.gains.degree > 1 else ""
        unit = f"{channel.unit}/s{power}"
        effort.set(
            title=f"v of {channel.name}",
            xlabel="time t (s)",
            ylabel=f"v ({unit.replace('m/s/s', 'm/s$^2$')})",
        )
        legend_below(output)
        legend_below(effort)
    return figure


def draw_disturbances(report: OuterLoopReport) -> Figure:
    """Draw what disturbances of each frequency do to the channels of an H-infinity design,
    relative to the largest values."""
    about = "what a disturbance of v does, relative to the largest values of the design"
    figure, ((*each,),) = _grid(report, 1, len(report.sizes), about, 5.2)
    for axes, (name, sizes) in zip(each, report.sizes.items(), strict=True):
        channel = report.channels[name]
        for version, style, label in zip(_versions(channel), ("-", "--"), ("", None), strict=False):
            system = version[0].disturbed(sizes)
            omega = np.geomspace(
                0.02 * min(abs(channel.gains.poles)), 40 * max(abs(channel.gains.poles)), 600
            )
            omega = omega[omega <= np.pi / system.dt] if system.dt else omega
            response = np.abs(Response(system)(omega)[:, :, 0])
            parts = [*size_names(channel.gains.degree, bool(channel.gains.integral)), "all together"]
            for part, colour, values in zip(
                parts, COLOURS, [*response.T, np.linalg.norm(response, axis=1)], strict=False
            ):
                axes.loglog(
                    omega, values, style, color=colour, label=part if label == "" else None, linewidth=1.4
                )
            axes.plot([], [], style, color=FAINT, label=f"{version[2]}: norm {version[0].norm(sizes):.3g}")
        axes.axhline(1, color=STOP, linewidth=1.2, label="bound")
        axes.set(title=name, xlabel="frequency (rad/s)", ylabel="amplitude / largest value", ylim=(1e-3, 3))
        legend_below(axes, 3)
    return figure


def _response(times: np.ndarray, y: np.ndarray) -> str:
    """Overshoot of a response to a unit step, and when it stays within 2 % of it, as text."""
    outside = np.flatnonzero(np.abs(y - 1) > 0.02)
    settled = (
        f"within 2 % from {times[outside[-1] + 1]:.3g} s"
        if outside[-1] + 1 < len(y)
        else "not within 2 % yet"
    )
    over = y.max() - 1
    return ("no overshoot" if over < 5e-4 else f"overshoot {100 * over:.1f} %") + f", {settled}"


def draw_period(report: OuterLoopReport) -> Figure:
    """Draw the eigenvalues of the whole loop from call to call over the period, and the largest of them."""
    held = "commands" if report.loops.drive else "torque"
    figure, ((plane, size),) = _grid(report, 1, 2, f"the whole loop, {held} held between calls", 6.0)
    motion, limits = report.motion, report.longest
    end = (
        1.25 * limits["stable"]
        if math.isfinite(limits["stable"]) and limits["stable"]
        else 10 / motion.decay()
    )
    shortest = report.loops.drive.shortest if report.loops.drive else 0.0
    periods = np.linspace(max(1e-3, shortest / end), 1, PERIODS) * end
    values = [motion.eigenvalues(period) for period in periods]  # behind drives, more for shorter periods
    circle = np.exp(1j * np.linspace(0, 2 * np.pi, 400))
    plane.plot(circle.real, circle.imag, color=STOP, linewidth=1, label="limit of stability |z| = 1")
    run = [motion.eigenvalues(period, True) for period in periods] if report.loops.delay else values
    every, of = np.concatenate(run), np.repeat(1e3 * periods, [len(z) for z in run])
    dots = plane.scatter(every.real, every.imag, c=of, s=7, cmap="viridis", zorder=3)
    figure.colorbar(dots, ax=plane, label="period T (ms)", shrink=0.8)
    plane.set(xlabel="Re z", ylabel="Im z", title="eigenvalues of the map over a period")
    plane.set_aspect("equal", adjustable="datalim")
    legend_below(plane)
    late = np.array([np.abs(motion.eigenvalues(period, True)[0]) for period in periods])
    size.plot(1e3 * periods, [np.abs(z[0]) for z in values], color=CONTINUOUS, label="whole loop")
    size.plot(1e3 * periods, late, color=SAMPLED, label="with a delay of one sample")
    size.axhline(1, color=STOP, linewidth=1)
    for limit, colour in ((limits["stable"], CONTINUOUS), (limits["stable_with_delay"], SAMPLED)):
        if 0 < limit < end:
            size.plot(1e3 * limit, 1, "o", color=colour)
            size.annotate(
                f"{1e3 * limit:.4g} ms",
                (1e3 * limit, 1),
                (0, 10),
                textcoords="offset points",
                ha="right",
                color=colour,
            )
    alone = {name: channel.longest_period(False) for name, channel in report.channels.items()}
    view = max([end, *(1.05 * limit for limit in alone.values() if limit < WIDER * end)])
    for name, limit in alone.items():
        where = f"{1e3 * limit:.4g} ms" + (" (beyond the view)" if limit > view else "")
        size.axvline(1e3 * limit, color=FAINT, linewidth=0.8, linestyle=":") if limit <= view else None
        size.plot([], [], ":", color=FAINT, linewidth=0.8, label=f"channel {name} alone: {where}")
    size.set(
        xlabel="period T (ms)",
        ylabel="largest |z|",
        title="stable while below 1",
        xlim=(0, 1e3 * view),
        ylim=(0.5, 1.6),
    )
    legend_below(size)
    return figure


def draw_wrong(report: OuterLoopReport) -> Figure:
    """Draw the eigenvalues with model errors, one at a time and all at once, and the effect of each."""
    title = f"model errors up to {report.spread:.0%} (L: of its distance from the axle; heading: rad)"
    figure, ((plane, bars),) = _grid(report, 1, 2, title, 6.6, (1.5, 1))
    loops, ranked = report.loops, [harm.name for harm in report.ranking]
    together = np.concatenate([_rates(case.eigenvalues, loops) for case in report.corners])
    plane.scatter(together.real, together.imag, s=5, color="#c4c4c4", label="all errors at once", zorder=1)
    amounts = report.spread * np.linspace(-1, 1, AMOUNTS)
    for name, colour, marker in zip(ranked, COLOURS, MARKERS, strict=False):
        rates = np.concatenate(
            [_rates(case.eigenvalues, loops) for case in one_by_one(report.motion, amounts, loops, [name])]
        )
        plane.scatter(
            rates.real, rates.imag, s=16, color=colour, marker=marker, linewidth=0.8, label=name, zorder=3
        )
    exact = _rates(report.motion.eigenvalues(loops.period, loops.delay), loops)
    plane.plot(
        exact.real,
        exact.imag,
        "+",
        color="black",
        markersize=13,
        markeredgewidth=2,
        label="exact model",
        zorder=4,
    )
    shown = np.quantile(together.real, OUTLIERS)
    left = min(shown, exact.real.min()) - 0.05 * np.ptp(together.real[together.real >= shown])
    plane.set_xlim(left=left)
    _draw_limit(plane, loops, f"unstable {'right of' if loops.period is None else 'outside'} it")
    beyond = int((together.real < left).sum())
    if beyond:
        say(plane, f"{beyond} of {len(together)} grey points are further left", (0.02, 0.02))
    of = "s" if loops.period is None else "(z - 1)/T"
    plane.set(
        xlabel=f"Re {of} (1/s)",
        ylabel=f"Im {of} (rad/s)",
        title="eigenvalues of the whole loop; the eight largest effects",
    )
    legend_below(plane, 5)
    harms = report.ranking[::-1]
    bars.barh([harm.name for harm in harms], [100 * harm.loss for harm in harms], color=COLOURS[0])
    for k, harm in enumerate(harms):
        row = report.law.output.rows[0]
        stays = f"steady error of {row.name} {harm.offset:.3g} {row.unit}" if abs(harm.offset) > 1e-9 else ""
        bars.text(100 * harm.loss + 0.6, k, f"{100 * harm.loss:.3g} %  {stays}", va="center", fontsize=8)
    bars.set(xlabel="largest loss of decay rate, disk margin or longest period (%)", title="largest effects")
    bars.set_xlim(0, 1.75 * max(1e-3, *[100 * harm.loss for harm in harms]))
    return figure


def _grid(
    report: OuterLoopReport, rows: int, columns: int, about: str, height: float, widths: Sequence[float] = ()
) -> tuple[Figure, np.ndarray]:
    # inches
    figure = Figure(
        figsize=(13.0, height * rows + 0.6), layout=ConstrainedLayoutEngine(w_pad=0.08, h_pad=0.1)
    )
    loops = report.loops
    run = (
        "continuous"
        if loops.period is None
        else f"called every {1e3 * loops.period:g} ms" + ", delay of one sample" * loops.delay
    )
    run += f", {loops.drive}" if loops.drive else ""
    gains = ", ".join(f"{name} {value:.4g}" for name, value in report.entries().items())
    figure.suptitle(
        f"{report.spec.robot}, {report.law.name}: {about}\n{gains}; {run}", fontsize=11, x=0.01, ha="left"
    )
    return figure, figure.subplots(rows, columns, squeeze=False, width_ratios=tuple(widths) or None)


def _versions(channel: Channel) -> list[tuple[Channel, str, str]]:
    """The channel in continuous time and, where it is sampled, as it is run; the title tells of a delay."""
    versions = [(channel.ideal, CONTINUOUS, "continuous")]
    if channel.period is None:
        return versions
    return [*versions, (channel, SAMPLED, f"every {1e3 * channel.period:g} ms")]


def _phase(L: np.ndarray) -> np.ndarray:
    """Return the phase (rad) without jumps, at the lowest frequency between -360 and 0 degrees."""
    phase = np.unwrap(np.angle(L))
    return phase - 2 * np.pi * math.ceil(phase[0] / (2 * np.pi))


def _margins_text(margins: Margins) -> tuple[str, str]:
    """The margins of gain and phase as text."""
    gain = "unlimited" if margins.gain == math.inf else f"{20 * math.log10(margins.gain):.1f} dB"
    phase = "unlimited"
    if math.isfinite(margins.phase):
        phase = f"{math.degrees(margins.phase):.1f}° at {margins.crossover:.3g} rad/s"
    return f"gain margin {gain}, Ms {margins.Ms:.3f}, Mt {margins.Mt:.3f}", f"phase margin {phase}"


def _mark_crossover(magnitude: Axes, phase: Axes, margins: Margins, colour: str) -> None:
    if math.isfinite(margins.phase):
        phase.axvline(margins.crossover, color=colour, linewidth=0.8, linestyle=":")
        magnitude.plot(margins.crossover, 0, "o", color=colour, markersize=5)
        phase.plot(margins.crossover, math.degrees(margins.phase) - 180, "o", color=colour, markersize=5)


def _finish_bode(magnitude: Axes, phase: Axes, channel: Channel) -> None:
    magnitude.axhline(0, color=FAINT, linewidth=0.8)
    phase.axhline(-180, color=STOP, linewidth=0.8)
    magnitude.set(
        title=f"{channel.name}: gain", xlabel="frequency (rad/s)", ylabel="|L| (dB)", ylim=(-50, 50)
    )
    phase.set(
        title=f"{channel.name}: phase",
        xlabel="frequency (rad/s)",
        ylabel="angle of L (deg)",
        ylim=(-285, -60),
    )
    for axes in (magnitude, phase):
        legend_below(axes)


def _finish_nyquist(axes: Axes, channel: Channel) -> None:
    """The point -1, and the circle around it that L must not enter to keep |S| below 2."""
    around = np.exp(1j * np.linspace(0, 2 * np.pi, 200)) / 2 - 1
    axes.fill(around.real, around.imag, color=STOP, alpha=0.12, label="|S| > 2")
    axes.plot(-1, 0, "+", color=STOP, markersize=11, markeredgewidth=2, label="-1")
    axes.set(
        title=f"{channel.name}: Nyquist",
        xlabel="Re L",
        ylabel="Im L",
        xlim=(-SHOWN, 1),
        ylim=(-SHOWN / 1.6, SHOWN / 1.6),
    )
    legend_below(axes, 2)


def _rates(values: np.ndarray, loops: Loops) -> np.ndarray:
    """Eigenvalues s, or (z - 1) / T, which is s for short periods T; 1/s."""
    return values if loops.period is None else (values - 1) / loops.period


def _draw_limit(axes: Axes, loops: Loops, label: str) -> None:
    """The edge of stability among `_rates`: the imaginary axis, or a circle that touches it;
    the view stays as it is."""
    view = axes.get_xlim(), axes.get_ylim()
    if loops.period is None:
        axes.axvline(0, color=STOP, linewidth=1.5, label=label)
    else:
        edge = (np.exp(1j * np.linspace(-np.pi, np.pi, 2000)) - 1) / loops.period
        axes.plot(edge.real, edge.imag, color=STOP, linewidth=1.5, label=label)
    axes.set(xlim=view[0], ylim=view[1])
