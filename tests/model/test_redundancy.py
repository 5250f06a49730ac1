"""More inputs than degrees of freedom: the jointed platform with four driven wheels,
and how weights and wishes share torques."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from noslip.analysis.answers import analyse
from noslip.checks.verification.sampling import random_plants
from noslip.model import Mechanism, ModelError, reduce
from noslip.model.law import symbols
from noslip.model.robots import ROBOTS
from noslip.model.robots.four_wheel import four_wheel
from noslip.model.rolling.kinematics import kinematics
from noslip.readers.robots import law_of, system_of
from noslip.simulation.closed_loop import simulate
from noslip.simulation.contact import contact_forces
from noslip.simulation.controllers.compiled import CompiledController
from noslip.simulation.controllers.controller import Limits
from noslip.simulation.controllers.symbolic import CasadiController
from noslip.simulation.plant import Plant
from noslip.simulation.specification.spec import ContactSection, read_spec
from noslip.tests.reference.independent import Description, Motion
from scipy.integrate import solve_ivp

ROOT = Path(__file__).parents[2]
WHEELS = "fr fl rr rl".split()
STATES = 25


@cache
def robot() -> Mechanism:
    return ROBOTS["four_wheel"]()


def names(quantities) -> list[str]:
    return [quantity.name for quantity in quantities]


def parameters(**given: float) -> np.ndarray:
    return np.array(robot().parameter_values(given))


def drawn(count: int = STATES, **given: float):
    """Random q, nu, tau, u and parameters, those given excepted."""
    random = np.random.default_rng(12)
    for _ in range(count):
        p = {q.name: random.uniform(0.5, 2.0) * q.default for q in robot().parameters}
        p |= (
            {f"w_{at}": 10 ** random.uniform(-1, 1) for at in WHEELS}
            | {"squeeze": random.uniform(-20, 20)}
            | given
        )
        q, nu, tau, u = (
            random.uniform(-size, size, n) for size, n in ((1.2, 8), (2.0, 2), (10.0, 4), (3.0, 2))
        )
        yield q, nu, tau, u, parameters(**p)


def close(value, expected, tolerance: float) -> bool:
    """To `tolerance` of the largest entry expected."""
    return bool(np.abs(np.ravel(value) - np.ravel(expected)).max() <= tolerance * np.abs(expected).max())


# -- the platform --------------------------------------------------------------------------------------------


@cache
def textbook() -> Motion:
    """The platform from bodies, frames and points, by Lagrange's equations with multipliers."""
    sizes = "b l_f l_r r m_f m_r I_f I_r I_w"
    d = Description("x y phi gamma theta_fr theta_fl theta_rr theta_rl", "tau_fr tau_fl tau_rr tau_rl", sizes)
    (x, y, phi, gamma, *angles), (b, l_f, l_r, r, m_f, m_r, I_f, I_r, I_w) = d.q, d.parameters
    N, F = d.N, d.N.orientnew("F", "Axis", (phi, d.N.z))
    R = F.orientnew("R", "Axis", (-gamma, F.z))
    front = d.point("front", d.O, x * N.x + y * N.y)
    rear = d.point("rear", d.point("joint", front, -l_f * F.x), -l_r * R.x)
    for name, centre, frame, mass, inertia in (("front", front, F, m_f, I_f), ("rear", rear, R, m_r, I_r)):
        d.body(name, centre, frame, mass, (0, 0, inertia))
        d.contact(centre.vel(N), frame.y)
    places = (front, F, -b), (front, F, b), (rear, R, -b), (rear, R, b)
    for name, (axle, frame, left), angle, tau in zip(WHEELS, places, angles, d.inputs, strict=True):
        wheel = frame.orientnew(name, "Axis", (angle, frame.y))
        hub = d.point(f"hub_{name}", axle, left * frame.y)
        d.body(name, hub, wheel, 0, (0, I_w, 0))
        d.contact(hub.vel(N) + wheel.ang_vel_in(N).cross(-r * N.z), frame.x)
        d.loads += [(wheel, tau * frame.y), (frame, -tau * frame.y)]
    return d.lagrange()


@cache
def reduced() -> ca.Function:
    """From q, nu, tau, p: qdot, qddot, Mbar, energy, its rate."""
    system, tau = system_of(robot()), ca.SX.sym("tau", 4)
    q, qdot = robot().q, robot().qdot
    qddot = system.S @ system.acceleration(tau) + system.Sdot @ system.nu
    rate = ca.jtimes(robot().energy(), ca.vertcat(q, qdot), ca.vertcat(qdot, qddot))
    energies = [ca.substitute(e, qdot, system.qdot) for e in (robot().energy(), rate)]
    answers = [ca.densify(answer) for answer in (system.qdot, qddot, system.Mbar, *energies)]
    return ca.Function("reduced", [q, system.nu, tau, robot().p], answers)


