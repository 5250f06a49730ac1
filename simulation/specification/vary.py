"""A SPEC with some entries changed: `initial.heading` = 0.5 instead of what the file says."""

import copy
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...readers.errors import BadInput
from .spec import DEEPEST, Spec, read_text, spec_of, spec_of_table, toml_table


def read_varied(file: Path | str, changes: Mapping[str, Any]) -> Spec:
    """The SPEC in a file with `changes`, dotted key -> TOML value, checked as if the file said so.

    A table as value takes the place of the whole table. Raises BadInput, naming the file.
    """
    return varied(read_text(file), file, changes)


def varied(text: str, name: Path | str, changes: Mapping[str, Any]) -> Spec:
    """The same of the text of a SPEC, with a name for it."""
    spec_of(text, name)  # what the text itself has wrong is said without the changes
    table = toml_table(text)
    try:
        for key, value in changes.items():
            _set(table, key, value)
        return spec_of_table(table, name)
    except BadInput as error:
        raise BadInput(f"{name} with {', '.join(changes)} changed: {error}") from error


def change(text: str) -> tuple[str, Any]:
    """Reads `key=value`, the value in TOML. Raises BadInput when it is neither."""
    key, equals, value = text.partition("=")
    try:
        read = toml_table(f"value = {value}")
    except BadInput:
        read = {}
    if not equals or not key.strip() or list(read) != ["value"] or key.count(".") >= DEEPEST:
        text = text if len(text) <= 80 else f"{text[:77]}..."
        raise BadInput(f"{text!r} is not KEY=VALUE in TOML, for example initial.heading=0.5 or output.type='\"I\"'")
    return key.strip(), read["value"]


def _set(table: dict[str, Any], key: str, value: Any) -> None:
    *sections, last = key.split(".")
    for depth, name in enumerate(sections):
        table = table.setdefault(name, {})
        if not isinstance(table, dict):
            raise BadInput(f"{key}: {'.'.join(sections[: depth + 1])} is not a table")
    table[last] = copy.deepcopy(value)
