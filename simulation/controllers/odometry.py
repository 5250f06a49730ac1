"""Dead reckoning: the pose of a vehicle from the rotation of its wheels, in Python,
and by the C of runtime_c."""

from __future__ import annotations

import math
from functools import lru_cache
from threading import Lock, RLock
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ...model.algebra.trigonometry import sine, unit
from ...readers.errors import check_named, naming
from .angles import nearest_angle
from .controller import Numbers

if TYPE_CHECKING:
    import casadi as ca

    from ...model.law import ControlLaw
    from ...model.reduction import ReducedSystem
    from .runtime import Runtime

MODES = {"reset": 0, "bumpless": 1}  # as in the C
HEADER = "noslip_odometry.h"
ORIGIN = (0.0, 0.0, 0.0)


class Reckoning(Protocol):
    """Poses are x, y (m) and heading (rad, not wrapped) of the vehicle's point. Objects are thread-safe."""

    def move(self, angle: Numbers, dt: float) -> np.ndarray:
        """Return the pose after each wheel turned at a constant rate by an angle (rad) within dt (s)."""

    def correct(self, truth: Numbers, mode: str) -> np.ndarray:
        """Return the pose after a correction; see Odometry.correct."""

    def unwind(self) -> np.ndarray:
        """Subtract whole turns from the heading and return the pose; the heading is then between -pi and pi,
        except for a pending correction.
        """


class Odometry:
    """The reference implementation. forward (2,) m/rad and turn (2,) rad/rad per wheel angle; the point is
    `ahead` (m) of the axle.

    The estimate is the position of the middle of the axle, as a complex number, and the heading. The pose
    differs from it by the part of a bumpless correction that is not applied yet, an offset that decreases
    over `release` seconds.
    """

    _heading: float

    def __init__(
        self, forward: Numbers, turn: Numbers, ahead: float, release: float = 0.0, start: Numbers = ORIGIN
    ):
        self._wheels = np.array([forward, turn], float)
        self._ahead, self._release = float(ahead), float(release)
        self._offset, self._since = np.zeros(3), 0.0
        self._lock = RLock()
        self._set(start)

    @property
    def pose(self) -> np.ndarray:
        """x, y, heading of the vehicle's point."""
        with self._lock:
            point = self._axle + self._ahead * unit(self._heading)
            fade = max(0.0, 1 - self._since / self._release) if self._release else 0.0
            return np.array([point.real, point.imag, self._heading]) + fade * self._offset

    def move(self, angle: Numbers, dt: float) -> np.ndarray:
        """Integrate the velocity along the arc: distance exp(i heading) times the mean of exp(i s),
        s from 0 to the turn."""
        way, turn = (float(one * angle[0] + other * angle[1]) for one, other in self._wheels)
        half = sine(turn / 2)
        mean = complex(sine(turn), 2 * half * half) / turn if turn else 1.0
        with self._lock:
            self._axle += way * unit(self._heading) * mean
            self._heading += turn
            self._since += dt
            return self.pose

    def correct(self, truth: Numbers, mode: str) -> np.ndarray:
        """reset: the pose is `truth` from now on. bumpless: the difference to the previous pose decreases
        linearly over `release` s.

        In the bumpless mode the difference of the headings is at most half a turn.
        """
        bumpless = _mode(mode) == MODES["bumpless"]
        with self._lock:
            before = self.pose
            self._set(truth)
            self._offset = np.zeros(3)
            if bumpless:
                self._heading += 2 * math.pi * round((before[2] - self._heading) / (2 * math.pi))
                self._offset = before - np.array([truth[0], truth[1], self._heading])
            self._since = 0.0
            return self.pose

    def unwind(self) -> np.ndarray:
        """See Reckoning.unwind; the position of the axle does not change."""
        with self._lock:
            self._heading: float = nearest_angle(self._heading, 0.0)
            return self.pose

    def _set(self, pose: Numbers) -> None:
        self._heading = float(pose[2])
        self._axle = complex(pose[0], pose[1]) - self._ahead * unit(self._heading)


