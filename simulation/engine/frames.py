"""The planar bodies and wheels of a Mechanism, and what leans on them, found from its contacts' velocities
and its mass matrix.

A contact or a body of a Mechanism gives the velocity of a point as rows in the rates of the coordinates.
Points with the same yaw rate belong to one frame. A frame is hinged about a vertical to the ground or to
another frame; the hinge and the places of its points are those that reproduce the rows at random states.
Masses, first moments and inertias are those that reproduce M(q).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache, partial
from itertools import islice

import casadi as ca
import numpy as np

from ...model.algebra.portable import portable
from ...model.mechanism import Mechanism
from ...readers.errors import BadInput
from .leaning import LeaningBody, leaning_angles, parts_of_mass, product

STATES = 12  # random ones at which rows and mass matrix are compared
EXACT = 1e-9  # relative difference that rounding explains
# Relative difference that is accepted, and said, where bodies on hinges of their own turn together
APART = 0.02


@dataclass(eq=False)
class Frame:
    """A rigid body in the plane. Its heading is `heading` . q; its origin is the hinge, at `pivot` (m) in the
    axes of frame `parent`, or of the ground (None).

    `mass` kg, `moment` mass times the centre of mass (kg m) in its own axes, `inertia` (kg m^2) about the
    origin, `height` (m) of the centre of mass, None where the Mechanism does not say it. With `apart` some of
    its bodies turn about other hinges, by the same angle.
    """

    heading: np.ndarray
    parent: int | None
    pivot: np.ndarray
    mass: float = 0.0
    moment: np.ndarray = field(default_factory=lambda: np.zeros(2))
    inertia: float = 0.0
    height: float | None = None
    apart: bool = False


@dataclass(frozen=True, eq=False)
class Castor:
    """What carries `load` (kg) without friction at a `place` (m) in the axes of `frame`."""

    name: str
    frame: int
    place: np.ndarray
    load: float


@dataclass(frozen=True, eq=False)
class WheelContact:
    """What touches the ground at a contact: `place` (m) in the axes of `frame`, `load` (kg) that rests on it.

    `angle` is the coordinate of its rotation; None: it turns freely, its rotation is no coordinate. `radius`
    (m) is negative where a positive angle rolls backward. `inertia` (kg m^2) is that about the axle. `turned`
    (rad) is the direction in which it rolls, from the heading of the frame to the left. With `rollers` on its
    rim nothing holds it across that direction: as a wheel of mecanum type acts, whose rollers have that
    direction and whose radius, here, is the part of its own along it. A contact that stands for several
    wheels, turned by one coordinate, has them at `places`; else that is its place alone.
    """

    name: str
    frame: int
    place: np.ndarray
    load: float
    angle: int | None
    radius: float
    inertia: float
    turned: float = 0.0
    rollers: bool = False
    wheels: tuple[np.ndarray, ...] = ()

    @property
    def places(self) -> tuple[np.ndarray, ...]:
        """Where wheels stand, m, in the axes of the frame."""
        return self.wheels or (self.place,)


@dataclass(frozen=True, eq=False)
class PlanarBodies:
    """A Mechanism as bodies: frames, wheels, what leans on the first frame, and the map from the rates of its
    coordinates to those of the hinges and axles.

    `joints` (n, n): velocity of [x; y; hinge of each frame; axle of each wheel with an angle; what leans] =
    joints @ qdot. `normal` is the part of the weight that presses on the ground, below 1 where the Mechanism
    is on a slope of its own. `mass` (kg) is the whole, 0 where bodies do not say it and wheels also have
    inertia along. `castors` are the supports that the Mechanism names. `off` is how far their mass matrix is
    from that of the Mechanism, relative to its largest entry: 0 but for frames with bodies `apart`, which
    turn about one hinge here.
    """

    frames: tuple[Frame, ...]
    wheels: tuple[WheelContact, ...]
    joints: np.ndarray
    normal: float = 1.0
    mass: float = 0.0
    leaning: tuple[LeaningBody, ...] = ()
    castors: tuple[Castor, ...] = ()
    off: float = 0.0

    def hinge(self, k: int) -> int:
        """Return the coordinate that turns frame k against the one that it is hinged to:
        the one which only its heading has."""
        parent = self.frames[k].parent
        before = np.zeros_like(self.frames[k].heading) if parent is None else self.frames[parent].heading
        return int(np.flatnonzero((self.frames[k].heading != 0) & (before == 0))[0])


@dataclass(frozen=True)
class _PointVelocity:
    """Rows (S, 2, n) of the velocities along and across at S states, `turned` (rad) from the heading to the
    left; `known` says which of the two are given. `place` (m, ahead and left) is what a contact says of
    itself.
    """

    name: str
    rows: np.ndarray
    known: tuple[bool, bool]
    place: np.ndarray | None = None
    turned: float = 0.0

    @property
    def directions(self) -> np.ndarray:
        """Along and across as rows of components forward and left, (2, 2)."""
        c, s = np.cos(self.turned), np.sin(self.turned)
        return np.array([[c, s], [-s, c]])


def planar(mechanism: Mechanism, parameters: np.ndarray, weighed: bool = True) -> PlanarBodies:
    """Return the bodies and wheels of a robot with these parameters (SI, in its order); unless `weighed`,
    only those on which contacts are, without masses and inertias of their own.

    Raises BadInput if it is not made of planar bodies on vertical hinges and of wheels with horizontal axles.
    """
    name = mechanism.name
    if mechanism.carried:
        raise BadInput(
            f"--engine mujoco: {name}: its ground moves, the engine's floor does not; run it without --engine"
        )
    if not mechanism.contacts:
        raise _refused(name, "it defines no contacts; add them with contact(name, mass, along, across)")
    x_y = [k for k, c in enumerate(mechanism.coordinates) if c.unit == "m"]
    if len(x_y) != 2:
        raise _refused(name, f"its position is not two coordinates in m; it has {len(x_y)}")
    random = np.random.default_rng(1992)
    states = random.uniform(-3.0, 3.0, (STATES, len(mechanism.coordinates)))
    function, count, bodies = _functions(mechanism), len(mechanism.contacts), len(mechanism.bodies) * weighed
    values = [[value.full() for value in function(q, parameters)] for q in states]
    rows, turning, M, places, masses, angles, heights = (
        np.array([value[k] for value in values]) for k in range(7)
    )
    if not np.isfinite(turning).all() or np.ptp(turning, axis=0).max() > EXACT:
        raise _refused(name, "the heading of a contact or body is not a sum of coordinates")
    turning = np.round(turning[0], 9)
    turned = _between_half_turns(angles[0, :, 0] - turning[:count] @ states[0])
    axles = _axles(mechanism, rows[:, : 2 * count], turning)
    points = []
    for k in range(count + bodies):
        pair = rows[:, 2 * k : 2 * k + 2].copy()
        contact = mechanism.contacts[k] if k < count else None
        known = (
            (True, True) if contact is None else (not contact.along.is_zero(), not contact.across.is_zero())
        )
        if contact is not None and axles[k] is not None:
            pair[:, :, axles[k]] = 0.0
        label = f"contact {contact.name!r}" if contact else f"body {mechanism.bodies[k - count].name!r}"
        own = (places[0, k, 1:], float(turned[k])) if contact is not None else ()
        points.append(_PointVelocity(label, pair, known, *own))
    frames, found, motions = _frames(name, points, turning, states, x_y)
    radii = [None if axle is None else -float(rows[0, 2 * k, axle]) for k, axle in enumerate(axles)]
    moved = M[:, x_y[0], x_y[0]]
    inertias: dict[int | None, float] = {}
    idle, off = [0.0] * count, 0.0
    leaning: list[LeaningBody] = []
    # Else wheels have inertia along
    mass = float(moved[0]) if np.ptp(moved) <= EXACT * moved[0] else float(masses[0].sum())
    if weighed:
        of = [found[count + k][0] for k in range(bodies)]
        _raise(frames, masses[0].ravel(), heights[0].ravel(), of)
        _weigh(name, frames, mass, masses[0].ravel(), of)
        leans = leaning_angles(rows, turning)
        parts = [part for angle in leans for part in parts_of_mass(states, angle, motions[0])]
        free = [
            _along(motions[found[k][0]], found[k][1], points[k].turned) if axles[k] is None else None
            for k in range(count)
        ]
        inertias, idle, found_of, off = _spins(
            name, frames, motions, M, sorted({a for a in axles if a is not None}), free, parts
        )
        leaning = [
            LeaningBody(angle, *each)
            for angle, each in zip(leans, found_of.reshape(-1, 3).tolist(), strict=True)
        ]
    driven = [abs(radius) for radius in radii if radius]
    if not driven:
        raise _refused(
            name,
            "no contact has a wheel: none of its velocities along is forward speed minus radius times rate",
        )
    named, standing = places[0, :, 1:], len(mechanism.standing)
    from_named = [found[k][1] - named[k] for k in range(count)]  # to the axes of the frame
    several = iter(named[standing:])
    wheels = tuple(
        WheelContact(
            c.name,
            *found[k],
            float(places[0, k, 0]),
            axles[k],
            radii[k] or float(np.mean(driven)),
            inertias[axles[k]] if axles[k] in inertias else idle[k] * float(np.mean(driven)) ** 2,
            points[k].turned,
            c.across.is_zero(),
            tuple(place + from_named[k] for place in islice(several, len(c.wheels))),
        )
        for k, c in enumerate(mechanism.contacts)
    )
    loaded = sum(wheel.load for wheel in wheels) / (mass or math.inf)
    for body in leaning:
        _check_leaning(name, mechanism.coordinates[body.angle].name, body, frames[0], wheels, mass)
    joints = _joints(name, frames, wheels, x_y, [body.angle for body in leaning], len(mechanism.coordinates))
    normal = loaded if _sloped(mechanism, x_y) else 1.0
    on = wheels[0].frame
    beside = [from_named[k] for k in range(count) if wheels[k].frame == on]
    if mechanism.supports and np.ptp(beside, axis=0).max() > EXACT * max(1.0, np.abs(named).max()):
        why = (
            "the places of contacts and supports do not fit the velocities of the contacts; correct ahead "
            "and left"
        )
        raise _refused(name, why)
    castors = tuple(
        Castor(c.name, on, np.round(named[count + k] + beside[0], 12) + 0.0, float(places[0, count + k, 0]))
        for k, c in enumerate(mechanism.supports)
    )
    return PlanarBodies(tuple(frames), wheels, joints, normal, mass, tuple(leaning), castors, off)


def _sloped(mechanism: Mechanism, x_y: list[int]) -> bool:
    """Return whether the energy at rest depends on the place: the robot is on a slope,
    which its contacts' loads consider."""
    resting = ca.substitute(mechanism.energy(), mechanism.qdot, ca.SX.zeros(len(mechanism.coordinates)))
    return any(ca.which_depends(resting, mechanism.q, 1, False)[k] for k in x_y)


