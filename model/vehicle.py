"""Vehicles whose forward speed and yaw rate are fixed combinations of the quasi-velocities, as with two driven wheels."""

import casadi as ca

from .algebra.exact import canonical
from .algebra.linear import solve
from .errors import ModelError
from .mechanism import Mechanism, Quantity, Vehicle, quantity
from .outputs import forward_speed, velocity
from .reduction import ReducedSystem

VELOCITIES = (quantity("forward_speed", "m/s"), quantity("yaw_rate", "rad/s"))


def body_pose(mechanism: Mechanism) -> tuple[Quantity, Quantity, Quantity] | None:
    """Return the coordinates that displace the vehicle in x and y and turn it: the pose of a body; None if there are none.

    The vehicle's own heading may be that of a steered wheel, whose angle against the body is another coordinate.
    """
    vehicle = mechanism.vehicle
    if vehicle is None:
        return None
    found = []
    for place, unit in ((vehicle.x, "m"), (vehicle.y, "m"), (vehicle.heading, "rad")):
        found += [q for q in mechanism.coordinates if q.unit == unit and ca.jacobian(place, q.symbol).is_one()][:1]
    return (found[0], found[1], found[2]) if len({q.name for q in found}) == 3 else None


def estimated_pose(mechanism: Mechanism) -> Vehicle | None:
    """Return the pose that a filter estimates: the vehicle's if its heading is a coordinate, else `body_pose`; None if there is
    neither.
    """
    if mechanism.vehicle and mechanism.vehicle.heading.is_symbolic():
        return mechanism.vehicle
    pose = body_pose(mechanism)
    return Vehicle(*(q.symbol for q in pose)) if pose else None


def velocity_map(system: ReducedSystem) -> ca.SX | None:
    """Return W, 2 x 2, in parameters only, with (forward speed, yaw rate) = W nu; None if there is no invertible one."""
    vehicle = system.mechanism.vehicle
    if vehicle is None or system.dof != 2 or system.mechanism.carried:
        return None
    motion = ca.vertcat(forward_speed(system), system.along_motion(vehicle.heading))
    W = canonical(ca.jacobian(motion, system.nu))
    fixed = not ca.depends_on(W, ca.vertcat(system.mechanism.q, system.nu))
    return W if fixed and not canonical(ca.det(W)).is_zero() else None


def required_velocity_map(system: ReducedSystem) -> ca.SX:
    """As `velocity_map`. Raises ModelError if there is none."""
    W = velocity_map(system)
    if W is None:
        raise ModelError(
            f"{system.mechanism.name}: forward speed and yaw rate are not fixed combinations of two quasi-velocities; dead "
            "reckoning and a point ahead of the axle require that: use moves_in_plane(x, y, heading), and quasi-velocities "
            "such as "
            "the rates of two wheels"
        )
    return W


def point_ahead(system: ReducedSystem) -> ca.SX:
    """Return how far the vehicle's point is ahead of the axle, m, in parameters only: its velocity to the left per yaw rate.

    Raises ModelError if there is no velocity_map, or the point moves sideways without turning: the wheels are not on one axle.
    """
    W, (_, sideways) = required_velocity_map(system), velocity(system)
    by_speed, by_yaw_rate = ca.horzsplit(canonical(ca.jacobian(sideways, system.nu) @ solve(W, ca.SX.eye(2))))
    states = ca.vertcat(system.mechanism.q, system.nu)
    if not by_speed.is_zero() or ca.depends_on(by_yaw_rate, states):
        name = system.mechanism.name
        raise ModelError(
            f"{name}: the vehicle's point moves sideways while it drives straight: the heading is not its direction of motion"
        )
    return by_yaw_rate
