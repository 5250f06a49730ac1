"""The robot of a SPEC on its floor as a file that MuJoCo opens by itself, and that [scene] brings back."""

from __future__ import annotations

import numpy as np

from ...readers.errors import BadInput
from ..plant import Plant
from ..specification.floor import Floor
from ..specification.spec import ContactSection
from .frames import planar
from .mjcf import ByItself, mjcf, with_castors
from .stepping import on_joints, refuse_in_scene


def scene_of(plant: Plant, contact: ContactSection, floor: Floor) -> str:
    """Return the MJCF of a robot, its base on a free joint, with its floor and its motors and MuJoCo's own
    friction.

    Joints are named as their coordinates, or, if they have none, as their contacts; motors as their inputs.
    The slope of the floor stays in the SPEC. Raises BadInput for a floor with patches, for a robot that
    `[scene]` would refuse, and as FloorEngine and `mjcf`.
    """
    if floor.patch:
        raise BadInput(
            "--write-scene: a scene has no patches; leave out [floor] patch, or make the floor of several "
            "shapes"
        )
    mechanism, bodies = (
        plant.system.mechanism,
        with_castors(planar(plant.system.mechanism, plant.parameters), contact.share),
    )
    if several := [wheel.name for wheel in bodies.wheels if wheel.wheels]:
        raise BadInput(
            f"--write-scene: {several[0]} of {mechanism.name} are several wheels on one coordinate; use its "
            "own file"
        )
    refuse_in_scene("--write-scene", mechanism.name, bodies)
    names = [coordinate.name for coordinate in mechanism.coordinates]
    frames = [names[bodies.hinge(k)] for k in range(1, len(bodies.frames))]
    wheels = [wheel.name if wheel.angle is None else names[wheel.angle] for wheel in bodies.wheels]
    joints = ["x", "y", "base", *frames, *(names[w.angle] for w in bodies.wheels if w.angle is not None)]
    motors = {}
    for name, column in zip(mechanism.inputs, on_joints(plant, bodies).T, strict=True):
        if len(acts := np.flatnonzero(column)) == 1:
            motors[name.name] = (joints[acts[0]], float(column[acts[0]]))
    scene = ByItself(contact.mu if floor.mu is None else floor.mu, frames, wheels, motors)
    return mjcf(mechanism.name, bodies, contact.height, floor.bumps, scene) + "\n"
