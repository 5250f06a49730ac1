"""Bodies of a Mechanism that lean about the axle of two wheels, as that of a balancer,
found from its mass matrix."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class LeaningBody:
    """A body that is hinged to a frame at its origin, about the direction to the left; `angle` is the
    coordinate by which it leans forward, 0 upright.

    `moment` (kg m) is its mass times the height of its centre of mass above the hinge, `about` (kg m^2) its
    inertia about the hinge, `wider` (kg m^2) by how much that about the forward direction through the hinge
    exceeds that about its long axis. What of its mass and of its inertia about the vertical is the frame's,
    no motion on a plane tells.
    """

    angle: int
    moment: float
    about: float
    wider: float


def leaning_angles(rows: np.ndarray, turning: np.ndarray) -> list[int]:
    """Return the coordinates that move no contact and no body in the plane: rows (S, 2 c,
    n) and yaw rates (c, n) are zero."""
    return [int(k) for k in np.flatnonzero(~rows.any(axis=(0, 1)) & ~turning.any(axis=0))]


def parts_of_mass(states: np.ndarray, angle: int, motion: np.ndarray) -> list[np.ndarray]:
    """Return the parts of M(q), each (S, n, n), of a unit of moment, about and wider, for a frame whose
    origin moves as `motion` (S, 3, n): forward, left, yaw rate.

    With c, s of the angle p, forward speed f, left l and yaw rate w, the energy of the body, but for what its
    mass has at the hinge and its inertia about the vertical, is
    moment (c f p' + s l w) + about p'^2 / 2 + wider s^2 w^2 / 2.
    """
    forward, left, yaw = (motion[:, k, :, None] for k in range(3))
    leans = np.zeros_like(yaw)
    leans[:, angle] = 1.0
    c, s = (f(states[:, angle])[:, None, None] for f in (np.cos, np.sin))
    return [
        c * product(forward, leans) + s * product(left, yaw),
        product(leans, leans) / 2,
        s * s * product(yaw, yaw) / 2,
    ]


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the matrices of the quadratic forms 2 (a q') (b q'), (S, n, n), of rows a and b (S, n, 1)."""
    return a @ b.swapaxes(1, 2) + b @ a.swapaxes(1, 2)


def inertia(body: LeaningBody, mass: float, upright: float) -> tuple[float, np.ndarray]:
    """Return the height (m) of the centre of mass above the hinge and the inertias (kg m^2) about it forward,
    left and up, of the body with all of a `mass` (kg), and an inertia `upright` about the vertical when it
    does not lean.
    """
    height = body.moment / mass
    at_hinge = np.array([upright + body.wider, body.about, upright])
    return height, at_hinge - mass * height * height * np.array([1.0, 1.0, 0.0])


def possible(inertias: Sequence[float] | np.ndarray) -> bool:
    """Return whether a rigid body can have these principal inertias: none exceeds the sum of the others."""
    return min(inertias) > 0 and 2 * max(inertias) <= sum(inertias)
