"""The numbers of a SPEC that may vary between samples, by their dotted names; SPECs with other values."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np

from ...model.law import ControlLaw
from ...model.mechanism import values_of
from ...readers.errors import check_named
from ..loop import Loop, axle_at, initial_of
from ..specification.cases import gain_entries, integral_entries, observer_entries
from ..specification.spec import NoiseSection, OutputSection, Spec

Place = tuple[str | int, ...]  # path to a number in a Spec: names of entries and indices of items
SEED = "seed"
SEEDS = 2**53  # upper bound of seeds: integers that a double represents


@dataclass(frozen=True)
class SampleInputs:
    """Columns of a table of samples: `nominal` values by name, in order; `spec` has all of them explicitly.

    `follows`: inputs that are equal to another one unless they are given, such as parameters of the plant,
    which are those of the controller unless the SPEC gives others. `state`: names of [q; nu].
    """

    law: ControlLaw
    spec: Spec
    nominal: dict[str, float]
    follows: dict[str, str]
    state: list[str]

    @property
    def names(self) -> list[str]:
        """The names, in the order of the columns of the table."""
        return list(self.nominal)

    def table(self, columns: Mapping[str, np.ndarray | float], count: int) -> np.ndarray:
        """Return a table (count, inputs) from given columns by name; the others follow or are nominal. Raises
        BadInput for unknown names."""
        for name in columns:
            check_named(name, self.names, "not a number of this SPEC that a sample can have:")
        made = np.empty((count, len(self.nominal)))
        for k, (name, value) in enumerate(self.nominal.items()):
            source = name if name in columns else self.follows.get(name, name)
            made[:, k] = columns.get(source, value)
        return made

    def spec_of(self, row: Sequence[float]) -> Spec:
        """Return the SPEC of one sample, a row of a table, for `noslip simulate`. Raises BadInput if it
        cannot be run."""
        values = dict(zip(self.nominal, row, strict=True))
        spec = _changed(self.spec, {self._place(name): float(value) for name, value in values.items()})
        if not spec.output.extension or spec.output.own:
            return spec
        # P_l stays on the axle
        return replace(spec, output=replace(spec.output, L=axle_at(self.law, spec.parameters)))

    def _place(self, name: str) -> Place:
        """Return the path to an input in a Spec."""
        if name == SEED:
            return ("sensors", "seed")
        tokens: Place = tuple(int(t) if t.isdigit() else t for t in re.findall(r"\w+", name))
        if tokens[:2] == ("output", "path"):
            return (*tokens[:2], "parameters", *tokens[2:])
        initial = self.spec.initial
        if tokens[0] == "initial" and tokens[1] != "extension" and initial and initial.q is not None:
            k, n = self.state.index(name.removeprefix("initial.")), len(initial.q)
            return ("initial", "q", k) if k < n else ("initial", "nu", k - n)
        return tokens


def inputs_of(spec: Spec, loop: Loop) -> SampleInputs:
    """Return the numbers of the SPEC of `loop` that may vary between samples."""
    law = loop.law
    full = _in_full(spec, loop)
    nominal: dict[str, float] = {}
    for where in ("parameters", "plant", "gains"):
        nominal |= {f"{where}.{name}": value for name, value in getattr(full, where).items()}
    output, reference, simulation = full.output, full.reference, full.simulation
    nominal |= {f"output.{name}": getattr(output, name) for name in _point(output, law)}
    nominal |= {
        f"output.path.{name}": value
        for name, value in (output.path.parameters if output.path else {}).items()
    }
    nominal |= {f"output.parameters.{name}": value for name, value in output.parameters.items()}
    nominal |= _numbers(reference, "reference")
    if reference.approach:
        nominal |= _numbers(reference.approach, "reference.approach")
    initial, state = full.initial, [q.name for q in law.system.state]
    if initial and initial.q is not None:
        nominal |= {f"initial.{q}": v for q, v in zip(state, (*initial.q, *(initial.nu or ())), strict=True)}
        nominal |= {f"initial.extension[{k}]": v for k, v in enumerate(initial.extension or ())}
    elif initial and initial.state is not None:
        nominal |= {f"initial.state.{name}": value for name, value in initial.state.items()}
    elif initial:
        nominal |= _numbers(initial, "initial")
    if feedback := full.feedback:
        nominal |= {f"feedback.effort[{k}]": value for k, value in enumerate(feedback.effort)}
        for where in ("weights", "motion"):
            nominal |= {f"feedback.{where}.{name}": value for name, value in getattr(feedback, where).items()}
        for k, command in enumerate(reference.commands or ()):
            nominal |= _numbers(command, f"reference.commands[{k}]")
    if full.limits:
        limits = _numbers(full.limits, "limits")
        of_grip = {"limits.margin", "limits.known", "limits.error"} if full.limits.mode != "grip" else set()
        nominal |= {name: limits[name] for name in limits if name not in of_grip}
        nominal |= _numbers(full.limits.notice_slip, "limits.notice_slip") if full.limits.notice_slip else {}
    if full.drive and full.drive.takes_velocity:
        nominal |= _numbers(full.drive, "drive")
    if full.contact:
        nominal |= _numbers(full.contact, "contact")
    if full.sensors:
        nominal |= _numbers(full.sensors.noise, "sensors.noise")
        nominal |= {f"sensors.{name}": getattr(full.sensors, name) for name in ("period", "counts")}
        nominal |= _numbers(full.correction, "correction") if full.correction else {}
        for name in ("gyro", "accelerometer"):
            sensor = getattr(full.sensors, name) if full.limits and full.limits.notice_slip else None
            nominal |= _numbers(sensor, f"sensors.{name}") if sensor else {}
        nominal[SEED] = full.sensors.seed
    if adaptation := full.adaptation:
        nominal |= _numbers(adaptation, "adaptation")
        nominal |= {
            f"adaptation.bounds.{name}[{k}]": pair[k]
            for name, pair in adaptation.bounds.items()
            for k in range(2)
        }
    if estimator := full.estimator:
        nominal |= _numbers(estimator, "estimator") | (
            _numbers(estimator.pose, "estimator.pose") if estimator.pose else {}
        )
        nominal |= {f"estimator.scales.{name}": value for name, value in estimator.scales.items()}
    nominal |= {f"simulation.{name}": getattr(simulation, name) for name in ("period", "delay", "duration")}
    follows = {f"plant.{name}": f"parameters.{name}" for name in full.plant if name not in spec.plant}
    return SampleInputs(law, full, {name: float(value) for name, value in nominal.items()}, follows, state)


def _in_full(spec: Spec, loop: Loop) -> Spec:
    """Return the SPEC with its defaults written out."""
    law = loop.law
    mechanism = law.system.mechanism
    names = [p.name for p in law.parameters]
    gains = values_of(list(law.gains), gain_entries(law, spec.gains, "gains"), "gains")
    ki, ko = (
        {name: value for name, value in entries(law, spec.gains).items() if value}
        for entries in (integral_entries, observer_entries)
    )
    parameters = mechanism.parameter_values(spec.parameters)
    changed: dict[str, Any] = {
        "parameters": dict(zip(names, parameters, strict=True)),
        "plant": dict(zip(names, loop.plant.parameters.tolist(), strict=True)),
        "gains": dict(zip([gain.name for gain in law.gains], gains, strict=True)) | ki | ko,
    }
    if spec.output.own:
        given = values_of(list(law.config), spec.output.parameters, "[output] parameters")
        changed["output"] = replace(
            spec.output, parameters=dict(zip([c.name for c in law.config], given, strict=True))
        )
    if spec.output.type != "IV" and not spec.feedback:
        rows = len(law.output.rows)
        changed["reference"] = replace(spec.reference, velocity=spec.reference.velocity or (0.0,) * rows)
    if loop.route:
        guide = loop.route.options
        limits: dict[str, Any] = {}
        if profile := loop.route.profile:
            limits = {"speed": guide.speed} | asdict(profile.limits)
        changed["reference"] = replace(spec.reference, **({"deceleration": guide.deceleration} | limits))
        changed["initial"] = initial_of(spec, guide)
    if initial := spec.initial:
        if initial.q is not None:
            changed["initial"] = replace(initial, nu=initial.nu or (0.0,) * law.system.dof)
        elif initial.state is None:
            changed["initial"] = replace(initial, heading=initial.heading or 0.0, speed=initial.speed or 0.0)
    if spec.limits:
        count = len(mechanism.inputs)
        torque = None if spec.kinematic else _spread(spec.limits.torque or (0.0,), count)
        integral, disturbance = (
            _spread(spec.limits.integral, len(ki)),
            _spread(spec.limits.disturbance, len(ko)),
        )
        changed["limits"] = replace(spec.limits, torque=torque, integral=integral, disturbance=disturbance)
    if spec.sensors:
        noise = NoiseSection(
            **{name: _spread(getattr(spec.sensors.noise, name), law.system.dof) for name in ("mean", "sd")}
        )
        changed["sensors"] = replace(spec.sensors, noise=noise)
    return replace(spec, **changed)


def _point(output: OutputSection, law: ControlLaw) -> list[str]:
    """Return which of L, W, band, L_backward the law has."""
    config = [c.name for c in law.config]
    found: list[str] = [name for name in ("L", "W", "band") if name in config and not output.own]
    return [*found, "L_backward"] if output.L_backward is not None else found


def _spread(values: tuple[float, ...], count: int) -> tuple[float, ...]:
    return values * count if len(values) == 1 else values


def _numbers(section: Any, where: str) -> dict[str, float]:
    """Return the numbers of a section by name, those in lists with their index."""
    found: dict[str, float] = {}
    for name, value in ((f.name, getattr(section, f.name)) for f in fields(section)):
        if isinstance(value, tuple):
            found |= {
                f"{where}.{name}[{k}]": item for k, item in enumerate(value) if isinstance(item, float | int)
            }
        elif isinstance(value, float | int) and not isinstance(value, bool):
            found[f"{where}.{name}"] = value
    return found


def _changed(value: Any, changes: Mapping[Place, float]) -> Any:
    """Return a Spec, or a part of one, with other values at given paths."""
    if () in changes:
        return int(changes[()]) if isinstance(value, int) else changes[()]
    parts: dict[str | int, dict[Place, float]] = {}
    for (head, *rest), number in changes.items():
        parts.setdefault(head, {})[tuple(rest)] = number
    if isinstance(value, Mapping):
        return {**value, **{head: _changed(value[head], rest) for head, rest in parts.items()}}
    if isinstance(value, tuple):
        return tuple(_changed(item, parts[k]) if k in parts else item for k, item in enumerate(value))
    return replace(
        value, **{str(head): _changed(getattr(value, str(head)), rest) for head, rest in parts.items()}
    )
