"""The units of a SPEC's numbers that depend on its robot and law: parameters by name, gains,
coordinates, inputs, outputs."""

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

from ...model.law import ControlLaw
from ...model.mechanism import per_second
from ...readers.errors import BadInput
from ...readers.quantities import Measured, check_unit
from ...readers.reading import units
from .cases import integral_entries, observer_entries
from .distributions import Margin
from .spec import Spec


def check_units(spec: Spec, law: ControlLaw) -> None:
    """Raise BadInput for a number that was given with a unit of another kind than the robot's or the law's
    own.

    Unknown names are left to the checks of names.
    """
    given = list(_measured(spec))
    known = _units(spec, law) if given else {}
    for name, value in given:
        for unit in known.get(name.removeprefix("sweep."), ()):
            check_unit(value, unit, name)
        if name.removeprefix("sweep.") not in known and not name.startswith(NAMED):
            raise BadInput(f'{name} = "{value.text}": write a number without a unit')


NAMED = tuple(
    f"{sweep}{where}."
    for sweep in ("", "sweep.")
    for where in ("parameters", "plant", "gains", "given", "output", "initial")
)


def _units(spec: Spec, law: ControlLaw) -> dict[str, list[str]]:
    """Return the units that each number must have, by dotted name;
    a number that stands for several has all of theirs."""
    mechanism, rows, rates = (
        law.system.mechanism,
        law.output.rows,
        [q.unit for q in law.system.quasi_velocities],
    )
    known = {name: [unit] for name, unit in units(Spec)}
    known |= {f"{where}.{q.name}": [q.unit] for where in ("parameters", "plant") for q in law.parameters}
    known |= {
        f"{where}.{q.name}": [q.unit]
        for where in ("initial", "initial.state", "feedback.motion")
        for q in law.system.state
    }
    known |= {f"given.{q.name}": [q.unit] for q in mechanism.coordinates}
    known |= {f"output.{'parameters' if spec.output.own else 'path'}.{q.name}": [q.unit] for q in law.config}
    gains = {q.name: q.unit for q in law.gains}
    degrees = dict(zip((row.name for row in rows), law.linearization.relative_degree, strict=True))
    gains |= {f"ki_{name}": f"1/s^{degree + 1}" for name, degree in degrees.items()}
    gains |= {f"ko_{name}": "1/s" for name in degrees}
    ki, ko = integral_entries(law, spec.gains), observer_entries(law, spec.gains)
    for name, unit in gains.items():
        known[f"gains.{name}"] = [unit]
        known.setdefault(f"gains.{name[:2]}", []).append(unit)
    lists = {
        "reference.position": ["m", "m", "rad"] if spec.feedback else [row.unit for row in rows],
        "reference.velocity": [per_second(row.unit) for row in rows],
        "reference.oscillation.amplitude": [row.unit for row in rows],
        "reference.oscillation.angle": ["rad"] * len(rows),
        "initial.q": [q.unit for q in mechanism.coordinates],
        "initial.nu": rates,
        "limits.integral": [
            _derivative(row.unit, degrees[row.name]) for row in rows if ki.get(f"ki_{row.name}")
        ],
        "limits.disturbance": [
            _derivative(row.unit, degrees[row.name]) for row in rows if ko.get(f"ko_{row.name}")
        ],
        "limits.torque": [q.unit for q in mechanism.inputs],
        "sensors.noise.mean": rates,
        "sensors.noise.sd": rates,
    }
    for name, each in lists.items():
        known |= {f"{name}[{k}]": [unit] for k, unit in enumerate(each)} | {f"{name}[0]*": each}
    return known


def _derivative(unit: str, degree: int) -> str:
    """Return the unit of a derivative by time."""
    for _ in range(degree):
        unit = per_second(unit)
    return unit


def _measured(value: Any, name: str = "") -> Iterator[tuple[str, Measured]]:
    """Yield the numbers with a unit and their dotted names; [0]* for the only one of a list."""
    if isinstance(value, Measured):
        yield name, value
    elif isinstance(value, Margin):
        for number in (value.a, value.b, *(value.within or ())):
            yield from _measured(number, name)
    elif isinstance(value, tuple):
        for k, item in enumerate(value):
            yield from _measured(item, f"{name}[{k}]" if len(value) > 1 else f"{name}[0]*")
    else:
        fields = value if isinstance(value, Mapping) else {}
        if dataclasses.is_dataclass(value):
            fields = {e.name: getattr(value, e.name) for e in dataclasses.fields(value)}
        for key, item in fields.items():
            inside = (
                name if name == "output.path" and key == "parameters" else f"{name}.{key}" if name else key
            )
            yield from _measured(item, inside)
