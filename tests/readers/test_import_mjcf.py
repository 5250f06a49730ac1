"""`noslip import` from an MJCF: kinetic energies against MuJoCo's, and what is refused."""

import casadi as ca
import numpy as np
import pytest
from noslip.cli.main import main
from noslip.readers.robots import find_robot, system_of
from noslip.readers.urdf.from_mjcf import _roll_pitch_yaw
from scipy.spatial.transform import Rotation

mujoco = pytest.importorskip("mujoco")
WHEEL = '<geom type="cylinder" size="0.1 0.02" euler="90 0 0" mass="0.8"/>'
CART = f"""<mujoco model="crate mover">
  <worldbody>
    <geom name="ground" type="plane" size="5 5 1"/>
    <body name="table" pos="2 0 0"><geom type="box" size="0.3 0.3 0.3"/></body>
    <body name="base" pos="0 0 0.1">
      <freejoint/>
      <inertial pos="0.05 0 0.02" mass="12" diaginertia="0.3 0.4 0.5"/>
      <geom type="box" size="0.3 0.2 0.05" mass="0"/>
      <body name="left" pos="0 0.25 0"><joint name="left_axle" axis="0 1 0" damping="0.1"/>{WHEEL}</body>
      <body name="right" pos="0 -0.25 0.02">
        <joint name="right_axle" axis="0 -1 0" pos="0 0 -0.02"/>
        <geom type="cylinder" size="0.1 0.02" euler="90 0 0" pos="0 0 -0.02" mass="0.8"/>
      </body>
      <body name="ball" pos="0.25 0 -0.07"><joint type="ball"/><geom type="sphere" size="0.03"
          mass="0.2"/></body>
      <body name="lidar" pos="0.1 0.02 0.2" euler="20 90 0"><geom type="capsule" size="0.04 0.03"
          mass="0.3"/></body>
    </body>
  </worldbody>
  <actuator><motor joint="left_axle"/><motor joint="right_axle"/></actuator>
</mujoco>"""
TRIKE = f"""<mujoco model="trike">
  <worldbody>
    <body name="frame" pos="0 0 0.1">
      <freejoint/>
      <inertial pos="0.3 0 0.1" mass="20" diaginertia="0.5 0.9 1.1"/>
      <body name="left" pos="0 0.3 0"><joint name="left_axle" axis="0 1 0"/>{WHEEL}</body>
      <body name="right" pos="0 -0.3 0"><joint name="right_axle" axis="0 1 0"/>{WHEEL}</body>
      <body name="knuckle" pos="0.8 0 0">
        <joint name="steering" axis="0 0 1" range="-80 80"/>
        <inertial pos="0 0 0.05" mass="0.5" diaginertia="0.01 0.01 0.012"/>
        <body name="front"><joint name="front_axle" axis="0 1 0"/>{WHEEL}</body>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="front_axle"/><position joint="steering"/></actuator>
</mujoco>"""


def mecanum() -> str:
    """A base on four wheels of 0.1 m, with rollers as capsules about their x axes,
    of 45 deg on the left and the right."""
    wheels = ""
    for name, ahead, left in (("fr", 0.3, -0.25), ("fl", 0.3, 0.25), ("rr", -0.3, -0.25), ("rl", -0.3, 0.25)):
        # Of the roller at the top, where those at the bottom are seen mirrored
        slant = 45 if ahead * left > 0 else -45
        rollers = "".join(
            f'<body euler="0 {60 * k} 0"><body name="{name}{k}" pos="0 0 0.075" euler="0 0 {slant}"><joint '
            'axis="1 0 0"/><geom type="capsule" size="0.025 0.01" euler="0 90 0" mass="0.02"/></body></body>'
            for k in range(6)
        )
        wheels += (
            f'<body name="{name}" pos="{ahead} {left} 0"><joint name="{name}_axle" axis="0 1 0"/><geom '
            'type="cylinder" size="0.05 0.02" euler="90 0 0" mass="0.8" contype="0" '
            f'conaffinity="0"/>{rollers}</body>'
        )
    return f"""<mujoco model="mecanum">
  <worldbody>
    <body name="base" pos="0 0 0.1">
      <freejoint/>
      <inertial pos="0.05 0.01 0.02" mass="12" diaginertia="0.3 0.4 0.5"/>
      {wheels}
    </body>
  </worldbody>
</mujoco>"""


