"""A film of a run from above, in the time of the run."""

from __future__ import annotations

import json
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.animation import FFMpegWriter, FuncAnimation, PillowWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...readers.errors import BadInput
from ...readers.templates import render
from ..drawing import DESIRED, draw_floor, implicit_path, is_outline, outlines
from ..engine.measured import SLIPS
from ..guidance import vehicle_motion
from ..plot import are_places
from ..run import Run

RATE = 20  # pictures a second, of the run and of the film
AROUND = 3.0  # m on each side of the vehicle, at least
# Points in each direction of the grid on which an implicit path is traced; points of a segment
GRID, PIECE = 200, 60
SLIPPING, WAY, BODY = "#c00000", "#0b61a4", "#333333"
NEARLY = 1e-9  # s: times of rows that are the same but for rounding
WRITERS: dict[str, Any] = {".gif": PillowWriter, ".mp4": FFMpegWriter}
KINDS = (*WRITERS, ".html")


@dataclass(frozen=True)
class Film:
    """What a film shows: F frames of a run.

    `t`: (F,), s. `lines`: the lines of the robot, each (F, points, 2), m. `way`: the vehicle's point, or the
    robot's first two outputs where it is no vehicle and they are a place, (F, 2), m; else (0, 2). `path`:
    curves to follow, each (points, 2), m. `slip`: the largest of the contacts, (F,), m/s; None where the
    robot rolls. `view`: half the side of the view that follows the vehicle, m; 0: the view stands still and
    holds everything.
    """

    title: str
    t: np.ndarray
    lines: list[np.ndarray]
    way: np.ndarray
    path: list[np.ndarray]
    slip: np.ndarray | None
    view: float

    def box(self) -> tuple[float, float, float]:
        """Return the middle (x, y) and half the side of a square that holds everything, m."""
        points = np.vstack([self.way, *self.path, *[line.reshape(-1, 2) for line in self.lines]])
        low, high = points.min(axis=0), points.max(axis=0)
        x, y = (low + high) / 2
        return float(x), float(y), float(0.55 * (high - low).max())


def check_film(suffix: str) -> None:
    """Raise BadInput for a kind of film that cannot be written."""
    if suffix not in KINDS:
        raise BadInput(f"--animate: {suffix or 'no ending'!r} is not {', '.join(KINDS[:-1])} or {KINDS[-1]}")
    if suffix in WRITERS and not WRITERS[suffix].isAvailable():
        raise BadInput(f"--animate: {suffix} needs ffmpeg; install it, or write a .gif or .html")


def film(run: Run, suffix: str) -> bytes:
    """Return the film as the bytes of a file with this ending. On a floor it says the slip, and the robot is
    red where it slips.

    A .html is one page that needs nothing else, with a bar to move through the time. Raises BadInput as
    `check_film`, and for a robot that has nothing to draw.
    """
    check_film(suffix)
    frames = film_of(run)
    return _page(frames) if suffix == ".html" else _pictures(run, frames, suffix)


def film_of(run: Run) -> Film:
    """Return the frames of a run. Raises BadInput for a robot that has nothing to draw."""
    mechanism = run.law.system.mechanism
    if not (mechanism.lines or mechanism.vehicle):
        raise BadInput(
            f"--animate: {mechanism.name} has no lines to draw (Mechanism.draws) and is no vehicle "
            "(moves_in_plane)"
        )
    instants = np.searchsorted(run.t, np.arange(0.0, run.t[-1] + NEARLY, 1 / RATE) - NEARLY).clip(
        max=len(run.t) - 1
    )
    lines = outlines(mechanism, run.q[instants], run.plant.parameters)
    if mechanism.vehicle:
        way = vehicle_motion(run.law.system)(run.x[instants].T, run.plant.parameters).full()[:2].T
    else:
        way = run.y[instants, :2] if are_places(run) else np.zeros((0, 2))
    slip = run.floor.slip[instants].max(axis=1) if run.floor else None
    title = f"{mechanism.name}: {run.law.output.about}"
    view = (
        max(AROUND, 1.2 * max(np.abs(line - way[:, None]).max() for line in lines))
        if mechanism.vehicle
        else 0.0
    )
    return Film(title, run.t[instants], lines, way, _paths(run, way), slip, view)


