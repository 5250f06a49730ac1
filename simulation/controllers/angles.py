"""A desired angle shifted by whole turns to be nearest to the actual one: in Python, and by the C."""

import math

HEADER = "noslip_angle.h"


def nearest_angle(desired: float, actual: float) -> float:
    """Return the angle (rad) that differs from `desired` by whole turns and is nearest to `actual`."""
    turns = round((desired - actual) / (2 * math.pi))
    return desired - turns * 2 * math.pi


def compiled_nearest_angle(desired: float, actual: float, scalar: str = "double") -> float:
    """Return the same, computed by the C. Raises BadInput if it returns an error."""
    from .runtime import runtime  # slow to import

    made = runtime(HEADER)
    answer = made.array(scalar, [0.0])
    made.call(
        f"angle nearest to {actual:g}, of {desired:g}",
        "noslip_nearest_angle",
        scalar,
        desired,
        actual,
        answer,
    )
    return answer[0]
