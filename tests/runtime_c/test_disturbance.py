"""Disturbance observers: the C against its reference and closed forms, in channels and closed loops,
beside integral action."""

import math
from dataclasses import replace

import control
import numpy as np
import pytest
from noslip.analysis.outer.channel import Channel
from noslip.analysis.outer.design import from_poles
from noslip.analysis.outer.motion import SteadyMotion, steady_motion
from noslip.analysis.outer.setting import setting_of
from noslip.readers.errors import BadInput
from noslip.simulation.closed_loop import simulate
from noslip.simulation.controllers.compiled import CompiledController
from noslip.simulation.controllers.controller import BACKENDS, ON_TARGET
from noslip.simulation.controllers.estimation.disturbance import CompiledObserver, Observer, make_observer
from noslip.simulation.controllers.runtime import runtime
from noslip.simulation.controllers.targets import TARGETS
from noslip.simulation.specification.spec import DriveSection, Initial, LimitsSection, Spec, read_spec
from noslip.tests.simulation.test_guidance import ARC_LINE_ARC, composite
from noslip.tests.simulation.test_simulate import SPECS
from noslip.tests.tools import skip_without
from scipy.linalg import expm

HEADER = "noslip_disturbance.h"
CIRCLE, LINE = (read_spec(SPECS / f"{name}.toml") for name in ("circle", "line"))
NAN, INF = math.nan, math.inf

each_scalar = pytest.mark.parametrize("scalar", ["double", "float"])
each_backend = pytest.mark.parametrize("backend", BACKENDS)


def spec_of(
    spec: Spec, period: float = 0.01, duration: float = 10.0, gains: dict[str, float] | None = None, **changes
) -> Spec:
    simulation = replace(spec.simulation, period=period, duration=duration, backend="c")
    return replace(spec, simulation=simulation, gains={**spec.gains, **(gains or {"ko": 5.0})}, **changes)


class C:
    """The C itself: statuses are returned."""

    def __init__(self, scalar: str, rate: float = 4.0, limit: float = 0.0):
        self.scalar, self.runtime = scalar, runtime(HEADER)
        self.self, self.add = (
            self.runtime.new("noslip_disturbance", scalar),
            self.runtime.array(scalar, [7.0]),
        )
        self.status = self.call("init", self.self, rate, limit)

    def call(self, name: str, *arguments) -> str:
        return self.runtime.status(
            self.runtime.function(f"noslip_disturbance_{name}", self.scalar)(*arguments)
        )

    def step(self, measured: float, v: float, dt: float = 0.25, status: str = "ok") -> tuple[str, float]:
        self.add[0] = NAN  # every result is written
        number = getattr(self.runtime.lib, f"NOSLIP_{status.upper()}")
        return self.call("step", self.self, measured, v, dt, number, self.add), self.add[0]


# -- the estimate --------------------------------------------------------------------------------------------


@each_backend
@pytest.mark.parametrize("degree", [1, 2])
def test_the_error_of_the_estimate_in_closed_form(backend, degree):
    """y^(r) = v + d, v held and d constant, integrated by the matrix exponential: the error is d / (1 + l
    T)^k at call k, whatever v is, at periods that are not all alike."""
    random, rate, d = np.random.default_rng(4), 3.0, 0.7
    made, state, factor = make_observer(backend, rate), random.normal(size=degree), 1.0
    made.step(state[-1], 0.0, 0.1, "ok")
    acting = 0.0  # v with the estimate
    for _ in range(30):
        dt = random.uniform(0.01, 0.3)
        moved = expm(dt * np.eye(degree + 1, k=1))
        state = moved[:degree, :degree] @ state + moved[:degree, -1] * (acting + d)
        factor /= 1 + rate * dt
        v = random.normal()
        less = made.step(state[-1], v, dt, "ok")
        assert d + less == pytest.approx(d * factor, abs=1e-12 if backend != "cf" else 2e-5)
        acting = v + less


