"""Random parameters, states and references, from a seed, at which a law is evaluated."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from ..controllers.backends import make_controller
from ..controllers.controller import Evaluation, ParameterRefused
from ..model.algebra.samples import smallest_eigenvalue
from ..model.law import ControlLaw, symbols
from ..model.mechanism import Quantity
from ..model.reduction import ReducedSystem
from ..readers.errors import BadInput

STATES_PER_PLANT = 20  # states that share parameters, config and gains
REGULAR = 1e-2  # |det Phi| is above this times the product of Phi's row norms
LARGEST = 5.0  # a row of S may have at most this times its median size: beyond lies a pole, as at a wheel steered across
TYPICAL = 99  # number of states for the median
HEAVY = 1e-4  # smallest eigenvalue of S'MS scaled to a diagonal of ones
DRAWS = 100  # random states per state needed, before giving up
NEWTON_STEPS = 8  # to move a point onto a path


@dataclass(frozen=True, eq=False)
class RandomPlant:
    """Parameters, config and gains in the order of the law's groups, and the points to evaluate with them."""

    params: tuple[float, ...]
    config: tuple[float, ...]
    gains: tuple[float, ...]
    points: "tuple[RandomPoint, ...]"


@dataclass(frozen=True, eq=False)
class RandomPoint:
    """A state, a reference, and CasADi's result. `number` counts the states of a law from 0."""

    number: int
    state: np.ndarray
    reference: np.ndarray
    truth: Evaluation


@dataclass(frozen=True, eq=False)
class Motion:
    """Parameters, a state [q; nu] and inputs tau, SI."""

    params: tuple[float, ...]
    state: np.ndarray
    tau: np.ndarray


def random_plants(law: ControlLaw, states: int, seed: int) -> Iterator[RandomPlant]:
    """Yield plants with `states` regular points in total. Raises BadInput if hardly any state is regular."""
    random = np.random.default_rng(seed)
    found = drawn = 0
    while found < states:
        if drawn > DRAWS * states:
            raise BadInput(
                f"{law.name}: hardly any random state is regular: {found} of {drawn}; is the output singular everywhere?"
            )
        params, config, gains = (_values(group, random) for group in (law.parameters, law.config, law.gains))
        drawn += STATES_PER_PLANT
        try:
            controller = make_controller("casadi", law, params, config, gains)
        except ParameterRefused:
            continue
        largest = _largest_rates(law.system, params)
        points: list[RandomPoint] = []
        for _ in range(min(STATES_PER_PLANT, states - found)):
            state, reference = _state(law, config, random), random.uniform(-2, 2, len(law.reference))
            truth = controller.evaluate(state, reference)
            if truth.status == "ok" and _regular(truth.values["Phi"]) and np.all(_rates(truth.values["S"]) <= largest):
                points.append(RandomPoint(found + len(points), state, reference, truth))
        found += len(points)
        yield RandomPlant(params, config, gains, tuple(points))


def random_motions(system: ReducedSystem, count: int, seed: int) -> Iterator[Motion]:
    """Yield motions of a robot where S and S'MS are regular. Raises BadInput if hardly any random state is."""
    random = np.random.default_rng(seed)
    found, n = 0, len(system.mechanism.coordinates)
    for drawn in range(DRAWS * count):
        if drawn % STATES_PER_PLANT == 0:
            params = _values(system.mechanism.parameters, random)
            largest = _largest_rates(system, params)
        state, tau = _uniform(system, system.state, random), random.uniform(-5, 5, len(system.mechanism.inputs))
        S, mass = _null_space(system)(state[:n], params).full(), _mass(system)(state[:n], params).full()
        finite = np.isfinite(S).all() and np.isfinite(mass).all()
        if finite and np.all(_rates(S) <= largest) and smallest_eigenvalue(mass) > HEAVY:
            found += 1
            yield Motion(params, state, tau)
        if found == count:
            return
    raise BadInput(f"{system.mechanism.name}: the mass matrix S'MS is regular at hardly any random state: {found} of {drawn + 1}")