def _refused(name: str, why: str) -> BadInput:
    return BadInput(
        f"--engine mujoco: {name} cannot be built from bodies and wheels: {why}; [scene] may take its file"
    )


@lru_cache(maxsize=16)
def _functions(mechanism: Mechanism) -> ca.Function:
    """Of q and parameters: rows of contacts and bodies, their yaw rates as rows, M, [load, ahead, left] of
    contacts, supports and the wheels of contacts, bodies' masses, the angles of the directions along of
    contacts, rad, bodies' heights.
    """
    q, qdot = mechanism.q, mechanism.qdot
    x_y = [k for k, c in enumerate(mechanism.coordinates) if c.unit == "m"]
    contacts = mechanism.contact_rows
    turning, angles = [], []
    for k in range(len(mechanism.contacts)):
        along, across = contacts[2 * k, :], contacts[2 * k + 1, :]
        # The direction across is (-sin, cos) of the heading; where only along is given, that is (cos, sin).
        c, s = (across[x_y[1]], -across[x_y[0]]) if not across.is_zero() else (along[x_y[0]], along[x_y[1]])
        turning.append((c * ca.jacobian(s, q) - s * ca.jacobian(c, q)) / (c * c + s * s))
        angles.append(ca.atan2(s, c))
    bodies = [ca.jacobian(ca.vertcat(body.forward, body.left), qdot) for body in mechanism.bodies]
    turning += [ca.jacobian(body.yaw_rate, qdot) for body in mechanism.bodies]
    places = [ca.horzcat(contact.mass, contact.ahead, contact.left) for contact in mechanism.standing]
    places += [ca.horzcat(0, place.T) for contact in mechanism.contacts for place in contact.wheels]
    masses, heights = (
        ca.vertcat(ca.SX(0, 1), *[getattr(b, of) for b in mechanism.bodies]) for of in ("mass", "height")
    )
    results = [ca.vertcat(contacts, *bodies), ca.vertcat(*turning), mechanism.M, ca.vertcat(*places)]
    results += [masses, ca.vertcat(*angles), heights]
    return portable(ca.Function("rows", [q, mechanism.p], [ca.densify(result) for result in results]))


