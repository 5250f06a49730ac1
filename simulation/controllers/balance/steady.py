"""Underactuated robots at rest or in a steady motion: what the inputs do to small deviations from it, and
gains by LQR.

A steady motion is a relative equilibrium: the quasi-velocities, the inputs and the coordinates on which the
equations depend are constant, the others, such as the place, go on. Deviations of a place in the plane are
taken in axes along the desired heading; a robot whose equations do not depend on where it is then has a
linearization with constant coefficients in a circle too.

By numbers, at given parameters. A mode of the linearized robot that no input moves is found as a part of the
state space orthogonal to all that the inputs reach (R. E. Kalman, Mathematical description of linear
dynamical systems, 1963). One that grows cannot be stabilized. One at 0 is left by every linear feedback: it
may be an integral of the motion, or a place that only manoeuvres reach, because rolling is nonholonomic.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from ....model.errors import ModelError
from ....model.mechanism import Mechanism
from ....model.reduction import counted
from ....model.underactuated import PartialLinearization, at_rest, partial_linearization
from ....model.vehicle import point_on_body
from ....readers.errors import BadInput, check_named

RESTS = 1e-9  # N, N m, or the unit of a rate: what is left at an equilibrium
REACHED = 1e-9  # relative: singular values at or below this count as zero
STILL = 1e-4  # 1/s: real parts at or below this in size count as zero: rounding moves a double 0 by its root
DIGITS = 10  # of gains, and of a steady motion
NEWTON, SAMPLES = 50, 3  # steps for a steady motion; random states at which dependences are looked for


@dataclass(frozen=True, eq=False)
class Steady:
    """The robot linearized about a steady motion, dx/dt = A x + B tau with x = [q; nu] and tau as deviations
    from it.

    The motion begins at q (n, pose 0 unless at rest) with nu (n-m); `rates` (n) are those of the coordinates
    there, `tau` (r) the inputs. `constant` are the numbers of the coordinates that it must hold, as the
    equations depend on them. `reached` are orthonormal columns that span what the inputs reach, `lost` those
    of the rest. `modes` of what is reached, `unreached` of the rest: 1/s.
    """

    partial: PartialLinearization = field(repr=False)
    q: tuple[float, ...]
    nu: tuple[float, ...]
    rates: tuple[float, ...]
    parameters: tuple[float, ...]
    tau: tuple[float, ...]
    constant: tuple[int, ...]
    A: np.ndarray
    B: np.ndarray
    reached: np.ndarray
    lost: np.ndarray
    modes: np.ndarray
    unreached: np.ndarray

    @property
    def names(self) -> list[str]:
        """Of the states."""
        return [quantity.name for quantity in self.partial.system.state]

    @property
    def state(self) -> np.ndarray:
        """Where the motion begins, [q; nu]."""
        return np.array([*self.q, *self.nu])

    @property
    def rests(self) -> bool:
        """Whether nothing moves."""
        return not any(self.nu)

    @property
    def about(self) -> str:
        """What the motion is, in words: at rest, or the quasi-velocities and coordinates that are not 0."""
        if self.rests:
            return "at rest"
        units = [quantity.unit for quantity in self.partial.system.state]
        given = zip(self.names, self.state, units, strict=True)
        return "in steady motion, " + ", ".join(
            f"{name} = {value:.6g} {unit}" for name, value, unit in given if value
        )

    @property
    def place(self) -> tuple[int, int, int] | None:
        """The numbers of the states that are the vehicle's position and heading; None if they are no
        coordinates, or the heading is not 0 at the beginning.
        """
        point = point_on_body(self.partial.system)
        return point.pose if point and point.arm.is_zero() and self.q[point.pose[2]] == 0.0 else None

    @property
    def stabilizable(self) -> bool:
        """Whether linear feedback leaves no mode that grows."""
        return bool(np.all(self.unreached.real <= STILL))

    @property
    def left(self) -> int:
        """How many modes at 0 no input moves."""
        return int(np.sum(np.abs(self.unreached.real) <= STILL))

    @property
    def verdict(self) -> str:
        """Whether linear feedback stabilizes it; what it cannot, and why."""
        if not self.stabilizable:
            return (
                f"not stabilizable: no input moves the modes {listed(self.unreached)} 1/s, and one of "
                f"them grows{self._of()}"
            )
        if not self.left:
            return "asymptotically stabilizable by linear feedback"
        grows = np.any(self.modes.real > STILL)
        return (
            f"{'all that grows can be stabilized' if grows else 'nothing grows'}, but not asymptotically "
            f"stabilizable by linear feedback: no input moves {counted(self.left, 'mode')} at 0: integrals "
            f"of the motion, or places that only manoeuvres reach{self._of()}"
        )

    def _of(self) -> str:
        """Return of which states the modes are that no input moves."""
        sizes = np.linalg.norm(self.lost, axis=1)
        alone = [name for name, size in zip(self.names, sizes, strict=True) if size > 1.0 - 1e-6]
        mixed = [name for name, size in zip(self.names, sizes, strict=True) if 1e-6 < size <= 1.0 - 1e-6]
        parts = [*alone, *([f"combinations of {', '.join(mixed)}"] if mixed else [])]
        return f" ({'; '.join(parts)})" if parts else ""

    def lqr(
        self, weights: Mapping[str, float], effort: float | Sequence[float] = 1.0, without: Sequence[str] = ()
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return K, r x (2n-m), of tau = tau_e - K (x - x_e), which minimizes the integral of sum(weight_i
        x_i^2) and sum(effort_j tau_j^2) over what the inputs reach, and X, (2n-m) x (2n-m): the least cost
        from x is (x - x_e)' X (x - x_e).

        `weights` by the name of a state; those not named have 0. States named in `without` on which nothing
        depends, such as angles of wheels, are left out of it: they go where they go. Raises BadInput for an
        unknown name, a weight that is negative or an effort that is not positive, for weights that leave a
        mode that grows or rests unseen, and for a motion that is not stabilizable.
        """
        self.check_names([*weights, *without])
        if not self.stabilizable:
            raise BadInput(f"lqr: {self.verdict}")
        for name, weight in weights.items():
            if not 0.0 <= weight < np.inf:
                raise BadInput(f"lqr: the weight of {name} is {weight}; it must be finite and not negative")
        R = np.atleast_1d(np.asarray(effort, float)) * np.ones(self.B.shape[1])
        if not np.all((R > 0.0) & (R < np.inf)):
            raise BadInput("lqr: effort must be positive and finite, one number or one for each input")
        kept = [
            k
            for k, name in enumerate(self.names)
            if name not in without or np.abs(self.A[:, k]).max() > REACHED
        ]
        T = np.zeros_like(self.A)[:, : len(kept)]
        T[kept] = np.eye(len(kept))
        T = T @ reached_and_lost(self.A[np.ix_(kept, kept)], self.B[kept])[0]
        Q = T.T @ np.diag([weights.get(name, 0.0) for name in self.names]) @ T
        A, B = T.T @ self.A @ T, T.T @ self.B
        from scipy.linalg import solve_continuous_are  # slow to import

        try:
            X = solve_continuous_are(A, B, Q, np.diag(R))
        except (np.linalg.LinAlgError, ValueError) as error:
            raise BadInput(
                f"lqr: no gains: weigh further states, so that every mode is seen ({error})"
            ) from error
        K = np.diag(1.0 / R) @ B.T @ X
        if not np.all(np.linalg.eigvals(A - B @ K).real < -STILL):
            raise BadInput("lqr: no gains: weigh further states, so that every mode is seen")
        return tidy(K @ T.T), T @ X @ T.T

    def check_names(self, names: Iterable[str]) -> None:
        """Raise BadInput for a name that is not that of a state."""
        for name in names:
            check_named(name, self.names, "lqr: unknown state")

    def without(self, K: np.ndarray, *names: str) -> np.ndarray:
        """Return gains, r x (2n-m), that do the same to what the inputs reach and do not use these states,
        such as the angles of wheels where the position is known. Raises BadInput for an unknown name, and if
        no others tell as much.
        """
        self.check_names(names)
        kept = [k for k, name in enumerate(self.names) if name not in names]
        own, gains = K @ self.reached, np.zeros_like(K)
        gains[:, kept] = own @ np.linalg.pinv(self.reached[kept])
        if not np.abs(gains @ self.reached - own).max() <= RESTS * np.abs(own).max():
            raise BadInput(
                f"lqr: without {', '.join(names)} the other states do not tell enough: leave one of them in"
            )
        return tidy(gains)


