"""Random constrained robots, and their equations by projected Newton-Euler in 40 digits, derived without
noslip.

A robot is a description: every function in it is a tree of operations on coordinates, parameters and
decimals. noslip gets it as CasADi expressions. Here the trees are evaluated as jets (value, gradient,
Hessian) of mpmath numbers, and the equations are solved at one state after another: no null space, no
decoupling matrix and no symbolic algebra lie between a robot and tau.
"""

import random
from collections.abc import Sequence
from dataclasses import dataclass

import mpmath
import numpy as np
from noslip.model import Mechanism

DIGITS = 40
TERMS = {"sin": "sin", "cos": "cos", "sqrt": "sqrt"}
WELL = 40.0  # the largest condition number, rows scaled to length 1, of a state that is tried
TRIES = 400  # states drawn, before a robot is given up


# -- trees ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Tree:
    """An operation on other trees; a leaf is a coordinate ("q", number), a parameter ("p",
    number) or a decimal ("n", text)."""

    operation: str
    arguments: tuple = ()

    def __add__(self, other):
        return Tree("+", (self, other))

    def __sub__(self, other):
        return Tree("-", (self, other))

    def __mul__(self, other):
        return Tree("*", (self, other))

    def __truediv__(self, other):
        return Tree("/", (self, other))


def decimal(text: str) -> Tree:
    return Tree("n", (text,))


def evaluated(tree: Tree, q: Sequence, p: Sequence, number, functions):
    """The tree in another algebra."""
    leaves = {"q": lambda k: q[k], "p": lambda k: p[k], "n": number}
    if tree.operation in leaves:
        return leaves[tree.operation](tree.arguments[0])
    a, *b = [evaluated(argument, q, p, number, functions) for argument in tree.arguments]
    match tree.operation:
        case "+":
            return a + b[0]
        case "-":
            return a - b[0]
        case "*":
            return a * b[0]
        case "/":
            return a / b[0]
        case name:
            return functions[name](a)


class Jet:
    """A function of q at a point: value, gradient (n,) and Hessian (n, n) of mpmath numbers.

    Arrays come first in products: an mpmath number before one is slow, for mpmath tries to read the array as
    a number.
    """

    def __init__(self, value, gradient, hessian):
        self.value, self.gradient, self.hessian = value, gradient, hessian

    def __add__(self, other):
        return Jet(self.value + other.value, self.gradient + other.gradient, self.hessian + other.hessian)

    def __sub__(self, other):
        return Jet(self.value - other.value, self.gradient - other.gradient, self.hessian - other.hessian)

    def __mul__(self, other):
        a, b = self, other
        mixed = np.outer(a.gradient, b.gradient)
        hessian = b.hessian * a.value + a.hessian * b.value + mixed + mixed.T
        return Jet(a.value * b.value, b.gradient * a.value + a.gradient * b.value, hessian)

    def __truediv__(self, other):
        v = other.value
        return self * other.through(1 / v, -1 / v**2, 2 / v**3)

    def through(self, value, slope, bend):
        """f(self), given f, f' and f'' there."""
        return Jet(
            value, self.gradient * slope, self.hessian * slope + np.outer(self.gradient, self.gradient) * bend
        )


JETS = {
    "sin": lambda a: a.through(mpmath.sin(a.value), mpmath.cos(a.value), -mpmath.sin(a.value)),
    "cos": lambda a: a.through(mpmath.cos(a.value), -mpmath.sin(a.value), -mpmath.cos(a.value)),
    "sqrt": lambda a: a.through(
        mpmath.sqrt(a.value), 1 / (2 * mpmath.sqrt(a.value)), -1 / (4 * mpmath.sqrt(a.value) ** 3)
    ),
}


def jet(tree: Tree, q: Sequence, p: Sequence) -> Jet:
    """The tree as a function of q."""
    n = len(q)
    zero, none = np.full(n, mpmath.mpf(0)), np.full((n, n), mpmath.mpf(0))
    unit = [np.array([mpmath.mpf(int(k == j)) for j in range(n)]) for k in range(n)]
    leaves = [Jet(value, unit[k], none) for k, value in enumerate(q)]
    fixed = [Jet(value, zero, none) for value in p]
    return evaluated(tree, leaves, fixed, lambda text: Jet(mpmath.mpf(text), zero, none), JETS)


def in_casadi(tree: Tree, q: Sequence, p: Sequence):
    """The tree as noslip takes it."""
    import casadi as ca

    return evaluated(
        tree, q, p, lambda text: ca.SX(float(text)), {"sin": ca.sin, "cos": ca.cos, "sqrt": ca.sqrt}
    )


