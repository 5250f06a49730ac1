"""The texts of an FMU: modelDescription.xml, buildDescription.xml, and the C between FMI 3.0 and a law,
a plant, or both."""

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from ...model.law import ControlLaw
from ...model.mechanism import Quantity
from ...model.reduction import ReducedSystem
from ...readers.errors import BadInput
from ...readers.quantities import in_base_units
from ...readers.templates import render
from ..derivation.grip import can_grip
from ..identity import DYNAMICS, banner, fingerprint
from ..printing.scalar import DOUBLE
from ..project.project import starting_value
from ..versions import TOOLS

KINDS = ("controller", "plant", "loop")
PERIOD, INTEGRATION_STEP = 0.01, 0.001  # s
HEADER = "noslip_fmi3.h"
REGULAR = 1e4  # condition number of Phi at a start
BASE = {  # pint's base units as in a description
    **{
        "kilogram": "kg",
        "meter": "m",
        "second": "s",
        "ampere": "A",
        "kelvin": "K",
        "mole": "mol",
        "candela": "cd",
    },
    "radian": "rad",
}
TYPES = (
    "Float32",
    "Int8",
    "UInt8",
    "Int16",
    "UInt16",
    "Int32",
    "UInt32",
    "UInt64",
    "Boolean",
    "String",
    "Binary",
    "Clock",
)
NOT_OFFERED = (  # functions that every FMU must have, and that are of no use in these
    *(f"{access}{kind}" for access in ("Get", "Set") for kind in TYPES),
    *(
        "GetNumberOfVariableDependencies",
        "GetVariableDependencies",
        "GetDirectionalDerivative",
        "GetAdjointDerivative",
    ),
    *(
        "GetFMUState",
        "SetFMUState",
        "FreeFMUState",
        "SerializedFMUStateSize",
        "SerializeFMUState",
        "DeserializeFMUState",
    ),
    *(
        "EnterConfigurationMode",
        "ExitConfigurationMode",
        "EnterEventMode",
        "EnterContinuousTimeMode",
        "EnterStepMode",
    ),
    *(
        f"{access}{kind}{form}"
        for access in ("Get", "Set")
        for kind in ("Interval", "Shift")
        for form in ("Decimal", "Fraction")
    ),
    *(
        "EvaluateDiscreteStates",
        "UpdateDiscreteStates",
        "CompletedIntegratorStep",
        "SetTime",
        "SetContinuousStates",
    ),
    *(
        "GetContinuousStateDerivatives",
        "GetEventIndicators",
        "GetContinuousStates",
        "GetNominalsOfContinuousStates",
    ),
    *(
        "GetNumberOfEventIndicators",
        "GetNumberOfContinuousStates",
        "GetOutputDerivatives",
        "ActivateModelPartition",
    ),
)


@dataclass(frozen=True)
class Item:
    """A value of an enumeration."""

    name: str
    value: int
    about: str


@dataclass(frozen=True)
class Variable:
    """A variable of an FMU; `declared` is the type of an enumeration. An `initial` value is exact or
    calculated."""

    name: str
    causality: str
    variability: str
    initial: str
    start: float = 0.0
    unit: str = ""
    about: str = ""
    declared: str = ""

    @property
    def literal(self) -> str:
        """Return the starting value, as in C and in XML."""
        return str(int(self.start)) if self.declared else DOUBLE.literal(self.start)

    @property
    def settable(self) -> str:
        """Return when it may be set: i, always; s, before the first step; -, never."""
        return "i" if self.causality == "input" else "s" if self.initial == "exact" else "-"


@dataclass(frozen=True)
class VariableGroup:
    """Variables that are a member of the instance: a struct of the robot, an array, or a number."""

    declaration: str
    variables: tuple[Variable, ...]


