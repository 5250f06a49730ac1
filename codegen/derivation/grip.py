"""The ground's forces at the contacts in the inputs and the velocities of a law, for the limiter in the C runtime."""

from functools import lru_cache

import casadi as ca

from ...model.algebra.exact import canonical
from ...model.contacts import ground, narrow, shift_of_sides
from ...model.law import symbols
from ...model.reduction import ReducedSystem
from .stages import Result, Stages, by_monomials

INPUTS = 2  # and quasi-velocities, for which noslip_grip.inc is written
MOST_COORDINATES = 6  # above, the forces have thousands of terms


def can_grip(system: ReducedSystem) -> bool:
    """Return whether the laws of the robot can keep its wheels rolling; `why_not` returns the reason if not."""
    return not why_not(system)


def why_not(system: ReducedSystem) -> str:
    """Return why the laws of the robot cannot keep its wheels rolling; empty if they can."""
    mechanism = system.mechanism
    inputs, n = len(mechanism.inputs), len(mechanism.coordinates)
    if not mechanism.contacts:
        return "it defines no contacts: add them with contact(name, mass, along, across)"
    if system.dof != INPUTS or inputs != INPUTS:
        return f"it is there for robots of two inputs and n - m = 2; this one has {inputs} inputs and n - m = {system.dof}"
    if n > MOST_COORDINATES:
        return f"it is there for robots of up to {MOST_COORDINATES} coordinates; this one has {n}"
    return ""


def is_wide(system: ReducedSystem) -> bool:
    """Whether every axle can carry the moment of its side force, so that a height of the centre of mass can be given."""
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
    return {Result.GROUND: ca.vertcat(*each), Result.GROUND_BY_INPUTS: ca.jacobian(ca.vertcat(*first), tau)}


@lru_cache(maxsize=16)
def staged_ground(inner: ReducedSystem) -> Stages:
    """Return, in steps that all laws of the robot share, GROUND, four numbers for each contact (force along and across, shift of
    the load, mass), and GROUND_BY_INPUTS, the first three by each input. No quantities unless `can_grip`.

    `inner` is the system in the inner velocities of these laws (`inner_velocities`), whose symbols the steps contain.
    """
    mechanism = inner.mechanism
    stages = Stages([q.symbol for q in mechanism.parameters])
    if not can_grip(inner):
        return stages
    tau, u = symbols(mechanism.inputs), ca.SX.sym("u", inner.dof)
    reaction, acceleration = ground(inner, u, tau), inner.acceleration(tau)
    none = ca.SX.zeros(tau.numel())
    without, at_rest = ca.substitute([reaction.force, acceleration], [tau], [none])
    by_inputs = canonical(ca.jacobian(reaction.force, u) @ ca.jacobian(acceleration, tau) + ca.jacobian(reaction.force, tau))
    shift, mass = shift_of_sides(mechanism), stages.exact(reaction.mass)
    moved_by = stages.exact(shift @ by_inputs[1::2, :])
    by = stages.exact(by_inputs)
    force = by_monomials(stages, ca.substitute(without, u, at_rest), inner.nu) + by @ tau
    contacts = range(reaction.mass.numel())
    names = [f"force_{way}_{k}" for k in contacts for way in ("along", "across")]
    force = ca.vertcat(*[stages.step(name, force[k]) for k, name in enumerate(names)])
    moved = stages.exact(shift) @ force[1::2]
    stages.quantities = {
        Result.GROUND: ca.vertcat(*[ca.vertcat(force[2 * k : 2 * k + 2], moved[k], mass[k]) for k in contacts]),
        Result.GROUND_BY_INPUTS: ca.vertcat(*[ca.vertcat(by[2 * k : 2 * k + 2, :], moved_by[k, :]) for k in contacts]),
    }
    return stages
