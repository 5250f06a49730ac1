"""Numbers with and without units, and the range of numbers in files and options; outside it, products and
powers would overflow or underflow.

A number may be given with a unit, "36 km/h"; pint knows the units. It is given single names only: as an
evaluator of expressions it would compute "9**9**9**9 m".
"""

import argparse
import re
from collections.abc import Callable
from decimal import Decimal
from functools import cache
from typing import TYPE_CHECKING, Any

from .errors import BadInput

if TYPE_CHECKING:
    import pint

SMALLEST, LARGEST = 1e-30, 1e30  # in SI units; physical sizes of a robot are well between

NUMBER = r"[-+]?(?:[0-9]{1,40}(?:\.[0-9]{0,40})?|\.[0-9]{1,40})(?:[eE][-+]?[0-9]{1,3})?"
FACTOR = r"[A-Za-z_]{1,30}(?:(?:\^|\*\*)-?[0-9])?"
UNIT = rf"(?:{FACTOR}(?:(?: ?\* ?| ){FACTOR}){{0,7}}(?: ?/ ?{FACTOR}){{0,7}}|1(?: ?/ ?{FACTOR}){{1,7}})"
QUANTITY = rf"({NUMBER}) {{1,4}}({UNIT})"  # also a regular expression of JSON Schema
TYPED = QUANTITY.replace("{1,4}", "{0,4}")  # on a command line, where a space needs quotation marks: 10ms

Dimension = frozenset[tuple[str, int]]
PLAIN = ("", "1")  # units of numbers without dimension


class Measured(float):
    """A number given with its unit: its value in SI, the text that was given, the powers of its base units.

    An angle is not a plain number here: rad/s and 1/s differ, hence rpm and Hz.
    """

    text: str
    dimension: Dimension


def measured(text: str, where: str, unit: str | None = None) -> Measured:
    """Return the number of a text such as "36 km/h" in SI, rounded once; `unit`, if known, is what it must be
    in.

    Raises BadInput for anything but a number and a known unit, and for a unit of another kind.
    """
    parts = re.fullmatch(QUANTITY, text)
    if not parts:
        shown = text if len(text) <= 60 else f"{text[:57]}..."
        raise BadInput(f"{where} = {shown!r} is not a number{_advice(unit)}")
    try:
        factor, dimension = in_base_units(parts[2])
    except BadInput as error:
        raise BadInput(f'{where} = "{text}": {error}{_advice(unit)}') from error
    value = Measured(Decimal(parts[1]) * factor)
    value.text, value.dimension = text, dimension
    if unit is not None:
        check_unit(value, unit, where)
    return value


def check_unit(value: float, unit: str, where: str) -> None:
    """Raise BadInput if a number was given with a unit of another kind than `unit`,
    which must be one of SI."""
    if not isinstance(value, Measured):
        return
    try:
        factor, dimension = in_base_units(unit)
    except BadInput:
        factor, dimension = Decimal(0), frozenset()
    if factor != 1:
        raise BadInput(
            f'{where} = "{value.text}": its unit, {unit!r}, is not one of SI; write a plain number'
        )
    if value.dimension != dimension:
        units = (name if power == 1 else f"{name}^{power}" for name, power in sorted(value.dimension))
        actual = " ".join(units) or "a plain number"
        raise BadInput(f'{where} = "{value.text}" has the wrong dimension, {actual}{_advice(unit)}')


def _advice(unit: str | None) -> str:
    """Return the end of a message: what to write."""
    if unit is None:
        return '; write a number in SI units, or a number, a space and a unit: "90 deg", "36 km/h", "2 N m"'
    if unit in PLAIN:
        return "; write a number without a unit"
    return f'; write a number in {unit}, or a number, a space and a unit, such as "1 {unit}"'


