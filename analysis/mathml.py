"""Formulas as MathML, which browsers typeset by themselves."""

import html
from itertools import pairwise

import sympy as sp
from markupsafe import Markup
from sympy.printing.mathml import MathMLPresentationPrinter

# Between factors: as the printer puts it, and as it is shown
TIMES, SPACE = "\u2062", '<mspace width="0.12em"/>'
KEPT = "\u00a0"  # a space that is kept at the ends of words


class _Printer(MathMLPresentationPrinter):
    """Sums as in text, and x_l_dot as x with a dot, its index kept."""

    def _as_ordered_terms(self, expr, order=None):
        return sorted(
            super()._as_ordered_terms(expr, order), key=lambda term: term.could_extract_minus_sign()
        )

    def _print_Symbol(self, symbol, style="plain"):
        name = symbol.name.removesuffix("_dot")
        element = super()._print_Symbol(sp.Symbol(name), style)
        if name == symbol.name:
            return element
        over, dot = self.dom.createElement("mover"), self.dom.createElement("mo")
        dot.appendChild(self.dom.createTextNode("\u02d9"))
        letter = element.firstChild if element.tagName == "msub" else element
        if element is not letter:
            element.replaceChild(over, letter)
        over.appendChild(letter)
        over.appendChild(dot)
        return over if element is letter else element


def mathml(*parts: sp.Expr | sp.Matrix | str, display: bool = False) -> Markup:
    """Formulas, with signs and words between them, as an element of a page;
    on a line of its own if `display`."""
    block = ' display="block"' if display else ""
    rows = (
        _part(part, k > 0, isinstance(after, sp.Basic | sp.MatrixBase))
        for k, (part, after) in enumerate(pairwise((*parts, "")))
    )
    return Markup(f"<math{block}><mrow>{''.join(rows)}</mrow></math>")


def _part(part: sp.Expr | sp.Matrix | str, after: bool, before: bool) -> str:
    """A formula, sign or words, these `after` or `before` a formula with a space that MathML keeps."""
    if not isinstance(part, str):
        return _Printer({"mul_symbol": TIMES}).doprint(part).replace("<mo>&#8290;</mo>", SPACE)
    if any(map(str.isalpha, part)):
        return f"<mtext>{KEPT * after}{html.escape(part)}{KEPT * before}</mtext>"
    return f"<mo>{html.escape(part)}</mo>"
