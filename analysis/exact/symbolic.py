"""Exact conversion of CasADi's expressions to SymPy's: finds the exact value of each number in a model."""

import math
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction

import casadi as ca
import sympy as sp
from sympy.printing.str import StrPrinter

from ...model.algebra.expression import fold, operate
from ...model.algebra.ratios import DIGITS, SIMPLE, ULPS
from ...model.errors import ModelError
from ...model.mechanism import Quantity

NOT_EXACT = "cannot be treated exactly; use +, -, *, /, powers, sqrt, sin, cos, tan, exp"
RADICAND = 1000  # denominator of a fraction whose root is recognized

FUNCTIONS: Mapping[int, Callable[..., sp.Expr]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: lambda a, b: a + b,
    ca.OP_SUB: lambda a, b: a - b,
    ca.OP_MUL: lambda a, b: a * b,
    ca.OP_DIV: lambda a, b: a / b,
    ca.OP_NEG: lambda a: -a,
    ca.OP_SQ: lambda a: a**2,
    ca.OP_TWICE: lambda a: 2 * a,
    ca.OP_INV: lambda a: 1 / a,
    ca.OP_POW: lambda a, b: a**b,
    ca.OP_CONSTPOW: lambda a, b: a**b,
    ca.OP_SQRT: sp.sqrt,
    ca.OP_SIN: sp.sin,
    ca.OP_COS: sp.cos,
    ca.OP_TAN: lambda a: sp.sin(a) / sp.cos(a),
    ca.OP_EXP: sp.exp,
    ca.OP_SINH: lambda a: (sp.exp(a) - sp.exp(-a)) / 2,
    ca.OP_COSH: lambda a: (sp.exp(a) + sp.exp(-a)) / 2,
    ca.OP_TANH: lambda a: (sp.exp(a) - sp.exp(-a)) / (sp.exp(a) + sp.exp(-a)),
    ca.OP_FABS: sp.Abs,
}


def symbol(quantity: Quantity) -> sp.Symbol:
    """Return the SymPy symbol of a coordinate or parameter: real, and positive if declared so."""
    return (
        sp.Symbol(quantity.name, positive=True)
        if quantity.sign == "positive"
        else sp.Symbol(quantity.name, real=True)
    )


def as_matrix(entries: Sequence[sp.Expr], shape: tuple[int, int]) -> sp.Matrix:
    """Return a matrix from its entries, column-major."""
    return sp.Matrix(shape[1], shape[0], entries).T


def symbolic(expression: ca.SX, quantities: Sequence[Quantity], where: str) -> list[sp.Expr]:
    """Return the entries of `expression`, column-major, in the symbols of `quantities`.

    A number is replaced by the simplest fraction, multiple of pi or root of a fraction equal to it up to
    rounding. Raises ModelError for other numbers, a division by zero, and a function that cannot be treated
    exactly.
    """

    def constant(value: float) -> sp.Expr:
        if not math.isfinite(value):
            raise ModelError(f"{where}: a division by zero, or a number that is none")
        number = recognized(value)
        if number is None:
            raise ModelError(
                f"{where}: {value!r} is no simple fraction, multiple of pi or root, so nothing exact follows "
                "from it; give it as a parameter"
            )
        return number

    def apply(code: int, arguments: tuple[sp.Expr, ...]) -> sp.Expr:
        if code not in FUNCTIONS:
            text = operate(code, *[ca.SX.sym("ab"[k]) for k in range(len(arguments))])
            raise ModelError(f"{where}: {text} {NOT_EXACT}")
        return FUNCTIONS[code](*arguments)

    leaves = [symbol(q) for q in quantities]
    entries = [
        sp.S(e)
        for e in fold(expression, [q.symbol for q in quantities], lambda k: leaves[k], constant, apply)
    ]
    if any(entry.has(sp.zoo, sp.nan, sp.oo, sp.I) for entry in entries):
        raise ModelError(f"{where}: a division by zero, or the root of a negative number")
    return entries


def recognized(value: float) -> sp.Expr | None:
    """Return the exact value of a float: a fraction, a multiple of pi, or a root of a fraction;
    None for other numbers."""
    for unit in (1.0, math.pi):
        fraction = _fraction(value / unit, SIMPLE if unit == 1.0 else RADICAND)
        if fraction is not None:
            return sp.Rational(fraction.numerator, fraction.denominator) * (1 if unit == 1.0 else sp.pi)
    if len(repr(value).split("e")[0].replace(".", "").strip("-0")) <= DIGITS:
        written = Fraction(repr(value))
        return sp.Rational(written.numerator, written.denominator)
    square = _fraction(value * value, RADICAND)
    return (
        None
        if square is None
        else sp.sqrt(sp.Rational(square.numerator, square.denominator)) * (1 if value > 0 else -1)
    )


def _fraction(value: float, denominator: int) -> Fraction | None:
    fraction = Fraction(value).limit_denominator(denominator)
    return fraction if abs(fraction - Fraction(value)) <= ULPS * Fraction(math.ulp(value)) else None


class _Writer(StrPrinter):
    """SymPy's printer with positive terms first, and r*(a - b) instead of -r*(b - a)."""

    def _print_Add(self, expr: sp.Add, order: str | None = None) -> str:  # SymPy's name
        terms = sorted(
            self._as_ordered_terms(expr, order=order), key=lambda term: term.could_extract_minus_sign()
        )
        first, *rest = [self._print(term) for term in terms]
        return first + "".join(f" - {text[1:]}" if text.startswith("-") else f" + {text}" for text in rest)

    def _print_Mul(self, expr: sp.Mul) -> str:  # noqa: N802
        sums = [factor for factor in expr.args if factor.is_Add and 2 * _minuses(factor) >= len(factor.args)]
        if expr.could_extract_minus_sign() and sums:
            turned = sp.Add(*[-term for term in sums[0].args])
            expr = sp.Mul(-1, turned, *[factor for factor in expr.args if factor is not sums[0]])
        return super()._print_Mul(expr)


def _minuses(total: sp.Add) -> int:
    return sum(term.could_extract_minus_sign() for term in total.args)


def written(expression: sp.Expr) -> str:
    """Return the expression as readable text in SymPy syntax."""
    return _Writer().doprint(expression)
