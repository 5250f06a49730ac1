"""Plots of planned paths."""

import itertools
import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...model.segments import Segment
from .chain import Pose
from .course import SmoothCurve

LINE, LEFT, RIGHT, CUSP, GIVEN, VEHICLE = "#444444", "#0b61a4", "#c2570c", "#c00000", "#2e8b57", "#333333"
BEND = 0.05  # rad between plotted points of an arc
PLACES = 600  # plotted points of a course
SIZE = 0.07  # length of a drawn vehicle, relative to the plot


def draw(segments: Sequence[Segment], title: str, waypoints: Sequence[Sequence[float]] = ()) -> Figure:
    """Return a plot of a path; `waypoints` (x, y) in m are marked."""
    figure = Figure(figsize=(9, 7.5), layout="constrained")
    axes = figure.add_subplot()
    for segment in segments:
        colour, name = _look(segment)
        angle = abs(segment.curvature * segment.length)
        places = np.transpose(segment.places(2 + math.ceil(angle / BEND)))
        axes.plot(
            *places, color=colour, linestyle="--" if segment.backward else "-", linewidth=2.2, label=name
        )
    joins = np.array([segment.end[:2] for segment in segments[:-1]]).reshape(-1, 2)
    axes.plot(*joins.T, "o", color="black", markersize=4, linestyle="", label="join", zorder=3)
    cusps = [after for before, after in itertools.pairwise(segments) if before.backward != after.backward]
    if cusps:
        places = np.array([(segment.x, segment.y) for segment in cusps])
        axes.plot(*places.T, "X", color=CUSP, markersize=10, linestyle="", label="cusp", zorder=4)
    if len(waypoints):
        axes.plot(
            *np.transpose(waypoints),
            "o",
            color=GIVEN,
            markersize=5,
            fillstyle="none",
            linestyle="",
            label="waypoint",
        )
    first, last = segments[0], segments[-1]
    _finish_plane(axes, (first.x, first.y, first.heading), last.end, (first.backward, last.backward))
    axes.set_title(title, fontsize=11)
    _legend(figure, axes)
    return figure


def draw_course(course: SmoothCurve, title: str, points: Sequence[Sequence[float]]) -> Figure:
    """Return a plot of a course beside the `points` (x, y) in m that it was fitted to, if any, and its
    curvature over the length: that of the vehicle, which at a cusp is the same on both sides.
    """
    figure = Figure(figsize=(13, 6.5), layout="constrained")
    plane, bend = figure.subplots(1, 2)
    ends = np.concatenate([[0.0], np.cumsum(np.abs(course.lengths))])
    joins = np.array([course.position(float(s)) for s in ends])
    begin, backward = 0.0, []
    for piece in course.pieces:
        at = np.linspace(0.0, piece.way, 2 + int(PLACES * piece.way / ends[-1]))
        places = np.array([piece.position(float(s)) for s in at])
        backward.append(piece.stretches[0].backward)
        colour, style, name = (RIGHT, "--", "course, backward") if backward[-1] else (LEFT, "-", "course")
        plane.plot(places.real, places.imag, color=colour, linestyle=style, linewidth=2.2, label=name)
        bends = np.array([piece.bend(float(s)) for s in at]) * (-1.0 if backward[-1] else 1.0)
        bend.plot(begin + at, bends, color=colour, linestyle=style, linewidth=1.8)
        begin += piece.way
    plane.plot(
        joins.real,
        joins.imag,
        "o",
        color="black",
        markersize=4,
        linestyle="",
        label="end of a part",
        zorder=3,
    )
    if len(points):
        plane.plot(
            *np.transpose(points),
            "o",
            color=GIVEN,
            markersize=6,
            fillstyle="none",
            linestyle="",
            label="waypoint",
            zorder=4,
        )
    last = course.pieces[-1]
    way = last.stretches[-1].begin if not course.rounding else last.way
    finish = (joins[-1].real, joins[-1].imag, last.direction(way))
    _finish_plane(plane, (course.x, course.y, course.direction(0.0)), finish, (backward[0], backward[-1]))
    bend.plot(ends, course.curvatures, "o", color="black", markersize=4)
    bend.set(xlabel="length along the course (m)", ylabel="curvature, positive to the left (1/m)")
    bend.grid(alpha=0.3)
    figure.suptitle(title, fontsize=11)
    _legend(figure, plane)
    return figure


def _finish_plane(axes: Axes, begin: Pose, end: Pose, backward: tuple[bool, bool] = (False, False)) -> None:
    """Set up the plane, and draw the vehicle at the first and last directions of travel."""
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.1)
    size = SIZE * max(np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim()))
    comes_home = math.dist(begin[:2], end[:2]) < size
    _draw_vehicle(axes, begin, backward[0], size, "start, goal" if comes_home else "start", 0.5)
    _draw_vehicle(axes, end, backward[1], size, "" if comes_home else "goal", 0.15)
    axes.set(xlabel="x (m)", ylabel="y (m)")
    axes.grid(alpha=0.3)


def _legend(figure: Figure, axes: Axes) -> None:
    """Add a legend below all panels, with each kind once."""
    named = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    figure.legend(
        named.values(), named.keys(), loc="outside lower center", ncols=5, fontsize=9, frameon=False
    )


def _look(segment: Segment) -> tuple[str, str]:
    """Return colour and name of a segment's kind."""
    way = ", backward" if segment.backward else ""
    if not segment.curvature:
        return LINE, f"line{way}"
    return (LEFT, f"turning left{way}") if segment.curvature > 0 else (RIGHT, f"turning right{way}")


def _draw_vehicle(
    axes: Axes, travel: tuple[float, float, float], backward: bool, size: float, name: str, alpha: float
) -> None:
    """Draw a pointed box at a pose, with its tip in the direction of the vehicle's heading."""
    x, y, heading = travel
    ahead = np.exp(1j * (heading + math.pi * backward))
    outline = np.array([-0.5 - 0.3j, 0.2 - 0.3j, 0.5, 0.2 + 0.3j, -0.5 + 0.3j]) * size * ahead + complex(x, y)
    axes.fill(outline.real, outline.imag, facecolor=VEHICLE, alpha=alpha, edgecolor="none", zorder=3)
    axes.fill(outline.real, outline.imag, facecolor="none", edgecolor=VEHICLE, linewidth=1.2, zorder=3)
    axes.text(x, y + 0.6 * size, name, ha="center", fontsize=10, zorder=5)
