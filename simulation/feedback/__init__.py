"""Loops of a state feedback: what it is to follow, and its controller."""
