"""Laws of partial feedback linearization: against equations by hand, in closed loops, what is refused,
and what must be found."""

import dataclasses
import math
from functools import cache
from pathlib import Path

import casadi as ca
import noslip
import numpy as np
import pytest
from noslip.analysis.answers import analyse, as_json
from noslip.analysis.text import as_text
from noslip.checks.verification.generate import generate
from noslip.checks.verification.verify import differences
from noslip.cli.main import main
from noslip.codegen.files import robot_files
from noslip.model import Mechanism, ModelError, linearize, reduce
from noslip.model.law import ControlLaw
from noslip.model.mechanism import values_of
from noslip.model.outputs import OutputMap, OutputRow
from noslip.model.underactuated import partial_linearization
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_laws, find_robot, law_of, system_of
from noslip.simulation.closed_loop import simulate
from noslip.simulation.controllers.backends import make_controller
from noslip.simulation.controllers.balance.steady import analyse_at_rest
from noslip.simulation.controllers.balance.zero_dynamics import of_outputs
from noslip.simulation.plot import draw
from noslip.simulation.run import Run
from noslip.simulation.specification.spec import Spec, read_spec
from noslip.simulation.specification.vary import read_varied, spec_of_table
from noslip.simulation.sweeping.batch import Batch
from scipy.integrate import solve_ivp

SPECS = Path(noslip.__file__).parent / "examples/specs" / "robots"
OF = {"balancer": ("wheels", "speeds", "upright", "drive"), "sleigh": ("heading",), "snakeboard": ("shape",)}
OF |= {"roller_racer": ("handlebar", "speeds")}
EACH = [(robot, name) for robot, names in OF.items() for name in names]
each_law = pytest.mark.parametrize(("robot", "name"), EACH)


def law(robot: str, name: str) -> ControlLaw:
    return law_of(find_robot(robot), name)


def values(robot: str) -> dict[str, float]:
    return {p.name: p.default for p in find_robot(robot).parameters}


def spec_of(robot: str, name: str, position, q, nu=None, **changes) -> Spec:
    """A continuous run by CasADi, at a small tolerance."""
    table = {
        "robot": robot,
        "output": {"type": name},
        "reference": {"position": list(position)},
        "initial": {"q": list(q)} | ({} if nu is None else {"nu": list(nu)}),
        "simulation": {"duration": 1.0, "backend": "casadi", "tolerance": 1e-12, "output_step": 0.05},
    }
    for where, change in changes.items():
        table[where] = {**table.get(where, {}), **change}
    return spec_of_table(table, SPECS / "x.toml")


# -- the law, derived by hand --------------------------------------------------------------------------------


def by_hand_balancer(v, q, nu, name: str, wanted) -> np.ndarray:
    """Newton forward, Euler about the axle and the vertical (as in test_underactuated), with both outputs'
    accelerations: five linear equations for speed', yaw', pitch'' and both torques.
    """
    s, c, (speed, yaw, tilt) = math.sin(q[3]), math.cos(q[3]), nu
    m, h, r, b, wheel = v["m"], v["h"], v["r"], v["b"], v["m_w"] + v["I_w"] / v["r"] ** 2
    unlike = v["I_x"] - v["I_z"] + m * h**2
    about = 2 * v["I_d"] + v["I_z"] * c**2 + (v["I_x"] + m * h**2) * s**2 + 2 * b**2 * wheel
    rows = [
        [m + 2 * wheel, 0, m * h * c, -1 / r, -1 / r],
        [m * h * c, 0, v["I_y"] + m * h**2, 1, 1],
        [0, about, 0, -b / r, b / r],
    ]
    right = [
        m * h * s * (tilt**2 + yaw**2),
        m * v["g"] * h * s + unlike * s * c * yaw**2,
        -2 * unlike * s * c * tilt * yaw - m * h * s * speed * yaw,
    ]
    outputs = {
        "speeds": [[1, 0, 0], [0, 1, 0]],
        "upright": [[0, 0, 1], [0, 1, 0]],
        "drive": [[1, 0, 1.0], [0, 1, 0]],
        "wheels": [[1 / r, b / r, -1], [1 / r, -b / r, -1]],
    }[name]
    drift = [3.0 * tilt, 0.0] if name == "drive" else [0.0, 0.0]
    rows += [[*row, 0, 0] for row in outputs]
    return np.linalg.solve(np.array(rows), np.array([*right, *np.subtract(wanted, drift)]))[3:]


