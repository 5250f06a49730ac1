"""Guidance and controller of a state feedback."""

from collections.abc import Callable

import numpy as np

from ...model.law import ControlLaw
from ...model.mechanism import Mechanism
from ...readers.errors import BadInput, check_named, naming
from ...readers.reading import one_for_each
from ..controllers import BACKENDS, ON_TARGET, SCALAR
from ..controllers.balance.feedback import Balanced, Feedback, StateFeedback, design, feedback_law
from ..controllers.balance.in_c import BalanceInC
from ..controllers.balance.steady import analyse_steady
from ..guidance import Leg, Side
from ..planning.course import SmoothCurve
from ..specification.feedback import FeedbackSection
from ..specification.spec import Spec
from .desired import Desired, Motion, commanded, on_course


class Regular(Side):
    """Of a law that is singular nowhere."""

    def __init__(self) -> None:
        pass

    def __call__(self, x: np.ndarray) -> float:
        """Return 1."""
        return 1.0

    def relative(self, x: np.ndarray) -> float:
        """Return 1."""
        return 1.0


class OnMotion:
    """Guidance along a desired motion; see the protocol Guidance."""

    piece, arrived = 0, False

    def __init__(self, leg: Leg, desired: Callable[[float], np.ndarray], used: list[int]):
        """`used`: numbers of the states that the controller is given."""
        self.leg, self._desired, self._used = leg, desired, used

    def leg_at(self, x: np.ndarray) -> Leg:
        """Return the controller."""
        return self.leg

    def reference(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return the reference at t."""
        return self._desired(t)[self._used]

    def left(self, t: float, x: np.ndarray) -> float:
        """Return infinity: the motion does not end."""
        return np.inf

    def update(self, t: float, x: np.ndarray) -> None:
        """Do nothing: there is no other motion."""


def feedback_of(robot: Mechanism, spec: Spec, parameters: list[float]) -> Balanced:
    """Return the feedback of a SPEC with [feedback] about the robot with these parameters. Raises BadInput
    and ModelError as `design` and `analyse_steady`, and for limits that do not fit the robot.
    """
    section = spec.feedback or FeedbackSection(weights={})
    inputs = [q.name for q in robot.inputs]
    effort = one_for_each(section.effort, inputs, "[feedback] effort")
    torque = one_for_each((spec.limits.torque if spec.limits else None) or (0.0,), inputs, "[limits] torque")
    if min(torque) < 0.0:
        raise BadInput(f"[limits] torque = {min(torque):g} must not be negative; 0 is no limit")
    with naming("[feedback]"):
        steady = analyse_steady(robot, section.motion, parameters)
        return design(steady, section.weights, effort, section.without, list(torque))


def make_guidance(law: ControlLaw, balanced: Balanced, spec: Spec, desired: Desired) -> OnMotion:
    """Return the guidance of a SPEC, with the controller of its backend. Raises BadInput for one that there
    is not."""
    feedback = _made(balanced, spec.simulation.backend)
    used = Balanced(balanced.steady, balanced.K, balanced.limit, feedback)
    return OnMotion(Leg(np.zeros(0), StateFeedback(law, used), Regular()), desired, balanced.used)


def _made(balanced: Balanced, backend: str) -> Feedback | None:
    """Return the C of the feedback as run by a backend; None for casadi."""
    if backend in SCALAR:
        return BalanceInC(balanced, SCALAR[backend])
    if backend in ON_TARGET:
        from ..controllers.balance.on_target import BalanceOnTarget

        return BalanceOnTarget(balanced, backend)
    check_named(backend, (*BACKENDS, *ON_TARGET), "unknown backend")
    return None


def desired_of(balanced: Balanced, spec: Spec) -> Desired:
    """Return the desired motion of a SPEC. Raises BadInput as `Desired`."""
    reference = spec.reference
    x, y, heading = (*(reference.position or ()), 0.0, 0.0, 0.0)[:3]
    motion: Motion | None = None
    if reference.commands is not None:
        motion = commanded(reference.commands, x, y, heading)
    elif course := reference.course:
        motion = on_course(
            SmoothCurve(
                x, y, course.heading, course.speed, course.lengths, course.curvatures, course.rounding
            )
        )
    return Desired(balanced.steady, motion)


def start_of(spec: Spec, balanced: Balanced, desired: Desired) -> np.ndarray | None:
    """Return [q; nu] at t = 0: as desired, changed by [initial] state; None where [initial] gives it
    otherwise. Raises BadInput for an unknown state.
    """
    if spec.initial and spec.initial.state is None:
        return None
    state, names = desired(0.0), balanced.steady.names
    for name, off in (spec.initial.state or {}).items() if spec.initial else ():
        check_named(name, names, "[initial] state: unknown state")
        state[names.index(name)] += off
    return state


__all__ = ["desired_of", "feedback_law", "feedback_of", "make_guidance", "start_of"]
