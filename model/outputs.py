"""Output maps y = h(q) or h(q, nu): the quantities that the controller makes follow a reference (14).

Types I to IV of the paper, for any vehicle that moves in a plane. P_l is a point of the vehicle: a distance L
ahead of the vehicle's point along its heading and, optionally, W to the left.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import casadi as ca

from .algebra.exact import canonical
from .algebra.operations import refuse_jumps, refuse_unsupported
from .algebra.samples import Sampled
from .errors import ModelError
from .mechanism import Mechanism, Output, Quantity, quantity, refuse_strangers, refuse_twice, scalar
from .names import (
    LawName,
    without_arclength,
    without_damping,
    without_extension,
    without_kinematic,
    without_offset,
)
from .paths import PATHS, SMOOTH, Path, config, course
from .reduction import ReducedSystem, counted


@dataclass(frozen=True, eq=False)
class Through:
    """An output outer(z) with z = inner(q), such as the distance of a point from a path: the chain rule in
    two short steps.

    If outer is an exact distance, `slope` may give its gradient with respect to z, a unit row, and `bend` the
    curvature of its level sets.
    """

    symbols: ca.SX
    inner: ca.SX
    outer: ca.SX
    slope: ca.SX | None = None
    bend: ca.SX | None = None


@dataclass(frozen=True, eq=False)
class OutputRow:
    """One output: a scalar expression in q, nu, the robot's parameters and the map's own."""

    name: str
    unit: str
    about: str
    expression: ca.SX
    through: Through | None = None
    of_foot: ca.SX | None = None  # the same in z of a CourseFoot and nu

    @property
    def in_motion(self) -> ca.SX:
        """Return the expression that is differentiated along the motion: in z of a CourseFoot,
        if there is one."""
        return self.expression if self.of_foot is None else self.of_foot


@dataclass(frozen=True, eq=False)
class CourseFoot:
    """The point of a course nearest to P_l, at `place` (m), and what moves with it, z: distance of P_l,
    heading relative to the direction of the course, curvature and its derivatives. `values` are z as
    functions of q and the parameters of the course.
    """

    place: ca.SX
    symbols: ca.SX
    values: ca.SX

    @property
    def distance(self) -> ca.SX:
        """The distance of P_l from the course, m."""
        return self.symbols[0]

    def at(self, expression: ca.SX) -> ca.SX:
        """Return an expression in z as a function of q and parameters."""
        return ca.substitute(expression, self.symbols, self.values)

    def up_to(self, curvatures: int) -> "CourseFoot":
        """Return the foot without curvature and derivatives of it, but for the first of these; a curvature
        that is not used counts as zero.
        """
        count = 2 + max(1, curvatures)
        values = self.values[:count] if curvatures else ca.vertcat(self.values[:2], 0)
        return replace(self, symbols=self.symbols[:count], values=values)

    def rates(self, along: ca.SX, aside: ca.SX, turning: ca.SX) -> ca.SX:
        """Return dz/dt from the velocity of P_l along the course and to its left (m/s), and the yaw rate of
        the heading.

        The last derivative of the curvature, which changes too, is taken to be constant: nothing that is used
        contains its rate.
        """
        distance, _, curvature, *others = ca.vertsplit(self.symbols)
        progress = along / (1 - curvature * distance)
        return ca.vertcat(aside, turning - curvature * progress, *[each * progress for each in others], 0)


FOOT = (
    Quantity(
        "distance", "m", "of P_l from the path, positive to the left", symbol=ca.SX.sym("foot.distance")
    ),
    Quantity(
        "cosine", "1", "of the heading relative to the path's direction", symbol=ca.SX.sym("foot.cosine")
    ),
    Quantity(
        "sine",
        "1",
        "of that angle, positive if the vehicle points to the left",
        symbol=ca.SX.sym("foot.sine"),
    ),
    Quantity(
        "curvature",
        "1/m",
        "of the parallel curve through P_l, positive turns left",
        symbol=ca.SX.sym("foot.curvature"),
    ),
)
"""Position of the vehicle relative to the foot of P_l on a path:
all that a law of Type IV needs to know about a path."""


@dataclass(frozen=True, eq=False)
class OutputMap:
    """n-m outputs, or with fewer inputs as many as these, with their additional parameters. `path` is the
    curve followed, for Type IV; `extension` allows a dynamic extension; a `kinematic` law commands
    quasi-velocities instead of inputs. With a `band`, one of the parameters, the inverse of Phi is damped
    where the cosine of the angle between heading and path is less.
    """

    name: str
    about: str
    rows: tuple[OutputRow, ...]
    parameters: tuple[Quantity, ...] = ()
    conditions: tuple[tuple[ca.SX, str], ...] = ()
    path: Path | None = None
    extension: bool = False
    kinematic: bool = False
    band: Quantity | None = None
    foot: CourseFoot | None = None

    def at_foot_values(self, expression: ca.SX) -> ca.SX:
        """Return an expression in z of the foot, if there is one, as a function of q and parameters."""
        return self.foot.at(expression) if self.foot else expression

    @property
    def required_path(self) -> Path:
        """Return the curve followed. Raises ModelError for outputs without one."""
        if self.path is None:
            raise ModelError(f"{self.name}: there is no path to follow; only Type IV has one")
        return self.path

    @property
    def at_foot(self) -> "OutputMap | None":
        """Return the same outputs in the frame at P_l's foot, with the parameters FOOT: y increases with the
        distance.

        In that frame cosine and sine of the heading are those in FOOT. None unless the path defines its unit
        normal, and with an extension.
        """
        if self.path is None or self.path.unit_normal is None or self.extension:
            return None
        distance, _, _, curvature = (q.symbol for q in FOOT)
        along_and_beside = ca.vertcat(ca.SX.sym("way"), ca.SX.sym("distance"))
        rows = [
            replace(
                row,
                expression=distance,
                through=Through(along_and_beside, row.through.inner, distance, ca.SX([[0, 1]]), -curvature),
            )
            if row.through
            else row
            for row in self.rows
        ]
        return replace(self, rows=tuple(rows))

    def check(self, system: ReducedSystem) -> None:
        """Raise ModelError for names that are invalid in C or occur twice, and for rows that do not depend on
        q, nu and parameters only.
        """
        where = f"{system.mechanism.name}, output {self.name}"
        quantity(self.name, "")
        refuse_twice([row.name for row in self.rows], where)
        refuse_twice([parameter.name for parameter in self.parameters], f"{where}, parameters")
        fixed = ca.vertcat(system.mechanism.p, *[parameter.symbol for parameter in self.parameters])
        symbols = ca.vertcat(system.mechanism.q, system.nu, fixed)
        for row in self.rows:
            quantity(row.name, row.unit, row.about)
            place = f"{where}: {row.name}"
            expression = scalar(row.expression, place)
            refuse_unsupported(expression, place)
            refuse_jumps(expression, system.nu, place)
            if ca.depends_on(expression, system.mechanism.qdot):
                rates = " ".join(
                    str(s) for s in ca.symvar(expression) if ca.depends_on(system.mechanism.qdot, s)
                )
                raise ModelError(
                    f"{place} uses {rates}: write outputs in q and nu; system.along_motion(f) is the rate of "
                    "f(q) in these"
                )
            refuse_strangers(
                expression,
                symbols,
                place,
                "coordinate, quasi-velocity or parameter of the robot or the output map",
            )
        for condition, meaning in self.conditions:
            value, place = scalar(condition, f"{where}: condition"), f"{where}: condition {meaning!r}"
            refuse_unsupported(value, place)
            refuse_strangers(value, fixed, place, "parameter")


def type_i(system: ReducedSystem, offset: bool = False) -> OutputMap:
    """Return Type I: the position of P_l. With `offset`, P_l may also lie beside the axis (as for Types II to
    IV)."""
    point = body_point(offset)
    return OutputMap(
        str(LawName("I")), "Type I: position of P_l", (_x(system, point), _y(system, point)), point
    )


def type_ii(system: ReducedSystem, offset: bool = False) -> OutputMap:
    """Return Type II: x of P_l and the heading."""
    point = body_point(offset)
    return OutputMap(
        str(LawName("II")), "Type II: x of P_l and heading", (_x(system, point), _heading(system)), point
    )


def type_iii(system: ReducedSystem, offset: bool = False) -> OutputMap:
    """Return Type III: y of P_l and the heading."""
    point = body_point(offset)
    return OutputMap(
        str(LawName("III")), "Type III: y of P_l and heading", (_y(system, point), _heading(system)), point
    )


def type_iv(system: ReducedSystem, path: Path, offset: bool = False) -> OutputMap:
    """Return Type IV: signed distance of P_l from a path, and the forward speed."""
    point = body_point(offset)
    about, foot = "signed distance of P_l from the path", None
    distance = at_point(system, point, "distance", about, path.distance, path.unit_normal)
    if path.moving:
        foot = _foot(system, point, path)
        distance = OutputRow(
            distance.name, distance.unit, distance.about, distance.expression, of_foot=foot.distance
        )
    speed = OutputRow("speed", "m/s", "forward speed", forward_speed(system))
    name, about = LawName("IV", path.kind), f"Type IV: path following, {path.about}"
    return OutputMap(
        str(name), about, (distance, speed), (*point, *path.parameters), path.conditions, path, foot=foot
    )


def _foot(system: ReducedSystem, point: tuple[Quantity, ...], path: Path) -> CourseFoot:
    """Return the foot of P_l on a path whose parameters are those of its point nearest to P_l."""
    x, y = place = reference_point(system, point)
    _, _, direction, *curvatures = (q.symbol for q in path.parameters)
    names = ("distance", "relative_heading", *(q.name for q in path.parameters[3:]))
    symbols = ca.vertcat(*[ca.SX.sym(f"foot.{name}") for name in names])
    heading = system.mechanism.required_vehicle.heading - direction
    return CourseFoot(ca.vertcat(*place), symbols, ca.vertcat(path.distance(x, y), heading, *curvatures))


def following(system: ReducedSystem, output: OutputMap) -> ReducedSystem:
    """Return the system with the foot of the output on a course, which moves with it; the system itself if
    there is none.

    Raises ModelError where surfaces move.
    """
    if (foot := output.foot) is None:
        return system
    if why := system.mechanism.why_carried:
        raise ModelError(f"{system.mechanism.name}, output {output.name}: {why}, as a course requires")
    heading = system.mechanism.required_vehicle.heading
    x_rate, y_rate = ca.vertsplit(system.along_motion(foot.place))
    cosine, sine = ca.cos(heading), ca.sin(heading)
    ahead, left = canonical(cosine * x_rate + sine * y_rate), canonical(cosine * y_rate - sine * x_rate)
    cosine, sine = ca.cos(foot.symbols[1]), ca.sin(foot.symbols[1])
    rates = foot.rates(
        cosine * ahead - sine * left, sine * ahead + cosine * left, system.along_motion(heading)
    )
    return replace(system, foot=(foot.symbols, ca.densify(ca.jacobian(rates, system.nu))))


OUTPUTS: dict[str, Callable[..., OutputMap]] = {
    str(LawName("I")): type_i,
    str(LawName("II")): type_ii,
    str(LawName("III")): type_iii,
    **{
        str(LawName("IV", kind)): lambda system, offset=False, path=path: type_iv(system, path(), offset)
        for kind, path in PATHS.items()
    },
}
COURSE = str(LawName("IV", "course"))
# Those with a path that moves too
STANDARD = OUTPUTS | {COURSE: lambda system, offset=False: type_iv(system, course(), offset)}


def output_names(robot: Mechanism) -> tuple[str, ...]:
    """Return the names of the output maps that this robot may have: Types I to IV, then its own. Those in
    OUTPUTS may have `OFFSET` of names.py.
    """
    return (*OUTPUTS, *(output.name for output in robot.outputs))


def output_map(system: ReducedSystem, name: str) -> OutputMap:
    """Return the output map of a law by name: one of OUTPUTS, optionally with an offset, or the robot's own.
    Raises KeyError.

    With EXTENDED of names.py it allows a dynamic extension, and P_l of one of OUTPUTS is on the axle. With
    KINEMATIC the outputs are those of a kinematic law. With DAMPED the inverse of Phi is damped near the
    singular set. Raises ModelError unless there is a path then, and for one of OUTPUTS if the robot is
    underactuated.
    """
    if (dynamic := without_kinematic(name)) != name:
        base_map = output_map(system, dynamic)
        return replace(base_map, name=name, about=f"{base_map.about}, kinematic", kinematic=True)
    if (in_time := without_arclength(name)) != name:
        return _by_arclength(system, on_axle(system, output_map(system, in_time)), name)
    if (plain := without_extension(name)) != name:
        base_map = output_map(system, plain)
        about = f"{base_map.about}, with dynamic extension"
        return replace(
            base_map if is_own(system, plain) else on_axle(system, base_map),
            name=name,
            about=about,
            extension=True,
        )
    if (exact := without_damping(name)) != name:
        return _damped(system, output_map(system, exact), name)
    own = {output.name: output for output in system.mechanism.outputs}
    if name in own:
        return _own(system, own[name])
    if system.underactuated:
        raise ModelError(_only_own(system, name))
    base = without_offset(name)
    standard = STANDARD[base](system, offset=base != name)
    return replace(
        standard, name=name, about=standard.about + (", P_l anywhere on the vehicle" if base != name else "")
    )


def _only_own(system: ReducedSystem, name: str) -> str:
    """Return why an underactuated robot has no laws of Types I to IV."""
    r, mechanism = len(system.mechanism.inputs), system.mechanism
    own = ", ".join(output.name for output in mechanism.outputs if len(output.rows) == r) or "none"
    return (
        f"{mechanism.name}, output {name}: {counted(r, 'input')} for n - m = {system.dof} degrees of "
        "freedom; Types I to IV are for robots with an input for each. The outputs of an underactuated "
        f"robot are its own, with {counted(r, 'row')}: {own}"
    )


PATH_GAIN = "path_gain_"  # names of the gains of a law along the way, with the order of the derivative


def _by_arclength(system: ReducedSystem, output: OutputMap, name: str) -> OutputMap:
    """Return the outputs of a law along the way: how far the motion is from that which brings P_l onto the
    course, and the speed.

    Derivatives of the distance e by the way of P_l along the parallel of the course through it are those by
    time over its speed along the course. Of these e, e', ... depend on q only, up to an order k - 1. The rate
    of the last is g(q) nu, and P_l comes onto the course as e^(k) + c_(k-1) e^(k-1) + ... + c_0 e = 0 says if
    (g + (c_(k-1) e^(k-1) + ... + c_0 e) a) nu = 0, where a nu is that speed: this is the first output. It has
    a regular Phi at standstill too.
    """
    where, foot = f"{system.mechanism.name}, output {name}", output.foot
    if foot is None:
        raise ModelError(f"{where}: only laws of Type IV along a course can be along the way")
    followed = following(system, output)
    assert followed.foot is not None, "the output has a foot"
    distance, curvature, rate = foot.distance, foot.symbols[2], foot.symbols[3]
    # d curvature/dt = rate ds/dt
    along = canonical(ca.jacobian(followed.foot[1][2, :].T, rate).T * (1 - curvature * distance))
    errors, states = [distance], ca.vertcat(followed.moving, system.nu)
    while True:
        rates = canonical(ca.jacobian(errors[-1], followed.moving) @ followed.directions)
        both = Sampled(
            ca.vertcat(rates, along), states, (*system.mechanism.parameters, *output.parameters), where
        )
        if both.rank() == 2:
            break
        if len(errors) > SMOOTH:
            raise ModelError(
                f"{where}: derivatives of the distance up to order {SMOOTH} by the way do not contain the "
                "steering"
            )
        column = next(k for k in range(system.dof) if not along[k].is_zero())
        errors.append(canonical(rates[column] / along[column]))
    k = len(errors)
    gains = tuple(
        config(
            f"{PATH_GAIN}{j}",
            float(math.comb(k, j)),
            f"1/m^{k - j}" if k - j > 1 else "1/m",
            f"on derivative {j} of the distance by the way",
            "positive",
        )
        for j in range(k)
    )
    aim = sum((gain.symbol * error for gain, error in zip(gains, errors, strict=True)), start=ca.SX(0))
    row = ca.densify((rates + aim * along) @ system.nu)
    unit = {1: "m/s", 2: "1/s"}.get(k, f"1/(m^{k - 2} s)" if k > 3 else "1/(m s)")
    steering = OutputRow(
        "steering",
        unit,
        "how far the motion is from that which brings P_l onto the course",
        foot.at(row),
        of_foot=row,
    )
    about = f"{output.about}, errors decay along the way"
    return replace(
        output,
        name=name,
        about=about,
        rows=(steering, output.rows[1]),
        parameters=(*output.parameters, *gains),
    )


BAND = 0.2  # default; within 11.5 degrees of the normal to the path
LEAST_BAND = 0.01  # far above SINGULAR, where P_l has no acceleration


def _damped(system: ReducedSystem, output: OutputMap, name: str) -> OutputMap:
    """Return the outputs of a damped law: the same, with the width of the band."""
    if output.path is None or output.foot:
        raise ModelError(
            f"{system.mechanism.name}, output {name}: only laws of Type IV can be damped, not along a course"
        )
    band = config(
        "band",
        BAND,
        "1",
        "cosine of the angle of heading and path up to which the inverse is damped",
        "positive",
    )
    between = (1 - band.symbol) * (band.symbol - LEAST_BAND)
    conditions = (
        *output.conditions,
        (between, f"the band is not between {LEAST_BAND:g} and 1: it is a cosine"),
    )
    about, parameters = f"{output.about}, damped near the normal", (*output.parameters, band)
    return replace(output, name=name, about=about, parameters=parameters, conditions=conditions, band=band)


def axle(system: ReducedSystem) -> ca.SX:
    """Return how far the axle is ahead of the vehicle's point, m, in parameters only: where turning does not
    move the vehicle sideways.

    Raises ModelError if no such point is fixed to the vehicle.
    """
    turning = system.along_motion(system.mechanism.required_vehicle.heading)
    ahead = ca.densify(canonical(-velocity(system)[1] / turning))
    if ca.depends_on(ahead, ca.vertcat(system.mechanism.q, system.nu)):
        raise ModelError(
            f"{system.mechanism.name}: no point on the vehicle's axis moves along its heading at all times"
        )
    return ahead


def on_axle(system: ReducedSystem, output: OutputMap) -> OutputMap:
    """Return one of OUTPUTS with P_l on the axle, without L. Raises ModelError as `axle` does."""
    (L, *others), ahead = output.parameters, axle(system)

    def moved(expression: ca.SX) -> ca.SX:
        return canonical(ca.substitute(expression, L.symbol, ahead))

    rows = [
        replace(
            row,
            expression=moved(row.expression),
            through=row.through and replace(row.through, inner=moved(row.through.inner)),
        )
        for row in output.rows
    ]
    about, foot = f"{output.about}, P_l on the axle", output.foot
    if foot:
        foot = replace(foot, place=moved(foot.place), values=moved(foot.values))
    return replace(output, about=about, rows=tuple(rows), parameters=tuple(others), foot=foot)


def is_own(system: ReducedSystem, name: str) -> bool:
    """Return whether this is the name of one of the robot's own outputs."""
    return name in [output.name for output in system.mechanism.outputs]


