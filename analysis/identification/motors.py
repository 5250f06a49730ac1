"""Motors between logged inputs and the robot's: torques, currents or voltages; a gear,
viscous and Coulomb friction."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

import casadi as ca

from ...model.mechanism import Quantity
from ...model.reduction import ReducedSystem
from ...readers.errors import BadInput

# Of logged inputs, and their units; a torque has that of the input
KINDS = {"torque": "", "current": "A", "voltage": "V"}
# What must be given or fitted, since no default is likely.
REQUIRED = {"torque": (), "current": ("torque_constant",), "voltage": ("torque_constant", "resistance")}


def motor_quantities(system: ReducedSystem) -> tuple[Quantity, ...]:
    """Return the parameters of all motors, as in noslip_motor.h, and those of a single one: NAME_INPUT.
    Without those whose name is also that of a parameter of the robot.
    """
    inputs = system.mechanism.inputs
    force = inputs[0].unit if len({each.unit for each in inputs}) == 1 else "N m"
    single = (_renamed(q, each.name) for each in inputs for q in _motor(each.unit))
    own = {p.name for p in system.mechanism.parameters}
    return tuple(q for q in (*_motor(force), *single) if q.name not in own)


def check_names(system: ReducedSystem, kind: str) -> None:
    """Raise BadInput if a parameter of the robot has the name of one of motors, and these are used."""
    motors = {
        name
        for q in _motor("N m")
        for name in (q.name, *(f"{q.name}_{each.name}" for each in system.mechanism.inputs))
    }
    for p in system.mechanism.parameters:
        if kind != "torque" and p.name in motors:
            raise BadInput(
                f"{system.mechanism.name}: {p.name} is also the name of a motor's parameter; rename the "
                "robot's"
            )


def _motor(force: str) -> Iterator[Quantity]:
    """Yield the parameters of a motor whose wheel or joint takes an input of the unit `force`."""
    velocity = "rad" if force == "N m" else "m"
    for name, unit, about, default, sign in (
        (
            "gear",
            "1",
            "turns of the motor per turn of the wheel, negative if it is mounted the other way round",
            1.0,
            "any",
        ),
        ("efficiency", "1", "of the gear where the motor drives the wheel", 1.0, "positive"),
        ("back_efficiency", "1", "of the gear where the wheel drives the motor", 1.0, "positive"),
        ("torque_constant", f"{force}/A", "torque of the motor per current", 1.0, "positive"),
        ("resistance", "ohm", "of winding, driver and cable", 1.0, "positive"),
        ("friction", f"{force} s/{velocity}", "viscous friction at the wheel", 0.0, "nonnegative"),
        ("dry_friction", force, "Coulomb friction at the wheel", 0.0, "nonnegative"),
        (
            "moving",
            f"{velocity}/s",
            "rate from which on the direction of friction counts in full",
            0.05,
            "positive",
        ),
    ):
        yield Quantity(name, unit, about, default, sign, symbol=ca.SX.sym(name))


def _renamed(quantity: Quantity, of: str) -> Quantity:
    name = f"{quantity.name}_{of}"
    return replace(quantity, name=name, about=f"{quantity.about}, {of} alone", symbol=ca.SX.sym(name))


def _single(name: str, system: ReducedSystem) -> bool:
    """Whether a parameter belongs to a single motor."""
    return any(name.endswith(f"_{each.name}") for each in system.mechanism.inputs)


def logged_inputs(system: ReducedSystem, kind: str) -> tuple[Quantity, ...]:
    """Return what a log with inputs of this kind has of each input."""
    names = {each.name: _logged(kind, each.name) for each in system.mechanism.inputs}
    units = {each.name: KINDS[kind] or each.unit for each in system.mechanism.inputs}
    return tuple(Quantity(names[each], units[each], symbol=ca.SX.sym(names[each])) for each in names)


def _logged(kind: str, name: str) -> str:
    """Return the column of an input of this kind."""
    return name if kind == "torque" else f"{kind}_{name}"


def kind_of_inputs(system: ReducedSystem, columns: Collection[str]) -> str:
    """Return the kind of inputs that a log with these columns has. Raises BadInput if it has several."""
    needed = {kind: {_logged(kind, each.name) for each in system.mechanism.inputs} for kind in KINDS}
    found = [kind for kind, names in needed.items() if names <= set(columns)]
    if len(found) > 1:
        raise BadInput(
            f"the log has {' and '.join(found)} of each input; choose one with --drive {'|'.join(found)}"
        )
    return found[0] if found else max(needed, key=lambda kind: len(needed[kind] & set(columns)))


def used_quantities(system: ReducedSystem, own: Collection[str]) -> tuple[Quantity, ...]:
    """Return the parameters of all motors, and those of `own` of single ones, NAME_INPUT,
    which replace them there."""
    return tuple(q for q in motor_quantities(system) if q.name in own or not _single(q.name, system))


def torques(
    system: ReducedSystem, kind: str, logged: Sequence[Quantity], motors: Sequence[Quantity]
) -> ca.SX:
    """Return the robot's inputs, r x 1, that follow from the logged ones at the present state."""
    mechanism, symbols = system.mechanism, {q.name: q.symbol for q in motors}
    rates = ca.substitute(ca.vertcat(*mechanism.actuation), mechanism.qdot, system.qdot)
    results = []
    for k, (each, taken) in enumerate(zip(logged, mechanism.inputs, strict=True)):
        of_motor = {
            q.name: symbols.get(f"{q.name}_{taken.name}", symbols.get(q.name, q.default))
            for q in _motor(taken.unit)
        }
        results.append(_torque(kind, each.symbol, rates[k], of_motor))
    return ca.vertcat(*results)


def _torque(kind: str, value: ca.SX, rate: ca.SX, motor: Mapping[str, ca.SX | float]) -> ca.SX:
    """Return the torque at the wheel, as in noslip_motor.h: E current e without friction, with E =
    torque_constant gear and e the efficiency where the motor drives, its reciprocal where the wheel drives
    it; the change is continuous below the rate `moving`.
    """
    forward = ca.fmin(ca.fmax(rate / motor["moving"], -1.0), 1.0)
    friction = motor["friction"] * rate + motor["dry_friction"] * forward
    if kind == "torque":
        return value - friction
    emf = motor["torque_constant"] * motor["gear"]
    current = value if kind == "current" else (value - emf * rate) / motor["resistance"]
    loaded = emf * current
    driven = ca.fmax(-ca.sign(loaded) * forward, 0.0)
    losses = (1 - driven) / motor["efficiency"] + driven * motor["back_efficiency"]
    return loaded / losses - friction
