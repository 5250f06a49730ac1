"""State feedback about a steady motion: tau = tau_e - K (x - x_d), with limits, for every heading;
and as a control law."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import casadi as ca
import numpy as np

from ....model.algebra.direct import Direct
from ....model.algebra.portable import portable
from ....model.law import ControlLaw, Feedbacks, symbols
from ....model.linearization import Linearization
from ....model.mechanism import quantity
from ....model.outputs import OutputMap, OutputRow
from ....readers.errors import BadInput
from ..controller import Evaluation, Numbers
from .steady import Steady, reached_and_lost

FALLEN = np.pi / 2  # rad or m: a deviation of a weighed coordinate beyond this is a fall
NAME = "lqr"  # of the law


class Feedback(Protocol):
    """What gives inputs (N or N m) at a state, of which another is desired, with a status."""

    def step(self, state: np.ndarray, desired: np.ndarray) -> tuple[str, np.ndarray]:
        """Return status and inputs; zeros with an error."""


@dataclass(frozen=True, eq=False)
class Balanced:
    """The feedback tau = tau_e - K (x - x_d), limited to `limit` (N or N m), one for all inputs or one each;
    0 or inf: none.

    A position in the plane is compared in axes along the desired heading, and headings by their smallest
    difference. `feedback` gives the inputs instead of this one: the same in C.
    """

    steady: Steady
    K: np.ndarray
    limit: float | Sequence[float] = np.inf
    feedback: Feedback | None = None

    @property
    def name(self) -> str:
        """Of the robot."""
        return self.steady.partial.system.mechanism.name

    @cached_property
    def limits(self) -> np.ndarray:
        """Of each input; 0: none."""
        given = np.broadcast_to(np.asarray(self.limit, float), (len(self.K),))
        return np.where(np.isfinite(given), given, 0.0)

    @cached_property
    def fallen(self) -> np.ndarray:
        """Deviation of each state beyond which the robot has fallen: FALLEN of coordinates that K weighs;
        0: any."""
        coordinates = np.arange(self.K.shape[1]) < len(self.steady.q)
        return np.where(coordinates & (np.abs(self.K).max(axis=0) > 0.0), FALLEN, 0.0)

    @cached_property
    def seen(self) -> np.ndarray:
        """Orthonormal columns that span what K sees of the linearized robot:
        what it does not see is not brought back."""
        return reached_and_lost(self.steady.A.T, self.K.T)[0]

    @cached_property
    def used(self) -> list[int]:
        """The numbers of the states that the feedback uses; of a position and its heading all or none."""
        weighed = np.abs(self.K).max(axis=0) > 0.0
        if (place := self.steady.place) and weighed[list(place[:2])].any():
            weighed[list(place)] = True
        return [int(k) for k in np.flatnonzero(weighed)]

    def deviation(self, state: ca.SX, desired: ca.SX) -> ca.SX:
        """Return x - x_d, (2n-m) x 1, as the gains see it; headings without whole turns taken off."""
        off = state - desired
        if self.steady.place:
            x, y, heading = self.steady.place
            c, s = ca.cos(desired[heading]), ca.sin(desired[heading])
            off[x], off[y] = c * off[x] + s * off[y], c * off[y] - s * off[x]
        return off

    @cached_property
    def _function(self) -> Direct:
        """From state and desired state to the deviation and the inputs without limits."""
        size = len(self.steady.names)
        state, desired = ca.SX.sym("state", size), ca.SX.sym("desired", size)
        off = self.deviation(state, desired)
        if self.steady.place:
            turn = off[self.steady.place[2]] / (2 * ca.pi)
            off[self.steady.place[2]] -= 2 * ca.pi * ca.floor(turn + 0.5)
        tau = ca.DM(self.steady.tau) - ca.DM(self.K) @ off
        return Direct(portable(ca.Function("feedback", [state, desired], [ca.densify(off), ca.densify(tau)])))

    def step(self, state: np.ndarray, desired: np.ndarray) -> tuple[str, np.ndarray]:
        """See Feedback; "astray" where it has fallen."""
        if self.feedback:
            return self.feedback.step(state, desired)
        if not (np.isfinite(state).all() and np.isfinite(desired).all()):
            return "nonfinite", np.zeros(len(self.K))
        off, tau = self._function(state, desired)
        if ((self.fallen > 0.0) & ~(np.abs(off) <= self.fallen)).any():
            return "astray", np.zeros(len(self.K))
        most = np.where(self.limits > 0.0, self.limits, np.inf)
        limited = np.clip(tau, -most, most)
        return ("ok" if (limited == tau).all() else "saturated"), limited


def feedback_law(balanced: Balanced) -> ControlLaw:
    """Return the feedback as a control law: its outputs are the states that it uses, its reference their
    desired values.

    It linearizes nothing: it has neither decoupling matrix nor gains of its own, and its limits are not in
    it.
    """
    system, tau_e = balanced.steady.partial.system, ca.DM(balanced.steady.tau)
    chosen = [system.state[k] for k in balanced.used]
    rows = tuple(OutputRow(q.name, q.unit, q.about or q.name, q.symbol) for q in chosen)
    reference = tuple(quantity(q.name, q.unit, f"desired {q.about or q.name}") for q in chosen)
    desired = ca.SX.zeros(len(system.state))
    for k, each in zip(balanced.used, reference, strict=True):
        desired[k] = each.symbol
    tau = tau_e - ca.DM(balanced.K) @ balanced.deviation(symbols(system.state), desired)
    about = f"state feedback, {balanced.steady.about}"
    nothing = ca.SX(0, 1)
    linearization = Linearization(
        system=system,
        output=OutputMap(NAME, about, rows),
        relative_degree=(0,) * len(rows),
        h=symbols(chosen),
        rate=nothing,
        Phi=ca.SX(0, 0),
        Phidot=ca.SX(0, 0),
        drift=nothing,
    )
    v = symbols(reference)
    return ControlLaw(
        linearization=linearization,
        parameters=tuple(system.mechanism.parameters),
        config=(),
        gains=(),
        reference=reference,
        virtual_input=(),
        v=v,
        extension_rate=nothing,
        outside=Feedbacks(nothing, tau, nothing, tau),
        within=None,
        u=nothing,
        tau=tau,
        u_of_v=nothing,
        tau_of_v=tau,
    )


class StateFeedback:
    """A Controller: the feedback with its state and the desired values of the states that it uses."""

    extension_rate = np.zeros(0)

    def __init__(self, law: ControlLaw, balanced: Balanced):
        self.law, self._balanced = law, balanced
        self._desired = balanced.steady.state

    def evaluate(self, state: np.ndarray, reference: np.ndarray) -> Evaluation:
        """See Controller: the states that are used, and the inputs."""
        status, tau = self.step(state, reference)
        return Evaluation(status, {"h": state[self._balanced.used], "tau": tau})

    def step(self, state: np.ndarray, reference: np.ndarray) -> tuple[str, np.ndarray]:
        """See Controller."""
        desired = self._desired.copy()
        desired[self._balanced.used] = reference
        return self._balanced.step(np.asarray(state, float), desired)

    believed = math.nan  # see Controller

    def believe(self, mu: float) -> None:
        """Raise BadInput: it has no limits of friction."""
        raise BadInput(f"{self.law.name}: a state feedback has no limits of friction")

    def adapt(self, params: Numbers) -> None:
        """Raise BadInput: its gains are fixed."""
        raise BadInput(
            f"{self.law.name}: the gains of a state feedback are fixed: it does not learn parameters"
        )

    def place(self, config: Numbers) -> None:
        """Do nothing: a state feedback has no config."""


def design(
    steady: Steady,
    weights: Mapping[str, float],
    effort: float | Sequence[float] = 1.0,
    without: Sequence[str] = (),
    limit: float | Sequence[float] = np.inf,
) -> Balanced:
    """Return the feedback of an LQR; see `Steady.lqr` and `Steady.without`, whose errors it raises."""
    gains, _ = steady.lqr(weights, effort, without)
    used = [name for name in without if np.abs(gains[:, steady.names.index(name)]).max() > 0.0]
    return Balanced(steady, steady.without(gains, *used) if used else gains, limit)
