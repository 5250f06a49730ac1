"""Pairs of functions that may be flat outputs of a system with two inputs, found by linear algebra with exact
functions.

If the derived flag Delta_1, Delta_2, ... of q' = S nu grows one by one to the dimension N, functions h1 and
h2 are flat outputs with the fewest derivatives if and only if their rates along the fields of the flag of
dimension N - 1 are proportional: dh1 and dh2 have rank 1 on it, and 2 on all directions (S. Li, W. Respondek,
Flat outputs of two-input driftless control systems, ESAIM: COCV 18, 2012). Given one of the two, or the ratio
of the rates, the other unknowns are linear.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

from sympy.polys.rings import PolyElement

from ...model.algebra.ratios import Ratio
from ..distributions.brackets import Span, VectorField
from ..distributions.distribution import Distribution
from ..distributions.integrals import constant_polynomials, monomials, vanishing_combinations
from ..exact.functions import Functions
from ..exact.points import random_point

DEGREE = 2  # highest degree of polynomials in coordinates, sines and cosines

Pair = tuple[Ratio, Ratio]


def pairs(Delta: Distribution) -> Iterator[Pair]:
    """Return pairs of polynomials whose rates along the flag are proportional; Delta has two fields, and its
    derived flag grows one by one. Raises TooLarge.

    First two coordinates, each plus a function of angles: points of the robot, such as the middle of an axle.
    Then a coordinate and any polynomial.
    """
    flag = Delta.derived.basis[:-1]
    yield from _points(Delta, flag)
    for k in range(Delta.functions.n):
        yield from _with_coordinate(Delta, flag, k)


def _points(Delta: Distribution, flag: Sequence[VectorField]) -> Iterator[Pair]:
    """Return pairs q_i + f, q_j + g, where f and g are polynomials in sines and cosines that do not depend on
    q_i and q_j.

    A one-form a dq_i + b dq_j + ... that vanishes on the flag is then a dh1 + b dh2: a (q_i + f)' + b (q_j +
    g)' = 0 along all fields of the flag, linear in the coefficients of f and g.
    """
    functions = Delta.functions
    rates = [functions.rates_along(field.vector) for field in flag]
    forms = Span(functions, list(flag)).complement()
    gens, constants = functions.ring.gens, functions.constants
    gradients = [functions.gradient(generator) for generator in gens]
    waves = [k for angle in functions.angles for k in (angle.cosine, angle.sine)]
    alone = [k for k in range(functions.n) if sum(bool(gradient[k]) for gradient in gradients) == 1]
    for i, j in itertools.combinations(alone, 2):
        weights = [(form[i], form[j]) for form in forms if form[i] or form[j]]
        if len(weights) != 1 or not all(weights[0]):
            continue
        (a, b), base = weights[0], [gens[constants + i], gens[constants + j]]
        others = [k for k in waves if not gradients[k][i] and not gradients[k][j]]
        for degree in range(DEGREE + 1):
            added = monomials(functions, others, degree)
            terms = [(weight, m) for weight in (a, b) for m in added]
            images = [
                [functions.times(weight, functions.along(rate, m)) for rate in rates] for weight, m in terms
            ]
            own = [functions.dot((a, b), [functions.along(rate, q) for q in base]) for rate in rates]
            solved = [c for c in vanishing_combinations(functions, [*images, own]) if len(terms) in c]
            if solved:
                scale = solved[0].pop(len(terms))
                found = [scale * q for q in base]
                for k, coefficient in solved[0].items():
                    found[k >= len(added)] += coefficient * terms[k][1]
                yield (found[0], scale), (found[1], scale)
                break


def _with_coordinate(Delta: Distribution, flag: Sequence[VectorField], k: int) -> Iterator[Pair]:
    """Return pairs of the coordinate q_k and a polynomial that is constant along the fields of the flag along
    which q_k is: the columns of `flag` combined so that q_k does not change."""
    functions, h1 = Delta.functions, Delta.functions.ring.gens[Delta.functions.constants + k]
    moving = [field for field in flag if field.vector[k]]
    if not moving:
        return
    along = min(moving, key=lambda field: len(field.vector[k]))
    held = [
        replace(field, vector=_without(functions, field, along, k)) if field.vector[k] else field
        for field in flag
        if field is not along
    ]
    if not _involutive(functions, held):
        return
    point, one = random_point(functions, seed=k), functions.ring.one
    fixed = [*Delta.annihilator, functions.gradient(h1)]
    for h2 in constant_polynomials(functions, held, DEGREE):
        if point.rank([*fixed, functions.gradient(h2)]) > len(fixed):
            yield (h1, one), (h2, one)


def _without(functions: Functions, field: VectorField, other: VectorField, k: int) -> tuple[PolyElement, ...]:
    """Return the combination of two fields whose entry k is zero, without a common factor."""
    common = field.vector[k].gcd(other.vector[k])
    up, by = other.vector[k].exquo(common), field.vector[k].exquo(common)
    vector = tuple(
        functions.times(up, a) - functions.times(by, b)
        for a, b in zip(field.vector, other.vector, strict=True)
    )
    return functions.primitive(vector)[1]


def _involutive(functions: Functions, fields: Sequence[VectorField]) -> bool:
    """Whether brackets of the fields are combinations of them at a random point: if not,
    they are not involutive."""
    point, vectors = random_point(functions, seed=functions.n), [field.vector for field in fields]
    brackets = [functions.bracket(x, y) for x, y in itertools.combinations(vectors, 2)]
    return point.rank([*vectors, *brackets]) == len(vectors)