def by_hand_snakeboard(v, q, nu, name: str, wanted) -> np.ndarray:
    """The momenta of rotor and wheels, and that along the constraints, with theta' = v tan(phi) / l."""
    (speed, _, wheels), t, l = nu, math.tan(q[4]), v["l"]  # noqa: E741
    whole, (spun, steered) = v["J"] + v["J_r"] + 2 * v["J_w"], wanted
    centripetal = speed * wheels * (1 + t**2) / l  # of theta'', besides v' t / l
    faster = -(t / l) * (whole * centripetal + v["J_r"] * spun) / (v["m"] + whole * t**2 / l**2)
    return np.array([v["J_r"] * (faster * t / l + centripetal + spun), 2 * v["J_w"] * steered])


def by_hand_sleigh(v, q, nu, name: str, wanted) -> np.ndarray:
    """Chaplygin: (I + m a^2) w' = torque - m a v w."""
    return np.array([(v["I"] + v["m"] * v["a"] ** 2) * wanted[0] + v["m"] * v["a"] * nu[0] * nu[1]])


BY_HAND = {"balancer": by_hand_balancer, "snakeboard": by_hand_snakeboard, "sleigh": by_hand_sleigh}


@pytest.mark.parametrize(("robot", "name"), [each for each in EACH if each[0] in BY_HAND])
def test_the_inputs_are_those_of_equations_by_hand(robot, name):
    """At random parameters, states and virtual inputs, to 1e-10."""
    made = law(robot, name)
    groups = [
        ca.vertcat(*[q.symbol for q in made.groups[group]])
        for group in ("params", "config", "state", "virtual_input")
    ]
    function, random = ca.Function("tau", groups, [made.tau_of_v]), np.random.default_rng(7)
    config = values_of(list(made.config), {}, "")
    for _ in range(50):
        v = {key: value * random.uniform(0.6, 1.6) for key, value in values(robot).items()}
        q, nu = (
            random.uniform(-0.7, 0.7, len(find_robot(robot).coordinates)),
            random.uniform(-2, 2, made.system.dof),
        )
        wanted = random.uniform(-3, 3, len(made.virtual_input))
        tau = function(list(v.values()), config, [*q, *nu], wanted).full().ravel()
        expected = BY_HAND[robot](v, q, nu, name, wanted)
        np.testing.assert_allclose(tau, expected, rtol=1e-10, atol=1e-10 * np.abs(expected).max())


@each_law
def test_the_highest_derivatives_are_the_virtual_input(robot, name):
    """On the robot's own equations, nudot = Mbar^-1 (S'E tau - bias);
    the last rows of Phi vanish whatever the inputs are."""
    made, random = law(robot, name), np.random.default_rng(3)
    io, system = made.linearization, made.system
    free = ca.SX.sym("tau", len(system.mechanism.inputs))
    driven, moved = system.acceleration(made.tau_of_v), system.acceleration(free)
    outputs = len(io.output.rows)
    highest = (io.Phi @ driven + io.drift)[:outputs] - ca.vertcat(*[q.symbol for q in made.virtual_input])
    groups = [
        ca.vertcat(*[q.symbol for q in made.groups[group]])
        for group in ("params", "config", "state", "virtual_input")
    ]
    function = ca.Function("zero", [*groups, free], [highest, (io.Phi @ moved + io.drift)[outputs:], driven])
    config, parameters = values_of(list(made.config), {}, ""), list(values(robot).values())
    assert io.Phi.shape == (system.dof, system.dof) and io.row_names[outputs].startswith("passive_")
    for _ in range(20):
        state, v = random.uniform(-0.6, 0.6, len(made.state)), random.uniform(-1, 1, outputs)
        given = parameters, config, state, v, random.uniform(-1, 1, free.numel())
        off, passive, u = (each.full() for each in function(*given))
        assert np.abs(off).max() < 1e-9 * max(1.0, np.abs(u).max()) and np.abs(passive).max() < 1e-9


# -- closed loops --------------------------------------------------------------------------------------------


