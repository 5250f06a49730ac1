"""The guarantees, each checked: one line each, then a summary.

    python -m noslip.guarantees [NAME ...] [--short] [--update] [-o DIR]

Exit 0: all that could be checked hold. 1: one does not. What a tool is missing for is skipped and said, and with
NOSLIP_REQUIRE_FIRMWARE=1 in the environment it does not hold.
"""

import argparse
import os
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from . import eva, faults, fuzz, instructions, lint, memory
from .tools import M4F, Failed, Missing, Task

CHECKS: dict[str, Callable[[Task], str]] = {
    "symbols": memory.symbols,
    "symbols-m4f": partial(memory.symbols, target=M4F),
    "stack-m4f": memory.stack,
    "sizes": memory.sizes,
    "sizes-m4f": partial(memory.sizes, target=M4F),
    "instructions-m4f": instructions.instructions,
    "warnings": lint.warnings,
    "warnings-m4f": partial(lint.warnings, target=M4F),
    "clang-tidy": lint.tidy,
    "misra": lint.misra,
    "eva": eva.eva,
    "faults": faults.check,
    "eva-bits": eva.same_bits,
    "sanitizers": fuzz.sanitizers,
    "fuzz": fuzz.fuzz,
}


def checked(name: str, task: Task) -> tuple[str, str]:
    """How a check ended - holds, FAILED or skipped - and what it says."""
    try:
        return "holds", CHECKS[name](task)
    except Missing as missing:
        required = os.environ.get("NOSLIP_REQUIRE_FIRMWARE") == "1"
        return "FAILED" if required else "skipped", str(missing)
    except (Failed, RuntimeError) as failed:
        return "FAILED", str(failed)


def main(argv: list[str] | None = None) -> int:
    """Runs the checks; answers the exit code."""
    parser = argparse.ArgumentParser(prog="python -m noslip.guarantees", description=__doc__.split("\n\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"which of {', '.join(CHECKS)} (default: all)")
    parser.add_argument("--short", action="store_true", help="the versions that run in the tests")
    parser.add_argument("--update", action="store_true", help="take what is measured now as the budget")
    parser.add_argument(
        "-o", dest="out", metavar="DIR", default="build/guarantees", help="where it works (default: build/guarantees)"
    )
    given = parser.parse_args(argv)
    if unknown := [name for name in given.names if name not in CHECKS]:
        parser.error(f"no check {unknown[0]}; there are {', '.join(CHECKS)}")
    task = Task(Path(given.out).resolve(), short=given.short, update=given.update)
    ends: list[str] = []
    for name in given.names or CHECKS:
        began = time.monotonic()
        end, said = checked(name, task)
        ends.append(end)
        print(f"{name:17}{end:8} {said}  [{time.monotonic() - began:.0f} s]", flush=True)
    words = (("holds", "hold"), ("FAILED", "failed"), ("skipped", "skipped"))
    print(", ".join(f"{ends.count(end)} {word}" for end, word in words))
    return int("FAILED" in ends)


if __name__ == "__main__":
    sys.exit(main())
