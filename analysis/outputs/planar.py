"""Exact description of a vehicle in the plane: heading, axle and points, derived from the equations,
not from names."""

from dataclasses import dataclass

import casadi as ca
import sympy as sp

from ...model.algebra.exact import canonical
from ...model.linearization import Linearization
from ...model.outputs import OutputRow, forward_speed, velocity
from ...model.reduction import ReducedSystem
from ..exact.functions import Functions


@dataclass(frozen=True)
class Planar:
    """Heading, and forward speed and yaw rate as rows in nu, 1 x (n-m).

    `ahead`: distance of the vehicle's point ahead of the axle, m, in parameters only; None without an axle, a
    line across the vehicle whose points do not move along it.
    """

    heading: sp.Expr
    forward: sp.Matrix
    yaw: sp.Matrix
    ahead: sp.Expr | None

    @property
    def cosine(self) -> sp.Expr:
        """Of the heading."""
        return sp.cos(self.heading)

    @property
    def sine(self) -> sp.Expr:
        """Of the heading."""
        return sp.sin(self.heading)


@dataclass(frozen=True)
class Arm:
    """Vector from the middle of the axle to a point: `ahead` along the heading, `left` of it, m,
    in parameters only."""

    ahead: sp.Expr
    left: sp.Expr


def planar_quantities(system: ReducedSystem) -> ca.SX:
    """Return heading, and the rows of forward speed, speed to the left and yaw rate, as one column;
    empty without a vehicle."""
    vehicle = system.mechanism.vehicle
    if vehicle is None:
        return ca.SX(0, 1)
    rates = ca.vertcat(forward_speed(system), velocity(system)[1], system.along_motion(vehicle.heading))
    return ca.vertcat(vehicle.heading, ca.vec(ca.jacobian(rates, system.nu).T))


def planar(entries: list[sp.Expr], functions: Functions) -> Planar | None:
    """Return the vehicle from `planar_quantities`, in exact symbols."""
    if not entries:
        return None
    heading, rest = entries[0], [_lowest(functions, entry) for entry in entries[1:]]
    p = len(rest) // 3
    forward, sideways, yaw = (sp.Matrix(1, p, rest[k * p : (k + 1) * p]) for k in range(3))
    return Planar(heading, forward, yaw, _axle(functions, sideways, yaw))


def arm_quantities(system: ReducedSystem, row: OutputRow) -> ca.SX:
    """Return the distances of an output's point ahead and to the left of the vehicle's point,
    as a column; empty without one."""
    vehicle, through = system.mechanism.vehicle, row.through
    if vehicle is None or through is None or through.inner.shape != (2, 1):
        return ca.SX(0, 1)
    dx, dy = through.inner[0] - vehicle.x, through.inner[1] - vehicle.y
    cosine, sine = ca.cos(vehicle.heading), ca.sin(vehicle.heading)
    return ca.vertcat(cosine * dx + sine * dy, cosine * dy - sine * dx)


def arm(entries: list[sp.Expr], vehicle: Planar | None, functions: Functions) -> Arm | None:
    """Return the vector from `arm_quantities`, in exact symbols; None without an axle,
    or if the point moves on the vehicle."""
    if not entries or vehicle is None or vehicle.ahead is None:
        return None
    ahead, left = (_lowest(functions, entry) for entry in (entries[0] + vehicle.ahead, entries[1]))
    fixed = all(functions.is_constant(part) for each in (ahead, left) for part in functions.ratio(each))
    return Arm(ahead, left) if fixed else None


def motion_quantities(linearization: Linearization) -> ca.SX:
    """Return how the outputs of a law with a dynamic extension move, 3 x (n-m): the derivatives by nu of the
    velocity of their point, 2 x (n-m), and of the speed that is held, zero if it is the point's. 0 x 0 unless
    these are two functions of q, or the distance of a point from a path and a speed.
    """
    system, rows = linearization.system, linearization.output.rows
    first, last = rows[0], rows[-1]
    if not linearization.integrators or len(rows) != 2 or system.mechanism.carried:
        return ca.SX(0, 0)
    speed = ca.jacobian(last.expression, system.nu)
    if first.through is not None and first.through.inner.shape == (2, 1) and not speed.is_zero():
        point = first.through.inner
    else:
        point = ca.vertcat(first.expression, last.expression)
    if ca.depends_on(ca.vertcat(point, ca.vec(speed)), system.nu):
        return ca.SX(0, 0)
    return ca.vertcat(canonical(ca.jacobian(point, system.mechanism.q) @ system.S), ca.densify(speed))


def _axle(functions: Functions, sideways: sp.Matrix, yaw: sp.Matrix) -> sp.Expr | None:
    """Return `ahead` such that the speed to the left is due to turning:
    sideways = ahead * yaw in every quasi-velocity."""
    turning = [k for k, entry in enumerate(yaw) if entry]
    if not turning:
        return None
    ahead = _lowest(functions, sideways[turning[0]] / yaw[turning[0]])
    fixed = all(functions.is_constant(part) for part in functions.ratio(ahead))
    return (
        ahead
        if fixed and not any(functions.ratio(a - ahead * b)[0] for a, b in zip(sideways, yaw, strict=True))
        else None
    )


def _lowest(functions: Functions, expression: sp.Expr) -> sp.Expr:
    return functions.quotient(*functions.ratio(expression))
