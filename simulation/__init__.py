"""Closed loops of a controller and a plant: a SPEC (specification/) becomes a `Loop` (loop.py), integrated to a `Run` and drawn.

`closed_loop.simulate` is the entry point; plots and contact forces are computed from the `Run`.
"""
