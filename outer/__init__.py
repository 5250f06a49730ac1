"""The outer loop, with python-control: design of its gains, linear analysis, the whole loop about a motion, interoperation."""

from ..controllers.angles import nearest_angle
from ..simulation.guidance import ShortWay
from .channel import Channel, Required, longest_period, longest_period_with
from .design import Gains, from_discrete_poles, from_lqr, from_poles, from_settling, settling_time
from .interop import (
    ControllerRefused,
    Moving,
    closed_loop_system,
    controller_system,
    integral_system,
    robot_system,
    sampled_robot_system,
)
from .margins import Margins, margins
from .motion import Setting, SteadyMotion, steady_motion
from .robustness import Harm, Loops, Wrong, corners, one_by_one, ranking, with_errors
from .setting import default_spec, setting_of

__all__ = [
    "Channel",
    "ControllerRefused",
    "Gains",
    "Harm",
    "Loops",
    "Margins",
    "Moving",
    "Required",
    "Setting",
    "ShortWay",
    "SteadyMotion",
    "Wrong",
    "closed_loop_system",
    "controller_system",
    "corners",
    "default_spec",
    "from_discrete_poles",
    "from_lqr",
    "from_poles",
    "from_settling",
    "integral_system",
    "longest_period",
    "longest_period_with",
    "margins",
    "nearest_angle",
    "one_by_one",
    "ranking",
    "robot_system",
    "sampled_robot_system",
    "setting_of",
    "settling_time",
    "steady_motion",
    "with_errors",
]
