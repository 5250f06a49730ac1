"""Layout of readable C text."""

import re
import textwrap
from collections.abc import Sequence

from ... import __version__

WIDTH = 120


def table(rows: Sequence[tuple[str, str]], indent: str = "    ") -> list[str]:
    """Return declarations with their comments in a column; a comment that is too long is written above."""
    width = max((len(left) for left, _ in rows), default=0)
    lines = []
    for left, comment in rows:
        line = f"{indent}{left.ljust(width)} /* {comment} */" if comment else f"{indent}{left}"
        above = [indent + text for text in aside(comment, WIDTH - len(indent))]
        lines.extend([line] if len(line) <= WIDTH else [*above, f"{indent}{left}"])
    return lines


def commented(statement: str, about: str, indent: str = "    ") -> str:
    """Return a statement followed by a comment, or preceded by it if the line would be too long."""
    if not about:
        return statement
    line = f"{statement} /* {about} */"
    return line if len(indent + line) <= WIDTH else "\n".join([*aside(about, WIDTH - len(indent)), statement])


def aside(about: str, width: int) -> list[str]:
    """Return the lines of a comment within a function or struct."""
    lines = textwrap.wrap(about, width - 6, break_long_words=False, break_on_hyphens=False) or [""]
    return [
        ("/* " if k == 0 else "   ") + line + (" */" if k == len(lines) - 1 else "")
        for k, line in enumerate(lines)
    ]


def comment(lines: Sequence[str]) -> str:
    """Return a block comment."""
    return "\n".join(["/*", *(f" * {line}".rstrip() for line in lines), " */"])


def fill(text: str, indent: str) -> list[str]:
    """Return a C statement or signature broken after commas and operators to fit the width, continuation
    lines indented further."""
    inner = text.lstrip()
    indent, text = indent + text[: len(text) - len(inner)], inner
    pieces = re.split(r"(?<=,) |(?<= [-+*/=]) (?![^\[]*\])|(?<=&&) |(?<=\|\|) ", text)  # not within brackets
    lines = [indent + pieces[0]]
    for piece in pieces[1:]:
        longer = f"{lines[-1]} {piece}"
        if len(longer) <= WIDTH:
            lines[-1] = longer
        else:
            lines.append(f"{indent}    {piece}")
    return lines


def body(statements: Sequence[str], indent: str = "    ") -> str:
    """Return statements, one per line."""
    return "\n".join(
        line for statement in statements for text in statement.split("\n") for line in _filled(text, indent)
    )


def _filled(text: str, indent: str) -> list[str]:
    """Fill a text unless it is a line of a block comment."""
    return [indent + text] if len(indent + text) <= WIDTH or text.startswith(" *") else fill(text, indent)


def guard_name(file_name: str) -> str:
    """Return the include guard of a header."""
    return re.sub(r"[^A-Z0-9]", "_", file_name.upper())


def c_linkage(declarations: str) -> list[str]:
    """Return declarations enclosed in extern "C" for C++."""
    return [
        "#ifdef __cplusplus",
        'extern "C" {',
        "#endif",
        "",
        declarations,
        "",
        "#ifdef __cplusplus",
        "}",
        "#endif",
    ]


def version_check(file_name: str) -> list[str]:
    """Return the check that stops the compiler if the runtime has another major or minor version than the
    header."""
    major, minor, *_ = __version__.split(".")
    return [
        "#if !defined(NOSLIP_VERSION_NUMBER) || NOSLIP_VERSION_NUMBER / 100 != "
        f"{100 * int(major) + int(minor)}",
        f'#error "{file_name} belongs to noslip {major}.{minor}: use the runtime of that version, or '
        'generate it again"',
        "#endif",
    ]
