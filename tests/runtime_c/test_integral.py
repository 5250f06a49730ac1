"""Integral action and computation delay: the C against its reference and its promises,
closed loops against closed forms."""

import csv
import dataclasses
import json
import math

import numpy as np
import pytest
from noslip.cli.main import main
from noslip.model.errors import ModelError
from noslip.model.segments import Segment
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot, law_of
from noslip.simulation.closed_loop import simulate, summary
from noslip.simulation.controllers.backends import make_controller
from noslip.simulation.controllers.controller import BACKENDS
from noslip.simulation.controllers.integral import CompiledIntegral, Integral, make_integral
from noslip.simulation.controllers.runtime import runtime
from noslip.simulation.loop import make_loop
from noslip.simulation.specification.cases import read_cases
from noslip.simulation.specification.spec import (
    Initial,
    LimitsSection,
    OutputSection,
    Reference,
    Spec,
    read_spec,
)
from noslip.tests.runtime_c.test_odometry import used
from noslip.tests.simulation.test_guidance import NOISE, chain, composite
from noslip.tests.simulation.test_simulate import LINE, SPECS, changed, toml
from scipy.integrate import solve_ivp
from scipy.linalg import expm

HEADER = "noslip_integral.h"
FIGURE_9B = read_spec(SPECS / "figures" / "figure_9b.toml")
NAN, INF = math.nan, math.inf

each_scalar = pytest.mark.parametrize("scalar", ["double", "float"])
each_backend = pytest.mark.parametrize("backend", BACKENDS)


def with_ki(spec: Spec, **ki: float) -> Spec:
    return dataclasses.replace(spec, gains={**spec.gains, **ki})


class C:
    """Integral action by the C itself: statuses are answered."""

    def __init__(self, scalar: str, ki: float = 2.0, limit: float = 0.0):
        self.scalar, self.runtime = scalar, runtime(HEADER)
        self.null = self.runtime.ffi.NULL
        self.self, self.add = self.runtime.new("noslip_integral", scalar), self.runtime.array(scalar, [7.0])
        used(self.runtime.ffi, self.self)
        self.status = self.call("init", self.self, ki, limit)

    def call(self, name: str, *arguments) -> str:
        return self.runtime.status(self.runtime.function(f"noslip_integral_{name}", self.scalar)(*arguments))

    def step(self, error: float, dt: float = 0.25, status: str = "ok") -> tuple[str, float]:
        self.add[0] = NAN  # every answer is written
        number = getattr(self.runtime.lib, f"NOSLIP_{status.upper()}")
        return self.call("step", self.self, error, dt, number, self.add), self.add[0]

    def reset(self, z: float) -> str:
        return self.call("reset", self.self, z)


# -- what it adds --------------------------------------------------------------------------------------------


@each_backend
def test_an_error_counts_until_the_next(backend):
    """Errors and times that are exact in float, the times not all alike."""
    made, z = make_integral(backend, 0.5), 0.0
    for error, dt, before in (
        (3.0, 8.0, 0.0),
        (-1.0, 0.25, 3.0),
        (2.0, 0.5, -1.0),
        (0.0, 0.125, 2.0),
        (1.0, 1.0, 0.0),
    ):
        z += before * dt
        assert made.step(error, dt, "ok") == 0.5 * z and made.z == z


@pytest.mark.parametrize(("scalar", "bound"), [("double", 1e-12), ("float", 3e-5)])
@pytest.mark.parametrize("limit", [0.0, 0.8])
@pytest.mark.parametrize("seed", range(3))
def test_c_is_the_reference(scalar, bound, limit, seed):
    """3000 steps, a third of them saturated."""
    random = np.random.default_rng(seed)
    ki, drift = random.uniform(0.2, 3), random.normal(0, 0.3)
    reference, compiled = Integral(ki, limit), CompiledIntegral(ki, limit, scalar)
    for _ in range(3000):
        error, dt = (
            float(np.float32(value)) for value in (drift + random.normal(0, 1), random.uniform(0, 0.02))
        )
        status = random.choice(["ok", "ok", "saturated"])
        if scalar == "float" and limit:  # a decision may fall the other way: go on from the same z
            reference.z = compiled.z
        assert compiled.step(error, dt, status) == pytest.approx(reference.step(error, dt, status), abs=bound)
        assert compiled.z == pytest.approx(reference.z, abs=bound)


