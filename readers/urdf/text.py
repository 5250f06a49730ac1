"""Writes what was recognized in a URDF as a robot file: its parameters here,
its equations in templates/robot.txt."""

import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np

from ...model.errors import ModelError
from ...model.mechanism import Mechanism
from ..files import MARK
from ..templates import render
from .parts import UP, Layout, LinkWheel, Part
from .rims import extent

# Relative, of lengths to half the track: a smaller offset is none, as is a smaller difference of two wheels
NONE = 1e-10
WIDTH = 118
SIDES = ("right", "left")
WHERE = {"fr": "front right", "fl": "front left", "rr": "rear right", "rl": "rear left"}
IMPORTED = ("cos", "sin", "Mechanism", "box", "placed", "wheels", "config")
ABOUT = {
    "two wheels": "two driven wheels on one axle",
    "mecanum": "four wheels with rollers (mecanum)",
    "skid steer": "skid steer, described by two driven wheels at its effective track",
    "car": "car: a fixed axle and a pair of steered wheels, described by one in the middle",
    "tricycle": "tricycle: a fixed axle and a steered wheel",
}
WORDS = (
    "Masses and inertias include all links that a part carries, merged by parallel axes; those of a wheel "
    "are the mean over a turn. The comments name the links and joints that the numbers below them come from."
)


def name_of(text: str) -> str:
    """Return a name of a URDF as one for a robot: letters, digits and _;
    `_robot` is added to a reserved name."""
    name = re.sub(r"\W", "_", text, flags=re.ASCII).strip("_")
    name = name if name[:1].isalpha() else f"robot_{name}".rstrip("_")
    try:
        Mechanism(name)
    except ModelError:
        return f"{name}_robot"
    return f"{name}_robot" if name in IMPORTED else name


def robot_file(layout: Layout) -> str:
    """Return the text of a robot file whose function is named after the URDF's robot."""
    count = len(layout.trailers)
    pulled = f", with {count} trailer{'s' * (count > 1)}" if count else ""
    about = _plain(f"{ABOUT[layout.kind]}{pulled}, from {layout.document.path.name}")
    notes = [
        line
        for note in layout.notes
        for line in textwrap.wrap(f"- {_plain(note)}", WIDTH, subsequent_indent="  ")
    ]
    return render(
        __file__,
        "robot.txt",
        robot=name_of(layout.document.name),
        about=about,
        title=about[0].upper() + about[1:],
        mark=MARK,
        words=[*textwrap.wrap(WORDS, WIDTH), *([""] if notes else []), *notes],
        minus=lambda name, rate: _term("-", name, rate),
        plus=lambda name, rate: _term("+", name, rate),
        lookahead=_number(round(layout.half, 3)),
        **_Names(layout).collected(),
    )


