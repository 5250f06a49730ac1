"""The position of a vehicle on a composite path, and what it follows next: runtime_c/noslip_path.h, and a
reference in Python.

The reference is written independently of the C, from its header. Both have the same interface, so that either
can guide a run.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from threading import Lock
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ...codegen.printing.scalar import SCALARS
from ...model.algebra.trigonometry import cosine, sine, sine_cosine
from ...model.segments import Segment
from ...readers.errors import BadInput
from .backends import runtime_of
from .runtime import Runtime, runtime

if TYPE_CHECKING:
    from ...model.law import ControlLaw

HEADER = "noslip_path.h"

REVERSING = ("refuse", "switch")  # as the C runtime's NOSLIP_REFUSE and NOSLIP_SWITCH
STOP = ("point", "axle")  # as its NOSLIP_STOP_POINT and NOSLIP_STOP_AXLE
JOIN = 1e-6  # m and rad: default of the largest gap and kink, in double
CREEP = 0.01  # m/s
MOST_ENDED = 64  # segments that may end in one update
ANGLE_MAX = 2.0**20  # rad: range of the C's sine in double
# In units of the radius: nearer to the centre of an arc, progress is undefined
CENTRE = 16 * sys.float_info.epsilon


@dataclass(frozen=True)
class TrackerOptions:
    """Options of path following.

    speed (m/s, positive) between stops; deceleration (m/s^2) before a stop, 0 for none; creep (m/s), the
    lowest desired speed before a stop, below which the vehicle counts as standing; gap (m) and kink (rad),
    the largest at a join; 0 is the default of the last three. L: distance (m) of P_l ahead of the vehicle's
    point, driving forward and in reverse; W: to the left of it; ahead: distance of that point ahead of the
    axle. reversing: "refuse" segments in reverse, or "switch" P_l at a cusp. stop: the point that stops at
    cusps and at the end, P_l ("point") or the middle of the axle ("axle"). closed: the last segment is
    followed by the first.
    """

    speed: float
    deceleration: float = 0.0
    creep: float = 0.0
    gap: float = 0.0
    kink: float = 0.0
    L: tuple[float, float] = (0.0, 0.0)
    W: float = 0.0
    ahead: float = 0.0
    reversing: str = "refuse"
    stop: str = "point"
    closed: bool = False


@dataclass(frozen=True)
class Guide:
    """The current segment and the position of the vehicle on it; zeros if `status` is an error.

    segment (from 0) and whether it is driven backward; changed: the segment differs from the last update, or
    is the first; waiting: at a cusp, until the vehicle stands; arrived: the end is reached. L (m) of P_l now.
    The segment or its straight extension starts at x, y (m) in the direction of travel heading (rad) with
    curvature (1/m, positive turns left). progress (m) of P_l on it, and the distance left (m) to its end; it
    ends at 0 or below, and is a smooth function of the pose; while waiting m/s, |forward speed| - creep; inf
    when arrived. remaining (m) to the stop, inf if there is none. Position relative to the foot of P_l:
    distance (m), positive to the left of travel; cosine and sine of the heading relative to the direction of
    travel there; foot_curvature (1/m) of the parallel curve through P_l. speed (m/s): desired forward speed
    of the vehicle, negative in reverse, and its rate along the motion (m/s^2).
    """

    status: str
    segment: int = 0
    backward: bool = False
    changed: bool = False
    waiting: bool = False
    arrived: bool = False
    L: float = 0.0
    x: float = 0.0
    y: float = 0.0
    heading: float = 0.0
    curvature: float = 0.0
    progress: float = 0.0
    left: float = 0.0
    remaining: float = 0.0
    distance: float = 0.0
    cosine: float = 0.0
    sine: float = 0.0
    foot_curvature: float = 0.0
    speed: float = 0.0
    speed_rate: float = 0.0


class Tracker(Protocol):
    """Follows a composite path; x, y (m) and heading (rad) are those of the vehicle's point, speed (m/s) goes
    forward.

    The status of a guide is "ok", "arrived", or an error: "nonfinite", "range", "singular" (P_l at the centre
    of an arc). Trackers are thread-safe.
    """

    options: TrackerOptions

    def look(self, x: float, y: float, heading: float, speed: float) -> Guide:
        """Return the guide for the current segment; nothing changes."""

    def update(self, x: float, y: float, heading: float, speed: float) -> Guide:
        """Switch to the next segment if the current one has ended, and return the guide."""


def make_tracker(
    backend: str, segments: Sequence[Segment], options: TrackerOptions, law: ControlLaw | None = None
) -> Tracker:
    """Return a tracker in Python ("casadi"), or the C as run by a backend; see `runtime_of`.

    Raises PathFault for a path that cannot be followed.
    """
    if backend == "casadi":
        return PathTracker(segments, options)
    c, scalar = runtime_of(backend, HEADER, law)
    return CompiledTracker(segments, options, scalar, c)


# -- faults of paths -----------------------------------------------------------------------------------------


class PathFault(BadInput):
    """A path that cannot be followed: `kind` as in the C's NOSLIP_FAULT_..., in lower case; `segment` from 0,
    -1 for none; `size` in the kind's unit."""

    def __init__(
        self, kind: str, segment: int, size: float, segments: Sequence[Segment], options: TrackerOptions
    ):
        super().__init__(_sentence(kind, segment, size, segments, options))
        self.kind, self.segment, self.size = kind, segment, size


