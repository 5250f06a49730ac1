"""A tractor with two driven wheels that pulls N trailers, each hitched to the middle of the axle before it.

The kinematics are those of P. Rouchon, M. Fliess, J. Levine and P. Martin, Flatness and motion planning: the
car with n trailers (1993), and O. J. Sordalen, Conversion of the kinematics of a car with n trailers into a
chained form (1993). The tractor is driven as the LABMATE is. All sizes are assumed.
"""

from casadi import SX, cos, sin

from ..drawing import Place, box, placed, wheels
from ..errors import ModelError
from ..mechanism import Mechanism

MOST = 32  # trailers


def tractor_sizes(robot: Mechanism) -> tuple[SX, ...]:
    """Add the sizes of a tractor; return b, d, r, m, I_t, I_w."""
    return (
        robot.parameter("b", 0.5, "m", "half the distance between the tractor's wheels"),
        robot.parameter(
            "d", 0.2, "m", "distance of the tractor's centre of mass ahead of its axle", sign="any"
        ),
        robot.parameter("r", 0.25, "m", "radius of the driven wheels"),
        robot.parameter("m", 150.0, "kg", "mass of the tractor with its wheels"),
        robot.parameter(
            "I_t", 25.0, "kg m^2", "tractor with its wheels about the vertical through its centre of mass"
        ),
        robot.parameter("I_w", 0.2, "kg m^2", "driven wheel with motor about its axle", sign="nonnegative"),
    )


def trailer_sizes(robot: Mechanism, k: int) -> tuple[SX, ...]:
    """Add the sizes of trailer k; return length from hitch to axle,
    the centre of mass ahead of the axle, mass, inertia."""
    return (
        robot.parameter(f"l_{k}", 1.2, "m", f"from the hitch of trailer {k} to its axle"),
        robot.parameter(
            f"d_{k}", 0.1, "m", f"distance of trailer {k}'s centre of mass ahead of its axle", sign="any"
        ),
        robot.parameter(f"m_{k}", 80.0, "kg", f"mass of trailer {k}"),
        robot.parameter(
            f"I_{k}", 15.0, "kg m^2", f"trailer {k} about the vertical through its centre of mass"
        ),
    )


def tractor_trailer(N: int = 1) -> Mechanism:
    """N trailers: 5 + N coordinates, 3 + N rolling constraints, 2 wheel torques; P_l is on the tractor.

    The velocity of each body is that of the body before it, in its own axes. Rotation of the trailers' wheels
    is not modelled.
    """
    if N < 0:
        raise ModelError(f"tractor_trailer: {N} trailers; give 0 or more")
    if N > MOST:
        raise ModelError(
            f"tractor_trailer: {N} trailers; give at most {MOST}: the derivation of more takes minutes to "
            "hours"
        )
    name = "tractor_trailer" if N == 1 else f"tractor_trailer_{N}"
    robot = Mechanism(
        name, f"tractor with two driven wheels and {N} trailer{'s' * (N != 1)}, hitched on the axles"
    )
    x = robot.coordinate("x", "m", "middle of the tractor's axle")
    y = robot.coordinate("y", "m", "middle of the tractor's axle")
    phi = robot.coordinate("phi", "rad", "heading of the tractor")
    theta_r = robot.coordinate("theta_r", "rad", "right wheel, positive rolls forward")
    theta_l = robot.coordinate("theta_l", "rad", "left wheel, positive rolls forward")

    b, d, r, m, I_t, I_w = tractor_sizes(robot)

    turning = robot.rate(phi)
    forward = cos(phi) * robot.rate(x) + sin(phi) * robot.rate(y)
    left = cos(phi) * robot.rate(y) - sin(phi) * robot.rate(x)
    robot.body("tractor", m, I_t, forward, left + d * turning, turning)
    for angle in (theta_r, theta_l):
        robot.kinetic_energy(I_w * robot.rate(angle) ** 2 / 2)
    robot.rolls("no side slip of the tractor", left)
    robot.rolls("right wheel rolls", r * robot.rate(theta_r) - (forward + b * turning))
    robot.rolls("left wheel rolls", r * robot.rate(theta_l) - (forward - b * turning))

    # Half of the tractor's weight rests on each driven wheel, that of a trailer on its axle: castors and
    # hitches carry none.
    for side, angle, across in (("right", theta_r, -b), ("left", theta_l, b)):
        slip = forward - across * turning - r * robot.rate(angle)
        robot.contact(f"{side} wheel", m / 2, along=slip, across=left, left=across)

    robot.draws(box((x, y), phi, 0.35, 0.6, 0.8 * b), *wheels((x, y), phi, b, r))
    hitch: Place = (x, y)
    before = phi
    for k in range(1, N + 1):
        heading = robot.coordinate(f"phi_{k}", "rad", f"heading of trailer {k}")
        length, ahead, mass, inertia = trailer_sizes(robot, k)
        fold, turning = before - heading, robot.rate(heading)
        forward, left = (
            cos(fold) * forward - sin(fold) * left,
            sin(fold) * forward + cos(fold) * left - length * turning,
        )
        robot.body(f"trailer_{k}", mass, inertia, forward, left + ahead * turning, turning)
        robot.rolls(f"no side slip of trailer {k}", left)
        robot.contact(f"trailer {k}", mass, across=left)
        axle = placed(hitch, heading, [(-length, 0)])[0]
        robot.draws([hitch, axle], box(axle, heading, 0.35, 0.45, 0.4), *wheels(axle, heading, 0.45, 0.2))
        before, hitch = heading, axle

    robot.input("tau_r", "N m", on=robot.rate(theta_r), about="right wheel torque")
    robot.input("tau_l", "N m", on=robot.rate(theta_l), about="left wheel torque")
    robot.quasi_velocity("thetadot_r", "rad/s", robot.rate(theta_r), "right wheel rate")
    robot.quasi_velocity("thetadot_l", "rad/s", robot.rate(theta_l), "left wheel rate")
    robot.moves_in_plane(x + d * cos(phi), y + d * sin(phi), phi)
    return robot
