"""Input-output linearization: relative degrees, decoupling matrix (15), its derivative,
second feedback (20)."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from .algebra.exact import canonical
from .algebra.expression import degree as degree_in
from .algebra.linear import condition, row_norms_squared, solve
from .algebra.poles import determinant, quotient, without_pole
from .algebra.samples import Sampled, dependent_sets, rank
from .errors import ModelError
from .extension import Chain, Integrators, extend
from .mechanism import Quantity
from .outputs import OutputMap, OutputRow, following
from .paths import SMOOTH
from .reduction import ReducedSystem, counted
from .underactuated import passive_equations, passive_names
from .vehicle import velocity_map

SINGULAR = 1e-5  # Phi is regarded as singular if its measure (`Linearization.measure`) is at or below this
SINGULAR_SQUARED = 1e-10  # the same for squares, which avoid a root
STEEPEST = 4 * math.sqrt(6) / 9  # largest x (2 - x^2) for |x| < 1, at x^2 = 2 / 3
ASIDE = 0.01  # of the speed normal to the path: how fast P_l moves aside in the middle of the band


@dataclass(frozen=True, eq=False)
class Linearization:
    """Input-output linearization of a reduced system: y_i^(k) = drift_i + (Phi u)_i with k =
    relative_degree[i], 1 or 2.

    Of a `kinematic` law the quasi-velocities nu take the place of u: y_i^(k) = drift_i + (Phi nu)_i with k
    one less, and the same Phi. Nothing but h depends on nu then; `rate` and `Phidot` are empty.

    Symbolic, in q, nu and parameters: outputs `h` ((n-m) x 1), derivatives `rate` of order 1 to k - 1 of each
    row in order, decoupling matrix `Phi` (15) and its time derivative `Phidot` (both (n-m) x (n-m)), `drift`
    ((n-m) x 1). Units are those of the output map's rows, per second for each derivative.

    With a dynamic extension, `integrators`, k may be larger, the inputs of the integrators take the place of
    u, all but h depend on their states xi too, and `Phidot`, which no law needs, is 0 x 0.

    With fewer inputs than n-m there are as many outputs as inputs, r. The last n-m-r rows of Phi and drift
    are then those of `passive_equations`, 0 = drift + Phi u, which hold whatever the inputs are (partial
    feedback linearization, see underactuated.py): Phi is regular where inertia couples the outputs to the
    inputs.
    """

    system: ReducedSystem
    output: OutputMap
    relative_degree: tuple[int, ...]
    h: ca.SX
    rate: ca.SX
    Phi: ca.SX
    Phidot: ca.SX
    drift: ca.SX
    integrators: Integrators | None = None

    @property
    def extension(self) -> tuple[Quantity, ...]:
        """The states xi of the integrators; empty without an extension."""
        return self.integrators.states if self.integrators else ()

    @property
    def kinematic(self) -> bool:
        """Whether nu takes the place of u."""
        return self.output.kinematic

    @property
    def inputs(self) -> tuple[str, ...]:
        """The names of the columns of Phi: quasi-velocities,
        or with an extension the inputs of the integrators."""
        return (
            self.integrators.inputs
            if self.integrators
            else tuple(q.name for q in self.system.quasi_velocities)
        )

    @property
    def row_names(self) -> tuple[str, ...]:
        """The names of the rows of Phi: outputs, and the quasi-velocities of the passive equations."""
        return (*(row.name for row in self.output.rows), *passive_names(self.system))

    @cached_property
    def determinant(self) -> ca.SX:
        """Return det Phi."""
        return self._checked("det Phi", canonical(ca.det(self.Phi)), (self.Phi,), determinant)

    @property
    def scale_squared(self) -> ca.SX:
        """Return the square of the product of Phi's row norms, an upper bound of (det Phi)^2."""
        return row_norms_squared(self.Phi)

    @cached_property
    def measure(self) -> tuple[ca.SX, ca.SX]:
        """Return two nonnegative expressions; Phi is regular where the first exceeds SINGULAR times the
        second.

        Up to 2 x 2 these are |det Phi| and the product of Phi's row norms; above, 1 and the condition number
        |Phi| |Phi^-1| in the 1-norm. Phi is used in the units of the outputs and quasi-velocities, without
        scaling.
        """
        if self.Phi.shape[0] > 2:
            return ca.SX(1), condition(self.Phi)
        plain = ca.fabs(self.determinant), ca.sqrt(self.scale_squared)
        if self.damping is None:
            return plain
        damped, inside = self.damping.measure, self.damping.inside
        return ca.if_else(inside, damped[0], plain[0]), ca.if_else(inside, damped[1], plain[1])

    @property
    def measures(self) -> tuple[tuple[ca.SX, ca.SX], ...]:
        """Return `measure`, and that of S'E where it changes with q and inputs are computed: the law is
        regular where each first exceeds SINGULAR times its second.
        """
        inputs = None if self.kinematic else self.system.input_measure
        return (self.measure, inputs) if inputs else (self.measure,)

    @cached_property
    def damping(self) -> "Damping | None":
        """What replaces the inverse of Phi near its singular set; None unless the output has a band. Raises
        ModelError as `Damping` does.
        """
        return Damping(self, self.output.band) if self.output.band else None

    def second_feedback(self, v: ca.SX) -> ca.SX:
        """Return u = Phi^-1 (v - drift) (20), (n-m) x 1, which makes the highest derivatives equal to v. With
        an extension the inputs of the integrators.
        """
        right = ca.vertcat(v, ca.SX.zeros(self.drift.numel() - v.numel())) - self.drift
        small = self.Phi.shape[0] <= 3
        w = ca.adj(self.Phi) @ right / self.determinant if small else solve(self.Phi, right)
        return self._checked("u", w, (self.Phi, right), quotient)

    def accelerations(self, w: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return u, (n-m) x 1, and d xi/dt, k x 1, of what `second_feedback` returns: u itself,
        unless there is an extension."""
        return self.integrators.rates(w) if self.integrators else (w, ca.SX(0, 1))

    def _checked(
        self, name: str, formula: ca.SX, parts: Sequence[ca.SX], combined: Callable[..., np.ndarray | None]
    ) -> ca.SX:
        moving = ca.vertcat(self.system.mechanism.q, self.system.nu, *[q.symbol for q in self.extension])
        return without_pole(self.system.mechanism.name, name, formula, parts, combined, moving)


class Damping:
    """The inverse of Phi of Type IV, damped where the heading is nearly normal to the path.

    With the forward acceleration and the yaw acceleration as inputs, only the latter is divided by something
    that vanishes. Let P_l have the velocity a omega at a yaw rate omega alone, n be the gradient of the
    distance, and c the cosine of the angle between the two; n a = |n| |a| c. For |c| below the band of the
    output, x = c / band, 1 / c becomes x (2 - x^2) / band. This is c / (c^2 + lambda) with lambda = band^2
    (1 - x^2)^2 / (2 - x^2), a damped inverse (Y. Nakamura and H. Hanafusa, J. Dyn. Sys., Meas., Control 108,
    1986) whose lambda vanishes with its slope at the edge of the band.

    What does not need the inverse is applied beside it, and not damped: the acceleration at which P_l has
    none, and the damping -kd omega of the outer loop. In the middle of the band P_l moves aside at ASIDE of
    the speed normal to the path, towards the side on which P_l moves along the path, so that the heading does
    not stay normal where it is an equilibrium.

    Raises ModelError if P_l does not move with fixed combinations of the quasi-velocities, forward speed and
    yaw rate.
    """

    def __init__(self, linearization: Linearization, band: Quantity):
        system, output = linearization.system, linearization.output
        W = velocity_map(system)
        where = f"{system.mechanism.name}, output {output.name}"
        if why := system.mechanism.why_carried:
            raise ModelError(f"{where}: {why}, as a damped inverse requires; take the law without damping")
        if W is None:
            raise ModelError(
                f"{where}: a damped inverse requires a vehicle whose forward speed and yaw rate are fixed "
                "combinations of the quasi-velocities; take the law without damping"
            )
        if linearization.integrators or linearization.kinematic:
            raise ModelError(
                f"{where}: a damped law has no dynamic extension, and commands inputs, not velocities"
            )
        self.linearization = linearization
        (through,) = [row.through for row in output.rows if row.through]
        J = ca.jacobian(through.inner, system.mechanism.q) @ system.S
        hessian, gradient = ca.hessian(through.outer, through.symbols)
        hessian, normal = (
            ca.substitute(each, through.symbols, through.inner) for each in (hessian, gradient.T)
        )
        self.directions = canonical(solve(W, ca.SX.eye(2)))  # of nu: forward, and turning
        self.speed, self.turning = ca.vertsplit(W @ system.nu)
        self.rest = -canonical(solve(J, system.along_motion(J) @ system.nu))
        self.curvature = ca.bilin(hessian, J @ system.nu, J @ system.nu)
        self.forward, self.aside = ca.horzsplit(normal @ J @ self.directions)
        self.size = ca.norm_2(normal) * ca.sqrt(canonical(ca.sumsqr(J @ self.directions[:, 1])))
        self.x = self.aside / (self.size * band.symbol)
        self.inverse = self.x * (2 - self.x**2) / (band.symbol * self.size)
        self.W, self.J = W, J

    @property
    def inside(self) -> ca.SX:
        """Whether the state is within the band."""
        return self.x**2 < 1

    @property
    def measure(self) -> tuple[ca.SX, ca.SX]:
        """Return two nonnegative expressions; P_l can be accelerated in each direction where the first
        exceeds SINGULAR times the second.
        """
        return ca.fabs(self.determinant), ca.sqrt(self.scale_squared)

    @property
    def determinant(self) -> ca.SX:
        """Return det J of the velocity J nu of P_l."""
        return canonical(ca.det(self.J))

    @property
    def scale_squared(self) -> ca.SX:
        """Return the square of the product of J's row norms."""
        return ca.sumsqr(self.J[0, :]) * ca.sumsqr(self.J[1, :])

    @property
    def lost(self) -> ca.SX:
        """Return the part of the asked yaw acceleration that is not done: 1 in the middle of the band,
        0 at its edge."""
        return (1 - self.x**2) ** 2

    def second_feedback(self, v: ca.SX, kd: ca.SX) -> ca.SX:
        """Return u within the band, 2 x 1, from the virtual input and the gain of the rate of the
        distance."""
        forward = v[1] - self.linearization.drift[1] - self.W[0, :] @ self.rest
        asked = v[0] + kd * self.aside * self.turning - self.curvature
        lean = ASIDE * self.lost * self.forward * self.speed / self.size
        turning = (asked - self.forward * forward) * self.inverse - kd * (self.turning + lean)
        return self.rest + self.directions @ ca.vertcat(forward, turning)


def linearize(system: ReducedSystem, output: OutputMap) -> Linearization:
    """Return the linearization: the relative degree of each row, Phi, its derivative along the motion and the
    drift.

    A row that depends on nu has degree 1; its row of Phi is dh/dnu. A row h(q) has degree 2; its row of Phi
    is dh/dq S. If the output map allows an extension and Phi is singular everywhere, see `extend`.
    Raises ModelError if the output map does not belong to this system (`OutputMap.check`), the number of rows
    is not n-m, or with fewer inputs that of the inputs, a row of Phi vanishes identically, or Phi is singular
    everywhere; for a kinematic law also if an output is not affine in nu.
    """
    where = f"{system.mechanism.name}, output {output.name}"
    if len(output.rows) != min(system.dof, len(system.mechanism.inputs)):
        raise ModelError(f"{where}: {_not_square(system, output)}")
    output.check(system)
    if system.underactuated and (output.extension or output.kinematic):
        raise ModelError(f"{where}: {_only_dynamic(output)}")
    followed = following(system, output)
    output_chains, integrators = chains(followed, output), None
    if output.extension and _sampled(followed, output, _rows(output_chains)).rank() < system.dof:
        output_chains, integrators = extend(followed, output_chains, output)
    if output.foot and max(chain.degree for chain in output_chains) > SMOOTH + 2:
        raise ModelError(
            f"{where}: the distance has a relative degree above {SMOOTH + 2}, and a course no more "
            "derivatives"
        )
    passive, passive_drift = passive_equations(system)
    Phi = ca.vertcat(_rows(output_chains), passive)
    _check_regular(followed, output, Phi, integrators)
    if output.kinematic:
        return _kinematic(system, output, output_chains)
    if integrators:
        at = output.at_foot_values(integrators.drift), output.at_foot_values(integrators.effect)
        integrators = replace(integrators, drift=at[0], effect=at[1])
    found = Linearization(
        system,
        output,
        tuple(chain.degree for chain in output_chains),
        ca.vertcat(*[row.expression for row in output.rows]),
        output.at_foot_values(
            ca.vertcat(ca.SX(0, 1), *[rate for chain in output_chains for rate in chain.rates])
        ),
        output.at_foot_values(ca.densify(Phi)),
        ca.SX(0, 0) if integrators else output.at_foot_values(ca.densify(followed.along_motion(Phi))),
        output.at_foot_values(ca.vertcat(*[chain.drift for chain in output_chains], passive_drift)),
        integrators,
    )
    return _with_needed(found)


def _with_needed(found: Linearization) -> Linearization:
    """Return the linearization without the parameters of a course that it does not use,
    derivatives of high order."""
    if found.output.foot is None:
        return found
    used = ca.vertcat(found.h, found.rate, ca.vec(found.Phi), ca.vec(found.Phidot), found.drift)
    needed = tuple(q for q in found.output.parameters if ca.depends_on(used, q.symbol))
    foot = found.output.foot.up_to(sum(q.name.startswith("curvature") for q in needed))
    return replace(found, output=replace(found.output, parameters=needed, foot=foot))


def _kinematic(system: ReducedSystem, output: OutputMap, output_chains: Sequence[Chain]) -> Linearization:
    """Return the linearization of a kinematic law: an output h(q) has degree 1, hdot = Phi nu; one h(q, nu) =
    Phi nu + drift has degree 0.
    """
    degrees, drift = tuple(chain.degree - 1 for chain in output_chains), []
    still = ca.SX.zeros(system.dof)
    for row, degree in zip(output.rows, degrees, strict=True):
        if degree_in(canonical(row.expression), system.nu) > 1:
            raise ModelError(
                f"{system.mechanism.name}, output {output.name}: row {row.name!r} is not affine in the "
                "quasi-velocities, as a kinematic law requires"
            )
        drift.append(ca.SX(0) if degree else canonical(ca.substitute(row.expression, system.nu, still)))
    h, none = ca.vertcat(*[row.expression for row in output.rows]), ca.SX(0, 1)
    Phi = output.at_foot_values(ca.densify(_rows(output_chains)))
    return _with_needed(Linearization(system, output, degrees, h, none, Phi, ca.SX(0, 0), ca.vertcat(*drift)))


def chains(system: ReducedSystem, output: OutputMap) -> list[Chain]:
    """Return each output as a chain of integrators, of degree 1 or 2. Raises ModelError for one that no input
    affects."""
    return [_chain(system, output, row, row.in_motion) for row in output.rows]


def _chain(system: ReducedSystem, output: OutputMap, row: OutputRow, expression: ca.SX) -> Chain:
    where = f"{system.mechanism.name}, output {output.name}"
    first, first_drift = derivative(system, expression, 1)
    if not _vanishes(system, output, first):
        return Chain((), first, first_drift)
    if degree_in(canonical(expression), system.nu) == math.inf:
        raise ModelError(
            f"{where}: row {row.name!r} depends on the quasi-velocities, but its derivative by them vanishes "
            "(a step, or a constant part); replace it by an output whose rate depends on the inputs"
        )
    second, second_drift = derivative(system, expression, 2)
    if _vanishes(system, output, second):
        raise ModelError(
            f"{where}: row {row.name!r} of Phi vanishes identically: neither the output nor its rate depends "
            "on an input, because the constraints keep the output constant; replace it by one that moves"
        )
    return Chain((second @ system.nu + carried_rate(system, expression),), second, second_drift)


def _rows(output_chains: Sequence[Chain]) -> ca.SX:
    """Return Phi."""
    return ca.vertcat(*[chain.row for chain in output_chains])


def derivative(system: ReducedSystem, expression: ca.SX, degree: int) -> tuple[ca.SX, ca.SX]:
    """Return the row of Phi and the drift of the derivative of order `degree` of an output: Phi u + drift."""
    if degree == 1:
        slope = ca.jacobian(expression, system.nu)
        return system.simplified("a row of Phi", slope, (slope,), lambda slope: slope), system.along_motion(
            expression
        )
    J, S = ca.jacobian(expression, system.moving), system.directions
    row = system.simplified("a row of Phi", J @ S, (J, S), lambda J, S: J @ S)
    return row, system.along_motion(row) @ system.nu + system.along_motion(carried_rate(system, expression))


def carried_rate(system: ReducedSystem, expression: ca.SX) -> ca.SX:
    """Return the part of the rate of an output h(q) that moving surfaces cause, whatever nu is: dh/dq s."""
    return canonical(ca.jacobian(expression, system.mechanism.q) @ system.carried)


def _vanishes(system: ReducedSystem, output: OutputMap, row: ca.SX) -> bool:
    """Return whether this row is zero at random states and parameters."""
    return row.is_zero() or _sampled(system, output, row).largest() < 1e-12


def _sampled(system: ReducedSystem, output: OutputMap, matrix: ca.SX) -> Sampled:
    where = f"{system.mechanism.name}, output {output.name}"
    return Sampled(
        matrix,
        ca.vertcat(system.moving, system.nu),
        (*system.mechanism.parameters, *output.parameters),
        where,
    )


def _not_square(system: ReducedSystem, output: OutputMap) -> str:
    """Return the reason why Phi is not square, and how to make it so."""
    mechanism, partial = system.mechanism, system.underactuated
    given = mechanism.inputs if partial else system.quasi_velocities
    count, needed = len(output.rows), len(given)
    rows, motions = ", ".join(row.name for row in output.rows), ", ".join(q.name for q in given)
    more = f"add {needed - count}" if count < needed else f"drop {count - needed}"
    of = f"{counted(needed, 'input')}" if partial else f"n - m = {needed}"
    kind = "inputs" if partial else "quasi-velocities"
    return (
        f"{counted(count, 'output')} for {of}; {more}: {rows or 'none'} must be as many as the {kind} "
        f"{motions}"
    )


def _only_dynamic(output: OutputMap) -> str:
    """Return why partial feedback linearization has neither a dynamic extension nor kinematic laws."""
    if output.kinematic:
        return (
            "a kinematic law commands all n - m quasi-velocities; with fewer inputs drives cannot follow them"
        )
    return "with fewer inputs than n - m there is no dynamic extension; take it without"


def _check_regular(
    system: ReducedSystem, output: OutputMap, Phi: ca.SX, integrators: Integrators | None
) -> None:
    """Raise ModelError if Phi is singular everywhere; the message names the dependent outputs and the
    directions without effect, or the outputs that inertia does not couple to the inputs.
    """
    values = (integrators.sampled(Phi, output) if integrators else _sampled(system, output, Phi)).values
    if any(map(is_regular, values)):
        return
    where = f"{system.mechanism.name}, output {output.name}: Phi is singular everywhere"
    motions = integrators.inputs if integrators else [q.name for q in system.quasi_velocities]
    rows = [row.name for row in output.rows]
    way_out = (
        ""
        if integrators or system.underactuated
        else "; or allow a dynamic extension: [output] extension = true"
    )
    if max(map(rank, values)) == len(values[0]):
        best = max(1 / np.linalg.cond(value, 1) for value in values)
        raise ModelError(
            f"{where}: its reciprocal condition number is at most {best:.0e}, and values up to {SINGULAR:g} "
            "count as singular; choose units of outputs and quasi-velocities in which they are of similar "
            "size"
        )
    of_outputs = [value[: len(rows)] for value in values]
    if system.underactuated and max(map(rank, of_outputs)) == len(rows):
        apart = [rows[k] for k in next(dependent_sets(values)) if k < len(rows)]
        inputs = ", ".join(q.name for q in system.mechanism.inputs)
        raise ModelError(
            f"{where}: inertia does not couple {' and '.join(apart)} to {inputs}: no input changes the "
            "highest derivative; choose other outputs, such as velocities at the inputs"
        )
    for column, velocity in enumerate(motions if not system.underactuated else ()):
        if max(np.abs(value[:, column]).max() for value in values) < 1e-12:
            raise ModelError(
                f"{where}: no output depends on the input along {velocity}; replace one by {velocity} itself "
                f"or by an output whose rate depends on it, such as a point that {velocity} moves (ahead of "
                "a steered wheel, not on its axle)" + way_out
            )
    together = next(dependent_sets(of_outputs))
    shared = max(rank(value[together, :]) for value in of_outputs)
    felt = [
        q
        for j, q in enumerate(motions)
        if max(np.abs(value[together, j]).max() for value in of_outputs) > 1e-12
    ]
    raise ModelError(
        f"{where}: the outputs {', '.join(rows[i] for i in together)} depend on each other: they contain "
        f"only {shared} {'combination' if shared == 1 else 'combinations'} of {', '.join(felt)}; replace one "
        "of them by an output that contains another, such as a point elsewhere on the robot (ahead of a "
        f"steered wheel, off an axle){way_out}"
    )


def is_regular(Phi: np.ndarray) -> bool:
    """Return whether a numerical Phi is regular by the measure of `Linearization.measure`."""
    if len(Phi) <= 2:
        return abs(np.linalg.det(Phi)) > SINGULAR * np.prod(np.linalg.norm(Phi, axis=1))
    return rank(Phi) == len(Phi) and 1 > SINGULAR * np.linalg.cond(Phi, 1)
