"""The reference backend: the model's expressions, evaluated by CasADi in double."""

import math
from functools import cache, cached_property

import casadi as ca
import numpy as np

from ...model.algebra.direct import Direct
from ...model.algebra.expression import fold, operate
from ...model.algebra.portable import portable
from ...model.law import ControlLaw, symbols
from ...model.linearization import SINGULAR
from .controller import Evaluation, Limits, Numbers, check_point

ANGLE_MAX = 2.0**20  # rad; the C in double rejects larger angles
FLAT = 1e-5  # entries of a gradient below this part of the largest count as zero, as in the C runtime
# The other quantities are matrices
VECTORS = ("h", "ydot", "u", "tau", "command", "extension_rate", "V", "bias", "lam")


class CasadiController:
    """A law with numerical parameters, config, gains and limits. The status is that of the C,
    with the same precedence."""

    def __init__(
        self,
        law: ControlLaw,
        params: Numbers,
        config: Numbers,
        gains: Numbers,
        limits: Limits | None = None,
    ):
        self.law = law
        self.extension_rate = np.zeros(len(law.extension))
        self._fixed = tuple(np.array(group, dtype=float) for group in (params, config, gains))
        self._step = Direct(step_function(law))
        self._slows = limits is not None and limits.mode == "slow"
        self._limits = np.array([limit or np.inf for limit in limits.torque] if limits else np.inf)
        friction = limits.friction if limits and limits.mode == "grip" else None
        self._grip = None
        if friction:
            from .grip import GripReference  # slow to import

            self._grip = GripReference(law, self._fixed[0], friction, self._limits)

    @cached_property
    def _evaluation(self) -> Direct:
        return Direct(evaluation_function(self.law))

    @cached_property
    def _model(self) -> Direct:
        return Direct(model_function(self.law))

    def evaluate(self, state: np.ndarray, reference: np.ndarray) -> Evaluation:
        """Return the quantities of the law."""
        check_point(self.law, state, reference)
        status, *_ = self._unlimited(state, reference)
        return Evaluation(status, self._values(self._evaluation, state, reference) if status == "ok" else {})

    def evaluate_with_model(self, state: np.ndarray, reference: np.ndarray) -> Evaluation:
        """Return the quantities of the law and those of the model (M, V, A, S, Mbar, bias, lam)."""
        evaluation = self.evaluate(state, reference)
        values = self._values(self._model, state, reference) if evaluation.status == "ok" else {}
        return Evaluation(evaluation.status, evaluation.values | values)

    def _values(self, direct: Direct, state: np.ndarray, reference: np.ndarray) -> dict[str, np.ndarray]:
        function, values = direct.function, {}
        for k, value in enumerate(direct(*self._fixed, state, reference)):
            name = function.name_out(k)
            values[name] = value if name in VECTORS else value.reshape(function.size_out(k), order="F")
        return values

    def step(self, state: np.ndarray, reference: np.ndarray) -> tuple[str, np.ndarray]:
        """Return status and what the law gives, see Controller, within the limits;
        zeros if the status is an error."""
        check_point(self.law, state, reference)
        status, tau, rate = self._unlimited(state, reference)
        self.extension_rate = (
            rate if status == "ok" and (np.abs(tau) <= self._limits).all() else np.zeros_like(rate)
        )
        if self._grip and status != "ok":
            self._grip.earned.forget()
        if self._grip and status == "ok":
            return self._grip.step(state, tau, self._slope(state, reference))
        if (np.abs(tau) <= self._limits).all():
            return status, tau
        if self._slows:
            tau = slowed(tau, self._slope(state, reference), self._limits)
        return "saturated", np.clip(tau, -self._limits, self._limits)

    @property
    def believed(self) -> float:
        """See Controller."""
        return self._grip.earned.mu if self._grip else math.nan

    def believe(self, mu: float) -> None:
        """See Controller."""
        assert self._grip is not None, "there is friction in mode grip only"
        self._grip.earned.believe_at_most(mu)

    def adapt(self, params: Numbers) -> None:
        """See Controller."""
        self._fixed = (np.array(params, dtype=float), *self._fixed[1:])
        if self._grip:
            self._grip.params = self._grip.earned.params = self._fixed[0]

    def place(self, config: Numbers) -> None:
        """See Controller."""
        params, _, gains = self._fixed
        self._fixed = (params, np.array(config, dtype=float), gains)

    def _slope(self, state: np.ndarray, reference: np.ndarray) -> np.ndarray:
        return np.asarray(slope_function(self.law)(*self._fixed, state, reference)).ravel()

    def _unlimited(self, state: np.ndarray, reference: np.ndarray) -> tuple[str, np.ndarray, np.ndarray]:
        """Return status, inputs and the rates of the states of the extension;
        zeros if the status is an error."""
        zero = np.zeros(len(self.law.inputs)), np.zeros(len(self.law.extension))
        if not (np.isfinite(state).all() and np.isfinite(reference).all()):
            return "nonfinite", *zero
        tau, measure, angles, rate = self._step(*self._fixed, state, reference)
        if not (np.abs(angles) <= ANGLE_MAX).all():
            return "range", *zero
        if not (measure[0::2] > SINGULAR * measure[1::2]).all():
            return "singular", *zero
        if not (np.isfinite(tau).all() and np.isfinite(rate).all()):
            return "nonfinite", *zero
        return "ok", tau, rate


