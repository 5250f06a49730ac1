"""Inputs that are valid but for a few random changes: exit 0, 1 or 2, at most one line about an error,
and an end."""

import argparse
import json
import os
import random
import signal
import tomllib
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from noslip.cli import COMMANDS
from noslip.cli.commands import parser_of
from noslip.cli.main import main
from noslip.readers.robots import find_robot
from noslip.simulation.sweeping.store import IDENTITY

ROOT = Path(__file__).parents[2]
FEW = 5  # in the normal suite, of each kind
MOST = 120  # s of processor time for one command: what has no bound takes longer, however fast the machine
SPEC = (ROOT / "examples/specs/line.toml").read_text().replace("duration = 15.0", "duration = 0.2")
SWEPT = SPEC + "\n[sweep]\nseed = 7\n[sweep.plant]\nm_c = { normal = [30.0, 6.0] }\n"
CASES = json.loads((ROOT / "examples/specs/reference/labmate_paper.json").read_text())
CASES["cases"] = CASES["cases"][:2]
NUMBERS = (
    "0",
    "-1",
    "1e308",
    "-1e308",
    "1e-308",
    "5e-324",
    "1e30",
    "1e-30",
    "nan",
    "inf",
    "-inf",
    "9" * 30,
    "9" * 5000,
    "0.1",
)
OTHERS = (
    "",
    "true",
    "'x'",
    "[]",
    "{}",
    "[[1], 2]",
    "{ a = 1 }",
    "[" * 400,
    "a.b",
    "\0",
    "é",
    '"',
    "=",
    "#",
    "null",
    "labmate",
)
ROBOTS = (
    "labmate",
    "tractor_trailer:2",
    "car",
    "examples/specs/robots/x.py:r",
    str(ROOT / "model/robots/labmate.py:labmate"),
)


def mutated(text: str, chance: random.Random) -> str:
    """A text with a number, a word, a line or a few characters exchanged, doubled or left out."""
    lines = text.splitlines()
    for _ in range(chance.randint(1, 2)):
        k = chance.randrange(len(lines))
        words = lines[k].split(" ")
        j, way = chance.randrange(len(words)), chance.randrange(6)
        if way <= 1:
            numbers = [i for i, word in enumerate(words) if any(c.isdigit() for c in word)]
            words[chance.choice(numbers or [j])] = chance.choice(NUMBERS)
        elif way == 2:
            words[j] = chance.choice(OTHERS)
        elif way == 3:
            words[j] = words[j][: chance.randrange(len(words[j]) + 1)]
        lines[k] = " ".join(words)
        if way == 4:
            lines.insert(chance.randrange(len(lines)), lines[k])
        elif way == 5 and len(lines) > 1:
            del lines[k]
    return "\n".join(lines) + "\n"


