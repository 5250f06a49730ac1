"""Imported robots in the engine, beside their own URDF in it; how robots stand and tip, by hand."""

from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from noslip.cli.main import main
from noslip.model import Mechanism
from noslip.readers.robots import system_of
from noslip.simulation.closed_loop import simulate, summary
from noslip.simulation.contact import contact_forces, grip
from noslip.simulation.engine.engine import FloorEngine
from noslip.simulation.engine.frames import planar
from noslip.simulation.engine.mjcf import with_castors
from noslip.simulation.integrate import Refused
from noslip.simulation.plant import Plant
from noslip.simulation.specification.floor import Floor
from noslip.simulation.specification.spec import ContactSection
from noslip.simulation.specification.vary import read_varied
from noslip.tests.urdfs import Urdf, four_wheels, steered

mujoco = pytest.importorskip("mujoco")
pytest.importorskip("yourdfpy")
LINE = Path(__file__).parents[2] / "examples/specs" / "line.toml"
NEAR = 0.01  # m, between the paths of the import and of the file
GRAVITY = 9.81


def cart(centre, castors) -> Urdf:
    """Two wheels at the origin, a body with its centre of mass somewhere, spheres ahead or behind."""
    made = Urdf("cart")
    made.link("base", 8.0, centre)
    for side, name in ((-1, "right"), (1, "left")):
        made.wheel(name, "base", (0, side * 0.2, 0.1))
    for k, ahead in enumerate(castors):
        made.link(
            f"castor_{k}", 0.05, shape='<collision><geometry><sphere radius="0.03"/></geometry></collision>'
        )
        made.joint(f"castor_{k}_joint", "fixed", "base", f"castor_{k}", (ahead, 0, 0.03))
    return made


CART = {"joints": {"theta_r": "right_joint", "theta_l": "left_joint"}}
SIDES = {
    "theta_r": ["front_right_joint", "rear_right_joint"],
    "theta_l": ["front_left_joint", "rear_left_joint"],
}
FRONT = {"front wheel": ["front_right_joint", "front_left_joint"]}
STEERED = {"initial": {"q": [2.9, 0.0, np.pi / 2, 0.0, 0.0], "nu": [1.0, 0.0]}}
SKID = {"drive": {"kind": "velocity", "bandwidth": 5.0, "delay": 0.01}}
KINDS = {
    "castor in front": (cart((0.1, 0, 0.1), [0.25]), CART, {}),
    "mass aside": (cart((0.05, 0.03, 0.1), [0.25]), CART, {}),
    "castor behind": (cart((-0.05, 0, 0.12), [-0.2]), CART, {}),
    "castors in front and behind": (cart((0, 0, 0.1), [0.25, -0.25]), CART, {}),
    "skid steer": (four_wheels(), {"joints": SIDES}, SKID),
    "car": (
        steered(pair=True),
        {
            "joints": {"delta": ["steering_right", "steering_left"], "theta": ["right_joint", "left_joint"]},
            "wheels": FRONT,
        },
        STEERED,
    ),
    "tricycle": (
        steered(pair=False, front=True),
        {
            "joints": {"delta": "steering", "theta": "front_joint"},
            "wheels": {"rear axle": ["right_joint", "left_joint"]},
        },
        STEERED,
    ),
    "tricycle driven at the rear": (
        steered(pair=False),
        {
            "joints": {"delta": "steering", "theta": ["right_joint", "left_joint"]},
            "wheels": {"front wheel": "front_joint"},
        },
        STEERED,
    ),
}


