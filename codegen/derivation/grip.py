"""The ground's forces at the contacts in the inputs and the velocities of a law,
for the limiter in the C runtime."""

from functools import lru_cache

import casadi as ca

from ...model.algebra.exact import canonical
from ...model.algebra.linear import solve
from ...model.contacts import Wheel, distribution, driven_wheels, ground, masses, narrow, shift_by_forces
from ...model.law import symbols
from ...model.reduction import ReducedSystem
from .stages import Result, Stages, by_monomials
from .transmission import Transmission

LEAST_INPUTS = 2  # for which noslip_grip.inc is written


def can_grip(system: ReducedSystem) -> bool:
    """Return whether the laws of the robot can keep its wheels rolling;
    `why_not` returns the reason if not."""
    return not why_not(system)


def why_not(system: ReducedSystem) -> str:
    """Return why the laws of the robot cannot keep its wheels rolling; empty if they can."""
    if system.underactuated:
        return (
            "it has fewer inputs than degrees of freedom: what no input drives moves on while inputs are "
            "limited"
        )
    if not system.mechanism.contacts:
        return "it defines no contacts: add them with contact(name, mass, along, across)"
    if len(system.mechanism.inputs) < LEAST_INPUTS:
        return f"it is there for robots of {LEAST_INPUTS} inputs or more"
    return ""


@lru_cache(maxsize=64)
def is_wide(system: ReducedSystem) -> bool:
    """Whether every axle, or all supports together, can carry the moment of side forces, so that a height of
    the centre of mass can be given."""
    return not narrow(system.mechanism)


@lru_cache(maxsize=64)
def wheels_of(system: ReducedSystem) -> list[Wheel]:
    """Return the wheels by which the laws of the robot earn friction; none unless `can_grip`."""
    return driven_wheels(system.mechanism, symbols(system.mechanism.inputs)) if can_grip(system) else []


def wheels_by_contact(system: ReducedSystem) -> dict[int, Wheel | None]:
    """Return the wheel of each contact from the first that has one of `wheels_of` to the last,
    None for one without."""
    wheels = {wheel.contact: wheel for wheel in wheels_of(system)}
    return {k: wheels.get(k) for k in range(min(wheels), max(wheels) + 1)} if wheels else {}


def _wheels(system: ReducedSystem) -> dict[Result, ca.SX]:
    """Return WHEELS, three numbers for each of `wheels_by_contact`: force of the inputs at the rim,
    mass, radius; 0 for None."""
    wheels = wheels_by_contact(system).values()
    rows = [
        ca.vertcat(wheel.drive, wheel.mass, wheel.radius) if wheel else ca.SX.zeros(3) for wheel in wheels
    ]
    return {Result.WHEELS: ca.vertcat(*rows)} if rows else {}


@lru_cache(maxsize=16)
def plain_ground(system: ReducedSystem) -> dict[Result, ca.SX]:
    """Return the quantities of `staged_ground` as the model has them."""
    if not can_grip(system):
        return {}
    tau = symbols(system.mechanism.inputs)
    reaction = ground(system, system.acceleration(tau), tau)
    first = [
        ca.vertcat(reaction.force[2 * k : 2 * k + 2], reaction.shift[k]) for k in range(reaction.mass.numel())
    ]
    each = [ca.vertcat(part, reaction.mass[k]) for k, part in enumerate(first)]
    by_inputs = ca.jacobian(ca.vertcat(*first), tau)
    return (
        {Result.GROUND: ca.vertcat(*each), Result.GROUND_BY_INPUTS: by_inputs}
        | _wheels(system)
        | _null_inputs(system)
    )


def _null_inputs(system: ReducedSystem) -> dict[Result, ca.SX]:
    """Return NULL_INPUTS, whose rows span the inputs that do not change the motion:
    1 - (S'E)^+ S'E, transposed."""
    if not system.redundant:
        return {}
    unit = ca.SX.eye(len(system.mechanism.inputs))
    return {Result.NULL_INPUTS: (unit - system.input_inverse() @ system.input_map).T}


