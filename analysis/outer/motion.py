"""The whole closed loop about a steady motion: true robot, law with its own parameters, torque continuous or
held.

When following a line or an arc, or a reference that moves uniformly, only the position along it changes. The
coordinates rho omit it: they are the errors of the outputs that are functions of q, the heading (relative to
the path's direction if there is a path), other coordinates on which the robot's equations depend (a steering
angle), and the quasi-velocities nu. The motion is an equilibrium of

    d rho/dt = r(rho, tau),    tau = kappa(rho, z),    dz/dt = y_d - y    (z only with integral action)

After the integrals, z has the estimates w of disturbance observers, by which v is reduced: dw/dt = ko
(dx/dt - v), with x the measured y^(r-1) and v without w; and then the states xi of a law's dynamic extension:
d xi/dt is a function of rho and z.

With velocity-controlled drives (drive.py) the acceleration nudot takes the place of tau, and u that of kappa:
the drives make nudot follow u. With a kinematic law its command c takes the place of tau: the drives make nu
follow c, nudot = omega (c - nu).

Because tau is constant in the motion, a sampled loop linearized about it is exactly the held one of the
linearized robot: rho+ = exp(A T) rho + int_0^T exp(A s) ds B tau.
"""

from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from ...model.algebra.samples import Sampled
from ...model.law import ControlLaw, symbols
from ...model.mechanism import Quantity
from ...model.outputs import OutputRow
from ...readers.errors import BadInput
from .channel import FIRST, LONGEST, delayed, first_unstable
from .design import FASTEST
from .drive import DriveLoop, sampled_late
from .exponential import exponential
from .margins import Broken

if TYPE_CHECKING:
    import control  # slow to import

STEPS = 50  # of Newton's method
CLOSE, SOLVED = 1e-12, 1e-9  # relative: its last step, and the residual that may be left
# relative: the largest derivative of the rates by the place along the motion that counts as zero
SYMMETRIC = 1e-7


@dataclass(frozen=True, eq=False)
class Setting:
    """All numbers of a closed loop, in the order of the law's groups; SI.

    `true` and `believed` are parameters of the robot and of the law; `config` is the law's, `measured` what
    errors are measured by (None: the same). `bias` is the error of the measured state, `integral` has a gain
    ki, and `observer` a rate ko, for each output. `drive`: the drives take velocities.
    """

    law: ControlLaw
    true: np.ndarray
    believed: np.ndarray
    config: np.ndarray
    gains: np.ndarray
    reference: np.ndarray
    start: np.ndarray
    integral: tuple[float, ...] = ()
    bias: np.ndarray | None = None
    measured: np.ndarray | None = None
    drive: DriveLoop | None = None
    observer: tuple[float, ...] = ()

    @property
    def acting(self) -> tuple[int, ...]:
        """Rows with integral action."""
        return tuple(k for k, ki in enumerate(self.integral) if ki)

    @property
    def observing(self) -> tuple[int, ...]:
        """Rows with a disturbance observer."""
        return tuple(k for k, ko in enumerate(self.observer) if ko)

    @property
    def held(self) -> int:
        """How many numbers the controller holds: integrals, estimates,
        and the states of its dynamic extension."""
        return len(self.acting) + len(self.observing) + len(self.law.extension)

    def arguments(self, x: np.ndarray, z: np.ndarray) -> list[np.ndarray]:
        """Return the arguments of `functions` at a state and integrals."""
        integral = np.array(self.integral or np.zeros(len(self.law.output.rows)))
        bias = np.zeros(len(x)) if self.bias is None else self.bias
        measured = self.config if self.measured is None else self.measured
        omega = np.array(self.drive.omega if self.drive else 0.0)
        return [
            x,
            z,
            self.true,
            self.believed,
            self.config,
            self.gains,
            integral,
            self.reference,
            bias,
            measured,
            omega,
        ]