@pytest.mark.nightly
@pytest.mark.parametrize("kind", KINDS)
def test_an_import_moves_as_its_file(kind, tmp_path, capsys):
    """Along a circle, by the same controller: the robot that the importer wrote,
    and the URDF itself as a scene."""
    urdf, scene, changes = KINDS[kind]
    file, robot = tmp_path / "robot.urdf", tmp_path / "robot.py"
    file.write_text(urdf.text)
    assert (
        main(
            [
                "import",
                str(file),
                "-o",
                str(robot),
                *(["--skid-steer-track", "0.9"] if kind == "skid steer" else []),
            ]
        )
        == 0
    )
    path = {"kind": "circle", "x_f": 0.0, "y_f": 0.0, "R": 3.0}
    rest = {
        "robot": f"{robot}:{urdf.name}",
        "parameters": {},
        "output": {"type": "IV", "L": 0.2, "path": path},
        "gains": {"kp": 1.0, "kd": 2.0, "kv": 1.0},
        "reference.speed": 0.4,
        "initial": {"point": [3.05, 0.0], "heading": np.pi / 2, "speed": 0.2},
        "contact": {"mu": 0.6},
        "simulation": {"duration": 6.0, "period": 0.01},
    }
    own = simulate(read_varied(LINE, rest | changes), engine="mujoco")
    there = simulate(
        read_varied(LINE, rest | changes | {"scene": {"file": str(file), **scene}}), engine="mujoco"
    )
    assert own.stopped is there.stopped is None
    assert np.hypot(*np.ptp(own.q[:, :2], axis=0)) > 0.4
    assert np.hypot(*(own.q - there.q)[:, :2].T).max() < NEAR
    slips = own.floor.slip.max() > 0.02
    assert slips == (kind == "skid steer") == ("skidding costs" in summary(own))
    # Nothing chatters
    assert np.abs(there.floor.load - there.floor.load[0]).max() < 0.1 * there.floor.load[0].max()


def stands(castors, d=0.05, h=0.12, wheels=(), track=0.2) -> Plant:
    """Two wheels on an axle, a mass of 10 kg d ahead of it and h high; castors (ahead, left, kg) or none."""
    robot = Mechanism("cart")
    units = {"x": "m", "y": "m", "phi": "rad", "theta_r": "rad", "theta_l": "rad"}
    x, y, phi, *angles = (robot.coordinate(name, unit) for name, unit in units.items())
    m, b, r = (
        robot.parameter("m", 10.0, "kg"),
        robot.parameter("b", track, "m"),
        robot.parameter("r", 0.1, "m"),
    )
    forward = ca.cos(phi) * robot.rate(x) + ca.sin(phi) * robot.rate(y)
    left, turning = ca.cos(phi) * robot.rate(y) - ca.sin(phi) * robot.rate(x), robot.rate(phi)
    robot.body("base", m, ca.SX(0.4), forward, left + d * turning, turning, height=h)
    robot.rolls("axle", left)
    on_wheels = (10 - sum(mass for *_, mass in castors)) / 20 * m
    for side, theta, aside in zip("rl", angles, (-b, b), strict=True):
        slip = forward - aside * turning - r * robot.rate(theta)
        robot.kinetic_energy(INERTIA * robot.rate(theta) ** 2 / 2)
        robot.rolls(f"{side} rolls", slip)
        places = [(ahead, np.sign(-1 if side == "r" else 1) * half) for ahead, half in wheels]
        robot.contact(f"{side} wheel", on_wheels, along=slip, across=left, left=aside, wheels=places)
        robot.input(f"tau_{side}", "N m", on=robot.rate(theta))
        robot.quasi_velocity(f"thetadot_{side}", "rad/s", robot.rate(theta))
    for k, (ahead, aside, mass) in enumerate(castors):
        robot.support(f"castor {k + 1}", mass, ahead=ahead, left=aside)
    robot.moves_in_plane(x, y, phi)
    return Plant(system_of(robot), robot.parameter_values({}))


INERTIA = 0.004  # kg m^2, of a wheel about its axle


def on_floor(plant: Plant, start=None, mu=2.0, **contact) -> FloorEngine:
    return FloorEngine(
        plant, ContactSection(**contact), Floor(mu=mu), np.zeros(7) if start is None else start
    )


def test_castors_carry_what_statics_says():
    """One castor: the lever rule. Two with the mass above the axle: their masses,
    whatever springs say. Three: minimum norm."""
    made = on_floor(stands([(0.25, 0.0, 2.0)]))
    assert made.carried() == pytest.approx([10 * GRAVITY * 0.05 / 0.25], rel=1e-4)
    assert made.look()[1] == pytest.approx([10 * GRAVITY * 0.8 / 2] * 2, rel=1e-4)
    made = on_floor(stands([(0.25, 0.0, 1.5), (-0.25, 0.0, 1.5)], d=0.0))
    assert made.carried() == pytest.approx([1.5 * GRAVITY] * 2, rel=1e-4) and made.look()[
        1
    ].sum() == pytest.approx(7 * GRAVITY)
    wrong = on_floor(stands([(0.2, 0.15, 1.0), (0.2, -0.15, 1.0), (-0.2, 0.0, 1.0)], d=0.04))
    loads = np.array([*wrong.look()[1], *wrong.carried()])
    places = np.array([[0.0, -0.2], [0.0, 0.2], [0.2, 0.15], [0.2, -0.15], [-0.2, 0.0]])
    # Springs in proportion to the masses
    rows, root = np.vstack([np.ones(5), places.T]), np.sqrt([3.5, 3.5, 1.0, 1.0, 1.0])
    springs = root * np.linalg.lstsq(rows * root, 10 * np.array([1.0, 0.04, 0.0]), rcond=None)[0]
    assert loads == pytest.approx(GRAVITY * springs, rel=1e-3)
    assert "castor 3" in wrong.castors and "0.12 m high" in wrong.standing.summary()