def _own(system: ReducedSystem, output: Output) -> OutputMap:
    """Return a user-defined output map, with rates replaced by quasi-velocities (9)."""
    rows = []
    for row, expression in output.rows:
        if ca.depends_on(expression, system.mechanism.qdot):
            expression = canonical(ca.substitute(expression, system.mechanism.qdot, system.qdot))
        rows.append(OutputRow(row.name, row.unit, row.about, expression))
    return OutputMap(output.name, output.about, tuple(rows), output.parameters)


def body_point(offset: bool = False) -> tuple[Quantity, ...]:
    """Return the parameters of P_l: L ahead of the vehicle's point (negative: behind) and, with `offset`,
    W to its left."""
    L = config("L", 0.0, "m", "distance of the reference point P_l ahead of the vehicle's point")
    W = config("W", 0.0, "m", "distance of P_l to the left of the vehicle's axis")
    return (L, W) if offset else (L,)


def body_offsets(parameters: Sequence[Quantity]) -> tuple[ca.SX, ca.SX]:
    """Return the distances of P_l ahead and to the left of the vehicle's point, m, from parameters that begin
    with `body_point`.
    """
    ahead, *others = parameters
    return ahead.symbol, next((q.symbol for q in others if q.name == "W"), ca.SX(0))


def reference_point(system: ReducedSystem, point: Sequence[Quantity]) -> tuple[ca.SX, ca.SX]:
    """Return the position of P_l in the world, m, from `body_point`."""
    vehicle = system.mechanism.required_vehicle
    ahead, left = body_offsets(point)
    cosine, sine = ca.cos(vehicle.heading), ca.sin(vehicle.heading)
    return vehicle.x + ahead * cosine - left * sine, vehicle.y + ahead * sine + left * cosine


