"""`noslip outer-loop`: designs gains of a law and computes margins,
sampling limits and sensitivity to model errors."""

import argparse
import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..readers.errors import BadInput, check_named, naming
from ..readers.files import check_folder, write_folder
from ..readers.progress import Progress
from ..readers.quantities import in_range, quantity
from ..simulation.controllers import DRIVES
from .commands import refuse_given, rendered

if TYPE_CHECKING:
    from ..analysis.outer.design import Gains
    from ..analysis.outer.drive import DriveLoop
    from ..model.law import ControlLaw
    from ..simulation.specification.spec import Spec

EXAMPLE = """examples:
  noslip outer-loop labmate --output type_iv_circle --period 0.01
  noslip outer-loop labmate --output type_iv_line --settling 4 --damping 1.25 \\
    --period 0.02 --delay --figures build/outer
  noslip outer-loop labmate --output type_iv_line --poles distance=-1,-4 --poles speed=-2 --json
  noslip outer-loop labmate --output type_iv_line --period 0.01 \\
    --drive velocity --bandwidth 5 --drive-delay 0.02
  noslip outer-loop --spec examples/specs/circle.toml --lqr distance=0.1,0.2,0.5 --lqr speed=0.2,0.5
  noslip outer-loop labmate --output type_iv_line --hinf distance=0.1,0.2,0.5,0.3 --period 0.01"""

