"""The TurtleBot3 Burger: two driven wheels and a castor behind them.

All numbers are those of ROBOTIS, turtlebot3_description/urdf/turtlebot3_burger.urdf of github.com/ROBOTIS-GIT/turtlebot3
(2025), with the axle as origin; the names of links and joints are those of that file.
"""

from dataclasses import replace

from ..mechanism import Mechanism
from .labmate import two_wheels

BODIES = {  # link -> mass (kg), place ahead of the axle (m), inertia about the vertical through its centre of mass (kg m^2)
    "base_link": (0.82573504, 0.0, 2.0064271e-3),
    "caster_back_link": (0.005, -0.081, 1e-3),
    "base_scan": (0.114, -0.032, 1e-3),
}


def turtlebot3_burger() -> Mechanism:
    """The platform of `two_wheels`, with the weight on its castor."""
    robot = Mechanism("turtlebot3_burger", "TurtleBot3 Burger, two driven wheels and a castor")
    m_c = sum(mass for mass, _, _ in BODIES.values())
    d = sum(mass * place for mass, place, _ in BODIES.values()) / m_c
    sizes = {
        "b": 0.08,  # wheel_left_joint, wheel_right_joint
        "d": d,
        "r": 0.033,  # wheel_left_link: collision cylinder
        "m_c": m_c,
        "m_w": 2.849894e-2,  # wheel_left_link
        "I_c": sum(inertia + mass * (place - d) ** 2 for mass, place, inertia in BODIES.values()),
        "I_w": 2.0712558e-5,  # wheel_left_link: izz, about its axle
        "I_m": 1.11839965e-5,  # wheel_left_link: mean of ixx and iyy
    }
    two_wheels(robot, sizes, 0.102 + d, 0.038 - d)  # base_link: its collision box, 0.14 m long, 0.032 m behind the axle
    c = robot.parameter("c", -0.081, "m", "distance of the castor ahead of the axle", sign="any")  # caster_back_joint
    on_castor = robot["m_c"] * robot["d"] / c
    robot.contacts = [replace(contact, mass=contact.mass - on_castor / 2) for contact in robot.contacts]
    return robot