def test_accelerations_are_those_of_lagrange():
    """qddot of all coordinates; what touches does not move; power in is the rate of energy,
    by either derivation."""
    other = textbook()
    assert list(other.coordinates) == names(robot().coordinates) and list(other.inputs) == names(
        robot().inputs
    )
    assert list(other.parameters) == names(robot().parameters)[: len(other.parameters)]
    for q, nu, tau, _, p in drawn():
        qdot, qddot, Mbar, energy, rate = (value.full() for value in reduced()(q, nu, tau, p))
        qdot, p = qdot[:, 0], p[: len(other.parameters)]
        assert close(qddot, other.acceleration(q, qdot, tau, p), 1e-10)
        assert np.abs(other.slip(q, qdot, tau, p)).max() < 1e-12 * np.abs(qdot).max()
        assert close(Mbar, Mbar.T, 1e-13) and np.linalg.eigvalsh(Mbar).min() > 0
        power, size = tau @ qdot[4:], np.abs(tau * qdot[4:]).sum()
        assert (
            abs(rate.item() - power) < 1e-11 * size
            and abs(float(other.power(q, qdot, tau, p)) - power) < 1e-11 * size
        )
        assert abs(energy.item() - float(other.energy(q, qdot, tau, p))) < 1e-11 * energy.item()


def test_energy_is_conserved_without_torques():
    q, nu, _, _, p = next(drawn(1))
    zero = np.zeros(4)
    rate = Plant(system_of(robot()), p).rate
    solution = solve_ivp(lambda _, x: rate(x, zero), (0.0, 3.0), [*q, *nu], "DOP853", rtol=1e-12, atol=1e-13)
    energies = [reduced()(x[:8], x[8:], zero, p)[3].full().item() for x in solution.y.T]
    assert solution.success and np.ptp(solution.y[3]) > 0.1 and np.ptp(energies) < 1e-10 * energies[0]


@pytest.mark.nightly
def test_what_the_joint_is_for():
    """With it six directions are reached (five where l_f = l_r: front and rear then turn alike);
    without it one: straight on."""
    jointed, rigid = analyse(robot()).constraints.json, analyse(four_wheel(0)).constraints.json
    assert jointed["growth"] == [2, 3, 5, 6] and len(jointed["integrals"]) == 2
    equal = [place["growth"] for place in jointed["singular_places"] if place["condition"] == "l_f - l_r"]
    assert [max(growth) for growth in equal] == [5]
    assert (
        rigid["growth"] == [1] and len(rigid["integrals"]) == rigid["holonomic"] == rigid["constraints"] == 6
    )
    assert {"phi = const", "y*cos(phi) - x*sin(phi) = const"} <= set(rigid["integrals"])
    with pytest.raises(ModelError, match="2 outputs for n - m = 1"):
        law_of(four_wheel(0), "type_i")
    with pytest.raises(ModelError, match="give 1, or 0"):
        four_wheel(2)


@pytest.mark.parametrize("joints", [1, 0])
def test_a_constraint_that_follows_from_others_is_refused_by_name(joints):
    """Side slip wheel by wheel: both wheels of an axle say the same. Without a joint that makes 7 in 7
    coordinates."""
    vehicle = four_wheel(joints)
    phi, x, y = vehicle["phi"], vehicle["x"], vehicle["y"]
    vehicle.rolls(
        "no side slip of the front left wheel", ca.cos(phi) * vehicle.rate(y) - ca.sin(phi) * vehicle.rate(x)
    )
    message = "not independent: 'no side slip of the front left wheel' follows from the others; remove it"
    for ask in (reduce, kinematics) if joints == 0 else (reduce,):
        with pytest.raises(ModelError, match=message):
            ask(vehicle)


# -- how torques are shared ----------------------------------------------------------------------------------


