"""Files of logs and of paths as other programs write them: the columns are those that were written, or the cause is said."""

import csv
import gzip
import io
import json
import math
import random
from datetime import UTC, datetime
from functools import cache

import numpy as np
import pytest
from noslip.identification.log import PoseLog, read_poses
from noslip.readers.errors import BadInput
from noslip.readers.tables import read_table
from noslip.tests import test_calibration as geometry

NAMES = ("t", "theta_r", "theta_l", "x_c", "y_c", "phi")
UNITS = ("s", "rad", "rad", "m", "m", "rad")
OTHER = {"s": ("ms", 1e3), "rad": ("deg", 180 / math.pi), "m": ("mm", 1e3)}
START = 1764230000.25  # s since 1970


def table(rows: int = 60) -> np.ndarray:
    """Times, angles and poses of a winding path, (rows, 6)."""
    log = geometry.log_of(*geometry.winding(rows), 1.0, 3)
    return np.column_stack([log.t[:rows], log.angles[:rows], log.pose[:rows]])


@cache
def plain() -> np.ndarray:
    return table()


def read(file, columns=(), mapped=()) -> PoseLog:
    return read_poses(read_table(file, columns), geometry.SYSTEM, NAMES[3:], dict(mapped))


def read_columns(log: PoseLog) -> np.ndarray:
    return np.column_stack([log.t - log.t[0], log.angles, log.pose])


# -- dialects at random ----------------------------------------------------------------------------------------------------

SEPARATORS = (",", ", ", ";", " ; ", "\t", "|", " ", "   ")
ENDS = ("\n", "\r\n", "\r", None)  # None: mixed
CODES = ("utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-32", "latin-1", "gz")
HEADERS = ("names", "comment", "percent", "brackets", "parentheses", "row of units", "suffix", "CASE", "columns", "numbers")
TIMES = ("s", "ms", "us", "epoch s", "epoch ms", "epoch us", "epoch ns", "date", "of day", "two columns")
TIME_NAMES = ("t", "time", "timestamp", "Time", "stamp", "time_stamp")
FORMS = ("separated",) * 5 + ("objects", "array of objects", "object of arrays", "rows", "pairs", "block of pairs", "equations")
EXTRAS = {"status": lambda k: "ok", "seq": str, "frame_id": lambda k: "base_link", "empty": lambda k: "", "flag": lambda k: "-"}