def test_castors_that_are_not_named_are_where_the_moments_balance():
    """The same robot without its castor; with the mass above the axle, one ahead of it and one behind."""
    plant = stands([(0.25, 0.0, 2.0)])
    bare = planar(plant.system.mechanism, plant.parameters)
    (castor,) = with_castors(replace(bare, castors=()), 1.0).castors
    assert castor.place == pytest.approx([0.25, 0.0]) and castor.load == pytest.approx(2.0)
    level = planar(stands([(0.25, 0.0, 3.0)], d=0.0).system.mechanism, plant.parameters)
    assert [c.place[0] for c in with_castors(replace(level, castors=()), 1.0).castors] == pytest.approx(
        [0.2, -0.2]
    )


@pytest.mark.parametrize("where, sign", [(0.25, 1), (-0.25, -1)])
def test_a_robot_tips_where_m_g_d_is_m_a_h(where, sign):
    """A castor in front lifts as the robot pulls away, one behind as it brakes. Its load L at a distance c
    from the axle: L c = m g d - (m h + 2 I / r) a, with the wheels' own spin; tau = (m + 2 I / r^2) a r / 2.
    """
    d, h = 0.05, 0.3
    for part in (0.5, 0.9, 1.15):
        a = part * GRAVITY * 10 * d / (10 * h + 2 * INERTIA / 0.1)
        tau = sign * (10 + 2 * INERTIA / 0.1**2) * a * 0.1 / 2
        start = np.array([0, 0, 0, 0, 0, *([0.0 if sign > 0 else 40.0] * 2)])
        made = on_floor(stands([(where, 0.0, 10 * d / 0.25)], d=sign * d, h=h), start)
        x = made.state()
        if part > 1:
            with pytest.raises(Refused, match="overturned"):
                for _ in range(200):
                    x = made.hold(0.0, x, np.full(2, tau), 0.01)
            continue
        for _ in range(30):
            x = made.hold(0.0, x, np.full(2, tau), 0.01)
        expected = (10 * GRAVITY * d - (10 * h + 2 * INERTIA / 0.1) * a) / 0.25
        assert made.carried()[0] == pytest.approx(expected, rel=0.02, abs=0.05)
        assert x[5] - start[5] == pytest.approx(sign * a / 0.1 * 0.3, rel=0.05)  # contacts yield a little


def test_the_verdict_sees_the_castor_lift(tmp_path):
    """contact_forces has the height of the robot without [contact] height, and the castor among its loads."""
    plant = stands([(0.25, 0.0, 2.0)], d=0.05, h=0.3)
    x, tau = np.zeros((1, 7)), np.full((1, 2), 3.0)
    loads = [contact.load[0] for contact in contact_forces(plant, x, tau, ContactSection())]
    a = 3.0 * 2 / 0.1 / (10 + 2 * INERTIA / 0.1**2)
    force = 6.0 / 0.1 - 2 * INERTIA / 0.1**2 * a  # of the ground, forward
    assert loads[2] == pytest.approx(2 * GRAVITY - force * 0.3 / 0.25)
    assert plant.height == pytest.approx(0.3) and plant.part == pytest.approx(0.8)


