"""Underactuated robots at rest: what inputs do at an equilibrium, the zero dynamics of their collocated linearization, LQR.

By numbers, at given parameters and a configuration where the robot can rest. A mode of the linearized robot that no input moves
is found as a part of the state space orthogonal to all that the inputs reach (R. E. Kalman, Mathematical description of linear
dynamical systems, 1963). One that grows cannot be stabilized. One at 0 is left by every linear feedback: it may be an integral of
the motion, or a place that only manoeuvres reach, because rolling is nonholonomic.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import casadi as ca
import numpy as np
from scipy.linalg import solve_continuous_are
from scipy.special import betaincinv

from ..controllers.controller import RUNNING
from ..model.algebra.trigonometry import sine_cosine
from ..model.errors import ModelError
from ..model.mechanism import Mechanism, Quantity
from ..model.reduction import counted
from ..model.underactuated import PartialLinearization, at_rest, partial_linearization
from ..readers.errors import BadInput
from ..simulation.plant import Plant

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RESTS = 1e-9  # N or N m, of forces that inputs leave at an equilibrium
REACHED = 1e-9  # relative: singular values at or below this count as zero
STILL = 1e-4  # 1/s: real parts at or below this in size count as zero: rounding moves a double 0 by its root
DIGITS = 10  # of gains
PERIOD, TOLERANCE = 0.01, 1e-9  # s, of the calls of a feedback; of the integration between them
FALLEN = np.pi / 2  # rad or m: a deviation of a weighed state beyond this ends a run


@dataclass(frozen=True, eq=False)
class AtRest:
    """The robot linearized at rest, dx/dt = A x + B tau with x = [q; nu] and tau from their values there.

    `reached` are orthonormal columns that span what the inputs reach. `modes` of these, `unreached` of the rest and `zero` of
    the zero dynamics with the velocities at the inputs held at zero: 1/s.
    """

    partial: PartialLinearization = field(repr=False)
    q: tuple[float, ...]
    parameters: tuple[float, ...]
    tau: tuple[float, ...]
    A: np.ndarray
    B: np.ndarray
    reached: np.ndarray
    modes: np.ndarray
    unreached: np.ndarray
    zero: np.ndarray

    @property
    def names(self) -> list[str]:
        """Of the states."""
        return [quantity.name for quantity in self.partial.system.state]

    @property
    def stabilizable(self) -> bool:
        """Whether linear feedback leaves no mode that grows."""
        return bool(np.all(self.unreached.real <= STILL))

    @property
    def left(self) -> int:
        """How many modes at 0 no input moves."""
        return int(np.sum(np.abs(self.unreached.real) <= STILL))

    def lines(self) -> list[str]:
        """Return the verdicts as text."""
        system = self.partial.system
        inputs = ", ".join(each.name for each in system.mechanism.inputs)
        growing = [mode for mode in self.modes if mode.real > STILL]
        zero = [mode for mode in self.zero if mode.real > STILL]
        lines = [
            f"{counted(len(system.mechanism.inputs), 'input')} ({inputs}) for {counted(system.dof, 'degree')} of freedom; "
            "at rest at q = 0, "
            "by numbers, at the default parameters",
            f"modes that the inputs move: {_listed(self.modes)} 1/s"
            + (f"; {counted(len(growing), 'mode')} of these grow{'s' * (len(growing) == 1)}" if growing else ""),
            f"zero dynamics with the velocities at the inputs held at 0 (collocated): {_listed(self.zero)} 1/s, "
            + ("unstable: holding these velocities alone makes the robot fall" if zero else "none of them grows"),
        ]
        if not self.stabilizable:
            lines.append(f"not stabilizable: no input moves the modes {_listed(self.unreached)} 1/s, and one of them grows")
        elif self.left:
            lines.append(
                f"{'all that grows can be stabilized' if growing else 'nothing grows'}, but not asymptotically stabilizable by "
                f"linear feedback: no input moves {counted(self.left, 'mode')} at 0: integrals of the motion, or places that "
                "only manoeuvres reach"
            )
        else:
            lines.append("asymptotically stabilizable by linear feedback")
        return lines

    def lqr(self, weights: Mapping[str, float], effort: float | Sequence[float] = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """Return K, r x (2n-m), of tau = tau_e - K (x - x_e), which minimizes the integral of sum(weight_i x_i^2) and
        sum(effort_j tau_j^2) over what the inputs reach, and X, (2n-m) x (2n-m): the least cost from x is (x - x_e)' X (x - x_e).

        `weights` by the name of a state; those not named have 0. Raises BadInput for an unknown name, a weight that is negative
        or an effort that is not positive, and for weights that leave a mode that grows or rests unseen.
        """
        self.check_names(weights)
        for name, weight in weights.items():
            if not 0.0 <= weight < np.inf:
                raise BadInput(f"lqr: the weight of {name} is {weight}; it must be finite and not negative")
        R = np.atleast_1d(np.asarray(effort, float)) * np.ones(self.B.shape[1])
        if not np.all((R > 0.0) & (R < np.inf)):
            raise BadInput("lqr: effort must be positive and finite, one number or one for each input")
        T = self.reached
        Q = T.T @ np.diag([weights.get(name, 0.0) for name in self.names]) @ T
        A, B = T.T @ self.A @ T, T.T @ self.B
        try:
            X = solve_continuous_are(A, B, Q, np.diag(R))
        except (np.linalg.LinAlgError, ValueError) as error:
            raise BadInput(f"lqr: no gains: weigh further states, so that every mode is seen ({error})") from error
        K = np.diag(1.0 / R) @ B.T @ X
        if not np.all(np.linalg.eigvals(A - B @ K).real < -STILL):
            raise BadInput("lqr: no gains: weigh further states, so that every mode is seen")
        return _tidy(K @ T.T), T @ X @ T.T

    def check_names(self, names: Iterable[str]) -> None:
        """Raise BadInput for a name that is not that of a state."""
        if unknown := [name for name in names if name not in self.names]:
            raise BadInput(f"lqr: unknown state {unknown[0]!r}; states are {', '.join(self.names)}")

    def without(self, K: np.ndarray, *names: str) -> np.ndarray:
        """Return gains, r x (2n-m), that do the same to what the inputs reach and do not use these states, such as the angles of
        wheels where the position is known. Raises BadInput for an unknown name, and if no others tell as much.
        """
        self.check_names(names)
        kept = [k for k, name in enumerate(self.names) if name not in names]
        own, gains = K @ self.reached, np.zeros_like(K)
        gains[:, kept] = own @ np.linalg.pinv(self.reached[kept])
        if not np.abs(gains @ self.reached - own).max() <= RESTS * np.abs(own).max():
            raise BadInput(f"lqr: without {', '.join(names)} the other states do not tell enough: leave one of them in")
        return _tidy(gains)


class Feedback(Protocol):
    """What gives inputs (N or N m) at a state, of which another is desired, with a status."""

    def step(self, state: np.ndarray, desired: np.ndarray) -> tuple[str, np.ndarray]:
        """Return status and inputs; zeros with an error."""


@dataclass(frozen=True, eq=False)
class Balanced:
    """The rigid robot with tau = tau_e - K (x - x_d), called every PERIOD and held between; at most `limit` (N or N m) each.

    A position in the plane is compared in axes along the desired heading, and headings by their smallest difference. `feedback`
    gives the inputs instead of this one: the same in C.
    """

    rest: AtRest
    K: np.ndarray
    limit: float = np.inf
    feedback: Feedback | None = None

    @property
    def name(self) -> str:
        """Of the robot."""
        return self.rest.partial.system.mechanism.name

    @property
    def limits(self) -> np.ndarray:
        """Of each input; 0: none."""
        return np.full(len(self.K), self.limit if np.isfinite(self.limit) else 0.0)

    @cached_property
    def fallen(self) -> np.ndarray:
        """Deviation of each state beyond which the robot has fallen: FALLEN of coordinates that K weighs; 0: any."""
        coordinates = np.arange(self.K.shape[1]) < len(self.rest.q)
        return np.where(coordinates & (np.abs(self.K).max(axis=0) > 0.0), FALLEN, 0.0)

    @cached_property
    def place(self) -> tuple[int, int, int] | None:
        """The numbers of the states that are the vehicle's position and heading; None if they are no coordinates, or the
        robot rests at another heading than 0.
        """
        pose = self.rest.partial.system.mechanism.pose_numbers
        return (pose[0], pose[1], pose[2]) if pose and self.rest.q[pose[2]] == 0.0 else None

    @cached_property
    def seen(self) -> np.ndarray:
        """Orthonormal columns that span what K sees of the linearized robot: what it does not see is not brought back."""
        return _reached(self.rest.A.T, self.K.T)[0]

    def step(self, state: np.ndarray, desired: np.ndarray) -> tuple[str, np.ndarray]:
        """See Feedback; "astray" where it has fallen."""
        if self.feedback:
            return self.feedback.step(state, desired)
        off = state - desired
        if self.place:
            x, y, heading = self.place
            s, c = sine_cosine(float(desired[heading]))
            off[[x, y]] = c * off[x] + s * off[y], c * off[y] - s * off[x]
            off[heading] -= 2 * np.pi * np.round(off[heading] / (2 * np.pi))
        if ((self.fallen > 0.0) & ~(np.abs(off) <= self.fallen)).any():
            return "astray", np.zeros(len(self.K))
        tau = np.asarray(self.rest.tau) - np.sum(self.K * off, axis=1)
        limited = np.clip(tau, -self.limit, self.limit)
        return ("ok" if (limited == tau).all() else "saturated"), limited

    def run(self, start: np.ndarray, duration: float, desired: Callable[[float], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Return states at the calls, (N, 2n-m), and inputs from there on, (N, r), from `start`; `desired` is x_d(t).

        Ends early where the robot has fallen: a state that K weighs is more than FALLEN off, or one is not finite.
        """
        plant, x = Plant(self.rest.partial.system, self.rest.parameters), np.asarray(start, float)
        states, inputs = [], []
        for k in range(round(duration / PERIOD) + 1):
            status, tau = self.step(x, desired(k * PERIOD))
            states.append(x)
            inputs.append(tau)
            if status not in RUNNING:
                break
            x = plant.step(x, tau, PERIOD, TOLERANCE)[0]
        return np.array(states), np.array(inputs)

    def returns(self, start: np.ndarray, duration: float, within: float) -> bool:
        """Return whether what K sees of the state and its rates is back at rest after `duration`, s, to `within` of its start."""
        T, rest = self.seen, np.array([*self.rest.q, *[0.0] * self.rest.partial.system.dof])
        states, _ = self.run(start, duration, lambda t: rest)
        complete = len(states) == round(duration / PERIOD) + 1
        return complete and bool(np.abs(T.T @ (states[-1] - rest)).max() <= within * max(1.0, np.abs(start - rest).max()))


