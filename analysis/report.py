"""The result of `noslip analyse` as a self-contained HTML page."""

import math
import re
from collections.abc import Iterable

import numpy as np
import sympy as sp
from markupsafe import Markup, escape

from .. import __version__
from ..readers.glossary import meanings
from ..readers.templates import render
from .answers import Answer, Constraints, damped_near, driven_straight, uncontrolled
from .certification.safety import SAFE, SINGULAR, Verdict
from .mathml import mathml
from .outputs.normal_form import SYMBOLS, NormalForm
from .text import VERDICTS, WORDS

INK, SOFT, OLD, NEW, HOLD, BAD, GOOD = (
    "#1a1a1a",
    "#777777",
    "#c9d9e8",
    "#0b61a4",
    "#f3e3d3",
    "#c00000",
    "#1b6e3c",
)
BREAK = Markup("<br>")


def report(answer: Answer) -> str:
    """The page."""
    legend = {
        name: about
        for form in answer.outputs.values()
        for each in form.moving
        for name, about in each.symbols.items()
    }
    return render(
        __file__,
        "report.html",
        answer=answer,
        growth=_growth(answer.constraints),
        straight=[_typeset(line) for line in driven_straight(answer)] if answer.outputs else [],
        legend=[(_symbol(name), about) for name, about in legend.items()],
        normal_form=_normal_form,
        course=_course,
        math=mathml,
        symbol=_symbol,
        symbol_of=sp.Symbol,
        s_is=SYMBOLS["s"].format(s="s"),
        verdicts=VERDICTS,
        marks={True: "✓", False: "✗", None: "?"},
        safe=SAFE,
        singular=SINGULAR,
        br=BREAK,
        words={name: meaning for word in WORDS for name, meaning in meanings(word).items()},
        version=__version__,
    )


def _normal_form(form: NormalForm) -> list[tuple[str, str]]:
    """The rows of an output's table: where it is singular, its coordinates, its zero dynamics."""
    decoupling, z3 = form.decoupling, Markup("z<sub>3</sub>′")
    conditions = [
        Markup("{}{}{}").format(c.words, ": " if c.words else "", mathml(c.formula, "=", sp.Integer(0)))
        for c in decoupling.conditions
    ]
    z = [Markup(" , ").join(map(_symbol, names)) for names in form.T]
    rows = [
        ("singular", BREAK.join(conditions or ["nowhere"])),
        ("damped", BREAK.join(damped_near(form))),
        (
            "not defined",
            BREAK.join(
                mathml("where", expression, "=", sp.Integer(0)) for expression in decoupling.undefined
            ),
        ),
        (
            "T(x)",
            BREAK.join(Markup("z<sub>{}</sub> = ({})").format(k + 1, names) for k, names in enumerate(z)),
        ),
        ("regular", _regular(form.charts[0].minor)),
        (
            z3,
            BREAK.join(mathml(sp.Symbol(f"{name}_dot"), "=", rate) for name, rate in form.equations.items()),
        ),
        ("zero dynamics", _typeset(uncontrolled(form))),
        ("reference at speed V", BREAK.join(_typeset(str(each)) for each in form.moving)),
    ]
    return [row for row in rows if row[1]]


def _typeset(text: str) -> Markup:
    """Text with its names that have an index, such as theta_r, as in the formulas."""
    parts = re.split(r"\b([A-Za-z]+_\w+|phi|psi|chi)\b", text)
    return Markup("").join(_symbol(part) if k % 2 else escape(part) for k, part in enumerate(parts))


def _regular(minor: sp.Expr) -> Markup:
    """Where the coordinates are regular; a constant minor is no condition."""
    nonzero = (sp.Symbol("Phi"), "≠", sp.Integer(0))
    return (
        mathml("where det", *nonzero)
        if minor.is_number
        else mathml("where", minor, "≠", sp.Integer(0), "and det", *nonzero)
    )


def _symbol(name: str) -> Markup:
    return mathml(sp.Symbol(name))


# -- drawings ------------------------------------------------------------------------------------------------


