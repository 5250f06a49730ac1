"""A mechanical system with rolling constraints, described once: paper equations (2) and (8).

The user names coordinates and parameters, adds the energy of each body, states which velocities vanish where
something rolls, and where the inputs act. M, V, A and E follow by CasADi's differentiation.
"""

import math
import numbers
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cached_property, wraps
from typing import Any, Concatenate, ParamSpec, TypeVar

import casadi as ca

from .algebra.exact import canonical
from .algebra.expression import as_text, degree, free_symbols, time_derivative
from .algebra.operations import kinks, refuse_jumps, refuse_unsupported
from .errors import ModelError
from .names import in_c, is_reserved, refuse_column, refuse_output, refuse_robot, similar

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

SIGNS: dict[str, tuple[Callable[[float], bool], str]] = {
    "positive": (lambda value: value > 0.0, "positive"),
    "nonnegative": (lambda value: value >= 0.0, "zero or positive"),
    "any": (lambda value: True, "any number"),
}


@dataclass(frozen=True)
class Quantity:
    """A named scalar: symbol, unit (SI), meaning; a parameter also has a default and a required sign."""

    name: str
    unit: str
    about: str = ""
    default: float = 0.0
    sign: str = "any"
    symbol: ca.SX = field(kw_only=True, compare=False, repr=False)

    @property
    def in_c(self) -> str:
        """Return the name of its member in C."""
        return in_c(self.name)

    def check(self, value: float, where: str = "") -> float:
        """Return `value` as a float. Raises ModelError if it is not finite or has the wrong sign."""
        place = f"{where}: " if where else ""
        if not is_number(value):
            raise ModelError(f"{place}{self.name} = {value!r} is not a number")
        try:
            number = float(value)
        except OverflowError as error:
            raise ModelError(
                f"{place}{self.name} = {str(value)[:12]}... is too large for a number"
            ) from error
        if not math.isfinite(number):
            raise ModelError(f"{place}{self.name} = {number} is not finite")
        holds, required = SIGNS[self.sign]
        if not holds(number):
            unit = "" if self.unit == "1" else f" {self.unit}"
            raise ModelError(f"{place}{self.name} = {number:g}{unit} must be {required} ({self.about})")
        return number


def quantity(name: str, unit: str, about: str = "", default: float = 0.0, sign: str = "any") -> Quantity:
    """Return a Quantity with a new symbol. Raises ModelError for a name that is invalid in C or Python,
    or an unknown sign."""
    if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) or is_reserved(name):
        raise ModelError(
            f"name {name!r} cannot be used in C: use letters, digits and _ only, no keyword of C, C++ or "
            "Python, no macro of the standard headers, no name that begins with noslip_; call it "
            f"{similar(str(name))}, for instance"
        )
    for text, label in ((unit, "unit"), (about, "about")):
        if not isinstance(text, str) or not text.isprintable() or "*/" in text:
            raise ModelError(
                f"{name}: {label} {text!r} must be text on one line that is valid in a C comment"
            )
    if sign not in tuple(SIGNS):
        raise ModelError(f"{name}: sign {sign!r} is not one of {', '.join(SIGNS)}")
    new = Quantity(name, unit, about, sign=sign, symbol=ca.SX.sym(name))
    return replace(new, default=new.check(default, f"default of {name}"))


def is_number(value: object) -> bool:
    """Return whether this is a real number of any kind: Python's, NumPy's, a fraction."""
    return isinstance(value, numbers.Real) and not isinstance(value, bool)


def per_second(unit: str) -> str:
    """Return the unit of a rate: m -> m/s -> m/s^2."""
    base, slash, power = unit.partition("/s")
    if not slash or power and not re.fullmatch(r"\^\d+", power):
        return f"{unit}/s"
    return f"{base}/s^{int(power[1:] or 1) + 1}"


# What follows the name, by order
DERIVATIVES = ("", "_rate", "_acceleration", "_jerk", "_snap", "_crackle", "_pop")


def derivative_name(name: str, order: int) -> str:
    """Return the name of a time derivative. Raises ModelError for an order without a name."""
    if order >= len(DERIVATIVES):
        raise ModelError(
            f"{name}: its derivative of order {order} is needed; names exist up to order "
            f"{len(DERIVATIVES) - 1}"
        )
    return name + DERIVATIVES[order]


def derivative_unit(unit: str, order: int) -> str:
    """Return the unit of a time derivative."""
    return unit if order == 0 else derivative_unit(per_second(unit), order - 1)


def scalar(expression: ca.SX | float, where: str) -> ca.SX:
    """Return the expression as a 1 x 1 SX. Raises ModelError if it is not a scalar."""
    value = matrix(expression, where)
    if value.shape != (1, 1):
        raise ModelError(f"{where} must be a scalar; it is {value.shape[0]} x {value.shape[1]}")
    return value


def matrix(expression: ca.SX | float, where: str) -> ca.SX:
    """Return the expression as SX of any shape. Raises ModelError if it is not an expression."""
    try:
        return ca.SX(expression)
    except (NotImplementedError, TypeError, RuntimeError) as error:
        text = " ".join(repr(expression).split())
        raise ModelError(f"{where} is not an expression: {text[:60]}; use numbers and CasADi SX") from error


def refuse_strangers(expression: ca.SX, symbols: ca.SX, where: str, belongs: str) -> None:
    """Raise ModelError if the expression uses a symbol that is not one of `symbols`."""
    elements = {symbol.element_hash() for symbol in ca.symvar(symbols)}
    for symbol in free_symbols(expression):
        if symbol.element_hash() not in elements:
            raise ModelError(f"{where} uses {symbol}, which is not a {belongs}")


