"""A disk that rolls upright on a level plane, driven about its axle and turned about the vertical.

A. M. Bloch, Nonholonomic Mechanics and Control (2003), section 1.4; the sizes of a bicycle wheel here are
assumed.
"""

from casadi import cos, sin

from ..drawing import box
from ..mechanism import Mechanism


def rolling_disk() -> Mechanism:
    """The vertical rolling disk: 4 coordinates, 2 constraints, 2 torques."""
    robot = Mechanism("rolling_disk", "vertical rolling disk, driven and turned")
    x = robot.coordinate("x", "m", "centre of the disk")
    y = robot.coordinate("y", "m", "centre of the disk")
    phi = robot.coordinate("phi", "rad", "heading, from the x axis to the direction of rolling")
    theta = robot.coordinate("theta", "rad", "rotation about the axle, positive forward")
    m = robot.parameter("m", 2.0, "kg", "mass (assumed)")
    R = robot.parameter("R", 0.3, "m", "radius (assumed)")
    I = robot.parameter("I", 0.15, "kg m^2", "inertia about the axle (assumed)")  # noqa: E741
    J = robot.parameter("J", 0.08, "kg m^2", "inertia about a diameter (assumed)")
    robot.principal_inertias(I, J, J)

    x_dot, y_dot, turning, rolling = (robot.rate(c) for c in (x, y, phi, theta))
    robot.kinetic_energy((m * (x_dot**2 + y_dot**2) + J * turning**2 + I * rolling**2) / 2)
    along, across = cos(phi) * x_dot + sin(phi) * y_dot - R * rolling, cos(phi) * y_dot - sin(phi) * x_dot
    robot.rolls("the disk rolls", along)
    robot.rolls("no side slip", across)
    robot.contact("disk", m, along=along, across=across)
    robot.input("tau_theta", "N m", on=rolling, about="torque about the axle")
    robot.input("tau_phi", "N m", on=turning, about="torque about the vertical")
    robot.quasi_velocity("thetadot", "rad/s", rolling, "rolling rate")
    robot.quasi_velocity("phidot", "rad/s", turning, "yaw rate")
    robot.moves_in_plane(x, y, phi)
    robot.draws(box((x, y), phi, R, R, 0.015))
    return robot
