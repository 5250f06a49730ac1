"""Logs: tables of times, states and inputs, from CSV, Parquet or MCAP."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ...model.mechanism import Quantity
from ...model.reduction import ReducedSystem
from ...readers.errors import BadInput
from ...readers.robots import suggestion
from ...readers.tables import Table, is_time, listed, picked, read_table
from ...readers.times import PARTS, SLOWEST, distinct, joined, seconds
from .dynamics import Dynamics
from .faults import (
    LONGEST,
    continued,
    cut,
    jumps_of,
    rows_of,
    saturated,
    spikes_and_steps,
    standstills,
    without_repeats,
)
from .smoothing import velocities

# Times the usual interval: a longer one separates two stretches of inputs, which change between rows
GAP = 1.5
USUAL = 0.85  # of the intervals are at most the usual one: times may jitter
FEWEST = 20  # rows
# Of the rows with the angle that has fewest: as many with all angles mean that these are measured together
TOGETHER = 0.9
COUNTS = 100  # whole numbers of an angle with a larger range are counts of an encoder, or degrees


@dataclass(frozen=True, eq=False)
class Log:
    """Rows of a log in the order of time: t (N) s, states x = [q; nu] (N, 2n-m) and logged inputs (N, r), SI.

    `state` names what x has from the log. `stretches` are ranges of rows without a gap in time; `remarks`
    state what was left out. `outputs` (N, ny) are what was measured, NaN where it was not; None: the
    quasi-velocities in x. What is not measured directly in x is an estimate. `numbers` (N) of the rows in the
    file.
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


def check_known(
    option: str, name: str, kind: str, names: Collection[str], listed: Collection[str] | None = None
) -> None:
    """Raise BadInput unless `name`, given to `option`, is one of the `names` of this kind;
    the message lists `listed` of them."""
    if name not in names:
        near, shown = suggestion(name, names).partition("; known are")[0], names if listed is None else listed
        raise BadInput(f"{option} {name}: not a {kind} of this robot{near}; it has {', '.join(shown)}")


@dataclass(frozen=True, eq=False)
class PoseLog:
    """Rows of a log in the order of time: t (N) s; the measured `angles` (N, k) of wheels and joints,
    unwrapped; the poses (N, 3), x and y (m) and heading (rad), NaN where they were not measured. `stretches`,
    `remarks` and `numbers` as in Log; `periods` after which angles start again in the file, by name.
    """

    t: np.ndarray
    names: tuple[str, ...]
    angles: np.ndarray
    pose: np.ndarray
    stretches: tuple[range, ...]
    remarks: tuple[str, ...]
    numbers: np.ndarray | None = None
    periods: Mapping[str, float] = field(default_factory=dict)


def quantities_in(table: Table, quantities: Sequence[Quantity], columns: Mapping[str, str]) -> set[str]:
    """Return the names of those quantities for which a table has a column, or `columns` names one. Raises
    BadInput.
    """
    return {*picked(table, {q.name: q.unit for q in quantities}, columns), *columns}


