"""Processor in the loop: the generated C runs on an emulated processor, or as a program of this host, and is called from here.

firmware/pil/pil.h says what can be called and how a message looks. The emulator's standard input and output carry them: the
image opens both by semihosting. One image, and one process, for a law and a target; controllers, trackers, dead reckoning and
integrators of that law are objects in it, which here have handles.
"""

from __future__ import annotations

import os
import re
import select
import struct
import subprocess
import weakref
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import IO

import cffi

from ..codegen.targets import STANDARD
from ..model.law import ControlLaw
from ..readers.errors import BadInput
from ..readers.files import children
from .build import built, compiler, runtime_files
from .compiled import Library, library
from .controller import ON_TARGET
from .runtime import Runtime, runtime
from .targets import HOST, SEMIHOSTING, TARGETS, Target, require

FOLDER = Path(__file__).resolve().parent.parent / "firmware" / "pil"
HEADER = (FOLDER / "pil.h").read_text()
# By hand: a parser of C would see no macros, and could not read the header without some law's pil_law.h.
OPERATIONS = re.findall(r"^ +PIL_OP_(\w+)", HEADER, re.M)
FAULTS = re.findall(r"^ +PIL_FAULT_(\w+)", HEADER, re.M)
MAGIC, VERSION = (int(re.findall(rf"define PIL_{name} (\w+?)u", HEADER)[0], 0) for name in ("MAGIC", "VERSION"))
SIZES = re.findall(r"\w+", re.findall(r"typedef struct \{([^}]*)\} pil_hello", HEADER)[0].replace("uint32_t", ""))
REQUEST, ANSWER = struct.Struct("<5I"), struct.Struct("<3IiI")
CALLED = ("noslip_path_f.c", "noslip_status.c")  # what an image needs of the runtime's sources
CHOSEN = """#define PIL_ROBOT(name) {robot}##name##_f
#define PIL_LAW(name) {law}##name##_f
#include "{law}_f.h"
"""
PATIENCE = 30.0  # s, for an answer: a step takes a millionth of it


class TargetFault(BadInput):
    """The program on the target ended, hangs, or answered what is no answer."""


@dataclass(frozen=True)
class Call:
    """One call and its answer, as in pil.h; `operation` in lower case."""

    operation: str
    number: int
    given: bytes
    status: int
    answer: bytes


def image(target: Target, law: Library) -> Path:
    """The program that serves calls of a law on a target. Raises BadInput where a tool is missing."""
    require(target.compiler, *target.machine[:1])
    own = {path.name: path.read_text() for path in FOLDER.glob("*.[ch]")}
    chosen = CHOSEN.format(robot=law.text.robot, law=law.text.prefix)
    files = {**runtime_files(), **target.files(), **law.files, **own, "pil_law.h": chosen}
    sources = [name for name in (*law.files, *own) if name.endswith(".c")]
    command = target.compile() if target.compiler else compiler()
    return built([*command, *STANDARD, "-O2", *sources, *CALLED, *target.start, *target.link()], files, "pil.elf")


