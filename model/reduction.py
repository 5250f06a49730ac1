"""From a constrained mechanism to its reduced equations: paper (3), (9) to (13)."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from .algebra.exact import canonical
from .algebra.expression import largest, time_derivative
from .algebra.linear import eliminate, regularity, solve, solve_symmetric
from .algebra.poles import quotient, singular_sets, without_pole
from .algebra.samples import RANK_TOLERANCE, Sampled, smallest_eigenvalue
from .errors import ModelError
from .mechanism import Mechanism, Quantity, is_number, per_second, quantity
from .recursion import Recursion, Reduced, check_bodies

# S'MS is regarded as singular if its smallest eigenvalue, scaled to a unit diagonal, is at or below
NEGLIGIBLE_MASS = 1e-12


@dataclass(frozen=True, eq=False)
class ReducedSystem:
    """S'MS nudot + S'(M Sdot nu + V) = S'E tau  (10), with qdot = S(q) nu  (9).

    Where surfaces move, A qdot = b: then qdot = S nu + s with the particular solution s(q), A s = b, and in
    (10) ds/dt is added to Sdot nu. Quasi-velocities that the user chose are nu = Gamma qdot still: Gamma
    s = 0.
    """

    mechanism: Mechanism
    quasi_velocities: tuple[Quantity, ...]
    S: ca.SX
    reduced: Reduced | None = None  # the equations body by body, if computed together with S
    particular: ca.SX | None = None  # s, n x 1; None: zero, because no surface moves
    # z, k x 1, which are no coordinates but move with them, and Z: dz/dt = Z nu
    foot: tuple[ca.SX, ca.SX] | None = None

    @property
    def nu(self) -> ca.SX:
        """Quasi-velocities, (n-m) x 1."""
        return ca.vertcat(*[v.symbol for v in self.quasi_velocities])

    @property
    def state(self) -> tuple[Quantity, ...]:
        """The state [q; nu] (11), by name."""
        return (*self.mechanism.coordinates, *self.quasi_velocities)

    @property
    def dof(self) -> int:
        """n - m, the number of quasi-velocities."""
        return len(self.quasi_velocities)

    @property
    def qdot(self) -> ca.SX:
        """S nu (9), n x 1; S nu + s where surfaces move."""
        return ca.densify(self.S @ self.nu + self.carried)

    @property
    def carried(self) -> ca.SX:
        """The particular solution s(q), n x 1: qdot with nu = 0; zero unless a surface moves."""
        return ca.SX(self.S.shape[0], 1) if self.particular is None else self.particular

    @cached_property
    def coordinates_by_velocity(self) -> tuple[tuple[int, ...], ...]:
        """For each quasi-velocity the places in q of the coordinates whose rate it is: of a wheel's rate,
        the wheel's angle."""
        rates = ca.vertsplit(canonical(self.qdot))
        return tuple(
            tuple(k for k, rate in enumerate(rates) if ca.is_equal(rate, nu)) for nu in ca.vertsplit(self.nu)
        )

    @cached_property
    def convective(self) -> ca.SX:
        """The second derivative of q with nudot = 0: Sdot nu, and ds/dt where surfaces move, n x 1."""
        rate = self.Sdot @ self.nu
        return rate if self.particular is None else rate + self.along_motion(self.particular)

    @property
    def moving(self) -> ca.SX:
        """What moves with nu: q, and z of the foot on a path, if any."""
        return self.mechanism.q if self.foot is None else ca.vertcat(self.mechanism.q, self.foot[0])

    @property
    def directions(self) -> ca.SX:
        """The derivatives of the rates of `moving` by nu: S, and Z of the foot on a path, if any."""
        return self.S if self.foot is None else ca.vertcat(self.S, self.foot[1])

    def along_motion(self, expression: ca.SX) -> ca.SX:
        """Return the time derivative of an expression in q, and in z of a foot, along (9)."""
        rate = self.qdot if self.foot is None else ca.vertcat(self.qdot, self.foot[1] @ self.nu)
        return time_derivative(expression, self.moving, ca.densify(rate))

    @cached_property
    def Sdot(self) -> ca.SX:
        """dS/dt along the motion, n x (n-m)."""
        return self.along_motion(self.S)

    @cached_property
    def V(self) -> ca.SX:
        """V(q, S nu), n x 1."""
        return ca.substitute(self.mechanism.V, self.mechanism.qdot, self.qdot)

    @cached_property
    def by_bodies(self) -> Reduced | None:
        """The same equations body by body, if the robot defines bodies; else None."""
        mechanism, rows = self.mechanism, self.mechanism.quasi_velocity_rows
        if self.reduced or not mechanism.bodies:
            return self.reduced
        if rows is None:
            return Recursion(mechanism, self.nu, self.S).reduced()
        return _by_bodies(mechanism, self.quasi_velocities, canonical(rows @ self.S))

    @cached_property
    def Mbar(self) -> ca.SX:
        """Reduced mass matrix S'MS (10), (n-m) x (n-m)."""
        S, M = self.S, self.mechanism.M
        if self.by_bodies:
            expression = self.by_bodies.written_out(self.by_bodies.Mbar)
            return self.checked("S'MS", expression, (S, M), lambda S, M: S.T @ M @ S)
        return self.simplified("S'MS", S.T @ M @ S, (S, M), lambda S, M: S.T @ M @ S)

    @cached_property
    def bias(self) -> ca.SX:
        """S'(M Sdot nu + V) (10), (n-m) x 1."""
        forces = self.mechanism.M @ self.convective + self.V
        if self.by_bodies:
            expression = self.by_bodies.written_out(self.by_bodies.bias)
            return self.checked("the bias", expression, (self.S, forces), lambda S, forces: S.T @ forces)
        return self.simplified(
            "the bias", self.S.T @ forces, (self.S, forces), lambda S, forces: S.T @ forces
        )

    @cached_property
    def input_map(self) -> ca.SX:
        """S'E (10), (n-m) x r."""
        S, E = self.S, self.mechanism.E
        return self.simplified("S'E", S.T @ E, (S, E), lambda S, E: S.T @ E)

    def simplified(
        self, name: str, expression: ca.SX, parts: Sequence[ca.SX], combined: Callable[..., np.ndarray | None]
    ) -> ca.SX:
        """Return the expression in canonical form, verified by `checked`."""
        return self.checked(name, canonical(expression), parts, combined)

    def checked(
        self, name: str, expression: ca.SX, parts: Sequence[ca.SX], combined: Callable[..., np.ndarray | None]
    ) -> ca.SX:
        """Return the expression, which must equal `combined` of the values of `parts` (see `added_pole`).

        Raises ModelError if it has a pole that the robot does not have.
        """
        moving = ca.vertcat(self.moving, self.nu)
        return without_pole(self.mechanism.name, name, expression, parts, combined, moving)

    def acceleration(self, tau: ca.SX) -> ca.SX:
        """Return nudot = (S'MS)^-1 (S'E tau - bias) (11), (n-m) x 1."""
        forces = self.input_map @ tau - self.bias
        return self.checked("nudot", solve_symmetric(self.Mbar, forces), (self.Mbar, forces), quotient)

    @property
    def redundant(self) -> bool:
        """Whether there are more inputs than n-m."""
        return len(self.mechanism.inputs) > self.dof

    @property
    def underactuated(self) -> bool:
        """Whether there are fewer inputs than n-m."""
        return len(self.mechanism.inputs) < self.dof

    @cached_property
    def driven(self) -> tuple[int, ...]:
        """The numbers of min(r, n-m) independent rows of S'E; of several, those that do not change with q."""
        B, q = self.input_map, self.mechanism.q
        values, chosen = _sampled(self.mechanism, B, "S'E").values, list[int]()

        def score(k: int) -> tuple[bool, bool, float]:
            worst = min(_distance_from_singular(value[[*chosen, k]]) for value in values)
            return worst > RANK_TOLERANCE, not ca.depends_on(B[k, :], q), worst

        for _ in range(min(B.shape)):
            chosen.append(max((k for k in range(self.dof) if k not in chosen), key=score))
        return tuple(sorted(chosen))

    @property
    def passive(self) -> tuple[int, ...]:
        """The numbers of the other rows, n-m-r; none unless `underactuated`."""
        return tuple(k for k in range(self.dof) if k not in self.driven) if self.underactuated else ()

    @cached_property
    def annihilator(self) -> ca.SX:
        """N, (n-m-r) x (n-m), with N S'E = 0 and the identity in its columns `passive`: multiplied by N,
        (10) has no inputs."""
        B, rows, others = self.input_map, list(self.driven), list(self.passive)
        N = ca.SX(len(others), self.dof)
        if others:
            N[:, others] = ca.SX.eye(len(others))
            N[:, rows] = -canonical(solve(B[rows, :].T, B[others, :].T)).T
        return N

    @cached_property
    def preferred(self) -> ca.SX:
        """Preferred inputs tau_0, r x 1, in q, nu and parameters, used as far as (12) allows;
        zero unless `redundant`."""
        mechanism = self.mechanism
        none = ca.SX(len(mechanism.inputs), 1)
        return (
            ca.sparsify(ca.substitute(mechanism.preferred, mechanism.qdot, self.qdot))
            if self.redundant
            else none
        )

    def spread(self, weight: Sequence[float] | None = None) -> ca.SX:
        """Return W^-1 (S'E)', r x (n-m), whose columns span the inputs of smallest sum(weight_i tau_i^2);
        `weight` as in `input_inverse`.
        """
        weights = self.mechanism.weights if weight is None else _weights(weight, len(self.mechanism.inputs))
        return ca.diag(1 / weights) @ self.input_map.T

    def input_inverse(self, weight: Sequence[float] | None = None) -> ca.SX:
        """Return (S'E)^+, r x (n-m); with more inputs than n-m, the one of smallest sum(weight_i tau_i^2);
        with fewer, that of the rows `driven`.

        `weight` is r positive numbers; None means the robot's own weights.
        """
        unit = ca.SX.eye(self.dof)
        if self.underactuated:
            rows, inverse = list(self.driven), ca.SX(len(self.mechanism.inputs), self.dof)
            parts = self.input_map[rows, :], ca.SX.eye(len(rows))
            inverse[:, rows] = self.checked("(S'E)^-1", solve(*parts), parts, quotient)
            return inverse
        if not self.redundant:
            return self.checked("(S'E)^-1", solve(self.input_map, unit), (self.input_map, unit), quotient)
        spread = self.spread(weight)
        inverse = spread @ solve_symmetric(canonical(self.input_map @ spread), unit)
        return self.checked("(S'E)^+", inverse, (self.input_map, spread), _weighted_inverse)

    @cached_property
    def distribution(self) -> ca.SX:
        """The square matrix that (12) inverts: S'E; with more inputs than n-m S'E W^-1 (S'E)',
        with fewer the rows `driven`."""
        B = self.input_map
        if self.underactuated:
            return B[list(self.driven), :]
        return canonical(B @ self.spread()) if self.redundant else B

    @cached_property
    def inputs_change(self) -> bool:
        """Whether the matrix that (12) inverts changes with q; at random states,
        if that is not seen in its entries."""
        B, q = self.distribution, self.mechanism.q
        if not ca.depends_on(B, q):
            return False
        size, slope = (_sampled(self.mechanism, each, "S'E") for each in (B, ca.jacobian(ca.vec(B), q)))
        return slope.largest() > RANK_TOLERANCE * size.largest()

    @cached_property
    def input_measure(self) -> tuple[ca.SX, ca.SX] | None:
        """Two nonnegative expressions: inputs reach every motion where the first exceeds SINGULAR times the
        second, in which sines and cosines are at their largest, so that an input that loses its effect shows.
        None if S'E does not change with q.
        """
        B = self.distribution
        return regularity(B, largest(B)) if self.inputs_change else None

    def first_feedback(self, u: ca.SX, weight: Sequence[float] | None = None) -> ca.SX:
        """Return tau (12) that makes nudot = u (13), r x 1; `weight` as in `input_inverse`.

        With more inputs than n-m, the one nearest to the preferred tau_0: (S'E)^+ (Mbar u + bias) + (1 -
        (S'E)^+ S'E) tau_0. The contribution of tau_0 is in the null space of S'E: it changes the constraint
        forces and not the motion. With fewer inputs u must be an acceleration that the robot can have: N
        (Mbar u + bias) = 0.
        """
        return self.preferred + self.input_inverse(weight) @ (
            self.Mbar @ u + self.bias - self.input_map @ self.preferred
        )

    def constraint_forces(self, tau: ca.SX, nudot: ca.SX) -> ca.SX:
        """Return lambda of (8), m x 1, with the paper's sign: +A' lambda on the left-hand side."""
        A, M, E = self.mechanism.A, self.mechanism.M, self.mechanism.E
        rest = E @ tau - self.V - M @ (self.convective + self.S @ nudot)
        return solve_symmetric(self._constraint_products, A @ rest)

    @cached_property
    def _constraint_products(self) -> ca.SX:
        """A A', m x m, which all laws of the robot share."""
        return canonical(self.mechanism.A @ self.mechanism.A.T)


