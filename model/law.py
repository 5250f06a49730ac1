"""The whole control law: outer loop, second feedback (20), first feedback (12), as one set of expressions."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca

from .linearization import Linearization, linearize
from .mechanism import Quantity, per_second, quantity
from .outputs import OutputMap
from .reduction import ReducedSystem


@dataclass(frozen=True, eq=False)
class ControlLaw:
    """State and reference to input. `groups` are what it depends on, `quantities` what it answers.

    Outer loop, row of relative degree 2: v = yddot_d + kd (ydot_d - ydot) + kp (y_d - y); degree 1: v = ydot_d + kv (y_d - y).
    """

    linearization: Linearization
    parameters: tuple[Quantity, ...]
    config: tuple[Quantity, ...]
    gains: tuple[Quantity, ...]
    state: tuple[Quantity, ...]
    reference: tuple[Quantity, ...]
    demand: tuple[Quantity, ...]
    v: ca.SX = field(repr=False)
    u: ca.SX = field(repr=False)
    tau: ca.SX = field(repr=False)
    u_of_demand: ca.SX = field(repr=False)
    tau_of_demand: ca.SX = field(repr=False)

    @property
    def name(self) -> str:
        """The law's name, as on the command line, in JSON and in C."""
        return self.output.name

    @property
    def system(self) -> ReducedSystem:
        """The reduced system it controls."""
        return self.linearization.system

    @property
    def output(self) -> OutputMap:
        """The outputs it makes follow."""
        return self.linearization.output

    @property
    def groups(self) -> dict[str, tuple[Quantity, ...]]:
        """Everything the law depends on, by where it comes from."""
        return {
            "params": self.parameters,
            "config": self.config,
            "gains": self.gains,
            "state": self.state,
            "reference": self.reference,
            "demand": self.demand,
        }

    def function(self, quantities: dict[str, ca.SX]) -> ca.Function:
        """CasADi function from (params, config, gains, state, reference) to the named quantities."""
        names = [name for name in self.groups if name != "demand"]
        arguments = [symbols(self.groups[name]) for name in names]
        return ca.Function(self.name, arguments, [ca.densify(q) for q in quantities.values()], names, list(quantities))


def symbols(quantities: Sequence[Quantity]) -> ca.SX:
    """The symbols of a group, as a column."""
    return ca.vertcat(*[q.symbol for q in quantities])


def control_law(system: ReducedSystem, output: OutputMap) -> ControlLaw:
    """Build the law for one output map. Raises ModelError as `linearize` does."""
    found = linearize(system, output)
    gains, reference, v = _outer_loop(found)
    demand = tuple(
        quantity(f"v_{row.name}", _derivative_unit(row.unit, degree), f"wanted derivative {degree} of {row.name}")
        for row, degree in zip(output.rows, found.relative_degree, strict=True)
    )
    u, u_of_demand = found.second_feedback(v), found.second_feedback(symbols(demand))
    mechanism = system.mechanism
    return ControlLaw(
        linearization=found,
        parameters=tuple(mechanism.parameters),
        config=output.parameters,
        gains=gains,
        state=system.state,
        reference=reference,
        demand=demand,
        v=v,
        u=u,
        tau=system.first_feedback(u),
        u_of_demand=u_of_demand,
        tau_of_demand=system.first_feedback(u_of_demand),
    )


def _outer_loop(found: Linearization) -> tuple[tuple[Quantity, ...], tuple[Quantity, ...], ca.SX]:
    """Gains, references and v of every row. The paper's gains are lost in the scan: 1, 2.5 and 2 are assumed."""
    gains: list[Quantity] = []
    reference: list[Quantity] = []
    v = []
    second_order = iter(ca.vertsplit(found.rate)) if found.rate.numel() else iter(())

    def add(group: list[Quantity], name: str, unit: str, about: str, default: float = 0.0, sign: str = "any") -> ca.SX:
        group.append(quantity(name, unit, about, default, sign))
        return group[-1].symbol

    for row, degree, h in zip(found.output.rows, found.relative_degree, ca.vertsplit(found.h), strict=True):
        y_d = add(reference, row.name, row.unit, f"wanted {row.about}")
        rate_d = add(reference, f"{row.name}_rate", per_second(row.unit), f"wanted rate of {row.name}")
        if degree == 1:
            kv = add(gains, f"kv_{row.name}", "1/s", f"{row.name} error", 2.0, "nonnegative")
            v.append(rate_d + kv * (y_d - h))
            continue
        unit = _derivative_unit(row.unit, 2)
        acceleration_d = add(reference, f"{row.name}_acceleration", unit, f"wanted second derivative of {row.name}")
        kp = add(gains, f"kp_{row.name}", "1/s^2", f"{row.name} error", 1.0, "nonnegative")
        kd = add(gains, f"kd_{row.name}", "1/s", f"error of the rate of {row.name}", 2.5, "nonnegative")
        v.append(acceleration_d + kd * (rate_d - next(second_order)) + kp * (y_d - h))
    return tuple(gains), tuple(reference), ca.vertcat(*v)


def _derivative_unit(unit: str, degree: int) -> str:
    return per_second(unit) if degree == 1 else per_second(per_second(unit))
