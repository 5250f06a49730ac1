"""`noslip export`: writes C that builds without further set-up: a folder, a firmware project, or an FMU."""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..readers.errors import BadInput, Mismatch
from ..readers.files import check_ending, check_folder, check_targets, work_folder, write_folder, write_whole
from .commands import show
from .generate import (
    DYNAMICS,
    FOLLOWER,
    add_selection,
    robot_name,
    select_follower,
    selected_files,
    selected_laws,
)

if TYPE_CHECKING:
    from ..codegen.project.vehicle import VehicleNumbers

EXAMPLE = """examples:
  noslip export labmate --output type_iv_circle --scalar float -o my_firmware/noslip
  noslip export labmate --output type_iv_circle --firmware cortex-m4f -o my_firmware
  noslip export labmate --output type_iv_circle --fmu loop -o circle.fmu
  noslip export labmate --output type_iv_circle --package cmake -o my_package
  noslip export labmate --output follower --firmware cortex-m4f -o my_vehicle
  noslip export agv.toml --firmware generic -o my_agv"""
FMU = ("controller", "plant", "loop")
PACKAGES = ("cmake", "platformio", "arduino", "zephyr", "esp-idf")


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add `noslip export`."""
    parser = subparsers.add_parser(
        "export",
        help="write C that builds without further set-up, or an FMU",
        description="Write the C of a robot's laws, the runtime, a Makefile and an example into a new "
        "folder, after comparing the C with the model as `noslip generate` does. With "
        "--firmware: write a project for a target, with start-up code, CMake files, a control "
        "loop to complete, and a self-test with golden vectors (float, unless --scalar is "
        "double). With --fmu: write an FMU for co-simulation by FMI 3.0, in double, with sources "
        "and a binary for this platform. With --package: write a package in the form of a "
        "package manager, with the self-test (float, unless --scalar is double).",
        epilog=EXAMPLE,
    )
    parser.add_argument(
        "robot",
        metavar="ROBOT",
        help="name of a shipped robot or path/to/file.py:name; with --firmware also SPEC.toml: the firmware "
        "of its vehicle",
    )
    add_selection(parser)
    form = parser.add_mutually_exclusive_group()
    form.add_argument(
        "--firmware",
        choices=("cortex-m4f", "rv32", "generic"),
        metavar="TARGET",
        help="cortex-m4f, rv32 or generic (any machine with a C compiler)",
    )
    form.add_argument(
        "--fmu",
        choices=FMU,
        metavar="PART",
        help="controller, plant or loop (both, the law called at a period); one law, none for a plant",
    )
    form.add_argument("--package", choices=PACKAGES, metavar="MANAGER", help=", ".join(PACKAGES))
    parser.add_argument(
        "-o", dest="out", metavar="DIR", required=True, help="a new or empty folder; of an FMU the file, .fmu"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run `noslip export`. Return 1, with nothing written, if C and model differ. Raises BadInput if a folder
    is not empty."""
    vehicle = _vehicle(args) if args.robot.endswith(".toml") else None
    if args.fmu:
        return _export_fmu(args)
    from ..checks.verification.generate import rejected
    from ..codegen.project.example import example
    from ..readers.robots import refuse_course

    if args.firmware or args.package:
        refuse_course(
            args.output, f"--firmware {args.firmware}" if args.firmware else f"--package {args.package}"
        )
    select_follower(args)

    target = Path(os.path.realpath(args.out))
    if os.path.lexists(target) and (not target.is_dir() or any(target.iterdir())):
        raise BadInput(f"{args.out}: exists and is not an empty folder; choose another")
    check_folder(target)
    if (args.firmware or args.package) and args.scalar == "both":
        args.scalar = "float"
    generated = selected_files(args, dynamics=DYNAMICS in args.output)
    laws = selected_laws(args)
    library = {**_runtime(args.scalar), **generated}
    if args.package:
        from ..checks.verification.project import package_files

        files = package_files(args.package, library, laws, args.scalar)
    elif args.firmware:
        from ..checks.verification import project

        files, board = project.project_files(args.firmware, library, laws, args.scalar, vehicle)
    else:
        files = {**library, **example(generated, laws[0])}
        if why := rejected(files):
            raise Mismatch(f"{robot_name(generated)}: {why}")
    target.parent.mkdir(parents=True, exist_ok=True)
    with work_folder(target.parent) as work:
        folder = work / "export"
        try:
            write_folder(folder, files)
            if args.firmware:
                page = project.readme(
                    args.firmware, generated["manifest.json"], laws, args.scalar, board, folder
                )
                write_folder(folder, {"README.md": page})
        except OSError as error:
            raise OSError(error.errno, error.strerror, args.out) from error
        if target.is_dir():
            target.rmdir()
        os.replace(folder, target)
    robot = robot_name(generated)
    goal, does = (" test", "self-test") if args.firmware else ("", "example")
    driven = f", then drives the vehicle of {args.robot}" if vehicle else ""
    then = f"`make -C {shlex.quote(args.out)}{goal}` builds the library and runs {robot}'s {does}{driven}"
    if args.package:
        then = "README.md says how to use them"
    show(
        args,
        lambda: f"{args.out}: {len(files)} files; {then}",
        lambda: {
            "folder": args.out,
            "robot": robot,
            "laws": [law.name for law in laws],
            "files": sorted(files),
        },
    )
    return 0


