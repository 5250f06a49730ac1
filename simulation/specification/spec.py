"""SPEC.toml of `noslip simulate`: read, checked, frozen.

A section is a frozen dataclass; each of its entries knows how to read its value. Unknown keys are always refused.
"""

import dataclasses
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path as File
from typing import TYPE_CHECKING, Any

from ...model.outputs import OFFSET
from ...model.segments import Segment
from ...readers.errors import BadInput, suggestion
from ...readers.files import read_input
from ...readers.reading import (
    _table,
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
    section,
    text,
    whole,
)
from ...readers.robots import beside

if TYPE_CHECKING:
    from .distributions import Sweep


SPECS = File(__file__).resolve().parents[2] / "specs"
TYPES = ("I", "II", "III", "IV")
TOLERANCES = (1e-13, 1e-2)  # below, rounding is larger than the tolerance; above, it is no simulation
MOST_ROWS = 10_000_000
DEEPEST = 16  # tables and lists in each other
MANY_PARTS = re.compile(rf"(?<![\w\"'-])(?:[\w\"'-]+[ \t]*\.[ \t]*){{{DEEPEST}}}")  # a key that would take minutes to read


@dataclass(frozen=True, kw_only=True)
class Path:
    """The curve of Type IV: its kind and its parameters by name; for a composite one its lines and arcs.

    `stop` says what comes to stand at the end and at cusps, P_l ("point") or the axle's middle ("axle"); after the last
    piece of a `closed` path comes the first.
    """

    kind: str
    parameters: Mapping[str, float] = dataclasses.field(default_factory=dict)
    segments: tuple[Segment, ...] = ()
    stop: str = "point"
    closed: bool = False

    @property
    def law(self) -> str:
        """The kind of curve that the law follows at a time."""
        return "segment" if self.segments else self.kind


COMPOSITE = {  # kind -> what it takes beside stop and closed
    "composite": {"segments"},
    "waypoints": {"points", "tolerance"},
    "dubins": {"from", "to", "radius"},
    "reeds_shepp": {"from", "to", "radius"},
}


def _read_path(value: Any, where: str) -> Path:
    rest = dict(_table(value, where))
    if "kind" not in rest:
        raise BadInput(f'{where} kind is missing, for example path = {{ kind = "line", A = 1, B = -1, C = 0 }}')
    kind = text(rest.pop("kind"), f"{where} kind")
    if kind not in COMPOSITE:
        return Path(kind=kind, parameters=named_numbers(rest, where))
    stop = one_of("point", "axle")(rest.pop("stop", "point"), f"{where} stop")
    closed = flag(rest.pop("closed", False), f"{where} closed")
    check_keys(rest, [*COMPOSITE[kind], "stop", "closed"], where)
    for key in sorted(COMPOSITE[kind] - set(rest)):
        raise BadInput(f"{where} {key} is missing; {kind} takes {', '.join(sorted(COMPOSITE[kind]))}")
    return Path(kind=kind, segments=tuple(_pieces(kind, rest, closed, where)), stop=stop, closed=closed)


def _pieces(kind: str, given: dict[str, Any], closed: bool, where: str) -> list[Segment]:
    """The lines and arcs of a composite path, planned where it is given by what it must reach."""
    from ... import planning  # slow to import

    if kind == "composite":
        return planning.segments_from_tables(given["segments"], f"{where} segments")
    if kind == "waypoints":
        points = given["points"]
        if not isinstance(points, list):
            raise BadInput(f"{where} points = {points!r} is not a list of [x, y]")
        places = [point(item, f"{where} points[{k}]") for k, item in enumerate(points)]
        return planning.fit(places, number("positive")(given["tolerance"], f"{where} tolerance"), closed=closed)
    plan = planning.dubins if kind == "dubins" else planning.reeds_shepp
    start, goal = (pose(given[name], f"{where} {name}") for name in ("from", "to"))
    return plan(start, goal, number("positive")(given["radius"], f"{where} radius"))


@dataclass(frozen=True, kw_only=True)
class Output:
    """What is controlled: Type I to IV, of the point P_l a distance L (m) ahead of the vehicle's point, W (m) to its left; or
    an output of the robot's own by its name, with its `parameters` where it has some.

    Driving with speed v / (L + d) < 0 the heading diverges from the path: `reversing` says whether that is allowed, refused,
    or avoided by a P_l on the other side of the axle, L_backward (by default as far behind it as L is ahead).
    """

    type: str = entry(text)
    L: float = entry(number(), 0.0)
    W: float = entry(number(), 0.0)
    path: Path | None = entry(_read_path, None)
    reversing: str = entry(one_of("allow", "refuse", "switch"), "allow")
    L_backward: float | None = entry(number(), None)
    parameters: Mapping[str, float] = entry(named_numbers, {})

    def __post_init__(self):
        if self.type in TYPES and self.parameters:
            raise BadInput(f"[output] parameters are for a robot's own output; type {self.type} has L, W and path")
        if self.own and (self.L or self.W or self.path):
            known = ", ".join(TYPES)
            raise BadInput(f"[output] type = {self.type!r} is not one of {known}; an output of a robot's own has no L, W or path")
        if not self.own and (self.type == "IV") != (self.path is not None):
            raise BadInput(f"[output] path belongs to type IV and to no other; type is {self.type}")
        if self.L_backward is not None and self.reversing != "switch":
            raise BadInput('[output] L_backward needs reversing = "switch"')

    @property
    def own(self) -> bool:
        """Is it an output of the robot's own?"""
        return self.type not in TYPES

    @property
    def segments(self) -> tuple[Segment, ...]:
        """The lines and arcs of a composite path; of any other output none."""
        return self.path.segments if self.path else ()

    @property
    def law(self) -> str:
        """Name of the control law."""
        if self.own:
            return self.type
        name = f"type_{self.type.lower()}" + (f"_{self.path.law}" if self.path else "")
        return name + OFFSET if self.W else name


