"""The law in short steps: the same mathematics, written in the frame where it is cheapest.

Inside the law the quasi-velocities are the vehicle's forward speed and yaw rate (w = W nu), where S and S'MS are sparse.
Outputs at a point go through that point, whose own acceleration is taken out of the inverse. Every step is exact: what
cancels is gone, and what depends on parameters only stands by itself, to be computed once.
"""

import math
from collections.abc import Hashable
from dataclasses import dataclass, field
from enum import StrEnum
from functools import lru_cache

import casadi as ca

from ...model.algebra.exact import canonical
from ...model.algebra.expression import degree, fold, operate, operations, time_derivative
from ...model.algebra.linear import norm, solve, solve_by_blocks
from ...model.algebra.operations import is_polynomial
from ...model.law import ControlLaw, outer_loop
from ...model.linearization import SINGULAR, SINGULAR_SQUARED, derivative
from ...model.mechanism import Quantity, quantity
from ...model.outputs import OutputMap, OutputRow, Through
from ...model.reduction import ReducedSystem
from ...model.vehicle import velocity_map
from .taylor import Taylor

MONOMIALS = 3  # quasi-velocities up to which what is quadratic in them is sorted by monomials; above, that is more to compute
Split = tuple[ca.SX, ca.SX | None]  # factor that init knows, rest; None where init knows the whole
STEP, PART = "step.", "part."  # before the names of symbols made here, so that they differ from all others


class Result(StrEnum):
    """What is derived of a law or of the dynamics, by its name in C: what entry points return, and what they and init check."""

    OUTPUTS = "h"
    RATES = "ydot"
    DECOUPLING = "Phi"
    DECOUPLING_RATE = "Phidot"
    ACCELERATION = "u"
    INPUTS = "tau"
    INPUTS_OF_DEMAND = "tau_of_demand"
    SLOPE = "slope"

    SINGULAR = "singular"
    REGULAR = "regular"
    CONDITIONS = "conditions"

    COORDINATE_RATES = "qdot"
    MASS = "Mbar"
    BIAS = "bias"
    INPUT_MAP = "input_map"
    VELOCITY_RATES = "nudot"

    @property
    def in_c(self) -> str:
        """The name of the argument or field that returns it."""
        return "tau" if self is Result.INPUTS_OF_DEMAND else self.value


@dataclass(frozen=True)
class Step:
    """A symbol for an expression in earlier symbols; `label` names it in C, empty for what init computes.

    With `least`, symbols for the inverse of a matrix, which has a meaning where its reciprocal condition exceeds `least`.
    """

    symbol: ca.SX
    expression: ca.SX
    label: str = ""
    least: float | None = None