class CompiledOdometry:
    """The same by the C, in double or float. Raises BadInput if the C returns an error."""

    def __init__(
        self, forward: Numbers, turn: Numbers, ahead: float, release: float = 0.0, start: Numbers = ORIGIN,
        scalar: str = "double", c: Runtime | None = None,
    ):  # fmt: skip
        from .runtime import runtime  # slow to import

        self._runtime, self._scalar, self._lock = c or runtime(HEADER), scalar, Lock()
        self._self, self._pose = (
            self._runtime.new(kind, scalar) for kind in ("noslip_odometry", "noslip_pose")
        )
        options = self._runtime.new(
            "noslip_odometry_options", scalar, (tuple(forward), tuple(turn), ahead, release)
        )
        self._call("init", options, self._runtime.new("noslip_pose", scalar, tuple(start)))

    @property
    def pose(self) -> np.ndarray:
        """x, y, heading of the vehicle's point."""
        return self._pose_after()

    def move(self, angle: Numbers, dt: float) -> np.ndarray:
        """See Odometry.move."""
        return self._pose_after("move", self._runtime.array(self._scalar, angle), dt, self._pose)

    def correct(self, truth: Numbers, mode: str) -> np.ndarray:
        """See Odometry.correct."""
        return self._pose_after(
            "correct", self._runtime.new("noslip_pose", self._scalar, tuple(truth)), _mode(mode)
        )

    def unwind(self) -> np.ndarray:
        """See Reckoning.unwind."""
        return self._pose_after("unwind")

    def _pose_after(self, *call) -> np.ndarray:
        """Return the pose after calling a function with these arguments."""
        with self._lock:
            if call:
                self._call(*call)
            self._call("pose", self._pose)
            return np.array([self._pose.x, self._pose.y, self._pose.heading])

    def _call(self, name: str, *arguments) -> None:
        self._runtime.call("dead reckoning", f"noslip_odometry_{name}", self._scalar, self._self, *arguments)


def make_odometry(
    backend: str,
    forward: Numbers,
    turn: Numbers,
    ahead: float,
    release: float = 0.0,
    start: Numbers = ORIGIN,
    law: ControlLaw | None = None,
) -> Reckoning:
    """Return dead reckoning for a backend: casadi in Python, the others by the C; see `runtime_of`.

    Raises BadInput for an unknown backend.
    """
    if backend == "casadi":
        return Odometry(forward, turn, ahead, release, start)
    from .backends import runtime_of  # slow to import

    c, scalar = runtime_of(backend, HEADER, law)
    return CompiledOdometry(forward, turn, ahead, release, start, scalar, c)


def vehicle_wheels(system: ReducedSystem, parameters: Numbers) -> tuple[np.ndarray, np.ndarray, float]:
    """Return (forward (2,), turn (2,), ahead): forward speed and yaw rate per quasi-velocity, and the
    distance of the point ahead of the axle.

    `parameters` in the order of mechanism.parameters. Raises BadInput if forward speed and yaw rate are not
    fixed combinations of two quasi-velocities.
    """
    W, ahead = (value.full() for value in wheels_function(system)(parameters))
    return W[0], W[1], float(ahead[0, 0])


@lru_cache(maxsize=16)
def wheels_function(system: ReducedSystem) -> ca.Function:
    """Return the function of the parameters to (forward; turn) per quasi-velocity (2, 2) and ahead; raises
    BadInput as `vehicle_wheels`.
    """
    import casadi as ca

    from ...model.algebra.portable import portable
    from ...model.errors import ModelError
    from ...model.vehicle import point_ahead, required_velocity_map  # slow to import

    with naming("", ModelError):
        W, ahead = required_velocity_map(system), point_ahead(system)
    return portable(ca.Function("wheels", [system.mechanism.p], [ca.densify(W), ca.densify(ahead)]))


@lru_cache(maxsize=16)
def axle_function(system: ReducedSystem) -> ca.Function:
    """Return the function of steering angle (rad) and parameters to distance (m) and change of heading (rad)
    of the axle per angle (rad) of the rolling wheel, (2,), for a robot with a `steered_axle`.
    """
    import casadi as ca

    from ...model.algebra.portable import portable
    from ...model.vehicle import steered_axle  # slow to import

    axle = steered_axle(system)
    assert axle is not None, "a robot with a steered wheel"
    return portable(ca.Function("axle", [axle.angle, system.mechanism.p], [ca.densify(axle.moved)]))


def has_arm(system: ReducedSystem) -> bool:
    """Return whether the vehicle's point is not that of its coordinates, but fixed on the same body."""
    from ...model.vehicle import point_on_body  # slow to import

    point = point_on_body(system)
    return point is not None and not point.arm.is_zero()


@lru_cache(maxsize=16)
def arm_function(system: ReducedSystem) -> ca.Function:
    """Return the function of the parameters to the arm of `point_on_body`, m, (2,),
    for a robot that has it."""
    import casadi as ca

    from ...model.algebra.portable import portable
    from ...model.vehicle import required_point  # slow to import

    return portable(ca.Function("arm", [system.mechanism.p], [ca.densify(required_point(system).arm)]))


def _mode(name: str) -> int:
    check_named(name, MODES, "unknown correction mode")
    return MODES[name]
