"""Common style of the figures: planes with equal scales, time axes, colours, and a note of assumptions."""

import csv
import io
import textwrap
from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from typing import Any

import casadi as ca
import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.container import BarContainer
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.legend import Legend
from matplotlib.patches import Circle, Patch, Rectangle
from matplotlib.transforms import ScaledTranslation

from ..model.drawing import box
from ..model.law import symbols
from ..model.mechanism import Mechanism
from ..model.outputs import OutputMap
from ..readers.files import MARK
from .specification.floor import Floor

DESIRED, STOP, FAINT = "#9a9a9a", "#c00000", "#666666"
COLOURS = ("#0b61a4", "#c2570c", "#2e8b57", "#8a4fa3", "#b8860b", "#16808c", "#a63a50", "#4d4d4d")
WIDEST = 190  # characters per line of the assumptions
BELOW = 0.45  # inches from the edge of a panel to what is below its label
METADATA = {"png": {"Software": MARK}, "svg": {"Date": None, "Creator": MARK}}  # the same bytes at every run
STYLE = matplotlib.RcParams(
    {
        "svg.hashsalt": "noslip",
        "figure.autolayout": False,
        "figure.constrained_layout.use": False,
        "font.size": 9.5,
        "axes.titlesize": 10.5,
        "axes.grid": True,
        "grid.alpha": 0.3,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "legend.frameon": False,
        "legend.fontsize": 9,
        "lines.linewidth": 1.6,
    }
)


def panels(
    *titles: str, height: float = 4.6, widths: Iterable[float] = (), most: int | None = None
) -> tuple[Figure, np.ndarray]:
    """Return a figure with a panel for each title, and the panels: in one row,
    or in rows of at most so many."""
    # inches: equal scales may widen the labels of an axis after the layout
    layout = ConstrainedLayoutEngine(w_pad=0.08)
    columns = min(most or len(titles), len(titles))
    rows = -(-len(titles) // columns)
    figure = Figure(figsize=(12.0, rows * height), layout=layout)
    axes = figure.subplots(rows, columns, squeeze=False, width_ratios=tuple(widths) or None).ravel()
    for panel in axes[len(titles) :]:
        panel.remove()
    axes = axes[: len(titles)]
    for panel, title in zip(axes, titles, strict=True):
        panel.set_title(title, loc="left")
    return figure, axes


def plane(axes: Axes, *points: np.ndarray, room: float = 0.06) -> None:
    """Set up axes of the plane in m, with equal scales and `points` (N, 2) in view; the size of the panel is
    kept. Call this last.
    """
    low, high = (
        np.min([p.min(axis=0) for p in points], axis=0),
        np.max([p.max(axis=0) for p in points], axis=0),
    )
    more = room * (high - low).max()
    axes.set_xlim(low[0] - more, high[0] + more, auto=True)  # auto: matplotlib may widen one of them
    axes.set_ylim(low[1] - more, high[1] + more, auto=True)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="x (m)", ylabel="y (m)")


def over_time(axes: Axes, quantity: str) -> None:
    """Set up axes of a quantity over time."""
    axes.set(xlabel="time t (s)", ylabel=quantity)
    axes.margins(x=0.01)


def start(axes: Axes, place: np.ndarray, label: str | None = "start") -> None:
    """Mark the start of a run by a ring, which hides nothing."""
    ring: dict[str, Any] = {
        "markersize": 9,
        "markerfacecolor": "none",
        "markeredgecolor": "black",
        "markeredgewidth": 1.5,
    }
    axes.plot(*place, "o", color="none", label=label, zorder=5, **ring)


def to_follow(axes: Axes, x: np.ndarray, y: np.ndarray, label: str | None = "path to follow") -> None:
    """Draw the desired path, wide and grey, behind the runs."""
    axes.plot(x, y, color=DESIRED, linewidth=5, alpha=0.45, solid_capstyle="round", label=label, zorder=0)


def legend_on_top(axes: Axes) -> Legend:
    """Put the legend into a panel in one row, above the curves, for which the axis is made longer."""
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.35 * (high - low))
    return axes.legend(loc="upper center", ncols=len(axes.get_lines()), fontsize=9)


