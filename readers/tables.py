"""Tables of logs: CSV, Parquet and MCAP, read as columns by name and written."""

import csv
import io
import json
import math
import re
import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from .errors import BadInput, installing
from .files import read_input
from .quantities import in_base_units

LARGEST = 256  # MB
FORMATS = (".csv", ".parquet", ".mcap")
WITH_UNIT = re.compile(r"(.*\S)\s*\[([^]]*)\]")
DECIMAL_COMMA = re.compile(r"\s*[-+]?\d*,\d+(?:[eE][-+]?\d+)?\s*")
NANOSECONDS = 1e9  # per second, of the times of MCAP


@dataclass(frozen=True)
class Column:
    """Entries of a column, None or "" where there is none, with the unit that its header gives in brackets, if any; `where`
    names file and column.
    """

    entries: Sequence[Any]
    unit: str | None
    where: str

    def numbers(self, unit: str = "") -> np.ndarray:
        """Return the column as floats in SI, NaN where an entry is empty. `unit`: the SI unit of the quantity.

        Raises BadInput for an entry that is not a number, and for a unit of another kind.
        """
        values = np.empty(len(self.entries))
        for k, entry in enumerate(self.entries):
            try:
                values[k] = math.nan if entry is None or entry == "" else float(entry)
            except (TypeError, ValueError) as error:
                hint = ": write a point, not a comma, before decimals" if DECIMAL_COMMA.fullmatch(str(entry)) else ""
                raise BadInput(f"{self.where} row {k + 2}: {str(entry)[:40]!r} is not a number{hint}") from error
        if self.unit is None:
            return values
        try:
            factor, dimension = in_base_units(self.unit)
        except BadInput as error:
            raise BadInput(f"{self.where}: {error}") from error
        if dimension != in_base_units(unit or "1")[1]:
            raise BadInput(f"{self.where}: [{self.unit}] is not a unit of a quantity in {unit or '1'}")
        return values * float(factor)


def read_table(file: str | Path) -> dict[str, Column]:
    """Return the columns of a table by name; the format is that of the file's suffix, CSV for any other. What separates the names
    of the columns of a CSV, commas, semicolons or tabs, separates its entries.

    A unit in brackets at the end of a name, "phi [deg]", is not part of it. Raises BadInput if the file is not such a table,
    or the library that reads it is missing; and OSError.
    """
    suffix = Path(file).suffix.lower()
    table = _parquet(file) if suffix == ".parquet" else _mcap(file) if suffix == ".mcap" else _csv(file)
    columns: dict[str, Column] = {}
    for head, entries in table.items():
        parts = WITH_UNIT.fullmatch(head)
        name, unit = (parts[1], parts[2]) if parts else (head, None)
        if name in columns:
            raise BadInput(f"{file}: two columns are called {name!r}")
        columns[name] = Column(entries, unit, f"{file} column {name!r}")
    return columns


def _csv(file: str | Path) -> dict[str, list[str]]:
    try:
        text = read_input(file, LARGEST).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise BadInput(f"{file}: not a text file (byte {error.start}); logs are CSV, .parquet or .mcap") from error
    lines = list(csv.reader(io.StringIO(text), delimiter=_separator(text)))
    lines = [line for line in lines if line and not line[0].startswith("#")]
    if not lines:
        raise BadInput(f"{file} is empty")
    head = [name.strip() for name in lines[0]]
    for name in head:
        if head.count(name) > 1:
            raise BadInput(f"{file}: two columns are called {name!r}")
    for k, line in enumerate(lines[1:], 2):
        if len(line) != len(head):
            raise BadInput(f"{file} row {k}: {len(line)} entries, but the first row names {len(head)} columns")
    return {name: [line[k] for line in lines[1:]] for k, name in enumerate(head)}


def _separator(text: str) -> str:
    """Return what separates the names of the columns: a comma; a semicolon or a tab where they have no comma."""
    head = next((line for line in text.splitlines() if line and not line.startswith("#")), "")
    return next((mark for mark in ",;\t" if mark in head), ",")


