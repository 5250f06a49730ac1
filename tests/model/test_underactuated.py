"""Underactuated robots: equations against textbooks, partial feedback linearization, verdicts at rest,
LQR on the rigid model."""

import dataclasses
import math
import re
import subprocess
from pathlib import Path

import casadi as ca
import noslip
import numpy as np
import pytest
from noslip.analysis.answers import analyse, as_json
from noslip.analysis.report import report
from noslip.analysis.text import as_text
from noslip.analysis.underactuated import Confirmed, confirm, region, returns, run, verdicts
from noslip.cli.main import main
from noslip.model import Mechanism, ModelError
from noslip.model.underactuated import PartialLinearization, partial_linearization
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot
from noslip.simulation.controllers.balance.feedback import Balanced
from noslip.simulation.controllers.balance.in_c import BalanceInC, differences
from noslip.simulation.controllers.balance.steady import Steady, analyse_at_rest
from noslip.simulation.controllers.balance.zero_dynamics import of_velocities
from noslip.tests.runtime_c.test_runtime import RUNTIME, STRICT
from noslip.tests.tools import COMPILERS

NAMES = ("balancer", "roller_racer", "sleigh", "snakeboard")
WEIGHTS = {"pitch": 10.0, "x": 40.0, "phi": 20.0, "speed": 1.0, "pitch_rate": 0.1, "yaw_rate": 0.5}


def values(robot: Mechanism) -> dict[str, float]:
    return {p.name: p.default for p in robot.parameters}


def states(partial: PartialLinearization, count: int):
    """Random states [q; nu] and inputs, and u = nudot there."""
    system, random = partial.system, np.random.default_rng(4)
    mechanism, tau = system.mechanism, ca.SX.sym("tau", len(system.mechanism.inputs))
    p = mechanism.parameter_values({})
    function = ca.Function("u", [mechanism.q, system.nu, tau, mechanism.p], [system.acceleration(tau)])
    for _ in range(count):
        q, nu, given = (
            random.uniform(-1.0, 1.0, size) for size in (len(mechanism.coordinates), system.dof, tau.numel())
        )
        yield q, nu, given, function(q, nu, given, p).full().ravel()


def test_the_balancer_is_the_textbooks():
    """Newton's law forward, and the moments of the body about the axle and of the whole about the
    vertical."""
    robot = find_robot("balancer")
    v, at = values(robot), [c.name for c in robot.coordinates].index("pitch")
    m, h, r, b, wheel = v["m"], v["h"], v["r"], v["b"], v["m_w"] + v["I_w"] / v["r"] ** 2
    for q, (speed, yaw, tilt), (right, left), (faster, turn, fall) in states(
        partial_linearization(robot), 50
    ):
        s, c = np.sin(q[at]), np.cos(q[at])
        unlike = v["I_x"] - v["I_z"] + m * h**2
        pushed = (m + 2 * wheel) * faster + m * h * (c * fall - s * (tilt**2 + yaw**2)) - (right + left) / r
        tipped = (
            m * h * c * faster
            + (v["I_y"] + m * h**2) * fall
            - m * v["g"] * h * s
            - unlike * s * c * yaw**2
            + right
            + left
        )
        about = 2 * v["I_d"] + v["I_z"] * c**2 + (v["I_x"] + m * h**2) * s**2 + 2 * b**2 * wheel
        turned = (
            about * turn + 2 * unlike * s * c * tilt * yaw + m * h * s * speed * yaw - b / r * (right - left)
        )
        np.testing.assert_allclose([pushed, tipped, turned], 0.0, atol=1e-11)


