"""Sections of a SPEC whose controller is a state feedback about a steady motion, and pushes."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ...readers.reading import each_of, entry, named_numbers, number, one_or_more, reads, text

NAMES = {"type": "array", "items": {"type": "string"}}


@reads(NAMES)
def _names(value: Any, where: str) -> tuple[str, ...]:
    """Read a list of names."""
    return each_of(text, value, where, "a list of names")


@dataclass(frozen=True, kw_only=True)
class FeedbackSection:
    """A state feedback instead of an output map, for a robot with fewer inputs than degrees of freedom:
    tau_e - K (x - x_d), whose gains minimize the integral of the weighted squares of deviations and inputs.
    About rest, or about the steady `motion` with these quasi-velocities and coordinates.
    """

    weights: Mapping[str, float] = entry(
        named_numbers, about="of the squares of these states, by name; others have 0"
    )
    effort: tuple[float, ...] = entry(
        one_or_more, (1.0,), "weight of the square of each input, or one for all"
    )
    without: tuple[str, ...] = entry(_names, (), "states that the gains do not use, such as angles of wheels")
    motion: Mapping[str, float] = entry(
        named_numbers, {}, "the steady motion, by name; without any the robot rests"
    )


@dataclass(frozen=True, kw_only=True)
class Command:
    """A part of the desired motion in a given `time`, from standstill to standstill: a `distance` along an
    arc that turns by `turn`; a line, a turn on the spot, or standing where one of them, or both, are 0.
    """

    time: float = entry(number("positive", "s"), about="how long it takes")
    distance: float = entry(number(unit="m"), 0.0, "along its arc; negative: in reverse")
    turn: float = entry(number(unit="rad"), 0.0, "of the heading, to the left")


@dataclass(frozen=True, kw_only=True)
class Push:
    """A disturbance: at `time` an impulse acts on the robot along a quasi-velocity, such as that of a push at
    the axle along its speed.
    """

    time: float = entry(number("nonnegative", "s"), about="at which it acts")
    on: str = entry(text, about="the quasi-velocity, by name")
    impulse: float = entry(
        number(unit="1"), about="N s along a quasi-velocity in m/s, N m s along one in rad/s"
    )
