"""The holonomic part of the constraints: functions C(q) that stay constant along every motion, dC = 0 on Delta*."""

import functools
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import sympy as sp
from sympy.polys.matrices import DomainMatrix
from sympy.polys.rings import PolyElement

from ...model.errors import ModelError
from ..exact.functions import Functions, TooLarge, Vector
from ..exact.points import MODULAR, Point, random_point
from ..exact.symbolic import written
from .distribution import Distribution

DEGREE = 3  # of the polynomials in coordinates, sines and cosines that are tried
MONOMIALS = 160  # more are not tried
OPERATIONS = 80  # of an integrand; for larger ones no antiderivative is looked for
SUBSETS = 40  # of coordinates that could go, at most this many are listed


@dataclass(frozen=True)
class FirstIntegral:
    """C(q) = `function` is constant. Where C is linear in a coordinate with a coefficient that is never zero, it is `solved`."""

    function: sp.Expr
    solved: tuple[sp.Symbol, sp.Expr] | None

    def text(self) -> str:
        """As an equation."""
        if self.solved is None:
            return f"{written(self.function)} = const"
        coordinate, rest = self.solved
        return f"{coordinate} = const" if rest == 0 else f"{coordinate} = {written(rest)} + const"


@dataclass(frozen=True)
class Holonomic:
    """k = `count` constraints integrate; `integrals` are those found in closed form, `forms` span their differentials.

    `could_go` lists sets of k coordinates that follow from the others, near generic points.
    """

    count: int
    forms: tuple[sp.Matrix, ...]
    integrals: tuple[FirstIntegral, ...]
    could_go: tuple[tuple[str, ...], ...]

    def text(self) -> list[str]:
        """Lines: the integrals, what was not found, the coordinates that could go."""
        lines = [integral.text() for integral in self.integrals]
        missing = self.count - len(self.integrals)
        if missing:
            what = "one more integral exists" if missing == 1 else f"{missing} more integrals exist"
            lines.append(f"{what if lines else what.replace(' more', '')} but no closed form was found")
        if self.could_go:
            lines.append("could go: " + " or ".join(" and ".join(names) for names in self.could_go))
        return lines


def holonomic(found: Distribution) -> Holonomic:
    """The integrals: polynomials in coordinates, sines and cosines first, then closed one-forms. Each is verified exactly."""
    count = found.holonomic
    if not count:
        return Holonomic(0, (), (), ())
    functions, forms = found.functions, found.annihilator
    expressions = tuple(sp.Matrix([[functions.expression(entry) for entry in form]]) for form in forms)
    point = random_point(functions, seed=count)
    gradients: list[Vector] = []
    integrals: list[FirstIntegral] = []
    for function, gradient in itertools.chain(_polynomials(found), _closed(found, forms)):
        if point.rank([*gradients, gradient]) > len(gradients):
            gradients.append(gradient)
            integrals.append(_integral(functions, function, gradient))
        if len(integrals) == count:
            break
    return Holonomic(count, expressions, tuple(integrals), _could_go(functions, forms, point))


def _polynomials(found: Distribution) -> Iterator[tuple[sp.Expr, Vector]]:
    """Integrals that are polynomials, with multiples of their gradients.

    With constant coefficients in the coordinates first, then of growing degree in coordinates, sines and cosines.
    """
    functions = found.functions
    gens = functions.ring.gens
    coordinates = gens[functions.constants : functions.constants + functions.n]
    others = [gens[k] for k in range(functions.constants, len(gens)) if k not in functions.roots]
    for variables, degree in ((coordinates, 1), *((others, degree) for degree in range(1, DEGREE + 1))):
        monomials = [
            functions.normal(math.prod(factors, start=functions.ring.one))
            for size in range(1, degree + 1)
            for factors in itertools.combinations_with_replacement(variables, size)
        ]
        monomials = [m for m in dict.fromkeys(monomials) if len(m) == 1]
        if len(monomials) > MONOMIALS:
            return
        try:
            integrals = _constant_along(found, monomials)
        except TooLarge:
            return
        for polynomial in integrals:
            yield functions.expression(polynomial), functions.gradient(polynomial)


def _constant_along(found: Distribution, monomials: Sequence[PolyElement]) -> list[PolyElement]:
    """Combinations of the monomials, coefficients in the parameters, whose rate is zero along Delta*; the shortest first."""
    functions = found.functions
    fixed = random_point(functions, seed=len(monomials))
    rates = [functions.rates_along(field.vector) for field in found.filtration.basis]
    images = [[functions.along(rate, monomial) for rate in rates] for monomial in monomials]
    rows: dict[tuple, dict[int, PolyElement]] = {}
    for column, image in enumerate(images):
        for place, polynomial in enumerate(image):
            for powers, coefficient in polynomial.terms():
                key = (place, powers[functions.constants :])
                term = functions.ring.from_dict({(*powers[: functions.constants], *[0] * len(key[1])): coefficient})
                entry = rows.setdefault(key, {})
                entry[column] = entry.get(column, functions.ring.zero) + term
    supports = _supports([{k: fixed(p) for k, p in row.items()} for row in rows.values()], len(monomials))
    domain = functions.ring.to_domain()
    field = domain.get_field()
    integrals = []
    for support in sorted(supports, key=len):
        used = [[row.get(k, functions.ring.zero) for k in support] for row in rows.values() if any(k in row for k in support)]
        if used:
            matrix = DomainMatrix(used, (len(used), len(support)), domain).convert_to(field)
            solutions = matrix.nullspace().to_list()
        else:
            solutions = [[field.one] * len(support)]
        for solution in solutions:
            common = functions.ring.one
            for entry in solution:
                common = common.lcm(entry.denom)
            scaled = [entry.numer * common.exquo(entry.denom) for entry in solution]
            shared = functools.reduce(PolyElement.gcd, scaled)
            made = sum((c.exquo(shared) * monomials[k] for c, k in zip(scaled, support, strict=True)), functions.ring.zero)
            if made and not any(functions.along(rate, made) for rate in rates):
                integrals.append(made)
    return integrals


