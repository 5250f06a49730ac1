"""Noticing slip: C as the reference implementation, bounds and false alarms, on a floor where wheels slip."""

import math
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot
from noslip.simulation.closed_loop import simulate
from noslip.simulation.controllers.ground.slip import CompiledSlip, ReferenceSlip, SlipOptions, make_slip
from noslip.simulation.controllers.runtime import runtime
from noslip.simulation.specification.spec import spec_of
from noslip.tests.runtime_c.test_profile import SPEC as FASTEST
from scipy.optimize import brentq, linprog
from scipy.stats import norm

ROOT = Path(__file__).resolve().parents[2]
FORWARD, TURN, DT = (0.075, 0.075), (0.1, -0.1), 0.01  # of the LABMATE: r/2, r/2b; s
OPTIONS = SlipOptions(
    window=0.2,
    count=(0.002, 0.002),
    wheel_noise=0.01,
    gyro_noise=0.003,
    gyro_bias=0.002,
    acceleration_noise=0.1,
    acceleration_bias=0.05,
    geometry=0.005,
    deviations=6.0,
    mu=0.6,
    least=0.1,
    lower=0.8,
    pause=0.1,
    rise=0.05,
    hold=1.0,
)
NAMES = (
    "mu",
    "slower",
    "uncertain_heading",
    "uncertain_way",
    "heading_difference",
    "heading_threshold",
    "speed_difference",
)


def drive(random, seconds: float):
    """Rates of the wheels (rad/s) of a vehicle that rolls about at random,
    and their means over each call, (N, 2)."""
    steps = round(seconds / DT)
    wheels = 10.0 + np.cumsum(random.normal(0.0, 0.3, (steps + 1, 2)), axis=0)
    return (wheels[1:] + wheels[:-1]) / 2


def readings(random, rates: np.ndarray, options: SlipOptions, geometry=(0.0, 0.0)):
    """What sensors with the errors of the options measure: angles in counts (N, 2),
    yaw rate (N), acceleration (N)."""
    noisy = rates + random.normal(0.0, 1.0, rates.shape) * options.wheel_noise
    turned = np.cumsum(np.vstack([[random.uniform(0, 1, 2)], noisy * DT]), axis=0)
    step = np.array(options.count)
    counted = np.floor(turned / step) * step if step.all() else turned
    true = rates * (1 + np.array(geometry))
    yaw = true @ TURN + options.gyro_bias + options.gyro_noise * random.normal(size=len(rates))
    speed = true @ FORWARD
    gained = np.diff(speed, prepend=speed[0]) / DT + options.acceleration_bias
    return np.diff(counted, axis=0), yaw, gained + options.acceleration_noise * random.normal(size=len(rates))


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_c_is_the_reference(scalar):
    """With slip now and then, of one wheel and of both alike, calls of any length,
    and accelerations that are known or not."""
    random, tolerance = np.random.default_rng(3), 1e-11 if scalar == "double" else 2e-3
    options = replace(OPTIONS, hold=0.3)
    c, reference = CompiledSlip(options, FORWARD, TURN, scalar), ReferenceSlip(options, FORWARD, TURN)
    noticed = []
    for k in range(700):
        angle, dt = random.normal(0.1, 0.03, 2), random.uniform(0.005, 0.015)
        slips = np.array([0.5, 0.5 * (k > 500)]) * (k % 300 > 285)
        yaw = (angle / dt - slips / dt) @ TURN + random.normal(0, 0.003)
        acceleration = None if k % 3 else random.normal(0.0, 0.1)
        one, other = (each.step(angle, yaw, acceleration, dt) for each in (c, reference))
        noticed.append(one.status)
        assert one.status == other.status
        for name in NAMES:
            assert getattr(one, name) == pytest.approx(getattr(other, name), abs=tolerance), (k, name)
        if k == 450:
            c.trust()
            reference.trust()
    assert {"ok", "slipping"} == set(noticed) and one.uncertain_way > 0


