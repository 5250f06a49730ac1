"""Composite paths in a file: reads and writes a table for each line or arc."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import astuple
from itertools import pairwise
from typing import Any

import numpy as np

from ...codegen.printing.scalar import Scalar
from ...model.algebra.trigonometry import angle_of
from ...model.segments import Segment
from ...readers import printing
from ...readers.errors import BadInput
from ...readers.reading import (
    Reader,
    Schema,
    angle,
    check_keys,
    flag,
    number,
    of_type,
    one_of,
    point,
    table_of,
)

LENGTH, FROM = number("positive", "m"), point.about("by default where the previous segment ends")
READERS: dict[str, dict[str, Reader]] = {
    "line": {
        "from": FROM,
        "to": point.about("its end"),
        "length": LENGTH.about("instead of from and to: it goes straight on"),
    },
    "arc": {
        "from": FROM,
        "heading": angle.about("direction of travel at its start, by default that of the previous segment"),
        "radius": LENGTH.about("radius of the arc"),
        "angle": number(unit="rad").about("turned, positive to the left; several turns are allowed"),
    },
}
BACKWARD = flag.about("whether it is driven in reverse")
DIGITS = {"double": np.float64, "float": np.float32}
LARGEST_GAP = {"double": 1e-6, "float": 1e-4}  # m, between segments: defaults of noslip_path_init
# rad: a line whose rounded end points determine its heading less accurately is written by its length
SURE = 1e-9


def schema() -> Schema:
    """Return the JSON Schema of a list of segments."""
    kinds = [
        table_of(
            {"kind": one_of(kind).about("kind of segment"), "backward": BACKWARD, **READERS[kind]}, ["kind"]
        )
        for kind in READERS
    ]
    return {"type": "array", "minItems": 1, "items": {"anyOf": kinds}}


def segments_from_tables(tables: Any, where: str) -> list[Segment]:
    """Return segments from tables { kind = "line", from, to } and { kind = "arc", from, heading, radius,
    angle }, m and rad.

    `angle` is positive to the left; `heading` is the direction of travel; `backward = true` for segments
    driven in reverse. After the first, a segment without `from`, or an arc without `heading`, continues the
    previous one (in the opposite direction where `backward` changes); such a line may have a `length` instead
    of `to`. Joins of other segments are not checked. Raises BadInput, counting segments from 1, for anything
    else.
    """
    if not isinstance(tables, list) or not tables:
        raise BadInput(f"{where} = {tables!r} is not a list of lines and arcs")
    segments: list[Segment] = []
    for k, table in enumerate(tables, 1):
        segments.append(_read(table, segments[-1] if segments else None, f"{where} {k}"))
    return segments


def _read(table: Any, before: Segment | None, where: str) -> Segment:
    kind = one_of(*READERS)(of_type(table, dict, where, "a table").get("kind"), f"{where} kind")
    check_keys(table, ["kind", "backward", *READERS[kind]], f"{where} ({kind})")
    entries = {key: read(table[key], f"{where} {key}") for key, read in READERS[kind].items() if key in table}
    backward = flag(table.get("backward", False), f"{where} backward")
    if before is None:
        _need(entries, ["from"] if kind == "line" else ["from", "heading"], f"{where}, the first,")
    x, y, heading = before.end if before else (0.0, 0.0, 0.0)
    if before and before.backward != backward:
        heading += math.pi
    x, y = entries.get("from", (x, y))
    if kind == "arc":
        _need(entries, ["radius", "angle"], where)
        heading, length = entries.get("heading", heading), entries["radius"] * abs(entries["angle"])
        curvature = math.copysign(1 / entries["radius"], entries["angle"])
    else:
        curvature = 0.0
        if "length" in entries:
            if "from" in entries or "to" in entries:
                raise BadInput(
                    f"{where} length is only for a line that continues the previous segment; remove length, "
                    "or from and to"
                )
            length = entries["length"]
        else:
            _need(entries, ["to"], where)
            dx, dy = entries["to"][0] - x, entries["to"][1] - y
            heading, length = angle_of(dy, dx), math.hypot(dx, dy)
    if not (0 < length < math.inf):
        raise BadInput(
            f"{where} has length {length:g} m; remove it" if length == 0 else f"{where} is too long"
        )
    return Segment(x, y, math.remainder(heading, 2 * math.pi), curvature, length, backward)


def _need(entries: Mapping[str, Any], keys: Sequence[str], where: str) -> None:
    for key in keys:
        if key not in entries:
            raise BadInput(f"{where} requires {key}")


def tables(segments: Sequence[Segment]) -> list[dict[str, Any]]:
    """Return tables that segments_from_tables reads back as the same segments, up to rounding."""
    return [_table(segment, first=k == 0) for k, segment in enumerate(segments)]


def _table(segment: Segment, first: bool) -> dict[str, Any]:
    begin, end = [segment.x, segment.y], list(segment.end[:2])
    backward = {"backward": segment.backward}
    if segment.curvature:
        angle = segment.curvature * segment.length
        arc = {
            "from": begin,
            "heading": segment.heading,
            "radius": 1 / abs(segment.curvature),
            "angle": angle,
        }
        return {"kind": "arc", **arc, **backward}
    ulp = math.ulp(max(map(abs, (*begin, *end))))
    if not first and ulp > SURE * segment.length:
        return {"kind": "line", "length": segment.length, **backward}
    return {"kind": "line", "from": begin, "to": end, **backward}


def toml(segments: Sequence[Segment], closed: bool = False) -> str:
    """Return the path as an entry of a SPEC's [output], one segment per line."""
    rows = []
    for table in tables(segments):
        rows.append(f"  {printing.toml(table)},\n")
    return (
        f'path = {{ kind = "composite", {"closed = true, " if closed else ""}segments = '
        f"[\n{''.join(rows)}] }}\n"
    )


