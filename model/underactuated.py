"""Robots with fewer inputs than degrees of freedom: partial feedback linearization, zero dynamics, and the
robot at rest.

With B = S'E of rank r < n-m, some accelerations cannot be chosen. Multiplied by N, N B = 0, (10) has no
inputs:

    N (Mbar u + bias) = 0,    u = nudot

Collocated partial feedback linearization (M. W. Spong, Partial feedback linearization of underactuated
mechanical systems, IROS 1994) chooses the rates of the velocities w = B' nu at the inputs, w' = v;
noncollocated, those of r other velocities. Together these are n-m equations for u. What is left when w stays
zero are the zero dynamics: nu = Z eta with B' Z = 0, so that N (Mbar (Z eta' + Z' eta) + bias) = 0.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from .algebra.exact import canonical
from .algebra.linear import solve
from .errors import ModelError
from .mechanism import Mechanism
from .reduction import ReducedSystem, counted, reduce


@dataclass(frozen=True, eq=False)
class PartialLinearization:
    """An underactuated robot."""

    system: ReducedSystem

    @property
    def annihilator(self) -> ca.SX:
        """N, (n-m-r) x (n-m), with N S'E = 0."""
        return self.system.annihilator

    @cached_property
    def velocities(self) -> ca.SX:
        """w = B' nu, the velocities at the inputs, r x 1."""
        return self.system.input_map.T @ self.system.nu

    def directions(self, chosen: Sequence[int] = ()) -> ca.SX:
        """Return Z, (n-m) x (n-m-r): motions that leave the velocities that are linearized zero;
        see `acceleration`."""
        if not chosen:
            return self.annihilator.T
        return ca.SX.eye(self.system.dof)[:, [k for k in range(self.system.dof) if k not in chosen]]

    def coupling(self, chosen: Sequence[int] = ()) -> ca.SX:
        """Return N Mbar Z, (n-m-r) x (n-m-r). Where it is singular, the inputs cannot choose the rates of
        these velocities; Spong calls the robot strongly inertially coupled where it is regular.
        """
        return self.annihilator @ self.system.Mbar @ self.directions(chosen)

    def acceleration(self, v: ca.SX, chosen: Sequence[int] = ()) -> ca.SX:
        """Return u = nudot, (n-m) x 1, with w' = v: collocated. With the numbers of r quasi-velocities in
        `chosen`, others than those at the inputs, these have the rates v: noncollocated, where `coupling` is
        regular.
        """
        system, N = self.system, self.annihilator
        B = system.input_map
        rows, turned = B.T, system.along_motion(B).T @ system.nu
        if chosen:
            rows, turned = ca.SX.eye(system.dof)[list(chosen), :], ca.SX.zeros(len(chosen))
        return solve(ca.vertcat(rows, N @ system.Mbar), ca.vertcat(v - turned, -N @ system.bias))

    def inputs(self, u: ca.SX) -> ca.SX:
        """Return tau, r x 1, for accelerations u that the robot can have."""
        return self.system.first_feedback(u)

    def zero_dynamics(self, eta: ca.SX, chosen: Sequence[int] = ()) -> tuple[ca.SX, ca.SX]:
        """Return qdot, n x 1, and eta', (n-m-r) x 1, while the velocities at the inputs, or the `chosen`
        ones, are zero: nu = Z eta.
        """
        system, N, Z = self.system, self.annihilator, self.directions(chosen)
        nu = ca.densify(Z @ eta)
        bias = ca.substitute(system.bias, system.nu, nu)
        turned = ca.substitute(system.along_motion(Z), system.nu, nu) @ eta
        rate = solve(N @ system.Mbar @ Z, -N @ (system.Mbar @ turned + bias))
        return ca.substitute(system.qdot, system.nu, nu), rate


def passive_equations(system: ReducedSystem, annihilator: ca.SX | None = None) -> tuple[ca.SX, ca.SX]:
    """Return P, (n-m-r) x (n-m), and p of the equations 0 = P u + p, which have no inputs; no rows unless
    underactuated.

    They are the rows of N (Mbar u + bias), each divided by the inertia N_k Mbar N_k': P is as large as the
    identity, whatever the masses are, so that the measure of Phi tells how strongly inertia couples the
    outputs to the inputs. N is `annihilator`, by default that of the system.
    """
    if not system.underactuated:
        return ca.SX(0, system.dof), ca.SX(0, 1)
    N = system.annihilator if annihilator is None else annihilator
    inverse = ca.diag(1 / passive_inertias(system, N))
    return canonical(inverse @ N @ system.Mbar), canonical(inverse @ N @ system.bias)


def passive_inertias(system: ReducedSystem, annihilator: ca.SX) -> ca.SX:
    """Return the inertias N_k Mbar N_k' of these equations, (n-m-r) x 1, which are positive."""
    return ca.diag(canonical(annihilator @ system.Mbar @ annihilator.T))


def passive_names(system: ReducedSystem) -> tuple[str, ...]:
    """Return the names of these equations: each has the quasi-velocity that occurs in no other,
    see `annihilator`."""
    return tuple(f"passive_{system.quasi_velocities[k].name}" for k in system.passive)


def partial_linearization(mechanism: Mechanism) -> PartialLinearization:
    """Return the robot, whose inputs must be independent and fewer than its n-m degrees of freedom. Raises
    ModelError."""
    system = reduce(mechanism, partially=True)
    if not system.underactuated:
        r = counted(len(mechanism.inputs), "input")
        raise ModelError(f"{mechanism.name}: {r} for n - m = {system.dof}: it is not underactuated")
    return PartialLinearization(system)


def at_rest(
    system: ReducedSystem, q: Sequence[float], parameters: Sequence[float]
) -> tuple[list[float], float]:
    """Return the inputs, r, that hold the robot at rest at q as well as inputs can,
    and the largest force that they leave."""
    nothing = [0.0] * system.dof
    needed = ca.Function(
        "needed", [system.mechanism.q, system.nu, system.mechanism.p], [system.bias, system.input_map]
    )
    bias, B = needed(q, nothing, parameters)
    tau = ca.pinv(B) @ bias
    return tau.full().ravel().tolist(), float(ca.norm_inf(B @ tau - bias))
