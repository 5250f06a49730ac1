"""Will this start stay away from the singular set? Decided before the run, for path following on one line, circle or arc.

The paper's section on singularities gives a condition, |s| < 1 with s = n . (cos phi, sin phi), n the unit normal of the
path at P_l. Under the linearizing feedback the distance h1(t) and the speed v(t) are known in closed form, and s obeys

    l ds/dt = (h1' - v s) (1 - l chi s) + l chi v (1 - s^2),

l = L + d, chi the curvature of the path's parallel through P_l (positive where n points away from the centre). At |s| = 1
it leads back inside if v / l > 0, |h1'| < |v| and |l chi| < 1: a start from which that holds for ever is safe. Until it does,
the equation is integrated. Reversing, with v < 0 and l < 0, is no different.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

from ..model.law import symbols
from ..model.shape import shape_names
from .cases import gain_entries
from .errors import BadInput
from .loop import Loop
from .odometry import vehicle_wheels
from .spec import Spec

LONGEST = 1000.0  # s, as far as a start is followed
TOLERANCE = 1e-10
SETTLED, POINTS = 6, 300  # time constants that a course goes on, and its points


@dataclass(frozen=True)
class Verdict:
    """`kind` is safe, singular or not_proved; `t` (s) when it will be singular; `reason` a sentence.

    `course`: s over t (s) as far as it was followed, 2 x N; empty when it was not.
    """

    kind: str
    reason: str
    t: float | None = None
    course: np.ndarray = field(default_factory=lambda: np.zeros((2, 0)), compare=False, repr=False)

    def __str__(self) -> str:
        """In words."""
        words = "will be singular" if self.kind == "singular" else self.kind.replace("_", " ")
        return f"{words}: {self.reason}"


@dataclass(frozen=True)
class Motion:
    """What is known of a start: distance and its rate (m, m/s), speed (m/s), s, l (m) and the gains; `chi` from h1."""

    h1: float
    h1_rate: float
    speed: float
    s: float
    wanted_speed: float
    lever: float
    kp: float
    kd: float
    kv: float
    chi: Callable[[float], float]

    def distance(self, t: float) -> tuple[float, float]:
        """h1 (m) and its rate (m/s) at time t: h1'' + kd h1' + kp h1 = 0, by the exponential of its 2 x 2 matrix."""
        a, mu = -self.kd / 2, np.emath.sqrt(self.kd**2 / 4 - self.kp)
        slower, faster = np.exp((a + mu) * t), np.exp((a - mu) * t)
        mean = ((slower + faster) / 2).real
        slope = (-slower * np.expm1(-2 * mu * t) / (2 * mu)).real if mu else t * mean
        h1, rate = self.h1, self.h1_rate
        return float(mean * h1 + slope * (rate - a * h1)), float(mean * rate + slope * (a * rate - self.kp * h1))

    def forward_speed(self, t: float) -> float:
        """v(t), m/s, from the first-order speed channel."""
        return self.wanted_speed + (self.speed - self.wanted_speed) * np.exp(-self.kv * t)


def certify(loop: Loop, spec: Spec) -> Verdict:
    """The verdict on a start, for the exact model and a continuous controller."""
    doubts = [
        (loop.law.output.path is None, "the outputs are not those of path following"),
        (bool(spec.plant), "the plant differs from what the controller believes"),
        (bool(loop.integral.rows), "integral action changes the loop"),
        (loop.sensing is not None, "the controller does not see the true state"),
        (spec.limits is not None, "torque limits can bend the motion"),
        (spec.simulation.period > 0, "the controller is sampled"),
        (bool(spec.output.W), "P_l lies beside the vehicle's axis"),
        (bool(spec.output.path and spec.output.path.segments), "path and wanted speed change along a composite path"),
    ]
    for applies, why in doubts:
        if applies:
            return Verdict("not_proved", f"{why}, which this proof does not cover")
    try:
        found = decide(_motion(loop, spec))
    except BadInput as error:
        return Verdict("not_proved", str(error))
    others = ", ".join(shape_names(loop.law.system))
    if found.kind == "safe" and others:
        doubt = f"as far as the heading goes, {found.reason}; but {others} may turn away, which this proof does not cover"
        return replace(found, kind="not_proved", reason=doubt)
    return found


def decide(motion: Motion) -> Verdict:
    """Integrate s until it is safe for ever or singular."""
    if abs(motion.s) >= 1:
        return Verdict("singular", "the heading is normal to the path at the start", 0.0)
    if _safe_for_ever(motion, 0.0, motion.s):
        reason = f"|s| = {abs(motion.s):.4f} < 1 at the start, and |h1'| stays below |v| for ever"
        return Verdict("safe", reason, None, _course(motion, _settled(motion, 0.0)))
    singular, safe = _edge, lambda t, s: float(not _safe_for_ever(motion, t, s[0])) - 0.5
    singular.terminal = safe.terminal = True
    found = _follow(motion, LONGEST, events=(singular, safe), max_step=0.1)
    t, largest = float(found.t[-1]), float(np.abs(found.y[0]).max())
    if found.t_events[0].size:
        reason = f"the heading becomes normal to the path at t = {t:.4g} s"
        return Verdict("singular", reason, t, _course(motion, t))
    if found.t_events[1].size:
        bound = np.ceil(1e4 * largest) / 1e4
        reason = f"|s| stays below {bound:.4f} until t = {t:.4g} s, and from then on |h1'| below |v|"
        return Verdict("safe", reason, None, _course(motion, _settled(motion, t)))
    reason = f"neither singular nor safe for ever within {LONGEST:g} s"
    if motion.wanted_speed * motion.lever < 0:
        reason += "; speed and L + d have opposite signs, so that the heading turns away from the path"
    return Verdict("not_proved", reason)