def damaged(data: bytes, chance: random.Random) -> bytes:
    """A few bits flipped, or an end cut off."""
    if chance.random() < 0.3:
        return data[: chance.randrange(len(data))]
    changed = bytearray(data)
    for _ in range(chance.randint(1, 4)):
        changed[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    return bytes(changed)


@pytest.fixture(scope="module")
def valid(tmp_path_factory) -> dict[str, bytes]:
    """What is mutated beside texts: a sweep, and the manifest of one that is under way."""
    folder = tmp_path_factory.mktemp("valid")
    (folder / "s.toml").write_text(SWEPT)
    assert (
        main(
            [
                "sweep",
                str(folder / "s.toml"),
                "--samples",
                "33",
                "-o",
                str(folder / "o.parquet"),
                "--jobs",
                "1",
            ]
        )
        == 0
    )
    identity = pq.ParquetFile(folder / "o.parquet").schema_arrow.metadata[IDENTITY]
    assert main(["simulate", str(folder / "s.toml"), "-o", str(folder / "r.csv")]) == 0
    read = {name: (folder / name).read_bytes() for name in ("o.parquet", "r.csv")}
    return read | {"sweep.json": identity}


def simulated(chance: random.Random, valid, place: Path) -> list[str]:
    (place / "s.toml").write_text(mutated(SPEC, chance))
    return ["simulate", "s.toml", "-o", "r.csv"]


def with_set(chance: random.Random, valid, place: Path) -> list[str]:
    (place / "s.toml").write_text(SPEC)
    keys = [
        f"{name}.{key}"
        for name, table in tomllib.loads(SPEC).items()
        if isinstance(table, dict)
        for key in table
    ]
    keys += [
        "a" + ".a" * chance.choice((1, 20, 3000)),
        "limits.torque",
        "sensors.seed",
        "contact.mu",
        "",
        "robot",
    ]
    key = chance.choice(keys)
    value = chance.choice([*NUMBERS, *OTHERS, "[" * 3000, "{ a = " * 3000])
    return ["simulate", "s.toml", "-o", "r.csv", "--set", f"{key}={value}"]


def evaluated(chance: random.Random, valid, place: Path) -> list[str]:
    (place / "c.json").write_text(mutated(json.dumps(CASES, indent=1), chance))
    return ["evaluate", "c.json"]


def planned(chance: random.Random, valid, place: Path) -> list[str]:
    numbers = [chance.choice((*NUMBERS[:11], "1", "2.5", "-4")) for _ in range(7)]
    if chance.random() < 0.5:
        return ["plan", "dubins", "--from", *numbers[:3], "--to", *numbers[3:6], "--radius", numbers[6]]
    (place / "p.csv").write_text(mutated("x,y,heading\n0, 0, 0\n1, 0, 0.1\n2, 1,\n3, 3, 1\n", chance))
    return ["plan", "waypoints", "p.csv", "--tolerance", numbers[0]]


def replayed(chance: random.Random, valid, place: Path) -> list[str]:
    text = "noslip record 1\nrobot labmate\nlaw type_iv_line\nmodel 0\nlaw_init 0 42f00000 -> 0\nend 1\n"
    (place / "r.txt").write_text(mutated(text, chance))
    return ["replay", "r.txt"]


def analysed(chance: random.Random, valid, place: Path) -> list[str]:
    robot = (
        mutated(chance.choice(ROBOTS).replace(":", ": "), chance).replace(": ", ":").strip().replace("\0", "")
    )
    return ["generate", robot, "-o", "g", "--output", "type_i", "--check"]


def designed(chance: random.Random, valid, place: Path) -> list[str]:
    """Gains, a design and options of random sizes, most of them such as a person gives."""

    def number() -> str:
        size = chance.choice((2, 2, 2, 8, 30, 300))
        return repr(chance.choice((1, 1, 1, 1, -1)) * 10 ** chance.uniform(-size, size))

    gains = ("kp = 1.0", "kd = 2.5", "kv = 2.0")
    text = SPEC
    for gain in gains:
        text = text.replace(gain, f"{gain[:5]}{number()}")
    (place / "s.toml").write_text(text)
    law = (
        ["--spec", "s.toml"]
        if chance.random() < 0.4
        else ["--output", chance.choice(("type_i", "type_ii", "type_iv_circle"))]
    )
    real, imaginary = number(), number().removeprefix("-")
    values = {k: ",".join(number() for _ in range(k)) for k in (2, 3, 4)}
    designs = [f"--{name}={values[k]}" for name in ("poles", "lqr", "hinf", "mixed") for k in values]
    designs += [f"--poles={real}+{imaginary}j,{real}-{imaginary}j", f"--settling={number()}"]
    options = (
        "period",
        "speed",
        "L",
        "wrong",
        "peak",
        "gain-margin",
        "phase-margin",
        "observer",
        "bandwidth",
        "drive-delay",
    )
    argv = ["outer-loop", "labmate", *law, *(chance.sample(designs, 1) if chance.random() < 0.6 else [])]
    argv += [f"--{name}={number()}" for name in options if chance.random() < 0.2]
    return argv + [name for name in ("--integral", "--delay", "--json") if chance.random() < 0.2]


COMMAND_LINES = (
    *(
        "check labmate_paper",
        "generate labmate --check --output type_i",
        "export labmate --output type_i -o e",
    ),
    *("analyse labmate", "outer-loop labmate --output type_i", "simulate s.toml -o r.csv"),
    "sweep s.toml --samples 3 -o n.parquet --jobs 1",
    *(
        "excite s.toml --fit m_c -o e.toml",
        "calibrate r.csv --robot labmate",
        "identify r.csv --robot labmate --fit m_c",
    ),
    *(
        "plan dubins --from 0 0 0 --to 5 5 1 --radius 1",
        "plan reeds-shepp --from 0 0 0 --to 5 5 1 --radius 1",
    ),
    *(
        "plan waypoints p.csv --tolerance 0.1",
        "plan course p.csv --tolerance 0.1",
        "view r.csv --spec s.toml -o v.png",
    ),
)


def options_of(words: list[str]) -> list[argparse.Action]:
    """The options of a command that take values and name no files."""
    parser = parser_of(COMMANDS)[0]
    for word in words[:2]:
        ways = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
        parser = ways[0].choices[word] if ways else parser
    files = {
        "--output",
        "--csv",
        "--figures",
        "--plot",
        "--report",
        "--record",
        "--animate",
        "--contact",
        "--write-scene",
        "-o",
    }
    return [
        a for a in parser._actions if a.option_strings and a.nargs != 0 and not files & set(a.option_strings)
    ]


def optioned(chance: random.Random, valid, place: Path) -> list[str]:
    """An option of any command, as its parser has it, with one of NUMBERS or OTHERS."""
    (place / "s.toml").write_text(SWEPT)
    (place / "p.csv").write_text("x,y\n0, 0\n1, 0\n2, 1\n3, 3\n")
    (place / "r.csv").write_bytes(valid["r.csv"])
    words = chance.choice(COMMAND_LINES).split()
    option = chance.choice(options_of(words))
    name, values = (
        option.option_strings[-1],
        [chance.choice((*NUMBERS, *OTHERS)).replace("\0", "") for _ in range(3)],
    )
    return [
        *words,
        *(
            [name, *values[: option.nargs if option.nargs == 3 else 1]]
            if option.nargs
            else [f"{name}={values[0]}"]
        ),
    ]


def resumed(chance: random.Random, valid, place: Path) -> list[str]:
    (place / "s.toml").write_text(SWEPT)
    (place / "o.parquet.parts").mkdir()
    (place / "o.parquet.parts/sweep.json").write_bytes(damaged(valid["sweep.json"], chance))
    return ["sweep", "s.toml", "--samples", "33", "-o", "o.parquet", "--jobs", "1"]


def sampled(chance: random.Random, valid, place: Path) -> list[str]:
    (place / "o.parquet").write_bytes(damaged(valid["o.parquet"], chance))
    return ["simulate", "o.parquet", "--sample", chance.choice(("0", "32", "33", "-1")), "-o", "r.csv"]


def swept(chance: random.Random, valid, place: Path) -> list[str]:
    (place / "s.toml").write_text(mutated(SWEPT, chance))
    return ["sweep", "s.toml", "--samples", "3", "-o", "n.parquet", "--jobs", "1"]


def forged(chance: random.Random, valid, place: Path) -> list[str]:
    """A sweep's file whose columns, groups or metadata are others."""
    (place / "valid.parquet").write_bytes(valid["o.parquet"])
    table = pq.read_table(place / "valid.parquet")
    known = dict(table.schema.metadata)
    way = chance.randrange(3)
    if way == 0:
        table = table.drop_columns(chance.sample(table.column_names, 2))
    elif way == 1:
        table = table.slice(0, chance.randrange(33))
    else:
        key = chance.choice(list(known))
        value = chance.choice((b"", b"{", b"[]", b"3", b"{}", damaged(known[key], chance)))
        table = table.replace_schema_metadata({**known, key: value})
    pq.write_table(table, place / "o.parquet")
    return ["simulate", "o.parquet", "--sample", "3", "-o", "r.csv"]


KINDS = (
    simulated,
    with_set,
    evaluated,
    planned,
    replayed,
    analysed,
    designed,
    optioned,
    resumed,
    sampled,
    swept,
    forged,
)


def try_all(kind, seeds, valid, place: Path, capfd) -> None:
    """One command for each seed, in a folder of its own."""

    def too_long(*_):
        raise TimeoutError(f"{MOST} s of processor time")

    before = signal.signal(signal.SIGVTALRM, too_long)
    try:
        for seed in seeds:
            own = place / str(seed)
            own.mkdir()
            os.chdir(own)
            find_robot.cache_clear()
            argv = kind(random.Random(f"{kind.__name__} {seed}"), valid, own)
            capfd.readouterr()
            signal.setitimer(signal.ITIMER_VIRTUAL, MOST)
            code = main(argv)
            signal.setitimer(signal.ITIMER_VIRTUAL, 0)
            err = capfd.readouterr().err
            about = f"{kind.__name__} {seed}: {str(argv)[:300]}: exit {code}: {err[:500]}"
            assert code in (0, 1, 2), about
            assert "Traceback" not in err and "Warning" not in err, about
            assert code != 2 or err.count("\n") == 1 and err.startswith("noslip"), about
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_a_mutated_input_is_used_or_refused(kind, valid, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    try_all(kind, range(FEW), valid, tmp_path, capfd)


@pytest.mark.nightly
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_many_mutated_inputs_are_used_or_refused(kind, valid, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    try_all(kind, range(FEW, 100), valid, tmp_path, capfd)
