"""[scene]: robots of files of the user's own in the physics engine,
against the robots that noslip makes from the equations."""

import re

import numpy as np
import pytest
from noslip.cli.main import main
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot, system_of
from noslip.simulation.closed_loop import simulate
from noslip.simulation.engine.scene import SceneEngine
from noslip.simulation.engine.scene_file import read_scene
from noslip.simulation.engine.written import scene_of
from noslip.simulation.integrate import Refused
from noslip.simulation.plant import Plant
from noslip.simulation.specification.floor import Floor
from noslip.simulation.specification.scene import SceneSection
from noslip.simulation.specification.spec import ContactSection
from noslip.simulation.specification.vary import read_varied
from noslip.tests.simulation.test_engine import GENTLE, LINE
from noslip.tests.urdfs import turtlebot3

mujoco = pytest.importorskip("mujoco")
pytest.importorskip("yourdfpy")
CONTACT = {"mu": 0.7, "share": 0.7, "height": 0.15}
BRIEF = {"simulation.period": 0.01, "simulation.duration": 2.0, "contact": CONTACT, "reference.speed": 1.0}
SAME = 0.001  # m: what two ways to share the load of a step explain, without sliding, over two seconds
HARD = 'solref="0.004 1" solimp="0.99 0.99 0.001"'


def plant(name: str) -> Plant:
    mechanism = find_robot(name)
    return Plant(system_of(mechanism), mechanism.parameter_values({}))


def cart() -> str:
    """The LABMATE by hand: its chassis somewhere else, its heading along the y axis of the chassis, its left
    axle reversed, and a motor with a gear at the right. The castor is where the LABMATE's own engine has it.
    """
    size = {p.name: p.default for p in find_robot("labmate").parameters}
    wheels = ""
    for side, left, axis in (("right", -size["b"], "-1 0 0"), ("left", size["b"], "1 0 0")):
        wheels += f"""
      <body name="{side}" pos="{0.1 - left} {-0.2 + 0.0 - size["d"]} -0.25">
        <joint name="{side} axle" axis="{axis}"/>
        <inertial pos="0 0 0" mass="{size["m_w"]}" diaginertia="{size["I_w"]} {size["I_m"]} {size["I_m"]}"/>
        <geom type="ellipsoid" size="{size["r"]} {size["r"]} {size["r"]}" friction="0.7" priority="1"
            condim="3" {HARD}/>
      </body>"""
    return f"""<mujoco model="cart">
  <option timestep="0.002" cone="pyramidal" integrator="RK4"/>
  <worldbody>
    <geom name="ground" type="plane" size="20 20 1"/>
    <body name="chassis" pos="2 1 0.4" euler="0 0 130">
      <freejoint/>
      <inertial pos="0.1 -0.2 -0.25" mass="{size["m_c"]}" diaginertia="{size["I_c"]} {size["I_c"]}
          {size["I_c"]}"/>
      <geom type="sphere" size="0.075" pos="0.1 0.4375 -0.325" mass="0" condim="1" priority="1"
          {HARD}/>{wheels}
    </body>
  </worldbody>
  <actuator><motor name="right motor" joint="right axle" gear="-25"/></actuator>
</mujoco>
"""


def cart_in(file, **section) -> SceneEngine:
    """The LABMATE as the cart of a file, at rest."""
    names = {"theta_r": ("right axle",), "theta_l": ("left axle",)}
    return SceneEngine(
        plant("labmate"),
        SceneSection(file=str(file), joints=names, **section),
        ContactSection(),
        Floor(),
        np.zeros(7),
    )


NAMED = {"joints": {"theta_r": "right axle", "theta_l": "left axle"}, "motors": {"tau_r": "right motor"}}


def test_a_cart_by_hand_moves_as_the_labmate(tmp_path):
    """From 2 m beside the line, across its way: path, loads, torques, slip and the reckoned pose."""
    (tmp_path / "cart.xml").write_text(cart())
    own = simulate(read_varied(LINE, GENTLE | BRIEF), engine="mujoco")
    scene = simulate(
        read_varied(LINE, GENTLE | BRIEF | {"scene": {"file": str(tmp_path / "cart.xml"), **NAMED}}),
        engine="mujoco",
    )
    assert not scene.warnings and len(scene.t) == len(own.t)
    assert (
        np.abs(scene.q[:, :2] - own.q[:, :2]).max() < SAME
        and np.abs(scene.q[:, 2] - own.q[:, 2]).max() < SAME
    )
    assert np.abs(scene.tau - own.tau).max() < 0.02 * np.abs(own.tau).max()
    assert np.abs(scene.floor.load - own.floor.load).max() < 0.01 * own.floor.load.max()
    assert np.abs(scene.floor.force - own.floor.force)[5:].max() < 0.05 * np.abs(own.floor.force).max()
    assert scene.floor.mu == 0.7 and scene.floor.slip.max() < 0.001
    assert np.abs(scene.floor.reckoned - scene.q[:, :3]).max() < SAME


