"""Surfaces and curves that roll on each other: metric, curvature and torsion forms from any parametrization.

D. J. Montana, The kinematics of contact and grasp, IJRR 7(3), 1988, used in the paper's section 2.2. Montana
requires orthogonal coordinates, M = diag(|f_u|, |f_v|). Here M is the triangular root of the metric, which is
the same for orthogonal coordinates and also valid for oblique ones (an ellipsoid of three axes).
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import casadi as ca

from ..algebra.exact import canonical
from ..algebra.expression import fold, free_symbols, operate
from ..algebra.operations import KINKS
from ..errors import ModelError
from ..mechanism import matrix, refuse_unknown

if TYPE_CHECKING:  # these take long to import, by way of SymPy
    from sympy.polys.rings import PolyElement

    from ..algebra.field import Field

SHORT = 1024  # multiples of 1/SHORT below this number are exact in the following operations
SMALLEST = 1e-9  # relative to its value at the regular place: a condition below this does not hold


@dataclass(frozen=True)
class Condition:
    """`expression` must be positive, so that the coordinates are regular and the sizes are valid."""

    expression: ca.SX
    about: str


@dataclass(frozen=True, eq=False)
class _Patch(ABC):
    """Common base of curves and surfaces: coordinates, parameters, a regular place, conditions.

    Parameters are the symbols of `position` that are not coordinates. `at` defines a regular place on the
    patch, by coordinates (default 0) and parameters (default 1); every root is positive there. `singular`
    describes where the coordinates are not regular.
    """

    name: str
    position: Callable[..., tuple[ca.SX | float, ...] | ca.SX]
    at: Mapping[str, float] = field(default_factory=dict)
    singular: str = ""
    needs: tuple[Condition, ...] = ()

    names: ClassVar[tuple[str, ...]] = ()  # of the coordinates
    dimension: ClassVar[int] = 0  # of the space the body lives in

    @property
    @abstractmethod
    def conditions(self) -> tuple[Condition, ...]:
        """Expressions that must be positive for the forms to hold."""

    @cached_property
    def coordinates(self) -> ca.SX:
        """(u, v) of a surface, (u) of a curve."""
        return ca.vertcat(*[ca.SX.sym(name) for name in self.names])

    @cached_property
    def point(self) -> ca.SX:
        """f, the position in the body's frame, m."""
        return self._given(self._point)

    @cached_property
    def parameters(self) -> list[ca.SX]:
        """Symbols of the sizes."""
        own = {symbol.element_hash() for symbol in ca.vertsplit(self.coordinates)}
        parameters = [symbol for symbol in free_symbols(self.point) if symbol.element_hash() not in own]
        if taken := {symbol.name() for symbol in parameters} & set(self.names):
            raise ModelError(f"{self.name}: {min(taken)!r} is a coordinate; give the parameter another name")
        refuse_unknown(self.at, [*(symbol.name() for symbol in parameters), *self.names], f"{self.name}: at")
        return parameters

    def refuse(self, place: Sequence[float], parameters: Mapping[str, float]) -> None:
        """Raise ModelError if a condition does not hold at these coordinates and parameters (by name).

        A value below 1e-9 times that at the regular place counts as zero: cos(pi/2) is not exactly zero in
        floating point.
        """
        missing = [symbol.name() for symbol in self.parameters if symbol.name() not in parameters]
        if missing:
            raise ModelError(f"{self.name}: no value for {', '.join(missing)}")
        sizes = [parameters[symbol.name()] for symbol in self.parameters]
        regular = [self.at.get(name, 0.0) for name in self.names]
        for condition in self.conditions:
            function = ca.Function(
                "condition", [self.coordinates, ca.vertcat(*self.parameters)], [condition.expression]
            )
            value, scale = float(function(place, sizes)), abs(float(function(regular, sizes)))
            if not math.isfinite(value) or value <= (SMALLEST * scale if math.isfinite(scale) else 0.0):
                where = ", ".join(
                    f"{name} = {number:g}" for name, number in zip(self.names, place, strict=True)
                )
                raise ModelError(
                    f"{self.name}: {condition.about} (here {where}: {condition.expression} = {value:.3g})"
                )

    # -- internal --------------------------------------------------------------------------------------------

    @cached_property
    def _numbers(self) -> dict[float, ca.SX]:
        """Numbers that arithmetic would round, each with the symbol that represents it until a form is
        complete."""
        return {}

    def _number(self, value: float) -> ca.SX:
        """Return the number, or the symbol for one that is not a short binary fraction."""
        if not math.isfinite(value) or value == round(value * SHORT) / SHORT and abs(value) < SHORT:
            return ca.SX(value)
        return self._numbers.setdefault(value, ca.SX.sym(f"number_{len(self._numbers)}"))

    def _given(self, expression: ca.SX) -> ca.SX:
        """Return the expression with its numbers substituted."""
        if not self._numbers:
            return expression
        return ca.substitute(
            expression, ca.vertcat(*self._numbers.values()), ca.SX(ca.DM(list(self._numbers)))
        )

    @cached_property
    def _point(self) -> ca.SX:
        try:
            position = self.position(*ca.vertsplit(self.coordinates))
            parts = position if isinstance(position, list | tuple) else [position]
            entries = [matrix(part, f"{self.name}: the position") for part in parts]
        except TypeError as error:
            raise ModelError(
                f"{self.name}: the position must be a function of ({', '.join(self.names)}): {error}"
            ) from error
        point = ca.vertcat(*entries)
        if point.numel() != self.dimension:
            raise ModelError(
                f"{self.name}: the position must have {self.dimension} components, it has {point.numel()}"
            )

        def apply(code: int, arguments: tuple[ca.SX, ...]) -> ca.SX:
            if code in KINKS:
                raise ModelError(
                    f"{self.name}: not smooth, its position uses {KINKS[code]}; give one smooth part of the "
                    "surface"
                )
            return operate(code, *arguments)

        symbols = free_symbols(point)
        return ca.vertcat(*fold(point, symbols, symbols.__getitem__, self._number, apply))

    def _root(self, square: ca.SX, name: str) -> tuple[ca.SX, tuple[Condition, ...]]:
        """Return the root of a sum of squares, positive at the regular place, and what must be positive for
        it to be smooth.

        Squares are taken out of the root: sqrt(R^2 cos(u)^2) becomes R cos(u), smooth where |cos(u)| has a
        kink. A root in a denominator is moved to the numerator, so that one radicand is one radical.
        """
        from ..algebra.field import Field
        from ..algebra.ratios import NotRational

        if square.is_zero():
            raise ModelError(f"{self.name}: {name} is zero everywhere: not a {type(self).__name__.lower()}")
        try:
            rationals = Field(square)
            above, below = rationals.simplify().magnitude
            root, factors = self._root_of(rationals, above, name)
            divisor, others = self._root_of(rationals, below, name)
            positive = rationals.expression((self._upright(rationals, below, name), rationals.ring.one))
            root, factors = root * divisor / positive, [*factors, *others]
        except NotRational:
            root, factors = ca.sqrt(square), [square]
        for factor in factors:
            self._value(factor, name)
        cause = f": {self.singular}" if self.singular else ""
        return canonical(root), tuple(
            Condition(
                factor, f"{factor} must be positive; the coordinates are singular where it is zero{cause}"
            )
            for factor in map(self._given, factors)
            if not factor.is_constant()
        )

    def _root_of(self, rationals: "Field", polynomial: "PolyElement", name: str) -> tuple[ca.SX, list[ca.SX]]:
        """Return the root of a polynomial's magnitude, and its factors and radicand,
        each positive at the regular place."""
        from ..algebra.ratios import factored, number

        content, powers = factored(polynomial) if not polynomial.is_ground else (polynomial.LC, [])
        root, radicand, factors = self._number(math.sqrt(number(abs(content)))), rationals.ring.one, []
        for factor, power in powers:
            factor = self._upright(rationals, factor, name)
            if power % 2:
                radicand *= factor
            if power > 1:
                factors.append(rationals.expression((factor, rationals.ring.one)))
                root *= factors[-1] ** (power // 2)
        if radicand != 1:
            factors.append(_sum(rationals, radicand))
            root *= ca.sqrt(factors[-1])
        return root, factors

    def _upright(self, rationals: "Field", factor: "PolyElement", name: str) -> "PolyElement":
        """Return the factor or its negative, whichever is positive at the regular place."""
        return (
            factor if self._value(rationals.expression((factor, rationals.ring.one)), name) > 0 else -factor
        )

    def _value(self, expression: ca.SX, name: str) -> float:
        """Return the value at the regular place. Raises ModelError if it is zero or not finite."""
        values = {
            **dict.fromkeys(self.names, 0.0),
            **{s.name(): value for value, s in self._numbers.items()},
            **self.at,
        }
        symbols = free_symbols(expression)
        numbers = [values.get(s.name(), 1.0) for s in symbols]
        value = float(ca.Function("value", [ca.vertcat(*symbols)], [expression])(numbers))
        if not math.isfinite(value) or abs(value) <= SMALLEST:
            where = (
                ", ".join(f"{s.name()} = {number:g}" for s, number in zip(symbols, numbers, strict=True))
                or "all places"
            )
            raise ModelError(
                f"{self.name}: {name} is {'zero' if math.isfinite(value) else 'not finite'} at {where}; "
                "name a regular place with at={...}"
            )
        return value


@dataclass(frozen=True, eq=False)
class Surface(_Patch):
    """A patch f(u, v) of a body's surface, in the body's frame, m.

    `outward` is 1 if f_u x f_v points out of the body and -1 if it points into it.

    The first use of a property raises ModelError if the surface is not smooth, does not have three
    components, or `at` is singular.
    """

    outward: int = 1

    names = ("u", "v")
    dimension = 3

    @cached_property
    def metric(self) -> ca.SX:
        """First fundamental form, 2 x 2: |df|^2 = (du, dv) metric (du, dv)'."""
        return self._given(self._metric)

    @cached_property
    def orthogonal(self) -> bool:
        """Whether the coordinate lines are orthogonal, as Montana requires."""
        return ca.SX(self._metric[0, 1]).is_zero()

    @cached_property
    def M(self) -> ca.SX:
        """Metric form, 2 x 2: (x.f', y.f')' = M (u', v')'. Upper triangular, M'M = metric;
        diagonal when orthogonal."""
        E, F, _, _ = ca.vertsplit(ca.vec(self._metric))
        return self._given(
            canonical(ca.blockcat([[self._length, F / self._length], [0, self._area / self._length]]))
        )

    @cached_property
    def inverse(self) -> ca.SX:
        """M^-1, 2 x 2."""
        return self._given(self._inverse)

    @cached_property
    def frame(self) -> ca.SX:
        """Gauss frame [x y z], 3 x 3: x along f_u, z the outward normal, y = z x x;
        the columns in the body's frame."""
        E, F, _, _ = ca.vertsplit(ca.vec(self._metric))
        f_u, f_v = ca.horzsplit(self._tangents)
        y = (E * f_v - F * f_u) / (self._area * self._length)
        return self._given(canonical(ca.horzcat(f_u / self._length, y, self._normal / self._area)))

    @cached_property
    def K(self) -> ca.SX:
        """Curvature form, 2 x 2, symmetric: (x.z', y.z')' = K M (u',
        v')'. Positive where the body is convex, 1/m."""
        inverse = self._inverse
        return self._given(canonical(-inverse.T @ (self._second / self._area) @ inverse))

    @cached_property
    def turning(self) -> ca.SX:
        """T M, 1 x 2: y.x' = T M (u', v')', the turning of the frame about the normal;
        it depends on the metric only."""
        return self._given(self._turning)

    @cached_property
    def T(self) -> ca.SX:
        """Torsion form, 1 x 2: y.x' = T M (u', v')', 1/m."""
        return self._given(canonical(self._turning @ self._inverse))

    @cached_property
    def gaussian(self) -> ca.SX:
        """Gaussian curvature det K, 1/m^2. It has no root of the metric."""
        return self._given(canonical(ca.det(self._second) / ca.det(self._metric) ** 2))

    @cached_property
    def conditions(self) -> tuple[Condition, ...]:
        """Expressions that must be positive for all of the above to hold."""
        conditions: dict[str, Condition] = {}
        for condition in (*self.needs, *self._roots[0][1], *self._roots[1][1]):
            conditions.setdefault(str(condition.expression), condition)
        return tuple(conditions.values())

    # -- internal --------------------------------------------------------------------------------------------

    @cached_property
    def _roots(self) -> tuple[tuple[ca.SX, tuple[Condition, ...]], ...]:
        """|f_u| and |f_u x f_v|, the latter with the sign of `outward`."""
        if self.outward not in (1, -1):
            raise ModelError(f"{self.name}: outward must be 1 or -1, got {self.outward!r}")
        length = self._root(self._metric[0, 0], "|f_u|")
        area = self._root(canonical(ca.det(self._metric)), "|f_u x f_v|")
        return length, area

    @property
    def _length(self) -> ca.SX:
        return self._roots[0][0]

    @property
    def _area(self) -> ca.SX:
        return self.outward * self._roots[1][0]

    @cached_property
    def _tangents(self) -> ca.SX:
        """[f_u f_v], 3 x 2."""
        return canonical(ca.jacobian(self._point, self.coordinates))

    @cached_property
    def _metric(self) -> ca.SX:
        return canonical(self._tangents.T @ self._tangents)

    @cached_property
    def _normal(self) -> ca.SX:
        """f_u x f_v."""
        f_u, f_v = ca.horzsplit(self._tangents)
        return canonical(ca.cross(f_u, f_v))

    @cached_property
    def _second(self) -> ca.SX:
        """Second derivatives of f along f_u x f_v, 2 x 2."""
        return canonical(
            ca.horzcat(
                *[
                    canonical(ca.jacobian(f, self.coordinates).T) @ self._normal
                    for f in ca.horzsplit(self._tangents)
                ]
            )
        )

    @cached_property
    def _turning(self) -> ca.SX:
        E, F, _, _ = ca.vertsplit(ca.vec(self._metric))
        f_u, f_v = ca.horzsplit(self._tangents)
        along = canonical(E * f_v - F * f_u).T @ canonical(ca.jacobian(f_u, self.coordinates))
        return canonical(along / (E * self._area))

    @cached_property
    def _inverse(self) -> ca.SX:
        _, F, _, _ = ca.vertsplit(ca.vec(self._metric))
        return canonical(
            ca.blockcat(
                [[1 / self._length, -F / (self._length * self._area)], [0, self._length / self._area]]
            )
        )


def _sum(rationals: "Field", polynomial: "PolyElement") -> ca.SX:
    """Return a polynomial as a sum: the radicand of a root keeps its sign,
    which a common factor -1 would hide."""
    from ..algebra.ratios import number

    terms = [
        ca.SX(number(coefficient))
        * math.prod(
            (rationals.expressions[k] ** power for k, power in enumerate(powers) if power), start=ca.SX(1)
        )
        for powers, coefficient in polynomial.terms()
    ]
    return sum(terms[1:], start=terms[0])


def hollow(surface: Surface) -> Surface:
    """Return the same surface with the body on its other side: a bowl, the inside of a tube."""
    return replace(surface, name=f"hollow {surface.name}", outward=-surface.outward)


@dataclass(frozen=True, eq=False)
class Curve(_Patch):
    """A curve f(u) in the plane, m: the outline of a body in planar rolling."""

    names = ("u",)
    dimension = 2

    @cached_property
    def m(self) -> ca.SX:
        """|f'|, the planar metric form."""
        return self._given(self._root_and_conditions[0])

    @cached_property
    def K(self) -> ca.SX:
        """Curvature, 1/m: positive where the curve turns left."""
        f_u = ca.jacobian(self._point, self.coordinates)
        f_uu = ca.jacobian(f_u, self.coordinates)
        return self._given(
            canonical((f_u[0] * f_uu[1] - f_u[1] * f_uu[0]) / self._root_and_conditions[0] ** 3)
        )

    @property
    def conditions(self) -> tuple[Condition, ...]:
        """Expressions that must be positive for all of the above to hold."""
        return (*self.needs, *self._root_and_conditions[1])

    @cached_property
    def _root_and_conditions(self) -> tuple[ca.SX, tuple[Condition, ...]]:
        return self._root(canonical(ca.sumsqr(ca.jacobian(self._point, self.coordinates))), "|f_u|")


def backward(curve: Curve) -> Curve:
    """Return the same outline with the opposite direction."""
    at = {**curve.at, "u": -curve.at.get("u", 0.0)}
    return replace(curve, name=f"{curve.name} backward", position=lambda u: curve.position(-u), at=at)


# -- shipped surfaces and curves -----------------------------------------------------------------------------


def plane() -> Surface:
    """Return (u, v, 0) with the body below: z is the outward normal. u, v in m."""
    return Surface("plane", lambda u, v: (u, v, 0))


def sphere(R: ca.SX | float) -> Surface:
    """Return a sphere of radius R about the origin: u latitude, v longitude (rad), clockwise seen from above.
    Montana's example.
    """
    R, needs = _size(R, "sphere: radius R")
    return Surface(
        "sphere",
        lambda u, v: (R * ca.cos(u) * ca.cos(v), -R * ca.cos(u) * ca.sin(v), R * ca.sin(u)),
        singular="the poles, u = -pi/2 and u = pi/2",
        needs=needs,
    )


def cylinder(R: ca.SX | float) -> Surface:
    """Return a cylinder of radius R about the z axis: u angle (rad), v along the axis (m)."""
    R, needs = _size(R, "cylinder: radius R")
    return Surface("cylinder", lambda u, v: (R * ca.cos(u), R * ca.sin(u), v), needs=needs)


def ellipsoid(a: ca.SX | float, b: ca.SX | float, c: ca.SX | float) -> Surface:
    """Return an ellipsoid with half axes a, b, c along x, y, z; u, v (rad): latitude and longitude of the
    sphere before stretching.

    The coordinates are orthogonal if a = b.
    """
    (a, of_a), (b, of_b), (c, of_c) = (
        _size(size, f"ellipsoid: half axis {n}") for size, n in ((a, "a"), (b, "b"), (c, "c"))
    )
    return Surface(
        "ellipsoid",
        lambda u, v: (a * ca.cos(u) * ca.cos(v), -b * ca.cos(u) * ca.sin(v), c * ca.sin(u)),
        singular="the poles, u = -pi/2 and u = pi/2",
        needs=(*of_a, *of_b, *of_c),
    )


def torus(R: ca.SX | float, r: ca.SX | float) -> Surface:
    """Return a tube of radius r around a circle of radius R > r about the z axis: u around the tube,
    v along it (rad)."""
    (R, of_R), (r, of_r) = _size(R, "torus: radius R"), _size(r, "torus: radius r of the tube")
    _, of_both = _size(R - r, "torus: R - r")
    return Surface(
        "torus",
        lambda u, v: ((R + r * ca.cos(u)) * ca.cos(v), -(R + r * ca.cos(u)) * ca.sin(v), r * ca.sin(u)),
        needs=(*of_R, *of_r, *of_both),
    )


def line() -> Curve:
    """(u, 0), u in m."""
    return Curve("line", lambda u: (u, 0))


def circle(R: ca.SX | float) -> Curve:
    """Return a circle of radius R about the origin, u in rad, counterclockwise."""
    R, needs = _size(R, "circle: radius R")
    return Curve("circle", lambda u: (R * ca.cos(u), R * ca.sin(u)), needs=needs)


def _size(size: ca.SX | float, name: str) -> tuple[ca.SX, tuple[Condition, ...]]:
    """Return a length, number or symbol, and the condition that it is positive. Raises ModelError for a
    number that is not."""
    length = matrix(size, name)
    if length.shape != (1, 1):
        raise ModelError(f"{name} must be a number or a symbol")
    if length.is_constant():
        value = float(length)
        if isinstance(size, bool) or not math.isfinite(value) or value <= 0.0:
            raise ModelError(f"{name} = {value:g} must be positive and finite")
        return length, ()
    return length, (Condition(length, f"{name} must be positive"),)
