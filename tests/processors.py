"""The same numbers on every processor: runs of all shipped SPECs under the kernels that libraries choose for
other processors.

OpenBLAS, NumPy and the C library choose code by processor, and each can be told to take another's. `python -m
noslip.tests.processors` prints, for each choice, one digest of the CSVs of all SPECs with all backends of
this host; `python -m noslip.tests.processors digest [SPEC ...]` prints that of this process.
"""

import hashlib
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

from noslip.simulation.closed_loop import simulate
from noslip.simulation.controllers.controller import BACKENDS
from noslip.simulation.specification.spec import read_spec

SPECS = sorted((Path(__file__).resolve().parent.parent / "examples/specs").rglob("*.toml"))


# What they need
CORES = {"Prescott": "sse3", "Nehalem": "sse4_2", "Haswell": "avx2", "Zen": "avx2", "SkylakeX": "avx512f"}


@cache
def choices() -> dict[str, dict[str, str]]:
    """What to set in the environment, by the name of the choice."""
    from numpy._core._multiarray_umath import __cpu_dispatch__ as dispatched

    cores = {core: {"OPENBLAS_CORETYPE": core} for core in CORES}
    plain = {
        "NumPy's baseline": {"NPY_DISABLE_CPU_FEATURES": " ".join(dispatched)},
        "libm without FMA": {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX2,-AVX,-FMA,-FMA4"},
    }
    together = {
        name: value for choice in (cores["Prescott"], *plain.values()) for name, value in choice.items()
    }
    return {"this processor": {}, **cores, **plain, "all of the oldest": together}


def lacking(choice: str) -> str:
    """Why this processor cannot run the kernels of a choice; empty if it can."""
    flags = Path("/proc/cpuinfo").read_text().replace("pni", "sse3").split()
    need = CORES.get(choice, "")
    return f"this processor has no {need}" if need and need not in flags else ""


def csv(spec: Path, backend: str) -> str:
    """The CSV of a SPEC, without its [sweep]."""
    return simulate(replace(read_spec(str(spec)), sweep=None), backend).csv()


def digest(specs: Sequence[Path], backends: Sequence[str] = BACKENDS) -> str:
    """Of the CSVs of all SPECs with all backends, in this process."""
    made = hashlib.sha256()
    for spec in specs:
        for backend in backends:
            text = csv(spec, backend)
            if os.environ.get("SHOWN"):
                print(
                    f"{spec.stem:20}{backend:8}{hashlib.sha256(text.encode()).hexdigest()[:12]}",
                    file=sys.stderr,
                )
            made.update(text.encode())
    return made.hexdigest()


def run_with(choice: str, command: Sequence[str]) -> str:
    """Standard output of Python with a choice in its environment. Raises CalledProcessError where it
    fails."""
    environment = {**os.environ, **choices()[choice]}
    return subprocess.run(
        [sys.executable, *command], env=environment, capture_output=True, text=True, check=True
    ).stdout


def digest_with(choice: str, specs: Sequence[Path], backends: Sequence[str] = BACKENDS) -> str:
    """The digest, found by a process with a choice in its environment."""
    return run_with(choice, ["-m", __spec__.name, "digest", ",".join(backends), *map(str, specs)]).strip()


def main(arguments: Sequence[str]) -> int:
    """Prints the table, 1 if there is more than one digest; or the digest of this process."""
    if arguments[:1] == ["digest"]:
        print(digest([Path(name) for name in arguments[2:]], arguments[1].split(",")))
        return 0
    found = {}
    for choice in (choice for choice in choices() if not lacking(choice)):
        found[choice] = digest_with(choice, SPECS)
        print(f"{choice:20}{found[choice]}", flush=True)
    return int(len(set(found.values())) > 1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
