"""The exact decoupling matrix (15) of an output map: its determinant in factors, and where it vanishes, as
formulas and text.

The gradient of a path's distance is represented by two symbols n_x, n_y, so that the vehicle is separate from
the path: det Phi is then a product of a lookahead, of the component of n across the heading, and of constants
of the vehicle.
"""

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import casadi as ca
import sympy as sp
from sympy.polys.rings import PolyElement

from ...model.algebra.ratios import Ratio, in_lowest_terms
from ...model.linearization import Linearization
from ...model.mechanism import Quantity, quantity
from ...model.outputs import OutputRow, Through
from ...model.underactuated import passive_inertias
from ..distributions.places import words
from ..exact.functions import Functions
from ..exact.half_angles import factors, halved, never_zero, no_common_zero, product
from ..exact.points import NoPoint, Point, random_point, refuse_dependent_roots
from ..exact.readable import readable, unsigned
from ..exact.real_points import RealPoint, real_point
from ..exact.symbolic import as_matrix, symbol, symbolic, written
from .planar import Arm, Planar, arm, arm_quantities, motion_quantities, planar, planar_quantities

Slope = tuple[sp.Expr, sp.Expr]  # derivative by a point in the plane

# Names of symbols in the answers, if the robot does not have them
OWN = ("s", "chi", "V", "v", "psi", "along_path")
SHORT = 30  # operations of a formula with n_x, n_y expanded; longer formulas keep the symbols
SEEDS = 3  # points tried on each condition


@dataclass(frozen=True)
class SingularCondition:
    """`formula` = 0, and its meaning. `confirmed`: Phi, or S'E, was found singular, with many digits, at real
    points where it holds.
    """

    formula: sp.Expr
    words: str
    confirmed: bool

    def __str__(self) -> str:
        """Return the condition as text with the formula."""
        formula = f"{written(self.formula)} = 0"
        return f"{self.words} ({formula})" if self.words else formula