def test_the_roller_racer_obeys_newton_and_euler():
    """Board and handlebar apart: unknown side forces of both axles;
    places as complex numbers in the axes of the board."""
    robot = find_robot("roller_racer")
    v = values(robot)
    for q, (speed, swinging), (torque,), (faster, swung) in states(partial_linearization(robot), 50):
        swing = q[3]
        bar, ahead = np.exp(1j * swing), v["l_1"]
        # Side speed of the handlebar's axle: that of the pivot, and -l_2 times the rate of the bar.
        yaw = (np.sin(swing) * speed + v["l_2"] * swinging) / (ahead * np.cos(swing) - v["l_2"])
        # Unknown: yaw acceleration, side forces of board and bar. Accelerations in the board's axes.
        rear = faster + 1j * speed * yaw  # of the rear axle, which has no side speed
        rows, right = [], []
        pull = rear - v["c"] * yaw**2  # of the centre of mass, without c * yaw acceleration to the left
        rows += [[0.0, 0.0, -(1j * bar).real], [v["m"] * v["c"], -1.0, -(1j * bar).imag]]
        right += [-v["m"] * pull.real, -v["m"] * pull.imag]
        rows += [[v["I"], v["c"], -(ahead - v["c"]) * np.cos(swing)], [v["I_h"], 0.0, v["l_2"]]]
        right += [-torque, torque - v["I_h"] * swung]
        # The rate of the constraint: l_1 yaw cos - v sin - l_2 (yaw + swing rate) = 0.
        rows.append([ahead * np.cos(swing) - v["l_2"], 0.0, 0.0])
        right.append(
            (ahead * yaw * np.sin(swing) + speed * np.cos(swing)) * swinging
            + faster * np.sin(swing)
            + v["l_2"] * swung
        )
        unknown, *_ = np.linalg.lstsq(np.array(rows), np.array(right), rcond=None)
        np.testing.assert_allclose(np.array(rows) @ unknown, right, atol=1e-9 * (1 + np.abs(right).max()))


@pytest.mark.parametrize("name", NAMES)
def test_velocities_at_the_inputs_are_linearized(name):
    """w' = v, and the inputs found give these accelerations to the robot."""
    partial = partial_linearization(find_robot(name))
    system, v = partial.system, ca.SX.sym("v", len(partial.system.driven))
    u = partial.acceleration(v)
    tau = partial.inputs(u)
    moved = system.acceleration(tau)
    w_rate = system.along_motion(partial.velocities) + ca.jacobian(partial.velocities, system.nu) @ moved
    everything = ca.vertcat(moved - u, w_rate - v, ca.vec(partial.annihilator @ system.input_map))
    function = ca.Function("f", [system.mechanism.q, system.nu, v, system.mechanism.p], [everything])
    random, p = np.random.default_rng(2), system.mechanism.parameter_values({})
    for _ in range(30):
        q, nu, wanted = (
            random.uniform(-0.8, 0.8, size) for size in (system.mechanism.q.numel(), system.dof, v.numel())
        )
        np.testing.assert_allclose(function(q, nu, wanted, p).full(), 0.0, atol=1e-8)


def test_the_balancers_modes_are_those_of_a_pencil():
    """Free: m h v' + J pitch'' = m g h pitch with M v' + m h pitch'' = 0. Its wheels fixed to the body:
    it rolls as one."""
    rest = analyse_at_rest(find_robot("balancer"))
    v = values(find_robot("balancer"))
    m, h, r, whole = v["m"], v["h"], v["r"], v["m"] + 2 * (v["m_w"] + v["I_w"] / v["r"] ** 2)
    J, weight = v["I_y"] + m * h**2, m * v["g"] * h
    falls = np.sqrt(weight * whole / (whole * J - (m * h) ** 2))
    rolls = np.sqrt(weight / (whole * r**2 + 2 * m * h * r + J))
    for modes, expected, still in ((rest.modes, falls, 4), (of_velocities(rest).modes, rolls, 5)):
        np.testing.assert_allclose(sorted(modes.real), [-expected, *[0.0] * still, expected], atol=1e-5)
    assert rest.stabilizable and rest.left == 3 and len(rest.unreached) == 3


def test_the_sleigh_is_chaplygins():
    """v' = a w^2 and (I + m a^2) w' = torque - m a v w."""
    robot = find_robot("sleigh")
    v = values(robot)
    for _, (speed, turning), (torque,), (faster, turned) in states(partial_linearization(robot), 50):
        expected = [
            v["a"] * turning**2,
            (torque - v["m"] * v["a"] * speed * turning) / (v["I"] + v["m"] * v["a"] ** 2),
        ]
        np.testing.assert_allclose([faster, turned], expected, atol=1e-10)