def refuse_twice(names: Iterable[str], where: str) -> None:
    """Raise ModelError if a name occurs twice."""
    earlier: set[str] = set()
    for name in names:
        if name in earlier:
            raise ModelError(f"{where}: the name {name!r} is used twice")
        earlier.add(name)


def refuse_unknown(names: Iterable[str], known: Iterable[str], where: str) -> None:
    """Raise ModelError for a name that is not among the known ones."""
    known = list(known)
    for name in names:
        if name not in known:
            raise ModelError(f"{where}: unknown name {name!r}; known are {', '.join(known) or 'none'}")


def values_of(quantities: list[Quantity], given: Mapping[str, float], where: str) -> list[float]:
    """Return the value of each quantity: from `given` if named there, else its default.

    Raises ModelError for an unknown name, and for a value that is not finite or has the wrong sign.
    """
    if not isinstance(given, Mapping):
        raise ModelError(f"{where}: must be names with their values, not {given!r}")
    refuse_unknown(given, sorted(q.name for q in quantities), where)
    return [q.check(given.get(q.name, q.default), where) for q in quantities]


def _before_reduction(
    method: Callable[Concatenate["Mechanism", Arguments], Result],
) -> Callable[Concatenate["Mechanism", Arguments], Result]:
    """Decorate a method that changes a robot's equations: it raises ModelError after these have been
    reduced."""

    @wraps(method)
    def checked(self: "Mechanism", /, *arguments: Arguments.args, **named: Arguments.kwargs) -> Result:
        if self.reduced:
            raise ModelError(
                f"{self.name}: {method.__name__} was called after the robot was reduced, and laws and plants "
                "depend on the result; add everything before, or build a new Mechanism"
            )
        return method(self, *arguments, **named)

    return checked


