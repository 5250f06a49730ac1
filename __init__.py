"""noslip: from the Lagrangian of a robot that rolls without slipping to the C of its controller."""

__version__ = "0.4.0"
