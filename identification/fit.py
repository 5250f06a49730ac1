"""Parameters by output error: the logged quasi-velocities compared with those predicted from the logged inputs."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline

from ..model.errors import ModelError
from ..model.mechanism import Quantity
from ..model.reduction import ReducedSystem
from ..readers.errors import BadInput
from ..readers.progress import Reported, silent
from .identifiability import Combination, combinations
from .log import Log

WINDOW = 25  # rows that are predicted from one initial state
LEFT_OUT = 5  # every so many windows one is not fitted: the validation
LONGEST_STEP = 0.01  # s, of the integration
MOST_STEPS = 50  # of the integration between two rows
ITERATIONS = 60
CONVERGED = 1e-9  # relative change of the parameters
WEAKEST = 1e-7  # smallest singular value of the sensitivities, relative to the largest, that is regarded as a number
DOUBTFUL = 0.5  # standard deviation relative to the value above which the log is said not to tell
WEIGHTINGS = 2


@dataclass(frozen=True)
class Estimate:
    """A parameter's value and standard deviation, both in its unit."""

    quantity: Quantity
    value: float
    sd: float


@dataclass(frozen=True, eq=False)
class Identification:
    """Result of a fit. `estimates` by name; `unidentifiable`: what no motion, or not this log, tells, one sentence each.

    `residual` and `validation` are the RMS errors of the predicted quasi-velocities over the fitted windows and over those left
    out, in the unit of the quasi-velocities, one for each; `held` tells how inputs were taken between the rows.
    """

    estimates: Mapping[str, Estimate]
    unidentifiable: tuple[str, ...]
    residual: np.ndarray
    validation: np.ndarray
    rows: int
    held: bool
    remarks: tuple[str, ...]


def identify(
    log: Log,
    system: ReducedSystem,
    names: Sequence[str],
    values: Mapping[str, float],
    held: bool | None,
    progress: Reported = silent,
) -> Identification:
    """Fit the named parameters; the others keep `values`. `held`: inputs are constant from row to row; None: what fits better.

    Each window of rows is predicted from an initial state that is fitted too; coordinates at its start are those of the log.
    Positive parameters stay positive. Standard deviations are the larger of two estimates: for errors that are independent from
    row to row, and for errors that are correlated within a window. Raises BadInput if nothing can be identified or the fit does
    not converge.
    """
    mechanism = system.mechanism
    every = np.array([values[p.name] for p in mechanism.parameters])
    found = combinations(system, names, every.tolist())
    free = [c.pivot for c in found]
    if not free:
        raise BadInput(f"--fit {' '.join(names)}: the motion of {mechanism.name} does not depend on these parameters")
    fits = [_Fit(log, system, free, every, way, progress) for way in ((held,) if held is not None else (True, False))]
    fit = min(fits, key=lambda each: each.cost)
    unseen = fit.unseen
    sentences = [*_by_structure(names, found), *(_by_log(name) for name in unseen)]
    alone = {c.pivot for c in found if not c.others} - set(unseen)
    sd = fit.deviations()
    for name in sorted(alone, key=names.index):
        if sd[name] > DOUBTFUL * abs(fit.value(name)):
            sentences.append(
                f"{name}: its standard deviation, {sd[name]:.3g}, is more than half of its value, {fit.value(name):.3g}"
            )
            alone.remove(name)
    known = {p.name: p for p in mechanism.parameters}
    estimates = {name: Estimate(known[name], fit.value(name), sd[name]) for name in names if name in alone}
    return Identification(estimates, tuple(sentences), fit.rms(), fit.rms(fitted=False), len(log.t), fit.held, log.remarks)


def _by_structure(names: Sequence[str], found: Sequence[Combination]) -> Iterator[str]:
    for combination in found:
        if combination.others:
            together = [combination.pivot, *(name for name, _ in combination.others)]
            yield f"{', '.join(together)}: any motion shows only {combination} (factors at the given values)"
    for name in names:
        if not any(name in (c.pivot, *dict(c.others)) for c in found):
            yield f"{name}: no motion depends on it"


def _by_log(name: str) -> str:
    return f"{name}: this log does not show it; excite it by another motion, for instance by turning and by changing speed"