class Mechanism:
    """Lagrangian, rolling constraints and inputs of one robot.

    n coordinates q, m constraints A(q) qdot = 0, r inputs tau: M(q) qddot + V(q, qdot) = E(q) tau - A(q)'
    lambda  (8).

    `reduced` is true after `reduce` has formed its equations (10). From then on only outputs can be added,
    because robots found by name are shared and what is derived from them is cached.
    """

    def __init__(self, name: str, about: str = ""):
        quantity(name, "")  # checks the name, which becomes C identifiers and file names
        refuse_robot(name)
        self.name = name
        self.about = about
        self.reduced = False
        self.coordinates: list[Quantity] = []
        self.velocities: list[Quantity] = []
        self.parameters: list[Quantity] = []
        self.inputs: list[Quantity] = []
        self.quasi_velocities: list[Quantity] = []
        self.constraint_names: list[str] = []
        self.contacts: list[Contact] = []
        self.supports: list[Contact] = []
        self.givens: list[str] = []
        self.vehicle: Vehicle | None = None
        self.outputs: list[Output] = []
        self.lines: list[ca.SX] = []
        self.bodies: list[Body] = []
        self.inertias: list[tuple[str, str, str]] = []
        self._constraints: list[ca.SX] = []
        self._surfaces: list[ca.SX] = []
        self._ground: dict[str, ca.SX] = {}
        self._known: dict[str, str] = {}
        self._actuation: list[ca.SX] = []
        self._weights: list[ca.SX] = []
        self._preferred: list[ca.SX] = []
        self._forces: list[tuple[ca.SX, ca.SX]] = []
        self._quasi_expressions: list[ca.SX] = []
        self._null_space: ca.SX | None = None
        self._kinetic = ca.SX(0)
        self._potential = ca.SX(0)

    # -- methods for the user --------------------------------------------------------------------------------

    @_before_reduction
    def coordinate(self, name: str, unit: str, about: str = "") -> ca.SX:
        """Add a generalized coordinate and return its symbol."""
        q = self._column(name, unit, about)
        self.velocities.append(self._new(f"{name}_dot", per_second(unit), f"rate of {name}"))
        self.coordinates.append(q)
        self._forget()
        return q.symbol

    @_before_reduction
    def parameter(
        self, name: str, default: float, unit: str, about: str = "", sign: str = "positive"
    ) -> ca.SX:
        """Add a physical parameter (SI) and return its symbol; `sign` is positive, nonnegative or any."""
        self.parameters.append(self._new(name, unit, about, default, sign))
        return self.parameters[-1].symbol

    def rate(self, expression: ca.SX) -> ca.SX:
        """Return the time derivative of an expression in the coordinates, along qdot. Raises ModelError if
        the expression has jumps.
        """
        where = "rate of an expression"
        position = self._smooth(self._at_rest(matrix(expression, f"{self.name}: rate"), where), where)
        return time_derivative(position, self.q, self.qdot) if self.coordinates else ca.SX(*position.shape)

    @_before_reduction
    def kinetic_energy(self, energy: ca.SX) -> None:
        """Add the kinetic energy of a body, J, quadratic in the rates of the coordinates."""
        self._kinetic += self._smooth(self._scalar(energy, "kinetic energy"), "kinetic energy", bends=False)
        self._forget()

    @_before_reduction
    def body(
        self,
        name: str,
        mass: ca.SX,
        inertia: ca.SX,
        forward: ca.SX,
        left: ca.SX,
        yaw_rate: ca.SX,
        height: ca.SX | float = 0.0,
    ) -> None:
        """Add a rigid body in the plane by the velocity (m/s) of its centre of mass along its own axes and
        its yaw rate (rad/s).

        `height` (m) is that of its centre of mass above the ground, which moves load between contacts; 0: not
        known.

        The energy is that of kinetic_energy(mass (forward^2 + left^2) / 2 + inertia yaw_rate^2 / 2). If the
        velocities of each body are written in terms of those of the body before it, the reduced equations are
        formed body by body, at a cost that grows linearly along a chain. `reduce` raises ModelError unless
        the velocities are along axes that turn at the yaw rate.
        """
        quantity(name, "")
        refuse_twice([*(b.name for b in self.bodies), name], f"{self.name}, bodies")
        entries = {
            "mass": mass,
            "inertia": inertia,
            "forward": forward,
            "left": left,
            "yaw_rate": yaw_rate,
            "height": height,
        }
        places = {key: f"body {name!r}, {key}" for key in entries}
        body = Body(
            name,
            **{
                key: self._smooth(self._scalar(x, places[key]), places[key], bends=False)
                for key, x in entries.items()
            },
        )
        if ca.depends_on(ca.vertcat(body.mass, body.inertia, body.height), ca.vertcat(self.q, self.qdot)):
            raise ModelError(
                f"{self.name}: body {name!r}: mass, inertia and height must be parameters or numbers"
            )
        self.bodies.append(body)
        self._forget()

    @_before_reduction
    def potential_energy(self, energy: ca.SX) -> None:
        """Add a potential energy, J, a function of the coordinates."""
        potential = self._at_rest(self._scalar(energy, "potential energy"), "potential energy")
        self._potential += self._smooth(potential, "potential energy")
        self._forget()

    @_before_reduction
    def force(self, force: ca.SX, on: ca.SX) -> None:
        """Add a force (N or N m) with the power force * `on`; `on` is a velocity, linear in the rates.

        For dissipation use force(-k * w, on=w).
        """
        velocity = self._velocity(on, "force's velocity")
        self._forces.append((self._scalar(force, "force"), velocity))
        self._forget()

    @_before_reduction
    def rolls(self, name: str, velocity: ca.SX, surface: ca.SX | float = 0.0) -> None:
        """Add a constraint (2): this velocity, linear in the rates, is zero; or equal to that of the
        `surface` on which something rolls, in coordinates and parameters, at the point of contact and in the
        same direction: a belt, a turntable.

        A drive keeps the surface at its speed, whatever the robot does.
        """
        self._refuse_name(name, "constraint", self.constraint_names)
        where = f"constraint {name!r}, surface"
        self._surfaces.append(self._smooth(self._at_rest(self._scalar(surface, where), where), where))
        self._constraints.append(self._velocity(velocity, f"constraint {name!r}"))
        self.constraint_names.append(name)
        self._forget()

    @_before_reduction
    def ground_moves(self, /, **rates: ca.SX | float) -> None:
        """Let all constraints hold on ground that moves: a robot at rest on it has these `rates` of
        coordinates, by their names, in coordinates and parameters; the others' are zero. Adds A rates to the
        velocities b of the surfaces.

        A belt along x: ground_moves(x=speed); a turntable: ground_moves(x=-Omega * y, y=Omega * x,
        phi=Omega). Constraints may be added before and after. Raises ModelError for a coordinate that is not
        one of the robot's, is moved already, or is given (`time`, `given`).
        """
        refuse_unknown(rates, [c.name for c in self.coordinates], f"{self.name}: ground_moves")
        if given := [name for name in rates if name in self._known]:
            raise ModelError(f"{self.name}: ground_moves: {given[0]} is given; the ground cannot move it")
        if twice := [name for name in rates if name in self._ground]:
            raise ModelError(
                f"{self.name}: ground_moves: {twice[0]} is moved already; add the rates and call it once"
            )
        where = "ground_moves, rate"
        self._ground |= {
            name: self._smooth(self._at_rest(self._scalar(rate, f"{where} of {name}"), where), where)
            for name, rate in rates.items()
        }
        self._forget()

    def time(self, name: str = "t") -> ca.SX:
        """Add the time, s, for what moves as a known function of it;
        return its symbol. It is a coordinate with the rate 1."""
        t = self.coordinate(name, "s", "time")
        self._knows(name, f"{name} is the time", 1.0)
        return t

    def given(self, name: str, unit: str, about: str = "") -> ca.SX:
        """Add a known function of time; return its symbol. Its value and its rate are coordinates, which
        every state contains.

        The law takes both from the state at each step. In a simulation they follow the function of [given] in
        the SPEC; without one the rate stays as it is at the start.
        """
        value = self.coordinate(name, unit, about)
        self.givens.append(name)
        rate = self.coordinate(f"{name}_rate", per_second(unit), f"rate of {name}")
        self._knows(name, f"{name} is given", rate)
        self._knows(f"{name}_rate", f"{name}_rate is given", 0.0)
        return value

    def holds(self, name: str, position: ca.SX) -> None:
        """Add a holonomic constraint (1) C(q) = const; its derivative becomes a row of A."""
        where = f"constraint {name!r}"
        self.rolls(name, self.rate(self._smooth(self._at_rest(self._scalar(position, where), where), where)))

    @_before_reduction
    def input(
        self,
        name: str,
        unit: str,
        on: ca.SX,
        about: str = "",
        weight: ca.SX | float = 1.0,
        preferred: ca.SX | float = 0.0,
        *,
        wanted: ca.SX | float | None = None,
    ) -> None:
        """Add an input (force or torque) with the power input * `on`: a column of E(q).

        With more inputs than n-m, many inputs give the same motion (12). Of these the law chooses those with
        the smallest sum of weight (input - preferred)^2; their difference affects only the constraint forces
        (8). `weight` is a positive number or an expression in parameters; `preferred`, in the unit of the
        input, may also depend on coordinates and rates. `wanted` is the former name of `preferred` and is
        deprecated. Raises ModelError for an invalid weight, and if both names are given.
        """
        new, where = self._column(name, unit, about), f"input {name!r}"
        if wanted is not None:
            if not (isinstance(preferred, int | float) and preferred == 0):
                raise ModelError(
                    f"{self.name}: {where}: give `preferred` or, as in older versions, `wanted`, not both"
                )
            preferred = wanted
        weight, preferred = (
            self._scalar(weight, f"{where}, weight"),
            self._scalar(preferred, f"{where}, preferred"),
        )
        if (
            ca.depends_on(weight, ca.vertcat(self.q, self.qdot))
            or weight.is_constant()
            and not 0 < float(weight) < math.inf
        ):
            raise ModelError(
                f"{self.name}: {where}: weight {weight} must be a positive number or an expression in "
                "parameters"
            )
        if preferred.is_constant() and not math.isfinite(float(preferred)):
            raise ModelError(f"{self.name}: {where}: preferred {preferred} is not finite")
        self._actuation.append(self._velocity(on, where))
        self._weights.append(weight)
        self._preferred.append(preferred)
        self.inputs.append(new)
        self._forget()

    @_before_reduction
    def quasi_velocity(self, name: str, unit: str, expression: ca.SX, about: str = "") -> None:
        """Choose a quasi-velocity nu_i as an expression linear in the rates;
        all of them together determine S(q) (9)."""
        new = self._column(name, unit, about)
        if self._null_space is not None:
            raise ModelError(
                f"{self.name}: quasi-velocity {name!r} after null_space, which defines them all; use one or "
                "the other"
            )
        self._quasi_expressions.append(self._velocity(expression, f"quasi-velocity {name!r}"))
        self.quasi_velocities.append(new)
        self._forget()

    @_before_reduction
    def null_space(self, S: ca.SX, names: Mapping[str, str]) -> None:
        """Set S(q), n x (n-m), directly; `names` maps the name of each quasi-velocity to its unit."""
        if not isinstance(names, Mapping):
            raise ModelError(
                f"{self.name}: null_space requires the names of the quasi-velocities with their units, not "
                f"{names!r}"
            )
        velocities = [self._column(name, unit) for name, unit in names.items()]
        if self.quasi_velocities:
            raise ModelError(
                f"{self.name}: null_space after quasi-velocity {self.quasi_velocities[0].name!r}; use one or "
                "the other, once"
            )
        S = matrix(S, f"{self.name}: S")
        refuse_unsupported(S, f"{self.name}: S")
        self._null_space = self._smooth(self._at_rest(S, "S"), "S")
        self.quasi_velocities = velocities

    @_before_reduction
    def moves_in_plane(self, x: ca.SX, y: ca.SX, heading: ca.SX) -> None:
        """Define the pose of the vehicle, for output Types I to IV: a point (m) and a heading (rad,
        from the x axis)."""
        places = {"x": x, "y": y, "heading": heading}
        for name, place in places.items():
            where = f"the vehicle's {name}"
            places[name] = self._smooth(self._at_rest(self._scalar(place, where), where), where)
        self.vehicle = Vehicle(**places)

    @_before_reduction
    def contact(
        self,
        name: str,
        mass: ca.SX,
        along: ca.SX | None = None,
        across: ca.SX | None = None,
        left: ca.SX | float = 0.0,
        ahead: ca.SX | float = 0.0,
        wheels: Sequence[tuple[ca.SX | float, ca.SX | float]] = (),
    ) -> None:
        """Define a contact with the ground, so that the forces there can be compared with the limit of
        friction.

        `along` and `across` are the velocity (m/s) of the contact point over the ground, forward and to the
        left; the constraints keep them zero by a force (N) in that direction. None means no force in that
        direction. `mass` (kg) rests on the contact; `left` (m) is its position to the left of the vehicle's
        centre line, `ahead` (m) that ahead of any point of it, which is required with `support` and for
        contacts on several lines. No equation of motion depends on this.

        `wheels`: places (ahead, left) of the wheels that the contact stands for, all turned by its
        coordinate, such as those of one side of a robot that steers by skidding. The engine has each of them,
        with an equal part of the mass.
        """
        if along is None and across is None:
            raise ModelError(
                f"{self.name}: contact {name!r} requires a velocity along or across that the constraints "
                "keep zero; use support for one without friction"
            )
        new = self._contact("contact", name, along, across, (mass, left, ahead))
        where = f"contact {name!r}, wheels"
        places = [
            ca.vertcat(*[self._at_rest(self._scalar(part, where), where) for part in place])
            for place in wheels
        ]
        self.contacts.append(replace(new, wheels=tuple(places)))
        self._forget()

    @_before_reduction
    def support(self, name: str, mass: ca.SX, ahead: ca.SX | float, left: ca.SX | float = 0.0) -> None:
        """Define a contact without friction, such as a castor: it carries `mass` (kg) at rest and keeps no
        velocity.

        `ahead` and `left` (m) are its position, from the same point as those of the contacts. A robot with
        supports names all that it stands on, on one frame: accelerating, it moves load forward and back too,
        and a support that would lift is not accepted by the limiter of friction. No equation of motion
        depends on this.
        """
        self.supports.append(self._contact("support", name, None, None, (mass, left, ahead)))
        self._forget()

    def output(
        self, name: str, about: str, rows: Sequence[tuple[Any, ...]], parameters: Sequence[Quantity] = ()
    ) -> None:
        """Add a user-defined output map (14), which becomes a law of this name: n-m rows (name, unit,
        expression, about), or with fewer inputs than n-m as many as inputs.

        An expression may contain coordinates, rates (`rate`), parameters, and the additional `parameters` of
        the map (`noslip.model.config`). Types I to IV are available without this call.
        """
        where = f"{self.name}, output {name!r}"
        quantity(name, "", about)
        refuse_twice([*(o.name for o in self.outputs), name], f"{self.name}, outputs")
        refuse_output(name, [o.name for o in self.outputs], where)
        checked = []
        for k, row in enumerate(rows):
            if not isinstance(row, tuple | list) or len(row) not in (3, 4):
                raise ModelError(f"{where}: row {k + 1} must be (name, unit, expression, about)")
            label, unit, expression, meaning = (*row, "")[:4]
            place = f"output {name!r}, {label}"
            checked.append(
                (quantity(label, unit, meaning), self._smooth(self._scalar(expression, place), place))
            )
        if not all(isinstance(parameter, Quantity) for parameter in parameters):
            raise ModelError(f"{where}: parameters must be created with config(name, default, unit, about)")
        self.outputs.append(Output(name, about, tuple(checked), tuple(parameters)))

    def principal_inertias(self, *inertias: ca.SX) -> None:
        """Declare that three parameters are the principal inertias (kg m^2) of one rigid body, such as (I, J,
        J) of a wheel with I about its axle and J about any diameter. Fits of parameters keep each at most the
        sum of the other two; no equation depends on this. With a geared motor, whose inertia counts by the
        square of the ratio, a wheel is no rigid body.

        Raises ModelError unless they are three parameters, whose defaults are those of a body.
        """
        names = {p.symbol.element_hash(): p for p in self.parameters}
        found = [names.get(symbol.element_hash()) for symbol in map(ca.SX, inertias) if symbol.is_symbolic()]
        known = [p for p in found if p]
        if len(inertias) != 3 or len(known) != 3:
            raise ModelError(
                f"{self.name}: principal_inertias requires three parameters; one may be given twice"
            )
        values = [p.default for p in known]
        if 2 * max(values) > sum(values) * (1 + 1e-9):
            text = ", ".join(f"{p.name} = {p.default:g}" for p in known)
            raise ModelError(
                f"{self.name}: no body has the principal inertias {text} kg m^2: one exceeds the sum of the "
                "others"
            )
        self.inertias.append((known[0].name, known[1].name, known[2].name))

    def draws(self, *lines: Sequence[tuple[ca.SX | float, ca.SX | float]]) -> None:
        """Declare how the robot looks from above: lines through points (x, y), m, in coordinates and
        parameters.

        A line that ends where it begins is the outline of a body, a line of two points is a wheel. Plots show
        `lines`, each (2, points); no equation depends on them. `noslip.model.drawing` has functions for boxes
        and wheels.
        """
        where = f"the points of line {len(self.lines) + 1} of the drawing"
        for line in lines:
            points = [
                ca.vertcat(*[self._at_rest(self._scalar(value, where), where) for value in point])
                for point in line
            ]
            self.lines.append(ca.horzcat(*points))

    # -- derived quantities ----------------------------------------------------------------------------------

    def __getitem__(self, name: str) -> ca.SX:
        """Return the symbol of a coordinate or parameter by name, for robots built on this one. Raises
        ModelError for unknown names.
        """
        for each in (*self.coordinates, *self.parameters):
            if each.name == name:
                return each.symbol
        raise ModelError(f"{self.name}: no coordinate or parameter {name!r}")

    @property
    def required_vehicle(self) -> "Vehicle":
        """Return the pose of the vehicle. Raises ModelError for a robot that does not define it."""
        if self.vehicle is None:
            raise ModelError(
                f"{self.name}: Types I to IV require the pose of the vehicle; call moves_in_plane(x, y, "
                "heading)"
            )
        return self.vehicle

    def coordinate_numbers(self, expressions: Iterable[ca.SX]) -> list[int]:
        """Return which coordinates the expressions are, counted from 0; empty unless each is one."""
        known = {c.symbol.element_hash(): k for k, c in enumerate(self.coordinates)}
        found = [known.get(each.element_hash(), -1) if each.is_symbolic() else -1 for each in expressions]
        return [] if -1 in found else found

    @property
    def q(self) -> ca.SX:
        """Coordinates, n x 1."""
        return ca.vertcat(*[c.symbol for c in self.coordinates])

    @property
    def qdot(self) -> ca.SX:
        """Rates of the coordinates, n x 1."""
        return ca.vertcat(*[v.symbol for v in self.velocities])

    @property
    def p(self) -> ca.SX:
        """Parameters."""
        return ca.vertcat(*[p.symbol for p in self.parameters])

    def parameter_values(self, given: Mapping[str, float], where: str = "parameters") -> list[float]:
        """Return the value of every parameter, with defaults filled in;
        raises ModelError as `values_of` does."""
        return values_of(self.parameters, given, where)

    @cached_property
    def M(self) -> ca.SX:
        """Mass matrix (8), n x n: second derivative of the kinetic energy by the rates."""
        return self._simple(ca.hessian(self._total_kinetic, self.qdot)[0])

    @cached_property
    def V(self) -> ca.SX:
        """Velocity, gravity and other generalized forces (8), n x 1, on the left-hand side."""
        coriolis = self._coriolis(self._total_kinetic)
        applied = ca.SX.zeros(len(self.coordinates))
        for force, velocity in self._forces:
            applied += force * self._rows({"the velocity of a force": velocity}).T
        return self._simple(coriolis + ca.gradient(self._potential, self.q) - applied)

    @cached_property
    def A(self) -> ca.SX:
        """Constraint matrix (2), m x n."""
        return self._rows(
            {
                f"constraint {name!r}": row
                for name, row in zip(self.constraint_names, self._constraints, strict=True)
            }
        )

    @cached_property
    def surface_velocity(self) -> ca.SX:
        """The right-hand side b(q) of A qdot = b, m x 1: zero unless a surface moves."""
        surfaces = ca.vertcat(ca.SX(0, 1), *self._surfaces)
        if self._ground:
            moved = ca.vertcat(*[self._ground.get(c.name, ca.SX(0)) for c in self.coordinates])
            surfaces += ca.substitute(ca.vertcat(ca.SX(0, 1), *self._constraints), self.qdot, moved)
        return ca.sparsify(surfaces)

    @property
    def carried(self) -> bool:
        """Whether a surface moves on which the robot rolls."""
        return self.surface_velocity.nnz() > 0

    @property
    def why_carried(self) -> str:
        """Why nu alone does not say how the robot moves, qdot = S nu + s with s other than zero; empty if it
        does.

        The reason with which all refuse such a robot that take its motion from the velocities of its wheels.
        """
        if not self.carried:
            return ""
        known = set(self._known.values())
        surfaces = zip(self.constraint_names, ca.vertsplit(self.surface_velocity), strict=True)
        moves = any(b.nnz() for name, b in surfaces if name not in known)
        cause = "its ground moves" if moves else f"{next(iter(self._known))} changes with time"
        return f"{cause}: the velocities of its wheels do not say how it moves"

    @cached_property
    def E(self) -> ca.SX:
        """Input matrix (8), n x r."""
        return self._rows(
            {f"input {u.name!r}": row for u, row in zip(self.inputs, self._actuation, strict=True)}
        ).T

    @cached_property
    def contact_rows(self) -> ca.SX:
        """Velocities along and across at each contact in turn, as rows J(q) with velocities = J qdot,
        2 c x n."""
        pairs = {
            f"contact {c.name!r}, {way}": getattr(c, way)
            for c in self.contacts
            for way in ("along", "across")
        }
        return self._rows(pairs) if pairs else ca.SX(0, len(self.coordinates))

    @cached_property
    def quasi_velocity_rows(self) -> ca.SX | None:
        """Gamma(q) with nu = Gamma qdot, (n-m) x n; None if the user defined S or nothing."""
        if not self._quasi_expressions:
            return None
        pairs = zip(self.quasi_velocities, self._quasi_expressions, strict=True)
        return self._rows({f"quasi-velocity {v.name!r}": row for v, row in pairs})

    @property
    def given_null_space(self) -> ca.SX | None:
        """S(q) as given by `null_space`, or None."""
        return self._null_space

    @property
    def standing(self) -> "tuple[Contact, ...]":
        """All that the robot stands on: the contacts, then the supports."""
        return (*self.contacts, *self.supports)

    @property
    def height(self) -> ca.SX:
        """Height of the centre of mass of the bodies whose height is known, m, in parameters;
        0 if there are none."""
        known = [body for body in self.bodies if not body.height.is_zero()]
        mass = sum((body.mass for body in known), ca.SX(0))
        return sum((body.mass * body.height for body in known), ca.SX(0)) / mass if known else ca.SX(0)

    @property
    def places_named(self) -> bool:
        """Whether loads follow from the places of all contacts: there are supports,
        or contacts on more than one line."""
        return bool(self.supports) or any(not contact.ahead.is_zero() for contact in self.contacts)

    @property
    def constraints(self) -> tuple[ca.SX, ...]:
        """The velocities that the constraints keep zero, in order."""
        return tuple(self._constraints)

    @property
    def actuation(self) -> tuple[ca.SX, ...]:
        """The velocity on which each input acts."""
        return tuple(self._actuation)

    @property
    def weights(self) -> ca.SX:
        """The weight of each input, r x 1."""
        return ca.vertcat(*self._weights)

    @property
    def preferred(self) -> ca.SX:
        """The preferred value of each input, r x 1, in coordinates, rates and parameters."""
        return ca.vertcat(*self._preferred)

    @property
    def forces(self) -> tuple[tuple[ca.SX, ca.SX], ...]:
        """Forces other than inputs, each with the velocity on which it acts."""
        return tuple(self._forces)

    @property
    def quasi_expressions(self) -> tuple[ca.SX, ...]:
        """The quasi-velocities as expressions in the rates; empty if the user defined S or nothing."""
        return tuple(self._quasi_expressions)

    @property
    def rest(self) -> tuple[ca.SX, ca.SX]:
        """Mass matrix, n x n, and V, n x 1, of the energies that do not belong to a `body`;
        without forces."""
        M = ca.hessian(self._kinetic, self.qdot)[0]
        return canonical(M), canonical(self._coriolis(self._kinetic) + ca.gradient(self._potential, self.q))

    def energy(self) -> ca.SX:
        """Total energy T + U, J."""
        return self._total_kinetic + self._potential

    def check(self) -> None:
        """Raise ModelError for anything that makes the method inapplicable and that can be seen without
        numerical values."""
        if not self.coordinates:
            raise ModelError(f"{self.name}: no coordinates; add them with coordinate(name, unit)")
        if not self._constraints:
            raise ModelError(
                f"{self.name}: no constraints; add them with rolls(name, velocity) or holds(name, position)"
            )
        if not self.inputs:
            raise ModelError(f"{self.name}: no inputs; add them with input(name, unit, on=velocity)")
        if self.carried and self.bodies:
            raise ModelError(
                f"{self.name}: body(...) does not go with a moving surface yet; use kinetic_energy(...)"
            )
        symbols = ca.vertcat(self.q, self.qdot, self.p)
        for where, expression in self._everything():
            refuse_strangers(
                expression, symbols, f"{self.name}: {where}", "coordinate, rate or parameter of it"
            )
        still = ca.SX.zeros(len(self.coordinates))
        kinetic = self._total_kinetic
        rest = ca.substitute(ca.vertcat(kinetic, ca.gradient(kinetic, self.qdot)), self.qdot, still)
        quadratic = _is_polynomial(kinetic, self.qdot) and ca.jacobian(self.M, self.qdot).is_zero()
        if not quadratic or not self._simple(rest).is_zero():
            raise ModelError(f"{self.name}: the kinetic energy is not quadratic in the rates")
        # Each raises unless linear in the rates
        _ = (self.V, self.A, self.E, self.contact_rows, self.quasi_velocity_rows)

    def declared(self) -> str:
        """Return all that was declared, as text: robots with equal texts are equal."""
        derived = {name for name, value in vars(Mechanism).items() if isinstance(value, cached_property)} | {
            "reduced"
        }
        return "\n".join(
            f"{name} {_described(value)}" for name, value in vars(self).items() if name not in derived
        )

    @property
    def names(self) -> list[str]:
        """All names defined so far."""
        groups = (self.coordinates, self.velocities, self.parameters, self.inputs, self.quasi_velocities)
        return [each.name for group in groups for each in group]

    # -- internal --------------------------------------------------------------------------------------------

    @property
    def _total_kinetic(self) -> ca.SX:
        return sum((body.kinetic_energy for body in self.bodies), start=self._kinetic)

    def _simple(self, matrix: ca.SX) -> ca.SX:
        """Return the matrix simplified; unchanged if there are bodies, because the expanded matrix of a long
        chain is too large.
        """
        return ca.sparsify(matrix) if self.bodies else canonical(matrix)

    def _coriolis(self, kinetic: ca.SX) -> ca.SX:
        """Return the contribution of a kinetic energy to V, n x 1."""
        momentum = ca.gradient(kinetic, self.qdot)
        return time_derivative(momentum, self.q, self.qdot) - ca.gradient(kinetic, self.q)

    def _everything(self) -> list[tuple[str, ca.SX]]:
        named = zip(self.constraint_names, self._constraints, strict=True)
        inputs = zip([i.name for i in self.inputs], self._actuation, strict=True)
        return [
            ("the kinetic energy", self._total_kinetic),
            ("the potential energy", self._potential),
            *[(f"constraint {name!r}", row) for name, row in named],
            ("the velocity of a surface", self.surface_velocity),
            *[(f"input {name!r}", row) for name, row in inputs],
            ("an input's weight", self.weights),
            ("the preferred value of an input", self.preferred),
            *[("a force", ca.vertcat(*pair)) for pair in self._forces],
            *[("a quasi-velocity", row) for row in self._quasi_expressions],
            *[
                (f"contact {c.name!r}", ca.vertcat(c.along, c.across, c.mass, c.left, c.ahead, *c.wheels))
                for c in self.standing
            ],
            *[(f"body {body.name!r}, height", body.height) for body in self.bodies],
            *([("S", self._null_space)] if self._null_space is not None else []),
            *[("a line of the drawing", line) for line in self.lines],
            *([("the vehicle's pose", ca.vertcat(*vars(self.vehicle).values()))] if self.vehicle else []),
        ]

    def _rows(self, velocities: Mapping[str, ca.SX]) -> ca.SX:
        """Return the matrix R(q) with velocities = R qdot. Raises ModelError if one is not linear in the
        rates."""
        stacked = ca.vertcat(*velocities.values())
        rows = self._simple(ca.jacobian(stacked, self.qdot))
        rest = self._simple(ca.substitute(stacked, self.qdot, ca.SX.zeros(len(self.coordinates))))
        for k, where in enumerate(velocities):
            linear = _is_polynomial(stacked[k], self.qdot) and not ca.depends_on(rows[k, :], self.qdot)
            if not linear or not rest[k].is_zero():
                raise ModelError(f"{self.name}: {where} is not linear in the coordinates' rates")
        return rows

    def _contact(
        self,
        kind: str,
        name: str,
        along: ca.SX | None,
        across: ca.SX | None,
        entries: tuple[ca.SX | float, ...],
    ) -> "Contact":
        """Return a contact or support, checked; `entries` are mass, left and ahead."""
        self._refuse_name(name, kind, [c.name for c in self.standing])
        where = f"{kind} {name!r}"
        first, second = [
            ca.SX(0) if v is None else self._velocity(v, f"{where}, velocity") for v in (along, across)
        ]
        places = [f"{where}, {entry}" for entry in ("mass", "left", "ahead")]
        m, left, ahead = [
            self._at_rest(self._scalar(value, at), at) for at, value in zip(places, entries, strict=True)
        ]
        return Contact(name, first, second, m, left, ahead)

    def _knows(self, coordinate: str, constraint: str, rate: ca.SX | float) -> None:
        """Add a constraint by which a coordinate has a known rate, whatever the robot and its ground do."""
        self.rolls(constraint, self.rate(self[coordinate]), surface=rate)
        self._known[coordinate] = constraint

    def _new(
        self, name: str, unit: str, about: str = "", default: float = 0.0, sign: str = "any"
    ) -> Quantity:
        new = quantity(name, unit, about, default, sign)
        refuse_twice([*dict.fromkeys(self.names), name], self.name)
        return new

    def _refuse_name(self, name: str, kind: str, others: Sequence[str]) -> None:
        """Raise ModelError for a name of this kind that is no text on one line, or is used already."""
        if not isinstance(name, str) or not name.strip() or not name.isprintable():
            raise ModelError(f"{self.name}: a {kind}'s name must be text on one line, got {name!r}")
        refuse_twice([*others, name], f"{self.name}, {kind}s")

    def _column(self, name: str, unit: str, about: str = "") -> Quantity:
        """Return a new quantity that is a column of the tables of runs."""
        new = self._new(name, unit, about)
        refuse_column(name)
        return new

    def _forget(self) -> None:
        """Discard the cached matrices, after an addition that changes them."""
        for matrix in ("M", "V", "A", "E", "surface_velocity", "contact_rows", "quasi_velocity_rows"):
            self.__dict__.pop(matrix, None)

    def _scalar(self, expression: ca.SX | float, where: str) -> ca.SX:
        value = scalar(expression, f"{self.name}: {where}")
        refuse_unsupported(value, f"{self.name}: {where}")
        return value

    def _velocity(self, expression: ca.SX, where: str) -> ca.SX:
        """Return a scalar that must be linear in the rates; `_rows` checks that it is."""
        return self._smooth(self._scalar(expression, where), where, bends=False)

    def _smooth(self, expression: ca.SX, where: str, bends: bool = True) -> ca.SX:
        """Return an expression that will be differentiated. Raises ModelError for jumps, and for corners in
        the rates unless `bends`.
        """
        refuse_jumps(expression, ca.vertcat(self.q, self.qdot), f"{self.name}: {where}")
        bent = [] if bends else kinks(expression, self.qdot)
        if bent:
            raise ModelError(
                f"{self.name}: {where} uses {bent[0]} of a rate; it must be a polynomial in the rates"
            )
        return expression

    def _at_rest(self, expression: ca.SX, where: str) -> ca.SX:
        """Return the expression. Raises ModelError if it uses rates."""
        if ca.depends_on(expression, self.qdot) if self.coordinates else False:
            raise ModelError(
                f"{self.name}: {where} uses rates of coordinates; it must be a function of coordinates and "
                "parameters"
            )
        return expression


