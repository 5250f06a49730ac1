"""A SPEC with some entries changed, for example `initial.heading` = 0.5."""

import copy
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...readers.errors import BadInput, naming
from ...readers.quantities import TYPED, spaced
from .spec import DEEPEST, Spec, read_text, spec_of, spec_of_table, toml_table


def read_varied(file: Path | str, changes: Mapping[str, Any]) -> Spec:
    """Return the SPEC of a file with `changes`, dotted key -> TOML value, checked like the file itself.

    A table as value replaces the whole table. Raises BadInput, naming the file.
    """
    return varied(read_text(file), file, changes)


def varied(text: str, name: Path | str, changes: Mapping[str, Any]) -> Spec:
    """Return the SPEC of a text with changes; `name` is that of the text,
    whose own errors are reported first."""
    try:
        table = toml_table(text)
        with naming(f"{name} with {', '.join(changes)} changed"):
            for key, value in changes.items():
                _set(table, key, value)
            return spec_of_table(table, name)
    except BadInput:
        spec_of(text, name)
        raise


def change(text: str) -> tuple[str, Any]:
    """Read `key=value`, with the value in TOML, a number with a unit,
    or a word. Raises BadInput if it is invalid."""
    key, equals, value = text.partition("=")
    try:
        read = toml_table(f"value = {value}")
    except BadInput:
        value, read = value.strip(), {}
        if re.fullmatch(TYPED, value):
            read = {"value": spaced(value)}
        elif re.fullmatch(r"[A-Za-z_][\w+.-]*", value, re.ASCII):
            # a word, of which a shell took the quotation marks away
            read = {"value": value}
    if not equals or not key.strip() or list(read) != ["value"] or key.count(".") >= DEEPEST:
        text = text if len(text) <= 80 else f"{text[:77]}..."
        raise BadInput(
            f"{text!r} is not KEY=VALUE in TOML, for example initial.heading=0.5, initial.heading='90 deg' "
            "or output.type='\"I\"'"
        )
    return key.strip(), read["value"]


def _set(table: dict[str, Any], key: str, value: Any) -> None:
    *sections, last = key.split(".")
    for depth, name in enumerate(sections):
        table = table.setdefault(name, {})
        if not isinstance(table, dict):
            raise BadInput(f"{key}: {'.'.join(sections[: depth + 1])} is not a table")
    table[last] = copy.deepcopy(value)


def spec_text(table: Mapping[str, Any]) -> str:
    """Return a table of a SPEC as TOML, sections last; tables inside sections are written in one line."""
    sections = {
        key: value for key, value in table.items() if isinstance(value, Mapping) and not _is_numbers(value)
    }
    lines = [f"{_key(key)} = {_value(value)}" for key, value in table.items() if key not in sections]
    for name, section in sections.items():
        lines += [
            "",
            f"[{_key(name)}]",
            *(f"{_key(key)} = {_value(value)}" for key, value in section.items()),
        ]
    return "\n".join(lines) + "\n"


def _is_numbers(value: Mapping[str, Any]) -> bool:
    return bool(value) and all(type(each) in (int, float) for each in value.values())


def _key(key: str) -> str:
    return key if re.fullmatch(r"[\w-]+", key, re.ASCII) else json.dumps(key)


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(key)} = {_value(each)}" for key, each in value.items()) + " }"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    # Integers, strings, true and false as in JSON
    return repr(value) if type(value) is float else json.dumps(value)
