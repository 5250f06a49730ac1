"""Closed loop of a controller and a plant, continuous or sampled."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..model.law import ControlLaw
from .backends import ON_TARGET
from .contact import grip, lambda_columns
from .guidance import outputs
from .loop import RUNNING, make_loop
from .march import continuous, sampled
from .plant import Plant
from .spec import Simulation, Spec

SINGLE, SINGLE_TOLERANCE = ("cf", *ON_TARGET), 1e-6  # rounding in float is noise: step-size control gets nowhere below it


@dataclass(frozen=True, eq=False)
class Run:
    """What happened, a row for each output time: t (N), q (N, n), nu (N, n-m), tau (N, r), y and y_d (N, n-m), status (N).

    SI units, columns named by `law`; `spec` says how it was run (backend, tolerance). y are the true outputs, with the
    plant's parameters; y_d is what was wanted. `forces` (N, m) are the constraint forces lambda (8) in the paper's sign, N;
    `seen` (N, 2n-m) is the state the controller worked with, `piece` (N) which piece of a composite path it followed, `integral`
    (N, K) the integral of y_d - y, as the controller sees it, of the outputs with integral action, `integral_rows`.
    When a run stopped, its last row tells where, with the status that stopped it and no torque.
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
    integral_rows: tuple[str, ...]
    warnings: tuple[str, ...] = ()

    @property
    def columns(self) -> list[str]:
        """Names of the CSV's columns."""
        mechanism = self.law.system.mechanism
        names = ["t", *[q.name for q in (*self.law.state, *mechanism.inputs)]]
        names += [*[f"y{k + 1}" for k in range(self.y.shape[1])], "status"]
        names += lambda_columns(mechanism)
        names += [f"seen_{q.name}" for q in self.law.state] if self.spec.sensors else []
        names += [f"integral_{row}" for row in self.integral_rows]
        return [*names, "piece"] if self.composite else names

    @property
    def composite(self) -> bool:
        """Is the path followed piece by piece?"""
        return bool(self.spec.output.path and self.spec.output.path.segments)

    @property
    def x(self) -> np.ndarray:
        """States [q; nu], (N, 2n-m)."""
        return np.hstack([self.q, self.nu])

    @property
    def error(self) -> np.ndarray:
        """y - y_d, (N, n-m)."""
        return self.y - self.y_d

    @property
    def stopped(self) -> str | None:
        """The status that ended the run before its time, None when nothing did."""
        last = str(self.status[-1])
        return None if last in RUNNING else last

    def csv(self) -> str:
        """The run as CSV, 17 significant digits."""
        numbers = np.column_stack([self.t, self.x, self.tau, self.y]).tolist()
        more = np.column_stack([self.forces, *([self.seen] if self.spec.sensors else []), self.integral]).tolist()
        pieces = [[str(piece)] if self.composite else [] for piece in self.piece]
        lines = [
            ",".join([*(f"{v:.17g}" for v in row), status, *(f"{v:.17g}" for v in rest), *piece])
            for row, status, rest, piece in zip(numbers, self.status, more, pieces, strict=True)
        ]
        return "\n".join([",".join(self.columns), *lines]) + "\n"

    def summary(self) -> str:
        """A few lines for a reader: how long, how far from what was wanted, how hard, how true to the constraints."""
        simulation = self.spec.simulation
        held = f"called every {simulation.period:g} s" if simulation.period else "continuous"
        held += f", acting {simulation.delay:g} s later" if simulation.delay else ""
        how = f"backend {simulation.backend}, {held}, tolerance {simulation.tolerance:g}"
        lines = [f"{self.spec.robot}, {self.law.name}, {how}: {self.t[-1]:.9g} s, {len(self.t)} rows"]
        for row, error in zip(self.law.output.rows, self.error.T, strict=True):
            lines.append(f"  error of {row.name}: final {error[-1]:.2e} {row.unit}, peak {np.abs(error).max():.3g} {row.unit}")
        inputs = self.law.system.mechanism.inputs
        peaks = ", ".join(f"{i.name} {peak:.3g} {i.unit}" for i, peak in zip(inputs, np.abs(self.tau).max(axis=0), strict=True))
        slip = np.linalg.norm(self.plant.slip(self.x), axis=1).max()
        lines.append(f"  peak {peaks}; worst ||A qdot|| {slip:.1e}")
        return "\n".join([*lines, *[f"  {line}" for line in grip(self).summary().splitlines()]])


def simulate(spec: Spec, backend: str | None = None, progress: Callable[[float], None] | None = None) -> Run:
    """Run the closed loop of a SPEC; `backend` instead of the SPEC's own; `progress` is told the time reached.

    Raises BadInput or ModelError when the SPEC cannot be run: unknown names, refused parameters, a singular start.
    """
    spec = replace(spec, simulation=_as_run(spec.simulation, backend))
    loop = make_loop(spec)
    march = sampled if spec.simulation.period else continuous
    rows = []
    for row in march(loop, spec.simulation):
        rows.append(row)
        if progress:
            progress(row.t)
    law, n = loop.law, len(loop.law.system.mechanism.coordinates)
    t, x, tau = (np.array([getattr(row, name) for row in rows]) for name in ("t", "x", "tau"))
    config, reference = (np.array([getattr(row, name) for row in rows]) for name in ("config", "reference"))
    wanted = [[r.name for r in law.reference].index(row.name) for row in law.output.rows]
    return Run(
        spec=spec,
        law=law,
        plant=loop.plant,
        t=t,
        q=x[:, :n],
        nu=x[:, n:],
        tau=tau,
        y=outputs(law)(x.T, loop.plant.parameters, config.T).full().T,
        y_d=reference[:, wanted],
        status=np.array([row.status for row in rows]),
        forces=loop.plant.constraint_forces(x, tau),
        seen=np.array([row.seen for row in rows]),
        piece=np.array([row.piece for row in rows]),
        config=config,
        integral=np.array([row.integral for row in rows]),
        integral_rows=loop.integral.rows,
        warnings=loop.warnings,
    )


def _as_run(simulation: Simulation, backend: str | None) -> Simulation:
    """With the backend asked for, and a tolerance that this one can meet."""
    backend = backend or simulation.backend
    least = SINGLE_TOLERANCE if backend in SINGLE and not simulation.period else 0.0
    return replace(simulation, backend=backend, tolerance=max(simulation.tolerance, least))