def _sentence(kind: str, k: int, size: float, segments: Sequence[Segment], options: TrackerOptions) -> str:
    """Return a message: the fault, the segment (counted from 1), the size, and what to do."""
    if kind == "options":
        return f"path: {next(_bad_options(options), 'an option is out of range')}"
    if kind == "empty":
        return "path: it has no segments; give at least one line or arc"
    this, before = f"path segment {k + 1}", f"segment {(k - 1) % len(segments) + 1}"
    match kind:
        case "nonfinite" if not size:
            return f"{this}: {segments[k]} has a number that is not finite"
        case "nonfinite":
            return (
                f"{this}: an angle of {size:.6g} rad is too large for sine and cosine; subtract whole turns"
            )
        case "length":
            return f"{this}: its length, {size:g} m, is not positive; remove it or make it longer"
        case "reversing":
            return f'{this} is to be driven in reverse, which is not allowed; set reversing = "switch"'
        case "lever":
            way, sign, name = (
                ("in reverse", "negative", "L_backward")
                if segments[k].backward
                else ("forward", "positive", "L")
            )
            return (
                f"{this}: P_l lies L + d = {size:g} m ahead of the axle, which must be {sign} driving "
                f"{way}; change {name}"
            )
        case "tight":
            radius = 1 / abs(segments[k].curvature)
            least = f"{radius + size:.6g} m, which L + d and W require"
            return (
                f"{this}: its radius, {radius:.6g} m, is not more than {least}; increase it or move P_l "
                "nearer to the axle"
            )
        case "gap":
            return f"{this} begins {size:.3g} m from the end of {before}; move it there"
        case "kink":
            return (
                f"{this}: its direction of travel differs by {size:.3g} rad from that at the end of "
                f"{before}; rotate it"
            )
        case "cusp":
            return (
                f"{this}: the direction of travel at the cusp after {before} is {size:.3g} rad off a "
                "change by pi; rotate it"
            )
        case _:
            missing = f"{size:.3g} m too short for P_l to change sides"
            return (
                f"{this}: the run from this cusp to the next stop is {missing}; lengthen it or set stop = "
                '"axle"'
            )


def _bad_options(options: TrackerOptions) -> Iterator[str]:
    for name in ("speed", "deceleration", "creep", "gap", "kink"):
        value = getattr(options, name)
        if not (math.isfinite(value) and value >= 0) or (name == "speed" and not value):
            yield f"{name} = {value:g} must be finite and {'positive' if name == 'speed' else 'not negative'}"
    for name, value in (
        ("L", options.L[0]),
        ("L_backward", options.L[1]),
        ("W", options.W),
        ("ahead", options.ahead),
    ):
        if not math.isfinite(value):
            yield f"{name} = {value:g} must be finite"
    for name, known in (("reversing", REVERSING), ("stop", STOP)):
        if getattr(options, name) not in known:
            yield f"{name} = {getattr(options, name)!r} is not one of {', '.join(known)}"


def _faults(segments: Sequence[Segment], options: TrackerOptions) -> Iterator[tuple[str, int, float]]:
    """Yield kind, segment and size of every fault, in the order of the C;
    those after the first may be meaningless."""
    for _ in _bad_options(options):
        yield "options", -1, 0.0
    if not segments:
        yield "empty", -1, 0.0
    lookaheads = [L + options.ahead for L in options.L]
    for k, segment in enumerate(segments):
        yield from (
            (kind, k, size) for kind, size in _segment_faults(segment, options, lookaheads[segment.backward])
        )
        if k:
            yield from ((kind, k, size) for kind, size in _join_faults(segments[k - 1], segment, options))
    if options.closed:
        yield from ((kind, 0, size) for kind, size in _join_faults(segments[-1], segments[0], options))
    if options.stop == "point":
        first, *others = _runs(segments, options.closed)
        after_cusps = [*others, first] if options.closed and others else others
        for run in sorted(after_cusps, key=lambda run: (run[0] - 1) % len(segments)):
            missing = lookaheads[0] - lookaheads[1] - sum(segments[k].length for k in run)
            if missing >= 0:
                yield "short", run[0], missing


