"""A law as a program: one graph for all its entry points, split into what init computes and what a step
computes."""

from collections.abc import Container, Sequence
from dataclasses import dataclass, replace
from itertools import count

import casadi as ca

from ..model.algebra.expression import free_symbols
from ..model.law import ControlLaw
from ..model.linearization import SINGULAR, SINGULAR_SQUARED, Linearization
from ..model.mechanism import Quantity
from ..model.names import in_c
from ..model.outputs import FOOT
from .costs import cycles
from .derivation.foot import at_foot_of, has_foot_form, place_names, plain_at_foot, staged_at_foot
from .derivation.grip import plain_ground, staged_ground
from .derivation.stages import Result, Stages, inner_velocities, staged
from .graph import (
    ARITHMETIC,
    SINCOS,
    Applied,
    Constant,
    Graph,
    Group,
    Leaf,
    Node,
    Operation,
    angles,
    executed,
    free_name,
    from_casadi,
    is_operation,
    reachable,
)
from .optimize import Optimizer

Matrix = list[list[Node]]


@dataclass(frozen=True)
class Entry:
    """A C function of a law or of the dynamics: its arguments besides `self` and the state, and the
    quantities it returns.

    A function that is not `public` does not check its arguments; it is called by the step after its checks.
    """

    name: str
    about: str
    answers: tuple[Result, ...]
    takes: Group | None = None  # REFERENCE, VIRTUAL_INPUT or INPUT
    whole: bool = False  # returns all in one struct
    public: bool = True
    at_foot: bool = False  # takes FOOT in place of the vehicle's position and heading
    slope: "Entry | None" = None  # of a step: the entry used to reduce the acceleration
    near: bool = False  # of a damped law, within its band

    @property
    def inverts(self) -> bool:
        """Whether it uses the inverse of Phi."""
        return not INVERTING.isdisjoint(self.answers)

    @property
    def within(self) -> "Entry":
        """The entry that takes its place within the band of a damped law."""
        return replace(
            self,
            name=f"{self.name}_near",
            about=f"{self.about}, within the band",
            public=False,
            slope=None,
            near=True,
        )


INVERTING = {
    Result.ACCELERATION,
    Result.INPUTS,
    Result.COMMAND,
    Result.INPUTS_OF_V,
    Result.COMMAND_OF_V,
    Result.SLOPE,
}
SLOPE = Entry(
    "slope",
    "Derivative of the inputs by the virtual input of the speed, the output of degree 1",
    (Result.SLOPE,),
    public=False,
)
FOLLOW_SLOPE = Entry(
    "follow_slope",
    "As slope, for a position relative to the foot of P_l",
    (Result.SLOPE,),
    public=False,
    at_foot=True,
)
GROUND = Entry(
    "ground",
    "Of each contact: the ground's force along and across, the shift of the load by each metre of height, "
    "the mass on it",
    (Result.GROUND,),
    Group.INPUT,
)
GROUND_BY_INPUTS = Entry(
    "ground_by_inputs", "Derivatives of the first three of ground by each input", (Result.GROUND_BY_INPUTS,)
)
NULL_INPUTS = Entry(
    "null_inputs",
    "Rows of inputs that do not change the motion, which span all of these: 1 - (S'E)^+ S'E, transposed (12)",
    (Result.NULL_INPUTS,),
    public=False,
)
WHEELS = Entry(
    "wheels",
    "Of each driven wheel: the force of the inputs at its rim, its inertia over its squared radius, its "
    "radius",
    (Result.WHEELS,),
    Group.INPUT,
    public=False,
)
EVALUATE = Entry(
    "evaluate",
    "All quantities, with one sine and cosine",
    (
        *(Result.OUTPUTS, Result.RATES, Result.DECOUPLING, Result.DECOUPLING_RATE),
        *(Result.ACCELERATION, Result.INPUTS, Result.COMMAND, Result.EXTENSION_RATE),
    ),
    Group.REFERENCE,
    whole=True,
)
STEP = Entry(
    "step",
    "The controller: outer loop and feedback (12) with (20), limits, safe outputs",
    (Result.EXTENSION_RATE, Result.INPUTS, Result.COMMAND),
    Group.REFERENCE,
    slope=SLOPE,
)
FOLLOW = Entry(
    "follow",
    "The step for a path given by the position relative to the foot of P_l",
    (Result.INPUTS, Result.COMMAND),
    Group.REFERENCE,
    at_foot=True,
    slope=FOLLOW_SLOPE,
)
ENTRIES = (
    Entry("output", "Outputs y = h (14)", (Result.OUTPUTS,)),
    Entry("rate", "First derivatives of the outputs of relative degree 2", (Result.RATES,)),
    Entry("decoupling", "Decoupling matrix Phi (15)", (Result.DECOUPLING,)),
    Entry("decoupling_rate", "Derivative dPhi/dt along the motion", (Result.DECOUPLING_RATE,)),
    Entry(
        "feedback",
        "Linearizing feedback (12) with (20): from the virtual input v to the inputs",
        (Result.INPUTS_OF_V, Result.COMMAND_OF_V),
        Group.VIRTUAL_INPUT,
    ),
    GROUND,
    GROUND_BY_INPUTS,
    NULL_INPUTS,
    WHEELS,
    EVALUATE,
    STEP,
    SLOPE,
    FOLLOW,
    FOLLOW_SLOPE,
)


