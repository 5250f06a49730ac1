"""`noslip import`: robot files from URDFs, against the URDFs' own links in space,
by our kinematics and by Pinocchio's."""

import json
import os
import re
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from noslip.cli.main import main
from noslip.model.reduction import ReducedSystem
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_laws, find_robot, system_of
from noslip.readers.urdf.comparison import compare
from noslip.readers.urdf.document import read
from noslip.readers.urdf.importing import SAME
from noslip.readers.urdf.parts import Layout, Options
from noslip.readers.urdf.recognition import recognize
from noslip.readers.urdf.text import name_of, robot_file
from noslip.simulation.contact import contact_forces
from noslip.simulation.plant import Plant
from noslip.simulation.specification.spec import ContactSection
from noslip.tests.urdf_links import Links
from noslip.tests.urdfs import (
    BESIDE,
    QUARTER,
    ROBOTS,
    WHEEL,
    Urdf,
    four_wheels,
    mecanum,
    steered,
    trailers,
    turtlebot3,
    two_wheels,
    with_arm,
)

pytestmark = pytest.mark.skipif(
    find_spec("yourdfpy") is None, reason="yourdfpy, of the extra `physics`, reads URDFs"
)
STATES = 5


def written(folder: Path, urdf: Urdf) -> str:
    file = folder / f"{urdf.name}.urdf"
    file.write_text(urdf.text)
    return str(file)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """By name, the robot of the file that is written for a URDF, and what the URDF was recognized as."""

    @cache
    def made(name: str) -> tuple[ReducedSystem, Layout]:
        folder = tmp_path_factory.mktemp(name)
        layout = recognize(read(written(folder, ROBOTS[name]())), options(name))
        file = folder / f"{name}.py"
        file.write_text(robot_file(layout))
        return system_of(find_robot(f"{file}:{name_of(layout.document.name)}")), layout

    return made


def options(name: str) -> Options:
    """What is named on the command line for the URDFs in tests/urdfs.py."""
    return Options(
        track=0.8 if name == "skid_steer" else None, arm=("elbow", "shoulder") if "arm" in name else ()
    )


def along(angle: ca.SX) -> ca.SX:
    return ca.vertcat(ca.cos(angle), ca.sin(angle))


def rates(name: str, q: dict, qdot: dict) -> dict[str, ca.SX]:
    """The rate of every joint of the URDFs in tests/urdfs.py, written down by hand from their sizes;
    wheels have radius 0.1 m."""
    if "arm" in name:
        below = {"arm": "two_wheels", "arm_on_rollers": "mecanum", "arm_on_a_car": "car"}[name]
        return rates(below, q, qdot) | {"shoulder": qdot["q_1"], "elbow": -qdot["q_2"], "wrist": 0}
    forward = ca.cos(q["phi"]) * qdot["x"] + ca.sin(q["phi"]) * qdot["y"]
    if name == "skid_steer":
        return {
            f"{end}_{side}_joint": qdot[f"theta_{side[0]}"]
            for end in ("front", "rear")
            for side in ("left", "right")
        }
    if name == "mecanum":
        found = {f"{end}_left_joint": -qdot[f"theta_{end[0]}l"] for end in ("front", "rear")}
        found |= {f"{end}_right_joint": qdot[f"theta_{end[0]}r"] for end in ("front", "rear")}
        return found | {f"{wheel[:-6]}_roller_{k}_joint": 0 for wheel in found for k in range(8)}
    if "delta" not in q:
        found = {"left_joint": qdot["theta_l"], "right_joint": -qdot["theta_r"], "lidar_joint": 0}
        count = sum(coordinate.startswith("phi_") for coordinate in q)
        axle = ca.vertcat(q["x"], q["y"]) - 0.1 * along(q["phi"])  # here still the hitch
        for k in range(1, count + 1):
            # The last hangs on a joint that is upside down
            heading, sign = q[f"phi_{k}"], -1 if k == count else 1
            found[f"hitch_{k}"] = sign * (qdot[f"phi_{k}"] - qdot[f"phi_{k - 1}" if k > 1 else "phi"])
            axle = axle - 0.5 * along(heading)
            for side, left in (("left", 0.15), ("right", -0.15)):
                centre = axle + left * along(heading + QUARTER)
                velocity = sum(ca.jacobian(centre, q[c]) * qdot[c] for c in q)
                found[f"{side}_{k}_joint"] = sign * ca.dot(along(heading), velocity) / 0.1
        return found
    driven_in_front = name == "tricycle"
    sideways = ca.cos(q["phi"]) * qdot["y"] - ca.sin(q["phi"]) * qdot["x"]
    front = (ca.cos(q["delta"]) * forward + ca.sin(q["delta"]) * (sideways + 0.8 * qdot["phi"])) / 0.1
    rolling = forward / 0.1 if driven_in_front else qdot["theta"]
    found = {"left_joint": -(rolling - 3 * qdot["phi"]), "right_joint": rolling + 3 * qdot["phi"]}
    for side, sign in (("_left", -1), ("_right", 1)) if name == "car" else (("", 1),):
        found[f"steering{side}"] = sign * qdot["delta"]
        found[f"front{side}_joint"] = qdot["theta"] if driven_in_front else front
    return found


