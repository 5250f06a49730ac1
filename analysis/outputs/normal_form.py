"""Normal-form coordinates T(x) = (h, rates of h, h~), the zero dynamics, and their stability.

Under the feedback (20) the outputs obey z1' = z2, z2' = v (relative degree 2) or z1' = v (relative degree 1).
The remaining z3 = h~(q) obeys z3' = J_h~ S Phi^-1 w, where w are the rates z2 and the outputs of relative
degree 1: it is driven by w only.

With a dynamic extension z2 has all derivatives below the relative degrees, and T is a function of q, nu and
the extension's xi.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations, islice

import casadi as ca
import numpy as np
import sympy as sp

from ...model.algebra.samples import Sampled
from ...model.errors import ModelError
from ...simulation.controllers.balance.steady import analyse_at_rest, listed
from ...simulation.controllers.balance.zero_dynamics import of_outputs
from ..exact.points import random_point
from ..exact.readable import readable
from ..exact.symbolic import written
from .decoupling import Decoupling, Slope
from .planar import Arm, Planar
from .shape import Shape, posture_names, shape_of, shape_of_others

CHOICES = 200  # largest number of h~ tried


@dataclass(frozen=True)
class Chart:
    """h~ = the coordinates `kept`; T is regular if Phi is and `minor` is not zero:
    det J_T = +-minor det Phi."""

    kept: tuple[sp.Symbol, ...]
    minor: sp.Expr
    everywhere: bool  # the minor is never zero


@dataclass(frozen=True)
class StraightMotion:
    """The zero dynamics while the reference moves at the speed V: the equation, and the steady state if it is
    stable.

    `stable_when` is empty if it is never stable; it applies to the heading and all of `shape`, or to the
    heading alone if the shape is unknown. `rate`, 1/s, is that of the linearized heading; the sign of
    `lookahead` (m) determines the stability of the heading. `names`: those of the symbols.
    """

    reference: str
    equation: str
    settles: str
    stable_when: str = ""
    rate: sp.Expr | None = None
    lookahead: sp.Expr | None = None
    shape: Shape = Shape((), ())
    names: Mapping[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        """A line."""
        decided = self.shape.decided
        stable = (
            f"{'' if decided else 'the heading is '}stable if and only if {self.stable_when}, then "
            f"{self.settles}"
        )
        settled = f"; {stable}" if self.stable_when else f": {self.settles}"
        return f"{self.reference}: {self.equation}{settled}{'' if decided else f'; {self.shape}'}"

    @property
    def symbols(self) -> dict[str, str]:
        """The symbols of SYMBOLS that occur in it, by their names here, with their meaning."""
        text = f"{self.equation} {self.settles}"
        used = {
            key: name
            for key, name in self.names.items()
            if key in SYMBOLS and re.search(rf"\b{name}\b", text)
        }
        return {name: SYMBOLS[key].format(**self.names) for key, name in used.items()}


SYMBOLS = {  # in the equations of StraightMotion
    "s": "n . (cos, sin)(heading), n the unit normal of the path at P_l; Phi is singular where |{s}| = 1",
    "chi": "curvature of the path at P_l, positive where n points away from its centre",
    "V": "speed of the reference, negative in reverse",
    "psi": "direction in which P_l moves",
}


@dataclass(frozen=True, eq=False)
class NormalForm:
    """`charts`: choices of h~; where Phi is regular, the rows of J_h are independent, so that one of them is
    regular.

    `offset`: the outputs of relative degree 1 at nu = 0; None if one is not affine in nu with derivatives in
    q only.
    """

    decoupling: Decoupling
    charts: tuple[Chart, ...]
    offset: dict[int, sp.Expr] | None

    @property
    def dimension(self) -> int:
        """Dimension of z3 and of the zero dynamics: n minus the number of outputs of relative degree 2."""
        return len(self.charts[0].kept)

    @property
    def T(self) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
        """Names of z1, z2, z3."""
        linearization = self.decoupling.linearization
        names = [row.name for row in linearization.output.rows]
        degrees = zip(names, linearization.relative_degree, strict=True)
        rates = tuple(f"{name}_{order * 'd'}ot" for name, degree in degrees for order in range(1, degree))
        return tuple(names), rates, tuple(map(str, self.charts[0].kept))

    @cached_property
    def equations(self) -> dict[str, sp.Expr]:
        """z3' in closed form, by coordinate, in z2 and the outputs of relative degree 1;
        empty if there is none."""
        linearization = self.decoupling.linearization
        names = zip(linearization.output.rows, linearization.relative_degree, strict=True)
        return self._rates(
            [sp.Symbol(f"{row.name}_dot" if degree == 2 else row.name) for row, degree in names]
        )

    @cached_property
    def zero_dynamics(self) -> str:
        """z3' with all outputs and their rates zero, as one line."""
        if self.offset is None:
            return "an output is not affine in the quasi-velocities: no closed form"
        if not any(self.offset.values()):
            return "z3' = 0"
        rates = self._rates([sp.Integer(0)] * self.decoupling.Phi.rows)
        return ", ".join(f"{name}' = {written(rate)}" for name, rate in rates.items())

    @property
    def stability(self) -> str:
        """Stability of the zero dynamics."""
        stands = self.offset is not None and not any(self.offset.values())
        return "Lagrange stable, not asymptotically stable" if stands else "not decided"

    @cached_property
    def shape(self) -> Shape:
        """The coordinates besides the heading on which the motion depends; empty without an axle."""
        decoupling = self.decoupling
        return (
            shape_of(decoupling)
            if decoupling.planar and decoupling.planar.ahead is not None
            else Shape((), ())
        )

    @cached_property
    def moving(self) -> tuple[StraightMotion, ...]:
        """For a vehicle in the plane, with references that move steadily; empty if no rule is known."""
        decoupling, vehicle = self.decoupling, self.decoupling.planar
        if vehicle is None or vehicle.ahead is None or self.offset is None:
            return ()
        arguments = decoupling, vehicle, self.shape
        return _along_a_path(*arguments) + _point_moving(*arguments) + _heading_held(*arguments)

    def _rates(self, w: Sequence[sp.Expr]) -> dict[str, sp.Expr]:
        """z3' = J_h~ S Phi^-1 (w - offset), by coordinate."""
        if self.offset is None:
            return {}
        driving = [entry - self.offset.get(k, 0) for k, entry in enumerate(w)]
        return {
            name: sp.Add(*[a * b for a, b in zip(row, driving, strict=True)])
            for name, row in self._driven.items()
        }

    @cached_property
    def _driven(self) -> dict[str, list[sp.Expr]]:
        """Rows of J_h~ S Phi^-1, by coordinate."""
        decoupling = self.decoupling
        rows = decoupling.S * decoupling.Phi.adjugate()
        kept = {str(name): decoupling.q.index(name) for name in self.charts[0].kept}
        return {
            name: [decoupling.over_determinant(entry) for entry in rows.row(k)] for name, k in kept.items()
        }


