"""The ground's forces at the contacts in the inputs and the velocities of a law, for the limiter in the C runtime."""

from functools import lru_cache

import casadi as ca

from ...model.algebra.exact import canonical
from ...model.algebra.linear import solve
from ...model.contacts import distribution, ground, masses, narrow, shift_by_forces, unit_slips
from ...model.law import symbols
from ...model.recursion import Recursion, Reduced
from ...model.reduction import ReducedSystem
from .stages import Result, Stages, by_monomials

LEAST_INPUTS = 2  # for which noslip_grip.inc is written


def can_grip(system: ReducedSystem) -> bool:
    """Return whether the laws of the robot can keep its wheels rolling; `why_not` returns the reason if not."""
    return not why_not(system)


def why_not(system: ReducedSystem) -> str:
    """Return why the laws of the robot cannot keep its wheels rolling; empty if they can."""
    if not system.mechanism.contacts:
        return "it defines no contacts: add them with contact(name, mass, along, across)"
    if len(system.mechanism.inputs) < LEAST_INPUTS:
        return f"it is there for robots of {LEAST_INPUTS} inputs or more"
    return ""


@lru_cache(maxsize=64)
def is_wide(system: ReducedSystem) -> bool:
    """Whether every axle, or all supports together, can carry the moment of side forces, so that a height of the centre of mass
    can be given."""
    return not narrow(system.mechanism)


@lru_cache(maxsize=16)
def plain_ground(system: ReducedSystem) -> dict[Result, ca.SX]:
    """Return the quantities of `staged_ground` as the model has them."""
    if not can_grip(system):
        return {}
    tau = symbols(system.mechanism.inputs)
    reaction = ground(system, system.acceleration(tau), tau)
    first = [ca.vertcat(reaction.force[2 * k : 2 * k + 2], reaction.shift[k]) for k in range(reaction.mass.numel())]
    each = [ca.vertcat(part, reaction.mass[k]) for k, part in enumerate(first)]
    by_inputs = ca.jacobian(ca.vertcat(*first), tau)
    return {Result.GROUND: ca.vertcat(*each), Result.GROUND_BY_INPUTS: by_inputs} | _null_inputs(system)


def _null_inputs(system: ReducedSystem) -> dict[Result, ca.SX]:
    """Return NULL_INPUTS, whose rows span the inputs that do not change the motion: 1 - (S'E)^+ S'E, transposed."""
    if not system.redundant:
        return {}
    unit = ca.SX.eye(len(system.mechanism.inputs))
    return {Result.NULL_INPUTS: (unit - system.input_inverse() @ system.input_map).T}


@lru_cache(maxsize=16)
def staged_ground(inner: ReducedSystem) -> Stages:
    """Return, in steps that all laws of the robot share, GROUND, four numbers for each contact (force along and across, shift of
    the load, mass), and GROUND_BY_INPUTS, the first three by each input; NULL_INPUTS if there are more inputs than n-m. Supports
    are contacts too, the last ones. No quantities unless `can_grip`.

    `inner` is the system in the inner velocities of these laws (`inner_velocities`), whose symbols the steps contain.
    """
    mechanism = inner.mechanism
    stages = Stages([q.symbol for q in mechanism.parameters])
    if not can_grip(inner):
        return stages
    mass, shift = stages.exact(masses(mechanism)), shift_by_forces(mechanism)
    force, by, moved_by = (_body_by_body if mechanism.bodies else _written_out)(stages, inner, shift)
    contacts = range(mass.numel())
    names = [f"force_{way}_{k}" for k in contacts for way in ("along", "across")]
    force = ca.vertcat(*[stages.step(name, force[k]) for k, name in enumerate(names)])
    moved = stages.exact(shift) @ force
    stages.quantities = {
        Result.GROUND: ca.vertcat(*[ca.vertcat(force[2 * k : 2 * k + 2], moved[k], mass[k]) for k in contacts]),
        Result.GROUND_BY_INPUTS: ca.vertcat(*[ca.vertcat(by[2 * k : 2 * k + 2, :], moved_by[k, :]) for k in contacts]),
    }
    if inner.redundant:
        spread = stages.exact(inner.spread())
        square = stages.inverse(stages.matrix("square", stages.exact(inner.input_map @ spread)))
        unit = ca.SX.eye(len(mechanism.inputs))
        stages.quantities[Result.NULL_INPUTS] = (unit - spread @ (square @ stages.exact(inner.input_map))).T
    return stages


