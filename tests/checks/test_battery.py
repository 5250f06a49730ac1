"""Laws of every shipped robot through the same battery: the C is the model, has the same bits from every
compiler, guards itself, is small, compiles without a warning, and Phidot is the derivative of Phi.

`python tests/checks/test_battery.py` takes every law of every robot through it, and prints a line for each
with what it measured.
"""

import math
import re
import subprocess
import sys
from collections.abc import Sequence
from functools import cache, cached_property

import cffi
import numpy as np
import pytest
from noslip.checks.verification import project
from noslip.checks.verification.project import FIRMWARE
from noslip.checks.verification.sampling import RandomPlant as Sample
from noslip.checks.verification.sampling import random_plants
from noslip.cli.main import main as main_of_noslip
from noslip.codegen.files import law_program, law_text, shared_files
from noslip.codegen.printing.law_c import runtime_types
from noslip.codegen.printing.robot_c import robot_declarations
from noslip.codegen.printing.scalar import SCALARS
from noslip.codegen.runtime import runtime_files
from noslip.model import ControlLaw
from noslip.model.outputs import OUTPUTS
from noslip.model.robots import SHIPPED
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_laws, find_robot, law_of, system_of
from noslip.simulation.controllers.backends import make_controller
from noslip.simulation.controllers.build import built
from noslip.simulation.controllers.compiled import CompiledController, Library
from noslip.simulation.controllers.pil import target_library
from noslip.simulation.controllers.symbolic import step_function
from noslip.simulation.controllers.targets import TARGETS, required
from noslip.simulation.plant import Plant
from noslip.tests.runtime_c.test_runtime import FLAGS, STRICT
from noslip.tests.tools import COMPILERS, HOST_CC, need, skip_without
from scipy.integrate import solve_ivp

VEHICLE = tuple(OUTPUTS)
TESTED = {  # each time; the others by hand
    "knife_edge": ("type_i", "type_iv_circle"),  # both relative degrees, with and without a path
    "car": ("type_i", "type_iv_circle"),
    "slope_platform": ("type_i", "type_iv_ellipse"),
    "turtlebot3_burger": ("type_iii",),
    "turtlebot3_waffle_pi": ("type_i",),
    "pioneer_3dx": ("type_ii",),
    "f1tenth": ("type_iv_line",),
    "forklift": ("type_iv_line",),
    "tractor_trailer:1": ("type_ii",),
    "tractor_trailer:4": ("type_i",),
}
CIRCLE = ("type_iv_circle",)  # of other vehicles
LAWS = {
    "knife_edge": VEHICLE,
    "rolling_disk": VEHICLE,
    "car": VEHICLE,
    "tricycle": VEHICLE,
    "ball_plate": ("ball",),
    "geared_arm": ("tip", "joints"),
    "slope_platform": VEHICLE,
    "turtlebot3_burger": VEHICLE,
    "turtlebot3_waffle_pi": VEHICLE,
    "pioneer_3dx": VEHICLE,
    "f1tenth": VEHICLE,
    "forklift": VEHICLE,
    "tractor_trailer:1": VEHICLE,
    "tractor_trailer:4": VEHICLE,
    "four_wheel": VEHICLE,
    "mobile_manipulator": ("end_point",),
    "turntable_ball": ("ball",),
    "bus": VEHICLE,
    "castor_platform": VEHICLE,
    "mecanum": ("pose",),
    # With fewer inputs than degrees of freedom, as the next three
    "balancer": ("wheels", "speeds", "upright", "drive"),
    "sleigh": ("heading",),
    "snakeboard": ("shape",),
    "roller_racer": ("handlebar", "speeds"),
    "labmate": (  # of other kinds than those in generated/, which test_runtime has
        *("type_iv_circle_damped", "type_iv_segment_damped", "type_i_extended", "type_iv_circle_extended"),
        *("type_i_kinematic", "type_iv_segment_kinematic"),
    ),
}
REFERENCE, *OTHERS = (HOST_CC, "-O2"), (HOST_CC, "-O0"), *((other, "-O2") for other in COMPILERS[1:])
ON_TARGET = {
    ("car", "type_iv_circle"),
    ("ball_plate", "ball"),
    ("four_wheel", "type_iv_circle"),
    ("balancer", "drive"),
}
ON_TARGET |= {
    ("labmate", f"type_i{kind}") for kind in ("v_circle_damped", "_extended", "v_segment_kinematic")
}
STATES = 20
ERROR = {"double": 1e-11, "float": 1e-3}  # of a quantity's largest entry, or of a tenth of its median size
TINY = 1e-300
BYTES = {  # at most: of the struct that is all a law's memory, in float; in double twice that
    "mobile_manipulator": 460,
    "four_wheel": 460,  # the forces on the ground of four driven wheels, each by each input
    "tractor_trailer": 280,
    "tractor_trailer_4": 480,  # the forces on the ground, body by body: eight constants for each trailer
    **dict.fromkeys(("car", "f1tenth"), 420),
    "bus": 350,  # rear wheels steer with the front ones: inertias by their ratio, too
    "mecanum": 280,
    "labmate": 280,
    **dict.fromkeys(("tricycle", "forklift"), 380),
}
BYTES_OF_OTHERS = 260
EARNED = ("earned", "wheel", "ground")  # members by which friction is earned; they are beside these bytes
NUMBERS_EARNED, NUMBERS_BY_CONTACT = 13, 10  # at a contact 4 of the last step's forces, and 6 of its wheel
CODE = {  # bytes at most of x86-64 code of all entry points of a scalar together, -O2
    # 13 kB of it for the forces on the ground, their derivatives by four inputs among them
    "mobile_manipulator": 66_000,
    "tractor_trailer": 26_000,
    # The forces on the ground, in `evaluate`, `ground` and the steps that keep the grip
    "tractor_trailer_4": 51_000,
    "four_wheel": 53_000,  # likewise; a third of it is `follow`, which keeps the grip too
    **dict.fromkeys(("car", "f1tenth"), 39_000),  # 300 of it earns friction
    **dict.fromkeys(("bus", "castor_platform"), 62_000),
    **dict.fromkeys(("tricycle", "forklift"), 38_000),
    "labmate": 29_000,  # 660 of it keeps what is expected of wheels within 80 instructions a tick
}
CODE_OF_OTHERS = 23_000
FAR = 2.0**22  # rad, beyond what sines are taken of in either scalar

