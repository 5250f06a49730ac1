"""The site and the playground: complete, without a broken link, and without anything from another machine."""

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from html import unescape
from pathlib import Path
from urllib.parse import quote

import noslip
import numpy as np
import pytest
from noslip import simulate
from noslip.simulation.contact import grip
from noslip.simulation.specification.vary import varied
from noslip.tests.browser import Page, browser
from noslip.tests.tools import need

ROOT = Path(noslip.__file__).parent
LOADED = re.compile(
    r"<(?:script|img|iframe|source)\b[^>]*\bsrc=\"(?:https?:)?//|<link\b[^>]*\bhref=\"(?:https?:)?//"
)


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
    run(
        sys.executable,
        "-m",
        "sphinx",
        "-q",
        "-W",
        "--keep-going",
        "-c",
        "docs/site",
        folder / "pages",
        folder / "site",
    )
    return folder / "site"


@pytest.mark.nightly
def test_site(site):
    """Every page of the repository's documentation is there and leads to the glossary;
    functions and commands are described."""
    pages = {str(path.relative_to(site)): path.read_text() for path in site.rglob("*.html")}
    # Linked, not written by Sphinx
    pages = {name: text for name, text in pages.items() if not name.startswith("_")}
    written = {"index", *(f"docs/{path.stem}" for path in ROOT.glob("docs/*.md"))}
    # Each has run without an error
    written |= {f"lessons/{path.stem}" for path in ROOT.glob("docs/lessons/*.py")}
    assert {f"{name}.html" for name in written} <= pages.keys()
    for name, text in pages.items():
        assert not LOADED.search(text), name
        assert "glossary.html" in text or name == "readers/glossary.html", name
    declared = re.findall(
        r"^int (labmate_\w+)\(", "".join(p.read_text() for p in ROOT.glob("generated/labmate/*[!f].h")), re.M
    )
    assert len(declared) > 50
    for name in declared:
        assert f'id="c.{name}"' in pages["reference/c_labmate.html"], name
    for name in noslip.__all__:
        assert f'id="noslip.{name}"' in pages["reference/python.html"], name
    assert "Watch the run of waypoints.toml" in pages["gallery.html"]
    text = unescape(re.sub("<[^>]*>", "", pages["reference/spec.html"]))
    for name in ("output.path", "reference.approach", "contact", "segments", "bandwidth"):
        assert name in text, name


# -- in a browser --------------------------------------------------------------------------------------------


@pytest.fixture
def tab(tmp_path) -> Iterator[Page]:
    """A page in a browser; fails if a script of it did."""
    with browser(tmp_path) as tab:
        yield tab
        assert not tab.faults


@pytest.mark.nightly
def test_search_needs_no_server(site, tab):
    """From a file: the words of a page lead to it."""
    tab.open(f"{(site / 'search.html').as_uri()}?q=involutive")
    shown = tab.until("document.body.innerText.includes('Search finished')", "document.body.innerHTML")
    assert 'href="readers/glossary.html' in shown


@pytest.mark.nightly
def test_paper(site, tab):
    """Method, guarantees, evidence and how to cite, with every claim of the guarantees,
    on four printed pages."""
    paper = (site / "paper.html").read_text()
    for name in ("Method", "Guarantees", "Evidence", "Assumptions", "How to cite", "Repository"):
        assert name in paper, name
    for name in re.findall(r"^\| `(\w[\w-]*)`", (ROOT / "checks/guarantees/README.md").read_text(), re.M):
        assert f">{name}<" in paper, name
    tab.open((site / "paper.html").as_uri())
    assert len(re.findall(rb"/Type\s*/Page\b", tab.printed())) == 4


