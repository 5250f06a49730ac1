"""The plate-ball problem: a ball between a fixed plate and a plate above it that is pushed.

R. W. Brockett and L. Dai, Non-holonomic kinematics and the role of elliptic functions in constructive
controllability (1993); V. Jurdjevic, The geometry of the plate-ball problem (1993). The ball does not slip on
either plate and does not spin about the vertical. The kinematics of contact are D. J. Montana's, as in the
paper's section 2.2.

A ball on one plate that moves in x and y has 4 velocities and 2 inputs. With the plate above, which does not
rotate, 2 remain.
"""

from math import pi

from casadi import cos, sin, substitute, sumsqr, vertcat

from ..drawing import box
from ..mechanism import Mechanism
from ..rolling.contact import RollingContact, rolls_on
from ..rolling.surfaces import plane, sphere


def ball_plate() -> Mechanism:
    """7 coordinates, 5 constraints (2 holonomic: the plate moves twice as far as the ball), 2 forces."""
    robot = Mechanism("ball_plate", "ball between a fixed plate and one that is pushed over it")
    u = robot.coordinate("u", "rad", "contact point on the fixed plate, its latitude on the ball")
    v = robot.coordinate("v", "rad", "contact point on the fixed plate, its longitude on the ball")
    x = robot.coordinate("x", "m", "position of the ball")
    y = robot.coordinate("y", "m", "position of the ball")
    psi = robot.coordinate("psi", "rad", "from the ball's u-curve to the x axis")
    x_p = robot.coordinate("x_p", "m", "position of the plate above")
    y_p = robot.coordinate("y_p", "m", "position of the plate above")
    m = robot.parameter("m", 0.5, "kg", "mass of the ball (assumed)")
    R = robot.parameter("R", 0.05, "m", "radius of the ball (assumed)")
    I = robot.parameter(  # noqa: E741
        "I", 0.0005, "kg m^2", "inertia of the ball about its centre, 2/5 m R^2 if solid (assumed)"
    )
    m_p = robot.parameter("m_p", 1.0, "kg", "mass of the plate above (assumed)")

    contact, place = RollingContact(sphere(R), plane()), vertcat(u, v, x, y, psi)
    x_dot, y_dot, x_p_dot, y_p_dot = (robot.rate(c) for c in (x, y, x_p, y_p))
    turning = substitute(contact.angular_velocity(robot.rate(place)), contact.q, place)
    robot.kinetic_energy(m * (x_dot**2 + y_dot**2) / 2 + I * sumsqr(turning) / 2)
    robot.kinetic_energy(m_p * (x_p_dot**2 + y_p_dot**2) / 2)
    rolls_on(robot, "ball on the fixed plate", contact, place)
    # The top of the ball is twice as fast as its centre, because it rolls on the plate below.
    robot.rolls("the plate above moves with the ball, x", x_p_dot - 2 * x_dot)
    robot.rolls("the plate above moves with the ball, y", y_p_dot - 2 * y_dot)

    robot.input("force_x", "N", on=x_p_dot, about="push on the plate above")
    robot.input("force_y", "N", on=y_p_dot, about="push on the plate above")
    robot.quasi_velocity("speed_x", "m/s", x_dot, "velocity of the ball's centre")
    robot.quasi_velocity("speed_y", "m/s", y_dot, "velocity of the ball's centre")
    robot.output(
        "ball", "position of the ball", [("x_b", "m", x, "x of the ball"), ("y_b", "m", y, "y of the ball")]
    )
    circle = [2 * pi * k / 40 for k in range(41)]
    robot.draws(
        [(x + R * cos(angle), y + R * sin(angle)) for angle in circle], box((x_p, y_p), 0.0, 0.05, 0.05, 0.05)
    )
    return robot