@pytest.mark.parametrize("name", ROBOTS)
def test_mass_matrix_and_bias_are_those_of_pinocchio(name, made):
    """Of the URDF as a free flyer, with the velocities that the constraints allow:
    T'M T and T'(M Tdot nu + h)."""
    pin = pytest.importorskip("pinocchio", reason="Pinocchio (pin) is not installed")
    system, _ = made(name)
    robot = system.mechanism
    model = pin.buildModelFromXML(ROBOTS[name]().text, pin.JointModelFreeFlyer())
    q = {c.name: c.symbol for c in robot.coordinates}
    qdot = dict(zip(q, ca.vertsplit(system.qdot), strict=True))
    c, s = ca.cos(q["phi"]), ca.sin(q["phi"])
    given = rates(name, q, qdot)
    joints = [given[model.names[k]] for k in range(2, model.njoints)]  # 0 is the world, 1 the free flyer
    v = ca.vertcat(
        c * qdot["x"] + s * qdot["y"], c * qdot["y"] - s * qdot["x"], 0, 0, 0, qdot["phi"], *joints
    )
    T = ca.jacobian(v, system.nu)
    Tdot = ca.jtimes(T, robot.q, system.qdot)
    f = ca.Function(
        "f", [robot.q, system.nu, robot.p], [ca.densify(e) for e in (T, Tdot, system.Mbar, system.bias)]
    )
    names = [model.names[k] for k in range(2, model.njoints)]
    position = ca.Function("position", [robot.q], [ca.vertcat(*positions(names, q))])
    values, random, data = [p.default for p in robot.parameters], np.random.default_rng(5), model.createData()
    for _ in range(STATES):
        state, nu = random.uniform(-1.2, 1.2, len(q)), random.uniform(-2, 2, system.dof)
        T_, Tdot_, Mbar, bias = (value.full() for value in f(state, nu, values))
        x, y, phi = (state[list(q).index(each)] for each in ("x", "y", "phi"))
        displaced = np.concatenate([[0.0] * 6, position(state).full()[:, 0]])
        configuration = pin.integrate(model, pin.neutral(model), displaced)
        configuration[:7] = [x, y, 0.0, 0.0, 0.0, np.sin(phi / 2), np.cos(phi / 2)]
        M = pin.crba(model, data, configuration)
        M = np.triu(M) + np.triu(M, 1).T
        wanted = T_.T @ M @ T_
        assert np.abs(Mbar - wanted).max() < 1e-10 * np.abs(wanted).max()
        h = pin.nonLinearEffects(model, data, configuration, T_ @ nu)
        wanted = T_.T @ (M @ (Tdot_ @ nu) + h)
        assert np.abs(bias[:, 0] - wanted).max() < 1e-10 * max(np.abs(wanted).max(), np.abs(h).max())


def positions(names: list[str], q: dict) -> list:
    """The angle of every joint; those of wheels do not matter, except that they turn."""
    known = {"steering": q.get("delta"), "steering_right": q.get("delta"), "lidar_joint": 0}
    known["steering_left"] = -q["delta"] if "delta" in q else None
    if "q_1" in q:
        known |= {"shoulder": q["q_1"], "elbow": -q["q_2"], "wrist": 0}
    if "phi_2" in q:
        known |= {"hitch_1": q["phi_1"] - q["phi"], "hitch_2": -(q["phi_2"] - q["phi_1"])}
    elif "phi_1" in q:
        known["hitch_1"] = q["phi"] - q["phi_1"]
    return [known.get(joint, 0.3 * k) for k, joint in enumerate(names)]


@pytest.mark.parametrize("name", ROBOTS)
def test_mass_matrix_is_that_of_the_links(name, made):
    """As with Pinocchio, T'M T, of links that are put together here."""
    system, _ = made(name)
    robot, links = system.mechanism, Links(ROBOTS[name]().text)
    q = {c.name: c.symbol for c in robot.coordinates}
    qdot = dict(zip(q, ca.vertsplit(system.qdot), strict=True))
    c, s, given = ca.cos(q["phi"]), ca.sin(q["phi"]), rates(name, q, qdot)
    forward, left = c * qdot["x"] + s * qdot["y"], c * qdot["y"] - s * qdot["x"]
    v = ca.vertcat(forward, left, 0, 0, 0, qdot["phi"], *[given[joint] for joint in links.moving])
    T, angles = ca.jacobian(v, system.nu), ca.vertcat(*positions(links.moving, q))
    f = ca.Function("f", [robot.q, system.nu, robot.p], [ca.densify(e) for e in (T, angles, system.Mbar)])
    values, random = [p.default for p in robot.parameters], np.random.default_rng(5)
    for _ in range(STATES):
        state, nu = random.uniform(-1.2, 1.2, len(q)), random.uniform(-2, 2, system.dof)
        T_, at, Mbar = (value.full() for value in f(state, nu, values))
        wanted = T_.T @ links.mass_matrix(dict(zip(links.moving, at[:, 0], strict=True))) @ T_
        assert np.abs(Mbar - wanted).max() < 1e-10 * np.abs(wanted).max()