DESIGNS = ("poles", "discrete_poles", "settling", "lqr", "hinf", "mixed")


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add `noslip outer-loop`."""
    parser = subparsers.add_parser(
        "outer-loop",
        help="design and assess the gains of a law",
        description=(
            "Given or designed gains of each channel of a law; margins, sensitivity, longest sampling "
            "period; the whole loop about its steady motion, and the effect of each model error on it. "
            "VALUES apply to all channels, ROW=VALUES to one."
        ),
        epilog=EXAMPLE,
    )
    parser.add_argument(
        "robot",
        metavar="ROBOT",
        nargs="?",
        help="name of a shipped robot or path/to/file.py:name; with --spec that of the SPEC",
    )
    parser.add_argument("--output", metavar="LAW", help="name of the law, for example type_iv_circle")
    parser.add_argument(
        "--spec", metavar="SPEC.toml", help="take path, reference, gains, parameters and plant from a SPEC"
    )
    parser.add_argument(
        "--L",
        type=quantity("m"),
        metavar="M",
        help="distance of P_l ahead of the vehicle's point, m (default: from SPEC, else 0)",
    )
    parser.add_argument(
        "--speed",
        type=quantity("m/s"),
        metavar="V",
        help="speed of the steady motion, m/s (default: from SPEC, else 1)",
    )
    design = parser.add_argument_group("design")
    for name, metavar, text in (
        (
            "poles",
            "[ROW=]P,P",
            "closed-loop poles, 1/s; as many as the relative degree, one more with --integral",
        ),
        ("discrete-poles", "[ROW=]Z,Z", "poles of the sampled channel; needs --period"),
        ("settling", "[ROW=]S", "settling time to 2 %%, s"),
        (
            "damping",
            "[ROW=]Z",
            "damping ratio for --settling: 1 critically damped (default), larger overdamped",
        ),
        (
            "lqr",
            "[ROW=]E,R,V",
            "LQR by largest error, its derivatives below the relative degree, integral (with --integral), v; "
            "SI units",
        ),
        (
            "observer",
            "[ROW=]L",
            "rate at which a disturbance observer follows, 1/s, besides any design; 0: none",
        ),
        (
            "hinf",
            "[ROW=]E,R,V,D",
            "H-infinity by the same values and the largest disturbance of v, which is below that of v",
        ),
        (
            "mixed",
            "[ROW=]W,WT,M",
            "mixed sensitivity: S small up to W rad/s, T from WT rad/s on, neither above M",
        ),
    ):
        design.add_argument(f"--{name}", metavar=metavar, action="append", default=[], help=text)
    design.add_argument("--integral", action="store_true", help="design integral action too")
    plain = quantity("1")
    sampled = parser.add_argument_group("on a processor")
    period = "sampling period with zero-order hold, s (default: from SPEC, else continuous)"
    sampled.add_argument("--period", type=quantity("s"), metavar="S", help=period)
    delay = "apply the torque one period after the state was measured (default: from SPEC, else at once)"
    sampled.add_argument("--delay", action="store_true", help=delay)
    sampled.add_argument(
        "--drive",
        choices=DRIVES,
        help="what the drives take: torque (default), or velocities that a loop of their own follows",
    )
    sampled.add_argument(
        "--bandwidth", type=quantity("1/s"), metavar="HZ", help="of the drives' own loop (default: from SPEC)"
    )
    sampled.add_argument(
        "--drive-delay",
        type=quantity("s"),
        metavar="S",
        help="dead time of the drives, s (default: from SPEC, else 0)",
    )
    sampled.add_argument(
        "--gain-margin", type=plain, default=6.0, metavar="DB", help="required at the longest period (6)"
    )
    sampled.add_argument(
        "--phase-margin", type=plain, default=45.0, metavar="DEG", help="required at the longest period (45)"
    )
    sampled.add_argument(
        "--peak", type=plain, default=2.0, metavar="MS", help="largest peak of the sensitivity there (2)"
    )
    parser.add_argument(
        "--wrong",
        type=plain,
        default=0.2,
        metavar="PART",
        help="relative error of each parameter (0.2: 20 %%)",
    )
    parser.add_argument(
        "--search", action="store_true", help="search all errors up to --wrong for the worst combination"
    )
    parser.add_argument(
        "--figures", metavar="DIR", help="write Bode, Nyquist, step and eigenvalue plots into a folder"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run `noslip outer-loop`. Raises BadInput for unknown names, unstable designs,
    and periods that are zero or too long."""
    from numpy.linalg import LinAlgError

    from ..analysis.outer.channel import Required
    from ..analysis.outer.report import OuterLoopReport
    from ..analysis.outer.robustness import Loops
    from ..readers.reading import number, positive

    law, spec = _law_and_spec(args)
    if args.period is None and args.spec and spec.simulation.period:
        args.period = spec.simulation.period
    args.delay = args.delay or _is_late(args.spec, spec)
    drive = _drive(args, spec)
    if drive and law.extension:
        raise BadInput(
            f"{law.name} has a dynamic extension, which does not go with {drive}; leave out --drive"
        )
    if args.period is not None:
        positive("period", args.period, "--period")
    else:
        refuse_given(args, ("delay", "discrete_poles"), "needs --period")
    number("positive", below=1.0)(args.wrong, "--wrong")
    required = Required(
        gain=10 ** (number("positive", most=1000.0)(args.gain_margin, "--gain-margin") / 20),
        phase=math.radians(positive("phase margin", args.phase_margin, "--phase-margin")),
        Ms=positive("peak", args.peak, "--peak"),
    )
    if args.figures:
        check_folder(args.figures)
    pictures = {}
    problem = "outer-loop: gains, speeds or lengths are too far apart to be computed with"
    with naming(problem, LinAlgError, "choose some that are nearer to 1 in SI units"), Progress() as progress:
        gains, sizes = _gains(args, law, spec), _sizes(args, law)
        loops, more = (
            Loops(args.period, args.delay, drive),
            (required, args.wrong, progress, sizes, args.search),
        )
        report = OuterLoopReport(law, spec, gains, loops, *more)
        if args.figures:
            from ..analysis.outer.pictures import pictures_of

            pictures = pictures_of(report)
        result = rendered(args, report.text, report.as_json)
    if pictures:
        folder = Path(args.figures)
        write_folder(folder, pictures)
        result += "" if args.json else "\n\n" + "\n".join(str(folder / name) for name in pictures)
    print(result)
    return 0


def _called(spec: "Spec", period: float | None) -> "Spec":
    """Return the SPEC with its controller called at a period (s), if it has none of its own."""
    if period is None or spec.simulation.period or not period > 0:
        return spec
    return replace(spec, simulation=replace(spec.simulation, period=period))


def _is_late(file: str | None, spec: "Spec") -> bool:
    """Return whether the inputs of the SPEC act one period late. Raises BadInput if they act in between."""
    delay, period = spec.simulation.delay, spec.simulation.period
    if 0 < delay < period:
        raise BadInput(
            f"{file}: [simulation] delay = {delay:g} is a part of the period, {period:g} s; margins are "
            "those of no delay or of a whole period: give --delay for the latter, or another delay in the "
            "SPEC"
        )
    return delay > 0