class _Fit:
    """Gauss-Newton with damping (Levenberg-Marquardt); the initial velocities of the windows are eliminated in each step."""

    def __init__(self, log: Log, system: ReducedSystem, names: Sequence[str], values: np.ndarray, held: bool, progress: Reported):
        self.held, self.values, self.progress = held, values.copy(), progress
        self.names, self.all_names = list(names), tuple(names)
        parameters = system.mechanism.parameters
        self.places = {p.name: k for k, p in enumerate(parameters)}
        self.quantities = {p.name: p for p in parameters}
        starts = [k for stretch in log.stretches for k in range(stretch.start, stretch.stop - WINDOW + 1, WINDOW - 1)]
        if len(starts) < 2 * LEFT_OUT:
            raise BadInput(f"the log has {len(starts)} stretches of {WINDOW} rows without a gap; {2 * LEFT_OUT} are needed")
        rows = np.array(starts)[:, None] + np.arange(WINDOW)
        middle = log.tau if held else _between(log)
        self.fitted = np.arange(len(starts)) % LEFT_OUT != LEFT_OUT - 1
        self.x, self.dt = log.x[rows], np.diff(log.t[rows], axis=1)
        second = rows[:, :-1] if held else rows[:, 1:]
        self.inputs = np.concatenate([log.tau[rows[:, :-1]], middle[rows[:, :-1]], log.tau[second], self.dt[:, :, None]], axis=2)
        self.n = len(system.mechanism.coordinates)
        self.nu0 = self.x[:, 0, self.n :].copy()
        spread = np.ptp(self.x[:, :, self.n :], axis=(0, 1))
        if not spread.max() > 0:
            raise BadInput("the quasi-velocities of the log do not change; a motion with changing speed is needed")
        self.scale = np.maximum(spread, 1e-9 * spread.max())
        steps = min(MOST_STEPS, max(1, math.ceil(float(self.dt.max()) / LONGEST_STEP - 1e-6)))
        self.step = _step(system, steps, self.names).map(len(starts))
        self.unseen = self._unseen()
        for _ in range(WEIGHTINGS):
            self._converge()
            self.scale = np.maximum(self.rms(), 1e-13 * spread.max())
        self.cost = float(np.sum(np.log(self.scale)))

    def value(self, name: str) -> float:
        return float(self.values[self.places[name]])

    def rms(self, fitted: bool = True) -> np.ndarray:
        """Return the RMS error of each quasi-velocity after fitting the initial velocities."""
        left, _ = self._projected(self.values, self.nu0, self.fitted if fitted else ~self.fitted)
        return np.sqrt(np.mean((left.reshape(len(left), WINDOW, -1) * self.scale) ** 2, axis=(0, 1)))

    def deviations(self) -> dict[str, float]:
        """Return the standard deviations of the parameters, in their units."""
        left, rows = self._projected(self.values, self.nu0, self.fitted)
        sizes = np.linalg.norm(rows, axis=(0, 1))
        rows = rows / sizes
        inverse = np.linalg.inv(np.einsum("wrp,wrq->pq", rows, rows))
        scores = np.einsum("wrp,wr->wp", rows, left)
        unknowns = self.nu0[self.fitted].size + len(self.names)
        independent = np.sum(left**2) / (left.size - unknowns) * inverse
        variance = np.maximum(np.diag(independent), np.diag(inverse @ (scores.T @ scores) @ inverse))
        return dict(zip(self.names, np.sqrt(variance) / sizes, strict=True)) | dict.fromkeys(self.unseen, math.inf)

    def _projected(self, values: np.ndarray, nu0: np.ndarray, windows: np.ndarray | slice) -> tuple[np.ndarray, np.ndarray]:
        """Return residuals of these windows and their derivatives by the fitted parameters; initial velocities are eliminated."""
        residual, by_start, by_values = (each[windows] for each in self._predicted(values, nu0))
        bases = np.linalg.qr(by_start)[0]
        return residual - _apply(bases, residual), by_values - _apply(bases, by_values)

    def _unseen(self) -> list[str]:
        """Remove parameters that the predicted velocities do not depend on, or not by themselves, from those fitted."""
        removed: list[str] = []
        while True:
            rows = self._projected(self.values, self.nu0, slice(None))[1].reshape(-1, len(self.names))
            rows = rows * [self._size(name) for name in self.names]
            _, singular, directions = np.linalg.svd(rows, full_matrices=False)
            if singular[-1] > WEAKEST * singular[0] and singular[0] > 0:
                return removed
            weak = self.names[int(np.argmax(np.abs(directions[-1])))]
            removed.append(weak)
            self.names.remove(weak)
            if not self.names:
                raise BadInput(f"the log does not show {', '.join(removed)}: the motion depends too little on them")

    def _size(self, name: str) -> float:
        return abs(self.value(name)) or 1.0

    def _converge(self) -> None:
        damping = 1e-3
        left, rows = self._projected(self.values, self.nu0, self.fitted)
        for iteration in range(ITERATIONS):
            self.progress(iteration, ITERATIONS, "iterations, or fewer")
            sizes = np.array([self._size(name) for name in self.names])
            rows, left = rows.reshape(-1, len(self.names)) * sizes, left.ravel()
            cost = float(left @ left)
            normal, gradient = rows.T @ rows, rows.T @ left
            if np.abs(np.linalg.lstsq(rows, left, rcond=None)[0]).max() < CONVERGED:
                return
            while True:
                move = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient)
                values = self._moved(move * sizes)
                if values is not None:
                    nu0 = self._starts(values)
                    left, rows = self._projected(values, nu0, self.fitted)
                    if np.sum(left**2) <= cost * (1 + 1e-12):
                        break
                damping *= 10.0
                if damping > 1e12:
                    return
            self.values, self.nu0, damping = values, nu0, damping / 10.0
        raise BadInput("the fit does not converge; start from better values with --set NAME=VALUE")

    def _moved(self, move: np.ndarray) -> np.ndarray | None:
        """Return all parameters after a change of those fitted, or None if one would have the wrong sign."""
        tried = self.values.copy()
        for name, change in zip(self.names, move, strict=True):
            tried[self.places[name]] += change
            try:
                self.quantities[name].check(tried[self.places[name]])
            except ModelError:
                return None
        return tried

    def _starts(self, values: np.ndarray) -> np.ndarray:
        """Return the initial velocities that fit best with these parameters."""
        residual, by_start, _ = self._predicted(values, self.nu0)
        return self.nu0 - np.einsum("wkr,wr->wk", np.linalg.pinv(by_start), residual)

    def _predicted(self, values: np.ndarray, nu0: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return residuals (windows, rows k), and their derivatives by initial velocities and by the fitted parameters."""
        windows, k, p = len(nu0), nu0.shape[1], len(self.names)
        fitted = [self.all_names.index(name) for name in self.names]
        x = np.hstack([self.x[:, 0, : self.n], nu0])
        by_start = np.zeros((windows, x.shape[1], k))
        by_start[:, self.n :] = np.eye(k)
        by_values = np.zeros((windows, x.shape[1], p))
        residual, starts, parameters = (
            [x[:, self.n :] - self.x[:, 0, self.n :]],
            [by_start[:, self.n :]],
            [by_values[:, self.n :]],
        )
        every = np.tile(values[:, None], windows)
        for row in range(WINDOW - 1):
            results = self.step(x.T, self.inputs[:, row].T, every)
            x, A, B = (np.array(each) for each in results)
            x = x.T
            A = A.reshape(len(x[0]), windows, -1).transpose(1, 0, 2)
            B = B.reshape(len(x[0]), windows, -1).transpose(1, 0, 2)[:, :, fitted]
            by_start, by_values = A @ by_start, A @ by_values + B
            residual.append(x[:, self.n :] - self.x[:, row + 1, self.n :])
            starts.append(by_start[:, self.n :])
            parameters.append(by_values[:, self.n :])
        residuals = (np.stack(residual, axis=1) / self.scale).reshape(windows, -1)
        by = [np.stack(each, axis=1) / self.scale[:, None] for each in (starts, parameters)]
        return residuals, by[0].reshape(windows, -1, k), by[1].reshape(windows, -1, p)


def _apply(bases: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return the projections of each window's vector or columns on its basis."""
    return bases @ (bases.transpose(0, 2, 1) @ vectors) if vectors.ndim == 3 else _apply(bases, vectors[:, :, None])[:, :, 0]


def _between(log: Log) -> np.ndarray:
    """Return the inputs in the middle between each row and the next, by cubic splines; the last of a stretch is its own."""
    middle = log.tau.copy()
    for stretch in log.stretches:
        if len(stretch) > 1:
            t, tau = log.t[stretch.start : stretch.stop], log.tau[stretch.start : stretch.stop]
            middle[stretch.start : stretch.stop - 1] = CubicSpline(t, tau)((t[:-1] + t[1:]) / 2)
    return middle


def _step(system: ReducedSystem, steps: int, names: Sequence[str]) -> ca.Function:
    """Return the motion from row to row as a function of state, [inputs at the row, halfway, at the next; interval] and all
    parameters, with its derivatives by state and by the named parameters. Runge-Kutta of order 4.
    """
    mechanism = system.mechanism
    tau = ca.SX.sym("tau", len(mechanism.inputs))
    state = ca.vertcat(*[q.symbol for q in system.state])
    parameters = ca.vertcat(*[p.symbol for p in mechanism.parameters])
    rate = ca.Function("rate", [state, tau, parameters], [ca.vertcat(system.qdot, system.acceleration(tau))])
    x, values = ca.SX.sym("x", state.shape[0]), ca.SX.sym("values", parameters.shape[0])
    first, middle, last = (ca.SX.sym(name, tau.shape[0]) for name in ("first", "middle", "last"))
    dt = ca.SX.sym("dt")

    def f(at: ca.SX, s: float) -> ca.SX:
        parabola = (1 - s) * (1 - 2 * s) * first + 4 * s * (1 - s) * middle + s * (2 * s - 1) * last
        return rate(at, parabola, values)

    h, end = dt / steps, x
    for k in range(steps):
        a, b, c = k / steps, (k + 0.5) / steps, (k + 1) / steps
        k1 = f(end, a)
        k2 = f(end + h / 2 * k1, b)
        k3 = f(end + h / 2 * k2, b)
        end = end + h / 6 * (k1 + 2 * k2 + 2 * k3 + f(end + h * k3, c))
    given = [x, ca.vertcat(first, middle, last, dt), values]
    known = [p.name for p in mechanism.parameters]
    by_values = ca.jacobian(end, values)[:, [known.index(name) for name in names]]
    return ca.Function("step", given, [end, ca.densify(ca.jacobian(end, x)), ca.densify(by_values)])
