"""Which combinations of parameters something known determines, whatever the motion."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import mpmath
import numpy as np

from ..exact.extended import DIGITS, evaluate

RANGE = (-1.5, 1.5)  # of random motions
POSITIVE = (0.3, 1.2)  # of random values that may be those of lengths and masses
NEGLIGIBLE = mpmath.mpf(10) ** (-DIGITS // 2)


@dataclass(frozen=True)
class Combination:
    """A change of parameters that the motion shows: d(pivot) + sum(factor * d(name));
    the factors may depend on parameters."""

    pivot: str
    others: tuple[tuple[str, float], ...]

    def __str__(self) -> str:
        """Return it as a sum with three digits."""
        terms = [f"{'-' if factor < 0 else '+'} {abs(factor):.3g} {name}" for name, factor in self.others]
        return " ".join([self.pivot, *terms])


def determined(
    observed: ca.SX,
    moving: Sequence[ca.SX],
    parameters: Mapping[str, ca.SX],
    names: Sequence[str],
    values: Sequence[float],
    point: Callable[[np.random.Generator], Sequence[float | mpmath.mpf]] | None = None,
) -> list[Combination]:
    """Return a basis of what `observed`, known for all values of `moving`, or at each `point`, determines of
    the named parameters near `values`.

    Its derivatives by the parameters are evaluated with DIGITS digits at random motions; their row space is
    reduced with pivots in the order of `names`. A parameter that is the pivot of no combination, or occurs
    beside one, is not identifiable by itself.
    """
    rates = ca.jacobian(observed, ca.vertcat(*[parameters[name] for name in names]))
    symbols, dimension = [*moving, *parameters.values()], observed.shape[0]
    random = np.random.default_rng(1)
    rows: list[list[mpmath.mpf]] = []
    with mpmath.workdps(DIGITS):
        for _ in range(2 + 2 * len(names)):
            moved = point(random) if point else random.uniform(*RANGE, len(moving))
            entries = evaluate(ca.densify(rates), symbols, [*moved, *values])
            rows += [entries[i::dimension] for i in range(dimension)]
        return _reduced(rows, names)


def generic_rank(matrix: ca.SX) -> int:
    """Return the rank of a matrix at almost all values of its symbols: the largest at some random ones."""
    symbols = ca.symvar(matrix)
    at = ca.Function("at", [ca.vertcat(*symbols)], [ca.densify(matrix)])
    points = np.random.default_rng(1).uniform(*POSITIVE, (4, len(symbols)))
    return max(int(np.linalg.matrix_rank(at(point).full())) for point in points)


def _reduced(rows: list[list[mpmath.mpf]], names: Sequence[str]) -> list[Combination]:
    """Return the reduced row echelon form as combinations."""
    largest = max((abs(entry) for row in rows for entry in row), default=mpmath.mpf(0))
    pivots: list[tuple[int, list[mpmath.mpf]]] = []
    for column in range(len(names)):
        best = max(rows, key=lambda row: abs(row[column]))
        if abs(best[column]) <= NEGLIGIBLE * largest:
            continue
        pivot = [entry / best[column] for entry in best]
        rows = [_without(row, pivot, column) for row in rows if row is not best]
        pivots = [(k, _without(row, pivot, column)) for k, row in pivots] + [(column, pivot)]
    return [
        Combination(
            names[k], tuple((names[j], float(e)) for j, e in enumerate(row) if j != k and abs(e) > NEGLIGIBLE)
        )
        for k, row in pivots
    ]


def _without(row: list[mpmath.mpf], pivot: list[mpmath.mpf], column: int) -> list[mpmath.mpf]:
    return [entry - row[column] * other for entry, other in zip(row, pivot, strict=True)]
