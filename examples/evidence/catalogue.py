"""All figures, in the order of the report."""

from collections.abc import Sequence
from importlib.util import find_spec

from ...readers.errors import BadInput, check_named, installing
from .figures import (
    beyond,
    circle,
    composite,
    estimated,
    floor,
    limits,
    line,
    masses,
    planned,
    redrawn,
    reversing,
    robots,
    rolling,
    sensing,
)
from .framework import Figure

FIGURES: tuple[Figure, ...] = (
    *line.FIGURES[:1],
    *redrawn.FIGURES,
    *line.FIGURES[1:],
    *circle.FIGURES,
    *masses.FIGURES,
    *composite.FIGURES,
    *sensing.FIGURES,
    *estimated.FIGURES,
    *beyond.FIGURES,
    *limits.FIGURES,
    *reversing.FIGURES,
    *rolling.FIGURES,
    *planned.FIGURES,
    *robots.FIGURES,
    *floor.FIGURES,
)
LONG = (*robots.FIGURES, *floor.FIGURES)  # they take minutes


def chosen(names: Sequence[str], every: bool = False) -> list[Figure]:
    """The figures named; when none is, the short ones, or `every` one that can be made. In the order of the
    report.

    Raises BadInput for an unknown name, and for one that `left_out` has.
    """
    known = [figure.name for figure in FIGURES]
    for name in names:
        check_named(name, known, "--only: unknown figure")
    missing = left_out()
    for name in sorted({*names} & {*missing}):
        raise BadInput(f"--only: figure {name!r} is made in a physics engine; {installing('physics')}")
    if names:
        return [figure for figure in FIGURES if figure.name in names]
    return [figure for figure in FIGURES if figure.name not in missing and (every or figure not in LONG)]


def left_out() -> list[str]:
    """The figures that cannot be made, because the physics engine is not installed."""
    return [] if find_spec("mujoco") else [figure.name for figure in FIGURES if figure.engine]
