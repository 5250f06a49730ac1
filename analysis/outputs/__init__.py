"""Outputs of a robot: singular sets of the decoupling matrix, normal forms, zero dynamics."""
