"""The reduced dynamics: recursion over bodies and generated C against the textbook's matrices,
SymPy and mechanics."""

import subprocess
from dataclasses import dataclass
from functools import cache

import casadi as ca
import cffi
import numpy as np
import pytest
import sympy as sp
from casadi import cos, sin
from noslip.cli.main import main
from noslip.codegen.dynamics import UNROLLED, DynamicsProgram, compile_dynamics
from noslip.codegen.files import dynamics_text, shared_files
from noslip.codegen.printing.dynamics_c import DynamicsC
from noslip.codegen.printing.law_c import runtime_types
from noslip.codegen.printing.robot_c import robot_declarations
from noslip.codegen.printing.scalar import SCALARS
from noslip.codegen.runtime import runtime_files
from noslip.model import Mechanism, ModelError, reduce
from noslip.model.recursion import cancelled
from noslip.model.reduction import ReducedSystem
from noslip.model.robots import ROBOTS
from noslip.model.robots.tractor_trailer import tractor_trailer
from noslip.readers.robots import find_robot, system_of
from noslip.simulation.controllers.build import compiler
from noslip.simulation.controllers.runtime import load
from scipy.integrate import solve_ivp
from sympy.physics.mechanics import LagrangesMethod, dynamicsymbols

TOLERANCE = {"double": 1e-12, "float": 2e-5}  # of the largest entry
EPS = {"double": np.finfo(np.float64).eps, "float": np.finfo(np.float32).eps}
STRICT = (
    "-std=c99 -O2 -ffp-contract=off -fno-math-errno -ffreestanding -pedantic -Wall -Wextra -Wconversion "
    "-Wsign-conversion -Wdouble-promotion -Wfloat-conversion -Wfloat-equal -Wshadow -Wundef -Wcast-qual "
    "-Wstrict-prototypes -Wmissing-prototypes -Wvla -Werror"
).split()


# -- robots that the shipped ones do not cover ---------------------------------------------------------------


def off_axle(name: str = "off_axle", quasi: bool = True) -> Mechanism:
    """Two trailers hitched behind the axle before, on a slope,
    with air drag and a spring between the bodies."""
    robot = Mechanism(name)
    x, y, phi = robot.coordinate("x", "m"), robot.coordinate("y", "m"), robot.coordinate("phi", "rad")
    defaults = {"m": 9, "inertia": 2, "d": 0.3, "h": 0.2, "c": 0.4}
    m, inertia, d, h, c = (robot.parameter(name, value, "") for name, value in defaults.items())
    turning = robot.rate(phi)
    forward = cos(phi) * robot.rate(x) + sin(phi) * robot.rate(y)
    left = cos(phi) * robot.rate(y) - sin(phi) * robot.rate(x)
    robot.body("tractor", m, inertia, forward, left + d * turning, turning)
    robot.rolls("tractor", left)
    robot.input("push", "N", on=forward)
    robot.input("turn", "N m", on=turning)
    if quasi:
        robot.quasi_velocity("v", "m/s", forward)
        robot.quasi_velocity("omega", "rad/s", turning)
    before = phi
    for k in (1, 2):
        heading = robot.coordinate(f"phi_{k}", "rad")
        fold, aside = before - heading, left - h * turning
        turning = robot.rate(heading)
        forward, left = (
            cos(fold) * forward - sin(fold) * aside,
            sin(fold) * forward + cos(fold) * aside - 0.9 * turning,
        )
        robot.rolls(f"trailer {k}", left)
        robot.body(f"trailer_{k}", m, inertia, forward, left + d * turning, turning)
        robot.force(-c * forward * ca.sqrt(1 + forward**2), on=forward)
        robot.potential_energy(c * (1 - cos(fold)))
        before = heading
    robot.kinetic_energy(inertia * (robot.rate(phi) * sin(x)) ** 2 / 2)
    robot.potential_energy(m * 9.81 * 0.1 * x)
    robot.moves_in_plane(x, y, phi)
    return robot


