"""Contacts with the ground: how the velocities of the contact points follow from the constraints, and the forces there."""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from .algebra.exact import canonical
from .algebra.linear import eliminate, solve
from .algebra.samples import RANK_TOLERANCE, Sampled, rank
from .errors import ModelError
from .mechanism import Mechanism
from .reduction import ReducedSystem

GRAVITY = 9.81  # m/s^2


@dataclass(frozen=True, eq=False)
class Ground:
    """What the ground does at the c contacts of a robot.

    `force`, 2 c x 1 (N): on the robot, along and across at each contact in turn. `mass`, c x 1 (kg): what rests on the contact.
    `shift`, c x 1 (N/m): what the side forces of its axle add to the load, for each metre of height of the centre of mass. The
    load is gravity times `mass` plus height times `shift`. All are affine in the inputs, and so in the virtual input.
    """

    force: ca.SX
    mass: ca.SX
    shift: ca.SX


def combination(mechanism: Mechanism) -> ca.SX:
    """Return C(q), 2 c x m, such that the velocities along and across at the c contacts are C A qdot; they vanish with the
    constraints.

    The ground forces F (N, along and across at each contact in turn) have the power F' C A qdot, the constraint forces in (8)
    -lambda' A qdot. Hence C' F = -lambda in the rows of the constraints that contacts maintain, those where C has a column.
    Raises ModelError for a contact that can move while the constraints hold, and if the contacts cannot produce every
    lambda of those constraints.
    """
    A, rows = mechanism.A, mechanism.contact_rows
    if not mechanism.contacts:
        return ca.SX(0, A.shape[0])
    C = canonical(rows @ _unit_slips(mechanism))
    moving = _sampled(mechanism, rows - C @ A)
    if moving.largest() > RANK_TOLERANCE:
        k = moving.largest_row()
        name, way = mechanism.contacts[k // 2].name, ("along", "across")[k % 2]
        raise ModelError(f"{mechanism.name}: contact {name!r} can move {way} while the constraints hold; correct its velocity")
    values = _sampled(mechanism, C).values
    sizes = np.abs(values).max(axis=0)
    C = ca.sparsify(C * ca.DM((sizes > RANK_TOLERANCE).astype(float)))  # where the simplification does not see a zero
    largest = sizes.max(axis=0)
    kept = [repr(name) for name, size in zip(mechanism.constraint_names, largest, strict=True) if size > RANK_TOLERANCE]
    if max(map(rank, values)) < len(kept):
        raise ModelError(
            f"{mechanism.name}: the contacts do not determine how the forces of {', '.join(kept)} are distributed; "
            "add contacts, or write their velocities in the same form as those constraints"
        )
    return C


def ground(system: ReducedSystem, nudot: ca.SX, tau: ca.SX) -> Ground:
    """Return what the ground does while the robot rolls with the rates nudot of its quasi-velocities and the inputs tau.

    C' F = -lambda with lambda of (8). Contacts that share a force divide it in proportion to the masses that rest on them:
    F minimizes the sum of F^2 / mass. Raises ModelError as `combination` does.
    """
    mechanism, C = system.mechanism, combination(system.mechanism)
    qddot = system.convective + system.S @ nudot
    needed = canonical(_unit_slips(mechanism).T @ (mechanism.M @ qddot + system.V - mechanism.E @ tau))  # -lambda
    rows, kept = ([k for k, part in enumerate(split(C)) if part.nnz()] for split in (ca.vertsplit, ca.horzsplit))
    block, needed = C[rows, kept], needed[kept]
    mass = ca.vertcat(*[contact.mass for contact in mechanism.contacts])
    force = ca.SX(C.shape[0], 1)
    if len(rows) == len(kept):
        force[rows] = solve(canonical(block.T), needed)
    else:
        shares = ca.diag(ca.vec(ca.horzcat(mass, mass).T)[rows]) @ block
        force[rows] = shares @ solve(canonical(block.T @ shares), needed)
    force = ca.densify(canonical(force))
    return Ground(force, mass, canonical(shift_of_sides(mechanism) @ force[1::2]))


def shift_of_sides(mechanism: Mechanism) -> ca.SX:
    """Return K, c x c (1/m): K times the forces across is the `shift` of Ground; zero for an axle without width.

    An axle carries the moment of its side force about its own contacts, in proportion to their masses.
    """
    K = ca.SX(len(mechanism.contacts), len(mechanism.contacts))
    for axle in axles(mechanism):
        mass, left = (ca.vertcat(*[getattr(mechanism.contacts[k], name) for k in axle]) for name in ("mass", "left"))
        arm = left - ca.dot(mass, left) / ca.sum1(mass)
        width = canonical(ca.dot(mass, arm**2))
        if not width.is_zero():
            K[axle, axle] = ca.repmat(-canonical(mass * arm / width), 1, len(axle))
    return K


def narrow(mechanism: Mechanism) -> list[str]:
    """Return the contacts whose axle has no width to carry the moment of its side force."""
    K = shift_of_sides(mechanism)
    return [mechanism.contacts[k].name for axle in axles(mechanism) for k in axle if K[k, :].is_zero()]


def _unit_slips(mechanism: Mechanism) -> ca.SX:
    """Return n x m velocities T with A T = 1: slip in one constraint each, if possible without quasi-velocities."""
    A, rows = mechanism.A, mechanism.quasi_velocity_rows
    m, n = A.shape
    if rows is None or rows.shape[0] != n - m:
        return canonical(A.T @ solve(canonical(A @ A.T), ca.SX.eye(m)))
    right = ca.vertcat(ca.SX.eye(m), ca.SX(n - m, m))
    return eliminate(ca.vertcat(A, rows), right, mechanism.q, mechanism.name)


def axles(mechanism: Mechanism) -> list[list[int]]:
    """Return the contacts on each axle, as indices: those with the same velocity across."""
    across = mechanism.contact_rows[1::2, :]
    groups: list[list[int]] = []
    for k in range(len(mechanism.contacts)):
        if across[k, :].is_zero():
            continue
        same = [axle for axle in groups if canonical(across[k, :] - across[axle[0], :]).is_zero()]
        if same:
            same[0].append(k)
        else:
            groups.append([k])
    return groups


def _sampled(mechanism: Mechanism, matrix: ca.SX) -> Sampled:
    return Sampled(matrix, mechanism.q, mechanism.parameters, f"{mechanism.name}: contacts")
