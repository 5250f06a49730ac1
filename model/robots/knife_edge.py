"""A knife edge on a level plane, the smallest robot that rolls: a unicycle, or a blade on ice.

The first example of J. I. Neimark and N. A. Fufaev, Dynamics of Nonholonomic Systems (1972), and of A. M.
Bloch, Nonholonomic Mechanics and Control (2003), section 1.6; the sizes are those of a small cart, assumed.
"""

from casadi import cos, sin

from ..drawing import placed
from ..mechanism import Mechanism


def knife_edge() -> Mechanism:
    """The blade's middle is the centre of mass: 3 coordinates, 1 constraint,
    a forward force and a yaw torque."""
    robot = Mechanism("knife_edge", "knife edge (unicycle), pushed forward and turned")
    x = robot.coordinate("x", "m", "middle of the blade, centre of mass")
    y = robot.coordinate("y", "m", "middle of the blade, centre of mass")
    phi = robot.coordinate("phi", "rad", "heading, from the x axis to the blade")
    m = robot.parameter("m", 10.0, "kg", "mass (assumed)")
    I = robot.parameter(  # noqa: E741
        "I", 0.5, "kg m^2", "inertia about the vertical through the centre of mass (assumed)"
    )

    forward = cos(phi) * robot.rate(x) + sin(phi) * robot.rate(y)
    sideways = cos(phi) * robot.rate(y) - sin(phi) * robot.rate(x)
    turning = robot.rate(phi)
    robot.kinetic_energy(m * (robot.rate(x) ** 2 + robot.rate(y) ** 2) / 2 + I * turning**2 / 2)
    robot.rolls("no side slip of the blade", sideways)
    robot.contact("blade", m, across=sideways)
    robot.input("force", "N", on=forward, about="push along the blade")
    robot.input("torque", "N m", on=turning, about="yaw torque")
    robot.quasi_velocity("speed", "m/s", forward, "forward speed")
    robot.quasi_velocity("yaw_rate", "rad/s", turning, "yaw rate")
    robot.moves_in_plane(x, y, phi)
    robot.draws(placed((x, y), phi, [(-0.2, 0), (0.2, 0), (0.1, 0.05), (0.1, -0.05), (0.2, 0)]))
    return robot