@dataclass(frozen=True, kw_only=True)
class Reference:
    """What the outputs shall do. Type IV: forward speed, m/s, at distance 0 from the path.

    On a composite path speed is that along it, and before the end and each cusp the wanted speed falls with `deceleration`
    (m/s^2; 0: all at once) to `creep` (m/s), below which it counts as standing.
    Types I to III: y_d(t) = position + velocity t, an entry for each output (x_l, y_l in m, heading in rad).
    """

    speed: float | None = entry(number(), None)
    deceleration: float | None = entry(number("nonnegative"), None)
    creep: float | None = entry(number("positive"), None)
    position: tuple[float, ...] | None = entry(numbers, None)
    velocity: tuple[float, ...] | None = entry(numbers, None)


@dataclass(frozen=True, kw_only=True)
class Initial:
    """Where it starts: P_l (m), heading (rad) and forward speed (m/s) without turning; or coordinates q, quasi-velocities nu."""

    point: tuple[float, ...] | None = entry(point, None)
    heading: float | None = entry(number(), None)
    speed: float | None = entry(number(), None)
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
class Noise:
    """Gaussian noise added to the sensed quasi-velocities (rad/s): mean and standard deviation of each, or one for all."""

    mean: tuple[float, ...] = entry(one_or_more, (0.0,))
    sd: tuple[float, ...] = entry(one_or_more, (0.0,))

    def __post_init__(self):
        if min(self.sd, default=0.0) < 0:
            raise BadInput(f"[sensors] noise sd = {min(self.sd):g} must be zero or positive")


@dataclass(frozen=True, kw_only=True)
class Sensors:
    """What the controller sees: wheel rates with noise, drawn anew every `period` s (0: at each call), and a pose that is
    dead-reckoned from the wheels. `counts` of an encoder per turn of a wheel; 0: no encoder, the angle itself.
    """

    noise: Noise = entry(section(Noise), Noise())
    seed: int = entry(whole(0), 0)
    period: float = entry(number("nonnegative"), 0.0)
    counts: int = entry(whole(0), 0)


