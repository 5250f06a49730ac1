"""Type IV near the normal to the path: the damped law against its closed form, its edge, sign and bound,
and where it ends."""

import json
import math
import re
import runpy
from pathlib import Path

import numpy as np
import pytest
from noslip.analysis.answers import analyse, damped_near
from noslip.checks.verification.verify import differences
from noslip.cli.main import main
from noslip.codegen.derivation import stages
from noslip.codegen.files import law_program, robot_files
from noslip.model import ModelError, control_law
from noslip.model.linearization import ASIDE, STEEPEST
from noslip.model.outputs import output_map
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot, law_of, system_of
from noslip.simulation.closed_loop import simulate
from noslip.simulation.controllers.backends import make_controller
from noslip.simulation.controllers.compiled import library
from noslip.simulation.specification.spec import spec_of_table
from noslip.simulation.specification.vary import read_varied

BAND, LOOKAHEAD = 0.2, 0.3  # of the LABMATE with L = 0
PATHS = ("line", "circle", "ellipse", "segment", "segment_offset")
KP, KD, KV = 1.0, 2.5, 2.0


def controller(name: str, backend: str = "c", band: float | None = BAND, **changed: float):
    law = law_of(find_robot("labmate"), name)
    given = {"band": band} | changed
    values = [
        [given.get(q.name, q.default) for q in group] for group in (law.parameters, law.config, law.gains)
    ]
    return make_controller(backend, law, *values)


def state(rng: np.random.Generator, x: float, y: float, heading: float) -> np.ndarray:
    return np.array([x, y, heading, *rng.uniform(-20, 20, 2), *rng.uniform(-10, 10, 2)])


def closed_form(
    heading: float,
    nu: np.ndarray,
    y: float,
    reference: np.ndarray,
    l: float = LOOKAHEAD,  # noqa: E741
) -> tuple[float, ...]:
    """Forward and yaw acceleration on the line y = 0, distance y of P_l, by hand; e,
    and the part that is lost."""
    r, b = 0.15, 0.75
    v, omega = r * (nu[0] + nu[1]) / 2, r * (nu[0] - nu[1]) / (2 * b)
    s, c = math.sin(heading), math.cos(heading) * math.copysign(1, l)
    y_d, yd_d, ydd_d, v_d, vd_d = reference
    along = vd_d + KV * (v_d - v)
    asked = ydd_d + KD * (yd_d - v * s) + KP * (y_d - y) - s * (along - l * omega**2)
    x = c / BAND
    inverse, lost = (x * (2 - x * x) / BAND, (1 - x * x) ** 2) if abs(x) < 1 else (1 / c, 0.0)
    aside = asked * inverse - KD * abs(l) * omega - ASIDE * lost * KD * v * s
    return along, (aside / abs(l)) - v * omega / l, asked, lost


@pytest.mark.parametrize("L", [0.0, -0.9])
@pytest.mark.parametrize("backend", ["c", "casadi"])
def test_the_accelerations_are_those_of_the_closed_form(backend, L):
    """Inside and outside of the band, to the edge and to its middle, and for a P_l behind the axle."""
    rng, law = np.random.default_rng(1), controller("type_iv_line_damped", backend, A=0.0, B=1.0, C=0.0, L=L)
    for x in (*rng.uniform(-1.2, 1.2, 40), 0.0, 1.0, -1.0):
        heading = rng.choice((-1, 1)) * (math.pi / 2 - math.asin(x * BAND))
        at, reference = state(rng, *rng.uniform(-3, 3, 2), heading), rng.uniform(-2, 2, 5)
        found = law.evaluate(at, reference)
        y = at[1] + L * math.sin(heading)
        along, turning, *_ = closed_form(heading, at[5:], y, reference, L + 0.3)
        u = found.values["u"].ravel()
        made = np.array([0.15 * (u[0] + u[1]) / 2, 0.15 * (u[0] - u[1]) / 1.5])
        assert found.status == "ok"
        assert np.abs(made - (along, turning)).max() < 1e-11 * max(1.0, abs(turning))


