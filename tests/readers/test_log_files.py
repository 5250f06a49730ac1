"""Files of logs and of paths as other programs write them: the columns are those that were written,
or the cause is said."""

import csv
import gzip
import io
import json
import math
import random
import re
from datetime import UTC, datetime
from functools import cache

import numpy as np
import pytest
from noslip.analysis.identification.log import PoseLog, read_log, read_poses
from noslip.cli.main import main
from noslip.readers import tables, text_tables, times
from noslip.readers.errors import BadInput
from noslip.readers.quantities import in_base_units
from noslip.readers.tables import read_table
from noslip.tests.analysis import test_calibration as geometry
from noslip.tests.analysis import test_identification as dynamics
from scipy.spatial.transform import Rotation

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


# -- dialects at random --------------------------------------------------------------------------------------

SEPARATORS = (",", ", ", ";", " ; ", "\t", "|", " ", "   ")
ENDS = ("\n", "\r\n", "\r", None)  # None: mixed
CODES = ("utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-32", "latin-1", "gz")
HEADERS = (
    "names",
    "comment",
    "percent",
    "brackets",
    "parentheses",
    "row of units",
    "suffix",
    "CASE",
    "columns",
    "numbers",
)
TIMES = ("s", "ms", "us", "epoch s", "epoch ms", "epoch us", "epoch ns", "date", "of day", "two columns")
TIME_NAMES = ("t", "time", "timestamp", "Time", "stamp", "time_stamp")
FORMS = ("separated",) * 5 + (
    "objects",
    "array of objects",
    "object of arrays",
    "rows",
    "pairs",
    "block of pairs",
    "equations",
)
EXTRAS = {
    "status": lambda k: "ok",
    "seq": str,
    "frame_id": lambda k: "base_link",
    "empty": lambda k: "",
    "flag": lambda k: "-",
}


