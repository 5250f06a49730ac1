"""Robot, controller and closed loop as systems of python-control, their signals named as in the model and in
C.

`control.interconnect` joins them by these names: states and inputs of the robot (x_c, ..., tau_r, tau_l),
references of the law (distance, distance_rate, ...; speed, speed_rate). The robot has no outputs of its own:
the controller measures its state.
"""

import control
import numpy as np

from ...readers.errors import BadInput
from ...readers.reading import positive
from ...simulation.controllers.controller import Controller
from ...simulation.controllers.integral import IntegralAction
from ...simulation.loop import RUNNING, Loop
from ...simulation.plant import Plant
from .motion import SteadyMotion, coordinates, functions

SHORTEST = 1e-12  # s, of a step with a torque held
TOLERANCE = 1e-12  # relative, of such a step


class ControllerRefused(BadInput):
    """The controller returned an error when called by python-control: singular, not finite, out of range."""


def robot_system(plant: Plant, name: str | None = None) -> control.NonlinearIOSystem:
    """The true robot in continuous time: inputs tau (N, N m), states and outputs [q; nu], SI (11)."""
    states, inputs = _names(plant)
    return control.nlsys(
        lambda t, x, u, params: plant.rate(x, u),
        lambda t, x, u, params: x,
        states=states,
        inputs=inputs,
        outputs=states,
        name=name or plant.system.mechanism.name,
    )


def sampled_robot_system(
    plant: Plant, period: float, tolerance: float = TOLERANCE, name: str | None = None
) -> control.NonlinearIOSystem:
    """The true robot in discrete time, the inputs held over each `period` (s); integrated to `tolerance`."""
    positive("period", period, "robot")
    states, inputs = _names(plant)
    return control.nlsys(
        lambda t, x, u, params: hold(plant, x, u, period, tolerance),
        lambda t, x, u, params: x,
        states=states,
        inputs=inputs,
        outputs=states,
        dt=period,
        name=name or plant.system.mechanism.name,
    )


def controller_system(
    controller: Controller, period: float | None = None, name: str = "controller"
) -> control.NonlinearIOSystem:
    """Return the law, in any backend: inputs [q; nu] and reference, outputs tau. It has no state.

    With a period (s) it is a discrete-time system. If the controller returns an error, ControllerRefused is
    raised. Raises BadInput for a law with a dynamic extension: python-control first evaluates the parts of a
    loop at zero inputs, where such a law is singular.
    """
    law = controller.law
    states, desired = [q.name for q in law.system.state], [q.name for q in law.reference]
    if law.extension:
        raise BadInput(f"{law.name} has a dynamic extension: use closed_loop_system, in which its states are")
    return control.nlsys(
        None,
        lambda t, x, u, params: command(controller, u[: len(states)], u[len(states) :]),
        inputs=[*states, *desired],
        outputs=[q.name for q in law.system.mechanism.inputs],
        dt=period or 0.0,
        name=name,
    )


def integral_system(
    controller: Controller, action: IntegralAction, period: float | None = None, name: str = "integral"
) -> control.NonlinearIOSystem:
    """Integral action around a controller: dz/dt = y_d - y, or z+ = z + period (y_d - y), without limits.

    Inputs: [q; nu] and every reference by its name with _d after it; outputs: the references that the
    controller takes, ki z added to the desired derivatives of highest order.
    """
    law = controller.law
    n, desired = len(law.system.state), [q.name for q in law.reference]

    def update(t: float, z: np.ndarray, u: np.ndarray, params: dict) -> np.ndarray:
        error = action.error(controller.evaluate(u[:n], u[n:]), u[n:])
        return z + period * error if period else error

    def references(t: float, z: np.ndarray, u: np.ndarray, params: dict) -> np.ndarray:
        return action.added(u[n:], action.ki * z)

    return control.nlsys(
        update,
        references,
        states=[f"{row}_integral" for row in action.rows],
        inputs=[*[q.name for q in law.system.state], *(f"{w}_d" for w in desired)],
        outputs=desired,
        dt=period or 0.0,
        name=name,
    )


def closed_loop_system(
    loop: Loop, period: float | None = None, name: str = "closed_loop"
) -> control.NonlinearIOSystem:
    """Robot and controller of a loop joined: states [q; nu] and those of a dynamic extension, inputs the
    references, outputs [q; nu] and tau.

    With a period (s) as a discrete-time system, torque held. With integral action its z are states too, the
    last ones, and the references end in _d, as for `integral_system`. Raises BadInput for drives that take
    velocities.
    """
    if loop.drive.commands:
        raise BadInput("these systems take torques: not with drives that take velocities")
    if loop.observers.rows:
        raise BadInput("gains: ko: these systems have no disturbance observers; leave it out, or take ki")
    law, controller = loop.law, loop.guidance.leg.controller
    if law.output.foot:
        raise BadInput(
            f"{law.name} follows a course, whose parameters change with every step: not in these systems"
        )
    if law.extension and loop.integral.rows:
        raise BadInput(
            f"{law.name} has a dynamic extension: its closed loop has no integral action here; leave ki out"
        )
    if law.extension:
        return _extended_loop(loop, period, name)
    robot = sampled_robot_system(loop.plant, period) if period else robot_system(loop.plant)
    parts = [robot, controller_system(controller, period)]
    desired = [q.name for q in law.reference]
    if loop.integral.rows:
        parts.append(integral_system(controller, loop.integral, period))
        desired = [f"{w}_d" for w in desired]
    outputs = [*[q.name for q in law.system.state], *[q.name for q in law.system.mechanism.inputs]]
    return control.interconnect(parts, inputs=desired, outputs=outputs, name=name)


