"""Executed instructions of functions in an image for QEMU, counted by the plugin in target/count.c."""

import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from threading import Lock

SOURCE = Path(__file__).resolve().parent / "target/count.c"
TIMEOUT = 120  # s, of each tool
BUILDING = Lock()  # of the plugin, by one thread

Symbols = Mapping[str, tuple[int, int]]  # function -> address, bytes


def run(command: Sequence[str], folder: Path, check: bool = True) -> subprocess.CompletedProcess:
    """Run a tool without input, for TIMEOUT at most."""
    done = subprocess.run(
        command, cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=TIMEOUT
    )
    if check and done.returncode:
        raise RuntimeError(f"{' '.join(command)}\n{done.stderr}")
    return done


def symbols_of(image: Path, prefix: str) -> dict[str, tuple[int, int]]:
    """Return function -> address and bytes, by the nm of a toolchain."""
    rows = [line.split() for line in run([f"{prefix}nm", "-S", str(image)], image.parent).stdout.splitlines()]
    found = [(row[3], int(row[0], 16), int(row[1], 16)) for row in rows if len(row) == 4 and row[2] in "tTW"]
    return {name.split(".")[0] if name.endswith(".isra.0") else name: (at, size) for name, at, size in found}


def count_calls(
    machine: Sequence[str],
    image: Path,
    symbols: Symbols,
    calls: Sequence[tuple[str, str]],
    folder: Path,
    costs: Path | None = None,
) -> tuple[subprocess.CompletedProcess, dict[str, tuple[int, int, int, int, int]]]:
    """Run an image on a machine (the command of the emulator) and count functions called by given callers:
    (function, caller).

    Returns the exit status, and function -> calls, instructions of all, of the shortest and of the longest
    call, including callees, and cycles of all calls by the costs of cycles.py, 0 without them. If one of the
    functions calls another, only the outer one is counted. The plugin is built in the folder.
    """
    log = image.with_suffix(".count")
    asked = []
    for function, caller in calls:
        first, size = symbols[caller]
        asked.append(f"call={symbols[function][0]:x}:{first:x}:{first + size - 1:x}")
    asked += [f"cycles={costs}"] if costs else []
    plugin = ["-d", "plugin", "-D", str(log), "-plugin", ",".join([str(_plugin(folder)), *asked])]
    done = run([*machine, *plugin, "-kernel", str(image)], image.parent, check=False)
    rows = [line.split() for line in log.read_text(encoding="utf-8").splitlines()]
    found: dict[int, tuple[int, int, int, int, int]] = {}
    for at, *numbers in rows:
        count, total, shortest, longest, cycles = map(int, numbers[:5])
        found[int(at, 16)] = count, total, shortest, longest, cycles
    return done, {function: found[symbols[function][0]] for function, _ in calls}


def _plugin(folder: Path) -> Path:
    plugin = folder / "count.so"
    with BUILDING:
        if plugin.exists() and plugin.stat().st_mtime >= SOURCE.stat().st_mtime:
            return plugin
        run(["gcc", "-std=c99", "-O2", "-fPIC", "-shared", str(SOURCE), "-o", str(plugin)], folder)
    return plugin
