"""Vehicles with one steered and one fixed axle, each represented by one wheel in its middle (the bicycle
model).

A. De Luca, G. Oriolo and C. Samson, Feedback control of a nonholonomic car-like robot (1998), for the
kinematics and for a point ahead of the steered wheel as output: a point fixed to the body does not depend on
the steering rate, so Phi is singular. G. Campion, G. Bastin and B. d'Andrea-Novel, Structural properties ...
of wheeled mobile robots (1996), for the tricycle. S. Sekhavat, P. Rouchon and J. Hermosillo, Computing the
flat outputs of Engel differential systems: the case study of the bi-steerable car (2001), for the bus, whose
rear axle is turned by a function of the angle of the front one.

Numbers of vehicles that exist:
- F1TENTH: gym/f110_gym/envs/f110_env.py of github.com/f1tenth/f1tenth_gym (2024), the default parameters, and
  for the wheels racecar.xacro of github.com/mit-racecar/racecar_simulator.
- Forklift: Robotnik, elevator/elevator.urdf.xacro and wheels/motor_wheel.urdf.xacro in
  pallet_truck_description/urdf of github.com/RobotnikAutomation/pallet_truck. The masses of its covers there
  are placeholders.
- Bus: Mercedes-Benz, The Citaro: technical information (C628.087), a city bus of 12 m. Its rear axle is not
  steered; that of the bus here is, as in buses for narrow streets.
"""

from collections.abc import Collection, Mapping

from casadi import SX, cos, sin, vertcat

from ..drawing import box, placed, wheels
from ..mechanism import Mechanism


def car() -> Mechanism:
    """Driven at the rear axle through a differential, steered in front;
    P_l is a point ahead of the front wheel, L > 0."""
    robot = Mechanism("car", "car, driven at the rear, steered in front")
    sizes = {"m": 1200.0, "l": 2.6, "c": 1.3, "r": 0.3, "I_c": 1800.0, "I_s": 4.0, "I_w": 3.0}
    return _steered(robot, sizes, driven_in_front=False, half=0.8, assumed=sizes)


def tricycle() -> Mechanism:
    """Driven and steered at the front wheel: it can turn about its rear axle, where a car is locked."""
    robot = Mechanism("tricycle", "tricycle, driven and steered in front")
    sizes = {"m": 80.0, "l": 1.0, "c": 0.4, "r": 0.15, "I_c": 10.0, "I_s": 0.1, "I_w": 0.1}
    return _steered(robot, sizes, driven_in_front=True, half=0.35, assumed=sizes)


def f1tenth() -> Mechanism:
    """A car of F1TENTH, a tenth of a car's size."""
    sizes = {"m": 3.74, "l": 0.15875 + 0.17145, "c": 0.17145, "I_c": 0.04712}  # m, lf + lr, lr, I
    sizes["r"] = 0.05  # racecar.xacro: wheel_radius
    # Two wheels of 0.1 kg about a diameter; four about their axles, with the motor
    sizes |= {"I_s": 2e-4, "I_w": 5e-4}
    robot = Mechanism("f1tenth", "car of F1TENTH, driven at the rear, steered in front")
    return _steered(robot, sizes, driven_in_front=False, half=0.31 / 2, assumed=("I_s", "I_w"))  # width


def forklift() -> Mechanism:
    """A pallet truck: one wheel drives and steers, ahead of the wheels under the forks."""
    mass, radius, breadth = 10.0, 0.122, 0.1  # wheel_mass, wheel_radius, wheel_width
    sizes = {"l": 1.3725, "r": radius}  # wheelbase: support_wheel joints
    sizes["I_w"] = mass * radius**2 / 2  # front_wheel_link
    # And steer_link
    sizes["I_s"] = mass * (3 * radius**2 + breadth**2) / 12 + mass * (3 * breadth**2 + radius**2) / 12
    # a uniform box, its batteries near the driven wheel
    sizes |= {"m": 600.0, "c": 0.95, "I_c": 600.0 * (1.7**2 + 0.8**2) / 12}
    robot = Mechanism("forklift", "forklift, driven and steered in front, forks behind")
    # fork_y, fork_width
    return _steered(robot, sizes, driven_in_front=True, half=0.25, assumed=("m", "c", "I_c"))


def bus() -> Mechanism:
    """Driven at the rear axle, both axles steered by one motor:
    a linkage turns the rear axle by -k times the front angle."""
    sizes = {"m": 18000.0, "l": 5.845}  # gross vehicle weight; wheelbase
    sizes["r"] = 22.5 * 0.0254 / 2 + 0.7 * 0.275  # tyres 275/70 R 22.5
    sizes["c"] = 5.845 * 6.5 / 18.0  # 6.5 t on the front axle, within its permissible load
    sizes["I_c"] = 18000.0 * (11.95**2 + 2.55**2) / 12  # a uniform box of its length and width
    sizes |= {"I_s": 60.0, "I_r": 200.0, "I_w": 60.0, "k": 0.4}
    robot = Mechanism("bus", "bus, driven at the rear axle, which is steered against the front axle")
    assumed = ("c", "I_c", "I_s", "I_r", "I_w", "k")
    # half: its width; overhangs
    return _steered(
        robot, sizes, driven_in_front=False, half=2.55 / 2, assumed=assumed, overhangs=(3.4, 2.705)
    )