def _parquet(file: str | Path) -> dict[str, Sequence[Any]]:
    pq = _library("pyarrow.parquet", "Parquet needs pyarrow", "sweep")
    import pyarrow

    try:
        table = pq.read_table(io.BytesIO(read_input(file, LARGEST)))
    except pyarrow.ArrowException as error:
        raise BadInput(f"{file} is not a Parquet file, or is damaged") from error
    return {name: table[name].to_pylist() for name in table.column_names}


def _mcap(file: str | Path) -> dict[str, list[Any]]:
    """Return the fields of JSON messages: a row for each message, in the order of time.

    With several topics a column is TOPIC.FIELD. Without a field t it is the time of the log, from its start, in s.
    """
    reader = _library("mcap.reader", "MCAP needs the library mcap", "logs")
    from mcap.exceptions import McapError

    rows: list[tuple[int, str, dict[str, Any]]] = []
    try:
        for _, channel, message in reader.make_reader(io.BytesIO(read_input(file, LARGEST))).iter_messages():
            if channel.message_encoding != "json":
                encoding = channel.message_encoding
                raise BadInput(f"{file}: topic {channel.topic} is encoded as {encoding}; only JSON is read, convert it to CSV")
            rows.append((message.log_time, channel.topic, dict(_fields(json.loads(message.data)))))
    except (McapError, struct.error, ValueError, TypeError, AttributeError) as error:
        raise BadInput(f"{file} is not an MCAP file, or is damaged") from error
    if not rows:
        raise BadInput(f"{file} has no messages")
    several = len({topic for _, topic, _ in rows}) > 1
    named = [(time, {f"{topic}.{name}" if several else name: v for name, v in each.items()}) for time, topic, each in rows]
    names = list(dict.fromkeys(name for _, each in named for name in each))
    table = {name: [each.get(name) for _, each in named] for name in names}
    return table if "t" in table else {"t": [(time - named[0][0]) / NANOSECONDS for time, _ in named], **table}


def _fields(message: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the entries of a message by their path: pose.x, rates.0."""
    if isinstance(message, dict | list):
        for key, value in message.items() if isinstance(message, dict) else enumerate(message):
            yield from _fields(value, f"{path}.{key}" if path else str(key))
    else:
        yield path, message


def _library(name: str, what: str, extra: str) -> ModuleType:
    try:
        return import_module(name)
    except ImportError as error:
        raise BadInput(f"{what}; {installing(extra)}") from error


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
    if suffix not in FORMATS and file != "-":
        raise BadInput(f"{file}: a log is written as {', '.join(FORMATS)}")
    if suffix == ".parquet":
        _library("pyarrow.parquet", "Parquet needs pyarrow", "sweep")
    if suffix == ".mcap":
        _library("mcap.writer", "MCAP needs the library mcap", "logs")


def table_bytes(columns: Sequence[Written], suffix: str, topic: str, about: Mapping[str, str]) -> str | bytes:
    """Return a table in the format of a suffix of FORMATS; the first column is the time t, s. `about` are remarks by name."""
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
        each.name: {"type": _json_type(each.values), "description": f"{each.about}, {each.unit}" if each.unit else each.about}
        for each in columns
    }
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", "type": "object", "properties": properties}
    stream = io.BytesIO()
    writer = Writer(stream)
    writer.start(library="noslip")
    kind = writer.register_schema("noslip.tick", "jsonschema", json.dumps(schema).encode())
    channel = writer.register_channel(topic, "json", kind)
    writer.add_metadata("noslip", dict(about))
    for k, row in enumerate(_plain_rows(columns)):
        time = round(row["t"] * NANOSECONDS)
        writer.add_message(channel, log_time=time, publish_time=time, sequence=k, data=json.dumps(row).encode())
    writer.finish()
    return stream.getvalue()


def _plain_rows(columns: Sequence[Written]) -> Iterable[dict[str, Any]]:
    names = [each.name for each in columns]
    for row in zip(*(each.values for each in columns), strict=True):
        values = (value.item() if hasattr(value, "item") else value for value in row)
        yield {n: None if isinstance(v, float) and not math.isfinite(v) else v for n, v in zip(names, values, strict=True)}


def _json_type(values: np.ndarray | Sequence[Any]) -> str:
    kind = np.asarray(values).dtype.kind
    return {"f": "number", "i": "integer", "u": "integer"}.get(kind, "string")
