"""The report of `noslip outer-loop`: gains, channels, the whole loop, and the effect of model errors."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ...model.law import ControlLaw
from ...readers.errors import BadInput
from ...readers.printing import plain
from ...readers.progress import Reported, silent
from ...simulation.specification.spec import Spec
from .channel import Channel, Required, first_unstable, last_kept, longest_period_with
from .design import Gains, by_speed, settling_time, show, size_names
from .margins import Margins, margins
from .motion import SteadyMotion, steady_motion
from .robustness import LARGE_OFFSET, Harm, Loops, Searched, Wrong, corners, ranking, search
from .setting import setting_of

NEUTRAL = 1e-9  # 1/s: rates of decay up to this count as zero, as of the heading of a robot at rest


@dataclass(frozen=True, eq=False)
class OuterLoopReport:
    """A law with its channels by row, as defined by SPEC and gains; `loops`: period and delay; `spread`: size
    of the model errors; `sizes`: largest values of an H-infinity design, by row; `searches`: whether the
    worst combination of errors is searched for.

    Results are computed on first use. Raises BadInput for a period beyond the stability limit.
    """

    law: ControlLaw
    spec: Spec
    gains: Mapping[str, Gains]
    loops: Loops
    required: Required
    spread: float
    progress: Reported = silent
    sizes: Mapping[str, Sequence[float]] = field(default_factory=dict)
    searches: bool = False

    def __post_init__(self):
        for name, channel in self.channels.items():
            channel.check_stable()
            if name in self.sizes:
                channel.disturbed(self.sizes[name])
        if self.why_not:
            return
        motion, period, delay, drive = self.motion, self.loops.period, self.loops.delay, self.loops.drive
        if motion.decay() < -NEUTRAL:
            raise BadInput(
                f"the whole loop is unstable about its motion, with s = {show(motion.eigenvalues()[0])} 1/s: "
                + (
                    "so are the zero dynamics of these outputs; noslip analyse judges those of the others"
                    if self.law.system.underactuated
                    else "if speed and L + d have opposite signs, the heading diverges"
                )
            )
        if period is not None and motion.decay(period, delay) < -NEUTRAL:
            late = (", with a delay of one sample," if delay else "") + (
                f", behind {drive}," if drive else ""
            )
            limit = motion.longest_period(delay)
            slower = f", or with all poles {self.fastest:.4g} times as fast" if drive else ""
            raise BadInput(
                f"period {period:g} s{late} is beyond stability: the whole loop is stable below {limit:.6g} "
                f"s{slower}"
            )

    @cached_property
    def channels(self) -> dict[str, Channel]:
        """The linear channel of each output."""
        units = {row.name: row.unit for row in self.law.output.rows}
        period, delay, drive = self.loops.period, self.loops.delay, self.loops.drive
        return {
            name: Channel(name, units[name], gains, period, delay, drive)
            for name, gains in self.gains.items()
        }

    @cached_property
    def _motion(self) -> SteadyMotion | str:
        try:
            return steady_motion(
                replace(setting_of(replace(self.spec, gains=self.entries())), drive=self.loops.drive)
            )
        except BadInput as error:
            return str(error)

    @property
    def motion(self) -> SteadyMotion:
        """The steady motion. Raises BadInput if there is none; see `why_not`."""
        if isinstance(self._motion, str):
            raise BadInput(self._motion)
        return self._motion

    @property
    def why_not(self) -> str:
        """The reason why there is no steady motion; empty if there is one."""
        return self._motion if isinstance(self._motion, str) else ""

    @cached_property
    def ranking(self) -> list[Harm]:
        """The effect of each error alone, the largest first."""
        return ranking(self.motion, self.spread, self.loops, self.progress)

    @cached_property
    def corners(self) -> list[Wrong]:
        """Combinations of all errors."""
        return list(corners(self.motion, self.spread, self.loops, progress=self.progress))

    @cached_property
    def searched(self) -> Searched:
        """The worst combination of errors that a search finds."""
        return search(self.motion, self.spread, self.loops, self.corners, progress=self.progress)

    @cached_property
    def at_once(self) -> Margins:
        """Margins of the whole loop, broken at all inputs; with velocity drives at all accelerations u,
        or commands."""
        return margins(self.motion.broken(self.loops.period, self.loops.delay))

    @cached_property
    def at_each(self) -> dict[str, Margins]:
        """Margins of the whole loop, broken at one input."""
        period, delay = self.loops.period, self.loops.delay
        return {
            name: margins(self.motion.broken_at(k, period, delay))
            for k, name in enumerate(self.motion.inputs)
        }

    @cached_property
    def longest(self) -> dict[str, float]:
        """Longest periods of the whole loop, s: stable, stable with a delay of one sample,
        with the required margins."""
        motion, delay = self.motion, self.loops.delay

        def slack(period: float) -> float:
            return min(
                self.required.slack(margins(motion.broken_at(k, period, delay)))
                for k in range(motion.B.shape[1])
            )

        limit = motion.longest_period(delay)
        shortest = self.loops.drive.shortest if self.loops.drive else 0.0
        kept = last_kept(slack, limit, shortest) if 0 < limit < math.inf else limit
        return {
            "stable": motion.longest_period(),
            "stable_with_delay": motion.longest_period(True),
            "with_margins": kept,
        }

    @cached_property
    def fastest(self) -> float:
        """The factor by which all poles of the channels may be faster until the whole sampled loop loses
        stability."""
        motion, (period, delay) = self.motion, (self.loops.period, self.loops.delay)

        def excess(factor: float) -> float:
            named = [(row, gains.faster(factor)) for row, gains in self.gains.items()]
            entries = {name: value for row, gains in named for name, value in gains.named(row).items()}
            gains = np.array([entries[gain.name] for gain in self.law.gains])
            integral = tuple(entries.get(f"ki_{row.name}", 0.0) for row in self.law.output.rows)
            setting = replace(motion.setting, start=motion.state, gains=gains, integral=integral)
            return -steady_motion(setting).decay(period, delay) - NEUTRAL

        return first_unstable(excess, 1.0)

    def entries(self) -> dict[str, float]:
        """Gains by name, as the law's struct has them and, with integral action, ki."""
        return {name: value for row, gains in self.gains.items() for name, value in gains.named(row).items()}

    def remembering(self) -> dict[str, float]:
        """Return the gains of integral action and of observers, which in C are not part of the law."""
        return {name: value for name, value in self.entries().items() if name.startswith(("ki_", "ko_"))}

    def spec_text(self) -> str:
        """Return the entry of a SPEC."""
        return f"gains = {{ {', '.join(f'{name} = {value!r}' for name, value in self.entries().items())} }}"

    def c_text(self) -> str:
        """Return the C initializer of the law's gains."""
        prefix, own_header = f"{self.law.system.mechanism.name}_{self.law.name}", self.remembering()
        own = ", ".join(
            f".{name} = {value!r}" for name, value in self.entries().items() if name not in own_header
        )
        return f"const {prefix}_gains gains = {{{own}}};"

    def as_json(self) -> dict[str, Any]:
        """Return all results, SI; complex numbers as [re, im]; null for infinite or unknown values."""
        results = {
            "robot": self.spec.robot,
            "output": self.law.name,
            "period": self.loops.period,
            "delay": self.loops.delay,
            "drive": self.loops.drive and asdict(self.loops.drive),
            "required": asdict(self.required),
            "gains": self.entries(),
            "spec": self.spec_text(),
            "c": self.c_text(),
            "channels": {name: self._channel_json(name, channel) for name, channel in self.channels.items()},
            "whole": {"refused": self.why_not} if self.why_not else self._whole_json(),
            "robust": {"refused": self.why_not} if self.why_not else self._robust_json(),
        }
        return plain(results)

    def _norms(self, name: str) -> dict[str, float | None]:
        """Return the H-infinity norms of a channel of such a design; empty for another."""
        if name not in self.sizes:
            return {}
        channel, sizes = self.channels[name], self.sizes[name]
        return {
            "continuous": channel.ideal.norm(sizes),
            "sampled": channel.norm(sizes) if channel.period else None,
        }

    def _channel_json(self, name: str, channel: Channel) -> dict[str, Any]:
        return {
            "relative_degree": channel.gains.degree,
            "unit": channel.unit,
            "gains": channel.gains.named(name),
            "poles": channel.gains.poles,
            "discrete_poles": channel.poles if channel.period else None,
            "settling_time": settling_time(channel.gains),
            "continuous": _margins_json(channel.ideal.margins()),
            "sampled": _margins_json(channel.margins()) if channel.period else None,
            "longest_period": _periods(channel, self.required),
            "fastest": channel.fastest() if channel.drive else None,
            "norms": self._norms(name) or None,
        }

    def _whole_json(self) -> dict[str, Any]:
        motion, (period, delay) = self.motion, (self.loops.period, self.loops.delay)
        return {
            "motion": dict(zip(motion.names, motion.rho, strict=True)),
            "inputs": dict(zip(motion.inputs, motion.torque, strict=True)),
            "eigenvalues": motion.eigenvalues(),
            "discrete_eigenvalues": motion.eigenvalues(period, delay) if period else None,
            "decay": motion.decay(period, delay),
            "margins_at_once": _margins_json(self.at_once),
            "margins": {name: _margins_json(margins) for name, margins in self.at_each.items()},
            "longest_period": self.longest,
            "fastest": self.fastest if self.loops.drive else None,
        }

    def _robust_json(self) -> dict[str, Any]:
        worst = min(self.corners, key=lambda case: case.decay)
        return {
            "spread": self.spread,
            "worst": self.ranking[0].name,
            "worst_offset": max(self.ranking, key=lambda harm: abs(harm.offset)).name,
            "ranking": [asdict(harm) for harm in self.ranking],
            "together": {
                "tried": len(self.corners),
                "combinations": 2 ** len(worst.amounts),
                "unstable": sum(not case.stable for case in self.corners),
                "slowest_decay": worst.decay,
                "amounts": worst.amounts,
            },
            "searched": self._searched_json() if self.searches else None,
        }

    def _searched_json(self) -> dict[str, Any]:
        found = self.searched
        return {
            "slowest_decay": found.worst.decay,
            "amounts": found.worst.amounts,
            "offset": found.worst.offset,
            "tried": found.tried,
            "drawn": found.drawn,
            "slowest_drawn": found.slowest_drawn,
        }

    def text(self) -> str:
        """Return the report as text."""
        blocks = [self._head(), self._channels_text(), self._whole_text()]
        return "\n\n".join(blocks if self.why_not else [*blocks, self._robust_text()])

    def _head(self) -> str:
        period = "continuous" if self.loops.period is None else f"called every {self.loops.period:g} s"
        late = ", delay of one sample" if self.loops.delay else ""
        behind = f", {self.loops.drive}" if self.loops.drive else ""
        lines = [
            f"{self.spec.robot}, {self.law.name}: {self.law.output.about}; {period}{late}{behind}",
            f"  {self.spec_text()}",
            f"  {self.c_text()}",
        ]
        for name, value in self.remembering().items():
            kind, row = name.split("_", 1)
            header = "noslip_integral.h" if kind == "ki" else "noslip_disturbance.h"
            highest = f"{row}_acceleration" if self.gains[row].degree == 2 else f"{row}_rate"
            lines.append(
                f"  {name} = {value!r}: in C by {header}, its result added to the reference's {highest}"
            )
        return "\n".join(lines)

    def _channels_text(self) -> str:
        rows = []
        for name, channel in self.channels.items():
            gains = ", ".join(
                f"{short[:2]} {value:.4g}" for short, value in channel.gains.named(name).items()
            )
            settles = settling_time(channel.gains)
            rows.append(
                f"{name} ({channel.unit}): {gains}; poles {_show(channel.gains.poles)} 1/s; settles to 2 % "
                f"in {settles:.4g} s"
            )
            rows.append(_margins_text("continuous", channel.ideal.margins()))
            if channel.period:
                rows.append(_margins_text(f"every {channel.period:g} s", channel.margins()))
                rows.append(f"  z {_show(channel.poles)}")
            if norms := self._norms(name):
                rows.append(_norms_text(channel, self.sizes[name], norms))
            if channel.drive:
                rows.append(f"  {_faster_text(channel.fastest())}")
            periods = _periods(channel, self.required)
            rows.append(f"  longest period {_periods_text(periods, self.loops.delay)}")
        return "\n".join(["Channels, exact model", *[f"  {row}" for row in rows]])

    def _whole_text(self) -> str:
        if self.why_not:
            return f"Whole loop: {self.why_not}"
        motion, period, delay = self.motion, self.loops.period, self.loops.delay
        place = ", ".join(
            f"{name} {round(value, 9) + 0.0:.4g}"
            for name, value in zip(motion.names, motion.rho, strict=True)
        )
        lines = [f"Whole loop about its steady motion ({place})", f"  s {_show(motion.eigenvalues())} 1/s"]
        lines += [f"  z {_show(motion.eigenvalues(period, delay))}"] if period else []
        lines += [f"  {_margins_text(name, margins)}" for name, margins in self.at_each.items()]
        lines.append(
            f"  {_margins_text('both at once' if len(self.at_each) == 2 else 'all at once', self.at_once)}"
        )
        lines += [f"    {_faster_text(self.fastest)}"] if self.loops.drive else []
        lines.append(f"    longest period {_periods_text(self.longest, delay)}")
        return "\n".join(lines)

    def _robust_text(self) -> str:
        row = self.law.output.rows[0]
        how = f"(L: of its distance from the axle; heading: {self.spread:g} rad)"
        lines = [
            f"One error of {self.spread:.0%} {how}, in either direction, largest effect first:",
            "by the largest relative loss of decay, margin or longest period, "
            f"or by {row.name} relative to {LARGE_OFFSET:g} {row.unit}",
        ]
        lines += [
            f"  {'':12}{'slowest 1/s':>12}{'disk margin':>13}{'longest s':>12}{f'{row.name} {row.unit}':>14}"
        ]
        for harm in self.ranking:
            offset = f"{harm.offset:.4f}" if abs(harm.offset) > 1e-9 else "0"
            lines.append(
                f"  {harm.name:12}{harm.decay:12.4g}{harm.disk:13.4g}{harm.longest_period:12.4g}{offset:>14}"
            )
        together = self._robust_json()["together"]
        sample = together["tried"] < together["combinations"]
        tried = f"a random sample of {together['tried']} of" if sample else "all"
        lines.append(
            f"  all at once, {tried} {together['combinations']} combinations of signs: "
            f"{together['unstable']} unstable, slowest decay {together['slowest_decay']:.4g} "
            f"1/s{' in the sample' if sample else ''}"
        )
        if self.searches:
            found = self.searched
            amounts = ", ".join(
                f"{name} {amount:+.3g} rad" if name == "heading" else f"{name} {100 * amount:+.3g} %"
                for name, amount in found.worst.amounts.items()
            )
            lines.append(
                f"  worst found in the box, after {found.tried} loops: decay {found.worst.decay:.4g} 1/s, "
                f"with {amounts}; {found.drawn} more at random: none slower than {found.slowest_drawn:.4g} "
                "1/s"
            )
        return "\n".join(lines)


