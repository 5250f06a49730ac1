"""Robots on a floor in a physics engine, compared with the Mechanism, with the rolling simulation,
and with Coulomb's law."""

import importlib
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from noslip.cli.main import main
from noslip.model.mechanism import Mechanism
from noslip.readers.errors import BadInput, installing
from noslip.readers.robots import find_robot, system_of
from noslip.simulation.closed_loop import simulate, summary
from noslip.simulation.contact import contact_forces
from noslip.simulation.engine.engine import FloorEngine
from noslip.simulation.engine.friction import coulomb
from noslip.simulation.engine.measured import FloorMeasurements
from noslip.simulation.integrate import Refused
from noslip.simulation.plant import Plant
from noslip.simulation.specification.floor import Bump, Floor, Patch, Rough
from noslip.simulation.specification.spec import ContactSection
from noslip.simulation.specification.vary import read_varied

mujoco = pytest.importorskip("mujoco")
LINE = Path(__file__).parents[2] / "examples/specs" / "line.toml"
ROBOTS = [
    "labmate",
    "slope_platform",
    "rolling_disk",
    "car",
    "tricycle",
    "mobile_manipulator",
    "tractor_trailer",
    "four_wheel",
]
ROBOTS += ["turtlebot3_burger", "turtlebot3_waffle_pi", "pioneer_3dx", "f1tenth", "forklift"]
FAST = {
    "gains": {"kp": 1.0, "kd": 2.5, "kv": 2.0},
    "initial": {"point": [0.0, 2.0], "heading": np.pi / 2, "speed": 0.0},
}
GENTLE = FAST | {"gains": {"kp": 0.1, "kd": 0.8, "kv": 0.5}, "reference.speed": 0.3}
RUBBER = Floor(mu=0.7)
SHORT = {"simulation.period": 0.01, "simulation.duration": 1.5}


def engine(name: str, floor: Floor = RUBBER, start=None, **contact) -> FloorEngine:
    """A robot with its own parameters, at rest at q = 0 unless a start is given."""
    mechanism = find_robot(name)
    plant = Plant(system_of(mechanism), mechanism.parameter_values({}))
    start = np.zeros(len(plant.system.state)) if start is None else start
    return FloorEngine(plant, ContactSection(**contact), floor, start)


@cache
def run(mu: float, height: float = 0.0, share: float = 0.7, gentle: bool = False, **floor):
    """The LABMATE from rest to a line, on a floor."""
    contact = {"mu": mu, "height": height, "share": share}
    limits = {} if gentle else {"limits": {"torque": [20.0], "mode": "cut"}}
    spec = read_varied(
        LINE,
        (GENTLE if gentle else FAST) | SHORT | {"contact": contact, "floor": {"mu": mu, **floor}} | limits,
    )
    return simulate(spec, engine="mujoco")


@pytest.mark.parametrize("name", [*ROBOTS, "castor_platform", "mecanum", "balancer"])
def test_the_engines_mass_matrix_is_that_of_the_mechanism(name):
    """MuJoCo's joint-space inertia, taken back to the coordinates and projected by S(q),
    at random states; its total mass."""
    random, made = np.random.default_rng(1992), engine(name)
    mechanism = find_robot(name)
    system, n = system_of(mechanism), len(mechanism.coordinates)
    values = mechanism.parameter_values({})
    matrices = ca.Function("MS", [mechanism.q, mechanism.p], [mechanism.M, system.S])
    model, data = made.model, made.data
    for _ in range(20):
        q = random.uniform(-3, 3, n)
        data.qpos[:] = 0.0
        data.qpos[made.moving] = made.planar.joints @ q
        mujoco.mj_forward(model, data)
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        M, S = (value.full() for value in matrices(q, values))
        there = full[np.ix_(made.moving, made.moving)]
        back = made.planar.joints.T @ there @ made.planar.joints
        wanted = S.T @ M @ S
        assert np.abs(S.T @ back @ S - wanted).max() <= 1e-8 * np.abs(wanted).max()
        assert np.abs(back - M).max() <= 1e-8 * np.abs(M).max()  # also where the robot would slip
    assert model.body_mass.sum() == pytest.approx(float(M[0, 0]), rel=1e-9)


def test_the_contacts_carry_what_the_mechanism_says():
    """Loads at rest: the share of the weight on the wheels, the rest on castors,
    which stand where the moments balance."""
    for name in ROBOTS:
        made = engine(name)
        loads = [wheel.load * 9.81 for wheel in made.planar.wheels]
        if name != "mobile_manipulator":  # its arm is stretched out ahead, and the body is kept level
            assert made.look()[1] == pytest.approx(loads, rel=2e-3), name
    assert engine("labmate", share=0.7).look()[1] == pytest.approx([0.35 * 32 * 9.81] * 2, rel=2e-3)