def coupled(p: int) -> Mechanism:
    """p coordinates whose masses feel each other, and one that is held."""
    robot = Mechanism(f"coupled_{p}")
    q = [robot.coordinate(f"q_{k + 1}", "m") for k in range(p)]
    held = robot.coordinate("held", "m")
    m, s = robot.parameter("m", 2.0, "kg"), robot.parameter("s", 0.7, "kg", sign="nonnegative")
    total = ca.SX(0)
    for k, each in enumerate(q):
        total = total + cos(each) * robot.rate(each)
        robot.kinetic_energy(
            s * robot.rate(each) ** 2 / 2 + m * (total + sin(each) * robot.rate(q[k - 1])) ** 2 / 2
        )
        robot.quasi_velocity(f"rate_{k + 1}", "m/s", robot.rate(each))
        robot.input(f"f_{k + 1}", "N", on=robot.rate(each))
    robot.kinetic_energy(robot.rate(held) ** 2 / 2)
    robot.holds("held", held)
    return robot


def twins() -> Mechanism:
    """Two velocities that are one at angle 0: S'MS is singular there."""
    robot = Mechanism("twins")
    a, b, held = (robot.coordinate(name, "rad") for name in ("a", "b", "held"))
    m = robot.parameter("m", 3.0, "kg")
    robot.kinetic_energy(
        m * (robot.rate(a) ** 2 + robot.rate(b) ** 2 + 2 * cos(a - b) * robot.rate(a) * robot.rate(b)) / 2
    )
    robot.kinetic_energy(robot.rate(held) ** 2)
    robot.holds("held", held)
    for angle, name in ((a, "a"), (b, "b")):
        robot.input(f"tau_{name}", "N m", on=robot.rate(angle))
        robot.quasi_velocity(f"rate_{name}", "rad/s", robot.rate(angle))
    return robot


OWN = {
    "off_axle": off_axle,
    "coupled_4": lambda: coupled(4),
    "coupled_6": lambda: coupled(UNROLLED + 1),
    "twins": twins,
}
CHAINS = ("tractor_trailer", "tractor_trailer:0", "tractor_trailer:3", "off_axle", "off_axle, S of its own")


@cache
def system(name: str) -> ReducedSystem:
    if name == "off_axle, S of its own":
        return reduce(off_axle("other", quasi=False))
    return reduce(OWN[name]()) if name in OWN else system_of(find_robot(name))


@cache
def textbook(name: str) -> ca.Function:
    """From parameters, q, nu and rates: Mbar, bias, S'E, qdot by the matrices (9),
    (10) of the Lagrangian; energy; S'E tau."""
    reduced = system(name)
    robot = reduced.mechanism
    M, S = robot.M, reduced.S
    # The rate of qdot with nu held
    turning = ca.jtimes(S @ reduced.nu + reduced.carried, robot.q, reduced.qdot)
    bias = S.T @ (M @ turning + ca.substitute(robot.V, robot.qdot, reduced.qdot))
    energy = ca.substitute(robot.energy(), robot.qdot, reduced.qdot)
    answers = [S.T @ M @ S, bias, S.T @ robot.E, reduced.qdot, energy]
    return ca.Function("textbook", [robot.p, robot.q, reduced.nu], [ca.densify(answer) for answer in answers])


@dataclass(frozen=True)
class State:
    """Numbers that are exact in float, too."""

    p: np.ndarray
    q: np.ndarray
    nu: np.ndarray
    tau: np.ndarray


def states(name: str, count: int = 20, seed: int = 3) -> list[State]:
    reduced, random = system(name), np.random.default_rng(seed)
    robot = reduced.mechanism
    defaults = np.array([parameter.default for parameter in robot.parameters])

    def single(values):
        return np.float32(values).astype(float)

    return [
        State(
            single(defaults * random.uniform(0.7, 1.3, len(defaults))),
            single(random.uniform(-1.2, 1.2, len(robot.coordinates))),
            single(random.uniform(-3.0, 3.0, reduced.dof)),
            single(random.uniform(-5.0, 5.0, len(robot.inputs))),
        )
        for _ in range(count)
    ]


