"""Processor in the loop: the generated C runs on an emulated processor, or as a program of this host, and is
called from here.

firmware/pil/pil.h defines the operations and the format of the messages, which use the emulator's standard
input and output; the image opens both by semihosting. There is one image, and one process, for a law, or a
state feedback, and a target. Controllers, trackers, speed profiles, odometry, integrators, approaches, what
notices slip and commands of velocity drives of that law are objects in it, represented here by handles.
"""

from __future__ import annotations

import os
import re
import select
import struct
import subprocess
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from threading import Lock
from typing import IO

import cffi
import numpy as np

from ...codegen.runtime import runtime_files
from ...codegen.targets import STANDARD
from ...model.law import ControlLaw
from ...readers.errors import BadInput
from ...readers.files import children
from .build import built, compiler
from .compiled import DynamicsLibrary, Library, dynamics_library, library
from .controller import ON_TARGET
from .runtime import Runtime, runtime
from .targets import HOST, SEMIHOSTING, TARGETS, Target, require

FOLDER = Path(__file__).resolve().parents[2] / "firmware" / "pil"
HEADER = (FOLDER / "pil.h").read_text(encoding="utf-8")
# By hand: a parser of C would see no macros, and could not read the header without some law's pil_law.h.
OPERATIONS = re.findall(r"^ +PIL_OP_(\w+)", HEADER, re.M)
FAULTS = re.findall(r"^ +PIL_FAULT_(\w+)", HEADER, re.M)
MAGIC, VERSION = (
    int(re.findall(rf"define PIL_{name} (\w+?)u", HEADER)[0], 0) for name in ("MAGIC", "VERSION")
)
SIZES = re.findall(
    r"\w+", re.findall(r"typedef struct \{([^}]*)\} pil_hello", HEADER)[0].replace("uint32_t", "")
)
REQUEST, ANSWER = struct.Struct("<5I"), struct.Struct("<3IiI")
CALLED = ("noslip_path_f.c", "noslip_status.c")  # sources of the runtime that an image contains
CHOSEN = """#define PIL_ROBOT(name) {robot}##name##_f
#define PIL_LAW(name) {law}##name##_f
#define PIL_GRIP {grip}
#define PIL_EXTENSION {extends}
#include "{law}_f.h"
"""
DYNAMICS = """#define PIL_DYNAMICS(name) {robot}_dynamics##name##_f
#define PIL_COORDINATES {coordinates}
#define PIL_DOF {dof}
#include "{robot}_dynamics_f.h"
"""
PATIENCE = 30.0  # s, timeout of an answer; a step takes a millionth of it


class TargetFault(BadInput):
    """The program on the target has ended, hangs, or sends an invalid answer."""


@dataclass(frozen=True)
class Call:
    """One call and its result, as in pil.h; `operation` in lower case."""

    operation: str
    number: int
    given: bytes
    status: int
    answer: bytes


@dataclass(frozen=True, eq=False)
class Served:
    """Generated C that an image serves: its `files` (name -> text),
    and the text of pil_law.h that chooses it."""

    files: Mapping[str, str]
    chosen: str


@cache
def served_law(law: ControlLaw) -> Served:
    """Return what an image of a law serves: the law and, unless it is kinematic,
    the dynamics of its robot."""
    made = library(law, "float")
    has_grip = "grip" in [name for name, _ in made.ffi.typeof(made.name("")).fields]
    chosen = CHOSEN.format(
        robot=made.text.robot, law=made.text.prefix, grip=int(has_grip), extends=made.text.extends
    )
    if law.kinematic:
        return Served(made.files, chosen)
    sizes = {"coordinates": len(law.system.mechanism.coordinates), "dof": law.system.dof}
    files = {**made.files, **dynamics_library(law.system, "float").files}
    return Served(files, chosen + DYNAMICS.format(robot=made.text.robot, **sizes))


def image(target: Target, served: Served) -> Path:
    """Return the program that serves calls of generated C on a target. Raises BadInput if a tool is
    missing."""
    require(target.compiler, *target.machine[:1])
    own = {path.name: path.read_text(encoding="utf-8") for path in FOLDER.glob("*.[ch]")}
    files = {**runtime_files(), **target.files(), **served.files, **own, "pil_law.h": served.chosen}
    sources = [name for name in (*served.files, *own) if name.endswith(".c")]
    command = target.compile() if target.compiler else compiler()
    return built(
        [*command, *STANDARD, "-O2", *sources, *CALLED, *target.start, *target.link()], files, "pil.elf"
    )


