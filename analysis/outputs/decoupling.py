"""The decoupling matrix (15) of an output map exactly: its determinant in factors, and where it vanishes, in formulas and words.

The gradient of a path's distance stands as two symbols n_x, n_y, so that the vehicle is seen apart from the path: det Phi is
then a product of a lever, of n across the heading, and of numbers of the vehicle.
"""

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import sympy as sp
from sympy.polys.rings import PolyElement

from ...model.algebra.ratios import Ratio
from ...model.linearization import Linearization
from ...model.mechanism import Quantity, quantity
from ...model.outputs import OutputRow, Through
from ..distributions.places import words
from ..exact.functions import Functions
from ..exact.half_angles import factors, halved, never_zero, product
from ..exact.points import NoPoint, Point, random_point, refuse_dependent_roots
from ..exact.readable import readable, unsigned
from ..exact.real_points import RealPoint, real_point
from ..exact.symbolic import as_matrix, symbol, symbolic, written
from .planar import Arm, Planar, arm, arm_quantities, planar, planar_quantities

Slope = tuple[sp.Expr, sp.Expr]  # derivative by a point in the plane

SHORT = 30  # operations of a formula with n_x, n_y written out; a longer one keeps them
SEEDS = 3  # points looked at on each condition


@dataclass(frozen=True)
class Condition:
    """`formula` = 0, and what that means. `confirmed`: Phi was found singular at real points where it holds, to many digits."""

    formula: sp.Expr
    words: str
    confirmed: bool

    def __str__(self) -> str:
        """In words, with the formula."""
        formula = f"{written(self.formula)} = 0"
        return f"{self.words} ({formula})" if self.words else formula


@dataclass(frozen=True, eq=False)
class Normal:
    """The gradient of a path's distance h at the point followed, as symbols and in the point's coordinates.

    `unit`: its length is 1, proved. `chi`: the curvature of the path, 1/m, positive where the gradient points away from the
    centre, where it is constant, proved. `point`: the point's coordinates, and what they are in q.
    """

    x: sp.Symbol
    y: sp.Symbol
    meaning: tuple[sp.Expr, sp.Expr]
    unit: bool
    chi: sp.Expr | None
    point: dict[sp.Symbol, sp.Expr]


