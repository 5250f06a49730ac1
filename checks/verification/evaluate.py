"""The quantities of a control law at given states."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...simulation.controllers.backends import make_controller
from ...simulation.controllers.controller import Controller, Evaluation, ParameterRefused
from ...simulation.controllers.symbolic import CasadiController

if TYPE_CHECKING:
    from ...simulation.specification.cases import EvaluationCase


def _evaluated(controller: Controller, case: EvaluationCase) -> Evaluation:
    """Return the quantities of a case, with those of the model if the controller has them."""
    if isinstance(controller, CasadiController):
        return controller.evaluate_with_model(case.state, case.reference)
    return controller.evaluate(case.state, case.reference)


def evaluate_cases(cases: Sequence[EvaluationCase], backend: str) -> list[Evaluation]:
    """Evaluate each case; a case with a parameter that the law rejects gets the status bad_parameter,
    or nonfinite."""
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
            evaluation = _evaluated(controller, case)
        else:
            numbers = (*case.params, *case.config, *case.gains)
            evaluation = Evaluation("bad_parameter" if np.all(np.isfinite(numbers)) else "nonfinite")
        if not all(np.all(np.isfinite(value)) for value in evaluation.values.values()):
            evaluation = Evaluation("nonfinite")
        evaluations.append(evaluation)
    return evaluations
