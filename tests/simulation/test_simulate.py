"""Closed loops against closed forms: paper, sections on path following; all compared in absolute values,
SI units."""

import csv
import dataclasses
import math
import re
from pathlib import Path

import numpy as np
import pytest
from noslip.cli.main import main
from noslip.readers.errors import BadInput
from noslip.simulation import closed_loop as module
from noslip.simulation.closed_loop import continuous, make_loop, simulate
from noslip.simulation.specification.spec import (
    Initial,
    OutputSection,
    PathSection,
    Reference,
    Spec,
    read_spec,
)
from noslip.simulation.specification.vary import read_varied
from scipy.integrate import solve_ivp
from scipy.linalg import expm

SPECS = Path(__file__).parents[2] / "examples/specs"
# Which asks much of the ground
BESIDE_THE_LINE = {"initial": {"point": [0.0, 2.0], "heading": math.pi / 2, "speed": 0.0}}
LINE, CIRCLE = read_varied(SPECS / "line.toml", BESIDE_THE_LINE), read_spec(SPECS / "circle.toml")
# m: half the wheels' distance, centre of mass ahead of the axle, wheel radius
B_HALF, D, R_WHEEL = 0.75, 0.30, 0.15
NORMAL = np.array([1.0, -1.0]) / math.sqrt(2)  # of y = x, towards growing distance


def changed(spec: Spec, **sections) -> Spec:
    """`spec` with entries of its sections, or whole ones, replaced."""
    made = {
        name: dataclasses.replace(getattr(spec, name), **v) if isinstance(v, dict) else v
        for name, v in sections.items()
    }
    return dataclasses.replace(spec, **made)


def with_gains(spec: Spec, kp: float, kd: float, kv: float) -> Spec:
    return dataclasses.replace(spec, gains={"kp": kp, "kd": kd, "kv": kv})


def channel(t, kp: float, kd: float, e: float, rate: float) -> np.ndarray:
    """Columns e(t), de/dt of e'' + kd e' + kp e = 0."""
    return expm(np.array([[0.0, 1.0], [-kp, -kd]]) * np.asarray(t)[:, None, None]) @ (e, rate)


def decay(slow: float, fast: float, e: float, rate: float):
    """The same as a function of t, which answers e and de/dt: kp = slow fast, kd = slow + fast."""
    a, b = (fast * e + rate) / (fast - slow), (slow * e + rate) / (slow - fast)

    def at(t: float) -> tuple[float, float]:
        slowly, fastly = a * math.exp(-slow * t), b * math.exp(-fast * t)
        return slowly + fastly, -slow * slowly - fast * fastly

    return at


def along_normal(run, normal=NORMAL) -> np.ndarray:
    """s = n . (cos phi, sin phi)."""
    return np.cos(run.q[:, 2]) * normal[..., 0] + np.sin(run.q[:, 2]) * normal[..., 1]


def s_on_line(t, l: float, s_0: float, rate, speed):  # noqa: E741
    """The heading's equation on a line, l ds/dt + v s = dh1/dt, integrated alone;
    where it reaches |s| = 1 it ends."""
    singular = lambda t, s: 1 - abs(s[0])  # noqa: E731
    singular.terminal = True
    return solve_ivp(
        lambda t, s: (rate(t) - speed(t) * s) / l,
        (0, t[-1]),
        [s_0],
        "DOP853",
        t,
        events=singular,
        rtol=1e-12,
        atol=1e-13,
    )


def beside_line(offset: float, speed: float) -> Spec:
    """`offset` m beside y = x and heading along it, at a speed."""
    return changed(
        LINE, initial=Initial(point=(0.0, offset * math.sqrt(2)), heading=math.pi / 4, speed=speed)
    )


def test_line_is_the_closed_form():
    run = simulate(LINE)
    h1 = -math.sqrt(2) * (4 * np.exp(-run.t / 2) - np.exp(-2 * run.t)) / 3
    assert len(run.t) == 1501 and run.t[-1] == 15.0 and set(run.status) == {"ok"}
    assert np.abs(run.y[:, 0] - h1).max() < 1e-11
    assert np.abs(run.y[:, 1] - 1.414 * (1 - np.exp(-2 * run.t))).max() < 1e-11


@pytest.mark.parametrize("spec", [LINE, CIRCLE], ids=["line", "circle"])
def test_constraints_and_their_integral_hold(spec):
    run = simulate(changed(spec, simulation={"duration": 15.0, "output_step": 0.05}))
    c = R_WHEEL / (2 * B_HALF)
    assert np.abs(run.q[:, 2] - run.q[0, 2] - c * (run.q[:, 3] - run.q[:, 4])).max() < 1e-10
    assert np.abs(run.plant.slip(run.x)).max() < 1e-12


