"""Random parameters, states and references, from a seed, at which a law is evaluated."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from ...model.algebra.direct import Direct
from ...model.algebra.samples import smallest_eigenvalue
from ...model.law import ControlLaw, symbols
from ...model.mechanism import Quantity
from ...model.reduction import ReducedSystem
from ...model.vehicle import point_on_body
from ...readers.errors import BadInput
from ...simulation.controllers.backends import make_controller
from ...simulation.controllers.controller import Evaluation, ParameterRefused

STATES_PER_PLANT = 20  # states that share parameters, config and gains
REGULAR = 1e-2  # |det Phi| is above this times the product of Phi's row norms
# a row of S may have at most this times its median size: beyond lies a pole, as at a wheel steered across
LARGEST = 5.0
TYPICAL = 99  # number of states for the median
HEAVY = 1e-4  # smallest eigenvalue of S'MS scaled to a diagonal of ones
# One of so many states has exact zeros and quarter turns, where a factor that should have cancelled shows
SPECIAL = 4
QUARTER = np.pi / 2  # rad
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
    accepted = drawn = 0
    while accepted < states:
        if drawn > DRAWS * states:
            raise BadInput(
                f"{law.name}: hardly any random state is regular: {accepted} of {drawn}; is the output "
                "singular everywhere?"
            )
        params, config, gains = (_values(group, random) for group in (law.parameters, law.config, law.gains))
        drawn += STATES_PER_PLANT
        try:
            controller = make_controller("casadi", law, params, config, gains)
        except ParameterRefused:
            continue
        regular, inverted = _Regular(law.system, params), _inverted(law, params, config)
        points: list[RandomPoint] = []
        for k in range(min(STATES_PER_PLANT, states - accepted)):
            state, reference = _state(law, config, random), random.uniform(-2, 2, len(law.reference))
            if k % SPECIAL == SPECIAL - 1:
                state = _special(law.state, state, random)
            truth = controller.evaluate(state, reference)
            if (
                truth.status == "ok"
                and _regular(inverted(state, truth))
                and regular.moves(state)
                and regular.driven(state)
            ):
                points.append(RandomPoint(accepted + len(points), state, reference, truth))
        accepted += len(points)
        yield RandomPlant(params, config, gains, tuple(points))


def random_motions(system: ReducedSystem, count: int, seed: int) -> Iterator[Motion]:
    """Yield motions of a robot where S and S'MS are regular. Raises BadInput if hardly any random state
    is."""
    random = np.random.default_rng(seed)
    accepted = 0
    for drawn in range(DRAWS * count):
        if drawn % STATES_PER_PLANT == 0:
            params = _values(system.mechanism.parameters, random)
            regular = _Regular(system, params)
        state, tau = (
            _uniform(system, system.state, random),
            random.uniform(-5, 5, len(system.mechanism.inputs)),
        )
        if drawn % SPECIAL == SPECIAL - 1:
            state = _special(system.state, state, random)
        if regular.moves(state):
            accepted += 1
            yield Motion(params, state, tau)
        if accepted == count:
            return
    regular_of = f"{accepted} of {DRAWS * count}"
    raise BadInput(
        f"{system.mechanism.name}: the mass matrix S'MS is regular at hardly any random state: {regular_of}"
    )


class _Regular:
    """Whether a system with these parameters is far from poles of S, S'MS and S'E at a state [q; nu].

    Sizes are compared with their medians over a fixed set of coordinates.
    """

    def __init__(self, system: ReducedSystem, params: Sequence[float]):
        self._params, self._function = np.array(params, float), _matrices(system)
        self._n = len(system.mechanism.coordinates)
        self._direct = Direct(self._function)
        ranges = [_range(system, quantity) for quantity in system.mechanism.coordinates]
        some = np.random.default_rng(0).uniform(-1, 1, (TYPICAL, len(ranges))) * ranges
        S, _, SE = (
            value.full().reshape(value.size1(), TYPICAL, -1).swapaxes(0, 1)
            for value in self._function(some.T, self._params)
        )
        typical = np.median(_rates(S), axis=0)
        self._largest = np.where(typical > 0, LARGEST * typical, np.inf)
        self._least = REGULAR * np.median(_reached(SE))

    def _at(self, q: np.ndarray) -> list[np.ndarray]:
        """Return S, S'MS and S'E."""
        values = self._direct(q, self._params)
        return [value.reshape(self._function.size_out(k), order="F") for k, value in enumerate(values)]

    def moves(self, state: np.ndarray) -> bool:
        """Whether S and S'MS are regular."""
        S, mass, _ = self._at(state[: self._n])
        finite = np.isfinite(S).all() and np.isfinite(mass).all()
        return bool(finite and np.all(_rates(S) <= self._largest) and smallest_eigenvalue(mass) > HEAVY)

    def driven(self, state: np.ndarray) -> bool:
        """Whether the inputs reach every quasi-velocity: S'E has full rank."""
        return bool(_reached(self._at(state[: self._n])[2]) >= self._least)


