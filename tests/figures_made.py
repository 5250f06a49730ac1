"""Figures made once, for all tests that look at them: the LABMATE's in the group `figures`, the others in the group `robots`.

Each is drawn in full, but only as SVG, which holds all that is drawn: that a PNG comes of it as well is tested on a few.
"""

from collections.abc import Sequence
from contextlib import nullcontext
from functools import cache
from unittest.mock import patch

from noslip.harness.figures import drawing, production, robots
from noslip.harness.figures.catalogue import FIGURES
from noslip.harness.figures.framework import Figure, carry_out
from noslip.harness.figures.production import Made, produce


def runs_here():
    """Within it figures' runs are carried out by this process, where the models are already: not for tests of processes."""
    return patch.object(production, "_workers", lambda count: nullcontext(carry_out))


@cache
def labmates_figures() -> dict[str, Made]:
    """Figure by name."""
    return {made.figure.name: made for made in _made([figure for figure in FIGURES if figure not in robots.FIGURES])}


@cache
def figure_of(robot: str) -> Made:
    """The figure of another robot."""
    (made,) = _made([figure for figure in robots.FIGURES if figure.name == robot])
    return made


def _made(figures: Sequence[Figure]) -> list[Made]:
    with runs_here(), patch.object(drawing, "METADATA", {"svg": drawing.METADATA["svg"]}):
        return produce(figures, 1, lambda made: None)
