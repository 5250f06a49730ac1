"""A law as a program: one graph for all its entry points, split into what init computes and what a step computes."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import count

import casadi as ca

from ..model.law import ControlLaw
from ..model.linearization import SINGULAR, SINGULAR_SQUARED, Linearization
from ..model.mechanism import Quantity
from ..model.names import in_c
from ..model.outputs import FOOT
from .derivation.foot import TOLD, can_be_told, place_names, plain_at_foot, staged_at_foot
from .derivation.stages import PART, STEP, Stages, staged
from .graph import CONSTANT_GROUPS, SHOWING, Graph, Node, free_name, from_casadi, reachable
from .optimize import Optimizer

Matrix = list[list[Node]]
AT_FOOT = "at foot: "  # begins the names of quantities by FOOT


@dataclass(frozen=True)
class Entry:
    """A C function of a law: what it takes beside `self` and the state, and which quantities it answers.

    One that is not `public` checks nothing: it is for the step, once that has found its arguments good.
    """

    name: str
    about: str
    answers: tuple[str, ...]
    takes: str = ""  # "", "reference" or "demand"
    public: bool = True
    at_foot: bool = False  # takes FOOT in place of the vehicle's position and heading

    @property
    def inverts(self) -> bool:
        """Does it need the inverse of Phi?"""
        return not {"u", "tau", "tau_of_demand", "slope"}.isdisjoint(self.answers)

    def of(self, quantity: str) -> str:
        """Name in the graph of a quantity that it answers."""
        return AT_FOOT + quantity if self.at_foot else quantity


ENTRIES = (
    Entry("output", "Outputs y = h (14)", ("h",)),
    Entry("rate", "First derivatives of the outputs of relative degree 2", ("ydot",)),
    Entry("decoupling", "Decoupling matrix Phi (15)", ("Phi",)),
    Entry("decoupling_rate", "Derivative dPhi/dt along the motion", ("Phidot",)),
    Entry("feedback", "Linearizing feedback (12) with (20): from wanted derivatives to inputs", ("tau_of_demand",), "demand"),
    Entry("evaluate", "Everything at one sine and cosine", ("h", "ydot", "Phi", "Phidot", "u", "tau"), "reference"),
    Entry("step", "The controller: outer loop and feedback (12) with (20), limits, safe answer", ("tau",), "reference"),
    Entry("slope", "Derivative of the inputs by the demand on the speed, the output of degree 1", ("slope",), public=False),
    Entry(
        "follow",
        "The step, where a path tells what it is for the law: P_l seen from its foot",
        ("tau",),
        "reference",
        at_foot=True,
    ),
    Entry("follow_slope", "As slope, seen from the foot of P_l", ("slope",), public=False, at_foot=True),
)


@dataclass(frozen=True, eq=False)
class Body:
    """What one entry point computes: its quantities as nodes; singular where not first > second of `singular`.

    `singular` is empty where nothing is inverted, or where the inversion itself tells.
    """

    quantities: dict[str, Matrix]
    singular: tuple[Node, ...]

    @property
    def roots(self) -> list[Node]:
        """Every node that must be computed, guards included."""
        return [*self.singular, *(node for matrix in self.quantities.values() for row in matrix for node in row)]


@dataclass(frozen=True, eq=False)
class Program:
    """A law's entry points, the constants init makes for them, and names for the nodes that have one."""

    law: ControlLaw
    entries: dict[Entry, Body]
    constants: dict[Node, str]  # node -> field of the law's struct, in the order init makes them
    labels: dict[Node, str]
    conditions: list[Node]  # functions of the configuration that must be positive
    regular: list[Node]  # functions of the parameters that must be positive, or Phi is singular everywhere
    graph: Graph

    @property
    def groups(self) -> dict[str, Sequence[Quantity]]:
        """The leaves of the graph, by group."""
        return {**self.law.groups, "foot": FOOT}

    @property
    def angles(self) -> list[Node]:
        """Arguments of sines and cosines that change from step to step."""
        return self._angles(fixed=False)

    @property
    def fixed_angles(self) -> list[Node]:
        """Arguments of sines and cosines that init takes."""
        return self._angles(fixed=True)

    def _angles(self, fixed: bool) -> list[Node]:
        known = fixed_nodes(root for body in self.entries.values() for root in body.roots)
        found = {node.arguments[0]: None for node in known if node.operation in ("sin", "cos") and known[node] == fixed}
        return list(found)


