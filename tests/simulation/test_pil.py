"""Processor in the loop: the law on an emulated processor gives the bits of the law on this host,
and errors are said clearly."""

import os
import shutil
import signal
import struct
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from noslip.checks.verification.sampling import random_plants
from noslip.cli.main import main
from noslip.model.segments import Segment
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot, law_of
from noslip.simulation.closed_loop import simulate
from noslip.simulation.controllers import pil
from noslip.simulation.controllers.backends import make_controller
from noslip.simulation.controllers.controller import ON_TARGET, Limits
from noslip.simulation.controllers.odometry import make_odometry
from noslip.simulation.controllers.pil import Session, TargetFault, served_law
from noslip.simulation.controllers.targets import HOST, TARGETS
from noslip.simulation.replay import first_difference, read_record, record_text
from noslip.simulation.specification.spec import (
    ContactSection,
    DriveSection,
    LimitsSection,
    read_spec,
    spec_of,
)
from noslip.tests import firmware
from noslip.tests.runtime_c.test_profile import SPEC as FASTEST
from noslip.tests.runtime_c.test_slip import SENSED
from noslip.tests.tools import skip_without

ROOT = Path(__file__).parents[2]
LAW = law_of(find_robot("labmate"), "type_iv_line")


@pytest.fixture(params=ON_TARGET)
def backend(request) -> str:
    """A backend whose tools are here."""
    skip_without(TARGETS[ON_TARGET[request.param]].missing())
    return request.param


@pytest.fixture(scope="module")
def runs():
    """Short closed loops, and their tables on this host."""
    specs = firmware.runs()
    short = {
        name: replace(spec, simulation=replace(spec.simulation, duration=2.0)) for name, spec in specs.items()
    }
    noticing = (
        FASTEST.replace('mode = "grip"', 'mode = "grip", notice_slip = {}')
        + SENSED
        + "accelerometer = { noise = 0.1 }\n"
    )
    short["fastest"] = spec_of(noticing.replace("11.0,", "1.0,") + "[plant]\nb = 0.8\n", "test")
    short["continuous"] = replace(
        specs["circle"], simulation=replace(specs["circle"].simulation, period=0.0, duration=0.5)
    )
    return {name: (spec, simulate(spec, "cf")) for name, spec in short.items()}


# -- the same bits -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["line", "circle", "composite", "continuous", "grip", "fastest"])
def test_loop(name, backend, runs):
    """The whole table, byte for byte: law, tracker, dead reckoning and integral answer as on this host."""
    spec, here = runs[name]
    assert simulate(spec, backend).csv() == here.csv()
    assert len(here.t) > 40 and here.stopped is None


def test_evaluate_and_step(backend):
    """All quantities at random states, limits that cut, errors with their status;
    two laws do not disturb each other."""
    (plant, other), seen = (list(random_plants(LAW, 40, seed=3))[:2], set())
    limits = Limits((2.0, 3.0), "slow")
    pairs = [
        [make_controller(name, LAW, p.params, p.config, p.gains, limits) for name in ("cf", backend)]
        for p in (plant, other)
    ]
    for point in plant.points:
        for state in (point.state, point.state * np.nan, 1e30 * point.state):
            for here, there in pairs:
                (status, tau), (status_there, tau_there) = (
                    c.step(state, point.reference) for c in (here, there)
                )
                assert status == status_there and tau.tobytes() == tau_there.tobytes()
                found, found_there = (c.evaluate(state, point.reference) for c in (here, there))
                assert found.status == found_there.status
                for name, value in found.values.items():
                    assert value.tobytes() == found_there.values[name].tobytes(), name
                seen.add(status)
    assert {"ok", "saturated", "nonfinite"} <= seen


