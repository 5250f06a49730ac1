"""A mechanical system with rolling constraints, written down once: paper equations (2) and (8).

The user names coordinates and parameters, adds the energy of each body, states which velocities vanish where
something rolls, and says where the inputs act. M, V, A and E follow by CasADi's differentiation.
"""

import keyword
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca

from .errors import ModelError
from .exact import canonical
from .expression import free_symbols, time_derivative

SIGNS = {
    "positive": (lambda value: value > 0.0, "positive"),
    "nonnegative": (lambda value: value >= 0.0, "zero or positive"),
    "any": (lambda value: True, "any number"),
}


@dataclass(frozen=True)
class Quantity:
    """A named scalar: symbol, unit (SI), meaning; a parameter also has a default and a sign it must keep."""

    name: str
    unit: str
    about: str = ""
    default: float = 0.0
    sign: str = "any"
    symbol: ca.SX = field(default=None, compare=False, repr=False)

    def check(self, value: float, where: str = "") -> float:
        """Answer `value` as a float. Raises ModelError when it is not finite or has the wrong sign."""
        place = f"{where}: " if where else ""
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ModelError(f"{place}{self.name} = {value!r} is not a number")
        if not math.isfinite(value):
            raise ModelError(f"{place}{self.name} = {value} is not finite")
        holds, wanted = SIGNS[self.sign]
        if not holds(value):
            raise ModelError(f"{place}{self.name} = {value:g} {self.unit} must be {wanted} ({self.about})")
        return float(value)