def test_friction_obeys_coulombs_law():
    """Random problems of up to four contacts: within the limit, against the slip,
    and no slip within the limit."""
    random, slides = np.random.default_rng(1992), 0
    for _ in range(300):
        c = random.integers(1, 5)
        J = random.normal(size=(2 * c, 2 * c + random.integers(3) if c > 2 else random.integers(2, 7)))
        give = 1e-3 * J @ J.T
        free, load, mu = (
            J @ random.normal(size=J.shape[1]),
            random.uniform(0, 800, c),
            random.uniform(0.05, 1.5, c),
        )
        force = coulomb(give, free, load, mu)
        slip = (free + give @ force).reshape(-1, 2)
        for f, s, limit in zip(force.reshape(-1, 2), slip, mu * load, strict=True):
            assert np.hypot(*f) <= limit * (1 + 1e-7)
            if np.hypot(*s) > 1e-4:
                slides += 1
                assert f * np.hypot(*s) == pytest.approx(-limit * s, abs=2e-3 * limit * np.hypot(*s) + 1e-9)
    assert slides > 100


def test_a_robot_that_needs_little_grip_moves_as_if_it_rolled():
    """The path to 1 mm, the slip to 1 mm/s: what steps of 1 ms and loads of the step before explain."""
    spec = read_varied(LINE, GENTLE | SHORT)
    rolling, there = simulate(spec), run(5.0, gentle=True, share=1.0)
    assert np.abs(there.q[:, :2] - rolling.q[:, :2]).max() < 1e-3
    assert there.floor.slip.max() < 0.001
    assert (
        np.abs(there.forces - rolling.forces)[1:].max() < 0.05 * np.abs(rolling.forces).max()
    )  # lambda, as the floor supplies it
    assert np.abs(there.floor.reckoned - there.q[:, :3]).max() < 1e-3


@pytest.mark.nightly
def test_the_papers_start_slips():
    """What rolling would need is beyond friction 0.7 there: the run slips,
    forces stay within the cone, reckoning is wrong."""
    there = run(0.7)
    assert there.floor.slip.max() > 1.0
    size = np.hypot(*there.floor.force.reshape(len(there.t), -1, 2).transpose(2, 0, 1))
    assert np.all(size <= 0.7 * there.floor.load * 1.02)
    assert 0.999 < there.floor.use.max() <= 1.0
    assert np.abs(there.floor.reckoned - there.q[:, :3]).max() > 0.05
    assert run(0.7, gentle=True).floor.slip.max() < 1e-3
    assert run(0.05, gentle=True).floor.slip.max() > 0.01  # the same demand, on ice


def test_energy_is_that_of_the_inputs_less_friction():
    """Between rows the kinetic energy of the sliding robot changes by the work of the inputs less that of
    friction."""
    made = engine("labmate", start=np.array([0.0, 0.0, 0.3, 0.0, 0.0, 4.0, 6.0]))
    mechanism = find_robot("labmate")
    energy = ca.Function("energy", [mechanism.q, mechanism.qdot, mechanism.p], [mechanism.energy()])
    values, tau, h = mechanism.parameter_values({}), np.array([40.0, -40.0]), 1e-4
    work = slips = 0.0
    q, qdot = made.coordinates()
    before = first = float(energy(q, qdot, values))
    x = made.state()
    for _ in range(400):
        at = qdot
        x = made.hold(0.0, x, tau, h)
        q, qdot = made.coordinates()
        slip = ca.Function(
            "slip", [mechanism.q, mechanism.qdot, mechanism.p], [mechanism.contact_rows @ mechanism.qdot]
        )
        middle = (at + qdot) / 2
        power = tau @ middle[3:] + made.look()[3] @ slip(q, middle, values).full().ravel()
        work += power * h
        slips = max(slips, made.look()[0].max())
    after = float(energy(q, qdot, values))
    assert slips > 0.5
    assert after - first == pytest.approx(work, abs=2e-3 * abs(before))


def test_steps_are_as_long_as_the_floor_says():
    made = engine("labmate", Floor(mu=0.7, step=3e-4))
    made.hold(0.0, made.state(), np.zeros(2), 0.01)
    assert made.model.opt.timestep == pytest.approx(0.01 / 34)


def test_a_robot_that_falls_over_stops(tmp_path, capsys):
    """High, on much friction, and pulled forward: it pitches over its castor or backward. Its rows before
    that are kept."""
    argv = ["simulate", "line", "--engine", "mujoco", "-o", str(tmp_path / "run.csv")]
    settings = (
        "contact={height=2.5,share=0.9,mu=2}",
        "initial.speed=0",
        "initial.point=[0.0,0.0]",
        "reference.speed=4",
    )
    more = (
        "gains.kv_speed=2",
        "limits={torque=[12.0],mode='cut'}",
        "simulation.period=0.01",
        "simulation.duration=1.0",
    )
    assert main([*argv, *(part for each in (*settings, *more) for part in ("--set", each))]) == 1
    out, err = capsys.readouterr()
    rows = np.genfromtxt(tmp_path / "run.csv", delimiter=",", names=True, dtype=None, encoding=None)
    assert re.search(r"stopped at t = 0\.\d+ s: overturned", err)
    assert re.search(r"castor: load 0 to 31.\d+ N, none for 0.64 s", out)
    assert (
        rows["status"][-1] == "overturned"
        and "overturned" not in rows["status"][:-1]
        and 0.3 < rows["t"][-1] < 1.0
    )


