"""Mass, centre of mass and inertia of rigid bodies."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Inertial:
    """Mass (kg), centre of mass (m, 3) and inertia about it (kg m^2, 3 x 3), along the axes of one frame."""

    mass: float
    centre: np.ndarray
    inertia: np.ndarray

    def seen_from(self, pose: np.ndarray) -> "Inertial":
        """Return the same body in another frame; `pose`, 4 x 4, is that of the body's present frame in it."""
        turn = pose[:3, :3]
        return Inertial(self.mass, turn @ self.centre + pose[:3, 3], turn @ self.inertia @ turn.T)

    def about(self, point: np.ndarray) -> np.ndarray:
        """Return the inertia about a point, by parallel axes, kg m^2."""
        arm = self.centre - point
        return self.inertia + self.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))

    def spun(self, point: np.ndarray, axis: np.ndarray) -> tuple["Inertial", float]:
        """Return its mean over a turn about an axle, through a point and of length 1,
        and its inertia about that axle."""
        foot = point + axis * (axis @ (self.centre - point))
        inertia = self.about(foot)
        along = float(axis @ inertia @ axis)
        across = (np.trace(inertia) - along) / 2
        return Inertial(self.mass, foot, across * np.eye(3) + (along - across) * np.outer(axis, axis)), along


def merged(bodies: Iterable[Inertial]) -> Inertial:
    """Return the body that several in one frame make together; of no mass for none."""
    bodies = list(bodies)
    mass = sum(body.mass for body in bodies)
    if not mass:
        return Inertial(0.0, np.zeros(3), np.zeros((3, 3)))
    centre = np.sum([body.mass * body.centre for body in bodies], axis=0) / mass
    return Inertial(mass, centre, np.sum([body.about(centre) for body in bodies], axis=0))