# -- robots --------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Velocity:
    """Linear in the rates: the rate of a function of q, coefficients times rates, or `terms`,
    times rates of functions."""

    function: Tree | None = None
    coefficients: tuple[Tree | None, ...] = ()
    terms: tuple[tuple[Tree, Tree], ...] = ()


@dataclass(frozen=True)
class Force:
    """-coefficient times v, |v| v, v sqrt(v^2 + 1/4), or |w|, w being the rate of the coordinate `other`;
    on v."""

    kind: str
    coefficient: Tree
    on: Velocity
    other: int


@dataclass(frozen=True)
class RandomRobot:
    """What was drawn. `weights` and `places`: kinetic energy,
    half the sum of weight times the place's rate squared."""

    seed: int
    n: int
    parameters: tuple[str, ...]  # defaults
    weights: tuple[Tree, ...]
    places: tuple[Tree, ...]
    potential: Tree
    forces: tuple[Force, ...]
    constraints: tuple[Velocity, ...]
    inputs: tuple[Velocity, ...]
    quasi: tuple[Velocity, ...]  # empty: noslip chooses
    outputs: tuple[tuple[int, Tree | Velocity], ...]  # relative degree, function of q or velocity
    name: str = ""
    coordinates: tuple[str, ...] = ()  # names
    vehicle: tuple[Tree, Tree, Tree] | None = None  # x, y, heading

    @property
    def dof(self) -> int:
        """n - m."""
        return self.n - len(self.constraints)


class _Draw:
    """Draws the parts of one robot."""

    def __init__(self, seed: int, n: int, parameters: int):
        self.random, self.n, self.parameters = random.Random(seed), n, parameters

    def number(self) -> Tree:
        return decimal(self.random.choice(("0.2", "0.3", "0.7", "1.1", "1.3", "2", "0.5", "0.1", "1", "3")))

    def factor(self) -> Tree:
        """A number or a parameter."""
        return (
            self.number()
            if self.random.random() < 0.4
            else Tree("p", (self.random.randrange(self.parameters),))
        )

    def coordinate(self) -> Tree:
        return Tree("q", (self.random.randrange(self.n),))

    def angle(self) -> Tree:
        a = self.coordinate()
        kind = self.random.random()
        if kind < 0.6:
            return a
        return a + self.coordinate() if kind < 0.8 else a - self.coordinate()

    def term(self) -> Tree:
        """A bounded, smooth function of one or two coordinates."""
        kind = self.random.randrange(8)
        wave = Tree(self.random.choice(("sin", "cos")), (self.angle(),))
        if kind < 3:
            return wave
        if kind == 3:
            return self.coordinate()
        if kind == 4:
            return self.coordinate() * Tree(self.random.choice(("sin", "cos")), (self.coordinate(),))
        if kind == 5:
            return self.number() / (decimal("2.5") + wave)
        if kind == 6:
            return wave / (decimal("1") + self.square(self.coordinate()))
        return Tree("sqrt", (decimal("1.7") + self.square(self.coordinate()),))

    @staticmethod
    def square(tree: Tree) -> Tree:
        return tree * tree

    def function(self, terms: int) -> Tree:
        total = self.factor() * self.term()
        for _ in range(self.random.randrange(terms)):
            more = self.factor() * self.term()
            total = total + more if self.random.random() < 0.7 else total - more
        return total

    def velocity(self, sure: int) -> Velocity:
        """One that has the rate of coordinate `sure`."""
        kind, others = self.random.random(), [k for k in range(self.n) if k != sure]
        parts: list[Tree | None] = [None] * self.n
        if kind < 0.3:
            return Velocity(Tree("q", (sure,)) + self.function(2))
        if kind < 0.6 and others:  # as of a wheel
            other, angle = self.random.choice(others), self.angle()
            parts[sure], parts[other] = Tree("cos", (angle,)), Tree("sin", (angle,))
            if self.random.random() < 0.5:
                third = self.random.randrange(self.n)
                parts[third] = self.factor() if parts[third] is None else parts[third] + self.factor()
            return Velocity(coefficients=tuple(parts))
        parts[sure] = self.factor()
        for k in self.random.sample(others, min(len(others), self.random.randrange(3))):
            parts[k] = self.function(2)
        return Velocity(coefficients=tuple(parts))

    def rate(self, k: int) -> Velocity:
        return Velocity(coefficients=tuple(decimal("1") if j == k else None for j in range(self.n)))