def test_a_contact_that_carries_nothing_is_said():
    t, load = np.arange(10) / 10, np.full((10, 2), 9.0)
    load[3:6, 0], load[4, 1] = 0.0, 0.0
    measured = FloorMeasurements(
        np.zeros((10, 2)), load, load, load, None, 0.7, ("left", "right"), (), np.zeros((10, 0))
    )
    left, right = measured.summary(t).splitlines()
    assert left.endswith("load 0 to 9 N, none for 0.3 s") and right.endswith("load 0 to 9 N")


@pytest.mark.parametrize("axis, falls", [("pitch", True), ("roll", True), ("yaw", False)])
def test_falling_over_is_noticed_about_both_horizontal_axes(axis, falls):
    made = engine("labmate", share=0.7)
    made.data.joint(f"{axis}_0").qpos[0] = -1.05
    if falls:
        with pytest.raises(Refused, match="overturned"):
            made.hold(0.0, made.state(), np.zeros(2), 0.001)
    else:
        made.hold(0.0, made.state(), np.zeros(2), 0.001)


def momentum(made: FloorEngine) -> np.ndarray:
    """The linear momentum along x and y (kg m/s), and the angular momentum about the vertical through the
    origin, by MuJoCo."""
    mujoco.mj_forward(made.model, made.data)
    mujoco.mj_subtreeVel(made.model, made.data)
    linear = made.model.body_subtreemass[1] * made.data.subtree_linvel[1]
    return np.array(
        [*linear[:2], made.data.subtree_angmom[1, 2] + np.cross(made.data.subtree_com[1], linear)[2]]
    )


def changes(
    name: str, floor: Floor, step: float, flies: bool = False
) -> tuple[np.ndarray, np.ndarray, float]:
    """Change of the momentum in 0.1 s with motors that turn, impulse of the ground's forces,
    and the largest momentum."""
    random = np.random.default_rng(3)
    system = system_of(find_robot(name))
    n = len(system.mechanism.coordinates)
    made = engine(name, floor, np.concatenate([np.zeros(n), random.uniform(2, 4, system.dof)]))
    if flies:
        made.model.opt.gravity[:] = 0.0
        made.data.qpos[
            [
                made.model.joint(k).qposadr[0]
                for k in range(made.model.njnt)
                if made.model.joint(k).name[:2] == "z_"
            ]
        ] += 1
    tau, impulse, x = random.uniform(-30, 30, len(system.mechanism.inputs)), np.zeros(3), made.state()
    first = momentum(made)
    for _ in range(round(0.1 / step)):
        places = made.data.geom_xpos[made._geoms].copy()
        headings = made._headings @ made.coordinates()[0]
        x = made.hold(0.0, x, tau, step)
        along, across = made.look()[3].reshape(-1, 2).T
        c, s = np.cos(headings), np.sin(headings)
        fx, fy = c * along - s * across, s * along + c * across
        impulse += step * np.array([fx.sum(), fy.sum(), (places[:, 0] * fy - places[:, 1] * fx).sum()])
    assert np.abs(made.look()[1]).max() == 0 if flies else made.look()[1].min() > 0
    return momentum(made) - first, impulse, float(np.abs(first).max())


@pytest.mark.parametrize("name", ["labmate", "tractor_trailer"])
def test_momentum_changes_by_what_the_ground_does(name):
    """Without friction, and in flight, it stays; with friction, slipping, it changes by the impulse of the
    forces and of their moments. The step explains the rest: half of it leaves half.
    """
    for flies in (False, True):
        change, impulse, size = changes(name, Floor(mu=0.0), 1e-3, flies)
        assert np.abs([change, impulse]).max() < 1e-6 * size
    coarse, fine = (changes(name, RUBBER, step) for step in (1e-3, 5e-4))
    rest = [np.abs(change - impulse).max() / size for change, impulse, size in (coarse, fine)]
    assert rest[1] < 1e-3 and rest[1] == pytest.approx(rest[0] / 2, rel=0.1)
    assert np.abs(fine[1]).max() > 0.05 * fine[2]


def test_load_moves_to_the_outer_wheel():
    """In a turn, by the moment of the side force about the axis at the height of the ground:
    F h / (2 b) on each side."""
    rate, spread = 12.0, 2.0
    start = np.array([0, 0, 0, 0, 0, rate + spread, rate - spread], float)
    made = engine("labmate", Floor(mu=5.0), start, height=0.3)
    x = made.state()
    for _ in range(100):
        x = made.hold(0.0, x, np.zeros(2), 0.01)
    _, load, _, force = made.look()
    assert force[1::2].sum() > 1.0
    assert abs((load[0] - load[1]) / (force[1::2].sum() * 0.3 / 0.75) - 1) < 0.05


@pytest.mark.parametrize(
    "angle, mu, patch, slides",
    # atan 0.7 = 0.61
    [(0.55, 0.7, None, False), (0.65, 0.7, None, True), (0.5, 0.7, 0.1, True), (0.5, 0.1, 0.7, False)],
)
def test_a_wheel_across_a_slope_slides_beyond_the_angle_of_friction(angle, mu, patch, slides):
    """It cannot roll down to the left; a patch counts while it is under the wheel."""
    patches = (
        ()
        if patch is None
        else (Patch(x=(-1.0, 1.0), y=(-1.0, 1.0), mu=patch), Patch(x=(2.0, 3.0), y=(-1.0, 1.0), mu=mu))
    )
    made = engine("rolling_disk", Floor(mu=mu, slope=(angle, np.pi / 2), patch=patches))
    for _ in range(20):
        made.hold(0.0, made.state(), np.zeros(2), 0.01)
    assert (made.look()[0].max() > 0.05) == slides


