"""The C of a follower with its telemetry on this host: loads the config that a dump has,
and makes the follower's calls."""

from __future__ import annotations

import struct
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ...codegen.files import has_follower, robot_files
from ...codegen.follower.follower import LAW, NAME, why_no_follower
from ...codegen.printing.scalar import SCALARS
from ...model.law import ControlLaw
from ...readers.errors import BadInput
from ...readers.files import write_folder
from ...readers.robots import find_laws, find_robot, law_of, system_of
from ..controllers.runtime import InC, declarations, knowing, load
from .dump import Event, Kind, Start, record_type

ROWS = struct.Struct("<I")
ROWS_AT = 20  # place of the number of segments in an image
REFUSED = {
    "damaged": "its bytes are damaged",
    "other_version": "it is of another version of noslip, or of another scalar",
    "other_model": "its law is not the one that this noslip derives; use the noslip and the robot that "
    "generated the C",
}


class FollowerInC(InC):
    """The generated C of a follower in one scalar, compiled; `law` is its law."""

    def __init__(self, robot: str, scalar: str):
        system = system_of(find_robot(robot))
        if LAW not in find_laws(system) or not has_follower(law_of(system, LAW)):
            raise BadInput(f"{why_no_follower(system)}; it has no follower")
        self.law: ControlLaw = law_of(system, LAW)
        self.scalar = scalar
        self._own = system.mechanism.name
        files = {
            name: text
            for name, text in robot_files(system, [self.law], (scalar,)).items()
            if name[-2:] in (".h", ".c")
        }
        with TemporaryDirectory() as folder:
            write_folder(Path(folder, "c"), files)
            self.ffi = knowing(
                declarations(SCALARS[scalar].name(f"{self._own}_telemetry") + ".h", Path(folder, "c"))
            )
        self.lib = load(self.ffi, files)

    def new(self, kind: str) -> Any:
        """Return a new struct of the follower: "" for itself, or config, tuning."""
        name = f"{self._own}_{NAME}_{kind}" if kind else f"{self._own}_{NAME}"
        return self.ffi.new(f"{SCALARS[self.scalar].name(name)} *")

    def call(self, function: str, *arguments: Any) -> int:
        """Call a function of the follower; return its status."""
        return getattr(self.lib, SCALARS[self.scalar].name(f"{self._own}_{NAME}_{function}"))(*arguments)

    def config(self, image: bytes, where: str) -> tuple[Any, Any]:
        """Return the config of an image and its segments, which must be kept. Raises BadInput if it is not
        one for this C."""
        config, count = (
            self.new("config"),
            ROWS.unpack_from(image.ljust(ROWS_AT + ROWS.size, b"\0"), ROWS_AT)[0],
        )
        segments = self.ffi.new(f"{SCALARS[self.scalar].name('noslip_segment')}[]", min(count, len(image)))
        status = self.call("load", config, segments, len(segments), image, len(image))
        if status < 0:
            name = self.status(status)
            raise BadInput(f"{where}: the config cannot be used: {REFUSED.get(name, name)}")
        return config, segments

    def reals(self, count: int) -> Any:
        """Return a new array of reals."""
        return self.ffi.new(f"{self.scalar}[{count}]")

    def apply(self, event: Event, follower: Any) -> int:
        """Repeat what was done between two ticks; return its status. Raises BadInput if it cannot be read."""
        if event.kind == Kind.RESET:
            return self.call("reset", follower)
        if event.kind == Kind.CORRECT:
            real = "d" if self.scalar == "double" else "f"
            try:
                *pose, mode = struct.unpack(f"<3{real}i", event.content)
            except struct.error as error:
                raise BadInput(
                    f"a correction before row {event.row} has {len(event.content)} bytes"
                ) from error
            truth = self.ffi.new(f"{SCALARS[self.scalar].name('noslip_pose')} *", pose)
            return self.call("correct", follower, truth, mode)
        tuning = self.new("tuning")
        status = self.call("load_tuning", tuning, event.content, len(event.content))
        if status < 0:
            raise BadInput(f"an update before row {event.row} cannot be used: {self.status(status)}")
        parts = (self.ffi.addressof(tuning, name) for name in ("params", "gains", "limits"))
        return self.call("update", follower, *parts)

    def records(self) -> tuple[Any, np.dtype]:
        """Return a new record, and its layout in memory as a type with the fields of `record_type`."""
        kind, wire = SCALARS[self.scalar].name("noslip_record"), record_type(self.scalar)
        names = list(wire.names or ())
        places: Any = {
            "names": names,
            "formats": [wire[name] for name in names],
            "offsets": [self._offset(kind, name) for name in names],
            "itemsize": self.ffi.sizeof(kind),
        }
        return self.ffi.new(f"{kind} *"), np.dtype(places)

    def _offset(self, kind: str, path: str) -> int:
        offset, place = 0, self.ffi.typeof(kind)
        for name in path.split("."):
            member = dict(place.fields)[name]
            offset, place = offset + member.offset, member.type
        return offset


@lru_cache(maxsize=4)
def follower_in_c(robot: str, scalar: str) -> FollowerInC:
    """Return the compiled follower of a robot, loaded once per process. Raises BadInput if it has none."""
    return FollowerInC(robot, scalar)


def vehicle_of(start: Start, robot: str | None, where: str) -> FollowerInC:
    """Return the compiled follower of a start: that of `robot`,
    or of the shipped one that the dump names. Raises BadInput."""
    name = robot or start.robot
    if not name:
        raise BadInput(f"{where}: it does not name its robot; give --robot")
    try:
        return follower_in_c(name, start.scalar)
    except BadInput as error:
        if robot is None:
            raise BadInput(f"{where}: {error}; give --robot path/to/file.py:name") from error
        raise