def test_errors_decay_with_the_poles_that_are_placed():
    """tilt'' + 5 tilt' + 6 tilt = 0 from (0.3, -0.2), and turn' = -2 (turn - 0.4), both as closed forms,
    to 1e-6."""
    spec = spec_of(
        "balancer",
        "upright",
        [0.0, 0.4],
        [0, 0, 0, 0.3, 0, 0],
        [0.2, -0.3, -0.2],
        simulation={"duration": 3.0},
    )
    run = simulate(dataclasses.replace(spec, gains={"kp_tilt": 6.0, "kd_tilt": 5.0, "kv_turn": 2.0}))
    slow, fast = np.linalg.solve([[1, 1], [-2, -3]], [0.3, -0.2])
    np.testing.assert_allclose(run.y[:, 0], slow * np.exp(-2 * run.t) + fast * np.exp(-3 * run.t), atol=1e-6)
    np.testing.assert_allclose(run.y[:, 1] - 0.4, -0.7 * np.exp(-2 * run.t), atol=1e-6)


@pytest.mark.parametrize(
    ("name", "chosen", "q", "eta"),
    [
        ("wheels", (), [0.1, -0.2, 0.3, 0.2, 0.0, 0.0], 0.15),
        ("speeds", (0, 1), [0, 0, 0.4, -0.15, 0.5, 0.5], -0.2),
    ],
)
def test_with_the_outputs_held_the_zero_dynamics_remain(name, chosen, q, eta):
    """Started with the outputs at rest, the run is that of `PartialLinearization.zero_dynamics`, integrated
    apart, to 1e-8: the balancer falls, with its motors held, or its speed and heading.
    """
    robot, partial = find_robot("balancer"), partial_linearization(find_robot("balancer"))
    symbol = ca.SX.sym("eta")
    rates = ca.Function(
        "rates", [robot.q, symbol, robot.p], [ca.vertcat(*partial.zero_dynamics(symbol, chosen))]
    )
    nu = (
        ca.Function("nu", [robot.q, robot.p], [partial.directions(chosen)])(q, robot.parameter_values({}))
        .full()
        .ravel()
        * eta
    )
    parameters = robot.parameter_values({})
    held = [q[4] - q[3], q[5] - q[3]] if name == "wheels" else [0.0, 0.0]
    run = simulate(spec_of("balancer", name, held, q, nu, simulation={"duration": 0.6, "tolerance": 1e-13}))
    apart = solve_ivp(
        lambda _, x: rates(x[:-1], x[-1], parameters).full().ravel(),
        (0, 0.6),
        [*q, eta],
        "DOP853",
        run.t,
        rtol=1e-12,
        atol=1e-13,
    )
    np.testing.assert_allclose(run.q, apart.y[:-1].T, atol=1e-8)
    assert abs(run.q[-1, 3]) > 2 * abs(q[3]) and np.abs(run.error).max() < 1e-9


@cache
def shipped(name: str, backend: str) -> Run:
    return simulate(read_varied(SPECS / f"{name}.toml", {"simulation.duration": 3.0}), backend)


@pytest.mark.parametrize(
    "name",
    [
        "balancer_drive",
        *(pytest.param(name, marks=pytest.mark.nightly) for name in ("snakeboard", "roller_racer")),
    ],
)
def test_shipped_runs_in_float_and_double(name):
    """The same runs by CasADi, by the C in double to 1e-9, and in float to 1e-3 of the largest state."""
    runs = {backend: shipped(name, backend) for backend in ("casadi", "c", "cf")}
    size = np.abs(runs["casadi"].x).max()
    assert all(run.stopped is None for run in runs.values())
    assert np.abs(runs["c"].x - runs["casadi"].x).max() <= 1e-9 * size
    assert 0 < np.abs(runs["cf"].x - runs["casadi"].x).max() <= 1e-3 * size


def test_the_balancer_drives_and_the_boards_drive_themselves():
    """What the shipped runs show: pitch and errors go to zero, the speed to that which is desired;
    sines propel the boards."""
    drive = simulate(
        read_varied(
            SPECS / "balancer_drive.toml", {"simulation.duration": 7.9, "simulation.backend": "casadi"}
        )
    )
    pitch = [c.name for c in drive.law.system.mechanism.coordinates].index("pitch")
    assert abs(drive.q[-1, pitch]) < 2e-3 and np.abs(drive.error[-1]).max() < 1e-4 and drive.warnings == ()
    np.testing.assert_allclose(drive.nu[-1, :2], [0.6, 0.5], atol=2e-3)
    for name, least in (("snakeboard", 0.05), ("roller_racer", 0.15)):
        run = simulate(
            read_varied(SPECS / f"{name}.toml", {"simulation.duration": 1.5, "simulation.period": 0.01}),
            "casadi",
        )
        assert run.nu[0, 0] == 0.0 and run.nu[-1, 0] > least
    names = [axes.get_ylabel() for axes in draw(drive).axes]
    assert "not controlled" in names and "error (m/s or rad/s)" in names


