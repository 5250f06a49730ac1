"""The closed loop marched through time, the controller continuous or called at a period."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.integrate import DOP853
from scipy.optimize import brentq

from .errors import BadInput
from .loop import RUNNING, Loop
from .spec import Simulation

SHORTEST = 1e-9  # s: a step that meets an error is shortened down to this, then the run stops
FIRST = 1e-3  # s, the first step tried
SHRINK = 0.2
BEYOND = 1e-9  # m: a piece of a path is left so little beyond its end, where rounding cannot call it back


@dataclass(frozen=True)
class Row:
    """One instant: true state, state the controller saw, inputs, status, what was followed and how (config, reference).

    `integral`: of the error, for each output with integral action.
    """

    t: float
    x: np.ndarray
    seen: np.ndarray
    tau: np.ndarray
    status: str
    piece: int
    config: np.ndarray
    reference: np.ndarray
    integral: np.ndarray


def continuous(loop: Loop, simulation: Simulation) -> Iterator[Row]:
    """The controller is part of the right-hand side. Steps end on the rows, so that rows are as good as steps. The integrals z
    of the errors of outputs with integral action are further states: [x; z].

    Where a trial step meets an error, a shorter one is tried; the run stops when none of at least SHORTEST is left. Where a
    step passes the end of a piece of the path, it is taken again up to that end.
    """
    n, ki = len(loop.start), loop.integral.ki

    def command(t: float, state: np.ndarray) -> tuple[str, np.ndarray]:
        return loop.command(t, state[:n], ki * state[n:])

    def rate(t: float, state: np.ndarray) -> np.ndarray:
        status, tau = command(t, state)
        if status not in RUNNING:
            raise _Refused(status)
        return np.concatenate([loop.plant.rate(state[:n], tau), loop.error(t, state[:n])])

    def solver_from(t: float, state: np.ndarray, bound: float) -> DOP853:
        first = min(FIRST, bound - t) or FIRST
        return DOP853(rate, t, state, bound, first_step=first, rtol=simulation.tolerance, atol=simulation.tolerance)

    solver = solver_from(0.0, np.concatenate([loop.start, np.zeros(len(ki))]), simulation.duration)
    for t in _row_times(simulation):
        solver.t_bound, solver.status = t, "running"
        while solver.t < t:
            try:
                _take_step(solver, simulation.tolerance)
            except _Refused as refused:
                if solver.h_abs <= SHORTEST:
                    yield _row(loop, solver.t, solver.y[:n], _none(loop), refused.status, solver.y[n:])
                    return
                solver.h_abs *= SHRINK
                continue
            end = _end_of_piece(loop, solver)
            if end is not None:
                solver = solver_from(*end, t)
        status, tau = command(t, solver.y)
        yield _row(loop, t, solver.y[:n], tau, status, solver.y[n:])
        if status not in RUNNING:
            return


def sampled(loop: Loop, simulation: Simulation) -> Iterator[Row]:
    """The controller is called every `period`, its torque held until the next one acts, as a firmware loop does."""
    period, tolerance = simulation.period, simulation.tolerance
    slack = 1e-9 * min(period, simulation.output_step)  # a row this near to a call belongs to the call
    rows = iter(_row_times(simulation))
    row = next(rows)
    x, t, held, status = loop.start, 0.0, _none(loop), "ok"
    integrators = loop.integral.integrators(simulation.backend)
    for k in itertools.count():
        loop.sense(t, x)
        loop.guidance.update(t, loop.seen(x))
        add = [one.step(e, period, status) for one, e in zip(integrators, loop.error(t, x), strict=True)]
        z = np.array([one.z for one in integrators])
        status, tau = loop.command(t, x, add)
        if status not in RUNNING:
            yield _row(loop, t, x, _none(loop), status, z)
            return
        end = (k + 1) * period
        for acting, last in ((held, min(t + simulation.delay, end)), (tau, end)):
            while t < last:
                due = row < last - slack
                until = row if due else last
                try:
                    x = _hold(loop, t, x, acting, until - t, tolerance)
                except _Refused as refused:
                    yield _row(loop, refused.t, refused.x, _none(loop), refused.status, z)
                    return
                t = max(t, until)
                if due:
                    yield _row(loop, row, x, acting, status, z)
                    row = next(rows, None)
                    if row is None:
                        return
        held = tau


class _Refused(Exception):
    """A state at which the run cannot go on."""

    def __init__(self, status: str, t: float = 0.0, x: np.ndarray | None = None):
        super().__init__(status)
        self.status, self.t, self.x = status, t, x


def _take_step(solver: DOP853, tolerance: float) -> None:
    solver.step()
    if solver.status == "failed":
        raise BadInput(f"[simulation] tolerance = {tolerance:g} cannot be met at t = {solver.t:.9g} s; loosen it")


def _end_of_piece(loop: Loop, solver: DOP853) -> tuple[float, np.ndarray] | None:
    """Time and [x; z] where the last step left the piece of path, the guidance having gone on; None where it did not."""
    guidance, n = loop.guidance, len(loop.start)
    start, end, state = solver.t_old, solver.t, solver.y
    left = guidance.left(end, state[:n])
    if left <= -BEYOND:
        within = solver.dense_output()

        def beyond(t: float) -> float:
            return guidance.left(t, within(t)[:n]) + BEYOND

        end = brentq(beyond, start, end, xtol=1e-15) if beyond(start) > 0 else start
        state = within(end)
    guidance.update(end, state[:n])
    return None if left > 0 else (end, state)


def _hold(loop: Loop, t: float, x: np.ndarray, tau: np.ndarray, duration: float, tolerance: float) -> np.ndarray:
    """State after `duration` seconds of constant tau. Raises _Refused where it meets the singular set or overflows."""
    left = h = duration
    while left > 0:
        h = min(h, left)
        after, error = loop.plant.step(x, tau, h, tolerance)
        if not error <= 1:  # also when it is NaN
            if h <= SHORTEST and not np.isfinite(error):
                raise _Refused("nonfinite", t + duration - left, x)
            h *= max(SHRINK, 0.9 * error**-0.125) if np.isfinite(error) else SHRINK
            continue
        if loop.beyond(after):
            raise _crossing(loop, t + duration - left, x, tau, h, tolerance)
        x, left = after, left - h
    return x


def _crossing(loop: Loop, t: float, x: np.ndarray, tau: np.ndarray, h: float, tolerance: float) -> _Refused:
    """Where a step of h seconds from x at t goes through the singular set."""

    def after(s: float) -> np.ndarray:
        return loop.plant.step(x, tau, s, tolerance)[0]

    s = brentq(lambda s: loop.guidance.leg.side(after(s)), 0.0, h, xtol=SHORTEST)
    return _Refused("singular", t + s, after(s))


def _row(loop: Loop, t: float, x: np.ndarray, tau: np.ndarray, status: str, z: np.ndarray) -> Row:
    seen, guidance = loop.seen(x), loop.guidance
    return Row(t, x, seen, tau, status, guidance.piece, guidance.leg.config, guidance.reference(t, seen), z)


def _none(loop: Loop) -> np.ndarray:
    return np.zeros(len(loop.law.system.mechanism.inputs))


def _row_times(simulation: Simulation) -> list[float]:
    """Multiples of output_step, and the end."""
    step, end = simulation.output_step, simulation.duration
    return [*(k * step for k in range(int(np.ceil(end / step - 1e-9)))), end]