@pytest.mark.parametrize("seed", range(4))
def test_heading_on_a_line(seed):
    random = np.random.default_rng(seed)
    slow, fast, kv, L = (
        random.uniform(0.4, 1),
        random.uniform(1.5, 4),
        random.uniform(0.5, 3),
        random.uniform(-0.1, 0.5),
    )
    s_0, h_0, v_0, v_d = random.uniform(-0.4, 0.4), random.uniform(-0.5, 0.5), random.uniform(1.0, 2.0), 1.5
    place = h_0 * NORMAL + random.uniform(-5, 5) * np.array([1.0, 1.0])
    kp, kd = slow * fast, slow + fast
    start = Initial(point=tuple(place), heading=math.pi / 4 - math.asin(s_0), speed=v_0)
    spec = changed(
        LINE, output={"L": L}, initial=start, reference={"speed": v_d}, simulation={"output_step": 0.05}
    )
    run = simulate(with_gains(spec, kp, kd, kv))
    assert run.stopped is None
    speed = lambda t: v_d + (v_0 - v_d) * math.exp(-kv * t)  # noqa: E731
    distance = decay(slow, fast, h_0, v_0 * s_0)
    alone = s_on_line(run.t, L + D, s_0, lambda t: distance(t)[1], speed)
    assert np.abs(run.y[:, 0] - channel(run.t, kp, kd, h_0, v_0 * s_0)[:, 0]).max() < 1e-10
    assert np.abs(along_normal(run) - alone.y[0]).max() < 1e-9


def on_line_turning(s_0: float, v: float, l: float) -> Initial:  # noqa: E741
    """On y = x at an angle to it, turning so that P_l stays on it."""
    phi = math.pi / 4 - math.asin(s_0)
    yaw_rate = -v * s_0 / l / (NORMAL @ (-math.sin(phi), math.cos(phi)))
    place = -(l - D) * np.array([math.cos(phi), math.sin(phi)])
    nu = ((v + B_HALF * yaw_rate) / R_WHEEL, (v - B_HALF * yaw_rate) / R_WHEEL)
    return Initial(q=(*place, phi, 0.0, 0.0), nu=nu)


def test_heading_decays_on_the_line():
    v, s_0 = 1.414, 0.6
    run = simulate(changed(LINE, initial=on_line_turning(s_0, v, D), simulation={"duration": 3.0}))
    assert np.abs(run.y[:, 0]).max() < 1e-12
    assert np.abs(along_normal(run) - s_0 * np.exp(-v * run.t / D)).max() < 1e-10


def test_heading_diverges_when_the_point_is_behind_the_axle():
    v, s_0, l = 1.414, 0.01, -0.3  # noqa: E741
    run = simulate(
        changed(LINE, initial=on_line_turning(s_0, v, l), output={"L": l - D}, simulation={"duration": 3.0})
    )
    assert run.stopped == "singular"
    assert abs(run.t[-1] - l / v * math.log(s_0)) < 1e-6


@pytest.mark.parametrize(("speed", "stated"), [(1.414, 0.845), (0.0, 0.54)])
def test_five_metres_beside_is_singular_when_stated(speed, stated):
    spec = beside_line(5.0, speed)
    run = simulate(spec)
    t = np.linspace(0, 1, 101)
    wanted = lambda t: 1.414 + (speed - 1.414) * math.exp(-2 * t)  # noqa: E731
    alone = s_on_line(t, D, 0.0, lambda t: -5 * (2 / 3) * (math.exp(-2 * t) - math.exp(-t / 2)), wanted)
    assert run.stopped == "singular" and list(run.status[:-1]) == ["ok"] * (len(run.t) - 1)
    assert abs(run.t[-1] - alone.t_events[0][0]) < 1e-6
    assert abs(run.t[-1] - stated) < 0.001
    loose = simulate(changed(spec, simulation={"tolerance": 1e-3, "output_step": 1.0}))
    assert loose.stopped == "singular" and abs(loose.t[-1] - run.t[-1]) < 1e-2
    held = simulate(changed(spec, simulation={"period": 1e-3}))
    assert held.stopped == "singular" and abs(held.t[-1] - run.t[-1]) < 0.01


