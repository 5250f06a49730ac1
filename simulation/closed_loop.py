"""Simulates the closed loop of a controller and a plant, continuous or sampled."""

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from ..model.errors import ModelError
from ..readers.errors import BadInput
from .contact import contact_forces, grip
from .controllers.controller import ON_TARGET
from .engine.measured import FloorMeasurements
from .guidance import distances, outputs, vehicle_motion
from .integrate import continuous, sampled
from .loop import Loop, make_loop
from .run import Run
from .specification.spec import MOST_ROWS, ApproachSection, Simulation, Spec

LOOK_BACK = 0.5  # s, of what led to a singular state
TRIAL = 20_000  # steps at most of a run that tries a remedy
# With rounding in float, step-size control fails at smaller tolerances
SINGLE, SINGLE_TOLERANCE = ("cf", *ON_TARGET), 1e-6


def simulate(
    spec: Spec,
    backend: str | None = None,
    progress: Callable[[float], None] | None = None,
    engine: str | None = None,
    most: int = MOST_ROWS,
    stages: bool = False,
) -> Run:
    """Simulate the closed loop of a SPEC and return the Run; `backend` replaces that of the SPEC; `progress`
    receives the time reached; a run in continuous time may take `most` steps. With the `engine` "mujoco" the
    robot is on a floor where its wheels may slip; otherwise it rolls. What `runs_as_firmware` is run so
    unless its `stages` are asked for, as a sweep has them.

    Raises BadInput or ModelError if the SPEC cannot be simulated: unknown names, invalid parameters, a
    singular start.
    """
    as_run = _as_run(spec.simulation, backend)
    spec = spec if as_run == spec.simulation else replace(spec, simulation=as_run)
    if not (engine or stages) and spec.simulation.backend in SINGLE:
        from .firmware.run import run_of_firmware, runs_as_firmware  # slow to import

        if runs_as_firmware(spec):
            done = run_of_firmware(spec, progress)
            return replace(done, warnings=(*done.warnings, *_unused(spec)))
    loop = make_loop(spec)
    floor = None
    if engine:
        from .engine.on_floor import OnFloor  # MuJoCo is optional

        floor = OnFloor(loop, spec)
        loop, steps = floor.loop, floor.rows()
    else:
        steps = (
            sampled(loop, spec.simulation)
            if spec.simulation.period
            else continuous(loop, spec.simulation, most)
        )
        loop = replace(loop, warnings=(*loop.warnings, *_unused(spec)))
    rows = []
    for row in steps:
        rows.append(row)
        if progress:
            progress(row.t)
    law, n = loop.law, len(loop.law.system.mechanism.coordinates)
    t, x, tau = (np.array([getattr(row, name) for row in rows]) for name in ("t", "x", "tau"))
    config, reference = (np.array([getattr(row, name) for row in rows]) for name in ("config", "reference"))
    entries = [[r.name for r in law.reference].index(row.name) for row in law.output.rows]
    measured = floor.measured() if floor else None
    memory = np.array([row.integral for row in rows])
    return Run(
        spec=spec,
        law=law,
        plant=loop.plant,
        t=t,
        q=x[:, :n],
        nu=x[:, n:],
        tau=tau,
        y=outputs(law)(x.T, loop.plant.parameters, config.T).full().T,
        y_d=reference[:, entries],
        status=np.array([row.status for row in rows]),
        forces=floor.constraint_forces(x) if floor else loop.plant.constraint_forces(x, tau),
        seen=np.array([row.seen for row in rows]),
        piece=np.array([row.piece for row in rows]),
        config=config,
        integral=memory[:, : len(loop.integral.rows)],
        extension=np.array([row.extension for row in rows]),
        integral_rows=loop.integral.rows,
        command=np.array([row.command for row in rows]),
        noticed=np.array([row.noticed for row in rows]),
        learned=np.array([row.learned for row in rows]),
        use=_use(loop, x, tau, spec, measured),
        warnings=(*loop.warnings, *(floor.engine.warnings if floor else ())),
        floor=measured,
        disturbance=memory[:, len(loop.integral.rows) :],
        disturbance_rows=loop.observers.rows,
        distance=distances(law, x, loop.plant.parameters, config) if law.output.foot else np.zeros(0),
    )


def _unused(spec: Spec) -> list[str]:
    """Return a warning for each section that only a physics engine reads."""
    given = [section for section in ("floor", "scene") if getattr(spec, section)]
    return [f"[{section}] has no effect without --engine mujoco: the wheels roll" for section in given]


