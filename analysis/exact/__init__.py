"""Exact arithmetic of functions of a robot: fields of functions, points, real zeros, readable text."""