@dataclass(frozen=True, eq=False)
class EntryBody:
    """What one entry point computes: its quantities as nodes; singular where not first > second of a pair of
    `singular`: that of Phi, then that of S'E if it changes.

    `singular` is empty where nothing is inverted, or where the inversion itself tells. Where `margin`, which
    init computes, is positive, the first exceeds the second of the first pair at all angles. A damped law is
    outside its band where first > second of `band`.
    """

    quantities: dict[Result, Matrix]
    singular: tuple[Node, ...]
    margin: Node | None = None
    # Products that these leave together; before they ran, those that they may
    kept: frozenset[Node] = frozenset()
    band: tuple[Node, ...] = ()

    @property
    def roots(self) -> list[Node]:
        """Every node that must be computed, guards included."""
        margin = [] if self.margin is None else [self.margin]
        return [
            *self.band,
            *self.singular,
            *margin,
            *(node for matrix in self.quantities.values() for row in matrix for node in row),
        ]


@dataclass(frozen=True, eq=False)
class Program:
    """A law's entry points, the constants init makes for them, and names for the nodes that have one."""

    law: ControlLaw
    entries: dict[Entry, EntryBody]
    constants: dict[Node, str]  # node -> field of the law's struct, in the order init makes them
    labels: dict[Node, str]
    conditions: list[Node]  # functions of the configuration that must be positive
    regular: list[Node]  # functions of the parameters that must be positive, or Phi is singular everywhere
    graph: Graph

    @property
    def groups(self) -> dict[str, Sequence[Quantity]]:
        """The leaves of the graph, by group."""
        return _groups(self.law)

    @property
    def angles(self) -> list[Node]:
        """Arguments of sines and cosines that change from step to step."""
        return angles(executed(self._roots))

    @property
    def fixed_angles(self) -> list[Node]:
        """Arguments of sines and cosines that init takes."""
        return angles(node for node in reachable(self._roots) if node.fixed)

    @property
    def _roots(self) -> list[Node]:
        return [root for body in self.entries.values() for root in body.roots]


def hidden_inputs(body: EntryBody) -> list[Leaf]:
    """Inputs of a step that can be infinite or NaN while every result is finite.

    Sums, products, roots and numerators pass such a value on, also to an angle, which is checked; a
    denominator or a function that is bounded need not. A matrix's inverse leaves the function then.
    """
    shown: set[Node] = set()
    stack = [root for matrix in body.quantities.values() for row in matrix for root in row]
    stack += angles(executed(body.roots))
    while stack:
        node = stack.pop()
        if node not in shown and (not isinstance(node, Applied) or node.operation in ARITHMETIC):
            shown.add(node)
            stack.extend(node.arguments[:1] if is_operation(node, Operation.DIV) else node.arguments)
    return [node for node in reachable(body.roots) if isinstance(node, Leaf) and node not in shown]