def as_json(segments: Sequence[Segment], closed: bool = False) -> str:
    """Return the same path as JSON."""
    path = {"kind": "composite", **({"closed": True} if closed else {}), "segments": tables(segments)}
    return printing.as_json(path) + "\n"


def _rounded(segment: Segment, scalar: Scalar) -> Segment:
    """Return a segment with the numbers that are written."""
    x, y, heading, curvature, length = np.array(astuple(segment)[:5], DIGITS[scalar.real]).tolist()
    return Segment(x, y, heading, curvature, length, segment.backward)


def c_array(segments: Sequence[Segment], scalar: Scalar, origin: Sequence[float] | None = None) -> str:
    """Return the path as a C array of noslip_segment, or of noslip_segment_f; `origin` (x, y), m, is that to
    which it is relative. Raises BadInput if the digits of the scalar leave gaps that noslip_path_init would
    refuse.
    """
    rounded = [_rounded(segment, scalar) for segment in segments]
    for before, after in pairwise(rounded):
        (x, y, _), digit = (
            before.end,
            float(np.spacing(np.array([after.x, after.y], DIGITS[scalar.real])).max()),
        )
        gap = math.hypot(x - after.x, y - after.y) + digit  # its own sums are rounded, too
        if gap > LARGEST_GAP[scalar.real]:
            raise BadInput(
                f"in {scalar.real}, x = {after.x:.9g}, y = {after.y:.9g} m leave a gap of {gap:.2g} m "
                "between segments, more than noslip_path accepts: write the path relative to an origin near "
                f"it, for instance --origin {segments[0].x:.0f} {segments[0].y:.0f}, or in double"
            )
    rows = []
    for segment in segments:
        numbers = {name: getattr(segment, name) for name in ("x", "y", "heading", "curvature", "length")}
        fields = [f".{name} = {scalar.literal(value)}" for name, value in numbers.items()]
        rows.append(f"    {{{', '.join(fields)}, .backward = {int(segment.backward)}}},\n")
    about = "m; heading of travel in rad; curvature in 1/m, positive turns left"
    if origin:
        about += (
            f";\n   x and y are relative to ({origin[0]:.12g}, {origin[1]:.12g}) m: subtract that from "
            "the pose, too"
        )
    return (
        f"/* {about} */\nstatic const {scalar.name('noslip_segment')} path[{len(rows)}] = "
        f"{{\n{''.join(rows)}}};\n"
    )
