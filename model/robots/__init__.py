"""The shipped robots, by name."""

from collections.abc import Callable

from ..mechanism import Mechanism
from .labmate import labmate

ROBOTS: dict[str, Callable[[], Mechanism]] = {"labmate": labmate}
