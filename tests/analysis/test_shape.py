"""Joints, trailers and steered wheels: what `noslip analyse` says of them,
against the robots' own equations, driven."""

import html
import math

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from noslip.analysis.answers import Answer, analyse, as_json, start_verdict
from noslip.analysis.outputs.decoupling import decouple
from noslip.analysis.outputs.normal_form import NormalForm, normal_form
from noslip.analysis.report import report
from noslip.analysis.text import as_text
from noslip.model import Mechanism, linearize, reduce
from noslip.model.law import symbols
from noslip.model.outputs import output_map
from noslip.model.robots.four_wheel import four_wheel
from noslip.readers.robots import find_robot
from noslip.tests.simulation.test_simulate import SPECS
from scipy.integrate import solve_ivp

ROBOTS = ("four_wheel", "tractor_trailer", "tractor_trailer:2", "car", "tricycle")
SMALL, ESCAPED = 1e-3, 0.1  # rad, a deviation at the start, and where one has surely grown


def form_of(robot: Mechanism, law: str = "type_iv_line") -> NormalForm:
    system = reduce(robot)
    return normal_form(decouple(linearize(system, output_map(system, law))))


def led_by_its_rear_body() -> Mechanism:
    """The jointed platform with its rear body as the vehicle: the front body follows in reverse."""
    robot = four_wheel()
    x, y, phi, gamma = ca.vertsplit(robot.q)[:4]
    size = {p.name: p.symbol for p in robot.parameters}
    rear = phi - gamma
    x_r = x - size["l_f"] * ca.cos(phi) - size["l_r"] * ca.cos(rear)
    y_r = y - size["l_f"] * ca.sin(phi) - size["l_r"] * ca.sin(rear)
    robot.moves_in_plane(x_r, y_r, rear)
    return robot


def hitched(straight: float = 0.0, sign: str = "positive", uneven: float = 0.0) -> Mechanism:
    """A unicycle with a massless trailer; the hitch's angle is `straight` (rad) when they are aligned.

    `uneven`: by how much of its length it is longer along the y axis than along the x axis.
    """
    robot = Mechanism("hitched", "unicycle with a trailer")
    x, y, phi, hitch = (
        robot.coordinate(name, unit)
        for name, unit in (("x", "m"), ("y", "m"), ("phi", "rad"), ("hitch", "rad"))
    )
    m, I, l = (  # noqa: E741
        robot.parameter(*each)
        for each in (("m", 3.0, "kg"), ("I", 1.0, "kg m^2"), ("l", 0.9, "m", "length", sign))
    )
    forward = ca.cos(phi) * robot.rate(x) + ca.sin(phi) * robot.rate(y)
    left = ca.cos(phi) * robot.rate(y) - ca.sin(phi) * robot.rate(x)
    fold, turning, l = hitch - straight, robot.rate(phi), l * (1 + uneven * ca.sin(phi) ** 2)  # noqa: E741
    robot.kinetic_energy(m * (robot.rate(x) ** 2 + robot.rate(y) ** 2) / 2 + I * turning**2 / 2)
    robot.rolls("no side slip", left)
    robot.rolls("trailer", ca.sin(fold) * forward + ca.cos(fold) * left - l * (turning - robot.rate(hitch)))
    robot.input("push", "N", on=forward)
    robot.input("turn", "N m", on=turning)
    robot.quasi_velocity("speed", "m/s", forward)
    robot.quasi_velocity("yaw_rate", "rad/s", turning)
    robot.moves_in_plane(x, y, phi)
    return robot


def steered_first() -> Mechanism:
    """Pushed and steered at its front wheel; the steering angle is the first coordinate,
    so that `phi` is what follows."""
    robot = Mechanism("steered_first", "bicycle")
    delta, x, y, phi = (
        robot.coordinate(name, unit)
        for name, unit in (("delta", "rad"), ("x", "m"), ("y", "m"), ("phi", "rad"))
    )
    m, l = robot.parameter("m", 3.0, "kg"), robot.parameter("l", 1.1, "m")  # noqa: E741
    forward = ca.cos(phi) * robot.rate(x) + ca.sin(phi) * robot.rate(y)
    left = ca.cos(phi) * robot.rate(y) - ca.sin(phi) * robot.rate(x)
    at_front, steering = left + l * robot.rate(phi), robot.rate(delta)
    pushed = ca.cos(delta) * forward + ca.sin(delta) * at_front
    robot.kinetic_energy(
        m * (robot.rate(x) ** 2 + robot.rate(y) ** 2) / 2 + (robot.rate(phi) + steering) ** 2 / 2
    )
    robot.rolls("rear", left)
    robot.rolls("front", ca.cos(delta) * at_front - ca.sin(delta) * forward)
    robot.input("push", "N", on=pushed)
    robot.input("steer", "N m", on=steering)
    robot.quasi_velocity("speed", "m/s", pushed)
    robot.quasi_velocity("steering", "rad/s", steering)
    robot.moves_in_plane(x + l * ca.cos(phi), y + l * ca.sin(phi), phi + delta)
    return robot