@pytest.mark.parametrize(("scalar", "bound"), [("double", 1e-10), ("float", 2e-3)])
@pytest.mark.parametrize("limit", [0.0, 0.8])
@pytest.mark.parametrize("seed", range(3))
def test_c_is_the_reference(scalar, bound, limit, seed):
    """3000 steps, a third of them saturated; differences of float are divided by dt."""
    random = np.random.default_rng(seed)
    rate = float(np.float32(random.uniform(0.2, 10)))
    reference, compiled = Observer(rate, limit), CompiledObserver(rate, limit, scalar)
    for _ in range(3000):
        measured, v, dt = (
            float(np.float32(x))
            for x in (random.normal(0, 0.1), random.normal(), random.uniform(0.005, 0.02))
        )
        status = random.choice(["ok", "ok", "saturated"])
        assert compiled.step(measured, v, dt, status) == pytest.approx(
            reference.step(measured, v, dt, status), abs=bound
        )
        assert abs(compiled.estimate) <= (float(np.float32(limit)) or INF)


@each_scalar
def test_it_stays_while_saturated_and_where_it_restarts(scalar):
    made = C(scalar, 4.0)
    made.step(0.0, 1.0)
    assert made.step(1.25, 0.0) == ("ok", -2.0)  # 1.25 / 0.25 - 1 = 4, half of it at l dt = 1
    assert made.step(9.0, 1.0, status="saturated") == ("ok", -2.0)
    assert made.step(8.75, 1.0, dt=0.0) == ("ok", -2.0)
    assert made.step(8.5, 0.0) == ("ok", -1.0)  # against the step before: -0.25 / 0.25 + 1 = 0
    assert made.call("applied", made.self, 3.0) == "ok"
    assert made.step(8.75, 0.0) == ("ok", 0.5)  # 1 - 3 = -2
    assert made.call("reset", made.self, 0.25) == "ok" and made.step(-40.0, 0.0) == ("ok", -0.25)


@each_scalar
def test_the_limit(scalar):
    made = C(scalar, 1e6, 0.5)
    for measured in (0.0, 1e30, -1e30, 1e30 if scalar == "float" else 1e300, 0.0):
        answer, less = made.step(measured, 0.0)
        assert answer == "ok" and abs(less) <= 0.5
    assert made.call("reset", made.self, 0.51) == "bad_parameter"
    assert made.call("reset", made.self, -0.5) == "ok" and made.step(0.0, 0.0) == ("ok", 0.5)


@each_scalar
def test_refused(scalar):
    """Statuses of bad arguments, of which none changes anything; what is added stays finite."""
    for rate, limit in ((-1.0, 0.0), (NAN, 0.0), (INF, 0.0), (1.0, -1.0), (1.0, NAN), (1.0, INF)):
        bad = C(scalar, rate, limit)
        assert bad.status == "bad_parameter" and bad.step(1.0, 1.0) == ("not_ready", 0.0)
        assert bad.call("reset", bad.self, 0.0) == bad.call("applied", bad.self, 0.0) == "not_ready"
    made = C(scalar)
    null = made.runtime.ffi.NULL
    made.step(0.0, 1.0)
    made.step(1.25, 0.0)
    kept = bytes(made.runtime.ffi.buffer(made.self))
    for arguments, status in (
        *[((*[NAN if k == wrong else 0.5 for k in range(3)],), "nonfinite") for wrong in range(3)],
        ((INF, 0.0, 0.1), "nonfinite"),
        ((0.0, -INF, 0.1), "nonfinite"),
        ((0.0, 0.0, -0.1), "bad_parameter"),
    ):
        assert made.step(*arguments) == (status, -2.0)
    assert made.call("reset", made.self, NAN) == made.call("applied", made.self, INF) == "nonfinite"
    assert bytes(made.runtime.ffi.buffer(made.self)) == kept
    assert made.call("step", made.self, 0.0, 0.0, 0.1, 0, null) == made.call("init", null, 1.0, 0.0) == "null"
    assert made.call("step", null, 0.0, 0.0, 0.1, 0, made.add) == "null" and made.add[0] == 0.0
    assert made.call("reset", null, 0.0) == made.call("applied", null, 0.0) == "null"


