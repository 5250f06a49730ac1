"""The desired motion of a robot under state feedback: its steady motion, commands, or a course;
as a state x_d(t)."""

import bisect
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ...model.algebra.trigonometry import sine_cosine
from ...readers.errors import BadInput
from ..controllers.balance.steady import Steady, tidy
from ..guidance import vehicle_motion
from ..planning.course import SmoothCurve
from ..specification.feedback import Command

STRAIGHT = 1e-9  # rad: an arc that turns less is a line


@dataclass(frozen=True)
class Along:
    """A place x + i y (m) with a heading (rad), the distance (m) and the turn (rad) up to there, forward
    speed and yaw rate, and their rates.
    """

    place: complex
    heading: float
    distance: float
    turn: float
    speed: float
    yaw_rate: float
    acceleration: float = 0.0
    yaw_acceleration: float = 0.0


Motion = Callable[[float], Along]  # from the time, s


def commanded(commands: Sequence[Command], x: float, y: float, heading: float) -> Motion:
    """Return the motion of commands from a pose, m and rad, one after the other; it stands before and after
    them. The progress of each is a polynomial of degree 5 in time, whose speed and acceleration are 0 at both
    ends.
    """
    begins = list(itertools.accumulate((each.time for each in commands), initial=0.0))
    poses = [(complex(x, y), heading, 0.0)]
    for each in commands:
        place, at, gone = poses[-1]
        poses.append((place + _chord(at, each.distance, each.turn), at + each.turn, gone + each.distance))

    def motion(t: float) -> Along:
        k = bisect.bisect_right(begins, t) - 1
        place, at, gone = poses[min(max(k, 0), len(commands))]
        turned = at - heading
        if not 0 <= k < len(commands):
            return Along(place, at, gone, turned, 0.0, 0.0)
        command = commands[k]
        u = (t - begins[k]) / command.time
        both = u * (1.0 - u)
        part, rate = u * u * u * (10.0 - 15.0 * u + 6.0 * u * u), 30.0 * both * both / command.time
        faster = 60.0 * both * (1.0 - 2.0 * u) / (command.time * command.time)
        distance, turn = command.distance * part, command.turn * part
        moved = place + _chord(at, distance, turn)
        rates = command.distance * rate, command.turn * rate, command.distance * faster, command.turn * faster
        return Along(moved, at + turn, gone + distance, turned + turn, *rates)

    return motion


def _chord(heading: float, distance: float, turn: float) -> complex:
    """Return how far an arc leads that begins in a direction."""
    if abs(turn) < STRAIGHT:
        s, c = sine_cosine(heading)
        return distance * complex(c, s)
    (s, c), (s_e, c_e) = sine_cosine(heading), sine_cosine(heading + turn)
    return distance / turn * complex(s_e - s, c - c_e)


def on_course(curve: SmoothCurve) -> Motion:
    """Return the motion along a course at its speed."""

    def motion(t: float) -> Along:
        gone = curve.speed * t
        heading = curve.direction(gone)
        turn, rate = heading - curve.heading, curve.speed * curve.bend(gone)
        return Along(curve.position(gone), heading, gone, turn, curve.speed, rate)

    return motion


def _times(matrix: np.ndarray, pair: np.ndarray) -> np.ndarray:
    """Return the product with two numbers, the same bits on every processor."""
    return matrix[:, 0] * pair[0] + matrix[:, 1] * pair[1]


class Desired:
    """The desired state x_d(t), (2n-m), of a robot: its steady motion, or one along `motion`.

    Along it, quasi-velocities differ from those of the steady motion by the least that gives forward speed
    and yaw rate, and coordinates that go on, such as angles of wheels, follow them. Coordinates that are
    constant in steady motion, such as the pitch, are where inputs can hold them while the robot accelerates,
    to first order: it leans forward.
    """

    def __init__(self, steady: Steady, motion: Motion | None = None):
        """Raises BadInput for a `motion` of a robot that has no place in the plane."""
        system = steady.partial.system
        if motion and not steady.place:
            raise BadInput(
                f"[reference]: {system.mechanism.name} has no position and heading as coordinates "
                "(moves_in_plane): only its steady motion can be desired; leave out commands and course"
            )
        self._steady, self._motion, self._n, self._place = steady, motion, len(steady.q), steady.place or ()
        self._rates = np.array(steady.rates)
        if motion:
            self._lead()

    def _lead(self) -> None:
        """Find quasi-velocities and rates of coordinates per forward speed and yaw rate,
        and what of these the motion has."""
        steady = self._steady
        system, dof = steady.partial.system, self._steady.partial.system.dof
        made = vehicle_motion(system)
        seen = [
            made([*steady.q, *nu], steady.parameters).full().ravel()[3:5]
            for nu in (np.zeros(dof), *np.eye(dof))
        ]
        slope = np.array(seen[1:]).T - seen[0][:, None]
        self._nu = tidy(np.linalg.pinv(slope))
        self._own = tidy(slope @ steady.nu)
        moves = ca.Function(
            "moves", [system.mechanism.q, system.mechanism.p], [ca.jacobian(system.qdot, system.nu)]
        )
        self._moves = tidy(moves(steady.q, steady.parameters).full() @ self._nu)
        n, held = self._n, list(steady.constant)
        cause = np.hstack([steady.A[n:, held], steady.B[n:]])
        self._lean = tidy(np.linalg.lstsq(cause, self._nu, rcond=None)[0][: len(held)])

    def __call__(self, t: float) -> np.ndarray:
        """Return x_d at t, s."""
        steady, state = self._steady, self._steady.state
        state[: self._n] += self._rates * t
        if self._motion is None:
            if self._place:
                x, y, heading = self._place
                state[[x, y]] = np.array(steady.q)[[x, y]] + self._arc(
                    self._rates[[x, y]], self._rates[heading], t
                )
            return state
        along = self._motion(t)
        state[: self._n] += _times(self._moves, np.array([along.distance, along.turn]) - self._own * t)
        state[self._n :] += _times(self._nu, np.array([along.speed, along.yaw_rate]) - self._own)
        state[list(steady.constant)] += _times(
            self._lean, np.array([along.acceleration, along.yaw_acceleration])
        )
        state[list(self._place)] = along.place.real, along.place.imag, along.heading
        return state

    @staticmethod
    def _arc(velocity: np.ndarray, yaw_rate: float, t: float) -> np.ndarray:
        """Return how far a constant velocity in axes that turn leads from heading 0, m."""
        chord = _chord(0.0, t, yaw_rate * t)
        moved = complex(*velocity) * chord
        return np.array([moved.real, moved.imag])
