"""Estimated cycles of a law's operations on a Cortex-M4F: by them is chosen which products the optimizer
keeps.

They are those of ARM's technical reference manual (DDI 0439), as in `guarantees/cycles.py`: 14 for a division
or a root, 2 for a load, 1 if it follows another one (here 1.5), and 1 more for an operation on the result of
the one before.
"""

from collections.abc import Iterable

from .graph import Applied, Node, Operation, executed

CYCLES = {Operation.ADD: 1, Operation.SUB: 1, Operation.MUL: 1, Operation.DIV: 14, Operation.SQRT: 14}
LOAD, WAIT = 1.5, 1
BYTES = 7  # of code for an operation with what it loads and stores, on a Cortex-M4F
LONG = 2048  # bytes of code from which a function is not copied into its callers


def code_bytes(roots: Iterable[Node]) -> int:
    """Return the estimated bytes of the code that computes the roots,
    without those of sines and other functions."""
    return BYTES * sum(isinstance(node, Applied) for node in executed(roots))


def cycles(roots: Iterable[Node]) -> float:
    """Return the estimated cycles of what a step computes: its operations, in the order of the graph, and
    what they load. A sine costs nothing here, since it costs the same in all forms of a step.
    """
    total, last = 0.0, None
    loaded: set[Node] = set()
    for node in executed(roots):
        if isinstance(node, Applied):
            total += CYCLES.get(node.operation, 0) + (WAIT if last in node.arguments else 0)
            last = node
        loaded.update(argument for argument in node.arguments if argument.fixed or not argument.arguments)
    return total + LOAD * len(loaded)