@pytest.mark.parametrize("name", ["labmate", "mobile_manipulator", "tractor_trailer:2"])
def test_a_scene_that_was_written_is_the_robot(name, tmp_path):
    """It begins where it should, for random starts, rolls there,
    and its mass matrix is that of the Mechanism."""
    there, random = plant(name), np.random.default_rng(1992)
    file = tmp_path / "robot.xml"
    file.write_text(scene_of(there, ContactSection(share=0.7), Floor(mu=0.6)))
    for _ in range(3):
        start = random.uniform(-1.5, 1.5, len(there.system.state))
        made = SceneEngine(there, SceneSection(file=str(file)), ContactSection(), Floor(), start)
        assert made.state() == pytest.approx(start, abs=1e-6)
        assert made.look()[0].max() < 1e-3 and made.mu == 0.6 and not made.warnings
        q = start[: len(there.system.mechanism.coordinates)]
        assert made.mass_matrix_difference(q) < 1e-5  # contacts give way, and it leans on its castor


def test_a_written_scene_moves_as_it_did(tmp_path, capsys):
    """From the command line: written, brought back, with the same path, until its end."""
    spec, scene = tmp_path / "line.toml", tmp_path / "labmate.xml"
    spec.write_text(LINE.read_text())
    changes = [
        f"--set={key}={value}" for key, value in (("simulation.period", 0.01), ("simulation.duration", 1.0))
    ]
    argv = ["simulate", str(spec), "--engine", "mujoco", *changes, "--set=contact={ share = 0.7, mu = 0.7 }"]
    runs = []
    for more in (["--write-scene", str(scene)], ['--set=scene.file="labmate.xml"']):
        assert main([*argv, *more, "-o", str(tmp_path / "run.csv")]) == 0
        runs.append(np.genfromtxt(tmp_path / "run.csv", delimiter=",", names=True, dtype=None, encoding=None))
    assert max(np.abs(runs[0][name] - runs[1][name]).max() for name in ("x_c", "y_c", "phi")) < SAME
    capsys.readouterr()
    assert main([*argv[:2], "-o", str(tmp_path / "run.csv"), '--set=scene.file="labmate.xml"']) == 0
    assert "[scene] has no effect without --engine mujoco" in capsys.readouterr().err


def car() -> str:
    """The car of F1TENTH by hand, with four wheels: its steered wheels turn by themselves,
    its rear wheels roll apart."""
    size = {p.name: p.default for p in find_robot("f1tenth").parameters}
    r, ahead, half = size["r"], size["l"], 0.1
    tyre = f'<geom type="sphere" size="{r}" mass="0" friction="0.7" priority="1" condim="3" {HARD}/>'
    about = f"{size['I_w'] / 4} {size['I_w'] / 2} {size['I_w'] / 4}"
    wheels = ""
    for side, left in (("right", -half), ("left", half)):
        wheels += f"""
      <body name="rear {side}" pos="0 {left} {r}">
        <joint name="rear_{side}" axis="0 1 0"/><inertial pos="0 0 0" mass="1e-6"
            diaginertia="{about}"/>{tyre}
      </body>
      <body name="knuckle {side}" pos="{ahead} {left} {r}">
        <joint name="steer_{side}" axis="0 0 -1"/>
        <inertial pos="0 0 0" mass="1e-6" diaginertia="1e-4 1e-4 {size["I_s"] / 2}"/>
        <body name="front {side}"><joint name="front_{side}" axis="0 1 0"/>
          <inertial pos="0 0 0" mass="1e-6" diaginertia="1e-7 1e-7 1e-7"/>{tyre}
        </body>
      </body>"""
    return f"""<mujoco><worldbody><geom type="plane" size="0 0 1"/><body name="car"><freejoint/>
      <inertial pos="{size["c"]} 0 {r}" mass="{size["m"]}" diaginertia="0.05 0.05 {size["I_c"]}"/>{wheels}
    </body></worldbody></mujoco>"""


