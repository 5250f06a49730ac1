"""Where a robot touches the ground: how the velocities of its contacts follow from its constraints."""

import casadi as ca
import numpy as np

from .algebra.exact import canonical
from .algebra.linear import solve
from .algebra.samples import RANK_TOLERANCE, Sampled, rank
from .errors import ModelError
from .mechanism import Mechanism


def combination(mechanism: Mechanism) -> ca.SX:
    """C(q), 2 c x m, with the velocities along and across of the c contacts = C A qdot: they vanish with the constraints.

    The ground's forces F (N, along and across of each contact in turn) do the power F' C A qdot, the constraints' in (8)
    do -lambda' A qdot; so C' F = -lambda in the rows of the constraints that contacts keep, those where C has a column.
    Raises ModelError for a contact that may move while the constraints hold, and when the contacts cannot give every
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
        raise ModelError(f"{mechanism.name}: contact {name!r} can move {way} while the constraints hold: correct its velocity")
    values = _sampled(mechanism, C).values
    largest = np.abs(values).max(axis=(0, 1))
    kept = [repr(name) for name, size in zip(mechanism.constraint_names, largest, strict=True) if size > RANK_TOLERANCE]
    if max(map(rank, values)) < len(kept):
        raise ModelError(
            f"{mechanism.name}: the contacts do not tell how the forces of {', '.join(kept)} are shared out: "
            "add contacts, or write their velocities as those constraints are written"
        )
    return C


def axles(mechanism: Mechanism) -> list[list[int]]:
    """Contacts, by their places in the list, that stand on one axle: those with the same velocity across."""
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