def _course(motion: Motion, end: float) -> np.ndarray:
    """t and s from the start to `end`, 2 x N."""
    found = _follow(motion, end, t_eval=np.linspace(0.0, end, POINTS))
    return np.vstack([found.t, found.y])


def _settled(motion: Motion, safe: float) -> float:
    """Some time constants after it was found to be safe."""
    return safe + SETTLED * max(abs(motion.lever / motion.wanted_speed), 2 / motion.kd if motion.kd else 0.0)


def _follow(motion: Motion, end: float, **options):
    """s from the start on, as solve_ivp answers."""
    return solve_ivp(_rate(motion), (0.0, end), [motion.s], "DOP853", rtol=TOLERANCE, atol=TOLERANCE, **options)


def _edge(t: float, s: np.ndarray) -> float:
    return 1.0 - abs(s[0])


def _rate(motion: Motion) -> Callable[[float, np.ndarray], list[float]]:
    def rate(t: float, state: np.ndarray) -> list[float]:
        (h1, h1_rate), v, s, l = motion.distance(t), motion.forward_speed(t), state[0], motion.lever  # noqa: E741
        bend = l * motion.chi(h1)
        return [((h1_rate - v * s) * (1 - bend * s) + bend * v * (1 - s * s)) / l]

    return rate


def _safe_for_ever(motion: Motion, t: float, s: float) -> bool:
    """Is |s| = 1 repelling from t on? h1'^2 + kp h1^2 never grows, which bounds h1' and h1."""
    (h1, h1_rate), v = motion.distance(t), motion.forward_speed(t)
    if v * motion.lever <= 0 or motion.wanted_speed * motion.lever <= 0 or abs(s) >= 1:
        return False
    fastest = np.sqrt(h1_rate**2 + motion.kp * h1**2)
    if not fastest < min(abs(v), abs(motion.wanted_speed)):
        return False
    farthest = np.sqrt(h1**2 + h1_rate**2 / motion.kp) if motion.kp > 0 else np.inf
    bends = [motion.chi(h) for h in ((-farthest, farthest) if np.isfinite(farthest) else (0.0,))]
    return all(abs(motion.lever * bend) < 1 for bend in bends)


def _motion(loop: Loop, spec: Spec) -> Motion:
    """Raises BadInput where the start or the path is not one this proof knows."""
    law, leg, x = loop.law, loop.guidance.leg, loop.start
    names = [c.name for c in law.config]
    config = dict(zip(names, leg.config, strict=True))
    row = law.output.rows[0]
    normal = ca.gradient(row.through.outer, row.through.symbols)
    normal = ca.substitute(normal, row.through.symbols, row.through.inner)
    heading = law.system.mechanism.vehicle.heading
    s = ca.dot(normal, ca.vertcat(ca.cos(heading), ca.sin(heading)))
    wanted = ca.vertcat(law.linearization.h, law.linearization.rate, s)
    function = ca.Function("start", [symbols(law.state), symbols(law.parameters), symbols(law.config)], [ca.densify(wanted)])
    h1, speed, h1_rate, s_0 = function(x, loop.plant.parameters, leg.config).full()[:, 0]
    lever = config["L"] + vehicle_wheels(law.system, loop.plant.parameters)[2]
    given = gain_entries(law, spec.gains, "gains")
    kp, kd, kv = (given.get(gain.name, gain.default) for gain in law.gains)
    if kp < 0 or kd < 0:
        raise BadInput("the distance's loop is unstable")
    chi = _parallel(law.output.path.kind, config)
    return Motion(h1, h1_rate, speed, s_0, spec.reference.speed, lever, kp, kd, kv, chi)


def _parallel(kind: str, config: dict[str, float]) -> Callable[[float], float]:
    """Curvature of the path's parallel at distance h1, 1/m, positive where the normal points away from the centre."""
    if kind == "line":
        return lambda h1: 0.0
    if kind == "circle":
        return lambda h1: 1 / (config["R"] + h1) if config["R"] + h1 > 0 else np.inf
    if kind == "segment":  # its normal points to the left, towards the centre of a left turn
        k = config["curvature"]
        return lambda h1: -k / (1 - k * h1) if k * h1 < 1 else np.inf
    raise BadInput(f"nothing is known in closed form about the distance from a {kind}")
