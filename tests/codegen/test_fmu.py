"""FMUs: valid by FMPy, and the same motion as `simulate` of the sampled loop."""

import json
import re
import subprocess
import zipfile
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path

import noslip.checks.verification.fmu as verification
import numpy as np
import pytest
from noslip.checks.verification.fmu import Instance
from noslip.checks.verification.sampling import random_plants
from noslip.cli.main import main
from noslip.codegen.fmu.fmu import KINDS
from noslip.readers.robots import find_robot, law_of
from noslip.simulation.closed_loop import simulate
from noslip.simulation.controllers.compiled import CompiledController
from noslip.simulation.controllers.controller import ON_LIMIT, Friction, Limits
from noslip.simulation.loop import make_loop
from noslip.simulation.specification.spec import read_spec, spec_of
from noslip.tests.tools import need

LAW, PERIOD, DURATION = "type_iv_circle", 0.01, 2.0
CLOSE = 1e-9


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """The file of an FMU."""
    folder = tmp_path_factory.mktemp("fmu")

    @cache
    def exported(kind: str, robot: str = "labmate", law: str = LAW) -> Path:
        file = folder / f"{robot}_{law}_{kind}.fmu"
        assert main(["export", robot, "--output", law, "--fmu", kind, "-o", str(file)]) == 0
        return file

    return exported


@pytest.fixture
def opened(exported, tmp_path):
    """An instance of an FMU."""

    def opened(kind: str, *which: str) -> Instance:
        folder = tmp_path / kind
        with zipfile.ZipFile(exported(kind, *which)) as archive:
            archive.extractall(folder)
        return Instance(folder)

    return opened


def named(group, quantities, numbers):
    return {f"{group}.{q.name}": float(value) for q, value in zip(quantities, numbers, strict=True)}


@pytest.fixture(scope="module")
def run():
    """A run of the shipped circle, called at a period, and the values that an FMU of it starts with."""
    spec = read_spec("circle")
    return started(
        replace(spec, simulation=replace(spec.simulation, period=PERIOD, duration=DURATION, tolerance=1e-13))
    )


def started(spec):
    """The run of a SPEC, and the values that an FMU of it starts with."""
    truth, loop = simulate(spec, "c"), make_loop(spec)
    assert truth.stopped is None and not spec.plant
    law, config = truth.law, loop.guidance.leg.config
    start = named("params", law.parameters, loop.believed) | named("config", law.config, config)
    start |= named("gains", law.gains, loop.gains) | named("state", law.system.state, loop.start)
    start |= named("extension", law.extension, loop.extension)
    start |= named("reference", law.reference, loop.guidance.reference(0.0, loop.start))
    return truth, start


def only(instance, values):
    return {name: value for name, value in values.items() if name in instance.references}


def compare(run, times, states):
    """The rows of a run at these times."""
    rows = np.searchsorted(run.t, np.array(times) - 1e-6)
    assert np.abs(run.t[rows] - times).max() < 1e-9 and len(times) > 20
    assert np.abs(np.array(states) - run.x[rows]).max() < CLOSE


@pytest.mark.parametrize("step", [PERIOD, 0.4 * PERIOD, 2.5 * PERIOD])
def test_loop_is_the_simulation(opened, run, step):
    """Whatever the communication step is: the law is called at the period."""
    truth, start = run
    loop = opened("loop")
    names = [f"state.{q.name}" for q in truth.law.state]
    assert loop.start(start | {"period": PERIOD})
    times, states = [], []
    for k in range(round(DURATION / step)):
        assert loop.step(k * step, step) and loop.status >= 0
        if abs((k + 1) * step / PERIOD - round((k + 1) * step / PERIOD)) < 1e-9:
            times.append((k + 1) * step)
            states.append(loop.get(names))
    compare(truth, times, states)