@pytest.fixture(scope="module")
def page(tmp_path_factory) -> Path:
    """The playground."""
    need("clang", "wasm-ld")
    folder = tmp_path_factory.mktemp("page")
    run(sys.executable, "examples/playground/build.py", folder)
    return folder / "index.html"


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("settings", "status"),
    [
        ({}, "the law is in force"),
        ({"speed": 6, "size": 2}, "the wheels would slip here"),
        ({"robot": "car", "mu": 0.05, "speed": 9}, "the wheels would slip here"),
        ({"robot": "no such robot"}, "the law is in force"),
        ({"law": "II", "x": [0, 2, 1.5707963267948966, 0, 0, 3, 3]}, "singular: the law has no torque here"),
    ],
)
def test_address_holds_the_run(settings, status, page, tab):
    """What happens is told, for the settings in the page's address."""
    tab.open(f"{page.as_uri()}#{quote(json.dumps(settings))}")
    tab.until(f"document.getElementById('status').textContent.includes({json.dumps(status)})")


# -- playground ----------------------------------------------------------------------------------------------

RUN = """
const follow = async (given) => {
  const drawn = arcsThrough(given.points || [], given.closed), s = {
      ...defaultsOf(given.robot || "labmate"), ...given, drawn };
  const loop = await Loop.of(s.robot), rows = [];
  for (let good = loop.start(s); good && rows.length <= 1000; good = loop.step()) {
    const { t, x, tau, use, forces } = loop.now;
    rows.push({ x: [t, ...x, ...tau], y: loop.get("y"), use, forces });
  }
  return { spec: spec(s), rows, status: loop.status };
};
"""
IN_NODE = """
(async () => {
  const runs = [];
  for (const given of JSON.parse(process.argv[2])) runs.push(await follow(given));
  process.stdout.write(JSON.stringify(runs));
})();
"""
AHEAD = {"x": [0.0, 2.0, 0.3, 0.0, 0.0, 3.0, 3.0]}
POINTS = {
    "points": [[0, 0], [4, 1], [8, 0], [10, -4], [6, -6], [2, -4]],
    "x": [0.0, -0.5, 0.4, 0.0, 0.0, 1.0, 1.0],
}
CAR = {"robot": "car", "x": [17.0, -5.0, 1.4, 0.1, 0.0, 9.0, 0.0]}
TRAIN = {"robot": "tractor_trailer:3", "x": [5.5, -3.0, 1.5, 0.0, 0.0, 1.4, 1.3, 1.1, 2.0, 2.5]}
WIDE = [[3 * x, 3 * y] for x, y in POINTS["points"]]
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
    "car": {"mass": 1500, **CAR},
    "car, ellipse": {"law": "IV ellipse", "mu": 0.3, "mode": "grip", **CAR},
    "car, type II": {"law": "II", "angle": 10, **CAR, "x": [0.0, 2.0, 0.2, 0.1, 0.0, 9.0, 0.0]},
    "tractor, drawn path": {
        "robot": "tractor_trailer:0",
        "law": "IV path",
        "L": 0.5,
        "closed": True,
        **POINTS,
    },
    "a trailer, limits": {
        "robot": "tractor_trailer:1",
        "limit": 20,
        "mode": "slow",
        "trailers": 120,
        "L": 0.5,
    },
    "two trailers": {"robot": "tractor_trailer:2", "law": "I", "angle": 70, "L": 0.5},
    "car, drawn path": {
        **CAR,
        "law": "IV path",
        "closed": True,
        "x": [0, -1, 0.3, 0.1, 0, 3, 0],
        "points": WIDE,
    },
    "forklift": {"robot": "forklift", "x": [7.0, -2.0, 1.4, 0.2, 0.0, 2.0, 0.0]},
    "mecanum platform": {"robot": "mecanum", "limit": 1},
    "mecanum platform, grip": {
        "robot": "mecanum",
        "mode": "grip",
        "mu": 0.05,
        "x": [2, -0.4, 0.3, 0, 0, 0, 0, 0.1, 0.1, 0],
    },
    "balancer": {"robot": "balancer", "believed": 4},
    "three trailers": {"trailers": 100, "believedTrailers": 60, **TRAIN},
    "three trailers, drawn path": {
        **{**TRAIN, "law": "IV path", "closed": False, "L": 0.5, "points": POINTS["points"]},
        "x": [0.0, -0.5, 0.4, 0.0, 0.0, 0.3, 0.2, 0.1, 1.0, 1.0],
    },
    "into the singular set": {"law": "II", "angle": 30, "x": [0.0, 2.0, 2.2, 0.0, 0.0, 3.0, 3.0]},
}