@dataclass(frozen=True, eq=False)
class Decoupling:
    """An output map in exact symbols.

    `gradients`, p x n: of the rows by q, zero for rows of relative degree 1. `rates`: of rows of relative degree 1, the output
    itself. `S`, n x p; `Phi`, p x p. `arms`: of each row, to the vehicle's point that it is about. `slopes`: of each row, its
    constant derivative by that point. `renamed`: symbols that stand for the output map's own parameters because the robot has
    others of their names.
    """

    linearization: Linearization
    functions: Functions
    q: tuple[sp.Symbol, ...]
    nu: tuple[sp.Symbol, ...]
    S: sp.Matrix
    gradients: sp.Matrix
    rates: dict[int, sp.Expr]
    Phi: sp.Matrix
    planar: Planar | None
    arms: tuple[Arm | None, ...]
    slopes: tuple[Slope | None, ...]
    normal: Normal | None
    renamed: dict[str, str]

    def lowest(self, expression: sp.Expr) -> sp.Expr:
        """The same function in lowest terms, in factors."""
        above, below = self.functions.ratio(expression)
        return readable(self.functions.expression(above) / self.functions.expression(below))

    def is_zero(self, expression: sp.Expr) -> bool:
        """Is it zero everywhere? Exactly."""
        return not self.functions.ratio(expression)[0]

    def at_defaults(self, expression: sp.Expr) -> float:
        """The value of an expression in parameters, at their defaults."""
        fixed = (*self.linearization.system.mechanism.parameters, *self.linearization.output.parameters)
        values = dict(zip(self.functions.symbols, [q.default for q in fixed], strict=False))
        return float(expression.subs(values))

    def over_determinant(self, expression: sp.Expr) -> sp.Expr:
        """expression / det Phi in lowest terms, in factors."""
        (above, below), (up, down) = self.functions.ratio(expression), self._ratio
        above, below = self.functions.times(above, down).cancel(self.functions.times(below, up))
        return readable(self.functions.expression(above) / self.functions.expression(below))

    @cached_property
    def det(self) -> sp.Expr:
        """det Phi in factors; a path's gradient is n_x, n_y."""
        return self.lowest(self.Phi.det(method="berkowitz"))

    @cached_property
    def det_for_people(self) -> sp.Expr:
        """det Phi with a path's gradient written out in the point followed where that is short."""
        explicit = self.written_out(self.det)
        return explicit if sp.count_ops(explicit) <= SHORT else self.det

    @cached_property
    def det_in_full(self) -> sp.Expr:
        """det Phi in coordinates, quasi-velocities and parameters alone."""
        return self.in_coordinates(self.written_out(self.det))

    @cached_property
    def conditions(self) -> tuple[Condition, ...]:
        """Where det Phi vanishes: where one of these holds. Empty: nowhere."""
        return tuple(Condition(*self._told(factor), self._singular_on(factor)) for factor in self._vanishing(self._ratio[0]))

    @cached_property
    def undefined(self) -> tuple[sp.Expr, ...]:
        """Where det Phi has no value: where one of these is zero."""
        found = list(self.poles)
        meaning, point = (self.normal.meaning, set(self.normal.point)) if self.normal else ((), set())
        for component in meaning:
            below = [part.as_base_exp()[0] for part in sp.Mul.make_args(sp.fraction(sp.together(component))[1])]
            found += [base for base in below if base.free_symbols & point and base not in found]
        return tuple(found)

    @cached_property
    def poles(self) -> tuple[sp.Expr, ...]:
        """Where quasi-velocities or outputs fail, whatever the path: where one of these is zero det Phi has no value."""
        return tuple(self.functions.expression(factor) for factor in self._vanishing(self._ratio[1]))

    @property
    def explained(self) -> dict[sp.Symbol, sp.Expr]:
        """The symbols made here, of a path's gradient and of the point followed, and what they stand for."""
        if self.normal is None:
            return {}
        return {**dict(zip((self.normal.x, self.normal.y), self.normal.meaning, strict=True)), **self.normal.point}

    def written_out(self, expression: sp.Expr) -> sp.Expr:
        """With the path's gradient in the point followed."""
        if self.normal is None:
            return expression
        meaning = dict(zip((self.normal.x, self.normal.y), self.normal.meaning, strict=True))
        parts = []
        for part in sp.Mul.make_args(expression):
            if part.free_symbols & set(meaning):
                above, below = sp.fraction(sp.together(part.xreplace(meaning)))
                part = readable(sp.factor_terms(above)) / below
            parts.append(part)
        return readable(sp.Mul(*parts))

    def in_coordinates(self, expression: sp.Expr) -> sp.Expr:
        """With the point followed in coordinates; a sum from which its place on the vehicle cancels becomes shorter."""
        point = self.normal.point if self.normal else {}
        parts = []
        for part in sp.Mul.make_args(expression):
            inserted = part.xreplace(point)
            if inserted != part and part.is_Add:
                expanded = sp.expand(inserted)
                reduced = sp.expand(expanded.subs({wave**2: 1 - sp.cos(wave.args[0]) ** 2 for wave in expanded.atoms(sp.sin)}))
                inserted = min((inserted, readable(expanded), readable(reduced)), key=sp.count_ops)
            parts.append(inserted)
        return sp.Mul(*parts)

    # -- inside -----------------------------------------------------------------------------------------------------

    @cached_property
    def _ratio(self) -> Ratio:
        return self.functions.ratio(self.Phi.det(method="berkowitz"))

    def _vanishing(self, polynomial: PolyElement) -> list[PolyElement]:
        """Its irreducible factors that may vanish, with positive leading terms."""
        found = [factor for factor, _ in self.functions.factors(polynomial)[1]] if polynomial else []
        return [f if f.LC > 0 else -f for f in found if not self._never_zero(f)]

    def _never_zero(self, factor: PolyElement) -> bool:
        return all(never_zero(self.functions, form) for form, _ in factors(self.functions, factor))

    def _told(self, factor: PolyElement) -> tuple[sp.Expr, str]:
        """A factor as a formula, and what it means that it is zero."""
        formula = unsigned(self.functions.expression(factor))
        shown = formula
        if self.det_for_people != self.det:
            shown = unsigned(sp.factor_terms(sp.fraction(sp.together(self.written_out(formula)))[0]))
        for known, about in self._catalogue:
            if [factor] == known:
                return shown, about
        about = words(self.functions, halved(self.functions, factor))
        return shown, "" if about.endswith("= 0") else about

    @cached_property
    def _catalogue(self) -> list[tuple[list[PolyElement], str]]:
        """Quantities of a vehicle in the plane, as factors that may vanish, and what it means that one is zero."""
        if self.planar is None:
            return []
        cosine, sine, nu = self.planar.cosine, self.planar.sine, sp.Matrix(self.nu)
        found = [
            (cosine, "the heading is at 90 or -90 degrees, along the y axis"),
            (sine, "the heading is at 0 or 180 degrees, along the x axis"),
            ((self.planar.forward * nu)[0], "the forward speed is zero"),
            ((self.planar.yaw * nu)[0], "the yaw rate is zero"),
        ]
        if self.normal:
            along, across = self.normal.x * cosine + self.normal.y * sine, self.normal.y * cosine - self.normal.x * sine
            flat = "" if self.normal.unit else ", or the distance has no slope at P_l"
            found.append((across, f"the heading is normal to the path{flat}"))
            found.append((along, "the heading is along the path"))
        for each in filter(None, self.arms):
            found.append((each.ahead, "P_l lies on the axle"))
            if self.normal and each.left:
                about = "the line from the middle of the axle to P_l is normal to the path"
                found.append((each.ahead * across - each.left * along, about))
        return [(self._vanishing(self.functions.ratio(known)[0]), about) for known, about in found]

    def _singular_on(self, factor: PolyElement) -> bool:
        """Is Phi singular at real points where the factor vanishes, and regular at one in general position?"""
        found, form = self.linearization, halved(self.functions, factor)
        parameters = (*found.system.mechanism.parameters, *found.output.parameters)
        ranks = []
        for seed in range(SEEDS):
            with contextlib.suppress(NoPoint):
                rank = self._rank(real_point(self.functions, parameters, form, seed))
                ranks += [] if rank is None else [rank]
        return self._rank(random_point(self.functions, 0)) == self.Phi.rows and bool(ranks) and max(ranks) < self.Phi.rows

    def _rank(self, point: Point | RealPoint) -> int | None:
        """Rank of Phi at a point; None at a pole."""
        rows = []
        for k in range(self.Phi.rows):
            above, below = zip(*[self.functions.ratio(entry) for entry in self.Phi.row(k)], strict=True)
            if not all(map(point, below)):
                return None
            others = [product(self.functions, below[:j] + below[j + 1 :]) for j in range(len(below))]
            rows.append(tuple(map(self.functions.times, above, others)))
        return point.rank(rows)