def _drive(args: argparse.Namespace, spec: "Spec") -> "DriveLoop | None":
    """Return the drives of the options, else those of the SPEC; None if they take torque."""
    from ..analysis.outer.drive import DriveLoop

    own = spec.drive
    kind = args.drive or (own.kind if own else "torque")
    if spec.kinematic != (kind == "kinematic"):
        raise BadInput(
            f"--drive {kind} does not fit {spec.law}: a kinematic law goes with --drive kinematic, and no "
            "other does"
        )
    if kind == "torque":
        refuse_given(
            args, ("bandwidth", "drive_delay"), "requires --drive velocity, velocity+torque or kinematic"
        )
        return None
    bandwidth = args.bandwidth if args.bandwidth is not None else own.bandwidth if own else None
    if bandwidth is None:
        raise BadInput(f"--drive {kind} requires --bandwidth HZ, that of the drives' own loop")
    delay = args.drive_delay if args.drive_delay is not None else own.delay if own else 0.0
    return DriveLoop(2 * math.pi * bandwidth, delay, kind == "velocity+torque", kind == "kinematic")


def _law_and_spec(args: argparse.Namespace) -> tuple["ControlLaw", "Spec"]:
    from ..analysis.outer.setting import BANDWIDTH, SPEED, as_kinematic, default_spec, on_tightest, with_speed
    from ..codegen.loop.stages import check
    from ..model.names import KINEMATIC, without_kinematic
    from ..readers.reading import number
    from ..readers.robots import find_robot, law_of
    from ..simulation.loop import make_loop
    from ..simulation.specification.vary import read_varied

    if args.speed is not None and not number()(args.speed, "--speed"):
        raise BadInput("--speed must not be zero: the steady motion is along the path")
    if args.spec is None:
        if args.output is None or args.robot is None:
            raise BadInput(
                f"outer-loop needs {'' if args.robot else 'ROBOT and '}--output LAW or --spec SPEC.toml"
            )
        kinematic = args.drive == "kinematic" and without_kinematic(args.output) == args.output
        law = law_of(find_robot(args.robot), args.output + KINEMATIC * kinematic)
        spec = default_spec(args.robot, law, SPEED if args.speed is None else args.speed)
        return law, _placed(_called(spec, args.period), args.L)
    model = {"simulation.backend": "casadi"}
    try:
        whole = read_varied(args.spec, model)
    except BadInput:  # it may need a period
        if args.period is None:
            raise
        whole = read_varied(args.spec, {**model, "simulation.period": args.period})
    spec = on_tightest(whole)
    if spec is not whole:
        print(f"{args.spec}: the steady motion is that on the tightest segment of the path", file=sys.stderr)
    spec = _called(spec, args.period)
    with naming(args.spec):
        check(spec, "noslip outer-loop")
    for option, value, own in (("ROBOT", args.robot, spec.robot), ("--output", args.output, spec.law)):
        if value is not None and value != own:
            raise BadInput(f"{args.spec}: the SPEC has {own}, but {option} is {value}")
    if args.drive == "kinematic" and not spec.kinematic:
        spec = as_kinematic(replace(spec, drive=None), args.bandwidth or BANDWIDTH)
    law = law_of(find_robot(spec.robot), spec.law)
    with naming(args.spec):
        make_loop(spec)  # refuses what `noslip simulate` refuses
    return law, _placed(spec if args.speed is None else with_speed(spec, args.speed), args.L)


def _placed(spec: "Spec", L: float | None) -> "Spec":
    """Return the SPEC with another L (m). Raises BadInput if L is not finite."""
    from ..readers.reading import number

    if L is None:
        return spec
    return replace(spec, output=replace(spec.output, L=number()(L, "--L")))


