"""SPEC.toml of `noslip simulate`: read and checked into frozen dataclasses.

Each section is a dataclass, and each entry has a reader for its value. Unknown keys are errors.
"""

import dataclasses
import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...codegen.loop.stages import check
from ...model.names import EXTENDED, INTEGRAL, KINEMATIC, OBSERVER, TYPES, LawName
from ...model.outputs import BAND
from ...model.paths import PATHS
from ...model.segments import Segment
from ...readers.errors import BadInput, naming
from ...readers.files import file_or_shipped, read_input
from ...readers.reading import (
    DEFINITIONS,
    DRAFT,
    Reader,
    Schema,
    Section,
    angle,
    ascending,
    check_keys,
    each_of,
    entry,
    flag,
    list_of,
    named_numbers,
    number,
    numbers,
    numbers_of,
    one_of,
    one_or_each,
    one_or_more,
    point,
    pose,
    reads,
    row,
    section,
    table,
    table_of,
    text,
    whole,
)
from ...readers.robots import beside, near
from ..controllers import DRIVES
from .feedback import Command, FeedbackSection, Push
from .floor import Floor
from .given import functions_of_time
from .scene import SceneSection

if TYPE_CHECKING:
    from .distributions import Sweep


MOST_ROWS = 10_000_000
DEEPEST = 16  # nesting of tables and lists
# a key that would take minutes to parse
MANY_PARTS = re.compile(rf"(?<![\w\"'-])(?:[\w\"'-]+[ \t]*\.[ \t]*){{{DEEPEST}}}")


@dataclass(frozen=True, kw_only=True)
class PathSection:
    """The curve of Type IV: its kind and its parameters by name; for a composite one its lines and arcs.

    `stop` is the point that stops at the end and at cusps, P_l ("point") or the middle of the axle ("axle");
    the last segment of a `closed` path is followed by the first.
    """

    kind: str
    parameters: Mapping[str, float] = dataclasses.field(default_factory=dict)
    segments: tuple[Segment, ...] = ()
    stop: str = "point"
    closed: bool = False

    @property
    def law(self) -> str:
        """The kind of curve that the law follows."""
        return "segment" if self.segments else self.kind


def _segments_schema() -> Schema:
    from ..planning import tables  # slow to import

    return tables.schema()


def _read_segments(value: Any, where: str) -> list[Segment]:
    from ..planning import tables  # slow to import

    return tables.segments_from_tables(value, where)


@reads({"type": "array", "items": point.schema(), "description": "[[x, y], ...] in m"})
def _points(value: Any, where: str) -> list[tuple[float, ...]]:
    """Read a list of [x, y]."""
    return list(each_of(point, value, where, "a list of [x, y]"))


BETWEEN = {
    "from": pose.about("where the path begins"),
    "to": pose.about("where it ends"),
    "radius": number("positive", "m").about("radius of every arc"),
}
COMPOSITE: dict[str, dict[str, Reader]] = {  # kind -> its keys besides stop and closed
    "composite": {
        "segments": Reader(_read_segments, _segments_schema).about("lines and arcs, in the order of travel")
    },
    "waypoints": {
        "points": _points.about("the path is made of lines between them"),
        "tolerance": number("positive", "m").about(
            "largest distance of the rounded corners from these lines"
        ),
    },
    "dubins": BETWEEN,
    "reeds_shepp": BETWEEN,
}
COURSE = "course"  # kind of the path that [reference] course describes
KIND = "kind of curve; the other keys are its parameters"
OPTIONS = {
    "stop": one_of("point", "axle").about(
        "what stops at the end and at cusps: P_l, or the middle of the axle"
    ),
    "closed": flag.about("whether the last segment is followed by the first"),
}
OF_COURSE = {"stop": OPTIONS["stop"]}


def _path_schema() -> Schema:
    """Return the schema of a path: that of a curve with named numbers,
    unless its kind is one of COMPOSITE."""
    course = table_of({"kind": one_of(COURSE).about(KIND), **OF_COURSE}, ["kind"])
    of_kind: list[Schema] = [{"if": {"properties": {"kind": {"const": COURSE}}}, "then": course}]
    for kind, readers in COMPOSITE.items():
        made = table_of({"kind": one_of(kind).about(KIND), **readers, **OPTIONS}, ["kind", *readers])
        of_kind.append({"if": {"properties": {"kind": {"const": kind}}}, "then": made})
    curve = {"properties": {"kind": text.about(KIND).schema()}, "additionalProperties": number().schema()}
    others = {"if": {"properties": {"kind": {"not": {"enum": [*COMPOSITE, COURSE]}}}}, "then": curve}
    return {
        "type": "object",
        "description": "the curve that type IV follows, by its kind",
        "properties": {"kind": {**text.about(KIND).schema(), "examples": [*PATHS, *COMPOSITE, COURSE]}},
        "required": ["kind"],
        "allOf": [*of_kind, others],
    }