def _described(value: object) -> str:
    """Return a text that is equal for equal values, expressions and dataclasses included."""
    if isinstance(value, ca.SX):
        return as_text(value)
    if isinstance(value, dict):
        return _described(list(value.items()))
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_described, value))}]"
    if is_dataclass(value):
        return f"{type(value).__name__}{_described([getattr(value, part.name) for part in fields(value)])}"
    return repr(value)


def _is_polynomial(expression: ca.SX, variables: ca.SX) -> bool:
    """Return whether the scalar is a polynomial in the variables, as written or simplified."""
    return degree(expression, variables) < math.inf or degree(canonical(expression), variables) < math.inf


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body in the plane: mass (kg), inertia about its centre of mass (kg m^2), velocities along its
    own axes, height of its centre of mass (m; 0: not known)."""

    name: str
    mass: ca.SX
    inertia: ca.SX
    forward: ca.SX
    left: ca.SX
    yaw_rate: ca.SX
    height: ca.SX

    @property
    def kinetic_energy(self) -> ca.SX:
        """In J."""
        return self.mass * (self.forward**2 + self.left**2) / 2 + self.inertia * self.yaw_rate**2 / 2


@dataclass(frozen=True)
class Vehicle:
    """A body in the plane: point (x, y) in m and heading in rad, as expressions in the coordinates."""

    x: ca.SX
    y: ca.SX
    heading: ca.SX


@dataclass(frozen=True)
class Contact:
    """A contact with the ground: its velocity along and across (m/s, forward and left), both zero in rolling.

    `mass` (kg) rests on it, `left` and `ahead` (m) are its position to the left of the vehicle's centre line
    and along it. A support has no velocities. `wheels`: places (ahead, left) of those for which the contact
    stands; empty for one wheel.
    """

    name: str
    along: ca.SX
    across: ca.SX
    mass: ca.SX
    left: ca.SX
    ahead: ca.SX
    wheels: tuple[ca.SX, ...] = ()


@dataclass(frozen=True, eq=False)
class Output:
    """A user-defined output map: rows as (name with unit and meaning,
    expression in coordinates and rates)."""

    name: str
    about: str
    rows: tuple[tuple[Quantity, ca.SX], ...]
    parameters: tuple[Quantity, ...] = ()
