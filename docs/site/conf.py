"""Settings of Sphinx for `make site`; pages.py makes the folder that it reads."""

import re
from pathlib import Path

from docutils.nodes import Element, SkipNode
from latex2mathml.converter import convert
from noslip import __version__
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

project, version, copyright = "noslip", __version__, "the noslip maintainers"
include_patterns = [
    "*.md",
    "docs/*.md",
    "lessons/*.md",
    "reference/*.md",
    "checks/guarantees/*.md",
    "codegen/derivation/*.md",
]
include_patterns += ["readers/*.md", "checks/bench/README.md"]
extensions = ["myst_parser", "sphinx.ext.autodoc"]
html_theme, html_title, html_copy_source = "furo", f"noslip {version}", False
html_math_renderer = "mathml"
html_show_search_summary = False  # would fetch pages, which a browser refuses for files
myst_enable_extensions, myst_heading_anchors = ["dollarmath"], 4
default_role = "code"  # docstrings mark code by single backquotes
autodoc_typehints, autodoc_member_order = "signature", "bysource"
highlight_language = "text"
suppress_warnings = ["myst.header"]  # CHANGELOG.md and others start sections at any level

ACCESSIBLE = {  # what the theme leaves out for keyboards and screen readers
    '<p class="caption" role="heading">': '<p class="caption" role="heading" aria-level="2">',
    '<aside class="sidebar-drawer">': '<aside class="sidebar-drawer" aria-label="all pages">',
    "<pre>": '<pre tabindex="0">',
    '<div class="table-wrapper': '<div tabindex="0" class="table-wrapper',
    # Text of pictures stays legible
    "</head>": "<style>@media (max-width: 45em) { article p:has(> img) { overflow-x: auto } "
    "article p > img { max-width: 60rem } }</style></head>",
    "<p><img ": '<p tabindex="0"><img ',
    '<div class="math-wrapper': '<div tabindex="0" class="math-wrapper',
}
LESSON = r"docs/lessons/\w+\.\w+|\d_\w+\.py"
CONTENTS = """

```{toctree}
:hidden:
:caption: Start
playground
docs/agv
docs/your_robot
docs/paths
docs/firmware
readers/glossary
```
```{toctree}
:hidden:
:glob:
:caption: Lessons
lessons/README
lessons/[0-9]*
```
```{toctree}
:hidden:
:caption: How to
docs/drives
docs/grip
docs/redundant
docs/extension
docs/normal
docs/underactuated
docs/identify
docs/estimator
docs/sweep
docs/engine
docs/following
docs/extending
CONTRIBUTING
```
```{toctree}
:hidden:
:caption: Why and how it works
docs/method
codegen/derivation/README
docs/faults
checks/bench/README
checks/guarantees/README
checks/guarantees/misra
```
```{toctree}
:hidden:
:caption: Reference
docs/api
reference/python
reference/c_labmate
reference/c_runtime
reference/command_line
reference/spec
```
```{toctree}
:hidden:
:caption: Evidence
paper
gallery
CHANGELOG
reference/citing
```
"""


def _prepare(app: Sphinx, page: str, text: list[str]) -> None:
    """Add the contents to the first page. Links to lessons lead to their pages, links to a folder to its
    README; without one they become plain text."""
    here = Path(app.srcdir, page).parent

    def link(match: re.Match[str]) -> str:
        label, target = match.groups()
        if re.fullmatch(LESSON, target):
            return f"[{label}]({'' if page.startswith('lessons/') else 'lessons/'}{Path(target).stem}.md)"
        folder = here / target
        if not folder.is_dir():
            return match[0]
        return f"[{label}]({target.rstrip('/')}/README.md)" if (folder / "README.md").exists() else label

    text[0] = re.sub(r"(?<!!)\[([^]]*)\]\(([\w./-]+)\)", link, text[0]) + (
        CONTENTS if page == "index" else ""
    )


def _plain(app: Sphinx, what: str, name: str, documented: object, options: object, lines: list[str]) -> None:
    """Docstrings are plain text: what reStructuredText would read as marks, such as |F|,
    stands for itself."""
    lines[:] = [re.sub(r"(?<!`)([*|]|(?<=\w)_(?=[\s,.);]|$))(?!`)", r"\\\1", line) for line in lines]


def _math(writer: HTML5Translator, node: Element) -> None:
    """Equations are MathML, which browsers set without a script."""
    mathml = convert(node.astext(), display="block" if node.tagname == "math_block" else "inline")
    space = '<mspace width="0.2em"/>'  # beside the names of functions
    writer.body.append(re.sub(r"<mi>(sin|cos|det|log)</mi>", rf"{space}<mi>\1</mi>{space}", mathml))
    raise SkipNode


def _complete(app: Sphinx, error: Exception | None) -> None:
    """Make the pages accessible."""
    for page in Path(app.outdir).rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        for original, right in ACCESSIBLE.items():
            text = text.replace(original, right)
        page.write_text(text, encoding="utf-8")


def setup(app: Sphinx) -> None:
    """Connect what is above."""
    app.connect("source-read", _prepare)
    app.connect("autodoc-process-docstring", _plain)
    app.connect("build-finished", _complete)
    app.add_html_math_renderer("mathml", (_math, None), (_math, None))
