"""The reduced equations (10) body by body: velocities in terms of earlier velocities, at a cost that grows
linearly along a chain.

Kane's form. A velocity u, linear in the rates, is u = J nu, and its derivative J nudot + drift. With the mass
m_i and inertia I_i of a body whose velocities along its own axes are forward, left and yaw rate, J_i a row
for each,

    S'MS = sum of J_i' M_i J_i,    S'(M Sdot nu + V) = sum of J_i' M_i a_i,    M_i = diag(m_i, m_i, I_i),

where a_i are the drifts plus the terms due to the rotation of the axes. Rates and velocities of bodies are
steps: symbols for expressions in earlier symbols. They are not expanded, and simplification treats one body
at a time.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from math import prod

import casadi as ca

from .algebra.exact import canonical
from .algebra.expression import degree, operate, time_derivative
from .algebra.samples import RANK_TOLERANCE, Sampled
from .errors import ModelError
from .mechanism import Body, Mechanism

LINEAR = (ca.OP_ASSIGN, ca.OP_NEG, ca.OP_TWICE, ca.OP_ADD, ca.OP_SUB)  # operations on velocities only
Step = tuple[ca.SX, ca.SX]
Entries = dict[tuple[int, ...], ca.SX]  # row, or row and column, from 0 -> entry
Polynomial = dict[tuple[int, ...], float]  # indices of factors -> coefficient
SHORT = 4  # operations and symbols; too short to simplify
LARGEST_PRODUCT = 100  # terms; longer products are not expanded


@dataclass(frozen=True)
class VelocityRow:
    """sum of row[j] nu_j, with derivative sum of row[j] nudot_j + drift. Columns from n-m on are rates that
    are not yet known."""

    row: dict[int, ca.SX] = field(default_factory=dict)
    drift: ca.SX = field(default_factory=lambda: ca.SX(0))
    value: ca.SX | None = None  # the step that represents the sum

    def plus(self, other: "VelocityRow", factor: ca.SX) -> "VelocityRow":
        """Return self + factor * other, for a factor that is constant in time."""
        row = dict(self.row)
        for j, entry in other.row.items():
            row[j] = row[j] + factor * entry if j in row else factor * entry
        return VelocityRow(row, self.drift + factor * other.drift)


@dataclass(frozen=True)
class Effort:
    """The force or moment, sum of row[j] nudot_j + bias, that the motion needs along a `velocity`, which is
    linear in the rates. Inputs and constraint forces supply the sum of all."""

    name: str
    velocity: ca.SX
    row: dict[int, ca.SX]
    bias: ca.SX


@dataclass(frozen=True)
class Reduced:
    """S'MS, S'(M Sdot nu + V), S'E (10) and S (9) in `steps`, ordered body by body in `groups`; `efforts` are
    the terms of the equations of motion before they are projected, in the same steps."""

    groups: tuple[tuple[Step, ...], ...]
    Mbar: ca.SX
    bias: ca.SX
    input_map: ca.SX
    S: ca.SX
    efforts: tuple[Effort, ...] = ()

    @property
    def steps(self) -> tuple[Step, ...]:
        """Return all steps in order."""
        return tuple(step for group in self.groups for step in group)

    @cached_property
    def _values(self) -> dict[int, ca.SX]:
        values: dict[int, ca.SX] = {}
        for symbol, expression in self.steps:
            values[symbol.element_hash()] = self.inserted(expression, values)
        return values

    def written_out(self, expression: ca.SX) -> ca.SX:
        """Return the expression with all steps substituted; common subexpressions stay shared."""
        return self.inserted(expression, self._values)

    @staticmethod
    def inserted(expression: ca.SX, values: dict[int, ca.SX]) -> ca.SX:
        """Return the expression with the values of some steps, by hash."""
        named = [symbol for symbol in ca.symvar(expression) if symbol.element_hash() in values]
        if not named:
            return expression
        return ca.substitute(
            [expression], [ca.vertcat(*named)], [ca.vertcat(*[values[s.element_hash()] for s in named])]
        )[0]


class Recursion:
    """Traverses the velocities of a mechanism, each once.

    The rates follow from the constraints (2) and quasi = `T` nu, where `quasi` are the quasi-velocities as
    expressions in the rates; if there are none, from qdot = `T` nu (9).
    """

    def __init__(self, mechanism: Mechanism, nu: ca.SX, T: ca.SX, quasi: Sequence[ca.SX] = ()):
        self.mechanism, self.nu = mechanism, nu
        self.q, self.qdot = mechanism.q, mechanism.qdot
        self.n, self.dof = self.q.numel(), nu.numel()
        self.steps: list[Step] = []
        self._step_symbols: set[int] = set()  # symbols of steps
        self.rates: dict[int, VelocityRow] = {}  # those known so far
        self._groups: list[tuple[Step, ...]] = []
        self._grouped = 0  # number of steps in a group
        self._Mbar: Entries = {}
        self._bias: Entries = {}
        self._efforts: list[Effort] = []
        self._columns = {self.qdot[k].element_hash(): k for k in range(self.n)}
        self._velocities: dict[
            int, tuple[ca.SX, VelocityRow]
        ] = {}  # by hash; stores the expression too, so that its hash stays unique
        self._moving: dict[int, tuple[ca.SX, bool]] = {}
        self._names = {
            velocity.element_hash(): f"{body.name}_{component}"
            for body in mechanism.bodies
            for component, velocity in (
                ("forward", body.forward),
                ("left", body.left),
                ("yaw_rate", body.yaw_rate),
            )
        }
        self._fixed = {symbol.element_hash() for symbol in ca.symvar(ca.SX(mechanism.p))}
        if quasi:
            self._solve(list(mechanism.constraints), list(quasi), T)
        else:
            self.rates = {k: self._given(T[k, :], T @ nu) for k in range(self.n)}
            self._maintain(range(len(mechanism.constraints)))
            for body in mechanism.bodies:
                self._add_body(body)

    # -- velocities ------------------------------------------------------------------------------------------

    def velocity(self, x: ca.SX) -> VelocityRow:
        """Return an expression that is linear in the rates as a Velocity. Raises ModelError for others."""
        key = x.element_hash()
        if key not in self._velocities:
            derived = self._derived(x)
            if key in self._names and self._is_known(derived):
                derived = self.named(self._names[key], derived)
            self._velocities[key] = (x, derived)
        return self._velocities[key][1]

    def named(self, name: str, velocity: VelocityRow) -> VelocityRow:
        """Return the velocity with a step for each coefficient and for its drift, simplified."""
        row = {}
        for j, entry in velocity.row.items():
            entry = self._simple(entry)
            if not entry.is_zero():
                row[j] = self.step(f"{name}_by_{self.nu[j]}", entry)
        return VelocityRow(
            row, self.step(f"{name}_drift", self._simple(velocity.drift)), self.step(name, self._sum(row))
        )

    def _simple(self, matrix: ca.SX) -> ca.SX:
        """Return the matrix simplified: completely while there are no steps,
        else only by cancelling terms."""
        if ca.n_nodes(matrix) <= SHORT:
            return matrix
        if not any(symbol.element_hash() in self._step_symbols for symbol in ca.symvar(matrix)):
            return canonical(matrix)
        simple = ca.densify(matrix)
        for k in range(simple.numel()):
            if not simple.nz[k].is_leaf():
                simple.nz[k] = cancelled(simple.nz[k])
        return ca.sparsify(simple)

    def step(self, name: str, expression: ca.SX) -> ca.SX:
        """Return a symbol for the expression; a constant multiple of a symbol is returned unchanged."""
        if self._is_multiple(expression):
            return expression
        symbol = ca.SX.sym(name)
        self.steps.append((symbol, expression))
        self._step_symbols.add(symbol.element_hash())
        return symbol

    def value(self, velocity: VelocityRow) -> ca.SX:
        """Return the velocity at nu; unknown rates remain symbols."""
        return self._sum(velocity.row) if velocity.value is None else velocity.value

    def _sum(self, row: dict[int, ca.SX]) -> ca.SX:
        terms = [
            entry * (self.nu[j] if j < self.dof else self.qdot[j - self.dof]) for j, entry in row.items()
        ]
        return sum(terms[1:], start=terms[0]) if terms else ca.SX(0)

    def at(self, x: ca.SX) -> ca.SX:
        """Return an expression in coordinates and rates as one in coordinates and nu."""
        if not self._moves(x):
            return x
        try:
            return self.value(self.velocity(x))
        except ModelError:
            return operate(x.op(), *[self.at(x.dep(k)) for k in range(x.n_dep())])

    def _derived(self, x: ca.SX) -> VelocityRow:
        if x.element_hash() in self._columns:
            k = self._columns[x.element_hash()]
            return self.rates.get(k) or VelocityRow({self.dof + k: ca.SX(1)})
        if x.is_zero():
            return VelocityRow()
        code, parts = (None, []) if x.is_leaf() else (x.op(), [x.dep(k) for k in range(x.n_dep())])
        moving = [self._moves(part) for part in parts]
        if code in LINEAR and all(m or part.is_zero() for part, m in zip(parts, moving, strict=True)):
            sign = ca.SX({ca.OP_NEG: -1, ca.OP_TWICE: 2}.get(code, 1))
            first = VelocityRow().plus(self.velocity(parts[0]), sign)
            return (
                first.plus(self.velocity(parts[1]), ca.SX(1 if code == ca.OP_ADD else -1))
                if len(parts) > 1
                else first
            )
        if code == ca.OP_MUL and moving.count(True) == 1:
            return self._times(parts[moving.index(False)], self.velocity(parts[moving.index(True)]))
        if code == ca.OP_DIV and moving == [True, False]:
            return self._times(1 / parts[1], self.velocity(parts[0]))
        raise ModelError(f"{self.mechanism.name}: a velocity is not linear in the rates: {str(x)[:60]}")

    def _times(self, factor: ca.SX, velocity: VelocityRow) -> VelocityRow:
        scaled = VelocityRow().plus(velocity, factor)
        if not ca.depends_on(factor, self.q):
            return scaled
        rate = time_derivative(factor, self.q, ca.vertcat(*[self._rate(k) for k in range(self.n)]))
        return VelocityRow(scaled.row, scaled.drift + rate * self.value(velocity))

    def _rate(self, k: int) -> ca.SX:
        return self.value(self.rates[k]) if k in self.rates else self.qdot[k]

    def _moves(self, x: ca.SX) -> bool:
        """Return whether the expression depends on the rates."""
        key = x.element_hash()
        if key not in self._moving:
            depends = (
                key in self._columns if x.is_leaf() else any(self._moves(x.dep(k)) for k in range(x.n_dep()))
            )
            self._moving[key] = (x, depends)
        return self._moving[key][1]

    def _is_known(self, velocity: VelocityRow) -> bool:
        unknown = range(self.dof, self.dof + self.n)
        return all(j not in unknown for j in velocity.row) and not ca.depends_on(velocity.drift, self.qdot)

    def _is_multiple(self, expression: ca.SX) -> bool:
        moving = [s for s in ca.symvar(expression) if s.element_hash() not in self._fixed]
        if not moving:
            return True
        if len(moving) > 1:
            return False
        return degree(expression, moving[0]) == 1 and ca.substitute(expression, moving[0], 0).is_zero()

    # -- rates -----------------------------------------------------------------------------------------------

    def _given(self, row: ca.SX, qdot: ca.SX) -> VelocityRow:
        entries = {j: row[j] for j in range(self.dof) if not row[j].is_zero()}
        return VelocityRow(entries, self._simple(time_derivative(row, self.q, qdot) @ self.nu))

    def slip(self, k: int) -> VelocityRow:
        """Return the velocity of constraint k: zero."""
        return VelocityRow()

    def _maintain(self, numbers: Iterable[int]) -> None:
        """Replace the velocities of constraints, given by their numbers, wherever they occur."""
        for k in numbers:
            constraint = self.mechanism.constraints[k]
            self._velocities[constraint.element_hash()] = (constraint, self.slip(k))

    def _solve(self, constraints: list[ca.SX], quasi: list[ca.SX], T: ca.SX) -> None:
        """Solve for all rates, in small sets of equations that contain only rates known before;
        each body as soon as possible."""
        equations = [*constraints, *quasi]
        rates = [self._places(self.qdot, equation) for equation in equations]
        # a derivative also requires the rates of the coordinates in the coefficients
        needs = [
            unknown | self._places(self.q, equation)
            for unknown, equation in zip(rates, equations, strict=True)
        ]
        waiting = {}
        for body in self.mechanism.bodies:
            velocities = ca.vertcat(body.forward, body.left, body.yaw_rate)
            waiting[body] = self._places(self.qdot, velocities) | self._places(self.q, velocities)
        places = [(i, k) for i, unknown in enumerate(rates) for k in sorted(unknown)]
        sets = _sets(ca.Sparsity.triplet(self.n, self.n, *map(list, zip(*places, strict=True))))
        while sets:
            ready = (s for s in sets if all(k in self.rates or k in s[1] for i in s[0] for k in needs[i]))
            rows, columns = chosen = next(
                ready, (sum((s[0] for s in sets), start=[]), sum((s[1] for s in sets), start=[]))
            )
            sets = [s for s in sets if s is not chosen and chosen in sets]
            right = [
                T[i - len(constraints), :] if i >= len(constraints) else self._by_nu(self.slip(i))
                for i in rows
            ]
            self._solve_set([equations[i] for i in rows], columns, ca.vertcat(*right))
            self._maintain(i for i in rows if i < len(constraints))
            for body in [body for body, needed in waiting.items() if needed <= self.rates.keys()]:
                del waiting[body]
                self._add_body(body)

    def _places(self, symbols: ca.SX, velocities: ca.SX) -> set[int]:
        """Return which of the symbols occur in the velocities."""
        place = {symbols[k].element_hash(): k for k in range(self.n)}
        used = {symbol.element_hash() for symbol in ca.symvar(velocities)}
        return {k for key, k in place.items() if key in used}

    def _by_nu(self, velocity: VelocityRow) -> ca.SX:
        return ca.horzcat(*[velocity.row.get(j, ca.SX(0)) for j in range(self.dof)])

    def _solve_set(self, equations: list[ca.SX], unknown: list[int], right: ca.SX) -> None:
        """Solve equations = right nu for the rates `unknown`."""
        before = set(self._velocities)
        left = [self.velocity(x) for x in equations]
        inverse, velocities = self._solved(left, unknown, right)
        values = ca.vertcat(*map(self.value, velocities))
        drift = -inverse @ ca.substitute(
            ca.vertcat(*[each.drift for each in left]), self.qdot[unknown], values
        )
        for key in set(self._velocities) - before:
            if not self._is_known(self._velocities[key][1]):
                del self._velocities[key]
        for k, (at, velocity) in enumerate(zip(unknown, velocities, strict=True)):
            name = f"{self.mechanism.velocities[at].name}_drift"
            rate = self._simple(drift[k])
            self.rates[at] = VelocityRow(
                velocity.row, self.step(name, rate) if len(unknown) == 1 else rate, velocity.value
            )
            self._velocities[self.qdot[at].element_hash()] = (self.qdot[at], self.rates[at])

    def _solved(
        self, left: list[VelocityRow], unknown: list[int], right: ca.SX
    ) -> tuple[ca.SX, list[VelocityRow]]:
        """Return the inverse of the matrix by the rates `unknown`, and these rates without their drift;
        a single one is named."""
        from .algebra.linear import eliminate  # imports this module in turn

        known = [*range(self.dof), *sorted({j for each in left for j in each.row if j >= self.dof + self.n})]
        B, by_known = (
            ca.vertcat(*[ca.horzcat(*[each.row.get(j, ca.SX(0)) for j in columns]) for each in left])
            for columns in ([self.dof + k for k in unknown], known)
        )
        inverse = (
            1 / B if len(unknown) == 1 else eliminate(B, ca.SX.eye(len(unknown)), self.q, self.mechanism.name)
        )
        rows = self._simple(inverse @ (ca.horzcat(right, ca.SX(len(left), len(known) - self.dof)) - by_known))
        velocities = [
            VelocityRow({j: rows[i, place] for place, j in enumerate(known) if not rows[i, place].is_zero()})
            for i in range(len(unknown))
        ]
        if len(unknown) == 1:
            velocities = [self.named(self.mechanism.velocities[unknown[0]].name, velocities[0])]
        return inverse, velocities

    # -- equations -------------------------------------------------------------------------------------------

    def reduced(self) -> Reduced:
        """Return the reduced equations; terms that do not belong to a body are added last."""
        mechanism = self.mechanism
        M, V = mechanism.rest
        taking_part = [k for k in range(self.n) if not (M[k, :].is_zero() and V[k].is_zero())]
        forces = ca.vertcat(*[self.at(V[k]) for k in taking_part])
        self._add("rest", M[taking_part, taking_part], [self.qdot[k] for k in taking_part], forces)
        for k, (force, on) in enumerate(mechanism.forces):
            self._add(f"force{k + 1}", ca.SX(1, 1), [on], -self.at(force))
        columns = [self.velocity(on) for on in mechanism.actuation]
        groups = (*self._groups, tuple(self.steps[self._grouped :]))
        p = range(self.dof)
        return Reduced(
            groups,
            ca.SX(
                ca.vertcat(*[ca.horzcat(*[self._Mbar.get((min(i, j), max(i, j)), 0) for j in p]) for i in p])
            ),
            ca.SX(ca.vertcat(*[self._bias.get((i,), 0) for i in p])),
            ca.horzcat(*[self._column(velocity) for velocity in columns]),
            ca.horzcat(*[self._column(velocity) for velocity in (self.rates[k] for k in range(self.n))]).T,
            tuple(self._efforts),
        )

    def _add_body(self, body: Body) -> None:
        forward, left, yaw_rate = (self.velocity(x) for x in (body.forward, body.left, body.yaw_rate))
        # Expanded, so that terms can cancel
        v, w, omega = (self._sum(velocity.row) for velocity in (forward, left, yaw_rate))
        # Due to the rotation of the axes
        turned = ca.vertcat(-body.mass * omega * w, body.mass * omega * v, 0)
        along = [body.forward, body.left, body.yaw_rate]
        self._add(body.name, ca.diag(ca.vertcat(body.mass, body.mass, body.inertia)), along, turned)

    def _column(self, velocity: VelocityRow) -> ca.SX:
        return ca.vertcat(*[self._simple(velocity.row.get(j, ca.SX(0))) for j in range(self.dof)])

    def _add(self, name: str, M: ca.SX, along: Sequence[ca.SX], forces: ca.SX) -> None:
        """Add J' M J and J' (M drift + forces) for velocities J nu, in a separate group of steps."""
        more: Entries = {}
        push: Entries = {}
        velocities = [self.velocity(x) for x in along]
        momentum = [self._weighted(M[k, :], velocities) for k in range(len(velocities))]
        self._efforts += [
            Effort(f"{name}_effort_{k + 1}", x, each.row, each.drift + forces[k])
            for k, (x, each) in enumerate(zip(along, momentum, strict=True))
        ]
        for k, (velocity, rate) in enumerate(zip(velocities, momentum, strict=True)):
            for i, a in velocity.row.items():
                push[i,] = push.get((i,), ca.SX(0)) + a * (rate.drift + forces[k])
                for j, b in rate.row.items():
                    if i <= j:
                        more[i, j] = more.get((i, j), ca.SX(0)) + a * b
        for total, part, label in ((self._Mbar, more, "Mbar"), (self._bias, push, "bias")):
            for key, entry in part.items():
                place = "".join(str(k + 1) for k in key)
                total[key] = self.step(
                    f"{label}{place}_{name}", total.get(key, ca.SX(0)) + self._simple(entry)
                )
        self._groups.append(tuple(self.steps[self._grouped :]))
        self._grouped = len(self.steps)

    @staticmethod
    def _weighted(weights: ca.SX, velocities: Sequence[VelocityRow]) -> VelocityRow:
        total = VelocityRow()
        for k, velocity in enumerate(velocities):
            if not weights[k].is_zero():
                total = total.plus(velocity, weights[k])
        return total


def check_bodies(mechanism: Mechanism) -> None:
    """Raise ModelError for a body whose velocities are not those of a rigid body along its own axes, at
    random states.

    For velocities u = j qdot along axes that turn at omega = j_omega qdot the terms dj/dt - du/dq, which are
    zero for the rate of a coordinate, must be omega j_left - left j_omega, forward j_omega - omega j_forward,
    and zero.
    """
    if not mechanism.bodies:
        return
    q, qdot = mechanism.q, mechanism.qdot
    differences, sizes = [], []
    for body in mechanism.bodies:
        velocities = forward, left, omega = body.forward, body.left, body.yaw_rate
        j = [ca.gradient(u, qdot) for u in velocities]
        turned = [
            time_derivative(row, q, qdot) - ca.gradient(u, q) for row, u in zip(j, velocities, strict=True)
        ]
        required = [omega * j[1] - left * j[2], forward * j[2] - omega * j[0], ca.SX.zeros(q.numel())]
        differences.append(ca.norm_inf(ca.vertcat(*turned) - ca.vertcat(*required)))
        sizes.append(1 + ca.norm_inf(ca.vertcat(*required)))
    table = ca.horzcat(ca.vertcat(*differences), ca.vertcat(*sizes))
    for value in Sampled(
        table, ca.vertcat(q, qdot), mechanism.parameters, f"{mechanism.name}: bodies"
    ).values:
        for body, (difference, size) in zip(mechanism.bodies, value, strict=True):
            if difference > RANK_TOLERANCE * size:
                raise ModelError(
                    f"{mechanism.name}: body {body.name!r}: forward and left are not the velocity of its "
                    "centre of mass along axes that turn at yaw_rate; check the signs, or use kinetic_energy"
                )


def _sets(pattern: ca.Sparsity) -> list[tuple[list[int], list[int]]]:
    """Return rows and columns of the blocks of the block triangular form of a square pattern."""
    count, rows, columns, row_start, column_start, *_ = pattern.btf()
    return [
        (
            sorted(rows[row_start[k] : row_start[k + 1]]),
            sorted(columns[column_start[k] : column_start[k + 1]]),
        )
        for k in range(count)
    ]


def cancelled(expression: ca.SX) -> ca.SX:
    """Return the expression, or its sum of products if like terms combine and this is shorter."""
    alike = False
    numbers: dict[tuple[object, ...], int] = {}  # (operation, operands), symbol or constant -> number
    known: dict[int, int] = {}  # hash of a part -> number: a part that is shared many times is numbered once
    expanded: dict[int, Polynomial] = {}  # likewise
    atoms: dict[tuple[int, bool], ca.SX] = {}  # (number of an expression, whether it is a divisor) -> factor

    def number(x: ca.SX) -> int:
        if x.element_hash() not in known:
            if x.is_leaf():
                key: tuple[object, ...] = (float(x),) if x.is_constant() else ("symbol", x.element_hash())
            else:
                key = ("operation", x.op(), *(number(x.dep(k)) for k in range(x.n_dep())))
            known[x.element_hash()] = numbers.setdefault(key, len(numbers))
        return known[x.element_hash()]

    def atom(x: ca.SX, divides: bool = False) -> Polynomial:
        key = (number(x), divides)
        atoms.setdefault(key, 1 / x if divides else x)
        return {(list(atoms).index(key),): 1.0}

    def polynomial(x: ca.SX) -> Polynomial:
        if x.element_hash() not in expanded:
            expanded[x.element_hash()] = polynomial_of(x)
        return expanded[x.element_hash()]

    def polynomial_of(x: ca.SX) -> Polynomial:
        if x.is_constant():
            return {(): float(x)} if not x.is_zero() else {}
        code = None if x.is_leaf() else x.op()
        if code not in (*LINEAR, ca.OP_MUL, ca.OP_SQ, ca.OP_DIV):
            return atom(x)
        first = polynomial(x.dep(0))
        if code in (ca.OP_NEG, ca.OP_TWICE, ca.OP_ASSIGN):
            return scaled(first, {ca.OP_NEG: -1.0, ca.OP_TWICE: 2.0}.get(code, 1.0))
        second = (
            first
            if code == ca.OP_SQ
            else atom(x.dep(1), divides=True)
            if code == ca.OP_DIV
            else polynomial(x.dep(1))
        )
        if code in (ca.OP_ADD, ca.OP_SUB):
            return gathered([*first.items(), *scaled(second, 1.0 if code == ca.OP_ADD else -1.0).items()])
        if len(first) * len(second) > LARGEST_PRODUCT:
            return atom(x)
        return gathered(
            [(tuple(sorted(a + b)), m * n) for (a, m), (b, n) in product(first.items(), second.items())]
        )

    def scaled(terms: Polynomial, factor: float) -> Polynomial:
        return {key: factor * value for key, value in terms.items()}

    def gathered(terms: Sequence[tuple[tuple[int, ...], float]]) -> Polynomial:
        nonlocal alike
        total: Polynomial = {}
        for key, value in terms:
            alike = alike or key in total
            total[key] = total.get(key, 0.0) + value
        return {key: value for key, value in total.items() if value}

    terms = polynomial(expression)
    if not alike:
        return expression
    factors = list(atoms.values())
    written = sum(
        (factor * prod((factors[k] for k in key), start=ca.SX(1)) for key, factor in terms.items()),
        start=ca.SX(0),
    )
    return written if ca.n_nodes(written) < ca.n_nodes(expression) else expression