def reduce(mechanism: Mechanism, partially: bool = False) -> ReducedSystem:
    """Return the reduced system with S(q) given by the user, from the user's quasi-velocities, or computed;
    check the assumptions.

    Raises ModelError if A does not have full rank, A S is not zero, S or S'E does not have full rank, S'MS is
    not positive definite, or there are too few inputs: fewer than n-m, unless the robot has outputs with as
    many rows, which can be linearized partially, or `partially` says that it need not have any.
    """
    mechanism.check()
    check_bodies(mechanism)
    check_constraints(mechanism)
    n, m = len(mechanism.coordinates), mechanism.A.shape[0]
    r = len(mechanism.inputs)
    if r < n - m and not (partially or any(len(output.rows) == r for output in mechanism.outputs)):
        raise ModelError(
            f"{mechanism.name}: {counted(r, 'input')} for n - m = {n - m} degrees of freedom; an "
            f"underactuated robot cannot be linearized as a whole. Declare outputs with {counted(r, 'row')}, "
            "output(name, about, rows), which are linearized partially; or add "
            f"{counted(n - m - r, 'input')} or {counted(n - m - r, 'constraint')}, or leave out what no "
            "input drives"
        )
    S, quasi_velocities, by_bodies = null_space(mechanism)
    if S.shape != (n, n - m):
        raise ModelError(
            f"{mechanism.name}: S is {S.shape[0]} x {S.shape[1]}; it must be n x (n-m) = {n} x {n - m}"
        )
    check_number(mechanism, len(quasi_velocities))
    product = _sampled(mechanism, mechanism.A @ S, "A S")
    if product.largest() > RANK_TOLERANCE:
        raise ModelError(
            f"{mechanism.name}: A S is not zero (up to {product.largest():.1e}): S does not satisfy "
            f"constraint {mechanism.constraint_names[product.largest_row()]!r}"
        )
    if _sampled(mechanism, S, "S").rank() < n - m:
        raise ModelError(f"{mechanism.name}: the columns of S are dependent; choose other quasi-velocities")
    system = ReducedSystem(mechanism, quasi_velocities, S, by_bodies, particular_solution(mechanism))
    if _sampled(mechanism, system.input_map, "S'E").rank() < (needed := min(r, n - m)):
        raise ModelError(
            f"{mechanism.name}: S'E has rank below {needed}: inputs depend on each other; leave one of them "
            "out"
            if system.underactuated
            else f"{mechanism.name}: S'E has rank below n - m = {n - m}: the inputs do not affect every "
            "motion; move an input to a coordinate that is free"
        )
    for k, weight in enumerate(
        np.transpose([value[:, 0] for value in _sampled(mechanism, mechanism.weights, "weights").values])
    ):
        if weight.min() <= 0.0:
            raise ModelError(
                f"{mechanism.name}: input {mechanism.inputs[k].name!r}: its weight is not positive; a weight "
                "must be a product or sum of positive parameters"
            )
    Mbar = _sampled(mechanism, system.Mbar, "S'MS")
    if min(map(smallest_eigenvalue, Mbar.at_defaults), default=0.0) < -NEGLIGIBLE_MASS:
        raise ModelError(
            f"{mechanism.name}: the mass matrix S'MS is not positive definite: a motion has negative kinetic "
            "energy; check signs and defaults"
        )
    if max(map(smallest_eigenvalue, Mbar.values)) <= NEGLIGIBLE_MASS:
        raise ModelError(
            f"{mechanism.name}: the mass matrix S'MS is singular: a motion without kinetic energy"
        )
    mechanism.reduced = True
    return system


