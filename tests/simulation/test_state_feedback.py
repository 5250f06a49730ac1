"""State feedback: steady motions against closed forms, SPECs with [feedback] against runs of their own,
commands, pushes."""

from itertools import product

import numpy as np
import pytest
from noslip.analysis.underactuated import run
from noslip.cli.main import main
from noslip.codegen.printing.scalar import SCALARS
from noslip.model import ModelError
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot
from noslip.simulation.closed_loop import simulate
from noslip.simulation.controllers import build
from noslip.simulation.controllers.balance.feedback import Balanced, design
from noslip.simulation.controllers.balance.in_c import BalanceInC, differences
from noslip.simulation.controllers.balance.on_target import BalanceOnTarget
from noslip.simulation.controllers.balance.steady import Steady, analyse_at_rest, analyse_steady
from noslip.simulation.controllers.controller import ON_TARGET
from noslip.simulation.controllers.targets import TARGETS
from noslip.simulation.feedback.desired import commanded, on_course
from noslip.simulation.planning.course import SmoothCurve
from noslip.simulation.specification.feedback import Command
from noslip.simulation.specification.vary import read_varied
from noslip.tests.runtime_c.test_runtime import STRICT
from noslip.tests.tools import COMPILERS, skip_without

WEIGHTS = {"pitch": 10.0, "x": 40.0, "phi": 20.0, "speed": 1.0, "pitch_rate": 0.1, "yaw_rate": 0.5}
WHEELS = ("theta_r", "theta_l")


def values(name: str) -> dict[str, float]:
    return {p.name: p.default for p in find_robot(name).parameters}


def test_a_sleigh_that_goes_ahead_is_chaplygins():
    """v' = a w^2 and (I + m a^2) w' = torque - m a v w: the turn decays ahead and grows in reverse;
    no input moves the speed."""
    p = values("sleigh")
    for speed in (1.0, -2.0):
        steady = analyse_steady(find_robot("sleigh"), {"speed": speed})
        turn = -p["m"] * p["a"] * speed / (p["I"] + p["m"] * p["a"] ** 2)
        np.testing.assert_allclose(sorted(steady.modes.real), sorted([turn, 0.0, 0.0]), atol=1e-6)
        np.testing.assert_allclose(steady.A[1], [0.0, 0.0, speed, 0.0, 0.0], atol=1e-12)  # y' = v phi
        assert steady.left == 2 and steady.stabilizable and "(x; speed)" in steady.verdict


