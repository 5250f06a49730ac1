"""`noslip robots`: lists the shipped robots."""

import argparse

from .commands import show

EXAMPLE = """example:
  noslip robots
  noslip laws labmate     the control laws of a robot"""


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Add `noslip robots`."""
    parser = subparsers.add_parser(
        "robots",
        help="list the shipped robots",
        description="List the shipped robots. A robot of your own is a Python file: path/to/file.py:name.",
        epilog=EXAMPLE,
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run `noslip robots`. Return 0."""
    from ..model.robots import ROBOTS

    robots = [(name, robot()) for name, robot in ROBOTS.items()]
    show(args, lambda: _table(robots), lambda: [_properties(name, robot) for name, robot in robots])
    return 0


def _table(robots: list) -> str:
    width, lines = max(len(name) for name, _ in robots), []
    for name, robot in robots:
        counts = f"{len(robot.coordinates)} coordinates, {len(robot.constraint_names)} constraints, {len(robot.inputs)} inputs"
        lines.append(f"{name:{width}}  {robot.about}; {counts}")
    return "\n".join(lines)


def _properties(name: str, robot) -> dict:
    return {
        "name": name,
        "about": robot.about,
        "coordinates": [q.name for q in robot.coordinates],
        "quasi_velocities": [q.name for q in robot.quasi_velocities],
        "constraints": list(robot.constraint_names),
        "inputs": [q.name for q in robot.inputs],
        "parameters": {q.name: {"default": q.default, "unit": q.unit, "about": q.about} for q in robot.parameters},
    }