PAIRS = {
    "joints": {"delta": ["steer_right", "steer_left"], "theta": ["rear_right", "rear_left"]},
    "wheels": {"front wheel": ["front_left", "front_right"]},
}


@pytest.mark.nightly
def test_a_car_with_four_wheels_moves_as_the_bicycle(tmp_path):
    """Steering torque and drive are shared by two joints each;
    the wheels in front are parallel and scrub a little."""
    (tmp_path / "car.xml").write_text(car())
    spec, brief = (
        LINE.parent / "robots" / "f1tenth.toml",
        {"simulation.period": 0.01, "simulation.duration": 1.5},
    )
    own = simulate(read_varied(spec, brief), engine="mujoco")
    scene = simulate(
        read_varied(spec, brief | {"scene": {"file": str(tmp_path / "car.xml"), **PAIRS}}), engine="mujoco"
    )
    assert not scene.warnings and scene.stopped == own.stopped
    way = np.hypot(*np.diff(own.q[:, :2], axis=0).T).sum()
    assert way > 1.0 and np.abs(scene.q[:, :2] - own.q[:, :2]).max() < 0.02 * way
    # At rest; later sliding makes loads jump
    assert scene.floor.load.sum(axis=1)[:5] == pytest.approx(3.74 * 9.81, rel=1e-3)


def test_steered_wheels_are_tied(tmp_path):
    """Their axles meet on that of the rear wheels, though the load on one is as from a curb; the file's axes
    are downward, one of them here upward. Without rear wheels they are parallel.
    """
    text = car().replace(
        '<joint name="steer_left" axis="0 0 -1"/>', '<joint name="steer_left" axis="0 0 1" damping="0.2"/>'
    )
    (tmp_path / "car.xml").write_text(text)
    named = {
        entry: {key: (of,) if isinstance(of, str) else tuple(of) for key, of in PAIRS[entry].items()}
        for entry in PAIRS
    }
    section = SceneSection(file=str(tmp_path / "car.xml"), **named)
    made = SceneEngine(plant("f1tenth"), section, ContactSection(), Floor(), np.zeros(7))
    made.hold(0.0, made.state(), np.array([0.0, 0.05]), 0.4)
    right, left = (float(made.data.joint(f"steer_{side}").qpos[0]) for side in ("right", "left"))
    ahead = next(p.default for p in find_robot("f1tenth").parameters if p.name == "l")
    # To the left of the middle
    centres = [side * 0.1 + ahead / np.tan(angle) for side, angle in ((-1, -right), (1, left))]
    assert left > 0.05 and centres[0] == pytest.approx(centres[1], rel=0.01)
    assert made.coordinates()[0][3] == pytest.approx(np.arctan(ahead / np.mean(centres)), abs=1e-3)
    parallel = read_scene(section.file, [("steer_right", "steer_left")]).model
    assert parallel.eq_data[0, :5].tolist() == [0.0, -1.0, 0.0, 0.0, 0.0]


def urdf(tmp_path) -> str:
    """The TurtleBot3 Burger, whose wheels are cylinders."""
    (tmp_path / "burger.urdf").write_text(turtlebot3("burger").text)
    return str(tmp_path / "burger.urdf")


WHEELS = {"joints": {"theta_r": "wheel_right_joint", "theta_l": "wheel_left_joint"}}


@pytest.mark.nightly
def test_a_urdf_gets_a_floor_and_moves(tmp_path):
    """It stands on a floor of [floor] mu, begins lifted out of it,
    and moves as the robot whose sizes it has."""
    spec, floor = (
        LINE.parent / "robots" / "turtlebot3_burger.toml",
        {"floor": {"mu": 0.5, "slope": [0.02, 1.0]}},
    )
    brief = {"simulation.period": 0.01, "simulation.duration": 2.0, **floor}
    own = simulate(read_varied(spec, brief), engine="mujoco")
    scene = simulate(
        read_varied(spec, brief | {"scene": {"file": urdf(tmp_path), **WHEELS}}), engine="mujoco"
    )
    assert not scene.warnings and scene.floor.mu == 0.5
    assert np.abs(scene.q[:, :2] - own.q[:, :2]).max() < SAME
    (tmp_path / "heavy.urdf").write_text(
        turtlebot3("burger").text.replace('mass value="0.825', 'mass value="1.825')
    )
    scene = SceneEngine(
        plant("turtlebot3_burger"),
        SceneSection(
            file=str(tmp_path / "heavy.urdf"),
            joints={"theta_r": ("wheel_right_joint",), "theta_l": ("wheel_left_joint",)},
        ),
        ContactSection(),
        Floor(),
        np.zeros(7),
    )
    for said in (
        "the mass is 2.002 kg, that of turtlebot3_burger 1.002 kg",
        "the mass matrix of the rolling robot differs",
    ):
        assert any(said in warning for warning in scene.warnings), said
    assert len(scene.warnings) == 2


