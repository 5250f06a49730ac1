"""Verdicts about zero dynamics, compared with runs of the robot under the law before they are given.

The runs integrate x' = (S nu, u) with the second feedback (20) of the law, v = 0, by CasADi: nothing of the
symbolic derivation of the zero dynamics is used. Parameters are at their defaults. From a state of straight
driving, or at rest, the runs begin at small deviations of all states that leave the outputs and their
derivatives as they are. The deviations after a time T are a matrix times those before; its eigenvalues are
exp(r T) with the rates r of the zero dynamics.
"""

from collections.abc import Sequence
from dataclasses import replace

import casadi as ca
import numpy as np
import sympy as sp
from scipy.linalg import null_space
from scipy.optimize import linear_sum_assignment

from ...model.algebra.integration import runge_kutta
from ...model.linearization import Linearization, linearize
from ...model.names import LawName
from ...model.outputs import forward_speed, output_map
from ...readers.errors import Contradiction
from ...simulation.controllers.balance.steady import analyse_at_rest, listed
from .normal_form import ExtendedForm, NormalForm, PartialForm, StraightMotion
from .shape import Shape, posture_names

DEVIATION = 1e-5  # of a state at the start of a run
STEPS = 25  # of a run, by the method of Runge and Kutta
LONGEST = 0.5  # of a run, times the fastest rate
AGREE = 1e-3  # between rates, relative to the fastest
DIRECTION = 0.5  # rad, of straight driving
AT_REST = 1e-9  # rates of what must not move
SIZE = 0.7  # of parameters whose default is 0
STATES = 4  # random states at which an equation is compared


def confirm(form: NormalForm) -> None:
    """Raise Contradiction unless runs of the robot have the signs and rates that the normal form states."""
    linearization = form.decoupling.linearization
    if isinstance(form, PartialForm):
        return _confirm_at_rest(form, linearization)
    if not isinstance(form, ExtendedForm):
        _confirm_that_it_stands(form, linearization)
    for moving in form.moving:
        V = sp.Symbol(form.decoupling.names["V"])
        rates = [V * each.rate for each in moving.shape.followers] + (
            [] if moving.rate is None else [moving.rate]
        )
        if rates:
            _confirm_straight(form, _on_a_line(linearization), rates, moving.shape)
        aside = any(arm and arm.left != 0 for arm in form.decoupling.arms)
        if moving.lookahead is not None and linearization.output.path and not aside:
            _confirm_on_the_path(form, linearization, moving)


def _confirm_straight(
    form: NormalForm, linearization: Linearization, rates: Sequence[sp.Expr], shape: Shape
) -> None:
    """Compare the rates, 1/s, with straight runs, forward and in reverse."""
    run = _Run(linearization, form, DIRECTION if shape.turns else 0.0)
    for V in (1.0, -1.0):
        state = run.straight(V, shape)
        still = run.is_still(state) if shape.decided or np.isfinite(state).all() else False
        if still:
            run.compare(state, np.array(run.numbers_of(rates, V)), f"at {V:g} m/s", shape.decided)
        elif shape.decided:
            raise _contradiction(form, "it can drive straight", "it turns, or its outputs do")


def _confirm_at_rest(form: PartialForm, linearization: Linearization) -> None:
    """Compare the modes with a run from rest."""
    if form.modes is None:
        return
    run = _Run(linearization, form, size=0.0)
    run.compare(analyse_at_rest(linearization.system.mechanism).state, form.modes, "at rest")


def _confirm_that_it_stands(form: NormalForm, linearization: Linearization) -> None:
    """Compare z3' = 0: with all outputs and their rates zero at a regular state, the robot is at rest."""
    if form.offset is None or any(form.offset.values()):
        return
    run = _Run(linearization, form)
    first = [k for k, degree in enumerate(linearization.relative_degree) if degree == 1]
    rates = ca.vertcat(linearization.rate, *[linearization.h[k] for k in first])
    function = ca.Function("rates", run.arguments, [rates, ca.jacobian(rates, linearization.system.nu)])
    draw, n = np.random.default_rng(1992), len(linearization.system.mechanism.coordinates)
    for _ in range(STATES):
        state = np.concatenate([draw.uniform(-1, 1, n), np.zeros(linearization.system.dof)])
        at_rest, slopes = (part.full() for part in function(state, run.parameters, run.config))
        if (
            np.isfinite(slopes).all()
            and np.linalg.matrix_rank(slopes) == len(slopes)
            and np.abs(at_rest).max() > AT_REST
        ):
            raise _contradiction(
                form,
                "it rests while the outputs do",
                f"outputs change at {np.abs(at_rest).max():.1e} at rest",
            )