@dataclass
class Stages:
    """Named steps, each a symbol and an expression in earlier symbols, and the quantities built from them.

    `at_foot`: some of the quantities a second time, by FOOT in place of the vehicle's position and heading.
    """

    fixed: list[ca.SX]  # the symbols that init knows
    steps: list[Step] = field(default_factory=list)
    quantities: dict[Result, ca.SX] = field(default_factory=dict)
    at_foot: dict[Result, ca.SX] = field(default_factory=dict)
    _parts: dict[tuple[int, ...], ca.SX] = field(default_factory=dict)
    _keys: dict[tuple[Hashable, ...], int] = field(default_factory=dict)

    def step(self, name: str, expression: ca.SX) -> ca.SX:
        """A symbol for the expression, its constant factor left outside; what is short already stays as it is."""
        factor, rest = self._split(expression)
        if rest is None or rest.is_symbolic():
            return self._times(factor, rest)
        symbol = ca.SX.sym(STEP + name)
        self.steps.append(Step(symbol, rest, name))
        return self._times(factor, symbol)

    def variable(self, name: str, expression: ca.SX) -> ca.SX:
        """A symbol for the expression as a whole, so that others can be differentiated by it."""
        made = self.step(name, expression)
        if made.is_symbolic():
            return made
        symbol = ca.SX.sym(STEP + name)
        self.steps.append(Step(symbol, made, name))
        return symbol

    def row(self, names: list[str], expressions: ca.SX) -> ca.SX:
        """A step for each entry of a row."""
        return ca.horzcat(*[self.step(name, expressions[k]) for k, name in enumerate(names)])

    def exact(self, matrix: ca.SX) -> ca.SX:
        """The matrix in canonical form, with a symbol for whatever init can compute."""
        simple = ca.densify(canonical(matrix))
        entries = [self._times(*self._split(entry)) for entry in ca.vertsplit(ca.vec(simple))]
        return ca.reshape(ca.vertcat(*entries), simple.shape)

    def inverse(self, matrix: ca.SX, least: float = 0.0) -> ca.SX:
        """The inverse: in closed form up to 3 x 3; above, block by block, and a block above 3 x 3 is left to the C runtime.

        There it has a meaning where its reciprocal condition exceeds `least`.
        """
        n = matrix.shape[0]
        if n <= 3:
            return self.exact(ca.adj(matrix) / ca.det(matrix) if n > 1 else 1 / matrix)

        def solve_block(block: ca.SX, right: ca.SX) -> ca.SX:
            inverse = self.inverse(block) if block.shape[0] <= 3 else self._inverted(block, least)
            solved = self.exact(inverse @ right)
            entries = [self.step(f"inverse_{k}", entry) for k, entry in enumerate(ca.vertsplit(ca.vec(solved)))]
            return ca.reshape(ca.vertcat(*entries), solved.shape)

        return ca.densify(solve_by_blocks(matrix, ca.SX.eye(n), solve_block))

    def _inverted(self, block: ca.SX, least: float) -> ca.SX:
        """Symbols for the entries of the inverse, which a step finds by elimination with pivots."""
        symbols = ca.SX.sym(f"{STEP}inverse", *block.shape)
        known = {symbol.element_hash() for symbol in self.fixed}
        if all(symbol.element_hash() in known for symbol in ca.symvar(block)):
            self.fixed.extend(ca.vertsplit(ca.vec(symbols)))
        self.steps.append(Step(symbols, block, least=least))
        return symbols

    def key(self, matrix: ca.SX) -> tuple[int, ...]:
        """The same for matrices whose entries are the same operations on the same symbols and numbers, else different."""

        def number(*operation: Hashable) -> int:
            return self._keys.setdefault(operation, len(self._keys))

        symbols = ca.symvar(matrix)
        return tuple(
            fold(matrix, symbols, lambda k: number(symbols[k].element_hash()), lambda value: number("is", value), number)
        )

    def _split(self, expression: ca.SX) -> Split:
        """factor * rest, the factor known to init; rest is None when init knows the whole."""
        symbols = ca.symvar(expression)
        known = {symbol.element_hash() for symbol in self.fixed}

        def leaf(k: int) -> Split:
            return (symbols[k], None) if symbols[k].element_hash() in known else (ca.SX(1), symbols[k])

        def apply(code: int, arguments: tuple[Split, ...]) -> Split:
            if all(rest is None for _, rest in arguments):
                return operate(code, *[factor for factor, _ in arguments]), None
            if code in (ca.OP_NEG, ca.OP_TWICE, ca.OP_SQ, ca.OP_INV):
                ((factor, rest),) = arguments
                keeps = code in (ca.OP_NEG, ca.OP_TWICE)
                return operate(code, factor), rest if keeps or rest is None else operate(code, rest)
            if code in (ca.OP_MUL, ca.OP_DIV):
                (f, a), (g, b) = arguments
                rest = a if b is None else operate(code, ca.SX(1) if a is None else a, b)
                return operate(code, f, g), rest
            return ca.SX(1), operate(code, *[self._times(*argument) for argument in arguments])

        if expression.is_constant():
            return expression, None
        (pair,) = fold(expression, symbols, leaf, lambda value: (ca.SX(value), None), apply)
        return pair

    def _times(self, factor: ca.SX, rest: ca.SX | None) -> ca.SX:
        part = self._part(factor)
        return part if rest is None else part * rest

    def _part(self, factor: ca.SX) -> ca.SX:
        """A symbol for an expression of parameters, the same for equal ones, or its negative."""
        if factor.is_constant() or factor.is_symbolic():
            return factor
        key = self.key(factor)
        if key not in self._parts:
            self._parts[key] = self._new_part(canonical(factor))
        return self._parts[key]

    def _new_part(self, factor: ca.SX) -> ca.SX:
        if factor.is_constant() or factor.is_symbolic():
            return factor
        if factor.op() == ca.OP_NEG:
            return -self._part(factor.dep(0))
        key = self.key(factor)
        if key not in self._parts:
            self._parts[key] = ca.SX.sym(f"{PART}{len(self.steps)}")
            self.steps.append(Step(self._parts[key], factor))
            self.fixed.append(self._parts[key])
        return self._parts[key]


