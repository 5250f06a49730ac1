"""Makes a robot file from a URDF, and puts it in place only after its model has been compared with the
URDF."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..errors import BadInput
from ..files import work_folder
from ..robots import find_robot, system_of
from .comparison import check_wheels, compare
from .document import read
from .parts import Layout, Options
from .recognition import recognize
from .text import name_of, robot_file

SAME = 1e-9  # relative: differences of the mass matrix and velocities of rims, of numbers with 12 digits


def import_urdf(file: str, options: Options, folder: Path) -> tuple[str, Mapping[str, Any]]:
    """Return the text of a robot file and what it describes: see `_described`. A temporary file is made in a
    `folder`.

    Raises BadInput for a URDF that cannot be described, ModelError for a robot that the method does not apply
    to.
    """
    layout = recognize(read(file), options)
    text = robot_file(layout)
    name = name_of(layout.document.name)
    with work_folder(folder) as work:
        path = work / "robot.py"
        path.write_text(text, encoding="utf-8")
        system = system_of(find_robot(f"{path}:{name}"))
    difference, slip = compare(system, layout)
    check_wheels(layout)
    if not max(difference, slip or 0.0) <= SAME:
        raise BadInput(
            f"{file}: nothing is written: the robot file differs from the URDF, in the mass matrix by "
            f"{difference:.1e} and in the velocity of a rim by {slip or 0.0:.1e} (relative); please report "
            "this"
        )
    if layout.original:
        difference, _ = compare(system, replace(layout, document=layout.original))
    return text, _described(name, layout, difference, system.mechanism)


def _described(name: str, layout: Layout, difference: float, robot: Any) -> dict[str, Any]:
    """Return name and kind, wheels and castors, notes, parameters,
    and the largest relative difference of the mass matrix."""
    wheels = [wheel for part in layout.parts for wheel in part.wheels]
    return {
        "robot": name,
        "kind": layout.kind,
        "wheels": {
            wheel.joint: {"link": wheel.link, "radius": wheel.radius, "load": layout.shares[wheel.joint]}
            | ({} if wheel.roller is None else {"roller": wheel.roller})
            for wheel in wheels
        },
        "castors": list(layout.castors),
        "supports": {
            name: {"ahead": ahead, "left": left, "load": layout.on_castors[name]}
            for name, place in layout.castors.items()
            for ahead, left in [layout.seen(place, layout.base.origin)]
        },
        "height": sum(part.mass * part.height for part in layout.parts)
        / sum(part.mass for part in layout.parts),
        "steered": [part.joint for part in layout.steered],
        "trailers": [part.joint for part in layout.trailers],
        "arm": [part.joint for part in layout.arm],
        "notes": list(layout.notes),
        "parameters": {
            p.name: {"default": p.default, "unit": p.unit, "about": p.about} for p in robot.parameters
        },
        "mass_matrix_difference": difference,
    }
