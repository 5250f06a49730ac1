"""Output error: parameters of a model from windows of a log, each predicted from an initial state that is fitted too."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..model.errors import ModelError
from ..model.mechanism import Quantity
from ..readers.errors import BadInput
from ..readers.progress import Reported, silent

ITERATIONS = 60
CONVERGED = 1e-9  # relative change of the parameters
GAIN = 1e-12  # expected decrease of the squared errors, relative, that is not worth a step
WEAKEST = 1e-7  # smallest singular value of the sensitivities, relative to the largest, that is regarded as a number
WEIGHTINGS, ROBUST_WEIGHTINGS = 2, 4
FEWEST = 20  # measurements beyond the unknowns from which the size of each output's error can be told
HUBER = 1.345  # standard deviations from which an error has less weight
MEDIAN = 1.4826  # standard deviation of a normal distribution in units of its median absolute value


@dataclass(frozen=True, eq=False)
class Prediction:
    """`step`: (state, inputs of an interval, parameters) -> the state after it; `output`: (state, inputs, parameters) -> what was
    measured there, the inputs those of the interval after it. Both also return derivatives by the state and by `names`.
    `angles`: which outputs are angles, compared up to whole turns.
    """

    step: ca.Function
    output: ca.Function
    names: tuple[str, ...]
    angles: np.ndarray


@dataclass(frozen=True, eq=False)
class Windows:
    """W windows of R rows: the `start` states (W, nx), of which the entries `fitted` are unknown; `inputs` (W, R, ni) of the
    interval after each row, those of the last are given to the output only; `measured` (W, R, ny), NaN where nothing was;
    `used` (W): whether a window is fitted or kept for validation. `t` (W, R): time of each row, s.
    """

    start: np.ndarray
    fitted: Sequence[int]
    inputs: np.ndarray
    measured: np.ndarray
    used: np.ndarray
    t: np.ndarray


class OutputError:
    """Gauss-Newton with damping (Levenberg-Marquardt); the initial states of the windows are eliminated in each step.

    After convergence each output is weighted by the inverse of its RMS error and fitted again. With `robust`, its size is taken
    from the median, and errors beyond HUBER standard deviations have a weight in proportion to 1/|error|.
    """

    def __init__(
        self,
        prediction: Prediction,
        windows: Windows,
        quantities: Sequence[Quantity],
        values: np.ndarray,
        progress: Reported = silent,
    ):
        """`quantities` and `values`: all parameters, in the order in which `step` takes them."""
        self.windows, self.progress, self.values = windows, progress, values.copy()
        self.names, self._all_names = list(prediction.names), prediction.names
        self._angles = prediction.angles
        self.places = {q.name: k for k, q in enumerate(quantities)}
        self.quantities = {q.name: q for q in quantities}
        self.start = windows.start[:, windows.fitted].copy()
        count, rows, _ = windows.measured.shape
        forward, observe = _with_sensitivities(prediction, len(windows.fitted))
        self._forward, self._observe = forward.mapaccum(rows - 1).map(count), observe.map(count * rows)
        self._weight = np.isfinite(windows.measured).astype(float)
        with np.errstate(invalid="ignore"):
            spread = np.nanmax(windows.measured, axis=(0, 1)) - np.nanmin(windows.measured, axis=(0, 1))
        self.scale = np.maximum(spread, 1e-9 * spread.max())
        self.unseen: list[str] = []
        self.cost = math.inf

    def fit(self, robust: bool = False) -> "OutputError":
        """Fit the parameters and return self. Raises BadInput if the log does not show them, or the fit does not converge.

        With few measurements beyond the unknowns, some outputs could be fitted exactly and would then outweigh the others; all
        then have the same weight, 1 m that of 1 rad.
        """
        spread = self.scale
        self.unseen = self._unseen()
        if self.surplus < FEWEST:
            self.scale = np.ones_like(spread)
            self._converge()
            return self
        for _ in range(ROBUST_WEIGHTINGS if robust else WEIGHTINGS):
            self._converge()
            self.scale = np.maximum(self._median() if robust else self.rms(), 1e-13 * spread.max())
            if robust:
                self._reweigh()
        self.cost = float(np.sum(np.log(self.scale)))
        return self

    def expected_deviations(self, noise: np.ndarray) -> dict[str, float]:
        """Return the standard deviations that a fit will have if the errors of each output have the standard deviation `noise`
        and are independent: the bound of Cramer and Rao, before anything is fitted. Infinite for a parameter without effect.
        """
        self.scale = noise
        self.unseen = self._unseen()
        rows = self._projected(self.values, self.start, slice(None))[1].reshape(-1, len(self.names))
        sizes = np.linalg.norm(rows, axis=0)
        variance = np.diag(np.linalg.inv((rows / sizes).T @ (rows / sizes))) / sizes**2
        return dict(zip(self.names, np.sqrt(variance), strict=True)) | dict.fromkeys(self.unseen, math.inf)

    @property
    def surplus(self) -> int:
        """Number of measurements beyond the unknowns."""
        used = self.windows.used
        return int(np.isfinite(self.windows.measured[used]).sum()) - self.start[used].size - len(self.names)

    def value(self, name: str) -> float:
        return float(self.values[self.places[name]])

    def rms(self, used: bool = True) -> np.ndarray:
        """Return the RMS error of each output over the windows that are used, or over the others; NaN if there are none."""
        errors = self._errors(self.windows.used == used)
        with np.errstate(invalid="ignore"):
            return np.sqrt(np.nansum(errors**2, axis=(0, 1)) / np.isfinite(errors).sum(axis=(0, 1)))

    def residuals(self) -> np.ndarray:
        """Return the errors of the outputs, (W, R, ny), in their units; NaN where nothing was measured."""
        return self._errors(slice(None))

    def deviations(self) -> dict[str, float]:
        """Return the standard deviations of the parameters, in their units: the larger of the one for errors that are independent
        from row to row, and of the one for errors that are correlated within a window.
        """
        used = self.windows.used
        left, rows = self._projected(self.values, self.start, used)
        sizes = np.linalg.norm(rows, axis=(0, 1))
        rows = rows / sizes
        inverse = np.linalg.inv(np.einsum("wrp,wrq->pq", rows, rows))
        scores = np.einsum("wrp,wr->wp", rows, left)
        independent = np.sum(left**2) / max(1, self.surplus) * inverse
        variance = np.maximum(np.diag(independent), np.diag(inverse @ (scores.T @ scores) @ inverse))
        return dict(zip(self.names, np.sqrt(variance) / sizes, strict=True)) | dict.fromkeys(self.unseen, math.inf)

    def _errors(self, windows: np.ndarray | slice) -> np.ndarray:
        """Return the errors of the outputs, (windows, R, ny), after fitting the initial states; NaN where not measured."""
        kept, self._weight = self._weight, np.isfinite(self.windows.measured).astype(float)
        left, _ = self._projected(self.values, self.start, windows)
        measured = self._weight[windows] > 0
        self._weight = kept
        return np.where(measured, left.reshape(measured.shape) * self.scale, np.nan)

    def _median(self) -> np.ndarray:
        return MEDIAN * np.nanmedian(np.abs(self._errors(self.windows.used)), axis=(0, 1))

    def _reweigh(self) -> None:
        errors = np.abs(self._errors(slice(None))) / self.scale
        self._weight = np.where(np.isfinite(errors), np.sqrt(HUBER / np.maximum(errors, HUBER)), 0.0)

    def _projected(self, values: np.ndarray, start: np.ndarray, windows: np.ndarray | slice) -> tuple[np.ndarray, np.ndarray]:
        """Return residuals of these windows and their derivatives by the fitted parameters; initial states are eliminated."""
        residual, by_start, by_values = (each[windows] for each in self._predicted(values, start))
        bases, sizes, _ = np.linalg.svd(by_start, full_matrices=False)
        bases = bases * (sizes > 1e-10 * sizes.max(initial=0.0))[:, None, :]
        return residual - _apply(bases, residual), by_values - _apply(bases, by_values)

    def _unseen(self) -> list[str]:
        """Remove parameters that the outputs do not depend on, or not by themselves, from those fitted."""
        removed: list[str] = []
        while True:
            rows = self._projected(self.values, self.start, slice(None))[1].reshape(-1, len(self.names))
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
        damping, used = 1e-3, self.windows.used
        left, rows = self._projected(self.values, self.start, used)
        for iteration in range(ITERATIONS):
            self.progress(iteration, ITERATIONS, "iterations, or fewer")
            sizes = np.array([self._size(name) for name in self.names])
            rows, left = rows.reshape(-1, len(self.names)) * sizes, left.ravel()
            cost = float(left @ left)
            normal, gradient = rows.T @ rows, rows.T @ left
            best = -np.linalg.lstsq(rows, left, rcond=None)[0]
            if np.abs(best).max() < CONVERGED or -gradient @ best <= GAIN * cost:
                return
            while True:
                move = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient)
                values = self._moved(move * sizes)
                if values is not None:
                    start = self._starts(values)
                    left, rows = self._projected(values, start, used)
                    if np.sum(left**2) <= cost * (1 + 1e-12):
                        break
                damping *= 10.0
                if damping > 1e12:
                    return
            self.values, self.start, damping = values, start, damping / 10.0
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
        """Return the initial states that fit best with these parameters."""
        residual, by_start, _ = self._predicted(values, self.start)
        return self.start - np.einsum("wkr,wr->wk", np.linalg.pinv(by_start, rcond=1e-10), residual)

    def _predicted(self, values: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return residuals (W, R ny), and their derivatives by the initial states and by the fitted parameters."""
        logged, columns = self.windows, [self._all_names.index(name) for name in self.names]
        windows, rows, outputs = logged.measured.shape
        x = logged.start.copy()
        x[:, logged.fitted] = start
        unit = np.eye(x.shape[1])[logged.fitted].ravel()  # dx/d(start), column by column
        first = np.hstack([x, np.tile(unit, (windows, 1)), np.zeros((windows, x.shape[1] * len(self._all_names)))])
        inputs, size = logged.inputs, logged.inputs.shape[2]
        later = self._forward(first.T, inputs[:, :-1].reshape(-1, size).T, np.tile(values[:, None], windows * (rows - 1)))
        z = np.concatenate([first[:, None], np.array(later).T.reshape(windows, rows - 1, -1)], axis=1)
        observed = self._observe(
            z.reshape(windows * rows, -1).T, inputs.reshape(-1, size).T, np.tile(values[:, None], windows * rows)
        )
        y, starts, parameters = (np.array(each).reshape(outputs, windows, rows, -1).transpose(1, 2, 0, 3) for each in observed)
        residual = y[..., 0] - logged.measured
        residual = np.where(self._angles, np.remainder(residual + np.pi, 2 * np.pi) - np.pi, residual)
        weight = self._weight / self.scale
        return (
            np.where(self._weight > 0, residual * weight, 0.0).reshape(windows, -1),
            (starts * weight[..., None]).reshape(windows, rows * outputs, -1),
            (parameters[..., columns] * weight[..., None]).reshape(windows, rows * outputs, -1),
        )


