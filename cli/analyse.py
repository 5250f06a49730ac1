"""`noslip analyse`: which constraints are holonomic, what can be controlled, where control breaks, what moves uncontrolled."""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..readers.errors import BadInput
from ..readers.files import check_targets, write_whole

if TYPE_CHECKING:
    from ..analysis.answers import System

PAUSE = 2.0  # s, between two lines that tell the progress
EXAMPLE = """ROBOT may also be a Kinematics, or a rolling contact, in a file: their outputs are empty.
Exit 1 when a start is not proved to be safe.

examples:
  noslip analyse labmate
  noslip analyse labmate --output type_iv_circle --json
  noslip analyse labmate --start specs/line.toml --report labmate.html
  noslip analyse labmate --start specs/line.toml --uncertainty 0.01 --uncertainty m_c=0.2
  noslip analyse labmate --output type_iv_line --start specs/line.toml --table"""


class Progress:
    """A line on stderr for the entries of a table that are done, at most one in 2 s."""

    def __init__(self) -> None:
        self._begin = self._last = time.monotonic()

    def __call__(self, done: int, of: int) -> None:
        """`done` entries `of` all are done."""
        now = time.monotonic()
        if done < of and now - self._last > PAUSE:
            self._last = now
            print(f"noslip: {done} of {of} safe offsets found after {now - self._begin:.0f} s", file=sys.stderr, flush=True)


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add `noslip analyse`."""
    parser = subparsers.add_parser(
        "analyse",
        help="analyse what a robot can do, with the reason",
        description=(
            "Tell which constraints of a robot are holonomic, what can be controlled, where control is singular and what moves "
            "that is not controlled. Generic ranks and integrals are exact; where they change is exact in its equation, and the "
            "ranks there are those of real points to 60 digits; whatever is neither is marked."
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
    parser.add_argument(
        "--uncertainty",
        metavar="[NAME=]SIZE",
        action="append",
        default=[],
        help="relative uncertainty of a parameter of the robot, or of all of them, that --start takes into account; "
        "for example 0.01 or m_c=0.2; may come several times",
    )
    parser.add_argument(
        "--table", action="store_true", help="with --start, also the largest safe offset by speed and heading; takes a minute or two"
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--report", metavar="FILE.html", help="write a page with formulas and drawings too")
    parser.add_argument("-o", dest="out", metavar="FILE", default="-", help="where the answer goes; default: standard output")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """`noslip analyse`: 0, or 1 when a start is not proved to be safe. Raises BadInput, ModelError, OSError."""
    from ..analysis.answers import analyse, as_json  # slow to import

    inputs = [*arguments.start, arguments.robot.split(":")[0]]
    check_targets([arguments.out, *([arguments.report] if arguments.report else [])], inputs=inputs)
    system = find_system(arguments.robot)
    uncertainty = read_uncertainty(arguments.uncertainty, system)
    answer = analyse(system, arguments.output, arguments.start, uncertainty, arguments.table, Progress())
    if arguments.json:
        written = json.dumps(as_json(answer), indent=2, ensure_ascii=False) + "\n"
    else:
        from ..analysis.text import as_text

        written = as_text(answer)
    if arguments.report:
        from ..analysis.report import report

        write_whole(arguments.report, report(answer))
    write_whole(arguments.out, written)
    return 1 if answer.fails else 0


def read_uncertainty(given: Sequence[str], system: "System") -> dict[str, float]:
    """Sizes by name of parameter; one without a name is for all that have none of their own. Raises BadInput."""
    found: dict[str, float] = {}
    for text in given:
        name, _, size = text.rpartition("=")
        try:
            found[name] = float(size)
        except ValueError:
            raise BadInput(f"--uncertainty {text}: give a number such as 0.01, or m_c=0.01 for one parameter") from None
    if "" not in found:
        return found
    common = found.pop("")
    return {q.name: common for q in getattr(system, "parameters", ())} | found


def find_system(text: str) -> "System":
    """A robot as for the other commands; in a file also a Kinematics or a rolling contact, or a function that answers one."""
    from ..model.mechanism import Mechanism
    from ..model.rolling.contact import PlanarContact, RollingContact
    from ..model.rolling.kinematics import Kinematics
    from ..readers.robots import find_robot

    return find_robot(text, (Mechanism, Kinematics, RollingContact, PlanarContact))
