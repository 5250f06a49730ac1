"""Lines and arcs, the segments of composite paths."""

import math
from dataclasses import dataclass

from .algebra.trigonometry import angle_of, sine, sine_cosine


@dataclass(frozen=True)
class Segment:
    """A line or an arc from (x, y) in the direction of travel `heading`, with `curvature` and `length`.

    m, rad, 1/m (positive turns left, 0 is a line). `backward`: the vehicle drives it in reverse, with its
    heading opposite to the direction of travel.
    """

    x: float
    y: float
    heading: float
    curvature: float
    length: float
    backward: bool = False

    def pose(self, s: float) -> tuple[float, float, float]:
        """Return point and direction of travel s metres from the start;
        the line or circle continues beyond both ends."""
        half = self.curvature * s / 2
        chord = s * (sine(half) / half if half else 1.0)
        s, c = sine_cosine(self.heading + half)
        return self.x + chord * c, self.y + chord * s, self.heading + 2 * half

    @property
    def end(self) -> tuple[float, float, float]:
        """Return point and direction of travel at the end."""
        return self.pose(self.length)

    def places(self, count: int) -> list[tuple[float, float]]:
        """Return `count` points, m, evenly spaced from its start to its end, both included."""
        return [self.pose(self.length * k / (count - 1))[:2] for k in range(count)]

    def distance(self, x: float, y: float) -> float:
        """Return the signed distance of a point from the whole line or circle, m; positive to the left of the
        direction of travel.
        """
        along, left = self._seen_from_start(x, y)
        from_centre = math.hypot(self.curvature * along, 1 - self.curvature * left)  # in units of the radius
        return (2 * left - self.curvature * (along * along + left * left)) / (1 + from_centre)

    def progress(self, x: float, y: float, near: float = 0.0) -> float:
        """Return the position of the point's foot, m from the start;
        on an arc of several turns the one nearest to `near`."""
        along, left = self._seen_from_start(x, y)
        if not self.curvature:
            return along
        turn = math.copysign(2 * math.pi, self.curvature)
        turned = angle_of(self.curvature * along, 1 - self.curvature * left)
        laps = round((near * self.curvature - turned) / turn)
        return (turned + laps * turn) / self.curvature

    def _seen_from_start(self, x: float, y: float) -> tuple[float, float]:
        """Return the coordinates along the direction of travel at the start, and to its left."""
        s, c = sine_cosine(self.heading)
        dx, dy = float(x - self.x), float(y - self.y)
        return c * dx + s * dy, c * dy - s * dx