@cache
def sharing(mechanism: Mechanism) -> ca.Function:
    """From q, nu, u, p: S'E, what it must give (12), torques, weights, preferred torques, nudot, lambda."""
    system, u = system_of(mechanism), ca.SX.sym("u", system_of(mechanism).dof)
    tau = system.first_feedback(u)
    nudot = system.acceleration(tau)
    preferred = ca.substitute(mechanism.preferred, mechanism.qdot, system.qdot)
    answers = [system.input_map, system.Mbar @ u + system.bias, tau, mechanism.weights, preferred, nudot]
    answers += [system.constraint_forces(tau, nudot)]
    return ca.Function(
        "sharing", [mechanism.q, system.nu, u, mechanism.p], [ca.densify(answer) for answer in answers]
    )


def skater() -> Mechanism:
    """Three pushes for two motions; the preferred value of one depends on coordinates and rates,
    one weight is a number."""
    blade = ROBOTS["knife_edge"]()
    w = blade.parameter("w", 0.4, "1")
    forward = ca.cos(blade["phi"]) * blade.rate(blade["x"]) + ca.sin(blade["phi"]) * blade.rate(blade["y"])
    oblique = forward + (0.3 + 0.1 * ca.sin(blade["x"])) * blade.rate(blade["phi"])
    blade.input(
        "oar",
        "N",
        on=oblique,
        weight=w * blade["m"] + w,
        preferred=2.0 - blade["m"] * forward**3 + blade["y"],
    )
    return blade


@pytest.mark.parametrize("which", ["four_wheel", "skater"])
def test_the_torques_are_those_nearest_to_the_wanted_ones(which):
    """(12) to 1e-12; against NumPy: least squares of W^(1/2) (tau - preferred) under (12),
    and the multipliers' conditions."""
    mechanism = robot() if which == "four_wheel" else skater()
    random, count = np.random.default_rng(5), len(mechanism.inputs)
    for _ in range(STATES):
        p = [random.uniform(0.3, 3.0) * (q.default or 10.0) for q in mechanism.parameters]
        sizes = mechanism.q.numel(), 2, 2
        B, effort, tau, weights, preferred, nudot, _ = (
            value.full()
            for value in sharing(mechanism)(*[random.uniform(-1.2, 1.2, size) for size in sizes], p)
        )
        assert np.abs(B @ tau - effort).max() <= 1e-12 * (np.abs(B) @ np.abs(tau)).max()
        half = 1 / np.sqrt(weights)
        nearest = preferred + half * np.linalg.lstsq(B * half.T, effort - B @ preferred, rcond=None)[0]
        assert close(tau, nearest, 1e-11)
        KKT = np.block([[np.diag(weights[:, 0]), B.T], [B, np.zeros((2, 2))]])
        assert close(tau, np.linalg.solve(KKT, np.vstack([weights * preferred, effort]))[:count], 1e-11)
        assert np.abs(np.linalg.svd(B)[2][2:] @ tau).max() > 1e-3  # so that other torques would do too


def test_a_wish_changes_the_constraint_forces_and_not_the_motion():
    """squeeze: nudot stays u to rounding, no power goes in,
    lambda changes as the ground's and the joint's forces must."""
    for q, nu, _, u, p in drawn(squeeze=0.0):
        wished = parameters(**dict(zip(names(robot().parameters), p, strict=True)) | {"squeeze": 15.0})
        (B, _, tau, *_, nudot, lam), (_, _, other, *_, same, shaped) = (
            [value.full() for value in sharing(robot())(q, nu, u, values)] for values in (p, wished)
        )
        assert close(nudot, u, 1e-11) and close(same, u, 1e-11)
        change, rates = other - tau, reduced()(q, nu, tau, p)[0].full()[4:]
        assert np.abs(change).max() > 1.0 and np.abs(shaped - lam).max() > 1.0
        assert np.abs(B @ change).max() < 1e-12 * np.abs(B).max() * 15 * 4
        assert abs(change.T @ rates).item() < 1e-12 * 15 * 4 * np.abs(rates).max()


def test_the_closed_loop_moves_the_same_whatever_is_wanted():
    spec = read_spec(ROOT / "examples/specs" / "robots" / "four_wheel.toml")
    quick = replace(spec.simulation, backend="casadi", tolerance=1e-9, duration=3.0, output_step=0.5)
    shares = {}, {"squeeze": 12.0}, {"w_fr": 30.0}
    runs = [
        simulate(replace(spec, simulation=quick, parameters=spec.parameters | share), "casadi")
        for share in shares
    ]
    forces = [run.plant.constraint_forces(run.x, run.tau) for run in runs]
    for run, lam in zip(runs[1:], forces[1:], strict=True):
        assert np.abs(run.x - runs[0].x).max() < 1e-6 and np.abs(lam - forces[0]).max() > 10.0


