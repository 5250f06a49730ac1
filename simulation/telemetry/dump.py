"""A serial dump: frames as runtime_c/noslip_telemetry.h writes them, the starts of a vehicle in it,
and what is missing."""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import IntEnum
from functools import lru_cache
from pathlib import Path

import numpy as np

from ...codegen.printing.scalar import SCALARS
from ...codegen.runtime import runtime_files
from ...codegen.telemetry.members import Structs
from ...readers.errors import BadInput
from ...readers.files import read_input

LARGEST = 1024  # MB
CRC = struct.Struct("<I")
REAL_IN_FORMAT = 5  # place of the byte in an image that says how many bytes a real has, see noslip_image.h


class Kind(IntEnum):
    """Kinds of frames, as in noslip_telemetry.h."""

    ROBOT = 1
    CONFIG = 2
    UPDATE = 3
    RECORD = 4
    CORRECT = 5
    RESET = 6


@dataclass(frozen=True)
class Event:
    """What was done between two ticks: `row` is the record before which it was done."""

    row: int
    kind: Kind
    content: bytes


@dataclass(eq=False)
class Start:
    """The ticks from one start of a vehicle on: the name of its robot, the image of its config, records in
    the order of ticks, and what was done between them.
    """

    robot: str
    image: bytes
    records: np.ndarray
    events: tuple[Event, ...]

    @property
    def scalar(self) -> str:
        """The scalar of the C: double or float."""
        return "double" if self.image[REAL_IN_FORMAT] == 8 else "float"

    @property
    def lost(self) -> list[tuple[int, int]]:
        """Rows before which records are missing, and how many."""
        ticks, missed = self.records["tick"].astype(np.int64), self.records["missed"].astype(np.int64)
        absent = np.diff(ticks, prepend=-1) - 1 - missed
        return [(int(row), int(absent[row])) for row in np.flatnonzero(absent)]


@dataclass(eq=False)
class Dump:
    """The starts in a dump, and remarks about what could not be read."""

    starts: list[Start] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)


@lru_cache
def record_type(scalar: str) -> np.dtype:
    """Return the type of a record in a frame: the members of noslip_record in their order, little-endian."""
    header = [runtime_files()[f"noslip_{name}.h"] for name in ("telemetry", "odometry")]
    real = "<f8" if scalar == "double" else "<f4"
    unsigned = ("tick", "missed", "counts")
    fields = []
    for member in Structs(header).members(SCALARS[scalar].name("noslip_record")):
        kind = real if member.real else "<u4" if member.path in unsigned else "<i4"
        fields.append((member.path, kind, (member.count,)) if member.count > 1 else (member.path, kind))
    return np.dtype(fields)


def decoded(block: bytes) -> bytes:
    """Return the bytes of a frame that COBS has encoded. Raises ValueError where it is damaged."""
    result, at = bytearray(), 0
    while at < len(block):
        code = block[at]
        if at + code > len(block):
            raise ValueError("a block is cut off")
        result += block[at + 1 : at + code]
        at += code
        if code < 255 and at < len(block):
            result.append(0)
    return bytes(result)


def frames(data: bytes) -> Iterator[tuple[int, bytes] | None]:
    """Yield the kind and the content of each frame, None for one that is damaged or incomplete."""
    for block in data.split(b"\0"):
        if not block:
            continue
        try:
            whole = decoded(block)
        except ValueError:
            yield None
            continue
        sound = len(whole) > CRC.size and zlib.crc32(whole[: -CRC.size]) == CRC.unpack(whole[-CRC.size :])[0]
        yield (whole[0], whole[1 : -CRC.size]) if sound else None


@dataclass
class _Open:
    """A start that is being read."""

    robot: str = ""
    image: bytes = b""
    records: list[bytes] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    tick: int = -1


def read_dump(file: str | Path) -> Dump:
    """Read a dump. Raises BadInput if it has no tick with a config, and OSError.

    Damaged frames are left out, and so are the ticks of a start without a config. A start begins where the
    number of the tick goes back.
    """
    data = read_input(file, LARGEST)
    dump, open_starts, damaged, own = Dump(), [_Open()], 0, 0
    robot, image, pending = "", b"", []
    for frame in frames(data):
        if frame is None:
            damaged += 1
        elif frame[0] == Kind.ROBOT:
            robot = frame[1].decode("ascii", "replace")
        elif frame[0] == Kind.CONFIG:
            image = frame[1]
        elif frame[0] in (Kind.UPDATE, Kind.CORRECT, Kind.RESET):
            pending.append((Kind(frame[0]), frame[1]))
        elif frame[0] == Kind.RECORD:
            start, tick = open_starts[-1], CRC.unpack_from(frame[1])[0]
            if tick <= start.tick or (image and start.image and image != start.image):
                start = _Open()
                open_starts.append(start)
            if image:
                start.robot, start.image = robot, image
            start.events += [Event(len(start.records), kind, content) for kind, content in pending]
            start.records.append(frame[1])
            start.tick, robot, image, pending = tick, "", b"", []
        else:
            own += 1
    dump.starts = [_closed(each, dump.remarks) for each in open_starts if each.image and each.records]
    without = sum(len(each.records) for each in open_starts if not each.image)
    if damaged:
        dump.remarks.append(f"{damaged} damaged frames are left out")
    if own:
        dump.remarks.append(f"{own} frames of other kinds are left out")
    if without:
        dump.remarks.append(f"{without} ticks of starts without a config are left out")
    if not dump.starts:
        said = f"; {', '.join(dump.remarks)}" if dump.remarks else ""
        raise BadInput(f"{file}: no config and ticks of noslip_telemetry are found{said}")
    return dump


def _closed(start: _Open, remarks: list[str]) -> Start:
    """Return a start with its records as an array; those of another size than the config says are left
    out."""
    scalar = "double" if start.image[REAL_IN_FORMAT : REAL_IN_FORMAT + 1] == b"\x08" else "float"
    kind = record_type(scalar)
    fits = [len(record) == kind.itemsize for record in start.records]
    if not all(fits):
        remarks.append(
            f"{fits.count(False)} records are not in {scalar}, as their config is, and are left out"
        )
    rows = np.cumsum([0, *fits]).tolist()
    events = tuple(Event(rows[each.row], each.kind, each.content) for each in start.events)
    whole = b"".join(record for record, good in zip(start.records, fits, strict=True) if good)
    return Start(start.robot, start.image, np.frombuffer(whole, kind), events)


def chosen(dump: Dump, number: int | None, file: str) -> Start:
    """Return the start of a number, from 1; the only one without a number. Raises BadInput."""
    count = len(dump.starts)
    if number is None and count > 1:
        lengths = ", ".join(f"{k}: {len(start.records)} ticks" for k, start in enumerate(dump.starts, 1))
        raise BadInput(
            f"{file}: the vehicle was started {count} times ({lengths}); choose one with --start K"
        )
    if number is not None and not 1 <= number <= count:
        raise BadInput(f"--start {number}: {file} has {count} starts")
    return dump.starts[(number or 1) - 1]