@dataclass(frozen=True, kw_only=True)
class Correction:
    """The dead-reckoned pose is set right at a rate (Hz): at once ("reset") or let in over `release` s ("bumpless")."""

    rate: float = entry(number("positive"))
    mode: str = entry(one_of("reset", "bumpless"), "reset")
    release: float | None = entry(number("positive"), None)


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Largest input of each motor (N m; 0: none), one or one each; beyond it each is cut, or the robot slows down.

    `integral`: the most that integral action may add to a wanted derivative (0: no limit), one or one for each output with ki.
    """

    torque: tuple[float, ...] = entry(one_or_more)
    mode: str = entry(one_of("cut", "slow"), "slow")
    integral: tuple[float, ...] = entry(one_or_more, (0.0,))


@dataclass(frozen=True, kw_only=True)
class Contact:
    """What rolling without slip is judged by, all assumed unless given: friction `mu`, the `share` of the weight that rests
    on the driven wheels, the `height` (m) of the centre of mass, which shifts load to the outer wheel.
    """

    mu: float = entry(number("positive"), 0.7)  # the middle of textbooks' 0.6 to 0.85, rubber sliding on dry concrete
    share: float = entry(number("positive"), 1.0)
    height: float = entry(number("nonnegative"), 0.0)

    def __post_init__(self):
        if self.share > 1:
            raise BadInput(f"[contact] share = {self.share:g} must be at most 1")


@dataclass(frozen=True, kw_only=True)
class Simulation:
    """How it is run: seconds, s between controller calls (0: continuous), s between rows, backend, integration tolerance.

    `delay`: s from a call until what it answers acts, at most a period; until the first answer acts, no torque does.
    """

    duration: float = entry(number("positive"))
    period: float = entry(number("nonnegative"), 0.0)
    delay: float = entry(number("nonnegative"), 0.0)
    output_step: float = entry(number("positive"), 0.01)
    backend: str = entry(text, "c")
    tolerance: float = entry(number("positive"), 1e-10)

    def __post_init__(self):
        low, high = TOLERANCES
        if not low <= self.tolerance <= high:
            raise BadInput(f"[simulation] tolerance = {self.tolerance:g} must lie between {low:g} and {high:g}")
        if self.delay > self.period:
            limit = f"at most the period, {self.period:g} s" if self.period else "0 without a period: nothing is sampled"
            raise BadInput(f"[simulation] delay = {self.delay:g} must be {limit}")
        if self.duration / self.output_step > MOST_ROWS:
            raise BadInput(f"[simulation] output_step = {self.output_step:g} gives more than {MOST_ROWS} rows; make it longer")
        if self.period and self.duration / self.period > MOST_ROWS:
            raise BadInput(
                f"[simulation] period = {self.period:g} calls the controller more than {MOST_ROWS} times; make it longer"
            )


def _read_sweep(value: Any, where: str) -> "Sweep":
    from .distributions import Sweep  # slow to import

    return section(Sweep)(value, "[sweep]")


@dataclass(frozen=True, kw_only=True)
class Spec:
    """One closed-loop run. `parameters` is what the controller believes, `plant` where the truth differs.

    `gains` of the law by name, or kp, kd, kv for all of a kind; ki, ki_distance, ... give the law integral action.
    `sweep` is for `noslip sweep`; one run takes no notice of it.
    """

    robot: str = entry(text)
    parameters: Mapping[str, float] = entry(named_numbers, {})
    plant: Mapping[str, float] = entry(named_numbers, {})
    gains: Mapping[str, float] = entry(named_numbers, {})
    output: Output = entry(section(Output))
    reference: Reference = entry(section(Reference))
    initial: Initial | None = entry(section(Initial), None)
    limits: Limits | None = entry(section(Limits), None)
    sensors: Sensors | None = entry(section(Sensors), None)
    correction: Correction | None = entry(section(Correction), None)
    contact: Contact = entry(section(Contact), Contact())
    simulation: Simulation = entry(section(Simulation))
    sweep: "Sweep | None" = entry(_read_sweep, None)

    def __post_init__(self):
        if self.sensors and not self.simulation.period:
            raise BadInput("[sensors] needs [simulation] period > 0: what is sensed is sensed at the controller's calls")
        if self.correction and not self.sensors:
            raise BadInput("[correction] needs [sensors]: without them the pose is the true one")
        composite = self.output.segments
        if self.initial is None and not composite:
            raise BadInput("[initial] is missing: point, heading and speed, or q and nu")
        for name in ("deceleration", "creep"):
            if getattr(self.reference, name) is not None and not composite:
                raise BadInput(f"[reference] {name} is for composite paths")
        wanted, optional = ("speed", ()) if self.output.type == "IV" else ("position", ("velocity",))
        for name in ("speed", "position", "velocity"):
            given = getattr(self.reference, name) is not None
            if given and name not in (wanted, *optional):
                takes = " and ".join((wanted, *optional))
                raise BadInput(f"[reference] {name} is not for type {self.output.type}, which takes {takes}")
            if not given and name == wanted:
                raise BadInput(f"[reference] {name} is missing; type {self.output.type} needs it")


def shipped() -> dict[str, File]:
    """Return the SPECs that come with noslip: name -> file, such as line, circle, figure_8."""
    return {file.stem: file for file in sorted(SPECS.rglob("*.toml"))}


def read_text(file: File | str) -> str:
    """Return the text of a file, or of a shipped SPEC by its name. Raises BadInput, naming the file, if it cannot be read."""
    place = File(file)
    if place.name == str(file) and not place.suffix and not place.exists():
        known = shipped()
        if str(file) not in known:
            raise BadInput(f"{file}: neither a file nor a shipped SPEC{suggestion(str(file), known)}")
        place = known[str(file)]
    try:
        return read_input(place).decode()
    except OSError as error:
        raise BadInput(f"{file}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise BadInput(f"{file}: not TOML: {error}") from error


def toml_table(text: str) -> dict[str, Any]:
    """The table that a text is. Raises BadInput where it is not TOML or nested deeper than any SPEC."""
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


def spec_of(text: str, name: File | str) -> Spec:
    """The SPEC that a text is. Raises BadInput, with the `name` of the text, for anything that is none."""
    try:
        return spec_of_table(toml_table(text), name)
    except BadInput as error:
        raise BadInput(f"{name}: {error}") from error


def spec_of_table(table: Mapping[str, Any], name: File | str) -> Spec:
    """The SPEC that a table of the file `name` is; a robot's own file is looked for beside it first. Raises BadInput."""
    spec = section(Spec)(table, "")
    return dataclasses.replace(spec, robot=beside(spec.robot, name))


def read_spec(file: File | str) -> Spec:
    """Read SPEC.toml. Raises BadInput, naming the file, for anything that is not a SPEC."""
    return spec_of(read_text(file), file)