def warnings(system: ReducedSystem) -> list[str]:
    """Return where the constraints lose rank, or the given quasi-velocities are not coordinates of the
    motion: one line each.

    Found by `singular_sets`; empty if there are none, or if S was given directly or chosen automatically.
    """
    mechanism = system.mechanism
    if mechanism.quasi_velocity_rows is None:
        return []
    values = [p.default for p in mechanism.parameters]
    square = ca.vertcat(mechanism.A, mechanism.quasi_velocity_rows)
    sets = singular_sets(square, mechanism.A.shape[0], mechanism.q, mechanism.p, values)
    return [
        f"{mechanism.name}: the constraints lose rank where {where}; the robot has more degrees of freedom "
        "there than S(q) has columns"
        if lost
        else f"{mechanism.name}: the quasi-velocities do not determine the motion where {where}; avoid this, "
        "or choose others"
        for where, lost in sets
    ]


def check_constraints(mechanism: Mechanism) -> None:
    """Raise ModelError for a constraint that follows from others, and if the constraints allow no motion."""
    A = _sampled(mechanism, mechanism.A, "A")
    m, n = mechanism.A.shape
    if A.rank() < m:
        dependent = mechanism.constraint_names[A.dependent_row()]
        raise ModelError(
            f"{mechanism.name}: the constraints are not independent: {dependent!r} follows from the others; "
            "remove it"
        )
    if m >= n:
        raise ModelError(f"{mechanism.name}: {m} constraints allow no motion in {n} coordinates")


