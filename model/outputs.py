"""Output maps y = h(q) or h(q, nu): what the controller makes follow a reference (14).

Types I to IV of the paper for any vehicle that moves in a plane. P_l is the point a distance L ahead of the vehicle's
point along its heading.
"""

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca

from .errors import ModelError
from .exact import canonical
from .mechanism import Quantity, quantity, refuse_strangers, refuse_twice, scalar
from .paths import Path, circle, config, ellipse, line
from .reduction import ReducedSystem


@dataclass(frozen=True, eq=False)
class Through:
    """An output as outer(z), z = inner(q), such as a distance of a point: the chain rule in two short steps."""

    symbols: ca.SX
    inner: ca.SX
    outer: ca.SX


@dataclass(frozen=True, eq=False)
class OutputRow:
    """One output: a scalar expression in q, nu, the robot's parameters and the map's own."""

    name: str
    unit: str
    about: str
    expression: ca.SX
    through: Through | None = None


@dataclass(frozen=True, eq=False)
class OutputMap:
    """n-m outputs with the parameters they bring along. `path` is the curve followed, for Type IV."""

    name: str
    about: str
    rows: tuple[OutputRow, ...]
    parameters: tuple[Quantity, ...] = ()
    conditions: tuple[tuple[ca.SX, str], ...] = ()
    path: Path | None = None

    def check(self, system: ReducedSystem) -> None:
        """Raise ModelError for names that C cannot take or that come twice, and for rows not of q, nu and parameters."""
        where = f"{system.mechanism.name}, output {self.name}"
        quantity(self.name, "")
        refuse_twice([row.name for row in self.rows], where)
        refuse_twice([parameter.name for parameter in self.parameters], f"{where}, parameters")
        fixed = ca.vertcat(system.mechanism.p, *[parameter.symbol for parameter in self.parameters])
        known = ca.vertcat(system.mechanism.q, system.nu, fixed)
        for row in self.rows:
            quantity(row.name, row.unit, row.about)
            place = f"{where}: {row.name}"
            expression = scalar(row.expression, place)
            if ca.depends_on(expression, system.mechanism.qdot):
                rates = " ".join(str(s) for s in ca.symvar(expression) if ca.depends_on(system.mechanism.qdot, s))
                raise ModelError(
                    f"{place} uses {rates}: write outputs in q and nu; system.along_motion(f) is the rate of f(q) in these"
                )
            refuse_strangers(expression, known, place, "coordinate, quasi-velocity or parameter of the robot or the output map")
        for condition, meaning in self.conditions:
            refuse_strangers(scalar(condition, f"{where}: condition"), fixed, f"{where}: condition {meaning!r}", "parameter")


def type_i(system: ReducedSystem) -> OutputMap:
    """Type I: the position of P_l."""
    L = look_ahead()
    return OutputMap("type_i", "Type I: position of P_l", (_x(system, L), _y(system, L)), (L,))


def type_ii(system: ReducedSystem) -> OutputMap:
    """Type II: x of P_l and the heading."""
    L = look_ahead()
    return OutputMap("type_ii", "Type II: x of P_l and heading", (_x(system, L), _heading(system)), (L,))


def type_iii(system: ReducedSystem) -> OutputMap:
    """Type III: y of P_l and the heading."""
    L = look_ahead()
    return OutputMap("type_iii", "Type III: y of P_l and heading", (_y(system, L), _heading(system)), (L,))


def type_iv(system: ReducedSystem, path: Path) -> OutputMap:
    """Type IV: signed distance of P_l from a path, and the forward speed."""
    L = look_ahead()
    distance = at_point(system, L, "distance", "signed distance of P_l from the path", path.distance)
    speed = OutputRow("speed", "m/s", "forward speed", forward_speed(system))
    name, about = f"type_iv_{path.kind}", f"Type IV: path following, {path.about}"
    return OutputMap(name, about, (distance, speed), (L, *path.parameters), path.conditions, path)


OUTPUTS: dict[str, Callable[[ReducedSystem], OutputMap]] = {
    "type_i": type_i,
    "type_ii": type_ii,
    "type_iii": type_iii,
    "type_iv_line": lambda system: type_iv(system, line()),
    "type_iv_circle": lambda system: type_iv(system, circle()),
    "type_iv_ellipse": lambda system: type_iv(system, ellipse()),
}


def look_ahead() -> Quantity:
    """L, how far P_l lies ahead of the vehicle's point (negative: behind)."""
    return config("L", 0.0, "m", "distance of the reference point P_l ahead of the vehicle's point")


def reference_point(system: ReducedSystem, L: Quantity) -> tuple[ca.SX, ca.SX]:
    """P_l in the world, m."""
    vehicle = _vehicle(system)
    return vehicle.x + L.symbol * ca.cos(vehicle.heading), vehicle.y + L.symbol * ca.sin(vehicle.heading)


def forward_speed(system: ReducedSystem) -> ca.SX:
    """Velocity of the vehicle's point along its heading, m/s, as a function of q and nu."""
    vehicle = _vehicle(system)
    x_dot, y_dot = system.along_motion(vehicle.x), system.along_motion(vehicle.y)
    return canonical(ca.cos(vehicle.heading) * x_dot + ca.sin(vehicle.heading) * y_dot)


def _vehicle(system: ReducedSystem):
    if system.mechanism.vehicle is None:
        raise ModelError(
            f"{system.mechanism.name}: Types I to IV need to know where the vehicle is; call moves_in_plane(x, y, heading)"
        )
    return system.mechanism.vehicle


def at_point(system: ReducedSystem, L: Quantity, name: str, about: str, outer: Callable[[ca.SX, ca.SX], ca.SX]) -> OutputRow:
    """An output in m that is a function of where P_l is."""
    point = ca.vertcat(*reference_point(system, L))
    symbols = ca.vertcat(ca.SX.sym("x_l"), ca.SX.sym("y_l"))
    return OutputRow(name, "m", about, outer(point[0], point[1]), Through(symbols, point, outer(symbols[0], symbols[1])))


def _x(system: ReducedSystem, L: Quantity) -> OutputRow:
    return at_point(system, L, "x_l", "x of P_l", lambda x, y: x)


def _y(system: ReducedSystem, L: Quantity) -> OutputRow:
    return at_point(system, L, "y_l", "y of P_l", lambda x, y: y)


def _heading(system: ReducedSystem) -> OutputRow:
    return OutputRow("heading", "rad", "heading", _vehicle(system).heading)
