"""A table of a run, as `noslip log` and `noslip simulate` write them, as a run of ours again,
for a given SPEC."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...model.mechanism import Quantity, quantity
from ...readers.errors import BadInput
from ...readers.tables import Column
from ...readers.times import distinct
from ..contact import contact_forces
from ..guidance import outputs, vehicle_motion
from ..loop import Loop, make_loop
from ..plant import Plant
from ..run import UNKNOWN, Run
from ..specification.spec import Spec

UNUSED = 0.0  # for coordinates that the table does not have and the outputs do not need


def run_of_table(columns: Mapping[str, Column], spec: Spec, where: str) -> Run:
    """Return the rows of a table as a run of a SPEC, which says what robot, law and path they belong to.

    Desired values are those of columns desired_y1, ..., otherwise those that the SPEC gives at each row.
    Inputs that the table does not have are NaN, and a status is "unknown". Raises BadInput if t, or a
    coordinate or velocity that the outputs depend on, is missing or not finite.
    """
    loop = make_loop(spec)
    law, plant = loop.law, loop.plant
    system, rows = law.system, law.output.rows
    t = _required(columns, "t", "s", where)
    if (late := np.flatnonzero(np.diff(t) <= 0)).size:
        before, after = distinct(*t[late[0] : late[0] + 2])
        row = columns["t"].rows[late[0] + 1]
        raise BadInput(
            f"{where} row {row}: t goes from {before} s to {after} s; times must increase: cut the table "
            "there"
        )
    measured = _columns(columns, system.state, len(t))
    x = np.nan_to_num(measured, nan=UNUSED)
    followed = _followed(loop, t, x)
    for k in np.flatnonzero(~np.isfinite(measured).all(0)):
        probe = np.where(np.arange(x.shape[1]) == k, np.nan, x[:1])
        if not np.isfinite(_seen(loop, probe, followed["config"][:1])).all():
            name = system.state[k].name
            needs = f"{law.name} of the SPEC needs"
            if name in columns:
                raise BadInput(f"{where}: numbers in {name} that are missing or not finite; {needs} them")
            raise BadInput(f"{where}: no column {name}; {needs} it")
    y = outputs(law)(x.T, plant.parameters, followed["config"].T).full().T
    velocity = bool(spec.drive and spec.drive.takes_velocity)
    tau = _inputs(columns, system.mechanism.inputs, len(t), velocity)
    desired = [_optional(columns, f"desired_y{k + 1}", row.unit) for k, row in enumerate(rows)]
    commanded = {f"command_{v.name}": v.unit for v in system.quasi_velocities if velocity}
    commands = [columns[name].numbers(unit) for name, unit in commanded.items() if name in columns]
    units = {p.name: p.unit for p in law.parameters}
    learned = [quantity(f"learned_{name}", units[name]) for name in spec.learned]
    none, n = np.empty((len(t), 0)), len(system.mechanism.coordinates)
    return Run(
        spec=spec,
        law=law,
        plant=plant,
        t=t,
        q=x[:, :n],
        nu=x[:, n:],
        tau=tau,
        y=y,
        y_d=np.column_stack(
            [followed["y_d"][:, k] if each is None else each for k, each in enumerate(desired)]
        ),
        status=np.array(
            [str(each) for each in columns["status"].entries] if "status" in columns else [UNKNOWN] * len(t)
        ),
        forces=plant.constraint_forces(x, tau),
        seen=x,
        piece=followed["piece"],
        config=followed["config"],
        integral=none,
        extension=_columns(columns, law.extension, len(t)) if law.extension else none,
        integral_rows=(),
        command=np.column_stack(commands) if commands else none,
        noticed=none,
        learned=_columns(columns, learned, len(t)) if learned else none,
        use=_use(columns, plant, x, tau, spec),
        warnings=loop.warnings,
    )


def _followed(loop: Loop, t: np.ndarray, x: np.ndarray) -> dict[str, np.ndarray]:
    """Return what is followed at each row: desired outputs, config of the law, segment."""
    law, guidance = loop.law, loop.guidance
    entries = [[r.name for r in law.reference].index(row.name) for row in law.output.rows]
    found: dict[str, list[Any]] = {"y_d": [], "config": [], "piece": []}
    for time, state in zip(t, x, strict=True):
        guidance.update(time, state)
        found["y_d"].append(guidance.reference(time, state)[entries])
        found["config"].append(guidance.leg_at(state).config)
        found["piece"].append(guidance.piece)
    return {name: np.array(values) for name, values in found.items()}


def _seen(loop: Loop, x: np.ndarray, config: np.ndarray) -> np.ndarray:
    """Return what is drawn of states: the outputs, and the motion of a vehicle."""
    law, plant = loop.law, loop.plant
    y = outputs(law)(x.T, plant.parameters, config.T).full()
    vehicle = law.system.mechanism.vehicle
    return np.vstack([y, vehicle_motion(law.system)(x.T, plant.parameters).full()]) if vehicle else y


def _required(columns: Mapping[str, Column], name: str, unit: str, where: str) -> np.ndarray:
    values = _optional(columns, name, unit)
    if values is not None and not len(values):
        raise BadInput(f"{where}: it has no rows")
    if values is None or not np.isfinite(values).all():
        raise BadInput(f"{where}: column {name!r} is missing or not finite")
    return values


def _optional(columns: Mapping[str, Column], name: str, unit: str) -> np.ndarray | None:
    return columns[name].numbers(unit) if name in columns else None


def _use(
    columns: Mapping[str, Column], plant: Plant, x: np.ndarray, tau: np.ndarray, spec: Spec
) -> dict[str, np.ndarray]:
    """Return the friction use of each contact that the table has; if it has none, what rolling needs,
    if [contact] is given."""
    named = {c.name: f"use_{c.name.replace(' ', '_')}" for c in plant.system.mechanism.contacts}
    if found := {name: columns[column].numbers() for name, column in named.items() if column in columns}:
        return found
    known = spec.contact if np.isfinite(tau).all() else None
    return {c.name: c.use for c in contact_forces(plant, x, tau, known)} if known else {}


def _columns(columns: Mapping[str, Column], quantities: Sequence[Quantity], rows: int) -> np.ndarray:
    """Return a column for each quantity, NaN where the table has none, (rows, len(quantities))."""
    found = [_optional(columns, q.name, q.unit) for q in quantities]
    return np.column_stack([np.full(rows, np.nan) if each is None else each for each in found])


def _inputs(
    columns: Mapping[str, Column], inputs: Sequence[Quantity], rows: int, velocity: bool
) -> np.ndarray:
    """Return the inputs; with velocity drives those of the law, `law_...` if the table has them,
    as `noslip log` calls them."""
    names = {i.name: f"law_{i.name}" if velocity and f"law_{i.name}" in columns else i.name for i in inputs}
    return _columns({own: columns[name] for own, name in names.items() if name in columns}, inputs, rows)
