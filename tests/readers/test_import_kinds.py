"""Each kind of published URDF, imported: masses, geometry, signs and sides against the links in space,
which share no code."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from noslip.cli.main import main
from noslip.model.contacts import masses
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot, system_of
from noslip.readers.urdf import recognition
from noslip.readers.urdf.comparison import LinkMotion
from noslip.readers.urdf.document import read
from noslip.readers.urdf.parts import Options
from noslip.readers.urdf.recognition import recognize
from noslip.simulation.contact import contact_forces
from noslip.simulation.plant import Plant
from noslip.simulation.specification.spec import ContactSection
from noslip.tests.bought import KINDS, SKID, Bought, add_castor, bought, mesh_with_shaft, sensors, shape
from noslip.tests.urdf_links import Links
from noslip.tests.urdfs import ROBOTS, numbers

pytest.importorskip("yourdfpy", reason="yourdfpy, of the extra `physics`, reads URDFs")
STATES = 4


@pytest.fixture
def imported(tmp_path, capsys):
    """A function that imports a URDF with options and returns the reduced robot,
    its JSON and what stderr said."""

    def imported(made: Bought, *options: str):
        file, target = tmp_path / "robot.urdf", tmp_path / "robot.py"
        file.write_text(made.text, encoding="utf-8")
        assert main(["import", str(file), *options, "-o", str(target), "--json"]) == 0, (
            capsys.readouterr().err
        )
        out, err = capsys.readouterr()
        said = json.loads(out)
        return system_of(find_robot(f"{target}:{said['robot']}")), said, err

    return imported


@pytest.fixture
def recognized(tmp_path):
    """A function that returns what a URDF is recognized as, and its notes as one text."""

    def recognized(made: Bought, options: Options = Options()):  # noqa: B008
        (tmp_path / "robot.urdf").write_text(made.text)
        layout = recognize(read(str(tmp_path / "robot.urdf")), options)
        return layout, "\n".join(layout.notes)

    return recognized


def exact(text: str) -> str:
    """The same URDF with quarter turns for the rounded ones, as noslip says that it reads them."""
    return re.sub(r"\b1\.57[0-9]*\b", repr(np.pi / 2), text)


def check(made: Bought, system, slips: bool = False) -> None:
    """At random velocities that the robot file allows: a wheel rolls at the rate of the coordinate of its
    side, no rim slips, and the energy is that of all links, with wheels that turn so, and nothing else that
    moves.
    """
    links, random, robot = Links(exact(made.text)), np.random.default_rng(3), system.mechanism
    names = [c.name for c in robot.coordinates]
    f = ca.Function(
        "f",
        [robot.q, system.nu, robot.p],
        [system.qdot, ca.substitute(robot.energy(), robot.qdot, system.qdot)],
    )
    M, frames = links.mass_matrix({}), links.frames({})
    middle = np.mean([*made.wheels.values()], axis=0)  # the point (x, y)
    for _ in range(STATES):
        q, nu = random.uniform(-2, 2, len(names)), random.uniform(-3, 3, system.dof)
        rates, energy = f(q, nu, [p.default for p in robot.parameters])
        rate = dict(zip(names, rates.full()[:, 0], strict=True))
        c, s = np.cos(q[names.index("phi")]), np.sin(q[names.index("phi")])
        v = np.zeros(M.shape[0])
        v[[0, 1, 5]] = c * rate["x"] + s * rate["y"], c * rate["y"] - s * rate["x"], rate["phi"]
        v[:2] += rate["phi"] * np.array([middle[1], -middle[0]])
        for joint, centre in made.wheels.items():
            forward = v[0] - centre[1] * v[5]
            coordinate = rate["theta_l" if centre[1] > 0 else "theta_r"]
            assert slips or forward == pytest.approx(made.radius * coordinate, rel=1e-9)
            assert slips or abs(v[1] + centre[0] * v[5]) < 1e-9  # to the left
            k = 6 + links.moving.index(joint)
            # Part of its axis that is to the left
            left = frames[links.joints[joint].find("child").get("link")][2][4, k]
            assert abs(left) == pytest.approx(1.0, abs=1e-9)
            v[k] = np.sign(left) * coordinate
        assert float(energy) == pytest.approx(v @ M @ v / 2, rel=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_is_its_links(kind, imported):
    made = KINDS[kind]()
    system, said, err = imported(made, *(["--skid-steer-track", str(SKID[kind])] if kind in SKID else []))
    robot, links = system.mechanism, Links(exact(made.text))
    check(made, system, slips=kind in SKID)
    size, (mass, centre) = {p.name: p.default for p in robot.parameters}, links.centre_of_mass()
    assert size["m"] == pytest.approx(mass, rel=1e-9) and size["h"] == pytest.approx(centre[2], rel=1e-6)
    assert [size["d"], size.get("e", 0.0)] == pytest.approx(centre[:2].tolist(), abs=1e-6)
    assert {name: (s["ahead"], s["left"]) for name, s in said["supports"].items()} == {
        name: pytest.approx(tuple(place[:2]), abs=1e-9) for name, place in made.castors.items()
    }
    if made.castors and kind != "idle":
        balanced(robot, mass, centre)
    assert "warning" not in err and (
        ("sonar_link" in err and "camera_link" in err) or "sonar_link" not in made.text
    )
    vehicle = robot.vehicle
    assert [str(vehicle.x), str(vehicle.y), str(vehicle.heading)] == ["x", "y", "phi"]


def balanced(robot, mass: float, centre) -> None:
    """What the robot stands on carries its weight and the moments of it."""
    values = [p.default for p in robot.parameters]
    places = ca.horzcat(
        masses(robot),
        *[ca.vertcat(*[getattr(each, way) for each in robot.standing]) for way in ("ahead", "left")],
    )
    carried, ahead, left = ca.Function("f", [robot.p], [places])(values).full().T
    assert carried.min() > 0 and carried.sum() == pytest.approx(mass, rel=1e-9)
    assert [carried @ ahead / mass, carried @ left / mass] == pytest.approx(centre[:2].tolist(), abs=1e-6)


DRIVEN = """robot = "robot.py:bought"
gains = { kp = 4.0, kd = 5.0, kv = 2.0 }
contact = { mu = 0.7 }
output = { type = "IV", L = 0.1, path = { kind = "circle", x_f = 0.0, y_f = 0.0, R = 2.0 } }
reference = { speed = 0.4 }
initial = { point = [2.02, 0.0], heading = 1.6, speed = 0.3 }
sensors = { counts = 4096, pose = "reckoned" }
simulation = { duration = 4.0, period = 0.01 }
"""


@pytest.mark.nightly
@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_is_driven_in_the_engine(kind, imported, tmp_path, capsys):
    """Along a circle, by its own dead reckoning, on all that it stands on; wheels on several axles skid,
    as the engine says."""
    pytest.importorskip("mujoco")
    made = KINDS[kind]()
    imported(made, *(["--skid-steer-track", str(SKID[kind])] if kind in SKID else []))
    (tmp_path / "run.toml").write_text(DRIVEN)
    assert (
        main(
            [
                "simulate",
                str(tmp_path / "run.toml"),
                "--engine",
                "mujoco",
                "-o",
                str(tmp_path / "run.csv"),
                "--json",
            ]
        )
        == 0
    )
    said = json.loads(capsys.readouterr().out)
    stands, (mass, centre) = said["floor"]["stands"], Links(exact(made.text)).centre_of_mass()
    assert (stands["mass"], stands["height"]) == pytest.approx((mass, centre[2]), rel=1e-6)
    assert set(stands["castors"]) == set(made.castors) and sum(stands["loads"].values()) == pytest.approx(
        9.81 * mass, rel=1e-4
    )
    assert kind in SKID or abs(said["errors"]["distance"]["final"]) < 2e-3
    assert (said["floor"]["skids"] is None) == (kind not in SKID)


@pytest.mark.parametrize(
    "castors", [[(0.2, 0.0), (-0.2, 0.0)], [(0.2, 0.1), (0.2, -0.1), (-0.2, 0.0)]], ids=len
)
def test_castors_in_front_and_behind_carry_what_statics_says(castors, imported):
    """With the mass above the axle: on equal springs, which stay in a plane."""
    made = bought(castors=castors, centre=(0, 0, 0.1))
    robot = imported(made)[0].mechanism
    places = np.array([*([0, -0.2], [0, 0.2]), *castors])
    plane = np.column_stack([np.ones(len(places)), places])
    mass, centre = Links(made.text).centre_of_mass()
    springs = plane @ np.linalg.solve(plane.T @ plane, mass * np.array([1, *centre[:2]]))
    carried = ca.Function("f", [robot.p], [masses(robot)])([p.default for p in robot.parameters])
    assert carried.full()[:, 0] == pytest.approx(springs, rel=1e-9)
    balanced(robot, mass, centre)


def test_loads_of_a_tricycle_with_castors_balance_its_forces(imported):
    """Newton and Euler for the whole robot as one body, at any steering angle: what the forces on the ground,
    in the axes of the body, add to the loads, and their moments about the height of the centre of mass.
    """
    made = bought(castors=[(-0.1, 0.3), (-0.1, -0.3)], centre=(0.1, 0, 0.2), drive="none")
    add_castor(made, "idle", "steering_0", 0.6, 0.0)
    system, said, _ = imported(made)
    assert said["kind"] == "tricycle" and set(said["supports"]) == set(made.castors) - {"steering_0_wheel"}
    robot, random = system.mechanism, np.random.default_rng(5)
    values, names = [p.default for p in robot.parameters], [c.name for c in robot.coordinates]
    lying = [p.default * (p.name not in ("h", "h_s")) for p in robot.parameters]
    place = ca.horzcat(
        *[ca.vertcat(*[getattr(each, way) for each in robot.standing]) for way in ("ahead", "left")]
    )
    places = ca.Function("f", [robot.p], [place])(values).full()
    height = float(ca.Function("f", [robot.p], [robot.height])(values))
    for _ in range(5):
        x, tau = random.uniform(-1, 1, len(names) + system.dof), random.uniform(-3, 3, 2)
        high, flat = (
            contact_forces(Plant(system, p), x[None], tau[None], ContactSection()) for p in (values, lying)
        )
        change = np.array([a.load[0] - b.load[0] for a, b in zip(high, flat, strict=True)])
        delta, rear, front = x[names.index("delta")], *high[:2]
        along, across = front.longitudinal[0], front.lateral[0]
        pull = np.array([rear.longitudinal[0], rear.lateral[0]])
        pull += [
            np.cos(delta) * along - np.sin(delta) * across,
            np.sin(delta) * along + np.cos(delta) * across,
        ]
        assert np.abs(pull).max() > 0.1 and change.sum() == pytest.approx(0, abs=1e-9)
        assert places.T @ change == pytest.approx(-height * pull, abs=1e-9)


@pytest.mark.parametrize("kind", ["collision", "visual"])
def test_the_middle_of_a_tyre_with_a_shaft_is_that_of_its_rim(kind, tmp_path, imported, monkeypatch):
    """In one mesh in mm: a tyre from 0 to 25 mm along the axle, a shaft on to 80 mm. The check of import
    finds the middle of the whole mesh, which no mass matrix tells from that of the rim."""
    pytest.importorskip("trimesh")
    mesh_with_shaft(tmp_path, "wheel.stl")
    shown = "<collision>" if kind == "visual" else "<visual>"  # left with a box, which has no rim
    made = bought(
        axis="z",
        geometry='<mesh filename="package://bought/meshes/wheel.stl" scale="0.001 0.001 0.001"/>',
        castors=[(0.2, 0)],
    )
    (tmp_path / "meshes").mkdir()
    (tmp_path / "wheel.stl").rename(tmp_path / "meshes" / "wheel.stl")
    hidden = re.compile(f"{shown}(<origin[^>]*>)<geometry><mesh[^>]*></geometry>")
    made.parts = [
        hidden.sub(rf'{shown}\1<geometry><box size="0.01 0.01 0.01"/></geometry>', part)
        for part in made.parts
    ]
    for centre in made.wheels.values():
        centre[1] += 0.0125  # z is to the left
    system = imported(made)[0]
    size = {p.name: p.default for p in system.mechanism.parameters}
    assert (size["b"], size["r"]) == pytest.approx((0.2, 0.1), rel=1e-6)  # STL has 7 digits
    made.radius = size["r"]
    check(made, system)
    circle = recognition.rim
    monkeypatch.setattr(recognition, "rim", lambda *given: replace(circle(*given), along=0.04))
    assert main(["import", str(tmp_path / "robot.urdf"), "-o", str(tmp_path / "robot.py")]) == 2


@pytest.mark.parametrize("off, angle", [(1e-6, 0), (0, 3e-8), (1e-4, 1e-5), (5e-3, 9e-3)])
@pytest.mark.parametrize("toe", [False, True], ids=["camber", "toe"])
def test_joints_nearly_in_line_are_moved_into_line_and_said(off, angle, toe, imported):
    """By how much, and how far the mass matrix is from that of the file then."""
    radius = 0.05 if toe else 0.1
    straight, made = (bought(radius=radius, castors=[(0.2, 0)], centre=(0.03, 0, 0.1)) for _ in range(2))
    at = next(k for k, part in enumerate(made.parts) if 'joint name="wheel_left_joint"' in part)
    turn = f"0 0 {angle!r}" if toe else f"{angle!r} 0 0"
    made.parts[at] = (
        made.parts[at].replace('xyz="0.0 ', f'xyz="{off!r} ').replace('rpy="0 0 0"', f'rpy="{turn}"')
    )
    system, said, err = imported(made)
    moved, turned = re.search(r"joints were moved.*wheel_left_joint by (\S+) mm and (\S+) deg", err).groups()
    # each joint by half of what they differ by; with toe the heading is the mean of both wheels', which are
    # 0.2 m away
    assert float(moved) == pytest.approx(500 * off + toe * 100 * angle, rel=0.02)
    assert float(turned) == pytest.approx(np.degrees(angle) / (2 if toe else 1), rel=0.2)  # two digits
    assert said["mass_matrix_difference"] < 2 * off / 0.2 + 4 * angle
    size, other = (
        {p.name: p.default for p in each.mechanism.parameters} for each in (system, imported(straight)[0])
    )
    assert {name: size.get(name, 0.0) for name in other} == pytest.approx(
        other, rel=2 * off / radius + 3 * angle, abs=off + angle
    )


@pytest.mark.parametrize(
    "name", [n if n in ("car", "trailer") else pytest.param(n, marks=pytest.mark.nightly) for n in ROBOTS]
)
def test_every_robot_nearly_in_line_is_moved_into_line(name, tmp_path, capsys):
    """All joints but rollers' displaced and turned at random:
    what is written is compared with what was moved to 1e-9."""
    random = np.random.default_rng(11)

    def off(joint: re.Match) -> str:
        xyz, rpy = (np.array([float(word) for word in joint[k].split()]) for k in (2, 4))
        if "roller" in joint[1] or "fixed" in joint[1]:
            return joint[0]
        place, turn = xyz + random.uniform(-2e-4, 2e-4, 3), rpy + random.uniform(-5e-4, 5e-4, 3)
        return f"{joint[1]}{numbers(place)}{joint[3]}{numbers(turn)}"

    text = re.sub(
        r'(<joint name="[^>]*>(?:(?!</joint>).)*?<origin xyz=")([^"]*)(" rpy=")([^"]*)',
        off,
        ROBOTS[name]().text,
    )
    (tmp_path / "robot.urdf").write_text(text)
    track = ["--skid-steer-track", "0.8"] if name == "skid_steer" else []
    arm = ["--arm", "shoulder", "elbow"] if "arm" in name else []
    assert (
        main(
            ["import", str(tmp_path / "robot.urdf"), *track, *arm, "-o", str(tmp_path / "robot.py"), "--json"]
        )
        == 0
    )
    out, err = capsys.readouterr()
    assert "joints were moved" in err and 1e-9 < json.loads(out)["mass_matrix_difference"] < 0.02


def test_several_axles_are_not_taken_as_one(tmp_path, bad_input):
    """Two wheels out of line by more than a twentieth of their distance, and four on short axles."""
    for made, place in ((bought(), "0.0 0.2"), (bought(wheelbase=0.22), "0.11 0.2")):
        text = made.text.replace(f'xyz="{place}', f'xyz="{float(place.split()[0]) + 0.03!r} 0.2')
        (tmp_path / "robot.urdf").write_text(text)
        assert "skid steer" in bad_input(
            ["import", str(tmp_path / "robot.urdf"), "-o", str(tmp_path / "robot.py")]
        )


SWAPPED = {
    "wheel_{}": "wheel_right_joint, 0.2 m to the left; wheel_left_joint, 0.2 m to the right",
    "{}_wheel_link": "left_wheel_link_joint",
    "Wheel{}": "Wheelleft_joint",
}


@pytest.mark.parametrize("names", SWAPPED)
def test_names_that_contradict_sides_are_said(names, imported):
    def other(side: str) -> str:
        return names.format("right" if side == "left" else "left")

    made = bought(names=other, castors=[(0.2, 0)], centre=(0.03, 0, 0.1))
    system, said, err = imported(made)
    assert "warning: names contradict sides" in err and SWAPPED[names] in err and "places decide" in err
    check(made, system)
    assert "warning" not in imported(bought(names=names.format, castors=[(0.2, 0)], centre=(0.03, 0, 0.1)))[2]


@pytest.mark.parametrize(
    "name, side",
    [
        *(
            ("left_wheel", 1),
            ("wheel_right_joint", -1),
            ("front_left_wheel", 1),
            ("fl_wheel", 1),
            ("wheel_rr", -1),
            ("l_wheel_joint", 1),
        ),
        *(
            ("leftWheel", 1),
            ("RightWheelJoint", -1),
            ("base_wheelr_joint", -1),
            ("drivewheel", 0),
            ("link_3", 0),
            ("wheel_1", 0),
        ),
        *(
            ("left_of_right", 0),
            ("roller", 0),
            ("lr_wheel", 1),
            ("wheel_L", 1),
            ("WHEEL_RIGHT", -1),
            ("Rad_größe", 0),
        ),
    ],
)
def test_sides_of_names(name, side):
    assert recognition._side(name) == side


def test_masses_that_are_missing_are_named_at_once(tmp_path, bad_input, imported):
    """Sensors without mass are said; wheels and a chassis are refused, all in one line."""
    made = bought(castors=[(0.2, 0)], more=sensors)
    _, _, err = imported(made)
    assert "of no weight: links sonar_link, camera_link" in err
    file = tmp_path / "robot.urdf"

    def line(text: str) -> str:
        file.write_text(text)
        return bad_input(["import", str(file), "-o", str(tmp_path / "robot.py")])

    def bare(text: str, *links: str) -> str:
        for link in links:
            text = re.sub(f'(<link name="{link}">)<inertial>.*?</inertial>', r"\1", text)
        return text

    said = line(bare(made.text, "base_link", "wheel_left"))
    assert (
        "links without mass: 'wheel_left' (a wheel), 'base_link' (the chassis)" in said
        and "sonar_link, camera_link" in said
    )
    assert "'base_link' (the chassis)" in line(made.text.replace('value="8.0"', 'value="0"'))
    # the chassis is fixed below an empty base_link that carries the wheels, and only a sensor has a mass
    below = bare(made.text, "base_link").replace(
        '<link name="base_link">', '<link name="base_link"></link><link name="body">', 1
    )
    below = below.replace(
        "</robot>",
        '<joint name="b" type="fixed"><parent link="base_link"/><child link="body"/></joint></robot>',
    )
    assert "'body' (the chassis)" in line(re.sub(r'<mass value="0.5"/>', '<mass value="0.1"/>', below))


def test_a_link_without_shape_may_have_the_inertia_of_the_chassis(recognized):
    """Fixed to it, as where the root must not have one: the same robot, unless that link has a shape,
    as a sensor has."""
    made = bought(castors=[(0.2, 0)], centre=(0.05, 0, 0.1))
    whole, _ = recognized(made)
    at = next(k for k, part in enumerate(made.parts) if part.startswith('<link name="base_link">'))
    inertial, rest = re.fullmatch(
        r'<link name="base_link">(<inertial>.*</inertial>)(.*)</link>', made.parts[at], re.S
    ).groups()
    joint = '<joint name="i" type="fixed"><parent link="base_link"/><child link="inertia"/></joint>'
    made.parts[at : at + 1] = [
        f'<link name="base_link">{rest}</link>',
        f'<link name="inertia">{inertial}</link>',
        joint,
    ]
    apart, said = recognized(made)
    for name in ("mass", "ahead", "left", "height", "inertia"):
        assert getattr(apart.base, name) == pytest.approx(getattr(whole.base, name), rel=1e-12, abs=1e-15)
    assert "without mass" not in said
    made.parts[at + 1] = made.parts[at + 1].replace(
        "</inertial>", "</inertial>" + shape('<sphere radius="0.02"/>')
    )
    with pytest.raises(BadInput, match=r"without mass: 'base_link' \(the chassis\)"):
        recognized(made)


def test_a_wheel_that_is_steered_on_its_axle_is_refused(recognized):
    """A car whose front wheels turn first, and are steered on what turns:
    no differential drive whose front wheels drag."""
    made = bought(centre=(0.1, 0, 0.1))
    disc = shape('<cylinder radius="0.1" length="0.02"/>', rpy="1.5707963267948966 0 0")
    for side, left in (("left", 0.2), ("right", -0.2)):
        made.link(f"{side}_hub", 0.1, moments=(1e-4,) * 3)
        made.joint(
            f"front_{side}_wheel", "continuous", "base_link", f"{side}_hub", (0.5, left, 0.08), axis="0 1 0"
        )
        made.link(f"front_{side}", 0.3, disc, moments=(1e-3,) * 3)
        made.joint(f"{side}_steering", "revolute", f"{side}_hub", f"front_{side}", axis="0 0 1")
    with pytest.raises(
        BadInput, match="link 'front_left' lies on the ground as a wheel does, and joint 'front_left_wheel'"
    ):
        recognized(made)
    layout, _ = recognized(made, Options(castors=("front_left", "front_right")))  # said to slide
    assert layout.kind == "two wheels" and [*layout.castors] == ["front_left", "front_right"]
    made.parts = [part.replace('"continuous"', '"fixed"') if "_hub" in part else part for part in made.parts]
    with pytest.raises(BadInput, match="joint 'left_steering'"):
        recognized(made)


def test_transmissions_decide_between_a_castor_and_a_steered_wheel(recognized):
    """A swivel above its wheel, that nothing drives: with both wheels driven it is a castor,
    otherwise it steers."""
    for drive, kind in (
        ("transmission", "two wheels"),
        ("ros2_control", "two wheels"),
        ("gazebo", "two wheels"),
        ("none", "tricycle"),
    ):
        made = bought(castors=[(0.25, 0)], castor="idle", centre=(0.05, 0, 0.1), drive=drive)
        layout, err = recognized(made)
        assert layout.kind == kind and ("is taken as a castor's" in err) == (kind == "two wheels"), drive


def test_what_is_doubtful_is_said(tmp_path, recognized):
    """Units, a wheel above the floor, radii that differ, castors whose shapes are not found."""
    trimesh = pytest.importorskip("trimesh")
    _, err = recognized(bought(radius=100.0, track=400.0, castors=[(200.0, 0)]))
    assert "the wheels are 400 m apart" in err and "in other units?" in err
    made = bought(castors=[(0.2, 0)])
    made.parts = [part.replace('xyz="0.0 -0.2 0.08"', 'xyz="0.0 -0.2 0.085"') for part in made.parts]
    assert "wheel_right_joint: its rim is 0.005 m above the ground" in recognized(made)[1]
    made = bought(castors=[(0.2, 0)])
    at = next(k for k, part in enumerate(made.parts) if 'link name="wheel_left"' in part)
    before, visual, after = made.parts[at].partition("<visual>")
    made.parts[at] = before + visual + after.replace('radius="0.1"', 'radius="0.17"')
    assert (
        "wheel_left_joint: the radius of its wheel is 0.1 m by link wheel_left, collision cylinder, but 0.17 "
        "m by" in recognized(made)[1]
    )
    made = bought(castors=[(0.2, 0)], castor="box")
    ball = '<mesh filename="ball.stl" scale="0.001 0.001 0.001"/>'
    made.parts = [part.replace('<box size="0.03 0.03 0.08"/>', ball) for part in made.parts]
    layout, err = recognized(made)
    assert layout.castors == {} and "links named as castors carry nothing" in err and "caster_0_link" in err
    layout, err = recognized(made, Options(castors=["caster_0_link"]))
    assert (
        layout.castors["caster_0_link"][0] == pytest.approx(0.2)
        and "it is taken to stand below its origin" in err
    )
    trimesh.creation.icosphere(radius=40.0).export(tmp_path / "ball.stl")
    layout, err = recognized(made)
    assert layout.castors["caster_0_link"][0] == pytest.approx(0.2, abs=1e-3) and "nothing" not in err
    made = bought(castors=[(0.2, 0)], mass=8.0)
    made.parts = [
        re.sub(r'(link name="base_link".*?izz=")[0-9.]*', r"\g<1>480000", part) for part in made.parts
    ]
    assert "is it in other units, such as kg mm^2?" in recognized(made)[1]


MECANUM_MJCF = """<mujoco model="rover">
  <asset><mesh name="{name}" file="wheel.stl"/></asset>
  <worldbody><body name="base" pos="0 0 0.1"><freejoint/><geom type="box" size="0.3 0.2 0.05" mass="8"/>
    {wheels}
  </body></worldbody>