@pytest.fixture(scope="module")
def model(page) -> str:
    """The page's script that simulates, for Node."""
    need("node")
    (model,) = re.findall(r'<script id="model">(.*?)</script>', page.read_text(), re.S)
    return model


@pytest.fixture(scope="module")
def playground(model, tmp_path_factory) -> dict[str, dict]:
    """What the page's own scripts compute, run by Node: name -> its SPEC, a row for each period,
    the last status."""
    file = tmp_path_factory.mktemp("playground") / "run.js"
    file.write_text(model + RUN + IN_NODE)
    return dict(zip(RUNS, json.loads(run("node", file, json.dumps(list(RUNS.values())))), strict=True))


def check_same(page: dict, name: str) -> None:
    """Fails unless times, states and torques of the page have the same bits in `noslip simulate` of the SPEC
    that it gives."""
    there = simulate(varied(page["spec"], name, {}))
    rows = {key: np.array([row[key] for row in page["rows"]]) for key in ("x", "y", "use", "forces")}
    stopped, count = there.stopped is not None, len(page["rows"])
    assert page["status"] == there.status[-1] and stopped == (name == "into the singular set")
    assert count == len(there.t) - stopped and (count == 1001 or stopped)
    kept = slice(0, count)
    assert (rows["x"] == np.column_stack([there.t, there.x, there.tau])[kept]).all()
    assert np.abs(rows["y"] - there.y[kept]).max() <= 1e-12  # m, m/s, rad: another order of the same sums
    if not there.use:  # loads that are not known: the page shows none
        assert not rows["use"].size
        return
    use = np.column_stack(list(there.use.values()))[kept]  # up to thousands beside the singular set
    assert np.max(np.abs(rows["use"] - use) / (1 + use)) <= 1e-11
    contacts = grip(there).contacts
    forces = np.column_stack(
        [part[kept] for contact in contacts for part in (contact.longitudinal, contact.lateral)]
    )
    assert np.max(np.abs(rows["forces"] - forces) / (1 + np.abs(forces))) <= 1e-10


@pytest.mark.nightly
@pytest.mark.parametrize("name", RUNS)
def test_playground_is_simulate(name, playground):
    """10 s of each robot, run by Node."""
    check_same(playground[name], name)


LEAVES = """
(async () => {
  const ended = [];
  for (const robot of Object.keys(ROBOTS)) {
    const loop = await Loop.of(robot), usual = defaultsOf(robot);
    let good = loop.start(usual);
    for (let k = 0; good && k < 300; k++) good = loop.step();
    const driving = loop.get("x"), laws = lawsOf(robot).filter((law) => law !== "IV path");
    for (const law of laws) for (const heading of [0, Math.PI / 2, driving[2]]) {
      const s = { ...usual, law, x: driving.with(2, heading) }, x = loop.startFor(s);
      good = loop.start({ ...s, x });
      for (let k = 0; good && k < 500; k++) good = loop.step();
      ended.push([x !== s.x, good ? "" : loop.status]);
    }
  }
  process.stdout.write(JSON.stringify(ended));
})();
"""


@pytest.mark.nightly
def test_another_law_goes_on(model, tmp_path):
    """Wherever a robot is and whatever it drives at, the page finds a start near it from which another law
    has torques."""
    file = tmp_path / "run.js"
    file.write_text(model + LEAVES)
    turned, stopped = zip(*json.loads(run("node", file)), strict=True)
    assert sum(turned) > 5 and not any(stopped)


