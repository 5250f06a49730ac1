"""`noslip laws`: lists the control laws of a robot."""

import argparse

from .commands import show

EXAMPLE = """example:
  noslip laws labmate
  noslip laws path/to/robot.py:cart --json"""


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add `noslip laws`."""
    parser = subparsers.add_parser(
        "laws",
        help="list the control laws of a robot",
        description="List the control laws of a robot: outputs with their units and relative degrees, gains and configuration.",
        epilog=EXAMPLE,
    )
    parser.add_argument("robot", metavar="ROBOT", help="name of a shipped robot or path/to/file.py:name")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run `noslip laws`. Return 0. Raises BadInput, ModelError."""
    from ..readers.errors import BadInput
    from ..readers.robots import find_laws, find_robot, law_of, system_of

    robot = find_robot(args.robot)
    laws = {name: _properties(law_of(robot, name)) for name in find_laws(system_of(robot))}
    if not laws and not args.json:
        raise BadInput(f"{args.robot} has no control law: declare its outputs with output(name, about, rows)")
    show(args, lambda: _table(laws), lambda: laws)
    return 0


def _table(laws: dict) -> str:
    width, lines = max(map(len, laws)), []
    for name, law in laws.items():
        outputs = ", ".join(f"{o['name']} ({o['unit']}, degree {o['relative_degree']})" for o in law["outputs"])
        rest = [f"{kind} {' '.join(law[kind])}" for kind in ("config", "gains") if law[kind]]
        lines.append(f"{name:{width}}  {'; '.join([outputs, *rest])}")
    return "\n".join(lines)


def _properties(law) -> dict:
    degrees = law.linearization.relative_degree
    return {
        "about": law.output.about,
        "outputs": [
            {"name": row.name, "unit": row.unit, "about": row.about, "relative_degree": degree}
            for row, degree in zip(law.output.rows, degrees, strict=True)
        ],
        "config": [q.name for q in law.config],
        "gains": [q.name for q in law.gains],
        "reference": [q.name for q in law.reference],
    }
