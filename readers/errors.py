"""The error of the command line: bad input, exit 2."""


class BadInput(Exception):
    """Something the user gave cannot be used: the message, one line, says what, where and what to do."""