@reads(_path_schema)
def _read_path(value: Any, where: str) -> PathSection:
    rest = dict(table(value, where))
    if "kind" not in rest:
        raise BadInput(
            f'{where} kind is missing, for example path = {{ kind = "line", A = 1, B = -1, C = 0 }}'
        )
    kind = text(rest.pop("kind"), f"{where} kind")
    known = OPTIONS if kind in COMPOSITE else OF_COURSE if kind == COURSE else {}
    options = {key: reader(rest.pop(key), f"{where} {key}") for key, reader in known.items() if key in rest}
    if kind not in COMPOSITE:
        return PathSection(kind=kind, parameters=named_numbers(rest, where), **options)
    readers = COMPOSITE[kind] | OPTIONS
    check_keys(rest, readers, where)
    for key in sorted(set(COMPOSITE[kind]) - set(rest)):
        raise BadInput(f"{where} {key} is missing; {kind} takes {', '.join(sorted(COMPOSITE[kind]))}")
    given = {key: readers[key](value, f"{where} {key}") for key, value in rest.items()}
    return PathSection(
        kind=kind, segments=tuple(_pieces(kind, given, options.get("closed", False))), **options
    )


def _pieces(kind: str, given: dict[str, Any], closed: bool) -> list[Segment]:
    """Return the lines and arcs of a composite path, planned if it is given by poses or waypoints."""
    if kind == "composite":
        return given["segments"]
    from .. import planning  # slow to import

    if kind == "waypoints":
        return planning.fit(given["points"], given["tolerance"], closed=closed)
    plan = planning.dubins if kind == "dubins" else planning.reeds_shepp
    return plan(given["from"], given["to"], given["radius"])


FEEDBACK = "lqr"  # the law of a SPEC with [feedback], which has no [output]


@dataclass(frozen=True, kw_only=True)
class OutputSection(Section):
    """The outputs: Type I to IV, with the point P_l at a distance L (m) ahead of the vehicle's point and W
    (m) to its left; or an output of the robot by its name, with its `parameters`, if any. With `extension`
    their decoupling matrix may be singular everywhere, as it is with P_l on the axle: integrators on inputs
    then make it regular where the vehicle moves.

    Type IV is singular where the heading is normal to the path. `near_singular` selects whether the law
    refuses such states, or its inverse is damped where the cosine of the angle between heading and path is
    below `band`.

    If v / (L + d) < 0 for the speed v, the heading diverges from the path: `reversing` selects whether that
    is allowed, refused, or avoided by a P_l on the other side of the axle, L_backward (by default as far
    behind the axle as L is ahead).
    """

    type: str = entry(text, about=f"{', '.join(TYPES)}, or the name of an output of the robot")
    L: float = entry(number(unit="m"), 0.0, "how far P_l is ahead of the vehicle's point")
    W: float = entry(number(unit="m"), 0.0, "how far P_l is to the left of the vehicle's axis")
    path: PathSection | None = entry(_read_path, None)
    reversing: str = entry(
        one_of("allow", "refuse", "switch"),
        "allow",
        "what happens where v / (L + d) < 0; switch: P_l on the other side of the axle",
    )
    L_backward: float | None = entry(number(unit="m"), None, 'L where v < 0, for reversing = "switch"')
    parameters: Mapping[str, float] = entry(named_numbers, {}, "those of an output of the robot, by name")
    extension: bool = entry(
        flag,
        False,
        "put integrators on inputs where outputs need it, such as those of a P_l in the middle of the axle",
    )

    arclength: bool = entry(
        flag,
        False,
        "errors along a course decay with the way of a P_l on the axle, not with time: regular at standstill "
        "too",
    )
    poles: tuple[float, ...] | None = entry(
        numbers_of(number(below=0.0)), None, "of these errors, in 1/m, negative; by default all are -1"
    )
    near_singular: str = entry(
        one_of("refuse", "damped"),
        "refuse",
        "what type IV does where the heading is nearly normal to the path",
    )
    band: float = entry(
        number("positive"), BAND, "of a damped inverse: cosine of the angle of heading and path, in 0.01 to 1"
    )

    @property
    def own(self) -> bool:
        """Whether it is an output of the robot."""
        return self.type not in TYPES

    @property
    def along_course(self) -> bool:
        """Whether the path is that of [reference] course."""
        return self.path is not None and self.path.kind == COURSE

    @property
    def segments(self) -> tuple[Segment, ...]:
        """The lines and arcs of a composite path; empty for other outputs."""
        return self.path.segments if self.path else ()

    @property
    def reverses(self) -> bool:
        """Whether a segment of a composite path is driven in reverse."""
        return any(segment.backward for segment in self.segments)

    @property
    def law(self) -> str:
        """Name of the control law."""
        if self.own:
            return self.type + EXTENDED * self.extension
        path, damped = self.path.law if self.path else "", self.near_singular == "damped"
        parts = {
            "offset": bool(self.W),
            "damped": damped,
            "extended": self.extension,
            "arclength": self.arclength,
        }
        return str(LawName(self.type, path, **parts))


