"""Makes the folder that Sphinx reads for `make site`: a copy of the repository, and the pages that are made
from other sources: the references of Python, C, the command line and SPEC, the gallery of figures, the
lessons.

    python docs/site/pages.py FOLDER
"""

import inspect
import json
import posixpath
import re
import shlex
import shutil
import sys
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import noslip
from lessons import rendered
from noslip.cli import COMMANDS
from noslip.cli.commands import parser_of, run
from noslip.codegen.loop.stages import STAGES
from noslip.codegen.runtime import runtime_files
from noslip.examples.evidence.catalogue import FIGURES
from noslip.examples.evidence.framework import SPECS, Case
from noslip.readers.printing import toml

ROOT = Path(noslip.__file__).parent
NO_SOURCES = ("build", "dist", ".git", ".venv", "__pycache__", ".*_cache", "*.egg-info")
QUICK = ("1", "6", "waypoints")  # figures that are drawn if `make figures` has not drawn all
FILMED = "waypoints"  # the run of one of them, of which a film is made if `make films` has made none
RESULTS = (  # what functions of the package return
    *(
        "model.reduction.ReducedSystem",
        "model.outputs.OutputMap",
        "model.linearization.Linearization",
        "model.law.ControlLaw",
    ),
    *("simulation.specification.spec.Spec", "simulation.run.Run", "analysis.answers.Answer"),
)
COMMENT = r"(?:^/\*((?:(?!\*/).)*)\*/\n)?"
TYPE = re.compile(COMMENT + r"^((?:typedef )?(?:enum|struct)\b[^;{]*\{.*?^\}[^;]*;)", re.S | re.M)
MARKS = r"^(?:(?:static|inline|NOSLIP_HOT|NOSLIP_APART) )*"
FUNCTION = re.compile(COMMENT + MARKS + r"((?!typedef)[a-z][\w *]*?(\w+)\([^;{]*\));", re.S | re.M)
TABLE = '<div class="table-wrapper docutils container">\n{}\n</div>'  # as Sphinx marks a table
BODY = re.compile(r"(?<=\))(?:\n\{\n.*?^\}| \{ .*? \})$", re.S | re.M)


def python_page() -> str:
    """The names of the package, and what its functions return."""
    lines = [
        "# Python",
        "",
        "[noslip from Python](../docs/api.md) has an overview with an example.",
        "",
        "```{eval-rst}",
    ]
    for name in noslip.__all__:
        class_or_not = ["class", "   :members:"] if inspect.isclass(getattr(noslip, name)) else ["function"]
        lines += [f".. auto{class_or_not[0]}:: noslip.{name}", *class_or_not[1:], ""]
    for name in RESULTS:
        lines += [f".. autoclass:: noslip.{name}", "   :members:", ""]
    return "\n".join([*lines, "```"])


def c_page(title: str, headers: Mapping[str, str]) -> str:
    """The headers (name -> text): what each is for, its types and functions in double;
    in float they end in _f."""
    parts = [f"# {title}", "Everything exists for `double` and, with the suffix `_f`, for `float`."]
    for file, content in headers.items():
        head, _, text = BODY.sub(";", content).removeprefix("/*").partition("*/")
        parts += [f"## {file}", _fenced("text", _comment(head))]
        parts += [
            _fenced("c", f"/*{note}*/\n{code}" if note else code)
            for note, code in TYPE.findall(text)
            if "_f;" not in code
        ]
        for note, code, name in FUNCTION.findall(text):
            if not name.endswith("_f"):
                parts += [
                    f"````{{c:function}} {' '.join(code.split())}\n\n{_fenced('text', _comment(note))}\n````"
                ]
    return "\n\n".join(parts)


def _comment(text: str) -> str:
    """The words of a comment in C."""
    return re.sub(r"^ \* ?", "", text, flags=re.M).strip()


def command_line_page() -> str:
    """The help of each command."""
    parser, commands = parser_of(COMMANDS)
    helps = {"": parser, **commands.choices}
    parts = [f"## noslip {name}\n\n{_fenced('text', each.format_help())}" for name, each in helps.items()]
    return "\n\n".join(["# Command line", *parts])


