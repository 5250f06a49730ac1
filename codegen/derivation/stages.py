"""The law in short steps: the same mathematics in the variables that need the fewest operations.

Inside the law the quasi-velocities are the vehicle's forward speed and yaw rate (w = W nu), where S and S'MS
are sparse. Outputs of a point are differentiated by way of that point, whose own acceleration is subtracted
before Phi is inverted. Every step is exact: terms that cancel are removed, and factors that depend on
parameters only are separated, to be computed once.
"""

import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import lru_cache

import casadi as ca

from ...model.algebra.exact import canonical
from ...model.algebra.expression import degree, fold, largest, operate, operations, time_derivative
from ...model.algebra.linear import norm, row_norms_squared, solve, solve_by_blocks
from ...model.algebra.operations import is_polynomial
from ...model.extension import Integrators, extended_alike
from ...model.law import ControlLaw, outer_loop
from ...model.linearization import ASIDE, SINGULAR, SINGULAR_SQUARED, carried_rate, chains, derivative
from ...model.mechanism import Quantity, derivative_name, quantity
from ...model.outputs import OutputMap, OutputRow, Through, following
from ...model.recursion import Reduced
from ...model.reduction import ReducedSystem
from ...model.underactuated import passive_equations, passive_names
from ...model.vehicle import VELOCITIES, velocity_map
from .taylor import Taylor

# Most quasi-velocities for which quadratic forms are sorted by monomials; above, that takes more operations
MONOMIALS = 3
Split = tuple[ca.SX, ca.SX | None]  # factor that init computes, rest; None if init computes the whole
PASSIVE = 0  # relative degree of a row without output
STEP, PART = "step.", "part."  # prefixes of the symbols of this module, so that they differ from all others


class Result(StrEnum):
    """The quantities of a law or of the dynamics, by their names in C: results of entry points,
    and values that are checked."""

    OUTPUTS = "h"
    RATES = "ydot"
    DECOUPLING = "Phi"
    DECOUPLING_RATE = "Phidot"
    ACCELERATION = "u"
    INPUTS = "tau"
    COMMAND = "command"
    EXTENSION_RATE = "extension_rate"
    INPUTS_OF_V = "tau_of_v"
    COMMAND_OF_V = "command_of_v"
    SLOPE = "slope"
    GROUND = "ground"
    GROUND_BY_INPUTS = "ground_by_inputs"
    NULL_INPUTS = "null_inputs"
    WHEELS = "wheels"

    SINGULAR = "singular"
    BAND = "band"
    REGULAR = "regular"
    CONDITIONS = "conditions"

    COORDINATE_RATES = "qdot"
    MASS = "Mbar"
    BIAS = "bias"
    INPUT_MAP = "input_map"
    VELOCITY_RATES = "nudot"

    MOVED = "moved"
    OTHERS = "others"
    FACTORS = "factors"
    SPENT = "spent"

    @property
    def in_c(self) -> str:
        """The name of the argument or field that returns it."""
        return self.value.removesuffix("_of_v")


@dataclass(frozen=True)
class Step:
    """A symbol for an expression in earlier symbols; `label` is its name in C, empty if init computes it.

    With `least`, the symbols are the inverse of a matrix, valid if its reciprocal condition number exceeds
    `least`. The optimizer may leave a product that is `kept` together, and leaves a sum that is a `total`.
    """

    symbol: ca.SX
    expression: ca.SX
    label: str = ""
    least: float | None = None
    kept: bool = False
    total: bool = False


