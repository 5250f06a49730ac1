"""The closed loop of a SPEC as `tube` needs it: plant, law and guard with their bounds, in coordinates in
which a motion settles.

Along a line or a circle the place on the path does not matter. There the vehicle is described from the foot
of P_l on the path: by h, the distance of P_l to the left, and psi, its heading against the direction of
travel. With the curvature k of the path (positive to the left), P_l' = (x', y') seen from the foot, the foot
advances at sigma' = x' / (1 - k h), h' = y' and psi' = heading' - k sigma'. Along an ellipse k depends on the
foot: there the direction theta of the path at the foot is a further coordinate, theta' = k sigma'. On a
composite path the distance along it is a further coordinate; where two segments join, k changes, h and psi do
not. Where forces depend on the pose, the coordinates are the robot's own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from ...model.law import symbols
from ...model.outputs import body_point, forward_speed, reference_point
from ...model.reduction import ReducedSystem
from ...model.segments import Segment
from ...model.vehicle import point_on_body, required_point
from ...readers.errors import BadInput
from ...simulation.controllers.odometry import arm_function, vehicle_wheels
from ...simulation.controllers.symbolic import slowed
from ...simulation.guidance import Route
from ...simulation.loop import Loop, make_loop
from ...simulation.specification.spec import Spec
from .enclosure import Bounds, Enclosure
from .tube import Tube

SIDES = (-1.0, 1.0)
AT_START = 1e-9  # m
OVERLAP = 1e-12  # relative; the halves of a range overlap so that rounding leaves no gap
LAPS = 20  # of a closed path, written as a sequence of segments
FLAT = 1e-4  # relative; ten times the value below which the controller takes a derivative for zero


@dataclass(frozen=True)
class Foot:
    """A start seen from its foot on the path: `config` of the law there, `curvature` (1/m) to the left,
    `distance` h (m), `heading` psi (rad); `along` is the coordinate of the foot along the path, if it
    matters.
    """

    config: np.ndarray
    curvature: float
    distance: float
    heading: float
    along: tuple[float, ...] = ()


def foot_of(kind: str, names: list[str], config: np.ndarray, pose: tuple[float, float, float]) -> Foot | None:
    """Return the start from P_l and the heading in the world frame. None for a path without a chart,
    and if no foot is found."""
    values, (x, y, heading) = dict(zip(names, config, strict=True)), pose
    if kind == "line":
        A, B, C = (values[name] for name in "ABC")
        size = math.hypot(A, B)
        curvature, distance, direction = 0.0, (A * x + B * y + C) / size, math.atan2(-A, B)
        values |= {"A": 0.0, "B": 1.0, "C": 0.0}
    elif kind == "circle":
        dx, dy, R = x - values["x_f"], y - values["y_f"], values["R"]
        curvature, distance, direction = -1 / R, math.hypot(dx, dy) - R, math.atan2(-dx, dy)
        values |= {"x_f": 0.0, "y_f": -R}
    elif kind == "segment":
        segment = Segment(values["x_s"], values["y_s"], values["direction"], values["curvature"], 1.0)
        curvature, distance = segment.curvature, segment.distance(x, y)
        direction = segment.heading + curvature * segment.progress(x, y)
        values |= {"x_s": 0.0, "y_s": 0.0, "direction": 0.0}
    elif kind == "ellipse":
        return _foot_on_ellipse(values["a"], values["b"], config, pose)
    else:
        return None
    psi = math.remainder(heading - direction, 2 * math.pi)
    return Foot(np.array([values[name] for name in names]), curvature, distance, psi)


def _foot_on_ellipse(a: float, b: float, config: np.ndarray, pose: tuple[float, float, float]) -> Foot | None:
    """Return the foot, where the distance is smallest."""
    x, y, heading = pose
    u = math.atan2(y / b, x / a)  # eccentric angle of the foot
    for _ in range(50):  # Newton's method on the derivative of the squared distance
        c, s = math.cos(u), math.sin(u)
        first = (b * b - a * a) * s * c + a * x * s - b * y * c
        second = (b * b - a * a) * (c * c - s * s) + a * x * c + b * y * s
        if not second > 0:
            return None  # beyond the centres of curvature
        u -= first / second
    if not abs(first) < 1e-9 * (a * a + a * abs(x) + b * abs(y)):
        return None
    normal = math.atan2(math.sin(u) / b, math.cos(u) / a)
    direction = normal - math.pi / 2
    distance = (x - a * math.cos(u)) * math.cos(normal) + (y - b * math.sin(u)) * math.sin(normal)
    return Foot(config, 0.0, distance, math.remainder(heading - direction, 2 * math.pi), (direction,))


def _ellipse(a: ca.SX, b: ca.SX, theta: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Curvature and foot where the direction of travel is theta: with the normal n outwards and G = |(a n_x,
    b n_y)|, the foot is (a^2 n_x, b^2 n_y) / G, the radius of curvature (a b)^2 / G^3.
    """
    n = ca.vertcat(-ca.sin(theta), ca.cos(theta))
    G = ca.sqrt((a * n[0]) ** 2 + (b * n[1]) ** 2)
    return -(G**3) / (a * b) ** 2, ca.vertcat(a * a * n[0], b * b * n[1]) / G


