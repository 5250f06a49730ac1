"""Compiles programs and counts: executed instructions, bytes of code, bytes of stack."""

import os
import re
import shutil
import subprocess
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import cases
from programs import Program, main_text

BENCH = Path(__file__).resolve().parent
RUNTIME = BENCH.parent / "runtime_c"
COMMON = ["-O2", "-ffp-contract=off", "-fno-math-errno", "-ffunction-sections", "-fcallgraph-info=su", "-w"]
LANGUAGE = {"c": ["-std=c99"], "c++": ["-std=c++14", "-fno-exceptions", "-fno-rtti"]}
M4F = ["-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"]
TIMEOUT = 120  # s, of any one tool


@dataclass(frozen=True)
class Count:
    """Per call of one function: mean, least and most instructions (callgrind knows only the mean); bytes."""

    instructions: float
    least: int | None
    most: int | None
    text_bytes: int
    stack_bytes: int

    @property
    def mean(self) -> float | int:
        """The mean, as a whole number where it is one."""
        return int(self.instructions) if self.instructions == int(self.instructions) else round(self.instructions, 2)


class Target:
    """A compiler and a machine to run on."""

    name = "host"
    prefix = ""
    flags: Sequence[str] = ()
    startup: Sequence[Path] = ()
    link: Sequence[str] = ()
    runner: Sequence[str] = ("valgrind",)

    def __init__(self, folder: Path):
        self.folder = folder / self.name

    @property
    def missing(self) -> str:
        """Which tool is not there; empty when all are."""
        tools = [*(self.prefix + tool for tool in ("gcc", "g++", "nm", "objcopy")), *self.runner]
        return next((tool for tool in tools if not shutil.which(tool)), "")

    def measure(self, label: str, programs: Sequence[Program], scalar: str, shared: Path) -> dict[str, Count]:
        """Program name -> count. `shared` holds generated headers, cases and the robot's own source."""
        folder = self.folder / scalar / label
        folder.mkdir(parents=True, exist_ok=True)
        objects = [self._compile(folder, program, shared) for program in programs]
        (folder / "main.c").write_text(main_text(programs))
        laws = dict.fromkeys(program.law for program in programs)
        suffix = "_f" if scalar == "float" else ""
        plain = [folder / "main.c", *(shared / f"cases_{law}_{scalar}.c" for law in laws), shared / f"labmate{suffix}.c"]
        plain += self.startup
        image = folder / "image"
        flags = [*COMMON, *LANGUAGE["c"], *self.flags, f"-I{RUNTIME}", f"-I{shared}"]
        run([self.prefix + "gcc", *flags, *map(str, plain + objects), *self.link, "-lm", "-o", str(image)], folder)
        symbols = self._symbols(image)
        counts = self.count(image, programs, symbols)
        graph = _call_graph(sorted(folder.glob("*.ci")))
        return {
            p.name: Count(
                *counts[p.name],
                text_bytes=sum(symbols[f][1] for f in _reached(graph, p.measured) if f in symbols and f in graph),
                stack_bytes=_deepest(graph, p.measured),
            )
            for p in programs
        }

    def count(self, image: Path, programs: Sequence[Program], symbols: dict) -> dict[str, tuple]:
        """Program name -> mean, least, most."""
        out = image.with_suffix(".callgrind")
        command = ["valgrind", "--tool=callgrind", "-q", f"--callgrind-out-file={out}", "--compress-strings=no"]
        _checked(run([*command, "--compress-pos=no", str(image)], image.parent, check=False), programs, image)
        inclusive = _inclusive(out.read_text())
        return {p.name: (inclusive[p.measured] / cases.COUNT, None, None) for p in programs}

    def _compile(self, folder: Path, program: Program, shared: Path) -> Path:
        path = folder / f"{program.name}.{'c' if program.language == 'c' else 'cc'}"
        path.write_text(program.text)
        compiler = self.prefix + ("gcc" if program.language == "c" else "g++")
        includes = [f"-I{place}" for place in (RUNTIME, shared, BENCH / "hand", BENCH / "peers")]
        target = path.with_suffix(".o")
        run([compiler, *COMMON, *LANGUAGE[program.language], *self.flags, *includes, "-c", str(path), "-o", str(target)], folder)
        # programs of one law each bring its init: nothing but their own entry shall meet in the image
        run([self.prefix + "objcopy", f"--keep-global-symbol=check_{program.name}", str(target)], folder)
        return target

    def _symbols(self, image: Path) -> dict[str, tuple[int, int]]:
        """Function -> address and bytes."""
        lines = run([self.prefix + "nm", "-S", str(image)], image.parent).stdout.splitlines()
        rows = [line.split() for line in lines if len(line.split()) == 4 and line.split()[2] in "tTW"]
        return {
            name.split(".")[0] if name.endswith(".isra.0") else name: (int(at, 16), int(size, 16)) for at, size, _, name in rows
        }