def compile_law(law: ControlLaw, optimize: bool = True, stages: bool | None = None) -> Program:
    """Build the graph of every entry point of the law and split off what init computes.

    `stages` says whether to write the law in short steps first, `optimize` whether to run the optimizer's
    passes; without both, the expressions are the model's own, as they come out of CasADi.
    """
    graph = Graph()
    source = in_steps(law) if (optimize if stages is None else stages) else plain(law)
    groups = _groups(law)
    nodes = {
        q.symbol.element_hash(): graph.leaf(group, q.name)
        for group, members in groups.items()
        for q in members
    }
    where = f"{law.system.mechanism.name} {law.name}"
    labels: dict[Node, str] = {}
    kept: set[Node] = set()
    totals: set[Node] = set()

    def build(expression: ca.SX) -> Matrix:
        free = free_symbols(ca.SX(expression))
        return from_casadi(graph, expression, free, [nodes[symbol.element_hash()] for symbol in free], where)

    for step in source.steps:
        made = build(step.expression)
        made = made if step.least is None else graph.inverse(made, step.least)
        for one, node in zip(
            ca.vertsplit(ca.vec(step.symbol.T)), (node for row in made for node in row), strict=True
        ):
            nodes[one.element_hash()] = node
            if step.kept:
                kept.add(node)
            if step.total:
                totals.add(node)
            if step.label:
                labels.setdefault(node, step.label)
    quantities, at_foot, near, near_at_foot = (
        {name: build(expression) for name, expression in made.items()}
        for made in (source.quantities, source.at_foot, source.near, source.near_at_foot)
    )
    labels = _own_names(law, quantities) | labels
    entries: dict[Entry, EntryBody] = {}
    for entry in (*ENTRIES, *(one.within for one in ENTRIES if near and one.inverts)):
        if (law.extension or law.kinematic) and entry in (GROUND, GROUND_BY_INPUTS, NULL_INPUTS, WHEELS):
            continue  # a step with an extension or without inputs does not keep grip
        given = at_foot if entry.at_foot else quantities
        given = given | (near_at_foot if entry.at_foot else near) if entry.near and given else given
        chosen = {name: given[name] for name in entry.answers if given.get(name)}
        singular = tuple(row[0] for row in given[Result.SINGULAR]) if chosen and entry.inverts else ()
        body = EntryBody(chosen, singular, kept=frozenset(kept))
        if chosen and not (
            entry.at_foot and (_reads(body, place_names(law)) or _grip_reads(law, place_names(law)))
        ):
            entries[entry] = _optimized(graph, body, labels, totals) if optimize else body
            if near and entry.inverts and not entry.near:
                entries[entry] = replace(
                    entries[entry], band=_band(graph, given[Result.BAND], labels, optimize)
                )
    entries = dict(sorted(entries.items(), key=lambda each: not each[0].near))  # the others call them
    conditions = [row[0] for row in quantities[Result.CONDITIONS]]
    regular = [row[0] for made in (quantities, at_foot) for row in made.get(Result.REGULAR, ())]
    constants = constants_of([root for body in entries.values() for root in body.roots], labels)
    return Program(law, entries, constants, labels, conditions, list(dict.fromkeys(regular)), graph)


def _groups(law: ControlLaw) -> dict[str, Sequence[Quantity]]:
    """The leaves of the graph, by group."""
    groups = law.groups | {Group.STATE: law.system.state, Group.EXTENSION: law.extension}
    return {**groups, Group.FOOT: FOOT, Group.INPUT: law.system.mechanism.inputs}


def in_steps(law: ControlLaw) -> Stages:
    """The law's quantities in short steps; those at the foot too,
    where they need nothing else of place and heading."""
    found = staged(law)
    if not (law.extension or law.kinematic):  # a step with an extension or without inputs does not keep grip
        floor = staged_ground(inner_velocities(law.system)[0])
        found.steps += floor.steps
        found.quantities |= floor.quantities
    if has_foot_form(law):
        foot = staged_at_foot(law)
        # The velocities
        shared = {step.symbol.element_hash() for step in found.steps if step.symbol.is_symbolic()}
        found.steps += [step for step in foot.steps if step.symbol.element_hash() not in shared]
        found.at_foot, found.near_at_foot = foot.quantities, foot.near
    return found