@pytest.mark.parametrize("path", PATHS)
def test_c_and_casadi_agree_throughout_the_band(path):
    rng = np.random.default_rng(2)
    name = f"type_iv_{path}_damped"
    W = {"W": 0.2} if "offset" in path else {}
    in_c, exact = (controller(name, backend, curvature=0.1, **W) for backend in ("c", "casadi"))
    for _ in range(200):
        at = state(rng, *rng.uniform(-5, 5, 2), rng.uniform(-math.pi, math.pi))
        reference = rng.uniform(-2, 2, 5)
        (one, tau), (other, expected) = in_c.step(at, reference), exact.step(at, reference)
        assert one == other == "ok"
        assert np.abs(tau - expected).max() < 1e-12 * max(1.0, np.abs(expected).max())


@pytest.mark.parametrize("backend", ["c", "cf"])
@pytest.mark.parametrize("path", PATHS)
def test_outside_the_band_every_bit_is_that_of_the_law_without_one(path, backend):
    rng = np.random.default_rng(3)
    damped, plain = controller(f"type_iv_{path}_damped", backend), controller(f"type_iv_{path}", backend)
    size = controller(f"type_iv_{path}_damped", "casadi").law.linearization.damping
    x_of = damped.law.at_state(size.x)
    fixed = [[q.default for q in group] for group in (damped.law.parameters, damped.law.config)]
    outside = differ = 0
    for _ in range(300):
        at, reference = (
            state(rng, *rng.uniform(-5, 5, 2), rng.uniform(-math.pi, math.pi)),
            rng.uniform(-2, 2, 5),
        )
        x = float(x_of(at, *fixed))
        same = damped.step(at, reference)[1].tobytes() == plain.step(at, reference)[1].tobytes()
        assert same or abs(x) < 1 + 1e-5
        outside, differ = outside + (abs(x) > 1), differ + (not same)
    assert outside > 150 and differ > 10


def test_both_sides_of_the_edge_have_the_same_value_and_slope():
    law = controller("type_iv_line_damped", "c", A=0.0, B=1.0, C=0.0)
    rng = np.random.default_rng(4)
    at, reference = state(rng, 0.0, 1.0, 0.0), rng.uniform(-1, 1, 5)

    def tau(c: float) -> np.ndarray:
        at[2] = math.acos(c)
        return law.step(at, reference)[1]

    h = 1e-6
    before, edge, after = tau(BAND - h), tau(BAND), tau(BAND + h)
    far, steps = tau(BAND + 0.01) - tau(BAND), (edge - before, after - edge)
    assert np.abs(steps).max() < 20 * h * np.abs(far).max() / 0.01 + 1e-9  # no jump
    assert np.abs((steps[0] - steps[1]) / h).max() < 1e-3 * np.abs(steps[0] / h).max()  # nor of the slope


def test_the_yaw_acceleration_turns_the_way_that_is_asked_and_is_bounded():
    """At rest, where nothing else acts; and its bound, anywhere in the band."""
    law, rng = controller("type_iv_line_damped", "c", A=0.0, B=1.0, C=0.0), np.random.default_rng(5)
    for _ in range(300):
        x, sign = rng.uniform(-1, 1), rng.choice((-1, 1))
        heading = sign * (math.pi / 2 - math.asin(x * BAND))
        at, reference = state(rng, *rng.uniform(-3, 3, 2), heading), rng.uniform(-2, 2, 5)
        for nu in (at[5:].copy(), np.zeros(2)):
            at[5:] = nu
            v, omega = 0.15 * nu.sum() / 2, 0.15 * (nu[0] - nu[1]) / 1.5
            y = at[1]
            _, _, asked, _ = closed_form(heading, nu, y, reference)
            u = law.evaluate(at, reference).values["u"].ravel()
            aside = LOOKAHEAD * 0.15 * (u[0] - u[1]) / 1.5 + v * omega
            if not nu.any():
                assert aside * asked * x >= 0
            assert (
                abs(aside + KD * LOOKAHEAD * omega)
                <= STEEPEST * abs(asked) / BAND + ASIDE * KD * abs(v) + 1e-9
            )
    grid = np.linspace(-1, 1, 100_001)
    assert STEEPEST == pytest.approx((grid * (2 - grid**2)).max(), rel=1e-8)


