"""Initial states of many robots at once: from a point, a heading and a speed to coordinates and
quasi-velocities."""

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from ..model.algebra.linear_numbers import least_norm
from ..model.algebra.portable import portable
from ..model.law import ControlLaw, symbols
from ..model.outputs import OutputRow, body_point, forward_speed, reference_point
from ..model.reduction import ReducedSystem

TRIES = 50
ENOUGH = 1e-12  # relative residual


def starts(
    system: ReducedSystem,
    parameters: np.ndarray,
    place: tuple[np.ndarray, np.ndarray],
    pose: np.ndarray,
    speed: np.ndarray,
    begin: np.ndarray | None = None,
) -> np.ndarray:
    """Return [q; nu] at t = 0, (N, 2n-m), of N robots with `parameters` (N, P), such that the point P_l, L
    ahead and W to the left as in `place` (N, N), is at `pose` (N, 3): x, y (m) and heading (rad), with a
    forward `speed` (N) m/s and no turning.

    Of the remaining degrees of freedom, the solution of least distance from `begin` (N, n) is used, by
    default zeros; coordinates on which the reduced mass matrix depends stay as they are there if possible: a
    vehicle starts with its wheels straight. NaN if the robot cannot be there.
    """
    where, motion, shape = _functions(system)
    known = [*place, *parameters.T]
    first = np.zeros((len(pose), len(shape))) if begin is None else begin
    q = _solved(where, pose, known, ~shape, first)
    lost = np.isnan(q).any(axis=1)
    if lost.any() and shape.any():
        q[lost] = _solved(where, pose[lost], [k[lost] for k in known], np.ones_like(shape), first[lost])
    target = np.column_stack([speed, np.zeros(len(speed))])
    nu = _solved(
        motion, target, [*q.T, *parameters.T], np.ones(system.dof, bool), np.zeros((len(q), system.dof))
    )
    return np.hstack([q, nu])


@lru_cache(maxsize=16)
def _functions(system: ReducedSystem) -> tuple[ca.Function, ca.Function, np.ndarray]:
    """Of q, then [L; W; parameters]: pose; of nu, then [q; parameters]: forward speed and yaw rate;
    which q shape the mass."""
    mechanism = system.mechanism
    point = body_point(offset=True)
    heading = mechanism.required_vehicle.heading
    place, pose = ca.vertcat(*[q.symbol for q in point]), ca.vertcat(*reference_point(system, point), heading)
    motion = ca.vertcat(forward_speed(system), system.along_motion(heading))

    def function(expression: ca.SX, unknown: ca.SX, known: ca.SX) -> ca.Function:
        slope = ca.densify(ca.jacobian(expression, unknown))
        return portable(ca.Function("start", [unknown, known], [ca.densify(expression), ca.vec(slope)]))

    # Such as a steering angle
    shape = np.array([ca.depends_on(system.Mbar, c.symbol) for c in mechanism.coordinates])
    return (
        function(pose, mechanism.q, ca.vertcat(place, mechanism.p)),
        function(motion, system.nu, ca.vertcat(mechanism.q, mechanism.p)),
        shape,
    )


def extension_starts(
    law: ControlLaw, parameters: np.ndarray, config: np.ndarray, state: np.ndarray, reference: np.ndarray
) -> np.ndarray:
    """Return the states of the dynamic extension at t = 0, (N, k): those with which the outputs of N robots
    at `state` (N, 2n-m) have the derivatives of the `reference` (N, R), or the nearest to them; (N, P)
    `parameters` and (N, C) `config` of the law.

    Order by order: the states on which derivatives of this order depend, and those of lower orders do not,
    are the least-squares solution.
    """
    function, depends = _extension_functions(law)
    names = [q.name for q in law.reference]
    orders = [
        (order, names.index(row.name) + order) for row, degree in _degrees(law) for order in range(1, degree)
    ]
    found, known = np.zeros((len(state), len(law.extension))), np.zeros(len(law.extension), bool)
    for order in range(1, max(order for order, _ in orders) + 1 if orders else 1):
        entries = [k for k, (each, _) in enumerate(orders) if each == order]
        new = np.flatnonzero(depends[entries].any(axis=0) & ~known)
        if not len(new):
            continue
        rate, slope = (v.full().T for v in function(np.hstack([state, found]).T, parameters.T, config.T))
        wrong = reference[:, [orders[k][1] for k in entries]] - rate[:, entries]
        A = slope.reshape(len(state), len(known), -1).swapaxes(1, 2)[:, entries][:, :, new]
        normal = (A[:, :, :, None] * A[:, :, None, :]).sum(axis=1)
        found[:, new] += least_norm(normal, (A * wrong[:, :, None]).sum(axis=1))
        known[new] = True
    return found


def _degrees(law: ControlLaw) -> list[tuple[OutputRow, int]]:
    return list(zip(law.output.rows, law.linearization.relative_degree, strict=True))


@lru_cache(maxsize=16)
def _extension_functions(law: ControlLaw) -> tuple[ca.Function, np.ndarray]:
    """Return the function from state, parameters and config to the rates of the outputs and their derivatives
    by the states of the extension, and which of these derivatives are not always zero.
    """
    rate = law.linearization.rate
    slope = ca.jacobian(rate, symbols(law.extension))
    return portable(law.at_state(rate, ca.vec(ca.densify(slope)))), ca.DM(slope.sparsity(), 1).full() != 0


@lru_cache(maxsize=16)
def _mapped(function: ca.Function, count: int) -> ca.Function:
    """Return the function of `count` columns of arguments at once:
    it takes longer to make than to evaluate."""
    return function.map(count)


def _rows(function: ca.Function, *arguments: np.ndarray) -> list[np.ndarray]:
    """Return the results of a function for each row of its arguments, (N, .) each,
    without the copies of a call of CasADi."""
    given = [np.ascontiguousarray(argument, float) for argument in arguments]
    made = [np.empty((len(given[0]), function.numel_out(k))) for k in range(function.n_out())]
    buffer: Any
    buffer, evaluate = _mapped(function, len(given[0])).buffer()
    for k, argument in enumerate(given):
        buffer.set_arg(k, argument.data)
    for k, result in enumerate(made):
        buffer.set_res(k, result.data)
    evaluate()
    return made


def _solved(
    function: ca.Function, target: np.ndarray, given: list[np.ndarray], moves: np.ndarray, begin: np.ndarray
) -> np.ndarray:
    """Solve function(unknown, given) = target, (N, .), by Newton's method with least-norm steps from `begin`;
    NaN if it does not converge.
    """
    known = np.column_stack(given)
    found = begin.copy()
    enough = ENOUGH * np.maximum(1.0, np.abs(target).max(axis=1, initial=0.0))
    left = np.flatnonzero(np.isfinite(target).all(axis=1) & np.isfinite(known).all(axis=1))
    solved = np.zeros(len(target), bool)
    for _ in range(TRIES):
        if not len(left):
            break
        value, slope = _rows(function, found[left], known[left])
        residual = value - target[left]
        good = np.abs(residual).max(axis=1) <= enough[left]
        solved[left[good]] = True
        usable = ~good & np.isfinite(residual).all(axis=1) & np.isfinite(slope).all(axis=1)
        left, residual, slope = left[usable], residual[usable], slope[usable]
        if len(left):
            jacobian = slope.reshape(len(left), len(moves), -1).swapaxes(1, 2) * moves
            free = (jacobian != 0).any(axis=1)  # the others stay exactly zero
            found[left] -= least_norm(jacobian, residual) * free
    found[~solved] = np.nan
    return found
