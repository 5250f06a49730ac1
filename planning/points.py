"""Files of points, and of the courses that were fitted to them."""

import csv
import io
import json
import math
import tomllib
from pathlib import Path
from typing import Any

from ..readers.errors import BadInput
from ..readers.files import read_input
from .course import SmoothCurve

TOLERANCE = 0.01  # m: of a course that is fitted to the points of a file


def reference_of(course: SmoothCurve) -> dict[str, Any]:
    """Return the [reference] of a SPEC that follows a course."""
    names = ("speed", "heading", "lengths", "curvatures", *(["rounding"] if course.rounding else []))
    table = {name: list(v) if isinstance(v := getattr(course, name), tuple) else v for name in names}
    return {"position": [course.x, course.y], "course": table | {"follow": "path"}}


def read_reference(file: str | Path) -> dict[str, Any]:
    """Return `position` and `course` of a SPEC's [reference] from a file: .json or .toml as `noslip plan course` writes it, or
    .csv with points, to which a course is fitted within TOLERANCE, at 1 m/s. Raises BadInput, naming the file.
    """
    kind = Path(file).suffix
    if kind == ".csv":
        from .smooth import fit_course  # slow to import

        points, headings = read_waypoints(file)
        try:
            return reference_of(fit_course(points, TOLERANCE, headings=headings))
        except BadInput as error:
            raise BadInput(f"{file}: {error}") from error
    read = {".json": json.loads, ".toml": tomllib.loads}.get(kind)
    if read is None:
        raise BadInput(f"{file}: a course is read from .json, .toml or .csv; see noslip plan course --help")
    try:
        whole = read(read_input(file).decode("utf-8-sig"))
    except OSError as error:
        raise BadInput(f"{file}: {error.strerror}; check the path") from error
    except (ValueError, RecursionError) as error:
        raise BadInput(f"{file}: not {kind[1:].upper()}: {error}") from error
    found = whole.get("reference") if isinstance(whole, dict) else None
    if not isinstance(found, dict) or set(found) != {"position", "course"} or not isinstance(found["course"], dict):
        raise BadInput(f"{file} has no [reference] with position and course; noslip plan course writes such a file")
    return found


def read_waypoints(file: str | Path, degrees: bool = False) -> tuple[list[tuple[float, float]], list[float | None]]:
    """Return waypoints (x, y) in m and headings in rad, None where the file has none. Raises BadInput naming the line."""
    points: list[tuple[float, float]] = []
    headings: list[float | None] = []
    try:
        text = read_input(file).decode("utf-8-sig")  # spreadsheet programs write a byte order mark
        rows = csv.reader(io.StringIO(text, newline=""), skipinitialspace=True)
        for row in rows:
            cells = [cell.strip() for cell in row]
            if not any(cells) or cells[0].startswith("#"):
                continue
            if not points and cells in (["x", "y"], ["x", "y", "heading"]):
                continue
            numbers = _numbers(cells, f"{file} line {rows.line_num}")
            points.append(numbers[:2])
            headings.append(math.radians(numbers[2]) if degrees and numbers[2] is not None else numbers[2])
    except OSError as error:
        raise BadInput(f"{file}: {error.strerror}; check the path") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise BadInput(f"{file}: not a table of numbers: {error}") from error
    return points, headings


def _numbers(cells: list[str], where: str) -> tuple[float, float, float | None]:
    if len(cells) not in (2, 3):
        raise BadInput(f"{where} has {len(cells)} entries; give x, y or x, y, heading")
    if not cells[-1]:
        cells = cells[:-1]
    try:
        x, y, *heading = map(float, cells)
    except ValueError as error:
        raise BadInput(f"{where}: {', '.join(cells)} is not x, y or x, y, heading in numbers") from error
    return x, y, heading[0] if heading else None
