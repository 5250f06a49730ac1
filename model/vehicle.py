"""Vehicles whose forward speed and yaw rate are combinations of the quasi-velocities: fixed ones, as with two
driven wheels, or such that depend on a steering angle.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations, product

import casadi as ca

from .algebra.exact import canonical
from .algebra.linear import solve
from .errors import ModelError
from .mechanism import Quantity, Vehicle, quantity
from .outputs import axle, forward_speed, velocity
from .reduction import ReducedSystem

VELOCITIES = (quantity("forward_speed", "m/s"), quantity("yaw_rate", "rad/s"))


Pose = tuple[Quantity, Quantity, Quantity]  # coordinates


def body_pose(system: ReducedSystem) -> Pose | None:
    """Return the coordinates that displace the vehicle in x and y and turn it: the pose of a body; None if
    there are none, or it cannot be said which.

    The vehicle's own heading may be that of a steered wheel, whose angle against the body is another
    coordinate. Where several coordinates could be the pose, it is that with which the allowed velocities
    turn.
    """
    mechanism, vehicle = system.mechanism, system.mechanism.vehicle
    if vehicle is None:
        return None
    places = (vehicle.x, "m"), (vehicle.y, "m"), (vehicle.heading, "rad")
    each = [
        [q for q in mechanism.coordinates if q.unit == unit and _displaces(q, place)]
        for place, unit in places
    ]
    poses = [(x, y, heading) for x, y, heading in product(*each) if len({x.name, y.name, heading.name}) == 3]
    if len(poses) > 1:
        poses = [pose for pose in poses if _turns(system, pose)]
    return poses[0] if len(poses) == 1 else None


def _displaces(q: Quantity, place: ca.SX) -> bool:
    """Return whether the place is a sum of the coordinate and a function of others."""
    return bool(canonical(ca.jacobian(place, q.symbol)).is_one())


def _turns(system: ReducedSystem, pose: Pose) -> bool:
    """Return whether a rotation of the pose about the origin turns the place of the vehicle, and the
    velocities that the constraints allow: the Lie brackets of the rotation with the columns of S (6) are such
    velocities too.
    """
    mechanism, vehicle = system.mechanism, system.mechanism.required_vehicle
    x, y, heading = (q.symbol for q in pose)
    rotation = (
        -y * ca.jacobian(mechanism.q, x) + x * ca.jacobian(mechanism.q, y) + ca.jacobian(mechanism.q, heading)
    )
    place = ca.jacobian(ca.vertcat(vehicle.x, vehicle.y), mechanism.q) @ rotation - ca.vertcat(
        -vehicle.y, vehicle.x
    )
    brackets = [
        ca.jtimes(each, mechanism.q, rotation) - ca.jtimes(rotation, mechanism.q, each)
        for each in ca.horzsplit(system.S)
    ]
    return all(
        canonical(each).is_zero() for each in (place, *[mechanism.A @ bracket for bracket in brackets])
    )


@dataclass(frozen=True, eq=False)
class PointOnBody:
    """The vehicle's point, fixed on the body whose pose is three coordinates.

    `pose`: x, y (m) and heading (rad) of the body, as numbers of coordinates from 0. `arm`, 2 x 1 (m), in
    parameters only: how far the vehicle's point is ahead of (x, y) and to its left; zero if (x, y) is the
    vehicle's point.
    """

    pose: tuple[int, int, int]
    arm: ca.SX


@lru_cache(maxsize=16)
def point_on_body(system: ReducedSystem) -> PointOnBody | None:
    """Return the vehicle's point on the body that the coordinates place; None if no three coordinates do so.

    Dead reckoning, followers, sweeps and certificates take the pose from here: it is that of the vehicle's
    point, and the coordinates (x, y) are behind it by the arm.
    """
    mechanism, vehicle = system.mechanism, system.mechanism.vehicle
    heading = mechanism.coordinate_numbers([vehicle.heading]) if vehicle else []
    if not vehicle or not heading:
        return None
    c, s = ca.cos(vehicle.heading), ca.sin(vehicle.heading)
    for x, y in permutations([k for k, q in enumerate(mechanism.coordinates) if q.unit == "m"], 2):
        away = ca.vertcat(vehicle.x, vehicle.y) - mechanism.q[[x, y]]
        arm = canonical(ca.vertcat(c * away[0] + s * away[1], c * away[1] - s * away[0]))
        if not ca.depends_on(arm, mechanism.q):
            return PointOnBody((x, y, heading[0]), arm)
    return None


def required_point(system: ReducedSystem) -> PointOnBody:
    """As `point_on_body`. Raises ModelError if there is none."""
    point = point_on_body(system)
    if point is None:
        names = ", ".join(c.name for c in system.mechanism.coordinates)
        raise ModelError(
            f"{system.mechanism.name}: it needs a pose of three coordinates, on whose body its point is; "
            f"{names}"
        )
    return point


def estimated_pose(system: ReducedSystem) -> Vehicle | None:
    """Return the pose that a filter estimates: the vehicle's if its heading is a coordinate, else
    `body_pose`; None if there is neither.
    """
    vehicle = system.mechanism.vehicle
    if vehicle and vehicle.heading.is_symbolic():
        return vehicle
    pose = body_pose(system)
    return Vehicle(*(q.symbol for q in pose)) if pose else None


def velocity_map(system: ReducedSystem) -> ca.SX | None:
    """Return W, 2 x 2, in parameters only, with (forward speed, yaw rate) = W nu;
    None if there is no invertible one."""
    vehicle = system.mechanism.vehicle
    if vehicle is None or system.dof != 2 or system.mechanism.carried:
        return None
    motion = ca.vertcat(forward_speed(system), system.along_motion(vehicle.heading))
    W = canonical(ca.jacobian(motion, system.nu))
    fixed = not ca.depends_on(W, ca.vertcat(system.mechanism.q, system.nu))
    return W if fixed and not canonical(ca.det(W)).is_zero() else None


def required_velocity_map(system: ReducedSystem) -> ca.SX:
    """As `velocity_map`. Raises ModelError if there is none."""
    if why := system.mechanism.why_carried:
        raise ModelError(f"{system.mechanism.name}: {why}")
    W = velocity_map(system)
    if W is None:
        raise ModelError(
            f"{system.mechanism.name}: forward speed and yaw rate are not fixed combinations of two "
            "quasi-velocities; dead reckoning and a point ahead of the axle require that: use "
            "moves_in_plane(x, y, heading), and quasi-velocities such as the rates of two wheels"
        )
    return W


def point_ahead(system: ReducedSystem) -> ca.SX:
    """Return how far the vehicle's point is ahead of the axle, m, in parameters only: its velocity to the
    left per yaw rate.

    Raises ModelError if there is no velocity_map, or the point moves sideways without turning: the wheels are
    not on one axle.
    """
    W, (_, sideways) = required_velocity_map(system), velocity(system)
    by_speed, by_yaw_rate = ca.horzsplit(canonical(ca.jacobian(sideways, system.nu) @ solve(W, ca.SX.eye(2))))
    states = ca.vertcat(system.mechanism.q, system.nu)
    if not by_speed.is_zero() or ca.depends_on(by_yaw_rate, states):
        name = system.mechanism.name
        raise ModelError(
            f"{name}: the vehicle's point moves sideways while it drives straight: the heading is not its "
            "direction of motion"
        )
    return by_yaw_rate


@dataclass(frozen=True, eq=False)
class SteeredAxle:
    """A fixed axle, whose middle moves along its heading, and a steered wheel, which moves as a unicycle
    does.

    Of the two quasi-velocities one is the rate of a rolling wheel, the other the steering rate.
    """

    pose: tuple[int, int, int]  # x, y (m) and heading (rad) of the axle, as numbers of coordinates from 0
    angle: ca.SX  # the coordinate that is the steering angle, rad
    steers: int  # index of the quasi-velocity that is the steering rate
    # 2: distance (m) and change of heading (rad) of the axle per angle (rad) of the rolling wheel, at this
    # angle
    moved: ca.SX
    motion: ca.SX  # 2 x 2: forward speed and yaw rate of the steered wheel are motion @ nu, at this angle
    reach: ca.SX  # m: how far the steered wheel is ahead of the axle, in parameters only


@lru_cache(maxsize=16)
def steered_axle(system: ReducedSystem) -> SteeredAxle | None:
    """Return the axle and the steered wheel of a vehicle; None if it does not move like this."""
    mechanism, vehicle = system.mechanism, system.mechanism.vehicle
    if vehicle is None or system.dof != 2 or mechanism.carried:
        return None
    pose = body_pose(system)
    if pose is None or not _is_on_axle(system):
        return None
    x, y, heading = (q.symbol for q in pose)
    angles = [
        (k, mechanism.coordinates[i].symbol)
        for k, each in enumerate(system.coordinates_by_velocity)
        for i in each
    ]
    for steers, angle in angles:
        if not canonical(vehicle.heading - angle - heading).is_zero():
            continue
        cosine, sine = ca.cos(heading), ca.sin(heading)
        x_rate, y_rate = system.along_motion(x), system.along_motion(y)
        beside = canonical(cosine * y_rate - sine * x_rate)
        moved = canonical(
            ca.jacobian(ca.vertcat(cosine * x_rate + sine * y_rate, system.along_motion(heading)), system.nu)
        )
        motion = canonical(
            ca.jacobian(ca.vertcat(forward_speed(system), system.along_motion(vehicle.heading)), system.nu)
        )
        reach = canonical(cosine * (vehicle.x - x) + sine * (vehicle.y - y))
        aside = canonical(cosine * (vehicle.y - y) - sine * (vehicle.x - x))
        state = [q.symbol for q in system.state]
        others = [symbol for symbol in state if not ca.is_equal(symbol, angle)]
        fixed = not ca.depends_on(ca.vertcat(ca.vec(moved), ca.vec(motion)), ca.vertcat(*others))
        fixed = fixed and not ca.depends_on(reach, ca.vertcat(*state))
        if beside.is_zero() and aside.is_zero() and fixed and moved[:, steers].is_zero():
            numbers = mechanism.coordinate_numbers([x, y, heading])
            return SteeredAxle(
                (numbers[0], numbers[1], numbers[2]), angle, steers, moved[:, 1 - steers], motion, reach
            )
    return None


def _is_on_axle(system: ReducedSystem) -> bool:
    """Return whether the vehicle's point moves along the vehicle's heading at all times."""
    try:
        return axle(system).is_zero()
    except ModelError:
        return False
