"""C that saves and loads the config of a follower, and records its ticks."""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace

from ...model.law import ControlLaw
from ...readers.templates import render
from ..follower.follower import NAME, fitted, measured_names
from ..printing.scalar import Scalar
from ..runtime import runtime_files
from .members import Member, Structs, described, joined

# What the follower's `update` changes: members of config and follower alike
IN_USE = ("params.", "gains.", "limits.")
HEAD = 28  # bytes of an image beside its numbers, see noslip_image.h


def telemetry_files(
    law: ControlLaw, scalar: Scalar, banner: Sequence[str], model: str, files: Mapping[str, str]
) -> dict[str, str]:
    """Return file name -> text of header and source for a law that has a follower.

    `model` is its SHA-256; `files` are the texts of the robot's headers, with its structs.
    """
    robot = law.system.mechanism.name
    own = scalar.name(f"{robot}_telemetry")
    config, segments = layout(robot, scalar, files)
    in_use = [member for member in config if member.path.startswith(IN_USE)]
    values = {
        "robot": robot,
        "law": f"{robot}_{law.name}",
        "own": scalar.name,
        "real": scalar.real,
        "banner": banner,
        "fields": joined(config),
        "in_use": joined(in_use),
        "row": joined(segments),
        "size": HEAD + _bytes(config, scalar),
        "in_use_size": HEAD + _bytes(in_use, scalar),
        "row_size": _bytes(segments, scalar),
        "hash": zlib.crc32(described({"config": config, "segment": segments}).encode()),
        "in_use_hash": zlib.crc32(described({"in use": in_use}).encode()),
        "model": int(model[:8], 16),
        "rates": measured_names(law.system),
    }
    return {f"{own}.{kind}": fitted(render(__file__, f"telemetry.{kind}", **values)) for kind in "hc"}


def layout(robot: str, scalar: Scalar, files: Mapping[str, str]) -> tuple[list[Member], list[Member]]:
    """Return the members of the follower's config and those of a segment, in the order of an image."""
    structs = Structs([text for name, text in {**runtime_files(), **files}.items() if name.endswith(".h")])
    config = [
        # The number of segments, which the image has anyway
        replace(each, count=0) if each.path == "count" else each
        for each in structs.members(scalar.name(f"{robot}_{NAME}_config"))
    ]
    return config, list(structs.members(scalar.name("noslip_segment")))


def _bytes(members: Sequence[Member], scalar: Scalar) -> int:
    real = 8 if scalar.real == "double" else 4
    return sum(each.count * (real if each.real else 4) for each in members)
