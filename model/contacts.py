"""Contacts with the ground: how the velocities of the contact points follow from the constraints,
and the forces there."""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from .algebra.exact import canonical
from .algebra.linear import eliminate, solve
from .algebra.linear_numbers import least_squares
from .algebra.samples import RANK_TOLERANCE, Sampled, rank
from .errors import ModelError
from .mechanism import Mechanism
from .reduction import ReducedSystem

GRAVITY = 9.81  # m/s^2


@dataclass(frozen=True, eq=False)
class Ground:
    """What the ground does at the c contacts of a robot, supports included.

    `force`, 2 c x 1 (N): on the robot, along and across at each contact in turn. `mass`, c x 1 (kg): what
    rests on the contact. `shift`, c x 1 (N/m): what the forces add to the load, for each metre of height of
    the centre of mass, see `shift_by_forces`. The load is gravity times `mass` plus height times `shift`. All
    are affine in the inputs, and so in the virtual input.
    """

    force: ca.SX
    mass: ca.SX
    shift: ca.SX


@dataclass(frozen=True, eq=False)
class Wheel:
    """A driven wheel by whose rate the ground's force F along its contact is known: mass rim' = drive - F.

    `contact`, `velocity`: numbers of the contact and of the quasi-velocity that is the wheel's rate; the
    rim's speed (m/s) is the rate times `radius` (m). `drive` (N): the force of the inputs at the rim; `mass`
    (kg): inertia over the squared radius.
    """

    contact: int
    velocity: int
    drive: ca.SX
    mass: ca.SX
    radius: ca.SX


