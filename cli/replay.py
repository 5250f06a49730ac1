"""`noslip replay`: repeats recorded calls of a target, or the ticks of a dump,
and compares the results bit by bit."""

import argparse

from ..readers.errors import BadInput
from ..readers.progress import Progress
from ..simulation import replay
from ..simulation.controllers import ON_TARGET
from ..simulation.replay import first_difference, read_record
from .commands import refuse_given, show
from .log import add_start


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add `noslip replay`."""
    parser = subparsers.add_parser(
        "replay",
        help="repeat recorded calls of a target and compare bits",
        description="Repeat the calls of the generated float C in a record, or the ticks in a dump of "
        "telemetry (noslip_telemetry.h), and compare every bit of the results.\nExit codes: 0 if "
        "all are equal, 1 at the first difference, 2 if the file is not a record of this "
        "model.\n\n" + replay.__doc__.split("\n\n", 1)[1],
        epilog="example:\n  noslip simulate line --set 'simulation.backend=\"m4f\"' -o run.csv --record "
        "run.txt\n  noslip replay run.txt",
    )
    parser.add_argument(
        "record",
        metavar="FILE",
        help="record written by `noslip simulate --record`, or by a board in that format; or dump",
    )
    parser.add_argument(
        "--backend",
        choices=("cf", *ON_TARGET),
        default="cf",
        help="this host (cf, the default), Cortex-M4F or RV32",
    )
    parser.add_argument(
        "--trust",
        action="store_true",
        help="allow to execute the robot file named in FILE, which is Python code",
    )
    add_start(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run `noslip replay`. Return 0 if all bits are equal, else 1. Raises BadInput."""
    if _is_dump(args.record):
        return _replay_dump(args)
    refuse_given(
        args,
        ("start", "robot"),
        f"is for a dump of telemetry; {args.record} is a record, which names its robot",
    )
    from ..simulation.controllers.pil import replay_session

    with Progress() as progress:
        record = read_record(args.record, args.trust, progress)
    session = replay_session(record.law, args.backend)
    try:
        with Progress() as progress:
            difference = first_difference(record, session, args.backend, progress)
    finally:
        session.close()
    values = {
        "file": args.record,
        "backend": args.backend,
        "calls": len(record.calls),
        "difference": difference,
    }
    same = f"{len(record.calls)} calls, the same bits on {args.backend}"
    show(args, lambda: f"{args.record}: {difference or same}", lambda: {"ok": difference is None, **values})
    return int(difference is not None)


def _is_dump(file: str) -> bool:
    """Return whether a file is a dump of telemetry, whose frames end with a byte 0, and not a text."""
    with open(file, "rb") as stream:
        return b"\0" in stream.read(1 << 16)


def _replay_dump(args: argparse.Namespace) -> int:
    from ..simulation.telemetry.dump import chosen, read_dump
    from ..simulation.telemetry.replay import first_different_tick
    from ..simulation.telemetry.vehicle import vehicle_of

    if args.backend != "cf":
        raise BadInput(f"--backend {args.backend}: a dump of telemetry is repeated on this host")
    dump = read_dump(args.record)
    start = chosen(dump, args.start, args.record)
    vehicle = vehicle_of(start, args.robot, args.record)
    with Progress() as progress:
        same, difference = first_different_tick(start, vehicle, args.record, progress)
    values = {
        "file": args.record,
        "backend": args.backend,
        "ticks": same,
        "difference": difference,
        "remarks": dump.remarks,
    }
    lines = [
        f"{args.record}: {same} ticks, the same bits on this host",
        *dump.remarks,
        *([difference] if difference else []),
    ]
    show(args, lambda: "\n  ".join(lines), lambda: {"ok": difference is None, **values})
    return int(difference is not None)
