"""The LABMATE on a conveyor along x, whose speed is a known function of time."""

from noslip.model import Mechanism
from noslip.model.robots.labmate import labmate


def conveyor() -> Mechanism:
    """The speed of the conveyor, `belt`, and its rate are in the state that the law receives."""
    robot = labmate()
    robot.ground_moves(x_c=robot.given("belt", "m/s", "speed of the conveyor along x"))
    return robot
