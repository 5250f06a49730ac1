"""Guidance: what the controller follows, one path with a moving reference or the segments of a composite
path."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Protocol, TypeVar

import casadi as ca
import numpy as np

from ..model.algebra.direct import Direct
from ..model.algebra.portable import portable
from ..model.algebra.trigonometry import cosine, sine_cosine
from ..model.law import ControlLaw, symbols
from ..model.outputs import forward_speed
from ..model.paths import course
from ..model.reduction import ReducedSystem
from ..readers.errors import BadInput
from .controllers.angles import nearest_angle
from .controllers.controller import Controller
from .planning.course import SmoothCurve
from .planning.course_tracker import CourseGuide, CourseTracker
from .specification.spec import CourseSection

if TYPE_CHECKING:
    from .controllers.approach import Approach
    from .controllers.tracking import Guide, Tracker, TrackerOptions
    from .planning.profile import SpeedProfile


class Side:
    """Detects on which side of the singular set a state is: the sign of det Phi, positive at the start. A
    damped law has no such set to cross; what its inverse needs instead keeps its sign.

    A step across the singular set is detected by the change of sign.
    """

    def __init__(self, law: ControlLaw, parameters: np.ndarray, config: np.ndarray, start: np.ndarray):
        self._function = Direct(_determinant(law))
        self._fixed = (parameters, config)
        self._sign = np.sign(self._function(start, *self._fixed)[0][0])

    def __call__(self, x: np.ndarray) -> float:
        return self._sign * self._function(x, *self._fixed)[0][0]

    def at(self, config: np.ndarray) -> Side:
        """Return the same for another config."""
        other = copy(self)
        other._fixed = (self._fixed[0], config)
        return other

    def relative(self, x: np.ndarray) -> float:
        """Return |det Phi| divided by the product of Phi's row norms, between 0 and 1."""
        determinant, scale = (value[0] for value in self._function(x, *self._fixed))
        if not (np.isfinite(determinant) and np.isfinite(scale)):
            return float("nan")
        return float(abs(determinant) / scale) if scale else 0.0


@lru_cache(maxsize=16)
def _determinant(law: ControlLaw) -> ca.Function:
    found = law.linearization.damping or law.linearization
    return portable(law.at_state(found.determinant, ca.sqrt(found.scale_squared)))


@dataclass(frozen=True, eq=False)
class Leg:
    """A controller for one path, used until the next switch. `config` in the order of law.config."""

    config: np.ndarray
    controller: Controller
    side: Side


LegMaker = Callable[[np.ndarray, np.ndarray], Leg]  # from config, and the state at which the leg begins


