"""The fastest speed along a composite path for given accelerations: runtime_c/noslip_profile.h."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np

from ...codegen.printing.scalar import SCALARS
from ...model.segments import Segment
from ...readers.errors import check_status
from ..controllers.backends import runtime_of
from ..controllers.controller import Numbers
from ..controllers.runtime import Runtime, runtime
from ..controllers.tracking import REVERSING, STOP, Guide, TrackerOptions

if TYPE_CHECKING:
    from ...model.law import ControlLaw

HEADER = "noslip_profile.h"


@dataclass(frozen=True)
class Accelerations:
    """The largest accelerations of the vehicle, m/s^2, positive: `lateral`, to the centre of a curve, and
    along the path, which together are within an ellipse. `angular`, rad/s^2, is that of its yaw rate where
    the curvature jumps; 0: no limit.
    """

    lateral: float
    acceleration: float
    deceleration: float
    angular: float = 0.0

    def top_speed(self, segments: Sequence[Segment]) -> float:
        """Return a speed (m/s) that no profile of the path exceeds."""
        return float(top_speed(segments, self.lateral, max(self.acceleration, self.deceleration)))


def top_speed(segments: Sequence[Segment], lateral: Numbers | float, along: Numbers | float) -> np.ndarray:
    """Return a speed (m/s) that no profile of the path exceeds, with these largest accelerations (m/s^2),
    one or arrays."""
    way = sum(segment.length for segment in segments)
    radii = [1 / abs(segment.curvature) for segment in segments if segment.curvature]
    return np.sqrt(2 * np.asarray(along) * way + np.asarray(lateral) * max(radii, default=0.0))


class SpeedProfile:
    """The profile of a path that a tracker follows with the same options, computed by the C in double or
    float, here or as `c` runs it; thread-safe. The speed rises from rest with P_l at `progress` (m) of the
    first segment, or where it is with the vehicle at the beginning of the path, if that is before.

    Raises BadInput for accelerations that are not finite and positive.
    """

    def __init__(
        self,
        segments: Sequence[Segment],
        options: TrackerOptions,
        limits: Accelerations,
        scalar: str = "double",
        c: Runtime | None = None,
        progress: float = math.inf,
    ):
        self._c, self._scalar, self._lock, self._count = c or runtime(HEADER), scalar, Lock(), len(segments)
        ffi, name = self._c.ffi, SCALARS[scalar].name
        self._segments = ffi.new(f"{name('noslip_segment')}[]", [vars(segment) for segment in segments])
        self._squares = self._c.array(scalar, np.zeros(len(segments)))
        real = np.float32 if scalar == "float" else np.float64
        lookahead = abs(real(options.L[segments[0].backward]) + real(options.ahead))
        behind = float(max(-real(progress) + (lookahead if options.stop == "axle" else 0), 0))
        values = vars(options) | {
            "reversing": REVERSING.index(options.reversing),
            "stop": STOP.index(options.stop),
        }
        given = (
            self._c.new("noslip_path_options", scalar, values),
            self._c.new("noslip_profile_limits", scalar, asdict(limits) | {"behind": behind}),
        )
        self._self = self._c.new("noslip_profile", scalar)
        self._given, self._guide = (segments, *given), self._c.new("noslip_guide", scalar)
        self._answer = [self._c.array(scalar, [0.0]) for _ in range(2)]
        self.limits = limits
        self._call("init", self._segments, self._count, *given, self._squares)

    def speed(self, guide: Guide, forward_speed: float) -> tuple[float, float]:
        """Return the desired forward speed (m/s), at most that of the guide,
        and its rate along the motion (m/s^2)."""
        with self._lock:
            for field in ("segment", "x", "y", "curvature", "progress", "speed", "speed_rate"):
                setattr(self._guide, field, getattr(guide, field))
            self._call("speed", self._guide, float(forward_speed), *self._answer)
            return self._answer[0][0], self._answer[1][0]

    def along(self, segment: int, progress: float) -> float:
        """Return the largest speed (m/s, without sign) at a place on a segment, m from its start."""
        given = self._given[0][segment]
        place = {name: getattr(given, name) for name in ("x", "y", "curvature")}
        return self.speed(
            Guide("ok", segment=segment, progress=progress, speed=self._given[1].speed, **place), 0.0
        )[0]

    def _call(self, name: str, *arguments) -> None:
        status = self._c.status(
            self._c.function(f"noslip_profile_{name}", self._scalar)(self._self, *arguments)
        )
        check_status(status, f"speed profile: {name}", "accelerations must be finite and positive")


def make_profile(
    backend: str,
    segments: Sequence[Segment],
    options: TrackerOptions,
    limits: Accelerations,
    law: ControlLaw,
    progress: float,
) -> SpeedProfile:
    """Return the profile, computed by the C as run by a backend, see `runtime_of`; in double for "casadi"."""
    c, scalar = runtime_of("c" if backend == "casadi" else backend, HEADER, law)
    return SpeedProfile(segments, options, limits, scalar, c, progress)
