"""A vehicle on a course with cusps, the point of it nearest to P_l,
and the desired speed: noslip_course.h."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from threading import Lock
from typing import Any

import numpy as np

from ...codegen.printing.scalar import SCALARS
from ...readers.errors import BadInput
from ..controllers.runtime import runtime
from ..controllers.tracking import REVERSING, STOP, guide_values
from .course import SmoothCurve

HEADER = "noslip_course.h"
WRONG = {  # status of init -> what to change
    "bad_parameter": "a part turns too far, or a number is too large for it; make parts shorter",
    "unstable": "P_l is on the side of the axle on which the heading diverges from a piece; change L or "
    "L_backward",
    "bad_path": "the piece after a cusp is too short: P_l is beyond its end when it has changed sides; set "
    'stop = "axle"',
}


@dataclass(frozen=True)
class CourseOptions:
    """Options of following a course.

    speed (m/s) along it between stops, negative if the vehicle faces against it; deceleration (m/s^2) before
    a stop, 0 for none; creep (m/s), the lowest desired speed before a stop, below which the vehicle counts as
    standing, 0 for the default; window (m): how far the nearest point may have moved since the last update, 0
    for any way; start (m): length along the course from which it is searched at first. L, W, ahead, stop as
    for TrackerOptions; reversing: with "allow" P_l may be on the side of the axle on which the heading
    diverges. endless: it does not stop at its end, after which the last curvature stays.
    """

    speed: float
    deceleration: float = 0.0
    creep: float = 0.0
    window: float = 0.0
    start: float = 0.0
    L: tuple[float, float] = (0.0, 0.0)
    W: float = 0.0
    ahead: float = 0.0
    reversing: str = "refuse"
    stop: str = "point"
    endless: bool = False


@dataclass(frozen=True)
class CourseGuide:
    """The point of a course nearest to P_l; zeros if `status` is an error.

    piece: cusps that were passed; backward: whether the vehicle drives in reverse; changed: the piece differs
    from the last update, or is the first; waiting: at a cusp, until the vehicle stands; arrived: the end is
    reached. L (m) of P_l now. length (m) along the course, distance (m) of P_l to the left of travel. left
    (m) to the stop; while waiting m/s, |forward speed| - creep; inf when arrived, or without a stop. The
    point x, y (m), the direction of travel there (rad), the curvature (1/m) and its derivatives by the
    length. speed (m/s): desired, negative in reverse, and its rate along the motion (m/s^2).
    """

    status: str
    piece: int = 0
    backward: bool = False
    changed: bool = False
    waiting: bool = False
    arrived: bool = False
    L: float = 0.0
    length: float = 0.0
    distance: float = 0.0
    left: float = 0.0
    x: float = 0.0
    y: float = 0.0
    direction: float = 0.0
    curvature: tuple[float, ...] = ()
    speed: float = 0.0
    speed_rate: float = 0.0


class CourseTracker:
    """The C, in double or float; thread-safe. x, y (m) and heading (rad) are those of the vehicle's point,
    speed (m/s) goes forward. The status of a guide is "ok", "arrived", or an error: "nonfinite", "range",
    "singular" (no nearest point).

    Raises BadInput for a course that cannot be followed.
    """

    def __init__(self, curve: SmoothCurve, options: CourseOptions, scalar: str = "double"):
        self.options, self._c, self._scalar, self._lock = options, runtime(HEADER), scalar, Lock()
        count = len(curve.lengths)
        arrays = {name: self._c.array(scalar, getattr(curve, name)) for name in ("lengths", "curvatures")}
        numbers = {name: getattr(curve, name) for name in ("x", "y", "heading", "rounding")}
        given = self._c.new("noslip_course_options", scalar, numbers | arrays | {"count": count})
        room = 2 * count + 1  # NOSLIP_COURSE_ROOM
        stretches = self._c.ffi.new(f"{SCALARS[scalar].name('noslip_stretch')}[]", room)
        self._course, self._self = (
            self._c.new("noslip_course", scalar),
            self._c.new("noslip_course_tracker", scalar),
        )
        self._kept = arrays, stretches  # the C refers to them
        self._check(self._call("noslip_course_init", self._course, stretches, room, given))
        values = asdict(options) | {
            name: names.index(getattr(options, name)) for name, names in CHOICES.items()
        }
        self._check(
            self._call(
                "tracker_init", self._self, self._course, self._c.new(f"{KIND}_options", scalar, values)
            )
        )
        self._guide = self._c.new("noslip_course_guide", scalar)
        self._largest = float(np.finfo(np.float32 if scalar == "float" else np.float64).max)
        # By the last look, with the tracker as it is
        self._seen: tuple[tuple[float, ...], CourseGuide] | None = None

    def look(self, x: float, y: float, heading: float, speed: float) -> CourseGuide:
        """Return the guide on the piece that is followed; nothing changes."""
        seen = (float(x), float(y), float(heading), float(speed))
        with self._lock:
            if not (self._seen and self._seen[0] == seen):
                self._seen = seen, self._guided("tracker_look", seen)
            return self._seen[1]

    def update(self, x: float, y: float, heading: float, speed: float) -> CourseGuide:
        """Go on to the next piece where the vehicle stands at a cusp, and return the guide."""
        with self._lock:
            self._seen = None
            return self._guided("tracker_update", (float(x), float(y), float(heading), float(speed)))

    def _guided(self, name: str, seen: tuple[float, ...]) -> CourseGuide:
        status = self._call(name, self._self, *seen, self._guide)
        if status not in ("ok", "arrived"):
            return CourseGuide(status)
        found = guide_values(self._guide, FIELDS, self._largest)
        return CourseGuide(status, **(found | {"curvature": tuple(found["curvature"])}))

    def _call(self, name: str, *arguments: Any) -> str:
        whole = name if name.startswith("noslip") else f"noslip_course_{name}"
        return self._c.status(self._c.function(whole, self._scalar)(*arguments))

    @staticmethod
    def _check(status: str) -> None:
        if status != "ok":
            raise BadInput(f"the course cannot be followed: {WRONG.get(status, status)}")


KIND = "noslip_course_tracker"
CHOICES = {"reversing": (*REVERSING, "allow"), "stop": STOP}  # "allow" as the C runtime's NOSLIP_ALLOW
FIELDS = tuple(name for name in CourseGuide.__dataclass_fields__ if name != "status")
