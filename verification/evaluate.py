"""The quantities of a control law at given states."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..controllers.backends import make_controller
from ..controllers.controller import Controller, Evaluation, ParameterRefused

if TYPE_CHECKING:
    from .cases import Case


def evaluate_cases(cases: Sequence[Case], backend: str) -> list[Evaluation]:
    """Evaluate each case; a case with a parameter that the law rejects gets the status bad_parameter, or nonfinite."""
    controllers: dict[tuple, Controller | None] = {}  # None: parameters rejected
    evaluations = []
    for case in cases:
        key = (case.law, case.params, case.config, case.gains)
        if key not in controllers:
            try:
                controllers[key] = make_controller(backend, *key)
            except ParameterRefused:
                controllers[key] = None
        controller = controllers[key]
        if controller is not None:
            evaluation = controller.evaluate(case.state, case.reference)
        else:
            numbers = (*case.params, *case.config, *case.gains)
            evaluation = Evaluation("bad_parameter" if np.all(np.isfinite(numbers)) else "nonfinite")
        if not all(np.all(np.isfinite(value)) for value in evaluation.values.values()):
            evaluation = Evaluation("nonfinite")
        evaluations.append(evaluation)
    return evaluations