@each_scalar
@pytest.mark.parametrize("seed", range(3))
def test_against_windup(scalar, seed):
    """What the header promises, at every step: within the limit; |z| grows only where the status was ok;
    back it always goes."""
    random = np.random.default_rng(seed)
    ki, limit = (float(np.float32(value)) for value in random.uniform(0.1, 2, 2))
    made, z, before = C(scalar, ki, limit), 0.0, 0.0
    grown = held = back = 0
    for _ in range(4000):
        # Some would go far beyond the limit, either side
        error = random.normal(0, 1) * 10.0 ** random.uniform(-3, 3)
        dt, status = random.uniform(0, 0.1), random.choice(["ok", "saturated", "singular"])
        answer, add = made.step(error, dt, status)
        now = made.self.z
        assert answer == "ok" and abs(add) <= limit
        grown += abs(now) > abs(z)
        assert abs(now) <= abs(z) or status == "ok"
        if before * z < 0:
            back += 1
            assert abs(now) < abs(z) or now == pytest.approx(z + before * dt, rel=1e-5)
        elif abs(now) == abs(z):
            held += 1
        z, before = now, made.self.error
    assert min(grown, held, back) > 200


@each_scalar
def test_gains_change_without_a_jump(scalar):
    """What is added stays, or changes by `change`, within the limit;
    the next step goes on. A bad gain changes nothing."""
    random, eps = np.random.default_rng(8), 1e-12 if scalar == "double" else 1e-5
    for _ in range(200):
        made = C(scalar, *random.uniform(0.5, 2, 2))
        for _ in range(5):
            _, before = made.step(random.normal(0, 1), 0.2)
        ki, limit = random.uniform(0.2, 3, 2)
        change = random.choice([0.0, random.normal(0, 0.5)])
        expected = np.clip(before + change, -limit, limit)
        for bad in ((0.0, limit), (-1.0, limit), (NAN, limit), (ki, -1.0), (ki, NAN)):
            assert (
                made.call("update", made.self, *bad, change) == "bad_parameter" and made.self.added == before
            )
        assert made.call("update", made.self, ki, limit, NAN) == "nonfinite" and made.self.added == before
        assert made.call("update", made.self, ki, limit, change) == "ok"
        made.self.error = 0.0
        for _ in range(3):
            assert made.step(0.0)[1] == pytest.approx(expected, abs=eps * (1 + abs(expected)))
    fresh = C(scalar)
    fresh.self.ready = 0
    assert fresh.call("update", fresh.self, 1.0, 1.0, 0.0) == "not_ready"
    assert fresh.call("update", fresh.null, 1.0, 1.0, 0.0) == "null"


@each_backend
def test_never_stuck_on_the_wrong_side(backend):
    """A single step that would go from one limit beyond the other goes to zero instead, saturated or not."""
    for status in ("ok", "saturated"):
        made = make_integral(backend, 1.0, 1.0)
        made.step(-1.0, 1.0, "ok")
        assert made.step(8.0, 1.0, "ok") == -1.0
        assert made.step(8.0, 1.0, status) == 0.0
        assert made.step(0.5, 1.0, status) == 0.0 and made.step(0.0, 1.0, "ok") == 0.5