def test_warnings_say_where_the_file_differs(tmp_path):
    """Cylinders that touch with both edges, a larger radius, a place, and sides that are interchanged."""
    text = cart().replace(
        'type="ellipsoid" size="0.15 0.15 0.15"', 'type="cylinder" size="0.16 0.02" euler="0 90 0"'
    )
    text = text.replace("-0.25", "-0.24").replace(
        '<body name="left" pos="-0.65', '<body name="left" pos="-0.68'
    )
    (tmp_path / "cart.xml").write_text(text)
    made = cart_in(tmp_path / "cart.xml")
    joints = ("joints are 0.015 m away from where labmate has its wheels",)
    radii = [
        f"the wheel on '{side} axle' has a radius of 0.16 m, that of labmate 0.15 m"
        for side in ("right", "left")
    ]
    edges = [
        f"the wheel on '{side} axle' touches at points 0.04 m apart along its axle"
        for side in ("right", "left")
    ]
    for said in (*joints, *radii, *edges):
        assert any(said in warning for warning in made.warnings), (said, made.warnings)
    (tmp_path / "own.xml").write_text(scene_of(plant("labmate"), ContactSection(share=0.7), Floor()))
    section = SceneSection(
        file=str(tmp_path / "own.xml"), joints={"theta_r": ("theta_l",), "theta_l": ("theta_r",)}
    )
    made = SceneEngine(plant("labmate"), section, ContactSection(), Floor(), np.zeros(7))
    assert any("left and right may be interchanged" in warning for warning in made.warnings)


def scene(old: str = "", new: str = "", **section):
    assert old in cart()
    return cart().replace(old, new) if old else cart(), {**NAMED, **section}


