"""Compiles programs and counts executed instructions, bytes of code and bytes of stack."""

import os
import shutil
import subprocess
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import cases
from counting import count_calls, run, symbols_of
from noslip.checks.guarantees.callgraph import call_graph, deepest, reached
from noslip.checks.guarantees.cycles import write_costs
from noslip.codegen.runtime import RUNTIME
from noslip.codegen.targets import STANDARD, flags
from programs import MeasuredProgram, main_text

BENCH = Path(__file__).resolve().parent
BOARDS = BENCH.parents[1] / "firmware/boards"
COMMON = [*STANDARD[1:], "-ffunction-sections", "-fcallgraph-info=su,da", "-w"]
LANGUAGE = {"c": [STANDARD[0]], "c++": ["-std=c++14", "-fno-exceptions", "-fno-rtti"]}
M4F = flags("cortex-m4f")


# Mean, least, most instructions of a call; its cycles
Executed = tuple[float, int | None, int | None, float | None]


@dataclass(frozen=True)
class Count:
    """Per call of a function: mean, minimum and maximum of instructions (with callgrind only the mean), mean
    of the cycles that cycles.py estimates (None for this machine); bytes."""

    instructions: float
    least: int | None
    most: int | None
    cycles: float | None
    text_bytes: int
    stack_bytes: int

    @property
    def mean(self) -> float | int:
        """The mean, as an integer if it is one."""
        return (
            int(self.instructions)
            if self.instructions == int(self.instructions)
            else round(self.instructions, 2)
        )


class Host:
    """A compiler and a machine."""

    name = "host"
    prefix = ""
    level = "-O2"
    peers = True  # whether the laws of other tools are measured on it, too, if it has the libm that they need
    flags: Sequence[str] = ()
    startup: Sequence[Path] = ()
    runner: Sequence[str] = ("valgrind",)

    def __init__(self, folder: Path):
        self.folder = folder / self.name

    @property
    def has_libm(self) -> bool:
        """Whether there is a libm."""
        return True

    @property
    def link(self) -> list[str]:
        """What is linked behind the programs."""
        return ["-lm"]

    @property
    def missing(self) -> str:
        """Return the missing tool; empty if there is none."""
        tools = [*(self.prefix + tool for tool in ("gcc", "g++", "nm", "objcopy")), *self.runner]
        return next((tool for tool in tools if not shutil.which(tool)), "")

    def measure(
        self, label: str, programs: Sequence[MeasuredProgram], scalar: str, shared: Path
    ) -> dict[str, Count]:
        """Return program name -> count. `shared`: generated headers, cases and the source of the robot."""
        folder = self.folder / scalar / label
        folder.mkdir(parents=True, exist_ok=True)
        objects = [self._compile(folder, program, shared) for program in programs]
        (folder / "main.c").write_text(main_text(programs), encoding="utf-8")
        laws = dict.fromkeys(program.law for program in programs)
        suffix = "_f" if scalar == "float" else ""
        plain = [
            folder / "main.c",
            *(shared / f"cases_{law}_{scalar}.c" for law in laws),
            shared / f"labmate{suffix}.c",
        ]
        plain += self.startup
        image = folder / "image"
        flags = [self.level, *COMMON, *LANGUAGE["c"], *self.flags, f"-I{RUNTIME}", f"-I{shared}"]
        run(
            [self.prefix + "gcc", *flags, *map(str, plain + objects), *self.link, "-o", str(image)],
            folder,
        )
        symbols = symbols_of(image, self.prefix)
        counts = self.count(image, programs, symbols)
        graph = call_graph(sorted(folder.glob("*.ci")))
        return {
            p.name: Count(
                *counts[p.name],
                sum(symbols[f][1] for f in reached(graph, p.measured) if f in symbols and f in graph),
                deepest(graph, p.measured),
            )
            for p in programs
        }

    def count(self, image: Path, programs: Sequence[MeasuredProgram], symbols: dict) -> dict[str, Executed]:
        """MeasuredProgram name -> mean, least, most, cycles."""
        out = image.with_suffix(".callgrind")
        command = [
            "valgrind",
            "--tool=callgrind",
            "-q",
            f"--callgrind-out-file={out}",
            "--compress-strings=no",
        ]
        _checked(run([*command, "--compress-pos=no", str(image)], image.parent, check=False), programs, image)
        inclusive = _inclusive(out.read_text(encoding="utf-8"))
        return {p.name: (inclusive[p.measured] / cases.COUNT, None, None, None) for p in programs}

    def _compile(self, folder: Path, program: MeasuredProgram, shared: Path) -> Path:
        path = folder / f"{program.name}.{'c' if program.language == 'c' else 'cc'}"
        path.write_text(program.text, encoding="utf-8")
        compiler = self.prefix + ("gcc" if program.language == "c" else "g++")
        includes = [f"-I{place}" for place in (RUNTIME, shared, BENCH / "hand", BENCH / "peers")]
        target = path.with_suffix(".o")
        run(
            [
                compiler,
                self.level,
                *COMMON,
                *LANGUAGE[program.language],
                *self.flags,
                *includes,
                "-c",
                str(path),
                "-o",
                str(target),
            ],
            folder,
        )
        # each program contains init of its law: only their own entry points may be shared in the image
        run([self.prefix + "objcopy", f"--keep-global-symbol=check_{program.name}", str(target)], folder)
        return target


