"""The files of the C runtime: where they are, and their text for users.

In runtime_c/ each module is written once, in the macro of a scalar: NAME.h includes NAME.inc for double and
for float, by noslip_scalars.inc. Users get both written out in NAME.h: they find each name in full.

python codegen/runtime.py FOLDER   write the files for users into a folder
"""

import re
import sys
from functools import cache
from pathlib import Path

RUNTIME = Path(__file__).resolve().parent.parent / "runtime_c"
SCALARS_FILE = "noslip_scalars.inc"
MODULE = re.compile(rf'#define NOSLIP_MODULE "(\w+\.inc)"\n#include "{SCALARS_FILE}"\n')
NAME = re.compile(r"NOSLIP_NAME\((\w+)\)")
WIDTH = 124
SCALARS = {"double": ("", "DBL"), "float": ("_f", "FLT")}  # suffix of names, prefix of the limits in float.h


@cache
def runtime_files() -> dict[str, str]:
    """Return the C on which generated laws depend, as users get it: file name -> text."""
    paths = sorted(path for path in RUNTIME.iterdir() if path.suffix in (".h", ".c", ".inc"))
    texts = {path.name: path.read_text(encoding="utf-8") for path in paths}
    written_out = {SCALARS_FILE, *(module for text in texts.values() for module in MODULE.findall(text))}

    def both(module: re.Match[str]) -> str:
        return "\n".join(f"{_rule(scalar)}\n\n{for_scalar(texts[module[1]], scalar)}" for scalar in SCALARS)

    return {name: MODULE.sub(both, text) for name, text in texts.items() if name not in written_out}


def for_scalar(text: str, scalar: str) -> str:
    """Return the text of a module for "double" or "float", without its first comment.

    Where names get shorter, a comment beside code keeps its column, and parameters of a function on further
    lines stay below those on the first.
    """
    suffix, limits = SCALARS[scalar]
    lines, shorter = [], 0  # by how many columns the first line of a function's head is shorter
    for line in text.split("\n\n", 1)[1].rstrip().split("\n"):
        if line.startswith("{") or not line:
            shorter = 0
        if not shorter and "NOSLIP_" not in line:
            lines.append(line)
            continue
        code, begin, comment = line.partition("/*")
        own = NAME.sub(rf"\1{suffix}", code).replace("NOSLIP_REAL", scalar)
        own = own.replace("NOSLIP_LARGEST", f"{limits}_MAX").replace("NOSLIP_EPSILON", f"{limits}_EPSILON")
        indent = len(own) - len(own.lstrip())
        if indent > 8:
            own = own[min(shorter, indent - 8) :]
        elif indent == 0 and own.count("(") > own.count(")"):
            shorter = len(code) - len(own)
        if begin and code.strip():
            own = own.rstrip().ljust(len(code) - 1) + " "
        lines.append(own + begin + comment)
    return "\n".join(lines) + "\n"


def _rule(title: str) -> str:
    return f"/* -- {title} ".ljust(WIDTH - 3, "-") + " */"


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in runtime_files().items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
