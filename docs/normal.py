"""Draws docs/normal.png: paths from starts with all headings, and what replaces the inverse.

python docs/normal.py [FILE.png]
"""

import sys
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from noslip import simulate
from noslip.readers.files import write_whole
from noslip.simulation.drawing import COLOURS, STOP, STYLE, encoded, legend_below
from noslip.simulation.specification.spec import spec_of

SPEC = """
robot = "labmate"
reference = {{ speed = 1.0 }}
initial = {{ point = [0.0, 2.0], heading = "{heading} deg", speed = 1.0 }}
simulation = {{ duration = {duration}, period = 0.01, output_step = 0.02 }}
[output]
type = "IV"
near_singular = "damped"
band = 0.2
path = {{ kind = "line", A = 0.0, B = 1.0, C = 0.0 }}
"""
HEADINGS = range(0, 360, 45)  # degrees
BANDS = (0.1, 0.2, 0.4)


def draw_paths(axes: Axes, duration: float) -> None:
    """Draw P_l from 2 m beside a line."""
    for heading in HEADINGS:
        run = simulate(spec_of(SPEC.format(heading=heading, duration=duration), ""))
        normal = heading % 180 == 90
        colour, label = (
            (STOP, "start exactly normal to the line") if normal else (COLOURS[0], "other starts, 45° apart")
        )
        first = heading in (0, 90)
        axes.plot(
            *run.q[:, :2].T, color=colour, linewidth=2 if normal else 1.2, label=label if first else None
        )
    axes.plot([-9, 9], [0, 0], "--", color="black", linewidth=1, label="line")
    axes.plot(0, 2, "o", color="black")
    axes.set(
        title="P$_l$ from 2 m beside a line, 1 m/s, band 0.2",
        xlabel="x (m)",
        ylabel="y (m)",
        xlim=(-9, 9),
        aspect="equal",
    )
    legend_below(axes, 3)


def draw_inverse(axes: Axes) -> None:
    """Draw 1/c, and within each band x (2 - x^2)/band with x = c/band."""
    for band, colour in zip(BANDS, COLOURS[1:], strict=False):
        x = np.linspace(-1, 1, 201)
        axes.plot(band * x, x * (2 - x**2) / band, color=colour, label=f"band {band:g}", zorder=3)
    for side in (-1, 1):
        c = side * np.geomspace(0.05, 0.8, 200)
        axes.plot(c, 1 / c, color=COLOURS[0], linewidth=1.2, label="1/c" if side > 0 else None)
    about = "c, cosine of the angle between heading and path"
    axes.set(
        title="Inverse, and what replaces it",
        xlabel=about,
        ylabel="factor of the yaw acceleration",
        ylim=(-13, 13),
    )
    legend_below(axes, 4)


def draw(duration: float = 20.0) -> Figure:
    """Return the picture, of runs of `duration` (s)."""
    figure = Figure(figsize=(13, 4.4), layout="constrained")
    paths, inverse = figure.subplots(1, 2, width_ratios=(2.2, 1))
    draw_paths(paths, duration)
    draw_inverse(inverse)
    return figure


if __name__ == "__main__":
    file = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).with_suffix(".png"))
    with matplotlib.rc_context(STYLE):
        write_whole(file, encoded(draw(), "png"))
