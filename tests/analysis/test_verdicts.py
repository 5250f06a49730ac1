"""Verdicts of analyses with what the literature says of the robots: shipped ones,
and ones that noslip has not seen."""

from collections.abc import Callable

import casadi as ca
import pytest
from casadi import cos, sin, tan
from noslip.analysis.distributions.analysis import analyse
from noslip.analysis.distributions.properties import LEAF, SPACE
from noslip.model import Mechanism
from noslip.model.mechanism import Quantity, quantity
from noslip.model.rolling.kinematics import Kinematics
from noslip.readers.robots import find_robot

YES, NO, OPEN = True, False, None
QUESTIONS = ("accessible", "controllable", "asymptotically_stabilizable", "dynamic_feedback_linearizable")


def coin(roll: bool = True, steer: bool = True) -> Mechanism:
    """A disk kept upright, rolled and turned about the vertical by torques."""
    robot = Mechanism("coin", "a vertical disk")
    x, y = robot.coordinate("x", "m"), robot.coordinate("y", "m")
    theta, phi = robot.coordinate("theta", "rad"), robot.coordinate("phi", "rad")
    m, r = robot.parameter("m", 1.0, "kg"), robot.parameter("r", 0.1, "m")
    I, J = robot.parameter("I", 0.005, "kg m^2"), robot.parameter("J", 0.0025, "kg m^2")  # noqa: E741
    v_x, v_y, rolling, turning = (robot.rate(q) for q in (x, y, theta, phi))
    robot.kinetic_energy(m * (v_x**2 + v_y**2) / 2 + I * rolling**2 / 2 + J * turning**2 / 2)
    robot.rolls("along x", v_x - r * cos(phi) * rolling)
    robot.rolls("along y", v_y - r * sin(phi) * rolling)
    for name, on, driven in (("roll", rolling, roll), ("steer", turning, steer)):
        if driven:
            robot.input(name, "N m", on=on)
    return robot


def blade(ahead: float, rotor: bool = False) -> Mechanism:
    """A body on a blade, its centre of mass `ahead` of it, turned by a torque from outside or against a
    rotor."""
    robot = Mechanism("blade", "a body on a blade")
    x, y, phi = robot.coordinate("x", "m"), robot.coordinate("y", "m"), robot.coordinate("phi", "rad")
    turning = robot.rate(phi)
    left = cos(phi) * robot.rate(y) - sin(phi) * robot.rate(x)
    forward = cos(phi) * robot.rate(x) + sin(phi) * robot.rate(y)
    robot.kinetic_energy((forward**2 + (left + ahead * turning) ** 2) / 2 + 0.1 * turning**2 / 2)
    robot.rolls("no side slip", left)
    spin = robot.rate(robot.coordinate("psi", "rad")) if rotor else turning
    if rotor:
        robot.kinetic_energy(0.05 * (turning + spin) ** 2 / 2)
    robot.input("torque", "N m", on=spin)
    robot.quasi_velocity("v", "m/s", forward)
    robot.quasi_velocity("w", "rad/s", turning)
    if rotor:
        robot.quasi_velocity("s", "rad/s", spin)
    return robot


def bicycle() -> Kinematics:
    """A car as one wheel in the middle of each axle."""
    q = [quantity("x", "m"), quantity("y", "m"), quantity("phi", "rad"), quantity("delta", "rad")]
    phi, delta = q[2].symbol, q[3].symbol
    return Kinematics(
        "bicycle",
        tuple(q),
        S=ca.horzcat(ca.vertcat(cos(phi), sin(phi), tan(delta), 0), ca.vertcat(0, 0, 0, 1)),
    )


def kingpins() -> Kinematics:
    """A unicycle with two trailers, each of length 1 and hitched 1/2 behind the axle before it."""
    q = [quantity("x", "m"), quantity("y", "m"), *[quantity(f"phi_{k}", "rad") for k in range(3)]]
    speed, turning = ca.SX([[1, 0]]), ca.SX([[0, 1]])
    rows = [cos(q[2].symbol) * speed, sin(q[2].symbol) * speed, turning]
    for before, own in zip(q[2:], q[3:], strict=False):
        fold = before.symbol - own.symbol
        rows.append(sin(fold) * speed - cos(fold) * turning / 2)
        speed, turning = cos(fold) * speed + sin(fold) * turning / 2, rows[-1]
    return Kinematics("kingpins", tuple(q), S=ca.vertcat(*rows))