def _extended_loop(loop: Loop, period: float | None, name: str) -> control.NonlinearIOSystem:
    """Return the closed loop of a law with a dynamic extension, whose states are the last ones."""
    law, controller, n = loop.law, loop.guidance.leg.controller, len(loop.start)
    states, inputs = _names(loop.plant)

    def update(t: float, x: np.ndarray, desired: np.ndarray, params: dict) -> np.ndarray:
        tau = command(controller, x, desired)
        if period is None:
            return np.append(loop.plant.rate(x[:n], tau), controller.extension_rate)
        return np.append(
            hold(loop.plant, x[:n], tau, period, TOLERANCE), x[n:] + period * controller.extension_rate
        )

    return control.nlsys(
        update,
        lambda t, x, desired, params: np.append(x[:n], command(controller, x, desired)),
        states=[q.name for q in law.state],
        inputs=[q.name for q in law.reference],
        outputs=[*states, *inputs],
        dt=period or 0.0,
        name=name,
    )


class Moving:
    """Robot and controller of a steady motion in coordinates rho in which it stands still,
    as systems of python-control."""

    def __init__(self, motion: SteadyMotion, controller: Controller):
        """`controller` in any backend, with the numbers of motion.setting. Raises BadInput for a motion with
        velocity drives."""
        if motion.setting.drive:
            raise BadInput("these systems take torques: not with drives that take velocities")
        if motion.setting.law.extension:
            raise BadInput("these systems have no states of a controller: not with a dynamic extension")
        self._motion, self._controller = motion, controller
        self._setting, self._functions = motion.setting, functions(motion.setting.law, ())
        self.names = list(coordinates(motion.setting.law))
        self._inputs = [q.name for q in motion.setting.law.system.mechanism.inputs]

    def state(self, rho: np.ndarray) -> np.ndarray:
        """A state [q; nu] at rho, by Newton's method from one of the steady motion."""
        x = self._motion.state.copy()
        for _ in range(30):
            values = self._functions(self._setting, x, np.zeros(0), self._motion.torque)
            step = np.linalg.pinv(values["P"]) @ (rho - values["rho"])
            x += step
            if np.abs(step).max() <= 1e-14 * max(1.0, np.abs(x).max()):
                break
        return x

    def coordinates(self, x: np.ndarray) -> np.ndarray:
        """rho of a state [q; nu]."""
        return self._functions(self._setting, x, np.zeros(0), self._motion.torque)["rho"]

    def robot_system(self) -> control.NonlinearIOSystem:
        """From tau to rho: states and outputs rho."""

        def rate(t: float, rho: np.ndarray, tau: np.ndarray, params: dict) -> np.ndarray:
            return self._functions(self._setting, self.state(rho), np.zeros(0), tau)["r"]

        signals = {"states": self.names, "inputs": self._inputs, "outputs": self.names}
        return control.nlsys(rate, lambda t, rho, tau, params: rho, name="robot", **signals)

    def controller_system(self) -> control.NonlinearIOSystem:
        """From rho to tau, at the motion's reference."""

        def answer(t: float, x: np.ndarray, rho: np.ndarray, params: dict) -> np.ndarray:
            return command(self._controller, self.state(rho), self._setting.reference)

        return control.nlsys(None, answer, inputs=self.names, outputs=self._inputs, name="controller")

    def closed_loop_system(self) -> control.InterconnectedSystem:
        """The closed loop of both: inputs are disturbances of tau, states rho, outputs rho and tau."""
        parts = [self.robot_system(), self.controller_system()]
        return control.interconnect(
            parts, inputs=self._inputs, outputs=[*self.names, *self._inputs], name="closed_loop"
        )


def command(controller: Controller, state: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Return tau. Raises ControllerRefused if the controller returns an error."""
    status, tau = controller.step(state, reference)
    if status not in RUNNING:
        raise ControllerRefused(
            f"{controller.law.name}: the controller returns {status!r} at state {np.array2string(state)}"
        )
    return tau


def hold(plant: Plant, x: np.ndarray, tau: np.ndarray, duration: float, tolerance: float) -> np.ndarray:
    """State after `duration` s of constant tau. Raises BadInput where it cannot be integrated."""
    left = h = duration
    while left > 0:
        h = min(h, left)
        after, error = plant.step(x, tau, h, tolerance)
        if error <= 1:
            x, left = after, left - h
            continue
        if h <= SHORTEST:
            raise BadInput(
                f"{plant.system.mechanism.name}: the motion with tau held cannot be integrated to "
                f"{tolerance:g}"
            )
        h *= max(0.2, 0.9 * error**-0.125) if np.isfinite(error) else 0.2
    return x


def _names(plant: Plant) -> tuple[list[str], list[str]]:
    return [q.name for q in plant.system.state], [q.name for q in plant.system.mechanism.inputs]
