"""Builds the loop of a controller and a robot from a SPEC."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial

import casadi as ca
import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import ArrayLike

from ..codegen.loop.stages import check
from ..model.algebra.direct import Direct
from ..model.algebra.trigonometry import sine_cosine
from ..model.contacts import GRAVITY, unknown_loads
from ..model.errors import ModelError
from ..model.law import ControlLaw
from ..model.linearization import SINGULAR
from ..model.mechanism import Mechanism, values_of
from ..model.names import EXTENDED, TYPES, without_damping
from ..model.outputs import PATH_GAIN, axle
from ..model.segments import Segment
from ..model.vehicle import velocity_map
from ..readers.errors import BadInput, check_named, check_status
from ..readers.reading import check_keys, one_for_each
from ..readers.robots import find_robot, law_of
from .contact import check_share, friction_accelerations
from .controllers.approach import Approach, make_approach
from .controllers.backends import SCALAR, make_controller
from .controllers.balance.steady import analyse_at_rest
from .controllers.balance.zero_dynamics import of_outputs
from .controllers.controller import RUNNING, Controller, Evaluation, Friction, Limits
from .controllers.estimation.disturbance import DisturbanceObservers
from .controllers.ground.slip import Noticed
from .controllers.integral import IntegralAction, hurwitz
from .controllers.odometry import vehicle_wheels
from .controllers.tracking import Tracker, TrackerOptions, make_tracker
from .controllers.velocity import VehicleLimits
from .drive import Drive, make_drive
from .feedback.guidance import desired_of, feedback_law, feedback_of, make_guidance, start_of
from .guidance import (
    COURSE_PARAMETERS,
    NO_NEAREST,
    AlongCourse,
    Approaching,
    Guidance,
    Leg,
    LegMaker,
    OnCourse,
    OnePath,
    Route,
    ShortWay,
    Side,
    accelerations,
    point_followed,
    smooth_curve,
)
from .planning.course import SmoothCurve
from .planning.course_tracker import CourseOptions, CourseTracker
from .planning.fits import misfit
from .planning.profile import Accelerations, make_profile
from .plant import Plant
from .sensing import Estimating, NoisyRates, Sensing, SlipSensing
from .specification.cases import gain_entries, integral_entries, observer_entries
from .specification.given import at_start, known_functions
from .specification.spec import (
    AdaptationSection,
    ApproachSection,
    CircleSection,
    ContactSection,
    CourseSection,
    Initial,
    LimitsSection,
    OscillationSection,
    PathSection,
    Simulation,
    Spec,
)
from .specification.units import check_units
from .starts import extension_starts, starts

# Of friction and motors that a speed profile uses by default; what is left is for staying on the path
PROFILE_PART = 0.6
DEVIATIONS = 6  # of the noise of a rate that count as its largest error
# Parts of friction that a kinematic law uses along its way and across it: together all of it
ALONG, LATERAL = 0.6, 0.8
ON_AXLE = 1e-9  # m: a point this near to the axle is on it
ACROSS = 0.7  # of the speed: at most as fast is a vehicle led across its path, so that it turns by 45 deg


class Learning:
    """Parameters of the controller that are learned at its calls; `believed` are those in use,
    which it changes in place."""

    def __init__(
        self, law: ControlLaw, believed: np.ndarray, section: AdaptationSection, simulation: Simulation
    ):
        """Raises BadInput for parameters that cannot be learned."""
        # slow to import, and needed by few runs
        from .controllers.estimation.adaptation import Adaptation, AdaptationOptions

        options = AdaptationOptions(**{field.name: getattr(section, field.name) for field in fields(section)})
        self.adaptation = Adaptation(law.system, believed, options, SCALAR.get(simulation.backend, "double"))
        self.believed, self._t = believed, 0.0
        self.applied: np.ndarray | None = None  # inputs since the last call, if they are known
        self.names = list(section.bounds)
        self._places = [[p.name for p in law.parameters].index(name) for name in self.names]

    @property
    def used(self) -> np.ndarray:
        """The learned parameters as they are in use, SI, in the order of `names`."""
        return self.believed[self._places]

    def step(self, t: float, seen: np.ndarray, controller: Controller) -> None:
        """Learn from the motion since the last call, by the inputs `applied` in between,
        and change the controller."""
        status, params = self.adaptation.step(seen, self.applied, t - self._t)
        check_status(status, f"[adaptation] at t = {t:g} s")
        self._t, self.believed[:] = t, params
        controller.adapt(params)


@dataclass(frozen=True, eq=False)
class Loop:
    """All parts of a run except time. `start` is the true state [q; nu] at t = 0, `extension` (k) the states
    of the law's dynamic extension then; `warnings` are for the user; `pushes` are times (s) and impulses
    (n-m) along the quasi-velocities, N s or N m s.

    `believed`, `gains` and `limits` are those of the controller. Without sensing, the controller sees the
    true state.
    """

    law: ControlLaw
    plant: Plant
    believed: np.ndarray
    gains: np.ndarray
    limits: Limits | None
    guidance: Guidance
    start: np.ndarray
    integral: IntegralAction
    observers: DisturbanceObservers
    sensing: NoisyRates | None
    drive: Drive
    extension: np.ndarray
    learning: Learning | None = None
    warnings: tuple[str, ...] = ()
    pushes: tuple[tuple[float, np.ndarray], ...] = ()

    @property
    def route(self) -> Route | None:
        """The composite path that is followed, if any."""
        found = self.guidance.guidance if isinstance(self.guidance, Approaching) else self.guidance
        return found if isinstance(found, Route) else None

    @property
    def composite(self) -> bool:
        """Whether a composite path is followed."""
        return self.route is not None

    def seen(self, x: np.ndarray) -> np.ndarray:
        """Return the state that the controller sees if the true one is x."""
        return self.sensing.state if self.sensing else x

    def sense(self, t: float, x: np.ndarray) -> None:
        """Update the sensors, and the parameters that are learned."""
        if self.sensing:
            self.sensing.sense(t, x)
        if self.learning:
            self.learning.step(t, self.seen(x), self.guidance.leg.controller)

    def call(self, t: float, x: np.ndarray, xi: np.ndarray) -> "ControllerCall":
        """Return what a call of the controller at time t in state x sees; `xi`:
        states of the dynamic extension, if any."""
        return ControllerCall(self, t, x, xi)

    def reference(self, t: float, seen: np.ndarray) -> np.ndarray:
        """Return the reference for a state that the controller sees;
        the speed along a path is less where slip was noticed."""
        reference = self.guidance.reference(t, seen)
        if self.noticed and self.noticed.slower < 1 and self.law.speed_row is not None:
            entry = [q.name for q in self.law.reference].index(self.law.output.rows[self.law.speed_row].name)
            reference = reference.copy()
            reference[entry : entry + 2] *= self.noticed.slower
        return reference

    @property
    def noticed(self) -> Noticed | None:
        """What was noticed of slip at the last call of the controller; None if that is not looked for."""
        return self.sensing.slip.noticed if self.sensing and self.sensing.slip else None

    @property
    def learned(self) -> np.ndarray:
        """The parameters in use that are learned; empty if there are none."""
        return self.learning.used if self.learning else np.zeros(0)

    @property
    def extension_rate(self) -> np.ndarray:
        """The rates of these states as the last command gave them."""
        return self.guidance.leg.controller.extension_rate if self.law.extension else np.zeros(0)

    def beyond(self, x: np.ndarray, xi: np.ndarray) -> bool:
        """Return whether the robot has crossed the singular set;
        only checked if the controller sees the true state."""
        return not self.sensing and self.side(x, xi) <= 0

    def side(self, x: np.ndarray, xi: np.ndarray) -> float:
        """Return on which side of the singular set a state is, see Side."""
        return self.guidance.leg_at(x).side(np.append(x, xi))


class ControllerCall:
    """A call of the controller: the state `seen`, the `reference` and the law's outputs there are found once.

    `add` is the value of integral action for each output that has it, `less` minus the estimate for each that
    has an observer.
    """

    def __init__(self, loop: Loop, t: float, x: np.ndarray, xi: np.ndarray):
        self._loop, self.seen = loop, loop.seen(x)
        self._leg = loop.guidance.leg_at(self.seen)
        self._known = np.append(self.seen, xi) if len(xi) else self.seen
        self.reference = loop.reference(t, self.seen)

    @cached_property
    def _outputs(self) -> Evaluation:
        return self._leg.controller.evaluate(self._known, self.reference)

    def error(self) -> np.ndarray:
        """Return y_d - y of the outputs with integral action."""
        rows = self._loop.integral
        return rows.error(self._outputs, self.reference) if rows.rows else np.zeros(0)

    def observed(self, add: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what the observers of disturbances compare: y^(r-1) and v without the estimates."""
        rows = self._loop.observers
        if not rows.rows:
            return np.zeros(0), np.zeros(0)
        return rows.seen(self._outputs, self._loop.integral.added(self.reference, add))

    @property
    def status(self) -> str:
        """The status of the law here; unlike a command, it is no step of the controller."""
        if np.isnan(self.reference).any():  # no point of the course is the nearest
            return "singular"
        status = self._outputs.status
        return "singular" if status in RUNNING and self._leg.side(self._known) <= 0 else status

    def command(self, add: np.ndarray, less: np.ndarray | None = None) -> tuple[str, np.ndarray]:
        """Return status and inputs (N, N m) of the controller; zeros on an error."""
        loop, controller, noticed = self._loop, self._leg.controller, self._loop.noticed
        if noticed:
            controller.believe(noticed.mu)
        reference = loop.integral.added(self.reference, add)
        status, tau = controller.step(
            self._known, reference if less is None else loop.observers.added(reference, less)
        )
        if status not in RUNNING and np.isnan(self.reference).any():  # no point of the course is the nearest
            return "singular", np.zeros(len(loop.law.inputs))
        if loop.learning:
            loop.learning.applied = tau if status in RUNNING else None
        if status in RUNNING and self._leg.side(self._known) <= 0:
            return "singular", np.zeros_like(tau)
        return noticed.status if noticed and noticed.status != "ok" and status in RUNNING else status, tau