def test_no_false_alarm_within_the_bounds():
    """Errors of geometry and bias at their bounds, in any direction, counts of any phase; noise at its rate:
    3 deviations give no more alarms than normal numbers beyond them, and 6 none.
    """
    random, worst, beyond, calls = np.random.default_rng(5), 0.0, 0, 0
    for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        options = replace(OPTIONS, deviations=3.0, lower=0.999, pause=0.0, hold=0.0)
        notice = ReferenceSlip(options, FORWARD, TURN)
        for angle, yaw, gained in zip(
            *readings(random, drive(random, 20.0), options, 0.005 * np.array(signs)), strict=True
        ):
            found = notice.step(angle, yaw, gained, DT)
            beyond, calls = beyond + (found.status == "slipping"), calls + 1
            worst = max(worst, abs(found.heading_difference) / found.heading_threshold)
    assert beyond <= 4 * norm.sf(3.0) * calls, f"{beyond} alarms in {calls} calls"
    assert worst > 0.5, "the threshold is loose"
    quiet = ReferenceSlip(OPTIONS, FORWARD, TURN)
    for angle, yaw, gained in zip(*readings(random, drive(random, 40.0), OPTIONS), strict=True):
        assert quiet.step(angle, yaw, gained, DT).status == "ok"


@pytest.mark.parametrize("count", [0.0, 0.01])
def test_counts_alone_are_bounded_not_random(count):
    """Without noise there is no alarm with 0 deviations, whatever the phase of the counts,
    and the bound is met within a half."""
    options = replace(
        OPTIONS,
        count=(count, count),
        wheel_noise=0.0,
        gyro_noise=0.0,
        gyro_bias=0.0,
        acceleration_noise=0.0,
        acceleration_bias=0.0,
        geometry=1e-9,
        deviations=0.0,
    )
    random, used = np.random.default_rng(6), [0.0, 0.0]
    notice = ReferenceSlip(options, FORWARD, TURN)
    for angle, yaw, gained in zip(*readings(random, drive(random, 30.0), options), strict=True):
        found = notice.step(angle, yaw, gained, DT)
        assert found.status == "ok"
        used[0] = max(used[0], abs(found.heading_difference) / found.heading_threshold)
        used[1] = max(used[1], abs(found.speed_difference) / max(found.speed_threshold, 1e-12))
    assert not count or min(used) > 0.4, used


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_mu_is_lowered_and_rises_again(scalar):
    """By `lower` at each notice, not below `least`, again after `pause`;
    after `hold` it rises by `rise` per second to mu."""
    notice = CompiledSlip(OPTIONS, FORWARD, TURN, scalar)
    rolling = ((0.1, 0.1), 0.0, None, DT)
    assert notice.step(*rolling).status == "ok"
    # 2 rad/s of yaw that no gyro sees
    slipping = [notice.step((0.1, 0.3), 0.0, None, DT) for _ in range(300)]
    falls = [k for k in range(1, 300) if slipping[k].mu < slipping[k - 1].mu]
    assert (
        slipping[0].mu == pytest.approx(0.48)
        and slipping[1].mu == slipping[0].mu
        and {one.status for one in slipping} == {"slipping"}
    )
    assert set(np.diff(falls)) <= {10, 11} and slipping[-1].mu == pytest.approx(0.1, abs=1e-6)
    assert slipping[0].slower == pytest.approx(math.sqrt(0.8), rel=1e-6)
    after = [notice.step(*rolling) for _ in range(1300)]
    held = max(k for k, one in enumerate(after) if one.mu <= after[0].mu * (1 + 1e-6)) * DT
    assert 0.98 < held < 1.5, "the window is emptied, then hold"
    rates = np.diff([one.mu for one in after]) / DT
    assert after[-1].mu == pytest.approx(0.6, abs=1e-6) and rates.max() < 0.0501 and after[-1].status == "ok"
    assert after[-1].uncertain_heading == after[50].uncertain_heading > 0.1
    notice.trust()
    assert notice.step(*rolling).uncertain_heading == 0


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_any_bits(scalar):
    """Whatever a reading or dt is: the status is one of six, what comes out is finite,
    mu within its bounds."""
    c = runtime("noslip_slip.h")
    random, kind = np.random.default_rng(11), {"double": np.float64, "float": np.float32}[scalar]
    vehicle = c.new("noslip_odometry_options", scalar, {"forward": list(FORWARD), "turn": list(TURN)})
    self, out = c.new("noslip_slip", scalar), c.new("noslip_noticed", scalar)
    step, statuses = c.function("noslip_slip_step", scalar), set()
    reading = c.new("noslip_slip_reading", scalar)
    assert c.status(step(self, reading, DT, out)) == "not_ready" and out.mu == 0
    assert (
        c.function("noslip_slip_init", scalar)(
            self, c.new("noslip_slip_options", scalar, vars(OPTIONS)), vehicle
        )
        == 0
    )
    for k in range(4000):
        numbers = random.integers(0, 256, 5 * kind().itemsize, dtype=np.uint8).view(kind)
        if k % 2:
            numbers = np.where(random.random(5) < 0.7, random.normal(0.0, 0.1, 5).astype(kind), numbers)
        reading.angle = [float(numbers[0]), float(numbers[1])]
        reading.yaw_rate, reading.acceleration = float(numbers[2]), float(numbers[3])
        reading.accelerates = int(random.integers(-2, 2))
        before = c.ffi.buffer(self)[:]
        statuses.add(
            status := c.status(step(self, reading, float(abs(numbers[4]) if k % 4 == 1 else numbers[4]), out))
        )
        values = [getattr(out, name) for name, _ in c.ffi.typeof(out[0]).fields]
        assert (
            np.isfinite(values).all()
            and 0.1 * (1 - 1e-6) <= out.mu <= 0.6 * (1 + 1e-6)
            and 0 < out.slower <= 1
        )
        assert status in ("ok", "slipping") or c.ffi.buffer(self)[:] == before, "an error changes nothing"
    assert statuses == {"ok", "slipping", "nonfinite", "bad_parameter"}


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_refused_options(scalar):
    negative = ("wheel_noise", "gyro_bias", "acceleration_noise", "deviations", "rise")
    bad = {name: -1.0 for name in negative} | {
        "window": 0.0,
        "count": (0.0, -1.0),
        "mu": 0.0,
        "least": 0.0,
        "lower": 1.0,
    }
    bad |= {
        "gyro_noise": math.nan,
        "acceleration_bias": math.nan,
        "geometry": math.inf,
        "hold": math.inf,
        "pause": 2.0,
    }
    assert set(bad) == set(vars(OPTIONS))
    for name, value in [*bad.items(), ("least", 0.7), ("lower", 0.0), ("pause", -1.0)]:
        with pytest.raises(BadInput, match="bad_parameter"):
            CompiledSlip(replace(OPTIONS, **{name: value}), FORWARD, TURN, scalar)
    for forward, turn in ((FORWARD, (0.0, 0.0)), ((math.nan, 1.0), TURN), (FORWARD, (math.inf, 1.0))):
        with pytest.raises(BadInput, match="bad_parameter"):
            CompiledSlip(OPTIONS, forward, turn, scalar)
    zeros = {name: 0.0 for name in ("wheel_noise", "gyro_bias", "acceleration_noise", "deviations", "rise")}
    CompiledSlip(replace(OPTIONS, **zeros), FORWARD, TURN, scalar)
    with pytest.raises(BadInput, match="unknown backend 'm4f'"):
        make_slip("m4f", OPTIONS, FORWARD, TURN)


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_the_grip_of_a_law(scalar):
    """It is that of the friction with the mu that is noticed, which no friction exceeds;
    earned friction falls to it at once."""
    c = runtime("noslip_slip.h")
    vehicle = c.new("noslip_odometry_options", scalar, {"forward": list(FORWARD), "turn": list(TURN)})
    self, earned, grip = (c.new(name, scalar) for name in ("noslip_slip", "noslip_earned", "noslip_grip"))
    write = c.function("noslip_slip_grip", scalar)
    given = {"mu": 0.6, "margin": 0.1, "share": 0.5, "height": 0.2}
    c.function("noslip_grip_init", scalar)(earned, grip, c.new("noslip_friction", scalar, given), 1)
    grip.weight = 7.0
    for k in range(3):
        arguments = [self, earned, grip]
        arguments[k] = c.ffi.NULL
        assert c.status(write(*arguments)) == "null" and grip.weight == 7.0
    assert c.status(write(self, earned, grip)) == "not_ready" and grip.weight == 7.0
    options = c.new("noslip_slip_options", scalar, vars(OPTIONS))
    assert c.function("noslip_slip_init", scalar)(self, options, vehicle) == 0
    for mu in (0.6, 0.3, 0.9):
        self.noticed.mu = mu
        assert write(self, earned, grip) == 0
        assert grip.weight == pytest.approx(min(mu, 0.6) * 0.9 * 0.5 * 9.81, rel=1e-6)
        assert grip.height == pytest.approx(min(mu, 0.6) * 0.9 * 0.2, rel=1e-6)
    c.function("noslip_grip_init", scalar)(
        earned, grip, c.new("noslip_friction", scalar, given | {"period": 0.01}), 1
    )
    for mu, believed in ((0.5, 0.36), (0.3, 0.3), (0.5, 0.3)):
        self.noticed.mu = mu
        assert write(self, earned, grip) == 0 and earned.mu == pytest.approx(believed, rel=1e-6)


