"""The common interface of controllers: quantities, limits, results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ...readers.errors import BadInput, check_named
from ...readers.reading import one_for_each
from . import BACKENDS as BACKENDS
from . import ON_TARGET as ON_TARGET

if TYPE_CHECKING:
    from ...model.law import ControlLaw

Numbers = Sequence[float] | np.ndarray  # in a fixed order

STATUS = (  # as in the C runtime
    *("ok", "saturated", "null", "nonfinite", "range", "bad_parameter", "singular", "not_ready"),
    *("bad_path", "unstable", "arrived", "grip", "will_slip", "slipping", "astray"),
    *("rejected", "diverged", "damaged", "other_version", "other_model", "full"),
)
ON_LIMIT = ("cut", "slow", "grip")  # as the C runtime's NOSLIP_CUT, NOSLIP_SLOW and NOSLIP_GRIP
RUNNING = ("ok", "saturated", "grip", "will_slip", "slipping")  # statuses of a step that gave inputs
QUANTITIES = ("h", "ydot", "Phi", "Phidot", "u", "tau")  # computed by every backend
MODEL_QUANTITIES = ("M", "V", "A", "S", "Mbar", "bias", "lam")  # computed by casadi in addition


class ParameterRefused(BadInput):
    """A parameter, config value or gain that is not finite, has the wrong sign or describes no valid path."""


@dataclass(frozen=True)
class Friction:
    """The floor as the controller believes it, as in the C struct noslip_friction: the coefficient `mu`; the
    `margin`, part of mu kept in reserve, 0 to below 1; the `share` of the weight on the contacts, above 0 to
    1; the `height` of the centre of mass, m. With a `period` (s) between two steps mu is earned, from what is
    `known` on, with a relative `error` of accelerations, rates that are `coarse` (rad/s), and a `lag` (s) of
    their answer to inputs.
    """

    mu: float
    margin: float = 0.0
    share: float = 1.0
    height: float = 0.0
    period: float = 0.0
    known: float = 0.0
    error: float = 0.0
    coarse: float = 0.0
    lag: float = 0.0


@dataclass(frozen=True)
class Limits:
    """Limits of the actuators: `torque` is the largest absolute value of each input, N or N m; 0 or inf: no
    limit. For a kinematic law it is that of each command, in the unit of the quasi-velocity, and the mode is
    not "grip".

    In `mode` "cut" each input is limited separately. In mode "slow" the desired acceleration is changed as
    little as possible, so that the other outputs are not affected; if these alone require more than the
    limits, the change that minimizes the largest |tau| / limit is used, and all inputs are divided by this
    quotient. In mode "grip" the inputs also keep every contact within `friction`: the desired acceleration is
    changed as in "slow", and if that is not enough, the inputs go from there towards coasting, where the
    ground's forces are smallest, as little as needed.
    """

    torque: tuple[float, ...]
    mode: str = "cut"
    friction: Friction | None = None

    def check(self, law: ControlLaw) -> None:
        """Raise BadInput if the law cannot have these limits."""
        inputs = law.inputs
        one_for_each(self.torque, [q.name for q in inputs], "limits: torque", of_all=False)
        for q, value in zip(inputs, self.torque, strict=True):
            if not value >= 0:
                raise BadInput(
                    f"limits: torque of {q.name} is {value}; give a positive number of {q.unit}, or 0 for no "
                    "limit"
                )
        check_named(self.mode, ON_LIMIT, "limits: unknown mode")
        if self.mode == "slow" and law.speed_row is None:
            raise BadInput(
                f'limits: {law.name} has no speed to reduce, as mode "slow" requires; use Type IV, or mode '
                '"cut"'
            )
        if self.mode == "grip":
            self._check_friction(law)

    def _check_friction(self, law: ControlLaw) -> None:
        from ...codegen.derivation.grip import is_wide, why_not  # slow to import

        name, floor = law.system.mechanism.name, self.friction
        if law.kinematic:
            raise BadInput(f'limits: mode "grip" is for laws that give torques; {law.name} gives velocities')
        if reason := why_not(law.system):
            raise BadInput(f'limits: mode "grip" does not apply to {name}: {reason}')
        if floor is None:
            raise BadInput('limits: mode "grip" requires friction')
        if not (
            0 < floor.mu < np.inf
            and 0 <= floor.margin < 1
            and 0 < floor.share <= 1
            and 0 <= floor.height < np.inf
        ):
            raise BadInput(
                f"limits: {floor}: mu must be positive, margin from 0 to below 1, share above 0 to 1, height "
                "not negative"
            )
        if floor.height and not is_wide(law.system):
            raise BadInput(
                f"limits: height = {floor.height:g}: {name} has an axle without width to carry the moment; "
                "omit it"
            )


@dataclass
class Evaluation:
    """The result of a controller at one state: `values` by quantity (SI, row-major),
    empty unless `status` is "ok"."""

    status: str
    values: dict[str, np.ndarray] = field(default_factory=dict)


class Controller(Protocol):
    """A control law with its parameters, config and gains fixed.

    `state` is q, then nu, then the states of a dynamic extension, in the order of law.state, `reference` in
    the order of law.reference, SI: one-dimensional, else BadInput is raised. Threads may share a controller;
    they take turns.
    """

    law: ControlLaw

    @property
    def extension_rate(self) -> np.ndarray:
        """Rates of the states of a dynamic extension at the last step, zero unless it returned "ok";
        empty without one."""

    @property
    def believed(self) -> float:
        """The friction that is believed since the last step; NaN without mode "grip"."""

    def evaluate(self, state: np.ndarray, reference: np.ndarray) -> Evaluation:
        """All quantities at a state."""

    def step(self, state: np.ndarray, reference: np.ndarray) -> tuple[str, np.ndarray]:
        """Status and inputs tau (12), (20), of a kinematic law the commanded nu, within the limits
        ("saturated": made so); zeros when the status is an error.
        """

    def believe(self, mu: float) -> None:
        """Keep the contacts within a friction `mu`, at most that of the limits, from the next step on;
        in mode "grip"."""

    def adapt(self, params: Numbers) -> None:
        """Use other parameters of the robot from the next step on. Raises BadInput where that is not
        possible."""

    def place(self, config: Numbers) -> None:
        """Use another config, such as another point of a course, from the next step on; after one that is not
        valid, steps give its status.
        """


def check_point(law: ControlLaw, state: np.ndarray, reference: np.ndarray) -> None:
    """Raise BadInput unless state and reference are one-dimensional and as long as those of the law."""
    for name, given, quantities in (("state", state, law.state), ("reference", reference, law.reference)):
        if np.shape(given) != (len(quantities),):
            names = ", ".join(q.name for q in quantities)
            raise BadInput(
                f"{law.name}: {name} has shape {np.shape(given)}; give {len(quantities)} numbers: {names}"
            )