class Session:
    """A running image. Raises BadInput if it cannot be built,
    TargetFault if it does not respond correctly."""

    def __init__(self, target: Target, served: Served):
        self.target = target
        self.log: list[Call] | None = None
        program = image(target, served)
        self._process = subprocess.Popen(
            target.run(str(program), *SEMIHOSTING),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            bufsize=0,
        )
        children.add(self._process)
        self._input, self._output, self._error = _pipes(self._process)
        self._lock = Lock()
        self.close = weakref.finalize(self, _end, self._process)  # at the latest at the exit of Python
        sizes = self.call("hello", 0, b"")[1]
        if len(sizes) != 4 * len(SIZES):
            raise self._fault(f"sends an initial answer of {len(sizes)} bytes")
        self.sizes = dict(zip(SIZES, struct.unpack(f"<{len(SIZES)}I", sizes), strict=True))
        counts = {
            "law": "laws",
            "path": "paths",
            "odometry": "odometries",
            "integral": "integrals",
            "approach": "approaches",
        }
        counts |= {
            "slip": "slips",
            "velocity": "velocities",
            "dynamics": "dynamics",
            "disturbance": "disturbances",
        }
        counts |= {"feedback": "feedbacks"}
        self._free = {kind: list(range(self.sizes[many]))[::-1] for kind, many in counts.items()}

    @property
    def alive(self) -> bool:
        """Return whether it can be called."""
        return self.close.alive

    def call(self, operation: str, number: int, given: bytes) -> tuple[int, bytes]:
        """Return status and result of an operation on the object of that number. Thread-safe."""
        with self._lock:
            return self._call(operation, number, given)

    def _call(self, operation: str, number: int, given: bytes) -> tuple[int, bytes]:
        if not self.alive:
            raise TargetFault(f"{self.target.name}: the program has ended")
        self._write(
            REQUEST.pack(MAGIC, VERSION, OPERATIONS.index(operation.upper()), number, len(given)) + given
        )
        magic, version, fault, status, size = ANSWER.unpack(self._read(ANSWER.size))
        if (magic, version) != (MAGIC, VERSION) or fault >= len(FAULTS):
            raise self._fault("sends an invalid answer")
        if fault:
            raise self._fault(
                f"rejects the call {operation} of object {number}, {len(given)} bytes: "
                f"{FAULTS[fault].lower()}"
            )
        answer = self._read(size)
        if self.log is not None:
            self.log.append(Call(operation, number, given, status, answer))
        return status, answer

    def take(self, kind: str) -> int:
        """Return the number of an unused object."""
        if not self._free[kind]:
            raise BadInput(
                f"{self.target.name}: the image has no room for another {kind}; PIL_... in pil.h defines "
                "their number"
            )
        return self._free[kind].pop()

    def give(self, kind: str, number: int) -> None:
        """Mark an object as unused."""
        self._free[kind].append(number)

    def _write(self, message: bytes) -> None:
        with suppress(BrokenPipeError):  # then reading returns what it printed before it ended
            os.write(self._input.fileno(), message)

    def _read(self, size: int) -> bytes:
        """Return `size` bytes from the program."""
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
        """Return the error after ending the program, with the last message of the emulator."""
        self._process.kill()
        self._process.wait()
        os.set_blocking(self._error.fileno(), False)  # a child process may still have it open
        said = (self._error.read() or b"").decode(errors="replace").strip().splitlines()
        self.close()
        return TargetFault(f"{self.target.name}: the program {what}" + (f" ({said[-1]})" if said else ""))


def _pipes(process: subprocess.Popen[bytes]) -> tuple[IO[bytes], IO[bytes], IO[bytes]]:
    """Return its standard input, output and error."""
    assert process.stdin and process.stdout and process.stderr, "each was asked to be a pipe"
    return process.stdin, process.stdout, process.stderr


