"""The firmware of the vehicle of a SPEC: its numbers are those of the SPEC,
and it drives as `noslip simulate` says."""

import csv
import math
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from noslip.checks.verification.project import FIRMWARE
from noslip.cli.main import main
from noslip.codegen.printing.scalar import SCALARS
from noslip.codegen.project.vehicle import vehicle_files
from noslip.readers.errors import BadInput
from noslip.simulation import noise
from noslip.simulation.closed_loop import simulate
from noslip.simulation.contact import contact_forces
from noslip.simulation.controllers import ON_TARGET
from noslip.simulation.firmware.numbers import vehicle_of
from noslip.simulation.firmware.run import runs_as_firmware
from noslip.simulation.guidance import outputs
from noslip.simulation.run import Run
from noslip.simulation.specification.spec import spec_of
from noslip.tests.tools import skip_without

AGV = """
robot = "labmate"
parameters = { b = 0.29, d = 0.07, r = 0.085, m_c = 41.0, I_c = 3.1 }
plant = { m_c = 44.0 }
gains = { kp = 2.0, kd = 3.0, kv = 2.0 }
output = { type = "IV", L = 0.21, path = { kind = "composite", stop = "axle", segments = [
  { kind = "line", from = [0.0, 0.0], to = [1.5, 0.0] },
  { kind = "arc", radius = 1.1, angle = 1.2 },
  { kind = "line", length = 1.0 } ] } }
reference = { speed = 0.7, deceleration = 0.6 }
initial = { point = [0.3, 0.05], heading = 0.08, speed = 0.0 }
sensors = { counts = 4096, pose = "reckoned" }
limits = { torque = 8.0, mode = "slow" }
simulation = { duration = 7.0, period = 0.01, output_step = 0.01 }
"""
VELOCITY = (
    'drive = { kind = "velocity", bandwidth = 4.0, delay = 0.013, most_speed = 20.0, '
    "most_acceleration = 30.0 }"
)
VARIANTS = {  # what is replaced, or added before the first line
    "torque": {},
    "late": {"period = 0.01, output": "period = 0.01, delay = 0.006, output"},
    "cut": {'mode = "slow"': 'mode = "cut"'},
    "integral": {
        "kv = 2.0 }": "kv = 2.0, ki_distance = 0.8, ki_speed = 0.5 }",
        "torque = 8.0": "torque = 8.0, integral = 0.4",
    },
    "grip": {'mode = "slow"': 'mode = "grip"', "robot =": "contact = { mu = 0.4, height = 0.2 }\nrobot ="},
    "noise": {
        "counts = 4096": "counts = 4096, noise = { mean = [0.02, -0.01], sd = [0.1, 0.2] }, seed = 5, period "
        "= 0.03"
    },
    "rows between ticks": {"output_step = 0.01": "output_step = 0.007"},
    "late velocity": {
        'limits = { torque = 8.0, mode = "slow" }': VELOCITY,
        "period = 0.01, output": "period = 0.01, delay = 0.008, output",
    },
    "velocity": {'limits = { torque = 8.0, mode = "slow" }': VELOCITY},
    "in reverse": {
        '{ kind = "line", length = 1.0 }': '{ kind = "line", length = 1.0 }, { kind = "line", length = 0.8, '
        "backward = true }",
        "L = 0.21": 'L = 0.21, reversing = "switch"',
    },
}
STEERED = """
robot = "{robot}"
plant = {{ m = {mass} }}
gains = {{ kp = 2.0, kd = 3.0, kv = 0.8 }}
output = {{ type = "IV", L = 0.5, path = {{ kind = "composite", stop = "point", segments = [
  {{ kind = "line", from = [0.0, 0.0], to = [4.0, 0.0] }},
  {{ kind = "arc", radius = {radius}, angle = -0.8 }},
  {{ kind = "line", length = 3.0 }} ] }} }}
reference = {{ speed = 1.2, deceleration = 0.5 }}
initial = {{ point = [0.3, 0.05], heading = 0.05, speed = 0.0 }}
sensors = {{ counts = 8192, pose = "reckoned" }}
{drives}
simulation = {{ duration = 9.0, period = 0.01, output_step = 0.01 }}
"""
TORQUES = 'limits = {{ torque = [{}, {}], mode = "slow" }}'
WITHIN = 4e-3  # m: the follower begins without the rates of the wheels, and computes in float


def variant(name: str) -> str:
    text = AGV
    for old, new in VARIANTS[name].items():
        assert text.count(old) == 1
        text = text.replace(old, new)
    return text


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Path:
    """The project of AGV for this host."""
    folder = tmp_path_factory.mktemp("vehicle")
    (folder / "agv.toml").write_text(AGV)
    assert main(["export", str(folder / "agv.toml"), "--firmware", "generic", "-o", str(folder / "agv")]) == 0
    return folder / "agv"


