"""Small systems of linear equations with sums in a fixed order:
those of BLAS and LAPACK depend on the processor."""

import numpy as np

DEPENDENT = 1e-13  # of a row: a smaller remainder after subtracting the others is due to rounding


def least_norm(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the least-norm x with A x = b, (N, k) from (N, m, k) and (N, m). A row that depends on those
    before it is ignored.

    Uses the Gram-Schmidt process twice.
    """
    directions: list[np.ndarray] = []
    x = np.zeros((len(A), A.shape[2]))
    for k in range(A.shape[1]):
        row, size = A[:, k], _norm(A[:, k])
        for direction in directions * 2:
            row = row - (row * direction).sum(axis=1)[:, None] * direction
        left = _norm(row)
        counts = left > DEPENDENT * size
        direction = np.where(counts, row / np.where(counts, left, 1.0), 0.0)
        missing = b[:, k, None] - (A[:, k] * x).sum(axis=1)[:, None]
        x = x + missing / np.where(counts, left, 1.0) * direction
        directions.append(direction)
    return x


def least_squares(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the x with the smallest |A x - b|, the shortest if there are several, (k,) from (m,
    k) and (m,)."""
    directions: list[np.ndarray] = []
    for column in A.T:
        left = column
        for direction in directions * 2:
            left = left - (left * direction).sum() * direction
        size = np.sqrt((left * left).sum())
        if size > DEPENDENT * np.sqrt((column * column).sum()):
            directions.append(left / size)
    if not directions:
        return np.zeros(A.shape[1])
    Q = np.array(directions)
    return least_norm((Q[:, :, None] * A).sum(axis=1)[None], (Q * b).sum(axis=1)[None])[0]


def _norm(rows: np.ndarray) -> np.ndarray:
    return np.sqrt((rows * rows).sum(axis=1))[:, None]