def plain(law: ControlLaw) -> Stages:
    """The law's quantities as the model has them, in one step."""
    found = law.linearization
    given, of_v = (
        (Result.COMMAND, Result.COMMAND_OF_V) if law.kinematic else (Result.INPUTS, Result.INPUTS_OF_V)
    )
    quantities = {
        Result.OUTPUTS: found.h,
        Result.RATES: found.rate,
        Result.DECOUPLING: found.Phi,
        Result.DECOUPLING_RATE: found.Phidot,
        Result.ACCELERATION: law.outside.u,
        given: law.outside.tau,
        Result.EXTENSION_RATE: law.extension_rate,
        of_v: law.outside.tau_of_v,
        Result.SINGULAR: ca.vertcat(_singular(found), *_inputs_singular(found)),
        Result.REGULAR: ca.SX(0, 1),
        Result.CONDITIONS: ca.vertcat(*[expression for expression, _ in law.output.conditions]),
        Result.SLOPE: law.slope_of(law.outside.tau_of_v),
        **({} if law.extension or law.kinematic else plain_ground(law.system)),
    }
    near: dict[Result, ca.SX] = {}
    if law.within and found.damping:
        x, (regular, bound) = found.damping.x, found.damping.measure
        quantities[Result.BAND] = ca.vertcat(x**2, 1)
        near = {
            Result.ACCELERATION: law.within.u,
            given: law.within.tau,
            of_v: law.within.tau_of_v,
            Result.SINGULAR: ca.vertcat(regular, SINGULAR * bound, *_inputs_singular(found)),
            Result.SLOPE: law.slope_of(law.within.tau_of_v),
        }

    def moved(made: dict[Result, ca.SX]) -> dict[Result, ca.SX]:
        return {
            name: plain_at_foot(law, made[name]) for name in (*at_foot_of(law), Result.BAND) if name in made
        }

    at_foot, near_at_foot = (moved(quantities), moved(near)) if has_foot_form(law) else ({}, {})
    return Stages([], [], quantities, at_foot, near, near_at_foot)


def _singular(found: Linearization) -> ca.SX:
    """What must be greater than what, for Phi not to be singular; without a root up to 2 x 2."""
    if found.system.dof <= 2:
        return ca.vertcat(found.determinant**2, SINGULAR_SQUARED * found.scale_squared)
    one, condition = found.measure
    return ca.vertcat(one, SINGULAR * condition)


def _inputs_singular(found: Linearization) -> list[ca.SX]:
    """The same for the inputs to reach every motion; empty where that does not change."""
    return [part for regular, bound in found.measures[1:] for part in (regular, SINGULAR * bound)]


def _band(graph: Graph, band: Matrix, labels: dict[Node, str], optimize: bool) -> tuple[Node, ...]:
    """The test of the band of a damped law, optimized by itself: outside it,
    the law is computed as without a band."""
    nodes = [node for row in band for node in row]
    return tuple(Optimizer(graph, labels).run(nodes) if optimize else nodes)


def _optimized(graph: Graph, body: EntryBody, labels: dict[Node, str], totals: Container[Node]) -> EntryBody:
    """The body after the optimizer's passes, with products kept or not, whichever costs less; names follow
    the nodes of their value. `totals`: sums that stay as they are."""
    keeps = list(dict.fromkeys((body.kept.intersection(reachable(body.roots)), frozenset[Node]())))
    tried = [(named := dict(labels), Optimizer(graph, named, kept, totals).run(body.roots)) for kept in keeps]
    costs = [cycles(roots) for _, roots in tried]
    chosen = costs.index(min(costs))
    named, roots = tried[chosen]
    labels.update(named)
    improved = iter(roots)
    singular = tuple(next(improved) for _ in body.singular)
    quantities = {
        name: [[next(improved) for _ in row] for row in matrix] for name, matrix in body.quantities.items()
    }
    margin = _margin(graph, *singular[:2]) if singular else None
    if margin is not None:
        labels.setdefault(margin, MARGIN)
    return EntryBody(quantities, singular, margin, keeps[chosen])


def _margin(graph: Graph, one: Node, other: Node) -> Node | None:
    """A node that init computes; if it is positive, `one` exceeds `other` at all angles. None if there is
    none.

    Twice the bound, since both are rounded.
    """
    bound = _at_most(graph, other) if one.fixed and not other.fixed else None
    return (
        None
        if bound is None
        else graph.apply(Operation.SUB, one, graph.apply(Operation.MUL, graph.constant(2), bound))
    )


