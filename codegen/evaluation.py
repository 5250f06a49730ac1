"""Values of the nodes of a graph at random states: to see which nodes are the same function but for a factor."""

from collections.abc import Callable, Iterable, Mapping
from math import isqrt

import numpy as np

from .graph import CONSTANT_GROUPS, ENTRY, MATRIX_INVERSE, Node

FUNCTIONS: dict[str, Callable[..., np.ndarray]] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.divide,
    "neg": np.negative,
    "sqrt": np.sqrt,
    "abs": np.abs,
    "sin": np.sin,
    "cos": np.cos,
    "exp": np.exp,
    "log": np.log,
    "pow": np.power,
    "sinh": np.sinh,
    "cosh": np.cosh,
    "tanh": np.tanh,
    "atan2": np.arctan2,
    "atan": np.arctan,
    "asin": np.arcsin,
    "acos": np.arccos,
    "sign": np.sign,
    "min": np.minimum,
    "max": np.maximum,
    "less": lambda a, b: (a < b) * 1.0,
    "not": lambda a: (a == 0) * 1.0,
    "if": lambda a, b: np.where(a != 0, b, 0.0),
}


def evaluate(nodes: Iterable[Node], states: int, stands: Mapping[Node, Node]) -> dict[Node, np.ndarray]:
    """Values of the nodes, arguments before users, at random leaves: the same parameters at each of the states.

    A leaf in `stands` has the value of the node it stands for. Matrix inverses have the shape (states, n, n), all else (states,).
    """
    random = np.random.default_rng(1992)
    values: dict[Node, np.ndarray] = {}
    with np.errstate(all="ignore"):
        for node in nodes:
            arguments = [values[argument] for argument in node.arguments]
            if node in stands:
                values[node] = values[stands[node]]
            elif node.operation == "leaf":
                fixed = node.group in CONSTANT_GROUPS
                values[node] = np.full(states, random.uniform(0.5, 1.5)) if fixed else random.uniform(0.5, 1.5, states)
            elif node.operation == "constant":
                values[node] = np.full(states, node.value)
            elif node.operation == MATRIX_INVERSE:
                n = isqrt(len(arguments))
                values[node] = _inverse(np.stack(arguments, axis=1).reshape(states, n, n))
            elif node.operation == ENTRY:
                values[node] = arguments[0].reshape(states, -1)[:, int(node.value)]
            elif node.operation in FUNCTIONS:
                values[node] = FUNCTIONS[node.operation](*arguments)
            else:  # an operation of the optimizer's own
                values[node] = np.full(states, np.nan)
    return values


def _inverse(matrices: np.ndarray) -> np.ndarray:
    try:
        return np.linalg.inv(matrices)
    except np.linalg.LinAlgError:
        return np.full(matrices.shape, np.nan)