def analyse_at_rest(
    robot: Mechanism, q: Sequence[float] | None = None, parameters: Sequence[float] | None = None
) -> Steady:
    """Return the robot at rest at q (all zero by default), m or rad, with parameters (its defaults), SI.

    Raises ModelError if it is not underactuated, or cannot rest there.
    """
    partial = _partial(robot, "no state with nu = 0 is at rest")
    place = [0.0] * len(robot.coordinates) if q is None else [float(each) for each in q]
    p = _parameters(robot, parameters)
    tau, left = at_rest(partial.system, place, p)
    refuse_undefined(robot, np.array([*tau, left]))
    if not left <= RESTS:
        where = "q = 0" if q is None else f"q = {place}"
        raise ModelError(f"{robot.name}: no inputs hold it at rest at {where}: a force of {left:.3g} is left")
    return _linearized(partial, np.array([*place, *[0.0] * partial.system.dof]), np.array(tau), p)


def analyse_steady(
    robot: Mechanism, motion: Mapping[str, float], parameters: Sequence[float] | None = None
) -> Steady:
    """Return the robot in the steady motion in which these quasi-velocities and coordinates have these
    values, SI; the others are found by Newton's method from 0, as near to 0 as possible; with parameters (its
    defaults), SI. Without any it is at rest.

    Raises BadInput for unknown names, and for coordinates that go on in every motion; ModelError if the robot
    is not underactuated and if no such motion is found.
    """
    if not motion:
        return analyse_at_rest(robot, None, parameters)
    partial = _partial(robot, "its steady motions depend on the place")
    p, system, n = _parameters(robot, parameters), partial.system, len(robot.coordinates)
    x, tau, rate = _equations(partial)
    constant = _constant(partial, p)
    names = [quantity.name for quantity in system.state]
    allowed = [*(names[k] for k in constant), *names[n:]]
    for name in motion:
        if name not in allowed:
            raise BadInput(
                f"{robot.name}: motion: {name!r} does not tell a steady motion; {', '.join(allowed)} do"
            )
    unknown = [k for k in [*constant, *range(n, len(names))] if names[k] not in motion]
    residual = ca.vertcat(*[rate[k] for k in constant], rate[n:])
    free = ca.vertcat(*[x[k] for k in unknown], tau)
    function = ca.Function("steady", [x, tau, robot.p], [residual, ca.jacobian(residual, free)])
    state = np.array([float(motion.get(name, 0.0)) for name in names])
    given = np.zeros(len(robot.inputs))
    for _ in range(NEWTON):
        left, slope = (each.full() for each in function(state, given, p))
        refuse_undefined(robot, left, slope)
        if np.abs(left).max() <= RESTS:
            return _linearized(partial, state, given, p)
        step = np.linalg.lstsq(slope, -left.ravel(), rcond=REACHED)[0]
        state[unknown] += step[: len(unknown)]
        given += step[len(unknown) :]
    told = ", ".join(f"{name} = {value:g}" for name, value in motion.items())
    raise ModelError(
        f"{robot.name}: no steady motion with {told} was found: a rate of {np.abs(left).max():.3g} is left"
    )