def staged(law: ControlLaw, outputs: OutputMap | None = None) -> Stages:
    """The law's quantities in steps; `outputs`: the law's own, written in another frame."""
    stages = Stages([q.symbol for group in ("params", "config", "gains") for q in law.groups[group]])
    inner, W = inner_velocities(law.system)
    to_inner, from_inner = stages.exact(W), stages.exact(solve(W, ca.SX.eye(law.system.freedom)))
    for q, speed in zip(inner.quasi_velocities, ca.vertsplit(to_inner @ law.system.nu), strict=True):
        stages.steps.append(Step(q.symbol, speed, q.name))
    output = _in_velocities(outputs or law.output, law.system, inner, W)
    degree = law.linearization.relative_degree
    rows = [
        _point_row(stages, inner, row.name, row.through) if row.through else _plain_row(stages, inner, row, k)
        for row, k in zip(output.rows, degree, strict=True)
    ]
    second = [row for row, k in zip(rows, degree, strict=True) if k == 2]
    h, rate = ca.vertcat(*[row.h for row in rows]), ca.vertcat(*[row.rate for row in second])
    gains, reference = ([q.symbol for q in law.groups[group]] for group in ("gains", "reference"))
    damped = _damped_alone(rows, degree)
    loop = outer_loop(degree, gains, reference, h, _rest_of_rates(rows, degree, damped, inner.nu))
    loop = ca.vertcat(*[stages.step(q.name, loop[k]) for k, q in enumerate(law.demand)])
    demand = ca.vertcat(*[q.symbol for q in law.demand])
    kd = {row.name: gain.symbol for row in output.rows for gain in law.gains if gain.name == f"kd_{row.name}"}
    damping = ca.vertcat(*[kd[output.rows[damped[j]].name] * inner.nu[j] if j in damped else 0 for j in range(inner.freedom)])

    feedback = _Feedback(stages, inner, rows)
    Phi = ca.vertcat(*[row.Phi for row in rows])
    quantities = {
        Result.OUTPUTS: h,
        Result.RATES: rate,
        Result.DECOUPLING: Phi @ to_inner,
        Result.DECOUPLING_RATE: ca.vertcat(*[row.Phidot for row in rows]) @ to_inner,
        Result.ACCELERATION: from_inner @ feedback.acceleration(loop, damping),
        Result.INPUTS: feedback.inputs(loop, damping),
        Result.INPUTS_OF_DEMAND: feedback.inputs(demand, ca.SX.zeros(inner.freedom)),
        **_singular(stages, Phi, W, feedback.inverse),
        Result.CONDITIONS: ca.vertcat(*[expression for expression, _ in law.output.conditions]),
        Result.SLOPE: ca.SX(0, 1) if law.speed_row is None else feedback.slope(law.speed_row),
    }
    stages.quantities = {name: ca.densify(quantity) for name, quantity in quantities.items()}
    return stages


@lru_cache(maxsize=16)
def inner_velocities(system: ReducedSystem) -> tuple[ReducedSystem, ca.SX]:
    """The system in w = W nu, w being forward speed and yaw rate where these are n-m fixed combinations of nu, else nu."""
    n, W = system.freedom, velocity_map(system)
    if W is not None:
        names = (quantity("forward_speed", "m/s"), quantity("yaw_rate", "rad/s"))
        return ReducedSystem(system.mechanism, names, canonical(system.S @ solve(W, ca.SX.eye(n)))), W
    same = tuple(Quantity(f"w_{q.name}", q.unit, q.about, symbol=ca.SX.sym(f"w_{q.name}")) for q in system.quasi_velocities)
    return ReducedSystem(system.mechanism, same, system.S), ca.SX.eye(n)


@dataclass
class _Point:
    """The point that an output is a function of: Jacobian, drift, and the output's drift that is due to the path's curvature."""

    jacobian: ca.SX
    drift: ca.SX
    curvature: ca.SX


@dataclass
class _Row:
    """An output in w: value, rate, rows of Phi (in steps, and written out) and of its derivative, drift."""

    h: ca.SX
    rate: ca.SX
    Phi: ca.SX
    Phi_written_out: ca.SX
    Phidot: ca.SX
    drift: ca.SX
    point: _Point | None = None