@dataclass
class Stages:
    """Named steps, each a symbol and an expression in earlier symbols, and the quantities built from them.

    `at_foot`: some of the quantities a second time, as functions of FOOT instead of the vehicle's position
    and heading. `near`, `near_at_foot`: those that a damped law has within its band instead.
    """

    fixed: list[ca.SX]  # the symbols known to init
    steps: list[Step] = field(default_factory=list)
    quantities: dict[Result, ca.SX] = field(default_factory=dict)
    at_foot: dict[Result, ca.SX] = field(default_factory=dict)
    near: dict[Result, ca.SX] = field(default_factory=dict)
    near_at_foot: dict[Result, ca.SX] = field(default_factory=dict)
    _parts: dict[tuple[int, ...], ca.SX] = field(default_factory=dict)
    _keys: dict[tuple[Hashable, ...], int] = field(default_factory=dict)
    _counted: int = 0  # symbols of `fixed` whose hashes are in the set
    _hashes: set[int] = field(default_factory=set)

    def is_fixed(self, symbol: ca.SX) -> bool:
        """Return whether init knows the symbol."""
        self._hashes.update(new.element_hash() for new in self.fixed[self._counted :])
        self._counted = len(self.fixed)
        return symbol.element_hash() in self._hashes

    def step(self, name: str, expression: ca.SX, total: bool = False) -> ca.SX:
        """Return a symbol for the expression times its constant factor; a short expression is returned
        unchanged. `total`: as in Step."""
        factor, rest = self._rest_named(name, expression, total)
        return self._times(factor, rest)

    def whole(self, name: str, expression: ca.SX) -> ca.SX:
        """Return the same with the factor written out in parameters, so that it can cancel."""
        factor, rest = self._rest_named(name, expression)
        return factor if rest is None else factor * rest

    def _rest_named(self, name: str, expression: ca.SX, total: bool = False) -> Split:
        factor, rest = self._split(expression)
        if rest is not None and not rest.is_symbolic():
            symbol = ca.SX.sym(STEP + name)
            self.steps.append(Step(symbol, rest, name, total=total))
            rest = symbol
        return factor, rest

    def variable(self, name: str, expression: ca.SX, kept: bool = False) -> ca.SX:
        """Return a symbol for the whole expression, by which others can be differentiated; `kept`:
        as in Step."""
        value = self.step(name, expression)
        if value.is_symbolic():
            return value
        symbol = ca.SX.sym(STEP + name)
        self.steps.append(Step(symbol, value, name, kept=kept))
        return symbol

    def row(self, names: list[str], expressions: ca.SX) -> ca.SX:
        """Return a row with a step for each entry."""
        return ca.horzcat(*[self.step(name, expressions[k]) for k, name in enumerate(names)])

    def matrix(self, name: str, expressions: ca.SX) -> ca.SX:
        """Return a matrix with a step for each entry."""
        entries = [
            self.step(f"{name}_{k}", entry)
            for k, entry in enumerate(ca.vertsplit(ca.vec(ca.densify(expressions))))
        ]
        return ca.reshape(ca.vertcat(*entries), expressions.shape)

    def exact(self, matrix: ca.SX) -> ca.SX:
        """Return the matrix in canonical form, with a symbol for each factor that init can compute."""
        simple = ca.densify(canonical(matrix))
        entries = [self._times(*self._split(entry)) for entry in ca.vertsplit(ca.vec(simple))]
        return ca.reshape(ca.vertcat(*entries), simple.shape)

    def inverse(self, matrix: ca.SX, least: float = 0.0) -> ca.SX:
        """Return the inverse: in closed form up to 3 x 3, above block by block; the C runtime inverts blocks
        above 3 x 3.

        The inverse of such a block is valid if its reciprocal condition number exceeds `least`.
        """
        n = matrix.shape[0]
        if n <= 3:
            return self.exact(ca.adj(matrix) / ca.det(matrix) if n > 1 else 1 / matrix)

        def solve_block(block: ca.SX, right: ca.SX) -> ca.SX:
            inverse = self.inverse(block) if block.shape[0] <= 3 else self._inverted(block, least)
            solved = self.exact(inverse @ right)
            entries = [
                self.step(f"inverse_{k}", entry) for k, entry in enumerate(ca.vertsplit(ca.vec(solved)))
            ]
            return ca.reshape(ca.vertcat(*entries), solved.shape)

        return ca.densify(solve_by_blocks(matrix, ca.SX.eye(n), solve_block))

    def _inverted(self, block: ca.SX, least: float) -> ca.SX:
        """Return symbols for the entries of the inverse, which the C computes by elimination with
        pivoting."""
        symbols = ca.SX.sym(f"{STEP}inverse", *block.shape)
        if all(map(self.is_fixed, ca.symvar(block))):
            self.fixed.extend(ca.vertsplit(ca.vec(symbols)))
        self.steps.append(Step(symbols, block, least=least))
        return symbols

    def recursion(self, equations: Reduced, parts: Sequence[ca.SX]) -> list[ca.SX]:
        """Return expressions in steps of equations, after adding the steps that they need."""
        names = [symbol for symbol, _ in equations.steps]
        place, stack = {symbol.element_hash(): k for k, symbol in enumerate(names)}, list(parts)
        needed: set[int] = set()
        while stack:
            new = {
                place[symbol.element_hash()]
                for symbol in ca.symvar(stack.pop())
                if symbol.element_hash() in place
            } - needed
            needed |= new
            stack += [equations.steps[k][1] for k in new]
        values: dict[int, ca.SX] = {}
        for k in sorted(needed):
            expression = equations.inserted(equations.steps[k][1], values)
            values[names[k].element_hash()] = self.step(str(names[k]), expression, total=True)
        return [equations.inserted(part, values) for part in parts]

    def key(self, matrix: ca.SX) -> tuple[int, ...]:
        """Return a key that is equal for matrices whose entries are the same operations on the same symbols
        and numbers."""

        def number(*operation: Hashable) -> int:
            return self._keys.setdefault(operation, len(self._keys))

        symbols = ca.symvar(matrix)
        return tuple(
            fold(
                matrix,
                symbols,
                lambda k: number(symbols[k].element_hash()),
                lambda value: number("is", value),
                number,
            )
        )

    def _split(self, expression: ca.SX) -> Split:
        """Return factor and rest, whose product is the expression; init computes the factor. The rest is None
        if init computes all."""
        symbols = ca.symvar(expression)

        def leaf(k: int) -> Split:
            return (symbols[k], None) if self.is_fixed(symbols[k]) else (ca.SX(1), symbols[k])

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
        """Return a symbol for an expression in parameters, or minus a symbol; equal expressions share one."""
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
    """Return the quantities of the law in steps; `outputs`: the outputs of the law,
    written in another frame."""
    stages = Stages([q.symbol for group in ("params", "config", "gains") for q in law.groups[group]])
    inner, W = inner_velocities(law.system)
    to_inner, from_inner = stages.exact(W), stages.exact(solve(W, ca.SX.eye(law.system.dof)))
    for q, speed in zip(inner.quasi_velocities, ca.vertsplit(to_inner @ law.system.nu), strict=True):
        stages.steps.append(Step(q.symbol, speed, q.name))
    output = _in_velocities(outputs or law.output, law.system, inner, W)
    followed = following(inner, output)
    if output.foot:
        for symbol, value in zip(
            ca.vertsplit(output.foot.symbols), ca.vertsplit(output.foot.values), strict=True
        ):
            stages.steps.append(Step(symbol, stages.exact(value), str(symbol).rpartition(".")[2]))
    degree, integrators = law.linearization.relative_degree, law.linearization.integrators
    if integrators:
        rows, integrators = _extended_rows(stages, followed, output, integrators)
        to_inner = W = ca.SX.eye(inner.dof)  # the columns of Phi are the inputs of the integrators
    else:
        rows = [
            _point_row(stages, inner, row.name, row.through)
            if row.through and not law.system.mechanism.carried
            else _plain_row(stages, followed, row, k + law.kinematic)
            for row, k in zip(output.rows, degree, strict=True)
        ]
    if law.kinematic:
        stages.quantities = _kinematic(stages, law, rows, from_inner, to_inner, W)
        return stages
    rows = [*rows, *_passive_rows(stages, law.system, inner, W)]
    degree = (*degree, *[PASSIVE] * (len(rows) - len(degree)))
    second = [row for row, k in zip(rows, degree, strict=True) if k > 1]
    h, rate = ca.vertcat(*[row.h for row in rows]), ca.vertcat(*[row.rate for row in second])
    damped = {} if integrators or law.system.mechanism.carried else _damped_alone(rows, degree)
    feedback = _Feedback(stages, inner, rows, integrators)
    loop = feedback.loop(law, ca.SX(h), _rest_of_rates(rows, degree, damped, inner.nu), damped)
    virtual = feedback.scale[: len(law.virtual_input)] * ca.vertcat(*[q.symbol for q in law.virtual_input])
    kd = {row.name: gain.symbol for row in output.rows for gain in law.gains if gain.name == f"kd_{row.name}"}
    damping = ca.vertcat(
        *[kd[output.rows[damped[j]].name] * inner.nu[j] if j in damped else 0 for j in range(inner.dof)]
    )

    Phi = ca.vertcat(*[row.Phi for row in rows])
    quantities = {
        Result.OUTPUTS: h,
        Result.RATES: rate,
        Result.DECOUPLING: Phi @ to_inner,
        Result.DECOUPLING_RATE: ca.SX(0, 0)
        if integrators
        else ca.vertcat(*[row.Phidot for row in rows]) @ to_inner,
        Result.ACCELERATION: from_inner @ feedback.acceleration(loop, damping),
        Result.EXTENSION_RATE: feedback.extension_rate(loop),
        Result.INPUTS: feedback.inputs(loop, damping),
        Result.INPUTS_OF_V: feedback.inputs(virtual, ca.SX.zeros(inner.dof)),
        **_singular(stages, feedback.Phi, W, feedback.inverse),
        Result.CONDITIONS: ca.vertcat(*[expression for expression, _ in law.output.conditions]),
        Result.SLOPE: ca.SX(0, 1) if law.speed_row is None else feedback.slope(law.speed_row),
    }
    quantities[Result.SINGULAR] = ca.vertcat(
        quantities[Result.SINGULAR], inputs_singular(stages, law.system, feedback.to_inputs)
    )
    if law.linearization.damping:
        quantities[Result.BAND], stages.near = _near(stages, law, feedback, rows, W, from_inner)
    stages.quantities = {name: ca.densify(quantity) for name, quantity in quantities.items()}
    return stages