def test_an_oscillation_has_the_derivatives_of_a_sine():
    """The reference of the run against central differences, and what is wrong with one."""
    spec = read_spec(SPECS / "snakeboard.toml")
    reference = dataclasses.replace(
        spec.reference,
        position=(0.1, -0.2),
        velocity=(0.03, 0.0),
        oscillation=dataclasses.replace(spec.reference.oscillation, angle=(0.4, -1.0)),
    )
    from noslip.simulation.loop import make_loop

    at = make_loop(dataclasses.replace(spec, reference=reference)).guidance.reference
    x, t, h = np.zeros(8), 0.7, 1e-4
    before, here, after = (at(t + k * h, x) for k in (-1, 0, 1))
    expected = [0.1 + 0.03 * t + math.sin(0.4 + 2 * t), -0.2 + 0.4 * math.sin(2 * t - 1)]
    np.testing.assert_allclose(here[[0, 3]], expected, atol=1e-14)
    for order in (0, 1):
        rate = (after[[order, 3 + order]] - before[[order, 3 + order]]) / (2 * h)
        np.testing.assert_allclose(here[[order + 1, order + 4]], rate, atol=1e-7)
    for change, message in (
        ({"amplitude": [1.0]}, "oscillation amplitude has 1 numbers; it must have 2: rotor, wheels"),
        ({"angle": [1.0]}, "oscillation angle has 1 numbers"),
        ({"rate": 0.0}, "oscillation rate"),
    ):
        with pytest.raises(BadInput, match=message):
            make_loop(
                read_varied(
                    SPECS / "snakeboard.toml", {f"reference.oscillation.{k}": v for k, v in change.items()}
                )
            )


def test_a_sweep_runs_what_simulate_runs():
    changes = {"simulation.duration": 2.0, "simulation.output_step": 0.01, "push": []}
    spec = read_varied(SPECS / "balancer_drive.toml", changes)
    batch, run = Batch(spec), simulate(spec)
    outcome = dict(zip(batch.outcomes, batch.run(np.array([list(batch.nominal.values())]))[0], strict=True))
    for k, row in enumerate(run.law.output.rows):
        assert outcome[f"final.{row.name}"] == pytest.approx(run.error[-1, k], abs=1e-8)
    with pytest.raises(BadInput, match="oscillation .*a sweep does not have it yet"):
        Batch(read_spec(SPECS / "snakeboard.toml"))


# -- where inertia does not couple ---------------------------------------------------------------------------


def test_uncoupled_states_are_singular_and_none_beside_them():
    """The balancer's pitch is not coupled where 2 I_w + m r^2 + 2 m_w r^2 + h m r cos(pitch) = 0; the roller
    racer's speed with its handlebar straight. All backends say so.
    """
    v = values("balancer")
    weight = 2 * v["I_w"] + (v["m"] + 2 * v["m_w"]) * v["r"] ** 2
    cases = [
        ("balancer", "upright", 3, math.acos(-weight / (v["h"] * v["m"] * v["r"]))),
        ("roller_racer", "speeds", 3, 0.0),
    ]
    for robot, name, place, where in cases:
        made = law(robot, name)
        fixed = (
            list(values(robot).values()),
            values_of(list(made.config), {}, ""),
            values_of(list(made.gains), {}, ""),
        )
        for backend, least in (("casadi", 1e-3), ("c", 1e-3), ("cf", 1e-2)):
            controller = make_controller(backend, made, *fixed)
            for off, status in ((0.0, "singular"), (least, "ok"), (-least, "ok")):
                state = np.zeros(len(made.state))
                state[place], state[-2:] = where + off, 0.3
                found, tau = controller.step(state, np.zeros(len(made.reference)))
                assert found == status and np.isfinite(tau).all() and (status == "ok" or not tau.any()), (
                    robot,
                    backend,
                    off,
                )
    with pytest.raises(BadInput, match="inertia does not couple the outputs to the inputs there"):
        simulate(spec_of("roller_racer", "speeds", [1.0], [0.0] * 4))


