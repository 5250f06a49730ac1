"""The snakeboard: a board on two pairs of wheels, driven by swinging a rotor and turning the wheels against
each other.

A. D. Lewis, J. P. Ostrowski, R. M. Murray, J. W. Burdick, Nonholonomic mechanics and locomotion: the
snakeboard example, IEEE International Conference on Robotics and Automation (1994), whose model this is; the
sizes are assumed. F. Bullo, A. D. Lewis, Kinematic controllability and motion planning for the snakeboard,
IEEE Transactions on Robotics and Automation 19 (2003).
"""

from casadi import cos, sin

from ...drawing import box, placed, wheels
from ...mechanism import Mechanism


def snakeboard() -> Mechanism:
    """5 coordinates, 2 constraints; 2 torques for 3 degrees of freedom. The rear wheels turn by as much as
    the front ones, to the other side.
    """
    robot = Mechanism("snakeboard", "snakeboard, driven by a rotor and the angle of its wheels")
    x = robot.coordinate("x", "m", "middle of the board")
    y = robot.coordinate("y", "m", "middle of the board")
    theta = robot.coordinate("theta", "rad", "heading of the board")
    psi = robot.coordinate("psi", "rad", "of the rotor, from the board")
    phi = robot.coordinate("phi", "rad", "of the front wheels, from the board; the rear ones have -phi")
    m = robot.parameter("m", 6.0, "kg", "mass of the whole (assumed)")
    l = robot.parameter("l", 0.2, "m", "from the middle to the wheels (assumed)")  # noqa: E741
    J = robot.parameter("J", 0.016, "kg m^2", "inertia of the board about the vertical (assumed)")
    J_r = robot.parameter("J_r", 0.072, "kg m^2", "inertia of the rotor (assumed)")
    J_w = robot.parameter("J_w", 0.0013, "kg m^2", "inertia of a pair of wheels about the vertical (assumed)")

    turning, steering = robot.rate(theta), robot.rate(phi)
    forward = cos(theta) * robot.rate(x) + sin(theta) * robot.rate(y)
    sideways = cos(theta) * robot.rate(y) - sin(theta) * robot.rate(x)
    robot.kinetic_energy(
        m * (forward**2 + sideways**2) / 2 + J * turning**2 / 2 + J_r * (turning + robot.rate(psi)) ** 2 / 2
    )
    for name, ahead in (("front", 1), ("rear", -1)):
        robot.kinetic_energy(J_w * (turning + ahead * steering) ** 2 / 2)
        robot.rolls(
            f"no side slip of the {name} wheels",
            cos(phi) * (sideways + ahead * l * turning) - ahead * sin(phi) * forward,
        )
    robot.input("tau_psi", "N m", on=robot.rate(psi), about="between board and rotor")
    robot.input("tau_phi", "N m", on=steering, about="between board and wheels, on both pairs together")
    robot.quasi_velocity("speed", "m/s", forward, "forward speed of the middle")
    robot.quasi_velocity("psi_rate", "rad/s", robot.rate(psi), "rate of the rotor")
    robot.quasi_velocity("phi_rate", "rad/s", steering, "rate of the wheels' angle")
    robot.moves_in_plane(x, y, theta)
    angles = [
        ("rotor", "rad", psi, "angle of the rotor"),
        ("wheels", "rad", phi, "angle of the front wheels"),
    ]
    robot.output("shape", "angles of rotor and wheels", angles)
    front, rear = placed((x, y), theta, [(l, 0), (-l, 0)])
    robot.draws(
        [rear, front], *wheels(front, theta + phi, 0.08, 0.03), *wheels(rear, theta - phi, 0.08, 0.03)
    )
    robot.draws(box((x, y), theta + psi, 0.15, 0.15, 0.02))
    return robot
