"""The reduced dynamics of a robot (the plant) as a program: named steps, divided between init and the calls.

Internally the quasi-velocities are the vehicle's forward speed and yaw rate, if it has these (w = W nu): S
and S'MS are then sparse.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from ..model.algebra.exact import canonical
from ..model.algebra.linear import solve
from ..model.mechanism import Quantity, quantity
from ..model.recursion import Recursion, Reduced
from ..model.reduction import ReducedSystem
from ..model.vehicle import velocity_map
from .derivation.stages import Result, inner_velocities
from .graph import Group, Node, angles, executed, reachable
from .program import Entry, constants_of
from .steps import StepBuilder, SteppedBody

UNROLLED = 5  # quasi-velocities up to which L D L' is written out; above, the runtime's loop is shorter
NEGLIGIBLE_PIVOT = 1e-6  # relative to the diagonal of the mass matrix, as in noslip_solve.inc


EVALUATE = Entry(
    "evaluate",
    "All of (9) and (10) at one sine and cosine of each angle",
    (Result.COORDINATE_RATES, Result.MASS, Result.BIAS, Result.INPUT_MAP),
    whole=True,
)
ENTRIES = (
    Entry("reduced", "Reduced mass matrix S'MS and bias S'(M Sdot nu + V) (10)", (Result.MASS, Result.BIAS)),
    EVALUATE,
    Entry(
        "acceleration",
        "The state's rate (11): qdot = S nu, nudot = (S'MS)^-1 (S'E tau - bias)",
        (Result.COORDINATE_RATES, Result.VELOCITY_RATES),
        Group.INPUT,
    ),
)


@dataclass(frozen=True, eq=False)
class DynamicsProgram:
    """The entry points, the constants that init computes for them, names of nodes,
    and pivots that init checks."""

    system: ReducedSystem
    entries: dict[Entry, SteppedBody]
    constants: dict[Node, str]
    labels: dict[Node, str]
    regular: list[tuple[Node, Node]]  # init returns singular if the first is not greater than the second

    @property
    def groups(self) -> dict[str, Sequence[Quantity]]:
        """The leaves of the graph, by group."""
        return _groups(self.system)

    @property
    def angles(self) -> list[Node]:
        """Arguments of sines and cosines that change from call to call."""
        return angles(executed(root for body in self.entries.values() for root in body.roots))

    @property
    def fixed_angles(self) -> list[Node]:
        """Arguments of sines and cosines that init computes."""
        return angles(reachable([*self.constants, *(node for pair in self.regular for node in pair)]))


def compile_dynamics(system: ReducedSystem, optimize: bool = True) -> DynamicsProgram:
    """Build the graph of the dynamics and separate the constants of init; `optimize` runs the optimizer on
    each group of steps."""
    return _Builder(system, optimize).program()


class _Builder(StepBuilder):
    """The steps of a robot's dynamics."""

    def __init__(self, system: ReducedSystem, optimize: bool):
        super().__init__(_groups(system), system.mechanism.name, optimize)
        self.system = system

    def program(self) -> DynamicsProgram:
        """Return the program with all entry points."""
        reduced, w, W = _equations(self.system)
        self.group(list(zip(ca.vertsplit(w), ca.vertsplit(W @ self.system.nu), strict=True)))
        for group in reduced.groups:
            self.group(group)
        tau = ca.vertcat(*[q.symbol for q in self.system.mechanism.inputs])
        force = reduced.input_map @ tau - reduced.bias
        quantities = {
            Result.COORDINATE_RATES: self._rates(reduced.S, w, W) + self.system.carried,
            Result.MASS: W.T @ reduced.Mbar @ W,
            Result.BIAS: W.T @ reduced.bias,
            Result.INPUT_MAP: canonical(W.T @ reduced.input_map),
        }
        looped = None
        if self.system.dof > UNROLLED:
            looped = W.T @ reduced.Mbar @ W, W.T @ force
        else:
            quantities[Result.VELOCITY_RATES] = _inverse(W) @ self._solved(reduced.Mbar, force)
        entries = {
            entry: self._body(entry, quantities, looped if Result.VELOCITY_RATES in entry.answers else None)
            for entry in ENTRIES
        }
        constants = constants_of([root for body in entries.values() for root in body.roots], self.labels)
        return DynamicsProgram(self.system, entries, constants, self.labels, self.regular)

    def _rates(self, S: ca.SX, w: ca.SX, W: ca.SX) -> ca.SX:
        """Return qdot = S w (9); entries that are multiples of an entry of nu are computed from nu."""
        parameters = {p.symbol.element_hash() for p in self.system.mechanism.parameters}
        rows = []
        for row in ca.vertsplit(S):
            fixed = all(symbol.element_hash() in parameters for symbol in ca.symvar(row))
            of_nu = canonical(row @ W) if fixed else row
            rows.append(of_nu @ self.system.nu if fixed and of_nu.is_constant() else row @ w)
        return ca.vertcat(*rows)

    def _body(
        self, entry: Entry, quantities: dict[Result, ca.SX], looped: tuple[ca.SX, ca.SX] | None
    ) -> SteppedBody:
        chosen = {name: quantities[name] for name in entry.answers if name in quantities}
        matrices = iter(self.built([*chosen.values(), *(looped or ())]))
        results = {name: next(matrices) for name in chosen}
        loop = (next(matrices), next(matrices)) if looped else None
        body = SteppedBody((), results, loop)
        return SteppedBody(tuple(self.needed(body.roots)), results, loop)

    def _solved(self, matrix: ca.SX, right: ca.SX) -> ca.SX:
        """Return matrix^-1 right by L D L' for a symmetric, positive definite matrix;
        zeros in it are exploited."""
        n = matrix.shape[0]
        table: dict[tuple[int, int], ca.SX] = {}  # L below the diagonal
        inverse: list[ca.SX] = []
        for i in range(n):
            above: list[ca.SX] = []  # L D
            for j in range(i):
                above.append(matrix[i, j] - sum((above[k] * table[j, k] for k in range(j)), start=ca.SX(0)))
            for j in range(i):
                table[i, j] = self.step(f"L_{i + 1}{j + 1}", above[j] * inverse[j])
            pivot = matrix[i, i] - sum((above[j] * table[i, j] for j in range(i)), start=ca.SX(0))
            alone = all(entry.is_zero() for entry in above)
            symbol = ca.SX.sym(f"pivot_{i + 1}")
            self.group([(symbol, pivot)], [ca.SX(0) if alone else NEGLIGIBLE_PIVOT * matrix[i, i]])
            inverse.append(1 / symbol)
        x = list(ca.vertsplit(right))
        for i in range(n):
            x[i] -= sum((table[i, j] * x[j] for j in range(i)), start=ca.SX(0))
            x[i] = self.step(f"force_{i + 1}", x[i])
        for i in reversed(range(n)):
            rest = sum((table[j, i] * x[j] for j in range(i + 1, n)), start=ca.SX(0))
            x[i] = self.step(f"w_dot_{i + 1}", x[i] * inverse[i] - rest)
        return ca.vertcat(*x)


def _groups(system: ReducedSystem) -> dict[str, Sequence[Quantity]]:
    return {"params": system.mechanism.parameters, "state": system.state, "input": system.mechanism.inputs}


def _equations(system: ReducedSystem) -> tuple[Reduced, ca.SX, ca.SX]:
    """Return the reduced equations in w, w, and W with w = W nu;
    body by body if the robot declares its bodies."""
    mechanism = system.mechanism
    if not (mechanism.bodies and mechanism.quasi_expressions):
        inner, W = inner_velocities(system)
        return Reduced((), inner.Mbar, inner.bias, inner.input_map, inner.S), inner.nu, W
    mapped = velocity_map(system)
    W = ca.SX.eye(system.dof) if mapped is None else mapped
    names = (
        [f"w_{q.name}" for q in system.quasi_velocities] if mapped is None else ["forward_speed", "yaw_rate"]
    )
    w = ca.vertcat(*[quantity(name, "").symbol for name in names])
    return Recursion(mechanism, w, _inverse(W), mechanism.quasi_expressions).reduced(), w, W


def _inverse(W: ca.SX) -> ca.SX:
    return canonical(solve(W, ca.SX.eye(W.shape[0])))
