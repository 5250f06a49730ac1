"""All figures, in the order of the report."""

from collections.abc import Sequence

from ..readers.errors import BadInput
from ..readers.robots import suggestion
from .figures import beyond, circle, composite, limits, line, masses, planned, redrawn, reversing, robots, rolling, sensing
from .framework import Figure

FIGURES: tuple[Figure, ...] = (
    *line.FIGURES[:1],
    *redrawn.FIGURES,
    *line.FIGURES[1:],
    *circle.FIGURES,
    *masses.FIGURES,
    *composite.FIGURES,
    *sensing.FIGURES,
    *beyond.FIGURES,
    *limits.FIGURES,
    *reversing.FIGURES,
    *rolling.FIGURES,
    *planned.FIGURES,
    *robots.FIGURES,
)


def chosen(names: Sequence[str]) -> list[Figure]:
    """The figures named, all when none is, in the order of the report. Raises BadInput for an unknown name."""
    known = [figure.name for figure in FIGURES]
    for name in names:
        if name not in known:
            raise BadInput(f"--only: unknown figure {name!r}{suggestion(name, known)}")
    return [figure for figure in FIGURES if not names or figure.name in names]
