"""The exceptions that the command line reports: it exits with code 2 for bad input, 1 for C that differs from the model."""

import difflib
from collections.abc import Iterable


class BadInput(Exception):
    """User input that cannot be used. The message is one line: what is wrong, where, and what to do."""


class Mismatch(Exception):
    """The generated C differs from the model: a line for each law that differs. This is a defect of noslip."""


def suggestion(name: str, names: Iterable[str]) -> str:
    """Return the end of a message about an unknown name: the nearest of `names`, or all of them."""
    names = list(names)
    near = difflib.get_close_matches(name, names, 1)
    return f"; did you mean {near[0]!r}?" if near else f"; known are {', '.join(names) or 'none'}"
