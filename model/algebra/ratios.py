"""Ratios of polynomials with exact coefficients: rational operations,
with size limits that keep them fast."""

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

import casadi as ca
import flint
from sympy import QQ
from sympy.polys.rings import PolyElement, PolyRing

TERMS, DEGREE = 100, 64  # of a polynomial; larger ones take too long to divide and to factor
SIMPLE = 10**5  # largest denominator of a float that is interpreted as a fraction
DIGITS = 12  # significant digits of a float that is interpreted as a decimal
ULPS = 4  # assumed rounding error of a float
# a sum of decimals below this, relative to its largest term, is regarded as rounding error
NOISE = QQ(1, 10**14)
LARGEST_WHOLE = 1000  # as a coefficient
Ratio = tuple[PolyElement, PolyElement]


class NotRational(Exception):
    """Not an element of a field of rational functions, or too large for exact simplification."""


@dataclass(frozen=True)
class Radical:
    """A generator whose square is known: numerator / denominator, in earlier generators."""

    place: int
    numerator: PolyElement
    denominator: PolyElement


def exact(value: float) -> QQ:
    """Return the rational number that a float represents.

    It is a simple fraction such as 1/3 or a decimal of at most DIGITS digits, if there is one within the
    rounding error of a few operations (0.2 is 1/5, and so is 0.1 * 2; 0.1 + 0.2 is 3/10), else the shortest
    decimal that rounds to the float. Raises NotRational for a value that is not finite.
    """
    if not math.isfinite(value):
        raise NotRational
    written = Fraction(repr(float(value)))
    near = Fraction(f"{value:.{DIGITS - 1}e}"), Fraction(value).limit_denominator(SIMPLE)
    fraction = next(
        (each for each in near if abs(each - written) <= ULPS * Fraction(math.ulp(value))), written
    )
    return QQ(fraction.numerator, fraction.denominator)


def number(coefficient: QQ) -> float:
    """Return the nearest float. Raises NotRational if the exact number is too large or too small for one."""
    try:
        value = float(Fraction(int(coefficient.numerator), int(coefficient.denominator)))
    except OverflowError as error:
        raise NotRational from error
    if abs(value) < sys.float_info.min:
        raise NotRational
    return value


def normalized(polynomial: PolyElement) -> tuple[QQ, PolyElement]:
    """Return a factor, and the polynomial divided by it, with short coefficients of magnitude near 1.

    Integer coefficients up to LARGEST_WHOLE are unchanged; otherwise the polynomial is divided by one of its
    coefficients.
    """
    coefficients = list(polynomial.values())
    if all(c.denominator == 1 and abs(c) <= LARGEST_WHOLE for c in coefficients):
        return QQ(1), polynomial
    scale = min(coefficients, key=lambda c: sum(len(repr(number(other / c))) for other in coefficients))
    return scale, polynomial.quo_ground(scale)


def plus(a: PolyElement, b: PolyElement) -> PolyElement:
    """Return the sum, without terms that are only rounding errors of decimals that cancel."""
    total = a + b
    if _is_simple(total):
        return total
    return _without_noise(total, lambda powers: abs(a.get(powers, 0)))


def times(a: PolyElement, b: PolyElement) -> PolyElement:
    """Return the product, as `plus` does. Raises NotRational if it is too large."""
    if len(a) * len(b) > TERMS * TERMS:
        raise NotRational
    product = a if b == b.ring.one else b if a == a.ring.one else a * b
    if len(a) > 1 and len(b) > 1 and not _is_simple(product):
        sizes = _sizes(a) * _sizes(b)
        product = _without_noise(product, sizes.__getitem__)
    if len(product) > TERMS or max(map(sum, product), default=0) > DEGREE:
        raise NotRational
    return product


def _is_simple(polynomial: PolyElement) -> bool:
    return all(coefficient.denominator <= SIMPLE for coefficient in polynomial.values())


def _sizes(polynomial: PolyElement) -> PolyElement:
    return polynomial.ring.from_dict({powers: abs(coefficient) for powers, coefficient in polynomial.items()})


def _without_noise(total: PolyElement, size: Callable[[tuple[int, ...]], QQ]) -> PolyElement:
    """Return the polynomial without coefficients that are negligible relative to the terms of which they are
    sums."""
    return total.ring.from_dict({powers: c for powers, c in total.items() if abs(c) >= NOISE * size(powers)})


def size(numerator: PolyElement, denominator: PolyElement) -> tuple[int, int]:
    """Return (number of terms, total degree)."""
    return len(numerator) + len(denominator), sum(map(sum, numerator)) + sum(map(sum, denominator))


