"""Wheels with rollers on their rim (mecanum, omnidirectional): how the roller on the ground lies,
from the rollers' joints."""

import math
from typing import Any

import numpy as np

from .document import Document
from .parts import UP, LinkWheel
from .rims import ALIGNED, ROUND, NotRound, rim

FEWEST = 3  # rollers of a wheel


def rollers_of(document: Document, joint: Any) -> list[Any]:
    """Return the joints of the rollers on the wheel of a joint: those that turn on its link,
    about other axes than its own."""
    if joint.type not in ("continuous", "revolute") or abs(document.axis(joint)[2]) > math.sin(ALIGNED):
        return []
    axis = document.axis(joint)
    links = document.subtree(joint.child, lambda below: below.type == "fixed")
    turning = [
        below for link in links for below in document.below(link) if below.type in ("continuous", "revolute")
    ]
    rollers = [below for below in turning if abs(document.axis(below) @ axis) < math.cos(ALIGNED)]
    return rollers if len(rollers) >= FEWEST else []


def wheel_with_rollers(
    document: Document, joint: Any, rollers: list[Any], heading: np.ndarray, radius: float | None
) -> LinkWheel:
    """Return the wheel of a joint, whose radius reaches to the outside of its rollers, unless one is given.

    A roller lies where its axis is nearest to the axle. Raises NotRound if the rollers differ in this or in
    their direction.
    """
    axis, pivot = document.axis(joint), document.pose(joint.child)[:3, 3]
    middles, directions = zip(*(_lies(document, roller, pivot, axis) for roller in rollers), strict=True)
    along = np.array([middle @ axis for middle in middles])
    rings = np.array([np.linalg.norm(middle - (middle @ axis) * axis) for middle in middles])
    angles = []
    for middle, direction, ring in zip(middles, directions, rings, strict=True):
        outward = (middle - (middle @ axis) * axis) / ring
        # Turned to the ground
        below = (direction @ axis) * axis + (direction @ np.cross(axis, outward)) * np.cross(axis, -UP)
        angles.append(math.atan2(below @ np.cross(UP, heading), below @ heading))
    differences = [math.remainder(angle - angles[0], math.pi) for angle in angles]
    if (
        max(map(abs, differences)) > ALIGNED
        or np.ptp(rings) > ROUND * rings.max()
        or np.ptp(along) > ROUND * rings.max()
    ):
        raise NotRound(
            "its rollers are not alike: their axes must lie at one distance from the axle and in one "
            "direction"
        )
    source = f"--radius {joint.child}"
    if radius is None:
        try:
            own = rim(document, rollers[0])
        except NotRound as error:
            reason = str(error).partition("; give its radius")[0]
            raise NotRound(
                f"its rollers: {reason}; give the radius of the wheel by --radius {joint.child}=METRES"
            ) from error
        radius = float(rings.mean()) + own.radius
        source = f"{len(rollers)} rollers {rings.mean():.6g} m from the axle; {own.source}"
    angle = math.remainder(angles[0] + float(np.mean(differences)), math.pi)
    return LinkWheel(joint.name, joint.child, pivot + along.mean() * axis, radius, source, roller=angle)


def _lies(
    document: Document, roller: Any, pivot: np.ndarray, axle: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the point of a roller's axis nearest to the axle, from the wheel's pivot (m),
    and the direction of that axis."""
    direction, place = document.axis(roller), document.pose(roller.child)[:3, 3] - pivot
    across = direction - (direction @ axle) * axle
    nearest = place - (place @ across) / (across @ across) * direction
    if not np.linalg.norm(nearest - (nearest @ axle) * axle) > 0:
        raise NotRound(f"the axis of its roller {roller.name!r} meets the axle")
    return nearest, direction


def steerable(places: np.ndarray, angles: np.ndarray) -> bool:
    """Return whether wheels at places (count, 2; m ahead, left) with rollers at these angles (rad) can move
    the body in every direction and turn it.
    """
    ahead, left = places.T
    c, s = np.cos(angles), np.sin(angles)
    size = np.abs(places).max()
    return int(np.linalg.matrix_rank(np.column_stack([c, s, (ahead * s - left * c) / size]), tol=1e-6)) == 3