@each_scalar
@pytest.mark.parametrize("status", ["ok", "saturated", "singular"])
@pytest.mark.parametrize("z", [3.0, -3.0])
def test_without_an_error_or_time_nothing_changes(scalar, status, z):
    """An error of exactly 0 and a time of exactly 0: z keeps its bits, inputs saturated or not."""
    made = C(scalar, ki=0.5)
    assert made.reset(z) == "ok"
    for error, dt in ((0.0, 0.25), (-0.0, 0.25), (7.0, 0.25), (-7.0, 0.0), (0.0, 0.0), (0.0, 0.25)):
        assert made.step(error, dt, status) == ("ok", 0.5 * z) and made.self.z == z


def test_at_zero_nothing_is_left_of_rounding():
    """In float: z goes from 1e6, of which 0.01 was lost, back to zero and not beyond;
    then it is the sum of what comes after."""
    made = C("float", ki=1.0)
    assert made.reset(1e6) == "ok"
    made.step(0.01, 1.0), made.step(-3e6, 1.0)
    assert made.self.z == 1e6 and made.self.rounded == pytest.approx(-0.01, rel=1e-6)
    other = C("float", ki=1.0)
    assert other.reset(1e6) == "ok"
    other.step(0.01, 1.0), other.step(-3e6, 1.0)
    assert other.reset(0.0) == "ok" and other.step(0.0, 1.0) == ("ok", 0.0)  # so with a new start
    assert made.step(0.5, 1.0, "saturated") == ("ok", 0.0)
    assert made.step(0.0, 1.0) == ("ok", 0.5)


def test_float_does_not_lose_small_steps():
    """2e-5 m for 200 s at 1 kHz, on top of 20 m s; a plain float sum would stay where it is."""
    made, error = C("float", ki=0.5), float(np.float32(2e-5))
    assert made.reset(20.0) == "ok"
    dt = float(np.float32(1e-3))
    for _ in range(200_000):
        made.step(error, dt)
    assert np.float32(20.0) + np.float32(error * dt) == np.float32(20.0)
    assert made.self.z - made.self.rounded == pytest.approx(20.0 + 199_999 * error * dt, abs=4e-6)


@each_scalar
def test_a_new_start_has_no_bump(scalar):
    made = C(scalar, ki=0.5, limit=4.0)
    made.step(1.0)
    assert made.reset(-3.0) == "ok"
    assert made.step(2.0, 100.0) == ("ok", -1.5)  # the time before the new start does not count
    assert made.step(0.0, 1.0) == ("ok", -0.5)
    before = made.self.z
    assert [made.reset(z) for z in (8.5, -8.5, NAN, INF)] == ["bad_parameter"] * 2 + ["nonfinite"] * 2
    assert made.self.z == before and made.reset(8.0) == "ok"


# -- what is refused -----------------------------------------------------------------------------------------


@each_scalar
def test_refused(scalar):
    for ki, limit in ((-0.1, 0.0), (NAN, 0.0), (INF, 0.0), (1.0, -1.0), (1.0, NAN), (1.0, INF)):
        made = C(scalar, ki, limit)
        assert (
            made.status == "bad_parameter"
            and made.step(1.0) == ("not_ready", 0.0)
            and made.reset(0.0) == "not_ready"
        )
    made = C(scalar)
    made.step(1.0), made.step(1.0)
    for error, dt in ((NAN, 0.1), (-INF, 0.1), (1.0, NAN), (NAN, -0.1), (1.0, -INF)):
        assert made.step(error, dt) == ("nonfinite", 0.5)
    assert made.step(1.0, -0.1) == ("bad_parameter", 0.5)
    assert made.step(0.0, 0.25) == ("ok", 1.0)  # as if there had been none of these


@each_scalar
def test_null_and_never_made(scalar):
    made = C(scalar)
    assert made.call("init", made.null, 1.0, 0.0) == made.call("reset", made.null, 0.0) == "null"
    assert made.call("step", made.self, 1.0, 0.1, 0, made.null) == "null"
    made.add[0] = 7.0
    assert made.call("step", made.null, 1.0, 0.1, 0, made.add) == "null" and made.add[0] == 0
    made.self.ready = 0
    made.self.z = NAN
    assert made.step(1.0) == ("not_ready", 0.0) and made.reset(0.0) == "not_ready"


