"""Exact symbolic algebra: expression graphs, canonical form, rational functions, linear equations."""
