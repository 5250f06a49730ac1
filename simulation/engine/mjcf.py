"""The planar bodies and wheels of a robot, on a floor, as an MJCF model for MuJoCo.

What moves in the plane has the mass matrix of the Mechanism. Out of the plane the Mechanism says nothing but
the loads of its contacts; the model adds what carries them:

- A body whose contacts carry its own weight moves up and down by itself; its hinge carries no weight. Any
  other body is carried by the one it is hinged to.
- It rolls if it has contacts on both sides, and pitches if it has contacts ahead and behind. Where it has
  none, it is kept level.
- Supports are castors, spheres without friction. Without any, what the contacts do not carry, by their loads
  or with a `share` below 1, is on one castor where the moments balance; with the centre of mass above an axle
  on two, ahead of it and behind.
- A body that leans about the axle of two wheels is hinged there, with all of the mass: where a part of it is
  on the axle, the motion is the same. It has the inertias of the equations.
- About its horizontal axes through the centre of mass, any other body has the inertia that it has about the
  vertical.
"""

from __future__ import annotations

import xml.etree.ElementTree as xml
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...readers.errors import BadInput
from ..specification.floor import Bump
from .frames import Castor, Frame, PlanarBodies, WheelContact
from .leaning import inertia, possible

NOTHING = 1e-12  # kg, kg m^2: a body with a joint must have a mass, also where it only holds others
FREE = 1e-6  # kg m^2, times the radius / m squared: a wheel whose rotation is no coordinate
# Of a wheel, relative to its radius: half the breadth of the ellipsoid that rolls on the floor
BREADTH = 0.25
SMALL = 1e-6  # m, relative: equal places, equal weights
FAR = 10.0  # times the size of the robot: no castor is farther away
STIFF, DAMPED = 0.004, 1.0  # s, 1: time constant and damping ratio with which a contact gives way
HARD = "0.99 0.99 0.001"  # how much of a contact's force is independent of its penetration
# MuJoCo leaves out that the normal turns as a wheel rolls on, v^2 / R; by half, a wheel leaves a bump as it
# should: beyond g.
CURVED = "0.5 0.5 0.001"
# Of a scene: how much harder friction is than what carries the load, so that wheels creep less
IMPRATIO = 100.0
X, Y, Z = "1 0 0", "0 1 0", "0 0 1"


@dataclass(frozen=True, eq=False)
class ByItself:
    """What makes the MJCF of a robot a scene by itself: MuJoCo's own friction `mu`, and motors.

    `names` are those of the joints of frames but the first and of wheels; `motors` by the name of their
    input: the joint and the force on it for each unit of the input.
    """

    mu: float
    frames: Sequence[str]
    wheels: Sequence[str]
    motors: Mapping[str, tuple[str, float]]


@dataclass(frozen=True, eq=False)
class Build:
    """What is built, and the element for pairs of shapes that touch;
    `shapes` are those that a robot can stand on."""

    planar: PlanarBodies
    height: float
    scene: ByItself | None
    pairs: xml.Element
    shapes: list[str]

    def hinge(self, k: int) -> str:
        """The name of the joint of frame k."""
        return self.scene.frames[k - 1] if self.scene else f"yaw_{k}"

    def axle(self, k: int) -> str:
        """The name of the joint of wheel k."""
        return self.scene.wheels[k] if self.scene else f"axle_{k}"


def with_castors(planar: PlanarBodies, share: float) -> PlanarBodies:
    """Return the robot with the castors on which it stands besides its contacts, which carry `share` of what
    they do by the Mechanism. Raises BadInput where no castor balances the moments.
    """
    wheels = tuple(replace(wheel, load=share * wheel.load) for wheel in planar.wheels)
    planar = replace(planar, wheels=wheels)
    standing = [k for k in range(len(planar.frames)) if stands(planar, k)]
    more = [castor for k in standing for castor in _castors(planar, k)] if not planar.castors else []
    return replace(planar, castors=(*planar.castors, *more))


