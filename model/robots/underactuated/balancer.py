"""A two-wheeled balancer: a body on the axle of two wheels, which their motors push off from.

K. Pathak, J. Franch, S. K. Agrawal, Velocity and position control of a wheeled inverted pendulum by partial
feedback linearization, IEEE Transactions on Robotics 21 (2005). The sizes are those of a small self-balancing
robot, assumed.
"""

from casadi import cos, sin

from ...drawing import box, wheels
from ...mechanism import Mechanism
from ...paths import config

GRAVITY = 9.81  # m/s^2


def balancer() -> Mechanism:
    """6 coordinates, 3 rolling constraints; 2 motors between body and wheels for 3 degrees of freedom.

    The body tilts forward by `pitch`; its principal axes are its own, so that its inertia about the vertical
    changes with it.

    Outputs, two each: the angles of the wheels at the motors; speeds; pitch. `drive` has the speed of a point
    of the body at a height H above the axle, plus a term that is proportional to the pitch. At rest the
    motors leave a v' + b pitch'' = m g h pitch, with a, b > 0. With v = -H pitch' - k pitch it becomes (H a -
    b) pitch'' + k a pitch' + m g h pitch = 0, which is stable for H > b / a, a point above the centre about
    which a push on the axle turns the body, and k > 0.
    """
    robot = Mechanism("balancer", "two-wheeled balancer, an inverted pendulum on wheels")
    x = robot.coordinate("x", "m", "middle of the axle")
    y = robot.coordinate("y", "m", "middle of the axle")
    phi = robot.coordinate("phi", "rad", "heading")
    pitch = robot.coordinate("pitch", "rad", "of the body, from upright forward")
    theta_r = robot.coordinate("theta_r", "rad", "right wheel, positive rolls forward")
    theta_l = robot.coordinate("theta_l", "rad", "left wheel, positive rolls forward")
    m = robot.parameter("m", 5.0, "kg", "mass of the body (assumed)")
    h = robot.parameter("h", 0.3, "m", "height of its centre of mass above the axle (assumed)")
    I_x = robot.parameter("I_x", 0.10, "kg m^2", "inertia of the body about its forward axis (assumed)")
    I_y = robot.parameter("I_y", 0.12, "kg m^2", "inertia of the body about the axle's direction (assumed)")
    I_z = robot.parameter("I_z", 0.04, "kg m^2", "inertia of the body about its long axis (assumed)")
    m_w = robot.parameter("m_w", 0.5, "kg", "mass of a wheel (assumed)")
    I_w = robot.parameter("I_w", 0.0025, "kg m^2", "inertia of a wheel about the axle (assumed)")
    I_d = robot.parameter("I_d", 0.0013, "kg m^2", "inertia of a wheel about a diameter (assumed)")
    r = robot.parameter("r", 0.1, "m", "radius of the wheels (assumed)")
    b = robot.parameter("b", 0.2, "m", "half the distance between the wheels (assumed)")
    g = robot.parameter("g", GRAVITY, "m/s^2", "gravity")

    forward = cos(phi) * robot.rate(x) + sin(phi) * robot.rate(y)
    sideways = cos(phi) * robot.rate(y) - sin(phi) * robot.rate(x)
    turning, tilting = robot.rate(phi), robot.rate(pitch)
    ahead, left, up = (
        forward + h * cos(pitch) * tilting,
        sideways + h * sin(pitch) * turning,
        -h * sin(pitch) * tilting,
    )
    upright = I_x * sin(pitch) ** 2 + I_z * cos(pitch) ** 2  # about the vertical
    robot.kinetic_energy(
        m * (ahead**2 + left**2 + up**2) / 2 + I_y * tilting**2 / 2 + upright * turning**2 / 2
    )
    robot.potential_energy(m * g * h * cos(pitch))
    robot.rolls("no side slip", sideways)
    for side, angle, across in (("right", theta_r, -b), ("left", theta_l, b)):
        rim = forward - across * turning
        robot.kinetic_energy(
            m_w * rim**2 / 2 + m_w * sideways**2 / 2 + I_d * turning**2 / 2 + I_w * robot.rate(angle) ** 2 / 2
        )
        robot.rolls(f"{side} wheel rolls", r * robot.rate(angle) - rim)
        robot.contact(
            f"{side} wheel", m / 2 + m_w, along=rim - r * robot.rate(angle), across=sideways, left=across
        )
        robot.input(
            f"tau_{side[0]}",
            "N m",
            on=robot.rate(angle) - tilting,
            about=f"{side} motor, between body and wheel",
        )
    robot.quasi_velocity("speed", "m/s", forward, "forward speed of the axle")
    robot.quasi_velocity("yaw_rate", "rad/s", turning, "yaw rate")
    robot.quasi_velocity("pitch_rate", "rad/s", tilting, "rate of the body's pitch")
    robot.moves_in_plane(x, y, phi)
    turn = ("turn", "rad/s", turning, "yaw rate")
    angles = [
        ("right", "rad", theta_r - pitch, "right wheel, from the body"),
        ("left", "rad", theta_l - pitch, "left wheel"),
    ]
    robot.output("wheels", "angles of the wheels, as their motors turn them", angles)
    robot.output(
        "speeds", "forward speed and yaw rate", [("ahead", "m/s", forward, "forward speed of the axle"), turn]
    )
    robot.output("upright", "pitch and yaw rate", [("tilt", "rad", pitch, "pitch of the body"), turn])
    H = config("H", 1.0, "m", "height of the point above the axle, along the body", "positive")
    k = config("k", 3.0, "m/(s rad)", "speed for each radian of pitch", "nonnegative")
    above = forward + H.symbol * tilting + k.symbol * pitch
    about = "speed of a point above the body, with a part of its pitch"
    robot.output("drive", f"{about}, and yaw rate", [("above", "m/s", above, about), turn], [H, k])
    robot.draws(box((x, y), phi, 0.08, 0.08, 0.15), *wheels((x, y), phi, b, r))
    top = 2 * h * sin(pitch)  # of the body, seen from above
    robot.draws([(x, y), (x + top * cos(phi), y + top * sin(phi))])
    return robot