@dataclass
class _Names:
    """Coordinates and parameters as they are written, each with its source as a comment,
    and their names for the equations."""

    layout: Layout
    coordinates: list[str] = field(default_factory=list)
    parameters: list[str] = field(default_factory=list)
    masses: list[str] = field(default_factory=list)
    source: str = ""  # of the last parameter

    def collected(self) -> dict[str, object]:
        """Return what the template needs."""
        layout = self.layout
        driven = (
            self.mecanum if layout.kind == "mecanum" else self.steering if layout.steered else self.two_wheels
        )
        entries = {"corners": [], "steered": [], "base": self.base(), **driven()}
        arm = [self.link(k) for k in range(1, len(layout.arm) + 1)]
        entries["castors"] = self.castors()
        angles = ", ".join(f'("angle_{link.k}", "rad", q_{link.k}, "joint {link.joint}")' for link in arm)
        entries |= {"arm": arm, "angles": angles}
        entries["trailers"] = [self.trailer(k) for k in range(1, len(layout.trailers) + 1)]
        total = f"({' + '.join(self.masses)})" if len(self.masses) > 1 else self.masses[0]
        return {"coordinates": self.coordinates, "parameters": self.parameters, "total": total, **entries}

    # -- coordinates and parameters --------------------------------------------------------------------------

    def coordinate(self, name: str, unit: str, about: str, source: str = "") -> None:
        """Add a coordinate."""
        self.coordinates += _comment(source)
        self.coordinates.append(f'{name} = robot.coordinate("{name}", "{unit}", "{about}")')

    def parameter(
        self, name: str, value: float, unit: str, about: str, source: str, sign: str = "positive"
    ) -> str:
        """Add a parameter and return its name."""
        sign = f', sign="{sign}"' if sign != "positive" else ""
        self.parameters += _comment(source) if source != self.source else []
        self.source = source
        self.parameters.append(
            f'{name} = robot.parameter("{name}", {_number(value)}, "{unit}", "{about}"{sign})'
        )
        return name

    def pair(
        self, name: str, values: Sequence[float], unit: str, about: str, source: str, sign: str = "positive"
    ) -> list[str]:
        """Add one parameter for equal values of the right and left side,
        else one each. Return the name for each value."""
        if max(values) - min(values) <= NONE * abs(values[0]):
            return [self.parameter(name, values[0], unit, about, source, sign)] * len(values)
        sides = {side[0]: side for side in SIDES} if len(values) == 2 else WHERE
        return [
            self.parameter(f"{name}_{key}", value, unit, f"{about}, {side}", source, sign)
            for (key, side), value in zip(sides.items(), values, strict=True)
        ]

    def signed(self, name: str, values: Sequence[float], unit: str, about: str, source: str) -> list[str]:
        """Add one parameter for values that are equal up to their signs,
        else one each. Return the term for each value."""
        if max(map(abs, values)) - min(map(abs, values)) > NONE * abs(values[0]):
            return self.pair(name, values, unit, about, source, "any")
        self.parameter(name, abs(values[0]), unit, about, source)
        return ["-" * (value < 0) + name for value in values]

    def offsets(self, name: str, values: Sequence[float], about: str, source: str) -> list[str]:
        """Add lengths as `pair` does, one for values that are opposite; nothing for zero,
        whose name is empty."""
        none = NONE * self.layout.half
        if max(map(abs, values)) <= none:
            return [""] * len(values)
        if len(values) == 2 and abs(sum(values)) <= none:
            self.parameter(name, values[1], "m", f"{about}, at the left", source, "any")
            return [f"-{name}", name]
        return self.pair(name, values, "m", about, source, "any")

    # -- parts -----------------------------------------------------------------------------------------------

    def base(self) -> SimpleNamespace:
        """The body with its fixed axle."""
        layout, part = self.layout, self.layout.base
        skid, corners = layout.kind == "skid steer", layout.kind == "mecanum"
        for name in ("x", "y"):
            self.coordinate(name, "m", "middle of the wheels" if skid or corners else "middle of the axle")
        self.coordinate("phi", "rad", "heading")
        if corners:
            return SimpleNamespace(
                e=self.body(part, "", "I_z", "the body", "the middle of its wheels"), box=self.box(part)
            )
        about = "half the effective track" if skid else "half the distance between the wheels"
        self.parameter("b", layout.half, "m", about, "--skid-steer-track" if skid else _joints(part.wheels))
        return SimpleNamespace(
            e=self.body(part, "", "I_z", "the body"), box=self.box(part), **vars(self.axle(part, ""))
        )

    def body(
        self,
        part: Part,
        suffix: str,
        inertia: str,
        name: str,
        origin: str = "its axle",
        about: str = " with its wheels",
    ) -> str:
        """Add mass, inertia and centre of mass of a part on an axle. Return the name of its offset to the
        left, or nothing."""
        source = f"links {', '.join(part.links)}"
        self.masses.append(self.parameter(f"m{suffix}", part.mass, "kg", f"mass of {name}{about}", source))
        self.parameter(
            inertia, part.inertia, "kg m^2", f"{name} about the vertical through its centre of mass", source
        )
        ahead = part.ahead if abs(part.ahead) > NONE * self.layout.half else 0.0
        self.parameter(f"d{suffix}", ahead, "m", f"centre of mass of {name} ahead of {origin}", source, "any")
        self.parameter(
            f"h{suffix}", part.height, "m", f"centre of mass of {name} above the ground", source, "any"
        )
        return self.offsets(
            f"e{suffix}", [part.left], f"centre of mass of {name} to the left of its middle", source
        )[0]

    def axle(self, part: Part, suffix: str) -> SimpleNamespace:
        """Add radius and inertia of the wheels of an axle, right and left;
        those of each side count together."""
        sides = self.sides(part)
        links = ", ".join(wheel.link for side in sides for wheel in side)
        source = "; ".join(dict.fromkeys(wheel.source for side in sides for wheel in side))
        radii = self.pair(
            f"r{suffix}", [side[0].radius for side in sides], "m", "radius of the wheels", source
        )
        about = (
            "a wheel about its axle"
            if len(sides[0]) == 1
            else "the wheels of a side together, about their axles"
        )
        inertias = self.pair(
            f"I_w{suffix}",
            [sum(w.inertia for w in side) for side in sides],
            "kg m^2",
            about,
            f"links {links}",
        )
        return SimpleNamespace(r=radii, I_w=inertias)

    def two_wheels(self) -> dict[str, object]:
        """Two driven wheels, or the two sides of a skid steer."""
        sides = self.sides(self.layout.base)
        wheel = "wheel" if len(sides[0]) == 1 else "wheels"
        for side, own in zip(SIDES, sides, strict=True):
            self.coordinate(
                f"theta_{side[0]}", "rad", f"{side} {wheel}, positive rolls forward", _angles(own)
            )
        load = self.loads("load", sides, f"part of the weight on the {wheel} of a side")
        places = [
            [self.layout.seen(w.centre, self.layout.base.origin) for w in side]
            for side in sides
            if len(side) > 1
        ]
        written = [f"[{', '.join(f'({_number(a)}, {_number(b)})' for a, b in side)}]" for side in places]
        return {"wheel": wheel, "load": load, "places": written}

    def castors(self) -> list[SimpleNamespace]:
        """The castors that carry a part of the weight.

        Those of a robot with trailers are not named: its loads would then be those of one rigid body.
        """
        layout = self.layout
        carrying = [link for link, load in layout.on_castors.items() if load > NONE and not layout.trailers]
        made = []
        for k, link in enumerate(carrying, 1):
            ahead, left = layout.seen(layout.castors[link], layout.base.origin)
            which = f"castor {k}" if len(carrying) > 1 else "the castor"
            a = self.parameter(
                f"a_c{k}", ahead, "m", f"{which} ahead of the middle of the wheels", f"link {link}", "any"
            )
            b = self.offsets(f"b_c{k}", [left], f"{which} to the left of the middle", f"link {link}")[0]
            load = self.parameter(
                f"load_c{k}", layout.on_castors[link], "1", f"part of the weight on {which}", f"link {link}"
            )
            made.append(SimpleNamespace(name=_plain(link), a=a, b=b, load=load))
        return made

    def mecanum(self) -> dict[str, object]:
        """Four wheels with rollers."""
        layout, wheels = self.layout, list(self.layout.corners.values())
        for corner, wheel in layout.corners.items():
            about = f"{WHERE[corner]} wheel, positive rolls forward"
            self.coordinate(f"theta_{corner}", "rad", about, _angles([wheel]))
        ahead, left = zip(*(layout.seen(wheel.centre, layout.base.origin) for wheel in wheels), strict=True)
        links = f"links {', '.join(wheel.link for wheel in wheels)}"
        rims = "; ".join(dict.fromkeys(wheel.source for wheel in wheels))
        rollers = [0.0 if wheel.roller is None else wheel.roller for wheel in wheels]
        columns = (
            [f"theta_{corner}" for corner in layout.corners],
            self.signed("a", ahead, "m", "wheels ahead of and behind the middle", _joints(wheels)),
            self.signed("b", left, "m", "wheels to the left and right of the middle", _joints(wheels)),
            self.signed(
                "gamma", rollers, "rad", "axis of the roller on the ground, from ahead to the left", rims
            ),
            self.pair("r", [wheel.radius for wheel in wheels], "m", "radius of the wheels", rims),
            self.pair("I_w", [wheel.inertia for wheel in wheels], "kg m^2", "a wheel about its axle", links),
            self.loads("load", [[wheel] for wheel in wheels], "part of the weight on a wheel"),
        )
        names = ("theta", "a", "b", "gamma", "r", "I_w", "load")
        rows = zip(layout.corners, *columns, strict=True)
        return {
            "corners": [
                SimpleNamespace(at=c, where=WHERE[c], **dict(zip(names, row, strict=True)))
                for c, *row in rows
            ]
        }

    def steering(self) -> dict[str, object]:
        """A steered wheel, or a pair that turns by the angle of a wheel in their middle."""
        layout, parts = self.layout, self.layout.steered
        wheels, rear = [part.wheels[0] for part in parts], layout.base.wheels
        turned = "front wheel" if len(parts) == 1 else "front wheels"
        driven = turned if layout.front else "rear wheels"
        self.coordinate("delta", "rad", "steering angle, from the body to the front wheel", _angles(parts))
        self.coordinate(
            "theta", "rad", f"{driven}, positive rolls forward", _angles(wheels if layout.front else rear)
        )
        axes = np.array([layout.seen(part.pivot, layout.base.origin) for part in parts])
        places = np.array([layout.seen(part.wheels[0].centre, part.pivot) for part in parts])
        joints, links = _joints(parts), f"links {', '.join(link for part in parts for link in part.links)}"
        self.parameter(
            "l", float(axes[:, 0].mean()), "m", "steering axis ahead of the fixed axle", joints, "any"
        )
        a = self.offsets("a_s", list(axes[:, 1]), "steering axis to the left of the middle", joints)
        ahead = self.offsets(
            "c_s", [float(places[:, 0].mean())], "front wheel ahead of the steering axis", _joints(wheels)
        )[0]
        beside = float(places[0, 1]) if len(parts) == 1 else 0.0  # a pair is described by a wheel on the axis
        aside = self.offsets(
            "w_s", [beside], "front wheel to the left of the steering axis", _joints(wheels)
        )[0]
        m = self.pair(
            "m_s", [part.mass for part in parts], "kg", "mass of a steered part with its wheel", links
        )
        about = "a steered part about the vertical through its centre of mass"
        inertia = self.pair("I_s", [part.inertia for part in parts], "kg m^2", about, links)
        d = self.offsets(
            "d_s", [part.ahead for part in parts], "its centre of mass ahead of the steering axis", links
        )
        e = self.offsets(
            "e_s", [part.left for part in parts], "its centre of mass to the left of the steering axis", links
        )
        h = self.pair(
            "h_s", [part.height for part in parts], "m", "its centre of mass above the ground", links, "any"
        )
        self.masses += m
        self.parameter("r_s", wheels[0].radius, "m", f"radius of the {turned}", wheels[0].source)
        of_wheels = f"links {', '.join(wheel.link for wheel in wheels)}"
        self.parameter(
            "I_ws", sum(wheel.inertia for wheel in wheels), "kg m^2", f"{turned} about the axle", of_wheels
        )
        self.loads("load_rear", [rear], "part of the weight on the rear wheels")
        self.loads("load_front", [wheels], f"part of the weight on the {turned}")
        names = ["steered"] if len(parts) == 1 else [f"steered_{side}" for side in SIDES]
        rows = zip(names, m, inertia, d, e, a, h, strict=True)
        return {
            "steered": [
                SimpleNamespace(**dict(zip(("name", "m", "I", "d", "e", "a", "h"), row, strict=True)))
                for row in rows
            ],
            "front": SimpleNamespace(ahead=ahead, aside=aside),
            "driven": driven,
            "driven_in_front": layout.front,
        }

    def trailer(self, k: int) -> SimpleNamespace:
        """A body behind a hitch, with its axle."""
        layout, part = self.layout, self.layout.trailers[k - 1]
        before, after = (layout.trailers[k - 2], f"_{k - 1}") if k > 1 else (layout.base, "")
        joint = _joints([part])
        self.coordinate(
            f"phi_{k}", "rad", f"heading of trailer {k}", f"{_angles([part])}, against phi{after}"
        )
        length, aside = (
            layout.seen(part.pivot, part.origin)[0],
            layout.seen(part.wheels[1].centre, part.origin)[1],
        )
        self.parameter(f"l_{k}", length, "m", f"from the hitch of trailer {k} to its axle", joint, "any")
        hitch = layout.seen(part.pivot, before.origin)[0]
        a = self.offsets(f"a_{k}", [hitch], f"hitch of trailer {k} ahead of the axle before it", joint)[0]
        self.parameter(
            f"b_{k}", aside, "m", f"half the distance between the wheels of trailer {k}", _joints(part.wheels)
        )
        e = self.body(part, f"_{k}", f"I_{k}", f"trailer {k}")
        axle = self.axle(part, f"_{k}")
        self.loads(f"load_{k}", [part.wheels], f"part of the weight on the wheels of trailer {k}")
        return SimpleNamespace(k=k, after=after, a=a, e=e, box=self.box(part), **vars(axle))

    def link(self, k: int) -> SimpleNamespace:
        """A link of an arm on its vertical joint."""
        layout, part = self.layout, self.layout.arm[k - 1]
        before, joint, name = layout.carrier(part), _joints([part]), f"link {k} of the arm"
        after = "" if before is layout.base else f"_q{layout.arm.index(before) + 1}"
        self.coordinate(f"q_{k}", "rad", f"{name}, from what carries it", _angles([part]))
        ahead, aside = layout.seen(part.pivot, before.origin)
        middle = "the middle of the wheels" if layout.kind in ("mecanum", "skid steer") else "the axle"
        about = f"joint {k} of the arm ahead of {f'joint {after[2:]} of the arm' if after else middle}"
        a = self.offsets(f"l_q{k}", [ahead], about, joint)[0]
        w = self.offsets(f"w_q{k}", [aside], f"joint {k} of the arm to the left of it", joint)[0]
        e = self.body(part, f"_q{k}", f"I_q{k}", name, "its joint", "")
        tips = [layout.seen(each.pivot, part.origin) for each in layout.arm if layout.carrier(each) is part]
        tip = tips[0] if tips else (2 * part.ahead, 2 * part.left)
        return SimpleNamespace(
            k=k, after=after, a=a, w=w, e=e, joint=_plain(part.joint), tip=f"{tip[0]:.3g}, {tip[1]:.3g}"
        )

    def loads(self, name: str, groups: Sequence[Sequence[LinkWheel]], about: str) -> list[str]:
        """Add the part of the weight on each group of wheels and return the names."""
        values = [sum(self.layout.shares[wheel.joint] for wheel in group) for group in groups]
        stands = _joints([wheel for group in groups for wheel in group])
        others = f" beside links {', '.join(self.layout.castors)}" if self.layout.castors else ""
        return self.pair(name, values, "1", about, f"centre of mass above {stands}{others}", "nonnegative")

    def sides(self, part: Part) -> list[list[LinkWheel]]:
        """Return the wheels of a part on the right and on the left."""
        aside = [self.layout.seen(wheel.centre, part.origin)[1] for wheel in part.wheels]
        return [
            [wheel for wheel, left in zip(part.wheels, aside, strict=True) if (left > 0) == way]
            for way in (False, True)
        ]

    def box(self, part: Part) -> str:
        """Return how far a part reaches behind, ahead and aside, from its shapes, else from a wheel."""
        corners, heading = extent(self.layout.document, part.links) - part.origin, self.layout.heading
        radius = part.wheels[0].radius
        ahead, left = (
            [*(corners @ axis), -radius / 2, radius / 2] for axis in (heading, np.cross(UP, heading))
        )
        return f"{-min(ahead):.3g}, {max(ahead):.3g}, {max(map(abs, left)):.3g}"


