"""Real points where a function vanishes, with many digits, and ranks there.

A point is found where the function changes sign along a line. What changes sign nowhere vanishes at most on
smaller sets than hypersurfaces.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from types import ModuleType

import mpmath
import numpy as np
from sympy.polys.rings import PolyElement

from ...model.mechanism import SIGNS, Quantity
from .functions import Functions, Vector
from .points import NoPoint

DIGITS = 60
NEGLIGIBLE = mpmath.mpf(10) ** -45  # relative to the terms of a sum, or to the largest entry of a matrix
LINES = 24  # lines searched for a change of sign
SAMPLES = 64  # samples on each line
SIZE = 4.0  # most coordinates are tried between -SIZE and SIZE, in which angles make a whole turn
LARGER = 5.0  # the others are larger by up to this power of ten


@dataclass(frozen=True)
class RealPoint:
    """Values of all generators to DIGITS digits; `halves` has those of half angles instead, `q` those of the
    coordinates.

    `at_defaults`: the parameters are at their defaults.
    """

    q: tuple
    values: tuple
    halves: tuple
    at_defaults: bool

    def __call__(self, polynomial: PolyElement) -> mpmath.mpf:
        """Return the value of a polynomial; 0 if it does not exceed rounding."""
        return _value(polynomial, self.values)

    def on(self, form: PolyElement) -> bool:
        """Whether a form in half angles (`half_angles`) vanishes here."""
        return not _value(form, self.halves)

    def rank(self, vectors: Sequence[Vector]) -> int:
        """Return the rank of the vectors here."""
        with mpmath.workdps(DIGITS):
            rows = [[self(entry) for entry in vector] for vector in vectors]
            return rank([[entry / max(map(abs, row)) for entry in row] for row in rows if any(row)])


def rank(rows: list[list[mpmath.mpf]], negligible: float | mpmath.mpf = NEGLIGIBLE) -> int:
    """Return the number of pivots that are not negligible, with rows scaled to one:
    elimination with complete pivoting."""
    pivots = 0
    while rows:
        size, i, j = max((abs(entry), i, j) for i, row in enumerate(rows) for j, entry in enumerate(row))
        if size <= negligible:
            break
        pivot = rows.pop(i)
        rows = [[a - row[j] / pivot[j] * b for a, b in zip(row, pivot, strict=True)] for row in rows]
        pivots += 1
    return pivots


def real_point(
    functions: Functions,
    parameters: Sequence[Quantity],
    form: PolyElement,
    seed: int,
    avoiding: Iterable[PolyElement] = (),
) -> RealPoint:
    """Return a random real point where a form in half angles is zero and those to be avoided are not, the
    same for the same seed.

    The parameters are at their defaults if possible; otherwise they are varied too, with their declared
    signs. Raises NoPoint if none is found.
    """
    draw, avoiding = np.random.default_rng(seed), list(avoiding)
    possible = all(SIGNS[p.sign][0](p.default) for p in parameters)
    for at_defaults in [True] * possible + [False] * (len(parameters) > 0):
        for _ in range(LINES):
            a, b = (_random(functions, parameters, draw, at_defaults) for _ in range(2))
            point = _on_line(functions, form, a, b, at_defaults)
            if point is not None and point.on(form) and not any(map(point.on, avoiding)):
                return point
    raise NoPoint


def _random(
    functions: Functions, parameters: Sequence[Quantity], draw: np.random.Generator, at_defaults: bool
) -> list[float]:
    """Return values of parameters and coordinates."""
    fixed = []
    for p in parameters:
        value = abs(p.default) * np.exp(draw.uniform(-3.0, 3.0)) or draw.uniform(0.2, 2.0)
        fixed.append(p.default if at_defaults else value * draw.choice([-1, 1]) if p.sign == "any" else value)
    size = SIZE * 10 ** draw.choice([0.0, 0.0, draw.uniform(0.0, LARGER)])
    return [float(value) for value in (*fixed, *draw.uniform(-size, size, functions.n))]


def _on_line(
    functions: Functions, form: PolyElement, a: list[float], b: list[float], at_defaults: bool
) -> RealPoint | None:
    """Return the first zero with a change of sign between a and b."""

    def along(part):
        return [(1 - part) * x + part * y for x, y in zip(a, b, strict=True)]

    def value(part):
        return sum(
            _terms(
                form, _generators(functions, along(part), np if isinstance(part, np.ndarray) else mpmath)[1]
            )
        )

    parts = np.linspace(0.0, 1.0, SAMPLES)
    with np.errstate(all="ignore"):
        along_it = np.broadcast_to(value(parts), parts.shape).astype(float)
        changes = np.flatnonzero(along_it[1:] * along_it[:-1] < 0)
    if not len(changes):
        return None
    with mpmath.workdps(DIGITS + 10):
        ends = [mpmath.mpf(float(parts[changes[0] + k])) for k in (0, 1)]
        try:
            zero = mpmath.findroot(
                value, ends, solver="anderson", tol=mpmath.mpf(10) ** (-2 * DIGITS), maxsteps=100
            )
        except (ValueError, ZeroDivisionError):  # a pole
            return None
        q = along(zero)[-functions.n :]
        values, halves = _generators(functions, along(zero), mpmath)
        finite = all(mpmath.isfinite(v) and mpmath.im(v) == 0 for v in (*values, *halves))
        return RealPoint(tuple(q), tuple(values), tuple(halves), at_defaults) if finite else None


def _generators(functions: Functions, symbols: list, numbers: ModuleType) -> tuple[list, list]:
    """Return the values of all generators, and with half angles."""
    first = len(functions.parameters)
    values = [*symbols[:first], *[numbers.pi] * (functions.constants - first), *symbols[first:]]
    values += [0 * values[-1]] * (len(functions.expressions) - len(values))
    halves = list(values)
    for angle in functions.angles:
        top, bottom = (sum(_terms(part, values)) for part in angle.argument)
        values[angle.cosine], values[angle.sine] = numbers.cos(top / bottom), numbers.sin(top / bottom)
        halves[angle.cosine], halves[angle.sine] = (
            numbers.cos(top / bottom / 2),
            numbers.sin(top / bottom / 2),
        )
    for exponent in functions.exponents:
        top, bottom = (sum(_terms(part, values)) for part in exponent.argument)
        values[exponent.place] = halves[exponent.place] = numbers.exp(top / bottom)
    for place, radicand in functions.roots.items():
        values[place] = halves[place] = numbers.sqrt(sum(_terms(radicand, values)))
    return values, halves


def _terms(polynomial: PolyElement, values: Sequence) -> list:
    terms = []
    for powers, coefficient in polynomial.terms():
        term = int(coefficient)
        for value, power in zip(values, powers, strict=True):
            if power:
                term = term * value**power
        terms.append(term)
    return terms


def _value(polynomial: PolyElement, values: Sequence) -> mpmath.mpf:
    """Return the value, or 0 if it does not exceed the rounding of its terms and of generators of size
    one."""
    with mpmath.workdps(DIGITS):
        total = mpmath.fsum(_terms(polynomial, values))
        size = mpmath.fsum(map(abs, _terms(polynomial, [max(1, abs(value)) for value in values])))
        return total if abs(total) > NEGLIGIBLE * size else mpmath.mpf(0)
