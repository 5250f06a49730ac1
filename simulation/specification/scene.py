"""Section [scene] of a SPEC: a robot in a scene of the user's own, an MJCF or a URDF,
for a run in a physics engine."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ...readers.errors import BadInput
from ...readers.reading import entry, reads, table, text


@reads({"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}, "minItems": 1}]})
def _names(value: Any, where: str) -> tuple[str, ...]:
    """Read a name or a list of names."""
    if isinstance(value, list) and not value:
        raise BadInput(f"{where} is empty: give a name, or several")
    return tuple(text(item, where) for item in value) if isinstance(value, list) else (text(value, where),)


@reads({"type": "object", "additionalProperties": _names.schema()})
def _named(value: Any, where: str) -> dict[str, tuple[str, ...]]:
    """Read a table of names."""
    return {key: _names(item, f"{where} {key}") for key, item in table(value, where).items()}


@dataclass(frozen=True, kw_only=True)
class SceneSection:
    """A robot in a physics engine that is described by a file of its own, with its shapes, friction and
    motors, instead of being made from the robot's equations. A name that is missing in `joints` and `wheels`
    is that of the file, and one that is missing in `motors`, too, if the file has a motor of that name on its
    joint; otherwise the input acts on the joint.
    """

    file: str = entry(
        text, about="an MJCF whose robot has a free joint, or a URDF; looked for beside the SPEC first"
    )
    joints: Mapping[str, tuple[str, ...]] = entry(
        _named,
        {},
        "coordinate: its joint in the file, or several whose mean it is, such as both steered wheels",
    )
    wheels: Mapping[str, tuple[str, ...]] = entry(
        _named, {}, "contact whose wheel turns by no coordinate: the joint of this wheel, or of several"
    )
    motors: Mapping[str, tuple[str, ...]] = entry(
        _named, {}, "input: the motor (<actuator>) that supplies it, or several that share it"
    )
