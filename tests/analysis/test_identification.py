"""Parameters from logs: against the numbers with which the logs were made, over random noise,
and by what cannot be told."""

import csv
import json
import math
from functools import cache
from pathlib import Path

import casadi as ca
import noslip
import numpy as np
import pytest
from noslip.analysis.identification.bounds import bounded_least_squares
from noslip.analysis.identification.dynamics import Dynamics, combinations
from noslip.analysis.identification.fit import identify, predicted
from noslip.analysis.identification.log import FEWEST, Log, _cleaned, read_log
from noslip.analysis.identification.result import Estimate
from noslip.cli.main import main
from noslip.model import Mechanism, ModelError, reduce
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot, system_of
from noslip.readers.tables import read_table
from noslip.simulation.closed_loop import simulate
from noslip.simulation.drawing import panels
from noslip.simulation.run import Run
from noslip.simulation.specification.spec import spec_of_table
from noslip.simulation.specification.vary import read_varied
from scipy.optimize import minimize
from scipy.signal import lfilter

PLANT = {"m_c": 47.0, "I_c": 11.0}
SYSTEM = system_of(find_robot("labmate"))
DYNAMICS = Dynamics.of(SYSTEM)
VALUES = {p.name: p.default for p in SYSTEM.mechanism.parameters} | {"r": 0.15}


SPEC = {
    "robot": "labmate",
    "plant": PLANT,
    "gains": {"kp": 1.0, "kd": 2.5, "kv": 2.0},
    "output": {"type": "IV", "L": 0.1, "path": {"kind": "circle", "x_f": 0.0, "y_f": 0.0, "R": 3.0}},
    "reference": {"speed": 1.0},
    "initial": {"point": [3.4, 0.0], "heading": 1.3, "speed": 0.2},
    "simulation": {"duration": 6.0, "period": 0.01},
}


@cache
def run() -> Run:
    """Towards a small circle from beside it, torques held for 10 ms, with another mass and inertia."""
    return simulate(spec_of_table(SPEC, Path("none.toml")))


def log_of(noise: float = 0.0, seed: int = 0) -> Log:
    random = np.random.default_rng(seed)
    x = np.hstack([run().q, run().nu + noise * random.normal(size=run().nu.shape)])
    return Log(run().t, x, run().tau, (range(len(x)),), ())


def columns() -> list[str]:
    return ["t", *(q.name for q in SYSTEM.state), *(i.name for i in SYSTEM.mechanism.inputs)]


def table() -> np.ndarray:
    return np.column_stack([run().t, run().q, run().nu, run().tau])


@pytest.fixture
def write(tmp_path):
    def write(rows, head=None, name="log.csv") -> str:
        file = tmp_path / name
        with file.open("w", newline="") as stream:
            csv.writer(stream).writerows([head or columns(), *rows])
        return str(file)

    return write


def test_the_numbers_of_a_run(write, capsys, tmp_path):
    file, picture = write(table().tolist()), tmp_path / "errors.svg"
    assert (
        main(
            ["identify", file, "--robot", "labmate", "--fit", "m_c", "I_c", "--json", "--plot", str(picture)]
        )
        == 0
    )
    drawn = picture.read_text()
    assert (
        "error of thetadot_r" in drawn
        and "left out of the fit" in drawn
        and "predicted minus measured (rad/s)" in drawn
    )
    printed = json.loads(capsys.readouterr().out)
    for name, value in PLANT.items():
        assert printed["parameters"][name]["value"] == pytest.approx(value, rel=1e-8)
    assert printed["inputs"] == "held" and printed["unidentifiable"] == [] and printed["residual"] < 1e-9


NOISE = 0.02  # rad/s