# -- closed loops --------------------------------------------------------------------------------------------


def test_it_removes_what_a_wrong_mass_leaves():
    """A robot of twice the mass: 5 s later than the gains' slowest error, exp(-0.5 t),
    nothing is left; without, 2.7 cm are."""
    heavy = {"m_c": 60.0, "m_w": 2.0}
    with_it = simulate(spec_of(CIRCLE, duration=25.0, plant=heavy))
    without = simulate(spec_of(CIRCLE, duration=25.0, plant=heavy, gains={"ko": 0.0}))
    left = [np.abs(run.y - run.y_d)[-1] for run in (with_it, without)]
    assert left[0].max() < 1e-3 * left[1].max() and left[1][0] > 0.02
    assert with_it.columns[-2:] == ["disturbance_distance", "disturbance_speed"]
    assert with_it.disturbance_rows == ("distance", "speed") and without.disturbance_rows == ()
    values = np.array([float(cell) for cell in with_it.csv().splitlines()[-1].split(",") if cell != "ok"])
    np.testing.assert_array_equal(values[-2:], with_it.disturbance[-1])


@pytest.mark.parametrize(("backend", "tolerance"), [("casadi", 1e-9), ("cf", 3e-4)])
def test_backends_agree(backend, tolerance):
    beside, limits = (
        Initial(point=(30.5, 20.0), heading=1.57, speed=4.0),
        LimitsSection(torque=(6.0,), disturbance=(0.02,)),
    )
    spec = spec_of(CIRCLE, duration=4.0, plant={"m_c": 60.0}, limits=limits, initial=beside)
    by_c, other = simulate(spec), simulate(spec, backend=backend)
    assert {"ok", "saturated"} <= set(by_c.status)
    np.testing.assert_allclose(other.disturbance, by_c.disturbance, rtol=0, atol=tolerance)
    np.testing.assert_allclose(other.y, by_c.y, rtol=0, atol=tolerance)
    held = np.flatnonzero((by_c.status[1:-1] == "saturated") & (by_c.status[:-2] == "saturated")) + 2
    assert len(held) > 10 and (by_c.disturbance[held] == by_c.disturbance[held - 1]).all()
    assert np.abs(by_c.disturbance).max(axis=0) == pytest.approx(0.02, abs=1e-9)


def test_beside_integral_action():
    """A right model and a start beside the path: critically damped gains do not overshoot with the observer,
    whose estimate hardly moves; with integral action of the same poles they do. A disturbance both remove."""
    place = {"kp": 1.0, "kd": 2.0, "kv": 2.0}
    observer, integral = {"ko": 2.0}, {"kp_distance": 5.0, "kd_distance": 4.0, "ki_distance": 2.0}
    runs = [simulate(spec_of(CIRCLE, gains=place | more)) for more in (observer, integral)]
    over = [float((np.sign(run.y[0, 0]) * -run.y[:, 0]).max() / abs(run.y[0, 0])) for run in runs]
    assert over[0] < 0.02 and over[1] > 0.1
    assert np.abs(runs[0].disturbance).max() < 0.05


def test_segments_of_a_composite_path():
    """Where a segment ends, nothing is compared with another: the estimates stay small on a right model."""
    run = simulate(spec_of(composite(ARC_LINE_ARC), duration=12.0, gains={"ko": 2.0}))
    assert set(run.piece) == {0, 1, 2} and set(run.status) == {"ok"}
    assert np.abs(run.disturbance).max() < 0.01


