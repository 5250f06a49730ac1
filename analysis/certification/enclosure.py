"""Bounds of a function near a trajectory: of its deviation from its value and from its tangent there.

At a point c + e, where the centre c lies within m of a given point x and |e| <= R entry by entry, Taylor's
theorem gives

    f(c + e) = f(c) + f'(c) e + e' f''(xi) e / 2.

|f''| is bounded over the whole box by its value at x and by how far it can be from that. Each operation is
carried out on Taylor polynomials about x, exact up to the order 3, with a bound of the derivatives of order 4
over the whole box (`_Jet`; Makino and Berz 2003 bound the remainder itself, which says nothing about f').
Terms of the second and third order thus cancel as they do in f; only those of the fourth are added up
operation by operation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from ...model.algebra.direct import Direct
from ...model.algebra.expression import fold, operate
from ...readers.errors import BadInput

NONE = np.zeros(0)


@dataclass(frozen=True)
class Bounds:
    """A function near a point x: `value` (n) and `slope` (n, inputs) there; bounds (n) of |f(c) - f(x)|,
    `moved`, of |f(c + e) - f(c)|, `radius`, of |f(c + e) - f(c) - f'(c) e|, `rest`, and of |(f'(c) - f'(x))
    e|, `turned`. Infinite or NaN where there are none. Where f'' at x is known, it is `hessian` (n, inputs,
    inputs), and `loose` is what is left of `rest`.
    """

    value: np.ndarray
    slope: np.ndarray
    moved: np.ndarray
    radius: np.ndarray
    rest: np.ndarray
    turned: np.ndarray
    hessian: np.ndarray | None = None
    loose: np.ndarray | None = None

    @property
    def finite(self) -> bool:
        """False if an operation may be undefined, such as a quotient whose denominator may be zero."""
        return bool(
            np.isfinite(self.radius).all() and np.isfinite(self.rest).all() and np.isfinite(self.moved).all()
        )

    def rows(self, which: slice) -> Bounds:
        """Return the enclosure of some entries of the function."""
        parts = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        return Bounds(**{name: part[which] for name, part in parts.items() if part is not None})

    def of(self, S: np.ndarray, G: np.ndarray, spread: np.ndarray, growth: np.ndarray) -> Bounds:
        """Return the bounds for e = S pi + G b + anything within `growth`,
        |pi| <= spread and |b| <= 1: correlated entries."""
        columns = np.hstack([S * spread, G, np.diag(growth)[:, growth > 0]])
        rest = self.rest
        with np.errstate(invalid="ignore", over="ignore"):
            if self.hessian is not None:
                rest = np.fmin(
                    rest, np.abs(columns.T @ self.hessian @ columns).sum(axis=(1, 2)) / 2 + self.loose
                )
            image = np.abs(self.slope @ columns).sum(axis=1)
        return replace(self, rest=rest, radius=np.fmin(self.radius, image + self.turned + rest))


class Enclosure:
    """`expression` (n) as a function of `symbols`, and of others that are `fixed`, with bounds.

    Raises BadInput for an operation without a rule.
    """

    def __init__(self, expression: ca.SX, symbols: ca.SX, fixed: ca.SX | None = None):
        fixed = ca.SX(0, 1) if fixed is None else fixed
        compiled = _compiled(
            ca.Function("f", [symbols, fixed], [ca.cse(ca.densify(ca.vec(expression)))]).serialize()
        )
        self._shape, self._tangent, self._bounds, places = compiled
        self._output, self._first, self._second = places
        self._half = np.where(self._first == self._second, 0.5, 1.0)
        self._curved, self._begins = np.unique(self._output, return_index=True)

    def tangent(self, x: np.ndarray, fixed: np.ndarray = NONE) -> tuple[np.ndarray, np.ndarray]:
        """Return value (n) and derivative (n, inputs) at x."""
        value, slope = self._tangent(x, fixed)
        return value, slope.reshape(self._shape, order="F")

    def bounds(
        self,
        x: np.ndarray,
        moved: np.ndarray,
        radius: np.ndarray,
        rest: np.ndarray | float = 0.0,
        fixed: np.ndarray = NONE,
    ) -> Bounds:
        """Return bounds near x. `rest`: the part of `radius` that is not linear in the variables of the
        derivative."""
        box = moved + radius
        value, slope, at, around, far = self._bounds(x, fixed, box)
        slope = slope.reshape(self._shape, order="F")
        size, a, b = np.abs(slope), self._first, self._second
        apart = rest if isinstance(rest, np.ndarray) else np.full(len(x), rest)
        pairs = np.array([moved, moved, moved, radius]), np.array([moved, radius, apart, radius])
        shares = np.divide(pairs, box, out=np.zeros((2, *pairs[0].shape)), where=box > 0).max(
            axis=2, initial=0.0
        )
        both = (pairs[0][:, a] * pairs[1][:, b] + pairs[0][:, b] * pairs[1][:, a]) * self._half
        hessian = np.zeros((len(value), len(x), len(x)))
        hessian[self._output, a, b] = hessian[self._output, b, a] = at
        with np.errstate(invalid="ignore", over="ignore"):
            most = np.vstack([both * (np.abs(at) + around), both[3] * around])
            curved = np.outer(np.append(shares[0] * shares[1], shares[0, 3] * shares[1, 3]), far)
            if len(self._curved):
                # The pairs of an output are adjacent
                curved[:, self._curved] += np.add.reduceat(most, self._begins, axis=1)
            from_moved, turned, from_apart, squared, loose = curved
            linear = size @ np.array([moved, radius, apart]).T
            return Bounds(
                value,
                slope,
                linear[:, 0] + from_moved / 2,
                linear[:, 1] + turned + squared / 2,
                linear[:, 2] + from_apart + squared / 2,
                turned,
                hessian,
                linear[:, 2] + from_apart + loose / 2,
            )


@lru_cache(maxsize=32)
def _compiled(function: str) -> tuple[tuple[int, int], Direct, Direct, np.ndarray]:
    """Return for a serialized function: the shape of its slope, functions for value and slope and for the
    terms of bounds, and the entries of f'' that are not zero.
    """
    f = ca.Function.deserialize(function)
    n = f.numel_in(0)
    symbols, fixed, radius = ca.SX.sym("x", n), ca.SX.sym("fixed", f.numel_in(1)), ca.SX.sym("radius", n)
    value = f(symbols, fixed)
    slope = ca.densify(ca.jacobian(value, symbols))
    leaves, box = [*ca.vertsplit(symbols), *ca.vertsplit(fixed)], ca.vertsplit(radius)

    def leaf(k: int) -> _Jet:
        return _Jet({(): leaves[k]} | ({(k,): ca.SX(1)} if k < n else {}), ca.SX(0), box)

    jets = fold(value, leaves, leaf, lambda number: _Jet({(): ca.SX(number)}, ca.SX(0), box), _apply)
    places, at, around, far = [], [], [], []
    for k, jet in enumerate(jets):
        seconds = {tuple(sorted(pair)) for m in jet.terms if len(m) > 1 for pair in _pairs(m)}
        for a, b in sorted(seconds):
            places.append((k, a, b))
            at.append(jet.terms.get((a, b), ca.SX(0)) * (2 if a == b else 1))
            around.append(jet.third(a, b))
        far.append(math.perm(ORDER + 1, 2) * jet.rest)
    parts = [ca.densify(ca.vertcat(ca.SX(0, 1), *part)) for part in (at, around, far)]
    tangent = Direct(ca.Function("tangent", [symbols, fixed], [value, slope]))
    bounds = Direct(ca.Function("bounds", [symbols, fixed, radius], [value, slope, *parts]))
    return slope.shape, tangent, bounds, np.array(places, int).reshape(-1, 3).T


ORDER = 3  # of the polynomials
Monomial = tuple[int, ...]  # indices of the variables, ascending


def _pairs(monomial: Monomial) -> list[tuple[int, int]]:
    """Return the pairs of variables whose second derivative is not zero."""
    return [(monomial[i], monomial[j]) for j in range(len(monomial)) for i in range(j)]


@dataclass(frozen=True)
class _Jet:
    """A function near x: its Taylor coefficients `terms` up to ORDER, by monomial, and `rest`: over the whole
    box, whose radii are `box`, the sum of |derivatives| of the next order over its factorial, each times the
    radii it belongs to.
    """

    terms: dict[Monomial, ca.SX]
    rest: ca.SX
    box: list[ca.SX]

    @property
    def value(self) -> ca.SX:
        return self.terms.get((), ca.SX(0))

    @cached_property
    def sizes(self) -> list[ca.SX]:
        """Return bounds by order, from 0 to ORDER + 1, defined as `rest`, over the box."""
        here = [ca.SX(0) for _ in range(ORDER + 1)]
        for monomial, coefficient in self.terms.items():
            term = ca.fabs(coefficient)
            for k in monomial:
                term *= self.box[k]
            here[len(monomial)] += term
        here.append(self.rest)
        return [
            sum((math.comb(i, j) * here[i] for i in range(j + 1, ORDER + 2)), here[j])
            for j in range(ORDER + 2)
        ]

    @cached_property
    def spread(self) -> ca.SX:
        """Return a bound of the deviation of the function from its value at x."""
        return self.sizes[0] - ca.fabs(self.value)

    def third(self, a: int, b: int) -> ca.SX:
        """Return a bound of the deviation of the polynomial's derivative by a and b from its value at x."""
        bound = ca.SX(0)
        for monomial, coefficient in self.terms.items():
            left = list(monomial)
            if len(monomial) == 3 and a in left:
                left.remove(a)
                if b in left:
                    left.remove(b)
                    times = math.prod(math.factorial(monomial.count(k)) for k in set(monomial))
                    bound += times * ca.fabs(coefficient) * self.box[left[0]]
        return bound

    def plus(self, other: _Jet, sign: int = 1) -> _Jet:
        terms = dict(self.terms)
        for monomial, coefficient in other.terms.items():
            terms[monomial] = (
                terms[monomial] + sign * coefficient if monomial in terms else sign * coefficient
            )
        return _Jet(terms, self.rest + other.rest, self.box)

    def times(self, other: _Jet) -> _Jet:
        terms = _product(self.terms, other.terms)
        if not any(self.terms) or not any(other.terms):  # a constant
            constant, jet = (other, self) if any(self.terms) else (self, other)
            return _Jet(terms, ca.fabs(constant.value) * jet.rest, self.box)
        rest = sum((x * y for x, y in zip(self.sizes, reversed(other.sizes), strict=True)), ca.SX(0))
        return _Jet(terms, rest, self.box)

    def through(self, coefficients: Sequence[ca.SX], most: Sequence[ca.SX]) -> _Jet:
        """Return g of this, from the Taylor coefficients of g at `value` up to ORDER and their bounds over
        the range up to ORDER + 1."""
        if not any(self.terms):
            return _Jet({(): coefficients[0]}, ca.SX(0), self.box)
        shift = {m: c for m, c in self.terms.items() if m}
        terms: dict[Monomial, ca.SX] = {(): coefficients[ORDER]}
        for coefficient in reversed(coefficients[:ORDER]):  # Horner's scheme
            terms = _product(terms, shift)
            terms[()] = coefficient
        powers, size, rest = [ca.SX(0), *self.sizes[1:]], [ca.SX(0), *self.sizes[1:]], ca.SX(0)
        for bound in most[1:]:  # the term of order ORDER + 1 of each power of the shift
            rest += bound * powers[ORDER + 1]
            powers = [
                sum((powers[i] * size[k - i] for i in range(k + 1)), ca.SX(0)) for k in range(ORDER + 2)
            ]
        return _Jet(terms, rest, self.box)