def test_a_straying_trial_step_does_not_end_a_run():
    spec = changed(beside_line(4.6, 1.414), simulation={"tolerance": 1e-3, "output_step": 5.0})
    loop = make_loop(spec)
    leg = loop.guidance.leg

    class Spy:
        refused = 0

        def __call__(self, x):
            side = leg.side(x)
            self.refused += side <= 0
            return side

    spy = Spy()
    loop.guidance.leg = dataclasses.replace(leg, side=spy)
    rows = list(continuous(loop, spec.simulation))
    assert spy.refused > 0
    assert [row.status for row in rows] == ["ok"] * 4 and rows[-1].t == 15.0


def circle_of(run):
    """Radius vectors of P_l from the centre: length and direction."""
    ahead = np.column_stack([np.cos(run.q[:, 2]), np.sin(run.q[:, 2])])
    radius = run.q[:, :2] + run.spec.output.L * ahead - (20.0, 20.0)
    length = np.hypot(*radius.T)
    return length, radius / length[:, None]


@pytest.mark.parametrize("L", [0.0, 0.4, -0.2])
def test_heading_on_a_circle(L):
    run = simulate(changed(CIRCLE, output={"L": L}, simulation={"output_step": 0.05}))
    rho, radial = circle_of(run)
    l, v = L + D, 5.0  # noqa: E741
    s = along_normal(run, radial)
    h_0, rate_0 = rho[0] - 10.0, v * s[0]
    distance = decay(1.0, 4.0, h_0, rate_0)

    def rate(t, s):
        h1, h1_rate = distance(t)
        return ((h1_rate - v * s) * (1 - l * s / (10 + h1)) + l * v / (10 + h1) * (1 - s**2)) / l

    alone = solve_ivp(rate, (0, run.t[-1]), [s[0]], "DOP853", run.t, rtol=1e-12, atol=1e-13)
    assert np.abs(rho - 10 - channel(run.t, 4.0, 5.0, h_0, rate_0)[:, 0]).max() < 1e-10
    assert np.abs(s - alone.y[0]).max() < 1e-10


def test_steady_circle():
    run = simulate(changed(CIRCLE, simulation={"duration": 30.0, "output_step": 0.1}))
    last = run.x[-1]
    inner = math.sqrt(10.0**2 - D**2)
    axle = last[:2] - D * np.array([math.cos(last[2]), math.sin(last[2])])
    assert abs(circle_of(run)[0][-1] - 10.0) < 1e-9
    assert abs(np.hypot(*(axle - 20.0)) - inner) < 1e-9
    assert abs(R_WHEEL / (2 * B_HALF) * (last[5] - last[6]) - 5.0 / inner) < 1e-9
    assert abs(along_normal(run, circle_of(run)[1])[-1] - D / 10.0) < 1e-9
    # The ground pulls the whole mass, 30 + 2 kg, inwards; lambda has the paper's sign, + A' lambda on the
    # left-hand side.
    assert abs(run.plant.constraint_forces(last, run.tau[-1])[0, 0] + 32.0 * 5.0 * 5.0 / inner) < 1e-6


@pytest.mark.parametrize("kind", ["I", "II", "III"])
def test_position_and_heading_follow_their_ramps(kind):
    random = np.random.default_rng(1992)
    # Type II is singular at 90 degrees, III at 0
    heading = {"I": 0.3, "II": 0.3, "III": math.pi / 2 + 0.3}[kind]
    position = {"I": (0.3, 0.2), "II": (0.3, heading + 0.2), "III": (0.3, heading + 0.2)}[kind]
    velocity = (random.uniform(0.5, 1.0), 0.7 if kind == "I" else 0.0)
    spec = changed(
        LINE,
        output=OutputSection(type=kind, L=0.1),
        reference=Reference(position=position, velocity=velocity),
        initial=Initial(point=(0.0, 0.0), heading=heading),
        simulation={"duration": 8.0, "output_step": 0.05},
    )
    run = simulate(spec)
    assert run.stopped is None
    assert np.abs(run.y_d - (np.array(position) + run.t[:, None] * velocity)).max() < 1e-12
    for k in (0, 1):
        e = channel(run.t, 1.0, 2.5, run.y[0, k] - position[k], -velocity[k])[:, 0]
        assert np.abs(run.y[:, k] - position[k] - velocity[k] * run.t - e).max() < 1e-10


