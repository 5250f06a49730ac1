"""Contacts with the ground: how the velocities of the contact points follow from the constraints."""

import casadi as ca
import numpy as np

from .algebra.exact import canonical
from .algebra.linear import solve
from .algebra.samples import RANK_TOLERANCE, Sampled, rank
from .errors import ModelError
from .mechanism import Mechanism


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
    C = canonical(solve(canonical(A @ A.T), A @ rows.T).T)
    moving = _sampled(mechanism, rows - C @ A)
    if moving.largest() > RANK_TOLERANCE:
        k = moving.largest_row()
        name, way = mechanism.contacts[k // 2].name, ("along", "across")[k % 2]
        raise ModelError(f"{mechanism.name}: contact {name!r} can move {way} while the constraints hold; correct its velocity")
    values = _sampled(mechanism, C).values
    largest = np.abs(values).max(axis=(0, 1))
    kept = [repr(name) for name, size in zip(mechanism.constraint_names, largest, strict=True) if size > RANK_TOLERANCE]
    if max(map(rank, values)) < len(kept):
        raise ModelError(
            f"{mechanism.name}: the contacts do not determine how the forces of {', '.join(kept)} are distributed; "
            "add contacts, or write their velocities in the same form as those constraints"
        )
    return C


def axles(mechanism: Mechanism) -> list[list[int]]:
    """Return the contacts on each axle, as indices: those with the same velocity across."""
    across = mechanism.contact_rows[1::2, :]
    found: list[list[int]] = []
    for k in range(len(mechanism.contacts)):
        if across[k, :].is_zero():
            continue
        same = [axle for axle in found if canonical(across[k, :] - across[axle[0], :]).is_zero()]
        if same:
            same[0].append(k)
        else:
            found.append([k])
    return found


def _sampled(mechanism: Mechanism, matrix: ca.SX) -> Sampled:
    return Sampled(matrix, mechanism.q, mechanism.parameters, f"{mechanism.name}: contacts")
