"""`noslip plan`: plans a path of lines and arcs between poses or through waypoints, for a SPEC or as C."""

import argparse
import itertools
import math
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..readers.errors import naming
from ..readers.files import check_targets, write_whole
from ..readers.quantities import Measured, quantity
from .commands import add_columns, refuse_given, show

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..model.segments import Segment
    from ..simulation.planning.course import SmoothCurve

EXAMPLE = """examples:
  noslip plan dubins --from 0 0 0 --to 4 3 1.5708 --radius 1
  noslip plan reeds-shepp --from 0 0 0 --to 0 2 180 --degrees --radius 1.5 --plot path.png
  noslip plan reeds-shepp --from 0 0 0 --to 0 2 180 --degrees --radius 3 \\
    --course 0.5 --speed 0.5 -o course.toml
  noslip plan waypoints points.csv --tolerance 0.05 --c --scalar float -o path.h
  noslip plan course points.csv --tolerance 0.01 --speed 0.5 -o reference.toml"""


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add `noslip plan`."""
    parser = subparsers.add_parser(
        "plan",
        help="plan a path of lines and arcs",
        description="Plan a path of lines and arcs and print it as `path` of a SPEC's [output] (m, rad).",
        epilog=EXAMPLE,
    )
    ways = parser.add_subparsers(metavar="WAY", title="ways", required=True)
    for name, about in (
        ("dubins", "the shortest forward path between two poses"),
        ("reeds-shepp", "the shortest path between two poses, forward and in reverse"),
    ):
        way = ways.add_parser(
            name, help=about, description=f"Plan {about} (x, y in m, heading of the vehicle).", epilog=EXAMPLE
        )
        # argparse of Python < 3.13 takes -1e-3 for an option
        way._negative_number_matcher = re.compile(r"-\.?\d")
        way.add_argument(
            "--from", dest="start", nargs=3, type=quantity(), metavar=("X", "Y", "HEADING"), required=True
        )
        way.add_argument(
            "--to", dest="goal", nargs=3, type=quantity(), metavar=("X", "Y", "HEADING"), required=True
        )
        way.add_argument(
            "--radius", type=quantity("m"), metavar="R", required=True, help="smallest turning radius, m"
        )
        _add_segments(way)
        way.add_argument(
            "--course",
            type=quantity("m"),
            metavar="M",
            help="print a course instead, for the [reference] of a SPEC: its curvature changes over ramps of "
            "this length, m",
        )
        way.add_argument(
            "--speed", type=quantity("m/s"), metavar="V", help="along the course, m/s; default: 1"
        )
        way.set_defaults(way=name, plan=_between_poses)
    way = ways.add_parser(
        "waypoints",
        help="through waypoints",
        description="Plan through waypoints: a smooth curve through them is approximated by few lines and "
        "arcs.",
        epilog=EXAMPLE,
    )
    _add_points(way)
    way.add_argument("--closed", action="store_true", help="return to the first waypoint")
    way.add_argument(
        "--min-radius", type=quantity("m"), metavar="R", help="reject curves with a smaller radius, m"
    )
    _add_segments(way)
    way.set_defaults(way="waypoints", plan=_through_waypoints)
    way = ways.add_parser(
        "course",
        help="a curve of continuous curvature through waypoints",
        description="Fit a course to the smooth curve through waypoints, and print it as the [reference] of "
        "a SPEC (m, rad).",
        epilog=EXAMPLE,
    )
    _add_points(way)
    way.add_argument(
        "--speed", type=quantity("m/s"), metavar="V", default=1.0, help="along it, m/s; default: 1"
    )
    way.add_argument(
        "--rounding",
        type=quantity("m"),
        metavar="M",
        default=0.0,
        help="of lines, arcs and clothoids, m; default: 0, no clothoids",
    )
    _add_common(way)
    way.set_defaults(run=_run_course)


def _add_points(way: argparse.ArgumentParser) -> None:
    about = "rows of x, y (m); with a header that names them also heading (rad) and columns that are not used"
    way.add_argument("points", metavar="POINTS.csv", help=about)
    add_columns(way, "x,y,heading or x,y,-")
    way.add_argument(
        "--origin",
        nargs=2,
        type=quantity("m"),
        metavar=("X", "Y"),
        help="subtract this place from the points: the path is relative to it, m",
    )
    way.add_argument(
        "--tolerance",
        type=quantity("m"),
        metavar="M",
        required=True,
        help="largest distance from the curve, m",
    )


def _add_segments(parser: argparse.ArgumentParser) -> None:
    """Add what the ways of lines and arcs have in common."""
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--c", action="store_true", help="print a C array of noslip_segment")
    form.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--scalar", choices=("double", "float"), help="type of the C array; default: double")
    parser.add_argument(
        "--spec", metavar="SPEC.toml", help="warn if its vehicle cannot follow the path at its speed"
    )
    _add_common(parser)
    parser.set_defaults(run=run, closed=False, remarks=())


def _add_common(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--degrees", action="store_true", help="headings are given in degrees; the output is in rad"
    )
    parser.add_argument(
        "-o", "--output", metavar="FILE", default="-", help="output file; default: standard output"
    )
    parser.add_argument("--plot", metavar="FILE.png", help="also write a plot")


def run(arguments: argparse.Namespace) -> int:
    """Run `noslip plan`. Return 0. Raises BadInput, ModelError, OSError."""
    inputs = [arguments.points] if arguments.way == "waypoints" else []
    inputs += [arguments.spec] if arguments.spec else []
    check_targets([arguments.output], [arguments.plot] if arguments.plot else [], inputs)
    if not arguments.c:
        refuse_given(arguments, ["scalar"], "requires --c")
    segments, waypoints = arguments.plan(arguments)
    if getattr(arguments, "course", None) is not None:
        return _run_between(arguments, segments)
    if "speed" in arguments:
        refuse_given(arguments, ["speed"], "requires --course: lines and arcs have no speed of their own")
    if arguments.spec:
        _warn(arguments.spec, segments, arguments.closed)
    written = _written(segments, arguments)
    about = _summary(segments, arguments.way) + _from_origin(arguments)

    def draw() -> "Figure":
        from ..simulation.planning.picture import draw  # slow to import

        return draw(segments, about, waypoints)

    return _hand_out(arguments, written, draw, about, {"way": arguments.way, **_measures(segments)})


def _hand_out(
    arguments: argparse.Namespace,
    written: str,
    draw: Callable[[], "Figure"],
    about: str,
    measures: dict[str, Any],
) -> int:
    """Write a path and, if desired, its plot, and describe it,
    after what was not used of its file. Return 0."""
    if arguments.plot:
        from ..simulation.drawing import encoded  # slow to import

        drawn = encoded(draw(), Path(arguments.plot).suffix[1:])
    write_whole(arguments.output, written)
    if arguments.plot:
        write_whole(arguments.plot, drawn)
    for remark in arguments.remarks:
        print(f"note: {remark}", file=sys.stderr)
    files = [file for file in (arguments.output, arguments.plot) if file and file != "-"]
    if arguments.output == "-":  # the path itself is printed, as JSON if desired
        print(about, file=sys.stderr)
    else:
        show(arguments, lambda: about, lambda: {**measures, "files": files})
    return 0


def _run_course(arguments: argparse.Namespace) -> int:
    from ..simulation.planning.smooth import fit_course  # slow to import

    check_targets([arguments.output], [arguments.plot] if arguments.plot else [], [arguments.points])
    points, headings = _waypoints(arguments)
    with naming(arguments.points):
        course = fit_course(
            points, arguments.tolerance, arguments.speed, arguments.rounding, headings=headings
        )
    return _hand_out_course(arguments, course, "course", points)


def _run_between(arguments: argparse.Namespace, segments: list["Segment"]) -> int:
    """Run `noslip plan dubins` or `reeds-shepp` with --course. Return 0. Raises BadInput, OSError."""
    from ..simulation.planning.ramps import with_ramps  # slow to import

    refuse_given(arguments, ["c"], "prints lines and arcs; with --course take --json, or nothing")
    speed = 1.0 if arguments.speed is None else arguments.speed
    return _hand_out_course(arguments, with_ramps(segments, arguments.course, speed), arguments.way, [])


def _hand_out_course(
    arguments: argparse.Namespace, course: "SmoothCurve", way: str, points: Sequence[Sequence[float]]
) -> int:
    """Write a course and, if desired, its plot beside points, and describe it. Return 0."""
    from ..readers.printing import as_json, toml
    from ..simulation.planning.points import reference_of  # slow to import

    reference = reference_of(course)
    if arguments.json:
        written = as_json({"reference": reference}) + "\n"
    else:
        written = "[reference]\n" + "".join(f"{name} = {toml(value)}\n" for name, value in reference.items())
    count, length, largest = len(course.lengths), course.way, max(map(abs, course.curvatures))
    about = f"{way}: " if way == "course" else f"{way}, a course: "
    about += f"{_counted(count, 'part')}, {length:.6g} m, "
    about += f"{_counted(course.cusps, 'cusp')}, " if course.cusps else ""
    about += f"largest curvature at their ends {largest:.4g} 1/m{_from_origin(arguments)}"

    def draw() -> "Figure":
        from ..simulation.planning.picture import draw_course  # slow to import

        return draw_course(course, about, points)

    measures = {
        "way": way,
        "parts": count,
        "length": length,
        "cusps": course.cusps,
        "largest_curvature_at_ends": largest,
    }
    return _hand_out(arguments, written, draw, about, measures)


def _between_poses(arguments: argparse.Namespace) -> tuple[list["Segment"], list]:
    from ..simulation.planning import dubins, reeds_shepp  # slow to import

    plan = dubins if arguments.way == "dubins" else reeds_shepp
    start, goal = (
        _pose(*pair, arguments.degrees) for pair in ((arguments.start, "--from"), (arguments.goal, "--to"))
    )
    return plan(start, goal, arguments.radius), []


def _pose(values: list[float], option: str, degrees: bool) -> tuple[float, ...]:
    """Return a pose, m and rad. Raises BadInput for a wrong unit, or a heading of more than a turn in rad."""
    from ..readers.reading import number, point, pose

    x, y, heading = values
    if degrees and not isinstance(heading, Measured):
        return (*point([x, y], option), number()(math.radians(heading), f"{option}[2]"))
    return pose(values, option)


def _waypoints(arguments: argparse.Namespace) -> tuple[list[tuple[float, float]], list[float | None]]:
    """Return the points, relative to --origin, and headings of a file;
    what of it is not used goes to `arguments.remarks`."""
    from ..simulation.planning.points import read_waypoints

    read = read_waypoints(arguments.points, arguments.degrees, arguments.columns)
    arguments.remarks = read.remarks
    x, y = arguments.origin or (0.0, 0.0)
    return [(point[0] - x, point[1] - y) for point in read.points], read.headings


def _through_waypoints(arguments: argparse.Namespace) -> tuple[list["Segment"], list]:
    from ..simulation.planning import fit  # slow to import

    points, headings = _waypoints(arguments)
    with naming(arguments.points):
        return fit(points, arguments.tolerance, headings, arguments.closed, arguments.min_radius), points


def _warn(spec: str, segments: list["Segment"], closed: bool) -> None:
    """Print what a run of a SPEC along a path would warn of. Raises BadInput for one that it cannot
    follow."""
    from ..readers.errors import BadInput
    from ..simulation.loop import make_loop
    from ..simulation.specification.spec import read_spec

    given = read_spec(spec)
    if not (given.output.path and given.output.path.segments):
        raise BadInput(
            f'{spec}: --spec requires [output] path = {{ kind = "composite" }}, which the path takes the '
            "place of"
        )
    path = replace(given.output.path, segments=tuple(segments), closed=closed)
    with naming(spec):
        loop = make_loop(replace(given, output=replace(given.output, path=path), initial=None))
    for warning in loop.warnings:
        print(f"{spec}: warning: {warning}", file=sys.stderr)


def _written(segments: list["Segment"], arguments: argparse.Namespace) -> str:
    from ..codegen.printing.scalar import SCALARS
    from ..simulation.planning import tables

    if arguments.c:
        return tables.c_array(
            segments, SCALARS[arguments.scalar or "double"], getattr(arguments, "origin", None)
        )
    write = tables.as_json if arguments.json else tables.toml
    return write(segments, arguments.closed)


def _from_origin(arguments: argparse.Namespace) -> str:
    origin = getattr(arguments, "origin", None)
    return f", relative to ({origin[0]:.12g}, {origin[1]:.12g}) m" if origin else ""


def _measures(segments: list["Segment"]) -> dict[str, float]:
    """Return number of segments, length (m), number of cusps and smallest radius (m,
    infinite without an arc)."""
    cusps = sum(before.backward != after.backward for before, after in itertools.pairwise(segments))
    tightest = max(abs(segment.curvature) for segment in segments)
    length, radius = sum(s.length for s in segments), 1 / tightest if tightest else math.inf
    return {"segments": len(segments), "length": length, "cusps": cusps, "smallest_radius": radius}


def _summary(segments: list["Segment"], way: str) -> str:
    count, length, cusps, radius = _measures(segments).values()
    parts = [_counted(count, "segment"), f"{length:.6g} m"]
    parts += [_counted(cusps, "cusp")] if cusps else []
    parts += [f"smallest radius {radius:.4g} m"] if math.isfinite(radius) else []
    return f"{way}: {', '.join(parts)}"


def _counted(count: float, noun: str) -> str:
    return f"{count} {noun}{'s' if count > 1 else ''}"
