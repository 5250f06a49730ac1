"""The parts of a robot that rolls, as they are recognized in a URDF."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from .document import Document

UP = np.array([0.0, 0.0, 1.0])
# Behind the middle, at its left
CORNERS = {(False, False): "fr", (False, True): "fl", (True, False): "rr", (True, True): "rl"}


@dataclass(frozen=True)
class Options:
    """What the user names: joints of wheels, joints or links of castors, radii (m) by link, track (m) of a
    skid steer, directions of rollers (rad, see `LinkWheel`) by the joint of their wheel, joints of an arm.
    """

    wheels: Sequence[str] = ()
    castors: Sequence[str] = ()
    radii: Mapping[str, float] = field(default_factory=dict)
    track: float | None = None
    rollers: Mapping[str, float] = field(default_factory=dict)
    arm: Sequence[str] = ()


@dataclass(frozen=True, eq=False)
class LinkWheel:
    """A wheel: its joint, the link there, its centre in the frame of the root, its radius (m), and whence
    this comes.

    `sign` is 1 if the joint turns about the direction to the left, so that a positive angle rolls forward,
    else -1. `mass` (kg) and `inertia` (about the axle, kg m^2) are those of all its links. `roller` is the
    direction of the axis of the roller that touches the ground, rad from the heading to the left; None of a
    wheel without rollers. `kind` is that of the shapes that show its middle, "collision" or "visual"; empty
    if none does.
    """

    joint: str
    link: str
    centre: np.ndarray
    radius: float
    source: str
    sign: int = 1
    mass: float = 0.0
    inertia: float = 0.0
    roller: float | None = None
    kind: str = ""


@dataclass(frozen=True, eq=False)
class Part:
    """A body in the plane. Its frame has x ahead, y to the left, and its `origin` (m, in the frame of the
    root) in the middle of its axle, or, if it is steered, at its pivot.

    A part but the base, whose `joint` is empty, turns on the vertical `joint` at `pivot`; `sign` is -1 if
    that turns about the downward vertical. Mass, centre of mass (`ahead`, `left`, and `height` above the
    ground) and inertia about the vertical there include the wheels, given from right to left.
    """

    joint: str
    sign: int
    pivot: np.ndarray
    origin: np.ndarray
    mass: float
    ahead: float
    left: float
    height: float
    inertia: float
    wheels: tuple[LinkWheel, ...]
    links: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Layout:
    """A robot of a kind that a robot file describes: "two wheels", "skid steer", "mecanum", "car" or
    "tricycle".

    `heading` is its direction in the frame of the root, `half` (m) half the distance of the base's wheels, or
    of the effective track. The motor drives the wheels of the base, or with `front` the steered wheels.
    `castors` are links with the places where they stand, `shares` the part of the weight on each wheel, by
    joint, `on_castors` on each castor, by link. `arm` are the links of an arm, each after the one that
    carries it. `original` is the URDF before joints were moved into line; None if none was.
    """

    document: Document
    kind: str
    heading: np.ndarray
    half: float
    base: Part
    steered: tuple[Part, ...]
    trailers: tuple[Part, ...]
    front: bool
    castors: Mapping[str, np.ndarray]
    shares: Mapping[str, float]
    on_castors: Mapping[str, float]
    notes: tuple[str, ...]
    arm: tuple[Part, ...] = ()
    original: Document | None = None

    @property
    def parts(self) -> tuple[Part, ...]:
        """All bodies."""
        return (self.base, *self.steered, *self.trailers, *self.arm)

    def carrier(self, part: Part) -> Part:
        """The part that carries a link of the arm."""
        by_link = {link: each for each in self.parts for link in each.links}
        return by_link[self.document.joints[part.joint].parent]

    @property
    def corners(self) -> dict[str, LinkWheel]:
        """The wheels of a robot with four on its base: front right "fr", then fl, rr,
        rl. Others have fewer entries."""
        places = {wheel.joint: self.seen(wheel.centre, self.base.origin) for wheel in self.base.wheels}
        named = {
            CORNERS[ahead < 0, left > 0]: wheel
            for wheel in self.base.wheels
            for ahead, left in [places[wheel.joint]]
        }
        return {corner: named[corner] for corner in CORNERS.values() if corner in named}

    def seen(self, place: np.ndarray, origin: np.ndarray) -> tuple[float, float]:
        """Return how far a place is ahead of and to the left of an origin, m."""
        return ahead_and_left(place - origin, self.heading)


def ahead_and_left(arm: np.ndarray, heading: np.ndarray) -> tuple[float, float]:
    """Return the components of a vector along the heading and to its left."""
    return float(arm @ heading), float(arm @ np.cross(UP, heading))
