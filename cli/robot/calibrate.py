"""`noslip calibrate`: fits the geometry of a vehicle to a log of its wheel angles and poses."""

import argparse

from ...readers.files import check_targets
from .identify import add_options, columns, fitted_and_set, reduced, show_result

EXAMPLE = """examples:
  noslip simulate circle --set 'plant={r=0.152,b=0.36}' --set simulation.period=0.05 -o run.csv
  noslip calibrate run.csv --robot labmate --fit r b
  noslip calibrate cw.csv ccw.csv --robot labmate --fit r b scale_theta_l   # wheels of different size"""


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add `noslip calibrate`."""
    parser = subparsers.add_parser(
        "calibrate",
        help="fit wheel radii, track and sensors of a vehicle to a log of angles and poses",
        description=(
            "Fit parameters so that the pose that follows from the logged angles of wheels and joints is the "
            "measured one. Poses may be missing in most rows. Besides the robot's parameters there are "
            "scale_ANGLE and zero_ANGLE of each logged angle, offset_x, offset_y and offset_heading of the "
            "pose sensor, and delay. Without --fit, all parameters of the robot are fitted that the motion "
            "of its pose determines. The exit code is 1 if a parameter of --fit is not identified."
        ),
        epilog=EXAMPLE,
    )
    form = "CSV or another text, .parquet, .mcap or a bag of ROS with t, angles and pose, SI units"
    parser.add_argument("logs", metavar="LOG", nargs="+", help=form)
    parser.add_argument("--fit", nargs="+", metavar="NAME", help="parameters to fit, such as r b")
    add_options(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run `noslip calibrate`. Return 0, or 1 if a parameter is not identified. Raises BadInput,
    ModelError, OSError."""
    from ...analysis.identification.geometry import calibrate, pose_names, sensor_parameters
    from ...analysis.identification.log import read_poses
    from ...analysis.identification.plausibility import check_sizes
    from ...readers.bags import table_of_log
    from ...readers.progress import Progress
    from ...readers.robots import find_robot

    check_targets([], [args.plot] if args.plot else [], inputs=args.logs)
    robot = find_robot(args.robot)
    system = reduced(robot)
    pose = pose_names(system)
    logs = [
        read_poses(table_of_log(file, args.columns, columns(args)), system, pose, columns(args))
        for file in args.logs
    ]
    own = {p.name for p in robot.parameters}
    values = fitted_and_set(args, (*robot.parameters, *sensor_parameters(logs[0].names)), robot)
    with Progress() as progress:
        result = calibrate(logs, system, args.fit, values, progress)
    check_sizes({name: each for name, each in result.estimates.items() if name in own}, values, logs[0].names)
    head = (
        f"{result.rows} rows; angles {', '.join(logs[0].names)}; pose "
        f"{', '.join(name for name, _ in result.outputs)}"
    )
    return show_result(
        args, robot, result, head, ", ".join(f"{name} ({unit})" for name, unit in result.outputs)
    )