ALIASES = {
    "°": "deg",
    "µ": "u",
    "μ": "u",
    "²": "^2",
    "Nm": "N m",
    "RPM": "rpm",
    "revs": "turn",
    "rev": "turn",
}
SCALED = rf"(?:({NUMBER}) ?)?({UNIT})(?: ?/ ?({NUMBER}))?"


def scaled_units(text: str) -> tuple[Decimal, Dimension]:
    """Return as `in_base_units` for a unit with a factor, "turn/4096" or "0.1 deg", in a spelling of tables,
    "µs" or "°/s".

    Raises BadInput for what is not a unit, and for a factor of 0.
    """
    for spelling, name in ALIASES.items():
        text = re.sub(rf"(?<![A-Za-z]){spelling}(?![A-Za-z])" if spelling.isascii() else spelling, name, text)
    parts = re.fullmatch(SCALED, text)
    if not parts:
        return in_base_units(text)
    factor, dimension = in_base_units(parts[2])
    product, quotient = Decimal(parts[1] or 1), Decimal(parts[3] or 1)
    if not product or not quotient:
        raise BadInput(f"{text!r} has a factor of 0")
    return factor * product / quotient, dimension


def is_unit(text: str) -> bool:
    """Return whether a text is a unit, perhaps with a factor."""
    try:
        scaled_units(text)
    except BadInput:
        return False
    return True


@cache
def in_base_units(text: str) -> tuple[Decimal, Dimension]:
    """Return the factor from a unit to SI's base units, and their powers. Raises BadInput for what is not a
    unit."""
    if text in PLAIN:
        return Decimal(1), frozenset()
    if not re.fullmatch(UNIT, text):
        raise BadInput(f"{text!r} is not a unit")
    product: Any = _registry().Quantity(Decimal(1))
    for over, name, power in re.findall(r"(/ ?)?([A-Za-z_]+)(?:(?:\^|\*\*)(-?[0-9]))?", text):
        product *= _unit(name) ** ((-1 if over else 1) * int(power or 1))
    return product.magnitude, frozenset((base, int(power)) for base, power in product.unit_items() if power)


def _unit(name: str) -> Any:
    """Return one unit in base units. Raises BadInput for an unknown one, and for one such as degC,
    whose zero is not zero."""
    registry = _registry()
    try:
        zero, one = (registry.Quantity(Decimal(k), registry.Unit(name)).to_base_units() for k in (0, 1))
    except Exception as error:  # unknown names, and what pint cannot compute in decimals: logarithmic units
        raise BadInput(f"unknown unit {name!r}") from error
    if zero.magnitude:
        raise BadInput(f"{name!r} has another zero than its SI unit")
    return one


@cache
def _registry() -> "pint.UnitRegistry":
    import pint  # slow to import

    return pint.UnitRegistry(non_int_type=Decimal)  # decimals: 3 ft are 0.9144 m, not 0.9143999999999999


def spaced(text: str) -> str:
    """Return a typed quantity such as "10ms" with the space that a file has: "10 ms"."""
    return re.sub(rf"\A({NUMBER}) *", r"\1 ", text)


def in_range(value: float) -> bool:
    """Return whether the absolute value of a finite number is zero or within the range."""
    return value == 0 or SMALLEST <= abs(value) <= LARGEST


def quantity(unit: str | None = None) -> Callable[[str], float]:
    """Return a reader of a number on the command line, for argparse: in `unit`, or with another of the same
    kind.

    The option itself must check that the number is finite and, if no unit is named here, that it was given in
    the right one.
    """

    def read(text: str) -> float:
        try:
            value = measured(spaced(text), "value", unit) if re.fullmatch(TYPED, text) else float(text)
        except BadInput as error:
            raise argparse.ArgumentTypeError(str(error)) from error
        if value - value == 0 and not in_range(value):
            raise argparse.ArgumentTypeError(
                f"{text} is out of range: give 0 or a size between {SMALLEST:g} and {LARGEST:g}"
            )
        return value

    read.__name__ = "float"  # argparse prints this name if the text is not a number
    return read
