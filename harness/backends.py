"""The controller behind one face: CasADi's evaluation of the model, or the compiled C, here or on an emulated processor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

from .errors import BadInput

if TYPE_CHECKING:
    from ..model.law import ControlLaw

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

    `state` is q then nu in the order of law.state, `reference` in the order of law.reference, SI.
    """

    law: ControlLaw

    def evaluate(self, state: np.ndarray, reference: np.ndarray) -> Evaluation:
        """All quantities at a state."""

    def step(self, state: np.ndarray, reference: np.ndarray) -> tuple[str, np.ndarray]:
        """Status and inputs tau (12), (20), within the limits ("saturated": made so); zeros when the status is an error."""


def make_controller(
    backend: str,
    law: ControlLaw,
    params: Sequence[float],
    config: Sequence[float],
    gains: Sequence[float],
    limits: Limits | None = None,
) -> Controller:
    """A controller of `law`; params, config and gains in the order of law.parameters, law.config and law.gains.

    Raises BadInput for an unknown backend or `limits` the law cannot have, ParameterRefused for a number it cannot take:
    alike in all backends.
    """
    if backend not in (*BACKENDS, *ON_TARGET):
        raise BadInput(f"unknown backend {backend!r}; known are {', '.join((*BACKENDS, *ON_TARGET))}")
    check_parameters(law, params, config, gains)
    if limits is not None:
        limits.check(law)
    if backend == "casadi":
        from .symbolic import CasadiController

        return CasadiController(law, params, config, gains, limits)
    from .compiled import CompiledController

    if backend in ON_TARGET:
        from .pil import target_library

        return CompiledController(law, params, config, gains, limits=limits, made_by=target_library(law, backend))
    return CompiledController(law, params, config, gains, "double" if backend == "c" else "float", limits)


def check_parameters(law: ControlLaw, params: Sequence[float], config: Sequence[float], gains: Sequence[float]) -> None:
    """Raise ParameterRefused when a value is not finite, has the wrong sign, or the path they describe does not exist."""
    from ..model.errors import ModelError
    from .symbolic import condition_values

    groups = (("parameter", law.parameters, params), ("output", law.config, config), ("gain", law.gains, gains))
    try:
        for kind, quantities, values in groups:
            for quantity, value in zip(quantities, values, strict=True):
                quantity.check(value, kind)
    except ModelError as error:
        raise ParameterRefused(str(error)) from error
    for value, (_, meaning) in zip(condition_values(law, params, config), law.output.conditions, strict=True):
        if not value > 0:
            raise ParameterRefused(f"output {law.name}: {meaning}")
