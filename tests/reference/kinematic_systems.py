"""Systems seen through their velocities only, whose distributions are known from the literature."""

from collections.abc import Callable

import casadi as ca
from casadi import cos, sin
from noslip.model.mechanism import Mechanism, Quantity, quantity
from noslip.model.rolling.kinematics import Kinematics


def angle(name: str) -> Quantity:
    return quantity(name, "rad")


def length(name: str) -> Quantity:
    return quantity(name, "m")


def size(name: str) -> Quantity:
    return quantity(name, "m", default=1.0, sign="positive")


def knife_edge() -> Kinematics:
    """A blade on ice: no velocity across."""
    x, y, phi = q = (length("x"), length("y"), angle("phi"))
    return Kinematics("knife_edge", q, A=ca.horzcat(sin(phi.symbol), -cos(phi.symbol), 0))


def vertical_disk() -> Kinematics:
    """A coin on its edge, kept upright: rolls and turns about the vertical."""
    q = (length("x"), length("y"), angle("heading"), angle("roll"))
    R = size("R")
    heading = q[2].symbol
    A = ca.vertcat(
        ca.horzcat(1, 0, 0, -R.symbol * cos(heading)), ca.horzcat(0, 1, 0, -R.symbol * sin(heading))
    )
    return Kinematics("vertical_disk", q, (R,), A=A)


def car() -> Kinematics:
    """Front wheels steer, both axles do not slide."""
    q = (length("x"), length("y"), angle("phi"), angle("delta"))
    wheelbase = size("L")
    phi, delta = q[2].symbol, q[3].symbol
    rear = ca.horzcat(sin(phi), -cos(phi), 0, 0)
    front = ca.horzcat(sin(phi + delta), -cos(phi + delta), -wheelbase.symbol * cos(delta), 0)
    return Kinematics("car", q, (wheelbase,), A=ca.vertcat(rear, front))


def trailers(count: int) -> Kinematics:
    """A unicycle with trailers, each hooked to the middle of the axle before it;
    S by turning and forward speed."""
    q = (length("x"), length("y"), *[angle(f"theta_{k}") for k in range(count + 1)])
    sizes = tuple(size(f"L_{k + 1}") for k in range(count))
    theta = [each.symbol for each in q[2:]]
    return Kinematics(
        f"unicycle with {count} trailers",
        q,
        sizes,
        S=ca.horzcat(ca.SX.eye(count + 3)[:, 2], forward(theta, sizes)),
    )


def forward(theta: list[ca.SX], sizes: tuple[Quantity, ...]) -> ca.SX:
    """Rates of (x, y, theta_0, ...) at forward speed 1: trailer k turns at v_(k-1) sin(theta_(k-1) -
    theta_k) / L_k."""
    speed, rates = ca.SX(1), []
    for k, L in enumerate(sizes):
        rates.append(speed * sin(theta[k] - theta[k + 1]) / L.symbol)
        speed = speed * cos(theta[k] - theta[k + 1])
    return ca.vertcat(cos(theta[0]), sin(theta[0]), 0, *rates)


def labmate_with_trailers(count: int) -> Kinematics:
    """The LABMATE, wheel angles included, and trailers each hooked to the middle of the axle before it;
    A by no-slip rows."""
    q = (
        *map(length, ("x_c", "y_c")),
        *map(angle, ("phi", "theta_r", "theta_l", *[f"psi_{k + 1}" for k in range(count)])),
    )
    b, r = size("b"), size("r")
    d = quantity("d", "m", default=0.3)
    sizes = tuple(size(f"L_{k + 1}") for k in range(count))
    n, qdot = len(q), ca.SX.sym("qdot", len(q))
    symbols = ca.vertcat(*[each.symbol for each in q])
    x, y, phi = (each.symbol for each in q[:3])
    headings = [phi, *[each.symbol for each in q[5:]]]

    def across(point: ca.SX, heading: ca.SX) -> ca.SX:
        rate = ca.jtimes(point, symbols, qdot)
        return cos(heading) * rate[1] - sin(heading) * rate[0]

    axle = ca.vertcat(x - d.symbol * cos(phi), y - d.symbol * sin(phi))
    along = ca.vertcat(cos(phi), sin(phi))
    rows = [across(axle, phi)]
    for side, rate in ((1, qdot[3]), (-1, qdot[4])):
        wheel = axle + side * b.symbol * ca.vertcat(sin(phi), -cos(phi))
        rows.append(r.symbol * rate - ca.dot(along, ca.jtimes(wheel, symbols, qdot)))
    place = axle
    for L, heading in zip(sizes, headings[1:], strict=True):
        place = place - L.symbol * ca.vertcat(cos(heading), sin(heading))
        rows.append(across(place, heading))
    A = ca.jacobian(ca.vertcat(*rows), qdot)
    assert A.shape == (n - 2, n)
    return Kinematics(f"labmate with {count} trailers", q, (b, d, r, *sizes), A=A)