class Dialect:
    """A way to write a log, drawn at random: the content of the file,
    and the options with which it is read."""

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
        text = (
            str(round(value))
            if whole
            else repr(float(value))
            if self.decimals == "repr"
            else format(value, self.decimals)
        )
        return text.replace(".", ",") if self.comma else text

    def times(self, t: np.ndarray) -> dict[str, list[str]]:
        """The column of times, or the columns; of a resolution of 1 ms or better."""
        unit = self.time.split()[-1]
        if self.time == "two columns":
            whole = [math.floor(START + each) for each in t]
            return {
                "header.stamp.sec": [str(each) for each in whole],
                "header.stamp.nanosec": [
                    str(round((START - k + each) * 1e9)) for k, each in zip(whole, t, strict=True)
                ],
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
            return (
                self.separator.join(cells) if plain is None else plain.replace(mark, spaced)
            ) + mark * self.trailing

        dated = self.time == "date" and self.separator.strip(" ") == "" and not self.quoted
        if dated:  # a date with a space in it is two cells between spaces
            place = next(
                k for k, head in enumerate(heads) if head.lower().startswith(("t", "s")) and "-" in rows[0][k]
            )
            rows = [[c.replace(" ", "T") if k == place else c for k, c in enumerate(row)] for row in rows]
        heads = [
            head.replace(" ", "") if self.separator.strip(" ") == "" and not self.quoted else head
            for head in heads
        ]
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
            wanted = {
                "t": [k for k, h in enumerate(heads) if h.lower().startswith(("time", "stamp")) or h == "t"]
            }
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
        lines = [
            between.join(f"{n}{mark}{self.shown(c)}" for n, c in zip(heads, row, strict=True)) for row in rows
        ]
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
    """Write a log in a dialect, and read it: None if it is as it was, else what was said;
    fails if it is another one."""
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
    assert np.abs(read_back - expected).max() < 3e-6, (seed, dialect)
    file.unlink()
    return None


def test_a_log_is_the_same_in_any_dialect(tmp_path):
    refused = [said for seed in range(60) if (said := compared(seed, tmp_path))]
    assert not refused, refused[0]


@pytest.mark.parametrize(
    ("module", "name", "planted"),
    [
        (tables, "scaled_units", lambda text: (1.0, in_base_units(text.split("/")[0])[1])),
        (times, "EPOCH", (0.0, 1.0)),
        (text_tables, "DECIMAL_COMMA", re.compile(r"[-+]?\d*,\d*")),
    ],
)
def test_a_planted_defect_is_found(module, name, planted, monkeypatch, tmp_path):
    """Units that are not converted, times since 1970 that are not seen,
    decimals in exponents that are not read."""
    monkeypatch.setattr(module, name, planted)
    with pytest.raises(AssertionError):
        refused = [said for seed in range(60) if (said := compared(seed, tmp_path))]
        assert not refused


@pytest.mark.nightly
def test_a_log_is_the_same_in_many_dialects(tmp_path):
    refused = [said for seed in range(1000, 21000) if (said := compared(seed, tmp_path))]
    assert not refused, (len(refused), refused[0])


# -- what is refused, and what is said -----------------------------------------------------------------------

HEAD = ",".join(NAMES)


def body(rows=None, separator=",", number=repr) -> list[str]:
    return [
        separator.join(number(float(value)) for value in row) for row in (plain() if rows is None else rows)
    ]


def lines(*before, rows=None, **form) -> bytes:
    return "\n".join([*before, *body(rows, **form)]).encode()


def changed(column: int, factor: float) -> np.ndarray:
    data = plain().copy()
    data[:, column] *= factor
    return data


def late(seconds: float) -> bytes:
    """Times since 1970, set back in the middle."""
    data = plain().copy()
    data[:, 0] += START - seconds * (np.arange(len(data)) >= 30)
    return lines(HEAD, rows=data, number=lambda v: f"{v:.3f}")


def blunt(data: np.ndarray) -> np.ndarray:
    """Times with one digit."""
    return np.column_stack([np.round(data[:, 0], 1), data[:, 1:]])


REFUSED = {  # content, what is said
    "empty": (b"", "is empty"),
    "blank": (b" \n\r\n\t\n", "is empty"),
    "header only": (f"{HEAD}\n".encode(), "has a header but no rows"),
    "one row": (lines(HEAD, rows=plain()[:1]), "1 usable rows are too few"),
    "no header": (lines(), "has no header: its first row is 0.0, 0.0, 0.0, 1.28"),
    "no header, what to do": (
        lines(),
        "name its 6 columns in order, --columns t,..., with - for one that is not used",
    ),
    "JSON without names": (json.dumps(plain().tolist()).encode(), "has no header"),
    "no angles": (
        lines("t,v,omega,x_c,y_c,phi"),
        "there are t, v, omega, x_c, y_c, phi; name angles with --map NAME=COLUMN",
    ),
    "speeds": (lines("t,v,omega,x_c,y_c,phi"), "rates, or speeds of the vehicle, do not tell its geometry"),
    "distances": (lines("t,theta_r [m],theta_l [m],x_c,y_c,phi"), "--map 'NAME=COLUMN [rad/0.15]'"),
    "two times": (
        lines("time,timestamp,theta_l,x_c,y_c,theta_r"),
        "t may be time or timestamp; choose one, --map t=time",
    ),
    "two headings": (lines("t,theta_r,theta_l,x_c,phi,phi"), "two columns are called 'phi'"),
    "another name": (
        lines("t,theta_r,theta_l,x,y,phi"),
        "column 'x_c' is missing; there are t, theta_r, theta_l, x, y, phi",
    ),
    "twist": (
        lines("t,theta_r,theta_l,linear.x,angular.z,phi"),
        "speeds of the vehicle, linear.x, angular.z, are not those of",
    ),
    "cut off": (lines(HEAD)[:-70], "row 61: "),
    "long row": (
        lines(HEAD) + b",1,2",
        "row 61: 8 entries, but the header names 6 columns; complete or delete this row",
    ),
    "text": (
        lines(HEAD, rows=plain()[:5]) + b"\n1,2,3,4,five,6",
        "column 'y_c' row 7: 'five' is not a number",
    ),
    "underscore": (
        lines(HEAD, rows=plain()[:5]) + b"\n1_0,2,3,4,5,6",
        "column 't' row 7: '1_0' is not a number",
    ),
    "twice": (lines(HEAD) + b"\n" + lines(HEAD), "row 62 repeats the header"),
    "quote": (lines(HEAD) + b'\n"1,2,3,4,5,6\n1,2,3,4,5,6', "row 62: a quotation mark is not closed"),
    "long entry": (lines(HEAD) + b"\n1,2,3,4,5," + b"9" * 140_000, "row 62: field larger than field limit"),
    "zeros": (lines(HEAD) + b"\n\0\0\0\n" + lines(), "not a text file (byte 0 in line 62)"),
    "bytes": (bytes(range(1, 256)), "not a text file"),
    "UTF-16 cut off": (lines(HEAD).decode().encode("utf-16")[:-1], "not a text file in UTF-16"),
    "gzip cut off": (gzip.compress(lines(HEAD))[:-9], "its gzip compression is damaged"),
    "workbook": (b"PK\x03\x04" + bytes(30), "a workbook or an archive; export the sheet as CSV"),
    "bag": (b"SQLite format 3\0", "cannot be read as a bag: Unrecognized storage format '.csv'"),
    "unit": (lines("t,theta_r [foo],theta_l,x_c,y_c,phi"), "column 'theta_r': unknown unit 'foo'"),
    "kind": (lines("t,theta_r [kg],theta_l,x_c,y_c,phi"), "[kg] is not a unit of a quantity in rad"),
    "counts": (
        lines(HEAD, rows=np.round(plain() * [1, 1e4, 1e4, 1, 1, 1])),
        "say --map 'theta_r=theta_r [turn/COUNTS]' --map",
    ),
    "clock set back": (late(0.6), "row 32: t goes from 1764230001.700 s to 1764230001.150 s, but times must"),
    "few digits": (
        lines(HEAD, rows=blunt(plain())),
        "row 3: t goes from 0.000000000 s to 0.000000000 s, but times",
    ),
    "thousands": (
        b"t;theta_r;theta_l;x_c;y_c;phi\n" + b"1,000;2,000;3,000;1,500;1,500;2,500\n" * 9,
        "00' is not a number; ",
    ),
    "broken JSON": (b'{"t": 0.0}\n{"t": 0.1\n', "not JSON, row 2: "),
    "words in JSON": (b'["a", ["b"]]', "JSON, but not a table"),
    "true in JSON": (
        json.dumps({**dict.fromkeys(NAMES, [True] * 9), "t": [*range(9)]}).encode(),
        "'True' is not a number",
    ),
    "unequal JSON": (b'{"t": [0, 1], "phi": [0]}', "different numbers of entries: t 2, phi 1"),
    "deep JSON": (b"[" * 200_000, "not JSON"),
    "pair without value": (b"t: 0.0\nphi: 1.0\n" * 12 + b"phi\n", "row 25: 'phi' is not `name: value`"),
    "pair twice": (b"t: 0.0, t: 0.1\n" * 9, "row 1: 't' occurs twice"),
    "messages": (b"header:\n  seq: 1\npose: [1, 2]\n---\n" * 9, "messages as `rostopic echo` prints them"),
    "page": (b"<html><body>404, not here</body></html>", "has a header but no rows"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_refused_names_file_place_and_remedy(case, bad_input, tmp_path):
    content, message = REFUSED[case]
    (tmp_path / "log.csv").write_bytes(content)
    said = bad_input(["calibrate", str(tmp_path / "log.csv"), "--robot", "labmate", "--fit", "r", "b"])
    assert message in said and str(tmp_path / "log.csv") in said and said.count("\n") == 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--columns", "t,theta_r"], "row 1: 6 entries, but --columns names 2 columns"),
        (["--map", "theta_r=7"], "has no header"),
        (["--columns", HEAD, "--map", "phi=heading"], "column 'heading' is missing; there are t, theta_r"),
        (["--columns", HEAD, "--map", "phi=phi [turn/0]"], "has a factor of 0"),
    ],
)
def test_options_that_are_refused(options, message, bad_input, tmp_path):
    (tmp_path / "log.csv").write_bytes(lines())
    assert message in bad_input(["calibrate", str(tmp_path / "log.csv"), "--robot", "labmate", *options])


def test_bytes_at_random_end_in_one_line(tmp_path):
    """Good files with bytes changed, cut and repeated: numbers or BadInput, no other exception."""
    random_bytes, file = random.Random(5), tmp_path / "log.csv"
    for seed in range(120):
        data = bytearray(Dialect(seed).written(plain()[:12]))
        for _ in range(random_bytes.choice((1, 3, 40))):
            k = random_bytes.randrange(len(data))
            other = random_bytes.choice((b"", b"\0", b'"', b"\xff", b",", b"\n", b"{", b"nan"))
            data[k : k + random_bytes.choice((0, 1, 30))] = other
        file.write_bytes(data)
        try:
            read(file)
        except BadInput as error:
            assert "\n" not in str(error)


def test_distances_and_counts_are_angles_by_a_unit_with_a_factor(tmp_path):
    """The radius that is stated cancels: distances of wheels with 0.15 m; counts of 4096 to a turn."""
    data = plain()
    for factor, unit in (
        (0.15, "rad/0.15"),
        (4096 / (2 * math.pi), "turn/4096"),
        (10 * 180 / math.pi, "0.1 deg"),
        (-1.0, None),
    ):
        rows = data.copy()
        rows[:, 1:3] *= factor
        (tmp_path / "log.csv").write_bytes(lines("t,right,left,x_c,y_c,phi", rows=rows))
        names = {"theta_r": "right", "theta_l": "left"}
        mapped = {name: f"{column} [{unit}]" if unit else f"-{column}" for name, column in names.items()}
        assert read_columns(read(tmp_path / "log.csv", (), mapped)) == pytest.approx(data, abs=1e-9)


def test_distances_taken_for_angles_are_noticed(bad_input, tmp_path):
    """By the motion, in a short log too."""
    message = "the floor, of wheels with a radius of 0.15 m"
    for count in (200, 60):
        rows = table(count)
        rows[:, 1:3] *= geometry.TRUE["r"]
        (tmp_path / "log.csv").write_bytes(lines(HEAD, rows=rows))
        said = bad_input(["calibrate", str(tmp_path / "log.csv"), "--robot", "labmate", "--fit", "r"])
        assert message in said and "--map 'theta_r=theta_r [rad/0.15]'" in said


def test_what_was_not_used_or_assumed_is_noted(tmp_path):
    file = tmp_path / "log.csv"
    file.write_bytes(lines(f"{HEAD},torque [N m]", rows=np.column_stack([plain(), plain()[:, 0]])))
    assert read(file).remarks == ("not used: column torque",)
    rows = plain().copy()
    rows[:, 0] = np.round((rows[:, 0] + START) * 1000)
    file.write_bytes(lines("a log of Monday", f"timestamp{HEAD[1:]}", rows=rows))
    said = "; ".join(read(file).remarks)
    assert (
        "left out before the header: 1 line, the last 'a log of Monday'" in said and "ms since 1970" in said
    )


def test_names_that_only_look_like_units_or_numbers(tmp_path):
    """position[0] is a name, (raw) no unit, the header of an array by pandas no row."""
    (tmp_path / "a.csv").write_bytes(lines("t,position[0],position[1],x_c (raw),y_c,phi"))
    mapped = {"theta_r": "position[0]", "theta_l": "position[1]", "x_c": "x_c (raw)"}
    assert read_columns(read(tmp_path / "a.csv", (), mapped)) == pytest.approx(plain())
    rows = np.column_stack([np.arange(len(plain())), plain()])
    (tmp_path / "b.csv").write_bytes(lines(",0,1,2,3,4,5", rows=rows))
    mapped = {name: str(k) for k, name in enumerate(NAMES)}
    assert read_columns(read(tmp_path / "b.csv", (), mapped)) == pytest.approx(plain())


@pytest.mark.parametrize(
    ("names", "mapped"),
    [
        (("sec", "nanosec"), {}),
        (("header.stamp.secs", "header.stamp.nsecs"), {}),
        (("timestamp", "stamp.sec", "stamp.nanosec"), {"t": "stamp.sec"}),
        (("__time",), {}),
        (("%time",), {"t": "%time"}),
        (("# t",), {}),
    ],
)
def test_times_by_other_names(names, mapped, tmp_path):
    times = {
        "sec": [math.floor(t) for t in plain()[:, 0] + START],
        "nano": [round((t + START) % 1 * 1e9) for t in plain()[:, 0]],
    }
    columns = [
        times["nano" if "n" in n[-7:-3] else "sec"] if n.endswith(("sec", "secs")) else plain()[:, 0]
        for n in names
    ]
    rows = [
        [*map(str, cells), *map(str, row[1:])]
        for cells, row in zip(zip(*columns, strict=True), plain(), strict=True)
    ]
    text = "\n".join([",".join(names) + HEAD[1:], *(",".join(row) for row in rows)])
    (tmp_path / "log.csv").write_text(text)
    assert read_columns(read(tmp_path / "log.csv", (), mapped)) == pytest.approx(plain(), abs=1e-6)


@pytest.mark.parametrize("stem", ["field.pose.pose.orientation.", "q", "/odom/orientation/", "rot_"])
def test_columns_of_a_quaternion_are_a_heading(stem, tmp_path, bad_input):
    """Also of one that is tilted a little, its negative, and one that is zero, which is none;
    they are no speeds."""
    turns = Rotation.from_euler(
        "ZYX", np.column_stack([plain()[:, -1], np.full((len(plain()), 2), 0.01)])
    ).as_quat()
    turns[::2] *= -1
    turns[3] = 0
    rows = np.column_stack([plain()[:, :-1], turns])
    head = ",".join([*NAMES[:-1], *(f"{stem}{part}" for part in "xyzw")])
    (tmp_path / "log.csv").write_bytes(lines(head, rows=rows))
    log = read(tmp_path / "log.csv", (), {"phi": stem.rstrip("._/")})
    right = plain()[:, -1].copy()
    right[3] = math.nan
    found = read_columns(log)
    assert np.remainder(found[:, -1] - right + 1, 2 * math.pi) - 1 == pytest.approx(
        0 * right, abs=1e-12, nan_ok=True
    )
    assert not any("not used" in remark for remark in log.remarks)
    other = read_columns(read(tmp_path / "log.csv", (), {"phi": f"-{stem.rstrip('._/')}"}))
    assert np.remainder(other[:, -1] + right + 1, 2 * math.pi) - 1 == pytest.approx(
        0 * right, abs=1e-12, nan_ok=True
    )
    said = bad_input(["calibrate", str(tmp_path / "log.csv"), "--robot", "labmate", "--map", "phi=heading"])
    assert "speeds" not in said and "column 'heading' is missing" in said
    with pytest.raises(BadInput, match=r"the yaw of a quaternion is in rad; leave out \[deg\]"):
        read(tmp_path / "log.csv", (), {"phi": f"{stem.rstrip('._/')} [deg]"})
    in_rad = read(tmp_path / "log.csv", (), {"phi": f"{stem.rstrip('._/')} [rad]"})
    assert np.array_equal(read_columns(in_rad), found, equal_nan=True)


def test_a_log_every_ten_seconds_is_none_of_the_dynamics(bad_input, tmp_path):
    rows = np.column_stack([10.0 * np.arange(40), *np.random.default_rng(1).normal(size=(4, 40))])
    (tmp_path / "log.csv").write_bytes(lines("t,thetadot_r,thetadot_l,tau_r,tau_l", rows=rows))
    said = bad_input(["identify", str(tmp_path / "log.csv"), "--robot", "labmate", "--fit", "m_c"])
    assert "t goes on by 10 s from row to row; if it is in ms" in said and "--map 't=t [ms]'" in said


def test_parquet_of_dates_and_structs(tmp_path):
    pa = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    data = plain()
    stamps = [round(START * 1e9) + round(each * 1e9) + 1 for each in data[:, 0]]  # no whole microseconds
    columns = {
        "timestamp": pa.array(stamps, pa.timestamp("ns")),
        "wheel": pa.array([{"r": a, "l": b} for a, b in data[:, 1:3]]),
    }
    columns |= {name: data[:, k] for k, name in enumerate(NAMES) if k > 2}
    parquet.write_table(pa.table(columns), tmp_path / "log")  # no suffix: the content tells
    log = read(tmp_path / "log", (), {"theta_r": "wheel.r", "theta_l": "wheel.l"})
    # Times of an epoch are doubles with steps of 2.4e-7 s
    assert read_columns(log) == pytest.approx(data, abs=3e-6)


# -- topics --------------------------------------------------------------------------------------------------


def bag(file, messages) -> str:
    """Write an MCAP file of (topic, time of the log in s, message)."""
    writing = pytest.importorskip("mcap.writer")
    with file.open("wb") as stream:
        writer = writing.Writer(stream)
        writer.start()
        kind, channels = writer.register_schema("any", "jsonschema", b"{}"), {}
        for topic, time, message in sorted(messages, key=lambda each: each[1]):
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "json", kind)
            ns, data = round((START + time) * 1e9), json.dumps(message).encode()
            writer.add_message(channels[topic], log_time=ns, publish_time=ns, data=data)
        writer.finish()
    return str(file)