def _values(quantities: Sequence[Quantity], random: np.random.Generator) -> tuple[float, ...]:
    """Return values between half and twice the default, with either sign if allowed; up to 1 if the default is zero."""
    values = []
    for quantity in quantities:
        size = quantity.default * random.uniform(0.5, 2) if quantity.default else random.uniform(0, 1)
        values.append(float(size * random.choice((-1, 1)) if quantity.sign == "any" else size))
    return tuple(values)


def _state(law: ControlLaw, config: Sequence[float], random: np.random.Generator) -> np.ndarray:
    """Return positions within 5 m, near the path if there is one; heading within pi, other angles 20, angular rates 15."""
    state = _uniform(law.system, law.state, random)
    place = _vehicle_place(law)
    if law.output.path and place:
        state[place] = np.asarray(_onto_path(law)(state[place], config)).ravel() + random.uniform(-1, 1, 2)
    return state


def _uniform(system: ReducedSystem, quantities: Sequence[Quantity], random: np.random.Generator) -> np.ndarray:
    return np.array([random.uniform(-1, 1) * _range(system, quantity) for quantity in quantities])


def _largest_rates(system: ReducedSystem, params: Sequence[float]) -> np.ndarray:
    """Return the largest norm allowed for each row of S, (n,), from the median over a fixed set of coordinates."""
    ranges = [_range(system, quantity) for quantity in system.mechanism.coordinates]
    some = np.random.default_rng(0).uniform(-1, 1, (TYPICAL, len(ranges))) * ranges
    each = np.hsplit(_null_space(system)(some.T, params).full(), TYPICAL)
    typical = np.median([_rates(S) for S in each], axis=0)
    return np.where(typical > 0, LARGEST * typical, np.inf)


def _rates(S: np.ndarray) -> np.ndarray:
    """Return the largest rate of each coordinate for quasi-velocities of size 1, (n,)."""
    return np.linalg.norm(S, axis=1)


def as_held(values: Sequence[float] | np.ndarray, scalar: str) -> np.ndarray:
    """Return the nearest values in a scalar, double or float."""
    return np.array(values, np.float32 if scalar == "float" else np.float64).astype(float)


@cache
def _null_space(system: ReducedSystem) -> ca.Function:
    """Return the function (q, parameters) to S."""
    return ca.Function("null_space", [system.mechanism.q, system.mechanism.p], [ca.densify(system.S)])


@cache
def _mass(system: ReducedSystem) -> ca.Function:
    """Return the function (q, parameters) to S'MS."""
    return ca.Function("mass", [system.mechanism.q, system.mechanism.p], [ca.densify(system.Mbar)])


def _range(system: ReducedSystem, quantity: Quantity) -> float:
    if quantity.name in _headings(system):
        return np.pi
    return {"rad": 20.0, "rad/s": 15.0}.get(quantity.unit, 5.0)


@cache
def _headings(system: ReducedSystem) -> frozenset[str]:
    """Return the coordinates on which the vehicle's heading depends."""
    vehicle = system.mechanism.vehicle
    return frozenset(map(str, ca.symvar(vehicle.heading)) if vehicle else ())


def _vehicle_place(law: ControlLaw) -> list[int]:
    """Return the indices of the vehicle's x and y in the state; empty unless they are coordinates."""
    vehicle, names = law.system.mechanism.vehicle, [quantity.name for quantity in law.state]
    point = [str(vehicle.x), str(vehicle.y)] if vehicle else []
    return [names.index(name) for name in point] if point and set(point) <= set(names) else []


@cache
def _onto_path(law: ControlLaw) -> ca.Function:
    """Return the function (point, config) to a point on the path, by Newton's method across it."""
    start, config = ca.SX.sym("start", 2), symbols(law.config)
    distance = law.output.required_path.distance(start[0], start[1])
    gradient = ca.gradient(distance, start)
    step = ca.Function("step", [start, config], [start - distance * gradient / ca.sumsqr(gradient)])
    point = start
    for _ in range(NEWTON_STEPS):
        point = step(point, config)
    return ca.Function("onto_path", [start, config], [point])


def _regular(Phi: np.ndarray) -> bool:
    return abs(np.linalg.det(Phi)) > REGULAR * np.prod(np.linalg.norm(Phi, axis=1))