def _confirm_on_the_path(form: NormalForm, linearization: Linearization, moving: StraightMotion) -> None:
    """Compare l s' = -V (s - l chi) with the motion at random places of the path:
    s by the law's own distance."""
    run, system = _Run(linearization, form), linearization.system
    (through, *_), q = [row.through for row in linearization.output.rows if row.through], system.mechanism.q
    vehicle = system.mechanism.required_vehicle
    normal = ca.gradient(through.outer, through.symbols) / ca.norm_2(
        ca.gradient(through.outer, through.symbols)
    )
    bend = ca.trace(ca.jacobian(normal, through.symbols))
    (normal, bend) = ca.substitute([normal, bend], [through.symbols], [through.inner])
    heading = ca.vertcat(ca.cos(vehicle.heading), ca.sin(vehicle.heading))
    s, beside = ca.dot(normal, heading), normal[1] * heading[0] - normal[0] * heading[1]
    qdot = system.S @ ca.solve(linearization.Phi, ca.vertcat(0, 1))  # along the path at 1 m/s
    (length,) = run.numbers_of([moving.lookahead], 1.0) if moving.lookahead is not None else (0.0,)
    left = length * ca.jtimes(s, q, qdot) + s - length * bend
    h, J = linearization.h[0], ca.jacobian(linearization.h[0], q)
    nearer = ca.Function("nearer", run.arguments, [ca.densify(h), ca.densify(h * J.T / ca.sumsqr(J))])
    error = ca.Function("error", run.arguments, [ca.vertcat(left, beside)])
    draw, n = np.random.default_rng(1992), q.numel()
    for _ in range(STATES):
        state = np.concatenate([draw.uniform(-1, 1, n), np.zeros(run.x.numel() - n)])
        for _ in range(STEPS):
            state[:n] -= nearer(state, run.parameters, run.config)[1].full()[:, 0]
        off, turned = error(state, run.parameters, run.config).full()[:, 0]
        on_path = abs(float(nearer(state, run.parameters, run.config)[0])) < AT_REST
        if on_path and abs(turned) > 0.1 and not abs(off) < AGREE * (1 + abs(length)):
            raise _contradiction(form, moving.equation, f"the two sides differ by {off:.2g} m/s at 1 m/s")


def _on_a_line(linearization: Linearization) -> Linearization:
    """Return the same law for a line, of a law along a path: the part of the vehicle is the same."""
    law = LawName.parse(linearization.output.name)
    if law is None or not law.path:
        return linearization
    line = replace(law, path="line", damped=False, arclength=False)
    return linearize(linearization.system, output_map(linearization.system, str(line)))


