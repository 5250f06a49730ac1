"""The exact functions of q: polynomials in coordinates, parameters, sines, cosines, exponentials and roots.

They are kept modulo s^2 + c^2 = 1 and root^2 = radicand in a normal form in which only zero is zero. For
that, arguments are written through angles (and exponents) independent over the rationals, whose sines and
exponentials are then algebraically independent (Ax's theorem), and no root lies in the field of the
generators before it (proved by a point at which its radicand is no square).
"""

import functools
import itertools
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from math import lcm, prod

import sympy as sp
from sympy import QQ, ZZ
from sympy.ntheory import factorint
from sympy.polys.matrices import DomainMatrix
from sympy.polys.rings import PolyElement, PolyRing, ring

from ...model.algebra.ratios import Ratio, by_squares, conjugate, factored, generators_of, in_lowest_terms
from ...model.errors import ModelError
from ...readers.progress import Reported, silent
from .symbolic import NOT_EXACT

LARGEST_POWER = 32  # largest exponent of a function in an expression
COMMON = 100  # terms that the search for a common factor, or for all, takes for each term
LARGEST_PRODUCT = 100_000  # most terms of a product before they are collected; more take too long

# Most terms that the operations on the functions of one system may take in all; see Functions.spend
WORK = 20_000_000

Vector = tuple[PolyElement, ...]  # a vector field or a one-form, n entries
Combination = tuple[sp.Expr, list[tuple[int, int]]]  # a constant, and (place in a basis, multiple)


class TooLarge(Exception):
    """Polynomials are too large for a proof in reasonable time."""


class TooMuchWork(TooLarge):
    """More than WORK terms were needed, so that nothing more is tried."""


@dataclass(frozen=True)
class Angle:
    """An independent argument of sines and cosines, and the places of their generators."""

    expression: sp.Expr
    argument: Ratio
    cosine: int
    sine: int


@dataclass(frozen=True)
class Exponent:
    """An independent argument of exponentials, and the place of their generator."""

    argument: Ratio
    place: int


