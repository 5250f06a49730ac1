"""Joins segments to a path, and verifies the result."""

import math
from collections.abc import Iterable, Sequence

from ...model.segments import Segment
from ...readers.errors import BadInput, naming

Pose = tuple[float, float, float]

CLOSE = 1e-9  # m and rad: largest gap in a planned path, and largest error at its goal


def pose(value: Sequence[float], where: str) -> Pose:
    """Return a pose (x m, y m, heading rad). Raises BadInput unless it is three finite numbers."""
    with naming(
        f"{where} = {value!r} is not a pose; give x, y (m) and heading (rad)", (TypeError, ValueError)
    ):
        x, y, heading = (float(number) for number in value)
    if not all(map(math.isfinite, (x, y, heading))):
        raise BadInput(f"{where} = {x:g} {y:g} {heading:g} is not finite")
    return x, y, heading


def joined(start: Pose, pieces: Iterable[tuple[float, float]]) -> list[Segment]:
    """Return consecutive segments from a pose of the vehicle; a piece is (curvature of the vehicle's path,
    signed length).

    1/m, positive to the vehicle's left, and m, negative in reverse.
    """
    segments, (x, y, heading) = [], start
    for curvature, length in pieces:
        backward = length < 0
        travel = math.remainder(heading + math.pi * backward, 2 * math.pi)
        segments.append(
            Segment(x, y, travel, 0.0 - curvature if backward else curvature, abs(length), backward)
        )
        x, y, _ = segments[-1].end
        heading += curvature * length
    return segments


def prove(segments: Sequence[Segment], start: Pose, goal: Pose) -> None:
    """Raise BadInput unless the segments lead the vehicle from pose to pose without a gap or a turn on the
    spot."""
    at = start
    for segment in segments:
        _same(at, _of_vehicle((segment.x, segment.y, segment.heading), segment.backward))
        at = _of_vehicle(segment.end, segment.backward)
    _same(at, goal)


def _of_vehicle(pose: Pose, backward: bool) -> Pose:
    x, y, heading = pose
    return x, y, heading + math.pi * backward


def _same(reached: Pose, goal: Pose) -> None:
    off = math.hypot(reached[0] - goal[0], reached[1] - goal[1])
    turned = math.remainder(reached[2] - goal[2], 2 * math.pi)
    if not (off <= CLOSE and abs(turned) <= CLOSE):
        raise BadInput(
            f"at ({goal[0]:g}, {goal[1]:g}) rounding leaves a gap of {off:.1e} m, {abs(turned):.1e} rad; "
            "choose an origin nearer to the path, headings below a turn, a radius not far beyond the "
            "distances"
        )