def _product(one: dict[Monomial, ca.SX], other: dict[Monomial, ca.SX]) -> dict[Monomial, ca.SX]:
    """Return the product of two polynomials, up to ORDER."""
    terms: dict[Monomial, ca.SX] = {}
    for m, x in one.items():
        for n, y in other.items():
            if len(m) + len(n) <= ORDER:
                monomial = tuple(sorted(m + n))
                terms[monomial] = terms[monomial] + x * y if monomial in terms else x * y
    return terms


def _power(x: _Jet, exponent: float) -> _Jet:
    """Return the coefficients of a power of a positive quantity, or any quantity for a negative integer;
    infinite if it may be 0."""
    binomials = [math.prod((exponent - i) / (i + 1) for i in range(k)) for k in range(ORDER + 2)]
    size, value = ca.fabs(x.value), x.value
    least = ca.fmax((value if exponent > 0 else size) - x.spread, 1e-200)
    root = ca.sqrt(value) if exponent == 0.5 else 1 / value
    coefficients = [root]
    for k in range(1, ORDER + 1):
        coefficients.append(coefficients[-1] / value * (binomials[k] / binomials[k - 1]))
    lowest = ca.sqrt(least) if exponent == 0.5 else 1 / least
    most = [lowest]
    for k in range(1, ORDER + 2):
        most.append(most[-1] / least * abs(binomials[k] / binomials[k - 1]))
    return x.through(coefficients, most)