@lru_cache(maxsize=16)
def staged_ground(inner: ReducedSystem) -> Stages:
    """Return, in steps that all laws of the robot share, GROUND, four numbers for each contact (force along
    and across, shift of the load, mass), and GROUND_BY_INPUTS, the first three by each input; WHEELS;
    NULL_INPUTS if there are more inputs than n-m. Supports are contacts too, the last ones. No quantities
    unless `can_grip`.

    `inner` is the system in the inner velocities of these laws (`inner_velocities`), whose symbols the steps
    contain.
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
        Result.GROUND: ca.vertcat(
            *[ca.vertcat(force[2 * k : 2 * k + 2], moved[k], mass[k]) for k in contacts]
        ),
        Result.GROUND_BY_INPUTS: ca.vertcat(
            *[ca.vertcat(by[2 * k : 2 * k + 2, :], moved_by[k, :]) for k in contacts]
        ),
    }
    stages.quantities |= {name: stages.exact(rows) for name, rows in _wheels(inner).items()}
    if inner.redundant:
        spread = stages.exact(inner.spread())
        square = stages.inverse(stages.matrix("square", stages.exact(inner.input_map @ spread)))
        unit = ca.SX.eye(len(mechanism.inputs))
        stages.quantities[Result.NULL_INPUTS] = (unit - spread @ (square @ stages.exact(inner.input_map))).T
    return stages


def _written_out(stages: Stages, inner: ReducedSystem, shift: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return the forces, 2 c x 1, and the derivatives of forces and shift by the inputs,
    each as one expression."""
    tau, u = symbols(inner.mechanism.inputs), ca.SX.sym("u", inner.dof)
    reaction, acceleration = ground(inner, u, tau), inner.acceleration(tau)
    without, at_rest = ca.substitute([reaction.force, acceleration], [tau], [ca.SX.zeros(tau.numel())])
    by_inputs = canonical(
        ca.jacobian(reaction.force, u) @ ca.jacobian(acceleration, tau) + ca.jacobian(reaction.force, tau)
    )
    rest, scaled = (
        by_monomials(stages, ca.substitute(without, u, at_rest), inner.nu),
        _scaled_efforts(stages, inner),
    )
    by_efforts = stages.exact(by_inputs @ solve(scaled, ca.SX.eye(tau.numel())))
    efforts = ca.vertcat(
        *[stages.step(f"effort_{k}", effort) for k, effort in enumerate(ca.vertsplit(scaled @ tau))]
    )
    return rest + by_efforts @ efforts, stages.exact(by_efforts @ scaled), stages.exact(shift @ by_inputs)


def _scaled_efforts(stages: Stages, inner: ReducedSystem) -> ca.SX:
    """Return the derivative of the efforts S'E tau by the inputs, each row divided by its first factor:
    forces are written by these efforts. Of two wheels they are the sum and the difference of the torques,
    whose effects on the forces are simple. Returns the identity if init cannot compute them, or inputs do not
    follow from efforts."""
    efforts = inner.input_map
    if inner.redundant or not all(map(stages.is_fixed, ca.symvar(efforts))):
        return ca.SX.eye(efforts.shape[1])
    first = [
        next(entry for entry in ca.horzsplit(row) if not entry.is_zero()) for row in ca.vertsplit(efforts)
    ]
    return canonical(ca.diag(1 / ca.vertcat(*first)) @ efforts)


def _body_by_body(stages: Stages, inner: ReducedSystem, shift: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return the forces, 2 c x 1, and the derivatives of forces and shift by the inputs,
    carried from body to body."""
    mechanism, equations, transmission = inner.mechanism, inner.by_bodies, Transmission(inner.mechanism)
    assert equations is not None, "the robot has bodies"
    tau, dof = symbols(mechanism.inputs), range(inner.dof)
    rows = [ca.horzcat(*[each.row.get(j, ca.SX(0)) for j in dof]) for each in equations.efforts]
    efforts = ca.horzcat(ca.vertcat(*rows), ca.vertcat(*[each.bias for each in equations.efforts]))
    Mbar, bias, input_map, efforts = stages.recursion(
        equations, [equations.Mbar, equations.bias, equations.input_map, efforts]
    )
    inverse, D = stages.inverse(Mbar), stages.exact(distribution(mechanism))

    def forces(supplied: ca.SX, inputs: ca.SX, moving: bool, name: str) -> ca.SX:
        """Return the forces where S'E tau - bias are `supplied`;
        without the biases of a robot that is not `moving`."""
        nudot = stages.matrix(f"{name}_nudot", inverse @ supplied)
        needed = efforts @ ca.vertcat(nudot, moving)
        along = [
            (each.velocity, stages.step(f"{name}_{each.name}", needed[k]))
            for k, each in enumerate(equations.efforts)
        ]
        along += [(velocity, -inputs[k]) for k, velocity in enumerate(mechanism.actuation)]
        reactions = transmission.reactions(
            along, lambda velocity, effort: stages.step(f"{name}_{velocity}", effort, total=True)
        )
        return D @ stages.matrix(f"{name}_reaction", reactions)

    force = forces(input_map @ tau - bias, tau, True, "rolling")
    unit = ca.SX.eye(tau.numel())
    by = ca.horzcat(
        *[forces(input_map[:, k], unit[:, k], False, f"by_input_{k}") for k in range(tau.numel())]
    )
    return force, by, stages.exact(shift) @ by