class Dialect:
    """A way to write a log, drawn at random: the content of the file, and the options with which it is read."""

    def __init__(self, seed: int):
        self.of = random.Random(seed)
        one = self.of.choice
        self.form, self.header, self.time, self.code = one(FORMS), one(HEADERS), one(TIMES), one(CODES)
        self.separator, self.end, self.quoted = one(SEPARATORS), one(ENDS), self.of.random() < 0.2
        self.decimals = one(("repr", ".9f", ".12e"))
        self.comma = self.separator.strip() != "," and self.of.random() < 0.4 and self.form == "separated"
        self.order = self.of.sample(range(6), 6) if self.of.random() < 0.5 else list(range(6))
        self.extras = self.of.sample(list(EXTRAS), self.of.choice((0, 0, 1, 3)))
        if self.separator.isspace() and self.separator != "\t" or self.form != "separated":
            self.extras = [name for name in self.extras if name not in ("empty", "flag")]
        self.trailing = self.of.random() < 0.15 and not (self.separator.isspace() and self.separator != "\t")
        self.noise = self.of.random() < 0.3  # comments, empty lines, a preamble
        self.columns: list[str] = []
        self.mapped: dict[str, str] = {}

    def __repr__(self) -> str:
        shown = "form header time code separator end quoted decimals comma order extras trailing noise"
        return ", ".join(f"{name}={getattr(self, name)!r}" for name in shown.split())

    def number(self, value: float, whole: bool = False) -> str:
        text = str(round(value)) if whole else repr(float(value)) if self.decimals == "repr" else format(value, self.decimals)
        return text.replace(".", ",") if self.comma else text

    def times(self, t: np.ndarray) -> dict[str, list[str]]:
        """The column of times, or the columns; of a resolution of 1 ms or better."""
        unit = self.time.split()[-1]
        if self.time == "two columns":
            whole = [math.floor(START + each) for each in t]
            return {
                "header.stamp.sec": [str(each) for each in whole],
                "header.stamp.nanosec": [str(round((START - k + each) * 1e9)) for k, each in zip(whole, t, strict=True)],
            }
        if self.time in ("date", "of day"):
            dates = [datetime.fromtimestamp(START + each, UTC) for each in t]
            form = "%Y-%m-%d %H:%M:%S.%f" if self.time == "date" else "%H:%M:%S.%f"
            return {"t": [each.strftime(form) for each in dates]}
        parts, epoch = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[unit], self.time.startswith("epoch")
        if unit == "s":
            start = START if epoch else 0.0
            return {"t": [format(start + each, ".6f").replace(".", "," if self.comma else ".") for each in t]}
        return {"t": [str(round(START * parts) * epoch + round(each * parts)) for each in t]}

    def written(self, data: np.ndarray) -> bytes:
        columns = {
            **self.times(data[:, 0]),
            **{name: [self.number(v) for v in data[:, k]] for k, name in enumerate(NAMES) if k},
        }
        names, stated = list(columns), dict(zip(NAMES, UNITS, strict=True))
        other = self.header in ("brackets", "parentheses", "row of units", "suffix")
        for k, name in enumerate(NAMES):
            if other and k and self.of.random() < 0.5:
                stated[name], factor = OTHER[UNITS[k]]
                columns[name] = [self.number(factor * v) for v in data[:, k]]
        stated["t"] = {"date": "", "of day": "", "two columns": ""}.get(self.time, self.time.split()[-1])
        called = {name: name for name in names}
        if "t" in called:
            called["t"] = self.of.choice(TIME_NAMES)
        if self.header == "CASE":
            called = {name: own if "." in name else own.upper() for name, own in called.items()}
        if self.time in ("ms", "us") and not other:  # nothing in the file says it
            self.mapped["t"] = f"{called['t']} [{stated['t']}]"
        names = [names[k] for k in self.order if k < len(names)] + names[6:]
        for name in self.extras:
            columns[name] = [EXTRAS[name](k) for k in range(len(data))]
            called[name], stated[name] = name, ""
            names.insert(self.of.randrange(len(names) + 1), name)
        heads = [called[name] for name in names]
        form = {"brackets": "{} [{}]", "parentheses": "{} ({})", "suffix": "{}_{}"}.get(self.header, "{}")
        heads = [form.format(called[n], stated[n]) if stated.get(n) else called[n] for n in names]
        rows = [[columns[name][k] for name in names] for k in range(len(data))]
        if self.form != "separated":
            for k, name in enumerate(names):
                if self.header == "row of units" and stated.get(name) and name not in self.mapped:
                    self.mapped[name] = f"{heads[k]} [{stated[name]}]"
            return self.encoded(self.structured(heads, rows))
        return self.encoded(self.separated(heads, [stated.get(n, "") for n in names], rows))

    def separated(self, heads, units, rows) -> list[str]:
        def line(cells) -> str:
            text = io.StringIO()
            mark = self.separator.strip(" ") or " "
            style = csv.QUOTE_ALL if self.quoted else csv.QUOTE_MINIMAL
            csv.writer(text, delimiter=mark, quoting=style, lineterminator="").writerow(cells)
            plain = text.getvalue() if mark != " " or self.quoted else None
            spaced = self.separator if plain is None or '"' not in plain else mark
            return (self.separator.join(cells) if plain is None else plain.replace(mark, spaced)) + mark * self.trailing

        dated = self.time == "date" and self.separator.strip(" ") == "" and not self.quoted
        if dated:  # a date with a space in it is two cells between spaces
            place = next(k for k, head in enumerate(heads) if head.lower().startswith(("t", "s")) and "-" in rows[0][k])
            rows = [[c.replace(" ", "T") if k == place else c for k, c in enumerate(row)] for row in rows]
        heads = [head.replace(" ", "") if self.separator.strip(" ") == "" and not self.quoted else head for head in heads]
        lines = [line(row) for row in rows]
        if self.noise:
            lines.insert(self.of.randrange(len(lines)), self.of.choice(("", "# a pause", "   ", "% mark 2")))
        if self.header == "comment":
            lines.insert(0, "#" + self.of.choice(("", " ")) + line(heads))
        elif self.header == "percent":
            lines.insert(0, "%" + line(heads))
        elif self.header == "row of units":
            lines[:0] = [line(heads), line([unit or "-" for unit in units])]
        elif self.header == "columns":
            self.columns = heads
        elif self.header == "numbers":
            wanted = {"t": [k for k, h in enumerate(heads) if h.lower().startswith(("time", "stamp")) or h == "t"]}
            wanted |= {name: [k for k, h in enumerate(heads) if h == name] for name in NAMES[1:]}
            unit = self.mapped.pop("t", "").partition(" ")[2]
            if not wanted["t"]:  # a pair of columns has no number
                self.columns = heads
            else:
                self.mapped = {name: str(k[0] + 1) for name, k in wanted.items()}
                self.mapped["t"] += f" {unit}" * bool(unit)
        else:
            lines.insert(0, line(heads))
        if self.noise:
            lines[:0] = self.of.choice(([], ["# of a robot", ""], ["Robot: seven", ""], ["", "", ""]))
        return lines

    def structured(self, heads, rows) -> list[str]:
        """The same as JSON or as names with values."""

        def value(text):
            try:
                return json.loads(text)
            except ValueError:
                return text

        records = [dict(zip(heads, row, strict=True)) for row in rows]
        plain = [{name: value(cell) for name, cell in record.items()} for record in records]
        if self.form == "objects":
            return [json.dumps(record) for record in plain]
        if self.form == "array of objects":
            return json.dumps(plain, indent=self.of.choice((None, 1))).split("\n")
        if self.form == "object of arrays":
            return [json.dumps({name: [record[name] for record in plain] for name in heads})]
        if self.form == "rows":
            self.columns = heads
            return [json.dumps(list(record.values())) for record in plain]
        mark = {"pairs": ": ", "block of pairs": ": ", "equations": "="}[self.form]
        between = "\n" if self.form == "block of pairs" else self.of.choice((", ", "  ", "\t", "; "))
        lines = [between.join(f'{n}{mark}{self.shown(c)}' for n, c in zip(heads, row, strict=True)) for row in rows]
        return ("\n---\n" if self.form == "block of pairs" else "\n").join(lines).split("\n")

    @staticmethod
    def shown(cell: str) -> str:
        return f'"{cell}"' if " " in cell or ":" in cell else cell

    def encoded(self, lines: list[str]) -> bytes:
        text = "".join(line + (self.end or self.of.choice(ENDS[:3])) for line in lines)
        if self.code == "gz":
            return gzip.compress(text.encode())
        return text.encode(self.code)


def compared(seed: int, folder) -> str | None:
    """Write a log in a dialect, and read it: None if it is as it was, else what was said; fails if it is another one."""
    dialect, data = Dialect(seed), plain()[: 12 + seed % 40]
    file = folder / f"{seed}.log"
    file.write_bytes(dialect.written(data))
    try:
        read_back = read_columns(read(file, dialect.columns, dialect.mapped))
    except BadInput as error:
        assert str(file) in str(error) and "\n" not in str(error) and len(str(error)) < 700, dialect
        return f"{seed} {dialect}: {error}"
    expected = data - np.where(np.arange(6) == 0, data[0], 0.0)
    assert read_back.shape == expected.shape, (seed, dialect)
    assert np.abs(read_back - expected).max() < 2e-6, (seed, dialect)
    file.unlink()
    return None


def test_a_log_is_the_same_in_any_dialect(tmp_path):
    refused = [said for seed in range(150) if (said := compared(seed, tmp_path))]
    assert not refused, refused[0]


@pytest.mark.nightly
def test_a_log_is_the_same_in_many_dialects(tmp_path):
    refused = [said for seed in range(1000, 21000) if (said := compared(seed, tmp_path))]
    assert not refused, (len(refused), refused[0])