@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_file_is_the_urdf(name, made):
    """Its mass matrix is that of the links in space, and where each wheel has its own constraint no rim
    slips."""
    system, layout = made(name)
    difference, slip = compare(system, layout)
    assert difference < SAME / 100 and (slip is None or slip < SAME / 100)
    assert (slip is None) == (name in ("car", "skid_steer", "arm_on_a_car"))
    assert abs(sum(layout.shares.values()) - 1) < 0.35  # castors carry the rest


@pytest.mark.parametrize("changed", [("I_z", 0.5), ("b", 0.21), ("e", 0.0)], ids=lambda c: c[0])
def test_a_changed_number_is_found(changed, made, tmp_path):
    name, value = changed
    _, layout = made("two_wheels")
    lines = robot_file(layout).splitlines()
    at = next(k for k, line in enumerate(lines) if line.strip().startswith((f"{name} =", f"{name}_r =")))
    before, comma, after = lines[at].partition(", ")
    lines[at] = f"{before}{comma}{value}, {after.partition(', ')[2]}"
    file = tmp_path / "changed.py"
    file.write_text("\n".join(lines))
    difference, slip = compare(system_of(find_robot(f"{file}:cart")), layout)
    assert max(difference, slip) > 1e4 * SAME


def test_two_wheels_have_the_laws_of_labmate(tmp_path, capsys):
    target = tmp_path / "cart.py"
    assert main(["import", written(tmp_path, two_wheels()), "-o", str(target), "--json"]) == 0
    out, err = capsys.readouterr()
    said = json.loads(out)
    assert (
        said["robot"] == "cart"
        and said["castors"] == ["castor"]
        and list(said["wheels"]) == ["right_joint", "left_joint"]
    )
    assert "castor" in err and "lidar_joint" in err and len(err.splitlines()) == len(said["notes"]) == 2
    assert said["mass_matrix_difference"] < SAME
    laws = find_laws(system_of(find_robot(f"{target}:cart")))
    assert {"type_i", "type_ii", "type_iii", "type_iv_line", "type_iv_circle"} <= set(laws)
    text = target.read_text()
    assert "links base, box" in text and "castor" in text and "lidar_joint" in text
    total = sum(wheel["load"] for wheel in said["wheels"].values())
    # by hand: the moments about the axle of the weight of all links, held by the castor 0.25 m ahead
    ahead = said["parameters"]["d"]["default"]
    assert total == pytest.approx(1 - ahead / 0.25, rel=1e-11)


@pytest.mark.parametrize("model", ["burger", "waffle_pi"])
def test_the_shipped_turtlebot3_is_its_links(model, tmp_path):
    """Mass matrix, bias and loads at random states: those of the robot that is imported from its maker's
    numbers."""
    layout = recognize(read(written(tmp_path, turtlebot3(model))), Options())
    shipped = f"turtlebot3_{model}"
    file = tmp_path / f"{shipped}.py"
    file.write_text(robot_file(layout))
    found = []
    for name in (shipped, f"{file}:{shipped}"):
        system = system_of(find_robot(name))
        robot, random = system.mechanism, np.random.default_rng(3)
        loads = ca.vertcat(*[contact.mass for contact in robot.contacts])
        f = ca.Function(
            "f", [robot.q, system.nu, robot.p], [ca.densify(e) for e in (system.Mbar, system.bias, loads)]
        )
        states = [(random.uniform(-2, 2, 5), random.uniform(-5, 5, 2)) for _ in range(STATES)]
        found.append(
            [
                np.vstack([v.full().reshape(-1, 1) for v in f(*s, [p.default for p in robot.parameters])])
                for s in states
            ]
        )
    assert np.allclose(*found, rtol=1e-10, atol=0)


def replaced(old: str, new: str, urdf=two_wheels, count: int = 1):
    def text() -> str:
        found = urdf().text
        assert old in found
        return found.replace(old, new, count)

    return text


def without_inertial(link: str, urdf=two_wheels):
    def text() -> str:
        before, name, after = urdf().text.partition(f'<link name="{link}">')
        return before + name + after.partition("</inertial>")[2]

    return text


