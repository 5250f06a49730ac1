"""Recognizes a URDF as a robot that rolls: its wheels, steered parts and trailers, castors,
and what is held fixed."""

import itertools
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import BadInput, suggestion
from .document import NO_BODY, Document
from .inertial import Inertial, merged
from .parts import UP, Layout, LinkWheel, Options, Part, ahead_and_left
from .rims import ALIGNED, ON_LINE, ROUND, NotRound, Rim, bottoms, lies_on, rim, span
from .rollers import rollers_of, steerable, wheel_with_rollers
from .statics import shares
from .straight import straightened

CASTOR = re.compile(r"cast[eo]r|swivel|ball_?wheel", re.IGNORECASE)
STEERS = re.compile(r"steer", re.IGNORECASE)
WHEEL = re.compile(r"wheel", re.IGNORECASE)
ROLLERS = re.compile(r"mec+h?an+um|swedish|omni", re.IGNORECASE)
# Words in names, as in rear_left, rl_wheel, LeftWheel
LEFT = ("left", "l", "fl", "bl", "rl", "lf", "lb", "lr", "wheell")
RIGHT = ("right", "r", "fr", "br", "rr", "rf", "rb", "wheelr")
GROUND = 0.15  # of the radius: heights at which a wheel or castor touches the ground
RAISED = 0.01  # of the radius: heights above the ground that are said
NONE = 1e-9  # relative: differences that are those of printed numbers
EQUAL = 0.01  # relative: radii that are described by one
PRINTED = 1e-4  # relative: radii of two wheels that differ as the numbers of a mesh do
SIZES = 0.005, 20.0  # m: distances of wheels that robots have
UNLIKELY = 10.0  # times the distance of the wheels: a radius of gyration of the body that none has
HOOP = 1.2  # times its mass and its radius squared: the inertia of a wheel about its axle that none has
# Of the radius: a wheel so far behind a vertical joint is a castor's, unless the joint is driven or said to
# steer
TRAIL = 0.2
ACKERMANN = 0.5  # relative: difference of the angles of two steered wheels
# How many times larger or smaller than the distance of the wheels a radius may be: meshes are in mm, or m
SLENDER = 50
UNEVEN = 1e-3  # relative: how far from a body of revolution a wheel may be without a note
UNBALANCED = 0.1  # of the radius: how far its centre of mass may be from the axle


def recognize(document: Document, options: Options) -> Layout:
    """Return the layout of the robot. Raises BadInput, naming joints and links, if a robot file cannot
    describe it.

    Joints that are out of line within the tolerances are moved into line first; the notes say how far.
    """
    try:
        layout = _Recognition(document, options).layout()
        straight, moved = straightened(layout)
        if not moved:
            return layout
        said = f"joints were moved so that wheels are in line and their axes parallel: {'; '.join(moved)}"
        layout = _Recognition(straight, options).layout()
        return replace(layout, notes=(*layout.notes, said), original=document)
    except BadInput as error:
        named = [name for name in sorted(document.without_axis) if repr(name) in str(error)]
        if not named:
            raise
        raise BadInput(f"{error}; without <axis>, so that it is 1 0 0: joints {_joints(named)}") from error