def _segment_faults(
    segment: Segment, options: TrackerOptions, lookahead: float
) -> Iterator[tuple[str, float]]:
    if not all(
        map(math.isfinite, (segment.x, segment.y, segment.heading, segment.curvature, segment.length))
    ):
        yield "nonfinite", 0.0
    turned = segment.curvature * segment.length
    for angle in (turned, segment.heading, segment.heading + turned):
        if abs(angle) > ANGLE_MAX:
            yield "nonfinite", min(angle, sys.float_info.max)
    if segment.length <= 0:
        yield "length", segment.length
    if segment.backward and options.reversing == "refuse":
        yield "reversing", 0.0
    ahead_in_travel = -lookahead if segment.backward else lookahead
    if ahead_in_travel <= 0:
        yield "lever", lookahead
    if segment.curvature:
        left_in_travel = -options.W if segment.backward else options.W
        outward = -left_in_travel if segment.curvature > 0 else left_in_travel
        radius, least = 1 / abs(segment.curvature), math.hypot(lookahead, max(0.0, outward))
        if radius <= least:
            yield "tight", least - radius


def _join_faults(before: Segment, after: Segment, options: TrackerOptions) -> Iterator[tuple[str, float]]:
    x, y, heading = before.end
    gap = math.hypot(after.x - x, after.y - y)
    if not gap <= (options.gap or JOIN):
        yield "gap", gap
    cusp = before.backward != after.backward
    kink = abs(math.remainder(after.heading - heading - (math.pi if cusp else 0.0), 2 * math.pi))
    if kink > (options.kink or JOIN):
        yield "cusp" if cusp else "kink", kink


def _runs(segments: Sequence[Segment], closed: bool) -> list[list[int]]:
    """Return the indices of the segments from stop to stop;
    in a closed path the last run continues into the first."""
    runs: list[list[int]] = []
    for k, segment in enumerate(segments):
        if k and segment.backward == segments[k - 1].backward:
            runs[-1].append(k)
        else:
            runs.append([k])
    if closed and len(runs) > 1 and segments[0].backward == segments[-1].backward:
        runs[0] = runs.pop() + runs[0]
    return runs


# -- the reference implementation ----------------------------------------------------------------------------


@dataclass(frozen=True)
class _Piece:
    """A segment or a straight extension: `shape` is followed up to its length, `rest` m before the stop.

    `runs_on` is true for an extension; `after` is the number of the next one, None at the end.
    """

    segment: int
    shape: Segment
    rest: float
    runs_on: bool
    after: int | None


@dataclass(frozen=True)
class _State:
    piece: int = 0
    progress: float = 0.0
    stopped: bool = False
    begun: bool = False


class _Error(Exception):
    def __init__(self, status: str):
        super().__init__(status)
        self.status = status