def forward_speed(system: ReducedSystem) -> ca.SX:
    """Return the velocity of the vehicle's point along its heading, m/s, as a function of q and nu."""
    return canonical(velocity(system)[0])


def velocity(system: ReducedSystem) -> tuple[ca.SX, ca.SX]:
    """Return the velocity of the vehicle's point along its heading and to the left of it, m/s,
    as functions of q and nu."""
    vehicle = system.mechanism.required_vehicle
    x_dot, y_dot = system.along_motion(vehicle.x), system.along_motion(vehicle.y)
    cosine, sine = ca.cos(vehicle.heading), ca.sin(vehicle.heading)
    return cosine * x_dot + sine * y_dot, cosine * y_dot - sine * x_dot


def at_point(
    system: ReducedSystem,
    point: Sequence[Quantity],
    name: str,
    about: str,
    outer: Callable[[ca.SX, ca.SX], ca.SX],
    unit_normal: Callable[[ca.SX, ca.SX], tuple[ca.SX, ca.SX]] | None = None,
) -> OutputRow:
    """Return an output in m that is a function of the position of P_l; `unit_normal` as in Path."""
    place = ca.vertcat(*reference_point(system, point))
    symbols = x, y = ca.SX.sym("x_l"), ca.SX.sym("y_l")
    through = Through(ca.vertcat(*symbols), place, outer(x, y), *(unit_normal(x, y) if unit_normal else ()))
    return OutputRow(name, "m", about, outer(place[0], place[1]), through)


def _x(system: ReducedSystem, point: Sequence[Quantity]) -> OutputRow:
    return at_point(system, point, "x_l", "x of P_l", lambda x, y: x)


def _y(system: ReducedSystem, point: Sequence[Quantity]) -> OutputRow:
    return at_point(system, point, "y_l", "y of P_l", lambda x, y: y)


def _heading(system: ReducedSystem) -> OutputRow:
    return OutputRow("heading", "rad", "heading", system.mechanism.required_vehicle.heading)
