"""The first fit: parameters with which the smoothed motion satisfies the equations of motion (inverse
dynamics)."""

from collections.abc import Sequence
from copy import copy

import casadi as ca
import numpy as np
from scipy.optimize import least_squares

from ...model.algebra.direct import Direct
from .dynamics import Dynamics
from .log import Log
from .smoothing import slopes, smooth

MOST_ROWS = 2000
SMALLEST = 1e-3  # of the value with which it begins: the least that a positive parameter may become


class InverseDynamics:
    """The equations S'MS nudot + bias - S'E tau (10) at the rows of a log,
    whose signals are smoothed without a delay."""

    def __init__(self, log: Log, dynamics: Dynamics, names: Sequence[str], values: np.ndarray):
        """`values`: all parameters; `names`: those to fit."""
        system = dynamics.system
        self._log, self._coordinates = log, len(system.mechanism.coordinates)
        self._values, self._quantities = values, {q.name: q for q in dynamics.quantities}
        self.names = list(names)
        self._places = [list(self._quantities).index(name) for name in names]
        nudot, fitted = ca.SX.sym("nudot", system.dof), [dynamics.quantities[k].symbol for k in self._places]
        forces = system.input_map @ dynamics.torque
        error = system.Mbar @ nudot + system.bias - forces
        arguments = [system.mechanism.q, system.nu, nudot, dynamics.logged, dynamics.parameters]
        derivative = ca.densify(ca.jacobian(error, ca.vertcat(*fitted)))
        self._equations = ca.Function(
            "equations", arguments, [ca.densify(error), ca.densify(forces), derivative]
        )
        self._take(log.x[:, self._coordinates :], log.inputs)

    def with_columns(self, velocities: np.ndarray, inputs: np.ndarray) -> "InverseDynamics":
        """Return the equations with other columns of the log: quasi-velocities (N, n-m) and inputs (N, r)."""
        other = copy(self)
        other._take(velocities, inputs)
        return other

    def fit(self, upper: dict[str, float]) -> np.ndarray:
        """Return all parameters, with the named ones fitted within their bounds; `upper`:
        the largest values of some."""
        begin = self._values[self._places]
        least = [self._least(name, value) for name, value in zip(self.names, begin, strict=True)]
        most = [upper.get(name, np.inf) for name in self.names]
        sizes = np.abs(begin) + (begin == 0)
        fitted = least_squares(
            lambda p: (self._at(self._with(p))[0] / self._scale).ravel(),
            np.clip(begin, least, most),
            lambda p: (self._at(self._with(p))[2] / self._scale[..., None]).reshape(-1, len(self.names)),
            (least, most),
            x_scale=sizes,
        )
        return self._with(fitted.x)

    def misfit(self, values: np.ndarray) -> float:
        """Return the RMS error of the equations, relative to that of the forces."""
        error, forces, _ = self._at(values)
        return float(np.sqrt(np.mean((error / self._scale) ** 2) / np.mean((forces / self._scale) ** 2)))

    def _take(self, velocities: np.ndarray, inputs: np.ndarray) -> None:
        """Smooth the signals, and take rows inside the stretches, at most about MOST_ROWS."""
        log, nu = self._log, smooth(velocities, self._log.stretches)
        inside = np.concatenate([np.arange(s.start + 1, s.stop - 1) for s in log.stretches])
        rows = inside[:: 1 + len(inside) // MOST_ROWS]
        signals = (
            log.x[:, : self._coordinates],
            nu,
            slopes(log.t, nu, log.stretches),
            smooth(inputs, log.stretches),
        )
        self._rows, self._mapped = (
            [each[rows].ravel() for each in signals],
            Direct(self._equations.map(len(rows))),
        )
        self._scale = self._rms(self._at(self._values)[1])

    def _least(self, name: str, value: float) -> float:
        return {"any": -np.inf, "nonnegative": 0.0}.get(self._quantities[name].sign, SMALLEST * abs(value))

    def _with(self, fitted: np.ndarray) -> np.ndarray:
        values = self._values.copy()
        values[self._places] = fitted
        return values

    def _at(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return errors and forces of the equations, (N, n-m),
        and derivatives of the errors by the fitted parameters."""
        count, dof = self._mapped.function.size2_in(0), self._equations.size1_out(0)
        error, forces, derivative = self._mapped(*self._rows, np.tile(values, count))
        by = derivative.reshape(count, -1, dof).swapaxes(1, 2)
        return error.reshape(count, dof), forces.reshape(count, dof), by

    @staticmethod
    def _rms(signals: np.ndarray) -> np.ndarray:
        size = np.sqrt(np.mean(signals**2, axis=0))
        return np.maximum(size, 1e-9 * size.max(initial=1e-300))
