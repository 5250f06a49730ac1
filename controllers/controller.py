"""The common interface of controllers: quantities, limits, results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ..readers.errors import BadInput

if TYPE_CHECKING:
    from ..model.law import ControlLaw

Numbers = Sequence[float] | np.ndarray  # in a fixed order

BACKENDS = ("casadi", "c", "cf")  # CasADi in double, generated C in double, generated C in float
ON_TARGET = {"m4f": "cortex-m4f", "rv32": "rv32imafc"}  # generated C in float on an emulated processor: backend -> target
STATUS = (  # as in the C runtime
    *("ok", "saturated", "null", "nonfinite", "range", "bad_parameter", "singular", "not_ready"),
    *("bad_path", "unstable", "arrived"),
)
ON_LIMIT = ("cut", "slow")  # as the C runtime's NOSLIP_CUT and NOSLIP_SLOW
QUANTITIES = ("h", "ydot", "Phi", "Phidot", "u", "tau")  # computed by every backend
MODEL_QUANTITIES = ("M", "V", "A", "S", "Mbar", "bias", "lam")  # computed by casadi in addition


class ParameterRefused(BadInput):
    """A parameter, config value or gain that is not finite, has the wrong sign or describes no valid path."""


@dataclass(frozen=True)
class Limits:
    """Limits of the actuators: `torque` is the largest absolute value of each input, N or N m; 0 or inf: no limit.

    In `mode` "cut" each input is limited separately. In mode "slow" the desired acceleration is changed as little as possible, so
    that the other outputs are not affected; if these alone require more than the limits, the change that minimizes the largest
    |tau| / limit is used, and all inputs are divided by this quotient.
    """

    torque: tuple[float, ...]
    mode: str = "cut"

    def check(self, law: ControlLaw) -> None:
        """Raise BadInput if the law cannot have these limits."""
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
            raise BadInput(f'limits: {law.name} has no speed to reduce, as mode "slow" requires; use Type IV, or mode "cut"')


@dataclass
class Evaluation:
    """The result of a controller at one state: `values` by quantity (SI, row-major), empty unless `status` is "ok"."""

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
