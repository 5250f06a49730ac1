"""A course: a smooth curve given by its curvature over its length, and a point that moves on it at constant
speed.

Between the places where the curvature is given it changes as a polynomial whose first four derivatives vanish
at both ends, so that all derivatives of the position up to order 6 are continuous: an output of that relative
degree can follow it exactly. The curvature of a clothoid has a rate that jumps, which no torque at a steered
wheel can follow. With a `rounding` the parts are lines, arcs and clothoids, and only within half that length
of where two of them meet the rate changes smoothly instead. Before the beginning the first curvature stays.
There the rate jumps if a course with a rounding begins with a clothoid.

Parts of negative length are driven in reverse. Where the sign changes is a cusp: the direction of the course
continues, so that a vehicle stops there, and drives back with its heading, its steering angle and the angles
of its hitches as they are.
"""

import itertools
import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...model.algebra.trigonometry import sine_cosine
from ...readers.errors import BadInput

NEAR = 0.2  # m: between the places from which the search of the nearest one begins
MOST = 200_000  # of these places
STEPS, ENOUGH = 20, 1e-13  # of Newton's method, as in noslip_course.h; relative change at which it ends
FLATTEST = 0.1  # likewise: how near a point may be to the centre of curvature, in radii
# Intervals of the quadrature, 1 on clothoids, and one more for each radian: an error of 2e-14 m (300 random
# courses)
LEAST = 3
NODES = (  # of Gauss and Legendre on [-1, 1] with 8 points, positive ones: place, weight
    (0.18343464249564980494, 0.36268378337836198297),
    (0.52553240991632898582, 0.31370664587788728734),
    (0.79666647741362673959, 0.22238103445337447054),
    (0.96028985649753623168, 0.10122853629037625915),
)


Polynomial = tuple[float, ...]  # coefficients by power
# Length in m, negative in reverse; curvature in 1/m as a polynomial in the part of the length
Part = tuple[float, Polynomial]
# Coefficients of the change from 0 at 0 to 1 at 1
BLEND = (0.0, 0.0, 0.0, 0.0, 0.0, 126.0, -420.0, 540.0, -315.0, 70.0)
# Integral of such a change with three derivatives, 1/2 at 1
RISE = (0.0, 0.0, 0.0, 0.0, 0.0, 7.0, -14.0, 10.0, -2.5)


def value(coefficients: Sequence[float], u: float, order: int = 0) -> float:
    """Return the derivative of an order of a polynomial at u; order -1: its integral from 0."""
    total = 0.0
    for power in range(len(coefficients) - 1, max(order, 0) - 1, -1):
        factor = 1.0 / (power + 1) if order < 0 else math.perm(power, order)
        total = total * u + factor * coefficients[power]
    return total * u if order < 0 else total


def blended(first: float, last: float) -> Polynomial:
    """Return the coefficients of a change from `first` at 0 to `last` at 1."""
    return (first, *[(last - first) * c for c in BLEND[1:]]) if last != first else (first,)


def rounded(first: float, before: float, after: float) -> Polynomial:
    """Return the coefficients of a polynomial that is `first` at 0,
    and whose rate changes from `before` at 0 to `after` at 1."""
    return (first, before, *[(after - before) * c for c in RISE[2:]])


@dataclass(frozen=True)
class Stretch:
    """A part of a course from `begin` on, m: the direction of travel there (rad), its `length` (m), and the
    coefficients of its curvature (1/m, positive to the left of travel) as a polynomial in the part of the
    length; `backward`: whether it is driven in reverse. Before its beginning the curvature is that of the
    beginning.
    """

    begin: float
    heading: float
    length: float
    coefficients: Polynomial
    backward: bool = False

    def curvature(self, at: float, order: int = 0) -> float:
        """Return the derivative of an order of the curvature, 1/m^(1 + order), `at` m after its beginning."""
        return value(self._polynomial(at), at / self.length, order) / math.prod([self.length] * order)

    def largest(self, at: float) -> float:
        """Return a bound of the magnitude of the curvature up to `at` m after its beginning, 1/m: those at
        both ends, and in between that of lines in the directions of the curvature there, as before rounding.
        """
        first, *others = self.coefficients
        return max(abs(first), abs(first + sum(others[:1]) / 2.0), abs(self.curvature(at)))

    def direction(self, at: float) -> float:
        """Return the direction, rad, `at` m after its beginning."""
        return self.heading + self.length * value(self._polynomial(at), at / self.length, -1)

    def _polynomial(self, at: float) -> Polynomial:
        return self.coefficients[:1] if at < 0.0 else self.coefficients


