"""Rolling contact of two rigid bodies: Montana's kinematics from any two surfaces, paper section 2.2, (4) and
(5).

Frames at the contact: body i has its Gauss frame x_i, y_i, z_i (x along the u-curve, z the outward normal).
z_2 = -z_1, and psi rotates x_1 into x_2: x_2 = cos(psi) x_1 - sin(psi) y_1, a rotation by -psi about the
outward normal of body 1. A vector in the tangent plane with components w in frame 1 has the components R_psi
w in frame 2, and R_psi is its own inverse.
"""

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import casadi as ca
import numpy as np

from ..algebra.exact import canonical
from ..algebra.expression import fold, free_symbols, operate
from ..errors import ModelError
from ..mechanism import Mechanism, Quantity, matrix, refuse_twice
from .kinematics import Kinematics
from .surfaces import SMALLEST, Condition, Curve, Surface

SIGNS = ((1, 1), (1, -1), (-1, 1), (-1, -1))


@dataclass(frozen=True, eq=False)
class _Contact(ABC):
    """Common base of contacts in space and in the plane."""

    first: Surface | Curve
    second: Surface | Curve

    names: ClassVar[tuple[str, ...]] = ()  # of the coordinates

    @property
    @abstractmethod
    def constraint_names(self) -> tuple[str, ...]:
        """One name for each row of A."""

    @property
    @abstractmethod
    def A(self) -> ca.SX:
        """Constraint matrix (2), m x n."""

    @property
    @abstractmethod
    def basis(self) -> ca.SX:
        """S(q) with A S = 0, n x (n-m)."""

    @property
    @abstractmethod
    def relative_curvature(self) -> ca.SX:
        """Relative curvature of the bodies at the contact, 1/m: positive definite if they touch at a point
        and nowhere near it.
        """

    @property
    def name(self) -> str:
        """Names of both bodies."""
        return f"{self.first.name} on {self.second.name}"

    @cached_property
    def q(self) -> ca.SX:
        """Coordinates, n x 1."""
        return ca.vertcat(*[ca.SX.sym(name) for name in self.names])

    @cached_property
    def parameters(self) -> list[ca.SX]:
        """Symbols of the sizes of both bodies. Raises ModelError if two of them,
        or one and a coordinate, have the same name."""
        symbols = {
            symbol.element_hash(): symbol for body in (self.first, self.second) for symbol in body.parameters
        }
        refuse_twice([*self.names, *[symbol.name() for symbol in symbols.values()]], self.name)
        return list(symbols.values())

    def kinematics(self) -> Kinematics:
        """Return the kinematics for the analysis: q, the sizes as parameters (with their signs), A,
        and the basis as S."""
        positive = {
            symbol.element_hash()
            for c in self.conditions
            for symbol in (c.expression,)
            if symbol.is_symbolic()
        }
        return Kinematics(
            self.name,
            tuple(
                Quantity(name, "1", symbol=symbol)
                for name, symbol in zip(self.names, ca.vertsplit(self.q), strict=True)
            ),
            tuple(
                Quantity(
                    s.name(),
                    "1",
                    default=1.0,
                    sign="positive" if s.element_hash() in positive else "any",
                    symbol=s,
                )
                for s in self.parameters
            ),
            A=self.A,
            S=self.basis,
            constraint_names=self.constraint_names,
        )

    @cached_property
    def size(self) -> ca.SX:
        """Size of the curvatures, 1/m: positive unless both bodies are flat."""
        return ca.norm_fro(self._at(0, self.first.K)) + ca.norm_fro(self._at(1, self.second.K))

    @cached_property
    def formal(self) -> str:
        """The reason why the kinematics hold only formally at every q; empty if they hold."""
        curvature = self.relative_curvature
        if vanishes(ca.det(curvature), self.size ** curvature.shape[0], f"{self.name}: relative curvature"):
            return (
                f"{self.name}: the relative curvature is singular everywhere, the bodies touch along a line "
                "or a face: the kinematics of a point of contact hold only formally"
            )
        return ""

    @cached_property
    def conditions(self) -> tuple[Condition, ...]:
        """Conditions for regular coordinates, then determinant and trace of the relative curvature;
        all must be positive."""
        regular = [
            Condition(self._at(k, condition.expression), f"body {k + 1}, {body.name}: {condition.about}")
            for k, body in enumerate((self.first, self.second))
            for condition in body.conditions
        ]
        about = (
            "of the relative curvature: zero where the bodies touch along a line, negative where they overlap"
        )
        curved = [
            Condition(canonical(ca.det(self.relative_curvature)), f"determinant {about}"),
            Condition(canonical(ca.trace(self.relative_curvature)), f"trace {about}"),
        ]
        return (*regular, *curved)

    def refuse(self, q: Sequence[float], parameters: Mapping[str, float]) -> None:
        """Raise ModelError if, at this q and parameters, coordinates are singular or the bodies overlap or
        touch along a line."""
        for k, body in enumerate((self.first, self.second)):
            body.refuse(q[self._slice(k)], parameters)
        sizes = [parameters[symbol.name()] for symbol in self.parameters]
        curvatures = [self.relative_curvature, self._at(0, self.first.K), self._at(1, self.second.K)]
        values = ca.Function("K", [self.q, ca.vertcat(*self.parameters)], curvatures)(q, sizes)
        relative, *own = (np.array(value) for value in values)
        size = max(float(np.abs(value).max()) for value in own)
        smallest = float(np.linalg.eigvalsh(relative)[0]) if np.all(np.isfinite(relative)) else math.nan
        if not smallest > SMALLEST * size:
            kind = "overlap near the contact" if smallest < -SMALLEST * size else "touch along a line"
            where = ", ".join(f"{name} = {number:g}" for name, number in zip(self.names, q, strict=True))
            raise ModelError(
                f"{self.name}: the bodies {kind} at {where} (smallest relative curvature {smallest:.3g} "
                "1/m): the kinematics hold only formally"
            )

    def _slice(self, body: int) -> slice:
        count = len(self.first.names)
        return slice(body * count, (body + 1) * count)

    def _at(self, body: int, form: ca.SX) -> ca.SX:
        """A form of body 0 or 1 at q."""
        return ca.substitute(form, (self.first, self.second)[body].coordinates, self.q[self._slice(body)])