def _wave(x: _Jet, quarter: int) -> _Jet:
    """Return sin(x + quarter pi / 2)."""
    cycle = [ca.sin(x.value), ca.cos(x.value), -ca.sin(x.value), -ca.cos(x.value)]
    values = [cycle[(quarter + k) % 4] for k in range(ORDER + 2)]
    most = [ca.fmin(1, ca.fabs(value) + x.spread) / math.factorial(k) for k, value in enumerate(values)]
    return x.through([value / math.factorial(k) for k, value in enumerate(values[:-1])], most)


def _sign(x: _Jet) -> _Jet:
    """Return a piecewise constant; without bounds unless it is constant over the box."""
    rest = ca.if_else(ca.fabs(x.value) > x.spread, 0, np.inf) if any(x.terms) else ca.SX(0)
    return _Jet({(): ca.sign(x.value)}, rest, x.box)


RULES: dict[int, Callable[..., _Jet]] = {
    ca.OP_ASSIGN: lambda x: x,
    ca.OP_ADD: lambda x, y: x.plus(y),
    ca.OP_SUB: lambda x, y: x.plus(y, -1),
    ca.OP_MUL: lambda x, y: x.times(y),
    ca.OP_DIV: lambda x, y: x.times(_power(y, -1)),
    ca.OP_NEG: lambda x: _Jet({m: -c for m, c in x.terms.items()}, x.rest, x.box),
    ca.OP_TWICE: lambda x: x.plus(x),
    ca.OP_SQ: lambda x: x.times(x),
    ca.OP_INV: lambda x: _power(x, -1),
    ca.OP_SQRT: lambda x: _power(x, 0.5),
    ca.OP_SIN: lambda x: _wave(x, 0),
    ca.OP_COS: lambda x: _wave(x, 1),
    ca.OP_TAN: lambda x: _wave(x, 0).times(_power(_wave(x, 1), -1)),
    ca.OP_FABS: lambda x: _scaled(x, _sign(x)),
    ca.OP_SIGN: _sign,
}


def _scaled(x: _Jet, sign: _Jet) -> _Jet:
    """Return x times a sign, which is constant if there are bounds."""
    return _Jet({m: sign.value * c for m, c in x.terms.items()}, x.rest + sign.rest, x.box)


def _apply(code: int, arguments: tuple[_Jet, ...]) -> _Jet:
    if code not in RULES:
        name = str(operate(code, *[ca.SX.sym("x") for _ in arguments]))
        raise BadInput(f"there is no bound for {name}, which the model contains")
    return RULES[code](*arguments)
