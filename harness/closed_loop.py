"""Closed loop of a controller and a plant, continuous or sampled."""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from scipy.integrate import DOP853
from scipy.optimize import brentq

from ..model.law import ControlLaw, symbols
from ..model.linearization import SINGULAR
from ..model.mechanism import values_of
from ..model.outputs import forward_speed, look_ahead, reference_point
from ..model.reduction import ReducedSystem
from .backends import Controller, make_controller
from .cases import gain_entries
from .direct import Direct
from .errors import BadInput
from .plant import Plant
from .robots import find_robot, law_of
from .spec import Initial, Simulation, Spec, check_keys

RUNNING = ("ok", "saturated")  # the statuses with which a run goes on
SHORTEST = 1e-9  # s: a step that meets an error is shortened down to this, then the run stops
FIRST = 1e-3  # s, the first step tried
SHRINK = 0.2
SINGLE, SINGLE_TOLERANCE = ("cf",), 1e-6  # rounding in float is noise: step-size control gets nowhere below it


@dataclass(frozen=True)
class Ramp:
    """Reference that moves at a constant rate: offset + slope t, in the order of law.reference."""

    offset: np.ndarray
    slope: np.ndarray

    def __call__(self, t: float) -> np.ndarray:
        return self.offset + self.slope * t


class Side:
    """Which side of the singular set a state is on: det Phi, its sign taken positive at the start.

    A step over the set is no way around it: behind it the sign has changed.
    """

    def __init__(self, law: ControlLaw, parameters: np.ndarray, config: np.ndarray, start: np.ndarray):
        groups = [symbols(law.state), symbols(law.parameters), symbols(law.config)]
        determinant = ca.densify(law.linearization.determinant)
        scale = ca.densify(ca.sqrt(law.linearization.scale_squared))
        self._function = Direct(ca.Function("side", groups, [determinant, scale]))
        self._fixed = (parameters, config)
        self._sign = np.sign(self._function(start, *self._fixed)[0][0])

    def __call__(self, x: np.ndarray) -> float:
        return self._sign * self._function(x, *self._fixed)[0][0]

    def relative(self, x: np.ndarray) -> float:
        """|det Phi| over the product of Phi's row norms, between 0 and 1."""
        determinant, scale = (value[0] for value in self._function(x, *self._fixed))
        if not (np.isfinite(determinant) and np.isfinite(scale)):
            return float("nan")
        return float(abs(determinant) / scale) if scale else 0.0


@dataclass(frozen=True, eq=False)
class Loop:
    """A controller wired to a plant: everything a run needs but the clock. `start` is the state [q; nu] at t = 0."""

    law: ControlLaw
    controller: Controller
    plant: Plant
    reference: Ramp
    start: np.ndarray
    config: np.ndarray
    side: Side

    def command(self, t: float, x: np.ndarray) -> tuple[str, np.ndarray]:
        """Status and inputs (N, N m) that the controller answers at time t in state x; zeros with an error."""
        status, tau = self.controller.step(x, self.reference(t))
        if status in RUNNING and self.side(x) <= 0:
            return "singular", np.zeros_like(tau)
        return status, tau


@dataclass(frozen=True)
class Row:
    """State, inputs and status at one time."""

    t: float
    x: np.ndarray
    tau: np.ndarray
    status: str