MESH = '<geometry><mesh filename="package://cart/left.stl"/></geometry>'
CYLINDER = '<geometry><cylinder radius="0.1" length="0.04"/></geometry>'
BAD = {
    "broken": (replaced("</link>", "</lnk>"), "not XML"),
    "not a urdf": (lambda: "<sdf/>", "first element is <sdf>"),
    "empty": (lambda: "", "not XML"),
    "no links": (lambda: '<robot name="a"/>', "no links"),
    "no name": (replaced(' name="cart"', ""), "<robot> has no name"),
    "xacro": (replaced('value="8.0"', 'value="${mass}"'), "line 3: a xacro file; expand it with `xacro"),
    "wheels that do not turn": (
        lambda: two_wheels().text.replace('"right_joint" type="continuous"', '"right_wheel" type="fixed"'),
        "joint 'right_wheel' is fixed; if it is a wheel, make it continuous",
    ),
    "rollers on a swivel": (
        lambda: swivelled().text.replace(
            '"base"/><child link="rear_left"/>', '"swivel"/><child link="rear_left"/>'
        ),
        "joint 'rear_left_joint' is a wheel with rollers on the vertical joint 'swivel_joint'; make that "
        "fixed",
    ),
    "no wheel inertia": (
        without_inertial("left"),
        "links without mass: 'left' (a wheel); give each its mass and inertia by <inertial>",
    ),
    "no inertia": (lambda: "<robot name='a'><link name='base'/></robot>", "no link has an <inertial>"),
    "no izz": (replaced(' izz="', ' i_zz="'), "link 'base', line 3: <inertia> has no izz"),
    "zero mass": (replaced('mass value="8.0"', 'mass value="0"'), "links without mass: 'base' (the chassis)"),
    "negative mass": (replaced('mass value="8.0"', 'mass value="-1"'), "link 'base': its mass is -1 kg"),
    "nan": (replaced('mass value="8.0"', 'mass value="nan"'), "link 'base', line 3: value='nan'"),
    "words": (replaced('mass value="8.0"', 'mass value="heavy"'), "value='heavy'"),
    "two numbers": (replaced('origin xyz="0.25 0.0 0.03"', 'origin xyz="0.25 0.03"'), "joint 'castor_joint'"),
    "impossible inertia": (
        replaced('<inertia ixx="', '<inertia ixx="-9'),
        "link 'base': its inertia has a negative principal moment",
    ),
    "no wheels": (replaced('type="continuous"', 'type="fixed"', count=9), "no wheel found"),
    "one wheel": (replaced('type="continuous"', 'type="fixed"'), "left_joint"),
    "tilted": (
        replaced('axis xyz="0.0 0.0 -1.0"', 'axis xyz="0.0 0.3 -1.0"'),
        "joint 'right_joint': its axis is 16.7 deg from horizontal",
    ),
    "toe": (
        replaced(f'rpy="{WHEEL}"', f'rpy="{WHEEL}.3"'),
        "'right_joint' and 'left_joint' differ by 17.2 deg",
    ),
    "cylinder askew": (
        replaced('axis xyz="0.0 0.0 -1.0"', 'axis xyz="0.3 0.0 -1.0"'),
        "link 'right': its cylinder is not centred on the axle",
    ),
    "no axis": (
        replaced('<axis xyz="0.0 0.0 -1.0"/>', ""),
        "; without <axis>, so that it is 1 0 0: joints 'right_joint'",
    ),
    "axis zero": (
        replaced('axis xyz="0.0 0.0 -1.0"', 'axis xyz="0 0 0"'),
        "joint 'right_joint': its axis has length zero",
    ),
    "no mesh": (
        replaced(CYLINDER, MESH),
        "link 'right': its mesh package://cart/left.stl is not found; give its radius by --radius right=",
    ),
    "cylinder across": (
        replaced(f"<collision>{CYLINDER}", f'<collision><origin rpy="1 0 0"/>{CYLINDER}'),
        "not along the axle",
    ),
    "radius zero": (replaced(CYLINDER, CYLINDER.replace("0.1", "0", 1)), "the radius of its cylinder is 0 m"),
    "twice": (replaced('link name="box"', 'link name="base"'), "link 'base' is defined twice"),
    "no parent": (
        replaced('parent link="base"', 'parent link="bass"'),
        "its parent is no link: 'bass'; did you mean 'base'?",
    ),
    "two roots": (replaced('<link name="box">', '<link name="loose"/><link name="box">'), "have no parent"),
    "two carriers": (
        replaced('child link="castor"', 'child link="box"'),
        "link 'box' is the child of joints",
    ),
    "type": (replaced('type="continuous"', 'type="spinning"'), "unknown type 'spinning'"),
    "floating": (
        replaced('"lidar_joint" type="continuous"', '"lidar_joint" type="floating"'),
        "joint 'lidar_joint' is floating",
    ),
    "mecanum": (
        replaced(CYLINDER, MESH.replace("left", "mecanum")),
        "joint 'right_joint': 'package://cart/mecanum.stl' is a wheel with rollers (mecanum or "
        "omnidirectional)",
    ),
    "unlike rollers": (
        replaced('sphere radius="0.02"', 'box size="1 1 1"', mecanum),
        "give the radius of the wheel by --radius",
    ),
    "three with rollers": (
        lambda: three_with_rollers(),
        "are wheels with rollers; a robot file describes four",
    ),
    "roller askew": (
        replaced('axis xyz="0.5000000000000001', 'axis xyz="0.3', mecanum),
        "its rollers are not alike",
    ),
    "skid": (lambda: four_wheels().text, "--skid-steer-track METRES"),
    "unbalanced": (
        replaced('xyz="0.0 0.0 0.01" rpy="0.0 0.0 0.3"', 'xyz="0.05 0.0 0.01"'),
        "centre of mass is 50% of the radius away",
    ),
    "limits": (replaced('lower="-1.0"', 'lower="0.5"', urdf=lambda: lifted()), "beyond its limits 0.5 to 1"),
    "apart": (
        lambda: apart().text,
        "joint 'steering_left' mimics 'steering_right' by 1: the wheels turn apart",
    ),
    "two pairs": (lambda: crab().text, "joints 'steering', 'steering_rear' steer wheels"),
}