def drawn(seed: int) -> RandomRobot:
    """The robot of that seed, which has states where its equations are well-conditioned."""
    for attempt in range(1000):
        robot = _drawn(seed, attempt)
        if len(states(robot, 3)) == 3:
            return robot
    raise AssertionError(f"no robot of seed {seed} is regular")


def _drawn(seed: int, attempt: int) -> RandomRobot:
    source = random.Random(f"{seed} {attempt}")
    n = source.choice((2, 3, 3, 4, 4, 5, 6))
    m = source.randrange(1, min(4, n - 1) + 1)
    if n - m > 3 and source.random() < 0.7:  # n - m above 3 is slow to generate; some are enough
        m = min(4, n - 2)
    draw = _Draw(source.randrange(1 << 30), n, source.randrange(2, 5))
    order = source.sample(range(n), n)  # which coordinate a constraint or an output has for sure
    weights = [draw.factor() for _ in range(n)]
    places = [Tree("q", (k,)) for k in range(n)]
    for _ in range(source.randrange(1, 4)):
        weights.append(draw.factor())
        places.append(Tree("q", (source.randrange(n),)) * draw.factor() + draw.function(2))
    forces = [
        Force(
            source.choice(("linear", "quadratic", "smooth", "scrub")),
            draw.factor(),
            draw.velocity(source.randrange(n)),
            source.randrange(n),
        )
        for _ in range(source.randrange(3))
    ]
    free = order[m:]
    chosen = source.random()
    quasi = [] if chosen < 0.4 else [draw.rate(k) if chosen < 0.7 else draw.velocity(k) for k in free]
    outputs = []
    for k in free:
        if source.random() < 0.3:
            outputs.append((1, draw.velocity(k)))
        else:
            outputs.append(
                (2, Tree("q", (k,)) if source.random() < 0.4 else Tree("q", (k,)) + draw.function(2))
            )
    return RandomRobot(
        seed,
        n,
        tuple(source.choice(("0.3", "0.8", "1.2", "0.45", "2.5")) for _ in range(draw.parameters)),
        tuple(weights),
        tuple(places),
        draw.function(3),
        tuple(forces),
        tuple(draw.velocity(k) for k in order[:m]),
        tuple(draw.rate(k) if source.random() < 0.5 else draw.velocity(k) for k in free),
        tuple(quasi),
        tuple(outputs),
    )


# -- for noslip ----------------------------------------------------------------------------------------------


def mechanism(robot: RandomRobot) -> Mechanism:
    """The robot as a user writes it down; its outputs are called "own"."""
    import casadi as ca

    result = Mechanism(robot.name or f"robot_{robot.seed}", "a random robot")
    names = robot.coordinates or [f"q_{k}" for k in range(robot.n)]
    q = [result.coordinate(name, "m" if name in ("x", "y") else "rad") for name in names]
    p = [result.parameter(f"p_{k}", float(default), "1") for k, default in enumerate(robot.parameters)]

    def velocity(v: Velocity):
        if v.function is not None:
            return result.rate(in_casadi(v.function, q, p))
        if v.terms:
            return sum(in_casadi(c, q, p) * result.rate(in_casadi(f, q, p)) for c, f in v.terms)
        parts = [
            in_casadi(c, q, p) * result.rate(q[k]) for k, c in enumerate(v.coefficients) if c is not None
        ]
        return sum(parts[1:], start=parts[0])

    for weight, place in zip(robot.weights, robot.places, strict=True):
        result.kinetic_energy(in_casadi(weight, q, p) * result.rate(in_casadi(place, q, p)) ** 2 / 2)
    result.potential_energy(in_casadi(robot.potential, q, p))
    for force in robot.forces:
        v, coefficient = velocity(force.on), in_casadi(force.coefficient, q, p)
        drag = {"linear": v, "quadratic": ca.fabs(v) * v, "smooth": v * ca.sqrt(v**2 + 0.25)}
        drag["scrub"] = ca.fabs(result.rate(q[force.other]))
        result.force(-coefficient * drag[force.kind], on=v)
    for k, constraint in enumerate(robot.constraints):
        result.rolls(f"constraint {k}", velocity(constraint))
    for k, velocity_of_input in enumerate(robot.inputs):
        result.input(f"tau_{k}", "N m", on=velocity(velocity_of_input))
    for k, quasi in enumerate(robot.quasi):
        result.quasi_velocity(f"nu_{k}", "rad/s", velocity(quasi))
    rows = [
        (f"y_{k}", "rad", in_casadi(output, q, p)) if degree == 2 else (f"y_{k}", "rad/s", velocity(output))
        for k, (degree, output) in enumerate(robot.outputs)
    ]
    if rows:
        result.output("own", "random outputs", rows)
    if robot.vehicle:
        result.moves_in_plane(*[in_casadi(each, q, p) for each in robot.vehicle])
    return result


