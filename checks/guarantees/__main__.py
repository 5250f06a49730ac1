"""Checks the guarantees: prints a line for each, then a summary.

    python -m noslip.checks.guarantees [NAME ...] [--short] [--update] [-o DIR]

Exit code 0: all checks that could run hold; 1: at least one failed. A check whose tool is missing is skipped
with a message; with NOSLIP_REQUIRE_FIRMWARE=1 in the environment it fails.
"""

import argparse
import os
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from . import eva, faults, fuzz, instructions, lint, memory, timing
from .tools import M4F, Failed, Missing, Task

CHECKS: dict[str, Callable[[Task], str]] = {
    "symbols": memory.symbols,
    "symbols-m4f": partial(memory.symbols, target=M4F),
    "stack-m4f": memory.stack,
    "sizes": memory.sizes,
    "sizes-m4f": partial(memory.sizes, target=M4F),
    "instructions-m4f": instructions.instructions,
    "timing": timing.timing,
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

MORE = ("type_iv_segment_damped",)  # of laws whose C has functions that no law in generated/ has
OTHERS = (  # a robot of many bodies, whose C is long; robots with fewer inputs than degrees of freedom
    ("tractor_trailer:6", "type_i"),
    ("balancer", "upright"),
    ("roller_racer", "handlebar"),
)
FEEDBACKS = ("balancer",)  # SPECs of state feedbacks


def checked(name: str, task: Task) -> tuple[str, str]:
    """Run a check; return its result (holds, FAILED or skipped) and its message."""
    try:
        return "holds", CHECKS[name](task)
    except Missing as missing:
        required = os.environ.get("NOSLIP_REQUIRE_FIRMWARE") == "1"
        return "FAILED" if required else "skipped", str(missing)
    except (Failed, RuntimeError) as failed:
        return "FAILED", str(failed)


def main(argv: list[str] | None = None) -> int:
    """Run the checks and return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m noslip.checks.guarantees", description=__doc__.split("\n\n")[0]
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"any of {', '.join(CHECKS)} (default: all)")
    parser.add_argument("--short", action="store_true", help="run the short versions, as the tests do")
    parser.add_argument("--update", action="store_true", help="record the measured values as the new budget")
    parser.add_argument(
        "-o",
        dest="out",
        metavar="DIR",
        default="build/guarantees",
        help="working folder (default: build/guarantees)",
    )
    arguments = parser.parse_args(argv)
    if unknown := [name for name in arguments.names if name not in CHECKS]:
        parser.error(f"unknown check {unknown[0]}; known are {', '.join(CHECKS)}")
    task = Task(Path(arguments.out).resolve(), short=arguments.short, update=arguments.update)
    task = task if task.short else replace(task, more=MORE, others=OTHERS, feedbacks=FEEDBACKS)
    ends: list[str] = []
    for name in arguments.names or CHECKS:
        began = time.monotonic()
        end, summary = checked(name, task)
        ends.append(end)
        print(f"{name:17}{end:8} {summary}  [{time.monotonic() - began:.0f} s]", flush=True)
    words = (("holds", "hold"), ("FAILED", "failed"), ("skipped", "skipped"))
    print(", ".join(f"{ends.count(end)} {word}" for end, word in words))
    return int("FAILED" in ends)


if __name__ == "__main__":
    sys.exit(main())