SENSED = """
[sensors]
counts = 4000
pose = "true"
gyro = { noise = 0.003, bias = 0.002 }
"""


def overestimated(notice: str = "", end: str = SENSED, mu: float = 0.65):
    """The fastest along a path with mu believed from the start, 1.3 times too large, on an engine's floor."""
    grip = f'mode = "grip", friction = "given"{notice}'
    text = FASTEST.replace("mu = 0.5", f"mu = {mu}").replace('mode = "grip"', grip).replace("11.0", "8.0")
    return simulate(spec_of(text + end + "[floor]\nmu = 0.5\n", "test"), engine="mujoco")


@pytest.mark.nightly
def test_noticing_slip_keeps_the_path_where_mu_is_overestimated():
    """Without, it is lost by 10 cm; with, it is kept within 1 cm, the wheels slip ten times shorter, and what
    dead reckoning lost is within what it says; with the right mu nothing is noticed.
    """
    pytest.importorskip("mujoco")
    bare, noticing = overestimated(), overestimated(", notice_slip = {}")
    off = [np.abs(run.y[:, 0]).max() for run in (bare, noticing)]
    slips = [np.count_nonzero(run.floor.slip.max(axis=1) > 0.01) * 0.01 for run in (bare, noticing)]
    assert off[1] < 0.01 < 0.1 < off[0], off
    assert slips[1] < 0.1 * slips[0], slips
    mu, heading, way = noticing.noticed.T
    assert mu.min() < 0.55 and mu[0] == 0.65 and "slipping" in noticing.status
    reckoned = noticing.floor.reckoned - noticing.q[:, :3]
    assert np.abs(reckoned[-1, 2]) < 2 * heading[-1] + 0.01
    assert np.hypot(*reckoned[-1, :2]) < way[-1]
    right = overestimated(", notice_slip = {}", mu=0.5)
    assert (
        "slipping" not in right.status
        and (right.noticed[:, 0] == 0.5).all()
        and (right.noticed[:, 1:] == 0).all()
    )


