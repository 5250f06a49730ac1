"""The robot of a run, drawn where it was."""

import numpy as np
from matplotlib.axes import Axes

from ...simulation.drawing import is_outline, outlines
from .framework import FigureRun


def draw_vehicle(axes: Axes, run: FigureRun, k: int, colour: str, alpha: float = 0.12) -> None:
    """Bodies and wheels at row k, to scale, a tick at the nose."""
    lines = [line[0] for line in outlines(run.robot, run.q[[k]], run.plant)]
    for line in lines:
        if is_outline(line):
            axes.fill(*line.T, facecolor=colour, alpha=alpha, linewidth=0, zorder=1.5)
            axes.fill(*line.T, facecolor="none", edgecolor=colour, linewidth=0.8, zorder=1.6)
        else:
            axes.plot(*line.T, color=colour, linewidth=3.0, solid_capstyle="butt", zorder=1.7)
    reach = max(((line - run.point[k]) @ run.forward[k]).max() for line in lines)
    nose = run.point[k] + np.outer([0.7 * reach, reach], run.forward[k])
    axes.plot(*nose.T, color=colour, linewidth=2.0, solid_capstyle="butt", zorder=1.7)
