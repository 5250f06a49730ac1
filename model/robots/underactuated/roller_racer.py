"""The roller racer: a board with two rear wheels and a handlebar with two wheels, which only the handlebar's
swing drives.

P. S. Krishnaprasad, D. P. Tsakiris, Oscillations, SE(2)-snakes and motion control: a study of the roller
racer, Dynamical Systems 16 (2001). The sizes are assumed. The mass of the handlebar is neglected beside that
of the rider on the board, as there.
"""

from casadi import cos, sin

from ...drawing import box, placed, wheels
from ...mechanism import Mechanism


def roller_racer() -> Mechanism:
    """4 coordinates, 2 rolling constraints; 1 torque at the pivot for 2 degrees of freedom."""
    robot = Mechanism("roller_racer", "roller racer, driven by the swing of its handlebar")
    x = robot.coordinate("x", "m", "middle of the rear axle")
    y = robot.coordinate("y", "m", "middle of the rear axle")
    phi = robot.coordinate("phi", "rad", "heading of the board")
    swing = robot.coordinate("swing", "rad", "of the handlebar relative to the board, positive to the left")
    m = robot.parameter("m", 40.0, "kg", "mass of board and rider (assumed)")
    I = robot.parameter(  # noqa: E741
        "I", 2.5, "kg m^2", "their inertia about the vertical through their centre of mass (assumed)"
    )
    I_h = robot.parameter("I_h", 0.1, "kg m^2", "inertia of the handlebar about the pivot (assumed)")
    c = robot.parameter("c", 0.1, "m", "distance of the centre of mass ahead of the rear axle (assumed)")
    l_1 = robot.parameter("l_1", 0.5, "m", "from the rear axle to the pivot (assumed)")
    l_2 = robot.parameter("l_2", 0.15, "m", "from the handlebar's axle to the pivot ahead of it (assumed)")

    turning, steering = robot.rate(phi), robot.rate(phi) + robot.rate(swing)
    forward = cos(phi) * robot.rate(x) + sin(phi) * robot.rate(y)
    sideways = cos(phi) * robot.rate(y) - sin(phi) * robot.rate(x)
    beside = sideways + c * turning
    robot.kinetic_energy(m * (forward**2 + beside**2) / 2 + I * turning**2 / 2 + I_h * steering**2 / 2)
    robot.rolls("no side slip of the rear wheels", sideways)
    robot.rolls(
        "no side slip of the handlebar",
        cos(swing) * (sideways + l_1 * turning) - sin(swing) * forward - l_2 * steering,
    )
    robot.input("torque", "N m", on=robot.rate(swing), about="between board and handlebar")
    robot.quasi_velocity("speed", "m/s", forward, "forward speed of the rear axle")
    robot.quasi_velocity("swing_rate", "rad/s", robot.rate(swing), "rate of the handlebar")
    robot.moves_in_plane(x, y, phi)
    robot.output("handlebar", "angle of the handlebar", [("bar", "rad", swing, "angle of the handlebar")])
    robot.output("speeds", "forward speed", [("ahead", "m/s", forward, "forward speed of the rear axle")])
    pivot = placed((x, y), phi, [(l_1, 0)])[0]
    axle = placed(pivot, phi + swing, [(-l_2, 0)])[0]
    robot.draws([(x, y), pivot, axle], box((x, y), phi, 0.1, 0.4, 0.1), *wheels((x, y), phi, 0.2, 0.05))
    robot.draws(*wheels(axle, phi + swing, 0.15, 0.05))
    return robot
