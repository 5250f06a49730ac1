"""Files of points, and of the courses that were fitted to them."""

import json
import math
import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...readers.errors import BadInput, naming
from ...readers.files import check_ending, read_input
from ...readers.reading import MOST_ANGLE
from ...readers.tables import Column, listed, picked, read_table
from .course import SmoothCurve

GLOBE = re.compile(r"lat(itude)?|lon(g|gitude)?|lng", re.IGNORECASE)
TOLERANCE = 0.01  # m: of a course that is fitted to the points of a file


def reference_of(course: SmoothCurve) -> dict[str, Any]:
    """Return the [reference] of a SPEC that follows a course."""
    names = ("speed", "heading", "lengths", "curvatures", *(["rounding"] if course.rounding else []))
    table = {name: list(v) if isinstance(v := getattr(course, name), tuple) else v for name in names}
    return {"position": [course.x, course.y], "course": table | {"follow": "path"}}


def read_reference(file: str | Path) -> dict[str, Any]:
    """Return `position` and `course` of a SPEC's [reference] from a file: .json or .toml as
    `noslip plan course` writes it, or .csv with points, to which a course is fitted within TOLERANCE, at 1
    m/s. Raises BadInput, naming the file.
    """
    kind = Path(file).suffix.lower()
    if kind == ".csv":
        from .smooth import fit_course  # slow to import

        read_points = read_waypoints(file)
        with naming(file):
            return reference_of(fit_course(read_points.points, TOLERANCE, headings=read_points.headings))
    check_ending(file, [".json", ".toml", ".csv"], "a course")
    read = {".json": json.loads, ".toml": tomllib.loads}[kind]
    with (
        naming(file, OSError, "check the path"),
        naming(f"{file}: not {kind[1:].upper()}", (ValueError, RecursionError)),
    ):
        whole = read(read_input(file).decode("utf-8-sig"))
    found = whole.get("reference") if isinstance(whole, dict) else None
    if (
        not isinstance(found, dict)
        or set(found) != {"position", "course"}
        or not isinstance(found["course"], dict)
    ):
        raise BadInput(
            f"{file} has no [reference] with position and course; noslip plan course writes such a file"
        )
    return found


@dataclass(frozen=True)
class Waypoints:
    """Points (x, y) in m and headings in rad, None where there is none; `remarks`:
    what of the file was not used."""

    points: list[tuple[float, float]]
    headings: list[float | None]
    remarks: list[str]


def read_waypoints(file: str | Path, degrees: bool = False, columns: Sequence[str] = ()) -> Waypoints:
    """Return the waypoints of a table with columns x, y and, optionally, heading; without a header it has x
    and y only.

    `degrees`: of headings without a unit; `columns`: names that replace the header. Raises BadInput naming
    the row.
    """
    with naming(file, OSError, "check the path"):
        table = read_table(file, columns, incomplete=True)
    plain = {"x": "1", "y": "2"} if not table.header and len(table) == 2 else {}
    found = picked(table, {"x": "m", "y": "m", "heading": "rad"}, plain)
    if globe := [name for name in table if GLOBE.fullmatch(name)]:
        project = "project them to x and y in m, for instance by UTM"
        raise BadInput(f"{file}: {' and '.join(globe)} are angles on the globe; {project}")
    if "x" not in found or "y" not in found:
        what = f"the columns {listed(table)}" if table.header else f"{len(table)} columns and no header"
        first = ", ".join(str(each.entries[0]) for each in table.values())
        example = ",".join(["x", "y", "heading", *["-"] * len(table)][: max(2, len(table))])
        raise BadInput(
            f"{file} has {what}, in its first row {first}: say which are x and y (m) and, if there is one, "
            f"heading (rad), with - for others, in the first line of the file or by --columns {example}"
        )
    x, y = (found[name].numbers("m").tolist() for name in ("x", "y"))
    for row, *place in zip(found["x"].rows, x, y, strict=True):
        if not all(map(math.isfinite, place)):
            numbers = f"x and y are {place[0]:g} and {place[1]:g}"
            raise BadInput(f"{file} row {row}: {numbers}; give two finite numbers, or delete the row")
    used = {column.where for column in found.values()}
    unused = [name for name, column in table.items() if column.where not in used]
    remarks = [
        *table.remarks,
        *([f"not used: column{'s' * (len(unused) > 1)} {listed(unused)}"] if unused else []),
    ]
    none: list[float | None] = [None] * len(x)
    return Waypoints(
        list(zip(x, y, strict=True)),
        _headings(found["heading"], degrees) if "heading" in found else none,
        remarks,
    )


def _headings(column: Column, degrees: bool) -> list[float | None]:
    """Return headings in rad, None where the entry is empty."""
    if column.unit is None and degrees:
        column = replace(column, unit="deg")
    values = column.numbers("rad").tolist()
    for row, entry, value in zip(column.rows, column.entries, values, strict=True):
        if not math.isfinite(value) and entry not in (None, ""):
            raise BadInput(
                f"{column.where} row {row}: {entry} is not finite; give a heading, or leave the entry empty"
            )
        if abs(value) > MOST_ANGLE and column.unit is None:
            raise BadInput(
                f"{column.where} row {row}: {value:g} rad is more than a turn; did you mean degrees? Say "
                "--degrees, or call the column 'heading [deg]', or 'heading [rad]' if that is meant"
            )
    return [value if math.isfinite(value) else None for value in values]
