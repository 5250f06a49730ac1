"""The result of a fit, and the parameters that no motion, or not this log, determines."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from ...model.mechanism import Quantity
from ...readers.errors import BadInput
from .identifiability import Combination
from .output_error import OutputError

ABSURD = 5.0  # times the value that was expected, or a part of it: no length or mass is that far off
DOUBTFUL = 0.5  # standard deviation relative to the value above which the log does not determine it


@dataclass(frozen=True)
class Estimate:
    """A parameter's value and standard deviation, both in its unit;
    `degrees` of freedom of the standard deviation."""

    quantity: Quantity
    value: float
    sd: float
    degrees: float

    @property
    def within(self) -> float:
        """Half of the interval of 95 %, by Student's distribution, in the parameter's unit."""
        return float(stdtrit(self.degrees, 0.975)) * self.sd


@dataclass(frozen=True, eq=False)
class Identification:
    """Result of a fit. `estimates` by name; `unidentifiable`: what no motion, or not this log, determines, in
    sentences.

    `residual` and `validation` are the RMS errors of each output (for the dynamics a quasi-velocity) over the
    fitted windows and over those left out, in the output's unit; NaN if none were left out. `inputs`: how
    they were interpolated between the rows. `outputs`: name and unit of each; `t` (W, R) and `errors` (W, R,
    ny) of each window, NaN where nothing was measured; `used` (W): whether it was fitted.
    """

    estimates: Mapping[str, Estimate]
    unidentifiable: tuple[str, ...]
    residual: np.ndarray
    validation: np.ndarray
    rows: int
    inputs: str
    remarks: tuple[str, ...]
    outputs: Sequence[tuple[str, str]]
    t: np.ndarray
    errors: np.ndarray
    used: np.ndarray


def result_of(
    fit: OutputError,
    names: Sequence[str],
    basis: Sequence[Combination],
    rows: int,
    remarks: tuple[str, ...],
    outputs: Sequence[tuple[str, str]],
    robot: Collection[str],
    inputs: str = "",
) -> Identification:
    """Return the result of a fit of the pivots of `basis`, combinations of the parameters `names`. Raises
    BadInput if a value is out of proportion to that of the parameters of the `robot` from which it began.
    """
    sentences = [*_by_structure(names, basis), *(_by_log(name) for name in fit.unseen)]
    tied = {
        name: unseen for unseen, others in fit.unseen.items() for name in others if name not in fit.unseen
    }
    stuck = [name for name in fit.at_bound() if name in tied]
    if stuck:
        raise BadInput(
            f"{stuck[0]} is at its bound, {fit.value(stuck[0]):g}, with {tied[stuck[0]]} = "
            f"{fit.value(tied[stuck[0]]):g}, and the log shows only both together: give another value with "
            "--set"
        )
    sentences += [f"{name}: this log shows it only together with {unseen}" for name, unseen in tied.items()]
    alone = {c.pivot for c in basis if not c.others} - set(fit.unseen) - set(tied)
    sd, degrees = fit.deviations()
    for name in fit.names:
        value, before = fit.value(name), fit.given(name)
        if name in robot and before > 0 and not before / ABSURD < value < before * ABSURD:
            raise BadInput(
                f"the log gives {name} = {value:.3g} where {before:.3g} was expected: look for a column with "
                f"another unit or meaning; if it may be that, say --set {name}={value:.1g}"
            )
    for name in sorted(alone, key=names.index):
        may_be_zero = fit.quantities[name].sign != "positive" and not fit.quantities[name].default
        if sd[name] > DOUBTFUL * abs(fit.value(name)) and not may_be_zero:
            sentences.append(
                f"{name}: its standard deviation, {sd[name]:.3g}, is more than half of its value, "
                f"{fit.value(name):.3g}"
            )
            alone.remove(name)
    estimates = {
        name: Estimate(fit.quantities[name], fit.value(name), sd[name], degrees[name])
        for name in names
        if name in alone
    }
    bounds = (
        f"{name} is at its bound, {fit.value(name):g}; beyond it the log would be predicted better"
        for name in fit.at_bound()
    )
    held = (
        f"the inertias are at their bound {each}; beyond it the log would be predicted better"
        for each in fit.held
    )
    remarks, windows = (*remarks, *bounds, *held, *fit.remarks), fit.windows
    left = (outputs, windows.t, fit.residuals(), windows.used)
    return Identification(
        estimates, tuple(sentences), fit.rms(), fit.rms(used=False), rows, inputs, remarks, *left
    )


def _by_structure(names: Sequence[str], basis: Sequence[Combination]) -> Iterator[str]:
    for combination in basis:
        if combination.others:
            together = [combination.pivot, *(name for name, _ in combination.others)]
            yield f"{', '.join(together)}: any motion shows only {combination} (factors at the given values)"
    for name in names:
        if not any(name in (c.pivot, *dict(c.others)) for c in basis):
            yield f"{name}: no motion depends on it"


def _by_log(name: str) -> str:
    return (
        f"{name}: this log does not show it; excite it by another motion, for instance by turning and by "
        "changing speed"
    )
