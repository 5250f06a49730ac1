"""Shared by the checks: locations of the C, compilation, running of tools, results of a check."""

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

from ...codegen.files import robot_files
from ...codegen.printing.scalar import SCALARS
from ...codegen.targets import STANDARD, TABLE, flags
from ...readers.robots import find_robot, law_of, system_of
from ...simulation.controllers.balance.in_c import callable_files
from ...simulation.feedback.guidance import feedback_of
from ...simulation.specification.spec import read_spec

ROOT = Path(noslip.__file__).resolve().parent
HERE = Path(__file__).resolve().parent
TIMEOUT = 3600  # s, of each tool; EVA of the path takes minutes of processor time

Value = TypeVar("Value")
Answer = TypeVar("Answer")


class Missing(Exception):
    """A tool is missing; the message names the package to install."""


class Failed(Exception):
    """A guarantee does not hold; the message has a line for each reason."""


@dataclass(frozen=True)
class Task:
    """Arguments of a check: the C, the working folder, short or complete version, whether to record a new
    budget; `more`: laws of the shipped robot that are generated for the check, beside those of its committed
    C; `others`: laws of other robots, likewise: robot and law, one of each robot; `feedbacks`: SPECs whose
    state feedback is generated, likewise.
    """

    folder: Path
    root: Path = ROOT
    short: bool = False
    update: bool = False
    more: tuple[str, ...] = ()
    others: tuple[tuple[str, str], ...] = ()
    feedbacks: tuple[str, ...] = ()

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
        folders = (self.runtime, *self._of_laws, self.root / "firmware", self.root / "firmware/boards")
        return [f"-I{folder}" for folder in folders]

    @property
    def _of_laws(self) -> list[Path]:
        """The folders with generated C."""
        laws = self.folder / "laws"
        more = [_written(laws, self.generated.name, self.more)] if self.more else []
        others = [_written(laws / _in_c(robot), robot, (law,)) for robot, law in self.others]
        return [self.generated, *more, *others, *(_feedback(laws, spec) for spec in self.feedbacks)]

    @property
    def sources(self) -> list[Path]:
        """All C sources."""
        return [path for folder in (self.runtime, *self._of_laws) for path in _c_files(folder)]

    @property
    def lanes(self) -> list[Path]:
        """The C sources of the batch laws, which firmware does not need."""
        return [path for folder in self._of_laws for path in _c_files(folder / "lanes")]

    @property
    def float_sources(self) -> list[Path]:
        """The C sources that a program in float needs: those in float, and those without a scalar."""
        names = {path.stem for path in self.sources}
        return [path for path in self.sources if path.stem.endswith("_f") or f"{path.stem}_f" not in names]

    @property
    def firmware(self) -> list[Path]:
        """The C of the vehicle in firmware/, without the boards."""
        return _c_files(self.root / "firmware")

    @property
    def laws(self) -> list[str]:
        """The laws' names in C, without the scalar; `more` are before the last,
        which has `follow` and is the follower's."""
        own = [
            path.stem
            for path in _c_files(self.generated)
            if "_type_" in path.stem and not path.stem.endswith("_f")
        ]
        return [*own[:-1], *(f"{self.generated.name}_{name}" for name in self.more), *own[-1:]]

    @property
    def laws_of_others(self) -> dict[str, str]:
        """The laws of other robots and these robots, both by their names in C, without the scalar."""
        return {f"{_in_c(robot)}_{law}": _in_c(robot) for robot, law in self.others}

    @property
    def feedback_names(self) -> list[str]:
        """The names in C of the state feedbacks, without the scalar."""
        return [_feedback(self.folder / "laws", spec).name for spec in self.feedbacks]

    def robot_of(self, law: str) -> str:
        """Return the name in C of the robot of a law."""
        return self.laws_of_others.get(law, self.generated.name)

    def law_file(self, name: str) -> Path:
        """Return the path of a file of a law."""
        return next(path for folder in self._of_laws if (path := folder / name).exists())

    def follows(self, law: str) -> bool:
        """Whether the law has the step function `follow`, which takes the foot on a path."""
        return f"int {law}_follow(" in self.law_file(f"{law}.h").read_text(encoding="utf-8")

    def grips(self, law: str) -> bool:
        """Whether the law can keep wheels rolling."""
        return " grip;" in self.law_file(f"{law}.h").read_text(encoding="utf-8")

    def driver(self, law: str, suffix: str, text: str) -> str:
        """Return C that includes a file written for any law, for one law: see tests/c/law_names.h."""
        named = f"#define LAW {law}\n#define FOLLOWS {int(self.follows(law))}\n"
        return f'#include "{law}{suffix}.h"\n{named}#include "{text}"\n#undef LAW\n#undef FOLLOWS\n'

    def headers(self) -> Path:
        """Write a source that includes every header of the runtime, to compile the inline functions."""
        self.folder.mkdir(parents=True, exist_ok=True)
        path = self.folder / "headers.c"
        path.write_text(
            "".join(f'#include "{header.name}"\n' for header in sorted(self.runtime.glob("*.h"))),
            encoding="utf-8",
        )
        return path


