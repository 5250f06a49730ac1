"""The batch simulator: its runs against the adaptive ones of `noslip simulate`,
its noise against the normal law."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from noslip.model.segments import Segment
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot, system_of
from noslip.simulation.closed_loop import simulate
from noslip.simulation.guidance import vehicle_motion
from noslip.simulation.noise import Noise as Draws
from noslip.simulation.noise import library
from noslip.simulation.specification.spec import (
    AccelerometerSection,
    ApproachSection,
    ContactSection,
    Correction,
    GyroSection,
    Initial,
    LimitsSection,
    NoiseSection,
    NoticeSlipSection,
    OutputSection,
    Reference,
    Sensors,
    read_spec,
)
from noslip.simulation.specification.spec import PathSection as Curve
from noslip.simulation.starts import starts
from noslip.simulation.sweeping import batch as module
from noslip.simulation.sweeping.batch import Batch
from scipy.stats import kstest

SPECS = Path(__file__).resolve().parents[2] / "examples/specs"
LEAST = 1e-12  # where both are right to the last bits

WAY = (  # a line, a quarter to the left, a line, the same in reverse
    Segment(0.0, 0.0, 0.0, 0.0, 1.5),
    Segment(1.5, 0.0, 0.0, 0.5, math.pi),
    Segment(3.5, 2.0, math.pi / 2, 0.0, 1.0),
    Segment(3.5, 3.0, -math.pi / 2, 0.0, 2.5, True),
)


def spec(name="circle", **simulation):
    """A shipped SPEC, sampled, for 2 s."""
    found = read_spec(SPECS / f"{name}.toml")
    return replace(
        found, simulation=replace(found.simulation, **{"duration": 2.0, "period": 0.01, **simulation})
    )


def sensed(encoders=0, **simulation):
    """With noise, dead reckoning, corrections, limits, and what is asked for in its time."""
    sensors = Sensors(
        noise=NoiseSection(mean=(0.01, -0.02), sd=(0.05,)), seed=5, period=0.03, counts=encoders
    )
    correction = Correction(rate=2.0) if encoders else Correction(rate=2.0, mode="bumpless", release=0.2)
    limits = LimitsSection(torque=(20.0,), mode="cut" if encoders else "slow")
    return replace(
        spec(delay=0.004, output_step=0.015, **simulation),
        sensors=sensors,
        correction=correction,
        limits=limits,
    )


def route():
    """Along a composite path with a cusp."""
    output = OutputSection(
        type="IV", L=0.3, path=Curve(kind="composite", segments=WAY, stop="axle"), reversing="switch"
    )
    reference, gains = Reference(speed=1.5, deceleration=1.0), {"kp": 4.0, "kd": 5.0, "kv": 3.0}
    return replace(spec(duration=12.0), output=output, reference=reference, gains=gains, initial=None)


def headed():
    """Type II, whose heading is to be half a dozen turns away, with integral action."""
    output, reference = OutputSection(type="II", L=0.4), Reference(position=(2.0, 13.0), velocity=(0.3, 0.1))
    start = Initial(q=(0.0, 0.0, 0.4, 0.0, 0.0))
    return replace(
        spec(), output=output, reference=reference, initial=start, gains={"kp": 1.0, "kd": 2.0, "ki": 0.5}
    )


def gripping(backend="c", approach=None, **limits):
    """The paper's start beside the line, on a slippery floor."""
    made = spec("line", backend=backend)
    reference, contact = (
        replace(made.reference, approach=approach),
        ContactSection(mu=0.3, share=0.9, height=0.1),
    )
    return replace(
        made, reference=reference, contact=contact, limits=LimitsSection(**{"mode": "grip", **limits})
    )


