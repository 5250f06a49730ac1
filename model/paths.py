"""Paths given as f(x, y) = 0: signed distance h1 of a point from the path, in m."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import casadi as ca

from .algebra.operations import refuse_jumps
from .errors import ModelError
from .mechanism import Quantity, quantity, scalar


def _no_foot(distance: ca.SX, curvature: ca.SX) -> tuple[ca.SX, ...]:
    raise ModelError("the path has no parameters relative to its foot: it does not define a unit normal")


@dataclass(frozen=True, eq=False)
class Path:
    """A curve and its parameters. `distance(x, y)` is zero on it and has a unit gradient there.

    `unit_normal(x, y)` returns the gradient of an exact distance, 1 x 2, and the curvature of the parallel
    curve through the point (1/m, positive if the gradient points away from the centre), if these are shorter
    than the derivatives of `distance`. `from_foot(distance, curvature)`, for a path with a unit normal,
    returns the parameters of the path in the frame at a foot, with x along the path and y in the direction of
    increasing distance, such that the parallel curve at that distance has that curvature. For other paths it
    raises ModelError. `moving`: the parameters are those of the path's point nearest to P_l, and change as it
    moves along the path.
    """

    kind: str
    about: str
    parameters: tuple[Quantity, ...]
    distance: Callable[[ca.SX, ca.SX], ca.SX]
    conditions: tuple[tuple[ca.SX, str], ...] = ()  # (expression that must be positive, what it means)
    unit_normal: Callable[[ca.SX, ca.SX], tuple[ca.SX, ca.SX]] | None = None
    from_foot: Callable[[ca.SX, ca.SX], tuple[ca.SX, ...]] = _no_foot
    moving: bool = False


def config(name: str, default: float, unit: str, about: str, sign: str = "any") -> Quantity:
    """Return a parameter of an output map; its symbol is marked,
    to distinguish it from those of the robot."""
    return replace(quantity(name, unit, about, default, sign), symbol=ca.SX.sym(f"config.{name}"))


def line() -> Path:
    """Return the line A x + B y + C = 0; the distance is exact, and positive on the side to which (A,
    B) points."""
    A = config("A", 1.0, "1", "line A x + B y + C = 0")
    B = config("B", -1.0, "1", "line A x + B y + C = 0")
    C = config("C", 0.0, "m", "line A x + B y + C = 0")
    norm_squared = A.symbol**2 + B.symbol**2

    def distance(x: ca.SX, y: ca.SX) -> ca.SX:
        inverse = 1 / ca.sqrt(norm_squared)
        return (A.symbol * inverse) * x + (B.symbol * inverse) * y + C.symbol * inverse

    return Path("line", "line", (A, B, C), distance, ((norm_squared, "A and B are both zero: not a line"),))


def circle() -> Path:
    """Return the circle of radius R about (x_f, y_f); the distance is exact, and positive outside."""
    x_f = config("x_f", 20.0, "m", "centre of the circle")
    y_f = config("y_f", 20.0, "m", "centre of the circle")
    R = config("R", 10.0, "m", "radius of the circle", "positive")

    def distance(x: ca.SX, y: ca.SX) -> ca.SX:
        return ca.sqrt((x - x_f.symbol) ** 2 + (y - y_f.symbol) ** 2) - R.symbol

    return Path("circle", "circle", (x_f, y_f, R), distance)


def segment() -> Path:
    """Return the line or arc through a point, with its direction there and its curvature; exact distance,
    positive to the left.

    One law serves all segments of a composite path: the distance is regular also for zero curvature.
    """
    x_s = config("x_s", 0.0, "m", "a point of the line or arc")
    y_s = config("y_s", 0.0, "m", "a point of the line or arc")
    direction = config("direction", 0.0, "rad", "direction of travel at that point")
    curvature = config("curvature", 0.0, "1/m", "curvature, positive turns left, 0 is a line")

    cosine, sine = ca.cos(direction.symbol), ca.sin(direction.symbol)

    def from_centre(x: ca.SX, y: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Return the vector from the centre in units of the radius, along the direction and to its right,
        and its length."""
        dx, dy = x - x_s.symbol, y - y_s.symbol
        along, out = (
            curvature.symbol * (cosine * dx + sine * dy),
            1 - curvature.symbol * (cosine * dy - sine * dx),
        )
        return along, out, ca.sqrt(along**2 + out**2)

    def distance(x: ca.SX, y: ca.SX) -> ca.SX:
        along, out, radii = from_centre(x, y)
        dx, dy = x - x_s.symbol, y - y_s.symbol
        return ((cosine * dy - sine * dx) * (1 + out) - (cosine * dx + sine * dy) * along) / (1 + radii)

    def unit_normal(x: ca.SX, y: ca.SX) -> tuple[ca.SX, ca.SX]:
        along, out, radii = from_centre(x, y)
        return ca.horzcat(
            -sine * out - cosine * along, cosine * out - sine * along
        ) / radii, -curvature.symbol / radii

    def from_foot(beside: ca.SX, bend: ca.SX) -> tuple[ca.SX, ...]:
        return ca.SX(0), ca.SX(0), ca.SX(0), bend / (1 + bend * beside)

    return Path(
        "segment", "line or arc", (x_s, y_s, direction, curvature), distance, (), unit_normal, from_foot
    )