def test_held_torque_does_the_work_that_the_energy_gains():
    run = simulate(changed(CIRCLE, simulation={"period": 0.01, "duration": 3.0}))
    work = np.sum(run.tau[:-1] * np.diff(run.q[:, 3:5], axis=0), axis=1)
    assert np.abs(np.diff(run.plant.energy(run.x)) - work).max() < 1e-9
    assert np.abs(work).max() > 1e-3


def test_rows_between_calls_hold_the_torque():
    run = simulate(changed(LINE, simulation={"period": 0.05, "duration": 1.0}))
    assert len(run.t) == 101 and run.t[-1] == 1.0
    held = run.tau[:-1].reshape(20, 5, 2)
    assert np.array_equal(held, np.repeat(held[:, :1], 5, axis=1))
    assert np.all(np.abs(np.diff(held[:, 0], axis=0)) > 0)


def test_wrong_masses():
    """The paper's figure 9, plant's masses double: no error stays on the line,
    8.7 cm on the circle at 5 m/s."""
    double = {"m_c": 60.0, "m_w": 2.0}
    coarse = {"output_step": 0.1, "duration": 30.0}
    line = simulate(dataclasses.replace(changed(LINE, simulation=coarse), plant=double))
    circle = simulate(dataclasses.replace(changed(CIRCLE, simulation=coarse), plant=double))
    assert abs(line.y[-1, 0]) < 1e-5
    assert abs(circle.y[-1, 0] - 0.087) < 0.0005
    assert np.ptp(circle.y[-20:, 0]) < 1e-6
    believed = simulate(
        dataclasses.replace(
            changed(LINE, simulation=coarse), parameters=double, plant={"m_c": 30.0, "m_w": 1.0}
        )
    )
    assert abs(believed.y[-1, 0]) < 1e-5


def test_true_outputs_use_the_true_radius():
    spec = dataclasses.replace(changed(CIRCLE, simulation={"duration": 1.0}), plant={"r": 0.14})
    run = simulate(spec)
    assert np.abs(run.y[:, 1] - 0.14 * (run.nu[:, 0] + run.nu[:, 1]) / 2).max() < 1e-12
    assert run.y[0, 1] == pytest.approx(5.0, abs=1e-12)


TYPE_I = changed(
    LINE,
    output=OutputSection(type="I"),
    reference=Reference(position=(0.0, 0.0), velocity=(1.0, 1.0)),
    initial={"point": (5.0, 4.0)},
)
ELLIPSE = changed(
    LINE,
    output={"path": PathSection(kind="ellipse", parameters={"a": 4.0, "b": 2.0})},
    initial={"point": (4.5, 0.0)},
    reference={"speed": 1.0},
)


@pytest.mark.parametrize("spec", [TYPE_I, LINE, CIRCLE, ELLIPSE], ids=["type_i", "line", "circle", "ellipse"])
def test_generated_c_drives_as_the_model_does(spec):
    spec = changed(spec, simulation={"duration": 20.0, "output_step": 0.1})
    ours, reference = simulate(spec, "c"), simulate(spec, "casadi")
    assert ours.stopped is None and ours.spec.simulation.backend == "c"
    assert np.abs(ours.x - reference.x).max() < 1e-8
    assert np.abs(ours.tau - reference.tau).max() < 1e-8
    assert np.abs(simulate(spec, "cf").x[:, :3] - reference.x[:, :3]).max() < 1e-4


@pytest.mark.parametrize("seed", range(3))
def test_start_is_where_it_was_asked_for(seed):
    random = np.random.default_rng(seed)
    (x, y), heading, speed, L = (
        random.uniform(-5, 5, 2),
        random.uniform(-3, 3),
        random.uniform(-2, 2),
        random.uniform(0.1, 1),
    )
    spec = changed(LINE, output={"L": L}, initial=Initial(point=(x, y), heading=heading, speed=speed))
    start = make_loop(spec).start
    wanted = [
        x - L * math.cos(heading),
        y - L * math.sin(heading),
        heading,
        0,
        0,
        speed / R_WHEEL,
        speed / R_WHEEL,
    ]
    assert np.abs(start - wanted).max() < 1e-12
    assert start[3] == start[4] == 0.0


def toml(name: str = "line", **changes: str) -> str:
    """The text of a shipped SPEC, whole lines replaced by the key they begin with."""
    text = (SPECS / f"{name}.toml").read_text()
    for key, line in changes.items():
        text, count = re.subn(rf"(?m)^{key} = .*$", line, text)
        assert count == 1
    return text