def _in_velocities(output: OutputMap, system: ReducedSystem, inner: ReducedSystem, W: ca.SX) -> OutputMap:
    """The same outputs as functions of q and w."""
    nu_of_w = solve(W, inner.nu)
    rows = [
        OutputRow(row.name, row.unit, row.about, canonical(ca.substitute(row.expression, system.nu, nu_of_w)), row.through)
        for row in output.rows
    ]
    return OutputMap(output.name, output.about, tuple(rows), output.parameters, output.conditions, output.path)


def _plain_row(stages: Stages, inner: ReducedSystem, row: OutputRow, degree: int) -> _Row:
    """A row straight from its expression."""
    row_of_Phi, drift = derivative(inner, row.expression, degree)
    Phi, Phidot = stages.exact(row_of_Phi), stages.exact(inner.along_motion(row_of_Phi))
    h = stages.step(row.name, stages.exact(row.expression))
    return _Row(h, stages.step(f"{row.name}_rate", Phi @ inner.nu), Phi, Phi, Phidot, stages.exact(drift))


def _point_row(stages: Stages, inner: ReducedSystem, name: str, through: Through) -> _Row:
    """A row h = outer(z(q)): first the point z, then the outer function's slope and curvature there."""
    q, w = inner.mechanism.q, inner.nu
    places = [str(symbol) for symbol in ca.vertsplit(through.symbols)]
    z = ca.vertcat(*[stages.variable(place, through.inner[k]) for k, place in enumerate(places)])
    outer = ca.substitute(through.outer, through.symbols, z)
    point = stages.exact(ca.jacobian(through.inner, q) @ inner.S)
    point_rate = stages.exact(time_derivative(point, q, inner.qdot))
    point_drift = stages.exact(point_rate @ w)
    zdot = ca.vertcat(*[stages.variable(f"{place}_rate", (point @ w)[k]) for k, place in enumerate(places)])

    gradient = ca.jacobian(outer, z) if through.slope is None else ca.substitute(through.slope, through.symbols, z)
    slope = stages.row([f"{name}_by_{place}" for place in places], gradient)
    Phi = written_out = stages.exact(slope @ point)
    if through.bend is not None or not slope.is_constant():
        Phi = stages.row([f"{name}_by_{q.name}" for q in inner.quasi_velocities], Phi)
    rate = stages.step(f"{name}_rate", Phi @ w)

    def shorten(expression: ca.SX) -> ca.SX:
        """The square of the point's speed, say, does not depend on the heading."""
        if expression.is_constant() or not ca.depends_on(expression, ca.vertcat(z, zdot)) or ca.depends_on(expression, z):
            return expression
        shorter = stages.exact(ca.substitute(expression, zdot, point @ w))
        return expression if ca.depends_on(shorter, q) else shorter

    if through.bend is None:
        taylor = Taylor(outer, z, zdot, rate, shorten)
        slope_rate = ca.horzcat(*[taylor.first(entry) for entry in ca.horzsplit(ca.densify(gradient))])
        curvature = taylor.second(outer)
    else:  # the velocity along a level of the distance, which does not change it, turns the slope
        bend = ca.substitute(through.bend, through.symbols, z)
        slope_rate = bend * (zdot.T - rate * slope)
        curvature = bend * (shorten(ca.sumsqr(zdot)) - rate**2)
    slope_rate = stages.row([f"{name}_by_{place}_rate" for place in places], slope_rate)
    curvature = stages.step(f"{name}_curvature", curvature)
    Phidot = stages.exact(slope_rate @ point + slope @ point_rate)
    drift = stages.exact(slope @ point_drift) + curvature
    return _Row(stages.step(name, outer), rate, Phi, written_out, Phidot, drift, _Point(point, point_drift, curvature))


def _damped_alone(rows: list[_Row], degree: tuple[int, ...]) -> dict[int, int]:
    """Column j of Phi -> row i, where only row i of Phi has an entry and is of degree 2 and straight.

    There the damping -kd Phi_ij w_j of the outer loop comes out of the inverse as -kd w_j, with no need to compute it.
    """
    found = {}
    for j in range(len(rows)):
        felt = [i for i, row in enumerate(rows) if not row.Phi[j].is_zero()]
        point = rows[felt[0]].point if felt else None
        if len(felt) == 1 and degree[felt[0]] == 2 and (point is None or point.curvature.is_zero()):
            found[j] = felt[0]
    return found