def slowed(tau: np.ndarray, slope: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """Return tau + c slope for the c nearest to 0 that keeps all |tau| <= limits; if there is none, for the c
    that minimizes the largest |tau| / limit, divided by that quotient."""
    slope = np.where(np.abs(slope) > FLAT * np.abs(slope).max(), slope, 0.0)
    a, b = (np.concatenate([values, -values]) for values in (tau / limits, slope / limits))
    # max(a + b c) is convex: c is 0, or a point where a line a + b c is 1, or where two of them intersect
    with np.errstate(divide="ignore", invalid="ignore"):
        candidates = np.concatenate([[0.0], (1 - a) / b, ((a[:, None] - a) / (b - b[:, None])).ravel()])
    candidates = candidates[np.isfinite(candidates)]
    overload = np.max(a + candidates[:, None] * b, axis=1)
    least = max(1.0, overload.min())
    good = overload <= least + 1e-13 * np.abs(a).max()
    change = min(candidates[good], key=abs)
    return (tau + change * slope) / least


@cache
def slope_function(law: ControlLaw) -> ca.Function:
    """Return the function (params, config, gains, state, reference) to the derivative of tau by the virtual
    input of the speed.
    """
    return portable(law.function({"slope": law.slope}))


@cache
def evaluation_function(law: ControlLaw) -> ca.Function:
    """Return the function (params, config, gains, state, reference) to the quantities of the law."""
    return portable(law.function(law.quantities))


@cache
def model_function(law: ControlLaw) -> ca.Function:
    """Return the function (params, config, gains, state, reference) to the quantities of the model."""
    system, mechanism = law.system, law.system.mechanism
    quantities = {
        "M": mechanism.M,
        "V": system.V,
        "A": mechanism.A,
        "S": system.S,
        "Mbar": system.Mbar,
        "bias": system.bias,
    }
    quantities |= {} if law.kinematic else {"lam": system.constraint_forces(law.tau, law.u)}
    return portable(law.function(quantities))


@cache
def step_function(law: ControlLaw) -> ca.Function:
    """Return the function (params, config, gains, state, reference) to tau, the measures of singularity, all
    angles, and the rates of the states of the extension.
    """
    found = law.linearization
    used = ca.vertcat(found.h, found.rate, ca.vec(found.Phi), ca.vec(found.Phidot), law.tau)
    measure, rate = ca.vertcat(*[part for pair in found.measures for part in pair]), law.extension_rate
    return portable(
        law.function(
            {"tau": law.tau, "measure": measure, "angles": angles(law, used), "extension_rate": rate}
        )
    )


def angles(law: ControlLaw, expression: ca.SX) -> ca.SX:
    """Return the arguments of every sine and cosine in `expression`, each once, as a column."""
    found: dict[int, ca.SX] = {}

    def apply(code: int, arguments: tuple[ca.SX, ...]) -> ca.SX:
        if code in (ca.OP_SIN, ca.OP_COS):
            found[arguments[0].element_hash()] = arguments[0]
        return operate(code, *arguments)

    leaves = [quantity.symbol for group in law.groups.values() for quantity in group]
    fold(expression, leaves, leaves.__getitem__, ca.SX, apply)
    return ca.vertcat(ca.SX(0, 1), *found.values())


def condition_values(law: ControlLaw, params: Numbers, config: Numbers) -> np.ndarray:
    """Return the values of law.output.conditions, which must be positive."""
    return np.asarray(_condition_function(law)(params, config)).ravel()


@cache
def _condition_function(law: ControlLaw) -> ca.Function:
    values = ca.vertcat(ca.SX(0, 1), *[expression for expression, _ in law.output.conditions])
    return portable(ca.Function("conditions", [symbols(law.parameters), symbols(law.config)], [values]))