@dataclass(frozen=True, kw_only=True)
class ApproachSection:
    """How desired outputs go from where the robot is to their final values: a distance, a point and a speed
    with at most `acceleration` (m/s^2), a heading with at most `angular` (rad/s^2). With a `jerk` (m/s^3) the
    acceleration of a distance, point and speed changes no faster; that of a heading in the same proportion.
    """

    acceleration: float = entry(
        number("positive", "m/s^2"), about="largest, of a desired distance, point and speed"
    )
    angular: float | None = entry(
        number("positive", "rad/s^2"), None, "largest, of a desired heading: types II and III"
    )
    jerk: float = entry(number("nonnegative", "m/s^3"), 0.0, "largest change of that per second; 0: no bound")


@dataclass(frozen=True, kw_only=True)
class CircleSection:
    """A circle on which the desired point moves: from `angle`, with `rate` (rad/s,
    positive turns left), about `position`."""

    radius: float = entry(number("positive", "m"), about="of the circle")
    rate: float = entry(number(unit="rad/s"), about="at which the desired point turns, positive to the left")
    angle: float = entry(angle, 0.0, "of the desired point at t = 0, from the x-axis to the left")


@dataclass(frozen=True, kw_only=True)
class OscillationSection:
    """By what desired outputs oscillate: amplitude sin(rate t + angle), with an amplitude for each output in
    its unit, one rate (rad/s), and an angle (rad) for each, or none.
    """

    amplitude: tuple[float, ...] = entry(numbers, about="of each desired output, in its unit")
    rate: float = entry(number("positive", "rad/s"), about="of the oscillation, 2 pi over its period")
    angle: tuple[float, ...] | None = entry(numbers, None, "of each in rad at t = 0; by default 0")


FOLLOW = ("time", "path")


@dataclass(frozen=True, kw_only=True)
class CourseSection:
    """A smooth curve on which the desired point moves at `speed` (m/s), from `position` on in the direction
    `heading` (rad): `curvatures` (1/m, positive turns left) at the beginning of the first of the `lengths`
    (m) and at the end of each. With a `rounding` the parts are lines, arcs and clothoids, rounded over that
    length where they meet. It is followed in time, or from wherever the robot is beside it. Parts of negative
    length are driven in reverse: where the sign changes is a cusp.
    """

    speed: float = entry(number("positive", "m/s"), about="of the desired point along the curve")
    heading: float = entry(
        angle, 0.0, "in which the desired point moves at t = 0, from the x-axis to the left"
    )
    lengths: tuple[float, ...] = entry(
        numbers, about="of the parts in m; those driven in reverse are negative"
    )
    curvatures: tuple[float, ...] = entry(
        numbers, about="in 1/m where each part begins, and where the last ends"
    )
    rounding: float = entry(
        number("nonnegative", "m"),
        0.0,
        "over which the curvature's rate changes where parts meet; 0: over the whole parts",
    )
    follow: str = entry(
        one_of(*FOLLOW),
        "time",
        "time: the desired point does not wait; path: it is the one nearest to the robot",
    )

    def __post_init__(self):
        parts, ends, shortest = (
            len(self.lengths),
            len(self.curvatures),
            min(map(abs, self.lengths), default=0.0),
        )
        met = [k for k in self.cusps if self.rounding and len(set(self.curvatures[k - 1 : k + 2])) > 1]
        for wrong, problem in (
            (
                ends != parts + 1,
                f"has {parts} lengths and {ends} curvatures: give one curvature more than lengths",
            ),
            (not all(self.lengths), "has a length of 0: they are positive, or negative in reverse"),
            (
                self.rounding > shortest,
                f"rounding = {self.rounding:g} must be at most the shortest of the lengths",
            ),
            (
                met,
                f"with a rounding, the parts at a cusp, after {met}, need the same constant curvature: add a "
                "line or an arc",
            ),
        ):
            if wrong:
                raise BadInput(f"[reference] course: {problem}")

    @property
    def cusps(self) -> tuple[int, ...]:
        """How many parts are before each cusp."""
        return tuple(
            k for k in range(1, len(self.lengths)) if (self.lengths[k - 1] < 0.0) != (self.lengths[k] < 0.0)
        )

    @property
    def reverses(self) -> bool:
        """Whether any part is driven in reverse."""
        return any(length < 0.0 for length in self.lengths)


def _course_schema() -> Schema:
    return {
        "anyOf": [
            section(CourseSection).schema(),
            {"type": "string", "description": "file of a course, or of points"},
        ]
    }


def _read_course(value: Any, where: str) -> CourseSection:
    """Read a course; one in a file has been read before, with the SPEC."""
    return section(CourseSection)(value, where)


_course = Reader(_read_course, _course_schema, kind=CourseSection)
FASTEST = math.inf  # m/s: as fast as the accelerations allow


@reads(
    {
        "anyOf": [*number(unit="m/s").schema()["anyOf"], {"const": "fastest"}],
        "description": "in m/s, or fastest",
    },
    "m/s",
)
def _speed(value: Any, where: str) -> float:
    """Read a speed, m/s, or "fastest"."""
    return FASTEST if value == "fastest" else number(unit="m/s")(value, where)


