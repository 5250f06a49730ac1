"""Readers of values and sections of TOML. Each checks its value; the error message says where the value is.

Each also knows its unit and its JSON Schema: what it reads is declared once.
"""

import dataclasses
import inspect
import math
import operator
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..model.mechanism import SIGNS
from .errors import BadInput, check_named
from .quantities import LARGEST, PLAIN, QUANTITY, SMALLEST, Measured, check_unit, in_range, measured, spaced

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Schema = dict[str, Any]
DRAFT = "http://json-schema.org/draft-07/schema#"  # which editors of TOML understand
BOUNDS: dict[str, Schema] = {"any": {}, "positive": {"exclusiveMinimum": 0}, "nonnegative": {"minimum": 0}}
SI = "in SI units"
MOST_ANGLE = 6.284  # rad: a turn, also a rounded one; a larger plain number is likely to be in degrees
DEFINITIONS: dict[str, Schema] = {  # of JSON Schema, for `ref`
    "quantity": {
        "type": "string",
        "pattern": f"^{QUANTITY}$",
        "description": 'a number with a unit, such as "36 km/h"',
    }
}


@dataclasses.dataclass(frozen=True)
class Reader:
    """A reader of a value: `read(value, where)` returns the value or raises BadInput.

    `schema()` returns its JSON Schema. `unit` is that of a number, or of each number of a list, in SI; None
    where it depends on the robot. `kind` is the dataclass that a table is read into. `check(value, where)`
    raises BadInput for a number beyond the bounds of the reader.
    """

    read: Callable[[Any, str], Any]
    schema: Callable[[], Schema]
    unit: str | tuple[str, ...] | None = None
    kind: "type[DataclassInstance] | None" = None
    check: Callable[[Any, str], None] = lambda value, where: None

    def about(self, meaning: str) -> "Reader":
        """Return the same reader; its schema says what the value means, before unit and form."""

        def schema() -> Schema:
            base = self.schema()
            return {**base, "description": ", ".join(filter(None, (meaning, base.get("description"))))}

        return dataclasses.replace(self, schema=schema)

    def __call__(self, value: Any, where: str) -> Any:
        """Return the value that was read."""
        return self.read(value, where)


def reads(
    schema: Schema | Callable[[], Schema], unit: str | None = None, **options: Any
) -> Callable[[Callable[[Any, str], Any]], Reader]:
    """Return a decorator that makes a function a Reader of values with this schema,
    with further `options` of Reader."""
    return lambda read: Reader(read, schema if callable(schema) else lambda: schema, unit, **options)


def of_type(value: Any, kind: type | tuple[type, ...], where: str, what: str) -> Any:
    """Return the value if it is of this type; `what` names it. Raises BadInput for others;
    true and false are no numbers."""
    if not isinstance(value, kind) or isinstance(value, bool) and kind is not bool:
        raise BadInput(f"{where} = {value!r} is not {what}")
    return value


def ref(name: str) -> Schema:
    """Return a reference to one of DEFINITIONS."""
    return {"$ref": f"#/definitions/{name}"}


def check_keys(keys: Iterable[str], allowed: Iterable[str], where: str) -> None:
    """Raise BadInput for a key that is not allowed, suggesting the nearest one that is."""
    allowed = list(allowed)
    for key in keys:
        check_named(key, allowed, f"{where}: unknown key")