def make_loop(spec: Spec) -> Loop:
    """Return the loop of a SPEC: controller, plant, guidance and start.

    Raises BadInput or ModelError if it cannot be simulated: unknown names, invalid parameters, a path that
    cannot be followed, a singular start.
    """
    mechanism = find_robot(spec.robot)
    if spec.feedback:
        return _feedback_loop(mechanism, spec)
    law = _law(mechanism, spec)
    check(spec, law=law)
    _check_axle(law, spec)
    names = [p.name for p in law.parameters]
    for where in ("parameters", "plant"):
        check_keys(getattr(spec, where), names, where)
    check_units(spec, law)
    believed = np.array(mechanism.parameter_values(spec.parameters))
    given = known_functions(mechanism, spec.given, spec.simulation.duration)
    plant = Plant(law.system, mechanism.parameter_values({**spec.parameters, **spec.plant}, "plant"), given)
    if spec.contact:
        check_share(spec.contact, plant)
    used = believed.copy()
    gains = values_of(list(law.gains), gain_entries(law, spec.gains, "gains"), "gains")
    limits, integral = _limits(spec, law, believed), _integral(spec, law, gains)
    observers = _observers(spec, law, gains)

    controller: Controller | None = None

    def make_leg(config: np.ndarray, x: np.ndarray) -> Leg:
        nonlocal controller
        known = limits
        if controller and limits and limits.friction and limits.friction.period:
            known = replace(limits, friction=replace(limits.friction, known=controller.believed))
        controller = make_controller(spec.simulation.backend, law, used, config, gains, known)
        return Leg(
            config, controller, Side(law, believed, config, np.append(x, np.zeros(len(law.extension))))
        )

    warnings: tuple[str, ...] = ()
    guidance: OnePath | Route | Approaching
    if (path := spec.output.path) and path.segments:
        limits_along = _accelerations(law, spec, believed)
        tracker = _tracker(law, spec, path, believed, limits_along)
        L = tracker.options.L[path.segments[0].backward]
        start = _start(initial_of(spec, tracker.options), plant, L, spec.output.W)
        profile_from = (
            partial(make_profile, spec.simulation.backend, path.segments, tracker.options, limits_along, law)
            if limits_along
            else None
        )
        guidance = route = Route(law, believed, tracker, make_leg, start, profile_from, spec.output.band)
        warnings = () if limits_along else _too_fast(spec, plant, path.segments, tracker.options, limits)
        if route.faces(start) < 0:
            warnings = (
                *warnings,
                "[initial] faces against the direction of travel: the path is followed away from its end",
            )
    else:
        spec, warnings = _facing(spec, law, believed)
        course, L = spec.reference.course, spec.output.L
        if spec.output.along_course and course and course.cusps and spec.desired_speed < 0.0:
            L = sides(law, spec)[1]
        start = _start(spec.initial or Initial(), plant, L, spec.output.W)
        guidance = _one_path(law, spec, believed, gains, make_leg, start)
        warnings = (*warnings, *_unstable(law, believed, guidance.leg.config))
    sensing: Sensing | None = None
    if spec.sensors:
        seen = (plant.parameters, believed, start)
        if spec.estimator:
            sensing = Estimating(spec.sensors, spec.estimator, law, *seen, spec.simulation)
        else:
            sensing = Sensing(spec.sensors, spec.correction, law, *seen, spec.simulation.backend)
        notice, gyro = spec.limits and spec.limits.notice_slip, spec.sensors.gyro
        if notice and gyro and spec.contact:
            known = (law, believed, spec.simulation.backend, spec.simulation.period)
            sensing.slip = SlipSensing(sensing, spec.sensors, gyro, notice, spec.contact.mu, *known)
    if spec.reference.approach:
        generators = _generators(law, spec, spec.reference.approach)
        guidance = Approaching(
            guidance, law, believed, generators, lambda: sensing is not None and sensing.jumped, start
        )
        warnings = (*warnings, *_turning_across(guidance, spec, spec.reference.approach))
    grips = spec.limits if spec.kinematic else None
    vehicle = _vehicle_limits(grips, spec.contact, law, believed) if grips and spec.contact else None
    drive = make_drive(spec.drive, spec.simulation, plant, law, believed, vehicle)
    extension = _extension(law, spec, believed, guidance, start)
    memory = (integral, observers, sensing, drive, extension)
    pushes = _pushes(spec, plant)
    loop = Loop(
        law, plant, believed, np.array(gains), limits, guidance, start, *memory, None, warnings, pushes
    )
    _check_start(loop)
    if spec.adaptation:
        loop = replace(loop, learning=Learning(law, used, spec.adaptation, spec.simulation))
    return loop