def test_a_low_bump_is_a_flat_floor():
    """The path over a bump of 1 micrometre is that without it."""
    start = np.array([0, 0, 0, 0, 0, 6.0, 6.5])
    states = []
    for bumps in ((), (Bump(x=0.3, y=0.75, height=1e-6, radius=0.3),)):
        made = engine("labmate", Floor(mu=0.7, bump=bumps), start, share=0.7, height=0.1)
        for _ in range(70):
            made.hold(0.0, made.state(), np.zeros(2), 0.01)
        states.append(np.concatenate([made.state(), made.look()[1] / 110]))
    assert np.abs(states[1] - states[0]).max() < 1e-4 and states[0][0] > 0.6


@pytest.mark.parametrize("angle, slides", [(0.55, False), (0.65, True)])
def test_the_flank_of_a_wide_bump_is_a_slope(angle, slides):
    """As the test of a slope, on a sphere of 200 m; the load is the part of the weight that presses on it."""
    height, radius = 80.0, 160.0
    made = engine(
        "rolling_disk",
        Floor(mu=0.7, bump=(Bump(x=0.0, y=-200 * np.sin(angle), height=height, radius=radius),)),
    )
    for _ in range(20):
        made.hold(0.0, made.state(), np.zeros(2), 0.01)
    slip, load, *_ = made.look()
    weight = 9.81 * made.planar.frames[0].mass
    assert (slip.max() > 0.05) == slides
    assert load[0] == pytest.approx(weight * np.cos(angle), rel=1e-2)


def test_a_wheel_on_a_bump_carries_less():
    """By the moment of the weight about the middle of the wheels, as the body leans: W (h_c - r / 16)
    tan(lean) / 2 b on each side; the rims are round also across, with a radius of r / 16.
    """
    raised, height, b, r = 0.05, 0.6, 0.75, 0.15
    made = engine("labmate", Floor(bump=(Bump(x=-0.3, y=b, height=raised, radius=0.5),)), height=height)
    right, left = made.look()[1]
    weight, lean = 32 * 9.81, np.arcsin(raised / (2 * b))
    assert right + left == pytest.approx(weight, rel=1e-3)
    assert abs((right - left) / (weight * (height - r / 16) * np.tan(lean) / b) - 1) < 0.01


def test_height_is_paid_for_in_speed():
    """Down a wide bump without torques: kinetic energy and that of the height together stay,
    within 5 % (0.5 % here)."""
    mechanism = find_robot("labmate")
    energy = ca.Function("energy", [mechanism.q, mechanism.qdot, mechanism.p], [mechanism.energy()])
    start = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 10.0, 10.0])
    made = engine("labmate", Floor(mu=0.7, bump=(Bump(x=-1.8, y=0.0, height=0.3, radius=4.0),)), start)

    def parts() -> tuple[float, float]:
        rise, speed = (float(getattr(made.data.joint("z_0"), name)[0]) for name in ("qpos", "qvel"))
        return float(
            energy(*made.coordinates(), mechanism.parameter_values({}))
        ) + 16 * speed**2, 32 * 9.81 * rise

    kinetic, potential = parts()
    for _ in range(50):
        made.hold(0.0, made.state(), np.zeros(2), 0.01)
    moving, lower = parts()
    assert potential - lower > 15 and made.look()[0].max() < 1e-3
    assert abs((moving - kinetic) / (potential - lower) - 1) < 0.05


def test_a_rough_floor_is_the_same_for_the_same_seed():
    rough = {"count": 40, "x": (0.0, 3.0), "y": (-1.0, 1.0), "height": 0.01, "radius": 0.2}
    one, same, other = (Floor(rough=Rough(**rough, seed=seed)).bumps for seed in (1, 1, 2))
    assert one == same != other and len(one) == 40
    assert all(0 <= b.x <= 3 and -1 <= b.y <= 1 and 0 < b.height <= 0.01 and b.radius == 0.2 for b in one)
    assert Bump(x=1.0, y=0.0, height=0.1, radius=0.3).at(1.0, 0.3 - 1e-9) == pytest.approx(0.0, abs=1e-8)
    assert Floor(bump=one).height(one[3].x, one[3].y) >= one[3].height * (1 - 1e-9)


def test_the_command_line(tmp_path, capsys):
    out = tmp_path / "run.csv"
    set_ = ["--set", "simulation.period=0.01", "--set", "simulation.duration=0.3", "--set", "floor={mu=2.0}"]
    assert main(["simulate", "line", "--engine", "mujoco", *set_, "-o", str(out)]) == 0
    assert "slip at most" in capsys.readouterr().out
    first = out.read_bytes()
    head = first.decode().splitlines()[0].split(",")
    wheels = ("right_wheel", "left_wheel")
    assert head[-7:] == [
        *(f"slip_{w}" for w in wheels),
        *(f"load_{w}" for w in wheels),
        "reckoned_x",
        "reckoned_y",
        "reckoned_phi",
    ]
    assert main(["simulate", "line", "--engine", "mujoco", *set_, "-o", str(out), "--json"]) == 0
    assert '"slips_for"' in capsys.readouterr().out
    assert out.read_bytes() == first  # the same at every run