class CortexM4F(Host):
    """Cortex-M4F with its single-precision FPU, in QEMU; a plugin counts every executed instruction,
    and its estimated cycles."""

    name = "cortex-m4f"
    prefix = "arm-none-eabi-"
    flags = M4F
    startup = (BOARDS / "start_cortex_m.c", BOARDS / "string.c")
    runner = ("qemu-system-arm", "gcc")
    machine = ("qemu-system-arm", "-M", "mps2-an386", *"-display none -monitor none -serial none".split())
    machine += ("-semihosting-config", "enable=on,target=native")

    @property
    def has_libm(self) -> bool:
        """Whether newlib is installed: GCC then names the file with its folder."""
        return "/" in run([f"{self.prefix}gcc", "-print-file-name=libm.a"], BOARDS).stdout

    @property
    def link(self) -> list[str]:
        """Ours and the hand-written laws need no C library."""
        libraries = ["-lm", "-lc", "-lnosys"] if self.has_libm else []
        return ["-nostdlib", f"-T{BOARDS / 'mps2-an386.ld'}", "-Wl,--gc-sections", *libraries, "-lgcc"]

    def count(self, image: Path, programs: Sequence[MeasuredProgram], symbols: dict) -> dict[str, Executed]:
        """MeasuredProgram name -> mean, least, most, cycles."""
        calls = [(p.measured, p.driver) for p in programs]
        done, found = count_calls(
            self.machine, image, symbols, calls, self.folder, write_costs(image, self.prefix)
        )
        _checked(done, programs, image)
        for name, (number, *_) in found.items():
            if number != cases.COUNT:
                raise RuntimeError(f"{image}: {name} was called {number} times, not {cases.COUNT}")
        made: dict[str, Executed] = {}
        for program in programs:
            _, total, least, most, cycles = found[program.measured]
            made[program.name] = total / cases.COUNT, least, most, round(cycles / cases.COUNT, 1)
        return made


class CortexM4FSmall(CortexM4F):
    """The same, where GCC is asked for small code."""

    name = "cortex-m4f -Os"
    level = "-Os"
    peers = False


class CortexM0Plus(CortexM4F):
    """The code of a Cortex-M0+, which has no FPU: each operation is a call of GCC's library, whose
    instructions are counted too.

    It runs on the same emulated machine; the cycles would be those of another processor.
    """

    name = "cortex-m0plus"
    peers = False
    flags = ("-mcpu=cortex-m0plus", "-mthumb", "-mfloat-abi=soft")

    def count(self, image: Path, programs: Sequence[MeasuredProgram], symbols: dict) -> dict[str, Executed]:
        """MeasuredProgram name -> mean, least, most, no cycles."""
        counted = super().count(image, programs, symbols)
        return {name: (mean, least, most, None) for name, (mean, least, most, _) in counted.items()}


def measure_all(
    target: Host, jobs: Sequence[tuple[str, Sequence[MeasuredProgram], str]], shared: Path
) -> dict:
    """Return (label, scalar) -> program name -> count; with one job per processor."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        futures = {
            (label, scalar): pool.submit(target.measure, label, programs, scalar, shared)
            for label, programs, scalar in jobs
        }
        return {key: future.result() for key, future in futures.items()}


def _checked(done: subprocess.CompletedProcess, programs: Sequence[MeasuredProgram], image: Path) -> None:
    """Raise RuntimeError for a program with wrong results, which is not measured."""
    if 0 < done.returncode <= len(programs):
        raise RuntimeError(f"{image}: {programs[done.returncode - 1].name} answers wrong numbers")
    if done.returncode:
        raise RuntimeError(f"{image}: exit {done.returncode} {done.stderr}")


def _inclusive(text: str) -> dict[str, int]:
    """Return function -> instructions with its callees, from callgrind's file (uncompressed names)."""
    totals: dict[str, int] = {}
    callee, next_is_cost = "", False
    for line in text.splitlines():
        if line.startswith("cfn="):
            callee = line[4:]
        elif line.startswith("calls="):
            next_is_cost = True
        elif next_is_cost:
            totals[callee] = totals.get(callee, 0) + int(line.split()[-1])
            next_is_cost = False
    return totals