def number(
    sign: str = "any",
    unit: str | None = None,
    above: float | None = None,
    below: float | None = None,
    least: float | None = None,
    most: float | None = None,
) -> Reader:
    """Return a reader of a finite number with a sign: any, positive or nonnegative; between `above` and
    `below`, and from `least` to `most`.

    A number may be given as a string with a unit and is returned in SI; without `unit`, as Measured: the
    robot or the law decides by `check_unit` whether it is the right one.
    """
    holds, requirement = SIGNS[sign]
    described = SI if unit is None else "a number without unit" if unit in PLAIN else f"in {unit}"
    limits = {
        kind: (within, limit, words)
        for kind, within, limit, words in (
            ("exclusiveMinimum", operator.gt, above, "above"),
            ("exclusiveMaximum", operator.lt, below, "below"),
            ("minimum", operator.ge, least, "at least"),
            ("maximum", operator.le, most, "at most"),
        )
        if limit is not None
    }
    bounds = BOUNDS[sign] | {kind: limit for kind, (_, limit, _) in limits.items()}

    def check(size: float, where: str) -> None:
        for within, limit, words in limits.values():
            if not within(size, limit):
                raise BadInput(f"{where} = {size:g} must be {words} {limit:g}")

    @reads(
        {"anyOf": [{"type": "number", **bounds}, ref("quantity")], "description": described},
        unit,
        check=check,
    )
    def read(value: Any, where: str) -> float:
        if isinstance(value, str):
            value = measured(value, where, unit)
        elif unit is not None:
            check_unit(value, unit, where)
        try:
            size = float(of_type(value, (int, float), where, "a number"))
        except OverflowError:
            size = math.inf
        if not math.isfinite(size):
            raise BadInput(f"{where} = {size} is not finite")
        if not in_range(size):
            raise BadInput(
                f"{where} = {size:g} is out of range: give 0 or a size between {SMALLEST:g} and {LARGEST:g}"
            )
        if not holds(size):
            raise BadInput(f"{where} = {size:g} must be {requirement}")
        check(size, where)
        return value if unit is None and isinstance(value, Measured) else size

    return read


def positive(name: str, value: float, where: str = "") -> float:
    """Return the value. Raises BadInput unless it is a positive finite number."""
    named = f"{where}: {name}" if where else name
    return number("positive")(value.item() if isinstance(value, np.number) else value, named)


_radians = number(unit="rad")
_turn = {"type": "number", "minimum": -MOST_ANGLE, "maximum": MOST_ANGLE}


@reads({**_radians.schema(), "anyOf": [_turn, ref("quantity")]}, "rad")
def angle(value: Any, where: str) -> float:
    """Read an angle, rad. More than a turn is accepted only with its unit: it is likely to be in degrees."""
    radians = _radians(value, where)
    if abs(radians) > MOST_ANGLE and not isinstance(value, str | Measured):
        problem = f"{where} = {value:.12g} rad is more than a turn: did you mean degrees?"
        raise BadInput(f'{problem} write "{value:.12g} deg", or "{value:.12g} rad" if that is meant')
    return radians


def row(form: str, *readers: Reader, entries: str = "numbers") -> Reader:
    """Return a reader of a list with an entry for each reader; `form` shows it."""
    items = [reader.schema() for reader in readers]

    def read_all(value: Any, where: str) -> tuple[float, ...]:
        if len(of_type(value, list, where, f"a list of {entries}")) != len(readers):
            raise BadInput(f"{where} has {len(value)} {entries}; it must be {form}")
        return tuple(
            read(item, f"{where}[{k}]") for k, (read, item) in enumerate(zip(readers, value, strict=True))
        )

    schema = {"type": "array", "items": items, "minItems": len(items), "maxItems": len(items)}
    units = tuple(reader.unit for reader in readers if isinstance(reader.unit, str))
    return Reader(
        read_all, lambda: {**schema, "description": f"{form} in {', '.join(dict.fromkeys(units))}"}, units
    )


def ascending(item: Reader, form: str = "[a, b]") -> Reader:
    """Return a reader of two numbers, the first below the second."""
    pair = row(form, item, item)

    def read(value: Any, where: str) -> tuple[float, ...]:
        first, second = pair(value, where)
        if not first < second:
            raise BadInput(f"{where} = [{first:g}, {second:g}]: the first must be below the second")
        return first, second

    return dataclasses.replace(pair, read=read)


point = row("[x, y]", number(unit="m"), number(unit="m"))
pose = row("[x, y, heading]", number(unit="m"), number(unit="m"), angle)


