"""Logs: tables of times, states and inputs, from CSV, Parquet or MCAP."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np

from ..model.reduction import ReducedSystem
from ..readers.errors import BadInput
from ..readers.robots import suggestion
from ..readers.tables import read_table

GAP = 1.5  # times the usual interval: a longer one separates two stretches
FEWEST = 20  # rows


@dataclass(frozen=True, eq=False)
class Log:
    """Rows of a log in the order of time: t (N) s, states x = [q; nu] (N, 2n-m) and inputs tau (N, r), SI.

    `stretches` are ranges of rows without a gap in time; `remarks` state what was left out.
    """

    t: np.ndarray
    x: np.ndarray
    tau: np.ndarray
    stretches: tuple[range, ...]
    remarks: tuple[str, ...]

    @property
    def interval(self) -> float:
        """The usual time between rows, s."""
        return float(np.median(np.diff(self.t)))


def check_known(option: str, name: str, kind: str, names: Collection[str]) -> None:
    """Raise BadInput unless `name`, given to `option`, is one of the `names` of this kind."""
    if name not in names:
        raise BadInput(f"{option} {name}: not a {kind} of this robot{suggestion(name, names)}; it has {', '.join(names)}")


@dataclass(frozen=True, eq=False)
class PoseLog:
    """Rows of a log in the order of time: t (N) s; the measured `angles` (N, k) of wheels and joints, unwrapped; the poses
    (N, 3), x and y (m) and heading (rad), NaN where they were not measured. `stretches` and `remarks` as in Log.
    """

    t: np.ndarray
    names: tuple[str, ...]
    angles: np.ndarray
    pose: np.ndarray
    stretches: tuple[range, ...]
    remarks: tuple[str, ...]


def read_log(file: str | Path, system: ReducedSystem, columns: Mapping[str, str]) -> Log:
    """Read a log with the columns of `noslip simulate`; `columns` maps names that are called otherwise: quantity -> column.

    Coordinates on which the dynamics do not depend may be missing. Quasi-velocities that are missing are not guessed.
    Raises BadInput if a column is missing or not numeric, times do not increase, or too few rows are left; and OSError.
    """
    state, inputs = [q.name for q in system.state], [i.name for i in system.mechanism.inputs]
    needed = {"t", *(q.name for q in system.quasi_velocities), *inputs, *_read_by_dynamics(system)}
    values = _columns(file, system, ["t", *state, *inputs], needed, columns)
    rows = np.column_stack([values.get(name, np.zeros(len(values["t"]))) for name in ("t", *state, *inputs)])
    rows, stretches, remarks = _cleaned(str(file), rows, rows.shape[1], FEWEST)
    return Log(rows[:, 0], rows[:, 1 : 1 + len(state)], rows[:, 1 + len(state) :], stretches, remarks)


def read_poses(file: str | Path, system: ReducedSystem, pose: Sequence[str], columns: Mapping[str, str]) -> PoseLog:
    """Read the measured coordinates of a log: those of the `pose` (x, y, heading), whose entries may be empty in most rows, and
    all others that it has. Angles that were reported within one turn are continued over the turns.

    Raises BadInput as `read_log`, and if the log has no poses or no other coordinate; and OSError.
    """
    others = [q.name for q in system.mechanism.coordinates if q.name not in pose]
    values = _columns(file, system, ["t", *others, *pose], {"t", *pose[:2]}, columns)
    names = [name for name in others if name in values]
    if not names:
        existing = f"those of {system.mechanism.name} are {', '.join(others)}" if others else f"{system.mechanism.name} has none"
        raise BadInput(f"{file}: no column with an angle of a wheel or joint; {existing}")
    nothing = np.full(len(values["t"]), math.nan)
    rows = np.column_stack([values.get(name, nothing) for name in ("t", *names, *pose)])
    rows, stretches, remarks = _cleaned(str(file), rows, 1 + len(names), 2)
    angles = rows[:, 1 : 1 + len(names)]
    for k, name in enumerate(names):
        jumps = np.abs(np.diff(angles[:, k])) > math.pi
        if jumps.any() and np.ptp(angles[:, k]) <= 2 * math.pi * (1 + 1e-6):
            angles[:, k] = np.unwrap(angles[:, k])
            remarks = (*remarks, f"{name} jumps {jumps.sum()} times by about a turn; it is continued over the turns")
    return PoseLog(rows[:, 0], tuple(names), angles, rows[:, 1 + len(names) :], stretches, remarks)


def _columns(
    file: str | Path, system: ReducedSystem, names: Sequence[str], needed: Collection[str], columns: Mapping[str, str]
) -> dict[str, np.ndarray]:
    """Return the columns of these names as far as the file has them, in SI; those `needed` must be there."""
    table = read_table(file)
    units = {q.name: q.unit for q in (*system.state, *system.mechanism.inputs)} | {"t": "s"}
    for name in columns:
        check_known("--map", name, "quantity", names)
    values = {}
    for name in names:
        column = columns.get(name, name)
        if column in table:
            values[name] = table[column].numbers(units[name])
        elif name in needed or name in columns:
            raise BadInput(f"{file}: column {column!r} is missing{suggestion(column, table)}")
    return values


def _read_by_dynamics(system: ReducedSystem) -> list[str]:
    """Return the coordinates that S'MS, the bias or S'E depend on."""
    dynamics = ca.veccat(system.Mbar, system.bias, system.input_map)
    return [q.name for q in system.mechanism.coordinates if ca.depends_on(dynamics, q.symbol)]


def _cleaned(file: str, rows: np.ndarray, dense: int, fewest: int) -> tuple[np.ndarray, tuple[range, ...], tuple[str, ...]]:
    """Return rows, stretches and remarks of a log without repeated rows and without those whose first `dense` entries are
    incomplete, divided where time has a gap.
    """
    remarks = []
    complete = np.isfinite(rows[:, :dense]).all(axis=1)
    if not complete.all():
        remarks.append(f"{(~complete).sum()} rows with an empty or non-finite entry are left out")
    rows = rows[complete]
    step = np.diff(rows[:, 0])
    same = ((rows[1:] == rows[:-1]) | np.isnan(rows[1:]) & np.isnan(rows[:-1])).all(axis=1)
    again = np.concatenate([[False], (step == 0) & same]) if len(rows) else complete[:0]
    if again.any():
        remarks.append(f"{again.sum()} repeated rows are left out")
    rows = rows[~again]
    if len(rows) < fewest:
        raise BadInput(f"{file}: {len(rows)} usable rows are too few; {fewest} or more are needed")
    step = np.diff(rows[:, 0])
    if step.min() <= 0:
        k = int(np.argmax(step <= 0))
        raise BadInput(f"{file}: t goes from {rows[k, 0]:g} s to {rows[k + 1, 0]:g} s; times must increase")
    ends = [0, *(np.flatnonzero(step > GAP * np.median(step)) + 1), len(rows)]
    if len(ends) > 2:
        remarks.append(f"{len(ends) - 2} gaps in t, the longest {step.max():.3g} s; the rows on both sides are not connected")
    stretches = tuple(range(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True))
    return rows, stretches, tuple(remarks)
