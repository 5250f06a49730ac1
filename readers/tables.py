"""Tables of logs: any text, Parquet and MCAP are read as columns by name; CSV,
Parquet and MCAP are written."""

import io
import json
import math
import re
import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from .errors import BadInput, library, naming, suggestion
from .files import check_ending, read_input
from .quantities import in_base_units, is_unit, scaled_units
from .text_tables import DECIMAL_COMMA, entries_of, text_table

LARGEST = 256  # MB
FORMATS = (".csv", ".parquet", ".mcap")
OTHERS = {  # first bytes of files that are no tables, and what to do
    b"PK\x03\x04": "a workbook or an archive; export the sheet as CSV",
    b"\xd0\xcf\x11\xe0": "an old workbook; export the sheet as CSV",
    b"MATLAB 5.0": "a file of MATLAB; write the table with writetable",
    b"\x89HDF": "an HDF5 file; export the table as CSV or Parquet",
    b"\x93NUMPY": "an array of NumPy; write it with numpy.savetxt",
    b"#ROSBAG": "a bag of ROS 1; `noslip log BAG --map NAME=TOPIC:FIELD -o LOG.csv` makes a table of it",
    b"SQLite format 3": "a database; of a bag of ROS 2 `noslip log BAG --map NAME=TOPIC:FIELD -o LOG.csv` "
    "makes a table",
}
WITH_UNIT = re.compile(r"(.*\S)(\s*)(?:\[([^]]*)\]|\(([^)]*)\))")
SUFFIXES = ("rad", "deg", "rpm", "mm", "cm", "m", "s", "ms", "us", "ns")  # units that may end a name: phi_deg
SECONDS = {
    "sec": "s",
    "secs": "s",
    "seconds": "s",
    "msec": "ms",
    "millis": "ms",
    "usec": "us",
    "micros": "us",
    "nsec": "ns",
}
TIME = re.compile(
    rf"(?:.*:)?(?:[%#_]*(?:t|times?|time_?stamps?|stamp|elapsed)(?:[_ ](s|ms|us|ns|{'|'.join(SECONDS)}))?"
    rf"|({'|'.join(SECONDS)}))",
    re.IGNORECASE,
)
STAMP = re.compile(r"(.*?)(n|nano)?secs?", re.IGNORECASE)  # two columns of whole seconds and nanoseconds
SPEED = re.compile(r"(?:.*[.:/])?(?:v|v_?x|omega|w|w_?z|linear.*|angular.*)", re.IGNORECASE)  # of the vehicle
MISSING = {"", "-", "--", "na", "n/a", "#n/a", "null", "none", "-nan(ind)", "nan(ind)", "1.#qnan", "-1.#ind"}
NANOSECONDS = 1e9  # per second, of the times of MCAP
SHOWN = 12  # names in a message


@dataclass(frozen=True)
class Column:
    """Entries of a column, None or "" where there is none, with the unit that its header gives, if any;
    `where` names file and column, `rows` are the numbers of its rows in the file. `topic`: that of its
    messages; `sign`: a factor of all numbers; `problem`: why it cannot be used; `others`: `where` of columns
    that it is made of, too. `is_yaw`: it was computed from quaternions, in rad whatever is said of its unit.
    """

    entries: Sequence[Any]
    unit: str | None
    where: str
    rows: Sequence[int]
    topic: str = ""
    sign: float = 1.0
    problem: str = ""
    others: Sequence[str] = ()
    is_yaw: bool = False

    def numbers(self, unit: str | None = "") -> np.ndarray:
        """Return the column as floats in SI, NaN where an entry is empty. `unit`: the SI unit of the
        quantity; None: of any. Times may also be dates, which are counted from 1970.

        Raises BadInput for an entry that is not a number, and for a unit of another kind.
        """
        if self.problem:
            raise BadInput(self.problem)
        values = np.empty(len(self.entries))
        for k, entry in enumerate(self.entries):
            try:
                values[k] = _number(entry, unit == "s")
            except (TypeError, ValueError, OverflowError) as error:
                text = repr(str(entry)[:40])
                hint = (
                    "; write a point, not a comma, before decimals"
                    if DECIMAL_COMMA.fullmatch(str(entry))
                    else ""
                )
                raise BadInput(f"{self.where} row {self.rows[k]}: {text} is not a number{hint}") from error
        if self.unit is None:
            return self.sign * values
        with naming(self.where, remedy="write another unit, --map 'NAME=COLUMN [UNIT]'"):
            factor, dimension = scaled_units(self.unit)
        if unit is not None and dimension != in_base_units(unit or "1")[1]:
            hint = (
                "; of a distance on the floor, with the wheel's radius in m: --map 'NAME=COLUMN [rad/0.15]'"
            )
            hint = hint if unit == "rad" and dimension == in_base_units("m")[1] else ""
            raise BadInput(f"{self.where}: [{self.unit}] is not a unit of a quantity in {unit or '1'}{hint}")
        return self.sign * values * float(factor)


