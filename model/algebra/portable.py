"""CasADi functions with the same bits on every processor."""

import casadi as ca

from .expression import fold, operate
from .trigonometry import sine_cosine


def portable(function: ca.Function) -> ca.Function:
    """Return the same function (name, arguments, results) with portable sines, cosines and tangents."""
    arguments, shapes = function.sx_in(), [function.size_out(k) for k in range(function.n_out())]
    results = function.call(arguments)
    leaves = [entry for argument in arguments for entry in ca.vertsplit(ca.vec(argument))]
    # By hash; stores the angle too, so that its hash stays unique
    cache: dict[int, tuple[ca.SX, tuple[ca.SX, ca.SX]]] = {}

    def apply(code: int, parts: tuple[ca.SX, ...]) -> ca.SX:
        if code not in (ca.OP_SIN, ca.OP_COS, ca.OP_TAN):
            return operate(code, *parts)
        key = parts[0].element_hash()
        if key not in cache:
            cache[key] = parts[0], sine_cosine(parts[0], ca.floor)
        s, c = cache[key][1]
        return s if code == ca.OP_SIN else c if code == ca.OP_COS else s / c

    entries = iter(
        fold(ca.vertcat(*map(ca.vec, map(ca.densify, results))), leaves, leaves.__getitem__, ca.SX, apply)
    )
    outputs = [
        ca.reshape(ca.vertcat(*[next(entries) for _ in range(rows * columns)]), rows, columns)
        for rows, columns in shapes
    ]
    return ca.Function(function.name(), arguments, outputs, function.name_in(), function.name_out())