def _castors(planar: PlanarBodies, k: int) -> list[Castor]:
    """Return the castors that carry what the contacts of frame k and of all that it carries do not."""
    group, origins = carried(planar, k), hinges(planar, k)
    wheels = [wheel for wheel in planar.wheels if wheel.frame in group]
    if not wheels:
        raise BadInput("--engine mujoco: nothing carries a body: no contact is on it")
    places, loads = (
        np.array([origins[w.frame] + w.place for w in wheels]),
        np.array([wheel.load for wheel in wheels]),
    )
    mass = sum(planar.frames[j].mass for j in group) * planar.normal
    rest = mass - loads.sum()
    if rest <= SMALL * mass:
        return []
    moment = (
        sum((planar.frames[j].moment + planar.frames[j].mass * origins[j] for j in group), np.zeros(2))
        * planar.normal
    )
    place, middle = np.round((moment - loads @ places) / rest, 12) + 0.0, places.mean(axis=0)
    name = "castor" if k == 0 else f"castor {k + 1}"
    if np.ptp(places[:, 0]) > SMALL or abs(place[0] - middle[0]) > SMALL:
        far = max(np.ptp(places, axis=0).max(), *(abs(wheel.radius) for wheel in wheels))
        if np.abs(place - middle).max() > FAR * far:
            raise BadInput(
                f"--engine mujoco: the contacts carry {loads.sum() / mass:.0%} of the weight, and the rest "
                f"would balance {place[0]:.3g} m ahead and {place[1]:.3g} m to the left; correct the masses "
                "on contacts, or name supports"
            )
        return [Castor(name, k, place, rest)]
    reach = np.ptp(places[:, 1]) / 2 or abs(wheels[0].radius)
    return [
        Castor(f"{where} {name}", k, np.array([middle[0] + side * reach, place[1]]), rest / 2)
        for where, side in (("front", 1), ("rear", -1))
    ]


def mjcf(
    name: str,
    planar: PlanarBodies,
    height: float,
    bumps: Sequence[Bump] = (),
    scene: ByItself | None = None,
) -> str:
    """Return the MJCF of a robot.

    `height` (m) is that of the centre of mass of each body with a mass that does not say its own. Joints: x,
    y, yaw_K of frame K, axle_K of the wheels of contact K, lean_K of what leans; z_K, pitch_K, roll_K. Geoms:
    floor, bump_K, wheel_K_J of the wheels of contact K, castor_K. As a `scene` the first frame has a free
    joint, base, and the others have the names given there. Raises BadInput for a scene in which the robot
    would fall over.
    """
    root = xml.Element("mujoco", model=name)
    option = xml.SubElement(root, "option", integrator="implicit")
    if scene:
        option.attrib.update(cone="elliptic", impratio=_text([IMPRATIO]))
    xml.SubElement(option, "flag", autoreset="disable")
    world = xml.SubElement(root, "worldbody")
    xml.SubElement(
        world,
        "geom",
        name="floor",
        type="plane",
        size="50 50 1",
        contype="0",
        conaffinity="0",
        rgba=".9 .9 .9 1",
    )
    build = Build(planar, height, scene, xml.SubElement(root, "contact"), ["floor"])
    for k, bump in enumerate(bumps):
        build.shapes.append(f"bump_{k}")
        _geom(world, f"bump_{k}", "sphere", [bump.curvature], (bump.x, bump.y, bump.height - bump.curvature))
    if scene:
        motors = xml.SubElement(root, "actuator")
        for motor, (joint, force) in scene.motors.items():
            xml.SubElement(motors, "motor", name=motor, joint=joint, gear=_text([force]))
        _frame(world, world, 0, build)
    else:
        held = _body(world, "ground", (0.0, 0.0, 0.0))
        _joint(held, "x", "slide", X)
        _joint(held, "y", "slide", Y)
        for k, frame in enumerate(planar.frames):
            if frame.parent is None:
                _frame(held, held, k, build)
    xml.indent(root)
    return xml.tostring(root, encoding="unicode")


def carried(planar: PlanarBodies, k: int) -> list[int]:
    """Return frame k and those that it carries, with what these carry."""
    others = [j for j, frame in enumerate(planar.frames) if frame.parent == k and not stands(planar, j)]
    return [k, *[i for j in others for i in carried(planar, j)]]


