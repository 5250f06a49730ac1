"""Underactuated robots: what can be said of them at rest, and how a state feedback holds the nonlinear rigid
robot."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import betaincinv

from ..model.mechanism import Quantity
from ..model.reduction import counted
from ..readers.errors import check_named
from ..readers.reading import number, whole
from ..simulation.controllers.balance.feedback import Balanced
from ..simulation.controllers.balance.steady import STILL, Steady, listed
from ..simulation.controllers.balance.zero_dynamics import of_velocities
from ..simulation.controllers.controller import RUNNING
from ..simulation.plant import Plant

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PERIOD, TOLERANCE = 0.01, 1e-9  # s, of the calls of a feedback; of the integration between them


def verdicts(rest: Steady) -> list[str]:
    """Return what can be said of a robot at rest, as text."""
    system = rest.partial.system
    inputs = ", ".join(each.name for each in system.mechanism.inputs)
    growing = [mode for mode in rest.modes if mode.real > STILL]
    zero = of_velocities(rest)
    return [
        f"{counted(len(system.mechanism.inputs), 'input')} ({inputs}) for {counted(system.dof, 'degree')} of "
        "freedom; at rest at q = 0, by numbers, at the default parameters",
        f"modes that the inputs move: {listed(rest.modes)} 1/s"
        + (f"; {counted(len(growing), 'mode')} of these grow{'s' * (len(growing) == 1)}" if growing else ""),
        f"zero dynamics with the velocities at the inputs held at 0 (collocated): {zero}"
        + (": holding these velocities alone makes the robot fall" if zero.unstable else ""),
        f"noncollocated, with these velocities held at 0 instead: {'; '.join(_noncollocated(rest))}",
        rest.verdict,
    ]


def _noncollocated(rest: Steady) -> list[str]:
    """Return for each choice of as many quasi-velocities as inputs the zero dynamics,
    or why these cannot be linearized."""
    system = rest.partial.system
    found = []
    for chosen in itertools.combinations(range(system.dof), len(system.driven)):
        names = ", ".join(system.quasi_velocities[k].name for k in chosen)
        found.append(f"{names}: {of_velocities(rest, chosen)}")
    return found


def run(
    balanced: Balanced, start: np.ndarray, duration: float, desired: Callable[[float], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return states of the rigid robot at the calls of a feedback, every PERIOD, (N, 2n-m), and inputs from
    there on, (N, r), from `start`; `desired` is x_d(t). Ends early where the feedback returns an error, such
    as where the robot has fallen.
    """
    steady = balanced.steady
    plant, x = Plant(steady.partial.system, steady.parameters), np.asarray(start, float)
    states, inputs = [], []
    for k in range(round(duration / PERIOD) + 1):
        status, tau = balanced.step(x, desired(k * PERIOD))
        states.append(x)
        inputs.append(tau)
        if status not in RUNNING:
            break
        x = plant.step(x, tau, PERIOD, TOLERANCE)[0]
    return np.array(states), np.array(inputs)


def returns(balanced: Balanced, start: np.ndarray, duration: float, within: float) -> bool:
    """Return whether what K sees of the state and its rates is back at rest after `duration`, s,
    to `within` of its start."""
    T, rest = balanced.seen, balanced.steady.state
    states, _ = run(balanced, start, duration, lambda t: rest)
    complete = len(states) == round(duration / PERIOD) + 1
    return complete and bool(
        np.abs(T.T @ (states[-1] - rest)).max() <= within * max(1.0, np.abs(start - rest).max())
    )


@dataclass(frozen=True, eq=False)
class Region:
    """A region of attraction by sampling, no proof: the `starts` (N, 2n-m), whether each `returned`, and the
    cost of each.

    `level` is the least cost of one that did not return: all `inside` samples with a smaller one returned. X,
    (2n-m) x (2n-m), is the form of the cost about the state `rest` (2n-m).
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
        """Return where two states, by their numbers, have the cost `level` with all others at rest,
        (N, 2)."""
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
        for returned, colour, marker, name in (
            (True, "#0b61a4", "o", "returned"),
            (False, "#c2570c", "x", "did not return"),
        ):
            chosen = self.starts[self.returned == returned]
            axes.plot(
                chosen[:, first],
                chosen[:, second],
                marker,
                color=colour,
                markersize=4,
                linestyle="",
                label=name,
            )
        if np.isfinite(self.level):
            axes.plot(
                *self.boundary(first, second).T,
                color="black",
                label=f"level {self.level:.3g}: all samples inside returned",
            )
        for label, place in ((axes.set_xlabel, first), (axes.set_ylabel, second)):
            label(f"{quantities[place].name} ({quantities[place].unit})")
        figure.legend(loc="outside lower center", ncols=3)
        return figure


def region(
    balanced: Balanced, X: np.ndarray, sizes: Mapping[str, float], count: int, duration: float, seed: int = 0
) -> Region:
    """Return the region from `count` runs of `duration` (s),
    from random starts with the states named up to `sizes` off rest."""
    rest = balanced.steady
    for name in sizes:
        check_named(name, rest.names, "region: unknown state")
    wide = np.array([sizes.get(name, 0.0) for name in rest.names])
    off = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, len(wide))) * wide
    middle = rest.state
    returned = np.array([returns(balanced, middle + each, duration, 1e-3) for each in off], bool)
    return Region(middle + off, returned, np.sum((off @ X) * off, axis=1), X, middle)


@dataclass(frozen=True)
class Confirmed:
    """How many of `count` starts, drawn uniformly where the cost is at most `level`, returned; certified by
    sampling.

    The starts were drawn after the level was chosen, so that what they say of all starts there is exact
    statistics.
    """

    level: float
    count: int
    returned: int

    def share(self, confidence: float = 0.99) -> float:
        """Return a lower bound, with this confidence, of the share of all these starts that return (C. J.
        Clopper and E. S. Pearson, 1934): with all of N returned, the N-th root of 1 - confidence. Raises
        BadInput unless 0 < confidence < 1.
        """
        number("positive", below=1.0)(confidence, "confidence")
        fell = self.count - self.returned
        return float(betaincinv(self.returned, fell + 1, 1.0 - confidence)) if self.returned else 0.0


def confirm(
    balanced: Balanced, X: np.ndarray, level: float, count: int, duration: float, seed: int = 1
) -> Confirmed:
    """Run `count` starts for `duration` s, drawn uniformly from all that the inputs reach with a cost of at
    most `level`: called every PERIOD, with limits, by the C if that is the feedback. Use another seed than
    that of the `region` that gave the level.

    Raises BadInput for a level that is not positive and finite, and for fewer than one start.
    """
    number("positive")(level, "confirm: level")
    whole(1)(count, "confirm: starts")
    rest, random = balanced.steady, np.random.default_rng(seed)
    T = rest.reached
    root = np.linalg.cholesky(T.T @ X @ T)
    ball = random.normal(size=(count, T.shape[1]))
    ball *= (random.uniform(size=count) ** (1 / T.shape[1]) / np.linalg.norm(ball, axis=1))[:, None]
    starts = rest.state + np.sqrt(level) * np.linalg.solve(root.T, ball.T).T @ T.T
    return Confirmed(level, count, sum(returns(balanced, start, duration, 1e-3) for start in starts))