def answers(name: str, state: State) -> list[np.ndarray]:
    return [np.asarray(value) for value in textbook(name)(state.p, state.q, state.nu)]


def close(value, expected, tolerance: float, floor: float = 0.0) -> bool:
    """To `tolerance` of the largest entry expected, which counts for at least `floor`."""
    value, expected = np.ravel(value), np.ravel(expected)
    return bool(
        np.abs(value - expected).max(initial=0.0) <= tolerance * max(np.abs(expected).max(initial=0.0), floor)
    )


# -- the C ---------------------------------------------------------------------------------------------------


@cache
def program(name: str) -> DynamicsProgram:
    """The same for both scalars."""
    return compile_dynamics(system(name))


class Plant:
    """A robot's compiled dynamics."""

    def __init__(self, name: str, scalar: str):
        reduced, kind = system(name), SCALARS[scalar]
        text = dynamics_text(program(name), kind)
        self.ffi = cffi.FFI()
        self.ffi.cdef("const char *noslip_status_name(int status);")
        self.ffi.cdef(runtime_types(kind))
        self.ffi.cdef(robot_declarations(reduced, kind))
        self.ffi.cdef(text.declarations())
        self.lib = load(self.ffi, {**shared_files(reduced, kind), **text.files()})
        self.system, self.real, self.robot = reduced, kind.real, reduced.mechanism.name
        self.name = kind.name
        self.own = self.ffi.new(f"{kind.name(self.robot + '_dynamics')} *")

    def function(self, name: str):
        return getattr(self.lib, self.name(f"{self.robot}_dynamics_{name}"))

    def filled(self, kind: str, quantities, values):
        struct = self.ffi.new(f"{self.name(f'{self.robot}_{kind}')} *")
        for quantity, value in zip(quantities, values, strict=True):
            setattr(struct, quantity.in_c, value)
        return struct

    def status(self, number: int) -> str:
        return self.ffi.string(self.lib.noslip_status_name(number)).decode()

    def init(self, p) -> str:
        params = self.filled("params", self.system.mechanism.parameters, p)
        return self.status(self.function("init")(self.own, params))

    def array(self, *shape: int):
        filled = [[7] * shape[1]] * shape[0] if shape[1:] else [7] * shape[0]
        return self.ffi.new(self.real + "".join(f"[{n}]" for n in shape), filled)

    def numbers(self, array) -> np.ndarray:
        return np.array([list(row) if hasattr(row, "__len__") else row for row in array], float)

    def state(self, q, nu):
        return self.filled("state", self.system.state, [*q, *nu])

    def reduced(self, q, nu) -> tuple[str, np.ndarray, np.ndarray]:
        p = self.system.dof
        Mbar, bias = self.array(p, p), self.array(p)
        status = self.function("reduced")(self.own, self.state(q, nu), Mbar, bias)
        return self.status(status), self.numbers(Mbar), self.numbers(bias)

    def evaluate(self, q, nu) -> tuple[str, dict[str, np.ndarray]]:
        evaluation = self.ffi.new(f"{self.name(self.robot + '_dynamics_evaluation')} *")
        status = self.function("evaluate")(self.own, self.state(q, nu), evaluation)
        return self.status(status), {
            key: self.numbers(getattr(evaluation, key)) for key in ("Mbar", "bias", "input_map", "qdot")
        }

    def acceleration(self, q, nu, tau) -> tuple[str, np.ndarray, np.ndarray]:
        qdot, nudot = self.array(len(q)), self.array(self.system.dof)
        inputs = self.ffi.new(f"{self.real}[]", list(tau))
        status = self.function("acceleration")(self.own, self.state(q, nu), inputs, qdot, nudot)
        return self.status(status), self.numbers(qdot), self.numbers(nudot)


