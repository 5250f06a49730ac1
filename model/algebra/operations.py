"""The scalar operations that a model may be made of: those that the generated C can compute without a
library."""

import math
from collections.abc import Iterable

import casadi as ca

from ..errors import ModelError
from .expression import fold, free_symbols

NAMES = {getattr(ca, name): name[3:].lower() for name in dir(ca) if name.startswith("OP_")}
SMOOTH = frozenset(
    {
        *(
            ca.OP_ASSIGN,
            ca.OP_ADD,
            ca.OP_SUB,
            ca.OP_MUL,
            ca.OP_DIV,
            ca.OP_NEG,
            ca.OP_SQ,
            ca.OP_TWICE,
            ca.OP_INV,
            ca.OP_SQRT,
        ),
        *(ca.OP_POW, ca.OP_CONSTPOW, ca.OP_HYPOT, ca.OP_EXP, ca.OP_LOG, ca.OP_SINH, ca.OP_COSH, ca.OP_TANH),
        *(ca.OP_SIN, ca.OP_COS, ca.OP_TAN, ca.OP_ASIN, ca.OP_ACOS, ca.OP_ATAN, ca.OP_ATAN2),
    }
)
BENT = {ca.OP_FABS: "fabs", ca.OP_FMIN: "fmin", ca.OP_FMAX: "fmax"}  # continuous, their derivatives jump
JUMPING = {
    **{
        ca.OP_SIGN: "sign",
        ca.OP_IF_ELSE_ZERO: "if_else",
        ca.OP_LT: "<",
        ca.OP_LE: "<=",
        ca.OP_EQ: "==",
        ca.OP_NE: "!=",
    },
    **{ca.OP_NOT: "not", ca.OP_AND: "and", ca.OP_OR: "or"},
}
SUPPORTED = SMOOTH | BENT.keys() | JUMPING.keys()
STEPS = JUMPING | {  # those without a place in the generated C too
    **{
        ca.OP_FLOOR: "floor",
        ca.OP_CEIL: "ceil",
        ca.OP_FMOD: "fmod",
        ca.OP_REMAINDER: "remainder",
        ca.OP_COPYSIGN: "copysign",
    },
}
KINKS = BENT | STEPS
POLYNOMIAL = frozenset({ca.OP_ASSIGN, ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_NEG, ca.OP_SQ, ca.OP_TWICE})
LARGEST_POWER = 32  # absolute value of an exponent
USABLE = (
    "use + - * / sqrt, powers with a constant exponent, sin cos tan asin acos atan atan2, exp log sinh cosh "
    "tanh, hypot, fabs fmin fmax sign, comparisons and if_else"
)


def refuse_unsupported(expression: ca.SX, where: str) -> None:
    """Raise ModelError for an operation that the generated C does not support, an exponent that varies or is
    above LARGEST_POWER in size, and a number that is not finite."""

    def constant(value: float) -> float:
        if not math.isfinite(value):
            raise ModelError(
                f"{where}: contains {value}, which is not a finite number; look for a division by zero"
            )
        return value

    def apply(code: int, arguments: tuple[float | None, ...]) -> None:
        if code not in SUPPORTED:
            raise ModelError(
                f"{where}: {NAMES.get(code, f'operation {code}')} is not supported in generated C; {USABLE}"
            )
        if code in (ca.OP_POW, ca.OP_CONSTPOW) and (
            arguments[1] is None or abs(arguments[1]) > LARGEST_POWER
        ):
            raise ModelError(
                f"{where}: the exponent of a power must be a constant between -{LARGEST_POWER} and "
                f"{LARGEST_POWER}; write exp(y*log(x)) for x**y with x > 0"
            )

    fold(expression, free_symbols(expression), lambda k: None, constant, apply)


def refuse_jumps(expression: ca.SX, moving: ca.SX, where: str) -> None:
    """Raise ModelError when an expression that will be differentiated by `moving` jumps."""
    jumping = kinks(expression, moving, STEPS)
    if jumping:
        raise ModelError(
            f"{where}: uses {jumping[0]}, which jumps and has no derivative there; only forces and preferred "
            "inputs may jump; fabs, fmin and fmax are continuous, tanh is smooth"
        )


def kinks(expression: ca.SX, variables: ca.SX, kinds: Iterable[int] = KINKS) -> list[str]:
    """Names of the operations of these kinds in `expression` whose arguments depend on `variables`, each
    once.

    A derivative by the variables does not contain what such an operation contributes where it jumps or bends:
    an expression that has one may be nonlinear although its second derivative is zero.
    """
    return list(dict.fromkeys(KINKS[code] for code, _ in _moving(expression, variables) if code in kinds))


def is_polynomial(expression: ca.SX, variables: ca.SX) -> bool:
    """Return whether the expression is written as a polynomial in the variables:
    its derivatives at one place determine it."""
    return all(
        code in POLYNOMIAL or code == ca.OP_DIV and not moves[1]
        for code, moves in _moving(expression, variables)
    )


def _moving(expression: ca.SX, variables: ca.SX) -> list[tuple[int, tuple[bool, ...]]]:
    """The operations that depend on `variables`, each with which of its arguments do."""
    if not (variables.numel() and ca.depends_on(expression, variables)):
        return []
    hashes = {symbol.element_hash() for symbol in ca.symvar(ca.SX(variables))}
    symbols, operations = free_symbols(expression), []

    def apply(code: int, arguments: tuple[bool, ...]) -> bool:
        if any(arguments):
            operations.append((code, arguments))
        return any(arguments)

    fold(expression, symbols, lambda k: symbols[k].element_hash() in hashes, lambda value: False, apply)
    return operations