@each_scalar
@pytest.mark.parametrize("ki", [0.0, 1e-30, 2.0])
def test_overflow_is_no_way_out(scalar, ki):
    """Errors and times up to the largest numbers: finite, and good afterwards."""
    most, random = (
        {"double": np.finfo(np.float64), "float": np.finfo(np.float32)}[scalar].max,
        np.random.default_rng(7),
    )
    made = C(scalar, ki)
    for _ in range(300):
        error, dt = (float(most) * random.choice([1.0, 0.5, 1e-20, 1e-35]) for _ in range(2))
        status, add = made.step(random.choice([-1, 1]) * error, dt, random.choice(["ok", "saturated"]))
        assert (
            status == "ok"
            and math.isfinite(add)
            and math.isfinite(made.self.z)
            and math.isfinite(made.self.rounded)
        )
    assert made.reset(1.0) == "ok" and made.step(0.0) == ("ok", np.float32(ki) if scalar == "float" else ki)


def test_what_python_is_told():
    with pytest.raises(BadInput, match="integral action: noslip_integral_init returns 'bad_parameter'"):
        CompiledIntegral(-1.0)
    with pytest.raises(BadInput, match="integral action: noslip_integral_step returns 'nonfinite'"):
        CompiledIntegral(1.0).step(NAN, 0.1, "ok")
    with pytest.raises(BadInput, match="unknown backend 'm4f'"):
        make_integral("m4f", 1.0)


# -- continuous loops against closed forms -------------------------------------------------------------------


def linear(t: np.ndarray, coefficients: list[float], start: list[float]) -> np.ndarray:
    """Columns z, y, ... of the chain of integrators whose last derivative is -coefficients @ state."""
    matrix = np.eye(len(start), k=1)
    matrix[-1] = -np.array(coefficients)
    return expm(matrix * np.asarray(t)[:, None, None]) @ start


@each_backend
def test_the_line_is_the_closed_form(backend):
    """h1 and its integral: s^3 + kd s^2 + kp s + ki; speed: s^2 + kv s + ki. To 1e-6;
    found 1e-10 in double."""
    spec = with_ki(
        changed(LINE, simulation={"output_step": 0.25, "duration": 10.0}), ki_distance=0.4, ki_speed=0.9
    )
    made = simulate(spec, backend)
    kp, kd, kv = (spec.gains[name] for name in ("kp", "kd", "kv"))
    h1 = linear(made.t, [0.4, kp, kd], [0.0, made.y[0, 0], 0.0])
    v = linear(made.t, [0.9, kv], [0.0, -1.414])
    bound = 5e-5 if backend == "cf" else 1e-6
    assert made.stopped is None and made.integral_rows == ("distance", "speed")
    assert (
        np.abs(made.y[:, 0] - h1[:, 1]).max() < bound and np.abs(made.integral[:, 0] + h1[:, 0]).max() < bound
    )
    assert (
        np.abs(made.error[:, 1] - v[:, 1]).max() < bound
        and np.abs(made.integral[:, 1] + v[:, 0]).max() < bound
    )


def heading_spec(heading: float, position: tuple[float, float], **ki: float) -> Spec:
    """Type II: x of P_l and the heading are wanted constant."""
    return Spec(
        robot="labmate",
        gains={"kp": 1.0, "kd": 2.5, **ki},
        output=OutputSection(type="II", L=0.0),
        reference=Reference(position=position),
        initial=Initial(point=(0.0, 0.0), heading=heading, speed=0.0),
        simulation=changed(LINE, simulation={"duration": 8.0, "output_step": 0.25}).simulation,
    )


