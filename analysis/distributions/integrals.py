"""The holonomic part of the constraints: functions C(q) that are constant along every motion,
dC = 0 on Delta*."""

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
from .brackets import VectorField
from .distribution import Distribution

DEGREE = 3  # highest degree of polynomials in coordinates, sines and cosines
MONOMIALS = 160  # most monomials
OPERATIONS = 80  # most operations of an integrand; larger ones are not integrated
SUBSETS = 40  # most listed sets of coordinates that could be eliminated


@dataclass(frozen=True)
class FirstIntegral:
    """C(q) = `function` is constant. Where C is linear in a coordinate with a coefficient that is never zero,
    it is `solved`."""

    function: sp.Expr
    solved: tuple[sp.Symbol, sp.Expr] | None

    def text(self) -> str:
        """Return the integral as an equation."""
        if self.solved is None:
            return f"{written(self.function)} = const"
        coordinate, rest = self.solved
        return f"{coordinate} = const" if rest == 0 else f"{coordinate} = {written(rest)} + const"


@dataclass(frozen=True)
class Holonomic:
    """k = `count` constraints are integrable; `integrals` are those found in closed form, `forms` span their
    differentials.

    `could_go` lists sets of k coordinates that are functions of the others near generic points.
    """

    count: int
    forms: tuple[sp.Matrix, ...]
    integrals: tuple[FirstIntegral, ...]
    could_go: tuple[tuple[str, ...], ...]

    def text(self) -> list[str]:
        """Return lines: the integrals, those not found, the coordinates that could be eliminated."""
        lines = [integral.text() for integral in self.integrals]
        missing = self.count - len(self.integrals)
        if missing:
            remaining = "one more integral exists" if missing == 1 else f"{missing} more integrals exist"
            lines.append(
                f"{remaining if lines else remaining.replace(' more', '')} but no closed form was found"
            )
        if self.could_go:
            lines.append("could go: " + " or ".join(" and ".join(names) for names in self.could_go))
        return lines


def holonomic(Delta: Distribution) -> Holonomic:
    """Find the integrals: polynomials in coordinates, sines and cosines first, then closed one-forms. Each is
    verified exactly."""
    count = Delta.holonomic
    if not count:
        return Holonomic(0, (), (), ())
    functions, forms = Delta.functions, Delta.annihilator
    expressions = tuple(sp.Matrix([[functions.expression(entry) for entry in form]]) for form in forms)
    point = random_point(functions, seed=count)
    gradients: list[Vector] = []
    integrals: list[FirstIntegral] = []
    polynomials = constant_polynomials(functions, Delta.filtration.basis)
    found = ((functions.expression(each), functions.gradient(each)) for each in polynomials)
    for function, gradient in itertools.chain(found, _closed(Delta, forms)):
        if point.rank([*gradients, gradient]) > len(gradients):
            gradients.append(gradient)
            integrals.append(_integral(functions, function, gradient))
        if len(integrals) == count:
            break
    return Holonomic(count, expressions, tuple(integrals), _could_go(functions, forms, point))


def constant_polynomials(
    functions: Functions, fields: Sequence[VectorField], degree: int = DEGREE
) -> Iterator[PolyElement]:
    """Find polynomials that are constant along the fields.

    First in the coordinates with constant coefficients, then of increasing degree in coordinates, sines and
    cosines.
    """
    coordinates = range(functions.constants, functions.constants + functions.n)
    others = [k for k in range(functions.constants, len(functions.ring.gens)) if k not in functions.roots]
    for variables, power in ((coordinates, 1), *((others, power) for power in range(1, degree + 1))):
        found = monomials(functions, variables, power)
        if len(found) > MONOMIALS:
            return
        try:
            integrals = _constant_along(functions, fields, found)
        except TooLarge:
            return
        yield from integrals


def monomials(functions: Functions, variables: Sequence[int], degree: int) -> list[PolyElement]:
    """Return the products of at most `degree` of these generators, each once;
    those that are no monomials are left out."""
    products = [
        functions.normal(math.prod([functions.ring.gens[k] for k in factors], start=functions.ring.one))
        for size in range(1, degree + 1)
        for factors in itertools.combinations_with_replacement(variables, size)
    ]
    return [m for m in dict.fromkeys(products) if len(m) == 1]


def _constant_along(
    functions: Functions, fields: Sequence[VectorField], monomials: Sequence[PolyElement]
) -> list[PolyElement]:
    """Return combinations of the monomials, with coefficients in the parameters, that are constant along the
    fields; the shortest first."""
    rates = [functions.rates_along(field.vector) for field in fields]
    images = [[functions.along(rate, monomial) for rate in rates] for monomial in monomials]
    integrals = [
        sum((c * monomials[k] for k, c in combination.items()), functions.ring.zero)
        for combination in vanishing_combinations(functions, images)
    ]
    return [each for each in integrals if each and not any(functions.along(rate, each) for rate in rates)]


