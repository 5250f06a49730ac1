"""Canonical forms of single expressions.

Sines and cosines of sums are also expanded by the addition theorems, because sin(a + b) and sin(a) are
independent otherwise.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from .expression import fold, free_symbols, operate
from .field import CanonicalForm, Field
from .known import Known
from .ratios import NotRational

_Fraction = tuple[ca.SX, ca.SX]
LARGEST = 400  # operations; above this, a canonical form costs more than it saves


def examined(entry: ca.SX, symbols: list[ca.SX]) -> Known:
    """Return what is to be known of an entry."""
    rewritten = _without_quotients_below(entry) if _divides_by_quotient(entry) else None
    entry = entry if rewritten is None else rewritten
    if entry.is_leaf() or ca.n_nodes(entry) > LARGEST:
        return Known(symbols, rewritten)
    try:
        element, magnitude = _simplify(entry)
    except NotRational:
        return Known(symbols, rewritten)
    is_own = ca.is_equal(magnitude, -entry if element.negative else entry, 1)
    hashes = [symbol.element_hash() for symbol in symbols]
    form = tuple(hashes.index(symbol.element_hash()) for symbol in element.symbols), element.text
    return Known(symbols, rewritten, form, element.negative, None if is_own else magnitude)


def _simplify(entry: ca.SX) -> tuple[CanonicalForm, ca.SX]:
    """Return the entry's element, and its magnitude as an expression: the canonical one, or the entry's own
    if that is shorter.

    The entry's own form is not used if it contains a symbol without effect or a removable pole. It is used if
    the canonical form has a pole where the entry has none: 1 / (1 + sin) is (1 - sin) / cos^2, but not where
    the sine is 1.
    """
    tried = [_tried(way) for way in (entry, by_addition_theorems(entry)) if way is not None]
    as_written, *expanded = tried
    if as_written is None and expanded and expanded[0] and _cost(expanded[0][1]) > _cost(entry):
        raise NotRational
    forms = [pair for pair in tried if pair]
    if not forms:
        raise NotRational
    return min(forms, key=lambda pair: _cost(pair[1]))


def _tried(entry: ca.SX) -> tuple[CanonicalForm, ca.SX] | None:
    """Return the result of `_as_written`, or None for an entry that is too large."""
    if ca.n_nodes(entry) > LARGEST:
        return None
    try:
        return _as_written(entry)
    except NotRational:
        return None


def _as_written(entry: ca.SX) -> tuple[CanonicalForm, ca.SX]:
    """As `_simplify`, treating sines and cosines of different arguments as independent."""
    field = Field(entry)
    element = field.simplify()
    magnitude = field.expression(element.magnitude)
    own = -entry if element.negative else entry
    clean = not element.cancelled and len(free_symbols(magnitude)) == len(field.symbols)
    return element, own if element.pole or clean and ca.n_nodes(own) < ca.n_nodes(magnitude) else magnitude


def _divides_by_quotient(entry: ca.SX) -> bool:
    """Return whether an entry divides somewhere by a quotient with a divisor that is not constant,
    or by its multiple."""
    stack, visited = [(entry, False)], set()
    while stack:
        node, below = stack.pop()
        if node.is_leaf() or (node.element_hash(), below) in visited:
            continue
        visited.add((node.element_hash(), below))
        code, parts = node.op(), [node.dep(k) for k in range(node.n_dep())]
        divides = code in (ca.OP_DIV, ca.OP_INV)
        if below and divides and not parts[-1].is_constant():
            return True
        factor = below and code in (ca.OP_MUL, ca.OP_DIV, ca.OP_SQ, ca.OP_NEG, ca.OP_TWICE)
        stack += [(part, factor or divides and part is parts[-1]) for part in parts]
    return False


def _without_quotients_below(entry: ca.SX) -> ca.SX:
    """Return the entry with a c / b for a / (b / c), whose value may be right where c = 0,
    but not its derivatives."""
    symbols = free_symbols(entry)

    def apply(code: int, parts: tuple[_Fraction, ...]) -> _Fraction:
        (top, bottom), *others = parts
        if code in (ca.OP_MUL, ca.OP_DIV):
            ((above, below),) = others if code == ca.OP_MUL else [others[0][::-1]]
            return top * above, bottom * below
        if code == ca.OP_INV:
            return bottom, top
        if code in (ca.OP_NEG, ca.OP_TWICE):
            return operate(code, top), bottom
        if code == ca.OP_SQ:
            return top**2, bottom**2
        return operate(code, *[top / bottom for top, bottom in parts]), ca.SX(1)

    ((top, bottom),) = fold(
        entry, symbols, lambda k: (symbols[k], ca.SX(1)), lambda value: (ca.SX(value), ca.SX(1)), apply
    )
    return top / bottom


def _cost(expression: ca.SX) -> tuple[int, int]:
    return len(free_symbols(expression)), ca.n_nodes(expression)


def by_addition_theorems(entry: ca.SX) -> ca.SX | None:
    """Return the entry with sines and cosines of sums and integer multiples of symbols expanded;
    None if there are none."""
    symbols = free_symbols(entry)
    expanded = False

    def apply(code: int, parts: tuple[_Sum, ...]) -> _Sum:
        nonlocal expanded
        if code in (ca.OP_SIN, ca.OP_COS, ca.OP_TAN) and parts[0].terms is not None and parts[0].count > 1:
            expanded = True
            cosine, sine = _circle(symbols, parts[0].terms)
            return _Sum({ca.OP_SIN: sine, ca.OP_COS: cosine}.get(code, sine / cosine))
        terms = parts[0].combined(code, *parts[1:])
        return _Sum(operate(code, *[part.expression for part in parts]), terms)

    (whole,) = fold(
        entry, symbols, lambda k: _Sum(symbols[k], {k: 1}), lambda value: _Sum(ca.SX(value)), apply
    )
    return whole.expression if expanded else None


@dataclass(frozen=True)
class _Sum:
    """An expression; if it is a sum of integer multiples of symbols, also these,
    by the index of the symbol."""

    expression: ca.SX
    terms: Mapping[int, int] | None = None

    @property
    def count(self) -> int:
        """Return the number of terms, counting multiplicities; 0 if it is not such a sum."""
        return sum(map(abs, (self.terms or {}).values()))

    def combined(self, code: int, *others: "_Sum") -> Mapping[int, int] | None:
        """Return the terms after an operation."""
        terms = [each.terms for each in (self, *others) if each.terms is not None]
        if len(terms) <= len(others):
            return None
        first, *rest = terms
        if code in (ca.OP_ADD, ca.OP_SUB):
            sign, (other,) = 1 if code == ca.OP_ADD else -1, rest
            places = dict.fromkeys([*first, *other])
            return {k: first.get(k, 0) + sign * other.get(k, 0) for k in places}
        if code in (ca.OP_NEG, ca.OP_TWICE):
            return {k: (-1 if code == ca.OP_NEG else 2) * multiple for k, multiple in first.items()}
        return None


def _circle(symbols: Sequence[ca.SX], terms: Mapping[int, int]) -> tuple[ca.SX, ca.SX]:
    """Return cosine and sine of a sum."""
    cosine, sine = ca.SX(1), ca.SX(0)
    for k, multiple in terms.items():
        c, s = ca.cos(symbols[k]), ca.sin(symbols[k]) * (1 if multiple > 0 else -1)
        for _ in range(abs(multiple)):
            cosine, sine = cosine * c - sine * s, sine * c + cosine * s
    return cosine, sine
