"""Section [floor] of a SPEC: friction, slope and bumps of the floor of a run in a physics engine."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ...readers.errors import BadInput
from ...readers.reading import Section, angle, ascending, entry, list_of, number, reads, row, section, whole

STEEPEST = 1.0  # rad, of a floor
SHORTEST, LONGEST = 1e-5, 2e-3  # s; contacts give way with a time constant of twice the longest
MOST_BUMPS = 1000  # each is a body that the engine looks at in every step


_interval = ascending(number(unit="m"))


@dataclass(frozen=True, kw_only=True)
class Patch:
    """A rectangle of the floor, x from x[0] to x[1] and y from y[0] to y[1] (m),
    with a friction coefficient of its own."""

    x: tuple[float, ...] = entry(_interval, about="from a to b")
    y: tuple[float, ...] = entry(_interval, about="from a to b")
    mu: float = entry(number("nonnegative", "1"), about="friction coefficient")


@dataclass(frozen=True, kw_only=True)
class Bump:
    """A cap of a sphere that rises from the floor: `height` (m) in its middle at x, y (m),
    on a circle of a `radius` (m)."""

    x: float = entry(number(unit="m"), about="middle")
    y: float = entry(number(unit="m"), about="middle")
    height: float = entry(number("positive", "m"), about="of its middle, at most the radius")
    radius: float = entry(number("positive", "m"), about="of the circle in which it meets the floor")

    def __post_init__(self):
        if self.height > self.radius:
            raise BadInput(
                f"[floor] bump: height = {self.height:g} must be at most its radius, {self.radius:g}"
            )

    @property
    def curvature(self) -> float:
        """Radius of its sphere, m."""
        return (self.radius**2 + self.height**2) / (2 * self.height)

    def at(self, x: float, y: float) -> float:
        """Return its height above the floor at a place, m; 0 beside it."""
        aside = (x - self.x) ** 2 + (y - self.y) ** 2
        return (
            math.sqrt(self.curvature**2 - aside) - self.curvature + self.height
            if aside < self.radius**2
            else 0.0
        )


@dataclass(frozen=True, kw_only=True)
class Rough:
    """Bumps of one `radius` at `count` random places in a rectangle, evenly distributed,
    as are their heights up to `height`."""

    count: int = entry(whole(1, MOST_BUMPS), about=f"how many bumps, at most {MOST_BUMPS}")
    x: tuple[float, ...] = entry(_interval, about="from a to b")
    y: tuple[float, ...] = entry(_interval, about="from a to b")
    height: float = entry(number("positive", "m"), about="of the highest possible, at most the radius")
    radius: float = entry(number("positive", "m"), about="of the circle in which each meets the floor")
    seed: int = entry(whole(0), 0, "seed of the random numbers: the same seed, the same floor")

    def __post_init__(self):
        if self.height > self.radius:
            raise BadInput(
                f"[floor] rough: height = {self.height:g} must be at most the radius, {self.radius:g}"
            )

    def bumps(self) -> tuple[Bump, ...]:
        """Return the bumps."""
        x, y, part = np.random.default_rng(self.seed).random((3, self.count)).tolist()
        return tuple(
            Bump(
                x=self.x[0] + a * (self.x[1] - self.x[0]),
                y=self.y[0] + b * (self.y[1] - self.y[0]),
                height=(1.0 - c) * self.height,  # above 0, as random numbers are below 1
                radius=self.radius,
            )
            for a, b, c in zip(x, y, part, strict=True)
        )


@reads(
    {"anyOf": [angle.schema(), row("[angle, heading]", angle, angle).schema()], "description": "in rad"},
    "rad",
)
def _slope(value: Any, where: str) -> tuple[float, float]:
    """Read an angle below the horizontal, or with it the heading of the way down."""
    made = row("[angle, heading]", angle, angle)(value if isinstance(value, list) else [value, 0.0], where)
    if not abs(made[0]) < STEEPEST:
        raise BadInput(f"{where} = {made[0]:g} rad is too steep to stand on; give less than {STEEPEST:g}")
    return made


@dataclass(frozen=True, kw_only=True)
class Floor(Section):
    """The floor of a run in a physics engine."""

    mu: float | None = entry(
        number("nonnegative", "1"), None, "friction coefficient, by default that of [contact]"
    )
    slope: tuple[float, float] = entry(
        _slope, (0.0, 0.0), "angle below the horizontal, or [angle, heading of the way down]"
    )
    patch: tuple[Patch, ...] = entry(
        list_of(Patch, "{ x = [0, 1], y = [-1, 1], mu = 0.2 }"),
        (),
        "rectangles with a friction coefficient of their own; the last one counts",
    )
    bump: tuple[Bump, ...] = entry(
        list_of(Bump, "{ x = 1, y = 0, height = 0.01, radius = 0.2 }"), (), "caps that rise from it"
    )
    rough: Rough | None = entry(section(Rough), None)
    step: float = entry(
        number("positive", "s", least=SHORTEST, most=LONGEST),
        1e-3,
        f"longest step of the engine, {SHORTEST:g} to {LONGEST:g}",
    )

    def __post_init__(self):
        super().__post_init__()
        if len(self.bump) > MOST_BUMPS:
            raise BadInput(f"[floor] bump: {len(self.bump)} are more than {MOST_BUMPS}")

    def height(self, x: float, y: float) -> float:
        """Return the height of the bumps at a place, m; 0 beside them. All lengths in m."""
        return max((bump.at(x, y) for bump in self.bumps), default=0.0)

    @cached_property
    def bumps(self) -> tuple[Bump, ...]:
        """All bumps: those listed, then the random ones."""
        return (*self.bump, *(self.rough.bumps() if self.rough else ()))