def test_slip_is_noticed_on_a_floor():
    """Both wheels spin alike on a line of which mu promises too much: an accelerometer tells it,
    a gyro alone cannot."""
    pytest.importorskip("mujoco")
    grip = 'mode = "grip", friction = "given", notice_slip = {}'
    text = FASTEST.replace("mu = 0.5", "mu = 0.65").replace('mode = "grip"', grip)
    text = text.replace("11.0", "0.5") + SENSED
    gyro, both = (
        simulate(spec_of(text + more + "[floor]\nmu = 0.3\n", "test"), engine="mujoco")
        for more in ("", "accelerometer = { noise = 0.05, bias = 0.05 }\n")
    )
    slips = both.t[np.flatnonzero(both.floor.slip.max(axis=1) > 0.1)[0]]
    assert -0.011 < both.t[np.flatnonzero(both.status == "slipping")[0]] - slips < 0.1
    assert both.noticed[-1, 0] < 0.6 and "slipping" not in gyro.status
    assert both.floor.slip.max() < gyro.floor.slip.max()


@pytest.mark.parametrize("backend", ["c", "cf", "casadi"])
def test_in_each_backend(backend):
    """A track that is wider than believed by more than `geometry`: slip is noticed in the same calls,
    and the robot is slower."""
    text = FASTEST.replace("11.0,", f'5.0, backend = "{backend}",') + SENSED + "[plant]\nb = 0.8\n"
    runs = [
        simulate(spec_of(text.replace('mode = "grip"', f'mode = "grip"{notice}'), "test"))
        for notice in ("", ", notice_slip = {}")
    ]
    assert runs[1].columns[-4:] == ["believed_mu", "uncertain_heading", "uncertain_way", "piece"]
    slipping = np.flatnonzero(runs[1].status == "slipping")
    assert 1.5 < runs[1].t[slipping[0]] < 2.5 and runs[1].noticed[:, 0].min() < 0.45
    assert (
        np.abs(runs[1].y[:, 1]).max() <= np.abs(runs[0].y[:, 1]).max()
        and runs[1].piece[-1] < runs[0].piece[-1] + 1
    )
    first = slipping[0]
    assert np.abs(runs[0].x[:first] - runs[1].x[:first]).max() == 0