# -- by itself -----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class State:
    """Numbers that a float holds. `nu` are the quasi-velocities, `reference` y_d,
    ydot_d (and yddot_d) row by row."""

    p: tuple[float, ...]
    q: tuple[float, ...]
    nu: tuple[float, ...]
    tau: tuple[float, ...]
    reference: tuple[float, ...]
    gains: tuple[float, ...]


def _row(v: Velocity, q, p) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients of the rates, (n,), and their derivatives by q, (n, n)."""
    if v.function is not None:
        jet_of_function = jet(v.function, q, p)
        return jet_of_function.gradient, jet_of_function.hessian
    n = len(q)
    if v.terms:
        jets = [(jet(c, q, p), jet(f, q, p)) for c, f in v.terms]
        slopes = sum(f.hessian * c.value + np.outer(f.gradient, c.gradient) for c, f in jets)
        return sum(f.gradient * c.value for c, f in jets), slopes
    parts = [jet(c, q, p) if c is not None else None for c in v.coefficients]
    zero, none = mpmath.mpf(0), np.full(n, mpmath.mpf(0))
    values = np.array([zero if part is None else part.value for part in parts])
    return values, np.array([none if part is None else part.gradient for part in parts])


def _rows(velocities: Sequence[Velocity], q, p) -> tuple[np.ndarray, np.ndarray]:
    """(k, n) and its derivatives (k, n, n)."""
    rows = [_row(v, q, p) for v in velocities]
    return np.array([row for row, _ in rows]), np.array([slopes for _, slopes in rows])


def solved(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """matrix^-1 right."""
    columns = right.reshape(len(matrix), -1)
    inverse = np.array((mpmath.matrix(matrix.tolist()) ** -1).tolist())
    return (inverse @ columns).reshape(right.shape)


def chosen_velocities(robot: RandomRobot, names: Sequence[str]) -> list[Velocity]:
    """The quasi-velocities: the robot's own, or those that noslip names: rates of coordinates,
    velocities that inputs act on."""
    if robot.quasi:
        return list(robot.quasi)
    velocities = []
    for name in names:
        kind, number = name.split("_")[:2]
        unit = tuple(decimal("1") if k == int(number) else None for k in range(robot.n))
        velocities.append(Velocity(coefficients=unit) if kind == "q" else robot.inputs[int(number)])
    return velocities


def truth(robot: RandomRobot, state: State, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Every quantity of the law and of the dynamics at a state,
    by Newton's and Euler's equations and Lagrange's multipliers."""
    with mpmath.workdps(DIGITS):
        return _truth(robot, state, names)