</mujoco>"""


def test_wheels_with_rollers_by_the_name_of_their_mesh_are_asked_for_rollers(tmp_path, bad_input, imported):
    """Before a skid steer is offered; in an MJCF, too, whose meshes are read. Plain wheels of the same names
    are named."""
    trimesh = pytest.importorskip("trimesh")
    mesh = shape('<mesh filename="package://base/meshes/Mecanum_{}.dae"/>', kinds=["visual"])
    made = bought(wheelbase=0.5, geometry='<cylinder radius="0.1" length="0.03"/>')
    file = tmp_path / "robot.urdf"
    file.write_text(re.sub(r'(<link name="wheel_.*?)</link>', rf"\1{mesh}</link>", made.text))
    assert "give the direction of the axis of the roller" in bad_input(
        ["import", str(file), "-o", str(tmp_path / "robot.py")]
    )
    pytest.importorskip("mujoco")
    trimesh.creation.cylinder(0.1, 0.04, sections=48).export(tmp_path / "wheel.stl")
    at = [(x, y) for x in (0.25, -0.25) for y in (0.2, -0.2)]
    for name, said in (
        ("mecanum_left", "give the direction of the axis of the roller"),
        ("wheel", "--skid-steer-track METRES"),
    ):
        wheels = "".join(
            f'<body name="w{k}" pos="{x} {y} 0"><joint name="w{k}" axis="0 1 0"/>'
            f'<geom type="mesh" mesh="{name}" euler="90 0 0" mass="0.5"/></body>'
            for k, (x, y) in enumerate(at)
        )
        (tmp_path / "scene.xml").write_text(MECANUM_MJCF.format(name=name, wheels=wheels))
        assert said in bad_input(["import", str(tmp_path / "scene.xml"), "-o", str(tmp_path / "robot.py")])


def test_fixed_links_are_one_body(imported, tmp_path):
    """However many: what import compares moves with three bodies, in time that grows with their number."""
    made = bought(castors=[(0.2, 0)])
    for k in range(300):
        made.fixed(f"bolt_{k}", f"bolt_{k - 1}" if k % 50 else "base_link", (0.001, 0, 0.001), 0.001)
    system, _, _ = imported(made)
    check(made, system)
    layout = recognize(read(str(tmp_path / "robot.urdf")), Options())
    assert set(LinkMotion(layout).tops) == {"base_footprint", "wheel_left", "wheel_right"}


@pytest.mark.nightly
def test_files_are_utf_8_whatever_the_locale(tmp_path):
    made = bought(castors=[(0.2, 0)], names=lambda side: f"Rad_größe_{side}")
    (tmp_path / "robot.urdf").write_text(made.text, encoding="utf-8")
    script = "import sys; from noslip.cli.main import main; sys.exit(main())"
    ascii_only = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    done = subprocess.run(
        [sys.executable, "-c", script, "import", "robot.urdf", "-o", "robot.py"],
        cwd=tmp_path,
        env={**os.environ, **ascii_only},
        capture_output=True,
    )
    assert done.returncode == 0, done.stderr
    assert "Rad_größe_left_joint" in (tmp_path / "robot.py").read_text(encoding="utf-8")
