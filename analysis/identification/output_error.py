"""Output error: parameters of a model from windows of a log,
each predicted from an initial state that is fitted too."""

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from scipy.special import stdtrit

from ...model.algebra.direct import Direct
from ...model.errors import ModelError
from ...model.mechanism import Quantity
from ...readers.errors import BadInput, naming
from ...readers.progress import Reported, silent
from .bounds import Triangle, bounded_least_squares
from .faults import EXACT, NORMAL, quantum

ITERATIONS = 60
CONVERGED = 1e-9  # relative change of the parameters
# Of the value with which it began, or its reciprocal: a positive parameter becomes 0 or goes beyond all
# bounds
VANISHED = 1e-4
GAIN = 1e-12  # expected decrease of the squared errors, relative, that is not worth a step
# Smallest singular value of the sensitivities, relative to the largest, that is regarded as a number
WEAKEST = 1e-7
# Change relative to that of a parameter that is not seen, from which another is not seen by itself
TIED = 1e-3
DOUBTFUL = 1e-4  # the same, where the fit does not converge
BEYOND = "the model grows beyond all bounds with these parameters; give better ones with --set NAME=VALUE"
WEIGHTINGS, ROBUST_WEIGHTINGS = 2, 4
FEWEST = 20  # measurements beyond the unknowns from which the size of each output's error can be told
CHANCE = 3.09  # standard deviations that a sum of random sign exceeds in one case of 1000
HUBER = 1.345  # standard deviations from which an error has less weight
LONG = 8  # rows of a window in which drift counts; of fewer, errors that two windows share would hide it
LARGER = 1.5  # times the variance for independent errors: that between windows, from which on it counts
SPARE = 4  # windows beyond the parameters that tell how much errors drift
PHASES = 64  # of a count, at which rounding is repeated
ROUNDED = 1.2  # times the error of rounding to a count: an error beyond has other causes too
SMOOTH = 0.5  # see `check_misfit`
# Square of the part of a derivative that no other one contains, from which a quantity is told apart
APART = 1e-6
RARE = 1e-4  # chance by which a quantity that is 0 may seem not to be
FEW = 3  # systematic errors that are looked for, at most
SHIFTED = 1e-6  # of a value: a change that is worth a remark


@dataclass(frozen=True, eq=False)
class Prediction:
    """`step`: (state, inputs of an interval, parameters) -> the state after it; `output`: (state, inputs,
    parameters) -> what was measured there, the inputs those of the interval after it. Both also return
    derivatives by the state and by `names`. `angles`: which outputs are angles, compared up to whole turns.
    """

    step: ca.Function
    output: ca.Function
    names: tuple[str, ...]
    angles: np.ndarray


@dataclass(frozen=True, eq=False)
class Windows:
    """W windows of R rows: the `start` states (W, nx), of which the entries `fitted` are unknown; `inputs`
    (W, R, ni) of the interval after each row, those of the last are given to the output only; `measured` (W,
    R, ny), NaN where nothing was; `used` (W): whether a window is fitted or kept for validation. `t` (W, R):
    time of each row, s. `number` (W, R): which row of the log it is; one that is in two windows has the same
    error in both.
    """

    start: np.ndarray
    fitted: Sequence[int]
    inputs: np.ndarray
    measured: np.ndarray
    used: np.ndarray
    t: np.ndarray
    number: np.ndarray


