"""Tables in text files, in whatever form a program has written them: with any separator, line ends, header
and encoding, decimal commas, as JSON, or as lines of `name: value`.
"""

import codecs
import csv
import gzip
import io
import json
import re
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

from .errors import BadInput, naming
from .quantities import is_unit

SAMPLE = 200  # rows by which separator and header are recognized
# The space stands for any white space; of those that divide the sample equally well, the first
SEPARATORS = ";\t|, "
COMMENT = ("#", "%", "//")
BOMS = (  # the longer first: that of UTF-16 is the beginning of that of UTF-32
    (codecs.BOM_UTF8, "utf-8-sig"),
    *((mark, "utf-32") for mark in (codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE)),
    *((mark, "utf-16") for mark in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)),
)
NUMBER = re.compile(r"[-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][-+]?\d+)?|[-+]?(?:nan|inf|infinity)", re.IGNORECASE)
DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?")
THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(?:,\d{3})+")  # may also be a number with a decimal comma
PAIR = re.compile(
    r"""\s*["']?([A-Za-z_%/][^:=,;"'\t]*?)["']?\s*[:=]\s*([-+.\w]+|"[^"]*"|'[^']*')\s*(?:[,;]|(?=\s)|$)"""
)
END_OF_RECORD = ("", "---", "...")


@dataclass
class TextTable:
    """Rows of cells; `lines` are their numbers in the file, from 1. `names` of the columns and their `units`,
    as far as the file has them; `names` is None for a table without a header. `remarks` say what of the file
    was left out.
    """

    rows: list[list[Any]]
    lines: list[int]
    names: list[str] | None = None
    units: list[str | None] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)


def text_table(
    data: bytes, file: str, most: int, columns: Sequence[str] = (), incomplete: bool = False
) -> TextTable:
    """Return the table in the content of a file. `most`: largest number of MB of compressed content;
    `columns`: names that replace its header; `incomplete`: cells at the end of a row may be missing.

    Raises BadInput, naming file and row, if it is not a text, has no rows or rows of different lengths.
    """
    text = _decoded(data, file, most)
    lines = text.split("\n")
    if not text.strip():
        raise BadInput(f"{file} is empty")
    if text.lstrip()[0] in "[{":
        table = _json(text, lines, file)
    elif _has_pairs(lines):
        table = _pairs(lines, file)
    elif "---" in lines:
        export = "export them as CSV, `rostopic echo -p` or `ros2 topic echo --csv`"
        raise BadInput(f"{file}: messages as `rostopic echo` prints them; {export}")
    else:
        table = _separated(lines, file)
    if not table.rows:
        raise BadInput(f"{file} has a header but no rows")
    header = table.names
    if columns:
        table.names, table.units = list(columns), []
    filled = max(
        k + 1 for row in table.rows for k, cell in enumerate(row or [""]) if cell not in (None, "") or k == 0
    )
    width = (
        len(table.names) if table.names else min(filled, Counter(map(len, table.rows)).most_common(1)[0][0])
    )
    for line, row in zip(table.lines, table.rows, strict=True):
        if row == header:
            raise BadInput(f"{file} row {line} repeats the header: two tables in one file; split it there")
        while len(row) > width and row[-1] in (None, ""):
            row.pop()
        if incomplete:
            row += [""] * (width - len(row))
        if len(row) != width:
            other = (
                f"{'--columns' if columns else 'the header'} names {width} columns"
                if table.names
                else f"most rows have {width}"
            )
            raise BadInput(f"{file} row {line}: {len(row)} entries, but {other}; complete or delete this row")
    return table


