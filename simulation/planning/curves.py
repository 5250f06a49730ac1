"""Smooth curves, through waypoints or given as functions, and samples of them that are dense enough for
fitting arcs."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import SupportsIndex

import numpy as np

from ...model.algebra.trigonometry import phase, product, size, unit
from ...readers.errors import BadInput, naming

Points = np.ndarray  # complex: x + i y, m

SAME = 1e-9  # m: points with a smaller distance are equal
FAR = 1e100  # m: beyond this, cubes of lengths would overflow
NEAR = 1 / 8  # of the tolerance: waypoints with a smaller distance count as one
MANY_HEADINGS, CONTRARY = 5, 0.5  # rad: so many headings that mostly differ by more from the curve's are none
BACK = 1e-6  # rad: a turn this close to half a turn has no defined side
STEP = 1e-6  # of the domain: for the numerical derivative of a function

TURN = 0.1  # rad between neighbouring samples, at most
SHARE = 1 / 16  # of the tolerance: largest distance of the curve from the chord of neighbouring samples
PARTS = 4  # samples per part of a spline, at least
MANY = 64  # number of parts assumed for a function
SHORTEST = 1e-6  # of the shortest part: if samples would have to be closer, there is a corner
MOST = 200_000  # samples


@dataclass(frozen=True)
class PlaneCurve:
    """Positions (m) and velocities, complex, as functions of the parameter, (N,) -> (N,); breakpoints; name
    of a parameter value.
    """

    place: Callable[[np.ndarray], Points]
    velocity: Callable[[np.ndarray], Points]
    knots: np.ndarray
    called: Callable[[float], str]


@dataclass(frozen=True)
class Samples:
    """Positions (m) and directions of travel (unit complex) along a curve, (N,)."""

    curve: PlaneCurve
    times: np.ndarray
    places: Points
    directions: Points

    def near(self, k: SupportsIndex) -> str:
        """Return the location of sample k as text."""
        place = self.places[k]
        return f"near ({place.real:.6g}, {place.imag:.6g}), {self.curve.called(self.times[k])}"


def through(
    points: Sequence[Sequence[float]], headings: Sequence[float | None] | None, closed: bool, tolerance: float
) -> tuple[PlaneCurve, float]:
    """Return the cubic Hermite curve through waypoints (x, y) in m, with the accumulated chord length as
    parameter, and the part of `tolerance` (m) that remains to stay within it.

    Waypoints closer together than a part of the tolerance count as one, as does a first point that is
    repeated at the end of a closed curve. The velocity at a waypoint is that of the parabola through the
    waypoint and its neighbours, at an end that of the parabola's end: through collinear waypoints the curve
    is straight, and a waypoint affects it only up to two waypoints away. If a heading (rad) is given, the
    velocity is the unit vector in its direction. Raises BadInput.
    """
    places, prescribed = _places(points), _headings(headings, len(points))
    kept, off = _merged(places, prescribed, closed, max(SAME, NEAR * tolerance)) if len(places) else ([], 0.0)
    if len(places) > 1 and (extent := float(np.abs(places - places[0]).max())) <= tolerance:
        raise BadInput(
            f"the waypoints are at most {extent:.3g} m from the first, less than the tolerance, "
            f"{tolerance:g} m: make it smaller, or give x and y in m; degrees of latitude and longitude have "
            "to be projected, for instance to UTM"
        )
    if len(kept) < (least := 3 if closed else 2):
        kind = "closed path" if closed else "path"
        raise BadInput(f"waypoints: {len(kept)} given in different places, a {kind} requires {least} or more")
    places, prescribed = places[kept], [prescribed[k] for k in kept]
    ring = np.concatenate([places[-1:], places, places[:2]]) if closed else places
    number = np.arange(len(ring)) - closed  # of the waypoint that is kept, from 0
    chords = np.diff(ring)
    lengths = size(chords)
    units = chords / lengths
    for k in np.flatnonzero(math.pi - np.abs(phase(units[1:] / units[:-1])) < BACK) + 1:
        if prescribed[number[k] % len(places)] is None:
            where = f"waypoint {kept[number[k] % len(places)] + 1} {_shown(ring[k])}"
            raise BadInput(
                f"the path turns back at {where}; give a heading there, move it, or split the path"
            )
    velocities = np.concatenate([units[:1], units])
    velocities[1:-1] = (lengths[1:] * units[:-1] + lengths[:-1] * units[1:]) / (lengths[1:] + lengths[:-1])
    _check_headings(prescribed, [velocities[closed + k] for k in range(len(places))])
    for at, m in enumerate(number):
        if (heading := prescribed[m % len(places)]) is not None:
            velocities[at] = unit(heading)
    if closed:
        ring, velocities, lengths = ring[1:-1], velocities[1:-1], lengths[1:-1]
    else:
        for end, neighbour in ((0, 1), (-1, -2)):
            if prescribed[end] is None:
                velocities[end] = 2 * units[end] - velocities[neighbour]
    knots = np.concatenate([[0.0], np.cumsum(lengths)])
    from scipy.interpolate import CubicHermiteSpline  # slow to import, and needed for waypoints only

    spline = CubicHermiteSpline(knots, ring, velocities)

    def called(time: float) -> str:
        k = min(int(np.searchsorted(knots, time, "right")), len(knots) - 1)
        return f"between waypoints {kept[k - 1] + 1} and {kept[k % len(places)] + 1}"

    return PlaneCurve(spline, spline.derivative(), knots, called), tolerance - off


def _merged(
    places: Points, prescribed: list[float | None], closed: bool, near: float
) -> tuple[list[int], float]:
    """Return the waypoints that are farther than `near` (m) from the one before, the first and, unless the
    curve is closed, the last among them; and how far at most another one is from them, m. A heading of one
    that is left out is given to the one that stands for it. Raises BadInput if those have different headings.
    """
    kept, last, off = [0], len(places) - 1, [0.0, 0.0]

    def stand_for(other: int, by: int, round: int) -> None:
        off[round] = max(off[round], float(abs(places[other] - places[by])))
        if prescribed[other] is not None and prescribed[by] not in (None, prescribed[other]):
            apart = abs(places[other] - places[by])
            message = f"waypoints {by + 1} and {other + 1} are {apart:.2g} m apart, and their headings differ"
            raise BadInput(f"{message}; remove one, or make the tolerance smaller")
        prescribed[by] = prescribed[other] if prescribed[by] is None else prescribed[by]

    for k in range(1, len(places)):
        if abs(places[k] - places[kept[-1]]) > near:
            kept.append(k)
        elif k < last or closed:
            stand_for(k, kept[-1], 0)
    end = 0 if closed else last  # which the ones before it must not be near to either
    while len(kept) > 1 and kept[-1] != end and abs(places[kept[-1]] - places[end]) <= near:
        stand_for(kept.pop(), end, 1)
    return kept if closed or kept[-1] == last else [*kept, last], sum(off)


def _check_headings(prescribed: Sequence[float | None], directions: Sequence[complex]) -> None:
    """Raise BadInput if many headings are prescribed, and most are not those of a path through these
    waypoints."""
    pairs = [
        (h, each)
        for h, each in zip(prescribed, directions, strict=True)
        if h is not None and abs(each) > BACK
    ]
    off = [abs(phase(unit(heading) / each)) for heading, each in pairs]
    if len(off) >= MANY_HEADINGS and (usual := float(np.median(off))) > CONTRARY:
        raise BadInput(
            f"the headings differ by {math.degrees(usual):.0f} deg from the directions between the "
            "waypoints: are they headings of travel, in rad? Leave the column out with --columns x,y,- or "
            "state its unit"
        )


def check_bends(samples: Samples, tolerance: float) -> None:
    """Raise BadInput if the curve has a smaller radius than the tolerance (m),
    a bend that its waypoints cannot mean."""
    turns = np.abs(phase(product(samples.directions[1:], samples.directions[:-1].conj())))
    radii = size(np.diff(samples.places)) / np.maximum(turns, 1e-300)
    k = int(np.argmin(radii))
    if radii[k] < tolerance:
        raise BadInput(
            f"the curve has radius {radii[k]:.2g} m {samples.near(k)}, less than the tolerance, "
            f"{tolerance:g} m; move or remove a waypoint there, or make the tolerance smaller"
        )


def of_function(
    function: Callable[[float], Sequence[float]], domain: tuple[float, float] | None
) -> PlaneCurve:
    """Return the curve t -> (x, y) in m: a spline of SciPy on all its knots,
    another function on `domain` (0 to 1)."""
    knots = getattr(function, "x", None)  # PPoly
    if knots is None and hasattr(function, "t") and hasattr(function, "k"):  # BSpline
        knots = function.t[function.k : len(function.t) - function.k]
    if knots is None or domain is not None:
        start, end = (0.0, 1.0) if domain is None else domain
        if not (math.isfinite(start) and math.isfinite(end) and start < end):
            raise BadInput(f"domain = ({start:g}, {end:g}) is not an interval of t; give (start, end)")
        knots = np.linspace(start, end, MANY + 1)
    knots = np.unique(knots)

    def place(times: np.ndarray, function: Callable[[float], Sequence[float]] = function) -> Points:
        between = f"t = {times[0]:g} and {times[-1]:g}"
        with naming(f"the curve is not a function t -> (x, y) between {between}", (TypeError, ValueError)):
            values = np.array([function(t) for t in times], float)
        if values.shape != (len(times), 2):
            raise BadInput(f"the curve has values of shape {values.shape[1:]} instead of x, y")
        for k in np.flatnonzero(~np.isfinite(values).all(axis=1)):
            raise BadInput(f"the curve is {values[k]} at t = {times[k]:g}; it must be finite there")
        return values @ [1, 1j]

    def differences(times: np.ndarray) -> Points:
        """Return the derivative of the parabola through three points in the domain."""
        step = STEP * (knots[-1] - knots[0])
        middle = np.clip(times, knots[0] + step, knots[-1] - step)
        before, at, after = (place(middle + k * step) for k in (-1, 0, 1))
        return (after - before) / (2 * step) + (times - middle) * (after - 2 * at + before) / step**2

    velocity = differences
    if hasattr(function, "derivative"):
        derivative = function.derivative()

        def velocity(times: np.ndarray) -> Points:
            return place(times, derivative)

    return PlaneCurve(place, velocity, knots, lambda time: f"t = {time:g}")


def sampled(curve: PlaneCurve, tolerance: float) -> Samples:
    """Return samples so dense that between two neighbours the curve differs from their chord by a part of the
    tolerance (m) only.

    Raises BadInput if the velocity vanishes or the curve has a corner, and if there would be too many
    samples.
    """
    shares = np.arange(PARTS) / PARTS
    times = np.append(
        (curve.knots[:-1, None] + np.diff(curve.knots)[:, None] * shares).ravel(), curve.knots[-1]
    )
    samples = _at(curve, times)
    rough = np.ones(len(times) - 1, bool)  # intervals that may need refinement
    while rough.any():
        left = np.flatnonzero(rough)
        if len(samples.times) + len(left) > MOST:
            raise BadInput(
                f"tolerance = {tolerance:g} m requires more than {MOST} samples of the curve; make it larger"
            )
        new = _at(curve, (samples.times[left] + samples.times[left + 1]) / 2)
        chords = samples.places[left + 1] - samples.places[left]
        bent = bends(chords, (samples.directions[left], new.directions, samples.directions[left + 1]))
        fine = bent < np.minimum(SHARE * tolerance, TURN / 8 * size(chords))
        samples = Samples(
            curve,
            *(
                np.insert(getattr(samples, name), left + 1, getattr(new, name))
                for name in ("times", "places", "directions")
            ),
        )
        rough = np.insert(rough, left, ~fine)
        rough[left + np.arange(1, len(left) + 1)] = ~fine
        close = rough & (np.diff(samples.times) < SHORTEST * np.diff(curve.knots).min())
        for k in np.flatnonzero(close):
            raise BadInput(f"the curve has a corner {samples.near(k)}; round it, or split the path there")
    return samples


def bends(chords: Points, directions: Sequence[Points]) -> np.ndarray:
    """Return the largest distance of a curve with these directions from its chords, m: exact for an arc, an
    upper bound otherwise.
    """
    return size(chords) * np.max([np.abs(phase(product(d, chords.conj()))) for d in directions], axis=0) / 4


def _at(curve: PlaneCurve, times: np.ndarray) -> Samples:
    velocities = curve.velocity(times)
    speeds = size(velocities)
    samples = Samples(curve, times, curve.place(times), velocities / np.where(speeds > 0, speeds, 1.0))
    for k in np.flatnonzero(speeds == 0):
        raise BadInput(
            f"the velocity of the curve vanishes {samples.near(k)}; its direction is undefined there"
        )
    return samples


def _places(points: Sequence[Sequence[float]]) -> Points:
    places = []
    for k, point in enumerate(points, 1):
        numbers = tuple(map(float, point))
        if len(numbers) != 2 or not all(map(math.isfinite, numbers)):
            raise BadInput(f"waypoint {k} = {numbers} must be two finite numbers x, y")
        if max(map(abs, numbers)) > FAR:
            raise BadInput(f"waypoint {k} = {numbers} is too far away; choose an origin nearer to the path")
        places.append(complex(*numbers))
    return np.array(places)


def _headings(headings: Sequence[float | None] | None, count: int) -> list[float | None]:
    if headings is None:
        return [None] * count
    if len(headings) != count:
        raise BadInput(
            f"{len(headings)} headings for {count} waypoints; give one for each, None where it is free"
        )
    for k, heading in enumerate(headings, 1):
        if heading is not None and not math.isfinite(heading):
            raise BadInput(
                f"the heading at waypoint {k} is {heading:g}; give a finite one, or None where it is free"
            )
    return list(headings)


def _shown(place: complex) -> str:
    return f"({place.real:g}, {place.imag:g})"