class Session:
    """A running image of one law. Raises BadInput where it cannot be built, TargetFault where it does not answer rightly."""

    def __init__(self, target: Target, law: Library):
        self.target = target
        self.log: list[Call] | None = None
        program = image(target, law)
        self._process = subprocess.Popen(
            target.run(str(program), *SEMIHOSTING),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            bufsize=0,
        )
        children.add(self._process)
        self._input, self._output, self._error = _pipes(self._process)
        self.close = weakref.finalize(self, _end, self._process)  # at the latest when Python ends
        told = self.call("hello", 0, b"")[1]
        if len(told) != 4 * len(SIZES):
            raise self._fault(f"says hello with {len(told)} bytes")
        self.sizes = dict(zip(SIZES, struct.unpack(f"<{len(SIZES)}I", told), strict=True))
        counts = {"law": "laws", "path": "paths", "odometry": "odometries", "integral": "integrals"}
        self._free = {kind: list(range(self.sizes[many]))[::-1] for kind, many in counts.items()}

    @property
    def alive(self) -> bool:
        """Can it be called?"""
        return self.close.alive

    def call(self, operation: str, number: int, given: bytes) -> tuple[int, bytes]:
        """Status and words that an operation answers for the object of that number."""
        if not self.alive:
            raise TargetFault(f"{self.target.name}: the program has ended")
        self._write(REQUEST.pack(MAGIC, VERSION, OPERATIONS.index(operation.upper()), number, len(given)) + given)
        magic, version, fault, status, size = ANSWER.unpack(self._read(ANSWER.size))
        if (magic, version) != (MAGIC, VERSION) or fault >= len(FAULTS):
            raise self._fault("sends what is no answer")
        if fault:
            raise self._fault(f"refuses the call {operation} of object {number}, {len(given)} bytes: {FAULTS[fault].lower()}")
        answer = self._read(size)
        if self.log is not None:
            self.log.append(Call(operation, number, given, status, answer))
        return status, answer

    def take(self, kind: str) -> int:
        """The number of an object that nobody uses."""
        if not self._free[kind]:
            raise BadInput(f"{self.target.name}: the image has no room for another {kind}; PIL_... in pil.h say how many it has")
        return self._free[kind].pop()

    def give(self, kind: str, number: int) -> None:
        """Nobody uses it any more."""
        self._free[kind].append(number)

    def _write(self, message: bytes) -> None:
        with suppress(BrokenPipeError):  # then reading finds what it said before it ended
            os.write(self._input.fileno(), message)

    def _read(self, size: int) -> bytes:
        """So many bytes."""
        found, file = b"", self._output.fileno()
        while len(found) < size:
            if not select.select([file], [], [], PATIENCE)[0]:
                raise self._fault(f"has not answered for {PATIENCE:g} s")
            part = os.read(file, size - len(found))
            if not part:
                raise self._fault("has ended")
            found += part
        return found

    def _fault(self, what: str) -> TargetFault:
        """The error, once the program is gone; with what the emulator said last."""
        self._process.kill()
        self._process.wait()
        os.set_blocking(self._error.fileno(), False)  # whoever it started may still have it open
        said = (self._error.read() or b"").decode(errors="replace").strip().splitlines()
        self.close()
        return TargetFault(f"{self.target.name}: the program {what}" + (f" ({said[-1]})" if said else ""))


def _pipes(process: subprocess.Popen[bytes]) -> tuple[IO[bytes], IO[bytes], IO[bytes]]:
    """Its standard input, output and error."""
    assert process.stdin and process.stdout and process.stderr, "each was asked to be a pipe"
    return process.stdin, process.stdout, process.stderr


