"""What a run on a floor shows beside the rows of any run: slip, loads and forces of the contacts, and the reckoned pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...model.mechanism import Mechanism

SLIPS = 0.01  # m/s from which on a contact counts as slipping
LIFTED = 0.1 + 1e-9  # s from which on it is said that a contact carried nothing


@dataclass(frozen=True, eq=False)
class FloorMeasurements:
    """For each row and contact, (N, c): slip (m/s), load (N), friction use (1: it slips); forces along and across in turn,
    (N, 2 c), N; the coordinates of the pose from dead reckoning, (N, 3), m and rad, None for a robot that cannot reckon. `mu` is
    the friction of the floor outside its patches.
    """

    slip: np.ndarray
    load: np.ndarray
    use: np.ndarray
    force: np.ndarray
    reckoned: np.ndarray | None
    mu: float

    def columns(self, mechanism: Mechanism) -> list[str]:
        """Return the names of the CSV columns of `values`."""
        names = [contact.name.replace(" ", "_") for contact in mechanism.contacts]
        pose = [] if self.reckoned is None else ["x", "y", "phi"]
        return [*(f"slip_{name}" for name in names), *(f"load_{name}" for name in names), *(f"reckoned_{name}" for name in pose)]

    @property
    def values(self) -> np.ndarray:
        """The columns, (N, .)."""
        return np.column_stack([self.slip, self.load, *([] if self.reckoned is None else [self.reckoned])])

    def as_json(self, t: np.ndarray, mechanism: Mechanism) -> dict[str, Any]:
        """Return for each contact its largest slip (m/s), when (s), how long it slips (s), its least and largest load
        (N), how long it carries nothing (s)."""
        during = np.diff(t, append=t[-1])
        return {
            "mu": self.mu,
            "contacts": {
                contact.name: {
                    "slip": slip.max(),
                    "at": t[np.argmax(slip)],
                    "slips_for": during[slip > SLIPS].sum(),
                    "load": [load.min(), load.max()],
                    "lifted_for": during[load <= 0].sum(),
                }
                for contact, slip, load in zip(mechanism.contacts, self.slip.T, self.load.T, strict=True)
            },
        }

    def summary(self, t: np.ndarray, mechanism: Mechanism) -> str:
        """Return a line for each contact."""
        found = self.as_json(t, mechanism)["contacts"]
        return "\n".join(
            f"{name}: slip at most {one['slip']:.3g} m/s (t = {one['at']:.4g} s), above {SLIPS * 100:g} cm/s for "
            f"{one['slips_for']:.3g} s, load {one['load'][0]:.4g} to {one['load'][1]:.4g} N"
            + (f", none for {one['lifted_for']:.3g} s" if one["lifted_for"] > LIFTED else "")
            for name, one in found.items()
        )