def _number(entry: Any, is_time: bool) -> float:
    """Return an entry of a table as a number. Raises ValueError, TypeError, OverflowError."""
    if entry is None or isinstance(entry, str) and entry.lower() in MISSING:
        return math.nan
    # Python would take them for numbers
    if isinstance(entry, bool) or isinstance(entry, str) and "_" in entry:
        raise ValueError(entry)
    try:
        return float(entry)
    except ValueError:
        if not is_time:
            raise
        date = datetime.fromisoformat(entry if "-" in entry else f"1970-01-01T{entry}")
        return (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()


class Table(dict[str, Column]):
    """Columns by name, in the order of the file. `header`: whether the file names them; else they are called
    "1", "2", ... `clocks`: the times of each topic's messages, of a file with several; `remarks`: what was
    left out.
    """

    def __init__(self, file: str | Path, header: bool = True, remarks: Sequence[str] = ()):
        super().__init__()
        self.file, self.header, self.remarks = str(file), header, list(remarks)
        self.clocks: dict[str, Column] = {}

    def missing(self, column: str, quantity: str) -> BadInput:
        """Return the error for a column that the table does not have, or a quantity for which it has none."""
        if not self.header:
            first = ", ".join(str(each.entries[0]) for each in [*self.values()][:SHOWN] if each.entries)
            names = f"--columns t,{'...' if quantity == 't' else f'{quantity},...'}"
            return BadInput(
                f"{self.file} has no header: its first row is {first}; name its {len(self)} columns in "
                f"order, {names}, with - for one that is not used, or give --map {quantity}=NUMBER"
            )
        near = suggestion(column, self).partition("; known are")[0]
        turns = {part for parts in _quaternions(self).values() for part in parts}
        speeds = ", ".join(name for name in self if SPEED.fullmatch(name) and name not in turns)
        return BadInput(
            f"{self.file}: column {column!r} is missing{near}; there are {listed(self)}; say which it is: "
            f"--map {quantity}=COLUMN, or --map '{quantity}=COLUMN [UNIT]' if it is not in SI units"
            + (f" (speeds of the vehicle, {speeds}, are not those of its wheels)" if speeds else "")
        )


def is_time(name: str) -> bool:
    """Return whether a column of this name has times, or one of their two columns."""
    return bool(TIME.fullmatch(name) or STAMP.fullmatch(name))


def listed(names: Iterable[str]) -> str:
    """Return names as text, the first ones of many."""
    names = list(names)
    return ", ".join(names[:SHOWN]) + (f" and {len(names) - SHOWN} more" if len(names) > SHOWN else "")


def read_table(file: str | Path, columns: Sequence[str] = (), incomplete: bool = False) -> Table:
    """Return the columns of a table by name; the format, Parquet, MCAP or a text as `text_table` reads it, is
    seen in the content.

    `columns` are names in the order of the file that replace its header, "-" for columns that are not used. A
    unit in brackets or parentheses at the end of a name, "phi [deg]", is not part of it. `incomplete`: cells
    at the end of a row may be missing. Raises BadInput if the file is not such a table, or the library that
    reads it is missing; and OSError.
    """
    data, suffix = read_input(file, LARGEST), Path(file).suffix.lower()
    for kind, mark, read in ((".mcap", b"\x89MCAP", _mcap), (".parquet", b"PAR1", _parquet)):
        if suffix == kind or data.startswith(mark):
            if columns:
                raise BadInput(
                    f"--columns: the columns of {file} have names; rename them with --map NAME=COLUMN"
                )
            return read(file, data)
    for mark, kind in OTHERS.items():
        if data.startswith(mark):
            raise BadInput(f"{file} is {kind}")
    text = text_table(data, str(file), LARGEST, columns, incomplete)
    names = text.names or [str(k + 1) for k in range(max(map(len, text.rows), default=0))]
    table = Table(file, text.names is not None, text.remarks)
    units = [*text.units, *[None] * len(names)]
    for k, head in enumerate(names):
        _add(table, head or f"unnamed {k + 1}", [each[k] for each in text.rows], text.lines, stated=units[k])
    table.pop("-", None)
    return table


def _add(
    table: Table,
    head: str,
    entries: Sequence[Any],
    rows: Sequence[int],
    topic: str = "",
    stated: str | None = None,
) -> None:
    """Add a column whose header may have a unit; one whose name occurs twice cannot be used."""
    name, unit = _split(head)
    where, unit = f"{table.file} column {name!r}", stated if unit is None else unit
    twice = f"{table.file}: two columns are called {name!r}; name all in order, --columns NAME,..."
    table[name] = Column(entries, unit, where, rows, topic, problem=twice if name in table else "")


def column_name(text: str) -> str:
    """Return the name of the column in an entry of --map, "-COLUMN" or "COLUMN [UNIT]"."""
    return _split(text)[0].removeprefix("-")


def _split(head: str) -> tuple[str, str | None]:
    """Return name and unit of a header such as "phi [deg]"; "position[0]" is a name."""
    parts = WITH_UNIT.fullmatch(head)
    name, space, in_brackets, in_parentheses = parts.groups() if parts else (head, "", None, None)
    if in_brackets is not None and (space or not in_brackets.isdigit()):
        return name, "" if in_brackets == "-" else in_brackets
    if in_parentheses is not None and is_unit(in_parentheses):
        return name, in_parentheses
    return head, None


def picked(table: Table, units: Mapping[str, str | None], chosen: Mapping[str, str]) -> dict[str, Column]:
    """Return the columns of quantities, which are given with their SI units, as far as the table has them:
    the `chosen` one, as "COLUMN", "-COLUMN" for the negative of it, or "COLUMN [UNIT]"; or that of the same
    name, whose case may differ and which may end with a unit, "phi_deg". The time t may be called time,
    timestamp, stamp, ..., or be two columns of s and ns.

    Raises BadInput for a chosen column that is missing, and for a quantity that may be one of several
    columns.
    """
    found = {}
    for quantity, unit in units.items():
        if quantity in chosen:
            found[quantity] = _chosen(chosen[quantity], quantity, table)
            continue
        alike = {quantity: table[quantity]} if quantity in table else _alike(quantity, unit, table)
        if len(alike) > 1:
            choice = f"choose one, --map {quantity}={next(iter(alike))}"
            raise BadInput(f"{table.file}: {quantity} may be {' or '.join(alike)}; {choice}")
        if alike:
            (found[quantity],) = alike.values()
    if problem := next(filter(None, (column.problem for column in found.values())), None):
        raise BadInput(problem)
    return found


def _alike(quantity: str, unit: str | None, table: Table) -> dict[str, Column]:
    """Return the columns whose names are the quantity's but for case, topic and a unit at the end."""
    form = rf"(?:.*:)?{re.escape(quantity)}(?:_({'|'.join(SUFFIXES)}))?"
    pattern = TIME if quantity == "t" else re.compile(form, re.IGNORECASE)
    pairs = _pairs_of_times(table) if quantity == "t" else {}
    found = {sec: column for (sec, _), column in pairs.items()}
    for name, column in table.items():
        parts = pattern.fullmatch(name)
        if not parts or any(name in pair for pair in pairs):
            continue
        stated = next((part.lower() for part in parts.groups() if part), None)
        stated = SECONDS.get(stated or "", stated)
        if stated is None or scaled_units(stated)[1] == in_base_units(unit or "1")[1]:
            found[name] = column if column.unit is not None else replace(column, unit=stated)
    return found


def _pairs_of_times(table: Mapping[str, Column]) -> dict[tuple[str, str], Column]:
    """Return the times in s that two columns give, whole seconds and nanoseconds:
    header.stamp.sec and .nanosec."""
    parts = [(name, match) for name in table if (match := STAMP.fullmatch(name))]
    found = {}
    for sec, nanosec in [(a, b) for a, s in parts for b, ns in parts if ns[2] and not s[2] and s[1] == ns[1]]:
        whole, part = table[sec], table[nanosec]
        times = (
            replace(whole, unit=None).numbers() + replace(part, unit=None).numbers() / NANOSECONDS
        ).tolist()
        found[sec, nanosec] = Column(times, "s", whole.where, whole.rows, whole.topic)
    return found


def _quaternions(table: Mapping[str, Column]) -> dict[str, tuple[str, ...]]:
    """Return the columns x, y, z and w of each quaternion, by what is before these:
    pose.orientation of pose.orientation.w."""
    stems = [name[:-1] for name in table if name.endswith("w")]
    each = {stem.rstrip("._/"): tuple(f"{stem}{part}" for part in "xyzw") for stem in stems if stem}
    return {
        name: parts
        for name, parts in each.items()
        if name not in table and all(part in table for part in parts)
    }


def yaw_of(x: float, y: float, z: float, w: float) -> float:
    """Return the yaw of a quaternion, rad; NaN of one that is zero."""
    return math.atan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z) if x or y or z or w else math.nan


