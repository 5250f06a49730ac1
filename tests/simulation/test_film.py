"""Films of runs: what they show is where the robot was."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from noslip.cli.main import main
from noslip.readers.errors import BadInput
from noslip.simulation.closed_loop import simulate
from noslip.simulation.film.film import RATE, film, film_of
from noslip.simulation.specification.vary import read_varied

SPECS = Path(__file__).resolve().parents[2] / "examples/specs"
SHORT = {"simulation.duration": 0.2}


def data(page: bytes) -> dict:
    """The numbers in a page."""
    return json.loads(
        re.search(r'<script type="application/json" id="film">(.*?)</script>', page.decode()).group(1)
    )


def test_a_film_of_each_kind(tmp_path, capsys):
    """One picture for each 1/20 s; a kind of film that cannot be written is refused before the run."""
    from PIL import Image

    run = ["simulate", "line", "-o", str(tmp_path / "run.csv"), "--set", "simulation.duration=0.2"]
    for option, name in (("--animate", "run.gif"), ("--video", "run.html")):
        assert main([*run, option, str(tmp_path / name)]) == 0
    with Image.open(tmp_path / "run.gif") as picture:
        assert picture.n_frames == 5
    assert len(data((tmp_path / "run.html").read_bytes())["t"]) == 5
    for name in ("run.avi", "run"):
        assert main([*run, "--animate", str(tmp_path / name)]) == 2
        assert ".gif, .mp4 or .html" in capsys.readouterr().err


def test_the_page_shows_where_the_robot_is():
    """LABMATE on the line: wheels stay 2 b apart, P_o goes its way,
    and the path to follow is the line x = y, to the mm."""
    run = simulate(read_varied(SPECS / "line.toml", SHORT))
    shown = data(film(run, ".html"))
    assert shown["t"] == [k / RATE for k in range(5)] and shown["slip"] is None
    rows = np.searchsorted(run.t, np.array(shown["t"]) - 1e-9)
    assert np.abs(np.array(shown["way"]) - 1000 * run.q[rows, :2]).max() <= 0.5
    wheels = [
        np.array(line["at"]).reshape(5, -1, 2).mean(axis=1) for line in shown["lines"] if not line["closed"]
    ]
    b = next(p.default for p in run.law.system.mechanism.parameters if p.name == "b")
    assert np.abs(np.hypot(*(wheels[0] - wheels[1]).T) - 2000 * b).max() <= 2.0
    (path,) = (np.array(curve) for curve in shown["path"])
    assert np.abs(path[:, 0] - path[:, 1]).max() <= 1 and np.ptp(path[:, 0]) > 2000


@pytest.mark.parametrize("name", ["robots/turntable_ball", "robots/geared_arm", "figures/waypoints"])
def test_all_that_moves_is_in_view(name):
    """The view of a vehicle follows it and holds all of its lines; that of others holds the whole run."""
    frames = film_of(simulate(read_varied(SPECS / f"{name}.toml", SHORT)))
    for line in frames.lines:
        if frames.view:
            assert np.abs(line - frames.way[:, None]).max() <= frames.view
        else:
            x, y, half = frames.box()
            assert np.abs(line - (x, y)).max() <= half
    assert frames.path


def test_a_robot_without_lines_is_refused(monkeypatch):
    """The arm, if it drew nothing: it is no vehicle."""
    run = simulate(read_varied(SPECS / "robots/geared_arm.toml", SHORT))
    monkeypatch.setattr(run.law.system.mechanism, "lines", [])
    with pytest.raises(BadInput, match="geared_arm has no lines to draw"):
        film(run, ".html")