@dataclass(frozen=True, eq=False)
class Region:
    """A region of attraction by sampling, no proof: the `starts` (N, 2n-m), whether each `returned`, and the cost of each.

    `level` is the least cost of one that did not return: all `inside` samples with a smaller one returned. X, (2n-m) x (2n-m),
    is the form of the cost about the state `rest` (2n-m).
    """

    starts: np.ndarray
    returned: np.ndarray
    cost: np.ndarray
    X: np.ndarray
    rest: np.ndarray

    @property
    def level(self) -> float:
        """Infinite if all returned."""
        return float(self.cost[~self.returned].min(initial=np.inf))

    @property
    def inside(self) -> int:
        """How many samples have a smaller cost than `level`."""
        return int(np.sum(self.cost < self.level))

    def boundary(self, first: int, second: int) -> np.ndarray:
        """Return where two states, by their numbers, have the cost `level` with all others at rest, (N, 2)."""
        of = [first, second]
        root = np.linalg.cholesky(self.X[np.ix_(of, of)])
        angle = np.linspace(0.0, 2 * np.pi, 200)
        circle = np.sqrt(self.level) * np.array([np.cos(angle), np.sin(angle)])
        return self.rest[of] + np.linalg.solve(root.T, circle).T

    def draw(self, quantities: Sequence[Quantity], first: int, second: int) -> "Figure":
        """Return a picture of the starts in the plane of two states; `quantities` are all states."""
        from matplotlib.figure import Figure  # slow to import

        figure = Figure(figsize=(7.5, 5.5), layout="constrained")
        axes = figure.add_subplot()
        for returned, colour, marker, name in ((True, "#0b61a4", "o", "returned"), (False, "#c2570c", "x", "did not return")):
            chosen = self.starts[self.returned == returned]
            axes.plot(chosen[:, first], chosen[:, second], marker, color=colour, markersize=4, linestyle="", label=name)
        if np.isfinite(self.level):
            axes.plot(
                *self.boundary(first, second).T, color="black", label=f"level {self.level:.3g}: all samples inside returned"
            )
        for label, number in ((axes.set_xlabel, first), (axes.set_ylabel, second)):
            label(f"{quantities[number].name} ({quantities[number].unit})")
        figure.legend(loc="outside lower center", ncols=3)
        return figure