def trident() -> Kinematics:
    """Three legs at the corners of a body, each with a wheel at its end, turned against the body."""
    q = [
        quantity("x", "m"),
        quantity("y", "m"),
        quantity("theta", "rad"),
        *[quantity(f"phi_{k}", "rad") for k in range(3)],
    ]
    theta, rows = q[2].symbol, []
    for k, leg in enumerate(q[3:]):
        corner, heading = theta + 2 * ca.pi * k / 3, theta + 2 * ca.pi * k / 3 + leg.symbol
        # Of the wheel, at a length 1 from the corner, which is at a distance 1
        across = [-sin(heading), cos(heading)]
        sweep = cos(heading - corner) + 1
        rows.append(ca.horzcat(*across, sweep, *[1 if j == k else 0 for j in range(3)]))
    return Kinematics("trident", tuple(q), A=ca.vertcat(*rows))


def planar(*angles: str) -> tuple[list[Quantity], list[ca.SX]]:
    """The coordinates x, y and these angles, and the symbols of the angles."""
    q = [quantity("x", "m"), quantity("y", "m"), *[quantity(each, "rad") for each in angles]]
    return q, [each.symbol for each in q[2:]]


def wheel(place: list[ca.SX], heading: ca.SX, q: ca.SX) -> ca.SX:
    """The row of a wheel at a place: no velocity across its heading."""
    return -sin(heading) * ca.jacobian(place[0], q) + cos(heading) * ca.jacobian(place[1], q)


def wheeled(name: str, q: list[Quantity], wheels: list[tuple[list[ca.SX], ca.SX]]) -> Kinematics:
    """A system from the places and headings of its wheels."""
    symbols = ca.vertcat(*[each.symbol for each in q])
    return Kinematics(
        name, tuple(q), A=ca.vertcat(*[wheel(place, heading, symbols) for place, heading in wheels])
    )


def along(place: list[ca.SX], heading: ca.SX, length: float) -> list[ca.SX]:
    """The place so far ahead."""
    return [place[0] + length * cos(heading), place[1] + length * sin(heading)]


def hitched() -> Kinematics:
    """A unicycle with a trailer, hitched 0.3 m behind the axle."""
    q, (phi, psi) = planar("phi", "psi")
    first = [q[0].symbol, q[1].symbol]
    return wheeled("hitched", q, [(first, phi), (along(along(first, phi, -0.3), psi, -1.0), psi)])


def car_and_trailer(behind: float) -> Kinematics:
    """A car with a trailer, hitched so far behind its rear axle."""
    q, (phi, delta, psi) = planar("phi", "delta", "psi")
    rear = [q[0].symbol, q[1].symbol]
    trailer = along(along(rear, phi, -behind), psi, -1.5)
    return wheeled("car_and_trailer", q, [(rear, phi), (along(rear, phi, 1.0), phi + delta), (trailer, psi)])


def fire_truck() -> Kinematics:
    """A car with a trailer on its rear axle whose own axle is steered too."""
    q, (phi, delta, psi, tiller) = planar("phi", "delta", "psi", "tiller")
    rear = [q[0].symbol, q[1].symbol]
    wheels = [(rear, phi), (along(rear, phi, 1.0), phi + delta), (along(rear, psi, -2.0), psi + tiller)]
    return wheeled("fire_truck", q, wheels)


def two_steered() -> Kinematics:
    """A bicycle both of whose wheels are steered, each by its own motor."""
    q, (phi, front, rear) = planar("phi", "front", "rear")
    place = [q[0].symbol, q[1].symbol]
    return wheeled(
        "two_steered", q, [(along(place, phi, -0.5), phi + rear), (along(place, phi, 0.5), phi + front)]
    )


def falling_disk() -> Kinematics:
    """A disk of radius 1 that rolls on a plane and may tilt: the contact, heading, roll and tilt."""
    q, (phi, theta, tilt) = planar("phi", "theta", "tilt")
    S = ca.vertcat(ca.horzcat(0, cos(phi), 0), ca.horzcat(0, sin(phi), 0), ca.SX.eye(3))
    return Kinematics("falling_disk", tuple(q), S=ca.SX(S))


def snake() -> Kinematics:
    """Three links of length 2, each with a wheel in its middle."""
    q, (phi, first, last) = planar("phi", "first", "last")
    middle = [q[0].symbol, q[1].symbol]
    ahead, behind = (
        along(along(middle, phi, 1.0), phi + first, 1.0),
        along(along(middle, phi, -1.0), phi + last, -1.0),
    )
    return wheeled("snake", q, [(middle, phi), (ahead, phi + first), (behind, phi + last)])


