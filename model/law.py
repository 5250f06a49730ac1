"""The whole control law: outer loop, second feedback (20), first feedback (12), as one set of expressions."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca

from .linearization import Linearization, linearize
from .mechanism import Quantity, per_second, quantity, refuse_twice
from .outputs import OutputMap
from .reduction import ReducedSystem


@dataclass(frozen=True, eq=False)
class ControlLaw:
    """A control law from state and reference to the inputs, symbolic.

    Outer loop, row of relative degree 2: v = yddot_d + kd (ydot_d - ydot) + kp (y_d - y); degree 1: v = ydot_d + kv (y_d - y).
    `v` and `u` are (n-m) x 1, `tau` is r x 1 in the units of the inputs. They depend on `groups`: parameters, config (of the
    output map), gains, state [q; nu] and reference, in SI units. `u_of_v` and `tau_of_v` are functions of v itself.
    """

    linearization: Linearization
    parameters: tuple[Quantity, ...]
    config: tuple[Quantity, ...]
    gains: tuple[Quantity, ...]
    state: tuple[Quantity, ...]
    reference: tuple[Quantity, ...]
    virtual_input: tuple[Quantity, ...]
    v: ca.SX = field(repr=False)
    u: ca.SX = field(repr=False)
    tau: ca.SX = field(repr=False)
    u_of_v: ca.SX = field(repr=False)
    tau_of_v: ca.SX = field(repr=False)

    @property
    def name(self) -> str:
        """Return the law's name, as on the command line, in JSON and in C."""
        return self.output.name

    @property
    def system(self) -> ReducedSystem:
        """Return the reduced system that it controls."""
        return self.linearization.system

    @property
    def output(self) -> OutputMap:
        """Return the outputs that it controls."""
        return self.linearization.output

    @property
    def speed_row(self) -> int | None:
        """Return the row of relative degree 1 if there is exactly one: its acceleration can be reduced in favour of the other
        rows.
        """
        degree = self.linearization.relative_degree
        return degree.index(1) if degree.count(1) == 1 else None

    @property
    def slope(self) -> ca.SX:
        """Return the derivative of tau by the virtual input of the speed row, r x 1 (0 x 1 without one); tau is affine in v
        (20), (12).
        """
        if self.speed_row is None:
            return ca.SX(0, 1)
        return ca.jacobian(self.tau_of_v, self.virtual_input[self.speed_row].symbol)

    @property
    def groups(self) -> dict[str, tuple[Quantity, ...]]:
        """Return all quantities on which the law depends, by group."""
        return {
            "params": self.parameters,
            "config": self.config,
            "gains": self.gains,
            "state": self.state,
            "reference": self.reference,
            "virtual_input": self.virtual_input,
        }

    @property
    def quantities(self) -> dict[str, ca.SX]:
        """What an evaluation of the law returns, by name."""
        found = self.linearization
        return {"h": found.h, "ydot": found.rate, "Phi": found.Phi, "Phidot": found.Phidot, "u": self.u, "tau": self.tau}

    def at_state(self, *expressions: ca.SX) -> ca.Function:
        """CasADi function from (state, parameters, config) to the expressions, which depend on nothing else."""
        arguments = [symbols(self.groups[name]) for name in ("state", "params", "config")]
        return ca.Function(self.name, arguments, [ca.densify(expression) for expression in expressions])

    def function(self, quantities: dict[str, ca.SX]) -> ca.Function:
        """Return the CasADi function from (params, config, gains, state, reference) to the named quantities."""
        names = [name for name in self.groups if name != "virtual_input"]
        arguments = [symbols(self.groups[name]) for name in names]
        return ca.Function(self.name, arguments, [ca.densify(q) for q in quantities.values()], names, list(quantities))


def symbols(quantities: Sequence[Quantity]) -> ca.SX:
    """Return the symbols of a group as a column."""
    return ca.vertcat(*[q.symbol for q in quantities])


def control_law(system: ReducedSystem, output: OutputMap) -> ControlLaw:
    """Return the control law for one output map. Raises ModelError as `linearize` does."""
    found = linearize(system, output)
    gains, reference = _outer_loop_symbols(found)
    v = outer_loop(found.relative_degree, [k.symbol for k in gains], [y.symbol for y in reference], found.h, found.rate)
    virtual_input = tuple(
        quantity(f"v_{row.name}", _derivative_unit(row.unit, degree), f"virtual input: derivative {degree} of {row.name}")
        for row, degree in zip(output.rows, found.relative_degree, strict=True)
    )
    for group, members in (("reference", reference), ("gains", gains)):
        refuse_twice([q.name for q in members], f"{system.mechanism.name}, output {output.name}, {group}")
    u, u_of_v = found.second_feedback(v), found.second_feedback(symbols(virtual_input))
    mechanism = system.mechanism
    return ControlLaw(
        linearization=found,
        parameters=tuple(mechanism.parameters),
        config=tuple(output.parameters),
        gains=gains,
        state=system.state,
        reference=reference,
        virtual_input=virtual_input,
        v=v,
        u=u,
        tau=system.first_feedback(u),
        u_of_v=u_of_v,
        tau_of_v=system.first_feedback(u_of_v),
    )


def outer_loop(degree: Sequence[int], gains: Sequence[ca.SX], reference: Sequence[ca.SX], h: ca.SX, rate: ca.SX) -> ca.SX:
    """Return the virtual input v from outputs h and their rates, with gains and references in order, row by row."""
    gain, desired, rates = iter(gains), iter(reference), iter(ca.vertsplit(rate) if rate.numel() else ())
    v = []
    for k, y in zip(degree, ca.vertsplit(h), strict=True):
        error, rate_d = next(desired) - y, next(desired)
        if k == 1:
            v.append(rate_d + next(gain) * error)
        else:
            v.append(next(desired) + next(gain) * error + next(gain) * (rate_d - next(rates)))
    return ca.vertcat(*v)


def _outer_loop_symbols(found: Linearization) -> tuple[tuple[Quantity, ...], tuple[Quantity, ...]]:
    """Return gains and references of every row. The paper's gains are illegible in the scan: 1, 2.5 and 2 are assumed."""
    gains: list[Quantity] = []
    reference: list[Quantity] = []
    for row, degree in zip(found.output.rows, found.relative_degree, strict=True):
        name, unit = row.name, row.unit
        reference.append(quantity(name, unit, f"desired {row.about}"))
        reference.append(quantity(f"{name}_rate", per_second(unit), f"desired rate of {name}"))
        if degree == 1:
            gains.append(quantity(f"kv_{name}", "1/s", f"{name} error", 2.0, "nonnegative"))
            continue
        reference.append(quantity(f"{name}_acceleration", _derivative_unit(unit, 2), f"desired second derivative of {name}"))
        gains.append(quantity(f"kp_{name}", "1/s^2", f"{name} error", 1.0, "nonnegative"))
        gains.append(quantity(f"kd_{name}", "1/s", f"error of the rate of {name}", 2.5, "nonnegative"))
    return tuple(gains), tuple(reference)


def _derivative_unit(unit: str, degree: int) -> str:
    return per_second(unit) if degree == 1 else per_second(per_second(unit))
