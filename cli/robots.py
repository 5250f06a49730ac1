"""`noslip robots`: lists the shipped robots."""

import argparse
import json

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
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run `noslip robots`. Return 0."""
    from ..model.robots import ROBOTS

    robots = [(name, robot()) for name, robot in ROBOTS.items()]
    if args.json:
        print(json.dumps([_properties(name, robot) for name, robot in robots], indent=1, ensure_ascii=False))
        return 0
    width = max(len(name) for name, _ in robots)
    for name, robot in robots:
        counts = f"{len(robot.coordinates)} coordinates, {len(robot.constraint_names)} constraints, {len(robot.inputs)} inputs"
        print(f"{name:{width}}  {robot.about}; {counts}")
    return 0


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