CASES = [
    pytest.param(robot, name, id=f"{robot} {name}")
    for robot, names in LAWS.items()
    for name in names
    if names != VEHICLE or name in TESTED.get(robot, CIRCLE)
]


@pytest.mark.parametrize(("robot", "name"), CASES)
def test_battery(robot, name):
    battery(robot, name, compared=("float",))


def battery(robot: str, name: str, compared: Sequence[str]) -> str:
    """All that must hold of a law, its bits in the scalars `compared`; answers what was measured."""
    law = Law(law_of(find_robot(robot), name))
    measured = []
    for scalar in SCALARS:
        off = law.is_the_model(scalar)
        law.refuses_null(scalar)
        law.refuses_what_is_not_finite(scalar)
        law.refuses_parameters(scalar)
        law.refuses_far_angles(scalar)
        measured.append(f"{scalar}: off by {off:.1e}, {law.is_small(scalar)}")
    for scalar in compared:
        law.has_the_same_bits(scalar, [law.library(cc, level, scalar, compared) for cc, level in OTHERS])
    if "Phidot" in law.law.quantities and law.law.quantities["Phidot"].numel():
        measured.append(f"Phidot off by {law.knows_the_rate_of_Phi():.1e}")
    if (robot, name) in ON_TARGET:
        law.has_the_same_bits_on_the_target()
    return "; ".join(measured)


