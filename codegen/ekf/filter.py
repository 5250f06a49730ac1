"""One tick of an extended Kalman filter on a robot's kinematics, in named steps, with the covariance as P = U
D U'.

States: the pose, the bias of the gyro, and scales (1 if the model is right) of parameters of S(q) or of
measured motions. In a tick the quasi-velocities nu have the integrals `turned` (the angles of wheels, by
encoders), with independent errors of variance noise^2 |turned|. The pose moves by S(q) turned at the heading
in the middle of the tick.

With a gyro, whose error is the bias and white noise: the difference between its turn and that of the wheels
measures bias and scales. The wheels' angles are then corrected by the rest of the difference, as their errors
and the gyro's variance share it. This is the same as one update of the states together with the wheels'
errors, because this rest is independent of what the difference says of the states.

The pose comes first. Its part of the transition matrix is then unit upper triangular and keeps the form of U;
what is left of the prediction are updates of rank one, for each error (Agee and Turner 1972). Numbers are
used one by one (Bierman 1977).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import casadi as ca
import numpy as np

from ...model.algebra.exact import canonical
from ...model.errors import ModelError
from ...model.mechanism import Quantity, quantity, refuse_twice
from ...model.reduction import ReducedSystem
from ...model.vehicle import estimated_pose
from ..derivation.stages import Result, inner_velocities
from ..dynamics import DynamicsProgram
from ..graph import Group
from ..program import Entry, constants_of
from ..steps import StepBuilder, SteppedBody

MOST_STATES = 8  # NOSLIP_EKF_STATES
POSE = 3  # states; the bias follows
Factor = dict[tuple[int, int], ca.SX]  # entries of U above the diagonal
RESULTS = (Result.MOVED, Result.OTHERS, Result.FACTORS, Result.SPENT)
WITHOUT_GYRO = Entry("wheels", "A tick by the wheels alone", RESULTS, Group.INPUT, public=False)
WITH_GYRO = Entry("gyro", "A tick by wheels and gyro", RESULTS, Group.INPUT, public=False)


@dataclass(frozen=True, eq=False)
class TickMotion:
    """The kinematics of a tick: symbols of what is measured,
    and the motion in the inner velocities w = W nu."""

    turned: tuple[Quantity, ...]  # integral of each quasi-velocity
    # Coordinates besides the pose on which S depends, in the middle of the tick
    measured: tuple[Quantity, ...]
    scales: tuple[Quantity, ...]
    w: ca.SX  # symbols of the integrals of the inner velocities, (p,)
    of_turned: ca.SX  # w as a function of turned and scales, (p,)
    heading: ca.SX
    S: ca.SX  # rows of the pose, (3, p), functions of heading, measured, scales


@dataclass(frozen=True, eq=False)
class FilterProgram(DynamicsProgram):
    """The ticks of the filter in named steps."""

    motion: TickMotion
    leaves: dict[str, Sequence[Quantity]] = field(default_factory=dict)

    @property
    def groups(self) -> dict[str, Sequence[Quantity]]:
        """The leaves of the graph, by group."""
        return self.leaves

    @property
    def states(self) -> int:
        """Number of states."""
        return len(self.leaves[Group.ESTIMATE])


def why_no_filter(system: ReducedSystem) -> str:
    """Return why a robot has no filter; empty if it has one."""
    try:
        _motion(system, ())
    except ModelError as error:
        return str(error)
    return ""


@lru_cache(maxsize=16)
def _motion(system: ReducedSystem, scaled: tuple[str, ...]) -> TickMotion:
    """Return the motion of a tick. Raises ModelError if the robot has none,
    or for names that cannot be scaled."""
    mechanism, vehicle = system.mechanism, estimated_pose(system)
    name = mechanism.name
    if mechanism.why_carried:
        raise ModelError(f"{name}: {mechanism.why_carried}")
    if mechanism.vehicle is None:
        raise ModelError(f"{name}: a filter needs a vehicle: use moves_in_plane(x, y, heading)")
    if vehicle is None:
        raise ModelError(
            f"{name}: a filter needs coordinates that displace the vehicle in x and y and turn it"
        )
    place = ca.vertcat(vehicle.x, vehicle.y, vehicle.heading)
    inner, W = inner_velocities(system)
    S_pose = canonical(ca.jacobian(place, mechanism.q) @ inner.S)
    w = ca.vertcat(*[ca.SX.sym(each) for each in _motions(inner)])
    turned = tuple(
        quantity(f"turned_{q.name}", _integrated(q.unit), f"integral of {q.name} in this tick")
        for q in system.quasi_velocities
    )
    parameters = {p.name: p for p in mechanism.parameters}
    kinematics = ca.vertcat(ca.vec(S_pose), ca.vec(W))
    refuse_twice(scaled, f"{name}: filter, scales")
    scales, real, factors = [], [], {q.name: ca.SX(1) for q in system.quasi_velocities}
    for each in scaled:
        scale = quantity(f"scale_{each}", "1", f"{each} is this times its nominal value")
        scales.append(scale)
        if each in parameters and ca.depends_on(kinematics, parameters[each].symbol):
            real.append((parameters[each].symbol, scale.symbol * parameters[each].symbol))
        elif each in factors:
            factors[each] = scale.symbol
        else:
            known = [*(p for p in parameters if ca.depends_on(kinematics, parameters[p].symbol)), *factors]
            raise ModelError(f"{name}: {each!r} cannot be scaled in the filter; {', '.join(known)} can")

    def scaled_by(expression: ca.SX) -> ca.SX:
        return (
            ca.substitute([expression], [a for a, _ in real], [b for _, b in real])[0] if real else expression
        )

    motions = ca.vertcat(
        *[factors[q.name] * t.symbol for q, t in zip(system.quasi_velocities, turned, strict=True)]
    )
    S = scaled_by(S_pose)
    others = [c for c in mechanism.coordinates if not ca.depends_on(place, c.symbol)]
    if not _is_planar(S, vehicle.heading, [c.symbol for c in mechanism.coordinates if c not in others]):
        raise ModelError(
            f"{name}: a filter needs a vehicle that moves alike wherever it is and whatever its heading"
        )
    measured = tuple(c for c in others if ca.depends_on(S, c.symbol))
    return TickMotion(turned, measured, tuple(scales), w, scaled_by(W) @ motions, vehicle.heading, S)


def check_scales(system: ReducedSystem, scaled: Sequence[str]) -> None:
    """Raise ModelError for names that cannot be scaled, or whose scales cannot be told apart by any
    motion."""
    motion = _motion(system, tuple(scaled))
    scales = ca.vertcat(*[q.symbol for q in motion.scales])
    moved = ca.substitute([motion.S @ motion.w], [motion.w], [motion.of_turned])[0]
    inputs = [q.symbol for q in (*motion.turned, *motion.measured)]
    parameters = system.mechanism.parameters
    by_scales = ca.Function(
        "by_scales",
        [ca.vertcat(*inputs), motion.heading, ca.vertcat(*[p.symbol for p in parameters]), scales],
        [ca.jacobian(moved, scales)],
    )
    random, nominal = np.random.default_rng(1), [p.default for p in parameters]
    tries = [
        by_scales(random.uniform(-1, 1, len(inputs)), angle, nominal, 1).full()
        for angle in random.uniform(-3, 3, 20)
    ]
    if scaled and np.linalg.matrix_rank(np.vstack(tries), 1e-9) < len(scaled):
        raise ModelError(
            f"{system.mechanism.name}: no motion tells the scales of {', '.join(scaled)} apart; leave one out"
        )


def _motions(inner: ReducedSystem) -> list[str]:
    """Return names of the integrals of the inner velocities."""
    known = {"forward_speed": "distance", "yaw_rate": "turn"}
    return [known.get(q.name, f"driven_{k + 1}") for k, q in enumerate(inner.quasi_velocities)]


def _integrated(unit: str) -> str:
    return unit.removesuffix("/s") if unit.endswith("/s") else f"{unit} s"


def _is_planar(S: ca.SX, heading: ca.SX, place: Sequence[ca.SX]) -> bool:
    """Whether the rows of x and y turn with the heading, and nothing else depends on the coordinates of the
    place."""
    turning = ca.jacobian(ca.vec(S), heading) - ca.vec(
        ca.vertcat(-S[1, :], S[0, :], ca.SX.zeros(1, S.shape[1]))
    )
    position = [symbol for symbol in place if symbol.element_hash() != heading.element_hash()]
    return canonical(turning).is_zero() and not any(ca.depends_on(S, symbol) for symbol in position)


def compile_filter(system: ReducedSystem, scaled: Sequence[str] = ()) -> FilterProgram:
    """Return the filter of a robot that also estimates scales of these parameters and motions.

    Raises ModelError if the robot has no filter, or for a name that cannot be scaled.
    """
    return _FilterBuilder(system, _motion(system, tuple(scaled))).program()


class _FilterBuilder(StepBuilder):
    """The steps of both ticks."""

    def __init__(self, system: ReducedSystem, motion: TickMotion):
        self.motion = motion
        count = POSE + 1 + len(motion.scales)
        if count > MOST_STATES:
            raise ModelError(
                f"{system.mechanism.name}: a filter has at most {MOST_STATES - POSE - 1} scales, not "
                f"{count - POSE - 1}"
            )
        heading = Quantity("heading", "rad", "", symbol=motion.heading)
        self.bias = quantity("gyro_bias", "rad/s", "bias of the gyro")
        estimate = (quantity("x", "m"), quantity("y", "m"), heading, self.bias, *motion.scales)
        self.D = [quantity(f"D_{j + 1}", "", "") for j in range(count)]
        self.U = {(i, j): quantity(f"U_{i + 1}{j + 1}", "", "") for j in range(count) for i in range(j)}
        names = [q.name for q in system.quasi_velocities]
        self.noise = [
            quantity(f"noise_{name}", _root(t.unit), "") for name, t in zip(names, motion.turned, strict=True)
        ]
        self.gyro_noise = quantity("gyro_noise", "rad/sqrt(s)")
        self.walk = quantity("bias_walk", "rad/s/sqrt(s)")
        self.gyro, self.dt = quantity("gyro", "rad/s", "rate"), quantity("dt", "s", "length of the tick")
        factors = [self.U[i, j] if i < j else self.D[j] for j in range(count) for i in range(j + 1)]
        groups: dict[str, Sequence[Quantity]] = {
            Group.PARAMS: system.mechanism.parameters,
            Group.CONFIG: (*self.noise, self.gyro_noise, self.walk),
            Group.ESTIMATE: estimate,
            Group.FACTOR: tuple(factors),
            Group.INPUT: (*motion.turned, *motion.measured, self.gyro, self.dt),
        }
        super().__init__(groups, system.mechanism.name)
        self.system, self.leaves, self.count = system, groups, count

    def program(self) -> FilterProgram:
        """Return the program with both ticks."""
        entries = {WITHOUT_GYRO: self._tick(False), WITH_GYRO: self._tick(True)}
        constants = constants_of([root for body in entries.values() for root in body.roots], self.labels)
        return FilterProgram(
            self.system, entries, constants, self.labels, self.regular, self.motion, self.leaves
        )

    def _tick(self, by_gyro: bool) -> SteppedBody:
        motion, n = self.motion, self.count
        state = [q.symbol for q in self.leaves[Group.ESTIMATE]]
        U, D = {key: q.symbol for key, q in self.U.items()}, [q.symbol for q in self.D]
        turned = [q.symbol for q in motion.turned]
        Q = [
            self.step(f"variance_{k + 1}", q.symbol**2 * ca.fabs(turned[k])) for k, q in enumerate(self.noise)
        ]
        # U of the errors of `turned`
        errors: Factor = {(i, j): ca.SX(0) for j in range(len(Q)) for i in range(j)}
        change = [ca.SX(0)] * n
        corrected_by = [[ca.SX(0)] * len(Q) for _ in range(n - POSE)]  # turned, by each state after the pose
        if by_gyro:
            turned_symbols, scales = ca.vertcat(*turned), ca.vertcat(*[q.symbol for q in motion.scales])
            turn = motion.S[2, :] @ motion.of_turned
            dt = self.dt.symbol
            by_scale = [
                self.step(f"turn_by_scale_{k + 1}", each)
                for k, each in enumerate(_columns(ca.jacobian(turn, scales)))
            ]
            by_wheel = [
                self.step(f"turn_by_{k + 1}", each)
                for k, each in enumerate(_columns(ca.jacobian(turn, turned_symbols)))
            ]
            difference = self.step("difference", (self.gyro.symbol - self.bias.symbol) * dt - turn)
            white = self.step("gyro_variance", self.gyro_noise.symbol**2 * dt)
            total, inverse, gain = self._measure(
                "wheels", errors, Q, by_wheel, white, self.step("gyro_weight", 1 / white)
            )
            share = [self.step(f"share_{k + 1}", each * inverse) for k, each in enumerate(gain)]
            h = [ca.SX(0)] * POSE + [dt, *by_scale]
            _, inverse, gain = self._measure("state", U, D, h, total, inverse)
            innovation = self.step("innovation", difference * inverse)
            change = [self.step(f"change_{k + 1}", each * innovation) for k, each in enumerate(gain)]
            rest = self.step(
                "rest", difference - sum((h[k] * change[k] for k in range(POSE, n)), start=ca.SX(0))
            )
            turned = [self.step(f"corrected_{k + 1}", turned[k] + share[k] * rest) for k in range(len(share))]
            corrected_by = [[-part * each for part in share] for each in h[POSE:]]
        others = [self.step(f"state_{k + 1}", state[k] + change[k]) for k in range(POSE, n)]
        moved, by_turned, by_scales = self._moved(turned, state[2] + change[2], others[1:])
        by_others = [by_turned @ ca.vertcat(*each) for each in corrected_by]
        by_others[1:] = [total + by_scales[:, k] for k, total in enumerate(by_others[1:])]
        self._propagate(
            U, moved, [self._steps(f"by_state_{k + POSE + 1}", each) for k, each in enumerate(by_others)]
        )
        spent_position, spent_heading = ca.SX(0), ca.SX(0)
        for j in reversed(range(len(Q))):
            error = by_turned[:, j] + sum(
                (by_turned[:, i] * errors[i, j] for i in range(j)), start=ca.SX.zeros(POSE, 1)
            )
            error = self._steps(f"error_{j + 1}", error)
            spent_position += Q[j] * (error[0] ** 2 + error[1] ** 2)
            spent_heading += Q[j] * error[2] ** 2
            self._add(f"error_{j + 1}", U, D, ca.vertsplit(error), Q[j])
        self._add("walk", U, D, [*([ca.SX(0)] * POSE), ca.SX(1)], self.walk.symbol**2 * self.dt.symbol)
        quantities = {
            Result.MOVED: ca.vertcat(*[moved[k] + change[k] for k in range(POSE)]),
            Result.OTHERS: ca.vertcat(*others),
            Result.FACTORS: ca.vertcat(*[U[i, j] if i < j else D[j] for j in range(n) for i in range(j + 1)]),
            Result.SPENT: ca.vertcat(spent_position, spent_heading),
        }
        built = dict(zip(quantities, self.built(list(quantities.values())), strict=True))
        body = SteppedBody((), built)
        return SteppedBody(tuple(self.needed(body.roots)), built)

    def _moved(
        self, turned: Sequence[ca.SX], heading: ca.SX, scales: Sequence[ca.SX]
    ) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Return the change of the pose, (3,), and its derivatives by `turned` and by the scales at the
        middle of the tick."""
        motion = self.motion
        known = [q.symbol for q in (*motion.turned, *motion.scales)]
        symbols = ca.vertcat(*[q.symbol for q in motion.scales])

        def at(expression: ca.SX, middle: ca.SX = motion.heading) -> ca.SX:
            return ca.substitute([expression], [*known, motion.heading], [*turned, *scales, middle])[0]

        w = ca.vertcat(
            *[
                self.step(str(name), each)
                for name, each in zip(_parts(motion.w), _parts(at(motion.of_turned)), strict=True)
            ]
        )
        middle = self.step("middle", heading + at(motion.S[2, :]) @ w / 2)
        S = self._steps("S_", at(motion.S, middle))
        moved = self._steps("moved_", S @ w)
        turning = ca.vertcat(-moved[1], moved[0], 0)  # derivative by the heading
        by_turned = at(ca.jacobian(motion.of_turned, ca.vertcat(*[q.symbol for q in motion.turned])))
        by_scales = at(ca.jacobian(motion.of_turned, symbols))
        direct = ca.horzcat(*[ca.jacobian(motion.S @ w, each.symbol) for each in motion.scales])
        direct = at(direct, middle) if motion.scales else ca.SX(POSE, 0)

        def chain(inner: ca.SX, outer: ca.SX) -> ca.SX:
            part = S @ inner + outer
            return part + turning @ part[2, :] / 2

        return (
            moved,
            self._steps("by_turned_", chain(by_turned, ca.SX.zeros(POSE, len(turned)))),
            chain(by_scales, direct),
        )

    def _propagate(self, U: Factor, moved: ca.SX, by_others: Sequence[ca.SX]) -> None:
        """Multiply U by the transition matrix; by_others are those of the states after the pose."""
        for j in range(POSE, self.count):
            column = [U[k, j] for k in range(j)] + [ca.SX(1)]
            added = [-moved[1] * column[2], moved[0] * column[2], ca.SX(0)]
            for i in range(POSE):
                added[i] += sum(
                    (by_others[k - POSE][i] * column[k] for k in range(POSE, j + 1)), start=ca.SX(0)
                )
                U[i, j] = self.step(f"U_{i + 1}{j + 1}_predicted", column[i] + added[i])
        U[0, 2] = self.step("U_13_predicted", U[0, 2] - moved[1])
        U[1, 2] = self.step("U_23_predicted", U[1, 2] + moved[0])

    def _measure(
        self, name: str, U: Factor, D: list[ca.SX], h: Sequence[ca.SX], r: ca.SX, inverse: ca.SX
    ) -> tuple[ca.SX, ca.SX, list[ca.SX]]:
        """Update U and D by a number h'x with the variance r = 1 / inverse (Bierman 1977). Return the
        innovation's variance, its inverse, and the gain times this variance."""
        alpha, gain = r, [ca.SX(0)] * len(D)
        for j in range(len(D)):
            f = h[j] + sum((U[i, j] * h[i] for i in range(j)), start=ca.SX(0))
            if f.is_zero():
                continue
            f = self.step(f"f_{name}_{j + 1}", f)
            v = self.step(f"v_{name}_{j + 1}", D[j] * f)
            back = self.step(f"back_{name}_{j + 1}", f * inverse)
            larger = self.step(f"alpha_{name}_{j + 1}", alpha + f * v)
            inverse = self.step(f"weight_{name}_{j + 1}", 1 / larger)
            D[j] = self.step(f"D_{j + 1}_{name}", D[j] * (alpha * inverse))
            for i in range(j):
                u, before = U[i, j], gain[i]
                U[i, j] = u if before.is_zero() else self.step(f"U_{i + 1}{j + 1}_{name}", u - back * before)
                gain[i] = before if u.is_zero() else self.step(f"gain_{name}_{i + 1}{j + 1}", before + u * v)
            gain[j], alpha = v, larger
        return alpha, inverse, gain

    def _add(self, name: str, U: Factor, D: list[ca.SX], vector: Sequence[ca.SX], c: ca.SX) -> None:
        """Add c a a' to U D U', c >= 0, for a vector a whose entries after those given are 0 (Agee and Turner
        1972)."""
        a = list(vector)
        for j in reversed(range(len(a))):
            if a[j].is_zero():
                continue
            weighted = self.step(f"weighted_{name}_{j + 1}", c * a[j])
            larger = self.step(f"D_{j + 1}_{name}", D[j] + weighted * a[j])
            inverse = self.step(f"inverse_{name}_{j + 1}", 1 / larger)
            beta = self.step(f"beta_{name}_{j + 1}", weighted * inverse)
            for i in range(j):
                a[i] = self.step(f"a_{name}_{i + 1}{j + 1}", a[i] - a[j] * U[i, j])
                U[i, j] = self.step(f"U_{i + 1}{j + 1}_{name}", U[i, j] + beta * a[i])
            c = self.step(f"c_{name}_{j + 1}", c * (D[j] * inverse))
            D[j] = larger

    def _steps(self, name: str, matrix: ca.SX) -> ca.SX:
        """Return the matrix with a step for each entry that is not a number."""
        entries = [self.step(f"{name}{k + 1}", entry) for k, entry in enumerate(_parts(matrix))]
        return ca.reshape(ca.vertcat(*entries), matrix.shape)


def _parts(matrix: ca.SX) -> list[ca.SX]:
    """Return the entries, by columns."""
    return ca.vertsplit(ca.vec(ca.densify(matrix)))


def _columns(row: ca.SX) -> list[ca.SX]:
    return ca.horzsplit(ca.densify(row)) if row.numel() else []


def _root(unit: str) -> str:
    """Return the unit of a standard deviation after one `unit`, of an error that grows as a random walk."""
    return f"sqrt({unit})"
