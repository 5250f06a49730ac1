"""`noslip import`: writes a robot file from a URDF or an MJCF."""

import argparse
import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...readers.errors import BadInput
from ...readers.files import check_ending, check_own, check_targets, write_whole
from ...readers.quantities import quantity
from ..commands import show

EXAMPLE = """examples:
  noslip import robot.urdf -o robot.py
  noslip import husky.urdf --skid-steer-track 1.02 -o husky.py
  noslip import robot.urdf --wheels left_joint right_joint \\
    --radius left_wheel=0.1 --radius right_wheel=0.1 -o robot.py"""


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add `noslip import`."""
    parser = subparsers.add_parser(
        "import",
        help="write a robot file from a URDF or an MJCF",
        description="Write a robot file from a URDF or an MJCF: two driven wheels, a car or a tricycle, "
        "trailers behind it, four wheels with rollers. Joints that are not wheels, steering or "
        "hitches are held fixed, but for vertical joints that --arm names. Before the file is "
        "put in place, its mass matrix is compared with that of the links. Requires the extra "
        "`physics`.",
        epilog=EXAMPLE,
    )
    parser.add_argument("urdf", metavar="FILE.urdf", help="a URDF, a xacro file expanded first, or an MJCF")
    parser.add_argument(
        "--wheels",
        nargs="+",
        metavar="JOINT",
        default=[],
        help="the joints of the wheels; default: by their shapes",
    )
    parser.add_argument(
        "--castors",
        nargs="+",
        metavar="NAME",
        default=[],
        help="joints or links of castors, in addition to those found",
    )
    parser.add_argument(
        "--radius", action="append", metavar="LINK=METRES", default=[], help="radius of the wheel of a link"
    )
    parser.add_argument(
        "--rollers",
        action="append",
        metavar="JOINT=ANGLE",
        default=[],
        help="direction of the axis of the roller that touches the ground, from ahead to the left, of a "
        "wheel whose rollers have no joints: 45 deg or -45 deg",
    )
    parser.add_argument(
        "--skid-steer-track",
        type=quantity("m"),
        metavar="METRES",
        help="describe a skid steer by two wheels this far apart",
    )
    parser.add_argument(
        "--arm",
        nargs="+",
        metavar="JOINT",
        default=[],
        help="vertical joints of an arm on the body: they become coordinates with inputs; others are held "
        "fixed",
    )
    parser.add_argument("-o", "--output", metavar="ROBOT.py", required=True, help="the robot file")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run `noslip import`. Return 0. Raises BadInput, ModelError, OSError."""
    from ...readers.reading import by_name, number
    from ...readers.urdf.importing import import_urdf
    from ...readers.urdf.parts import Options

    check_targets([args.output], inputs=[args.urdf])
    if args.output != "-":
        check_ending(args.output, [".py"], "a robot file")
        check_own(Path(args.output))
    rollers = by_name(
        "--rollers", args.rollers, "JOINT=ANGLE, such as front_left='-45 deg'", number(unit="rad")
    )
    if steep := [joint for joint, angle in rollers.items() if not abs(angle) < math.pi / 2]:
        raise BadInput(f"--rollers {steep[0]}: give JOINT=ANGLE between -90 and 90 deg")
    options = Options(
        args.wheels,
        args.castors,
        by_name("--radius", args.radius, "LINK=METRES, such as wheel_left=0.05", number("positive", "m")),
        args.skid_steer_track,
        rollers,
        args.arm,
    )
    text, described = import_urdf(args.urdf, options, Path(args.output).parent)
    write_whole(args.output, text)
    for note in described["notes"]:
        print(f"noslip: {note}", file=sys.stderr)
    show(
        args,
        lambda: _summary(args.output, described),
        lambda: {"file": args.output, **described},
        args.output,
    )
    return 0


def _summary(file: str, described: Mapping[str, Any]) -> str:
    wheels, castors = ", ".join(described["wheels"]), described["supports"]
    carried = sum(castor["load"] for castor in castors.values())
    on_castors = f"castors {', '.join(castors)} carry {carried:.0%}; " if castors else ""
    return (
        f"{file}:{described['robot']}: {described['kind']}; wheels {wheels}; {on_castors}"
        f"centre of mass {described['height']:.3g} m high; "
        f"mass matrix as in the URDF to {described['mass_matrix_difference']:.0e}"
    )