def test_a_balancer_in_a_circle():
    """Upright: the wheels' forces give no moment forward. Along axes that turn with it, x' = v + w y and y' =
    v phi - w x; the yaw rate makes it fall faster: (m g h + (I_x - I_z + m h^2) w^2) sin(pitch), less m h w^2
    sin(pitch) forward.
    """
    p, (speed, rate) = values("balancer"), (0.5, 0.8)
    steady = analyse_steady(find_robot("balancer"), {"speed": speed, "yaw_rate": rate})
    np.testing.assert_allclose([*steady.q, *steady.tau], 0.0, atol=1e-9)
    np.testing.assert_allclose(
        steady.rates, [speed, 0.0, rate, 0.0, *((speed + s * p["b"] * rate) / p["r"] for s in (1, -1))]
    )
    np.testing.assert_allclose(steady.A[0], [0, rate, 0, 0, 0, 0, 1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(steady.A[1], [-rate, 0, speed, 0, 0, 0, 0, 0, 0], atol=1e-12)
    m, h, whole = p["m"], p["h"], p["m"] + 2 * (p["m_w"] + p["I_w"] / p["r"] ** 2)
    M = [[whole, m * h], [m * h, p["I_y"] + m * h**2]]
    pushed = [m * h * rate**2, m * p["g"] * h + (p["I_x"] - p["I_z"] + m * h**2) * rate**2]
    np.testing.assert_allclose(steady.A[[6, 8], 3], np.linalg.solve(M, pushed), atol=1e-9)
    assert steady.left == 1  # the difference of the wheels' angles; at rest the place beside it too
    assert analyse_at_rest(find_robot("balancer")).left == 3


def test_the_snakeboard_goes_round_with_its_wheels_turned():
    p = values("snakeboard")
    steady = analyse_steady(find_robot("snakeboard"), {"speed": 1.0, "phi": 0.3})
    assert steady.rates[2] == pytest.approx(np.tan(0.3) / p["l"], rel=1e-9)
    ahead = analyse_steady(find_robot("snakeboard"), {"speed": 1.0})
    assert steady.left == 1 and ahead.left == 2 and "(x; speed)" in ahead.verdict


def test_what_is_no_steady_motion_is_refused():
    with pytest.raises(ModelError, match="sleigh: no steady motion with yaw_rate = 1 was found: a rate of"):
        analyse_steady(find_robot("sleigh"), {"yaw_rate": 1.0})
    with pytest.raises(
        BadInput, match="motion: 'x' does not tell a steady motion; pitch, speed, yaw_rate, pitch_rate do"
    ):
        analyse_steady(find_robot("balancer"), {"x": 1.0})


CASES = {
    "balancer": ({"speed": 0.5, "yaw_rate": 0.8}, WEIGHTS | {"y": 40.0}, WHEELS),
    "sleigh": ({"speed": -1.0}, {"y": 1.0, "phi": 1.0, "yaw_rate": 1.0}, ()),
    "roller_racer": ({"speed": -1.0}, {"y": 1.0, "phi": 1.0, "swing": 1.0}, ()),
    # None sees the rotor
    "snakeboard": ({"speed": 1.0, "phi": 0.3}, {"x": 1.0, "y": 1.0, "theta": 1.0, "speed": 1.0}, ("psi",)),
}


def steady_feedback(name: str) -> tuple[Steady, Balanced]:
    motion, weights, without = CASES[name]
    steady = analyse_steady(find_robot(name), motion)
    return steady, design(steady, weights, 0.2, without)


@pytest.mark.parametrize(
    "name", [*list(CASES)[:2], *(pytest.param(each, marks=pytest.mark.nightly) for each in list(CASES)[2:])]
)
def test_steady_motions_are_held_by_the_c(name):
    """The C is the feedback; it brings the nonlinear robot from beside its desired motion,
    at a heading of 2 rad, back to it."""
    steady, feedback = steady_feedback(name)
    assert differences(feedback)["double"] < 1e-12 and differences(feedback)["float"] < 1e-5
    loop = Balanced(steady, feedback.K, feedback.limit, BalanceInC(feedback))
    x, y, heading = steady.place or (0, 1, 2)
    velocity, rate = complex(steady.rates[x], steady.rates[y]), steady.rates[heading]

    def desired(t: float) -> np.ndarray:
        state = steady.state
        state[: len(steady.q)] += np.array(steady.rates) * t
        place = velocity * ((np.exp(1j * rate * t) - 1) / (1j * rate) if rate else t) * np.exp(2j)
        state[[x, y, heading]] = place.real, place.imag, 2.0 + rate * t
        return state

    start = desired(0.0)
    start[[x, y]] += 0.05 * np.array([-np.sin(2.0), np.cos(2.0)])
    states, _ = run(loop, start, 12.0, desired)
    assert len(states) == 1201
    off = states[-1] - desired(12.0)
    at = 2.0 + rate * 12.0
    aside = np.cos(at) * off[y] - np.sin(at) * off[x]
    assert abs(aside) < 1e-3 and abs(off[heading]) < 1e-3


def test_commands_are_what_they_say():
    """Places, headings and rates are derivatives of each other; lines,
    arcs and turns end where geometry says."""
    commands = [
        Command(time=2.0, distance=1.5),
        Command(time=1.0, turn=np.pi / 2),
        Command(time=3.0, distance=np.pi, turn=-np.pi),
    ]
    motion = commanded(commands, 1.0, 2.0, 0.0)
    for t, place, heading in (
        (-1.0, 1 + 2j, 0.0),
        (2.0, 2.5 + 2j, 0.0),
        (3.0, 2.5 + 2j, np.pi / 2),
        (9.0, 4.5 + 2j, -np.pi / 2),
    ):
        found = motion(t)
        assert found.place == pytest.approx(place, abs=1e-12) and found.heading == pytest.approx(
            heading, abs=1e-12
        )
        assert found.speed == pytest.approx(0.0, abs=1e-12)
    curve = on_course(SmoothCurve(0.0, 0.0, 0.3, 0.7, (2.0, 1.0), (0.0, 0.5, 0.2)))
    h = 1e-5
    for moves, times in ((motion, (0.3, 1.7, 2.4, 3.9, 5.5)), (curve, (0.5, 2.0, 4.5))):
        for t in times:
            before, now, after = moves(t - h), moves(t), moves(t + h)
            forward = now.speed * np.exp(1j * now.heading)
            assert (after.place - before.place) / (2 * h) == pytest.approx(forward, abs=1e-8)
            for value, rate in (("heading", "yaw_rate"), ("turn", "yaw_rate"), ("distance", "speed")):
                assert (getattr(after, value) - getattr(before, value)) / (2 * h) == pytest.approx(
                    getattr(now, rate), abs=1e-8
                )
            if moves is motion:
                for value, rate in (("speed", "acceleration"), ("yaw_rate", "yaw_acceleration")):
                    slope = (getattr(after, value) - getattr(before, value)) / (2 * h)
                    assert slope == pytest.approx(getattr(now, rate), abs=1e-7)


SHORT = {
    "reference.commands": [{"distance": 0.3, "time": 2.0}],
    "push": [{"time": 2.505, "on": "speed", "impulse": 1.0}],
    "simulation.duration": 4.0,
    "simulation.output_step": 0.01,
}


def test_a_spec_of_a_balancer_runs_by_the_c():
    """As the same calls made by hand until it is pushed; CasADi's run is the same;
    it stands 0.3 m ahead, then steps aside."""
    made = simulate(read_varied("balancer", SHORT))
    assert made.stopped is None and made.columns[1:4] == ["x", "y", "phi"]
    steady = analyse_at_rest(find_robot("balancer"))
    loop = design(steady, WEIGHTS, 0.2, WHEELS, 4.0)
    states, inputs = run(loop, made.x[0], 2.5, lambda t: _desired(made, t, steady))
    np.testing.assert_allclose(made.x[:251], states, atol=1e-7)
    np.testing.assert_allclose(made.tau[:250], inputs[:250], atol=1e-6)
    other = simulate(read_varied("balancer", SHORT), backend="casadi")
    np.testing.assert_allclose(other.x, made.x, atol=1e-9)
    jump = made.nu[251] - made.nu[250]  # by an impulse on the axle: the body's centre of mass stays behind
    p = values("balancer")
    m, h, whole = p["m"], p["h"], p["m"] + 2 * (p["m_w"] + p["I_w"] / p["r"] ** 2)
    expected = np.linalg.solve([[whole, m * h], [m * h, p["I_y"] + m * h**2]], [1.0, 0.0])
    np.testing.assert_allclose(jump[[0, 2]], expected, rtol=0.1)  # within 10 ms it also falls a little
    exact = simulate(
        read_varied("balancer", SHORT | {"push": [{"time": 2.5, "on": "speed", "impulse": 1.0}]})
    )
    # a row shows what was before
    np.testing.assert_allclose((exact.nu[250] - made.nu[250])[[0, 2]], 0.0, atol=1e-6)


def _desired(made, t: float, steady: Steady) -> np.ndarray:
    state = steady.state
    names = [row.name for row in made.law.output.rows]
    state[[steady.names.index(name) for name in names]] = made.y_d[round(t / 0.01)]
    return state


def test_a_spec_in_steady_motion_and_on_a_course():
    """In a circle from 0.05 m beside it; along a course that bends, at constant speed,
    seen with noise and a delay."""
    circle = {
        "feedback.motion": {"speed": 0.5, "yaw_rate": 0.8},
        "feedback.weights": WEIGHTS | {"y": 40.0},
        "reference": {},
        "initial.state": {"y": 0.05},
        "push": [],
        "simulation.duration": 8.0,
    }
    made = simulate(read_varied("balancer", circle))
    assert np.abs(made.error[-1]).max() < 1e-3 and made.nu[-1, 0] == pytest.approx(0.5, abs=1e-3)
    radius = np.abs(made.q[:, 0] + 1j * made.q[:, 1] - 0.5j / 0.8)
    assert radius[0] == pytest.approx(0.575) and radius[-1] == pytest.approx(0.625, abs=1e-3)
    course = {"speed": 0.5, "lengths": [1.0, 1.0, 2.0], "curvatures": [0.0, 0.0, 1.0, 0.0]}
    bends = circle | {
        "feedback.motion": {"speed": 0.5},
        "reference": {"course": course, "position": [1.0, 2.0]},
        "sensors": {"pose": "true", "noise": {"sd": 0.01}},
        "simulation.delay": 0.005,
    }
    seen = simulate(read_varied("balancer", bends))
    assert seen.y[0, :2] == pytest.approx([1.0, 2.05]) and np.abs(seen.error[-1, :3]).max() < 0.03
    assert 0.005 < (seen.seen - seen.x)[:, -1].std() < 0.02 and not (seen.seen - seen.x)[:, :6].any()


@pytest.mark.parametrize("backend", ON_TARGET)
def test_a_target_gives_the_bits_of_this_host(backend):
    """The whole table of a run, standing up to the push; errors and limits at random states;
    no room for a 17th at a time."""
    skip_without(TARGETS[ON_TARGET[backend]].missing())
    here = simulate(read_varied("balancer", SHORT), backend="cf")
    assert (
        here.stopped is None and simulate(read_varied("balancer", SHORT), backend=backend).csv() == here.csv()
    )
    steady = analyse_at_rest(find_robot("balancer"))
    feedback, random, seen = design(steady, WEIGHTS, 0.2, WHEELS, 4.0), np.random.default_rng(3), set()
    loops = BalanceInC(feedback, "float"), BalanceOnTarget(feedback, backend)
    for size in (*[0.1] * 20, *[1.0] * 20, 1e5, 1e30, 1e300, np.nan):
        state, desired = size * random.normal(size=(2, len(steady.names)))
        with np.errstate(over="ignore"):
            (status, tau), (status_there, tau_there) = (loop.step(state, desired) for loop in loops)
        assert status == status_there and tau.tobytes() == tau_there.tobytes()
        seen.add(status)
    assert seen == {"ok", "saturated", "astray", "range", "nonfinite"}
    with pytest.raises(BadInput, match="no room for another feedback"):
        _ = [BalanceOnTarget(feedback, backend) for _ in range(17)]


@pytest.mark.parametrize("scalar", SCALARS)
def test_every_compiler_gives_the_same_bits_without_a_warning(scalar, monkeypatch):
    """Of the generated header, at 200 random states near and far from desired ones;
    the processors are above."""
    steady = analyse_at_rest(find_robot("balancer"))
    feedback, answers = design(steady, WEIGHTS, 0.2, WHEELS, 4.0), {}
    for compiler, level in product(COMPILERS, ("-O0", "-O2", "-O3")):
        monkeypatch.setenv("CC", f"{compiler} {' '.join(STRICT)}")
        monkeypatch.setattr(build, "QUICK", (level,))
        c, random, found = BalanceInC(feedback, scalar), np.random.default_rng(8), []
        for _ in range(200):
            desired = random.normal(size=len(steady.names))
            status, tau = c.step(
                desired + random.uniform(0.0, 1.0) * random.normal(size=len(desired)), desired
            )
            found.append((status, tau.tobytes()))
        answers[compiler, level] = found
    first, *others = answers.values()
    assert all(other == first for other in others)
    assert {status for status, _ in first} == {"ok", "saturated", "astray"}


BAD = {
    "feedback.weights={tilt=1}": "unknown state 'tilt'",
    "feedback.effort=[1,1,1]": "effort has 3 numbers; it must have 1 or 2",
    "feedback.motion={speed=0.5}": "commands begin and end at rest",
    "initial.state={tilt=1}": "[initial] state: unknown state 'tilt'",
    "initial.state={pitch=2}": "the robot has fallen at the start",
    "limits.mode='slow'": "give torque, and mode",
    "limits.torque=[1,2,3]": "[limits] torque has 3 numbers",
    "simulation.backend='m4'": "unknown backend 'm4'; did you mean 'm4f'",
    "simulation.period=0.0": "[[push]] requires [simulation] period > 0",
    "gains={kp=1}": "[feedback] does not go with [gains]",
    "output={type='I'}": "[feedback] does not go with [output]",
    "reference.speed=1": "[feedback] does not go with [reference] speed",
    "reference.position=[0,0,0,0]": "a position of more than x, y and heading",
    "push=[{time=1,on='x',impulse=1}]": "push[0] on: unknown quasi-velocity 'x'",
    "sensors={counts=100}": "there is no dead reckoning",
}


@pytest.mark.parametrize("changed", BAD)
def test_bad_specs_are_refused_in_a_line(changed, bad_input, tmp_path):
    assert BAD[changed] in bad_input(
        ["simulate", "balancer", "-o", str(tmp_path / "run.csv"), "--set", changed]
    )


def test_other_commands_refuse_it(bad_input, tmp_path):
    out = ["-o", str(tmp_path / "run.csv")]
    target = ["--set", "simulation.backend='m4f'", "--record", str(tmp_path / "record")]
    assert "a record is of a law" in bad_input(["simulate", "balancer", *out, *target])
    assert "[feedback] does not go with noslip outer-loop" in bad_input(
        ["outer-loop", "balancer", "--spec", "balancer"]
    )
    assert "[feedback] does not go with analyse --start" in bad_input(
        ["analyse", "balancer", "--start", "balancer"]
    )
    assert "commands requires [feedback]" in bad_input(
        ["simulate", "line", *out, "--set", "reference.commands=[{time=1}]"]
    )
    assert "a run requires [output] or [feedback]" in bad_input(
        ["simulate", "line", *out, "--set", "output={type='lqr'}"]
    )
    generate = ["generate", "balancer", "--lqr", "pitch=1", "-o", str(tmp_path)]
    assert "give NAME=NUMBER, such as speed=0.5" in bad_input([*generate, "--motion", "speed"])
    assert "--motion applies to --lqr" in bad_input(["generate", "balancer", "--motion", "speed=1"])
    assert "no steady motion with yaw_rate = 1" in bad_input(
        ["generate", "sleigh", "--lqr", "phi=1", "--motion", "yaw_rate=1"]
    )


def test_the_command_draws_and_films(tmp_path):
    """A run of a second with all that a user may ask for."""
    files = [str(tmp_path / name) for name in ("run.csv", "run.png", "run.html")]
    short = ["--set", "simulation.duration=4.0", "--set", "reference.commands=[]"]
    assert (
        main(["simulate", "balancer", "-o", files[0], "--plot", files[1], "--animate", files[2], *short]) == 0
    )
    assert (tmp_path / "run.csv").read_text().startswith("t,x,y,phi,pitch,") and (
        tmp_path / "run.png"
    ).stat().st_size > 10_000