def _between_half_turns(angles: np.ndarray) -> np.ndarray:
    """Return angles without whole turns, rad; what rounding leaves of them is none."""
    rest = angles - 2 * np.pi * np.round(angles / (2 * np.pi))
    return np.where(np.abs(rest) < EXACT, 0.0, rest)


def _axles(mechanism: Mechanism, rows: np.ndarray, turning: np.ndarray) -> list[int | None]:
    """Return for each contact the coordinate that turns its wheel:
    it moves the contact along at a constant rate, and no body."""
    found: list[int | None] = []
    for k in range(len(mechanism.contacts)):
        along, across = rows[:, 2 * k], rows[:, 2 * k + 1]
        still = ~turning.any(axis=0) & (np.abs(across).max(axis=0) == 0)
        turns = np.flatnonzero(still & (np.ptp(along, axis=0) <= EXACT * np.abs(along[0])) & (along[0] != 0))
        if len(turns) > 1 or (len(turns) == 0 and not mechanism.contacts[k].along.is_zero()):
            raise _refused(mechanism.name, f"contact {mechanism.contacts[k].name!r} is not that of one wheel")
        found.append(int(turns[0]) if len(turns) else None)
    return found


def _frames(
    name: str, points: list[_PointVelocity], turning: np.ndarray, states: np.ndarray, x_y: list[int]
) -> tuple[list[Frame], dict[int, tuple[int, np.ndarray]], list[np.ndarray]]:
    """Return the frames, for each point its frame and place there, and the motion (S, 3, n) of each frame's
    origin: forward, left, yaw rate.
    """
    n = states.shape[1]
    ground = np.zeros((len(states), 3, n))
    ground[:, 0, x_y[0]] = ground[:, 1, x_y[1]] = 1.0
    frames: list[Frame] = []
    motions: list[np.ndarray] = []
    found: dict[int, tuple[int, np.ndarray]] = {}
    left = list(range(len(points)))
    while left:
        for first in left:
            heading = turning[first]
            mine = [k for k in left if np.array_equal(turning[k], heading)]
            if not heading.any():
                raise _refused(name, f"{points[first].name} does not turn")
            for parent in (*range(len(frames)), None):
                before, motion = (
                    (np.zeros(n), ground) if parent is None else (frames[parent].heading, motions[parent])
                )
                hinge = partial(_hinge, angle=states @ (before - heading), motion=motion, heading=heading)
                fitted, on_it = hinge([points[k] for k in mine]), mine
                if fitted is None and (on_it := [k for k in mine if points[k].place is not None]):
                    # Bodies on hinges of their own that turn together, as both steered wheels of a car beside
                    # their contact.
                    fitted = (
                        hinge([points[k] for k in on_it]) if all(hinge([points[k]]) for k in mine) else None
                    )
                if fitted is not None:
                    break
            else:
                continue
            pivot, places, moved = fitted
            frames.append(Frame(heading, parent, pivot, apart=on_it != mine))
            motions.append(moved)
            found |= {k: (len(frames) - 1, np.zeros(2)) for k in mine}
            found |= {k: (len(frames) - 1, place) for k, place in zip(on_it, places, strict=True)}
            left = [k for k in left if k not in mine]
            break
        else:
            raise _refused(name, f"{points[left[0]].name} is not on a body hinged about a vertical")
    return frames, found, motions