class Law:
    """A law with what its tests share: its C by compiler, and a plant with random states."""

    def __init__(self, law: ControlLaw):
        self.law = law
        self.texts = {scalar: law_text(law_program(law), SCALARS[scalar]) for scalar in SCALARS}
        self.built = cache(self._built)
        self.ffi = cffi.FFI()
        self.ffi.cdef("const char *noslip_status_name(int status);")
        for scalar, text in self.texts.items():
            self.ffi.cdef(runtime_types(SCALARS[scalar]))
            self.ffi.cdef(robot_declarations(law.system, SCALARS[scalar]))
            self.ffi.cdef(text.declarations())

    @property
    def answer(self) -> str:
        """What a step answers."""
        return "command" if self.law.kinematic else "tau"

    @cached_property
    def plant(self) -> Sample:
        """One with most of the states of the first few."""
        return max(random_plants(self.law, 3 * STATES, seed=11), key=lambda plant: len(plant.points))

    def library(self, cc: str, level: str, scalar: str, scalars: Sequence[str] = tuple(SCALARS)) -> Library:
        """One scalar of those compiled together, without a warning."""
        return Compiled(self.texts[scalar], self.ffi, *self.built(cc, level, scalars))

    def _built(self, cc: str, level: str, scalars: Sequence[str]) -> tuple[object, str]:
        """Functions and file of a library."""
        files = {}
        for scalar in scalars:
            files |= {**shared_files(self.law.system, SCALARS[scalar]), **self.texts[scalar].files()}
        sources = [*(name for name in files if name.endswith(".c")), "noslip_status.c"]
        path = built(
            [cc, *FLAGS, level, *STRICT, "-fPIC", "-shared", *sources], {**runtime_files(), **files}, "law.so"
        )
        return self.ffi.dlopen(str(path)), str(path)

    def instance(self, scalar: str) -> "Instance":
        """Made by the reference compiler, with the plant's numbers."""
        return Instance(self, self.library(*REFERENCE, scalar))

    # -- what must hold --------------------------------------------------------------------------------------

    def is_the_model(self, scalar: str) -> float:
        """All quantities against CasADi's, both given what the scalar can hold;
        the largest relative error."""
        rounded = [
            as_held(group, scalar).tolist()
            for group in (self.plant.params, self.plant.config, self.plant.gains)
        ]
        model = make_controller("casadi", self.law, *rounded)
        made = CompiledController(self.law, *rounded, made_by=self.library(*REFERENCE, scalar))
        pairs = []
        for point in self.plant.points:
            at = as_held(point.state, scalar), as_held(point.reference, scalar)
            pairs.append((made.evaluate(*at), model.evaluate(*at)))
            status, tau = made.step(*at)
            assert pairs[-1][0].status == pairs[-1][1].status == status == "ok"
            assert np.abs(tau - pairs[-1][0].values[self.answer]).max() <= ERROR[scalar] * np.abs(tau).max()
        assert len(pairs) >= STATES // 2
        errors = {}
        for quantity in self.law.quantities:
            sizes = [np.abs(truth.values[quantity]).max(initial=0.0) for _, truth in pairs]
            for (found, truth), size in zip(pairs, sizes, strict=True):
                off = np.abs(found.values[quantity] - truth.values[quantity]).max(initial=0.0)
                errors[quantity] = max(
                    errors.get(quantity, 0.0), off / max(size, 0.1 * np.median(sizes), TINY)
                )
        assert max(errors.values()) <= ERROR[scalar], errors
        return max(errors.values())

    def has_the_same_bits(self, scalar: str, others: list[Library]) -> None:
        """Of everything evaluate and step answer, as by the reference compiler."""
        right = self._bits(self.library(*REFERENCE, scalar))
        assert all(self._bits(other) == right for other in others)

    def has_the_same_bits_on_the_target(self) -> None:
        """In float, on an emulated Cortex-M4F."""
        missing = TARGETS["cortex-m4f"].missing()
        if missing and required():
            pytest.fail(f"{', '.join(missing)} not installed")
        if not missing:
            self.has_the_same_bits("float", [target_library(self.law, "m4f")])

    def _bits(self, library: Library) -> bytes:
        made = CompiledController(
            self.law, self.plant.params, self.plant.config, self.plant.gains, made_by=library
        )
        answers = []
        for point in self.plant.points:
            values = made.evaluate(point.state, point.reference).values
            answers += [*values.values(), made.step(point.state, point.reference)[1]]
        return b"".join(np.asarray(answer, float).tobytes() for answer in answers)

    def refuses_null(self, scalar: str) -> None:
        one, null = self.instance(scalar), cffi.FFI.NULL
        given = [one.own, one.params, one.config, one.gains]
        for k in range(4):
            assert (
                one.call("init", *[null if i == k else argument for i, argument in enumerate(given)], null)
                == "null"
            )
            if k:
                one.assert_answers("not_ready")
        assert one.call("init", *given, null) == "ok" and one.call("reset", null) == "null"
        one.assert_answers("ok")
        for function, answer in (("step", one.tau), ("evaluate", one.all)):
            arguments = [one.own, one.state, one.reference, *one.time[function], answer]
            pointers = [k for k, argument in enumerate(arguments) if isinstance(argument, cffi.FFI.CData)]
            for k in pointers:
                one.soil()
                assert one.call(function, *[null if i == k else a for i, a in enumerate(arguments)]) == "null"
                assert k == pointers[-1] or not np.any(one.numbers(answer))

    def refuses_what_is_not_finite(self, scalar: str) -> None:
        one = self.instance(scalar)
        for struct in (one.state, one.reference):
            numbers = one.numbers(struct)
            for k, good in enumerate(numbers.copy()):
                for bad in (math.nan, math.inf, -math.inf):
                    numbers[k] = bad
                    one.assert_answers("nonfinite")
                numbers[k] = good
        one.assert_answers("ok")

    def refuses_parameters(self, scalar: str) -> None:
        """Not finite, or of the wrong sign; the law is not ready then."""
        one = self.instance(scalar)
        groups = (
            (one.params, self.law.parameters),
            (one.config, self.law.config),
            (one.gains, self.law.gains),
        )
        for struct, quantities in groups:
            numbers = one.numbers(struct) if quantities else ()
            for k, quantity in enumerate(quantities):
                good = numbers[k]
                for bad in (
                    math.nan,
                    math.inf,
                    *{"positive": (0.0, -1.0), "nonnegative": (-1.0,), "any": ()}[quantity.sign],
                ):
                    numbers[k] = bad
                    assert one.init() == "bad_parameter", quantity.name
                    one.assert_answers("not_ready")
                numbers[k] = good
        assert one.init() == "ok"

    def refuses_far_angles(self, scalar: str) -> None:
        """Where CasADi's backend does, and with the same status: angles whose sine is taken."""
        one, plant, state = self.instance(scalar), self.plant, self.plant.points[0].state
        model, refused = make_controller("casadi", self.law, plant.params, plant.config, plant.gains), 0
        for k, quantity in enumerate(self.law.state):
            if quantity.unit == "rad":
                far = np.array(state)
                far[k] = FAR
                status = model.evaluate(far, plant.points[0].reference).status
                one.numbers(one.state)[:] = far[: len(one.numbers(one.state))]
                one.assert_answers(status)
                refused += status == "range"
        assert refused or not step_function(self.law).size1_out("angles")

    def is_small(self, scalar: str) -> str:
        """Its struct, and in float its code: no heap and no globals, so this is all there is."""
        library = self.library(*REFERENCE, scalar)
        struct, suffix = library.ffi.sizeof(library.name("")), SCALARS[scalar].name("")
        fields = dict(library.ffi.typeof(library.name("")).fields)
        symbols = [line.split() for line in run("nm", "-S", "--defined-only", library.path).splitlines()]
        own = [line for line in symbols if line[-1].startswith(self.law.system.mechanism.name)]
        assert not [line for line in own if line[-2] in "bBdD"]
        in_float = re.compile(r"_f(_|\.|$)")  # car_type_i_step_f, and the static car_type_i_step_f_limited
        code = sum(
            int(line[1], 16)
            for line in own
            if line[-2] in "tT" and bool(in_float.search(line[-1])) == bool(suffix)
        )
        robot, times = self.law.system.mechanism.name, 1 if suffix else 2
        earned = sum(library.ffi.sizeof(fields[name].type) for name in EARNED if name in fields)
        contacts = len(self.law.system.mechanism.standing)
        assert earned <= times * 4 * (NUMBERS_EARNED + NUMBERS_BY_CONTACT * contacts)
        assert struct - earned <= times * BYTES.get(robot, BYTES_OF_OTHERS) and 0 < code <= CODE.get(
            robot, CODE_OF_OTHERS
        )
        return f"{struct} bytes of struct, {code} of code"

    def knows_the_rate_of_Phi(self) -> float:
        """Phidot against differences of fourth order of Phi along qdot = S nu; the largest relative error."""
        made = CompiledController(
            self.law,
            self.plant.params,
            self.plant.config,
            self.plant.gains,
            made_by=self.library(*REFERENCE, "double"),
        )
        S = self.law.function({"S": self.law.system.S})
        worst, size = (
            0.0,
            np.median([np.abs(point.truth.values["Phidot"]).max() for point in self.plant.points]),
        )
        for point in self.plant.points:
            n = len(point.state) - self.law.system.dof
            basis = S(
                self.plant.params, self.plant.config, self.plant.gains, point.state, point.reference
            ).full()
            qdot = np.concatenate([basis @ point.state[n:], np.zeros(len(point.state) - n)])
            h = 1e-3 / max(1.0, np.abs(qdot).max())
            at = {
                k: made.evaluate(point.state + k * h * qdot, point.reference).values["Phi"]
                for k in (-2, -1, 1, 2)
            }
            rate = (8 * (at[1] - at[-1]) - (at[2] - at[-2])) / (12 * h)
            off = np.abs(rate - point.truth.values["Phidot"]).max()
            worst = max(worst, off / max(size, np.abs(rate).max(), np.abs(at[1]).max()))
        assert worst <= 1e-7
        return worst


