"""`follow`, the step that is told where P_l is by a path: against the step that is given the pose,
and on a path of any shape."""

import math
from dataclasses import asdict
from functools import cache

import casadi as ca
import numpy as np
import pytest
from noslip.checks.verification.sampling import RandomPlant, random_plants
from noslip.codegen.derivation.foot import has_foot_form
from noslip.codegen.files import law_program
from noslip.codegen.graph import Leaf
from noslip.codegen.program import compile_law
from noslip.model.law import control_law
from noslip.model.mechanism import Mechanism
from noslip.model.outputs import FOOT, OUTPUTS
from noslip.model.reduction import reduce
from noslip.readers.robots import find_laws, find_robot, law_of, system_of
from noslip.simulation.controllers.compiled import library
from noslip.simulation.controllers.controller import ON_LIMIT, Friction, Limits
from noslip.simulation.controllers.runtime import runtime
from noslip.simulation.plant import Plant as Motion

CASES = [
    ("labmate", ""),
    ("labmate", "_offset"),
    ("knife_edge", ""),
    ("rolling_disk", ""),
    ("four_wheel", ""),
]
ERROR = {"double": 1e-11, "float": 1e-4}  # of the largest torque at a state

each_law = pytest.mark.parametrize(("robot", "suffix"), CASES)
each_scalar = pytest.mark.parametrize("scalar", list(ERROR))


class Follower:
    """A law in memory of its own, made for a plant, and what its two steps are given."""

    def __init__(self, law, plant, scalar: str, limits: Limits | None = None, on_error: int = 0):
        self.law, self.plant, self.c = law, plant, library(law, scalar)
        name, robot = self.c.name, self.c.robot_name
        self.own, self.tau = (
            self.c.instance(),
            self.c.ffi.new(f"{self.c.text.scalar.real}[{self.c.text.inputs}]"),
        )
        self.state, self.reference = (
            self.c.ffi.new(f"{kind} *") for kind in (robot("state"), name("reference"))
        )
        self.foot = self.c.ffi.new(f"{self.c.text.scalar.name('noslip_foot')} *")
        structs = [
            (robot("params"), plant.params),
            (name("config"), plant.config),
            (name("gains"), plant.gains),
        ]
        options = self.c.ffi.new(f"{robot('options')} *", {"on_error": on_error})
        if limits:
            options.limit, options.on_limit = list(limits.torque), ON_LIMIT.index(limits.mode)
            if limits.friction:
                options.friction = asdict(limits.friction)
        given = [self.c.ffi.new(f"{kind} *", [float(v) for v in values]) for kind, values in structs]
        assert self.call("init", *given, options) == "ok"

    def call(self, function: str, *arguments) -> str:
        return self.c.status(self.c.function(function)(self.own, *arguments))

    def numbers(self, place) -> np.ndarray:
        """What lies there, as an array in the same memory."""
        return np.frombuffer(self.c.ffi.buffer(place), f"f{self.c.ffi.sizeof(self.c.text.scalar.real)}")

    def see(self, point) -> None:
        self.numbers(self.state)[:] = point.state
        self.numbers(self.reference)[:] = point.reference
        self.numbers(self.foot)[:] = foot_at(self.law, self.plant.config, point.state)

    def step(self) -> tuple[str, np.ndarray]:
        return self.call("step", self.state, self.reference, self.tau), self.numbers(self.tau).astype(float)

    def follow(self) -> tuple[str, np.ndarray]:
        self.numbers(self.tau)[:] = math.nan
        return self.call("follow", self.foot, self.state, self.reference, self.tau), self.numbers(
            self.tau
        ).astype(float)


def foot_at(law, config, state) -> tuple[float, float, float, float]:
    """P_l and the heading from the nearest point of the arc: by the arc's centre."""
    names, vehicle = [q.name for q in law.state], law.system.mechanism.vehicle
    x, y, heading = (float(state[names.index(str(part))]) for part in (vehicle.x, vehicle.y, vehicle.heading))
    given = dict(zip([q.name for q in law.config], config, strict=True))
    point = complex(x, y) + complex(given["L"], given.get("W", 0)) * np.exp(1j * heading)
    turns = math.copysign(1.0, given["curvature"])
    centre = complex(given["x_s"], given["y_s"]) + 1j * np.exp(1j * given["direction"]) / given["curvature"]
    out = turns * (point - centre)
    turned = np.exp(1j * heading) / (1j * out / abs(out))
    return turns * (1 / abs(given["curvature"]) - abs(out)), turned.real, turned.imag, turns / abs(out)


@cache
def made(robot: str, suffix: str, states: int = 120):
    """A law, and plants with points: nearly all of the points are as near to the path as its radius."""
    law = law_of(find_robot(robot), f"type_iv_segment{suffix}")
    return law, [plant for plant in random_plants(law, states, seed=21) if plant.points]


