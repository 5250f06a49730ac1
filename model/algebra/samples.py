"""Random states and parameters, at which generic properties (ranks, relative degrees, signs) are looked at."""

from collections.abc import Sequence

import casadi as ca
import numpy as np

from ..errors import ModelError
from ..mechanism import Quantity

SAMPLES = 8  # every other one with all parameters at their defaults
RANK_TOLERANCE = 1e-9  # of the largest singular value


class Sampled:
    """A matrix at a few random states, parameters at and around their defaults: generic rank and size.

    Raises ModelError when it is finite at none of them.
    """

    def __init__(self, matrix: ca.SX, states: ca.SX, parameters: Sequence[Quantity], where: str):
        function = ca.Function("sample", [states, ca.vertcat(*[p.symbol for p in parameters])], [ca.densify(matrix)])
        random = np.random.default_rng(1992)
        points = random.uniform(-1.5, 1.5, (SAMPLES, states.numel()))
        around = random.uniform(-0.5, 0.5, (SAMPLES, len(parameters)))
        around[::2] = 0.0
        values = [
            np.asarray(function(point, [_near(*pair) for pair in zip(parameters, change, strict=True)]))
            for point, change in zip(points, around, strict=True)
        ]
        self.values = [value for value in values if np.all(np.isfinite(value))]
        self.at_defaults = [value for value in values[::2] if np.all(np.isfinite(value))]
        if not self.values:
            raise ModelError(f"{where}: not finite at any of {SAMPLES} random states; look for a division by zero")

    def rank(self) -> int:
        """The largest rank seen: the generic one."""
        return max(rank(value) for value in self.values)

    def largest(self) -> float:
        """The largest absolute entry seen."""
        return max(float(np.abs(value).max(initial=0.0)) for value in self.values)

    def largest_row(self) -> int:
        """The row of that entry."""
        return int(np.argmax(np.max(np.abs(self.values), axis=(0, 2))))

    def dependent_row(self) -> int:
        """The first row that adds nothing to those before it."""
        value = max(self.values, key=rank)
        return next(k for k in range(value.shape[0]) if rank(value[: k + 1]) <= k)


def rank(value: np.ndarray) -> int:
    """Number of singular values that are not negligible."""
    singular = np.linalg.svd(value, compute_uv=False)
    return int(np.sum(singular > RANK_TOLERANCE * max(singular.max(initial=0.0), np.finfo(float).tiny)))


def smallest_eigenvalue(value: np.ndarray) -> float:
    """Of a symmetric matrix scaled to a diagonal of ones, so that units and sizes do not matter."""
    diagonal = np.diag(value)
    if diagonal.min() <= 0.0:
        return -1.0 if diagonal.min() < 0.0 else 0.0
    scale = 1 / np.sqrt(diagonal)
    return float(np.linalg.eigvalsh(value * np.outer(scale, scale))[0])


def _near(parameter: Quantity, change: float) -> float:
    """A value near the default, of the sign it must have; one near zero where the default is zero and may be negative."""
    size = abs(parameter.default) or 1.0
    middle = parameter.default if parameter.sign == "any" or not change else size
    return middle + change * size