def _joints(items: Sequence[Part | LinkWheel]) -> str:
    return f"joint{'s' * (len(items) > 1)} {', '.join(item.joint for item in items)}"


def _angles(items: Sequence[Part | LinkWheel]) -> str:
    """Return the angles of joints, with a minus if they are the negative of the coordinate."""
    return (
        f"angle{'s' * (len(items) > 1)} of {', '.join('-' * (item.sign < 0) + item.joint for item in items)}"
    )


def _comment(source: str) -> list[str]:
    return [f"# {line}" for line in textwrap.wrap(_plain(source), WIDTH)]


def _number(value: float) -> str:
    """Return a number with 12 digits."""
    text = f"{value:.12g}"
    return text if re.search(r"[.e]", text) else f"{text}.0"


def _term(sign: str, name: str, rate: str) -> str:
    """Return a term of a velocity, such as ` - e * turning`; nothing for an empty name."""
    if name.startswith("-"):
        sign, name = "-+"[sign == "-"], name[1:]
    return f" {sign} {name} * {rate}" if name else ""


def _plain(text: str) -> str:
    """Return a text of a URDF as it may stand in a comment or a string: on one line,
    without quotation marks."""
    return "".join(c if c.isprintable() else " " for c in text).replace("\\", "/").replace('"', "'")
