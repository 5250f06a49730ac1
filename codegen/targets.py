"""The table of targets, firmware/boards/targets.toml, and the include of firmware/Makefile that is made from
it."""

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

BOARDS = Path(__file__).resolve().parent.parent / "firmware" / "boards"
TABLE: dict[str, Any] = tomllib.loads((BOARDS / "targets.toml").read_text(encoding="utf-8"))
STANDARD: tuple[str, ...] = tuple(TABLE["standard"])  # flags with which all targets compute the same bits
# The dialect is set apart
SAME_BITS: tuple[str, ...] = tuple(flag for flag in STANDARD if not flag.startswith("-std="))

HEAD = """# Made from boards/targets.toml by `make generate`; edit that file.
"""


def entries(target: str) -> dict[str, Any]:
    """A target's entries in the table, and those of its processor. Raises KeyError for an unknown target."""
    row = TABLE["target"][target]
    return {**(TABLE["target"][row["processor"]] if "processor" in row else {}), **row}


def flags(target: str) -> tuple[str, ...]:
    """The flags of a target's processor, without those of `STANDARD`. Raises KeyError for an unknown
    target."""
    row = entries(target)
    return (*row["flags"], *TABLE["toolchain"][row["toolchain"]]["flags"])


def makefile() -> str:
    """Text of firmware/targets.mk: the targets that a vehicle is built for,
    a variable for each of their entries."""
    rows = {name: entries(name) for name, row in TABLE["target"].items() if "vehicle" in row}
    lines = [HEAD, f"standard := {' '.join(STANDARD)}", f"TARGETS := {' '.join(rows)}"]
    for name, row in rows.items():
        toolchain = TABLE["toolchain"][row["toolchain"]]
        lines += [
            "",
            *_set(f"cpu_{name}", flags(name)),
            *_set(f"board_{name}", [*row["start"], *row["vehicle"]]),
            *_set(f"script_{name}", [row["script"]]),
            *_set(f"clock_{name}", [str(row["clock"])] if "clock" in row else []),
            *_set(f"machine_{name}", row.get("machine", [])),
            *_set(f"cross_{name}", [toolchain["prefix"]]),
            *_set(f"clang_{name}", [toolchain["clang"]]),
        ]
    return "\n".join(lines) + "\n"


def _set(name: str, words: Sequence[str]) -> list[str]:
    return [f"{name} := {' '.join(words)}"] if words else []


if __name__ == "__main__":
    print(makefile(), end="")