@dataclass(frozen=True, eq=False)
class RollingContact(_Contact):
    """Two bodies that touch at a point and roll on each other; `spin` tells whether they may also rotate
    about the normal.

    q = (u1, v1, u2, v2, psi) (4): the contact point on body 1 and on body 2, and the angle between the
    u-curves.
    """

    first: Surface
    second: Surface
    spin: bool = False

    names = ("u1", "v1", "u2", "v2", "psi")

    @cached_property
    def forms(self) -> tuple[tuple[ca.SX, ca.SX, ca.SX], ...]:
        """Metric, curvature and torsion forms (M, K, T) of both bodies at q."""
        bodies = (self.first, self.second)
        return tuple(
            (self._at(k, body.M), self._at(k, body.K), self._at(k, body.T)) for k, body in enumerate(bodies)
        )

    @cached_property
    def R(self) -> ca.SX:
        """R_psi of (5), 2 x 2: maps components in frame 1 to components in frame 2 and back."""
        c, s = ca.cos(self.q[4]), ca.sin(self.q[4])
        return ca.blockcat([[c, -s], [-s, -c]])

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """One name for each row of A."""
        return ("no slip along x_2", "no slip along y_2", *(() if self.spin else ("no spin",)))

    @cached_property
    def A(self) -> ca.SX:
        """Constraint matrix (2), m x 5, m = 2 with spin, 3 without: R M1 (u1', v1')' - M2 (u2', v2')' = 0
        (5), m/s.

        Without spin there is also psi' - T1 M1 (u1', v1')' - T2 M2 (u2', v2')' = 0, rad/s.
        """
        (M1, _, _), (M2, _, _) = self.forms
        slip = ca.horzcat(self.R @ M1, -M2, ca.SX(2, 1))
        spin = ca.horzcat(-self._at(0, self.first.turning), -self._at(1, self.second.turning), 1)
        return slip if self.spin else ca.vertcat(slip, spin)

    @cached_property
    def basis(self) -> ca.SX:
        """S(q) with A S = 0, 5 x (5-m), without division by the relative curvature, so that it is also valid
        for line contacts.

        The quasi-velocities are those of the contact point along x_1 and y_1 on body 1, m/s; with spin also
        omega_z, rad/s.
        """
        (_, _, T1), (_, _, T2) = self.forms
        rolls = ca.vertcat(
            self._at(0, self.first.inverse), self._at(1, self.second.inverse) @ self.R, T1 + T2 @ self.R
        )
        return ca.horzcat(rolls, ca.vertcat(0, 0, 0, 0, 1)) if self.spin else rolls

    @cached_property
    def S(self) -> ca.SX:
        """S(q) with A S = 0, 5 x (5-m), by Montana's contact equations; quasi-velocities omega_x, omega_y,
        with spin omega_z.

        omega is the angular velocity of body 1 relative to body 2 in frame 1, rad/s:
        (u1', v1')' = M1^-1 (K1 + R K2 R)^-1 (-omega_y, omega_x)', (5), psi' = omega_z + T1 M1 (u1', v1')' +
        T2 M2 (u2', v2')'. Raises ModelError if the contact is a line everywhere.
        """
        if self.formal:
            raise ModelError(f"{self.formal}; use the basis instead of S")
        turned = canonical(ca.inv(self.relative_curvature)) @ ca.DM([[0, -1], [1, 0]])
        return canonical(ca.horzcat(self.basis[:, :2] @ turned, self.basis[:, 2:]))

    def angular_velocity(self, rates: ca.SX) -> ca.SX:
        """Return the angular velocity of body 1 relative to body 2, 3 x 1, in frame 1, rad/s, at these rates
        of q, with or without slip.
        """
        (M1, K1, T1), (M2, K2, T2) = self.forms
        along = K1 @ M1 @ rates[:2] + self.R @ K2 @ M2 @ rates[2:4]
        return ca.vertcat(along[1], -along[0], rates[4] - T1 @ M1 @ rates[:2] - T2 @ M2 @ rates[2:4])

    @cached_property
    def rotation(self) -> ca.SX:
        """Axes of body 2 in the frame of body 1, 3 x 3."""
        return self._at(0, self.first.frame) @ ca.diagcat(self.R, -1) @ self._at(1, self.second.frame).T

    @cached_property
    def origin(self) -> ca.SX:
        """Origin of body 2 in the frame of body 1, 3 x 1, m."""
        return self._at(0, self.first.point) - self.rotation @ self._at(1, self.second.point)

    @cached_property
    def relative_curvature(self) -> ca.SX:
        """K1 + R K2 R, 2 x 2, 1/m: positive definite where the bodies touch at a point and nowhere near
        it."""
        (_, K1, _), (_, K2, _) = self.forms
        return canonical(K1 + self.R @ K2 @ self.R)

    @cached_property
    def curvature_difference(self) -> ca.SX:
        """Gaussian curvature of body 1 minus that of body 2 at the contact, 1/m^2."""
        return canonical(self._at(0, self.first.gaussian) - self._at(1, self.second.gaussian))

    @cached_property
    def volume(self) -> ca.SX:
        """det M1 det M2."""
        (M1, _, _), (M2, _, _) = self.forms
        return canonical(ca.det(M1) * ca.det(M2))