def _partial(robot: Mechanism, why: str) -> PartialLinearization:
    if robot.why_carried:
        raise ModelError(f"{robot.name}: {robot.why_carried}; {why}")
    return partial_linearization(robot)


def _parameters(robot: Mechanism, parameters: Sequence[float] | None) -> list[float]:
    return robot.parameter_values({}) if parameters is None else [float(each) for each in parameters]


def _equations(partial: PartialLinearization) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return the state [q; nu], the inputs and the rate of the state."""
    system = partial.system
    tau = ca.SX.sym("tau", len(system.mechanism.inputs))
    return ca.vertcat(system.mechanism.q, system.nu), tau, ca.vertcat(system.qdot, system.acceleration(tau))


def _constant(partial: PartialLinearization, p: Sequence[float]) -> list[int]:
    """Return the coordinates that a steady motion must hold: those on which the rates depend, seen from the
    vehicle; found at random states.
    """
    system, random = partial.system, np.random.default_rng(0)
    n, point = len(system.mechanism.coordinates), point_on_body(system)
    pose = list(point.pose) if point else []
    x, u, expression = _equations(partial)
    numbers = ca.substitute(expression, system.mechanism.p, ca.DM(p))
    rate = ca.Function("rate", [x, u], [numbers, ca.jacobian(numbers, system.mechanism.q)])
    depends = np.zeros(n, bool)
    for _ in range(SAMPLES):
        state, tau = random.uniform(-1.0, 1.0, n + system.dof), random.uniform(-1.0, 1.0, u.numel())
        if pose:
            along, aside, heading = pose
            elsewhere, state[pose] = state.copy(), 0.0
            here, there = (rate(each, tau)[0].full().ravel() for each in (state, elsewhere))
            s, c = np.sin(elsewhere[heading]), np.cos(elsewhere[heading])
            there[[along, aside]] = c * there[along] + s * there[aside], c * there[aside] - s * there[along]
            depends[pose] |= not np.abs(there - here).max() <= RESTS * max(1.0, np.abs(here).max())
        found = np.abs(rate(state, tau)[1].full()).max(axis=0)
        depends |= (found > RESTS) & ~np.isin(np.arange(n), pose)
    return [int(k) for k in np.flatnonzero(depends)]


def _linearized(partial: PartialLinearization, state: np.ndarray, tau: np.ndarray, p: list[float]) -> Steady:
    """Return the robot linearized about a motion, in axes that turn with it."""
    system, robot = partial.system, partial.system.mechanism
    x, u, rate = _equations(partial)
    linear = ca.Function("linear", [x, u, robot.p], [ca.jacobian(rate, x), ca.jacobian(rate, u), system.qdot])
    A, B, rates = (each.full() for each in linear(state, tau, p))
    refuse_undefined(robot, A, B, rates)
    if point := point_on_body(system):
        along, aside, heading = point.pose
        A[along, aside] += rates[heading, 0]
        A[aside, along] -= rates[heading, 0]
    reached, lost = reached_and_lost(A, B)
    n = len(robot.coordinates)
    q, nu, qdot = (tuple(map(float, each)) for each in map(tidy, (state[:n], state[n:], rates.ravel())))
    of = modes(reached.T @ A @ reached), modes(lost.T @ A @ lost)
    constant = tuple(_constant(partial, p))
    return Steady(
        partial, q, nu, qdot, tuple(p), tuple(map(float, tidy(tau))), constant, A, B, reached, lost, *of
    )


def tidy(numbers: np.ndarray) -> np.ndarray:
    """Return numbers with DIGITS digits, and 0 for those that are rounding errors:
    the same ones on every processor."""
    exact = np.where(np.abs(numbers) > 10.0**-DIGITS * np.abs(numbers).max(initial=0.0), numbers, 0.0)
    return np.array([float(f"{number:.{DIGITS}g}") for number in exact.ravel()]).reshape(numbers.shape)


def refuse_undefined(robot: Mechanism, *arrays: np.ndarray) -> None:
    """Raise ModelError if a number is not finite: the quasi-velocities, given or chosen automatically,
    are not defined there."""
    if not all(np.isfinite(array).all() for array in arrays):
        raise ModelError(
            f"{robot.name}: its equations are not defined there: give it quasi-velocities that are regular "
            "at rest"
        )


def reached_and_lost(A: np.ndarray, B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return orthonormal bases of the controllable subspace and of its complement, found in steps:
    no high powers of A."""
    basis, new = np.zeros((len(A), 0)), B
    while new.size:
        new = new - basis @ (basis.T @ new)
        new = new - basis @ (basis.T @ new)
        left, sizes, _ = np.linalg.svd(new, full_matrices=False)
        new = left[:, sizes > REACHED * max(1.0, np.abs(A).max(), np.abs(B).max())]
        basis = np.hstack([basis, new])
        new = A @ new
    return basis, np.linalg.svd(basis, full_matrices=True)[0][:, basis.shape[1] :]


def modes(matrix: np.ndarray) -> np.ndarray:
    """Return the eigenvalues, the fastest growing first."""
    found = np.linalg.eigvals(matrix).astype(complex)
    return found[np.lexsort((found.imag, -found.real))]


def listed(found: np.ndarray) -> str:
    """Return modes as text, equal ones counted; those that rounding cannot tell from 0 as 0."""
    texts: dict[str, int] = {}
    for mode in found:
        real, imaginary = (0.0 if abs(part) <= STILL else part for part in (mode.real, mode.imag))
        text = f"{real:.4g}{imaginary:+.4g}i" if imaginary else f"{real:.4g}"
        texts[text] = texts.get(text, 0) + 1
    return (
        ", ".join(f"{text} ({count} times)" if count > 1 else text for text, count in texts.items()) or "none"
    )