def test_a_heading_with_integral_action():
    """Both outputs of Type II, one of them with integral action."""
    made = simulate(heading_spec(0.4, (0.5, 0.1), ki_heading=0.5))
    assert made.integral_rows == ("heading",) and made.columns[-1] == "integral_heading"
    x, heading = linear(made.t, [1.0, 2.5], [-0.5, 0.0]), linear(made.t, [0.5, 1.0, 2.5], [0.0, 0.3, 0.0])
    assert np.abs(made.error[:, 0] - x[:, 0]).max() < 1e-9
    assert np.abs(made.error[:, 1] - heading[:, 1]).max() < 1e-9


@pytest.mark.parametrize("turns", [-1, 0, 2])
def test_a_heading_goes_the_short_way_round(turns):
    loop = make_loop(heading_spec(0.4, (0.5, 0.1 + 2 * math.pi * turns), ki=0.5))
    assert loop.call(0.0, loop.start, loop.extension).error() == pytest.approx((0.5, -0.3), abs=1e-12)


# -- figure 9 (b) --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("period", [0.0, 0.01])
@pytest.mark.parametrize("heavier", ["plant", "controller"])
def test_the_offset_of_figure_9b_goes(period, heavier):
    """A robot twice as heavy as believed, and the other way round: from some cm to below 1e-6 m."""
    spec = changed(FIGURE_9B, simulation={"duration": 36.0, "output_step": 0.5, "period": period})
    if heavier == "controller":
        believed = {**spec.parameters, "m_c": 60.0, "m_w": 2.0}
        spec = dataclasses.replace(spec, parameters=believed, plant={"m_c": 30.0, "m_w": 1.0})
    assert np.all(np.abs(simulate(spec).error[-1]) > (0.02, 0.01))
    made = simulate(with_ki(spec, ki_distance=1.0, ki_speed=1.0))
    assert np.all(np.abs(made.error[-1]) < 1e-6) and made.stopped is None
    reference = simulate(made.spec if period else changed(made.spec, simulation={"duration": 6.0}), "casadi")
    for name in ("x", "tau", "integral"):
        ours, theirs = (getattr(found, name) for found in (made, reference))
        assert np.abs(ours[: len(theirs)] - theirs).max() < 1e-8


@pytest.mark.nightly
def test_the_offset_goes_in_float_too():
    """At 1 kHz steps of z are below its last bit."""
    spec = changed(
        FIGURE_9B, simulation={"duration": 20.0, "output_step": 0.5, "period": 1e-3, "backend": "cf"}
    )
    spec = changed(
        spec,
        output={
            "path": dataclasses.replace(spec.output.path, parameters={"x_f": 0.0, "y_f": 0.0, "R": 10.0})
        },
    )
    spec = changed(spec, initial={"point": (10.0, 0.0)})
    made = simulate(
        dataclasses.replace(
            spec, gains={"kp": 11.0, "kd": 6.0, "kv": 4.0, "ki_distance": 6.0, "ki_speed": 4.0}
        )
    )
    assert np.abs(made.error[-1]).max() < 2e-5


# -- sampled loops -------------------------------------------------------------------------------------------