@pytest.mark.parametrize(
    "changes, said",
    [
        (["simulation.period=0.0"], "period > 0"),
        (["floor.step=0.01"], "[floor] step = 0.01 must be at most 0.002"),
        (["floor={mu=-1}"], "floor"),
        (["floor={slope=1.5}"], "too steep"),
        (["floor={patch=[{x=[1,0],y=[0,1],mu=0.2}]}"], "must be below"),
        (["floor={patch=3}"], "not a list"),
        (["floor={bump={x=1,y=0,height=0.1,radius=0.3}}"], "is not a list, for example [{ x = 1"),
        (["floor={bump=[{x=1,y=0,height=0.1}]}"], "[floor] bump[0] radius is missing"),
        (["floor={bump=[{x=1,y=0,height=-0.1,radius=0.3}]}"], "height = -0.1 must be positive"),
        (["floor={bump=[{x=1,y=0,height=0.4,radius=0.3}]}"], "at most its radius, 0.3"),
        (["floor={rough={count=0,x=[0,1],y=[0,1],height=0.01,radius=0.2}}"], "must be 1 or more"),
        (["floor={rough={count=9999,x=[0,1],y=[0,1],height=0.01,radius=0.2}}"], "must be at most 1000"),
        (["floor={rough={count=9,x=[1,0],y=[0,1],height=0.01,radius=0.2}}"], "must be below"),
        (["floor={rough={count=9,x=[0,1],y=[0,1],height=0.3,radius=0.2}}"], "at most the radius, 0.2"),
        (['robot="knife_edge"', "parameters={}", "output.L=0.3"], "no contact has a wheel"),
        (["plant={I_w=0.0}"], "no inertia about its axle"),
        (["plant={d=0.3}", "contact={share=0.999}"], "the rest would balance 281 m ahead"),
        (["sensors={pose='wrong'}"], "pose"),
        (["floor={grip=1}"], "unknown key"),
        (["sensors={pose='true'}", "correction={rate=1.0}"], "the true pose needs no correction"),
    ],
)
def test_bad_input_is_one_line(changes, said, tmp_path, capsys):
    set_ = [part for change in ("simulation.period=0.01", *changes) for part in ("--set", change)]
    assert main(["simulate", "line", "--engine", "mujoco", *set_, "-o", str(tmp_path / "run.csv")]) == 2
    error = capsys.readouterr().err
    assert said in error and len(error.splitlines()) == 1


def test_mujoco_is_optional():
    """Without it a run on a floor says in one line what to install; any other run does not import it."""
    text = """if True:
        import sys
        sys.modules["mujoco"] = None
        from noslip.cli.main import main
        run = ["simulate", "line", "-o", "-", "--set", "simulation.period=0.01", "--set",
            "simulation.duration=0.02"]
        sys.exit(10 * main(run) + main([*run, "--engine", "mujoco"]))"""
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].endswith(f"MuJoCo is not installed; {installing('physics')}")


def test_the_pose_that_the_controller_sees():
    """True unless [sensors] says otherwise: with reckoning,
    where the robot has slipped it is not where it believes."""
    spec = read_varied(
        LINE, FAST | SHORT | {"limits": {"torque": [20.0]}, "contact": {"share": 0.7}, "sensors": {}}
    )
    there = simulate(spec, engine="mujoco")
    assert np.array_equal(there.seen[:, :3], there.floor.reckoned)
    assert np.abs(there.seen[-1, :3] - there.q[-1, :3]).max() > 0.05


def test_a_floor_without_an_engine_is_reported(tmp_path, capsys):
    set_ = ["--set", "simulation.duration=0.02", "--set", "floor={mu=0.5}"]
    assert main(["simulate", "line", *set_, "-o", str(tmp_path / "run.csv")]) == 0
    assert "[floor] has no effect without --engine mujoco" in capsys.readouterr().err


@pytest.mark.parametrize("mu", [0.7, 0.3])
def test_the_grip_limiter_keeps_the_wheels_rolling_on_a_real_floor(mu):
    """From the paper's start, on the floor that it believes in;
    on a worse one than it believes in they slip."""
    limits = FAST | SHORT | {"contact": {"mu": mu, "share": 0.7}, "limits": {"mode": "grip"}}
    there = simulate(read_varied(LINE, limits), engine="mujoco")
    assert there.floor.slip.max() < 0.002 and 0.8 < there.floor.use.max() < 1.0
    if mu == 0.7:
        assert (
            simulate(read_varied(LINE, limits | {"floor": {"mu": 0.3}}), engine="mujoco").floor.slip.max()
            > 0.1
        )


ROBOT_SPECS = sorted(file.stem for file in (LINE.parent / "robots").glob("*.toml") if file.stem in ROBOTS)