def _rest_of_rates(rows: list[_Row], degree: tuple[int, ...], damped: dict[int, int], w: ca.SX) -> ca.SX:
    """Rates of the outputs of degree 2 without the terms that are damped past the inverse."""
    rates = []
    for i, (row, k) in enumerate(zip(rows, degree, strict=True)):
        if k == 2:
            left = [row.Phi[j] * w[j] for j in range(len(rows)) if damped.get(j) != i]
            rates.append(row.rate if len(left) == len(rows) else sum(left, start=ca.SX(0)))
    return ca.vertcat(*rates)


class _Feedback:
    """Both feedbacks in w: u = Phi^-1 (v - residual) - rest - damping, tau = K u + bias (12), (20).

    `damping` is the part of the outer loop that has been taken past the inverse, see _damped_alone. With more inputs than
    n-m, K u + bias is what S'E (tau - preferred) must be, and is shared out last: that takes less than the r rows of (S'E)^+.
    """

    def __init__(self, stages: Stages, inner: ReducedSystem, rows: list[_Row]):
        self.stages, self.inner = stages, inner
        Phi = ca.vertcat(*[row.Phi for row in rows])
        self.inverse = stages.inverse(Phi, SINGULAR)
        self.rest = self._acceleration_at_rest(rows)
        self.residual = ca.vertcat(*[self._residual(row) for row in rows])
        self.K, self.bias = stages.exact(inner.Mbar), stages.exact(inner.bias)
        if inner.redundant:
            self.bias -= inner.input_map @ inner.preferred
            self.spread = stages.exact(inner.spread())
            self.square = stages.inverse(_symbols(stages, "square", stages.exact(inner.input_map @ self.spread)))
        else:
            to_inputs = stages.exact(inner.input_inverse()) if inner.freedom <= 3 else stages.inverse(inner.input_map)
            self.K, self.bias = stages.exact(to_inputs @ self.K), to_inputs @ self.bias

    def acceleration(self, v: ca.SX, damping: ca.SX) -> ca.SX:
        """u, the rate of w."""
        return self._solved(v) - self.rest - damping

    def inputs(self, v: ca.SX, damping: ca.SX) -> ca.SX:
        """tau."""
        rest = self.bias - self.K @ (self.rest + damping)
        if self.inner.freedom <= MONOMIALS:
            rest = _by_monomials(self.stages, rest, self.inner.nu)
        return self.inner.preferred + self._shared(self.K @ self._solved(v) + rest)

    def slope(self, row: int) -> ca.SX:
        """Derivative of tau by the demand of a row."""
        return self._shared(self.K @ self.inverse[:, row])

    def _shared(self, effort: ca.SX) -> ca.SX:
        """The inputs for an effort, where this does not give them already."""
        if not self.inner.redundant:
            return effort
        effort = _symbols(self.stages, "effort", effort)
        return self.spread @ _symbols(self.stages, "share", self.square @ effort)

    def _solved(self, v: ca.SX) -> ca.SX:
        wanted = ca.vertcat(*[self.stages.step(f"wanted_{k}", v[k] - self.residual[k]) for k in range(v.numel())])
        names = [f"u_{q.name}" for q in self.inner.quasi_velocities]
        return ca.vertcat(*[self.stages.step(name, (self.inverse @ wanted)[k]) for k, name in enumerate(names)])

    def _acceleration_at_rest(self, rows: list[_Row]) -> ca.SX:
        """minus the w-dot at which the outputs' point has no acceleration; zero where Phi can be regular and that is not."""
        none = ca.SX.zeros(self.inner.freedom)
        points = [row.point for row in rows if row.point is not None]
        if not points or points[0].jacobian.shape[0] != self.inner.freedom:
            return none
        if len({self.stages.key(point.jacobian) for point in points}) > 1:
            return none
        determinant = canonical(ca.det(points[0].jacobian))
        written_out = ca.vertcat(*[row.Phi_written_out for row in rows])
        if determinant.is_zero() or _divides(canonical(ca.det(written_out) / determinant)):
            return none
        return self.stages.exact(solve(points[0].jacobian, points[0].drift))

    def _residual(self, row: _Row) -> ca.SX:
        if row.point is not None and not self.rest.is_zero():
            return row.point.curvature
        return self.stages.exact(row.drift - row.Phi @ self.rest) if not self.rest.is_zero() else row.drift