def _written_out(stages: Stages, inner: ReducedSystem, shift: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return the forces, 2 c x 1, and the derivatives of forces and shift by the inputs, each as one expression."""
    tau, u = symbols(inner.mechanism.inputs), ca.SX.sym("u", inner.dof)
    reaction, acceleration = ground(inner, u, tau), inner.acceleration(tau)
    without, at_rest = ca.substitute([reaction.force, acceleration], [tau], [ca.SX.zeros(tau.numel())])
    by_inputs = canonical(ca.jacobian(reaction.force, u) @ ca.jacobian(acceleration, tau) + ca.jacobian(reaction.force, tau))
    rest, scaled = by_monomials(stages, ca.substitute(without, u, at_rest), inner.nu), _scaled_efforts(stages, inner)
    by_efforts = stages.exact(by_inputs @ solve(scaled, ca.SX.eye(tau.numel())))
    efforts = ca.vertcat(*[stages.step(f"effort_{k}", effort) for k, effort in enumerate(ca.vertsplit(scaled @ tau))])
    return rest + by_efforts @ efforts, stages.exact(by_efforts @ scaled), stages.exact(shift @ by_inputs)


def _scaled_efforts(stages: Stages, inner: ReducedSystem) -> ca.SX:
    """Return the derivative of the efforts S'E tau by the inputs, each row divided by its first factor: forces are written by
    these efforts. Of two wheels they are the sum and the difference of the torques, whose effects on the forces are simple.
    Returns the identity if init cannot compute them, or inputs do not follow from efforts."""
    efforts = inner.input_map
    if inner.redundant or not all(map(stages.is_fixed, ca.symvar(efforts))):
        return ca.SX.eye(efforts.shape[1])
    first = [next(entry for entry in ca.horzsplit(row) if not entry.is_zero()) for row in ca.vertsplit(efforts)]
    return canonical(ca.diag(1 / ca.vertcat(*first)) @ efforts)


def _body_by_body(stages: Stages, inner: ReducedSystem, shift: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return the forces, 2 c x 1, and the derivatives of forces and shift by the inputs, in the steps of `Recursion`.

    The equations of motion of the robot that may slip have m more rows, those of A qdot; at rest there they are
    -lambda = K nudot + k - L tau.
    """
    tau, free = symbols(inner.mechanism.inputs), range(inner.dof)
    equations, slip = _with_slip(inner)
    held = range(inner.dof, inner.dof + slip.numel())
    parts = [equations.Mbar, equations.bias, equations.input_map]
    Mbar, bias, input_map = _in_steps(stages, equations, parts, slip)
    inverse = stages.inverse(Mbar[free, free])
    D = stages.exact(distribution(inner.mechanism))

    def forces(effort: ca.SX, bias: ca.SX, direct: ca.SX, name: str) -> ca.SX:
        nudot = stages.matrix(f"{name}_nudot", inverse @ effort)
        return D @ stages.matrix(f"{name}_reaction", Mbar[held, free] @ nudot + bias - direct)

    none = ca.SX(len(held), tau.numel())
    force = forces(input_map[free, :] @ tau - bias[free], bias[held], input_map[held, :] @ tau, "rolling")
    by = forces(input_map[free, :], none, input_map[held, :], "by_inputs")
    return force, by, stages.exact(shift) @ by


def _with_slip(inner: ReducedSystem) -> tuple[Reduced, ca.SX]:
    """Return the equations of motion in the quasi-velocities and in the velocities A qdot that the constraints keep zero, and the
    symbols of these."""
    mechanism = inner.mechanism
    slip = ca.SX.sym("slip", mechanism.A.shape[0])
    velocities, rows = ca.vertcat(inner.nu, slip), mechanism.quasi_velocity_rows
    if rows is None:
        T = ca.horzcat(inner.S, unit_slips(mechanism))
    else:
        T = ca.horzcat(canonical(rows @ inner.S), ca.SX(rows.shape[0], slip.numel()))
    return Recursion(mechanism, velocities, T, mechanism.quasi_expressions, slips=True).reduced(), slip


def _in_steps(stages: Stages, equations: Reduced, parts: list[ca.SX], slip: ca.SX) -> list[ca.SX]:
    """Return the parts without slip, after adding the steps that they need."""
    names = [symbol for symbol, _ in equations.steps]
    with_slip = [*(expression for _, expression in equations.steps), *parts]
    *expressions, Mbar, bias, input_map = ca.substitute(with_slip, [slip], [ca.SX.zeros(slip.numel())])
    place, stack = {symbol.element_hash(): k for k, symbol in enumerate(names)}, [Mbar, bias, input_map]
    needed: set[int] = set()
    while stack:
        new = {place[symbol.element_hash()] for symbol in ca.symvar(stack.pop()) if symbol.element_hash() in place} - needed
        needed |= new
        stack += [expressions[k] for k in new]
    values: dict[int, ca.SX] = {}
    for k in sorted(needed):
        values[names[k].element_hash()] = stages.step(str(names[k]), equations.inserted(expressions[k], values))
    return [equations.inserted(part, values) for part in (Mbar, bias, input_map)]