@pytest.mark.nightly
@pytest.mark.parametrize("name", ROBOT_SPECS)
def test_every_robot_rolls_where_friction_is_high(name):
    """The shipped runs on a floor with mu 5 and as the rolling model has them, over 4 s: to 5 mm,
    and 1 cm/s of slip."""
    spec = read_varied(
        LINE.parent / "robots" / f"{name}.toml",
        {"simulation.period": 0.005, "simulation.duration": 4.0, "floor": {"mu": 5.0}},
    )
    there, rolling = simulate(spec, engine="mujoco"), simulate(spec)
    places = [k for k, c in enumerate(there.law.system.mechanism.coordinates) if c.unit == "m"]
    assert np.abs(there.q - rolling.q)[:, places].max() < 5e-3
    assert there.floor.slip.max() < 0.01


@pytest.mark.nightly
@pytest.mark.parametrize(
    "mu, survive", [(0.7, {"figure_1_type_i", "figure_11", "figure_13"}), (0.3, {"figure_13"})]
)
def test_which_of_the_papers_starts_survive_on_a_floor(mu, survive):
    """As docs/engine.md states: at 100 Hz, without limits of the motors; figure 13 only coasts."""
    ran = set()
    for file in sorted((LINE.parent / "figures").glob("figure_*.toml")):
        spec = read_varied(file, {"simulation.period": 0.01, "contact": {"mu": mu, "share": 0.7}})
        there = simulate(spec, engine="mujoco")
        if there.stopped is None and there.floor.slip.max() < 0.01:
            ran.add(file.stem)
    assert ran == survive


@pytest.mark.nightly
def test_halving_the_step_changes_a_path_by_less_than_a_millimetre(monkeypatch):
    """Each halving halves the change: the method is of first order. Slowly and with much friction it agrees
    with rolling."""
    monkeypatch.syspath_prepend(LINE.parents[2] / "checks/bench")
    bench = importlib.import_module("engine")
    for name, (changes, limit) in bench.RUNS.items():
        first, second = bench.moved(changes)
        assert first < limit and second < 0.7 * first, name
    assert bench.from_rolling(bench.RUNS[bench.ROLLING][0]) < 1e-3


def test_loads_of_a_robot_with_a_castor_are_those_of_the_balance():
    """The load on the Pioneer's axle while it starts to turn: that of contact_forces,
    and what the spin of the wheels takes."""
    circle = {"type": "IV", "L": 0.2, "path": {"kind": "circle", "x_f": 0.0, "y_f": 0.0, "R": 1.5}}
    start = {
        "initial": {"point": [1.5, 0.0], "heading": np.pi / 2, "speed": 0.0},
        "reference.speed": 0.8,
        "output": circle,
    }
    rest = {"simulation.period": 0.01, "simulation.duration": 0.4, "contact": {"mu": 0.8, "height": 0.12}}
    there = simulate(read_varied(LINE.parent / "robots" / "pioneer_3dx.toml", start | rest), engine="mujoco")
    model = contact_forces(there.plant, there.x, there.tau, there.spec.contact)
    still = contact_forces(there.plant, there.x, there.tau, ContactSection())
    sizes = dict(
        zip([p.name for p in there.plant.system.mechanism.parameters], there.plant.parameters, strict=True)
    )
    spin = np.array([there.plant.rate(x, tau)[5:].sum() for x, tau in zip(there.x, there.tau, strict=True)])
    load, at_rest = (sum(contact.load for contact in each[:2]) for each in (model, still))
    moved = load + sizes["I_w"] * spin / sizes["c"] - at_rest
    measured = there.floor.load.sum(axis=1) - at_rest
    assert moved[10] < -5.0 and np.abs(measured - moved)[10:].max() < 0.05 * np.abs(moved).max()


def cart_with_rollers() -> Mechanism:
    """Four driven wheels; the roller on the ground has its axis at 45 deg,
    front right and rear left to the left, else right."""
    robot = Mechanism("cart_with_rollers", "four wheels with rollers")
    x, y, phi = (robot.coordinate(name, unit) for name, unit in (("x", "m"), ("y", "m"), ("phi", "rad")))
    forward = ca.cos(phi) * robot.rate(x) + ca.sin(phi) * robot.rate(y)
    left = ca.cos(phi) * robot.rate(y) - ca.sin(phi) * robot.rate(x)
    turning = robot.rate(phi)
    robot.body("body", ca.SX(20.0), ca.SX(1.5), forward - 0.02 * turning, left + 0.05 * turning, turning)
    for name, ahead, aside, sign in (
        ("fr", 0.3, -0.2, 1),
        ("fl", 0.3, 0.2, -1),
        ("rr", -0.3, -0.2, -1),
        ("rl", -0.3, 0.2, 1),
    ):
        theta = robot.coordinate(f"theta_{name}", "rad")
        c, s = np.sqrt(0.5), sign * np.sqrt(0.5)
        slip = c * (forward - aside * turning - 0.1 * robot.rate(theta)) + s * (left + ahead * turning)
        robot.kinetic_energy(0.02 * robot.rate(theta) ** 2 / 2)
        robot.rolls(f"{name} rolls", slip)
        share = 1 + 0.05 * ahead / 0.3**2 + 0.02 * aside / 0.2**2  # of four equal springs
        robot.contact(name, 5.0 * share, along=slip, left=aside, ahead=ahead)
        robot.input(f"tau_{name}", "N m", on=robot.rate(theta))
    for name, unit, rate in (
        ("forward", "m/s", forward),
        ("left", "m/s", left),
        ("yaw_rate", "rad/s", turning),
    ):
        robot.quasi_velocity(name, unit, rate)
    robot.moves_in_plane(x, y, phi)
    return robot


