"""Figures of a sweep: errors over time, outcomes by parameter, and maps of starts:
which become singular, which keep rolling."""

from pathlib import Path
from typing import Any

import matplotlib.figure
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.ticker import FuncFormatter, NullLocator

from ....model.mechanism import Quantity
from ....model.outputs import OutputRow
from ....readers.progress import Reported, silent
from ...drawing import COLOURS, FAINT, STOP, over_time, pictures
from ..runner import run_table
from ..store import open_sweep
from ..study import Study, study_of
from .report import SweepReport
from .statistics import ENDED

INSTANTS, DRAWN = 240, 2000  # of the errors over time, and how many samples are drawn
BANDS = ((0.005, 0.995, 0.15), (0.05, 0.95, 0.3), (0.25, 0.75, 0.55))  # from, to, how dark
POINTS, BINS = 6000, 24  # of a cloud, and steps of its median
COLUMNS, MOST = 3, 6  # panels in a row, and in all
GRID = (181, 25)  # starts of the map, finer in the heading
# About the SPEC's, of what does not vary; rad, m, m/s
REACH = {"heading": np.pi, "point[0]": 5.0, "point[1]": 5.0, "speed": 2.0}
EDGES = (0.002, 0.998)  # of what varies, in the map where no heading is known
STARTS = 1000  # samples in it
USES = (0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.5, 5.0, 10.0)  # friction use, steps of the map
NOMINAL: dict[str, Any] = {
    "marker": "*",
    "s": 170,
    "color": "white",
    "edgecolor": "black",
    "linewidth": 1.2,
    "zorder": 6,
}


def figures_of(report: SweepReport, jobs: int, progress: Reported = silent) -> dict[str, bytes]:
    """File name -> content, png and svg."""
    study, name = report.study, Path(report.spec).name
    summary = report.summary
    summary_text = (
        f"{name}: {summary.samples} samples, {summary.failed} fail "
        f"({100 * summary.failed / summary.samples:.3g} %)"
    )
    made = {"envelope": (lambda: _envelope(report, jobs, progress), f"{summary_text}; error over time")}
    if study.plan.names:
        made["cloud"] = (lambda: _cloud(report), f"{summary_text}; by parameter")
    starts = _start_axes(study)
    if starts:
        made["starts"] = (
            lambda: _starts(report, starts, jobs),
            f"{name}: starts that become singular, all else as in the SPEC",
        )
        if "use" in study.batch.outcomes:
            title = f"{name}: starts that keep rolling, all else as in the SPEC"
            made["rolling"] = (lambda: _rolling(report, starts, jobs), title)
    found: dict[str, bytes] = {}
    for number, (file, (draw, title)) in enumerate(made.items()):
        progress(number, len(made), "pictures")
        found |= {f"{file}.{kind}": content for kind, content in pictures(draw, title, "").items()}
    return found


def _envelope(report: SweepReport, jobs: int, progress: Reported) -> matplotlib.figure.Figure:
    """Quantiles of the error of the first output, signed, and of its size on a logarithmic scale."""
    study, row = report.study, report.study.batch.law.output.rows[0]
    t = np.linspace(0.0, study.spec.simulation.duration, INSTANTS)
    watched = study_of(study.text, report.spec, study.samples, tuple(t))
    table = study.plan.table(0, min(DRAWN, study.samples))
    first = watched.batch.outcomes.index(f"error.{row.name}[0]")
    table = np.vstack([_nominal(study), table])

    def finished(rows: int) -> None:
        progress(rows, len(table), "runs for the envelope")

    errors = run_table(watched, table, jobs, finished)[:, first : first + INSTANTS]
    figure = matplotlib.figure.Figure(figsize=(12.0, 4.8), layout="constrained")
    axes = figure.subplots(1, 2)
    running = np.isfinite(errors[1:]).any(axis=0)
    for panel, values in zip(axes, (errors, np.abs(errors)), strict=True):
        for low, high, dark in BANDS:
            edges = np.full((2, INSTANTS), np.nan)
            edges[:, running] = np.nanquantile(values[1:, running], (low, high), axis=0)
            panel.fill_between(
                t, *edges, color=COLOURS[0], alpha=dark, linewidth=0, label=f"{high - low:.0%} of the samples"
            )
        panel.plot(t, values[0], color="black", linewidth=1.3, linestyle="--", label="SPEC")
        over_time(panel, f"error of {row.name} ({row.unit})")
    band = study.plan.sweep.band
    axes[0].axhspan(
        -band, band, color=COLOURS[2], alpha=0.18, linewidth=0, label=f"band ± {band:g} {row.unit}"
    )
    axes[1].axhline(band, color=COLOURS[2], linewidth=1.2, label=f"band {band:g} {row.unit}")
    axes[1].set_yscale("log")
    axes[1].set_ylabel(f"|error of {row.name}| ({row.unit})")
    size = np.abs(errors[np.isfinite(errors)])
    axes[1].set_ylim(max(1e-9, np.quantile(size, 0.01) / 2), size.max() * 1.5)
    axes[0].set_title(f"{row.name}, the first {len(table)} samples, while they run", loc="left")
    axes[1].set_title("absolute value", loc="left")
    axes[0].legend(loc="best")
    return figure


