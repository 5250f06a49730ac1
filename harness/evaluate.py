"""`noslip evaluate`: the quantities of a control law at given states."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .backends import BACKENDS, ON_TARGET, Controller, Evaluation, ParameterRefused, make_controller

if TYPE_CHECKING:
    from .cases import Case

EXAMPLE = """example:
  noslip evaluate tests/reference/labmate_paper.json --backend c -o out.json"""


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "evaluate",
        help="evaluate a control law at given states",
        description="Evaluate h, ydot, Phi, Phidot, u and tau at the states of a file of cases.\n"
        "A case that cannot be evaluated has its status instead; that is no error.",
        epilog=EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("cases", metavar="CASES.json", help="cases: parameters, output, q, nu, reference, gains")
    parser.add_argument(
        "--backend",
        choices=(*BACKENDS, *ON_TARGET),
        default="c",
        help="casadi; the generated C in double (c, the default) or float (cf); the same on an emulated Cortex-M4F or RV32",
    )
    parser.add_argument(
        "-o", dest="out", metavar="OUT.json", default="-", help="where to write; - (the default) is standard output"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """The command. Answers 0: also when cases have a status other than ok."""
    from .cases import read_cases, write_out

    write_out(args.out, evaluate_cases(read_cases(args.cases), args.backend))
    return 0


def evaluate_cases(cases: Sequence[Case], backend: str) -> list[Evaluation]:
    """Evaluate each case; a parameter that the law refuses gives it the status bad_parameter, or nonfinite."""
    controllers: dict[tuple, Controller | None] = {}  # None: refused
    evaluations = []
    for case in cases:
        key = (case.law, case.params, case.config, case.gains)
        if key not in controllers:
            try:
                controllers[key] = make_controller(backend, *key)
            except ParameterRefused:
                controllers[key] = None
        controller = controllers[key]
        if controller is not None:
            evaluation = controller.evaluate(case.state, case.reference)
        else:
            numbers = (*case.params, *case.config, *case.gains)
            evaluation = Evaluation("bad_parameter" if np.all(np.isfinite(numbers)) else "nonfinite")
        if not all(np.all(np.isfinite(value)) for value in evaluation.values.values()):
            evaluation = Evaluation("nonfinite")
        evaluations.append(evaluation)
    return evaluations