def legend_below(axes: Axes, ncols: int = 1, **options: Any) -> Legend:
    """Put the legend below a panel and its label, where it covers no curve; the layout makes room for it."""
    assert axes.figure, "a panel of a figure"
    below = axes.transAxes + ScaledTranslation(0, -BELOW, axes.figure.dpi_scale_trans)
    return axes.legend(
        loc="upper center", bbox_to_anchor=(0.5, 0), bbox_transform=below, ncols=ncols, **options
    )


def draw_floor(axes: Axes, floor: Floor) -> None:
    """Draw patches and bumps of a floor, seen from above, behind the runs; they do not change the view."""
    shapes: list[Patch] = [
        Rectangle(
            (p.x[0], p.y[0]),
            p.x[1] - p.x[0],
            p.y[1] - p.y[0],
            label=f"\u03bc {p.mu:g}",
            facecolor="#7fb2d9",
            alpha=0.35,
        )
        for p in floor.patch
    ]
    shapes += [
        Circle((b.x, b.y), b.radius, label="bumps" if k == 0 else None, facecolor="#b59a6a", alpha=0.35)
        for k, b in enumerate(floor.bumps)
    ]
    for shape in shapes:
        shape.set(zorder=0, linewidth=0)
        axes.add_artist(shape)


def at_times(axes: Axes, times: np.ndarray, places: np.ndarray, away: np.ndarray) -> None:
    """Write times (N,), s, beside places (N, 2), each on the side to which `away` (N, 2) points."""
    for t, place, (dx, dy) in zip(times, places, away, strict=True):
        side: dict[str, Any] = {"ha": "left" if dx > 0.3 else "right" if dx < -0.3 else "center"}
        side |= {"va": "bottom" if dy > 0.3 else "top" if dy < -0.3 else "center"}
        axes.annotate(
            f"{t:.3g} s", place, (7 * dx, 7 * dy), textcoords="offset points", fontsize=9, color=FAINT, **side
        )


def zoom(axes: Axes, place: tuple[float, float, float, float], around: np.ndarray, half: float) -> Axes:
    """Return a magnified view at `place` (x, y, width, height,
    relative to the panel) of 2 `half` m about a point."""
    inset = axes.inset_axes(place)
    inset.set(
        xlim=(around[0] - half, around[0] + half),
        ylim=(around[1] - half, around[1] + half),
        aspect="equal",
        autoscale_on=False,
    )
    inset.tick_params(labelsize=7)
    inset.locator_params(nbins=4)
    inset.spines[:].set(visible=True, color=FAINT)
    axes.indicate_inset_zoom(inset, edgecolor=FAINT, alpha=0.8)
    return inset


def say(axes: Axes, text: str, place: tuple[float, float], colour: str = FAINT, **options) -> None:
    """Write a note inside a panel, at `place` relative to it."""
    axes.text(*place, text, transform=axes.transAxes, color=colour, fontsize=9, **options)


def pictures(draw: Callable[[], Figure], title: str, assumed: str) -> dict[str, bytes]:
    """Return the figure drawn by `draw` as the bytes of a png and of an svg file, with a title and a note of
    assumptions, and its data as those of a csv file (`plotted`)."""
    with matplotlib.rc_context(STYLE):
        figure = draw()
        figure.suptitle(title, fontsize=12, fontweight="bold", x=0.01, ha="left")
        if assumed:
            text = textwrap.fill(f"Assumed, illegible in the scan: {assumed}", WIDEST)
            figure.supxlabel(text, fontsize=8, color=FAINT, x=0.01, ha="left")
        _freeze(figure)
        return with_data(figure, *METADATA)


def with_data(figure: Figure, *kinds: str) -> dict[str, bytes]:
    """Return a figure as the bytes of files of these kinds (`encoded`),
    and its data as those of a csv file (`plotted`)."""
    return {kind: encoded(figure, kind) for kind in kinds} | {"csv": plotted(figure).encode()}


def plotted(figure: Figure) -> str:
    """Return the points of all curves, markers and bars of a figure as CSV after a comment: panel, its
    labels, the curve's label, x, y.

    What has no label in the figure has none here; each has a number of its own in its panel.
    """
    text = io.StringIO()
    text.write(f"# {MARK}\n")
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(("panel", "number", "curve", "x_label", "y_label", "x", "y"))
    for axes in figure.axes:
        for number, (label, points) in enumerate(_curves(axes)):
            name = "" if label.startswith("_") else label
            head = (axes.get_title(loc="left"), number, name, axes.get_xlabel(), axes.get_ylabel())
            rows.writerows((*head, f"{x:.9g}", f"{y:.9g}") for x, y in points)
    return text.getvalue()