def spec_page() -> str:
    """The entries of a SPEC, from its schema."""
    schema = json.loads((ROOT / "examples/specs/spec.schema.json").read_text(encoding="utf-8"))
    head = (
        'In [TOML](https://toml.io). Numbers are in SI units; with a unit they are strings, such as `"90 '
        'deg"`.'
    )
    together = [
        "## What goes together",
        "The stages of a closed loop, in their order:",
        _fenced("text", "\n\n".join(map(str, STAGES))),
    ]
    return "\n\n".join(["# SPEC.toml", schema["description"], head, *_sections(schema, ""), *together])


def _sections(schema: Mapping[str, Any], name: str) -> Iterator[str]:
    """A table of the entries, then a section for each entry that is a table,
    of which the table has the first sentence."""
    entries = {key: value for key, value in schema["properties"].items() if value}
    rows = []
    for key, value in entries.items():
        meaning, entry = _cell(value.get("description", "")), f"`{key}`"
        if "properties" in value:
            meaning, entry = (
                meaning.partition(". ")[0].rstrip("."),
                f"[{entry}](#{name.replace('.', '')}{key})",
            )
        rows.append(f"| {entry} | {_allowed(value)} | {meaning} |")
    yield "\n".join(["| entry | value | meaning |", "|---|---|---|", *rows])
    for kind in schema.get("allOf", ()):
        if value := kind["if"]["properties"]["kind"].get("const"):
            yield f"### `[{name}]` with `kind = {json.dumps(value)}`"
            yield from _sections(kind["then"], name)
    for key, value in entries.items():
        if "properties" in value:
            inner = f"{name}.{key}".lstrip(".")
            yield f"{'##' if not name else '###'} `[{inner}]`\n\n{value.get('description', '')}"
            yield from _sections(value, inner)


def _allowed(value: Mapping[str, Any]) -> str:
    """What a value may be, and what it is by default."""
    kinds = [json.dumps(each) for each in value.get("enum", value.get("examples", ()))]
    kind = value.get("type") or ("number" if "anyOf" in value else "")
    values = ", ".join(f"`{each}`" for each in kinds) or {"object": "table", "array": "list"}.get(kind, kind)
    return values + (f"; default `{json.dumps(value['default'])}`" if "default" in value else "")


def _cell(text: str) -> str:
    return " ".join(text.replace("|", r"\|").split())


def gallery_page(folder: Path) -> str:
    """The report of the figures that were drawn, as a page of the site: each with its claims and the runs
    that it shows, their commands and SPECs.
    """
    report = (folder / "report.html").read_text(encoding="utf-8")
    parts = [
        "# Gallery",
        "Every figure is drawn from runs of the generated C. A claim is the paper's, in our words, or this "
        "project's.",
    ]
    parts += [
        "[The report](figures/report.html) has the same in one file to send, and what else was measured."
    ]
    drawn = [figure for figure in FIGURES if f'<h2 id="{figure.name}">' in report]
    if len(drawn) < len(FIGURES):
        parts += ["`make figures ALL=--all` draws the others, `make site` then shows them here."]
    for figure in drawn:
        parts += [
            f"## {figure.title}\n\n{figure.paper}\n\n![{figure.title}](figures/figure_{figure.name}.svg)"
        ]
        parts += _claims(report, figure.name)
        if figure.cases:
            parts += [_fenced("sh", "\n".join(_command(label, case) for label, case in figure.cases.items()))]
        for file in dict.fromkeys(case.file for case in figure.cases.values()):
            film = f"films/{Path(file).stem}.html"
            parts += [f"[Watch the run of {file}]({film})"] if (folder.parent / film).exists() else []
            spec = _fenced("toml", (SPECS / file).read_text(encoding="utf-8"))
            parts += [f"<details><summary>{file}</summary>", spec, "</details>"]
    return "\n\n".join(parts)


