"""From which starts damped laws and laws with a dynamic extension can begin, without an enclosure of the
whole motion.

What a damped law inverts does not depend on the state: it begins everywhere, whatever robot, sampling, limits
and sensors are.

With a dynamic extension and P_l on the axle the whole motion is that of the outputs, and singular where P_l
stands still; along a path also where the heading is normal to it, |distance'| = |speed|. In the continuous
loop with the controller's parameters the errors obey e^(k) + ... + kd e' + kp e = 0, so that these sizes are
known functions of time. They are bounded between the times at which they are computed: the error state
changes by at most |eps| (exp(|A| h) - 1) in h seconds.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.linalg import expm, solve_continuous_lyapunov

from ...model.law import ControlLaw, symbols
from ...simulation.guidance import OnePath
from ...simulation.loop import Loop
from ...simulation.specification.spec import Spec

LONGEST, SHORTEST = 0.05, 1e-4  # s: steps between the times at which sizes are computed
ROUNDING = 1e-9  # of what is computed, relative to its size at the start


def begins_everywhere(law: ControlLaw) -> bool:
    """Return whether what a damped law inverts is the same in all states."""
    damping, inputs = law.linearization.damping, law.linearization.measures[1:]
    return damping is not None and not inputs and not ca.depends_on(damping.determinant, symbols(law.state))


def centres(loop: Loop, spec: Spec) -> bool:
    """Return whether there are points at which the distance from the path has no gradient,
    such as the centre of a circle."""
    kind = loop.law.output.required_path.kind
    return kind != "segment" and kind != "line" or any(piece.curvature for piece in spec.output.segments)


@dataclass(frozen=True)
class Proof:
    """`least`: a lower bound of what must not vanish (m/s), up to `until` (s; infinite: for ever);
    `lost`: why it ends there."""

    least: float
    until: float
    lost: str = ""


def why_no_closed_form(loop: Loop, spec: Spec, uncertainty: Mapping[str, float]) -> str:
    """Return why the errors of an extended law are not the solutions of their linear equations;
    empty if they are."""
    output, guidance = loop.law.output, loop.guidance
    doubts = [
        (
            any(uncertainty.values()) or not np.array_equal(loop.plant.parameters, loop.believed),
            "the robot's parameters differ",
        ),
        (spec.simulation.period > 0, "the loop is sampled"),
        (loop.limits is not None, "the inputs are limited"),
        (bool(loop.integral.rows), "the loop has integral action"),
        (type(guidance) is not OnePath, "the reference depends on the place of the robot"),
        (spec.output.own, "the output is the robot's own"),
        (
            output.path is not None and output.path.kind not in ("line", "circle"),
            "the distance is one of first order",
        ),
        (bool(loop.law.linearization.measures[1:]), "inputs may lose a direction"),
        (_leaves_joints(loop.law), "joints move that the outputs do not determine"),
    ]
    return next((why for applies, why in doubts if applies), "")


def _leaves_joints(law: ControlLaw) -> bool:
    """Return whether the motion depends on more than the outputs with their derivatives and the place along a
    path."""
    found, system = law.linearization, law.system
    z = ca.vertcat(found.h, found.rate)
    motion = ca.vertcat(z, ca.vec(found.Phi), found.drift, ca.vec(system.S))
    moving = [q for q in system.mechanism.coordinates if ca.depends_on(motion, q.symbol)]
    return len(moving) + system.dof + len(law.extension) > z.numel() + (law.output.path is not None)


class OutputErrors:
    """The errors of the outputs over time, e = y_d - y: `state` (a column for each row: e, e',
    ...) from the start's on."""

    def __init__(self, loop: Loop):
        law = loop.law
        degrees = law.linearization.relative_degree
        h, rate = (
            part.full().ravel()
            for part in law.at_state(law.linearization.h, law.linearization.rate)(
                np.append(loop.start, loop.extension), loop.believed, loop.guidance.leg.config
            )
        )
        desired, gains, rates = loop.guidance.reference(0.0, loop.start), iter(loop.gains), iter(rate)
        self.states, self.matrices, place = [], [], 0
        for first, degree in zip(h, degrees, strict=True):
            y = np.array([first, *[next(rates) for _ in range(degree - 1)]])
            self.states.append(desired[place : place + degree] - y)
            A = np.eye(degree, k=1)
            A[-1] = [-next(gains) for _ in range(degree)]
            self.matrices.append(A)
            place += degree + 1
        self.places = np.cumsum([0, *[degree + 1 for degree in degrees]])[:-1]

    def after(self, h: float) -> None:
        """Go on by h seconds."""
        self.states = [expm(A * h) @ e for A, e in zip(self.matrices, self.states, strict=True)]

    def growth(self) -> tuple[float, float]:
        """Return a and g: in h <= 1/a seconds the states change by at most 2 g a h in all."""
        a = max(float(np.linalg.norm(A, 2)) for A in self.matrices)
        return a, float(sum(np.linalg.norm(e) for e in self.states))

    def bound(self, row: int, order: int) -> float:
        """Return a bound of this derivative of an error from now on, by a Lyapunov function."""
        A, e = self.matrices[row], self.states[row]
        P = solve_continuous_lyapunov(A.T, -np.eye(len(A)))
        return math.sqrt(float(e @ P @ e) * np.linalg.inv(P)[order, order])


