"""Memory of the compiled C: symbols, stack and sizes."""

import re
from pathlib import Path

from . import budget
from .callgraph import Graph, call_graph, deepest, reached
from .tools import HOST, M4F, Machine, Task, hold, run

BY_COMPILERS = {"memcpy", "memmove", "memset"}  # calls that compilers generate
MOST_STACK, MOST_OF_LARGE = 384, 512  # bytes; LARGE
LARGE = ("_follower_", "_ekf_")
EMIT_ALL = "-fkeep-inline-functions"  # so that the object of headers.c contains the inline functions
MODULES = (
    *(
        "adaptation",
        "approach",
        "balance",
        "course",
        "disturbance",
        "ekf",
        "encoder",
        "integral",
        "motor",
        "nearest_angle",
    ),
    *("odometry", "profile", "reversing", "slip", "velocity"),
)
IN_HEADERS = tuple(f"noslip_{name}" for name in MODULES)


def symbols(task: Task, target: Machine = HOST) -> str:
    """Check that no symbol is undefined except those that compilers call, that no data is writable, that no
    library is needed.

    On a bare target only the float sources are checked, since double needs the compiler's library; no symbol
    may be undefined.
    """
    objects = target.compile(task, task.sources if target is HOST else task.float_sources)
    objects += target.compile(task, [task.headers()], EMIT_ALL) if target is HOST else []
    by_compilers = BY_COMPILERS if target is HOST else set()
    findings, defined, undefined = [], set(), {}
    for path in objects:
        for line in run([target.tool("nm"), path]).splitlines():
            *_, kind, name = line.split()
            if kind in "Uw":
                undefined[name] = path.name
            elif kind in "TtRrNn":
                defined.add(name)
            else:
                findings.append(f"{path.name}: {name} is writable data (nm: {kind})")
        _, data, bss = _size(target, path)
        if data or bss:
            findings.append(f"{path.name}: {data} bytes of data, {bss} of bss")
    # Exists in position-independent code; not a function
    needed = set(undefined) - defined - {"_GLOBAL_OFFSET_TABLE_"}
    hold([*findings, *(f"{undefined[name]} needs {name}" for name in sorted(needed - by_compilers))])
    _link(task, target, objects)
    return (
        f"{len(objects)} objects need {', '.join(sorted(needed)) or 'nothing'}, have no data and no bss, "
        "link with -nostdlib"
    )


def stack(task: Task, target: Machine = M4F) -> str:
    """Check the stack of the deepest call chain of each entry point: no recursion, variable frame or unknown
    function.

    The compiler's library counts as unknown, so that a use of double in a float function is found.
    """
    graph = graph_of(task, target)
    own = (*IN_HEADERS, "noslip_path", "labmate", *task.feedback_names)
    entries = [name for name in sorted(graph) if name.endswith("_f") and name.startswith(own)]
    used = {entry: deepest(graph, entry) for entry in entries}
    outside = {
        (entry, name) for entry in entries for name in reached(graph, entry) - set(graph) - BY_COMPILERS
    }
    hold(
        [f"{entry} calls {name}" for entry, name in sorted(outside)]
        + [
            f"{entry}: {bytes_} bytes, more than {_most(entry)}"
            for entry, bytes_ in used.items()
            if bytes_ > _most(entry)
        ]
    )
    measured: budget.Numbers = {}
    for entry, most in used.items():
        laws = sorted((*task.laws, *task.laws_of_others, *task.feedback_names), key=len, reverse=True)
        module = next((name for name in laws if entry.startswith(name)), "runtime")
        measured.setdefault(f"{module}_f", {})[
            f"stack {entry.removeprefix(module + '_').removesuffix('_f')}"
        ] = most
    worst = max(used, key=used.__getitem__)
    return (
        f"{len(used)} entry points, worst {worst} {used[worst]} bytes; "
        f"{budget.compare(task, target, measured)}"
    )


def sizes(task: Task, target: Machine = HOST) -> str:
    """Compare the bytes of code and data of each object, and of the struct that the caller owns,
    with the budget."""
    objects = target.compile(task, task.sources if target is HOST else task.float_sources)
    measured = {
        path.stem: dict(zip(("text", "data", "bss"), _size(target, path), strict=True)) for path in objects
    }
    for module, size in _structs(task, target).items():
        if module in measured:
            measured[module]["struct"] = size
    total = sum(each["text"] for each in measured.values())
    return f"{len(objects)} objects, {total} bytes of code; {budget.compare(task, target, measured)}"


def _size(target: Machine, path: Path) -> tuple[int, int, int]:
    text, data, bss = run([target.tool("size"), path]).splitlines()[-1].split()[:3]
    return int(text), int(data), int(bss)


def _link(task: Task, target: Machine, objects: list[Path]) -> None:
    """Link all objects without libraries; an undefined symbol is an error."""
    by_compilers = target.compile(task, [task.root / "firmware/boards/string.c"], "-ffreestanding")
    options = [*target.flags, "-nostdlib", "-Wl,-z,defs,-e,labmate_check_params_f"]
    run([target.compiler, *options, *objects, *by_compilers, "-o", task.folder / target.name / "all"])


def graph_of(task: Task, target: Machine) -> Graph:
    objects = [*target.compile(task, task.float_sources), *target.compile(task, [task.headers()], EMIT_ALL)]
    return call_graph(path.with_suffix(".ci") for path in objects)


def _structs(task: Task, target: Machine) -> dict[str, int]:
    """Return module -> bytes of the struct that the caller owns."""
    own = [*task.laws, *task.laws_of_others, "noslip_path"]
    kinds = {**{name: name for name in own}, **dict.fromkeys(task.feedback_names, "noslip_balance")}
    scalars = ("", "_f")
    headers = [*(f"{law}{suffix}" for law in own[:-1] for suffix in scalars), "noslip_path", "noslip_balance"]
    lines = [f'#include "{header}.h"' for header in headers]
    lines += [
        f"char size_of_{name}{end}[sizeof({kind}{end})] = {{1}};"
        for name, kind in kinds.items()
        for end in scalars
    ]
    source = task.folder / "structs.c"
    source.write_text("\n".join(lines) + "\n", encoding="utf-8")
    listing = run([target.tool("nm"), "-S", *target.compile(task, [source])])
    return {name: int(size, 16) for size, name in re.findall(r"^\S+ (\S+) \w size_of_(\w+)$", listing, re.M)}


def _most(entry: str) -> int:
    return MOST_OF_LARGE if any(part in entry for part in LARGE) else MOST_STACK
