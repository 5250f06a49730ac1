"""The robot of a run, drawn where it was."""

import numpy as np
from matplotlib.axes import Axes

from ..simulation.plot import _outline
from .framework import Outcome


def draw_vehicle(axes: Axes, run: Outcome, k: int, colour: str, alpha: float = 0.12) -> None:
    """Body, wheels and axle at row k, to scale, a tick at the nose."""
    cosine, sine = run.forward[k]
    turn = np.array([[cosine, sine], [-sine, cosine]])
    body, wheels = _outline(run.parameters)
    axes.fill(*(body @ turn + run.q[k, :2]).T, facecolor=colour, alpha=alpha, linewidth=0, zorder=1.5)
    axes.fill(*(body @ turn + run.q[k, :2]).T, facecolor="none", edgecolor=colour, linewidth=0.8, zorder=1.6)
    nose = np.array([[0.7 * body[:, 0].max(), 0.0], [body[:, 0].max(), 0.0]])
    axle = np.array([wheel.mean(axis=0) for wheel in wheels])
    for line, width in ((axle, 1.0), (nose, 2.0), *((wheel, 3.0) for wheel in wheels)):
        axes.plot(*(line @ turn + run.q[k, :2]).T, color=colour, linewidth=width, solid_capstyle="butt", zorder=1.7)
