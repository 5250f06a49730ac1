"""Inputs that are valid but for a few random changes: exit 0, 1 or 2, at most one line about an error, and an end."""

import json
import os
import random
import signal
import tomllib
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from noslip.cli.main import main
from noslip.readers.robots import find_robot
from noslip.sweeping.store import IDENTITY

ROOT = Path(__file__).parent.parent
FEW = 5  # in the normal suite, of each kind
MOST = 120  # s of processor time for one command: what has no bound takes longer, however fast the machine
SPEC = (ROOT / "specs/line.toml").read_text().replace("duration = 15.0", "duration = 0.2")
SWEPT = SPEC + "\n[sweep]\nseed = 7\n[sweep.plant]\nm_c = { normal = [30.0, 6.0] }\n"
CASES = json.loads((ROOT / "specs/reference/labmate_paper.json").read_text())
CASES["cases"] = CASES["cases"][:2]
NUMBERS = ("0", "-1", "1e308", "-1e308", "1e-308", "5e-324", "1e30", "1e-30", "nan", "inf", "-inf", "9" * 30, "9" * 5000, "0.1")
OTHERS = ("", "true", "'x'", "[]", "{}", "[[1], 2]", "{ a = 1 }", "[" * 400, "a.b", "\0", "é", '"', "=", "#", "null", "labmate")
ROBOTS = ("labmate", "tractor_trailer:2", "car", "specs/robots/x.py:r", str(ROOT / "model/robots/labmate.py:labmate"))


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
    assert main(["sweep", str(folder / "s.toml"), "--samples", "33", "-o", str(folder / "o.parquet"), "--jobs", "1"]) == 0
    identity = pq.ParquetFile(folder / "o.parquet").schema_arrow.metadata[IDENTITY]
    return {"o.parquet": (folder / "o.parquet").read_bytes(), "sweep.json": identity}


def simulated(chance: random.Random, valid, place: Path) -> list[str]:
    (place / "s.toml").write_text(mutated(SPEC, chance))
    return ["simulate", "s.toml", "-o", "r.csv"]


def with_set(chance: random.Random, valid, place: Path) -> list[str]:
    (place / "s.toml").write_text(SPEC)
    keys = [f"{name}.{key}" for name, table in tomllib.loads(SPEC).items() if isinstance(table, dict) for key in table]
    keys += ["a" + ".a" * chance.choice((1, 20, 3000)), "limits.torque", "sensors.seed", "contact.mu", "", "robot"]
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
    robot = mutated(chance.choice(ROBOTS).replace(":", ": "), chance).replace(": ", ":").strip().replace("\0", "")
    return ["generate", robot, "-o", "g", "--output", "type_i", "--check"]


def designed(chance: random.Random, valid, place: Path) -> list[str]:
    option = chance.choice(("period", "settling", "poles", "speed", "L", "wrong", "peak", "gain-margin", "phase-margin", "lqr"))
    return ["outer-loop", "labmate", "--output", "type_iv_circle", f"--{option}={chance.choice(NUMBERS)}"]


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


KINDS = (simulated, with_set, evaluated, planned, replayed, analysed, designed, resumed, sampled, swept, forged)


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
    try_all(kind, range(FEW, 300), valid, tmp_path, capfd)