def test_the_snakeboard_is_that_of_its_source():
    """theta' = v tan(phi) / l; the momenta of rotor, wheels, and of the whole along the constraints:
    Lagrange's equations of m v^2 / 2 + J_0 theta'^2 / 2 + J_r (2 theta' psi' + psi'^2) / 2 + J_w phi'^2 with
    the inertia J_0 = J + J_r + 2 J_w.
    """
    robot = find_robot("snakeboard")
    v = values(robot)
    whole = v["J"] + v["J_r"] + 2 * v["J_w"]
    for q, (speed, _, wheels), (tau_psi, tau_phi), (faster, spun, steered) in states(
        partial_linearization(robot), 50
    ):
        t = np.tan(q[4])
        turned = (faster * t + speed * wheels * (1 + t**2)) / v["l"]
        np.testing.assert_allclose(v["J_r"] * (turned + spun), tau_psi, atol=1e-9)
        np.testing.assert_allclose(2 * v["J_w"] * steered, tau_phi, atol=1e-9)
        along = v["m"] * faster + t / v["l"] * (whole * turned + v["J_r"] * spun)
        np.testing.assert_allclose(along, 0.0, atol=1e-9 * (1 + abs(whole * turned)))


def two_pendulums() -> Mechanism:
    """A pendulum that a motor drives, and one upside down that it does not reach."""
    robot = Mechanism("pair", "two pendulums, and a needle that shows the angle of the first")
    a, b, needle = (robot.coordinate(name, "rad") for name in ("a", "b", "needle"))
    robot.holds("needle", needle - a)
    g = robot.parameter("g", 9.81, "m/s^2")
    robot.kinetic_energy(robot.rate(a) ** 2 / 2 + robot.rate(b) ** 2 / 2)
    robot.potential_energy(g * ca.cos(b) - g * ca.cos(a))
    robot.input("motor", "N m", on=robot.rate(a))
    return robot


def test_what_cannot_be_stabilized_is_said_with_the_reason():
    rest = analyse_at_rest(two_pendulums())
    grows = np.sqrt(9.81)
    assert not rest.stabilizable and rest.left == 1  # needle - a cannot change
    np.testing.assert_allclose(sorted(rest.unreached.real), [-grows, 0.0, grows], atol=1e-9)
    assert verdicts(rest)[0].startswith("1 input (motor) for 2 degrees of freedom")
    assert verdicts(rest)[-1].startswith(
        "not stabilizable: no input moves the modes 3.132, 0, -3.132 1/s, and one of them grows"
    )
    racer = analyse_at_rest(find_robot("roller_racer"))
    assert racer.stabilizable and racer.left == 4
    assert verdicts(racer)[-1].startswith(
        "nothing grows, but not asymptotically stabilizable by linear feedback"
    )


def test_noncollocated_linearization_is_spongs():
    """The balancer's motors sum to f = tau_r + tau_l. Eliminated from its two equations for the speed v and
    the pitch p, (whole r + m h c) v' + (m h r c + J) p' = m g h s + m h r s p'^2; rates of p or of v chosen,
    the other follows, and f.
    """
    robot = find_robot("balancer")
    p, partial = values(robot), partial_linearization(robot)
    m, h, r, whole = p["m"], p["h"], p["r"], p["m"] + 2 * (p["m_w"] + p["I_w"] / p["r"] ** 2)
    J, system, v = p["I_y"] + p["m"] * p["h"] ** 2, partial.system, ca.SX.sym("v", 2)
    random, given = np.random.default_rng(6), robot.parameter_values({})
    for chosen in ((1, 2), (0, 1)):
        u = partial.acceleration(v, chosen)
        function = ca.Function("u", [robot.q, system.nu, v, robot.p], [u, partial.inputs(u)])
        for _ in range(20):
            q, (speed, tilt), wanted = (
                random.uniform(-0.6, 0.6, 6),
                random.uniform(-1, 1, 2),
                random.uniform(-2, 2),
            )
            s, c = np.sin(q[3]), np.cos(q[3])
            rates = [0.0, wanted] if chosen == (1, 2) else [wanted, 0.0]
            found, tau = function(q, [speed, 0.0, tilt], rates, given)
            pulled = m * p["g"] * h * s + m * h * r * s * tilt**2
            ahead, over = whole * r + m * h * c, m * h * r * c + J
            both = (
                [(pulled - over * wanted) / ahead, wanted]
                if chosen == (1, 2)
                else [wanted, (pulled - ahead * wanted) / over]
            )
            np.testing.assert_allclose(found.full().ravel(), [both[0], 0.0, both[1]], atol=1e-9)
            force = r * (whole * both[0] + m * h * (c * both[1] - s * tilt**2))
            assert float(ca.sum1(tau)) == pytest.approx(force, abs=1e-9)
    rest = analyse_at_rest(robot)
    falls = np.sqrt(m * p["g"] * h / (m * h * r + J))
    np.testing.assert_allclose(
        sorted(of_velocities(rest, (0, 1)).modes.real), [-falls, *[0.0] * 5, falls], atol=1e-5
    )
    np.testing.assert_allclose(of_velocities(rest, (1, 2)).modes, 0.0, atol=1e-4)
    said = verdicts(rest)[3]
    assert (
        "yaw_rate, pitch_rate: 0 (7 times) 1/s, none of them grows" in said
        and "speed, yaw_rate: 4.521" in said
    )
    assert "speed: not possible at rest" in verdicts(analyse_at_rest(find_robot("sleigh")))[3]