MADE = {
    **{name: lambda name=name: find_robot(name) for name in ROBOTS},
    "rear body": led_by_its_rear_body,
    "hitched": hitched,
    "steered": steered_first,
}


@pytest.fixture(scope="module", params=MADE)
def form(request) -> NormalForm:
    return form_of(MADE[request.param]())


class Drive:
    """Along A x + B y = 0 at the speed V: q' = S Phi^-1 (-h1, V), the robot's own S and Phi by CasADi,
    at random sizes."""

    def __init__(self, form: NormalForm, seed: int, lever: int, V: float):
        """`lever`: the sign of how far P_l lies ahead of the axle."""
        linearization = form.decoupling.linearization
        mechanism, random = linearization.system.mechanism, np.random.default_rng(seed)
        self.form, self.V = form, V
        fixed = [*mechanism.parameters, *linearization.output.parameters]
        self.values = {p.name: random.uniform(0.6, 1.6) for p in fixed} | {
            "A": random.uniform(-1, 1),
            "B": 1.0,
        }
        self.values["L"] = lever * random.uniform(0.6, 1.6) - (
            self.values["d"] if "d" in self.values else 0.0
        )
        motion = linearization.system.S @ ca.solve(linearization.Phi, ca.vertcat(-linearization.h[0], V))
        function = ca.Function("drive", [mechanism.q, symbols(fixed)], [motion, linearization.h[0]])
        self.numbers = [self.values[p.name] for p in fixed]
        self.rate = lambda t, q: function(q, self.numbers)[0].full()[:, 0]
        self.distance = lambda q: float(function(q, self.numbers)[1])
        self.along = math.atan2(-self.values["A"], self.values["B"])

    @property
    def names(self) -> list[str]:
        return [c.name for c in self.form.decoupling.linearization.system.mechanism.coordinates]

    @property
    def posture(self) -> list[int]:
        """Of the heading, the headings of trailers and angles between bodies."""
        angles = [
            k
            for k, name in enumerate(self.names)
            if name in ("phi", "gamma", "delta", "hitch") or name.startswith("phi_")
        ]
        assert len(angles) == len(self.form.shape.names) + 1
        return angles

    def straight(self) -> np.ndarray:
        """On the line and along it."""
        q = np.zeros(len(self.names))
        q[[k for k, name in enumerate(self.names) if name.startswith("phi")]] = self.along
        return self.onto_the_line(q)

    def onto_the_line(self, q: np.ndarray) -> np.ndarray:
        """Moved sideways until P_l is on the line."""
        moved, normal = q.copy(), np.array([self.values["A"], self.values["B"]])
        moved[[self.names.index("x"), self.names.index("y")]] -= (
            self.distance(q) * normal / np.linalg.norm(normal)
        )
        assert abs(self.distance(moved)) < 1e-12
        return moved

    def settles(self) -> bool:
        """Does a small deviation of the whole posture die out? The other outcome must be as clear."""
        start, places = self.straight(), self.posture
        start[places] += SMALL * np.cos(np.arange(1, len(places) + 1))

        def escaped(t: float, q: np.ndarray) -> float:
            return ESCAPED - np.abs(q[places] - self.straight()[places]).max()

        escaped.terminal = True
        run = solve_ivp(self.rate, (0.0, 30.0 / abs(self.V)), start, rtol=1e-8, atol=1e-10, events=escaped)
        final = np.abs(run.y[places, -1] - self.straight()[places]).max()
        assert run.success and (run.t_events[0].size or final < SMALL / 100)
        return not run.t_events[0].size

    def jacobian(self) -> np.ndarray:
        """Of the posture's rates by the posture, on the line, by differences."""
        places, at, step = self.posture, self.straight(), 1e-6

        def rates(k: int, way: int) -> np.ndarray:
            moved = at.copy()
            moved[k] += way * step
            return self.rate(0.0, self.onto_the_line(moved))[places]

        return np.array([(rates(k, 1) - rates(k, -1)) / (2 * step) for k in places]).T

    def number(self, formula: sp.Expr) -> float:
        """Of a formula of the answer."""
        values = self.values | {"V": self.V}
        return float(formula.subs({symbol: values[str(symbol)] for symbol in formula.free_symbols}))

    def holds(self, condition: str) -> bool:
        """Of a condition of the answer."""
        return all(
            bool(sp.sympify(part).subs(self.values | {"V": self.V})) for part in condition.split(" and ")
        )


@pytest.mark.parametrize("V", [0.9, -0.9])
@pytest.mark.parametrize("lever", [1, -1])
def test_the_verdict_is_what_driving_shows(form, lever, V):
    """Small deviations of heading and shape die out, forward and in reverse, exactly where it is said."""
    drive, (moving,) = Drive(form, 3, lever, V), form.moving
    assert moving.shape.decided and moving.shape.names and moving.stable_when
    assert drive.holds(moving.stable_when) == drive.settles()