def by_hand(spec: Spec, ki: tuple[float, float], delay: float) -> np.ndarray:
    """States at the calls of a loop written out: integrals, controller,
    the true robot with the torque that acts."""
    loop = make_loop(spec)
    law, mechanism = loop.law, loop.law.system.mechanism
    gains = [spec.gains[gain.name[:2]] for gain in law.gains]
    config = loop.guidance.leg.config
    controller = make_controller("casadi", law, mechanism.parameter_values(spec.parameters), config, gains)
    period, x, z, acting, states = spec.simulation.period, loop.start, np.zeros(2), np.zeros(2), []
    wanted = np.array([0.0, 0.0, 0.0, spec.reference.speed, 0.0])
    for _ in range(round(spec.simulation.duration / period) + 1):
        states.append(x)
        reference = wanted + np.array([0.0, 0.0, ki[0] * z[0], 0.0, ki[1] * z[1]])
        error = wanted[[0, 3]] - controller.evaluate(x, reference).values["h"]
        tau = controller.step(x, reference)[1]
        for torque, seconds in ((acting, delay), (tau, period - delay)):
            if seconds:
                rate = lambda t, x, torque=torque: loop.plant.rate(x, torque)  # noqa: E731
                x = solve_ivp(rate, (0.0, seconds), x, "DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
        acting, z = tau, z + period * error
    return np.array(states)


@pytest.mark.parametrize("delay", [0.0, 0.02, 0.05])
@pytest.mark.parametrize("ki", [(0.0, 0.0), (0.4, 0.7)])
@pytest.mark.parametrize("backend", ["c", "casadi"])
def test_a_sampled_loop_is_the_one_written_out(delay, ki, backend):
    """Delay and integral action; rows fall on the calls, for one run also in between."""
    spec = changed(
        LINE,
        simulation={"duration": 4.0, "period": 0.05, "output_step": 0.05, "delay": delay, "tolerance": 1e-12},
    )
    spec = dataclasses.replace(spec, plant={"m_c": 45.0})
    made = simulate(with_ki(spec, ki_distance=ki[0], ki_speed=ki[1]), backend)
    assert np.abs(made.x - by_hand(spec, ki, delay)).max() < 1e-9
    finer = simulate(changed(made.spec, simulation={"output_step": 0.0125}), backend)
    assert np.abs(finer.x[::4] - made.x).max() < 1e-9


def test_what_acts_when():
    """A row has the torque that acts from there on: none before the first answer does;
    z is that of the last call."""
    times = {"duration": 0.4, "period": 0.1, "output_step": 0.025}
    rows = {
        delay: simulate(changed(LINE, simulation={**times, "delay": delay})) for delay in (0.0, 0.05, 0.1)
    }
    none, half, whole = (rows[delay].tau for delay in (0.0, 0.05, 0.1))
    assert np.abs(none[:4] - none[0]).max() == 0 and np.abs(none[4] - none[0]).max() > 0.1
    assert (
        np.all(half[:2] == 0)
        and np.array_equal(half[2:6], np.tile(half[2], (4, 1)))
        and np.array_equal(half[2], none[0])
    )
    assert np.all(whole[:4] == 0) and np.array_equal(whole[4:8], np.tile(none[0], (4, 1)))
    assert "delay 0.05 s" in summary(rows[0.05]) and "delay" not in summary(rows[0.0])


def test_a_very_short_delay_is_none():
    spec = changed(LINE, simulation={"duration": 3.0, "period": 0.02})
    assert np.abs(simulate(spec).x - simulate(changed(spec, simulation={"delay": 1e-12})).x).max() < 1e-9


# -- limits --------------------------------------------------------------------------------------------------

FROM_REST = {"point": (0.0, 1.0), "heading": math.pi / 4, "speed": 0.0}


def limited(mode: str, **more) -> Spec:
    """From rest beside the line with motors that are too weak at first."""
    spec = changed(LINE, initial=FROM_REST, simulation={"period": 0.01, "duration": 20.0})
    gains = {"kp": 4.0, "kd": 5.0, "kv": 2.0}
    return dataclasses.replace(
        spec, gains=gains, limits=LimitsSection(torque=(1.0,), mode=mode, **more), plant={"m_c": 40.0}
    )


@each_backend
@pytest.mark.parametrize("mode", ["cut", "slow"])
def test_saturated_from_the_start_nothing_winds_up(backend, mode):
    """Until the inputs are first within their limits the run is, bit by bit, the one without;
    then the offset goes."""
    spec = changed(limited(mode), simulation={"backend": backend})
    without, made = simulate(spec), simulate(with_ki(spec, ki=1.0))
    first = np.flatnonzero(made.status == "ok")[0]
    assert first > 20 and np.all(made.integral[: first + 1] == 0)
    assert np.array_equal(made.x[: first + 1], without.x[: first + 1]) and not np.array_equal(
        made.x, without.x
    )
    assert made.stopped is None and np.abs(made.error[-1]).max() < 0.001
    saturated = made.status[:-1] != "ok"
    assert np.all(np.diff(np.abs(made.integral), axis=0)[saturated] <= 0)


def test_c_and_python_saturate_alike():
    for mode in ("cut", "slow"):
        spec = with_ki(changed(limited(mode), simulation={"duration": 8.0}), ki=1.0)
        made, reference = simulate(spec), simulate(spec, "casadi")
        assert (
            np.abs(made.x - reference.x).max() < 1e-8
            and np.abs(made.integral - reference.integral).max() < 1e-8
        )


def test_integral_action_has_a_limit():
    made = simulate(with_ki(limited("slow", integral=(0.001, 0.02)), ki_distance=0.5, ki_speed=0.25))
    added = np.abs(made.integral) * (0.5, 0.25)
    assert np.all(added <= (0.001, 0.02)) and np.all(added.max(axis=0) > (0.00095, 0.019))


# -- paths, sensors, files -----------------------------------------------------------------------------------


@pytest.mark.parametrize("period", [0.0, 0.01])
def test_the_integral_goes_on_over_joins(period):
    """It jumps nowhere, and what it holds on the bend counts on the line behind it."""
    path = chain((1 / 5, 5 * math.pi), (0.0, 10.0))
    step = period or 0.05
    spec = changed(composite(path, duration=16.0), simulation={"period": period, "output_step": step})
    spec = dataclasses.replace(spec, plant={"m_c": 60.0, "m_w": 2.0})
    made = simulate(with_ki(spec, ki=0.8))
    at = np.flatnonzero(np.diff(made.piece))[0]
    assert list(np.unique(made.piece)) == [0, 1] and made.stopped is None
    steps = np.abs(np.diff(made.integral, axis=0)).max(axis=0)
    assert (
        np.all(steps <= 1.01 * step * np.abs(made.error).max(axis=0)) and abs(made.integral[at + 1, 0]) > 1e-3
    )
    assert np.abs(made.error[at, 0]) < 0.5 * np.abs(simulate(spec).error[at, 0])
    if period:
        reference = simulate(made.spec, "casadi")
        assert (
            np.abs(made.x - reference.x).max() < 1e-8
            and np.abs(made.integral - reference.integral).max() < 1e-8
        )


def test_over_a_cusp():
    """The law and its P_l change, the integrators stay."""
    forward, back = Segment(0, 0, 0, 0, 5), Segment(5, 0, math.pi, -1 / 4, 6, backward=True)
    spec = composite((forward, back), duration=25.0, reversing="switch")
    spec = changed(
        spec, initial=None, reference={"deceleration": 0.4, "creep": 0.005}, simulation={"period": 0.01}
    )
    made = simulate(with_ki(spec, ki_distance=0.4))
    assert made.stopped is None and list(np.unique(made.piece)) == [0, 1]
    assert np.abs(made.x - simulate(made.spec, "casadi").x).max() < 1e-8


def test_it_integrates_what_is_seen():
    """With sensors, the error is that of the state the controller works with."""
    spec = with_ki(
        dataclasses.replace(changed(LINE, simulation={"period": 0.01, "duration": 3.0}), sensors=NOISE),
        ki_speed=0.5,
    )
    made = simulate(spec)
    speed = R_WHEEL / 2 * made.seen[:-1, 5:].sum(axis=1)
    assert np.diff(made.integral[:, 0]) == pytest.approx(0.01 * (1.414 - speed), abs=1e-12)


R_WHEEL = 0.15  # m


def test_columns_are_there_when_asked_for(tmp_path):
    (tmp_path / "ki.toml").write_text(
        toml(
            duration="duration = 2.0",
            gains="gains = { kp = 1.0, kd = 2.5, kv = 2.0, ki = 0.4, ki_speed = 0.9 }",
        )
    )
    target = tmp_path / "run.csv"
    assert main(["simulate", str(tmp_path / "ki.toml"), "-o", str(target)]) == 0
    with open(target, encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0])[-2:] == ["integral_distance", "integral_speed"]
    made = simulate(read_spec(tmp_path / "ki.toml"))
    assert made.spec.gains["ki"] == 0.4 and made.integral[-1, 1] != 0
    assert np.array_equal([[float(row[name]) for name in list(row)[-2:]] for row in rows], made.integral)
    assert not any(
        "integral" in name
        for name in simulate(with_ki(changed(LINE, simulation={"duration": 0.1}), ki=0.0)).columns
    )


