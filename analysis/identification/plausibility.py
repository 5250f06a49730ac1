"""Logs with a wrong sign, exchanged columns or another unit:
found by what would make them agree with the robot's equations."""

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations

import casadi as ca
import numpy as np

from ...model.reduction import ReducedSystem
from ...readers.errors import BadInput
from ...readers.quantities import scaled_units
from .faults import NORMAL
from .result import Estimate
from .smoothing import slopes

Columns = Mapping[str, np.ndarray]
WRONG = 0.5  # error of the equations, relative to the motion, from which on something else is tried
RIGHT = 0.25  # error below which it is taken for the cause
UNCERTAIN = 2.5  # factor by which lengths of the robot may be off
# Factor by which a fitted length is so far off that the unit of the angles is doubted; a turn has 6.28 rad
FAR = 5.0
NOISY = 3.0  # times its noise: the change of a coordinate from which on it moves
BLOCK = 25  # rows over which motions are compared
OTHER_UNITS = {
    "rad": ("deg", "turn"),
    "rad/s": ("deg/s", "rpm"),
    "m": ("mm", "cm"),
    "s": ("ms", "us", "ns"),
}


@dataclass(frozen=True)
class _Change:
    """Something that may be wrong with a log: how to say it, and the columns without it."""

    text: str
    without: Callable[[Columns], Columns]


def check_kinematics(
    t: np.ndarray,
    columns: Columns,
    system: ReducedSystem,
    values: Sequence[float],
    stretches: Sequence[range],
    measured: Sequence[str],
    scaled: Collection[str] = (),
) -> None:
    """Raise BadInput if measured coordinates contradict those that follow by (9), qdot = S nu, and one change
    of sign, order or unit removes the contradiction.

    `columns`: what was measured of the state, without gaps; `measured`: the angles that give the
    quasi-velocities, where these are not among them; `values`: the robot's parameters, as far as they are
    known; `scaled`: angles whose scale is not known, and whose unit is not judged.
    """
    motion = _Motion(system, values, [name for name in columns], measured)
    if not motion.compared:
        return
    units = {q.name: q.unit for q in system.state}
    wheels = _wheels(system, columns)
    groups = [*((name,) for name in columns), *((*angle, *rate) for angle, rate in wheels if angle and rate)]
    angles = tuple(name for angle, _ in wheels for name in angle)
    known = [name for name in (*columns, "t") if name not in scaled]
    unscaled = tuple(name for name in angles if name not in scaled)
    of_units = _units(known, unscaled, {**units, "t": "s"}, motion.radius)
    _blame(
        {"t": t, **columns},
        lambda logged: motion.misfit(logged, stretches),
        [*_signs(groups), *_exchanges(groups, units), *of_units],
        "the motions of the log contradict each other",
    )


def check_sizes(estimates: Mapping[str, Estimate], values: Mapping[str, float], names: Sequence[str]) -> None:
    """Raise BadInput if a fitted length differs from its value so far by a factor that the unit of the
    angles, which are called `names`, is likely to be another one: turns, or distances in m.
    """
    for name, each in estimates.items():
        given = values.get(name, each.quantity.default)
        if (
            each.quantity.unit == "m"
            and each.quantity.sign == "positive"
            and not 1 / FAR < each.value / given < FAR
        ):
            units = " or ".join(
                " ".join(f"--map '{a}={a} [{unit}]'" for a in names) for unit in ("turn", f"rad/{given:g}")
            )
            raise BadInput(
                f"{name} = {each.value:.4g} m would fit the log, which is far from {given:g} m: are the "
                f"angles in turns, or distances in m? Say {units}; or give a better value to begin with, "
                f"--set {name}={each.value:.2g}"
            )