def _end(process: subprocess.Popen[bytes]) -> None:
    """End the program: it exits at the end of its input, and is killed if it does not exit soon."""
    children.discard(process)
    given, *others = _pipes(process)
    with suppress(OSError):
        given.close()
    try:
        process.wait(1.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    for pipe in others:
        pipe.close()


_sessions: dict[tuple[Served, str], Session] = {}


def session_of(served: Served, backend: str) -> Session:
    """Return the running image of generated C for this backend, started at the first use."""
    key = served, backend
    if key not in _sessions or not _sessions[key].alive:
        _sessions[key] = Session(TARGETS[ON_TARGET[backend]], served)
    return _sessions[key]


def session(law: ControlLaw, backend: str) -> Session:
    """Return the running image of a law for this backend, started at the first use."""
    return session_of(served_law(law), backend)


@contextmanager
def recorded(law: ControlLaw, backend: str) -> Iterator[list[Call]]:
    """Record the calls to the image of a law within a block."""
    running = session(law, backend)
    calls: list[Call] = []
    running.log = calls
    try:
        yield calls
    finally:
        running.log = None


def replay_session(law: ControlLaw, backend: str) -> Session:
    """Return a new image to replay calls on; for the backend cf, a program of this host."""
    return Session(HOST if backend == "cf" else TARGETS[ON_TARGET[backend]], served_law(law))


# -- the interfaces of the compiled C, with the C on a target ------------------------------------------------


class Handle:
    """An object on the target. `z`: for an integrator, the last integral returned; `extension` and
    `extension_rate`: for a law, the states of its dynamic extension, which are sent with each call, and their
    rates at the last step; `believed`: the friction that it believes since then, if it keeps grip.
    """

    extension = extension_rate = believed = np.zeros(0, np.float32)

    def __init__(self, session: Session, kind: str):
        self.session, self.number, self.z = session, session.take(kind), 0.0
        weakref.finalize(self, session.give, kind, self.number).atexit = False


Function = Callable[..., int]


def remote(ffi: cffi.FFI, operation: str, kinds: Sequence, inputs: int) -> Function:
    """Return a C function whose first argument is a handle, called on the target: the next `inputs` arguments
    are sent, pointers with the data they point to; the others are pointers for results. `kinds` are the C
    types of all arguments but the handle.
    """

    def call(handle: Handle, *arguments) -> int:
        given = b"".join(
            _bytes(ffi, kind, value) for kind, value in zip(kinds, arguments[:inputs], strict=False)
        )
        if operation in ("law_step", "law_evaluate"):
            given += handle.extension.tobytes()
        status, answer = handle.session.call(operation, handle.number, given)
        places = [ffi.buffer(pointer) for pointer in arguments[inputs:]]
        at = sum(map(len, places))
        more = {"integral_step": 4, "law_step": handle.extension_rate.nbytes + handle.believed.nbytes}.get(
            operation, 0
        )
        if at + more != len(answer):
            raise handle.session._fault(f"answers {operation} with {len(answer)} bytes")
        if operation == "integral_step":
            (handle.z,) = struct.unpack_from("<f", answer, at)
        elif more:
            found, count = np.frombuffer(answer, np.float32, offset=at), len(handle.extension_rate)
            handle.extension_rate[:], handle.believed[:] = found[:count], found[count:]
        for place in places:
            place[:], answer = answer[: len(place)], answer[len(place) :]
        return status

    return call


def _bytes(ffi: cffi.FFI, kind, value) -> bytes:
    """Return an argument as its bytes in memory."""
    pointer = value if kind.kind == "pointer" else ffi.new(f"{kind.cname} *", value)
    return bytes(ffi.buffer(pointer))


class TargetLibrary(Library):
    """A law's C on a target: the types are those of this host, the functions are called on the target."""

    inputs = {"init": 4, "step": 2, "evaluate": 2}

    def __init__(self, law: ControlLaw, backend: str):
        here = library(law, "float")
        vars(self).update(vars(here))
        self._law, self._backend, self._here = law, backend, here

    def instance(self) -> Handle:
        """As Library.instance, on the target."""
        handle = Handle(session(self._law, self._backend), "law")
        handle.extension, handle.extension_rate = (
            np.zeros(len(self._law.extension), np.float32) for _ in range(2)
        )
        handle.believed = np.zeros(int(self._here.text.grips), np.float32)
        return handle

    @staticmethod
    def believed(instance: Handle) -> float:
        """As Library.believed: 0 before the first step."""
        return float(instance.believed[0])

    def set_friction(self, instance: Handle, mu: float) -> None:
        """As Library.set_friction, on the target."""
        instance.session.call("law_friction", instance.number, np.float32(mu).tobytes())

    def function(self, name: str) -> Function:
        """As Library.function, on the target."""
        kinds = self.ffi.typeof(self._here.function(name)).args[1:]
        timed = name == "step" and bool(self._law.extension)  # the step takes dt too
        return remote(self.ffi, f"law_{name}", kinds, self.inputs[name] + timed)

    def numbers(self, place) -> np.ndarray:
        """As Library.numbers; of arrays that a handle keeps here, these themselves."""
        return place if isinstance(place, np.ndarray) else super().numbers(place)


class TargetDynamics(DynamicsLibrary):
    """The C of the dynamics of a law's robot on the target that runs the law, as `TargetLibrary`."""

    inputs = {"init": 1, "acceleration": 2}

    def __init__(self, law: ControlLaw, backend: str):
        here = dynamics_library(law.system, "float")
        vars(self).update(vars(here))
        self._law, self._backend, self._here = law, backend, here

    def instance(self) -> Handle:
        """As DynamicsLibrary.instance, on the target."""
        return Handle(session(self._law, self._backend), "dynamics")

    def function(self, name: str) -> Function:
        """As DynamicsLibrary.function, on the target."""
        kinds = self.ffi.typeof(self._here.function(name)).args[1:]
        return remote(self.ffi, f"dynamics_{name}", kinds, self.inputs[name])


class TargetRuntime(Runtime):
    """The C of a header on the target that runs a law, in float, with the interface of Runtime."""

    inputs = {  # 2 for the others
        **{"path_look": 4, "path_update": 4, "odometry_pose": 0, "odometry_unwind": 0},
        **{
            "integral_step": 3,
            "approach_init": 3,
            "approach_start": 3,
            "slip_trust": 0,
            "disturbance_step": 4,
        },
        **{
            "velocity_init": 3,
            "velocity_set_vehicle": 1,
            "velocity_reset": 1,
            "velocity_step": 4,
            "velocity_follow": 4,
        },
    }
    kinds = {"profile": "path"}  # of an object that shares the numbers, and the segments, of others

    def __init__(self, header: str, law: ControlLaw, backend: str):
        here = runtime(header)
        self.ffi, self.lib, self._law, self._backend = here.ffi, here.lib, law, backend
        self._kind = header.removeprefix("noslip_").removesuffix(".h")

    def new(self, kind: str, scalar: str, *initial):
        """As Runtime.new; the object itself is on the target."""
        if kind == f"noslip_{self._kind}":
            return Handle(session(self._law, self._backend), self.kinds.get(self._kind, self._kind))
        return super().new(kind, scalar, *initial)

    def function(self, name: str, scalar: str) -> Function:
        """As Runtime.function, on the target."""
        operation = name.removeprefix("noslip_")
        kinds = self.ffi.typeof(super().function(name, scalar)).args[1:]
        if operation == "path_init":
            return self._with_segments(remote(self.ffi, operation, kinds[1:], 2))
        if operation == "profile_init":
            return self._with_segments(remote(self.ffi, operation, kinds[1:], 3), 1)
        return remote(self.ffi, operation, kinds, self.inputs.get(operation, 2))

    def _with_segments(self, init: Function, local: int = 0) -> Function:
        """Send the segments first, one by one: they are stored on the target too,
        as the last `local` arguments are."""

        def init_with_segments(handle: Handle, segments, count: int, *arguments) -> int:
            most = handle.session.sizes["segments"]
            if count > most:
                raise BadInput(f"path: it has {count} segments; backend {self._backend} takes {most}")
            for k in range(count):
                segment = bytes(self.ffi.buffer(self.ffi.addressof(segments[k])))
                handle.session.call("path_segment", handle.number, struct.pack("<I", k) + segment)
            return init(handle, count, *arguments[: len(arguments) - local])

        return init_with_segments


@lru_cache(maxsize=64)
def target_library(law: ControlLaw, backend: str) -> TargetLibrary:
    """Return a law's C for a backend that runs on a target, created once per process."""
    return TargetLibrary(law, backend)


@lru_cache(maxsize=16)
def target_dynamics(law: ControlLaw, backend: str) -> TargetDynamics:
    """Return the C of the dynamics of a law's robot for a backend that runs on a target,
    created once per process."""
    return TargetDynamics(law, backend)


@lru_cache(maxsize=64)
def target_runtime(header: str, law: ControlLaw, backend: str) -> TargetRuntime:
    """Return a header's C for a backend that runs on the target of a law, created once per process."""
    return TargetRuntime(header, law, backend)
