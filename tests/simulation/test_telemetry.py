"""Telemetry: frames and ring in C, a config as bytes, dumps with damage, gaps and restarts, logs,
and replay bit by bit."""

import csv
import json
import random
import struct
import zlib
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from noslip.checks.guarantees.vehicle import PERIOD, Firmware, FirmwareLoop
from noslip.cli.main import main
from noslip.readers.tables import read_table
from noslip.simulation.closed_loop import simulate
from noslip.simulation.controllers.runtime import runtime
from noslip.simulation.specification.vary import read_varied
from noslip.simulation.telemetry.dump import Kind, frames, read_dump, record_type
from noslip.simulation.telemetry.run import run_of
from noslip.simulation.telemetry.table import run_of_table
from noslip.simulation.telemetry.vehicle import follower_in_c

HEADER = "noslip_telemetry.h"
RING = 1 << 12
SCALARS = {"double": "", "float": "_f"}


@pytest.fixture(scope="module")
def c(tmp_path_factory) -> Firmware:
    return Firmware(tmp_path_factory.mktemp("headers"))


def framed(kind: int, content: bytes) -> bytes:
    """A frame by the definition of COBS: blocks that end before a 0 or after 254 bytes."""
    whole = bytes([kind]) + content
    whole += struct.pack("<I", zlib.crc32(whole))
    result = b""
    for part in whole.split(b"\0"):
        while len(part) >= 254:
            result, part = result + b"\xff" + part[:254], part[254:]
        result += bytes([len(part) + 1]) + part
    return result + b"\0"


class Ring:
    """A ring of the C."""

    def __init__(self, size: int = RING):
        self.c = runtime(HEADER)
        self.memory, self.self = self.c.ffi.new(f"uint8_t[{size}]"), self.c.ffi.new("noslip_telemetry *")
        assert self.c.lib.noslip_telemetry_init(self.self, self.memory, size) == 0
        self.bytes, self.count = self.c.ffi.new("uint8_t[4096]"), self.c.ffi.new("uint32_t *")

    def send(self, kind: int, content: bytes) -> str:
        return self.c.status(self.c.lib.noslip_telemetry_send(self.self, kind, content, len(content)))

    def read(self, most: int = 4096) -> bytes:
        assert self.c.lib.noslip_telemetry_read(self.self, self.bytes, most, self.count) == 0
        return bytes(self.c.ffi.buffer(self.bytes, self.count[0]))


# -- frames --------------------------------------------------------------------------------------------------


def contents(chance: random.Random, count: int) -> list[bytes]:
    """Of all lengths around a block, with few and with many zeros."""
    sizes = [
        0,
        1,
        2,
        248,
        249,
        250,
        253,
        254,
        255,
        256,
        503,
        508,
        509,
        *(chance.randrange(700) for _ in range(count)),
    ]

    def byte(rare: float) -> int:
        return chance.choice((0, 0, 255, 1)) if chance.random() < rare else 1 + chance.randrange(255)

    return [bytes(byte(0.2 * (k % 3)) for _ in range(size)) for k, size in enumerate(sizes)]


def test_frames_are_cobs_with_a_crc():
    """The bytes are those of the definition, whatever they wrap around; the reader finds what was sent."""
    ring, sent = Ring(), b""
    for k, content in enumerate(contents(random.Random(1), 200)):
        assert ring.send(1 + k % 255, content) == "ok"
        block = ring.read()
        assert block.count(0) == 1 and list(frames(block)) == [(1 + k % 255, content)]
        if b"\xff" * 254 not in block:  # both ways of ending a full block are COBS
            assert block.replace(b"\x01\0", b"\0") == framed(1 + k % 255, content).replace(b"\x01\0", b"\0")
        sent += block
    assert len(sent) > 10 * RING


def test_a_ring_keeps_whole_frames():
    """Read in any portions, it gives the frames that it took in their order; the others are counted,
    and leave nothing behind."""
    chance, ring, taken, read, refused = random.Random(2), Ring(256), [], b"", 0
    for content in contents(chance, 1000):
        status = ring.send(9, content)
        taken += [content] if status == "ok" else []
        refused += status == "full"
        assert status in ("ok", "full") and ring.self.dropped == refused
        for _ in range(chance.randrange(4)):
            read += ring.read(chance.randrange(120))
    read += ring.read()
    assert [content for _, content in frames(read)] == taken and len(taken) > 100 < refused
    assert ring.read() == b""


