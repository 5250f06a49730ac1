"""Parameters of the dynamics: the logged quasi-velocities compared with those predicted from the logged
inputs."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache, partial

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline

from ...model.algebra.integration import runge_kutta
from ...readers.errors import BadInput
from ...readers.progress import Reported, silent
from .dynamics import Dynamics, combinations
from .faults import contradictions, unexplained, without
from .inverse import InverseDynamics
from .log import Log
from .output_error import OutputError, Prediction, Windows, solvable, with_derivatives
from .plausibility import check_dynamics, check_kinematics
from .result import Identification, result_of

# Rows that are predicted from one initial state; no row is in two windows, whose errors would then be alike
WINDOW = 25
LEFT_OUT = 5  # every so many windows one is not fitted: the validation
LONGEST_STEP = 0.01  # s, of the integration
MISFIT = 0.5  # of the motion: smooth errors from which on nothing is explained
PASSES = 6  # of the fit, at most; after each it is looked for what it contradicts
# Parameters that explain errors if they are not fitted, besides the robot's
FRICTION = ("friction", "dry_friction", "bias_gyro")
MOST_STEPS = 50  # of the integration between two rows


@solvable
def identify(
    log: Log,
    dynamics: Dynamics,
    names: Sequence[str],
    values: Mapping[str, float],
    held: bool | None,
    progress: Reported = silent,
) -> Identification:
    """Fit the named parameters; the others keep `values`, or their defaults. `held`: inputs are constant from
    row to row; None: what fits better.

    Each window of rows is predicted from an initial state, of which the measured coordinates and the
    velocities are fitted too; other coordinates at its start are those of the log. The fit begins with the
    `values` or, if they predict the outputs better, with those that satisfy the equations of motion best.
    Parameters stay within their bounds. Raises BadInput if nothing can be identified or the fit does not
    converge.
    """
    mechanism = dynamics.system.mechanism
    every = dynamics.values(values)
    basis = combinations(dynamics, names, every.tolist())
    if not basis:
        raise BadInput(
            f"--fit {' '.join(names)}: the motion of {mechanism.name} does not depend on these parameters"
        )
    free = [c.pivot for c in basis]
    _check_motions(log, dynamics, every)

    @cache
    def first(names: tuple[str, ...]) -> np.ndarray:
        """Return the parameters with which the equations of motion hold best, those of these names fitted."""
        equations = InverseDynamics(log, dynamics, names, every)
        _check_inputs(log, dynamics, equations)
        return equations.fit(dynamics.upper)

    own, n, outputs = dynamics.robot, len(mechanism.coordinates), [(q.name, q.unit) for q in dynamics.outputs]
    angles = np.array([unit == "rad" for _, unit in outputs])
    for _ in range(PASSES):
        fits = {
            way: predicted(log, dynamics, free, every, way, progress)
            for way in ((True, False) if held is None else (held,))
        }
        for each in fits.values():
            each.leave_out_unseen()
            each.begin(first(tuple(each.names)))
            each.fit()
        way = min(fits, key=lambda each: fits[each].cost)
        fit = fits[way]
        wrong = contradictions(fit.residuals(), fit.windows.measured, fit.windows.number, angles)
        if not wrong:
            break
        measured = replace(log, outputs=log.measured(n))
        (log,) = without([measured], "outputs", wrong, range(len(outputs)), [name for name, _ in outputs])
        first.cache_clear()
    else:
        raise unexplained(log, wrong)
    others = [q.name for q in dynamics.quantities if q.name not in names and q.name in {*own, *FRICTION}]
    plain, late = (
        predicted(each, dynamics, others, fit.values, way).simulated(fit.start)
        for each in (log, replace(log, inputs=_a_row_later(log)))
    )
    of_delay = (late[0] - plain[0]) / log.interval
    of_offsets = np.broadcast_to(np.eye(len(outputs)), (*of_delay.shape, len(outputs)))
    others += ["delay of the inputs", *(f"offset of {name}" for name, _ in outputs)]
    fit.explain(others, np.concatenate([plain[1], of_delay[..., None], of_offsets], axis=3))
    fit.check_misfit(MISFIT)
    return result_of(
        fit, names, basis, len(log.t), log.remarks, outputs, own, inputs="held" if way else "smooth"
    )


def _a_row_later(log: Log) -> np.ndarray:
    """Return the inputs of the row before each row; of the first of a stretch its own."""
    rows = np.arange(len(log.t))
    return log.inputs[np.where(np.isin(rows, [stretch.start for stretch in log.stretches]), rows, rows - 1)]


def _check_motions(log: Log, dynamics: Dynamics, values: np.ndarray) -> None:
    """Raise BadInput if columns of the log contradict each other, unless one is changed."""
    mechanism = dynamics.system.mechanism
    known = {
        q.name: each for q, each in zip(dynamics.system.state, log.x.T, strict=True) if q.name in log.state
    }
    coordinates = {q.name for q in mechanism.coordinates}
    angles = [name for k in dynamics.direct if (name := dynamics.outputs[k].name) in coordinates]
    check_kinematics(
        log.t, known, dynamics.system, values[: len(mechanism.parameters)].tolist(), log.stretches, angles
    )


def _check_inputs(log: Log, dynamics: Dynamics, equations: InverseDynamics) -> None:
    """Raise BadInput if inputs and velocities of the log contradict the equations of motion,
    unless one is changed."""
    n, inputs = len(dynamics.system.mechanism.coordinates), [q.name for q in dynamics.inputs]
    velocities = dynamics.velocities_in(log.state)
    columns = dict(zip((*velocities, *inputs), np.hstack([log.x[:, n:], log.inputs]).T, strict=True))

    def misfit(changed: Mapping[str, np.ndarray]) -> float:
        nu, given = (np.column_stack([changed[name] for name in names]) for names in (velocities, inputs))
        other = equations.with_columns(nu, given)
        return other.misfit(other.fit(dynamics.upper))

    check_dynamics(columns, misfit, velocities, inputs)


def predicted(
    log: Log,
    dynamics: Dynamics,
    names: Sequence[str],
    values: np.ndarray,
    held: bool,
    progress: Reported = silent,
) -> OutputError:
    """Return the prediction of the outputs of a log. `values`: all parameters; `names`:
    those that may be fitted."""
    windows = _windows(log, dynamics, held)
    steps = min(MOST_STEPS, max(1, math.ceil(float(windows.inputs[:, :, -1].max()) / LONGEST_STEP - 1e-6)))
    bounds = dynamics.upper, dynamics.triangles
    return OutputError(
        _prediction(dynamics, steps, names), windows, dynamics.quantities, values, progress, *bounds
    )


def _windows(log: Log, dynamics: Dynamics, held: bool) -> Windows:
    n = len(dynamics.system.mechanism.coordinates)
    starts = [k for stretch in log.stretches for k in range(stretch.start, stretch.stop - WINDOW + 1, WINDOW)]
    if len(starts) < 2 * LEFT_OUT:
        raise BadInput(
            f"the log has {len(starts)} stretches of {WINDOW} rows without a gap; {2 * LEFT_OUT} are needed"
        )
    rows = np.array(starts)[:, None] + np.arange(WINDOW)
    x, dt = log.x[rows], np.diff(log.t[rows], axis=1, append=log.t[rows[:, -1:]])
    if not np.ptp(x[:, :, n:], axis=(0, 1)).max() > 0:
        raise BadInput(
            "the quasi-velocities of the log do not change; a motion with changing speed is needed"
        )
    first, next_row = log.inputs[rows], np.minimum(rows + 1, rows[:, -1:])
    middle, last = (first, first) if held else (_between(log)[rows], log.inputs[next_row])
    inputs = np.concatenate([first, middle, last, dt[:, :, None]], axis=2)
    used = np.arange(len(starts)) % LEFT_OUT != LEFT_OUT - 1
    return Windows(x[:, 0], dynamics.start_places, inputs, log.measured(n)[rows], used, log.t[rows], rows)


def _between(log: Log) -> np.ndarray:
    """Return the inputs in the middle between each row and the next, by cubic splines;
    the last of a stretch is its own."""
    middle = log.inputs.copy()
    for stretch in log.stretches:
        if len(stretch) > 1:
            t, tau = log.t[stretch.start : stretch.stop], log.inputs[stretch.start : stretch.stop]
            middle[stretch.start : stretch.stop - 1] = CubicSpline(t, tau)((t[:-1] + t[1:]) / 2)
    return middle


def _prediction(dynamics: Dynamics, steps: int, names: Sequence[str]) -> Prediction:
    """Return the motion from row to row, by Runge-Kutta of order 4. The inputs of an interval are the logged
    ones at its beginning, in its middle and at its end, and its length.
    """
    system, state = dynamics.system, dynamics.state
    tau, u = ca.SX.sym("tau", dynamics.torque.shape[0]), ca.SX.sym("u", len(dynamics.inputs))
    every, symbols = dynamics.parameters, [q.symbol for q in dynamics.quantities]
    motion = ca.Function("motion", [state, tau, every], [ca.vertcat(system.qdot, system.acceleration(tau))])
    torque = ca.Function("torque", [state, dynamics.logged, every], [dynamics.torque])
    rate = ca.Function("rate", [state, u, every], [motion(state, torque(state, u, every), every)])
    first, middle, last = (ca.SX.sym(name, u.shape[0]) for name in ("first", "middle", "last"))
    dt = ca.SX.sym("dt")

    def f(at: ca.SX, s: float) -> ca.SX:
        parabola = (1 - s) * (1 - 2 * s) * first + 4 * s * (1 - s) * middle + s * (2 * s - 1) * last
        return rate(at, parabola, every)

    h, end = dt / steps, state
    for k in range(steps):
        a, b, c = k / steps, (k + 0.5) / steps, (k + 1) / steps
        end = runge_kutta([partial(f, s=s) for s in (a, b, b, c)], end, h)
    inputs = ca.vertcat(first, middle, last, dt)
    fitted = [q.symbol for name in names for q in dynamics.quantities if q.name == name]
    return Prediction(
        with_derivatives("step", end, state, inputs, symbols, fitted),
        with_derivatives("output", dynamics.measured, state, inputs, symbols, fitted),
        tuple(names),
        np.array([q.unit == "rad" for q in dynamics.outputs]),
    )