def _claims(report: str, figure: str) -> list[str]:
    """What a figure assumes and its table of claims, as the report has them;
    nothing for a figure without claims."""
    section = re.search(rf'<h2 id="{re.escape(figure)}">.*?(?=<h2 )', report, re.S)
    assert section, f"the report lacks figure {figure}"
    assumed = re.findall(r'<p class="note">.*?</p>', section[0])
    table = r"<table><thead><tr><th>claim</th>.*?</table>"
    tables = re.findall(
        rf"(?:<details><summary>[^<]*</summary>\s*)?{table}(?:\s*</details>)?", section[0], re.S
    )
    return [
        *assumed,
        *(TABLE.format(table.replace("<table>", '<table class="docutils">')) for table in tables),
    ]


def _command(label: str, case: Case) -> str:
    """What simulates a run of a figure, in a clone."""
    changes = [f"--set {shlex.quote(f'{key}={toml(value)}')}" for key, value in case.changes.items()]
    engine = [f"--engine {case.engine}"] if case.engine else []
    return " ".join(
        [
            "noslip simulate",
            f"examples/specs/figures/{case.file}",
            *engine,
            *changes,
            f"-o run.csv  # {label}",
        ]
    )


def _fenced(language: str, text: str) -> str:
    return f"```{language}\n{text.rstrip()}\n```"


PRINTED = """<style>
@media print {
  @page { size: A4; margin: 1.5cm }
  html { font-size: 8.25pt }
  .content { width: 100% !important; padding: 0 !important }
  article { line-height: 1.25 }
  article h1, article h2, article h3 { margin: 0.4em 0 0.2em }
  article p, article ul, article ol, article li, article table { margin-block: 0.2em !important }
  article th, article td { padding: 0.05em 0.4em !important }
  article img { max-height: 3.6cm }
  .headerlink, .page footer { display: none }
}
</style>"""


def paper_page(report: str) -> str:
    """A paper of four printed pages: what noslip is, its method, guarantees and evidence, out of the
    documentation and of what the report says.
    """
    cff = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    title, version, date = (
        re.search(rf'^{name}: "?(.*?)"?$', cff, re.M)[1] for name in ("title", "version", "date-released")
    )
    guarantees = (ROOT / "checks/guarantees/README.md").read_text(encoding="utf-8")
    alarms = re.search(r"0 alarms means: (.*?)\.", guarantees, re.S)[1]
    rows = re.findall(
        r"^\| `([^|]*)` \| ([^|]*) \|", guarantees.replace("| see below |", f"| {_cell(alarms)} |"), re.M
    )
    plain = [(name, re.sub(r"\[(.*?)\]\(.*?\)", r"\1", claim)) for name, claim in rows]
    table = "\n".join(
        ["| check | claim |", "|---|---|", *(f"| `{name}` | {claim} |" for name, claim in plain)]
    )
    claims = re.findall(r"<p><strong>(.*?)</strong></p>", report)
    parts = [
        f"# {title}",
        f"The noslip maintainers. Version {version}, {date}. {available()}",
        excerpt("README.md", "Path following in C", "![The LABMATE"),
        excerpt("README.md", "The method is that of", "If these words"),
        "## Method",
        excerpt("docs/method.md", "## A wheel constrains", "Suffixes of laws"),
        "## Guarantees",
        "What `make guarantees` checks of the C:",
        table,
        "## Evidence",
        " ".join(claims),
        "![The LABMATE goes to a line](figures/figure_1.svg)",
        excerpt("checks/bench/README.md", "![Instructions", "The rows but"),
        excerpt("docs/following.md", "![Distance", "## "),
        "## Assumptions",
        excerpt("README.md", "Some numbers are illegible", "[CITATION"),
        "## How to cite",
        _fenced("bibtex", (ROOT / "CITATION.bib").read_text(encoding="utf-8")),
        PRINTED,
    ]
    return "\n\n".join(parts)