def _near(
    stages: Stages, law: ControlLaw, feedback: "_Feedback", rows: list["_Row"], W: ca.SX, from_inner: ca.SX
) -> tuple[ca.SX, dict[Result, ca.SX]]:
    """Return what must be greater than what outside the band of a damped law, and its quantities within the
    band: see `Damping` of model/linearization.py.
    """
    (distance, speed), (forward, turning) = rows, ca.vertsplit(feedback.inner.nu)
    assert distance.point is not None and law.output.band is not None, (
        "a damped law has a distance of a point"
    )
    point, band, kd = (
        distance.point,
        law.output.band.symbol,
        next(k.symbol for k in law.gains if k.name.startswith("kd_")),
    )
    size_squared = point.slope_squared * stages.exact(ca.sumsqr(point.jacobian[:, 1]))
    width = band * ca.sqrt(size_squared)
    rest = stages.exact(solve(point.jacobian, point.drift))
    by_forward, by_turning = ca.horzsplit(distance.Phi)
    x = stages.step("cosine_in_band", by_turning / width)
    lost = stages.step("lost", (1 - x**2) ** 2)
    lean = stages.step("lean", kd * ASIDE * lost * by_forward * forward / ca.sqrt(size_squared))

    def acceleration(v: ca.SX) -> ca.SX:
        """Return the derivative of w, without damping, from the virtual input without the part that `turning`
        damps."""
        along = stages.step("forward", v[1] - speed.drift + rest[0])
        asked = stages.step("asked", v[0] - point.curvature - by_forward * along)
        return ca.vertcat(along - rest[0], asked * x * (2 - x**2) / width - lean - kd * turning - rest[1])

    gains, reference = ([q.symbol for q in law.groups[group]] for group in ("gains", "reference"))
    h = ca.vertcat(distance.h, speed.h)
    u = acceleration(outer_loop(law.linearization.relative_degree, gains, reference, h, by_forward * forward))
    virtual = ca.vertcat(*[q.symbol for q in law.virtual_input])
    u_of_v = acceleration(ca.vertcat(virtual[0] + kd * by_turning * turning, virtual[1]))
    slope = ca.vertcat(1, -by_forward * x * (2 - x**2) / width)
    metric = canonical(W @ W.T)
    bound = SINGULAR_SQUARED / ca.det(W) ** 2
    for k in range(2):
        bound *= stages.exact(point.jacobian[k, :] @ metric @ point.jacobian[k, :].T)
    quantities = {
        Result.ACCELERATION: from_inner @ u,
        Result.INPUTS: feedback.inputs_of(u),
        Result.INPUTS_OF_V: feedback.inputs_of(u_of_v),
        Result.SLOPE: feedback.inputs_of(slope, part=True),
        Result.SINGULAR: ca.vertcat(
            stages.exact(ca.det(point.jacobian)) ** 2,
            bound,
            inputs_singular(stages, law.system, feedback.to_inputs),
        ),
        Result.REGULAR: ca.SX(0, 1),
    }
    edge = band**2 * stages.exact(size_squared * feedback.scale[0] ** 2)
    return ca.vertcat(feedback.Phi[0, 1] ** 2, edge), {
        name: ca.densify(each) for name, each in quantities.items()
    }