class Functions:
    """The ring of the entries of `expressions` (SymPy), with its derivatives by the coordinates.

    Raises ModelError for functions other than rational ones, sin, cos, exp of rational arguments, sqrt and
    Abs, which cannot be treated exactly.
    """

    def __init__(
        self,
        name: str,
        coordinates: Sequence[sp.Symbol],
        parameters: Sequence[sp.Symbol],
        expressions: Iterable[sp.Expr],
    ):
        self.name = name
        self.work, self.most_work = 0, WORK  # see spend
        self.progress: Reported = silent
        self.coordinates, self.parameters = tuple(coordinates), tuple(parameters)
        self.symbols = (*parameters, *coordinates)
        expressions = list(expressions)
        constants = [*parameters, *([sp.pi] if any(e.has(sp.pi) for e in expressions) else [])]
        self.constants = len(constants)  # generators before this place are constants
        self.expressions: list[sp.Expr] = [*constants, *coordinates]  # the expression of each generator
        self.angles: list[Angle] = []
        self.exponents: list[Exponent] = []
        self.roots: dict[int, PolyElement] = {}  # place of its generator -> radicand
        self.positive: list[sp.Expr] = []  # assumed positive: f of an |f| or of the root of a square
        self._known: dict[sp.Expr, Ratio] = {}
        self.ring: PolyRing = ring([f"g{k}" for k in range(len(self.expressions))], ZZ)[0]
        angles, self._in_angles = self._basis(_arguments(expressions, (sp.sin, sp.cos)))
        for angle, argument in angles:
            cosine, sine = self._generator(sp.cos(angle)), self._generator(sp.sin(angle))
            self.angles.append(Angle(angle, self._lift(argument), cosine, sine))
            self._forget()
        exponents, self._in_exponents = self._basis(_arguments(expressions, (sp.exp,)))
        for exponent, argument in exponents:
            place = self._generator(sp.exp(exponent))
            self.exponents.append(Exponent(self._lift(argument), place))
            self._forget()
        for expression in expressions:
            self.ratio(expression)

    # -- conversion to and from the ring ---------------------------------------------------------------------

    def ratio(self, expression: sp.Expr) -> Ratio:
        """Return an expression as numerator and denominator. Raises ModelError for a function that is not in
        the ring."""
        if expression not in self._known:
            self._known[expression] = self._convert(expression)
        return tuple(
            part.set_ring(self.ring) if part.ring != self.ring else part for part in self._known[expression]
        )

    def expression(self, polynomial: PolyElement) -> sp.Expr:
        """Return a polynomial as a factored SymPy expression."""
        if not polynomial:
            return sp.Integer(0)
        content, factors = self.factors(polynomial)
        return sp.Mul(sp.Integer(content), *[self._sum(factor) ** power for factor, power in factors])

    def quotient(self, numerator: PolyElement, denominator: PolyElement) -> sp.Expr:
        """Return a ratio as a factored SymPy expression, squares of sines or of cosines eliminated,
        whichever is shorter."""
        above, below = self.lowest(numerator, denominator)
        ratios = [in_lowest_terms(a, b) for a in self.forms(above) for b in self.forms(below)]
        above, below = min(ratios, key=lambda ratio: len(ratio[0]) + len(ratio[1]))
        return self.expression(above) / self.expression(below)

    def product(
        self, above: Sequence[PolyElement], below: Sequence[PolyElement]
    ) -> tuple[sp.Rational, dict[PolyElement, int]]:
        """Return a ratio of products as a number and irreducible factors with their powers."""
        number, powers = sp.Integer(1), dict[PolyElement, int]()
        for sign, parts in ((1, above), (-1, below)):
            for part in parts:
                content, factors = self.factors(part)
                number *= sp.Integer(content) ** sign
                for factor, power in factors:
                    powers[factor] = powers.get(factor, 0) + sign * power
        return number, {factor: power for factor, power in powers.items() if power}

    def factors(self, polynomial: PolyElement) -> tuple[int, Sequence[tuple[PolyElement, int]]]:
        """Return content and irreducible factors with their powers, squares of sines or of cosines
        eliminated, whichever gives fewer."""
        self.spend(COMMON * len(polynomial))
        lists = [factored(form) for form in self.forms(polynomial)]
        content, factors = min(
            lists, key=lambda pair: (len(pair[1]), sum(len(factor) for factor, _ in pair[1]))
        )
        return int(content), factors

    def _sum(self, polynomial: PolyElement) -> sp.Expr:
        return sp.Add(
            *[
                sp.Mul(
                    sp.Integer(int(c)),
                    *[self.expressions[k] ** power for k, power in enumerate(powers) if power],
                )
                for powers, c in polynomial.terms()
            ]
        )

    def _convert(self, e: sp.Expr) -> Ratio:
        one = self.ring.one
        if e.is_Rational:
            return self.ring(int(e.p)), self.ring(int(e.q))
        if e in self.expressions:
            return self.ring.gens[self.expressions.index(e)], one
        if e.is_Add or e.is_Mul:
            first, *rest = [self.ratio(part) for part in e.args]
            for other in rest:
                first, other = self._lift(first), self._lift(other)
                first = self._add(first, other) if e.is_Add else self._times(first, other)
            return first
        if e.is_Pow and e.exp.is_Rational and e.exp.q <= 2 and abs(e.exp) <= LARGEST_POWER:
            base = self.ratio(e.base) if e.exp.q == 1 else self._root(e.base)
            value = (self.ring.one, self.ring.one)
            for _ in range(abs(e.exp.p)):
                value = self._times(value, self._lift(base))
            if e.exp < 0 and not value[0]:
                raise ModelError(f"{self.name}: a division by zero: {e.base} vanishes")
            return value if e.exp > 0 else (value[1], value[0])
        if isinstance(e, sp.Abs):
            self._assume(e.args[0])
            return self.ratio(e.args[0])
        if isinstance(e, sp.sin | sp.cos) and (parts := self._combination(e.args[0])):
            cosine, sine = self._circle(*parts)
            return self._lift(sine if isinstance(e, sp.sin) else cosine)
        if isinstance(e, sp.exp):
            return self._exponential(*self._in_exponents[e.args[0]])
        raise ModelError(f"{self.name}: {e} {NOT_EXACT}")

    def _lift(self, ratio: Ratio) -> Ratio:
        return ratio[0].set_ring(self.ring), ratio[1].set_ring(self.ring)

    def _add(self, a: Ratio, b: Ratio) -> Ratio:
        # Over the least common denominator; products in normal form hide their factors
        left, right = in_lowest_terms(a[1], b[1])
        return self._cancel(self.normal(a[0] * right + b[0] * left), self.normal(a[1] * right))

    def _times(self, a: Ratio, b: Ratio) -> Ratio:
        return self._cancel(self.normal(a[0] * b[0]), self.normal(a[1] * b[1]))

    def _cancel(self, numerator: PolyElement, denominator: PolyElement) -> Ratio:
        self.spend(len(numerator) * len(denominator))
        return in_lowest_terms(numerator, denominator)

    def _generator(self, expression: sp.Expr) -> int:
        """Return the index of a new generator."""
        place = len(self.expressions)
        self.expressions.append(expression)
        self.ring = ring([f"g{k}" for k in range(place + 1)], ZZ)[0]
        self.roots = {k: radicand.set_ring(self.ring) for k, radicand in self.roots.items()}
        self.angles = [replace(angle, argument=self._lift(angle.argument)) for angle in self.angles]
        self.exponents = [
            replace(exponent, argument=self._lift(exponent.argument)) for exponent in self.exponents
        ]
        self._forget()
        return place

    def _forget(self) -> None:
        """Discard cached values that depend on the generators."""
        for name in ("relations", "positive_places"):
            self.__dict__.pop(name, None)

    # -- angles and exponents --------------------------------------------------------------------------------

    def _basis(
        self, arguments: list[sp.Expr]
    ) -> tuple[list[tuple[sp.Expr, Ratio]], dict[sp.Expr, Combination]]:
        """Return arguments independent over the rationals, and every argument as a combination of these."""
        offsets, rows = {}, []
        for argument in arguments:
            offsets[argument], rest = self._without_offset(argument)
            rows.append(self._rational(rest))
        tops, monomials = self._over_one_denominator(rows)
        order = sorted(range(len(rows)), key=lambda k: (len(rows[k][0]), sp.default_sort_key(arguments[k])))
        basis: list[int] = []
        for k in order:
            chosen = DomainMatrix(
                [[QQ(tops[j].get(m, 0)) for m in monomials] for j in (*basis, k)],
                (len(basis) + 1, len(monomials)),
                QQ,
            )
            if monomials and chosen.rank() > len(basis):
                basis.append(k)
        multiples = {k: _solve([tops[j] for j in basis], tops[k], monomials) for k in range(len(rows))}
        elements = []
        for j, place in enumerate(basis):
            finest = lcm(*[int(multiples[k][j].denominator) for k in range(len(rows))])
            for k in range(len(rows)):
                multiples[k][j] *= finest
            top, bottom = rows[place]
            elements.append(
                (sp.expand(arguments[place] - offsets[arguments[place]]) / finest, (top, bottom * finest))
            )
        combinations = [[(j, int(m)) for j, m in enumerate(multiples[k]) if m] for k in range(len(rows))]
        return elements, {a: (offsets[a], parts) for a, parts in zip(arguments, combinations, strict=True)}

    def _combination(self, argument: sp.Expr) -> Combination | None:
        """Return an argument of sines and cosines as a combination of the angles; None if it is none."""
        if argument not in self._in_angles:
            offset, rest = self._without_offset(argument)
            rows = [angle.argument for angle in self.angles] + [self._rational(rest)]
            tops, monomials = self._over_one_denominator(rows)
            matrix = DomainMatrix(
                [[QQ(top.get(m, 0)) for m in monomials] for top in tops], (len(tops), len(monomials)), QQ
            )
            multiples = (
                _solve(tops[:-1], tops[-1], monomials) if matrix.rank() == len(self.angles) else [QQ(1, 2)]
            )
            if any(multiple.denominator != 1 for multiple in multiples):
                return None
            self._in_angles[argument] = (offset, [(k, int(m)) for k, m in enumerate(multiples) if m])
        return self._in_angles[argument]

    def _without_offset(self, argument: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
        """Return a multiple of pi, and the rest of an argument."""
        offset, rest = sp.expand(argument).as_independent(*self.symbols, as_Add=True)
        return (offset, rest) if (offset / sp.pi).is_Rational else (sp.Integer(0), sp.expand(argument))

    def _over_one_denominator(self, rows: Sequence[Ratio]) -> tuple[list[dict], list]:
        """Return the numerators of ratios over one denominator, as dictionaries, and all their monomials."""
        lifted = [self._lift(row) for row in rows]
        common = prod({bottom for _, bottom in lifted}, start=self.ring.one)
        tops = [dict(top * common.exquo(bottom)) for top, bottom in lifted]
        return tops, sorted({m for top in tops for m in top})

    def _rational(self, argument: sp.Expr) -> Ratio:
        if not argument.is_rational_function(*self.expressions):
            raise ModelError(
                f"{self.name}: the argument {argument} of sin, cos or exp is not rational in the coordinates"
            )
        top, bottom = self.ratio(argument)
        return (top, bottom) if bottom.LC > 0 else (-top, -bottom)

    def _circle(self, offset: sp.Expr, parts: list[tuple[int, int]]) -> tuple[Ratio, Ratio]:
        """Return cosine and sine of an argument."""
        cosine, sine = self.ratio(sp.cos(offset)), self.ratio(sp.sin(offset))
        for angle, multiple in parts:
            for _ in range(abs(multiple)):
                c, s = (self.ring.gens[k] for k in (self.angles[angle].cosine, self.angles[angle].sine))
                s = s if multiple > 0 else -s
                cosine, sine = self._lift(cosine), self._lift(sine)
                left = self._add(
                    self._times(cosine, (c, self.ring.one)), self._times(sine, (-s, self.ring.one))
                )
                right = self._add(
                    self._times(cosine, (s, self.ring.one)), self._times(sine, (c, self.ring.one))
                )
                cosine, sine = left, right
        return cosine, sine

    def _exponential(self, offset: sp.Expr, parts: list[tuple[int, int]]) -> Ratio:
        if offset:
            raise ModelError(f"{self.name}: exp({offset}) cannot be treated exactly; give it as a parameter")
        up = prod(
            (self.ring.gens[self.exponents[a].place] ** m for a, m in parts if m > 0), start=self.ring.one
        )
        down = prod(
            (self.ring.gens[self.exponents[a].place] ** -m for a, m in parts if m < 0), start=self.ring.one
        )
        return up, down

    # -- roots -----------------------------------------------------------------------------------------------

    def _root(self, base: sp.Expr) -> Ratio:
        """Return sqrt(base): squares are extracted, and each other factor has its own generator, so that
        roots are independent."""
        top, bottom = self._lift(self.ratio(base))
        if not top:
            return self.ring.zero, self.ring.one
        square = self.normal(top * bottom)
        if self.sign(square) < 0:
            raise ModelError(f"{self.name}: the root of {base}, which is negative")
        outside, inside = min(
            (self._squares_out(form) for form in self.forms(square)), key=lambda pair: len(pair[1])
        )
        value = outside
        for factor in inside:
            place = self._root_generator(factor, sp.sqrt(self.expression(factor)))
            value = value.set_ring(self.ring) * self.ring.gens[place]
        if not outside.is_ground:
            self._assume(self.expression(outside))
        return self._cancel(self.normal(value), bottom.set_ring(self.ring))

    def forms(self, polynomial: PolyElement) -> list[PolyElement]:
        """The polynomial itself, and with squares of cosines eliminated instead of those of sines,
        angle by angle."""
        forms = [polynomial]
        for angle in self.angles:
            square = 1 - self.ring.gens[angle.sine] ** 2
            turned = [_without_squares(form, angle.cosine, square) for form in forms]
            forms += [other for form, other in zip(forms, turned, strict=True) if other != form]
        return forms

    def _squares_out(self, polynomial: PolyElement) -> tuple[PolyElement, list[PolyElement]]:
        """Return the square root of the greatest square factor, and the other factors."""
        content, factors = factored(polynomial)
        outside, inside = self.ring.one, []
        for factor, power in (
            *((self.ring(p), power) for p, power in factorint(abs(int(content))).items()),
            *factors,
        ):
            outside *= factor ** (power // 2)
            inside += [factor] * (power % 2)
        if content < 0:
            inside = [*inside[:-1], -inside[-1]] if inside else [self.ring(-1)]
        return outside, inside

    def _root_generator(self, radicand: PolyElement, expression: sp.Expr) -> int:
        radicand = self.normal(radicand.set_ring(self.ring))
        for place, other in self.roots.items():
            if other == radicand:
                return place
        place = self._generator(expression)
        self.roots[place] = radicand.set_ring(self.ring)
        self._forget()
        return place

    def _assume(self, expression: sp.Expr) -> None:
        if not expression.is_positive and expression not in self.positive:
            self.positive.append(expression)

    # -- arithmetic ------------------------------------------------------------------------------------------

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.coordinates)

    @cached_property
    def relations(self) -> list[tuple[int, PolyElement]]:
        """Indices of generators with their squares, the last first."""
        gens = self.ring.gens
        circles = [(a.sine, 1 - gens[a.cosine] ** 2) for a in self.angles]
        return [*reversed(self.roots.items()), *circles]

    def spend(self, terms: int) -> None:
        """Count the terms that an operation takes: what is tried has the same bound on every machine. Raises
        TooMuchWork."""
        self.work += terms
        self.progress(self.work, self.most_work, "terms at most for the constraints")
        if self.work > self.most_work:
            raise TooMuchWork(f"{self.most_work:,} terms of polynomials")

    @contextmanager
    def within(self, terms: int) -> Iterator[None]:
        """Let operations within the block take so many more terms at most;
        those taken do not count after it."""
        before, self.most_work = (self.work, self.most_work), self.work + terms
        try:
            yield
        finally:
            self.work, self.most_work = before

    def normal(self, polynomial: PolyElement) -> PolyElement:
        """Return the normal form: no power above the first of a sine or a root."""
        self.spend(1 + len(polynomial))
        if polynomial.ring != self.ring:
            polynomial = polynomial.set_ring(self.ring)
        for place, square in self.relations:
            polynomial = _without_squares(polynomial, place, square)
        return polynomial

    def times(self, a: PolyElement, b: PolyElement) -> PolyElement:
        """Return the product in normal form."""
        self.spend(len(a) * len(b))
        return self.normal(a * b)

    def lowest(self, numerator: PolyElement, denominator: PolyElement) -> Ratio:
        """Return the ratio without common factors, no sine or root in its denominator,
        which has a positive leading term."""
        for place, _ in self.relations:
            if any(powers[place] for powers in denominator):
                other = conjugate(denominator, place)
                numerator, denominator = self.times(numerator, other), self.times(denominator, other)
        self.spend(COMMON * (len(numerator) + len(denominator)))
        numerator, denominator = in_lowest_terms(numerator, denominator)
        return (-numerator, -denominator) if denominator.LC < 0 else (numerator, denominator)

    def primitive(self, vector: Vector) -> tuple[PolyElement, Vector]:
        """Return the greatest common factor of the entries as far as found, and the vector without it;
        the vector is not zero."""
        content = self.ring.zero
        self.spend(COMMON * sum(map(len, vector)))
        for entry in sorted(filter(None, vector), key=len):
            content = content.gcd(entry)
            if content == 1:
                break
        vector = tuple(entry.exquo(content) for entry in vector)
        for angle in self.angles:
            # A common factor s is not visible in 1 - c^2, but in s times the vector.
            sine, square = self.ring.gens[angle.sine], 1 - self.ring.gens[angle.cosine] ** 2
            turned = [self.times(sine, entry).div(square) for entry in vector]
            if not any(rest for _, rest in turned):
                vector, content = tuple(quotient for quotient, _ in turned), self.times(content, sine)
        return content, vector

    def is_constant(self, polynomial: PolyElement) -> bool:
        """Whether it depends on parameters only."""
        return not any(any(powers[self.constants :]) for powers in polynomial)

    def never_zero(self, polynomial: PolyElement) -> bool:
        """Whether it is proved not to be zero for any coordinates."""
        return self.sign(polynomial) != 0

    def sign(self, polynomial: PolyElement) -> int:
        """Return 1 or -1 for a polynomial proved never to be zero: its terms have one sign and do not vanish
        together. Else 0.

        The signs of parameters and squares decide it; squares of cosines and sines are balanced first, as 1 +
        3 s^2 to c^2 + 4 s^2.
        """
        if len(polynomial) > 1 and any(powers[place] for powers in polynomial for place in self.roots):
            return 0
        polynomial = functools.reduce(self._balanced, self.angles, polynomial)
        positive = self.positive_places
        left = [
            {k: power for k, power in enumerate(powers) if power and k not in positive}
            for powers in polynomial
        ]
        signs = {1 if coefficient > 0 else -1 for coefficient in polynomial.values()}
        if len(signs) != 1 or any(power % 2 for term in left for power in term.values()):
            return 0
        used = [a for a in self.angles if any(k in term for term in left for k in (a.cosine, a.sine))]
        choices = itertools.product(*[(a.cosine, a.sine) for a in used])
        return (
            signs.pop()
            if all(any(term.keys() <= set(nonzero) for term in left) for nonzero in choices)
            else 0
        )

    @cached_property
    def positive_places(self) -> frozenset[int]:
        """Generators that are positive: parameters declared so, exponentials,
        roots of functions that are never zero."""
        positive = {k for k, expression in enumerate(self.expressions) if expression.is_positive}
        self.__dict__["positive_places"] = frozenset(positive)
        return frozenset(
            positive | {place for place, radicand in self.roots.items() if self.sign(radicand) > 0}
        )

    def _balanced(self, polynomial: PolyElement, angle: Angle) -> PolyElement:
        """Multiply terms of lower degree in this angle's cosine and sine by c^2 + s^2 if that makes all
        degrees equal."""
        degrees = {powers: powers[angle.cosine] + powers[angle.sine] for powers in polynomial}
        most = max(degrees.values(), default=0)
        if most % 2 or any(degree % 2 for degree in degrees.values()):
            return polynomial
        circle = self.ring.gens[angle.cosine] ** 2 + self.ring.gens[angle.sine] ** 2
        parts = [
            self.ring.from_dict({p: c}) * circle ** ((most - degrees[p]) // 2) for p, c in polynomial.items()
        ]
        return sum(parts, self.ring.zero)

    # -- derivatives -----------------------------------------------------------------------------------------

    @cached_property
    def _rates(self) -> list[list[Ratio]]:
        """d(generator)/dq_k, each as a ratio."""
        zero, one = (self.ring.zero, self.ring.one), (self.ring.one, self.ring.one)
        gens = self.ring.gens
        rates = [[zero] * self.n for _ in self.expressions]
        for k in range(self.n):
            rates[self.constants + k][k] = one
        for k, variable in enumerate(gens[self.constants : self.constants + self.n]):
            for angle in self.angles:
                up, down = _derivative(angle.argument, variable)
                rates[angle.cosine][k], rates[angle.sine][k] = (
                    (-up * gens[angle.sine], down),
                    (up * gens[angle.cosine], down),
                )
            for exponent in self.exponents:
                up, down = _derivative(exponent.argument, variable)
                rates[exponent.place][k] = up * gens[exponent.place], down
        for place, radicand in self.roots.items():
            for k in range(self.n):
                total = zero
                for g in generators_of(radicand):
                    total = self._add(
                        total, self._times((radicand.diff(gens[g]), self.ring.one), rates[g][k])
                    )
                rates[place][k] = self._times(total, (gens[place], 2 * radicand))
        return rates

    @cached_property
    def delta(self) -> PolyElement:
        """The common denominator of the generators' derivatives,
        1 unless there are roots or fractions as arguments."""
        common = self.ring.one
        for row in self._rates:
            for _, bottom in row:
                common = common.lcm(bottom)
        return common

    @cached_property
    def _scaled_rates(self) -> list[list[PolyElement]]:
        return [[self.normal(top * self.delta.exquo(bottom)) for top, bottom in row] for row in self._rates]

    def gradient(self, polynomial: PolyElement) -> Vector:
        """Return delta d(polynomial)/dq."""
        parts = [
            (polynomial.diff(self.ring.gens[g]), self._scaled_rates[g]) for g in generators_of(polynomial)
        ]
        return tuple(
            self.normal(sum((part * rate[k] for part, rate in parts if rate[k]), self.ring.zero))
            for k in range(self.n)
        )

    def rates_along(self, field: Vector) -> list[PolyElement]:
        """Return delta times the rate of each generator along a vector field."""
        return [self.dot(field, row) for row in self._scaled_rates]

    def along(self, rates: Sequence[PolyElement], polynomial: PolyElement) -> PolyElement:
        """Return delta times the rate of a polynomial, from the `rates_along` of a field. Raises TooLarge."""
        slopes = {g: polynomial.diff(self.ring.gens[g]) for g in generators_of(polynomial) if rates[g]}
        terms = sum(len(slope) * len(rates[g]) for g, slope in slopes.items())
        self.spend(terms)
        if terms > LARGEST_PRODUCT:
            raise TooLarge
        return self.normal(sum((slope * rates[g] for g, slope in slopes.items()), self.ring.zero))

    def dot(self, a: Sequence[PolyElement], b: Sequence[PolyElement]) -> PolyElement:
        """Return the sum of products."""
        self.spend(sum(len(x) * len(y) for x, y in zip(a, b, strict=True)))
        return self.normal(sum((x * y for x, y in zip(a, b, strict=True) if x and y), self.ring.zero))

    def bracket(self, x: Vector, y: Vector) -> Vector:
        """Return delta [x, y] = delta (dy/dq x - dx/dq y). Raises TooLarge."""
        along_x, along_y = self.rates_along(x), self.rates_along(y)
        return tuple(self.along(along_x, b) - self.along(along_y, a) for a, b in zip(x, y, strict=True))


def _without_squares(polynomial: PolyElement, place: int, square: PolyElement) -> PolyElement:
    """Return the polynomial with generator^2 replaced by `square`."""
    *lower, reduced = by_squares(polynomial, place)
    for part in reversed(lower):
        reduced = reduced * square + part
    return reduced


def _derivative(ratio: Ratio, variable: PolyElement) -> Ratio:
    top, bottom = ratio
    return in_lowest_terms(top.diff(variable) * bottom - top * bottom.diff(variable), bottom**2)


def _arguments(expressions: Iterable[sp.Expr], functions: tuple) -> list[sp.Expr]:
    """Return the arguments of these functions, each once, in a fixed order."""
    return sorted(
        {atom.args[0] for e in expressions for atom in e.atoms(*functions)}, key=sp.default_sort_key
    )


def _solve(basis: list[dict], row: dict, monomials: list) -> list:
    """Return the coefficients of `row` in the basis, over QQ."""
    if not basis:
        return []
    columns = [[QQ(b.get(m, 0)) for b in basis] + [QQ(row.get(m, 0))] for m in monomials]
    reduced, pivots = DomainMatrix(columns, (len(monomials), len(basis) + 1), QQ).rref()
    solved = reduced.to_list()
    return [solved[k][-1] for k in range(len(pivots))]
