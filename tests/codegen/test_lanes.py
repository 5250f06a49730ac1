"""The batch laws: every lane has the bits and the status of a step of its own."""

import subprocess
from functools import cache
from pathlib import Path

import cffi
import noslip
import numpy as np
import pytest
from noslip.codegen.files import law_program, law_text, shared_files
from noslip.codegen.printing.lanes_c import FOLDER, LanesC
from noslip.codegen.printing.law_c import runtime_types
from noslip.codegen.printing.robot_c import robot_declarations
from noslip.codegen.printing.scalar import SCALARS
from noslip.codegen.runtime import RUNTIME
from noslip.codegen.targets import STANDARD
from noslip.model.outputs import OUTPUTS
from noslip.readers.robots import find_robot, law_of
from noslip.tests.tools import HOST_CC, need

ROOT = Path(noslip.__file__).parent
STRICT = "-Wall -Wextra -Wpedantic -Wconversion -Wshadow -Wdouble-promotion -Werror".split()
SPECIAL = (0.0, -0.0, 1e-30, 1e5, 1e30, -np.inf, np.nan)
COUNT = 1000  # no multiple of the lanes of a loop


@cache
def vectors() -> list[str]:
    """Flags for vector instructions that this processor has."""
    known = Path("/proc/cpuinfo")
    return ["-mavx2"] if known.exists() and " avx2 " in known.read_text(encoding="utf-8") else []


