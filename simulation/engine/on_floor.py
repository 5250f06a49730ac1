"""The loop of a controller and a robot on a floor, and what is measured there beside the rows of any run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ...codegen.loop.stages import check
from ...model.vehicle import point_on_body, velocity_map
from ...readers.errors import BadInput
from ..controllers.odometry import vehicle_wheels
from ..integrate import Row, sampled
from ..loop import Loop
from ..sensing import Sensing, angle_coordinates
from ..specification.floor import Floor
from ..specification.spec import ContactSection, Sensors, Spec
from .engine import FloorEngine
from .measured import FloorMeasurements, Skidding
from .scene import SceneEngine
from .stepping import Stepped

TURNED = 0.01  # rad: below it a run does not tell the effective track


class OnFloor:
    """A loop whose robot moves in MuJoCo. `loop` has sensors also where the SPEC has none:
    they reckon beside the true pose."""

    def __init__(self, loop: Loop, spec: Spec):
        """Raises BadInput for a loop without a period, and as Engine."""
        check(spec, "--engine mujoco")
        contact, floor = spec.contact or ContactSection(), spec.floor or Floor()
        self.engine: Stepped
        if spec.scene:
            self.engine = SceneEngine(loop.plant, spec.scene, contact, floor, loop.start)
        else:
            self.engine = FloorEngine(loop.plant, contact, floor, loop.start)
        self.loop, self._simulation = (
            replace(loop, sensing=loop.sensing or _reckoning(loop, spec)),
            spec.simulation,
        )
        self._looks: list[tuple[np.ndarray, ...]] = []
        self._moved: list[tuple[float, np.ndarray, np.ndarray]] = []

    def rows(self) -> Iterator[Row]:
        """Yield the rows of the run, and keep what is measured at each."""

        def hold(t: float, x: np.ndarray, given: np.ndarray, duration: float) -> np.ndarray:
            return self.engine.hold(t, x, given, duration, self.loop.drive)

        for row in sampled(self.loop, self._simulation, (hold, self.engine.pushed)):
            sensing = self.loop.sensing
            self._moved.append((row.t, row.x, row.tau))
            placed = sensing.placed if isinstance(sensing, Sensing) else np.zeros(0)
            self._looks.append((*self.engine.look(), self.engine.carried(), placed))
            yield row

    def measured(self) -> FloorMeasurements:
        """Return what was measured at the rows so far."""
        slip, load, use, force, carried, reckoned = (
            np.array(each) for each in zip(*self._looks, strict=True)
        )
        engine, seen = self.engine, reckoned if self.loop.sensing else None
        stands, skids = engine.standing, self._skidding(slip, force)
        return FloorMeasurements(
            slip, load, use, force, seen, engine.mu, engine.names, engine.castors, carried, stands, skids
        )

    def _skidding(self, slip: np.ndarray, force: np.ndarray) -> Skidding | None:
        """Return what skidding cost, None if each wheel has a coordinate. Heading and angles of the wheels
        give the track: the change of the heading is that of the believed track times a factor, fitted by
        least squares.
        """
        t, x, tau = (np.array(each) for each in zip(*self._moved, strict=True))
        system, wheels = self.loop.plant.system, self.engine.planar.wheels
        point = point_on_body(system)
        if len(self.engine.names) == len(wheels) or velocity_map(system) is None or point is None:
            return None
        along, across = force.reshape(len(t), -1, 2).transpose(2, 0, 1)
        ahead = np.array([place[0] for wheel in wheels for place in wheel.places])
        forward, turn, _ = vehicle_wheels(system, self.loop.plant.parameters)
        believed = np.diff(x[:, angle_coordinates(system)], axis=0) @ turn
        turned, square = np.diff(x[:, point.pose[2]]), float(believed @ believed)
        track = float(np.abs(forward / turn).sum())
        power = np.einsum("ki,ki->k", tau[:-1], np.diff(x[:, angle_coordinates(system)], axis=0))
        return Skidding(
            float(np.hypot(along, across)[1:].ravel() @ (np.diff(t)[:, None] * slip[1:]).ravel()),
            float(np.maximum(power, 0.0).sum()),
            float(np.abs((ahead - ahead.mean()) @ across.T).max()),
            track * square / float(turned @ believed) if square > TURNED**2 else None,
            track,
        )

    def constraint_forces(self, x: np.ndarray) -> np.ndarray:
        """Return lambda of (8), with the paper's sign, as the floor supplied it at each row x, (N, m)."""
        force = self.engine.on_contacts(self.measured().force)
        combination = self.loop.plant.contacts(x)[0][:, : force.shape[1]]  # without supports
        return -(combination.swapaxes(1, 2) @ force[:, :, None])[:, :, 0]


def _reckoning(loop: Loop, spec: Spec) -> Sensing | None:
    """Return exact sensors with the true pose; None for a robot that cannot reckon its pose."""
    try:
        seen = (loop.plant.parameters, loop.believed, loop.start, spec.simulation.backend)
        return Sensing(Sensors(pose="true"), None, loop.law, *seen)
    except BadInput:
        return None