def _vehicle(args: argparse.Namespace) -> VehicleNumbers:
    """Return the numbers of the vehicle of a SPEC, whose follower is then what is exported."""
    if not args.firmware:
        raise BadInput(
            f"{args.robot} is a SPEC, where a robot is expected; with --firmware TARGET its vehicle is "
            "exported"
        )
    if args.output:
        raise BadInput(f"--output {args.output[0]}: the SPEC says what is exported; leave it out")
    from ..readers.errors import naming
    from ..simulation.firmware.numbers import vehicle_of
    from ..simulation.specification.spec import read_spec

    spec = read_spec(args.robot)
    with naming(args.robot):
        _, vehicle = vehicle_of(spec)
    for warning in vehicle.warnings:
        print(f"{args.robot}: warning: {warning}", file=sys.stderr)
    args.robot, args.output = spec.robot, [FOLLOWER]
    return vehicle


def _refuse_kinematic(laws: Sequence[str]) -> None:
    from ..model.names import without_kinematic  # slow to import

    for name in laws:
        if without_kinematic(name) != name:
            raise BadInput(
                f"--fmu: {name} gives velocities; an FMU has the law of torques: take "
                f"{without_kinematic(name)}"
            )


def _export_fmu(args: argparse.Namespace) -> int:
    """Write an FMU, whose steps have been compared with those of the compiled C."""
    check_ending(args.out, [".fmu"], "an FMU")
    if args.scalar == "float":
        raise BadInput("--scalar float: FMUs are in double; leave it out")
    check_targets([args.out])
    args.scalar = "double"
    from ..checks.verification.fmu import make_fmu
    from ..readers.robots import find_robot, refuse_course, system_of

    laws = [name for name in args.output if name != DYNAMICS]
    _refuse_kinematic(laws)
    refuse_course(laws, f"--fmu {args.fmu}")
    if args.fmu == "plant":
        args.output = [DYNAMICS]
    elif len(laws) != 1:
        raise BadInput(f"--fmu {args.fmu} has one law: give one --output LAW")
    generated = selected_files(args, dynamics=args.fmu != "controller")
    system, law = system_of(find_robot(args.robot)), None if args.fmu == "plant" else selected_laws(args)[0]
    model, content = make_fmu(args.fmu, system, law, generated)
    write_whole(args.out, content)
    show(
        args,
        lambda: f"{args.out}: {model}, for co-simulation by FMI 3.0",
        lambda: {
            "file": args.out,
            "robot": robot_name(generated),
            "laws": [law.name] if law else [],
            "model": model,
        },
    )
    return 0


def _runtime(scalar: str) -> dict[str, str]:
    """Return the C runtime for a scalar ("double", "float" or "both"), by file name."""
    from ..codegen.runtime import runtime_files

    files = runtime_files()
    twins = {
        name: name.removesuffix(".c") + "_f.c" for name in files if name.removesuffix(".c") + "_f.c" in files
    }
    unwanted = {"double": set(twins.values()), "float": set(twins), "both": set()}[scalar]
    return {name: text for name, text in files.items() if name not in unwanted}
