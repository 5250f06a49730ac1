"""Programs written as named steps, each optimized by itself: the dynamics and the filter of a robot."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from ..model.mechanism import Quantity
from .derivation.stages import Result
from .graph import Graph, Group, Node, free_name, from_casadi, reachable
from .optimize import Optimizer
from .program import Matrix


@dataclass(frozen=True, eq=False)
class NamedStep:
    """A named value, represented by `leaf` in later steps; a pivot is singular if it is not greater than
    `bound`."""

    leaf: Node
    node: Node
    bound: Node | None = None


@dataclass(frozen=True, eq=False)
class SteppedBody:
    """The computation of an entry point: steps in order, then its quantities.

    `looped`: S'MS and S'E tau - bias, from which the runtime computes the quantity nudot.
    """

    steps: tuple[NamedStep, ...]
    quantities: dict[Result, Matrix]
    looped: tuple[Matrix, Matrix] | None = None

    @property
    def roots(self) -> list[Node]:
        """All nodes that must be computed, including those of checks."""
        matrices = [*self.quantities.values(), *(self.looped or ())]
        bounds = [step.bound for step in self.steps if step.bound is not None]
        return [
            *(step.node for step in self.steps),
            *bounds,
            *(node for matrix in matrices for row in matrix for node in row),
        ]


class StepBuilder:
    """Collects steps group by group; an expression in parameters only is not a step and is inserted where it
    is used.

    `groups` are the leaves of the graph; `where` is named in errors.
    """

    def __init__(self, groups: Mapping[str, Sequence[Quantity]], where: str, optimize: bool = True):
        self.where, self.optimize = where, optimize
        self.graph = Graph()
        self.labels: dict[Node, str] = {}
        self.steps: dict[Node, NamedStep] = {}  # by leaf
        self.regular: list[tuple[Node, Node]] = []
        self.taken: set[str] = set()  # names of steps
        self.nodes = {
            q.symbol.element_hash(): self.graph.leaf(group, q.name)
            for group, members in groups.items()
            for q in members
        }
        self.symbols = {q.symbol.element_hash(): q.symbol for members in groups.values() for q in members}

    def needed(self, roots: Sequence[Node]) -> Iterator[NamedStep]:
        """Yield the steps on which the roots depend, in order."""
        needed: set[Node] = set()
        stack = list(roots)
        while stack:
            leaves = [node for node in reachable([stack.pop()]) if node in self.steps and node not in needed]
            needed.update(leaves)
            stack += [
                node
                for leaf in leaves
                for node in (self.steps[leaf].node, self.steps[leaf].bound)
                if node is not None
            ]
        return (step for leaf, step in self.steps.items() if leaf in needed)

    def group(self, steps: Sequence[tuple[ca.SX, ca.SX]], bounds: Sequence[ca.SX] = ()) -> None:
        """Add steps that are optimized together; a later one may use an earlier one. `bounds`: of pivots."""
        for symbol, _ in steps:
            self.symbols[symbol.element_hash()] = symbol
            self.nodes[symbol.element_hash()] = self.graph.leaf(
                Group.STEP, free_name(str(symbol), self.taken)
            )
        nodes = [
            matrix[0][0]
            for matrix in self.built([expression for _, expression in (*steps, *((None, b) for b in bounds))])
        ]
        for k, (symbol, _) in enumerate(steps):
            leaf, node = self.nodes[symbol.element_hash()], nodes[k]
            bound = nodes[len(steps) + k] if bounds else None
            if node.fixed or bound is None and not node.arguments:
                self.nodes[symbol.element_hash()] = node
                if bound is not None:
                    self.regular.append((node, bound))
            else:
                self.steps[leaf] = NamedStep(leaf, node, bound)
                self.labels.setdefault(node, str(symbol))

    def built(self, matrices: Sequence[ca.SX]) -> list[Matrix]:
        """Return the nodes of matrices, optimized together."""
        built = []
        for matrix in matrices:
            symbols = ca.symvar(matrix)
            leaves = [self.nodes[symbol.element_hash()] for symbol in symbols]
            built.append(from_casadi(self.graph, ca.densify(matrix), symbols, leaves, self.where))
        if not self.optimize:
            return built
        roots = [node for matrix in built for row in matrix for node in row]
        improved = iter(Optimizer(self.graph, self.labels).run(roots))
        return [[[next(improved) for _ in row] for row in matrix] for matrix in built]

    def step(self, name: str, expression: ca.SX) -> ca.SX:
        """Return a symbol for the expression; a number is returned unchanged."""
        if expression.is_constant():
            return expression
        symbol = ca.SX.sym(name)
        self.group([(symbol, expression)])
        return symbol