def _end(process: subprocess.Popen[bytes]) -> None:
    """The program ends by itself where its input does; if not at once, it is made to."""
    children.discard(process)
    given, *told = _pipes(process)
    with suppress(OSError):
        given.close()
    try:
        process.wait(1.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    for pipe in told:
        pipe.close()


_sessions: dict[tuple[ControlLaw, str], Session] = {}


def session(law: ControlLaw, backend: str) -> Session:
    """The image of a law that runs for this backend, started when first wanted."""
    key = law, backend
    if key not in _sessions or not _sessions[key].alive:
        _sessions[key] = Session(TARGETS[ON_TARGET[backend]], library(law, "float"))
    return _sessions[key]


@contextmanager
def recorded(law: ControlLaw, backend: str) -> Iterator[list[Call]]:
    """The calls that go to the image of a law within a block."""
    running = session(law, backend)
    calls: list[Call] = []
    running.log = calls
    try:
        yield calls
    finally:
        running.log = None


def replay_session(law: ControlLaw, backend: str) -> Session:
    """A fresh image to replay calls on; for the backend cf a program of this host."""
    return Session(HOST if backend == "cf" else TARGETS[ON_TARGET[backend]], library(law, "float"))


# -- the faces of the compiled C, with the C elsewhere ---------------------------------------------------------------------


class Handle:
    """An object on the target. `z`: of an integrator, the integral it told last."""

    def __init__(self, session: Session, kind: str):
        self.session, self.number, self.z = session, session.take(kind), 0.0
        weakref.finalize(self, session.give, kind, self.number).atexit = False


Function = Callable[..., int]


def remote(ffi: cffi.FFI, operation: str, kinds: Sequence, inputs: int) -> Function:
    """A C function whose first argument is a handle, called on the target: the next `inputs` arguments go there, pointers with
    what they point to; the others are pointers to what comes back. `kinds` are the C types of all but the handle.
    """

    def call(handle: Handle, *arguments) -> int:
        given = b"".join(_bytes(ffi, kind, value) for kind, value in zip(kinds, arguments[:inputs], strict=False))
        status, answer = handle.session.call(operation, handle.number, given)
        places = [ffi.buffer(pointer) for pointer in arguments[inputs:]]
        at = sum(map(len, places))
        if at + 4 * (operation == "integral_step") != len(answer):
            raise handle.session._fault(f"answers {operation} with {len(answer)} bytes")
        if operation == "integral_step":
            (handle.z,) = struct.unpack_from("<f", answer, at)
        for place in places:
            place[:], answer = answer[: len(place)], answer[len(place) :]
        return status

    return call


def _bytes(ffi: cffi.FFI, kind, value) -> bytes:
    """An argument as it lies in memory."""
    pointer = value if kind.kind == "pointer" else ffi.new(f"{kind.cname} *", value)
    return bytes(ffi.buffer(pointer))


class TargetLibrary(Library):
    """A law's C on a target: types are those of this host, functions are called there."""

    inputs = {"init": 4, "step": 2, "evaluate": 2}

    def __init__(self, law: ControlLaw, backend: str):
        here = library(law, "float")
        self.text, self.ffi, self.lib, self.files = here.text, here.ffi, here.lib, here.files
        self._law, self._backend, self._here = law, backend, here

    def instance(self) -> Handle:
        """As Library's, on the target."""
        return Handle(session(self._law, self._backend), "law")

    def function(self, name: str) -> Function:
        """As Library's, on the target."""
        kinds = self.ffi.typeof(self._here.function(name)).args[1:]
        return remote(self.ffi, f"law_{name}", kinds, self.inputs[name])


class TargetRuntime(Runtime):
    """The C of a header on the target that runs a law, in float; Runtime's face."""

    inputs = {"look": 4, "update": 4, "pose": 0, "move": 2, "correct": 2, "step": 3}

    def __init__(self, header: str, law: ControlLaw, backend: str):
        here = runtime(header)
        self.ffi, self.lib, self._law, self._backend = here.ffi, here.lib, law, backend
        self._kind = header.removeprefix("noslip_").removesuffix(".h")

    def new(self, kind: str, scalar: str, *initial):
        """As Runtime's; the object itself is on the target."""
        if kind == f"noslip_{self._kind}":
            return Handle(session(self._law, self._backend), self._kind)
        return super().new(kind, scalar, *initial)

    def function(self, name: str, scalar: str) -> Function:
        """As Runtime's, on the target."""
        operation = name.removeprefix("noslip_")
        kinds = self.ffi.typeof(super().function(name, scalar)).args[1:]
        if operation == "path_init":
            return self._path_init(remote(self.ffi, operation, kinds[1:], 2))
        return remote(self.ffi, operation, kinds, self.inputs.get(operation.split("_")[1], 2))

    def _path_init(self, init: Function) -> Function:
        """The segments go first, one by one: they stay on the target too."""

        def path_init(handle: Handle, segments, count: int, options, fault) -> int:
            most = handle.session.sizes["segments"]
            if count > most:
                raise BadInput(f"path: it has {count} segments; backend {self._backend} takes {most}")
            for k in range(count):
                segment = bytes(self.ffi.buffer(self.ffi.addressof(segments[k])))
                handle.session.call("path_segment", handle.number, struct.pack("<I", k) + segment)
            return init(handle, count, options, fault)

        return path_init


@lru_cache(maxsize=64)
def target_library(law: ControlLaw, backend: str) -> TargetLibrary:
    """A law's C for a backend that runs on a target, made once per process."""
    return TargetLibrary(law, backend)


@lru_cache(maxsize=64)
def target_runtime(header: str, law: ControlLaw, backend: str) -> TargetRuntime:
    """A header's C for a backend that runs on the target of a law, made once per process."""
    return TargetRuntime(header, law, backend)
