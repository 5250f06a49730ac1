"""The distribution Delta of a system: the span of the columns of S(q), its filtration,
and the closure Delta*, paper 2.1."""

import functools
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import sympy as sp
from sympy.polys.rings import PolyElement

from ...model.algebra.ratios import in_lowest_terms
from ...model.errors import ModelError
from ...model.mechanism import Mechanism, Quantity
from ...model.reduction import ReducedSystem
from ...model.rolling.kinematics import Kinematics, kinematics
from ..exact.functions import Functions, TooLarge, TooMuchWork, Vector
from ..exact.points import Point, refuse_dependent_roots
from ..exact.real_points import RealPoint
from ..exact.symbolic import as_matrix, symbol, symbolic
from .brackets import Filtration, Span, VectorField, filtration


@dataclass(frozen=True, eq=False)
class Distribution:
    """Delta, exactly: `fields` are the columns of S, `forms` the rows of A (none if only S is given), up to
    factors.

    `given`: whether S is that of the system, not one computed from A.
    """

    name: str
    coordinates: tuple[Quantity, ...]
    parameters: tuple[Quantity, ...]
    given: bool
    functions: Functions
    S: sp.Matrix
    fields: tuple[VectorField, ...]
    forms: tuple[VectorField, ...]

    @cached_property
    def filtration(self) -> Filtration:
        """Delta_1 = Delta, Delta_(i+1) = Delta_i + [Delta, Delta_i];
        the last is Delta*. Raises ModelError if too large."""
        return self._filtration(derived=False)

    @cached_property
    def derived(self) -> Filtration:
        """The derived flag Delta_(i+1) = Delta_i + [Delta_i, Delta_i]. Raises ModelError if too large."""
        return self._filtration(derived=True)

    @property
    def growth(self) -> tuple[int, ...]:
        """Generic dimensions of the filtration, the growth vector."""
        return self.filtration.growth

    @property
    def holonomic(self) -> int:
        """k = n - dim Delta*, the number of holonomic constraints."""
        return self.functions.n - self.growth[-1]

    @property
    def m(self) -> int:
        """Number of constraints."""
        return self.functions.n - len(self.fields)

    @cached_property
    def annihilator(self) -> list[Vector]:
        """k one-forms that vanish on Delta*: the differentials of the integrals,
        up to combinations with functions."""
        with provable(self.name):
            return Span(self.functions, list(self.filtration.basis)).complement()

    def near(self, point: Point | RealPoint) -> "Distribution":
        """Return the distribution with fields that span Delta near the point: the columns of S, or others if
        S is invalid and A is not."""
        columns = [column.whole(self.functions) for column in self.fields]
        if point.rank(columns) == len(columns) or not self.forms:
            return self
        span = Span(self.functions, point=point)
        for form in self.forms:
            span.add(form)
        return replace(self, fields=_unscaled(span.complement()))

    def _filtration(self, derived: bool) -> Filtration:
        with provable(self.name):
            return filtration(self.functions, self.fields, derived)


@contextmanager
def provable(name: str) -> Iterator[None]:
    """Convert TooLarge and TooMuchWork to ModelError within the block."""
    try:
        yield
    except TooMuchWork as error:
        raise ModelError(
            f"{name}: not decided within {error}; write the system in simpler coordinates, or give numbers "
            "for parameters"
        ) from None
    except TooLarge:
        raise ModelError(
            f"{name}: the functions of q grow too large for an exact proof; write the system in simpler "
            "coordinates, or give numbers for parameters"
        ) from None


def distribution(system: Kinematics | Mechanism | ReducedSystem) -> Distribution:
    """Return the distribution of a system.

    Raises ModelError if constraints are dependent everywhere (it names one), if A S is not exactly zero, if
    columns of S are dependent, and for functions of q that cannot be treated exactly.
    """
    model = kinematics(system)
    with provable(model.name):
        return _distribution(model)