def _decoded(data: bytes, file: str, most: int) -> str:
    """Return the text, each line ended by a line feed."""
    if data.startswith(b"\x1f\x8b"):
        with (
            naming(
                f"{file}: its gzip compression is damaged",
                (OSError, EOFError, zlib.error),
                "compress it anew",
            ),
            gzip.open(io.BytesIO(data)) as stream,
        ):
            data = stream.read((most << 20) + 1)
        if len(data) > most << 20:
            raise BadInput(f"{file} has more than {most} MB of text, the limit for such a file")
    encoding = next((name for mark, name in BOMS if data.startswith(mark)), "")
    if not encoding and 0 in data[:2] and data[:2] != b"\0\0":
        encoding = "utf-16-le" if data[1] == 0 else "utf-16-be"
    try:
        text = data.decode(encoding or "utf-8")
    except UnicodeDecodeError as error:
        if encoding:
            raise BadInput(
                f"{file}: not a text file in {encoding.upper()} (byte {error.start}); save it as UTF-8"
            ) from error
        # Headers by older programs, such as "phi [°]"; numbers are the same in any encoding
        text = data.decode("latin-1")
    text = text.lstrip("\ufeff").rstrip("\0\x1a").replace("\r\n", "\n").replace("\r", "\n")
    if strange := re.search(r"[\0-\x08\x0e-\x1f\x7f]", text):
        line = text.count("\n", 0, strange.start()) + 1
        raise BadInput(
            f"{file}: not a text file (byte {ord(strange[0])} in line {line}); logs are CSV, .parquet or "
            ".mcap"
        )
    return text


def is_number(cell: str) -> bool:
    """Return whether a cell is a number, perhaps with a decimal comma."""
    return NUMBER.fullmatch(cell) is not None


# -- separated cells -----------------------------------------------------------------------------------------


def _separated(lines: Sequence[str], file: str) -> TextTable:
    """Read a table whose header, if there is one, is the last line before the first row of numbers, or the
    last comment there. What precedes it is left out, with a remark.
    """
    written = [
        (k, line) for k, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith(COMMENT)
    ]
    sample = [line for _, line in written[:SAMPLE]]
    separator = max(SEPARATORS, key=lambda mark: _share_of_numbers(sample, mark))
    numbered = list(_cells(lines, separator, file))
    rows = [row for _, row in numbered]
    width, first = _first_of_numbers(rows)
    used = max((k + 1 for row in rows[first:] for k, cell in enumerate(row) if cell), default=0)
    # Cells at the end that are empty in all rows may have no name
    widths = range(min(used, width), width + 1)
    table = TextTable(rows[first:], [k for k, _ in numbered[first:]])
    before = numbered[:first]
    if len(before) > 1 and _are_units(before[-1][1], before[-2][1]):
        table.units = _units(before.pop()[1])
    if before:
        line = lines[before[-1][0] - 1]
        names = _names(line, separator, widths, file)
        # Words are no header of another width
        if len(names) in widths or len(names) > 1 and separator != " ":
            table.names = names
            before.pop()
    start = table.lines[0] if table.lines else len(lines) + 1
    comments = [line.strip() for line in lines[: start - 1] if line.lstrip().startswith(COMMENT)]
    heads = [_names(comment.lstrip("#%/ \t"), separator, widths, file) for comment in comments]
    heads = [names for names in heads if len(names) in widths and not any(map(is_number, names))]
    if table.names is None and len(heads) > 1 and _are_units(heads[-1], heads[-2]):
        table.units = _units(heads.pop())
    if table.names is None and heads:
        table.names = heads[-1]
    if before:
        last = " ".join(before[-1][1])[:40]
        table.remarks.append(
            f"left out before the header: {len(before)} line{'s' * (len(before) > 1)}, the last {last!r}"
        )
    if separator != "," or any('"' in line for line in lines):
        _point_decimals(table)
    return table