def test_in_the_middle_it_turns_towards_the_side_of_its_motion():
    """Exactly normal and driving: forward with P_l ahead, in reverse with P_l behind,
    towards the path or away from it."""
    for L, v in ((0.0, 1.0), (-0.6, -1.0)):
        law = controller("type_iv_line_damped", "casadi", A=0.0, B=1.0, C=0.0, L=L)
        for sign in (-1.0, 1.0):
            nu = v / 0.15
            at = np.array([0.0, -L * sign, sign * math.pi / 2, 0.0, 0.0, nu, nu])  # P_l on the path
            turned = law.evaluate(at, np.array([0.0, 0.0, 0.0, v, 0.0])).values["u"].ravel()
            yaw = turned[0] - turned[1]
            assert yaw * -math.sin(at[2]) * v > 0  # the motion v (cos, sin) turns towards +x


SPEC = {
    "robot": "labmate",
    "output": {
        "type": "IV",
        "near_singular": "damped",
        "path": {"kind": "line", "A": 0.0, "B": 1.0, "C": 0.0},
    },
    "reference": {"speed": 1.0},
    "initial": {"point": [0.0, 2.0], "heading": math.pi / 2, "speed": 1.0},
    "simulation": {"duration": 20.0, "period": 0.01},
}
CIRCLE = {"kind": "circle", "x_f": 0.0, "y_f": 0.0, "R": 5.0}


def run(initial: dict, **output: object):
    table = {**SPEC, "initial": SPEC["initial"] | initial, "output": SPEC["output"] | output}
    return simulate(spec_of_table(table, Path("normal.toml")))


@pytest.mark.parametrize("speed", [0.0, 1.0])
@pytest.mark.parametrize("heading", [90.0, -90.0])
@pytest.mark.parametrize("y", [-4.0, 0.5, 2.0])
def test_starts_at_exactly_the_normal_reach_the_path(y, heading, speed):
    initial = {"point": [0.0, y], "heading": math.radians(heading), "speed": speed}
    made = run(initial)
    assert made.stopped is None and abs(made.error[-1, 0]) < 1e-2
    # There it turns past the line, and back
    assert made.q[-1, 0] > made.q[0, 0] or (y, heading, speed) == (-4.0, -90.0, 0.0)
    with pytest.raises(BadInput, match='set \\[output\\] near_singular = "damped"'):
        run(initial, near_singular="refuse")


@pytest.mark.parametrize("angle", [0.0, 180.0])
def test_starts_normal_to_a_circle_reach_it(angle):
    """From outside, straight away from the centre and straight towards it."""
    made = run({"point": [7.0, 0.0], "heading": math.radians(angle)}, path=CIRCLE)
    assert made.stopped is None and abs(made.error[-1, 0]) < 1e-2


@pytest.mark.nightly
def test_a_composite_path_is_followed_from_the_normal_and_swept_alike(tmp_path, capsys):
    """`follow` in C against the model, and the simulator of sweeps against `simulate`,
    with a band of their own."""
    text = (Path(__file__).parents[2] / "examples/specs/figures/figure_11.toml").read_text()
    text = re.sub(r"(?m)^type = .*$", 'type = "IV"\nnear_singular = "damped"\nband = 0.3', text)
    text = re.sub(
        r"(?s)\[initial\].*?(?=\n\[)",
        '[initial]\npoint = [0.0, 1.0]\nheading = "-90 deg"\nspeed = 1.0\n',
        text,
    )
    text = re.sub(r"(?m)^(duration|period|backend) = .*$", "", text).replace(
        "[simulation]", "[simulation]\nduration = 8.0\nperiod = 0.01"
    )
    spec, out = tmp_path / "s.toml", tmp_path / "s.parquet"
    spec.write_text(text + "\n[sweep]\nseed = 1\n[sweep.initial]\nspeed = { uniform = [0.5, 1.5] }\n")
    assert main(["sweep", str(spec), "--samples", "4", "-o", str(out), "--verify", "4"]) == 0
    assert "4 ok" in capsys.readouterr().out
    spec.write_text(text)
    in_c, exact = (
        simulate(read_varied(str(spec), {"simulation.backend": backend})) for backend in ("c", "casadi")
    )
    assert in_c.stopped is None and np.abs(in_c.q - exact.q).max() < 1e-7
    assert abs(in_c.error[-1, 0]) < 0.02


