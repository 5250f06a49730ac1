"""The controller behind one face: CasADi's evaluation of the model, or the compiled C in double or float."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

from .errors import BadInput

if TYPE_CHECKING:
    from ..model.law import ControlLaw

BACKENDS = ("casadi", "c", "cf")  # CasADi in double, generated C in double, generated C in float
STATUS = ("ok", "saturated", "null", "nonfinite", "range", "bad_parameter", "singular", "not_ready")  # names as the C runtime's
QUANTITIES = ("h", "ydot", "Phi", "Phidot", "u", "tau")  # what every backend answers
MODEL_QUANTITIES = ("M", "V", "A", "S", "Mbar", "bias", "lam")  # what casadi answers as well


class ParameterRefused(BadInput):
    """A parameter, config value or gain that is not finite, has the wrong sign or makes no path."""


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
        """Status and inputs tau (12), (20); zeros when the status is an error."""


def make_controller(
    backend: str, law: ControlLaw, params: Sequence[float], config: Sequence[float], gains: Sequence[float]
) -> Controller:
    """A controller of `law`; params, config and gains in the order of law.parameters, law.config and law.gains.

    Raises BadInput for an unknown backend, ParameterRefused for a number the law cannot take: alike in all backends.
    """
    if backend not in BACKENDS:
        raise BadInput(f"unknown backend {backend!r}; known are {', '.join(BACKENDS)}")
    check_parameters(law, params, config, gains)
    if backend == "casadi":
        from .symbolic import CasadiController

        return CasadiController(law, params, config, gains)
    from .compiled import CompiledController

    return CompiledController(law, params, config, gains, scalar="double" if backend == "c" else "float")


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