@dataclass(frozen=True, eq=False)
class Normal:
    """The gradient of a path's distance h at P_l, as symbols and in the coordinates of P_l.

    `unit`: its length is 1, proved. `chi`: the curvature of the path, 1/m, positive if the gradient points
    away from the centre, if it is constant, proved. `point`: the coordinates of P_l, and their expressions in
    q.
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

    `gradients`, r x n: of the r outputs with respect to q, zero for those of relative degree 1. `rates`: for
    outputs of relative degree 1, the output itself. `S`, n x p; `Phi`, p x p. `inputs` is S'E, p x r, of an
    underactuated robot its rows that are inverted, r x r; 0 x 0 if it is constant. `inertias`, which are
    positive, are those by which the passive equations of an underactuated robot are divided. `arms`: for each
    row, the vector to its point of the vehicle. `slopes`: for each row, its constant gradient with respect to
    that point. `renamed`: symbols of the output map's own parameters that have the same name as others of the
    robot. `names`: of each symbol in OWN the name that it has here. `motion`: see `motion_quantities`, 3 x p;
    `effect`: that of the integrators of a dynamic extension; both empty without one.
    """

    linearization: Linearization
    functions: Functions
    q: tuple[sp.Symbol, ...]
    nu: tuple[sp.Symbol, ...]
    S: sp.Matrix
    gradients: sp.Matrix
    rates: dict[int, sp.Expr]
    Phi: sp.Matrix
    inputs: sp.Matrix
    inertias: tuple[sp.Expr, ...]
    planar: Planar | None
    arms: tuple[Arm | None, ...]
    slopes: tuple[Slope | None, ...]
    normal: Normal | None
    renamed: dict[str, str]
    names: dict[str, str]
    motion: sp.Matrix
    effect: tuple[sp.Expr, ...]

    def lowest(self, expression: sp.Expr) -> sp.Expr:
        """Return the same function in lowest terms, in factors."""
        above, below = self.functions.ratio(expression)
        return readable(self.functions.expression(above) / self.functions.expression(below))

    def is_zero(self, expression: sp.Expr) -> bool:
        """Return whether it is zero everywhere, exactly."""
        return not self.functions.ratio(expression)[0]

    def at_defaults(self, expression: sp.Expr) -> float:
        """Return the value of an expression in parameters, at their defaults."""
        fixed = (*self.linearization.system.mechanism.parameters, *self.linearization.output.parameters)
        values = dict(zip(self.functions.symbols, [q.default for q in fixed], strict=False))
        return float(expression.subs(values))

    def over_determinant(self, expression: sp.Expr) -> sp.Expr:
        """Return expression / det Phi in lowest terms, in factors."""
        (above, below), (up, down) = self.functions.ratio(expression), self._ratio
        above, below = in_lowest_terms(self.functions.times(above, down), self.functions.times(below, up))
        return readable(self.functions.expression(above) / self.functions.expression(below))

    @cached_property
    def det(self) -> sp.Expr:
        """det Phi in factors; the gradient of a path is n_x, n_y."""
        return self.lowest(self.Phi.det(method="berkowitz"))

    @cached_property
    def det_for_people(self) -> sp.Expr:
        """det Phi with the gradient of a path expanded in the coordinates of P_l if that is short."""
        explicit = self.written_out(self.det)
        return explicit if sp.count_ops(explicit) <= SHORT else self.det

    @cached_property
    def det_in_full(self) -> sp.Expr:
        """det Phi in coordinates, quasi-velocities and parameters only."""
        return self.in_coordinates(self.written_out(self.det))

    @cached_property
    def conditions(self) -> tuple[SingularCondition, ...]:
        """Conditions for det Phi = 0, poles of what an extension integrates,
        and S'E of lower rank. Empty: never."""
        of_Phi = self._vanishing(self._ratio[0])
        of_inputs = [f for f in self._inputs_vanish if f not in of_Phi]
        found = [SingularCondition(*self._described(f), self._singular_on(f, self.Phi)) for f in of_Phi]
        poles = [
            f
            for entry in self.effect
            for f in self._vanishing(self.functions.ratio(entry)[1])
            if f not in of_Phi
        ]
        for formula, about in (self._described(f) for f in dict.fromkeys(poles)):
            found.append(
                SingularCondition(
                    formula, f"what is integrated has a pole{f': {about}' if about else ''}", True
                )
            )
        for formula, about, factor in ((*self._described(f), f) for f in of_inputs):
            about = f"inputs lose a direction{f': {about}' if about else ''}"
            found.append(SingularCondition(formula, about, self._singular_on(factor, self.inputs)))
        return tuple(found)

    @cached_property
    def undefined(self) -> tuple[sp.Expr, ...]:
        """Expressions at whose zeros det Phi is undefined."""
        expressions = list(self.poles)
        meaning, point = (self.normal.meaning, set(self.normal.point)) if self.normal else ((), set())
        for component in meaning:
            below = [
                part.as_base_exp()[0] for part in sp.Mul.make_args(sp.fraction(sp.together(component))[1])
            ]
            expressions += [base for base in below if base.free_symbols & point and base not in expressions]
        return tuple(expressions)

    @cached_property
    def poles(self) -> tuple[sp.Expr, ...]:
        """Expressions at whose zeros quasi-velocities or outputs are undefined, for any path,
        and det Phi with them."""
        return tuple(self.functions.expression(factor) for factor in self._vanishing(self._ratio[1]))

    @property
    def explained(self) -> dict[sp.Symbol, sp.Expr]:
        """The symbols introduced for a path's gradient and for P_l, with their meaning."""
        if self.normal is None:
            return {}
        return {
            **dict(zip((self.normal.x, self.normal.y), self.normal.meaning, strict=True)),
            **self.normal.point,
        }

    def written_out(self, expression: sp.Expr) -> sp.Expr:
        """Return the expression with the path's gradient in the coordinates of P_l."""
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
        """Return the expression with P_l in coordinates; sums in which its position on the vehicle cancels
        are shortened."""
        point = self.normal.point if self.normal else {}
        parts = []
        for part in sp.Mul.make_args(expression):
            inserted = part.xreplace(point)
            if inserted != part and part.is_Add:
                expanded = sp.expand(inserted)
                reduced = sp.expand(
                    expanded.subs({wave**2: 1 - sp.cos(wave.args[0]) ** 2 for wave in expanded.atoms(sp.sin)})
                )
                inserted = min((inserted, readable(expanded), readable(reduced)), key=sp.count_ops)
            parts.append(inserted)
        return sp.Mul(*parts)

    # -- internal --------------------------------------------------------------------------------------------

    @cached_property
    def _ratio(self) -> Ratio:
        return self.functions.ratio(self.Phi.det(method="berkowitz"))

    @cached_property
    def _inputs_vanish(self) -> list[PolyElement]:
        """Return polynomials at whose zeros S'E loses rank, because all its minors vanish: their common
        factors, or if these are none, the sum of their squares unless it is proved not to vanish.
        """
        p, r = self.inputs.shape
        minors = [
            self.functions.ratio(self.inputs[:, list(c)].det(method="berkowitz"))[0]
            for c in combinations(range(r), p)
        ]
        vanishing = [self._vanishing(minor) for minor in minors if minor]
        if not p or not all(vanishing):
            return []
        if common := [f for f in vanishing[0] if all(f in others for others in vanishing[1:])]:
            return common
        if no_common_zero(self.functions, [halved(self.functions, minor) for minor in minors if minor]):
            return []
        return [
            self.functions.normal(sum((self.functions.times(m, m) for m in minors), self.functions.ring.zero))
        ]

    def _vanishing(self, polynomial: PolyElement) -> list[PolyElement]:
        """Return its irreducible factors that may vanish, with positive leading terms."""
        factors = [factor for factor, _ in self.functions.factors(polynomial)[1]] if polynomial else []
        return [f if f.LC > 0 else -f for f in factors if not self._never_zero(f)]

    @cached_property
    def _positive(self) -> set[PolyElement]:
        """The factors of `inertias`."""
        return {
            f
            for inertia in self.inertias
            for f, _ in self.functions.factors(self.functions.ratio(inertia)[0])[1]
        }

    def _never_zero(self, factor: PolyElement) -> bool:
        if {factor, -factor} & self._positive:
            return True
        return all(never_zero(self.functions, form) for form, _ in factors(self.functions, factor))

    def _described(self, factor: PolyElement) -> tuple[sp.Expr, str]:
        """Return a factor as a formula, and the meaning of its zeros."""
        formula = unsigned(self.functions.expression(factor))
        gradient = self.functions.gradient(factor)
        cyclic = [
            q
            for q, slope in zip(self.functions.coordinates, gradient, strict=True)
            if formula.has(q) and not slope
        ]
        shown = formula = unsigned(formula.subs(dict.fromkeys(cyclic, 0))) if cyclic else formula
        if self.det_for_people != self.det:
            shown = unsigned(sp.factor_terms(sp.fraction(sp.together(self.written_out(formula)))[0]))
        for vanishing, about in self._catalogue:
            if [factor] == vanishing:
                return shown, about
        about = words(self.functions, halved(self.functions, factor))
        return shown, "" if about.endswith("= 0") else about

    @cached_property
    def _catalogue(self) -> list[tuple[list[PolyElement], str]]:
        """Return quantities of a vehicle in the plane, as factors that may vanish,
        and the meaning of their zeros."""
        if self.planar is None:
            return []
        cosine, sine, nu = self.planar.cosine, self.planar.sine, sp.Matrix(self.nu)
        quantities = [
            (cosine, "the heading is at 90 or -90 degrees, along the y axis"),
            (sine, "the heading is at 0 or 180 degrees, along the x axis"),
            ((self.planar.forward * nu)[0], "the forward speed is zero"),
            ((self.planar.yaw * nu)[0], "the yaw rate is zero"),
        ]
        if self.normal:
            along, across = (
                self.normal.x * cosine + self.normal.y * sine,
                self.normal.y * cosine - self.normal.x * sine,
            )
            flat = "" if self.normal.unit else ", or the gradient of the distance vanishes at P_l"
            quantities.append((across, f"the heading is normal to the path{flat}"))
            quantities.append((along, "the heading is along the path"))
        for each in filter(None, self.arms):
            quantities.append((each.ahead, "P_l lies on the axle"))
            if self.normal and each.left:
                about = "the line from the middle of the axle to P_l is normal to the path"
                quantities.append((each.ahead * across - each.left * along, about))
        return [(self._vanishing(self.functions.ratio(quantity)[0]), about) for quantity, about in quantities]

    def _singular_on(self, factor: PolyElement, matrix: sp.Matrix) -> bool:
        """Return whether a matrix loses rank at real points where the factor vanishes,
        and not at one in general position."""
        linearization, form = self.linearization, halved(self.functions, factor)
        parameters = (*linearization.system.mechanism.parameters, *linearization.output.parameters)
        ranks = []
        for seed in range(SEEDS):
            with contextlib.suppress(NoPoint):
                rank = self._rank(real_point(self.functions, parameters, form, seed), matrix)
                ranks += [] if rank is None else [rank]
        return (
            self._rank(random_point(self.functions, 0), matrix) == matrix.rows
            and bool(ranks)
            and max(ranks) < matrix.rows
        )

    def _rank(self, point: Point | RealPoint, matrix: sp.Matrix) -> int | None:
        """Return the rank of a matrix at a point; None at a pole."""
        rows = []
        for k in range(matrix.rows):
            above, below = zip(*[self.functions.ratio(entry) for entry in matrix.row(k)], strict=True)
            if not all(map(point, below)):
                return None
            others = [product(self.functions, below[:j] + below[j + 1 :]) for j in range(len(below))]
            rows.append(tuple(map(self.functions.times, above, others)))
        return point.rank(rows)


