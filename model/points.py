"""Exact evaluation at points of a field: what is not zero at a point is not zero."""

import random
from collections.abc import Sequence
from dataclasses import dataclass

from sympy import GF, QQ
from sympy.ntheory import sqrt_mod
from sympy.polys.domains import Domain
from sympy.polys.matrices import DomainMatrix
from sympy.polys.rings import PolyElement, ring

from .errors import ModelError
from .functions import Functions, Vector
from .ratios import factored, generators_of

PRIME = 2305712387343084721  # 1 modulo 8 and modulo the odd primes to 37: so -1 and all of them have roots
MODULAR = GF(PRIME)
TRIES = 64  # random points looked at until one serves


class NoPoint(Exception):
    """No point was found that meets the conditions."""


@dataclass(frozen=True)
class Point:
    """A value of every generator in a field: a homomorphism from the functions, so ranks here are never above the generic."""

    domain: Domain
    values: tuple

    def __call__(self, polynomial: PolyElement):
        """The value of a polynomial."""
        if self.domain is not MODULAR:
            return _evaluated(polynomial, self.values, self.domain.zero, self.domain)
        total, values = 0, [int(value) for value in self.values]
        for powers, coefficient in polynomial.terms():
            term = int(coefficient)
            for value, power in zip(values, powers, strict=True):
                if power:
                    term = term * (value if power == 1 else pow(value, power, PRIME)) % PRIME
            total += term
        return self.domain(total)

    def matrix(self, vectors: Sequence[Vector]) -> DomainMatrix:
        """The vectors as rows."""
        return DomainMatrix([[self(entry) for entry in v] for v in vectors], (len(vectors), len(vectors[0])), self.domain)

    def rank(self, vectors: Sequence[Vector]) -> int:
        """Rank of the vectors here."""
        return int(self.matrix(vectors).rank()) if vectors else 0


def random_point(functions: Functions, seed: int, vanishing: Sequence[PolyElement] = (), domain: Domain = MODULAR) -> Point:
    """A random point, the same for the same seed, where the polynomials `vanishing` are zero.

    In QQ the sines and cosines are rational points of the circle. Raises NoPoint when none is found.
    """
    draw = random.Random(seed)
    for _ in range(TRIES):
        values = _values(functions, domain, draw, vanishing)
        if values is not None and not any(map(Point(domain, values), vanishing)):
            return Point(domain, values)
    raise NoPoint


def refuse_dependent_roots(functions: Functions) -> None:
    """Prove that no root lies in the field of the other generators before it and of roots of numbers.

    Each time by a point where its radicand is no square though the others are; roots of -1 and of different primes are
    independent. Raises ModelError when no such point is found.
    """
    for place, radicand in functions.roots.items():
        draw = random.Random(place)
        if radicand.is_ground:
            proved = sqrt_mod(int(radicand.LC) % PRIME, PRIME) is not None
        else:
            tries = (_values(functions, MODULAR, draw, before=place) for _ in range(TRIES))
            proved = any(values is not None and _root(Point(MODULAR, values)(radicand), MODULAR) is None for values in tries)
        if not proved:
            raise ModelError(
                f"{functions.name}: {functions.expressions[place]} cannot be treated beside the other functions, from which it "
                "seems to follow; write it without this root"
            )


def _values(
    functions: Functions, domain: Domain, draw: random.Random, vanishing: Sequence[PolyElement] = (), before: int | None = None
) -> tuple | None:
    """One try: values of the generators, 0 for roots from the place `before` on."""

    def number():
        return QQ(draw.randint(2, 100), 101) if domain is QQ else domain(draw.randrange(2, PRIME))  # no angle is special

    values = [number() for _ in functions.expressions]
    for angle in functions.angles:
        if angle.sine is not None:
            point = on_circle(number(), domain)
            if point is None:
                return None
            values[angle.cosine], values[angle.sine] = point
    for place in functions.roots:
        values[place] = domain.zero
    for free_of_roots in vanishing:
        for place in reversed(functions.roots):
            if place in generators_of(free_of_roots):
                free_of_roots = functions.times(free_of_roots, functions.conjugate(free_of_roots, place))
        if not _move_to(free_of_roots, functions, values, domain, draw):
            return None
    for place, radicand in functions.roots.items():
        if place == before:
            break
        root = _root(Point(domain, tuple(values))(radicand), domain)
        if not root:
            return None
        values[place] = draw.choice([root, -root])
    return tuple(values)


def _move_to(zero: PolyElement, functions: Functions, values: list, domain: Domain, draw: random.Random) -> bool:
    """Change one value, or a cosine with its sine, so that `zero` vanishes; False when that does not work out."""
    places = generators_of(zero)
    on_angles = {place: angle for angle in functions.angles for place in (angle.cosine, angle.sine)}
    varying = [place for place in places if place >= functions.constants] or list(places)
    place = draw.choice(sorted(varying))
    angle = on_angles.get(place)
    unknown = ring("t", domain)[1]
    inserted = [unknown.ring(value) for value in values]
    if angle is None or angle.sine is None:
        inserted[place] = unknown
        roots = _zeros(_evaluated(zero, inserted, unknown.ring.zero, domain), domain)
        if not roots:
            return False
        values[place] = draw.choice(roots)
        return True
    # cos = (1 - t^2)/(1 + t^2), sin = 2t/(1 + t^2); t infinite is the cosine -1.
    degree = max(powers[angle.cosine] + powers[angle.sine] for powers in zero)
    total = unknown.ring.zero
    for powers, coefficient in zero.terms():
        rest = [0 if k in (angle.cosine, angle.sine) else power for k, power in enumerate(powers)]
        c, s = powers[angle.cosine], powers[angle.sine]
        factor = (1 - unknown**2) ** c * (2 * unknown) ** s * (1 + unknown**2) ** (degree - c - s)
        total += _evaluated(zero.ring.from_dict({tuple(rest): coefficient}), inserted, unknown.ring.zero, domain) * factor
    points = [on_circle(t, domain) for t in _zeros(total, domain)]
    if total.degree() < 2 * degree:
        points.append((-domain.one, domain.zero))
    points = [point for point in points if point is not None]
    if not points:
        return False
    values[angle.cosine], values[angle.sine] = draw.choice(points)
    return True


def _evaluated(polynomial: PolyElement, values: Sequence, zero, domain: Domain):
    total = zero
    for powers, coefficient in polynomial.terms():
        term = zero + domain(coefficient)
        for value, power in zip(values, powers, strict=True):
            if power:
                term *= value**power
        total += term
    return total


def on_circle(t, domain: Domain) -> tuple | None:
    """Cosine and sine by the tangent of the half angle."""
    length = 1 + t * t
    return ((1 - t * t) / length, 2 * t / length) if length else None


def _zeros(polynomial: PolyElement, domain: Domain) -> list:
    """Zeros of a polynomial in one unknown that lie in the field."""
    if not polynomial:
        return []
    factors = factored(polynomial)[1]
    return [-factor.coeff(1) / factor.LC for factor, _ in factors if factor.degree() == 1]


def _root(value, domain: Domain):
    """A square root in the field, or None."""
    if domain is QQ:
        return QQ.exsqrt(value) if value >= 0 else None
    if not value:
        return domain.zero
    found = sqrt_mod(int(value) % PRIME, PRIME)
    return None if found is None else domain(found)