def _steered(
    robot: Mechanism,
    sizes: Mapping[str, float],
    driven_in_front: bool,
    half: float,
    assumed: Collection[str],
    overhangs: tuple[float, float] | None = None,
) -> Mechanism:
    """5 coordinates, 3 constraints, a drive and a steering torque; `half` (m) the width, `assumed` which
    sizes have no source.

    `overhangs` (m) behind the rear and ahead of the front axle. With a size k the rear axle is steered by -k
    delta.
    """
    x = robot.coordinate("x", "m", "middle of the rear axle")
    y = robot.coordinate("y", "m", "middle of the rear axle")
    phi = robot.coordinate("phi", "rad", "heading of the body")
    delta = robot.coordinate("delta", "rad", "steering angle, from the body to the front wheel")
    driven = "front wheel" if driven_in_front else "rear wheels"
    theta = robot.coordinate("theta", "rad", f"{driven}, positive rolls forward")

    def size(name: str, unit: str, about: str, sign: str = "positive") -> SX:
        return robot.parameter(name, sizes[name], unit, about + " (assumed)" * (name in assumed), sign)

    m = size("m", "kg", "mass with all wheels")
    l = size("l", "m", "wheelbase")  # noqa: E741
    c = size("c", "m", "distance of the centre of mass ahead of the rear axle", "any")
    r = size("r", "m", f"radius of the {driven}")
    I_c = size("I_c", "kg m^2", "body about the vertical through the centre of mass")
    I_s = size("I_s", "kg m^2", "steered part about the steering axis")
    I_w = size("I_w", "kg m^2", f"{driven} with motor, about the axle", "nonnegative")
    turned = SX(0)  # of the rear axle, to the left
    if "k" in sizes:
        turned = (
            -size("k", "1", "angle of the rear axle to the right per steering angle to the left", "any")
            * delta
        )
        I_r = size("I_r", "kg m^2", "steered part of the rear axle about the vertical", "nonnegative")
        robot.kinetic_energy(I_r * robot.rate(phi + turned) ** 2 / 2)

    def velocity(point: SX, heading: SX) -> tuple[SX, SX]:
        """Return the velocity of a point of the body, along a heading and to its left."""
        x_dot, y_dot = robot.rate(point[0]), robot.rate(point[1])
        return cos(heading) * x_dot + sin(heading) * y_dot, cos(heading) * y_dot - sin(heading) * x_dot

    rear, ahead, steered = vertcat(x, y), vertcat(cos(phi), sin(phi)), phi + delta
    front, centre = rear + l * ahead, rear + c * ahead
    turning, steering, rolling = robot.rate(phi), robot.rate(delta), robot.rate(theta)
    robot.kinetic_energy(
        m * (robot.rate(centre[0]) ** 2 + robot.rate(centre[1]) ** 2) / 2 + I_c * turning**2 / 2
    )
    robot.kinetic_energy(I_s * robot.rate(steered) ** 2 / 2 + I_w * rolling**2 / 2)

    (rear_forward, rear_sideways), (front_forward, front_sideways) = (
        velocity(rear, phi),
        velocity(front, steered),
    )
    if "k" in sizes:
        forward, left = rear_forward, rear_sideways
        rear_forward, rear_sideways = (
            cos(turned) * forward + sin(turned) * left,
            cos(turned) * left - sin(turned) * forward,
        )
    slip = (front_forward if driven_in_front else rear_forward) - r * rolling
    robot.rolls("no side slip of the rear axle", rear_sideways)
    robot.rolls("no side slip of the front wheel", front_sideways)
    robot.rolls(f"{driven} roll" + ("s" if driven_in_front else ""), slip)
    along_rear, along_front = (None, slip) if driven_in_front else (slip, None)
    robot.contact("rear axle", m * (l - c) / l, along_rear, rear_sideways)
    robot.contact("front wheel", m * c / l, along_front, front_sideways, ahead=l)

    robot.input("tau_d", "N m", on=rolling, about=f"drive torque on the {driven}")
    robot.input("tau_s", "N m", on=steering, about="steering torque, against the body")
    robot.quasi_velocity("thetadot", "rad/s", rolling, f"rate of the {driven}")
    robot.quasi_velocity("deltadot", "rad/s", steering, "steering rate")
    robot.moves_in_plane(front[0], front[1], steered)  # the steered wheel moves like a unicycle
    behind, before = overhangs or (0.2 * l, 0.15 * l)
    robot.draws(box((x, y), phi, behind, l + before, half), *wheels((x, y), phi + turned, half, r))
    robot.draws(placed((front[0], front[1]), steered, [(-1.3 * r, 0), (1.3 * r, 0)]))
    return robot