@dataclass(frozen=True, eq=False)
class ExtendedForm(NormalForm):
    """The normal form after a dynamic extension. Wherever Phi is regular the derivatives in z1 and z2 are
    independent; h~ is

    - `cyclic`: coordinates on which neither the motion nor the outputs depend. Their rates are functions of
      z1 and z2;
    - for a path, `along`, the length of it behind P_l: with the distance at rest P_l moves along it at the
      reference's speed;
    - `others`: coordinates of joints. They are the zero dynamics.
    """

    cyclic: tuple[str, ...] = ()
    others: tuple[str, ...] = ()
    along: bool = False

    @property
    def equations(self) -> dict[str, sp.Expr]:  # type: ignore[override]
        """Empty: no closed form is derived."""
        return {}

    @property
    def zero_dynamics(self) -> str:  # type: ignore[override]
        """What moves while the outputs follow a reference that moves."""
        follow = [f"the rates of {', '.join(self.cyclic)} follow from the outputs"] if self.cyclic else []
        along = [f"{self.decoupling.names['along_path']}' is the speed of P_l"] if self.along else []
        return "; ".join([str(self.shape) if self.others else "none", *follow, *along])

    @cached_property
    def shape(self) -> Shape:
        """The coordinates of joints, with the motion of the outputs held."""
        return shape_of_others(self.decoupling, self.others) if self.others else Shape((), ())

    @property
    def stability(self) -> str:
        """Stability of `others`."""
        if not self.others:
            return "nothing is left that could diverge"
        return (
            f"stable while driving straight if and only if {stable}"
            if (stable := self._stable_when)
            else "not decided"
        )

    @cached_property
    def moving(self) -> tuple[StraightMotion, ...]:  # type: ignore[override]
        """Straight driving, if others are left."""
        if not self.others or not self.shape.decided:
            return ()
        names = self.decoupling.names
        settles = ", ".join(each.settles(names["psi"]) for each in self.shape.followers)
        equation = f"P_l moves in the direction {names['psi']}"
        reference = f"{names['V']} straight ahead"
        return (
            StraightMotion(reference, equation, settles, self._stable_when, shape=self.shape, names=names),
        )

    @property
    def _stable_when(self) -> str:
        ways = {each.way for each in self.shape.followers}
        return "" if len(ways) != 1 else f"{self.decoupling.names['V']} {'>' if ways == {1} else '<'} 0"