class _Recognition:
    """The steps of `recognize`, with what they share."""

    def __init__(self, document: Document, options: Options):
        self.document, self.options, self.notes = document, options, list(document.notes)
        both = {*document.joints, *document.links}
        for option, names, candidates in (
            ("--wheels", options.wheels, document.joints),
            ("--castors", options.castors, both),
            ("--radius", options.radii, document.links),
            ("--rollers", options.rollers, document.joints),
            ("--arm", options.arm, document.joints),
        ):
            for name in names:
                if name not in candidates:
                    raise self.wrong(f"{option}: there is no {name!r}{suggestion(name, candidates)}")
        on_wheels = {name: rollers_of(document, joint) for name, joint in document.joints.items()}
        self.rollers = {name: rollers for name, rollers in on_wheels.items() if rollers}
        self.on_rims = {roller.name for rollers in self.rollers.values() for roller in rollers}
        self.placing = self.placing_joints()
        self.beyond_hoops: list[str] = []

    def placing_joints(self) -> list[str]:
        """Return the joints by which a file places its robot in the world:
        those that carry all that has a mass or a shape."""
        document, joints, link = self.document, [], self.document.root
        while len(below := document.below(link)) == 1:
            body = document.links[link]
            if document.inertial(link) or body.visuals or body.collisions:
                break
            joints.append(below[0])
            link = below[0].child
        moving = [joint.name for joint in joints if joint.type != "fixed"]
        if moving:
            names = ", ".join(moving)
            self.notes.append(
                f"joints {names} place the robot in the world, as its coordinates do; they are held at zero"
            )
        return moving

    def wrong(self, message: str) -> BadInput:
        return BadInput(f"{self.document.path}: {message}")

    def layout(self) -> Layout:
        document, options = self.document, self.options
        if not any(map(document.inertial, document.links)):
            raise self.wrong("no link has an <inertial> with a mass; a model needs masses and inertias")
        if impossible := document.impossible_inertias:
            self.notes.append(f"{NO_BODY}: links {', '.join(impossible)}")
        self.refuse_rollers()
        wheels = self.wheels()
        self.ground = min(wheel.centre[2] - wheel.radius for wheel in wheels)
        self.turning = {wheel.joint: self.turning_joint(wheel) for wheel in wheels}
        named = {*options.wheels, *options.rollers, *self.rollers}
        for wheel in wheels:
            if wheel.joint in {*options.rollers, *self.rollers} and (turning := self.turning[wheel.joint]):
                raise self.wrong(
                    f"joint {wheel.joint!r} is a wheel with rollers on the vertical joint {turning!r}; make "
                    "that fixed"
                )
        self.castors = {
            w.link: w.centre for w in wheels if w.joint not in named and self.is_castor(w, wheels)
        }
        self.castor_links = {link: link for link in self.castors}  # by the name of a castor
        wheels = [wheel for wheel in wheels if wheel.link not in self.castors]
        extra = [wheel for wheel in wheels if options.wheels and wheel.joint not in options.wheels]
        if extra:
            raise self.wrong(
                f"joint {extra[0].joint!r} is a wheel, too; name it in --wheels, or in --castors if it is one"
            )
        fixed = [wheel for wheel in wheels if self.turning[wheel.joint] is None]
        if len(fixed) < 2:
            raise self.wrong(
                f"wheels on {document.root!r}, without castors and those on vertical joints: "
                f"{_joints(fixed) or 'none'}; {self.unused()}a robot file describes a body on an axle of two "
                "wheels, which turn on continuous joints"
            )
        self.heading = self.common_heading(wheels)
        self.castors |= self.fixed_castors(wheels)
        fixed = self.equal(fixed, EQUAL if options.track or len(fixed) < len(wheels) else PRINTED)
        kind, half, origin = self.axle(fixed)
        groups: dict[str, list[LinkWheel]] = {}
        for wheel in wheels:
            if joint := self.turning[wheel.joint]:
                groups.setdefault(joint, []).append(wheel)
        arm = self.arm(wheels)
        self.check_masses(fixed, wheels)
        self.compare_names(wheels, origin)
        self.hold([*(wheel.joint for wheel in wheels), *self.on_rims, *arm], groups, GROUND * fixed[0].radius)
        steering = [joint for joint, own in groups.items() if self.steers(joint, own)]
        alike = {
            wheel.joint: wheel
            for wheel in self.equal([w for joint in steering for w in groups[joint]], EQUAL)
        }
        groups = {
            joint: [alike.get(wheel.joint, wheel) for wheel in self.equal(own, EQUAL)]
            for joint, own in groups.items()
        }
        self.carrying = {document.joints[joint].child: joint for joint in (*groups, *arm)}
        base = self.part("", fixed, origin)
        steered = self.steered(
            [self.part(joint, groups[joint], self.pivot(joint)) for joint in steering], base
        )
        trailers = self.chain({joint: own for joint, own in groups.items() if joint not in steering}, base)
        if steered and base.wheels[0].radius != base.wheels[1].radius:
            raise self.wrong(
                f"joints {_joints(fixed)}: the radii of the wheels differ; beside steered wheels that is not "
                "described"
            )
        if kind == "mecanum" and groups:
            raise self.wrong(
                f"joints {', '.join(groups)}: steered wheels and trailers beside wheels with rollers are not "
                "described"
            )
        if steered:
            if kind != "two wheels":
                raise self.wrong(
                    f"wheels on several axles ({_joints(fixed)}) and steered wheels ({_joints(groups)})"
                )
            kind = "car" if len(steered) == 2 else "tricycle"
        front = self.driven_in_front(fixed, steered)
        links = tuple(self.part(joint, [], self.pivot(joint)) for joint in arm)
        for joint in arm:
            if above := [each.name for each in self.ancestors(joint) if each.name in groups]:
                raise self.wrong(
                    f"--arm: joint {joint!r} is on joint {above[0]!r}, not on the body; that is not described"
                )
        if arm:
            self.notes.append(
                "the contacts carry what they do with the arm at zero; their loads do not follow its motion"
            )
        if self.beyond_hoops:
            self.notes.append(
                "the inertia about the axle is larger than that of a hoop of the same mass and radius; "
                "correct <inertia>, unless it contains that of a geared motor: links "
                f"{', '.join(self.beyond_hoops)}"
            )
        weights, on_castors, stable = shares(base, (*steered, *links), trailers, self.castors, self.heading)
        if not stable:
            self.notes.append(
                "the centre of mass is not above the supports; the wheels are taken to carry all the weight; "
                "name by --castors what else the robot stands on"
            )
        return Layout(
            document,
            kind,
            self.heading,
            half,
            base,
            steered,
            trailers,
            front,
            self.castors,
            weights,
            on_castors,
            tuple(dict.fromkeys(self.notes)),
            links,
        )

    # -- wheels ----------------------------------------------------------------------------------------------

    def refuse_rollers(self) -> None:
        """Raise BadInput for wheels that are named as if they had rollers, or whose links or meshes are,
        whose direction is not known."""
        document = self.document
        for joint in document.joints.values():
            if joint.type in ("floating", "planar") and joint.name not in self.placing:
                raise self.wrong(
                    f"joint {joint.name!r} is {joint.type}; a robot file has revolute and fixed joints"
                )
            if joint.name in {
                *self.rollers,
                *self.on_rims,
                *self.options.rollers,
                *self.options.wheels,
                *self.placing,
            }:
                continue
            if joint.type not in ("continuous", "revolute") or abs(document.axis(joint)[2]) > math.sin(
                ALIGNED
            ):
                continue
            links = [
                document.links[link]
                for link in document.subtree(joint.child, lambda below: below.type == "fixed")
            ]
            shapes = [shape.geometry.mesh for link in links for shape in (*link.visuals, *link.collisions)]
            meshes = [mesh.filename for mesh in shapes if mesh is not None]
            for name in (joint.name, *(link.name for link in links), *meshes):
                if ROLLERS.search(name):
                    raise self.wrong(
                        f"joint {joint.name!r}: {name!r} is a wheel with rollers (mecanum or "
                        "omnidirectional), but they have no joints; give the direction of the axis of the "
                        f"roller on the ground, from ahead to the left, by --rollers {joint.name}='45 deg', "
                        "or -45 deg; if it has none, name all wheels by --wheels"
                    )

    def wheels(self) -> list[LinkWheel]:
        """Return the wheels that stand on the ground, those of castors included. Raises BadInput if there are
        none."""
        document, named = self.document, self.options.wheels
        wheels: list[LinkWheel] = []
        self.reasons: dict[str, str] = {}  # why joints that turn are no wheels
        for joint in document.joints.values():
            if joint.name in named or (joint.type == "continuous" and joint.name not in self.on_rims):
                try:
                    wheels.append(self.wheel(joint))
                except NotRound as error:
                    self.reasons[joint.name] = str(error)
        lowest_named = [
            wheel.centre[2] - wheel.radius for wheel in wheels if not named or wheel.joint in named
        ]
        for wheel in list(wheels):
            height = wheel.centre[2] - wheel.radius - min(lowest_named, default=0.0)
            if abs(height) > GROUND * wheel.radius:
                self.reasons[wheel.joint] = (
                    f"its rim is {height:.3g} m above the ground, where the other wheels stand"
                )
                wheels.remove(wheel)
            elif abs(height) > RAISED * wheel.radius:
                self.notes.append(
                    f"joint {wheel.joint}: its rim is {height:.3g} m above the ground, where the other "
                    "wheels stand; it is taken to touch the ground"
                )
        for joint in {*named, *self.rollers, *self.options.rollers} & self.reasons.keys():
            raise self.wrong(f"joint {joint!r} cannot be a wheel: {self.reasons[joint]}")
        if not wheels:
            raise self.wrong(
                f"no wheel found; {self.unused()}name the joints of the wheels by --wheels JOINT ..."
            )
        for wheel in wheels:
            self.refuse_more_joints(wheel)
        return wheels

    def refuse_more_joints(self, wheel: LinkWheel) -> None:
        """Raise BadInput for a wheel that carries joints, as one with rollers does,
        or that turns with another."""
        for link in self.document.subtree(wheel.link):
            for joint in self.document.below(link):
                if joint.type != "fixed" and joint.name not in self.on_rims:
                    raise self.wrong(
                        f"joint {joint.name!r} turns on the wheel of joint {wheel.joint!r}; a wheel has "
                        "three or more rollers about other axes than its own, or nothing that turns on it"
                    )
        if self.document.joints[wheel.joint].mimic is not None:
            raise self.wrong(f"joint {wheel.joint!r} is a wheel that mimics another joint; remove <mimic>")

    def wheel(self, joint: Any) -> LinkWheel:
        """Return the wheel on a joint. Raises NotRound."""
        document = self.document
        if joint.type not in ("continuous", "revolute"):
            raise NotRound(f"it is {joint.type}, and a wheel turns: continuous")
        tilt = math.degrees(math.asin(min(1.0, abs(document.axis(joint)[2]))))
        if tilt > math.degrees(ALIGNED):
            raise NotRound(
                f"its axis is {tilt:.3g} deg from horizontal; correct <axis>, which is in the frame of the "
                "joint, or rpy"
            )
        radius = self.options.radii.get(joint.child)
        if joint.name in self.rollers:
            heading = self.heading_of(joint)
            return wheel_with_rollers(document, joint, self.rollers[joint.name], heading, radius)
        try:
            shape = rim(document, joint)
        except NotRound:
            if not radius:
                raise
            shape = Rim(radius, 0.0, "", "", 0.0)
            self.notes.append(
                f"joint {joint.name}: no shape shows where its wheel is; its middle is taken at the joint"
            )
        if not radius and shape.other and abs(shape.other / shape.radius - 1) > ROUND:
            self.notes.append(
                f"joint {joint.name}: the radius of its wheel is {shape.radius:.4g} m by {shape.source}, but "
                f"{shape.other:.4g} m by its {'visual' if shape.kind == 'collision' else 'collision'}; the "
                f"first is taken, --radius {joint.child}=METRES replaces it"
            )
        size, source = (radius, f"--radius {joint.child}") if radius else (shape.radius, shape.source)
        centre, angle = (
            self.pivot(joint.name) + shape.along * document.axis(joint),
            self.options.rollers.get(joint.name),
        )
        return LinkWheel(joint.name, joint.child, centre, size, source, roller=angle, kind=shape.kind)

    def unused(self) -> str:
        """Return why horizontal joints that turn are no wheels, to be followed by advice."""
        joints = self.document.joints
        level = [
            n for n in self.reasons if abs(self.document.axis(joints[n])[2]) < 0.5 and not CASTOR.search(n)
        ]
        reasons = [f"joint {name!r}: {self.reasons[name]}; " for name in level]
        held = [
            name
            for name, joint in joints.items()
            if joint.type == "fixed" and WHEEL.search(name) and not CASTOR.search(name)
        ]
        reasons += [f"joint {name!r} is fixed; if it is a wheel, make it continuous; " for name in held]
        return "".join(reasons[:2])

    def ancestors(self, joint: str) -> list[Any]:
        """Return the joints that carry a joint, from it to the root."""
        joints, carrier = [], self.document.carrier
        link = self.document.joints[joint].parent
        while link in carrier:
            joints.append(carrier[link])
            link = carrier[link].parent
        return joints

    def turning_joint(self, wheel: LinkWheel) -> str | None:
        """Return the nearest vertical joint that carries a wheel."""
        for joint in self.ancestors(wheel.joint):
            if self.vertical(joint):
                return joint.name
        return None

    def is_castor(self, wheel: LinkWheel, wheels: list[LinkWheel]) -> bool:
        """Return whether a wheel is that of a castor: named so, or alone and not driven, and behind its
        vertical joint or beside driven wheels on the body."""
        joints = [self.document.joints[wheel.joint], *self.ancestors(wheel.joint)]
        names = {name for joint in joints for name in (joint.name, joint.child)}
        if names & set(self.options.castors) or any(map(CASTOR.search, names)):
            return True
        turning, driven = self.turning[wheel.joint], self.document.driven
        if turning is None or turning in driven or STEERS.search(turning):
            return False
        beside = [w for w in wheels if self.turning[w.joint] == turning and w is not wheel]
        if any(np.linalg.norm(w.centre - wheel.centre) > 2 * wheel.radius for w in beside):
            return False
        if self.trail(turning, wheel) > TRAIL * wheel.radius:
            return True
        fixed = [w.joint for w in wheels if self.turning[w.joint] is None]
        if wheel.joint in driven or not fixed or not driven.issuperset(fixed):
            return False
        self.notes.append(
            f"joint {turning}: its wheel is taken as a castor's, since transmissions drive "
            f"{', '.join(fixed)} and neither that wheel nor its joint"
        )
        return True

    def trail(self, turning: str, wheel: LinkWheel) -> float:
        """Return the distance of a wheel from its vertical joint, at right angles to its axle, m."""
        arm = (wheel.centre - self.pivot(turning))[:2]
        axle = self.document.axis(self.document.joints[wheel.joint])[:2]
        return abs(float(arm[0] * axle[1] - arm[1] * axle[0]))

    def fixed_castors(self, wheels: list[LinkWheel]) -> dict[str, np.ndarray]:
        """Return what stands on the ground without a wheel: links named so, and spheres. A second place of a
        link, farther from the first than the radius of a wheel, is a castor of its own. Raises BadInput for a
        name.
        """
        document, castors, radius = self.document, {}, wheels[0].radius
        named = {
            document.joints[n].child if n in document.joints else n for n in self.options.castors
        } - self.castors.keys()
        rims = {link for wheel in wheels for link in document.subtree(wheel.link)}
        for name, link in document.links.items():
            spheres = any(s.geometry.sphere is not None for s in (*link.collisions, *link.visuals))
            if name in rims or name in self.castors or not (spheres or CASTOR.search(name) or name in named):
                continue
            places = bottoms(document, name)
            if not places and name in named and self.has_shape(name):
                self.notes.append(
                    f"--castors: no shape of link {name} can be read; it is taken to stand below its origin"
                )
                places = [(self.ground, document.pose(name)[:3, 3])]
            height = places[0][0] - self.ground if places else math.inf
            if abs(height) > GROUND * radius:
                continue
            if abs(height) > RAISED * radius:
                self.notes.append(
                    f"link {name}: the castor is {height:.3g} m above the ground; it is taken to touch it"
                )
            below = [place for at, place in places if at <= places[0][0] + RAISED * radius]
            while below:
                near = [np.linalg.norm((place - below[0])[:2]) < radius for place in below]
                names = itertools.chain([name], (f"{name} {k}" for k in itertools.count(2)))
                own = next(
                    each
                    for each in names
                    if each not in self.castor_links and (each == name or each not in document.links)
                )
                castors[own] = np.mean(
                    [place for place, same in zip(below, near, strict=True) if same], axis=0
                )
                self.castor_links[own] = name
                below = [place for place, same in zip(below, near, strict=True) if not same]
        standing = {*self.castor_links.values()}
        lost = {name for name in named if not standing.intersection(document.subtree(name))}
        if lost:
            raise self.wrong(f"--castors: link {min(lost)!r} has no shape that reaches the ground")
        above = {name: document.carrier[name].parent for name in document.links if name in document.carrier}
        tops = [
            name
            for name in above
            if CASTOR.search(name) and not CASTOR.search(above[name]) and name not in rims
        ]
        if unknown := [name for name in tops if not standing.intersection(document.subtree(name))]:
            self.notes.append(
                "links named as castors carry nothing, since none of their shapes that can be read reaches "
                f"the ground: {', '.join(unknown)}; name by --castors those that stand there"
            )
        return castors

    # -- what is said of a file ------------------------------------------------------------------------------

    def check_masses(self, fixed: Sequence[LinkWheel], wheels: Sequence[LinkWheel]) -> None:
        """Raise BadInput for wheels or a chassis without mass, naming all; note what else has a shape and no
        mass.

        The chassis is what carries all wheels of the body, or if the rest of the body is lighter than the
        wheels, its largest link.
        """
        document = self.document
        massless = [
            n
            for n in document.links
            if not document.inertial(n) and (self.has_shape(n) or n in document.weightless)
        ]
        on_wheels = {wheel.link: document.subtree(wheel.link) for wheel in wheels}
        lost = [link for link, links in on_wheels.items() if not any(map(document.inertial, links))]
        carriers = {document.joints[wheel.joint].parent for wheel in fixed}
        beside = {
            *(link for links in on_wheels.values() for link in links),
            *self.castor_links.values(),
        } - carriers
        body = [name for name in document.links if name not in beside]

        def mass(links: Iterable[str]) -> float:
            return sum(own.mass for link in links if (own := document.inertial(link)))

        # A link without shape, fixed to the chassis, may have its inertia; one that weighs less than the
        # wheels is a sensor.
        beneath = [
            joint
            for joint in document.joints.values()
            if joint.type == "fixed" and not self.has_shape(joint.child)
        ]
        of_wheels = mass(link for links in on_wheels.values() for link in links)
        weighed = {joint.parent for joint in beneath if mass([joint.child]) > of_wheels} - {
            *document.weightless
        }
        suspects = {name for name in massless if {name} == carriers - weighed}
        if mass(body) < of_wheels:
            suspects |= carriers | {max(body, key=lambda name: span(document, name))}
        chassis = [name for name in massless if name in suspects]
        others = [name for name in massless if name not in {*lost, *chassis, *weighed}]
        if lost or chassis:
            what = [f"{name!r} (a wheel)" for name in lost] + [f"{name!r} (the chassis)" for name in chassis]
            also = f"; without mass are also links {', '.join(others)}" if others else ""
            raise self.wrong(
                f"links without mass: {', '.join(what)}; give each its mass and inertia by <inertial>{also}"
            )
        if not mass(body):
            raise self.wrong(
                "only wheels and castors have a mass; give the chassis <inertial> with mass and inertia"
            )
        if others:
            self.notes.append(
                f"without mass, which <inertial> would give, and so of no weight: links {', '.join(others)}"
            )

    def has_shape(self, link: str) -> bool:
        return bool(self.document.links[link].visuals or self.document.links[link].collisions)

    def compare_names(self, wheels: Sequence[LinkWheel], origin: np.ndarray) -> None:
        """Note wheels whose joints, or else links, are named after the other side."""
        contradicting = []
        for wheel in wheels:
            named, left = (
                _side(wheel.joint) or _side(wheel.link),
                ahead_and_left(wheel.centre - origin, self.heading)[1],
            )
            if named * left < 0:
                contradicting.append(
                    f"{wheel.joint}, {abs(left):.3g} m to the {'left' if left > 0 else 'right'}"
                )
        if contradicting:
            forward = " ".join(f"{part:.3g}" for part in self.heading)
            self.notes.append(
                f"warning: names contradict sides, seen along the heading {forward}: joints "
                f"{'; '.join(contradicting)}; their places decide, not their names: correct the URDF if the "
                "robot drives the other way"
            )

    def equal(self, wheels: list[LinkWheel], tolerance: float) -> list[LinkWheel]:
        """Return wheels with their mean radius if the radii differ by less than a tolerance (relative),
        with a note."""
        radii = [wheel.radius for wheel in wheels]
        if not radii or not 0 < max(radii) - min(radii) <= tolerance * min(radii):
            return wheels
        mean = float(np.mean(radii))
        if max(radii) - min(radii) > NONE * mean:
            between = f"{min(radii):.8g} to {max(radii):.8g} m"
            self.notes.append(
                f"the radii of the wheels of joints {_joints(wheels)}, {between}, are taken as {mean:.8g} m"
            )
        return [replace(wheel, radius=mean) for wheel in wheels]

    # -- the base --------------------------------------------------------------------------------------------

    def heading_of(self, joint: Any) -> np.ndarray:
        """Return the direction in which the wheel of a joint rolls: of the two, that nearer to x,
        or to y if it rolls along y."""
        heading = np.cross(self.document.axis(joint), UP)
        heading /= np.linalg.norm(heading)
        forward = heading[0] if abs(heading[0]) > ALIGNED else heading[1]
        return heading if forward > 0 else -heading

    def common_heading(self, wheels: list[LinkWheel]) -> np.ndarray:
        """Return the direction in which all wheels roll. Raises BadInput if they have none."""
        headings = [self.heading_of(self.document.joints[wheel.joint]) for wheel in wheels]
        for wheel, heading in zip(wheels, headings, strict=True):
            angle = math.degrees(math.acos(min(1.0, float(heading @ headings[0]))))
            if angle > math.degrees(ALIGNED):
                raise self.wrong(
                    f"the axles of joints {wheels[0].joint!r} and {wheel.joint!r} differ by {angle:.3g} deg; "
                    "with all joints at zero every wheel must roll the same way"
                )
        mean = np.sum(headings, axis=0)
        return mean / np.linalg.norm(mean)

    def axle(self, fixed: list[LinkWheel]) -> tuple[str, float, np.ndarray]:
        """Return the kind of a robot with these wheels on its base, half their distance, and their middle."""
        document, places = self.document, [ahead_and_left(wheel.centre, self.heading) for wheel in fixed]
        ahead, aside = (np.array(values) for values in zip(*places, strict=True))
        actual, track = float(np.ptp(aside)), self.options.track
        self.apart = apart = max(float(np.ptp(ahead)), actual)
        for wheel in fixed:
            if not 1 / SLENDER < wheel.radius / apart < SLENDER:
                raise self.wrong(
                    f"link {wheel.link!r}: its radius, {wheel.radius:.3g} m ({wheel.source}), does not fit "
                    f"wheels that are {apart:.3g} m apart; correct the scale of its mesh, or give --radius "
                    f"{wheel.link}=METRES"
                )
        if not SIZES[0] <= apart <= SIZES[1]:
            self.notes.append(
                f"the wheels are {apart:.3g} m apart; a URDF is in m and kg: is this one in other units?"
            )
        several = np.ptp(ahead) > ON_LINE * (actual if len(fixed) == 2 else fixed[0].radius)
        middle = (aside.max() + aside.min()) / 2
        origin = ahead.mean() * self.heading + middle * np.cross(UP, self.heading) + self.ground * UP
        lost = self.options.rollers.keys() - {
            wheel.joint for wheel in fixed if wheel.joint not in self.rollers
        }
        if lost:
            raise self.wrong(
                f"--rollers: joint {min(lost)!r} is no wheel on {document.root!r} whose rollers have no "
                "joints"
            )
        if any(wheel.roller is not None for wheel in fixed):
            if track is not None:
                raise self.wrong(
                    "--skid-steer-track: wheels with rollers do not slip when the robot turns; leave it out"
                )
            self.check_rollers(fixed, np.column_stack([ahead - ahead.mean(), aside - middle]))
            return "mecanum", actual / 2, origin
        if several and track is None:
            raise self.wrong(
                f"joints {_joints(fixed)} are wheels on several axles fixed to {document.root!r}: when it "
                "turns they slip aside (skid steer), so that it does not roll. --skid-steer-track METRES "
                "describes it by two wheels at their effective track, which is measured in turns and larger "
                f"than {actual:.3g} m; if they have rollers, give --rollers"
            )
        if not several and track is not None:
            raise self.wrong(
                f"--skid-steer-track: joints {_joints(fixed)} are on one axle, whose wheels do not slip"
            )
        sides = [
            [wheel for wheel, left in zip(fixed, aside, strict=True) if (left > middle) == way]
            for way in (False, True)
        ]
        if len(fixed) != 2 and not several or len(sides[0]) != len(sides[1]):
            raise self.wrong(
                f"joints {_joints(fixed)}: give as many wheels on the left as on the right, and two on one "
                "axle"
            )
        if track is None:
            return "two wheels", actual / 2, origin
        if not actual <= track < math.inf:
            raise self.wrong(
                f"--skid-steer-track {track:g} m: the effective track is at least that of the wheels, "
                f"{actual:g} m"
            )
        if len({wheel.radius for wheel in fixed}) > 1:
            raise self.wrong(
                f"joints {_joints(fixed)}: the radii of the wheels differ; give one by --radius LINK=METRES"
            )
        self.notes.append(
            f"skid steer: described by two wheels {track:g} m apart, its effective track; the wheels are "
            f"{actual:g} m apart"
        )
        return "skid steer", track / 2, origin

    def check_rollers(self, wheels: list[LinkWheel], places: np.ndarray) -> None:
        """Raise BadInput unless these are four wheels with rollers at places (m ahead, left of their middle),
        two on each side, which together move the body in every direction.
        """
        plain = [wheel.joint for wheel in wheels if wheel.roller is None]
        if plain:
            raise self.wrong(
                f"joint {plain[0]!r} is a wheel without rollers beside others that have them; if it has "
                "some, give the direction of the axis of the one on the ground, from ahead to the left, by "
                f"--rollers {plain[0]}='45 deg', or -45 deg"
            )
        for wheel in wheels:
            if wheel.roller is None or abs(math.cos(wheel.roller)) < ALIGNED:
                raise self.wrong(
                    f"joint {wheel.joint!r}: rollers about the direction of the axle; the wheel would not "
                    "drive"
                )
        if len({(ahead > 0, left > 0) for ahead, left in places}) < 4 or len(wheels) != 4:
            raise self.wrong(
                f"joints {_joints(wheels)} are wheels with rollers; a robot file describes four, two in "
                "front and two behind"
            )
        angles = np.array([wheel.roller for wheel in wheels])
        if not steerable(places, angles):
            said = ", ".join(
                f"{wheel.joint} {math.degrees(angle):.3g} deg"
                for wheel, angle in zip(wheels, angles, strict=True)
            )
            raise self.wrong(
                f"wheels with rollers in the directions {said}, from ahead to the left, cannot turn the body "
                "and move it sideways; those of the front right and the rear left one are 45 deg, of the "
                "others -45 deg"
            )
        if self.on_rims:
            self.notes.append(
                "the rollers count as parts of their wheels; that they also turn about their own axes is "
                "left out"
            )

    def arm(self, wheels: Sequence[LinkWheel]) -> list[str]:
        """Return the joints of the arm, each after those that carry it. Raises BadInput for one that is not
        vertical, or that carries what stands on the ground.
        """
        standing = {link: f"castor {name!r}" for name, link in self.castor_links.items()}
        standing |= {
            link: f"wheel {wheel.link!r}" for wheel in wheels for link in self.document.subtree(wheel.link)
        }
        carries = {
            joint.name: what for link, what in reversed(standing.items()) for joint in self.joints_above(link)
        }
        for name in self.options.arm:
            joint = self.document.joints[name]
            if name in carries:
                raise self.wrong(
                    f"--arm: joint {name!r} carries the {carries[name]}, which stands on the ground; leave "
                    "it out"
                )
            if joint.type not in ("continuous", "revolute"):
                raise self.wrong(
                    f"--arm: joint {name!r} is {joint.type}; those of an arm turn. Leave it out, and it is "
                    "held fixed"
                )
            tilt = math.degrees(math.acos(min(1.0, abs(self.document.axis(joint)[2]))))
            if tilt > math.degrees(ALIGNED):
                raise self.wrong(
                    f"--arm: joint {name!r}: its axis is {tilt:.3g} deg from vertical, and a robot file "
                    "describes motion in the plane; leave it out, and it is held fixed at zero"
                )
            if joint.mimic is not None:
                raise self.wrong(
                    f"--arm: joint {name!r} mimics {joint.mimic.joint!r}; remove <mimic>, or leave it out"
                )
        return sorted(dict.fromkeys(self.options.arm), key=lambda name: len(self.ancestors(name)))

    def vertical(self, joint: Any) -> bool:
        """Return whether a joint turns about a vertical axis, and not the whole robot."""
        turns = joint.type in ("continuous", "revolute") and joint.name not in self.placing
        return turns and abs(self.document.axis(joint)[2]) > math.cos(ALIGNED)

    def hold(self, used: Iterable[str], groups: Mapping[str, list[LinkWheel]], within: float) -> None:
        """Note which castors are left out and which joints are held fixed. Raises BadInput for a joint that
        carries what lies on the ground as a wheel does, `within` a height (m).
        """
        document = self.document
        if self.castors:
            names = ", ".join(self.castors)
            self.notes.append(
                f"castors slide without friction, and their mass stays on the body: links {names}"
            )
        of_castors = {joint.name for link in self.castor_links.values() for joint in self.joints_above(link)}
        used = {*used, *groups, *of_castors, *self.placing}
        held = [
            joint for joint in document.joints.values() if joint.type != "fixed" and joint.name not in used
        ]
        for joint in held:
            apart = [link for link in document.subtree(joint.child) if link not in self.castor_links.values()]
            if link := next((link for link in apart if lies_on(document, link, self.ground, within)), ""):
                why = f": {self.reasons[joint.name]}" if joint.name in self.reasons else ""
                raise self.wrong(
                    f"link {link!r} lies on the ground as a wheel does, and joint {joint.name!r}, which "
                    f"carries it, is none of a wheel or castor{why}; turn it about its axle on a continuous "
                    "joint of its own, or name it by --castors; if it carries nothing, make the joint fixed"
                )
            lower, upper = (getattr(joint.limit, end, None) for end in ("lower", "upper"))
            if (
                joint.type != "continuous"
                and lower is not None
                and upper is not None
                and not lower <= 0 <= upper
            ):
                raise self.wrong(
                    f"joint {joint.name!r} would be held at zero, beyond its limits {lower:g} to {upper:g}; "
                    "fix it in the URDF"
                )
        if held:
            names = ", ".join(joint.name for joint in held)
            vertical = " ".join(joint.name for joint in held if self.vertical(joint))
            kept = (
                f"; --arm makes joints of an arm of those that are vertical: {vertical}" if vertical else ""
            )
            self.notes.append(f"held fixed at zero, with all that they carry: joints {names}{kept}")
        for joint in held:
            if WHEEL.search(joint.name + joint.child) and joint.name in self.reasons:
                self.notes.append(f"joint {joint.name} is not taken as a wheel's: {self.reasons[joint.name]}")

    def joints_above(self, link: str) -> list[Any]:
        joint = self.document.carrier.get(link)
        return [] if joint is None else [joint, *self.ancestors(joint.name)]

    # -- bodies ----------------------------------------------------------------------------------------------

    def links_of(self, joint: str) -> list[str]:
        """Return the links of a part: all that its joint carries, except those of other parts."""
        top = self.document.joints[joint].child if joint else self.document.root
        return self.document.subtree(top, lambda below: below.child not in self.carrying)

    def part(self, joint: str, wheels: Sequence[LinkWheel], origin: np.ndarray) -> Part:
        """Return the body that a vertical joint carries, or with "" the base, in a frame with this origin."""
        document, links = self.document, self.links_of(joint)
        downward = joint and document.axis(document.joints[joint])[2] < 0
        finished, bodies, rims = [], [], set()
        for wheel in sorted(wheels, key=lambda w: ahead_and_left(w.centre, self.heading)[1]):
            own = document.subtree(wheel.link)
            rims.update(own)
            complete, mean = self.with_inertia(wheel, own)
            finished.append(complete)
            bodies.append(mean)
        bodies += [
            b.seen_from(document.pose(link))
            for link in links
            if link not in rims and (b := document.inertial(link))
        ]
        whole = merged(bodies)
        ahead, left = ahead_and_left(whole.centre - origin, self.heading)
        inertia = float(whole.inertia[2, 2])
        if not joint and inertia > whole.mass * (UNLIKELY * self.apart) ** 2:
            self.notes.append(
                f"the inertia of the body about the vertical, {inertia:.3g} kg m^2, is too large for its "
                "mass and size: is it in other units, such as kg mm^2?"
            )
        if not inertia > 0:
            raise self.wrong(
                f"the inertia of {', '.join(links[:3])} about the vertical is zero; give <inertia>"
            )
        place = self.pivot(joint) if joint else origin
        sign = -1 if downward else 1
        height = float(whole.centre[2] - self.ground)
        return Part(
            joint,
            sign,
            place,
            origin,
            whole.mass,
            ahead,
            left,
            height,
            inertia,
            tuple(finished),
            tuple(links),
        )

    def pivot(self, joint: str) -> np.ndarray:
        """Return the place of a joint in the frame of the root, m."""
        return self.document.pose(self.document.joints[joint].child)[:3, 3]

    def with_inertia(self, wheel: LinkWheel, links: list[str]) -> tuple[LinkWheel, Inertial]:
        """Return a wheel with its inertia, and its mean over a turn as a body. Raises BadInput if it has
        none."""
        document = self.document
        bodies = [b.seen_from(document.pose(link)) for link in links if (b := document.inertial(link))]
        body, axle = merged(bodies), np.cross(UP, self.heading)
        mean, about = body.spun(wheel.centre, axle)
        if not about > 0:
            raise self.wrong(f"link {wheel.link!r}: its inertia about the axle is zero; give <inertia>")
        offset = np.linalg.norm(body.centre - mean.centre) / wheel.radius
        if offset > UNBALANCED:
            raise self.wrong(
                f"link {wheel.link!r}: its centre of mass is {offset:.0%} of the radius away from the axle; "
                "correct <inertial>"
            )
        if about > HOOP * body.mass * wheel.radius**2:
            self.beyond_hoops.append(wheel.link)
        uneven = max(offset, np.abs(body.about(mean.centre) - mean.inertia).max() / about)
        if uneven > UNEVEN:
            self.notes.append(
                f"link {wheel.link}: not a body of revolution (by {uneven:.1%}); its mean over a turn is "
                "taken"
            )
        sign = 1 if document.axis(document.joints[wheel.joint]) @ axle > 0 else -1
        return replace(wheel, sign=sign, mass=body.mass, inertia=about), mean

    # -- steered parts and trailers --------------------------------------------------------------------------

    def steers(self, joint: str, wheels: list[LinkWheel]) -> bool:
        """Return whether a vertical joint steers a wheel, and does not pull a trailer."""
        near = len(wheels) == 1 and self.trail(joint, wheels[0]) <= TRAIL * wheels[0].radius
        return len(wheels) == 1 and (
            near or joint in self.document.driven or STEERS.search(joint) is not None
        )

    def steered(self, parts: list[Part], base: Part) -> tuple[Part, ...]:
        """Return the steered parts from right to left. Raises BadInput unless they are one in the middle or
        one pair."""
        places = [ahead_and_left(part.pivot - base.origin, self.heading) for part in parts]
        parts = [parts[k] for k in sorted(range(len(parts)), key=lambda k: places[k][1])]
        names = ", ".join(repr(part.joint) for part in parts)
        for part in parts:
            above = [joint.name for joint in self.ancestors(part.joint) if joint.child in self.carrying]
            if above:
                raise self.wrong(
                    f"joint {part.joint!r} steers a wheel on joint {above[0]!r}, not on the body; that is "
                    "not described"
                )
        if not parts:
            return ()
        near = ON_LINE * parts[0].wheels[0].radius
        ahead, aside = zip(*places, strict=True)
        if len(parts) > 2 or abs(sum(aside)) > 2 * near or max(ahead) - min(ahead) > near:
            raise self.wrong(
                f"joints {names} steer wheels; a robot file describes one steered wheel in the middle, or a "
                "pair on one line"
            )
        if min(map(abs, ahead)) < near:
            raise self.wrong(
                f"joints {names} steer wheels beside the fixed axle; they must be ahead of it or behind it"
            )
        for part in parts:
            mimic = self.document.joints[part.joint].mimic
            other = next((p for p in parts if mimic is not None and p.joint == mimic.joint), None)
            if other and abs(mimic.multiplier * part.sign * other.sign - 1) > ACKERMANN:
                raise self.wrong(
                    f"joint {part.joint!r} mimics {mimic.joint!r} by {mimic.multiplier:g}: the wheels turn "
                    "apart; correct <mimic>"
                )
        if len({part.wheels[0].radius for part in parts}) > 1:
            raise self.wrong(f"joints {names} steer wheels of different radii")
        if len(parts) == 2:
            self.notes.append(
                f"joints {names}: both turn by one angle, that of a wheel in the middle (bicycle model); "
                "Ackermann steering turns each by its own, so that none slips"
            )
        return tuple(parts)

    def driven_in_front(self, fixed: list[LinkWheel], steered: tuple[Part, ...]) -> bool:
        """Return whether the motor drives the steered wheels: as transmissions say,
        else those of a tricycle."""
        if not steered:
            return False
        powered = [
            any(w.joint in self.document.driven for w in wheels)
            for wheels in (fixed, [p.wheels[0] for p in steered])
        ]
        front = powered[1] if powered[0] != powered[1] else len(steered) == 1
        if powered[0] == powered[1]:
            driven = steered[0].wheels[0].joint if front else fixed[0].joint
            self.notes.append(
                f"the motor is taken to drive {driven}: the transmissions do not decide between front and "
                "rear"
            )
        return front

    def chain(self, groups: Mapping[str, list[LinkWheel]], base: Part) -> tuple[Part, ...]:
        """Return the trailers in the order in which they are pulled. Raises BadInput unless they are one
        chain of axles."""
        trailers: list[Part] = []
        for joint, wheels in sorted(groups.items(), key=lambda pair: len(self.ancestors(pair[0]))):
            before = trailers[-1] if trailers else base
            above = [each.name for each in self.ancestors(joint) if each.child in self.carrying]
            if above[:1] != ([before.joint] if trailers else []):
                raise self.wrong(
                    f"joint {joint!r}: a second trailer on one body; a robot file describes a chain of "
                    "trailers"
                )
            places = np.array([ahead_and_left(wheel.centre, self.heading) for wheel in wheels])
            near = ON_LINE * wheels[0].radius
            if len(wheels) != 2 or np.ptp(places[:, 0]) > near or wheels[0].radius != wheels[1].radius:
                raise self.wrong(
                    f"joint {joint!r} carries the wheels of joints {_joints(wheels)}; it must steer one "
                    "wheel, or carry a trailer with two equal wheels on one axle"
                )
            pivot, middle = self.pivot(joint), np.mean([wheel.centre for wheel in wheels], axis=0)
            middle[2] = self.ground
            behind, aside = ahead_and_left(pivot - middle, self.heading)
            hitch = ahead_and_left(pivot - before.origin, self.heading)[1]
            if abs(behind) < near or max(abs(aside), abs(hitch)) > near:
                raise self.wrong(
                    f"joint {joint!r}: the hitch of a trailer must be on the middle line, and not above its "
                    "axle"
                )
            if joint in self.document.driven:
                raise self.wrong(f"joint {joint!r} has a transmission; the joint of a trailer turns freely")
            trailers.append(self.part(joint, wheels, middle))
        return tuple(trailers)


def _joints(items: Any) -> str:
    names = [item if isinstance(item, str) else item.joint for item in items]
    return ", ".join(map(repr, names))


def _side(name: str) -> int:
    """Return 1 for a name that says left, -1 for right, 0 if it says neither or both."""
    words = {word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+", name)} | set(
        re.findall("left|right", name.lower())
    )
    return any(word in words for word in LEFT) - any(word in words for word in RIGHT)