def _gains(args: argparse.Namespace, law: "ControlLaw", spec: "Spec") -> dict[str, "Gains"]:
    """Return the gains of each row: designed if an option requests it, else those of the SPEC,
    else the defaults of the law."""
    from ..analysis.outer.design import (
        from_discrete_poles,
        from_hinf,
        from_lqr,
        from_poles,
        from_settling,
        gains_of,
    )
    from ..analysis.outer.weighted import Weights, from_mixed
    from ..model.law import gain_names
    from ..simulation.specification.cases import gain_entries, integral_entries, observer_entries

    own = gain_entries(law, spec.gains, "gains") | integral_entries(law, spec.gains)
    values = {gain.name: gain.default for gain in law.gains} | own
    degrees = _degrees(law)
    rows = list(degrees)
    options = (*DESIGNS, "damping", "observer")
    requested = {name: _by_row(getattr(args, name), rows, f"--{name.replace('_', '-')}") for name in options}
    observers = observer_entries(law, spec.gains)
    gains = {}
    for row, degree in degrees.items():
        ways = [name for name in DESIGNS if row in requested[name]]
        if len(ways) > 1:
            raise BadInput(
                f"{row}: --{ways[0].replace('_', '-')} and --{ways[1].replace('_', '-')}; choose one"
            )
        if row in requested["damping"] and ways != ["settling"]:
            raise BadInput(f"{row}: --damping requires --settling")
        numbers = {name: requested[name][row] for name in requested if row in requested[name]}
        if not ways:
            of_errors = [values[f"{name}_{row}"] for name in gain_names(degree)]
            gains[row] = gains_of(degree, of_errors, values.get(f"ki_{row}", 0.0)).check(row)
        elif ways == ["poles"]:
            gains[row] = from_poles(degree, numbers["poles"], args.integral, row)
        elif ways == ["discrete_poles"]:
            gains[row] = from_discrete_poles(
                degree, numbers["discrete_poles"], args.period, args.integral, row
            )
        elif ways == ["lqr"]:
            gains[row] = from_lqr(degree, _real(numbers["lqr"], row), args.integral, args.period, row)
        elif ways == ["mixed"]:
            if len(weights := _real(numbers["mixed"], row)) != 3:
                raise BadInput(
                    f"{row}: --mixed takes the band of S, the roll-off of T and the largest peak of both"
                )
            gains[row] = from_mixed(degree, Weights(*weights), args.integral, row)[0]
        elif ways == ["hinf"]:
            gains[row] = from_hinf(degree, _real(numbers["hinf"], row), args.integral, args.period, row)
        else:
            settling, damping = (
                _one(numbers.get(name, [1.0]), name, row) for name in ("settling", "damping")
            )
            gains[row] = from_settling(degree, settling, damping, args.integral, row)
        ko = _one(requested["observer"].get(row, [observers.get(f"ko_{row}", 0.0)]), "observer", row)
        gains[row] = replace(gains[row], observer=ko).check(row)
    if not any(requested[name] for name in DESIGNS):
        designs = "--poles, --discrete-poles, --settling, --lqr, --hinf or --mixed"
        refuse_given(args, ["integral"], f"requires a design: {designs}")
    return gains


def _degrees(law: "ControlLaw") -> dict[str, int]:
    """Return the relative degrees by row, without rows that a kinematic law commands as they are."""
    each = zip(law.output.rows, law.linearization.relative_degree, strict=True)
    return {row.name: degree for row, degree in each if degree}


def _sizes(args: argparse.Namespace, law: "ControlLaw") -> dict[str, list[float]]:
    """Return the largest values of an H-infinity design by row."""
    return {
        row: _real(numbers, row) for row, numbers in _by_row(args.hinf, list(_degrees(law)), "--hinf").items()
    }


def _by_row(texts: Sequence[str], rows: Sequence[str], option: str) -> dict[str, list[complex]]:
    """Return the numbers of an option by row. VALUES apply to all rows;
    ROW=VALUES takes precedence for one row."""
    general: dict[str, list[complex]] = {}
    special: dict[str, list[complex]] = {}
    for text in texts:
        row, equals, values = text.rpartition("=")
        if equals:
            check_named(row, rows, f"{option} {text}: unknown output")
        try:
            numbers = [complex(value) for value in values.split(",")]
        except ValueError as error:
            raise BadInput(
                f"{option} {text}: {values!r} are not numbers separated by commas, such as -1,-4 or "
                "-1+2j,-1-2j"
            ) from error
        special.update({row: numbers} if equals else {})
        for number in numbers:
            if math.isfinite(abs(number)) and not in_range(abs(number)):
                raise BadInput(f"{option} {text}: {abs(number):g} is out of range")
        general.update({} if equals else {name: numbers for name in rows})
    return general | special


def _real(numbers: Sequence[complex], row: str) -> list[float]:
    for number in numbers:
        if number.imag:
            raise BadInput(f"{row}: {number} must be real")
    return [number.real for number in numbers]


def _one(numbers: Sequence[complex], name: str, row: str) -> float:
    if len(numbers) != 1:
        raise BadInput(f"{row}: --{name} takes one number, not {len(numbers)}")
    return _real(numbers, row)[0]
