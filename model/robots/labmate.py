"""The LABMATE mobile platform of the paper: two driven wheels on one axle, castors ignored."""

from collections.abc import Mapping

from casadi import SX, cos, sin

from ..drawing import box, wheels
from ..mechanism import Mechanism


def labmate() -> Mechanism:
    """5 coordinates, 3 rolling constraints, 2 wheel torques."""
    robot = Mechanism("labmate", "LABMATE mobile platform, two driven wheels, castors ignored")
    # The wheel radius is illegible in the scan: 0.15 is the value of later literature; the inertias suggest
    # 0.10.
    assumed = {"r": " (assumed: illegible in the scan)"}
    sizes = {
        "b": 0.75,
        "d": 0.30,
        "r": 0.15,
        "m_c": 30.0,
        "m_w": 1.0,
        "I_c": 15.625,
        "I_w": 0.005,
        "I_m": 0.0025,
    }
    return two_wheels(robot, sizes, 1.0, 1.0, assumed)  # the paper's platform is 2 m long


def two_wheels(
    robot: Mechanism,
    sizes: Mapping[str, float],
    behind: float,
    ahead: float,
    assumed: Mapping[str, str] | None = None,
) -> Mechanism:
    """The platform from its bodies' energies; `sizes` are the defaults of its parameters, drawn `behind` and
    `ahead` of P_c (m).

    P_c is the centre of mass, P_o the middle of the axle, a distance d behind it; the right wheel is on the
    body's -Y side. `assumed` is added to what parameters mean.
    """

    def size(name: str, unit: str, about: str, sign: str = "positive") -> SX:
        return robot.parameter(name, sizes[name], unit, about + (assumed or {}).get(name, ""), sign)

    x_c = robot.coordinate("x_c", "m", "centre of mass P_c")
    y_c = robot.coordinate("y_c", "m", "centre of mass P_c")
    phi = robot.coordinate("phi", "rad", "heading, from the x axis to the body's X axis")
    theta_r = robot.coordinate("theta_r", "rad", "right wheel, positive rolls forward")
    theta_l = robot.coordinate("theta_l", "rad", "left wheel, positive rolls forward")

    b = size("b", "m", "half the distance between the wheels")
    d = size("d", "m", "distance of P_c ahead of the axle", sign="any")
    r = size("r", "m", "wheel radius")
    m_c = size("m_c", "kg", "mass of the platform without wheels")
    m_w = size("m_w", "kg", "mass of one wheel with its motor", sign="nonnegative")
    I_c = size("I_c", "kg m^2", "platform about the vertical through P_c")
    I_w = size("I_w", "kg m^2", "wheel with motor about its axle", sign="nonnegative")
    I_m = size("I_m", "kg m^2", "wheel with motor about a vertical diameter", sign="nonnegative")

    def body(expression: tuple[SX, SX]) -> tuple[SX, SX]:
        """Return the components along the body's X (forward) and Y (left) axes of the velocity of a point
        given in the world."""
        x_dot, y_dot = (robot.rate(component) for component in expression)
        return x_dot * cos(phi) + y_dot * sin(phi), y_dot * cos(phi) - x_dot * sin(phi)

    def kinetic(mass: SX, inertia: SX, point: tuple[SX, SX]) -> SX:
        x_dot, y_dot = (robot.rate(component) for component in point)
        return mass * (x_dot**2 + y_dot**2) / 2 + inertia * robot.rate(phi) ** 2 / 2

    axle = (x_c - d * cos(phi), y_c - d * sin(phi))
    right = (axle[0] + b * sin(phi), axle[1] - b * cos(phi))
    left = (axle[0] - b * sin(phi), axle[1] + b * cos(phi))
    robot.kinetic_energy(kinetic(m_c, I_c, (x_c, y_c)))
    for wheel, angle in ((right, theta_r), (left, theta_l)):
        robot.kinetic_energy(kinetic(m_w, I_m, wheel) + I_w * robot.rate(angle) ** 2 / 2)

    # (22) to (24): P_o does not move sideways; the velocity of each wheel's centre equals that of its rim.
    robot.rolls("no side slip of P_o", body(axle)[1])
    robot.rolls("right wheel rolls", r * robot.rate(theta_r) - body(right)[0])
    robot.rolls("left wheel rolls", r * robot.rate(theta_l) - body(left)[0])

    # Half of the weight rests on each driven wheel: castors are ignored.
    for name, wheel, angle, left_of in (
        ("right wheel", right, theta_r, -b),
        ("left wheel", left, theta_l, b),
    ):
        forward, sideways = body(wheel)
        robot.contact(
            name, (m_c + 2 * m_w) / 2, along=forward - r * robot.rate(angle), across=sideways, left=left_of
        )

    robot.input("tau_r", "N m", on=robot.rate(theta_r), about="right wheel torque")
    robot.input("tau_l", "N m", on=robot.rate(theta_l), about="left wheel torque")
    robot.quasi_velocity("thetadot_r", "rad/s", robot.rate(theta_r), "right wheel rate")
    robot.quasi_velocity("thetadot_l", "rad/s", robot.rate(theta_l), "left wheel rate")
    robot.moves_in_plane(x_c, y_c, phi)
    robot.draws(box((x_c, y_c), phi, behind, ahead, b), *wheels(axle, phi, b, r))
    return robot
