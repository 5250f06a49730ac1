"""Actuation of a robot: whether its inputs drive every quasi-velocity, and the reachable dimension if they do
not.

If S'E has rank n-m, the feedback (12) turns the robot into qdot = S nu, nudot = u (13). Otherwise the robot
is x' = f(x) + sum g_j tau_j, x = [q; nu], where f is its motion without inputs, and brackets of these
determine what it reaches: H. J. Sussmann, V. Jurdjevic, Controllability of nonlinear systems, J. Differential
Equations 12, 1972.
"""

import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import casadi as ca
import mpmath
import numpy as np
from scipy.linalg import null_space as null_space_of

from ...model.algebra.expression import fold
from ...model.algebra.samples import Sampled
from ...model.errors import ModelError
from ...model.mechanism import Mechanism
from ...model.reduction import ReducedSystem, null_space
from ..exact.real_points import DIGITS, rank
from ..exact.symbolic import FUNCTIONS

LARGEST = 20_000  # operations of a bracket
CONSTANT = 1e-9  # of sizes about 1: what is below it is zero
STATES = 3  # random states at which ranks are computed
# Relative, of numbers in a model such as 0.1; smaller values compared with the terms of a bracket are zero
ROUNDING = 1e-12
NUMERIC: Mapping[int, Callable] = {
    **FUNCTIONS,
    ca.OP_SQRT: mpmath.sqrt,
    ca.OP_SIN: mpmath.sin,
    ca.OP_COS: mpmath.cos,
    ca.OP_TAN: mpmath.tan,
    ca.OP_EXP: mpmath.exp,
    ca.OP_SINH: mpmath.sinh,
    ca.OP_COSH: mpmath.cosh,
    ca.OP_TANH: mpmath.tanh,
    ca.OP_FABS: abs,
}