def _hinge(
    points: list[_PointVelocity], angle: np.ndarray, motion: np.ndarray, heading: np.ndarray
) -> tuple[np.ndarray, list[np.ndarray], np.ndarray] | None:
    """Return the hinge in the axes of a parent that moves as `motion`, the place of each point, and the
    motion of the hinge in the axes of the frame; None if no hinge reproduces the rows. `angle` (S): heading
    of the parent minus that of the frame.
    """
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    forward, left, yaw = motion[:, 0], motion[:, 1], motion[:, 2]
    own = np.broadcast_to(heading, yaw.shape)
    base = np.stack([c * forward - s * left, s * forward + c * left], axis=1)
    # Ahead, left
    by_pivot = np.stack([np.stack([s * -yaw, c * yaw], axis=1), np.stack([c * -yaw, s * -yaw], axis=1)])
    zero = np.zeros_like(own)
    by_place = np.stack([np.stack([zero, own], axis=1), np.stack([-own, zero], axis=1)])
    unknowns, columns, velocities = 2 + 2 * len(points), [], []
    for k, point in enumerate(points):
        kept = np.flatnonzero(point.known)
        block = np.zeros((unknowns, len(angle), len(kept), len(heading)))
        along_across = point.directions
        block[:2], block[2 + 2 * k : 4 + 2 * k] = (
            np.einsum("ab,usbn->usan", along_across, by)[:, :, kept] for by in (by_pivot, by_place)
        )
        columns.append(block.reshape(unknowns, -1))
        velocities.append((point.rows - np.einsum("ab,sbn->san", along_across, base))[:, kept].ravel())
    A, b = np.hstack(columns).T, np.concatenate(velocities)
    solution = np.linalg.lstsq(A, b, rcond=None)[0]
    if np.abs(A @ solution - b).max() > EXACT * max(1.0, np.abs(b).max()):
        return None
    solution[np.abs(solution) < EXACT] = 0.0
    pivot, places = solution[:2], list(solution[2:].reshape(-1, 2))
    for point, place in zip(points, places, strict=True):
        if point.place is None:
            continue
        if not point.known[0]:
            place[1] = point.place[1]
        if not point.known[1]:  # its velocity does not depend on where it is in the direction along
            place += point.directions[0] * (point.directions[0] @ (point.place - place))
    moved = base + np.tensordot(pivot, by_pivot, axes=1)
    return pivot, places, np.concatenate([moved, own[:, None]], axis=1)