@dataclass(frozen=True, eq=False)
class Run:
    """What happened, a row for each output time: t (N), q (N, n), nu (N, n-m), tau (N, r), y and y_d (N, n-m), status (N).

    SI units, columns named by `law`; `spec` says how it was run (backend, tolerance). y are the true outputs, with the
    plant's parameters; y_d is what was wanted. When a run stopped, its last row tells where, with the status that
    stopped it and no torque.
    """

    spec: Spec
    law: ControlLaw
    plant: Plant
    t: np.ndarray
    q: np.ndarray
    nu: np.ndarray
    tau: np.ndarray
    y: np.ndarray
    y_d: np.ndarray
    status: np.ndarray

    @property
    def columns(self) -> list[str]:
        """Names of the CSV's columns."""
        quantities = (*self.law.state, *self.law.system.mechanism.inputs)
        return ["t", *[q.name for q in quantities], *[f"y{k + 1}" for k in range(self.y.shape[1])], "status"]

    @property
    def x(self) -> np.ndarray:
        """States [q; nu], (N, 2n-m)."""
        return np.hstack([self.q, self.nu])

    @property
    def error(self) -> np.ndarray:
        """y - y_d, (N, n-m)."""
        return self.y - self.y_d

    @property
    def stopped(self) -> str | None:
        """The status that ended the run before its time, None when nothing did."""
        last = str(self.status[-1])
        return None if last in RUNNING else last

    def csv(self) -> str:
        """The run as CSV, 17 significant digits."""
        numbers = np.column_stack([self.t, self.x, self.tau, self.y]).tolist()
        lines = [",".join([*(f"{v:.17g}" for v in row), status]) for row, status in zip(numbers, self.status, strict=True)]
        return "\n".join([",".join(self.columns), *lines]) + "\n"

    def summary(self) -> str:
        """A few lines for a reader: how long, how far from what was wanted, how hard, how true to the constraints."""
        simulation = self.spec.simulation
        held = f"called every {simulation.period:g} s" if simulation.period else "continuous"
        how = f"backend {simulation.backend}, {held}, tolerance {simulation.tolerance:g}"
        lines = [f"{self.spec.robot}, {self.law.name}, {how}: {self.t[-1]:.9g} s, {len(self.t)} rows"]
        for row, error in zip(self.law.output.rows, self.error.T, strict=True):
            lines.append(f"  error of {row.name}: final {error[-1]:.2e} {row.unit}, peak {np.abs(error).max():.3g} {row.unit}")
        inputs = self.law.system.mechanism.inputs
        peaks = ", ".join(f"{i.name} {peak:.3g} {i.unit}" for i, peak in zip(inputs, np.abs(self.tau).max(axis=0), strict=True))
        slip = np.linalg.norm(self.plant.slip(self.x), axis=1).max()
        return "\n".join([*lines, f"  peak {peaks}; worst ||A qdot|| {slip:.1e}"])


def simulate(spec: Spec, backend: str | None = None, progress: Callable[[float], None] | None = None) -> Run:
    """Run the closed loop of a SPEC; `backend` instead of the SPEC's own; `progress` is told the time reached.

    Raises BadInput or ModelError when the SPEC cannot be run: unknown names, refused parameters, a singular start.
    """
    spec = replace(spec, simulation=_as_run(spec.simulation, backend))
    loop = make_loop(spec)
    march = sampled if spec.simulation.period else continuous
    rows = []
    for row in march(loop, spec.simulation):
        rows.append(row)
        if progress:
            progress(row.t)
    t, x = np.array([row.t for row in rows]), np.array([row.x for row in rows])
    law, n = loop.law, len(loop.law.system.mechanism.coordinates)
    h = ca.Function("h", [symbols(law.state), symbols(law.parameters), symbols(law.config)], [ca.densify(law.linearization.h)])
    wanted = [[r.name for r in law.reference].index(row.name) for row in law.output.rows]
    return Run(
        spec=spec,
        law=law,
        plant=loop.plant,
        t=t,
        q=x[:, :n],
        nu=x[:, n:],
        tau=np.array([row.tau for row in rows]),
        y=h(x.T, loop.plant.parameters, loop.config).full().T,
        y_d=loop.reference(t[:, None])[:, wanted],
        status=np.array([row.status for row in rows]),
    )


def _as_run(simulation: Simulation, backend: str | None) -> Simulation:
    """With the backend asked for, and a tolerance that this one can meet."""
    backend = backend or simulation.backend
    least = SINGLE_TOLERANCE if backend in SINGLE and not simulation.period else 0.0
    return replace(simulation, backend=backend, tolerance=max(simulation.tolerance, least))


def make_loop(spec: Spec) -> Loop:
    """Build controller, plant, reference and start of a SPEC. Raises BadInput or ModelError as `simulate` does."""
    mechanism = find_robot(spec.robot)
    law = law_of(mechanism, spec.output.law)
    names = [p.name for p in law.parameters]
    for where in ("parameters", "plant"):
        check_keys(getattr(spec, where), names, where)
    believed = mechanism.parameter_values(spec.parameters)
    true = mechanism.parameter_values({**spec.parameters, **spec.plant}, "plant")
    config = _config(law, spec)
    gains = values_of(list(law.gains), gain_entries(law, spec.gains, "gains"), "gains")
    controller = make_controller(spec.simulation.backend, law, believed, config, gains)
    plant = Plant(law.system, true)
    start = _start(spec.initial, law.system, plant, spec.output.L)
    side = Side(law, np.array(believed), np.array(config), start)
    loop = Loop(law, controller, plant, _reference(law, spec), start, np.array(config), side)
    _check_start(loop)
    return loop