def test_misuse_of_a_ring():
    c = runtime(HEADER)
    null, ring = c.ffi.NULL, Ring()
    for size in (0, 128, 255, 1000, (1 << 31)):
        assert c.status(c.lib.noslip_telemetry_init(ring.self, ring.memory, size)) == "bad_parameter"
        assert ring.send(9, b"1") == "not_ready"
    assert (
        c.status(c.lib.noslip_telemetry_read(ring.self, ring.bytes, 9, ring.count)) == "not_ready"
        and ring.count[0] == 0
    )
    assert c.status(c.lib.noslip_telemetry_init(null, null, RING)) == c.status(
        c.lib.noslip_telemetry_init(ring.self, null, RING)
    )
    ring, record = Ring(), c.ffi.new("noslip_record *")
    assert [ring.send(kind, b"") for kind in (0, 256, -1)] == ["bad_parameter"] * 3
    for call in (
        lambda: c.lib.noslip_telemetry_send(null, 9, b"1", 1),
        lambda: c.lib.noslip_telemetry_send(ring.self, 9, null, 1),
        lambda: c.lib.noslip_telemetry_record(null, record),
        lambda: c.lib.noslip_telemetry_record(ring.self, null),
        lambda: c.lib.noslip_telemetry_correct(ring.self, null, 0),
        lambda: c.lib.noslip_telemetry_read(ring.self, null, 1, ring.count),
        lambda: c.lib.noslip_telemetry_read(ring.self, ring.bytes, 1, null),
    ):
        assert c.status(call()) == "null"
    assert ring.send(9, bytes(4000)) == "ok" and ring.send(9, bytes(4000)) == "full"
    assert c.lib.noslip_telemetry_send(ring.self, 9, ring.bytes, 0xFFFFFFFF) == c.lib.NOSLIP_FULL


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_a_record_is_in_its_frame(scalar):
    """Each field in the order of the struct as the C compiler has it,
    with the tick that the ring has counted."""
    ring, chance = Ring(), np.random.default_rng(3)
    suffix = SCALARS[scalar]
    record = ring.c.ffi.new(f"noslip_record{suffix} *")
    send = getattr(ring.c.lib, f"noslip_telemetry_record{suffix}")
    tick = -1
    for _ in range(50):
        ring.c.ffi.buffer(record)[:] = chance.bytes(ring.c.ffi.sizeof(f"noslip_record{suffix}"))
        record.missed = int(chance.integers(0, 5))
        tick += 1 + record.missed
        assert send(ring.self, record) == 0 and record.tick == tick
        ((kind, content),) = frames(ring.read())
        assert kind == Kind.RECORD and content == packed(ring.c.ffi, record)
        assert np.frombuffer(content, record_type(scalar))["tick"][0] == tick


def packed(ffi, struct_, leave: tuple[str, ...] = ()) -> bytes:
    """The bytes of each number of a struct in memory, but for its gaps,
    its pointers and the members to leave out."""
    kind = ffi.typeof(struct_)
    kind = kind.item if kind.kind == "pointer" else kind
    memory = bytes(
        ffi.buffer(
            ffi.addressof(struct_[0]) if ffi.typeof(struct_).kind == "pointer" else ffi.addressof(struct_)
        )
    )
    return b"".join(memory[at : at + size] for at, size in _places(ffi, kind, 0, leave))


def _places(ffi, kind, at: int, leave: tuple[str, ...] = ()):
    if kind.kind == "array":
        for k in range(kind.length):
            yield from _places(ffi, kind.item, at + k * ffi.sizeof(kind.item))
    elif kind.kind == "struct":
        for name, member in kind.fields:
            if name not in leave and member.type.kind != "pointer":
                yield from _places(ffi, member.type, at + member.offset)
    else:
        yield at, ffi.sizeof(kind)


# -- a config as bytes ---------------------------------------------------------------------------------------


class Flash:
    """A config with random numbers, saved by the generated C."""

    def __init__(self, scalar: str, seed: int = 4):
        self.c, self.suffix = follower_in_c("labmate", scalar), SCALARS[scalar]
        chance, ffi = np.random.default_rng(seed), self.c.ffi
        self.config = self.c.new("config")
        ffi.buffer(self.config)[:] = chance.bytes(ffi.sizeof(self.config[0]))
        self.segments = ffi.new(f"noslip_segment{self.suffix}[5]")
        ffi.buffer(self.segments)[:] = chance.bytes(ffi.sizeof(self.segments))
        self.config.segments, self.config.count = self.segments, 5
        self.image, used = ffi.new("uint8_t[4096]"), ffi.new("uint32_t *")
        assert self.c.call("save", self.config, self.image, 4096, used) == 0
        self.bytes = bytes(ffi.buffer(self.image, used[0]))

    def load(self, image: bytes, most: int = 5) -> str:
        """The status; nothing may change unless it is good."""
        ffi, config = self.c.ffi, self.c.new("config")
        segments = ffi.new(f"noslip_segment{self.suffix}[5]")
        for place in (ffi.buffer(config), ffi.buffer(segments)):
            place[:] = b"\xa5" * len(place)
        status = self.c.status(self.c.call("load", config, segments, most, image, len(image)))
        if status != "ok":
            assert set(bytes(ffi.buffer(config)) + bytes(ffi.buffer(segments))) == {0xA5}
        self.loaded = config, segments
        return status