def region(balanced: Balanced, X: np.ndarray, sizes: Mapping[str, float], count: int, duration: float, seed: int = 0) -> Region:
    """Return the region from `count` runs of `duration` (s), from random starts with the states named up to `sizes` off rest."""
    rest = balanced.rest
    if unknown := [name for name in sizes if name not in rest.names]:
        raise BadInput(f"region: unknown state {unknown[0]!r}; states are {', '.join(rest.names)}")
    wide = np.array([sizes.get(name, 0.0) for name in rest.names])
    off = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, len(wide))) * wide
    middle = np.array([*rest.q, *[0.0] * rest.partial.system.dof])
    returned = np.array([balanced.returns(middle + each, duration, 1e-3) for each in off], bool)
    return Region(middle + off, returned, np.sum((off @ X) * off, axis=1), X, middle)


@dataclass(frozen=True)
class Confirmed:
    """How many of `count` starts, drawn uniformly where the cost is at most `level`, returned; certified by sampling.

    The starts were drawn after the level was chosen, so that what they say of all starts there is exact statistics.
    """

    level: float
    count: int
    returned: int

    def share(self, confidence: float = 0.99) -> float:
        """Return a lower bound, with this confidence, of the share of all these starts that return (C. J. Clopper and
        E. S. Pearson, 1934): with all of N returned, the N-th root of 1 - confidence. Raises BadInput unless 0 < confidence < 1.
        """
        if not 0.0 < confidence < 1.0:
            raise BadInput(f"confidence = {confidence:g} must be between 0 and 1")
        fell = self.count - self.returned
        return float(betaincinv(self.returned, fell + 1, 1.0 - confidence)) if self.returned else 0.0