def fastest(backend="c"):
    """The fastest along a composite path, with a gyro and an accelerometer that tell wrongly that wheels
    slip. Without encoder counts in float: a rounding in float decides which count it is, and a count is more
    than what is compared; and from behind and beside the path.
    """
    made = replace(route(), reference=Reference(speed=math.inf), contact=ContactSection(mu=0.5, height=0.1))
    output = replace(made.output, L=0.0, reversing="refuse", path=replace(made.output.path, segments=WAY[:3]))
    start = None if backend == "c" else Initial(point=(-0.2, 0.3), heading=0.1, speed=0.0)
    sensors = Sensors(
        noise=NoiseSection(sd=(0.02,)), seed=3, counts=2000 if backend == "c" else 0,
        pose="reckoned" if backend == "c" else "true",
        gyro=GyroSection(noise=0.01, bias=0.002), accelerometer=AccelerometerSection(noise=0.1),
    )  # fmt: skip
    notice = NoticeSlipSection(
        deviations=1.0 if backend == "c" else 6.0, geometry=0.0, hold=0.2, pause=0.05, rise=0.3
    )
    limits, simulation = (
        LimitsSection(mode="grip", notice_slip=notice),
        replace(made.simulation, backend=backend, duration=6.0),
    )
    return replace(made, output=output, initial=start, sensors=sensors, limits=limits, simulation=simulation)


def observed(made, backend="c", torque=(9.0,)):
    """With disturbance observers, integral action of the other output,
    and limits of both that are reached."""
    limits = LimitsSection(torque=torque, integral=(0.05,), disturbance=(0.1,))
    simulation = replace(made.simulation, backend=backend, duration=1.5 * made.simulation.duration)
    return replace(
        made, gains=made.gains | {"ko_distance": 2.0, "ki_speed": 0.2}, limits=limits, simulation=simulation
    )


LED = Reference(speed=1.5, deceleration=1.0, approach=ApproachSection(acceleration=0.5))
TURNING = ApproachSection(acceleration=0.5, angular=1.0, jerk=2.0)
BESIDE, GAINS = Initial(point=(0.3, 0.4), heading=0.1, speed=0.2), {"kp": 1.0, "kd": 2.0}
CORRECTED = {
    "sensors": Sensors(noise=NoiseSection(mean=(0.02, -0.05)), seed=4),
    "correction": Correction(rate=0.7),
}
KINDS = {  # name -> SPEC and how many samples
    "line": (lambda: spec("line"), 25),
    "circle": (spec, 25),
    "sensed": (sensed, 8),
    "encoders": (lambda: sensed(2000, duration=1.5), 4),
    "float": (lambda: sensed(backend="cf"), 4),
    "route": (lambda: replace(route(), gains={"kp": 4.0, "kd": 5.0, "kv": 3.0, "ko": 2.0}), 3),
    "observed": (lambda: observed(spec()), 4),
    "observed in float": (lambda: observed(route(), "cf", None), 2),
    "heading": (headed, 4),
    "grip": (lambda: gripping(torque=(4.0,)), 4),
    "approach": (lambda: gripping("cf", ApproachSection(acceleration=0.3)), 4),
    "approached": (lambda: replace(route(), reference=LED, initial=BESIDE, **CORRECTED), 2),
    "led point": (
        lambda: replace(headed(), reference=replace(headed().reference, approach=TURNING), gains=GAINS),
        2,
    ),
    "slips": (lambda: gripping(torque=(20.0,), mode="cut"), 4),
    "fastest": (fastest, 3),
    "fastest in float": (lambda: fastest("cf"), 2),
}


@cache
def made(kind):
    """The simulator of a kind of SPEC, and as many samples as it is tried with: other masses, starts,
    seeds, gains, times."""
    batch = Batch(KINDS[kind][0](), instants=(0.5, 1.234))
    random, count = np.random.default_rng(len(kind)), KINDS[kind][1]
    varied = {
        name: value * random.uniform(0.8, 1.2, count)
        for name, value in batch.nominal.items()
        if name.startswith(
            ("plant.m", "plant.I", "gains.", "contact.mu", "contact.h", "limits.m", "reference.a")
        )
        or name in ("parameters.b", "simulation.delay", "limits.torque[1]")
    }
    near = {
        "initial.point[0]": 1.0,
        "initial.point[1]": 0.1,
        "initial.heading": 0.3,
        "initial.x_c": 1.0,
        "initial.theta_r": 3.0,
    }
    varied |= {
        n: batch.nominal[n] + w * random.uniform(-1, 1, count) for n, w in near.items() if n in batch.nominal
    }
    if "seed" in batch.nominal:
        varied["seed"] = random.integers(0, 2**53, count).astype(float)
    return batch, batch.table(varied, count)


