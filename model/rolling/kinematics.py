"""A system given by its velocities only: coordinates and constraints A(q) qdot = 0 (2),
or qdot = S(q) nu (9)."""

from dataclasses import dataclass

import casadi as ca

from ..algebra.linear import eliminate
from ..errors import ModelError
from ..mechanism import Mechanism, Quantity, matrix, refuse_strangers, refuse_twice
from ..reduction import ReducedSystem, check_constraints, check_number


@dataclass(frozen=True, eq=False)
class Kinematics:
    """n coordinates with m constraints, given by A(q), m x n, by S(q), n x (n-m), or by both.

    Entries are exact: a number represents the simplest fraction, multiple of pi or root that equals it up to
    rounding. Raises ModelError for matrices of the wrong shape, unknown symbols, and names used twice.
    """

    name: str
    coordinates: tuple[Quantity, ...]
    parameters: tuple[Quantity, ...] = ()
    A: ca.SX | None = None
    S: ca.SX | None = None
    constraint_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        n = len(self.coordinates)
        if not n:
            raise ModelError(f"{self.name}: no coordinates")
        if self.A is None and self.S is None:
            raise ModelError(f"{self.name}: neither constraints A(q) nor S(q)")
        refuse_twice([q.name for q in (*self.coordinates, *self.parameters)], self.name)
        symbols = ca.vertcat(*[q.symbol for q in (*self.coordinates, *self.parameters)])
        for name in ("A", "S"):
            value = getattr(self, name)
            if value is not None:
                checked = matrix(value, f"{self.name}: {name}")
                refuse_strangers(checked, symbols, f"{self.name}: {name}", "coordinate or parameter of it")
                object.__setattr__(self, name, checked)
        if self.A is not None and (self.A.shape[1] != n or self.A.shape[0] >= n):
            raise ModelError(
                f"{self.name}: A is {self.A.shape[0]} x {self.A.shape[1]}, it must be m x n with m < n = {n}"
            )
        columns = n - self.A.shape[0] if self.A is not None else None
        if self.S is not None and (
            self.S.shape[0] != n or not 0 < self.S.shape[1] <= n or columns not in (None, self.S.shape[1])
        ):
            shape = f"n x (n-m) = {n} x {'(n-m)' if columns is None else columns}"
            raise ModelError(f"{self.name}: S is {self.S.shape[0]} x {self.S.shape[1]}, it must be {shape}")
        if not self.constraint_names:
            object.__setattr__(self, "constraint_names", tuple(f"constraint {k + 1}" for k in range(self.m)))

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.coordinates)

    @property
    def m(self) -> int:
        """Number of constraints."""
        if self.A is not None:
            return self.A.shape[0]
        assert self.S is not None, "one of them is given"
        return self.n - self.S.shape[1]


def kinematics(system: Kinematics | Mechanism | ReducedSystem) -> Kinematics:
    """Return the kinematics of a mechanism: its A, and S for its quasi-velocities if it has some; energy and
    inputs are not used.

    Raises ModelError if there are no coordinates or constraints, or if the number of quasi-velocities is not
    n - m.
    """
    if isinstance(system, Kinematics):
        return system
    mechanism, S = (
        (system.mechanism, system.S)
        if isinstance(system, ReducedSystem)
        else (system, system.given_null_space)
    )
    if not mechanism.coordinates or not mechanism.constraint_names:
        raise ModelError(
            f"{mechanism.name}: the analysis requires coordinates and constraints; add them with coordinate "
            "and rolls"
        )
    A, gamma = mechanism.A, mechanism.quasi_velocity_rows
    if A.shape[0] >= len(mechanism.coordinates):
        check_constraints(mechanism)
    if S is None and gamma is not None:
        S = _null_space(mechanism, gamma)
    names = tuple(mechanism.constraint_names)
    return Kinematics(mechanism.name, tuple(mechanism.coordinates), tuple(mechanism.parameters), A, S, names)


def _null_space(mechanism: Mechanism, gamma: ca.SX) -> ca.SX | None:
    """Return S with A S = 0 and gamma S = 1; None if the two together are singular, for example because of
    dependent constraints.
    """
    A, name = mechanism.A, mechanism.name
    m, n = A.shape
    check_number(mechanism, gamma.shape[0])
    try:
        return eliminate(
            ca.vertcat(A, gamma), ca.vertcat(ca.SX(m, n - m), ca.SX.eye(n - m)), mechanism.q, name
        )
    except ValueError:  # no pivot left
        return None