def three_with_rollers() -> str:
    return "\n".join(line for line in mecanum().text.splitlines() if '="rear_left' not in line)


def swivelled() -> Urdf:
    made = mecanum()
    made.link("swivel", 0.1)
    made.joint("swivel_joint", "continuous", "base", "swivel")
    return made


def lifted() -> Urdf:
    made = two_wheels()
    made.link("mast", 0.1)
    made.joint("lift", "prismatic", "base", "mast", (0, 0, 0.5))
    return made


def apart() -> Urdf:
    """A car whose joints of steering turn about opposite axes by the same angle."""
    made = steered(pair=True)
    at = next(k for k, part in enumerate(made.parts) if 'joint name="steering_left"' in part)
    made.parts[at] = made.parts[at].replace("</joint>", '<mimic joint="steering_right"/></joint>')
    return made


def crab() -> Urdf:
    """A tricycle with a second steered wheel behind."""
    made = steered(pair=False)
    made.link("rear_knuckle", 0.4)
    made.joint("steering_rear", "revolute", "base", "rear_knuckle", (-0.8, 0, 0.1))
    made.wheel("rear", "rear_knuckle", (0, 0, 0))
    return made


def test_a_wheel_ahead_of_its_steering_axis_stands_where_it_is(tmp_path):
    """At any steering angle."""
    file = tmp_path / "trike.urdf"
    file.write_text(steered(pair=False, front=True, ahead=0.07).text)
    assert main(["import", str(file), "-o", str(tmp_path / "trike.py")]) == 0
    robot = system_of(find_robot(f"{tmp_path}/trike.py:trike")).mechanism
    front = robot.contacts[1]
    place = ca.Function("place", [robot.q, robot.p], [front.ahead])
    values = [p.default for p in robot.parameters]
    for delta in (-0.9, 0.0, 0.4):
        q = [delta if name == "delta" else 0.3 for name in (c.name for c in robot.coordinates)]
        assert float(place(q, values)) == pytest.approx(0.8 + 0.07 * np.cos(delta), abs=1e-12)


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line(case, tmp_path, bad_input):
    text, said = BAD[case]
    file = tmp_path / "robot.urdf"
    file.write_text(text())
    line = bad_input(["import", str(file), "-o", str(tmp_path / "robot.py")])
    assert str(file) in line and said in line


@pytest.mark.parametrize(
    "more, said",
    [
        (["--wheels", "lefty_joint"], "no 'lefty_joint'; did you mean 'left_joint'?"),
        (["--wheels", "castor_joint", "left_joint"], "joint 'castor_joint' cannot be a wheel: it is fixed"),
        (
            ["--wheels", "lidar_joint"],
            "joint 'lidar_joint' cannot be a wheel: its axis is 90 deg from horizontal",
        ),
        (
            ["--castors", "left_joint"],
            "wheels on 'base', without castors and those on vertical joints: 'right_joint'",
        ),
        (["--castors", "box"], "--castors: link 'box'"),
        (["--arm", "lidar"], "there is no 'lidar'; did you mean 'lidar_joint'?"),
        (["--arm", "left_joint"], "--arm: joint 'left_joint' carries the wheel 'left'"),
        (["--arm", "box_joint"], "--arm: joint 'box_joint' is fixed; those of an arm turn"),
        (["--radius", "left"], "give LINK=METRES"),
        (["--radius", "left=-1"], "--radius left = -1 must be positive"),
        (["--radius", "door=1"], "there is no 'door'"),
        (["--skid-steer-track", "1.0"], "on one axle"),
        (["--skid-steer-track", "1 kg"], "--skid-steer-track"),
    ],
)
def test_bad_options_are_one_line(more, said, tmp_path, bad_input):
    assert said in bad_input(
        ["import", written(tmp_path, two_wheels()), *more, "-o", str(tmp_path / "robot.py")]
    )


