"""Many closed loops of one SPEC, each run by `noslip simulate` itself:
what the C of batch.c does not have, at its own pace."""

from typing import Any

import numpy as np

from ...model.errors import ModelError
from ...readers.errors import BadInput
from ..closed_loop import simulate
from ..controllers.controller import STATUS
from ..loop import make_loop
from ..run import Run
from ..sensing import pose_coordinates
from ..specification.spec import Spec
from .inputs import inputs_of


class Simulated:
    """Closed loops of a SPEC with sections that are not in the C of a sweep: inputs and outcomes are named as
    in `Batch`, and

    learned.NAME  of each learned parameter: its value in use at the end
    outside     largest distance of a learned parameter in use from its bounds, relative to the distance of
                these: 0 within them
    off         largest distance of the pose that the controller sees from the true one, m, with [estimator]

    `integration_error` is the tolerance of the integrator.
    """

    computed = "none, each sample is run by noslip simulate"  # where `Batch` names the vectors

    def __init__(self, spec: Spec, band: float, instants: tuple[float, ...] = ()):
        """`band` of all outputs, in their units; `instants`: s,
        ascending. Raises BadInput and ModelError as `simulate` does."""
        self.loop = make_loop(spec)
        self.law = self.loop.law
        self._inputs = inputs_of(spec, self.loop)
        self.spec, self._band, self._instants = self._inputs.spec, band, instants
        self.inputs, self.nominal = self._inputs.names, self._inputs.nominal
        self.table = self._inputs.table
        rows = [row.name for row in self.law.output.rows]
        self._pose = pose_coordinates(self.law.system) if spec.estimator else []
        members = {
            "final": rows,
            "peak": rows,
            "settling": rows,
            "effort": [q.name for q in self.law.system.mechanism.inputs],
        }
        members |= {"end": self._inputs.state, "learned": list(spec.learned)}
        self.outcomes = ["status", "t_end", "saturated", "integration_error"]
        self.outcomes += [f"{kind}.{name}" for kind, names in members.items() for name in names]
        self.outcomes += [*(["outside"] if spec.adaptation else []), *(["off"] if spec.estimator else [])]
        self.outcomes += [f"error.{row}[{k}]" for row in rows for k in range(len(instants))]

    def run(self, table: np.ndarray) -> np.ndarray:
        """Outcomes (N, outcomes) of samples (N, inputs); NaN except status and t_end where a number is
        rejected."""
        return np.array([self._of_sample(row) for row in np.asarray(table, float)]).reshape(
            len(table), len(self.outcomes)
        )

    def status(self, number: float) -> str:
        """Return the name of a status."""
        return STATUS[abs(int(number))]

    def _of_sample(self, row: np.ndarray) -> list[float]:
        try:
            found = self._outcomes(simulate(self._inputs.spec_of(row.tolist()), stages=True))
        except (BadInput, ModelError):
            found = {"status": self._number("bad_parameter"), "t_end": 0.0}
        return [found.get(name, np.nan) for name in self.outcomes]

    def _outcomes(self, run: Run) -> dict[str, float]:
        """Return the outcomes of a run by name."""
        error, size, stopped = run.error, np.abs(run.error), run.stopped
        entries: dict[str, Any] = {
            "final": error[-1],
            "peak": size.max(axis=0),
            "settling": [run.t[each > self._band].max(initial=0.0) for each in size.T],
            "effort": np.abs(run.tau).max(axis=0),
            "end": run.x[-1],
            "learned": run.learned[-1],
        }
        found = {
            name: values
            for kind, each in entries.items()
            for name, values in zip(self._named(kind), each, strict=True)
        }
        found |= {
            "status": self._number(stopped),
            "t_end": run.t[-1],
            "integration_error": run.spec.simulation.tolerance,
        }
        found["saturated"] = np.diff(run.t, append=run.t[-1])[run.status == "saturated"].sum()
        if run.spec.adaptation:
            least, most = np.array(list(run.spec.adaptation.bounds.values())).T
            found["outside"] = np.maximum(
                np.maximum(least - run.learned, run.learned - most) / (most - least), 0.0
            ).max()
        if self.spec.estimator:
            found["off"] = np.hypot(*(run.seen - run.x)[:, self._pose[:2]].T).max()
        for k, instant in enumerate(self._instants):
            later = np.flatnonzero(run.t >= instant - 1e-9)
            at = error[later[0]] if len(later) else np.full(error.shape[1], np.nan)
            found |= {
                f"error.{row.name}[{k}]": value for row, value in zip(self.law.output.rows, at, strict=True)
            }
        return found

    def _named(self, kind: str) -> list[str]:
        return [name for name in self.outcomes if name.startswith(f"{kind}.")]

    def _number(self, stopped: str | None) -> int:
        """Return a status as a number: negative if it stopped the run early."""
        if stopped is None or stopped == "arrived":
            return STATUS.index(stopped or "ok")
        return -STATUS.index(stopped)