def driven_wheels(mechanism: Mechanism, tau: ca.SX) -> list[Wheel]:
    """Return the wheels with inertia whose rates are quasi-velocities, and which nothing but their contacts
    and the inputs tau couples to the robot: their rows of (8) are I theta'' = E tau - r F.
    """
    rates, rows, found = mechanism.quasi_velocity_rows, mechanism.contact_rows, []
    for i, row in enumerate(() if rates is None else ca.vertsplit(rates)):
        j = row.sparsity().get_col()
        touched = [k for k in range(rows.shape[0]) if not rows[k, j].is_zero()]
        if len(j) != 1 or not (row[j[0]] - 1).is_zero() or len(touched) != 1 or touched[0] % 2:
            continue
        inertia, radius = canonical(mechanism.M[j, :]), -rows[touched[0], j]
        drive = mechanism.E[j, :] @ tau
        alone = inertia.nnz() == 1 and not inertia[j].is_zero() and canonical(mechanism.V[j]).is_zero()
        if (
            alone
            and not ca.depends_on(ca.vertcat(inertia[j], radius), ca.vertcat(mechanism.q, mechanism.qdot))
            and drive.nnz()
        ):
            found.append(Wheel(touched[0] // 2, i, drive / radius, inertia[j] / radius**2, radius))
    return found


def unknown_loads(mechanism: Mechanism) -> str:
    """Return why the loads of the contacts are not known from what rests on them; empty if they are."""
    if not mechanism.contacts:
        return "the robot defines no contacts"
    resting = ca.substitute(mechanism.energy(), mechanism.qdot, ca.SX.zeros(len(mechanism.coordinates)))
    moves = ca.which_depends(resting, mechanism.q, 1, False)
    units = [c.unit for c, does in zip(mechanism.coordinates, moves, strict=True) if does]
    if units and "m" not in units:  # on a slope the energy depends on the place too
        return (
            "it rises and falls as it leans, which changes the loads of its contacts; --engine mujoco has "
            "them"
        )
    return ""


def combination(mechanism: Mechanism) -> ca.SX:
    """Return C(q), 2 c x m, such that the velocities along and across at the c contacts are C A qdot; they
    vanish with the constraints. Supports are contacts without velocities, the last ones.

    The ground forces F (N, along and across at each contact in turn) have the power F' C A qdot, the
    constraint forces in (8) -lambda' A qdot. Hence C' F = -lambda in the rows of the constraints that
    contacts maintain, those where C has a column. Raises ModelError for a contact that can move while the
    constraints hold, and if the contacts cannot produce every lambda of those constraints.
    """
    A, rows = mechanism.A, _rows(mechanism)
    if not mechanism.contacts:
        return ca.SX(0, A.shape[0])
    C = _whole_numbers(A, rows, _sampled(mechanism, ca.vertcat(A, rows)).values)
    if C is None:
        C = canonical(rows @ unit_slips(mechanism))
    moving = _sampled(mechanism, rows - C @ A)
    if moving.largest() > RANK_TOLERANCE:
        k = moving.largest_row()
        name, way = mechanism.contacts[k // 2].name, ("along", "across")[k % 2]
        raise ModelError(
            f"{mechanism.name}: contact {name!r} can move {way} while the constraints hold; correct its "
            "velocity"
        )
    values = _sampled(mechanism, C).values
    sizes = np.abs(values).max(axis=0)
    # Where the simplification does not see a zero
    C = ca.sparsify(C * ca.DM((sizes > RANK_TOLERANCE).astype(float)))
    largest = sizes.max(axis=0)
    kept = [
        repr(name)
        for name, size in zip(mechanism.constraint_names, largest, strict=True)
        if size > RANK_TOLERANCE
    ]
    if max(map(rank, values)) < len(kept):
        raise ModelError(
            f"{mechanism.name}: the contacts do not determine how the forces of {', '.join(kept)} are "
            "distributed; add contacts, or write their velocities in the same form as those constraints"
        )
    return C


def _whole_numbers(A: ca.SX, rows: ca.SX, values: Sequence[np.ndarray]) -> ca.SX | None:
    """Return C with C A = rows if it consists of whole numbers and this is proved: the velocity of a contact
    is often that of a constraint, or minus it, and `unit_slips` is long for many bodies. None if not.
    `values` are samples of A above rows.
    """
    m = A.shape[0]
    table = np.hstack(values)
    C = np.round(np.linalg.lstsq(table[:m].T, table[m:].T)[0].T)
    if np.abs(C @ table[:m] - table[m:]).max(initial=0.0) > RANK_TOLERANCE * np.abs(table).max(initial=1.0):
        return None

    def proved(row: ca.SX, numbers: np.ndarray) -> bool:
        (places,) = np.nonzero(numbers)
        if (
            len(places) == 1
            and numbers[places[0]] == 1
            and row.serialize() == A[int(places[0]), :].serialize()
        ):
            return True
        return canonical(row - ca.SX(ca.DM(numbers[None])) @ A).is_zero()

    return ca.sparsify(ca.SX(ca.DM(C))) if all(map(proved, ca.vertsplit(rows), C)) else None


def ground(system: ReducedSystem, nudot: ca.SX, tau: ca.SX) -> Ground:
    """Return what the ground does while the robot rolls with the rates nudot of its quasi-velocities and the
    inputs tau.

    C' F = -lambda with lambda of (8). Contacts that share a force divide it in proportion to the masses that
    rest on them: F minimizes the sum of F^2 / mass. Raises ModelError as `combination` does.
    """
    mechanism = system.mechanism
    multiplied_out = not mechanism.bodies  # what several bodies do is too long then
    simple = canonical if multiplied_out else ca.sparsify
    qddot = system.convective + system.S @ nudot
    # -lambda
    needed = simple(
        unit_slips(mechanism, multiplied_out).T @ (mechanism.M @ qddot + system.V - mechanism.E @ tau)
    )
    force = ca.densify(simple(distribution(mechanism) @ needed))
    return Ground(force, masses(mechanism), simple(shift_by_forces(mechanism) @ force))


def masses(mechanism: Mechanism) -> ca.SX:
    """Return the mass that rests on each contact, c x 1 (kg), supports included."""
    return ca.vertcat(*[contact.mass for contact in mechanism.standing])


def distribution(mechanism: Mechanism) -> ca.SX:
    """Return D, 2 c x m: the forces at the contacts are D times -lambda. Raises ModelError as `combination`
    does."""
    C, mass = combination(mechanism), masses(mechanism)
    rows, kept = (
        [k for k, part in enumerate(split(C)) if part.nnz()] for split in (ca.vertsplit, ca.horzsplit)
    )
    block, D = C[rows, kept], ca.SX(*C.shape)
    if len(rows) == len(kept):
        D[rows, kept] = solve(canonical(block.T), ca.SX.eye(len(kept)))
    else:
        shares = ca.diag(ca.vec(ca.horzcat(mass, mass).T)[rows]) @ block
        D[rows, kept] = shares @ solve(canonical(block.T @ shares), ca.SX.eye(len(kept)))
    return canonical(D)


def shift_by_forces(mechanism: Mechanism) -> ca.SX:
    """Return K, c x 2 c (1/m): K times the forces is the `shift` of Ground.

    If the robot names the places of all that it stands on (`Mechanism.places_named`), the moments of all
    forces about the height of the centre of mass are balanced by changes of all loads: exact for three
    supports, for more the changes of smallest sum of squares over mass. Contacts that are all on the centre
    line stand for whole axles (`on_centre_line`): load moves forward and back, and each axle carries the
    moment of side forces in itself. Without places, an axle carries the moment of its side force about its
    own contacts, by the same rule; zero for an axle without width. The moment that the spin of wheels takes
    is neglected.
    """
    count = len(mechanism.standing)
    K = ca.SX(count, 2 * count)
    if mechanism.places_named:
        return _shift_of_all(mechanism)
    for axle in axles(mechanism):
        mass, left = (
            ca.vertcat(*[getattr(mechanism.contacts[k], name) for k in axle]) for name in ("mass", "left")
        )
        arm = left - ca.dot(mass, left) / ca.sum1(mass)
        width = canonical(ca.dot(mass, arm**2))
        if not width.is_zero():
            K[axle, [2 * k + 1 for k in axle]] = ca.repmat(-canonical(mass * arm / width), 1, len(axle))
    return K


def _shift_of_all(mechanism: Mechanism) -> ca.SX:
    """Return K of `shift_by_forces` for a robot all of whose supports are named; zero if they are on one line
    that is not its centre line."""
    mass, ahead, left = (
        ca.vertcat(*[getattr(each, name) for each in mechanism.standing])
        for name in ("mass", "ahead", "left")
    )
    arms = ca.horzcat(*[place - ca.dot(mass, place) / ca.sum1(mass) for place in (ahead, left)])
    weighted = ca.diag(mass) @ arms
    if on_centre_line(mechanism):
        weighted, arms = weighted[:, 0], arms[:, 0]
    squares = canonical(arms.T @ weighted)
    if canonical(ca.det(squares)).is_zero():
        return ca.SX(mass.numel(), 2 * mass.numel())
    # Of along and across, in the vehicle's axes
    directions = canonical(_rows(mechanism) @ _translations(mechanism))
    return canonical(-weighted @ solve(squares, directions[:, : arms.shape[1]].T))


def on_centre_line(mechanism: Mechanism) -> bool:
    """Return whether all that the robot stands on is named and on its centre line, as in the bicycle model:
    each contact stands for an axle whose width is not known.
    """
    return mechanism.places_named and all(each.left.is_zero() for each in mechanism.standing)


def _rows(mechanism: Mechanism) -> ca.SX:
    """Return the velocities along and across at each contact, as rows by qdot, 2 c x n; those of supports,
    which are last, are zero."""
    return ca.vertcat(mechanism.contact_rows, ca.SX(2 * len(mechanism.supports), len(mechanism.coordinates)))


def _translations(mechanism: Mechanism) -> ca.SX:
    """Return the rates of the coordinates, n x 2, with which the whole robot moves at 1 m/s, forward and to
    the left, in the directions in which contacts have their places."""
    return _moved_along(mechanism, _heading_of_places(mechanism))


def _heading_of_places(mechanism: Mechanism) -> ca.SX:
    """Return the heading of the frame in which contacts have their places `ahead` and `left`: that of the
    first body, or else of the vehicle.

    The vehicle may be a steered wheel, whose heading is a sum of coordinates. The frame then has the heading
    or one of these coordinates: the one with which contacts move as points at their places do. Raises
    ModelError if none of them fits, or several do.
    """
    heading = mechanism.required_vehicle.heading
    for body in mechanism.bodies[:1]:
        for q, rate in zip(mechanism.coordinates, mechanism.velocities, strict=True):
            if (body.yaw_rate - rate.symbol).is_zero():
                return q.symbol
    summed = [q.symbol for q in mechanism.coordinates if ca.depends_on(heading, q.symbol)]
    if len(summed) < 2:
        return heading
    fitting = [
        frame
        for frame in (heading, *summed)
        if any(_places_fit(mechanism, frame, turned) for turned in (summed if frame is heading else [frame]))
    ]
    if len(fitting) != 1:
        reason = "are not clear from" if fitting else "do not fit"
        raise ModelError(
            f"{mechanism.name}: the places of contacts (ahead, left) {reason} their velocities; give them "
            "from one point of the body, along its heading and to its left, or make the robot of bodies "
            "(`body`), the first of which has the contacts"
        )
    return fitting[0]


def _places_fit(mechanism: Mechanism, heading: ca.SX, turned: ca.SX) -> bool:
    """Return whether contacts move as points at their places in a frame with a heading do, up to a common
    velocity, while the coordinate `turned` has the rate 1."""
    rows = mechanism.contact_rows
    turning = rows @ ca.jacobian(mechanism.q, turned)
    directions = rows @ _moved_along(mechanism, heading)
    places = [ca.vertcat(-contact.left, contact.ahead) for contact in mechanism.contacts]
    of_places = ca.vertcat(*[directions[2 * k : 2 * k + 2, :] @ place for k, place in enumerate(places)])
    for value in _sampled(mechanism, ca.horzcat(directions, turning - of_places)).values:
        axes, velocity = value[:, :2], value[:, 2]
        common = least_squares(axes, velocity)
        if np.abs(axes @ common - velocity).max() > RANK_TOLERANCE * (1 + np.abs(velocity).max()):
            return False
    return True


def _moved_along(mechanism: Mechanism, heading: ca.SX) -> ca.SX:
    """Return the rates of the coordinates, n x 2, with which the whole robot moves at 1 m/s along a heading,
    and to its left."""
    vehicle, n = mechanism.required_vehicle, len(mechanism.coordinates)
    place = canonical(ca.jacobian(ca.vertcat(vehicle.x, vehicle.y), mechanism.q))
    of = [[k for k in range(n) if (place[:, k] - axis).is_zero()] for axis in (ca.SX([1, 0]), ca.SX([0, 1]))]
    if not all(of):
        raise ModelError(
            f"{mechanism.name}: supports require a vehicle whose x and y are coordinates, up to functions of "
            "others"
        )
    rates = ca.SX(n, 2)
    rates[[of[0][0], of[1][0]], :] = ca.vertcat(
        ca.horzcat(ca.cos(heading), -ca.sin(heading)),
        ca.horzcat(ca.sin(heading), ca.cos(heading)),
    )
    return rates


def narrow(mechanism: Mechanism) -> list[str]:
    """Return the contacts that cannot carry the moment of side forces: their axle has no width, or all
    supports are on one line that is not the centre line."""
    K = shift_by_forces(mechanism)
    if mechanism.places_named:
        return [contact.name for contact in mechanism.standing] if K.is_zero() else []
    return [mechanism.contacts[k].name for axle in axles(mechanism) for k in axle if K[k, :].is_zero()]


def unit_slips(mechanism: Mechanism, simple: bool = True) -> ca.SX:
    """Return n x m velocities T with A T = 1: slip in one constraint each, if possible without
    quasi-velocities; `simple`: in canonical form."""
    A, rows = mechanism.A, mechanism.quasi_velocity_rows
    m, n = A.shape
    if rows is None or rows.shape[0] != n - m:
        return canonical(A.T @ solve(canonical(A @ A.T), ca.SX.eye(m)))
    right = ca.vertcat(ca.SX.eye(m), ca.SX(n - m, m))
    if not simple:
        return solve(ca.vertcat(A, rows), right)
    return eliminate(ca.vertcat(A, rows), right, mechanism.q, mechanism.name)


def axles(mechanism: Mechanism) -> list[list[int]]:
    """Return the contacts on each axle, as indices: those with the same velocity across."""
    across = mechanism.contact_rows[1::2, :]
    values = np.array(_sampled(mechanism, across).values)
    groups: list[list[int]] = []

    def equal(j: int, k: int) -> bool:
        """Whether two rows are equal: first at samples, since the proof takes long for many bodies."""
        near = np.abs(values[:, j] - values[:, k]).max() <= RANK_TOLERANCE * (1 + np.abs(values[:, j]).max())
        return bool(near) and canonical(across[k, :] - across[j, :]).is_zero()

    for k in range(len(mechanism.contacts)):
        if across[k, :].is_zero():
            continue
        same = [axle for axle in groups if equal(axle[0], k)]
        if same:
            same[0].append(k)
        else:
            groups.append([k])
    return groups


def _sampled(mechanism: Mechanism, matrix: ca.SX) -> Sampled:
    return Sampled(matrix, mechanism.q, mechanism.parameters, f"{mechanism.name}: contacts")
