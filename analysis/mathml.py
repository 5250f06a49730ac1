"""Formulas as MathML, which browsers typeset by themselves."""

import html

import sympy as sp
from markupsafe import Markup
from sympy.printing.mathml import MathMLPresentationPrinter

TIMES, SPACE = "\u2062", '<mspace width="0.12em"/>'  # between factors: as the printer puts it, and as it is shown


class _Printer(MathMLPresentationPrinter):
    """Sums as in text, and x_l_dot as x with a dot, its index kept."""

    def _as_ordered_terms(self, expr, order=None):
        return sorted(super()._as_ordered_terms(expr, order), key=lambda term: term.could_extract_minus_sign())

    def _print_Symbol(self, symbol, style="plain"):
        name = symbol.name.removesuffix("_dot")
        made = super()._print_Symbol(sp.Symbol(name), style)
        if name == symbol.name:
            return made
        over, dot = self.dom.createElement("mover"), self.dom.createElement("mo")
        dot.appendChild(self.dom.createTextNode("\u02d9"))
        letter = made.firstChild if made.tagName == "msub" else made
        if made is not letter:
            made.replaceChild(over, letter)
        over.appendChild(letter)
        over.appendChild(dot)
        return over if made is letter else made


def mathml(*parts: sp.Expr | sp.Matrix | str, display: bool = False) -> Markup:
    """Formulas, with signs and words between them, as an element of a page; on a line of its own if `display`."""
    block = ' display="block"' if display else ""
    return Markup(f"<math{block}><mrow>{''.join(map(_part, parts))}</mrow></math>")


def _part(part: sp.Expr | sp.Matrix | str) -> str:
    if isinstance(part, str):
        tag = "mtext" if any(map(str.isalpha, part)) else "mo"
        return f"<{tag}>{html.escape(part)}</{tag}>"
    return _Printer({"mul_symbol": TIMES}).doprint(part).replace("<mo>&#8290;</mo>", SPACE)
