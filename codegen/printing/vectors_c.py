"""C of a robot and of its law for the vectors of the batch simulator: each vector has the same number of
several robots.

The statements are those of the C in double. `lanes` is the type of a vector, `LANES(x)` has x in all lanes,
and functions have the suffix _lanes: sweeping/lanes.inc defines them. A test that would leave a function
clears a lane of the mask `fine` instead. The simulator computes such lanes one by one, in double, which gives
their status and their bits.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..dynamics import DynamicsProgram
from ..graph import FUNCTIONS, Group, Leaf, MatrixInverse, Node, angles, executed, is_operation
from ..program import STEP, Entry, Program
from .dynamics_c import DynamicsC
from .lanes_c import masked
from .law_c import LawC
from .layout import body, fill
from .program_c import ProgramC
from .scalar import DOUBLE, Scalar
from .statements import Statements

ARRAYS = {Group.STATE: "state", Group.REFERENCE: "reference", Group.INPUT: "tau"}


class _Vector(Scalar):
    """A vector of doubles."""

    def literal(self, value: float) -> str:
        """Return a vector with the number in all lanes."""
        return f"LANES({DOUBLE.literal(value)})"


VECTOR = _Vector("lanes", "_lanes")


@dataclass(frozen=True)
class VectorText:
    """The C of a robot's dynamics or law in vectors: its functions; the statements that copy the constants of
    `one` into the array `constants`, number k to [k * width]; the number of constants; entries of the state
    that are read, and those with a sine and cosine.
    """

    functions: str
    puts: str
    count: int
    reads: list[int]
    turns: list[int]


def dynamics_vectors(program: DynamicsProgram) -> VectorText | None:
    """The rates of the state, `lanes_acceleration`; None if vectors cannot compute them."""
    text = _DynamicsText(program, VECTOR, [])
    if any(program.entries[entry].looped for entry in text.named("acceleration")):
        return None
    return _text(text, ["acceleration"])


def law_vectors(program: Program, steps: bool, grounded: bool) -> VectorText | None:
    """det Phi and the outputs, `lanes_decoupling` and `lanes_output`; where it `steps`, also the inputs,
    `lanes_step`, and if `grounded` the forces on the ground, `lanes_ground`. None if vectors cannot compute
    them.
    """
    text, more = _LawText(program, VECTOR, []), ["step", *(["ground"] if grounded else [])]
    return None if text.extends else _text(text, ["decoupling", "output", *(more if steps else [])])


def turns_function(turns: Sequence[int]) -> str:
    """The function that computes the sines and cosines of entries of the state."""
    lines = ["lanes_mask fine = LANES_ALL;"]
    for k in turns:
        lines += [
            f"fine &= noslip_angle_ok_lanes(state[{k}]);",
            f"noslip_sincos_lanes(state[{k}], &sine[{k}], &cosine[{k}]);",
        ]
    unused = [] if turns else [f"(void){name};" for name in ("state", "sine", "cosine")]
    return _function("turns", ["const lanes *state", "lanes *sine", "lanes *cosine"], [*unused, *lines])


class _Text(ProgramC[Any]):
    """What the C of dynamics and laws in vectors has in common."""

    def step_given(self, node: Node) -> str | None:
        """Return the C of a node that need not be computed; None if it must."""
        if node in self.program.constants:
            return f"self[{list(self.program.constants).index(node)}]"
        if isinstance(node, Leaf) and node.group in ARRAYS:
            return self.argument(node.group, node.name)
        return None

    def argument(self, group: Group, name: str) -> str:
        """Return the C of an entry of an argument."""
        return f"{ARRAYS[group]}[{[q.name for q in self.program.groups[group]].index(name)}]"

    def leave(self, condition: str, answer: str = "NOSLIP_SINGULAR") -> str:
        """Return a statement that clears the lanes for which a function would be left."""
        return masked(condition)

    def named(self, *names: str) -> list[Entry]:
        """Return the entry points with these names."""
        return [entry for entry in self.entries if entry.name in names]

    def function_of(self, entry: Entry) -> str:
        """Return the function of an entry point."""
        places, arguments = self.places(entry), list(self.parameters(entry))
        made = [quantity.in_c for quantity in self.returned(entry)]
        read = [name for name in arguments if name not in made]
        writer = _Statements(
            VECTOR, self.step_given, self.program.labels, self.leave, {*arguments, *RESERVED}
        )
        self.statements(writer, entry, places)
        lines = ["lanes_mask fine = LANES_ALL;", *writer.lines]
        read += ["sine", "cosine"]
        unused = [f"(void){name};" for name in read if not any(f"{name}[" in line for line in lines)]
        declared = [f"const lanes *{name}" for name in read]
        declared += [
            f"lanes {quantity.in_c}{self.shape(entry, quantity)}" for quantity in self.returned(entry)
        ]
        return _function(entry.name, declared, [*unused, *lines])

    def statements(self, writer: Statements, entry: Entry, places: Sequence[tuple[Node, str]]) -> None:
        """Write the statements of an entry point."""
        raise NotImplementedError


RESERVED = {"self", "state", "sine", "cosine", "fine", "lanes"}


class _DynamicsText(_Text, DynamicsC):
    """The dynamics in vectors."""

    def statements(self, writer: Statements, entry: Entry, places: Sequence[tuple[Node, str]]) -> None:
        """Write the statements of an entry point."""
        self.write(writer, entry, places)


class _LawText(_Text, LawC):
    """A law in vectors."""

    def statements(self, writer: Statements, entry: Entry, places: Sequence[tuple[Node, str]]) -> None:
        """Write the statements of an entry point; a step is fine if it is ordinary."""
        before, after = self.ordinary(entry) if entry == STEP else ([], [])
        writer.lines += [self.leave(f"!({self._in_arrays(condition)})") for condition in before[1:]]
        self.write(writer, entry, places)
        writer.lines += [self.leave(f"!({self._in_arrays(condition)})") for condition in after]

    def _in_arrays(self, condition: str) -> str:
        """Return a condition of the inputs with their limits, which follow the constants."""
        # Beyond `clear` nothing but the friction of the floor is left to check
        limit = r"self->(?:clear|limit)\[(\d+)\]"
        return re.sub(limit, lambda k: f"self[{len(self.program.constants) + int(k[1])}]", condition).replace(
            "made[", "tau["
        )


class _Statements(Statements):
    """Statements in vectors; sines and cosines of entries of the state are computed before."""

    def not_singular(self, measure: Node, bound: Node, margin: Node | None = None) -> None:
        """Clear the lanes in which `measure` is not greater than `bound`;
        a test of the margin is no cheaper."""
        super().not_singular(measure, bound)

    def turned(self, angle: str, sine: str, cosine: str) -> list[str]:
        """Return the statements that give the sine and the cosine of an angle these names."""
        if not angle.startswith("state["):
            return super().turned(angle, sine, cosine)
        return [
            f"const lanes {sine} = {angle.replace('state', 'sine')}, {cosine} = "
            f"{angle.replace('state', 'cosine')};"
        ]


def _text(text: _Text, wanted: list[str]) -> VectorText | None:
    """The text of the entry points with these names; None if one is missing, or has operations that vectors
    have not: those of noslip_functions.h and noslip_solve.h.
    """
    entries = text.named(*wanted)
    names = [q.name for q in text.program.groups[Group.STATE]]
    nodes = executed([root for entry in entries for root in text.program.entries[entry].roots])
    if len(entries) < len(wanted) or any(
        is_operation(node, *FUNCTIONS) or isinstance(node, MatrixInverse) for node in nodes
    ):
        return None
    state = [node for node in nodes if isinstance(node, Leaf) and node.group is Group.STATE]
    puts = [
        f"constants[{k} * width] = one->{field};" for k, field in enumerate(text.program.constants.values())
    ]
    if isinstance(text, _LawText):
        puts += [f"constants[{len(puts) + k} * width] = one->limit[{k}];" for k in range(text.inputs)]
    turns = [angle for angle in angles(nodes) if isinstance(angle, Leaf)]
    places = [
        sorted(names.index(node.name) for node in some if isinstance(node, Leaf)) for some in (state, turns)
    ]
    functions = [text.function_of(entry) for entry in entries]
    return VectorText("\n\n".join(functions), "\n".join(puts), len(puts), *places)


def _function(name: str, arguments: Sequence[str], lines: Sequence[str]) -> str:
    head = f"static LANES_INLINE lanes_mask lanes_{name}({', '.join(arguments)})"
    return "\n".join([*fill(head, ""), "{", body([*lines, "return fine;"]), "}"])
