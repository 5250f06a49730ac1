"""Stability of joints, trailers and bodies behind a steered wheel when a vehicle drives straight.

The posture is all coordinates on which S depends; it moves at f(posture) v + g(posture) omega, with the forward speed v of the
vehicle and its yaw rate omega. About straight driving, f = 0, the loop makes omega proportional to the error of the heading,
which then obeys its own equation; the rest of the posture moves, to first order and with constant heading, at v df times
its deviation. It is proved that turning the posture by the coefficients c changes nothing: all headings are equivalent.
"""

from dataclasses import dataclass

import casadi as ca
import sympy as sp

from ...model.reduction import ReducedSystem
from ..exact.readable import readable
from ..exact.symbolic import written
from .decoupling import Decoupling

SHORT = 20  # operations of an equation that is printed


@dataclass(frozen=True)
class Follower:
    """A coordinate during straight driving at the speed v: its rate is v times `course`, 1/m, exactly.

    v times `rate`, 1/m, is the rate of its small deviations. `way`: 1 if it is stable driving forward and unstable in reverse,
    -1 if the opposite is true.
    """

    name: str
    course: sp.Expr
    rate: sp.Expr
    way: int

    def __str__(self) -> str:
        """A line."""
        v, short = sp.Symbol("v"), sp.count_ops(self.course) <= SHORT
        moves = f"' = {written(readable(v * self.course))}" if short else f" changes at the rate {written(v * self.rate)}"
        settles, leaves = ("driving forward", "in reverse")[:: self.way]
        return f"{self.name}{moves}: converges {settles}, diverges {leaves}"


@dataclass(frozen=True)
class Shape:
    """`names` of the coordinates of the posture besides the heading's; its `followers` are all of them, or none: not decided."""

    names: tuple[str, ...]
    followers: tuple[Follower, ...]

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
            return ", ".join(map(str, self.followers))
        return f"whether {', '.join(self.names)} {'converges' if len(self.names) == 1 else 'converge'} is not decided"


def shape_names(system: ReducedSystem) -> tuple[str, ...]:
    """Return the names of the coordinates besides the heading's on which the velocities of a vehicle depend."""
    return tuple(system.mechanism.coordinates[k].name for k in _posture(system)[1:])


def shape_of(decoupling: Decoupling) -> Shape:
    """Return the shape of a vehicle with an axle, exactly."""
    names = shape_names(decoupling.linearization.system)
    return Shape(names, _followers(decoupling) if names else ())


def _posture(system: ReducedSystem) -> list[int]:
    """Places of the coordinates on which S depends: first one of the heading, then the others."""
    mechanism = system.mechanism
    if mechanism.vehicle is None:
        return []
    symbols = [each.symbol for each in mechanism.coordinates]
    turns = [k for k, each in enumerate(symbols) if ca.depends_on(mechanism.vehicle.heading, each)]
    return turns + [k for k, each in enumerate(symbols) if k not in turns and ca.depends_on(system.S, each)]


def _followers(decoupling: Decoupling) -> tuple[Follower, ...]:
    """Empty where straight driving is not at zeros of the posture, is no cascade, or signs of rates are not known."""
    vehicle, places = decoupling.planar, _posture(decoupling.linearization.system)
    if vehicle is None:
        return ()
    W = sp.Matrix.vstack(vehicle.forward, vehicle.yaw)
    if W.shape != (2, 2) or decoupling.is_zero(W.det()):
        return ()
    posture = [decoupling.q[k] for k in places]
    f, g = ([decoupling.lowest(entry) for entry in decoupling.S.extract(places, [0, 1]) * column] for column in _inverse(W))
    gradient = sp.Matrix([vehicle.heading]).jacobian(posture)
    straight = dict.fromkeys(posture, 0)
    if gradient.free_symbols or any(e.subs(straight) != 0 for e in (vehicle.heading, *f)):
        return ()
    A = sp.Matrix(f).jacobian(posture).subs(straight).applyfunc(decoupling.lowest)
    others = A[1:, 1:] - A[1:, 0] * gradient[:, 1:] / gradient[0]
    if any(len(block) > 1 for block in others.strongly_connected_components()):
        return ()
    rates = others.diagonal()
    ways = [-_sign(decoupling, rate) for rate in rates]
    if 0 in ways:
        return ()
    c = others.LUsolve(-A[1:, 0] / gradient[0]).applyfunc(decoupling.lowest)
    c = [(1 - (gradient[:, 1:] * c)[0]) / gradient[0], *c]
    if any(not decoupling.is_zero(sp.Add(*[a * e.diff(q) for a, q in zip(c, posture, strict=True)])) for e in (*f, *g)):
        return ()
    return tuple(Follower(str(q), *values) for q, *values in zip(posture[1:], f[1:], rates, ways, strict=True))


def _inverse(W: sp.Matrix) -> tuple[sp.Matrix, sp.Matrix]:
    """Columns of the inverse of a 2 x 2 matrix."""
    inverse = W.adjugate() / W.det()
    return inverse[:, 0], inverse[:, 1]


def _sign(decoupling: Decoupling, rate: sp.Expr) -> int:
    """Return the sign of an expression in parameters; 0 if their signs do not determine it."""
    above, below = decoupling.functions.ratio(rate)
    return decoupling.functions.sign(above) * decoupling.functions.sign(below)
