"""The whole control law: outer loop, second feedback (20), first feedback (12), as one set of expressions.

Of a kinematic law the second feedback gives the quasi-velocities that drives are commanded; there is no first
feedback.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
from numpy.polynomial import polynomial

from .linearization import Linearization, linearize
from .mechanism import Quantity, derivative_name, derivative_unit, quantity, refuse_twice
from .outputs import OutputMap, OutputRow
from .reduction import ReducedSystem


@dataclass(frozen=True, eq=False)
class Feedbacks:
    """Both feedbacks: `u` and `tau` with the outer loop, `u_of_v` and `tau_of_v` of the virtual input;
    see ControlLaw."""

    u: ca.SX
    tau: ca.SX
    u_of_v: ca.SX
    tau_of_v: ca.SX


@dataclass(frozen=True, eq=False)
class ControlLaw:
    """A control law from state and reference to the inputs, symbolic.

    Outer loop, row of relative degree 2: v = yddot_d + kd (ydot_d - ydot) + kp (y_d - y); degree 1: v =
    ydot_d + kv (y_d - y); longer chains as degree 2, with ka on the error of the second derivative and so on
    (GAINS); degree 0: v = y_d. `v` and `u` are (n-m) x 1, `tau` is r x 1 in the units of the inputs; with
    fewer inputs than n-m, `v` is r x 1. They depend on `groups`: parameters, config (of the output map),
    gains, state [q; nu] and reference, in SI units. `u_of_v` and `tau_of_v` are functions of v itself.
    Of a kinematic law `tau` is the command nu_c, (n-m) x 1, in the units of the quasi-velocities, and `u` is
    empty. With a dynamic extension its states xi are the last of the state, and `extension_rate` is d xi/dt,
    k x 1; else 0 x 1. Of a damped law these are what `outside` and `within` give on either side of the edge
    of its band.
    """

    linearization: Linearization
    parameters: tuple[Quantity, ...]
    config: tuple[Quantity, ...]
    gains: tuple[Quantity, ...]
    reference: tuple[Quantity, ...]
    virtual_input: tuple[Quantity, ...]
    v: ca.SX = field(repr=False)
    u: ca.SX = field(repr=False)
    tau: ca.SX = field(repr=False)
    extension_rate: ca.SX = field(repr=False)
    u_of_v: ca.SX = field(repr=False)
    tau_of_v: ca.SX = field(repr=False)
    outside: Feedbacks = field(repr=False)
    within: Feedbacks | None = field(repr=False)

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
    def kinematic(self) -> bool:
        """Whether it commands quasi-velocities instead of inputs."""
        return self.linearization.kinematic

    @property
    def inputs(self) -> tuple[Quantity, ...]:
        """Return what a step returns: the robot's inputs, or of a kinematic law the commanded
        quasi-velocities."""
        if not self.kinematic:
            return tuple(self.system.mechanism.inputs)
        velocities = self.system.quasi_velocities
        return tuple(
            quantity(f"command_{q.name}", q.unit, f"commanded {q.about or q.name}") for q in velocities
        )

    @property
    def extension(self) -> tuple[Quantity, ...]:
        """Return the states of the dynamic extension; empty without one."""
        return self.linearization.extension

    @cached_property
    def state(self) -> tuple[Quantity, ...]:
        """Return [q; nu], followed by the states of the extension."""
        return (*self.system.state, *self.extension)

    @property
    def rates(self) -> tuple[Quantity, ...]:
        """Return the derivatives of the outputs below the highest, in the order of `Linearization.rate`."""
        degrees = zip(self.output.rows, self.linearization.relative_degree, strict=True)
        return tuple(_derivative(row, order) for row, degree in degrees for order in range(1, degree))

    @property
    def speed_row(self) -> int | None:
        """Return the row of relative degree 1, of a kinematic law 0, if there is exactly one: it can be
        reduced in favour of the other rows.
        """
        degree, of_speed = self.linearization.relative_degree, 0 if self.kinematic else 1
        return degree.index(of_speed) if degree.count(of_speed) == 1 else None

    @property
    def slope(self) -> ca.SX:
        """Return the derivative of tau by the virtual input of the speed row, r x 1 (0 x 1 without one); tau
        is affine in v (20), (12).
        """
        return self.slope_of(self.tau_of_v)

    def slope_of(self, tau_of_v: ca.SX) -> ca.SX:
        """Return the same of `outside` or `within`."""
        if self.speed_row is None:
            return ca.SX(0, 1)
        return ca.jacobian(tau_of_v, self.virtual_input[self.speed_row].symbol)

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
        io = self.linearization
        if self.kinematic:
            return {"h": io.h, "Phi": io.Phi, "command": self.tau}
        values = {
            "h": io.h,
            "ydot": io.rate,
            "Phi": io.Phi,
            "Phidot": io.Phidot,
            "u": self.u,
            "tau": self.tau,
        }
        return values | ({"extension_rate": self.extension_rate} if self.extension else {})

    def at_state(self, *expressions: ca.SX) -> ca.Function:
        """CasADi function from (state, parameters, config) to the expressions,
        which depend on nothing else."""
        arguments = [symbols(self.groups[name]) for name in ("state", "params", "config")]
        return ca.Function(self.name, arguments, [ca.densify(expression) for expression in expressions])

    def function(self, quantities: dict[str, ca.SX]) -> ca.Function:
        """Return the CasADi function from (params, config, gains, state,
        reference) to the named quantities."""
        names = [name for name in self.groups if name != "virtual_input"]
        arguments = [symbols(self.groups[name]) for name in names]
        return ca.Function(
            self.name, arguments, [ca.densify(q) for q in quantities.values()], names, list(quantities)
        )


def symbols(quantities: Sequence[Quantity]) -> ca.SX:
    """Return the symbols of a group as a column."""
    return ca.vertcat(*[q.symbol for q in quantities])


def control_law(system: ReducedSystem, output: OutputMap) -> ControlLaw:
    """Return the control law for one output map. Raises ModelError as `linearize` does."""
    linearization = linearize(system, output)
    gains, reference = _outer_loop_symbols(linearization)
    degrees, h, rate = linearization.relative_degree, linearization.h, linearization.rate
    v = outer_loop(degrees, [k.symbol for k in gains], [y.symbol for y in reference], h, rate)
    virtual_input = tuple(
        quantity(
            f"v_{row.name}", derivative_unit(row.unit, degree), f"virtual input: {_nth(degree)}{row.name}"
        )
        for row, degree in zip(output.rows, degrees, strict=True)
    )
    for group, members in (("reference", reference), ("gains", gains)):
        refuse_twice([q.name for q in members], f"{system.mechanism.name}, output {output.name}, {group}")
    both = v, symbols(virtual_input)
    (u, extension_rate), (u_of_v, _) = (
        linearization.accelerations(linearization.second_feedback(each)) for each in both
    )
    outside = applied = _feedback(linearization, u, u_of_v)
    within = None
    if linearization.damping:
        kd = next(k.symbol for k in gains if k.name.startswith("kd_"))
        within = _feedback(linearization, *[linearization.damping.second_feedback(each, kd) for each in both])
        applied = _either(linearization.damping.inside, within, outside)
    return ControlLaw(
        linearization=linearization,
        parameters=tuple(system.mechanism.parameters),
        config=tuple(linearization.output.parameters),
        gains=gains,
        reference=reference,
        virtual_input=virtual_input,
        v=v,
        extension_rate=extension_rate,
        outside=outside,
        within=within,
        **vars(applied),
    )


def _feedback(linearization: Linearization, u: ca.SX, u_of_v: ca.SX) -> Feedbacks:
    """Return both feedbacks from what `second_feedback` gives, with the outer loop and of v."""
    if linearization.kinematic:
        return Feedbacks(ca.SX(0, 1), u, ca.SX(0, 1), u_of_v)
    first = linearization.system.first_feedback
    return Feedbacks(u, first(u), u_of_v, first(u_of_v))


def _either(condition: ca.SX, one: Feedbacks, other: Feedbacks) -> Feedbacks:
    """Return `one` where the condition holds, else `other`."""
    return Feedbacks(
        *[ca.if_else(condition, a, b) for a, b in zip(vars(one).values(), vars(other).values(), strict=True)]
    )


def _nth(order: int) -> str:
    return f"derivative {order} of " if order else ""


def _derivative(row: OutputRow, order: int, about: str = "") -> Quantity:
    return quantity(derivative_name(row.name, order), derivative_unit(row.unit, order), about)


def outer_loop(
    degree: Sequence[int], gains: Sequence[ca.SX], reference: Sequence[ca.SX], h: ca.SX, rate: ca.SX
) -> ca.SX:
    """Return the virtual input v from outputs h and their derivatives,
    with gains and references in order, row by row."""
    gain, desired, rates = iter(gains), iter(reference), iter(ca.vertsplit(rate) if rate.numel() else ())
    v = []
    for k, y in zip(degree, ca.vertsplit(h), strict=True):
        measured = [y, *[next(rates) for _ in range(1, k)]][:k]
        errors = [next(desired) - value for value in measured]
        v.append(sum((next(gain) * error for error in errors), start=next(desired)))
    return ca.vertcat(*v)


# On the error of the derivative of order 0, 1, ...; kv for relative degree 1
GAINS = ("kp", "kd", "ka", "kj", "ks", "kc")
ORDINAL = ("", "rate", *(f"{nth} derivative" for nth in ("second", "third", "fourth", "fifth", "sixth")))
SHORT_GAINS = ("kv", *GAINS)


def gain_names(degree: int) -> tuple[str, ...]:
    """Return the names of the gains of a chain, without that of the output."""
    return ("kv",) if degree == 1 else GAINS[:degree]


def default_gains(degree: int) -> list[float]:
    """Return default gains of a chain: a pole at -2 1/s; from degree 2 on one at -0.5 1/s,
    and all others at -2 1/s."""
    poles = [-2.0] * degree if degree < 2 else [-0.5, *[-2.0] * (degree - 1)]
    return polynomial.polyfromroots(poles)[:-1].tolist()


def _outer_loop_symbols(linearization: Linearization) -> tuple[tuple[Quantity, ...], tuple[Quantity, ...]]:
    """Return gains and references of every row. The paper's gains are illegible in the scan: 1,
    2.5 and 2 are assumed."""
    gains: list[Quantity] = []
    reference: list[Quantity] = []
    for row, degree in zip(linearization.output.rows, linearization.relative_degree, strict=True):
        name = row.name
        for order in range(degree + 1):
            meaning = row.about if order == 0 else f"{ORDINAL[order]} of {name}"
            reference.append(_derivative(row, order, f"desired {meaning}"))
        for order, (gain, default) in enumerate(zip(gain_names(degree), default_gains(degree), strict=True)):
            meaning = f"{name} error" if order == 0 else f"error of the {ORDINAL[order]} of {name}"
            gains.append(
                quantity(
                    f"{gain}_{name}", derivative_unit("1", degree - order), meaning, default, "nonnegative"
                )
            )
    return tuple(gains), tuple(reference)
