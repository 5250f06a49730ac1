"""The largest offset from the path from which a start is proved to be safe, by speed and heading."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ...codegen.loop.stages import check
from ...readers.errors import BadInput
from ...readers.progress import Reported, silent
from ...simulation.loop import Loop, make_loop
from ...simulation.specification.spec import Initial, Spec
from .certificate import Certificate, widest
from .enclosed_loop import EnclosedLoop
from .safety import check_uncertainty

SPEEDS = (0.0, 0.5, 1.0)  # of the desired speed
HEADINGS = (-45.0, 0.0, 45.0)  # degrees, from the direction of travel
FIRST, MOST, HALVINGS = 0.5, 8.0, 3  # m: first and largest offset tried; it is doubled, then bisected


@dataclass(frozen=True)
class Offsets:
    """`offsets` (m) by speed (m/s) and heading (rad, from the path's direction): up to there each start is
    proved to be safe on a grid, on both sides of the path; None where not even a start on the path is safe.
    """

    speeds: tuple[float, ...]
    headings: tuple[float, ...]
    offsets: tuple[tuple[float | None, ...], ...]

    def lines(self) -> list[str]:
        """Return the table as text."""
        head = "speed m/s".rjust(10) + "".join(
            f"{math.degrees(heading):9.0f} deg" for heading in self.headings
        )
        rows = []
        for speed, offsets in zip(self.speeds, self.offsets, strict=True):
            cells = "".join(("none" if offset is None else f"{offset:.3g} m").rjust(13) for offset in offsets)
            rows.append(f"{speed:10.3g}{cells}")
        return [head, *rows]


def safe_offsets(
    spec: Spec,
    uncertainty: Mapping[str, float],
    speeds: Sequence[float] | None = None,
    headings: Sequence[float] | None = None,
    progress: Reported = silent,
) -> Offsets:
    """Return the table for a SPEC whose path is a line, a circle or an arc; `speeds` in m/s, `headings` in
    rad, or a few of each.

    Raises BadInput for another path, and as `make_loop` does.
    """
    check(spec, "analyse --table")
    loop = make_loop(spec)
    check_uncertainty(uncertainty, loop)
    initial, desired = spec.initial, spec.reference.speed
    assert initial and initial.point and desired is not None, "checked by the table of stages"
    enclosed = EnclosedLoop(loop, spec, uncertainty) if loop.law.output.path else None
    if enclosed is None or not enclosed.settles:
        raise BadInput("a table of safe offsets needs a line, a circle or an arc as path")
    h, psi = enclosed.z[:2]
    direction = (initial.heading or 0.0) - psi
    left = (-math.sin(direction), math.cos(direction))
    foot = [coordinate - h * n for coordinate, n in zip(initial.point, left, strict=True)]
    speeds = tuple(speeds or (part * desired for part in SPEEDS))
    headings = tuple(headings or map(math.radians, HEADINGS))

    def beside(offset: float, speed: float, heading: float) -> tuple[Loop, Spec]:
        point = tuple(float(coordinate + offset * n) for coordinate, n in zip(foot, left, strict=True))
        moved = replace(spec, initial=Initial(point=point, heading=float(direction + heading), speed=speed))
        return make_loop(moved), moved

    invariant = widest(enclosed.started(*beside(0.0, desired, 0.0)), spec.simulation)

    def safe(offset: float, speed: float, heading: float) -> bool:
        return all(_safe(side * offset, speed, heading) for side in ((1.0, -1.0) if offset else (1.0,)))

    def _safe(offset: float, speed: float, heading: float) -> bool:
        try:
            course = Certificate(
                enclosed.started(*beside(offset, speed, heading)), spec.simulation, invariant
            ).run()
        except BadInput:  # the start is singular
            return False
        return not course.lost

    offsets: list[float | None] = []
    columns = len(headings)
    for v, a in itertools.product(speeds, headings):
        offsets.append(_largest(lambda d, v=v, a=a: safe(d, v, a)))
        progress(len(offsets), len(speeds) * columns, "safe offsets found")
    return Offsets(
        speeds, headings, tuple(tuple(offsets[k : k + columns]) for k in range(0, len(offsets), columns))
    )


def _largest(safe) -> float | None:
    """Return the largest offset tried for which, and for all smaller ones tried, `safe` holds."""
    if not safe(0.0):
        return None
    good, bad = 0.0, FIRST
    while bad <= MOST and safe(bad):
        good, bad = bad, 2 * bad
    if bad > MOST:
        return good
    for _ in range(HALVINGS):
        middle = (good + bad) / 2
        good, bad = (middle, bad) if safe(middle) else (good, middle)
    return good
