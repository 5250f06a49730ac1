"""The same bits from every compiler, at every level, on every target: one digest of all LABMATE laws over seeded states.

`python tests/test_bits.py` prints the table: target, compiler and flags, states, digest in float, in double, and of sine,
cosine and root.
"""

import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
RUNTIME, GENERATED, DRIVERS, BOARDS = (
    ROOT / "runtime_c",
    ROOT / "generated" / "labmate",
    ROOT / "tests" / "c",
    ROOT / "firmware/boards",
)
SOURCES = [DRIVERS / "law_digest.c", *sorted(RUNTIME.glob("*.c")), *sorted(GENERATED.glob("*.c"))]
INCLUDE = [f"-I{folder}" for folder in (RUNTIME, GENERATED, DRIVERS)]
STANDARD = "-std=c99 -ffp-contract=off -fno-math-errno"
LEVELS = ("-O0", "-O1", "-O2", "-O3", "-Os")
LAWS = 8  # the last is no law: a vehicle led along a path
FULL, FEW = 20_000, 1_000  # states: of builds for the host, of one for each other target; of the others
TESTED = 2_000  # states at most, where this runs as a test
TIMEOUT = 120  # s, of any one tool

CONSOLE = (
    "-display none -monitor none -serial none -chardev stdio,id=out "
    "-semihosting-config enable=on,target=native,chardev=out -kernel"
)
NODE = """
const [file, states] = process.argv.slice(1);
const { exports } = new WebAssembly.Instance(new WebAssembly.Module(require("fs").readFileSync(file)));
const text = new Uint8Array(exports.memory.buffer, exports.law_digest(Number(states)));
process.stdout.write(Buffer.from(text.subarray(0, text.indexOf(0))));
"""


@dataclass(frozen=True)
class Target:
    """What runs the laws, and how they get there."""

    flags: str = ""
    clang: str = ""  # clang's name of the target
    linker: str = ""  # the compiler that links, and compiles `start`; empty: the one that compiles the laws
    start: tuple[Path, ...] = ()
    link: str = ""
    runner: tuple[str, ...] = ()


def cortex(machine: str, flags: str) -> Target:
    """A Cortex-M board of QEMU."""
    return Target(
        f"{flags} -mthumb -mfloat-abi=hard",
        "thumbv7em-none-eabihf",
        "arm-none-eabi-gcc",
        (BOARDS / "start_cortex_m.c", DRIVERS / "law_digest_bare.c", BOARDS / "string.c"),
        f"-nostdlib -T {shlex.quote(str(BOARDS / 'mps2-an386.ld'))} -lgcc",
        ("qemu-system-arm", *f"-M {machine} {CONSOLE}".split()),
    )


def rv32(flags: str, cpu: str = "rv32") -> Target:
    """QEMU's RISC-V board."""
    return Target(
        f"{flags} -mcmodel=medany",
        "riscv32-unknown-elf",
        "riscv64-unknown-elf-gcc",
        (BOARDS / "start_rv32.c", DRIVERS / "law_digest_bare.c", BOARDS / "string.c"),
        f"-nostdlib -T {shlex.quote(str(BOARDS / 'virt.ld'))} -lgcc",
        ("qemu-system-riscv32", *f"-M virt -cpu {cpu} -bios none {CONSOLE}".split()),
    )


HOST = platform.machine()
TARGETS = {
    HOST: Target(),
    "cortex-m4f": cortex("mps2-an386", "-mcpu=cortex-m4 -mfpu=fpv4-sp-d16"),
    "cortex-m7": cortex("mps2-an500", "-mcpu=cortex-m7 -mfpu=fpv5-d16"),
    "rv32imafc": rv32("-march=rv32imafc -mabi=ilp32f"),
    "rv32imafdc": rv32("-march=rv32imafdc -mabi=ilp32d"),
    "rv32imac": rv32("-march=rv32imac -mabi=ilp32", "rv32,f=false,d=false"),
    "wasm32": Target(
        clang="wasm32",
        start=(BOARDS / "string.c",),
        link="-nostdlib -Wl,--no-entry -Wl,--export=law_digest",
        runner=("node", "-e", NODE),
    ),
}


@dataclass(frozen=True)
class Build:
    """One way to compile the laws, and how many states they are run at."""

    target: str
    compiler: str
    flags: str
    states: int = FEW

    def __str__(self) -> str:
        return f"{self.target} {self.compiler} {self.flags}"

    @property
    def missing(self) -> str:
        """What is not there; empty when it can be built and run."""
        target = TARGETS[self.target]
        tools = [self.compiler, target.linker, *target.runner[:1], *["wasm-ld"] * (self.target == "wasm32")]
        absent = [tool for tool in dict.fromkeys(tools) if tool and not shutil.which(tool)]
        return f"{', '.join(absent)} not installed" if absent else ""

    @property
    def unsuited(self) -> str:
        """Which instructions of the flags this processor does not have; empty when it has all."""
        wanted = {flag[2:] for flag in self.flags.split() if flag in ("-mavx2", "-mfma")}
        absent = sorted(wanted - processor())
        return f"this processor has no {', '.join(absent)}" if absent else ""

    def digest(self, folder: Path) -> list[str]:
        """Builds in an empty folder and runs; answers the words of law_digest's line."""
        target = TARGETS[self.target]
        given = [*STANDARD.split(), *target.flags.split(), *self.flags.split()]
        bare = [] if self.target == HOST else ["-ffreestanding", f"-DSTATES={self.states}u", f"-I{BOARDS}"]
        for_clang = [f"--target={target.clang}"] if target.clang and self.compiler == "clang" else []
        run([self.compiler, *for_clang, *given, *bare, *INCLUDE, "-c", *map(str, SOURCES)], folder)
        objects = [f"{source.stem}.o" for source in SOURCES]
        linker = [target.linker] if target.linker else [self.compiler, *for_clang]
        start = map(str, target.start)
        run([*linker, *given, *bare, *INCLUDE, *start, *objects, *shlex.split(target.link), "-o", "digest"], folder)
        return run([*(target.runner or ["./digest"]), *["digest"] * bool(target.runner), *self.arguments], folder).split()

    @property
    def arguments(self) -> list[str]:
        """The program's arguments; bare metal has none."""
        return [] if TARGETS[self.target].linker else [str(self.states)]