def _curves(axes: Axes) -> Iterator[tuple[str, np.ndarray]]:
    """Yield label and points (N, 2) of each line, scatter and group of bars."""
    for line in axes.lines:
        points = np.array(line.get_xydata(), float)
        if line.get_transform() == axes.transData and len(points):
            yield str(line.get_label()), points
    for scatter in axes.collections:
        if isinstance(scatter, PathCollection):
            yield str(scatter.get_label()), np.ma.filled(scatter.get_offsets(), np.nan)
    for bars in axes.containers:
        if isinstance(bars, BarContainer):
            # Its end lies in the middle of one side
            share = (1.0, 0.5) if bars.orientation == "horizontal" else (0.5, 1.0)
            boxes = [bar.get_bbox() for bar in bars]
            yield str(bars.get_label()), np.array([box.min + share * box.size for box in boxes])


def outlines(robot: Mechanism, q: np.ndarray, parameters: np.ndarray) -> list[np.ndarray]:
    """Return the lines that show a robot from above at coordinates q (N, n): each (N, points, 2), m. See
    `Mechanism.draws`.

    A vehicle without lines is drawn as a small box.
    """
    return [line.full().T.reshape(len(q), -1, 2) for line in lines_function(robot).call([q.T, parameters])]


@lru_cache(maxsize=16)
def lines_function(robot: Mechanism) -> ca.Function:
    """Return the function of coordinates and parameters to the lines of `outlines`, each as one column."""
    lines, vehicle = list(robot.lines), robot.vehicle
    if not lines and vehicle:
        small = box((vehicle.x, vehicle.y), vehicle.heading, 0.5, 0.5, 0.25)
        lines = [ca.horzcat(*[ca.vertcat(*point) for point in small])]
    return ca.Function("lines", [robot.q, robot.p], [ca.densify(ca.vec(line)) for line in lines])


def implicit_path(output: OutputMap) -> ca.Function:
    """Return the function of points (x, y) and the output's parameters to signed distance from the path,
    m, and nearest point."""
    point = ca.SX.sym("point", 2)
    distance = output.required_path.distance(point[0], point[1])
    foot = point - distance * ca.gradient(distance, point)
    return ca.Function("path", [point, symbols(output.parameters)], [distance, foot])


def draw_implicit(
    axes: Axes,
    function: ca.Function,
    config: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    label: str,
    **style: Any,
) -> None:
    """Draw the curve on which the distance of an `implicit_path` is zero, on a grid x, y, m."""
    places = np.meshgrid(x, y)
    values = (
        function(np.vstack([place.ravel() for place in places]), config)[0].full().reshape(places[0].shape)
    )
    axes.contour(
        *places,
        values,
        [0.0],
        colors=style["color"],
        linewidths=style["linewidth"],
        alpha=style["alpha"],
        zorder=0,
    )
    axes.plot([], [], label=label, **style)


def is_outline(line: np.ndarray) -> bool:
    """Return whether the line (points, 2) is closed."""
    return len(line) > 2 and bool(np.allclose(line[0], line[-1]))


def evenly_spread(points: np.ndarray, count: int) -> np.ndarray:
    """Return indices of points (N, 2) at about equal distances along the curve through them."""
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    return np.searchsorted(way, np.linspace(0.0, way[-1], count)).clip(max=len(way) - 1)


def _freeze(figure: Figure) -> None:
    """Compute the layout once and round it: the solver's last bits vary,
    and SVG derives names of clip paths from them."""
    if engine := figure.get_layout_engine():
        for _ in range(2):  # as in `encoded`
            engine.execute(figure)
    figure.set_layout_engine(None)  # not "none": with that each file would be drawn twice
    for axes in figure.axes:
        axes.set_position(np.round(axes.get_position(original=True).bounds, 6))


def encoded(figure: Figure, kind: str) -> bytes:
    """Return a figure as the bytes of a file; `kind` is png, svg or pdf."""
    made = io.BytesIO()
    if figure.get_layout_engine():
        # Once more: equal scales change the ticks for which the first layout makes room
        figure.draw_without_rendering()
    figure.savefig(made, format=kind, dpi=130, metadata=METADATA.get(kind))
    return made.getvalue()