def _feedback_loop(mechanism: Mechanism, spec: Spec) -> Loop:
    """Return the loop of a SPEC with [feedback]."""
    for where in ("parameters", "plant"):
        check_keys(getattr(spec, where), [p.name for p in mechanism.parameters], where)
    believed = mechanism.parameter_values(spec.parameters)
    balanced = feedback_of(mechanism, spec, believed)
    law = feedback_law(balanced)
    check_units(spec, law)
    plant = Plant(law.system, mechanism.parameter_values({**spec.parameters, **spec.plant}, "plant"))
    desired = desired_of(balanced, spec)
    start = start_of(spec, balanced, desired)
    if start is None:
        start = _start(spec.initial or Initial(), plant, 0.0, 0.0)
    sensing = NoisyRates(spec.sensors, law.system, start) if spec.sensors else None
    parts = (
        IntegralAction(law, [], {}),
        DisturbanceObservers(law, [], {}),
        sensing,
        make_drive(None, spec.simulation, plant, law, np.array(believed)),
    )
    guidance = make_guidance(law, balanced, spec, desired)
    pushes = _pushes(spec, plant)
    loop = Loop(
        law, plant, np.array(believed), np.zeros(0), None, guidance, start, *parts, np.zeros(0), pushes=pushes
    )
    status, _ = loop.call(0.0, loop.start, loop.extension).command(np.zeros(0))
    if status == "astray":
        raise BadInput(
            "[initial]: the robot has fallen at the start: a coordinate is more than 1.57 (m or rad) off; "
            "move it"
        )
    _check_start(loop)
    return loop


