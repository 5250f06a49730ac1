"""Lines that show a robot from above, in its coordinates and parameters: what `Mechanism.draws` takes."""

from collections.abc import Sequence

from casadi import SX, cos, sin

Place = tuple[SX | float, SX | float]  # m
Line = list[Place]


def placed(at: Place, heading: SX | float, points: Sequence[Place]) -> Line:
    """Points given ahead of and to the left of a place, m, in the plane."""
    c, s = cos(heading), sin(heading)
    return [(at[0] + c * ahead - s * left, at[1] + s * ahead + c * left) for ahead, left in points]


def box(at: Place, heading: SX | float, behind: SX | float, ahead: SX | float, half: SX | float) -> Line:
    """The closed outline of a body that reaches so far behind and ahead of a place,
    `half` to each side, m."""
    return placed(
        at, heading, [(-behind, -half), (ahead, -half), (ahead, half), (-behind, half), (-behind, -half)]
    )


def wheels(at: Place, heading: SX | float, half: SX | float, radius: SX | float) -> list[Line]:
    """The two wheels of an axle with its middle at a place, each `half` (m) beside it."""
    return [placed(at, heading, [(-radius, side), (radius, side)]) for side in (-half, half)]
