"""Whether a desired speed fits the bends and joins of a path, before it is driven."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from ..controllers.tracking import TrackerOptions
from .profile import Accelerations, SpeedProfile

if TYPE_CHECKING:
    from ...model.segments import Segment

AT_ONCE = 1e9  # m/s^2: along the path, so that a profile is limited by bends and joins alone


def misfit(
    segments: Sequence[Segment], options: TrackerOptions, limits: Accelerations
) -> tuple[float, str] | None:
    """Return the largest speed (m/s, without sign) that all bends and joins allow, and the place of that
    which allows least; None if the speed of the options fits. `limits` are the accelerations that all of the
    friction, or of the motors, can give.
    """
    alone = Accelerations(limits.lateral, AT_ONCE, AT_ONCE, limits.angular)
    profile = SpeedProfile(segments, replace(options, speed=abs(options.speed)), alone)
    found = [
        (abs(profile.along(k, segment.length / 2)), _bend(segment)) for k, segment in enumerate(segments)
    ]
    for k in range(0 if options.closed else 1, len(segments)):
        before, after = segments[k - 1], segments[k]
        if before.backward == after.backward:  # not a cusp, where the vehicle stops
            jump = abs(after.curvature - before.curvature)
            where = (
                f"the join at ({after.x:.3g}, {after.y:.3g}) m, where the curvature changes by {jump:.3g} 1/m"
            )
            found.append((abs(profile.along(k, 0.0)), where))
    speed, where = min(found, key=lambda each: each[0])
    return (speed, where) if speed < abs(options.speed) * (1 - 1e-9) and math.isfinite(speed) else None


def _bend(segment: Segment) -> str:
    radius = 1 / abs(segment.curvature) if segment.curvature else math.inf
    return f"the arc of radius {radius:.3g} m that begins at ({segment.x:.3g}, {segment.y:.3g}) m"
