"""A run of the firmware of a SPEC's vehicle, here or on an emulated processor: its C,
and the robot of the C that tests it."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ...codegen.files import has_follower, robot_files
from ...codegen.loop.stages import broken
from ...codegen.printing.scalar import FLOAT
from ...codegen.project.selftest import headers
from ...codegen.project.vehicle import VehicleNumbers, columns, places, vehicle_files
from ...codegen.targets import STANDARD
from ...model.law import ControlLaw
from ...readers.errors import BadInput
from ...readers.robots import find_robot, law_of
from ..controllers import ON_TARGET
from ..controllers.build import QUICK, built, compiler, with_runtime
from ..controllers.targets import CONSOLE, HOST, TARGETS, Target, require
from ..noise import source
from ..run import Run
from ..specification.spec import Spec
from .numbers import EXPORT, vehicle_of

ON = {"cf": HOST, **{backend: TARGETS[name] for backend, name in ON_TARGET.items()}}  # backend -> target
STOPPED = 1  # exit code where the watchdog stopped the vehicle
DESIRED = ("desired distance", "desired speed")  # after the columns of the CSV, with DRIVE_DESIRED
HEADERS = ("console.h", "decimal.h")  # of firmware/selftest


def runs_as_firmware(spec: Spec) -> bool:
    """Return whether a SPEC is run by the C in float that `noslip export --firmware` writes for its
    vehicle."""
    return (
        spec.simulation.backend in ON
        and not broken(spec, EXPORT)
        and has_follower(law_of(find_robot(spec.robot), spec.law))
    )


def run_of_firmware(spec: Spec, progress: Callable[[float], None] | None = None) -> Run:
    """Return the run of a SPEC that `runs_as_firmware`; `progress` receives the time reached. Its rows are
    those that the test of the exported project prints.

    Raises BadInput as `vehicle_of`, where a tool is missing, and if the firmware rejects its numbers.
    """
    loop, vehicle = vehicle_of(spec)
    law = loop.law
    named = _rows(law, vehicle, ON[spec.simulation.backend], progress)
    system, outputs = law.system, law.output.rows
    state, inputs = [q.name for q in system.state], [i.name for i in system.mechanism.inputs]
    contacts = [each.name for each in system.mechanism.standing if vehicle.floor]
    count, n, piece = len(named["t"]), len(system.mechanism.coordinates), named["piece"].astype(int)

    def table(*names: str) -> np.ndarray:
        """Return columns as a table, (N, len(names))."""
        return np.array([named[name] for name in names]).T if names else np.empty((count, 0))

    x = table(*state)
    return Run(
        spec=spec,
        law=law,
        plant=loop.plant,
        t=named["t"],
        q=x[:, :n],
        nu=x[:, n:],
        tau=table(*inputs),
        y=table(*(f"y{k + 1}" for k in range(len(outputs)))),
        y_d=table(*DESIRED),
        status=named["status"],
        forces=table(*(f"lambda_{k + 1}" for k in range(len(system.mechanism.constraint_names)))),
        seen=table(*(f"seen_{name}" for name in state)),
        piece=piece,
        config=np.array(places(law, vehicle.segments, vehicle.config["path"]["L"]))[piece],
        integral=table(*(f"integral_{name}" for name in loop.integral.rows)),
        extension=table(),
        integral_rows=loop.integral.rows,
        command=table(*(f"command_{v.name}" for v in system.quasi_velocities if vehicle.drives)),
        noticed=table(*(["believed_mu"] if "believed_mu" in named else [])),
        learned=table(),
        use={name: named[f"use_{name.replace(' ', '_')}"] for name in contacts},
        warnings=loop.warnings,
    )


def _rows(
    law: ControlLaw, vehicle: VehicleNumbers, target: Target, progress: Callable[[float], None] | None
) -> dict[str, np.ndarray]:
    """Drive a vehicle along its path on a target; return the columns by name."""
    found = []
    command = target.run(str(_program(law, vehicle, target).resolve()), *(CONSOLE if target.bare else ()))
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, encoding="ascii"
    ) as process:
        assert process.stdout, "it is a pipe"
        next(process.stdout)
        for line in process.stdout:
            found.append(line.rstrip("\n").split(","))
            if progress and len(found[-1]) > 1:
                progress(float(found[-1][0]))
    if process.returncode not in (0, STOPPED) or not found:
        raise BadInput(
            f"the firmware of the vehicle ends on {target.name} with exit code {process.returncode}"
        )
    if len(found[-1]) == 1:
        raise BadInput(f"the firmware rejects the numbers of the vehicle: {found[-1][0]}")
    names = [*columns(law, vehicle), *DESIRED]
    entries = zip(names, zip(*found, strict=True), strict=True)
    return {name: np.array(values, str if name == "status" else float) for name, values in entries}


def _program(law: ControlLaw, vehicle: VehicleNumbers, target: Target) -> Path:
    """Return the program that drives the vehicle. Raises BadInput if a tool is missing."""
    if target.bare:
        require(target.compiler, *target.machine[:1])
    own = {Path(name).name: text for name, text in vehicle_files(law, FLOAT, vehicle).items()}
    own |= {
        name: text
        for name, text in robot_files(law.system, [law], (FLOAT.real,)).items()
        if "_telemetry" not in name
    }
    own |= {name: text for name, text in headers().items() if name in HEADERS}
    files = {**with_runtime({**own, **source()}), **target.files()}
    sources = [
        name for name in files if name.endswith(".c") and (name not in target.files() or name in target.start)
    ]
    command = target.compile() if target.compiler else compiler()
    options = [*STANDARD, *QUICK, "-DDRIVE_DESIRED", *sources, *target.link()]
    return built([*command, *options], files, "drive.elf" if target.bare else "drive.run")
