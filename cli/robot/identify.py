"""`noslip identify`: fits parameters of a robot to a log of its motion and inputs."""

import argparse
import math
from collections.abc import Container, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...readers.errors import BadInput
from ...readers.files import check_targets, write_whole
from ..commands import add_columns, show

if TYPE_CHECKING:
    from ...analysis.identification.result import Identification
    from ...model.mechanism import Mechanism, Quantity
    from ...model.reduction import ReducedSystem

EXAMPLE = """example:
  noslip simulate line --set simulation.period=0.01 -o run.csv
  noslip identify run.csv --robot labmate --fit m_c I_c"""


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add `noslip identify`."""
    parser = subparsers.add_parser(
        "identify",
        help="fit parameters of a robot to a log of its motion and inputs",
        description=(
            "Fit parameters so that the model predicts the logged quasi-velocities from the logged inputs "
            "(output error). States what the motion of this robot, or this log, cannot tell. The exit code "
            "is 1 if a parameter of --fit is not identified."
        ),
        epilog=EXAMPLE,
    )
    form = (
        "CSV or another text, .parquet, .mcap or a bag of ROS with the columns of `noslip simulate`, SI units"
    )
    parser.add_argument("log", metavar="LOG", help=form)
    parser.add_argument(
        "--fit", required=True, nargs="+", metavar="NAME", help="parameters to fit, such as m_c I_c friction"
    )
    add_options(parser)
    parser.add_argument(
        "--drive",
        choices=("torque", "current", "voltage"),
        help="what the log has of each input: a column such as tau_r, current_tau_r or voltage_tau_r "
        "(default: what it has)",
    )
    parser.add_argument(
        "--outputs",
        nargs="+",
        metavar="NAME",
        help="what is compared: quasi-velocities, coordinates, gyro (default: the quasi-velocities, or "
        "angles that give them)",
    )
    parser.add_argument(
        "--inputs",
        choices=("held", "smooth"),
        help="inputs between two rows: constant, or interpolated by splines (default: what fits better)",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run `noslip identify`. Return 0, or 1 if a parameter is not identified. Raises BadInput,
    ModelError, OSError."""
    from ...analysis.identification.dynamics import GYRO, Dynamics, described, usual_outputs
    from ...analysis.identification.fit import identify
    from ...analysis.identification.log import check_known, quantities_in, read_log
    from ...analysis.identification.motors import KINDS, kind_of_inputs, logged_inputs
    from ...readers.bags import table_of_log
    from ...readers.progress import Progress
    from ...readers.robots import find_robot

    check_targets([], [args.plot] if args.plot else [], inputs=[args.log])
    robot = find_robot(args.robot)
    system = reduced(robot)
    values = fitted_and_set(args, described(system), robot)
    table = table_of_log(args.log, args.columns, columns(args))
    inputs = [each for kind in KINDS for each in logged_inputs(system, kind)]
    there = quantities_in(table, [*system.state, *inputs], columns(args))
    for name in args.outputs or ():
        check_known("--outputs", name, "quantity", [*(q.name for q in system.state), GYRO])
    kind = args.drive or kind_of_inputs(system, there)
    dynamics = Dynamics.of(system, kind, args.outputs or usual_outputs(system, there), {*args.fit, *values})
    dynamics.check(args.fit, values)
    log = read_log(table, dynamics, columns(args))
    with Progress() as progress:
        result = identify(
            log, dynamics, args.fit, values, None if args.inputs is None else args.inputs == "held", progress
        )
    held = "constant" if result.inputs == "held" else "smooth"
    head = f"{result.rows} rows, one in {log.interval:.4g} s; inputs: {kind}, {held} between rows"
    outputs = ", ".join(f"{name} ({unit})" for name, unit in result.outputs)
    return show_result(
        args, robot, result, head, f"{outputs}, in parentheses over the rows that were not fitted"
    )


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add what all fits of parameters have in common."""
    parser.add_argument(
        "--robot", required=True, metavar="ROBOT", help="name of a shipped robot or path/to/file.py:name"
    )
    parser.add_argument(
        "--plot",
        metavar="ERRORS.png",
        help="also write a plot of the errors that the fit leaves: .png, .svg, .pdf",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="value of another parameter, SI; may be repeated",
    )
    add_map(parser)
    add_columns(parser, "t,theta_r,theta_l,-")


def add_map(parser: argparse.ArgumentParser) -> None:
    """Add --map, which names columns."""
    parser.add_argument(
        "--map",
        action="append",
        default=[],
        metavar="NAME=COLUMN",
        help="the column of a quantity that has another name, sign or unit: NAME=-COLUMN, 'NAME=COLUMN "
        "[UNIT]', where the unit may have a factor, [turn/4096]; a field of a topic: NAME=TOPIC:FIELD, "
        "for instance theta_r=/joint_states:JOINT.position or phi=/odom:pose.pose.orientation",
    )


def reduced(robot: "Mechanism") -> "ReducedSystem":
    """Return the reduced system. Raises BadInput for a robot with too few inputs, ModelError as `reduce`."""
    from ...readers.robots import system_of

    robot.check()
    inputs, dof = len(robot.inputs), len(robot.coordinates) - robot.A.shape[0]
    if inputs < dof:
        counts = f"{inputs} input{'s' * (inputs != 1)} and {dof} degrees of freedom"
        raise BadInput(
            f"{robot.name}: {counts}; identification does not support robots with fewer inputs than that"
        )
    return system_of(robot)


def fitted_and_set(
    args: argparse.Namespace, parameters: Iterable["Quantity"], robot: "Mechanism"
) -> dict[str, float]:
    """Return the values of --set; check the names of --fit. Raises BadInput, ModelError."""
    from ...analysis.identification.log import check_known
    from ...readers.quantities import check_unit
    from ...readers.reading import by_name, number

    named = {p.name: p for p in parameters}
    single = tuple(f"_{each.name}" for each in robot.inputs)
    own = {p.name for p in robot.parameters}
    # Without those of single motors
    listed = [name for name in named if name in own or not name.endswith(single)]
    values = {}
    for name, value in by_name("--set", args.set, "NAME=VALUE", number()).items():
        check_known("--set", name, "parameter", named, listed)
        check_unit(value, named[name].unit, f"--set {name}")
        values[name] = named[name].check(value, "--set")
    for name in args.fit or ():
        check_known("--fit", name, "parameter", named, listed)
        if args.fit.count(name) > 1:
            raise BadInput(f"--fit: {name} is given twice")
    return values


def columns(args: argparse.Namespace) -> dict[str, str]:
    """Return the columns of --map by the quantity."""
    pairs = [text.partition("=") for text in args.map]
    if missing := [name for name, equals, _ in pairs if not equals]:
        raise BadInput(f"--map {missing[0]}: give NAME=COLUMN")
    return {name: column for name, _, column in pairs}


def show_result(
    args: argparse.Namespace, robot: "Mechanism", result: "Identification", head: str, outputs: str
) -> int:
    """Print a fit and write its plot; `outputs` names the quantities of its errors. Return 0, or 1 if a
    parameter of --fit is not identified.
    """
    if args.plot:
        from ...analysis.identification.drawing import draw
        from ...simulation.drawing import encoded

        write_whole(args.plot, encoded(draw(result), Path(args.plot).suffix[1:]))
    show(
        args,
        lambda: _text(result, {p.name for p in robot.parameters}, head, outputs),
        lambda: _values(result),
    )
    return 0 if set(result.estimates) >= set(args.fit or ()) and result.estimates else 1


def _text(result: "Identification", robot: Container[str], head: str, outputs: str) -> str:
    lines = [head, ""]
    width = max((len(name) for name in result.estimates), default=0)
    for name, each in result.estimates.items():
        unit = "" if each.quantity.unit == "1" else f" {each.quantity.unit}"
        lines.append(f"{name:{width}} = {each.value:.7g}{unit}, within {each.within:.2g} of that with 95 %")
    lines += [f"not identified: {sentence}" for sentence in result.unidentifiable]
    pairs = zip(result.residual, result.validation, strict=True)
    errors = ", ".join(
        f"{fit:.3g}" if math.isnan(other) else f"{fit:.3g} ({other:.3g})" for fit, other in pairs
    )
    lines += ["", f"RMS error of {outputs}: {errors}"]
    lines += [f"note: {remark}" for remark in result.remarks]
    if of_robot := {name: each for name, each in result.estimates.items() if name in robot}:
        values = ", ".join(f"{name} = {each.value:.9g}" for name, each in of_robot.items())
        lines += ["", f"in a SPEC: parameters = {{ {values} }}"]
    return "\n".join(lines)


def _values(result: "Identification") -> dict[str, Any]:
    whole = {"residual": result.residual, "validation": result.validation}
    return {
        "parameters": {
            name: {"value": e.value, "sd": e.sd, "within": e.within, "unit": e.quantity.unit}
            for name, e in result.estimates.items()
        },
        "unidentifiable": list(result.unidentifiable),
        **{
            name: None if math.isnan(each[0]) else math.sqrt(sum(e * e for e in each) / len(each))
            for name, each in whole.items()
        },
        "rows": result.rows,
        **({"inputs": result.inputs} if result.inputs else {}),
        "remarks": list(result.remarks),
    }
