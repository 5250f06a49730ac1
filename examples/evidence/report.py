"""The report: a self-contained HTML file, and the claims as JSON."""

import base64
import importlib.metadata
import platform
import subprocess
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

from markupsafe import Markup, escape

from ...codegen.versions import TOOLS
from ...readers.files import MARK
from ...readers.printing import toml
from ...readers.robots import find_robot
from ...readers.templates import render
from ...simulation.controllers.build import FLAGS, QUICK, compiler
from .framework import SPECS, FigureRun
from .production import Made


def report(made: Sequence[Made]) -> str:
    """The HTML of all figures."""
    runs = {id(run): run for each in made for run in each.runs.values()}.values()
    files = sorted({case.file for each in made for case in each.figure.cases.values()})
    return render(
        __file__,
        "report.html",
        mark=MARK,
        made=made,
        runs=list(runs),
        robots={robot: find_robot(robot).parameters for robot in sorted({run.spec.robot for run in runs})},
        specs={name: (SPECS / name).read_text(encoding="utf-8") for name in files},
        digests=dict(sorted({name: digest for run in runs for name, digest in run.sources.items()}.items())),
        versions=_versions(),
        summary=summary,
        by_whom=by_whom,
        repeated=repeated(made),
        image=lambda each: base64.b64encode(each.pictures["svg"]).decode(),
        friction=lambda run: "–" if (needed := _friction(run)) is None else f"μ ≥ {needed:.2g}",
        ending=_ending,
        sentence=_sentence,
        marked=_marked,
        toml=toml,
    )


def summary(made: Iterable[Made]) -> str:
    """Return how many claims hold, how many do not hold as expected, and how many fail."""
    claims = [claim for each in made for claim in each.claims]
    if not claims:
        return "no claims"
    failing = [claim for claim in claims if not claim.as_expected]
    found = [claim for claim in claims if claim.as_expected and not claim.holds]
    said = [_count(len(claims) - len(failing) - len(found), "claim holds", "claims hold")]
    said += [_count(len(found), "does not (as found here)", "do not (as found here)")] if found else []
    said += (
        [_count(len(failing), "FAILS", "FAIL") + ": " + "; ".join(claim.text for claim in failing)]
        if failing
        else []
    )
    return ", ".join(said)


def repeated(made: Iterable[Made]) -> set[str]:
    """Return the texts of claims that more than one figure makes, which a page folds where they hold."""
    times = Counter(claim.text for each in made for claim in each.claims)
    return {text for text, count in times.items() if count > 1}


def by_whom(made: Iterable[Made]) -> list[str]:
    """Return the summaries of the paper's claims and of this project's, apart."""
    made = list(made)
    found = []
    for whose, paper in (("claims of the paper", True), ("claims of this project", False)):
        own = [
            replace(each, claims=[claim for claim in each.claims if claim.paper == paper]) for each in made
        ]
        found.append(f"{whose}: {summary(own)}")
    return found


def as_json(made: Iterable[Made]) -> list[dict[str, Any]]:
    """Return figures with their claims, and for each run the worst slip, integral and difference from CasADi,
    and on a floor the fastest a wheel slips (m/s).
    """
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
                    "slipping": run.slipping,
                    "stopped": run.stopped,
                    "friction_needed": _friction(run),
                }
                for label, run in each.runs.items()
            },
        }
        for each in made
    ]


def _friction(run: FigureRun) -> float | None:
    """Return the friction coefficient that rolling requires at the worst row;
    None for a robot without contacts."""
    return max((float(contact.needs.max()) for contact in run.grip.contacts), default=None)


def _ending(run: FigureRun) -> str:
    return f"{run.stopped} at {run.t[-1]:.4g} s" if run.stopped else f"{run.t[-1]:g} s, {len(run.t)} rows"


def _versions() -> dict[str, str]:
    packages = {name: importlib.metadata.version(name) for name in ("numpy", "scipy", "matplotlib")}
    said = subprocess.run(
        [*compiler(), "--version"], capture_output=True, encoding="utf-8", errors="replace"
    ).stdout.splitlines()
    return {
        "generator": TOOLS,
        "Python": platform.python_version(),
        **packages,
        "C compiler": f"{said[0] if said else 'unknown'}, {' '.join((*FLAGS, *QUICK))}",
    }


def _count(number: int, one: str, many: str) -> str:
    return f"{number} {one if number == 1 else many}"


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."


def _marked(text: str) -> Markup:
    """The text with "assumed" standing out."""
    return escape(text).replace("assumed", Markup("<mark>assumed</mark>"))