def continuous(loop: Loop, simulation: Simulation) -> Iterator[Row]:
    """The controller is part of the right-hand side. Steps end on the rows, so that rows are as good as steps.

    Where a trial step meets an error, a shorter one is tried; the run stops when none of at least SHORTEST is left.
    """

    def rate(t: float, x: np.ndarray) -> np.ndarray:
        status, tau = loop.command(t, x)
        if status not in RUNNING:
            raise _Refused(status)
        return loop.plant.rate(x, tau)

    first = min(FIRST, simulation.duration)
    tolerance = simulation.tolerance
    solver = DOP853(rate, 0.0, loop.start, simulation.duration, first_step=first, rtol=tolerance, atol=tolerance)
    for t in _row_times(simulation):
        solver.t_bound, solver.status = t, "running"
        while solver.t < t:
            try:
                solver.step()
            except _Refused as refused:
                if solver.h_abs <= SHORTEST:
                    yield _stopped(loop, solver.t, solver.y, refused.status)
                    return
                solver.h_abs *= SHRINK
            if solver.status == "failed":
                raise BadInput(f"[simulation] tolerance = {tolerance:g} cannot be met at t = {solver.t:.9g} s; loosen it")
        status, tau = loop.command(t, solver.y)
        yield Row(t, solver.y, tau, status)
        if status not in RUNNING:
            return


def sampled(loop: Loop, simulation: Simulation) -> Iterator[Row]:
    """The controller is called every `period`, its torque held in between, as a firmware loop does."""
    period, tolerance = simulation.period, simulation.tolerance
    slack = 1e-9 * min(period, simulation.output_step)  # a row this near to a call belongs to the call
    rows = iter(_row_times(simulation))
    row = next(rows)
    x, t = loop.start, 0.0
    for k in itertools.count():
        status, tau = loop.command(t, x)
        if status not in RUNNING:
            yield _stopped(loop, t, x, status)
            return
        end = (k + 1) * period
        while t < end:
            due = row < end - slack
            until = row if due else end
            try:
                x = _hold(loop, t, x, tau, until - t, tolerance)
            except _Refused as refused:
                yield _stopped(loop, refused.t, refused.x, refused.status)
                return
            t = max(t, until)
            if due:
                yield Row(row, x, tau, status)
                row = next(rows, None)
                if row is None:
                    return


class _Refused(Exception):
    """A state at which the run cannot go on."""

    def __init__(self, status: str, t: float = 0.0, x: np.ndarray | None = None):
        super().__init__(status)
        self.status, self.t, self.x = status, t, x


def _hold(loop: Loop, t: float, x: np.ndarray, tau: np.ndarray, duration: float, tolerance: float) -> np.ndarray:
    """State after `duration` seconds of constant tau. Raises _Refused where it meets the singular set or overflows."""
    left = h = duration
    while left > 0:
        h = min(h, left)
        after, error = loop.plant.step(x, tau, h, tolerance)
        if not error <= 1:  # also when it is NaN
            if h <= SHORTEST and not np.isfinite(error):
                raise _Refused("nonfinite", t + duration - left, x)
            h *= max(SHRINK, 0.9 * error**-0.125) if np.isfinite(error) else SHRINK
            continue
        if loop.side(after) <= 0:
            raise _crossing(loop, t + duration - left, x, tau, h, tolerance)
        x, left = after, left - h
    return x


def _crossing(loop: Loop, t: float, x: np.ndarray, tau: np.ndarray, h: float, tolerance: float) -> _Refused:
    """Where a step of h seconds from x at t goes through the singular set."""

    def after(s: float) -> np.ndarray:
        return loop.plant.step(x, tau, s, tolerance)[0]

    s = brentq(lambda s: loop.side(after(s)), 0.0, h, xtol=SHORTEST)
    return _Refused("singular", t + s, after(s))


def _stopped(loop: Loop, t: float, x: np.ndarray, status: str) -> Row:
    return Row(t, x, np.zeros(len(loop.law.system.mechanism.inputs)), status)


def _row_times(simulation: Simulation) -> list[float]:
    """Multiples of output_step, and the end."""
    step, end = simulation.output_step, simulation.duration
    return [*(k * step for k in range(int(np.ceil(end / step - 1e-9)))), end]


def _config(law: ControlLaw, spec: Spec) -> list[float]:
    path = spec.output.path.parameters if spec.output.path else {}
    names = [c.name for c in law.config if c.name != "L"]
    check_keys(path, names, "[output] path")
    missing = [name for name in names if name not in path]
    if missing:
        raise BadInput(f"[output] path {missing[0]} is missing; a {spec.output.path.kind} has {', '.join(names)}")
    return values_of(list(law.config), {"L": spec.output.L, **path}, "[output]")