def _supports(rows: list[dict[int, object]], columns: int) -> list[tuple[int, ...]]:
    """The places of nonzero entries of a basis of the null space, modulo the prime."""
    if not rows:
        return [(k,) for k in range(columns)]
    dense = [[row.get(k, MODULAR.zero) for k in range(columns)] for row in rows]
    null = DomainMatrix(dense, (len(dense), columns), MODULAR).nullspace().to_list()
    return [tuple(k for k, entry in enumerate(vector) if entry) for vector in null]


def _closed(found: Distribution, forms: Sequence[Vector]) -> Iterator[tuple[sp.Expr, Vector]]:
    """Integrals, with multiples of their gradients, of one-forms that are closed, or are so divided by one of their entries."""
    functions = found.functions
    for form in forms:
        for divisor in dict.fromkeys([functions.ring.one, *filter(None, form)]):
            if _is_closed(functions, form, divisor):
                closed = [functions.quotient(entry, divisor) for entry in form]
                made = _integrated(functions, closed)
                if made is not None and all(
                    _is_zero(functions, sp.diff(made, q) - e) for q, e in zip(functions.coordinates, closed, strict=True)
                ):
                    yield made, form
                    break


def _is_closed(functions: Functions, form: Vector, divisor: PolyElement) -> bool:
    """d(form / divisor) = 0?"""
    slope = functions.gradient(divisor)
    slopes = [functions.gradient(entry) for entry in form]
    rates = [
        [functions.normal(divisor * slopes[i][j] - form[i] * slope[j]) for j in range(functions.n)] for i in range(functions.n)
    ]
    return all(rates[i][j] == rates[j][i] for i, j in itertools.combinations(range(functions.n), 2))


def _integrated(functions: Functions, form: list[sp.Expr]) -> sp.Expr | None:
    """C with dC = form, coordinate by coordinate; None when an antiderivative is not found."""
    total = sp.Integer(0)
    for coordinate, entry in zip(functions.coordinates, form, strict=True):
        rest = entry - sp.diff(total, coordinate)
        if total != 0:
            rest = sp.simplify(rest) if rest.count_ops() <= OPERATIONS else rest
        part = _antiderivative(rest, coordinate)
        if part is None:
            return None
        total += part
    return total


def _antiderivative(integrand: sp.Expr, x: sp.Symbol) -> sp.Expr | None:
    """By x, of a function rational in x, or in sine and cosine of one argument linear in x; None for any other."""
    if not integrand.has(x):
        return integrand * x
    if integrand.count_ops() > OPERATIONS:
        return None
    if integrand.is_rational_function(x):
        return sp.integrals.rationaltools.ratint(integrand, x, real=True)
    arguments = {atom.args[0] for atom in integrand.atoms(sp.sin, sp.cos) if atom.has(x)}
    if len(arguments) != 1:
        return None
    (argument,) = arguments
    t, slope = sp.Dummy("t", real=True), sp.diff(argument, x)
    replaced = integrand.subs({sp.sin(argument): 2 * t / (1 + t**2), sp.cos(argument): (1 - t**2) / (1 + t**2)})
    if slope.has(x) or replaced.has(x) or not replaced.is_rational_function(t):
        return None
    integral = sp.integrals.rationaltools.ratint(sp.together(replaced * 2 / (slope * (1 + t**2))), t, real=True)
    return integral.subs(t, sp.tan(argument / 2))


def _is_zero(functions: Functions, expression: sp.Expr) -> bool:
    """Exactly; False also where it cannot be told."""
    plain = sp.together(expression.replace(sp.tan, lambda a: sp.sin(a) / sp.cos(a)))
    try:
        return not Functions(functions.name, functions.coordinates, functions.parameters, [plain]).ratio(plain)[0]
    except ModelError:
        return False


def _integral(functions: Functions, function: sp.Expr, gradient: Vector) -> FirstIntegral:
    """Solved for the first coordinate for which this can be done everywhere."""
    for k, coordinate in enumerate(functions.coordinates):
        if gradient[k] and functions.is_constant(gradient[k]) and functions.never_zero(gradient[k]):
            slope = sp.diff(function, coordinate)
            rest = sp.factor(sp.expand(coordinate - function / slope))
            if not slope.has(*functions.coordinates) and not rest.has(coordinate):
                return FirstIntegral(function, (coordinate, rest))
    return FirstIntegral(function, None)


def _could_go(functions: Functions, forms: Sequence[Vector], point: Point) -> tuple[tuple[str, ...], ...]:
    """Sets of as many coordinates as forms, in which the forms are independent."""
    subsets = itertools.combinations(range(functions.n), len(forms))
    good = (chosen for chosen in subsets if point.rank([tuple(form[k] for k in chosen) for form in forms]) == len(forms))
    return tuple(tuple(str(functions.coordinates[k]) for k in chosen) for chosen in itertools.islice(good, SUBSETS))