def _paths(run: Run, way: np.ndarray) -> list[np.ndarray]:
    """Return the curves of the path to follow as far as the run is near them, or of the desired point;
    none for other outputs."""
    if run.composite:
        return [np.transpose(piece.places(PIECE)) for piece in run.spec.output.segments]
    desired = run.spec.output.type == "I" or (run.spec.feedback and are_places(run))
    if desired or (len(way) and not run.law.system.mechanism.vehicle):
        return [run.y_d[:, :2]]
    if not run.law.output.path:
        return []
    low, high = way.min(axis=0) - AROUND, way.max(axis=0) + AROUND
    x, y = (np.linspace(*ends, GRID) for ends in zip(low, high, strict=True))
    places = np.meshgrid(x, y)
    distance = implicit_path(run.law.output)(np.vstack([place.ravel() for place in places]), run.config[0])[
        0
    ].full()
    contour = Figure().subplots().contour(*places, distance.reshape(GRID, GRID), [0.0])
    return [line for line in contour.allsegs[0] if len(line) > 1]


def _pictures(run: Run, frames: Film, suffix: str) -> bytes:
    """Return the film as pictures."""
    figure = Figure(figsize=(5, 5), layout="constrained")
    axes = figure.subplots()
    axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
    axes.grid(alpha=0.3)
    if run.floor and run.spec.floor:
        draw_floor(axes, run.spec.floor)
    for curve in frames.path:
        axes.plot(*curve.T, color=DESIRED, linewidth=5, alpha=0.45, zorder=0)
    (way,) = axes.plot([], [], color=WAY, linewidth=1.5)
    robot = [
        axes.plot([], [], color=BODY, linewidth=1.0 if is_outline(line[0]) else 4.0)[0]
        for line in frames.lines
    ]
    _look(axes, *frames.box())

    def show(k: int) -> list:
        slip = 0.0 if frames.slip is None else frames.slip[k]
        way.set_data(*frames.way[: k + 1].T)
        for artist, line in zip(robot, frames.lines, strict=True):
            artist.set_data(*line[k].T)
            artist.set_color(SLIPPING if slip > SLIPS else BODY)
        if frames.view:
            x, y = frames.way[k]
            _look(axes, x, y, frames.view)
        axes.set_title(
            f"t = {frames.t[k]:.2f} s" + ("" if frames.slip is None else f", slip {slip:.2f} m/s"),
            fontsize=10,
        )
        return robot

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, f"film{suffix}")
        made = FuncAnimation(figure, show, frames=len(frames.t), cache_frame_data=False)
        made.save(file, WRITERS[suffix](fps=RATE), dpi=80)
        return file.read_bytes()


def _look(axes: Axes, x: float, y: float, half: float) -> None:
    axes.set(xlim=(x - half, x + half), ylim=(y - half, y + half))


def _page(frames: Film) -> bytes:
    """Return the film as a page, with places in mm."""

    def rounded(values: np.ndarray) -> list:
        return np.rint(1000 * values).astype(int).tolist()

    data = {
        "rate": RATE,
        "t": np.round(frames.t, 6).tolist(),
        "lines": [
            {"closed": is_outline(line[0]), "at": rounded(line.reshape(len(line), -1))}
            for line in frames.lines
        ],
        "way": rounded(frames.way),
        "path": [rounded(curve) for curve in frames.path],
        "slip": None if frames.slip is None else np.round(frames.slip, 4).tolist(),
        "slips": SLIPS,
        "view": rounded(np.array([frames.view or frames.box()[2]]))[0],
        "middle": None if frames.view else rounded(np.array(frames.box()[:2])),
    }
    shown = json.dumps(data, separators=(",", ":"))
    slips, above = frames.slip is not None, frames.view > 0
    return render(__file__, "film.html", title=frames.title, slips=slips, above=above, data=shown).encode()
