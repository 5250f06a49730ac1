"""Figures made once, for all tests that look at them.

Each is drawn in full, but only as SVG, which holds all that is drawn: that a PNG comes of it as well is
tested on a few.
"""

from contextlib import nullcontext
from functools import cache
from unittest.mock import patch

from noslip.examples.evidence import production
from noslip.examples.evidence.catalogue import FIGURES
from noslip.examples.evidence.framework import FigureRun, carry_out
from noslip.examples.evidence.production import Made, produce
from noslip.simulation import drawing
from noslip.simulation.specification.spec import Spec

RUNS = {}


def run_once(spec: Spec, singular: bool, engine: str | None) -> FigureRun:
    """`carry_out`, once for all figures that have this run."""
    key = repr((spec, singular, engine))
    if key not in RUNS:
        RUNS[key] = carry_out(spec, singular, engine)
    return RUNS[key]


def runs_here():
    """Within it figures' runs are carried out by this process, where the models are already:
    not for tests of processes."""
    return patch.object(production, "_workers", lambda count: nullcontext(run_once))


@cache
def figure_of(name: str) -> Made:
    """A figure by name, those of the robots included."""
    (figure,) = (figure for figure in FIGURES if figure.name == name)
    with runs_here(), patch.object(drawing, "METADATA", {"svg": drawing.METADATA["svg"]}):
        (made,) = produce([figure], 1, lambda made: None)
    return made
