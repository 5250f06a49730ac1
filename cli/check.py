"""`noslip check`: compares the generated C with the symbolic reference, and both with expected values."""

import argparse
from typing import TYPE_CHECKING

from ..readers.errors import BadInput
from ..readers.progress import Progress
from ..simulation.controllers import BACKENDS
from .commands import refuse_given, show

if TYPE_CHECKING:
    from ..checks.verification.check import Comparison

DESCRIPTION = """With files: compare every backend with the `expect` values of the cases.
Without files: compare the generated C in double with CasADi, and the C in float with the C in double, at
random states with random parameters. The exit code is 1 if an error exceeds its limit. Errors are relative
to the largest entry of the quantity (at random states at least to a tenth of its median size, because some
entries cancel)."""
EXAMPLE = """examples:
  noslip check                                       compare the C with the model, every law of the LABMATE
  noslip check --output type_i --states 100 --seed 7
  noslip check labmate_paper                         compare all backends with expected values"""


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add `noslip check`."""
    parser = subparsers.add_parser(
        "check",
        help="compare the C with the model, and all backends with expected values",
        description=DESCRIPTION,
        epilog=EXAMPLE,
    )
    parser.add_argument("cases", metavar="CASES.json", nargs="*", help="cases with `expect`")
    parser.add_argument(
        "--backend", action="append", choices=BACKENDS, help="only this backend; may be repeated"
    )
    random = parser.add_argument_group("without files")
    random.add_argument("--robot", help="name of a shipped robot or path/to/file.py:name (default labmate)")
    random.add_argument(
        "--output", metavar="LAW", help="only this law, such as type_iv_circle (default: all)"
    )
    random.add_argument("--states", type=int, metavar="N", help="random states per law (default 2000)")
    random.add_argument("--seed", type=int, help="seed of the random states (default 1992)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run `noslip check`. Return 0 if every error is within its limits, else 1. Raises BadInput."""
    # Slow to import
    from ..checks.verification.check import MOST_STATES, RANDOM_LIMITS, check_files, check_random

    if args.cases:
        refuse_given(
            args,
            ("robot", "output", "states", "seed"),
            "applies to random states only; omit it, or omit the files",
        )
        return _shown(args, check_files(args.cases, args.backend or BACKENDS))
    backends = args.backend or list(RANDOM_LIMITS)
    if "casadi" in backends:
        raise BadInput("casadi is the reference at random states; give --backend c or cf, or a file of cases")
    states, seed = 2000 if args.states is None else args.states, 1992 if args.seed is None else args.seed
    if not 1 <= states <= MOST_STATES or seed < 0:
        raise BadInput(
            f"--states must be 1 to {MOST_STATES} and --seed 0 or more; given: {states} and {seed}"
        )
    with Progress() as progress:
        comparison = check_random(args.robot or "labmate", args.output, states, seed, backends, progress)
    return _shown(args, comparison)


def _shown(args: argparse.Namespace, comparison: "Comparison") -> int:
    show(args, comparison.text, comparison.as_json)
    return 1 if comparison.failures else 0