def test_objects_are_given_back(backend):
    """As many laws one after the other as one likes; at a time no more than the image has."""
    numbers = [[q.default for q in group] for group in (LAW.parameters, LAW.config, LAW.gains)]
    numbers[1][1:] = [1.0, -1.0, 0.0]
    running = pil.session(LAW, backend)
    free = len(running._free["law"])
    for _ in range(5):
        make_controller(backend, LAW, *numbers)
    assert len(running._free["law"]) == free
    kept = [
        make_odometry(backend, (0.1, 0.1), (0.1, -0.1), 0.0, law=LAW) for _ in running._free["odometry"][:]
    ]
    with pytest.raises(BadInput, match="no room for another odometry"):
        make_odometry(backend, (0.1, 0.1), (0.1, -0.1), 0.0, law=LAW)
    del kept
    make_odometry(backend, (0.1, 0.1), (0.1, -0.1), 0.0, law=LAW)


def test_whole_turns_are_taken_off(backend):
    here, there = (
        make_odometry(name, (0.1, 0.1), (0.1, -0.1), 0.3, start=(1.0, 2.0, 50.0), law=LAW)
        for name in ("cf", backend)
    )
    assert here.move((0.5, 0.2), 0.01).tolist() == there.move((0.5, 0.2), 0.01).tolist()
    assert here.unwind().tolist() == there.unwind().tolist() and abs(there.pose[2]) <= np.pi


def test_a_path_that_is_too_long(backend):
    from noslip.simulation.controllers.tracking import TrackerOptions, make_tracker

    path = [Segment(float(k), 0.0, 0.0, 0.0, 1.0) for k in range(513)]
    options = TrackerOptions(speed=1.0, ahead=0.3)
    with pytest.raises(BadInput, match=f"513 segments; backend {backend} takes 512"):
        make_tracker(backend, path, options, LAW)
    here, there = (make_tracker(name, path[:512], options, LAW) for name in ("cf", backend))
    assert here.update(0.5, 0.1, 0.0, 1.0) == there.update(0.5, 0.1, 0.0, 1.0)


# -- a target that answers wrongly, or not at all ------------------------------------------------------------
# Here the target is this host: what answers is the same C, or a shell.


@pytest.fixture
def host():
    """A program of this host."""
    session = Session(HOST, served_law(LAW))
    yield session
    session.close()


def test_protocol_errors_have_a_number(host):
    """Each is answered, and then the program ends."""
    program = pil.image(HOST, served_law(LAW))
    size = host.sizes["state"] + host.sizes["reference"]
    right = [pil.MAGIC, pil.VERSION, pil.OPERATIONS.index("LAW_STEP"), 0, size]
    for place, value, fault in (
        (0, pil.MAGIC ^ 1, "MAGIC"),
        (1, pil.VERSION + 1, "MAGIC"),
        (2, len(pil.OPERATIONS), "OPERATION"),
        (3, host.sizes["laws"], "OBJECT"),
        (3, 2**32 - 1, "OBJECT"),
        (4, size - 4, "SIZE"),
        (4, 2**32 - 1, "SIZE"),
    ):
        request = right.copy()
        request[place] = value
        done = subprocess.run(
            [program], input=struct.pack("<5I", *request) + bytes(size), capture_output=True, timeout=20
        )
        magic, version, found, status, more = struct.unpack("<3IiI", done.stdout)
        assert (magic, version, pil.FAULTS[found], more) == (pil.MAGIC, pil.VERSION, fault, 0) and status < 0
        assert done.returncode == 1
    law_not_made = subprocess.run(
        [program], input=struct.pack("<5I", *right) + bytes(size), capture_output=True, timeout=20
    )
    assert law_not_made.returncode == 0 and struct.unpack("<3IiI", law_not_made.stdout[:20])[2:] == (
        0,
        -6,
        12,
    )
    halved = subprocess.run([program], input=struct.pack("<5I", *right)[:13], capture_output=True, timeout=20)
    assert halved.returncode == 1 and halved.stdout == b""


def test_a_call_that_is_refused(host):
    with pytest.raises(TargetFault, match="rejects the call law_step of object 5000, 48 bytes: object"):
        host.call("law_step", 5000, bytes(48))
    with pytest.raises(TargetFault, match="has ended"):
        host.call("hello", 0, b"")