def test_wheels_of_one_coordinate_skid(tmp_path):
    """Four wheels on two coordinates, turning on the spot: a wheel a ahead and c at the right has the
    friction mu N against its slip v = (c omega - r theta', a omega).
    """
    a, c, mu = 0.2, 0.25, 0.5
    plant = stands([], d=0.0, wheels=[(a, c), (-a, c)], track=0.3)
    start = np.array([0, 0, 0, 0, 0, 9.0, -9.0])
    made = on_floor(plant, start, mu=mu)
    omega = 0.1 / 0.3 * 9.0
    made.hold(0.0, made.state(), np.zeros(2), 1e-5)
    slip, load, use, force = made.look()
    v = np.array([omega * c - 0.1 * 9.0, omega * a])  # of the front wheel at the right, in its axes
    assert load == pytest.approx([10 * GRAVITY / 4] * 4, rel=1e-3) and use == pytest.approx(
        [1.0] * 4, rel=1e-6
    )
    assert force[:2] == pytest.approx(-mu * 10 * GRAVITY / 4 * v / np.hypot(*v), rel=0.02)
    # N; front and rear are opposite
    assert made.on_contacts(force[None])[0, 1] == pytest.approx(0.0, abs=0.01)
    assert slip[0] == pytest.approx(np.hypot(*v), rel=0.05)


def test_a_share_of_the_weight_counts_once(bad_input, tmp_path):
    argv = ["simulate", "pioneer_3dx", "-o", str(tmp_path / "run.csv"), "--set", "contact={mu=0.7,share=0.8}"]
    assert "pioneer_3dx says itself that 76% of the weight is on these contacts" in bad_input(argv)
    run = simulate(read_varied(LINE.parent / "robots" / "pioneer_3dx.toml", {"simulation.duration": 0.1}))
    assert "76% of the weight on these contacts" in grip(run).assumed()
    heavy = simulate(read_varied(LINE, {"contact": {"mu": 0.7, "share": 0.8}, "simulation.duration": 0.1}))
    assert "80% of the weight on these contacts" in grip(heavy).assumed()


def test_idle_wheels_have_their_inertia():
    """A tricycle driven in front: its rear wheels roll along with an inertia that the mass matrix has."""
    robot, units = Mechanism("trike"), {"x": "m", "y": "m", "phi": "rad", "delta": "rad", "theta": "rad"}
    x, y, phi, delta, theta = (robot.coordinate(name, unit) for name, unit in units.items())
    forward = ca.cos(phi) * robot.rate(x) + ca.sin(phi) * robot.rate(y)
    left, turning = ca.cos(phi) * robot.rate(y) - ca.sin(phi) * robot.rate(x), robot.rate(phi)
    steering = turning + robot.rate(delta)
    ahead = ca.cos(delta) * forward + ca.sin(delta) * (left + turning)
    aside = ca.cos(delta) * (left + turning) - ca.sin(delta) * forward
    robot.body("base", ca.SX(20), ca.SX(2), forward, left + 0.3 * turning, turning)
    for sign in (-1, 1):  # two knuckles, each on a hinge of its own
        robot.body(
            f"knuckle_{sign + 1}",
            ca.SX(1),
            ca.SX(0.02),
            ahead - sign * 0.2 * ca.cos(delta) * turning - sign * 0.01 * steering,
            aside + sign * 0.2 * ca.sin(delta) * turning + 0.03 * steering,
            steering,
        )
        robot.kinetic_energy(0.05 * ((forward - sign * 0.3 * turning) / 0.1) ** 2 / 2)
    robot.kinetic_energy(0.01 * robot.rate(theta) ** 2 / 2)
    slip = ahead - 0.1 * robot.rate(theta)
    robot.rolls("front", aside)
    robot.rolls("axle", left)
    robot.rolls("drive", slip)
    robot.contact("rear", ca.SX(15), across=left)
    robot.contact("front wheel", ca.SX(7), along=slip, across=aside)
    robot.input("tau", "N m", on=robot.rate(theta))
    robot.input("steer", "N m", on=robot.rate(delta))
    robot.moves_in_plane(x, y, phi)
    bodies = planar(robot, np.zeros(0))
    rear, front = bodies.wheels
    assert rear.inertia / rear.radius**2 == pytest.approx(
        2 * 0.05 / 0.1**2, rel=1e-9
    ) and front.inertia == pytest.approx(0.01)
    assert (
        bodies.frames[1].apart
        and bodies.frames[1].pivot == pytest.approx([1.0, 0.0])
        and bodies.mass == pytest.approx(22)
    )
    assert 1e-4 < bodies.off < 1e-3  # 2 kg m 0.2 m 0.01 m / largest entry
