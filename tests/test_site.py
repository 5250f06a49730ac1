"""The site and the playground: complete, without a broken link, and without anything from another machine."""

import json
import re
import runpy
import shutil
import subprocess
import sys
from html import unescape
from pathlib import Path
from urllib.parse import quote

import noslip
import numpy as np
import pytest
from noslip import simulate
from noslip.controllers.targets import missing, required
from noslip.simulation.specification.vary import varied

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
    written |= {f"lessons/{path.stem}" for path in ROOT.glob("docs/lessons/*.py")}  # each has run without an error
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


# -- in a browser --------------------------------------------------------------------------------------------------------


def opened(address: str) -> str:
    """The page after some seconds in a browser without a window. Fails if a script does."""
    browser = next((path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None)
    if browser is None:
        pytest.skip("no browser (chromium) here")
    flags = ["--headless", "--no-sandbox", "--enable-logging=stderr", "--virtual-time-budget=4000", "--dump-dom"]
    result = subprocess.run([browser, *flags, address], capture_output=True, text=True, timeout=120)
    assert result.returncode == 0 and "CONSOLE" not in result.stderr, result.stderr
    return result.stdout


@pytest.mark.nightly
def test_search_needs_no_server(site):
    """From a file: the words of a page lead to it."""
    page = opened(f"{(site / 'search.html').as_uri()}?q=involutive")
    assert "Search finished" in page and 'href="docs/glossary.html' in page


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("settings", "status"),
    [
        ({}, "the law is in force"),
        ({"speed": 6, "size": 2}, "the wheels would slip here"),
        ({"law": "II", "x": [0, 2, 1.5707963267948966, 0, 0, 3, 3]}, "singular: the law has no torque here"),
    ],
)
def test_address_holds_the_run(settings, status, tmp_path):
    """What happens is told, for the settings in the page's address."""
    if absent := missing("clang", "wasm-ld"):
        pytest.skip(f"{', '.join(absent)} not installed")
    run(sys.executable, "playground/build.py", tmp_path)
    shown = opened(f"{(tmp_path / 'index.html').as_uri()}#{quote(json.dumps(settings))}")
    assert status in re.search(r'<output id="status"[^>]*>([^<]*)', shown)[1]


# -- playground ----------------------------------------------------------------------------------------------------------

RUN = """
const runs = JSON.parse(process.argv[2]).map((given) => {
  const s = { ...DEFAULTS, ...given, drawn: arcsThrough(given.points || [], given.closed) }, loop = new Loop(), rows = [];
  for (let good = loop.start(s); good && rows.length <= 1000; good = loop.step()) {
    rows.push([loop.get("t"), ...loop.get("x"), ...loop.get("tau"), ...loop.get("y"), ...loop.get("use")]);
  }
  return { spec: spec(s), rows, status: loop.status };
});
process.stdout.write(JSON.stringify(runs));
"""
AHEAD = {"x": [0.0, 2.0, 0.3, 0.0, 0.0, 3.0, 3.0]}
POINTS = {"points": [[0, 0], [4, 1], [8, 0], [10, -4], [6, -6], [2, -4]], "x": [0.0, -0.5, 0.4, 0.0, 0.0, 1.0, 1.0]}
RUNS = {
    "type I, another mass": {"law": "I", "angle": 30, "mass": 42, **AHEAD},
    "type II": {"law": "II", "angle": 10, **AHEAD},
    "type III": {"law": "III", "angle": 60, **AHEAD},
    "line": {"law": "IV line", "angle": 20, "L": 0.5, "believed": 25, **AHEAD},
    "circle": {},
    "circle, limits cut": {"limit": 4, "mode": "cut"},
    "circle, limits slow": {"limit": 4, "mode": "slow"},
    "circle, grip": {"mode": "grip", "mu": 0.2, "speed": 3},
    "ellipse": {"law": "IV ellipse"},
    "drawn path": {"law": "IV path", "closed": False, **POINTS},
    "closed path": {"law": "IV path", "closed": True, **POINTS},
    "into the singular set": {"law": "II", "angle": 30, "x": [0.0, 2.0, 2.2, 0.0, 0.0, 3.0, 3.0]},
}


@pytest.fixture(scope="module")
def playground(tmp_path_factory) -> dict[str, dict]:
    """What the page's own scripts compute, run by Node: name -> its SPEC, a row for each period, the last status."""
    if absent := missing("node", "clang", "wasm-ld"):
        (pytest.fail if required() else pytest.skip)(f"{', '.join(absent)} not installed")
    file = tmp_path_factory.mktemp("playground") / "run.js"
    file.write_text(runpy.run_path(str(ROOT / "playground" / "build.py"))["script"]() + RUN)
    return dict(zip(RUNS, json.loads(run("node", file, json.dumps(list(RUNS.values())))), strict=True))


@pytest.mark.nightly
@pytest.mark.parametrize("name", RUNS)
def test_playground_is_simulate(name, playground):
    """Times, states and torques of 10 s have the same bits in the page and in `noslip simulate` of the SPEC that it gives."""
    page = playground[name]
    there = simulate(varied(page["spec"], name, {}))
    rows = np.array(page["rows"])
    stopped = there.stopped is not None
    assert page["status"] == there.status[-1] and stopped == (name == "into the singular set")
    assert len(rows) == len(there.t) - stopped and (len(rows) == 1001 or stopped)
    kept = slice(0, len(rows))
    assert (rows[:, :10] == np.column_stack([there.t, there.x, there.tau])[kept]).all()
    assert np.abs(rows[:, 10:12] - there.y[kept]).max() <= 1e-12  # m, m/s, rad: another order of the same sums
    use = np.column_stack(list(there.use.values()))[kept]  # up to thousands beside the singular set
    assert np.max(np.abs(rows[:, 12:] - use) / (1 + use)) <= 1e-12


@pytest.mark.nightly
def test_playground_page(tmp_path):
    """One file, below 1 MB, that loads nothing."""
    if absent := missing("clang", "wasm-ld"):
        pytest.skip(f"{', '.join(absent)} not installed")
    run(sys.executable, "playground/build.py", tmp_path)
    (page,) = tmp_path.iterdir()
    text = page.read_text()
    assert page.name == "index.html" and len(text) < 1_000_000
    assert not LOADED.search(text) and "http" not in text.lower()