@dataclass(frozen=True, eq=False)
class PlanarContact(_Contact):
    """Two outlines in a plane that roll on each other, q = (u1, u2): m1 u1' = m2 u2', the planar (5). Always
    holonomic.

    Both have the same direction at the contact, with body 1 on the left and body 2 on the right: outline 1
    counterclockwise, outline 2 clockwise (`backward`), or counterclockwise if body 2 is a ring around body 1.
    """

    first: Curve
    second: Curve

    names = ("u1", "u2")
    constraint_names = ("no slip",)

    @cached_property
    def A(self) -> ca.SX:
        """Constraint matrix (2), 1 x 2: m1 u1' - m2 u2' = 0, m/s."""
        return ca.horzcat(self._at(0, self.first.m), -self._at(1, self.second.m))

    @cached_property
    def basis(self) -> ca.SX:
        """S(q) = (1/m1, 1/m2)', 2 x 1; its quasi-velocity is that of the contact along both outlines, m/s."""
        return ca.vertcat(1 / self._at(0, self.first.m), 1 / self._at(1, self.second.m))

    @cached_property
    def relative_curvature(self) -> ca.SX:
        """Curvature of outline 1 minus that of outline 2, 1/m: positive where the bodies touch at a point."""
        return canonical(self._at(0, self.first.K) - self._at(1, self.second.K))


