"""Smoothed signals: a low-pass filter that runs forwards and backwards, without a delay; slopes;
velocities from angles."""

from collections.abc import Sequence

import casadi as ca
import numpy as np
from scipy.signal import butter, filtfilt

from .dynamics import Dynamics

CUTOFF = 0.05  # of the rate of the rows: frequency from which on a signal is taken for noise
ORDER = 2  # of the Butterworth filter, which is applied twice
PAD = 3 * (ORDER + 1)  # rows by which the filter continues a signal at each end


def smooth(signals: np.ndarray, stretches: Sequence[range]) -> np.ndarray:
    """Return signals (N, k) after the filter, each stretch by itself; too short ones are unchanged."""
    numerator, denominator = butter(ORDER, 2 * CUTOFF)
    result = signals.copy()
    for stretch in stretches:
        if len(stretch) > PAD:
            rows = slice(stretch.start, stretch.stop)
            result[rows] = filtfilt(numerator, denominator, signals[rows], axis=0)
    return result


def slopes(t: np.ndarray, signals: np.ndarray, stretches: Sequence[range]) -> np.ndarray:
    """Return the derivatives of signals (N, k) by time, each stretch by itself;
    those of a single row are 0."""
    result = np.zeros_like(signals)
    for stretch in stretches:
        if len(stretch) > 1:
            rows = slice(stretch.start, stretch.stop)
            result[rows] = np.gradient(signals[rows], t[rows], axis=0)
    return result


def velocities(t: np.ndarray, x: np.ndarray, dynamics: Dynamics, stretches: Sequence[range]) -> np.ndarray:
    """Return the quasi-velocities (N, n-m) that the outputs give, of which x (N,
    2n-m) contains the measured ones."""
    system = dynamics.system
    names, n = [q.name for q in system.state], len(system.mechanism.coordinates)
    rows = [k for k in dynamics.direct if dynamics.outputs[k].name in names]
    places = [names.index(dynamics.outputs[k].name) for k in rows]
    x = smooth(x, stretches)
    rates = np.where(np.array(places) < n, slopes(t, x, stretches)[:, places], x[:, places])
    jacobian = ca.densify(ca.jacobian(dynamics.rates, system.nu)[rows, :])
    rest = ca.densify(ca.substitute(dynamics.rates[rows], system.nu, 0))
    at = ca.Function("at", [system.mechanism.q, dynamics.parameters], [jacobian, rest])
    values = [q.default for q in dynamics.quantities]
    at_rows = (at(q, values) for q in x[:, :n])
    return np.array(
        [
            np.linalg.lstsq(J.full(), rate - c.full().ravel())[0]
            for (J, c), rate in zip(at_rows, rates, strict=True)
        ]
    )