def _sampled(mechanism: Mechanism, matrix: ca.SX, name: str) -> Sampled:
    return Sampled(matrix, mechanism.q, mechanism.parameters, f"{mechanism.name}: {name}")


def _weighted_inverse(B: np.ndarray, spread: np.ndarray) -> np.ndarray | None:
    """W^-1 B' (B W^-1 B')^-1, given B and W^-1 B'; None where B has not full rank, or nearly."""
    inverse = quotient(B @ spread, np.eye(len(B)))
    return None if inverse is None else spread @ inverse


def _weights(weight: Sequence[float], r: int) -> ca.SX:
    weights = list(weight) if isinstance(weight, Iterable) else [weight]
    if len(weights) != r or not all(is_number(w) and 0 < w < np.inf for w in weights):
        raise ModelError(f"weights must be {r} positive numbers, not {weights}")
    return ca.SX([float(w) for w in weights])


def check_number(mechanism: Mechanism, count: int) -> None:
    """Raise ModelError unless there are n - m quasi-velocities."""
    m, n = mechanism.A.shape
    if count != n - m:
        raise ModelError(f"{mechanism.name}: {count} quasi-velocities; there must be n - m = {n - m}")


def null_space(mechanism: Mechanism) -> tuple[ca.SX, tuple[Quantity, ...], Reduced | None]:
    """Return S(q) and its quasi-velocities: given, from the user's quasi-velocities, or from automatically
    chosen rates.

    Also returns the reduced equations if they are computed together with S.
    """
    if mechanism.given_null_space is not None:
        return mechanism.given_null_space, tuple(mechanism.quasi_velocities), None
    n, m = len(mechanism.coordinates), mechanism.A.shape[0]
    rows, names = mechanism.quasi_velocity_rows, tuple(mechanism.quasi_velocities)
    if rows is None:
        chosen = _choose_velocities(mechanism)
        rows, names = ca.vertcat(*[row for row, _ in chosen]), tuple(velocity for _, velocity in chosen)
    check_number(mechanism, rows.shape[0])
    square = ca.vertcat(mechanism.A, rows)
    if _sampled(mechanism, square, "the quasi-velocities").rank() < n:
        raise ModelError(
            f"{mechanism.name}: the quasi-velocities do not determine the motion: they depend on the "
            "constraints or on each other"
        )
    right = ca.vertcat(ca.SX(m, n - m), ca.SX.eye(n - m))
    if mechanism.bodies and mechanism.quasi_expressions:
        reduced = _by_bodies(mechanism, names, ca.SX.eye(n - m))
        S = reduced.written_out(reduced.S)
        return without_pole(mechanism.name, "S", S, (square, right), quotient, mechanism.q), names, reduced
    return eliminate(square, right, mechanism.q, mechanism.name), names, None