def read_log(file: str | Path | Table, dynamics: Dynamics, columns: Mapping[str, str]) -> Log:
    """Read a log with the columns of `noslip simulate`; `columns` maps names that are called otherwise:
    quantity -> column.

    Coordinates on which nothing depends may be missing, and outputs other than quasi-velocities be empty in
    most rows. Quasi-velocities that are missing are estimated from the outputs.
    Raises BadInput if a column is missing or not numeric, times do not increase, or too few rows are left;
    and OSError.
    """
    system, outputs = dynamics.system, [q.name for q in dynamics.outputs]
    inputs, state = [q.name for q in dynamics.inputs], [q.name for q in system.state]
    rates = {q.name for q in system.quasi_velocities}
    units = {q.name: q.unit for q in (*system.state, *dynamics.inputs, *dynamics.outputs)}
    needed = {"t", *inputs, *outputs, *dynamics.coordinates_needed}
    table = file if isinstance(file, Table) else read_table(file)
    alone = {name for name in outputs if name not in rates}
    values, numbers, usual, notes = _columns(table, units, needed, columns, inputs, alone)
    dense = [
        "t",
        *inputs,
        *(name for name in state if name in needed and not (name in outputs and name not in rates)),
    ]
    sparse = [name for name in values if name not in dense]
    whole = np.column_stack([values[n] for n in (*dense, *sparse)])
    rows, stretches, remarks = _cleaned(table.file, whole, len(dense), FEWEST, numbers, dense, usual)
    if np.median(np.diff(rows[:, 0])) > SLOWEST:
        raise BadInput(f"{table.file}: {remarks[0]}; rows so far apart do not show the motion between them")
    remarks = (*notes, *remarks)
    clean = dict(zip((*dense, *sparse), rows.T, strict=True))
    for name in outputs:
        if not np.isfinite(clean[name]).any():
            raise BadInput(f"{table.file}: {name} is empty in all rows; leave it out of --outputs")
    units["t"] = "s"
    t, kept = clean["t"], _numbers(values["t"], numbers, rows[:, 0])
    cuts: list[int] = []
    for name in sparse:
        if units[name] == "rad":
            clean[name], _, remark = continued(clean[name], t, name, kept)
            remarks = (*remarks, *remark)
    for name in outputs:
        if ends := saturated(clean[name]):
            clean[name] = clean[name].copy()
            clean[name][ends] = math.nan
            remarks = (*remarks, f"{name} is at the end of its range in {rows_of(kept, t, ends)}: left out")
        clean[name], steps, remark = _sound(t, clean[name], name, kept)
        remarks, cuts = (*remarks, *remark), [*cuts, *([] if name in rates else steps)]
    stretches = cut(stretches, cuts)
    measured = np.column_stack([clean[name] for name in outputs])
    x = np.column_stack([filled(t, clean[name]) if name in clean else np.zeros(len(rows)) for name in state])
    if not rates <= clean.keys():
        x[:, -system.dof :] = velocities(t, x, dynamics, stretches)
    known = tuple(name for name in state if name in clean)
    logged = np.column_stack([clean[name] for name in inputs])
    return Log(t, x, logged, stretches, remarks, measured, known, kept)


def _numbers(every: np.ndarray, numbers: Sequence[int], t: np.ndarray) -> np.ndarray:
    """Return the rows of the file that have the times t, of all times with these `numbers`."""
    first = {time: number for time, number in reversed(list(zip(every.tolist(), numbers, strict=True)))}
    return np.array([first[time] for time in t.tolist()])


def _sound(
    t: np.ndarray, values: np.ndarray, name: str, numbers: np.ndarray
) -> tuple[np.ndarray, list[int], list[str]]:
    """Return a signal with NaN where it repeats a value that is held, where it stands still and jumps then,
    and in single rows that are far off; the rows after which it is not connected; and remarks.
    """
    thinned, remarks = without_repeats(values, name)
    values, cuts = thinned.copy(), list[int]()
    if still := standstills(values):
        values[np.concatenate(still)], cuts = math.nan, [rows[-1] for rows in still]
        from_to = "; ".join(
            f"{rows_of(numbers, t, rows[:1])} to {rows_of(numbers, t, rows[-1:])}" for rows in still
        )
        remarks.append(f"{name} stands still and jumps then, {from_to}: left out")
    there = np.flatnonzero(np.isfinite(values))
    spikes, steps = spikes_and_steps(
        np.diff(values[there])[:, None], jumps_of(t[there], values[there])[:, None]
    )
    if len(spikes):
        values[there[spikes]] = math.nan
        remarks.append(f"{name} is far off in {rows_of(numbers, t, there[spikes])}: left out")
    if len(steps):
        after = there[steps + 1]
        remarks.append(
            f"{name} jumps at {rows_of(numbers, t, after)}; the rows before and after are not connected"
        )
        cuts += (after - 1).tolist()
    return values, cuts, remarks