@each_scalar
@each_law
def test_follow_is_the_step_seen_from_the_path(robot, suffix, scalar):
    """Torques against CasADi's at the pose, on arcs to both sides."""
    law, plants = made(robot, suffix)
    turned = set()
    for plant in plants:
        one = Follower(law, plant, scalar)
        for point in plant.points:
            one.see(point)
            status, tau = one.follow()
            truth = point.truth.values["tau"]
            assert status == "ok" and np.abs(tau - truth).max() <= ERROR[scalar] * np.abs(truth).max()
            turned.add(float(one.foot.curvature) > 0)
    assert turned == {True, False} or len(plants) < 3


@pytest.mark.parametrize(("robot", "suffix", "mode"), [(*case, mode) for case in CASES for mode in ON_LIMIT])
def test_limits_as_of_the_step(robot, suffix, mode):
    law, plants = made(robot, suffix)
    inputs, seen = len(law.system.mechanism.inputs), set()
    for plant in plants:
        for point in plant.points[:6]:
            friction = Friction(0.3) if mode == "grip" else None
            limits = Limits((0.4 * np.abs(point.truth.values["tau"]).max(),) * inputs, mode, friction)
            one = Follower(law, plant, "double", limits)
            one.see(point)
            (status, tau), (truth, expected) = one.follow(), one.step()
            assert status == truth and np.abs(tau - expected).max() <= 1e-9 * limits.torque[0]
            assert np.abs(tau).max() <= limits.torque[0]
            seen.add(status)
    assert ("grip" if mode == "grip" else "saturated") in seen


@each_scalar
@each_law
def test_what_it_reads_must_be_finite(robot, suffix, scalar):
    """Every number that is infinite or NaN is refused, but for those of the state that it does not read;
    then what is held."""
    law, (plant, *_) = made(robot, suffix, 20)
    (body,) = (body for entry, body in law_program(law).entries.items() if entry.name == "follow")
    read = {n.name for n in reachable_leaves(body) if n.group == "state"}
    assert read >= {q.name for q in law.system.quasi_velocities}
    one = Follower(law, plant, scalar, on_error=1)
    one.see(plant.points[0])
    good = one.follow()
    assert good[0] == "ok"
    places = [(one.foot, [q.name for q in FOOT]), (one.reference, [q.name for q in law.reference])]
    for struct, names in [*places, (one.state, [q.name for q in law.state])]:
        for name in names:
            kept = getattr(struct, name)
            for bad in (math.nan, math.inf, -math.inf):
                setattr(struct, name, bad)
                status, tau = one.follow()
                assert status == ("ok" if struct == one.state and name not in read else "nonfinite"), name
                assert np.array_equal(tau, good[1])
            setattr(struct, name, kept)


def reachable_leaves(body) -> set:
    seen, stack = set(), list(body.roots)
    while stack:
        if (node := stack.pop()) not in seen:
            seen.add(node)
            stack.extend(node.arguments)
    return {node for node in seen if isinstance(node, Leaf)}


def test_refusals():
    law, (plant, *_) = made("labmate", "", 20)
    one = Follower(law, plant, "double")
    one.see(plant.points[0])
    given, null = [one.foot, one.state, one.reference, one.tau], one.c.ffi.NULL
    for k in range(4):
        assert (
            one.call("follow", *[null if i == k else argument for i, argument in enumerate(given)]) == "null"
        )
        assert k == 3 or list(one.tau) == [0, 0]
    one.foot.cosine, one.foot.sine = 0.0, 1.0  # straight across the path
    assert one.follow()[0] == "singular" and list(one.tau) == [0, 0]
    one.own.ready = 0
    assert one.follow()[0] == "not_ready" and list(one.tau) == [0, 0]


def test_who_has_it():
    """Not a law without a path's parallels, and no vehicle that feels where it stands or points."""
    laws = {name: law_of(find_robot("labmate"), name) for name in find_laws(system_of(find_robot("labmate")))}
    assert [name for name, law in laws.items() if has_foot_form(law)] == ["type_iv_segment"]
    assert not has_foot_form(law_of(find_robot("slope_platform"), "type_iv_segment"))  # gravity
    # Its heading is that of the front wheel
    assert not has_foot_form(law_of(find_robot("car"), "type_iv_segment"))


