"""Logs: tables of times, states and inputs, from CSV, Parquet or MCAP."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ..model.reduction import ReducedSystem
from ..readers.errors import BadInput
from ..readers.robots import suggestion
from ..readers.tables import WITH_UNIT, read_table
from .dynamics import Dynamics
from .faults import LONGEST, continued, cut, jumps_of, rows_of, spikes_and_steps, without_repeats
from .smoothing import velocities

GAP = 1.5  # times the usual interval: a longer one separates two stretches of inputs, which change between rows
USUAL = 0.85  # of the intervals are at most the usual one: times may jitter
FEWEST = 20  # rows
SLOWEST = 2.0  # s from row to row; of a longer time it is said that it may be in another unit
PARTS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}  # s


@dataclass(frozen=True, eq=False)
class Log:
    """Rows of a log in the order of time: t (N) s, states x = [q; nu] (N, 2n-m) and logged inputs (N, r), SI.

    `state` names what x has from the log. `stretches` are ranges of rows without a gap in time; `remarks` state what was left
    out. `outputs` (N, ny) are what was measured, NaN where it was not; None: the quasi-velocities in x. What is not measured
    directly in x is an estimate. `numbers` (N) of the rows in the file.
    """

    t: np.ndarray
    x: np.ndarray
    inputs: np.ndarray
    stretches: tuple[range, ...]
    remarks: tuple[str, ...]
    outputs: np.ndarray | None = None
    state: tuple[str, ...] = ()
    numbers: np.ndarray | None = None

    def measured(self, n: int) -> np.ndarray:
        """Return the outputs; `n` is the number of coordinates in x."""
        return self.x[:, n:] if self.outputs is None else self.outputs

    @property
    def interval(self) -> float:
        """The usual time between rows, s."""
        return float(np.median(np.diff(self.t)))


def check_known(option: str, name: str, kind: str, names: Collection[str], listed: Collection[str] | None = None) -> None:
    """Raise BadInput unless `name`, given to `option`, is one of the `names` of this kind; the message lists `listed` of them."""
    if name not in names:
        near, shown = suggestion(name, names).partition("; known are")[0], names if listed is None else listed
        raise BadInput(f"{option} {name}: not a {kind} of this robot{near}; it has {', '.join(shown)}")


@dataclass(frozen=True, eq=False)
class PoseLog:
    """Rows of a log in the order of time: t (N) s; the measured `angles` (N, k) of wheels and joints, unwrapped; the poses
    (N, 3), x and y (m) and heading (rad), NaN where they were not measured. `stretches`, `remarks` and `numbers` as in Log;
    `periods` after which angles start again in the file, by name.
    """

    t: np.ndarray
    names: tuple[str, ...]
    angles: np.ndarray
    pose: np.ndarray
    stretches: tuple[range, ...]
    remarks: tuple[str, ...]
    numbers: np.ndarray | None = None
    periods: Mapping[str, float] = field(default_factory=dict)


def names_of(file: str | Path, columns: Mapping[str, str]) -> set[str]:
    """Return the names of the columns of a log, and those that `columns` adds. Raises BadInput, OSError."""
    return {*read_table(file), *columns}


def read_log(file: str | Path, dynamics: Dynamics, columns: Mapping[str, str]) -> Log:
    """Read a log with the columns of `noslip simulate`; `columns` maps names that are called otherwise: quantity -> column.

    Coordinates on which nothing depends may be missing, and outputs other than quasi-velocities be empty in most rows.
    Quasi-velocities that are missing are estimated from the outputs.
    Raises BadInput if a column is missing or not numeric, times do not increase, or too few rows are left; and OSError.
    """
    system, outputs = dynamics.system, [q.name for q in dynamics.outputs]
    inputs, state = [q.name for q in dynamics.inputs], [q.name for q in system.state]
    rates = {q.name for q in system.quasi_velocities}
    units = {q.name: q.unit for q in (*system.state, *dynamics.inputs, *dynamics.outputs)}
    needed = {"t", *inputs, *outputs, *dynamics.coordinates_needed}
    values = _columns(file, units, needed, columns)
    dense = ["t", *inputs, *(name for name in state if name in needed and not (name in outputs and name not in rates))]
    sparse = [name for name in values if name not in dense]
    rows, stretches, remarks = _cleaned(str(file), np.column_stack([values[n] for n in (*dense, *sparse)]), len(dense), FEWEST)
    clean = dict(zip((*dense, *sparse), rows.T, strict=True))
    for name in outputs:
        if not np.isfinite(clean[name]).any():
            raise BadInput(f"{file}: {name} is empty in all rows; leave it out of --outputs")
    t, numbers = clean["t"], _numbers(values["t"], rows[:, 0])
    cuts: list[int] = []
    for name in sparse:
        if units[name] == "rad":
            clean[name], _, remark = continued(clean[name], t, name, numbers)
            remarks = (*remarks, *remark)
    for name in outputs:
        clean[name], steps, remark = _sound(t, clean[name], name, numbers)
        remarks, cuts = (*remarks, *remark), [*cuts, *([] if name in rates else steps)]
    stretches = cut(stretches, cuts)
    measured = np.column_stack([clean[name] for name in outputs])
    x = np.column_stack([filled(t, clean[name]) if name in clean else np.zeros(len(rows)) for name in state])
    if not rates <= clean.keys():
        x[:, -system.dof :] = velocities(t, x, dynamics, stretches)
    known = tuple(name for name in state if name in clean)
    logged = np.column_stack([clean[name] for name in inputs])
    return Log(t, x, logged, stretches, remarks, measured, known, numbers)


def _numbers(every: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return the rows of the file, of which the first has the names, that have the times t, of all times."""
    first = {time: k + 2 for k, time in reversed(list(enumerate(every.tolist())))}
    return np.array([first[time] for time in t.tolist()])