def ballbot() -> Mechanism:
    """A ball that rolls in a plane with a body above it, turned against each other by a torque."""
    robot = Mechanism("ballbot", "a body on a ball, in a plane")
    x, ball, body = (
        robot.coordinate("x", "m"),
        robot.coordinate("ball", "rad"),
        robot.coordinate("body", "rad"),
    )
    v, spin, pitch = robot.rate(x), robot.rate(ball), robot.rate(body)
    robot.kinetic_energy(2 * v**2 / 2 + 0.01 * spin**2 / 2)
    robot.kinetic_energy(
        10 * ((v + 0.5 * cos(body) * pitch) ** 2 + (0.5 * sin(body) * pitch) ** 2) / 2 + 0.4 * pitch**2 / 2
    )
    robot.potential_energy(10 * 9.81 * 0.5 * cos(body))
    robot.rolls("ball", v - 0.1 * spin)
    robot.input("torque", "N m", on=spin - pitch)
    robot.quasi_velocity("v", "m/s", v)
    robot.quasi_velocity("pitch_rate", "rad/s", pitch)
    return robot


LEWIS = (
    "A. D. Lewis, Local configuration controllability ... with a single input, European Control "
    "Conference 1997"
)
ONE_INPUT = (
    "B. Charlet, J. Levine, R. Marino, Systems & Control Letters 13, 1989: with one input as by "
    "static feedback"
)
BRM = "A. M. Bloch, M. Reyhanoglu, N. H. McClamroch, IEEE TAC 37(11), 1992"
FLAT = "P. Rouchon, M. Fliess, J. Levine, P. Martin, Flatness, motion planning and trailer systems, CDC 1993"
FLAG = (
    "P. Martin, P. Rouchon, Feedback linearization and driftless systems, Math. Control Signals Systems "
    "7, 1994"
)
ENGEL = (
    "S. Sekhavat, P. Rouchon, J. Hermosillo, Computing the flat outputs of Engel differential systems, "
    "ACC 2001"
)
MUIR = (
    "P. F. Muir, C. P. Neuman, Kinematic modeling for feedback control of an omnidirectional wheeled "
    "mobile robot, ICRA 1987"
)
CODIMENSION = (
    "P. Martin, P. Rouchon, Any (controllable) driftless system with m inputs and m + 2 states is "
    "flat, CDC 1995"
)
FIRE = (
    "L. Bushnell, D. Tilbury, S. Sastry, Steering three-input nonholonomic systems: the fire truck "
    "example, IJRR 14(4), 1995"
)
CASTORS = (
    "G. Campion, G. Bastin, B. d'Andrea-Novel, Structural properties ... of wheeled mobile robots, "
    "IEEE TRA 12(1), 1996"
)
# robot, number of holonomic constraints, answers to QUESTIONS where the robot can go, source
SHIPPED: dict[str, tuple[int, tuple[bool | None, ...], str]] = {
    "labmate": (1, (YES, YES, NO, YES), "Sarkar, Yun, Kumar 1992"),
    "knife_edge": (0, (YES, YES, NO, YES), BRM),
    "car": (0, (YES, YES, NO, YES), FLAT),
    "bus": (0, (YES, YES, NO, NO), f"{ENGEL}, as it is with the angle of its wheels: the flag is (2, 3, 5)"),
    "mecanum": (
        2,
        (YES, YES, NO, YES),
        f"{MUIR}: any motion of the body in the plane, and the wheels' angles are flat",
    ),
    "castor_platform": (
        1,
        (YES, YES, NO, NO),
        f"{CASTORS}: castors leave the mobility of two wheels; {FLAG}: flag (2, 3, 5, 8)",
    ),
    "tractor_trailer": (
        1,
        (YES, YES, NO, NO),
        f"{FLAG}, as it is with the angles of its wheels: the flag is (2, 3, 5)",
    ),
    "balancer": (
        1,
        (YES, OPEN, NO, OPEN),
        "K. Pathak, J. Franch, S. K. Agrawal, IEEE Transactions on Robotics 21(3), 2005",
    ),
    "roller_racer": (0, (YES, NO, NO, NO), f"{LEWIS}; {ONE_INPUT}"),
    "sleigh": (0, (YES, NO, NO, NO), f"v' = a w^2 >= 0; {LEWIS}; {ONE_INPUT}"),
    "snakeboard": (0, (YES, YES, NO, OPEN), "F. Bullo, A. D. Lewis, IEEE Trans. Robotics Autom. 19(3), 2003"),
}
UNSEEN: dict[str, tuple[Callable[[], Mechanism | Kinematics], int, tuple[bool | None, ...], str]] = {
    "coin": (coin, 0, (YES, YES, NO, YES), BRM),
    "coin that is only rolled": (
        lambda: coin(steer=False),
        0,
        (NO, NO, NO, NO),
        "its turning stays as it is",
    ),
    "coin that is only steered": (
        lambda: coin(roll=False),
        0,
        (NO, NO, NO, NO),
        "its rolling stays as it is",
    ),
    "blade under the centre of mass": (
        lambda: blade(0.0),
        0,
        (NO, NO, NO, NO),
        "Neimark, Fufaev 1972: its speed stays as it is",
    ),
    "blade with a rotor": (lambda: blade(0.2, rotor=True), 0, (YES, NO, NO, NO), f"{LEWIS}; {ONE_INPUT}"),
    "bicycle": (bicycle, 0, (YES, YES, NO, YES), FLAT),
    "trailers with kingpins": (kingpins, 0, (YES, YES, NO, NO), FLAG),
    "trailer with a kingpin": (
        hitched,
        0,
        (YES, YES, NO, YES),
        f"{FLAT}: the general trailer system with one trailer",
    ),
    "car with a trailer on its axle": (lambda: car_and_trailer(0.0), 0, (YES, YES, NO, YES), FLAT),
    "car with a trailer behind its axle": (lambda: car_and_trailer(0.4), 0, (YES, YES, NO, YES), FLAT),
    "fire truck": (
        fire_truck,
        0,
        (YES, YES, NO, OPEN),
        f"{FIRE}: three-input chained form, so flat; not decided here",
    ),
    "bicycle with two steered wheels": (two_steered, 0, (YES, YES, NO, YES), CODIMENSION),
    "disk that may fall": (falling_disk, 0, (YES, YES, NO, YES), f"{BRM}; {CODIMENSION}"),
    "three links with wheels": (snake, 0, (YES, YES, NO, NO), f"growth (2, 3, 5); {FLAG}"),
    "ballbot in a plane": (
        ballbot,
        1,
        (YES, OPEN, OPEN, NO),
        "U. Nagarajan, G. Kantor, R. Hollis, IJRR 33(6), 2014: linearly controllable at rest, which "
        "analyse_at_rest says",
    ),
    "trident snake": (
        trident,
        0,
        (YES, YES, NO, OPEN),
        "M. Ishikawa, Trident snake robot, IFAC NOLCOS 2004: growth (3, 6)",
    ),
}