@cache
def plant(name: str, scalar: str) -> Plant:
    return Plant(name, scalar)


ALL = (*(name for name in ROBOTS if name != "mobile_manipulator"), "tractor_trailer:3", *OWN)


@pytest.mark.parametrize("scalar", SCALARS)
@pytest.mark.parametrize("name", ALL)
def test_the_c_is_the_textbook(name, scalar):
    """Mass matrix, bias, input map and rates at random states and parameters;
    the acceleration solves (10) to rounding."""
    compiled = plant(name, scalar)
    for state in states(name):
        Mbar, bias, input_map, qdot, _ = answers(name, state)
        assert compiled.init(state.p) == "ok"
        # a bias that cancels is as good as what it is made of
        floor = np.abs(Mbar).max() * np.abs(state.nu).max()
        status, found_M, found_bias = compiled.reduced(state.q, state.nu)
        assert (
            status == "ok"
            and close(found_M, Mbar, TOLERANCE[scalar])
            and close(found_bias, bias, TOLERANCE[scalar], floor)
        )
        assert np.array_equal(found_M, found_M.T) and np.linalg.eigvalsh(found_M).min() > 0.0
        status, all_of_it = compiled.evaluate(state.q, state.nu)
        assert status == "ok" and close(all_of_it["input_map"], input_map, TOLERANCE[scalar])
        assert close(all_of_it["qdot"], qdot, TOLERANCE[scalar])
        assert close(all_of_it["Mbar"], Mbar, TOLERANCE[scalar]) and close(
            all_of_it["bias"], bias, TOLERANCE[scalar], floor
        )
        status, rates, nudot = compiled.acceleration(state.q, state.nu, state.tau)
        force = input_map @ state.tau
        left = np.abs(Mbar @ nudot + bias[:, 0] - force).max()
        parts = np.abs(Mbar).max() * np.abs(nudot).max() + np.abs(bias).max() + np.abs(force).max() + floor
        assert (
            status == "ok"
            and close(rates, qdot, TOLERANCE[scalar])
            and left <= 10 * TOLERANCE[scalar] * parts
        )


@pytest.mark.parametrize("name", CHAINS)
def test_body_by_body_is_the_textbook(name):
    """Kane's recursion against Lagrange's equations."""
    chain = system(name)
    robot = chain.mechanism
    function = ca.Function(
        "reduced", [robot.p, robot.q, chain.nu], [chain.Mbar, chain.bias, chain.input_map, robot.A @ chain.S]
    )
    assert chain.by_bodies is not None
    for state in states(name):
        Mbar, bias, input_map, slip = (np.asarray(value) for value in function(state.p, state.q, state.nu))
        expected = answers(name, state)
        floor = np.abs(expected[0]).max() * np.abs(state.nu).max()
        assert (
            close(Mbar, expected[0], 1e-12)
            and close(bias, expected[1], 1e-12, floor)
            and close(input_map, expected[2], 1e-12)
        )
        assert np.abs(slip).max() < 1e-12


def operations(trailers: int) -> int:
    text = DynamicsC(compile_dynamics(reduce(tractor_trailer(trailers))), SCALARS["double"], [])
    (reduced,) = (entry for entry in text.program.entries if entry.name == "reduced")
    counted = text.operations(reduced)
    assert counted["sincos"] == trailers and counted["div"] == 0
    return sum(counted.values())


@pytest.mark.nightly
def test_the_cost_grows_linearly():
    """The same operations for every trailer more, sine and cosine of one angle among them."""
    counted = [operations(trailers) for trailers in (2, 3, 5, 9)]
    each = counted[1] - counted[0]
    assert counted == [counted[0] + each * more for more in (0, 1, 3, 7)]
    assert each <= 30


def test_the_c_is_the_same_again():
    texts = [
        DynamicsC(compile_dynamics(reduce(tractor_trailer(2))), SCALARS["float"], []).files()
        for _ in range(2)
    ]
    assert texts[0] == texts[1]