def each_of(item: Callable[[Any, str], Any], value: Any, where: str, what: str) -> tuple[Any, ...]:
    """Return what a reader reads of each item of a list; `what` names the list. Raises BadInput for what is
    no list."""
    return tuple(item(each, f"{where}[{k}]") for k, each in enumerate(of_type(value, list, where, what)))


def numbers_of(item: Reader, empty: str = "") -> Reader:
    """Return a reader of a list of numbers; an `empty` one is refused with what to do, if that is said."""

    def check(values: Iterable[float] | None, where: str) -> None:
        for k, value in enumerate(values or ()):
            item.check(value, f"{where}[{k}]")

    least = {"minItems": 1} if empty else {}

    @reads({"type": "array", "items": item.schema(), **least, "description": SI}, check=check)
    def read(value: Any, where: str) -> tuple[float, ...]:
        if empty and value == []:
            raise BadInput(f"{where} is empty: {empty}")
        return each_of(item, value, where, "a list of numbers")

    return read


numbers = numbers_of(number())  # those with a unit are Measured: the robot or law checks it


def one_for_each(
    values: Sequence[float], names: Sequence[str], where: str, of_all: bool = True
) -> tuple[float, ...]:
    """Return as many values as names; a single one is for all of them, if it may be `of_all`. Raises BadInput
    for another number of values.
    """
    if len(values) == len(names):
        return tuple(values)
    if len(values) == 1 and of_all:
        return tuple(values) * len(names)
    count = f"1 or {len(names)}" if of_all else str(len(names))
    raise BadInput(
        f"{where} has {len(values)} numbers; it must have {count}: {', '.join(names) or 'there is none'}"
    )


_plain = number(unit="1")


def by_name(option: str, texts: Iterable[str], example: str, read: Reader = _plain) -> dict[str, float]:
    """Return the numbers of an option of a command line, NAME=NUMBER each, by name; `read` reads each, by
    default without a unit. Raises BadInput, with an example, for a text of another form, and for a name that
    has a number already.
    """
    numbers: dict[str, float] = {}
    for text in texts:
        name, equals, size = text.rpartition("=")
        if not equals or name in numbers:
            raise BadInput(
                f"{option} {text}: "
                f"{f'{name or option} has a number already' if equals else f'give {example}'}"
            )
        try:
            numbers[name] = read(float(size), f"{option} {name}")
        except ValueError:
            numbers[name] = read(spaced(size), f"{option} {name}")
    return numbers


@reads({"type": "string"})
def text(value: Any, where: str) -> str:
    """Read a string."""
    return of_type(value, str, where, "a string")


def one_of(*words: str) -> Reader:
    """Return a reader of one of these words."""

    @reads({"enum": list(words)})
    def read(value: Any, where: str) -> str:
        if value not in words:
            raise BadInput(f"{where} = {value!r} is not one of {', '.join(words)}")
        return value

    return read


def whole(least: int, most: int | None = None) -> Reader:
    """Return a reader of an integer from `least` to `most`."""
    maximum = {} if most is None else {"maximum": most}

    @reads({"type": "integer", "minimum": least, **maximum})
    def read(value: Any, where: str) -> int:
        if not least <= of_type(value, int, where, "an integer") <= (value if most is None else most):
            raise BadInput(
                f"{where} = {value} must be {f'{least} or more' if value < least else f'at most {most}'}"
            )
        return value

    return read


@reads({"type": "boolean"})
def flag(value: Any, where: str) -> bool:
    """Read true or false."""
    return of_type(value, bool, where, "true or false")


def one_or_each(item: Reader, empty: str = "") -> Reader:
    """Return a reader of a number, or a list of them as `numbers_of` reads it."""
    several = numbers_of(item, empty)

    @reads({"anyOf": [*item.schema()["anyOf"], several.schema()], "description": SI}, check=several.check)
    def read(value: Any, where: str) -> tuple[float, ...]:
        return several(value, where) if isinstance(value, list) else (item(value, where),)

    return read


