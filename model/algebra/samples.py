"""Random states and parameters for evaluating generic properties: ranks, relative degrees, signs."""

from collections.abc import Iterator, Sequence
from itertools import combinations

import casadi as ca
import numpy as np

from ..errors import ModelError
from ..mechanism import Quantity

SAMPLES = 8  # every second one with all parameters at their defaults
RANK_TOLERANCE = 1e-9  # relative to the largest singular value


class Sampled:
    """A matrix at a few random states, with parameters at and around their defaults: generic rank and size.

    Raises ModelError if it is not finite at any of them.
    """

    def __init__(self, matrix: ca.SX, states: ca.SX, parameters: Sequence[Quantity], where: str):
        function = ca.Function(
            "sample", [states, ca.vertcat(*[p.symbol for p in parameters])], [ca.densify(matrix)]
        )
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
            raise ModelError(
                f"{where}: not finite at any of {SAMPLES} random states; check for a division by zero"
            )

    def rank(self) -> int:
        """Return the largest rank in the samples, which is the generic rank."""
        return max(rank(value) for value in self.values)

    def largest(self) -> float:
        """Return the largest absolute value of an entry in the samples."""
        return max(float(np.abs(value).max(initial=0.0)) for value in self.values)

    def largest_row(self) -> int:
        """Return the row of the largest entry."""
        return int(np.argmax(np.max(np.abs(self.values), axis=(0, 2))))

    def dependent_row(self) -> int:
        """Return the first row that depends linearly on the rows before it."""
        value = max(self.values, key=rank)
        return next(k for k in range(value.shape[0]) if rank(value[: k + 1]) <= k)


def rank(value: np.ndarray) -> int:
    """Return the number of singular values that are not negligible."""
    singular = np.linalg.svd(value, compute_uv=False)
    return int(np.sum(singular > RANK_TOLERANCE * max(singular.max(initial=0.0), np.finfo(float).tiny)))


def dependent_sets(values: Sequence[np.ndarray]) -> Iterator[list[int]]:
    """Yield sets of rows that are dependent in every sample, smallest first."""
    for size in range(2, len(values[0]) + 1):
        for rows in map(list, combinations(range(len(values[0])), size)):
            if all(rank(value[rows, :]) < size for value in values):
                yield rows


def smallest_eigenvalue(value: np.ndarray) -> float:
    """Return the smallest eigenvalue of a symmetric matrix, scaled to a diagonal of ones,
    so that units have no effect."""
    diagonal = np.diag(value)
    if diagonal.min() <= 0.0:
        return -1.0 if diagonal.min() < 0.0 else 0.0
    scale = 1 / np.sqrt(diagonal)
    return float(np.linalg.eigvalsh(value * np.outer(scale, scale))[0])


def _near(parameter: Quantity, change: float) -> float:
    """Return a value near the default with the required sign;
    near zero if the default is zero and may have either sign."""
    size = abs(parameter.default) or 1.0
    middle = parameter.default if parameter.sign == "any" or not change else size
    return middle + change * size