def decouple(linearization: Linearization) -> Decoupling:
    """Return the exact form of a linearization. Raises ModelError if it cannot be treated exactly.

    With a dynamic extension the states xi are among the coordinates of `functions`, and `gradients` are zero.
    """
    system, output = linearization.system, linearization.output
    state = (*system.state, *linearization.extension)
    where = f"{system.mechanism.name}, output {output.name}"
    followed = next((row for row in output.rows if output.path is not None and _is_followed(row)), None)
    own = _distinct(
        [*state, *system.mechanism.parameters],
        output.parameters,
        output.path.kind if output.path else "output",
    )
    used = {q.name for q in (*state, *system.mechanism.parameters, *system.mechanism.inputs, *own)}
    normals = [_fresh(name, used) for name in ("n_x", "n_y")] if followed else []
    quantities = [*state, *normals, *system.mechanism.parameters, *own]
    gradients = [
        _gradient(linearization, k, normals if row is followed else []) for k, row in enumerate(output.rows)
    ]
    rows = [
        _extended_row(linearization, k, normals if row is followed else [])
        if linearization.integrators
        else linearization.Phi[k, :]
        if linearization.relative_degree[k] == 1
        else gradients[k] @ system.S
        for k, row in enumerate(output.rows)
    ]
    rows.append(linearization.Phi[len(rows) :, :])  # the passive equations of an underactuated robot
    first_degree = [k for k, degree in enumerate(linearization.relative_degree) if degree == 1]
    parts = {
        "S": system.S,
        "gradients": ca.vertcat(*gradients),
        "Phi": ca.vertcat(*rows),
        "inputs": _varying_inputs(linearization),
        "rates": ca.vertcat(*[linearization.h[k] for k in first_degree]),
        "inertias": passive_inertias(system, system.annihilator),
        "planar": planar_quantities(system),
        **{f"arm {k}": arm_quantities(system, row) for k, row in enumerate(output.rows)},
        "motion": motion_quantities(linearization),
        "effect": linearization.integrators.effect if linearization.integrators else ca.SX(0, 1),
    }
    entries = {
        name: symbolic(part, quantities, f"{where}: {name}") if part.numel() else []
        for name, part in parts.items()
    }
    fixed = (*system.mechanism.parameters, *own)
    functions = Functions(
        where,
        [symbol(q) for q in (*state, *normals)],
        [symbol(q) for q in fixed],
        [entry for part in entries.values() for entry in part],
    )
    refuse_dependent_roots(functions)
    vehicle = planar(entries["planar"], functions)
    return Decoupling(
        linearization=linearization,
        functions=functions,
        q=tuple(symbol(q) for q in system.mechanism.coordinates),
        nu=tuple(symbol(q) for q in system.quasi_velocities),
        S=as_matrix(entries["S"], parts["S"].shape),
        gradients=as_matrix(entries["gradients"], parts["gradients"].shape),
        rates=dict(zip(first_degree, entries["rates"], strict=True)),
        Phi=as_matrix(entries["Phi"], parts["Phi"].shape),
        inputs=as_matrix(entries["inputs"], parts["inputs"].shape),
        inertias=tuple(entries["inertias"]),
        planar=vehicle,
        arms=tuple(arm(entries[f"arm {k}"], vehicle, functions) for k in range(len(output.rows))),
        slopes=tuple(_constant_slope(row) for row in output.rows),
        normal=_normal(followed.through, normals, quantities, fixed, where)
        if followed and followed.through
        else None,
        renamed={
            new.name: f"{old.name} of the output map: {old.about}"
            for new, old in zip(own, output.parameters, strict=True)
            if new != old
        },
        names={name: _fresh(name, used).name for name in OWN},
        motion=as_matrix(entries["motion"], parts["motion"].shape),
        effect=tuple(entries["effect"]),
    )


