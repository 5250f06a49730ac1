"""Factors by half angles: where a function of cosines and sines vanishes, component by component.

With C = cos(a/2) and S = sin(a/2), cos a = C^2 - S^2, sin a = 2 C S and 1 = C^2 + S^2 are forms in C and S.
Functions of an angle do not factor uniquely (sin^2 = (1 - cos)(1 + cos)), forms do: sin a = 2 C S separates
a = 0 from a = 180 degrees. Forms are kept in the ring of the functions: the generators of cos a and sin a
stand for C and S there.

An irreducible form has one generic rank on all its zeros, real and complex. So what holds at a point in
general position on it holds on all of it but for smaller sets.
"""

from collections.abc import Iterable, Sequence
from math import prod

import sympy as sp
from sympy.polys.rings import PolyElement

from ...model.algebra.ratios import conjugate, factored, generators_of
from .functions import Angle, Functions

LARGEST = 100  # most terms of a form that is factored
SQUARED = 40  # most terms of a polynomial whose square is examined


def halved(functions: Functions, polynomial: PolyElement) -> PolyElement:
    """Return the polynomial as a form in the cosine and sine of half of each of its angles."""
    for angle in _angles(functions, polynomial):
        C, S = functions.ring.gens[angle.cosine], functions.ring.gens[angle.sine]
        degrees = {powers: powers[angle.cosine] + powers[angle.sine] for powers in polynomial}
        most, total = max(degrees.values()), functions.ring.zero
        for powers, coefficient in polynomial.terms():
            rest = tuple(0 if k in (angle.cosine, angle.sine) else power for k, power in enumerate(powers))
            shape = (C**2 - S**2) ** powers[angle.cosine] * (2 * C * S) ** powers[angle.sine]
            total += (
                functions.ring.from_dict({rest: coefficient})
                * shape
                * (C**2 + S**2) ** (most - degrees[powers])
            )
        polynomial = total
    return polynomial