def rolls_on(
    mechanism: Mechanism,
    name: str,
    contact: RollingContact | PlanarContact,
    q: Sequence[ca.SX] | ca.SX,
    formal: bool = False,
) -> None:
    """Add the rows of a rolling contact to the mechanism's constraints (2); `q` is that of the contact in the
    mechanism's coordinates.

    Raises ModelError for a contact along a line unless `formal` is true.
    """
    entries = ca.vertsplit(q) if isinstance(q, ca.SX) else q
    place = ca.vertcat(*[matrix(entry, f"{mechanism.name}: {name}: q") for entry in entries])
    if place.numel() != contact.q.numel():
        names = ", ".join(symbol.name() for symbol in ca.vertsplit(contact.q))
        raise ModelError(f"{mechanism.name}: {name}: q must be ({names}); it has {place.numel()} entries")
    if contact.formal and not formal:
        raise ModelError(f"{mechanism.name}: {name}: {contact.formal}; use formal=True to accept this")
    for condition in () if formal else contact.conditions:
        _refuse_defaults(mechanism, f"{mechanism.name}: {name}", condition)
    velocities = ca.substitute(contact.A, contact.q, place) @ mechanism.rate(place)
    for constraint, velocity in zip(contact.constraint_names, ca.vertsplit(velocities), strict=True):
        mechanism.rolls(f"{name}: {constraint}", velocity)


def _refuse_defaults(mechanism: Mechanism, where: str, condition: Condition) -> None:
    """Raise ModelError if a condition on sizes alone does not hold for the mechanism's parameters at their
    defaults."""
    if {symbol.element_hash() for symbol in free_symbols(condition.expression)} <= {
        p.symbol.element_hash() for p in mechanism.parameters
    }:
        function = ca.Function("condition", [mechanism.p], [condition.expression])
        value = float(function([p.default for p in mechanism.parameters]))
        if not value > 0.0:
            raise ModelError(f"{where}: {condition.about} (here {condition.expression} = {value:.3g})")


# -- the distribution ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class RollingGrowth:
    """Growth vector of the distribution of a rolling contact: the generic one, and where it differs."""

    vector: tuple[int, ...]
    holonomic: int
    determinant: ca.SX | None  # of the vector fields that span the space; None if Delta is involutive
    drops_where: ca.SX | None  # the set where this is zero; None: nowhere on the patches
    special: tuple[str, ...]  # orbits that have dimension 2 nevertheless
    reason: str


def rolling_growth(contact: RollingContact | PlanarContact) -> RollingGrowth:
    """Return growth vector and number k of holonomic constraints for any two surfaces, exact, from the
    structure equations.

    With e_1, e_2 the pure-rolling columns of `basis`, kappa_i the Gaussian curvatures and E = d/dpsi,
    [e_1, e_2] = -T1 (e_1, e_2)' + (kappa_2 - kappa_1) E and [E, e_i] = dR/dpsi's columns on body 2, so that
    det[e_1, e_2, b, [e_1, b], [e_2, b]] = (kappa_1 - kappa_2)^3 / (det M1 det M2), b = [e_1, e_2], and
    det[e_1, e_2, E, [E, e_1], [E, e_2]] = -1 / (det M1 det M2). No root of a metric occurs.
    """
    if isinstance(contact, PlanarContact):
        return RollingGrowth(
            (1,),
            1,
            None,
            None,
            (),
            "one vector field is involutive: the arc lengths m1 du1 and m2 du2 stay equal",
        )
    difference, volume = contact.curvature_difference, contact.volume
    if contact.spin:
        return RollingGrowth(
            (3, 5), 0, canonical(-1 / volume), None, (), "with the spin it spans the space everywhere"
        )
    if vanishes(difference, contact.size**2, f"{contact.name}: difference of the Gaussian curvatures"):
        reason = "both surfaces have the same constant Gaussian curvature: the distribution is involutive"
        return RollingGrowth((2,), 3, None, None, (), reason)
    determinant = canonical(difference**3 / volume)
    if not ca.depends_on(difference, contact.q):
        where = difference if free_symbols(difference) else None
        return RollingGrowth(
            (2, 3, 5), 0, determinant, where, (), "both Gaussian curvatures are constant and differ"
        )
    special = mirrors(contact)
    reason = "it spans the space in three steps wherever the Gaussian curvatures at the contact differ"
    if special:
        reason += (
            "; mirror configurations (one orbit up to the symmetries of the surfaces) are never left, "
            "nor reached from others"
        )
    return RollingGrowth((2, 3, 5), 0, determinant, difference, special, reason)


