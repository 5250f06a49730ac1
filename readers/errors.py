"""The exceptions that the command line reports: it exits with code 2 for bad input, 1 for C that differs from the model."""


class BadInput(Exception):
    """User input that cannot be used. The message is one line: what is wrong, where, and what to do."""


class Mismatch(Exception):
    """The generated C differs from the model: a line for each law that differs. This is a defect of noslip."""
