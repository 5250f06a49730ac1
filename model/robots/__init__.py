"""The shipped robots, by name."""

from collections.abc import Callable

from ..mechanism import Mechanism
from .balancer import balancer
from .ball_plate import ball_plate
from .differential import pioneer_3dx, turtlebot3_burger, turtlebot3_waffle_pi
from .four_wheel import four_wheel
from .geared_arm import geared_arm
from .knife_edge import knife_edge
from .labmate import labmate
from .mobile_manipulator import mobile_manipulator
from .roller_racer import roller_racer
from .rolling_disk import rolling_disk
from .sleigh import sleigh
from .slope_platform import slope_platform
from .snakeboard import snakeboard
from .steered import car, f1tenth, forklift, tricycle
from .tractor_trailer import tractor_trailer
from .turntable_ball import turntable_ball

ROBOTS: dict[str, Callable[..., Mechanism]] = {
    "labmate": labmate,
    "knife_edge": knife_edge,
    "rolling_disk": rolling_disk,
    "car": car,
    "tricycle": tricycle,
    "ball_plate": ball_plate,
    "mobile_manipulator": mobile_manipulator,
    "geared_arm": geared_arm,
    "slope_platform": slope_platform,
    "tractor_trailer": tractor_trailer,
    "four_wheel": four_wheel,
    "turtlebot3_burger": turtlebot3_burger,
    "turtlebot3_waffle_pi": turtlebot3_waffle_pi,
    "pioneer_3dx": pioneer_3dx,
    "f1tenth": f1tenth,
    "forklift": forklift,
    "turntable_ball": turntable_ball,
}

UNDERACTUATED: dict[str, Callable[..., Mechanism]] = {  # without laws
    "balancer": balancer,
    "roller_racer": roller_racer,
    "sleigh": sleigh,
    "snakeboard": snakeboard,
}
