"""Parameters of the geometry: measured poses compared with those that follow from the angles of wheels and
joints."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import casadi as ca
import numpy as np
from scipy.ndimage import median_filter

from ...model.algebra.integration import runge_kutta
from ...model.algebra.linear import solve
from ...model.mechanism import Quantity
from ...model.reduction import ReducedSystem
from ...readers.errors import BadInput
from ...readers.progress import Reported, silent
from .dynamics import pose_names
from .faults import EITHER_WAY, NEARBY, PERIODS, contradictions, either_way, rows_of, unexplained, without
from .identifiability import Combination, determined, generic_rank
from .log import PoseLog, filled
from .output_error import FEWEST, OutputError, Prediction, Windows, solvable, with_derivatives
from .plausibility import check_kinematics
from .result import Identification, result_of

BEND = "bend"
MISFIT = 0.1  # of the motion: smooth errors from which on nothing is explained
# Part of the rows with a pose from which on the motion between poses is compared with that of the angles
DENSE = 0.2
DIRECTIONS = (0.0, -math.pi / 2, math.pi / 2, math.pi)  # of the pose sensor from which the fit may begin, rad
PASSES = 6  # of the fit, at most; after each it is looked for what it contradicts
WINDOWS = 10  # into which the log is divided, about; each has an initial pose of its own


def sensor_parameters(angles: Sequence[str]) -> tuple[Quantity, ...]:
    """Return parameters of the sensors: of each angle its scale, true per reported, and its zero; the place
    of the pose sensor, ahead and to the left of the vehicle's point, and its direction; the time by which the
    poses are late; how the rates of the angles change between rows.
    """

    def quantity(name: str, unit: str, about: str, default: float = 0.0, sign: str = "any") -> Quantity:
        return Quantity(name, unit, about, default, sign, symbol=ca.SX.sym(name))

    return (
        *(
            quantity(f"scale_{name}", "1", f"true {name} per reported one", 1.0, "positive")
            for name in angles
        ),
        *(quantity(f"zero_{name}", "rad", f"true {name} where zero is reported") for name in angles),
        quantity("offset_x", "m", "place of the pose sensor ahead of the point (x, y)"),
        quantity("offset_y", "m", "place of the pose sensor to the left of the point (x, y)"),
        quantity(
            "offset_heading",
            "rad",
            "direction of the pose sensor, counterclockwise from the vehicle's heading",
        ),
        quantity("delay", "s", "age of a pose when it is logged"),
        quantity(
            BEND,
            "1",
            "change of the rates of angles between rows, 1 is as the rows beside show",
            sign="nonnegative",
        ),
    )


@solvable
def calibrate(
    logs: Sequence[PoseLog],
    system: ReducedSystem,
    names: Sequence[str] | None,
    values: Mapping[str, float],
    progress: Reported = silent,
) -> Identification:
    """Fit the named parameters of the robot or of `sensor_parameters`; None: all parameters of the robot that
    the motion of its pose determines. The others keep `values`, or their defaults.

    From the start of each window q' = S(q) nu is integrated with the nu of least squares that gives the
    measured angles (kinematics (6)); the pose there is fitted. Errors beyond the usual ones have less weight.
    Raises BadInput if the angles do not determine the motion, nothing can be identified, or the fit does not
    converge.
    """
    first, pose = logs[0], pose_names(system)
    if any(log.names != first.names for log in logs):
        raise BadInput("the logs have different columns; calibrate them one by one")
    measured = [k for k in range(3) if any(np.isfinite(log.pose[:, k]).any() for log in logs)]
    measured = measured if {0, 1} <= {*measured} else [k for k in measured if k == 2]
    if 2 not in measured:
        raise BadInput(f"the log has no heading, {pose[2]}; measure it in some rows, or in all with a pose")
    geometry = _Geometry.of(system, first.names, measured)
    for log in logs:
        _check_turns(log, system, values)
        _check_motions(log, system, names or (), values)
    quantities = (*system.mechanism.parameters, *geometry.sensors)
    every = np.array([values.get(q.name, q.default) for q in quantities])
    if names is None:
        names = [p.name for p in system.mechanism.parameters if ca.depends_on(geometry.rate, p.symbol)]
        every_basis = geometry.determined(quantities, names, every)
        basis = [c for c in every_basis if not c.others]
        if every_basis and not basis:
            raise BadInput(
                f"the measured motion shows only {', '.join(map(str, every_basis))}: choose what to fit with "
                "--fit"
            )
        names = [c.pivot for c in basis]
    else:
        basis = geometry.determined(quantities, names, every)
    if not basis:
        raise BadInput(
            f"{system.mechanism.name}: the motion of the pose does not depend on "
            f"{', '.join(names) or 'any parameter'}"
        )
    fitted = [c.pivot for c in basis]
    others = [
        q.name
        for q in quantities
        if (
            q.name not in names
            and ca.depends_on(ca.vertcat(geometry.rate, geometry.pose, geometry.delay), q.symbol)
        )
        or q.name == BEND
        and BEND not in fitted
    ]
    prediction = geometry.prediction(quantities, fitted)
    for _ in range(PASSES):
        begun = []
        for direction in DIRECTIONS if "offset_heading" in fitted else (values.get("offset_heading", 0.0),):
            begin = np.where(np.array([q.name for q in quantities]) == "offset_heading", direction, every)
            windows = _windows(logs, system, pose, measured, direction)
            begun.append(OutputError(prediction, windows, quantities, begin, progress))
        fit = min(begun, key=OutputError.begin_cost)
        fit.fit(robust=True)
        if BEND not in {*fitted, *values}:
            before = fit.values
            fit.begin(np.where(np.array([q.name for q in quantities]) == BEND, 1.0, before))
            if fit.values[fit.places[BEND]] != before[fit.places[BEND]]:
                fit.fit(robust=True)
        wrong = contradictions(fit.residuals(), fit.windows.measured, fit.windows.number, prediction.angles)
        if not wrong:
            break
        logs = [
            _bridged(*pair) for pair in zip(without(logs, "pose", wrong, measured, pose), logs, strict=True)
        ]
    else:
        raise unexplained(logs[0], wrong)
    if "offset_heading" in fit.names:
        fit.values[fit.places["offset_heading"]] = math.remainder(fit.value("offset_heading"), 2 * math.pi)
    of_others = OutputError(geometry.prediction(quantities, others), fit.windows, quantities, fit.values)
    fit.explain(others, of_others.simulated(fit.start)[1])
    fit.check_misfit(MISFIT)
    remarks = tuple(dict.fromkeys(remark for log in logs for remark in log.remarks))
    if fit.surplus < FEWEST:
        few = (
            f"only {fit.surplus} number{'s' * (fit.surplus > 1)} measured beyond the unknowns: standard "
            "deviations are rough"
        )
        few = f"{few}; measure more poses"
        remarks = (*remarks, few)
    outputs = [(pose[k], ("m", "m", "rad")[k]) for k in measured]
    own = {p.name for p in system.mechanism.parameters}
    return result_of(fit, names, basis, sum(len(log.t) for log in logs), remarks, outputs, own)


def _bridged(log: PoseLog, before: PoseLog) -> PoseLog:
    """Return a log whose angles are interpolated where a pose of the log before was left out:
    it may be they that are wrong."""
    angles, left_out = log.angles.copy(), (np.isnan(log.pose) & np.isfinite(before.pose)).any(axis=1)
    angles[left_out] = math.nan
    return replace(log, angles=np.column_stack([filled(log.t, each) for each in angles.T]))


def _check_turns(log: PoseLog, system: ReducedSystem, values: Mapping[str, float]) -> None:
    """Raise BadInput if an angle that starts again after a turn turns by about half of one from row to row,
    as far as dense poses and the robot's parameters tell: over the usual motion of NEARBY rows, since poses
    are noisy.
    """
    periodic = [name for name, period in log.periods.items() if period == PERIODS["a turn"]]
    if not periodic or not _dense(log):
        return
    q = [c.name for c in system.mechanism.coordinates]
    known = _corrected(log, system, values)
    x = np.column_stack([known.get(name, np.zeros(len(log.t))) for name in q])
    place = [q.index(name) for name in pose_names(system) if name in known]
    at = ca.Function("S", [system.mechanism.q, system.mechanism.p], [ca.densify(system.S)])
    parameters = [values.get(p.name, p.default) for p in system.mechanism.parameters]
    count = len(log.t) - 1
    S = at.map(count)(x[:-1].T, np.tile(np.array(parameters)[:, None], count)).full()
    S = S.reshape(len(q), count, -1).transpose(1, 0, 2)
    nu = np.linalg.pinv(S[:, place]) @ np.diff(x[:, place], axis=0)[:, :, None]
    for name in periodic:
        scale = values.get(f"scale_{name}", 1.0)
        change = median_filter((S[:, [q.index(name)]] @ nu)[:, 0, 0], NEARBY, mode="nearest") / scale
        k = int(np.argmax(np.abs(change)))
        if abs(change[k]) > EITHER_WAY * PERIODS["a turn"]:
            step = float(np.median(np.diff(log.t)))
            raise either_way(
                name, rows_of(log.numbers, log.t, [k + 1]), abs(float(change[k])), log.periods[name], step
            )


def _dense(log: PoseLog) -> bool:
    """Whether there are poses enough to compare the motion between them with that of the angles."""
    return bool(np.isfinite(log.pose).any(axis=1).mean() >= DENSE)


def _check_motions(
    log: PoseLog, system: ReducedSystem, fitted: Sequence[str], values: Mapping[str, float]
) -> None:
    """Raise BadInput if the motion between dense poses and that of the angles contradict each other, unless
    one is changed. Fitted parameters may explain it: units of angles are not judged if their scale is fitted,
    places not if the direction is.
    """
    if not _dense(log):
        return
    columns = _corrected(log, system, values)
    if "offset_heading" in fitted:
        columns = {name: each for name, each in columns.items() if name not in pose_names(system)[:2]}
    given = [values.get(p.name, p.default) for p in system.mechanism.parameters]
    scaled = [name for name in log.names if f"scale_{name}" in fitted]
    check_kinematics(log.t, columns, system, given, log.stretches, log.names, scaled)


def _corrected(log: PoseLog, system: ReducedSystem, values: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Return the angles and the pose, as far as it was measured,
    that follow from a log with these values of the sensors."""
    known = {q.name: values.get(q.name, q.default) for q in sensor_parameters(log.names)}
    pairs = zip(log.names, log.angles.T, strict=True)
    angles = {name: known[f"scale_{name}"] * each + known[f"zero_{name}"] for name, each in pairs}
    pose = zip(pose_names(system), log.pose.T, strict=True)
    late = log.t + known["delay"]
    reading = {
        name: np.interp(late, log.t, filled(log.t, each)) for name, each in pose if np.isfinite(each).any()
    }
    x, y, heading = pose_names(system)
    if heading in reading:
        reading[heading] = reading[heading] - known["offset_heading"]
    if {x, y, heading} <= reading.keys():
        cosine, sine = np.cos(reading[heading]), np.sin(reading[heading])
        reading[x] = reading[x] - known["offset_x"] * cosine + known["offset_y"] * sine
        reading[y] = reading[y] - known["offset_x"] * sine - known["offset_y"] * cosine
    return {**angles, **reading}