def fmu(
    kind: str, system: ReducedSystem, law: ControlLaw | None, sources: Mapping[str, str]
) -> tuple[str, dict[str, str]]:
    """Return the name of the model and the texts of the FMU, by their names in the archive.

    `kind`: controller (the law), plant (the robot's dynamics, without a law) or loop (both). `sources`: file
    name -> text of the C of the robot in double, with the runtime.
    """
    mechanism = system.mechanism
    robot, own = mechanism.name, f"{mechanism.name}_{law.name}" if law else ""
    identifier = f"{own or robot}_{kind}"
    has_plant = kind != "controller"
    groups = _groups(kind, system, law, sources)
    reals = [
        Variable("time", "independent", "continuous", ""),
        *(v for group in groups for v in group.variables),
    ]
    choices, enumerations = _choices(law, sources)
    token = hashlib.sha256(f"{identifier} {TOOLS} {fingerprint(system, law)}".encode()).hexdigest()
    values = {
        "identifier": identifier,
        "kind": kind,
        "about": f"{mechanism.about}: {law.output.about if law else DYNAMICS}",
        "banner": banner(fingerprint(system, law)),
        "tools": TOOLS,
        "token": token,
        "robot": robot,
        "law": own,
        "dynamics": f"{robot}_{DYNAMICS}" if has_plant else "",
        "groups": groups,
        "reals": reals,
        "choices": choices,
        "coordinates": len(mechanism.coordinates),
        "states": len(system.state),
        "extension": len(law.extension) if law else 0,
        "grips": law is not None and can_grip(system),
        "limits": [f"self->real.of.limit[{k}]" for k in range(len(mechanism.inputs))],
        **_arguments(system, law),
        "lengths": ["integration_step", *["period"] * (kind == "loop")],
        "period": PERIOD,
        "units": {unit: _base(unit) for unit in dict.fromkeys(["s", *(v.unit for v in reals)]) if unit},
        "enumerations": enumerations,
        "unused": {
            "statuses": [f"fmi3{name}" for name in NOT_OFFERED],
            "instances": ["fmi3InstantiateModelExchange", "fmi3InstantiateScheduledExecution"],
        },
    }
    code = {
        **sources,
        HEADER: render(__file__, HEADER),
        f"{identifier}.c": render(__file__, "fmu.c", **values),
    }
    compiled = sorted(name for name in code if name.endswith(".c"))
    files = {
        f"sources/{name}": text for name, text in sorted(code.items()) if name.endswith((".c", ".h", ".inc"))
    }
    files["sources/buildDescription.xml"] = render(
        __file__, "buildDescription.xml", **values, sources=compiled
    )
    return identifier, {"modelDescription.xml": render(__file__, "modelDescription.xml", **values), **files}


def _groups(
    kind: str, system: ReducedSystem, law: ControlLaw | None, sources: Mapping[str, str]
) -> list[VariableGroup]:
    """Return the variables that are numbers, except time, in the order of their value references."""
    mechanism = system.mechanism
    robot, inputs = mechanism.name, mechanism.inputs
    parameter, entry, shown = (
        ("parameter", "fixed", "exact"),
        ("input", "continuous", "exact"),
        ("output", "continuous", "exact"),
    )
    computed = ("output", "continuous" if kind == "controller" else "discrete", "calculated")
    groups = [_struct(f"{robot}_params params", "params", parameter, mechanism.parameters)]
    if law:
        own = f"{robot}_{law.name}"
        groups.append(_struct(f"{own}_config config", "config", parameter, law.config))
        groups.append(_struct(f"{own}_gains gains", "gains", parameter, law.gains))
        most = "largest absolute value; 0: no limit"
        groups.append(
            _struct(f"double extension[{len(law.extension)}]", "extension", parameter, law.extension)
        )
        limits = [Variable(f"limit.{q.name}", *parameter, 0.0, q.unit, f"{q.about}: {most}") for q in inputs]
        groups.append(VariableGroup(f"double limit[{len(inputs)}]", tuple(limits)))
        if can_grip(system):
            floor = (
                sources["noslip_grip.h"].partition("typedef struct noslip_friction {")[2].partition("}")[0]
            )
            friction = re.findall(r"double (\w+); +/\* (?:(m): )?(.*?) \*/", floor)
            members = tuple(
                Variable(f"friction.{name}", *parameter, 0.0, unit or "1", about)
                for name, unit, about in friction
            )
            groups.append(VariableGroup("noslip_friction friction", members))
    if kind == "loop":
        period = Variable("period", *parameter, PERIOD, "s", "time between calls of the law")
        groups.append(VariableGroup("double period", (period,)))
    if kind != "controller":
        step = Variable(
            "integration_step", *parameter, INTEGRATION_STEP, "s", "longest step of the integration"
        )
        groups.append(VariableGroup("double integration_step", (step,)))
    starts = _at_rest(law) if law else {}
    groups.append(
        _struct(
            f"{robot}_state state", "state", entry if kind == "controller" else shown, system.state, starts
        )
    )
    if law:
        groups.append(
            _struct(f"{robot}_{law.name}_reference reference", "reference", entry, law.reference, starts)
        )
    groups.append(_struct(f"double tau[{len(inputs)}]", "tau", computed if law else entry, inputs))
    return [group for group in groups if group.variables]


