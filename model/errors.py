"""The exception for invalid models."""


class ModelError(ValueError):
    """A robot, output or parameter for which the method is not applicable. The message says what,
    where and what to do."""