def test_controller_and_plant_are_the_simulation(opened, run):
    """The controller does its step first."""
    truth, start = run
    controller, plant = opened("controller"), opened("plant")
    state, tau = (
        [f"{g}.{q.name}" for q in of]
        for g, of in (("state", truth.law.state), ("tau", truth.law.system.mechanism.inputs))
    )
    assert controller.start(only(controller, start))
    assert plant.start(only(plant, start))
    times, states = [], []
    for k in range(round(DURATION / PERIOD)):
        controller.set(dict(zip(state, plant.get(state), strict=True)))
        assert controller.step(k * PERIOD, PERIOD) and controller.status >= 0
        plant.set(dict(zip(tau, controller.get(tau), strict=True)))
        assert plant.step(k * PERIOD, PERIOD)
        times.append((k + 1) * PERIOD)
        states.append(plant.get(state))
    compare(truth, times, states)


@pytest.mark.parametrize("kind", KINDS)
def test_fmpy_finds_no_problem(exported, kind):
    pytest.importorskip("fmpy")
    from fmpy import read_model_description
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(exported(kind))) == []
    description = read_model_description(str(exported(kind)))
    assert description.fmiVersion == "3.0" and description.coSimulation and not description.modelExchange
    units = {variable.unit for variable in description.modelVariables if variable.type == "Float64"}
    assert {"m", "kg", "rad", "s"} <= units and None not in units
    assert all(variable.description for variable in description.modelVariables)


def test_fmpy_simulates_the_loop(exported, run):
    fmpy = pytest.importorskip("fmpy")
    truth, start = run
    names = [f"state.{q.name}" for q in truth.law.state]
    values = fmpy.simulate_fmu(
        str(exported("loop")),
        stop_time=DURATION,
        output_interval=PERIOD,
        start_values=start | {"period": PERIOD},
        output=names,
    )
    compare(truth, values["time"][1:], [list(row)[1:] for row in values[1:]])


def test_every_function_of_the_standard_is_there(opened, tmp_path):
    """And nothing else is visible."""
    fmpy = pytest.importorskip("fmpy")
    need("nm")
    opened("loop")
    (binary,) = (tmp_path / "loop" / "binaries").rglob("*_loop.*")
    symbols = subprocess.run(
        ["nm", "-D", "--defined-only", binary], capture_output=True, text=True, check=True
    ).stdout
    header = (Path(fmpy.__file__).parent / "c-code" / "fmi3Functions.h").read_text()
    assert sorted(line.split()[-1] for line in symbols.splitlines()) == sorted(
        re.findall(r"fmi3FullName\((fmi3\w+)\)", header)
    )


@pytest.mark.parametrize("robot, law", [("labmate", LAW), ("ball_plate", "ball")])
def test_controller_is_the_compiled_law(opened, robot, law):
    """With limits that some inputs exceed, and states at which it is singular or not finite;
    also without config."""
    model = law_of(find_robot(robot), law)
    controller = opened("controller", robot, law)
    names = [f"tau.{q.name}" for q in model.system.mechanism.inputs]
    statuses = set()
    for number, plant in enumerate(random_plants(model, 60, 5)):
        fixed = [named(g, model.groups[g], getattr(plant, g)) for g in ("params", "config", "gains")]
        sizes = np.abs(
            [point.truth.values["tau"].ravel() for point in plant.points] or np.ones((1, len(names)))
        )
        mode = ON_LIMIT[number % len(ON_LIMIT) if model.speed_row is not None else 0]
        limits = Limits(
            tuple(np.median(sizes, axis=0)), mode, Friction(0.5, 0.1, 0.9, 0.2) if mode == "grip" else None
        )
        own = CompiledController(model, plant.params, plant.config, plant.gains, limits=limits)
        start = {name: value for group in fixed for name, value in group.items()}
        start |= named("limit", model.system.mechanism.inputs, limits.torque) | {
            "on_limit": ON_LIMIT.index(mode)
        }
        if limits.friction:
            start |= {f"friction.{name}": value for name, value in asdict(limits.friction).items()}
        assert controller.start(start)
        for k, point in enumerate(plant.points):
            state = np.where(np.arange(len(point.state)) == 0, np.nan, point.state) if k == 7 else point.state
            controller.set(
                named("state", model.state, state) | named("reference", model.reference, point.reference)
            )
            assert controller.step(k * 0.1, 0.1)
            status, tau = own.step(state, point.reference)
            assert np.array_equal(controller.get(names), tau)
            assert own._library.status(controller.status) == status
            statuses.add(status)
    assert {"ok", "saturated", "nonfinite", *["grip"] * (robot == "labmate")} <= statuses


