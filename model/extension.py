"""Dynamic extension: integrators on inputs until outputs whose decoupling matrix is singular everywhere have
a regular one.

Where outputs depend on fewer combinations of the accelerations u than there are outputs, an integrator is put
on each of these combinations: its value becomes a state xi, its rate an input, and the outputs are
differentiated once more. This is repeated until the decoupling matrix is regular (dynamic extension
algorithm: A. Isidori, Nonlinear Control Systems, section 5.4).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import casadi as ca
import numpy as np

from .algebra.exact import canonical
from .algebra.linear import solve
from .algebra.samples import Sampled, dependent_sets, rank
from .errors import ModelError
from .mechanism import Quantity, derivative_name, derivative_unit, quantity
from .outputs import OutputMap
from .reduction import ReducedSystem
from .vehicle import VELOCITIES, velocity_map

NOTHING = 1e-12  # a row whose entries are at or below this at random states vanishes
LARGEST = 50_000  # operations of a derivative


@dataclass(frozen=True, eq=False)
class Chain:
    """An output as a chain of integrators: its derivatives of order 1 to k - 1, and that of order k, row w +
    drift.

    k is its relative degree; w are the inputs: the accelerations u, or those that remain after an extension.
    """

    rates: tuple[ca.SX, ...]
    row: ca.SX
    drift: ca.SX

    @property
    def degree(self) -> int:
        """Relative degree."""
        return len(self.rates) + 1


@dataclass(frozen=True)
class Choice:
    """Outputs `rows`, which depend on the inputs through those in `columns` only;
    each of these receives an integrator."""

    rows: tuple[int, ...]
    columns: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Integrators:
    """A reduced system with integrators on some inputs: d/dt [nu; xi] = drift + effect w.

    `states` are xi, in the order in which they were added, `choices` what was extended. The inputs w, (n-m) x
    1, are the rates of `velocities` (forward speed and yaw rate if these are fixed combinations of nu, else
    nu), each differentiated once more for each integrator on it.
    """

    system: ReducedSystem
    velocities: tuple[Quantity, ...]
    orders: tuple[int, ...]
    drift: ca.SX
    effect: ca.SX
    states: tuple[Quantity, ...] = ()
    choices: tuple[Choice, ...] = ()

    @property
    def xi(self) -> ca.SX:
        """The states of the integrators, k x 1."""
        return ca.vertcat(ca.SX(0, 1), *[q.symbol for q in self.states])

    @property
    def inputs(self) -> tuple[str, ...]:
        """Return the names of the inputs w."""
        return tuple(
            derivative_name(q.name, order) for q, order in zip(self.velocities, self.orders, strict=True)
        )

    def rates(self, w: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return u = nudot, (n-m) x 1, and d xi/dt, k x 1."""
        rate = ca.densify(self.drift + self.effect @ w)
        return rate[: w.numel()], rate[w.numel() :]

    def derivative(self, expression: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return row and drift of the derivative of an expression in q, nu and xi: row w + drift."""
        slope = ca.jacobian(expression, ca.vertcat(self.system.nu, self.xi))
        return canonical(slope @ self.effect), canonical(
            self.system.along_motion(expression) + slope @ self.drift
        )

    def sampled(self, matrix: ca.SX, of: OutputMap) -> Sampled:
        """Return a matrix at random states."""
        states = ca.vertcat(self.system.moving, self.system.nu, self.xi)
        return Sampled(
            matrix, states, (*self.system.mechanism.parameters, *of.parameters), _where(self.system, of)
        )

    def on(
        self, chains: Sequence[Chain], choice: Choice, states: Sequence[Quantity], of: OutputMap
    ) -> "Extended":
        """Return the chains and integrators after one more integrator on each combination of inputs of a
        choice."""
        count, columns = len(self.velocities), list(choice.columns)
        others = [k for k in range(count) if k not in columns]
        Phi = ca.vertcat(*[chain.row for chain in chains])
        held, free = ca.SX(count, len(columns)), ca.SX(count, count)
        held[columns, :] = ca.SX.eye(len(columns))
        free[others, others] = ca.SX.eye(len(others))
        # w[columns] = held - relation w[others]
        free[columns, others] = -_relation(Phi, choice.rows, columns, others)
        xi = ca.vertcat(*[q.symbol for q in states])
        after = Integrators(
            self.system,
            self.velocities,
            tuple(order + (k in columns) for k, order in enumerate(self.orders)),
            ca.vertcat(canonical(self.drift + self.effect @ held @ xi), ca.SX.zeros(len(columns))),
            ca.vertcat(canonical(self.effect @ free), held.T),
            (*self.states, *states),
            (*self.choices, choice),
        )
        return [after._continued(chain, held @ xi, free, of) for chain in chains], after

    def _continued(self, chain: Chain, held: ca.SX, free: ca.SX, of: OutputMap) -> Chain:
        """Return a chain in the inputs that remain: longer by one if none of these acts on its last
        derivative."""
        row, last = canonical(chain.row @ free), canonical(chain.row @ held + chain.drift)
        if not (row.is_zero() or self.sampled(row, of).largest() < NOTHING):
            return Chain(chain.rates, row, last)
        if ca.n_nodes(last) > LARGEST:
            where = _where(self.system, of)
            raise ModelError(
                f"{where}: no dynamic extension was found: derivatives have more than {LARGEST} operations"
            )
        return Chain((*chain.rates, last), *self.derivative(last))


Extended = tuple[list[Chain], Integrators]


def extend(system: ReducedSystem, chains: Sequence[Chain], of: OutputMap) -> Extended:
    """Return the chains after a dynamic extension, and the integrators. Raises ModelError if none makes Phi
    regular.

    Each stage adds more derivatives of outputs than states. Either Phi becomes regular, or the derivatives,
    as functions of the states, become dependent: then the outputs satisfy a differential equation whatever
    the inputs are.
    """
    extended, added = _begin(system, chains)
    while (choice := _choice(extended, added, of)) is not None:
        derivatives = ca.vertcat(
            *[row.in_motion for row in of.rows], *[rate for chain in extended for rate in chain.rates]
        )
        states = ca.vertcat(system.moving, system.nu, added.xi)
        if added.sampled(ca.jacobian(derivatives, states), of).rank() < derivatives.numel():
            names = ", ".join(row.name for row in of.rows)
            raise ModelError(
                f"{_where(system, of)}: no dynamic extension makes Phi regular: {names} and their "
                "derivatives satisfy an equation that no input changes; replace one of these outputs"
            )
        extended, added = added.on(
            extended, choice, [_state(added.velocities[k], added.orders[k]) for k in choice.columns], of
        )
    return extended, added


def extended_alike(
    system: ReducedSystem, chains: Sequence[Chain], integrators: Integrators, of: OutputMap
) -> Extended:
    """Return the chains and integrators of the same system in other quasi-velocities,
    with the same choices and states."""
    extended, added = _begin(system, chains)
    states = iter(integrators.states)
    for choice in integrators.choices:
        extended, added = added.on(extended, choice, [next(states) for _ in choice.columns], of)
    return extended, added


def _begin(system: ReducedSystem, chains: Sequence[Chain]) -> Extended:
    """Return the chains as functions of the rates of `velocities`, and no integrators."""
    W = velocity_map(system)
    effect = ca.SX.eye(system.dof) if W is None else canonical(solve(W, ca.SX.eye(system.dof)))
    velocities = system.quasi_velocities if W is None else VELOCITIES
    none = Integrators(system, velocities, (1,) * system.dof, ca.SX.zeros(system.dof), effect)
    return [Chain(chain.rates, canonical(chain.row @ effect), chain.drift) for chain in chains], none


def _where(system: ReducedSystem, output: OutputMap) -> str:
    return f"{system.mechanism.name}, output {output.name}"


def _state(velocity: Quantity, order: int) -> Quantity:
    name, unit = derivative_name(velocity.name, order), derivative_unit(velocity.unit, order)
    return quantity(name, unit, f"derivative {order} of {velocity.name}, a state of the dynamic extension")


def _choice(chains: Sequence[Chain], integrators: Integrators, of: OutputMap) -> Choice | None:
    """Return which inputs to extend: the fewest outputs that depend on each other, and inputs through which
    they do; None if Phi is regular somewhere.

    Of several such inputs, those are taken through which they do where all coordinates are 0 (joints
    straight), and of these the ones whose relation to the others is the shortest.
    """
    Phi, count = ca.vertcat(*[chain.row for chain in chains]), len(chains)
    values = integrators.sampled(Phi, of).values
    if max(map(rank, values)) == count:
        return None
    dependent = next(dependent_sets(values))
    shared = max(rank(value[dependent]) for value in values)
    q = integrators.system.moving
    try:
        straight = integrators.sampled(ca.substitute(Phi, q, ca.SX.zeros(q.shape)), of).values
    except ModelError:  # it is not finite there
        straight = []

    def hidden(rows: tuple[int, ...], columns: tuple[int, ...], values: list[np.ndarray]) -> bool:
        return max((rank(value[np.ix_(rows, columns)]) for value in values), default=0) < shared

    candidates = [
        (
            hidden(rows, columns, straight),
            ca.n_nodes(_relation(Phi, rows, columns, range(count))),
            rows,
            columns,
        )
        for rows in combinations(dependent, shared)
        for columns in combinations(range(count), shared)
        if not hidden(rows, columns, values)
    ]
    return Choice(*min(candidates)[2:])


def _relation(Phi: ca.SX, rows: Sequence[int], columns: Sequence[int], others: Sequence[int]) -> ca.SX:
    """Return how the inputs in `columns` and in `others` act on the outputs `rows`:
    as w[columns] + relation w[others]."""
    return canonical(solve(Phi[list(rows), list(columns)], Phi[list(rows), list(others)]))