def _unstable(law: ControlLaw, believed: np.ndarray, config: np.ndarray) -> tuple[str, ...]:
    """Return a warning if a mode of the zero dynamics of an underactuated robot at rest grows:
    no gain changes that."""
    if not law.system.underactuated:
        return ()
    try:
        found = of_outputs(
            analyse_at_rest(law.system.mechanism, None, believed.tolist()), law.linearization, config.tolist()
        )
    except ModelError:  # it does not rest at q = 0
        return ()
    return (f"zero dynamics of {law.name} at rest: {found}",) if found.unstable else ()


def _pushes(spec: Spec, plant: Plant) -> tuple[tuple[float, np.ndarray], ...]:
    """Return times and impulses of the pushes of a SPEC. Raises BadInput for an unknown quasi-velocity."""
    names = [q.name for q in plant.system.quasi_velocities]
    for k, push in enumerate(spec.push):
        check_named(push.on, names, f"push[{k}] on: unknown quasi-velocity")
    return tuple((push.time, push.impulse * np.eye(len(names))[names.index(push.on)]) for push in spec.push)


def _law(mechanism: Mechanism, spec: Spec) -> ControlLaw:
    """Return the law of the SPEC. Raises BadInput if the type is neither one of the paper's nor an output of
    the robot."""
    check_named(
        spec.output.type,
        [*TYPES, *(output.name for output in mechanism.outputs)],
        "[output] type: unknown output",
    )
    return law_of(mechanism, spec.law)


def _check_axle(law: ControlLaw, spec: Spec) -> None:
    """Raise BadInput if P_l of a law with a dynamic extension is not on the axle, where that law has it."""
    if spec.output.own or not (law.output.extension or spec.output.arclength):
        return
    ahead, given = axle_at(law, spec.parameters), "extension" if law.output.extension else "arclength"
    if abs(spec.output.L - ahead) > ON_AXLE:
        raise BadInput(
            f"[output] {given} = true is for a P_l on the axle, L = {ahead:g} m; L is {spec.output.L:g}: "
            f"change it, or omit {given}; for another point that needs one, define an output of the robot's "
            "own"
        )


def axle_at(law: ControlLaw, parameters: Mapping[str, float]) -> float:
    """Return how far the axle is ahead of the vehicle's point, m;
    `parameters` that differ from their defaults by name."""
    mechanism = law.system.mechanism
    return float(
        ca.Function("ahead", [mechanism.p], [axle(law.system)])(mechanism.parameter_values(parameters))
    )


def _limits(spec: Spec, law: ControlLaw, believed: np.ndarray) -> Limits | None:
    """Return the limits; a single limit applies to all inputs. None for a kinematic law,
    whose commands its drives limit."""
    inputs = len(law.system.mechanism.inputs)
    if spec.limits is None or spec.kinematic:
        return None
    torque, friction = (0.0,) if spec.limits.torque is None else spec.limits.torque, None
    if spec.limits.mode == "grip" and (floor := spec.contact):
        height = floor.height or Plant(law.system, believed.tolist()).height
        friction = replace(
            earning(spec), mu=floor.mu, margin=spec.limits.margin, share=floor.share, height=height
        )
    return Limits(torque * inputs if len(torque) == 1 else torque, spec.limits.mode, friction)


def earning(spec: Spec) -> Friction:
    """Return how friction is earned, all else 0: not with drives that take velocities,
    where torques do not turn wheels."""
    limits, simulation, sensors = spec.limits, spec.simulation, spec.sensors
    period = simulation.period
    if (
        limits is None
        or limits.friction != "earned"
        or not period
        or (spec.drive and spec.drive.takes_velocity)
    ):
        return Friction(0.0)
    counts, noise = (sensors.counts, max(sensors.noise.sd)) if sensors else (0, 0.0)
    coarse, lag = (float(value) for value in roughness(period, simulation.delay, counts, noise))
    return Friction(0.0, period=period, known=limits.known or 0.0, error=limits.error, coarse=coarse, lag=lag)


