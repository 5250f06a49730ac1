"""Plots of what a fit leaves: the errors of each output over time."""

import numpy as np
from matplotlib.figure import Figure

from ...simulation.drawing import COLOURS, legend_below, over_time, panels
from .result import Identification


def draw(result: Identification) -> Figure:
    """Return a panel for each output with its errors, predicted minus measured;
    those of windows that were left out differ."""
    figure, axes = panels(
        *[f"error of {name}: {rms:.3g} {unit} RMS" for (name, unit), rms in _sizes(result)], most=3
    )
    for k, (panel, (_, unit)) in enumerate(zip(axes, result.outputs, strict=True)):
        for used, label, colour in ((True, "fitted", COLOURS[0]), (False, "left out of the fit", COLOURS[1])):
            t, errors = (
                result.t[result.used == used].ravel(),
                result.errors[result.used == used, :, k].ravel(),
            )
            if len(t):
                panel.plot(t, errors, ".", markersize=3, color=colour, label=label)
        panel.axhline(0.0, color="black", linewidth=0.8)
        largest = np.nanmax(np.abs(result.errors[:, :, k]), initial=1e-15)
        panel.set_ylim(-1.1 * largest, 1.1 * largest)
        over_time(panel, f"predicted minus measured ({unit})")
        legend_below(panel, 2)
    return figure


def _sizes(result: Identification) -> list[tuple[tuple[str, str], float]]:
    return list(zip(result.outputs, map(float, result.residual), strict=True))