def _kinematic(
    stages: Stages, law: ControlLaw, rows: list["_Row"], from_inner: ca.SX, to_inner: ca.SX, W: ca.SX
) -> dict[Result, ca.SX]:
    """Return the quantities of a kinematic law: w = Phi^-1 (v - drift), nu_c = W^-1 w.

    Rows of Phi may be multiplied by a factor each, as are their v: see _Scaled.
    """
    degree, dof = law.linearization.relative_degree, len(rows)
    scaled = [row.scaled if dof <= 2 else None for row in rows]
    Phi = ca.vertcat(*[part.Phi if part else row.Phi for part, row in zip(scaled, rows, strict=True)])
    scale = ca.vertcat(*[part.factor if part else 1 for part in scaled])
    h, names = (
        ca.vertcat(*[row.h for row in rows]),
        [f"w_{q.name}" for q in inner_velocities(law.system)[0].quasi_velocities],
    )
    inverse, drift = stages.inverse(Phi, SINGULAR), stages.exact(law.linearization.drift)

    def command(v: ca.SX) -> ca.SX:
        right = [
            stages.step(f"{q.name}_less_drift", v[k] - drift[k]) for k, q in enumerate(law.virtual_input)
        ]
        w = inverse @ (scale * ca.vertcat(*right))
        return from_inner @ ca.vertcat(*[stages.step(name, w[k]) for k, name in enumerate(names)])

    gains, reference = ([q.symbol for q in law.groups[group]] for group in ("gains", "reference"))
    loop = outer_loop(degree, gains, reference, h, ca.SX(0, 1))
    loop = ca.vertcat(*[stages.step(q.name, loop[k]) for k, q in enumerate(law.virtual_input)])
    quantities = {
        Result.OUTPUTS: h,
        Result.DECOUPLING: ca.vertcat(*[row.Phi for row in rows]) @ to_inner,
        Result.COMMAND: command(loop),
        Result.COMMAND_OF_V: command(ca.vertcat(*[q.symbol for q in law.virtual_input])),
        **_singular(stages, Phi, W, inverse),
        Result.CONDITIONS: ca.vertcat(*[expression for expression, _ in law.output.conditions]),
        Result.SLOPE: ca.SX(0, 1)
        if law.speed_row is None
        else from_inner @ (inverse[:, law.speed_row] * scale[law.speed_row]),
    }
    return {name: ca.densify(quantity) for name, quantity in quantities.items()}


@lru_cache(maxsize=16)
def inner_velocities(system: ReducedSystem) -> tuple[ReducedSystem, ca.SX]:
    """Return the system in w = W nu, and W; w is forward speed and yaw rate if these are n-m fixed
    combinations of nu, else nu."""
    n, W = system.dof, velocity_map(system)
    if W is not None:
        names = tuple(quantity(q.name, q.unit) for q in VELOCITIES)
        return ReducedSystem(system.mechanism, names, canonical(system.S @ solve(W, ca.SX.eye(n)))), W
    same = tuple(
        Quantity(f"w_{q.name}", q.unit, q.about, symbol=ca.SX.sym(f"w_{q.name}"))
        for q in system.quasi_velocities
    )
    return ReducedSystem(system.mechanism, same, system.S, particular=system.particular), ca.SX.eye(n)


@dataclass
class _Point:
    """The point of which an output is a function: Jacobian, drift, the drift of the output due to the
    curvature of the path, and the square of the output's gradient."""

    jacobian: ca.SX
    drift: ca.SX
    curvature: ca.SX
    slope_squared: ca.SX


@dataclass
class _Scaled:
    """A row of Phi multiplied by a positive `factor` that removes roots and divisions from it, and what is
    multiplied alike: rate, drift due to the curvature of the path, and the part `away` of the output; `rest`
    is the other part as it is. The rate is None, for Phi w, if the drift does not use it.
    """

    factor: ca.SX
    Phi: ca.SX
    rate: ca.SX | None
    curvature: ca.SX
    away: ca.SX
    rest: ca.SX


@dataclass
class _Row:
    """An output in w: value, rate, its rows of Phi (in steps, and written out) and of dPhi/dt, drift."""

    h: ca.SX
    rate: ca.SX
    Phi: ca.SX
    Phi_written_out: ca.SX
    Phidot: ca.SX
    drift: ca.SX
    point: _Point | None = None
    scaled: "_Scaled | None" = None

    @property
    def turns_by_rate(self) -> bool:
        """Whether the rate is used for the curvature of the path, too."""
        curved = self.point is not None and not self.point.curvature.is_zero()
        return curved and (self.scaled is None or self.scaled.rate is not None)


def _in_velocities(output: OutputMap, system: ReducedSystem, inner: ReducedSystem, W: ca.SX) -> OutputMap:
    """Return the outputs as functions of q and w."""
    nu_of_w = solve(W, inner.nu)

    def moved(expression: ca.SX) -> ca.SX:
        return canonical(ca.substitute(expression, system.nu, nu_of_w))

    rows = [
        replace(
            row, expression=moved(row.expression), of_foot=None if row.of_foot is None else moved(row.of_foot)
        )
        for row in output.rows
    ]
    return replace(output, rows=tuple(rows))


def _plain_row(stages: Stages, inner: ReducedSystem, row: OutputRow, degree: int) -> _Row:
    """Return a row differentiated from its expression."""
    row_of_Phi, drift = derivative(inner, row.in_motion, degree)
    Phi, Phidot = stages.exact(row_of_Phi), stages.exact(inner.along_motion(row_of_Phi))
    h = stages.step(row.name, stages.exact(row.in_motion))
    rate = Phi @ inner.nu + stages.exact(carried_rate(inner, row.in_motion))
    return _Row(h, stages.step(f"{row.name}_rate", rate), Phi, Phi, Phidot, stages.exact(drift))