def deviations(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Errors of m_c and I_c, and their standard deviations, of logs with noisy rates."""
    results = [
        identify(log_of(NOISE, seed), DYNAMICS, list(PLANT), VALUES, True).estimates for seed in range(count)
    ]
    errors = np.array([[e[name].value - PLANT[name] for name in PLANT] for e in results])
    return errors, np.array([[e[name].sd for name in PLANT] for e in results])


def test_panels_of_many_outputs_have_rows_of_three():
    _, axes = panels(*"abcde", most=3)
    places = [(each.get_subplotspec().rowspan.start, each.get_subplotspec().colspan.start) for each in axes]
    assert places == [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1)]


def test_values_lie_within_their_deviations():
    off = np.divide(*deviations(6))
    assert np.abs(off).max() < 4.0 and 0.3 < off.std() < 1.8
    assert np.abs(off.mean(axis=0)).max() < 4.0 / np.sqrt(len(off))


@pytest.mark.nightly
def test_errors_that_outputs_share_have_the_right_deviations():
    """The same error of both rates in a row: m_c is seen mainly in their sum, I_c in their difference. As for
    independent errors, they would be off by 1.5 and 0.1 standard deviations.
    """
    off = []
    for seed in range(12):
        common = np.random.default_rng(seed).normal(size=(len(run().t), 1)) * [1.0, 1.0]
        log = log_of()
        log.x[:, -2:] += NOISE * common
        estimates = identify(log, DYNAMICS, list(PLANT), VALUES, True).estimates
        off.append([(estimates[name].value - value) / estimates[name].sd for name, value in PLANT.items()])
    sizes = np.sqrt(np.mean(np.square(off), axis=0))
    assert (sizes > 0.4).all() and (sizes < 1.7).all()


def test_few_degrees_of_freedom_widen_the_interval():
    """Student's quantiles of a table."""
    quantiles = {1: 12.706205, 6: 2.446912, 30: 2.042272, 10**6: 1.959966}
    widths = {k: Estimate(SYSTEM.mechanism.parameters[0], 1.0, 2.0, k).within / 2.0 for k in quantiles}
    assert widths == {k: pytest.approx(each, abs=1e-5) for k, each in quantiles.items()}


OWN = """
from noslip.model.robots.labmate import labmate

def named():
    robot = labmate()
    for name in ("friction", "moving_part", "efficiency_a", "bias_gyro"):
        robot.parameter(name, 2.0, "1", "of its own", "positive")
    return robot
"""


def test_names_of_the_robot_go_before_those_of_motors(write, tmp_path, capsys, bad_input):
    (tmp_path / "own.py").write_text(OWN)
    file, robot = write(table().tolist()), f"{tmp_path / 'own.py'}:named"
    given = ["identify", file, "--robot", robot, "--fit", "m_c", "I_c"]
    assert main([*given, "--set", "efficiency_a=3", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["parameters"]["m_c"]["value"] == pytest.approx(
        PLANT["m_c"], rel=1e-8
    )
    assert "rename the robot's" in bad_input([*given, "--drive", "current", "--map", "current_tau_r=tau_r"])
    assert "rename the robot's" in bad_input([*given, "--outputs", "thetadot_r", "thetadot_l", "gyro"])
    assert "does not depend" in bad_input([*given[:5], "moving_part"])


def test_too_few_inputs(write, bad_input):
    message = bad_input(["identify", write(table().tolist()), "--robot", "balancer", "--fit", "m_b"])
    assert "2 inputs and 3 degrees of freedom; identification does not support" in message


@pytest.mark.nightly
def test_correlated_errors_have_larger_deviations():
    """Errors with a correlation of 0.7 from row to row: as for independent ones,
    deviations would be half of what they are."""
    results = []
    for seed in range(40):
        white = np.random.default_rng(seed).normal(size=(len(run().t) + 100, 2))
        errors = NOISE * math.sqrt(1 - 0.7**2) * lfilter([1.0], [1.0, -0.7], white, axis=0)[100:]
        log = Log(run().t, np.hstack([run().q, run().nu + errors]), run().tau, (range(len(errors)),), ())
        estimates = identify(log, DYNAMICS, list(PLANT), VALUES, True).estimates
        results.append(
            [(estimates[name].value - value) / estimates[name].sd for name, value in PLANT.items()]
        )
    inside = np.mean(np.abs(results) < 1.96, axis=0)
    print(inside)
    assert (inside > 0.8).all()


@pytest.mark.nightly
def test_values_lie_in_their_intervals_in_most_logs():
    """In 93 to 97 % of 1000 logs, with errors, and stated deviations, within 1.2 times the bound of Cramer
    and Rao for the whole log.
    """
    errors, sd = deviations(1000)
    every = DYNAMICS.values(VALUES | PLANT)
    bound = predicted(log_of(), DYNAMICS, list(PLANT), every, True).expected_deviations(np.full(2, NOISE))
    inside, size = np.mean(np.abs(errors) < 1.96 * sd, axis=0), np.sqrt(np.mean(errors**2, axis=0))
    print(dict(zip(PLANT, zip(inside, size / list(bound.values()), strict=True), strict=True)))
    assert (inside > 0.93).all() and (inside < 0.97).all()
    assert (np.stack([size, np.mean(sd, axis=0)]) < 1.2 * np.array(list(bound.values()))).all()


def test_what_a_motion_cannot_tell():
    """By hand: speed sees m_c + 2 m_w + 2 I_w/r^2, turning I_c + 2 I_m + 2 (m_w + I_w/r^2) b^2,
    both m_c d."""
    every = DYNAMICS.values(VALUES).tolist()
    r = VALUES["r"]
    others_of = {
        c.pivot: dict(c.others) for c in combinations(DYNAMICS, ["m_c", "I_c", "m_w", "I_w", "I_m"], every)
    }
    assert set(others_of) == {"m_c", "I_c", "m_w"} and others_of["m_c"] == {}
    assert others_of["m_w"] == {"I_w": pytest.approx(1 / r**2, rel=1e-12)}
    assert others_of["I_c"] == {"I_m": pytest.approx(2.0, rel=1e-12)}


def test_a_mass_that_is_seen_only_with_others_is_not_answered():
    result = identify(log_of(), DYNAMICS, ["I_c", "I_m", "m_c"], VALUES, True)
    assert list(result.estimates) == ["m_c"] and result.estimates["m_c"].value == pytest.approx(
        47.0, rel=1e-6
    )
    assert result.unidentifiable == (
        "I_c, I_m: any motion shows only I_c + 2 I_m (factors at the given values)",
    )


def test_a_log_without_turning_does_not_show_the_inertia():
    t = np.arange(500) * 0.01
    tau, mechanism = ca.SX.sym("tau", 2), SYSTEM.mechanism
    arguments = [mechanism.q, SYSTEM.nu, tau, ca.vertcat(*[p.symbol for p in mechanism.parameters])]
    acceleration = ca.Function("acceleration", arguments, [SYSTEM.acceleration(tau)])
    per_torque = acceleration(0, 0, 1, list(VALUES.values())).full()
    nu = (per_torque * (1 - np.cos(t))).T  # of equal torques sin t
    log = Log(t, np.hstack([np.zeros((500, 5)), nu]), np.sin(t)[:, None] * [1.0, 1.0], (range(500),), ())
    result = identify(log, DYNAMICS, ["m_c", "I_c"], VALUES, False)
    assert list(result.estimates) == ["m_c"] and result.estimates["m_c"].value == pytest.approx(
        VALUES["m_c"], rel=1e-5
    )
    assert result.unidentifiable[0].startswith("I_c: this log does not show it")


def thin_disk(tied: bool) -> Mechanism:
    """A disk that rolls and turns, I about the axle and J about a diameter, or with I = 2 J in its place."""
    robot = Mechanism("thin_disk", "")
    x, y, phi, theta = (
        robot.coordinate(name, unit)
        for name, unit in (("x", "m"), ("y", "m"), ("phi", "rad"), ("theta", "rad"))
    )
    J = robot.parameter("J", 0.08, "kg m^2")
    I = 2 * J if tied else robot.parameter("I", 0.15, "kg m^2")  # noqa: E741
    if not tied:
        robot.principal_inertias(J, I, J)
    x_dot, y_dot, turning, rolling = (robot.rate(each) for each in (x, y, phi, theta))
    robot.kinetic_energy(x_dot**2 + y_dot**2 + J * turning**2 / 2 + I * rolling**2 / 2)
    robot.rolls("rolls", ca.cos(phi) * x_dot + ca.sin(phi) * y_dot - 0.3 * rolling)
    robot.rolls("no side slip", ca.cos(phi) * y_dot - ca.sin(phi) * x_dot)
    for name, rate in (("thetadot", rolling), ("phidot", turning)):
        robot.input(f"tau_{name}", "N m", on=rate)
        robot.quasi_velocity(name, "rad/s", rate)
    robot.moves_in_plane(x, y, phi)
    return robot


def log_of_disk(I: float, J: float, seed: int = 4) -> Log:  # noqa: E741
    """Torques of two frequencies at the inertia I + 2 R^2 of rolling and J of turning, by hand;
    noisy rates."""
    t, random = np.arange(600) * 0.01, np.random.default_rng(seed)
    tau, inertia = np.column_stack([np.cos(3 * t), 0.5 * np.cos(2 * t)]), np.array([I + 2 * 0.3**2, J])
    nu = np.column_stack([np.sin(3 * t) / 3, 0.5 * np.sin(2 * t) / 2]) / inertia + 0.01 * random.normal(
        size=tau.shape
    )
    return Log(t, np.hstack([np.zeros((600, 4)), nu]), tau, (range(600),), ())


def test_inertias_stay_those_of_a_body():
    """A log that a disk cannot make: the answer is that of the robot in which I is 2 J; and one of a disk,
    as it is."""
    free, tied = (Dynamics.of(reduce(thin_disk(each))) for each in (False, True))
    beyond, within = log_of_disk(0.3, 0.08), log_of_disk(0.12, 0.08)
    result = identify(beyond, free, ["I", "J"], {}, False)
    on_bound = identify(beyond, tied, ["J"], {}, False).estimates["J"].value
    assert result.estimates["J"].value == pytest.approx(on_bound, rel=1e-5) and on_bound > 0.09
    assert result.estimates["I"].value == pytest.approx(2 * on_bound, rel=1e-5)
    assert result.remarks == (
        "the inertias are at their bound I <= 2 J; beyond it the log would be predicted better",
    )
    alone = identify(beyond, free, ["I"], {"J": 0.08}, False)
    assert alone.estimates["I"].value == pytest.approx(0.16, rel=1e-9) and alone.remarks == result.remarks
    result = identify(within, free, ["I", "J"], {}, False)
    assert not result.remarks and all(
        abs(result.estimates[k].value - v) < 0.002 for k, v in (("I", 0.12), ("J", 0.08))
    )


def rollers() -> Mechanism:
    """A thin disk that carries a second body: I about the first's axle,
    J about diameters and of the second, which has K too."""
    robot = Mechanism("rollers", "")
    pairs = (("x", "m"), ("y", "m"), ("phi", "rad"), ("theta", "rad"), ("psi", "rad"))
    x, y, phi, theta, psi = (robot.coordinate(name, unit) for name, unit in pairs)
    I, J, K = (  # noqa: E741
        robot.parameter(name, value, "kg m^2") for name, value in (("I", 0.12), ("J", 0.08), ("K", 0.06))
    )
    robot.principal_inertias(I, J, J)
    robot.principal_inertias(J, K, K)
    x_dot, y_dot, turning, rolling, spinning = (robot.rate(each) for each in (x, y, phi, theta, psi))
    energy = x_dot**2 + y_dot**2 + (J * turning**2 + I * rolling**2 + K * spinning**2) / 2
    robot.kinetic_energy(energy)
    robot.rolls("rolls", ca.cos(phi) * x_dot + ca.sin(phi) * y_dot - 0.3 * rolling)
    robot.rolls("no side slip", ca.cos(phi) * y_dot - ca.sin(phi) * x_dot)
    for name, rate in (("thetadot", rolling), ("phidot", turning), ("psidot", spinning)):
        robot.input(f"tau_{name}", "N m", on=rate)
        robot.quasi_velocity(name, "rad/s", rate)
    robot.moves_in_plane(x, y, phi)
    return robot


@pytest.mark.parametrize(
    ("inertias", "bounds"),
    [((0.4, 0.1, 0.02), 2), ((0.1, 0.3, 0.02), 1), ((0.3, 0.1, 0.09), 1), ((0.12, 0.08, 0.06), 0)],
)
def test_two_bodies_that_share_an_inertia(inertias, bounds):
    """Torques of three frequencies at inertias of no bodies: the answer is feasible,
    and the least squares that SLSQP finds."""
    t, random = np.arange(400) * 0.01, np.random.default_rng(7)
    added, frequency = np.array([2 * 0.3**2, 0.0, 0.0]), np.array([3.0, 2.0, 4.0])
    tau = 0.5 * np.cos(np.outer(t, frequency))
    ideal = 0.5 * np.sin(np.outer(t, frequency)) / frequency  # of an inertia of 1 kg m^2
    nu = ideal / (np.array(inertias) + added) + 0.001 * random.normal(size=tau.shape)
    log = Log(t, np.hstack([np.zeros((400, 5)), nu]), tau, (range(400),), ())
    dynamics = Dynamics.of(reduce(rollers()))
    fit = predicted(log, dynamics, ["I", "J", "K"], np.array([q.default for q in dynamics.quantities]), False)
    fit.fit()._converge()  # with the weights that follow from the fit
    I, J, K = found = np.array([fit.value(name) for name in ("I", "J", "K")])  # noqa: E741
    assert I <= 2 * J * (1 + 1e-8) and J <= 2 * K * (1 + 1e-8)
    assert len(fit.held) == bounds

    def cost(inertias: np.ndarray) -> float:
        values = fit.values.copy()
        values[[fit.places[name] for name in ("I", "J", "K")]] = inertias
        return float(np.log(np.sum(fit._tried(values)[1] ** 2)))

    feasible = {"type": "ineq", "fun": lambda v: np.array([2 * v[1] - v[0], 2 * v[2] - v[1]])}
    other = minimize(
        cost,
        [0.12, 0.08, 0.06],
        method="SLSQP",
        bounds=[(0.01, 1)] * 3,
        constraints=feasible,
        options={"ftol": 1e-9},
    )
    assert cost(found) <= other.fun + 1e-6 and np.allclose(found, other.x, rtol=0.01, atol=0)


def test_bounded_least_squares():
    """Over random quadratics with up to six bounds: feasible, and not worse than what SLSQP finds."""
    random, bounded = np.random.default_rng(11), 0
    for _ in range(300):
        n, m = random.integers(2, 6), random.integers(1, 7)
        A, b, G = random.normal(size=(n + 3, n)), random.normal(size=n + 3), random.normal(size=(m, n))
        G /= np.linalg.norm(G, axis=1)[:, None]
        h = G @ random.normal(size=n) - random.uniform(0, 1, m)
        s, held = bounded_least_squares(A, b, G, h)
        other = minimize(
            lambda s, A=A, b=b: float(np.sum((A @ s - b) ** 2)),
            s,
            jac=lambda s, A=A, b=b: 2 * A.T @ (A @ s - b),
            method="SLSQP",
            constraints={"type": "ineq", "fun": lambda s, G=G, h=h: G @ s - h, "jac": lambda s, G=G: G},
            options={"ftol": 1e-14},
        )
        assert (G @ s >= h - 1e-9).all() and np.allclose(s, other.x, rtol=0, atol=1e-6)
        assert np.abs((G @ s - h)[held]).max(initial=0.0) < 1e-9
        bounded += held.sum() > 1
    assert bounded > 50
    with pytest.raises(BadInput, match="leave none"):
        bounded_least_squares(np.eye(1), np.zeros(1), np.array([[1.0], [-1.0]]), np.array([0.5, -0.2]))


def test_inertias_of_no_body_are_refused(write, bad_input):
    robot = Mechanism("none", "")
    one, two = robot.parameter("one", 1.0, "kg m^2"), robot.parameter("two", 2.5, "kg m^2")
    for inertias, message in (
        ((one, one, two), "no body has the principal inertias one = 1, one = 1, two = 2.5"),
        ((one, two), "requires three parameters"),
        ((one, two, 2 * one), "requires three parameters"),
    ):
        with pytest.raises(ModelError, match=message):
            robot.principal_inertias(*inertias)
    rows, head = np.zeros((200, 5)).tolist(), ["t", "thetadot", "phidot", "tau_theta", "tau_phi"]
    said = bad_input(
        ["identify", write(rows, head), "--robot", "rolling_disk", "--fit", "m", "--set", "I=0.5"]
    )
    assert "no body has the inertias I = 0.5, J = 0.08: I <= 2 J must hold" in said


def test_rows_that_are_left_out_are_told(write):
    rows = table().tolist()
    rows[100][0] = rows[101][6] = ""
    rows.insert(200, rows[199])
    del rows[400:450]
    log = read_log(write(rows), DYNAMICS, {})
    assert [remark.split(",")[0].split(" are")[0] for remark in log.remarks] == [
        "2 rows with an empty or non-finite entry",
        "1 repeated rows",
        "2 gaps in t",
    ]
    assert len(log.stretches) == 3 and sum(map(len, log.stretches)) == len(log.t) == len(rows) - 3
    result = identify(log, DYNAMICS, ["m_c"], VALUES | {"I_c": 11.0}, True)
    assert result.estimates["m_c"].value == pytest.approx(47.0, rel=1e-8)


def test_columns_by_other_names_and_those_that_are_not_needed(write):
    keep = [0, 6, 7, 8, 9]
    file = write(table()[:, keep].tolist(), ["time", *np.array(columns())[keep][1:]])
    log = read_log(file, DYNAMICS, {"t": "time"})
    assert np.array_equal(log.t, run().t) and np.array_equal(log.inputs, run().tau) and not log.x[:, :5].any()


def bad(change):
    rows = table().tolist()
    return change(rows) or rows


def swapped(rows):
    rows[50], rows[60] = rows[60], rows[50]


def still(rows):
    return [[row[0], *table()[0, 1:8], *row[8:]] for row in rows]


BAD = {
    "few": (lambda rows: rows[: FEWEST - 1], [], "usable rows are too few"),
    "short": (lambda rows: rows[:100], [], "stretches of 25 rows"),
    "order": (swapped, [], "times must increase"),
    "text": (
        lambda rows: [*rows[:5], ["x", *rows[5][1:]], *rows[6:]],
        [],
        "column 't' row 7: 'x' is not a number",
    ),
    "ragged": (lambda rows: [*rows[:5], rows[5][:-1]], [], "row 7: 9 entries"),
    "still": (still, [], "do not change"),
    "parameter": (None, ["--fit", "m_d"], "not a parameter of this robot; did you mean"),
    "twice": (None, ["--fit", "m_c", "m_c"], "given twice"),
    "map": (None, ["--fit", "m_c", "--map", "tau_x=a"], "--map tau_x: not a quantity"),
    "column": (None, ["--fit", "m_c", "--map", "tau_r=torque"], "column 'torque' is missing"),
    "set": (None, ["--fit", "m_c", "--set", "r=wide"], "'wide' is not a number"),
    "sign": (None, ["--fit", "m_c", "--set", "r=-1"], "must be positive"),
    "nan": (None, ["--fit", "m_c", "--set", "m_w=nan"], "--set m_w = nan is not finite"),
    "ratio": (
        None,
        ["--fit", "m_c", "--set", "gear=0", "--set", "efficiency=-1"],
        "--set: efficiency = -1 must be positive",
    ),
    "unlike": (None, ["--fit", "zzz"], "moving, bias_gyro"),
    "no pair": (None, ["--fit", "m_c", "--set", "r"], "give NAME=VALUE"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input(case, write, bad_input):
    change, options, message = BAD[case]
    rows = bad(change) if change else table().tolist()
    file = write(rows)
    assert message in bad_input(["identify", file, "--robot", "labmate", *(options or ["--fit", "m_c"])])


def test_bad_files(tmp_path, bad_input):
    for name, content, message in (
        ("a.csv", b"", "is empty"),
        ("b.csv", b"\xff\xfe\x00", "not a text file"),
        ("c.csv", b"t,t\n1,2\n", "two columns are called 't'"),
        ("d.parquet", b"PAR1", "not a Parquet file"),
    ):
        (tmp_path / name).write_bytes(content)
        assert message in bad_input(["identify", str(tmp_path / name), "--robot", "labmate", "--fit", "m_c"])
    assert "No such file" in bad_input(
        ["identify", str(tmp_path / "none.csv"), "--robot", "labmate", "--fit", "m_c"]
    )


@pytest.mark.parametrize(("name", "mark"), [("a.csv", ";"), ("b.csv", "\t"), ("c.csv", ",")])
def test_what_separates_names_separates_entries(name, mark, tmp_path, bad_input):
    """Commas, semicolons and tabs; decimal commas, which a program for tables may write, are read."""
    lines = ["# a log", "t;tau_r;x", "0.0;1.5;-2e-3", "0.1;1.6;"]
    (tmp_path / name).write_text("\n".join(lines).replace(";", mark))
    columns = read_table(tmp_path / name)
    assert {key: column.numbers().tolist()[:1] for key, column in columns.items()} == {
        "t": [0.0],
        "tau_r": [1.5],
        "x": [-0.002],
    }
    assert np.isnan(columns["x"].numbers()[1])
    if mark == ",":
        return
    (tmp_path / name).write_text("\n".join(lines).replace(".", ",").replace(";", mark))
    assert {key: column.numbers().tolist()[:1] for key, column in read_table(tmp_path / name).items()} == {
        "t": [0.0],
        "tau_r": [1.5],
        "x": [-0.002],
    }


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "ms"), (1e6, "us"), (1e9, "ns"), (1.0, "")])
def test_times_in_another_unit_are_noticed(factor, unit):
    """Rows every 10 ms or 0.5 s whose times are not in s: it is said, with the unit that they may be in."""
    for step in (0.01, 0.5):
        rows = np.column_stack([factor * step * np.arange(30), np.zeros(30)])
        remarks = _cleaned("log.csv", rows, 2, 2)[2]
        assert len(remarks) == bool(unit) and (not unit or f"--map 't=t [{unit}]'" in remarks[0])


# -- logs of the physics engine ------------------------------------------------------------------------------


HEAVY = {"m_c": 60.0, "m_w": 2.0}  # twice what the controller believes, as in figure 9
FIGURE_9 = Path(noslip.__file__).parent / "examples/specs/figures/figure_9b.toml"


def eight(speed: float) -> Run:
    """The heavy robot on an eight, on a floor in the engine."""
    arcs = [{"kind": "arc", "from": [0.0, 0.0], "heading": 0.0, "radius": 1.2, "angle": 6.28}]
    arcs.append({"kind": "arc", "radius": 1.2, "angle": -6.28})
    path = {"output": {"type": "IV", "L": 0.1, "path": {"kind": "composite", "segments": arcs}}}
    start = {"initial": {"point": [0.0, 0.0], "heading": 0.0, "speed": 0.0}}
    floor = {"plant": HEAVY, "reference": {"speed": speed}, "contact": {"mu": 0.7}, "floor": {"mu": 0.7}}
    time = {"duration": round(13.0 / speed, 2), "period": 0.01, "output_step": 0.01}
    return simulate(
        spec_of_table({**SPEC, **path, **start, **floor, "simulation": time}, Path("none.toml")),
        engine="mujoco",
    )


@pytest.mark.nightly
def test_figure_9_with_numbers_from_the_engine():
    """Torques of another run, by inverse dynamics, within 5 %;
    the offset of 8.7 cm on the circle falls below 5 mm."""
    pytest.importorskip("mujoco")
    run, other = eight(1.2), eight(0.9)
    rows = len(run.t) - 1
    nu = run.nu[:rows] + NOISE * np.random.default_rng(9).normal(size=(rows, 2))
    log = Log(run.t[:rows], np.hstack([run.q[:rows], nu]), run.tau[:rows], (range(rows),), ())
    fitted = {
        name: e.value
        for name, e in identify(log, DYNAMICS, ["m_c", "I_c", "m_w"], VALUES, True).estimates.items()
    }
    nudot, p = ca.SX.sym("nudot", 2), SYSTEM.mechanism.p
    inverse = ca.solve(SYSTEM.input_map, SYSTEM.Mbar @ nudot + SYSTEM.bias)
    torque = ca.Function("torque", [ca.vertcat(*[q.symbol for q in SYSTEM.state]), nudot, p], [inverse])

    def off(numbers: dict[str, float]) -> float:
        """RMS error of the torques of the other run, relative to their RMS."""
        middle, rates = (
            (other.x[1:] + other.x[:-1]) / 2,
            np.diff(other.nu, axis=0) / np.diff(other.t)[:, None],
        )
        values = [(VALUES | numbers)[q.name] for q in SYSTEM.mechanism.parameters]
        predicted = np.array(
            [torque(x, rate, values).full().ravel() for x, rate in zip(middle, rates, strict=True)]
        )[:-1]
        return float(np.sqrt(np.mean((predicted - other.tau[:-2]) ** 2) / np.mean(other.tau[:-2] ** 2)))

    def offset(numbers: dict[str, float]) -> float:
        return abs(
            simulate(read_varied(FIGURE_9, {"parameters": {"r": 0.15, **numbers}, "plant": HEAVY})).error[
                -1, 0
            ]
        )

    found = off(fitted), off({}), offset(fitted), offset({})
    print(fitted, found)
    assert (
        found[0] < 0.05 < 0.3 < found[1] and found[2] < 0.005 and found[3] == pytest.approx(0.087, abs=0.001)
    )