def doubled(functions: Functions, form: PolyElement) -> PolyElement | None:
    """Return the form as a polynomial in cosines and sines of the whole angles, up to a number;
    None if a degree is odd."""
    for angle in _angles(functions, form):
        c, s = functions.ring.gens[angle.cosine], functions.ring.gens[angle.sine]
        total = functions.ring.zero
        for powers, coefficient in form.terms():
            up, down = powers[angle.cosine], powers[angle.sine]
            if (up + down) % 2:
                return None
            rest = tuple(0 if k in (angle.cosine, angle.sine) else power for k, power in enumerate(powers))
            total += (
                functions.ring.from_dict({rest: coefficient})
                * (1 + c) ** (up // 2)
                * (1 - c) ** (down // 2)
                * s ** (up % 2)
            )
        form = total
    return functions.normal(form).primitive()[1]


def expression(functions: Functions, form: PolyElement) -> sp.Expr:
    """Return the form in coordinates: in whole angles if its degrees are even, else in half angles."""
    whole = doubled(functions, form)
    if whole is not None:
        return functions.expression(whole)
    named = list(functions.expressions)
    for angle in _angles(functions, form):
        named[angle.cosine], named[angle.sine] = sp.cos(angle.expression / 2), sp.sin(angle.expression / 2)
    return sp.Add(
        *[
            sp.Mul(sp.Integer(int(c)), *[named[k] ** power for k, power in enumerate(powers) if power])
            for powers, c in form.terms()
        ]
    )


def factors(functions: Functions, polynomial: PolyElement) -> list[tuple[PolyElement, int]]:
    """Return the irreducible forms whose product is the polynomial, up to a number, with their powers.

    They have positive leading terms. A polynomial that is too large is not factored.
    """
    powers: dict[PolyElement, int] = {}
    for whole, power in functions.factors(polynomial)[1]:
        form = halved(functions, whole)
        for part, times in components(form):
            powers[part] = powers.get(part, 0) + power * times
    return list(powers.items())


def components(form: PolyElement) -> list[tuple[PolyElement, int]]:
    """Return the irreducible factors of a form, up to a number, with their powers and with positive leading
    terms; one that is too large is its only factor."""
    parts = factored(form)[1] if len(form) <= LARGEST else [(form, 1)]
    return [(part if part.LC > 0 else -part, power) for part, power in parts]


def never_zero(functions: Functions, form: PolyElement) -> bool:
    """Whether the form is proved not to be zero at any real point.

    Its terms have one sign and do not vanish together; or it is quadratic in a generator, with a discriminant
    that is negative; or it has one unknown, and by Sturm's theorem no real zero.
    """
    return _definite(functions, form) != 0


def no_common_zero(functions: Functions, forms: Sequence[PolyElement]) -> bool:
    """Whether these are proved not to vanish together at a real point,
    by the sum of squares of those that are not too large."""
    squares = []
    for form in forms:
        whole = doubled(functions, form)
        if len(form if whole is None else whole) <= SQUARED:
            squares.append(doubled(functions, form**2) if whole is None else functions.times(whole, whole))
    total = functions.normal(sum(filter(None, squares), functions.ring.zero))
    return any(map(functions.never_zero, functions.forms(total))) or never_zero(
        functions, halved(functions, total)
    )


def product(functions: Functions, forms: Iterable[PolyElement]) -> PolyElement:
    """Return the product of forms."""
    return prod(forms, start=functions.ring.one)


def without_roots(functions: Functions, form: PolyElement) -> PolyElement:
    """Return the norm of the form, which has no square root of the ring and vanishes where the form does for
    some signs of the roots."""
    for place in sorted(generators_of(form) & set(functions.roots), reverse=True):
        radicand = functions.roots[place]
        gens, angles = functions.ring.gens, _angles(functions, radicand)
        one = product(
            functions, [(gens[a.cosine] ** 2 + gens[a.sine] ** 2) ** degree_of(radicand, a) for a in angles]
        )
        squared, radicand = form * conjugate(form, place), halved(functions, radicand)
        most, form = max(powers[place] for powers in squared) // 2, functions.ring.zero
        for powers, coefficient in squared.terms():
            rest, half = (*powers[:place], 0, *powers[place + 1 :]), powers[place] // 2
            form += functions.ring.from_dict({rest: coefficient}) * radicand**half * one ** (most - half)
    return form


def _angles(functions: Functions, polynomial: PolyElement) -> list[Angle]:
    """Return the angles whose cosine or sine occurs in the polynomial."""
    used = generators_of(polynomial)
    return [angle for angle in functions.angles if used & {angle.cosine, angle.sine}]


def degree_of(polynomial: PolyElement, angle: Angle) -> int:
    """Return the degree in cosine and sine of an angle."""
    return max((powers[angle.cosine] + powers[angle.sine] for powers in polynomial), default=0)


def _definite(functions: Functions, form: PolyElement) -> int:
    """Return 1 or -1 for a form proved to have this sign everywhere, else 0."""
    sign = functions.sign(form)
    if sign or not form or generators_of(form) & set(functions.roots):
        return sign
    unknown = [k for k in generators_of(form) if k not in functions.positive_places]
    angles = _angles(functions, form)
    for k in unknown:
        pair = next(((angle.cosine, angle.sine) for angle in angles if k in (angle.cosine, angle.sine)), (k,))
        if (
            max(sum(powers[place] for place in pair) for powers in form)
            == 2
            == max(powers[k] for powers in form)
        ):
            a, b, c = (_coefficient(form, pair, k, power) for power in (2, 1, 0))
            sign = _definite(functions, a)
            if sign and _definite(functions, 4 * a * c - b**2) == 1:
                return sign
    return _by_sturm(form, unknown, angles)


def _by_sturm(form: PolyElement, unknown: Sequence[int], angles: Sequence[Angle]) -> int:
    """Return the sign of a form in one coordinate, or one half angle, without parameters,
    that has no real zero; else 0."""
    pair = next((angle for angle in angles if set(unknown) <= {angle.cosine, angle.sine}), None)
    if generators_of(form) != set(unknown) or len(unknown) > 1 and pair is None:
        return 0
    place = pair.sine if pair else unknown[0]
    polynomial = sp.Poly.from_dict({(powers[place],): int(c) for powers, c in form.terms()}, sp.Dummy("t"))
    if pair and polynomial.degree() < degree_of(form, pair):
        return 0  # zero if the cosine of the half angle is
    return (
        int(sp.sign(polynomial.LC())) if polynomial.degree() % 2 == 0 and not polynomial.count_roots() else 0
    )


def _coefficient(form: PolyElement, pair: Sequence[int], place: int, power: int) -> PolyElement:
    """Of generator^power; the other one of an angle is set to 1."""
    terms = {
        tuple(0 if k in pair else p for k, p in enumerate(powers)): c
        for powers, c in form.terms()
        if powers[place] == power
    }
    return form.ring.from_dict(terms)