def _point_row(stages: Stages, inner: ReducedSystem, name: str, through: Through) -> _Row:
    """Return a row h = outer(z(q)) by the chain rule: first the point z,
    then gradient and curvature of `outer` there."""
    q, w = inner.mechanism.q, inner.nu
    places = [str(symbol) for symbol in ca.vertsplit(through.symbols)]
    z = ca.vertcat(*[stages.variable(place, through.inner[k]) for k, place in enumerate(places)])
    outer = ca.substitute(through.outer, through.symbols, z)
    point = stages.exact(ca.jacobian(through.inner, q) @ inner.S)
    point_rate = stages.exact(time_derivative(point, q, inner.qdot))
    point_drift = stages.exact(point_rate @ w)
    zdot = ca.vertcat(*[stages.variable(f"{place}_rate", (point @ w)[k]) for k, place in enumerate(places)])

    gradient = (
        ca.jacobian(outer, z) if through.slope is None else ca.substitute(through.slope, through.symbols, z)
    )
    slope = stages.row([f"{name}_by_{place}" for place in places], gradient)
    Phi = written_out = stages.exact(slope @ point)
    if through.bend is not None or not slope.is_constant():
        Phi = stages.row([f"{name}_by_{q.name}" for q in inner.quasi_velocities], Phi)
    rate = stages.step(f"{name}_rate", Phi @ w)

    def shorten(expression: ca.SX) -> ca.SX:
        """Return a shorter equal expression; the square of the speed of the point, for example, does not
        depend on the heading."""
        if (
            expression.is_constant()
            or not ca.depends_on(expression, ca.vertcat(z, zdot))
            or ca.depends_on(expression, z)
        ):
            return expression
        shorter = stages.exact(ca.substitute(expression, zdot, point @ w))
        return expression if ca.depends_on(shorter, q) else shorter

    if through.bend is None:
        taylor = Taylor(outer, z, zdot, rate, shorten)
        slope_rate = ca.horzcat(*[taylor.first(entry) for entry in ca.horzsplit(ca.densify(gradient))])
        curvature = taylor.second(outer)
    else:  # motion along a level line of the distance does not change the distance, but turns its gradient
        bend = ca.substitute(through.bend, through.symbols, z)
        slope_rate = bend * (zdot.T - rate * slope)
        curvature = bend * (shorten(ca.sumsqr(zdot)) - rate**2)
    slope_rate = stages.row([f"{name}_by_{place}_rate" for place in places], slope_rate)
    curvature = stages.step(f"{name}_curvature", curvature)
    Phidot = stages.exact(slope_rate @ point + slope @ point_rate)
    drift = stages.exact(slope @ point_drift) + curvature
    h = stages.step(name, outer)
    scaled = _scaled(stages, name, h, outer, z, zdot, through.inner, point, inner, shorten)
    slope_squared = canonical(ca.sumsqr(gradient)) if through.slope is None else ca.SX(1)
    return _Row(
        h, rate, Phi, written_out, Phidot, drift, _Point(point, point_drift, curvature, slope_squared), scaled
    )


def _scaled(
    stages: Stages,
    name: str,
    h: ca.SX,
    outer: ca.SX,
    z: ca.SX,
    zdot: ca.SX,
    place: ca.SX,
    point: ca.SX,
    inner: ReducedSystem,
    shorten: Callable[[ca.SX], ca.SX],
) -> _Scaled | None:
    """Return the row of an output sqrt(S) + const or F / sqrt(S) + const with conics F and S in z, multiplied
    by sqrt(S) or sqrt(S)^3; None for other outputs.

    With R = sqrt(S), Q = dS/dt / 2 and zdot constant, H = R^3 dh/dt = S dF/dt - F Q, and
    R^3 d2h/dt2 = S d2F/dt2 - F dQ/dt + Q (F Q - 2 H) / S. For F = S: R dh/dt = Q, R d2h/dt2 = dQ/dt - Q^2 /
    S.

    With S = p p', where p = dF/dz is linear, Q = p dp/dt, d2F/dt2 = dp/dt dz/dt, dQ/dt = dp/dt (dp/dt)' and
    F = p z / 2 + F(0).
    """
    rest = ca.SX(0)
    while not outer.is_leaf() and outer.op() == ca.OP_SUB and not ca.depends_on(outer.dep(1), z):
        rest, outer = rest - outer.dep(1), outer.dep(0)
    if outer.is_leaf() or outer.op() not in (ca.OP_SQRT, ca.OP_DIV):
        return None
    root = outer if outer.op() == ca.OP_SQRT else outer.dep(1)
    if root.is_leaf() or root.op() != ca.OP_SQRT:
        return None
    S, F = root.dep(0), outer.dep(0)
    places = [str(symbol).removeprefix(STEP) for symbol in ca.vertsplit(z)]
    if degree(ca.vertcat(F, S), z) > 2:
        return None

    def turned(hessian: ca.SX) -> ca.SX:
        return shorten(zdot.T @ stages.exact(hessian) @ zdot)

    def row_of_Phi(gradient: ca.SX) -> ca.SX:
        row = stages.row([f"scaled_{name}_by_{place}" for place in places], gradient)
        return stages.row(
            [f"scaled_{name}_by_{q.name}" for q in inner.quasi_velocities], stages.exact(row @ point)
        )

    if outer.op() == ca.OP_SQRT:
        half, half_hessian = stages.exact(ca.jacobian(S, z) / 2), ca.hessian(S, z)[0] / 2
        rigid = point.shape == (2, 2) and not ca.depends_on(canonical(point.T @ point), inner.mechanism.q)
        if rigid and canonical(half_hessian - ca.SX.eye(2)).is_zero():
            return _from_point(stages, name, half, z, place, point, inner, rest)
        Phi = row_of_Phi(half)
        rate = stages.step(f"scaled_{name}_rate", Phi @ inner.nu)
        return _Scaled(root, Phi, rate, turned(half_hessian) - rate**2 / S, ca.SX(0), h)
    p, at_zero = ca.jacobian(F, z), ca.SX.zeros(z.numel())
    if canonical(ca.substitute(p, z, at_zero)).is_zero() and canonical(S - ca.sumsqr(p)).is_zero():
        hessian, twice_at_zero = (
            stages.exact(ca.hessian(F, z)[0]),
            stages.exact(ca.substitute(2 * F, z, at_zero)),
        )
        p, p_rate = (
            ca.horzcat(
                *[
                    stages.variable(f"{name}_{what}_{k}", each, kept=True)
                    for k, each in zip(places, row, strict=True)
                ]
            )
            for what, row in (
                ("normal", ca.horzsplit(z.T @ hessian)),
                ("normal_rate", ca.horzsplit(zdot.T @ hessian)),
            )
        )
        F, S = stages.variable(f"{name}_level", (p @ z + twice_at_zero) / 2, kept=True), ca.sumsqr(p)
        half, bent, half_bent = p @ hessian, shorten(p_rate @ zdot), shorten(ca.sumsqr(p_rate))
        Q = stages.step(f"{name}_turning", p @ p_rate.T)
    else:
        F, S = stages.exact(F), stages.exact(S)
        p, half = stages.exact(ca.jacobian(F, z)), stages.exact(ca.jacobian(S, z) / 2)
        bent, half_bent = turned(ca.hessian(F, z)[0]), turned(ca.hessian(S, z)[0] / 2)
        Q = stages.step(f"{name}_turning", half @ zdot)
    Phi = row_of_Phi(S * p - F * half)
    rate = stages.step(f"scaled_{name}_rate", Phi @ inner.nu)
    curvature = S * bent - F * half_bent + Q * (F * Q - 2 * rate) / S
    return _Scaled(S * ca.sqrt(S), Phi, rate, curvature, S * F, rest)


