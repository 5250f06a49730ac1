"""Chaplygin's sleigh: a body on a knife edge behind its centre of mass, which a torque turns.

S. A. Chaplygin, On the theory of motion of nonholonomic systems, Matematicheskii Sbornik 28 (1911); A. M.
Bloch, Nonholonomic Mechanics and Control (2003), section 1.7. With the speed v of the edge and the yaw rate
w, v' = a w^2: turning it either way drives it forward, and nothing slows it down.
"""

from casadi import cos, sin

from ...drawing import box
from ...mechanism import Mechanism


def sleigh() -> Mechanism:
    """3 coordinates, 1 constraint; 1 torque for 2 degrees of freedom."""
    robot = Mechanism("sleigh", "Chaplygin's sleigh, turned by a torque")
    x = robot.coordinate("x", "m", "the knife edge")
    y = robot.coordinate("y", "m", "the knife edge")
    phi = robot.coordinate("phi", "rad", "heading")
    m = robot.parameter("m", 2.0, "kg", "mass (assumed)")
    I = robot.parameter(  # noqa: E741
        "I", 0.05, "kg m^2", "inertia about the vertical through the centre of mass (assumed)"
    )
    a = robot.parameter("a", 0.2, "m", "distance of the centre of mass ahead of the edge (assumed)")

    turning = robot.rate(phi)
    forward = cos(phi) * robot.rate(x) + sin(phi) * robot.rate(y)
    sideways = cos(phi) * robot.rate(y) - sin(phi) * robot.rate(x)
    robot.kinetic_energy(m * (forward**2 + (sideways + a * turning) ** 2) / 2 + I * turning**2 / 2)
    robot.rolls("no side slip of the edge", sideways)
    robot.input("torque", "N m", on=turning, about="on the body, as of a rotor")
    robot.quasi_velocity("speed", "m/s", forward, "forward speed of the edge")
    robot.quasi_velocity("yaw_rate", "rad/s", turning, "yaw rate")
    robot.moves_in_plane(x, y, phi)
    robot.output("heading", "heading", [("direction", "rad", phi, "heading")])
    robot.draws(
        box((x, y), phi, 0.1, 0.3, 0.12),
        [(x - 0.05 * cos(phi), y - 0.05 * sin(phi)), (x + 0.05 * cos(phi), y + 0.05 * sin(phi))],
    )
    return robot