def confirm(balanced: Balanced, X: np.ndarray, level: float, count: int, duration: float, seed: int = 1) -> Confirmed:
    """Run `count` starts for `duration` s, drawn uniformly from all that the inputs reach with a cost of at most `level`: called
    every PERIOD, with limits, by the C if that is the feedback. Use another seed than that of the `region` that gave the level.

    Raises BadInput for a level that is not positive and finite, and for fewer than one start.
    """
    if not 0.0 < level < np.inf:
        raise BadInput(f"confirm: the level is {level:g}; it must be positive and finite")
    if count < 1:
        raise BadInput(f"confirm: {count} starts; at least one is needed")
    rest, random = balanced.rest, np.random.default_rng(seed)
    T = rest.reached
    root = np.linalg.cholesky(T.T @ X @ T)
    ball = random.normal(size=(count, T.shape[1]))
    ball *= (random.uniform(size=count) ** (1 / T.shape[1]) / np.linalg.norm(ball, axis=1))[:, None]
    starts = np.array([*rest.q, *[0.0] * rest.partial.system.dof]) + np.sqrt(level) * np.linalg.solve(root.T, ball.T).T @ T.T
    return Confirmed(level, count, sum(balanced.returns(start, duration, 1e-3) for start in starts))


def analyse_at_rest(robot: Mechanism, q: Sequence[float] | None = None, parameters: Sequence[float] | None = None) -> AtRest:
    """Return the robot at rest at q (all zero by default), m or rad, with parameters (its defaults), SI.

    Raises ModelError if it is not underactuated, or cannot rest there.
    """
    if robot.why_carried:
        raise ModelError(f"{robot.name}: {robot.why_carried}; no state with nu = 0 is at rest")
    partial = partial_linearization(robot)
    system = partial.system
    place = [0.0] * len(robot.coordinates) if q is None else [float(each) for each in q]
    p = robot.parameter_values({}) if parameters is None else [float(each) for each in parameters]
    tau, left = at_rest(system, place, p)
    _refuse_undefined(robot, np.array([*tau, left]))
    if not left <= RESTS:
        where = "q = 0" if q is None else f"q = {place}"
        raise ModelError(f"{robot.name}: no inputs hold it at rest at {where}: a force of {left:.3g} is left")
    x = ca.vertcat(robot.q, system.nu)
    u = ca.SX.sym("tau", len(tau))
    rate = ca.vertcat(system.qdot, system.acceleration(u))
    linear = ca.Function("linear", [x, u, robot.p], [ca.jacobian(rate, x), ca.jacobian(rate, u)])
    A, B = (each.full() for each in linear([*place, *[0.0] * system.dof], tau, p))
    _refuse_undefined(robot, A, B)
    reached, rest = _reached(A, B)
    eta = ca.SX.sym("eta", len(partial.passive))
    moved = ca.vertcat(robot.q, eta)
    slope = ca.Function("zero", [moved, robot.p], [ca.jacobian(ca.vertcat(*partial.zero_dynamics(eta)), moved)])
    zero = slope([*place, *[0.0] * eta.numel()], p).full()
    _refuse_undefined(robot, zero)
    return AtRest(
        partial,
        tuple(place),
        tuple(p),
        tuple(tau),
        A,
        B,
        reached,
        _modes(reached.T @ A @ reached),
        _modes(rest.T @ A @ rest),
        _modes(zero),
    )