class PathTracker:
    """The reference implementation: double, Python's mathematics. Raises PathFault for a path that cannot be
    followed."""

    def __init__(self, segments: Sequence[Segment], options: TrackerOptions):
        for fault in _faults(segments, options):
            raise PathFault(*fault, segments, options)
        self.options = options
        self._creep = options.creep or CREEP
        self._pieces = _pieces(segments, options)
        self._limit = min(len(segments) + 1, MOST_ENDED)  # of segment changes in one update
        self._state, self._lock = _State(), Lock()

    def look(self, x: float, y: float, heading: float, speed: float) -> Guide:
        """See Tracker.look."""
        state = self._state
        try:
            return self._guide(state, *self._find(state, x, y, heading, speed), heading, speed)
        except _Error as error:
            return Guide(error.status)

    def update(self, x: float, y: float, heading: float, speed: float) -> Guide:
        """See Tracker.update."""
        with self._lock:
            return self._update(x, y, heading, speed)

    def _update(self, x: float, y: float, heading: float, speed: float) -> Guide:
        state, changed = self._state, not self._state.begun
        try:
            progress, distance = self._find(state, x, y, heading, speed)
            for _ in range(self._limit):
                state = replace(
                    state, progress=progress, stopped=state.stopped or self._at_stop(state, progress)
                )
                if not self._ended(state, speed):
                    break
                state, changed = self._next(state), True
                progress, distance = self._find(state, x, y, heading, speed)
        except _Error as error:
            return Guide(error.status)
        self._state = replace(state, progress=progress, begun=True)
        return replace(self._guide(self._state, progress, distance, heading, speed), changed=changed)

    def _find(self, state: _State, x: float, y: float, heading: float, speed: float) -> tuple[float, float]:
        """Return progress and distance of P_l on the current segment. Raises _Error if they are undefined."""
        if not all(map(math.isfinite, (x, y, heading, speed))):
            raise _Error("nonfinite")
        if abs(heading) > ANGLE_MAX:
            raise _Error("range")
        shape = self._pieces[state.piece].shape
        L, W = self.options.L[shape.backward], self.options.W
        s, c = sine_cosine(heading)
        px, py = x + L * c - W * s, y + L * s + W * c
        if shape.curvature:
            s, c = sine_cosine(shape.heading)
            centre = shape.x - s / shape.curvature, shape.y + c / shape.curvature
            if abs(shape.curvature) * math.dist(centre, (px, py)) <= CENTRE:
                raise _Error("singular")
        try:
            progress, distance = shape.progress(px, py, state.progress), shape.distance(px, py)
        except (OverflowError, ValueError):  # from rounding to whole turns
            raise _Error("nonfinite") from None
        if not (math.isfinite(progress) and math.isfinite(distance)):
            raise _Error("nonfinite")
        if abs(progress * shape.curvature) > ANGLE_MAX:
            raise _Error("range")
        return progress, distance

    def _at_stop(self, state: _State, progress: float) -> bool:
        piece = self._pieces[state.piece]
        return piece.runs_on and progress >= piece.shape.length

    def _ended(self, state: _State, speed: float) -> bool:
        """Return whether the current segment has ended: P_l is beyond it; at a stop, the vehicle stands."""
        piece = self._pieces[state.piece]
        if piece.runs_on:
            return state.stopped and piece.after is not None and abs(speed) <= self._creep
        return state.progress >= piece.shape.length

    def _next(self, state: _State) -> _State:
        """Return the state at the start of the next segment; for an extension of zero length, at the stop."""
        after = self._pieces[state.piece].after
        assert after is not None, "only called if another segment follows"
        following = self._pieces[after]
        return replace(
            state, piece=after, progress=0.0, stopped=following.runs_on and not following.shape.length
        )

    def _guide(self, state: _State, progress: float, distance: float, heading: float, speed: float) -> Guide:
        piece = self._pieces[state.piece]
        turned = heading - piece.shape.pose(progress)[2]
        arrived, waiting = state.stopped and piece.after is None, state.stopped and piece.after is not None
        left = piece.shape.length - progress
        remaining = left + piece.rest
        sign = -1.0 if piece.shape.backward else 1.0
        speed_d, rate = (0.0, 0.0) if state.stopped else self._profile(remaining, sign * speed)
        return Guide(
            status="arrived" if arrived else "ok",
            segment=piece.segment,
            backward=piece.shape.backward,
            waiting=waiting,
            arrived=arrived,
            L=self.options.L[piece.shape.backward],
            x=piece.shape.x,
            y=piece.shape.y,
            heading=piece.shape.heading,
            curvature=piece.shape.curvature,
            progress=progress,
            left=math.inf if arrived else abs(speed) - self._creep if waiting else left,
            remaining=remaining,
            distance=distance,
            cosine=cosine(turned),
            sine=sine(turned),
            foot_curvature=piece.shape.curvature / (1 - piece.shape.curvature * distance),
            speed=sign * speed_d,
            speed_rate=sign * rate,
        )

    def _profile(self, remaining: float, speed: float) -> tuple[float, float]:
        """Return the desired speed at this distance from the stop and its rate along the motion,
        in the direction of travel."""
        cruise, deceleration = self.options.speed, self.options.deceleration
        if not deceleration:
            return cruise, 0.0
        falling = math.sqrt(2 * deceleration * max(0.0, remaining))
        if self._creep < falling < cruise:
            return falling, -deceleration * min(2.0, max(0.0, speed / falling))
        return min(cruise, max(self._creep, falling)), 0.0


