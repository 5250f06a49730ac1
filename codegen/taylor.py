"""Second derivatives along a motion by Taylor arithmetic: each operation carries its value and two derivatives."""

from collections.abc import Callable

import casadi as ca

from ..model.errors import ModelError

Jet = tuple[ca.SX, ca.SX, ca.SX]  # value, first, second derivative


def second_derivative(outer: ca.SX, z: ca.SX, zdot: ca.SX, rate: ca.SX, shorten: Callable[[ca.SX], ca.SX]) -> ca.SX:
    """zdot' (d2 outer / dz2) zdot, for a scalar `outer` of z and parameters.

    `rate`, the first derivative of `outer`, is known already and is used wherever it appears; `shorten` may replace an
    expression by an equal one. Raises ModelError for a function whose derivatives are not known here.
    """
    known = _known_rates(outer, z, rate)
    zero = ca.SX(0)
    jets: dict[int, Jet] = {z[k].element_hash(): (z[k], zdot[k], zero) for k in range(z.numel())}

    def jet(x: ca.SX) -> Jet:
        key = x.element_hash()
        if key not in jets:
            jets[key] = (x, zero, zero) if x.is_leaf() else derive(x)
        return jets[key]

    def derive(x: ca.SX) -> Jet:
        arguments = [jet(x.dep(k)) for k in range(x.n_dep())]
        if x.op() not in RULES:
            raise ModelError("the second derivative of an output needs a rule for each function in it; use + - * / sqrt sin cos")
        first, second = RULES[x.op()]
        xdot = known.get(x.element_hash(), first(x, *arguments))
        return x, xdot, shorten(second(x, xdot, *arguments))

    return jet(outer)[2]


def _known_rates(outer: ca.SX, z: ca.SX, rate: ca.SX) -> dict[int, ca.SX]:
    """The expressions whose first derivative is `rate`: the outermost and what it differs from by a constant."""
    known = {outer.element_hash(): rate}
    while not outer.is_leaf() and outer.op() == ca.OP_SUB and not ca.depends_on(outer.dep(1), z):
        outer = outer.dep(0)
        known[outer.element_hash()] = rate
    return known


def _quotient_second(x: ca.SX, xdot: ca.SX, a: Jet, b: Jet) -> ca.SX:
    return (a[2] - 2 * xdot * b[1] - x * b[2]) / b[0]


# operation -> (first derivative from value and arguments, second derivative from value, first derivative and arguments)
RULES: dict[int, tuple[Callable[..., ca.SX], Callable[..., ca.SX]]] = {
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
