"""Stability of joints, trailers and bodies behind a steered wheel when a robot drives straight.

The posture is all coordinates on which S depends; it moves at f(posture) v + g(posture) omega, with a speed v
and the rate omega of a direction. Driving straight v is constant and the direction is held. Of outputs that
leave Phi regular, points of the vehicle ahead of its axle, these are forward speed and heading of the
vehicle: the heading's error obeys its own equation. Of outputs that need a dynamic extension they are the
outputs' own: their point moves in a direction that the posture determines, such as the heading of the body on
whose axle it is, and that is held, whatever the heading of another body does.

About straight driving, f = 0, the posture moves to first order at v df times its deviation, with the
direction constant. It is proved that turning the posture by the coefficients c changes nothing: all
directions are equivalent.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import product

import casadi as ca
import sympy as sp

from ...model.errors import ModelError
from ...model.reduction import ReducedSystem
from ..exact.readable import readable
from ..exact.symbolic import written
from .decoupling import Decoupling

SHORT = 20  # operations of an equation that is printed

Followers = tuple[tuple["Follower", ...], dict[str, sp.Expr]]


@dataclass(frozen=True)
class Follower:
    """A coordinate during straight driving at the speed v: its rate is v times `course`, 1/m, exactly; None:
    not in closed form.

    v times `rate`, 1/m, is the rate of its small deviations. `way`: 1 if it is stable driving forward and
    unstable in reverse, -1 if the opposite is true. `turns`: as in Shape. `v`: the symbol.
    """

    name: str
    course: sp.Expr | None
    rate: sp.Expr
    way: int
    turns: sp.Expr
    v: str

    def __str__(self) -> str:
        """A line."""
        v, course = sp.Symbol(self.v), self.course
        short = course is not None and sp.count_ops(course) <= SHORT
        moves = (
            f"' = {written(readable(v * course))}"
            if short
            else f" changes at the rate {written(v * self.rate)}"
        )
        settles, leaves = ("driving forward", "in reverse")[:: self.way]
        return f"{self.name}{moves}: converges {settles}, diverges {leaves}"

    def settles(self, direction: str) -> str:
        """Return where it goes, if it converges, in a motion in this direction (a symbol)."""
        return f"{self.name} -> {written(self.turns * sp.Symbol(direction))}"


@dataclass(frozen=True)
class Shape:
    """`names` of the coordinates of the posture besides the first; its `followers` are all of them, or none:
    not decided. `speed`: what v is. `turns`: the coordinates of the posture by name, per angle by which the
    whole motion is turned.
    """

    names: tuple[str, ...]
    followers: tuple[Follower, ...]
    speed: str = "the forward speed"
    turns: dict[str, sp.Expr] = field(default_factory=dict)

    @property
    def decided(self) -> bool:
        """Whether all of it is known, also if it is empty."""
        return len(self.followers) == len(self.names)

    def lost(self, way: int) -> list[str]:
        """Return those that diverge from straight driving, forward (1) or in reverse (-1)."""
        return [each.name for each in self.followers if each.way != way]

    def lines(self) -> list[str]:
        """Return for each its equation in straight driving, and its stability."""
        return list(map(str, self.followers)) if self.decided else [str(self)]

    def __str__(self) -> str:
        """A line."""
        if self.decided:
            return "; ".join(map(str, self.followers))
        return (
            f"whether {', '.join(self.names)} {'converges' if len(self.names) == 1 else 'converge'} is "
            "not decided"
        )


@dataclass(frozen=True)
class Held:
    """What is held in straight driving: `speed`, over `scale` in m/s, everywhere if `exact`, and the rate of
    a direction, `turning`, 1 x p by nu; `gradient` of the direction by the posture. The direction is 0 where
    the posture is.
    """

    speed: sp.Matrix
    turning: sp.Matrix
    gradient: sp.Matrix
    scale: sp.Expr = sp.Integer(1)
    exact: bool = True


def posture_names(system: ReducedSystem) -> tuple[str, ...]:
    """Return the names of the posture: first those on which the heading of a vehicle depends,
    then the others."""
    return tuple(system.mechanism.coordinates[k].name for k in _posture(system))


def shape_of(decoupling: Decoupling) -> Shape:
    """Return the shape of a vehicle with an axle, whose heading is held, exactly."""
    places, vehicle = _posture(decoupling.linearization.system), decoupling.planar
    names = tuple(str(decoupling.q[k]) for k in places[1:])
    if not names or vehicle is None:
        return Shape(names, ())
    posture = [decoupling.q[k] for k in places]
    held = None
    if vehicle.heading.subs(dict.fromkeys(posture, 0)) == 0:
        held = Held(vehicle.forward, vehicle.yaw, sp.Matrix([vehicle.heading]).jacobian(posture))
    followers, turns = _followers(decoupling, held, places)
    return Shape(names, followers, turns=turns)


def shape_of_others(decoupling: Decoupling, others: Sequence[str]) -> Shape:
    """Return the shape of `others`, the coordinates that the outputs of a law with a dynamic extension do not
    determine, exactly: the motion of the outputs is held.
    """
    places = [k for k in _posture(decoupling.linearization.system) if str(decoupling.q[k]) not in others]
    places += [k for k, q in enumerate(decoupling.q) if str(q) in others]
    speed = (
        "the speed that is held"
        if decoupling.linearization.output.path
        else "the speed of the outputs' point"
    )
    if len(places) != len(others) + 1:
        return Shape(tuple(others), (), speed)
    names = tuple(str(decoupling.q[k]) for k in places[1:])
    followers, turns = _followers(decoupling, _own_motion(decoupling, places), places)
    return Shape(names, followers, speed, turns)


def _posture(system: ReducedSystem) -> list[int]:
    """Places of the coordinates on which S depends: first those of the heading, if there is one,
    then the others."""
    mechanism = system.mechanism
    heading = mechanism.vehicle.heading if mechanism.vehicle else ca.SX(0)
    symbols = [each.symbol for each in mechanism.coordinates]
    turns = [k for k, each in enumerate(symbols) if ca.depends_on(heading, each)]
    return turns + [k for k, each in enumerate(symbols) if k not in turns and ca.depends_on(system.S, each)]


def _own_motion(decoupling: Decoupling, places: Sequence[int]) -> Held | None:
    """Return speed and direction of the outputs' point, if the posture determines its direction.

    Its velocity is e (a' nu): all columns of its Jacobian J S are parallel to e, which is a column without
    common factors.
    """
    motion, posture = decoupling.motion, [decoupling.q[k] for k in places]
    straight = dict.fromkeys(posture, 0)
    columns = [motion[:2, j] for j in range(motion.cols)]
    along = next((column for column in columns if column.subs(straight)[0] != 0), None)
    parallel = along is not None and all(
        decoupling.is_zero(along[0] * c[1] - along[1] * c[0]) for c in columns
    )
    moves = motion.free_symbols & {*decoupling.functions.coordinates} <= set(posture)
    if along is None or not parallel or not moves:
        return None
    x, y = _direction(decoupling, along, posture)
    size = decoupling.lowest(x**2 + y**2)
    sign = _sign(decoupling, decoupling.lowest(x.subs(straight)))
    if y.subs(straight) != 0 or not sign:
        return None
    held, scale = not motion[2, :].is_zero_matrix, sp.sqrt(size.subs(straight))
    speed = (
        motion[2, :]
        if held
        else sp.Matrix([[decoupling.lowest(sign * (x * c[0] + y * c[1])) for c in columns]])
    )
    slopes = [x * y.diff(q) - y * x.diff(q) for q in posture]
    gradient = sp.Matrix([[decoupling.lowest(slope / size) for slope in slopes]])
    turning = gradient * decoupling.S.extract(list(places), list(range(motion.cols)))
    return Held(speed, turning, gradient, sp.Integer(1) if held else scale, held or size == 1)


def _direction(
    decoupling: Decoupling, column: sp.Matrix, posture: Sequence[sp.Symbol]
) -> tuple[sp.Expr, sp.Expr]:
    """Return a vector parallel to a column: if possible, cosine and sine of a sum of angles of the
    posture."""
    for signs in product((1, 0, -1), repeat=len(posture)):
        angle = sp.Add(*[sign * q for sign, q in zip(signs, posture, strict=True)])
        with suppress(ModelError):  # the functions do not have this angle
            if any(signs) and decoupling.is_zero(column[0] * sp.sin(angle) - column[1] * sp.cos(angle)):
                return sp.cos(angle), sp.sin(angle)
    y, x = sp.fraction(decoupling.lowest(column[1] / column[0]))
    return x, y


def _followers(decoupling: Decoupling, held: Held | None, places: Sequence[int]) -> Followers:
    """Return the followers, and `turns` of Shape; empty where straight driving is not at zeros of the
    posture, is no cascade, or signs of rates are not known.
    """
    if held is None:
        return (), {}
    W = sp.Matrix.vstack(held.speed, held.turning)
    if W.shape != (2, 2) or decoupling.is_zero(W.det()):
        return (), {}
    posture = [decoupling.q[k] for k in places]
    f, g = (
        [decoupling.lowest(entry) for entry in decoupling.S.extract(list(places), [0, 1]) * column]
        for column in _inverse(W)
    )
    straight = dict.fromkeys(posture, 0)
    gradient = held.gradient.subs(straight).applyfunc(decoupling.lowest)
    if gradient[0] == 0 or any(e.subs(straight) != 0 for e in f):
        return (), {}
    A = sp.Matrix(f).jacobian(posture).subs(straight).applyfunc(decoupling.lowest)
    others = A[1:, 1:] - A[1:, 0] * gradient[:, 1:] / gradient[0]
    if any(len(block) > 1 for block in others.strongly_connected_components()):
        return (), {}
    ways = [-_sign(decoupling, rate) for rate in others.diagonal()]
    if 0 in ways:
        return (), {}
    c = others.LUsolve(-A[1:, 0] / gradient[0]).applyfunc(decoupling.lowest)
    c = [decoupling.lowest((1 - (gradient[:, 1:] * c)[0]) / gradient[0]), *c]
    turned = [(held.gradient * sp.Matrix(c))[0] - 1]
    turned += [sp.Add(*[a * e.diff(q) for a, q in zip(c, posture, strict=True)]) for e in (*f, *g)]
    if not all(map(decoupling.is_zero, turned)):
        return (), {}
    rates = [rate * held.scale for rate in others.diagonal()]
    courses = [e if held.exact else None for e in f[1:]]
    names = [str(q) for q in posture]
    followers = tuple(
        map(Follower, names[1:], courses, rates, ways, c[1:], [decoupling.names["v"]] * len(rates))
    )
    return followers, dict(zip(names, c, strict=True))


def _inverse(W: sp.Matrix) -> tuple[sp.Matrix, sp.Matrix]:
    """Columns of the inverse of a 2 x 2 matrix."""
    inverse = W.adjugate() / W.det()
    return inverse[:, 0], inverse[:, 1]


def _sign(decoupling: Decoupling, rate: sp.Expr) -> int:
    """Return the sign of an expression in parameters; 0 if their signs do not determine it."""
    above, below = decoupling.functions.ratio(rate)
    return decoupling.functions.sign(above) * decoupling.functions.sign(below)
