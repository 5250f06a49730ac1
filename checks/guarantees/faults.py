"""Response of the controller to faults: measures the tables of docs/faults.md.

There are two tables. The first is for each law alone: every bit of every number of the state is flipped in
turn. The second is for the vehicle of firmware/ on its path, with wrong or constant counters, missed ticks, a
wrong clock, and motors without torque.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...readers.robots import find_laws, find_robot, law_of, system_of
from ...simulation.controllers.compiled import CompiledController
from ...simulation.controllers.controller import Limits
from ..verification.sampling import random_plants
from .tools import Failed, Task, need
from .vehicle import STOP, Firmware, FirmwareLoop, SettingsRefused

PAGE = "docs/faults.md"
SEED, STATES, BITS = 1992, 20, 32
LIMIT = 20.0  # N m
SAME = 0.01  # of the limit: smaller changes of a torque count as none
BEGIN, TICKS = 200, 2600  # of a run: when the fault begins, and the total number
NO_MASS = tuple((f"params__{name}", 1e-30) for name in ("m_c", "m_w", "I_c", "I_w", "I_m"))
REASONS = ("runs", "stops: an error", "stops: too many strikes", "stops: a wheel stands")

TEXT = """# Response to faults

Measured by `python -m noslip.checks.guarantees faults`, which fails if the measurements differ from this
page; `--update` rewrites it.

## One flipped bit in the input of a law

Laws of the LABMATE in float, limits {limit:g} N m, {states} random states; each of the {bits} bits of
each number of the state is flipped in turn. "Same" means that no torque changes by more than {same:.0%}
of the limit. No torque is NaN or exceeds its limit, and with every error the torques are zero. Faults
in the column "other" can only be detected by plausibility checks before the law, such as those of the
vehicle in `firmware/`.

| law | same | other, within limits | nonfinite | range | singular |
|---|---|---|---|---|---|
{rows}

## The vehicle of firmware/ on its path

Ticks of 10 ms, 1 m/s, counters of 16 bits. The fault begins at tick {begin}, a fault in the settings at
the start. The watchdog holds the last torques for up to 3 bad or missed ticks, then stops. "After" and
"rolled" count from the fault to the stop. "Error" is the position error of the true vehicle at the end,
from dead reckoning and path following together. At every tick the commands are finite and within the
supply voltage, and they are zero after a stop.

| fault | statuses | the vehicle | after, ticks | rolled, m | error, mm |
|---|---|---|---|---|---|
{ends}

