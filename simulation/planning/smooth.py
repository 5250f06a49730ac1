"""Fits a course, a curve of continuous curvature, to sampled points,
splines and other curves within a tolerance."""

from collections.abc import Callable, Sequence

import numpy as np

from ...model.algebra.trigonometry import phase, product
from ...readers.errors import BadInput
from ...readers.reading import number, positive
from .course import SmoothCurve
from .curves import Samples, check_bends, of_function, sampled, through

MOST = 256  # parts of a course
EACH, PLACES = 24, 240  # places of each part, and of the course, that are compared, at least
ROUNDS = 8  # of the method of Gauss and Newton
LIKELY = 2.0  # of the tolerance: a fit that is farther off is not looked at
DIGITS = 12  # of the numbers returned: rounding of the solver does not show in them


def fit_course(
    curve: Sequence[Sequence[float]] | Callable[[float], Sequence[float]],
    tolerance: float,
    speed: float = 1.0,
    rounding: float = 0.0,
    domain: tuple[float, float] | None = None,
    headings: Sequence[float | None] | None = None,
) -> SmoothCurve:
    """Return a course that is at most `tolerance` (m) from a curve, each point from that at the same length
    along it.

    `curve`: points (x, y) in m, through which a smooth curve is laid, with `headings` (rad) where they are
    given; or a function t -> (x, y), such as a spline of SciPy, on `domain`. The course has parts of equal
    length, of which it tries more and more; its curvature is as SmoothCurve says, with a `rounding` (m) that
    of lines, arcs and clothoids. Raises BadInput for curves with corners, if more than MOST parts were
    needed, and for numbers that are not finite, or not positive (`rounding`: negative).
    """
    positive("tolerance", tolerance)
    positive("speed", speed)
    number("nonnegative")(rounding, "rounding")
    if callable(curve):
        samples = sampled(of_function(curve, domain), tolerance)
    else:
        shape, remaining = through(curve, headings, False, tolerance)
        samples = sampled(shape, remaining)
        check_bends(samples, tolerance)
        tolerance = remaining
    lengths = _lengths(samples)
    count = 1
    while count <= MOST:
        if rounding > lengths[-1] / count:
            break
        made = _fitted(samples, lengths, count, speed, rounding, tolerance)
        if made and _deviation(made, samples, lengths) <= tolerance:
            return made
        count = max(count + 1, count * 3 // 2)
    raise BadInput(
        f"no course of {count if rounding else MOST} parts or fewer is within {tolerance:g} m of the curve; "
        "make tolerance larger" + (", or rounding smaller" if rounding else "")
    )


def _lengths(samples: Samples) -> np.ndarray:
    """Return the length along the curve at each sample, m: of the arcs between neighbours."""
    chords = np.diff(samples.places)
    half = phase(product(samples.directions[1:], samples.directions[:-1].conj())) / 2
    return np.concatenate([[0.0], np.cumsum(np.abs(chords) / np.sinc(half / np.pi))])


def _fitted(
    samples: Samples, lengths: np.ndarray, count: int, speed: float, rounding: float, tolerance: float
) -> SmoothCurve | None:
    """Return the course of `count` parts of least squares, None if that is clearly beyond the tolerance. Its
    direction is linear in its curvatures.
    """
    part, each = float(lengths[-1]) / count, max(EACH, PLACES // count)
    parts, at = (part,) * count, np.linspace(0.0, lengths[-1], count * each + 1)
    target = np.interp(at, lengths, samples.places.real) + 1j * np.interp(at, lengths, samples.places.imag)
    direction = np.interp(at, lengths, np.unwrap(np.angle(samples.directions)))

    columns = np.column_stack([np.ones(len(at)), _turned(parts, rounding, at, each)])
    turns = np.linalg.lstsq(columns, direction, rcond=None)[0]
    start, step, off = target[0], at[1] - at[0], target

    def summed(values: np.ndarray) -> np.ndarray:
        """Integrals from the beginning, by the trapezoidal rule: what it neglects `_deviation` would see."""
        return (
            np.concatenate(
                [np.zeros((1, *values.shape[1:])), np.cumsum((values[1:] + values[:-1]) / 2, axis=0)]
            )
            * step
        )

    for _ in range(ROUNDS):
        along = np.exp(1j * (columns @ turns))
        off = target - (start + summed(along))
        slopes = np.column_stack(
            [np.ones(len(at)), 1j * np.ones(len(at)), summed(1j * along[:, None] * columns)]
        )
        both = np.vstack([slopes.real, slopes.imag])
        change = np.linalg.lstsq(both, np.concatenate([off.real, off.imag]), rcond=None)[0]
        start, turns = start + change[0] + 1j * change[1], turns + change[2:]
    if np.abs(off).max() > LIKELY * tolerance:
        return None
    heading, *curvatures = (round(float(value), DIGITS) for value in turns)
    place = round(float(start.real), DIGITS), round(float(start.imag), DIGITS)
    return SmoothCurve(*place, heading, speed, (round(part, DIGITS),) * count, tuple(curvatures), rounding)


def _turned(parts: tuple[float, ...], rounding: float, at: np.ndarray, each: int) -> np.ndarray:
    """Return the direction at each place, a column for each knot: for the curvature 1 there and 0 at the
    others.

    All but the first two and the last are equal but for their place.
    """
    count = len(parts)
    columns: list[np.ndarray] = []
    for k in range(count + 1):
        if 2 < k < count:
            columns.append(np.concatenate([np.zeros(each), columns[-1][:-each]]))
            continue
        own = SmoothCurve(0.0, 0.0, 0.0, 1.0, parts, tuple(float(j == k) for j in range(count + 1)), rounding)
        columns.append(np.array([own.direction(float(s)) for s in at]))
    return np.array(columns).T


def _deviation(course: SmoothCurve, samples: Samples, lengths: np.ndarray) -> float:
    """Return the largest distance of samples from the points of the course at the same lengths, m."""
    return max(
        abs(course.position(float(s)) - place) for s, place in zip(lengths, samples.places, strict=True)
    )
