"""The drives between the controller and the robot: they take torques,
or velocities that a loop of their own follows."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING, Protocol

import casadi as ca
import numpy as np

from ..model.algebra.direct import Direct
from ..model.algebra.portable import portable
from ..model.reduction import ReducedSystem
from ..readers.reading import one_for_each
from .controllers.controller import RUNNING
from .controllers.velocity import VehicleLimits, VelocityLimits, make_acceleration, make_velocity
from .plant import Plant, motion
from .specification.given import Given

if TYPE_CHECKING:
    from ..model.law import ControlLaw
    from .specification.spec import DriveSection, Simulation


class Drive(Protocol):
    """What moves the robot. What is given to it is one vector, `given`, that is held between two calls of the
    controller.

    `delay` (s): from when it is given until it acts; `commands`: the number of commanded velocities.
    """

    delay: float
    commands: int

    def begin(self, x: np.ndarray) -> np.ndarray:
        """Return what is given before the first call, in the state x at the start."""

    def take(self, x: np.ndarray, status: str, tau: np.ndarray) -> tuple[str, np.ndarray]:
        """Return status and what is given until the next call:
        from the state that the controller sees and its result."""

    def step(
        self, x: np.ndarray, given: np.ndarray, h: float, tolerance: float, t: float = 0.0
    ) -> tuple[np.ndarray, float]:
        """Return the state after h seconds, as Plant.step."""

    def torque(self, x: np.ndarray, given: np.ndarray) -> np.ndarray:
        """Return the inputs of the robot at a state, N or N m."""

    def command(self, given: np.ndarray) -> np.ndarray:
        """Return the commanded velocities."""


class TorqueDrive:
    """Drives that take the torques of the controller."""

    delay, commands = 0.0, 0

    def __init__(self, plant: Plant):
        self._inputs = len(plant.system.mechanism.inputs)
        self.step = plant.step

    def begin(self, x: np.ndarray) -> np.ndarray:
        """No torque."""
        return np.zeros(self._inputs)

    def take(self, x: np.ndarray, status: str, tau: np.ndarray) -> tuple[str, np.ndarray]:
        """See Drive."""
        return status, tau

    def torque(self, x: np.ndarray, given: np.ndarray) -> np.ndarray:
        """See Drive."""
        return given

    def command(self, given: np.ndarray) -> np.ndarray:
        """None."""
        return np.zeros(0)


class VelocityDrive:
    """Drives whose own loop makes each quasi-velocity follow its command c: nudot = omega (c - nu), and with
    feed-forward of the controller's torque the acceleration that this causes in addition; the whole within
    the largest acceleration.

    What is given: [c; tau]; of a kinematic law [c], limited, and no torque.
    """

    def __init__(
        self,
        section: DriveSection,
        simulation: Simulation,
        plant: Plant,
        law: ControlLaw,
        believed: np.ndarray,
        vehicle: VehicleLimits | None = None,
    ):
        """`believed`: parameters of the controller of `law`; `vehicle`: limits of the motion that is
        commanded. Raises BadInput for a wrong number of limits.
        """
        system, period = plant.system, simulation.period
        self.delay, self.commands = section.delay, system.dof
        limits = command_limits(section, system, period, vehicle)
        self._velocity = make_velocity(simulation.backend, limits, period, law)
        self._acceleration = (
            None if section.kinematic else make_acceleration(simulation.backend, law, believed)
        )
        self._period, self._inputs = period, len(system.mechanism.inputs)
        step, torque = driven(system, section.feeds, plant.given)
        self._time = plant.time
        self._step, self._torque = Direct(step), Direct(torque)
        self._own = (plant.parameters, section.omega, np.array(limits.acceleration))

    def begin(self, x: np.ndarray) -> np.ndarray:
        """The present velocities, and no torque."""
        nu = x[-self.commands :]
        self._velocity.reset(nu)
        return np.concatenate([nu, np.zeros(self._inputs)])

    def take(self, x: np.ndarray, status: str, tau: np.ndarray) -> tuple[str, np.ndarray]:
        """See Drive."""
        if self._acceleration is None:
            status, command = self._velocity.follow(tau, x[-self.commands :], status, self._period)
            return status, np.concatenate([command, np.zeros(self._inputs)])
        caused, u = self._acceleration(x, tau)
        status, command = self._velocity.step(
            u, x[-self.commands :], status if caused in RUNNING else caused, self._period
        )
        return status, np.concatenate([command, tau])

    def step(
        self, x: np.ndarray, given: np.ndarray, h: float, tolerance: float, t: float = 0.0
    ) -> tuple[np.ndarray, float]:
        """See Drive."""
        after, error = self._step(x, given, *self._own, h, tolerance, *self._time(t))
        return after, float(error[0])

    def torque(self, x: np.ndarray, given: np.ndarray) -> np.ndarray:
        """See Drive."""
        return self._torque(x, given, *self._own)[0]

    def command(self, given: np.ndarray) -> np.ndarray:
        """See Drive."""
        return given[: self.commands]


def command_limits(
    section: DriveSection, system: ReducedSystem, period: float, vehicle: VehicleLimits | None = None
) -> VelocityLimits:
    """Return the limits of the commands of a controller called every `period` seconds: a command may be ahead
    of the drive by twice what that lags at the largest acceleration. Raises BadInput for a wrong number of
    limits.
    """
    names = [v.name for v in system.quasi_velocities]
    speed = one_for_each(section.most_speed, names, "[drive] most_speed")
    acceleration = one_for_each(section.most_acceleration, names, "[drive] most_acceleration")
    lag = section.lag + period
    return VelocityLimits(
        tuple(speed), tuple(acceleration), tuple(2 * a * lag for a in acceleration), vehicle
    )


def make_drive(
    section: DriveSection | None,
    simulation: Simulation,
    plant: Plant,
    law: ControlLaw,
    believed: np.ndarray,
    vehicle: VehicleLimits | None = None,
) -> Drive:
    """Return the drives of a SPEC. Raises BadInput for limits that do not fit the robot."""
    if section is None or not section.takes_velocity:
        return TorqueDrive(plant)
    return VelocityDrive(section, simulation, plant, law, believed, vehicle)


@lru_cache(maxsize=16)
def driven(system: ReducedSystem, feeds: bool, known: Given = ()) -> tuple[ca.Function, ca.Function]:
    """Return the functions from state, given, parameters, omega (1/s) and largest accelerations: to the state
    after h seconds and its error norm (with h, tolerance and, if something is `known`, t as further
    arguments), and to the torque of the drives.
    """
    mechanism = system.mechanism
    x, p = ca.vertcat(mechanism.q, system.nu), mechanism.p
    command, tau = ca.SX.sym("command", system.dof), ca.SX.sym("tau", len(mechanism.inputs))
    omega, most = ca.SX.sym("omega"), ca.SX.sym("most", system.dof)
    fed = system.acceleration(tau) if feeds else ca.SX.zeros(system.dof)
    nudot = ca.fmax(-most, ca.fmin(most, fed + omega * (command - system.nu)))
    given = [ca.vertcat(command, tau), p, omega, most]
    torque = portable(ca.Function("torque", [x, *given], [ca.densify(system.first_feedback(nudot))]))
    return motion(system, nudot, given, known)[1], torque


def whole_periods(delay: float, period: float) -> tuple[int, float]:
    """Return a delay (s) as a number of whole periods and the rest, above 0 and up to a period, or 0."""
    whole = max(0, math.ceil(delay / period - 1e-9) - 1)
    return whole, delay - whole * period