# -- zero dynamics -------------------------------------------------------------------------------------------


def test_the_zero_dynamics_of_each_output_are_those_of_its_equation():
    """At rest the motors leave a v' + b p'' = w p: with the outputs held, b p'' = w p (speeds), the wheels
    fixed to the body, and (H a - b) p'' + k a p' + w p = 0 for v = -H p' - k p (drive); with p held nothing
    is left that moves.
    """
    v, rest = values("balancer"), analyse_at_rest(find_robot("balancer"))
    m, h, r, whole = v["m"], v["h"], v["r"], v["m"] + 2 * (v["m_w"] + v["I_w"] / v["r"] ** 2)
    a, b, w = whole * r + m * h, v["I_y"] + m * h**2 + m * h * r, m * v["g"] * h

    def drive(H: float, k: float) -> np.ndarray:
        return np.roots([H * a - b, k * a, w])

    falls, rolls = math.sqrt(w / b), math.sqrt(w / (r * a + b))
    for name, config, expected in (
        ("speeds", None, [falls, -falls]),
        ("wheels", None, [rolls, -rolls]),
        ("upright", None, []),
        ("drive", None, drive(1.0, 3.0)),
        ("drive", [0.2, 3.0], drive(0.2, 3.0)),
    ):
        made = law("balancer", name)
        found = of_outputs(rest, made.linearization, config)
        count = len(made.state) - sum(made.linearization.relative_degree)
        modes = np.concatenate([np.asarray(expected, complex), np.zeros(count - len(expected))])
        np.testing.assert_allclose(np.sort_complex(found.modes), np.sort_complex(modes), atol=1e-4)
        assert found.unstable == (np.max(np.real(expected), initial=0.0) > 1e-3)
    assert (
        of_outputs(
            analyse_at_rest(find_robot("roller_racer")), law("roller_racer", "speeds").linearization
        ).modes
        is None
    )


@pytest.mark.nightly
def test_analyse_and_simulate_say_it():
    answer = analyse(find_robot("balancer"))
    outputs, text = as_json(answer)["outputs"], " ".join(as_text(answer).split())
    assert outputs["wheels"]["singular_when"] == "nowhere" and outputs["drive"]["relative_degree"] == [1, 1]
    assert outputs["drive"]["stability"] == outputs["upright"]["stability"] == "none of them grows"
    assert outputs["wheels"]["stability"] == outputs["speeds"]["stability"] == "unstable"
    assert "zero dynamics at rest 3.967, 0 (3 times), -3.967 1/s, unstable" in text
    assert "Types I to IV are for robots with an input for each" in text
    warned = simulate(
        spec_of("balancer", "speeds", [0.0, 0.0], [0.0] * 6, simulation={"duration": 0.1})
    ).warnings
    assert warned == ("zero dynamics of speeds at rest: 4.521, 0 (5 times), -4.521 1/s, unstable",)
    low = spec_of("balancer", "drive", [0.0, 0.0], [0.0] * 6, simulation={"duration": 0.1})
    low = dataclasses.replace(low, output=dataclasses.replace(low.output, parameters={"H": 0.2, "k": 3.0}))
    (warning,) = simulate(low).warnings
    assert warning.startswith("zero dynamics of drive at rest: ") and warning.endswith("1/s, unstable")


# -- robots of a user's own ----------------------------------------------------------------------------------


def one_motor() -> Mechanism:
    """Two wheels, of which one has a motor, in the rates of the wheels:
    forward speed and yaw rate are combinations of these."""
    robot = Mechanism("one_motor", "two wheels, one driven")
    x, y, phi = (robot.coordinate(name, unit) for name, unit in (("x", "m"), ("y", "m"), ("phi", "rad")))
    right, left = robot.coordinate("right", "rad"), robot.coordinate("left", "rad")
    m, I, d = (  # noqa: E741
        robot.parameter("m", 5.0, "kg"),
        robot.parameter("I", 0.3, "kg m^2"),
        robot.parameter("d", 0.2, "m"),
    )
    forward = ca.cos(phi) * robot.rate(x) + ca.sin(phi) * robot.rate(y)
    aside, turning = ca.cos(phi) * robot.rate(y) - ca.sin(phi) * robot.rate(x), robot.rate(phi)
    robot.kinetic_energy(m * (forward**2 + (aside + d * turning) ** 2) / 2 + I * turning**2 / 2)
    robot.rolls("no side slip", aside)
    slips = [
        forward + side * 0.2 * turning - 0.1 * robot.rate(angle) for side, angle in ((1, right), (-1, left))
    ]
    for name, slip, at in (("right", slips[0], -0.2), ("left", slips[1], 0.2)):
        robot.rolls(name, slip)
        robot.contact(f"{name} wheel", m / 2, along=slip, left=at)
    robot.input("motor", "N m", on=robot.rate(right))
    robot.quasi_velocity("w_right", "rad/s", robot.rate(right))
    robot.quasi_velocity("w_left", "rad/s", robot.rate(left))
    robot.moves_in_plane(x, y, phi)
    robot.output("course", "heading", [("direction", "rad", phi)])
    robot.output("both", "both wheels", [("w_1", "rad", right), ("w_2", "rad", left)])
    return robot


