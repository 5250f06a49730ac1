"""Shipped robots with fewer inputs than degrees of freedom:
their laws linearize as many outputs as they have inputs."""
