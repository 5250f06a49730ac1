"""Cost of the firmware on a Cortex-M4F: instructions of a tick, bytes of stack and of the image.

    python checks/bench/firmware.py [--json] [--build DIR] [--optimize=-Os]

A tick is a call of labmate_follower_tick_f; every one is counted of the run that the image makes in QEMU,
from the start of its path until it stands at the end. These are instructions, not cycles. Exit code 1 where
the run does not arrive.
"""

import argparse
import json
import os
import sys
import tempfile
from pathlib import Path

import noslip
from counting import count_calls, run, symbols_of
from noslip.checks.guarantees.callgraph import call_graph, deepest
from noslip.simulation.controllers.targets import QUIET, SEMIHOSTING, TARGETS, missing

FIRMWARE = Path(noslip.__file__).parent / "firmware"
TARGET, PREFIX = "cortex-m4f", "arm-none-eabi-"
# Time advances with the instructions, and immediately while the processor sleeps
CLOCK = ("-icount", "shift=5,sleep=off")
PARTS = {  # function -> its caller; odometry, path and motors are inline in the first
    "labmate_follower_tick_f": "main",
    "labmate_type_iv_segment_follow_f": "act",
    "noslip_watchdog_step": "act",
    "init_law": "act",
}
ENTRIES = ("labmate_follower_tick_f", "labmate_follower_init_f", "main")


def measure(folder: Path, optimize: str = "-O2") -> dict:
    """Build the image in a folder and run it.

    Returns `instructions`: function -> calls, mean, minimum and maximum of a call; `stack_bytes`: entry
    point -> worst chain of calls; `text_bytes`: of the image and of the part of each source. Raises
    RuntimeError if the run does not arrive.
    """
    make = ["make", "-s", "-C", str(FIRMWARE), f"TARGET={TARGET}", f"BUILD={folder}", f"OPTIMIZE={optimize}"]
    run(make, folder)
    built = folder / f"{TARGET}-gcc"
    image = built / "firmware.elf"
    symbols = symbols_of(image, PREFIX)
    instructions = {}
    for function, caller in PARTS.items():
        machine = [*TARGETS[TARGET].machine, *QUIET, *SEMIHOSTING, *CLOCK]
        done, found = count_calls(machine, image, symbols, [(function, caller)], folder)
        if done.returncode:
            raise RuntimeError(f"{image}: exit {done.returncode} {done.stdout}{done.stderr}")
        calls, total, least, most, _ = found[function]
        instructions[function] = {
            "calls": calls,
            "mean": round(total / calls, 1),
            "least": least,
            "most": most,
        }
    graph = call_graph(sorted(built.glob("*.ci")))
    return {
        "instructions": instructions,
        "stack_bytes": {entry: deepest(graph, entry) for entry in ENTRIES},
        "text_bytes": {"image": _text([image]), **_kept(built, symbols)},
    }


def _text(files: list[Path]) -> int:
    rows = run([f"{PREFIX}size", *map(str, files)], files[0].parent).stdout.splitlines()[1:]
    return sum(int(row.split()[0]) for row in rows)


def _kept(built: Path, symbols: dict) -> dict[str, int]:
    """Return source -> bytes of its functions in the image."""
    kept = {}
    for made in sorted(built.glob("*.o")):
        own = symbols_of(made, PREFIX)
        kept[made.stem] = sum(size for name, (_, size) in own.items() if symbols.get(name, (0, 0))[1] == size)
    return kept


def text(result: dict) -> str:
    """Return the result as tables."""
    lines = [f"{'function':32}{'calls':>7}{'mean':>9}{'least':>7}{'most':>7}   instructions, {TARGET}"]
    for name, row in result["instructions"].items():
        lines.append(f"{name:32}{row['calls']:7}{row['mean']:9.1f}{row['least']:7}{row['most']:7}")
    lines += [
        "",
        "bytes of stack: " + ", ".join(f"{name} {size}" for name, size in result["stack_bytes"].items()),
    ]
    lines += ["bytes of code: " + ", ".join(f"{name} {size}" for name, size in result["text_bytes"].items())]
    return "\n".join(lines)


def main() -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="as JSON")
    parser.add_argument(
        "--build", metavar="DIR", type=Path, help="where images are built, and kept (default: nowhere)"
    )
    parser.add_argument("--optimize", default="-O2", metavar="FLAG", help="how GCC optimizes (default: -O2)")
    args = parser.parse_args()
    if absent := missing("make", "gcc", f"{PREFIX}gcc", TARGETS[TARGET].machine[0]):
        print(f"skipped, {', '.join(absent)} not installed")
        return int(os.environ.get("NOSLIP_REQUIRE_FIRMWARE") == "1")
    with tempfile.TemporaryDirectory() as folder:
        try:
            result = measure((args.build or Path(folder)).resolve(), args.optimize)
        except RuntimeError as error:
            print(error, file=sys.stderr)
            return 1
    print(json.dumps(result, indent=1) if args.json else text(result))
    return 0


if __name__ == "__main__":
    sys.exit(main())