def _sound(t: np.ndarray, values: np.ndarray, name: str, numbers: np.ndarray) -> tuple[np.ndarray, list[int], list[str]]:
    """Return a signal with NaN where it repeats a value that is held, and in single rows that are far off; the rows
    after which it jumps; and remarks.
    """
    values, remarks = without_repeats(values, name)
    there = np.flatnonzero(np.isfinite(values))
    spikes, steps = spikes_and_steps(np.diff(values[there])[:, None], jumps_of(t[there], values[there])[:, None])
    if len(spikes):
        values = values.copy()
        values[there[spikes]] = math.nan
        remarks.append(f"{name} is far off in {rows_of(numbers, t, there[spikes])}: left out")
    if len(steps):
        after = there[steps + 1]
        remarks.append(f"{name} jumps at {rows_of(numbers, t, after)}; the rows before and after are not connected")
        return values, (after - 1).tolist(), remarks
    return values, [], remarks


def filled(t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return a column interpolated where nothing was measured."""
    known = np.isfinite(values)
    return np.interp(t, t[known], values[known]) if known.any() else np.zeros(len(t))


def read_poses(file: str | Path, system: ReducedSystem, pose: Sequence[str], columns: Mapping[str, str]) -> PoseLog:
    """Read the measured coordinates of a log: those of the `pose` (x, y, heading), whose entries may be empty in most rows, and
    all others that it has; x and y may be missing. Angles that start again are continued, single angles that are far off
    interpolated.

    Raises BadInput as `read_log`, and if the log has no poses or no other coordinate; and OSError.
    """
    others = [q.name for q in system.mechanism.coordinates if q.name not in pose]
    units = {q.name: q.unit for q in system.mechanism.coordinates}
    values = _columns(file, units, {"t"}, columns)
    missing = [name for name in pose[:2] if name not in values]
    if missing and not (len(missing) == 2 and pose[2] in values):
        raise BadInput(f"{file}: column {missing[0]!r} is missing; without a place, give the heading {pose[2]} alone")
    names = [name for name in others if name in values]
    if not names:
        existing = f"those of {system.mechanism.name} are {', '.join(others)}" if others else f"{system.mechanism.name} has none"
        raise BadInput(f"{file}: no column with an angle of a wheel or joint; {existing}")
    nothing = np.full(len(values["t"]), math.nan)
    rows = np.column_stack([values.get(name, nothing) for name in ("t", *names, *pose)])
    rows, stretches, remarks = _cleaned(str(file), rows, 1 + len(names), 2, LONGEST)
    t, signals, periods = rows[:, 0], rows[:, 1:], {}
    numbers, cuts = _numbers(values["t"], t), list[int]()
    for k, name in enumerate((*names, *pose)):
        if name not in pose[:2]:
            signals[:, k], period, remark = continued(signals[:, k], t, name, numbers)
            if name in names:
                periods[name], remarks = period, (*remarks, *remark)
        signals[:, k], steps, remark = _sound(t, signals[:, k], name, numbers)
        remarks, cuts = (*remarks, *remark), [*cuts, *steps]
        if name in names:
            known = np.flatnonzero(np.isfinite(signals[:, k]))
            signals[: known[0], len(names) :] = signals[known[-1] + 1 :, len(names) :] = math.nan
            signals[:, k] = filled(t, signals[:, k])
    angles, poses = signals[:, : len(names)], signals[:, len(names) :]
    return PoseLog(t, tuple(names), angles, poses, cut(stretches, cuts), remarks, numbers, periods)


def _columns(
    file: str | Path, units: Mapping[str, str], needed: Collection[str], columns: Mapping[str, str]
) -> dict[str, np.ndarray]:
    """Return t and the columns of these names, given with their units, as far as the file has them, in SI; those `needed` must be
    there. `columns`: quantity -> column, as "COLUMN", "-COLUMN" for the negative of it, or "COLUMN [UNIT]".
    """
    table, units = read_table(file), {"t": "s", **units}
    for name in columns:
        check_known("--map", name, "quantity", units)
    values = {}
    for name, unit in units.items():
        column, sign, stated = _mapped(columns.get(name, name), table)
        if column in table:
            values[name] = sign * replace(table[column], unit=stated or table[column].unit).numbers(unit)
        elif name in needed or name in columns:
            raise BadInput(f"{file}: column {column!r} is missing{suggestion(column, table)}")
    return values


def _mapped(text: str, table: Collection[str]) -> tuple[str, float, str | None]:
    """Return column, sign and unit of an entry of --map."""
    parts = WITH_UNIT.fullmatch(text)
    name, unit = (parts[1], parts[2]) if parts else (text, None)
    return (name[1:], -1.0, unit) if name.startswith("-") and name not in table else (name, 1.0, unit)


def _cleaned(
    file: str, rows: np.ndarray, dense: int, fewest: int, gap: float = GAP
) -> tuple[np.ndarray, tuple[range, ...], tuple[str, ...]]:
    """Return rows, stretches and remarks of a log without repeated rows and without those whose first `dense` entries are
    incomplete, divided where time has a gap, of more than `gap` usual intervals.
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
    if (usual := float(np.median(step))) > SLOWEST:
        likely = next((unit for unit, part in PARTS.items() if usual * part <= SLOWEST), "ns")
        there = f"call its column 't [{likely}]', or say --map 't=t [{likely}]'"
        remarks.append(f"t goes on by {usual:g} s from row to row; if it is in {likely}, {there}")
    ends = [0, *(np.flatnonzero(step > gap * np.quantile(step, USUAL)) + 1), len(rows)]
    if len(ends) > 2:
        remarks.append(f"{len(ends) - 2} gaps in t, the longest {step.max():.3g} s; the rows on both sides are not connected")
    stretches = tuple(range(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True))
    return rows, stretches, tuple(remarks)
