"""The ground's forces at the contacts against balances of forces and moments written down by hand;
absolute values, SI units."""

import dataclasses
import math
from functools import cache
from pathlib import Path as File

import casadi as ca
import numpy as np
import pytest
from casadi import cos, sin
from noslip.codegen.identity import fingerprint
from noslip.model import Mechanism, ModelError, reduce
from noslip.model.contacts import GRAVITY, axles, combination, ground, narrow, shift_by_forces, unknown_loads
from noslip.model.robots import ROBOTS
from noslip.model.robots.labmate import labmate
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot, system_of
from noslip.simulation.closed_loop import simulate
from noslip.simulation.contact import ContactForce, Grip, contact_forces, draw_contact, grip
from noslip.simulation.plant import Plant
from noslip.simulation.run import Run
from noslip.simulation.specification.spec import ContactSection, Initial, read_spec
from noslip.simulation.specification.vary import read_varied
from noslip.tests.legible import unreadable

SPECS = File(__file__).parents[2] / "examples/specs"
# Which asks much of the ground
BESIDE_THE_LINE = {"initial": {"point": [0.0, 2.0], "heading": math.pi / 2, "speed": 0.0}}
LINE, CIRCLE = read_varied(SPECS / "line.toml", BESIDE_THE_LINE), read_spec(SPECS / "circle.toml")
STATES = 200
RANGES = {
    **{"b": (0.3, 1.2), "d": (-0.5, 0.5), "r": (0.05, 0.3), "m_c": (5, 60), "m_w": (0.2, 3)},
    **{"I_c": (2, 30), "I_w": (0.001, 0.05), "I_m": (0.0005, 0.02)},
}


def labmate_system():
    return system_of(find_robot("labmate"))


@cache
def on_the_line() -> Run:
    """The shipped run to a line."""
    return simulate(LINE)


def labmates():
    """Random platforms, states and torques: parameters by name, plant, x, tau."""
    random = np.random.default_rng(1992)
    for _ in range(STATES):
        values = {name: random.uniform(*bounds) for name, bounds in RANGES.items()}
        plant = Plant(labmate_system(), [values[p.name] for p in labmate_system().mechanism.parameters])
        yield (
            values,
            plant,
            np.append(random.uniform(-10, 10, 5), random.uniform(-10, 10, 2)),
            random.uniform(-10, 10, 2),
        )


def body_of(p):
    """Of the whole platform, wheels included: mass, inertia about its centre of mass,
    how far that is ahead of the axle."""
    mass = p["m_c"] + 2 * p["m_w"]
    ahead = p["m_c"] * p["d"] / mass
    about = p["I_c"] + p["m_c"] * (p["d"] - ahead) ** 2 + 2 * (p["I_m"] + p["m_w"] * (ahead**2 + p["b"] ** 2))
    return mass, about, ahead