def imported(folder, text: str) -> str:
    """The robot of the file that is written for a scene."""
    scene, made = folder / "scene.xml", folder / "robot.py"
    scene.write_text(text)
    assert main(["import", str(scene), "-o", str(made)]) == 0
    return f"{made}:{next(name for name in ('crate_mover', 'trike', 'mecanum') if name[:5] in text)}"


def joint_rates(name: str, q: dict[str, float], qdot: dict[str, float]) -> dict[str, float]:
    """By hand, from the sizes of the scenes; the sign of the axis of each joint included."""
    if name == "crate_mover":
        return {"left_axle": qdot["theta_l"], "right_axle": -qdot["theta_r"]}
    if name == "mecanum":
        return {f"{corner}_axle": qdot[f"theta_{corner}"] for corner in ("fr", "fl", "rr", "rl")}
    forward = np.cos(q["phi"]) * qdot["x"] + np.sin(q["phi"]) * qdot["y"]
    sides = {
        f"{side}_axle": (forward - left * qdot["phi"]) / 0.1
        for side, left in (("left", 0.3), ("right", -0.3))
    }
    return sides | {"steering": qdot["delta"], "front_axle": qdot["theta"]}


@pytest.mark.parametrize("text", [CART, TRIKE, mecanum()], ids=["two wheels", "tricycle", "mecanum"])
def test_the_energy_is_mujocos(text, tmp_path, capsys):
    """At random states that roll, to 1e-10 (relative): the file has numbers with 12 digits."""
    system = system_of(find_robot(imported(tmp_path, text)))
    robot, random = system.mechanism, np.random.default_rng(17)
    n = len(robot.coordinates)
    f = ca.Function(
        "f",
        [robot.q, system.nu, robot.p],
        [system.qdot, ca.substitute(robot.energy(), robot.qdot, system.qdot)],
    )
    model = mujoco.MjModel.from_xml_string(text)
    data, full, slot = mujoco.MjData(model), np.zeros((model.nv, model.nv)), np.zeros((3, model.nv))
    for _ in range(20):
        values = random.uniform(-1, 1, n), random.uniform(-3, 3, system.dof)
        rates, energy = f(*values, robot.parameter_values({}))
        names = [c.name for c in robot.coordinates]
        q, qdot = (
            dict(zip(names, values[0], strict=True)),
            dict(zip(names, rates.full().ravel(), strict=True)),
        )
        data.qpos[:], data.qvel[:] = model.qpos0, 0.0
        data.qpos[3:7] = [np.cos(q["phi"] / 2), 0, 0, np.sin(q["phi"] / 2)]
        data.qvel[:2], data.qvel[5] = [qdot["x"], qdot["y"]], qdot["phi"]
        for joint, rate in joint_rates(robot.name, q, qdot).items():
            data.joint(joint).qvel[:] = rate
        if "delta" in q:
            data.joint("steering").qpos[:] = q["delta"]
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        for corner in ("fr", "fl", "rr", "rl") if robot.name == "mecanum" else ():
            lowest = min((data.body(f"{corner}{k}") for k in range(6)), key=lambda body: body.xpos[2])
            # Where it touches the ground
            mujoco.mj_jac(model, data, slot, None, lowest.xpos - [0, 0, 0.025], lowest.id)
            assert abs(slot @ data.qvel @ lowest.xmat.reshape(3, 3)[:, 0]) < 1e-10
        assert float(energy) == pytest.approx(data.qvel @ full @ data.qvel / 2, rel=1e-10)


def test_what_is_said_of_a_scene(tmp_path, capsys):
    system = system_of(find_robot(imported(tmp_path, CART)))
    text, said = (tmp_path / "robot.py").read_text(), capsys.readouterr()
    assert "damping and friction are left out: joints left_axle" in said.err and "links ball" in said.err
    assert "joints right_axle, left_axle" in text and "link right, collision cylinder" in text
    # No table
    assert float(system.mechanism.parameter_values({})[1]) == pytest.approx(12 + 2 * 0.8 + 0.2 + 0.3)


SUM = "".join(
    f'<fixed name="{name}"><joint joint="left_axle" coef="{left}"/><joint joint="right_axle" '
    'coef="0.5"/></fixed>'
    for name, left in (("ahead", 0.5), ("turn", -0.5))
)
MIXED = CART.replace(
    '<motor joint="left_axle"/><motor joint="right_axle"/>', '<motor tendon="ahead"/><motor tendon="turn"/>'
)
MIXED = MIXED.replace("<actuator>", f"<tendon>{SUM}</tendon><actuator>")