@pytest.mark.parametrize(
    ("script", "said"),
    [
        ("exit 3", "has ended"),
        ("exec 0<&-; head -c 20 /dev/zero; exec sleep 60", "sends an invalid answer"),
        ("echo it hurts >&2; exit 3", r"has ended \(it hurts\)"),
        ("exec sleep 60", "has not answered for 1 s"),
        ("head -c 20 /dev/zero", "sends an invalid answer"),
        (
            "printf 'NPIL\\001\\0\\0\\0\\0\\0\\0\\0\\0\\0\\0\\0\\004\\0\\0\\0abcd'; exec sleep 60",
            "sends an initial answer of 4 bytes",
        ),
        (
            "printf 'NPIL\\001\\0\\0\\0\\003\\0\\0\\0\\0\\0\\0\\0\\0\\0\\0\\0'; exec sleep 60",
            "rejects the call hello of object 0, 0 bytes",
        ),
        ("printf 'NPIL\\001\\0\\0\\0'; exec sleep 60", "has not answered for 1 s"),
    ],
)
def test_a_target_out_of_order(script, said, tmp_path, monkeypatch):
    """One error, and no process is left."""
    program = tmp_path / "image"
    program.write_text(f"#!/bin/sh\necho $$ > {tmp_path}/pid\n{script}\n")
    program.chmod(0o755)
    monkeypatch.setattr(pil, "image", lambda *_: program)
    monkeypatch.setattr(pil, "PATIENCE", 1)
    with pytest.raises(TargetFault, match=f"^host: the program {said}"):
        Session(HOST, served_law(LAW))
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "pid").read_text()), 0)


def test_a_program_that_ended_is_started_again(backend):
    before = pil.session(LAW, backend)
    before._process.kill()
    before._process.wait()
    with pytest.raises(TargetFault, match="the program has ended"):
        before.call("hello", 0, b"")
    assert pil.session(LAW, backend).call("hello", 0, b"")[0] == 0


def test_missing_tools(bad_input, monkeypatch, tmp_path):
    """Which tool, and where it is to be had."""
    monkeypatch.setattr(pil, "_sessions", {})
    of_target, which = {"m4f": "arm-none-eabi-gcc", "rv32": "riscv64-unknown-elf-gcc"}, shutil.which
    monkeypatch.setattr("shutil.which", lambda tool: None if tool in of_target.values() else which(tool))
    for backend, tool in of_target.items():
        setting = f'simulation.backend="{backend}"'
        argv = [
            "simulate",
            str(ROOT / "examples/specs/line.toml"),
            "--set",
            setting,
            "-o",
            str(tmp_path / "x"),
        ]
        line = bad_input(argv)
        assert (
            f"{tool} is not installed" in line
            and f"package gcc-{'arm' if backend == 'm4f' else 'riscv64'}" in line
        )


def test_interrupt_leaves_nothing(backend, tmp_path):
    """Ctrl-C while the target computes for ever: exit 130, no file, no emulator."""
    spec = ROOT / "examples/specs/line.toml"
    settings = [
        "--set",
        f'simulation.backend="{backend}"',
        "--set",
        "simulation.duration=1e4",
        "--set",
        "simulation.period=0.01",
    ]
    command = [
        str(Path(sys.executable).parent / "noslip"),
        "simulate",
        str(spec),
        *settings,
        "-o",
        str(tmp_path / "run.csv"),
    ]
    run = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    deadline = time.monotonic() + 60
    while not (emulators := _children(run.pid)) and time.monotonic() < deadline:
        time.sleep(0.05)
    for child in emulators:
        os.kill(child, signal.SIGSTOP)  # as one that hangs
    run.send_signal(signal.SIGINT)
    assert run.wait(20) == 130 and "interrupted" in run.stderr.read()
    assert emulators and not any(_runs(child) for child in emulators) and not list(tmp_path.iterdir())


def _children(pid: int) -> list[int]:
    """The emulators that a process started."""
    found = subprocess.run(
        ["ps", "-o", "pid=,comm=", "--ppid", str(pid)], capture_output=True, text=True
    ).stdout.splitlines()
    return [int(line.split()[0]) for line in found if "qemu" in line]


