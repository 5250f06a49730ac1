"""Numerical search for poles of an expression: zeros of denominators that it still contains."""

from collections.abc import Callable, Iterator, Sequence

import casadi as ca
import numpy as np

from ..errors import ModelError
from .exact import canonical, read, write
from .expression import free_symbols

# Straight lines in the space of all symbols on which zeros are bracketed and bisected
LINES, STEPS, BISECTIONS = 6, 200, 60
BESIDE = 1e-9  # distance from a zero at which values are compared
LARGEST_BLOCK = 5  # largest block, in rows, whose determinant is computed symbolically
# Smallest singular value, with rows scaled to length 1, above which a matrix is regarded as regular
REGULAR = 1e-3
DEVIATION = 1e-8  # relative; a removable pole of order 1 has about 1e-16 / BESIDE
LONGEST = 60  # characters of a denominator that a message shows
# Relative to the product of the largest given values: bound of the rounding error of their combination
ROUNDING = 1e-12


def denominators(expression: ca.SX) -> list[ca.SX]:
    """Return the factors, each once, by which the expression divides somewhere and that are not constant."""
    factors: dict[int, ca.SX] = {}
    visited: set[int] = set()
    stack = [expression.nz[k] for k in range(expression.nnz())]
    while stack:
        node = stack.pop()
        if node.is_leaf() or node.element_hash() in visited:
            continue
        visited.add(node.element_hash())
        parts = [node.dep(k) for k in range(node.n_dep())]
        below = parts[1:] if node.op() == ca.OP_DIV else parts if node.op() == ca.OP_INV else []
        factors.update((factor.element_hash(), factor) for part in below for factor in _factors(part))
        stack += parts
    return list(factors.values())


def _factors(node: ca.SX) -> Iterator[ca.SX]:
    """Yield the factors of a product, power or root; a power of 2 has the zeros of its base,
    but no change of sign there."""
    if node.is_constant():
        return
    if not node.is_leaf() and node.op() in (
        ca.OP_MUL,
        ca.OP_SQ,
        ca.OP_SQRT,
        ca.OP_NEG,
        ca.OP_TWICE,
        ca.OP_CONSTPOW,
        ca.OP_DIV,
    ):
        for k in range(node.n_dep()):
            yield from _factors(node.dep(k))
    else:
        yield node


def added_pole(
    formula: ca.SX, parts: Sequence[ca.SX], combined: Callable[..., np.ndarray | None], moving: ca.SX
) -> ca.SX | None:
    """Return a denominator of `formula`, not of `parts`, where `formula` is wrong and `parts` are regular;
    None if there is none.

    `formula` must equal `combined` of the values of `parts`, which returns None where these are singular.
    Both are compared at a distance of BESIDE from zeros of each denominator, on random lines in the space of
    the `moving` symbols, and where some of these are exactly 0, a common position of joints. The other
    symbols are random positive numbers.
    """
    present = {str(each) for part in parts for each in denominators(ca.SX(part))}
    below = [each for each in denominators(formula) if str(each) not in present]
    if not below:
        return None
    symbols = free_symbols(ca.veccat(formula, *parts))
    place = ca.vertcat(*symbols)
    divisors = ca.Function("denominators", [place], [ca.vertcat(*below)])
    values = ca.Function("values", [place], [ca.densify(each) for each in (formula, *parts)])
    way = ca.SX.sym("way", len(symbols))
    rates = ca.Function(
        "rates", [place, way], [ca.densify(ca.jtimes(each, place, way)) for each in (formula, *parts)]
    )
    names = {symbol.element_hash() for symbol in ca.vertsplit(moving)}
    moves = np.array([symbol.element_hash() in names for symbol in symbols])
    random = np.random.default_rng(1997)

    def compared(at: np.ndarray) -> tuple[np.ndarray, np.ndarray | None, list[np.ndarray]]:
        value, *others = (each.full() for each in values(at))
        return value, combined(*others) if all(np.isfinite(each).all() for each in others) else None, others

    def is_wrong(at: np.ndarray) -> bool:
        value, truth, others = compared(at)
        if truth is None:
            return False
        size = np.prod([np.abs(each).max(initial=0.0) for each in others])
        allowed = DEVIATION * np.abs(truth).max(initial=0.0) + ROUNDING * size
        return not np.abs(value - truth).max(initial=0.0) <= allowed  # true for NaN

    def start() -> np.ndarray:
        return np.where(moves, random.uniform(-1.5, 1.5, len(moves)), random.uniform(0.5, 1.5, len(moves)))

    for _ in range(LINES if moves.any() else 0):
        origin, along = start(), random.normal(size=len(moves)) * moves
        along /= np.linalg.norm(along)
        t = np.linspace(-3.0, 3.0, STEPS + 1)
        table = divisors(origin[:, None] + along[:, None] * t).full()
        for k, row in enumerate(table):
            for j in np.flatnonzero(row[:-1] * row[1:] < 0)[:3]:

                def divisor(
                    s: float, k: int = k, origin: np.ndarray = origin, along: np.ndarray = along
                ) -> float:
                    return float(divisors(origin + along * s)[k])

                zero = _bisected(divisor, t[j], t[j + 1])
                if is_wrong(origin + along * (zero + BESIDE)):
                    return below[k]

    def is_rough(at: np.ndarray) -> bool:
        """Whether derivatives of `formula` are not finite where those of `parts` are,
        as of 1 / (1 / x) at 0."""
        value, *others = (each.full() for each in rates(at, random.normal(size=len(moves)) * moves))
        smooth = all(np.isfinite(each).all() for each in others)
        return smooth and compared(at)[1] is not None and not np.isfinite(value).all()

    some = random.random((len(moves), LINES)) < 0.5
    zeroed = np.where(
        moves[:, None] & np.column_stack([np.eye(len(moves), dtype=bool), some, moves]), 0.0, start()[:, None]
    )
    for at, row in zip(zeroed.T, divisors(zeroed).full().T, strict=True):
        vanishing = np.flatnonzero((row == 0) | ~np.isfinite(row))
        if len(vanishing) and (is_wrong(at) or is_rough(at)):
            return below[vanishing[0]]
    return None


