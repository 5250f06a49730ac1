"""Moves the joints of a robot into line where a URDF has them almost there,
so that what is compared with it is exact."""

from collections.abc import Iterator

import numpy as np

from .document import Document
from .parts import UP, Layout, LinkWheel, Part
from .rims import ON_LINE

EXACT = 1e-12  # m, rad: rounding of numbers


def straightened(layout: Layout) -> tuple[Document, list[str]]:
    """Return the URDF with its joints in line, and for each joint that was moved how far.

    The wheels of an axle are in line then, axes of wheels exactly to the left, vertical joints vertical,
    hitches and a steering axis on the middle line, and the joints of a steered pair opposite each other. What
    a joint carries moves with it. An axis is turned by the least angle, about the middle of the wheel or the
    pivot.
    """
    document, left = layout.document, np.cross(UP, layout.heading)
    moves = {"": np.eye(4)}  # of the parts, by joint, in the frame of the root
    origins: dict[str, np.ndarray] = {}
    said: list[str] = []

    def move(
        name: str, before: np.ndarray, point: np.ndarray, axis: np.ndarray, place: tuple[float, float]
    ) -> np.ndarray:
        """Return the motion of what a joint carries, 4 x 4, that turns its axis and brings a point to a
        place.

        `before` is the motion of what carries the joint.
        """
        joint = document.joints[name]
        start = before[:3, :3] @ point + before[:3, 3]
        ahead, aside = np.subtract(place, layout.seen(start, layout.base.origin))
        shift = ahead * layout.heading + aside * left
        own = before[:3, :3] @ document.axis(joint)
        off, angle = float(np.linalg.norm(shift)), float(np.linalg.norm(np.cross(own, axis)))
        if max(off, angle) <= EXACT:
            return before
        after, turn = np.eye(4), _least_turn(own, axis)
        after[:3, :3], after[:3, 3] = turn, start + shift - turn @ start
        after = after @ before
        origins[name] = (
            np.linalg.inv(before @ document.pose(joint.parent)) @ after @ document.pose(joint.child)
        )
        said.append(f"{name} by {1000 * off:.2g} mm and {np.degrees(angle):.2g} deg")
        return after

    for part in layout.parts:
        if part.joint:
            carrier = layout.carrier(part)
            moves[part.joint] = move(
                part.joint, moves[carrier.joint], part.pivot, part.sign * UP, _pivot(layout, part)
            )
        for wheel, place in _wheels(layout, part):
            move(wheel.joint, moves[part.joint], wheel.centre, wheel.sign * left, place)
    return (document.moved(origins) if origins else document), said


def _pivot(layout: Layout, part: Part) -> tuple[float, float]:
    """Return where a vertical joint should be: ahead of the base's origin and to its left, m."""
    ahead, aside = layout.seen(part.pivot, layout.base.origin)
    if part in layout.trailers or (part,) == layout.steered:
        return ahead, 0.0
    if part in layout.steered:
        pair = np.array([layout.seen(each.pivot, layout.base.origin) for each in layout.steered])
        return float(pair[:, 0].mean()), float(np.sign(aside) * np.ptp(pair[:, 1]) / 2)
    return ahead, aside


def _wheels(layout: Layout, part: Part) -> Iterator[tuple[LinkWheel, tuple[float, float]]]:
    """Yield the wheels of a part, each with where its middle should be, as `_pivot`."""
    places = np.array([layout.seen(wheel.centre, layout.base.origin) for wheel in part.wheels]).reshape(-1, 2)
    in_line = part in layout.trailers or part is layout.base and layout.kind not in ("mecanum", "skid steer")
    if in_line:
        places[:, 0] = 0.0 if part is layout.base else places[:, 0].mean()
    if part in layout.trailers:
        places[:, 1] = np.ptp(places[:, 1]) / 2 * np.array([-1, 1])
    if (part,) == layout.steered and abs(places[0, 1]) <= ON_LINE * part.wheels[0].radius:
        places[0, 1] = 0.0
    if part in layout.steered and len(layout.steered) == 2:
        arms = np.array([layout.seen(each.wheels[0].centre, each.pivot) for each in layout.steered])
        ahead, aside = _pivot(layout, part)
        outward = (arms[1, 1] - arms[0, 1]) / 2
        places[0] = ahead + arms[:, 0].mean(), aside + np.sign(aside) * outward
    yield from zip(part.wheels, map(tuple, places.tolist()), strict=True)


def _least_turn(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the rotation by the least angle that turns one unit vector into another,
    which is nearly the same."""
    x, y, z = np.cross(a, b)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + cross + cross @ cross / (1 + a @ b)
