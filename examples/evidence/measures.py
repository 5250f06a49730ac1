"""Quantities that claims refer to."""

import numpy as np

STILL = 1e-6  # m/s: slower than this is standing, of neither sign


def sign_changes(values: np.ndarray, still: float = STILL) -> int:
    """How often values (N,) change sign, those within `still` of zero left out."""
    return len(reversals(values, still))


def reversals(values: np.ndarray, still: float = STILL) -> list[int]:
    """Rows just after a change of sign, values within `still` of zero left out."""
    rows = np.flatnonzero(np.abs(values) > still)
    return [int(k) for k in rows[1:][np.diff(np.sign(values[rows])) != 0]]


def cusps(run) -> list[int]:
    """Rows at which P_o turns back on its path: it cannot move sideways,
    so its locus has a cusp where its speed changes sign."""
    return reversals(run.speed)


def overshoot(distance: np.ndarray) -> float:
    """How far a distance (N,) gets to the other side than it started on, at least 0."""
    return max(0.0, float((-np.sign(distance[0]) * distance).max()))


def time_to_stay_within(t: np.ndarray, distance: np.ndarray, band: float) -> float:
    """First row's time from which on |distance| stays within the band;
    infinite when it does not end there."""
    outside = np.flatnonzero(np.abs(distance) > band)
    if len(outside) == 0:
        return float(t[0])
    return float(t[outside[-1] + 1]) if outside[-1] + 1 < len(t) else float("inf")