def _raise(frames: list[Frame], masses: np.ndarray, heights: np.ndarray, of: list[int]) -> None:
    """Set the heights of the frames: of the centre of mass of those of their bodies whose height is known."""
    for k, frame in enumerate(frames):
        known = [j for j, own in enumerate(of) if own == k and heights[j]]
        if known:
            frame.height = float(masses[known] @ heights[known] / masses[known].sum())


def _weigh(name: str, frames: list[Frame], total: float, masses: np.ndarray, of: list[int]) -> None:
    """Set the masses of the frames: those of the bodies on them,
    and what remains of the total on the first."""
    for mass, k in zip(masses, of, strict=True):
        frames[k].mass += float(mass)
    rest = total - sum(frame.mass for frame in frames)
    frames[0].mass += rest if abs(rest) > EXACT * total else 0.0
    if rest < -EXACT * total or not frames[0].mass:
        raise _refused(name, "its bodies weigh more than all that moves")


def _along(motion: np.ndarray, place: np.ndarray, turned: float) -> np.ndarray:
    """Return the rows (S, n) of the velocity of a place of a frame in the direction `turned` (rad) from its
    heading."""
    forward, left, yaw = (motion[:, k] for k in range(3))
    return np.cos(turned) * (forward - place[1] * yaw) + np.sin(turned) * (left + place[0] * yaw)


