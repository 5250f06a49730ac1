"""Which numbers a file or an option may give: beyond, products and powers of them overflow or vanish."""

import argparse

SMALLEST, LARGEST = 1e-30, 1e30  # in SI units; every size a robot can have lies well between


def in_range(value: float) -> bool:
    """Is the size of a finite number within the range? Zero is."""
    return value == 0 or SMALLEST <= abs(value) <= LARGEST


def quantity(text: str) -> float:
    """A number on the command line, for argparse; one that is not finite is left to the option's own check."""
    value = float(text)
    if value - value == 0 and not in_range(value):
        raise argparse.ArgumentTypeError(f"{text} is out of range: sizes are 0 or between {SMALLEST:g} and {LARGEST:g}")
    return value


quantity.__name__ = "float"  # which argparse names where the text is no number at all