def test_motors_may_drive_sums_of_joints(tmp_path, capsys):
    """By tendons that hold nothing themselves: the wheels are driven as by motors of their own."""
    direct, mixed = (system_of(find_robot(imported(tmp_path, text))) for text in (CART, MIXED))
    assert (
        [i.name for i in mixed.mechanism.inputs]
        == [i.name for i in direct.mechanism.inputs]
        == ["tau_r", "tau_l"]
    )
    assert mixed.mechanism.parameter_values({}) == direct.mechanism.parameter_values({})


@pytest.mark.parametrize("ahead", [0.1, -0.1])
def test_a_body_may_stand_on_two_balls_of_its_own(ahead, tmp_path, capsys):
    """One in front and one behind: the loads are those of equal springs at four places,
    of which the wheels are two."""
    balls = "".join(f'<geom type="sphere" size="0.03" pos="{x} 0 -0.07" mass="0"/>' for x in (0.25, -0.25))
    text = CART.replace('pos="0.05 0 0.02" mass="12"', f'pos="{ahead} 0 0.02" mass="12"')
    body = text[text.index('<body name="ball"') : text.index('<body name="lidar"')]
    lidar = text[text.index('<body name="lidar"') : text.index("    </body>\n  </worldbody>")]
    name = imported(tmp_path, text.replace(body, balls).replace(lidar, ""))
    assert "castors base, base 2 carry 50%" in capsys.readouterr().out
    robot = find_robot(name)
    size, places = {p.name: p.default for p in robot.parameters}, np.array([0.0, 0.0, 0.25, -0.25])
    centre = 12 * ahead / size["m"]
    assert size["d"] == pytest.approx(centre)
    expected = 0.25 + centre * places / (places @ places)
    assert [size[f"load_c{k}"] for k in (1, 2)] == pytest.approx(expected[2:].tolist())
    assert [size["a_c1"], size["a_c2"]] == [0.25, -0.25] and size["load"] == pytest.approx(0.25)


def test_angles_are_those_of_the_rotation():
    random = np.random.default_rng(3)
    turns = [
        *Rotation.random(50, rng=random),
        *(
            Rotation.from_euler("xyz", [a, s * np.pi / 2, b])
            for a, b in random.uniform(-3, 3, (20, 2))
            for s in (-1, 1)
        ),
    ]
    for turn in turns:
        again = Rotation.from_euler("xyz", _roll_pitch_yaw(turn.as_matrix()))
        assert np.abs(again.as_matrix() - turn.as_matrix()).max() < 1e-12


BAD = {
    "broken": (CART.replace("</body>", "</bdy>", 1), "not XML"),
    "unknown element": (
        CART.replace("<freejoint/>", "<freejont/>"),
        "MuJoCo cannot compile it: XML Error: Schema violation",
    ),
    "no free joint": (
        CART.replace("<freejoint/>", ""),
        "the robot is the body with a <freejoint/>; with one are: none",
    ),
    "two robots": (
        CART.replace('<body name="table" pos="2 0 0">', '<body name="table" pos="2 0 0"><freejoint/>'),
        "'table', 'base'",
    ),
    "two joints": (
        TRIKE.replace('axis="0 0 1" range="-80 80"/>', 'axis="0 0 1"/><joint axis="1 0 0"/>'),
        "'knuckle' has 2 joints",
    ),
    "equality": (
        CART.replace(
            "<actuator>", '<equality><joint joint1="left_axle" joint2="right_axle"/></equality><actuator>'
        ),
        "equality constraints and tendons",
    ),
    "a spring": (
        MIXED.replace('<fixed name="turn">', '<fixed name="turn" stiffness="3">'),
        "equality constraints and tendons",
    ),
    "no wheels": (
        CART.replace('axis="0 1 0"', 'axis="0 0 1"').replace('axis="0 -1 0"', 'axis="0 0 1"'),
        "no wheel found",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_scenes_are_refused_in_one_line(name, tmp_path, capsys):
    text, said = BAD[name]
    (tmp_path / "scene.xml").write_text(text)
    assert main(["import", str(tmp_path / "scene.xml"), "-o", str(tmp_path / "robot.py")]) == 2
    out, err = capsys.readouterr()
    assert said in err and len(err.splitlines()) == 1 and not (tmp_path / "robot.py").exists()