def columns(batch, outcomes, field, names):
    """Outcomes (N, names) of a field, such as final.distance."""
    return outcomes[:, [batch.outcomes.index(f"{field}.{name}") for name in names]]


@pytest.mark.parametrize("kind", KINDS)
def test_samples_are_the_runs_of_simulate(kind):
    batch, table = made(kind)
    outcomes = batch.run(table)
    rows, state = [r.name for r in batch.law.output.rows], [q.name for q in batch.law.state]
    stated = outcomes[:, batch.outcomes.index("integration_error")]
    assert stated.max() <= 1e-6, "what is compared would not be worth it"
    arrived = 0
    for k, sample in enumerate(table):
        run, near = simulate(batch.spec_of(sample)), {"rtol": 0, "atol": 10 * (stated[k] + LEAST)}
        found = {f: columns(batch, outcomes, f, rows)[k] for f in ("final", "peak")}
        np.testing.assert_allclose(found["final"], run.error[-1], **near)
        np.testing.assert_allclose(found["peak"], np.abs(run.error).max(axis=0), **near)
        np.testing.assert_allclose(columns(batch, outcomes, "end", state)[k], run.x[-1], **near)
        stands = run.composite and run.piece[-1] == len(run.spec.output.segments) - 1 and run.y_d[-1, 1] == 0
        assert batch.status(outcomes[k, 0]) == ("arrived" if stands else run.status[-1])
        arrived += stands
        last = [run.t[np.abs(e) > module.BAND].max(initial=0.0) for e in run.error.T]
        np.testing.assert_array_equal(columns(batch, outcomes, "settling", rows)[k], last)
        for i, instant in enumerate((0.5, 1.234)):
            error = run.error[np.flatnonzero(run.t >= instant - 1e-9)[0], 0]
            assert outcomes[k, batch.outcomes.index(f"error.{rows[0]}[{i}]")] == pytest.approx(
                error, abs=near["atol"]
            )
    assert arrived == len(table) or kind not in ("route", "approached", "observed in float")


@pytest.mark.parametrize("kind", ["grip", "approach", "slips", "fastest"])
def test_friction_is_that_of_simulate(kind):
    """The largest friction use by the constraint forces, and how long which status lasted."""
    batch, table = made(kind)
    outcomes, worst = batch.run(table), []
    for row, sample in zip(outcomes, table, strict=True):
        run, found = simulate(batch.spec_of(sample)), dict(zip(batch.outcomes, row, strict=True))
        worst.append(max(use.max() for use in run.use.values()))
        assert found["use"] == pytest.approx(worst[-1], abs=1e-9)
        limited = {
            "grip": ("saturated", "grip", "will_slip"),
            "approach": ("grip",),
            "fastest": ("grip", "slipping"),
        }
        for status in limited.get(kind, ()):
            assert found[status] == pytest.approx(
                np.count_nonzero(run.status[:-1] == status) * 0.01, abs=1e-9
            )
    assert {"slips": max(worst) > 1.5, "fastest": max(worst) > 0.97}.get(kind, max(worst) <= 0.97)
    assert ("will_slip" in batch.outcomes) == (kind != "slips") and "use" not in made("line")[0].outcomes


@pytest.mark.nightly
def test_the_friction_of_a_robot_on_a_castor():
    """A castor bears load, but has no friction of its own."""
    made = read_spec(SPECS / "robots/turtlebot3_burger.toml")
    simulation, floor = (
        replace(made.simulation, duration=2.0, period=0.01),
        ContactSection(mu=0.6, height=0.05),
    )
    made = replace(made, simulation=simulation, contact=floor)
    batch, alone = Batch(made), Batch(made, vectors=0)
    table = batch.table(
        {"contact.mu": np.linspace(0.2, 0.8, 5), "plant.m_c": batch.nominal["plant.m_c"] * 1.2}, 5
    )
    outcomes = batch.run(table)
    assert outcomes.tobytes() == alone.run(table).tobytes()
    for row, sample in zip(outcomes[[0, -1]], table[[0, -1]], strict=True):
        worst = max(use.max() for use in simulate(batch.spec_of(sample)).use.values())
        assert row[batch.outcomes.index("use")] == pytest.approx(worst, abs=1e-9) and worst > 0.01


