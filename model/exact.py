"""Exact simplification: rational functions in canonical form, modulo sin^2 + cos^2 = 1 and sqrt(a)^2 = a.

What cancels is gone, and what does not matter (the heading in S'MS) is found and proved at once. Entries of a matrix that
are equal as rational functions of the same symbols, sines, cosines and roots come out as one expression, K and -K as one
and its negative.
"""

import casadi as ca

from .expression import free_symbols
from .field import Element, Field
from .ratios import NotRational

LARGEST = 400  # operations; above this a canonical form costs more than it brings


def canonical(expression: ca.SX) -> ca.SX:
    """The same matrix, each entry simplified exactly; one that is too large, or would only become longer, stays as it is."""
    expression = ca.SX(expression)
    simplified = ca.SX(expression)
    found: dict[int, Element] = {}
    shortest: dict[object, ca.SX] = {}  # key of the element -> its magnitude
    for k in range(expression.nnz()):
        entry = expression.nz[k]
        if entry.is_constant() or entry.is_symbolic() or ca.n_nodes(entry) > LARGEST:
            continue
        try:
            found[k], magnitude = _simplify(entry)
        except NotRational:
            continue
        known = shortest.setdefault(found[k].key, magnitude)
        if ca.n_nodes(magnitude) < ca.n_nodes(known):
            shortest[found[k].key] = magnitude
    for k, element in found.items():
        simplified.nz[k] = -shortest[element.key] if element.negative else shortest[element.key]
    return ca.sparsify(simplified)


def _simplify(entry: ca.SX) -> tuple[Element, ca.SX]:
    """The entry's element, and its magnitude as an expression: the canonical one, or the entry's own if that is shorter.

    The entry's own is not taken when it has a symbol that does not matter or a pole that cancels.
    """
    field = Field(entry)
    element = field.simplify()
    magnitude = field.expression(element.magnitude)
    own = -entry if element.negative else entry
    clean = not element.cancelled and len(free_symbols(magnitude)) == len(field.symbols)
    return element, own if clean and ca.n_nodes(own) < ca.n_nodes(magnitude) else magnitude
