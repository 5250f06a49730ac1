"""Courses along paths of lines and arcs: between them the curvature changes over ramps,
and the goal is met."""

import itertools
import math
from collections.abc import Sequence

import numpy as np

from ...model.algebra.trigonometry import unit
from ...model.segments import Segment
from ...readers.errors import BadInput
from ...readers.reading import positive
from .chain import CLOSE
from .course import SmoothCurve

ROUNDS = 30  # of Newton's method
SHORTEST = 1e-9  # m: shorter lines and arcs are left out
ENOUGH = 1e-13  # m and rad: change at which it ends, relative to the length of the path

# Signed length (m), curvature at both ends (1/m), number of a segment or -1 for a ramp
Part = tuple[float, float, float, int]


def with_ramps(segments: Sequence[Segment], ramp: float, speed: float = 1.0) -> SmoothCurve:
    """Return the course that leads along lines and arcs, forward and in reverse, with the same start and
    goal.

    Its curvature is 0 at both ends, and changes smoothly over `ramp` (m) at each end and where segments of
    different curvature meet; beside a cusp over a ramp on each side, to and from their mean, so that a
    steered wheel does not turn there. It is nowhere larger than that of the segments, whose lengths are
    changed so that the goal is met, by Newton's method, with the least change. Raises BadInput if none of
    positive lengths is found, and for numbers that are not positive and finite.
    """
    positive("ramp", ramp)
    positive("speed", speed)
    bends = [-segment.curvature if segment.backward else segment.curvature for segment in segments]
    ways = [-1.0 if segment.backward else 1.0 for segment in segments]
    lengths = np.array([segment.length for segment in segments])
    first, last = segments[0], segments[-1]
    start = math.remainder(first.heading - math.pi * first.backward, 2 * math.pi)
    goal = np.array([*last.end[:2], start + sum(np.array(bends) * ways * lengths)])
    parts = _parts(bends, ways, ramp)
    lengths = lengths - [_taken(parts, k, ramp) for k in range(len(segments))]
    whole = sum(segment.length for segment in segments)
    for _ in range(ROUNDS):
        curve = _curve((first.x, first.y, start), speed, parts, lengths)
        off, slope = _off(curve, goal, parts, lengths, bends, ways)
        change = np.linalg.lstsq(slope, off, rcond=None)[0]
        lengths = lengths - change
        if not np.abs(change).max() > ENOUGH * max(1.0, whole):
            break
    curve = _curve((first.x, first.y, start), speed, parts, lengths)
    if (
        not lengths.min() > -SHORTEST
        or not np.abs(_off(curve, goal, parts, lengths, bends, ways)[0]).max() <= CLOSE
    ):
        raise BadInput(
            f"no course with ramps of {ramp:g} m leads along this path of {len(segments)} segments: they are "
            "too short; make the ramps shorter, or the radius larger"
        )
    return curve


def _parts(bends: Sequence[float], ways: Sequence[float], ramp: float) -> list[Part]:
    """Return the parts of a course, ramps between segments with these curvatures,
    driven forward (1) or in reverse (-1)."""
    parts: list[Part] = [(ways[0] * ramp, 0.0, bends[0], -1)]
    for k, (bend, way) in enumerate(zip(bends, ways, strict=True)):
        parts.append((way, bend, bend, k))
        if k + 1 < len(bends) and ways[k + 1] != way:
            mean = (bend + bends[k + 1]) / 2
            parts += [(way * ramp, bend, mean, -1), (ways[k + 1] * ramp, mean, bends[k + 1], -1)]
        else:
            parts.append((way * ramp, bend, bends[k + 1] if k + 1 < len(bends) else 0.0, -1))
    return [part for part in parts if part[3] >= 0 or part[1] != part[2]]


def _taken(parts: Sequence[Part], segment: int, ramp: float) -> float:
    """Return how much of a segment its ramps take at first, m: as they turn as much as it,
    or half of each."""
    taken = 0.0
    for before, after in itertools.pairwise(parts):
        if segment in (before[3], after[3]) and -1 in (before[3], after[3]):
            _, first, last, _ = after if before[3] == segment else before
            bend = first if before[3] == segment else last
            taken += ramp * (first + last) / 2 / bend if bend and before[0] * after[0] > 0 else ramp / 2
    return taken


def _curve(
    start: tuple[float, float, float], speed: float, parts: Sequence[Part], lengths: np.ndarray
) -> SmoothCurve:
    """Return the course whose segments have these lengths, from a pose."""
    given = [(part[0] * (lengths[part[3]] if part[3] >= 0 else 1.0), part[2]) for part in parts]
    kept = [(length, bend) for length, bend in given if abs(length) > SHORTEST]
    curvatures = (parts[0][1], *(bend for _, bend in kept))
    return SmoothCurve(*start, speed, tuple(float(length) for length, _ in kept), tuple(curvatures))


def _off(
    curve: SmoothCurve,
    goal: np.ndarray,
    parts: Sequence[Part],
    lengths: np.ndarray,
    bends: Sequence[float],
    ways: Sequence[float],
) -> tuple[np.ndarray, np.ndarray]:
    """Return by how much a course misses the pose x, y (m) and heading (rad), and the derivatives by the
    lengths: where a segment is longer, what follows moves ahead, and turns about its end.
    """
    ends = np.cumsum([abs(part[0]) * (abs(lengths[part[3]]) if part[3] >= 0 else 1.0) for part in parts])
    end, heading = curve.position(curve.way), _heading(curve, curve.way)
    slope = np.zeros((3, len(lengths)))
    for part, at in zip(parts, ends, strict=True):
        if (k := part[3]) >= 0:
            place, along = curve.position(float(at)), _heading(curve, float(at))
            moved = ways[k] * (unit(along) + 1j * bends[k] * (end - place))
            slope[:, k] = moved.real, moved.imag, ways[k] * bends[k]
    return np.array([end.real, end.imag, heading]) - goal, slope


def _heading(curve: SmoothCurve, at: float) -> float:
    """Return the heading (rad) of the vehicle `at` m along a course, forward and in reverse."""
    stretch = curve.stretches[curve._part(at)]
    return curve.direction(at) - math.pi * stretch.backward