def roughness(period: ArrayLike, delay: ArrayLike, counts: ArrayLike, noise: ArrayLike) -> np.ndarray:
    """Return the largest errors (rad/s) of rates that encoders of `counts` a turn (0: exact ones) and a
    standard deviation `noise` make, and the lag (s) of their answer: a rate by counts is the mean of a
    period.
    """
    period, delay, counts, noise = np.broadcast_arrays(period, delay, counts, noise)
    coarse = np.divide(2 * np.pi, counts * period, out=np.zeros(counts.shape), where=counts > 0)
    return np.array([coarse + DEVIATIONS * noise, delay + np.where(counts > 0, period / 2, 0.0)])


def _vehicle_limits(
    limits: LimitsSection, contact: ContactSection, law: ControlLaw, believed: np.ndarray
) -> VehicleLimits:
    """Return the accelerations that use all of friction together, with its margin: the vehicle as one body.
    Raises BadInput as `vehicle_wheels` does.
    """
    forward, turn, _ = vehicle_wheels(law.system, believed)
    part = contact.share * Plant(law.system, believed.tolist()).part
    most = contact.mu * (1 - limits.margin) * part * GRAVITY
    return VehicleLimits(tuple(forward), tuple(turn), ALONG * most, LATERAL * most)


def _integral(spec: Spec, law: ControlLaw, gains: list[float]) -> IntegralAction:
    ki = integral_entries(law, spec.gains)
    return IntegralAction(law, gains, ki, *([spec.limits.integral] if spec.limits else []))


def _observers(spec: Spec, law: ControlLaw, gains: list[float]) -> DisturbanceObservers:
    ko = observer_entries(law, spec.gains)
    return DisturbanceObservers(law, gains, ko, spec.limits.disturbance if spec.limits else (0.0,))


def _turning_across(guidance: Approaching, spec: Spec, approach: ApproachSection) -> tuple[str, ...]:
    """Return a warning if an approach leads the vehicle across its path faster than it drives: it turns
    until it is normal to the path, where type IV is singular.

    From the distance e at rest the distance changes by up to sqrt(a |e|), with the acceleration a half the
    way there, and with -a the other half.
    """
    speed, distance = abs(spec.desired_speed or 0.0), abs(guidance.offsets[0])
    if spec.output.type != "IV" or not 0 < speed < math.sqrt(approach.acceleration * distance):
        return ()
    most = (ACROSS * speed) ** 2 / distance
    return (
        f"[reference] approach: from {distance:.3g} m beside the path, {approach.acceleration:g} m/s^2 leads "
        f"the vehicle across it faster than its speed of {speed:g} m/s: it may turn normal to the path, "
        f"where type IV is singular; give acceleration = {most:.2g}, or a higher speed",
    )


def _generators(law: ControlLaw, spec: Spec, approach: ApproachSection) -> list[Approach]:
    """Return the generators of an approach, one for each of `led`."""
    found = accelerations(law, approach.acceleration, approach.angular or 0.0)
    jerks = [each * (approach.jerk / approach.acceleration) for each in found]
    backend, period = spec.simulation.backend, spec.simulation.period
    return [make_approach(backend, each, period, law, jerk) for each, jerk in zip(found, jerks, strict=True)]


def _accelerations(law: ControlLaw, spec: Spec, believed: np.ndarray) -> Accelerations | None:
    """Return the largest accelerations along a composite path, if its speed follows a profile: those given,
    the others of friction.
    """
    if not spec.reference.profiled:
        return None
    names = [each.name for each in fields(Accelerations)]
    given = {name: value for name in names if (value := getattr(spec.reference, name))}
    if spec.reference.incomplete and spec.contact:
        limits = _limits(spec, law, believed)
        known = friction_accelerations(
            Plant(law.system, list(believed)), spec.contact, PROFILE_PART, limits.torque if limits else ()
        )
        given = {name: given.get(name, getattr(known, name)) for name in names}
    return Accelerations(**given)


def _too_fast(
    spec: Spec, plant: Plant, segments: Sequence[Segment], options: TrackerOptions, limits: Limits | None
) -> tuple[str, ...]:
    """Return a warning if the speed on lines and arcs does not fit bends and joins,
    by all of friction and motors."""
    contact, torque = spec.contact, limits.torque if limits else ()
    if contact is None or options.speed == 0 or unknown_loads(plant.system.mechanism):
        return ()
    # The accelerations of a steered vehicle are not known from its wheels
    if velocity_map(plant.system) is None:
        return ()
    part = 1 - spec.limits.margin if spec.limits and spec.limits.mode == "grip" else 1.0
    found = misfit(segments, options, friction_accelerations(plant, contact, part, torque))
    if found is None:
        return ()
    speed, where = found
    return (
        f"[reference] speed = {options.speed:g} m/s does not fit the friction of [contact] mu = "
        f"{contact.mu:g}: "
        f'at most {math.floor(100 * speed) / 100:g} m/s fits {where}; give that, or speed = "fastest"',
    )


