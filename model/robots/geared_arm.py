"""A planar arm of two links in a vertical plane, each driven by a motor through gears: all constraints are
holonomic.

The arm is that of M. W. Spong, S. Hutchinson and M. Vidyasagar, Robot Modeling and Control (2006), sections
6.4 and 7.3. Each pair of gears rolls without slip, which is a constraint C(q) = const (1), treated like any
other.
"""

from casadi import SX, cos, sin, vertcat

from ..mechanism import Mechanism


def geared_arm() -> Mechanism:
    """Two joints and two rotors: 4 coordinates, 2 holonomic constraints, 2 motor torques;
    all sizes are assumed."""
    robot = Mechanism("geared_arm", "planar arm of two links under gravity, motors behind gears")
    q_1 = robot.coordinate("q_1", "rad", "link 1, up from the horizontal x axis")
    q_2 = robot.coordinate("q_2", "rad", "link 2, from link 1")
    theta_1 = robot.coordinate("theta_1", "rad", "rotor 1, against the base")
    theta_2 = robot.coordinate("theta_2", "rad", "rotor 2, against link 1, on which it sits at the shoulder")

    def size(name: str, value: float, unit: str, about: str, sign: str = "positive") -> SX:
        return robot.parameter(name, value, unit, f"{about} (assumed)", sign)

    l_1, l_2 = size("l_1", 0.5, "m", "length of link 1"), size("l_2", 0.4, "m", "length of link 2")
    c_1, c_2 = (
        size("c_1", 0.25, "m", "centre of mass along link 1"),
        size("c_2", 0.2, "m", "centre of mass along link 2"),
    )
    m_1, m_2 = (
        size("m_1", 4.0, "kg", "mass of link 1 with both motors"),
        size("m_2", 2.5, "kg", "mass of link 2"),
    )
    I_1 = size("I_1", 0.1, "kg m^2", "link 1 about its centre of mass")
    I_2 = size("I_2", 0.04, "kg m^2", "link 2 about its centre of mass")
    J = size("J", 1e-4, "kg m^2", "each rotor about its axis")
    N = size("N", 50.0, "1", "gear ratio: turns of a rotor per turn of its joint")
    g = robot.parameter("g", 9.81, "m/s^2", "acceleration of gravity", "nonnegative")

    def along(angle: SX) -> SX:
        return vertcat(cos(angle), sin(angle))

    elbow, tip = l_1 * along(q_1), l_1 * along(q_1) + l_2 * along(q_1 + q_2)
    links = (m_1, I_1, c_1 * along(q_1), q_1), (m_2, I_2, elbow + c_2 * along(q_1 + q_2), q_1 + q_2)
    for mass, inertia, centre, angle in links:
        x_dot, z_dot = robot.rate(centre[0]), robot.rate(centre[1])
        robot.kinetic_energy(mass * (x_dot**2 + z_dot**2) / 2 + inertia * robot.rate(angle) ** 2 / 2)
        robot.potential_energy(mass * g * centre[1])
    for rotor in (theta_1, q_1 + theta_2):
        robot.kinetic_energy(J * robot.rate(rotor) ** 2 / 2)
    robot.holds("gears of joint 1", theta_1 - N * q_1)
    robot.holds("gears of joint 2", theta_2 - N * q_2)

    robot.input("tau_1", "N m", on=robot.rate(theta_1), about="torque of motor 1")
    robot.input("tau_2", "N m", on=robot.rate(theta_2), about="torque of motor 2")
    robot.quasi_velocity("qdot_1", "rad/s", robot.rate(q_1), "rate of joint 1")
    robot.quasi_velocity("qdot_2", "rad/s", robot.rate(q_2), "rate of joint 2")
    robot.output(
        "tip",
        "position of the tip",
        [("x_t", "m", tip[0], "x of the tip"), ("z_t", "m", tip[1], "height of the tip")],
    )
    robot.output(
        "joints",
        "angles of the joints",
        [("angle_1", "rad", q_1, "joint 1"), ("angle_2", "rad", q_2, "joint 2")],
    )
    robot.draws([(0, 0), (elbow[0], elbow[1]), (tip[0], tip[1])])
    return robot
