"""Where the point and the heading of a Mechanism are on the robot of a scene,
and which of its joints are the Mechanism's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .frames import PlanarBodies
from .mjcf import hinges
from .scene_file import SceneFile

TILTED = 0.1  # rad between a joint and the direction that it should have
MISPLACED = 0.1  # relative to the size of the robot: joints that are not where the robot has them
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class SharedJoint:
    """Joints of a scene that are one of the Mechanism, their mean: their numbers, addresses in qpos and qvel,
    and signs: 1 where a positive angle is one of the Mechanism's. `shapes` are those of the wheel on each
    joint, none on a hinge.
    """

    joints: tuple[int, ...]
    at: np.ndarray
    dofs: np.ndarray
    signs: np.ndarray
    zero: np.ndarray
    shapes: tuple[tuple[int, ...], ...]


@dataclass(frozen=True, eq=False)
class Alignment:
    """`point` and `ahead`: place (m) and heading of the Mechanism in the axes of the base. `hinges` of all
    frames but the first, `wheels` of all contacts. `off` (m): how far a joint is at most from where the
    Mechanism has it; `size` (m) of the robot.
    """

    point: np.ndarray
    ahead: np.ndarray
    hinges: tuple[SharedJoint, ...]
    wheels: tuple[SharedJoint, ...]
    off: float
    size: float


def align(
    scene: SceneFile,
    data,
    name: str,
    bodies: PlanarBodies,
    turned: Sequence[Sequence[int]],
    rolled: Sequence[Sequence[int]],
) -> Alignment:
    """Return the alignment of the robot `name` with `data`, its pose in the file, all hinges straight; from
    the joints of its frames but the first, `turned`, and of its wheels, `rolled`.

    Raises BadInput for joints that are elsewhere or about other axes than those of the Mechanism.
    """
    shapes = [tuple(tuple(scene.shapes(k)) for k in own) for own in rolled]
    centres = [
        [middle(scene, data, k, of) for k, of in zip(own, wheel, strict=True)]
        for own, wheel in zip(rolled, shapes, strict=True)
    ]
    origins = hinges(bodies, 0)
    known = np.array(
        [
            *(origins[k] for k in range(1, len(bodies.frames))),
            *(origins[wheel.frame] + np.mean(wheel.places, axis=0) for wheel in bodies.wheels),
        ]
    )
    there = np.array(
        [
            *(data.xanchor[list(own)].mean(axis=0) for own in turned),
            *(np.mean(own, axis=0) for own in centres),
        ]
    )
    turn, place, off = _moved(known, there[:, :2])
    size = float(np.abs(known - known.mean(axis=0)).max())
    if not size > 0:
        raise scene.wrong(
            f"the wheels and hinges of {name} are at one place, which does not show its heading"
        )
    if off > MISPLACED * size:
        raise scene.wrong(
            f"its joints are not where {name} has its wheels and hinges, by {off:.3g} m: correct [scene] "
            "joints, or the robot's parameters"
        )
    root = scene.base([k for own in (*turned, *rolled) for k in own])
    axes, (c, s) = data.xmat[root].reshape(3, 3), (np.cos(turn), np.sin(turn))
    point = np.array([*place, np.mean([centre[2] for own in centres for centre in own])])
    left = np.array([-s, c, 0.0])
    return Alignment(
        axes.T @ (point - data.xpos[root]),
        axes.T @ np.array([c, s, 0.0]),
        tuple(_shared(scene, data, own, UP, "vertical", ()) for own in turned),
        tuple(
            _shared(scene, data, own, np.sign(wheel.radius) * left, "that of the other axles", of)
            for own, wheel, of in zip(rolled, bodies.wheels, shapes, strict=True)
        ),
        off,
        size,
    )


def middle(scene: SceneFile, data, joint: int, shapes: Sequence[int]) -> np.ndarray:
    """Return the middle of the shapes of a wheel, on its axle,
    m. Raises BadInput for a wheel without shapes."""
    if not shapes:
        raise scene.wrong(
            f"joint {scene.model.joint(joint).name!r} carries no shape that can touch the floor"
        )
    anchor, axis = data.xanchor[joint], data.xaxis[joint]
    return anchor + axis * (axis @ (data.geom_xpos[list(shapes)].mean(axis=0) - anchor))


def _moved(known: np.ndarray, there: np.ndarray) -> tuple[float, np.ndarray, float]:
    """Return the angle and the place to which a figure of points (count, 2) is moved,
    and the largest distance that is left."""
    a, b = known - known.mean(axis=0), there - there.mean(axis=0)
    turn = float(np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum()))
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, -s], [s, c]])
    off = float(np.linalg.norm(b - a @ rotation.T, axis=1).max())
    return turn, there.mean(axis=0) - rotation @ known.mean(axis=0), off


def _shared(
    scene: SceneFile,
    data,
    joints: Sequence[int],
    direction: np.ndarray,
    what: str,
    shapes: tuple[tuple[int, ...], ...],
) -> SharedJoint:
    """Return joints about an axis in a direction, or the opposite one. Raises BadInput for another axis."""
    model, numbers = scene.model, list(joints)
    along = data.xaxis[numbers] @ direction
    for k, part in zip(numbers, along, strict=True):
        off = np.arccos(min(1.0, abs(part)))
        if off > TILTED:
            raise scene.wrong(
                f"joint {model.joint(k).name!r}: its axis is {np.degrees(off):.3g} deg from {what}; correct "
                "it"
            )
    at = model.jnt_qposadr[numbers]
    return SharedJoint(tuple(numbers), at, model.jnt_dofadr[numbers], np.sign(along), model.qpos0[at], shapes)
