"""Zero dynamics of an underactuated robot at rest: the motion that is left while outputs, or velocities, are
held.

By numbers: the robot with the accelerations that hold them is linearized on the states in which they are at
rest.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ....model.linearization import SINGULAR, Linearization
from ....model.mechanism import values_of
from ....model.reduction import ReducedSystem
from .steady import STILL, Steady, listed, modes, refuse_undefined

UNCOUPLED = 1e-9  # relative: a coupling at or below this is none
NOT_COUPLED = "not possible at rest, where inertia does not couple them to the inputs"


@dataclass(frozen=True, eq=False)
class ZeroDynamics:
    """The `modes` of the zero dynamics, 1/s, the fastest growing first; None where inertia does not couple
    what is held to the inputs.
    """

    modes: np.ndarray | None

    @property
    def unstable(self) -> bool:
        """Whether one of them grows."""
        return self.modes is not None and bool(np.any(self.modes.real > STILL))

    @property
    def verdict(self) -> str:
        """Whether one of them grows, or why there are none."""
        return NOT_COUPLED if self.modes is None else "unstable" if self.unstable else "none of them grows"

    def __str__(self) -> str:
        """Return modes and verdict."""
        return self.verdict if self.modes is None else f"{listed(self.modes)} 1/s, {self.verdict}"


def of_velocities(rest: Steady, chosen: Sequence[int] = ()) -> ZeroDynamics:
    """Return the zero dynamics with the velocities at the inputs held at zero, or the quasi-velocities with
    the numbers `chosen`.
    """
    partial = rest.partial
    system, r = partial.system, len(partial.system.driven)
    coupling = ca.Function("coupling", [system.mechanism.q, system.mechanism.p], [partial.coupling(chosen)])
    sizes = np.linalg.svd(coupling(rest.q, rest.parameters).full(), compute_uv=False)
    if not sizes.min() > UNCOUPLED * max(1.0, sizes.max()):
        return ZeroDynamics(None)
    held = system.nu[list(chosen)] if chosen else partial.velocities
    return ZeroDynamics(_modes(system, rest, held, partial.acceleration(ca.SX.zeros(r), chosen)))


def of_outputs(
    rest: Steady, linearization: Linearization, config: Sequence[float] | None = None
) -> ZeroDynamics:
    """Return the zero dynamics with the outputs held at their values at rest; `config` are the parameters of
    the output map, by default their own defaults. The robot's parameters are those of `rest`.
    """
    output, robot = linearization.output, linearization.system.mechanism
    given: dict[str, Any] = (
        {} if config is None else {q.name: value for q, value in zip(output.parameters, config, strict=True)}
    )
    symbols = ca.vertcat(ca.SX(0, 1), *[q.symbol for q in output.parameters])
    numbers = ca.DM(values_of(list(output.parameters), given, output.name))
    none = ca.SX.zeros(linearization.h.numel())
    parts = [
        ca.vertcat(linearization.h, linearization.rate),
        linearization.second_feedback(none),
        *linearization.measure,
    ]
    held, u, regular, bound = ca.substitute(parts, [symbols], [numbers]) if output.parameters else parts
    state = ca.vertcat(robot.q, linearization.system.nu)
    measure = ca.Function("measure", [state, robot.p], [regular - SINGULAR * bound])
    if not float(measure(rest.state, rest.parameters)) > 0.0:
        return ZeroDynamics(None)
    return ZeroDynamics(_modes(linearization.system, rest, held, u))


def _modes(system: ReducedSystem, rest: Steady, held: ca.SX, u: ca.SX) -> np.ndarray:
    """Return the modes of qdot = S nu, nudot = u on the states in which `held`, which u keeps constant, is as
    at rest.

    `system` is the reduction in whose symbols `held` and u are: each reduction that chooses the
    quasi-velocities has its own.
    """
    from scipy.linalg import null_space  # slow to import

    robot = system.mechanism
    state = ca.vertcat(robot.q, system.nu)
    slopes = ca.Function(
        "zero", [state, robot.p], [ca.jacobian(ca.vertcat(system.qdot, u), state), ca.jacobian(held, state)]
    )
    A, D = (slope.full() for slope in slopes(rest.state, rest.parameters))
    refuse_undefined(robot, A, D)
    T = null_space(D)
    return modes(T.T @ A @ T)
