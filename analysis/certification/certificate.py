"""Encloses the motions of a closed loop for all uncertain parameters,
until it is proved regular for ever or the proof fails."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...model.linearization import SINGULAR
from ...simulation.specification.spec import Simulation
from .enclosed_loop import EnclosedLoop, Inputs
from .enclosure import Bounds
from .tube import Flow, Lost, Tube, TubeStep

LONGEST, STEPS = 0.05, 6000  # longest step of a continuous loop, s; most steps
SETTLED = 1e-3  # relative to 1 + |x|: minimum width of a set that is tested for invariance
# s: motions count as approaching the singular set if they would reach it within this time at their present
# rate
SOON = 0.5
WIDER = 4  # how often the set of a settled motion is widened, each time by a factor of 4
STILL = 1e-9  # relative to 1 + |x|: largest change of a motion at rest
PROBE = 1e-6  # deviation whose growth determines whether an equilibrium is stable
NEAR_JOINT = 1e-4  # m: closer than this to a joint of the path, the motion crosses it
AGAIN = 1.2  # factor of the time until the next attempt


@dataclass
class Course:
    """The proved result: regular up to `until` (s), for ever if `invariant`; `margin`: lower bound of |det
    Phi| over its row norms.

    `largest`: upper bound of |s|; `lost`: why no more is proved, empty if the end was reached; `t` (s) and
    `s` of the nominal motion. `unstable`: it rests at an equilibrium that is not stable. `approaching`: all
    motions approach the singular set, and none would have reached it earlier at its present rate; `approach`:
    which deviations of the parameters (1: the largest) bring them nearer; `shares`: what each parameter's
    spread contributes to the width of the set in its coordinates, relative to that width and summed. Both are
    None before the first step.
    """

    until: float = 0.0
    margin: float = 1.0
    largest: float = 0.0
    invariant: bool = False
    lost: str = ""
    t: list[float] = field(default_factory=list)
    s: list[float] = field(default_factory=list)
    unstable: bool = False
    approaching: bool = False
    approach: np.ndarray | None = None
    shares: np.ndarray | None = None


@dataclass(frozen=True)
class Settled:
    """The motions whose deviation differs by at most `width` from the part of `tube` that is linear in the
    parameters."""

    tube: Tube
    width: np.ndarray

    @property
    def start(self) -> Tube:
        """The tube of these motions."""
        return Tube(self.tube.centre, self.tube.S, np.diag(self.width), self.tube.spread)

    def holds(self, tube: Tube) -> bool:
        """Whether it contains all motions of a tube."""
        reach = (
            np.abs(tube.centre - self.tube.centre) + np.abs(tube.S - self.tube.S) @ tube.spread + tube.rest
        )
        return bool((reach <= self.width).all())


class _Stop(Exception):
    """The proof cannot be continued."""


class _Standing(_Stop):
    """A motion may stop where two segments of a path join."""

    def __init__(self) -> None:
        super().__init__("a motion may stand where two pieces of the path join")


class _Field:
    """A rate of change along a path whose curvature may be that of any reachable segment."""

    def __init__(self, loop: EnclosedLoop):
        self.loop = loop
        # The curvature at the nominal motion, if it is an argument
        self.curvature = np.zeros(0 if loop.along is None else 1)

    def near(self, tube: Tube, moved: np.ndarray, growth: np.ndarray) -> tuple[np.ndarray, bool]:
        """Return by how much the curvature may differ from `curvature` for advancing motions,
        and whether they must advance."""
        loop = self.loop
        if loop.along is None:
            return self.curvature, False
        place, far = tube.centre[loop.along], tube.radius[loop.along]
        reach = far + (growth + moved)[loop.along]
        middle, half = loop.curvatures.within(place - far, place + reach)
        self.curvature = np.array([middle])
        return np.array([half]), loop.curvatures.within(place - reach, place + reach) != (middle, half)

    def advancing(self, rate: Bounds, has_to: bool) -> bool:
        """Whether all motions advance along the path, if they must."""
        at = self.loop.along
        return not has_to or bool(rate.value[at] > rate.moved[at] + rate.radius[at])


class _Held(_Field):
    """The plant with its inputs held: x = [z; integrals; held; next],
    in which the inputs from `first` on act."""

    def __init__(self, loop: EnclosedLoop, first: int):
        super().__init__(loop)
        self._first = first

    def _arguments(self, *parts: np.ndarray) -> list[np.ndarray]:
        n, r = len(self.loop.z), len(self.loop.most)
        return [np.concatenate([part[:n], part[self._first : self._first + r]]) for part in parts]

    def tangent(self, x: np.ndarray, bounds: Bounds | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """See RateOfChange."""
        n, r, count = len(self.loop.z), len(self.loop.most), len(self.loop.spread)
        value, slope = self.loop.plant.tangent(
            np.concatenate([*self._arguments(x), self.loop.nominal, self.curvature])
        )
        rate, A, B = np.zeros(len(x)), np.zeros((len(x), len(x))), np.zeros((len(x), count))
        rate[:n], A[:n, :n], B[:n] = value, slope[:, :n], slope[:, n + r : n + r + count]
        A[:n, self._first : self._first + r] = slope[:, n : n + r]
        return rate, A, B

    def bounds(self, tube: Tube, moved: np.ndarray, growth: np.ndarray) -> Bounds:
        """See RateOfChange."""
        loop, n, count = self.loop, len(self.loop.z), len(tube.spread)
        half, has_to = self.near(tube, moved, growth)
        parts = (tube.centre, moved, tube.radius + growth, growth, tube.S, tube.G)
        x, moved, radius, growth, S, G = self._arguments(*parts)
        none = np.zeros(count)
        rate = loop.plant.bounds(
            np.concatenate([x, loop.nominal, self.curvature]),
            np.concatenate([moved, none, 0 * half]),
            np.concatenate([radius, tube.spread, half]),
            np.concatenate([0 * x, none, half]),
        )
        S, G = np.vstack([S, np.eye(count), np.zeros((len(half), count))]), _padded(G, count + len(half))
        rate = rate.of(S, G, tube.spread, np.concatenate([growth, none, half]))
        if not self.advancing(rate, has_to):
            raise _Standing
        entries = (rate.value, rate.slope, rate.moved, rate.radius, rate.rest, rate.turned)
        return Bounds(*[_padded(entry, len(tube.centre) - n) for entry in entries])


class _Closed(_Field):
    """Plant and law together: x = [z; integrals]."""

    def __init__(self, loop: EnclosedLoop, fixed: np.ndarray):
        super().__init__(loop)
        self._fixed = fixed
        self._inputs: Inputs | None = None

    def tangent(self, x: np.ndarray, bounds: Bounds | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """See RateOfChange."""
        loop, m, n, r, count = self.loop, len(x), len(self.loop.z), len(self.loop.most), len(self.loop.spread)
        value, slope = loop.law.tangent(np.concatenate([x, self.curvature]), self._fixed)
        tau = loop.limited(value)
        rate, by = loop.plant.tangent(np.concatenate([x[:n], tau, loop.nominal, self.curvature]))
        rate = np.concatenate([rate, value[r : r + m - n]])
        if bounds is None or self._inputs is None:
            return rate, np.zeros((m, m)), np.zeros((m, count))
        A = np.vstack([by[:, n : n + r] @ self._inputs.slope(slope)[:, :m], slope[r : r + m - n, :m]])
        A[:n, :n] += by[:, :n]
        return rate, A, _padded(by[:, n + r : n + r + count], m - n)

    def bounds(self, tube: Tube, moved: np.ndarray, growth: np.ndarray) -> Bounds:
        """See RateOfChange."""
        loop, n, r, m, count = (
            self.loop,
            len(self.loop.z),
            len(self.loop.most),
            len(tube.centre),
            len(tube.spread),
        )
        half, has_to = self.near(tube, moved, growth)
        law = loop.law_bounds(tube, self.curvature, half, moved, growth, self._fixed)
        self._inputs = loop.inputs(law)
        tau, errors, none = self._inputs.bounds, law.rows(slice(r, r + m - n)), np.zeros(count)
        plant = loop.plant.bounds(
            np.concatenate([tube.centre[:n], tau.value, loop.nominal, self.curvature]),
            np.concatenate([moved[:n], tau.moved, none, 0 * half]),
            np.concatenate([tube.radius[:n] + growth[:n], tau.radius, tube.spread, half]),
            np.concatenate([np.zeros(n), tau.rest, none, half]),
        )
        slope = tau.slope[:, :m]
        S = np.vstack([tube.S[:n], slope @ tube.S, np.eye(count), np.zeros((len(half), count))])
        G = np.vstack([tube.G[:n], slope @ tube.G, np.zeros((count + len(half), tube.G.shape[1]))])
        apart = np.abs(tau.slope) @ np.concatenate([growth, half]) + tau.turned
        plant = plant.of(S, G, tube.spread, np.concatenate([growth[:n], apart, none, half]))
        if not self.advancing(plant, has_to):
            raise _Standing
        parts = ("value", "moved", "radius", "rest", "turned")
        value, *rest = (np.concatenate([getattr(plant, name), getattr(errors, name)]) for name in parts)
        return Bounds(value, np.zeros((m, 0)), *rest)


def _padded(part: np.ndarray, rows: int) -> np.ndarray:
    return np.concatenate([part, np.zeros((rows, *part.shape[1:]))])


class Certificate:
    """Integrates an EnclosedLoop. `invariant`: sets of motions that stay regular for ever."""

    def __init__(self, loop: EnclosedLoop, simulation: Simulation, invariant: tuple[Settled, ...] = ()):
        self._loop, self._simulation, self._course = loop, simulation, Course()
        self._t, self._steps, self._count = 0.0, 0, len(loop.loop.integral.rows)
        self._invariant, self._tried = invariant, invariant[:0]
        self._kept: tuple[Tube, float, Course] | None = None  # state before a set was widened
        self._flows: dict[Any, Flow] = {}
        self._before: Tube | None = None
        self._deadline = -np.inf
        self._next = 0.0

    @property
    def settled(self) -> tuple[Settled, ...]:
        """The set that was found to be invariant."""
        return self._tried if self._course.invariant else ()

    def run(self, tube: Tube | None = None) -> Course:
        """Return the proved result for the motions from the start, or from a tube."""
        tube = tube or self._first()
        try:
            self._rest(tube)
            self._guard(tube.centre, 0 * tube.centre, tube.radius)
            self._follow(tube)
        except Lost:
            self._course.lost = "the bounds grow without limit"
        except _Stop as stop:
            self._course.lost = str(stop)
        return self._course

    def _first(self) -> Tube:
        """Return the tube of the start."""
        start, inputs = self._loop.start, len(self._loop.most)
        count = self._count + (2 * inputs if self._simulation.period else 0)
        centre = np.concatenate([start.value, np.zeros(count)])
        return Tube(
            centre, _padded(start.slope, count), _padded(np.diag(start.rest), count), self._loop.spread
        )

    def _follow(self, tube: Tube) -> None:
        """Integrate to the end, or until the set of motions is invariant. Raises Lost and _Stop."""
        period = self._simulation.period
        while not self._ended():
            try:
                tube = self._turn(tube, self._passed)
                if period:
                    self._t = round(self._t / period) * period
                tube = self._tried_again(tube)
            except (Lost, _Stop):
                if not self._kept:
                    raise
                self._next = 2 * self._t
                tube, self._t, self._course = self._kept  # the set that was widened was too wide
                self._kept, self._tried = None, ()

    # -- integration -----------------------------------------------------------------------------------------

    def _turn(self, tube: Tube, passed: Callable[[TubeStep], Tube]) -> Tube:
        """Integrate one period of a sampled loop or one step of a continuous one,
        and check every step by `passed`."""
        loop, simulation = self._loop, self._simulation
        if not simulation.period:
            # Common times of courses
            end = min((int(self._t / LONGEST + 1e-9) + 1) * LONGEST, simulation.duration)
            return passed(
                self._flow(_Closed, self._fixed()).step(tube, min(end - self._t, self._to_joint(tube)))
            )
        first, r = len(loop.z) + self._count, len(loop.most)
        tube = self._called(tube)
        for begin, duration in ((first, simulation.delay), (first + r, simulation.period - simulation.delay)):
            flow = self._flow(_Held, begin)
            while duration > 1e-9 * simulation.period:
                step = flow.step(tube, duration)
                tube, duration = passed(step), duration - step.h
        return _handed_on(tube, first, r)

    def _to_joint(self, tube: Tube) -> float:
        """Return a duration (s) in which most motions stay on their segment of the path,
        or change it together."""
        loop = self._loop
        if loop.along is None:
            return np.inf
        place, far = tube.centre[loop.along], tube.radius[loop.along]
        speed = max(abs(tube.centre[loop.first]), STILL)
        left = loop.curvatures.left(place - far)
        return max(0.7 * (left - 2 * far) if left > 2 * far else far / 3, NEAR_JOINT) / speed

    def _flow(self, kind: type, argument: Any) -> Flow:
        """The integrator, kept between steps because it adapts its step length."""
        key = (kind, argument if isinstance(argument, int) else argument.tobytes())
        if key not in self._flows:
            self._flows[key] = Flow(kind(self._loop, argument))
        return self._flows[key]

    def _called(self, tube: Tube) -> Tube:
        """Return the tube with the inputs of the controller and the integrals of the next call."""
        loop, r, n, fixed = self._loop, len(self._loop.most), len(self._loop.z), self._fixed()
        m = n + self._count
        part, none = Tube(tube.centre[:m], tube.S[:m], tube.G[:m], tube.spread), np.zeros(m)
        rate = _Field(loop)
        half, _ = rate.near(part, none, none)
        law = loop.law_bounds(part, rate.curvature, half, none, none, fixed)
        inputs, errors = loop.inputs(law), law.rows(slice(r, r + self._count))
        if not (inputs.bounds.finite and errors.finite):
            raise Lost
        size, T = len(tube.centre), self._simulation.period
        centre, A, rest = tube.centre.copy(), np.eye(size), np.zeros(size)
        upcoming, summed = slice(m + r, m + 2 * r), slice(n, m)
        centre[upcoming], rest[upcoming] = inputs.bounds.value, inputs.bounds.rest
        A[upcoming] = 0.0
        A[upcoming, :m] = inputs.slope(law.slope)[:, :m]
        centre[summed] += T * errors.value
        A[summed, :m] += T * errors.slope[:, :m]
        rest[summed] = T * errors.rest
        return tube.map(centre, A, np.zeros_like(tube.S), rest)

    def _rest(self, tube: Tube) -> None:
        """Raise _Stop if the nominal motion is at an unstable equilibrium."""
        if not self._loop.settles:
            return
        m, count = len(self._loop.z) + self._count, len(tube.centre)
        probe = Tube(tube.centre, 0 * tube.S, PROBE * np.eye(count)[:, :m], 0 * tube.spread)
        try:
            after = self._turn(probe, lambda step: step.tube)
        except (Lost, _Stop):
            return
        if (np.abs(after.centre - tube.centre) > STILL * (1 + np.abs(tube.centre)))[:m].any():
            return
        if np.abs(np.linalg.eigvals(after.G[:m, :m] / PROBE)).max() > 1 + 1e-6:
            self._course.unstable = True
            raise _Stop("the equilibrium is not stable")

    def _fixed(self) -> np.ndarray:
        """Return the present config and reference of the law."""
        loop = self._loop
        reference = (
            loop.loop.guidance.reference(self._t, loop.loop.start)
            if loop.reference is None
            else loop.reference
        )
        return np.concatenate([loop.constants, reference])

    # -- checks of a step ------------------------------------------------------------------------------------

    def _passed(self, step: TubeStep) -> Tube:
        """Return the result of a step after checking that the states in between are regular."""
        self._approach(step, self._guard(step.centre, step.moved, step.radius))
        self._t += step.h
        self._steps += 1
        if self._steps > STEPS:
            raise _Stop(f"more than {STEPS} steps would be needed to go on")
        self._course.until = self._t
        return step.tube

    def _guard(self, centre: np.ndarray, moved: np.ndarray, radius: np.ndarray) -> Bounds:
        """Return the bounds of the guard. Raises _Stop unless every state is proved to be regular."""
        loop, n, course = self._loop, len(self._loop.z), self._course
        curvature = half = np.zeros(0)
        if loop.along is not None:
            place, reach = centre[loop.along], (moved + radius)[loop.along]
            if place + reach >= loop.stop:
                raise _Stop(
                    "the desired speed changes along the path from here on, which this proof does not cover"
                )
            curvature, half = (
                np.array([part]) for part in loop.curvatures.within(place - reach, place + reach)
            )
        near = np.concatenate([moved[:n], 0 * half]), np.concatenate([radius[:n], half])
        bounds = loop.guard.bounds(np.concatenate([centre[:n], curvature]), *near, fixed=loop.constants)
        size, scale, determinant, s, *inputs = bounds.value
        spread = bounds.moved + bounds.radius
        if not (
            bounds.finite
            and abs(determinant) > spread[2]
            and size - spread[0] > SINGULAR * (scale + spread[1])
        ):
            raise _Stop("a motion may become singular")
        if inputs and not inputs[0] - spread[4] > SINGULAR * (inputs[1] + spread[5]):
            raise _Stop("inputs may lose a direction")
        least = (size - spread[0]) / (scale + spread[1])
        course.margin, course.largest = (
            min(course.margin, float(least)),
            max(course.largest, float(abs(s) + spread[3])),
        )
        course.t.append(self._t)
        course.s.append(float(s))
        return bounds

    def _approach(self, step: TubeStep, guard: Bounds) -> None:
        """Record whether all motions of a step are near the singular set and approach it."""
        n, course = len(self._loop.z), self._course
        side = np.sign(guard.value[2])
        slope, rate = side * guard.slope[2, :n], step.rate
        nearer = -(slope @ rate.value[:n]) - np.abs(slope) @ (rate.moved + rate.radius)[:n]
        farthest = abs(guard.value[2]) + guard.moved[2] + guard.radius[2]
        if farthest < SOON * nearer:
            self._deadline = self._t + farthest / nearer
        course.approaching = self._t <= self._deadline
        course.approach = -np.sign(slope @ step.tube.S[:n])
        width = np.maximum(step.tube.radius[:n], np.finfo(float).tiny)
        course.shares = step.tube.spread * (np.abs(step.tube.S[:n]) / width[:, None]).sum(axis=0)

    def _ended(self) -> bool:
        return self._course.invariant or self._t >= self._end

    @property
    def _end(self) -> float:
        return self._simulation.duration - 1e-9

    def _tried_again(self, tube: Tube) -> Tube:
        """For a settled motion, return whether the set of states is contained in an earlier one;
        else a wider set is tried."""
        if not self._loop.settles:
            return tube
        if any(each.holds(tube) for each in (*self._invariant, *self._tried)):
            self._course.invariant = True
            return tube
        if self._t < self._next:
            return tube
        self._next = AGAIN * self._t + 0.1
        width = np.maximum(2 * tube.rest, SETTLED * (1 + np.abs(tube.centre)))
        width[tube.radius == 0] = 0.0  # unused entries
        last, self._before = self._before, tube
        if (
            last is not None
            and (np.abs(tube.centre - last.centre) <= STILL * (1 + np.abs(tube.centre))).all()
        ):
            self._rest(tube)
        if last is None or not (np.abs(tube.centre - last.centre) <= width)[: len(self._loop.z)].all():
            return tube
        course = self._course
        self._kept = self._kept or (tube, self._t, replace(course, t=course.t[:], s=course.s[:]))
        self._tried = (Settled(tube, width),)
        return self._tried[0].start


def _handed_on(tube: Tube, first: int, r: int) -> Tube:
    """Apply the computed inputs until those of the next call."""
    acting, upcoming = slice(first, first + r), slice(first + r, first + 2 * r)
    centre, S, G = tube.centre.copy(), tube.S.copy(), tube.G.copy()
    for part in (centre, S, G):
        part[acting], part[upcoming] = part[upcoming], 0.0
    return Tube(centre, S, G, tube.spread)


def widest(loop: EnclosedLoop, simulation: Simulation) -> tuple[Settled, ...]:
    """Return the widest set found of motions that stay regular for ever;
    none if the start does not lead into one."""
    certificate = Certificate(loop, simulation)
    certificate.run()
    invariant = certificate.settled
    for _ in range(WIDER if invariant else 0):
        wider = Settled(invariant[0].tube, 4 * invariant[0].width)
        if not Certificate(loop, simulation, invariant).run(wider.start).invariant:
            break
        invariant = (wider,)
    return invariant