def acrobot(joints: int, motors: int) -> Mechanism:
    """A chain of rods whose first joints have motors; outputs are the last joints, which have none."""
    robot = Mechanism("acrobot", "a chain of rods")
    q = [robot.coordinate(f"q_{k}", "rad") for k in range(joints)]
    robot.holds("needle", robot.coordinate("needle", "rad") - q[0])
    m, l = robot.parameter("m", 1.0, "kg"), robot.parameter("l", 0.5, "m")  # noqa: E741
    x, y, angle = ca.SX(0), ca.SX(0), ca.SX(0)
    for joint in q:
        angle += joint
        middle = x + l * ca.sin(angle) / 2, y - l * ca.cos(angle) / 2
        robot.kinetic_energy(
            m * sum(robot.rate(each) ** 2 for each in middle) / 2 + m * l**2 / 24 * robot.rate(angle) ** 2
        )
        robot.potential_energy(m * 9.81 * middle[1])
        x, y = x + l * ca.sin(angle), y - l * ca.cos(angle)
    for k in range(motors):
        robot.input(f"tau_{k}", "N m", on=robot.rate(q[k]))
    robot.output(
        "tail", "the last joints", [(f"b_{k}", "rad", q[joints - motors + k]) for k in range(motors)]
    )
    return robot


@pytest.mark.parametrize("make", [one_motor, pytest.param(lambda: acrobot(4, 2), marks=pytest.mark.nightly)])
def test_the_c_of_other_robots_is_the_model(make):
    """Compared at random states: in other quasi-velocities than the derivation's,
    and with two passive equations for 4 joints."""
    robot = make()
    made = law_of(robot, robot.outputs[0].name)
    files = generate(system_of(robot), [made], ("float",), dynamics=False)
    assert f"{robot.name}_{made.name}_f.c" in files and differences(system_of(robot), [made], files) == []


def test_a_planted_defect_is_found():
    """A sign in the C of the linearizing feedback."""
    made = law("balancer", "drive")
    files = robot_files(made.system, [made], ("float",), dynamics=False)
    text = files["balancer_drive_f.c"]
    assert "tau[1] = " in text
    files["balancer_drive_f.c"] = text.replace("tau[1] = ", "tau[1] = -", 1)
    (found,) = differences(made.system, [made], files)
    assert found.startswith("balancer, drive, float: tau_of_v by feedback differs: the C gives")


# -- what is refused -----------------------------------------------------------------------------------------


def outputs_of(robot: str, *rows: tuple[str, ca.SX]) -> object:
    system = system_of(find_robot(robot))
    return linearize(
        system, OutputMap("mine", "", tuple(OutputRow(name, "rad/s", "", each) for name, each in rows))
    )


def nu(robot: str, k: int) -> ca.SX:
    return system_of(find_robot(robot)).nu[k]


def twice_driven() -> Mechanism:
    robot = Mechanism("twice", "three degrees of freedom, two inputs on one of them")
    a, b, c = (robot.coordinate(name, "rad") for name in "abc")
    robot.holds("needle", robot.coordinate("needle", "rad") - a)
    robot.kinetic_energy((robot.rate(a) ** 2 + robot.rate(b) ** 2 + robot.rate(c) ** 2) / 2)
    for name in ("one", "two"):
        robot.input(name, "N m", on=robot.rate(a))
    robot.output("mine", "two", [("y_a", "rad", a), ("y_b", "rad", b)])
    return robot