def stands(planar: PlanarBodies, k: int) -> bool:
    """Return whether frame k carries its own weight: the first, or contacts on it carry as much."""
    frame = planar.frames[k]
    load = sum(each.load for each in planar.wheels if each.frame == k)
    load += sum(each.load for each in planar.castors if each.frame == k)
    return frame.parent is None or (load > 0 and abs(load - frame.mass) <= SMALL * frame.mass)


def _frame(level: xml.Element, tilting: xml.Element, k: int, build: Build) -> None:
    """Add frame k and all that is hinged to it to its parent: to the part that stays level, or to that which
    tilts with the weight it carries. In a scene the first frame tilts as a whole.
    """
    planar, free = build.planar, build.scene is not None and k == 0
    frame, alone = planar.frames[k], stands(planar, k)
    body = _body(level if alone else tilting, f"frame_{k}", (*frame.pivot, 0.0), inertial=alone and not free)
    if free:
        xml.SubElement(body, "freejoint", name="base")
    else:
        _joint(body, build.hinge(k), "hinge", Z)
    upper = body
    if alone and not free:
        upper = _body(body, f"body_{k}", (0.0, 0.0, 0.0), inertial=False)
        _joint(upper, f"z_{k}", "slide", Z)
    if alone:
        _supports(upper, k, build, free)
    _inertial(upper, planar, k, build.height)
    for j, wheel in enumerate(planar.wheels):
        if wheel.frame == k:
            _wheel(upper, j, wheel, build)
    for j, other in enumerate(planar.frames):
        if other.parent == k:
            _frame(body, upper, j, build)


def _supports(upper: xml.Element, k: int, build: Build, free: bool) -> None:
    """Add the castors of what stands on its own, and, unless it is `free`, the joints about the horizontal
    axes about which it has contacts on both sides.
    """
    planar = build.planar
    group, origins = carried(planar, k), hinges(planar, k)
    radius = min(abs(wheel.radius) for wheel in planar.wheels) / 2
    places = [
        origins[wheel.frame] + place
        for wheel in planar.wheels
        if wheel.frame in group
        for place in wheel.places
    ]
    for j, castor in enumerate(planar.castors):
        if castor.frame in group:
            places.append(origins[castor.frame] + castor.place)
        if castor.frame == k:
            made = _body(upper, castor.name, (*castor.place, radius))
            _geom(made, f"castor_{j}", "sphere", [radius], (0.0, 0.0, 0.0))
            _pair(build, f"castor_{j}")
    long, wide = np.ptp(places, axis=0) > SMALL
    if free:
        if not (wide and long):
            raise BadInput(
                "--write-scene: on these contacts the robot would fall over; "
                + (
                    "they are on one line along it"
                    if not wide
                    else "set [contact] share below 1, so that a castor carries the rest"
                )
            )
        return
    if long:
        _joint(upper, f"pitch_{k}", "hinge", Y)
    if wide:
        _joint(upper, f"roll_{k}", "hinge", X)


def hinges(planar: PlanarBodies, k: int) -> dict[int, np.ndarray]:
    """Return the origins of frame k and all after it in the axes of k, all hinges straight."""
    found = {k: np.zeros(2)}
    for j, frame in enumerate(planar.frames):
        if frame.parent in found and j != k:
            found[j] = found[frame.parent] + frame.pivot
    return found


def _inertial(body: xml.Element, planar: PlanarBodies, k: int, height: float) -> None:
    """Add mass and inertia of frame k, or of what leans on it,
    without what its wheels have about a vertical diameter."""
    frame: Frame = planar.frames[k]
    wheels = [wheel for wheel in planar.wheels if wheel.frame == k]
    centre = frame.moment / frame.mass if frame.mass else np.zeros(2)
    about = frame.inertia - frame.mass * float(centre @ centre) - sum(_diameter(wheel) for wheel in wheels)
    if about <= 0:
        raise BadInput(
            f"--engine mujoco: the wheels of body {k + 1} have more inertia about a vertical than the body "
            "itself"
        )
    if planar.leaning and k == 0:
        _leans(body, planar, about)
        xml.SubElement(body, "inertial", pos="0 0 0", mass=_text([NOTHING]), diaginertia=_text([NOTHING] * 3))
        return
    height = height if frame.height is None else frame.height
    place = [*centre.tolist(), height if frame.mass else 0.0]
    xml.SubElement(
        body,
        "inertial",
        pos=_text(place),
        mass=_text([frame.mass or NOTHING]),
        diaginertia=_text([float(about)] * 3),
    )
    if abs(planar.normal - 1) > SMALL:
        body.set("gravcomp", _text([1 - planar.normal]))


