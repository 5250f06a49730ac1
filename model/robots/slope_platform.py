"""The LABMATE on a slope, with viscous friction in its bearings: an example with gravity and damping.

The level platform is `labmate`; gravity and damping are added. Slope and damping are assumed.
"""

from dataclasses import replace

from casadi import cos, sin

from ..mechanism import Mechanism
from .labmate import labmate


def slope_platform() -> Mechanism:
    """The plane rises along x by the angle `slope`; the platform's coordinates lie in it."""
    robot = labmate()
    robot.name, robot.about = (
        "slope_platform",
        "LABMATE platform on a slope that rises along x, with viscous damping",
    )
    slope = robot.parameter("slope", 0.15, "rad", "angle of the plane, which rises along x (assumed)", "any")
    g = robot.parameter("g", 9.81, "m/s^2", "acceleration of gravity", "nonnegative")
    c = robot.parameter(
        "c", 0.5, "N m s", "viscous friction of each wheel's bearing (assumed)", "nonnegative"
    )

    # The platform, the middle of the two wheels
    x_c, axle = robot["x_c"], robot["x_c"] - robot["d"] * cos(robot["phi"])
    robot.potential_energy(g * sin(slope) * (robot["m_c"] * x_c + 2 * robot["m_w"] * axle))
    for wheel in ("theta_r", "theta_l"):
        rate = robot.rate(robot[wheel])
        robot.force(-c * rate, on=rate)
    # The normal component
    robot.contacts = [replace(contact, mass=contact.mass * cos(slope)) for contact in robot.contacts]
    return robot