def _spins(
    name: str,
    frames: list[Frame],
    motions: list[np.ndarray],
    M: np.ndarray,
    axles: list[int],
    free: list[np.ndarray | None],
    more: list[np.ndarray],
) -> tuple[dict[int | None, float], list[float], np.ndarray, float]:
    """Set first moments and inertias of the frames such that M(q) is that of the Mechanism; return the
    inertia of each axle; that of each wheel whose rotation is no coordinate and which moves along as `free`,
    by its radius squared (kg); the factors of `more` parts of M, each (S, n, n); and how much of M is left,
    relative to its largest entry.
    """
    rest, basis = M.copy(), []
    for frame, motion in zip(frames, motions, strict=True):
        forward, left, yaw = (motion[:, k, :, None] for k in range(3))
        rest -= frame.mass * (product(forward, forward) + product(left, left)) / 2
        weighs = 1.0 if frame.mass > 0 else 0.0
        basis += [weighs * product(left, yaw), -weighs * product(forward, yaw), product(yaw, yaw) / 2]
    for axle in axles:
        unit = np.zeros_like(M)
        unit[:, axle, axle] = 1.0
        basis.append(unit)
    basis += [product(along[:, :, None], along[:, :, None]) / 2 for along in free if along is not None]
    basis += more
    A = np.stack([each.ravel() for each in basis], axis=1)
    solution = np.linalg.lstsq(A, rest.ravel(), rcond=None)[0]
    off = float(np.abs(A @ solution - rest.ravel()).max() / np.abs(M).max())
    if off > (APART if any(frame.apart for frame in frames) else EXACT):
        raise _refused(name, "its kinetic energy is not that of bodies and wheels in the plane")
    for k, frame in enumerate(frames):
        frame.moment, frame.inertia = solution[3 * k : 3 * k + 2], float(solution[3 * k + 2])
        about = frame.inertia - (frame.moment @ frame.moment / frame.mass if frame.mass else 0.0)
        if about <= 0:
            raise _refused(name, f"a body has no positive inertia about the vertical ({about:.3g} kg m^2)")
    rolls = [along is not None for along in free]
    own, idle, others = np.split(solution[3 * len(frames) :], [len(axles), len(axles) + sum(rolls)])
    if idle.min(initial=0.0) < -EXACT * np.abs(M).max():
        raise _refused(
            name,
            f"a wheel that turns freely has a negative inertia ({idle.min():.3g} kg by its radius squared)",
        )
    spun = iter(np.where(idle > EXACT * np.abs(M).max(), idle, 0.0).tolist())
    inertias: dict[int | None, float] = dict(zip(axles, own.tolist(), strict=True))
    if any(inertia <= 0 for inertia in inertias.values()):
        raise _refused(name, "a wheel has no inertia about its axle, and so no defined slip; give it one")
    return (
        inertias,
        [next(spun) if rolling else 0.0 for rolling in rolls],
        others,
        off if off > EXACT else 0.0,
    )


def _check_leaning(
    name: str, angle: str, body: LeaningBody, frame: Frame, wheels: tuple[WheelContact, ...], mass: float
) -> None:
    """Raise BadInput unless a body leans about the axle of all wheels,
    and what does not lean weighs nothing beside it."""
    if body.moment <= 0 or not mass:
        raise _refused(
            name, f"what moves with {angle} is no body that leans about an axle, its centre of mass above it"
        )
    if any(
        wheel.frame or abs(wheel.place[0]) > EXACT or wheel.radius != wheels[0].radius for wheel in wheels
    ):
        raise _refused(
            name, f"a body leans by {angle}, and the wheels are not on one axle that it leans about"
        )
    if np.abs(frame.moment).max() > EXACT * mass:
        raise _refused(
            name, f"a body leans by {angle}, and what does not lean weighs more on one side of the axle"
        )


def _joints(
    name: str,
    frames: list[Frame],
    wheels: tuple[WheelContact, ...],
    x_y: list[int],
    leaning: list[int],
    n: int,
) -> np.ndarray:
    """Return `Planar.joints`. Raises BadInput if a coordinate moves none of them."""
    unit = np.eye(n)
    hinges = [
        frame.heading - (0 if frame.parent is None else frames[frame.parent].heading) for frame in frames
    ]
    axles = [wheel.angle for wheel in wheels if wheel.angle is not None]
    if len(set(axles)) < len(axles):
        raise _refused(name, "one coordinate turns two wheels")
    joints = np.array([*unit[x_y], *hinges, *unit[axles], *unit[leaning]])
    if joints.shape != (n, n) or np.linalg.matrix_rank(joints) < n:
        raise _refused(
            name, "its coordinates are not those of its position, the headings of its bodies and its wheels"
        )
    return joints