def test_the_shipped_run_comes_to_its_circle():
    spec = read_spec(ROOT / "examples/specs" / "robots" / "four_wheel.toml")
    run = simulate(
        replace(spec, simulation=replace(spec.simulation, tolerance=1e-6, output_step=0.5)), "casadi"
    )
    off = np.abs(run.error)
    assert (
        run.stopped is None
        and run.t[-1] == spec.simulation.duration
        and np.all(off[-1] < 1e-3 * off.max(axis=0))
    )


# -- the C ---------------------------------------------------------------------------------------------------

LAWS = "type_i", "type_iv_circle"
ERROR = {"double": 1e-10, "float": 2e-4}  # of the largest entry of each quantity
each_scalar = pytest.mark.parametrize("scalar", ["double", "float"])


@cache
def plants(name: str):
    return list(random_plants(law_of(robot(), name), 40, seed=3))


@each_scalar
@pytest.mark.parametrize("name", LAWS)
def test_c_is_the_model(name, scalar):
    """All quantities at random states, weights and wishes; four torques for two outputs."""
    law, compared = law_of(robot(), name), 0
    for plant in plants(name):
        controller = CompiledController(law, plant.params, plant.config, plant.gains, scalar)
        for point in plant.points:
            evaluation = controller.evaluate(point.state, point.reference)
            assert evaluation.status == "ok" and len(evaluation.values["tau"]) == 4
            for quantity, value in evaluation.values.items():
                truth = point.truth.values[quantity]
                assert np.abs(value - truth).max() <= ERROR[scalar] * np.abs(truth).max(), quantity
            status, tau = controller.step(point.state, point.reference)
            assert np.abs(tau - evaluation.values["tau"]).max() <= ERROR[scalar] * np.abs(tau).max()
            compared += status == "ok"
    assert compared == 40


@each_scalar
def test_the_speed_gives_way_within_the_limits_of_four_wheels(scalar):
    """on_limit slow: C as the model, and, where neither says more,
    the distance still gets the acceleration it is to have."""
    law, kept = law_of(robot(), "type_iv_circle"), 0
    linearization, tau, point = law.linearization, ca.SX.sym("tau", 4), [q.symbol for q in law.config]
    distance = (linearization.Phi @ law.system.acceleration(tau) + linearization.drift)[0]
    second = ca.Function(
        "second", [symbols(law.state), tau, symbols(law.parameters), ca.vertcat(*point)], [distance]
    )
    for plant in plants("type_iv_circle"):
        for point in plant.points:
            largest = np.abs(point.truth.values["tau"]).max()
            for share in (0.97, 0.5):
                limits = Limits(tuple([share * largest] * 4), "slow")
                status, truth = CasadiController(
                    law, plant.params, plant.config, plant.gains, limits=limits
                ).step(point.state, point.reference)
                other, answer = CompiledController(
                    law, plant.params, plant.config, plant.gains, scalar, limits=limits
                ).step(point.state, point.reference)
                assert other == status == "saturated"
                assert np.abs(answer).max() <= share * largest * (1 + 1e-6)
                assert np.abs(answer - truth).max() <= {"double": 1e-9, "float": 5e-3}[scalar] * largest
            unlimited, reached = (
                float(second(point.state, values, plant.params, plant.config))
                for values in (point.truth.values["tau"], truth)
            )
            kept += abs(unlimited - reached) < 1e-6 * max(1.0, abs(unlimited))
    assert kept >= 5


@each_scalar
def test_c_refuses_a_weight_that_is_none(scalar):
    law = law_of(robot(), "type_i")
    config, gains = ([q.default for q in law.groups[group]] for group in ("config", "gains"))
    for weight in (0.0, -1.0, np.nan, np.inf):
        values = np.where(np.array(names(law.parameters)) == "w_rl", weight, parameters())
        controller = CompiledController(law, values, config, gains, scalar)
        status, tau = controller.step(np.zeros(10), np.zeros(len(law.reference)))
        assert status == controller.refused == "bad_parameter" and not tau.any()


# -- what a user may write -----------------------------------------------------------------------------------

