"""A whole step of a controller on a Cortex-M4F: encoders, dead reckoning, path and law, along a line, an arc,
a line, an arc.

    python checks/bench/whole_step.py [--json] [--optimize=-Os]

The counts that the vehicle reads are those of a closed loop simulated beforehand. These are instructions, not
cycles.
"""

import argparse
import csv
import json
import math
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from counting import count_calls, run, symbols_of
from noslip.checks.guarantees.callgraph import call_graph, deepest, reached
from noslip.codegen.targets import STANDARD
from noslip.simulation.controllers.targets import QUIET, SEMIHOSTING, TARGETS, missing

ROOT = Path(__file__).resolve().parents[2]
TARGET = TARGETS["cortex-m4f"]
PREFIX = "arm-none-eabi-"
SOURCES: tuple[str, ...] = (
    "runtime_c/noslip_path_f.c",
    "runtime_c/noslip_status.c",
    "generated/labmate/labmate_f.c",
)
SOURCES += ("generated/labmate/labmate_type_iv_segment_f.c", "checks/bench/target/whole_step.c")
INCLUDE = ("runtime_c", "generated/labmate", "firmware/boards")
COUNTS, PERIOD, SPEED, DECELERATION, DURATION = 4096, 0.01, 1.4, 0.5, 17.0
LINE, RADIUS, LAST = 3.0, 5.0, 4.0  # m; with a quarter turn to the left between the lines
ANGLE = 0.5  # rad: of the last arc, on which the vehicle slows down
MANY = 50  # segments of the same path with its second line divided
SPEC = f"""
robot = "labmate"
gains = {{ kp = 1.0, kd = 2.5, kv = 2.0 }}
output = {{ type = "IV", path = {{ kind = "composite", segments = [
  {{ kind = "line", from = [0, 0], to = [{LINE}, 0] }},
  {{ kind = "arc", radius = {RADIUS}, angle = {math.pi / 2!r} }},
  {{ kind = "line", length = {LAST} }},
  {{ kind = "arc", radius = {RADIUS}, angle = {ANGLE} }},
] }} }}
reference = {{ speed = {SPEED}, deceleration = {DECELERATION} }}
initial = {{ point = [0.0, 0.1], heading = 0.1, speed = 0.0 }}
simulation = {{ duration = {DURATION}, period = {PERIOD}, output_step = {PERIOD}, backend = "cf" }}
"""
PARTS = ("read_encoders", "reckon", "look", "labmate_type_iv_segment_follow_f")
KINDS = ("ordinary", "changing", "standing")
SMALL = (["-O2"], ["-Os"], ["-Os", "-flto"])
Row = dict[str, float]


def measure(folder: Path, optimize: Sequence[str] = ("-O2",)) -> dict:
    """Build images in a folder and run them.

    Returns instructions (calls, mean, minimum, maximum) of a step within a segment, `ordinary`, of one in
    which a segment begins, `changing`, and of one at the stop, `standing`, on the path of 4 segments and,
    `many`, on that of 50; of the parts, compiled as separate functions; bytes of stack and code of a step,
    and of code of a complete program including start-up and initialization, by flags. Raises RuntimeError if
    a run does not arrive.
    """
    folder.mkdir(parents=True, exist_ok=True)
    recorded = _record(folder)
    image = _Image(folder / "step", recorded, 4, optimize)
    many = _Image(folder / "many", recorded, MANY, optimize)
    apart = _Image(folder / "apart", recorded, 4, (*optimize, "-DAPART"))
    return {
        **{kind: image.count("step", kind) for kind in KINDS},
        "many": {kind: many.count("step", kind) for kind in KINDS},
        "parts": {part: apart.count(part, "step") for part in PARTS},
        "stack_bytes": image.stack_bytes,
        "text_bytes": image.text_bytes,
        "program_bytes": {
            " ".join(flags): _program_bytes(folder / "program", recorded, flags) for flags in SMALL
        },
    }


class _Image:
    """A program of target/whole_step.c on a path with a given number of segments."""

    def __init__(self, folder: Path, recorded: list[tuple[int, int]], pieces: int, flags: Sequence[str]):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "recorded.h").write_text(_header(recorded, pieces), encoding="utf-8")
        for name, text in TARGET.files().items():
            (folder / name).write_text(text, encoding="utf-8")
        sources = [*(str(ROOT / source) for source in SOURCES), *TARGET.start]
        include = [f"-I{ROOT / place}" for place in INCLUDE]
        command = [
            *TARGET.compile(),
            *STANDARD,
            "-ffunction-sections",
            "-Wl,--gc-sections",
            *flags,
            "-fcallgraph-info=su,da",
        ]
        run([*command, *include, "-I.", *sources, *TARGET.link(), "-o", "image"], folder)
        self._folder, self._image = folder, folder / "image"
        self._symbols = symbols_of(self._image, PREFIX)
        self._graph = call_graph(sorted(folder.glob("*.ci")))

    def count(self, function: str, caller: str) -> Row:
        """Return the instructions of a function called by another: minimum, mean and maximum of a call."""
        machine = [*TARGET.machine, *QUIET, *SEMIHOSTING]
        done, found = count_calls(
            machine, self._image, self._symbols, [(function, caller)], self._folder.parent
        )
        if done.returncode:
            raise RuntimeError(f"{self._image}: exit {done.returncode} {done.stderr}")
        calls, total, least, most, _ = found[function]
        return {"calls": calls, "mean": round(total / calls, 1), "least": least, "most": most}

    @property
    def stack_bytes(self) -> int:
        """Return the bytes of stack of the deepest call chain in a step."""
        return deepest(self._graph, "step")

    @property
    def text_bytes(self) -> int:
        """Return the bytes of code of all functions that a step may call."""
        return sum(self._symbols[name][1] for name in reached(self._graph, "step") if name in self._symbols)


