"""The closed loop of line.toml as it is commonly written by hand for many robots: Runge-Kutta of order 4, the law at each
call. The same functions run on arrays of NumPy, and compiled by numba, one robot after the other.
"""

import math
from collections.abc import Callable

import numpy as np
from noslip.simulation.loop import Loop


def constants(loop: Loop, gains: dict[str, float]) -> tuple[float, ...]:
    """Return the numbers of the equations, computed once for all calls."""
    b, d, r, m_c, m_w, I_c, I_w, I_m = loop.plant.parameters
    L, A, B, C = loop.guidance.leg.config
    norm, speed = math.hypot(A, B), loop.guidance.reference(0.0, loop.start)[3]
    mass, inertia = m_c + 2 * m_w + 2 * I_w / r**2, I_c + m_c * d**2 + 2 * (I_m + m_w * b**2 + I_w * b**2 / r**2)
    numbers = (r / 2, r / (2 * b), d, m_c * d, r, b, mass, inertia, L, A / norm, B / norm, C / norm, L + d, speed)
    return tuple(map(float, (*numbers, gains["kp"], gains["kd"], gains["kv"])))


def made(compiled: Callable[[Callable], Callable] = lambda function: function) -> Callable:
    """Return the function that runs a loop, `compiled`: constants, state, calls, steps in a period, length of a step -> state."""

    @compiled
    def torques(c, x):
        half, turn, _, shift, r, b, mass, inertia, L, A, B, C, ahead, speed, kp, kd, kv = c
        sin, cos = np.sin(x[2]), np.cos(x[2])
        v, omega = half * (x[5] + x[6]), turn * (x[5] - x[6])
        along, across = A * cos + B * sin, B * cos - A * sin
        distance, rate = A * (x[0] + L * cos) + B * (x[1] + L * sin) + C, v * along + ahead * omega * across
        v_dot = kv * (speed - v)
        omega_dot = (-kp * distance - kd * rate - v_dot * along - v * omega * across + ahead * omega**2 * along) / (
            ahead * across
        )
        both, difference = r * (mass * v_dot - shift * omega**2), r / b * (inertia * omega_dot + shift * v * omega)
        return 0.5 * (both + difference), 0.5 * (both - difference)

    @compiled
    def rates(c, x, tau):
        half, turn, d, shift, r, b, mass, inertia = c[:8]
        sin, cos = np.sin(x[2]), np.cos(x[2])
        v, omega = half * (x[5] + x[6]), turn * (x[5] - x[6])
        v_dot = (shift * omega**2 + (tau[0] + tau[1]) / r) / mass
        omega_dot = (b / r * (tau[0] - tau[1]) - shift * v * omega) / inertia
        forward, around = v_dot / r, b / r * omega_dot
        return v * cos - d * omega * sin, v * sin + d * omega * cos, omega, x[5], x[6], forward + around, forward - around

    @compiled
    def moved(x, k, h):
        return (
            *(x[0] + h * k[0], x[1] + h * k[1], x[2] + h * k[2], x[3] + h * k[3]),
            *(x[4] + h * k[4], x[5] + h * k[5], x[6] + h * k[6]),
        )

    @compiled
    def run(c, x, calls, steps, h):
        for _ in range(calls):
            tau = torques(c, x)
            for _ in range(steps):
                k1 = rates(c, x, tau)
                k2 = rates(c, moved(x, k1, h / 2), tau)
                k3 = rates(c, moved(x, k2, h / 2), tau)
                k4 = rates(c, moved(x, k3, h), tau)
                x = moved(moved(moved(moved(x, k1, h / 6), k2, h / 3), k3, h / 3), k4, h / 6)
        return x

    return run


def in_numpy(loop: Loop, gains: dict[str, float], count: int, calls: int, period: float, steps: int) -> Callable[[], np.ndarray]:
    """Return the function that runs `count` robots at once and returns the states at the end, (7, N)."""
    run, c = made(), constants(loop, gains)
    x = tuple(np.full(count, value) for value in loop.start)
    return lambda: np.array(run(c, x, calls, steps, period / steps))


def in_numba(
    loop: Loop, gains: dict[str, float], count: int, calls: int, period: float, steps: int
) -> Callable[[], np.ndarray] | None:
    """Return the same for numba, None if it is not installed; compiled before."""
    try:
        from numba import njit
    except ImportError:
        return None
    run, c, starts = made(njit), constants(loop, gains), np.tile(loop.start, (count, 1))

    @njit
    def each(c, starts, calls, steps, h):
        ends = np.empty((7, len(starts)))
        for k in range(len(starts)):
            s = starts[k]
            ends[:, k] = run(c, (s[0], s[1], s[2], s[3], s[4], s[5], s[6]), calls, steps, h)
        return ends

    each(c, starts[:1], 1, 1, period)
    return lambda: each(c, starts, calls, steps, period / steps)