REFUSED = {
    "zero": (dict(weight=0.0), "'oar': weight 0 must be a positive number"),
    "negative": (dict(weight=-2.0), "must be a positive number"),
    "not a number": (dict(weight=np.nan), "weight: contains nan, which is not a finite number"),
    "no limit": (dict(weight=np.inf), "weight: contains inf, which is not a finite number"),
    "no expression": (dict(weight="much"), "weight is not an expression"),
    "no scalar": (dict(weight=ca.SX.ones(2)), "weight must be a scalar"),
    "nothing wanted": (dict(preferred=np.nan), "preferred: contains nan, which is not a finite number"),
    "both names": (
        dict(preferred=1.0, wanted=2.0),
        "`preferred` or, as in older versions, `wanted`, not both",
    ),
    "a stranger": (dict(preferred=ca.SX.sym("stranger")), "uses stranger"),
    "a strange weight": (dict(weight=ca.SX.sym("stranger")), "uses stranger"),
}


@pytest.mark.parametrize("why", REFUSED)
def test_a_wrong_weight_or_wish_is_refused(why):
    more, message = REFUSED[why]
    mechanism = ROBOTS["knife_edge"]()
    with pytest.raises(ModelError, match=message):
        mechanism.input("oar", "N", on=mechanism.rate(mechanism["x"]), **more)
        reduce(mechanism)


def test_the_former_name_of_a_preferred_input_is_accepted():
    robots = [ROBOTS["knife_edge"]() for _ in range(2)]
    for mechanism, name in zip(robots, ("preferred", "wanted"), strict=True):
        mechanism.input("oar", "N", on=mechanism.rate(mechanism["x"]), **{name: 2.0 * mechanism["m"] + 1.0})
        assert ca.Function("tau_0", [mechanism["m"]], [mechanism.preferred[-1]])(3.0) == 7.0


def test_a_weight_must_stay_positive_and_fixed():
    mechanism = ROBOTS["knife_edge"]()
    with pytest.raises(ModelError, match="expression in parameters"):
        mechanism.input("oar", "N", on=mechanism.rate(mechanism["x"]), weight=mechanism["x"])
    mechanism.input("oar", "N", on=mechanism.rate(mechanism["phi"]), weight=mechanism["m"] - 50.0)
    with pytest.raises(ModelError, match="'oar': its weight is not positive"):
        reduce(mechanism)


# -- what docs/redundant.md says -----------------------------------------------------------------------------


def table() -> list[tuple[dict[str, float], list[float]]]:
    """Parameters of each row of the page's table, and its numbers."""
    rows = []
    for line in (ROOT / "docs" / "redundant.md").read_text().splitlines():
        cells = [cell.strip() for cell in line.split("|")[1:-1]]
        if cells and re.fullmatch(r"-?\d[\d.]*", cells[1]):
            settings = dict(re.findall(r"`(\w+) = ([-\d.]+)`", cells[0]))
            rows.append(
                (
                    {name: float(value) for name, value in settings.items()},
                    [float(cell) for cell in cells[1:]],
                )
            )
    return rows


def described(**given: float) -> list[float]:
    """Torques of the wheels, side forces of the axles, friction used by the wheels,
    at the state of the page."""
    q, nu, u, p = [0, 0, 0, 0.5, 0, 0, 0, 0], [1.0, 0.4], [1.5, 0.0], parameters(**given)
    tau = sharing(robot())(q, nu, u, p)[2].full().T
    fr, fl, rr, rl = contacts = contact_forces(
        Plant(system_of(robot()), p), np.array([[*q, *nu]]), tau, ContactSection()
    )
    return [
        *tau[0],
        fr.lateral[0] + fl.lateral[0],
        rr.lateral[0] + rl.lateral[0],
        *(c.use[0] for c in contacts),
    ]


def test_the_page_says_what_is_computed():
    rows = table()
    assert rows[0][0] == {} and len(rows) == 5
    for settings, numbers in rows:
        difference = np.abs(np.array(numbers) - described(**settings))
        assert difference[:6].max() < 0.0501 and difference[6:].max() < 0.00501


def test_weights_of_one_over_the_load_use_all_wheels_alike():
    """Straight on the least sum of tau^2 / load needs the same friction of every wheel: exactly,
    wheels without inertia."""
    p = parameters(
        **{f"w_{at}": 1 / load for at, load in zip(WHEELS, (60, 60, 30, 30), strict=True)}, I_w=0.0
    )
    state = np.zeros(10)
    tau = sharing(robot())(state[:8], state[8:], [2.0, 0.0], p)[2].full().T
    uses = [
        c.use[0] for c in contact_forces(Plant(system_of(robot()), p), state[None, :], tau, ContactSection())
    ]
    assert np.ptp(uses) < 1e-12 and abs(uses[0] - 2.0 / (0.7 * 9.81)) < 1e-12