def filled(t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return a column interpolated where nothing was measured."""
    known = np.isfinite(values)
    return np.interp(t, t[known], values[known]) if known.any() else np.zeros(len(t))


def read_poses(
    file: str | Path | Table, system: ReducedSystem, pose: Sequence[str], columns: Mapping[str, str]
) -> PoseLog:
    """Read the measured coordinates of a log: those of the `pose` (x, y, heading), whose entries may be empty
    in most rows, and all others that it has; x and y may be missing. Angles that start again are continued,
    single angles that are far off interpolated.

    Raises BadInput as `read_log`, and if the log has no poses or no other coordinate; and OSError.
    """
    others = [q.name for q in system.mechanism.coordinates if q.name not in pose]
    units = {q.name: q.unit for q in system.mechanism.coordinates}
    table = file if isinstance(file, Table) else read_table(file)
    there = quantities_in(table, system.mechanism.coordinates, columns)
    used = {column.where for column in picked(table, units, columns).values()}
    others_there = any(column.where not in used and not is_time(name) for name, column in table.items())
    # a gyro tells the heading alone
    alone = pose[2] in there and not there & set(pose[:2]) and not others_there
    places = () if alone else pose[:2]
    names = [name for name in others if name in there]
    if not names and table.header:
        existing = (
            f"those of {system.mechanism.name} are {', '.join(others)}"
            if others
            else f"{system.mechanism.name} has none"
        )
        raise BadInput(
            f"{table.file}: no column with an angle of a wheel or joint, {existing}; there are "
            f"{listed(table)}; name angles with --map NAME=COLUMN, distances on the floor with --map "
            "'NAME=COLUMN [rad/RADIUS]', counts with --map 'NAME=COLUMN [turn/COUNTS]'; rates, or speeds of "
            "the vehicle, do not tell its geometry"
        )
    values, numbers, usual, notes = _columns(table, units, {"t", *names, *places}, columns, (), pose)
    nothing = np.full(len(values["t"]), math.nan)
    rows = np.column_stack([values.get(name, nothing) for name in ("t", *names, *pose)])
    rows, stretches, remarks = _cleaned(
        table.file, rows, 1 + len(names), 2, numbers, ("t", *names), usual, LONGEST
    )
    t, signals, periods, remarks = rows[:, 0], rows[:, 1:], {}, (*notes, *remarks)
    kept, cuts = _numbers(values["t"], numbers, t), list[int]()
    for k, name in enumerate((*names, *pose)):
        if name not in pose[:2]:
            signals[:, k], period, remark = continued(signals[:, k], t, name, kept)
            if name in names:
                periods[name], remarks = period, (*remarks, *remark)
        signals[:, k], steps, remark = _sound(t, signals[:, k], name, kept)
        remarks, cuts = (*remarks, *remark), [*cuts, *steps]
    stretches, known = cut(stretches, cuts), np.isfinite(signals[:, : len(names)])
    if (complete := known.all(axis=1)).sum() >= TOGETHER * known.sum(axis=0).min(initial=len(t)):
        # Angles are measured together, but not in all rows: the poses of the others are between angles that
        # nothing tells.
        before = np.concatenate([[0], np.cumsum(complete)])
        stretches = tuple(range(before[each.start], before[each.stop]) for each in stretches)
        t, signals, kept = t[complete], signals[complete], kept[complete]
    else:
        for k in range(len(names)):
            first, last = np.flatnonzero(known[:, k])[[0, -1]]
            signals[:first, len(names) :] = signals[last + 1 :, len(names) :] = math.nan
            signals[:, k] = filled(t, signals[:, k])
    angles, poses = signals[:, : len(names)], signals[:, len(names) :]
    return PoseLog(t, tuple(names), angles, poses, tuple(filter(None, stretches)), remarks, kept, periods)


def _columns(
    table: Table,
    units: Mapping[str, str],
    needed: Collection[str],
    columns: Mapping[str, str],
    held: Collection[str],
    alone: Collection[str],
) -> tuple[dict[str, np.ndarray], Sequence[int], float | None, list[str]]:
    """Return t and the columns of these names, given with their units, as far as the table has them, in SI;
    the numbers of their rows in the file; for columns of several topics, which are joined as `times.joined`
    says, the usual time between messages, s; and remarks. `columns` as for `tables.picked`. Raises BadInput
    if one of those `needed` is missing.
    """
    units = {"t": "s", **units}
    for name in columns:
        check_known("--map", name, "quantity", units)
    several = len({column.topic for column in table.values()}) > 1  # each has times of its own
    wanted = {name: unit for name, unit in units.items() if name != "t" or name in columns or not several}
    found = picked(table, wanted, columns)
    used = {(where, column.topic) for column in found.values() for where in (column.where, *column.others)}
    topics = {column.topic for name, column in found.items() if name != "t"}
    if several and topics:
        if "t" in found:
            table.clocks[found["t"].topic] = found["t"]
        found["t"] = table.clocks[min(topics)]
    for name in units:
        if name in needed and name not in found:
            raise table.missing(columns.get(name, name), name)
    remarks = list(table.remarks)
    idle = [
        name
        for name, column in table.items()
        if (column.where, column.topic) not in used and not is_time(name)
    ]
    if idle:
        remarks.append(f"not used: column{'s' * (len(idle) > 1)} {listed(idle)}")
    t = found.pop("t")
    if len(topics) > 1:
        values, usual, more = joined(table, found, units, held, alone)
        return values, range(1, len(values["t"]) + 1), usual, [*remarks, *more]
    unitless = [name for name, column in found.items() if units[name] == "rad" and column.unit is None]
    if counts := [name for name in unitless if _are_counts(found[name].numbers("rad"))]:
        said, example = (
            " ".join(f"--map '{name}={name} [{unit}]'" for name in counts) for unit in ("turn/COUNTS", "deg")
        )
        raise BadInput(
            f"{table.file}: {', '.join(counts)}: whole numbers only, which are no rad; say {said}, or "
            f"{example}"
        )
    times, more = seconds(t)
    return {"t": times, **{n: found[n].numbers(units[n]) for n in found}}, t.rows, None, [*remarks, *more]


def read_rows(
    table: Table, units: Mapping[str, str | None], columns: Mapping[str, str]
) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """Return t, s, and those quantities for which `columns` names one, at the times of the topic of the
    first, and remarks.

    Quantities of other topics are interpolated linearly, angles continued over the turns before, but not
    beyond their first and last message or over gaps; rows where one is missing are left out. `units`: the SI
    units, None: of any. Raises BadInput as `times.joined`, and if no row is left.
    """
    units = {"t": "s", **units}
    found = picked(table, {name: units[name] for name in columns}, columns)
    first = next((column.topic for name, column in found.items() if name != "t"), "")
    if "t" in found:
        table.clocks[found["t"].topic] = found.pop("t")
    remarks: list[str] = []
    for name, column in found.items():
        if "rad" in (units[name], column.unit):
            t, _ = seconds(table.clocks[column.topic])
            values, _, more = continued(column.numbers(units[name]), t, name, np.asarray(column.rows))
            found[name], remarks = (
                replace(column, entries=values.tolist(), unit=None, sign=1.0),
                [*remarks, *more],
            )
    rows, _, _ = joined(table, found, units, (), ())
    own = np.isin(rows["t"], seconds(table.clocks[first])[0])
    complete = own & np.isfinite(list(rows.values())).all(axis=0)
    if not complete.any():
        raise BadInput(
            f"{table.file}: {', '.join(found)} are at no time all known; their topics do not overlap, or "
            "have gaps"
        )
    others = {name: column.topic for name, column in found.items() if column.topic != first}
    if others:
        of = {topic: ", ".join(name for name in others if others[name] == topic) for topic in others.values()}
        between = "; ".join(f"{names} of {topic}" for topic, names in of.items())
        remarks.append(f"rows are the messages of {first}; interpolated linearly in time: {between}")
    if (own & ~complete).any():
        remarks.append(
            f"{(own & ~complete).sum()} of {own.sum()} rows are left out, where another topic has no "
            "messages around"
        )
    return {name: values[complete] for name, values in rows.items()}, (*table.remarks, *remarks)


def _are_counts(values: np.ndarray) -> bool:
    values = values[np.isfinite(values)]
    return bool(values.size and np.ptp(values) > COUNTS and not (values % 1).any())


def _cleaned(
    file: str,
    rows: np.ndarray,
    dense: int,
    fewest: int,
    numbers: Sequence[int] | None = None,
    names: Sequence[str] = (),
    interval: float | None = None,
    gap: float = GAP,
) -> tuple[np.ndarray, tuple[range, ...], tuple[str, ...]]:
    """Return rows, stretches and remarks of a log without repeated rows and without those whose first `dense`
    entries, of columns with these `names`, are incomplete, divided where time has a gap, of more than `gap`
    usual intervals. `numbers` of the rows in the file; `interval`: the usual time between rows, s; None: that
    which most are at most apart.
    """
    remarks = []
    finite = np.isfinite(rows[:, :dense])
    complete = finite.all(axis=1)
    if not complete.all():
        remarks.append(f"{(~complete).sum()} rows with an empty or non-finite entry are left out")
    lines = (np.arange(len(rows)) + 1 if numbers is None else np.asarray(numbers))[complete]
    rows = rows[complete]
    step = np.diff(rows[:, 0])
    same = ((rows[1:] == rows[:-1]) | np.isnan(rows[1:]) & np.isnan(rows[:-1])).all(axis=1)
    again = np.concatenate([[False], (step == 0) & same]) if len(rows) else complete[:0]
    if again.any():
        remarks.append(f"{again.sum()} repeated rows are left out")
    rows, lines = rows[~again], lines[~again]
    if len(rows) < fewest:
        empty = [f"{name} in {n}" for name, n in zip(names, (~finite).sum(axis=0), strict=False) if n]
        why = f"; of {len(complete)} there is no number for {', '.join(empty)}" if empty else ""
        raise BadInput(f"{file}: {len(rows)} usable rows are too few; {fewest} or more are needed{why}")
    step = np.diff(rows[:, 0])
    if step.min() <= 0:
        k = int(np.argmax(step <= 0))
        before, after = distinct(rows[k, 0], rows[k + 1, 0])
        why = "the clock was set back; cut the log there"
        if step[k] == 0:
            why = "other numbers at the same time; write times with more digits, or delete a row"
        raise BadInput(
            f"{file} row {lines[k + 1]}: t goes from {before} s to {after} s, but times must increase: {why}"
        )
    if (usual := float(np.median(step))) > SLOWEST:
        likely = next((unit for unit, part in PARTS.items() if usual * part <= SLOWEST), "ns")
        there = f"call its column 't [{likely}]', or say --map 't=t [{likely}]'"
        remarks.append(f"t goes on by {usual:g} s from row to row; if it is in {likely}, {there}")
    ends = [0, *(np.flatnonzero(step > gap * (interval or np.quantile(step, USUAL))) + 1), len(rows)]
    if len(ends) > 2:
        remarks.append(
            f"{len(ends) - 2} gaps in t, the longest {step.max():.3g} s; the rows on both sides are not "
            "connected"
        )
    stretches = tuple(range(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True))
    return rows, stretches, tuple(remarks)