def _tracker(
    law: ControlLaw, spec: Spec, path: PathSection, believed: np.ndarray, limits: Accelerations | None
) -> Tracker:
    """Return the tracker of a composite path. Raises BadInput for a path that cannot be followed."""
    reference, output = spec.reference, spec.output
    speed, deceleration = reference.speed or 0.0, reference.deceleration or 0.0
    if limits:
        speed, deceleration = min(speed, limits.top_speed(path.segments)), limits.deceleration
    options = TrackerOptions(
        speed=speed,
        deceleration=deceleration,
        creep=reference.creep or 0.0,
        L=sides(law, spec),
        W=output.W,
        ahead=0.0 - axle_at(law, spec.parameters),
        reversing="switch" if output.reversing == "switch" else "refuse",
        stop=path.stop,
        closed=path.closed,
    )
    return make_tracker(spec.simulation.backend, path.segments, options, law)


def _facing(spec: Spec, law: ControlLaw, believed: np.ndarray) -> tuple[Spec, tuple[str, ...]]:
    """Return the SPEC with P_l on the side of the axle that the speed requires, if configured;
    else a warning."""
    output, speed, course = spec.output, spec.desired_speed, spec.reference.course
    if output.type != "IV" or not speed or (output.along_course and course and course.cusps):
        return spec, ()
    try:
        ahead = vehicle_wheels(law.system, believed)[2]
    except BadInput:  # another kind of robot: cannot be checked
        return spec, ()
    if speed * (output.L + ahead) >= 0:
        return spec, ()
    what = (
        f"speed {speed:g} m/s and L + d = {output.L + ahead:g} m have opposite signs: the heading "
        "diverges from the path"
    )
    advice = '[output] L on the other side of the axle or reversing = "switch"'
    if output.reversing == "refuse":
        raise BadInput(f"[output] {what}; set {advice}")
    if output.reversing == "allow":
        return spec, (f"{what}; {advice} avoids that",)
    L = -output.L - 2 * ahead if output.L_backward is None else output.L_backward
    if speed * (L + ahead) <= 0:
        raise BadInput(
            f"[output] L_backward = {L:g} is on the same side of the axle as L; set it to less than "
            f"{-ahead:g}"
        )
    return replace(spec, output=replace(output, L=L)), ()


def _config(law: ControlLaw, spec: Spec) -> np.ndarray:
    if spec.output.own:
        return np.array(values_of(list(law.config), spec.output.parameters, "[output] parameters"))
    given = {"L": spec.output.L, "band": spec.output.band, **({"W": spec.output.W} if spec.output.W else {})}
    given = {name: value for name, value in given.items() if name in [c.name for c in law.config]}
    if path := spec.output.path:
        along = [c.name for c in law.config if c.name.startswith(PATH_GAIN)]
        own = ("L", "W", "band", *(COURSE_PARAMETERS if law.output.foot else ()), *along)
        names = [c.name for c in law.config if c.name not in own]
        check_keys(path.parameters, names, "[output] path")
        missing = [name for name in names if name not in path.parameters]
        if missing:
            raise BadInput(f"[output] path {missing[0]} is missing; a {path.kind} has {', '.join(names)}")
        given |= path.parameters
        if (poles := spec.output.poles) is not None:
            one_for_each(poles, along, "[output] poles", of_all=False)
            given |= dict(zip(along, polynomial.polyfromroots(poles)[:-1].tolist(), strict=True))
    return np.array(values_of(list(law.config), given, "[output]"))


def _reference(law: ControlLaw, spec: Spec) -> Callable[[float], np.ndarray]:
    """Return the function from t to the reference, in the order of law.reference."""
    rows, degrees = [row.name for row in law.output.rows], law.linearization.relative_degree
    position, velocity = spec.reference.position or (), spec.reference.velocity
    if spec.output.type == "IV":
        position = (0.0, spec.desired_speed)
    if velocity is None:
        velocity = (0.0,) * len(rows)
    for name, given in (("position", position), ("velocity", velocity)):
        one_for_each(given, rows, f"[reference] {name}", of_all=False)
    offset, slope = [], []
    for degree, start, rate in zip(degrees, position, velocity, strict=True):
        offset += [start, rate, *[0.0] * (degree - 1)][: degree + 1]
        slope += [rate, *[0.0] * degree]
    begin, rates = np.array(offset), np.array(slope)
    if oscillation := spec.reference.oscillation:
        swung = _oscillating(oscillation, law)
        return lambda t: begin + rates * t + swung(t)
    along = spec.reference.circle or spec.reference.course
    if along is None or law.output.foot:
        return lambda t: begin + rates * t
    moved, (first, second) = _moved_point(along, max(degrees[:2])), degrees[:2]

    def at(t: float) -> np.ndarray:
        point, made = moved(t), begin + rates * t
        made[: first + second + 2] += [*point.real[: first + 1], *point.imag[: second + 1]]
        return made

    return at