@dataclass(frozen=True, eq=False)
class _Geometry:
    """The motion that the angles determine. `turning` (k): derivatives of the reported angles by a parameter
    of the path; `rate` (n): those of the coordinates, in which `angles` are reported angles; `pose` (3):
    reading of the sensor, late by `delay`.
    """

    system: ReducedSystem
    sensors: tuple[Quantity, ...]
    turning: ca.SX
    rate: ca.SX
    pose: ca.SX
    delay: ca.SX
    measured: Sequence[int]

    @classmethod
    def of(
        cls, system: ReducedSystem, angles: Sequence[str], measured: Sequence[int] = (0, 1, 2)
    ) -> "_Geometry":
        """`measured`: which of x, y and heading are. Raises BadInput if the angles do not determine the
        quasi-velocities."""
        mechanism, sensors = system.mechanism, sensor_parameters(angles)
        if mechanism.why_carried:
            raise BadInput(f"{mechanism.name}: {mechanism.why_carried}")
        symbols = {q.name: q.symbol for q in (*mechanism.coordinates, *sensors)}
        places = [k for k, q in enumerate(mechanism.coordinates) if q.name in angles]
        reported = mechanism.q[places]
        scale, zero = (
            ca.vertcat(*[symbols[f"{kind}_{name}"] for name in angles]) for kind in ("scale", "zero")
        )
        turning = ca.SX.sym("turning", len(places))
        S = ca.substitute(system.S, reported, scale * reported + zero)
        rows = S[places, :]
        if generic_rank(rows) < system.dof:
            others = [q.name for q in mechanism.coordinates if q.name not in (*pose_names(system), *angles)]
            raise BadInput(
                f"{', '.join(angles)} alone cannot tell how {mechanism.name} moves in its {system.dof} "
                "quasi-velocities; "
                + (f"log {' or '.join(others)} too" if others else "no other angle is a coordinate of it")
            )
        nu = (
            solve(rows, scale * turning)
            if len(places) == system.dof
            else solve(rows.T @ rows, rows.T @ (scale * turning))
        )
        rate = S @ nu
        for row, k in enumerate(places):
            rate[k] = turning[row]
        x, y, heading = (symbols[name] for name in pose_names(system))
        ahead = ca.vertcat(ca.cos(heading), ca.sin(heading))
        left = ca.vertcat(-ahead[1], ahead[0])
        place = ca.vertcat(x, y) + symbols["offset_x"] * ahead + symbols["offset_y"] * left
        reading = ca.vertcat(place, heading + symbols["offset_heading"])
        return cls(system, sensors, turning, rate, reading, symbols["delay"], measured)

    def determined(
        self, quantities: Sequence[Quantity], names: Sequence[str], values: np.ndarray
    ) -> list[Combination]:
        """Return the combinations of the named parameters that the velocity of the measured pose, seen along
        its own axes, determines; the delay by itself.
        """
        q, heading = self.system.mechanism.q, self.pose[2]
        velocity = ca.jtimes(self.pose, q, self.rate)
        along = ca.vertcat(ca.cos(heading), ca.sin(heading))
        place = ca.vertcat(ca.dot(along, velocity[:2]), along[0] * velocity[1] - along[1] * velocity[0])
        relative = ca.vertcat(place if {0, 1} <= {*self.measured} else [], velocity[2])
        moving = [*ca.vertsplit(q), *ca.vertsplit(self.turning)]
        parameters = {p.name: p.symbol for p in quantities}
        return determined(ca.vertcat(relative, self.delay), moving, parameters, names, values.tolist())

    def prediction(self, quantities: Sequence[Quantity], names: Sequence[str]) -> Prediction:
        """Return the motion from row to row. Inputs of a row are the changes of the angles until the next,
        half of the change of that change from one row to the next, and their rates before the row, which move
        a late pose back.
        """
        q, angles = self.system.mechanism.q, self.turning.shape[0]
        change, bend = ca.SX.sym("change", angles), ca.SX.sym("bend", angles)
        inputs = ca.vertcat(change, bend, self.turning)
        factor = next(p.symbol for p in quantities if p.name == BEND)
        parameters = [p.symbol for p in quantities]
        rate = ca.Function("rate", [q, self.turning, ca.vertcat(*parameters)], [self.rate])

        def f(at: ca.SX, s: float) -> ca.SX:
            return rate(at, change + factor * (2 * s - 1) * bend, ca.vertcat(*parameters))

        end = runge_kutta([partial(f, s=s) for s in (0.0, 0.5, 0.5, 1.0)], q, 1.0)
        # By the midpoint rule
        earlier = q - self.delay * ca.substitute(self.rate, q, q - self.delay / 2 * self.rate)
        late = ca.substitute(self.pose, q, earlier)[[*self.measured]]
        fitted = [p.symbol for name in names for p in quantities if p.name == name]
        return Prediction(
            with_derivatives("step", end, q, inputs, parameters, fitted),
            with_derivatives("output", late, q, inputs, parameters, fitted),
            tuple(names),
            np.array([k == 2 for k in self.measured]),
        )