@pytest.mark.nightly
def test_a_sweep_shows_what_converges_and_what_was_refused(tmp_path, capsys):
    """From all round and 3 m beside a line: what becomes singular without the band is on the line with it."""
    text = """
robot = "labmate"
output = {{ type = "IV", {near} path = {{ kind = "line", A = 0.0, B = 1.0, C = 0.0 }} }}
reference = {{ speed = 1.0 }}
initial = {{ point = [0.0, 3.0], heading = 0.0, speed = 1.0 }}
simulation = {{ duration = 15.0, period = 0.01 }}
[sweep]
seed = 1
fails = {{ final = 0.05 }}
[sweep.initial]
heading = {{ uniform = ["-180 deg", "180 deg"] }}
"""
    failed = []
    for near in ("", 'near_singular = "damped", '):
        spec, out = tmp_path / f"s{len(failed)}.toml", tmp_path / f"s{len(failed)}.parquet"
        spec.write_text(text.format(near=near))
        assert main(["sweep", str(spec), "--samples", "200", "-o", str(out), "--json"]) in (0, 1)
        failed.append(json.loads(capsys.readouterr().out)["failed"])
    assert failed[0] > 20 and failed[1] == 0


def test_what_cannot_be_damped_is_refused_with_the_reason(capsys):
    labmate = system_of(find_robot("labmate"))
    with pytest.raises(ModelError, match="only laws of Type IV can be damped"):
        output_map(labmate, "type_i_damped")
    for name, says in (
        ("damped_extended", "cannot be extended"),
        ("damped_kinematic", "cannot be kinematic"),
    ):
        with pytest.raises(BadInput, match=says):
            law_of(find_robot("labmate"), f"type_iv_line_{name}")
    car = system_of(find_robot("car"))
    with pytest.raises(ModelError, match="forward speed and yaw rate are fixed combinations"):
        control_law(car, output_map(car, "type_iv_line_damped"))
    for output, says in (
        ({"type": "I", "path": None}, 'near_singular = "damped" requires .output. type = "IV"'),
        ({"near_singular": "refuse", "band": 0.1}, "band requires .output. near_singular"),
        ({"band": 1.5}, "the band is not between 0.01 and 1"),
        ({"band": 0.0099}, "the band is not between 0.01 and 1"),
        ({"band": 1e-5}, "the band is not between 0.01 and 1"),
    ):
        table = {key: value for key, value in (SPEC["output"] | output).items() if value is not None}
        with pytest.raises(BadInput, match=says):
            reference = {"position": [0.0, 0.0]} if table["type"] == "I" else SPEC["reference"]
            simulate(spec_of_table({**SPEC, "output": table, "reference": reference}, Path("x.toml")))


def test_the_analysis_says_what_is_lost():
    form = analyse(find_robot("labmate"), ["type_iv_line_damped"]).outputs["type_iv_line_damped"]
    assert any("(1 - x^2)^2" in line for line in damped_near(form))
    assert damped_near(analyse(find_robot("labmate"), ["type_iv_line"]).outputs["type_iv_line"]) == []


@pytest.mark.nightly
def test_a_wrong_damped_inverse_is_found_before_it_is_written(monkeypatch, tmp_path):
    monkeypatch.setenv("NOSLIP_CACHE", str(tmp_path))
    original = stages._near

    def wrong(*given):
        band, near = original(*given)
        return band, near | {stages.Result.INPUTS: 1.001 * near[stages.Result.INPUTS]}

    monkeypatch.setattr(stages, "_near", wrong)
    system = system_of(find_robot("labmate"))
    law = control_law(system, output_map(system, "type_iv_line_damped"))
    law_program.cache_clear()
    found = differences(system, [law], robot_files(system, [law], ["double"]))
    law_program.cache_clear()
    library.cache_clear()
    assert found and "tau by" in found[0] and "differ" in found[0]


@pytest.mark.nightly
def test_the_picture_of_the_page_is_drawn():
    """docs/normal.py, with short runs: eight paths and the line;
    of the inverse three bands and both branches."""
    draw = runpy.run_path(str(Path(__file__).parents[2] / "docs" / "normal.py"))["draw"]
    paths, inverse = draw(0.1).axes
    assert len(paths.get_lines()) == 10 and len(inverse.get_lines()) == 5
    for line, band in zip(inverse.get_lines(), (0.1, 0.2, 0.4), strict=False):
        assert abs(line.get_ydata()[-1] - 1 / band) < 1e-12
