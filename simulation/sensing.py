"""What the controller sees where it does not see the truth: noisy wheel rates,
a dead-reckoned pose, corrections."""

import math
from collections import deque

import numpy as np

from ..model.algebra.direct import Direct
from ..model.algebra.trigonometry import sine_cosine, unit
from ..model.law import ControlLaw
from ..model.reduction import ReducedSystem
from ..model.vehicle import point_on_body, steered_axle
from ..readers.errors import BadInput, check_status
from ..readers.reading import one_for_each
from .controllers import SCALAR
from .controllers.angles import nearest_angle
from .controllers.ground.slip import Noticed, SlipOptions, make_slip
from .controllers.odometry import arm_function, axle_function, make_odometry, vehicle_wheels
from .guidance import Number, vehicle_motion
from .noise import Noise
from .specification.spec import (
    Correction,
    EstimatorSection,
    GyroSection,
    NoticeSlipSection,
    Sensors,
    Simulation,
)

# Added to the seed for gyro and accelerometer, so that their noise is not that of the wheels
GYRO_SEED = 2**63
ERRORS = 2**40  # added to the seed: errors of gyro and measured poses are independent of those of the wheels
UNWIND = 4.0  # rad: beyond it whole turns are taken off the heading seen, as in firmware/vehicle.c


class NoisyRates:
    """Sensors of one run that tell the truth but for noise of the quasi-velocities. `state` is what the
    controller sees: [q; nu], SI.
    """

    jumped = False  # whether the pose was corrected at once, the last time
    slip: "SlipSensing | None" = None  # set by the loop where slip is to be noticed

    def __init__(self, sensors: Sensors, system: ReducedSystem, start: np.ndarray):
        """Raises BadInput for a wrong number of means or deviations."""
        dof, names = system.dof, [q.name for q in system.quasi_velocities]
        self._sensors = sensors
        self._mean, self._sd = (
            np.array(one_for_each(values, names, "[sensors] noise"))
            for values in (sensors.noise.mean, sensors.noise.sd)
        )
        self._random = Noise(sensors.seed, dof) if self._sd.any() else None  # without, no C is needed
        self._rates = slice(len(start) - dof, len(start))
        self._noise, self._drawn = self._draw(), 0.0
        self.state = start.copy()
        self.state[self._rates] += self._noise

    def sense(self, t: float, x: np.ndarray) -> None:
        """Look at the true state x at time t, in order of time."""
        if t:
            self._renew(t)
        self.state = x.copy()
        self.state[self._rates] += self._noise

    def _renew(self, t: float) -> None:
        """Draw the noise at t if it is time."""
        if (sample := _count(t, self._sensors.period)) > self._drawn:
            self._noise, self._drawn = self._draw(), sample

    def _draw(self) -> np.ndarray:
        return self._mean + self._sd * self._random.draw() if self._random else self._mean


