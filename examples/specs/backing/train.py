"""A tractor that backs N trailers: `tractor_trailer` in coordinates of its last axle, which follows the path.

The middle of the last axle is a flat output (P. Rouchon, M. Fliess, J. Levine and P. Martin, Flatness and
motion planning: the car with n trailers, 1993): with an extension it leaves no zero dynamics, so that no
trailer can fold. The quasi-velocities are the speed of the last axle and the yaw rate of the tractor: the
kinematics are a product and a tangent for each trailer.
"""

import casadi as ca
from casadi import cos, sin, tan
from noslip.model import Mechanism, ModelError
from noslip.model.drawing import Place, box, placed, wheels
from noslip.model.robots.tractor_trailer import tractor_sizes, trailer_sizes


def train(N: int = 2) -> Mechanism:
    """N trailers, 1 to 3: 5 + N coordinates, 3 + N rolling constraints, 2 wheel torques;
    P_l is on the last trailer."""
    if not 1 <= N <= 3:
        raise ModelError(f"train: {N} trailers; give 1 to 3")
    robot = Mechanism(
        f"train_{N}", f"tractor that backs {N} trailer{'s' * (N > 1)}, in coordinates of the last axle"
    )
    x = robot.coordinate("x", "m", "middle of the last axle")
    y = robot.coordinate("y", "m", "middle of the last axle")
    phi = robot.coordinate("phi", "rad", "heading of the last trailer")
    hitch = [
        robot.coordinate(f"hitch_{k}", "rad", f"from the heading of trailer {k} to that before it")
        for k in range(1, N + 1)
    ]
    theta_r = robot.coordinate("theta_r", "rad", "right wheel, positive rolls forward")
    theta_l = robot.coordinate("theta_l", "rad", "left wheel, positive rolls forward")

    b, d, r, m, I_t, I_w = tractor_sizes(robot)

    # From the last axle to the tractor: velocities of each body along its own axes, and its share of S.
    turning, heading = robot.rate(phi), phi
    axle: Place = (x, y)
    forward = cos(phi) * robot.rate(x) + sin(phi) * robot.rate(y)
    left = cos(phi) * robot.rate(y) - sin(phi) * robot.rate(x)
    speed, yaw = ca.SX(1), []  # of a body, for each unit of the speed of the last axle
    for k in range(N, 0, -1):
        fold = hitch[k - 1]
        length, ahead, mass, inertia = trailer_sizes(robot, k)
        robot.body(f"trailer_{k}", mass, inertia, forward, left + ahead * turning, turning)
        robot.rolls(f"no side slip of trailer {k}", left)
        robot.contact(f"trailer {k}", mass, across=left)
        hinge: Place = placed(axle, heading, [(length, 0)])[0]
        robot.draws([axle, hinge], box(axle, heading, 0.35, 0.45, 0.4), *wheels(axle, heading, 0.45, 0.2))
        yaw.append(tan(fold) * speed / length)
        speed = speed / cos(fold)
        swept = left + length * turning
        forward, left = cos(fold) * forward + sin(fold) * swept, cos(fold) * swept - sin(fold) * forward
        turning, heading, axle = turning + robot.rate(fold), heading + fold, hinge

    robot.body("tractor", m, I_t, forward, left + d * turning, turning)
    robot.rolls("no side slip of the tractor", left)
    for side, angle, across in (("right", theta_r, -b), ("left", theta_l, b)):
        rim = forward - across * turning
        robot.kinetic_energy(I_w * robot.rate(angle) ** 2 / 2)
        robot.rolls(f"{side} wheel rolls", r * robot.rate(angle) - rim)
        robot.contact(f"{side} wheel", m / 2, along=rim - r * robot.rate(angle), across=left, left=across)
        robot.input(f"tau_{side[0]}", "N m", on=robot.rate(angle), about=f"{side} wheel torque")
    robot.draws(box(axle, heading, 0.35, 0.6, 0.8 * b), *wheels(axle, heading, b, r))

    folding = [before - own for own, before in zip(yaw, [*yaw[1:], ca.SX(0)], strict=True)][::-1]
    last = [ca.SX(0)] * (N - 1)
    S = ca.horzcat(
        ca.vertcat(cos(phi), sin(phi), yaw[0], *folding, speed / r, speed / r),
        ca.vertcat(0, 0, 0, 1, *last, b / r, -b / r),
    )
    robot.null_space(S, {"speed": "m/s", "turning": "rad/s"})
    robot.output("end", "middle of the last axle", [("x_e", "m", x), ("y_e", "m", y)])
    robot.moves_in_plane(x, y, phi)
    return robot