def _growth(constraints: Constraints) -> Markup:
    """A column of boxes for each step: what was there, what the new brackets add,
    and above it what integrates."""
    wide, tall, left = max(170, 8 * max(len(name) for level in constraints.levels for name in level)), 34, 46
    width, height = left + len(constraints.growth) * (wide + 16) + 10, constraints.n * tall + 44
    drawn, below = [], height - 30
    for step, dimension in enumerate(constraints.growth):
        x = left + step * (wide + 16)
        names = [name for level in constraints.levels[: step + 1] for name in level]
        new = constraints.growth[step - 1] if step else 0
        for k in range(constraints.n):
            y = below - (k + 1) * tall
            if k < dimension:
                fill, ink = (NEW, "white") if k >= new else (OLD, INK)
                drawn.append(_box(x, y, wide, tall - 4, fill))
                drawn.append(_label(x + wide / 2, y + tall / 2 + 3, names[k], ink))
            elif step == len(constraints.growth) - 1:
                drawn.append(_box(x, y, wide, tall - 4, HOLD, dashed=True))
                drawn.append(_label(x + wide / 2, y + tall / 2 + 3, "holonomic", SOFT))
        drawn.append(_label(x + wide / 2, height - 8, f"step {step + 1}: dimension {dimension}", INK))
    top = below - constraints.n * tall
    drawn.append(
        f'<line x1="{left - 10}" y1="{top - 2}" x2="{width}" y2="{top - 2}" stroke="{SOFT}" '
        'stroke-dasharray="5 4"/>'
    )
    drawn.append(_label(left - 28, top + 4, f"n = {constraints.n}", SOFT))
    return _svg(width, height, drawn, "growth of the distribution, step by step")


def _course(verdict: Verdict) -> Markup:
    """s over t between -1 and 1."""
    width, height, left, right, top, bottom = 720, 240, 52, 20, 16, 36
    t, s = verdict.course
    end = float(t[-1])

    def x(value: float) -> float:
        return left + (width - left - right) * value / end

    def y(value: float) -> float:
        return top + (height - top - bottom) * (1.15 - value) / 2.3

    places = np.unique(np.linspace(0, len(t) - 1, 600).astype(int))
    line = " ".join(f"{x(t[k]):.1f},{y(s[k]):.1f}" for k in places)
    drawn = [_box(left, y(1), width - left - right, y(-1) - y(1), "#eef4ee")]
    for value, look in (
        (1, f'"{BAD}" stroke-dasharray="6 4"'),
        (0, '"#cccccc"'),
        (-1, f'"{BAD}" stroke-dasharray="6 4"'),
    ):
        drawn.append(
            f'<line x1="{left}" y1="{y(value):.1f}" x2="{width - right}" y2="{y(value):.1f}" stroke={look}/>'
        )
    drawn += [_label(left - 8, y(value) + 4, f"{value:g}", INK, "end") for value in (-1, 0, 1)]
    drawn += [_label(x(value), height - bottom + 18, f"{value:g}", INK) for value in _ticks(end)]
    drawn.append(_label(width - right, height - 4, "t (s)", SOFT, "end"))
    drawn.append(_label(left - 34, y(0) + 4, "s", SOFT))
    drawn.append(f'<polyline points="{line}" fill="none" stroke="{NEW}" stroke-width="2"/>')
    colour = {SINGULAR: BAD, SAFE: GOOD}.get(verdict.kind, SOFT)
    drawn.append(f'<circle cx="{x(end):.1f}" cy="{y(s[-1]):.1f}" r="4" fill="{colour}"/>')
    return _svg(width, height, drawn, "s over time; singular at 1 and -1")


def _ticks(end: float) -> list[float]:
    step = 10 ** math.floor(math.log10(end))
    step = next(size for size in (step / 5, step / 2, step, 2 * step) if end / size <= 8)
    return [round(k * step, 12) for k in range(int(end / step) + 1)]


def _svg(width: float, height: float, drawn: Iterable[str], about: str) -> Markup:
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" width="{width:g}" '
        'role="img"'
    )
    return Markup(
        f'{head} font-family="system-ui, sans-serif" '
        f'font-size="13"><title>{about}</title>{"".join(drawn)}</svg>'
    )


def _box(x: float, y: float, width: float, height: float, fill: str, dashed: bool = False) -> str:
    edge = f' stroke="{SOFT}" stroke-dasharray="4 3"' if dashed else ""
    return (
        f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" rx="3" '
        f'fill="{fill}"{edge}/>'
    )


def _label(x: float, y: float, text: str, fill: str, anchor: str = "middle") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" fill="{fill}" text-anchor="{anchor}">{escape(text)}</text>'
