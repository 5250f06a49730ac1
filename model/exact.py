"""Exact simplification: rational functions in canonical form, modulo sin^2 + cos^2 = 1.

Two expressions that are equal as rational functions of their symbols, sines, cosines and roots come out as the same
expression, so what cancels is gone and what does not matter (the heading in S'MS) is found and proved at once.
"""

from fractions import Fraction
from math import prod

import casadi as ca
from sympy import QQ, Symbol
from sympy.polys.rings import PolyElement, ring

from .expression import fold, free_symbols

LARGEST = 400  # operations; above this a canonical form costs more than it brings
Ratio = tuple[PolyElement, PolyElement]


class NotRational(Exception):
    """An operation that has no place in a field of rational functions."""


def canonical(expression: ca.SX) -> ca.SX:
    """The same matrix, each entry simplified exactly; entries that are not rational or too large stay as they are."""
    expression = ca.SX(expression)
    simplified = ca.SX(expression)
    for k in range(expression.nnz()):
        simplified.nz[k] = _canonical_entry(expression.nz[k])
    return ca.sparsify(simplified)


def _canonical_entry(entry: ca.SX) -> ca.SX:
    if entry.is_constant() or entry.is_symbolic() or ca.n_nodes(entry) > LARGEST:
        return entry
    try:
        return Field(entry).simplify()
    except NotRational:
        return entry


class Field:
    """The rational functions that one expression lives in: its symbols, and sin, cos of their arguments, as generators."""

    def __init__(self, entry: ca.SX):
        self.entry = entry
        self.symbols = free_symbols(entry)
        self.atoms: dict[tuple, ca.SX] = {}  # (function, argument's text) -> expression of the generator
        self._collect()
        generators = [Symbol(f"g{k}") for k in range(len(self.symbols) + len(self.atoms))]
        self.ring, *self.generators = ring(generators, QQ)
        self.expressions = [*self.symbols, *self.atoms.values()]
        places = {key: len(self.symbols) + k for k, key in enumerate(self.atoms)}
        self.places = places
        self.pairs = [(places["sin", a], places["cos", a]) for kind, a in self.atoms if kind == "sin"]

    def simplify(self) -> ca.SX:
        """The entry in canonical form, factored."""
        (result,) = self._evaluate()
        numerator, denominator = self._cancel(result)
        return self._product(numerator) / self._product(denominator)

    def _collect(self) -> None:
        """Find the sines and cosines; a sine brings its cosine along, so that their relation can be used."""

        def apply(code: int, arguments: tuple[ca.SX, ...]) -> ca.SX:
            if code in (ca.OP_SIN, ca.OP_COS):
                key = str(arguments[0])
                self.atoms.setdefault(("sin", key), ca.sin(arguments[0]))
                self.atoms.setdefault(("cos", key), ca.cos(arguments[0]))
            elif code not in RATIONAL:
                raise NotRational
            return APPLY_SX[code](*arguments)

        fold(self.entry, self.symbols, lambda k: self.symbols[k], ca.SX, apply)

    def _evaluate(self) -> list[Ratio]:
        one = self.ring.one

        def constant(value: float) -> Ratio:
            exact = Fraction(value)
            return self.ring(QQ(exact.numerator, exact.denominator)), one

        def apply(code: int, arguments: tuple) -> tuple:
            (expression, *_), values = zip(*arguments, strict=True)
            rebuilt = APPLY_SX[code](*[a[0] for a in arguments])
            if code in (ca.OP_SIN, ca.OP_COS):
                key = ("sin" if code == ca.OP_SIN else "cos", str(expression))
                return rebuilt, (self.generators[self.places[key]], one)
            numerator, denominator = RATIONAL[code](*values)
            return rebuilt, (self._reduce(numerator), self._reduce(denominator))

        leaves = [(symbol, (self.generators[k], one)) for k, symbol in enumerate(self.symbols)]
        folded = fold(self.entry, self.symbols, lambda k: leaves[k], lambda v: (ca.SX(v), constant(v)), apply)
        return [value for _, value in folded]

    def _reduce(self, polynomial: PolyElement) -> PolyElement:
        """Remainder modulo sin^2 = 1 - cos^2 for every angle."""
        for sine, cosine in self.pairs:
            if polynomial.degree(self.generators[sine]) < 2:
                continue
            square = 1 - self.generators[cosine] ** 2
            reduced = self.ring.zero
            for powers, coefficient in polynomial.terms():
                half, rest = divmod(powers[sine], 2)
                kept = (*powers[:sine], rest, *powers[sine + 1 :])
                reduced += self.ring({kept: coefficient}) * square**half
            polynomial = reduced
        return polynomial

    def _cancel(self, ratio: Ratio) -> Ratio:
        numerator, denominator = ratio
        if not denominator:
            raise NotRational
        return numerator.cancel(denominator)

    def _product(self, polynomial: PolyElement) -> ca.SX:
        """A polynomial back as an expression: its factors, each a sum of products."""
        if not polynomial:
            return ca.SX(0)
        content, factors = polynomial.factor_list()
        parts = [self._power(self._sum(factor), power) for factor, power in factors]
        if content != 1 or not parts:
            parts.insert(0, ca.SX(_number(content)))
        return prod(parts[1:], start=parts[0])

    def _sum(self, polynomial: PolyElement) -> ca.SX:
        terms = []
        for powers, coefficient in polynomial.terms():
            factors = [self._power(self.expressions[k], p) for k, p in enumerate(powers) if p]
            number = _number(coefficient)
            term = prod(factors[1:], start=factors[0]) if factors else ca.SX(1)
            terms.append(term if number == 1 else -term if number == -1 else number * term)
        return sum(terms[1:], start=terms[0])

    @staticmethod
    def _power(base: ca.SX, power: int) -> ca.SX:
        return base if power == 1 else base**2 if power == 2 else prod([base] * power, start=ca.SX(1))


def _number(coefficient: QQ) -> float:
    return float(Fraction(int(coefficient.numerator), int(coefficient.denominator)))


def _add(a: Ratio, b: Ratio) -> Ratio:
    return (a[0] + b[0], a[1]) if a[1] == b[1] else (a[0] * b[1] + b[0] * a[1], a[1] * b[1])


RATIONAL = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: _add,
    ca.OP_SUB: lambda a, b: _add(a, (-b[0], b[1])),
    ca.OP_MUL: lambda a, b: (a[0] * b[0], a[1] * b[1]),
    ca.OP_DIV: lambda a, b: (a[0] * b[1], a[1] * b[0]),
    ca.OP_NEG: lambda a: (-a[0], a[1]),
    ca.OP_SQ: lambda a: (a[0] ** 2, a[1] ** 2),
    ca.OP_TWICE: lambda a: (2 * a[0], a[1]),
    ca.OP_INV: lambda a: (a[1], a[0]),
}

APPLY_SX = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: lambda a, b: a + b,
    ca.OP_SUB: lambda a, b: a - b,
    ca.OP_MUL: lambda a, b: a * b,
    ca.OP_DIV: lambda a, b: a / b,
    ca.OP_NEG: lambda a: -a,
    ca.OP_SQ: lambda a: a**2,
    ca.OP_TWICE: lambda a: 2 * a,
    ca.OP_INV: lambda a: 1 / a,
    ca.OP_SIN: ca.sin,
    ca.OP_COS: ca.cos,
}
