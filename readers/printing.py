"""How results are written: tables in columns, values for JSON, values in TOML."""

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

WIDTH = 110  # columns of a line of JSON


def columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return a line for each row, the first column aligned to the left, the others to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])]) for row in rows]


def plain(value: Any) -> Any:
    """Return a value in a form that JSON has: arrays as lists, complex numbers as pairs,
    None for numbers that are not finite."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = dataclasses.asdict(value)
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, complex | np.complexfloating):
        return [float(value.real), float(value.imag)]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value


def as_json(value: Any, indent: int = 0) -> str:
    """Return a value that `plain` has given as JSON, in lines of at most WIDTH columns where its texts allow:
    what fits on one line is on one, and lines are filled with members that fit on one.
    """
    text = json.dumps(value, ensure_ascii=False, allow_nan=False)
    if len(text) + indent < WIDTH or not value or not isinstance(value, Mapping | list | tuple):
        return text
    indent += 1
    if isinstance(value, Mapping):
        members = [
            f"{json.dumps(key, ensure_ascii=False)}: {as_json(member, indent)}"
            for key, member in value.items()
        ]
    else:
        members = [as_json(member, indent) for member in value]
    lines = [members[0]]
    for member in members[1:]:
        if "\n" in member + lines[-1] or indent + len(lines[-1]) + len(member) + 3 > WIDTH:
            lines.append(member)
        else:
            lines[-1] += f", {member}"
    start, end = "{}" if isinstance(value, Mapping) else "[]"
    return f"{start}\n{' ' * indent}" + f",\n{' ' * indent}".join(lines) + f"\n{' ' * (indent - 1)}{end}"


def toml(value: Any) -> str:
    """Return a value as TOML, on one line."""
    if isinstance(value, Mapping):
        return (
            "{ " + ", ".join(f"{key} = {toml(item)}" for key, item in value.items()) + " }" if value else "{}"
        )
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml, value))}]"
    return json.dumps(value)
