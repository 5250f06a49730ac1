"""`noslip analyse`: holonomic constraints, controllability,
singularities of the outputs and zero dynamics of a robot."""

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ..readers.files import check_targets, write_whole
from ..readers.kept import remembered
from ..readers.progress import Progress
from .commands import rendered

if TYPE_CHECKING:
    from ..analysis.answers import Answer, System

ROOMS = ("model", "codegen", "readers", "simulation", "analysis")  # that analyse
EXAMPLE = """ROBOT may also be a Kinematics or a rolling contact in a file; these have no outputs.
The exit code is 1 if a start is not proved to be safe.

examples:
  noslip analyse labmate
  noslip analyse labmate --output type_iv_circle --json
  noslip analyse labmate --start line --report labmate.html
  noslip analyse labmate --start line --uncertainty 0.01 --uncertainty m_c=0.2
  noslip analyse labmate --output type_iv_line --start line --table"""


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add `noslip analyse`."""
    parser = subparsers.add_parser(
        "analyse",
        help="analyse constraints, controllability, singularities and zero dynamics of a robot",
        description=(
            "Determine which constraints of a robot are holonomic, what can be controlled, where the "
            "decoupling matrix is singular, and the zero dynamics. Generic ranks and integrals are exact. "
            "The set where a rank changes is given by an exact equation; the ranks on it are computed at "
            "real points with 60 digits. Results that are not exact are marked."
        ),
        epilog=EXAMPLE,
    )
    parser.add_argument("robot", metavar="ROBOT", help="name of a shipped robot or path/to/file.py:name")
    parser.add_argument(
        "--output",
        metavar="LAW",
        action="append",
        default=[],
        help="only these outputs, such as type_i; may be repeated",
    )
    parser.add_argument(
        "--start",
        metavar="SPEC.toml",
        action="append",
        default=[],
        help="determine whether the loop from this start meets the singular set; may be repeated",
    )
    parser.add_argument(
        "--uncertainty",
        metavar="[NAME=]SIZE",
        action="append",
        default=[],
        help="relative uncertainty of one parameter of the robot, or of all, for --start; "
        "for example 0.01 or m_c=0.2; may be repeated",
    )
    parser.add_argument(
        "--table",
        action="store_true",
        help="with --start, also compute the largest safe offset by speed and heading; takes a minute or two",
    )
    parser.add_argument(
        "--report", metavar="FILE.html", help="also write an HTML page with formulas and drawings"
    )
    parser.add_argument(
        "-o", dest="out", metavar="FILE", default="-", help="output file; default: standard output"
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run `noslip analyse`. Return 0, or 1 if a start is not proved to be safe. Raises BadInput,
    ModelError, OSError."""
    inputs = [*arguments.start, arguments.robot.split(":")[0]]
    check_targets([arguments.out, *([arguments.report] if arguments.report else [])], inputs=inputs)
    system = find_system(arguments.robot)
    uncertainty = read_uncertainty(arguments.uncertainty, system)

    def answer() -> "Answer":
        from ..analysis.answers import analyse  # slow to import

        with Progress() as progress:
            return analyse(system, arguments.output, arguments.start, uncertainty, arguments.table, progress)

    if arguments.report:
        from ..analysis.report import report

        analysis = answer()
        write_whole(arguments.report, report(analysis))
        text, values, fails = _results(analysis)
    elif key := _key(arguments, uncertainty):
        text, values, fails = remembered(key, lambda: _results(answer()), rooms=ROOMS)
    else:
        text, values, fails = _results(answer())
    write_whole(arguments.out, rendered(arguments, lambda: text, lambda: values) + "\n")
    return 1 if fails else 0


def _results(answer: "Answer") -> tuple[str, dict[str, Any], bool]:
    """Return the answer as text and as values, and whether a start is not proved to be safe."""
    from ..analysis.answers import as_json
    from ..analysis.text import as_text

    return as_text(answer), as_json(answer), answer.fails


def _key(arguments: argparse.Namespace, uncertainty: dict[str, float]) -> tuple:
    """Return all that the results depend on except the code of ROOMS, for shipped robots; empty for a robot
    in a file, whose code may import more.
    """
    from importlib.metadata import version

    from ..model.robots import SHIPPED
    from ..simulation.specification.vary import read_varied

    specs = [read_varied(file, {}) for file in arguments.start]
    if any(
        robot.split(":")[0] not in SHIPPED for robot in (arguments.robot, *(spec.robot for spec in specs))
    ):
        return ()
    tools = [version(name) for name in ("casadi", "mpmath", "numpy", "scipy", "sympy")]
    starts = list(zip(arguments.start, map(repr, specs), strict=True))
    return (
        "analysis",
        tools,
        arguments.robot,
        arguments.output,
        starts,
        sorted(uncertainty.items()),
        arguments.table,
    )


def read_uncertainty(texts: Sequence[str], system: "System") -> dict[str, float]:
    """Return relative uncertainties by parameter name. A size without a name applies to all parameters not
    named. Raises BadInput.
    """
    from ..readers.reading import by_name

    sizes = by_name(
        "--uncertainty",
        [text if "=" in text else f"={text}" for text in texts],
        "NAME=SIZE, such as m_c=0.01",
    )
    common = {
        q.name: size for name, size in sizes.items() if not name for q in getattr(system, "parameters", ())
    }
    return common | {name: size for name, size in sizes.items() if name}


def find_system(text: str) -> "System":
    """Return the robot of this name; in a file, also a Kinematics, a rolling contact,
    or a function that returns one."""
    from ..model.mechanism import Mechanism
    from ..model.rolling.contact import PlanarContact, RollingContact
    from ..model.rolling.kinematics import Kinematics
    from ..readers.robots import find_robot

    return find_robot(text, (Mechanism, Kinematics, RollingContact, PlanarContact))