def test_an_inertia_that_no_body_has_is_noted(tmp_path, capsys):
    """A principal moment of the left wheel above the sum of the others."""
    made = two_wheels()
    at = next(k for k, part in enumerate(made.parts) if 'link name="left"' in part)
    made.parts[at] = re.sub(r'izz="[^"]*"', 'izz="0.9"', made.parts[at])
    assert main(["import", written(tmp_path, made), "-o", str(tmp_path / "cart.py")]) == 0
    assert (
        "no body has such an inertia, with a principal moment above the sum of the others; correct "
        "<inertia>: links left\n" in (capsys.readouterr().err)
    )


def test_a_chassis_that_stands_on_a_ball_of_its_own(tmp_path, capsys):
    """It is no castor apart, and its part of the weight is there; of two <inertial> the first counts,
    as in ROS, and is said."""

    def solid(mass: float, shape: str, more: str = "") -> str:
        inertial = (
            f'<inertial><mass value="{mass}"/><inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" '
            'izz="1e-3"/></inertial>'
        )
        return f"{inertial}{more}<collision>{shape}</collision>"

    disc = '<geometry><cylinder radius="0.05" length="0.01"/></geometry>'
    ball = '<collision><origin xyz="-0.1 0 0.02"/><geometry><sphere radius="0.02"/></geometry></collision>'
    axle = {
        side: f'<joint name="{side}" type="continuous"><origin xyz="0.02 {y} 0.05" rpy="-1.5707963267948966 '
        f'0 0"/><parent link="base"/><child link="{side}_wheel"/><axis xyz="0 0 1" rpy="0 '
        f'0"/></joint><link name="{side}_wheel">{solid(0.1, disc)}</link>'
        for side, y in (("left", 0.1), ("right", -0.1))
    }
    box = '<origin xyz="0 0 0.06"/><geometry><box size="0.2 0.2 0.05"/></geometry>'
    base = f'<link name="base">{solid(3.0, box, solid(9.0, disc).partition("<collision>")[0])}{ball}</link>'
    (tmp_path / "cart.urdf").write_text(f'<robot name="cart">{base}{"".join(axle.values())}</robot>')
    assert main(["import", str(tmp_path / "cart.urdf"), "-o", str(tmp_path / "cart.py")]) == 0
    out, err = capsys.readouterr()
    assert (
        "warning: given more than once, of which the first counts, as in ROS: <inertial> of link base\n"
        in err
    )
    robot = find_robot(f"{tmp_path / 'cart.py'}:cart")
    size = {p.name: p.default for p in robot.parameters}
    assert size["m"] == pytest.approx(3.2) and "castors base carry" in out
    assert size["load_c1"] == pytest.approx(3.0 * 0.02 / 0.12 / 3.2) and size["d"] == pytest.approx(
        -3.0 * 0.02 / 3.2
    )


def test_what_stands_on_the_ground_is_no_arm(tmp_path, bad_input):
    """Nor is the joint of a castor's swivel, nor one that carries the vertical joint of a trailer's
    wheels."""
    castor, truck = two_wheels(), trailers(2)
    castor.link("fork", 0.1)
    castor.joint("swivel", "continuous", "base", "fork", (0.4, 0, 0.05))
    castor.wheel("roller", "fork", (-0.03, 0, 0), radius=0.05, mass=0.1)
    for made, joint, what in ((castor, "swivel", "castor 'roller'"), (truck, "hitch_1", "wheel 'right_1'")):
        line = bad_input(
            ["import", written(tmp_path, made), "--arm", joint, "-o", str(tmp_path / "robot.py")]
        )
        assert f"--arm: joint {joint!r} carries the {what}" in line