class CortexM4F(Target):
    """Cortex-M4F with its single-precision FPU, in QEMU; a plugin counts every executed instruction."""

    name = "cortex-m4f"
    prefix = "arm-none-eabi-"
    flags = tuple(M4F)
    startup = (BENCH.parent / "firmware/boards/start_cortex_m.c",)
    link = ("-nostartfiles", "--specs=nosys.specs", f"-T{BENCH.parent / 'firmware/boards/mps2-an386.ld'}", "-Wl,--gc-sections")
    runner = ("qemu-system-arm", "gcc")

    def count(self, image: Path, programs: Sequence[Program], symbols: dict) -> dict[str, tuple]:
        """Program name -> mean, least, most."""
        calls = []
        for p in programs:
            first, size = symbols[p.driver]
            calls.append(f"call={symbols[p.measured][0]:x}:{first:x}:{first + size - 1:x}")
        log = image.with_suffix(".count")
        command = ["qemu-system-arm", "-M", "mps2-an386", "-display", "none", "-monitor", "none", "-serial", "none"]
        command += ["-semihosting-config", "enable=on,target=native", "-kernel", str(image), "-d", "plugin", "-D", str(log)]
        command += ["-plugin", ",".join([str(self._plugin()), *calls])]
        _checked(run(command, image.parent, check=False), programs, image)
        rows = [line.split() for line in log.read_text().splitlines()]
        found = {int(at, 16): tuple(map(int, numbers)) for at, *numbers in rows}
        counted = {}
        for p in programs:
            number, total, least, most = found[symbols[p.measured][0]]
            if number != cases.COUNT:
                raise RuntimeError(f"{image}: {p.measured} was called {number} times, not {cases.COUNT}")
            counted[p.name] = (total / number, least, most)
        return counted

    def _plugin(self) -> Path:
        plugin = self.folder / "count.so"
        source = BENCH / "target/count.c"
        if not plugin.exists() or plugin.stat().st_mtime < source.stat().st_mtime:
            run(["gcc", "-std=c99", "-O2", "-fPIC", "-shared", str(source), "-o", str(plugin)], self.folder)
        return plugin


def measure_all(target: Target, jobs: Sequence[tuple[str, Sequence[Program], str]], shared: Path) -> dict:
    """(label, scalar) -> program name -> count; as many jobs at a time as there are processors."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        futures = {
            (label, scalar): pool.submit(target.measure, label, programs, scalar, shared) for label, programs, scalar in jobs
        }
        return {key: future.result() for key, future in futures.items()}


def run(command: Sequence[str], folder: Path, check: bool = True) -> subprocess.CompletedProcess:
    """Run a tool, its input closed, for TIMEOUT at most."""
    done = subprocess.run(command, cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=TIMEOUT)
    if check and done.returncode:
        raise RuntimeError(f"{' '.join(command)}\n{done.stderr}")
    return done


def _checked(done: subprocess.CompletedProcess, programs: Sequence[Program], image: Path) -> None:
    """A program whose answers are not those expected is not measured."""
    if 0 < done.returncode <= len(programs):
        raise RuntimeError(f"{image}: {programs[done.returncode - 1].name} answers wrong numbers")
    if done.returncode:
        raise RuntimeError(f"{image}: exit {done.returncode} {done.stderr}")


def _inclusive(text: str) -> dict[str, int]:
    """Function -> instructions with its callees, from callgrind's file (uncompressed names)."""
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


def _call_graph(files: Sequence[Path]) -> dict[str, tuple[int, set[str]]]:
    """Function -> bytes of its own frame, callees; from GCC's -fcallgraph-info. Library functions are not in it."""
    graph: dict[str, tuple[int, set[str]]] = {}
    for file in files:
        text = file.read_text()
        for title, stack in re.findall(r'node: \{ title: "([^"]*)" label: "[^"]*\\n(\d+) bytes', text):
            graph[_plain(title)] = (int(stack), set())
        for caller, callee in re.findall(r'edge: \{ sourcename: "([^"]*)" targetname: "([^"]*)"', text):
            graph.setdefault(_plain(caller), (0, set()))[1].add(_plain(callee))
    return graph


def _plain(title: str) -> str:
    return title.rpartition(":")[2]


def _reached(graph: dict, name: str, seen: set[str] | None = None) -> set[str]:
    seen = set() if seen is None else seen
    if name not in seen:
        seen.add(name)
        for callee in graph.get(name, (0, ()))[1]:
            _reached(graph, callee, seen)
    return seen


def _deepest(graph: dict, name: str) -> int:
    own, callees = graph.get(name, (0, set()))
    return own + max((_deepest(graph, callee) for callee in callees), default=0)