def _runs(pid: int) -> bool:
    deadline = time.monotonic() + 5
    while time.monotonic() < deadline:
        state = subprocess.run(["ps", "-o", "stat=", "-p", str(pid)], capture_output=True, text=True).stdout
        if not state or state.startswith("Z"):
            return False
        time.sleep(0.05)
    return True


# -- record and replay ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def record(tmp_path_factory):
    """The text of a record. It is made on this host: what an image answers is the same,
    which test_loop and others see to."""
    spec = firmware.runs()["line"]
    session = Session(HOST, served_law(LAW))
    session.log = calls = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pil, "session", lambda *_: session)
        simulate(replace(spec, simulation=replace(spec.simulation, duration=0.2)), "m4f")
    session.close()
    return record_text("labmate", LAW, calls)


def replayed(text: str, tmp_path, capsys, *more: str) -> tuple[int, str]:
    """Exit code, and what is said."""
    file = tmp_path / "record.txt"
    file.write_text(text)
    code = main(["replay", str(file), *more])
    out, err = capsys.readouterr()
    return code, out + err


def test_replay(record, tmp_path, capsys):
    code, said = replayed(record, tmp_path, capsys)
    assert code == 0 and f"{len(record.splitlines()) - 5} calls, the same bits on cf" in said
    assert "law_init 0 " in record and record.count("law_step 0 ") > 20


def test_reading_and_replaying_tell_how_far_they_are(record, tmp_path):
    file, told = tmp_path / "record.txt", []
    file.write_text(record)
    read = read_record(str(file), progress=lambda *each: told.append(each))
    count = len(read.calls)
    assert told == [(done, count, "calls read") for done in range(1, count + 1)]
    told.clear()
    session = Session(HOST, served_law(LAW))
    assert first_difference(read, session, "cf", lambda *each: told.append(each)) is None
    session.close()
    assert told == [(done, count, "calls repeated") for done in range(count)]


def test_replay_on_a_target(record, backend, tmp_path, capsys):
    code, said = replayed(record, tmp_path, capsys, "--backend", backend)
    assert code == 0 and f"the same bits on {backend}" in said


def test_replay_finds_the_first_difference(record, tmp_path, capsys):
    """One bit of an answer, the status, one bit of what was given: the first line that differs is told."""
    lines = record.splitlines()
    k = next(k for k, line in enumerate(lines) if k > 15 and line.startswith("law_step"))
    last = format(int(lines[k][-8:], 16) ^ 1, "08x")
    words = lines[k].split()
    other = " ".join([*words[:2], format(int(words[2], 16) ^ 0x8000, "08x"), *words[3:]])
    for line, said in (
        (lines[k][:-8] + last, f"line {k + 1}: law_step 0: number 3 of the result was {last} ("),
        (lines[k].replace("-> 0", "-> 1"), f"line {k + 1}: law_step 0 returned status 1, on cf 0"),
        (other, f"line {k + 1}: law_step 0: number 1 of the result"),
    ):
        changed = "\n".join([*lines[:k], line, *lines[k + 1 :]]) + "\n"
        code, found = replayed(changed, tmp_path, capsys)
        assert code == 1 and said in found


