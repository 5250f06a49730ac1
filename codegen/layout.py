"""Small helpers for C text that people read."""

import re
from collections.abc import Sequence

WIDTH = 120


def table(rows: Sequence[tuple[str, str]], indent: str = "    ") -> list[str]:
    """Declarations with their comments in one column; a comment that would run too far stands above."""
    width = max((len(left) for left, _ in rows), default=0)
    lines = []
    for left, comment in rows:
        line = f"{indent}{left.ljust(width)} /* {comment} */" if comment else f"{indent}{left}"
        lines.extend([line] if len(line) <= WIDTH else [f"{indent}/* {comment} */", f"{indent}{left}"])
    return lines


def comment(lines: Sequence[str]) -> str:
    """A block comment."""
    return "\n".join(["/*", *(f" * {line}".rstrip() for line in lines), " */"])


def fill(text: str, indent: str) -> list[str]:
    """A C statement or signature broken after commas and operators to fit the width, continuation lines indented further."""
    inner = text.lstrip()
    indent, text = indent + text[: len(text) - len(inner)], inner
    pieces = re.split(r"(?<=,) |(?<= [-+*/=]) |(?<=&&) |(?<=\|\|) ", text)
    lines = [indent + pieces[0]]
    for piece in pieces[1:]:
        longer = f"{lines[-1]} {piece}"
        if len(longer) <= WIDTH:
            lines[-1] = longer
        else:
            lines.append(f"{indent}    {piece}")
    return lines


def body(statements: Sequence[str], indent: str = "    ") -> str:
    """Statements, one a line."""
    return "\n".join(line for statement in statements for text in statement.split("\n") for line in fill(text, indent))


def guard_name(file_name: str) -> str:
    """Include guard of a header."""
    return re.sub(r"[^A-Z0-9]", "_", file_name.upper())


def c_linkage(declarations: str) -> list[str]:
    """Declarations that C++ can use too."""
    return ["#ifdef __cplusplus", 'extern "C" {', "#endif", "", declarations, "", "#ifdef __cplusplus", "}", "#endif"]