EXTENDED = """
robot = "labmate"
output = { type = "IV", L = -0.3, extension = true, path = { kind = "circle", x_f = 0.0, y_f = 0.0, R = 2.0 \
} }
reference = { speed = 0.5 }
initial = { point = [2.1, 0.0], heading = 1.7, speed = 0.45, extension = [0.2] }
simulation = { duration = 2.0, period = 0.01, tolerance = 1e-13 }
"""


def test_extended_laws_are_the_simulation(opened, tmp_path):
    """The loop, and controller and plant in turn: the states of the extension advance between the calls,
    from those given."""
    truth, start = started(spec_of(EXTENDED, tmp_path / "spec.toml"))
    law = truth.law
    assert truth.extension[0] == [0.2] and np.abs(np.diff(truth.extension, axis=0)).max() > 1e-4
    loop, controller, plant = (opened(kind, "labmate", law.name) for kind in ("loop", "controller", "plant"))
    names = (
        [f"state.{q.name}" for q in law.system.state],
        [f"tau.{q.name}" for q in law.system.mechanism.inputs],
    )
    for one in (loop, controller, plant):
        assert one.start(only(one, start | {"period": PERIOD}))
    times, states, in_turn = [], [], []
    for k in range(round(DURATION / PERIOD)):
        assert loop.step(k * PERIOD, PERIOD) and loop.status >= 0
        controller.set(dict(zip(names[0], plant.get(names[0]), strict=True)))
        assert controller.step(k * PERIOD, PERIOD) and controller.status >= 0
        plant.set(dict(zip(names[1], controller.get(names[1]), strict=True)))
        assert plant.step(k * PERIOD, PERIOD)
        times.append((k + 1) * PERIOD)
        states.append(loop.get(names[0]))
        in_turn.append(plant.get(names[0]))
    compare(truth, times, states)
    compare(truth, times, in_turn)


def test_outputs_before_the_first_step(opened, run):
    """tau and status are those of the starting values."""
    truth, start = run
    loop = opened("loop")
    assert loop.start(start)
    assert np.array_equal(loop.get(["tau.tau_r", "tau.tau_l"]), truth.tau[0]) and loop.status == 0


@pytest.mark.parametrize(
    "law",
    [
        LAW,
        *(pytest.param(law, marks=pytest.mark.nightly) for law in ("type_i", "type_iii", "type_iv_ellipse")),
    ],
)
def test_a_loop_with_its_own_starting_values_stays_at_rest(opened, law):
    """Also where the law is singular at 0, as Type III with the heading along x,
    and where the path is far away."""
    loop = opened("loop", "labmate", law)
    assert loop.start({})
    for k in range(200):
        assert loop.step(k * PERIOD, PERIOD) and loop.status == 0
    assert np.abs(loop.get(["tau.tau_r", "tau.tau_l", "state.thetadot_r", "state.thetadot_l"])).max() < 1e-9