@dataclass(frozen=True, eq=False)
class PartialForm(NormalForm):
    """The normal form of outputs of an underactuated robot: h~ is the rest of the state [q; nu]. Its zero
    dynamics are judged at rest, by numbers: `zero_dynamics` are their `modes` (None: not judged), `stability`
    the verdict.
    """

    modes: np.ndarray | None = None
    zero_dynamics: str = ""  # type: ignore[assignment]
    stability: str = ""  # type: ignore[assignment]

    @property
    def equations(self) -> dict[str, sp.Expr]:  # type: ignore[override]
        """Empty: no closed form is derived."""
        return {}

    @cached_property
    def moving(self) -> tuple[StraightMotion, ...]:  # type: ignore[override]
        """Empty: no rule is known."""
        return ()


def normal_form(decoupling: Decoupling) -> NormalForm:
    """Choose h~ among the coordinates, of an underactuated robot among the states."""
    if decoupling.linearization.integrators:
        return _extended_form(decoupling)
    if decoupling.linearization.system.underactuated:
        return _partial_form(decoupling)
    degree = decoupling.linearization.relative_degree
    gradients = decoupling.gradients.extract(
        [k for k in range(len(degree)) if degree[k] == 2], list(range(len(decoupling.q)))
    )
    offset = {k: decoupling.lowest(_offset(decoupling, k, rate)) for k, rate in decoupling.rates.items()}
    moves = {s for expression in (*decoupling.Phi, *offset.values()) for s in expression.free_symbols} & set(
        decoupling.nu
    )
    return NormalForm(decoupling, _charts(decoupling, gradients), None if moves else offset)


def _offset(decoupling: Decoupling, k: int, rate: sp.Expr) -> sp.Expr:
    """Return rate - Phi_k nu, where Phi_k is the gradient of the rate by nu:
    its value at rest if Phi_k does not depend on nu."""
    row = decoupling.Phi.row(k)
    if row.has(*decoupling.nu):
        return rate - (row * sp.Matrix(decoupling.nu))[0]
    return rate.xreplace(dict.fromkeys(decoupling.nu, sp.Integer(0)))


def _extended_form(decoupling: Decoupling) -> ExtendedForm:
    """Choose h~ of an extended system: cyclic coordinates, the position along a path, joints.

    Raises ModelError if these are not all that is left.
    """
    linearization = decoupling.linearization
    system, integrators = linearization.system, linearization.integrators
    assert integrators is not None
    z = ca.vertcat(linearization.h, linearization.rate)
    motion = ca.vertcat(z, ca.vec(linearization.Phi), linearization.drift, ca.vec(system.S))
    state = ca.vertcat(system.mechanism.q, system.nu, integrators.xi)
    cyclic = [c for c in system.mechanism.coordinates if not ca.depends_on(motion, c.symbol)]
    along = [sp.Symbol(decoupling.names["along_path"])] if linearization.output.path else []
    by_name = {c.name: c for c in system.mechanism.coordinates}
    joints = [by_name[name] for name in reversed(posture_names(system)) if by_name[name] not in cyclic]
    left = state.numel() - z.numel()
    count = left - len(cyclic) - len(along)
    for others in combinations(joints, count) if 0 <= count <= len(joints) else ():
        kept = [*cyclic, *reversed(others)]
        T = ca.vertcat(z, *[c.symbol for c in kept])
        if integrators.sampled(ca.jacobian(T, state), linearization.output).rank() == T.numel():
            chart = Chart((*[sp.Symbol(c.name) for c in kept], *along), sp.Integer(1), True)
            names = tuple(c.name for c in cyclic), tuple(c.name for c in reversed(others))
            return ExtendedForm(decoupling, (chart,), None, *names, bool(along))
    raise ModelError(
        f"{decoupling.functions.name}: the dynamic extension leaves {left} states besides the outputs' "
        "derivatives, whose zero dynamics are not decided: they are not "
        f"{', '.join(c.name for c in (*cyclic, *joints)) or 'cyclic'} alone"
    )