def _leans(body: xml.Element, planar: PlanarBodies, upright: float) -> None:
    """Add the body that leans, with the mass of the first frame and an inertia `upright` (kg m^2) about the
    vertical."""
    if len(planar.leaning) > 1:
        raise BadInput(f"--engine mujoco: {len(planar.leaning)} bodies lean; it has one that does")
    height, inertias = inertia(planar.leaning[0], planar.frames[0].mass, upright)
    if not possible(inertias):
        raise BadInput(
            f"--engine mujoco: no rigid body has the inertias of the one that leans, {_text(inertias)} kg m^2"
        )
    made = _body(body, "leaning_0", (0.0, 0.0, abs(planar.wheels[0].radius)), inertial=False)
    _joint(made, "lean_0", "hinge", Y)
    mass = _text([planar.frames[0].mass])
    xml.SubElement(made, "inertial", pos=_text([0.0, 0.0, height]), mass=mass, diaginertia=_text(inertias))


def _diameter(wheel: WheelContact) -> float:
    """Return the inertia of a wheel, a disc, about a diameter, kg m^2."""
    return (wheel.inertia or FREE * wheel.radius**2) / 2


def _wheel(body: xml.Element, j: int, wheel: WheelContact, build: Build) -> None:
    """Add the wheels of a contact; their mass is part of the body's. The first turns on the axle, with the
    inertia of all; others are fixed, and the engine lets their rims move as that of the first.
    """
    radius, about = abs(wheel.radius), _diameter(wheel)
    for i, place in enumerate(wheel.places):
        first = i == 0
        made = _body(
            body,
            wheel.name if first else f"{wheel.name} {i + 1}",
            (*place, radius),
            (about, 2 * about, about),
            first,
        )
        if wheel.turned:
            made.set("quat", _text([np.cos(wheel.turned / 2), 0.0, 0.0, np.sin(wheel.turned / 2)]))
        if first:
            _joint(made, build.axle(j), "hinge", Y if wheel.radius > 0 else "0 -1 0")
        _geom(made, f"wheel_{j}_{i}", "ellipsoid", [radius, BREADTH * radius, radius], (0.0, 0.0, 0.0))
        _pair(build, f"wheel_{j}_{i}", build.scene.mu if build.scene else None)


def _body(
    parent: xml.Element,
    name: str,
    place: Iterable[float],
    inertia: Iterable[float] = (NOTHING,) * 3,
    inertial: bool = True,
) -> xml.Element:
    body = xml.SubElement(parent, "body", name=name, pos=_text(place))
    if inertial:
        xml.SubElement(body, "inertial", pos="0 0 0", mass=_text([NOTHING]), diaginertia=_text(inertia))
    return body


def _joint(body: xml.Element, name: str, kind: str, axis: str) -> None:
    xml.SubElement(body, "joint", name=name, type=kind, axis=axis)


def _geom(body: xml.Element, name: str, kind: str, size: Iterable[float], place: Iterable[float]) -> None:
    """Add a shape without mass, which touches only where a pair says so."""
    made = xml.SubElement(body, "geom", name=name, mass="0", contype="0", conaffinity="0", rgba=".2 .2 .2 1")
    made.attrib.update(type=kind, size=_text(size), pos=_text(place))


def _pair(build: Build, name: str, mu: float | None = None) -> None:
    """Let a shape rest on the floor and on bumps, without friction or with MuJoCo's own."""
    for shape in build.shapes:
        made = xml.SubElement(build.pairs, "pair", geom1=shape, geom2=name, condim="1" if mu is None else "3")
        made.attrib.update(solref=_text([STIFF, DAMPED]), solimp=HARD if shape == "floor" else CURVED)
        if mu is not None:
            made.set("friction", _text([mu, mu, 0.0, 0.0, 0.0]))


def _text(values: Iterable[float]) -> str:
    return " ".join(f"{float(value):.17g}" for value in values)
