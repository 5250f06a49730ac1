"""Approximation of curves by few lines and arcs within a tolerance.

A biarc consists of two arcs with a common tangent. Of the one-parameter family between two given points and
directions, the one with equal chords is used (E. Bertolazzi, M. Frego, arXiv:1601.07392).
"""

import math
from collections.abc import Callable, Sequence

import numpy as np

from ...model.algebra.trigonometry import cosine, phase, product, sine, size, unit
from ...model.segments import Segment
from ...readers.errors import BadInput
from ...readers.reading import positive
from .chain import joined, prove
from .curves import Points, Samples, bends, check_bends, of_function, sampled, through

Arc = tuple[float, float]  # curvature (1/m, positive turns left) and length (m)

QUARTER = math.pi / 2  # rad: largest angle of an arc, so that the foot of a point on it is unique
# The foot moves at most at this multiple of the curve's speed: the curve stays away from the centre of an arc
STRETCH = 2
MOST_PIECES = 2000  # segments of a path: about 10 s of computing time, and 112 KB in double
STRAIGHT = 1e-11  # rad: a curve whose direction changes less between samples is a line there
# Relative to the coordinates: smaller differences between lines and arcs are ignored
ROUNDING = 64 * np.finfo(float).eps


def fit(
    points: Sequence[Sequence[float]] | Callable[[float], Sequence[float]],
    tolerance: float,
    headings: Sequence[float | None] | None = None,
    closed: bool = False,
    min_radius: float | None = None,
    domain: tuple[float, float] | None = None,
) -> list[Segment]:
    """Return lines and arcs, without jumps of the heading, that stay within `tolerance` (m) of a curve, and
    vice versa.

    `points`: waypoints (x, y) in m, connected by the cubic Hermite curve of `curves.through` (chord-length
    parameter, directions from parabolas through neighbours; `headings` in rad, None where free, prescribes
    some; `closed` connects the last to the first); or a function t -> (x, y) on `domain`: by default 0 to 1,
    for a spline of SciPy its knots. Start and end point and directions are those of the curve. Each segment
    covers as much of the curve as possible.

    Raises BadInput for invalid waypoints, a curve with a corner, and a curve with a radius below `min_radius`
    (m).
    """
    positive("tolerance", tolerance)
    if min_radius is not None:
        positive("min_radius", min_radius)
    if callable(points):
        samples = sampled(of_function(points, domain), tolerance)
    else:
        curve, remaining = through(points, headings, closed, tolerance)
        samples = sampled(curve, remaining)
        check_bends(samples, tolerance)
        tolerance = remaining
    rounding = ROUNDING * float(np.abs(samples.places).max())
    arcs: list[Arc] = []
    k = 0
    for stop in _stops(samples):
        while k < stop:
            k, pair = _longest(samples, k, stop, tolerance, min_radius)
            for arc in pair:
                _append(arcs, arc, rounding)
            if len(arcs) > MOST_PIECES:
                raise BadInput(
                    f"the path needs more than {MOST_PIECES} lines and arcs; make the tolerance larger or "
                    "split it"
                )
    start, goal = (
        (float(place.real), float(place.imag), phase(direction))
        for place, direction in zip(samples.places[[0, -1]], samples.directions[[0, -1]], strict=True)
    )
    segments = joined(start, arcs)
    prove(segments, start, goal)
    return segments


def _stops(samples: Samples) -> list[int]:
    """Return the samples where straight parts begin and end, so that they become lines,
    and the last sample."""
    straight = np.abs(phase(samples.directions[1:] / samples.directions[:-1])) < STRAIGHT
    return [*(np.flatnonzero(np.diff(straight)) + 1), len(straight)]


def _longest(
    samples: Samples, k: int, stop: int, tolerance: float, min_radius: float | None
) -> tuple[int, list[Arc]]:
    """Return the last sample up to `stop` that a biarc from sample k can reach, and the biarc; found by
    doubling and bisection.
    """
    good, bad, step = k, stop + 1, 1
    best: list[Arc] = []
    while bad - good > 1:
        tried = min(good + step, bad - 1) if bad > stop else (good + bad) // 2
        pair = _biarc(samples, k, tried)
        if _within(samples, k, tried, pair, tolerance) and not _tight(pair, min_radius):
            good, best, step = tried, pair, 2 * step
        else:
            bad = tried
    if good == k:
        pair = _biarc(samples, k, k + 1)
        if _tight(pair, min_radius):
            radius = 1 / max(abs(curvature) for curvature, _ in pair)
            raise BadInput(
                f"the curve has radius {radius:.4g} m {samples.near(k)}, less than min_radius = "
                f"{min_radius:g} m; straighten it there or allow a smaller radius"
            )
        raise BadInput(
            f"no arcs stay within {tolerance:g} m of the curve {samples.near(k)}; make the tolerance larger"
        )
    return good, best