class Compiled(Library):
    """One scalar of a library that is there already."""

    def __init__(self, text, ffi: cffi.FFI, lib: object, path: str):
        self.text, self.ffi, self.lib, self.path = text, ffi, lib, path
        self.scalar, self.robot, self.prefix = text.scalar, text.robot, text.prefix
        self.files = {}


class Instance:
    """A law in memory of its own, and what its entry points are given:
    the plant's numbers and its first state."""

    def __init__(self, law: Law, library: Library):
        plant, self.library = law.plant, library
        name, robot, ffi = library.name, library.robot_name, library.ffi
        self.own, self.tau = library.instance(), ffi.new(f"{library.text.scalar.real}[{library.text.inputs}]")
        self.params = self.struct(robot("params"), plant.params)
        self.config = self.struct(name("config"), plant.config)
        self.gains = self.struct(name("gains"), plant.gains)
        self.state = self.struct(robot("state"), plant.points[0].state[: len(law.law.system.state)])
        self.time = {"step": [0.0] if law.law.extension else [], "evaluate": []}  # since the step before
        self.reference = self.struct(name("reference"), plant.points[0].reference)
        self.all = ffi.new(f"{name('evaluation')} *")
        assert self.init() == "ok"
        for k, value in enumerate(plant.points[0].state[len(law.law.system.state) :]):
            self.own.extension[k] = value

    def struct(self, name: str, values):
        made = self.library.ffi.new(f"{name} *")
        if len(values):
            self.numbers(made)[:] = values
        return made

    def numbers(self, place) -> np.ndarray:
        """What lies there, as an array in the same memory."""
        ffi = self.library.ffi
        return np.frombuffer(ffi.buffer(place), f"f{ffi.sizeof(self.library.text.scalar.real)}")

    def call(self, function: str, *arguments) -> str:
        return self.library.status(self.library.function(function)(*arguments))

    def init(self) -> str:
        return self.call("init", self.own, self.params, self.config, self.gains, cffi.FFI.NULL)

    def soil(self) -> None:
        for place in (self.tau, self.all):
            self.numbers(place)[:] = math.nan

    def assert_answers(self, status: str) -> None:
        """Of step and evaluate: this status, and finite values, zeros with an error."""
        for function, answer in (("step", self.tau), ("evaluate", self.all)):
            self.soil()
            assert (
                self.call(function, self.own, self.state, self.reference, *self.time[function], answer)
                == status
            ), function
            values = self.numbers(answer)
            assert np.all(np.isfinite(values)) if status == "ok" else not np.any(values)