def _use(
    loop: Loop, x: np.ndarray, tau: np.ndarray, spec: Spec, measured: FloorMeasurements | None
) -> dict[str, np.ndarray]:
    """Return the friction use of each contact by name: measured on a floor,
    else what rolling needs if the SPEC has [contact]."""
    if measured:
        return dict(zip(measured.names, measured.use.T, strict=True))
    return {c.name: c.use for c in contact_forces(loop.plant, x, tau, spec.contact)} if spec.contact else {}


def _as_run(simulation: Simulation, backend: str | None) -> Simulation:
    """Return the simulation options with the backend given, and a tolerance that this backend can meet."""
    backend = backend or simulation.backend
    least = SINGLE_TOLERANCE if backend in SINGLE and not simulation.period else 0.0
    return replace(simulation, backend=backend, tolerance=max(simulation.tolerance, least))


def why_singular(run: Run, engine: str | None = None) -> str:
    """Return what a run that ended "singular" met, where, and what led there; and a change of its SPEC with
    which it does not end so, which has been tried.
    """
    law, t, x = run.law, run.t, run.x
    vehicle = vehicle_motion(law.system)(x.T, run.plant.parameters).full()
    place = (
        f"at ({vehicle[0, -1]:.3g}, {vehicle[1, -1]:.3g}) m, heading {math.degrees(vehicle[2, -1]):.4g} deg"
    )
    quantity = f"det Phi of {', '.join(row.name for row in law.output.rows)} is zero"
    since = max(int(np.searchsorted(t, t[-1] - LOOK_BACK)), 0)
    limited = int(np.isin(run.status[since:-1], ("grip", "will_slip", "saturated")).sum())
    led = [f"the speed went from {vehicle[3, since]:.3g} to {vehicle[3, -1]:.3g} m/s"]
    led += [f"the heading turned by {math.degrees(vehicle[2, -1] - vehicle[2, since]):.3g} deg"]
    led += [f"inputs were limited in {limited} of {len(t) - 1 - since} rows"] if limited else []
    text = f"{quantity} {place}; in the last {t[-1] - t[since]:.2g} s {', '.join(led)}"
    for about, changed in _remedies(run):
        with suppress(BadInput, ModelError):
            tried = simulate(changed(), engine=engine, most=TRIAL)
            nearer = abs(tried.y[-1, 0]) <= abs(tried.y[0, 0]) or law.output.rows[0].name != "distance"
            if tried.stopped is None and nearer:
                return f"{text}; with {about} this run does not stop (tried)"
    return f"{text}; of the remedies in docs/normal.md none that was tried on this run works"


def _remedies(run: Run) -> Iterator[tuple[str, Callable[[], Spec]]]:
    """Return changes of a SPEC that may keep a run from the singular set, the gentlest first: what they are
    in a SPEC, and a function that makes it, which raises BadInput if the SPEC does not permit the change.
    """
    spec, reference, output = run.spec, run.spec.reference, run.spec.output
    if output.type == "IV":
        yield (
            'near_singular = "damped" in [output]',
            lambda: replace(spec, output=replace(output, near_singular="damped")),
        )
    slow = reference.approach.acceleration / 4 if reference.approach else 0.2
    approach = replace(reference.approach or ApproachSection(acceleration=slow), acceleration=slow)
    yield (
        f"approach = {{ acceleration = {slow:g} }} in [reference]",
        lambda: replace(spec, reference=replace(reference, approach=approach)),
    )
    if reference.approach:
        yield "no approach in [reference]", lambda: replace(spec, reference=replace(reference, approach=None))
    if reference.speed and isinstance(reference.speed, float) and math.isfinite(reference.speed):
        half = reference.speed / 2
        yield (
            f"speed = {half:g} in [reference]",
            lambda: replace(spec, reference=replace(reference, speed=half)),
        )
    if (initial := spec.initial) and initial.q is None and initial.state is None and not initial.speed:
        speed = min(abs(spec.desired_speed or 0.0), 0.5)
        yield f"speed = {speed:g} in [initial]", lambda: replace(spec, initial=replace(initial, speed=speed))


