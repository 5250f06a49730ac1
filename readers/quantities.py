"""The range of numbers in files and options; outside it, products and powers would overflow or underflow."""

import argparse

SMALLEST, LARGEST = 1e-30, 1e30  # in SI units; physical sizes of a robot are well between


def in_range(value: float) -> bool:
    """Return whether the absolute value of a finite number is zero or within the range."""
    return value == 0 or SMALLEST <= abs(value) <= LARGEST


def quantity(text: str) -> float:
    """Return a number on the command line, for argparse. The option itself must check that it is finite."""
    value = float(text)
    if value - value == 0 and not in_range(value):
        raise argparse.ArgumentTypeError(f"{text} is out of range: give 0 or a size between {SMALLEST:g} and {LARGEST:g}")
    return value


quantity.__name__ = "float"  # argparse prints this name if the text is not a number
