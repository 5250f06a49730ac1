"""Texts from templates, which lie in a folder `templates` beside the code that fills them in."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jinja2 import Environment

STYLE = Path(__file__).parent / "templates"


def render(module: str, name: str, **values: object) -> str:
    """The template `name` beside a module, whose __file__ is given, with these values. Raises UndefinedError
    if one is missing.

    In HTML and XML values stand in {{ }} and are escaped; HTML can include page.css, the style of all pages.
    In all other texts values stand in @{ }, since C has many braces.
    """
    return (
        _environment(Path(module).parent / "templates", name.endswith((".html", ".xml")))
        .get_template(name)
        .render(values)
    )


@lru_cache
def _environment(folder: Path, html: bool) -> Environment:
    # Slow to import, and most runs render nothing
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    start, end = ("{{", "}}") if html else ("@{", "}")
    return Environment(
        loader=FileSystemLoader([folder, STYLE]),
        variable_start_string=start,
        variable_end_string=end,
        autoescape=html,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
