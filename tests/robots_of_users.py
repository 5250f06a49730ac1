"""Robots as users write them, in a file of their own."""

from casadi import cos, sin
from noslip import Mechanism


def sled():
    """A body on a blade; its outputs are its speeds."""
    robot = Mechanism("sled", "a body on a blade")
    x, y, phi = robot.coordinate("x", "m"), robot.coordinate("y", "m"), robot.coordinate("phi", "rad")
    forward = cos(phi) * robot.rate(x) + sin(phi) * robot.rate(y)
    robot.kinetic_energy(1.5 * (robot.rate(x) ** 2 + robot.rate(y) ** 2) + 0.2 * robot.rate(phi) ** 2)
    robot.rolls("no side slip", cos(phi) * robot.rate(y) - sin(phi) * robot.rate(x))
    robot.input("F", "N", on=forward)
    robot.input("T", "N m", on=robot.rate(phi))
    robot.quasi_velocity("v", "m/s", forward)
    robot.quasi_velocity("w", "rad/s", robot.rate(phi))
    robot.output(
        "speeds",
        "forward speed and yaw rate",
        [("forward", "m/s", forward), ("yaw", "rad/s", robot.rate(phi))],
    )
    return robot


def crank():
    """A disk on a line, pushed by a crank that has no effect at 90 degrees."""
    robot = Mechanism("crank", "a disk on a line and a crank")
    x, a, b = robot.coordinate("x", "m"), robot.coordinate("a", "rad"), robot.coordinate("b", "rad")
    rate = robot.rate
    robot.kinetic_energy(rate(x) ** 2 / 2 + 0.05 * rate(a) ** 2 + 0.005 * rate(b) ** 2)
    robot.rolls("rolls", rate(x) - 0.1 * rate(b))
    robot.input("F", "N", on=cos(a) * rate(x))
    robot.input("T", "N m", on=rate(a))
    robot.quasi_velocity("v", "m/s", rate(x))
    robot.quasi_velocity("w", "rad/s", rate(a))
    robot.output("place", "place and angle", [("px", "m", x), ("pa", "rad", a)])
    return robot


def two_wheels():
    """Two driven wheels, and no parameter."""
    robot = Mechanism("two_wheels", "two driven wheels")
    x, y, phi = robot.coordinate("x", "m"), robot.coordinate("y", "m"), robot.coordinate("phi", "rad")
    forward = cos(phi) * robot.rate(x) + sin(phi) * robot.rate(y)
    robot.kinetic_energy(5 * (robot.rate(x) ** 2 + robot.rate(y) ** 2) + robot.rate(phi) ** 2 / 2)
    robot.rolls("no side slip", cos(phi) * robot.rate(y) - sin(phi) * robot.rate(x))
    for name, side in (("right", 1), ("left", -1)):
        wheel = robot.coordinate(name, "rad")
        robot.kinetic_energy(0.05 * robot.rate(wheel) ** 2 / 2)
        robot.rolls(f"{name} wheel rolls", forward + side * 0.3 * robot.rate(phi) - 0.1 * robot.rate(wheel))
        robot.input(f"tau_{name}", "N m", on=robot.rate(wheel))
        robot.quasi_velocity(f"omega_{name}", "rad/s", robot.rate(wheel))
    robot.moves_in_plane(x, y, phi)
    return robot


def in_wind():
    """As two_wheels, pushed along x by a force that depends on the place."""
    robot = two_wheels()
    robot.potential_energy(1.5 * robot.q[0] ** 2)
    return robot