class Sensing(NoisyRates):
    """Sensors and dead reckoning of one run. `state` is what the controller sees: [q; nu], SI; `reckoned` the
    pose of the vehicle's point, (3,), `placed` the coordinates at this pose.

    The noise of a sample counts until the next: the dead-reckoned pose feels it for as long as the controller
    does. Its heading is the true one but for whole turns.
    """

    def __init__(
        self,
        sensors: Sensors,
        correction: Correction | None,
        law: ControlLaw,
        parameters: np.ndarray,
        believed: np.ndarray,
        start: np.ndarray,
        backend: str,
    ):
        """Starts from the true pose. `parameters` are the truth,
        `believed` what the controller reckons with."""
        system = law.system
        super().__init__(sensors, system, start)
        self._correction, self.parameters = correction, parameters
        self._motion = Direct(vehicle_motion(system))
        axle = steered_axle(system)
        self._axle = SteeredMotion(system, axle.steers, believed) if axle else None
        self._pose = list(axle.pose) if axle else pose_coordinates(system)
        self._angles = angle_coordinates(system)
        # m, in the axes of the body
        self._arm = 0j if axle else complex(*arm_function(system)(believed).full().ravel())
        forward, turn, ahead = SteeredMotion.WHEELS if axle else vehicle_wheels(system, believed)
        release = correction.release or 1 / correction.rate if correction else 0.0
        self._odometry = make_odometry(
            backend, forward, turn, ahead, release, start=self._true_pose(start), law=law
        )
        self.reckoned = self._true_pose(start)
        if sensors.pose == "reckoned":
            self.state[self._pose] = self.placed
        self._t, self._true_angle = 0.0, start[self._angles].copy()
        self._turned = self._true_angle.copy()  # with the noise so far; what an encoder counts
        self._corrected = 0.0

    def sense(self, t: float, x: np.ndarray) -> None:
        """Look at the true state x at time t, in order of time."""
        dt, self._t = t - self._t, t
        self.jumped = False
        if not dt:
            return
        angle = x[self._angles]
        before = self._counted()
        self._turned += angle - self._true_angle + self._noise * dt
        self._true_angle = angle.copy()
        moved = self._counted() - before
        if self.slip:
            self.slip.sense(moved, dt, self._true_pose(x))
        pose = self._pose_after(t, dt, moved, x)
        self._renew(t)
        self.state = x.copy()
        self.reckoned = pose
        if self._sensors.pose == "reckoned":
            self.state[self._pose] = self.placed
        self.state[self._angles] = self._counted()
        self.state[self._rates] = self._rate_scales() * (
            moved / dt if self._sensors.counts else x[self._rates] + self._noise
        )

    def _pose_after(self, t: float, dt: float, moved: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Return the pose after the wheels turned by `moved` in dt, corrected if it is time;
        x is the true state."""
        if abs(self.reckoned[2]) > UNWIND:
            self._odometry.unwind()
        pose = self._odometry.move(self._axle.moved(moved, self._counted()) if self._axle else moved, dt)
        if self._correction and (due := _count(t, 1 / self._correction.rate)) > self._corrected:
            self._corrected, self.jumped = due, self._correction.mode == "reset"
            *place, heading = self._true_pose(x)
            pose = self._odometry.correct((*place, nearest_angle(heading, pose[2])), self._correction.mode)
            if self.slip:
                self.slip.notice.trust()
        return pose

    @property
    def placed(self) -> np.ndarray:
        """The coordinates x, y (m) and heading (rad) at the pose that is reckoned."""
        x, y, heading = self.reckoned
        place = complex(x, y) - self._arm * unit(heading)
        return np.array([place.real, place.imag, heading])

    def _rate_scales(self) -> np.ndarray:
        """Return by how much each sensed rate is multiplied."""
        return np.ones(len(self._mean))

    def _counted(self) -> np.ndarray:
        """The wheels' angles as the encoders tell them."""
        if not self._sensors.counts:
            return self._turned.copy()
        step = 2 * math.pi / self._sensors.counts
        return np.floor(self._turned / step) * step

    def _true_pose(self, x: np.ndarray) -> np.ndarray:
        return x[self._pose] if self._axle else self._motion(x, self.parameters)[0][:3]


class SteeredMotion:
    """The motion of the fixed axle of a vehicle with a steered wheel, by its encoders: that of the follower
    in C. Dead reckoning is given distance and change of heading instead of angles of wheels.
    """

    WHEELS = (1.0, 0.0), (0.0, 1.0), 0.0  # forward, turn and ahead of make_odometry

    def __init__(self, system: ReducedSystem, steers: int, believed: np.ndarray):
        self._steers, self._believed = steers, believed
        self._by_angle = Direct(axle_function(system))

    def moved(self, turned: np.ndarray, angles: np.ndarray) -> np.ndarray:
        """Return distance (m) and change of heading (rad) of the axle, (2,), after its wheels turned, (2,),
        to `angles`: those at the steering angle in the middle.
        """
        angle = angles[self._steers] - turned[self._steers] / 2
        return self._by_angle(angle, self._believed)[0] * turned[1 - self._steers]


class SlipSensing:
    """Gyro and accelerometer of one run, and what is noticed by them. `noticed` is the result of the last
    call."""

    def __init__(
        self,
        sensing: Sensing,
        sensors: Sensors,
        gyro: GyroSection,
        notice: NoticeSlipSection,
        mu: float,
        law: ControlLaw,
        believed: np.ndarray,
        backend: str,
        period: float,
    ):
        """`mu`: the friction of [contact]; `believed`: the parameters that the controller reckons with;
        `period` (s) of its calls.
        """
        self._gyro, self._accelerometer = gyro, sensors.accelerometer
        forward, turn, _ = vehicle_wheels(law.system, believed)
        self.options = slip_options(sensors, gyro, notice, mu, turn, period)
        self.notice = make_slip(backend, self.options, forward, turn, law)
        self._ahead = vehicle_wheels(law.system, sensing.parameters)[2]
        self._random = Noise(sensors.seed + GYRO_SEED, 2)
        self._pose, self._speed = sensing.reckoned.copy(), math.nan
        self.noticed = Noticed("ok", mu, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    def sense(self, moved: np.ndarray, dt: float, pose: np.ndarray) -> None:
        """Compare the angles `moved` (2,) with the true motion to `pose` during dt."""
        noise, before = self._random.draw(), self._pose
        yaw_rate = (pose[2] - before[2]) / dt + self._gyro.bias + self._gyro.noise * noise[0]
        speed, acceleration = self._mean_speed(before, pose, dt), None
        if self._accelerometer:
            gained = 0.0 if math.isnan(self._speed) else (speed - self._speed) / dt
            acceleration = gained + self._accelerometer.bias + self._accelerometer.noise * noise[1]
        self._pose, self._speed = pose.copy(), speed
        self.noticed = self.notice.step(moved, yaw_rate, acceleration, dt)

    def _mean_speed(self, before: np.ndarray, after: np.ndarray, dt: float) -> float:
        """Return the mean forward speed of the middle of the axle, m/s."""
        (s0, c0), (s1, c1), (s, c) = (
            sine_cosine(float(a)) for a in (before[2], after[2], (before[2] + after[2]) / 2)
        )
        x, y = after[:2] - before[:2] - self._ahead * np.array([c1 - c0, s1 - s0])
        return float((c * x + s * y) / dt)


def slip_options(
    sensors: Sensors, gyro: GyroSection, notice: NoticeSlipSection, mu: float, turn: np.ndarray, period: float
) -> SlipOptions:
    """Return the options of noticing slip: errors of the sensors as the SPEC has them. `turn` (2,) is that of
    the wheels."""
    accelerometer = sensors.accelerometer
    mean, sd = (np.broadcast_to(values, 2) for values in (sensors.noise.mean, sensors.noise.sd))
    count = 2 * math.pi / sensors.counts if sensors.counts else 0.0
    return SlipOptions(
        window=notice.window,
        count=(count, count),
        wheel_noise=float(wheel_noise(sd, sensors.period, period)),
        gyro_noise=gyro.noise,
        gyro_bias=float(gyro_bias(gyro.bias, turn, mean)),
        acceleration_noise=accelerometer.noise if accelerometer else 0.0,
        acceleration_bias=accelerometer.bias if accelerometer else 0.0,
        geometry=notice.geometry,
        deviations=notice.deviations,
        mu=mu,
        least=notice.least,
        lower=notice.lower,
        pause=notice.pause,
        rise=notice.rise,
        hold=notice.hold,
    )


def wheel_noise(sd: np.ndarray, sensor_period: Number, period: Number) -> Number:
    """Return the noise of the wheels' rates, of standard deviations (..., 2), as if it were new at each call:
    larger if it stays for several.
    """
    return np.max(sd, axis=-1) * np.sqrt(np.maximum(sensor_period / period, 1.0))


def gyro_bias(bias: Number, turn: np.ndarray, mean: np.ndarray) -> Number:
    """Return the constant error of a gyro with that of the wheels' rates, (..., 2):
    the same in the difference of the two."""
    return bias + np.abs(turn[..., 0] * mean[..., 0]) + np.abs(turn[..., 1] * mean[..., 1])


class Estimating(Sensing):
    """Sensors and the robot's extended Kalman filter, in C. `reckoned` is the estimated pose; sensed rates
    are multiplied by their estimated scales."""

    def __init__(
        self,
        sensors: Sensors,
        estimator: EstimatorSection,
        law: ControlLaw,
        parameters: np.ndarray,
        believed: np.ndarray,
        start: np.ndarray,
        simulation: Simulation,
    ):
        """Starts from the true pose; otherwise as Sensing. Raises BadInput if the robot has no filter of its
        wheels alone."""
        super().__init__(sensors, None, law, parameters, believed, start, simulation.backend)
        fixes = estimator.pose
        self._estimator, self._names = estimator, [q.name for q in law.system.quasi_velocities]
        from .controllers.estimation.ekf import Filter, FilterOptions  # slow to import

        options = FilterOptions(
            noise=np.array(one_for_each(estimator.noise, self._names, "[estimator] noise")),
            start=self.reckoned,
            start_sd=estimator.start_sd,
            gyro_noise=estimator.gyro_noise,
            bias_sd=estimator.bias_sd,
            bias_walk=estimator.bias_walk,
            scale_sd=estimator.scales,
            gate=estimator.gate,
            memory=math.ceil(fixes.delay / simulation.period) + 2 if fixes else 0,
        )
        self.filter = Filter(law.system, believed, options, SCALAR.get(simulation.backend, "double"))
        self._errors = Noise(sensors.seed + ERRORS, 4)  # of gyro and measured pose
        self._true_heading = float(self.reckoned[2])
        self._arriving: deque[tuple[float, np.ndarray]] = deque()  # time and value of poses on their way
        self._measured = 0.0

    def _rate_scales(self) -> np.ndarray:
        scales = dict(zip(self._estimator.scales, self.filter.state[4:], strict=True))
        return np.array([scales.get(name, 1.0) for name in self._names])

    def _pose_after(self, t: float, dt: float, moved: np.ndarray, x: np.ndarray) -> np.ndarray:
        *place, heading = self._true_pose(x)
        rate = (heading - self._true_heading) / dt
        self._true_heading = heading
        error = self._errors.draw()
        estimator, fixes = self._estimator, self._estimator.pose
        gyro = (
            rate + estimator.bias + estimator.gyro_noise / math.sqrt(dt) * error[0]
            if estimator.gyro_noise
            else None
        )
        if abs(self.filter.pose[2]) > UNWIND:
            self.filter.unwind()
        status = self.filter.tick(moved, dt, gyro)
        check_status(status, f"[estimator] the filter's tick at t = {t:g} s", fine=("ok", "diverged"))
        if fixes and (due := _count(t, 1 / fixes.rate)) > self._measured:
            self._measured = due
            self._arriving.append(
                (t, np.array([*place, heading]) + error[1:] * (fixes.sd, fixes.sd, fixes.heading_sd))
            )
        while fixes and self._arriving and t - self._arriving[0][0] >= fixes.delay - 1e-9:
            since, (x_m, y_m, heading_m) = self._arriving.popleft()
            sds = {"sd": fixes.sd, "heading_sd": fixes.heading_sd}
            heading_m = nearest_angle(heading_m, 0.0)
            status = self.filter.correct("pose", x=x_m, y=y_m, heading=heading_m, age=t - since, **sds)
            self.jumped = self.jumped or status == "ok"
            if self.slip and status == "ok":
                self.slip.notice.trust()
        return self.filter.pose


def _count(t: float, period: float) -> float:
    """How many periods have gone by; with none, every instant counts."""
    return math.floor(t / period + 1e-9) if period else t


def pose_coordinates(system: ReducedSystem) -> list[int]:
    """Which coordinates are x, y and heading of the vehicle's body. Raises BadInput if there are none."""
    point = point_on_body(system)
    if point is None:
        names = ", ".join(c.name for c in system.mechanism.coordinates)
        raise BadInput(
            f"[sensors]: dead reckoning needs a robot whose pose is three of its coordinates; {names}"
        )
    return list(point.pose)


def angle_coordinates(system: ReducedSystem) -> list[int]:
    """For each quasi-velocity the coordinate whose rate it is. Raises BadInput if one is that of none."""
    for velocity, places in zip(system.quasi_velocities, system.coordinates_by_velocity, strict=True):
        if not places:
            raise BadInput(
                f"[sensors]: dead reckoning needs {velocity.name} to be the rate of a coordinate, a wheel's "
                "angle"
            )
    return [places[0] for places in system.coordinates_by_velocity]