def driven(folder: Path) -> list[dict[str, str]]:
    """The rows of the drive of a project."""
    done = subprocess.run(
        ["make", "-s", "-C", folder, "test"], capture_output=True, text=True, stdin=subprocess.DEVNULL
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr == ""  # no warning
    with (folder / "build/run.csv").open() as file:
        return list(csv.DictReader(file))


def same_as_simulated(folder: Path, text: str) -> Run:
    """The run of `noslip simulate` in float, whose bytes the drive of a project printed."""
    run = simulate(spec_of(text, "agv.toml"), "cf")
    assert (folder / "build/run.csv").read_text() == run.csv()
    return run


def off(rows: list[dict[str, str]], text: str, names: tuple[str, str] = ("x_c", "y_c")) -> float:
    """How far the vehicle is, at most, from where the loop of `noslip simulate` in double has it,
    stage by stage in Python, m."""
    run = simulate(spec_of(text, "agv.toml"), "c")
    assert len(rows) == len(run.t) and np.ptp(run.q[:, 0]) > 2.5  # it has driven
    return max(
        math.dist([float(row[name]) for name in names], q[:2]) for row, q in zip(rows, run.q, strict=True)
    )


def of_variant(project: Path, folder: Path, text: str) -> Path:
    """A copy of the project with the numbers of another SPEC."""
    shutil.copytree(project, folder, ignore=shutil.ignore_patterns("build", "*.run"))
    loop, vehicle = vehicle_of(spec_of(text, "agv.toml"))
    files = vehicle_files(loop.law, SCALARS["float"], vehicle)
    files |= {f"selftest/{name}": text for name, text in noise.source().items()} if vehicle.noise else {}
    for name, content in files.items():
        (folder / name).write_text(content)
    return folder


@pytest.mark.parametrize("name", VARIANTS)
def test_it_drives_as_simulated(name, project, tmp_path):
    text = variant(name)
    folder = of_variant(project, tmp_path / "agv", text)
    assert off(driven(folder), text) < WITHIN
    shows_the_model(same_as_simulated(folder, text))


def shows_the_model(run: Run) -> None:
    """What the rows show beside the state is that of the model, which Python evaluates."""
    x, plant, scale = run.x, run.plant, np.abs(run.forces).max()
    assert run.y == pytest.approx(outputs(run.law)(x.T, plant.parameters, run.config.T).full().T, abs=1e-12)
    assert run.forces == pytest.approx(plant.constraint_forces(x, run.tau), abs=1e-11 * scale)
    for contact in contact_forces(plant, x, run.tau, run.spec.contact) if run.spec.contact else ():
        assert run.use[contact.name] == pytest.approx(contact.use, rel=1e-10)
    simulation = run.spec.simulation
    if not run.command.size and simulation.delay == 0 and simulation.output_step == simulation.period:
        for k in (5, 60, 250):  # from row to row nothing but held torques moves it
            after, error = plant.step(x[k], run.tau[k], simulation.period, 1e-12)
            assert error < 1 and x[k + 1] == pytest.approx(after, abs=1e-8)


@pytest.mark.parametrize("drives", ["torque", "velocity"])
@pytest.mark.parametrize("robot", ["car", "tricycle"])
def test_a_steered_vehicle_drives_as_simulated(robot, drives, tmp_path):
    """Its dead reckoning is that of the axle, from the angles of a rolling and of a steered wheel."""
    mass, radius, torques = (1300.0, 9.0, (900.0, 200.0)) if robot == "car" else (90.0, 4.0, (25.0, 10.0))
    kinds = {"torque": TORQUES.format(*torques), "velocity": VELOCITY}
    text = STEERED.format(robot=robot, mass=mass, radius=radius, drives=kinds[drives])
    (tmp_path / "vehicle.toml").write_text(text)
    assert (
        main(
            [
                "export",
                str(tmp_path / "vehicle.toml"),
                "--firmware",
                "generic",
                "-o",
                str(tmp_path / "vehicle"),
            ]
        )
        == 0
    )
    assert off(driven(tmp_path / "vehicle"), text, ("x", "y")) < WITHIN
    shows_the_model(same_as_simulated(tmp_path / "vehicle", text))


def test_a_vehicle_that_is_stopped(project, tmp_path):
    text = AGV.replace("torque = 8.0", "torque = 0.02").replace("0.08, speed = 0.0", "1.2, speed = 0.6")
    folder = of_variant(project, tmp_path / "agv", text)
    done = subprocess.run(
        ["make", "-s", "-C", folder, "test"], capture_output=True, text=True, stdin=subprocess.DEVNULL
    )
    assert done.returncode != 0 and "astray" in done.stdout
    run = same_as_simulated(folder, text)
    assert run.stopped == "astray" and run.t[-1] < 1 and not run.tau[-1].any()


def test_the_numbers_are_those_of_the_spec(project):
    text = (project / "vehicle.c").read_text()
    members = dict(re.findall(r"\.(\w+) = (-?[\d.e-]+)f?\b", text))
    for name, value in {
        "b": 0.29,
        "d": 0.07,
        "r": 0.085,
        "m_c": 41.0,
        "I_c": 3.1,
        "period": 0.01,
        "kp_distance": 2.0,
    }.items():
        assert float(members[name]) == pytest.approx(value, rel=1e-6)
    assert ".counts_per_turn = {4096.0f, 4096.0f}" in text and ".limit = {8.0f, 8.0f}" in text
    assert text.count("Assumed:") == 4
    assert ".m_c = 44.0" in (project / "selftest/drive.c").read_text()  # the true mass is that of the plant


@pytest.mark.parametrize(
    "old, new", [(".b = 0.29f", ".b = 0.24f"), (".counts_per_turn = {4096.0f", ".counts_per_turn = {3900.0f")]
)
def test_a_wrong_number_is_found(old, new, project, tmp_path):
    """The comparison above sees it."""
    folder = tmp_path / "agv"
    shutil.copytree(project, folder, ignore=shutil.ignore_patterns("build", "*.run"))
    text = (folder / "vehicle.c").read_text()
    assert text.count(old) == 1
    (folder / "vehicle.c").write_text(text.replace(old, new))
    assert off(driven(folder), AGV) > 10 * WITHIN


@pytest.mark.parametrize("target", [name for name in FIRMWARE if name != "generic"])
def test_the_same_rows_on_every_target(target, project, tmp_path):
    skip_without(FIRMWARE[target].missing("make"))
    (tmp_path / "agv.toml").write_text(AGV)
    assert (
        main(["export", str(tmp_path / "agv.toml"), "--firmware", target, "-o", str(tmp_path / "agv")]) == 0
    )
    driven(tmp_path / "agv")
    run = same_as_simulated(tmp_path / "agv", AGV)
    (backend,) = [name for name, on in ON_TARGET.items() if on.startswith(target)]
    assert simulate(spec_of(AGV, "agv.toml"), backend).csv() == run.csv()


@pytest.mark.parametrize(
    "old, new, says",
    [
        ("counts = 4096, ", "", "requires [sensors] counts"),
        ('pose = "reckoned"', 'pose = "true"', "set pose"),
        ("period = 0.01, ", "", "period"),
        ("kv = 2.0 }", "kv = 2.0, ko_speed = 1.0 }", "a follower does not have it"),
        ("speed = 0.7", 'speed = "fastest", lateral = 1.0, acceleration = 1.0, '
                        'angular = 2.0', "a follower does not have it"),
        ("L = 0.21", "L = 0.21, W = 0.05", "a follower does not have it"),
        ("deceleration = 0.6", "deceleration = 0.6, approach = { "
                               "acceleration = 0.4 }", "a follower leads the distance alone"),
        ('limits = { torque = 8.0, mode = "slow" }', "", "requires [limits] torque"),
        ("plant =", 'push = [{ time = 1.0, on = "thetadot_r", impulse = 0.05 '
                    '}]\nplant =', "does not push the vehicle"),
    ],
)  # fmt: skip
def test_what_a_follower_does_not_have_is_refused(old, new, says):
    assert AGV.count(old) == 1
    with pytest.raises(BadInput, match=re.escape(says)):
        vehicle_of(spec_of(AGV.replace(old, new), "agv.toml"))


def test_what_a_follower_does_not_have_is_run_stage_by_stage():
    pushed = f'{AGV}[[push]]\ntime = 1.0\non = "thetadot_r"\nimpulse = 0.05\n'
    for text, as_firmware in (
        (AGV, True),
        (pushed, False),
        (AGV.replace("L = 0.21", "L = 0.21, W = 0.05"), False),
    ):
        spec = spec_of(text, "agv.toml")
        assert (
            runs_as_firmware(replace(spec, simulation=replace(spec.simulation, backend="cf"))) == as_firmware
        )
        assert not runs_as_firmware(spec)  # in double


def test_what_only_an_engine_reads_is_said():
    (warning,) = simulate(spec_of(f"{AGV}[floor]\nmu = 0.3\n", "agv.toml"), "cf").warnings
    assert warning == "[floor] has no effect without --engine mujoco: the wheels roll"


def test_a_robot_without_a_follower_is_refused():
    others = AGV.strip().split("\n", 3)[3]
    with pytest.raises(BadInput, match="dead reckoning needs"):
        vehicle_of(spec_of(f'robot = "knife_edge"\n{others}', "agv.toml"))


def test_the_command_line_says_what_is_wrong(bad_input, tmp_path):
    (tmp_path / "agv.toml").write_text(AGV.replace("counts = 4096, ", ""))
    spec, out = str(tmp_path / "agv.toml"), ["-o", str(tmp_path / "out")]
    assert spec in bad_input(["export", spec, "--firmware", "generic", *out])
    assert "--firmware" in bad_input(["export", spec, *out])
    assert "--firmware" in bad_input(["export", spec, "--fmu", "loop", "-o", str(tmp_path / "x.fmu")])
    assert "leave it out" in bad_input(
        ["export", spec, "--firmware", "generic", "--output", "follower", *out]
    )
    assert "absent.toml" in bad_input(["export", "absent.toml", "--firmware", "generic", *out])