def _oscillating(oscillation: OscillationSection, law: ControlLaw) -> Callable[[float], np.ndarray]:
    """Return the function from t to what an oscillation adds to the reference. Raises BadInput for wrong
    numbers of entries."""
    rows, degrees = law.output.rows, law.linearization.relative_degree
    angles = (0.0,) * len(rows) if oscillation.angle is None else oscillation.angle
    for name, given in (("amplitude", oscillation.amplitude), ("angle", angles)):
        one_for_each(given, [row.name for row in rows], f"[reference] oscillation {name}", of_all=False)

    def at(t: float) -> np.ndarray:
        parts = []
        for amplitude, angle, degree in zip(oscillation.amplitude, angles, degrees, strict=True):
            s, c = sine_cosine(angle + oscillation.rate * t)
            quarters, orders = np.array([s, c, -s, -c]), np.arange(degree + 1)
            parts.append(amplitude * oscillation.rate**orders * quarters[orders % 4])
        return np.concatenate(parts)

    return at


def _one_path(
    law: ControlLaw,
    spec: Spec,
    believed: np.ndarray,
    gains: Sequence[float],
    make_leg: LegMaker,
    start: np.ndarray,
) -> OnePath:
    """Return the guidance of a path that is not a composite one, or of none."""
    config, reference, course = _config(law, spec), _reference(law, spec), spec.reference.course
    if course is None or (law.output.foot is None and course.follow == "time"):
        leg = make_leg(config, start)
        return OnePath(leg, reference, ShortWay(law, believed, leg.config))
    curve = smooth_curve(course, *(spec.reference.position or ())[:2])
    if law.output.foot:
        return AlongCourse(
            law,
            believed,
            config,
            reference,
            _on_course(law, spec, curve, believed, config, start),
            make_leg,
            start,
        )
    _check_along(law, gains)
    leg = make_leg(config, start)
    return OnCourse(leg, reference, ShortWay(law, believed, leg.config), curve, start)


def _on_course(
    law: ControlLaw,
    spec: Spec,
    curve: SmoothCurve,
    believed: np.ndarray,
    config: np.ndarray,
    start: np.ndarray,
) -> CourseTracker:
    """Return the tracker of a course. Raises BadInput for a course that cannot be followed, or if none of its
    points is the nearest.
    """
    reference, output, stop = (
        spec.reference,
        spec.output,
        spec.output.path.stop if spec.output.path else "point",
    )
    place = curve.pieces[0].nearest(complex(*Direct(point_followed(law))(start, believed, config)[0]))
    if np.isnan(place):
        raise BadInput(NO_NEAREST)
    axle_matters = curve.cusps or stop == "axle" or output.reversing != "allow"
    options = CourseOptions(
        speed=curve.speed if reference.speed is None else reference.speed,
        deceleration=reference.deceleration or 0.0,
        creep=reference.creep or 0.0,
        start=place,
        L=sides(law, spec) if curve.cusps else (output.L, output.L),
        W=output.W,
        ahead=0.0 - axle_at(law, spec.parameters) if axle_matters else 0.0,
        reversing=output.reversing,
        stop=stop,
        endless=not reference.stops,
    )
    return CourseTracker(curve, options, SCALAR.get(spec.simulation.backend, "double"))


def sides(law: ControlLaw, spec: Spec) -> tuple[float, float]:
    """Return L (m) driving forward, and in reverse: as given, else as far behind the axle."""
    mirrored = 2 * axle_at(law, spec.parameters) - spec.output.L
    return spec.output.L, mirrored if spec.output.L_backward is None else spec.output.L_backward


def _check_along(law: ControlLaw, gains: Sequence[float]) -> None:
    """Raise BadInput unless a course can be followed from wherever the robot is: along it the errors of the
    place, and with them kp, are missing, so that the speed's error obeys s^(k-1) + ... + kd.
    """
    given = iter(gains)
    for row, degree in zip(law.output.rows[:2], law.linearization.relative_degree, strict=False):
        own = [next(given) for _ in range(degree)]
        if not hurwitz([1.0, *own[:0:-1]]):
            raise BadInput(
                f'[reference] course: with follow = "path" the gains of {row.name} other than kp must place '
                "poles of their own; "
                "change them"
            )


def _moved_point(along: CircleSection | CourseSection, order: int) -> Callable[[float], np.ndarray]:
    """Return the function from t to how far a point has moved on a circle or a course, x + i y, and its
    derivatives up to `order`.
    """
    if isinstance(along, CourseSection):
        curve = smooth_curve(along)
        return lambda t: curve.derivatives(t, order)
    sizes, quarters = np.cumprod([along.radius, *[along.rate] * order]), np.arange(order + 1) % 4

    def at(t: float) -> np.ndarray:
        s, c = sine_cosine(along.angle + along.rate * t)
        return sizes * np.array([complex(c, s), complex(-s, c), complex(-c, -s), complex(s, -c)])[quarters]

    return at