def _from_point(
    stages: Stages,
    name: str,
    half: ca.SX,
    z: ca.SX,
    place: ca.SX,
    point: ca.SX,
    inner: ReducedSystem,
    rest: ca.SX,
) -> _Scaled:
    """Return the row of sqrt(p p') + rest, the distance of z = `place`, a function of q, from a center.

    `half`: p = (z - center)'. `point`: J in dz/dt = J w, where J'J is constant.

    In the frame of w, in which the vehicle's own lengths do not turn, Phi = p J and p p' = Phi (J'J)^-1 Phi'.
    The curvature's part, (p p' (dz/dt)'(dz/dt) - (p dz/dt)^2) / p p', is there the square of p x dz/dt over p
    p': no large numbers cancel.
    """
    q, w = inner.mechanism.q, inner.nu
    moves = canonical(ca.jacobian(place, q))
    shifts = [k for k in range(q.numel()) if not moves[:, k].is_zero() and not ca.depends_on(moves[:, k], q)]
    own = ca.substitute(place, q[shifts], ca.SX.zeros(len(shifts)))
    names = [f"{str(symbol).removeprefix(STEP)}_from_center" for symbol in ca.vertsplit(z)]
    start = stages.row(names, stages.exact(ca.substitute(half, z, place - own)))
    turned = canonical((start + own.T) @ point)
    names = [f"scaled_{name}_by_{q.name}" for q in inner.quasi_velocities]
    Phi = ca.horzcat(
        *[stages.whole(each, entry) for each, entry in zip(names, ca.horzsplit(turned), strict=True)]
    )
    seen = solve(point.T @ point, Phi.T)
    squared = stages.step(f"{name}_squared", stages.exact(Phi @ seen))
    across = stages.step(f"{name}_across", stages.exact(ca.det(point) * (seen[0] * w[1] - seen[1] * w[0])))
    return _Scaled(
        ca.sqrt(squared), stages.exact(Phi), None, across**2 / squared, ca.SX(0), ca.sqrt(squared) + rest
    )


def _extended_rows(
    stages: Stages, inner: ReducedSystem, output: OutputMap, integrators: Integrators
) -> tuple[list[_Row], Integrators]:
    """Return the rows as functions of the inputs of the integrators, and these in w:
    the same choices, derived in w."""
    extended, added = extended_alike(inner, chains(inner, output), integrators, output)
    none, rows = ca.SX(0, 0), []
    for row, chain in zip(output.rows, extended, strict=True):
        rates = [
            stages.step(derivative_name(row.name, k), stages.exact(rate))
            for k, rate in enumerate(chain.rates, start=1)
        ]
        Phi, h = stages.exact(chain.row), stages.step(row.name, stages.exact(row.in_motion))
        rows.append(_Row(h, ca.vertcat(*rates), Phi, Phi, none, stages.exact(chain.drift)))
    return rows, replace(added, drift=stages.exact(added.drift), effect=stages.exact(added.effect))


def _passive_rows(stages: Stages, system: ReducedSystem, inner: ReducedSystem, W: ca.SX) -> list[_Row]:
    """Return the equations of motion without inputs as rows whose v is 0:
    no rows unless there are fewer inputs than n-m."""
    if not system.underactuated:
        return []
    none, N = ca.SX(0, 1), canonical(system.annihilator @ W.T)
    P, drift = passive_equations(inner, N)
    parts = zip(passive_names(system), ca.vertsplit(P), ca.vertsplit(drift), strict=True)
    rows = []
    for name, part, rest in parts:
        Phi = stages.row([f"{name}_by_{q.name}" for q in inner.quasi_velocities], stages.exact(part))
        rows.append(
            _Row(
                none,
                none,
                Phi,
                stages.exact(part),
                stages.exact(inner.along_motion(part)),
                stages.exact(rest),
            )
        )
    return rows


def _damped_alone(rows: list[_Row], degree: tuple[int, ...]) -> dict[int, int]:
    """Return column j of Phi -> row i, where only row i has an entry in the column, has degree 2, and its
    rate is not needed for the curvature of the path.

    There Phi^-1 maps the damping -kd Phi_ij w_j of the outer loop to -kd w_j, which needs no inverse.
    """
    alone = {}
    for j in range(len(rows)):
        felt = [i for i, row in enumerate(rows) if not row.Phi[j].is_zero()]
        if len(felt) == 1 and degree[felt[0]] == 2 and not rows[felt[0]].turns_by_rate:
            alone[j] = felt[0]
    return alone


