"""`noslip replay`: what a target computed, computed once more and compared bit by bit."""

import argparse

from ..controllers.controller import ON_TARGET
from ..simulation import replay
from ..simulation.replay import first_difference, read_record


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add `noslip replay`."""
    parser = subparsers.add_parser(
        "replay",
        help="do once more what a target was asked, and compare bits",
        description="Call the generated float C as a record says, and compare every bit that it answers.\n"
        "Exit 0 where all are equal, 1 at the first difference, 2 where the file is no record of this model.\n\n"
        + replay.__doc__.split("\n\n", 1)[1],
        epilog="example:\n  noslip simulate specs/line.toml --set 'simulation.backend=\"m4f\"' -o run.csv --record run.txt\n"
        "  noslip replay run.txt",
    )
    parser.add_argument("record", metavar="FILE", help="what `noslip simulate --record` wrote, or a board's record in that form")
    parser.add_argument(
        "--backend", choices=("cf", *ON_TARGET), default="cf", help="where: this host (cf, the default), Cortex-M4F or RV32"
    )
    parser.add_argument("--trust", action="store_true", help="run the robot's file that FILE names, which is code")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """The command."""
    from ..controllers.pil import replay_session

    record = read_record(args.record, args.trust)
    session = replay_session(record.law, args.backend)
    try:
        difference = first_difference(record, session, args.backend)
    finally:
        session.close()
    print(f"{args.record}: {difference or f'{len(record.calls)} calls, the same bits on {args.backend}'}")
    return int(difference is not None)
