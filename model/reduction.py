"""From a constrained mechanism to its reduced equations: paper (3), (9) to (13)."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from .errors import ModelError
from .exact import canonical
from .expression import time_derivative
from .mechanism import Mechanism, Quantity, per_second, quantity

SAMPLES = 8  # random states at which generic ranks are looked at
RANK_TOLERANCE = 1e-9  # of the largest singular value


@dataclass(frozen=True, eq=False)
class ReducedSystem:
    """S'MS nudot + S'(M Sdot nu + V) = S'E tau  (10), with qdot = S(q) nu  (9)."""

    mechanism: Mechanism
    quasi_velocities: tuple[Quantity, ...]
    S: ca.SX

    @property
    def nu(self) -> ca.SX:
        """Quasi-velocities, (n-m) x 1."""
        return ca.vertcat(*[v.symbol for v in self.quasi_velocities])

    @property
    def state(self) -> tuple[Quantity, ...]:
        """The state [q; nu] (11), by name."""
        return (*self.mechanism.coordinates, *self.quasi_velocities)

    @property
    def freedom(self) -> int:
        """n - m, the number of quasi-velocities."""
        return len(self.quasi_velocities)

    @property
    def qdot(self) -> ca.SX:
        """S nu (9), n x 1."""
        return self.S @ self.nu

    def along_motion(self, expression: ca.SX) -> ca.SX:
        """Time derivative of an expression in q along (9)."""
        return time_derivative(expression, self.mechanism.q, self.qdot)

    @cached_property
    def Sdot(self) -> ca.SX:
        """dS/dt along the motion, n x (n-m)."""
        return self.along_motion(self.S)

    @cached_property
    def V(self) -> ca.SX:
        """V(q, S nu), n x 1."""
        return ca.substitute(self.mechanism.V, self.mechanism.qdot, self.qdot)

    @cached_property
    def Mbar(self) -> ca.SX:
        """Reduced mass matrix S'MS (10), (n-m) x (n-m)."""
        return canonical(self.S.T @ self.mechanism.M @ self.S)

    @cached_property
    def bias(self) -> ca.SX:
        """S'(M Sdot nu + V) (10), (n-m) x 1."""
        return canonical(self.S.T @ (self.mechanism.M @ self.Sdot @ self.nu + self.V))

    @cached_property
    def input_map(self) -> ca.SX:
        """S'E (10), (n-m) x r."""
        return canonical(self.S.T @ self.mechanism.E)

    def acceleration(self, tau: ca.SX) -> ca.SX:
        """nudot = (S'MS)^-1 (S'E tau - bias) (11), (n-m) x 1."""
        return solve(self.Mbar, self.input_map @ tau - self.bias)

    def first_feedback(self, u: ca.SX, weight: Sequence[float] | None = None) -> ca.SX:
        """tau (12) that makes nudot = u (13), r x 1.

        With more inputs than n-m the one of least sum(weight_i tau_i^2); `weight` is positive, default all 1.
        """
        wanted = self.Mbar @ u + self.bias
        r = len(self.mechanism.inputs)
        if r == self.freedom:
            return solve(self.input_map, wanted)
        inverse = ca.diag(1 / _weights(weight, r))
        return inverse @ self.input_map.T @ solve(canonical(self.input_map @ inverse @ self.input_map.T), wanted)

    def constraint_forces(self, tau: ca.SX, nudot: ca.SX) -> ca.SX:
        """lambda of (8), m x 1, with the paper's sign: +A' lambda on the left-hand side."""
        A, M, E = self.mechanism.A, self.mechanism.M, self.mechanism.E
        rest = E @ tau - self.V - M @ (self.Sdot @ self.nu + self.S @ nudot)
        return solve(canonical(A @ A.T), A @ rest)


def reduce(mechanism: Mechanism) -> ReducedSystem:
    """Choose S(q) (the user's, from her quasi-velocities, or computed) and check what the method needs.

    Raises ModelError when A has not full rank, A S is not zero, S or S'E has not full rank, or inputs are too few.
    """
    mechanism.check()
    n, m = len(mechanism.coordinates), mechanism.A.shape[0]
    A = Sampled(mechanism, mechanism.A)
    if A.rank() < m:
        dependent = mechanism.constraint_names[A.dependent_row()]
        raise ModelError(f"{mechanism.name}: the constraints are not independent: {dependent!r} follows from the others; drop it")
    if len(mechanism.inputs) < n - m:
        raise ModelError(
            f"{mechanism.name}: {len(mechanism.inputs)} inputs for n - m = {n - m} degrees of freedom; "
            "an underactuated robot cannot be linearized by this method: add an input or a constraint"
        )
    S, quasi_velocities = _null_space(mechanism)
    if S.shape != (n, n - m):
        raise ModelError(f"{mechanism.name}: S is {S.shape[0]} x {S.shape[1]}, it must be n x (n-m) = {n} x {n - m}")
    product = Sampled(mechanism, mechanism.A @ S)
    if product.largest() > RANK_TOLERANCE:
        raise ModelError(
            f"{mechanism.name}: A S is not zero (up to {product.largest():.1e}): S does not satisfy "
            f"constraint {mechanism.constraint_names[product.largest_row()]!r}"
        )
    if Sampled(mechanism, S).rank() < n - m:
        raise ModelError(f"{mechanism.name}: the columns of S are dependent; choose other quasi-velocities")
    system = ReducedSystem(mechanism, quasi_velocities, S)
    if Sampled(mechanism, system.input_map).rank() < n - m:
        raise ModelError(
            f"{mechanism.name}: S'E has rank below n - m = {n - m}: the inputs do not reach every motion; "
            "move an input to a coordinate that is free"
        )
    if Sampled(mechanism, system.Mbar).rank() < n - m:
        raise ModelError(f"{mechanism.name}: the mass matrix S'MS is singular: a motion without kinetic energy")
    return system


