"""Manoeuvres that show parameters: figures of eight of different size and speed,
rated by the standard deviations to expect."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from ...model.contacts import GRAVITY
from ...readers.errors import BadInput
from ...readers.progress import Reported, silent
from ...simulation.closed_loop import simulate
from ...simulation.run import Run
from ...simulation.specification.spec import ContactSection, LimitsSection, spec_of_table
from .dynamics import Dynamics, combinations
from .fit import predicted
from .log import Log

RADII = (0.95, 0.7, 0.5)  # of the circles of the eight, in units of the largest that the room has
SPEEDS = (0.8, 0.6, 0.4)  # of the largest, and of the one at which a steady circle uses all friction
PERIOD = 0.01  # s, where the SPEC is continuous


@dataclass(frozen=True, eq=False)
class Manoeuvre:
    """A run that shows parameters: its SPEC as a table, standard deviations to be expected of them,
    largest friction use."""

    table: Mapping[str, Any]
    deviations: Mapping[str, float]
    use: float | None
    run: Run

    @property
    def volume(self) -> float:
        """The logarithm of the volume of the confidence region (D-optimal: the smallest),
        up to a constant."""
        return float(np.sum(np.log(list(self.deviations.values()))))


def parameters_of_motion(dynamics: Dynamics, values: Sequence[float]) -> list[str]:
    """Return the parameters that the dynamics determine, of those that the kinematics do not depend on; of
    several that are seen only together the first.
    """
    system = dynamics.system
    names = [p.name for p in system.mechanism.parameters if not ca.depends_on(system.S, p.symbol)]
    return [c.pivot for c in combinations(dynamics, names, values)]


def excite(
    table: Mapping[str, Any],
    file: Path | str,
    names: Sequence[str] | None,
    room: float,
    fastest: float,
    noise: float,
    progress: Reported = silent,
) -> Manoeuvre:
    """Return the manoeuvre that shows the named parameters best; None: `parameters_of_motion`. `table` is the
    SPEC of a vehicle.

    Each candidate is simulated with the law, limits and floor of the SPEC, path and start replaced by an
    eight inside a square of `room` (m), at up to `fastest` (m/s). Those that would slip, exceed the limits or
    leave the room do not count. `noise` is the standard deviation of the quasi-velocities that will be
    logged. Raises BadInput if none is left or shows all parameters.
    """
    refused: dict[str, int] = {}
    best: Manoeuvre | None = None
    spec = spec_of_table(table, Path(file))
    margin = spec.limits.margin if spec.limits else LimitsSection.margin
    grip = (spec.contact or ContactSection()).mu * (1 - margin) * GRAVITY  # m/s^2
    sizes = [radius * room / 4 for radius in RADII]
    speeds = [
        (radius, part * limit)
        for radius in sizes
        for part in SPEEDS
        for limit in (fastest / SPEEDS[0], math.sqrt(grip * radius))
    ]
    tried = list(
        dict.fromkeys((radius, round(speed, 3)) for radius, speed in speeds if 1e-3 < speed <= fastest)
    )
    for k, (radius, speed) in enumerate(tried):
        progress(k, len(tried), "manoeuvres")
        manoeuvre = _tried(_eight(table, radius, speed), file, names, room, margin, noise)
        if isinstance(manoeuvre, str):
            refused[manoeuvre] = refused.get(manoeuvre, 0) + 1
        elif best is None or manoeuvre.volume < best.volume:
            best = manoeuvre
    if best is None:
        reasons = "; ".join(f"{count} {reason}" for reason, count in refused.items())
        raise BadInput(f"none of {len(tried)} manoeuvres in {room:g} m x {room:g} m serves: {reasons}")
    return best


def _tried(
    eight: Mapping[str, Any],
    file: Path | str,
    names: Sequence[str] | None,
    room: float,
    margin: float,
    noise: float,
) -> Manoeuvre | str:
    """Return a manoeuvre, or why it does not serve."""
    run = simulate(spec_of_table(eight, Path(file)))
    use = max((float(np.nanmax(each)) for each in run.use.values()), default=None)
    if run.stopped:
        return f"would stop with status {run.stopped}"
    if set(run.status) - {"ok"}:
        return "would exceed the limits"
    if use is not None and use > 1 - margin:
        return "would slip"
    place = run.q[:, :2] - run.q[0, :2]
    if np.ptp(place, axis=0).max() > room:
        return "would leave the room"
    system = run.law.system
    dynamics = Dynamics.of(system)
    values = dynamics.values(
        {p.name: v for p, v in zip(system.mechanism.parameters, run.plant.parameters, strict=True)}
    )
    log = Log(run.t, run.x, run.tau, (range(len(run.t)),), ())
    fitted = list(names) if names is not None else parameters_of_motion(dynamics, values.tolist())
    deviations = predicted(log, dynamics, fitted, values, True).expected_deviations(
        np.full(system.dof, noise)
    )
    hidden = [name for name, sd in deviations.items() if not math.isfinite(sd)]
    if hidden:
        return f"would not show {', '.join(hidden)}"
    return Manoeuvre(eight, {name: deviations[name] for name in fitted}, use, run)


def _eight(table: Mapping[str, Any], radius: float, speed: float) -> dict[str, Any]:
    """Return the SPEC with two full circles, to the left and to the right, from rest."""
    arcs = [{"kind": "arc", "from": [0.0, 0.0], "heading": 0.0, "radius": radius, "angle": 2 * math.pi}]
    arcs.append({"kind": "arc", "radius": radius, "angle": -2 * math.pi})
    simulation = table["simulation"]
    period = simulation.get("period", 0.0) or PERIOD
    duration = min(simulation["duration"], round(0.97 * 4 * math.pi * radius / speed, 2))
    output = {key: value for key, value in table["output"].items() if key in ("type", "L", "W")}
    return {
        **{
            key: value
            for key, value in table.items()
            if key not in ("plant", "sweep", "correction", "sensors", "floor")
        },
        "output": {**output, "path": {"kind": "composite", "segments": arcs}},
        "reference": {"speed": speed},
        "initial": {"point": [0.0, 0.0], "heading": 0.0, "speed": 0.0},
        "contact": dict(table.get("contact", {})),
        "simulation": {**simulation, "duration": duration, "period": period, "output_step": period},
    }