@dataclass(frozen=True, kw_only=True)
class Reference:
    """Desired values of the outputs. Type IV: forward speed, m/s, at distance 0 from the path, at once or
    with `approach`.

    On a composite path, speed is that along it; before the end and each cusp the desired speed decreases with
    `deceleration` (m/s^2; 0: at once) to `creep` (m/s), below which the vehicle counts as standing; on a
    course too, which without these and without a cusp has no end: its last curvature stays. With the speed
    "fastest", or with `lateral`, it follows a profile: the fastest within `lateral`, `acceleration`,
    `deceleration` and `angular`, by default of friction. Types I to III: y_d(t) = position + velocity t, an
    entry for each output (x_l, y_l in m, heading in rad). With `circle` the first two outputs, a point, also
    move on a circle about it; with `course` along a curve from it; with `oscillation` the outputs of a
    robot's own move as sines. With [feedback]: its steady motion, or from the `position` x, y (m) and heading
    (rad) on `commands`, or a `course`.
    """

    speed: float | None = entry(
        _speed, None, 'desired forward speed of type IV; on a composite path "fastest"'
    )
    lateral: float | None = entry(
        number("positive", "m/s^2"), None, "largest acceleration towards the centre of an arc"
    )
    acceleration: float | None = entry(
        number("positive", "m/s^2"), None, "largest forward acceleration along a composite path"
    )
    angular: float | None = entry(
        number("positive", "rad/s^2"), None, "largest change of the yaw rate where arcs begin and end"
    )
    deceleration: float | None = entry(
        number("nonnegative", "m/s^2"),
        None,
        "before the end and cusps of a composite path or a course; 0: at once",
    )
    creep: float | None = entry(
        number("positive", "m/s"), None, "speed below which the vehicle counts as standing"
    )
    position: tuple[float, ...] | None = entry(
        numbers, None, "desired outputs of types I to III at t = 0, one for each"
    )
    velocity: tuple[float, ...] | None = entry(numbers, None, "rates of these desired outputs, one for each")
    approach: ApproachSection | None = entry(section(ApproachSection), None)
    circle: CircleSection | None = entry(
        section(CircleSection), None, "on which a desired point moves, in addition"
    )
    course: CourseSection | None = entry(
        _course, None, "along which a desired point moves, in addition, or a P_l of type IV"
    )
    oscillation: OscillationSection | None = entry(section(OscillationSection), None)
    commands: tuple[Command, ...] | None = entry(
        list_of(Command, "{ distance = 2, time = 6 }"),
        None,
        "of [feedback]: parts of the desired motion, one after the other",
    )

    @property
    def stops(self) -> bool:
        """Whether a course has an end at which the vehicle stops."""
        given = self.deceleration is not None or self.creep is not None
        return given or bool(self.course and self.course.cusps)

    @property
    def profiled(self) -> bool:
        """Whether the speed along a composite path follows a profile."""
        return self.speed == FASTEST or self.lateral is not None

    @property
    def incomplete(self) -> bool:
        """Whether a profile follows that leaves an acceleration out."""
        return self.profiled and not all((self.lateral, self.acceleration, self.deceleration, self.angular))

    @property
    def fastest(self) -> bool:
        """Whether the speed is as fast as the accelerations allow."""
        return self.speed == FASTEST

    @property
    def no_point(self) -> bool:
        """Whether there is a position that is not x, y."""
        return self.position is not None and len(self.position) != 2

    @property
    def beyond_pose(self) -> bool:
        """Whether the position has more than x, y and heading."""
        return self.position is not None and len(self.position) > 3


@dataclass(frozen=True, kw_only=True)
class Initial:
    """Initial state: P_l (m), heading (rad) and forward speed (m/s) without turning; or coordinates q and
    quasi-velocities nu.

    `extension`: states of the law's dynamic extension, by default those with which the outputs move as the
    reference does. `state`, with [feedback]: by how much states differ from the desired ones at the start.
    """

    point: tuple[float, ...] | None = entry(point, None, "position of P_l")
    heading: float | None = entry(angle, None, "heading of the vehicle, from the x-axis to the left")
    speed: float | None = entry(number(unit="m/s"), None, "forward, without turning")
    q: tuple[float, ...] | None = entry(numbers, None, "every coordinate, in the order of the robot")
    nu: tuple[float, ...] | None = entry(numbers, None, "every quasi-velocity, in the order of the robot")
    extension: tuple[float, ...] | None = entry(
        numbers, None, "every state of the law's dynamic extension; by default as the reference desires"
    )
    state: Mapping[str, float] | None = entry(
        named_numbers,
        None,
        "with [feedback]: by how much states differ from the desired ones at the start, by name",
    )


@dataclass(frozen=True, kw_only=True)
class NoiseSection(Section):
    """Gaussian noise added to the sensed quasi-velocities (rad/s): mean and standard deviation of each,
    or one for all."""

    mean: tuple[float, ...] = entry(one_or_more, (0.0,), "mean error of each quasi-velocity, or one for all")
    sd: tuple[float, ...] = entry(
        one_or_each(number(least=0.0)), (0.0,), "standard deviation of each, or one for all"
    )