def hidden_inputs(body: Body) -> list[Node]:
    """Inputs of a step that can be infinite or NaN while every result is finite.

    Sums, products, roots and numerators pass such a value on; a denominator or a function that is bounded need not, and an
    angle is checked by itself.
    """
    shown: set[Node] = set()
    stack = [root for matrix in body.quantities.values() for row in matrix for root in row]
    while stack:
        node = stack.pop()
        if node not in shown and node.operation in SHOWING:
            shown.add(node)
            stack.extend(node.arguments[:1] if node.operation == "div" else node.arguments)
    return [node for node in reachable(body.roots) if node.operation == "leaf" and node not in shown]


def fixed_nodes(roots: Iterable[Node]) -> dict[Node, bool]:
    """For every node the roots depend on: does it depend on nothing but parameters, so that init can compute it?"""
    fixed: dict[Node, bool] = {}
    for node in reachable(roots):
        is_leaf = node.operation == "leaf"
        fixed[node] = node.group in CONSTANT_GROUPS if is_leaf else all(fixed[argument] for argument in node.arguments)
    return fixed


def compile_law(law: ControlLaw, optimize: bool = True, stages: bool | None = None) -> Program:
    """Build the graph of every entry point of the law and split off what init computes.

    `stages` says whether to write the law in short steps first, `optimize` whether to run the optimizer's passes; without
    both, the expressions are the model's own, as they come out of CasADi.
    """
    graph = Graph()
    source = in_steps(law) if (optimize if stages is None else stages) else plain(law)
    groups = law.groups | {"foot": FOOT}
    nodes = {q.symbol.element_hash(): graph.leaf(group, q.name) for group, members in groups.items() for q in members}
    symbols = [q.symbol for members in groups.values() for q in members]
    where = f"{law.system.mechanism.name} {law.name}"
    labels: dict[Node, str] = {}

    def build(expression: ca.SX) -> Matrix:
        return from_casadi(graph, expression, symbols, [nodes[symbol.element_hash()] for symbol in symbols], where)

    for symbol, expression, *least in source.steps:
        made = graph.inverse(build(expression), *least) if least else build(expression)
        for one, (node,) in zip(ca.vertsplit(ca.vec(symbol.T)), ([node] for row in made for node in row), strict=True):
            nodes[one.element_hash()] = node
            symbols.append(one)
            if not least and not str(one).startswith(PART):
                labels.setdefault(node, str(one).removeprefix(STEP))
    quantities = {name: build(expression) for name, expression in source.quantities.items()}
    labels = _own_names(law, quantities) | labels
    entries = {}
    for entry in ENTRIES:
        chosen = {name: quantities[entry.of(name)] for name in entry.answers if quantities.get(entry.of(name))}
        singular = tuple(row[0] for row in quantities[entry.of("singular")]) if chosen and entry.inverts else ()
        body = Body(chosen, singular)
        if chosen and not (entry.at_foot and _reads(body, place_names(law))):
            entries[entry] = _optimized(graph, body, labels) if optimize else body
    conditions = [row[0] for row in quantities["conditions"]]
    regular = [row[0] for name in ("regular", AT_FOOT + "regular") for row in quantities.get(name, ())]
    constants = constants_of([root for body in entries.values() for root in body.roots], labels)
    return Program(law, entries, constants, labels, conditions, list(dict.fromkeys(regular)), graph)


def in_steps(law: ControlLaw) -> Stages:
    """The law's quantities in short steps; those at the foot too, where they need nothing else of place and heading."""
    found = staged(law)
    if can_be_told(law):
        told = staged_at_foot(law)
        shared = {symbol.element_hash() for symbol, *_ in found.steps if symbol.is_symbolic()}  # the velocities
        found.steps += [step for step in told.steps if step[0].element_hash() not in shared]
        found.quantities |= {AT_FOOT + name: told.quantities[name] for name in TOLD}
    return found