def _biarc(samples: Samples, k: int, m: int) -> list[Arc]:
    """Return the biarc of equal chords from sample k to sample m."""
    across = complex(samples.places[m] - samples.places[k])
    leaving, arriving = (phase(samples.directions[n] / across) for n in (k, m))
    joint = -(leaving + arriving) / 2  # direction where the arcs meet, relative to the line from start to end
    chord = abs(across) / (2 * cosine((arriving - leaving) / 4))
    return [_arc(chord, turn) for turn in (joint - leaving, arriving - joint)]


def _arc(chord: float, turn: float) -> Arc:
    curvature = 2 * sine(turn / 2) / chord
    return curvature, turn / curvature if curvature else chord


def _tight(pair: list[Arc], min_radius: float | None) -> bool:
    return min_radius is not None and any(abs(curvature) * min_radius > 1 + 1e-9 for curvature, _ in pair)


def _within(samples: Samples, k: int, m: int, pair: list[Arc], tolerance: float) -> bool:
    """Return whether samples k to m are near the biarc, and the biarc near them.

    The latter follows from the feet of the samples: they move along the biarc from end to end, neither
    backward nor in jumps, so that every point of it is the foot of a point of the curve. Between samples, the
    distances of curve and biarc from their chords are bounded.
    """
    if any(abs(curvature) * length > QUARTER for curvature, length in pair):
        return False
    place, direction = samples.places[k], samples.directions[k]
    (curvature, length), second = pair
    turn = curvature * length
    middle = place + length * direction * unit(turn / 2) * (2 * sine(turn / 2) / turn if turn else 1.0)
    points = samples.places[k : m + 1]
    along, left = _feet(points, place, direction, curvature)
    farther, beside = _feet(points, middle, direction * unit(turn), second[0])
    beyond = along > length
    along, left = np.where(beyond, length + farther, along), np.where(beyond, beside, left)
    slack = ROUNDING * max(1.0, np.abs(points).max())
    steps, whole = np.diff(along), length + second[1]
    if np.any(steps < -slack) or np.any(steps > STRETCH * size(np.diff(points)) + slack):
        return False
    if along[0] > slack or abs(along[-1] - whole) > slack or np.any(farther[beyond] < -slack):
        return False
    bent = bends(np.diff(points), (samples.directions[k:m], samples.directions[k + 1 : m + 1]))
    bent += np.where(beyond[1:], np.maximum(abs(curvature), abs(second[0])), abs(curvature)) * steps**2 / 8
    return bool(np.all(np.maximum(np.abs(left[:-1]), np.abs(left[1:])) + bent <= tolerance))


def _feet(
    points: Points, place: complex, direction: complex, curvature: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions of the feet of points on a line or arc, m from its start, and the distances of the
    points to its left, m.
    """
    local = product(points - place, np.conj(direction))
    # from the centre, in units of the radius; 1 at the start
    spoke = (1 - curvature * local.imag) + 1j * (curvature * local.real)
    along = phase(spoke) / curvature if curvature else local.real
    return along, (2 * local.imag - curvature * (local.real**2 + local.imag**2)) / (1 + size(spoke))


def _append(arcs: list[Arc], arc: Arc, rounding: float) -> None:
    """Append an arc, as a line if it is one up to rounding;
    an arc that continues the last one is merged with it."""
    curvature, length = arc
    if abs(curvature) * length * length <= rounding:
        curvature = 0.0
    if arcs:
        before, gone = arcs[-1]
        longer = max(length, gone)
        if abs(curvature - before) * longer * longer <= rounding:
            curvature, length = (curvature * length + before * gone) / (length + gone), length + gone
            arcs.pop()
    arcs.append((curvature, length))