@dataclass(frozen=True, eq=False)
class Actuation:
    """Actuation by the inputs of a mechanism: `driven` of the `dof` = n - m quasi-velocities; generic ranks
    at random states."""

    mechanism: Mechanism
    driven: int
    dof: int

    @property
    def full(self) -> bool:
        """Whether the inputs drive every quasi-velocity, so that (13) describes the robot."""
        return self.driven == self.dof

    @cached_property
    def reached(self) -> int | None:
        """Dimension of the strong accessibility distribution, at the default parameters; None if it cannot be
        computed.

        The distribution is the smallest one that has all g_j and is invariant under brackets with f and g_j.
        Its dimension is the largest of those at random states.
        """
        try:
            return max(self._reached(seed) for seed in range(STATES))
        except (ModelError, KeyError, ZeroDivisionError, RuntimeError, ValueError):
            return None

    @cached_property
    def at_rest(self) -> bool | None:
        """Whether it is small-time locally controllable at rest at generic configurations, at the default
        parameters; None if that is not decided, or cannot be computed.

        No: a single input g, and [g, [f, g]] is not a combination of the ad_f^k g (H. J. Sussmann, 1983,
        proposition 6.3). Yes, without potential and dissipation, where Delta* is the whole space: the g_j and
        their symmetric products [g_i, [f, g_j]], i < j, span all velocities, and [g_j, [f, g_j]] is a
        combination of the g_j (A. D. Lewis, 2000).
        """
        try:
            (verdict, *others) = [self._at_rest(seed) for seed in range(STATES)]
            return verdict if all(other == verdict for other in others) else None
        except (ModelError, KeyError, ZeroDivisionError, RuntimeError, ValueError):
            return None

    def _at_rest(self, seed: int) -> bool | None:
        x, drift, driving = self._fields
        count, value, resting = len(driving), self._value(seed), self._value(seed, rest=True)
        with mpmath.workdps(DIGITS):
            if any(resting(drift)):
                return None
            twice = ca.substitute(drift, self._system.nu, 2 * self._system.nu)[-self.dof :]
            once = value(drift)[-self.dof :]
            free = _size(
                [fast - 4 * slow for fast, slow in zip(value(twice), once, strict=True)]
            ) <= ROUNDING * max(1, _size(once))
            products = [[_bracket(one, _bracket(drift, other, x), x) for other in driving] for one in driving]
            own, usual = (
                [resting(each) for each in driving],
                max(_size(value(each)) for row in products for each in row),
            )
            bad = [
                product for j in range(count) if _size(product := resting(products[j][j])) > ROUNDING * usual
            ]
            if count == 1 and bad:
                linear, candidate = list(own), driving[0]
                for _ in range(x.numel() - 1):
                    candidate = _bracket(drift, candidate, x)
                    linear.append(resting(candidate))
                return False if _rank([*linear, *bad]) > _rank(linear) else None
            good = [resting(products[i][j]) for j in range(count) for i in range(j)]
            spans = _rank([*own, *good]) == self.dof
            return True if free and spans and _rank([*own, *bad]) == _rank(own) else None

    @cached_property
    def linearizable(self) -> tuple[bool, str] | None:
        """Whether static state feedback linearizes it where it is accessible, and why, at the default
        parameters; None if that cannot be computed.

        D_1 = span{g_j} and D_(k+1) = D_k + [f, D_k] must be involutive, up to one with all dimensions that
        are `reached` (B. Jakubczyk, W. Respondek, On linearization of control systems, Bull. Acad. Pol. Sci.
        28, 1980): ranks at random states.
        """
        try:
            return self._linearizable()
        except (ModelError, KeyError, ZeroDivisionError, RuntimeError, ValueError):
            return None

    def _linearizable(self) -> tuple[bool, str] | None:
        (x, drift, driving), states = self._fields, [self._value(seed) for seed in range(STATES)]

        def independent(fields: list[ca.SX], more: list[tuple[ca.SX, ca.SX, ca.SX]]) -> list[ca.SX]:
            """Return the brackets among `more`, each with the two fields of which it is one,
            that add to the span of fields."""
            added: list[ca.SX] = []
            for bracket, a, b in more:
                for value in states:
                    entries = value(bracket)
                    negligible = _size(entries) <= ROUNDING * _size(value(a)) * _size(value(b))
                    spanned = [value(each) for each in (*fields, *added)]
                    if not negligible and _rank([*spanned, entries]) > _rank(spanned):
                        added.append(bracket)
                        break
            return added

        with mpmath.workdps(DIGITS):
            fields = newest = list(driving)
            for k in range(1, x.numel() + 1):
                brackets = [(_bracket(a, b, x), a, b) for a, b in combinations(fields, 2)]
                if max(ca.n_nodes(each) for each, *_ in brackets or [(x, x, x)]) > LARGEST:
                    return None
                if independent(fields, brackets):
                    return False, f"D_{k}, of the inputs and their brackets with the drift, is not involutive"
                newest = independent(fields, [(_bracket(drift, field, x), drift, field) for field in newest])
                if not newest:
                    break
                fields = [*fields, *newest]
            if len(fields) == self.reached:
                return True, f"D_1 to D_{k} are involutive, and the last has all {len(fields)} dimensions"
            return False, f"D_1 to D_{k} are involutive, but have {len(fields)} dimensions of {self.reached}"

    @cached_property
    def momentum(self) -> tuple[str, ...]:
        """The coordinates of a common displacement whose momentum no input changes and is the rate of a
        function of q, at the default parameters; empty if none is found.

        Constant displacements xi with A xi = 0 that no input drives, E' xi = 0: the momentum p = xi' M qdot
        has the rate xi' (Mdot qdot - V). If that is zero in all motions and xi' M is a gradient, the function
        grows with p t.
        """
        mechanism, system = self.mechanism, self._system
        rate = ca.jtimes(mechanism.M, mechanism.q, system.qdot) @ system.qdot - system.V
        state = ca.vertcat(mechanism.q, system.nu)
        rows = ca.Function(
            "rows", [state, mechanism.p], [ca.densify(ca.vertcat(mechanism.A, mechanism.E.T, rate.T))]
        )
        xi = ca.SX.sym("xi", len(mechanism.coordinates))
        slopes = ca.jacobian(mechanism.M @ xi, mechanism.q)
        curl, by_nu = ca.densify(slopes - slopes.T), ca.densify(system.S.T @ mechanism.M @ xi)
        closed = ca.Function("closed", [state, mechanism.p, xi], [curl, by_nu])
        draw, parameters = np.random.default_rng(1992), [p.default for p in mechanism.parameters]
        states = draw.uniform(-1, 1, (2 * len(mechanism.coordinates), state.numel()))
        stacked = np.concatenate([rows(each, parameters).full() for each in states])
        if not np.isfinite(stacked).all():
            return ()
        for displacement in null_space_of(stacked, rcond=CONSTANT).T:
            values = [[part.full() for part in closed(each, parameters, displacement)] for each in states]
            if (
                all(np.abs(curl).max() < CONSTANT for curl, _ in values)
                and min(np.abs(p).max() for _, p in values) > CONSTANT
            ):
                moved = np.abs(displacement) > CONSTANT
                return tuple(q.name for q, moves in zip(mechanism.coordinates, moved, strict=True) if moves)
        return ()

    @cached_property
    def _fields(self) -> tuple[ca.SX, ca.SX, list[ca.SX]]:
        """The state x = [q; nu], the drift f and the g_j."""
        system, inputs = self._system, len(self.mechanism.inputs)

        def field(tau: ca.SX) -> ca.SX:
            return ca.densify(ca.vertcat(system.qdot, system.acceleration(tau)))

        drift = field(ca.SX.zeros(inputs))
        return (
            ca.vertcat(self.mechanism.q, system.nu),
            drift,
            [field(ca.SX.eye(inputs)[:, j]) - drift for j in range(inputs)],
        )

    def _value(self, seed: int, rest: bool = False) -> Callable[[ca.SX], list[mpmath.mpf]]:
        """Return the function from a vector to its numbers at a random state, or at one with nu = 0."""
        (x, _, _), draw, parameters = self._fields, random.Random(seed), self.mechanism.parameters
        state = [draw.uniform(-1.0, 1.0) for _ in range(x.numel())]
        if rest:
            state[-self.dof :] = [0.0] * self.dof
        with mpmath.workdps(DIGITS):
            at = [mpmath.mpf(number) for number in (*state, *[p.default for p in parameters])]
        symbols = ca.vertsplit(ca.vertcat(x, self.mechanism.p))
        return lambda vector: fold(
            vector, symbols, at.__getitem__, mpmath.mpf, lambda code, parts: NUMERIC[code](*parts)
        )

    def _reached(self, seed: int) -> int:
        (x, drift, driving), value = self._fields, self._value(seed)
        values: list[list[mpmath.mpf]] = []
        with mpmath.workdps(DIGITS):
            sizes = [_size(value(other)) for other in (drift, *driving)]
            waiting = list(zip(driving, sizes[1:], strict=True))
            while waiting and len(values) < x.numel():
                candidate, usual = waiting.pop(0)
                entries = value(candidate)
                size = _size(entries)
                if size <= ROUNDING * usual:
                    continue
                direction = [entry / size for entry in entries]
                if rank([*values, direction], ROUNDING) > len(values):
                    values.append(direction)
                    brackets = [_bracket(other, candidate, x) for other in (drift, *driving)]
                    waiting += [
                        (bracket, size * other) for bracket, other in zip(brackets, sizes, strict=True)
                    ]
        return len(values)

    @cached_property
    def _system(self) -> ReducedSystem:
        S, names, reduced = null_space(self.mechanism)
        return ReducedSystem(self.mechanism, names, S, reduced)


def actuation(mechanism: Mechanism) -> Actuation | None:
    """Return the actuation of a mechanism; None without inputs.

    The rank of S'E is that of [A; E'] minus m, since A has rank m and S spans its null space.
    """
    if not mechanism.inputs:
        return None
    A, E = mechanism.A, mechanism.E
    both = Sampled(ca.vertcat(A, E.T), mechanism.q, mechanism.parameters, f"{mechanism.name}: A and E")
    m, n = A.shape
    return Actuation(mechanism, both.rank() - m, n - m)


def _size(vector: list[mpmath.mpf]) -> mpmath.mpf:
    return max(map(abs, vector))


def _rank(vectors: list[list[mpmath.mpf]]) -> int:
    """Return the rank of vectors of any size."""
    return rank([[entry / _size(vector) for entry in vector] for vector in vectors if any(vector)], ROUNDING)


def _bracket(f: ca.SX, g: ca.SX, x: ca.SX) -> ca.SX:
    return ca.densify(ca.jtimes(g, x, f) - ca.jtimes(f, x, g))