@pytest.mark.parametrize(
    "name", [name if name == "sleigh" else pytest.param(name, marks=pytest.mark.nightly) for name in NAMES]
)
def test_the_analysis_says_it(name):
    answer = analyse(find_robot(name))
    assert "Underactuated, at rest" in as_text(answer) and answer.at_rest == tuple(as_json(answer)["at_rest"])
    assert (
        len(answer.at_rest) == 5 and "degrees of freedom; at rest at q = 0, by numbers" in answer.at_rest[0]
    )
    assert answer.at_rest[1].endswith("; 1 mode of these grows") == (name == "balancer")
    assert answer.at_rest[2] in report(answer)


def balanced(limit: float = 4.0) -> tuple[Steady, Balanced, np.ndarray]:
    rest = analyse_at_rest(find_robot("balancer"))
    K, X = rest.lqr(WEIGHTS, 0.2)
    return rest, Balanced(rest, K, limit), X


def test_the_balancer_stands_drives_a_line_and_stops():
    """Torques held for 10 ms and limited, on the rigid model: from a tilt back to rest;
    2 m ahead in 6 s, upright at the end."""
    rest, loop, X = balanced()
    tilted = np.array([0.2 * (name == "pitch") for name in rest.names])
    stood, inputs = run(loop, tilted, 6.0, lambda t: np.zeros(9))
    assert np.abs(stood[-1]).max() < 1e-5 and np.abs(inputs).max() <= 4.0
    r = values(find_robot("balancer"))["r"]

    def desired(t: float) -> np.ndarray:
        u = min(t / 6.0, 1.0)
        way, speed = 2.0 * u**3 * (10 - 15 * u + 6 * u**2), 10.0 * (u * (1 - u)) ** 2
        along = {"x": way, "theta_r": way / r, "theta_l": way / r, "speed": speed}
        return np.array([along.get(name, 0.0) for name in rest.names])

    driven, _ = run(loop, np.zeros(9), 12.0, desired)
    off = driven - [desired(0.01 * k) for k in range(len(driven))]
    assert np.abs(off[-1]).max() < 1e-4 and np.abs(off[:, 0]).max() < 0.2
    assert np.abs(driven[:, rest.names.index("pitch")]).max() < 0.1 and np.abs(driven[:, 1]).max() < 1e-9
    fell, _ = run(loop, 6 * tilted, 6.0, lambda t: np.zeros(9))
    assert len(fell) < 601  # it falls: 4 N m are not enough from 1.2 rad


WITHOUT = ("theta_r", "theta_l")
LQR = [
    "generate",
    "balancer",
    "--lqr",
    *(f"{name}={weight}" for name, weight in WEIGHTS.items()),
    "--effort",
    "0.2",
]


