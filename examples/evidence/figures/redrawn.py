"""The paper's diagrams, figures 2 to 5: drawn, not run."""

from collections.abc import Callable
from dataclasses import dataclass

import matplotlib.figure

from ..framework import Claim, Figure, Runs
from .diagrams import DIAGRAMS

TITLES = {
    "two-bodies": (
        "2",
        "Figure 2: two bodies in rolling contact",
        "Contact point, frames and velocities of the contact's kinematics (5).",
    ),
    "platform": ("3", "Figure 3: the mobile platform", "Two driven wheels on one axle, castors ignored."),
    "notation": (
        "4",
        "Figure 4: notation",
        "Points, lengths and angles of the platform; L and d as in every spec.",
    ),
    "control-scheme": (
        "5",
        "Figure 5: control scheme",
        "Nonlinear feedbacks (12) and (20) inside, a linear loop around them.",
    ),
}


@dataclass(frozen=True)
class Diagram(Figure):
    """A figure without runs, so without claims."""

    def all_claims(self, runs: Runs) -> list[Claim]:
        """None."""
        return []


def _drawn(name: str) -> Callable[[Runs], matplotlib.figure.Figure]:
    return lambda runs: DIAGRAMS[name]()


FIGURES = tuple(
    Diagram(number, title, f"The paper's diagram, redrawn. {about}", "", {}, _drawn(name), lambda runs: [])
    for name, (number, title, about) in TITLES.items()
)