An undetected error of the clock makes every rate wrong. Rates above `fastest` are rejected. A singular
mass matrix makes the law return torques that move nothing. A slipping or lifted wheel is not detected.
"""


# -- a law, with each bit of its state flipped ---------------------------------------------------------------


def flipped(law_name: str, states: int) -> dict[str, int]:
    """Count the results of a law (float, limits 20 N m) by kind after one bit of one number of the state has
    flipped.

    Raises Failed if a torque is not finite or exceeds its limit, or is not zero with an error.
    """
    robot = find_robot("labmate")
    law, counts = (
        law_of(robot, law_name),
        dict.fromkeys(("same", "other", "nonfinite", "range", "singular"), 0),
    )
    for plant in random_plants(law, states, SEED):
        limits = Limits((LIMIT,) * len(robot.inputs))
        controller = CompiledController(law, plant.params, plant.config, plant.gains, "float", limits)
        for point in plant.points:
            _, good = controller.step(point.state, point.reference)
            for k in range(len(point.state)):
                for bit in range(BITS):
                    status, tau = controller.step(_flip(point.state, k, bit), point.reference)
                    counts[_kind(law_name, status, tau, good)] += 1
    return counts


def _flip(state: np.ndarray, k: int, bit: int) -> np.ndarray:
    broken = np.array(state, np.float32)
    broken.view(np.uint32)[k] ^= np.uint32(1 << bit)
    return broken


def _kind(law: str, status: str, tau: np.ndarray, good: np.ndarray) -> str:
    error = status not in ("ok", "saturated")
    if not np.all(np.abs(tau) <= LIMIT) or (error and np.any(tau != 0)):
        raise Failed(f"{law}: returns {status} with torques {tau}")
    return status if error else "same" if np.abs(tau - good).max() <= SAME * LIMIT else "other"


# -- the vehicle on its path ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Fault:
    """A fault: `misread` changes the counters read at a tick, `missed` returns the number of ticks missed
    before it, `settings` are changed before the start (member names as in labmate_follower_f.h, separated by
    `__`)."""

    name: str
    misread: Callable[[int, np.random.Generator, list[int]], list[int]] = lambda tick, random, counts: counts
    missed: Callable[[int], int] = lambda tick: 0
    settings: tuple[tuple[str, float], ...] = ()
    reported: bool = True  # whether the loop receives the number of missed ticks


def _one_bit(bit: int, wheel: int, when: Callable[[int, np.random.Generator], bool]) -> Callable:
    def misread(tick: int, random: np.random.Generator, counts: list[int]) -> list[int]:
        if when(tick, random):
            counts[wheel] ^= 1 << (bit if bit >= 0 else int(random.integers(0, 16)))
        return counts

    return misread


def _stuck(*wheels: int) -> Callable:
    kept: dict[int, int] = {}

    def misread(tick: int, random: np.random.Generator, counts: list[int]) -> list[int]:
        for wheel in wheels:
            if tick >= BEGIN:
                counts[wheel] = kept.setdefault(wheel, counts[wheel])
        return counts

    return misread


def _noisy(tick: int, random: np.random.Generator, counts: list[int]) -> list[int]:
    return [int(random.integers(0, 1 << 16)) for _ in counts] if tick >= BEGIN else counts


def faults() -> list[Fault]:
    """Return all faults, starting with a run without one."""
    once, often = (
        (lambda tick, random: tick == BEGIN),
        (lambda tick, random: tick >= BEGIN and random.random() < 0.01),
    )
    always = lambda tick, random: tick >= BEGIN and random.random() < 0.5  # noqa: E731
    later = lambda missed: lambda tick: missed if tick >= BEGIN else 0  # noqa: E731
    return [
        Fault("none"),
        *(
            Fault(f"bit {bit} of the right counter flips once", _one_bit(bit, 0, once))
            for bit in (0, 4, 8, 10, 12, 15)
        ),
        Fault("a random bit of the left counter flips in 1 % of the ticks", _one_bit(-1, 1, often)),
        Fault("a random bit of the left counter flips in half of the ticks", _one_bit(-1, 1, always)),
        Fault("the right counter stands still", _stuck(0)),
        Fault("both counters stand still", _stuck(0, 1)),
        Fault("both counters show random numbers", _noisy),
        Fault("one tick in 150 is missed", missed=lambda tick: int(tick >= BEGIN and tick % 150 == 0)),
        Fault("3 ticks are missed, once", missed=lambda tick: 3 * (tick == BEGIN)),
        Fault("4 ticks are missed, once", missed=lambda tick: 4 * (tick == BEGIN)),
        Fault("20 ticks are missed, once", missed=lambda tick: 20 * (tick == BEGIN)),
        Fault("every tick takes ten times too long, and the clock shows it", missed=later(9)),
        Fault(
            "every tick takes ten times too long, and the clock does not show it",
            missed=later(9),
            reported=False,
        ),
        Fault(
            "every tick takes twice as long, and the clock does not show it", missed=later(1), reported=False
        ),
        Fault(
            "limits of 0 N m: those of the motors",
            settings=(("limits__limit__0", 0.0), ("limits__limit__1", 0.0)),
        ),
        Fault(
            "limits of 1e-6 N m: no torque", settings=(("limits__limit__0", 1e-6), ("limits__limit__1", 1e-6))
        ),
        Fault(
            "supplies of 1e-6 V: no torque",
            settings=(("motors__0__supply", 1e-6), ("motors__1__supply", 1e-6)),
        ),
        Fault("no mass: m_c = 0", settings=(("params__m_c", 0.0),)),
        Fault("a singular mass matrix: all masses and inertias 1e-30", settings=NO_MASS),
        Fault("a wheel radius of NaN", settings=(("params__r", float("nan")),)),
    ]


@dataclass(frozen=True)
class FaultOutcome:
    """Outcome of a run with a fault: error statuses, how the run ended and after how many ticks of the fault,
    distance rolled from the first fault to the zero command (m; None if it did not stop), and error at the
    end (m; None unless it arrived)."""

    statuses: tuple[str, ...]
    end: str
    after: int | None = None
    rolled: float | None = None
    error: float | None = None


def outcome(c: Firmware, fault: Fault) -> FaultOutcome:
    """Run the vehicle with a fault. Raises Failed if a command is not finite, exceeds its limit,
    or is not 0 after a stop."""
    try:
        loop = FirmwareLoop(c, **dict(fault.settings))
    except SettingsRefused as refused:
        return FaultOutcome((refused.status,), "rejected before anything moves")
    random = np.random.default_rng(SEED)
    statuses: dict[str, None] = {}
    stopped, way, standing = None, 0.0, 0
    begin = 0 if fault.settings else BEGIN
    for tick in range(TICKS):
        missed = fault.missed(tick)

        def misread(counts, tick=tick):
            counts[0], counts[1] = fault.misread(tick, random, [counts[0], counts[1]])

        before = (c.lib.x, c.lib.y)
        status = loop.tick(misread, missed, fault.reported)
        _check(c, fault, loop)
        if stopped is None and tick >= begin:
            way += float(np.hypot(c.lib.x - before[0], c.lib.y - before[1]))
        if status < 0 and stopped is None:
            statuses[c.status(status)] = None
        if stopped is None and loop.state == STOP:
            stopped = tick
        standing += status == c.lib.NOSLIP_ARRIVED
        if standing > 300:
            break
    guide = loop.vehicle.path.guide
    arrived = standing > 300
    return FaultOutcome(
        tuple(statuses),
        REASONS[loop.vehicle.watchdog.reason]
        if stopped is not None
        else "arrives"
        if arrived
        else "runs, not there yet",
        None if stopped is None else stopped - begin + 1,
        way if stopped is not None else None,
        float(np.hypot(guide.remaining, guide.foot.distance)) + loop.drift() if arrived else None,
    )


def _check(c: Firmware, fault: Fault, loop: FirmwareLoop) -> None:
    for k in range(2):
        limit = loop.settings.motors[k].supply
        if not abs(loop.command[k]) <= limit:
            raise Failed(f"{fault.name}: the command is {loop.command[k]} V, the supply {limit} V")
        if loop.state == STOP and loop.command[k] != 0:
            raise Failed(f"{fault.name}: a command of {loop.command[k]} V after the watchdog has stopped")


# -- the page ------------------------------------------------------------------------------------------------


def page(laws: dict[str, dict[str, int]], runs: dict[str, FaultOutcome], states: int) -> str:
    """Return the page with both tables, in Markdown."""
    rows = [
        f"| `{law}` | {' | '.join(_share(n, sum(counts.values())) for n in counts.values())} |"
        for law, counts in laws.items()
    ]
    ends = [
        f"| {name} | {', '.join(o.statuses) or '-'} | {o.end} | {_number(o.after, 'd')} | "
        f"{_number(o.rolled, '.2f')} | {_number(None if o.error is None else 1000 * o.error, '.1f')} |"
        for name, o in runs.items()
    ]
    return TEXT.format(
        limit=LIMIT,
        states=states,
        bits=BITS,
        same=SAME,
        begin=BEGIN,
        rows="\n".join(rows),
        ends="\n".join(ends),
    )


def _share(count: int, all_of_them: int) -> str:
    return f"{100 * count / all_of_them:.1f} %" if count else "-"


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def table(root: Path, states: int = STATES) -> str:
    """Return the page for the firmware of a source tree. Raises Failed as `flipped` and `outcome` do."""
    robot = find_robot("labmate")
    laws = {name: flipped(name, states) for name in find_laws(system_of(robot))}
    with tempfile.TemporaryDirectory() as folder:
        c = Firmware(Path(folder), root)
        runs = {fault.name: outcome(c, fault) for fault in faults()}
    return page(laws, runs, states)


def check(task: Task) -> str:
    """Check that the page agrees with the measurements. Raises Failed if not."""
    need("gcc", "gcc")
    path, now = task.root / PAGE, table(task.root)
    if task.update:
        path.write_text(now, encoding="utf-8")
    if not path.exists() or path.read_text(encoding="utf-8") != now:
        raise Failed(
            f"{PAGE} differs from the measurements; python -m noslip.checks.guarantees faults --update"
        )
    return f"{len(faults())} faults of the vehicle, each bit of the state of each law: as in {PAGE}"