def _tidy(gains: np.ndarray) -> np.ndarray:
    """Return gains with DIGITS digits, and 0 for those that are rounding errors: the same ones on every processor."""
    exact = np.where(np.abs(gains) > 10.0**-DIGITS * np.abs(gains).max(), gains, 0.0)
    return np.array([[float(f"{gain:.{DIGITS}g}") for gain in row] for row in exact])


def _refuse_undefined(robot: Mechanism, *arrays: np.ndarray) -> None:
    """Raise ModelError if a number is not finite: the quasi-velocities, given or chosen automatically, are not defined there."""
    if not all(np.isfinite(array).all() for array in arrays):
        raise ModelError(f"{robot.name}: its equations are not defined there: give it quasi-velocities that are regular at rest")


def _reached(A: np.ndarray, B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return orthonormal bases of the controllable subspace and of its complement, found in steps: no high powers of A."""
    basis, new = np.zeros((len(A), 0)), B
    while new.size:
        new = new - basis @ (basis.T @ new)
        new = new - basis @ (basis.T @ new)
        left, sizes, _ = np.linalg.svd(new, full_matrices=False)
        new = left[:, sizes > REACHED * max(1.0, np.abs(A).max(), np.abs(B).max())]
        basis = np.hstack([basis, new])
        new = A @ new
    return basis, np.linalg.svd(basis, full_matrices=True)[0][:, basis.shape[1] :]


def _modes(matrix: np.ndarray) -> np.ndarray:
    """Return the eigenvalues, the fastest growing first."""
    modes = np.linalg.eigvals(matrix).astype(complex)
    return modes[np.lexsort((modes.imag, -modes.real))]


def _listed(modes: np.ndarray) -> str:
    """Return modes as text, equal ones counted; those that rounding cannot tell from 0 as 0."""
    texts: dict[str, int] = {}
    for mode in modes:
        real, imaginary = (0.0 if abs(part) <= 1e-4 else part for part in (mode.real, mode.imag))
        text = f"{real:.4g}{imaginary:+.4g}i" if imaginary else f"{real:.4g}"
        texts[text] = texts.get(text, 0) + 1
    return ", ".join(f"{text} ({count} times)" if count > 1 else text for text, count in texts.items()) or "none"