def skew(askew: bool):
    """A knife edge whose blade is askew of the heading told, or whose heading is turned by an uneven gear."""
    robot = Mechanism(
        "askew" if askew else "uneven",
        "a knife edge that is not the same in all directions, or not written so",
    )
    x, y = robot.coordinate("x", "m"), robot.coordinate("y", "m")
    phi, psi = robot.coordinate("phi", "rad"), robot.coordinate("psi", "rad")
    m, J, a = (
        robot.parameter("m", 10.0, "kg"),
        robot.parameter("J", 0.2, "kg m^2"),
        robot.parameter("a", 0.4, "rad", sign="any"),
    )
    heading = phi + a if askew else phi
    forward = ca.cos(heading) * robot.rate(x) + ca.sin(heading) * robot.rate(y)
    motor = robot.rate(psi)
    robot.kinetic_energy(m * (robot.rate(x) ** 2 + robot.rate(y) ** 2) / 2 + J * motor**2 / 2)
    robot.rolls("no side slip", ca.cos(heading) * robot.rate(y) - ca.sin(heading) * robot.rate(x))
    robot.rolls("gear", robot.rate(phi) - (1 if askew else 1 + a * ca.cos(phi)) * motor)
    robot.input("push", "N", on=forward)
    robot.input("turn", "N m", on=motor)
    robot.quasi_velocity("speed", "m/s", forward)
    robot.quasi_velocity("motor", "rad/s", motor)
    robot.moves_in_plane(x, y, phi)
    return robot


@pytest.mark.parametrize("askew", [True, False])
def test_no_follow_where_the_foot_does_not_tell_all(askew):
    """Never one that reads the world's heading, or leaves out what depends on it."""
    law = control_law(system := reduce(skew(askew)), OUTPUTS["type_iv_segment"](system))
    entries = compile_law(law).entries
    assert "step" in {entry.name for entry in entries}
    assert not {entry.name for entry in entries if entry.at_foot}
    assert not {entry.name for entry in compile_law(law, optimize=False).entries if entry.at_foot}


@each_scalar
def test_one_foot_in_both(scalar):
    """What Python declares is the C runtime's struct."""
    law = law_of(find_robot("labmate"), "type_iv_segment")
    name = library(law, scalar).text.scalar.name("noslip_foot")
    ours, theirs = (
        ffi.typeof(name).fields for ffi in (library(law, scalar).ffi, runtime("noslip_path.h").ffi)
    )
    assert [(n, f.offset, f.type.cname) for n, f in ours] == [(n, f.offset, f.type.cname) for n, f in theirs]
    assert [n for n, _ in ours] == [q.name for q in FOOT]


def test_a_path_of_any_shape():
    """Round an ellipse, whose curvature changes all the way, the distance dies out as the outer loop says."""
    law = law_of(find_robot("labmate"), "type_iv_segment")
    names = [q.name for q in law.state]
    kp, kd, h = 4.0, 5.0, 1e-3
    plant = RandomPlant(
        tuple(q.default for q in law.parameters), (0.3, 0.0, 0.0, 0.0, 0.0), (kp, kd, 2.0), ()
    )
    one, motion = Follower(law, plant, "double"), Motion(law.system, plant.params)
    x = np.zeros(len(names))
    x[names.index("x_c")], x[names.index("y_c")], x[names.index("phi")] = 4.3, -0.3, math.pi / 2
    x[-2:] = 1.0 / plant.params[[q.name for q in law.parameters].index("r")]
    one.reference.speed = 1.0
    s, errors = 0.0, []
    for _ in range(11500):
        s, foot = ellipse_foot(x, names, s)
        errors.append(foot[0])
        one.numbers(one.state)[:], one.numbers(one.foot)[:] = x, foot
        assert one.call("follow", one.foot, one.state, one.reference, one.tau) == "ok"
        tau = list(one.tau)
        x = x + h * motion.rate(x + h / 2 * motion.rate(x, tau), tau)  # by the midpoint
    assert s > math.pi  # both kinds of vertices are behind it
    slope = (-3 * errors[0] + 4 * errors[1] - errors[2]) / (2 * h)
    slow, fast = (-kd + math.sqrt(kd**2 - 4 * kp)) / 2, (-kd - math.sqrt(kd**2 - 4 * kp)) / 2
    a = (slope - fast * errors[0]) / (slow - fast)
    times = h * np.arange(len(errors))
    expected = a * np.exp(slow * times) + (errors[0] - a) * np.exp(fast * times)
    assert abs(errors[0]) > 0.2 and np.abs(errors - expected).max() < 5 * h  # the torque is held for h


def ellipse_foot(x, names, s: float) -> tuple[float, tuple[float, float, float, float]]:
    """The nearest point of the ellipse (4 cos s, 2.5 sin s), from the last one on,
    and P_l seen from there."""
    a, b = 4.0, 2.5
    heading = x[names.index("phi")]
    point = complex(x[names.index("x_c")], x[names.index("y_c")]) + 0.3 * np.exp(1j * heading)
    for _ in range(20):
        at, first = complex(a * math.cos(s), b * math.sin(s)), complex(-a * math.sin(s), b * math.cos(s))
        off, second = at - point, -at
        s -= (off * first.conjugate()).real / (abs(first) ** 2 + (off * second.conjugate()).real)
    tangent = first / abs(first)
    distance = ((point - at) / (1j * tangent)).real
    bend = (first.conjugate() * second).imag / abs(first) ** 3
    turned = np.exp(1j * heading) / tangent
    return s, (distance, turned.real, turned.imag, bend / (1 - bend * distance))
