"""The shipped robots, by name."""

from collections.abc import Callable

from ..mechanism import Mechanism
from .ball_plate import ball_plate
from .castor_platform import castor_platform
from .differential import pioneer_3dx, turtlebot3_burger, turtlebot3_waffle_pi
from .four_wheel import four_wheel
from .geared_arm import geared_arm
from .knife_edge import knife_edge
from .labmate import labmate
from .mecanum import mecanum
from .mobile_manipulator import mobile_manipulator
from .rolling_disk import rolling_disk
from .slope_platform import slope_platform
from .steered import bus, car, f1tenth, forklift, tricycle
from .tractor_trailer import tractor_trailer
from .turntable_ball import turntable_ball
from .underactuated.balancer import balancer
from .underactuated.roller_racer import roller_racer
from .underactuated.sleigh import sleigh
from .underactuated.snakeboard import snakeboard

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
    "bus": bus,
    "castor_platform": castor_platform,
    "mecanum": mecanum,
}

UNDERACTUATED: dict[str, Callable[..., Mechanism]] = {  # with fewer inputs than degrees of freedom
    "balancer": balancer,
    "roller_racer": roller_racer,
    "sleigh": sleigh,
    "snakeboard": snakeboard,
}

SHIPPED = ROBOTS | UNDERACTUATED