def _cloud(report: SweepReport) -> matplotlib.figure.Figure:
    """The first limited outcome against each number, those that the rank correlations name first."""
    study = report.study
    outcome = next(iter(study.criterion.limits), study.shown[0])
    ranks = report.summary.ranks.get(outcome, {})
    names = sorted(study.plan.names, key=lambda name: -abs(ranks.get(name, 0.0)))[:MOST]
    found = open_sweep(report.output)[0]
    part = next(found.iter_batches(batch_size=POINTS, columns=[*names, outcome, "status", "failed"]))
    values = {name: part[name].to_numpy(zero_copy_only=False) for name in part.schema.names}
    size, ended = np.abs(values[outcome]), np.isin(values["status"], ENDED)
    nominal = study.batch.run(_nominal(study))[0]
    here = abs(nominal[study.batch.outcomes.index(outcome)])
    rows = -(-len(names) // COLUMNS)
    figure = matplotlib.figure.Figure(figsize=(12.0, 1.2 + 3.4 * rows), layout="constrained")
    axes = figure.subplots(rows, min(COLUMNS, len(names)), squeeze=False, sharey=True).ravel()
    decades = size[ended & (size > 0)]
    logarithmic = len(decades) > 0 and np.quantile(decades, 0.99) > 30 * np.quantile(decades, 0.01)
    unit = _unit(study, outcome)
    for panel, name in zip(axes, names, strict=False):
        groups = (
            (ended & ~values["failed"], FAINT, 7, 0.45, "within the limits"),
            (ended & values["failed"], COLOURS[1], 9, 0.7, "fails"),
            (~ended, STOP, 22, 1.0, "stopped early"),
        )
        for which, colour, s, alpha, label in groups:
            if which.any():
                style = {
                    "s": s,
                    "alpha": alpha,
                    "linewidth": 0,
                    "color": colour,
                    "label": label,
                    "rasterized": True,
                }
                panel.scatter(values[name][which], size[which], **style)
        _draw_median(panel, values[name][ended], size[ended])
        panel.scatter(study.batch.nominal[name], here, label="SPEC", **NOMINAL)
        if outcome in study.criterion.limits:
            panel.axhline(
                study.criterion.limits[outcome], color=STOP, linewidth=1.0, linestyle=":", label="limit"
            )
        if logarithmic:
            panel.set_yscale("log")
        else:
            panel.set_ylim(bottom=0.0)
        if study.plan.margins[name].kind == "log_uniform":
            panel.set_xscale("log")
            low, high = study.plan.margins[name].quantile(np.array([0.0, 1.0]))
            panel.set_xticks(np.geomspace(low, high, 5))
            panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.2g}"))
            panel.xaxis.set_minor_locator(NullLocator())
        rank = f": rank correlation {ranks[name]:+.2f}" if name in ranks else ""
        panel.set_title(f"{name}{rank}", loc="left")
        panel.set_xlabel(f"{name}{_input_unit(study, name)}")
    for panel in axes[: len(names) : COLUMNS]:
        panel.set_ylabel(f"|{outcome}| ({unit})" if unit else f"|{outcome}|")
    for panel in axes[len(names) :]:
        panel.set_axis_off()
    named = {
        label: handle
        for panel in axes
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True)
    }
    figure.legend(named.values(), named.keys(), loc="outside lower center", ncols=len(named), markerscale=1.6)
    return figure