def rollers(mu: float, start=None, **floor) -> FloorEngine:
    mechanism = cart_with_rollers()
    start = np.zeros(10) if start is None else start
    return FloorEngine(Plant(system_of(mechanism), []), ContactSection(), Floor(mu=mu, **floor), start)


def test_wheels_with_rollers_roll_as_the_mechanism():
    """The moments of the loads; then, with torques that ask for little grip,
    the motion of the rolling model, and its energy."""
    made = rollers(0.7)
    moments = np.array([[1, *wheel.place] for wheel in made.planar.wheels]).T
    assert moments @ made.look()[1] == pytest.approx(9.81 * 20 * np.array([1, 0.05, 0.02]), rel=2e-3)
    start, tau = (
        np.array([0.2, -0.1, 0.5, 1.0, 2.0, 3.0, 4.0, 0.4, -0.3, 0.8]),
        np.array([0.5, -0.2, 0.3, 0.1]),
    )
    plant, made = Plant(system_of(cart_with_rollers()), []), rollers(0.7, start)
    x, rolling = made.state(), start
    assert x == pytest.approx(start, abs=1e-9) and made.look()[0].max() < 1e-9
    for _ in range(100):
        x, rolling = made.hold(0.0, x, tau, 0.01), plant.step(rolling, tau, 0.01, 1e-10)[0]
    assert np.abs(x - rolling)[:3].max() < 0.001 and np.abs(x - rolling)[7:].max() < 0.002
    assert np.hypot(*(rolling - start)[:2]) > 0.3 and made.look()[0].max() < 0.002  # it turns during a step
    energy = plant.energy(np.array([x, rolling]))
    assert energy[0] == pytest.approx(energy[1], rel=2e-3)


def test_rollers_push_along_their_axes_only():
    """Sliding, the force at each contact is within friction and along its roller; momentum changes by these
    forces, and without friction not at all.
    """
    for mu in (0.3, 0.0):
        made = rollers(mu, np.array([0, 0, 0.4, 0, 0, 0, 0, 1.0, -0.5, 1.5]))
        first, impulse, x, step = momentum(made), np.zeros(3), made.state(), 2.5e-4
        for _ in range(400):
            places, heading = made.data.geom_xpos[made._geoms].copy(), made.coordinates()[0][2]
            x = made.hold(0.0, x, np.array([9.0, -9.0, 5.0, 2.0]), step)
            along, across = made.look()[3].reshape(-1, 2).T
            angles = heading + np.pi / 4 * np.array([1, -1, -1, 1])
            force = along * np.array([np.cos(angles), np.sin(angles)])
            assert np.abs(across).max() < 1e-2 * made.look()[1].max()  # it has turned since
            assert made.look()[2].max() <= 1.0  # of the limit by the load of the step before
            impulse += step * np.array(
                [*force.sum(axis=1), (places[:, 0] * force[1] - places[:, 1] * force[0]).sum()]
            )
        change = momentum(made) - first
        assert np.abs(change - impulse).max() < 2e-3 * np.abs(first).max()
        assert made.look()[0].max() > 0.1 and (mu == 0) == (np.abs(change).max() < 5e-5 * np.abs(first).max())


@pytest.mark.parametrize("heading", [0.0, np.pi / 2, 2.0])
def test_a_cart_with_rollers_rolls_down_a_slope(heading):
    """In every direction as fast: with 20 kg of gravity, and four wheels of 0.02 kg m^2 that turn by its way
    over 0.1 m."""
    made = rollers(0.7, slope=(0.1, heading))
    for _ in range(10):
        made.hold(0.0, made.state(), np.zeros(4), 0.01)
    way = made.coordinates()[0][:2]
    fallen = 20 / 28 * 9.81 * np.sin(0.1) * 0.1**2 / 2
    assert np.abs(way - fallen * np.array([np.cos(heading), np.sin(heading)])).max() < 0.03 * fallen
    assert made.look()[0].max() < 0.0001


def test_rollers_on_bumps_are_refused():
    with pytest.raises(BadInput, match="wheels with rollers on bumps"):
        rollers(0.7, bump=(Bump(x=1.0, y=0.0, height=0.01, radius=0.1),))


# -- a body that leans ---------------------------------------------------------------------------------------

STANDING = {"reference.commands": [], "push": [], "simulation.output_step": 0.01}
MOVING = {
    "reference.commands": [{"distance": 0.3, "turn": 0.5, "time": 1.0}],
    "push": [
        {"time": 0.305, "on": "speed", "impulse": 1.0},
        {"time": 0.6, "on": "yaw_rate", "impulse": 0.05},
    ],
    "simulation.duration": 1.5,
    "simulation.output_step": 0.01,
}