def _periods(channel: Channel, required: Required) -> dict[str, float]:
    stable, late = (channel.longest_period(delay) for delay in (False, True))
    return {
        "stable": stable,
        "stable_with_delay": late,
        "with_margins": longest_period_with(channel, required),
    }


def _periods_text(periods: Mapping[str, float], delay: bool) -> str:
    kept = "with the required margins" + (" (and the delay)" if delay else "")
    stable, late, with_margins = (
        f"{periods[name]:.6g} s" for name in ("stable", "stable_with_delay", "with_margins")
    )
    return f"{stable} stable, {late} with a delay of one sample, {with_margins} {kept}"


def _faster_text(factor: float) -> str:
    return f"stable behind the drives with poles up to {factor:.4g} times as fast"


def _norms_text(channel: Channel, sizes: Sequence[float], norms: Mapping[str, float | None]) -> str:
    named = zip(size_names(channel.gains.degree, bool(channel.gains.integral)), sizes, strict=False)
    relative = ", ".join(f"{name}/{size:g}" for name, size in named)
    achieved = ", ".join(
        f"{norms[how]:.4g} {text}"
        for how, text in (("continuous", "continuous"), ("sampled", f"every {channel.dt:g} s"))
        if norms[how] is not None
    )
    return f"  H-infinity norm from a disturbance/{sizes[-1]:g} of v to {relative}: {achieved}"


def _margins_json(margins: Margins) -> dict[str, float]:
    return asdict(margins)


def _margins_text(name: str, margins: Margins) -> str:
    parts = [f"Ms {margins.Ms:.4g}", f"Mt {margins.Mt:.4g}"]
    parts.append(
        f"disk {margins.disk:.4g} ({_decibel(margins.disk_gain)}, {math.degrees(margins.disk_phase):.3g} deg)"
    )
    if not math.isnan(margins.gain):
        parts = [
            f"gain {_decibel(margins.gain)}",
            f"phase {math.degrees(margins.phase):.3g} deg",
            f"dead time {margins.delay:.3g} s",
            *parts,
        ]
    return f"  {name:14}" + ", ".join(parts)


def _decibel(factor: float) -> str:
    return f"{20 * math.log10(factor):.3g} dB" if 0 < factor < math.inf else "unlimited"


def _show(poles: np.ndarray) -> str:
    return ", ".join(show(pole) for pole in by_speed(poles))