def _draw_median(panel: Axes, x: np.ndarray, y: np.ndarray) -> None:
    if len(x) < 2 * BINS:
        return
    groups = np.array_split(np.argsort(x), BINS)
    middle = [(np.median(x[group]), np.median(y[group])) for group in groups]
    panel.plot(*np.transpose(middle), color=COLOURS[0], linewidth=2.0, label="median")


def _start_axes(study: Study) -> dict[str, tuple[float, float]]:
    """Heading and the place that varies, or the two numbers of the start that do: names and ranges;
    none without either."""
    nominal, varies = study.batch.nominal, study.plan.names
    known = [f"initial.{name}" for name in REACH if f"initial.{name}" in nominal]
    if known:
        places = sorted(known[1:], key=lambda name: name not in varies)
        names = [known[0], places[0]]
        return {
            name: (nominal[name] - reach, nominal[name] + reach)
            for name in names
            for reach in [REACH[name[8:]]]
        }
    names = [name for name in varies if name.startswith("initial.")][:2]
    if len(names) < 2:
        return {}
    return {name: tuple(study.plan.margins[name].quantile(np.array(EDGES)).tolist()) for name in names}


def _starts(
    report: SweepReport, ranges: dict[str, tuple[float, float]], jobs: int
) -> matplotlib.figure.Figure:
    """When a run from each start becomes singular, all else as in the SPEC; and where the samples start."""
    study = report.study
    x, y, (status, t_end) = _on_grid(study, ranges, jobs, "status", "t_end")
    names = np.array([study.batch.status(number) for number in status.ravel()]).reshape(status.shape)
    figure = matplotlib.figure.Figure(figsize=(9.5, 5.6), layout="constrained")
    axes = figure.subplots()
    ended = np.isin(names, ENDED)
    groups = (
        ("runs to the end", ended, "#dfeade"),
        ("stops for another reason", ~ended & (names != "singular"), "#b9b9b9"),
    )
    for label, which, colour in groups:
        if which.any():
            shown = np.ma.masked_where(~which, np.ones(which.shape))
            axes.pcolormesh(x, y, shown, cmap=ListedColormap([colour]), shading="nearest", rasterized=True)
            axes.scatter([], [], s=90, marker="s", color=colour, label=label)
    singular = np.ma.masked_where(names != "singular", t_end)
    if singular.count():
        drawn = axes.pcolormesh(x, y, singular, cmap="YlOrRd_r", vmin=0.0, shading="nearest", rasterized=True)
        figure.colorbar(drawn, ax=axes, label="time when the run becomes singular (s); 0: at its start")
        axes.scatter([], [], s=90, marker="s", color=drawn.cmap(0.3), label="becomes singular")
    _finish_map(figure, report, ranges)
    axes.set_title(
        f"{np.mean(names == 'singular'):.1%} of {names.size} starts shown become singular", loc="left"
    )
    return figure


def _rolling(
    report: SweepReport, ranges: dict[str, tuple[float, float]], jobs: int
) -> matplotlib.figure.Figure:
    """The largest friction use of a run from each start, all else as in the SPEC;
    and where the samples start."""
    x, y, (use, t_end) = _on_grid(report.study, ranges, jobs, "use", "t_end")
    use = np.ma.masked_where(t_end <= 0.0, use)
    figure = matplotlib.figure.Figure(figsize=(9.5, 5.6), layout="constrained")
    axes = figure.subplots()
    shown, steps = np.ma.minimum(use, 0.999 * USES[-1]), BoundaryNorm(USES, 256)
    drawn = axes.pcolormesh(x, y, shown, cmap="RdYlGn_r", norm=steps, shading="nearest", rasterized=True)
    if np.any(t_end <= 0.0):
        axes.set_facecolor("#b9b9b9")
        axes.scatter([], [], s=90, marker="s", color="#b9b9b9", label="stops at its start")
    figure.colorbar(
        drawn, ax=axes, ticks=USES, label=f"largest friction use, at most {USES[-1]:g}; above 1 a wheel slips"
    )
    if use.min() < 1.0 < use.max():
        axes.contour(x, y, use, levels=[1.0], colors="black", linewidths=1.2)
        axes.plot([], [], color="black", linewidth=1.2, label="friction use 1")
    _finish_map(figure, report, ranges)
    axes.set_title(f"{np.sum(use <= 1.0) / use.size:.1%} of {use.size} starts shown keep rolling", loc="left")
    return figure


