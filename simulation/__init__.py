"""Simulation of the closed loop of a controller and a plant: SPEC (specification/), `Loop` (loop.py), `Run`,
plots.

`closed_loop.simulate` is the entry point; plots and contact forces are computed from the `Run`.
"""