def _rest_of_rates(rows: list[_Row], degree: tuple[int, ...], damped: dict[int, int], w: ca.SX) -> ca.SX:
    """Return the derivatives of the outputs below the highest, without the terms whose damping is applied
    outside the inverse.
    """
    rates = []
    for i, (row, k) in enumerate(zip(rows, degree, strict=True)):
        if k > 1:
            rates.append(_rest_of_rate(row.Phi, i, damped, w) if i in damped.values() else row.rate)
    return ca.vertcat(*rates)


def _rest_of_rate(Phi: ca.SX, i: int, damped: dict[int, int], w: ca.SX) -> ca.SX:
    return sum((Phi[j] * w[j] for j in range(w.numel()) if damped.get(j) != i), start=ca.SX(0))


class _Feedback:
    """Both feedbacks in w: u = Phi^-1 (v - residual) - rest - damping, tau = K u + bias (12), (20).

    Rows of Phi may be multiplied by a factor each, `scale`, as are their v and residual: see _Scaled.
    With an extension Phi^-1 (v - residual) are the inputs of the `integrators`, which give u.
    `damping` is the part of the outer loop that is applied outside the inverse, see _damped_alone. With more
    inputs than n-m, K u + bias is the required S'E (tau - preferred), which is distributed last: fewer
    operations than the r rows of (S'E)^+.
    """

    def __init__(
        self, stages: Stages, inner: ReducedSystem, rows: list[_Row], integrators: Integrators | None
    ):
        self.stages, self.inner, self.integrators = stages, inner, integrators
        self.rest = self._acceleration_at_rest(rows)
        scales = not integrators and inner.dof <= 2 and not self.rest.is_zero()
        curved = [scales and row.point is not None and not row.point.curvature.is_zero() for row in rows]
        self.rows = [row.scaled if bends else None for row, bends in zip(rows, curved, strict=True)]
        self.scale = ca.vertcat(*[scaled.factor if scaled else 1 for scaled in self.rows])
        each = list(zip(rows, self.rows, strict=True))
        self.Phi = ca.vertcat(*[scaled.Phi if scaled else row.Phi for row, scaled in each])
        self.inverse = stages.inverse(self.Phi, SINGULAR)
        self.residual = ca.vertcat(
            *[scaled.curvature if scaled else self._residual(row) for row, scaled in each]
        )
        self.equations = _varying(inner)
        if self.equations:
            self.K, self.bias = stages.recursion(self.equations, [self.equations.Mbar, self.equations.bias])
        else:
            self.K, self.bias = stages.exact(inner.Mbar), stages.exact(inner.bias)
        if inner.redundant:
            self.bias -= inner.input_map @ inner.preferred
            self.spread = stages.exact(inner.spread())
            self.square = stages.inverse(stages.matrix("square", stages.exact(inner.input_map @ self.spread)))
            self.to_inputs = self.square
        else:
            self.to_inputs = (
                stages.exact(inner.input_inverse()) if inner.dof <= 3 else self._inverse_of_driven()
            )
            self.K, self.bias = stages.exact(self.to_inputs @ self.K), self.to_inputs @ self.bias

    def _inverse_of_driven(self) -> ca.SX:
        """Return the inverse of the independent rows of S'E, all of them unless underactuated,
        at their columns."""
        rows = list(self.inner.driven)
        inverse = ca.SX(len(rows), self.inner.dof)
        inverse[:, rows] = self.stages.inverse(self.inner.input_map[rows, :])
        return inverse

    def loop(self, law: ControlLaw, h: ca.SX, rates: ca.SX, damped: dict[int, int]) -> ca.SX:
        """Return the virtual input of the outer loop, multiplied as the rows of Phi are, from the outputs and
        their rates.

        It leaves out what is `damped` outside the inverse, as `rates` do.
        """
        gains, reference = ([q.symbol for q in law.groups[group]] for group in ("gains", "reference"))
        degree, none = law.linearization.relative_degree, [ca.SX(0)] * len(reference)
        # Passive equations, the last rows, have no virtual input
        with_rows = zip(law.virtual_input, self.rows, strict=False)
        names = [q.name if scaled is None else f"scaled_{q.name}" for q, scaled in with_rows]
        if any(self.rows):
            away, rate = ca.SX.zeros(h.numel()), ca.SX.zeros(rates.numel())
            for k, scaled in enumerate(self.rows):
                if scaled:
                    # Of its rate, the only one: the others have one less than their degree
                    place = sum(degree[:k]) - k
                    undamped = (
                        _rest_of_rate(scaled.Phi, k, damped, self.inner.nu)
                        if scaled.rate is None
                        else scaled.rate
                    )
                    h[k], away[k], rates[place], rate[place] = scaled.rest, scaled.away, 0, undamped
            v = self.scale * outer_loop(degree, gains, reference, h, rates) + outer_loop(
                degree, gains, none, away, rate
            )
        else:
            v = outer_loop(degree, gains, reference, h, rates)
        return ca.vertcat(*[self.stages.step(name, v[k]) for k, name in enumerate(names)])

    def acceleration(self, v: ca.SX, damping: ca.SX) -> ca.SX:
        """Return u, the derivative of w."""
        return self._accelerations(v) - self.rest - damping

    def extension_rate(self, v: ca.SX) -> ca.SX:
        """Return d xi/dt of the extension."""
        return self.integrators.rates(self._solved(v))[1] if self.integrators else ca.SX(0, 1)

    def inputs(self, v: ca.SX, damping: ca.SX) -> ca.SX:
        """Return tau."""
        if self.equations:
            return self.inputs_of(self.acceleration(v, damping))
        rest = self.bias - self.K @ (self.rest + damping)
        if self.inner.dof <= MONOMIALS:
            rest = by_monomials(self.stages, rest, self.inner.nu)
        return self.inner.preferred + self._shared(self.K @ self._accelerations(v) + rest)

    def inputs_of(self, u: ca.SX, part: bool = False) -> ca.SX:
        """Return tau of the derivative of w, or of a `part` of it alone."""
        return (
            self._shared(self.K @ u) if part else self.inner.preferred + self._shared(self.K @ u + self.bias)
        )

    def slope(self, row: int) -> ca.SX:
        """Return the derivative of tau by the virtual input of a row."""
        return self._shared(self.K @ self.inverse[:, row])

    def _shared(self, effort: ca.SX) -> ca.SX:
        """Return the inputs with the given effort S'E tau if there are more than n-m, else the effort, which
        is then the inputs."""
        if not self.inner.redundant:
            return effort
        effort = self.stages.matrix("effort", effort)
        return self.spread @ self.stages.matrix("share", self.square @ effort)

    def _accelerations(self, v: ca.SX) -> ca.SX:
        """Return the derivative of w without the part that is applied outside the inverse."""
        if not self.integrators:
            return self._solved(v)
        u, _ = self.integrators.rates(self._solved(v))
        return self.stages.matrix("acceleration", u)

    def _solved(self, v: ca.SX) -> ca.SX:
        kinds = ["scaled_v_less_drift" if scaled else "v_less_drift" for scaled in self.rows]
        v = ca.vertcat(v, ca.SX.zeros(len(kinds) - v.numel()))  # of passive equations
        v_less_drift = ca.vertcat(
            *[self.stages.step(f"{one}_{k}", v[k] - self.residual[k]) for k, one in enumerate(kinds)]
        )
        names = (
            self.integrators.inputs
            if self.integrators
            else [f"u_{q.name}" for q in self.inner.quasi_velocities]
        )
        return ca.vertcat(
            *[self.stages.step(name, (self.inverse @ v_less_drift)[k]) for k, name in enumerate(names)]
        )

    def _acceleration_at_rest(self, rows: list[_Row]) -> ca.SX:
        """Return minus the w-dot at which the point of the outputs has no acceleration; zero if it may not
        exist although Phi is regular."""
        none = ca.SX.zeros(self.inner.dof)
        points = [row.point for row in rows if row.point is not None]
        if not points or points[0].jacobian.shape[0] != self.inner.dof:
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