def _partial_form(decoupling: Decoupling) -> PartialForm:
    """Choose h~ among the states, coordinates first, and judge the zero dynamics at rest."""
    linearization = decoupling.linearization
    system, chosen, kept = (
        linearization.system,
        ca.vertcat(linearization.h, linearization.rate),
        list[sp.Symbol](),
    )
    state = ca.vertcat(system.mechanism.q, system.nu)
    parameters = (*system.mechanism.parameters, *linearization.output.parameters)
    for quantity in system.state:
        longer = ca.vertcat(chosen, quantity.symbol)
        if (
            Sampled(ca.jacobian(longer, state), state, parameters, decoupling.functions.name).rank()
            == longer.numel()
        ):
            chosen = longer
            kept.append(sp.Symbol(quantity.name))
    try:
        found = of_outputs(analyse_at_rest(system.mechanism), linearization)
    except ModelError as error:
        modes, judged = None, ("not decided", str(error))
    else:
        modes = found.modes
        judged = "not judged" if modes is None else f"at rest {listed(modes)} 1/s", found.verdict
    return PartialForm(decoupling, (Chart(tuple(kept), sp.Integer(1), True),), None, modes, *judged)


def _charts(decoupling: Decoupling, gradients: sp.Matrix) -> tuple[Chart, ...]:
    """Return the simplest choices first: those regular everywhere,
    then by the minor of the coordinates omitted."""
    n, count = len(decoupling.q), gradients.rows
    general = random_point(decoupling.functions, 0)
    charts = []
    for gone in islice(combinations(range(n), count), CHOICES):
        minor = gradients.extract(list(range(count)), list(gone)).det(method="berkowitz")
        above, _ = decoupling.functions.ratio(minor)
        if above and general(above):
            kept = tuple(decoupling.q[k] for k in range(n) if k not in gone)
            everywhere = decoupling.functions.never_zero(above)
            chart = Chart(kept, decoupling.lowest(minor), everywhere)
            charts.append((not everywhere, len(above), sum(map(sum, above)), chart))
    return tuple(chart for *_, chart in sorted(charts, key=lambda each: each[:3]))


# -- moving references ---------------------------------------------------------------------------------------
#
# A point P_l of the vehicle, (l, w) from the middle of the axle, moves at v e + omega (l e_left - w e), where
# e is the heading vector, v the forward speed of the vehicle's point and omega the yaw rate. That an output
# obeys this is checked exactly.


def _along_a_path(decoupling: Decoupling, vehicle: Planar, shape: Shape) -> tuple[StraightMotion, ...]:
    """Distance from a path and forward speed, held at 0 and V.

    With n the unit normal at P_l, e_n = n . e and chi the curvature of the path (positive where n points away
    from the centre), h1' = 0 gives omega = -V e_n / (l n . e_left) for w = 0; n turns with P_l, and s = e_n
    obeys l s' = -V (s - l chi).
    """
    if decoupling.normal is None:
        return ()
    followed = _points(
        decoupling,
        vehicle,
        [slope or (decoupling.normal.x, decoupling.normal.y) for slope in decoupling.slopes],
    )
    speed = next(
        (k for k in decoupling.rates if _same(decoupling, decoupling.Phi.row(k), vehicle.forward)), None
    )
    if not followed or speed is None or decoupling.slopes[followed[0].row] is not None:
        return ()
    arm, names = followed[0].arm, decoupling.names
    s, V, bent = names["s"], sp.Symbol(names["V"]), names["chi"]
    if not arm.ahead:
        return ()  # beside the axle: Phi is singular where the heading is along the path
    lookahead, rate, chi = _factor(arm.ahead), -V / arm.ahead, decoupling.normal.chi
    stable_when = _stable_when(shape, V, arm.ahead)
    if arm.left:
        reference, settles = f"{V} along a straight path", "the heading is along it"
        equation = f"small deviations of the heading change at the rate {written(rate)}"
    else:
        reference = (
            f"{V} along a path of small curvature" if shape.followers and chi != 0 else f"{V} along the path"
        )
        equation = f"{lookahead}*{s}' = -{V}*({s} - {lookahead}*{bent})"
        if chi is None:
            settles = f"{s} follows {lookahead}*{bent}, and |{s}| < 1 while |{lookahead}*{bent}| < 1"
        elif not chi:
            settles = f"{s} -> 0 ({bent} = 0)"
        else:
            settles = (
                f"{s} -> {written(arm.ahead * chi)} ({bent} = {written(chi)}), which must be below 1 in size"
            )
    if not stable_when:
        settles = "never stable"
    return (StraightMotion(reference, equation, settles, stable_when, rate, arm.ahead, shape, names),)


