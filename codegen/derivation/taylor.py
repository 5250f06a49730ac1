"""First and second derivatives along a motion by Taylor arithmetic:
each operation returns its value and derivatives."""

from collections.abc import Callable

import casadi as ca

from ...model.algebra.expression import operate

Jet = tuple[ca.SX, ca.SX, ca.SX]  # value, first, second derivative
# first derivative from value and arguments, second derivative from value, first derivative and arguments
Rule = tuple[Callable[..., ca.SX], Callable[..., ca.SX]]


class Taylor:
    """Derivatives of a scalar `outer` of z and parameters, and of its subexpressions, along a motion of z
    with constant zdot.

    `rate`, the first derivative of `outer`, is given and is used wherever it occurs; `shorten` may replace an
    expression by an equal one.
    """

    def __init__(self, outer: ca.SX, z: ca.SX, zdot: ca.SX, rate: ca.SX, shorten: Callable[[ca.SX], ca.SX]):
        self.shorten = shorten
        self._first = {z[k].element_hash(): zdot[k] for k in range(z.numel())}
        self._second = {z[k].element_hash(): ca.SX(0) for k in range(z.numel())}
        self._first[outer.element_hash()] = rate
        while not outer.is_leaf() and outer.op() == ca.OP_SUB and not ca.depends_on(outer.dep(1), z):
            outer = outer.dep(0)  # without an added constant, which does not change the rate
            self._first[outer.element_hash()] = rate

    def first(self, x: ca.SX) -> ca.SX:
        """Return dx/dt."""
        return self._cached(self._first, x, lambda: _rule(x)[0](x, *self._arguments(x, 1)))

    def second(self, x: ca.SX) -> ca.SX:
        """Return d2x/dt2."""
        return self._cached(
            self._second, x, lambda: self.shorten(_rule(x)[1](x, self.first(x), *self._arguments(x, 2)))
        )

    def _cached(self, cache: dict[int, ca.SX], x: ca.SX, derive: Callable[[], ca.SX]) -> ca.SX:
        key = x.element_hash()
        if key not in cache:
            cache[key] = ca.SX(0) if x.is_leaf() else derive()
        return cache[key]

    def _arguments(self, x: ca.SX, order: int) -> list[Jet]:
        arguments = [x.dep(k) for k in range(x.n_dep())]
        return [(a, self.first(a), self.second(a) if order == 2 else ca.SX(0)) for a in arguments]


def _rule(x: ca.SX) -> Rule:
    return RULES.get(x.op()) or _chain_rule(x)


def _chain_rule(x: ca.SX) -> Rule:
    """Return the rule of an operation from its derivatives by CasADi."""
    varying = [k for k in range(x.n_dep()) if not x.dep(k).is_constant()]
    symbols = ca.vertcat(*[ca.SX.sym(f"argument_{k}") for k in varying])
    arguments = [symbols[varying.index(k)] if k in varying else x.dep(k) for k in range(x.n_dep())]
    hessian, gradient = ca.hessian(operate(x.op(), *arguments), symbols)

    def jets(operands: tuple[Jet, ...]) -> list[ca.SX]:
        """Return the values, first and second derivatives of the varying arguments, each as a column."""
        return [ca.vertcat(*[operands[k][order] for k in varying]) for order in range(3)]

    def first(_: ca.SX, *operands: Jet) -> ca.SX:
        value, rate, _ = jets(operands)
        return ca.dot(ca.substitute(gradient, symbols, value), rate)

    def second(_: ca.SX, __: ca.SX, *operands: Jet) -> ca.SX:
        value, rate, change = jets(operands)
        slope, bend = ca.substitute(gradient, symbols, value), ca.substitute(hessian, symbols, value)
        return ca.dot(slope, change) + ca.bilin(bend, rate, rate)

    return first, second


def _quotient_second(x: ca.SX, xdot: ca.SX, a: Jet, b: Jet) -> ca.SX:
    return (a[2] - 2 * xdot * b[1] - x * b[2]) / b[0]


RULES: dict[int, Rule] = {  # shorter than by the chain rule, since they use known values
    ca.OP_ADD: (lambda x, a, b: a[1] + b[1], lambda x, d, a, b: a[2] + b[2]),
    ca.OP_SUB: (lambda x, a, b: a[1] - b[1], lambda x, d, a, b: a[2] - b[2]),
    ca.OP_NEG: (lambda x, a: -a[1], lambda x, d, a: -a[2]),
    ca.OP_TWICE: (lambda x, a: 2 * a[1], lambda x, d, a: 2 * a[2]),
    ca.OP_MUL: (
        lambda x, a, b: a[1] * b[0] + a[0] * b[1],
        lambda x, d, a, b: a[2] * b[0] + 2 * a[1] * b[1] + a[0] * b[2],
    ),
    ca.OP_SQ: (lambda x, a: 2 * a[0] * a[1], lambda x, d, a: 2 * (a[1] ** 2 + a[0] * a[2])),
    ca.OP_DIV: (lambda x, a, b: (a[1] - x * b[1]) / b[0], _quotient_second),
    ca.OP_INV: (lambda x, a: -x * x * a[1], lambda x, d, a: -x * (2 * d * a[1] + x * a[2])),
    ca.OP_SQRT: (lambda x, a: a[1] / (2 * x), lambda x, d, a: (a[2] / 2 - d * d) / x),
    ca.OP_SIN: (lambda x, a: ca.cos(a[0]) * a[1], lambda x, d, a: ca.cos(a[0]) * a[2] - x * a[1] ** 2),
    ca.OP_COS: (lambda x, a: -ca.sin(a[0]) * a[1], lambda x, d, a: -ca.sin(a[0]) * a[2] - x * a[1] ** 2),
}
