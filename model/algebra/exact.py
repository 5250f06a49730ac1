"""Exact simplification: rational functions in canonical form, modulo sin^2 + cos^2 = 1 and sqrt(a)^2 = a.

Common factors cancel, and symbols without effect (such as the heading in S'MS) disappear with proof. Entries
of a matrix that are equal as rational functions of the same symbols, sines, cosines and roots become the same
expression, and K and -K one expression and its negative.
"""

import casadi as ca

from .expression import free_symbols
from .known import Known, Store, known_of

REMEMBERED = 50_000  # entries whose forms are remembered


def canonical(expression: ca.SX) -> ca.SX:
    """Return the same matrix with each entry simplified exactly; an entry that is too large or would become
    longer is unchanged.
    """
    expression = ca.SX(expression)
    simplified = ca.SX(expression)
    elements: dict[int, tuple[object, bool]] = {}  # key and sign
    shortest: dict[object, ca.SX] = {}  # key -> its magnitude
    for k in range(expression.nnz()):
        simplified.nz[k], known, magnitude = _simplified(expression.nz[k])
        if known is None or (key := known.key) is None:
            continue
        elements[k] = key, known.negative
        current = shortest.setdefault(key, magnitude)
        if ca.n_nodes(magnitude) < ca.n_nodes(current):
            shortest[key] = magnitude
    for k, (key, negative) in elements.items():
        simplified.nz[k] = -shortest[key] if negative else shortest[key]
    return ca.sparsify(simplified)


# By operations and symbols: the laws of a robot have many in common
_known: dict[tuple[str, tuple[int, ...]], Known] = {}
_stores: list[Store] = []  # of other runs, at most one


def keep_in(store: Store) -> None:
    """Keep what is found of each entry for other runs, and use what they found."""
    _stores[:] = [store]


def read(key: str) -> str | None:
    """Return what another run wrote for a key; None if none did."""
    return next((text for store in _stores if (text := store.read(key))), None)


def write(key: str, text: str) -> None:
    """Write a text for a key, for other runs."""
    for store in _stores:
        store.write(key, text)


def _simplified(entry: ca.SX) -> tuple[ca.SX, Known | None, ca.SX]:
    """Return the entry without quotients below, what is known of it, None of a leaf, and its magnitude.

    Computed once for each expression in the same symbols. What is the entry's own is returned as the nodes of
    this entry, so that the result does not depend on what was computed before.
    """
    if entry.is_leaf():
        return entry, None, entry
    symbols = free_symbols(entry)
    operations = entry.serialize()
    key = operations, tuple(symbol.element_hash() for symbol in symbols)
    known = _known.get(key)
    if known is None:
        if len(_known) >= REMEMBERED:
            _known.clear()
        known = _known[key] = _found(entry, operations, symbols)
    entry = entry if known.rewritten is None else known.rewritten
    own = -entry if known.negative else entry
    return entry, known, own if known.magnitude is None else known.magnitude


def _found(entry: ca.SX, operations: str, symbols: list[ca.SX]) -> Known:
    """Return what another run found of an entry, or find it."""
    if text := read(operations):
        return known_of(text, symbols)
    # Imports SymPy, which takes long: not before there is something to simplify
    from .entries import examined

    known = examined(entry, symbols)
    write(operations, known.text())
    return known