def test_a_call_evaluates_the_outputs_once(monkeypatch):
    """For integral action and observers together."""
    evaluate, calls = CompiledController.evaluate, []
    monkeypatch.setattr(
        CompiledController, "evaluate", lambda self, *at: calls.append(1) or evaluate(self, *at)
    )
    run = simulate(spec_of(CIRCLE, duration=1.0, period=0.1, gains={"ko": 2.0, "ki_speed": 0.2}))
    # At the start, for its status, and at 0, 0.1, ..., 1 s
    assert set(run.status) == {"ok"} and len(calls) == 1 + 11


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"period": 0.0}, r"\(gain ko\) requires \[simulation\] period > 0"),
        ({"gains": {"ko_distance": -1.0}}, "ko_distance = -1 must be nonnegative and finite"),
        ({"gains": {"ko_length": 1.0}}, "unknown gain 'ko_length'"),
        (
            {"limits": LimitsSection(torque=(9.0,), disturbance=(1.0, 2.0, 3.0))},
            "disturbance has 3 numbers; it must have 1 or 2",
        ),
        ({"limits": LimitsSection(torque=(9.0,), disturbance=(-1.0,))}, "must be nonnegative"),
        (
            {"limits": LimitsSection(torque=(9.0,), disturbance=(1.0,)), "gains": {"ko": 0.0}},
            "requires a disturbance observer",
        ),
        ({"drive": DriveSection(kind="velocity", bandwidth=5.0)}, r"\(gain ko\) does not go with"),
        ({"drive": DriveSection(kind="kinematic", bandwidth=5.0)}, "a kinematic law commands velocities"),
    ],
)
def test_specs_refused(changes, reason):
    with pytest.raises(BadInput, match=reason):
        simulate(spec_of(CIRCLE, **changes))


def test_a_limit_of_the_estimate_requires_no_torques():
    free, none = (LimitsSection(torque=torque, disturbance=(0.5,)) for torque in (None, (0.0,)))
    runs = [simulate(spec_of(CIRCLE, duration=0.5, limits=limits)) for limits in (free, none)]
    assert np.array_equal(runs[0].x, runs[1].x) and set(runs[0].status) == {"ok"}


@pytest.mark.parametrize("target", ["m4f", "rv32"])
def test_processors_have_the_bits_of_this_host_in_float(target):
    skip_without(TARGETS[ON_TARGET[target]].missing())
    limits, beside = (
        LimitsSection(torque=(6.0,), disturbance=(0.02,)),
        Initial(point=(30.5, 20.0), heading=1.57, speed=4.0),
    )
    gains = {"ko": 4.0, "ki_speed": 0.2}
    spec = spec_of(CIRCLE, duration=1.0, plant={"m_c": 60.0}, limits=limits, gains=gains, initial=beside)
    here, there = simulate(spec, backend="cf"), simulate(spec, backend=target)
    assert np.array_equal(here.disturbance, there.disturbance) and np.array_equal(here.tau, there.tau)
    assert "saturated" in here.status and np.abs(here.disturbance[-1]).max() > 0


def test_the_longest_period_does_not_depend_on_a_fast_observer():
    """The eigenvalues are 1 - k T, of magnitude 1 at T = 2 / k, and 1 / (1 + ko T) of the observer,
    of magnitude below 1."""
    gains = from_poles(1, [-2.0])
    for rate in (2.0, 200.0, 2000.0):
        assert Channel("x", "m", replace(gains, observer=rate)).longest_period(False) == pytest.approx(
            1.0, rel=1e-9
        )
    with pytest.raises(BadInput, match="too fast with 2001 1/s: choose a rate of at most 2000 1/s"):
        replace(gains, observer=2001.0).check("x")
    with pytest.raises(BadInput, match="choose a rate of 0 or more"):
        replace(gains, observer=-1.0).check("x")


# -- the linear loop -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("integral", [False, True])
@pytest.mark.parametrize("period", [None, 0.1])
def test_poles_of_the_gains_stay(degree, integral, period):
    """One pole more, of the estimate; the others are those without an observer."""
    gains = from_poles(degree, [-1.0, -2.5, -3.0][: degree + integral], integral)
    without, observed = (Channel("y", "m", replace(gains, observer=ko), period).poles for ko in (0.0, 4.0))
    more = -4.0 if period is None else 1 / (1 + 4.0 * period)
    for pole in (*without, more):
        assert np.abs(observed - pole).min() < 1e-7
    assert len(observed) == len(without) + 1