def _at_rest(law: ControlLaw) -> dict[str, float]:
    """Return starting values by name, of states and of desired outputs, with which a robot stays at rest: the
    desired outputs are those there. All coordinates are 0, or where Phi is singular so, one angle is 1 rad.
    Empty for a law with an extension, which is singular at rest, and where none of these is regular.
    """
    if law.extension:
        return {}
    system, found = law.system, law.linearization
    function = law.at_state(found.h, found.Phi)
    numbers = [q.default for q in system.mechanism.parameters], [starting_value(q) for q in law.config]
    angles = [k for k, q in enumerate(system.mechanism.coordinates) if q.unit == "rad"]
    for angle in (None, *angles):
        state = np.zeros(len(system.state))
        state[[] if angle is None else angle] = 1.0
        h, Phi = (value.full() for value in function(state, *numbers))
        if np.isfinite(h).all() and np.isfinite(Phi).all() and np.linalg.cond(Phi) < REGULAR:
            outputs = {row.name: float(value) for row, value in zip(law.output.rows, h.ravel(), strict=True)}
            return dict(zip((q.name for q in system.state), state.tolist(), strict=True)) | outputs
    return {}


def _struct(
    declaration: str,
    name: str,
    role: tuple[str, str, str],
    quantities: Sequence[Quantity],
    known: Mapping[str, float] = MappingProxyType({}),
) -> VariableGroup:
    starts = [starting_value(q) if name == "config" else known.get(q.name, q.default) for q in quantities]
    return VariableGroup(
        declaration,
        tuple(
            Variable(f"{name}.{q.name}", *role, s, q.unit, q.about)
            for q, s in zip(quantities, starts, strict=True)
        ),
    )


def _choices(
    law: ControlLaw | None, sources: Mapping[str, str]
) -> tuple[list[Variable], dict[str, list[Item]]]:
    """Return the variables that are enumerations, the status last, and their types,
    as in the runtime's headers."""
    status, controller = sources["noslip_status.h"], sources["noslip_controller.h"]
    types = {"Status": _items(status, "enum {")}
    last = Variable(
        "status", "output", "discrete", "calculated", declared="Status", about="status of the last call"
    )
    if law is None:
        return [last], types
    types |= {
        "OnError": _items(status, "enum noslip_on_error {"),
        "OnLimit": _items(controller, "enum noslip_on_limit {"),
    }
    parameter = ("parameter", "fixed", "exact")
    on_error = Variable("on_error", *parameter, declared="OnError", about="inputs on an error")
    on_limit = Variable(
        "on_limit", *parameter, declared="OnLimit", about="what to do if inputs exceed their limits"
    )
    return [on_error, on_limit, last], types


def _items(header: str, opening: str) -> list[Item]:
    """Return the values of an enum of a header, which begins so, with their comments."""
    body = header.partition(opening)[2].partition("}")[0]
    items = re.findall(r"NOSLIP_(\w+) = (-?\d+)\b,?(?: +/\* (.*?) \*/)?", body)
    return [Item(name.lower(), int(value), about) for name, value, about in items]


def _arguments(system: ReducedSystem, law: ControlLaw | None) -> dict[str, list[str]]:
    """Return the first arguments of init, and those groups among them that have no member."""
    groups = {
        "params": system.mechanism.parameters,
        **({"config": law.config, "gains": law.gains} if law else {}),
    }
    empty = [name for name, group in groups.items() if not group]
    return {
        "arguments": [f"&{name}" if name in empty else f"&self->real.of.{name}" for name in groups],
        "empty": empty,
    }


def _base(unit: str) -> dict[str, object] | None:
    """Return the attributes of a BaseUnit; None for what is not a unit of SI."""
    try:
        factor, powers = in_base_units(unit)
        attributes: dict[str, object] = {BASE[name]: power for name, power in sorted(powers)}
    except (BadInput, KeyError):
        return None
    return attributes if factor == 1 else attributes | {"factor": float(factor)}