@dataclass(frozen=True, kw_only=True)
class GyroSection:
    """A gyro: the mean yaw rate between two calls, with Gaussian noise and a constant error."""

    noise: float = entry(number("nonnegative", "rad/s"), 0.0, "standard deviation of a reading")
    bias: float = entry(
        number("nonnegative", "rad/s"), 0.0, "constant error of the readings; the largest that is expected"
    )


@dataclass(frozen=True, kw_only=True)
class AccelerometerSection:
    """An accelerometer at the middle of the axle: the mean forward acceleration between two calls, with
    Gaussian noise and a constant error.
    """

    noise: float = entry(number("nonnegative", "m/s^2"), 0.0, "standard deviation of a reading")
    bias: float = entry(
        number("nonnegative", "m/s^2"), 0.0, "constant error of the readings; the largest that is expected"
    )


@dataclass(frozen=True, kw_only=True)
class Sensors:
    """State that the controller sees: wheel rates with noise, and a pose from dead reckoning or the true one.
    Gyro and accelerometer are for noticing slip.
    """

    noise: NoiseSection = entry(section(NoiseSection), NoiseSection())
    seed: int = entry(whole(0), 0, "seed of the random numbers of the noise")
    period: float = entry(
        number("nonnegative", "s"), 0.0, "between two values of the noise; 0: new at each call"
    )
    counts: int = entry(
        whole(0), 0, "counts of an encoder per turn of a wheel; 0: no encoder, the exact angle"
    )
    pose: str = entry(one_of("reckoned", "true"), "reckoned", "the pose that the controller is given")
    gyro: GyroSection | None = entry(section(GyroSection), None)
    accelerometer: AccelerometerSection | None = entry(section(AccelerometerSection), None)


@dataclass(frozen=True, kw_only=True)
class Correction:
    """Corrections of the pose: at once ("reset") or gradually ("bumpless")."""

    rate: float = entry(number("positive", "1/s"), about="how often the pose is corrected")
    mode: str = entry(one_of("reset", "bumpless"), "reset", "at once, or gradually over the time `release`")
    release: float | None = entry(number("positive", "s"), None, "time in which a gradual correction is made")


@dataclass(frozen=True, kw_only=True)
class NoticeSlipSection(Section):
    """How slip is noticed by a gyro: it is where the heading that it measured differs from that of the
    wheels, over about the last `window` (s), by more than counts, noise, bias and a relative error `geometry`
    of the wheels' ways may make it. `deviations` of the noise beyond these bounds make a false alarm: with 6
    the probability is at most 2e-9 at each call.

    mu is then multiplied by `lower`, down to `least`, and rises by `rise` (1/s) after `hold` (s) without
    slip. The desired speed along a path is multiplied by the root of mu over that of [contact].
    """

    window: float = entry(number("positive", "s"), 0.2, "differences count for about so long")
    geometry: float = entry(
        number("nonnegative", "1"), 0.005, "largest relative error of the ways of the wheels"
    )
    deviations: float = entry(
        number("nonnegative", "1"), 6.0, "threshold, in standard deviations of the noise"
    )
    lower: float = entry(
        number("positive", "1", below=1.0), 0.8, "factor of mu each time slip is noticed, below 1"
    )
    least: float = entry(
        number("positive", "1"), 0.1, "the least mu that is believed, at most that of [contact]"
    )
    pause: float = entry(
        number("nonnegative", "s"), 0.1, "slip that goes on is noticed again after so long; at most hold"
    )
    rise: float = entry(number("nonnegative", "1/s"), 0.05, "by so much mu rises per second")
    hold: float = entry(number("nonnegative", "s"), 1.0, "after so long without slip")


@dataclass(frozen=True, kw_only=True)
class MeasuredPose:
    """Poses that are measured now and then, with normal errors, and reach the estimator `delay` s later."""

    rate: float = entry(number("positive", "1/s"), about="how often the pose is measured")
    sd: float = entry(number("positive", "m"), about="standard deviation of x and of y")
    heading_sd: float = entry(number("positive", "rad"), about="standard deviation of the heading")
    delay: float = entry(
        number("nonnegative", "s"), 0.0, "from the measurement to its arrival, which the estimator is told"
    )


_least_most = ascending(number(), "[least, most]")
_deviations = row("[x, y, heading]", number(unit="m"), number(unit="m"), number(unit="rad"))


