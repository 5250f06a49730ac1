"""The exception for bad input; the command line exits with code 2."""

import difflib
from collections.abc import Iterable


class BadInput(Exception):
    """User input that cannot be used. The message is one line: what is wrong, where, and what to do."""


def suggestion(name: str, known: Iterable[str]) -> str:
    """Return the end of a message about an unknown name: the nearest known name, or all known names."""
    known = list(known)
    near = difflib.get_close_matches(name, known, 1)
    return f"; did you mean {near[0]!r}?" if near else f"; known are {', '.join(known) or 'none'}"
