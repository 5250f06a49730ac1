"""The outer loop, with python-control: design of its gains, linear analysis,
the whole loop about a motion, interoperation."""

from typing import TYPE_CHECKING

from ...simulation.controllers.angles import nearest_angle
from ...simulation.guidance import ShortWay
from .channel import Channel, Required, longest_period, longest_period_with
from .design import Gains, from_discrete_poles, from_hinf, from_lqr, from_poles, from_settling, settling_time
from .drive import DriveLoop
from .margins import Margins, margins
from .motion import Setting, SteadyMotion, steady_motion
from .robustness import Harm, Loops, Wrong, corners, one_by_one, ranking, with_errors
from .setting import default_spec, setting_of
from .weighted import Weights, from_mixed, weighted_norm

if TYPE_CHECKING:
    from .interop import (
        ControllerRefused,
        Moving,
        closed_loop_system,
        controller_system,
        integral_system,
        robot_system,
        sampled_robot_system,
    )

__all__ = [
    "Channel",
    "ControllerRefused",
    "DriveLoop",
    "Gains",
    "Harm",
    "Loops",
    "Margins",
    "Moving",
    "Required",
    "Setting",
    "ShortWay",
    "SteadyMotion",
    "Weights",
    "Wrong",
    "closed_loop_system",
    "controller_system",
    "corners",
    "default_spec",
    "from_discrete_poles",
    "from_hinf",
    "from_lqr",
    "from_mixed",
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
    "weighted_norm",
    "with_errors",
]


def __getattr__(name: str) -> object:
    """Return a name of `interop`, imported when it is first used:
    python-control takes longer to import than all else here."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(".interop", __name__), name)