def _varying_inputs(linearization: Linearization) -> ca.SX:
    """Return S'E, of an underactuated robot the rows that (12) inverts;
    0 x 0 unless the law uses it and it changes with q."""
    if not linearization.measures[1:]:
        return ca.SX(0, 0)
    system = linearization.system
    return system.distribution if system.underactuated else system.input_map


def _is_followed(row: OutputRow) -> bool:
    """Return whether it is a function of a point in the plane,
    other than a fixed combination of its coordinates."""
    return row.through is not None and row.through.symbols.shape == (2, 1) and _constant_slope(row) is None


def _slope(through: Through) -> ca.SX:
    """Return the gradient of `outer` with respect to the point, 1 x 2."""
    return through.slope if through.slope is not None else ca.jacobian(through.outer, through.symbols)


def _constant_slope(row: OutputRow) -> Slope | None:
    """Return the gradient with respect to a point in the plane, if it is two constants."""
    if row.through is None or row.through.symbols.shape != (2, 1):
        return None
    slope = ca.densify(_slope(row.through))
    return tuple(symbolic(slope, [], "slope")) if slope.is_constant() else None


def _gradient(linearization: Linearization, k: int, normals: Sequence[Quantity]) -> ca.SX:
    """Return the gradient of row k with respect to q, 1 x n; zero if the relative degree is 1."""
    mechanism, row = linearization.system.mechanism, linearization.output.rows[k]
    if linearization.relative_degree[k] == 1 or linearization.integrators:
        return ca.SX(1, len(mechanism.coordinates))
    if row.through is None or not normals:
        return ca.jacobian(linearization.h[k], mechanism.q)
    return ca.horzcat(*[n.symbol for n in normals]) @ ca.jacobian(row.through.inner, mechanism.q)


