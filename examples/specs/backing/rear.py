"""The shipped car with the middle of its rear axle as output,
which follows the path forward and in reverse."""

from noslip.model import Mechanism
from noslip.model.robots.steered import car


def rear() -> Mechanism:
    """The middle of the rear axle is a flat output of a car:
    it leaves no zero dynamics in either direction. It is P_l too."""
    robot = car()
    x, y, phi = robot["x"], robot["y"], robot["phi"]
    robot.output("rear", "middle of the rear axle", [("x_r", "m", x), ("y_r", "m", y)])
    robot.moves_in_plane(x, y, phi)
    return robot