@pytest.mark.parametrize("scalar", SCALARS)
def test_an_image_has_every_number_of_the_config(scalar):
    """In the order of the structs as the C compiler has them, and back again bit by bit."""
    flash = Flash(scalar)
    ffi = flash.c.ffi
    numbers = packed(ffi, flash.config, ("count",)) + b"".join(
        packed(ffi, segment) for segment in flash.segments
    )
    assert flash.bytes[24:-4] == numbers
    assert struct.unpack("<I", flash.bytes[-4:])[0] == zlib.crc32(flash.bytes[:-4])
    assert len(flash.bytes) == struct.unpack_from("<I", flash.bytes, 8)[0]
    assert flash.load(flash.bytes + b"\xff" * 100) == "ok"
    config, segments = flash.loaded
    assert (config.count, config.segments) == (5, segments)
    assert packed(ffi, config, ("count",)) + b"".join(packed(ffi, segment) for segment in segments) == numbers


def resealed(image: bytes, place: int, word: int) -> bytes:
    """An image with another word in its head, and the CRC for it."""
    changed = image[:place] + struct.pack("<I", word) + image[place + 4 : -4]
    return changed + struct.pack("<I", zlib.crc32(changed))


def test_wrong_images_are_refused():
    flash, chance = Flash("float"), random.Random(5)
    image = flash.bytes
    assert flash.load(image) == "ok"
    for erased in (b"", b"\xff" * len(image), bytes(len(image)), image[:27], image[:-1], image[1:]):
        assert flash.load(erased) == "damaged"
    for _ in range(300):
        bit = chance.randrange(8 * len(image))
        changed = bytearray(image)
        changed[bit // 8] ^= 1 << bit % 8
        assert flash.load(bytes(changed)) == "damaged", bit
    words = struct.unpack_from("<6I", image)
    assert flash.load(resealed(image, 4, words[1] + 1)) == "other_version"  # format
    assert flash.load(Flash("double").bytes) == "other_version"
    assert flash.load(resealed(image, 12, words[3] ^ 1)) == "other_version"  # fields
    assert flash.load(resealed(image, 16, words[4] ^ 1)) == "other_model"
    assert flash.load(resealed(image, 20, 4)) == flash.load(resealed(image, 20, 2**31)) == "damaged"  # rows
    assert flash.load(image, most=4) == flash.load(image, most=-1) == "full"
    null, used = flash.c.ffi.NULL, flash.c.ffi.new("uint32_t *")
    assert flash.c.call("load", null, flash.segments, 5, image, len(image)) == flash.c.lib.NOSLIP_NULL
    assert flash.c.call("save", null, flash.image, 4096, used) == flash.c.lib.NOSLIP_NULL
    assert flash.c.call("save", flash.config, flash.image, len(image) - 1, used) == flash.c.lib.NOSLIP_FULL
    assert used[0] == len(image)
    flash.config.count = -1
    assert flash.c.call("save", flash.config, flash.image, 4096, used) == flash.c.lib.NOSLIP_BAD_PARAMETER


def test_any_bytes_are_no_image():
    """Also where magic and CRC are right: an error, or a config of numbers, never a place outside."""
    flash, chance = Flash("float"), random.Random(6)
    for _ in range(500):
        body = bytearray(chance.randbytes(chance.randrange(0, 900)))
        body[:4] = flash.bytes[:4]
        body[8:12] = struct.pack("<I", len(body) + 4)
        assert flash.load(bytes(body) + struct.pack("<I", zlib.crc32(bytes(body)))) != "ok"


# -- a vehicle that tells ------------------------------------------------------------------------------------


class Telling:
    """The vehicle of firmware/ on this host, with what its line sends."""

    def __init__(self, c: Firmware, **changes):
        self.loop, self.c, ffi = FirmwareLoop(c, **changes), c, c.ffi
        self.ring, self.telemetry = ffi.new("uint8_t[4096]"), ffi.new("noslip_telemetry *")
        assert c.lib.noslip_telemetry_init(self.telemetry, self.ring, 4096) == 0
        self.bytes, self.count, self.sent = ffi.new("uint8_t[4096]"), ffi.new("uint32_t *"), []
        self.none = ffi.new("float[2]")
        self.describe()

    def drain(self) -> None:
        assert self.c.lib.noslip_telemetry_read(self.telemetry, self.bytes, 4096, self.count) == 0
        self.sent.append(bytes(self.c.ffi.buffer(self.bytes, self.count[0])))

    def describe(self) -> None:
        assert (
            self.c.lib.labmate_follower_describe_f(self.loop.vehicle, self.telemetry, self.bytes, 4096) == 0
        )
        self.drain()

    def tick(self, missed: int = 0, **more) -> int:
        loop = self.loop
        status = loop.tick(missed=missed, **more)
        told = (loop.vehicle, self.telemetry, loop.counts, missed, status, loop.command, 0.0, self.none)
        assert self.c.lib.tell(*told) == 0
        self.drain()
        return status


def drive(c: Firmware, ticks: int = 400) -> Telling:
    telling = Telling(c)
    for _ in range(ticks):
        telling.tick()
    return telling


@pytest.fixture(scope="module")
def parts(c) -> list[bytes]:
    """What was sent at the start, and at each of 400 ticks."""
    return drive(c).sent


@pytest.fixture
def dumped(tmp_path):
    """Writes a dump; returns its name."""

    def dumped(sent: list[bytes], name: str = "run.dump") -> str:
        file = tmp_path / name
        file.write_bytes(b"".join(sent))
        return str(file)

    return dumped


def replayed(capsys, *argv: str) -> tuple[int, dict]:
    code = main(["replay", *argv, "--json"])
    return code, json.loads(capsys.readouterr().out)


def test_a_dump_is_repeated_bit_by_bit(parts, dumped, capsys):
    code, said = replayed(capsys, dumped(parts))
    assert (code, said["ticks"], said["difference"], said["remarks"]) == (0, 400, None, [])


@pytest.mark.parametrize(
    "name", ["torque", "pose.heading", "status", "watchdog", "distance", "command", "rate"]
)
def test_another_bit_is_found(name, parts, dumped, capsys):
    """A record of the wrong number, sealed with the right CRC."""
    ((kind, content),) = frames(parts[200])
    values = np.frombuffer(content, record_type("float")).copy()
    values.view(np.uint8)[record_type("float").fields[name][1]] ^= 1
    code, said = replayed(capsys, dumped([*parts[:200], framed(kind, values.tobytes()), *parts[201:]]))
    assert code == 1 and said["ticks"] == 199 and said["difference"].startswith(f"tick 199: {name} was ")


def test_what_is_done_between_ticks_is_repeated(c, dumped, capsys):
    """Missed ticks and misread counters, a correction, other gains, a stop and its reset;
    without one of them it differs."""
    telling = Telling(c)
    loop, lib, vehicle = telling.loop, c.lib, telling.loop.vehicle

    def misread(counts):
        counts[0] = (counts[0] + 20000) & 0xFFFF

    for k in range(500):
        if k == 100:
            pose = vehicle.odometry.pose
            truth = c.new("noslip_pose_f", {"x": pose.x, "y": pose.y + 0.03, "heading": pose.heading + 0.01})
            assert lib.labmate_follower_correct_f(vehicle, truth, lib.NOSLIP_RESET) == 0
            assert lib.tell_correction(telling.telemetry, truth, lib.NOSLIP_RESET) == 0
        if k == 200:
            params, gains = (
                c.new("labmate_params_f", vehicle.params),
                c.new("labmate_type_iv_segment_gains_f", vehicle.gains),
            )
            params.m_c, gains.kv_speed = 40.0, 1.0
            assert lib.labmate_follower_update_f(vehicle, params, gains, c.ffi.NULL) == 0
            telling.describe()
        if k == 300:
            telling.tick(missed=9)
            assert loop.state == 2
            assert lib.labmate_follower_reset_f(vehicle) == 0
            assert lib.noslip_telemetry_send(telling.telemetry, Kind.RESET, c.ffi.NULL, 0) == 0
        if k % 90 == 50:
            telling.tick(missed=1, misread=misread)
        telling.tick()
    assert replayed(capsys, dumped(telling.sent))[0] == 0
    for left_out in (Kind.CORRECT, Kind.UPDATE, Kind.RESET):
        blocks = [block + b"\0" for block in b"".join(telling.sent).split(b"\0") if block]
        first = [list(frames(block))[0][0] for block in blocks].index(Kind.RECORD)
        rest = [block for block in blocks[first:] if list(frames(block))[0][0] != left_out]
        code, said = replayed(capsys, dumped([*blocks[:first], *rest]))
        assert code == 1 and "was" in said["difference"], left_out


@pytest.mark.parametrize("scalar", SCALARS)
def test_ticks_by_angles_are_repeated(scalar, dumped, capsys):
    """In both scalars, with velocity drives that follow at once; the log has their angles and commands."""
    vehicle, suffix, ring = follower_in_c("labmate", scalar), SCALARS[scalar], Ring()
    config, sent = vehicle.new("config"), []
    segments = vehicle.ffi.new(f"noslip_segment{suffix}[1]", [{"length": 9.0}])
    assert (
        getattr(vehicle.lib, f"labmate_default_params{suffix}")(vehicle.ffi.addressof(config, "params")) == 0
    )
    config.period, config.counts_per_turn, config.counter_bits, config.fastest = (
        PERIOD,
        [4096, 4096],
        16,
        20.0,
    )
    config.segments, config.count, config.path.speed, config.astray, config.gains = (
        segments,
        1,
        1.0,
        0.5,
        (1.0, 2.5, 2.0),
    )
    config.drive = vehicle.lib.NOSLIP_DRIVE_VELOCITY
    config.velocity = [{"speed": 20.0, "acceleration": 15.0, "band": 5.0}] * 2
    config.start.y = 0.05
    follower, command, turned = vehicle.new(""), vehicle.reals(2), vehicle.reals(2)
    record, _ = vehicle.records()
    assert vehicle.call("init", follower, config) == 0
    own = runtime(HEADER).ffi
    telemetry = vehicle.ffi.cast("noslip_telemetry *", int(own.cast("uintptr_t", ring.self)))
    assert vehicle.call("describe", follower, telemetry, vehicle.ffi.new("uint8_t[2048]"), 2048) == 0
    chance, way = np.random.default_rng(7), np.zeros(2)
    for _ in range(200):
        dt = PERIOD * chance.uniform(0.8, 1.2)
        turned[0], turned[1] = command[0] * dt, command[1] * dt
        way += turned[0], turned[1]
        status = vehicle.call("tick_angles", follower, turned, dt, command)
        vehicle.call("record", follower, vehicle.ffi.NULL, 0, status, command, record)
        record.dt, record.turned = dt, turned
        told = own.new(f"noslip_record{suffix} *")
        own.buffer(told)[:] = vehicle.ffi.buffer(record)[:]
        assert getattr(ring.c.lib, f"noslip_telemetry_record{suffix}")(ring.self, told) == 0
        sent.append(ring.read())
    file = dumped(sent)
    assert replayed(capsys, file)[:1] == (0,)
    assert main(["log", file, "-o", f"{file}.csv"]) == 0
    table = read_table(f"{file}.csv")
    assert [table[name].numbers("rad")[-1] for name in ("theta_r", "theta_l")] == pytest.approx(way, rel=1e-5)
    assert table["command_thetadot_r"].numbers()[-1] == pytest.approx(command[0], rel=1e-6)
    assert "tau_r" not in table and "law_tau_r" in table  # the drives need not supply the law's torque
    capsys.readouterr()


# -- what is missing -----------------------------------------------------------------------------------------


def logged(capsys, file: str, *more: str) -> dict:
    assert main(["log", file, "-o", f"{file}.csv", "--json", *more]) == 0
    return json.loads(capsys.readouterr().out)


def test_damage_gaps_and_missed_ticks_are_counted(c, parts, dumped, capsys):
    chance = random.Random(8)
    damaged = list(parts)
    for k in (50, 51, 120):
        place = chance.randrange(len(parts[k]) - 1)
        damaged[k] = parts[k][:place] + bytes([parts[k][place] ^ 64]) + parts[k][place + 1 :]
        assert 0 not in damaged[k][:-1]
    del damaged[200:210]
    damaged.append(parts[300][:40])  # the end of the dump is inside a frame
    file = dumped(damaged)
    said = logged(capsys, file)
    assert (said["ticks"], said["lost"], said["starts"]) == (400 - 13, 13, 1)
    assert said["remarks"] == ["4 damaged frames are left out", "13 records are missing in 3 gaps"]
    code, said = replayed(capsys, file)
    assert code == 1 and said["ticks"] == 49 and "2 records are missing before tick 51" in said["difference"]
    telling = Telling(c)
    for k in range(60):
        telling.tick(missed=2 if k == 30 else 0)
    said = logged(capsys, dumped(telling.sent))
    assert said["remarks"] == ["the vehicle missed 2 ticks"] and said["duration"] == pytest.approx(0.61)


def test_restarts_are_told_and_chosen(parts, dumped, bad_input, capsys):
    file = dumped([*parts[:101], *parts[:301]])
    said = bad_input(["log", file, "-o", f"{file}.csv"])
    assert "started 2 times (1: 100 ticks, 2: 300 ticks); choose one with --start" in said
    assert "has 2 starts" in bad_input(["view", file, "-o", f"{file}.png", "--start", "3"])
    assert [logged(capsys, file, "--start", k)["ticks"] for k in ("1", "2")] == [100, 300]
    assert replayed(capsys, file, "--start", "2")[1]["ticks"] == 300
    # The log began too late, then the vehicle was started
    said = logged(capsys, dumped([*parts[90:201], *parts[:51]]))
    assert said["ticks"] == 50 and "111 ticks of starts without a config are left out" in said["remarks"]
    said = logged(capsys, dumped([*parts[90:100], parts[0], *parts[100:200]]))  # told again while it drove
    assert said["ticks"] == 110 and said["lost"] == 89


@pytest.mark.parametrize(
    "content", [b"", b"\0" * 500, b"not a dump\n", b"\x05abc\0" * 99, b"\xff" * 999 + b"\0"]
)
def test_what_is_no_dump_is_refused(content, dumped, bad_input):
    said = bad_input(["log", dumped([content]), "-o", "run.csv"])
    assert "no config and ticks" in said


def test_any_bytes_are_read_or_refused(parts, dumped):
    """Bytes changed, left out and repeated at random: a start is a part of what was sent, in its order."""
    chance, whole = random.Random(9), b"".join(parts[:60])
    sent = {content for part in parts for _, content in frames(part)}
    changes = (
        lambda data, place: data.pop(place),
        lambda data, place: data.insert(place, chance.randrange(256)),
        lambda data, place: data.__setitem__(place, 0),
        lambda data, place: data.__setitem__(slice(place, place + 200), b""),
    )
    for _ in range(60):
        data = bytearray(whole)
        for _ in range(chance.randrange(1, 30)):
            chance.choice(changes)(data, chance.randrange(len(data)))
        try:
            dump = read_dump(dumped([bytes(data)]))
        except Exception as error:
            assert type(error).__name__ == "BadInput", error
            continue
        for start in dump.starts:
            assert all(row.tobytes() in sent for row in start.records)
            assert (np.diff(start.records["tick"].astype(int)) > 0).all()


@pytest.mark.nightly
def test_bad_input(parts, dumped, bad_input, tmp_path):
    file, nameless = (
        dumped(parts),
        dumped([framed(2, list(frames(parts[0]))[1][1]), *parts[1:]], "nameless.dump"),
    )
    assert ".csv or .parquet or .mcap" in bad_input(["log", file, "-o", str(tmp_path / "run.xls")])
    assert "is a table, not a dump" in bad_input(
        ["log", dumped(parts, "run.csv"), "-o", str(tmp_path / "out.csv")]
    )
    assert "give --spec SPEC" in bad_input(
        ["view", dumped(parts, "run.csv"), "-o", str(tmp_path / "run.png")]
    )
    assert "leave it out" in bad_input(
        ["view", dumped(parts), "--spec", "line", "-o", str(tmp_path / "run.png")]
    )
    assert "give --robot" in bad_input(["replay", nameless])
    assert main(["replay", nameless, "--robot", "labmate"]) == 0
    assert "two driven wheels" in bad_input(["replay", file, "--robot", "four_wheel"])
    assert "other" in bad_input(["replay", file, "--robot", "turtlebot3_burger"])
    assert "on this host" in bad_input(["replay", file, "--backend", "m4f"])
    robot, image = framed(1, b"nobody"), parts[0].split(b"\0", 1)[1]
    assert "'nobody'" in bad_input(
        ["log", dumped([robot, image, *parts[1:]], "other.dump"), "-o", str(tmp_path / "x.csv")]
    )
    words = list(frames(parts[0]))
    other = framed(2, resealed(words[1][1], 16, 1))
    assert "the noslip and the robot" in bad_input(
        ["replay", dumped([framed(*words[0]), other, *parts[1:]], "model.dump")]
    )
    text = tmp_path / "record.txt"
    text.write_text("noslip record 1\n")
    assert "--start is for a dump of telemetry" in bad_input(["replay", str(text), "--start", "1"])


# -- logs ----------------------------------------------------------------------------------------------------


def test_formats_have_the_same_numbers(parts, dumped, tmp_path, capsys):
    """And units and meanings where the format has a place for them."""
    file = dumped(parts)
    for suffix in ("csv", "parquet", "mcap"):
        assert main(["log", file, "-o", str(tmp_path / f"run.{suffix}")]) == 0
    tables = [read_table(tmp_path / f"run.{suffix}") for suffix in ("csv", "parquet", "mcap")]
    assert list(tables[0]) == list(tables[1]) == list(tables[2])
    for name in tables[0]:
        if name in ("status", "watchdog"):
            assert len({tuple(map(str, table[name].entries)) for table in tables}) == 1
        else:
            numbers = [table[name].numbers() for table in tables]
            assert np.array_equal(np.float32(numbers[0]), np.float32(numbers[1])) and np.array_equal(
                numbers[1], numbers[2]
            ), name
    schema = pq.read_schema(tmp_path / "run.parquet")
    assert schema.field("phi").metadata[b"unit"] == b"rad" and schema.metadata[b"robot"] == b"labmate"
    reader = pytest.importorskip("mcap.reader")
    with open(tmp_path / "run.mcap", "rb") as stream:
        kind, channel, message = next(iter(reader.make_reader(stream, validate_crcs=True).iter_messages()))
    assert (channel.topic, channel.message_encoding, kind.encoding) == ("/labmate", "json", "jsonschema")
    pytest.importorskip("jsonschema").validate(json.loads(message.data), json.loads(kind.data))
    assert json.loads(kind.data)["properties"]["phi"]["description"].endswith("rad")


def test_columns_are_what_the_vehicle_did(c, dumped, tmp_path):
    """Against the simulated vehicle: angles, rates, pose, torque and status of each tick."""
    telling, rows = Telling(c), []
    for _ in range(300):
        status = telling.tick()
        vehicle, lib = telling.loop.vehicle, c.lib
        rows.append([vehicle.state.phi, *vehicle.torque, lib.rate[0], lib.rate[1], status])
    file = dumped(telling.sent)
    assert main(["log", file, "-o", f"{file}.csv"]) == 0
    with open(f"{file}.csv", encoding="utf-8", newline="") as stream:
        table = list(csv.DictReader(stream))
    phi, right, left, rate_right, rate_left, status = np.array(rows).T
    assert [float(row["t"]) for row in table] == pytest.approx(PERIOD * np.arange(300), abs=1e-9)
    assert np.array_equal(np.float32([row["phi"] for row in table]), np.float32(phi))
    assert np.array_equal(
        np.float32([[row["tau_r"], row["tau_l"]] for row in table]), np.float32([right, left]).T
    )
    assert {row["status"] for row in table} == {"ok"} == {c.status(int(each)) for each in status}
    for name, rate in (("r", rate_right), ("l", rate_left)):
        angle = np.array([float(row[f"theta_{name}"]) for row in table])
        assert np.abs(angle - np.cumsum(rate) * PERIOD).max() < 0.1
        assert np.array([float(row[f"thetadot_{name}"]) for row in table])[5:-5] == pytest.approx(
            rate[5:-5], abs=0.15
        )


@pytest.mark.nightly
def test_a_log_identifies_the_vehicle(c, dumped, capsys):
    """The wheel radius of its own odometry; the mass from torques, with what the back EMF over a held voltage
    adds, and from the voltages of the motors, without: see noslip_motor.h.
    """
    telling = drive(c, 2000)
    file = dumped(telling.sent)
    assert main(["log", file, "-o", f"{file}.mcap"]) == 0
    capsys.readouterr()
    assert main(["calibrate", f"{file}.mcap", "--robot", "labmate", "--fit", "r", "b", "--json"]) == 0
    r, b = (each["value"] for each in json.loads(capsys.readouterr().out)["parameters"].values())
    params, motor = telling.loop.settings.params, telling.loop.settings.motors[0]
    assert r == pytest.approx(params.r, rel=1e-6) and b == pytest.approx(params.b, rel=1e-5)
    assert main(["identify", f"{file}.mcap", "--robot", "labmate", "--fit", "m_c", "I_c", "--json"]) == 0
    mass = json.loads(capsys.readouterr().out)["parameters"]["m_c"]["value"]
    emf = motor.torque_constant * motor.gear
    added = 2 * motor.efficiency * emf**2 * PERIOD / (motor.resistance * params.r**2)
    assert mass == pytest.approx(params.m_c + added, rel=0.01) and added > 2
    names = (
        "gear",
        "efficiency",
        "back_efficiency",
        "torque_constant",
        "resistance",
        "friction",
        "dry_friction",
        "moving",
    )
    given = [each for name in names for each in ("--set", f"{name}={getattr(motor, name)}")]
    voltages = [
        "--drive",
        "voltage",
        "--map",
        "voltage_tau_r=command_tau_r",
        "--map",
        "voltage_tau_l=command_tau_l",
    ]
    arguments = [
        "identify",
        f"{file}.mcap",
        "--robot",
        "labmate",
        "--fit",
        "m_c",
        "I_c",
        "--inputs",
        "held",
        "--json",
    ]
    assert main([*arguments, *voltages, *given]) == 0
    fitted = json.loads(capsys.readouterr().out)["parameters"]["m_c"]
    # Four steps of simulated.c in a tick
    faster = motor.efficiency * emf**2 * PERIOD / 4 / (motor.resistance * params.r**2)
    assert fitted["value"] == pytest.approx(params.m_c - faster, abs=0.01 * params.m_c)
    # The steps of simulated.c are a systematic error, which is found in the log: the interval holds the mass
    # without them too.
    assert abs(fitted["value"] - params.m_c) < fitted["within"] < 0.04 * params.m_c


def test_units_in_headers(tmp_path, bad_input):
    from noslip.analysis.identification.log import read_poses
    from noslip.readers.robots import find_robot, system_of

    system, random = system_of(find_robot("labmate")), np.random.default_rng(1)
    rows = np.column_stack([np.arange(30) * 10.0, *np.cumsum(0.1 * random.normal(size=(5, 30)), axis=1)])
    head = "t [ms],theta_r [deg],theta_l,x_c [cm],y_c,yaw [deg]"
    file = tmp_path / "log.csv"
    np.savetxt(file, rows, delimiter=",", header=head, comments="")
    log = read_poses(file, system, ("x_c", "y_c", "phi"), {"phi": "yaw"})
    assert np.allclose(log.t, rows[:, 0] / 1e3) and np.allclose(log.angles[:, 0], np.deg2rad(rows[:, 1]))
    assert np.allclose(log.pose, rows[:, 3:] * (0.01, 1.0, np.pi / 180))
    for wrong, said in (("t [m]", "not a unit of a quantity in s"), ("t [furlongs/x]", "column 't'")):
        np.savetxt(file, rows, delimiter=",", header=head.replace("t [ms]", wrong, 1), comments="")
        assert said in bad_input(["calibrate", str(file), "--robot", "labmate", "--map", "phi=yaw"])
    for name, content, said in (
        ("a.mcap", b"no", "not an MCAP file"),
        ("a.parquet", b"no", "not a Parquet file"),
    ):
        (tmp_path / name).write_bytes(content)
        assert said in bad_input(["calibrate", str(tmp_path / name), "--robot", "labmate"])


@pytest.mark.nightly
def test_commands_of_the_page(parts, dumped, tmp_path):
    """Those of docs/firmware.md, with a dump of this host."""
    page = (Path(__file__).parents[2] / "docs/firmware.md").read_text()
    block = page.split("<!-- run by tests/simulation/test_telemetry.py -->\n```sh\n")[1].split("```")[0]
    lines = [line.split("#")[0].split() for line in block.splitlines()]
    assert lines[0][:4] == ["make", "-C", "firmware", "run"]
    places = {"/tmp/run.dump": dumped(parts)} | {
        f"run.{suffix}": str(tmp_path / f"run.{suffix}") for suffix in ("mcap", "png")
    }
    places["run.toml"] = "line"
    for _, *words in lines[1:]:
        assert main([places.get(word, word) for word in words]) == 0


def test_a_dump_is_drawn(parts, dumped, tmp_path, capsys):
    assert main(["view", dumped(parts), "-o", str(tmp_path / "run.svg")]) == 0
    text = Path(tmp_path / "run.svg").read_text(encoding="utf-8")
    assert len(text) > 20_000 and "labmate" in capsys.readouterr().out


# -- tables as runs ------------------------------------------------------------------------------------------


def test_a_logged_table_is_the_run_of_its_dump(parts, dumped, tmp_path):
    """With the SPEC of the dump: the same states, outputs and segments in every format."""
    file = dumped(parts)
    (start,) = read_dump(file).starts
    run = run_of(start, follower_in_c("labmate", "float"), file)
    for suffix in ("csv", "parquet", "mcap"):
        assert main(["log", file, "-o", str(tmp_path / f"run.{suffix}")]) == 0
        again = run_of_table(read_table(tmp_path / f"run.{suffix}"), run.spec, "run")
        for name in ("t", "q", "nu", "tau", "y_d"):
            assert getattr(again, name) == pytest.approx(getattr(run, name), rel=1e-6, abs=1e-6), name
        assert list(again.status) == list(run.status) and again.y[:, 0] == pytest.approx(
            run.y[:, 0], abs=1e-4
        )


@pytest.mark.parametrize("name", ["line", "circle", "payload"])
def test_a_simulated_table_is_its_run(name, tmp_path, capsys):
    """The columns of `noslip simulate` give every number of the run again."""
    run = simulate(read_varied(name, {"simulation.duration": 2.0}))
    (tmp_path / "run.csv").write_text(run.csv())
    again = run_of_table(read_table(tmp_path / "run.csv"), run.spec, "run.csv")
    for part in ("t", "q", "nu", "tau", "y", "y_d", "config", "piece", "forces", "learned"):
        assert getattr(again, part) == pytest.approx(getattr(run, part), abs=1e-12), part
    assert main(["view", str(tmp_path / "run.csv"), "--spec", name, "-o", str(tmp_path / "run.svg")]) == 0
    assert len((tmp_path / "run.svg").read_text()) > 20_000 and "labmate" in capsys.readouterr().out


def test_torques_of_the_law_are_those_of_velocity_drives(tmp_path):
    """A table with both: with torque drives the inputs are tau, whatever the law asked for."""
    drive = {
        "drive.kind": "velocity",
        "drive.bandwidth": 10.0,
        "simulation.period": 0.01,
        "simulation.backend": "c",
    }
    (tmp_path / "run.csv").write_text(
        "t,x_c,y_c,phi,thetadot_r,thetadot_l,tau_r,law_tau_r\n0,0,0,0,0,0,1,2\n1,0,0,0,0,0,1,2\n"
    )
    for change, expected in (({}, 1.0), (drive, 2.0)):
        run = run_of_table(read_table(tmp_path / "run.csv"), read_varied("line", change), "run.csv")
        assert list(run.tau[:, 0]) == [expected] * 2 and np.isnan(run.tau[:, 1]).all()


@pytest.mark.nightly
def test_tables_that_do_not_fit_are_refused(tmp_path, bad_input, capsys):
    """What the outputs need must be there and finite; wheel angles and torques need not."""
    run = simulate(read_varied("line", {"simulation.duration": 0.5}))
    head, *rows = [line.split(",") for line in run.csv().splitlines()]
    file, out = tmp_path / "run.csv", str(tmp_path / "run.png")

    def view(names, change=lambda row: row, count=None) -> list[str]:
        places = [head.index(name) for name in names]
        lines = [names, *[change([row[k] for k in places]) for row in rows[:count]]]
        file.write_text("\n".join(",".join(line) for line in lines) + "\n")
        return ["view", str(file), "--spec", "line", "-o", out]

    needed = ["t", "x_c", "y_c", "phi", "thetadot_r", "thetadot_l"]
    assert (
        main(view(needed, count=1)) == 0
        and "labmate: 1 row, 0 s, at the end unknown" in capsys.readouterr().out
    )
    assert main(view(needed)) == 0
    rows[-1][head.index("status")] = "singular"
    assert main(view([*needed, "status"])) == 0 and "at the end singular" in capsys.readouterr().out
    for name in needed:
        assert name in bad_input(view([each for each in needed if each != name]))
    assert "no column x_c; type_iv_line of the SPEC needs it\n" in bad_input(view(["t", *needed[2:]]))
    assert "run.csv has a header but no rows\n" in bad_input(view(needed, count=0))
    assert "x_c that are missing or not finite" in bad_input(view(needed, lambda row: [row[0], "", *row[2:]]))
    assert "times must increase" in bad_input(view(needed, lambda row: ["1.0", *row[1:]]))