def _cells(lines: Sequence[str], separator: str, file: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the number and the cells of each line that is neither empty nor a comment."""
    texts = ("" if line.lstrip().startswith(COMMENT) else line for line in lines)
    if separator == " ":
        texts = (" ".join(line.split()) for line in texts)
    reader = csv.reader((f"{text}\n" for text in texts), delimiter=separator, skipinitialspace=True)
    last = 0
    try:
        for row in reader:
            begun, last = last + 1, reader.line_num
            if last > begun:
                raise BadInput(
                    f"{file} row {begun}: a quotation mark is not closed in this line; remove or close it"
                )
            cells = [cell.strip() for cell in row]
            if any(cells):
                yield last, cells
    except csv.Error as error:
        raise BadInput(f"{file} row {last + 1}: {error}; write one entry between two separators") from error


def _share_of_numbers(sample: Sequence[str], separator: str) -> float:
    """Return which share of the cells are numbers if this separates them, less where rows have different
    numbers of cells, and a little more; 0 if nothing is separated.
    """
    try:
        rows = [row for _, row in _cells(sample, separator, "")]
    except BadInput:
        return 0.0
    width, alike = Counter(map(len, rows)).most_common(1)[0] if rows else (0, 0)
    cells = [cell for row in rows for cell in row if cell]
    return (
        (sum(map(is_number, cells)) / len(cells) + 0.01) * alike / len(rows) if width > 1 and cells else 0.0
    )


def _first_of_numbers(rows: Sequence[Sequence[str]]) -> tuple[int, int]:
    """Return the usual number of cells, and the index of the first row with numbers in columns where the rows
    have numbers; if no column has, that of the second row.
    """
    sample = rows[-SAMPLE:]
    width = Counter(map(len, sample)).most_common(1)[0][0] if sample else 0
    numbers = Counter(k for row in sample for k, cell in enumerate(row) if is_number(cell))
    # a header and its units may be among few rows
    usual = [k for k in numbers if 2 * numbers[k] > len(sample) - 2]
    for first, row in enumerate(rows):
        cells = [row[k] for k in usual if k < len(row) and row[k]]
        of_pandas = ["", *map(str, range(len(row) - 1))]  # its header of an array without names
        if 2 * sum(map(is_number, cells)) > len(cells) and row != of_pandas:
            return width, first
    return width, min(1, len(rows))


def _names(line: str, separator: str, widths: range, file: str) -> list[str]:
    """Return the names in a header, one of `widths` if it can be,
    by another separator than that of the rows."""
    ways = [next(iter(_cells([line], mark, file)), (0, []))[1] for mark in (separator, *SEPARATORS)]
    for names in ways:
        while names and not names[-1]:
            names.pop()
    # Names divided by commas and spaces have no commas
    fitting = [names for names in ways if len(names) in widths]
    return next((names for names in fitting if not any(n[-1:] in tuple(SEPARATORS) for n in names)), ways[0])


def _units(cells: Sequence[str]) -> list[str | None]:
    return [cell.strip("[]()- ") or None for cell in cells]


def _are_units(cells: Sequence[str], names: Sequence[str]) -> bool:
    units = list(filter(None, _units(cells)))
    return len(cells) <= len(names) and bool(units) and all(map(is_unit, units))


def _point_decimals(table: TextTable) -> None:
    """Replace decimal commas, unless numbers with a point show that commas are not decimal, or all may be
    those of thousands.
    """
    cells = [cell for row in table.rows for cell in row if "," in cell and DECIMAL_COMMA.fullmatch(cell)]
    if all(map(THOUSANDS.fullmatch, cells)) or any(
        "." in cell and is_number(cell) for row in table.rows for cell in row
    ):
        return
    table.rows = [
        [c.replace(",", ".") if DECIMAL_COMMA.fullmatch(c) else c for c in row] for row in table.rows
    ]


# -- JSON ----------------------------------------------------------------------------------------------------


def _json(text: str, lines: Sequence[str], file: str) -> TextTable:
    """Read a list of objects or of rows, an object or a row in each line, or an object of columns."""
    try:
        whole = json.loads(text)
        number = [1] * len(whole) if len(lines) == 1 else list(range(1, len(whole) + 1))
    except (ValueError, RecursionError) as problem:
        whole, number = [], []
        for k, line in enumerate(lines, 1):
            try:
                if line.strip():
                    whole.append(json.loads(line))
                    number.append(k)
            except (ValueError, RecursionError) as error:
                where = f"row {k}: {error}" if whole else str(problem)
                raise BadInput(
                    f"{file}: not JSON, {where}; write an object or a list of numbers in each line"
                ) from error
    if isinstance(whole, dict) and whole and all(isinstance(each, list) for each in whole.values()):
        if len({len(each) for each in whole.values()}) > 1:
            sizes = ", ".join(f"{name} {len(each)}" for name, each in whole.items())
            raise BadInput(f"{file}: its columns have different numbers of entries: {sizes}")
        rows = [list(row) for row in zip(*whole.values(), strict=True)]
        return TextTable(rows, list(range(1, len(rows) + 1)), list(whole))
    if isinstance(whole, dict):
        lists = [
            each for each in whole.values() if isinstance(each, list) and each and isinstance(each[0], dict)
        ]
        whole = lists[0] if len(lists) == 1 else [whole]
        number = list(range(1, len(whole) + 1))
    if all(isinstance(each, dict) for each in whole):
        records = [dict(entries_of(each)) for each in whole]
        return _of_records(records, number)
    if not all(isinstance(each, list) for each in whole):
        raise BadInput(f"{file}: JSON, but not a table; write a list of objects, or an object in each line")
    named = bool(whole and whole[0]) and all(
        isinstance(each, str) and not is_number(each) for each in whole[0]
    )
    return TextTable(whole[named:], number[named:], whole[0] if named else None)


def entries_of(message: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the entries of nested objects and lists by their path: pose.x, rates.0."""
    if isinstance(message, dict | list):
        for key, value in message.items() if isinstance(message, dict) else enumerate(message):
            yield from entries_of(value, f"{path}.{key}" if path else str(key))
    else:
        yield path, message


def _of_records(records: Sequence[dict[str, Any]], lines: list[int]) -> TextTable:
    names = list(dict.fromkeys(name for record in records for name in record))
    return TextTable([[record.get(name) for name in names] for record in records], lines, names)


# -- name: value ---------------------------------------------------------------------------------------------


def _has_pairs(lines: Sequence[str]) -> bool:
    """Return whether the first lines consist of `name: value`, and some of the values are numbers."""
    sample = list(
        islice((line for line in lines if line.strip() not in END_OF_RECORD and line.strip()[0] != "#"), 20)
    )
    pairs = [pair for line in sample for pair in PAIR.findall(line)]
    return (
        bool(sample)
        and not any(PAIR.sub("", line).strip() for line in sample)
        and any(is_number(v) for _, v in pairs)
    )


def _pairs(lines: Sequence[str], file: str) -> TextTable:
    """Read a record in each line with several pairs; pairs in lines of their own belong to one record up to
    an empty line, a line of dashes, or a name that it has.
    """
    records: list[dict[str, Any]] = []
    numbers: list[int] = []
    begin = True
    for k, line in enumerate(lines, 1):
        if line.strip() in END_OF_RECORD or line.lstrip().startswith("#"):
            begin = True
            continue
        pairs = PAIR.findall(line)
        if PAIR.sub("", line).strip() or not pairs:
            raise BadInput(
                f"{file} row {k}: {line.strip()[:40]!r} is not `name: value`; write a number behind each name"
            )
        if begin or len(pairs) > 1 or pairs[0][0] in records[-1]:
            records.append({})
            numbers.append(k)
        for name, value in pairs:
            if name in records[-1]:
                raise BadInput(f"{file} row {k}: {name!r} occurs twice in it; write each name once")
            records[-1][name] = value.strip("\"'")
        begin = False
    return _of_records(records, numbers)
