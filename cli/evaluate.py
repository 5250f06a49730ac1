"""`noslip evaluate`: evaluates the quantities of a control law at given states."""

import argparse
from typing import Any

from ..readers.files import check_targets
from ..simulation.controllers import BACKENDS, ON_TARGET
from .commands import PrintSchema, show

EXAMPLE = """example:
  noslip evaluate labmate_paper --backend c -o out.json"""


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add `noslip evaluate`."""
    parser = subparsers.add_parser(
        "evaluate",
        help="evaluate a control law at given states",
        description="Evaluate h, ydot, Phi, Phidot, u and tau at the states of a file of cases.\n"
        "For a case that cannot be evaluated, the result is its status; the exit code is 0 all the same.",
        epilog=EXAMPLE,
    )
    parser.add_argument(
        "cases", metavar="CASES.json", help="cases: parameters, output, q, nu, reference, gains"
    )
    parser.add_argument(
        "--backend",
        choices=(*BACKENDS, *ON_TARGET),
        default="c",
        help="casadi; the generated C in double (c, the default) or float (cf); the float C on an emulated "
        "Cortex-M4F or RV32",
    )
    parser.add_argument(
        "-o",
        dest="out",
        metavar="OUT.json",
        default="-",
        help="output file; - (the default) is standard output",
    )
    parser.add_argument(
        "--schema",
        action=PrintSchema,
        nargs=0,
        const=_schema,
        help="print the JSON Schema of CASES.json and exit",
    )
    parser.set_defaults(run=run)


def _schema() -> dict[str, Any]:
    from ..simulation.specification.cases import schema  # slow to import

    return schema()


def run(args: argparse.Namespace) -> int:
    """Run `noslip evaluate`. Return 0, also if cases have a status other than ok. Raises BadInput,
    ModelError, OSError."""
    from ..checks.verification.evaluate import evaluate_cases
    from ..simulation.specification.cases import read_cases, write_out  # slow to import

    check_targets([args.out], inputs=[args.cases])
    evaluations = evaluate_cases(read_cases(args.cases), args.backend)
    write_out(args.out, evaluations)
    if args.out != "-":  # else the JSON is printed already
        statuses = [evaluation.status for evaluation in evaluations]
        show(args, str, lambda: {"backend": args.backend, "statuses": statuses, "files": [args.out]})
    return 0
