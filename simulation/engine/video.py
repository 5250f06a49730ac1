"""A film of a run from above, in the time of the run."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.animation import FFMpegWriter, FuncAnimation, PillowWriter
from matplotlib.figure import Figure

from ...readers.errors import BadInput
from ..drawing import draw_floor, is_outline, outlines
from ..guidance import vehicle_motion
from ..run import Run
from .measured import SLIPS

RATE = 20  # pictures a second, of the run and of the film
AROUND = 3.0  # m on each side of the vehicle
WRITERS: dict[str, Any] = {".gif": PillowWriter, ".mp4": FFMpegWriter}


def check_video(suffix: str) -> None:
    """Raise BadInput for a kind of film that cannot be written."""
    if suffix not in WRITERS:
        raise BadInput(f"--video: {suffix or 'no ending'!r} is not .gif or .mp4")
    if not WRITERS[suffix].isAvailable():
        raise BadInput(f"--video: {suffix} needs ffmpeg; install it, or write a .gif")


def video(run: Run, suffix: str) -> bytes:
    """Return the film as the bytes of a file with this ending; the view follows the vehicle. On a floor its title says the slip.

    Raises BadInput as `check_video`, and for a robot that is not a vehicle.
    """
    check_video(suffix)
    mechanism = run.law.system.mechanism
    if mechanism.vehicle is None:
        raise BadInput(f"--video: {mechanism.name} is not a vehicle (moves_in_plane)")
    instants = np.searchsorted(run.t, np.arange(0.0, run.t[-1] + 1e-9, 1 / RATE)).clip(max=len(run.t) - 1)
    lines = outlines(mechanism, run.q[instants], run.plant.parameters)
    place = vehicle_motion(run.law.system)(run.x.T, run.plant.parameters).full()[:2].T
    figure = Figure(figsize=(5, 5), layout="constrained")
    axes = figure.subplots()
    axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
    axes.grid(alpha=0.3)
    if run.floor and run.spec.floor:
        draw_floor(axes, run.spec.floor)
    (way,) = axes.plot([], [], color="#0b61a4", linewidth=1.5)
    drawn = [axes.plot([], [], color="#333333", linewidth=1.0 if is_outline(line[0]) else 4.0)[0] for line in lines]

    def show(k: int) -> list:
        now = instants[k]
        (x, y), slip = place[now], run.floor.slip[now].max() if run.floor else 0.0
        way.set_data(*place[: now + 1].T)
        for artist, line in zip(drawn, lines, strict=True):
            artist.set_data(*line[k].T)
            artist.set_color("#c00000" if slip > SLIPS else "#333333")
        axes.set(xlim=(x - AROUND, x + AROUND), ylim=(y - AROUND, y + AROUND))
        axes.set_title(f"t = {run.t[now]:.2f} s" + (f", slip {slip:.2f} m/s" if run.floor else ""), fontsize=10)
        return drawn

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, f"film{suffix}")
        FuncAnimation(figure, show, frames=len(instants), cache_frame_data=False).save(file, WRITERS[suffix](fps=RATE), dpi=80)
        return file.read_bytes()