def _on_grid(
    study: Study, ranges: dict[str, tuple[float, float]], jobs: int, *outcomes: str
) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Return the grid of a map of starts, and these outcomes of the runs from there."""
    (one, other), (x, y) = ranges, (np.linspace(*r, n) for r, n in zip(ranges.values(), GRID, strict=True))
    grid = np.meshgrid(x, y)
    table = study.plan.inputs.table({one: grid[0].ravel(), other: grid[1].ravel()}, grid[0].size)
    found = run_table(study, table, jobs)
    return x, y, [found[:, study.batch.outcomes.index(name)].reshape(grid[0].shape) for name in outcomes]


def _finish_map(
    figure: matplotlib.figure.Figure, report: SweepReport, ranges: dict[str, tuple[float, float]]
) -> None:
    """Draw samples and the SPEC's own start into a map of starts, and label it."""
    study, axes, (one, other) = report.study, figure.axes[0], ranges
    _draw_samples(axes, report, one, other)
    axes.scatter(study.batch.nominal[one], study.batch.nominal[other], label="SPEC", **NOMINAL)
    axes.set(xlabel=f"{one}{_input_unit(study, one)}", ylabel=f"{other}{_input_unit(study, other)}")
    axes.set(xlim=ranges[one], ylim=ranges[other])
    axes.grid(False)
    figure.legend(loc="outside lower center", ncols=6)


def _draw_samples(axes: Axes, report: SweepReport, one: str, other: str) -> None:
    """The starts of some samples, those that stopped crossed."""
    study = report.study
    varies = [name for name in (one, other) if name in study.plan.names]
    if not varies:
        return
    part = next(open_sweep(report.output)[0].iter_batches(batch_size=STARTS, columns=[*varies, "status"]))
    x, y = (
        part[n].to_numpy() if n in varies else np.full(len(part), study.batch.nominal[n])
        for n in (one, other)
    )
    stopped = ~np.isin(part["status"].to_numpy(zero_copy_only=False), ENDED)
    axes.scatter(
        x[~stopped],
        y[~stopped],
        s=7,
        color="#33506b",
        alpha=0.7,
        linewidth=0,
        label="samples",
        rasterized=True,
    )
    if stopped.any():
        axes.scatter(
            x[stopped], y[stopped], s=30, marker="x", color="black", linewidth=1.2, label="samples that stop"
        )


def _nominal(study: Study) -> np.ndarray:
    """The row of the SPEC itself."""
    return study.plan.inputs.table({}, 1)


def _unit(study: Study, outcome: str) -> str:
    kind, _, row = outcome.partition(".")
    if kind in ("settling", "saturated"):
        return "s"
    known: list[OutputRow | Quantity] = [*study.batch.law.output.rows, *study.batch.law.state]
    units = {each.name: each.unit for each in known}
    return units.get(row.partition("[")[0], "")


def _input_unit(study: Study, name: str) -> str:
    """Unit of a number that varies, in brackets, where it is known."""
    section, _, last = name.partition(".")
    known = {
        "heading": "rad",
        "point[0]": "m",
        "point[1]": "m",
        "speed": "m/s",
        "L": "m",
        "period": "s",
        "delay": "s",
    }
    if section in ("plant", "parameters"):
        known = {q.name: q.unit for q in study.batch.law.parameters}
    found = known.get(last, "")
    return f" ({found})" if found else ""
