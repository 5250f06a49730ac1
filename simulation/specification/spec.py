"""SPEC.toml of `noslip simulate`: read and checked into frozen dataclasses.

Each section is a dataclass, and each entry has a reader for its value. Unknown keys are errors.
"""

import dataclasses
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...model.names import TYPES, LawName
from ...model.paths import PATHS
from ...model.segments import Segment
from ...readers.errors import BadInput
from ...readers.files import file_or_shipped, read_input
from ...readers.reading import (
    DEFINITIONS,
    DRAFT,
    Reader,
    Schema,
    angle,
    check_keys,
    entry,
    flag,
    named_numbers,
    number,
    numbers,
    one_of,
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
from ...readers.robots import beside

if TYPE_CHECKING:
    from .distributions import Sweep


TOLERANCES = (1e-13, 1e-2)  # below, rounding exceeds the tolerance; above, the result is not meaningful
MOST_ROWS = 10_000_000
STEEPEST = 1.0  # rad, of a floor
DEEPEST = 16  # nesting of tables and lists
MANY_PARTS = re.compile(rf"(?<![\w\"'-])(?:[\w\"'-]+[ \t]*\.[ \t]*){{{DEEPEST}}}")  # a key that would take minutes to parse


@dataclass(frozen=True, kw_only=True)
class PathSection:
    """The curve of Type IV: its kind and its parameters by name; for a composite one its lines and arcs.

    `stop` is the point that stops at the end and at cusps, P_l ("point") or the middle of the axle ("axle"); the last
    segment of a `closed` path is followed by the first.
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
    from ...planning import tables  # slow to import

    return tables.schema()


def _read_segments(value: Any, where: str) -> list[Segment]:
    from ...planning import tables  # slow to import

    return tables.segments_from_tables(value, where)


@reads({"type": "array", "items": point.schema()})
def _points(value: Any, where: str) -> list[tuple[float, ...]]:
    """Read a list of [x, y]."""
    if not isinstance(value, list):
        raise BadInput(f"{where} = {value!r} is not a list of [x, y]")
    return [point(item, f"{where}[{k}]") for k, item in enumerate(value)]


BETWEEN = {"from": pose, "to": pose, "radius": number("positive", "m")}
COMPOSITE: dict[str, dict[str, Reader]] = {  # kind -> its keys besides stop and closed
    "composite": {"segments": Reader(_read_segments, _segments_schema)},
    "waypoints": {"points": _points, "tolerance": number("positive", "m")},
    "dubins": BETWEEN,
    "reeds_shepp": BETWEEN,
}
OPTIONS = {"stop": one_of("point", "axle"), "closed": flag}


def _path_schema() -> Schema:
    """Return the schema of a path: that of a curve with named numbers, unless its kind is one of COMPOSITE."""
    of_kind: list[Schema] = []
    for kind, readers in COMPOSITE.items():
        made = table_of({"kind": one_of(kind), **readers, **OPTIONS}, ["kind", *readers])
        of_kind.append({"if": {"properties": {"kind": {"const": kind}}}, "then": made})
    curve = {"properties": {"kind": {}}, "additionalProperties": number().schema()}
    others = {"if": {"properties": {"kind": {"not": {"enum": list(COMPOSITE)}}}}, "then": curve}
    return {
        "type": "object",
        "properties": {"kind": {"type": "string", "examples": [*PATHS, *COMPOSITE]}},
        "required": ["kind"],
        "allOf": [*of_kind, others],
    }


@reads(_path_schema)
def _read_path(value: Any, where: str) -> PathSection:
    rest = dict(table(value, where))
    if "kind" not in rest:
        raise BadInput(f'{where} kind is missing, for example path = {{ kind = "line", A = 1, B = -1, C = 0 }}')
    kind = text(rest.pop("kind"), f"{where} kind")
    if kind not in COMPOSITE:
        return PathSection(kind=kind, parameters=named_numbers(rest, where))
    readers = COMPOSITE[kind] | OPTIONS
    options = {key: readers[key](rest.pop(key), f"{where} {key}") for key in OPTIONS if key in rest}
    check_keys(rest, readers, where)
    for key in sorted(set(COMPOSITE[kind]) - set(rest)):
        raise BadInput(f"{where} {key} is missing; {kind} takes {', '.join(sorted(COMPOSITE[kind]))}")
    given = {key: readers[key](value, f"{where} {key}") for key, value in rest.items()}
    return PathSection(kind=kind, segments=tuple(_pieces(kind, given, options.get("closed", False))), **options)


def _pieces(kind: str, given: dict[str, Any], closed: bool) -> list[Segment]:
    """Return the lines and arcs of a composite path, planned if it is given by poses or waypoints."""
    if kind == "composite":
        return given["segments"]
    from ... import planning  # slow to import

    if kind == "waypoints":
        return planning.fit(given["points"], given["tolerance"], closed=closed)
    plan = planning.dubins if kind == "dubins" else planning.reeds_shepp
    return plan(given["from"], given["to"], given["radius"])


@dataclass(frozen=True, kw_only=True)
class OutputSection:
    """The outputs: Type I to IV, with the point P_l at a distance L (m) ahead of the vehicle's point and W (m) to its left; or
    an output of the robot by its name, with its `parameters`, if any.

    If v / (L + d) < 0 for the speed v, the heading diverges from the path: `reversing` selects whether that is allowed, refused,
    or avoided by a P_l on the other side of the axle, L_backward (by default as far behind the axle as L is ahead).
    """

    type: str = entry(text)
    L: float = entry(number(unit="m"), 0.0)
    W: float = entry(number(unit="m"), 0.0)
    path: PathSection | None = entry(_read_path, None)
    reversing: str = entry(one_of("allow", "refuse", "switch"), "allow")
    L_backward: float | None = entry(number(unit="m"), None)
    parameters: Mapping[str, float] = entry(named_numbers, {})

    def __post_init__(self):
        if self.type in TYPES and self.parameters:
            raise BadInput(f"[output] parameters apply to a robot's own output; type {self.type} has L, W and path")
        if self.own and (self.L or self.W or self.path):
            known = ", ".join(TYPES)
            raise BadInput(f"[output] type = {self.type!r} is not one of {known}; an output of a robot's own has no L, W or path")
        if not self.own and (self.type == "IV") != (self.path is not None):
            raise BadInput(f"[output] path applies to type IV only; type is {self.type}")
        if self.L_backward is not None and self.reversing != "switch":
            raise BadInput('[output] L_backward requires reversing = "switch"')

    @property
    def own(self) -> bool:
        """Whether it is an output of the robot."""
        return self.type not in TYPES

    @property
    def segments(self) -> tuple[Segment, ...]:
        """The lines and arcs of a composite path; empty for other outputs."""
        return self.path.segments if self.path else ()

    @property
    def law(self) -> str:
        """Name of the control law."""
        return self.type if self.own else str(LawName(self.type, self.path.law if self.path else "", bool(self.W)))


@dataclass(frozen=True, kw_only=True)
class Reference:
    """Desired values of the outputs. Type IV: forward speed, m/s, at distance 0 from the path.

    On a composite path, speed is that along it; before the end and each cusp the desired speed decreases with `deceleration`
    (m/s^2; 0: at once) to `creep` (m/s), below which the vehicle counts as standing.
    Types I to III: y_d(t) = position + velocity t, an entry for each output (x_l, y_l in m, heading in rad).
    """

    speed: float | None = entry(number(unit="m/s"), None)
    deceleration: float | None = entry(number("nonnegative", "m/s^2"), None)
    creep: float | None = entry(number("positive", "m/s"), None)
    position: tuple[float, ...] | None = entry(numbers, None)
    velocity: tuple[float, ...] | None = entry(numbers, None)


@dataclass(frozen=True, kw_only=True)
class Initial:
    """Initial state: P_l (m), heading (rad) and forward speed (m/s) without turning; or coordinates q and quasi-velocities nu."""

    point: tuple[float, ...] | None = entry(point, None)
    heading: float | None = entry(angle, None)
    speed: float | None = entry(number(unit="m/s"), None)
    q: tuple[float, ...] | None = entry(numbers, None)
    nu: tuple[float, ...] | None = entry(numbers, None)

    def __post_init__(self):
        by_pose = [name for name in ("point", "heading", "speed") if getattr(self, name) is not None]
        by_state = [name for name in ("q", "nu") if getattr(self, name) is not None]
        if by_pose and by_state:
            raise BadInput(f"[initial] has both {by_pose[0]} and {by_state[0]}: give point, heading, speed or q, nu")
        if self.point is None and self.q is None:
            raise BadInput("[initial] point = [x, y] or q = [...] is missing")


@dataclass(frozen=True, kw_only=True)
class NoiseSection:
    """Gaussian noise added to the sensed quasi-velocities (rad/s): mean and standard deviation of each, or one for all."""

    mean: tuple[float, ...] = entry(one_or_more, (0.0,))
    sd: tuple[float, ...] = entry(one_or_more, (0.0,))

    def __post_init__(self):
        if min(self.sd, default=0.0) < 0:
            raise BadInput(f"[sensors] noise sd = {min(self.sd):g} must be zero or positive")


@dataclass(frozen=True, kw_only=True)
class Sensors:
    """State that the controller sees: wheel rates with noise, drawn every `period` s (0: at each call), and a pose from dead
    reckoning. `counts` of an encoder per turn of a wheel; 0: no encoder, the exact angle. `pose` "true": the true pose instead.
    """

    noise: NoiseSection = entry(section(NoiseSection), NoiseSection())
    seed: int = entry(whole(0), 0)
    period: float = entry(number("nonnegative", "s"), 0.0)
    counts: int = entry(whole(0), 0)
    pose: str = entry(one_of("reckoned", "true"), "reckoned")


@dataclass(frozen=True, kw_only=True)
class Correction:
    """Corrections of the pose at a rate (Hz): at once ("reset") or gradually over `release` s ("bumpless")."""

    rate: float = entry(number("positive", "1/s"))
    mode: str = entry(one_of("reset", "bumpless"), "reset")
    release: float | None = entry(number("positive", "s"), None)


@dataclass(frozen=True, kw_only=True)
class LimitsSection:
    """Largest input of each motor (N m; 0: none), one or one each; above it each is limited, or the vehicle slows down.

    `integral`: maximum that integral action may add to a desired derivative (0: no limit), one or one for each output with ki.
    """

    torque: tuple[float, ...] = entry(one_or_more)
    mode: str = entry(one_of("cut", "slow"), "slow")
    integral: tuple[float, ...] = entry(one_or_more, (0.0,))


@dataclass(frozen=True, kw_only=True)
class ContactSection:
    """Assumptions of the check of rolling without slip: friction `mu`, the `share` of the weight on the driven wheels,
    the `height` (m) of the centre of mass, which moves load to the outer wheel.
    """

    mu: float = entry(number("positive", "1"), 0.7)  # the middle of the range 0.6 to 0.85 of rubber on dry concrete in textbooks
    share: float = entry(number("positive", "1"), 1.0)
    height: float = entry(number("nonnegative", "m"), 0.0)

    def __post_init__(self):
        if self.share > 1:
            raise BadInput(f"[contact] share = {self.share:g} must be at most 1")


@reads(row("[a, b]", number(unit="m"), number(unit="m")).schema(), "m")
def _interval(value: Any, where: str) -> tuple[float, ...]:
    """Read a < b, m."""
    a, b = row("[a, b]", number(unit="m"), number(unit="m"))(value, where)
    if not a < b:
        raise BadInput(f"{where} = [{a:g}, {b:g}]: the first must be below the second")
    return a, b


@dataclass(frozen=True, kw_only=True)
class Patch:
    """A rectangle of the floor, x from x[0] to x[1] and y from y[0] to y[1] (m), with a friction coefficient of its own."""

    x: tuple[float, ...] = entry(_interval)
    y: tuple[float, ...] = entry(_interval)
    mu: float = entry(number("nonnegative", "1"))


@reads(lambda: {"type": "array", "items": section(Patch).schema()})
def _patches(value: Any, where: str) -> tuple[Patch, ...]:
    """Read a list of patches; where two overlap, the later one counts."""
    if not isinstance(value, list):
        raise BadInput(f"{where} = {value!r} is not a list, for example [{{ x = [0, 1], y = [-1, 1], mu = 0.2 }}]")
    return tuple(section(Patch)(item, f"{where}[{k}]") for k, item in enumerate(value))


@reads({"anyOf": [angle.schema(), row("[angle, heading]", angle, angle).schema()]}, "rad")
def _slope(value: Any, where: str) -> tuple[float, float]:
    """Read an angle below the horizontal, or with it the heading of the way down."""
    made = row("[angle, heading]", angle, angle)(value if isinstance(value, list) else [value, 0.0], where)
    if not abs(made[0]) < STEEPEST:
        raise BadInput(f"{where} = {made[0]:g} rad is too steep to stand on; give less than {STEEPEST:g}")
    return made


@dataclass(frozen=True, kw_only=True)
class Floor:
    """The floor of a run in a physics engine: friction `mu` (default: that of [contact]), `slope`: its angle (rad), or [angle,
    heading of the way down], and patches with another friction.
    """

    mu: float | None = entry(number("nonnegative", "1"), None)
    slope: tuple[float, float] = entry(_slope, (0.0, 0.0))
    patch: tuple[Patch, ...] = entry(_patches, ())


@dataclass(frozen=True, kw_only=True)
class Simulation:
    """Options of the simulation: duration (s), period between calls of the controller (s, 0: continuous), s between rows,
    backend, integration tolerance.

    `delay`: s from a call until its inputs act, at most a period; before the first ones act, the torque is zero.
    """

    duration: float = entry(number("positive", "s"))
    period: float = entry(number("nonnegative", "s"), 0.0)
    delay: float = entry(number("nonnegative", "s"), 0.0)
    output_step: float = entry(number("positive", "s"), 0.01)
    backend: str = entry(text, "c")
    tolerance: float = entry(number("positive", "1"), 1e-10)

    def __post_init__(self):
        low, high = TOLERANCES
        if not low <= self.tolerance <= high:
            raise BadInput(f"[simulation] tolerance = {self.tolerance:g} must be between {low:g} and {high:g}")
        if self.delay > self.period:
            limit = f"at most the period, {self.period:g} s" if self.period else "0 without a period: the loop is continuous"
            raise BadInput(f"[simulation] delay = {self.delay:g} must be {limit}")
        if self.duration / self.output_step > MOST_ROWS:
            raise BadInput(f"[simulation] output_step = {self.output_step:g} gives more than {MOST_ROWS} rows; make it longer")
        if self.period and self.duration / self.period > MOST_ROWS:
            raise BadInput(
                f"[simulation] period = {self.period:g} calls the controller more than {MOST_ROWS} times; make it longer"
            )


def _sweep() -> Reader:
    from .distributions import Sweep  # slow to import

    return section(Sweep)


@reads(lambda: _sweep().schema())
def _read_sweep(value: Any, where: str) -> "Sweep":
    return _sweep()(value, "[sweep]")


@dataclass(frozen=True, kw_only=True)
class Spec:
    """One closed-loop run. `parameters` are those of the controller, `plant` those of the robot that differ.

    `gains` of the law by name, or kp, kd, kv for all of a kind; ki, ki_distance, ... add integral action.
    `sweep` is used by `noslip sweep` only.
    """

    robot: str = entry(text)
    parameters: Mapping[str, float] = entry(named_numbers, {})
    plant: Mapping[str, float] = entry(named_numbers, {})
    gains: Mapping[str, float] = entry(named_numbers, {})
    output: OutputSection = entry(section(OutputSection))
    reference: Reference = entry(section(Reference))
    initial: Initial | None = entry(section(Initial), None)
    limits: LimitsSection | None = entry(section(LimitsSection), None)
    sensors: Sensors | None = entry(section(Sensors), None)
    correction: Correction | None = entry(section(Correction), None)
    contact: ContactSection = entry(section(ContactSection), ContactSection())
    floor: Floor | None = entry(section(Floor), None)
    simulation: Simulation = entry(section(Simulation))
    sweep: "Sweep | None" = entry(_read_sweep, None)

    def __post_init__(self):
        if self.sensors and not self.simulation.period:
            raise BadInput("[sensors] requires [simulation] period > 0: sensors are read at the calls of the controller")
        if self.correction and not self.sensors:
            raise BadInput("[correction] requires [sensors]: without them the pose is the true one")
        if self.correction and self.sensors and self.sensors.pose == "true":
            raise BadInput('[correction] requires [sensors] pose = "reckoned": the true pose needs none')
        composite = self.output.segments
        if self.initial is None and not composite:
            raise BadInput("[initial] is missing: point, heading and speed, or q and nu")
        for name in ("deceleration", "creep"):
            if getattr(self.reference, name) is not None and not composite:
                raise BadInput(f"[reference] {name} applies to composite paths only")
        wanted, optional = ("speed", ()) if self.output.type == "IV" else ("position", ("velocity",))
        for name in ("speed", "position", "velocity"):
            given = getattr(self.reference, name) is not None
            if given and name not in (wanted, *optional):
                takes = " and ".join((wanted, *optional))
                raise BadInput(f"[reference] {name} does not apply to type {self.output.type}, which takes {takes}")
            if not given and name == wanted:
                raise BadInput(f"[reference] {name} is missing; type {self.output.type} requires it")


def schema() -> Schema:
    """Return the JSON Schema of a SPEC."""
    made = section(Spec).schema()
    return {"$schema": DRAFT, "title": "SPEC.toml of noslip", **made, "definitions": DEFINITIONS}


def read_text(file: Path | str) -> str:
    """Return the text of a file, or of a shipped SPEC by its name. Raises BadInput, naming the file, if it cannot be read."""
    place = file_or_shipped(file, ".toml")
    try:
        return read_input(place).decode()
    except OSError as error:
        raise BadInput(f"{file}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise BadInput(f"{file}: not TOML: {error}") from error


def toml_table(text: str) -> dict[str, Any]:
    """Return the table of a TOML text. Raises BadInput if it is not TOML or nested too deeply."""
    if MANY_PARTS.search(text):
        raise BadInput(f"not a SPEC: a key has more than {DEEPEST} parts")
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # TOMLDecodeError, or a number of too many digits
        raise BadInput(f"not TOML: {error}") from error
    level: list[Any] = [table]
    for _ in range(DEEPEST):
        lists = [each.values() if isinstance(each, dict) else each for each in level if isinstance(each, dict | list)]
        level = [item for items in lists for item in items]
    if level:
        raise BadInput(f"not a SPEC: tables and lists are nested more than {DEEPEST} deep")
    return table


def spec_of(text: str, name: Path | str) -> Spec:
    """Return the SPEC of a text. Raises BadInput, with the `name` of the text, if it is invalid."""
    try:
        return spec_of_table(toml_table(text), name)
    except BadInput as error:
        raise BadInput(f"{name}: {error}") from error


def spec_of_table(table: Mapping[str, Any], name: Path | str) -> Spec:
    """Return the SPEC of a table of the file `name`; a robot file is looked up beside it first. Raises BadInput."""
    spec: Spec = section(Spec)(table, "")
    return dataclasses.replace(spec, robot=beside(spec.robot, name))


def read_spec(file: Path | str) -> Spec:
    """Read SPEC.toml. Raises BadInput, naming the file, if it is not a valid SPEC."""
    return spec_of(read_text(file), file)