# -- mechanics -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["labmate", "tractor_trailer", "tractor_trailer:3", "off_axle"])
def test_energy_changes_by_the_work_done(name):
    """Conserved without torques (and drag); with torques it is their work; measured below 1e-10."""
    compiled, state = plant(name, "double"), states(name, 1)[0]
    n = len(state.q)
    p = (
        state.p
        if name != "off_axle"
        else np.where([q.name == "c" for q in system(name).mechanism.parameters], 1e-300, state.p)
    )
    assert compiled.init(p) == "ok"

    def energy(x):
        return float(textbook(name)(p, x[:n], x[n : n + len(state.nu)])[4])

    for torque in (0.0, 1.0):

        def rate(t, x, torque=torque):
            q, nu = x[:n], x[n:-1]
            tau = torque * state.tau * np.cos(t)
            status, qdot, nudot = compiled.acceleration(q, nu, tau)
            assert status == "ok"
            input_map = compiled.evaluate(q, nu)[1]["input_map"] if torque else np.zeros((len(nu), len(tau)))
            return np.concatenate([qdot, nudot, [nu @ input_map @ tau]])

        run = solve_ivp(rate, (0.0, 2.0), [*state.q, *state.nu, 0.0], method="DOP853", rtol=1e-11, atol=1e-11)
        begin, end, work = energy(run.y[:, 0]), energy(run.y[:, -1]), run.y[-1, -1]
        assert np.abs(run.y[:-1, -1] - run.y[:-1, 0]).max() > 0.1 and (
            torque == 0.0 or abs(work) > 1e-3 * abs(begin)
        )
        assert abs(end - begin - work) < 1e-9 * (abs(begin) + abs(end) + abs(work))


@cache
def lagrange():
    """SymPy's equations of tractor and two trailers, from places in the world: functions of q, qdot,
    tau and parameters."""
    names = ("x", "y", "phi", "theta_r", "theta_l", "phi_1", "phi_2")
    q = x, y, phi, right, left, *headings = dynamicsymbols(" ".join(names))
    rates = [each.diff() for each in q]
    tau = sp.symbols("tau_r tau_l")
    parameters = sp.symbols([p.name for p in system("tractor_trailer:2").mechanism.parameters])
    named = {str(p): p for p in parameters}
    b, d, r, I_w = (named[key] for key in ("b", "d", "r", "I_w"))
    t = dynamicsymbols._t

    def along(angle):
        return sp.Matrix([sp.cos(angle), sp.sin(angle)])

    def kinetic(mass, inertia, axle, ahead, angle):
        velocity = (axle + ahead * along(angle)).diff(t)
        return mass * velocity.dot(velocity) / 2 + inertia * angle.diff() ** 2 / 2

    def sideways(axle, angle):
        return axle.diff(t).dot(along(angle + sp.pi / 2))

    axle = sp.Matrix([x, y])
    T = kinetic(named["m"], named["I_t"], axle, d, phi) + I_w * (right.diff() ** 2 + left.diff() ** 2) / 2
    forward = axle.diff(t).dot(along(phi))
    constraints = [
        sideways(axle, phi),
        forward + b * phi.diff() - r * right.diff(),
        forward - b * phi.diff() - r * left.diff(),
    ]
    for k, heading in enumerate(headings, 1):
        axle = axle - named[f"l_{k}"] * along(heading)
        T += kinetic(named[f"m_{k}"], named[f"I_{k}"], axle, named[f"d_{k}"], heading)
        constraints.append(sideways(axle, heading))
    # Virtual work by the wheels alone: SymPy wants forces at points or torques on frames, a generalized force
    # comes in T's place.
    equations = LagrangesMethod(T + tau[0] * right + tau[1] * left, q, nonhol_coneqs=constraints)
    equations.form_lagranges_equations()
    plain = [*sp.symbols(names), *sp.symbols([f"{name}_dot" for name in names])]
    inserted = dict(zip([*rates, *q], [*plain[len(q) :], *plain[: len(q)]], strict=True))
    matrices = [part.subs(inserted) for part in (equations.mass_matrix_full, equations.forcing_full)]
    return sp.lambdify([*plain, *tau, *parameters], matrices, cse=True)


