"""Robots and laws by name, as on the command line and in files."""

import difflib
import inspect
import re
import sys
import traceback
import types
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from ..model.errors import ModelError
from ..model.law import ControlLaw, control_law
from ..model.mechanism import Mechanism
from ..model.outputs import OFFSET, OUTPUTS, output_map, output_names
from ..model.reduction import ReducedSystem, reduce
from ..model.robots import ROBOTS
from .errors import BadInput


@cache
def find_robot(text: str, kinds: tuple[type, ...] = (Mechanism,)) -> Mechanism:
    """A shipped name, or "path/to/file.py:name" where name is a Mechanism, or another of `kinds`, or a function answering one.

    Whole numbers after it, each with a colon before, are the function's arguments: "tractor_trailer:4". Raises BadInput:
    unknown name, no such file, numbers that the function does not take, or, with file and line, an error that the user's
    own code raised.
    """
    whole = text
    text, *numbers = re.fullmatch(r"(.*?)((?::-?\d+)*)", text, re.DOTALL).groups()
    numbers = [int(number) for number in numbers[0].split(":")[1:]]
    if text in ROBOTS:
        _check_numbers(whole, ROBOTS[text], numbers)
        try:
            return ROBOTS[text](*numbers)
        except ModelError as error:
            raise BadInput(f"robot {whole!r}: {error}") from error
    if "\0" in text:
        raise BadInput(f"robot {text!r} is no name of a file")
    file, colon, name = text.rpartition(":")
    if not colon and not text.endswith(".py"):
        raise BadInput(f"unknown robot {text!r} (neither a shipped name nor path/to/file.py:name){suggestion(text, ROBOTS)}")
    if file in ROBOTS:
        raise BadInput(f"robot {whole!r}: what follows a shipped name must be whole numbers")
    if not colon:
        file, name = text, ""
    return _robot_of_file(Path(file), name, kinds, numbers)


def find_laws(system: ReducedSystem) -> tuple[str, ...]:
    """Names of the laws that this robot can have, Types I to IV before its own; empty when none fits."""
    return tuple(name for name in output_names(system.mechanism) if _fits(system, name))


@cache
def law_of(robot: Mechanism | ReducedSystem, law_name: str) -> ControlLaw:
    """The control law, built once per process. Raises BadInput for an unknown name, ModelError as `control_law` does."""
    check_law(robot if isinstance(robot, Mechanism) else robot.mechanism, law_name)
    system = system_of(robot) if isinstance(robot, Mechanism) else robot
    return control_law(system, output_map(system, law_name))


def check_law(robot: Mechanism, law_name: str) -> None:
    """Raise BadInput for a name that is neither of Types I to IV nor of the robot's own outputs."""
    known = output_names(robot)
    if law_name not in known and law_name.removesuffix(OFFSET) not in OUTPUTS:
        raise BadInput(f"unknown output {law_name!r}{suggestion(law_name, known)}")


@cache
def system_of(robot: Mechanism) -> ReducedSystem:
    """The reduced system, built once per process. Raises ModelError as `reduce` does."""
    return reduce(robot)


def suggestion(name: str, known: Iterable[str]) -> str:
    """The end of a message about an unknown name: the nearest one, or all."""
    known = list(known)
    near = difflib.get_close_matches(name, known, 1)
    return f"; did you mean {near[0]!r}?" if near else f"; known are {', '.join(known) or 'none'}"


def _fits(system: ReducedSystem, law_name: str) -> bool:
    try:
        law_of(system, law_name)
    except ModelError:
        return False
    return True


def _check_numbers(text: str, robot: object, numbers: list[int]) -> None:
    """Raise BadInput where the robot is a function that does not take these numbers, or none and there are some."""
    try:
        taken = inspect.signature(robot)
    except (TypeError, ValueError):  # no function, or one that does not say
        taken = None
    try:
        if taken:
            taken.bind(*numbers)
        if taken or not numbers:
            return
    except TypeError:
        pass
    names = ", ".join(taken.parameters) if taken else ""
    raise BadInput(f"robot {text!r}: it takes {f'the numbers {names}' if names else 'no numbers'}, given are {len(numbers)}")


def _robot_of_file(path: Path, name: str, kinds: tuple[type, ...], numbers: list[int]) -> Mechanism:
    module = _run(path)
    made = [key for key, value in vars(module).items() if isinstance(value, kinds)]
    made += [
        key for key, value in vars(module).items() if getattr(value, "__module__", None) == module.__name__ and callable(value)
    ]
    if name not in vars(module):
        wanted = f"no robot {name!r} in it" if name else "say which robot"
        raise BadInput(f"{path}: {wanted}; give {path}:name{suggestion(name, made)}")
    robot = getattr(module, name)
    if callable(robot) or numbers:
        _check_numbers(":".join([f"{path}:{name}", *map(str, numbers)]), robot, numbers)
        robot = _guarded(path, lambda: robot(*numbers))
    if not isinstance(robot, kinds):
        raise BadInput(
            f"{path}: {name} is no Mechanism nor a function without arguments that answers one, it is {type(robot).__name__}"
        )
    return robot


def _run(path: Path) -> types.ModuleType:
    """The user's file as a module; her own modules beside it can be imported."""
    module = types.ModuleType(path.stem)
    module.__file__ = str(path)
    source = path.read_bytes()
    folder = str(path.resolve().parent)
    sys.path.insert(0, folder)
    try:
        _guarded(path, lambda: exec(compile(source, str(path), "exec"), vars(module)))
    finally:
        sys.path.remove(folder)
    return module


def _guarded(path: Path, call):
    """Answer call(); whatever the user's code raises becomes BadInput with the last line of her file that took part."""
    try:
        return call()
    except (Exception, SystemExit) as error:
        lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)]
        if isinstance(error, SyntaxError) and error.filename == str(path):
            lines.append(error.lineno)
        kind = "" if isinstance(error, ModelError) else f"{type(error).__name__}: "
        raise BadInput(f"{path}:{lines[-1] if lines else 1}: {kind}{error}") from error
