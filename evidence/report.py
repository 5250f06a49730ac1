"""The report: one HTML file that needs no other, and the claims as JSON."""

import base64
import html
import importlib.metadata
import platform
import subprocess
from collections.abc import Iterable, Sequence
from typing import Any

from ..codegen.files import TOOLS
from ..controllers.build import FLAGS, QUICK, compiler
from ..readers.files import MARK
from ..readers.printing import toml
from ..readers.robots import find_robot
from .framework import SPECS, Claim, Outcome
from .production import Made

CSS = """
body { font: 15px/1.5 system-ui, sans-serif; color: #1a1a1a; max-width: 1080px; margin: 2em auto; padding: 0 1em }
h1 { font-size: 1.6em } h2 { font-size: 1.25em; margin-top: 2.5em; border-top: 1px solid #ccc; padding-top: 1em }
h3 { font-size: 1em; margin-bottom: .3em }
img { width: 100%; height: auto; border: 1px solid #e4e4e4 }
table { border-collapse: collapse; width: 100%; font-size: .9em; margin: .6em 0 }
th, td { text-align: left; vertical-align: top; padding: .3em .6em; border-bottom: 1px solid #ddd }
th { border-bottom: 2px solid #888 } .number { text-align: right; white-space: nowrap }
.holds { color: #1b6e3c } .not { color: #9a5b00; font-weight: 600 } .fails { color: #c00000; font-weight: 700 }
.note, .whose, .assumed { color: #555; font-size: .92em } .whose { white-space: nowrap }
code, pre { font: 12.5px/1.4 ui-monospace, monospace } pre { background: #f6f6f6; padding: .8em; white-space: pre-wrap }
mark { background: #fff0b8 } .digest { word-break: break-all }
@media print { body { margin: 0; max-width: none; font-size: 11px } h2 { break-before: page } img, tr { break-inside: avoid } }
"""
INTRODUCTION = """Every run below is a closed loop of the generated C (double precision; the digests of its files are at the end)
and a simulated LABMATE. It was run a second time with CasADi evaluating the model itself, and the two are compared. A claim
is the paper's, in our words, or this project's; what was measured is computed from the runs each time. Values that the scan
of the paper lost are this project's assumptions: they stand on each figure and are marked in each spec."""


def report(made: Sequence[Made]) -> str:
    """The HTML of all figures."""
    failing = [(each, claim) for each in made for claim in each.claims if not claim.holds or not claim.as_expected]
    parts = [
        "<h1>Control of mechanical systems with rolling constraints: the figures, from the generated C</h1>",
        f"<p>After N. Sarkar, X. Yun and V. Kumar, MS-CIS-92-44 (1992). {INTRODUCTION}</p>",
        f"<p><strong>{_text(_sentence(summary(made)))}</strong></p>",
        *(
            f'<p class="{_class(claim)}"><a href="#{each.figure.name}">{_text(each.figure.title)}</a>: {_text(claim.text)}: '
            f"{_text(claim.verdict)}. {_text(claim.measured)}</p>"
            for each, claim in failing
        ),
        _table(("figure", "claims", "outcome"), map(_summary_row, made)),
        *_slipping({id(run): run for each in made for run in each.runs.values()}.values()),
        *(part for each in made for part in _figure(each)),
        *_appendix(made),
    ]
    title = "noslip: the paper's figures"
    head = f'<meta charset="utf-8"><meta name="generator" content="{MARK}"><meta name="viewport" content="width=device-width">'
    head += f"<title>{title}</title><style>{CSS}</style>"
    return f'<!DOCTYPE html>\n<html lang="en"><head>{head}</head><body>\n' + "\n".join(parts) + "\n</body></html>\n"