def in_lowest_terms(numerator: PolyElement, denominator: PolyElement) -> Ratio:
    """Return numerator.cancel(denominator), computed in the ring of the generators that occur.

    The others do not matter, but SymPy's greatest common divisor evaluates them one after the other, each
    with a larger number.
    """
    whole, used = numerator.ring, tuple(sorted(generators_of(numerator) | generators_of(denominator)))
    above, below = _restricted(numerator, used).cancel(_restricted(denominator, used))
    return _lifted(above, whole, used), _lifted(below, whole, used)


def _restricted(polynomial: PolyElement, used: tuple[int, ...]) -> PolyElement:
    """Return the polynomial in the ring of these generators, all that it has; unchanged if there are none."""
    if not used:
        return polynomial
    return _smaller(polynomial.ring, used).from_dict(
        {tuple(powers[k] for k in used): c for powers, c in polynomial.items()}
    )


def _lifted(polynomial: PolyElement, whole: PolyRing, used: tuple[int, ...]) -> PolyElement:
    """Return a polynomial in these generators in the whole ring."""
    if polynomial.ring == whole:
        return polynomial
    lifted = {}
    for powers, coefficient in polynomial.items():
        place = [0] * whole.ngens
        for k, power in zip(used, powers, strict=True):
            place[k] = power
        lifted[tuple(place)] = coefficient
    return whole.from_dict(lifted)


@lru_cache(maxsize=4096)
def _smaller(whole: PolyRing, used: tuple[int, ...]) -> PolyRing:
    return PolyRing([whole.symbols[k] for k in used], whole.domain, whole.order)


@lru_cache(maxsize=4096)
def factored(polynomial: PolyElement) -> tuple[QQ, tuple[tuple[PolyElement, int], ...]]:
    """Return the content and the irreducible factors with their powers, in SymPy's order, found by FLINT,
    which takes seconds for polynomials for which SymPy takes minutes.
    """
    ring = polynomial.ring
    if ring.domain.is_FiniteField:
        content, factors = polynomial.factor_list()
        return content, tuple(factors)
    scale = math.lcm(*(int(c.denominator) for c in polynomial.values()))
    context = flint.fmpz_mpoly_ctx.get([f"x{k}" for k in range(ring.ngens)], "lex")
    content, factors = context.from_dict(
        {powers: int(c * scale) for powers, c in polynomial.items()}
    ).factor()
    made = [(_of_flint(ring, factor), int(power)) for factor, power in factors]
    made.sort(key=lambda pair: (pair[0].degree(), pair[1], pair[0].to_dense()))
    return ring.domain(int(content)) / scale, tuple(made)


def _of_flint(ring: PolyRing, polynomial: flint.fmpz_mpoly) -> PolyElement:
    terms = polynomial.to_dict().items()
    return ring.from_dict(
        {tuple(map(int, powers)): ring.domain(int(coefficient)) for powers, coefficient in terms}
    )


def generators_of(polynomial: PolyElement) -> set[int]:
    """Return the indices of the generators in the polynomial."""
    return {k for powers in polynomial for k, power in enumerate(powers) if power}


def without_squares(polynomial: PolyElement, radical: Radical) -> tuple[PolyElement, int]:
    """Return a polynomial with at most the first power of the radical,
    and the power of radical.denominator to divide it by."""
    if all(powers[radical.place] < 2 for powers in polynomial):
        return polynomial, 0
    parts = by_squares(polynomial, radical.place)
    most = len(parts) - 1
    reduced = polynomial.ring.zero
    for half, part in enumerate(parts):
        if part:
            square = radical.numerator**half * radical.denominator ** (most - half)
            reduced = plus(reduced, times(part, square))
    return reduced, most


def by_squares(polynomial: PolyElement, place: int) -> list[PolyElement]:
    """Polynomials with at most the first power of a generator: the given one is their sum,
    the k-th times generator^(2 k)."""
    parts: list[dict[tuple[int, ...], QQ]] = [
        {} for _ in range(max((powers[place] for powers in polynomial), default=0) // 2 + 1)
    ]
    for powers, coefficient in polynomial.items():
        half, rest = divmod(powers[place], 2)
        parts[half][(*powers[:place], rest, *powers[place + 1 :])] = coefficient
    return [polynomial.ring.from_dict(part) for part in parts]


def conjugate(polynomial: PolyElement, place: int) -> PolyElement:
    """The polynomial with the other sign of a generator."""
    return polynomial.ring.from_dict(
        {powers: -c if powers[place] % 2 else c for powers, c in polynomial.items()}
    )


def _add(a: Ratio, b: Ratio) -> Ratio:
    if a[1] == b[1]:
        return plus(a[0], b[0]), a[1]
    return plus(times(a[0], b[1]), times(b[0], a[1])), times(a[1], b[1])


# Steps that are not operations of CasADi.
SYMBOL, CONSTANT, POWER = "symbol", "constant", "power"

RATIONAL: dict[int, Callable[..., Ratio]] = {
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
