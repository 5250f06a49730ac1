"""Traversal of CasADi expressions: the list of scalar operations of a set of SX outputs."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import casadi as ca

Value = TypeVar("Value")


class ScalarOperation(NamedTuple):
    """One scalar operation `code` (a casadi.OP_* number) on earlier `values`;
    `result` is its index in the work vector."""

    code: int
    arguments: tuple[int, ...]
    result: int
    constant: float = 0.0


def operations(function: ca.Function) -> Iterator[ScalarOperation]:
    """Yield the operations of an SX function in order of execution,
    with the indices assigned by CasADi (which are reused)."""
    for k in range(function.n_instructions()):
        code = function.instruction_id(k)
        if code == ca.OP_CONST:
            yield ScalarOperation(
                code, (), function.instruction_output(k)[0], function.instruction_constant(k)
            )
        elif code == ca.OP_OUTPUT:
            yield ScalarOperation(
                code, tuple(function.instruction_input(k)), function.instruction_output(k)[1]
            )
        elif code == ca.OP_INPUT:
            yield ScalarOperation(
                code, (function.instruction_input(k)[1],), function.instruction_output(k)[0]
            )
        else:
            arguments = tuple(function.instruction_input(k))
            yield ScalarOperation(code, arguments, function.instruction_output(k)[0])


def fold(
    outputs: ca.SX,
    symbols: Sequence[ca.SX],
    leaf: Callable[[int], Value],
    constant: Callable[[float], Value],
    apply: Callable[[int, tuple[Value, ...]], Value],
) -> list[Value]:
    """Evaluate the dense entries (column-major) of `outputs` in another algebra.

    `leaf(k)` is the value of symbols[k], `constant` that of a number, `apply` that of one operation.
    """
    dense = ca.densify(ca.vec(outputs))
    function = ca.Function("walk", [ca.vertcat(*symbols)], [dense])
    work: dict[int, Value] = {}
    results: list[Value] = [constant(0.0)] * dense.numel()
    for code, arguments, result, number in operations(function):
        if code == ca.OP_CONST:
            work[result] = constant(number)
        elif code == ca.OP_INPUT:
            work[result] = leaf(arguments[0])
        elif code == ca.OP_OUTPUT:
            results[result] = work[arguments[0]]
        else:
            work[result] = apply(code, tuple([work[a] for a in arguments]))
    return results


def operate(code: int, *arguments: ca.SX) -> ca.SX:
    """Return the result of one scalar operation, given by its casadi.OP_* number."""
    return ca.SX.unary(code, *arguments) if len(arguments) == 1 else ca.SX.binary(code, *arguments)


def largest(expression: ca.SX) -> ca.SX:
    """Return a bound of the absolute value of each entry, in which no terms cancel and sines and cosines
    are 1. Divisors keep their values.
    """

    def apply(code: int, arguments: tuple[tuple[ca.SX, ca.SX], ...]) -> tuple[ca.SX, ca.SX]:
        values, bounds = zip(*arguments, strict=True)
        value = operate(code, *values)
        if code in (ca.OP_SIN, ca.OP_COS):
            return value, ca.SX(1)
        if code in (ca.OP_ADD, ca.OP_SUB):
            return value, bounds[0] + bounds[1]
        if code in (ca.OP_MUL, ca.OP_SQ, ca.OP_TWICE, ca.OP_SQRT):
            return value, operate(code, *bounds)
        if code == ca.OP_DIV:
            return value, bounds[0] / ca.fabs(values[1])
        return value, bounds[0] if code == ca.OP_NEG else ca.fabs(value)

    symbols = free_symbols(expression)
    pairs = fold(
        expression,
        symbols,
        lambda k: (symbols[k], ca.fabs(symbols[k])),
        lambda x: (ca.SX(x), ca.SX(abs(x))),
        apply,
    )
    return ca.reshape(ca.vertcat(*[bound for _, bound in pairs]), expression.shape)


def free_symbols(expression: ca.SX) -> list[ca.SX]:
    """Return the symbols on which `expression` depends, each once."""
    return ca.symvar(expression)


def as_text(expression: ca.SX) -> str:
    """Shape, symbols and operations of an expression, constants to their last bit;
    CasADi's own text has six digits of them."""
    symbols, dense = free_symbols(expression), ca.densify(expression)
    function = ca.Function("walk", [ca.vertcat(*symbols)], [ca.vec(dense)])
    steps = [f"{o.code} {o.arguments} {o.result} {o.constant!r}" for o in operations(function)]
    return "\n".join([f"{dense.shape} {symbols}", *steps])


def degree(expression: ca.SX, variables: ca.SX) -> float:
    """Return the degree of an expression (the largest of a matrix's entries) as a polynomial in `variables`,
    from its structure.

    The degree is infinite for expressions that are not written as polynomials, such as fabs(v), sqrt(v),
    fmax(v, 0) or 1/v. Derivatives would not show this: they vanish almost everywhere for functions with
    corners or steps. The degree is an upper bound, because terms may cancel.
    """
    chosen = {variables.nz[k].element_hash() for k in range(variables.nnz())}
    symbols = free_symbols(expression)
    degrees = fold(
        expression,
        symbols,
        lambda k: _Power(int(symbols[k].element_hash() in chosen)),
        lambda value: _Power(0, value),
        _power_of_result,
    )
    return max((each.degree for each in degrees), default=0)


@dataclass(frozen=True)
class _Power:
    """The degree of an expression, and its `value` if it is a number."""

    degree: float
    value: float = math.nan


def _power_of_result(code: int, arguments: tuple[_Power, ...]) -> _Power:
    first, last = arguments[0].degree, arguments[-1].degree
    if code in (ca.OP_ADD, ca.OP_SUB, ca.OP_NEG, ca.OP_TWICE, ca.OP_ASSIGN):
        return _Power(max(first, last))
    if code == ca.OP_SQ:
        return _Power(2 * first)
    if code == ca.OP_MUL or (code == ca.OP_IF_ELSE_ZERO and not first):
        return _Power(first + last)
    if code == ca.OP_DIV and not last:
        return _Power(first)
    if code in (ca.OP_POW, ca.OP_CONSTPOW) and arguments[-1].value >= 0 and arguments[-1].value.is_integer():
        return _Power(first * arguments[-1].value if first else 0)
    return _Power(math.inf if any(each.degree for each in arguments) else 0)


def time_derivative(expression: ca.SX, variables: ca.SX, rates: ca.SX) -> ca.SX:
    """Return d/dt of `expression` (any shape) for `variables` with these rates:
    (d expression / d variables) rates."""
    return ca.reshape(ca.jtimes(ca.vec(expression), variables, rates), expression.shape)
