"""A firmware project or a package of a robot's laws: its files, including golden vectors,
and what they cost, measured."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from pathlib import Path

import casadi as ca
import cffi
import numpy as np

from ...analysis.exact.extended import evaluate
from ...codegen.packages.packages import package
from ...codegen.printing.scalar import SCALARS
from ...codegen.project import project
from ...codegen.project.selftest import ExpectedStep, Golden, digest, digests, headers, selftest, slows
from ...codegen.project.vehicle import VehicleNumbers, example, vehicle_files
from ...model.law import ControlLaw
from ...readers.errors import BadInput
from ...simulation import noise
from ...simulation.controllers.compiled import CompiledController, library
from ...simulation.controllers.controller import STATUS, Limits
from ...simulation.controllers.runtime import load
from ...simulation.controllers.symbolic import slowed
from ...simulation.controllers.targets import CONSOLE, HOST, TARGETS, Target
from .check import SMALLEST, TYPICAL
from .sampling import as_held, random_plants
from .verify import LIMIT

FIRMWARE = {"cortex-m4f": TARGETS["cortex-m4f"], "rv32": TARGETS["rv32imafc"], "generic": HOST}  # --firmware
STEPS, SEED = 12, 1992  # golden states of each law, and the seed of the random numbers
COUNTING = {  # options that make QEMU's clock count instructions; instructions per tick of the stopwatch
    "cortex-m4f": (("-icount", "shift=0"), ("-DSTOPWATCH_INSTRUCTIONS=40u",)),  # 1 ns each, SysTick at 25 MHz
    "rv32": (("-icount", "shift=0"), ()),
}
TIMEOUT = 120  # s, of each tool


def project_files(
    name: str,
    sources: dict[str, str],
    laws: Sequence[ControlLaw],
    scalar: str,
    vehicle: VehicleNumbers | None = None,
) -> tuple[dict[str, str], project.Board]:
    """Return file name -> text of everything but README.md, for a target of FIRMWARE; `sources`: C of the
    laws and the runtime; `vehicle`: the numbers of a follower, by default examples.
    """
    target, robot = FIRMWARE[name], laws[0].system.mechanism.name
    board = _board(name, target)
    files = {f"noslip/{file}": text for file, text in sources.items()}
    files |= {f"board/{file}": text for file, text in target.files().items()}
    files |= {f"selftest/{file}": text for file, text in headers().items()}
    golden = [_golden(law, scalar) for law in laws]
    files["selftest/selftest.c"] = selftest(golden, SCALARS[scalar], _digests(golden, sources, scalar))
    follows = f"{SCALARS[scalar].name(f'{robot}_follower')}.h" in sources
    files["loop.c"] = (project.follower_loop if follows else project.loop)(laws[0], SCALARS[scalar])
    if follows:
        files |= vehicle_files(laws[0], SCALARS[scalar], vehicle or example(laws[0]))
        files |= {f"selftest/{file}": text for file, text in noise.source().items()}
    files = _needed(files)
    files["Makefile"] = project.makefile(robot, board, drives=follows)
    files["CMakeLists.txt"] = project.cmake(robot, board)
    return files, board


def package_files(
    manager: str, sources: dict[str, str], laws: Sequence[ControlLaw], scalar: str
) -> dict[str, str]:
    """Return file name -> text of a package for a manager of PACKAGES; `sources` as for `project_files`."""
    files, _ = project_files("generic", sources, laws, scalar)
    return package(manager, files, laws, SCALARS[scalar])


def readme(
    name: str, manifest: str, laws: Sequence[ControlLaw], scalar: str, board: project.Board, folder: Path
) -> str:
    """Return README.md of the project in a folder, with measured values if the tools are installed."""
    entries = json.loads(manifest)
    rows = [_operations(law, scalar, entries["laws"][law.name]["operations"]["feedback"]) for law in laws]
    head = (
        f"| law, {scalar} | bytes of its struct | + − | × | ÷ | √ | sine and cosine "
        "|\n|---|---|---|---|---|---|---|"
    )
    table = "\n".join([head, *rows])
    costs = (
        "A step, apart from its checks, and the memory of one law (on a target with int of 4 "
        f"bytes):\n\n{table}\n\n"
    )
    names, drives = [law.name for law in laws], (folder / "vehicle.c").exists()
    return project.readme(
        entries["robot"], names, board, entries["tools"], f"{costs}{_measured(name, folder)}\n", drives
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
    """Return the files without the headers of boards and self-tests that no file includes."""

    def needed(name: str) -> bool:
        return not (name.startswith(("board/", "selftest/")) and name.endswith(".h")) or any(
            f'"{Path(name).name}"' in text for text in files.values()
        )

    return {name: text for name, text in files.items() if needed(name)}


def _golden(law: ControlLaw, scalar: str) -> Golden:
    """Return random regular steps of a law with random parameters, then one that is not finite.

    The expected values are the model's, in extended precision; the digest is that of the C on this machine.
    Raises BadInput as `random_plants` does.
    `random_plants` does.
    """
    plant = next(p for p in random_plants(law, 20 * STEPS, SEED) if len(p.points) >= STEPS)
    params, config, gains = (as_held(group, scalar) for group in (plant.params, plant.config, plant.gains))
    points = [(as_held(p.state, scalar), as_held(p.reference, scalar)) for p in plant.points[:STEPS]]
    slope = law.slope if slows(law) else None
    taus, slopes = (
        [
            _exact(expression, law, params, config, gains, *point) if expression is not None else np.zeros(0)
            for point in points
        ]
        for expression in (law.tau, slope)
    )
    sizes = [np.abs(tau).max() for tau in taus]
    within = [LIMIT[scalar] * max(size, TYPICAL * np.median(sizes), SMALLEST) for size in sizes]
    limits = _limits(np.abs(taus), max(within))
    right = [_limited(*each, limits) for each in zip(taus, slopes, within, strict=True)] + [
        ("nonfinite", np.zeros(len(taus[0])), 0.0)
    ]
    broken = np.array(points[0][0])
    broken[len(law.system.state) - 1] = np.nan
    points.append((broken, points[0][1]))
    controller = CompiledController(
        law, params, config, gains, scalar, Limits(tuple(limits), "slow" if slows(law) else "cut")
    )
    if controller.refused:
        raise BadInput(f"{law.name}: the C rejects random parameters: {controller.refused}")
    codes = {library(law, scalar).status(n): n for n in range(-len(STATUS), len(STATUS))}
    steps = [
        ExpectedStep(*point, codes[status], tau, off)
        for point, (status, tau, off) in zip(points, right, strict=True)
    ]
    answers = [controller.step(*point) for point in points]
    here = digest([(codes[status], tau) for status, tau in answers], SCALARS[scalar])
    return Golden(law, params, config, gains, steps, limits, here)


def _exact(expression: ca.SX, law: ControlLaw, *numbers: np.ndarray) -> np.ndarray:
    """Return the model's plain expression, rounded once; `numbers` are params, config, gains,
    state and reference."""
    groups = [law.groups[name] for name in ("params", "config", "gains", "state", "reference")]
    places = [quantity.symbol for group in groups for quantity in group]
    return np.array(
        evaluate(expression, places, np.concatenate([np.ravel(group) for group in numbers])), float
    )


def _limits(sizes: np.ndarray, off: float) -> np.ndarray:
    """Return limits (r,) that about half of the inputs of these sizes (N, r) exceed; no size is within `off`
    of its limit.

    An input whose sizes leave no such place, for instance one that is always zero, has a limit above all of
    them.
    """
    return np.array([_limit(np.sort(column), off) for column in sizes.T], np.float32).astype(float)


def _limit(sizes: np.ndarray, off: float) -> float:
    edges = np.append(sizes, 2 * sizes[-1] + 8 * off)
    # Also once the limit is rounded to a float
    wide = np.flatnonzero(np.diff(edges) > 4 * off + 1e-6 * edges[1:])
    between = (edges[wide] + edges[wide + 1]) / 2
    return float(between[np.abs(between - np.median(sizes)).argmin()])


def _limited(
    tau: np.ndarray, slope: np.ndarray, off: float, limits: np.ndarray
) -> tuple[str, np.ndarray, float]:
    """Return status, inputs within the limits, and the tolerance of these if tau and its gradient have the
    tolerance `off`."""
    if np.all(np.abs(tau) <= limits):
        return "ok", tau, off
    if not len(slope):
        return "saturated", np.clip(tau, -limits, limits), off
    exact = slowed(tau, slope, limits)
    steps = off * np.vstack([np.eye(len(tau)), -np.eye(len(tau))])
    moved = [slowed(tau + step, slope, limits) for step in steps] + [
        slowed(tau, slope + step, limits) for step in steps
    ]
    return "saturated", exact, off + sum(np.abs(other - exact).max() for other in moved)


def _digests(golden: Sequence[Golden], sources: dict[str, str], scalar: str) -> dict[str, int]:
    """Return the digests of the self-test on this machine, by name."""
    ffi = cffi.FFI()
    names = digests(golden, SCALARS[scalar])
    ffi.cdef("".join(f"uint32_t {name}(void);\n" for name in names))
    text = selftest(golden, SCALARS[scalar]).replace("static uint32_t", "uint32_t")
    own = headers()
    own["route.h"] = own["route.h"].replace("static uint32_t", "uint32_t")
    laws = {name: text for name, text in sources.items() if not name.startswith("noslip_")}
    lib = load(ffi, {**laws, **own, "selftest.c": text})
    return {name: getattr(lib, name)() for name in names}


def _operations(law: ControlLaw, scalar: str, count: dict[str, int]) -> str:
    compiled = library(law, scalar)
    size = compiled.ffi.sizeof(compiled.name(""))
    numbers = (size, count["add"] + count["sub"], count["mul"], count["div"], count["sqrt"], count["sincos"])
    return f"| `{law.name}` | {' | '.join(map(str, numbers))} |"


def _measured(name: str, folder: Path) -> str:
    """Return the output of `make test` and `make budget` in the folder, which is restored; or why they were
    not run.

    Raises BadInput if the self-test fails.
    """
    absent = FIRMWARE[name].missing("make")
    if absent:
        return (
            f"Bytes and instructions were not measured on the computer that exported this ({absent[0]} is "
            "missing): see `make budget`.\n"
        )
    outputs = []
    for goal in ("test", "budget"):
        command = ["make", "-s", "-C", str(folder), goal]
        process = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            timeout=TIMEOUT,
        )
        if process.returncode:
            lines = (process.stderr + process.stdout).strip().splitlines()
            worst = next(
                (line for line in lines if "rror:" in line or "FAIL" in line),
                lines[-1] if lines else "no output",
            )
            raise BadInput(f"the exported project does not pass `make {goal}`: {worst}")
        outputs.append(process.stdout.strip())
    subprocess.run(["make", "-s", "-C", str(folder), "clean"], capture_output=True, timeout=TIMEOUT)
    compiler = FIRMWARE[name].compiler or "cc"
    asked = subprocess.run(
        [compiler, "-dumpfullversion"], capture_output=True, encoding="utf-8", errors="replace"
    )
    version = asked.stdout.strip()
    text = "\n".join(outputs).replace(str(folder), ".")
    counted = (
        "; instructions of a step with all its checks, as executed in QEMU" if FIRMWARE[name].bare else ""
    )
    return f"Measured with {compiler} {version} -O2{counted}:\n\n```\n{text}\n```\n"