@pytest.mark.nightly
def test_an_arm_is_driven_from_its_file(tmp_path, capsys, bad_input):
    """It has as many outputs as inputs, and the loop holds them, on a floor, too. What does not move in the
    plane is held, with a word, or refused if it is named.
    """
    file, target = written(tmp_path, with_arm(two_wheels())), tmp_path / "cart.py"
    assert main(["import", file, "--arm", "elbow", "shoulder", "-o", str(target), "--json"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["arm"] == ["shoulder", "elbow"]
    assert "held fixed at zero, with all that they carry: joints lidar_joint, wrist; --arm makes" in err
    assert "wrist': its axis is 90 deg from vertical" in bad_input(
        ["import", file, "--arm", "wrist", "-o", str(target)]
    )
    (tmp_path / "arm.toml").write_text(ARM)
    for engine in ([], ["--engine", "mujoco"] if find_spec("mujoco") else []):
        assert (
            main(["simulate", str(tmp_path / "arm.toml"), *engine, "-o", str(tmp_path / "run.csv"), "--json"])
            == 0
        )
        said = json.loads(capsys.readouterr().out)
        assert {name: abs(e["final"]) < 0.01 for name, e in said["errors"].items()} == dict.fromkeys(
            ("x_p", "y_p", "angle_1", "angle_2"), True
        )
        assert said["errors"]["angle_1"]["peak"] > 0.5


ARM = """robot = "cart.py:cart"
gains = { kp = 9.0, kd = 6.0 }
output = { type = "point_and_arm" }
reference = { position = [0.5, 0.2, 0.6, -0.9] }
initial = { q = [0, 0, 0, 0, 0, 0, 0], nu = [0, 0, 0, 0] }
simulation = { duration = 3.0, period = 0.005 }
"""
ROLLERS = {"front_right": 45, "rear_left": 45, "front_left": -45, "rear_right": -45}


def given(**degrees: float) -> list[str]:
    return [word for name, angle in degrees.items() for word in ("--rollers", f"{name}_joint={angle} deg")]


def test_rollers_that_have_no_joints_are_named(tmp_path, bad_input, capsys):
    """Their directions, given, lead to the robot of the URDF whose rollers have joints;
    otherwise one line says what to give."""
    for urdf, options in ((mecanum(), []), (mecanum(0), given(**ROLLERS))):
        assert (
            main(["import", written(tmp_path, urdf), *options, "-o", str(tmp_path / "robot.py"), "--json"])
            == 0
        )
        wheels = json.loads(capsys.readouterr().out)["wheels"]
        found = {
            joint.removesuffix("_joint"): (wheel["radius"], np.degrees(wheel["roller"]))
            for joint, wheel in wheels.items()
        }
        assert found == {name: pytest.approx((0.1, angle)) for name, angle in ROLLERS.items()}
    file = written(tmp_path, mecanum(0))
    for options, said in (
        (given(front_right=45), "joint 'front_left_joint' is a wheel without rollers beside others"),
        (
            given(**ROLLERS | {"front_left": 45, "rear_right": 45}),
            "cannot turn the body and move it sideways",
        ),
        (given(**ROLLERS, box=45), "--rollers: joint 'box_joint' is no wheel on 'base'"),
        (
            [*given(**ROLLERS), "--skid-steer-track", "1"],
            "--skid-steer-track: wheels with rollers do not slip",
        ),
        (given(door=45), "--rollers: there is no 'door_joint'"),
        (given(front_right=90), "between -90 and 90 deg"),
        (["--rollers", "front_right_joint"], "give JOINT=ANGLE"),
    ):
        assert said in bad_input(["import", file, *options, "-o", str(tmp_path / "robot.py")])


@pytest.mark.nightly
def test_loads_of_four_wheels_with_rollers(made):
    """Newton and Euler for the whole robot as one body with its centre of mass at a height."""
    system, _ = made("mecanum")
    robot, random, height = system.mechanism, np.random.default_rng(9), 0.15
    size = {parameter.name: parameter.default for parameter in robot.parameters}
    a, b, d, e = (size[name] for name in "abde")
    places = np.array([[a, -b], [a, b], [-a, -b], [-a, b]])
    plant = Plant(system, list((size | {"h": 0.0}).values()))  # the height is that of [contact]
    for _ in range(20):
        x, tau = random.uniform(-2, 2, 10), random.uniform(-3, 3, 4)
        (vx, vy, turn), (ax, ay, spin) = x[7:], plant.rate(x, tau)[7:]
        pull = size["m"] * np.array(
            [ax - vy * turn - d * turn**2 - e * spin, ay + vx * turn + d * spin - e * turn**2]
        )
        load, still = (
            np.array([contact.load[0] for contact in contact_forces(plant, x, tau, ContactSection(height=h))])
            for h in (height, 0.0)
        )
        assert (
            np.abs(np.vstack([np.ones(4), places.T]) @ (load - still) + [0.0, *(height * pull)]).max() < 1e-9
        )
        assert (
            np.abs(
                still @ np.column_stack([np.ones(4), places]) - 9.81 * size["m"] * np.array([1, d, e])
            ).max()
            < 1e-8
        )


def test_files_that_cannot_be_read_or_written(tmp_path, bad_input):
    file = written(tmp_path, two_wheels())
    assert "check the path" in bad_input(
        ["import", str(tmp_path / "none.urdf"), "-o", str(tmp_path / "robot.py")]
    )
    assert "ends in .py" in bad_input(["import", file, "-o", str(tmp_path / "robot")])
    assert "does not exist" in bad_input(["import", file, "-o", str(tmp_path / "none" / "robot.py")])
    own = tmp_path / "own.py"
    own.write_text("mine = 1\n")
    assert "was not written by noslip" in bad_input(["import", file, "-o", str(own)])
    assert own.read_text() == "mine = 1\n"


def test_a_wheel_from_a_scaled_and_turned_mesh(tmp_path):
    """The radius of a mesh in mm, along its x axis, is that of its points about the axle."""
    trimesh = pytest.importorskip("trimesh")
    (tmp_path / "cart").mkdir()
    trimesh.creation.cylinder(50.0, 20.0, sections=64).export(tmp_path / "cart" / "left.stl")
    mesh = f'<origin rpy="0 0 {QUARTER!r}"/>{MESH.replace("/>", " scale={}/>", 1)}'.format(
        '"0.002 0.002 0.001"'
    )
    urdf = two_wheels()
    file = tmp_path / "cart.urdf"
    file.write_text(urdf.text.replace(CYLINDER, mesh, 1))
    layout = recognize(read(str(file)), Options())
    assert [wheel.radius for wheel in layout.base.wheels] == pytest.approx([0.1, 0.1], rel=1e-4)
    assert "mesh" in layout.base.wheels[0].source
    for scale, said in (
        ("0.002 0.001 0.001", "not round about the axle"),
        (
            "2 2 1",
            r"its radius, 100 m \(link right, collision mesh\), does not fit wheels that are 0.4 m apart",
        ),
        ("2e-6 2e-6 1e-6", "does not fit wheels that are 0.4 m apart"),
        ("0 0 0", "left.stl has no size; correct its scale"),
    ):
        file.write_text(urdf.text.replace(CYLINDER, mesh.replace("0.002 0.002 0.001", scale)))
        with pytest.raises(BadInput, match=said):
            recognize(read(str(file)), Options(wheels=("left_joint", "right_joint")))


def test_a_mirrored_mesh_is_mirrored(tmp_path):
    """A negative scale across the axle leaves the wheel as it is;
    along the axle it moves the middle to the other side."""
    trimesh = pytest.importorskip("trimesh")
    (tmp_path / "cart").mkdir()
    shape = trimesh.creation.cylinder(0.1, 0.04, sections=64)
    shape.apply_translation([0.0, 0.0, 0.03])
    shape.export(tmp_path / "cart" / "left.stl")
    file, sides = tmp_path / "cart.urdf", {}
    for scale in ("1 1 1", "-1 1 1", "1 1 -1", "-1 -1 -1"):
        mesh = MESH.replace("/></", f' scale="{scale}"/></')
        file.write_text(
            two_wheels().text.replace(f'<origin xyz="0 0 {BESIDE}"/>', "").replace(CYLINDER, mesh)
        )
        wheels = recognize(read(str(file)), Options()).base.wheels
        assert [wheel.radius for wheel in wheels] == pytest.approx([0.1, 0.1], rel=1e-4)
        sides[scale] = [float(wheel.centre[1]) for wheel in wheels]
    joints = np.array([-0.2, 0.2]) - BESIDE
    assert sides["1 1 1"] == sides["-1 1 1"] == pytest.approx(joints + 0.03, abs=1e-7)
    assert sides["1 1 -1"] == sides["-1 -1 -1"] == pytest.approx(joints - 0.03, abs=1e-7)


def test_text_of_a_urdf_stays_text(tmp_path):
    """A name with quotation marks, a line break and a backslash becomes a comment, never code."""
    evil = "&#10;raise SystemExit(7)&#10;&quot;&quot;&quot;\\"
    text = (
        two_wheels().text.replace('"lidar', f'"{evil}lidar').replace('link name="box"', f'link name="{evil}"')
    )
    file = tmp_path / "cart.urdf"
    file.write_text(text.replace('link="box"', f'link="{evil}"'))
    target = tmp_path / "cart.py"
    assert main(["import", str(file), "-o", str(target)]) == 0
    assert "raise SystemExit(7)" in target.read_text()


def test_what_is_named_on_the_command_line(tmp_path, capsys):
    """A radius in place of a shape, and friction that is left out, with a word."""
    urdf = two_wheels()
    file = tmp_path / "cart.urdf"
    joint = '<joint name="left_joint" type="continuous">'
    file.write_text(urdf.text.replace(CYLINDER, MESH, 1).replace(joint, f'{joint}<dynamics damping="0.1"/>'))
    argv = ["import", str(file), "--radius", "right=10 cm", "--wheels", "right_joint", "left_joint", "--json"]
    assert main([*argv, "-o", str(tmp_path / "cart.py")]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["wheels"]["right_joint"]["radius"] == 0.1
    assert (
        "damping and friction are left out: joints left_joint" in err
        and "--radius right" in (tmp_path / "cart.py").read_text()
    )


@pytest.mark.skipif(
    "NOSLIP_URDFS" not in os.environ, reason="NOSLIP_URDFS has no paths of URDFs, separated as those of PATH"
)
def test_urdfs_of_others(tmp_path, capsys):
    """Each becomes a robot file, whose mass matrix and rims are compared before it is written,
    or is refused in one line."""
    for file in os.environ["NOSLIP_URDFS"].split(os.pathsep):
        status = main(["import", file, "-o", str(tmp_path / "robot.py")])
        out, err = capsys.readouterr()
        print(out or err)
        assert status == 0 or (status == 2 and err.startswith(f"noslip: {file}") and err.count("\n") == 1)


def test_names_are_made_identifiers():
    for given, name in (
        ("my-robot 2", "my_robot_2"),
        ("3dx", "robot_3dx"),
        ("class", "class_robot"),
        ("é", "robot"),
        ("wheels", "wheels_robot"),
        ("math", "math_robot"),
    ):
        assert name_of(given) == name
