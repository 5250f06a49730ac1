"""What the checks share: where the C is, how it is compiled, how a tool is run, what a check answers."""

import os
import platform
import shutil
import subprocess
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TypeVar

import noslip

from ..codegen.targets import STANDARD, TABLE, flags

ROOT = Path(noslip.__file__).resolve().parent
HERE = Path(__file__).resolve().parent
TIMEOUT = 900  # s, of any one tool

Value = TypeVar("Value")
Answer = TypeVar("Answer")


class Missing(Exception):
    """A tool is not there; the message says what to install."""


class Failed(Exception):
    """A guarantee does not hold; the message has a line for each reason."""


@dataclass(frozen=True)
class Task:
    """What a check is to do: on which C, where it may write, all of it or a short version, whether to accept a new budget."""

    folder: Path
    root: Path = ROOT
    short: bool = False
    update: bool = False

    @property
    def runtime(self) -> Path:
        """The hand-written C."""
        return self.root / "runtime_c"

    @property
    def generated(self) -> Path:
        """The generated C of the shipped robot."""
        return self.root / "generated" / "labmate"

    @property
    def include(self) -> list[str]:
        """Flags that find the headers."""
        folders = (self.runtime, self.generated, self.root / "firmware", self.root / "firmware/boards")
        return [f"-I{folder}" for folder in folders]

    @property
    def sources(self) -> list[Path]:
        """Every source."""
        return [*_c_files(self.runtime), *_c_files(self.generated)]

    @property
    def float_sources(self) -> list[Path]:
        """Every source that has nothing but float."""
        return [path for path in self.sources if path.stem.endswith("_f")]

    @property
    def firmware(self) -> list[Path]:
        """What a user's project would have: the vehicle in firmware/, without its boards."""
        return _c_files(self.root / "firmware")

    @property
    def laws(self) -> list[str]:
        """The laws' names in C, without the scalar."""
        return [path.stem for path in _c_files(self.generated) if "_type_" in path.stem and not path.stem.endswith("_f")]

    def follows(self, law: str) -> bool:
        """Does the law have a second step, `follow`, that a path tells the foot?"""
        return f"int {law}_follow(" in (self.generated / f"{law}.h").read_text()

    def driver(self, law: str, suffix: str, text: str) -> str:
        """C that includes for one law a text that is written once for all: see tests/c/law_names.h."""
        named = f"#define LAW {law}\n#define FOLLOWS {int(self.follows(law))}\n"
        return f'#include "{law}{suffix}.h"\n{named}#include "{text}"\n#undef LAW\n#undef FOLLOWS\n'

    def headers(self) -> Path:
        """A source that includes every header of the runtime, so that functions that are inline are somewhere."""
        self.folder.mkdir(parents=True, exist_ok=True)
        path = self.folder / "headers.c"
        path.write_text("".join(f'#include "{header.name}"\n' for header in sorted(self.runtime.glob("*.h"))))
        return path


@dataclass(frozen=True)
class Target:
    """A machine, the compiler for it, and the package that has the compiler."""

    name: str
    prefix: str
    flags: tuple[str, ...]
    package: str

    @property
    def compiler(self) -> str:
        """The compiler's name. Missing: it is not there."""
        return need(f"{self.prefix}gcc", self.package)

    @property
    def version(self) -> str:
        """Name and version of the compiler, as budgets record it."""
        return f"{self.compiler} {run([self.compiler, '-dumpfullversion']).strip()}"

    def tool(self, name: str) -> str:
        """One of the binary tools that come with the compiler."""
        return need(self.prefix + name, self.package)

    def compile(self, task: Task, sources: Iterable[Path], *flags: str) -> list[Path]:
        """Objects of sources at -O2, each with its call graph beside it; what was compiled before is not again."""
        folder = task.folder / self.name
        folder.mkdir(parents=True, exist_ok=True)
        command = (self.compiler, *STANDARD, "-O2", "-fcallgraph-info=su,da", *self.flags, *flags, *task.include, "-c")
        return each(lambda source: _compiled(command, source, folder / f"{source.stem}.o"), sources)


HOST = Target(platform.machine(), "", (), "gcc")
ARM = TABLE["toolchain"]["arm"]
M4F = Target("cortex-m4f", ARM["prefix"], flags("cortex-m4f"), ARM["package"])
TARGETS = {target.name: target for target in (HOST, M4F)}


def _c_files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.c"))


@cache
def _compiled(command: tuple[str, ...], source: Path, target: Path) -> Path:
    run([*command, str(source), "-o", str(target)], folder=target.parent)
    return target


def need(tool: str, package: str) -> str:
    """The tool's name. Missing: it is not installed."""
    if shutil.which(tool) is None:
        raise Missing(f"install {package}")
    return tool


def run(command: Sequence[str | Path], folder: Path | None = None, **more: str) -> str:
    """What a tool that must succeed says, on both channels. `more` goes into its environment. Failed: it did not."""
    code, text = attempt(command, folder, **more)
    if code:
        raise Failed(f"{' '.join(map(str, command))}\n{text}".strip())
    return text


def attempt(command: Sequence[str | Path], folder: Path | None = None, **more: str) -> tuple[int, str]:
    """Exit code and what a tool says. Failed: it has not ended in time."""
    words = [str(word) for word in command]
    try:
        done = subprocess.run(
            words,
            cwd=folder,
            env={**os.environ, **more},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=TIMEOUT,
        )
    except subprocess.TimeoutExpired as late:
        raise Failed(f"{words[0]} has not ended after {TIMEOUT} s: {' '.join(words)}") from late
    return done.returncode, done.stdout


def each(function: Callable[[Value], Answer], values: Iterable[Value]) -> list[Answer]:
    """The function's answers, two at a time."""
    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(function, values))


def hold(found: Iterable[str]) -> None:
    """Failed, where anything was found."""
    if lines := list(found):
        raise Failed("\n".join(lines))
