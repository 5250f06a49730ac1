"""A desired angle shifted by whole turns to be nearest to the actual one, as by `noslip_nearest_angle`."""

import math


def nearest_angle(desired: float, actual: float) -> float:
    """Return the angle (rad) that differs from `desired` by whole turns and is nearest to `actual`."""
    turns = round((desired - actual) / (2 * math.pi))
    return desired - turns * 2 * math.pi
