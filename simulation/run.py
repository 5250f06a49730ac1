"""The result of a simulation: a row for each output time."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from ..codegen.loop.stages import stages_of
from ..model.law import ControlLaw
from ..model.mechanism import Quantity
from .controllers.controller import RUNNING
from .engine.measured import FloorMeasurements
from .plant import Plant
from .specification.spec import Spec

UNKNOWN = "unknown"  # status of the rows of a table without that column


class Outputs:
    """What follows from the outputs y, their desired values y_d, and the status of each row."""

    y: np.ndarray
    y_d: np.ndarray
    status: np.ndarray

    @property
    def error(self) -> np.ndarray:
        """y - y_d, (N, n-m)."""
        return self.y - self.y_d

    @property
    def stopped(self) -> str | None:
        """The status that ended the run before its time, None when nothing did, or it is UNKNOWN."""
        last = str(self.status[-1])
        return None if last in (*RUNNING, UNKNOWN) else last


@dataclass(frozen=True, eq=False)
class Run(Outputs):
    """What happened, a row for each output time: t (N), q (N, n), nu (N, n-m), tau (N, r), y and y_d (N,
    n-m), status (N).

    SI units, columns named by `law`; `spec` is the SPEC with backend and tolerance used. y are the true
    outputs, with the plant's parameters; y_d are the desired ones. `forces` (N, m) are the constraint forces
    lambda (8) in the paper's sign, N; `seen` (N, 2n-m) is the state that the controller sees, `piece` (N) the
    current segment of a composite path, or piece of a course, `integral` (N, K) the integral of y_d - y, as
    the controller sees it, of the outputs with integral action, `integral_rows`, `extension` (N, k) the
    states of the law's dynamic extension. `command` (N, n-m) are the velocities that velocity-controlled
    drives were given, (N, 0) with other drives. `noticed` (N, 3) are the friction believed and by how much
    dead reckoning may be wrong because of slip, rad and m, if the SPEC has notice_slip, else (N, 0).
    `learned` (N, k) are the parameters in use that [adaptation] learns. `use` is the friction use (N) of each
    contact by name, if the SPEC has [contact]. `floor` is what was measured in a physics engine, where the
    robot need not roll; None otherwise. `disturbance` (N, K) are the estimates of the observers, of the
    outputs `disturbance_rows`. `distance` (N) is that of P_l from a course, m, positive to the left of
    travel; empty without one. If a run stopped, its last row has the time, the state and the status that
    stopped it, and no torque.
    """

    spec: Spec
    law: ControlLaw
    plant: Plant
    t: np.ndarray
    q: np.ndarray
    nu: np.ndarray
    tau: np.ndarray
    y: np.ndarray
    y_d: np.ndarray
    status: np.ndarray
    forces: np.ndarray
    seen: np.ndarray
    piece: np.ndarray
    config: np.ndarray
    integral: np.ndarray
    extension: np.ndarray
    integral_rows: tuple[str, ...]
    command: np.ndarray
    noticed: np.ndarray
    learned: np.ndarray
    use: Mapping[str, np.ndarray] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    floor: FloorMeasurements | None = None
    disturbance: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    disturbance_rows: tuple[str, ...] = ()
    distance: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def learned_parameters(self) -> list[tuple[Quantity, np.ndarray, float]]:
        """Return each parameter that [adaptation] learns, its values in use (N) and its true value, SI."""
        truth = {
            p.name: (p, value) for p, value in zip(self.law.parameters, self.plant.parameters, strict=True)
        }
        return [
            (truth[name][0], used, float(truth[name][1]))
            for name, used in zip(self.spec.learned, self.learned.T, strict=True)
        ]

    @property
    def balanced(self) -> bool:
        """Whether `works` are known on ground that moves: rows show all inputs, which are continuous, or held
        for `output_step` or longer.
        """
        simulation = self.spec.simulation
        shown = not simulation.period or simulation.output_step <= simulation.period and not self.command.size
        return self.plant.system.mechanism.carried and shown and not self.floor

    @property
    def works(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return, since the start at each row, J: the energy gained, the work of inputs and forces, and that
        of the drives of moving ground, if `balanced`. The energy is the sum of both. Works are integrals of
        the powers at the rows: of cubic splines, or with the inputs held from each row to the next in a loop
        with a period.
        """
        energy = self.plant.energy(self.x)
        by_ground = self._integral(self.plant.ground_power)
        return energy - energy[0], self._integral(self.plant.power) - by_ground, by_ground

    def _integral(self, power: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> np.ndarray:
        """Return the work of a power (W) of states and inputs since the start, J."""
        if len(self.t) < 2:
            return np.zeros(len(self.t))
        if self.spec.simulation.period:
            held = power(self.x[:-1], self.tau[:-1]) + power(self.x[1:], self.tau[:-1])
            return np.append(0.0, np.cumsum(held / 2 * np.diff(self.t)))
        from scipy.interpolate import CubicSpline  # slow to import

        return CubicSpline(self.t, power(self.x, self.tau)).antiderivative()(self.t)

    @property
    def _filled(self) -> dict[str, tuple[Iterable[object], Iterable[np.ndarray]]]:
        """For the columns of the table of stages, in the order of the file: what the <NAME> in each stands
        for, and the values, (N) for each name.
        """
        system, rows = self.law.system, range(1, 1 + max(self.y.shape[1], self.forces.shape[1]))
        single, state = ("",), [q.name for q in system.state]
        filled: dict[str, tuple[Iterable[object], Iterable[np.ndarray]]] = {
            "t": (single, [self.t]),
            "<STATE>": (state, self.x.T),
            "<INPUT>": ([q.name for q in system.mechanism.inputs], self.tau.T),
            "y<NUMBER>": (rows, self.y.T),
            "status": (single, [self.status]),
            "lambda_<NUMBER>": (rows, self.forces.T),
            "use_<CONTACT>": (self.use, self.use.values()),
            "seen_<STATE>": (state, self.seen.T),
            "integral_<OUTPUT>": (self.integral_rows, self.integral.T),
            "disturbance_<OUTPUT>": (self.disturbance_rows, self.disturbance.T),
            "<EXTENSION>": ([q.name for q in self.law.extension], self.extension.T),
            "command_<VELOCITY>": ([q.name for q in system.quasi_velocities], self.command.T),
            "believed_mu": (single, self.noticed.T[:1]),
            "uncertain_heading": (single, self.noticed.T[1:2]),
            "uncertain_way": (single, self.noticed.T[2:]),
            "learned_<PARAMETER>": (self.spec.learned, self.learned.T),
            **(self.floor.filled if self.floor else {}),
            "distance": (single, [self.distance] if self.distance.size else []),
            "piece": (single, [self.piece] if self.in_pieces else []),
        }
        stages = stages_of(self.spec, "--engine mujoco" if self.floor else "")
        there = {column for stage in stages for column in stage.columns}
        return {column: filled[column] for column in filled if column in there}

    @property
    def _columns(self) -> list[tuple[str, np.ndarray]]:
        """Names and values of the CSV columns; a coordinate may be called t, too."""
        return [
            (re.sub("<[A-Z]+>", str(name), column).replace(" ", "_"), values)
            for column, (names, several) in self._filled.items()
            for name, values in zip(names, several, strict=False)
        ]

    @property
    def columns(self) -> list[str]:
        """Return the names of the CSV columns."""
        return [name for name, _ in self._columns]

    @property
    def composite(self) -> bool:
        """Whether the path is a composite one."""
        return bool(self.spec.output.segments)

    @property
    def in_pieces(self) -> bool:
        """Whether the path has pieces: segments of a composite one,
        or those of a course between its cusps."""
        return self.composite or bool(self.distance.size)

    @property
    def x(self) -> np.ndarray:
        """States [q; nu], (N, 2n-m)."""
        return np.hstack([self.q, self.nu])

    def csv(self) -> str:
        """Return the run as CSV, with 17 significant digits, and 0 for either zero."""
        names, columns = zip(*self._columns, strict=True)
        texts = [
            [v if isinstance(v, str) else f"{v + 0.0:.17g}" for v in values.tolist()] for values in columns
        ]
        return "\n".join(map(",".join, [names, *zip(*texts, strict=True)])) + "\n"