@pytest.mark.parametrize("delay", [False, True])
def test_a_channel_is_what_the_observer_does(delay):
    """Its step response and its map, against a chain integrated by the matrix exponential and the observer
    itself."""
    gains, period = replace(from_poles(2, [-1.0, -2.0]), observer=5.0), 0.05
    channel, made, state, v = (
        Channel("y", "m", gains, period, delay),
        Observer(5.0),
        np.array([0.3, -0.1]),
        0.0,
    )
    moved = expm(period * np.eye(3, k=1))
    A, B, K = channel._matrices()
    linear = np.zeros(len(A))
    linear[:2], linear[2] = state, -(K[0, 1] - gains.rate) * state[1]  # the estimate is 0 at first
    for _ in range(40):
        before, own = v, -gains.error * state[0] - gains.rate * state[1]
        v = own + made.step(state[1], own, period, "ok")
        state = moved[:2, :2] @ state + moved[:2, 2] * (before if delay else v)
        linear = (A - B @ K) @ linear
        assert linear[:2] == pytest.approx(state, abs=1e-12)
    closed = channel.closed()
    assert np.linalg.eigvals(closed.A) == pytest.approx(np.linalg.eigvals(A - B @ K))
    assert (closed.C @ np.linalg.solve(np.eye(len(A)) - closed.A, closed.B) + closed.D)[
        :2, 0
    ] == pytest.approx([1, 0], abs=1e-9)


def test_a_channels_response_is_that_of_its_gains():
    """A step of the reference moves y as without an observer: the estimate stays 0."""
    gains, times = from_poles(2, [-1.0, -2.0]), 0.05 * np.arange(80)
    each = [Channel("y", "m", replace(gains, observer=ko), 0.05).closed() for ko in (0.0, 5.0)]
    first, second = (control.step_response(system, times, squeeze=False).outputs[:, 0] for system in each)
    np.testing.assert_allclose(second, first, rtol=0, atol=1e-12)


def test_the_whole_loop_by_simulate():
    """The linearized map with two observers, called every 20 ms, against a run of the C beside the steady
    motion; the robot is 1 % heavier than the law assumes."""
    spec = spec_of(
        CIRCLE, period=0.02, duration=1.0, gains={"ko_distance": 4.0, "ko_speed": 6.0}, plant={"m_c": 30.3}
    )
    motion = steady_motion(setting_of(spec))
    n, m = len(spec_states(motion)), len(motion.z)
    assert m == 2 and np.abs(motion.rho[0]) < 1e-12
    start = motion.state.copy()
    start[-2:] += [2e-4, -3e-4]
    initial = Initial(q=tuple(start[: n - 2]), nu=tuple(start[n - 2 :]))
    run = simulate(replace(spec, initial=initial, simulation=replace(spec.simulation, output_step=0.02)))
    state = np.concatenate([[0.0, 0.0, 2e-4, -3e-4], -motion.z])  # the estimates begin at 0
    closed = motion.closed(0.02)
    for k in range(50):
        found = np.concatenate([run.y[k, :1], run.nu[k], run.disturbance[k]])
        expected = state[[0, 2, 3, 4, 5]] + np.concatenate([[0.0], motion.state[-2:], motion.z])
        np.testing.assert_allclose(found, expected, rtol=0, atol=3e-7)
        state = closed @ state


def spec_states(motion: SteadyMotion) -> list[str]:
    return [q.name for q in motion.setting.law.state]


@pytest.mark.parametrize("spec", [CIRCLE, LINE], ids=["circle", "line"])
def test_eigenvalues_of_the_whole_loop(spec):
    """With a right model, those without observers, and -ko of each."""
    gains = {"ko_distance": 4.0, "ko_speed": 6.5}
    without, observed = (
        steady_motion(setting_of(spec_of(spec, gains=each))).eigenvalues() for each in ({"ko": 0.0}, gains)
    )
    for value in (*without, -4.0, -6.5):
        assert np.abs(observed - value).min() < 1e-6
    assert len(observed) == len(without) + 2