def vanishing_combinations(
    functions: Functions, images: Sequence[Sequence[PolyElement]]
) -> list[dict[int, PolyElement]]:
    """Return combinations of vectors, with coefficients in the parameters, without a common factor, that are
    zero: a basis, the shortest first."""
    fixed = random_point(functions, seed=len(images))
    rows: dict[tuple, dict[int, PolyElement]] = {}
    for column, image in enumerate(images):
        for place, polynomial in enumerate(image):
            for powers, coefficient in polynomial.terms():
                key = (place, powers[functions.constants :])
                term = functions.ring.from_dict(
                    {(*powers[: functions.constants], *[0] * len(key[1])): coefficient}
                )
                entry = rows.setdefault(key, {})
                entry[column] = entry.get(column, functions.ring.zero) + term
    supports = _supports([{k: fixed(p) for k, p in row.items()} for row in rows.values()], len(images))
    domain = functions.ring.to_domain()
    field = domain.get_field()
    combinations = []
    for support in sorted(supports, key=len):
        used = [
            [row.get(k, functions.ring.zero) for k in support]
            for row in rows.values()
            if any(k in row for k in support)
        ]
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
            combinations.append({k: c.exquo(shared) for k, c in zip(support, scaled, strict=True) if c})
    return combinations


def _supports(rows: list[dict[int, object]], columns: int) -> list[tuple[int, ...]]:
    """Return the places of nonzero entries of a basis of the null space, modulo the prime."""
    if not rows:
        return [(k,) for k in range(columns)]
    dense = [[row.get(k, MODULAR.zero) for k in range(columns)] for row in rows]
    null = DomainMatrix(dense, (len(dense), columns), MODULAR).nullspace().to_list()
    return [tuple(k for k, entry in enumerate(vector) if entry) for vector in null]


def _closed(Delta: Distribution, forms: Sequence[Vector]) -> Iterator[tuple[sp.Expr, Vector]]:
    """Find integrals, with multiples of their gradients, of one-forms that are closed,
    possibly after division by an entry."""
    functions = Delta.functions
    for form in forms:
        for divisor in dict.fromkeys([functions.ring.one, *filter(None, form)]):
            if _is_closed(functions, form, divisor):
                closed = [functions.quotient(entry, divisor) for entry in form]
                potential = _integrated(functions, closed)
                if potential is not None and all(
                    _is_zero(functions, sp.diff(potential, q) - e)
                    for q, e in zip(functions.coordinates, closed, strict=True)
                ):
                    yield potential, form
                    break


def _is_closed(functions: Functions, form: Vector, divisor: PolyElement) -> bool:
    """Whether d(form / divisor) = 0."""
    slope = functions.gradient(divisor)
    slopes = [functions.gradient(entry) for entry in form]
    rates = [
        [functions.normal(divisor * slopes[i][j] - form[i] * slope[j]) for j in range(functions.n)]
        for i in range(functions.n)
    ]
    return all(rates[i][j] == rates[j][i] for i, j in itertools.combinations(range(functions.n), 2))


def _integrated(functions: Functions, form: list[sp.Expr]) -> sp.Expr | None:
    """Return C with dC = form, integrated coordinate by coordinate;
    None if an antiderivative is not found."""
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
    """Return the antiderivative by x of a function rational in x,
    or in sine and cosine of an argument linear in x; else None."""
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
    replaced = integrand.subs(
        {sp.sin(argument): 2 * t / (1 + t**2), sp.cos(argument): (1 - t**2) / (1 + t**2)}
    )
    if slope.has(x) or replaced.has(x) or not replaced.is_rational_function(t):
        return None
    integral = sp.integrals.rationaltools.ratint(
        sp.together(replaced * 2 / (slope * (1 + t**2))), t, real=True
    )
    return integral.subs(t, sp.tan(argument / 2))


def _is_zero(functions: Functions, expression: sp.Expr) -> bool:
    """Whether the expression is exactly zero; False also if this cannot be decided."""
    plain = sp.together(expression.replace(sp.tan, lambda a: sp.sin(a) / sp.cos(a)))
    try:
        return not Functions(functions.name, functions.coordinates, functions.parameters, [plain]).ratio(
            plain
        )[0]
    except ModelError:
        return False


def _integral(functions: Functions, function: sp.Expr, gradient: Vector) -> FirstIntegral:
    """Solve for the first coordinate for which this is possible everywhere."""
    for k, coordinate in enumerate(functions.coordinates):
        if gradient[k] and functions.is_constant(gradient[k]) and functions.never_zero(gradient[k]):
            slope = sp.diff(function, coordinate)
            rest = sp.factor(sp.expand(coordinate - function / slope))
            if not slope.has(*functions.coordinates) and not rest.has(coordinate):
                return FirstIntegral(function, (coordinate, rest))
    return FirstIntegral(function, None)


def _could_go(functions: Functions, forms: Sequence[Vector], point: Point) -> tuple[tuple[str, ...], ...]:
    """Return sets of as many coordinates as forms in which the forms are independent."""
    subsets = itertools.combinations(range(functions.n), len(forms))
    good = (
        chosen
        for chosen in subsets
        if point.rank([tuple(form[k] for k in chosen) for form in forms]) == len(forms)
    )
    return tuple(
        tuple(str(functions.coordinates[k]) for k in chosen) for chosen in itertools.islice(good, SUBSETS)
    )
