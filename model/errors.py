"""The one error a model raises."""


class ModelError(ValueError):
    """A robot, output or parameter that the method cannot take: the message says what, where and what to do."""