@dataclass(frozen=True, eq=False)
class SteadyMotion:
    """An equilibrium and the loop linearized about it: d rho/dt = A rho + B tau, tau = K rho + H z, dz/dt = E
    rho + F z.

    `state` is one state [q; nu] of the motion, `torque` its constant inputs, `rho` the coordinates there by
    `names`, `z` what the integrals and observers hold, in the order of the rows that have one, and the states
    of a dynamic extension. `X`: the derivatives of what the observers measure by rho; their rows of E and F
    are those of -v. With a drive, tau stands for the accelerations nudot, the loop without a period is that
    of ideal drives, and `fed` is what the feed-forward of torque adds (`Fed`). With a kinematic law tau
    stands for its command, and the loop without a period is that behind drives without dead time.
    """

    setting: Setting = field(repr=False)
    state: np.ndarray
    torque: np.ndarray
    names: tuple[str, ...]
    rho: np.ndarray
    z: np.ndarray
    A: np.ndarray
    B: np.ndarray
    K: np.ndarray
    H: np.ndarray
    E: np.ndarray
    F: np.ndarray
    X: np.ndarray
    fed: "Fed | None" = None

    @property
    def inputs(self) -> list[str]:
        """Names of the inputs at which the loop is broken."""
        system = self.setting.law.system
        if self.setting.law.kinematic:
            return [q.name for q in self.setting.law.inputs]
        if self.setting.drive:
            return [f"u_{v.name}" for v in system.quasi_velocities]
        return [q.name for q in system.mechanism.inputs]

    def closed(self, period: float | None = None, delay: bool = False) -> np.ndarray:
        """Matrix of the closed loop: of d/dt of [rho, z], or of the map over a period of [rho, z(,
        tau of the call before)]."""
        A, B, K = self._matrices(period, delay)
        return A + B @ K

    def eigenvalues(self, period: float | None = None, delay: bool = False) -> np.ndarray:
        """Return the eigenvalues, slowest first: s in 1/s, or z with a period."""
        values = np.linalg.eigvals(self.closed(period, delay)).astype(complex)
        return values[np.argsort(-(np.abs(values) if period else values.real), kind="stable")]

    def decay(self, period: float | None = None, delay: bool = False) -> float:
        """Return the rate, 1/s, at which the slowest part of a deviation decays; negative if it grows."""
        slowest = self.eigenvalues(period, delay)[0]
        return float(-np.log(abs(slowest)) / period if period else -slowest.real)

    def broken(self, period: float | None = None, delay: bool = False) -> Broken:
        """L, broken at the robot's inputs, negative feedback; square."""
        A, B, K = self._matrices(period, delay)
        return Broken(A, B, -K, period or 0.0)

    def broken_at(self, k: int, period: float | None = None, delay: bool = False) -> Broken:
        """L, broken at input k alone, the others closed."""
        A, B, K = self._matrices(period, delay)
        others = [j for j in range(B.shape[1]) if j != k]
        return Broken(A + B[:, others] @ K[others], B[:, [k]], -K[[k]], period or 0.0)

    def loop(self, period: float | None = None, delay: bool = False) -> "control.StateSpace":
        """L as `broken`, as a system with names."""
        import control

        A, B, K = self._matrices(period, delay)
        returned = [f"{name}_returned" for name in self.inputs]
        return control.ss(A, B, -K, 0, period or 0.0, inputs=self.inputs, outputs=returned, name="loop")

    def longest_period(self, delay: bool = False) -> float:
        """Return the period (s) at which the loop, stable at all shorter ones tried, has an eigenvalue on the
        unit circle (`first_unstable`).
        """

        def excess(period: float) -> float:
            return float(np.abs(np.linalg.eigvals(self.closed(period, delay))).max() - 1)

        unit = 1 / np.abs(np.linalg.eigvals(self.closed())).max()
        drive = self.setting.drive
        # An observer may be faster than what ends stability
        last = LONGEST * (FASTEST if self.setting.observing else 1.0)
        return first_unstable(excess, unit, max(FIRST, drive.shortest / unit) if drive else FIRST, last)

    def _matrices(self, period: float | None, delay: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return A, B and K of the loop in the state [rho, z(, tau)], with tau = K state."""
        n, held, r = len(self.rho), len(self.z), self.B.shape[1]
        A = np.block([[self.A, np.zeros((n, held))], [self.E, self.F]])
        B, K = np.vstack([self.B, np.zeros((held, r))]), np.hstack([self.K, self.H])
        ko = np.array([self.setting.observer[k] for k in self.setting.observing])[:, None]
        first = n + len(self.setting.acting)
        observed = slice(first, first + len(ko))
        if period is None:
            A[observed] *= ko
            A[observed, :n] += ko * self.X @ self.A
            B[observed] = ko * self.X @ self.B
            return A, B, K
        if self.setting.drive:
            return self._behind(self.setting.drive, period, delay)
        moved = exponential(period * np.block([[self.A, self.B], [np.zeros((r, n + r))]]))
        A[:n, :n], B[:n] = moved[:n, :n], moved[:n, n:]
        follows = ko / (1 + ko * period)
        A[n:] *= period
        A[observed] *= follows
        A[observed, :n] += follows * self.X @ (A[:n, :n] - np.eye(n))
        B[observed] = follows * self.X @ B[:n]
        A[n:, n:] += np.eye(held)
        return (*delayed(A, B), np.hstack([K, np.zeros((r, r))])) if delay else (A, B, K)

    def _behind(
        self, drive: DriveLoop, period: float, delay: bool
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return A, B and K of the loop in the state [rho, e, the u (and tau) of the calls before, z],
        with u = K state."""
        (n, r), held = self.B.shape, len(self.z)
        if drive.kinematic:  # nu is in rho
            F, G, J = self.A, self.B, np.zeros((n, r))
        else:
            F, G, J = drive.between_samples(self.A, self.B, period)
        if self.fed:  # of [u; tau]: nudot = by_state rho + by_torque tau + omega e
            F[:, :n] += np.vstack([self.B, -np.eye(r)]) @ self.fed.by_state
            G = np.hstack([0 * G, np.vstack([self.B, -np.eye(r)]) @ self.fed.by_torque])
            J = np.hstack([J, np.zeros((n + r, self.fed.by_torque.shape[1]))])
        A, B = sampled_late(F, G, J, period, drive.delay + period * delay)
        if self.fed:  # tau = of_state rho + of_u u
            A[:, :n] += B[:, r:] @ self.fed.of_state
            B = B[:, :r] + B[:, r:] @ self.fed.of_u
        sums = np.hstack([period * self.E, np.zeros((held, len(A) - n)), np.eye(held)])
        K = np.hstack([self.K, np.zeros((r, len(A) - n)), self.H])
        return (
            np.vstack([np.hstack([A, np.zeros((len(A), held))]), sums]),
            np.vstack([B, np.zeros((held, r))]),
            K,
        )


@dataclass(frozen=True, eq=False)
class Fed:
    """Feed-forward of the torque about a steady motion: the true robot's nudot = by_state rho + by_torque
    tau, and the law's tau = of_state rho + of_u u.
    """

    by_state: np.ndarray
    by_torque: np.ndarray
    of_state: np.ndarray
    of_u: np.ndarray


def steady_motion(setting: Setting) -> SteadyMotion:
    """Return the steady motion near setting.start, with the linearization.

    Raises BadInput if there is none (a path whose curvature changes, a reference that does not move
    uniformly), or if the loop depends on the position along it.
    """
    look, held = (
        functions(setting.law, setting.acting, setting.drive is not None, setting.observing),
        setting.held,
    )
    x, z = np.array(setting.start, float), np.zeros(held)
    for _ in range(STEPS):
        values = look(setting, x, z)
        P = np.linalg.pinv(values["P"])
        residual = np.concatenate([values["r"], values["e"]])
        matrix = values["r_x"] + values["r_tau"] @ values["kappa_x"]
        slope = np.block(
            [[matrix @ P, values["r_tau"] @ values["kappa_z"]], [values["e_x"] @ P, values["e_z"]]]
        )
        if not np.all(np.isfinite(slope)):
            break
        step = np.linalg.lstsq(slope, -residual)[0]
        x, z = x + P @ step[: len(P.T)], z + step[len(P.T) :]
        scale = max(1.0, np.abs(x).max())
        if np.abs(step).max() <= CLOSE * scale:
            if np.abs(residual).max() > SOLVED * scale:
                break
            return _linearized(setting, look(setting, x, z), x, z)
    raise BadInput(
        f"{setting.law.name}: no steady motion near the start: path or reference change, or it is singular "
        "there"
    )


def _linearized(
    setting: Setting, values: dict[str, np.ndarray], x: np.ndarray, z: np.ndarray
) -> SteadyMotion:
    right = np.linalg.pinv(values["P"])
    reduced = {name: values[name] @ right for name in ("r_x", "kappa_x", "e_x", "x_x")}
    _check_steady(setting.law, values, reduced)
    fed = None
    if setting.drive and setting.drive.feeds:
        by_state, by_torque, of_state, of_u = feed_function(setting.law)(*_seen(setting, x))
        fed = Fed(by_state.full() @ right, by_torque.full(), of_state.full() @ right, of_u.full())
    return SteadyMotion(
        setting=setting,
        state=x,
        torque=values["kappa"],
        names=coordinates(setting.law),
        rho=values["rho"],
        z=z,
        A=reduced["r_x"],
        B=values["r_tau"],
        K=reduced["kappa_x"],
        H=values["kappa_z"],
        E=reduced["e_x"],
        F=values["e_z"],
        X=reduced["x_x"],
        fed=fed,
    )


def _check_steady(law: ControlLaw, values: dict[str, np.ndarray], reduced: dict[str, np.ndarray]) -> None:
    """Raise BadInput if rho does not describe the motion completely,
    or the loop changes along a moving reference."""
    taken = {"r_x": 0.0, "kappa_x": values["kappa_t"], "e_x": values["e_t"], "x_x": 0.0}
    for name, matrix in reduced.items():
        left = [values[name] - matrix @ values["P"], matrix @ values["moves"] + taken[name]]
        largest = max(np.abs(part).max(initial=0.0) for part in left)
        if largest > SYMMETRIC * max(1.0, np.abs(values[name]).max(initial=0.0)):
            raise BadInput(f"{law.name}: no steady motion: the closed loop depends on the position along it")


def coordinates(law: ControlLaw) -> tuple[str, ...]:
    """Names of rho."""
    rows = [row.name for row in _position_rows(law)]
    heading = "heading_from_path" if law.output.path else "heading"
    shape = [c.name for c in _shape(law)]
    return (
        *rows,
        *([heading] if _angles(law) else []),
        *shape,
        *[v.name for v in law.system.quasi_velocities],
    )


class MotionFunctions:
    """Residuals and their derivatives by name, for a law and the rows that have integral action, or are
    `observing`.

    `driven`: the input tau is the acceleration nudot instead, and kappa the law's u; of a kinematic law its
    command.
    """

    def __init__(
        self, law: ControlLaw, acting: tuple[int, ...], driven: bool = False, observing: tuple[int, ...] = ()
    ):
        system, rows = law.system, _position_rows(law)
        x, p = symbols(system.state), symbols(law.parameters)
        xi = ca.SX.sym("xi", len(law.extension))
        estimates = ca.SX.sym("d", len(observing))
        z, tau = (
            ca.vertcat(ca.SX.sym("z", len(acting)), estimates, xi),
            ca.SX.sym("tau", system.dof if driven else len(system.mechanism.inputs)),
        )
        believed, config, measured = (ca.SX.sym(n, k) for n, k in _sizes(law))
        ki, bias = ca.SX.sym("ki", len(law.output.rows)), ca.SX.sym("bias", x.numel())
        omega, gains, reference = ca.SX.sym("omega"), symbols(law.gains), symbols(law.reference)
        acts = driven and not law.kinematic
        by_name = {q.name: q.symbol for q in law.reference}

        # The law at the measured state.
        virtual = law.v + ca.vertcat(
            *[ki[k] * z[acting.index(k)] if k in acting else 0 for k in range(len(law.output.rows))]
        )
        less = ca.vertcat(
            *[estimates[observing.index(k)] if k in observing else 0 for k in range(len(law.output.rows))]
        )
        kappa = ca.substitute(
            law.u_of_v if acts else law.tau_of_v, symbols(law.virtual_input), virtual - less
        )
        substitution = [
            ca.vertcat(x, symbols(law.extension), p, symbols(law.config)),
            ca.vertcat(x + bias, xi, believed, config),
        ]
        kappa = ca.substitute(kappa, *substitution)
        errors = [by_name[law.output.rows[k].name] - law.linearization.h[k] for k in acting]
        without = [-virtual[k] for k in observing]
        e = ca.substitute(ca.vertcat(ca.SX(0, 1), *errors, *without, law.extension_rate), *substitution)
        measured_x = ca.substitute(
            ca.vertcat(ca.SX(0, 1), *[_observed(law, k) for k in observing]), *substitution
        )

        # The true robot, with its outputs relative to the desired ones.
        place = ca.vertcat(*[row.expression for row in rows], *_angles(law), *[c.symbol for c in _shape(law)])
        rho = ca.vertcat(ca.substitute(place, symbols(law.config), measured), system.nu)
        nudot = omega * (tau - system.nu) if law.kinematic else tau if driven else system.acceleration(tau)
        full = ca.vertcat(system.qdot, nudot)
        P = ca.jacobian(rho, x)
        rest = ca.SX(rho.numel() - len(rows), 1)
        y_d = ca.vertcat(*[by_name[row.name] for row in rows])
        moves = ca.vertcat(*[by_name[f"{row.name}_rate"] for row in rows], rest)
        r = P @ full - moves
        rho = rho - ca.vertcat(y_d, rest)

        answers = {"rho": rho, "P": P, "kappa": kappa, "e": e}
        along = moves[: len(rows)]
        answers |= {
            "moves": moves,
            "kappa_t": ca.jacobian(kappa, y_d) @ along,
            "e_t": ca.jacobian(e, y_d) @ along,
        }
        answers |= {"kappa_x": ca.jacobian(kappa, x), "kappa_z": ca.jacobian(kappa, z)}
        answers |= {"e_x": ca.jacobian(e, x), "e_z": ca.jacobian(e, z), "x_x": ca.jacobian(measured_x, x)}
        moving = {"r": r, "r_x": ca.jacobian(r, x), "r_tau": ca.jacobian(r, tau)}
        arguments = [x, z, p, believed, config, gains, ki, reference, bias, measured, omega]
        self._law = ca.Function("law", arguments, [ca.densify(v) for v in answers.values()])
        self._robot = ca.Function("robot", [*arguments, tau], [ca.densify(v) for v in moving.values()])
        self._names = (tuple(answers), tuple(moving))

    def __call__(
        self, setting: Setting, x: np.ndarray, z: np.ndarray, tau: np.ndarray | None = None
    ) -> dict[str, np.ndarray]:
        """Return all of them, vectors as such; `tau` replaces the inputs of the law."""
        arguments = setting.arguments(x, z)
        values = dict(zip(self._names[0], self._law(*arguments), strict=True))
        values |= zip(
            self._names[1], self._robot(*arguments, values["kappa"] if tau is None else tau), strict=True
        )
        arrays = {name: value.full() for name, value in values.items()}
        return arrays | {
            name: arrays[name].ravel() for name in ("rho", "kappa", "e", "moves", "kappa_t", "e_t", "r")
        }


@lru_cache(maxsize=16)
def functions(
    law: ControlLaw, acting: tuple[int, ...], driven: bool = False, observing: tuple[int, ...] = ()
) -> MotionFunctions:
    return MotionFunctions(law, acting, driven, observing)


@lru_cache(maxsize=16)
def feed_function(law: ControlLaw) -> ca.Function:
    """Return the function from the state, the true and the believed parameters and the bias of the state to
    four derivatives, with the torque that keeps nu: of the true nudot by state and torque, and of the law's
    torque by state and u.
    """
    system, x, p = law.system, symbols(law.state), symbols(law.parameters)
    believed, bias = ca.SX.sym("believed", p.numel()), ca.SX.sym("bias", x.numel())
    u, tau = ca.SX.sym("u", system.dof), ca.SX.sym("tau", len(system.mechanism.inputs))
    fed = ca.substitute(system.first_feedback(u), ca.vertcat(x, p), ca.vertcat(x + bias, believed))
    moved, still = system.acceleration(tau), ca.SX.zeros(system.dof)
    derivatives = [ca.jacobian(moved, x), ca.jacobian(moved, tau), ca.jacobian(fed, x), ca.jacobian(fed, u)]
    torque = ca.substitute(fed, u, still)
    at = [ca.substitute(ca.substitute(each, tau, torque), u, still) for each in derivatives]
    return ca.Function("feed", [x, p, believed, bias], [ca.densify(each) for each in at])


def _seen(setting: Setting, x: np.ndarray) -> list[np.ndarray]:
    bias = np.zeros(len(x)) if setting.bias is None else setting.bias
    return [x, setting.true, setting.believed, bias]


def _observed(law: ControlLaw, k: int) -> ca.SX:
    """Return the derivative of row k below its relative degree."""
    io = law.linearization
    before, degree = sum(order - 1 for order in io.relative_degree[:k]), io.relative_degree[k]
    return io.h[k] if degree == 1 else io.rate[before + degree - 2]


def _sizes(law: ControlLaw) -> tuple[tuple[str, int], ...]:
    return ("believed", len(law.parameters)), ("config", len(law.config)), ("measured", len(law.config))


def _position_rows(law: ControlLaw) -> list[OutputRow]:
    """Rows that are functions of q."""
    return [row for row in law.output.rows if not ca.depends_on(row.expression, law.system.nu)]


def _angles(law: ControlLaw) -> list[ca.SX]:
    """Return the vehicle's heading, relative to the line if there is a path;
    none if it is an output or there is no vehicle."""
    vehicle = law.system.mechanism.vehicle
    if vehicle is None:
        return []
    if law.output.path is None:
        return (
            []
            if any(ca.is_equal(row.expression, vehicle.heading, 9) for row in _position_rows(law))
            else [vehicle.heading]
        )
    across, along = path_frame(law)
    # The way of travel does not matter; at a right angle the law is singular
    return [ca.atan(across / along)]


@lru_cache(maxsize=16)
def _shape(law: ControlLaw) -> tuple[Quantity, ...]:
    """Return coordinates on which the robot's equations depend and that outputs and heading do not determine,
    such as a steering angle.
    """
    system, q = law.system, law.system.mechanism.q
    equations = ca.vertcat(ca.vec(system.Mbar), system.bias, ca.vec(system.input_map))
    place = ca.vertcat(*[row.expression for row in _position_rows(law)], *_angles(law))
    shape: list[Quantity] = []

    def rank(chosen: list[Quantity]) -> int:
        jacobian = ca.jacobian(ca.vertcat(place, *[c.symbol for c in chosen]), q)
        return Sampled(jacobian, q, (*law.parameters, *law.config), f"{law.name}: coordinates").rank()

    for coordinate in system.mechanism.coordinates:
        if ca.depends_on(equations, coordinate.symbol) and rank([*shape, coordinate]) > rank(shape):
            shape.append(coordinate)
    return tuple(shape)


def path_frame(law: ControlLaw) -> tuple[ca.SX, ca.SX]:
    """Parts of the vehicle's forward unit vector across the path, along its normal, and along it,
    the normal turned clockwise."""
    through = next(row.through for row in law.output.rows if row.through and row.name == "distance")
    n = ca.substitute(ca.gradient(through.outer, through.symbols), through.symbols, through.inner)
    heading = law.system.mechanism.required_vehicle.heading
    cosine, sine = ca.cos(heading), ca.sin(heading)
    return n[0] * cosine + n[1] * sine, n[1] * cosine - n[0] * sine