def _distribution(model: Kinematics) -> Distribution:
    quantities = (*model.coordinates, *model.parameters)
    A = _exact(model.A, quantities, f"{model.name}: A")
    S = _exact(model.S, quantities, f"{model.name}: S")
    symbols = [symbol(c) for c in model.coordinates], [symbol(p) for p in model.parameters]
    functions = Functions(model.name, *symbols, [*(A or ()), *(S or ())])
    refuse_dependent_roots(functions)
    forms = (
        [_polynomial(functions, list(A.row(k)), f"row {k + 1}") for k in range(A.rows)]
        if A is not None
        else []
    )
    rows = _independent(functions, forms)
    if len(rows) < len(forms):
        name = next(
            name
            for name, form in zip(model.constraint_names, forms, strict=True)
            if form.name not in {r.name for r in rows}
        )
        raise ModelError(
            f"{model.name}: the constraints are not independent: {name!r} follows from the others "
            "everywhere; drop it"
        )
    fields: Sequence[VectorField]
    if S is None:
        vectors = Span(functions, rows).complement()
        fields = _unscaled(vectors)
        S = sp.Matrix([[functions.expression(v[k]) for v in vectors] for k in range(functions.n)])
    else:
        fields = [_polynomial(functions, list(S.col(k)), f"s{k + 1}") for k in range(S.cols)]
    for name, form in zip(model.constraint_names, forms, strict=False):
        for column in fields:
            if functions.dot(form.vector, column.vector):
                raise ModelError(
                    f"{model.name}: A S is not zero: column {column.name} of S does not satisfy constraint "
                    f"{name!r}"
                )
    if len(_independent(functions, fields)) < len(fields):
        raise ModelError(
            f"{model.name}: the columns of S depend on each other everywhere; choose other quasi-velocities"
        )
    return Distribution(
        model.name,
        model.coordinates,
        model.parameters,
        model.S is not None,
        functions,
        S,
        tuple(fields),
        tuple(forms),
    )


def part(
    Delta: Distribution, rows: Sequence[int], columns: Sequence[int], expanded: bool = False
) -> Distribution:
    """Return the distribution of these coordinates alone, spanned by these columns of S, which must be
    independent in these rows and depend on no other coordinate there. `expanded`: sines and cosines of sums
    are written in those of the coordinates."""
    coordinates = tuple(Delta.coordinates[k] for k in rows)
    S = Delta.S.extract(list(rows), list(columns))
    parameters = tuple(p for p in Delta.parameters if S.has(symbol(p)))
    symbols = [symbol(c) for c in coordinates]
    waves = (
        [sp.cos(q) for q in symbols if any(wave.has(q) for wave in S.atoms(sp.sin, sp.cos))]
        if expanded
        else []
    )
    functions = Functions(Delta.name, symbols, [symbol(p) for p in parameters], [*waves, *S])
    fields = tuple(_polynomial(functions, list(S.col(k)), f"s{k + 1}") for k in range(S.cols))
    return Distribution(Delta.name, coordinates, parameters, True, functions, S, fields, ())


def _exact(matrix: ca.SX | None, quantities: Sequence, where: str) -> sp.Matrix | None:
    return None if matrix is None else as_matrix(symbolic(matrix, quantities, where), matrix.shape)


def _polynomial(functions: Functions, entries: list[sp.Expr], name: str) -> VectorField:
    """Convert entries that are ratios to polynomials without a common factor,
    and record the multiplier and the divisor."""
    ratios = [functions.ratio(entry) for entry in entries]
    common = functools.reduce(PolyElement.lcm, [below for _, below in ratios])
    vector: Vector = tuple(functions.normal(above * common.exquo(below)) for above, below in ratios)
    if not any(vector):
        return VectorField(name, 1, vector)
    content, vector = functions.primitive(vector)
    above, below = in_lowest_terms(common, content)
    return VectorField(name, 1, vector, (above,), (below,))


def _unscaled(vectors: Sequence[Vector]) -> tuple[VectorField, ...]:
    return tuple(VectorField(f"s{k + 1}", 1, vector) for k, vector in enumerate(vectors))


def _independent(functions: Functions, vectors: Sequence[VectorField]) -> list[VectorField]:
    """Return the vectors that are independent of those before, in echelon form."""
    span = Span(functions)
    for vector in vectors:
        if any(vector.vector):
            span.add(vector)
    return span.fields