def quantity(name: str, unit: str, about: str = "", default: float = 0.0, sign: str = "any") -> Quantity:
    """A Quantity with a fresh symbol. Raises ModelError for a name that C or Python cannot take, or an unknown sign."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) or keyword.iskeyword(name) or name in C_KEYWORDS:
        raise ModelError(f"name {name!r} cannot be used in C: letters, digits and _ only, no keyword")
    if sign not in SIGNS:
        raise ModelError(f"{name}: sign {sign!r} is not one of {', '.join(SIGNS)}")
    made = Quantity(name, unit, about, default, sign, ca.SX.sym(name))
    made.check(default, f"default of {name}")
    return made


def per_second(unit: str) -> str:
    """The unit of a rate: m -> m/s -> m/s^2."""
    base, slash, power = unit.partition("/s")
    if not slash or power and not re.fullmatch(r"\^\d+", power):
        return f"{unit}/s"
    return f"{base}/s^{int(power[1:] or 1) + 1}"


C_KEYWORDS = frozenset(
    "auto break case char const continue default do double else enum extern float for goto if inline int long register "
    "restrict return short signed sizeof static struct switch typedef union unsigned void volatile while".split()
)


def values_of(quantities: list[Quantity], given: Mapping[str, float], where: str) -> list[float]:
    """The value of each quantity: `given` where named, else its default.

    Raises ModelError for a name that is not among the quantities, a value that is not finite or has the wrong sign.
    """
    known = {q.name for q in quantities}
    for name in given:
        if name not in known:
            raise ModelError(f"{where}: unknown name {name!r}; known are {', '.join(sorted(known)) or 'none'}")
    return [q.check(given.get(q.name, q.default), where) for q in quantities]


class Mechanism:
    """Lagrangian, rolling constraints and inputs of one robot.

    n coordinates q, m constraints A(q) qdot = 0, r inputs tau: M(q) qddot + V(q, qdot) = E(q) tau - A(q)' lambda  (8).
    """

    def __init__(self, name: str, about: str = ""):
        quantity(name, "")  # the name becomes C identifiers and file names
        self.name = name
        self.about = about
        self.coordinates: list[Quantity] = []
        self.velocities: list[Quantity] = []
        self.parameters: list[Quantity] = []
        self.inputs: list[Quantity] = []
        self.quasi_velocities: list[Quantity] = []
        self.constraint_names: list[str] = []
        self.vehicle: Vehicle | None = None
        self._constraints: list[ca.SX] = []
        self._actuation: list[ca.SX] = []
        self._forces: list[tuple[ca.SX, ca.SX]] = []
        self._quasi_expressions: list[ca.SX] = []
        self._null_space: ca.SX | None = None
        self._kinetic = ca.SX(0)
        self._potential = ca.SX(0)

    # -- what the user writes -----------------------------------------------------------------------------------

    def coordinate(self, name: str, unit: str, about: str = "") -> ca.SX:
        """Add a generalized coordinate and answer its symbol."""
        self._new_name(name)
        q = quantity(name, unit, about)
        self.coordinates.append(q)
        self.velocities.append(quantity(f"{name}_dot", per_second(unit), f"rate of {name}"))
        return q.symbol

    def parameter(self, name: str, default: float, unit: str, about: str = "", sign: str = "positive") -> ca.SX:
        """Add a physical parameter (SI) and answer its symbol; `sign` is positive, nonnegative or any."""
        self._new_name(name)
        self.parameters.append(quantity(name, unit, about, default, sign))
        return self.parameters[-1].symbol

    def rate(self, expression: ca.SX) -> ca.SX:
        """Time derivative of an expression in the coordinates, along qdot."""
        return time_derivative(self._scalar_or_matrix(expression, "rate"), self.q, self.qdot)

    def kinetic_energy(self, energy: ca.SX) -> None:
        """Add the kinetic energy of a body, J, quadratic in the coordinates' rates."""
        self._kinetic += self._scalar(energy, "kinetic energy")

    def potential_energy(self, energy: ca.SX) -> None:
        """Add a potential energy, J, a function of the coordinates."""
        self._potential += self._scalar(energy, "potential energy")

    def force(self, force: ca.SX, on: ca.SX) -> None:
        """Add a force (N or N m) that does the power force * `on`; `on` is a velocity, linear in the rates.

        Dissipation is force(-k * w, on=w).
        """
        self._forces.append((self._scalar(force, "force"), self._scalar(on, "force's velocity")))

    def rolls(self, name: str, velocity: ca.SX) -> None:
        """Add a constraint (2): this velocity, linear in the rates, stays zero."""
        self.constraint_names.append(name)
        self._constraints.append(self._scalar(velocity, f"constraint {name!r}"))

    def holds(self, name: str, position: ca.SX) -> None:
        """Add a holonomic constraint (1) C(q) = const; its derivative becomes a row of A."""
        self.rolls(name, self.rate(self._scalar(position, f"constraint {name!r}")))

    def input(self, name: str, unit: str, on: ca.SX, about: str = "") -> None:
        """Add an input (force or torque) that does the power input * `on`: a column of E(q)."""
        self._new_name(name)
        self.inputs.append(quantity(name, unit, about))
        self._actuation.append(self._scalar(on, f"input {name!r}"))

    def quasi_velocity(self, name: str, unit: str, expression: ca.SX, about: str = "") -> None:
        """Choose a quasi-velocity nu_i as an expression linear in the rates; S(q) follows from all of them (9)."""
        self._new_name(name)
        self.quasi_velocities.append(quantity(name, unit, about))
        self._quasi_expressions.append(self._scalar(expression, f"quasi-velocity {name!r}"))

    def null_space(self, S: ca.SX, names: Mapping[str, str]) -> None:
        """Give S(q), n x (n-m), outright; `names` maps each quasi-velocity's name to its unit."""
        for name, unit in names.items():
            self._new_name(name)
            self.quasi_velocities.append(quantity(name, unit))
        self._null_space = ca.SX(S)

    def moves_in_plane(self, x: ca.SX, y: ca.SX, heading: ca.SX) -> None:
        """Say where the vehicle is, for output Types I to IV: a point (m) and a heading (rad, from the x axis)."""
        self.vehicle = Vehicle(ca.SX(x), ca.SX(y), ca.SX(heading))

    # -- what follows -------------------------------------------------------------------------------------------

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
        """Value of every parameter, defaults filled in; raises ModelError as `values_of` does."""
        return values_of(self.parameters, given, where)

    @cached_property
    def M(self) -> ca.SX:
        """Mass matrix (8), n x n: second derivative of the kinetic energy by the rates."""
        return canonical(ca.hessian(self._kinetic, self.qdot)[0])

    @cached_property
    def V(self) -> ca.SX:
        """Velocity, gravity and other generalized forces (8), n x 1, on the left-hand side."""
        momentum = ca.gradient(self._kinetic, self.qdot)
        coriolis = time_derivative(momentum, self.q, self.qdot) - ca.gradient(self._kinetic, self.q)
        applied = ca.SX.zeros(len(self.coordinates))
        for force, velocity in self._forces:
            applied += force * ca.gradient(velocity, self.qdot)
        return canonical(coriolis + ca.gradient(self._potential, self.q) - applied)

    @cached_property
    def A(self) -> ca.SX:
        """Constraint matrix (2), m x n."""
        return self._rows(self._constraints)

    @cached_property
    def E(self) -> ca.SX:
        """Input matrix (8), n x r."""
        return self._rows(self._actuation).T

    @cached_property
    def quasi_velocity_rows(self) -> ca.SX | None:
        """Gamma(q) with nu = Gamma qdot, (n-m) x n; None when the user gave S or nothing."""
        return self._rows(self._quasi_expressions) if self._quasi_expressions else None

    @property
    def given_null_space(self) -> ca.SX | None:
        """S(q) as given by `null_space`, or None."""
        return self._null_space

    def energy(self) -> ca.SX:
        """Total energy T + U, J."""
        return self._kinetic + self._potential

    def check(self) -> None:
        """Raise ModelError for anything the method cannot take that shows without numbers."""
        if not self.coordinates:
            raise ModelError(f"{self.name}: no coordinates; add them with coordinate(name, unit)")
        if not self._constraints:
            raise ModelError(f"{self.name}: no constraints; add them with rolls(name, velocity) or holds(name, position)")
        m, n = len(self._constraints), len(self.coordinates)
        if m >= n:
            raise ModelError(f"{self.name}: {m} constraints leave no motion in {n} coordinates")
        if not self.inputs:
            raise ModelError(f"{self.name}: no inputs; add them with input(name, unit, on=velocity)")
        known = set(self._symbols())
        for where, expression in self._everything():
            for symbol in free_symbols(expression):
                if symbol.__hash__() not in known:
                    raise ModelError(f"{self.name}: {where} uses {symbol}, which is no coordinate, rate or parameter of it")
        if not ca.jacobian(self.M, self.qdot).is_zero():
            raise ModelError(f"{self.name}: the kinetic energy is not quadratic in the rates")

    # -- inside -------------------------------------------------------------------------------------------------

    def _symbols(self) -> list[int]:
        return [s.symbol.__hash__() for s in (*self.coordinates, *self.velocities, *self.parameters)]

    def _everything(self) -> list[tuple[str, ca.SX]]:
        named = zip(self.constraint_names, self._constraints, strict=True)
        inputs = zip([i.name for i in self.inputs], self._actuation, strict=True)
        return [
            ("the kinetic energy", self._kinetic),
            ("the potential energy", self._potential),
            *[(f"constraint {name!r}", row) for name, row in named],
            *[(f"input {name!r}", row) for name, row in inputs],
            *[("a force", ca.vertcat(*pair)) for pair in self._forces],
            *[("a quasi-velocity", row) for row in self._quasi_expressions],
        ]

    def _rows(self, velocities: list[ca.SX]) -> ca.SX:
        """The matrix R(q) with velocities = R qdot. Raises ModelError when one is not linear in the rates."""
        stacked = ca.vertcat(*velocities)
        rows = canonical(ca.jacobian(stacked, self.qdot))
        rest = ca.substitute(stacked, self.qdot, ca.SX.zeros(len(self.coordinates)))
        if not ca.jacobian(rows, self.qdot).is_zero() or not canonical(rest).is_zero():
            raise ModelError(f"{self.name}: a constraint, input or quasi-velocity is not linear in the coordinates' rates")
        return rows

    def _new_name(self, name: str) -> None:
        taken = (*self.coordinates, *self.velocities, *self.parameters, *self.inputs, *self.quasi_velocities)
        if name in {known.name for known in taken}:
            raise ModelError(f"{self.name}: the name {name!r} is used twice")

    def _scalar_or_matrix(self, expression: ca.SX, where: str) -> ca.SX:
        try:
            return ca.SX(expression)
        except (NotImplementedError, TypeError) as error:
            raise ModelError(f"{self.name}: {where} is no expression: {expression!r}") from error

    def _scalar(self, expression: ca.SX, where: str) -> ca.SX:
        made = self._scalar_or_matrix(expression, where)
        if made.shape != (1, 1):
            raise ModelError(f"{self.name}: {where} must be a scalar, it is {made.shape[0]} x {made.shape[1]}")
        return made


@dataclass(frozen=True)
class Vehicle:
    """A body in the plane: point (x, y) in m and heading in rad, as expressions in the coordinates."""

    x: ca.SX
    y: ca.SX
    heading: ca.SX