def wheels_and_poses(late=0.0, stamp=lambda t: {}) -> list:
    """Angles in every row, and poses half a row later in every fifth,
    from the columns of a log without noise."""
    log = geometry.log_of(*geometry.winding(300))
    middle = (log.pose[1:] + log.pose[:-1]) / 2
    wheels = [
        ("/wheels", t, {"right": a, "left": b} | stamp(t))
        for t, (a, b) in zip(log.t, log.angles, strict=True)
    ]
    poses = [
        (
            "/odom",
            t + 0.025 + late,
            dict(zip(NAMES[3:], pose, strict=True)) | {"frame": "odom"} | stamp(t + 0.025),
        )
        for t, pose in list(zip(log.t, middle, strict=False))[::5]
    ]
    return [*wheels, *poses]


def stamped(t: float) -> dict:
    return {"header": {"stamp": {"sec": int(START + t), "nanosec": round((START + t) % 1 * 1e9)}}}


MAPPED = ["--map", "theta_r=/wheels:right", "--map", "theta_l=/wheels:left"]


@pytest.mark.parametrize(("late", "stamp"), [(0.0, lambda t: {}), (0.2, stamped)])
def test_topics_are_joined_in_time(late, stamp, tmp_path, capsys):
    """By the times of the log; by those of headers, where the log is late."""
    file = bag(tmp_path / "log.mcap", wheels_and_poses(late, stamp))
    assert main(["calibrate", file, "--robot", "labmate", "--fit", "r", "b", "--json", *MAPPED]) == 0
    said = json.loads(capsys.readouterr().out)
    for name in ("r", "b"):  # chords instead of arcs, by half a row
        assert said["parameters"][name]["value"] == pytest.approx(geometry.TRUE[name], rel=2e-3)
    assert "theta_r of /wheels is interpolated linearly at the times of other topics" in said["remarks"]
    assert "not used: column /odom:frame" in said["remarks"] and not any(
        "gap" in each for each in said["remarks"]
    )


