"""Repeats the ticks of a dump with the same C on this host and compares every bit of the records."""

import numpy as np

from ...readers.progress import Reported, silent
from .dump import Start
from .vehicle import FollowerInC

# Arguments of a tick; all other fields of a record are compared
GIVEN = ("tick", "missed", "counts", "dt", "turned")


def first_different_tick(
    start: Start, vehicle: FollowerInC, where: str, progress: Reported = silent
) -> tuple[int, str | None]:
    """Return how many ticks are the same, and the first difference, None if there is none up to the end.

    Ticks after a record that is missing cannot be repeated, which counts as a difference. Raises BadInput if
    the config or an event of the start cannot be used.
    """
    lost = start.lost
    last = lost[0][0] if lost else len(start.records)
    repeated = _repeated(start, vehicle, last, where, progress)
    if isinstance(repeated, str):
        return 0, repeated
    recorded = start.records[:last]
    rows = {
        name: _rows_that_differ(recorded[name], repeated[name])
        for name in recorded.dtype.names or ()
        if name not in GIVEN
    }
    first = min((int(each[0]) for each in rows.values() if len(each)), default=last)
    for name, each in rows.items():
        if len(each) and each[0] == first:
            then, now = (np.atleast_1d(values[name][first]) for values in (recorded, repeated))
            return (
                first,
                f"tick {recorded['tick'][first]}: {name} was {_shown(then)}, on this host it is "
                f"{_shown(now)}",
            )
    if lost:
        tick = start.records["tick"][last]
        return last, f"{lost[0][1]} records are missing before tick {tick}: what follows cannot be repeated"
    return last, None


def _repeated(
    start: Start, vehicle: FollowerInC, last: int, where: str, progress: Reported
) -> np.ndarray | str:
    """Return the records of the first `last` ticks, or why the follower does not begin."""
    config, segments = vehicle.config(start.image, where)
    follower, command, turned = vehicle.new(""), vehicle.reals(2), vehicle.reals(2)
    record, memory = vehicle.records()
    status = vehicle.call("init", follower, config)
    if status < 0:
        return f"init refuses the config: {vehicle.status(status)}"
    counts, buffer = vehicle.ffi.new("uint32_t[2]"), vehicle.ffi.buffer(record)
    rows, events = [], list(start.events)
    for row, given in enumerate(start.records[:last]):
        progress(row, last, "ticks repeated")
        while events and events[0].row <= row:
            vehicle.apply(events.pop(0), follower)
        missed, dt = int(given["missed"]), float(given["dt"])
        if dt:
            turned[0], turned[1] = map(float, given["turned"])
            status = vehicle.call("tick_angles", follower, turned, dt, command)
        else:
            counts[0], counts[1] = map(int, given["counts"])
            status = vehicle.call("tick", follower, counts, missed, command)
        vehicle.call("record", follower, counts, missed, status, command, record)
        rows.append(bytes(buffer))
    del segments  # kept until here: the config points to them
    return np.frombuffer(b"".join(rows), memory)


def _rows_that_differ(then: np.ndarray, now: np.ndarray) -> np.ndarray:
    """Return the rows whose bits differ."""
    size = then.dtype.itemsize * int(np.prod(then.shape[1:], dtype=int))
    bits = [np.ascontiguousarray(values).view(np.uint8).reshape(len(values), size) for values in (then, now)]
    return np.flatnonzero((bits[0] != bits[1]).any(axis=1))


def _shown(values: np.ndarray) -> str:
    return " ".join(f"{np.ascontiguousarray(v).tobytes()[::-1].hex()} ({v})" for v in values)