def excerpt(file: str, first: str, last: str) -> str:
    """A document from one text to the next other one, with links as from the root, a level deeper."""
    text = (ROOT / file).read_text(encoding="utf-8")
    text = text[text.index(first) :].partition(last)[0]
    folder = posixpath.dirname(file)
    text = re.sub(
        r"\]\((?!\w+:|#)([^)]*)\)",
        lambda link: f"]({posixpath.normpath(posixpath.join(folder, link[1]))})",
        text,
    )
    return re.sub("^##", "###", text, flags=re.M).strip()


def available() -> str:
    """Where the software is to be had, as its owner says in pyproject.toml; without that, how to say it."""
    urls = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"].get("urls", {})
    unknown = (
        "No address is stated: `[project.urls] Repository` in pyproject.toml is where the owner of the "
        "repository says it."
    )
    return f"<{urls['Repository']}>" if "Repository" in urls else unknown


def figures() -> Path:
    """The folder of `make figures`; without it, that of a few figures, drawn now if they are not there."""
    every, few = ROOT / "build/figures", ROOT / "build/gallery"
    if not (every / "report.html").exists() and not (few / "report.html").exists():
        assert run(["figures", "--only", *QUICK, "-o", str(few)]) == 0
    return every if (every / "report.html").exists() else few


def films() -> Path:
    """The folder of `make films`; without it, that of one film, made now if it is not there."""
    folder = ROOT / "build/films"
    if not any(folder.glob("*.html")):
        folder.mkdir(parents=True, exist_ok=True)
        assert (
            run(
                [
                    "simulate",
                    FILMED,
                    "-o",
                    str(folder / f"{FILMED}.csv"),
                    "--animate",
                    str(folder / f"{FILMED}.html"),
                ]
            )
            == 0
        )
    return folder


def playground_page(folder: Path) -> str:
    """What the playground is, and a link to its page if `make playground` has made it,
    which is then copied into a folder."""
    heading, _, text = (ROOT / "examples/playground/README.md").read_text(encoding="utf-8").partition("\n")
    if (page := ROOT / "build/playground/index.html").exists():
        folder.mkdir()
        shutil.copy(page, folder / "index.html")
        heading += "\n\n**[Drive a robot here](playground/index.html)**"
    return f"{heading}\n{text}"


def main(folder: Path) -> None:
    """Make the folder."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(*NO_SOURCES))
    (folder / "reference").mkdir()
    (folder / "README.md").rename(folder / "index.md")
    shutil.copytree(figures(), folder / "figures")
    shutil.copytree(films(), folder / "films", ignore=shutil.ignore_patterns("*.csv"))
    generated = [
        path for path in sorted((ROOT / "generated/labmate").glob("*.h")) if not path.stem.endswith("_f")
    ]
    labmate = {path.name: path.read_text(encoding="utf-8") for path in generated}
    runtime = {name: text for name, text in runtime_files().items() if name.endswith(".h")}
    cff, bibtex = ((ROOT / f"CITATION.{kind}").read_text(encoding="utf-8") for kind in ("cff", "bib"))
    pages = {
        "reference/python": python_page(),
        "reference/c_labmate": c_page("C of the LABMATE", labmate),
        "reference/c_runtime": c_page("C of the runtime", runtime),
        "reference/command_line": command_line_page(),
        "reference/spec": spec_page(),
        "reference/citing": "\n\n".join(
            ("# How to cite", available(), _fenced("bibtex", bibtex), _fenced("yaml", cff))
        ),
        "paper": paper_page((folder / "figures/report.html").read_text(encoding="utf-8")),
        "gallery": gallery_page(folder / "figures"),
        "playground": playground_page(folder / "playground"),
    }
    (folder / "lessons").mkdir()
    pages["lessons/README"] = (
        (ROOT / "docs/lessons/README.md").read_text(encoding="utf-8").replace("../../", "../")
    )
    for lesson in sorted((ROOT / "docs/lessons").glob("*.py")):
        pages[f"lessons/{lesson.stem}"] = rendered(lesson, folder / "lessons")
    for name, text in pages.items():
        (folder / f"{name}.md").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
