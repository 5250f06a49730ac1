"""The LABMATE with a radius for each wheel, as a robot file for tests:
no two wheels of a pair are of the same size."""

from casadi import cos, sin
from noslip.model import Mechanism

robot = Mechanism("uneven", "two driven wheels of different size")
x, y, phi = robot.coordinate("x", "m"), robot.coordinate("y", "m"), robot.coordinate("phi", "rad")
angles = [robot.coordinate(name, "rad") for name in ("theta_r", "theta_l")]
b, d = (
    robot.parameter("b", 0.375, "m", "half the distance between the wheels"),
    robot.parameter("d", 0.1, "m"),
)
radii = [robot.parameter(name, 0.15, "m") for name in ("r_r", "r_l")]
m_c, m_w = robot.parameter("m_c", 30.0, "kg"), robot.parameter("m_w", 1.0, "kg")
I_c, I_w, I_m = (
    robot.parameter(name, value, "kg m^2")
    for name, value in (("I_c", 15.625), ("I_w", 0.005), ("I_m", 0.0025))
)


def velocity(ahead, left):
    """Forward and sideways velocity of a point of the vehicle."""
    v_x, v_y = robot.rate(x), robot.rate(y)
    forward, sideways = v_x * cos(phi) + v_y * sin(phi), v_y * cos(phi) - v_x * sin(phi)
    return forward - left * robot.rate(phi), sideways + ahead * robot.rate(phi)


forward, sideways = velocity(0, 0)
robot.kinetic_energy(m_c * (forward**2 + sideways**2) / 2 + I_c * robot.rate(phi) ** 2 / 2)
robot.rolls("no side slip", velocity(-d, 0)[1])
for name, angle, radius, left in zip(("right wheel", "left wheel"), angles, radii, (-b, b), strict=True):
    along, across = velocity(-d, left)
    robot.kinetic_energy(
        m_w * (along**2 + across**2) / 2 + I_m * robot.rate(phi) ** 2 / 2 + I_w * robot.rate(angle) ** 2 / 2
    )
    robot.rolls(f"{name} rolls", radius * robot.rate(angle) - along)
    robot.contact(
        name, (m_c + 2 * m_w) / 2, along=along - radius * robot.rate(angle), across=across, left=left
    )
    robot.input(f"tau_{name[0]}", "N m", on=robot.rate(angle))
for name, angle in zip(("thetadot_r", "thetadot_l"), angles, strict=True):
    robot.quasi_velocity(name, "rad/s", robot.rate(angle))
robot.moves_in_plane(x, y, phi)