def hitched(by_constraints: bool) -> Kinematics:
    """A unicycle that pulls a trailer by a hitch as far behind its axle as the trailer is long,
    given by A or by S."""
    *_, t0, t1 = q = (length("x"), length("y"), angle("t0"), angle("t1"))
    L = size("L")
    across, along = sin(t0.symbol - t1.symbol), cos(t0.symbol - t1.symbol)
    if by_constraints:
        axle = ca.horzcat(sin(t0.symbol), -cos(t0.symbol), 0, 0)
        trailer = ca.horzcat(-sin(t1.symbol), cos(t1.symbol), -L.symbol * along, -L.symbol)
        return Kinematics("hitched", q, (L,), A=ca.vertcat(axle, trailer))
    turning = ca.vertcat(0, 0, 1, -along)
    forward_one = ca.vertcat(cos(t0.symbol), sin(t0.symbol), 0, across / L.symbol)
    return Kinematics("hitched", q, (L,), S=ca.horzcat(turning, forward_one))


def grushin(
    function: Callable[[ca.SX], ca.SX], kind: Callable[[str], Quantity] = length, *parameters: Quantity
) -> Kinematics:
    """Velocities along x, and along y times a function of x: singular where the function is zero."""
    x, y = kind("x"), length("y")
    S = ca.horzcat(ca.vertcat(1, 0), ca.vertcat(0, function(x.symbol)))
    return Kinematics("grushin", (x, y), parameters, S=S)


def pendulum() -> Kinematics:
    """A point on a rigid rod in space: only holonomic."""
    q = tuple(map(length, "xyz"))
    return Kinematics("spherical_pendulum", q, A=ca.horzcat(*[each.symbol for each in q]))


def slider_crank() -> Kinematics:
    """Crank angle, rod angle and slider, joined at the pins: only holonomic, one freedom."""
    q = (angle("crank"), angle("rod"), length("x"))
    R, L = size("R"), size("L")
    crank, rod, x = (each.symbol for each in q)
    closure = ca.vertcat(
        R.symbol * cos(crank) + L.symbol * cos(rod) - x, R.symbol * sin(crank) + L.symbol * sin(rod)
    )
    return Kinematics("slider_crank", q, (R, L), A=ca.jacobian(closure, ca.vertcat(crank, rod, x)))


def sleigh(ahead: float, pushed: bool = False) -> Mechanism:
    """Chaplygin's sleigh, turned by a torque and, if `pushed`, pushed along its blade;
    its centre of mass `ahead` (m) of it."""
    robot = Mechanism("sleigh")
    x, y, phi = (robot.coordinate(name, unit) for name, unit in (("x", "m"), ("y", "m"), ("phi", "rad")))
    m, inertia = robot.parameter("m", 1.0, "kg"), robot.parameter("I", 0.5, "kg m^2")
    d = robot.parameter("d", ahead, "m", sign="any")
    forward = cos(phi) * robot.rate(x) + sin(phi) * robot.rate(y)
    across, turning = cos(phi) * robot.rate(y) - sin(phi) * robot.rate(x), robot.rate(phi)
    robot.kinetic_energy(m * (forward**2 + (across + d * turning) ** 2) / 2 + inertia * turning**2 / 2)
    robot.rolls("no slip across the blade", across)
    robot.input("torque", "N m", on=turning)
    if pushed:
        robot.input("push", "N", on=forward)
    return robot


def snakeboard() -> Mechanism:
    """J. Ostrowski, A. Lewis, R. Murray, J. Burdick, IEEE Int. Conf. Robotics and Automation, 1994:
    rotor and wheels driven."""
    robot = Mechanism("snakeboard")
    x, y = robot.coordinate("x", "m"), robot.coordinate("y", "m")
    theta, psi, phi = (robot.coordinate(name, "rad") for name in ("theta", "psi", "phi"))
    m, half = robot.parameter("m", 6.0, "kg"), robot.parameter("l", 0.2, "m")
    J, J_r, J_w = (
        robot.parameter(name, value, "kg m^2")
        for name, value in (
            (
                "J",
                0.1,
            ),
            ("J_r", 0.1),
            ("J_w", 0.02),
        )
    )
    vx, vy, turning, rotor, wheels = map(robot.rate, (x, y, theta, psi, phi))
    robot.kinetic_energy(m * (vx**2 + vy**2) / 2 + J * turning**2 / 2 + J_r * (turning + rotor) ** 2 / 2)
    robot.kinetic_energy(J_w * ((turning + wheels) ** 2 + (turning - wheels) ** 2) / 2)
    for name, sign in (("front", 1), ("back", -1)):
        heading = theta + sign * phi
        robot.rolls(
            f"no slip across the {name} wheels",
            cos(heading) * vy - sin(heading) * vx + sign * half * cos(phi) * turning,
        )
    robot.input("rotor_torque", "N m", on=rotor)
    robot.input("wheel_torque", "N m", on=wheels)
    return robot