def test_refusals(opened, run):
    """What may not be set, values that init refuses, and steps that are none."""
    _, start = run
    loop = opened("loop")
    for wrong in (
        {"params.r": -1.0},
        {"gains.kp_distance": np.nan},
        {"period": 0.0},
        {"integration_step": -1.0},
        {"limit.tau_r": np.inf},
    ):
        assert not loop.start(start | wrong), wrong
    assert loop.start(start)
    for name, value in (("on_limit", len(ON_LIMIT)), ("on_error", -1)):
        with pytest.raises(verification.Mismatch, match=name):
            loop.start(start | {name: value})
    assert loop.start(start)
    for name, value in (
        ("tau.tau_r", 1.0),
        ("params.r", 0.1),
        ("state.x_c", 0.0),
        ("time", 0.0),
        ("on_limit", 0),
    ):
        with pytest.raises(verification.Mismatch, match=name):
            loop.set({name: value})
    for time, duration in ((0.0, 0.0), (0.0, -1.0), (0.0, np.nan), (np.nan, 1.0), (0.0, 1e300)):
        assert not loop.step(time, duration)
    assert loop.start(start | {"state.thetadot_r": np.nan})
    assert not loop.step(0.0, PERIOD)


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("kind", KINDS)
def test_sources_compile_without_a_warning(exported, tmp_path, kind, compiler):
    """Those that the build description names, in the folder as it is."""
    with zipfile.ZipFile(exported(kind)) as archive:
        archive.extractall(tmp_path)
    folder = tmp_path / "sources"
    names = re.findall(r'<SourceFile name="([^"]*)"', (folder / "buildDescription.xml").read_text())
    assert sorted(names) == sorted(path.name for path in folder.glob("*.c"))
    strict = [
        "-std=c99",
        "-pedantic",
        "-Wall",
        "-Wextra",
        "-Wconversion",
        "-Wshadow",
        "-Wmissing-prototypes",
        "-Werror",
    ]
    subprocess.run([compiler, *strict, "-fsyntax-only", *names], cwd=folder, check=True)


@pytest.mark.parametrize(
    "kind, wrong",
    [
        (
            "controller",
            (
                "real.of.tau);",
                "real.of.tau) + 0 * (self->real.of.tau[0] += 1e-9 * self->real.of.tau[0] > 0);",
            ),
        ),
        ("plant", ("1.0 / 6.0}", "1.0 / 6.001}")),
    ],
)
def test_a_planted_defect_is_found_and_nothing_is_written(kind, wrong, tmp_path, monkeypatch, capsys):
    right = verification.fmu

    def changed(*arguments):
        identifier, texts = right(*arguments)
        name = f"sources/{identifier}.c"
        assert texts[name].count(wrong[0]) == 1
        return identifier, texts | {name: texts[name].replace(*wrong)}

    monkeypatch.setattr(verification, "fmu", changed)
    file = tmp_path / "x.fmu"
    file.write_text("as before")
    assert main(["export", "labmate", "--output", LAW, "--fmu", kind, "-o", str(file)]) == 1
    assert "differs from the model" in capsys.readouterr().err
    assert file.read_text() == "as before" and [path.name for path in tmp_path.iterdir()] == ["x.fmu"]


def test_the_same_bytes_again(exported, tmp_path, capsys):
    again = tmp_path / "again.fmu"
    assert main(["export", "labmate", "--output", LAW, "--fmu", "plant", "-o", str(again), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == {"file": str(again), "robot": "labmate", "laws": [], "model": "labmate_plant"}
    assert again.read_bytes() == exported("plant").read_bytes()


@pytest.mark.parametrize(
    "options, advice",
    [
        (["--output", LAW, "--fmu", "controller", "-o", "x.zip"], "ends in .fmu"),
        (["--output", LAW, "--output", "type_i", "--fmu", "loop", "-o", "x.fmu"], "one --output"),
        (["--fmu", "controller", "-o", "x.fmu"], "one --output"),
        (["--output", LAW, "--scalar", "float", "--fmu", "controller", "-o", "x.fmu"], "double"),
        (["--output", LAW, "--fmu", "robot", "-o", "x.fmu"], "controller"),
        (["--output", LAW, "--fmu", "loop", "--firmware", "generic", "-o", "x.fmu"], "--firmware"),
        (["--output", LAW, "--fmu", "loop", "-o", "no/such/x.fmu"], "does not exist"),
    ],
)
def test_bad_input(options, advice, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["export", "labmate", *options]) == 2
    message = capsys.readouterr().err
    assert advice in message and message.count("\n") == 1 and not list(tmp_path.iterdir())
