"""The comparison of path following with the usual controllers: path, controllers and measures,
and a run of each."""

import importlib.util
import math
from pathlib import Path

import noslip
import numpy as np
import pytest

pytest.importorskip("mujoco")
FILE = Path(noslip.__file__).parent / "checks/bench" / "following.py"
GOOD = {
    "pure pursuit": {"lookahead": 0.5, "bandwidth": 4.0},
    "regulated pure pursuit": {"lookahead": 0.8, "bandwidth": 4.0},
    "cascaded PID": {"distance": 2.0, "heading": 5.0, "integral": 0.5, "rate": 0.05, "bandwidth": 4.0},
    "noslip, Type IV": {"kp": 4.0, "kd": 4.0, "kv": 2.0, "ahead": 0.15},
}


@pytest.fixture(scope="module")
def bench():
    spec = importlib.util.spec_from_file_location("following", FILE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_points_are_those_of_lines_and_arcs(bench):
    """The end of each piece, in closed form; the law's own path ends where they do."""
    x, y, heading, s = 0.0, 0.0, 0.0, 0.0
    for length, kappa in bench.PATH:
        length = round(length / bench.SPACING) * bench.SPACING
        chord = 2 * math.sin(kappa * length / 2) / kappa if kappa else length
        x, y = (
            x + chord * math.cos(heading + kappa * length / 2),
            y + chord * math.sin(heading + kappa * length / 2),
        )
        heading, s = heading + kappa * length, s + length
        assert bench.POINTS[round(s / bench.SPACING), :3] == pytest.approx([x, y, heading], abs=1e-4)
    segments = bench.spec_of(0.5, 0.7, GOOD["noslip, Type IV"], "cut").output.path.segments
    assert [segment.curvature for segment in segments] == pytest.approx([kappa for _, kappa in bench.PATH])


def test_nearest_goes_forward(bench):
    nearest = bench.Nearest()
    random = np.random.default_rng(17)
    for k in range(0, len(bench.POINTS) - 200, 40):
        x, y, heading, _ = bench.POINTS[k]
        off = random.uniform(-0.2, 0.2)
        found, distance = nearest(np.array([x - off * math.sin(heading), y + off * math.cos(heading)]))
        assert abs(found - k) <= 1 and distance == pytest.approx(off, abs=1e-9)


def test_pure_pursuit_goes_round_the_circle_through_the_point_ahead(bench):
    """On an arc, along it, the circle is the arc; and at any pose the circle passes through the point."""
    on_arc = round((1.5 + 0.3) / bench.SPACING)
    place, heading = bench.POINTS[on_arc, :2], bench.POINTS[on_arc, 2]
    rate = bench.pure_pursuit(bench.Pose(place, heading, on_arc, 0.0), 0.7, {"lookahead": 0.5})
    assert rate == pytest.approx(0.7 / 1.0, rel=1e-3)
    turned = bench.Pose(place, heading - 0.3, on_arc, 0.0)
    kappa = bench.pure_pursuit(turned, 0.7, {"lookahead": 0.5}) / 0.7
    centre = place + np.array([-math.sin(turned.heading), math.cos(turned.heading)]) / kappa
    ahead = bench.POINTS[on_arc:, :2]
    point = ahead[np.argmax(np.hypot(*(ahead - place).T) >= 0.35)]
    assert np.hypot(*(point - centre)) == pytest.approx(1 / abs(kappa), rel=1e-9)


def test_the_others_on_the_path_ask_for_its_curvature(bench):
    on_arc = round((1.5 + 0.3) / bench.SPACING)
    pose = bench.Pose(bench.POINTS[on_arc, :2], bench.POINTS[on_arc, 2], on_arc, 0.0)
    assert bench.CascadedPid(GOOD["cascaded PID"])(pose, 0.7) == pytest.approx((0.7, 0.7))
    tight = round((1.5 + math.pi / 2 + 1.0 + 0.2) / bench.SPACING)
    pose = bench.Pose(bench.POINTS[tight, :2], bench.POINTS[tight, 2], tight, 0.0)
    v, w = bench.RegulatedPurePursuit({"lookahead": 0.5})(pose, 0.7)
    assert v == pytest.approx(0.7 * 0.75 / 0.9, rel=1e-2) and w == pytest.approx(-v / 0.75, rel=1e-2)


def test_the_wheels_keep_their_limit_and_let_go_of_it(bench):
    wheels = bench.Wheels(bench.SIZES, 4.0)
    for _ in range(200):
        assert wheels(50.0, 0.0, np.zeros(2)) == pytest.approx([bench.TORQUE] * 2)
    assert np.all(wheels(0.0, 0.0, np.ones(2)) < 0)  # at once: the sum stood still at the limit


@pytest.mark.parametrize("name", GOOD)
def test_what_is_tried_lies_in_the_box_and_is_as_much_for_all(bench, name):
    tried = bench.candidates(name)
    box = bench.OURS if name in bench.NOSLIP else bench.USUAL[name].box
    assert len(tried) == bench.SAMPLES and set(box) == set(GOOD[name])
    assert all(low <= one[key] <= high for one in tried for key, (low, high) in box.items())


def test_measures(bench):
    """Along the path at a constant distance, and a run that does not arrive."""
    q = np.zeros((len(bench.POINTS), 5))
    x, y, heading, _ = bench.POINTS.T
    q[:, 2] = heading
    ahead, left = bench.SIZES["d"], 0.02
    q[:, 0], q[:, 1] = (
        x + ahead * np.cos(heading) - left * np.sin(heading),
        y + ahead * np.sin(heading) + left * np.cos(heading),
    )
    t = bench.SPACING * np.arange(len(q)) / 0.5
    tau, slip = np.ones((len(q), 2)), np.full(len(q), 0.3)
    found = bench.measured(t, q, tau, slip, None)
    assert found["rms"] == pytest.approx(0.02, rel=1e-3) and found["speed"] == pytest.approx(0.5, rel=1e-3)
    assert found["torque"] == 1.0 and found["change"] == 0.0 and found["slip"] == 0.3
    assert bench.measured(t[:100], q[:100], tau[:100], slip[:100], None)["rms"] is None
    assert bench.measured(t, q, tau, slip, "range") == {"rms": None, "stopped": "range"}


@pytest.mark.nightly
@pytest.mark.parametrize("name", GOOD)
def test_each_follows_the_path(bench, name):
    found = bench.run(name, 0.7, 0.7, GOOD[name])
    assert found["rms"] < 0.04 and found["largest"] < 0.06 and found["slip"] < 0.01