def particular_solution(mechanism: Mechanism) -> ca.SX | None:
    """Return s(q), n x 1, with A s = b, the velocity of the surfaces: with Gamma s = 0 if the user chose
    quasi-velocities, else of least norm; None if no surface moves.
    """
    if not mechanism.carried:
        return None
    A, b, rows = mechanism.A, mechanism.surface_velocity, mechanism.quasi_velocity_rows
    if rows is None:
        return canonical(A.T @ solve(canonical(A @ A.T), b))
    right = ca.vertcat(b, ca.SX(rows.shape[0], 1))
    return eliminate(ca.vertcat(A, rows), right, mechanism.q, mechanism.name)


def _by_bodies(mechanism: Mechanism, nu: Sequence[Quantity], T: ca.SX) -> Reduced:
    """Return the reduced equations in nu, where the robot's own quasi-velocities are T nu."""
    return Recursion(mechanism, ca.vertcat(*[q.symbol for q in nu]), T, mechanism.quasi_expressions).reduced()


def _choose_velocities(mechanism: Mechanism) -> list[tuple[ca.SX, Quantity]]:
    """Return n-m velocities that determine the motion, as rows of Gamma: those of inputs first, then rates of
    coordinates.

    Of each kind, the one is chosen first that, together with A, is farthest from singular in the worst
    sample.
    """
    n, m = len(mechanism.coordinates), mechanism.A.shape[0]
    candidates = _actuated_velocities(mechanism) + [
        (ca.SX.eye(n)[k, :], _rate(mechanism.coordinates[k])) for k in range(n)
    ]
    actuated = len(mechanism.inputs)
    stacked = _sampled(mechanism, ca.vertcat(mechanism.A, *[row for row, _ in candidates]), "A and E").values
    chosen: list[int] = []

    def score(k: int) -> tuple[bool, float]:
        rows = [*range(m), *[m + j for j in (*chosen, k)]]
        worst = min(_distance_from_singular(value[rows]) for value in stacked)
        return worst > RANK_TOLERANCE and k < actuated, worst

    for _ in range(n - m):
        chosen.append(max((k for k in range(len(candidates)) if k not in chosen), key=score))
    velocities = [candidates[k] for k in sorted(chosen)]
    for _, velocity in velocities:
        if velocity.name in mechanism.names:
            raise ModelError(
                f"{mechanism.name}: the name {velocity.name!r} is used twice: it is also that of an "
                "automatically chosen quasi-velocity; choose your own with quasi_velocity(name, unit, "
                "expression)"
            )
    return velocities