def _yaw(parts: Sequence[Column]) -> Column:
    """Return the column of the yaw, rad, of a quaternion in columns x, y,
    z and w. Raises BadInput as `numbers`."""
    quaternions = zip(*(replace(part, unit=None).numbers().tolist() for part in parts), strict=True)
    yaws = [yaw_of(*quaternion) for quaternion in quaternions]
    return replace(parts[0], entries=yaws, unit="rad", others=[part.where for part in parts], is_yaw=True)


def _chosen(text: str, quantity: str, table: Table) -> Column:
    """Return the column of an entry of --map, of a quaternion its yaw. Raises BadInput if the table has
    none."""
    pairs = _pairs_of_times(table) if quantity == "t" else {}
    known = {**table, **{sec: column for (sec, _), column in pairs.items()}}
    name, unit = _split(text)
    turns = _quaternions(table)
    if turned := next((each for each in _spellings(name.removeprefix("-"), table) if each in turns), ""):
        known[turned] = _yaw([table[part] for part in turns[turned]])
    for sign, whole, bare in ((1.0, text, name), (-1.0, text.removeprefix("-"), name.removeprefix("-"))):
        for tried, stated in ((whole, None), (bare, unit)):
            for column in (known[each] for each in _spellings(tried, table) if each in known):
                if column.is_yaw and stated not in (None, "rad"):
                    raise BadInput(
                        f"{table.file}: --map {quantity}={text}: the yaw of a quaternion is in rad; "
                        f"leave out [{unit}]"
                    )
                return replace(column, sign=sign, unit=column.unit if stated is None else stated)
    raise table.missing(name, quantity)