def _program_bytes(folder: Path, recorded: list[tuple[int, int]], flags: Sequence[str]) -> int:
    """Code of a program that reads counters and steps. What compilers call by themselves cannot be analysed
    as one with it."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "recorded.h").write_text(_header(recorded, 4), encoding="utf-8")
    for name, text in TARGET.files().items():
        (folder / name).write_text(text, encoding="utf-8")
    include = [f"-I{place}" for place in (".", *(str(ROOT / place) for place in INCLUDE))]
    compile = [*TARGET.compile(), *STANDARD, "-ffunction-sections", *flags, *include]
    run([*compile, "-fno-lto", "-c", "string.c", "-o", "string.o"], folder)
    sources = [
        *(str(ROOT / source) for source in SOURCES),
        *(name for name in TARGET.start if name != "string.c"),
    ]
    run(
        [*compile, "-Wl,--gc-sections", "-DIMAGE", *sources, "string.o", *TARGET.link(), "-o", "image"],
        folder,
    )
    return int(run([f"{PREFIX}size", "image"], folder).stdout.splitlines()[1].split()[0])


def _record(folder: Path) -> list[tuple[int, int]]:
    """Return the counters of the two encoders at each tick of the simulated run."""
    (folder / "spec.toml").write_text(SPEC, encoding="utf-8")
    run([str(Path(sys.executable).parent / "noslip"), "simulate", "spec.toml", "-o", "run.csv"], folder)
    with open(folder / "run.csv", encoding="utf-8") as file:
        rows = [[float(row[name]) for name in ("theta_r", "theta_l")] for row in csv.DictReader(file)]
    counts = [[round(angle * COUNTS / (2 * math.pi)) % 2**16 for angle in row] for row in rows]
    return [(right, left) for right, left in counts]


def _header(recorded: list[tuple[int, int]], pieces: int) -> str:
    """Return the header recorded.h for the program."""
    quarter, cut = math.pi / 2, LAST / (pieces - 3)
    segments = [(0.0, 0.0, 0.0, 0.0, LINE), (LINE, 0.0, 0.0, 1 / RADIUS, quarter * RADIUS)]
    segments += [(LINE + RADIUS, RADIUS + cut * k, quarter, 0.0, cut) for k in range(pieces - 3)]
    segments += [(LINE + RADIUS, RADIUS + LAST, quarter, 1 / RADIUS, ANGLE * RADIUS)]
    lines = [
        f"#define {name} {value}f"
        for name, value in (("PERIOD", PERIOD), ("SPEED", SPEED), ("DECELERATION", DECELERATION))
    ]
    lines += [f"#define COUNTS {COUNTS}", f"#define TICKS {len(recorded)}"]
    lines += [
        "static const noslip_pose_f start = {0.0f, 0.1f, 0.1f};",
        "static const noslip_segment_f segments[] = {",
    ]
    lines += [f"    {{{', '.join(f'{number!r}f' for number in segment)}, 0}}," for segment in segments]
    rows = ", ".join(f"{{{right}, {left}}}" for right, left in recorded)
    return "\n".join([*lines, "};", f"static const uint16_t recorded[TICKS][2] = {{{rows}}};", ""])


def text(result: dict) -> str:
    """Return the result as a table."""
    rows = {
        "step": result["ordinary"],
        "step, at the stop": result["standing"],
        "step, a piece begins": result["changing"],
    }
    rows |= {f"the same, {MANY} pieces": result["many"]["changing"]}
    rows |= {f"  {part}": row for part, row in result["parts"].items()}
    lines = [f"{TARGET.name + ', instructions':36}{'calls':>7}{'mean':>9}{'least':>7}{'most':>7}"]
    lines += [
        f"{name:36}{row['calls']:7}{row['mean']:9.1f}{row['least']:7}{row['most']:7}"
        for name, row in rows.items()
    ]
    program = ", ".join(f"{flags} {size}" for flags, size in result["program_bytes"].items())
    lines.append(
        f"bytes: {result['stack_bytes']} of stack, {result['text_bytes']} of code; of a whole program "
        f"{program}"
    )
    return "\n".join(lines)


def absent() -> list[str]:
    """Return the missing tools."""
    return missing("gcc", TARGET.compiler, *TARGET.machine[:1])


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="as JSON")
    parser.add_argument("--optimize", default="-O2", metavar="FLAGS", help="flags of GCC (default: -O2)")
    args = parser.parse_args()
    if tools := absent():
        print(f"skipped, {', '.join(tools)} not installed")
        return int(os.environ.get("NOSLIP_REQUIRE_FIRMWARE") == "1")
    with tempfile.TemporaryDirectory() as folder:
        try:
            result = measure(Path(folder), args.optimize.split())
        except RuntimeError as error:
            print(error, file=sys.stderr)
            return 1
    print(json.dumps(result, indent=1) if args.json else text(result))
    return 0


if __name__ == "__main__":
    sys.exit(main())
