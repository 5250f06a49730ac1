"""Finds robots and laws by name, as given on the command line and in files."""

import ast
import inspect
import re
import sys
import traceback
import types
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

from ..model.algebra.exact import keep_in
from ..model.errors import ModelError
from ..model.law import ControlLaw, control_law
from ..model.mechanism import Mechanism
from ..model.names import (
    ARCLENGTH,
    EXTENDED,
    KINEMATIC,
    LawName,
    without_arclength,
    without_damping,
    without_extension,
    without_kinematic,
    without_offset,
)
from ..model.outputs import COURSE, STANDARD, output_map, output_names
from ..model.reduction import ReducedSystem, reduce
from ..model.robots import SHIPPED
from .errors import BadInput, check_named, naming, suggestion
from .files import SHIPPED as SPECS
from .files import file_or_shipped, read_input
from .forms import Forms

keep_in(Forms())


@dataclass(frozen=True)
class Source:
    """The user's file that defines a robot: path, text, and first and last line of the statement that defines
    its name."""

    path: Path
    text: bytes
    line: int
    last: int

    def line_of(self, message: str) -> int:
        """Return the line of the call that a message is about: one that contains a name quoted there, or
        calls a method named there.

        If there are several, the first one; lines of the robot's own function take precedence.
        """
        calls = [node for node in ast.walk(ast.parse(self.text)) if isinstance(node, ast.Call)]
        calls.sort(key=lambda call: (not self.line <= call.lineno <= self.last, call.lineno))
        for name in re.findall(r"'([^']+)'", message):
            for call in calls:
                if any(
                    isinstance(argument, ast.Constant) and argument.value == name for argument in call.args
                ):
                    return call.lineno
        words = message.replace("-", " ")
        for call in calls:
            if isinstance(call.func, ast.Attribute) and call.func.attr.replace("_", " ") in words:
                return call.lineno
        return self.line


_sources: WeakKeyDictionary[Mechanism, Source] = WeakKeyDictionary()


@cache
def find_robot(text: str, kinds: tuple[type, ...] = (Mechanism,)) -> Mechanism:
    """Return a robot: a shipped name, or "path/to/file.py:name", where name is a Mechanism (or another of
    `kinds`) or a function that returns one.

    Integers after the name, each preceded by a colon, are arguments of the function: "tractor_trailer:4". The
    same name always returns the same object, which accepts only further outputs once it has been reduced.
    Raises BadInput for an unknown name, a missing file, invalid arguments, or, with file and line, an error
    raised by the user's code.
    """
    whole, text = text, re.sub(r"(:-?\d{1,15})*\Z", "", text, count=1)
    numbers = [int(number) for number in whole[len(text) :].split(":")[1:]]
    if text in SHIPPED:
        _check_numbers(whole, SHIPPED[text], numbers)
        with naming(f"robot {whole!r}", ModelError):
            return SHIPPED[text](*numbers)
    if "\0" in text:
        raise BadInput(f"robot {text!r} is not a valid file name")
    file, colon, name = text.rpartition(":")
    if not colon and (text.endswith(".toml") or text in {file.stem for file in SPECS.rglob("*.toml")}):
        raise BadInput(
            f"{text} is a SPEC, where a robot is expected: give the robot that it names, or `noslip simulate "
            f"{text}`"
        )
    if not colon and not text.endswith(".py"):
        raise BadInput(
            f"unknown robot {text!r} (neither a shipped name nor "
            f"path/to/file.py:name){suggestion(text, SHIPPED)}"
        )
    if file in SHIPPED:
        raise BadInput(f"robot {whole!r}: the arguments after a shipped name must be integers")
    if not colon:
        file, name = text, ""
    return _robot_of_file(Path(file), name, kinds, numbers)


def find_laws(system: ReducedSystem) -> tuple[str, ...]:
    """Return the names of the laws that this robot can have, Types I to IV first, then its own; if there are
    none, its own that need a dynamic extension.
    """
    found = tuple(name for name in output_names(system.mechanism) if _fits(system, name))
    extended = (output.name + EXTENDED for output in system.mechanism.outputs)
    return found or tuple(name for name in extended if _fits(system, name))


