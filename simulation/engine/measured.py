"""What a run on a floor shows beside the rows of any run: slip, loads and forces of the contacts,
and the reckoned pose."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

SLIPS = 0.01  # m/s from which on a contact counts as slipping
LIFTED = 0.1 + 1e-9  # s from which on it is said that a contact carried nothing


@dataclass(frozen=True, eq=False)
class FloorMeasurements:
    """For each row and each of `names`, contacts or their wheels, (N, c): slip (m/s), load (N), friction use
    (1: it slips); forces along and across in turn, (N, 2 c), N; the coordinates of the pose from dead
    reckoning, (N, 3), m and rad, None for a robot that cannot reckon; the loads of `castors`, (N, k), N. `mu`
    is the friction of the floor outside its patches, `stands` says how the robot stands at rest, `skids` what
    skidding cost.
    """

    slip: np.ndarray
    load: np.ndarray
    use: np.ndarray
    force: np.ndarray
    reckoned: np.ndarray | None
    mu: float
    names: tuple[str, ...]
    castors: tuple[str, ...]
    carried: np.ndarray
    stands: Standing | None = None
    skids: Skidding | None = None

    @property
    def filled(self) -> dict[str, tuple[Iterable[object], Iterable[np.ndarray]]]:
        """For the columns of the table of stages: what the <NAME> in each stands for, and the values,
        (N) for each name."""
        return {
            "slip_<CONTACT>": (self.names, self.slip.T),
            "load_<CONTACT>": ((*self.names, *self.castors), (*self.load.T, *self.carried.T)),
            "reckoned_<POSE>": (("x", "y", "phi"), () if self.reckoned is None else self.reckoned.T),
        }

    def as_json(self, t: np.ndarray) -> dict[str, Any]:
        """Return for each contact its largest slip (m/s), when (s), how long it slips (s), its least and
        largest load (N), and how long it carries nothing (s), the last two for castors too; how the robot
        stands; what skidding cost.
        """
        during = np.diff(t, append=t[-1])
        loads = {
            name: {"load": [load.min(), load.max()], "lifted_for": during[load <= 0].sum()}
            for name, load in zip((*self.names, *self.castors), (*self.load.T, *self.carried.T), strict=True)
        }
        slips = {
            name: {"slip": slip.max(), "at": t[np.argmax(slip)], "slips_for": during[slip > SLIPS].sum()}
            for name, slip in zip(self.names, self.slip.T, strict=True)
        }
        return {
            "mu": self.mu,
            "contacts": {name: slips[name] | loads[name] for name in self.names},
            "castors": {name: loads[name] for name in self.castors},
            "stands": self.stands and asdict(self.stands),
            "skids": self.skids and asdict(self.skids),
        }

    def summary(self, t: np.ndarray) -> str:
        """Return how the robot stands, a line for each contact and castor, and what skidding cost."""
        found = self.as_json(t)
        lines = [self.stands.summary()] if self.stands else []
        slips = {
            name: f"slip at most {one['slip']:.3g} m/s (t = {one['at']:.4g} s), above {SLIPS * 100:g} cm/s "
            f"for {one['slips_for']:.3g} s, "
            for name, one in found["contacts"].items()
        }
        for name, one in {**found["contacts"], **found["castors"]}.items():
            lifted = f", none for {one['lifted_for']:.3g} s" if one["lifted_for"] > LIFTED else ""
            lines.append(
                f"{name}: {slips.get(name, '')}load {one['load'][0]:.4g} to {one['load'][1]:.4g} N{lifted}"
            )
        return "\n".join([*lines, *([self.skids.summary()] if self.skids else [])])


@dataclass(frozen=True)
class Standing:
    """How a robot stands at rest: its mass (kg), the height of its centre of mass (m; None: on the ground,
    since nothing says it), the load (N) on each contact and castor, and the places of castors, ahead of and
    to the left of the first body (m).
    """

    mass: float
    height: float | None
    loads: dict[str, float]
    castors: dict[str, tuple[float, float]]

    @property
    def left_out(self) -> str:
        """What the engine does not have of a robot, because nothing says it; empty if it has all."""
        height = (
            "the height of the centre of mass, so that no load shifts and nothing topples ([contact] height)"
        )
        castors = "castors, on which a part of the weight may rest (support() of the robot, [contact] share)"
        absent = [height] if self.height is None else []
        absent += [] if self.castors else [castors]
        absent += [] if self.castors or len(self.loads) > 2 else ["a second pair of wheels, as of skid steer"]
        return "; ".join(absent)

    def summary(self) -> str:
        """Return a line."""
        height = (
            "as low as the ground (no height is given)"
            if self.height is None
            else f"{self.height:.3g} m high"
        )
        loads = [f"{name} {load:.4g} N" for name, load in self.loads.items()]
        at = [
            f"{name} {ahead:.3g} m ahead and {left:.3g} m to the left"
            for name, (ahead, left) in self.castors.items()
        ]
        places = f"; {', '.join(at)} of the first body's origin" if at else ""
        return f"stands: {self.mass:.4g} kg, centre of mass {height}; at rest {', '.join(loads)}{places}"


@dataclass(frozen=True)
class Skidding:
    """What several wheels on one coordinate cost as they skid: `lost` (J) of the `supplied` (J) by the
    inputs, the largest `moment` (N m) of their side forces, and the effective `track` (m) fitted from the
    run, beside the `believed` one; None where the robot did not turn.
    """

    lost: float
    supplied: float
    moment: float
    track: float | None
    believed: float

    def summary(self) -> str:
        """Return a line."""
        part = f" ({self.lost / self.supplied:.0%})" if self.supplied > 0 else ""
        fitted = (
            "the robot did not turn: no effective track"
            if self.track is None
            else f"effective track {self.track:.4g} m"
        )
        cost = (
            f"skidding costs {self.lost:.3g} J of {self.supplied:.3g} J{part}, moment at most "
            f"{self.moment:.3g} N m"
        )
        return f"{cost}; from this run {fitted}, the robot has {self.believed:.4g} m"