BAD = {
    "no file": (None, NAMED, "No such file or directory; check the path"),
    "broken": (*scene("</body>", "</bdy>"), "not XML"),
    "not a scene": ("<sdf/>", NAMED, "the first element is <sdf>"),
    "unknown element": (
        *scene("<freejoint/>", "<freejoin/>"),
        "MuJoCo cannot read it: XML Error: Schema violation",
    ),
    "xacro": ('<robot name="${a}"/>', NAMED, "a xacro file; expand it"),
    "no link": ('<robot name="a"><joint name="a" type="fixed"/></robot>', NAMED, "<joint> has no <parent>"),
    "circle": (
        turtlebot3("burger").text.replace(
            "</robot>",
            '<joint name="a" type="fixed"><parent link="base_scan"/><child '
            'link="base_link"/></joint></robot>',
        ),
        WHEELS,
        "every link has a parent",
    ),
    "no mass": (
        re.sub('(name="wheel_left_link">)<inertial>.*?</inertial>', r"\1", turtlebot3("burger").text),
        WHEELS,
        "link 'wheel_left_link' moves, and has no <inertial>",
    ),
    "zero mass": (
        turtlebot3("burger").text.replace('mass value="0.02849894"', 'mass value="0"'),
        WHEELS,
        "link 'wheel_left_link' moves, and has no <inertial> with a mass",
    ),
    "mesh": (
        turtlebot3("burger").text.replace(
            '<cylinder length="0.018" radius="0.033"/>', '<mesh filename="package://a/b.stl"/>'
        ),
        WHEELS,
        "its mesh package://a/b.stl is not found",
    ),
    "inertia": (
        turtlebot3("burger").text.replace('izz="2.0712558e-05"', 'izz="3e-05"', 1),
        WHEELS,
        "link 'wheel_left_link': no body has such an inertia, with a principal moment above the sum of the "
        "others",
    ),
    "unknown joint": (
        *scene(joints={"theta_r": "right"}),
        "joints theta_r: there is no joint 'right'; those that turn are right axle, left axle",
    ),
    "no joint of its name": (
        *scene(joints={"theta_r": "right axle"}),
        "joints theta_l: there is no joint 'theta_l'",
    ),
    "slide": (*scene('name="left axle"', 'name="left axle" type="slide"'), "joint 'left axle' does not turn"),
    "axis": (
        *scene('name="left axle" axis="1 0 0"', 'name="left axle" axis="1 0 0.5"'),
        "joint 'left axle': its axis is 26.6 deg from that",
    ),
    "twice": (
        *scene(joints={"theta_r": "right axle", "theta_l": "right axle"}),
        "joint 'right axle' is named twice",
    ),
    "coordinate": (
        *scene(joints={"theta_x": "right axle"}),
        "[scene] joints: unknown key 'theta_x'; did you mean",
    ),
    "contact": (*scene(wheels={"rear": "right axle"}), "[scene] wheels: unknown key 'rear'"),
    "input": (*scene(motors={"tau_x": "right motor"}), "[scene] motors: unknown key 'tau_x'; did you mean"),
    "motor": (
        *scene(motors={"tau_r": "motor"}),
        "motors tau_r: there is no actuator 'motor'; did you mean 'right motor'?",
    ),
    "other motor": (
        *scene(motors={"tau_l": "right motor"}),
        "actuator 'right motor' must be a <motor> of 'left axle'",
    ),
    "velocity": (
        *scene(
            '<motor name="right motor" joint="right axle" gear="-25"/>',
            '<velocity name="v" joint="right axle" kv="1"/>',
            motors={},
        ),
        "actuator 'v' would hold joint 'right axle' by itself",
    ),
    "no gear": (*scene('gear="-25"', 'gear="0"'), "actuator 'right motor' has no gear"),
    "no free joint": (*scene("<freejoint/>", ""), "body 'chassis', has no free joint and cannot move"),
    "elsewhere": (
        *scene('<body name="left" pos="-0.65', '<body name="left" pos="-1.65'),
        "joints are not where labmate has its wheels",
    ),
    "no shape": (
        *scene('<geom type="ellipsoid"', '<geom type="ellipsoid" contype="0" conaffinity="0"'),
        "carries no shape that can touch",
    ),
    "in the air": (
        *scene("<freejoint/>", '<freejoint/><geom type="box" size=".6 .6 .1" pos="0 0 -.5" mass="0"/>'),
        "no wheel of 'right wheel' stands on the floor",
    ),
    "falls": (*scene('pos="0.1 0.4375 -0.325"', 'pos="0.1 -1.4375 -0.325"'), "the robot falls over"),
    "two robots": (
        *scene(
            ' <body name="left"',
            '</body><body name="other"><freejoint/><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/> '
            '<body name="left"',
        ),
        "on several robots",
    ),
    "no name": (*scene(joints={"theta_r": []}), "joints theta_r is empty"),
    "a number": (*scene(joints={"theta_r": 3}), "is not a string"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_scenes_are_refused_in_one_line(case, tmp_path, bad_input):
    content, section, said = BAD[case]
    file, spec = tmp_path / "cart.xml", tmp_path / "line.toml"
    if content:
        file.write_text(content)
    lines = [
        f"{key} = {value!r}".replace("{'", '{ "').replace("':", '" =').replace("'", '"')
        for key, value in section.items()
    ]
    spec.write_text(LINE.read_text() + '\n[scene]\nfile = "cart.xml"\n' + "\n".join(lines) + "\n")
    argv = [
        "simulate",
        str(spec),
        "--engine",
        "mujoco",
        "--set=simulation.period=0.01",
        "--set=simulation.duration=0.1",
    ]
    robot = ['--set=robot="turtlebot3_burger"'] if section is WHEELS else []
    line = bad_input([*argv, *robot, "-o", str(tmp_path / "run.csv")])
    assert said in line and (file.name in line or "unknown key" in line or "[scene] joints" in line), line


@pytest.mark.parametrize(
    "changes, said",
    [
        (["--set=floor.mu=0.3"], "[floor] mu, patch, bump and rough do not apply"),
        (['--set=robot="slope_platform"', "--set=output.L=0.5"], "is on a slope of its own"),
        (["--write-scene", "again.xml"], "--write-scene: the SPEC has [scene]"),
    ],
)
def test_what_does_not_go_with_a_scene(changes, said, tmp_path, bad_input, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cart.xml").write_text(cart())
    spec = tmp_path / "line.toml"
    spec.write_text(
        LINE.read_text()
        + '\n[scene]\nfile = "cart.xml"\njoints = { theta_r = "right axle", theta_l = "left axle" }\n'
    )
    argv = [
        "simulate",
        "line.toml",
        "--engine",
        "mujoco",
        "--set=simulation.period=0.01",
        "--set=simulation.duration=0.1",
    ]
    assert said in bad_input([*argv, *changes, "-o", "run.csv"])


@pytest.mark.parametrize(
    "name, contact, floor, said",
    [
        ("labmate", {}, {}, "the robot would fall over; set [contact] share below 1"),
        ("car", {}, {}, "the robot would fall over; they are on one line"),
        ("rolling_disk", {}, {}, "its input tau_phi does not act on a joint"),
        ("slope_platform", {"share": 0.7}, {}, "slope_platform is on a slope of its own"),
        (
            "labmate",
            {"share": 0.7},
            {"patch": ({"x": (0, 1), "y": (0, 1), "mu": 0.1},)},
            "a scene has no patches",
        ),
    ],
)
def test_robots_that_cannot_be_written(name, contact, floor, said):
    with pytest.raises(BadInput, match=re.escape(said)):
        scene_of(plant(name), ContactSection(**contact), Floor(**floor))


@pytest.mark.parametrize(
    "file, more, said",
    [("r.xml", [], "the robot would fall over"), ("r.urdf", ["--set=contact.share=0.7"], "ends in .xml")],
)
def test_a_scene_that_cannot_be_written_is_refused_before_the_run(
    file, more, said, tmp_path, bad_input, monkeypatch
):
    monkeypatch.setattr(
        "noslip.simulation.closed_loop.simulate", lambda *_, **__: pytest.fail("the run has begun")
    )
    assert said in bad_input(
        ["simulate", "line", *more, "--write-scene", str(tmp_path / file), "-o", str(tmp_path / "run.csv")]
    )


def test_a_robot_that_falls_over_in_a_scene_is_noticed(tmp_path):
    (tmp_path / "cart.xml").write_text(cart())
    made = cart_in(tmp_path / "cart.xml")
    made.hold(0.0, made.state(), np.zeros(2), 0.001)
    turn = made.data.qpos[made._at + 3 : made._at + 7]
    mujoco.mju_mulQuat(turn, turn.copy(), np.array([np.cos(0.55), np.sin(0.55), 0.0, 0.0]))
    with pytest.raises(Refused, match="overturned"):
        made.hold(0.0, made.state(), np.zeros(2), 0.001)


@pytest.mark.parametrize("limit", ['ctrlrange="-0.04 0.04"', 'forcerange="-0.04 0.04"', 'ctrlrange="-1 1"'])
def test_motors_of_the_inputs_names_are_used_and_their_limits_said(limit, tmp_path):
    """2 N m by a gear of -25 asks for 0.08; 1 N m is what both kinds of limits leave."""
    text = cart().replace('name="right motor" joint="right axle"', f'name="tau_r" joint="right axle" {limit}')
    (tmp_path / "cart.xml").write_text(text)
    made, limited = cart_in(tmp_path / "cart.xml"), "0.04" in limit
    made.hold(0.0, made.state(), np.array([0.5, 0.5]), 0.01)
    assert not made.warnings
    made.hold(0.01, made.state(), np.array([2.0, 0.5]), 0.01)
    supplied = made.data.joint("right axle").qfrc_actuator[0]
    assert abs(supplied) == pytest.approx(1.0 if limited else 2.0) and made.data.qfrc_applied.any()
    said = "motor 'tau_r' is at its limit, first at t = 0.01 s, and supplies up to 1 N m less"
    assert [said in warning for warning in made.warnings] == [True] * limited


def test_a_motor_of_the_inputs_name_on_another_joint_is_not_used(tmp_path):
    (tmp_path / "cart.xml").write_text(
        cart().replace('name="right motor" joint="right axle"', 'name="tau_r" joint="left axle"')
    )
    made = cart_in(tmp_path / "cart.xml")
    made.hold(0.0, made.state(), np.array([0.5, 0.5]), 0.001)
    assert not made.data.ctrl.any() and made.data.joint("right axle").qfrc_applied[0]


def test_meshes_that_mujoco_cannot_read_are_refused_where_they_touch(tmp_path):
    """Shapes that are only seen may be of any format."""
    text, mesh = turtlebot3("burger").text, '<geometry><mesh filename="b.dae"/></geometry>'
    (tmp_path / "b.dae").write_text("<COLLADA/>")
    for kind in ("visual", "collision"):
        (tmp_path / f"{kind}.urdf").write_text(
            text.replace('<link name="base_link">', f'<link name="base_link"><{kind}>{mesh}</{kind}>')
        )
    assert read_scene(str(tmp_path / "visual.urdf")).paved
    with pytest.raises(BadInput, match=r"b\.dae is none of \.stl, \.obj, \.msh; convert it"):
        read_scene(str(tmp_path / "collision.urdf"))
