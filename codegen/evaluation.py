"""Values of the nodes of a graph at random states: to see which nodes are the same function but for a
factor."""

from collections.abc import Callable, Iterable, Mapping

import numpy as np

from .graph import Applied, Constant, Element, Leaf, MatrixInverse, Node, Operation

FUNCTIONS: dict[Operation, Callable[..., np.ndarray]] = {
    Operation.ADD: np.add,
    Operation.SUB: np.subtract,
    Operation.MUL: np.multiply,
    Operation.DIV: np.divide,
    Operation.NEG: np.negative,
    Operation.SQRT: np.sqrt,
    Operation.ABS: np.abs,
    Operation.SIN: np.sin,
    Operation.COS: np.cos,
    Operation.EXP: np.exp,
    Operation.LOG: np.log,
    Operation.POW: np.power,
    Operation.SINH: np.sinh,
    Operation.COSH: np.cosh,
    Operation.TANH: np.tanh,
    Operation.ATAN2: np.arctan2,
    Operation.ATAN: np.arctan,
    Operation.ASIN: np.arcsin,
    Operation.ACOS: np.arccos,
    Operation.SIGN: np.sign,
    Operation.MIN: np.minimum,
    Operation.MAX: np.maximum,
    Operation.LESS: lambda a, b: (a < b) * 1.0,
    Operation.NOT: lambda a: (a == 0) * 1.0,
    Operation.IF: lambda a, b: np.where(a != 0, b, 0.0),
}


def evaluate(nodes: Iterable[Node], states: int, stands: Mapping[Node, Node]) -> dict[Node, np.ndarray]:
    """Values of the nodes, arguments before users, at random leaves: the same parameters at each of the
    states.

    A leaf in `stands` has the value of the node it stands for. Matrix inverses have the shape (states, n, n),
    all else (states,).
    """
    random = np.random.default_rng(1992)
    values: dict[Node, np.ndarray] = {}
    with np.errstate(all="ignore"):
        for node in nodes:
            arguments = [values[argument] for argument in node.arguments]
            match node:
                case _ if node in stands:
                    values[node] = values[stands[node]]
                case Leaf():
                    values[node] = (
                        np.full(states, random.uniform(0.5, 1.5))
                        if node.fixed
                        else random.uniform(0.5, 1.5, states)
                    )
                case Constant(value):
                    values[node] = np.full(states, value)
                case MatrixInverse():
                    values[node] = _inverse(np.stack(arguments, axis=1).reshape(states, node.size, node.size))
                case Element():
                    values[node] = arguments[0].reshape(states, -1)[:, node.number]
                case Applied(operation):
                    values[node] = FUNCTIONS[operation](*arguments)
                case _:  # a node of the optimizer's own
                    values[node] = np.full(states, np.nan)
    return values


def _inverse(matrices: np.ndarray) -> np.ndarray:
    try:
        return np.linalg.inv(matrices)
    except np.linalg.LinAlgError:
        return np.full(matrices.shape, np.nan)
