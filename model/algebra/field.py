"""The field of rational functions that contains one expression, with its sines, cosines and roots."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import prod
from typing import Any

import casadi as ca
from sympy import QQ
from sympy.polys.rings import PolyElement, ring

from .expression import fold, free_symbols, operate
from .operations import LARGEST_POWER
from .ratios import (
    CONSTANT,
    LARGEST_WHOLE,
    POWER,
    RATIONAL,
    SYMBOL,
    NotRational,
    Radical,
    Ratio,
    conjugate,
    exact,
    factored,
    generators_of,
    in_lowest_terms,
    normalized,
    number,
    size,
    times,
    without_squares,
)

# (operation, indices of its arguments), (SYMBOL, k), (CONSTANT, value), (POWER, index, n)
Step = tuple[Any, ...]
# Terms up to which a polynomial is factored; longer ones rarely have factors, and factoring them is slow
FACTORED = 15


@dataclass(frozen=True)
class CanonicalForm:
    """A rational function in canonical form, sign and magnitude;
    elements of equal magnitude have equal symbols and texts."""

    symbols: list[ca.SX]
    text: str
    negative: bool
    magnitude: Ratio
    cancelled: bool  # whether a common factor was cancelled
    pole: bool  # whether rationalizing introduced a denominator that vanishes where the expression is defined


class Field:
    """Rational functions over QQ of an expression's symbols and of its atoms, the subexpressions that are not
    rational.

    Sines (with their cosines) and roots are atoms whose square is known; other functions are treated as
    independent.
    """

    def __init__(self, entry: ca.SX):
        # The same order everywhere, so that equal factors are equal
        self.symbols = sorted(free_symbols(entry), key=str)
        self.steps: list[Step] = []
        self.places: dict[Step, int] = {}
        self._expression_of: dict[int, ca.SX] = {}
        (self.result,) = fold(
            entry,
            self.symbols,
            lambda k: self._step(SYMBOL, k),
            lambda value: self._step(CONSTANT, value),
            self._operation,
        )
        atoms = sorted(
            (step for step in self.steps if step[0] not in (SYMBOL, CONSTANT, POWER, *RATIONAL)),
            key=self._text,
        )
        self.generator_of = {atom: len(self.symbols) + k for k, atom in enumerate(atoms)}
        self.expressions = [*self.symbols, *[self._rebuilt(self.places[atom]) for atom in atoms]]
        self.ring, *self.generators = ring([f"g{k}" for k in range(len(self.expressions))], QQ)
        self.radicals: list[Radical] = []
        self.cosines: list[Radical] = []  # the sines among the radicals, with the roles exchanged
        self.floats: dict[QQ, float] = {}  # exact number -> the float from which it was made
        self.atoms: dict[Step, int] = {}  # function and canonical arguments -> generator
        self.divisors: dict[PolyElement, None] = {}  # the sums that occur as denominators, as an ordered set

    def simplify(self) -> CanonicalForm:
        """Return the expression in canonical form.

        The denominator has no sine or root, and there is no common factor. Then, if this has fewer terms, a
        sine or root is moved to the denominator and squares of cosines are written as squares of sines.
        """
        fraction = self._evaluate()
        numerator, denominator = self._rationalize(*fraction)
        ratio = in_lowest_terms(numerator, denominator)
        cancelled = ratio[1].leading_expv() != denominator.leading_expv()
        numerator, denominator = (self._by_sines(part) for part in self._roots_below(*ratio))
        negative = bool(numerator) and (numerator.LC < 0) != (denominator.LC < 0)
        magnitude = tuple(-part if part and part.LC < 0 else part for part in (numerator, denominator))
        text = repr((self.ring.ngens, list(self.atoms.items()), magnitude))
        pole = denominator != 1 and any(powers[r.place] for r in self.radicals for powers in fraction[1])
        pole = pole and not self._divides(denominator, fraction[1])
        return CanonicalForm(self.symbols, text, negative, magnitude, cancelled, pole)

    def expression(self, ratio: Ratio) -> ca.SX:
        """Return a ratio as an expression, with numerator and denominator factored."""
        if not ratio[0]:
            return ca.SX(0)
        (upper, above), (lower, below) = self._product(ratio[0]), self._product(ratio[1], self.divisors)
        content = upper / lower
        decimal = abs(content) in self.floats and int(content.denominator).bit_count() > 1
        if not decimal and max(abs(content.numerator), content.denominator) <= LARGEST_WHOLE:
            upper, lower = content.numerator, content.denominator
        else:
            upper, lower = content, 1
        return self._multiple(upper, above) / self._multiple(lower, below)

    # -- the expression as steps -----------------------------------------------------------------------------

    def _step(self, *step: Any) -> int:
        """Return the index of a step; equal steps have the same index."""
        if step not in self.places:
            self.places[step] = len(self.steps)
            self.steps.append(step)
        return self.places[step]

    def _operation(self, code: int, arguments: tuple[int, ...]) -> int:
        """Return the step of an operation. A sine also adds its cosine; tangents and powers are expanded."""
        if code in (ca.OP_SIN, ca.OP_COS, ca.OP_TAN):
            sine, cosine = self._step(ca.OP_SIN, *arguments), self._step(ca.OP_COS, *arguments)
            return (
                sine
                if code == ca.OP_SIN
                else cosine
                if code == ca.OP_COS
                else self._step(ca.OP_DIV, sine, cosine)
            )
        if code in (ca.OP_POW, ca.OP_CONSTPOW):
            kind, exponent = self.steps[arguments[1]][:2]
            if kind == CONSTANT and abs(exponent) <= LARGEST_POWER and (2 * exponent).is_integer():
                whole = exponent.is_integer()
                base = arguments[0] if whole else self._step(ca.OP_SQRT, arguments[0])
                return self._step(POWER, base, int(exponent if whole else 2 * exponent))
        return self._step(code, *arguments)

    def _rebuilt(self, place: int) -> ca.SX:
        """Return a step as an expression."""
        if place not in self._expression_of:
            kind, *arguments = self.steps[place]
            if kind == SYMBOL:
                expression = self.symbols[arguments[0]]
            elif kind == CONSTANT:
                expression = ca.SX(arguments[0])
            elif kind == POWER:
                expression = self._rebuilt(arguments[0]) ** arguments[1]
            else:
                expression = operate(kind, *[self._rebuilt(argument) for argument in arguments])
            self._expression_of[place] = expression
        return self._expression_of[place]

    def _text(self, atom: Step) -> tuple[str, int]:
        """Return the key by which atoms are sorted: their arguments, then sine before cosine."""
        code, *arguments = atom
        return " ".join(str(self._rebuilt(argument)) for argument in arguments), code

    # -- arithmetic ------------------------------------------------------------------------------------------

    def _evaluate(self) -> Ratio:
        values: list[Ratio] = []
        for kind, *arguments in self.steps:
            if kind == SYMBOL:
                value = self.generators[arguments[0]], self.ring.one
            elif kind == CONSTANT:
                value = self.ring(self._number(arguments[0])), self.ring.one
            elif kind == POWER:
                value = self._power(values[arguments[0]], arguments[1])
            elif kind in RATIONAL:
                value = self._reduce(*RATIONAL[kind](*[values[place] for place in arguments]))
            else:
                value = self._atom((kind, *arguments), [values[place] for place in arguments])
            if len(value[1]) > 1:
                self.divisors[value[1]] = None
            values.append(value)
        return values[self.result]

    def _number(self, value: float) -> QQ:
        """Return the exact number for a float, and store the float,
        so that converting back gives the same bits."""
        fraction = exact(value)
        self.floats.setdefault(abs(fraction), abs(value))
        return fraction

    def _float(self, coefficient: QQ) -> float:
        value = self.floats.get(abs(coefficient))
        return number(coefficient) if value is None else math.copysign(value, coefficient)

    def _power(self, base: Ratio, exponent: int) -> Ratio:
        value = self.ring.one, self.ring.one
        for _ in range(abs(exponent)):
            value = self._reduce(*RATIONAL[ca.OP_MUL](value, base))
        return value if exponent >= 0 else (value[1], value[0])

    def _atom(self, step: Step, arguments: list[Ratio]) -> Ratio:
        """Return the generator of a function at these arguments, the same one for all equal arguments."""
        arguments = [self._lowest(ratio) for ratio in arguments]
        place = self.atoms.setdefault((step[0], *arguments), self.generator_of[step])
        if place == self.generator_of[step]:
            if step[0] == ca.OP_SIN:
                other = self.generator_of[ca.OP_COS, *step[1:]]
                self.radicals.append(Radical(place, 1 - self.generators[other] ** 2, self.ring.one))
                self.cosines.append(Radical(other, 1 - self.generators[place] ** 2, self.ring.one))
            elif step[0] == ca.OP_SQRT:
                self.radicals.append(Radical(place, *arguments[0]))
        return self.generators[place], self.ring.one

    def _lowest(self, ratio: Ratio) -> Ratio:
        """Return the unique representation of this ratio in lowest terms."""
        numerator, denominator = self._rationalize(*ratio)
        numerator, denominator = in_lowest_terms(numerator, denominator)
        return numerator.quo_ground(denominator.LC), denominator.monic()

    def _reduce(self, numerator: PolyElement, denominator: PolyElement) -> Ratio:
        """Return the same ratio without squares of radicals."""
        for radical in reversed(self.radicals):
            numerator, up = without_squares(numerator, radical)
            denominator, down = without_squares(denominator, radical)
            if up != down and radical.denominator != 1:
                numerator, denominator = (
                    times(numerator, radical.denominator ** max(down - up, 0)),
                    times(denominator, radical.denominator ** max(up - down, 0)),
                )
        return numerator, denominator

    def _rationalize(self, numerator: PolyElement, denominator: PolyElement) -> Ratio:
        """Return the same ratio without radicals in the denominator."""
        for radical in reversed(self.radicals):
            if any(powers[radical.place] for powers in denominator):
                other = conjugate(denominator, radical.place)
                numerator, denominator = self._reduce(times(numerator, other), times(denominator, other))
        if not denominator:
            raise NotRational
        return numerator, denominator

    def _divides(self, divisor: PolyElement, polynomial: PolyElement) -> bool:
        """Return whether the divisor divides the square of the polynomial,
        so that it vanishes only where the polynomial does."""
        try:
            numerator, denominator = self._rationalize(*self._reduce(times(polynomial, polynomial), divisor))
            return in_lowest_terms(numerator, denominator)[1].is_ground
        except NotRational:  # too large to decide
            return False

    # -- the shorter of two forms ----------------------------------------------------------------------------

    def _roots_below(self, numerator: PolyElement, denominator: PolyElement) -> Ratio:
        """Return a/(b sqrt(c)) instead of a sqrt(c)/(b c) where this is shorter, for each radical."""
        for radical in self.radicals:
            if generators_of(denominator).isdisjoint(generators_of(radical.numerator)):
                continue  # no common factor possible
            generator = self.generators[radical.place]
            upper, lower = self._reduce(times(numerator, generator), denominator)
            upper, lower = in_lowest_terms(upper, lower)
            lower = times(lower, generator)
            if size(upper, lower) < size(numerator, denominator):
                numerator, denominator = upper, lower
        return numerator, denominator

    def _by_sines(self, polynomial: PolyElement) -> PolyElement:
        """Replace cos^2 by 1 - sin^2, for each angle for which this has fewer terms."""
        for cosine in self.cosines:
            other, _ = without_squares(polynomial, cosine)
            polynomial = other if len(other) < len(polynomial) else polynomial
        return polynomial

    # -- back to expressions ---------------------------------------------------------------------------------

    def _product(self, polynomial: PolyElement, divisors: Iterable[PolyElement] = ()) -> tuple[QQ, ca.SX]:
        """Return a number, and the polynomial divided by it as a product of its factors, each a sum of
        products.

        Factors are also looked for among the divisors.
        """
        if len(polynomial) == 1:
            return polynomial.LC, self._sum(polynomial.monic())
        content, factors = _factors(polynomial)
        powers: dict[PolyElement, int] = {}
        for whole, power in factors:
            among, parts = self._split(whole, divisors)
            content *= among**power
            for part in parts:
                scale, factor = normalized(part)
                content *= scale**power
                powers[factor] = powers.get(factor, 0) + power
        parts = [self._sum(factor) ** power for factor, power in powers.items()]
        return content, prod(parts[1:], start=parts[0])

    def _split(
        self, polynomial: PolyElement, divisors: Iterable[PolyElement]
    ) -> tuple[QQ, list[PolyElement]]:
        """Return a number and shorter factors of a polynomial: divisors and quotients by them, or the
        polynomial alone.

        A square of a sum with sines has no factors as a polynomial once sin^2 + cos^2 = 1 was used in it, and
        where the sum is small, most of the digits of the expanded square cancel.
        """
        shorter = []
        rest, _ = self._reduce(polynomial, self.ring.one)
        for divisor in sorted(divisors, key=len):
            while (
                len(divisor) < len(rest)
                and (quotient := self._quotient(rest, divisor))
                and len(quotient) < len(rest)
            ):
                shorter.append(divisor)
                rest = quotient
        if not shorter:
            return QQ(1), [polynomial]
        contents, factors = zip(
            *[_primitive(self._by_sines(factor)) for factor in (*shorter, rest)], strict=True
        )
        return prod(contents, start=QQ(1)), list(factors)

    def _quotient(self, polynomial: PolyElement, divisor: PolyElement) -> PolyElement | None:
        """Return polynomial / divisor, modulo the squares of radicals,
        if it is a polynomial that is not too large."""
        try:
            upper, lower = self._rationalize(*self._reduce(polynomial, divisor))
        except NotRational:
            return None
        upper, lower = in_lowest_terms(upper, lower)
        return upper.quo_ground(lower.LC) if lower.is_ground else None

    def _multiple(self, factor: QQ, expression: ca.SX) -> ca.SX:
        if factor in (1, -1):
            return int(factor) * expression
        value = ca.SX(self._float(factor))
        return value if expression.is_one() else value * expression

    def _sum(self, polynomial: PolyElement) -> ca.SX:
        terms = []
        for powers, coefficient in polynomial.terms():
            factors = [self.expressions[k] ** power for k, power in enumerate(powers) if power]
            factor = self._float(coefficient)
            term = prod(factors[1:], start=factors[0]) if factors else ca.SX(1)
            terms.append(term if factor == 1 else -term if factor == -1 else factor * term)
        return sum(terms[1:], start=terms[0])


def _factors(polynomial: PolyElement) -> tuple[QQ, Sequence[tuple[PolyElement, int]]]:
    """Return content and irreducible factors, as `factored` does, which is slow for many symbols.

    After division by its common monomial, a polynomial that is linear in some generator, with a single term
    in it, is irreducible.
    Long polynomials are treated as irreducible.
    """
    common = tuple(map(min, zip(*polynomial, strict=True)))
    rest = polynomial.quo_term((common, QQ(1)))
    generators = range(len(common))
    irreducible = any([powers[k] for powers in rest if powers[k]] == [1] for k in generators)
    if not irreducible and len(polynomial) <= FACTORED:
        return factored(polynomial)
    content, primitive = _primitive(rest)
    return content, [(polynomial.ring.gens[k], common[k]) for k in generators if common[k]] + [(primitive, 1)]


def _primitive(polynomial: PolyElement) -> tuple[QQ, PolyElement]:
    """Return a number, and the polynomial divided by it: whole coefficients without a common factor,
    the leading one positive."""
    content, primitive = polynomial.primitive()
    return (-content, -primitive) if primitive.LC < 0 else (content, primitive)
