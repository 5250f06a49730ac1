"""`noslip generate`: writes the C of a robot's control laws, or compares it with the existing files."""

import argparse
import difflib
import hashlib
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ..readers.errors import BadInput, naming
from ..readers.files import MARK, check_folder, write_folder
from ..readers.progress import Progress
from .commands import refuse_given, show

if TYPE_CHECKING:
    from ..model.law import ControlLaw

DYNAMICS = "dynamics"  # written in addition to the laws
FOLLOWER = "follower"  # with its law and the dynamics
EKF = "ekf"  # the extended Kalman filter
ADAPTATION = "adaptation"  # with the dynamics
PARTS = (DYNAMICS, EKF, ADAPTATION)  # are not laws
# Folders whose code makes files.
DETERMINE = (
    "model",
    "codegen",
    "simulation/controllers",
    "checks/verification",
    "readers",
    "runtime_c",
    "cli",
)

OUTPUT_HELP = (
    f"a law, such as type_i, {DYNAMICS}, the plant model, {EKF}, the filter for the pose, {ADAPTATION}, "
    f"which learns the parameters of --adapt, or {FOLLOWER}, a law of lines and arcs with all that is around "
    "it; may be repeated (default: all but what learns)"
)
EXAMPLE = """examples:
  noslip generate labmate                      write generated/labmate/
  noslip generate labmate --check              exit with 1 and print a diff unless the C is current
  noslip generate labmate --explain            print the effect of each pass of the optimizer
  noslip generate labmate --output ekf --scale thetadot_r --scale thetadot_l --scale b -o c
                                               write the filter, which also estimates radii and track
  noslip generate my_robot.py:cart -o c --output type_i --scalar float"""


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add `noslip generate`."""
    parser = subparsers.add_parser(
        "generate",
        help="write the C of a robot's control laws and dynamics",
        description="Write the C of a robot's control laws and dynamics into DIR/ROBOT/, in double and "
        "float. Before writing, the C is compiled and compared with the model at random states; "
        "if they differ, nothing is written and the exit code is 1. Without a C compiler, the "
        "comparison is skipped with a warning.",
        epilog=EXAMPLE,
    )
    parser.add_argument("robot", metavar="ROBOT", help="name of a shipped robot or path/to/file.py:name")
    parser.add_argument(
        "-o", dest="out", metavar="DIR", default="generated", help="output folder (default: generated)"
    )
    add_selection(parser)
    parser.add_argument(
        "--check",
        action="store_true",
        help="write nothing; fail with a diff unless the files in DIR are current",
    )
    parser.add_argument(
        "--explain", action="store_true", help="write nothing; print the effect of each pass of the optimizer"
    )
    add_balance(parser)
    parser.add_argument("--for", dest="target", metavar="TARGET", help=argparse.SUPPRESS)
    parser.set_defaults(run=run)


def add_balance(parser: argparse.ArgumentParser) -> None:
    """Add the options of the feedback of a robot with fewer inputs than degrees of freedom."""
    parser.add_argument(
        "--lqr",
        nargs="+",
        default=[],
        metavar="NAME=WEIGHT",
        help="instead of laws, ROBOT_lqr.h: the state feedback at rest of a robot with fewer inputs than "
        "degrees of freedom that minimizes the integral of the weighted squares of these states and of "
        "the inputs",
    )
    parser.add_argument(
        "--motion",
        nargs="+",
        default=[],
        metavar="NAME=VALUE",
        help="for --lqr: not at rest, but in the steady motion with these velocities, such as speed=0.5 "
        "yaw_rate=0.4",
    )
    parser.add_argument(
        "--effort", type=float, metavar="WEIGHT", help="of the inputs, for --lqr (default: 1)"
    )
    parser.add_argument(
        "--limit", type=float, metavar="N", help="largest input, N or N m, for --lqr (default: none)"
    )
    parser.add_argument(
        "--without",
        action="append",
        default=[],
        metavar="NAME",
        help="a state that --lqr does not use; may be repeated",
    )


def add_selection(parser: argparse.ArgumentParser) -> None:
    """Add the options that select laws and scalars."""
    parser.add_argument("--output", action="append", default=[], metavar="LAW", help=OUTPUT_HELP)
    parser.add_argument(
        "--scale",
        action="append",
        default=[],
        metavar="NAME",
        help="the filter also estimates by how much this parameter or quasi-velocity must be multiplied; may "
        "be repeated",
    )
    parser.add_argument(
        "--adapt",
        action="append",
        default=[],
        metavar="NAME",
        help=f"a parameter that --output {ADAPTATION} learns while the robot drives; may be repeated",
    )
    parser.add_argument("--scalar", choices=("double", "float", "both"), default="both", help="default: both")


def run(args: argparse.Namespace) -> int:
    """Run `noslip generate`. Return 1 if --check finds a difference, or if C and model differ;
    nothing is written then."""
    if args.target is not None:
        raise BadInput(
            "--for is gone, since it saved nothing that could be measured: leave it out; the C suits all "
            "targets"
        )
    if args.lqr:
        return _generate_balance(args)
    refuse_given(args, ("effort", "limit", "motion", "without"), "applies to --lqr NAME=WEIGHT ...")
    select_follower(args)
    if args.explain:
        from ..codegen.explain import explain

        explained = {law.name: explain(law) for law in selected_laws(args)}
        show(args, lambda: "\n\n".join(explained.values()), lambda: explained)
        return 0
    if not args.check:
        check_folder(args.out)
    files = selected_files(
        args, dynamics=not args.output or DYNAMICS in args.output, compare=not args.check, lanes=True
    )
    folder = Path(args.out) / robot_name(files)
    if args.check:
        differ = _compare(files, folder)
        total = len({*files, *differ})
        different = f"{folder}: {len(differ)} of {total} files differ"
        show(
            args,
            lambda: different if differ else f"{folder}: {len(files)} files are current",
            lambda: {"ok": not differ, "folder": str(folder), "files": total, "different": differ},
        )
        return int(bool(differ))
    write_folder(folder, files, stale=_written_before(folder) - set(files))
    show(
        args, lambda: f"{folder}: {len(files)} files", lambda: {"folder": str(folder), "files": sorted(files)}
    )
    return 0


def _generate_balance(args: argparse.Namespace) -> int:
    """Write the header of a state feedback. Return 1 if its C differs from it; nothing is written then."""
    from ..readers.reading import by_name, number
    from ..readers.robots import find_robot
    from ..simulation.controllers.balance.feedback import design
    from ..simulation.controllers.balance.in_c import ROUNDING, differences, header
    from ..simulation.controllers.balance.steady import analyse_steady

    others = {"--output": args.output, "--check": args.check, "--explain": args.explain}
    others |= {"--scale": args.scale, "--adapt": args.adapt, "--scalar": args.scalar != "both"}
    if unused := [option for option, value in others.items() if value]:
        raise BadInput(
            f"--lqr does not go with {', '.join(unused)}: it writes one header, in double and float"
        )
    if args.limit is not None:
        number("positive")(args.limit, "--limit")
    effort = 1.0 if args.effort is None else args.effort
    steady = analyse_steady(
        find_robot(args.robot), by_name("--motion", args.motion, "NAME=NUMBER, such as speed=0.5")
    )
    weights = by_name("--lqr", args.lqr, "NAME=NUMBER, such as pitch=10")
    balanced = design(steady, weights, effort, args.without, args.limit or float("inf"))
    found = differences(balanced)
    if wrong := [
        f"{scalar} by {difference:.2g}"
        for scalar, difference in found.items()
        if not difference <= ROUNDING[scalar]
    ]:
        print(
            f"noslip: {balanced.name}_lqr: the C differs from the feedback: {', '.join(wrong)}",
            file=sys.stderr,
        )
        return 1
    given = [*args.lqr, f"--effort {effort:g}", *[f"--without {name}" for name in args.without]]
    given += [] if args.limit is None else [f"--limit {args.limit:g}"]
    given += ["--motion", *args.motion] if args.motion else []
    folder, name = Path(args.out) / balanced.name, f"{balanced.name}_lqr.h"
    where = "at rest" if steady.rests else "in steady motion"
    about = f"{MARK}: state feedback of {balanced.name} {where}, --lqr {' '.join(given)}"
    write_folder(folder, {name: header(balanced, about)}, stale=set())
    show(
        args,
        lambda: f"{folder / name}: compared at random states",
        lambda: {"folder": str(folder), "files": [name]},
    )
    return 0


def select_follower(args: argparse.Namespace) -> None:
    """Replace the follower in the selection by what it consists of. Raises BadInput if the robot has none."""
    if FOLLOWER not in args.output:
        return
    from ..codegen.files import has_follower
    from ..codegen.follower.follower import LAW, why_no_follower
    from ..readers.robots import find_laws, find_robot, law_of, system_of

    system = system_of(find_robot(args.robot))
    if LAW not in find_laws(system) or not has_follower(law_of(system, LAW)):
        raise BadInput(f"--output {FOLLOWER}: {why_no_follower(system)}; choose a law instead")
    args.output = list(dict.fromkeys([name for name in args.output if name != FOLLOWER] + [LAW, DYNAMICS]))


def selected_files(
    args: argparse.Namespace, dynamics: bool, compare: bool = True, lanes: bool = False
) -> dict[str, str]:
    """Return the selected C files by name, with the dynamics and the batch laws or without; what learns
    requires the former. Print to stderr where the constraints lose rank.

    Raises Mismatch if the C is to be compared with the model and differs from it.
    """
    from ..codegen.versions import TOOLS
    from ..model.mechanism import Mechanism
    from ..readers.kept import remembered
    from ..readers.robots import find_robot

    robot = find_robot(args.robot)
    chosen = [getattr(args, option, "") for option in ("output", "scale", "adapt", "scalar")]
    key = ("files", TOOLS, robot.declared(), chosen, dynamics, lanes, compare and _compiled_by())
    make = partial(_selected_files, args, dynamics, compare, lanes)
    own = type(robot) is not Mechanism  # a class of the user's, of which `declared` may not tell all
    made = make() if own else remembered(key, make, rooms=DETERMINE, lasts=lambda made: made.lasts)
    for line in made.warnings:
        print(f"warning: {line}", file=sys.stderr)
    return made.files


@dataclass(frozen=True)
class _Made:
    """The selected C files by name, and where the constraints lose rank; `lasts`:
    all that was to be compared was compared."""

    files: dict[str, str]
    warnings: list[str]
    lasts: bool


def _compiled_by() -> tuple | None:
    """Return the compiler with which the C is compared with the model; None if there is none."""
    from ..simulation.controllers.build import FLAGS, QUICK, compiler, identity

    try:
        return identity([*compiler(), *FLAGS, *QUICK])
    except BadInput:
        return None


def _selected_files(args: argparse.Namespace, dynamics: bool, compare: bool, lanes: bool) -> _Made:
    """As `selected_files`."""
    from ..checks.verification.generate import generate
    from ..checks.verification.verify import is_compared
    from ..codegen.files import robot_files
    from ..model.reduction import warnings
    from ..readers.robots import find_robot, placed, system_of

    scalars = ("double", "float") if args.scalar == "both" else (args.scalar,)
    robot = find_robot(args.robot)
    system, laws = system_of(robot), _laws_of_files(args)
    with placed(robot), Progress() as progress:
        adapted = _adapted(args)
        dynamics = dynamics or bool(adapted)
        scaled = _scaled(args, lanes and not args.output)
        asked = system, laws, scalars, dynamics, lanes, scaled, adapted
        files = generate(*asked, progress) if compare else robot_files(*asked)
    return _Made(files, warnings(system), not compare or is_compared(system, laws, files, scaled))


def _laws_of_files(args: argparse.Namespace) -> list["ControlLaw"]:
    return [] if args.output and set(args.output) <= set(PARTS) else selected_laws(args)


def _scaled(args: argparse.Namespace, everything: bool) -> list[str] | None:
    """Return of what the filter estimates the scale; None: no filter. Raises BadInput if the robot has none,
    or not this."""
    from ..codegen.ekf.filter import check_scales, why_no_filter
    from ..model.errors import ModelError
    from ..readers.robots import find_robot, system_of

    asked = EKF in args.output
    if not (asked or everything):
        refuse_given(args, ["scale"], f"applies to the filter: add --output {EKF}")
        return None
    system = system_of(find_robot(args.robot))
    if not asked and not args.scale and why_no_filter(system):
        return None
    with naming(f"--output {EKF}", ModelError):
        check_scales(system, args.scale)
    return args.scale


def _adapted(args: argparse.Namespace) -> list[str]:
    """Return the parameters that are learned. Raises BadInput if they cannot be."""
    from ..codegen.adaptation.adaptation import adapted_parameters
    from ..model.errors import ModelError
    from ..readers.robots import find_robot, system_of

    if ADAPTATION not in args.output:
        refuse_given(args, ["adapt"], f"names what --output {ADAPTATION} learns: add it")
        return []
    if not args.adapt:
        raise BadInput(
            f"--output {ADAPTATION} requires --adapt NAME: a parameter that changes, such as the mass"
        )
    with naming(f"--output {ADAPTATION}", ModelError):
        adapted_parameters(system_of(find_robot(args.robot)), args.adapt)
    return args.adapt


def selected_laws(args: argparse.Namespace) -> list["ControlLaw"]:
    """Return the selected control laws. Raises BadInput if the robot has none or the selection is empty."""
    from ..model.outputs import OUTPUTS
    from ..readers.robots import find_laws, find_robot, law_of, system_of

    system = system_of(find_robot(args.robot))
    names: Sequence[str] = [name for name in args.output if name not in PARTS]
    if args.output and not names:
        raise BadInput(
            f"--output {args.output[0]} is not a control law; also name a law, such as --output "
            f"{next(iter(OUTPUTS))}"
        )
    names = names or find_laws(system)
    if not names:
        names = [next(iter(OUTPUTS))]  # building it raises the error that states the reason
    laws: list[ControlLaw] = []
    names = list(dict.fromkeys(names))
    with Progress() as progress:
        for name in names:
            progress(len(laws), len(names), "laws derived")
            laws.append(law_of(system, name))
    return laws


def robot_name(files: Mapping[str, str]) -> str:
    """Return the name of the robot to which these files belong."""
    return json.loads(files["manifest.json"])["robot"]


def _written_before(folder: Path) -> set[str]:
    """Return the files in the folder that an earlier run listed in its manifest and that have not been
    changed since."""
    try:
        listed = dict(json.loads((folder / "manifest.json").read_text(encoding="utf-8"))["files"])
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return set()
    regular = [path for path in folder.rglob("*") if path.is_file() and not path.is_symlink()]
    present = {path.relative_to(folder).as_posix(): path for path in regular}
    return {
        name
        for name, path in present.items()
        if hashlib.sha256(path.read_bytes()).hexdigest() == listed.get(name)
    }


def _compare(files: Mapping[str, str], folder: Path) -> list[str]:
    """Print the differences between the folder and `files`, and return the names of the files that differ,
    are added or are missing.
    """
    folders = {str(Path(name).parent) for name in files}
    present = {path.relative_to(folder).as_posix() for path in folder.rglob("*")} - folders
    different = []
    for name in sorted(present | set(files)):
        path = folder / name
        if name not in files:
            print(f"{path}: this file is not generated; remove it", file=sys.stderr)
        elif name not in present:
            print(f"{path}: missing; run noslip generate", file=sys.stderr)
        elif path.read_bytes() != files[name].encode():
            old = path.read_bytes().decode(errors="replace").splitlines(keepends=True)
            sys.stderr.writelines(
                difflib.unified_diff(
                    old, files[name].splitlines(keepends=True), str(path), "generated from the model"
                )
            )
        else:
            continue
        different.append(name)
    return different