def _pieces(segments: Sequence[Segment], options: TrackerOptions) -> list[_Piece]:
    """Return every segment, and after the last one of each run its extension, in the order of travel."""
    pieces: list[_Piece] = []
    runs = _runs(segments, options.closed)
    if options.closed and len({segment.backward for segment in segments}) == 1:  # no stop
        return [
            _Piece(k, segment, math.inf, False, (k + 1) % len(segments)) for k, segment in enumerate(segments)
        ]
    for run in runs:
        way = sum(segments[k].length for k in run)
        last = segments[run[-1]]
        run_on = abs(options.L[last.backward] + options.ahead) if options.stop == "axle" else 0.0
        for k in run:
            way -= segments[k].length
            pieces.append(
                _Piece(k, segments[k], way + run_on if k != run[-1] else run_on, False, len(pieces) + 1)
            )
        extension = Segment(*last.end, 0.0, run_on, last.backward)
        pieces.append(_Piece(run[-1], extension, 0.0, True, len(pieces) + 1))
    pieces[-1] = replace(pieces[-1], after=0 if options.closed else None)
    first = next(k for k, piece in enumerate(pieces) if piece.segment == 0)
    # So that segment 0 is the first
    turned = {k: (k - first) % len(pieces) for k in range(len(pieces))} | {None: None}
    return [replace(piece, after=turned[piece.after]) for piece in pieces[first:] + pieces[:first]]


# -- the C ---------------------------------------------------------------------------------------------------


class CompiledTracker:
    """The C, in double or float. Raises PathFault for a path that cannot be followed."""

    def __init__(
        self,
        segments: Sequence[Segment],
        options: TrackerOptions,
        scalar: str = "double",
        c: Runtime | None = None,
    ):
        self.options = options
        self._c, self._scalar, self._lock = c or runtime(HEADER), scalar, Lock()
        kind = f"{SCALARS[scalar].name('noslip_segment')}[]"
        self._segments = self._c.ffi.new(kind, [vars(segment) for segment in segments])
        self._self, fault = self._new("noslip_path"), self._new("noslip_path_fault")
        values = vars(options) | {
            "reversing": _index(REVERSING, options.reversing),
            "stop": _index(STOP, options.stop),
        }
        given = self._segments, len(segments), self._new("noslip_path_options", values)
        if self._call("noslip_path_init", *given, fault) != "ok":
            raise PathFault(_fault_names(self._c)[fault.kind], fault.segment, fault.size, segments, options)
        self._guide = self._new("noslip_guide")
        self._fields = [name for name, _ in self._c.ffi.typeof(self._guide).item.fields if name != "foot"]
        self._largest = float(np.finfo(np.float32 if scalar == "float" else np.float64).max)

    def _new(self, kind: str, *initial):
        return self._c.new(kind, self._scalar, *initial)

    def _call(self, name: str, *arguments) -> str:
        return self._c.status(self._c.function(name, self._scalar)(self._self, *arguments))

    def look(self, x: float, y: float, heading: float, speed: float) -> Guide:
        """See Tracker.look."""
        return self._answer("noslip_path_look", x, y, heading, speed)

    def update(self, x: float, y: float, heading: float, speed: float) -> Guide:
        """See Tracker.update."""
        return self._answer("noslip_path_update", x, y, heading, speed)

    def _answer(self, name: str, *seen: float) -> Guide:
        with self._lock:
            status, foot = self._call(name, *seen, self._guide), self._guide.foot
            found = guide_values(self._guide, self._fields, self._largest)
            at_foot = {
                "distance": foot.distance,
                "cosine": foot.cosine,
                "sine": foot.sine,
                "foot_curvature": foot.curvature,
            }
        return Guide(status, **(found | at_foot))


def guide_values(guide: Any, fields: Iterable[str], largest: float) -> dict[str, Any]:
    """Return fields of a guide of the C: flags as truth values, endless lengths,
    which are at least `largest`, as infinite."""
    found = {field: getattr(guide, field) for field in fields}
    flags = {field: bool(found[field]) for field in ("backward", "changed", "waiting", "arrived")}
    endless = {
        field: math.inf for field in ("left", "remaining") if field in found and found[field] >= largest
    }
    return found | flags | endless


def _index(names: Sequence[str], name: str) -> int:
    """Return the index of a name; -1, which the C rejects, for an unknown one."""
    return names.index(name) if name in names else -1


def _fault_names(c: Runtime) -> dict[int, str]:
    """Return the kinds of faults by number."""
    prefix = "NOSLIP_FAULT_"
    return {
        getattr(c.lib, name): name.removeprefix(prefix).lower()
        for name in dir(c.lib)
        if name.startswith(prefix)
    }
