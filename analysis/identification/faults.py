"""Faults of signals in a log: counters that start again, values that are repeated,
jumps that no motion makes."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.ndimage import median_filter

from ...readers.errors import BadInput

# After which angles start again; the latter are in other units
PERIODS = {"a turn": 2 * math.pi, "360": 360.0, "1": 1.0}
BITS = (16, 24, 32)  # of counters
ROUNDED = 1.02  # of a period: the range of values that were rounded, or are noisy where they start again
# Of a period: a change from row to row from which on it may have been in the other direction
EITHER_WAY = 0.45
NEARBY = 11  # rows around an interval that show what changes are usual
ISOLATED = 10.0  # times the usual change: a single one that large is a jump
FASTEST = 3.0  # times the change that 5 % of the rows exceed: the same
HELD = 3.0  # times the smallest step: the usual step of a signal that is held, not quantized
LONGEST = 4.0  # usual intervals over which an angle is taken as linear
STILL = 5  # rows with the same value
EXACT = 1e-9  # of the largest value: what is not regarded as a change
JUMP, PART = 8.0, 0.25  # see `contradictions`
NORMAL = 1.4826  # standard deviation of a normal distribution in units of its median absolute value
MOST = 0.1  # of the changes that may contradict a fit
NAMED = 5  # rows that a remark names


def continued(
    values: np.ndarray, t: np.ndarray, name: str, numbers: np.ndarray
) -> tuple[np.ndarray, float, list[str]]:
    """Return a signal (N) that starts again after a period continued over the periods, NaN where it was not
    measured; the period, infinity if it does not start again; and remarks. `numbers` of the rows in the file.

    The period is a turn, or that of a counter of BITS, whose count is the smallest change. The change nearest
    to 0 is taken; raises BadInput if it comes close to half of a period.
    """
    there = np.isfinite(values)
    change = np.diff(values[there])
    if not len(change):
        return values, math.inf, []
    extent = float(np.subtract(*np.quantile(values[there], (0.99, 0.01))))
    count = quantum(values[there]) if len(change) > NEARBY else 0.0
    periods = {**PERIODS, **{f"{bits} bits": count * 2.0**bits for bits in BITS if count}}
    for what, period in periods.items():
        jumps = np.abs(change) > period / 2
        if not jumps.any() or not extent <= period * ROUNDED:
            continue
        new = change - period * np.round(change / period)
        largest = int(np.argmax(np.abs(new) * ~jumps_of(t[there], np.concatenate([[0.0], np.cumsum(new)]))))
        if abs(new[largest]) > EITHER_WAY * period:
            if period not in PERIODS.values():
                continue
            rows = rows_of(numbers, t, [int(np.flatnonzero(there)[largest + 1])])
            raise either_way(name, rows, abs(new[largest]), period, np.diff(t[there])[largest])
        whole = values.copy()
        whole[there] = values[there][0] + np.concatenate([[0.0], np.cumsum(new)])
        return (
            whole,
            period,
            [f"{name} starts again {jumps.sum()} times after {what}; it is continued over the turns"],
        )
    return values, math.inf, []


def either_way(name: str, row: str, change: float, period: float, interval: float) -> BadInput:
    """Return the error for a change between two rows of which a log that starts again cannot tell the
    direction."""
    return BadInput(
        f"{row}: {name} changes by about {change:.3g} from row to row and starts again after {period:.3g}, "
        "so that it may have turned either way; this log can tell rates up to "
        f"{EITHER_WAY * period / interval:.3g} per s: log it more often, or log an angle that does not start "
        "again"
    )


def quantum(values: np.ndarray) -> float:
    """Return the count of which all changes are multiples; 0 if there is none."""
    changes = np.unique(np.abs(np.diff(values)))
    finest = np.unique(np.diff(changes))
    finest = finest[finest > 1e-9 * changes[-1]]
    if not len(finest):
        return 0.0
    count = float(finest[0])
    for each in changes:
        multiple = round(each / count)
        if abs(each - multiple * count) > 0.2 * count:
            return 0.0
        count = each / multiple if multiple else count
    return count


def jumps_of(t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return which intervals (N - 1) of a signal have a change that is far larger than those nearby and the
    largest usual ones, also per time.
    """
    change, step = np.diff(values), np.diff(t)
    found = np.ones(len(change), bool)
    for each in (change, change / step):
        size = np.abs(each)
        moving = size[size > 0]
        if not len(moving):
            return np.zeros(len(change), bool)
        usual = median_filter(size, NEARBY, mode="nearest") + np.median(moving)
        found &= np.abs(
            each - median_filter(each, NEARBY, mode="nearest")
        ) > ISOLATED * usual + FASTEST * np.quantile(size, 0.95)
    return found


