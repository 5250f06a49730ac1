"""Robots that can be bought with two driven wheels and a castor behind them: `two_wheels` with their numbers.

The origin is the middle of the axle; names of links and joints are those of the sources:
- TurtleBot3: ROBOTIS, turtlebot3_description/urdf of github.com/ROBOTIS-GIT/turtlebot3 (2025).
- Pioneer 3-DX: Cyberbotics, Pioneer3dx.proto and docs/guide/pioneer-3dx.md of github.com/cyberbotics/webots
  (R2021c), and for its castor MobileRobots, amr_robots_description/urdf/pioneer3dx.urdf.
"""

from collections.abc import Mapping
from dataclasses import replace

from ..mechanism import Mechanism
from .labmate import two_wheels

# Mass (kg), place ahead of the axle (m), inertia about its vertical (kg m^2)
Bodies = Mapping[str, tuple[float, float, float]]

TURTLEBOT3_WHEEL = {
    "r": 0.033,  # wheel_left_link: collision cylinder
    "m_w": 2.849894e-2,  # wheel_left_link
    "I_w": 2.0712558e-5,  # wheel_left_link: izz, about its axle
    "I_m": 1.11839965e-5,  # wheel_left_link: mean of ixx and iyy
}


def turtlebot3_burger() -> Mechanism:
    """TurtleBot3 Burger, turtlebot3_burger.urdf."""
    robot = Mechanism("turtlebot3_burger", "TurtleBot3 Burger, two driven wheels and a castor")
    bodies = {"base_link": (0.82573504, 0.0, 2.0064271e-3), "caster_back_link": (0.005, -0.081, 1e-3)}
    bodies["base_scan"] = (0.114, -0.032, 1e-3)
    # b: wheel_left_joint; c: caster_back_joint; base_link: its collision box, 0.14 m long, 0.032 m behind the
    # axle
    return _with_castor(robot, bodies, {"b": 0.08, **TURTLEBOT3_WHEEL}, c=-0.081, behind=0.102, ahead=0.038)


def turtlebot3_waffle_pi() -> Mechanism:
    """TurtleBot3 Waffle Pi, turtlebot3_waffle_pi.urdf; its two castors count as one between them."""
    robot = Mechanism("turtlebot3_waffle_pi", "TurtleBot3 Waffle Pi, two driven wheels and castors")
    bodies = {"base_link": (1.3729096, 0.0, 1.4612727e-2), "base_scan": (0.114, -0.064, 1e-3)}
    bodies["caster_back_*_link"] = (2 * 0.005, -0.177, 2 * (1e-3 + 0.005 * 0.064**2))
    # b: wheel_left_joint; c: caster_back_left_joint; base_link: its collision box, 0.266 m long, 0.064 m
    # behind the axle
    return _with_castor(robot, bodies, {"b": 0.144, **TURTLEBOT3_WHEEL}, c=-0.177, behind=0.197, ahead=0.069)


def pioneer_3dx() -> Mechanism:
    """Pioneer 3-DX, 9 kg (pioneer-3dx.md): Pioneer3dx.proto, the castor from pioneer3dx.urdf,
    inertias assumed."""
    robot = Mechanism("pioneer_3dx", "Pioneer 3-DX, two driven wheels and a castor")
    length, width = 0.341, 0.261  # boundingObject LARGE_BOX, SIDES
    bodies = {"body": (6.73, -0.06, 6.73 * (length**2 + width**2) / 12)}  # physics; as a uniform box
    bodies["caster_*"] = (0.21, -0.211, 0.0)  # links caster_swivel, caster_wheel, caster_hubcap
    mass, radius, breadth = (9.0 - 6.94) / 2, 0.0975, 0.048  # what is left of 9 kg; BOUNDING_WHEEL
    wheel = {
        "r": radius,
        "m_w": mass,
        "I_w": mass * radius**2 / 2,
        "I_m": mass * (3 * radius**2 + breadth**2) / 12,
    }
    assumed = {"I_c": " (assumed: a uniform box)"} | dict.fromkeys(
        ("I_w", "I_m"), " (assumed: a uniform disc)"
    )
    # b: RIGHT_WHEEL; c: base_caster_swivel_joint, caster_swivel_hubcap_joint; LARGE_BOX is 0.04 m behind the
    # axle
    return _with_castor(
        robot, bodies, {"b": 0.165, **wheel}, c=-0.211, behind=0.2105, ahead=0.1305, assumed=assumed
    )


def _with_castor(
    robot: Mechanism,
    bodies: Bodies,
    sizes: Mapping[str, float],
    c: float,
    behind: float,
    ahead: float,
    assumed: Mapping[str, str] | None = None,
) -> Mechanism:
    """The platform of `two_wheels`, with the weight on its castor, which touches the ground `c` ahead of the
    axle (m).

    `sizes` are those of `two_wheels` without those of the platform, which is made of `bodies` and drawn
    `behind` and `ahead` of the axle (m).
    """
    m_c = sum(mass for mass, _, _ in bodies.values())
    d = sum(mass * place for mass, place, _ in bodies.values()) / m_c
    I_c = sum(inertia + mass * (place - d) ** 2 for mass, place, inertia in bodies.values())
    two_wheels(robot, {**sizes, "d": d, "m_c": m_c, "I_c": I_c}, behind + d, ahead - d, assumed)
    place = robot.parameter("c", c, "m", "distance of the castor ahead of the axle", sign="any")
    on_castor = robot["m_c"] * robot["d"] / place
    robot.support("castor", on_castor, ahead=place)
    robot.contacts = [replace(contact, mass=contact.mass - on_castor / 2) for contact in robot.contacts]
    return robot