class Guidance(Protocol):
    """Provides the reference for the controller. States are those that the controller sees."""

    @property
    def leg(self) -> Leg:
        """The controller in use."""

    def leg_at(self, x: np.ndarray) -> Leg:
        """Return the controller in use, told what it must know of the path at a state."""

    @property
    def piece(self) -> int:
        """Which piece of the path is followed, from 0."""

    @property
    def arrived(self) -> bool:
        """Whether the end of the path is reached."""

    def reference(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return the reference, in the order of law.reference; without side effects."""

    def left(self, t: float, x: np.ndarray) -> float:
        """Return a value that is positive until the current segment ends; without side effects,
        smooth in x."""

    def update(self, t: float, x: np.ndarray) -> None:
        """Switch to the next segment if the current one has ended."""


class ShortWay:
    """Prepares references of a law: a desired angle is shifted by whole turns to be nearest to the actual
    one."""

    def __init__(self, law: ControlLaw, parameters: np.ndarray, config: np.ndarray):
        names = [q.name for q in law.reference]
        rows = [(k, names.index(row.name)) for k, row in enumerate(law.output.rows) if row.unit == "rad"]
        self._rows, self._fixed = rows, (parameters, config)
        self._outputs = Direct(outputs(law))

    def outputs(self, state: np.ndarray) -> np.ndarray:
        """Return the outputs at a state."""
        return self._outputs(state, *self._fixed)[0]

    def __call__(self, state: np.ndarray, reference: np.ndarray) -> np.ndarray:
        """Return the reference for the controller, in the order of law.reference."""
        if not self._rows:
            return reference
        prepared, y = np.array(reference, float), self.outputs(state)
        for row, entry in self._rows:
            prepared[entry] = nearest_angle(prepared[entry], y[row])
        return prepared


class OnePath:
    """A single path, or none; the reference is `reference(t)`, with headings shifted to the nearest."""

    piece, arrived = 0, False

    def __init__(self, leg: Leg, reference: Callable[[float], np.ndarray], prepare: ShortWay):
        self.leg, self._desired, self._prepare = leg, reference, prepare

    def leg_at(self, x: np.ndarray) -> Leg:
        """Return the controller."""
        return self.leg

    def reference(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return the reference at t."""
        return self._prepare(x, self._desired(t))

    def left(self, t: float, x: np.ndarray) -> float:
        """Return infinity: the path does not end."""
        return np.inf

    def update(self, t: float, x: np.ndarray) -> None:
        """Do nothing: there is no other path."""


NO_NEAREST = "[initial]: the robot is as far from the course as the centre of its curvature; move it"


class OnCourse(OnePath):
    """A course on which the desired point is the one nearest to that of the robot, whatever the time; both
    move at the speed of the course.
    """

    def __init__(
        self,
        leg: Leg,
        reference: Callable[[float], np.ndarray],
        prepare: ShortWay,
        course: SmoothCurve,
        start: np.ndarray,
    ):
        """`course` as the desired point moves on it, `reference` by the time since its beginning; `start`:
        the state there. Raises BadInput if no point of the course is the nearest.
        """
        super().__init__(leg, reference, prepare)
        self._course, self._along = course, course.nearest(self._point(start))
        if math.isnan(self._along):
            raise BadInput(NO_NEAREST)

    def reference(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return the reference at the nearest point; NaN if there is none."""
        along = self._nearest(x)
        if math.isnan(along):
            return np.full(len(self.leg.controller.law.reference), math.nan)
        return super().reference(along / self._course.speed, x)

    def update(self, t: float, x: np.ndarray) -> None:
        """Search from the nearest point next time."""
        along = self._nearest(x)
        self._along = self._along if math.isnan(along) else along

    def _nearest(self, x: np.ndarray) -> float:
        return self._course.nearest(self._point(x), self._along)

    def _point(self, x: np.ndarray) -> complex:
        return complex(*self._prepare.outputs(x)[:2])


class AlongCourse(OnePath):
    """A course that a law of Type IV follows: the parameters of its path are those of the course's point
    nearest to P_l."""

    def __init__(
        self,
        law: ControlLaw,
        parameters: np.ndarray,
        config: np.ndarray,
        reference: Callable[[float], np.ndarray],
        tracker: CourseTracker,
        make_leg: LegMaker,
        start: np.ndarray,
    ):
        """`config` is that of the law besides the path, `start` the state that the controller sees at first.
        Raises BadInput if no point of the course is the nearest.
        """
        self._motion, self._parameters, self._tracker = (
            Direct(vehicle_motion(law.system)),
            parameters,
            tracker,
        )
        names, given = [c.name for c in law.config], [q.name for q in law.reference]
        first = names.index("x_s")
        self._entries = slice(first, first + sum(name in COURSE_PARAMETERS for name in names))
        self._L = names.index("L") if "L" in names else None
        speed = given.index("speed")
        # With its rate, where the law uses it
        self._speed = slice(speed, speed + (1 if law.kinematic else 2))
        self._config, self._unknown, self._make_leg = (
            np.array(config),
            np.full(len(given), math.nan),
            make_leg,
        )
        guide = tracker.update(*self._seen(start))
        if guide.status not in ("ok", "arrived"):
            raise BadInput(NO_NEAREST)
        config = self._at(guide)
        super().__init__(make_leg(config, start), reference, ShortWay(law, parameters, config))

    def leg_at(self, x: np.ndarray) -> Leg:
        """Return the controller, with the point of the course nearest to a state."""
        guide = self.guide(x)
        if guide.status in ("ok", "arrived"):
            config = self._at(guide)
            self.leg.controller.place(config)
            self.leg = Leg(config, self.leg.controller, self.leg.side.at(config))
        return self.leg

    def reference(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return the reference, at the tracker's speed; NaN if no point of the course is the nearest."""
        guide = self.guide(x)
        if guide.status not in ("ok", "arrived"):
            return self._unknown
        reference = self._desired(t).copy()
        reference[self._speed] = (guide.speed, guide.speed_rate)[: self._speed.stop - self._speed.start]
        return reference

    def guide(self, x: np.ndarray) -> CourseGuide:
        """Return where on the course the robot is."""
        return self._tracker.look(*self._seen(x))

    def left(self, t: float, x: np.ndarray) -> float:
        """Return the distance left to a stop, m, or m/s while waiting for a standstill."""
        guide = self.guide(x)
        return guide.left if guide.status == "ok" else math.inf

    def update(self, t: float, x: np.ndarray) -> None:
        """Search from the nearest point next time; where the robot stands at a cusp,
        go on to the next piece."""
        guide = self._tracker.update(*self._seen(x))
        if guide.status in ("ok", "arrived"):
            self.arrived = guide.arrived
            if guide.changed:
                self.piece = guide.piece
                self.leg = self._make_leg(self._at(guide), x)

    def _at(self, guide: CourseGuide) -> np.ndarray:
        """Return the config of the law for a point of the course."""
        config = self._config.copy()
        curvatures = self._entries.stop - self._entries.start - 3
        config[self._entries] = [guide.x, guide.y, guide.direction, *guide.curvature[:curvatures]]
        if self._L is not None:
            config[self._L] = guide.L
        return config

    def _seen(self, x: np.ndarray) -> np.ndarray:
        return self._motion(x, self._parameters)[0][:4]


COURSE_PARAMETERS = frozenset(q.name for q in course().parameters)


def smooth_curve(course: CourseSection, x: float = 0.0, y: float = 0.0) -> SmoothCurve:
    """Return the curve of a course that begins at (x, y), m."""
    return SmoothCurve(x, y, course.heading, course.speed, course.lengths, course.curvatures, course.rounding)


@dataclass(frozen=True)
class Led:
    """What one generator leads: an output of relative degree 2 and one of degree 1, by the numbers of their
    rows and of their entries in the reference, and of its rate among all rates; None if there is none.
    """

    position: tuple[int, int, int] | None  # row, entry, rate
    speed: tuple[int, int] | None  # row, entry


def led(law: ControlLaw) -> list[Led]:
    """Return what the generators of an approach lead: each output once."""
    names = [q.name for q in law.reference]
    degrees = law.linearization.relative_degree
    rows = [(k, names.index(row.name), degrees[k]) for k, row in enumerate(law.output.rows)]
    positions = [(k, entry, rate) for rate, (k, entry, _) in enumerate(row for row in rows if row[2] == 2)]
    speeds = [(k, entry) for k, entry, degree in rows if degree == 1]
    return [Led(*pair) for pair in itertools.zip_longest(positions, speeds)]


def led_units(law: ControlLaw) -> list[str]:
    """Return the unit of what each of `led` leads: m or rad."""
    return [law.output.rows[each.position[0]].unit if each.position else "m" for each in led(law)]


Number = TypeVar("Number", float, np.ndarray)


def accelerations(law: ControlLaw, acceleration: Number, angular: Number) -> list[Number]:
    """Return the largest acceleration of each of `led`, in the unit of its output per s^2: coordinates in m
    share `acceleration`, so that of a point is at most that.
    """
    units = led_units(law)
    return [acceleration / math.sqrt(units.count("m")) if unit == "m" else angular for unit in units]


class Approaching:
    """Leads outputs with bounded acceleration from where the robot is to what another guidance desires: from
    the start, from a cusp, where P_l changes sides, and from where the pose has jumped. The speed along a
    composite path is that of the path where it is slower.
    """

    def __init__(
        self,
        guidance: OnePath | Route,
        law: ControlLaw,
        parameters: np.ndarray,
        generators: Sequence[Approach],
        jumped: Callable[[], bool],
        start: np.ndarray,
    ):
        """`generators`: one for each of `led`; `jumped`: whether the pose did at the last update of the
        sensors; `start`: the state that the controller sees.
        """
        self.guidance, self._parameters, self._jumped = guidance, parameters, jumped
        self._led = list(zip(led(law), generators, strict=True))
        self._outputs, self._rows = Direct(approached_from(law)), len(law.output.rows)
        self._prepare = ShortWay(law, parameters, guidance.leg.config)
        self._L = [c.name for c in law.config].index("L") if isinstance(guidance, Route) else None
        self._begin(0.0, start)

    @property
    def leg(self) -> Leg:
        """See Guidance; of the other guidance."""
        return self.guidance.leg

    @property
    def piece(self) -> int:
        """See Guidance; of the other guidance."""
        return self.guidance.piece

    def leg_at(self, x: np.ndarray) -> Leg:
        """See Guidance; of the other guidance."""
        return self.guidance.leg_at(x)

    @property
    def arrived(self) -> bool:
        """See Guidance; of the other guidance."""
        return self.guidance.arrived

    @property
    def offsets(self) -> list[float]:
        """How far each output that is led is from what the other guidance desires, as led now."""
        return [float(desired[0]) for desired in self._desired]

    def reference(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return the reference: that of the other guidance,
        and what the generators added at the last call of the controller."""
        reference = np.array(self.guidance.reference(t, x))
        for (made, _), desired in zip(self._led, self._desired, strict=True):
            if made.position:
                reference[made.position[1] : made.position[1] + 3] += desired[:3]
            if made.speed:
                reference[made.speed[1] : made.speed[1] + 2] = desired[3:]
        return self._prepare(x, reference)

    def left(self, t: float, x: np.ndarray) -> float:
        """Return what is left of the other guidance's segment."""
        return self.guidance.left(t, x)

    def update(self, t: float, x: np.ndarray) -> None:
        """Advance the generators to t, or begin again."""
        before = self.leg.config
        self.guidance.update(t, x)
        if self._jumped() or (self._L is not None and self.leg.config[self._L] != before[self._L]):
            self._begin(t, x)
        else:
            self._step(t, x)

    def _begin(self, t: float, x: np.ndarray) -> None:
        base, (found,) = self.guidance.reference(t, x), self._outputs(x, self._parameters, self.leg.config)
        for made, generator in self._led:
            offset = rate = speed = 0.0
            if made.position:
                row, entry, k = made.position
                offset, rate = found[row] - base[entry], found[self._rows + k] - base[entry + 1]
            if made.speed:
                speed = found[made.speed[0]]
            generator.start(offset, rate, speed)
        self._t = t
        self._step(t, x)

    def _step(self, t: float, x: np.ndarray) -> None:
        base, self._desired = self.guidance.reference(t, x), []
        for made, generator in self._led:
            speed, speed_rate = base[made.speed[1] : made.speed[1] + 2] if made.speed else (0.0, 0.0)
            desired = generator.step(t - self._t, speed)
            self._desired.append(generator.within(speed, speed_rate) if self._L is not None else desired)
        self._t = t


LOST = {  # status of a tracker -> why the position on the path is undefined
    "singular": "P_l is at the centre of the path's first arc; move it",
    "range": "the heading is too large for sine and cosine; subtract whole turns",
    "nonfinite": "P_l is too far from the path; move it nearer",
}


class Route:
    """A composite path: the tracker selects the segment, and the law of a line or arc follows it."""

    def __init__(
        self,
        law: ControlLaw,
        parameters: np.ndarray,
        tracker: Tracker,
        make_leg: LegMaker,
        start: np.ndarray,
        profile_from: Callable[[float], SpeedProfile] | None = None,
        band: float = 0.0,
    ):
        """`parameters` are those of the controller, `band` that of a damped law. Starts with the first
        segment. The desired speed is that of the profile that `profile_from` returns, if given, for the
        progress of P_l (m) from which it rises: less than that at the start by the distance from the path,
        else the vehicle would turn more than it drives. Raises BadInput if the position on the segment is
        undefined.
        """
        self._law, self._tracker, self._make_leg = law, tracker, make_leg
        self._motion, self._parameters = Direct(vehicle_motion(law.system)), parameters
        speed = [q.name for q in law.reference].index("speed")
        # With its rate, where the law uses it
        self._speed = slice(speed, speed + (1 if law.kinematic else 2))
        self._zeros = np.zeros(len(law.reference))
        self.piece, self.arrived, self._band = 0, False, band
        first = tracker.look(*self._seen(start))
        if (reason := LOST.get(first.status)) is not None:
            raise BadInput(f"[initial]: {reason}")
        self.profile = profile_from(first.progress - abs(first.distance)) if profile_from else None
        self.update(0.0, start)

    def leg_at(self, x: np.ndarray) -> Leg:
        """Return the controller of the segment."""
        return self.leg

    @property
    def options(self) -> TrackerOptions:
        """Options of path following."""
        return self._tracker.options

    def reference(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return the reference: on the path, at the tracker's speed."""
        guide = self.guide(x)
        speed = guide.speed, guide.speed_rate
        reference = self._zeros.copy()
        desired = self.profile.speed(guide, self._seen(x)[3]) if self.profile else speed
        reference[self._speed] = desired[: len(reference[self._speed])]
        return reference

    def guide(self, x: np.ndarray) -> Guide:
        """Where on the path the robot is."""
        return self._tracker.look(*self._seen(x))

    def left(self, t: float, x: np.ndarray) -> float:
        """Return the distance left, m, or m/s while waiting for a standstill."""
        return np.inf if self.arrived else self.guide(x).left

    def update(self, t: float, x: np.ndarray) -> None:
        """Switch segments, and build the controller for the new one."""
        guide = self._tracker.update(*self._seen(x))
        self.arrived = bool(guide.arrived)
        if guide.changed:
            self.piece = guide.segment
            self.leg = self._make_leg(self._config(guide), x)

    def faces(self, x: np.ndarray) -> float:
        """Return the cosine of the angle between the vehicle's heading and its desired heading there."""
        guide, heading = self.guide(x), self._seen(x)[2]
        return cosine(
            float(heading - guide.heading - guide.curvature * guide.progress - np.pi * guide.backward)
        )

    def _config(self, guide: Guide) -> np.ndarray:
        given = {
            "L": guide.L,
            "W": self._tracker.options.W,
            "x_s": guide.x,
            "y_s": guide.y,
            "direction": guide.heading,
            "curvature": guide.curvature,
            "band": self._band,
        }
        return np.array([given[c.name] for c in self._law.config])

    def _seen(self, x: np.ndarray) -> np.ndarray:
        return self._motion(x, self._parameters)[0][:4]


@lru_cache(maxsize=16)
def vehicle_motion(system: ReducedSystem) -> ca.Function:
    """Return the function from state and parameters to x, y (m), heading (rad),
    forward speed (m/s) and yaw rate (rad/s)."""
    vehicle = system.mechanism.required_vehicle
    motion = ca.vertcat(
        vehicle.x, vehicle.y, vehicle.heading, forward_speed(system), system.along_motion(vehicle.heading)
    )
    return portable(ca.Function("motion", [symbols(system.state), system.mechanism.p], [ca.densify(motion)]))


@lru_cache(maxsize=16)
def approached_from(law: ControlLaw) -> ca.Function:
    """Return the function from state, parameters and config to all outputs,
    and the rates of those of relative degree 2."""
    found = law.linearization
    return portable(law.at_state(ca.vertcat(found.h, found.rate)))


@lru_cache(maxsize=16)
def point_followed(law: ControlLaw) -> ca.Function:
    """Return the function from state, parameters and config to x and y (m) of P_l, which follows a course."""
    foot, given = (
        law.output.foot,
        [symbols(group) for group in (law.system.state, law.parameters, law.config)],
    )
    assert foot is not None, "the law follows a course"
    return portable(ca.Function(law.name, given, [ca.densify(foot.place)]))


def distances(law: ControlLaw, x: np.ndarray, parameters: np.ndarray, config: np.ndarray) -> np.ndarray:
    """Return how far P_l is to the left of a course, m, for rows of states and of the config that has the
    nearest point."""
    names = [c.name for c in law.config]
    x_s, y_s, direction = (config[:, names.index(name)] for name in ("x_s", "y_s", "direction"))
    P_l = point_followed(law)(x.T, parameters, config.T).full()
    s, c = sine_cosine(direction)
    return c * (P_l[1] - y_s) - s * (P_l[0] - x_s)


@lru_cache(maxsize=16)
def outputs(law: ControlLaw) -> ca.Function:
    """Return the function from state, parameters and config to the outputs y = h (14)."""
    given = [symbols(group) for group in (law.system.state, law.parameters, law.config)]
    return portable(ca.Function(law.name, given, [ca.densify(law.linearization.h)]))