def wet_bend() -> tuple[float, float, float, float]:
    """Return radius (m), speed (m/s), the angle along the bend of wet.toml where both wheels are on its
    patch, and the time (s) until the first leaves it, of the rigid robot on the path."""
    spec = tomllib.loads((ROOT / "examples/specs/figures/wet.toml").read_text())
    b, d = (q.default for name in "bd" for q in find_robot("labmate").parameters if q.name == name)
    (line, arc, _), (patch,) = spec["output"]["path"]["segments"], spec["floor"]["patch"]
    radius, speed = arc["radius"], spec["reference"]["speed"]

    def left_wheel(angle: float) -> np.ndarray:
        heading = angle - math.asin(d / radius)  # the middle of the axle, d behind, does not move sideways
        forward, left = (
            np.array([math.cos(heading + turn), math.sin(heading + turn)]) for turn in (0.0, math.pi / 2)
        )
        return (
            np.array(line["to"])
            + radius * np.array([math.sin(angle), 1 - math.cos(angle)])
            - d * forward
            + b * left
        )

    on = brentq(lambda angle: left_wheel(angle)[0] - patch["x"][0], 0.5, 1.5)
    off = brentq(lambda angle: left_wheel(angle)[1] - patch["y"][1], on, 2.0)
    return radius, speed, on, (off - on) * radius / speed


def least_distance(unaware: float, dt: float = 0.02, facets: int = 64) -> float:
    """Return how far (m) the centre of mass at least comes outside the bend, whatever forces within friction
    act on it from `unaware` (s) after both wheels are on the patch; until then the force is towards the
    centre, as of wheels that slide sideways. A linear program: polygons around the circles of forces and
    places, to 0.6 s after the patch.
    """
    radius, speed, angle, wet = wet_bend()
    steps, gravity = round((wet + 0.6) / dt), 9.81
    place = radius * np.array([math.sin(angle), -math.cos(angle)])
    velocity = speed * np.array([math.cos(angle), math.sin(angle)])
    bounds, rows, right, x, v = [], [], [], place, velocity
    times = dt * np.arange(1, steps + 1)
    most = np.where(times - dt / 2 < wet, 0.2, 0.7) * gravity
    for k in range(steps):
        inwards = -most[k] * x / np.linalg.norm(x)
        x, v = x + dt * v + dt**2 * inwards / 2, v + dt * inwards
        bounds += [(a, a) if times[k] < unaware + dt / 2 else (-most[k], most[k]) for a in inwards]
    for normal in (
        np.array([math.cos(turn), math.sin(turn)]) for turn in 2 * np.pi * np.arange(facets) / facets
    ):
        rows += [np.append(np.kron(np.eye(steps)[k], normal), 0.0) for k in range(steps)]
        right += most.tolist()
        for k in range(steps):
            moved = np.where(np.arange(steps) <= k, (k - np.arange(steps) + 0.5) * dt**2, 0.0)
            rows.append(np.append(np.kron(moved, normal), -1.0))
            right.append(radius - normal @ (place + times[k] * velocity))
    cost = np.append(np.zeros(2 * steps), 1.0)
    found = linprog(
        cost, A_ub=np.array(rows), b_ub=np.array(right), bounds=[*bounds, (0.0, None)], method="highs"
    )
    assert found.status == 0
    return found.fun


def test_no_force_within_friction_keeps_the_wet_bend():
    """The bounds that docs/grip.md has beside the measured 129 mm."""
    page = (ROOT / "docs/grip.md").read_text()
    for unaware, said in ((0.0, "43 mm"), (0.1, "67 mm"), (0.2, "86 mm")):
        assert said in page and abs(1000 * least_distance(unaware) - float(said.split()[0])) < 2, unaware


@pytest.mark.parametrize(
    "changes, said",
    [
        ({"gyro = { noise = 0.003, bias = 0.002 }": ""}, r"notice_slip requires \[sensors\] gyro"),
        ({'mode = "grip"': 'mode = "slow", torque = 9.0'}, 'notice_slip requires .limits. mode = "grip"'),
        ({"notice_slip = {}": "notice_slip = { lower = 1.0 }"}, "lower = 1 must be below 1"),
        ({"notice_slip = {}": "notice_slip = { least = 0.7 }"}, "least = 0.7 must be at most .* mu = 0.5"),
        ({"notice_slip = {}": "notice_slip = { pause = 2.0 }"}, "pause = 2 must be at most hold = 1"),
        ({"notice_slip = {}": "notice_slip = { threshold = 2.0 }"}, "threshold"),
        ({"gyro = { noise = 0.003": "gyro = { noise = -1.0"}, "noise"),
    ],
)
def test_refused_specs(changes, said):
    text = FASTEST.replace('mode = "grip"', 'mode = "grip", notice_slip = {}') + SENSED
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    with pytest.raises(BadInput, match=said):
        simulate(spec_of(text, "test"))