def decouple(found: Linearization) -> Decoupling:
    """The exact form of a linearization. Raises ModelError for what cannot be treated exactly."""
    system, output = found.system, found.output
    where = f"{system.mechanism.name}, output {output.name}"
    followed = next((row for row in output.rows if output.path is not None and _is_followed(row)), None)
    own = _distinct(
        [*system.state, *system.mechanism.parameters], output.parameters, output.path.kind if output.path else "output"
    )
    used = {q.name for q in (*system.state, *system.mechanism.parameters, *own)}
    normals = [_fresh(name, used) for name in ("n_x", "n_y")] if followed else []
    quantities = [*system.state, *normals, *system.mechanism.parameters, *own]
    gradients = [_gradient(found, k, normals if row is followed else []) for k, row in enumerate(output.rows)]
    rows = [
        found.Phi[k, :] if degree == 1 else gradient @ system.S
        for k, (degree, gradient) in enumerate(zip(found.relative_degree, gradients, strict=True))
    ]
    parts = {
        "S": system.S,
        "gradients": ca.vertcat(*gradients),
        "Phi": ca.vertcat(*rows),
        "rates": ca.vertcat(*[found.h[k] for k, degree in enumerate(found.relative_degree) if degree == 1]),
        "planar": planar_quantities(system),
        **{f"arm {k}": arm_quantities(system, row) for k, row in enumerate(output.rows)},
    }
    entries = {name: symbolic(part, quantities, f"{where}: {name}") if part.numel() else [] for name, part in parts.items()}
    fixed = (*system.mechanism.parameters, *own)
    functions = Functions(
        where,
        [symbol(q) for q in (*system.state, *normals)],
        [symbol(q) for q in fixed],
        [entry for made in entries.values() for entry in made],
    )
    refuse_dependent_roots(functions)
    vehicle = planar(entries["planar"], functions)
    return Decoupling(
        linearization=found,
        functions=functions,
        q=tuple(symbol(q) for q in system.mechanism.coordinates),
        nu=tuple(symbol(q) for q in system.quasi_velocities),
        S=as_matrix(entries["S"], parts["S"].shape),
        gradients=as_matrix(entries["gradients"], parts["gradients"].shape),
        rates=dict(zip([k for k, degree in enumerate(found.relative_degree) if degree == 1], entries["rates"], strict=True)),
        Phi=as_matrix(entries["Phi"], parts["Phi"].shape),
        planar=vehicle,
        arms=tuple(arm(entries[f"arm {k}"], vehicle, functions) for k in range(len(output.rows))),
        slopes=tuple(_constant_slope(row) for row in output.rows),
        normal=_normal(followed.through, normals, quantities, fixed, where) if followed and followed.through else None,
        renamed={
            new.name: f"{old.name} of the output map: {old.about}"
            for new, old in zip(own, output.parameters, strict=True)
            if new != old
        },
    )


