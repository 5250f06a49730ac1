"""A firmware project of a robot's laws: what goes into the folder, golden vectors included, and what it costs there."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..codegen import project
from ..codegen.scalar import SCALARS
from ..codegen.selftest import Golden, Step, selftest
from ..model.law import ControlLaw
from .backends import STATUS
from .compiled import CompiledController, library
from .errors import BadInput
from .sampling import random_plants
from .targets import BOARDS, CONSOLE, HOST, TARGETS, Target

FIRMWARE = {"cortex-m4f": TARGETS["cortex-m4f"], "rv32": TARGETS["rv32imafc"], "generic": HOST}  # --firmware
STEPS, SEED = 12, 1992  # golden states of each law, and what they are drawn with
COUNTING = {  # options with which QEMU's time is the number of instructions; what one tick of the stopwatch stands for
    "cortex-m4f": (("-icount", "shift=0"), ("-DSTOPWATCH_INSTRUCTIONS=40u",)),  # 1 ns each, SysTick at 25 MHz
    "rv32": (("-icount", "shift=0"), ()),
}
TIMEOUT = 120  # s, of any one tool


def project_files(
    name: str, sources: dict[str, str], laws: Sequence[ControlLaw], scalar: str
) -> tuple[dict[str, str], project.Board]:
    """File name -> text of everything but README.md, for a target of FIRMWARE; `sources` are the laws' C and the runtime's."""
    target, robot = FIRMWARE[name], laws[0].system.mechanism.name
    board = _board(name, target)
    made = {f"noslip/{file}": text for file, text in sources.items()}
    made |= {f"board/{file}": text for file, text in target.files().items()}
    made |= {f"selftest/{path.name}": path.read_text() for path in sorted((BOARDS.parent / "selftest").glob("*.h"))}
    golden = [_golden(law, scalar) for law in laws]
    made["selftest/selftest.c"] = selftest(golden, SCALARS[scalar])
    made["loop.c"] = project.loop(laws[0], SCALARS[scalar])
    made = _needed(made)
    made["Makefile"] = project.makefile(robot, board)
    made["CMakeLists.txt"] = project.cmake(robot, board)
    return made, board


def readme(name: str, manifest: str, laws: Sequence[ControlLaw], scalar: str, board: project.Board, folder: Path) -> str:
    """README.md of the project in a folder, with what was measured there if the tools are here."""
    given = json.loads(manifest)
    rows = [_operations(law, scalar, given["laws"][law.name]["operations"]["feedback"]) for law in laws]
    head = f"| law, {scalar} | bytes of its struct | + − | × | ÷ | √ | sine and cosine |\n|---|---|---|---|---|---|---|"
    table = "\n".join([head, *rows])
    costs = f"A step, apart from its checks, and the memory of one law (on a target with int of 4 bytes):\n\n{table}\n\n"
    return project.readme(
        given["robot"], [law.name for law in laws], board, given["tools"], costs + _measured(name, folder) + "\n"
    )


def _board(name: str, target: Target) -> project.Board:
    if not target.bare:
        return project.Board("any machine")
    options, define = COUNTING[name]
    link = ("-nostdlib", "-T", f"board/{target.script}", "-Wl,--gc-sections", "-lgcc")
    run = target.run("", *options, *CONSOLE)[:-1]  # the image comes last
    prefix = target.compiler.removesuffix("gcc")
    return project.Board(name, prefix, target.flags, target.start, link, run, define)


def _needed(files: dict[str, str]) -> dict[str, str]:
    """Without the board's headers that no file includes."""

    def needed(name: str) -> bool:
        return not (name.startswith("board/") and name.endswith(".h")) or any(
            f'"{Path(name).name}"' in text for text in files.values()
        )

    return {name: text for name, text in files.items() if needed(name)}


def _golden(law: ControlLaw, scalar: str) -> Golden:
    """Random regular steps of a law made of random parameters, then one that is not finite; answers by the C on this machine.

    Raises BadInput as `random_plants` does.
    """
    plant = next(p for p in random_plants(law, 20 * STEPS, SEED) if len(p.points) >= STEPS)
    controller = CompiledController(law, plant.params, plant.config, plant.gains, scalar)
    if controller.refused:
        raise BadInput(f"{law.name}: the C refuses random parameters: {controller.refused}")
    numbers = {library(law, scalar).status(n): n for n in range(-len(STATUS), len(STATUS))}
    points = [(p.state, p.reference) for p in plant.points[:STEPS]]
    broken = np.array(points[0][0])
    broken[-1] = np.nan
    steps = []
    for state, reference in [*points, (broken, points[0][1])]:
        status, tau = controller.step(state, reference)
        steps.append(Step(state, reference, numbers[status], tau))
    return Golden(law, plant.params, plant.config, plant.gains, steps)


def _operations(law: ControlLaw, scalar: str, count: dict[str, int]) -> str:
    made = library(law, scalar)
    size = made.ffi.sizeof(made.name(""))
    numbers = (size, count["add"] + count["sub"], count["mul"], count["div"], count["sqrt"], count["sincos"])
    return f"| `{law.name}` | {' | '.join(map(str, numbers))} |"


def _measured(name: str, folder: Path) -> str:
    """What `make test` and `make budget` say there, and then all is as it was; or why they were not asked.

    Raises BadInput when the self-test fails.
    """
    absent = FIRMWARE[name].missing("make")
    if absent:
        return (
            f"Bytes and instructions were not measured where this was written ({absent[0]} was not there): see `make budget`.\n"
        )
    said = []
    for goal in ("test", "budget"):
        command = ["make", "-s", "-C", str(folder), goal]
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=TIMEOUT)
        if done.returncode:
            lines = (done.stderr + done.stdout).strip().splitlines()
            worst = next((line for line in lines if "rror:" in line or "FAIL" in line), lines[-1] if lines else "it says nothing")
            raise BadInput(f"the exported project does not pass `make {goal}`: {worst}")
        said.append(done.stdout.strip())
    subprocess.run(["make", "-s", "-C", str(folder), "clean"], capture_output=True, timeout=TIMEOUT)
    compiler = FIRMWARE[name].compiler or "cc"
    version = subprocess.run([compiler, "-dumpfullversion"], capture_output=True, text=True).stdout.strip()
    text = "\n".join(said).replace(str(folder), ".")
    counted = "; instructions of a step with all its checks, as executed in QEMU" if FIRMWARE[name].bare else ""
    return f"Measured with {compiler} {version} -O2{counted}:\n\n```\n{text}\n```\n"