@dataclass(frozen=True)
class Inputs:
    """The limited inputs near a state: their bounds, and the combinations of entries of `law` (inputs,
    entries) that they follow there.
    """

    bounds: Bounds
    mix: np.ndarray

    def slope(self, slope: np.ndarray) -> np.ndarray:
        """Return the derivative of the inputs from that of `law`."""
        return self.mix @ slope


def mixed(law: Bounds, mix: np.ndarray, value: np.ndarray, off: np.ndarray, off_moved: np.ndarray) -> Inputs:
    """Inputs of that value whose change differs from that of the combinations by at most `off`, between x and
    the centre by at most `off_moved`.
    """
    used = np.abs(mix).any(axis=0)  # the other entries may have no bounds
    size, part = np.abs(mix[:, used]), law.rows(used)
    with np.errstate(invalid="ignore", over="ignore"):
        moved, radius, rest, turned = (
            size @ bound for bound in (part.moved, part.radius, part.rest, part.turned)
        )
    return Inputs(
        Bounds(value, mix[:, used] @ part.slope, moved + off_moved, radius + off, rest + off, turned), mix
    )


def kink(
    over: np.ndarray, moved: np.ndarray, radius: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the slope of the line nearest to max(0, x), where x moves from `over` by at most `moved` and
    then changes by at most `radius`; and by how much the change of max(0, x) can differ from that of the
    line, in the second step and in the first.
    """
    spread = moved + radius
    slope = np.clip(0.5 + 0.5 * over / np.maximum(spread, 1e-300), 0.0, 1.0)
    straddles, steeper = (slope > 0) & (slope < 1), np.maximum(slope, 1 - slope)
    off = np.minimum((spread - np.abs(over)) / 2 + moved, steeper * radius)
    return slope, np.where(straddles, off, 0.0), np.where(straddles, steeper * moved, 0.0)


class EnclosedPlant:
    """w' = N^-1 F and the rates of the coordinates before, from an Enclosure of [rates; N; F] of [z; tau; p];
    N is dof^2.

    Nothing is inverted symbolically: N (w' + dw') = F + dF - dN w' bounds the change of w'.
    """

    def __init__(self, parts: Enclosure, dof: int):
        self._parts, self._dof = parts, dof
        self.fixed = np.zeros(0)  # values of the other arguments

    def tangent(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return value and derivative at x."""
        value, slope = self._parts.tangent(x, self.fixed)
        return self._solved(value, slope)[:2]

    def bounds(
        self, x: np.ndarray, moved: np.ndarray, radius: np.ndarray, rest: np.ndarray | float = 0.0
    ) -> Bounds:
        """See Enclosure."""
        parts, f = self._parts.bounds(x, moved, radius, rest, self.fixed), self._dof
        value, slope, inverse = self._solved(parts.value, parts.slope)
        size, k = np.abs(value[-f:]), len(value) - f
        (mN, mF), (RN, RF), (rN, rF) = (
            self._split(part)[1:] for part in (parts.moved, parts.radius, parts.rest)
        )
        inverse = np.abs(inverse)
        change = inverse @ (mN + RN)
        if not (parts.finite and np.abs(change).sum(axis=1).max() < 1):
            endless = np.full(len(value), np.inf)
            return Bounds(value, slope, endless, endless, endless, endless)
        inverse = np.linalg.solve(np.eye(f) - change, inverse)  # bound for any N in the box (Neumann series)
        moved_w = inverse @ (mF + mN @ size)
        radius_w = inverse @ (RF + RN @ (size + moved_w))
        rest_w = inverse @ (rF + rN @ (size + moved_w) + RN @ radius_w)
        tN, tF = self._split(parts.turned)[1:]
        linear = self._split(np.abs(parts.slope) @ radius)[1]
        turned_w = inverse @ (
            tF + tN @ (size + moved_w) + linear @ moved_w + mN @ (np.abs(slope[-f:]) @ radius)
        )
        firsts = (parts.moved, parts.radius, parts.rest, parts.turned)
        both = zip(firsts, (moved_w, radius_w, rest_w, turned_w), strict=True)
        return Bounds(value, slope, *[np.concatenate([first[:k], second]) for first, second in both])

    def _split(self, part: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        f = self._dof
        k = len(part) - f * (f + 1)
        return part[:k], part[k : k + f * f].reshape(f, f).T, part[k + f * f :]

    def _solved(self, value: np.ndarray, slope: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        rates, N, F = self._split(value)
        f, k = self._dof, len(rates)
        inverse = np.linalg.inv(N)
        w = inverse @ F
        by = slope[k + f * f :].copy()
        for column in range(f):
            by -= slope[k + column * f : k + (column + 1) * f] * w[column]
        return np.concatenate([rates, w]), np.vstack([slope[:k], inverse @ by]), inverse


@dataclass(frozen=True)
class PathCurvatures:
    """Curvatures `values` (1/m) of the segments of a path, and the places `ends` (m along it) where each but
    the last ends."""

    ends: np.ndarray
    values: np.ndarray

    def within(self, low: float, high: float) -> tuple[float, float]:
        """Return middle and half the spread of the curvatures between two places."""
        first, last = np.searchsorted(self.ends, (low, high), side="right")
        curvatures = self.values[first : last + 1]
        return (curvatures.max() + curvatures.min()) / 2, (curvatures.max() - curvatures.min()) / 2

    def left(self, place: float) -> float:
        """Return the distance to the next joint, m; infinite if none follows."""
        following = np.searchsorted(self.ends, place, side="right")
        return float(self.ends[following] - place) if following < len(self.ends) else np.inf


class EnclosedLoop:
    """z (n): the coordinates and quasi-velocities that matter; p: the uncertain parameters, of value
    `nominal` and +- `spread`.

    `plant`: z' of [z; tau; p]. `law`: the inputs before limits, the errors with integral action and, where it
    may slow down, the inputs with each limit met, of [z; integrals] with `constants` and the reference.
    `guard`: |det Phi|, the product of Phi's row norms, det Phi and s, the cosine of the angle between heading
    and normal, of z with `constants`. `start`: z of p. `settles`: a motion may come to rest in these
    coordinates. On a composite path `curvatures` are those of its segments, z[along] the place on it, `stop`
    (m) where the desired speed changes; all three functions then also depend on the curvature, their last
    argument.
    """

    def __init__(self, loop: Loop, spec: Spec, uncertainty: Mapping[str, float]):
        """Raises BadInput for a robot whose pose is not three of its coordinates,
        and a model without bounds."""
        law, mechanism = loop.law, loop.law.system.mechanism
        names = [q.name for q in law.parameters]
        uncertain = [k for k, name in enumerate(names) if uncertainty.get(name)]
        self.loop, self._uncertain = loop, uncertain
        self.spread = np.array([uncertainty[names[k]] for k in uncertain]) * np.abs(
            loop.plant.parameters[uncertain]
        )
        self.slows = loop.limits is not None and loop.limits.mode == "slow"
        self.most = np.array(
            [most or np.inf for most in loop.limits.torque]
            if loop.limits
            else [np.inf] * len(mechanism.inputs)
        )
        parameters = ca.vertsplit(mechanism.p)
        certain = [k for k in range(len(names)) if k not in uncertain]
        self._p = ca.vertcat(ca.SX(0, 1), *[parameters[k] for k in uncertain])
        self._certain = (
            ca.vertcat(ca.SX(0, 1), *[parameters[k] for k in certain]),
            ca.SX(loop.plant.parameters[certain]),
        )
        self._of_nu = _velocities(law.system, loop.believed)
        self._build(spec)
        self._begin(loop, spec)

    def started(self, loop: Loop, spec: Spec) -> EnclosedLoop:
        """Return the loop with another start."""
        other = copy(self)
        other._begin(loop, spec)
        return other

    def half(self, spec: Spec, which: int, side: float) -> tuple[EnclosedLoop, Spec]:
        """Return the loop and the SPEC with one uncertain parameter restricted to the half of its range above
        (side 1) or below (-1) its value. `spec` is that of this loop; the plant gets the middle of the half,
        the controller's value is unchanged.
        """
        middle, other = np.zeros(len(self.spread)), copy(self)
        middle[which], other.spread = side / 2, self.spread.copy()
        other.spread[which] *= 0.5 + OVERLAP
        changed = replace(spec, plant={**spec.plant, **self.plant_at(middle)})
        return other.started(make_loop(changed), changed), changed

    def _build(self, spec: Spec) -> None:
        """Build the parts that do not depend on the start, the gains and the position of the path."""
        law, system, loop = self.loop.law, self.loop.law.system, self.loop
        tau, limits, curvature = (
            ca.SX.sym(name, n) for name, n in (("tau", len(self.most)), ("most", len(self.most)), ("k", 1))
        )
        on_body = point_on_body(system)
        pose = list(on_body.pose) if on_body else []
        # From the coordinates to the vehicle's point, as the controller knows it: P_l is where the controller
        # takes it to be.
        self._arm = arm_function(system)(loop.believed).full().ravel() if on_body else np.zeros(2)
        acting = ca.vertcat(ca.vec(system.Mbar), ca.vec(system.input_map), system.bias)
        state, kind = symbols(law.state), law.output.required_path.kind
        # Whether the forces are the same in each pose
        level = not ca.depends_on(acting, ca.vertcat(*[state[k] for k in pose]))
        self._kind = kind if pose and level and foot_of(kind, *self._pose_of(loop, pose)) else ""
        if loop.composite and not self._kind:
            raise BadInput("the forces depend on the pose, which is not covered along a composite path")
        self._pose = pose
        self.settles = self._kind in ("line", "circle", "segment") and not loop.composite
        z, x_of_z, rates = self._speeds(*self._chart(curvature))
        by_nu = ca.inv(ca.DM(self._of_nu))
        self._forces = self._plain_inputs(by_nu)
        acting = ca.solve(self._forces, tau)
        mass, force = by_nu.T @ system.Mbar @ by_nu, by_nu.T @ (system.input_map @ acting - system.bias)
        motion = ca.substitute(ca.vertcat(ca.vec(mass), force), state, x_of_z)
        rates, motion = (ca.substitute(part, *self._certain) for part in (rates, motion))
        law_of_z, guard = self._controller(x_of_z, limits, curvature)
        needed = ca.vertcat(motion, law_of_z, guard)
        keep = _relevant(z, rates, ca.vertcat(needed, z[2]) if loop.composite else needed)
        self._keep, self.along = keep, keep.index(2) if loop.composite else None
        self.first = len(keep) - system.dof
        moving, constant = (curvature, ca.SX(0, 1)) if loop.composite else (ca.SX(0, 1), curvature)
        constants = ca.vertcat(symbols(law.config), symbols(law.gains), limits, constant)
        z = ca.vertcat(*[z[k] for k in keep])
        kept = ca.vertcat(*[rates[k] for k in keep[: -system.dof]])
        parts = Enclosure(ca.vertcat(kept, motion), ca.vertcat(z, tau, self._p, moving), constants)
        self.plant = EnclosedPlant(parts, system.dof)
        fixed = ca.vertcat(constants, symbols(law.reference))
        self.law = Enclosure(law_of_z, ca.vertcat(z, self._integrals, moving), fixed)
        self.guard = Enclosure(guard, ca.vertcat(z, moving), constants)

    def _pose_of(
        self, loop: Loop, pose: list[int]
    ) -> tuple[list[str], np.ndarray, tuple[float, float, float]]:
        """Return the config of the path by name, P_l and the heading at the start."""
        names, config, x = [c.name for c in loop.law.config], np.asarray(loop.guidance.leg.config), loop.start
        values = dict(zip(names, config, strict=True))
        ahead, left = self._arm + (values["L"], values.get("W", 0.0))
        c, s = math.cos(x[pose[2]]), math.sin(x[pose[2]])
        return (
            names,
            config,
            (x[pose[0]] + ahead * c - left * s, x[pose[1]] + ahead * s + left * c, x[pose[2]]),
        )

    def _begin(self, loop: Loop, spec: Spec) -> None:
        """Set the start and the numbers of path and controller."""
        self.loop, self.nominal, x = loop, loop.plant.parameters[self._uncertain], loop.start
        config, begin, curvature = np.asarray(loop.guidance.leg.config), x[: self._first], [0.0]
        self.reference: np.ndarray | None = None
        self.curvatures, self.stop = PathCurvatures(np.zeros(0), np.zeros(1)), np.inf
        if self._kind:
            foot = foot_of(self._kind, *self._pose_of(loop, self._pose))
            if foot is None:
                raise BadInput("the start has no foot on the path")
            along = foot.along
            if isinstance(loop.guidance, Route):
                self.curvatures, self.stop, place = _path_curvatures(loop.guidance, spec, x)
                along, self.reference = (place,), loop.guidance.reference(0.0, x)
            others = [k for k in range(self._first) if k not in self._pose]
            config, curvature = foot.config, [] if loop.composite else [foot.curvature]
            begin = np.array([foot.distance, foot.heading, *along, *x[others]])
        most = np.where(np.isfinite(self.most), self.most, 0.0)
        self.constants = np.concatenate([config, loop.gains, most, curvature])
        self.plant.fixed = self.constants
        start = np.concatenate([begin, self._of_nu @ x[self._first :]])
        self.z = start[self._keep]
        self.start = self._start(spec)

    def plant_at(self, deviation: np.ndarray) -> dict[str, float]:
        """Return the uncertain parameters by name, with deviations in units of their spread."""
        names = [self.loop.law.parameters[k].name for k in self._uncertain]
        return dict(zip(names, map(float, self.nominal + deviation * self.spread), strict=True))

    def limited(self, value: np.ndarray) -> np.ndarray:
        """Return the limited inputs from the value of `law`."""
        r = len(self.most)
        tau = value[:r]
        if (np.abs(tau) <= self.most).all():
            return tau
        if self.slows:
            tau = slowed(tau, value[-r:], self.most)
        return np.clip(tau, -self.most, self.most)

    def law_bounds(
        self,
        tube: Tube,
        curvature: np.ndarray,
        half: np.ndarray,
        moved: np.ndarray,
        growth: np.ndarray,
        fixed: np.ndarray,
    ) -> Bounds:
        """Return bounds of `law` for the states [z; integrals] of a tube, `moved` and `growth` as in
        RateOfChange; `curvature`, where it is an argument, may be off by `half`.
        """
        none, columns = np.zeros(len(half)), np.zeros((len(half), tube.G.shape[1]))
        apart = np.concatenate([0 * growth, half])
        radius = np.concatenate([tube.radius + growth, half])
        bounds = self.law.bounds(
            np.concatenate([tube.centre, curvature]), np.concatenate([moved, none]), radius, apart, fixed
        )
        S, G = np.vstack([tube.S, np.zeros((len(half), len(tube.spread)))]), np.vstack([tube.G, columns])
        return bounds.of(S, G, tube.spread, np.concatenate([growth, half]))

    def inputs(self, law: Bounds) -> Inputs:
        """Return the limited inputs from the bounds of `law`; if several limits may be active,
        `rest` covers all cases."""
        r = len(self.most)
        value, size, spread = self.limited(law.value), np.abs(law.value[:r]), (law.moved + law.radius)[:r]
        if (size + spread <= self.most).all():
            return mixed(law, np.eye(r, len(law.value)), value, np.zeros(r), np.zeros(r))
        if self.slows:
            return self._slowed(law, value)
        moved, radius = law.moved[:r], law.radius[:r]
        slope, off, off_moved = kink(size - self.most, moved, radius)
        both = spread - size > self.most  # either limit may be active
        slope, off, off_moved = (
            np.where(both, 0.5, slope),
            np.where(both, radius / 2, off),
            np.where(both, moved / 2, off_moved),
        )
        return mixed(law, (1 - slope)[:, None] * np.eye(r, len(law.value)), value, off, off_moved)

    def _slowed(self, law: Bounds, value: np.ndarray) -> Inputs:
        """Return the inputs if one limit is, or may be, active and the others are not;
        else anything within the limits."""
        r, n = len(self.most), len(law.value)
        spread = law.moved + law.radius
        tau, steepness, steepness_spread = law.value[:r], np.abs(law.value[-r:]), spread[-r:]
        for k, (i, side) in enumerate((i, side) for i in range(r) for side in SIDES):
            met = n - r - (2 * r - k) * r
            over, others = side * tau[i] - self.most[i], np.arange(r) != i
            steep = steepness[i] - steepness_spread[i] > FLAT * (steepness + steepness_spread).max()
            rows = np.arange(r) + met
            holds = (np.abs(law.value[rows]) + spread[rows] <= self.most)[others].all()
            if not (steep and holds and over + spread[i] > 0):
                continue
            if over - spread[i] < 0:
                if (
                    not (np.abs(tau) + spread[:r] <= self.most)[others].all()
                    or -side * tau[i] + spread[i] > self.most[i]
                ):
                    continue
            slope, off, off_moved = kink(over, law.moved[i], law.radius[i])
            mix = np.zeros((r, n))
            mix[:, :r], mix[:, met : met + r] = (1 - slope) * np.eye(r), slope * np.eye(r)
            least = steepness[i] - steepness_spread[i]
            ratio = (steepness + steepness_spread) / least
            # max(0, over) less the line multiplies the quotient of two slopes, which changes too
            if 0 < slope < 1:
                apart = min(slope, 1 - slope) * abs(over)
                change, change_moved = (
                    (part[-r:] + ratio * part[n - r + i]) / least for part in (law.radius, law.moved)
                )
                off = off * ratio + (apart + law.moved[i]) * change
                off_moved = off_moved * ratio + apart * change_moved
            return mixed(law, mix, value, off * np.ones(r), off_moved * np.ones(r))
        anything, none = self.most + np.abs(value), np.zeros(r)
        return Inputs(
            Bounds(value, np.zeros((r, law.slope.shape[1])), none, anything, anything, none), np.zeros((r, n))
        )

    def _chart(self, curvature: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Return the coordinates of z, the state [q; nu] as a function of z,
        and the rates of these coordinates."""
        law, system = self.loop.law, self.loop.law.system
        state, rates, pose = symbols(law.state), system.qdot, self._pose
        self._first = system.mechanism.q.numel()
        if not self._kind:
            return state[: self._first], state, rates
        config = {c.name: c.symbol for c in law.config}
        ahead, left = config["L"] + self._arm[0], config.get("W", ca.SX(0)) + self._arm[1]
        h, psi, along = ca.SX.sym("h"), ca.SX.sym("psi"), ca.SX.sym("along")
        direction, place, lengthwise = ca.SX(0), ca.SX.zeros(2), ca.SX(0, 1)
        if self._kind == "line":
            curvature = ca.SX(0)
        elif self._kind == "ellipse":
            (curvature, place), direction = _ellipse(config["a"], config["b"], along), along
        if self._kind == "ellipse" or self.loop.composite:
            lengthwise = along
        point = body_point(offset=True)
        offsets = ca.vertcat(*[q.symbol for q in point]), ca.vertcat(ahead, left) - required_point(system).arm
        velocity = system.along_motion(ca.substitute(ca.vertcat(*reference_point(system, point)), *offsets))
        cosine, sine = ca.cos(direction), ca.sin(direction)
        behind, across = (
            left * ca.sin(psi) - ahead * ca.cos(psi),
            h - ahead * ca.sin(psi) - left * ca.cos(psi),
        )
        places = place + ca.vertcat(cosine * behind - sine * across, sine * behind + cosine * across)
        others = [k for k in range(self._first) if k not in pose]
        from_foot, x_of_z = state[:], state[:]  # with the foot as origin, and in the world frame
        for k, here, there in zip(
            pose, (behind, across, psi), (*ca.vertsplit(places), direction + psi), strict=True
        ):
            from_foot[k], x_of_z[k] = here, there
        ahead_, aside = ca.vertsplit(ca.substitute(velocity, state, from_foot))
        advance = ahead_ / (1 - curvature * h)
        moved = ca.vertcat(aside, ca.substitute(rates[pose[2]], state, from_foot) - curvature * advance)
        if lengthwise.numel():
            moved = ca.vertcat(moved, curvature * advance if self._kind == "ellipse" else advance)
        moved = ca.vertcat(moved, *[ca.substitute(rates[k], state, from_foot) for k in others])
        return ca.vertcat(h, psi, lengthwise, *[state[k] for k in others]), x_of_z, moved

    def _speeds(self, coordinates: ca.SX, x_of_z: ca.SX, rates: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """z with forward speed and yaw rate, by the controller's parameters, for the quasi-velocities;
        the rest by this z."""
        nu, moving = self.loop.law.system.nu, ca.SX.sym("moving", self.loop.law.system.dof)
        change = nu, ca.SX(ca.inv(ca.DM(self._of_nu))) @ moving
        return ca.vertcat(coordinates, moving), ca.substitute(x_of_z, *change), ca.substitute(rates, *change)

    def _controller(self, x_of_z: ca.SX, limits: ca.SX, curvature: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return the expressions of `law` and `guard`."""
        law, action, linearization = self.loop.law, self.loop.integral, self.loop.law.linearization
        desired = symbols(law.reference)
        self._integrals = ca.SX.sym("integral", len(action.rows))
        added = ca.SX.zeros(desired.numel())
        for k, entry in enumerate(action.highest):
            added[entry] = action.ki[k] * self._integrals[k]
        numbers = symbols(law.parameters), ca.SX(self.loop.believed)
        bent = {c.name: c.symbol for c in law.config}.get("curvature") if self.loop.composite else None

        def in_z(expression: ca.SX) -> ca.SX:
            value = ca.substitute(ca.substitute(expression, *numbers), symbols(law.state), x_of_z)
            return value if bent is None else ca.substitute(value, bent, curvature)

        through, heading = law.output.rows[0].through, law.system.mechanism.required_vehicle.heading
        if through is None:
            raise BadInput(f"{law.name}: its first output is no distance of a point")
        gradient = ca.substitute(ca.gradient(through.outer, through.symbols), through.symbols, through.inner)
        s = ca.dot(gradient, ca.vertcat(ca.cos(heading), ca.sin(heading))) / ca.sqrt(ca.sumsqr(gradient))
        errors = [
            desired[entry] - linearization.h[row]
            for entry, row in zip(action.desired, action.acting, strict=True)
        ]
        tau = self._forces @ in_z(ca.substitute(law.tau, desired, desired + added))
        slope = in_z(law.slope)
        met = []
        for i in range(len(self.most) if self.slows else 0):
            met += [tau + (side * limits[i] - tau[i]) / slope[i] * slope for side in SIDES]
        flat = slope if self.slows else ca.SX(0, 1)
        inputs = [part for pair in linearization.measures[1:] for part in pair]
        guard = ca.vertcat(*linearization.measure, linearization.determinant, s, *inputs)
        return ca.vertcat(tau, *map(in_z, errors), *met, flat), in_z(guard)

    def _plain_inputs(self, by_nu: ca.DM) -> ca.DM:
        """Return the factor of the inputs: with as many inputs as speeds and no limits,
        forces along the speeds are used."""
        system, r = self.loop.law.system, len(self.most)
        map_ = system.input_map
        if np.isfinite(self.most).any() or r != system.dof or ca.symvar(map_):
            return ca.DM.eye(r)
        return by_nu.T @ ca.evalf(ca.densify(map_))

    def _start(self, spec: Spec) -> Bounds:
        """Return z as a function of p: quasi-velocities of a start given by its speed depend on the
        parameters."""
        n, count = len(self.z), len(self.spread)
        rest = Bounds(self.z, np.zeros((n, count)), *np.zeros((4, n)))
        initial = spec.initial
        if not count or initial is None or initial.q is not None or not initial.speed:
            return rest
        system = self.loop.law.system
        dof, q, speed = system.dof, system.mechanism.q, ca.SX.sym("speed")
        motion = ca.vertcat(
            forward_speed(system), system.along_motion(system.mechanism.required_vehicle.heading)
        )
        M = ca.substitute(ca.jacobian(motion, system.nu), *self._certain)
        desired = ca.vertcat(speed, 0.0)
        nu = ca.solve(M, desired) if dof == 2 else M.T @ ca.solve(M @ M.T, desired)
        rates = Enclosure(ca.SX(self._of_nu) @ nu, self._p, ca.vertcat(q, speed))
        fixed = np.append(self.loop.start[: self._first], initial.speed)
        velocities = rates.bounds(self.nominal, np.zeros(count), self.spread, fixed=fixed)
        for name in ("slope", "radius", "rest"):
            getattr(rest, name)[-dof:] = getattr(velocities, name)
        return rest


def _path_curvatures(route: Route, spec: Spec, start: np.ndarray) -> tuple[PathCurvatures, float, float]:
    """Return the curvatures of a composite path, the place where the desired speed begins to change, and that
    of the start.

    Raises BadInput if the start is beyond the last segment.
    """
    options, segments = route.options, spec.output.segments
    changes = [k for k in range(1, len(segments)) if segments[k].backward != segments[k - 1].backward]
    turns = options.closed and not changes
    laps = LAPS if turns else 1
    course = [segments[k] for k in range(changes[0] if changes else len(segments))] * laps
    ends = np.cumsum([segment.length for segment in course])
    slowing = options.speed**2 / (2 * options.deceleration) if options.deceleration else 0.0
    stop = float(ends[-1]) - (0.0 if turns else slowing)
    guide = route.guide(start)
    if not abs(segments[guide.segment].length - guide.progress - guide.left) < AT_START:
        raise BadInput("the start is behind the last piece of the path")
    before = [segment.length for segment in segments[: guide.segment]]
    curvatures = PathCurvatures(ends[:-1], np.array([segment.curvature for segment in course]))
    return curvatures, stop, float(guide.progress + sum(before))


def _velocities(system: ReducedSystem, believed: np.ndarray) -> np.ndarray:
    """Return forward speed and yaw rate if they are combinations of the quasi-velocities,
    else the quasi-velocities."""
    try:
        forward, turn, _ = vehicle_wheels(system, believed)
    except BadInput:
        return np.eye(system.dof)
    return np.array([forward, turn])


def _relevant(z: ca.SX, rates: ca.SX, needed: ca.SX) -> list[int]:
    """Return the coordinates among z on which the result depends, directly or through rates."""
    coordinates = rates.numel()
    keep: list[int] = []
    while more := [k for k in range(coordinates) if k not in keep and ca.depends_on(needed, z[k])]:
        keep = sorted([*keep, *more])
        needed = ca.vertcat(*[rates[k] for k in keep])
    keep += range(coordinates, z.numel())
    return keep
