"""The effect of model errors: the closed loop about its steady motion with different parameters of robot and
law."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from scipy.optimize import differential_evolution

from ...readers.errors import BadInput
from ...readers.progress import Reported, silent
from ...simulation.controllers.odometry import vehicle_wheels
from .drive import DriveLoop
from .margins import margins
from .motion import Setting, SteadyMotion, steady_motion

# Largest number of combinations of all errors; if there are more, as many are drawn at random
MOST_CORNERS = 256
LOST = 1e6  # 1/s: stands for a loop without a steady motion
# Of the search for the worst errors; errors drawn at random to check it
POPULATION, GENERATIONS, DRAWN = 32, 20, 200
# SI unit of the first output: an offset regarded as equivalent to the loss of all decay or margin
LARGE_OFFSET = 0.1


@dataclass(frozen=True, eq=False)
class Wrong:
    """One closed loop with errors, `amounts` by name. `motion` is None if it has no steady motion.

    `decay` (1/s): rate at which the slowest part of a deviation decays, negative if it grows; `offset`:
    steady error of the first output, in its unit.
    """

    amounts: Mapping[str, float]
    motion: SteadyMotion | None = field(repr=False)
    eigenvalues: np.ndarray
    decay: float
    offset: float

    @property
    def stable(self) -> bool:
        """Whether every deviation decays."""
        return self.decay > 0


@dataclass(frozen=True)
class Harm:
    """The worse effect of two errors of the same size, positive and negative: on decay, disk margin at all
    inputs at once, longest period, offset. `loss` is the largest relative loss of the first three: 1 if
    stability is lost. `hurt`, by which errors are ranked, is the larger of `loss` and |offset| /
    LARGE_OFFSET; infinite if stability is lost.
    """

    name: str
    decay: float
    disk: float
    longest_period: float
    offset: float
    loss: float
    hurt: float


@dataclass(frozen=True)
class Loops:
    """How the loops are sampled: period (s; None: continuous), delay of one sample; and the drives,
    if they take velocities."""

    period: float | None = None
    delay: bool = False
    drive: DriveLoop | None = None


CONTINUOUS = Loops()


def errors_of(setting: Setting) -> tuple[str, ...]:
    """Return the possible errors: the robot's parameters, the position of P_l (L), the measured heading
    (heading), speed (speed).
    """
    names = [p.name for p, value in zip(setting.law.parameters, setting.true, strict=True) if value]
    names += ["L"] if _lever(setting) else []
    names += ["heading"] if _heading_entry(setting) is not None else []
    return (*names, *(["speed"] if _speeds(setting) else []))


def wrong(setting: Setting, name: str, amount: float) -> Setting:
    """Return the setting with one error of size `amount`: a relative change of the true parameter, or of the
    speed; of the law's L, relative to the distance of P_l from the axle; of the measured heading, rad. Raises
    BadInput for an unknown name.
    """
    law = setting.law
    parameters = [p.name for p in law.parameters]
    if name in parameters:
        true = setting.true.copy()
        true[parameters.index(name)] *= 1 + amount
        return replace(setting, true=true)
    if name == "L" and _lever(setting):
        config = setting.config.copy()
        config[[c.name for c in law.config].index("L")] += amount * _lever(setting)
        return replace(
            setting, config=config, measured=setting.config if setting.measured is None else setting.measured
        )
    if name == "heading" and _heading_entry(setting) is not None:
        bias = np.zeros(len(setting.start)) if setting.bias is None else setting.bias.copy()
        bias[_heading_entry(setting)] += amount
        return replace(setting, bias=bias)
    if name == "speed" and _speeds(setting):
        reference, start = setting.reference.copy(), setting.start.copy()
        reference[_speeds(setting)] *= 1 + amount
        start[-law.system.dof :] *= 1 + amount
        return replace(setting, reference=reference, start=start)
    raise BadInput(f"nothing named {name!r} can be wrong; known are {', '.join(errors_of(setting))}")


def with_errors(nominal: SteadyMotion, amounts: Mapping[str, float], loops: Loops = CONTINUOUS) -> Wrong:
    """Return the closed loop with these errors, near the motion without errors."""
    setting = replace(nominal.setting, start=nominal.state)
    for name, amount in amounts.items():
        setting = wrong(setting, name, amount)
    try:
        motion = steady_motion(setting)
    except BadInput:
        return Wrong(amounts, None, np.zeros(0), -np.inf, np.nan)
    eigenvalues = motion.eigenvalues(loops.period, loops.delay)
    return Wrong(amounts, motion, eigenvalues, motion.decay(loops.period, loops.delay), float(motion.rho[0]))


def one_by_one(
    nominal: SteadyMotion,
    amounts: Iterable[float],
    loops: Loops = CONTINUOUS,
    names: Sequence[str] = (),
) -> Iterator[Wrong]:
    """Yield each error with each amount, the others zero."""
    for name in names or errors_of(nominal.setting):
        for amount in amounts:
            yield with_errors(nominal, {name: amount}, loops)


def corners(
    nominal: SteadyMotion,
    spread: float,
    loops: Loops = CONTINUOUS,
    names: Sequence[str] = (),
    progress: Reported = silent,
) -> Iterator[Wrong]:
    """Yield all errors at once, -spread or +spread each, in every combination; MOST_CORNERS random ones, from
    a fixed seed, if there are more."""
    names = tuple(names or errors_of(nominal.setting))
    signs = list(product((-1.0, 1.0), repeat=len(names)))
    if len(signs) > MOST_CORNERS:
        chosen = np.random.default_rng(0).choice(len(signs), MOST_CORNERS, replace=False)
        signs = [signs[k] for k in chosen]
    for k, each in enumerate(signs):
        progress(k, len(signs), "combinations of errors")
        yield with_errors(nominal, dict(zip(names, (spread * sign for sign in each), strict=True)), loops)


@dataclass(frozen=True)
class Searched:
    """The slowest loop that a search in the box of all errors found, after `tried` loops; and the slowest
    decay (1/s) of `drawn` further ones whose errors were drawn at random. No proof: a bound of all of them
    may be lower.
    """

    worst: Wrong
    tried: int
    drawn: int
    slowest_drawn: float


def search(
    nominal: SteadyMotion,
    spread: float,
    loops: Loops = CONTINUOUS,
    begun: Sequence[Wrong] = (),
    names: Sequence[str] = (),
    progress: Reported = silent,
) -> Searched:
    """Search all errors within +-spread for those with the slowest decay, by differential evolution from a
    fixed seed (R. Storn and K. Price, 1997). It begins with the slowest of the loops `begun`, such as
    `corners`, and others at random.
    """
    names, random = tuple(names or errors_of(nominal.setting)), np.random.default_rng(0)
    best, tried = min(begun, key=lambda case: case.decay, default=with_errors(nominal, {}, loops)), 0
    all_of_it = POPULATION * (GENERATIONS + 1) + DRAWN

    def decay(amounts: np.ndarray) -> float:
        nonlocal best, tried
        progress(tried, all_of_it, "errors in search of the worst")
        case = with_errors(nominal, dict(zip(names, amounts.tolist(), strict=True)), loops)
        best, tried = min(best, case, key=lambda each: each.decay), tried + 1
        return max(case.decay, -LOST)

    slowest = sorted(begun, key=lambda case: case.decay)[: POPULATION // 2]
    start = np.array([[case.amounts[name] for name in names] for case in slowest]).reshape(-1, len(names))
    more = random.uniform(-spread, spread, (POPULATION - len(start), len(names)))
    box = [(-spread, spread)] * len(names)
    options = {"init": np.vstack([start, more]), "maxiter": GENERATIONS, "tol": 0.0, "polish": False}
    differential_evolution(decay, box, rng=np.random.default_rng(0), **options)
    searched, drawn = tried, [decay(each) for each in random.uniform(-spread, spread, (DRAWN, len(names)))]
    return Searched(best, searched, DRAWN, float(min(drawn)))


def ranking(
    nominal: SteadyMotion, spread: float, loops: Loops = CONTINUOUS, progress: Reported = silent
) -> list[Harm]:
    """Return the effect of each error of +-spread alone, the largest first (`Harm.hurt`)."""
    right = _harm("", [with_errors(nominal, {}, loops)], loops, None)
    names, harms = errors_of(nominal.setting), list[Harm]()
    for name in names:
        progress(len(harms), len(names), "errors")
        harms.append(_harm(name, list(one_by_one(nominal, (-spread, spread), loops, [name])), loops, right))
    return sorted(harms, key=lambda harm: -harm.hurt)


def _harm(name: str, cases: Sequence[Wrong], loops: Loops, right: Harm | None) -> Harm:
    decay, offset = min(case.decay for case in cases), max((case.offset for case in cases), key=abs)
    stable = [case.motion for case in cases if case.motion and case.stable]
    if len(stable) < len(cases):
        return Harm(name, decay, 0.0, 0.0, offset, 1.0, np.inf)
    disk = min(margins(motion.broken(loops.period, loops.delay)).disk for motion in stable)
    longest = min(motion.longest_period(loops.delay) for motion in stable)
    # The parts that are kept of what the right model has; all of what is zero or unlimited there.
    pairs = (
        [] if right is None else [(decay, right.decay), (disk, right.disk), (longest, right.longest_period)]
    )
    kept = [part / whole if part != whole and whole else 1.0 for part, whole in pairs] or [1.0]
    loss = float(1 - min(kept))
    return Harm(name, decay, disk, longest, offset, loss, max(loss, abs(offset) / LARGE_OFFSET))


def _lever(setting: Setting) -> float:
    """Return the distance of P_l ahead of the axle, in the law's parameters, m; 0 without a P_l."""
    names = [c.name for c in setting.law.config]
    if "L" not in names:
        return 0.0
    try:
        return float(
            setting.config[names.index("L")] + vehicle_wheels(setting.law.system, setting.believed)[2]
        )
    except BadInput:
        return 0.0


def _heading_entry(setting: Setting) -> int | None:
    """Return the index of the heading in the state; None if it is not a coordinate."""
    vehicle = setting.law.system.mechanism.vehicle
    names = [q.name for q in setting.law.state]
    return names.index(str(vehicle.heading)) if vehicle and str(vehicle.heading) in names else None


def _speeds(setting: Setting) -> list[int]:
    """Return the entries of the reference that are speeds: the desired speed, or rates of positions,
    if they are not zero."""
    names = [q.name for q in setting.law.reference]
    units = [q.unit for q in setting.law.reference]
    return [
        k
        for k, (name, unit) in enumerate(zip(names, units, strict=True))
        if unit == "m/s" and setting.reference[k]
    ]