IN_BROWSER = """
new Promise((done) => {
  const s = { ...defaultsOf("tractor_trailer:3"), trailers: 100 }, rows = [], other = makeWorker();
  other.onmessage = ({ data }) => {
    data.rows.forEach(({ t, x, tau }) => rows.push([t, ...x, ...tau]));
    if (rows.length > 1000) done({ spec: spec(s), rows });
  };
  other.postMessage({ run: 1, settings: s });
  other.postMessage({ run: 1, steps: 1000 });
})
"""
CARRY = """
(() => {
  const floor = element("floor"), { left, top, width, height } = floor.getBoundingClientRect(),
      [x, y] = now.x;
  const carry = (kind, clientX, clientY) => floor.dispatchEvent(new PointerEvent(kind, { clientX, clientY,
      buttons: 1 }));
  const [u, v] = [left + width / 2 + x * scale, top + height / 2 - y * scale];
  floor.setPointerCapture = () => {}; // there is no pointer to capture
  carry("pointerdown", u, v);
  carry("pointermove", u - 2 * scale, v);
  carry("pointerup", u - 2 * scale, v);
  return settings.x[0] - x;
})()
"""


@pytest.mark.nightly
def test_browser_is_simulate(page, tab):
    """10 s of three trailers, computed by the page's worker in a browser,
    have the bits of `noslip simulate`."""
    tab.open(page.as_uri())
    found = tab.value(IN_BROWSER)
    there = simulate(varied(found["spec"], "page", {}))
    assert (np.array(found["rows"]) == np.column_stack([there.t, there.x, there.tau])).all() and len(
        there.t
    ) == 1001


@pytest.mark.nightly
def test_dragged_robot_comes_back(page, tab):
    """Pulled 2 m off its circle, the robot is on it again after a while."""
    tab.open(page.as_uri())
    before = tab.until("now && now.t > 8", "now.error[0]")
    assert abs(tab.value(CARRY) + 2) < 0.2
    away = tab.until("!waiting && now.t < 1", "now.error[0]")
    back = tab.until("now.t > 10", "now.error[0]")
    assert abs(before) < 0.3 < abs(away) and abs(back) < 0.01  # m


@pytest.mark.nightly
def test_controls_come_before_charts_on_a_phone(page, tab):
    """At 390 pixels, without a need to scroll sideways; every law has a name in words."""
    tab.resize(390, 844)
    tab.open(page.as_uri())
    tops = tab.value("['floor', 'controls', 'plots'].map((id) => element(id).getBoundingClientRect().top)")
    assert tops == sorted(tops) and tab.value("document.documentElement.scrollWidth") <= 390
    names = tab.value("Object.keys(ROBOTS).flatMap((robot) => lawsOf(robot).map((law) => LAWS[law]))")
    assert len(names) > 40 and not any(re.search(r"\b[IV]+\b|undefined", name) for name in names)


CHOOSE = """
(() => {
  const { law } = element("controls").elements;
  law.value = "II";
  for (const kind of ["input", "change"]) law.dispatchEvent(new Event(kind, { bubbles: true }));
})()
"""
NUDGE = 'element("floor").dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowUp" }))'


@pytest.mark.nightly
def test_stopped_robot_goes_on(page, tab):
    """A robot that stands at a singular heading goes on after an arrow key,
    and one that drives after a change of law."""
    settings = {"law": "II", "x": [0, 2, np.pi / 2, 0, 0, 0, 0]}
    tab.open(f"{page.as_uri()}#{quote(json.dumps(settings))}")
    stuck = tab.until("now && !going", "regular.filter((value) => Math.abs(value) < FORBIDDEN).length")
    tab.value(NUDGE)
    tab.until("going && !waiting && now.t > 3")
    tab.value('choose("car")')
    tab.until("going && now.t > 3 && now.t < 8")
    tab.value(CHOOSE)
    assert stuck and tab.until("settings.law === 'II' && !waiting && now.t > 3", "going")
    lateral = float(
        re.findall(r"lateral error (-?\d+\.\d\d) m", tab.value("element('measures').textContent"))[0]
    )
    assert abs(lateral - tab.value("lateralError()")) < 0.5  # m; it goes on


@pytest.mark.nightly
def test_playground_page(page):
    """One file, below 1 MB, that loads nothing."""
    text = page.read_text()
    assert [path.name for path in page.parent.iterdir()] == ["index.html"] and len(text) < 1_000_000
    assert not LOADED.search(text) and not re.search("https?:", text, re.I)  # base64 has no colon
