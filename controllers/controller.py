"""What every controller is to its callers: its quantities, its limits, what it returns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ..readers.errors import BadInput

if TYPE_CHECKING:
    from ..model.law import ControlLaw

Numbers = Sequence[float] | np.ndarray  # one after another, in a known order

BACKENDS = ("casadi", "c", "cf")  # CasADi in double, generated C in double, generated C in float
ON_TARGET = {"m4f": "cortex-m4f", "rv32": "rv32imafc"}  # generated C in float on an emulated processor: backend -> target
STATUS = (  # names as the C runtime's
    *("ok", "saturated", "null", "nonfinite", "range", "bad_parameter", "singular", "not_ready"),
    *("bad_path", "unstable", "arrived"),
)
ON_LIMIT = ("cut", "slow")  # as the C runtime's NOSLIP_CUT and NOSLIP_SLOW
QUANTITIES = ("h", "ydot", "Phi", "Phidot", "u", "tau")  # what every backend answers
MODEL_QUANTITIES = ("M", "V", "A", "S", "Mbar", "bias", "lam")  # what casadi answers as well


class ParameterRefused(BadInput):
    """A parameter, config value or gain that is not finite, has the wrong sign or makes no path."""


@dataclass(frozen=True)
class Limits:
    """What the actuators can do: `torque` is the largest absolute value of each input, N or N m; 0 or inf: no limit.

    Beyond them, `mode` "cut" cuts each input by itself. "slow" gives up the wanted rate of the speed, as little as can be, so
    that the other outputs get what they ask for; where these alone ask for more than the limits, the change that makes the
    largest |tau| / limit least is taken, and all inputs are scaled alike.
    """

    torque: tuple[float, ...]
    mode: str = "cut"

    def check(self, law: ControlLaw) -> None:
        """Raise BadInput when the law cannot have these limits."""
        inputs = law.system.mechanism.inputs
        if len(self.torque) != len(inputs):
            names = ", ".join(q.name for q in inputs)
            raise BadInput(f"limits: torque has {len(self.torque)} values; give {len(inputs)}, for {names}")
        for q, value in zip(inputs, self.torque, strict=True):
            if not value >= 0:
                raise BadInput(f"limits: torque of {q.name} is {value}; give a positive number of {q.unit}, or 0 for no limit")
        if self.mode not in ON_LIMIT:
            raise BadInput(f"limits: unknown mode {self.mode!r}; known are {', '.join(ON_LIMIT)}")
        if self.mode == "slow" and law.speed_row is None:
            raise BadInput(f'limits: {law.name} has no speed to give up, as mode "slow" does; use Type IV, or mode "cut"')


@dataclass
class Evaluation:
    """What a controller answers at one state: `values` by quantity (SI, row-major), empty unless `status` is "ok"."""

    status: str
    values: dict[str, np.ndarray] = field(default_factory=dict)


class Controller(Protocol):
    """A control law with its parameters, config and gains fixed.

    `state` is q then nu in the order of law.state, `reference` in the order of law.reference, SI: one-dimensional, else
    BadInput is raised. Threads may share a controller; they take turns.
    """

    law: ControlLaw

    def evaluate(self, state: np.ndarray, reference: np.ndarray) -> Evaluation:
        """All quantities at a state."""

    def step(self, state: np.ndarray, reference: np.ndarray) -> tuple[str, np.ndarray]:
        """Status and inputs tau (12), (20), within the limits ("saturated": made so); zeros when the status is an error."""


def check_point(law: ControlLaw, state: np.ndarray, reference: np.ndarray) -> None:
    """Raise BadInput unless state and reference are one-dimensional and as long as those of the law."""
    for name, given, quantities in (("state", state, law.state), ("reference", reference, law.reference)):
        if np.shape(given) != (len(quantities),):
            names = ", ".join(q.name for q in quantities)
            raise BadInput(f"{law.name}: {name} has shape {np.shape(given)}; give {len(quantities)} numbers: {names}")
