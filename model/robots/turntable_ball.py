"""A ball that rolls without slipping on a turntable.

E. J. Routh, Advanced Rigid Dynamics (1884); K. Weltner, Stable circular orbits of freely moving balls on
rotating discs, American Journal of Physics 47 (1979). Without forces the ball moves on a circle that depends
on its start, in 7/2 of the turntable's period if it is solid.
"""

from math import pi

from casadi import cos, sin

from ..mechanism import Mechanism


def turntable_ball() -> Mechanism:
    """5 coordinates, 2 constraints with a moving surface, 3 inputs.

    The inertia of a ball is the same about every axis, so that its angular momentum is I times its angular
    velocity in fixed axes, and I times the angular acceleration is the torque. The coordinates `turn` are the
    integrals of the angular velocity; they are no angles that determine the attitude of the ball, on which
    nothing depends.
    """
    robot = Mechanism("turntable_ball", "ball that rolls on a turntable")
    x = robot.coordinate("x", "m", "position of the ball's centre, from the axis of the turntable")
    y = robot.coordinate("y", "m", "position of the ball's centre, from the axis of the turntable")
    turns = [
        robot.coordinate(f"turn_{axis}", "rad", f"integral of the angular velocity about {axis}")
        for axis in "xyz"
    ]
    m = robot.parameter("m", 0.2, "kg", "mass of the ball (assumed)")
    R = robot.parameter("R", 0.03, "m", "radius of the ball (assumed)")
    I = robot.parameter(  # noqa: E741
        "I", 7.2e-5, "kg m^2", "inertia of the ball about its centre, 2/5 m R^2: solid"
    )
    Omega = robot.parameter(
        "Omega", 2.0, "rad/s", "rate of the turntable, positive to the left (assumed)", sign="any"
    )

    v_x, v_y = robot.rate(x), robot.rate(y)
    w_x, w_y, w_z = (robot.rate(turn) for turn in turns)
    robot.kinetic_energy(m * (v_x**2 + v_y**2) / 2 + I * (w_x**2 + w_y**2 + w_z**2) / 2)
    # The lowest point of the ball, R below its centre, moves with the turntable.
    robot.rolls("no slip along x", v_x - R * w_y, surface=-Omega * y)
    robot.rolls("no slip along y", v_y + R * w_x, surface=Omega * x)
    robot.input("force_x", "N", on=v_x, about="push on the centre of the ball")
    robot.input("force_y", "N", on=v_y, about="push on the centre of the ball")
    robot.input("torque_z", "N m", on=w_z, about="about the vertical")
    robot.quasi_velocity("speed_x", "m/s", v_x, "velocity of the ball's centre")
    robot.quasi_velocity("speed_y", "m/s", v_y, "velocity of the ball's centre")
    robot.quasi_velocity("spin", "rad/s", w_z, "angular velocity about the vertical")
    robot.output(
        "ball",
        "position and spin of the ball",
        [
            ("x_b", "m", x, "x of the ball"),
            ("y_b", "m", y, "y of the ball"),
            ("spin_b", "rad/s", w_z, "spin of the ball"),
        ],
    )
    robot.draws([(x + R * cos(2 * pi * k / 40), y + R * sin(2 * pi * k / 40)) for k in range(41)])
    return robot