@cache
def law_of(robot: Mechanism | ReducedSystem, law_name: str) -> ControlLaw:
    """Return the control law, built once per process. Raises BadInput for an unknown name,
    ModelError as `control_law` does."""
    mechanism = robot if isinstance(robot, Mechanism) else robot.mechanism
    check_law(mechanism, law_name)
    system = system_of(robot) if isinstance(robot, Mechanism) else robot
    with placed(mechanism, f"{law_name!r}"):
        return control_law(system, output_map(system, law_name))


def check_law(robot: Mechanism, law_name: str) -> None:
    """Raise BadInput unless the name is one of Types I to IV or of the robot's own outputs."""
    dynamic = without_kinematic(law_name)
    in_time = without_arclength(dynamic)
    names, plain = output_names(robot), without_extension(in_time)
    exact = without_damping(plain)
    if exact not in names and without_offset(exact) not in STANDARD:
        check_named(law_name, names, "unknown output")
    if in_time != dynamic and in_time != COURSE:
        raise BadInput(f"{law_name}: only {COURSE}{ARCLENGTH} is along the way")
    if plain != in_time and dynamic != law_name:
        raise BadInput(
            f"{law_name}: a kinematic law has no dynamic extension: it has no accelerations; take "
            f"{plain}{KINEMATIC}"
        )
    if plain != law_name and exact != plain:
        other = "kinematic" if plain == dynamic else "extended"
        raise BadInput(
            f"{law_name}: a damped law cannot be {other}: it damps accelerations, without integrators; take "
            f"{plain}"
        )


def refuse_course(law_names: Iterable[str], where: str) -> None:
    """Raise BadInput for a law along a course; `where` names what would give it the same config at each
    step."""
    for law_name in law_names:
        name = LawName.parse(law_name)
        if name and name.path == "course":
            raise BadInput(
                f"{where}: the config of {law_name} is the nearest point of a course, new at each step; take "
                "its C alone, from noslip generate, and see docs/extension.md"
            )


@cache
def system_of(robot: Mechanism) -> ReducedSystem:
    """Return the reduced system, built once per process. Raises ModelError as `reduce` does."""
    with placed(robot):
        return reduce(robot)


@contextmanager
def placed(robot: object, about: str = "") -> Iterator[None]:
    """Prefix a ModelError about a robot of a user's file with file and line of the call that it,
    or `about`, names."""
    try:
        yield
    except ModelError as error:
        source = _sources.get(robot) if isinstance(robot, Mechanism) else None
        if source is None:
            raise
        raise ModelError(f"{source.path}:{source.line_of(f'{about} {error}')}: {error}") from error


def check_trust(robot: str, file: Path | str, trusted: bool) -> None:
    """Raise BadInput if `file` names a robot file, which is Python code,
    and the user has not given --trust."""
    if not trusted and robot.split(":")[0] not in SHIPPED and (":" in robot or robot.endswith(".py")):
        raise BadInput(
            f"{file} names the robot {robot!r}, a file whose code would be executed; read it, then add "
            "--trust"
        )


def beside(robot: str, file: Path | str) -> str:
    """Return a robot named in a file; "path/to/file.py:name" is looked up relative to that file first, then
    to the current folder.
    """
    stem, py, name = robot.partition(".py")
    return f"{near(stem + py, file)}{name}" if py else robot


def near(name: str, file: Path | str) -> str:
    """Return a file that is named in another `file`, or in the shipped SPEC of that name, looked up relative
    to that first, then to the current folder.
    """
    with suppress(BadInput):  # a text of another name
        file = file_or_shipped(file, ".toml")
    there = Path(file).parent / name
    return str(there) if "\0" not in name and there.is_file() else name


def _fits(system: ReducedSystem, law_name: str) -> bool:
    try:
        law_of(system, law_name)
    except ModelError:
        return False
    return True


