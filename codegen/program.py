"""A law as a program: one graph for all its entry points, split into what init computes and what a step computes."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import casadi as ca

from ..model.law import ControlLaw
from ..model.linearization import SINGULAR_SQUARED
from .graph import Graph, Node, from_casadi, reachable

Matrix = list[list[Node]]
CONSTANT_GROUPS = frozenset({"params", "config", "gains"})  # known to init; the others change from step to step


@dataclass(frozen=True)
class Entry:
    """A C function of a law: what it takes beside `self` and the state, and which quantities it answers."""

    name: str
    about: str
    answers: tuple[str, ...]
    takes: str = ""  # "", "reference" or "demand"

    @property
    def inverts(self) -> bool:
        """Does it need the inverse of Phi?"""
        return bool(self.takes)


ENTRIES = (
    Entry("output", "Outputs y = h (14)", ("h",)),
    Entry("rate", "First derivatives of the outputs of relative degree 2", ("ydot",)),
    Entry("decoupling", "Decoupling matrix Phi (15)", ("Phi",)),
    Entry("decoupling_rate", "Derivative dPhi/dt along the motion", ("Phidot",)),
    Entry("feedback", "Linearizing feedback (12) with (20): from wanted derivatives to inputs", ("tau_of_demand",), "demand"),
    Entry("evaluate", "Everything at one sine and cosine", ("h", "ydot", "Phi", "Phidot", "u", "tau"), "reference"),
    Entry("step", "The controller: outer loop and feedback (12) with (20), limits, safe answer", ("tau",), "reference"),
)


@dataclass(frozen=True, eq=False)
class Program:
    """Nodes of every quantity of a law, the constants init makes, and names for the nodes that have one."""

    law: ControlLaw
    quantities: dict[str, Matrix]
    singular: tuple[Node, Node]  # singular where not first > second
    constants: dict[Node, str]  # node -> field of the law's struct, in the order init makes them
    labels: dict[Node, str]
    conditions: list[Node]  # functions of the configuration that must be positive

    def roots(self, entry: Entry) -> list[Node]:
        """What an entry point must compute, guards included."""
        answered = [node for name in entry.answers for row in self.quantities[name] for node in row]
        return [*self.singular, *answered] if entry.inverts else answered

    @property
    def angles(self) -> list[Node]:
        """Arguments of sines and cosines that change from step to step."""
        fixed = fixed_nodes(node for matrix in self.quantities.values() for row in matrix for node in row)
        found = {node.arguments[0]: None for node in fixed if node.operation in ("sin", "cos") and not fixed[node]}
        return list(found)


def fixed_nodes(roots: Iterable[Node]) -> dict[Node, bool]:
    """For every node the roots depend on: does it depend on nothing but parameters, so that init can compute it?"""
    fixed: dict[Node, bool] = {}
    for node in reachable(roots):
        is_leaf = node.operation == "leaf"
        fixed[node] = node.group in CONSTANT_GROUPS if is_leaf else all(fixed[argument] for argument in node.arguments)
    return fixed


def compile_law(law: ControlLaw, transform: Callable[[Graph, dict[str, Matrix]], dict[str, Matrix]] | None = None) -> Program:
    """Build the graph of every quantity of the law and split it. `transform` may rewrite the graph before the split."""
    graph = Graph()
    found = law.linearization
    symbols = ca.vertcat(*[q.symbol for group in law.groups.values() for q in group])
    leaves = [graph.leaf(group, q.name) for group, quantities in law.groups.items() for q in quantities]
    determinant = found.determinant
    expressions = {
        "h": found.h,
        "ydot": found.rate,
        "Phi": found.Phi,
        "Phidot": found.Phidot,
        "drift": found.drift,
        "v": law.v,
        "u": law.u,
        "tau": law.tau,
        "tau_of_demand": law.tau_of_demand,
        "Mbar": law.system.Mbar,
        "bias": law.system.bias,
        "determinant": determinant,
        "singular": ca.vertcat(determinant**2, SINGULAR_SQUARED * found.scale_squared),
        "conditions": ca.vertcat(*[expression for expression, _ in law.output.conditions]),
    }
    stacked = ca.vertcat(*[ca.vec(expression.T) for expression in expressions.values()])
    entries = iter(row[0] for row in from_casadi(graph, stacked, [symbols], leaves, f"{law.system.mechanism.name} {law.name}"))
    quantities = {
        name: [[next(entries) for _ in range(expression.shape[1])] for _ in range(expression.shape[0])]
        for name, expression in expressions.items()
    }
    if transform is not None:
        quantities = transform(graph, quantities)
    labels = _labels(law, quantities)
    left, right = (row[0] for row in quantities.pop("singular"))
    conditions = [row[0] for row in quantities.pop("conditions")]
    return Program(law, quantities, (left, right), _split(quantities, (left, right), labels), labels, conditions)


def _labels(law: ControlLaw, quantities: dict[str, Matrix]) -> dict[Node, str]:
    """The field's own names for the nodes that have one; the first name given stays."""
    rows = [row.name for row in law.output.rows]
    second = [row for row, degree in zip(rows, law.linearization.relative_degree, strict=True) if degree == 2]
    motions = [q.name for q in law.system.quasi_velocities]
    inputs = [q.name for q in law.system.mechanism.inputs]
    size = range(1, len(rows) + 1)
    square = [[f"{i}{j}" for j in size] for i in size]
    names = {
        "h": [[name] for name in rows],
        "ydot": [[f"{name}_rate"] for name in second],
        "Phi": [[f"Phi_{place}" for place in row] for row in square],
        "determinant": [["det_Phi"]],
        "Phidot": [[f"Phidot_{place}" for place in row] for row in square],
        "drift": [[f"drift_{name}"] for name in rows],
        "v": [[f"v_{name}"] for name in rows],
        "u": [[f"u_{name}"] for name in motions],
        "Mbar": [[f"Mbar_{place}" for place in row] for row in square],
        "bias": [[f"bias_{name}"] for name in motions],
        "tau": [[name] for name in inputs],
    }
    labels: dict[Node, str] = {}
    taken: set[str] = set()
    for quantity, texts in names.items():
        for nodes, row in zip(quantities[quantity], texts, strict=True):
            for node, text in zip(nodes, row, strict=True):
                if node.operation not in ("leaf", "constant") and node not in labels and text not in taken:
                    labels[node] = text
                    taken.add(text)
    return labels


def _split(quantities: dict[str, Matrix], singular: tuple[Node, Node], labels: dict[Node, str]) -> dict[Node, str]:
    """The fixed nodes that a step uses directly, with the names of their fields."""
    roots = [node for name, matrix in quantities.items() if name in NEEDED for row in matrix for node in row]
    used: dict[Node, None] = {}
    fixed = fixed_nodes([*roots, *singular])
    for node in [n for n in fixed if not fixed[n]]:
        used.update((argument, None) for argument in node.arguments if fixed[argument])
    used.update((root, None) for root in (*roots, *singular) if fixed[root])
    names: dict[Node, str] = {}
    taken = set(labels.values())
    number = 0
    for node in sorted(used, key=lambda n: n.order):
        if node.operation == "constant":
            continue
        if node.operation == "leaf":
            name = node.name if node.name not in taken else f"{node.group}_{node.name}"
        elif node in labels:
            name = labels[node]
        else:
            number += 1
            name = f"k{number}"
        taken.add(name)
        names[node] = name
    return names


NEEDED = frozenset(name for entry in ENTRIES for name in entry.answers)