def check_dynamics(
    columns: Columns, misfit: Callable[[Columns], float], velocities: Sequence[str], inputs: Sequence[str]
) -> None:
    """Raise BadInput if the equations of motion do not hold with any parameters, and one change of sign or
    order of the inputs or velocities makes them hold. `misfit` of changed columns is the relative error of
    the equations after a fit.
    """
    groups = [*((name,) for name in (*velocities, *inputs)), tuple(inputs)]
    swaps = [(a, b) for names in (velocities, inputs) for a, b in combinations(names, 2)]
    changes = [*_signs(groups), *(_exchange([pair]) for pair in swaps)]
    _blame(
        columns, misfit, changes, "the log contradicts the equations of motion whatever the fitted parameters"
    )


def _blame(
    columns: Columns, misfit: Callable[[Columns], float], changes: Sequence[_Change], what: str
) -> None:
    """Raise BadInput with the changes that remove a contradiction."""
    before = misfit(columns)
    if before < WRONG:
        return
    after = [(misfit(change.without(columns)), change.text) for change in changes]
    best = min(after)[0]
    if best < min(RIGHT, before / 3):
        likely = [text for error, text in after if error < 1.1 * best + 0.01]
        raise BadInput(
            f"{what} (error {before:.0%}); they agree ({best:.1%}) with {', or with '.join(likely[:3])}"
        )


def _wheels(system: ReducedSystem, columns: Columns) -> list[tuple[list[str], list[str]]]:
    """Return the measured angle and the measured rate, as far as there are, of each wheel or joint whose rate
    is a quasi-velocity.
    """
    names = [c.name for c in system.mechanism.coordinates]
    angles = [[names[k] for k in places] for places in system.coordinates_by_velocity]
    known = [(each, [q.name]) for each, q in zip(angles, system.quasi_velocities, strict=True)]
    return [([n for n in angle if n in columns], [n for n in rate if n in columns]) for angle, rate in known]


def _signs(groups: Sequence[tuple[str, ...]]) -> Iterator[_Change]:
    for names in groups:
        advice = " ".join(f"--map {name}=-{name}" for name in names)
        yield _Change(
            f"the opposite sign of {' and '.join(names)} ({advice})",
            partial(_scaled, names=names, factor=-1.0),
        )


def _scaled(columns: Columns, names: Sequence[str], factor: float) -> Columns:
    return {**columns, **{name: factor * columns[name] for name in names}}


def _exchanges(groups: Sequence[tuple[str, ...]], units: Mapping[str, str]) -> Iterator[_Change]:
    for first, second in combinations(groups, 2):
        if [units[name] for name in first] == [units[name] for name in second] and not set(first) & set(
            second
        ):
            yield _exchange(list(zip(first, second, strict=True)))


def _exchange(pairs: Sequence[tuple[str, str]]) -> _Change:
    advice = " ".join(f"--map {a}={b} --map {b}={a}" for a, b in pairs)
    new = {**dict(pairs), **{b: a for a, b in pairs}}
    text = " and ".join(f"{a} and {b} exchanged" for a, b in pairs)
    return _Change(f"{text} ({advice})", lambda c: {**c, **{name: c[other] for name, other in new.items()}})


def _units(
    names: Sequence[str], angles: tuple[str, ...], units: Mapping[str, str], radius: float
) -> Iterator[_Change]:
    """Yield other units of single columns, of all in the same unit, and of the angles, which may be distances
    on the floor, m.
    """
    alike = [
        tuple(name for name in names if units[name] == unit)
        for unit in dict.fromkeys(units[name] for name in names)
    ]
    for group in dict.fromkeys([*((name,) for name in names), *alike, angles]):
        others = OTHER_UNITS.get(units[group[0]], ()) if group else ()
        for unit in (*others, *([f"rad/{radius:.6g}"] if group and group == angles and radius else [])):
            factor = float(scaled_units(unit)[0])
            advice = " ".join(f"--map '{name}={name} [{unit}]'" for name in group)
            called = unit if unit in others else f"m on the floor, of wheels with a radius of {radius:.6g} m"
            yield _Change(
                f"{', '.join(group)} in {called} ({advice})",
                partial(_scaled, names=group, factor=factor),
            )