@dataclass(frozen=True, kw_only=True)
class EstimatorSection:
    """The pose by the robot's extended Kalman filter, from the wheels of [sensors], a gyro, and poses
    measured now and then.

    `noise`, `gyro_noise`, `bias_sd`, `bias_walk`, `start_sd`, `scales` and `gate` are what the filter is
    told. The simulated gyro has the bias `bias` and white noise of `gyro_noise`.
    """

    noise: tuple[float, ...] = entry(
        one_or_more,
        about="of each wheel, or one for all: standard deviation of its angle after 1 rad, in sqrt(rad)",
    )
    gyro_noise: float = entry(number("nonnegative"), 0.0, "white noise of the gyro, rad/sqrt(s); 0: no gyro")
    bias: float = entry(number(unit="rad/s"), 0.0, "of the simulated gyro")
    bias_sd: float = entry(number("positive", "rad/s"), 0.01, "standard deviation of the bias at first")
    bias_walk: float = entry(
        number("nonnegative"), 0.0, "random walk of the bias that the filter reckons with, rad/s/sqrt(s)"
    )
    start_sd: tuple[float, ...] = entry(
        _deviations, (0.01, 0.01, 0.01), "standard deviations of the first pose"
    )
    scales: Mapping[str, float] = entry(
        named_numbers,
        {},
        "parameters and quasi-velocities whose scale is estimated, with its standard deviation at first",
    )
    gate: float = entry(
        number("positive"), 1.0, "largest innovation that is used, in units of its 99.9 % quantile"
    )
    pose: MeasuredPose | None = entry(section(MeasuredPose), None, "poses that are measured now and then")


@reads(
    {
        "type": "object",
        "additionalProperties": {"type": "array", "items": number().schema(), "minItems": 2, "maxItems": 2},
        "minProperties": 1,
        "description": "in SI units",
    }
)
def _bounds(value: Any, where: str) -> dict[str, tuple[float, float]]:
    """Read a table of least and most by name."""
    bounds = {name: _least_most(pair, f"{where} {name}") for name, pair in table(value, where).items()}
    if not bounds:
        raise BadInput(f"{where} is empty: name a parameter with its least and most")
    return bounds


@dataclass(frozen=True, kw_only=True)
class AdaptationSection:
    """Parameters of the controller that are learned while the robot drives, by recursive least squares,
    within `bounds`.

    `sd` is relative to the distance of the bounds. `noise` is the standard deviation of an equation (10), N
    or N m, after it was smoothed over `window`; errors within `dead_zone` teach nothing.
    """

    bounds: Mapping[str, tuple[float, float]] = entry(
        _bounds, about="least and most of each parameter that is learned, by name"
    )
    noise: float = entry(number("positive"), about="standard deviation of an equation of motion, N or N m")
    sd: float = entry(
        number("positive", "1"), 0.3, "standard deviation of each at first, relative to its bounds, at most 1"
    )
    dead_zone: float = entry(
        number("nonnegative"), 0.0, "largest error of the equations, N or N m, that teaches nothing"
    )
    forgetting: float = entry(
        number("nonnegative", "s"), 0.0, "what is so old counts for 1/e; 0: nothing is forgotten"
    )
    window: float = entry(
        number("positive", "s"), 0.1, "time over which the equations are smoothed, at least 5 periods"
    )
    rate: float = entry(
        number("positive", "1/s"), 0.1, "fastest change of a parameter in use, relative to its bounds"
    )


@dataclass(frozen=True, kw_only=True)
class LimitsSection(Section):
    """Largest input of each motor (N m; 0: none), one or one each; above it each is limited ("cut"), or the
    vehicle slows down ("slow"). Mode "grip" also keeps the wheels rolling on the floor of [contact], with
    `margin`, a part of mu, in reserve; torque may then be left out. mu is "earned": 0.6 of it, or what is
    `known`, is believed at first, and 0.5 of it more each second while the wheels accelerate as expected;
    where one runs away, 0.9 of what it shows. With `notice_slip` a gyro lowers mu too.

    `integral`: maximum that integral action may add to a desired derivative (0: no limit), one or one for
    each output with ki. `disturbance`: likewise what a disturbance observer may estimate, for outputs with
    ko. With either, torque may be left out.
    """

    torque: tuple[float, ...] | None = entry(
        one_or_more, None, "largest input of each motor, or one for all; 0: none"
    )
    mode: str = entry(
        one_of("cut", "slow", "grip"),
        "slow",
        "above it, each input is limited, or the vehicle slows down, or grip is kept too",
    )
    margin: float = entry(
        number("nonnegative", "1", below=1.0), 0.05, "with grip: the part of mu kept in reserve"
    )
    friction: str = entry(
        one_of("earned", "given"),
        "earned",
        "with grip: mu is believed as far as the wheels show it, or from the start",
    )
    known: float | None = entry(
        number("positive", "1"), None, "the mu that is believed at first, at most that of [contact]"
    )
    error: float = entry(
        number("positive", "1"), 0.5, "largest relative error of accelerations, by masses and torques"
    )
    integral: tuple[float, ...] = entry(
        one_or_more, (0.0,), "the most that integral action adds to each desired derivative; 0: no limit"
    )
    disturbance: tuple[float, ...] = entry(
        one_or_more,
        (0.0,),
        "the largest disturbance of each desired derivative that an observer estimates; 0: no limit",
    )
    notice_slip: NoticeSlipSection | None = entry(section(NoticeSlipSection), None)

    @property
    def of_memory(self) -> bool:
        """Whether integral action or an observer is limited."""
        return any((*self.integral, *self.disturbance))


_positive = one_or_each(number("positive"), "give a number, or one for each quasi-velocity")
NO_LIMIT = 1e6  # rad/s and rad/s^2: far beyond any drive, and finite, as limits of the C are