def runge_kutta(rates: Iterable[Callable[[ca.SX], ca.SX]], x: ca.SX, h: ca.SX | float) -> ca.SX:
    """Return x after a step of length h of order 4; `rates` of x at its beginning, twice in its middle, and at its end."""
    begin, middle, again, end = rates
    k1 = begin(x)
    k2 = middle(x + h / 2 * k1)
    k3 = again(x + h / 2 * k2)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + end(x + h * k3))


def with_derivatives(
    name: str, result: ca.SX, x: ca.SX, inputs: ca.SX, parameters: Sequence[ca.SX], fitted: Sequence[ca.SX]
) -> ca.Function:
    """Return (x, inputs, parameters) -> result and its derivatives by x and by the fitted parameters."""
    derivatives = [ca.densify(ca.jacobian(result, each)) for each in (x, ca.vertcat(*fitted))]
    return ca.Function(name, [x, inputs, ca.vertcat(*parameters)], [ca.densify(result), *derivatives])


def _with_sensitivities(prediction: Prediction, fitted: int) -> tuple[ca.Function, ca.Function]:
    """Return step and output with z = [x; dx/d(start); dx/d(parameters)] instead of x, the derivatives column by column; the
    output also returns its derivatives by the start, of which `fitted` entries are unknown, and by the parameters.
    """
    step, output = prediction.step, prediction.output
    x, inputs, values = (ca.SX.sym(name, step.size1_in(k)) for k, name in enumerate(("x", "inputs", "values")))
    by_start, by_values = ca.SX.sym("X", x.shape[0], fitted), ca.SX.sym("P", x.shape[0], len(prediction.names))
    z = ca.vertcat(x, ca.vec(by_start), ca.vec(by_values))
    after, A, B = step(x, inputs, values)
    forward = ca.vertcat(after, ca.vec(A @ by_start), ca.vec(A @ by_values + B))
    y, C, D = output(x, inputs, values)
    return (
        ca.Function("forward", [z, inputs, values], [ca.densify(forward)]),
        ca.Function("observe", [z, inputs, values], [y, ca.densify(C @ by_start), ca.densify(C @ by_values + D)]),
    )


def _apply(bases: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return the projections of each window's vector or columns on its basis."""
    return bases @ (bases.transpose(0, 2, 1) @ vectors) if vectors.ndim == 3 else _apply(bases, vectors[:, :, None])[:, :, 0]