def initial_of(spec: Spec, options: TrackerOptions) -> Initial:
    """Return the initial state as given; else at rest at the start of the composite path, with the stopping
    point at its start.
    """
    if spec.initial is not None:
        return spec.initial
    first = spec.output.segments[0]
    heading = first.heading + (np.pi if first.backward else 0.0)
    lookahead = options.L[first.backward] + options.ahead if options.stop == "axle" else 0.0
    s, c = sine_cosine(heading)
    ahead, left = np.array([c, s]), np.array([-s, c])
    place = np.array([first.x, first.y]) + lookahead * ahead + (options.W * left if lookahead else 0.0)
    return Initial(point=tuple(place), heading=float(heading), speed=0.0)


def _start(initial: Initial, plant: Plant, L: float, W: float) -> np.ndarray:
    """Return [q; nu] at t = 0: as given, or computed from P_l, heading and forward speed;
    known functions have their values."""
    system = plant.system
    n, dof, known = len(system.mechanism.coordinates), system.dof, at_start(system.mechanism, plant.given)
    if initial.q is not None:
        nu = (0.0,) * dof if initial.nu is None else initial.nu
        for key, given, needed in (("q", initial.q, system.state[:n]), ("nu", nu, system.state[n:])):
            one_for_each(given, [q.name for q in needed], f"[initial] {key}", of_all=False)
        for k, value in known.items():
            if initial.q[k] not in (0.0, value):
                name = system.mechanism.coordinates[k].name
                raise BadInput(
                    f"[initial] q: {name} is {initial.q[k]:g}, but {value:g} by [given]: write 0 or that"
                )
        return np.array([*(known.get(k, value) for k, value in enumerate(initial.q)), *nu])
    pose, speed = (
        np.array([[*(initial.point or ()), initial.heading or 0.0]]),
        np.array([initial.speed or 0.0]),
    )
    begin = np.array([[known.get(k, 0.0) for k in range(n)]])
    (found,) = starts(system, plant.parameters[None], (np.array([L]), np.array([W])), pose, speed, begin)
    for part, where in ((found[:n], "point and heading"), (found[n:], "speed")):
        if np.isnan(part).any():
            raise BadInput(f"[initial] {where}: the robot cannot reach this state; give q and nu instead")
    return found


def _extension(
    law: ControlLaw, spec: Spec, believed: np.ndarray, guidance: Guidance, start: np.ndarray
) -> np.ndarray:
    """Return the states of the dynamic extension at t = 0: as given, else as the reference desires;
    empty without one."""
    given = spec.initial.extension if spec.initial else None
    if given is not None:
        states = [f"{q.name} ({q.unit})" for q in law.extension]
        return np.array(one_for_each(given, states, "[initial] extension", of_all=False))
    desired = guidance.reference(0.0, start)
    return extension_starts(law, believed[None], guidance.leg.config[None], start[None], desired[None])[0]


def _check_start(loop: Loop) -> None:
    """Raise BadInput with the reason if the law has an error at the start."""
    status = loop.call(0.0, loop.start, loop.extension).status
    if status in RUNNING:
        return
    check_status(status, "[initial]: the controller, at the start,", fine=["singular"])
    size = loop.guidance.leg.side.relative(np.append(loop.start, loop.extension))
    raise BadInput(
        f"[initial]: Phi is singular at the start: |det Phi| = {size:.1e} of its row norms; "
        f"{_why_singular(loop)}"
    )


def _can_extend(loop: Loop) -> bool:
    """Return whether the law has a dynamic extension."""
    try:
        law_of(loop.law.system, without_damping(loop.law.name) + EXTENDED)
    except (BadInput, ModelError):
        return False
    return True


def _why_singular(loop: Loop) -> str:
    """Return what to change: the output, if it is singular at other states too, else the start."""
    start = np.append(loop.start, loop.extension)
    if np.isnan(loop.guidance.leg.side.relative(start)):
        return (
            "an output has no derivative there (such as at the centre of a circle), or a number is too "
            "large: change either"
        )
    random = np.random.default_rng(1992)
    others = start + random.uniform(-1.0, 1.0, (8, len(start)))
    if max(loop.guidance.leg.side.relative(x) for x in others) <= SINGULAR:
        extended = (
            ", or set [output] extension = true, which puts an integrator on an input"
            if _can_extend(loop)
            else ""
        )
        return (
            "it is singular at every state, because P_l is on the axle (L = -d): change L ([output] L, "
            f"or --L){extended}"
        )
    if loop.law.extension:
        return (
            "with a dynamic extension it is where the point that is tracked stands still: start with a "
            "speed, [initial] speed"
        )
    if loop.law.output.path:
        return (
            "the heading is normal to the path: change it, move the point, or set [output] near_singular "
            '= "damped"'
        )
    if loop.law.system.underactuated:
        return "inertia does not couple the outputs to the inputs there: change [initial]"
    return "the inputs do not affect the outputs independently there: change the heading"
