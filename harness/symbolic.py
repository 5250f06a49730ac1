"""The reference backend: the model's own expressions, evaluated by CasADi in double."""

from collections.abc import Sequence
from functools import cache

import casadi as ca
import numpy as np

from ..model.expression import fold, operate
from ..model.law import ControlLaw, symbols
from ..model.linearization import SINGULAR
from .backends import Evaluation
from .direct import Direct

ANGLE_MAX = 2.0**20  # rad; beyond it the C's sine and cosine in double refuse
VECTORS = ("h", "ydot", "u", "tau", "V", "bias", "lam")  # the other quantities are matrices


class CasadiController:
    """A law with numbers for its parameters, config and gains. Status as the C runtime's, found in the same order."""

    def __init__(self, law: ControlLaw, params: Sequence[float], config: Sequence[float], gains: Sequence[float]):
        self.law = law
        self._fixed = tuple(np.array(group, dtype=float) for group in (params, config, gains))
        self._step, self._evaluation = Direct(step_function(law)), evaluation_function(law)

    def evaluate(self, state: np.ndarray, reference: np.ndarray) -> Evaluation:
        """All quantities, those of the model (M, V, A, S, Mbar, bias, lam) included."""
        status, _ = self.step(state, reference)
        if status != "ok":
            return Evaluation(status)
        values = [np.asarray(value) for value in self._evaluation(*self._fixed, state, reference)]
        named = zip(self._evaluation.name_out(), values, strict=True)
        return Evaluation(status, {name: value.ravel() if name in VECTORS else value for name, value in named})

    def step(self, state: np.ndarray, reference: np.ndarray) -> tuple[str, np.ndarray]:
        """Status and tau, N or N m; zeros when the status is an error."""
        zero = np.zeros(len(self.law.system.mechanism.inputs))
        if not (np.all(np.isfinite(state)) and np.all(np.isfinite(reference))):
            return "nonfinite", zero
        tau, determinant, scale, angles = self._step(*self._fixed, state, reference)
        if not np.all(np.abs(angles) <= ANGLE_MAX):
            return "range", zero
        if not abs(determinant[0]) > SINGULAR * scale[0]:
            return "singular", zero
        if not np.all(np.isfinite(tau)):
            return "nonfinite", zero
        return "ok", tau


@cache
def evaluation_function(law: ControlLaw) -> ca.Function:
    """(params, config, gains, state, reference) to every quantity of an Evaluation."""
    found, system, mechanism = law.linearization, law.system, law.system.mechanism
    quantities = {"h": found.h, "ydot": found.rate, "Phi": found.Phi, "Phidot": found.Phidot, "u": law.u, "tau": law.tau}
    quantities |= {"M": mechanism.M, "V": system.V, "A": mechanism.A, "S": system.S, "Mbar": system.Mbar, "bias": system.bias}
    return law.function(quantities | {"lam": system.constraint_forces(law.tau, law.u)})


@cache
def step_function(law: ControlLaw) -> ca.Function:
    """(params, config, gains, state, reference) to tau, det Phi, the product of Phi's row norms, and all angles."""
    found = law.linearization
    scale = ca.sqrt(found.scale_squared)
    used = ca.vertcat(found.h, found.rate, ca.vec(found.Phi), ca.vec(found.Phidot), law.tau)
    return law.function({"tau": law.tau, "determinant": found.determinant, "scale": scale, "angles": angles(law, used)})


def angles(law: ControlLaw, expression: ca.SX) -> ca.SX:
    """The arguments of every sine and cosine in `expression`, each once, as a column."""
    found: dict[int, ca.SX] = {}

    def apply(code: int, arguments: tuple[ca.SX, ...]) -> ca.SX:
        if code in (ca.OP_SIN, ca.OP_COS):
            found[arguments[0].element_hash()] = arguments[0]
        return operate(code, *arguments)

    leaves = [quantity.symbol for group in law.groups.values() for quantity in group]
    fold(expression, leaves, leaves.__getitem__, ca.SX, apply)
    return ca.vertcat(ca.SX(0, 1), *found.values())


def condition_values(law: ControlLaw, params: Sequence[float], config: Sequence[float]) -> np.ndarray:
    """The expressions of law.output.conditions, which must be positive."""
    return np.asarray(_condition_function(law)(params, config)).ravel()


@cache
def _condition_function(law: ControlLaw) -> ca.Function:
    values = ca.vertcat(ca.SX(0, 1), *[expression for expression, _ in law.output.conditions])
    return ca.Function("conditions", [symbols(law.parameters), symbols(law.config)], [values])
