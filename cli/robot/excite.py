"""`noslip excite`: a manoeuvre whose log shows the parameters of a vehicle."""

import argparse
from typing import TYPE_CHECKING, Any

from ...readers.errors import BadInput
from ...readers.files import check_targets
from ..commands import show

if TYPE_CHECKING:
    from ...analysis.identification.excitation import Manoeuvre

EXAMPLE = """example:
  noslip excite line --fit m_c I_c --room 6 -o eight.toml
  noslip simulate eight.toml -o eight.csv --plot eight.png"""


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add `noslip excite`."""
    parser = subparsers.add_parser(
        "excite",
        help="find a manoeuvre whose log shows the parameters of a vehicle",
        description=(
            "Simulate figures of eight of different size and speed with the law, limits and floor of a SPEC, "
            "and write the SPEC of the one whose log determines the parameters best (D-optimal), with the "
            "standard deviations to expect from `noslip identify`. Manoeuvres that would slip, exceed the "
            "limits or leave the room do not count."
        ),
        epilog=EXAMPLE,
    )
    parser.add_argument("spec", metavar="SPEC", help="SPEC.toml of type IV, or the name of a shipped one")
    parser.add_argument("-o", "--output", required=True, metavar="SPEC2", help="the SPEC to write")
    parser.add_argument(
        "--fit", nargs="+", metavar="NAME", help="parameters (default: those that the dynamics determine)"
    )
    parser.add_argument(
        "--room", type=float, default=6.0, metavar="M", help="side of the square to drive in, m (default: 6)"
    )
    parser.add_argument(
        "--speed", type=float, metavar="M/S", help="largest speed, m/s (default: that of the SPEC)"
    )
    parser.add_argument(
        "--noise",
        type=float,
        default=0.02,
        metavar="SD",
        help="standard deviation of the logged quasi-velocities (default: 0.02)",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run `noslip excite`. Return 0. Raises BadInput, ModelError, OSError."""
    from ...analysis.identification.excitation import excite
    from ...analysis.identification.log import check_known
    from ...readers.files import write_whole
    from ...readers.progress import Progress
    from ...readers.reading import number
    from ...readers.robots import find_robot
    from ...simulation.specification.spec import read_spec, read_text, toml_table
    from ...simulation.specification.vary import spec_text

    check_targets([args.output], [], inputs=[args.spec])
    for option, value in (("--room", args.room), ("--noise", args.noise), ("--speed", args.speed)):
        if value is not None:
            number("positive")(value, option)
    spec = read_spec(args.spec)
    if spec.output.type != "IV":
        raise BadInput(
            f'{args.spec}: [output] type = "{spec.output.type}"; excite needs "IV", to follow an eight'
        )
    if spec.reference.profiled and args.speed is None:
        raise BadInput(
            f"{args.spec}: [reference] speed follows a profile; excite needs --speed, the largest in m/s"
        )
    for name in args.fit or ():
        check_known("--fit", name, "parameter", [p.name for p in find_robot(spec.robot).parameters])
    with Progress() as progress:
        fastest = args.speed or abs(spec.reference.speed or 0.0)
        manoeuvre = excite(
            toml_table(read_text(args.spec)), args.spec, args.fit, args.room, fastest, args.noise, progress
        )
    head = f"# Written by noslip excite: an eight that shows {', '.join(manoeuvre.deviations)}\n\n"
    write_whole(args.output, head + spec_text(manoeuvre.table))
    show(args, lambda: _text(manoeuvre, args), lambda: _values(manoeuvre))
    return 0


def _text(manoeuvre: "Manoeuvre", args: argparse.Namespace) -> str:
    use = "" if manoeuvre.use is None else f", friction use at most {manoeuvre.use:.2f}"
    circle, reference = manoeuvre.run.spec.output.segments[0], manoeuvre.run.spec.reference
    lines = [
        f"eight with circles of {1 / circle.curvature:.4g} m at {reference.speed:g} m/s, "
        f"{manoeuvre.run.t[-1]:.1f} s{use}"
    ]
    lines.append(f"standard deviations to expect, with a noise of {args.noise:g} in each row:")
    units = {p.name: p.unit for p in manoeuvre.run.law.system.mechanism.parameters}
    lines += [f"  {name}: {sd:.2g} {units[name]}" for name, sd in manoeuvre.deviations.items()]
    return "\n".join([*lines, f"  {args.output}"])


def _values(manoeuvre: "Manoeuvre") -> dict[str, Any]:
    return {
        "speed": manoeuvre.run.spec.reference.speed,
        "use": manoeuvre.use,
        "sd": dict(manoeuvre.deviations),
    }