def in_c(scalar: str) -> tuple[Steady, Balanced]:
    """The balancer that does not use the angles of its wheels, with the feedback of the C."""
    rest, loop, _ = balanced()
    own = Balanced(rest, rest.without(loop.K, *WITHOUT), 4.0)
    return rest, dataclasses.replace(own, feedback=BalanceInC(own, scalar))


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_the_balancer_turns_drives_and_stops_by_the_c(scalar):
    """From a tilt, turned by 2 rad on the spot, then 1.5 m along the heading that it has:
    the gains hold for every heading."""
    rest, loop = in_c(scalar)
    at = {name: k for k, name in enumerate(rest.names)}

    def desired(t: float) -> np.ndarray:
        made, turned, gone = np.zeros(9), np.clip(t / 4.0, 0.0, 1.0), np.clip((t - 6.0) / 6.0, 0.0, 1.0)
        made[at["phi"]] = 2.0 * turned**2 * (3 - 2 * turned)
        made[at["yaw_rate"]] = 12.0 * turned * (1 - turned) / 4.0
        way, speed = 1.5 * gone**3 * (10 - 15 * gone + 6 * gone**2), 1.5 * 30 * (gone * (1 - gone)) ** 2 / 6.0
        made[at["x"]], made[at["y"]], made[at["speed"]] = way * np.cos(2.0), way * np.sin(2.0), speed
        return made

    driven, inputs = run(loop, np.eye(9)[at["pitch"]] * 0.1, 18.0, desired)
    end = driven[-1] - desired(18.0)
    ahead, beside = (
        np.array([[np.cos(2.0), np.sin(2.0)], [-np.sin(2.0), np.cos(2.0)]]) @ end[[at["x"], at["y"]]]
    )
    assert len(driven) == 1801 and np.abs(inputs).max() <= 4.0 and abs(ahead) < 1e-5
    assert np.abs(end[[at[name] for name in ("phi", "pitch", "speed")]]).max() < 1e-5
    # No input moves it sideways at rest: what the turn while it rights itself left stays
    assert abs(beside) < 0.01
    assert np.abs(driven[:, at["pitch"]]).max() < 0.2


def test_the_c_of_a_feedback_is_the_feedback():
    """At random states, with its limits, what has fallen, and headings by whole turns;
    a wrong gain is found."""
    _, loop, _ = balanced()
    assert differences(loop) == {
        "double": pytest.approx(0.0, abs=1e-13),
        "float": pytest.approx(0.0, abs=1e-5),
    }
    wrong = dataclasses.replace(loop, K=loop.K * (1 + 1e-9), feedback=None)
    x = np.full(9, 0.05)
    assert BalanceInC(loop).step(x, 0 * x)[1] == pytest.approx(loop.step(x, 0 * x)[1], abs=1e-14)
    assert not np.abs(BalanceInC(loop).step(x, 0 * x)[1] - wrong.step(x, 0 * x)[1]).max() < 1e-12
    turned = x + 2 * np.pi * (np.arange(9) == loop.steady.names.index("phi"))
    np.testing.assert_allclose(BalanceInC(loop).step(turned, 0 * x)[1], loop.step(x, 0 * x)[1], atol=1e-12)
    for state, status in ((20 * x, "ok"), (40 * x, "astray"), (x * np.nan, "nonfinite"), (1e9 * x, "range")):
        found, tau = BalanceInC(loop).step(state, 0 * x)
        assert found == status or (found, status) == ("saturated", "ok")
        assert np.isfinite(tau).all() and (status == "ok" or not tau.any())


def test_gains_without_states_do_the_same():
    rest, loop, _ = balanced()
    kept = rest.without(loop.K, *WITHOUT)
    np.testing.assert_allclose(kept @ rest.reached, loop.K @ rest.reached, atol=1e-8)
    assert not kept[:, [rest.names.index(name) for name in WITHOUT]].any()
    with pytest.raises(BadInput, match="without speed the other states do not tell enough"):
        rest.without(loop.K, "speed")
    with pytest.raises(BadInput, match="unknown state 'tilt'"):
        rest.without(loop.K, "tilt")


