"""The result of `noslip analyse` as a self-contained HTML page."""

import html
import math
from collections.abc import Iterable, Sequence

import numpy as np
import sympy as sp

from .. import __version__
from .answers import Answer, Constraints, driven_straight, uncontrolled
from .certification.safety import SAFE, SINGULAR, Verdict
from .mathml import mathml
from .outputs.normal_form import SYMBOLS, NormalForm
from .text import VERDICTS

INK, SOFT, OLD, NEW, HOLD, BAD, GOOD = "#1a1a1a", "#777777", "#c9d9e8", "#0b61a4", "#f3e3d3", "#c00000", "#1b6e3c"
CSS = """
body { font: 15px/1.5 system-ui, sans-serif; color: #1a1a1a; max-width: 1000px; margin: 2em auto; padding: 0 1em }
h1 { font-size: 1.6em } h2 { font-size: 1.25em; margin-top: 2.2em; border-top: 1px solid #ccc; padding-top: .8em }
h3 { font-size: 1.05em; margin: 1.8em 0 .3em } math { font-size: 1.08em } math[display=block] { margin: .6em 0; overflow-x: auto }
table { border-collapse: collapse; width: 100%; font-size: .93em; margin: .6em 0 }
th, td { text-align: left; vertical-align: top; padding: .3em .6em; border-bottom: 1px solid #ddd }
th { border-bottom: 2px solid #888 }
svg { max-width: 100%; height: auto } .yes { color: #1b6e3c; font-weight: 600 } .no { color: #9a5b00; font-weight: 600 }
.fails { color: #c00000; font-weight: 700 } .note { color: #555; font-size: .92em } code { font: 12.5px ui-monospace, monospace }
@media print { body { margin: 0; max-width: none; font-size: 11px } tr, svg, math { break-inside: avoid } }
"""


def report(answer: Answer) -> str:
    """Return the page."""
    title = f"Analysis of {answer.name}"
    parts = [
        f"<h1>{_text(title)}</h1>",
        *([f"<p>{_text(answer.about)}</p>"] if answer.about else []),
        *_constraints(answer.constraints),
        *_properties(answer.constraints),
        *_outputs(answer),
        *_starts(answer.starts),
        f'<p class="note">noslip {__version__}. Formulas are exact unless marked as not verified. Numbers in brackets '
        "are the equations of N. Sarkar, X. Yun and V. Kumar, Control of Mechanical Systems with Rolling Constraints, "
        "MS-CIS-92-44 (1992).</p>",
    ]
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{_text(title)}</title>'
    body = "\n".join(parts)
    return f'<!DOCTYPE html>\n<html lang="en"><head>{head}<style>{CSS}</style></head><body>\n{body}\n</body></html>\n'


# -- sections -----------------------------------------------------------------------------------------------------------


def _constraints(found: Constraints) -> list[str]:
    kinds = f"{found.k} holonomic, {found.m - found.k} nonholonomic"
    listed = ", ".join(map(str, found.growth))
    return [
        "<h2>Constraints</h2>",
        f"<p>{found.m} constraints in {found.n} coordinates: <strong>{kinds}</strong>. The distribution Δ of the velocities that "
        f"they allow has the growth vector ({listed}).</p>",
        *([mathml("S(q)", "=", found.S, display=True)] if found.S else []),
        _growth(found),
        *_folded("Proof of the growth", found.proof),
        _table(("", ""), [(title, _lines(map(_text, lines))) for title, lines in found.notes.items() if lines], header=False),
    ]


def _properties(found: Constraints) -> list[str]:
    if not found.checks:
        return []
    rows = [
        (
            f"{_text(check.question)}<br><span class='note'>on {_text(check.where)}</span>",
            f'<span class="{"yes" if check.verdict else "no"}">{VERDICTS[check.verdict]}</span>',
            f"{_text(check.reason)}<br><span class='note'>{_text(check.reference)}</span>",
            _lines(f"{_mark(each.holds)} {_text(each.text)}" for each in check.hypotheses),
        )
        for check in found.checks
    ]
    return [f"<h2>Properties of {_text(found.controlled)}</h2>", _table(("property", "", "reason", "hypotheses"), rows)]


def _outputs(answer: Answer) -> list[str]:
    refused = [
        (_text(reason), ", ".join(f"<code>{law}</code>" for law in laws)) for reason, laws in answer.refused_by_reason.items()
    ]
    others = ["<h3>Not applicable to this system</h3>", _table(("reason", "laws"), refused)] if refused else []
    if not answer.outputs:
        return ["<h2>Outputs</h2>", f"<p>None: {_text(answer.no_outputs)}.</p>", *others]
    straight = driven_straight(answer)
    used = {name for form in answer.outputs.values() for each in form.moving for name in each.symbols}
    legend = _table(("", ""), [(mathml(sp.Symbol(k)), _text(v)) for k, v in SYMBOLS.items() if k in used], header=False)
    return [
        "<h2>Outputs</h2>",
        *(part for law, form in answer.outputs.items() for part in _output(law, form)),
        *([f"<h3>Driving straight</h3><p>{_lines(map(_text, straight))}</p>"] if straight else []),
        *([f"<h3>Symbols</h3>{legend}"] if used else []),
        *others,
    ]