def spikes_and_steps(change: np.ndarray, jumps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows that differ from both rows beside them, whose jumps cancel, and the intervals of the
    other jumps. `change` (N - 1, k) of intervals, of which `jumps` (N - 1, k) are jumps.
    """
    both = jumps[1:] & jumps[:-1]
    cancel = np.abs(change[1:] + change[:-1]) < 0.5 * np.minimum(np.abs(change[1:]), np.abs(change[:-1]))
    spikes = np.flatnonzero((both & cancel).any(axis=1)) + 1
    of_spikes = np.isin(np.arange(len(jumps)), np.concatenate([spikes - 1, spikes]))
    return spikes, np.flatnonzero(jumps.any(axis=1) & ~of_spikes)


def without_repeats(values: np.ndarray, name: str) -> tuple[np.ndarray, list[str]]:
    """Return a signal (N) with NaN where a value is held, as it is if a sensor is slower than the rows; and
    remarks.

    A quantized signal, which may also stay the same, changes mostly by its smallest step, a held one by many.
    """
    there = np.flatnonzero(np.isfinite(values))
    change = np.diff(values[there])
    new = np.flatnonzero(change)
    if len(new) < NEARBY or (every := float(np.median(np.diff(new)))) < 2:
        return values, []
    steps = np.abs(change[new])
    if (
        np.median(steps) <= HELD * steps.min()
        or np.ptp(np.diff(new)[1:-1]) > every
        and np.median(steps) < ISOLATED * steps.min()
    ):
        return values, []
    kept = np.full_like(values, math.nan)
    rows = there[np.concatenate([[0], new + 1])]
    kept[rows] = values[rows]
    return kept, [
        f"{name} is new in every {every:g}th row only; the rows between, which repeat it, do not count"
    ]


def standstills(values: np.ndarray) -> list[list[int]]:
    """Return the rows that repeat a value while what is measured moves on, as it is if a sensor or its line
    fails for a while: after STILL rows or more the signal (N, NaN where it was not measured) jumps to where
    the motion has come to.
    """
    there = np.flatnonzero(np.isfinite(values))
    change = np.abs(np.diff(values[there]))
    new = np.flatnonzero(change)
    if not len(new):
        return []
    since = np.diff(new, prepend=-1)  # rows with the value that ends with each change
    least = HELD * np.quantile(change[new], 0.95)
    found = [(k, n) for k, n in zip(new, since, strict=True) if n >= STILL and change[k] > least]
    return [
        there[k - n + 2 : k + 1].tolist()
        for k, n in found
        if change[k] > HELD * change[k + 1 : k + STILL].max(initial=0.0)
    ]


def saturated(values: np.ndarray) -> list[int]:
    """Return the rows at which a signal (N, NaN where it was not measured) is held at its largest or smallest
    value, as by a sensor at the end of its range: runs of that value, where the signal is nowhere else
    straight, as a profile of speeds is.
    """
    there = np.flatnonzero(np.isfinite(values))
    known = values[there]
    if len(known) < NEARBY:
        return []
    straight = np.ones(len(known), bool)
    straight[1:-1] = np.abs(np.diff(known, 2)) <= EXACT * np.abs(known).max()
    rows = np.zeros(len(known), bool)
    for end in (known.max(), known.min()):
        at = known == end
        runs = at[2:] & at[1:-1] & at[:-2]
        if runs.sum() >= STILL and at.mean() < 0.5 and straight[~at].mean() < MOST:
            rows |= at
    return list(map(int, there[rows]))


def cut(stretches: Iterable[range], after: Sequence[int]) -> tuple[range, ...]:
    """Return stretches of rows that also end after these rows."""
    pieces = []
    for stretch in stretches:
        inside = sorted({k + 1 for k in after if stretch.start <= k < stretch.stop - 1})
        ends = [stretch.start, *inside, stretch.stop]
        pieces += [range(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True)]
    return tuple(pieces)


def rows_of(numbers: np.ndarray | None, t: np.ndarray, rows: Sequence[int]) -> str:
    """Return rows of a log as text: the first of them, by their numbers in the file and times."""
    named = [f"{k + 2 if numbers is None else numbers[k]} (t = {t[k]:.6g} s)" for k in rows[:NAMED]]
    more = f" and {len(rows) - NAMED} more" if len(rows) > NAMED else ""
    return f"row{'s' * (len(rows) > 1)} {', '.join(named)}{more}"


@dataclass(frozen=True)
class Contradictions:
    """What a fit contradicts: `single` measurements as (row, output), and `steps`, rows at which an output
    differs from those before and stays so, of `compared` changes.
    """

    single: list[tuple[int, int]]
    steps: list[int]
    compared: int

    def __bool__(self) -> bool:
        return bool(self.single or self.steps)


def contradictions(
    errors: np.ndarray, measured: np.ndarray, number: np.ndarray, angles: np.ndarray
) -> Contradictions:
    """Return what a fit contradicts, by the errors that it leaves, predicted minus measured (W, R, ny) in W
    windows of R rows with the `number` (W, R) in the log. `angles` (ny): which outputs are angles.

    The errors of an output change from row to row by noise. A change of JUMP times the usual one, and of a
    part PART of the motion, usual and nearby, is neither noise nor the drift of a model that is not quite
    right.
    """
    single, steps, compared = [], [], 0
    for k in range(errors.shape[2]):
        there = [np.flatnonzero(np.isfinite(each)) for each in errors[:, :, k]]
        change = [np.diff(errors[w, rows, k]) for w, rows in enumerate(there)]
        motion = [np.diff(measured[w, rows, k]) for w, rows in enumerate(there)]
        if angles[k]:
            change = [np.remainder(each + np.pi, 2 * np.pi) - np.pi for each in change]
        sizes, moved = np.abs(np.concatenate(change)), np.abs(np.concatenate(motion))
        if not len(sizes):
            continue
        compared = max(compared, len(sizes))
        usual = max(
            JUMP * NORMAL * np.median(sizes), PART * (np.median(moved[moved > 0]) if moved.any() else 0.0)
        )
        usual = max(usual, EXACT * np.nanmax(np.abs(measured[:, :, k])))
        for w, each in enumerate(change):
            limit = np.maximum(
                usual, PART * median_filter(np.abs(motion[w]), NEARBY, mode="nearest") if len(each) else 0.0
            )
            alone, others = spikes_and_steps(each[:, None], (np.abs(each) > limit)[:, None])
            single += [(int(number[w, there[w][row]]), k) for row in alone]
            steps += [int(number[w, there[w][row + 1]]) for row in others]
    return Contradictions(sorted(set(single)), sorted(set(steps)), compared)


def unexplained(log: Any, wrong: Contradictions) -> BadInput:
    """Return the error for a log of which too much contradicts a fit."""
    rows = [row for row in sorted({row for row, _ in wrong.single} | set(wrong.steps)) if row < len(log.t)]
    count = len(wrong.single) + len(wrong.steps)
    return BadInput(
        f"the log contradicts the robot's motion in {count} of {wrong.compared} rows, "
        f"{rows_of(log.numbers, log.t, rows)}: no parameters explain it"
    )


def without(
    logs: Sequence[Any], field: str, wrong: Contradictions, outputs: Sequence[int], names: Sequence[str]
) -> list[Any]:
    """Return logs without what a fit contradicts: single measurements become NaN in the `field` of a log,
    whose columns have the `names` and of which the `outputs` were fitted; rows before and after a step are
    not connected. The rows of all logs are numbered one after the other. Raises BadInput if a large part of
    the log is contradicted.
    """
    cleaned: list[Any] = []
    begin = 0
    for log in logs:
        count = len(log.t)
        single = [(row - begin, outputs[k]) for row, k in wrong.single if begin <= row < begin + count]
        steps = [row - begin for row in wrong.steps if begin <= row < begin + count]
        begin += count
        if len(wrong.single) + len(wrong.steps) > MOST * wrong.compared:
            raise unexplained(log, wrong)
        values, remarks = getattr(log, field).copy(), list(log.remarks)
        if single:
            values[tuple(np.transpose(single))] = math.nan
            what = ", ".join(names[k] for k in sorted({k for _, k in single}))
            remarks.append(
                f"{what} is far off in {rows_of(log.numbers, log.t, sorted({r for r, _ in single}))}: left "
                "out"
            )
        if steps:
            said = rows_of(log.numbers, log.t, steps)
            remarks.append(f"the motion jumps at {said}; the rows before and after are not connected")
        after = [row - 1 for row in steps]
        cleaned.append(
            replace(log, **{field: values}, stretches=cut(log.stretches, after), remarks=tuple(remarks))
        )
    return cleaned