@dataclass(frozen=True)
class Machine:
    """A machine, its compiler and flags, and the package of the compiler."""

    name: str
    prefix: str
    flags: tuple[str, ...]
    package: str

    @property
    def compiler(self) -> str:
        """The name of the compiler. Raises Missing if it is not installed."""
        return need(f"{self.prefix}gcc", self.package)

    @property
    def version(self) -> str:
        """Name and version of the compiler, as budgets record it."""
        return f"{self.compiler} {run([self.compiler, '-dumpfullversion']).strip()}"

    def tool(self, name: str) -> str:
        """Return the name of a binary tool that belongs to the compiler."""
        return need(self.prefix + name, self.package)

    def compile(self, task: Task, sources: Iterable[Path], *flags: str) -> list[Path]:
        """Compile sources at -O2, with their call graphs, unless compiled before; return the objects."""
        folder = task.folder / self.name
        folder.mkdir(parents=True, exist_ok=True)
        command = (
            self.compiler,
            *STANDARD,
            "-O2",
            "-fcallgraph-info=su,da",
            *self.flags,
            *flags,
            *task.include,
            "-c",
        )
        return each(lambda source: _compiled(command, source, folder / f"{source.stem}.o"), sources)


HOST = Machine(platform.machine(), "", (), "gcc")
ARM = TABLE["toolchain"]["arm"]
M4F = Machine("cortex-m4f", ARM["prefix"], flags("cortex-m4f"), ARM["package"])
TARGETS = {target.name: target for target in (HOST, M4F)}


def _in_c(robot: str) -> str:
    return robot.replace(":", "_")


def _c_files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.c"))


@cache
def _written(folder: Path, robot: str, names: tuple[str, ...]) -> Path:
    """Write the C of laws of a robot into a folder, with that of their batch laws; what all of its laws share
    too unless that is committed. Return the folder."""
    system = system_of(find_robot(robot))
    committed = (ROOT / "generated" / system.mechanism.name).exists()
    for name, text in robot_files(
        system, [law_of(system, law) for law in names], dynamics=False, lanes=True
    ).items():
        if "_type_" in name or not committed:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text, encoding="utf-8")
    return folder


@cache
def _feedback(folder: Path, file: str) -> Path:
    """Write the header of the state feedback of a SPEC, with sources that call it, into a folder of its own
    in `folder`, named as in C. Return that folder."""
    spec = read_spec(file)
    robot = find_robot(spec.robot)
    made = folder / f"{robot.name}_lqr"
    made.mkdir(parents=True, exist_ok=True)
    for name, text in callable_files(
        feedback_of(robot, spec, robot.parameter_values({})), list(SCALARS.values())
    ).items():
        (made / name).write_text(text, encoding="utf-8")
    return made


@cache
def _compiled(command: tuple[str, ...], source: Path, target: Path) -> Path:
    run([*command, str(source), "-o", str(target)], folder=target.parent)
    return target


def need(tool: str, package: str) -> str:
    """Return the name of the tool. Raises Missing if it is not installed."""
    if shutil.which(tool) is None:
        raise Missing(f"install {package}")
    return tool


def run(command: Sequence[str | Path], folder: Path | None = None, **more: str) -> str:
    """Run a tool and return its output, stdout and stderr. `more`:
    environment variables. Raises Failed if it fails."""
    code, text = attempt(command, folder, **more)
    if code:
        raise Failed(f"{' '.join(map(str, command))}\n{text}".strip())
    return text


def attempt(command: Sequence[str | Path], folder: Path | None = None, **more: str) -> tuple[int, str]:
    """Run a tool and return its exit code and output. Raises Failed if it takes too long."""
    words = [str(word) for word in command]
    try:
        process = subprocess.run(
            words,
            cwd=folder,
            env={**os.environ, **more},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
            errors="replace",
            timeout=TIMEOUT,
        )
    except subprocess.TimeoutExpired as late:
        raise Failed(f"{words[0]} has not ended after {TIMEOUT} s: {' '.join(words)}") from late
    return process.returncode, process.stdout


def each(function: Callable[[Value], Answer], values: Iterable[Value]) -> list[Answer]:
    """Return the results of the function for each value, two at a time."""
    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(function, values))


def hold(findings: Iterable[str]) -> None:
    """Raise Failed if there are findings."""
    if lines := list(findings):
        raise Failed("\n".join(lines))