def _point_moving(decoupling: Decoupling, vehicle: Planar, shape: Shape) -> tuple[StraightMotion, ...]:
    """Both coordinates of P_l, moving at (V cos psi, V sin psi):
    its component across the vehicle is l omega."""
    points = _points(decoupling, vehicle, decoupling.slopes)
    if len(points) != 2 or points[0].arm != points[1].arm:
        return ()
    if not sp.Matrix([point.slope for point in points]).det():
        return ()
    ahead, heading, factor = points[0].arm.ahead, written(vehicle.heading), _factor(vehicle.heading)
    V, psi = decoupling.names["V"], decoupling.names["psi"]
    equation = f"{_factor(ahead)}*{factor}' = {V}*sin({psi} - {factor})"
    forward, backward = map(_losing, map(shape.lost, (1, -1)))
    settles = (
        f"{heading} -> {psi}, driving forward{forward}; else {heading} -> {psi} + pi, driving in "
        f"reverse{backward}"
    )
    stable_when = f"{written(ahead)} > 0"
    if forward:
        stable_when, settles = "", f"for {stable_when} {settles}"
    rate, reference = -sp.Symbol(V) / ahead, f"{V} > 0 in the direction {psi}"
    return (StraightMotion(reference, equation, settles, stable_when, rate, ahead, shape, decoupling.names),)


def _heading_held(decoupling: Decoupling, vehicle: Planar, shape: Shape) -> tuple[StraightMotion, ...]:
    """Return the motion with one coordinate of P_l and the heading held:
    the other coordinate is not controlled."""
    points = _points(decoupling, vehicle, decoupling.slopes)
    second_degree = [k for k in range(decoupling.Phi.rows) if k not in decoupling.rates]
    turns = any(_same(decoupling, decoupling.Phi.row(k), vehicle.yaw) for k in second_degree)
    if not points or not turns:
        return ()
    (g_x, g_y), name = points[0].slope, decoupling.linearization.output.rows[points[0].row].name
    V = decoupling.names["V"]
    equation = (
        f"forward speed = {written(sp.Symbol(V) / readable(g_x * vehicle.cosine + g_y * vehicle.sine))}"
    )
    settles = "the other coordinate of P_l drifts, neither controlled nor bounded"
    return (
        StraightMotion(
            f"{name} at {V}, heading held", equation, settles, shape=shape, names=decoupling.names
        ),
    )


def _stable_when(shape: Shape, V: sp.Symbol, lookahead: sp.Expr) -> str:
    """Return the condition that all rates of straight driving are negative:
    -V/lookahead and those of the shape. Empty: never."""
    ways = {each.way for each in shape.followers}
    if not ways:
        return f"{written(V * lookahead)} > 0"
    return (
        ""
        if len(ways) > 1
        else " and ".join(f"{written(e)} {'>' if ways == {1} else '<'} 0" for e in (V, lookahead))
    )


def _losing(names: Sequence[str]) -> str:
    return f", where {', '.join(names)} {'diverges' if len(names) == 1 else 'diverge'}" if names else ""


def _factor(expression: sp.Expr) -> str:
    """Return text that can be multiplied."""
    return f"({written(expression)})" if expression.is_Add else written(expression)


@dataclass(frozen=True)
class _MovingPoint:
    """An output that moves like a point of the vehicle in the direction of its gradient."""

    row: int
    arm: Arm
    slope: Slope


def _points(decoupling: Decoupling, vehicle: Planar, slopes: Sequence[Slope | None]) -> list[_MovingPoint]:
    """Return the outputs that move like a point of the vehicle,
    each in the direction given for its row, exactly."""
    points = []
    for row, (arm, slope) in enumerate(zip(decoupling.arms, slopes, strict=True)):
        if arm and slope:
            along = slope[0] * vehicle.cosine + slope[1] * vehicle.sine
            left = slope[1] * vehicle.cosine - slope[0] * vehicle.sine
            moves = vehicle.forward * along + vehicle.yaw * (arm.ahead * left - arm.left * along)
            points += (
                [_MovingPoint(row, arm, slope)] if _same(decoupling, decoupling.Phi.row(row), moves) else []
            )
    return points


def _same(decoupling: Decoupling, a: sp.Matrix, b: sp.Matrix) -> bool:
    return all(decoupling.is_zero(x - y) for x, y in zip(a, b, strict=True))
