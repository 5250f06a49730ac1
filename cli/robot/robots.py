"""`noslip robots`, `laws` and `stages`: list the shipped robots, the control laws of a robot,
the stages of a loop."""

import argparse

from ..commands import show

EXAMPLE_OF_ROBOTS = """example:
  noslip robots
  noslip laws labmate     the control laws of a robot"""
EXAMPLE_OF_STAGES = """example:
  noslip stages
  noslip stages --json"""
EXAMPLE_OF_LAWS = """example:
  noslip laws labmate
  noslip laws path/to/robot.py:cart --json"""


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add `noslip robots`, `noslip laws` and `noslip stages`."""
    parser = subparsers.add_parser(
        "robots",
        help="list the shipped robots",
        description="List the shipped robots. A robot of your own is a Python file: path/to/file.py:name.",
        epilog=EXAMPLE_OF_ROBOTS,
    )
    parser.set_defaults(run=list_robots)
    parser = subparsers.add_parser(
        "laws",
        help="list the control laws of a robot",
        description="List the control laws of a robot: outputs with their units and relative degrees, gains "
        "and configuration.",
        epilog=EXAMPLE_OF_LAWS,
    )
    parser.add_argument("robot", metavar="ROBOT", help="name of a shipped robot or path/to/file.py:name")
    parser.set_defaults(run=list_laws)
    parser = subparsers.add_parser(
        "stages",
        help="list the stages of a closed loop",
        description="List the stages of a closed loop: sections of a SPEC, signals, columns, and what goes "
        "together and why.",
        epilog=EXAMPLE_OF_STAGES,
    )
    parser.set_defaults(run=list_stages)


def list_robots(args: argparse.Namespace) -> int:
    """Run `noslip robots`. Return 0."""
    from ...model.robots import SHIPPED

    robots = [(name, robot()) for name, robot in SHIPPED.items()]
    show(args, lambda: _robots_table(robots), lambda: [_robot(name, robot) for name, robot in robots])
    return 0


def _robots_table(robots: list) -> str:
    width, lines = max(len(name) for name, _ in robots), []
    for name, robot in robots:
        counts = (
            f"{len(robot.coordinates)} coordinates, {len(robot.constraint_names)} constraints, "
            f"{len(robot.inputs)} inputs"
        )
        lines.append(f"{name:{width}}  {robot.about}; {counts}")
    return "\n".join(lines)


def _robot(name: str, robot) -> dict:
    return {
        "name": name,
        "about": robot.about,
        "coordinates": [q.name for q in robot.coordinates],
        "quasi_velocities": [q.name for q in robot.quasi_velocities],
        "constraints": list(robot.constraint_names),
        "inputs": [q.name for q in robot.inputs],
        "parameters": {
            q.name: {"default": q.default, "unit": q.unit, "about": q.about} for q in robot.parameters
        },
    }


def list_stages(args: argparse.Namespace) -> int:
    """Run `noslip stages`. Return 0."""
    from ...codegen.loop.stages import STAGES

    show(args, lambda: "\n\n".join(map(str, STAGES)), lambda: [stage.as_json() for stage in STAGES])
    return 0


def list_laws(args: argparse.Namespace) -> int:
    """Run `noslip laws`. Return 0. Raises BadInput, ModelError."""
    from ...readers.errors import BadInput
    from ...readers.robots import find_laws, find_robot, law_of, system_of

    robot = find_robot(args.robot)
    laws = {name: _law(law_of(robot, name)) for name in find_laws(system_of(robot))}
    if not laws and not args.json:
        raise BadInput(f"{args.robot} has no control law: declare its outputs with output(name, about, rows)")
    show(args, lambda: _laws_table(laws), lambda: laws)
    return 0


def _laws_table(laws: dict) -> str:
    width, lines = max(map(len, laws)), []
    for name, law in laws.items():
        outputs = ", ".join(
            f"{o['name']} ({o['unit']}, degree {o['relative_degree']})" for o in law["outputs"]
        )
        rest = [f"{kind} {' '.join(law[kind])}" for kind in ("config", "gains") if law[kind]]
        lines.append(f"{name:{width}}  {'; '.join([outputs, *rest])}")
    return "\n".join(lines)


def _law(law) -> dict:
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