class OutputError:
    """Gauss-Newton with damping (Levenberg-Marquardt); the initial states of the windows are eliminated in
    each step.

    After convergence each output is weighted by the inverse of its RMS error and fitted again. With `robust`,
    its size is taken from the median, and errors beyond HUBER standard deviations have a weight in proportion
    to 1/|error|.
    """

    def __init__(
        self,
        prediction: Prediction,
        windows: Windows,
        quantities: Sequence[Quantity],
        values: np.ndarray,
        progress: Reported = silent,
        upper: Mapping[str, float] | None = None,
        triangles: Sequence[Triangle] = (),
    ):
        """`quantities` and `values`: all parameters, in the order of those of `step`; `upper`: the largest
        values of some; `triangles`: what holds for inertias together.
        """
        self.windows, self.progress, self.values, self._given = windows, progress, values.copy(), values
        self.names, self._all_names = list(prediction.names), prediction.names
        self._angles = prediction.angles
        self.places = {q.name: k for k, q in enumerate(quantities)}
        self.quantities = {q.name: q for q in quantities}
        self._upper, self._triangles = upper or {}, triangles
        self.held: list[Triangle] = []  # those at whose bound the fit is
        self.start = windows.start[:, windows.fitted].copy()
        count, rows, _ = windows.measured.shape
        forward, observe = _with_sensitivities(prediction, len(windows.fitted))
        self._forward, self._observe = (
            Direct(forward.mapaccum(rows - 1).map(count)),
            Direct(observe.map(count * rows)),
        )
        self._weight = np.isfinite(windows.measured).astype(float)
        with np.errstate(invalid="ignore"):
            spread = np.nanmax(windows.measured, axis=(0, 1)) - np.nanmin(windows.measured, axis=(0, 1))
        self.scale = np.maximum(spread, 1e-9 * spread.max())
        # What the log does not show, with parameters that it shows only beside it
        self.unseen: dict[str, list[str]] = {}
        self.cost, self._robust = math.inf, False
        self.shifts: dict[str, float] = {}  # of the parameters, by systematic errors; see `explain`
        self.remarks: list[str] = []
        self._unexplained = 1.0  # part of the squared errors that are not systematic
        # Values and start with which was simulated last, and the result
        self._simulated: tuple[Any, Any] = (), ()

    def fit(self, robust: bool = False) -> "OutputError":
        """Fit the parameters and return self. Raises BadInput if the log does not show them, or the fit does
        not converge.

        With few measurements beyond the unknowns, some outputs could be fitted exactly and would then
        outweigh the others; all then have the same weight, 1 m that of 1 rad.
        """
        spread, self._robust = self.scale, robust
        self.leave_out_unseen()
        if self.surplus < 1:
            measured, unknowns = self._counts
            raise BadInput(
                f"the log has {measured} measured numbers for {unknowns} unknown ones, with those of the "
                "start of each window: nothing is left that tells how far the parameters are off; measure "
                "more, or fit fewer parameters"
            )
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

    def leave_out_unseen(self) -> None:
        """Remove fitted parameters that the outputs do not depend on, or not by themselves;
        they keep their values."""
        while weak := self._weakest(WEAKEST):
            name, *others = weak
            self.unseen[name] = others
            self.names.remove(name)
            self.values[self.places[name]] = self._given[self.places[name]]
            if not self.names:
                raise BadInput(
                    f"the log does not show {', '.join(self.unseen)}: the motion depends too little on them"
                )

    def begin(self, values: np.ndarray) -> None:
        """Begin with these parameters if the outputs are then predicted better than with those given. Raises
        BadInput if neither predicts them.
        """
        pairs = [(each, self._tried(each)) for each in (self.values, values)]
        possible = [
            (float(np.sum(after[1] ** 2)), k) for k, (_, after) in enumerate(pairs) if after is not None
        ]
        if not possible:
            raise BadInput(BEYOND)
        self.values = pairs[min(possible)[1]][0].copy()

    def begin_cost(self) -> float:
        """Return the squared errors of the values and initial states at present,
        these fitted to first order."""
        return float(np.sum(self._projected(self.values, self.start, self.windows.used)[0] ** 2))

    def at_bound(self) -> list[str]:
        """Return the fitted parameters that are 0 or at their largest value, and would go on beyond."""
        left, rows = self._projected(self.values, self.start, self.windows.used)
        blocked = self._blocked(np.einsum("wrp,wr->p", rows, left))
        return [name for name, each in zip(self.names, blocked, strict=True) if each]

    def expected_deviations(self, noise: np.ndarray) -> dict[str, float]:
        """Return the standard deviations that a fit will have if the errors of each output have the standard
        deviation `noise` and are independent: the bound of Cramer and Rao if no row is in two windows.
        Infinite for a parameter without effect.
        """
        self.scale = noise
        self.leave_out_unseen()
        rows = self._projected(self.values, self.start, slice(None))[1]
        sizes = np.linalg.norm(rows, axis=(0, 1))
        each, of_log = (
            r.reshape(-1, len(self.names)) for r in (rows / sizes, self._by_row(rows / sizes, slice(None)))
        )
        by_error = of_log @ np.linalg.inv(each.T @ each)
        deviations = np.linalg.norm(by_error, axis=0) / sizes
        return dict(zip(self.names, deviations, strict=True)) | dict.fromkeys(self.unseen, math.inf)

    @property
    def surplus(self) -> int:
        """Number of measurements beyond the unknowns."""
        measured, unknowns = self._counts
        return measured - unknowns

    @property
    def _counts(self) -> tuple[int, int]:
        """Numbers of measurements, and of unknowns with the initial states."""
        used = self.windows.used
        return int(np.isfinite(self.windows.measured[used]).sum()), self.start[used].size + len(self.names)

    def value(self, name: str) -> float:
        return float(self.values[self.places[name]])

    def given(self, name: str) -> float:
        """Return the value with which the fit began."""
        return float(self._given[self.places[name]])

    def rms(self, used: bool = True) -> np.ndarray:
        """Return the RMS error of each output over the windows that are used, or over the others;
        NaN if there are none."""
        errors = self._errors(self.windows.used == used)
        with np.errstate(invalid="ignore"):
            return np.sqrt(np.nansum(errors**2, axis=(0, 1)) / np.isfinite(errors).sum(axis=(0, 1)))

    def residuals(self) -> np.ndarray:
        """Return the errors of the outputs, (W, R, ny), in their units; NaN where nothing was measured."""
        return self._errors(slice(None))

    def deviations(self) -> tuple[dict[str, float], dict[str, float]]:
        """Return the standard deviations of the parameters, in their units, and their degrees of freedom.

        Errors may be correlated in any way within a row, and a row in two windows has one error. Where they
        may drift, or successive errors are correlated beyond chance, they may be correlated in any way within
        a window too: then the variance between windows counts, to which rows in two windows contribute as
        errors that are independent from row to row, if it is clearly larger: that of a few windows, of which
        some tell little, is also small by chance. It is not biased if errors are independent, and its degrees
        of freedom are those of Satterthwaite, which are few where few windows tell most (R. M. Bell and D. F.
        McCaffrey, Survey Methodology 28, 2002). Errors of rounding are those of `_of_counts`. Errors with
        less weight count as in the covariance of an M-estimate (Huber, Robust Statistics, 1981, section 7.6).
        Raises BadInput if there are too few windows.
        """
        left, rows = self._influence()
        sizes = np.linalg.norm(rows, axis=(0, 1))
        rows = rows / sizes
        each = np.einsum("wrp,wrq->wpq", rows, rows)  # information of each window
        inverse, of_row = np.linalg.inv(each.sum(axis=0)), self._of_a_row(left)

        def variance(by_row: np.ndarray) -> np.ndarray:
            by_error = by_row @ inverse
            return np.einsum("rjp,jk,rkp->p", by_error, of_row, by_error, optimize=True)

        alone = rows.reshape(-1, len(of_row), len(self.names))
        together = self._by_row(rows, self.windows.used)
        degrees, found = np.full(len(self.names), float(self.surplus)), variance(together)
        if (of_counts := self._of_counts(rows)) is not None:
            found = np.sum((of_counts @ inverse) ** 2, axis=(0, 1)) / PHASES
        elif (correlated := self._correlated(left)) or self._drifts:
            if len(each) <= len(self.names):
                raise BadInput(
                    f"successive errors are correlated, and {len(each)} windows are too few to tell how far "
                    f"{len(self.names)} parameters are off; give a longer log, or fit fewer"
                )
            if correlated:
                found = found * self._inflation(left, rows @ inverse)
            information, axes = np.linalg.eigh(each.sum(axis=0))
            U, share, _ = np.linalg.svd(
                rows @ axes / np.sqrt(np.maximum(information, 1e-300)), full_matrices=False
            )
            larger = 1 / np.sqrt(np.maximum(1 - share**2, 1e-6)) - 1
            weights = rows @ inverse  # of the errors of a window in its part of the changes of the parameters
            weights = weights + np.einsum("wrk,wk,wsk,wsp->wrp", U, larger, U, weights, optimize=True)
            by_window = np.sum(np.einsum("wrp,wr->wp", weights, left) ** 2, axis=0)
            by_window = np.maximum(by_window + found - variance(alone), by_window / 2)
            fit = np.einsum("wrq,wrp->pwq", rows, weights)
            # Covariances of these parts, if errors are independent
            between = -fit @ inverse @ fit.transpose(0, 2, 1)
            between += np.einsum("wrp,wv->pwv", weights**2, np.eye(len(each)))
            few = np.trace(between, axis1=1, axis2=2) ** 2 / np.sum(between**2, axis=(1, 2))
            degrees = np.full_like(degrees, len(each) - len(self.names)) if correlated else degrees
            larger_by_window = by_window > LARGER * found
            found, degrees = np.where(larger_by_window, (by_window, few), (found, degrees))
        sd = dict(zip(self.names, np.sqrt(found) / sizes, strict=True))
        sd = {name: math.hypot(each, self.shifts.get(name, 0.0)) for name, each in sd.items()}
        return sd | dict.fromkeys(self.unseen, math.inf), dict(zip(self.names, degrees.tolist(), strict=True))

    def check_misfit(self, most: float) -> None:
        """Raise BadInput if the errors of an output that nothing explains are more than a part `most` of its
        changes within the windows, and are not noise: successive ones are alike (von Neumann's ratio, 2 for
        independent errors, is below SMOOTH).
        """
        used = self.windows.used
        with warnings.catch_warnings():
            # Windows, or all, without a measurement of an output
            warnings.simplefilter("ignore", RuntimeWarning)
            outputs, errors = self.windows.measured[used], self._errors(used)
            motion = outputs - np.nanmean(outputs, axis=1, keepdims=True)
            rounding = EXACT * np.nanmax(np.abs(outputs), axis=(0, 1))
            size, left, change = (
                np.nanmean(each**2, axis=(0, 1)) for each in (motion, errors, np.diff(errors, axis=1))
            )
        left, change = self._unexplained * left, self._unexplained * change
        if (wrong := (left > np.maximum(most**2 * size, rounding**2)) & (change < SMOOTH * left)).any():
            part = math.sqrt(np.max(left[wrong] / np.maximum(size[wrong], left[wrong] / 100)))
            raise BadInput(
                f"no values of {', '.join(self.names)} explain this log: errors of {part:.0%} of the motion "
                "remain; are all columns those of this robot, and do they change?"
            )

    def explain(self, names: Sequence[str], derivatives: np.ndarray) -> None:
        """Find systematic errors, which look like quantities of these `names` that are not fitted;
        `derivatives` (W, R, ny, k) of the outputs by them, at the end of the fit.

        They are added to the fit, linear at its end, one by one, that which explains most, as long as it is
        not 0 by more than chance, be errors independent or correlated in any way within a window. What they
        change of the fitted parameters is kept in `shifts` and becomes part of their standard deviations;
        `remarks` say what was found.
        """
        left, rows = self._influence(derivatives)
        windows, fitted, left = len(left), len(self.names), left.ravel()
        sizes = np.linalg.norm(rows, axis=(0, 1))
        names, columns = [*self.names, *names], rows.reshape(len(left), -1) / np.where(sizes > 0, sizes, 1.0)
        chosen = list(range(fitted))
        found: list[tuple[float, int, float, float]] = []
        while (degrees := windows - len(chosen) - 1) >= SPARE and len(found) < FEW:
            base = np.linalg.qr(columns[:, chosen])[0]
            better = []
            for k in set(np.flatnonzero(sizes)) - set(chosen):
                alone = columns[:, k] - base @ (base.T @ columns[:, k])
                if (size := float(alone @ alone)) > APART:
                    value = -float(alone @ left) / size
                    after = left - base @ (base.T @ left) + value * alone
                    by_window = (
                        windows / degrees * np.sum((alone * after).reshape(windows, -1).sum(axis=1) ** 2)
                    )
                    sd = math.sqrt(max(by_window, size * float(after @ after) / self.surplus)) / size
                    if abs(value) > float(stdtrit(degrees, 1 - RARE)) * sd:
                        better.append((value**2 * size, int(k), value / sizes[k], sd / sizes[k]))
            if not better:
                break
            found.append(max(better))
            chosen.append(found[-1][1])
        change = np.linalg.lstsq(columns[:, chosen], -left, rcond=None)[0]
        self._unexplained = float(
            np.sum((left + columns[:, chosen] @ change) ** 2) / max(left @ left, 1e-300)
        )
        change = change[:fitted] / sizes[:fitted]
        self.shifts = dict(zip(self.names, change.tolist(), strict=True)) if found else {}
        if any(abs(shift) > SHIFTED * abs(self.value(name)) for name, shift in self.shifts.items()):
            self.remarks += [
                f"the errors look like {names[k]} = {self.base(names[k]) + value:.3g}, within {2 * sd:.2g}, "
                "which is not fitted; the intervals include what it would change"
                for _, k, value, sd in found
            ]

    def base(self, name: str) -> float:
        """Return the value of a quantity that is not fitted, 0 for one that is no parameter."""
        return self.value(name) if name in self.places else 0.0

    def _inflation(self, left: np.ndarray, by_error: np.ndarray) -> np.ndarray:
        """Return by how much correlation from row to row increases the variances (p) that errors `left`
        (windows, R ny) have through `by_error` (windows, R ny, p), if it is the same all along the log; at
        least 1.
        """
        measured = np.isfinite(self.windows.measured[self.windows.used])
        errors, by = left.reshape(measured.shape), by_error.reshape(*measured.shape, -1)
        total, alone = np.zeros(by.shape[3]), np.zeros(by.shape[3])
        longest = measured.shape[1] // 2
        for lag in range(longest):
            a, b = slice(0, measured.shape[1] - lag), slice(lag, measured.shape[1])
            pairs = np.maximum((measured[:, a] & measured[:, b]).sum(axis=(0, 1)), 1)
            covariance = np.sum(errors[:, a] * errors[:, b], axis=(0, 1)) / pairs * (1 - lag / longest)
            part = np.einsum("k,wrkp,wrkp->p", covariance, by[:, a], by[:, b], optimize=True)
            total, alone = total + part * (1 if lag == 0 else 2), alone + part * (lag == 0)
        return np.maximum(total / alone, 1.0)

    def _of_counts(self, rows: np.ndarray) -> np.ndarray | None:
        """Return sum rows' errors (PHASES, ny, p) of each output if its errors are those of rounding to
        counts, as where an angle is measured by an encoder; None if they are not, or an output is not
        rounded. `rows`: derivatives (windows, R ny, p).

        Where its count begins is then all that is random about an encoder: errors of all rows follow from it,
        and those at rates of whole counts per row are alike in all windows. So the rounding is repeated for
        PHASES of the count.
        """
        measured, errors = self.windows.measured[self.windows.used], self._errors(self.windows.used)
        by_row = rows.reshape(*measured.shape, -1)
        changes = np.zeros((PHASES, measured.shape[2], rows.shape[2]))
        for k, rms in enumerate(self.rms()):
            there = np.isfinite(measured[..., k])
            count = quantum(measured[..., k][there])
            if not count or rms > ROUNDED * count / math.sqrt(12):
                return None
            exact = (
                np.nan_to_num(measured[..., k] + errors[..., k]) / count
                + np.arange(PHASES)[:, None, None] / PHASES
            )
            rounding = np.where(there, np.round(exact) - exact, 0.0) * count / self.scale[k]
            changes[:, k] = np.einsum("jwr,wrp->jp", rounding, by_row[:, :, k])
        return changes

    @property
    def _drifts(self) -> bool:
        """Whether the errors may drift within a window, and there are windows enough to tell how much."""
        used = self.windows.used
        rows = np.isfinite(self.windows.measured[used]).any(axis=2).sum() / used.sum()
        return rows >= LONG and used.sum() - len(self.names) >= SPARE

    def _by_row(self, rows: np.ndarray, windows: np.ndarray | slice) -> np.ndarray:
        """Return derivatives of these windows (windows, R ny, p) added up for each row of the log, (rows,
        ny, p)."""
        of_log, place = np.unique(self.windows.number[windows], return_inverse=True)
        by_row = np.zeros((len(of_log), self.windows.measured.shape[2], rows.shape[2]))
        np.add.at(by_row, place.ravel(), rows.reshape(-1, *by_row.shape[1:]))
        return by_row

    def _influence(self, others: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return errors (windows, R ny) and derivatives (windows, R ny, p) of the fitted windows such that a
        change of the errors changes the parameters by (rows' rows)^-1 rows' errors. Both are those of least
        squares, or, where large errors have less weight, weighted errors, and derivatives as often as an
        error counts in full. `others` (W, R, ny, k): derivatives by more quantities, which follow those by
        the parameters.
        """
        used, (numbers, unknowns) = self.windows.used, self._counts
        weight, measured = self._weight[used], self._weight > 0
        in_full = np.maximum((weight == 1.0).sum(axis=(0, 1)), 1) / np.maximum(
            measured[used].sum(axis=(0, 1)), 1
        )
        of_few = 1 + unknowns / numbers * (1 / in_full - 1)
        errors = np.nan_to_num(self._errors(used) / self.scale) * weight**2 * of_few / np.sqrt(in_full)
        _, rows = self._projected(self.values, self.start, used, measured * np.sqrt(in_full), others)
        return errors.reshape(len(errors), -1), rows

    def _of_a_row(self, left: np.ndarray) -> np.ndarray:
        """Return the covariance of the weighted errors of the outputs in a row, ny x ny: the mean over the
        rows that have both. In a fit with few measurements all errors are regarded as independent and of one
        size.
        """
        measured = np.isfinite(self.windows.measured[self.windows.used])
        outputs, each = measured.shape[2], measured.sum() / self.surplus
        if self.surplus < FEWEST:
            return np.eye(outputs) * each * np.mean(left.reshape(measured.shape)[measured] ** 2)
        errors, there = left.reshape(-1, outputs), measured.reshape(-1, outputs).astype(float)
        mean = errors.T @ errors / np.maximum(there.T @ there, 1.0)
        sizes, directions = np.linalg.eigh(each * mean)  # of rows that are not the same, some may be negative
        return directions * np.maximum(sizes, 0.0) @ directions.T

    def _correlated(self, left: np.ndarray) -> bool:
        """Whether products of successive errors of an output are on average positive, by more than chance."""
        measured = np.isfinite(self.windows.measured[self.windows.used])
        errors = left.reshape(measured.shape)
        successive = [
            errors[w, measured[w, :, k], k] for w in range(len(errors)) for k in range(errors.shape[2])
        ]
        products = np.concatenate([each[1:] * each[:-1] for each in successive])
        return bool(products.sum() > CHANCE * np.linalg.norm(products))

    def _errors(self, windows: np.ndarray | slice) -> np.ndarray:
        """Return the errors of the outputs, (windows, R, ny), after fitting the initial states;
        NaN where not measured."""
        weight = self._weight[windows]
        left, _ = self._projected(self.values, self.start, windows)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(weight > 0, left.reshape(weight.shape) * self.scale / weight, np.nan)

    def _median(self) -> np.ndarray:
        return NORMAL * np.nanmedian(np.abs(self._errors(self.windows.used)), axis=(0, 1))

    def _reweigh(self) -> None:
        errors = np.abs(self._errors(slice(None))) / self.scale
        self._weight = np.where(np.isfinite(errors), np.sqrt(HUBER / np.maximum(errors, HUBER)), 0.0)

    def _projected(
        self,
        values: np.ndarray,
        start: np.ndarray,
        windows: np.ndarray | slice,
        weight: np.ndarray | None = None,
        others: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return residuals of these windows and their derivatives by the fitted parameters; initial states
        are eliminated. `weight` (W, R, ny): another than that of the fit; `others` as for `_influence`.
        """
        residual, by_start, by_values = (each[windows] for each in self._predicted(values, start, weight))
        if others is not None:
            scaled = (
                np.nan_to_num(others) * ((self._weight if weight is None else weight) / self.scale)[..., None]
            )[windows]
            by_values = np.concatenate([by_values, scaled.reshape(*by_values.shape[:2], -1)], axis=2)
        bases, sizes, _ = np.linalg.svd(by_start, full_matrices=False)
        bases = bases * (sizes > 1e-10 * sizes.max(initial=0.0))[:, None, :]
        return residual - _apply(bases, residual), by_values - _apply(bases, by_values)

    def _weakest(self, limit: float) -> list[str]:
        """Return the fitted parameter that is seen least, by this limit, and those that change with it while
        the outputs stay; empty if all are seen.
        """
        residual, *derivatives = self._predicted(self.values, self.start)
        if not all(np.isfinite(each).all() for each in (residual, *derivatives)):
            raise BadInput(BEYOND)
        rows = self._projected(self.values, self.start, slice(None))[1].reshape(-1, len(self.names))
        rows = rows * [self._size(name) for name in self.names]
        _, singular, directions = np.linalg.svd(rows, full_matrices=False)
        if singular[-1] > limit * singular[0] and singular[0] > 0:
            return []
        order = np.argsort(-np.abs(directions[-1]), kind="stable")
        return [self.names[k] for k in order if k == order[0] or abs(directions[-1, k]) > TIED]

    def _size(self, name: str) -> float:
        """Return what a change of a parameter is compared with; a value may be near 0."""
        return max(abs(self.value(name)), abs(float(self._given[self.places[name]])) or 1.0)

    def _converge(self) -> None:
        """Minimize the squared errors among inertias that bodies can have, from the nearest of them."""
        directions = np.diag([self._size(name) for name in self.names])
        nearest, held = bounded_least_squares(
            np.eye(len(self.names)), np.zeros(len(self.names)), *self._limits(directions)
        )
        if held.any():
            for name, change in zip(self.names, directions @ nearest, strict=True):
                self.values[self.places[name]] += change
            self.start = self._starts(self.values)
        self._descend()

    def _limits(self, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the bounds of the inertias as G s >= h for a change directions s of the fitted parameters,
        rows of length 1."""
        G = -self._factors(self.names) @ directions
        size = np.linalg.norm(G, axis=1)
        size = np.where(size > 0, size, np.inf)  # of what is not free: no bound
        return G / size[:, None], self._factors(list(self.quantities)) @ self.values / size

    def _factors(self, names: Sequence[str]) -> np.ndarray:
        return np.array([each.factors(names) for each in self._triangles]).reshape(-1, len(names))

    def _descend(self) -> None:
        damping, used = 1e-3, self.windows.used
        left, rows = self._projected(self.values, self.start, used)
        for iteration in range(ITERATIONS):
            self.progress(iteration, ITERATIONS, "iterations, or fewer")
            rows, left = rows.reshape(-1, len(self.names)), left.ravel()
            free = ~self._blocked(left @ rows)
            directions = np.diag([self._size(name) for name in self.names])[:, free]
            rows, cost, limits = rows @ directions, float(left @ left), self._limits(directions)
            best, held = bounded_least_squares(rows, -left, *limits)
            self.held = [each for each, holds in zip(self._triangles, held, strict=True) if holds]
            if np.abs(best).max(initial=0.0) < CONVERGED or -left @ rows @ best <= GAIN * cost:
                return
            while True:
                damped = np.vstack([rows, math.sqrt(damping) * np.diag(np.linalg.norm(rows, axis=0))])
                step, _ = bounded_least_squares(damped, np.append(-left, np.zeros(rows.shape[1])), *limits)
                values = self._moved(directions @ step)
                after = None if values is None else self._tried(values)
                if values is not None and after is not None and np.sum(after[1] ** 2) <= cost * (1 + 1e-12):
                    break
                damping *= 10.0
                if damping > 1e12:
                    return
            self.values, damping = values, damping / 10.0
            self.start, left, rows = after
            for name in self.names:
                change = self.value(name) / (self.given(name) or 1.0)
                if self.quantities[name].sign == "positive" and not VANISHED < change < 1 / VANISHED:
                    limit = "0" if change < 1 else "as large as can be"
                    raise BadInput(
                        f"the log does not tell {name}: the fit makes it {limit}; excite it more or do not "
                        "fit it, or look for wrong rows"
                    )
        weak, better = self._weakest(DOUBTFUL), "start from better values with --set NAME=VALUE"
        hint = (
            f"this log hardly tells {', '.join(weak)} apart: give one with --set and do not fit it"
            if weak[1:]
            else better
        )
        raise BadInput(f"the fit does not converge; {hint}")

    def _bounds(self, name: str) -> tuple[float, float]:
        """Return the least and the largest value that a parameter may take; a positive one may not be 0."""
        least = -math.inf if self.quantities[name].sign == "any" else 0.0
        return least, self._upper.get(name, math.inf)

    def _blocked(self, gradient: np.ndarray) -> np.ndarray:
        """Return which fitted parameters are at a bound that the decrease of the squared errors would
        cross."""
        bounds = np.array([self._bounds(name) for name in self.names])
        values = np.array([self.value(name) for name in self.names])
        near = CONVERGED * np.array([self._size(name) for name in self.names])
        return (values <= bounds[:, 0] + near) & (gradient > 0) | (values >= bounds[:, 1] - near) & (
            gradient < 0
        )

    def _moved(self, move: np.ndarray) -> np.ndarray | None:
        """Return all parameters after a change of those fitted, cut at their bounds,
        or None if one has the wrong sign."""
        tried = self.values.copy()
        for name, change in zip(self.names, move, strict=True):
            value = tried[self.places[name]] + change
            try:
                cut = value if self.quantities[name].sign == "positive" else max(value, self._bounds(name)[0])
                tried[self.places[name]] = self.quantities[name].check(min(cut, self._bounds(name)[1]))
            except ModelError:
                return None
        return tried

    def _tried(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """Return initial states, residuals and their derivatives with these parameters;
        None if they are not finite."""
        try:
            start = self._starts(values)
            left, rows = self._projected(values, start, self.windows.used)
        except np.linalg.LinAlgError:
            return None
        return (start, left, rows) if np.isfinite(left).all() and np.isfinite(rows).all() else None

    def _starts(self, values: np.ndarray) -> np.ndarray:
        """Return the initial states that fit best with these parameters."""
        residual, by_start, _ = self._predicted(values, self.start)
        return self.start - np.einsum("wkr,wr->wk", np.linalg.pinv(by_start, rcond=1e-10), residual)

    def _predicted(
        self, values: np.ndarray, start: np.ndarray, given: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return residuals (W, R ny), and their derivatives by the initial states and by the fitted
        parameters, all weighted."""
        windows, rows, outputs = self.windows.measured.shape
        at, columns = (
            (values.tobytes(), start.tobytes()),
            [self._all_names.index(name) for name in self.names],
        )
        if at != self._simulated[0]:
            self._simulated = at, self._simulate(values, start)
        residual, starts, parameters = self._simulated[1]
        weight = (self._weight if given is None else given) / self.scale
        return (
            np.where(weight > 0, residual * weight, 0.0).reshape(windows, -1),
            (starts * weight[..., None]).reshape(windows, rows * outputs, -1),
            (parameters[..., columns] * weight[..., None]).reshape(windows, rows * outputs, -1),
        )

    def simulated(self, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the errors (W, R, ny) of the outputs from these initial states and their derivatives by all
        parameters of the prediction (W, R, ny, k).
        """
        errors, _, derivatives = self._simulate(self.values, start)
        return errors, derivatives

    def _simulate(self, values: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return errors of the outputs (W, R, ny) and their derivatives by the initial states and by all
        parameters."""
        logged = self.windows
        windows, rows, outputs = logged.measured.shape
        x = logged.start.copy()
        x[:, logged.fitted] = start
        unit = np.eye(x.shape[1])[logged.fitted].ravel()  # dx/d(start), column by column
        first = np.hstack(
            [x, np.tile(unit, (windows, 1)), np.zeros((windows, x.shape[1] * len(self._all_names)))]
        )
        (later,) = self._forward(
            first.ravel(), logged.inputs[:, :-1].ravel(), np.tile(values, windows * (rows - 1))
        )
        z = np.concatenate([first[:, None], later.reshape(windows, rows - 1, -1)], axis=1)
        observed = self._observe(z.ravel(), logged.inputs.ravel(), np.tile(values, windows * rows))
        y, starts, parameters = (each.reshape(windows, rows, -1, outputs).swapaxes(2, 3) for each in observed)
        residual = y[..., 0] - logged.measured
        return (
            np.where(self._angles, np.remainder(residual + np.pi, 2 * np.pi) - np.pi, residual),
            starts,
            parameters,
        )


# A decorator: BadInput where a system of linear equations has no solution or is not finite.
solvable = naming("the log does not show the parameters", np.linalg.LinAlgError, BEYOND)


def with_derivatives(
    name: str, result: ca.SX, x: ca.SX, inputs: ca.SX, parameters: Sequence[ca.SX], fitted: Sequence[ca.SX]
) -> ca.Function:
    """Return (x, inputs, parameters) -> result and its derivatives by x and by the fitted parameters."""
    derivatives = [ca.densify(ca.jacobian(result, each)) for each in (x, ca.vertcat(*fitted))]
    return ca.Function(name, [x, inputs, ca.vertcat(*parameters)], [ca.densify(result), *derivatives])


def _with_sensitivities(prediction: Prediction, fitted: int) -> tuple[ca.Function, ca.Function]:
    """Return step and output with z = [x; dx/d(start); dx/d(parameters)] instead of x, the derivatives column
    by column; the output also returns its derivatives by the start, of which `fitted` entries are unknown,
    and by the parameters.
    """
    step, output = prediction.step, prediction.output
    x, inputs, values = (
        ca.SX.sym(name, step.size1_in(k)) for k, name in enumerate(("x", "inputs", "values"))
    )
    by_start, by_values = (
        ca.SX.sym("X", x.shape[0], fitted),
        ca.SX.sym("P", x.shape[0], len(prediction.names)),
    )
    z = ca.vertcat(x, ca.vec(by_start), ca.vec(by_values))
    after, A, B = step(x, inputs, values)
    forward = ca.vertcat(after, ca.vec(A @ by_start), ca.vec(A @ by_values + B))
    y, C, D = output(x, inputs, values)
    return (
        ca.Function("forward", [z, inputs, values], [ca.densify(forward)]),
        ca.Function(
            "observe", [z, inputs, values], [y, ca.densify(C @ by_start), ca.densify(C @ by_values + D)]
        ),
    )


def _apply(bases: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return the projections of each window's vector or columns on its basis."""
    return (
        bases @ (bases.transpose(0, 2, 1) @ vectors)
        if vectors.ndim == 3
        else _apply(bases, vectors[:, :, None])[:, :, 0]
    )