def plain(law: ControlLaw) -> Stages:
    """The law's quantities as the model has them, in one step."""
    found = law.linearization
    quantities = {
        "h": found.h,
        "ydot": found.rate,
        "Phi": found.Phi,
        "Phidot": found.Phidot,
        "u": law.u,
        "tau": law.tau,
        "tau_of_demand": law.tau_of_demand,
        "singular": _singular(found),
        "regular": ca.SX(0, 1),
        "conditions": ca.vertcat(*[expression for expression, _ in law.output.conditions]),
        "slope": law.slope,
    }
    if can_be_told(law):
        quantities |= {AT_FOOT + name: plain_at_foot(law, quantities[name]) for name in TOLD}
    return Stages([], quantities=quantities)


def _singular(found: Linearization) -> ca.SX:
    """What must be greater than what, for Phi not to be singular; without a root up to 2 x 2."""
    if found.system.freedom <= 2:
        return ca.vertcat(found.determinant**2, SINGULAR_SQUARED * found.scale_squared)
    one, condition = found.measure
    return ca.vertcat(one, SINGULAR * condition)


def _optimized(graph: Graph, body: Body, labels: dict[Node, str]) -> Body:
    """The body after the optimizer's passes; names follow the nodes whose value they are."""
    improved = iter(Optimizer(graph, labels).run(body.roots))
    singular = tuple(next(improved) for _ in body.singular)
    quantities = {name: [[next(improved) for _ in row] for row in matrix] for name, matrix in body.quantities.items()}
    return Body(quantities, singular)


def _reads(body: Body, names: frozenset[str]) -> bool:
    """Is one of these coordinates read? A sine of more than the heading, which FOOT does not have, keeps it."""
    return any(node.operation == "leaf" and node.group == "state" and node.name in names for node in reachable(body.roots))


def _own_names(law: ControlLaw, quantities: dict[str, Matrix]) -> dict[Node, str]:
    """The field's own names for what a law answers."""
    rows = [row.name for row in law.output.rows]
    second = [row for row, degree in zip(rows, law.linearization.relative_degree, strict=True) if degree == 2]
    size = range(1, len(rows) + 1)
    names = {
        "h": [[name] for name in rows],
        "ydot": [[f"{name}_rate"] for name in second],
        "Phi": [[f"Phi_{i}{j}" for j in size] for i in size],
        "Phidot": [[f"Phidot_{i}{j}" for j in size] for i in size],
        "u": [[f"u_{q.name}"] for q in law.system.quasi_velocities],
        "tau": [[q.name] for q in law.system.mechanism.inputs],
    }
    labels: dict[Node, str] = {}
    for quantity, texts in names.items():
        for nodes, row in zip(quantities[quantity], texts, strict=True):
            for node, text in zip(nodes, row, strict=True):
                if node.operation not in ("leaf", "constant"):
                    labels.setdefault(node, text)
    return labels


def constants_of(roots: Sequence[Node], labels: dict[Node, str]) -> dict[Node, str]:
    """The fixed nodes that a step uses directly, with the names of their fields."""
    fixed = fixed_nodes(roots)
    used: dict[Node, None] = {}
    for node in [n for n in fixed if not fixed[n]]:
        used.update((argument, None) for argument in node.arguments if fixed[argument])
    used.update((root, None) for root in roots if fixed[root])
    kept = sorted((node for node in used if node.operation != "constant"), key=lambda node: node.order)
    names: dict[Node, str] = {}
    taken = set(OWN_FIELDS)
    for node in (node for node in kept if node.operation == "leaf"):
        names[node] = free_name(in_c(node.name) if node.name not in taken else f"{node.group}_{node.name}", taken)
    numbers = (f"k{number}" for number in count(1))
    for node in (node for node in kept if node.operation != "leaf"):
        named = node in labels and labels[node] not in taken
        names[node] = free_name(in_c(labels[node]) if named else next(name for name in numbers if name not in taken), taken)
    return {node: names[node] for node in kept}


OWN_FIELDS = ("limit", "held", "on_error", "on_limit", "ready")  # of every law's struct
