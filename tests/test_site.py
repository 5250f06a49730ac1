"""The site and the playground: complete, without a broken link, and without anything from another machine."""

import re
import subprocess
import sys
from html import unescape
from pathlib import Path

import noslip
import pytest

ROOT = Path(noslip.__file__).parent
LOADED = re.compile(r"<(?:script|img|iframe|source)\b[^>]*\bsrc=\"(?:https?:)?//|<link\b[^>]*\bhref=\"(?:https?:)?//")


def run(*command: object) -> str:
    """Standard output of a command that must succeed."""
    result = subprocess.run([str(part) for part in command], cwd=ROOT, capture_output=True, text=True)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The site, where every warning of Sphinx is an error: links that lead nowhere are among them."""
    pytest.importorskip("furo", reason="the extra `site` is not installed")
    pytest.importorskip("myst_parser", reason="the extra `site` is not installed")
    folder = tmp_path_factory.mktemp("site")
    run(sys.executable, "docs/site/pages.py", folder / "pages")
    run(sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-c", "docs/site", folder / "pages", folder / "site")
    return folder / "site"


@pytest.mark.nightly
def test_site(site):
    """Every page of the repository's documentation is there and leads to the glossary; functions and commands are described."""
    pages = {str(path.relative_to(site)): path.read_text() for path in site.rglob("*.html")}
    pages = {name: text for name, text in pages.items() if not name.startswith("_")}  # linked, not written by Sphinx
    written = {"index", *(f"docs/{path.stem}" for path in ROOT.glob("docs/*.md"))}
    assert {f"{name}.html" for name in written} <= pages.keys()
    for name, text in pages.items():
        assert not LOADED.search(text), name
        assert "glossary.html" in text or name == "docs/glossary.html", name
    declared = re.findall(r"^int (labmate_\w+)\(", "".join(p.read_text() for p in ROOT.glob("generated/labmate/*[!f].h")), re.M)
    assert len(declared) > 50
    for name in declared:
        assert f'id="c.{name}"' in pages["reference/c_labmate.html"], name
    for name in noslip.__all__:
        assert f'id="noslip.{name}"' in pages["reference/python.html"], name
    text = unescape(re.sub("<[^>]*>", "", pages["reference/spec.html"]))
    for name in ("output.path", "reference.approach", "contact", "segments", "bandwidth"):
        assert name in text, name