@pytest.mark.nightly
def test_two_trailers_move_as_sympys_lagrangian_says():
    """Accelerations of all coordinates, from multipliers in SymPy and from the C here."""
    name = "tractor_trailer:2"
    compiled, robot = plant(name, "double"), system(name).mechanism
    assert [q.name for q in robot.coordinates] == ["x", "y", "phi", "theta_r", "theta_l", "phi_1", "phi_2"]
    for state in states(name):
        assert compiled.init(state.p) == "ok"
        _, qdot, nudot = compiled.acceleration(state.q, state.nu, state.tau)
        matrix, right = lagrange()(*state.q, *qdot, *state.tau, *state.p)
        qddot = np.linalg.solve(matrix, right)[7:14, 0]
        assert close(nudot, qddot[3:5], 1e-10)
        step = 1e-5  # the rates of the trailers' headings change as the acceleration says
        after, before = (
            compiled.acceleration(state.q + s * qdot, state.nu + s * nudot, state.tau)[1]
            for s in (step, -step)
        )
        assert close((after - before) / (2 * step), qddot, 1e-6)


def test_a_steady_circle():
    """Each axle on a circle of its own, R_i^2 = R_{i-1}^2 - l_i^2, all bodies turning alike;
    measured: 1e-15."""
    name = "tractor_trailer:3"
    compiled, robot = plant(name, "double"), system(name).mechanism
    p = {parameter.name: parameter.default for parameter in robot.parameters}
    assert compiled.init(p.values()) == "ok"
    yaw_rate, radius, heading = 0.4, 5.0, 0.3
    v = yaw_rate * radius
    headings = []
    for k in (1, 2, 3):
        heading -= np.arcsin(p[f"l_{k}"] / radius)
        radius = np.sqrt(radius**2 - p[f"l_{k}"] ** 2)
        headings.append(heading)
    nu = [(v + p["b"] * yaw_rate) / p["r"], (v - p["b"] * yaw_rate) / p["r"]]
    state = [1.0, 2.0, 0.3, 0.0, 0.0, *headings], nu
    _, values = compiled.evaluate(*state)
    assert close(values["qdot"][[2, 5, 6, 7]], [yaw_rate] * 4, 1e-14)
    _, _, nudot = compiled.acceleration(*state, values["bias"])
    assert np.abs(nudot).max() < 1e-12
    # Of the forward speed: twice each body's energy, by its radius
    mass = p["m"] + 2 * p["I_w"] / p["r"] ** 2
    radius = 5.0
    for k in (1, 2, 3):
        radius = np.sqrt(radius**2 - p[f"l_{k}"] ** 2)
        mass += p[f"m_{k}"] * (radius / 5) ** 2 + (p[f"I_{k}"] + p[f"m_{k}"] * p[f"d_{k}"] ** 2) / 25
    assert close(values["Mbar"].sum(), mass * p["r"] ** 2, 1e-13)


# -- what is refused -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("scalar", SCALARS)
def test_singular_where_two_motions_are_one(scalar):
    compiled = plant("twins", scalar)
    assert compiled.init([3.0]) == "ok"
    for angle, expected in ((0.0, "singular"), (5e-4, "singular"), (3e-3, "ok"), (1.0, "ok")):
        status, qdot, nudot = compiled.acceleration([angle, 0.0, 0.0], [1.0, 2.0], [1.0, -1.0])
        assert status == expected
        assert (not qdot.any() and not nudot.any()) == (expected != "ok")
    assert compiled.reduced([0.0, 0.0, 0.0], [1.0, 2.0])[0] == "ok"


