"""The loop of a controller and a robot on a floor, and what is measured there beside the rows of any run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ...readers.errors import BadInput
from ..integrate import Row, sampled
from ..loop import Loop
from ..sensing import Sensing
from ..specification.floor import Floor
from ..specification.spec import ContactSection, Sensors, Spec
from .engine import FloorEngine
from .measured import FloorMeasurements
from .scene import SceneEngine
from .stepping import Stepped


class OnFloor:
    """A loop whose robot moves in MuJoCo. `loop` has sensors also where the SPEC has none: they reckon beside the true pose."""

    def __init__(self, loop: Loop, spec: Spec):
        """Raises BadInput for a loop without a period, and as Engine."""
        if not spec.simulation.period:
            raise BadInput("--engine mujoco requires [simulation] period > 0: the controller is called as in firmware")
        contact, floor = spec.contact or ContactSection(), spec.floor or Floor()
        self.engine: Stepped
        if spec.scene and spec.push:
            raise BadInput("[[push]] does not go with [scene]: it is along velocities that only the engine's own bodies have")
        if spec.scene:
            self.engine = SceneEngine(loop.plant, spec.scene, contact, floor, loop.start)
        else:
            self.engine = FloorEngine(loop.plant, contact, floor, loop.start)
        self.loop, self._simulation = replace(loop, sensing=loop.sensing or _reckoning(loop, spec)), spec.simulation
        self._looks: list[tuple[np.ndarray, ...]] = []

    def rows(self) -> Iterator[Row]:
        """Yield the rows of the run, and keep what is measured at each."""

        def hold(t: float, x: np.ndarray, given: np.ndarray, duration: float) -> np.ndarray:
            return self.engine.hold(t, x, given, duration, self.loop.drive)

        for row in sampled(self.loop, self._simulation, (hold, self.engine.pushed)):
            sensing = self.loop.sensing
            self._looks.append((*self.engine.look(), sensing.placed if isinstance(sensing, Sensing) else np.zeros(0)))
            yield row

    def measured(self) -> FloorMeasurements:
        """Return what was measured at the rows so far."""
        slip, load, use, force, reckoned = (np.array(each) for each in zip(*self._looks, strict=True))
        return FloorMeasurements(slip, load, use, force, reckoned if self.loop.sensing else None, self.engine.mu)

    def constraint_forces(self, x: np.ndarray) -> np.ndarray:
        """Return lambda of (8), with the paper's sign, as the floor supplied it at each row x, (N, m)."""
        force = self.measured().force
        combination = self.loop.plant.contacts(x)[0][:, : force.shape[1]]  # without supports
        return -(combination.swapaxes(1, 2) @ force[:, :, None])[:, :, 0]


def _reckoning(loop: Loop, spec: Spec) -> Sensing | None:
    """Return exact sensors with the true pose; None for a robot that cannot reckon its pose."""
    try:
        seen = (loop.plant.parameters, loop.believed, loop.start, spec.simulation.backend)
        return Sensing(Sensors(pose="true"), None, loop.law, *seen)
    except BadInput:
        return None