def as_held(values, scalar: str) -> np.ndarray:
    """The nearest values that a scalar has."""
    return np.asarray(values, np.float32 if scalar == "float" else float).astype(float)


def run(*command: str) -> str:
    return subprocess.run([need(command[0]), *command[1:]], capture_output=True, text=True, check=True).stdout


def test_the_battery_has_every_robot():
    assert {robot.partition(":")[0] for robot in LAWS} == set(SHIPPED)


@pytest.mark.nightly
# Its other laws are in test_runtime
@pytest.mark.parametrize("robot", [robot for robot in LAWS if robot != "labmate"])
def test_the_battery_has_every_law(robot):
    assert set(LAWS[robot]) == set(find_laws(system_of(find_robot(robot))))


def test_random_states_keep_away_from_the_poles_of_S():
    """A car's wheel across: tan(delta) is its rate of turning, 1 in the median over all angles."""
    law = law_of(find_robot("car"), "type_i")
    delta = [c.name for c in law.state].index("delta")
    tangents = [
        abs(math.tan(point.state[delta]))
        for plant in random_plants(law, 300, seed=5)
        for point in plant.points
    ]
    assert len(tangents) == 300 and 2.0 < max(tangents) < 8.0


EXPORTED = {"car": "type_iv_circle", "tractor_trailer": "type_iv_line", "ball_plate": "ball"}