@dataclass(frozen=True)
class SmoothCurve:
    """From (x, y) in m in the direction `heading` (rad): `curvatures` (1/m, positive turns left) at the
    beginning of the first of the `lengths` (m) and at the end of each; before the first and after the last
    the curvature stays. `speed`, m/s, along it. Parts of negative length lead back, against the direction.
    Lengths along the course, its direction and its curvature are those of travel.

    With a `rounding` (m, at most the shortest of the lengths) the curvature is linear over each part, except
    within half of it of where parts meet and where the last ends; without, it changes smoothly over the whole
    of each part.
    """

    x: float
    y: float
    heading: float
    speed: float
    lengths: tuple[float, ...]
    curvatures: tuple[float, ...]
    rounding: float = 0.0

    @cached_property
    def stretches(self) -> tuple[Stretch, ...]:
        """The parts; the last of each piece leads on from its end, without one of its own."""
        found: list[Stretch] = []
        for signed, coefficients in self._parts() or [(1.0, self.curvatures)]:
            backward, length = signed < 0.0, abs(signed)
            begin, heading = 0.0, self.heading + math.pi * backward
            if found:
                last = found[-1]
                turn = math.pi if backward else -math.pi
                cusp = backward != last.backward
                begin = last.begin + (0.0 if cusp else last.length)
                heading = last.heading + turn if cusp else last.direction(last.length)
            found.append(
                Stretch(begin, heading, length, tuple(-c if backward else c for c in coefficients), backward)
            )
        return tuple(found)

    @property
    def way(self) -> float:
        """Its length in m, forward and in reverse."""
        return sum(map(abs, self.lengths))

    @property
    def cusps(self) -> int:
        """How many there are."""
        return len(self.pieces) - 1

    @cached_property
    def pieces(self) -> tuple["SmoothCurve", ...]:
        """The courses from cusp to cusp."""
        ends = [k + 1 for k in range(len(self.lengths)) if self._ends(k)] or [0]
        stretches, pieces, begin = self.stretches, [], 0
        first = [
            0,
            *[k + 1 for k, (a, b) in enumerate(itertools.pairwise(stretches)) if a.backward != b.backward],
        ]
        for k, end in zip(first, ends, strict=True):
            x, y = self._places[k].real, self._places[k].imag
            heading = stretches[k].heading - math.pi * stretches[k].backward
            lengths, curvatures = self.lengths[begin:end], self.curvatures[begin : end + 1]
            pieces.append(replace(self, x=x, y=y, heading=heading, lengths=lengths, curvatures=curvatures))
            begin = end
        return tuple(pieces)

    def _ends(self, part: int) -> bool:
        """Whether a part ends at a cusp, or with the course."""
        return part + 1 == len(self.lengths) or (self.lengths[part] < 0.0) != (self.lengths[part + 1] < 0.0)

    def _parts(self) -> list[Part]:
        """Return lengths and polynomials of all parts, and of what leads on from the ends of pieces."""
        parts: list[Part] = []
        for k, signed in enumerate(self.lengths):
            way = math.copysign(1.0, signed)
            parts += [
                (way * length, c) for length, c in (self._rounded(k) if self.rounding else self._blended(k))
            ]
            parts += [(way, self.curvatures[k + 1 : k + 2])] if self._ends(k) else []
        return parts

    def _blended(self, k: int) -> list[Part]:
        """Return length and polynomial of a part over which the curvature changes smoothly."""
        return [(abs(self.lengths[k]), blended(self.curvatures[k], self.curvatures[k + 1]))]

    def _rounded(self, k: int) -> list[Part]:
        """Return lengths and polynomials of a line, arc or clothoid,
        and of what is between it and the next."""
        half, ends, slope = self.rounding / 2, self._ends(k), self._slope(k)
        cusp, after = ends and k + 1 < len(self.lengths), 0.0 if ends else self._slope(k + 1)
        begin = half if k > 0 and not self._ends(k - 1) else 0.0
        straight, last = abs(self.lengths[k]) - begin - (0.0 if cusp else half), self.curvatures[k + 1]
        own: Polynomial = (self.curvatures[k] + slope * begin, slope * straight)
        parts = [(straight, own)] if straight > 0.0 else []
        joint = (self.rounding, rounded(last - slope * half, slope * self.rounding, after * self.rounding))
        return parts if cusp else [*parts, joint]

    def _slope(self, k: int) -> float:
        """Return the rate of the curvature of a part, 1/m^2, before rounding."""
        return (self.curvatures[k + 1] - self.curvatures[k]) / abs(self.lengths[k])

    def direction(self, length: float) -> float:
        """Return the direction of travel at a length along the course, rad."""
        stretch = self.stretches[self._part(length)]
        return stretch.direction(length - stretch.begin)

    def bend(self, length: float, order: int = 0) -> float:
        """Return the derivative of an order of the curvature, 1/m^(1 + order), at `length` m."""
        stretch = self.stretches[self._part(length)]
        return stretch.curvature(length - stretch.begin, order)

    def position(self, length: float) -> complex:
        """Return x + i y at a length along the course, m."""
        k = self._part(length)
        return self._places[k] + self._moved(self.stretches[k], length - self.stretches[k].begin)

    def derivatives(self, t: float, order: int) -> np.ndarray:
        """Return x + i y and its derivatives up to `order` at time t, m, m/s, ..."""
        length = self.speed * t
        stretch = self.stretches[self._part(length)]
        at = length - stretch.begin
        s, c = sine_cosine(stretch.direction(at))
        rates = [math.prod([self.speed] * (k + 1)) * stretch.curvature(at, k) for k in range(order - 1)]
        forward = [complex(c, s)]  # e^(i direction) and its derivatives
        for n in range(order - 1):
            forward.append(1j * sum(math.comb(n, k) * rates[k] * forward[n - k] for k in range(n + 1)))
        return np.array([self.position(length), *[self.speed * each for each in forward[:order]]])

    def nearest(self, point: complex, near: float | None = None) -> float:
        """Return the length along the course, which has no cusp, at which it is nearest to a point x + i y,
        m, by Newton's method from the length `near`; without one, from the nearest of places that are NEAR
        apart. NaN if the point is as far as the centre of curvature, or too far ahead, by the rule of
        noslip_course_nearest. Raises BadInput as `_scanned` does.
        """
        length = self._scanned(point) if near is None else near
        for _ in range(STEPS):
            stretch = self.stretches[self._part(length)]
            s, c = sine_cosine(stretch.direction(length - stretch.begin))
            off = (point - self.position(length)) * complex(c, -s)  # ahead, and to the left
            slope = 1.0 - stretch.curvature(length - stretch.begin) * off.imag
            if not slope > FLATTEST:
                break
            step = off.real / slope
            length += step
            if abs(step) <= ENOUGH * max(1.0, abs(length)):
                return length
        return math.nan

    def _scanned(self, point: complex) -> float:
        """Return the length at the nearest of places that are NEAR apart. Those are left out that are too
        near to a far one. Raises BadInput if more than MOST are left.
        """
        last, k, at, place, nearest, least = (
            1 + int(self.stretches[-1].begin / NEAR),
            0,
            0.0,
            self.position(0.0),
            0,
            math.inf,
        )
        for _ in range(MOST):
            off = abs(point - place)
            if off < least:
                nearest, least = k, off
            k += max(1, int((off - least) / NEAR))
            if k > last:
                return nearest * NEAR
            at, place = k * NEAR, self._further(place, at, k * NEAR)
        raise BadInput(
            f"the course is {self.stretches[-1].begin:g} m long: its place nearest to the start is not found "
            f"among {MOST} places that are {NEAR:g} m apart; take a shorter course"
        )

    def _further(self, place: complex, at: float, length: float) -> complex:
        """Return the position at a length, given the `place` at a smaller one."""
        k = self._part(length)
        stretch = self.stretches[k]
        same = k == self._part(at)
        return (
            place + self._moved(stretch, length - stretch.begin, at - stretch.begin)
            if same
            else self.position(length)
        )

    def _part(self, length: float) -> int:
        """The number of the part at a length; before the beginning the first."""
        return bisect_right(self._begins, length)

    @cached_property
    def _begins(self) -> list[float]:
        """Where the parts after the first begin, m."""
        return [stretch.begin for stretch in self.stretches[1:]]

    @cached_property
    def _places(self) -> list[complex]:
        """The position at the beginning of each part."""
        places = [complex(self.x, self.y)]
        for stretch, after in zip(self.stretches, self.stretches[1:], strict=False):
            moved = 0j if after.backward != stretch.backward else self._moved(stretch, stretch.length)
            places.append(places[-1] + moved)
        return places

    @staticmethod
    def _moved(stretch: Stretch, length: float, start: float = 0.0) -> complex:
        """Return how far the course goes within a part, by the quadrature of Gauss and Legendre over each
        radian of the turn."""
        count = (LEAST if len(stretch.coefficients) > 2 else 1) + int(
            abs(length - start) * stretch.largest(length)
        )
        half, total = (length - start) / count / 2, 0j
        for k in range(count):
            middle = start + (2 * k + 1) * half
            for place, weight in NODES:
                for at in (middle - place * half, middle + place * half):
                    s, c = sine_cosine(stretch.direction(at))
                    total += weight * half * complex(c, s)
        return total