@pytest.mark.parametrize(
    ("gains", "said"),
    [
        ({"ki": -0.1}, "ki_distance = -0.1"),
        ({"ki_distance": 2.5}, "ki_distance = 2.5 makes distance unstable: .* requires ki < kp kd = 2.5"),
        ({"ki_distance": 0.1, "kd": 0.0}, "requires ki < kp kd = 0"),
        ({"ki_speed": 0.1, "kv": 0.0}, "ki_speed requires kv_speed > 0"),
        ({"ki_heading": 0.1}, "unknown gain 'ki_heading'"),
        ({"kii": 0.1}, "unknown gain 'kii'; did you mean 'ki'"),
    ],
)
def test_gains_that_are_refused(gains, said):
    with pytest.raises((BadInput, ModelError), match=said):
        make_loop(with_ki(LINE, **gains))


BAD = {
    "NaN": (toml(gains="gains = { ki = nan }"), "gains ki = nan is not finite"),
    "text": (toml(gains='gains = { ki = "much" }'), "gains ki = 'much' is not a number"),
    "delay without a period": (
        toml(duration="duration = 1.0\ndelay = 0.01"),
        "delay = 0.01 must be at most period = 0:",
    ),
    "delay too long": (toml(period="period = 0.01\ndelay = 0.011"), "must be at most period = 0.01"),
    "negative delay": (toml(period="period = 0.01\ndelay = -0.001"), "[simulation] delay"),
    "limits, continuous": (
        toml(gains="gains = { ki = 0.1 }\nlimits = { torque = 5.0 }"),
        "requires [simulation] period > 0",
    ),
    "no integral": (toml(gains="limits = { torque = 5.0, integral = 1.0 }"), "requires integral action"),
    "limits of three": (
        toml(
            gains="gains = { ki = 0.1 }\nlimits = { torque = 5.0, integral = [1, 1, 1] }",
            period="period = 0.01",
        ),
        "it must have 1 or 2: distance, speed",
    ),
    "negative limit": (
        toml(gains="gains = { ki = 0.1 }\nlimits = { torque = 5.0, integral = -1 }", period="period = 0.01"),
        "integral = -1 must be nonnegative",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_specs_are_refused_in_one_line(name, tmp_path, capsys):
    content, hint = BAD[name]
    (tmp_path / "bad.toml").write_text(content)
    assert main(["simulate", str(tmp_path / "bad.toml"), "-o", str(tmp_path / "x.csv")]) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and "bad.toml" in message and hint in message
    assert [f.name for f in tmp_path.iterdir()] == ["bad.toml"]


def test_cases_have_no_memory(tmp_path):
    law = law_of(find_robot("labmate"), "type_i")
    values = {"params": law.parameters, "output": law.config}
    made = {key: {q.name: q.default for q in quantities} for key, quantities in values.items()}
    made["output"]["type"] = "I"
    made |= {"q": [0.0] * 5, "nu": [1.0, 2.0], "reference": {key: [0.0, 0.0] for key in ("y", "yd", "ydd")}}
    file = tmp_path / "cases.json"
    for gains, good in (({"kp": 1.0, "kd": 2.0}, True), ({"kp": 1.0, "kd": 2.0, "ki": 0.5}, False)):
        file.write_text(json.dumps({"cases": [made | {"gains": gains}]}))
        if good:
            assert len(read_cases(str(file))) == 1
        else:
            with pytest.raises(BadInput, match="case 0: gains: unknown gain 'ki': a law has no memory"):
                read_cases(str(file))
