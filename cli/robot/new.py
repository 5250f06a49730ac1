"""`noslip new`: writes a commented SPEC of a vehicle from a few numbers."""

import argparse
import math
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ...readers.errors import BadInput, check_named
from ...readers.files import check_ending, check_targets, write_whole
from ..commands import show

EXAMPLE = """examples:
  noslip new agv.toml
  noslip new agv.toml --kind differential track=0.62 wheel_radius=97mm mass=48 counts=4096 speed=0.8 torque=9
  noslip new truck.toml --kind tricycle wheelbase=1.2 wheel_radius=0.12 mass=400"""


@dataclass(frozen=True)
class AskedNumber:
    """A number of a vehicle: its unit, its default, what it is."""

    unit: str
    default: float
    about: str


COMMON = {
    "period": AskedNumber("s", 0.01, "time between two calls of the controller"),
    "deceleration": AskedNumber("m/s^2", 0.4, "with which the vehicle stops at the end of the path"),
}
KINDS: dict[str, dict[str, AskedNumber]] = {
    "differential": {
        "track": AskedNumber("m", 0.5, "distance between the two driven wheels"),
        "wheel_radius": AskedNumber("m", 0.1, "radius of the driven wheels"),
        "mass": AskedNumber("kg", 50.0, "of the whole vehicle"),
        "length": AskedNumber("m", 0.8, "of the body, for its inertia as a uniform box as wide as the track"),
        "ahead": AskedNumber("m", 0.05, "how far the centre of mass is ahead of the axle"),
        "counts": AskedNumber("1", 4096.0, "of an encoder in a turn of a wheel, with gear and quadrature"),
        "torque": AskedNumber("N m", 10.0, "largest torque at a wheel"),
        "speed": AskedNumber("m/s", 0.6, "along the path"),
        **COMMON,
    },
    "car": {
        "wheelbase": AskedNumber("m", 2.6, "distance between the axles"),
        "track": AskedNumber("m", 1.6, "width, for the inertia of the body"),
        "wheel_radius": AskedNumber("m", 0.3, "radius of the driven wheels"),
        "mass": AskedNumber("kg", 1200.0, "of the whole vehicle"),
        "counts": AskedNumber(
            "1", 16384.0, "of the encoders in a turn of a driven wheel, and of the steering angle"
        ),
        "torque": AskedNumber("N m", 900.0, "largest torque at the driven axle"),
        "steering_torque": AskedNumber("N m", 200.0, "largest torque about the steering axis"),
        "speed": AskedNumber("m/s", 3.0, "of the front wheel along the path"),
        **COMMON,
    },
    "tricycle": {
        "wheelbase": AskedNumber("m", 1.0, "distance of the steered wheel from the rear axle"),
        "track": AskedNumber("m", 0.7, "width, for the inertia of the body"),
        "wheel_radius": AskedNumber("m", 0.15, "radius of the steered wheel, which drives"),
        "mass": AskedNumber("kg", 80.0, "of the whole vehicle"),
        "counts": AskedNumber(
            "1", 16384.0, "of the encoders in a turn of the wheel, and of the steering angle"
        ),
        "torque": AskedNumber("N m", 25.0, "largest torque at the wheel"),
        "steering_torque": AskedNumber("N m", 10.0, "largest torque about the steering axis"),
        "speed": AskedNumber("m/s", 0.8, "of the steered wheel along the path"),
        **COMMON,
    },
}
POLE = -1.5  # 1/s, twice: the distance from the path decays without overshoot
START = 1.0  # m/s^2, of a vehicle that starts
SHARE = 0.02  # of the mass, in each wheel


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add `noslip new`."""
    parser = subparsers.add_parser(
        "new",
        help="write a commented SPEC of a vehicle from a few numbers",
        description="Write a SPEC of a vehicle on a path of lines and arcs, from a few numbers (SI, or with "
        "a unit). What is not given is asked for at a terminal; elsewhere, and where the answer "
        "is empty, it has the default that the SPEC states.",
        epilog=EXAMPLE + "\n\n" + "\n".join(_listed(kind) for kind in KINDS),
    )
    parser.mixed = True
    parser.add_argument("file", metavar="FILE.toml", help="the SPEC, a new file")
    parser.add_argument(
        "numbers", metavar="KEY=VALUE", nargs="*", help="numbers of the vehicle, such as track=0.62"
    )
    parser.add_argument(
        "--kind", choices=tuple(KINDS), help="two driven wheels, or a steered one (default: differential)"
    )
    parser.set_defaults(run=run)


def _listed(kind: str) -> str:
    entries = KINDS[kind].items()
    return "\n".join(
        [
            f"{kind}:",
            *(f"  {name:13} {entry.about} ({entry.default:g} {entry.unit})" for name, entry in entries),
        ]
    )


def run(args: argparse.Namespace) -> int:
    """Run `noslip new`. Raises BadInput for unknown keys and wrong numbers, for a file that is there, and for
    numbers of which no run can begin.
    """
    if os.path.lexists(args.file):
        raise BadInput(f"{args.file}: exists; choose another name, or remove it")
    check_ending(args.file, [".toml"], "a SPEC")
    check_targets([args.file])
    asks = sys.stdin is not None and sys.stdin.isatty()
    kind = args.kind or (_asked_kind() if asks else next(iter(KINDS)))
    given = _given(args.numbers, kind)
    values = {}
    for name, entry in KINDS[kind].items():
        values[name] = given[name] if name in given else _asked(name, entry) if asks else entry.default
    text = spec_text(
        kind,
        values,
        {name for name in values if values[name] == KINDS[kind][name].default and name not in given},
    )
    _check(text, args.file)
    write_whole(args.file, text)
    then = f"noslip simulate {args.file} -o run.csv --plot run.png"
    answer = {"file": args.file, "kind": kind, "numbers": values}
    show(args, lambda: f"{args.file}: a {kind} vehicle; next: {then}", lambda: answer)
    return 0


def _given(numbers: Sequence[str], kind: str) -> dict[str, float]:
    """Return the numbers of the command line by key, SI."""
    given: dict[str, float] = {}
    for text in numbers:
        name, sign, value = text.partition("=")
        if not sign:
            raise BadInput(f"{text}: write KEY=VALUE, such as track=0.62")
        if name in given:
            raise BadInput(f"{text}: {name} has a number already")
        check_named(name, KINDS[kind], f"unknown number of a {kind} vehicle")
        given[name] = _number(name, value, KINDS[kind][name])
    return given


def _number(name: str, text: str, entry: AskedNumber) -> float:
    from ...readers.quantities import quantity  # slow to import

    try:
        value = float(quantity(entry.unit)(text))
    except (argparse.ArgumentTypeError, ValueError) as error:
        raise BadInput(
            f"{name} = {text!r}: write a number in {entry.unit}, or a number with a unit"
        ) from error
    if not (math.isfinite(value) and (value > 0 or name == "ahead")):
        raise BadInput(f"{name} = {text}: must be positive, {entry.about}")
    if name == "counts" and value != int(value):
        raise BadInput(f"counts = {text}: must be a whole number, {entry.about}")
    return value


def _typed(question: str) -> str:
    """Return what is typed at a terminal. Raises BadInput where the input ends."""
    try:
        return input(question).strip()
    except EOFError as error:
        raise BadInput("the input ended before all was answered; nothing is written") from error


def _asked_kind() -> str:
    answer = _typed(f"kind ({', '.join(KINDS)}) [{next(iter(KINDS))}]: ") or next(iter(KINDS))
    check_named(answer, KINDS, "unknown kind of vehicle")
    return answer


def _asked(name: str, entry: AskedNumber) -> float:
    """Return the number that is typed; an empty answer is the default."""
    answer = _typed(f"{name}, {entry.about}, in {entry.unit} [{entry.default:g}]: ")
    return _number(name, answer, entry) if answer else entry.default


def spec_text(kind: str, values: Mapping[str, float], assumed: set[str]) -> str:
    """Return a SPEC with a comment for each number; those of `assumed` are defaults, and labelled."""

    def said(name: str) -> str:
        return f"{KINDS[kind][name].about}{', assumed' if name in assumed else ''}"

    v, differential = values, kind == "differential"
    base = v["track"] if differential else v["wheelbase"]
    radius = round(max(2.0 * base, v["speed"] ** 2 / 0.5), 2)  # at most 0.5 m/s^2 to the side
    L = round((0.5 if differential else 0.4) * base, 3)
    kv = round(min(2.0, START / v["speed"]), 3)
    line = round(max(3 * base, 2 * v["speed"]), 2)
    duration = math.ceil(
        (2 * line + math.pi / 2 * radius) / v["speed"] + v["speed"] / v["deceleration"] + 4 / kv + 3
    )
    lines = [
        f"# A {kind} vehicle on a line, an arc and a line. SI units; a number may have another: '62 cm'.",
        "# Numbers that nobody gave are labelled assumed: measure or replace them.",
        f'robot = "{"labmate" if differential else kind}"',
        "",
        "[parameters] # what the controller believes",
    ]
    if differential:
        wheel = SHARE * v["mass"]
        body = v["mass"] - 2 * wheel
        disc = wheel * v["wheel_radius"] ** 2 / 2
        inertia = body * (v["track"] ** 2 + v["length"] ** 2) / 12
        lines += [
            f"b = {v['track'] / 2:.6g} # m, half of the track: {said('track')}",
            f"d = {v['ahead']:.6g} # m, {said('ahead')}",
            f"r = {v['wheel_radius']:.6g} # m, {said('wheel_radius')}",
            f"m_c = {body:.6g} # kg, the mass without the wheels; {said('mass')}",
            f"m_w = {wheel:.6g} # kg, a wheel, assumed: {SHARE:.0%} of the mass",
            f"I_c = {inertia:.6g} # kg m^2, of a uniform box of length {v['length']:g} m and the track's "
            "width, assumed",
            f"I_w = {disc:.6g} # kg m^2, a wheel as a disc, assumed; a motor behind a gear adds to it",
            f"I_m = {disc / 2:.6g} # kg m^2, a wheel about a diameter, assumed",
        ]
    else:
        inertia = v["mass"] * ((1.5 * v["wheelbase"]) ** 2 + v["track"] ** 2) / 12
        lines += [
            f"l = {v['wheelbase']:.6g} # m, {said('wheelbase')}",
            f"r = {v['wheel_radius']:.6g} # m, {said('wheel_radius')}",
            f"m = {v['mass']:.6g} # kg, {said('mass')}",
            f"c = {0.45 * v['wheelbase']:.6g} # m, centre of mass ahead of the rear axle, assumed: 45% of "
            "the wheelbase",
            f"I_c = {inertia:.6g} # kg m^2, of a uniform box of 1.5 times the wheelbase and the width, "
            "assumed",
        ]
    origin = "centre of mass" if differential else "front wheel"
    lines += [
        "",
        "[gains] # of the second-order error of the distance and the first-order error of the speed; see "
        "noslip outer-loop",
        f"kp = {POLE**2:g} # 1/s^2, assumed: both poles at {POLE:g} 1/s, no overshoot",
        f"kd = {-2 * POLE:g} # 1/s",
        f"kv = {kv:g} # 1/s, assumed: from rest at most {START:g} m/s^2",
        "",
        "[output]",
        'type = "IV" # distance from the path, and speed along it',
        f"L = {L:g} # m, how far the point that follows the path is ahead of the {origin}",
        "",
        "[output.path]",
        'kind = "composite" # lines and arcs in the order of travel: put in your own',
        'stop = "axle" # the middle of the axle stops at the end'
        if differential
        else 'stop = "point" # P_l stops at the end',
        "segments = [",
        f'  {{ kind = "line", from = [0.0, 0.0], to = [{line:g}, 0.0] }}, # m',
        f'  {{ kind = "arc", radius = {radius:g}, angle = {math.pi / 2:.6f} }}, # m, rad, positive to the '
        "left",
        f'  {{ kind = "line", length = {line:g} }}, # m',
        "]",
        "",
        "[reference]",
        f"speed = {v['speed']:g} # m/s, {said('speed')}",
        f"deceleration = {v['deceleration']:g} # m/s^2, {said('deceleration')}",
    ]
    if differential:
        lines += [
            "",
            "[initial]",
            f"point = [{L + v['ahead']:g}, 0.05] # m, P_l, 5 cm to the left of the path",
            "heading = 0.0 # rad",
            "speed = 0.0 # m/s",
        ]
    torque = f"torque = {v['torque']:g} # N m, {said('torque')}"
    if not differential:
        torque = (
            f"torque = [{v['torque']:g}, {v['steering_torque']:g}] # N m, {said('torque')}; "
            f"{said('steering_torque')}"
        )
    lines += [
        "",
        "[sensors]",
        f"counts = {v['counts']:g} # {said('counts')}",
        'pose = "reckoned" # the controller knows its pose from the wheels alone',
        "",
        "[limits]",
        torque,
        'mode = "slow" # at a limit the vehicle slows down and stays on the path',
        "",
        "[simulation]",
        f"duration = {duration:g} # s, to the end of the path",
        f"period = {v['period']:g} # s, {said('period')}",
    ]
    return "\n".join(lines) + "\n"


def _check(text: str, name: str) -> None:
    """Raise BadInput if no run of the SPEC can begin."""
    from ...simulation.loop import make_loop  # slow to import
    from ...simulation.specification.spec import spec_of

    make_loop(spec_of(text, name))
