"""Readers of values and sections of TOML. Each checks its value; the error message says where the value is."""

import dataclasses
import math
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, TypeVar

from ..model.mechanism import SIGNS
from .errors import BadInput
from .quantities import LARGEST, SMALLEST, in_range
from .robots import suggestion

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Section = TypeVar("Section", bound="DataclassInstance")
Reader = Callable[[Any, str], Any]


def check_keys(given: Iterable[str], known: Iterable[str], where: str) -> None:
    """Raise BadInput for an unknown key, suggesting the nearest known one."""
    known = list(known)
    for key in given:
        if key not in known:
            raise BadInput(f"{where}: unknown key {key!r}{suggestion(key, known)}")


def number(sign: str = "any") -> Reader:
    """Return a reader of a finite number with a sign: any, positive or nonnegative."""
    holds, wanted = SIGNS[sign]

    def read(value: Any, where: str) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise BadInput(f"{where} = {value!r} is not a number")
        try:
            value = float(value)
        except OverflowError:
            value = math.inf
        if not math.isfinite(value):
            raise BadInput(f"{where} = {value} is not finite")
        if not in_range(value):
            raise BadInput(f"{where} = {value:g} is out of range: give 0 or a size between {SMALLEST:g} and {LARGEST:g}")
        if not holds(value):
            raise BadInput(f"{where} = {value:g} must be {wanted}")
        return value

    return read


def numbers(value: Any, where: str) -> tuple[float, ...]:
    """Read a list of finite numbers."""
    if not isinstance(value, list):
        raise BadInput(f"{where} = {value!r} is not a list of numbers")
    return tuple(number()(item, f"{where}[{k}]") for k, item in enumerate(value))


def point(value: Any, where: str) -> tuple[float, ...]:
    """Reads [x, y]."""
    made = numbers(value, where)
    if len(made) != 2:
        raise BadInput(f"{where} has {len(made)} numbers; it must be [x, y]")
    return made


def pose(value: Any, where: str) -> tuple[float, ...]:
    """Read [x, y, heading]."""
    made = numbers(value, where)
    if len(made) != 3:
        raise BadInput(f"{where} has {len(made)} numbers; it must be [x, y, heading]")
    return made


def text(value: Any, where: str) -> str:
    """Read a string."""
    if not isinstance(value, str):
        raise BadInput(f"{where} = {value!r} is not a string")
    return value


def one_of(*known: str) -> Reader:
    """Return a reader of one of the known words."""

    def read(value: Any, where: str) -> str:
        if value not in known:
            raise BadInput(f"{where} = {value!r} is not one of {', '.join(known)}")
        return value

    return read


def whole(least: int) -> Reader:
    """Return a reader of an integer that is at least `least`."""

    def read(value: Any, where: str) -> int:
        if isinstance(value, bool) or not isinstance(value, int):
            raise BadInput(f"{where} = {value!r} is not an integer")
        if value < least:
            raise BadInput(f"{where} = {value} must be {least} or more")
        return value

    return read


def flag(value: Any, where: str) -> bool:
    """Read true or false."""
    if not isinstance(value, bool):
        raise BadInput(f"{where} = {value!r} is neither true nor false")
    return value


def one_or_more(value: Any, where: str) -> tuple[float, ...]:
    """Read a number or a list of numbers."""
    return numbers(value, where) if isinstance(value, list) else (number()(value, where),)


def named_numbers(value: Any, where: str) -> dict[str, float]:
    """Read a table of finite numbers. The robot or law checks the names."""
    return {key: number()(item, f"{where} {key}") for key, item in _table(value, where).items()}


def section(kind: type[Section]) -> Callable[[Any, str], Section]:
    """Return a reader of a table into the dataclass `kind`."""

    def read(value: Any, where: str) -> Section:
        given, entries = _table(value, where), dataclasses.fields(kind)
        check_keys(given, [e.name for e in entries], where or "top level")
        for e in entries:
            required = e.default is dataclasses.MISSING and e.default_factory is dataclasses.MISSING
            if required and e.name not in given:
                raise BadInput(f"{_path(where, e)} is missing")
        return kind(**{e.name: e.metadata["read"](given[e.name], _path(where, e)) for e in entries if e.name in given})

    return read


def entry(read: Reader, default: Any = dataclasses.MISSING) -> Any:
    """Declare an entry of a section: its reader and its default; without a default the entry is required."""
    if isinstance(default, dict):
        return dataclasses.field(default_factory=lambda: dict(default), metadata={"read": read})
    return dataclasses.field(default=default, metadata={"read": read})


def _path(where: str, e: dataclasses.Field) -> str:
    if where:
        return f"{where} {e.name}"
    return f"[{e.name}]" if "section" in e.metadata["read"].__qualname__ else e.name


def _table(value: Any, where: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise BadInput(f"{where} = {value!r} is not a table")
    return value