BAD = {
    "misspelt robot": (toml(robot='robot = "labmat"'), "labmate"),
    "misspelt section": (toml(gains="gians = { kp = 1.0 }"), "did you mean 'gains'"),
    "misspelt key": (toml(duration="durration = 15.0"), "did you mean 'duration'"),
    "misspelt parameter": (toml(parameters="parameters = { m_cc = 1.0 }"), "did you mean 'm_c'"),
    "misspelt gain": (toml(gains="gains = { kpp = 1.0 }"), "did you mean 'kp'"),
    "misspelt path key": (toml(path='path = { kind = "line", A = 1.0, B = -1.0, C = 0.0, D = 0.0 }'), "'D'"),
    "missing path key": (toml(path='path = { kind = "line", A = 1.0, B = -1.0 }'), "C is missing"),
    "misspelt path": (toml(path='path = { kind = "lime", A = 1.0, B = -1.0, C = 0.0 }'), "line"),
    "composite path": (
        toml(path='path = { kind = "composite", segments = [] }'),
        "not a list of lines and arcs",
    ),
    "no path": (toml(path=""), "path"),
    "no kind": (toml(path="path = { A = 1.0 }"), "kind"),
    "not a line": (toml(path='path = { kind = "line", A = 0.0, B = 0.0, C = 0.0 }'), "not a line"),
    "unknown type": (toml(type='type = "V"'), "[output] type"),
    "unknown backend": (toml(backend='backend = "rust"'), "rust"),
    "missing duration": (toml(duration=""), "[simulation] duration"),
    "negative duration": (toml(duration="duration = -1.0"), "[simulation] duration"),
    "negative period": (toml(period="period = -0.1"), "[simulation] period"),
    "negative tolerance": (toml(tolerance="tolerance = -1e-10"), "[simulation] tolerance"),
    "tiny tolerance": (toml(tolerance="tolerance = 1e-20"), "[simulation] tolerance"),
    "negative output step": (toml(tolerance="output_step = -0.01"), "[simulation] output_step"),
    "too many rows": (toml(tolerance="output_step = 1e-9"), "[simulation] output_step"),
    "text for a number": (toml(duration='duration = "long"'), "[simulation] duration"),
    "truth for a number": (toml(duration="duration = true"), "[simulation] duration"),
    "huge number": (toml(duration="duration = 1" + 400 * "0"), "not finite"),
    "infinite parameter": (toml(parameters="parameters = { r = inf }"), "r = inf"),
    "NaN heading": (toml(heading="heading = nan"), "[initial] heading"),
    "negative mass": (toml(parameters="plant = { m_c = -1.0 }"), "m_c"),
    "negative gain": (toml(gains="gains = { kp = -1.0 }"), "kp"),
    "point of three": (toml(point="point = [0.0, 1.0, 2.0]"), "[initial] point"),
    "point and state": (toml(heading="q = [0, 0, 0, 0, 0]"), "[initial]"),
    "short state": (
        toml(point="q = [0.0]", heading="").replace("speed = 0.5", ""),
        "[initial] q has 1 numbers",
    ),
    "position for Type IV": (toml().replace("speed = 1.414", "position = [0, 0]"), "[reference]"),
    "on the axle": (toml(L="L = -0.3"), "axle"),
    "normal to the path": (toml(heading="heading = 2.356194490192345"), "normal to the path"),
    "no TOML": ("robot = ", "not TOML"),
    "not text": (b"\xff\xfe", "not TOML"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_specs_are_refused_in_one_line(name, tmp_path, capsys):
    content, hint = BAD[name]
    (tmp_path / "bad.toml").write_bytes(content if isinstance(content, bytes) else content.encode())
    assert main(["simulate", str(tmp_path / "bad.toml"), "-o", str(tmp_path / "x.csv")]) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and "bad.toml" in message and hint in message
    assert [f.name for f in tmp_path.iterdir()] == ["bad.toml"]


def test_refuses_targets_before_the_run(tmp_path, capsys):
    line = str(SPECS / "line.toml")
    for arguments in (
        ["-o", str(tmp_path / "none" / "x.csv")],
        ["-o", str(tmp_path)],
        ["-o", str(tmp_path / "x.csv"), "--plot", str(tmp_path / "x.doc")],
        ["-o", str(tmp_path / "x.png"), "--plot", str(tmp_path / "x.png")],
    ):
        assert main(["simulate", line, *arguments]) == 2
        assert capsys.readouterr().err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_writes_rows_summary_and_picture(tmp_path, capsys):
    target, picture = tmp_path / "run.csv", tmp_path / "run.png"
    assert main(["simulate", str(SPECS / "line.toml"), "-o", str(target), "--plot", str(picture)]) == 0
    shown = capsys.readouterr()
    assert "error of distance" in shown.out and str(target) in shown.out
    assert not shown.err and "rolls" in shown.out
    with open(target, encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    run = simulate(read_spec(SPECS / "line.toml"))
    names = "t x_c y_c phi theta_r theta_l thetadot_r thetadot_l tau_r tau_l y1 y2".split()
    forces = ["lambda_1", "lambda_2", "lambda_3"]
    assert list(rows[0]) == [*names, "status", *forces]
    assert np.array_equal([[float(row[name]) for name in forces] for row in rows], run.forces)
    assert np.array_equal(
        [[float(row[name]) for name in names] for row in rows],
        np.column_stack([run.t, run.q, run.nu, run.tau, run.y]),
    )
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.nightly
def test_a_stopped_run_keeps_its_rows_and_says_when(tmp_path, capsys):
    far = toml(point="point = [0.0, 7.0710678118654755]").replace("speed = 0.5", "speed = 0.0")
    (tmp_path / "far.toml").write_text(far)
    assert (
        main(
            [
                "simulate",
                str(tmp_path / "far.toml"),
                "-o",
                str(tmp_path / "x.csv"),
                "--plot",
                str(tmp_path / "x.png"),
            ]
        )
        == 1
    )
    assert re.search(r"stopped at t = 0\.54\d* s: singular", capsys.readouterr().err)
    few = [
        "--set",
        "simulation.output_step=10.0",
        "-o",
        str(tmp_path / "two.csv"),
        "--plot",
        str(tmp_path / "two.png"),
    ]
    assert main(["simulate", str(tmp_path / "far.toml"), *few]) == 1 and (tmp_path / "two.png").exists()
    with open(tmp_path / "x.csv", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["status"] for row in rows] == ["ok"] * (len(rows) - 1) + ["singular"]
    assert all(math.isfinite(float(value)) for row in rows for name, value in row.items() if name != "status")


def test_a_full_disk_is_bad_input(capsys):
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full here")
    assert main(["simulate", str(SPECS / "line.toml"), "-o", "/dev/full"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_ctrl_c_leaves_nothing(tmp_path, monkeypatch, capsys):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "continuous", interrupted)
    assert main(["simulate", str(SPECS / "line.toml"), "-o", str(tmp_path / "x.csv")]) == 130
    assert not list(tmp_path.iterdir())


def test_a_tolerance_that_cannot_be_met_is_said():
    loop = make_loop(LINE)
    leg = loop.guidance.leg

    class Rough:
        believed = math.nan

        def __init__(self):
            self.random = np.random.default_rng(1992)

        def step(self, state, reference):
            status, tau = leg.controller.step(state, reference)
            return status, tau + (self.random.uniform(-1e6, 1e6, 2) if state[0] > 0.5 else 0.0)

    loop.guidance.leg = dataclasses.replace(leg, controller=Rough())
    with pytest.raises(BadInput, match="tolerance"):
        list(continuous(loop, LINE.simulation))


def test_a_picture_has_the_vehicle_at_the_end():
    """After more than a turn its last outline stands where the run ends;
    the torques of a turn are explained, and no others."""
    from noslip.simulation.plot import draw  # slow to import

    for name, duration, why in (("circle", 14.0, "turning"), ("line", 15.0, "")):
        run = simulate(read_varied(name, {"simulation.duration": duration, "simulation.output_step": 0.1}))
        plane, _, _, inputs = draw(run).axes
        ends = [
            np.hypot(*(patch.get_xy().mean(axis=0) - run.q[-1, :2]))
            for patch in plane.patches
            if hasattr(patch, "get_xy")
        ]
        assert (
            min(ends) < 0.5
            and inputs.get_title("left").startswith(why)
            and bool(inputs.get_title("left")) == bool(why)
        )


def test_a_picture_calls_assumed_what_the_user_did_not_set():
    """The radius of the LABMATE is illegible in the scan: its default is assumed,
    that of a SPEC is the user's."""
    from noslip.simulation.plot import draw  # slow to import

    for changes, said in (
        ({"parameters": {}}, "r = 0.15 m (assumed)"),
        ({"parameters": {"r": 0.2}}, "r = 0.2 m,"),
    ):
        title = draw(simulate(read_varied("line", {"simulation.duration": 0.1} | changes))).get_suptitle()
        assert said in title + "," and title.count("(assumed)") == said.count("(assumed)")