def test_the_command_writes_the_feedback(tmp_path, capsys, bad_input):
    """It compiles with strict warnings, alone and with gcc and clang; bad options are refused in a line."""
    assert (
        main([*LQR, "--limit", "4", "--without", "theta_r", "--without", "theta_l", "-o", str(tmp_path)]) == 0
    )
    assert "compared at random states" in capsys.readouterr().out
    written = tmp_path / "balancer" / "balancer_lqr.h"
    assert written.read_text().startswith(
        "/* balancer_lqr.h - Generated by noslip: state feedback of balancer at rest, --lqr pitch"
    )
    (tmp_path / "main.c").write_text(
        '#include "balancer_lqr.h"\nint main(void)\n{\n    noslip_balance_f self;\n'
        "    float state[BALANCER_LQR_STATES] = {0}, tau[BALANCER_LQR_INPUTS];\n"
        "    return balancer_lqr_init_f(&self) + noslip_balance_step_f(&self, state, state, tau);\n}\n"
    )
    first = written.read_text()
    assert main([*LQR, "--effort", "2", "-o", str(tmp_path)]) == 0 and written.read_text() != first
    for cc in COMPILERS:
        command = [cc, "-std=c99", *STRICT, f"-I{RUNTIME}", f"-I{written.parent}", str(tmp_path / "main.c")]
        subprocess.run([*command, "-o", str(tmp_path / "main")], check=True)
        assert subprocess.run([tmp_path / "main"]).returncode == 0
    for arguments, message in (
        (["generate", "labmate", "--lqr", "x=1"], "it is not underactuated"),
        (["generate", "balancer", "--lqr", "pitch"], "give NAME=NUMBER"),
        (["generate", "balancer", "--lqr", "pitch=1", "pitch=2"], "pitch has a number already"),
        ([*LQR, "--limit", "-2"], "--limit = -2 must be positive"),
        ([*LQR, "--output", "type_i"], "--lqr does not go with --output"),
        ([*LQR, "--check", "--explain"], "--lqr does not go with --check, --explain"),
        ([*LQR, "--check", "--scalar", "float"], "--lqr does not go with --check, --scalar"),
        ([*LQR, "--scale", "r", "--adapt", "m_b"], "--lqr does not go with --scale, --adapt"),
        (["generate", "balancer", "--limit", "3"], "--limit applies to --lqr"),
        (["generate", "balancer", "--effort", "1"], "--effort applies to --lqr"),
    ):
        assert message in bad_input(arguments)


def test_gains_are_those_of_the_riccati_equation():
    """The cost X satisfies A'X + XA - X B R^-1 B'X + Q = 0 for what the inputs reach, and K = R^-1 B'X."""
    rest, loop, X = balanced()
    T = rest.reached
    Q, R = np.diag([WEIGHTS.get(name, 0.0) for name in rest.names]), 0.2 * np.eye(2)
    residual = rest.A.T @ X + X @ rest.A - X @ rest.B @ np.linalg.inv(R) @ rest.B.T @ X + Q
    assert np.abs(T.T @ residual @ T).max() < 1e-7 * np.abs(X).max()
    np.testing.assert_allclose(loop.K, np.linalg.inv(R) @ rest.B.T @ X, atol=1e-9 * np.abs(loop.K).max())


@pytest.mark.parametrize("count", [24, pytest.param(1000, marks=pytest.mark.nightly)])
def test_a_region_of_attraction_by_sampling(count):
    """All samples cheaper than the first that does not return do; far ones fall;
    the region is of a useful size."""
    _, loop, X = balanced()
    found = region(loop, X, {"pitch": 0.8, "pitch_rate": 4.0}, count, 6.0)
    assert found.returned.any() and not found.returned.all()
    assert found.returned[found.cost < found.level].all() and found.inside >= 0.1 * count
    of = [loop.steady.names.index(name) for name in ("pitch", "pitch_rate")]
    edge = found.boundary(*of)
    np.testing.assert_allclose(np.sum(edge @ X[np.ix_(of, of)] * edge, axis=1), found.level, rtol=1e-9)
    (axes,) = found.draw(loop.steady.partial.system.state, *of).axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("pitch (rad)", "pitch_rate (rad/s)")
    shown = [len(line.get_xdata()) for line in axes.lines[:2]]
    assert shown == [found.returned.sum(), count - found.returned.sum()]
    again = region(loop, X, {"pitch": 0.1, "pitch_rate": 0.5}, 6, 6.0)
    assert again.returned.all() and again.level == np.inf and again.inside == 6


def measured() -> tuple[Balanced, np.ndarray]:
    """The balancer whose gains do not use the angles of its wheels, and the form of the cost."""
    rest, loop, X = balanced()
    return Balanced(rest, rest.without(loop.K, "theta_r", "theta_l"), loop.limit), X


@pytest.mark.parametrize("count", [16, pytest.param(1000, marks=pytest.mark.nightly)])
def test_a_level_is_confirmed_by_fresh_starts(count):
    """In all directions that the inputs reach, with limits, called every 10 ms;
    far beyond it robots fall, and are counted."""
    loop, X = measured()
    found = confirm(loop, X, 1.4, count, 6.0)
    assert found.returned == count and found.share(0.95) == pytest.approx(0.05 ** (1 / count), rel=1e-9)
    far = confirm(loop, X, 12.0, 16, 6.0)
    assert 0 < far.returned < 8 and 0 < far.share() < far.returned / 16


