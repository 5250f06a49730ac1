"""Exact evaluation at points of a field: a function that is not zero at a point is not zero."""

import random
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sympy import GF, QQ
from sympy.ntheory import sqrt_mod
from sympy.polys.domains import Domain
from sympy.polys.matrices import DomainMatrix
from sympy.polys.rings import PolyElement, ring

from ...model.algebra.ratios import factored, generators_of
from ...model.errors import ModelError
from .functions import Functions, Vector
from .half_angles import without_roots

PRIME = 2305712387343084721  # 1 modulo 8 and modulo the odd primes to 37: so -1 and all of them have roots
MODULAR = GF(PRIME)
TRIES = 64  # random points tried


class NoPoint(Exception):
    """No point was found that satisfies the conditions."""


@dataclass(frozen=True)
class Point:
    """A value of every generator in a field: a homomorphism from the functions, so ranks here are never above
    the generic.

    `halves` has the cosine and sine of half of each angle, up to a common factor, in place of those of the
    angle.
    """

    domain: Domain
    values: tuple
    halves: tuple

    def __call__(self, polynomial: PolyElement):
        """Return the value of a polynomial."""
        return self._value(polynomial, self.values)

    def on(self, form: PolyElement) -> bool:
        """Whether a form in half angles (`half_angles`) vanishes here."""
        return not self._value(form, self.halves)

    def _value(self, polynomial: PolyElement, generators: Sequence):
        if self.domain is not MODULAR:
            return _evaluated(polynomial, generators, self.domain.zero, self.domain)
        total, values = 0, [int(value) for value in generators]
        for powers, coefficient in polynomial.terms():
            term = int(coefficient)
            for value, power in zip(values, powers, strict=True):
                if power:
                    term = term * (value if power == 1 else pow(value, power, PRIME)) % PRIME
            total += term
        return self.domain(total)

    def matrix(self, vectors: Sequence[Vector]) -> DomainMatrix:
        """Return the vectors as rows."""
        return DomainMatrix(
            [[self(entry) for entry in v] for v in vectors], (len(vectors), len(vectors[0])), self.domain
        )

    def rank(self, vectors: Sequence[Vector]) -> int:
        """Return the rank of the vectors here."""
        return int(self.matrix(vectors).rank()) if vectors else 0


def random_point(
    functions: Functions, seed: int, vanishing: Sequence[PolyElement] = (), domain: Domain = MODULAR
) -> Point:
    """Return a random point, the same for the same seed, where the forms in half angles `vanishing`
    (`half_angles`) are zero.

    In QQ the sines and cosines are rational points of the circle. Raises NoPoint if none is found.
    """
    draw = random.Random(seed)
    for _ in range(TRIES):
        point = _try(functions, domain, draw, vanishing)
        if point is not None and all(map(point.on, vanishing)):
            return point
    raise NoPoint


def refuse_dependent_roots(functions: Functions) -> None:
    """Prove that no root lies in the field of the other generators before it and of roots of numbers.

    For each root, by a point where its radicand is not a square although the others are; roots of -1 and of
    different primes are independent. Raises ModelError if no such point is found.
    """
    for place, radicand in functions.roots.items():
        draw = random.Random(place)
        if radicand.is_ground:
            proved = sqrt_mod(int(radicand.LC) % PRIME, PRIME) is not None
        else:
            tries = (_try(functions, MODULAR, draw, before=place) for _ in range(TRIES))
            proved = any(point is not None and _root(point(radicand), MODULAR) is None for point in tries)
        if not proved:
            raise ModelError(
                f"{functions.name}: {functions.expressions[place]} cannot be treated beside the other "
                "functions, from which it seems to follow; write it without this root"
            )


def _try(
    functions: Functions,
    domain: Domain,
    draw: random.Random,
    vanishing: Sequence[PolyElement] = (),
    before: int | None = None,
) -> Point | None:
    """Try one point; the value is 0 for roots from the place `before` on."""

    def number():
        # Generic angles
        return QQ(draw.randint(2, 100), 101) if domain is QQ else domain(draw.randrange(2, PRIME))

    halves = [number() for _ in functions.expressions]
    for angle in functions.angles:
        halves[angle.cosine] = domain.one
    for place in functions.roots:
        halves[place] = domain.zero
    for form in vanishing:
        if not _move_to(without_roots(functions, form), functions, halves, domain, draw):
            return None
    values = list(halves)
    for angle in functions.angles:
        C, S = halves[angle.cosine], halves[angle.sine]
        length = C * C + S * S
        if not length:
            return None
        values[angle.cosine], values[angle.sine] = (C * C - S * S) / length, 2 * C * S / length
    for place, radicand in functions.roots.items():
        if place == before:
            break
        root = _root(Point(domain, tuple(values), tuple(halves))(radicand), domain)
        if not root:
            return None
        values[place] = halves[place] = draw.choice([root, -root])
    return Point(domain, tuple(values), tuple(halves))


def _move_to(
    zero: PolyElement, functions: Functions, halves: list, domain: Domain, draw: random.Random
) -> bool:
    """Change one value, or the tangent of a half angle, so that the form `zero` vanishes; return False if
    this is not possible."""
    places = generators_of(zero)
    on_angles = {k: angle for angle in functions.angles for k in (angle.cosine, angle.sine)}
    varying = [place for place in places if place >= functions.constants] or list(places)
    place = draw.choice(sorted(varying))
    unknown = ring("t", domain)[1]
    inserted = [unknown.ring(value) for value in halves]
    angle = on_angles.get(place)
    values: list[tuple[tuple[int, Any], ...]]  # places with what is put there
    if angle is None:
        inserted[place] = unknown
        values = [
            ((place, root),) for root in _zeros(_evaluated(zero, inserted, unknown.ring.zero, domain), domain)
        ]
    else:
        inserted[angle.cosine], inserted[angle.sine] = unknown.ring.one, unknown
        polynomial = _evaluated(zero, inserted, unknown.ring.zero, domain)
        values = [((angle.cosine, domain.one), (angle.sine, root)) for root in _zeros(polynomial, domain)]
        if polynomial.degree() < max(powers[angle.cosine] + powers[angle.sine] for powers in zero):
            values.append(((angle.cosine, domain.zero), (angle.sine, domain.one)))
    if not values:
        return False
    for k, value in draw.choice(values):
        halves[k] = value
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


def _zeros(polynomial: PolyElement, domain: Domain) -> list:
    """Return the zeros in the field of a polynomial in one unknown."""
    if not polynomial:
        return []
    factors = factored(polynomial)[1]
    return [-factor.coeff(1) / factor.LC for factor, _ in factors if factor.degree() == 1]


def _root(value, domain: Domain):
    """Return a square root in the field, or None."""
    if domain is QQ:
        return QQ.exsqrt(value) if value >= 0 else None
    if not value:
        return domain.zero
    root = sqrt_mod(int(value) % PRIME, PRIME)
    return None if root is None else domain(root)
