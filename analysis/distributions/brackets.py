"""Lie brackets, the filtration they span, and the proof of its dimensions.

Everything is linear algebra over the field of the exact functions of q, by elimination without fractions. A
field is kept only up to a factor and to the fields before it: by [X, a Y] = a [X, Y] + X(a) Y this changes no
span.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from sympy.polys.rings import PolyElement

from ..exact.functions import Functions, TooLarge, Vector
from ..exact.points import Point
from ..exact.real_points import RealPoint

TERMS = 4000  # most terms of a bracket, in all components; proofs with larger brackets take too long


@dataclass(frozen=True)
class VectorField:
    """Its name as a bracket, the bracket's length, and n polynomial components.

    vector = product(above) / product(below) * (the bracket named) + a combination of the fields before it;
    entry `pivot` of all fields after it is 0.
    """

    name: str
    length: int
    vector: Vector
    above: tuple[PolyElement, ...] = ()
    below: tuple[PolyElement, ...] = ()
    pivot: int = -1

    def whole(self, functions: Functions) -> Vector:
        """Return the vector times its divisor, which vanishes where the field itself does."""
        return tuple(functools.reduce(functions.times, self.below, entry) for entry in self.vector)


@dataclass(frozen=True)
class Dependence:
    """factor * [left, right] = sum of coefficient * basis field, exactly;
    `left` and `right` as in `basis`."""

    name: str
    left: VectorField
    right: VectorField
    factor: PolyElement
    coefficients: dict[int, PolyElement]


@dataclass
class Span:
    """Vectors in echelon form, independent over the field of functions. `point`: pivots that do not vanish
    there are preferred."""

    functions: Functions
    fields: list[VectorField] = field(default_factory=list)
    point: Point | RealPoint | None = None

    def reduce(self, vector: Vector) -> tuple[list[tuple[int, PolyElement, PolyElement]], Vector]:
        """Return steps (k, up, by) in which vector := up * vector - by * field k, and the remainder: 0 for a
        vector in the span."""
        f, steps = self.functions, []
        for k, own in enumerate(self.fields):
            entry = vector[own.pivot]
            if entry:
                common = own.vector[own.pivot].gcd(entry)
                up, by = own.vector[own.pivot].exquo(common), entry.exquo(common)
                vector = tuple(f.normal(up * a - by * b) for a, b in zip(vector, own.vector, strict=True))
                refuse_large(vector)
                steps.append((k, up, by))
        return steps, vector

    def add(self, candidate: VectorField) -> tuple[PolyElement, dict[int, PolyElement]] | None:
        """Add an independent field; for a dependent one return factor and coefficients: factor * vector = sum
        coefficient * field."""
        f = self.functions
        steps, rest = self.reduce(candidate.vector)
        if not any(rest):
            factor, coefficients = f.ring.one, dict[int, PolyElement]()
            for k, up, by in steps:
                factor = f.times(factor, up)
                coefficients = {j: f.times(up, c) for j, c in coefficients.items()} | {k: by}
            return factor, coefficients
        content, rest = f.primitive(rest)
        pivot = min((k for k, entry in enumerate(rest) if entry), key=lambda k: self._difficulty(rest[k]))
        above = (*candidate.above, *(up for _, up, _ in steps))
        self.fields.append(
            replace(candidate, vector=rest, above=above, below=(*candidate.below, content), pivot=pivot)
        )
        return None

    def complement(self) -> list[Vector]:
        """Return a basis of the annihilator, n minus their number of vectors: one-forms for fields,
        fields for one-forms."""
        f = self.functions
        pivots = {own.pivot for own in self.fields}
        annihilator = []
        for free in (k for k in range(f.n) if k not in pivots):
            vector = [f.ring.one if k == free else f.ring.zero for k in range(f.n)]
            for own in reversed(self.fields):
                rest, pivot = f.dot(vector, own.vector), own.vector[own.pivot]
                common = pivot.gcd(rest)
                vector = [f.times(entry, pivot.exquo(common)) for entry in vector]
                vector[own.pivot] = -rest.exquo(common)
            refuse_large(vector)
            annihilator.append(f.primitive(tuple(vector))[1])
        return annihilator

    def _difficulty(self, entry: PolyElement) -> tuple:
        f = self.functions
        vanishes = self.point is not None and not self.point(entry)
        return vanishes, not f.never_zero(entry), not f.is_constant(entry), len(entry), sum(map(sum, entry))


@dataclass(frozen=True)
class Filtration:
    """Delta_1, Delta_2, ... with their generic dimensions `growth`; `basis` spans the last one, level by
    level.

    `dependences` are the exact identities of all computed brackets that depend on others.
    """

    basis: tuple[VectorField, ...]
    growth: tuple[int, ...]
    dependences: tuple[Dependence, ...]


def filtration(functions: Functions, generators: Sequence[VectorField], derived: bool = False) -> Filtration:
    """Return Delta_1 = span of the generators, which are independent, and Delta_(i+1) = Delta_i + [Delta_1,
    Delta_i], until it is involutive.

    `derived`: the derived flag, Delta_i + [Delta_i, Delta_i], instead. Raises TooLarge.
    """
    span = Span(functions)
    for generator in generators:
        span.add(generator)
    growth, dependences, before = [len(span.fields)], [], 0
    while before < growth[-1] < functions.n:
        for k in range(before, growth[-1]):
            right = span.fields[k]
            for left in span.fields[:k] if derived else generators[:k]:
                bracket = _bracket(functions, left, right)
                combination = span.add(bracket)
                if combination is not None:
                    dependences.append(Dependence(bracket.name, left, right, *combination))
                if len(span.fields) == functions.n:
                    return Filtration(tuple(span.fields), (*growth, functions.n), tuple(dependences))
        before = growth[-1]
        if len(span.fields) > before:
            growth.append(len(span.fields))
    return Filtration(tuple(span.fields), tuple(growth), tuple(dependences))


def _bracket(functions: Functions, left: VectorField, right: VectorField) -> VectorField:
    vector = functions.bracket(left.vector, right.vector)
    refuse_large(vector)
    above, below = (*left.above, *right.above, functions.delta), (*left.below, *right.below)
    return VectorField(f"[{left.name},{right.name}]", left.length + right.length, vector, above, below)


def refuse_large(vector: Sequence[PolyElement]) -> None:
    """Raise TooLarge for a vector with more than TERMS terms."""
    if sum(map(len, vector)) > TERMS:
        raise TooLarge


class Brackets:
    """All brackets of given fields, level by level, not divided by any function, so that they are valid
    everywhere.

    Brackets equal to a constant multiple of another are omitted.
    """

    def __init__(self, functions: Functions, generators: Sequence[Vector]):
        self.functions = functions
        self.levels: list[list[Vector]] = [list(generators)]

    def up_to(self, level: int) -> list[Vector]:
        """Return the brackets of Delta_level, shorter ones first. Raises TooLarge."""
        return [vector for k in range(level) for vector in self._level(k)]

    def growth_at(self, point: Point | RealPoint, steps: int, enough: int) -> tuple[int, ...]:
        """Return the dimensions of Delta_1, ..., at most Delta_steps, at a point, up to the dimension
        `enough`; fewer if too large."""
        growth: list[int] = []
        vectors: list[Vector] = []
        for level in range(steps):
            try:
                vectors += self._level(level)
            except TooLarge:
                break
            growth.append(point.rank(vectors))
            if growth[-1] >= enough:
                break
        return tuple(growth)

    def _level(self, level: int) -> list[Vector]:
        while len(self.levels) <= level:
            vectors, brackets = [vector for each in self.levels for vector in each], []
            for k, right in enumerate(self.levels[-1]):
                for left in self.levels[0] if len(self.levels) > 1 else self.levels[0][:k]:
                    vector = self.functions.bracket(left, right)
                    refuse_large(vector)
                    if any(vector) and not any(_parallel(vector, other) for other in vectors):
                        vectors.append(vector)
                        brackets.append(vector)
            self.levels.append(brackets)
        return self.levels[level]


def _parallel(a: Vector, b: Vector) -> bool:
    """Whether one vector is a constant multiple of the other."""
    if any(len(x) != len(y) for x, y in zip(a, b, strict=True)):
        return False
    k = next(k for k, entry in enumerate(a) if entry)
    return all(x * b[k].LC == y * a[k].LC for x, y in zip(a, b, strict=True))