@pytest.mark.parametrize("scalar", SCALARS)
@pytest.mark.parametrize("p", [4, UNROLLED + 1])
def test_singular_written_out_and_looped(p, scalar):
    """Without the mass s, the last two motions are one where the last but one coordinate is pi / 2."""
    compiled = plant(f"coupled_{p}", scalar)
    for last_but_one, s, expected in ((np.pi / 2, 0.0, "singular"), (1.5, 0.0, "ok"), (np.pi / 2, 0.7, "ok")):
        assert compiled.init([2.0, s]) == "ok"
        q = [0.0] * (p - 2) + [last_but_one, 0.7, 0.0]
        status, qdot, nudot = compiled.acceleration(q, [1.0] * p, [1.0] * p)
        assert status == expected and qdot.any() == nudot.any() == (expected == "ok")


@pytest.mark.parametrize("scalar", SCALARS)
def test_what_the_entry_points_refuse(scalar):
    """Each with its status and zeros."""
    compiled = Plant("tractor_trailer", scalar)
    p = [parameter.default for parameter in compiled.system.mechanism.parameters]
    q, nu, tau = np.zeros(6), np.ones(2), np.ones(2)
    far = 9000.0 if scalar == "float" else 1.1e6
    assert compiled.acceleration(q, nu, tau)[0] == "not_ready"
    assert compiled.init([-p[0], *p[1:]]) == compiled.init([np.nan, *p[1:]]) == "bad_parameter"
    assert compiled.acceleration(q, nu, tau)[0] == "not_ready"
    assert compiled.init(p) == "ok"
    changed = [
        ("nonfinite", {0: np.nan}, {}, {}),
        ("nonfinite", {4: np.inf}, {}, {}),
        ("nonfinite", {}, {1: -np.inf}, {}),
        ("nonfinite", {}, {}, {0: np.nan}),
        ("nonfinite", {}, {0: 3e38 if scalar == "float" else 1.7e308}, {}),
        ("range", {2: far}, {}, {}),
        ("range", {2: 0.6 * far, 5: -0.6 * far}, {}, {}),
    ]
    for expected, *changes in changed:
        passed = [values.copy() for values in (q, nu, tau)]
        for values, change in zip(passed, changes, strict=True):
            for place, value in change.items():
                values[place] = value
        status, qdot, nudot = compiled.acceleration(*passed)
        assert status == expected and not qdot.any() and not nudot.any()
        if not changes[2]:
            status, Mbar, bias = compiled.reduced(*passed[:2])
            assert status == expected and not Mbar.any() and not bias.any()
    ffi, function = compiled.ffi, compiled.function("acceleration")
    state, numbers, qdot, nudot = (
        compiled.state(q, nu),
        compiled.array(2),
        compiled.array(6),
        compiled.array(2),
    )
    for k, arguments in enumerate([(compiled.own, state, numbers, qdot, nudot)] * 5):
        passed = [ffi.NULL if j == k else argument for j, argument in enumerate(arguments)]
        assert compiled.status(function(*passed)) == "null"


def test_a_body_must_be_one():
    """Forward and left have to turn with the body, and be velocities."""

    def made(change) -> Mechanism:
        robot = Mechanism("wrong")
        x, y, phi = robot.coordinate("x", "m"), robot.coordinate("y", "m"), robot.coordinate("phi", "rad")
        forward = cos(phi) * robot.rate(x) + sin(phi) * robot.rate(y)
        left = cos(phi) * robot.rate(y) - sin(phi) * robot.rate(x)
        arguments = {"mass": 2, "inertia": 1, "forward": forward, "left": left, "yaw_rate": robot.rate(phi)}
        robot.body("cart", **arguments | change(robot, x, forward, left))
        robot.rolls("no side slip", left)
        robot.input("push", "N", on=forward)
        robot.input("turn", "N m", on=robot.rate(phi))
        return robot

    reduce(made(lambda *_: {}))
    wrong = {
        "axes that turn at yaw_rate": lambda robot, x, forward, left: {"left": -left},
        "cart.*axes": lambda robot, x, forward, left: {"yaw_rate": -robot.rate(robot["phi"])},
        "must be parameters": lambda robot, x, forward, left: {"mass": 1 + x**2},
        "quadratic|linear": lambda robot, x, forward, left: {"forward": forward**2},
    }
    for message, change in wrong.items():
        with pytest.raises(ModelError, match=message):
            reduce(made(change))