def test_the_bound_of_a_share_is_the_binomial_distributions():
    """With the share at the bound, as many returns or more have the probability 1 - confidence,
    summed term by term."""
    for count, returned in ((20, 20), (200, 187), (50, 1)):
        p = Confirmed(1.0, count, returned).share(0.9)
        tail = sum(math.comb(count, k) * p**k * (1 - p) ** (count - k) for k in range(returned, count + 1))
        assert tail == pytest.approx(0.1, rel=1e-9)
    assert Confirmed(1.0, 5, 0).share() == 0.0


def test_starts_of_a_confirmation_are_uniform(monkeypatch):
    """All have a cost up to the level; half of it encloses 2^-3 of a ball in the 6 dimensions that the inputs
    reach."""
    loop, X = measured()
    starts: list[np.ndarray] = []
    monkeypatch.setattr(
        "noslip.analysis.underactuated.returns",
        lambda balanced, start, duration, within: starts.append(start) or True,
    )
    confirm(loop, X, 0.7, 4000, 6.0)
    of = np.array(starts)
    cost, T = np.sum((of @ X) * of, axis=1), loop.steady.reached
    assert cost.max() <= 0.7 * (1 + 1e-9) and np.abs(of - of @ T @ T.T).max() < 1e-12
    assert abs(np.mean(cost < 0.35) - 1 / 8) < 4 * math.sqrt(1 / 8 * 7 / 8 / 4000)
    assert np.abs((of @ X @ T).mean(axis=0)).max() < 0.05 * np.abs(of @ X @ T).max()  # on all sides alike


def test_wheels_that_roll_on_are_no_fall():
    """A start that is turned and moves: the wheels end turned, as gains without their angles let them;
    it returned."""
    loop, _ = measured()
    start = np.zeros(len(loop.steady.names))
    start[[loop.steady.names.index(name) for name in ("phi", "speed")]] = 0.4, 1.0
    states, _ = run(loop, start, 6.0, lambda t: np.zeros(len(start)))
    wheels = [loop.steady.names.index(name) for name in ("theta_r", "theta_l")]
    assert np.abs(states[-1, wheels]).min() > 0.05 and returns(loop, start, 6.0, 1e-3)


def test_bad_input():
    rest, loop, X = balanced()
    wrong = {
        "unknown state 'tilt'; known are x, y, phi, pitch": lambda: rest.lqr({"tilt": 1.0}),
        "weight of pitch is -1.0": lambda: rest.lqr({"pitch": -1.0}),
        "effort must be positive": lambda: rest.lqr(WEIGHTS, 0.0),
        "weigh further states": lambda: rest.lqr({"pitch": 1.0}),
        "confirm: level = inf is not finite": lambda: confirm(loop, X, np.inf, 1, 1.0),
        "confirm: starts = 0 must be 1 or more": lambda: confirm(loop, X, 1.0, 0, 1.0),
        "confidence = 1 must be below": lambda: Confirmed(1.0, 1, 1).share(1.0),
        "region: unknown state 'tilt'": lambda: region(loop, X, {"tilt": 1.0}, 1, 1.0),
    }
    for message, call in wrong.items():
        with pytest.raises(BadInput, match=message):
            call()
    tilted = [0.3 * (c.name == "pitch") for c in find_robot("balancer").coordinates]
    with pytest.raises(ModelError, match="balancer: no inputs hold it at rest at q = .*: a force of"):
        analyse_at_rest(find_robot("balancer"), tilted)
    with pytest.raises(ModelError, match="labmate: 2 inputs for n - m = 2: it is not underactuated"):
        analyse_at_rest(find_robot("labmate"))


def test_the_page_runs(capsys):
    page = (Path(noslip.__file__).parent / "docs" / "underactuated.md").read_text()
    (code,) = re.findall(
        r"<!-- run by tests/model/test_underactuated.py -->\n```python\n(.*?)```", page, re.DOTALL
    )
    exec(compile(code, "underactuated.md", "exec"), {})
    left, inside, fresh = capsys.readouterr().out.splitlines()
    assert float(left) < 1e-5 and "of 24 samples are inside the level" in inside
    assert fresh == "20 of 20 fresh starts returned: 79.4% of all at least, 99 % sure"