def first(contacts: tuple[ContactForce, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Longitudinal and lateral forces and loads of the only row."""
    return tuple(
        np.array([getattr(c, name)[0] for c in contacts]) for name in ("longitudinal", "lateral", "load")
    )


# -- the platform --------------------------------------------------------------------------------------------


def test_forces_accelerate_the_platform():
    """m a, moments about the centre of mass and each wheel's spin,
    with the acceleration that the plant has."""
    for p, plant, x, tau in labmates():
        mass, about, ahead = body_of(p)
        speed, turn = p["r"] * (x[5] + x[6]) / 2, p["r"] * (x[5] - x[6]) / (2 * p["b"])
        spin = plant.rate(x, tau)[5:]
        speed_rate, turn_rate = p["r"] * spin.sum() / 2, p["r"] * (spin[0] - spin[1]) / (2 * p["b"])
        (right, left), side, load = first(contact_forces(plant, x, tau, ContactSection()))
        assert abs(right + left - mass * (speed_rate - ahead * turn**2)) < 1e-10
        assert abs(side.sum() - mass * (speed * turn + ahead * turn_rate)) < 1e-10
        assert abs(p["b"] * (right - left) - ahead * side.sum() - about * turn_rate) < 1e-10
        assert np.abs(tau - p["r"] * np.array([right, left]) - p["I_w"] * spin).max() < 1e-10
        assert np.abs(load - mass * 9.81 / 2).max() < 1e-10
        assert abs(side[0] - side[1]) < 1e-10


def test_forces_are_those_of_newton_and_euler():
    """The same balances solved for forces and accelerations together; nothing of the model takes part."""
    for p, plant, x, tau in labmates():
        mass, about, ahead = body_of(p)
        r, b, J = p["r"], p["b"], p["I_w"]
        speed, turn = r * (x[5] + x[6]) / 2, r * (x[5] - x[6]) / (2 * b)
        balances = np.array(  # of speed_rate, turn_rate, right, left, side
            [
                [mass, 0, -1, -1, 0],
                [0, mass * ahead, 0, 0, -1],
                [0, about, -b, b, ahead],
                [J / r, J * b / r, r, 0, 0],
                [J / r, -J * b / r, 0, r, 0],
            ]
        )
        *_, right, left, side = np.linalg.solve(
            balances, [mass * ahead * turn**2, -mass * speed * turn, 0, *tau]
        )
        longitudinal, lateral, _ = first(contact_forces(plant, x, tau, ContactSection()))
        assert np.abs(longitudinal - [right, left]).max() < 1e-10
        assert np.abs(lateral - side / 2).max() < 1e-10


def test_height_shifts_load_to_the_outer_wheel():
    for p, plant, x, tau in labmates():
        mass, _, ahead = body_of(p)
        turn, spin = p["r"] * (x[5] - x[6]) / (2 * p["b"]), plant.rate(x, tau)[5:]
        speed, turn_rate = p["r"] * (x[5] + x[6]) / 2, p["r"] * (spin[0] - spin[1]) / (2 * p["b"])
        pull = mass * (speed * turn + ahead * turn_rate)  # to the left
        height = 0.5 * 0.8 * mass * 9.81 * p["b"] / abs(pull)  # half of what lifts a wheel
        _, side, (right, left) = first(
            contact_forces(plant, x, tau, ContactSection(share=0.8, height=height))
        )
        assert abs(right + left - 0.8 * mass * 9.81) < 1e-9
        # No moment is left that rolls the body over
        assert abs(p["b"] * (right - left) - height * pull) < 1e-8
        assert abs(side.sum() - pull) < 1e-10
        assert abs(side[0] - side[1]) < 1e-10  # shared in proportion to the load at rest


def test_steady_circle():
    run = simulate(
        dataclasses.replace(
            CIRCLE, simulation=dataclasses.replace(CIRCLE.simulation, duration=30.0, output_step=0.1)
        )
    )
    inner = math.sqrt(10.0**2 - 0.3**2)  # m, radius of the axle's middle, which turns left at 5 m/s
    right, left = grip(run).contacts
    for wheel, sign in ((right, 1), (left, -1)):
        assert abs(wheel.lateral[-1] - 32.0 * 25.0 / inner / 2) < 1e-6
        # At a steady rate torques only carry the centre of mass, ahead of the axle, round: moment b (F_r -
        # F_l) = ahead F_side.
        assert (
            abs(
                2 * wheel.longitudinal[-1]
                - (-32.0 * 0.28125 * (5 / inner) ** 2 + sign * 0.28125 * 80.0360324 / 0.75)
            )
            < 1e-4
        )
    assert wheel.load[-1] == pytest.approx(156.96, abs=1e-9)


def test_what_friction_is_needed_is_enough():
    run = on_the_line()
    found = grip(run)
    assert not found.rolls and "would slip: right wheel, first at t = 0 s, requires mu >= " in found.verdict()
    needed = max(c.needs.max() for c in found.contacts)
    for mu, rolls in ((needed * (1 + 1e-12), True), (needed * (1 - 1e-12), False)):
        again = grip(with_contact(run, mu=mu))
        assert again.rolls is rolls and again.verdict().startswith("rolls" if rolls else "would slip")
    assert "assumed: mu 0.7, 100% of the weight" in found.summary() and "castors ignored" in found.summary()


def test_friction_beyond_measure_is_told_briefly():
    run = on_the_line()
    heavy = dataclasses.replace(run, tau=1e200 * np.ones_like(run.tau))
    verdict = grip(heavy).verdict()
    assert "would slip" in verdict and len(verdict) < 200
    told = [
        float(word)
        for word, before in zip(verdict.split()[1:], verdict.split(), strict=False)
        if before == ">="
    ]
    needed = [c.needs.max() for c in grip(heavy).contacts]
    assert all(1 <= a / b < 1.011 for a, b in zip(told, needed, strict=True))


def with_contact(run, **options):
    return dataclasses.replace(run, spec=dataclasses.replace(run.spec, contact=ContactSection(**options)))


def test_a_wheel_without_load_lifts():
    found = grip(with_contact(on_the_line(), height=2.0))
    right, left = found.contacts
    assert right.load[0] < 0 < left.load[0] and np.isinf(right.use[0])
    assert abs(right.lateral[0] - left.lateral[0]) < 1e-10 < abs(left.lateral[0])
    assert not found.rolls and found.verdict().startswith("wheel lifts: right wheel, first at t = 0 s")
    assert abs(right.load + left.load - 32 * GRAVITY).max() < 1e-9


def test_no_number_is_no_grip():
    nothing, zero, one = np.array([np.nan]), np.zeros(1), np.ones(1)
    for force, load in ((nothing, one), (zero, nothing)):
        found = Grip(zero, (ContactForce("wheel", force, zero, load, 0.7),), ContactSection())
        assert not found.rolls and found.verdict().startswith("would slip: wheel")
    plant = Plant(labmate_system(), [p.default for p in labmate_system().mechanism.parameters])
    states = np.zeros((2, 7))
    states[1] = np.nan
    for height in (0.0, 0.5):
        right, _ = contact_forces(plant, states, np.ones((2, 2)), ContactSection(height=height))
        assert np.isfinite(right.use[0]) and np.isinf(right.use[1])


def test_a_run_that_stopped_is_judged_by_the_rows_before():
    start = Initial(point=(0.0, 5.0 * math.sqrt(2)), heading=math.pi / 4, speed=1.414)
    run = simulate(dataclasses.replace(LINE, initial=start))
    assert run.stopped == "singular"
    found = grip(run)
    assert len(found.t) == len(run.t) - 1 and all(len(c.use) == len(found.t) for c in found.contacts)
    assert np.all([np.isfinite(c.use) for c in found.contacts])
    assert len(draw_contact(run).axes) == 2


def test_held_torque_is_judged_by_what_was_held():
    simulation = dataclasses.replace(LINE.simulation, period=0.05, duration=1.0)
    run = simulate(dataclasses.replace(LINE, simulation=simulation))
    found = grip(run)
    assert len(found.t) == 101
    alone = contact_forces(run.plant, run.x[42], run.tau[42], ContactSection())
    assert [c.longitudinal[42] for c in found.contacts] == [c.longitudinal[0] for c in alone]


def test_friction_use_has_columns():
    plain = dataclasses.replace(LINE, simulation=dataclasses.replace(LINE.simulation, duration=0.1))
    assert not any("use_" in name for name in simulate(plain).columns)
    run = simulate(dataclasses.replace(plain, contact=ContactSection(mu=0.5)))
    header, first_row, *_ = (line.split(",") for line in run.csv().splitlines())
    values = dict(zip(header, first_row, strict=True))
    right, left = grip(run).contacts
    assert (
        float(values["use_right_wheel"]) == right.use[0] > 1
        and float(values["use_left_wheel"]) == left.use[0]
    )


def test_constraint_forces_have_columns():
    run = simulate(dataclasses.replace(LINE, simulation=dataclasses.replace(LINE.simulation, duration=0.1)))
    forces = run.plant.constraint_forces(run.x, run.tau)
    assert [name for name in run.columns if name.startswith("lambda")] == ["lambda_1", "lambda_2", "lambda_3"]
    right, left = grip(run).contacts
    wanted = np.column_stack([-right.lateral - left.lateral, right.longitudinal, left.longitudinal])
    # The rows of A: side slip of P_o, then what rolls beyond each wheel's centre
    assert np.abs(forces - wanted).max() < 1e-10


def test_contacts_are_part_of_the_c():
    without = labmate()
    without.contacts.clear()
    assert fingerprint(reduce(without)) != fingerprint(reduce(labmate()))
    assert [p.name for p in without.parameters] == [p.name for p in labmate().parameters]


@pytest.mark.parametrize("options", [{}, {"height": 0.5}, {"height": 2.0}, {"mu": 5.0}])
def test_figure(options):
    figure = draw_contact(with_contact(on_the_line(), **options))
    use, circle = figure.axes
    labels = [text.get_text() for text in use.get_legend().get_texts()]
    assert any(label.startswith("right wheel, at most ") for label in labels) and "would slip" in labels
    assert circle.get_aspect() == 1.0 and "(N)" in circle.get_xlabel() and "(N)" in circle.get_ylabel()
    assert use.get_ylim()[1] > 1.0 and np.all(np.isfinite(use.get_ylim()))
    figure.draw_without_rendering()
    assert unreadable(figure) == []


# -- other robots --------------------------------------------------------------------------------------------


def disk() -> Mechanism:
    """An upright rolling disk, steered and driven."""
    robot = Mechanism("disk")
    x, y, heading, roll = (
        robot.coordinate(*q) for q in (("x", "m"), ("y", "m"), ("heading", "rad"), ("roll", "rad"))
    )
    m, r, I, J = (  # noqa: E741
        robot.parameter(*p)
        for p in (("m", 2.0, "kg"), ("r", 0.2, "m"), ("I", 0.03, "kg m^2"), ("J", 0.04, "kg m^2"))
    )
    forward = cos(heading) * robot.rate(x) + sin(heading) * robot.rate(y)
    sideways = cos(heading) * robot.rate(y) - sin(heading) * robot.rate(x)
    robot.kinetic_energy(
        (m * (forward**2 + sideways**2) + I * robot.rate(heading) ** 2 + J * robot.rate(roll) ** 2) / 2
    )
    robot.rolls("rolls along x", 7 * (robot.rate(x) - r * robot.rate(roll) * cos(heading)))  # not even in m/s
    robot.rolls("rolls along y", r * robot.rate(roll) * sin(heading) - robot.rate(y))
    robot.input("drive", "N m", on=robot.rate(roll))
    robot.input("steer", "N m", on=robot.rate(heading))
    robot.contact("disk", m, along=forward - r * robot.rate(roll), across=sideways)
    return robot


def edge(**contact) -> Mechanism:
    """A knife edge that carries its centre of mass ahead of the blade."""
    robot = Mechanism("edge")
    x, y, heading = (robot.coordinate(*q) for q in (("x", "m"), ("y", "m"), ("heading", "rad")))
    m, d = robot.parameter("m", 2.0, "kg"), robot.parameter("d", 0.3, "m")
    centre = (x + d * cos(heading), y + d * sin(heading))
    forward = cos(heading) * robot.rate(x) + sin(heading) * robot.rate(y)
    robot.kinetic_energy(m * sum(robot.rate(c) ** 2 for c in centre) / 2 + 0.1 * robot.rate(heading) ** 2 / 2)
    robot.rolls("blade", cos(heading) * robot.rate(y) - sin(heading) * robot.rate(x))
    robot.input("push", "N", on=forward)
    robot.input("turn", "N m", on=robot.rate(heading))
    given = {"mass": m, "across": cos(heading) * robot.rate(y) - sin(heading) * robot.rate(x)} | contact
    robot.contact("blade", **given)
    return robot


def tractor_trailer() -> Mechanism:
    """A tractor with a hinged trailer, two axles of two wheels;
    a rod pushes a slider and touches no ground."""
    robot = Mechanism("tractor_trailer")
    names = (("x", "m"), ("y", "m"), ("heading", "rad"), ("hinge", "rad"), ("slider", "m"))
    x, y, heading, hinge, slider = (robot.coordinate(*q) for q in names)
    m, mt = robot.parameter("m", 20.0, "kg"), robot.parameter("mt", 10.0, "kg")
    length, half = robot.parameter("length", 1.2, "m"), robot.parameter("half", 0.4, "m")
    behind = heading - hinge
    trailer = (x - length * cos(behind), y - length * sin(behind))

    def body(point, angle):
        x_dot, y_dot = (robot.rate(c) for c in point)
        return x_dot * cos(angle) + y_dot * sin(angle), y_dot * cos(angle) - x_dot * sin(angle)

    for mass, point, angle in ((m, (x, y), heading), (mt, trailer, behind)):
        robot.kinetic_energy(
            mass * sum(robot.rate(c) ** 2 for c in point) / 2 + 0.5 * robot.rate(angle) ** 2 / 2
        )
    robot.kinetic_energy(robot.rate(slider) ** 2 / 2)
    robot.rolls("tractor", body((x, y), heading)[1])
    robot.rolls("trailer", body(trailer, behind)[1])
    robot.holds("rod", slider - x - y / 2)
    robot.input("push", "N", on=body((x, y), heading)[0])
    robot.input("turn", "N m", on=robot.rate(heading))
    for name, point, angle, mass in (("tractor", (x, y), heading, m), ("trailer", trailer, behind, mt)):
        for side, part in (("right", 0.25), ("left", 0.75)):
            at = half if side == "left" else -half
            wheel = (point[0] - at * sin(angle), point[1] + at * cos(angle))
            robot.contact(f"{name}, {side}", part * mass, across=body(wheel, angle)[1], left=at)
    return robot


def ball() -> Mechanism:
    """A ball that rolls on a level plate without spin, q = place and orientation as turns about x and y so
    far."""
    robot = Mechanism("ball")
    x, y, about_x, about_y = (
        robot.coordinate(*q) for q in (("x", "m"), ("y", "m"), ("about_x", "rad"), ("about_y", "rad"))
    )
    m, r = robot.parameter("m", 0.5, "kg"), robot.parameter("r", 0.1, "m")
    robot.kinetic_energy(m * (robot.rate(x) ** 2 + robot.rate(y) ** 2) / 2)
    robot.kinetic_energy(0.4 * m * r**2 * (robot.rate(about_x) ** 2 + robot.rate(about_y) ** 2) / 2)
    robot.rolls("rolls along x", robot.rate(x) - r * robot.rate(about_y))
    robot.rolls("rolls along y", robot.rate(y) + r * robot.rate(about_x))
    robot.input("f_x", "N", on=robot.rate(x))
    robot.input("f_y", "N", on=robot.rate(y))
    robot.contact(
        "ball",
        m,
        along=robot.rate(x) - r * robot.rate(about_y),
        across=robot.rate(y) + r * robot.rate(about_x),
    )
    return robot


OTHERS = {"disk": disk, "edge": edge, "tractor_trailer": tractor_trailer, "ball": ball}


def states_of(name: str, options: ContactSection):
    """The plant's defaults, random states and inputs, and what `contact_forces` finds."""
    system = reduce(OTHERS[name]())
    mechanism = system.mechanism
    plant = Plant(system, [p.default for p in mechanism.parameters])
    random = np.random.default_rng(1992)
    n = len(mechanism.coordinates)
    x = random.uniform(-1.5, 1.5, (STATES, n + system.dof))
    tau = random.uniform(-5, 5, (STATES, len(mechanism.inputs)))
    return system, plant, x, tau, contact_forces(plant, x, tau, options)


@pytest.mark.parametrize("name", OTHERS)
def test_ground_and_inputs_do_what_the_equations_of_motion_ask(name):
    """M qddot + V - E tau is what the ground does at the contacts, J' F,
    and what a rod does that touches no ground."""
    system, plant, x, tau, contacts = states_of(name, ContactSection())
    mechanism, n = system.mechanism, len(system.mechanism.coordinates)
    nudot = ca.SX.sym("nudot", system.dof)
    forces = ca.SX.sym("F", 2 * len(contacts))
    inputs = ca.SX.sym("tau", len(mechanism.inputs))
    motion = system.S @ nudot + system.Sdot @ system.nu
    given = mechanism.E @ inputs + mechanism.contact_rows.T @ forces
    balance = ca.Function(
        "balance",
        [mechanism.q, system.nu, nudot, inputs, forces, mechanism.p],
        [mechanism.M @ motion + system.V - given, mechanism.A],
    )
    F = np.column_stack([way for c in contacts for way in (c.longitudinal, c.lateral)])
    lam = plant.constraint_forces(x, tau)
    rods = [k for k, constraint in enumerate(mechanism.constraint_names) if constraint == "rod"]
    for k in range(STATES):
        nudots = plant.rate(x[k], tau[k])[n:]
        rest, A = (
            value.full() for value in balance(x[k, :n], x[k, n:], nudots, tau[k], F[k], plant.parameters)
        )
        assert np.abs(rest[:, 0] + A[rods].T @ lam[k, rods]).max() < 1e-10


def test_wheels_of_an_axle_share_by_load():
    *_, contacts = states_of("tractor_trailer", ContactSection())
    for right, left in (contacts[:2], contacts[2:]):
        assert np.abs(left.lateral - 3 * right.lateral).max() < 1e-10
        assert not np.any(right.longitudinal) and not np.any(left.longitudinal)
    assert axles(tractor_trailer()) == [[0, 1], [2, 3]]
    # With a height each axle bears the moment of its own side force.
    *_, raised = states_of("tractor_trailer", ContactSection(height=0.2))
    for right, left in (raised[:2], raised[2:]):
        side = right.lateral + left.lateral
        shift = 0.2 * side / 0.8
        weight = GRAVITY * (20.0 if right is raised[0] else 10.0)
        assert np.abs(right.load - 0.25 * weight - shift).max() < 1e-9
        assert np.abs(left.load - 0.75 * weight + shift).max() < 1e-9


SHIPPED = [name for name in ROBOTS if find_robot(name).contacts]


@pytest.mark.parametrize("name", [*OTHERS, *SHIPPED])
def test_forces_are_affine_in_what_is_wanted(name):
    """`ground` against lambda (8): its forces at random inputs,
    and that they and the loads are affine in the inputs."""
    system = reduce(OTHERS[name]()) if name in OTHERS else system_of(find_robot(name))
    mechanism = system.mechanism
    n, m, inputs = len(mechanism.coordinates), len(mechanism.constraint_names), len(mechanism.inputs)
    tau = ca.SX.sym("tau", inputs)
    made = ground(system, system.acceleration(tau), tau)
    answers = [made.force, made.mass, made.shift]
    function = ca.Function(
        "ground", [ca.vertcat(mechanism.q, system.nu), tau, mechanism.p], [ca.densify(a) for a in answers]
    )
    random = np.random.default_rng(1992)
    height = 0.1 if not narrow(mechanism) else 0.0
    for _ in range(STATES // 10):
        values = [p.default * random.uniform(0.8, 1.25) for p in mechanism.parameters]
        plant = Plant(system, values)
        x = random.uniform(-1.2, 1.2, n + system.dof)
        one, other = random.uniform(-5, 5, (2, inputs))
        found = contact_forces(plant, x, one, ContactSection(height=height))
        force, mass, shift = (value.full().ravel() for value in function(x, one, values))
        C, lam = plant.contacts(x)[0][0], plant.constraint_forces(x, one)[0]
        held = np.abs(C).max(axis=0) > 0
        size = 1 + np.abs(force).max()
        assert C.shape == (2 * len(found), m) and np.abs(C.T @ force + lam)[held].max() < 1e-9 * size
        assert (
            np.abs(force - np.ravel([[c.longitudinal[0], c.lateral[0]] for c in found])).max() < 1e-9 * size
        )
        assert np.abs(GRAVITY * mass + height * shift - [c.load[0] for c in found]).max() < 1e-9 * size
        between, second = (
            np.concatenate([v.full().ravel() for v in function(x, u, values)])
            for u in ((one + other) / 2, other)
        )
        assert np.abs(2 * between - second - np.concatenate([force, mass, shift])).max() < 1e-9 * (
            size + np.abs(second).max()
        )


def test_a_robot_without_contacts():
    system = reduce(no_contacts())
    assert (
        contact_forces(Plant(system, [2.0, 0.3]), np.zeros((3, 5)), np.zeros((3, 2)), ContactSection()) == ()
    )
    found = Grip(np.zeros(3), (), ContactSection())
    assert found.summary() == found.verdict() == "not known whether it rolls: the robot defines no contacts"


def no_contacts() -> Mechanism:
    robot = edge()
    robot.contacts.clear()
    return robot


def test_height_needs_a_width():
    system = reduce(edge())
    with pytest.raises(BadInput, match=r"\[contact\] height = 0.4: blade of edge has no width"):
        contact_forces(
            Plant(system, [2.0, 0.3]), np.zeros((3, 5)), np.zeros((3, 2)), ContactSection(height=0.4)
        )


def forward_of(robot: Mechanism):
    x, y, heading = robot.q[0], robot.q[1], robot.q[2]
    return cos(heading) * robot.rate(x) + sin(heading) * robot.rate(y)


def contact(robot: Mechanism, name="wheel", mass=1.0, **more) -> Mechanism:
    robot.contact(name, mass, **more)
    return robot


REFUSED = {
    "name": (lambda r: contact(r, "", along=0), "name"),
    "twice": (lambda r: contact(r, "blade", along=0), "'blade' is used twice"),
    "no velocity": (lambda r: contact(r), "requires a velocity"),
    "not an expression": (lambda r: contact(r, along="fast"), "not an expression"),
    "matrix": (lambda r: contact(r, along=r.qdot), "scalar"),
    "mass that moves": (lambda r: contact(r, mass=r.qdot[0], along=0), "uses rates"),
    "stranger": (lambda r: contact(r, mass=ca.SX.sym("m"), along=0), "uses m"),
    "not linear": (lambda r: contact(r, along=forward_of(r) ** 2), "not linear"),
    "may move": (lambda r: contact(r, along=forward_of(r)), "'wheel' can move along"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_wrong_contacts_are_refused(name):
    declare, message = REFUSED[name]
    with pytest.raises(ModelError, match=message):
        combination(reduce(declare(edge())).mechanism)


def test_contacts_must_tell_constraints_apart():
    robot = disk()
    robot.contacts.clear()
    forward = cos(robot.q[2]) * robot.rate(robot.q[0]) + sin(robot.q[2]) * robot.rate(robot.q[1])
    robot.contact("disk", 1.0, along=forward - robot.p[1] * robot.rate(robot.q[3]))
    with pytest.raises(
        ModelError,
        match="do not determine how the forces of 'rolls along x', 'rolls along y' are distributed",
    ):
        combination(robot)


# -- robots that name all that they stand on -----------------------------------------------------------------


def cart(*supports: tuple[str, float, float, float], ahead: float = 0.0) -> Mechanism:
    """The LABMATE's platform and wheels with supports (name, mass, ahead and left of the axle's middle);
    `ahead` is that of the wheels."""
    robot = labmate()
    robot.contacts = [
        dataclasses.replace(each, mass=ca.SX(10.0), ahead=ca.SX(ahead)) for each in robot.contacts
    ]
    for support in supports:
        robot.support(support[0], support[1], ahead=support[2], left=support[3])
    return robot


CARTS = {
    "castor behind": (("castor", 4.0, -0.6, 0.0),),
    "castor aside": (("castor", 3.0, 0.7, 0.2),),
    "two castors": (("front", 3.0, 0.8, 0.1), ("rear", 5.0, -0.5, -0.1)),
}


@pytest.mark.parametrize("name", CARTS)
def test_loads_balance_the_moments_of_all_forces(name):
    """Newton and Euler for the whole robot as one body with its centre of mass at a height, whose
    acceleration is found by differences of the motion: nothing of the contacts takes part. With three
    supports the loads are those of the balance; with more they satisfy it.
    """
    system = reduce(cart(*CARTS[name]))
    height, random = 0.15, np.random.default_rng(7)
    places = np.array([[0.0, -0.75], [0.0, 0.75], *(support[2:] for support in CARTS[name])])
    for _ in range(STATES // 4):
        values = [p.default * random.uniform(0.8, 1.25) for p in system.mechanism.parameters]
        sizes = dict(zip([p.name for p in system.mechanism.parameters], values, strict=True))
        places[:2, 1] = -sizes["b"], sizes["b"]
        plant = Plant(system, values)
        x, tau = random.uniform(-2, 2, 7), random.uniform(-5, 5, 2)
        found = contact_forces(plant, x, tau, ContactSection(height=height))
        at_rest = contact_forces(plant, x, tau, ContactSection())
        mass, _, ahead = body_of(sizes)
        turn, spin = sizes["r"] * (x[5] - x[6]) / (2 * sizes["b"]), plant.rate(x, tau)[5:]
        speed, turn_rate = sizes["r"] * (x[5] + x[6]) / 2, sizes["r"] * (spin[0] - spin[1]) / (2 * sizes["b"])
        pull = mass * np.array(
            [sizes["r"] * spin.sum() / 2 - ahead * turn**2, speed * turn + ahead * turn_rate]
        )
        load, still = (np.array([c.load[0] for c in each]) for each in (found, at_rest))
        assert np.abs(still - GRAVITY * np.array([10.0, 10.0, *(s[1] for s in CARTS[name])])).max() < 1e-12
        balance = np.vstack([np.ones(len(load)), places.T])
        assert np.abs(balance @ (load - still) + [0.0, *(height * pull)]).max() < 1e-9
        if len(load) == 3:
            assert np.abs(load - still - np.linalg.solve(balance, [0.0, *(-height * pull)])).max() < 1e-9
        assert [c.support for c in found] == [False, False, *[True] * len(CARTS[name])]
        assert all(
            c.longitudinal[0] == 0 == c.lateral[0] and c.use[0] == (0 if c.load[0] > 0 else np.inf)
            for c in found[2:]
        )


@pytest.mark.parametrize("name", CARTS)
def test_the_ground_of_a_robot_with_supports(name):
    """`ground` gives the loads of `contact_forces`, affine in the inputs; also of a steered wheel,
    whose forces are turned."""
    for system in (reduce(cart(*CARTS[name])), reduce(steered_with_supports())):
        mechanism, random = system.mechanism, np.random.default_rng(8)
        tau = ca.SX.sym("tau", 2)
        made = ground(system, system.acceleration(tau), tau)
        function = ca.Function(
            "ground", [mechanism.q, system.nu, tau, mechanism.p], [ca.densify(a) for a in vars(made).values()]
        )
        plant = Plant(system, [p.default for p in mechanism.parameters])
        for _ in range(10):
            q, nu, inputs = (random.uniform(-1, 1, size) for size in (mechanism.q.numel(), 2, 2))
            force, mass, shift = (value.full().ravel() for value in function(q, nu, inputs, plant.parameters))
            found = contact_forces(plant, np.append(q, nu), inputs, ContactSection(height=0.2))
            size = 1 + np.abs(force).max()
            assert np.abs(GRAVITY * mass + 0.2 * shift - [c.load[0] for c in found]).max() < 1e-9 * size
            assert (
                np.abs(force - np.ravel([[c.longitudinal[0], c.lateral[0]] for c in found])).max()
                < 1e-9 * size
            )


def steered_with_supports() -> Mechanism:
    robot = ROBOTS["car"]()
    robot.support("right castor", 2.0, ahead=0.2, left=-0.3)
    robot.support("left castor", 2.0, ahead=0.2, left=0.3)
    return robot


def test_contacts_on_the_centre_line_move_load_forward_and_back():
    """A car of one wheel an axle on a straight line: m a h about the rear axle is taken off the front one."""
    robot = ROBOTS["car"]()
    values = {p.name: p.default for p in robot.parameters}
    plant = Plant(reduce(robot), list(values.values()))
    x, tau, height = np.zeros(7), np.array([900.0, 0.0]), 0.55
    m, wheelbase, r = (values[name] for name in ("m", "l", "r"))
    acceleration = tau[0] / r / (m + values["I_w"] / r**2)
    rear, front = contact_forces(plant, x, tau, ContactSection(height=height))
    at_rest, moved = m * GRAVITY * values["c"] / wheelbase, m * acceleration * height / wheelbase
    assert abs(front.load[0] - (at_rest - moved)) < 1e-9 * m * GRAVITY and moved > 0.05 * at_rest
    assert abs(rear.load[0] + front.load[0] - m * GRAVITY) < 1e-9 * m * GRAVITY
    x[6] = x[5] = 2.0  # turning, too: the side forces move no load
    rear, front = contact_forces(plant, x, tau, ContactSection(height=height))
    assert sum(c.load[0] for c in (rear, front)) == pytest.approx(m * GRAVITY, rel=1e-9)
    assert front.load[0] == pytest.approx(at_rest - height * rear.longitudinal[0] / wheelbase, rel=1e-9)
    # No longer on the centre line: it would lean
    robot.contacts[1] = dataclasses.replace(robot.contacts[1], left=ca.SX(0.1))
    assert narrow(robot)


@pytest.mark.parametrize("name", ["car", "tricycle", "f1tenth", "forklift", "bus"])
def test_places_are_along_the_body_whatever_is_steered(name):
    """The balance of moments about the middle of the rear axle, in the axes of the body, not of the steered
    wheel, which is the vehicle."""
    robot = ROBOTS[name]()
    values = {p.name: p.default for p in robot.parameters}
    plant, random = Plant(reduce(robot), list(values.values())), np.random.default_rng(11)
    for _ in range(10):
        x, tau, height = random.uniform(-0.6, 0.6, 7), random.uniform(-5, 5, 2), 0.3
        rear, front = contact_forces(plant, x, tau, ContactSection(height=height))
        at_rest = contact_forces(plant, x, tau, ContactSection())
        pull = 0.0
        for contact, angle in ((rear, -values.get("k", 0.0) * x[3]), (front, x[3])):
            pull += np.cos(angle) * contact.longitudinal[0] - np.sin(angle) * contact.lateral[0]
        moved = [a.load[0] - b.load[0] for a, b in zip((rear, front), at_rest, strict=True)]
        assert moved == pytest.approx([height * pull / values["l"], -height * pull / values["l"]], rel=1e-9)


def test_places_that_do_not_fit_the_velocities_are_refused():
    """Of a robot whose vehicle is its steered wheel: they say along which heading they are."""
    robot = ROBOTS["car"]()
    robot.contacts[1] = dataclasses.replace(robot.contacts[1], ahead=ca.SX(1.0))
    with pytest.raises(ModelError, match=r"car: the places of contacts \(ahead, left\) do not fit"):
        shift_by_forces(robot)
    robot = steered_with_supports()
    del robot.contacts[0]
    with pytest.raises(ModelError, match="are not clear from their velocities"):
        shift_by_forces(robot)


def test_supports_on_one_line_carry_no_moment():
    system = reduce(cart(("castor", 3.0, 0.0, 0.3)))
    plant = Plant(system, [p.default for p in system.mechanism.parameters])
    with pytest.raises(BadInput, match=r"\[contact\] height = 0.4: all supports of labmate are on one line"):
        contact_forces(plant, np.zeros((3, 7)), np.zeros((3, 2)), ContactSection(height=0.4))


WRONG_SUPPORTS = {
    "twice": (lambda r: r.support("right wheel", 1.0, 0.0), "'right wheel' is used twice"),
    "name": (lambda r: r.support(" ", 1.0, 0.0), "a support's name must be text"),
    "place that moves": (lambda r: r.support("castor", 1.0, r.qdot[0]), "support 'castor', ahead uses rates"),
    "matrix": (lambda r: r.support("castor", 1.0, 0.0, r.q), "must be a scalar"),
}


@pytest.mark.parametrize("name", WRONG_SUPPORTS)
def test_wrong_supports_are_refused(name):
    declare, message = WRONG_SUPPORTS[name]
    with pytest.raises(ModelError, match=message):
        declare(labmate())


def test_supports_are_part_of_the_c():
    one, other = (reduce(cart(("castor", 4.0, place, 0.0))) for place in (-0.6, -0.5))
    assert len({fingerprint(system) for system in (one, other, reduce(labmate()))}) == 3


LEANS = {"balancer": "it rises and falls as it leans", "slope_platform": "", "car": ""}


@pytest.mark.parametrize("name", LEANS)
def test_loads_that_change_as_a_body_leans_are_not_known(name):
    """Nothing is said of its contacts then; on a slope, too, the energy at rest changes,
    but not by leaning."""
    plant = Plant(system_of(find_robot(name)), find_robot(name).parameter_values({}))
    state, reason = np.zeros((1, len(plant.system.state))), unknown_loads(plant.system.mechanism)
    assert reason.startswith(LEANS[name]) and bool(reason) == bool(LEANS[name])
    assert bool(reason) != bool(contact_forces(plant, state, np.zeros((1, 2)), ContactSection()))
