"""A platform like the LABMATE with its castors as bodies, which the paper's model ignores.

G. Campion, G. Bastin and B. d'Andrea-Novel, Structural properties ... of wheeled mobile robots (1996), for
the kinematics of castors. Sizes and masses of the platform are those of the paper; those of the castors are
assumed.
"""

from casadi import cos, sin

from ..drawing import box, placed, wheels
from ..mechanism import Mechanism


def castor_platform() -> Mechanism:
    """9 coordinates, 7 rolling constraints, 2 wheel torques.

    A castor swivels about a vertical pin and rolls behind it. Loads on the ground are those with its wheel
    below the pin.
    """
    robot = Mechanism("castor_platform", "platform like the LABMATE with two castors as bodies of their own")
    x = robot.coordinate("x", "m", "middle of the axle")
    y = robot.coordinate("y", "m", "middle of the axle")
    phi = robot.coordinate("phi", "rad", "heading")
    angles = {
        side: robot.coordinate(f"theta_{side[0]}", "rad", f"{side} wheel, positive rolls forward")
        for side in SIDES
    }
    b = robot.parameter("b", 0.75, "m", "half the distance between the driven wheels")
    d = robot.parameter("d", 0.30, "m", "distance of the platform's centre of mass ahead of the axle")
    r = robot.parameter("r", 0.15, "m", "radius of the driven wheels (assumed: illegible in the scan)")
    m = robot.parameter("m", 32.0, "kg", "platform with its driven wheels")
    I = robot.parameter(  # noqa: E741
        "I", 16.7, "kg m^2", "platform with its driven wheels about the vertical through its centre of mass"
    )
    I_w = robot.parameter("I_w", 0.005, "kg m^2", "driven wheel with motor about its axle", "nonnegative")
    e = robot.parameter("e", 1.1, "m", "distance of the castors' pins ahead of the axle (assumed)")
    f = robot.parameter("f", 0.4, "m", "half the distance between the castors' pins (assumed)")
    c = robot.parameter("c", 0.05, "m", "trail, from a castor's pin back to its wheel's centre (assumed)")
    r_k = robot.parameter("r_k", 0.06, "m", "radius of a castor's wheel (assumed)")
    m_k = robot.parameter("m_k", 1.0, "kg", "castor, its centre of mass above its wheel's centre (assumed)")
    I_k = robot.parameter(
        "I_k", 0.002, "kg m^2", "castor about the vertical through its wheel's centre (assumed)"
    )
    I_r = robot.parameter("I_r", 0.0018, "kg m^2", "a castor's wheel about its axle (assumed)", "nonnegative")

    forward = cos(phi) * robot.rate(x) + sin(phi) * robot.rate(y)
    left = cos(phi) * robot.rate(y) - sin(phi) * robot.rate(x)
    turning = robot.rate(phi)
    robot.body("platform", m, I, forward, left + d * turning, turning)
    robot.rolls("no side slip of the axle", left)
    for side, theta in angles.items():
        beside = SIDES[side] * b
        slip = forward - beside * turning - r * robot.rate(theta)
        robot.kinetic_energy(I_w * robot.rate(theta) ** 2 / 2)
        robot.rolls(f"{side} wheel rolls", slip)
        robot.contact(f"{side} wheel", m * (e - d) / e / 2, along=slip, across=left, left=beside)
        robot.input(f"tau_{side[0]}", "N m", on=robot.rate(theta), about=f"{side} wheel torque")
    robot.draws(box((x, y), phi, 0.7, 1.3, b), *wheels((x, y), phi, b, r))
    for side, sign in SIDES.items():
        beta = robot.coordinate(
            f"beta_{side[0]}", "rad", f"{side} castor, from the platform to the left; 0 behind its pin"
        )
        gamma = robot.coordinate(
            f"gamma_{side[0]}", "rad", f"wheel of the {side} castor, positive rolls forward"
        )
        swivelling, pin = turning + robot.rate(beta), (forward - sign * f * turning, left + e * turning)
        along = cos(beta) * pin[0] + sin(beta) * pin[1]
        across = cos(beta) * pin[1] - sin(beta) * pin[0] - c * swivelling
        slip = along - r_k * robot.rate(gamma)
        robot.body(f"castor_{side[0]}", m_k, I_k, along, across, swivelling)
        robot.kinetic_energy(I_r * robot.rate(gamma) ** 2 / 2)
        robot.rolls(f"{side} castor rolls", slip)
        robot.rolls(f"no side slip of the {side} castor", across)
        # Its load stands at the pin: the trail, a twentieth of e, is left out there.
        robot.contact(
            f"{side} castor", m_k + m * d / e / 2, along=slip, across=across, left=sign * f, ahead=e
        )
        (centre,) = placed(placed((x, y), phi, [(e, sign * f)])[0], phi + beta, [(-c, 0)])
        robot.draws(placed(centre, phi + beta, [(-r_k, 0), (r_k, 0), (c, 0)]))
    robot.quasi_velocity("speed", "m/s", forward, "forward speed of the axle's middle")
    robot.quasi_velocity("yaw_rate", "rad/s", turning, "yaw rate")
    robot.moves_in_plane(x, y, phi)
    return robot


SIDES = {"right": -1, "left": 1}  # of the heading, where left is positive
