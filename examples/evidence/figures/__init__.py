"""The figures, a module for each group of experiments."""