def _output(law: str, form: NormalForm) -> list[str]:
    made = form.decoupling
    output, degree = made.linearization.output, made.linearization.relative_degree
    rows = ", ".join(f"{_text(row.about)} (relative degree {k})" for row, k in zip(output.rows, degree, strict=True))
    conditions = [f"{_text(c.words)}{': ' if c.words else ''}{mathml(c.formula, '=', sp.Integer(0))}" for c in made.conditions]
    z = [" , ".join(mathml(sp.Symbol(name)) for name in names) for names in form.T]
    rates = [mathml(sp.Symbol(f"{name}_dot"), "=", rate) for name, rate in form.equations.items()]
    table = [
        ("singular", _lines(conditions or ["nowhere"])),
        ("not defined", _lines(mathml("where", expression, "=", sp.Integer(0)) for expression in made.undefined)),
        ("T(x)", _lines(f"z<sub>{k + 1}</sub> = ({names})" for k, names in enumerate(z))),
        ("regular", mathml("where", form.charts[0].minor, "≠", sp.Integer(0), "and det Φ ≠ 0")),
        ("z<sub>3</sub>′", _lines(rates)),
        ("zero dynamics", _text(uncontrolled(form))),
        ("reference at speed V", _lines(_text(str(each)) for each in form.moving)),
    ]
    return [
        f"<h3><code>{law}</code> {_text(output.about)}</h3>",
        f"<p>{rows}</p>",
        mathml("det Φ", "=", made.det_for_people, display=True),
        *_where(form),
        _table(("", ""), [row for row in table if row[1]], header=False),
    ]


def _where(form: NormalForm) -> list[str]:
    explained = [mathml(name, "=", meaning) for name, meaning in form.decoupling.explained.items()]
    return [f"<p>{', '.join(explained)}</p>"] if explained else []


def _starts(starts: dict[str, Verdict]) -> list[str]:
    if not starts:
        return []
    parts = ["<h2>Starts</h2>", f"<p>{mathml(sp.Symbol('s'))} is {_text(SYMBOLS['s'])}.</p>"]
    for file, verdict in starts.items():
        kind = {SAFE: "yes", SINGULAR: "fails"}.get(verdict.kind, "no")
        parts.append(f'<h3><code>{_text(file)}</code></h3><p class="{kind}">{_text(str(verdict))}</p>')
        if verdict.course.shape[1] > 1:
            parts.append(_course(verdict))
    return parts


# -- drawings -----------------------------------------------------------------------------------------------------------


def _growth(found: Constraints) -> str:
    """Return a drawing: a column of boxes for each step, with the brackets added in it, and above them the integrals."""
    wide, tall, left = max(170, 8 * max(len(name) for level in found.levels for name in level)), 34, 46
    width, height = left + len(found.growth) * (wide + 16) + 10, found.n * tall + 44
    drawn, below = [], height - 30
    for step, dimension in enumerate(found.growth):
        x = left + step * (wide + 16)
        names = [name for level in found.levels[: step + 1] for name in level]
        new = found.growth[step - 1] if step else 0
        for k in range(found.n):
            y = below - (k + 1) * tall
            if k < dimension:
                fill, ink = (NEW, "white") if k >= new else (OLD, INK)
                drawn.append(_box(x, y, wide, tall - 4, fill))
                drawn.append(_label(x + wide / 2, y + tall / 2 + 3, names[k], ink))
            elif step == len(found.growth) - 1:
                drawn.append(_box(x, y, wide, tall - 4, HOLD, dashed=True))
                drawn.append(_label(x + wide / 2, y + tall / 2 + 3, "holonomic", SOFT))
        drawn.append(_label(x + wide / 2, height - 8, f"step {step + 1}: dimension {dimension}", INK))
    top = below - found.n * tall
    drawn.append(f'<line x1="{left - 10}" y1="{top - 2}" x2="{width}" y2="{top - 2}" stroke="{SOFT}" stroke-dasharray="5 4"/>')
    drawn.append(_label(left - 28, top + 4, f"n = {found.n}", SOFT))
    return _svg(width, height, drawn, "growth of the distribution, step by step")


def _course(verdict: Verdict) -> str:
    """Return a drawing of s over t between -1 and 1."""
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
    for value, look in ((1, f'"{BAD}" stroke-dasharray="6 4"'), (0, '"#cccccc"'), (-1, f'"{BAD}" stroke-dasharray="6 4"')):
        drawn.append(f'<line x1="{left}" y1="{y(value):.1f}" x2="{width - right}" y2="{y(value):.1f}" stroke={look}/>')
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


def _svg(width: float, height: float, drawn: Iterable[str], about: str) -> str:
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" width="{width:g}" role="img"'
    return f'{head} font-family="system-ui, sans-serif" font-size="13"><title>{about}</title>{"".join(drawn)}</svg>'


def _box(x: float, y: float, width: float, height: float, fill: str, dashed: bool = False) -> str:
    edge = f' stroke="{SOFT}" stroke-dasharray="4 3"' if dashed else ""
    return f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" rx="3" fill="{fill}"{edge}/>'


def _label(x: float, y: float, text: str, fill: str, anchor: str = "middle") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" fill="{fill}" text-anchor="{anchor}">{_text(text)}</text>'


# -- HTML ---------------------------------------------------------------------------------------------------------------


def _table(head: Sequence[str], rows: Iterable[Sequence[str]], header: bool = True) -> str:
    top = f"<thead><tr>{''.join(f'<th>{cell}</th>' for cell in head)}</tr></thead>" if header else ""
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table>{top}<tbody>{body}</tbody></table>"


def _folded(title: str, lines: Sequence[str]) -> list[str]:
    """Return collapsible lines."""
    return [f"<details><summary>{title}</summary><p>{_lines(map(_text, lines))}</p></details>"] if lines else []


def _lines(parts: Iterable[str]) -> str:
    return "<br>".join(parts)


def _mark(holds: bool | None) -> str:
    return {True: "✓", False: "✗", None: "?"}[holds]


def _text(text: str) -> str:
    return html.escape(text)