@pytest.mark.nightly
@pytest.mark.parametrize("target", ["generic", "cortex-m4f"])
@pytest.mark.parametrize("robot", EXPORTED)
def test_an_exported_project_passes_its_own_test(robot, target, tmp_path, monkeypatch):
    """With nothing of this process's environment but the path to the tools. That the export itself has it
    measured is tested in test_project.py."""
    skip_without(FIRMWARE[target].missing("make"))
    monkeypatch.setattr(project, "_measured", lambda *_: "")
    folder, law = tmp_path / robot, EXPORTED[robot]
    assert main_of_noslip(["export", robot, "--output", law, "--firmware", target, "-o", str(folder)]) == 0
    command = ["make", "-s", "-C", str(folder), "budget", "test"]
    environment = {"PATH": "/usr/local/bin:/usr/bin:/bin"}
    tried = subprocess.run(
        command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=120, env=environment
    )
    assert tried.returncode == 0 and tried.stderr == ""
    assert f"{robot}_{law}_f: pass" in tried.stdout and tried.stdout.endswith("selftest: pass\n")


ROBOTS_AS_MOVED = (*LAWS, "four_wheel:0")


@pytest.mark.parametrize("robot", ROBOTS_AS_MOVED)
def test_energy_is_the_work_done(robot):
    """Without inputs, friction and moving surfaces it stays as it is, up to the integration;
    else its rate is the power."""
    system, random = system_of(find_robot(robot)), np.random.default_rng(12)
    n, parameters = len(system.mechanism.coordinates), system.mechanism.parameters
    numbers = [p.default * random.uniform(0.7, 1.3) for p in parameters]
    x = random.uniform(-0.8, 0.8, n + system.dof)
    with_friction = Plant(system, numbers)
    for _ in range(10):
        at, tau = x * random.uniform(0.5, 1.5, len(x)), random.uniform(-5, 5, len(system.mechanism.inputs))
        rate, h = with_friction.rate(at, tau), 1e-4
        states = np.array([at + k * h * rate for k in (-2, -1, 1, 2)])
        E = with_friction.energy(states)
        power = float(with_friction.power(at, tau)[0])
        assert abs((8 * (E[2] - E[1]) - (E[3] - E[0])) / (12 * h) - power) < 1e-8 * (
            abs(power) + np.abs(E).max()
        )
    moved_by = {"c": bool(system.mechanism.forces), "Omega": system.mechanism.carried}
    still = [0.0 if moved_by.get(p.name) else value for p, value in zip(parameters, numbers, strict=True)]
    plant, none = Plant(system, still), np.zeros(len(system.mechanism.inputs))
    start = np.concatenate([x[:n], 0.3 * x[n:]])
    run = solve_ivp(lambda _, x: plant.rate(x, none), (0.0, 1.0), start, "DOP853", rtol=1e-12, atol=1e-13)
    E = plant.energy(run.y.T)
    assert run.success and np.ptp(run.y, axis=1).max() > 0.01 and np.ptp(E) < 1e-10 * np.abs(E).max()


def main() -> int:
    """Every law; 1 if one is wrong."""
    wrong = 0
    for robot, names in LAWS.items():
        for name in names:
            try:
                said = battery(robot, name, compared=tuple(SCALARS))
            except (AssertionError, BadInput) as error:
                said, wrong = f"WRONG: {error}", wrong + 1
            print(f"{robot} {name}: {said}", flush=True)
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
