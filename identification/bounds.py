"""Bounds of several parameters together: the principal inertias of a rigid body."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..model.mechanism import Mechanism

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
    """Return what limits the inertias of the robot's bodies, as far as its file says which belong together."""
    found = []
    for body in mechanism.inertias:
        for k, inertia in enumerate(body):
            others = body[:k] + body[k + 1 :]
            if inertia not in others:
                found.append(Triangle(inertia, (others[0], others[1])))
    return tuple(dict.fromkeys(found))