def _values(quantities: Sequence[Quantity], random: np.random.Generator) -> tuple[float, ...]:
    """Return values between half and twice the default, with either sign if allowed;
    up to 1 if the default is zero."""
    values = []
    for quantity in quantities:
        size = quantity.default * random.uniform(0.5, 2) if quantity.default else random.uniform(0, 1)
        values.append(float(size * random.choice((-1, 1)) if quantity.sign == "any" else size))
    return tuple(values)


def _state(law: ControlLaw, config: Sequence[float], random: np.random.Generator) -> np.ndarray:
    """Return positions within 5 m, near the path if there is one; heading within pi, other angles 20,
    angular rates 15."""
    state = _uniform(law.system, law.state, random)
    place = _vehicle_place(law)
    if law.output.path and place:
        state[place] = np.asarray(_onto_path(law)(state[place], config)).ravel() + random.uniform(-1, 1, 2)
    return state


def _special(quantities: Sequence[Quantity], state: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Return the state with some or all entries zero, and some angles at whole quarter turns."""
    zero, quarter = random.random((2, len(state))) < random.uniform(0.2, 1.2, 2)[:, None]
    turned = np.where(
        [quantity.unit == "rad" for quantity in quantities] & quarter,
        QUARTER * np.round(state / QUARTER),
        state,
    )
    return np.where(zero, 0.0, turned)


def _uniform(
    system: ReducedSystem, quantities: Sequence[Quantity], random: np.random.Generator
) -> np.ndarray:
    return np.array([random.uniform(-1, 1) * _range(system, quantity) for quantity in quantities])


def _rates(S: np.ndarray) -> np.ndarray:
    """Return the largest rate of each coordinate for quasi-velocities of size 1, (..., n), of S, (...,
    n, k)."""
    return np.linalg.norm(S, axis=-1)


def _reached(SE: np.ndarray) -> np.ndarray:
    """Return the smallest singular value of each S'E, (...), of (..., k, inputs);
    0 if an entry is not finite."""
    finite = np.isfinite(SE).all(axis=(-2, -1))
    return np.where(
        finite, np.linalg.svd(np.where(finite[..., None, None], SE, 0.0), compute_uv=False)[..., -1], 0.0
    )


def as_held(values: Sequence[float] | np.ndarray, scalar: str) -> np.ndarray:
    """Return the nearest values in a scalar, double or float."""
    return np.array(values, np.float32 if scalar == "float" else np.float64).astype(float)


@cache
def _matrices(system: ReducedSystem) -> ca.Function:
    """Return the function (q, parameters) to S, S'MS and S'E."""
    matrices = [ca.densify(matrix) for matrix in (system.S, system.Mbar, system.input_map)]
    return ca.Function("matrices", [system.mechanism.q, system.mechanism.p], matrices)


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
    """Return the indices of the coordinates x and y of the vehicle in the state; empty if there are none."""
    point = point_on_body(law.system)
    return list(point.pose[:2]) if point else []


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


def _inverted(
    law: ControlLaw, params: Sequence[float], config: Sequence[float]
) -> Callable[[np.ndarray, Evaluation], np.ndarray]:
    """Return the function from a state and CasADi's result to what the law inverts there: Phi,
    or the Jacobian of P_l."""
    if law.linearization.damping is None:
        return lambda state, truth: truth.values["Phi"]
    function = law.at_state(law.linearization.damping.J)
    return lambda state, truth: function(state, params, config).full()


def _regular(Phi: np.ndarray) -> bool:
    return abs(np.linalg.det(Phi)) > REGULAR * np.prod(np.linalg.norm(Phi, axis=1))