def solve(matrix: ca.SX, right: ca.SX) -> ca.SX:
    """matrix^-1 right, through cofactors up to 3 x 3 (no pivot that could vanish before the determinant does)."""
    n = matrix.shape[0]
    if n > 3:
        return ca.solve(matrix, right)
    determinant = canonical(ca.det(matrix))
    return ca.adj(matrix) @ right / determinant if n > 1 else right / matrix


class Sampled:
    """A matrix of the mechanism at a few random states, defaults for the parameters: generic rank and size."""

    def __init__(self, mechanism: Mechanism, matrix: ca.SX):
        function = ca.Function("sample", [mechanism.q, mechanism.p], [ca.densify(matrix)])
        random = np.random.default_rng(1992)
        p = [parameter.default for parameter in mechanism.parameters]
        states = random.uniform(-1.5, 1.5, (SAMPLES, len(mechanism.coordinates)))
        self.values = [np.asarray(function(q, p)) for q in states]

    def rank(self) -> int:
        """The largest rank seen: the generic one."""
        return max(_rank(value) for value in self.values)

    def largest(self) -> float:
        """The largest absolute entry seen."""
        return max(float(np.abs(value).max()) for value in self.values)

    def largest_row(self) -> int:
        """The row of that entry."""
        return int(np.argmax(np.max(np.abs(self.values), axis=(0, 2))))

    def dependent_row(self) -> int:
        """The first row that adds nothing to those before it."""
        value = self.values[0]
        return next(k for k in range(value.shape[0]) if _rank(value[: k + 1]) <= k)


def _rank(value: np.ndarray) -> int:
    if not np.all(np.isfinite(value)):
        return 0
    singular = np.linalg.svd(value, compute_uv=False)
    return int(np.sum(singular > RANK_TOLERANCE * max(singular[0], np.finfo(float).tiny)))


def _weights(weight: Sequence[float] | None, r: int) -> ca.SX:
    given = [1.0] * r if weight is None else list(weight)
    if len(given) != r or not all(np.isfinite(w) and w > 0 for w in given):
        raise ModelError(f"weights must be {r} positive numbers, got {given}")
    return ca.SX(given)


def _null_space(mechanism: Mechanism) -> tuple[ca.SX, tuple[Quantity, ...]]:
    """S(q) and its quasi-velocities: given, from the user's quasi-velocities, or from rates chosen here."""
    if mechanism.given_null_space is not None:
        return mechanism.given_null_space, tuple(mechanism.quasi_velocities)
    n, m = len(mechanism.coordinates), mechanism.A.shape[0]
    rows, names = mechanism.quasi_velocity_rows, tuple(mechanism.quasi_velocities)
    if rows is None:
        chosen = _independent_rates(mechanism)
        rows = ca.SX.eye(n)[chosen, :]
        names = tuple(
            quantity(f"{c.name}_rate", per_second(c.unit), f"rate of {c.name}")
            for c in (mechanism.coordinates[k] for k in chosen)
        )
    if rows.shape[0] != n - m:
        raise ModelError(f"{mechanism.name}: {rows.shape[0]} quasi-velocities, there must be n - m = {n - m}")
    square = ca.vertcat(mechanism.A, rows)
    if Sampled(mechanism, square).rank() < n:
        raise ModelError(f"{mechanism.name}: the quasi-velocities do not fix the motion: they depend on the constraints or on each other")
    return eliminate(square, ca.vertcat(ca.SX(m, n - m), ca.SX.eye(n - m))), names


def _independent_rates(mechanism: Mechanism) -> list[int]:
    """n-m coordinates whose rates fix the motion: actuated ones first, then the best conditioned."""
    n, m = len(mechanism.coordinates), mechanism.A.shape[0]
    reached = np.any([v != 0 for v in Sampled(mechanism, mechanism.E).values], axis=(0, 2))
    A = Sampled(mechanism, mechanism.A).values[0]
    chosen: list[int] = []
    for _ in range(n - m):
        def score(k: int) -> tuple[bool, float]:
            stacked = np.vstack([A, np.eye(n)[[*chosen, k]]])
            smallest = np.linalg.svd(stacked, compute_uv=False)[-1]
            return smallest > RANK_TOLERANCE and bool(reached[k]), smallest

        chosen.append(max((k for k in range(n) if k not in chosen), key=score))
    return sorted(chosen)


def eliminate(matrix: ca.SX, right: ca.SX) -> ca.SX:
    """matrix^-1 right in canonical form, by elimination with exact simplification after every step.

    A pivot that vanishes somewhere cancels from the result unless the determinant vanishes there too.
    """
    n = matrix.shape[0]
    table = canonical(ca.densify(ca.horzcat(matrix, right)))
    remaining = list(range(n))
    order = {}
    for _ in range(n):
        row, column = min(
            ((i, j) for i in remaining for j in range(n) if j not in order and not table[i, j].is_zero()),
            key=lambda place: _difficulty(table[place]),
        )
        pivot = table[row, :] / table[row, column]
        pivot[column] = 1
        pivot = canonical(pivot)
        table = ca.densify(table)
        table[row, :] = pivot
        for i in range(n):
            if i != row and not table[i, column].is_zero():
                reduced = table[i, :] - table[i, column] * pivot
                reduced[column] = 0
                table[i, :] = canonical(reduced)
        order[column] = row
        remaining.remove(row)
    return ca.sparsify(ca.vertcat(*[table[order[column], n:] for column in range(n)]))


def _difficulty(pivot: ca.SX) -> tuple[bool, int]:
    return not pivot.is_constant(), ca.n_nodes(pivot)