def _is_followed(row: OutputRow) -> bool:
    """Is it a function of a point in the plane, other than a fixed combination of its coordinates?"""
    return row.through is not None and row.through.symbols.shape == (2, 1) and _constant_slope(row) is None


def _slope(through: Through) -> ca.SX:
    """Derivative of outer by the point, 1 x 2."""
    return through.slope if through.slope is not None else ca.jacobian(through.outer, through.symbols)


def _constant_slope(row: OutputRow) -> Slope | None:
    """The derivative by a point in the plane, where it is two numbers."""
    if row.through is None or row.through.symbols.shape != (2, 1):
        return None
    slope = ca.densify(_slope(row.through))
    return tuple(symbolic(slope, [], "slope")) if slope.is_constant() else None


def _gradient(found: Linearization, k: int, normals: Sequence[Quantity]) -> ca.SX:
    """Of row k by q, 1 x n; zero where the relative degree is 1."""
    mechanism, row = found.system.mechanism, found.output.rows[k]
    if found.relative_degree[k] == 1:
        return ca.SX(1, len(mechanism.coordinates))
    if row.through is None or not normals:
        return ca.jacobian(found.h[k], mechanism.q)
    return ca.horzcat(*[n.symbol for n in normals]) @ ca.jacobian(row.through.inner, mechanism.q)


def _normal(
    through: Through, normals: Sequence[Quantity], quantities: Sequence[Quantity], fixed: Sequence[Quantity], where: str
) -> Normal:
    used = {q.name for q in quantities}
    point = [replace(_fresh(str(s), used), symbol=s) for s in ca.vertsplit(through.symbols)]
    slope = _slope(through)
    bend = through.bend if through.bend is not None else ca.trace(ca.jacobian(slope, through.symbols))
    x, y, bend, distance = symbolic(ca.vertcat(slope.T, bend, through.outer), (*point, *fixed), where)
    functions = Functions(where, [symbol(q) for q in point], [symbol(q) for q in fixed], (x, y, bend, distance))
    refuse_dependent_roots(functions)
    unit = not functions.ratio(x**2 + y**2 - 1)[0]
    places = dict(zip(map(symbol, point), symbolic(through.inner, quantities, where), strict=True))
    meaning = (_shortest(x, functions), _shortest(y, functions))
    n_x, n_y = map(symbol, normals)
    return Normal(n_x, n_y, meaning, unit, _constant_curvature(bend, distance, functions) if unit else None, places)


def _constant_curvature(bend: sp.Expr, distance: sp.Expr, functions: Functions) -> sp.Expr | None:
    """Of the path, when all its parallels have one centre: 1/bend - distance is then its radius, the same everywhere."""
    if not functions.ratio(bend)[0]:
        return sp.Integer(0)
    above, below = functions.lowest(*functions.ratio(1 / bend - distance))
    constant = above and functions.is_constant(above) and functions.is_constant(below)
    return functions.quotient(below, above) if constant else None


def _shortest(entry: sp.Expr, functions: Functions) -> sp.Expr:
    """As it was written, with a simpler numerator, or in lowest terms."""
    above, below = sp.fraction(sp.together(entry))
    made = [entry, functions.quotient(functions.ratio(above)[0], functions.ring.one) / below]
    made.append(functions.quotient(*functions.ratio(entry)))
    return readable(min(made, key=sp.count_ops))


def _distinct(taken: Sequence[Quantity], own: Sequence[Quantity], kind: str) -> list[Quantity]:
    """The output map's own parameters, under other names where the robot has theirs."""
    names = {q.name for q in taken}
    return [replace(q, name=f"{q.name}_{kind}") if q.name in names else q for q in own]


def _fresh(name: str, taken: set[str]) -> Quantity:
    while name in taken:
        name += "_"
    return quantity(name, "")