def test_terms_that_cancel():
    a, b, c = (ca.SX.sym(name) for name in "abc")
    assert cancelled((a + b) * c - a * c - c * b).is_zero()
    assert str(cancelled(a * (b + c))) == str(a * (b + c))
    assert cancelled(a / c - b * a / c + (b * a) / c).n_dep() == 2
    assert cancelled(ca.sin(a) * b - b * ca.sin(a)).is_zero()
    deep = a * b
    for _ in range(60):  # each part is shared: as a tree it has 2^60 leaves
        deep = ca.sin(deep) * deep + deep
    assert cancelled(deep * c - c * deep).is_zero()


# -- files and command line ----------------------------------------------------------------------------------


@pytest.mark.parametrize("scalar", SCALARS)
@pytest.mark.parametrize("name", ["tractor_trailer", "coupled_6"])
def test_strict_compilers_are_silent(name, scalar, tmp_path):
    """Warnings are errors, and nothing is called that is not in these files."""
    reduced = system(name)
    kind = SCALARS[scalar]
    files = {**runtime_files(), **shared_files(reduced, kind), **dynamics_text(program(name), kind).files()}
    for file, text in files.items():
        (tmp_path / file).write_text(text)
    sources = [
        file
        for file in files
        if file.endswith(".c") and file.startswith((reduced.mechanism.name, "noslip_status"))
    ]
    command = [
        *compiler(),
        *STRICT,
        "-fPIC",
        "-shared",
        "-nostdlib",
        "-Wl,-z,defs",
        *sources,
        "-o",
        "plant.so",
    ]
    process = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert process.returncode == 0, process.stderr


def test_generate_writes_the_dynamics(tmp_path):
    folder = tmp_path / "tractor_trailer_2"
    assert (
        main(
            [
                "generate",
                "tractor_trailer:2",
                "--output",
                "dynamics",
                "--scalar",
                "float",
                "-o",
                str(tmp_path),
            ]
        )
        == 0
    )
    names = {"tractor_trailer_2_f", "tractor_trailer_2_dynamics_f"}
    assert {path.name for path in folder.iterdir()} == {
        "manifest.json",
        *(f"{n}.{e}" for n in names for e in "ch"),
    }


def test_numbers_after_a_robots_name(bad_input, tmp_path):
    assert find_robot("tractor_trailer").name == find_robot("tractor_trailer:1").name == "tractor_trailer"
    assert len(find_robot("tractor_trailer:4").coordinates) == 9
    file = tmp_path / "mine.py"
    file.write_text(
        "from noslip.model.robots.tractor_trailer import tractor_trailer\n"
        "def some(n, more=0):\n    return tractor_trailer(n + more)\n"
        "one = tractor_trailer(1)\n"
    )
    assert find_robot(f"{file}:some:2").name == "tractor_trailer_2"
    assert find_robot(f"{file}:some:1:2").name == "tractor_trailer_3"
    for name, message in {
        "tractor_trailer:-1": "give 0 or more",
        "tractor_trailer:1:2": "it takes the numbers N; 2 are given",
        "tractor_trailer:two": "must be integers",
        "labmate:3": "it takes no numbers",
        f"{file}:some": "it takes the numbers n, more; 0 are given",
        f"{file}:one:1": "it takes no numbers",
    }.items():
        assert message in bad_input(["generate", name, "-o", str(tmp_path / "out")])
