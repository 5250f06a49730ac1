"""Times of logs: their unit, and the columns of several topics joined in time."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from .errors import BadInput
from .tables import Column, Table

EPOCH = 1.1e9, 2.2e9  # s since 1970: the years 2004 to 2039
PARTS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}  # s
SLOWEST = 2.0  # s from row to row; of a longer time it is said that it may be in another unit
GAP = 3.0  # times the usual interval: over a longer one nothing is interpolated
# rad: over a larger change of an angle from message to message nothing is interpolated, it may be a wrap
TURNED = np.pi


def seconds(column: Column) -> tuple[np.ndarray, list[str]]:
    """Return times in s, and a remark if it was their size that told their unit: that of times since 1970.

    Raises BadInput as `Column.numbers`.
    """
    times = column.numbers("s")
    steps = np.abs(np.diff(times[np.isfinite(times)]))
    if column.unit is not None or not steps.any():
        return times, []
    first, usual = float(np.nanmin(times)), float(np.median(steps[steps > 0]))
    for unit, part in PARTS.items():
        if unit != "s" and EPOCH[0] < first * part < EPOCH[1] and usual * part <= SLOWEST:
            return times * part, [f"{column.where} is taken for {unit} since 1970, by its size"]
    return times, []


def distinct(first: float, second: float) -> tuple[str, str]:
    """Return two times as text, with the digits that tell them apart."""
    texts = [(f"{first:.{digits}f}", f"{second:.{digits}f}") for digits in (3, 6, 9)]
    return next((pair for pair in texts if pair[0] != pair[1]), texts[-1])


def joined(
    table: Table,
    columns: Mapping[str, Column],
    units: Mapping[str, str | None],
    held: Collection[str],
    alone: Collection[str],
) -> tuple[dict[str, np.ndarray], float, list[str]]:
    """Return the times t and the columns of several topics in the same rows; the longest of the usual times
    between the messages of a topic, s; and remarks on how they were joined.

    Rows are the times of all messages but those with `held` columns only, which keep the last value before.
    Columns that are `alone` are NaN in rows of other topics. All others are interpolated linearly there,
    except over gaps, and over changes by half a turn or more, which may be an angle that begins anew. Raises
    BadInput for times that decrease, and for topics without a time in common.
    """
    clocks, remarks = _clocks(table, [column.topic for column in columns.values()])
    dense = {column.topic for name, column in columns.items() if name not in held} or {*clocks}
    t = np.unique(np.concatenate([clocks[topic] for topic in dense]))
    rows = {"t": t}
    for name, column in columns.items():
        own, values = clocks[column.topic], column.numbers(units[name])
        last = np.searchsorted(own, t, "right") - 1
        before = np.where(last >= 0, values[last], np.nan)
        exact = np.where(own[last] == t, before, np.nan)
        if name in held:
            rows[name] = before
            remarks.append(f"{name} of {column.topic} keeps its last value between messages")
        elif name in alone:
            rows[name] = exact
        else:
            step, change = np.diff(own), np.abs(np.diff(values))
            sure = (step <= GAP * np.median(step)) & ((change < TURNED) | (units[name] not in ("rad", None)))
            between = (last >= 0) & np.append(sure, False)[last]
            rows[name] = np.where(np.isnan(exact) & between, np.interp(t, own, values), exact)
            if len(dense) > 1:
                remarks.append(
                    f"{name} of {column.topic} is interpolated linearly at the times of other topics"
                )
    usual = [float(np.median(np.diff(clocks[topic]))) for topic in dense if len(clocks[topic]) > 1]
    return rows, max(usual, default=0.0), remarks


def _clocks(table: Table, topics: Sequence[str]) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return the times of the messages of these topics, s, and remarks on their unit. Raises as `joined`."""
    clocks: dict[str, np.ndarray] = {}
    remarks = []
    for topic in dict.fromkeys(topics):
        clocks[topic], remark = seconds(table.clocks[topic])
        remarks += remark
        if (back := np.flatnonzero(~(np.diff(clocks[topic]) >= 0))).size:
            first, then = distinct(*clocks[topic][back[0] : back[0] + 2])
            message = f"{table.clocks[topic].where} goes from {first} s to {then} s at message {back[0] + 2}"
            raise BadInput(
                f"{message}: the clock was set back; cut the log there, and give its parts as two logs"
            )
    late = max(clocks, key=lambda topic: clocks[topic][0])
    early = min(clocks, key=lambda topic: clocks[topic][-1])
    if clocks[late][0] > clocks[early][-1]:
        end, begin = distinct(clocks[early][-1], clocks[late][0])
        message = f"{table.file}: the messages of {early} end at {end} s, those of {late} begin at {begin} s"
        raise BadInput(f"{message}; their clocks differ, or they are of different runs: log them together")
    return clocks, remarks