@pytest.mark.nightly
def test_a_bend_taken_too_fast_will_slip():
    turning = Initial(q=(30.0, 20.0, math.pi / 2, 0.0, 0.0), nu=(36.0, 31.0))  # 5 m/s on a circle of 10 m
    gripped = {"initial": turning, "contact": ContactSection(mu=0.7), "limits": LimitsSection(mode="grip")}
    batch = Batch(replace(spec(duration=0.5), **gripped))
    table = batch.table({"contact.mu": 0.2}, 1)
    outcomes, run = (
        dict(zip(batch.outcomes, batch.run(table)[0], strict=True)),
        simulate(batch.spec_of(table[0])),
    )
    slips = np.count_nonzero(run.status[:-1] == "will_slip") * 0.01
    assert outcomes["will_slip"] == pytest.approx(slips, abs=1e-9) and outcomes["use"] > 1 and slips > 0


@pytest.mark.parametrize("kind", ["sensed", "route"])
def test_a_trace_has_the_rows_of_simulate(kind):
    batch, table = made(kind)
    rows, run = batch.trace(table[1]), simulate(batch.spec_of(table[1]))
    np.testing.assert_array_equal(rows["t"], run.t)
    np.testing.assert_allclose(rows["x"], run.x, rtol=0, atol=1e-10)
    np.testing.assert_allclose(rows["tau"], run.tau, rtol=0, atol=1e-8)
    np.testing.assert_allclose(rows["error"], run.error, rtol=0, atol=1e-10)
    np.testing.assert_array_equal(rows["piece"], run.piece)
    assert [batch.status(number) for number in rows["status"]] == run.status.tolist()