def implicit(
    kind: str, about: str, parameters: tuple[Quantity, ...], f: Callable[[ca.SX, ca.SX], ca.SX]
) -> Path:
    """Return any curve f(x, y) = 0, with the first-order distance f / |grad f|: zero and of unit gradient on
    the curve.

    Raises ModelError if f does not depend on the point.
    """

    def distance(x: ca.SX, y: ca.SX) -> ca.SX:
        point = ca.SX.sym("point", 2)
        value = scalar(f(point[0], point[1]), f"path {kind!r}: f(x, y)")
        refuse_jumps(value, point, f"path {kind!r}: f(x, y)")
        gradient = ca.gradient(value, point)
        if gradient.is_zero():
            raise ModelError(f"path {kind!r}: f(x, y) does not depend on x or y")
        return ca.substitute(value / ca.sqrt(ca.sumsqr(gradient)), point, ca.vertcat(x, y))

    return Path(kind, about, parameters, distance)


def ellipse() -> Path:
    """Return (x/a)^2 + (y/b)^2 = 1 about the origin, an example of an implicit curve; positive outside.

    A factor of f does not change f / |grad f|; with this one x has the coefficient 1 in the gradient.
    """
    a = config("a", 4.0, "m", "half axis of the ellipse along x", "positive")
    b = config("b", 2.0, "m", "half axis of the ellipse along y", "positive")

    def f(x: ca.SX, y: ca.SX) -> ca.SX:
        return (x**2 + a.symbol**2 / b.symbol**2 * y**2 - a.symbol**2) / 2

    return implicit("ellipse", "ellipse, f / |grad f|", (a, b), f)


SMOOTH = 4  # derivatives of the curvature of a course that are continuous; see simulation/planning/course.py


def course() -> Path:
    """Return a curve of any curvature, given at its point nearest to P_l: place, direction, curvature and its
    derivatives by the length along it. These are parameters that change with every step. The distance is
    exact there, and positive to the left.
    """
    x_s = config("x_s", 0.0, "m", "the point of the course nearest to P_l")
    y_s = config("y_s", 0.0, "m", "the point of the course nearest to P_l")
    direction = config("direction", 0.0, "rad", "direction of travel there")
    curvature = config("curvature", 0.2, "1/m", "curvature there, positive turns left")
    rates = [
        config(
            f"curvature_{k}",
            0.0,
            f"1/m^{k + 1}",
            f"derivative {k} of the curvature by the length along the course",
        )
        for k in range(1, SMOOTH + 1)
    ]
    cosine, sine = ca.cos(direction.symbol), ca.sin(direction.symbol)

    def distance(x: ca.SX, y: ca.SX) -> ca.SX:
        return cosine * (y - y_s.symbol) - sine * (x - x_s.symbol)

    return Path(
        "course",
        "course of changing curvature",
        (x_s, y_s, direction, curvature, *rates),
        distance,
        moving=True,
    )


PATHS: dict[str, Callable[[], Path]] = {
    "line": line,
    "circle": circle,
    "ellipse": ellipse,
    "segment": segment,
}
"""Every path with a law of Type IV, by its kind."""