REFUSED = {
    "not coupled": (
        lambda: outputs_of("sleigh", ("ahead", nu("sleigh", 0))),
        "sleigh, output mine: Phi is singular everywhere: inertia does not couple ahead to torque: no input "
        "changes the highest derivative; choose other outputs, such as velocities at the inputs",
    ),
    "one of two not coupled": (
        lambda: outputs_of("snakeboard", ("ahead", nu("snakeboard", 0)), ("spin", nu("snakeboard", 1))),
        "inertia does not couple ahead and spin to tau_psi, tau_phi",
    ),
    "dependent": (
        lambda: outputs_of("balancer", ("one", nu("balancer", 2)), ("two", 2 * nu("balancer", 2))),
        "balancer, output mine: Phi is singular everywhere: the outputs one, two depend on each other: they "
        "contain only 1 combination of pitch_rate",
    ),
    "too few": (
        lambda: outputs_of("balancer", ("one", nu("balancer", 2))),
        "balancer, output mine: 1 output for 2 inputs; add 1: one must be as many as the inputs tau_r, tau_l",
    ),
    "too many": (
        lambda: outputs_of("balancer", *[(f"y_{k}", nu("balancer", k)) for k in range(3)]),
        "3 outputs for 2 inputs; drop 1: y_0, y_1, y_2 must be",
    ),
    "type I": (
        lambda: law("balancer", "type_i"),
        "balancer, output type_i: 2 inputs for n - m = 3 degrees of freedom; Types I to IV are for robots "
        "with an input for each. The outputs of an underactuated robot are its own, with 2 rows: wheels, "
        "speeds, upright, drive",
    ),
    "type IV on a course": (
        lambda: law("sleigh", "type_iv_course"),
        "Types I to IV are for robots with an input for each",
    ),
    "extension": (
        lambda: law("balancer", "upright_extended"),
        "there is no dynamic extension; take it without",
    ),
    "kinematic": (
        lambda: law("balancer", "upright_kinematic"),
        "a kinematic law commands all n - m quasi-velocities",
    ),
    "dependent inputs": (
        lambda: reduce(twice_driven()),
        "twice: S'E has rank below 2: inputs depend on each other",
    ),
    "of another size": (
        lambda: law_of(one_motor(), "both"),
        "one_motor, output both: 2 outputs for 1 input; drop 1: w_1, w_2 must be as many as the inputs motor",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused(case):
    build, message = REFUSED[case]
    with pytest.raises(ModelError) as error:
        build()
    assert message in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("changes", "engine", "message"),
    [
        (
            {"drive.kind": "velocity", "drive.bandwidth": 5.0},
            None,
            "does not go with fewer inputs than quasi-velocities",
        ),
        (
            {"limits.mode": "grip", "contact.mu": 0.5},
            None,
            '"grip" does not apply to balancer: it has fewer inputs',
        ),
    ],
)
def test_sections_that_do_not_go_with_it(changes, engine, message):
    with pytest.raises(BadInput, match=message):
        simulate(read_varied(SPECS / "balancer_drive.toml", changes | {"push": []}), "casadi", engine=engine)


def test_the_commands_take_these_laws(capsys, tmp_path):
    assert find_laws(system_of(find_robot("balancer"))) == OF["balancer"]
    assert (
        main(["laws", "balancer"]) == 0
        and "drive    above (m/s, degree 1), turn (rad/s, degree 1)" in capsys.readouterr().out
    )
    assert (
        main(["outer-loop", "balancer", "--output", "drive", "--spec", str(_straight(tmp_path, "drive"))])
        == 0
    )
    assert "-2.255+2.281j" in capsys.readouterr().out
    assert (
        main(["outer-loop", "balancer", "--output", "speeds", "--spec", str(_straight(tmp_path, "speeds"))])
        == 2
    )
    assert "s = 4.521 1/s: so are the zero dynamics of these outputs" in capsys.readouterr().err


def _straight(folder: Path, name: str) -> Path:
    text = (
        f'robot = "balancer"\ngains = {{ kv = 2.0 }}\n[output]\ntype = "{name}"\n[reference]\nposition = '
        "[0.6, 0.0]\n"
    )
    file = folder / f"{name}.toml"
    file.write_text(text + "[initial]\nq = [0, 0, 0, 0.1, 0, 0]\n[simulation]\nduration = 1.0\n")
    return file
