"""Shipped robots with fewer inputs than degrees of freedom: they have no laws."""
