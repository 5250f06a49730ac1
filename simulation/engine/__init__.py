"""Robots on a floor in a physics engine: wheels that may slip and lift, made from the same Mechanism."""