def _varying(inner: ReducedSystem) -> Reduced | None:
    """Return the equations body by body if S'MS changes with the coordinates:
    then they are shorter than written out."""
    equations = inner.by_bodies
    if equations is None or not ca.depends_on(equations.written_out(equations.Mbar), inner.mechanism.q):
        return None
    return equations


def _singular(stages: Stages, Phi: ca.SX, W: ca.SX, inverse: ca.SX) -> dict[Result, ca.SX]:
    """Return `singular`: up to 2 x 2 (det Phi)^2 and its bound, both divided by (det W)^2 so that they are in
    w.

    Above, where w is nu, the condition number in the 1-norm; nothing if the C runtime inverts Phi as a whole,
    since it then checks the condition. `regular`: an expression that must be positive for Phi to be regular
    anywhere.
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
    return (
        {Result.SINGULAR: ca.vertcat(square, bound), Result.REGULAR: ca.SX(0, 1)}
        if shorter is None
        else shorter
    )


def inputs_singular(stages: Stages, system: ReducedSystem, inverse: ca.SX) -> ca.SX:
    """Return what must be greater than what for inputs to reach every motion: see
    `ReducedSystem.input_measure`; nothing if that does not change. `inverse`: of what (12) inverts, used
    above 2 x 2, where w is nu.
    """
    B = system.distribution
    if not system.inputs_change:
        return ca.SX(0, 1)
    size = largest(B)
    if B.shape[0] > 2:
        return ca.vertcat(1, SINGULAR * norm(size) * norm(inverse))
    return ca.vertcat(stages.exact(ca.det(B)) ** 2, SINGULAR_SQUARED * stages.exact(row_norms_squared(size)))


def _one_square(stages: Stages, square: ca.SX, bound: ca.SX) -> dict[Result, ca.SX] | None:
    """Return a x^2 > b x^2 + c y^2 as |x| > sqrt(c / (a - b)) |y| with a - b > 0, which init tests; None if
    it does not have this form. Where several y are compared, squares save the roots."""
    variables = [symbol for symbol in ca.symvar(square) if not stages.is_fixed(symbol)]
    others = [symbol for symbol in ca.symvar(bound) if not stages.is_fixed(symbol)]
    steps = {step.symbol.element_hash() for step in stages.steps if step.label}
    if len(variables) != 1 or any(symbol.element_hash() not in steps for symbol in others):
        return None
    x = ca.vertcat(
        *variables, *[symbol for symbol in others if symbol.element_hash() != variables[0].element_hash()]
    )
    factors = canonical(ca.hessian(square - bound, x)[0])
    if ca.depends_on(factors, x) or not canonical(square - bound - x.T @ factors @ x / 2).is_zero():
        return None
    if any(not factors[i, j].is_zero() for i in range(x.numel()) for j in range(i)):
        return None
    rest = [stages.exact(-factors[k, k] / factors[0, 0]) for k in range(1, x.numel())]
    compared = (
        ca.vertcat(ca.fabs(x[0]), ca.sqrt(rest[0]) * ca.fabs(x[1]))
        if len(rest) == 1
        else ca.vertcat(
            x[0] ** 2, sum((factor * x[k] ** 2 for k, factor in enumerate(rest, 1)), start=ca.SX(0))
        )
    )
    return {Result.SINGULAR: compared, Result.REGULAR: stages.exact(factors[0, 0] / 2)}


def by_monomials(stages: Stages, expression: ca.SX, w: ca.SX) -> ca.SX:
    """Return a column of polynomials of degree 2 in w sorted by monomials;
    other entries are returned unchanged."""
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
        quadratic = is_polynomial(entry, w) and not ca.depends_on(square, w)
        rows.append(sum(terms, start=ca.SX(0)) if quadratic else entry)
    return ca.vertcat(*rows)


def _divides(expression: ca.SX) -> bool:
    """Whether the expression has a division by something other than a number."""
    function = ca.Function("f", [ca.vertcat(*ca.symvar(expression))], [expression])
    return any(operation.code in (ca.OP_DIV, ca.OP_INV) for operation in operations(function))
