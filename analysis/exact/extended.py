"""Evaluation of the model's expressions in extended precision,
as the exact value with which rounded ones are compared."""

from collections.abc import Callable, Iterable, Sequence

import casadi as ca
import mpmath
import numpy as np

from ...model.algebra.expression import fold

DIGITS = 40
ROUNDING = {"double": 2.0**-53, "float": 2.0**-24}
RESPONSE = 30.0  # a difference up to this times the change of the model with rounded inputs is not an error
TRIES = 4  # inputs are rounded up and down at random so often

FUNCTIONS: dict[int, Callable] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: lambda a, b: a + b,
    ca.OP_SUB: lambda a, b: a - b,
    ca.OP_MUL: lambda a, b: a * b,
    ca.OP_DIV: lambda a, b: a / b if b else mpmath.nan,
    ca.OP_NEG: lambda a: -a,
    ca.OP_SQ: lambda a: a * a,
    ca.OP_TWICE: lambda a: 2 * a,
    ca.OP_INV: lambda a: 1 / a if a else mpmath.nan,
    ca.OP_SQRT: lambda a: mpmath.sqrt(a) if a >= 0 else mpmath.nan,
    ca.OP_POW: mpmath.power,
    ca.OP_CONSTPOW: mpmath.power,
    ca.OP_FABS: abs,
    ca.OP_SIGN: mpmath.sign,
    ca.OP_FMIN: min,
    ca.OP_FMAX: max,
    ca.OP_COPYSIGN: lambda a, b: abs(a) if b >= 0 else -abs(a),
    ca.OP_FLOOR: mpmath.floor,
    ca.OP_CEIL: mpmath.ceil,
    ca.OP_EXP: mpmath.exp,
    ca.OP_LOG: mpmath.log,
    ca.OP_SIN: mpmath.sin,
    ca.OP_COS: mpmath.cos,
    ca.OP_TAN: mpmath.tan,
    ca.OP_ASIN: mpmath.asin,
    ca.OP_ACOS: mpmath.acos,
    ca.OP_ATAN: mpmath.atan,
    ca.OP_ATAN2: mpmath.atan2,
    ca.OP_HYPOT: mpmath.hypot,
    ca.OP_SINH: mpmath.sinh,
    ca.OP_COSH: mpmath.cosh,
    ca.OP_TANH: mpmath.tanh,
    ca.OP_ASINH: mpmath.asinh,
    ca.OP_ACOSH: mpmath.acosh,
    ca.OP_ATANH: mpmath.atanh,
    ca.OP_ERF: mpmath.erf,
    ca.OP_LT: lambda a, b: mpmath.mpf(a < b),
    ca.OP_LE: lambda a, b: mpmath.mpf(a <= b),
    ca.OP_EQ: lambda a, b: mpmath.mpf(a == b),
    ca.OP_NE: lambda a, b: mpmath.mpf(a != b),
    ca.OP_NOT: lambda a: mpmath.mpf(not a),
    ca.OP_AND: lambda a, b: mpmath.mpf(bool(a and b)),
    ca.OP_OR: lambda a, b: mpmath.mpf(bool(a or b)),
    ca.OP_IF_ELSE_ZERO: lambda a, b: b if a else mpmath.mpf(0),
}


def evaluate(
    expression: ca.SX, symbols: Sequence[ca.SX], values: Iterable[float | mpmath.mpf]
) -> list[mpmath.mpf]:
    """Return the entries of `expression`, column by column, with DIGITS digits; `values` of `symbols` are
    taken as exact.

    Raises KeyError for an operation that is not in FUNCTIONS.
    """
    with mpmath.workdps(DIGITS):
        numbers = [value if isinstance(value, mpmath.mpf) else mpmath.mpf(float(value)) for value in values]
        return fold(
            expression,
            symbols,
            numbers.__getitem__,
            mpmath.mpf,
            lambda code, arguments: FUNCTIONS[code](*arguments),
        )


def due_to_rounding(
    off: float, expression: ca.SX, groups: Sequence[ca.SX], inputs: Sequence[np.ndarray], scalar: str
) -> bool:
    """Return whether a difference `off` from the model is explained by the condition of the expression at
    these inputs, by group.

    It is if the model itself, in extended precision, differs as much where its inputs are rounded to the
    scalar, or in double.
    """
    symbols, values = (
        [symbol for group in groups for symbol in ca.vertsplit(group)],
        np.concatenate([*map(np.ravel, inputs)]),
    )

    def exact(at: np.ndarray) -> np.ndarray:
        return np.array(evaluate(expression, symbols, at), float)

    expected, response = exact(values), 0.0
    for seed in range(TRIES):
        rounded = values * (1 + ROUNDING[scalar] * np.random.default_rng(seed).choice((-1, 1), len(values)))
        response = max(response, np.abs(exact(rounded) - expected).max(initial=0.0))
    in_double = (
        ca.Function("in_double", list(groups), [ca.densify(expression)])(*inputs).full().ravel(order="F")
    )
    return bool(off <= RESPONSE * response + 2 * np.abs(in_double - expected).max(initial=0.0))
