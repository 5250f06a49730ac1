"""A platform on four mecanum wheels, each with rollers on its rim at 45 degrees: it moves in any direction.

P. F. Muir and C. P. Neuman, Kinematic modeling for feedback control of an omnidirectional wheeled mobile
robot (1987). Sizes are those of the KUKA youBot's base in K. M. Lynch and F. C. Park, Modern Robotics (2017),
chapter 13; masses are assumed.
"""

from math import pi

from casadi import cos, sin

from ..drawing import box, placed
from ..mechanism import Mechanism


def mecanum() -> Mechanism:
    """7 coordinates, 4 rolling constraints, 4 wheel torques for 3 degrees of freedom.

    A wheel's lowest roller turns freely about its own axis, so that nothing moves over the ground along this
    axis only. Rollers are parts of their wheels: their own inertia is not modelled.
    """
    robot = Mechanism("mecanum", "platform on four mecanum wheels, which moves in any direction")
    x = robot.coordinate("x", "m", "middle of the wheels")
    y = robot.coordinate("y", "m", "middle of the wheels")
    phi = robot.coordinate("phi", "rad", "heading")
    l_x = robot.parameter("l_x", 0.235, "m", "half the distance between the axles")
    l_y = robot.parameter("l_y", 0.15, "m", "half the distance between the wheels of an axle")
    r = robot.parameter("r", 0.0475, "m", "radius of the wheels")
    gamma = robot.parameter(
        "gamma", pi / 4, "rad", "from the heading to the axis of the lowest roller of the right front wheel"
    )
    m = robot.parameter("m", 20.0, "kg", "mass with all wheels (assumed)")
    I_z = robot.parameter(
        "I_z", 0.8, "kg m^2", "platform with wheels about the vertical through their middle (assumed)"
    )
    I_w = robot.parameter(
        "I_w", 0.0016, "kg m^2", "a wheel with its motor about its axle (assumed)", "nonnegative"
    )

    forward = cos(phi) * robot.rate(x) + sin(phi) * robot.rate(y)
    left = cos(phi) * robot.rate(y) - sin(phi) * robot.rate(x)
    turning = robot.rate(phi)
    robot.body("platform", m, I_z, forward, left, turning)
    robot.draws(box((x, y), phi, 0.29, 0.29, 0.1))
    for at, where, ahead, aside, turned in (
        ("fr", "front right", l_x, -l_y, 1),
        ("fl", "front left", l_x, l_y, -1),
        ("rr", "rear right", -l_x, -l_y, -1),
        ("rl", "rear left", -l_x, l_y, 1),
    ):
        theta = robot.coordinate(f"theta_{at}", "rad", f"{where} wheel, positive rolls forward")
        rolling = forward - aside * turning - r * robot.rate(theta)
        slip = cos(gamma) * rolling + turned * sin(gamma) * (left + ahead * turning)
        robot.kinetic_energy(I_w * robot.rate(theta) ** 2 / 2)
        robot.rolls(f"{where} wheel rolls", slip)
        robot.contact(f"{where} wheel", m / 4, along=slip, left=aside, ahead=ahead)
        robot.input(f"tau_{at}", "N m", on=robot.rate(theta), about=f"{where} wheel torque")
        robot.draws(placed((x, y), phi, [(ahead - r, aside), (ahead + r, aside)]))
    robot.quasi_velocity("forward", "m/s", forward, "forward speed of the middle")
    robot.quasi_velocity("left", "m/s", left, "speed of the middle to the left")
    robot.quasi_velocity("yaw_rate", "rad/s", turning, "yaw rate")
    robot.moves_in_plane(x, y, phi)
    place = [
        ("x_o", "m", x, "x of the middle"),
        ("y_o", "m", y, "y of the middle"),
        ("heading", "rad", phi, "heading"),
    ]
    robot.output("pose", "place and heading", place)
    return robot