one_or_more = one_or_each(number())


@reads({"type": "object", "additionalProperties": number().schema(), "description": SI})
def named_numbers(value: Any, where: str) -> dict[str, float]:
    """Read a table of finite numbers. The robot or law checks the names and, of Measured numbers,
    the units."""
    return {key: number()(item, f"{where} {key}") for key, item in table(value, where).items()}


def table_of(readers: Mapping[str, Reader], required: Iterable[str] = ()) -> Schema:
    """Return the schema of a table with these entries and no others."""
    properties = {key: reader.schema() for key, reader in readers.items()}
    needed = {"required": sorted(required)} if required else {}
    return {"type": "object", "properties": properties, **needed, "additionalProperties": False}


def section(kind: "type[DataclassInstance]") -> Reader:
    """Return a reader of a table into the dataclass `kind`."""

    def read(value: Any, where: str) -> Any:
        values, entries = table(value, where), dataclasses.fields(kind)
        check_keys(values, [e.name for e in entries], where or "top level")
        for e in entries:
            if _required(e) and e.name not in values:
                raise BadInput(f"{_path(where, e)} is missing")
        return kind(
            **{
                e.name: e.metadata["read"](values[e.name], _path(where, e))
                for e in entries
                if e.name in values
            }
        )

    def schema() -> Schema:
        entries = dataclasses.fields(kind)
        base = table_of(
            {e.name: e.metadata["read"] for e in entries}, [e.name for e in entries if _required(e)]
        )
        for e in entries:
            if isinstance(e.default, str | int | float):
                base["properties"][e.name] = base["properties"][e.name] | {"default": e.default}
        return {"description": inspect.cleandoc(kind.__doc__ or ""), **base}

    return Reader(read, schema, kind=kind)


class Section:
    """A section whose numbers are within the bounds of their readers, also where it is made in Python."""

    def __post_init__(self) -> None:
        for e in dataclasses.fields(self):  # type: ignore[arg-type]
            e.metadata["read"].check(getattr(self, e.name), e.name)


def list_of(kind: "type[DataclassInstance]", example: str) -> Reader:
    """Return a reader of a list of tables of one kind."""

    def read(value: Any, where: str) -> tuple[Any, ...]:
        return each_of(section(kind), value, where, f"a list, for example [{example}]")

    def schema() -> Schema:
        return {"type": "array", "items": section(kind).schema()}

    return Reader(read, schema)


def units(kind: "type[DataclassInstance]", prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yield the dotted name and the unit of each number of a section whose unit does not depend on the
    robot."""
    for e in dataclasses.fields(kind):
        reader: Reader = e.metadata["read"]
        if reader.kind is not None:
            yield from units(reader.kind, f"{prefix}{e.name}.")
        elif isinstance(reader.unit, tuple):
            yield from ((f"{prefix}{e.name}[{k}]", unit) for k, unit in enumerate(reader.unit))
        elif reader.unit is not None:
            yield f"{prefix}{e.name}", reader.unit


def entry(read: Reader, default: Any = dataclasses.MISSING, about: str = "") -> Any:
    """Declare an entry of a section: its reader, its default and its meaning;
    without a default the entry is required."""
    metadata = {"read": read.about(about) if about else read}
    if isinstance(default, dict):
        return dataclasses.field(default_factory=lambda: dict(default), metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def _required(e: dataclasses.Field) -> bool:
    return e.default is dataclasses.MISSING and e.default_factory is dataclasses.MISSING


def _path(where: str, e: dataclasses.Field) -> str:
    if where:
        return f"{where} {e.name}"
    return f"[{e.name}]" if e.metadata["read"].kind is not None else e.name


def table(value: Any, where: str) -> dict[str, Any]:
    """Return the value if it is a table."""
    return of_type(value, dict, where, "a table")