def test_replay_refuses_what_is_damaged(record, tmp_path, capsys):
    """Exit 2 and one line: not a record, cut off, another model, no number, numbers too few."""
    lines = record.splitlines()
    k = next(k for k, line in enumerate(lines) if line.startswith("law_step"))

    def but(number: int, line: str) -> str:
        return "\n".join([*lines[:number], line, *lines[number + 1 :]]) + "\n"

    for text, said in (
        ("", "its first line is not"),
        ("\n".join(lines[:1]), "expected 'robot'"),
        ("\n".join(lines[:-1]), "incomplete"),
        ("\n".join(lines[:20]), "incomplete"),
        ("\n".join([*lines[:k], *lines[k + 1 :]]), "incomplete"),
        (but(1, "robot labmat"), "labmat"),
        (but(2, "law type_v"), "type_v"),
        (but(3, "model " + "0" * 64), "another model"),
        (but(k, lines[k].replace("->", "-")), f"{k + 1}: not a call"),
        (but(k, lines[k].replace("law_step", "law_stop")), f"{k + 1}: not a call"),
        (but(k, lines[k] + "0"), f"{k + 1}: not a call"),
        (but(k, lines[k][:-1] + "g"), f"{k + 1}: not a call"),
        (but(k, lines[k].replace("law_step 0", "law_step -1")), f"{k + 1}: not a call"),
        (but(k, lines[k].replace("law_step 0", "law_step 4000")), f"line {k + 1}: "),
        (but(k, lines[k].replace("law_step 0", "law_step 0 00000000")), f"line {k + 1}: "),
        (but(k, lines[k] + " 00000000"), f"line {k + 1}: law_step 0 has 4 numbers as result; it must have 3"),
    ):
        code, found = replayed(text, tmp_path, capsys)
        assert code == 2 and said in found and found.count("\n") == 1, found


def test_record_needs_a_target(bad_input, tmp_path):
    out, record = str(tmp_path / "run.csv"), str(tmp_path / "record.txt")
    line = bad_input(["simulate", str(ROOT / "examples/specs/line.toml"), "-o", out, "--record", record])
    assert "--record requires [simulation] backend" in line


def test_record_of_a_run(backend, tmp_path, capsys):
    """From the command line: run, record, replay."""
    out, record = str(tmp_path / "run.csv"), str(tmp_path / "record.txt")
    settings = [
        "--set",
        f'simulation.backend="{backend}"',
        "--set",
        "simulation.period=0.05",
        "--set",
        "simulation.duration=0.5",
    ]
    assert (
        main(["simulate", str(ROOT / "examples/specs/line.toml"), *settings, "-o", out, "--record", record])
        == 0
    )
    assert main(["replay", record]) == 0
    assert "the same bits on cf" in capsys.readouterr().out


# -- make firmware-test --------------------------------------------------------------------------------------


def test_a_failing_image_is_seen(backend, capsys):
    """Exit codes of programs come through; one that fails is counted, and makes the whole fail."""
    target = TARGETS[ON_TARGET[backend]]
    assert firmware.exit_codes(target) == "exit codes 0, 3, 255"
    report = firmware.Report()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(firmware, "PROGRAMS", {"return 3;": 0})
        report.take("programs", lambda: firmware.exit_codes(target), [])
    assert (report.right, report.wrong) == (0, 1) and "ends with 3, not 0" in capsys.readouterr().out


def test_what_is_missing_is_skipped_or_wrong(monkeypatch, capsys):
    for asked, wrong in (("0", 0), ("1", 1)):
        monkeypatch.setenv("NOSLIP_REQUIRE_FIRMWARE", asked)
        report = firmware.Report()
        report.take("programs", lambda: pytest.fail("not to be run"), ["qemu-system-arm"])
        assert (report.right, report.wrong, report.skipped) == (0, wrong, 1)
    assert "skipped: qemu-system-arm not installed" in capsys.readouterr().out


@pytest.mark.parametrize("kind", ["velocity", "kinematic"])
def test_velocity_drives_on_the_processor(kind, backend):
    """Commands of the target are those of the host's float, to the bit: the law, the dynamics,
    and the limits of the vehicle."""
    spec = read_spec(ROOT / "examples/specs/circle.toml")
    drive = DriveSection(kind=kind, bandwidth=5.0, delay=0.013, most_speed=(9.0,), most_acceleration=(20.0,))
    limits = LimitsSection(mode="grip") if kind == "kinematic" else None
    simulation = replace(spec.simulation, period=0.01, duration=0.3, output_step=0.01)
    spec = replace(
        spec, drive=drive, limits=limits, contact=ContactSection(mu=0.3), gains={}, simulation=simulation
    )
    here, there = simulate(spec, "cf"), simulate(spec, backend)
    assert (
        (there.command == here.command).all()
        and (there.x == here.x).all()
        and (there.status == here.status).all()
    )
    assert np.abs(here.command).max() > 1.0