def _truth(robot: RandomRobot, state: State, names: Sequence[str]) -> dict[str, np.ndarray]:
    n, m = robot.n, len(robot.constraints)
    p, q, nu = ([mpmath.mpf(value) for value in values] for values in (state.p, state.q, state.nu))
    A, A_q = _rows(robot.constraints, q, p)
    G, G_q = _rows(chosen_velocities(robot, names), q, p)
    square, square_q = np.concatenate([A, G]), np.concatenate([A_q, G_q])
    zeros = np.full((m, n - m), mpmath.mpf(0))
    eye = np.array([[mpmath.mpf(int(i == j)) for j in range(n - m)] for i in range(n - m)])
    S = solved(square, np.concatenate([zeros, eye]))
    qdot = S @ np.array(nu)
    A_dot, G_dot, square_dot = A_q @ qdot, G_q @ qdot, square_q @ qdot
    S_dot = -solved(square, square_dot @ S)

    # the mass of each place times its acceleration J qddot + Jdot qdot, along J
    M, V = np.full((n, n), mpmath.mpf(0)), np.full(n, mpmath.mpf(0))
    for weight, place in zip(robot.weights, robot.places, strict=True):
        w, at = jet(weight, q, p).value, jet(place, q, p)
        M = M + np.outer(at.gradient, at.gradient) * w
        V = V + at.gradient * (w * (qdot @ at.hessian @ qdot))
    V = V + jet(robot.potential, q, p).gradient
    for force in robot.forces:
        row, _ = _row(force.on, q, p)
        v = row @ qdot
        drag = {"linear": v, "quadratic": abs(v) * v, "smooth": v * mpmath.sqrt(v**2 + mpmath.mpf(1) / 4)}
        drag["scrub"] = abs(qdot[force.other])
        V = V + row * (jet(force.coefficient, q, p).value * drag[force.kind])
    E = _rows(robot.inputs, q, p)[0].T

    # the motion that given inputs make
    whole = np.block([[M, A.T], [A, np.full((m, m), mpmath.mpf(0))]])
    forces = E @ np.array([mpmath.mpf(t) for t in state.tau]) - V
    free = solved(whole, np.concatenate([forces, -A_dot @ qdot]))[:n]
    quantities = {
        "qdot": qdot,
        "Mbar": S.T @ M @ S,
        "bias": S.T @ (M @ S_dot @ np.array(nu) + V),
        "input_map": S.T @ E,
        "nudot": G @ free + G_dot @ qdot,
    }
    if len(robot.outputs) < n - m:
        return {name: np.array(value).astype(float) for name, value in quantities.items()}

    # the outputs and what their outer loops ask for
    h, ydot, J, J_dot, v = [], [], [], [], []
    reference, gains = iter(state.reference), iter(state.gains)
    for degree, output in robot.outputs:
        if degree == 1:
            row, row_q = _row(output, q, p)
            h.append(row @ qdot)
            desired, rate = next(reference), next(reference)
            v.append(rate + next(gains) * (desired - h[-1]))
            J.append(row)
            J_dot.append(row_q @ qdot)
        else:
            at = jet(output, q, p)
            h.append(at.value)
            ydot.append(at.gradient @ qdot)
            desired, rate, second = next(reference), next(reference), next(reference)
            v.append(second + next(gains) * (desired - h[-1]) + next(gains) * (rate - ydot[-1]))
            J.append(at.gradient)
            J_dot.append(at.hessian @ qdot)
    J, J_dot = np.array(J), np.array(J_dot)

    # accelerations that constraints and outputs ask for; the inputs and multipliers that give them
    stacked = np.concatenate([A, J])
    qddot = solved(stacked, np.concatenate([-A_dot @ qdot, np.array(v) - J_dot @ qdot]))
    tau = solved(np.concatenate([E, -A.T], axis=1), M @ qddot + V)[: n - m]
    quantities |= {
        "h": np.array(h),
        "ydot": np.array(ydot),
        "Phi": J @ S,
        "Phidot": J_dot @ S + J @ S_dot,
        "u": G @ qddot + G_dot @ qdot,
        "tau": tau,
    }
    return {name: np.array(value).astype(float) for name, value in quantities.items()}


def states(robot: RandomRobot, count: int) -> list[State]:
    """Random states where nothing that must be inverted is near singular;
    every third with coordinates that are zero."""
    source, accepted = np.random.default_rng(robot.seed), []
    free = robot.dof
    references = sum(3 if degree == 2 else 2 for degree, _ in robot.outputs)
    gains = sum(2 if degree == 2 else 1 for degree, _ in robot.outputs)

    def single(values) -> tuple[float, ...]:
        return tuple(np.float32(values).astype(float).tolist())

    for _ in range(TRIES):
        if len(accepted) == count:
            break
        defaults = np.array([float(default) for default in robot.parameters])
        q = source.uniform(-1.2, 1.2, robot.n)
        if len(accepted) % 3 == 2:
            q[source.random(robot.n) < 0.5] = 0.0
        state = State(
            single(defaults * source.uniform(0.7, 1.4, len(defaults))),
            single(q),
            single(source.uniform(-2, 2, free)),
            single(source.uniform(-3, 3, len(robot.inputs))),
            single(source.uniform(-1, 1, references)),
            single(source.uniform(0.5, 3, gains)),
        )
        if _well_conditioned(robot, state):
            accepted.append(state)
    return accepted


def _well_conditioned(robot: RandomRobot, state: State) -> bool:
    with mpmath.workdps(20):
        q, p = [mpmath.mpf(x) for x in state.q], [mpmath.mpf(x) for x in state.p]
        A, E = _rows(robot.constraints, q, p)[0], _rows(robot.inputs, q, p)[0]
        J = np.array(
            [_row(x, q, p)[0] if degree == 1 else jet(x, q, p).gradient for degree, x in robot.outputs]
        )
        checked = [np.concatenate([A, J]) if len(J) else A, np.concatenate([A, E])]
        if robot.quasi:
            checked.append(np.concatenate([A, _rows(robot.quasi, q, p)[0]]))
        return all(_condition(matrix.astype(float)) < WELL for matrix in checked)


def _condition(rows: np.ndarray) -> float:
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    return float(np.linalg.cond(rows / length)) if length.min() > 0 else float("inf")