def _actuated_velocities(mechanism: Mechanism) -> list[tuple[ca.SX, Quantity]]:
    """Return the velocity on which each input acts: the rate of a coordinate if it is one."""
    velocities = []
    for k, force in enumerate(mechanism.inputs):
        row = mechanism.E[:, k].T
        rates = [
            c
            for j, c in enumerate(mechanism.coordinates)
            if ca.is_equal(ca.densify(row), ca.densify(ca.SX.eye(len(mechanism.coordinates))[j, :]), 1)
        ]
        unit = {"N": "m/s", "N m": "rad/s"}.get(force.unit, f"W/({force.unit})")
        velocities.append(
            (
                row,
                _rate(rates[0])
                if rates
                else quantity(f"{force.name}_velocity", unit, f"velocity on which {force.name} acts"),
            )
        )
    return velocities


def counted(count: int, noun: str) -> str:
    """Return "1 input", "2 inputs"."""
    return f"{count} {noun}{'s' if count != 1 else ''}"


def _rate(coordinate: Quantity) -> Quantity:
    return quantity(f"{coordinate.name}_rate", per_second(coordinate.unit), f"rate of {coordinate.name}")


def _distance_from_singular(rows: np.ndarray) -> float:
    """Return the smallest singular value of the rows scaled to length 1."""
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    return float(np.linalg.svd(rows / np.where(length > 0, length, 1.0), compute_uv=False)[-1])