class _Run:
    """The robot under the second feedback of a law with v = 0, at default parameters."""

    def __init__(
        self, linearization: Linearization, form: NormalForm, direction: float = 0.0, size: float = SIZE
    ):
        """`direction`, rad: of straight driving, and of the line of a law along one; `size`:
        of parameters whose default is 0."""
        self.form, self.linearization, self.direction = form, linearization, direction
        system, output = linearization.system, linearization.output
        self.x = ca.vertcat(system.mechanism.q, system.nu, *[q.symbol for q in linearization.extension])
        line = {"A": -np.sin(direction), "B": np.cos(direction), "C": 0.0} if output.path else {}
        self.parameters = np.array([q.default or size for q in system.mechanism.parameters])
        self.config = np.array([line.get(q.name, q.default or SIZE) for q in output.parameters])
        robot = dict(zip([q.name for q in system.mechanism.parameters], self.parameters, strict=True))
        own = dict(zip([q.name for q in output.parameters], self.config, strict=True))
        renamed = {new: own.get(about.partition(" ")[0]) for new, about in form.decoupling.renamed.items()}
        self._numbers = own | robot | renamed
        self.arguments = [
            self.x,
            system.mechanism.p,
            ca.vertcat(ca.SX(0, 1), *[q.symbol for q in output.parameters]),
        ]
        u, rates = linearization.accelerations(
            linearization.second_feedback(ca.SX.zeros(linearization.h.numel()))
        )
        self.z = ca.vertcat(linearization.h, linearization.rate)
        self._motion = ca.Function("motion", self.arguments, [ca.densify(ca.vertcat(system.qdot, u, rates))])

    def straight(self, V: float, shape: Shape) -> np.ndarray:
        """Return a state of straight driving at the speed V, in which the posture keeps still if it can."""
        system = self.linearization.system
        names = [q.name for q in system.mechanism.coordinates]
        posture = [names.index(name) for name in posture_names(system)]
        state = np.zeros(self.x.numel())
        for name, turned in zip(shape.turns, self.numbers_of(list(shape.turns.values()), V), strict=True):
            state[names.index(name)] = turned * self.direction
        S = ca.Function("S", [self.x, system.mechanism.p], [ca.densify(system.S)])(state, self.parameters)
        directions = np.linalg.svd(S.full()[posture])[2]
        point = ca.Function("point", self.arguments, [self._speed()])
        state[len(names) : len(names) + system.dof] = directions[-1]
        state[len(names) : len(names) + system.dof] *= V / float(point(state, self.parameters, self.config))
        return state

    def is_still(self, state: np.ndarray) -> bool:
        """Whether velocities and posture do not change."""
        system = self.linearization.system
        rates, posture = self.motion(state[:, None])[:, 0], posture_names(system)
        moving = [k for k, q in enumerate(system.mechanism.coordinates) if q.name not in posture]
        return bool(np.abs(np.delete(rates, moving)).max() < AT_REST * max(1.0, np.abs(state).max()))

    def _speed(self) -> ca.SX:
        """Return the speed that is held: that of the point of an extended law, else the forward speed."""
        rows, system = self.linearization.output.rows, self.linearization.system
        if not self.linearization.integrators or ca.depends_on(rows[-1].expression, system.nu):
            return forward_speed(system)
        x_rate, y_rate = (system.along_motion(row.expression) for row in rows)
        return ca.densify(np.cos(self.direction) * x_rate + np.sin(self.direction) * y_rate)

    def motion(self, states: np.ndarray) -> np.ndarray:
        """Return the rates of states, a column each."""
        return self._motion(states, self.parameters, self.config).full()

    def numbers_of(self, rates: Sequence[sp.Expr], V: float) -> list[float]:
        """Return the values of rates at the speed V."""
        numbers = self._numbers | {self.form.decoupling.names["V"]: V}
        return [
            float(rate.subs({symbol: numbers[str(symbol)] for symbol in rate.free_symbols})) for rate in rates
        ]

    def compare(self, state: np.ndarray, rates: np.ndarray, where: str, decided: bool = True) -> None:
        """Raise Contradiction unless the rates of the zero dynamics are these and the others zero; or if not
        all are `decided`, unless these are among them.
        """
        slopes = ca.Function("slopes", self.arguments, [ca.densify(ca.jacobian(self.z, self.x))])
        free = null_space(slopes(state, self.parameters, self.config).full())
        fastest = np.abs(rates).max(initial=0.0) or 1.0
        moved = np.concatenate([state[:, None] + side * DEVIATION * free for side in (1, -1)], axis=1)
        h = LONGEST / fastest / STEPS
        for _ in range(STEPS):
            moved = runge_kutta([self.motion] * 4, moved, h)
        count = free.shape[1]
        after = free.T @ (moved[:, :count] - moved[:, count:]) / (2 * DEVIATION)
        seen = np.log(np.linalg.eigvals(after).astype(complex)) / (h * STEPS)
        stated = np.concatenate([rates, np.zeros(max(0, count - len(rates)) * decided)])
        off = np.abs(seen[:, None] - stated)
        if decided and len(stated) == count:
            # Sorted, rates whose real parts are equal would be those of rounding
            off = off[linear_sum_assignment(off)]
        else:
            off = np.array([np.inf]) if decided else off.min(axis=0, initial=np.inf)
        if not off.max(initial=0.0) <= AGREE * fastest:
            raise _contradiction(self.form, *[f"rates {listed(each)} 1/s {where}" for each in (stated, seen)])


def _contradiction(form: NormalForm, stated: str, seen: str) -> Contradiction:
    where = form.decoupling.functions.name
    return Contradiction(
        f"{where}: its zero dynamics are derived as: {stated}; a run of the robot shows: {seen}"
    )