def proof_of_motion(loop: Loop, spec: Spec) -> Proof:
    """Return the proof that P_l keeps moving, and along a path that the heading does not become normal to
    it."""
    errors, course = OutputErrors(loop), spec.reference
    start = max(1.0, *(float(np.abs(e).max()) for e in errors.states))
    path = loop.law.output.path
    if path is None:
        bend, least = _bend(spec)
        size: Callable[[list[np.ndarray]], float] = lambda y: math.hypot(y[0][1], y[1][1])  # noqa: E731

        def tail() -> float:
            return least - math.hypot(errors.bound(0, 1), errors.bound(1, 1))
    else:
        bend, speed = 0.0, abs(course.speed or 0.0)
        names = [c.name for c in loop.law.config]
        R = loop.guidance.leg.config[names.index("R")] if path.kind == "circle" else np.inf
        size = lambda y: min(abs(y[1][0]) - abs(y[0][1]), R + y[0][0])  # noqa: E731

        def tail() -> float:
            return min(speed - errors.bound(1, 0) - errors.bound(0, 1), R - errors.bound(0, 0))

    t, found, asked = 0.0, np.inf, LONGEST
    while t < spec.simulation.duration:
        if t >= asked:
            asked = t + LONGEST
            if tail() - ROUNDING * start > found:
                return Proof(found, np.inf)
        reference = loop.guidance.reference(t, loop.start)
        y = [reference[p : p + len(e)] - e for p, e in zip(errors.places, errors.states, strict=True)]
        now, (a, g) = size(y) - ROUNDING * start, errors.growth()
        h = min(LONGEST, 1 / a, now / (2 * (bend + 2 * a * g)) if now > 0 else 0.0)
        if h < SHORTEST:
            return Proof(0.0, t, f"at t = {t:.4g} s it is {max(now, 0.0):.2g} m/s and may vanish")
        found, t = min(found, now / 2), t + h
        errors.after(h)
    if (last := tail() - ROUNDING * start) > 0:
        return Proof(min(found, last), np.inf)
    return Proof(found, spec.simulation.duration)


def _bend(spec: Spec) -> tuple[float, float]:
    """Return the largest acceleration of a desired point, m/s^2, and its least speed, m/s."""
    velocity = math.hypot(*(spec.reference.velocity or (0.0, 0.0))[:2])
    if circle := spec.reference.circle:
        return circle.radius * circle.rate**2, abs(circle.radius * circle.rate) - velocity
    if course := spec.reference.course:
        return course.speed**2 * max(map(abs, course.curvatures)), course.speed - velocity
    return 0.0, velocity