class Batch:
    """A law's step and batch law in one scalar, compiled with the flags that vectorize."""

    def __init__(self, name: str, scalar: str, folder: Path, cc: str = HOST_CC, change=lambda text: text):
        self.law, self.scalar = law_of(find_robot("labmate"), name), SCALARS[scalar]
        program, self.ffi = law_program(self.law), cffi.FFI()
        text, lanes = law_text(program, self.scalar), LanesC(program, self.scalar, [])
        self.prefix, self.type = text.prefix, np.dtype(scalar.replace("float", "f4").replace("double", "f8"))
        written = {Path(name).name: change(content) for name, content in lanes.files().items()}
        files = {**shared_files(self.law.system, self.scalar), **text.files(), **written}
        for file, content in files.items():
            (folder / file).write_text(content)
        sources = [*(file for file in files if file.endswith(".c")), str(RUNTIME / "noslip_status.c")]
        flags = [*STANDARD, *STRICT, "-O3", *vectors(), "-fno-math-errno", "-fPIC", "-shared", f"-I{RUNTIME}"]
        subprocess.run([need(cc), *flags, *sources, "-o", "batch.so"], cwd=folder, check=True)
        self.ffi.cdef(runtime_types(self.scalar))
        self.ffi.cdef(
            robot_declarations(self.law.system, self.scalar) + text.declarations() + lanes.declarations()
        )
        self.lib = self.ffi.dlopen(str(folder / "batch.so"))

    def call(self, name: str, *arguments):
        return getattr(self.lib, self.scalar.name(name))(*arguments)

    def made(self, group: str, values):
        """A struct of the law, filled in the order of its fields."""
        struct = self.ffi.new(f"{self.scalar.name(group)} *")
        for (field, _), value in zip(self.ffi.typeof(struct).item.fields, values, strict=True):
            setattr(struct, field, float(value))
        return struct

    def start(self, on_error: int, on_limit: int, limit: float):
        """An initialized law, with its options."""
        robot, law = self.law.system.mechanism.name, self.ffi.new(f"{self.scalar.name(self.prefix)} *")
        params = self.made(f"{robot}_params", [q.default for q in self.law.parameters])
        groups = [
            self.made(f"{self.prefix}_{group}", [q.default for q in self.law.groups[group]])
            for group in ("config", "gains")
        ]
        options = self.ffi.new(
            f"{self.scalar.name(robot + '_options')} *", {"on_error": on_error, "on_limit": on_limit}
        )
        options.limit[0] = options.limit[1] = limit
        options.friction.mu = 0.7
        assert self.call(f"{self.prefix}_init", law, params, *groups, options) == 0
        return law

    def compare(self, law, state: np.ndarray, reference: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return the statuses of the lanes after comparing them and all inputs with those of single steps,
        bit by bit."""
        count = state.shape[1]
        made, status = tau.copy(), np.full(count, 99, np.int32)
        ours = self.ffi.from_buffer(f"{self.scalar.real}[]", made)
        given = [self.ffi.from_buffer(f"{self.scalar.real}[]", array) for array in (state, reference)]
        least = self.call(
            f"{self.prefix}_steps", law, count, *given, ours, self.ffi.from_buffer("int[]", status)
        )
        assert least == min(0, status.min())
        one, torque = (
            self.ffi.new(f"{self.scalar.name(self.prefix)} *"),
            self.ffi.new(f"{self.scalar.real}[2]"),
        )
        robot = self.law.system.mechanism.name
        for k in range(count):
            one[0] = law[0]
            one.held = list(map(float, tau[:, k]))
            at, wanted = (
                self.made(f"{robot}_state", state[:, k]),
                self.made(f"{self.prefix}_reference", reference[:, k]),
            )
            assert self.call(f"{self.prefix}_step", one, at, wanted, torque) == status[k], k
            assert np.array(list(torque), self.type).tobytes() == made[:, k].tobytes(), k
        return status

    def random(self, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """States, references and held inputs: random, in every fourth lane one special value,
        in others arbitrary bits."""
        source = np.random.default_rng(seed)
        sizes = len(self.law.state), len(self.law.reference)
        both = source.uniform(-4, 4, (sum(sizes), COUNT))
        special = np.arange(0, COUNT, 4)
        both[source.integers(sum(sizes), size=special.size), special] = source.choice(SPECIAL, special.size)
        both[:, :20] = 0  # singular for some laws
        both = both.astype(self.type)
        both[:, 1::8] = np.frombuffer(source.bytes(both[:, 1::8].nbytes), self.type).reshape(
            both[:, 1::8].shape
        )
        state, reference = np.split(both, [sizes[0]])
        return (
            np.ascontiguousarray(state),
            np.ascontiguousarray(reference),
            source.uniform(-1, 1, (2, COUNT)).astype(self.type),
        )


CHOSEN = [("type_iv_ellipse", "double", "gcc"), ("type_i", "float", "clang")]
ALL = [(name, scalar, cc) for name in OUTPUTS for scalar in SCALARS for cc in ("gcc", "clang")]


@pytest.mark.parametrize(
    "name, scalar, cc",
    [*CHOSEN, *(pytest.param(*each, marks=pytest.mark.nightly) for each in ALL if each not in CHOSEN)],
)
def test_lanes_are_steps(name, scalar, cc, tmp_path):
    """Bits and status of every lane, for all choices of limits and of what an error gives,
    and before init."""
    batch = Batch(name, scalar, tmp_path, cc)
    seen = set()
    for seed, (on_error, on_limit, limit) in enumerate(
        [(0, 0, 0.0), (1, 0, 5.0), (0, 1, 20.0), (1, 2, 20.0)]
    ):
        if on_limit == 1 and batch.law.speed_row is None:
            continue
        seen |= set(batch.compare(batch.start(on_error, on_limit, limit), *batch.random(seed)).tolist())
    assert {0, 1, -2} <= seen, seen
    none = batch.ffi.new(f"{batch.scalar.name(batch.prefix)} *")
    # NOSLIP_NOT_READY
    assert set(batch.compare(none, *(array[:, :70].copy() for array in batch.random(9)))) == {-6}


def test_a_lane_that_differs_is_found(tmp_path):
    """A sign in the batch law that differs from the step's."""
    batch = Batch(
        "type_i", "float", tmp_path, change=lambda text: text.replace("made[1] = t", "made[1] = -t")
    )
    with pytest.raises(AssertionError):
        batch.compare(batch.start(0, 0, 0.0), *batch.random(1))


def test_no_lanes(tmp_path):
    """n = 0 does nothing; a missing array is refused."""
    batch = Batch("type_i", "float", tmp_path)
    law, none = batch.start(0, 0, 0.0), batch.ffi.NULL
    some, status = batch.ffi.new("float[7]"), batch.ffi.new("int[1]")
    assert batch.call(f"{batch.prefix}_steps", law, 0, some, some, some, status) == 0
    for k in range(5):
        given = [none if place == k else one for place, one in enumerate((law, some, some, some, status))]
        assert batch.call(f"{batch.prefix}_steps", given[0], 1, *given[1:]) == -1


def test_the_committed_batch_laws_are_of_every_law():
    """generated/labmate/lanes has the header and the source of every law in both scalars."""
    expected = {
        f"labmate_{name}_steps{s.suffix}.{kind}"
        for name in OUTPUTS
        for s in SCALARS.values()
        for kind in "ch"
    }
    assert {path.name for path in (ROOT / "generated/labmate" / FOLDER).iterdir()} == expected