def without_pole(
    robot: str,
    name: str,
    formula: ca.SX,
    parts: Sequence[ca.SX],
    combined: Callable[..., np.ndarray | None],
    moving: ca.SX,
) -> ca.SX:
    """Return `formula`, an expression for `name` of a robot. Raises ModelError where `added_pole` finds a
    denominator. That there is none is found once, and kept for other runs."""
    symbols = ca.vertcat(*free_symbols(ca.veccat(formula, *parts, moving)))
    compared = ca.Function("compared", [symbols], [formula, *parts, moving]).serialize()
    key = f"no pole of {name} by {combined.__qualname__}: {compared}"
    if read(key):
        return formula
    pole = added_pole(formula, parts, combined, moving)
    if pole is None:
        write(key, "none")
        return formula
    text = str(pole)
    if len(text) > LONGEST or "@" in text:  # CasADi numbers what appears twice
        text = f"an expression in {', '.join(sorted(map(str, free_symbols(pole))))}"
    raise ModelError(
        f"{robot}: no expression for {name} was found without a division by {text}, which vanishes where the "
        "robot and its quasi-velocities are regular; choose other quasi-velocities"
    )


def quotient(matrix: np.ndarray, right: np.ndarray) -> np.ndarray | None:
    """Return matrix^-1 right, or None if the matrix is nearly singular."""
    return np.linalg.solve(matrix, right) if _is_regular(matrix) else None


def determinant(matrix: np.ndarray) -> np.ndarray | None:
    """Return the determinant of a square matrix as 1 x 1, or None if the matrix is nearly singular."""
    return np.array([[np.linalg.det(matrix)]]) if _is_regular(matrix) else None


def _is_regular(matrix: np.ndarray) -> bool:
    length = np.linalg.norm(matrix, axis=1, keepdims=True)
    return length.min() > 0.0 and np.linalg.svd(matrix / length, compute_uv=False)[-1] >= REGULAR


def singular_sets(
    matrix: ca.SX, rows: int, states: ca.SX, parameters: ca.SX, values: Sequence[float]
) -> list[tuple[str, bool]]:
    """Return sets on which a square matrix is singular: a text "f = 0" each, and whether its first `rows`
    rows lose rank there.

    The sets are those of the determinants of its diagonal blocks, up to LARGEST_BLOCK. Factors without a
    change of sign on random lines, and larger blocks, are not reported.
    """
    count, i, j, first, _, *_ = (matrix := ca.sparsify(matrix)).sparsity().btf()
    sets: dict[str, bool] = {}
    random = np.random.default_rng(1992)
    for k in range(count):
        block = ca.densify(matrix[i[first[k] : first[k + 1]], j[first[k] : first[k + 1]]])
        if block.shape[0] > LARGEST_BLOCK:
            continue
        determinant = canonical(ca.det(block))
        for factor in _factors(determinant) if not determinant.is_zero() else ():
            if not ca.depends_on(factor, states):
                continue
            function = ca.Function("factor", [states, parameters], [factor, matrix[:rows, :]])
            for _ in range(LINES):
                start, along = random.uniform(-1.5, 1.5, states.numel()), random.normal(size=states.numel())
                t = np.linspace(-3.0, 3.0, STEPS + 1)
                at = [float(function(start + along * s, values)[0]) for s in t]
                signs = [m for m in range(STEPS) if at[m] * at[m + 1] < 0]
                if signs:

                    def value(
                        s: float, f: ca.Function = function, a: np.ndarray = start, b: np.ndarray = along
                    ) -> float:
                        return float(f(a + b * s, values)[0])

                    zero = _bisected(value, t[signs[0]], t[signs[0] + 1])
                    A = function(start + along * zero, values)[1].full()
                    scale = np.linalg.norm(function(start, values)[1].full(), axis=1).max()
                    sets[f"{factor} = 0"] = bool(np.linalg.svd(A, compute_uv=False)[-1] < 1e-6 * scale)
                    break
    return list(sets.items())


def _bisected(function: Callable[[float], float], low: float, high: float) -> float:
    rising = function(high) > 0
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        if (function(middle) > 0) == rising:
            high = middle
        else:
            low = middle
    return (low + high) / 2