def run(command: list[str], folder: Path) -> str:
    """Standard output of a command that must succeed."""
    result = subprocess.run(command, cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=TIMEOUT)
    assert result.returncode == 0, f"{command[0]} ended with {result.returncode}\n{result.stdout}{result.stderr}"
    return result.stdout


@cache
def processor() -> set[str]:
    """The flags of this processor, where Linux tells them."""
    info = Path("/proc/cpuinfo")
    return set(info.read_text().split()) if info.exists() else set()


REFERENCE = Build(HOST, "gcc", "-O2", FULL)


def builds() -> Iterator[Build]:
    """Every build, the one that the others are compared with first."""
    yield REFERENCE
    for compiler in ("gcc", "clang"):
        for level in LEVELS:
            build = Build(HOST, compiler, level, FULL)
            if build != REFERENCE:
                yield build
        yield Build(HOST, compiler, "-O3 -mavx2 -mfma", FULL)
        yield Build(HOST, compiler, "-O2 -DNOSLIP_SOFT_SQRT", FULL)
    for name, target in TARGETS.items():
        if target.linker:
            levels = LEVELS if name == "cortex-m4f" else ("-O2",)
            yield from (Build(name, target.linker, level, FULL if level == "-O2" else FEW) for level in levels)
            yield from (Build(name, "clang", level) for level in levels)
    yield from (Build("wasm32", "clang", level, FULL) for level in LEVELS)


def tested() -> list[Build]:
    """The builds that are worth a test each time; `make bits` has all. The slow ones first, so that processes end together."""
    left_out = {HOST: ("-O1", "-O3", "-Os"), "cortex-m4f": ("-O1", "-O3"), "wasm32": ("-O0", "-O1", "-O3")}
    found = [build for build in builds() if build.flags not in left_out.get(build.target, ())]
    return sorted(found, key=lambda build: build.target == HOST)


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """The digest of host and gcc -O2, by the number of states."""

    @cache
    def reference(states: int) -> list[str]:
        build = replace(REFERENCE, states=states)
        if build.missing:
            pytest.skip(build.missing)
        return build.digest(tmp_path_factory.mktemp("reference"))

    return reference


@pytest.mark.parametrize("build", tested(), ids=str)
def test_bits(build, reference, tmp_path):
    if build.missing and os.environ.get("NOSLIP_REQUIRE_FIRMWARE") == "1":
        pytest.fail(build.missing)
    if build.missing or build.unsuited:
        pytest.skip(build.missing or build.unsuited)
    build = replace(build, states=min(build.states, TESTED))
    assert build.digest(tmp_path) == reference(build.states)


def test_most_steps_are_good(reference):
    """What is compared is mostly answers; the rest are errors of all kinds."""
    _, in_float, _, in_double, _ = reference(TESTED)
    for good in (int(in_float, 16), int(in_double, 16)):
        assert 0.85 * LAWS * TESTED < good < LAWS * TESTED


def test_digest_notices_fused_operations(reference, tmp_path):
    build = Build(HOST, "gcc", "-O2 -mfma -std=gnu11 -ffp-contract=fast", FEW)
    if build.missing or build.unsuited:
        pytest.skip(build.missing or build.unsuited)
    fused, right = build.digest(tmp_path), reference(FEW)
    assert all(fused[k] != right[k] for k in (0, 2, 4))


def table(jobs: int = 2) -> int:
    """Prints a line for every build as it ends; 1 if one differs, fails, or is missing though required."""
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(jobs) as pool:

        def digest(build: Build) -> list[str] | str:
            if build.missing or build.unsuited:
                return f"skipped: {build.missing or build.unsuited}"
            try:
                return build.digest(Path(tempfile.mkdtemp(dir=folder)))
            except (AssertionError, subprocess.TimeoutExpired) as error:
                return f"FAILED: {error}"

        right = {states: pool.submit(digest, replace(REFERENCE, states=states)) for states in (FULL, FEW)}
        wrong = skipped = 0
        print(f"{'target':11}{'compiler':24}{'flags':24}{'states':>6}  {'float':17}{'double':17}sincos and root")
        every = list(builds())
        for build, answer in zip(every, pool.map(digest, every), strict=True):
            if isinstance(answer, str):
                wrong += answer.startswith("FAILED") or bool(build.missing and os.environ.get("NOSLIP_REQUIRE_FIRMWARE") == "1")
                skipped += answer.startswith("skipped")
                text = answer
            else:
                same = answer == right[build.states].result()
                wrong += not same
                text = f"{answer[0]} {answer[2]} {answer[4]}{'' if same else '  DIFFERS'}"
            print(f"{build.target:11}{build.compiler:24}{build.flags:24}{build.states:6}  {text}", flush=True)
    print(f"{wrong} wrong" if wrong else f"{len(every) - skipped} builds, one digest", f"{skipped} skipped", sep=", ")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(table())
