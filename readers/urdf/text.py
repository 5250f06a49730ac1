"""Writes what was recognized in a URDF as a robot file."""

import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ...model.errors import ModelError
from ...model.mechanism import Mechanism
from ..files import MARK
from .parts import Layout, Part, Wheel
from .rims import extent

NONE = 1e-9  # m, or relative: a smaller offset is left out, a smaller difference of two wheels is none
WIDTH = 118
IMPORTED = ("cos", "sin", "Mechanism", "box", "placed", "wheels")
SIDES = ("right", "left")
ABOUT = {
    "two wheels": "two driven wheels on one axle",
    "skid steer": "skid steer, described by two driven wheels at its effective track",
    "car": "car: a fixed axle and a pair of steered wheels, described by one in the middle",
    "tricycle": "tricycle: a fixed axle and a steered wheel",
}


def name_of(text: str) -> str:
    """Return a name of a URDF as one for a robot: letters, digits and _; `_robot` is added to a reserved name."""
    name = re.sub(r"\W", "_", text, flags=re.ASCII).strip("_")
    name = name if name[:1].isalpha() else f"robot_{name}".rstrip("_")
    try:
        Mechanism(name)
    except ModelError:
        return f"{name}_robot"
    return f"{name}_robot" if name in IMPORTED else name


def robot_file(layout: Layout) -> str:
    """Return the text of a robot file whose function is named after the URDF's robot."""
    return _Writer(layout).text()