@dataclass(frozen=True, kw_only=True)
class DriveSection:
    """What the drives take: the controller's torque; or commands for the quasi-velocities, which their own
    loop follows, of first order with a `bandwidth` (Hz), `delay` s later; or both, the torque as a
    feed-forward. The commands of kind "kinematic" are those of a kinematic law, which needs no masses; the
    others are integrals of the accelerations of a law.

    `most_speed` and `most_acceleration` limit commands and drives, in the unit of the quasi-velocities (rad/s
    for wheels) and per second: one for all or one for each. Without them there is practically no limit.
    """

    kind: str = entry(one_of(*DRIVES), about="what the drives take")
    bandwidth: float | None = entry(
        number("positive", "Hz"), None, "of their own loop; required where they take velocities"
    )
    delay: float = entry(number("nonnegative", "s"), 0.0, "from a command until the drives follow it")
    most_speed: tuple[float, ...] = entry(
        _positive, (NO_LIMIT,), "largest speed of each, or one for all, in rad/s for wheels"
    )
    most_acceleration: tuple[float, ...] = entry(
        _positive, (NO_LIMIT,), "largest change of it per second, in rad/s^2 for wheels"
    )

    @property
    def takes_velocity(self) -> bool:
        """Whether the drives take velocities."""
        return self.kind != "torque"

    @property
    def feeds(self) -> bool:
        """Whether the torque is a feed-forward."""
        return self.kind == "velocity+torque"

    @property
    def kinematic(self) -> bool:
        """Whether the commands are those of a kinematic law."""
        return self.kind == "kinematic"

    @property
    def omega(self) -> float:
        """Bandwidth of the drives' own loop, rad/s."""
        return 2 * math.pi * (self.bandwidth or math.inf)

    @property
    def lag(self) -> float:
        """How late a drive follows a steady acceleration, s."""
        return self.delay + 1 / self.omega


@dataclass(frozen=True, kw_only=True)
class ContactSection(Section):
    """Assumptions of the check of rolling without slip."""

    # 0.7: the middle of the range 0.6 to 0.85 of rubber on dry concrete in textbooks
    mu: float = entry(number("positive", "1"), 0.7, "friction coefficient")
    share: float = entry(
        number("positive", "1", most=1.0),
        1.0,
        "part of the weight on the contacts, of a robot that does not say it",
    )
    height: float = entry(
        number("nonnegative", "m"),
        0.0,
        "height of the centre of mass, which moves load; 0: that of the robot",
    )


@dataclass(frozen=True, kw_only=True)
class Simulation(Section):
    """Options of the simulation."""

    duration: float = entry(number("positive", "s"), about="how long the run lasts")
    period: float = entry(number("nonnegative", "s"), 0.0, "between calls of the controller; 0: continuous")
    delay: float = entry(
        number("nonnegative", "s"),
        0.0,
        "from a call until its inputs act, at most the period; before the first, they are zero",
    )
    output_step: float = entry(number("positive", "s"), 0.01, "between rows of the result")
    backend: str = entry(
        text, "c", "what computes the law: c, cf (float), casadi, or an emulated processor such as m4f"
    )
    tolerance: float = entry(
        number("positive", "1", least=1e-13, most=1e-2), 1e-10, "relative error of a step of the integration"
    )

    @property
    def least_step(self) -> float:
        """The shortest time between rows, or calls, s: no run has more than MOST_ROWS."""
        return self.duration / MOST_ROWS


def _sweep() -> Reader:
    from .distributions import Sweep  # slow to import

    return section(Sweep)


@reads(lambda: _sweep().schema())
def _read_sweep(value: Any, where: str) -> "Sweep":
    return _sweep()(value, "[sweep]")


