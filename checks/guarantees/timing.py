"""How long every entry point of the follower takes at most: instructions and estimated cycles on three
processors, and stack.

The numbers are the largest over the calls that c/timing.c makes, measured and not proved. Cycles are
estimated by the models of checks/guarantees/cycles.py.
"""

import re
from collections.abc import Sequence
from dataclasses import replace

from ...codegen.targets import TABLE, flags
from . import budget, memory
from .callgraph import deepest
from .cycles import CORTEX_M4, CORTEX_M7, RV32, Model, write_costs
from .tools import HERE, M4F, Failed, Machine, Task, need, run

RISCV = TABLE["toolchain"]["riscv"]
M7 = replace(M4F, name="cortex-m7", flags=flags("cortex-m7"))
RV32_MACHINE = Machine(
    "rv32imafc", RISCV["prefix"], (*flags("rv32imafc"), "-ffreestanding"), RISCV["package"]
)
MODELS: dict[str, tuple[Machine, Model]] = {
    "M4F": (M4F, CORTEX_M4),
    "M7": (M7, CORTEX_M7),
    "RV32": (RV32_MACHINE, RV32),
}
QUIET = (
    "-display",
    "none",
    "-monitor",
    "none",
    "-serial",
    "none",
    "-semihosting-config",
    "enable=on,target=native",
)
PAGE = "docs/firmware.md"
HEAD = (
    "| entry point | "
    + " | ".join(f"{name} instructions | {name} cycles" for name in MODELS)
    + " | M4F stack, bytes |"
)
Counted = dict[str, tuple[int, int]]  # entry point -> instructions and estimated cycles of the longest calls


def timing(task: Task) -> str:
    """Count the instructions and cycles of each entry point on each processor;
    compare the instructions with the budget."""
    found = {name: count(task, machine, model) for name, (machine, model) in MODELS.items()}
    compared = []
    for name, (machine, _) in MODELS.items():
        measured: budget.Numbers = {"timing": {entry: most for entry, (most, _) in found[name].items()}}
        compared.append(f"{name} {budget.compare(task, machine, measured)}")
    page = task.root / PAGE
    text = page.read_text(encoding="utf-8")
    written = with_table(text, found, stack_of(task, list(found["M4F"])))
    if task.update:
        page.write_text(written, encoding="utf-8")
    elif "as budgeted" in compared[0] and written != text and all("as budgeted" in each for each in compared):
        raise Failed(
            f"the table of {PAGE} has other numbers: python -m noslip.checks.guarantees timing --update"
        )
    tick = ", ".join(f"{name} {found[name]['labmate_follower_tick'][1]}" for name in MODELS)
    return f"{len(found['M4F'])} entry points; cycles of a tick at most {tick}; {'; '.join(compared)}"


def count(task: Task, machine: Machine, model: Model) -> Counted:
    """Return entry point, without the scalar -> instructions and cycles of its longest calls. Raises
    RuntimeError if the vehicle of the program does not arrive, Failed if an entry point is not called."""
    row = TABLE["target"][machine.name]
    need(row["machine"][0], row["machine"][0])
    folder = task.folder / "timing" / machine.name
    folder.mkdir(parents=True, exist_ok=True)
    boards, source = task.root / "firmware/boards", HERE / "c/timing.c"
    objects = machine.compile(task, [path for path in task.float_sources if "ekf" not in path.name])
    objects += machine.compile(task, [source, task.root / "firmware/robot.c"], "-fno-optimize-sibling-calls")
    objects += machine.compile(
        task, [boards / name for name in row["start"]], "-ffreestanding", f"-I{boards}"
    )
    image, script = folder / "image", f"-T{boards / row['script']}"
    run([machine.compiler, *machine.flags, "-nostdlib", script, *objects, "-lgcc", "-o", image])
    plugin, log = folder / "count.so", folder / "count.log"
    run(
        [
            need("gcc", "gcc"),
            "-std=c99",
            "-O2",
            "-fPIC",
            "-shared",
            task.root / "checks/bench/target/count.c",
            "-o",
            plugin,
        ]
    )
    listing = re.findall(r"^(\S+) (\S+) [Tt] (\w+)$", run([machine.tool("nm"), "-S", image]), re.M)
    places = {name: (int(at, 16) & ~1, int(size, 16)) for at, size, name in listing}
    names = re.findall(r"^CALL\((\w+),", source.read_text(encoding="utf-8"), re.M)
    calls = [_call(places[name][0], *places[f"call_{name}"]) for name in names]
    asked = ",".join([str(plugin), *calls, f"cycles={write_costs(image, machine.prefix, model)}"])
    run([*row["machine"], *QUIET, "-kernel", image, "-d", "plugin", "-D", log, "-plugin", asked])
    rows = [list(map(int, line.split()[1:])) for line in log.read_text(encoding="utf-8").splitlines()]
    if missing := [name for name, counted in zip(names, rows, strict=True) if not counted[0]]:
        raise Failed(f"{machine.name}: no call of {', '.join(missing)}")
    return {_plain(name): (counted[3], counted[5]) for name, counted in zip(names, rows, strict=True)}


def stack_of(task: Task, entries: Sequence[str]) -> dict[str, int]:
    """Return entry point -> bytes of stack of its deepest call chain on the Cortex-M4F."""
    graph = memory.graph_of(task, M4F)
    names = {entry: f"{entry}_f" if f"{entry}_f" in graph else entry for entry in entries}
    return {entry: deepest(graph, name) for entry, name in names.items()}


def with_table(page: str, found: dict[str, Counted], stack: dict[str, int]) -> str:
    """Return a page with these numbers in its table."""
    first = next(iter(found.values()))
    rows = [
        [f"`{entry}`", *(str(n) for each in found.values() for n in each[entry]), str(stack[entry])]
        for entry in first
    ]
    table = "\n".join(
        [HEAD, "|---" * (2 * len(found) + 2) + "|", *(f"| {' | '.join(row)} |" for row in rows)]
    )
    return re.sub(re.escape(HEAD) + r"\n(?:\|.*\n)*", lambda _: f"{table}\n", page)


def _call(entry: int, first: int, size: int) -> str:
    return f"call={entry:x}:{first:x}:{first + size - 1:x}"


def _plain(name: str) -> str:
    return name.removesuffix("_").removesuffix("_f")
