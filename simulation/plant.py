"""The plant: dynamics (10), (11) of a mechanism with its own parameters."""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from ..model.algebra.direct import Direct
from ..model.algebra.linear import solve
from ..model.algebra.portable import portable
from ..model.contacts import combination, narrow, shift_by_forces
from ..model.mechanism import Mechanism
from ..model.reduction import ReducedSystem
from . import runge_kutta
from .specification.given import Given, accelerations


class Plant:
    """A robot with its true parameters (SI, in the order of mechanism.parameters). State x = [q; nu] (11).

    `given`: expressions in t of the coordinates that are known functions of time; the rates of the others
    stay as they are.
    """

    def __init__(self, system: ReducedSystem, parameters: Sequence[float], given: Given = ()):
        self.system = system
        self.parameters = np.array(parameters, float)
        self.given = given
        self._functions = functions(system, given)
        self._rate, self._step = Direct(self._functions["rate"]), Direct(self._functions["step"])

    def time(self, t: float) -> tuple[float, ...]:
        """Return the last arguments of functions of motion at t, s: none unless something is given."""
        return (t,) if self.given else ()

    @cached_property
    def height(self) -> float:
        """Height of the centre of mass, m; 0 if the robot does not say it,
        or contacts on one line cannot carry its moment."""
        return float(self._standing[0])

    @cached_property
    def part(self) -> float:
        """The part of the weight that rests on the contacts by the robot's own masses;
        1 on a slope of its own."""
        return float(self._standing[1])

    @cached_property
    def _standing(self) -> np.ndarray:
        return standing(self.system.mechanism)(self.parameters).full().ravel()

    def rate(self, x: np.ndarray, tau: np.ndarray, t: float = 0.0) -> np.ndarray:
        """xdot = [S nu + s; (S'MS)^-1 (S'E tau - S'(M Sdot nu + V))] (11), at t (s)."""
        return self._rate(x, tau, self.parameters, *self.time(t))[0]

    def step(
        self, x: np.ndarray, tau: np.ndarray, h: float, tolerance: float, t: float = 0.0
    ) -> tuple[np.ndarray, float]:
        """Return the state after h seconds of constant tau from t (s) by one DOP853 step, and its error norm:
        1 is the tolerance.
        """
        after, error = self._step(x, tau, self.parameters, h, tolerance, *self.time(t))
        return after, float(error[0])

    def energy(self, x: np.ndarray) -> np.ndarray:
        """Total energy T + U, J, of each row of x."""
        return self._rows("energy", x)[:, 0]

    def power(self, x: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return the power of inputs, forces (friction, not weight) and the drives of moving surfaces, W, for
        each row of x and tau: the rate of the energy.
        """
        return self._rows("power", x, tau)[:, 0]

    def ground_power(self, x: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return the power of the drives of moving surfaces alone, -lambda' b, W,
        for each row of x and tau."""
        return self._rows("ground_power", x, tau)[:, 0]

    def pushed(self, x: np.ndarray, impulse: np.ndarray) -> np.ndarray:
        """Return the state after an impulse (n-m) along the quasi-velocities, N s or N m s."""
        after = x.copy()
        after[-self.system.dof :] += self._rows("jump", x, impulse)[0]
        return after

    def slip(self, x: np.ndarray) -> np.ndarray:
        """Return A qdot - b, the residual of the constraints (2), for each row of x;
        b is zero unless surfaces move."""
        return self._rows("slip", x)

    def constraint_forces(self, x: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return lambda of (8), with the paper's sign, for each row of x and tau."""
        return self._rows("forces", x, tau)

    def contacts(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return for each row of x: C, (N, 2 c, m), as in `combination`; mass (kg) on each contact and its
        position left (m), (N, c). Supports are contacts too, the last ones.
        """
        m, count = len(self.system.mechanism.constraint_names), len(self.system.mechanism.standing)
        rows = np.split(self._rows("contacts", x), [2 * count * m, 2 * count * m + count], axis=1)
        return rows[0].reshape(-1, m, 2 * count).swapaxes(1, 2), rows[1], rows[2]

    def shift(self, x: np.ndarray) -> np.ndarray:
        """Return for each row of x: K, (N, c, 2 c), as in `shift_by_forces`."""
        count = len(self.system.mechanism.standing)
        return self._rows("shift", x).reshape(-1, 2 * count, count).swapaxes(1, 2)

    def _rows(self, name: str, *rows: np.ndarray) -> np.ndarray:
        return self._functions[name](*[np.atleast_2d(r).T for r in rows], self.parameters).full().T


@lru_cache(maxsize=16)
def standing(mechanism: Mechanism) -> ca.Function:
    """Return the function of the parameters to `Plant.height` and `Plant.part`."""
    height = ca.SX(0) if mechanism.height.is_zero() or narrow(mechanism) else mechanism.height
    places = [k for k, q in enumerate(mechanism.coordinates) if q.unit == "m"]
    # Depends on q for wheels that roll along
    along = mechanism.rest[0][places[0], places[0]] if places else ca.SX(0)
    mass = sum(
        (body.mass for body in mechanism.bodies), ca.SX(0) if ca.depends_on(along, mechanism.q) else along
    )
    resting = ca.substitute(mechanism.energy(), mechanism.qdot, ca.SX.zeros(len(mechanism.coordinates)))
    level = not any(ca.which_depends(resting, mechanism.q, 1, False))
    known = mechanism.contacts and level and not mass.is_zero()
    part = sum((contact.mass for contact in mechanism.contacts), ca.SX(0)) / mass if known else ca.SX(1)
    return portable(ca.Function("standing", [mechanism.p], [ca.densify(ca.vertcat(height, part))]))


@lru_cache(maxsize=16)
def functions(system: ReducedSystem, given: Given = ()) -> dict[str, ca.Function]:
    """Return what the methods of Plant evaluate, by name; arguments are columns, in the order of the method,
    then parameters.

    Those of motion, `rate` and `step`, have the time as the last argument if something is given.
    """
    mechanism = system.mechanism
    x, p = ca.vertcat(mechanism.q, system.nu), mechanism.p
    tau = ca.SX.sym("tau", len(mechanism.inputs))
    acceleration = system.acceleration(tau)
    rate, step = motion(system, acceleration, [tau, p], given)
    impulse = ca.SX.sym("impulse", system.dof)

    def forces() -> ca.SX:
        return system.constraint_forces(tau, acceleration)

    def ground_power() -> ca.SX:
        return -ca.dot(forces(), mechanism.surface_velocity)

    def power() -> ca.SX:
        of_forces = sum((force * velocity for force, velocity in mechanism.forces), ca.SX(0))
        whole = ca.dot(tau, mechanism.E.T @ mechanism.qdot) + of_forces
        return ca.substitute(whole, mechanism.qdot, system.qdot) + ground_power()

    def contacts() -> ca.SX:
        places = ca.vertcat(*[c.mass for c in mechanism.standing], *[c.left for c in mechanism.standing])
        return ca.vertcat(ca.vec(combination(mechanism)), places)

    others: dict[str, tuple[list[ca.SX], Callable[[], ca.SX]]] = {
        "energy": ([x, p], lambda: ca.substitute(mechanism.energy(), mechanism.qdot, system.qdot)),
        "power": ([x, tau, p], power),
        "ground_power": ([x, tau, p], ground_power),
        "jump": ([x, impulse, p], lambda: solve(system.Mbar, impulse)),
        "slip": ([x, p], lambda: mechanism.A @ system.qdot - mechanism.surface_velocity),
        "contacts": ([x, p], contacts),
        "shift": ([x, p], lambda: ca.vec(ca.densify(shift_by_forces(mechanism)))),
        "forces": ([x, tau, p], forces),
    }
    return _WhenAsked({"rate": rate, "step": step}, others)


class _WhenAsked(dict[str, ca.Function]):
    """Functions by name; of the `others`, arguments and what makes the result, each is made when it is asked
    for."""

    def __init__(
        self,
        made: Mapping[str, ca.Function],
        others: Mapping[str, tuple[list[ca.SX], Callable[[], ca.SX]]],
    ):
        super().__init__(made)
        self._others = others

    def __missing__(self, name: str) -> ca.Function:
        arguments, result = self._others[name]
        self[name] = portable(ca.Function(name, arguments, [ca.densify(result())]))
        return self[name]


def motion(
    system: ReducedSystem, nudot: ca.SX, given: list[ca.SX], known: Given
) -> tuple[ca.Function, ca.Function]:
    """Return the functions from the state, what is `given` with it and, if something is a known function of
    time, t (s): to the rate of the state, and to the state after h seconds and its error norm (with h and
    tolerance before t).
    """
    x, t, h, tolerance = (
        ca.vertcat(system.mechanism.q, system.nu),
        *(ca.SX.sym(name) for name in ("t", "h", "tolerance")),
    )
    time = [t] if known else []
    qdot = system.qdot + accelerations(system.mechanism, known, t) if known else system.qdot
    rate = portable(ca.Function("rate", [x, *given, *time], [ca.densify(ca.vertcat(qdot, nudot))]))
    after, error, _ = runge_kutta.step(
        lambda at, x: rate(x, *given, *([at] if known else [])), t, x, rate(x, *given, *time), h, tolerance
    )
    ends = [ca.densify(after), ca.densify(error)]
    return rate, ca.Function("step", [x, *given, h, tolerance, *time], ends)
