"""Shortest paths between poses for a vehicle with a minimum turning radius: Dubins, and Reeds-Shepp.

Lengths are in turning radii, points are complex numbers, and the start is the origin with heading along x. A
path begins on one of the two circles at the start and ends on one of the two at the goal. The middle part
takes the centre of the first circle to the centre of the last by K e^{i theta}, where theta is the heading at
the end of the first arc, and K depends on the middle part only. So |K|, the distance of the centres,
determines the one free length of the middle part, and the direction from centre to centre then determines
theta and with it the arcs at both ends.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence

from ...model.algebra.trigonometry import arcsine, phase, unit
from ...model.segments import Segment
from ...readers.errors import BadInput
from ...readers.reading import positive
from .chain import Pose, joined, pose, prove

Piece = tuple[int, float]  # steering (1 left, 0 straight, -1 right) and signed length (negative: in reverse)
Middles = Callable[[int, int, float], Iterator[list[Piece]]]

# m and rad: shorter pieces, and arcs shorter than a full turn by less than this, are due to rounding
SNAP = 1e-10
FAR = 1e100  # turning radii: beyond this, squares of distances overflow
# Relative difference of lengths below which paths are equal: then fewer cusps, fewer pieces, forward first
TIE = 1e-12
SIDES = (1, -1)


def dubins(start: Sequence[float], goal: Sequence[float], radius: float) -> list[Segment]:
    """Return the shortest forward path between poses (x m, y m, heading rad) with turning radius at least
    `radius` (m).

    L. E. Dubins, American Journal of Mathematics 79 (1957): arc, line, arc; or three arcs. The error at the
    goal is at most 1e-9 (m and rad). Raises BadInput for an invalid pose or radius, for equal poses, and for
    distances or a radius so large that rounding prevents that accuracy.
    """
    return _plan(_dubins_middles, False, pose(start, "start"), pose(goal, "goal"), radius)


def reeds_shepp(start: Sequence[float], goal: Sequence[float], radius: float) -> list[Segment]:
    """Return the shortest path, forward and in reverse, between poses of the vehicle with turning radius at
    least `radius` (m).

    J. A. Reeds and L. A. Shepp, Pacific Journal of Mathematics 145 (1990): at most five pieces. Heading and
    curvature of a Segment are those of the direction of travel. Units, accuracy and errors as for `dubins`.
    """
    return _plan(_reeds_shepp_middles, True, pose(start, "start"), pose(goal, "goal"), radius)


def _plan(middles: Middles, reversing: bool, start: Pose, goal: Pose, radius: float) -> list[Segment]:
    """Return the shortest path with one of the middle parts, in SI units."""
    positive("radius", radius)
    target = complex(goal[0] - start[0], goal[1] - start[1]) / radius * unit(-start[2])
    if not abs(target) < FAR:
        raise BadInput(
            f"start and goal are too far apart for a radius of {radius:g} m; move them together or increase "
            "it"
        )
    turn = math.remainder(goal[2] - start[2], 2 * math.pi)
    # rad, or radii: moves the end point by less than SNAP
    slack = SNAP / max(1.0, radius * (1 + abs(target)))
    if abs(target) < slack and abs(turn) < slack:
        raise BadInput("start and goal are the same pose; there is no path to plan")
    paths = [_tidy(pieces, reversing, slack) for pieces in _paths(middles, target, turn, slack)]
    paths = [pieces for pieces in paths if reversing or all(length > 0 for _, length in pieces)]
    shortest = min(map(_length, paths))
    best = min((pieces for pieces in paths if _length(pieces) <= shortest * (1 + TIE)), key=_effort)
    path = joined(start, [(steer / radius, length * radius) for steer, length in best])
    prove(path, start, goal)
    return path


def _paths(middles: Middles, target: complex, turn: float, slack: float) -> Iterator[list[Piece]]:
    """Yield every path to the target, with the heading changed by `turn`,
    that has one of the middle parts."""
    for first in SIDES:
        for last in SIDES:
            apart = _centres(first, last, target, turn)
            for middle in middles(first, last, abs(apart)):
                across = _centres(first, last, *_end(middle))
                theta = phase(apart / across) if min(abs(apart), abs(across)) > slack else 0.0
                turned = sum(steer * length for steer, length in middle)
                yield [(first, first * theta), *middle, (last, last * (turn - theta - turned))]


def _centres(first: int, last: int, end: complex, turned: float) -> complex:
    """Return the vector from the centre of the first circle, which begins at the origin, to that of the last
    circle through `end`.
    """
    return end + 1j * last * unit(turned) - 1j * first


def _end(pieces: Iterable[Piece]) -> tuple[complex, float]:
    """Return position and heading after the pieces."""
    place, heading = 0j, 0.0
    for steer, length in pieces:
        ahead = unit(heading)
        heading += steer * length
        place += 1j * steer * (ahead - unit(heading)) if steer else length * ahead
    return place, heading


def _straight(
    first: int, last: int, apart: float, before: list[Piece], after: list[Piece]
) -> Iterator[list[Piece]]:
    """Yield middle parts with a line between given pieces: the two lengths of the line for which the centres
    are `apart`."""
    fixed = _centres(first, last, *_end([*before, *after]))
    along = (fixed * unit(-sum(steer * length for steer, length in before))).real
    square = along * along + apart * apart - (fixed.real * fixed.real + fixed.imag * fixed.imag)
    if square >= -1e-14 * (1 + apart * apart):  # including a line whose length is zero up to rounding
        for root in SIDES:
            yield [*before, (0, root * math.sqrt(max(0.0, square)) - along), *after]


def _dubins_middles(first: int, last: int, apart: float) -> Iterator[list[Piece]]:
    """Yield a line; or, between circles of the same side, one arc of the other side."""
    yield from _straight(first, last, apart, [], [])
    if first == last and apart <= 4:
        for side in SIDES:
            yield [(-first, side * 2 * arcsine(apart / 4))]


def _reeds_shepp_middles(first: int, last: int, apart: float) -> Iterator[list[Piece]]:
    """Yield those of Dubins; a line with quarter turns from or to a cusp; two arcs of equal length."""
    yield from _dubins_middles(first, last, apart)
    quarters = [side * math.pi / 2 for side in SIDES]
    for before in [[], *([(-first, quarter)] for quarter in quarters)]:
        for after in [[], *([(-last, quarter)] for quarter in quarters)]:
            if before or after:
                yield from _straight(first, last, apart, before, after)
    if first != last:
        for side in SIDES:
            for cosine, second in (
                ((2 + apart) / 4, -1),
                ((2 - apart) / 4, -1),
                ((20 - apart * apart) / 16, 1),
            ):
                if abs(cosine) <= 1:
                    arc = side * (math.pi / 2 - arcsine(cosine))
                    yield [(-first, arc), (first, second * arc)]


def _tidy(pieces: Iterable[Piece], reversing: bool, slack: float) -> list[Piece]:
    """Return the pieces with equal steering merged, arcs taken the shorter way (forward, unless reversing),
    without empty ones.
    """
    merged: list[Piece] = []
    for steer, length in pieces:
        if merged and merged[-1][0] == steer:
            length += merged.pop()[1]
        if steer:
            length = math.remainder(length, 2 * math.pi)
        if steer and not reversing and length < -slack:
            length += 2 * math.pi
        if abs(length) > slack:
            merged.append((steer, length))
    return merged


def _length(pieces: Iterable[Piece]) -> float:
    return sum(abs(length) for _, length in pieces)


def _effort(pieces: Sequence[Piece]) -> tuple[int, int, bool]:
    cusps = sum(a[1] * b[1] < 0 for a, b in zip(pieces, pieces[1:], strict=False))
    return cusps, len(pieces), any(length < 0 for _, length in pieces[:1])