def _spellings(name: str, table: Table) -> Iterator[str]:
    """Yield what a column may be called in a table: without the mark of a comment, with or without its topic,
    before which a field may have a colon or a point.
    """
    yield from (name, name.lstrip("%# "))
    for topic in dict.fromkeys(column.topic for column in table.values() if column.topic):
        if name.startswith((f"{topic}:", f"{topic}.")):
            field = name.removeprefix(topic)[1:]
            yield from (f"{topic}:{field}", field)


def _parquet(file: str | Path, data: bytes) -> Table:
    pq = library("pyarrow.parquet", "Parquet needs pyarrow", "sweep")
    import pyarrow

    try:
        arrow = pq.read_table(io.BytesIO(data)).flatten()
    except (pyarrow.ArrowException, OSError) as error:
        raise BadInput(f"{file} is not a Parquet file, or is damaged") from error
    table = Table(file)
    for name, column in zip(arrow.column_names, arrow.columns, strict=True):
        dated = pyarrow.types.is_timestamp(column.type)  # nanoseconds are no datetime of Python
        plain = (
            column.cast(pyarrow.timestamp("ns", column.type.tz)).cast(pyarrow.int64()) if dated else column
        )
        _add(table, name, plain.to_pylist(), range(1, len(column) + 1), stated="ns" if dated else None)
    return table


def _mcap(file: str | Path, data: bytes) -> Table:
    """Return the fields of JSON messages: a row for each message of a topic, in the order of time.

    With several topics a column is TOPIC:FIELD. The times of a topic are its field t, a time stamp in its
    messages, or the times of the log, from its start, in s.
    """
    reader = library("mcap.reader", "MCAP needs the library mcap", "logs")
    from mcap.exceptions import McapError

    topics: dict[str, list[tuple[int, dict[str, Any]]]] = {}
    encoded: dict[str, str] = {}
    try:
        for _, channel, message in reader.make_reader(io.BytesIO(data)).iter_messages():
            if channel.message_encoding == "json":
                fields = dict(entries_of(json.loads(message.data)))
                topics.setdefault(channel.topic, []).append((message.log_time, fields))
            else:
                encoded[channel.topic] = (
                    f"topic {channel.topic} is encoded as {channel.message_encoding}, which is read of bags "
                    "of ROS 2 only, else JSON; `noslip log` makes a table of a bag"
                )
    except (
        McapError,
        struct.error,
        ValueError,
        TypeError,
        AttributeError,
        RecursionError,
        EOFError,
    ) as error:
        raise BadInput(f"{file} is not an MCAP file, or is damaged") from error
    if not topics:
        raise BadInput(f"{file}{''.join(f': {each}' for each in encoded.values()) or ' has no messages'}")
    several = len(topics) > 1
    table = Table(file, remarks=[*encoded.values()])
    stamps = {}
    for topic, messages in topics.items():
        own, rows = Table(file), range(1, len(messages) + 1)
        for name in dict.fromkeys(name for _, fields in messages for name in fields):
            entries = [fields.get(name) for _, fields in messages]
            _add(own, f"{topic}:{name}" if several else name, entries, rows, topic)
        table |= own
        name = f"{topic}:t" if several else "t"
        stamped = [own[name]] if name in own else [*_alike("t", "s", own).values()]
        if len(stamped) == 1:
            stamps[topic] = stamped[0]
    start = 0 if stamps else min(messages[0][0] for messages in topics.values())
    for topic, messages in topics.items():
        times = [(time - start) / NANOSECONDS for time, _ in messages]
        logged = Column(times, "s", f"{file} {topic} time of the log", range(1, len(messages) + 1), topic)
        table.clocks[topic] = stamps.get(topic, logged)
    if not several and "t" not in table:
        table["t"] = table.clocks[topic]
    return table