def test_rates_are_the_eigenvalues_of_the_whole_posture(form):
    (moving,) = form.moving
    for seed in range(3):
        drive = Drive(form, seed, 1, 0.7 * (-1) ** seed)
        stated = [
            drive.number(rate)
            for rate in (moving.rate, *(sp.Symbol("V") * each.rate for each in moving.shape.followers))
        ]
        assert (
            np.abs(np.sort(np.linalg.eigvals(drive.jacobian())) - np.sort(np.array(stated, float))).max()
            < 1e-6
        )


def test_courses_are_the_rates_of_driving_straight(form):
    """Far from straight, the vehicle's heading being along the line."""
    drive, mechanism = Drive(form, 5, 1, 0.8), form.decoupling.linearization.system.mechanism
    random = np.random.default_rng(7)
    heading = ca.Function("heading", [mechanism.q], [mechanism.vehicle.heading])
    first = drive.posture[0]
    for _ in range(5):
        q = drive.straight()
        q[drive.posture] += random.uniform(-1, 1, len(drive.posture))
        q[first] += drive.along - float(heading(q))
        rate = drive.rate(0.0, drive.onto_the_line(q))
        for each in form.shape.followers:
            drive.values |= dict(zip(drive.names, q, strict=True))
            assert abs(drive.number(each.course) * 0.8 - rate[drive.names.index(each.name)]) < 1e-9


@pytest.mark.parametrize(("name", "angle"), [("four_wheel", "gamma"), ("tractor_trailer", "phi_1")])
def test_in_reverse_the_path_is_kept_while_the_vehicle_folds(name, angle):
    """With P_l behind the axle the distance goes to zero and the heading along the line, whatever follows."""
    drive = Drive(form_of(find_robot(name)), 11, -1, -0.8)
    start, place = drive.straight(), drive.names.index(angle)
    start[place] += 0.05
    start[1] += 0.2
    run = solve_ivp(drive.rate, (0.0, 40.0), start, rtol=1e-8, atol=1e-10)
    end = run.y[:, -1]
    phi = drive.names.index("phi")
    assert abs(drive.distance(end)) < 1e-6 and abs(end[phi] - drive.along) < 1e-6
    assert abs(abs(end[place] - start[place]) - math.pi) < 0.1


def test_which_way_it_must_drive():
    """Led by its rear body the platform is only stable in reverse, and a point in front of it never is."""
    moving = form_of(led_by_its_rear_body()).moving[0]
    assert moving.stable_when == "V < 0 and L < 0" and [each.way for each in moving.shape.followers] == [-1]
    (moving,) = form_of(led_by_its_rear_body(), "type_i").moving
    assert not moving.stable_when and "driving forward, where gamma diverges; else" in moving.settles


@pytest.mark.parametrize("robot", [hitched(straight=0.3), hitched(sign="any"), hitched(uneven=0.2)])
def test_what_is_not_decided_is_not_claimed(robot):
    """An angle not zero straight ahead, a length of either sign, not the same all round:
    of the heading alone, and it says so."""
    form = form_of(robot)
    (moving,) = form.moving
    assert not moving.shape.decided and moving.shape.names == ("hitch",) and moving.shape.followers == ()
    assert "the heading is stable if and only if L*V > 0, then s -> 0" in str(moving)
    assert str(moving).endswith("whether hitch converges is not decided")
    output = as_json(analyse(robot, ["type_iv_line"]))["outputs"]["type_iv_line"]
    assert (
        output["moving_reference"][0]["not_examined"] == ["hitch"]
        and "not decided" in output["zero_dynamics"]
    )


def test_what_people_read():
    answer = analyse(hitched(), ["type_i", "type_iv_circle"])
    line = "hitch' = -v*sin(hitch)/l: converges driving forward, diverges in reverse"
    for text in (" ".join(as_text(answer).split()), html.unescape(report(answer))):
        assert (
            line in text and "stable if and only if V > 0 and L > 0, then s" in text and "L*V > 0" not in text
        )
        assert (
            "driving in reverse, where hitch diverges" in text and "V along a path of small curvature" in text
        )
    output = as_json(answer)["outputs"]["type_iv_circle"]
    assert line in output["zero_dynamics"] and "V > 0 and L > 0" in output["zero_dynamics"]
    (moving,) = output["moving_reference"]
    assert moving["shape"] == {"hitch": "-V/l"} and moving["not_examined"] == []


def test_nothing_is_said_of_what_has_no_shape():
    answer: Answer = analyse(find_robot("knife_edge"), ["type_iv_line"])
    assert "driving straight" not in as_text(answer) and "stable if and only if L*V > 0" in " ".join(
        as_text(answer).split()
    )


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["four_wheel", "tractor_trailer:3"])
def test_what_follows_the_vehicle_is_enclosed_too(name):
    robot = find_robot(name)
    verdict = start_verdict(robot.name, str(SPECS / "robots" / f"{name.partition(':')[0]}.toml"))
    assert verdict.kind == "safe" and np.isfinite(verdict.until)
