"""`noslip analyse`: which constraints are holonomic, what can be controlled, where control breaks, what moves uncontrolled."""

import argparse
import json
from typing import TYPE_CHECKING

from .files import check_targets, write_whole

if TYPE_CHECKING:
    from .analysis import System

EXAMPLE = """ROBOT may also be a Kinematics, or a rolling contact, in a file: their outputs are empty.
Exit 1 when a start will be singular.

examples:
  noslip analyse labmate
  noslip analyse labmate --output type_iv_circle --json
  noslip analyse labmate --start specs/line.toml --report labmate.html"""


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add `noslip analyse`."""
    parser = subparsers.add_parser(
        "analyse",
        help="tell what a robot can do, exactly and with the reason",
        description=(
            "Tell which constraints of a robot are holonomic, what can be controlled, where control is singular and what moves "
            "that is not controlled. Everything is exact."
        ),
        epilog=EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("robot", metavar="ROBOT", help="a shipped robot's name or path/to/file.py:name")
    parser.add_argument(
        "--output", metavar="LAW", action="append", default=[], help="only these outputs, such as type_i; may come several times"
    )
    parser.add_argument(
        "--start",
        metavar="SPEC.toml",
        action="append",
        default=[],
        help="say whether this start will meet the singular set; may come several times",
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--report", metavar="FILE.html", help="write a page with formulas and drawings too")
    parser.add_argument("-o", dest="out", metavar="FILE", default="-", help="where the answer goes; default: standard output")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """`noslip analyse`: 0, or 1 when a start will be singular. Raises BadInput, ModelError, OSError."""
    from .analysis import analyse, as_json  # slow to import

    check_targets([arguments.out, *([arguments.report] if arguments.report else [])])
    answer = analyse(find_system(arguments.robot), arguments.output, arguments.start)
    if arguments.json:
        written = json.dumps(as_json(answer), indent=2, ensure_ascii=False) + "\n"
    else:
        from .analysis_text import as_text

        written = as_text(answer)
    if arguments.report:
        from .analysis_report import report

        write_whole(arguments.report, report(answer))
    write_whole(arguments.out, written)
    return 1 if answer.fails else 0


def find_system(text: str) -> "System":
    """A robot as for the other commands; in a file also a Kinematics or a rolling contact, or a function that answers one."""
    from ..model.kinematics import Kinematics
    from ..model.mechanism import Mechanism
    from ..model.rolling import PlanarContact, RollingContact
    from .robots import find_robot

    return find_robot(text, (Mechanism, Kinematics, RollingContact, PlanarContact))
