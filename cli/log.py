"""`noslip log` and `noslip view`: a serial dump of telemetry, or a bag of ROS, as a table and as a plot;
a table as a plot."""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..readers.errors import BadInput, check_named, naming
from ..readers.files import check_targets, write_whole
from .commands import refuse_given, show
from .robot.identify import add_map, columns

if TYPE_CHECKING:
    from ..readers.tables import Column
    from ..simulation.run import Run
    from ..simulation.specification.spec import Spec
    from ..simulation.telemetry.dump import Dump, Start
    from ..simulation.telemetry.vehicle import FollowerInC

EXAMPLE_OF_LOG = """examples:
  make -C firmware run TARGET=cortex-m4f TELEMETRY=/tmp/run.dump
  noslip log /tmp/run.dump -o run.csv
  noslip log /tmp/run.dump -o run.mcap     for PlotJuggler or Foxglove
  noslip log run.bag --map theta_r=/joint_states:right_wheel.position \\
    --map phi=/odom:pose.pose.orientation -o run.csv"""
EXAMPLE_OF_VIEW = """examples:
  noslip view /tmp/run.dump -o run.png
  noslip view run.parquet --spec run.toml -o run.png"""


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add `noslip log` and `noslip view`."""
    parser = subparsers.add_parser(
        "log",
        help="turn a serial dump of telemetry, or a bag of ROS, into CSV, Parquet or MCAP",
        description="Write the ticks in a dump of noslip_telemetry.h as a table with the columns of `noslip "
        "simulate`: pose from dead reckoning, angles and filtered rates of the wheels, torques, "
        "outputs, commands, status. Damaged frames, missing records and restarts are counted. Or "
        "write fields of a bag of ROS 1 or 2 as the columns that --map names, at the times of "
        "the first one's topic; those of other topics are interpolated.",
        epilog=EXAMPLE_OF_LOG,
    )
    parser.add_argument(
        "-o", "--output", metavar="LOG", required=True, help="LOG.csv, LOG.parquet or LOG.mcap"
    )
    _add_dump(parser, "bytes as they came from the line, or a bag: .bag, .db3, .mcap, a folder of rosbag2")
    parser.set_defaults(run=run)
    parser = subparsers.add_parser(
        "view",
        help="plot a serial dump of telemetry, or a table of a run, as a run",
        description="Draw the ticks in a dump of noslip_telemetry.h as `noslip simulate --plot` draws a run; "
        "or the rows of a table (CSV, Parquet, MCAP, a bag of ROS) of `noslip log` or `noslip "
        "simulate`, with the SPEC that says robot, law and path.",
        epilog=EXAMPLE_OF_VIEW,
    )
    parser.add_argument(
        "-o", "--output", metavar="RUN.png", required=True, help="picture: .png, .svg or .pdf"
    )
    parser.add_argument(
        "--spec", metavar="SPEC", help="of a table: what robot, law and path its rows belong to"
    )
    _add_dump(parser, "bytes as they came from the line, or a table: .csv, .parquet, .mcap, a bag of ROS")
    parser.set_defaults(run=run_view)


def add_start(parser: argparse.ArgumentParser) -> None:
    """Add what selects the ticks of a dump."""
    parser.add_argument(
        "--robot", metavar="ROBOT", help="path/to/file.py:name, if the robot is not a shipped one"
    )
    parser.add_argument(
        "--start", type=int, metavar="K", help="the ticks from the K-th start of the vehicle on, from 1"
    )


def _add_dump(parser: argparse.ArgumentParser, what: str) -> None:
    parser.add_argument("dump", metavar="DUMP", help=what)
    add_start(parser)
    add_map(parser)


def run(args: argparse.Namespace) -> int:
    """Run `noslip log`. Return 0. Raises BadInput, OSError."""
    from ..readers.bags import is_bag
    from ..readers.tables import check_format, table_bytes
    from ..simulation.telemetry.run import table

    check_targets([args.output], inputs=[args.dump])
    check_format(args.output)
    if is_bag(args.dump):
        return _log_bag(args)
    dump, start, vehicle, ticks = _read(args)
    columns = table(start, ticks)
    about = {
        "robot": vehicle.law.system.mechanism.name,
        "law": vehicle.law.name,
        "remarks": "; ".join(remarks(dump, start)),
    }
    write_whole(
        args.output, table_bytes(columns, Path(args.output).suffix.lower(), f"/{about['robot']}", about)
    )
    _show(args, dump, start, ticks)
    return 0


def _log_bag(args: argparse.Namespace) -> int:
    """Write mapped fields of a bag as a table. Return 0."""
    from ..analysis.identification.log import read_rows
    from ..readers.bags import table_of_log
    from ..readers.robots import find_robot, system_of
    from ..readers.tables import Written, table_bytes

    refuse_given(args, ["start"], f"is for dumps; {args.dump} is a bag")
    mapped = columns(args)
    units: dict[str, str | None] = dict.fromkeys(mapped)
    if args.robot:
        system = system_of(find_robot(args.robot))
        units = {q.name: q.unit for q in (*system.state, *system.mechanism.inputs)}
        for name in mapped:
            check_named(name, ("t", *units), "--map: quantity")
    rows, lines = read_rows(table_of_log(args.dump, (), mapped), units, mapped)
    units["t"] = "s"
    written = [
        Written(name, units[name] or "", mapped.get(name, "time"), values) for name, values in rows.items()
    ]
    about = {"bag": args.dump, "remarks": "; ".join(lines)}
    write_whole(args.output, table_bytes(written, Path(args.output).suffix.lower(), "/bag", about))
    head = f"{args.dump}: {_counted(len(rows['t']), 'row')} of {', '.join(mapped)}"
    values = {"rows": len(rows["t"]), "remarks": list(lines), "files": [args.output]}
    show(args, lambda: "\n  ".join([head, *lines, args.output]), lambda: values, args.output)
    return 0


def run_view(args: argparse.Namespace) -> int:
    """Run `noslip view`. Return 0. Raises BadInput, OSError."""
    from ..readers.bags import is_bag
    from ..simulation.drawing import encoded
    from ..simulation.plot import draw

    check_targets([], [args.output], inputs=[args.dump, *([args.spec] if args.spec else [])])
    if _is_table(args.dump) or is_bag(args.dump):
        return _view_table(args)
    refuse_given(
        args, ["spec"], f"is for tables: {args.dump} is a dump, which says what it belongs to; leave it out"
    )
    dump, start, _, ticks = _read(args)
    write_whole(args.output, encoded(draw(ticks), Path(args.output).suffix[1:]))
    _show(args, dump, start, ticks)
    return 0


def _is_table(file: str) -> bool:
    from ..readers.tables import FORMATS

    return Path(file).suffix.lower() in FORMATS


def _view_table(args: argparse.Namespace) -> int:
    """Draw a table as a run of its SPEC. Return 0."""
    from ..model.errors import ModelError
    from ..simulation.drawing import encoded
    from ..simulation.plot import draw
    from ..simulation.specification.vary import read_varied
    from ..simulation.telemetry.table import run_of_table

    refuse_given(args, ("robot", "start"), f"is for dumps; {args.dump} is a table, whose robot --spec says")
    if not args.spec:
        raise BadInput(
            f"{args.dump} is a table, which does not say what was followed: give --spec SPEC, or the dump of "
            "bytes"
        )
    spec = read_varied(args.spec, {})
    with naming(args.spec, ModelError):
        table, lines = _columns(args, spec)
        run = run_of_table(table, spec, args.dump)
    write_whole(args.output, encoded(draw(run), Path(args.output).suffix[1:]))
    head = _head(run, "row", run.t[-1] - run.t[0])
    values = {
        "robot": run.law.system.mechanism.name,
        "rows": len(run.t),
        "duration": float(run.t[-1] - run.t[0]),
        "status": str(run.status[-1]),
        **({"remarks": list(lines)} if lines else {}),
        "files": [args.output],
    }
    show(args, lambda: "\n  ".join([head, *lines, args.output]), lambda: values, args.output)
    return 0


def _columns(args: argparse.Namespace, spec: "Spec") -> tuple["Mapping[str, Column]", tuple[str, ...]]:
    """Return the columns of a table or bag, also under the names of --map,
    and remarks on how topics were joined."""
    from ..analysis.identification.log import read_rows
    from ..readers.bags import is_bag, table_of_log
    from ..readers.robots import find_robot, system_of
    from ..readers.tables import Column, picked

    mapped = columns(args)
    table = table_of_log(args.dump, (), mapped)
    found = picked(table, dict.fromkeys(mapped), mapped)
    if len({column.topic for column in found.values()}) < 2 and not is_bag(args.dump):
        return {**table, **found}, ()
    system = system_of(find_robot(spec.robot))
    units: dict[str, str | None] = {q.name: q.unit for q in (*system.state, *system.mechanism.inputs)}
    rows, lines = read_rows(table, {**dict.fromkeys(mapped), **units}, mapped)
    count = range(1, len(rows["t"]) + 1)
    return {
        name: Column(values.tolist(), None, f"{args.dump} {name}", count) for name, values in rows.items()
    }, lines


def _read(args: argparse.Namespace) -> tuple["Dump", "Start", "FollowerInC", "Run"]:
    from ..simulation.telemetry.dump import chosen, read_dump
    from ..simulation.telemetry.run import run_of
    from ..simulation.telemetry.vehicle import vehicle_of

    if _is_table(args.dump):
        raise BadInput(
            f"{args.dump} is a table, not a dump of bytes; `noslip view {args.dump} --spec SPEC -o RUN.png` "
            "draws it"
        )
    dump = read_dump(args.dump)
    start = chosen(dump, args.start, args.dump)
    if not len(start.records):
        raise BadInput(f"{args.dump}: this start has no record of a tick")
    vehicle = vehicle_of(start, args.robot, args.dump)
    return dump, start, vehicle, run_of(start, vehicle, args.dump)


def remarks(dump: "Dump", start: "Start") -> list[str]:
    """Return what is missing in a dump and in one of its starts."""
    lost, missed = start.lost, int(start.records["missed"].sum())
    lines = list(dump.remarks)
    if len(dump.starts) > 1:
        lines.append(f"the vehicle was started {len(dump.starts)} times")
    if lost:
        lines.append(f"{sum(number for _, number in lost)} records are missing in {len(lost)} gaps")
    if missed:
        lines.append(f"the vehicle missed {_counted(missed, 'tick')}")
    return lines


def _counted(number: int, name: str) -> str:
    return f"{number} {name}" if number == 1 else f"{number} {name}s"


def _head(run: "Run", row: str, duration: float) -> str:
    return (
        f"{run.law.system.mechanism.name}: {_counted(len(run.t), row)}, {duration:.9g} s, at the end "
        f"{run.status[-1]}"
    )


def _show(args: argparse.Namespace, dump: "Dump", start: "Start", ticks: "Run") -> None:
    head = _head(ticks, "tick", ticks.t[-1])
    lines = remarks(dump, start)
    values: dict[str, Any] = {
        "robot": ticks.law.system.mechanism.name,
        "ticks": len(ticks.t),
        "duration": float(ticks.t[-1]),
        "status": str(ticks.status[-1]),
        "starts": len(dump.starts),
        "lost": sum(number for _, number in start.lost),
        "remarks": lines,
        "files": [args.output],
    }
    show(args, lambda: "\n  ".join([head, *lines, args.output]), lambda: values, args.output)
