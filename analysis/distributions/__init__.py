"""Distributions and brackets: growth, involutive closure, integrals, places of lower rank,
control properties."""