@pytest.mark.parametrize("kind", ["circle", "sensed", "encoders", "route"])
def test_the_same_bytes_whatever_the_chunks_and_threads(kind, monkeypatch):
    batch, table = made(kind)
    table = np.concatenate([table] * 4)
    whole = batch.run(table)
    for k in range(0, len(table), len(table) // 4):
        assert whole[k : k + len(table) // 4].tobytes() == whole[: len(table) // 4].tobytes()
    with ThreadPoolExecutor(3) as pool:
        parts = np.concatenate(list(pool.map(batch.run, np.array_split(table, 7))))
    assert parts.tobytes() == whole.tobytes()
    monkeypatch.setattr(module, "CHUNK", 3)
    assert batch.run(table[::-1]).tobytes() == whole[::-1].tobytes()


def test_a_run_ends_where_it_meets_the_singular_set():
    batch = Batch(spec())
    heading = np.linspace(-3.1, 3.1, 60)
    table = batch.table(
        {"initial.heading": heading, "initial.point[0]": 29.0, "initial.speed": 4.0}, len(heading)
    )
    outcomes = batch.run(table)
    met = np.flatnonzero([batch.status(number) == "singular" for number in outcomes[:, 0]])
    assert 1 <= len(met) < len(heading)
    steps, error = (outcomes[:, batch.outcomes.index(name)] for name in ("steps", "integration_error"))
    for k in met:
        run = simulate(batch.spec_of(table[k]))
        assert run.status[-1] == "singular"
        assert outcomes[k, batch.outcomes.index("t_end")] == pytest.approx(run.t[-1], abs=2e-9)
        end = columns(batch, outcomes, "end", [q.name for q in batch.law.state])[k]
        np.testing.assert_allclose(end, run.x[-1], rtol=0, atol=error[k] + LEAST)
    assert steps.max() > 1, "no run was hard enough to be repeated"
    others = np.setdiff1d(np.arange(len(heading)), met)
    assert np.all((error[others] <= module.ACCURACY) | (steps[others] == 32))


@pytest.mark.parametrize("order", [4, 6])
def test_the_integrator_is_of_order_4_or_6(order):
    """An accuracy just missed by order 4 asks for order 6 with the same steps."""
    fast, ends = spec(period=0.2, output_step=0.2, duration=0.2), []
    for n in (1, 2, 4, 32):
        accuracy = math.inf
        for each in (4, order):
            batch = Batch(fast, accuracy=accuracy, longest=0.2 / n)
            table = batch.table({"initial.heading": 1.0}, 1)
            found = dict(zip(batch.outcomes, batch.run(table)[0], strict=True))
            assert found["order"] == each and found["steps"] == n
            accuracy = np.nextafter(found["integration_error"], 0) if order > 4 else math.inf
        ends.append(np.array([found[f"end.{q.name}"] for q in batch.law.state]))
    errors = [np.abs(end - ends[-1]).max() for end in ends[:-1]]
    assert errors[0] > 1e-8, "rounding is what would be compared"
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all((orders > order - 0.5) & (orders < order + 1.5)), orders
    truth = simulate(batch.spec_of(table[0])).x[-1]
    np.testing.assert_allclose(ends[-1], truth, rtol=0, atol=20 * found["integration_error"] + 1e-8)


def test_saturation_counts_seconds_and_the_largest_input():
    batch, table = made("sensed")
    outcomes, run = batch.run(table[:1])[0], simulate(batch.spec_of(table[0]))
    rows = batch.trace(table[0])
    saturated = sum(batch.status(number) == "saturated" for number in rows["status"]) * 0.015
    assert abs(outcomes[batch.outcomes.index("saturated")] - saturated) < 0.03
    effort = columns(batch, outcomes[None], "effort", ["tau_r", "tau_l"])[0]
    assert np.all(effort >= np.abs(run.tau).max(axis=0)) and np.all(effort <= [20.0, 24.0])


def test_a_refused_number_is_an_outcome():
    batch, table = made("sensed")
    bad = {
        "plant.m_c": (-1.0, 0.0, math.nan, math.inf),
        "parameters.r": (0.0,),
        "gains.kp_distance": (math.nan,),
        "output.path.R": (-1.0,),
        "sensors.noise.sd[1]": (-0.1,),
        "limits.torque[0]": (-1.0,),
        "simulation.delay": (0.02,),
        "simulation.period": (0.0, -1.0),
        "simulation.duration": (0.0,),
        "seed": (-1.0, 2.0**53),
        "initial.heading": (math.nan,),
        "correction.rate": (0.0,),
    }
    floor = {
        "contact.mu": (0.0, -1.0),
        "contact.share": (0.0, 1.1),
        "contact.height": (-0.1,),
        "limits.margin": (-0.1, 1.0),
    }
    gripped = made("grip")[0]
    refused = np.concatenate(
        [gripped.table({name: value}, 1) for name, values in floor.items() for value in values]
    )
    assert {gripped.status(number) for number in gripped.run(refused)[:, 0]} == {"bad_parameter"}
    refused = np.concatenate(
        [batch.table({name: value}, 1) for name, values in bad.items() for value in values]
    )
    outcomes = batch.run(np.concatenate([table[:1], refused, table[:1]]))
    assert {batch.status(number) for number in outcomes[1:-1, 0]} == {"bad_parameter"}
    assert np.all(outcomes[1:-1, 1] == 0.0) and np.all(np.isnan(outcomes[1:-1, 2:]))
    assert outcomes[0].tobytes() == outcomes[-1].tobytes() == batch.run(table[:1])[0].tobytes()


def test_a_plant_is_what_is_believed_unless_it_is_said():
    batch = made("circle")[0]
    table = batch.table({"parameters.b": np.array([0.7, 0.8]), "parameters.d": 0.1, "plant.d": 0.2}, 2)
    place = {name: batch.inputs.index(name) for name in ("plant.b", "plant.d", "plant.m_c")}
    assert table[:, place["plant.b"]].tolist() == [0.7, 0.8] and table[:, place["plant.d"]].tolist() == [
        0.2,
        0.2,
    ]
    assert table[0, place["plant.m_c"]] == batch.nominal["plant.m_c"]
    given = batch.spec_of(table[1])
    assert given.plant["b"] == given.parameters["b"] == 0.8 and given.plant["d"] == 0.2
    with pytest.raises(BadInput, match=r"plant\.m_x.*did you mean 'plant\.m_[cw]'"):
        batch.table({"plant.m_x": 1.0}, 1)


def test_a_sweep_refuses_what_it_cannot_run():
    with pytest.raises(BadInput, match="period = 0"):
        Batch(spec(period=0.0))
    with pytest.raises(BadInput, match='requires .simulation. backend = "c"'):
        Batch(spec(backend="casadi"))


@pytest.mark.parametrize("robot, L, W", [("labmate", 0.3, -0.1), ("car", 1.0, 0.0)])
def test_starts_are_where_they_are_wanted(robot, L, W):
    random, system, count = np.random.default_rng(9), system_of(find_robot(robot)), 8
    pose, speed = random.uniform(-3, 3, (count, 3)), random.uniform(-2, 2, count)
    parameters = np.array([p.default for p in system.mechanism.parameters]) * random.uniform(
        0.9, 1.1, (count, 1)
    )
    found = starts(system, parameters, (np.full(count, L), np.full(count, W)), pose, speed)
    x, y, heading, forward, turning = vehicle_motion(system)(found.T, parameters.T).full()
    point = [x + L * np.cos(heading) - W * np.sin(heading), y + L * np.sin(heading) + W * np.cos(heading)]
    np.testing.assert_allclose(
        [*point, heading, forward, turning], [*pose.T, speed, np.zeros(count)], rtol=0, atol=1e-11
    )
    names = [c.name for c in system.mechanism.coordinates]
    still = [names.index(name) for name in ("theta_r", "theta_l", "delta", "theta") if name in names]
    np.testing.assert_array_equal(found[:, still], 0.0)  # wheels straight, no turns on them
    one = starts(system, parameters[2:3], (np.array([L]), np.array([W])), pose[2:3], speed[2:3])
    np.testing.assert_allclose(one[0], found[2], rtol=0, atol=1e-13)
    lost = starts(system, parameters, (np.full(count, np.nan), np.full(count, W)), pose, speed)
    assert np.isnan(lost).any(axis=1).all()


@pytest.mark.parametrize(
    "counter, key, words",
    [  # published with the generator
        ([0] * 4, [0] * 2, [0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8]),
        ([0xFFFFFFFF] * 4, [0xFFFFFFFF] * 2, [0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD]),
        (
            [0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344],
            [0xA4093822, 0x299F31D0],
            [0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1],
        ),
    ],
)
def test_the_generator_is_philox(counter, key, words):
    ffi, lib = library()
    made = ffi.new("uint32_t[4]")
    lib.noise_words(counter, key, made)
    assert list(made) == words


def test_noise_is_normal_and_independent():
    count = 20000
    x = np.array([Draws(seed, 2).draw() for seed in range(count)])  # over seeds
    one = Draws(11, 2)
    y = np.array([one.draw() for _ in range(count)])  # over draws
    bound = 4.5 / math.sqrt(count)
    for z in (x, y):
        assert np.abs(z.mean(axis=0)).max() < bound
        assert np.abs((z**2).mean(axis=0) - 1).max() < bound * math.sqrt(2)
        assert np.abs((z**3).mean(axis=0)).max() < bound * math.sqrt(15)
        assert np.abs((z**4).mean(axis=0) - 3).max() < bound * math.sqrt(96)
        assert abs((z[:, 0] * z[:, 1]).mean()) < bound
        assert np.abs((z[1:] * z[:-1]).mean(axis=0)).max() < bound
        assert kstest(z.ravel(), "norm").pvalue > 1e-3
    assert Draws(11, 2).draw().tobytes() == y[0].tobytes()
    assert len({row.tobytes() for row in np.concatenate([x, y[1:]])}) == 2 * count - 1


def test_the_logarithm_is_good_to_the_last_bits():
    log, random = library()[1].noise_log, np.random.default_rng(3)
    for x in np.concatenate(
        [
            random.uniform(0, 1, 2000),
            2.0 ** random.uniform(-60, 0, 2000),
            1 - 2.0 ** -random.uniform(1, 53, 500),
        ]
    ):
        assert log(x) == pytest.approx(math.log(x), rel=1e-14, abs=0)