@dataclass
class _Writer:
    """The file as it grows: parameters with their sources, then the equations."""

    layout: Layout
    parameters: list[str] = field(default_factory=list)
    equations: list[str] = field(default_factory=list)
    coordinates: list[str] = field(default_factory=list)
    source: str = ""  # of the last parameter

    def text(self) -> str:
        layout = self.layout
        self.base()
        if layout.steered:
            self.steering()
        else:
            self.two_wheels()
        for k in range(len(layout.trailers)):
            self.trailer(k + 1)
        self.drawing()
        name, file = name_of(layout.document.name), layout.document.path.name
        about = f"{ABOUT[layout.kind]}, from {file}"
        if layout.trailers:
            about = f"{ABOUT[layout.kind]}, with {_count(len(layout.trailers), 'trailer')}, from {file}"
        robot = [f'robot = Mechanism("{name}", {_quoted(about)})']
        body = [*robot, *self.coordinates, "", *self.parameters, "", *self.equations, "return robot"]
        return "\n".join(
            [
                f'"""{_plain(about[0].upper() + about[1:])}. {MARK} import.',
                "",
                *textwrap.wrap(
                    "Masses and inertias include all links that a part carries, merged by parallel axes; those of a wheel are "
                    "the mean over a turn. The comments name the links and joints that numbers come from.",
                    WIDTH,
                ),
                *(["", *[line for note in layout.notes for line in _bullet(note)]] if layout.notes else []),
                '"""',
                "",
                "from casadi import cos, sin",
                "from noslip import Mechanism",
                "from noslip.model.drawing import box, placed, wheels"
                if self.placed
                else "from noslip.model.drawing import box, wheels",
                "",
                "",
                f"def {name}() -> Mechanism:",
                *[f"    {line}" if line else "" for line in body],
                "",
            ]
        )

    @property
    def placed(self) -> bool:
        return bool(self.layout.steered or self.layout.trailers)

    # -- pieces -------------------------------------------------------------------------------------------------

    def coordinate(self, name: str, unit: str, about: str, source: str = "") -> None:
        end = f"  # {_plain(source)}" if source else ""
        self.coordinates.append(f'{name} = robot.coordinate("{name}", "{unit}", "{about}"){end}')

    def parameter(self, name: str, value: float, unit: str, about: str, source: str, sign: str = "positive") -> str:
        """Add a parameter, with its source as a comment above it, and return its name."""
        wanted = f', sign="{sign}"' if sign != "positive" else ""
        if source != self.source:
            self.parameters += [f"# {line}" for line in textwrap.wrap(_plain(source), WIDTH)]
        self.source = source
        self.parameters.append(f'{name} = robot.parameter("{name}", {_number(value)}, "{unit}", "{about}"{wanted})')
        return name

    def offset(self, name: str, value: float, about: str, source: str) -> str:
        """Add a length unless it is zero, and return its name, or nothing."""
        return self.parameter(name, value, "m", about, source, "any") if abs(value) > NONE else ""

    def pair(self, name: str, values: Sequence[float], unit: str, about: str, source: str, sign: str = "positive") -> list[str]:
        """Add one parameter for equal values of the right and left side, else one each. Return the name for each value."""
        if max(values) - min(values) <= NONE * abs(values[0]):
            return [self.parameter(name, values[0], unit, about, source, sign)] * len(values)
        return [
            self.parameter(f"{name}_{side[0]}", value, unit, f"{about}, {side}", source, sign)
            for side, value in zip(SIDES, values, strict=True)
        ]

    def body(self, part: Part, name: str, suffix: str = "", about: str = "") -> tuple[str, str, str, str]:
        """Add mass, inertia and place of a body's centre of mass. Return their names; that to the left may be empty."""
        source = f"links {', '.join(part.links)}"
        what = about or name
        return (
            self.parameter(f"m{suffix}", part.mass, "kg", f"mass of the {what} with its wheels", source),
            self.parameter(
                f"I{suffix or '_z'}", part.inertia, "kg m^2", f"{what} about the vertical through its centre of mass", source
            ),
            self.parameter(f"d{suffix}", part.ahead, "m", f"centre of mass of the {what} ahead of its axle", source, "any"),
            self.offset(f"e{suffix}", part.left, f"centre of mass of the {what} to the left of its middle", source),
        )

    def shares(self, name: str, groups: Sequence[Sequence[Wheel]], about: str) -> list[str]:
        """Add the part of the weight on each group of wheels and return the names."""
        values = [sum(self.layout.shares[wheel.joint] for wheel in group) for group in groups]
        stands = [wheel.joint for group in groups for wheel in group]
        castors = list(self.layout.castors)
        source = f"centre of mass above joints {', '.join(stands)}" + (f" and links {', '.join(castors)}" if castors else "")
        return self.pair(name, values, "1", about, source, "nonnegative")

    # -- equations ----------------------------------------------------------------------------------------------

    def base(self) -> None:
        """The fixed axle: coordinates, the body on it, and no side slip."""
        layout, base = self.layout, self.layout.base
        for name in ("x", "y"):
            self.coordinate(name, "m", "middle of the axle" if layout.kind != "skid steer" else "middle of the wheels")
        self.coordinate("phi", "rad", "heading")
        about = "half the effective track" if layout.kind == "skid steer" else "half the distance between the wheels"
        source = "--skid-steer-track" if layout.kind == "skid steer" else f"joints {', '.join(w.joint for w in base.wheels)}"
        self.parameter("b", layout.half, "m", about, source)
        m, inertia, d, e = self.body(base, "body")
        others = [*(f"m_{name}" for name in self.steered_names), *(f"m_{k + 1}" for k in range(len(layout.trailers)))]
        self.total = f"({' + '.join([m, *others])})" if others else m
        self.equations += [
            "forward = cos(phi) * robot.rate(x) + sin(phi) * robot.rate(y)",
            "left = cos(phi) * robot.rate(y) - sin(phi) * robot.rate(x)",
            "turning = robot.rate(phi)",
            f'robot.body("base", {m}, {inertia}, forward{_minus(e, "turning")}, left + {d} * turning, turning)',
            'robot.rolls("no side slip of the axle", left)',
        ]

    def wheel_pair(self, part: Part, suffix: str, about: str) -> tuple[list[str], list[str]]:
        """Add radius and inertia of the wheels of an axle, right and left; those of each side count together."""
        layout = self.layout
        sides = self.sides(part)
        radii = [side[0].radius for side in sides]
        source = "; ".join(dict.fromkeys(wheel.source for side in sides for wheel in side))
        links = ", ".join(wheel.link for side in sides for wheel in side)
        count = "each wheel" if layout.kind != "skid steer" or part is not layout.base else "wheels of a side together"
        return (
            self.pair(f"r{suffix}", radii, "m", f"radius of the {about}", source),
            self.pair(
                f"I_w{suffix}",
                [sum(wheel.inertia for wheel in side) for side in sides],
                "kg m^2",
                f"{about} about the axle, {count}",
                f"links {links}",
            ),
        )

    def sides(self, part: Part) -> list[list[Wheel]]:
        """Return the wheels of a part on the right and on the left."""
        aside = [self.layout.seen(wheel.centre, part.origin)[1] for wheel in part.wheels]
        return [[wheel for wheel, left in zip(part.wheels, aside, strict=True) if (left > 0) == way] for way in (False, True)]

    def two_wheels(self) -> None:
        """Two driven wheels, or the two sides of a skid steer."""
        sides = self.sides(self.layout.base)
        several = "wheels" if self.layout.kind == "skid steer" else "wheel"
        for side, own in zip(SIDES, sides, strict=True):
            turned = ["-" * (wheel.sign < 0) + wheel.joint for wheel in own]
            self.coordinate(f"theta_{side[0]}", "rad", f"{side} {several}, positive rolls forward", f"joint {', '.join(turned)}")
        radius, inertia = self.wheel_pair(self.layout.base, "", "wheels")
        share = self.shares(
            "load",
            sides,
            "part of the weight on the wheels of a side" if several == "wheels" else "part of the weight on each wheel",
        )
        rows = [
            f'("{side}", theta_{side[0]}, {"-" * (k == 0)}b, {radius[k]}, {inertia[k]}, {share[k]})'
            for k, side in enumerate(SIDES)
        ]
        names = ["side", "theta", "aside", "radius", "inertia", "share"]
        self.equations += [
            f"for {', '.join(names)} in (",
            *[f"    {row}," for row in rows],
            "):",
            "    slip = forward - aside * turning - radius * robot.rate(theta)",
            "    robot.kinetic_energy(inertia * robot.rate(theta) ** 2 / 2)",
            f'    robot.rolls(f"{{side}} {several} roll{"s" if several == "wheel" else ""}", slip)',
            f'    robot.contact(f"{{side}} {several}", share * {self.total}, along=slip, across=left, left=aside)',
            f'    robot.input(f"tau_{{side[0]}}", "N m", on=robot.rate(theta), about=f"{{side}} {several} torque")',
            f'    robot.quasi_velocity(f"thetadot_{{side[0]}}", "rad/s", robot.rate(theta), f"{{side}} {several} rate")',
            "robot.moves_in_plane(x + d * cos(phi), y + d * sin(phi), phi)",
        ]

    @property
    def steered_names(self) -> list[str]:
        """The suffixes of the parameters of the steered parts: one in the middle, or right and left."""
        return [] if not self.layout.steered else ["s"] if len(self.layout.steered) == 1 else ["sr", "sl"]

    def steering(self) -> None:
        """A steered wheel, or a pair that turns by the angle of a wheel in their middle."""
        layout, parts = self.layout, self.layout.steered
        pair, front = len(parts) == 2, layout.front
        joints = ", ".join("-" * (part.sign < 0) + part.joint for part in parts)
        front_joints = ", ".join("-" * (part.wheels[0].sign < 0) + part.wheels[0].joint for part in parts)
        rear_joints = ", ".join("-" * (wheel.sign < 0) + wheel.joint for wheel in layout.base.wheels)
        driven = ("front wheels" if pair else "front wheel") if front else "rear wheels"
        self.coordinate("delta", "rad", "steering angle, from the body to the front wheel", f"joint {joints}")
        self.coordinate("theta", "rad", f"{driven}, positive rolls forward", f"joint {front_joints if front else rear_joints}")
        pivots = [layout.seen(part.pivot, layout.base.origin) for part in parts]
        places = [layout.seen(part.wheels[0].centre, part.pivot) for part in parts]
        self.parameter(
            "l", float(np.mean([p[0] for p in pivots])), "m", "steering axis ahead of the fixed axle", f"joint {joints}", "any"
        )
        trail = self.offset(
            "c_s", float(np.mean([p[0] for p in places])), "front wheel ahead of the steering axis", f"joint {front_joints}"
        )
        rows = []
        for name, part, pivot in zip(self.steered_names, parts, pivots, strict=True):
            what = {"s": "steered part", "sr": "right steered part", "sl": "left steered part"}[name]
            aside = self.offset(
                f"a_{name}", pivot[1], f"{what}: its steering axis to the left of the middle", f"joint {part.joint}"
            )
            rows.append((name, aside or "0", *self.body(part, what, f"_{name}")))
        (r_rear, _), inertias = self.wheel_pair(layout.base, "", "rear wheels")
        wheels = [part.wheels[0] for part in parts]
        r_front = self.parameter("r_s", wheels[0].radius, "m", "radius of the front wheel", wheels[0].source)
        i_front = self.parameter(
            "I_ws",
            sum(w.inertia for w in wheels),
            "kg m^2",
            f"{'front wheels together' if pair else 'front wheel'} about the axle",
            f"links {', '.join(w.link for w in wheels)}",
        )
        load_rear = self.shares("load_rear", [list(layout.base.wheels)], "part of the weight on the rear wheels")[0]
        load_front = self.shares("load_front", [wheels], "part of the weight on the steered wheels")[0]
        self.equations += [
            "steering, rolling = robot.rate(delta), robot.rate(theta)",
            "",
            "# along the steered wheels and to their left: the velocity of the point of the body between the steering axes",
            "front_forward = cos(delta) * forward + sin(delta) * (left + l * turning)",
            "front_left = cos(delta) * (left + l * turning) - sin(delta) * forward",
        ]
        for name, aside, mass, inertia, d, e in rows:
            ahead_there, left_there = (
                f"front_forward - cos(delta) * {aside} * turning",
                f"front_left + sin(delta) * {aside} * turning",
            )
            if aside == "0":
                ahead_there, left_there = "front_forward", "front_left"
            self.equations.append(
                f'robot.body("steered_{name}", {mass}, {inertia}, {ahead_there}{_minus(e, "(turning + steering)")}, '
                f"{left_there} + {d} * (turning + steering), turning + steering)"
            )
        across = f"front_left{_plus(trail, '(turning + steering)')}"
        # a single wheel beside its steering axis is slower or faster than that by the yaw rate
        beside = (
            ""
            if pair
            else self.offset("w_s", places[0][1], "front wheel to the left of the steering axis", f"joint {front_joints}")
        )
        along = f"front_forward{_minus(beside, '(turning + steering)')}"
        rear_spin = "rolling" if not front else f"forward / {r_rear}"
        front_spin = "rolling" if front else f"({along}) / {r_front}" if beside else f"{along} / {r_front}"
        rear_slip, front_slip = f"forward - {r_rear} * rolling", f"{along} - {r_front} * rolling"
        verb = "roll" if driven.endswith("s") else "rolls"
        self.equations += [
            f"for aside, inertia in ((-b, {inertias[0]}), (b, {inertias[1]})):",
            f"    robot.kinetic_energy(inertia * ({rear_spin} - aside / {r_rear} * turning) ** 2 / 2)",
            f"robot.kinetic_energy({i_front} * ({front_spin}) ** 2 / 2)",
            "",
            f"slip = {front_slip if front else rear_slip}",
            f"front_aside = {across}",
            'robot.rolls("no side slip of the front wheel", front_aside)',
            f'robot.rolls("{driven} {verb}", slip)',
            f'robot.contact("rear axle", {load_rear} * {self.total}, {"" if front else "along=slip, "}across=left)',
            f'robot.contact("front wheel", {load_front} * {self.total}, {"along=slip, " if front else ""}across=front_aside)',
            f'robot.input("tau_d", "N m", on=rolling, about="drive torque on the {driven}")',
            'robot.input("tau_s", "N m", on=steering, about="steering torque, against the body")',
            f'robot.quasi_velocity("thetadot", "rad/s", rolling, "rate of the {driven}")',
            'robot.quasi_velocity("deltadot", "rad/s", steering, "steering rate")',
            "pivot = placed((x, y), phi, [(l, " + (rows[0][1] if not pair else "0") + ")])[0]",
            f"front = placed(pivot, phi + delta, [({trail or 0}, {beside or 0})])[0]" if trail or beside else "front = pivot",
            "robot.moves_in_plane(front[0], front[1], phi + delta)  # the steered wheel moves like a unicycle",
            f"robot.draws(placed(front, phi + delta, [(-{r_front}, 0), ({r_front}, 0)]))",
        ]

    def trailer(self, k: int) -> None:
        """A trailer: the velocities of its axle from those of the axle before it."""
        layout, part = self.layout, self.layout.trailers[k - 1]
        before = layout.trailers[k - 2] if k > 1 else layout.base
        after = f"_{k - 1}" if k > 1 else ""
        self.coordinate(f"phi_{k}", "rad", f"heading of trailer {k}", f"phi{after} {'+-'[part.sign < 0]} joint {part.joint}")
        length = layout.seen(part.pivot, part.origin)[0]
        hitch = layout.seen(part.pivot, before.origin)[0]
        joints = f"joint {part.joint}; joints {', '.join(wheel.joint for wheel in part.wheels)}"
        self.parameter(f"l_{k}", length, "m", f"from the hitch of trailer {k} to its axle", joints, "any")
        a = self.offset(f"a_{k}", hitch, f"hitch of trailer {k} ahead of the axle before it", f"joint {part.joint}")
        aside = layout.seen(part.wheels[1].centre, part.origin)[1]
        b = self.parameter(f"b_{k}", aside, "m", f"half the distance between the wheels of trailer {k}", joints)
        mass, inertia, d, e = self.body(part, f"trailer {k}", f"_{k}")
        (r, _), inertias = self.wheel_pair(part, f"_{k}", f"wheels of trailer {k}")
        load = self.shares(f"load_{k}", [list(part.wheels)], f"part of the weight on trailer {k}'s wheels")[0]
        self.equations += [
            "",
            f"fold = phi{after} - phi_{k}",
            f"turning_{k} = robot.rate(phi_{k})",
            f"at_hitch = left{after}{_plus(a, f'turning{after}')}",
            f"forward_{k} = cos(fold) * forward{after} - sin(fold) * at_hitch",
            f"left_{k} = sin(fold) * forward{after} + cos(fold) * at_hitch - l_{k} * turning_{k}",
            f'robot.body("trailer_{k}", {mass}, {inertia}, forward_{k}{_minus(e, f"turning_{k}")}, '
            f"left_{k} + {d} * turning_{k}, turning_{k})",
            f"for aside, inertia in ((-{b}, {inertias[0]}), ({b}, {inertias[1]})):",
            f"    robot.kinetic_energy(inertia * ((forward_{k} - aside * turning_{k}) / {r}) ** 2 / 2)",
            f'robot.rolls("no side slip of trailer {k}", left_{k})',
            f'robot.contact("trailer {k}", {load} * {self.total}, across=left_{k})',
            f"axle_{k} = placed(placed({f'axle_{k - 1}' if k > 1 else '(x, y)'}, phi{after}, [({a or 0}, 0)])[0], "
            f"phi_{k}, [(-l_{k}, 0)])[0]",
        ]

    def drawing(self) -> None:
        """The outline of each part from its shapes, else from its wheels."""
        layout = self.layout
        for k, part in enumerate((layout.base, *layout.trailers)):
            corners = np.array([layout.seen(corner, part.origin) for corner in extent(layout.document, list(part.links))])
            r = part.wheels[0].radius
            if not len(corners):
                corners = np.array([(-r, -layout.half), (r, layout.half)])
            sizes = [-corners[:, 0].min(), corners[:, 0].max(), np.abs(corners[:, 1]).max()]
            behind, ahead, half = (f"{max(size, r / 2):.3g}" for size in sizes)
            place, heading = (f"axle_{k}", f"phi_{k}") if k else ("(x, y)", "phi")
            b, radius = (f"b_{k}", f"r_{k}") if k else ("b", self.drawn_radius())
            lines = f"box({place}, {heading}, {behind}, {ahead}, {half}), *wheels({place}, {heading}, {b}, {radius})"
            self.equations.append(f"robot.draws({lines})")

    def drawn_radius(self) -> str:
        return next(line.split(" =")[0] for line in self.parameters if re.match(r"r(_r)? = ", line))


def _number(value: float) -> str:
    """Return a number with 12 digits."""
    text = f"{value:.12g}"
    return text if re.search(r"[.e]", text) else f"{text}.0"


def _minus(name: str, rate: str) -> str:
    return f" - {name} * {rate}" if name else ""


def _plus(name: str, rate: str) -> str:
    return f" + {name} * {rate}" if name else ""


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'s' * (number != 1)}"


def _plain(text: str) -> str:
    """Return a text of a URDF as it may stand in a comment or a docstring: on one line, without quotation marks."""
    return "".join(c if c.isprintable() else " " for c in text).replace("\\", "/").replace('"', "'")


def _quoted(text: str) -> str:
    return f'"{_plain(text)}"'


def _bullet(note: str) -> list[str]:
    return textwrap.wrap(_plain(note), WIDTH, initial_indent="- ", subsequent_indent="  ")