@dataclass(frozen=True, kw_only=True)
class Spec:
    """One closed-loop run. `parameters` are those of the controller, `plant` those of the robot that differ.

    `gains` of the law by name, or kp, kd, kv for all of a kind; ki, ki_distance, ... add integral action, ko,
    ko_distance, ... disturbance observers.
    `sweep` is used by `noslip sweep` only.
    """

    robot: str = entry(text, about="name of a shipped robot, or path/to/file.py:name")
    parameters: Mapping[str, float] = entry(
        named_numbers, {}, "parameters of the robot that differ from its defaults, by name"
    )
    plant: Mapping[str, float] = entry(
        named_numbers, {}, "parameters of the simulated robot that differ from these, by name"
    )
    gains: Mapping[str, float] = entry(
        named_numbers,
        {},
        "gains of the law by name, or kp, kd, kv for all of a kind; ki, ki_distance, ... add integral "
        "action; ko, ko_distance, ... disturbance observers",
    )
    given: Mapping[str, str | float] = entry(
        functions_of_time, {}, "what a robot is given as known functions of time (`Mechanism.given`), by name"
    )
    output: OutputSection = entry(section(OutputSection), OutputSection(type=FEEDBACK))
    feedback: FeedbackSection | None = entry(section(FeedbackSection), None)
    reference: Reference = entry(section(Reference), Reference())
    initial: Initial | None = entry(section(Initial), None)
    limits: LimitsSection | None = entry(section(LimitsSection), None)
    sensors: Sensors | None = entry(section(Sensors), None)
    correction: Correction | None = entry(section(Correction), None)
    estimator: EstimatorSection | None = entry(section(EstimatorSection), None)
    adaptation: AdaptationSection | None = entry(section(AdaptationSection), None)
    drive: DriveSection | None = entry(section(DriveSection), None)
    contact: ContactSection | None = entry(section(ContactSection), None)
    floor: Floor | None = entry(section(Floor), None)
    scene: SceneSection | None = entry(section(SceneSection), None)
    push: tuple[Push, ...] = entry(
        list_of(Push, '{ time = 5, on = "speed", impulse = 1 }'), (), "impulses that disturb the robot"
    )
    simulation: Simulation = entry(section(Simulation))
    sweep: "Sweep | None" = entry(_read_sweep, None)

    def __post_init__(self):
        check(self)

    @property
    def kinematic(self) -> bool:
        """Whether the law is kinematic: the drives then take its commands."""
        return self.drive is not None and self.drive.kinematic

    @property
    def desired_speed(self) -> float:
        """Desired forward speed of type IV at first, m/s: by default that of a course,
        in reverse where it begins so."""
        course, speed = self.reference.course, self.reference.speed
        along = speed if speed is not None else course.speed if course else 0.0
        return -along if course and course.lengths and course.lengths[0] < 0.0 else along

    @property
    def integral_action(self) -> bool:
        """Whether an output has integral action."""
        return any(value and name.split("_")[0] == INTEGRAL for name, value in self.gains.items())

    @property
    def observes_disturbances(self) -> bool:
        """Whether an output has a disturbance observer."""
        return any(value and name.split("_")[0] == OBSERVER for name, value in self.gains.items())

    @property
    def learned(self) -> tuple[str, ...]:
        """Names of the parameters that [adaptation] learns."""
        return tuple(self.adaptation.bounds) if self.adaptation else ()

    @property
    def law(self) -> str:
        """Name of the control law."""
        return self.output.law + KINEMATIC * self.kinematic


def schema() -> Schema:
    """Return the JSON Schema of a SPEC."""
    made = section(Spec).schema()
    made["anyOf"] = [{"required": ["output", "reference"]}, {"required": ["feedback"]}]
    return {"$schema": DRAFT, "title": "SPEC.toml of noslip", **made, "definitions": DEFINITIONS}


def read_text(file: Path | str) -> str:
    """Return the text of a file, or of a shipped SPEC by its name. Raises BadInput, naming the file,
    if it cannot be read."""
    with naming(file, OSError), naming(f"{file}: not TOML", UnicodeDecodeError):
        return read_input(file_or_shipped(file, ".toml")).decode("utf-8-sig")


def toml_table(text: str) -> dict[str, Any]:
    """Return the table of a TOML text. Raises BadInput if it is not TOML or nested too deeply."""
    if MANY_PARTS.search(text):
        raise BadInput(f"not a SPEC: a key has more than {DEEPEST} parts")
    with naming("not TOML", (ValueError, RecursionError)):  # TOMLDecodeError, or a number of too many digits
        table = tomllib.loads(text)
    level: list[Any] = [table]
    for _ in range(DEEPEST):
        lists = [
            each.values() if isinstance(each, dict) else each
            for each in level
            if isinstance(each, dict | list)
        ]
        level = [item for items in lists for item in items]
    if level:
        raise BadInput(f"not a SPEC: tables and lists are nested more than {DEEPEST} deep")
    return table


def spec_of(text: str, name: Path | str) -> Spec:
    """Return the SPEC of a text. Raises BadInput, with the `name` of the text, if it is invalid."""
    with naming(name):
        return spec_of_table(toml_table(text), name)


def spec_of_table(table: Mapping[str, Any], name: Path | str) -> Spec:
    """Return the SPEC of a table of the file `name`; its files are looked up beside it first. Raises
    BadInput."""
    spec: Spec = section(Spec)(_with_course(table, name), "")
    robot = beside(spec.robot, name)
    scene = spec.scene and dataclasses.replace(spec.scene, file=near(spec.scene.file, name))
    unchanged = (robot, scene) == (spec.robot, spec.scene)
    return spec if unchanged else dataclasses.replace(spec, robot=robot, scene=scene)


def _with_course(table: Mapping[str, Any], name: Path | str) -> Mapping[str, Any]:
    """Return the table with the course, and where it begins, that [reference] course names as a file."""
    reference = table.get("reference")
    if not (isinstance(reference, dict) and isinstance(file := reference.get("course"), str)):
        return table
    from ..planning.points import read_reference  # slow to import

    return {
        **table,
        "reference": {
            **read_reference(near(file, name)),
            **{k: v for k, v in reference.items() if k != "course"},
        },
    }


def read_spec(file: Path | str) -> Spec:
    """Read SPEC.toml. Raises BadInput, naming the file, if it is not a valid SPEC."""
    return spec_of(read_text(file), file)