def _symbols(stages: Stages, name: str, matrix: ca.SX) -> ca.SX:
    """A step for each entry of a matrix."""
    entries = [stages.step(f"{name}_{k}", entry) for k, entry in enumerate(ca.vertsplit(ca.vec(ca.densify(matrix))))]
    return ca.reshape(ca.vertcat(*entries), matrix.shape)


def _singular(stages: Stages, Phi: ca.SX, W: ca.SX, inverse: ca.SX) -> dict[Result, ca.SX]:
    """`singular`: up to 2 x 2 (det Phi)^2 and what it must exceed, both divided by (det W)^2 so that they are in w.

    Above, where w is nu, the condition in the 1-norm; nothing where the C runtime inverts Phi as a whole, and tells.
    `regular`: what must be positive for that to be possible at all.
    """
    none = ca.SX(0, 1)
    if Phi.shape[0] > 2:
        whole = any(step.least == SINGULAR and step.expression.shape == Phi.shape for step in stages.steps)
        singular = none if whole else ca.vertcat(1, SINGULAR * norm(Phi) * norm(inverse))
        return {Result.SINGULAR: singular, Result.REGULAR: none}
    scale = ca.SX(SINGULAR_SQUARED)
    metric = canonical(W @ W.T)
    for k in range(Phi.shape[0]):
        scale *= stages.exact(Phi[k, :] @ metric @ Phi[k, :].T)
    square, bound = stages.exact(ca.det(Phi)) ** 2, scale / ca.det(W) ** 2
    shorter = _one_square(stages, square, bound)
    return {Result.SINGULAR: ca.vertcat(square, bound), Result.REGULAR: ca.SX(0, 1)} if shorter is None else shorter


def _one_square(stages: Stages, square: ca.SX, bound: ca.SX) -> dict[Result, ca.SX] | None:
    """a x^2 > b x^2 + c y^2 as x^2 > c / (a - b) y^2 with a - b > 0, if that is what it is."""
    known = {symbol.element_hash() for symbol in stages.fixed}
    variables = [symbol for symbol in ca.symvar(square) if symbol.element_hash() not in known]
    others = [symbol for symbol in ca.symvar(bound) if symbol.element_hash() not in known]
    steps = {step.symbol.element_hash() for step in stages.steps if step.label}
    if len(variables) != 1 or any(symbol.element_hash() not in steps for symbol in others):
        return None
    x = ca.vertcat(*variables, *[symbol for symbol in others if symbol.element_hash() != variables[0].element_hash()])
    factors = canonical(ca.hessian(square - bound, x)[0])
    if ca.depends_on(factors, x) or not canonical(square - bound - x.T @ factors @ x / 2).is_zero():
        return None
    if any(not factors[i, j].is_zero() for i in range(x.numel()) for j in range(i)):
        return None
    rest = [stages.exact(-factors[k, k] / factors[0, 0]) * x[k] ** 2 for k in range(1, x.numel())]
    return {Result.SINGULAR: ca.vertcat(x[0] ** 2, sum(rest, start=ca.SX(0))), Result.REGULAR: stages.exact(factors[0, 0] / 2)}


def _by_monomials(stages: Stages, expression: ca.SX, w: ca.SX) -> ca.SX:
    """A column of polynomials of degree 2 in w, written monomial by monomial; anything else stays as it is."""
    rows = []
    zeros = ca.SX.zeros(w.numel())
    for entry in ca.vertsplit(canonical(expression)):
        if degree(entry, w) == math.inf:
            rows.append(entry)
            continue
        hessian, gradient = ca.hessian(entry, w)
        constant, linear = ca.substitute(entry, w, zeros), ca.substitute(gradient, w, zeros)
        square = stages.exact(hessian / 2)
        terms = [stages.exact(constant)] + [stages.exact(linear[k]) * w[k] for k in range(w.numel())]
        terms += [
            (square[j, k] if j == k else stages.exact(2 * square[j, k])) * (w[j] * w[k])
            for j in range(w.numel())
            for k in range(j, w.numel())
        ]
        known = is_polynomial(entry, w) and not ca.depends_on(square, w)
        rows.append(sum(terms, start=ca.SX(0)) if known else entry)
    return ca.vertcat(*rows)


def _divides(expression: ca.SX) -> bool:
    """Is there a division by something that is not a number?"""
    function = ca.Function("f", [ca.vertcat(*ca.symvar(expression))], [expression])
    return any(operation.code in (ca.OP_DIV, ca.OP_INV) for operation in operations(function))
