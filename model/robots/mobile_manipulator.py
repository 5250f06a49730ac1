"""The LABMATE with a planar arm of two links on it: the end point follows a trajectory, the platform follows
the arm.

After Y. Yamamoto and X. Yun, Coordinating locomotion and manipulation of a mobile manipulator (1994): the end
point tracks, and the platform moves so that the arm keeps its preferred posture. The sizes of the arm are
assumed.
"""

from dataclasses import replace

from casadi import SX, cos, sin, vertcat

from ..drawing import placed
from ..mechanism import Mechanism
from .labmate import labmate


def mobile_manipulator() -> Mechanism:
    """7 coordinates, 3 constraints, 4 torques; the arm moves in the horizontal plane,
    its base ahead of P_c."""
    robot = labmate()
    robot.name, robot.about = "mobile_manipulator", "LABMATE platform with a planar arm of two links"
    q_1 = robot.coordinate("q_1", "rad", "link 1, from the platform's X axis")
    q_2 = robot.coordinate("q_2", "rad", "link 2, from link 1")

    def size(name: str, value: float, unit: str, about: str, sign: str = "positive") -> SX:
        return robot.parameter(name, value, unit, f"{about} (assumed)", sign)

    a = size("a", 0.2, "m", "distance of the arm's base ahead of P_c", "any")
    l_1, l_2 = size("l_1", 0.5, "m", "length of link 1"), size("l_2", 0.5, "m", "length of link 2")
    m_1, m_2 = size("m_1", 3.0, "kg", "mass of link 1"), size("m_2", 2.0, "kg", "mass of link 2")
    I_1 = size("I_1", 0.06, "kg m^2", "link 1 about its middle, which is its centre of mass")
    I_2 = size("I_2", 0.04, "kg m^2", "link 2 about its middle, which is its centre of mass")

    # Velocities along each body's own axes, from one to the next: P_c, the base, the elbow.
    phi, x_dot, y_dot = robot["phi"], robot.rate(robot["x_c"]), robot.rate(robot["y_c"])
    forward, left, yaw_rate = (
        cos(phi) * x_dot + sin(phi) * y_dot,
        cos(phi) * y_dot - sin(phi) * x_dot,
        robot.rate(phi),
    )
    to_joint = a
    for name, angle, length, mass, inertia in (
        ("link_1", q_1, l_1, m_1, I_1),
        ("link_2", q_2, l_2, m_2, I_2),
    ):
        left = left + to_joint * yaw_rate
        forward, left = cos(angle) * forward + sin(angle) * left, cos(angle) * left - sin(angle) * forward
        yaw_rate, to_joint = yaw_rate + robot.rate(angle), length
        robot.body(name, mass, inertia, forward, left + length / 2 * yaw_rate, yaw_rate)
    # The weight of the arm also rests on the driven wheels, half on each in every posture.
    robot.contacts = [replace(contact, mass=contact.mass + (m_1 + m_2) / 2) for contact in robot.contacts]

    robot.input("tau_1", "N m", on=robot.rate(q_1), about="torque of joint 1")
    robot.input("tau_2", "N m", on=robot.rate(q_2), about="torque of joint 2")
    robot.quasi_velocity("qdot_1", "rad/s", robot.rate(q_1), "rate of joint 1")
    robot.quasi_velocity("qdot_2", "rad/s", robot.rate(q_2), "rate of joint 2")

    def along(angle: SX | float) -> SX:
        return vertcat(cos(angle), sin(angle))

    # From P_c to the end point, in the platform's axes
    reach = a * along(0) + l_1 * along(q_1) + l_2 * along(q_1 + q_2)
    robot.output(
        "end_point",
        "position of the end point, and position of the end point relative to the platform",
        [
            ("x_e", "m", robot["x_c"] + cos(phi) * reach[0] - sin(phi) * reach[1], "x of the end point"),
            ("y_e", "m", robot["y_c"] + sin(phi) * reach[0] + cos(phi) * reach[1], "y of the end point"),
            ("ahead", "m", reach[0], "distance of the end point ahead of P_c"),
            ("left", "m", reach[1], "distance of the end point to the left of the platform's axis"),
        ],
    )
    robot.draws(
        placed(
            (robot["x_c"], robot["y_c"]),
            phi,
            [(a, 0), (a + l_1 * cos(q_1), l_1 * sin(q_1)), (reach[0], reach[1])],
        )
    )
    return robot
