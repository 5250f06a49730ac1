"""The closed loop marched through time, the controller continuous or called at a period."""

import itertools
import math
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ..readers.errors import BadInput
from .controllers.controller import RUNNING
from .drive import whole_periods
from .loop import Loop
from .runge_kutta import SHRINK, AcceptedStep, Integrator, resize
from .specification.spec import MOST_ROWS, Simulation

SHORTEST = 1e-9  # s: a step that meets an error is shortened down to this, then the run stops
# A step in continuous time beyond the next row is at most LONGEST, and this share of what the tolerance
# permits: rows within a step are as good as its end.
LONGEST, SHARE = 0.08, 0.5  # s, 1
PACE = 4000  # steps from which on the time they covered decides whether the run goes on
MOST_STEPS = 100_000  # while the inputs are held
# For observers, where another piece of a path begins: there is nothing to compare with
OTHER_OUTPUT = "saturated"
BEYOND = 1e-9  # m: a piece of a path is left so little beyond its end, where rounding cannot call it back


@dataclass(frozen=True)
class Row:
    """One instant: true state, state the controller saw, inputs, status, what was followed and how (config,
    reference).

    `integral`: of the error, for each output with integral action, and then the estimates of observers;
    `extension`: the states of the dynamic extension; `command`: the velocities that drives were given, if
    any; `noticed`: friction believed, uncertain heading and way, if slip is noticed; `learned`: the
    parameters in use that are learned, if any.
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
    extension: np.ndarray
    command: np.ndarray
    noticed: np.ndarray
    learned: np.ndarray


def continuous(loop: Loop, simulation: Simulation, most: int = MOST_ROWS) -> Iterator[Row]:
    """The controller is part of the right-hand side. The integrals z of the errors of outputs with integral
    action and the states xi of a dynamic extension are further states: [x; z; xi]. A row within a step is of
    the polynomial of order 7 through it.

    Where a trial step meets an error, a shorter one is tried; the run stops when none of at least SHORTEST is
    left. Where a step passes the end of a piece of the path, it is used up to that end. Raises BadInput for a
    run that would take more than `most` steps.
    """
    ki = loop.integral.ki
    n, m = len(loop.start), len(loop.start) + len(ki)

    def row(t: float, state: np.ndarray, refused: str = "") -> Row:
        status, tau = refused, None
        if not refused:
            status, tau = loop.call(t, state[:n], state[m:]).command(ki * state[n:m])
        return _row(loop, t, state[:n], tau, status, state[n:m], state[m:])

    def rate(t: float, state: np.ndarray) -> np.ndarray:
        call = loop.call(t, state[:n], state[m:])
        status, tau = call.command(ki * state[n:m])
        if status not in RUNNING:
            raise Refused(status, t, state[:n])
        return np.concatenate([loop.plant.rate(state[:n], tau, t), call.error(), loop.extension_rate])

    begin, steps = 0.0, 0  # of the current piece of the path
    solver = Integrator(
        rate, begin, np.concatenate([loop.start, np.zeros(len(ki)), loop.extension]), simulation.tolerance
    )
    due = deque(_row_times(simulation))
    while True:
        if due[0] <= solver.t:
            yield (last := row(due.popleft(), solver.x))
            if last.status not in RUNNING or not due:
                return
        try:
            long = min(SHARE * solver.h, LONGEST)
            step = solver.step(min(max(due[0], solver.t + long), simulation.duration))
            end, state, over = _up_to_end_of_piece(loop, step)
        except Refused as refused:
            if solver.h <= SHORTEST:
                yield row(solver.t, solver.x, refused.status)
                return
            solver.h *= SHRINK
            continue
        steps += 1
        if steps > PACE and steps * (simulation.duration - begin) > most * (step.end - begin):
            raise _too_stiff(step.end, step.end - step.begin)
        inside = [*itertools.takewhile(end.__gt__, due)]
        for t, between in zip(inside, step.within(np.array(inside)), strict=True):
            due.popleft()
            yield (last := row(t, between))
            if last.status not in RUNNING:
                return
        loop.guidance.update(end, state[:n])
        if over:
            solver.restart(end, state)
            begin, steps = end, 0
        else:
            solver.take(step)


# From t, state, what is held and duration to the state then
Hold = Callable[[float, np.ndarray, np.ndarray, float], np.ndarray]
# From a state and an impulse along the quasi-velocities to the state then
Push = Callable[[np.ndarray, np.ndarray], np.ndarray]


def sampled(loop: Loop, simulation: Simulation, moved_by: tuple[Hold, Push] | None = None) -> Iterator[Row]:
    """The controller is called every `period`, what the drives are given held until the next acts, as a
    firmware loop does.

    `moved_by` moves the robot in between, and pushes it; without it that is the plant, which rolls.
    """
    period = simulation.period
    xi = loop.extension
    pushes = deque(sorted(loop.pushes, key=lambda push: push[0]))

    def rolls(t: float, x: np.ndarray, given: np.ndarray, duration: float) -> np.ndarray:
        return _hold(loop, t, x, xi, given, duration, simulation.tolerance)

    moves, push = moved_by or (rolls, loop.plant.pushed)

    def hold(t: float, x: np.ndarray, given: np.ndarray, duration: float) -> np.ndarray:
        """Move the robot, with the pushes that are due before the end."""
        while pushes and pushes[0][0] < t + duration:
            when, impulse = pushes.popleft()
            before = max(when - t, 0.0)
            x = push(moves(t, x, given, before), impulse)
            t, duration = t + before, duration - before
        return moves(t, x, given, duration)

    whole, rest = whole_periods(simulation.delay + loop.drive.delay, period)
    slack = 1e-9 * min(period, simulation.output_step)  # a row this near to a call belongs to the call
    rows = iter(_row_times(simulation))
    row = next(rows)
    x, t, status = loop.start, 0.0, "ok"
    held, waiting = loop.drive.begin(x), deque[tuple[float, np.ndarray]]()
    integrators = loop.integral.integrators(simulation.backend)
    observers, piece = loop.observers.observers(simulation.backend), loop.guidance.piece
    for k in itertools.count():
        if k:
            xi = xi + period * loop.extension_rate
        loop.sense(t, x)
        loop.guidance.update(t, loop.seen(x))
        call = loop.call(t, x, xi)
        add = np.array(
            [one.step(e, period, status) for one, e in zip(integrators, call.error(), strict=True)]
        )
        before = status if loop.guidance.piece == piece else OTHER_OUTPUT
        piece, observed = loop.guidance.piece, zip(observers, *call.observed(add), strict=True)
        less = np.array([one.step(measured, v, period, before) for one, measured, v in observed])
        z = np.array([*[one.z for one in integrators], *[one.estimate for one in observers]])
        status, given = loop.drive.take(call.seen, *call.command(add, less))
        if status not in RUNNING:
            yield _row(loop, t, x, None, status, z, xi)
            return
        end = (k + 1) * period
        waiting.append((min((k + whole) * period + rest, end + whole * period), given))
        while t < end:
            while waiting and waiting[0][0] <= t:
                held = waiting.popleft()[1]
            last = min(waiting[0][0], end) if waiting else end
            while t < last:
                due = row < last - slack
                until = row if due else last
                try:
                    x = hold(t, x, held, until - t)
                except Refused as refused:
                    yield _row(loop, refused.t, refused.x, None, refused.status, z, xi)
                    return
                t = max(t, until)
                if due:
                    yield _row(loop, row, x, held, status, z, xi)
                    row = next(rows, np.inf)
                    if row == np.inf:
                        return


class Refused(Exception):
    """A state at which the run cannot go on."""

    def __init__(self, status: str, t: float, x: np.ndarray):
        super().__init__(status)
        self.status, self.t, self.x = status, t, x


def _too_stiff(t: float, h: float) -> BadInput:
    """The error of a run that would not end in a time worth waiting for."""
    return BadInput(
        f"the loop is too fast to simulate: at t = {t:.4g} s steps of {h:.1e} s are needed; make gains "
        "smaller"
    )


def _up_to_end_of_piece(loop: Loop, step: AcceptedStep) -> tuple[float, np.ndarray, bool]:
    """Time and [x; z; xi] up to which a step is used, and whether it ends a piece of the path there."""
    guidance, n = loop.guidance, len(loop.start)
    left = guidance.left(step.end, step.after[:n])
    if left > -BEYOND:
        return step.end, step.after, left <= 0

    def beyond(t: float) -> float:
        return guidance.left(t, step.within(t)[:n]) + BEYOND

    end = _root(beyond, step.begin, step.end, 1e-15) if beyond(step.begin) > 0 else step.begin
    return end, step.within(end), True


def _hold(
    loop: Loop, t: float, x: np.ndarray, xi: np.ndarray, given: np.ndarray, duration: float, tolerance: float
) -> np.ndarray:
    """State after `duration` seconds, with what the drives are given held. Raises Refused where it meets the
    singular set or overflows.
    """
    left = h = duration
    for _ in range(MOST_STEPS):
        if left <= 0:
            return x
        h = min(h, left)
        after, error = loop.drive.step(x, given, h, tolerance, t + duration - left)
        if not error <= 1:  # also when it is NaN
            if h <= SHORTEST and not np.isfinite(error):
                raise Refused("nonfinite", t + duration - left, x)
            h *= resize(error)
            continue
        if loop.beyond(after, xi):
            raise _crossing(loop, t + duration - left, x, xi, given, h, tolerance)
        x, left = after, left - h
    raise _too_stiff(t + duration - left, h)


def _crossing(
    loop: Loop, t: float, x: np.ndarray, xi: np.ndarray, given: np.ndarray, h: float, tolerance: float
) -> Refused:
    """Where a step of h seconds from x at t goes through the singular set."""

    def after(s: float) -> np.ndarray:
        return loop.drive.step(x, given, s, tolerance, t)[0]

    s = _root(lambda s: loop.side(after(s), xi), 0.0, h, SHORTEST)
    return Refused("singular", t + s, after(s))


def _row(
    loop: Loop, t: float, x: np.ndarray, given: np.ndarray | None, status: str, z: np.ndarray, xi: np.ndarray
) -> Row:
    """A row with what the drives are given; None: nothing."""
    seen, guidance, drive = loop.seen(x), loop.guidance, loop.drive
    tau = np.zeros(len(loop.law.system.mechanism.inputs)) if given is None else drive.torque(x, given)
    command = np.zeros(drive.commands) if given is None else drive.command(given)
    extra = z, xi, command, _noticed(loop), loop.learned
    return Row(
        t, x, seen, tau, status, guidance.piece, guidance.leg_at(x).config, loop.reference(t, seen), *extra
    )


def _noticed(loop: Loop) -> np.ndarray:
    """Return the friction that is believed, and the uncertainty of dead reckoning (rad, m) if slip is
    noticed; empty without mode "grip"."""
    noticed, mu = loop.noticed, loop.guidance.leg.controller.believed
    uncertain = [noticed.uncertain_heading, noticed.uncertain_way] if noticed else []
    return np.array([mu, *uncertain]) if math.isfinite(mu) else np.zeros(0)


def _row_times(simulation: Simulation) -> list[float]:
    """Multiples of output_step, and the end."""
    step, end = simulation.output_step, simulation.duration
    return [*(k * step for k in range(int(np.ceil(end / step - 1e-9)))), end]


def _root(function: Callable[[float], float], begin: float, end: float, tolerance: float) -> float:
    """Where a function of the time, with opposite signs at the begin and the end, is zero, s."""
    from scipy.optimize import brentq  # slow to import, and needed by few runs

    return brentq(function, begin, end, xtol=tolerance)