def _windows(
    logs: Sequence[PoseLog],
    system: ReducedSystem,
    pose: Sequence[str],
    measured: Sequence[int] = (0, 1, 2),
    direction: float = 0.0,
) -> Windows:
    """Divide the logs at poses, of which these entries are measured; shorter windows are filled with rows in
    which nothing moves or is measured. `direction` of the pose sensor, rad.
    """
    coordinates = [q.name for q in system.mechanism.coordinates]
    angles, places = (
        [coordinates.index(name) for name in names] for names in (logs[0].names, [pose[k] for k in measured])
    )
    longest = max(2, math.ceil(sum(len(log.t) for log in logs) / WINDOWS))
    begins = np.cumsum([0, *(len(log.t) for log in logs)])
    pieces = [
        (log, begin, *piece)
        for log, begin in zip(logs, begins, strict=False)
        for stretch in log.stretches
        for piece in _pieces(log, stretch, longest, measured)
    ]
    if not pieces:
        raise BadInput("the log has no two poses on a stretch without a gap; two or more are needed")
    rows = max(last - first for _, _, first, last in pieces) + 1
    start = np.zeros((len(pieces), len(coordinates)))
    inputs, outputs = (
        np.zeros((len(pieces), rows, 3 * len(angles))),
        np.full((len(pieces), rows, len(measured)), math.nan),
    )
    t, number = np.full((len(pieces), rows), math.nan), np.full((len(pieces), rows), -1)
    for k, (log, begin, first, last) in enumerate(pieces):
        here, count = slice(first, last + 1), last + 1 - first
        change = np.diff(log.angles[here], axis=0)
        inputs[k, : count - 1, : len(angles)] = change
        step = np.diff(log.t[here])[:, None]
        rates = change / step
        if count > 2:
            middles = (log.t[here][1:] + log.t[here][:-1]) / 2
            inputs[k, : count - 1, len(angles) : 2 * len(angles)] = (
                np.gradient(rates, middles, axis=0) * step**2 / 2
            )
        # Before the row: poses are late
        inputs[k, :count, 2 * len(angles) :] = np.concatenate([rates[:1], rates])
        outputs[k, :count], t[k, :count] = log.pose[here][:, measured], log.t[here]
        number[k, :count] = begin + np.arange(first, last + 1)
        start[k, angles] = log.angles[first]
        start[k, places] = [
            filled(log.t[here], log.pose[here, each])[0] - direction * (each == 2) for each in measured
        ]
    return Windows(start, places, inputs, outputs, np.ones(len(pieces), bool), t, number)


def _pieces(log: PoseLog, stretch: range, longest: int, measured: Sequence[int]) -> list[tuple[int, int]]:
    """Return first and last row of the windows of a stretch, both with a pose;
    each begins where the one before ends."""
    with_pose = [k for k in stretch if np.isfinite(log.pose[k, [*measured][:2]]).all()]
    pieces, first = [], 0
    while first < len(with_pose) - 1:
        within = [k for k in range(first + 1, len(with_pose)) if with_pose[k] - with_pose[first] <= longest]
        last = within[-1] if within else first + 1
        pieces.append((with_pose[first], with_pose[last]))
        first = last
    return pieces