def _reference(law: ControlLaw, spec: Spec) -> Ramp:
    rows = len(law.output.rows)
    if spec.output.type == "IV":
        position, velocity = (0.0, spec.reference.speed), (0.0, 0.0)
    else:
        position = spec.reference.position
        velocity = (0.0,) * rows if spec.reference.velocity is None else spec.reference.velocity
    for name, given in (("position", position), ("velocity", velocity)):
        if len(given) != rows:
            wanted = ", ".join(row.name for row in law.output.rows)
            raise BadInput(f"[reference] {name} has {len(given)} numbers, it must have {rows}: {wanted}")
    offset, slope = [], []
    for degree, start, rate in zip(law.linearization.relative_degree, position, velocity, strict=True):
        offset += [start, rate, 0.0][: degree + 1]
        slope += [rate, 0.0, 0.0][: degree + 1]
    return Ramp(np.array(offset), np.array(slope))


def _start(initial: Initial, system: ReducedSystem, plant: Plant, L: float) -> np.ndarray:
    """[q; nu] at t = 0: as given, or found from P_l, heading and forward speed; what these leave open is least."""
    n, freedom = len(system.mechanism.coordinates), system.freedom
    if initial.q is not None:
        nu = (0.0,) * freedom if initial.nu is None else initial.nu
        for name, given, wanted in (("q", initial.q, n), ("nu", nu, freedom)):
            if len(given) != wanted:
                raise BadInput(f"[initial] {name} has {len(given)} numbers, {system.mechanism.name} has {wanted}")
        return np.array([*initial.q, *nu])
    heading, speed = initial.heading or 0.0, initial.speed or 0.0
    ahead = look_ahead()
    point = ca.substitute(ca.vertcat(*reference_point(system, ahead)), ahead.symbol, L)
    pose = ca.vertcat(point, system.mechanism.vehicle.heading)
    motion = ca.vertcat(forward_speed(system), system.along_motion(system.mechanism.vehicle.heading))
    q, nu, p = system.mechanism.q, system.nu, plant.parameters
    q_0 = _solve(ca.substitute(pose, system.mechanism.p, p), q, [*initial.point, heading], "point and heading")
    motion = ca.substitute(motion, ca.vertcat(q, system.mechanism.p), ca.vertcat(q_0, p))
    return np.concatenate([q_0, _solve(motion, nu, [speed, 0.0], "speed")])


def _solve(expression: ca.SX, unknown: ca.SX, wanted: list[float], where: str) -> np.ndarray:
    """Newton's method, least-norm steps from zero to expression(unknown) = wanted. Raises BadInput when it gets nowhere."""
    function = ca.Function("start", [unknown], [expression - ca.DM(wanted), ca.densify(ca.jacobian(expression, unknown))])
    found, enough = np.zeros(unknown.numel()), 1e-12 * max(1.0, *np.abs(wanted))
    for _ in range(50):
        residual, jacobian = (value.full() for value in function(found))
        if np.abs(residual).max() <= enough:
            return found
        moves = np.any(jacobian != 0, axis=0)  # the others stay exactly zero
        found[moves] -= np.linalg.lstsq(jacobian[:, moves], residual[:, 0])[0]
    raise BadInput(f"[initial] {where}: the robot cannot be there; give q and nu instead")


def _check_start(loop: Loop) -> None:
    """Raise BadInput when the controller refuses the start, with the reason."""
    status, _ = loop.command(0.0, loop.start)
    if status in RUNNING:
        return
    if status != "singular":
        raise BadInput(f"[initial]: the controller answers {status!r} at the start")
    size = loop.side.relative(loop.start)
    raise BadInput(f"[initial]: Phi is singular at the start: |det Phi| = {size:.1e} of its row norms; {_why_singular(loop)}")


def _why_singular(loop: Loop) -> str:
    """What to change: singular at other states too is the output's fault, else the start's."""
    if np.isnan(loop.side.relative(loop.start)):
        return "an output has no derivative there (the centre of a circle, say), or a number is too large: change either"
    random = np.random.default_rng(1992)
    others = loop.start + random.uniform(-1.0, 1.0, (8, len(loop.start)))
    if max(loop.side.relative(x) for x in others) <= SINGULAR:
        return "so it is at every state, P_l lies on the axle (L = -d): change [output] L"
    if loop.law.output.path:
        return "the heading is normal to the path: turn it or move the point"
    return "here the inputs do not reach the outputs independently: change the heading"
