"""The exponential of small matrices."""

import math

import numpy as np

TERMS = 18  # of the series; for a matrix of norm 1/2 the next is below 1e-22


def exponential(matrix: np.ndarray) -> np.ndarray:
    """Return exp(matrix) by scaling and squaring with the series. SciPy's takes a hundred times as long if
    BLAS uses threads."""
    halvings = max(0, math.frexp(2 * np.abs(matrix).sum(axis=1).max(initial=0.0))[1])
    small = matrix / 2.0**halvings
    series = unit = np.eye(len(matrix))
    for k in range(TERMS, 0, -1):
        series = unit + small @ series / k
    for _ in range(halvings):
        series = series @ series
    return series
