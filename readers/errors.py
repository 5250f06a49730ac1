"""The exception for bad input; the command line exits with code 2."""


class BadInput(Exception):
    """User input that cannot be used. The message is one line: what is wrong, where, and what to do."""
