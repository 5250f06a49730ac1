"""Bounds of several parameters together: the principal inertias of a rigid body."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import nnls

from ...model.mechanism import Mechanism
from ...readers.errors import BadInput

ROUNDING = 1e-9  # of the inertias: what is not regarded as beyond a bound


@dataclass(frozen=True)
class Triangle:
    """One of the principal inertias of a rigid body, which is at most the sum of the other two."""

    inertia: str
    others: tuple[str, str]

    def __str__(self) -> str:
        """Return it as an inequality."""
        first, second = self.others
        return f"{self.inertia} <= " + (f"2 {first}" if first == second else f"{first} + {second}")

    def factors(self, names: Sequence[str]) -> np.ndarray:
        """Return the factors of these parameters in the difference that must not be positive."""
        return np.array([(name == self.inertia) - self.others.count(name) for name in names], float)

    def holds(self, values: Mapping[str, float]) -> bool:
        """Return whether it holds for these values, up to rounding."""
        most = sum(values[name] for name in self.others)
        return values[self.inertia] <= most * (1 + ROUNDING)


def triangles(mechanism: Mechanism) -> tuple[Triangle, ...]:
    """Return what limits the inertias of the robot's bodies,
    as far as its file says which belong together."""
    found = []
    for body in mechanism.inertias:
        for k, inertia in enumerate(body):
            others = body[:k] + body[k + 1 :]
            if inertia not in others:
                found.append(Triangle(inertia, (others[0], others[1])))
    return tuple(dict.fromkeys(found))


def bounded_least_squares(
    A: np.ndarray, b: np.ndarray, G: np.ndarray, h: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the s of least |A s - b| with G s >= h, and which rows of G hold it back: those with a positive
    multiplier. A has full rank, rows of G have length 1, or 0 where they say nothing; one that is missed by
    less than ROUNDING counts as met.

    A problem of the least distance, whose dual is one of nonnegative least squares (Lawson and Hanson,
    Solving Least Squares Problems, 1974, chapter 23). Raises BadInput if no s meets all rows.
    """
    s = np.linalg.lstsq(A, b, rcond=None)[0]
    if (G @ s >= h - ROUNDING).all():
        return s, np.zeros(len(h), bool)
    Q, R = np.linalg.qr(A)
    K = solve_triangular(R, G.T, trans="T").T  # of z = R s - Q' b, whose norm is what exceeds the least
    size = np.linalg.norm(K, axis=1)
    size[size == 0] = np.inf
    K, least = K / size[:, None], (h - K @ Q.T @ b) / size
    unit = least.max()
    dual, distance = nnls(np.vstack([K.T, least / unit]), np.append(np.zeros(len(s)), 1.0))
    if distance < ROUNDING:
        raise BadInput(
            "the inertias that are given leave none for the others of their bodies; give others with --set"
        )
    z = unit * (K.T @ dual) / (1.0 - least / unit @ dual)
    return solve_triangular(R, z + Q.T @ b), dual > 0