def mirrors(contact: RollingContact) -> tuple[str, ...]:
    """Return the orbits of dimension 2 of two congruent bodies, as text, as far as reflections of the
    coordinates give them.

    Every orbit of pure rolling has dimension 2 or 5 (A. Agrachev, Yu. Sachkov, Control theory from the
    geometric viewpoint, 2004, chapter 24). If it is 2, the contact follows an isometry (u2, v2) = s(u1, v1)
    of the surfaces with ds = R_psi in their frames: M2 ds = R_psi M1, psi constant. This is what is proved
    here; since the metric determines T, the row of the spin follows. Candidates are s = (+-u1, +-v1), with a
    free shift of one coordinate (surfaces of revolution) or none, and psi = 0 or pi. The symmetries of the
    surfaces map these orbits to others of the same kind.
    """
    u, v, shift = ca.SX.sym("u"), ca.SX.sym("v"), ca.SX.sym("const")
    (M1, _, _), (M2, _, _) = contact.forms
    here = ca.substitute(M1, contact.q[:2], ca.vertcat(u, v))
    orbits = []
    moved: tuple[tuple[ca.SX | int, ca.SX | int], ...] = ((0, shift), (shift, 0), (0, 0))
    for s, (psi, turn) in itertools.product(SIGNS, (("0", ca.DM([1, -1])), ("pi", ca.DM([-1, 1])))):
        for shifts in moved:
            place = ca.vertcat(s[0] * u + shifts[0], s[1] * v + shifts[1])
            there = _without_signs(ca.substitute(M2, contact.q[2:4], place))
            left = there @ ca.diag(ca.DM(s)) - ca.diag(turn) @ here
            if not _differs(ca.norm_fro(left), ca.norm_fro(here)) and canonical(left).is_zero():
                names = [_shifted(*each) for each in zip(s, ("u1", "v1"), shifts, strict=True)]
                orbits.append(f"u2 = {names[0]}, v2 = {names[1]}, psi = {psi}")
                break
    return tuple(orbits)


def _without_signs(expression: ca.SX) -> ca.SX:
    """Return the same expression with cos(-a) as cos(a) and sin(-a) as -sin(a),
    which `canonical` treats as independent."""

    def apply(code: int, arguments: tuple[ca.SX, ...]) -> ca.SX:
        if code in (ca.OP_SIN, ca.OP_COS) and arguments[0].is_op(ca.OP_NEG):
            value = operate(code, arguments[0].dep())
            return value if code == ca.OP_COS else -value
        return operate(code, *arguments)

    symbols = free_symbols(expression)
    return ca.reshape(
        ca.vertcat(*fold(expression, symbols, symbols.__getitem__, ca.SX, apply)), expression.shape
    )


def vanishes(expression: ca.SX, size: ca.SX, where: str) -> bool:
    """Return whether an expression is zero everywhere: proved exactly, or disproved at a place where it is
    not small relative to `size`.

    Raises ModelError if neither is possible.
    """
    if _differs(expression, size):
        return False
    if canonical(expression).is_zero():
        return True
    raise ModelError(
        f"{where} is zero to rounding, and cannot be proved to be: give the sizes as symbols, or write the "
        "surfaces more simply"
    )


def _differs(expression: ca.SX, size: ca.SX) -> bool:
    """Return whether it is, at some place, not small relative to `size`. Faster than a proof that it is
    zero."""
    both = ca.vertcat(expression, size)
    symbols = free_symbols(both)
    function = ca.Function("both", [ca.vertcat(*symbols)], [both])
    for place in np.random.default_rng(1992).uniform(0.2, 1.2, (8, len(symbols))):
        value, scale = (float(number) for number in ca.vertsplit(function(place)))
        if abs(value) > SMALLEST * abs(scale):
            return True
    return False


def _shifted(sign: int, name: str, shift: ca.SX | int) -> str:
    """Return the text of sign * name + shift."""
    signed = name if sign > 0 else f"-{name}"
    return f"{signed} + const" if isinstance(shift, ca.SX) else signed