def test_commands_of_another_topic_are_held(tmp_path):
    rows = dynamics.table()
    names = dynamics.columns()
    messages = []
    for row in rows:
        named = dict(zip(names, map(float, row), strict=True))
        messages.append(("/rates", named["t"], {name: named[name] for name in ("thetadot_r", "thetadot_l")}))
        messages.append(("/motors", named["t"] - 0.002, {name: named[name] for name in ("tau_r", "tau_l")}))
    log = read_log(bag(tmp_path / "log.mcap", messages), dynamics.DYNAMICS, {})
    assert len(log.t) == len(rows) and np.array_equal(log.inputs, rows[:, -2:])
    assert log.x[:, -2:] == pytest.approx(rows[:, 6:8])
    assert "tau_r of /motors keeps its last value between messages" in log.remarks


def test_an_angle_that_wraps_is_not_interpolated_where_it_does(tmp_path):
    """The rows of poses at a wrap are left out: halfway there is an angle that the wheel never had."""
    messages = wheels_and_poses()
    for _, _, message in messages:
        message |= {
            name: math.remainder(message[name], 2 * math.pi) for name in ("right", "left") if name in message
        }
    table = read_table(bag(tmp_path / "log.mcap", messages))
    log = read_poses(
        table, geometry.SYSTEM, NAMES[3:], {"theta_r": "/wheels:right", "theta_l": "/wheels:left"}
    )
    expected = geometry.log_of(*geometry.winding(300))
    true = np.column_stack([np.interp(log.t - log.t[0], expected.t, each) for each in expected.angles.T])
    assert (
        np.abs(np.array([[math.remainder(e, 2 * math.pi) for e in row] for row in log.angles - true])).max()
        < 1e-4
    )
    assert np.isfinite(log.pose[:, 0]).sum() > 40


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: {"t": t}, "0 s, those of /odom begin at 1764230000.275 s; their clocks differ"),
        (lambda t: {"stamp": START + t - 5 * (t > 7)}, "the clock was set back; cut the log there"),
    ],
)
def test_topics_whose_clocks_differ_are_refused(change, message, tmp_path, bad_input):
    only = [
        (topic, t, each | (change(t) if topic == "/wheels" else {})) for topic, t, each in wheels_and_poses()
    ]
    file = bag(tmp_path / "log.mcap", only)
    assert message in bad_input(["calibrate", file, "--robot", "labmate", "--fit", "r", *MAPPED])
