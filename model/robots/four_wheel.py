"""A platform of two bodies on one axle each, joined by a vertical pin, with a motor on each of its four
wheels.

The kinematics are those of P. I. Corke and P. Ridley, Steering kinematics for a center-articulated mobile
robot (2001), and of C. Altafini, A path-tracking criterion for an LHD articulated vehicle (1999). There a
cylinder bends the joint; here only the wheels do, and their four torques act on two degrees of freedom. That
their differences affect the constraint forces only is the internal force of V. Kumar and K. J. Waldron, Force
distribution in closed kinematic chains (1988). All sizes are assumed, and so is that each body has its centre
of mass above its axle, so that the joint carries no weight.
"""

from casadi import SX, cos, sin

from ..drawing import box, placed
from ..drawing import wheels as on_axle
from ..errors import ModelError
from ..mechanism import Mechanism


def four_wheel(joints: int = 1) -> Mechanism:
    """8 coordinates, 6 constraints, 4 wheel torques; without a joint 7 coordinates and 1 degree of freedom:
    it drives straight.

    The weights w_.. distribute the torques: a wheel with a larger weight gets less. `squeeze` is the
    preferred torque of the rear wheels, and its negative that of the front wheels; it does not change the
    motion but loads the joint.
    """
    if joints not in (0, 1):
        raise ModelError(f"four_wheel: {joints} joints; give 1, or 0 for a frame with two fixed axles")
    name = "four_wheel" if joints else "four_wheel_rigid"
    robot = Mechanism(
        name,
        f"platform with four driven wheels, {'a joint between its axles' if joints else 'both axles fixed'}",
    )
    x = robot.coordinate("x", "m", "middle of the front axle")
    y = robot.coordinate("y", "m", "middle of the front axle")
    phi = robot.coordinate("phi", "rad", "heading of the front body")
    gamma = (
        robot.coordinate("gamma", "rad", "joint, from the rear body to the front body") if joints else SX(0)
    )
    wheels = {"fr": "front right", "fl": "front left", "rr": "rear right", "rl": "rear left"}
    angles = {
        at: robot.coordinate(f"theta_{at}", "rad", f"{where} wheel, positive rolls forward")
        for at, where in wheels.items()
    }

    def size(name: str, value: float, unit: str, about: str, sign: str = "positive") -> SX:
        return robot.parameter(name, value, unit, f"{about} (assumed)", sign)

    # With l_f = l_r one more function of q would be constant: the rotations of all wheels would depend on the
    # joint.
    b = size("b", 0.4, "m", "half the distance between the wheels of an axle")
    l_f, l_r = (
        size("l_f", 0.5, "m", "from the front axle to the joint"),
        size("l_r", 0.7, "m", "from the joint to the rear axle"),
    )
    r = size("r", 0.2, "m", "radius of the wheels")
    m_f, m_r = (
        size("m_f", 120.0, "kg", "front body with its wheels"),
        size("m_r", 60.0, "kg", "rear body with its wheels"),
    )
    I_f = size(
        "I_f", 12.0, "kg m^2", "front body with its wheels about the vertical through the middle of its axle"
    )
    I_r = size(
        "I_r", 6.0, "kg m^2", "rear body with its wheels about the vertical through the middle of its axle"
    )
    I_w = size("I_w", 0.1, "kg m^2", "each wheel with its motor about its axle", "nonnegative")

    # Velocities along each body's own axes: at the front axle, and from there by the joint at the rear axle.
    forward, left = (
        cos(phi) * robot.rate(x) + sin(phi) * robot.rate(y),
        cos(phi) * robot.rate(y) - sin(phi) * robot.rate(x),
    )
    turning, at_joint = robot.rate(phi), left - l_f * robot.rate(phi)
    rear_turning = turning - robot.rate(gamma)
    rear_forward, rear_left = (
        cos(gamma) * forward - sin(gamma) * at_joint,
        sin(gamma) * forward + cos(gamma) * at_joint,
    )
    axles = {
        "f": (m_f, I_f, forward, left, turning),
        "r": (m_r, I_r, rear_forward, rear_left - l_r * rear_turning, rear_turning),
    }
    for axle, body in axles.items():
        where = {"f": "front", "r": "rear"}[axle]
        robot.body(where, *body)
        robot.rolls(f"no side slip of the {where} axle", body[3])
    for at, where in wheels.items():
        mass, _, ahead, across, yaw_rate = axles[at[0]]
        rolling, beside = robot.rate(angles[at]), b if at[1] == "l" else -b
        slip = ahead - beside * yaw_rate - r * rolling
        robot.kinetic_energy(I_w * rolling**2 / 2)
        robot.rolls(f"{where} wheel rolls", slip)
        robot.contact(f"{where} wheel", mass / 2, along=slip, across=across, left=beside)

    squeeze = robot.parameter(
        "squeeze", 0.0, "N m", "preferred torque of the rear wheels; its negative for the front ones", "any"
    )
    for at, where in wheels.items():
        weight = robot.parameter(
            f"w_{at}", 1.0, "1", f"weight of the {where} torque; a larger weight reduces it"
        )
        preferred = -squeeze if at[0] == "f" else squeeze
        robot.input(
            f"tau_{at}",
            "N m",
            robot.rate(angles[at]),
            f"{where} wheel torque",
            weight=weight,
            preferred=preferred,
        )
    robot.quasi_velocity("speed", "m/s", forward, "forward speed of the front axle's middle")
    if joints:
        robot.quasi_velocity("yaw_rate", "rad/s", turning, "yaw rate of the front body")
    robot.moves_in_plane(x, y, phi)
    joint = placed((x, y), phi, [(-l_f, 0)])[0]
    rear = placed(joint, phi - gamma, [(-l_r, 0)])[0]
    robot.draws(box((x, y), phi, 0.3, 0.35, 0.8 * b), *on_axle((x, y), phi, b, r), [(x, y), joint])
    robot.draws(box(rear, phi - gamma, 0.35, 0.4, 0.8 * b), *on_axle(rear, phi - gamma, b, r), [rear, joint])
    return robot