@dataclass(frozen=True, eq=False)
class Written:
    """A column to write: its name, unit, what it is, and its numbers or texts."""

    name: str
    unit: str
    about: str
    values: np.ndarray | Sequence[Any]


def check_format(file: str) -> None:
    """Raise BadInput unless the name of a table to write ends as one of FORMATS, and its library is there."""
    suffix = Path(file).suffix.lower()
    if file != "-":
        check_ending(file, FORMATS, "a log")
    if suffix == ".parquet":
        library("pyarrow.parquet", "Parquet needs pyarrow", "sweep")
    if suffix == ".mcap":
        library("mcap.writer", "MCAP needs the library mcap", "logs")


def table_bytes(columns: Sequence[Written], suffix: str, topic: str, about: Mapping[str, str]) -> str | bytes:
    """Return a table in the format of a suffix of FORMATS; the first column is the time t,
    s. `about` are remarks by name."""
    if suffix == ".parquet":
        return _parquet_bytes(columns, about)
    return _mcap_bytes(columns, topic, about) if suffix == ".mcap" else _csv_text(columns)


def _csv_text(columns: Sequence[Written]) -> str:
    rows = zip(*(map(_text, each.values) for each in columns), strict=True)
    return "\n".join([",".join(each.name for each in columns), *(",".join(row) for row in rows)]) + "\n"


def _text(value: Any) -> str:
    """Return a number so that it is read as the same: floats with the digits of their type."""
    return repr(value) if isinstance(value, float) and not isinstance(value, np.generic) else str(value)


def _parquet_bytes(columns: Sequence[Written], about: Mapping[str, str]) -> bytes:
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrays = [pa.array(each.values) for each in columns]
    fields = [
        pa.field(each.name, array.type, metadata={"unit": each.unit, "about": each.about})
        for each, array in zip(columns, arrays, strict=True)
    ]
    stream = io.BytesIO()
    pq.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata=dict(about))), stream)
    return stream.getvalue()


def _mcap_bytes(columns: Sequence[Written], topic: str, about: Mapping[str, str]) -> bytes:
    """Return messages in JSON with a JSON Schema, which PlotJuggler and Foxglove read."""
    from mcap.writer import Writer

    properties = {
        each.name: {
            "type": _json_type(each.values),
            "description": f"{each.about}, {each.unit}" if each.unit else each.about,
        }
        for each in columns
    }
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "type": "object",
        "properties": properties,
    }
    stream = io.BytesIO()
    writer = Writer(stream)
    writer.start(library="noslip")
    kind = writer.register_schema("noslip.tick", "jsonschema", json.dumps(schema).encode())
    channel = writer.register_channel(topic, "json", kind)
    writer.add_metadata("noslip", dict(about))
    for k, row in enumerate(_plain_rows(columns)):
        time = round(row["t"] * NANOSECONDS)
        writer.add_message(
            channel, log_time=time, publish_time=time, sequence=k, data=json.dumps(row).encode()
        )
    writer.finish()
    return stream.getvalue()


def _plain_rows(columns: Sequence[Written]) -> Iterable[dict[str, Any]]:
    names = [each.name for each in columns]
    for row in zip(*(each.values for each in columns), strict=True):
        values = (value.item() if hasattr(value, "item") else value for value in row)
        yield {
            n: None if isinstance(v, float) and not math.isfinite(v) else v
            for n, v in zip(names, values, strict=True)
        }


def _json_type(values: np.ndarray | Sequence[Any]) -> str:
    kind = np.asarray(values).dtype.kind
    return {"f": "number", "i": "integer", "u": "integer"}.get(kind, "string")