def _extended_row(linearization: Linearization, k: int, normals: Sequence[Quantity]) -> ca.SX:
    """Return row k of Phi after a dynamic extension, 1 x (n-m), with the gradient `normals` of a path if
    there is one: the highest derivative of a function of a point contains that of the point times the
    gradient.
    """
    integrators, through = linearization.integrators, linearization.output.rows[k].through
    if integrators is None or through is None or not normals:
        return linearization.Phi[k, :]
    rows, last = ca.SX(2, linearization.system.dof), through.inner
    for _ in range(linearization.relative_degree[k]):
        if not rows.is_zero():
            return linearization.Phi[k, :]  # the point has a lower relative degree than the function
        rows, last = integrators.derivative(last)
    return ca.horzcat(*[n.symbol for n in normals]) @ rows


def _normal(
    through: Through,
    normals: Sequence[Quantity],
    quantities: Sequence[Quantity],
    fixed: Sequence[Quantity],
    where: str,
) -> Normal:
    used = {q.name for q in quantities}
    point = [replace(_fresh(str(s), used), symbol=s) for s in ca.vertsplit(through.symbols)]
    slope = _slope(through)
    bend = through.bend if through.bend is not None else ca.trace(ca.jacobian(slope, through.symbols))
    x, y, bend, distance = symbolic(ca.vertcat(slope.T, bend, through.outer), (*point, *fixed), where)
    functions = Functions(
        where, [symbol(q) for q in point], [symbol(q) for q in fixed], (x, y, bend, distance)
    )
    refuse_dependent_roots(functions)
    unit = not functions.ratio(x**2 + y**2 - 1)[0]
    places = dict(zip(map(symbol, point), symbolic(through.inner, quantities, where), strict=True))
    meaning = (_shortest(x, functions), _shortest(y, functions))
    n_x, n_y = map(symbol, normals)
    return Normal(
        n_x, n_y, meaning, unit, _constant_curvature(bend, distance, functions) if unit else None, places
    )


def _constant_curvature(bend: sp.Expr, distance: sp.Expr, functions: Functions) -> sp.Expr | None:
    """Return the curvature of the path if all parallel curves have one centre:
    then 1/bend - distance is the constant radius."""
    if not functions.ratio(bend)[0]:
        return sp.Integer(0)
    above, below = functions.lowest(*functions.ratio(1 / bend - distance))
    constant = above and functions.is_constant(above) and functions.is_constant(below)
    return functions.quotient(below, above) if constant else None


def _shortest(entry: sp.Expr, functions: Functions) -> sp.Expr:
    """Return the entry as written, with a simpler numerator, or in lowest terms."""
    above, below = sp.fraction(sp.together(entry))
    forms = [entry, functions.quotient(functions.ratio(above)[0], functions.ring.one) / below]
    forms.append(functions.quotient(*functions.ratio(entry)))
    return readable(min(forms, key=sp.count_ops))


def _distinct(taken: Sequence[Quantity], own: Sequence[Quantity], kind: str) -> list[Quantity]:
    """Return the output map's own parameters, renamed where the robot has the same names."""
    names = {q.name for q in taken}
    return [replace(q, name=f"{q.name}_{kind}") if q.name in names else q for q in own]


def _fresh(name: str, taken: set[str]) -> Quantity:
    while name in taken:
        name += "_"
    return quantity(name, "")