def as_json(run: Run) -> dict[str, Any]:
    """Return what `summary` states, SI: duration, errors of the outputs, largest inputs, residual of the
    constraints, and whether each contact rolls; of a run in a physics engine, slip and load of each contact
    instead.
    """
    simulation, inputs = run.spec.simulation, run.law.system.mechanism.inputs
    return {
        "robot": run.spec.robot,
        "law": run.law.name,
        "backend": simulation.backend,
        "period": simulation.period,
        "delay": simulation.delay,
        "drive": run.spec.drive and asdict(run.spec.drive),
        "tolerance": simulation.tolerance,
        "status": str(run.status[-1]),
        "duration": run.t[-1],
        "rows": len(run.t),
        "errors": {
            name: {"unit": unit, "final": error[-1], "peak": np.abs(error).max()}
            for name, unit, error in _errors(run)
        },
        "inputs": {
            i.name: {"unit": i.unit, "peak": peak}
            for i, peak in zip(inputs, np.abs(run.tau).max(axis=0), strict=True)
        },
        **(_rolls(run) if run.floor is None else {"floor": run.floor.as_json(run.t)}),
        **({"learned": learned} if (learned := _learned(run)) else {}),
        "warnings": run.warnings,
    }


def _errors(run: Run) -> list[tuple[str, str, np.ndarray]]:
    """Return name, unit and error of each output, and the distance from a course that is none of the
    outputs."""
    errors = [
        (row.name, row.unit, error) for row, error in zip(run.law.output.rows, run.error.T, strict=True)
    ]
    known = not run.distance.size or any(name == "distance" for name, _, _ in errors)
    return errors if known else [("distance", "m", run.distance), *errors]


def _learned(run: Run) -> dict[str, dict[str, Any]]:
    return {
        p.name: {"unit": p.unit, "final": used[-1], "true": true} for p, used, true in run.learned_parameters
    }


def summary(run: Run) -> str:
    """Return a few lines about a run: duration, errors of the outputs, learned parameters, largest inputs,
    residual of the constraints.
    """
    simulation, values = run.spec.simulation, as_json(run)
    held = f"called every {simulation.period:g} s" if simulation.period else "continuous"
    held += f", delay {simulation.delay:g} s" if simulation.delay else ""
    if (drive := run.spec.drive) and drive.takes_velocity:
        held += f", {drive.kind} drives of {drive.bandwidth:g} Hz, delay {drive.delay:g} s"
    how = f"backend {simulation.backend}, {held}, tolerance {simulation.tolerance:g}"
    lines = [f"{run.spec.robot}, {run.law.name}, {how}: {run.t[-1]:.9g} s, {len(run.t)} rows"]
    if run.floor and run.floor.stands and run.floor.stands.left_out:
        lines.append(f"  the engine leaves out: {run.floor.stands.left_out}")
    for name, error in values["errors"].items():
        unit = error["unit"]
        lines.append(f"  error of {name}: final {error['final']:.2e} {unit}, peak {error['peak']:.3g} {unit}")
    for name, each in values.get("learned", {}).items():
        lines.append(
            f"  learned {name}: {each['final']:.4g} {each['unit']}, true {each['true']:.4g} {each['unit']}"
        )
    peaks = ", ".join(
        f"{name} {found['peak']:.3g} {found['unit']}" for name, found in values["inputs"].items()
    )
    if run.floor:
        ground = run.floor.summary(run.t)
    else:
        residual = "||A qdot - b||" if run.plant.system.mechanism.carried else "||A qdot||"
        ground, peaks = grip(run).summary(), f"{peaks}; worst {residual} {values['residual']:.1e}"
    lines.append(f"  peak {peaks}")
    if energy := values.get("energy"):
        lines.append(
            f"  energy {energy['gained']:+.4g} J: inputs and forces {energy['inputs']:+.4g} J, drive of the "
            f"ground {energy['ground']:+.4g} J, largest difference {energy['difference']:.1e} J"
        )
    return "\n".join([*lines, *[f"  {line}" for line in ground.splitlines()]])


def _rolls(run: Run) -> dict[str, Any]:
    """Return the residual of the constraints, and whether each contact rolls, of a run that assumes it; on
    ground that moves also the balance of energy.
    """
    made = {"residual": np.linalg.norm(run.plant.slip(run.x), axis=1).max(), "rolling": grip(run).as_json()}
    return {**made, **({"energy": _energy(run)} if run.balanced else {})}


def _energy(run: Run) -> dict[str, float]:
    """Return the energy gained and the works at the end, J,
    and the largest difference between both sides at any row."""
    gained, inputs, ground = run.works
    difference = np.abs(gained - inputs - ground).max()
    return {"gained": gained[-1], "inputs": inputs[-1], "ground": ground[-1], "difference": difference}