def _check_numbers(text: str, robot: Any, numbers: list[int]) -> None:
    """Raise BadInput if the robot does not accept these arguments."""
    try:
        taken = inspect.signature(robot)
    except (TypeError, ValueError):  # not a function, or one without a signature
        taken = None
    try:
        if taken:
            taken.bind(*numbers)
        if taken or not numbers:
            return
    except TypeError:
        pass
    names = ", ".join(taken.parameters) if taken else ""
    raise BadInput(
        f"robot {text!r}: it takes {f'the numbers {names}' if names else 'no numbers'}; {len(numbers)} are "
        "given"
    )


def _robot_of_file(path: Path, name: str, kinds: tuple[type, ...], numbers: list[int]) -> Any:
    text = read_input(path)
    module = _run(path, text)
    candidates = [key for key, value in vars(module).items() if isinstance(value, kinds)]
    candidates += [
        key
        for key, value in vars(module).items()
        if getattr(value, "__module__", None) == module.__name__ and callable(value)
    ]
    if name not in vars(module):
        problem = f"it does not define a robot {name!r}" if name else "no robot is named"
        raise BadInput(f"{path}: {problem}; give {path}:name{suggestion(name, candidates)}")
    attribute = robot = getattr(module, name)
    if callable(attribute) or numbers:
        _check_numbers(":".join([f"{path}:{name}", *map(str, numbers)]), attribute, numbers)
        robot = _guarded(path, lambda: attribute(*numbers))
    source = Source(path, text, *_lines(text, name))
    if not isinstance(robot, kinds):
        actual = f"it is {type(robot).__name__}"
        if callable(attribute):
            actual = f"it returns {type(robot).__name__}" + (
                "; is `return` missing?" if robot is None else ""
            )
        problem = "neither a Mechanism nor a function without arguments that returns one"
        raise BadInput(f"{path}:{source.line}: {name} is {problem}: {actual}")
    if isinstance(robot, Mechanism):
        _sources[robot] = source
    return robot


def _lines(text: bytes, name: str) -> tuple[int, int]:
    """Return first and last line of the statement of a module that binds a name,
    or of its first line if there is none."""
    for node in ast.parse(text).body:
        names = [
            getattr(node, "name", None),
            *(getattr(target, "id", None) for target in getattr(node, "targets", ())),
        ]
        if name in names:
            return node.lineno, node.end_lineno or node.lineno
    return 1, 1


def _run(path: Path, source: bytes) -> types.ModuleType:
    """Execute the user's file as a module; it can import modules in the same folder that no library is named
    like."""
    module = types.ModuleType(path.stem)
    module.__file__ = str(path)
    _guarded(path, lambda: exec(compile(source, str(path), "exec"), vars(module)))
    return module


@contextmanager
def _modules_beside(path: Path) -> Iterator[None]:
    """Let code import the modules beside a file, after all libraries: a control.py there does not replace
    python-control.

    They are forgotten at the end, so that the modules beside another file may have the same names.
    """
    folder, known = str(path.resolve().parent), set(sys.modules)
    sys.path.append(folder)
    try:
        yield
    finally:
        sys.path.remove(folder)
        new = {name: getattr(sys.modules[name], "__file__", None) for name in set(sys.modules) - known}
        beside = {
            name
            for name, file in new.items()
            if file in (f"{folder}/{name}.py", f"{folder}/{name}/__init__.py")
        }
        for name in new:
            if name.partition(".")[0] in beside:
                del sys.modules[name]


def _guarded(path: Path, call):
    """Return call(). An exception of the user's code becomes BadInput with the last line of the user's file
    in its traceback."""
    try:
        with _modules_beside(path):
            return call()
    except (Exception, SystemExit) as error:
        lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)]
        if isinstance(error, SyntaxError) and error.filename == str(path):
            lines.append(error.lineno)
        kind = "" if isinstance(error, ModelError) else f"{type(error).__name__}: "
        near = ""
        if isinstance(error, AttributeError) and error.name and error.obj is not None:
            near = suggestion(
                error.name, [attribute for attribute in dir(error.obj) if not attribute.startswith("_")]
            )
        raise BadInput(
            f"{path}:{lines[-1] if lines else 1}: {kind}{error}{near if 'did you mean' in near else ''}"
        ) from error