def _at_most(graph: Graph, node: Node) -> Node | None:
    """A bound of the absolute value that init computes: no sine exceeds 1. None if there is none."""
    if node.fixed:
        return (
            graph.constant(abs(node.value))
            if isinstance(node, Constant)
            else graph.apply(Operation.ABS, node)
        )
    if is_operation(node, *SINCOS):
        return graph.constant(1)
    if not is_operation(node, *BOUNDED_BY):
        return None
    bounds = [bound for argument in node.arguments if (bound := _at_most(graph, argument)) is not None]
    return graph.apply(BOUNDED_BY[node.operation], *bounds) if len(bounds) == len(node.arguments) else None


def _reads(body: EntryBody, names: frozenset[str]) -> bool:
    """Is one of these coordinates read? A sine of more than the heading, which FOOT does not have,
    keeps it."""
    return any(
        isinstance(node, Leaf) and node.group is Group.STATE and node.name in names
        for node in reachable(body.roots)
    )


def _grip_reads(law: ControlLaw, names: frozenset[str]) -> bool:
    """Do the ground's forces, in steps, depend on one of these coordinates? A kinematic law does not use
    them."""
    if law.kinematic:
        return False
    floor = staged_ground(inner_velocities(law.system)[0])
    expressions = [*(step.expression for step in floor.steps), *floor.quantities.values()]
    return any(
        ca.depends_on(each, q.symbol)
        for each in expressions
        for q in law.groups[Group.STATE]
        if q.name in names
    )


def _own_names(law: ControlLaw, quantities: dict[Result, Matrix]) -> dict[Node, str]:
    """The field's own names for what a law answers."""
    rows = [row.name for row in law.output.rows]
    size = range(1, len(law.linearization.row_names) + 1)
    names = {
        Result.OUTPUTS: [[name] for name in rows],
        Result.RATES: [[q.name] for q in law.rates],
        Result.DECOUPLING: [[f"Phi_{i}{j}" for j in size] for i in size],
        Result.DECOUPLING_RATE: [[f"Phidot_{i}{j}" for j in size] for i in size],
        Result.ACCELERATION: [[f"u_{q.name}"] for q in law.system.quasi_velocities],
        Result.COMMAND if law.kinematic else Result.INPUTS: [[q.name] for q in law.inputs],
        Result.EXTENSION_RATE: [[f"{q.name}_rate"] for q in law.extension],
    }
    labels: dict[Node, str] = {}
    for quantity, texts in (
        (quantity, texts) for quantity, texts in names.items() if quantities.get(quantity)
    ):
        for nodes, row in zip(quantities[quantity], texts, strict=True):
            for node, text in zip(nodes, row, strict=True):
                if node.arguments:
                    labels.setdefault(node, text)
    return labels


def constants_of(roots: Sequence[Node], labels: dict[Node, str]) -> dict[Node, str]:
    """The fixed nodes that a step uses directly, with the names of their fields."""
    used: dict[Node, None] = {}
    for node in executed(roots):
        used.update((argument, None) for argument in node.arguments if argument.fixed)
    used.update((root, None) for root in roots if root.fixed)
    kept = sorted((node for node in used if not isinstance(node, Constant)), key=lambda node: node.order)
    names: dict[Node, str] = {}
    taken = set(OWN_FIELDS)
    for node in (node for node in kept if isinstance(node, Leaf)):
        names[node] = free_name(
            in_c(node.name) if node.name not in taken else f"{node.group}_{node.name}", taken
        )
    numbers = (f"k{number}" for number in count(1))
    for node in (node for node in kept if node.arguments):
        named = node in labels and labels[node] not in taken
        names[node] = free_name(
            in_c(labels[node]) if named else next(name for name in numbers if name not in taken), taken
        )
    return {node: names[node] for node in kept}


MARGIN = "regular_margin"  # name of the node that says that Phi is regular at all angles
BOUNDED_BY = {Operation.MUL: Operation.MUL, Operation.ADD: Operation.ADD, Operation.SUB: Operation.ADD}
OWN_FIELDS = (
    "limit",
    "held",
    "clear",
    "extension",
    "extension_rate",
    "on_error",
    "on_limit",
    "grip",
    "ready",
)  # of every law's struct