def summary(made: Iterable[Made]) -> str:
    """How many claims hold, how many do not as was found before, how many fail."""
    claims = [claim for each in made for claim in each.claims]
    if not claims:
        return "no claims"
    failing = [claim for claim in claims if not claim.as_expected]
    found = [claim for claim in claims if claim.as_expected and not claim.holds]
    said = [_count(len(claims) - len(failing) - len(found), "claim holds", "claims hold")]
    said += [_count(len(found), "does not (as found here)", "do not (as found here)")] if found else []
    said += [_count(len(failing), "FAILS", "FAIL") + ": " + "; ".join(claim.text for claim in failing)] if failing else []
    return ", ".join(said)


def as_json(made: Iterable[Made]) -> list[dict[str, Any]]:
    """Figures with their claims, and for each run the worst slip, integral and difference from CasADi."""
    return [
        {
            "figure": each.figure.name,
            "title": each.figure.title,
            "claims": [{**vars(claim), "as_expected": claim.as_expected} for claim in each.claims],
            "runs": {
                label: {"refused": run.refused}
                if run.refused
                else {
                    "slip": run.slip,
                    "integral": run.integral,
                    "agreement": run.agreement,
                    "stopped": run.stopped,
                    "friction_needed": _friction(run),
                }
                for label, run in each.runs.items()
            },
        }
        for each in made
    ]


def _figure(made: Made) -> list[str]:
    figure = made.figure
    image = base64.b64encode(made.pictures["svg"]).decode()
    assumed = [f'<p class="assumed">Assumed, lost in the scan: {_text(figure.assumed)}.</p>'] if figure.assumed else []
    return [
        f'<h2 id="{figure.name}">{_text(figure.title)}</h2>',
        f"<p>{_text(figure.paper)}</p>",
        f'<img alt="{_text(figure.title)}" src="data:image/svg+xml;base64,{image}">',
        *assumed,
        *(_claims_and_runs(made) if figure.cases else []),
    ]


def _claims_and_runs(made: Made) -> list[str]:
    runs = ("run", "spec and what differs from it", "‖A q̇‖", "φ − c(θ_r − θ_l), rad", "C − CasADi", "friction needed", "ended")
    return [
        _table(("claim", "whose", "measured", "outcome"), map(_claim_row, made.claims)),
        "<h3>Runs</h3>",
        _table(runs, (_run_row(made, label) for label in made.figure.cases)),
        *_slipping(made.runs.values()),
    ]


def _claim_row(claim: Claim) -> list[str]:
    note = f'<div class="note">{_text(_sentence(claim.note))}</div>' if claim.note else ""
    return [
        _cell(f"{_text(claim.text)}{note}"),
        _cell("the paper's" if claim.paper else "ours", "whose"),
        _cell(_text(claim.measured)),
        _cell(_text(claim.verdict), _class(claim)),
    ]


def _run_row(made: Made, label: str) -> list[str]:
    case, run = made.figure.cases[label], made.runs[label]
    changes = "".join(f"<br><code>{_text(f'{key} = {toml(value)}')}</code>" for key, value in case.changes.items())
    spec = f'<a href="#{case.file}"><code>{case.file}</code></a>{changes}'
    if run.refused:
        return [_cell(_text(label)), _cell(spec), *[_cell("–", "number")] * 4, _cell(_text(f"refused: {run.refused}"))]
    numbers = ("–" if value is None else f"{value:.1e}" for value in (run.slip, run.integral, run.agreement))
    needed = _friction(run)
    friction = _cell("–" if needed is None else f"μ ≥ {needed:.2g}", "number" if run.grip.rolls else "number not")
    return [
        _cell(_text(label)),
        _cell(spec),
        *(_cell(number, "number") for number in numbers),
        friction,
        _cell(_text(_ending(run))),
    ]


def _friction(run: Outcome) -> float | None:
    """The friction coefficient that rolling needs at the worst row; None of a robot that has no contacts to judge."""
    return max((float(contact.needs.max()) for contact in run.grip.contacts), default=None)