def judged(robot: Mechanism | Kinematics) -> tuple[int, tuple[bool | None, ...]]:
    """Return the number of holonomic constraints, and the verdicts on the leaf,
    or on the space if there is none."""
    found = analyse(robot)
    where = LEAF if found.k else SPACE
    checks = {(check.name, check.where): check.verdict for check in found.checks}
    return found.k, tuple(checks[name, where] for name in QUESTIONS)


LONG = ("balancer", "car", "roller_racer", "castor_platform")
SLOW = ("car with a trailer on its axle", "car with a trailer behind its axle", "fire truck")


@pytest.mark.parametrize(
    "name", [pytest.param(each, marks=pytest.mark.nightly) if each in LONG else each for each in SHIPPED]
)
def test_shipped_robots_are_judged_as_in_the_literature(name):
    k, verdicts, _ = SHIPPED[name]
    assert judged(find_robot(name)) == (k, verdicts)


@pytest.mark.parametrize(
    "name", [pytest.param(each, marks=pytest.mark.nightly) if each in SLOW else each for each in UNSEEN]
)
def test_unseen_robots_are_judged_as_in_the_literature(name):
    make, k, verdicts, _ = UNSEEN[name]
    assert judged(make()) == (k, verdicts)


def test_reasons_name_the_theorem():
    driven = analyse(blade(0.2)).check("controllable")
    assert "[g, [f, g]] of the only input g is outside" in driven.reason and "Sussmann" in driven.reference
    board = analyse(find_robot("snakeboard")).check("controllable")
    assert "their symmetric products span all velocities" in board.reason and "Lewis" in board.reference