class _Motion:
    """The coordinates that were measured, and their changes that follow from the other measurements."""

    def __init__(
        self, system: ReducedSystem, values: Sequence[float], names: Sequence[str], measured: Sequence[str]
    ):
        coordinates = [q.name for q in system.mechanism.coordinates]
        self._state = [q.name for q in system.state]
        self._velocities = [q.name for q in system.quasi_velocities]
        self._by_angles = not set(self._velocities) <= set(names)
        self._angles = [coordinates.index(name) for name in measured] if self._by_angles else []
        unknown = [q.symbol for q in system.mechanism.coordinates if q.name not in names]
        self.compared = [
            k
            for k, name in enumerate(coordinates)
            if name in names
            and k not in self._angles
            and not any(ca.depends_on(system.qdot[k], each) for each in unknown)
        ]
        arguments = [system.mechanism.q, system.nu, system.mechanism.p]
        self._rates = ca.Function(
            "rates", arguments, [ca.densify(system.qdot), ca.densify(system.S), ca.densify(system.carried)]
        )
        self._values = np.array(values, float)
        lengths = [k for k, q in enumerate(system.mechanism.coordinates) if q.unit == "m"]
        rolling = self._rates(np.zeros(len(coordinates)), np.ones(system.dof), self._values)[0].full()[
            lengths
        ]
        # m per rad, where all quasi-velocities are alike
        self.radius = float(np.nan_to_num(np.linalg.norm(rolling)))

    def misfit(self, columns: Columns, stretches: Sequence[range]) -> float:
        """Return the error of the changes over blocks of rows, relative to the changes: the RMS over the
        coordinates that move by more than noise. Each coordinate's changes may be off by the same factor, up
        to UNCERTAIN.
        """
        t, count = columns["t"], len(columns["t"])
        x = np.column_stack([columns.get(name, np.zeros(count)) for name in self._state])
        n = len(self._state) - len(self._velocities)
        q, nu = x[:, :n], x[:, n:]
        values = np.tile(self._values[:, None], count)
        if self._by_angles:
            _, S, carried = self._rates.map(count)(q.T, nu.T, values)
            rows = S.full().reshape(n, count, -1).transpose(1, 0, 2)[:, self._angles]
            given = (slopes(t, q, stretches) - carried.full().T)[:, self._angles]
            nu = (np.linalg.pinv(rows) @ given[:, :, None])[:, :, 0]
        rates = self._rates.map(count)(q.T, nu.T, values)[0].full().T
        ends = [range(s.start, s.stop, BLOCK) for s in stretches]
        integrals = np.vstack(
            [np.zeros(n), np.cumsum((rates[1:] + rates[:-1]) / 2 * np.diff(t)[:, None], axis=0)]
        )
        predicted, actual = (
            np.vstack([np.diff(each[list(rows)], axis=0) for rows in ends]) for each in (integrals, q)
        )
        ratio = np.sum(predicted * actual, axis=0) / np.maximum(np.sum(predicted**2, axis=0), 1e-300)
        predicted = predicted * np.clip(ratio, 1 / UNCERTAIN, UNCERTAIN)
        sizes = np.sqrt(np.maximum(np.mean(predicted**2, axis=0), np.mean(actual**2, axis=0)))
        errors = np.sqrt(np.mean((predicted - actual) ** 2, axis=0))
        uneven = np.maximum(*(np.median(np.abs(np.diff(each, 2, axis=0)), axis=0) for each in (integrals, q)))
        noise = NORMAL * uneven / math.sqrt(3)  # of a difference of two rows
        moving = [k for k in self.compared if sizes[k] > NOISY * noise[k]]
        return float(np.sqrt(np.mean((errors[moving] / sizes[moving]) ** 2))) if moving else 0.0