def test_a_balancer_leans_as_the_equations_say():
    """It stands up from a tilt, drives an arc, is pushed twice and stops, by the C of its state feedback: the
    run with wheels that roll is approached in proportion to the engine's step.
    """
    rolling = simulate(read_varied("balancer", MOVING))
    off, slip = [], []
    for step in (1e-3, 5e-4):
        there = simulate(
            read_varied("balancer", MOVING | {"floor": {"mu": 5.0, "step": step}}), engine="mujoco"
        )
        assert there.stopped is None
        slip.append(there.floor.slip.max())
        off.append(np.abs(there.x - rolling.x).max(axis=0))
    names = [q.name for q in rolling.law.system.state]
    largest = dict(zip(names, off[1], strict=True))
    assert max(largest[name] for name in ("x", "y", "phi", "pitch")) < 0.002
    assert max(largest[name] for name in ("speed", "yaw_rate", "pitch_rate")) < 0.01
    assert slip[0] < 0.02 and slip[1] < 0.6 * slip[0]
    ratio = off[1] / off[0]
    assert ((0.45 < ratio) & (ratio < 0.55)).all(), dict(zip(names, ratio, strict=True))


def test_a_balancer_stands_on_a_slope_by_its_weight():
    """Its wheels hold what its weight pulls down the slope,
    and all weight is above the axle's line on the ground."""
    slope = 0.05
    spec = read_varied(
        "balancer", STANDING | {"floor.slope": [slope, 0.0], "floor.mu": 1.0, "simulation.duration": 6.0}
    )
    there = simulate(spec, engine="mujoco")
    p = {q.name: q.default for q in find_robot("balancer").parameters}
    whole, r, moment = p["m"] + 2 * p["m_w"], p["r"], p["m"] * p["h"]
    pitch = there.q[-1, [c.name for c in find_robot("balancer").coordinates].index("pitch")]
    assert pitch < -0.01
    above = moment * np.sin(pitch) * np.cos(slope) + (whole * r + moment * np.cos(pitch)) * np.sin(slope)
    assert above == pytest.approx(0.0, abs=1e-3 * whole * r)
    assert there.tau[-1].sum() == pytest.approx(-whole * 9.81 * r * np.sin(slope), rel=1e-3)
    assert there.floor.load[-1].sum() == pytest.approx(whole * 9.81 * np.cos(slope), rel=1e-3)


def test_a_balancer_without_grip_falls():
    """On ice its wheels spin, and the run ends where it lies on the floor."""
    ice = STANDING | {"floor.mu": 0.01, "initial.state": {"pitch": 0.6}, "simulation.duration": 3.0}
    made = simulate(read_varied("balancer", ice), engine="mujoco")
    assert made.stopped == "overturned" and made.floor.slip.max() > 0.5


def test_a_law_that_lets_it_fall_is_stopped():
    """Held speeds leave the body to itself: it falls, at the latest to the floor."""
    falls = {"output": {"type": "speeds"}, "reference": {"position": [0.0, 0.0]}, "push": []}
    made = simulate(read_varied("balancer_drive", falls), engine="mujoco")
    pitch = made.q[:, [c.name for c in find_robot("balancer").coordinates].index("pitch")]
    assert made.stopped == "overturned" and 1.3 < abs(pitch[-1]) < 1.6


LEANING = {
    "contact.height=0.3": "[contact] height and share are for robots whose bodies stay level",
    "contact.share=0.9": "[contact] height and share are for robots whose bodies stay level",
    "scene={file='robot.xml'}": "[feedback] does not go with [scene]",
}


def test_figures_and_files_are_of_robots_that_stay_level(bad_input, tmp_path):
    argv = [
        "simulate",
        "balancer",
        "-o",
        str(tmp_path / "run.csv"),
        "--set",
        "simulation.duration=0.1",
        "--set",
        "push=[]",
    ]
    assert "scenes are for robots that stand by themselves" in bad_input(
        [*argv, "--write-scene", str(tmp_path / "x.xml")]
    )
    assert "it rises and falls as it leans" in bad_input([*argv, "--contact", str(tmp_path / "x.png")])


@pytest.mark.parametrize("changed", LEANING)
def test_what_a_body_that_leans_does_not_have(changed, bad_input, tmp_path):
    argv = ["simulate", "balancer", "-o", str(tmp_path / "run.csv"), "--engine", "mujoco", "--set", changed]
    assert LEANING[changed] in bad_input(argv)


def test_the_engine_says_first_what_it_leaves_out():
    """Of the LABMATE what nothing says; nothing of a robot that names castors and the height of its mass."""
    short = {"simulation.period": 0.01, "simulation.duration": 0.02, **FAST}
    said = summary(simulate(read_varied(LINE, short), engine="mujoco")).splitlines()[1]
    assert (
        "leaves out" in said
        and "height of the centre of mass" in said
        and "castors" in said
        and "skid steer" in said
    )
    high = summary(
        simulate(read_varied(LINE, {**short, "contact": {"mu": 0.7, "height": 0.2}}), engine="mujoco")
    )
    assert "height of the centre of mass" not in high.splitlines()[1] and "castors" in high.splitlines()[1]
