"""Exact simplification: rational functions in canonical form, modulo sin^2 + cos^2 = 1 and sqrt(a)^2 = a.

Common factors cancel, and symbols without effect (such as the heading in S'MS) disappear with proof. Entries of a matrix that are
equal as rational functions of the same symbols, sines, cosines and roots become the same expression, and K and -K one expression
and its negative.
"""

from typing import TYPE_CHECKING

import casadi as ca

from .expression import free_symbols

if TYPE_CHECKING:  # slow to import, as `entries` is: by way of SymPy
    from .entries import Known
    from .field import CanonicalForm

REMEMBERED = 50_000  # entries whose forms are remembered


def canonical(expression: ca.SX) -> ca.SX:
    """Return the same matrix with each entry simplified exactly; an entry that is too large or would become longer is
    unchanged.
    """
    expression = ca.SX(expression)
    simplified = ca.SX(expression)
    elements: dict[int, CanonicalForm] = {}
    shortest: dict[object, ca.SX] = {}  # key of the element -> its magnitude
    for k in range(expression.nnz()):
        simplified.nz[k], element, magnitude = _simplified(expression.nz[k])
        if element is None:
            continue
        elements[k] = element
        current = shortest.setdefault(element.key, magnitude)
        if ca.n_nodes(magnitude) < ca.n_nodes(current):
            shortest[element.key] = magnitude
    for k, element in elements.items():
        simplified.nz[k] = -shortest[element.key] if element.negative else shortest[element.key]
    return ca.sparsify(simplified)


_known: dict[tuple[str, tuple[int, ...]], "Known"] = {}  # by operations and symbols: the laws of a robot have many in common


def _simplified(entry: ca.SX) -> tuple[ca.SX, "CanonicalForm | None", ca.SX]:
    """Return the entry without quotients below, its element, None if it has none, and its magnitude.

    Computed once for each expression in the same symbols. What is the entry's own is returned as the nodes of this entry, so that
    the result does not depend on what was computed before.
    """
    if entry.is_leaf():
        return entry, None, entry
    symbols = free_symbols(entry)
    key = entry.serialize(), tuple(symbol.element_hash() for symbol in symbols)
    known = _known.get(key)
    if known is None:
        if len(_known) >= REMEMBERED:
            _known.clear()
        from .entries import examined  # imports SymPy, which takes long: not before there is something to simplify

        known = _known[key] = examined(entry, symbols)
    entry = entry if known.rewritten is None else known.rewritten
    own = -entry if known.element and known.element.negative else entry
    return entry, known.element, own if known.magnitude is None else known.magnitude
