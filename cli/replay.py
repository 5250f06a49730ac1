"""`noslip replay`: repeats recorded calls of a target and compares the results bit by bit."""

import argparse

from ..controllers import ON_TARGET
from ..readers.progress import Progress
from ..simulation import replay
from ..simulation.replay import first_difference, read_record
from .commands import show


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add `noslip replay`."""
    parser = subparsers.add_parser(
        "replay",
        help="repeat recorded calls of a target and compare bits",
        description="Repeat the calls of the generated float C in a record and compare every bit of the results.\n"
        "Exit codes: 0 if all are equal, 1 at the first difference, 2 if the file is not a record of this model.\n\n"
        + replay.__doc__.split("\n\n", 1)[1],
        epilog="example:\n  noslip simulate line --set 'simulation.backend=\"m4f\"' -o run.csv --record run.txt\n"
        "  noslip replay run.txt",
    )
    parser.add_argument(
        "record", metavar="FILE", help="record written by `noslip simulate --record`, or by a board in that format"
    )
    parser.add_argument(
        "--backend", choices=("cf", *ON_TARGET), default="cf", help="this host (cf, the default), Cortex-M4F or RV32"
    )
    parser.add_argument(
        "--trust", action="store_true", help="allow to execute the robot file named in FILE, which is Python code"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run `noslip replay`. Return 0 if all bits are equal, else 1. Raises BadInput."""
    from ..controllers.pil import replay_session

    with Progress() as progress:
        record = read_record(args.record, args.trust, progress)
    session = replay_session(record.law, args.backend)
    try:
        with Progress() as progress:
            difference = first_difference(record, session, args.backend, progress)
    finally:
        session.close()
    values = {"file": args.record, "backend": args.backend, "calls": len(record.calls), "difference": difference}
    same = f"{len(record.calls)} calls, the same bits on {args.backend}"
    show(args, lambda: f"{args.record}: {difference or same}", lambda: {"ok": difference is None, **values})
    return int(difference is not None)
