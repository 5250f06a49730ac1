"""Generates the double and the float part of the C runtime's headers from one text: runtime_c/NAME.inc into NAME.h.

python -m noslip.guarantees.headers           write the headers
python -m noslip.guarantees.headers --check   write nothing; exit 1 if a header is not current

The parts of a header before BEGIN and after END are kept. Between them is NAME.inc, once for each scalar, with macros expanded.
"""

import re
import sys
from pathlib import Path

RUNTIME = Path(__file__).resolve().parent.parent / "runtime_c"
BEGIN, END = "/* -- {scalar}: generated from {name} by guarantees/headers.py ", "/* -- end of the generated part "
WIDTH = 124
SCALARS = {"double": ("", "DBL"), "float": ("_f", "FLT")}


def headers(folder: Path = RUNTIME) -> dict[Path, str]:
    """Return the current text of each header that has a .inc file, by path."""
    return {text.with_suffix(".h"): header(text) for text in sorted(folder.glob("*.inc")) if text.with_suffix(".h").exists()}


def header(text: Path) -> str:
    """Return the header of one .inc file; parts outside BEGIN and END are read from the existing header."""
    old = text.with_suffix(".h").read_text(encoding="utf-8")
    before = old[: old.index(BEGIN.format(scalar="double", name=text.name))]
    after = old[old.index(END) :].split("\n", 1)[1]
    parts = [
        _rule(BEGIN.format(scalar=scalar, name=text.name)) + "\n\n" + for_scalar(text.read_text(encoding="utf-8"), scalar)
        for scalar in SCALARS
    ]
    return before + "\n".join(parts) + "\n" + _rule(END) + "\n" + after


def for_scalar(text: str, scalar: str) -> str:
    """Return the text for "double" or "float" without its first comment; comments and continuation lines keep their columns."""
    suffix, limits = SCALARS[scalar]
    lines, shift = [], 0
    for line in text.split("\n\n", 1)[1].rstrip().split("\n"):
        code = re.split(r"\s*/\*", line, maxsplit=1)[0]
        comment = line.removeprefix(code)
        own = re.sub(r"NOSLIP_NAME\((\w+)\)", rf"\1{suffix}", code)
        own = own.replace("NOSLIP_REAL", scalar)
        own = own.replace("NOSLIP_LARGEST", f"{limits}_MAX").replace("NOSLIP_EPSILON", f"{limits}_EPSILON")
        indent = len(own) - len(own.lstrip())
        if shift and indent > 8:
            own = own[min(shift, indent - 8) :]
        if comment and code.strip():
            own += " " * max(0, len(code) + len(comment) - len(comment.lstrip()) - len(own) - 1) + " " + comment.lstrip()
        else:
            own += comment
        opens = own.count("(") > own.count(")")
        if opens and not line.startswith(" "):
            shift = len(code) - len(own)
        elif line.startswith(("{", "}")) or not line:
            shift = 0
        lines.append(own)
    return "\n".join(lines) + "\n"


def _rule(text: str) -> str:
    return text.ljust(WIDTH - 3, "-") + " */"


if __name__ == "__main__":
    stale = {path: text for path, text in headers().items() if path.read_text(encoding="utf-8") != text}
    for path, text in stale.items():
        if "--check" in sys.argv[1:]:
            print(f"{path.name} is not current: python -m noslip.guarantees.headers")
        else:
            path.write_text(text, encoding="utf-8")
    sys.exit(1 if stale and "--check" in sys.argv[1:] else 0)