def _slipping(runs: Iterable[Outcome]) -> list[str]:
    """What to say of runs that a floor could not hold."""
    done = [run for run in runs if not run.refused]
    slipping = [run for run in done if not run.grip.rolls]
    if not slipping:
        return []
    said = f"in {len(slipping)} of {len(done)} runs the wheels would slip for want of friction; like the paper, the figures take "
    return [
        f'<p class="note">{_text(_sentence(said + "rolling for granted"))} {_text(_sentence(slipping[0].grip.assumed()))}</p>'
    ]


def _ending(run: Outcome) -> str:
    return f"{run.stopped} at {run.t[-1]:.4g} s" if run.stopped else f"{run.t[-1]:g} s, {len(run.t)} rows"


def _summary_row(made: Made) -> list[str]:
    worst = "fails" if not all(c.as_expected for c in made.claims) else "holds" if all(c.holds for c in made.claims) else "not"
    link = f'<a href="#{made.figure.name}">{_text(made.figure.title)}</a>'
    return [_cell(link), _cell(str(len(made.claims)), "number"), _cell(_text(summary([made])), worst)]


def _appendix(made: Sequence[Made]) -> list[str]:
    """Parameters, specs, digests, versions."""
    runs = [run for each in made for run in each.runs.values()]
    files = sorted({case.file for each in made for case in each.figure.cases.values()})
    digests = {name: digest for run in runs for name, digest in run.sources.items()}
    robots = sorted({run.spec.robot for run in runs})
    return [
        *(part for robot in robots for part in _parameters(robot)),
        '<h2 id="specs">Specs</h2>',
        "<p>Each runs by itself: <code>noslip simulate FILE -o run.csv --plot run.png</code>. What is assumed is marked.</p>",
        *(f'<h3 id="{name}">{name}</h3><pre>{_marked(_text((SPECS / name).read_text()))}</pre>' for name in files),
        '<h2 id="digests">The C that ran</h2>',
        "<p>SHA-256 of every file; those of a robot are the ones that <code>noslip generate</code> writes.</p>",
        _table(
            ("file", "SHA-256"),
            ([_cell(f"<code>{n}</code>"), _cell(f"<code>{d}</code>", "digest")] for n, d in sorted(digests.items())),
        ),
        '<h2 id="versions">Versions</h2>',
        _table(("tool", "version"), ([_cell(_text(tool)), _cell(_text(version))] for tool, version in _versions().items())),
    ]


def _parameters(robot: str) -> list[str]:
    rows = (
        [_cell(f"<code>{p.name}</code>"), _cell(f"{p.default:g} {_text(p.unit)}", "number"), _cell(_marked(_text(p.about)))]
        for p in find_robot(robot).parameters
    )
    return [
        f'<h2 id="parameters">Parameters of the {_text(robot)}</h2>',
        _table(("parameter", "unless a spec says otherwise", ""), rows),
    ]


def _versions() -> dict[str, str]:
    packages = {name: importlib.metadata.version(name) for name in ("numpy", "scipy", "matplotlib")}
    said = subprocess.run([*compiler(), "--version"], capture_output=True, text=True).stdout.splitlines()
    return {
        "generator": TOOLS,
        "Python": platform.python_version(),
        **packages,
        "C compiler": f"{said[0] if said else 'unknown'}, {' '.join((*FLAGS, *QUICK))}",
    }


def _class(claim: Claim) -> str:
    return "fails" if not claim.as_expected else "holds" if claim.holds else "not"


def _count(number: int, one: str, many: str) -> str:
    return f"{number} {one if number == 1 else many}"


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."


def _text(text: str) -> str:
    return html.escape(text)


def _marked(text: str) -> str:
    """Escaped text with "assumed" standing out."""
    return text.replace("assumed", "<mark>assumed</mark>")


def _cell(content: str, kind: str = "") -> str:
    return f'<td class="{kind}">{content}</td>' if kind else f"<td>{content}</td>"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    titles = "".join(f"<th>{_text(title)}</th>" for title in head)
    body = "\n".join(f"<tr>{''.join(row)}</tr>" for row in rows)
    return f"<table><thead><tr>{titles}</tr></thead><tbody>\n{body}\n</tbody></table>"
