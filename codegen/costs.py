"""Estimated cycles of a law's operations on a target: the objective with which the order of the optimizer's passes is chosen.

Those of cortex-m4f are in ARM's technical reference manual (DDI 0439), as in `guarantees/cycles.py`: 14 for a division or a root,
2 for a load, 1 if it follows another one, and 1 more for an operation on the result of the one before. The others are assumed: a
host overlaps loads and, in part, divisions; rv32 is a pipeline of five stages with an FPU; soft has no FPU, so that each
operation is a call of the compiler's library (float, on a Cortex-M0+).
"""

from collections.abc import Iterable
from dataclasses import dataclass

from .graph import Applied, Node, Operation, executed


@dataclass(frozen=True)
class Costs:
    """Cycles of a sum, a product, a division, a root and a load, and of the wait for the result of the operation before."""

    sum: float
    product: float
    division: float
    root: float
    load: float
    wait: float

    def of(self, operation: Operation) -> float:
        """Return the cycles of an operation; 0 for one that costs the same in whatever order the passes run, such as a sine."""
        match operation:
            case Operation.ADD | Operation.SUB:
                return self.sum
            case Operation.MUL:
                return self.product
            case Operation.DIV:
                return self.division
            case Operation.SQRT:
                return self.root
        return 0.0


DEFAULT = "cortex-m4f"
COSTS = {
    "host": Costs(sum=1, product=1, division=6, root=8, load=0.5, wait=1.5),
    "cortex-m4f": Costs(sum=1, product=1, division=14, root=14, load=1.5, wait=1),
    "rv32": Costs(sum=1, product=1, division=20, root=25, load=2, wait=4),
    "soft": Costs(sum=75, product=123, division=384, root=270, load=2, wait=0),
}


BYTES = 7  # of code for an operation with what it loads and stores, on a Cortex-M4F
LONG = 2048  # bytes of code from which a function is not copied into its callers, and repeated steps become a loop


def code_bytes(roots: Iterable[Node]) -> int:
    """Return the estimated bytes of the code that computes the roots, without those of sines and other functions."""
    return BYTES * sum(isinstance(node, Applied) for node in executed(roots))


def cycles(roots: Iterable[Node], costs: Costs) -> float:
    """Return the estimated cycles of what a step computes: its operations, in the order of the graph, and what they load."""
    total, last = 0.0, None
    loaded: set[Node] = set()
    for node in executed(roots):
        if isinstance(node, Applied):
            total += costs.of(node.operation) + (costs.wait if last in node.arguments else 0)
            last = node
        loaded.update(argument for argument in node.arguments if argument.fixed or not argument.arguments)
    return total + costs.load * len(loaded)
