"""Ratios of polynomials with exact coefficients: the rational operations, within bounds that keep them quick."""

import sys
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

import casadi as ca
from sympy import QQ
from sympy.polys.polyconfig import using
from sympy.polys.rings import PolyElement

TERMS, DEGREE = 100, 64  # of a polynomial; more take too long to divide and to factor
PLACES = 12  # random ones at which a polynomial is factored first
Ratio = tuple[PolyElement, PolyElement]


class NotRational(Exception):
    """Not an element of a field of rational functions, or one too large to be worth the trouble."""


@dataclass(frozen=True)
class Radical:
    """A generator whose square is known: numerator / denominator, in generators found before it."""

    place: int
    numerator: PolyElement
    denominator: PolyElement


def exact(value: float) -> QQ:
    """The rational number that a float is. Raises NotRational when it is none."""
    try:
        fraction = Fraction(value)
    except (OverflowError, ValueError) as error:  # infinite, not a number
        raise NotRational from error
    return QQ(fraction.numerator, fraction.denominator)


def number(coefficient: QQ) -> float:
    """The nearest float. Raises NotRational when the exact number is too large or too small for one."""
    try:
        value = float(Fraction(int(coefficient.numerator), int(coefficient.denominator)))
    except OverflowError as error:
        raise NotRational from error
    if abs(value) < sys.float_info.min:
        raise NotRational
    return value


def times(a: PolyElement, b: PolyElement) -> PolyElement:
    """The product. Raises NotRational when it is too large."""
    if len(a) * len(b) > TERMS * TERMS:
        raise NotRational
    product = a * b
    if len(product) > TERMS or max(map(sum, product), default=0) > DEGREE:
        raise NotRational
    return product


def size(numerator: PolyElement, denominator: PolyElement) -> tuple[int, int]:
    """Terms, then degrees."""
    return len(numerator) + len(denominator), sum(map(sum, numerator)) + sum(map(sum, denominator))


@lru_cache(maxsize=4096)
def factored(polynomial: PolyElement) -> tuple[QQ, tuple[tuple[PolyElement, int], ...]]:
    """Content and irreducible factors with their powers.

    Factors are built up from those at a random place. Where it has more there, that takes a minute and is in vain: with the
    three places that SymPy looks at, once in some hundred polynomials of 40 terms; with PLACES not in many thousand.
    """
    with using(EEZ_NUMBER_OF_CONFIGS=PLACES):
        content, factors = polynomial.factor_list()
    return content, tuple(factors)


def generators_of(polynomial: PolyElement) -> set[int]:
    """Places of the generators that the polynomial has."""
    return {k for powers in polynomial for k, power in enumerate(powers) if power}


def without_squares(polynomial: PolyElement, radical: Radical) -> tuple[PolyElement, int]:
    """A polynomial with at most the first power of the radical, and the power of radical.denominator to divide it by."""
    most = max((powers[radical.place] for powers in polynomial), default=0) // 2
    if not most:
        return polynomial, 0
    reduced = polynomial.ring.zero
    for half in range(most + 1):
        terms = {
            (*powers[: radical.place], powers[radical.place] % 2, *powers[radical.place + 1 :]): coefficient
            for powers, coefficient in polynomial.items()
            if powers[radical.place] // 2 == half
        }
        if terms:
            square = radical.numerator**half * radical.denominator ** (most - half)
            reduced += times(polynomial.ring.from_dict(terms), square)
    return reduced, most


def _add(a: Ratio, b: Ratio) -> Ratio:
    if a[1] == b[1]:
        return a[0] + b[0], a[1]
    return times(a[0], b[1]) + times(b[0], a[1]), times(a[1], b[1])


# Steps that are no operation of CasADi's.
SYMBOL, CONSTANT, POWER = "symbol", "constant", "power"

RATIONAL = {
    SYMBOL: None,
    CONSTANT: None,
    POWER: None,
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: _add,
    ca.OP_SUB: lambda a, b: _add(a, (-b[0], b[1])),
    ca.OP_MUL: lambda a, b: (times(a[0], b[0]), times(a[1], b[1])),
    ca.OP_DIV: lambda a, b: (times(a[0], b[1]), times(a[1], b[0])),
    ca.OP_NEG: lambda a: (-a[0], a[1]),
    ca.OP_SQ: lambda a: (times(a[0], a[0]), times(a[1], a[1])),
    ca.OP_TWICE: lambda a: (2 * a[0], a[1]),
    ca.OP_INV: lambda a: (a[1], a[0]),
}
