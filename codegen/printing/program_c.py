"""Common parts of the C of laws and dynamics: names, the frame of a file, checks, places of results."""

import re
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Generic, TypeVar

from ...model.mechanism import Quantity
from ...model.names import in_c
from ...model.reduction import ReducedSystem
from ..derivation.stages import Result
from ..dynamics import DynamicsProgram
from ..graph import Group, Leaf, Node, count, executed
from ..program import Entry, Program
from .layout import c_linkage, comment, fill, guard_name, version_check
from .meaning import meanings
from .scalar import Scalar

AnyProgram = TypeVar("AnyProgram", bound=Program | DynamicsProgram)


class ProgramC(ABC, Generic[AnyProgram]):
    """The C of a program in one scalar; `title` is the first line of its files,
    `name` follows the robot's name in C."""

    title: str

    local = "made"  # name of the array in which an entry point computes a quantity before it is written

    def __init__(
        self, program: AnyProgram, system: ReducedSystem, name: str, scalar: Scalar, banner: Sequence[str]
    ):
        self.program: AnyProgram = program
        self.system, self.scalar, self.banner = system, scalar, list(banner)
        self.entries = list(program.entries)
        self.robot = system.mechanism.name
        self.inputs = len(system.mechanism.inputs)
        self.prefix = f"{self.robot}_{name}"
        self.type = scalar.name(self.prefix)
        self.state_type = scalar.name(f"{self.robot}_state")
        self.evaluation_type = scalar.name(f"{self.prefix}_evaluation")
        self.meanings = meanings(program)

    def files(self) -> dict[str, str]:
        """File name -> text."""
        return {f"{self.type}.h": self.header(), f"{self.type}.c": self.source()}

    def header(self) -> str:
        """Return the header."""
        file_name = f"{self.type}.h"
        guard = guard_name(file_name)
        lines = [self._head(file_name), f"#ifndef {guard}", f"#define {guard}", ""]
        lines += [f'#include "{self.scalar.name(self.robot)}.h"', "", *version_check(file_name), ""]
        lines += [*c_linkage(self._with_warning(self.declarations())), "", "#endif", ""]
        return "\n".join(lines)

    def _with_warning(self, declarations: str) -> str:
        """Return declarations, which cffi reads too, with the macro that warns where the status of init is
        ignored."""
        init = re.compile(rf"^int {self.function('init')}\([^;]*;", re.MULTILINE)
        return init.sub(
            lambda found: "\n".join(fill(f"NOSLIP_NODISCARD {' '.join(found[0].split())}", "")), declarations
        )

    @abstractmethod
    def declarations(self) -> str:
        """Return types and prototypes, without preprocessor directives."""

    @abstractmethod
    def source(self) -> str:
        """Return the source."""

    @abstractmethod
    def shape(self, entry: Entry, quantity: Result) -> str:
        """Return the C array bounds of a quantity: a column has one, a matrix two (row major)."""

    @abstractmethod
    def parameters(self, entry: Entry, public: bool = False) -> dict[str, str]:
        """Return names and declarations of the arguments of an entry point, or of its static function."""

    @abstractmethod
    def array(self, leaf: Leaf) -> tuple[str, Sequence[Quantity]] | None:
        """Return name and members of the array that contains the leaf; None if it is in a struct."""

    def returned(self, entry: Entry) -> Sequence[Result]:
        """Return the quantities that an entry point returns."""
        return entry.answers

    def place(self, entry: Entry, quantity: Result) -> str:
        """Return the place to which a quantity is written."""
        return f"all->{quantity.in_c}" if entry.whole else quantity.in_c

    def operations(self, entry: Entry) -> dict[str, int]:
        """Return the operations of an entry point without checks and limits,
        and without loops of the runtime."""
        return count(executed(self.program.entries[entry].roots))

    def cost(self, entry: Entry) -> str:
        """Return the operations as a line of a comment."""
        counted = ", ".join(
            f"{number} {operation}" for operation, number in self.operations(entry).items() if number
        )
        return f"Operations: {counted or 'none'}."

    def function(self, name: str) -> str:
        """Return the C name of a function."""
        return self.scalar.name(f"{self.prefix}_{name}")

    def signature(self, entry: Entry) -> str:
        """Return the signature of an entry point."""
        return f"int {self.function(entry.name)}({', '.join(self.parameters(entry, public=True).values())})"

    def places(self, entry: Entry) -> list[tuple[Node, str]]:
        """Return the nodes that an entry point computes, and the places to which they are written."""
        return [
            (
                node,
                self.place(entry, quantity)
                + (f"[{i}][{j}]" if "][" in self.shape(entry, quantity) else f"[{i}]"),
            )
            for quantity, matrix in self.program.entries[entry].quantities.items()
            for i, row in enumerate(matrix)
            for j, node in enumerate(row)
        ]

    def pieces(self, entry: Entry) -> list[tuple[str, str, int]]:
        """Return the result arrays of an entry point, the local one and the caller's,
        with their lengths; matrices by rows."""
        pieces = []
        for quantity in self.returned(entry):
            place = self.place(entry, quantity)
            local = place if entry.whole else self.local.format(quantity)
            first, *second = map(int, self.shape(entry, quantity)[1:-1].split("]["))
            rows = (
                [(f"{local}[{i}]", f"{place}[{i}]", second[0]) for i in range(first)]
                if second
                else [(local, place, first)]
            )
            pieces += rows
        return pieces

    def leave(self, condition: str, answer: str = "NOSLIP_SINGULAR") -> str:
        """Return a statement that leaves the function on a condition."""
        return f"if ({condition}) {{\n    return {answer};\n}}"

    def in_range(self, angle: str) -> str:
        """Return the condition that an angle is in the range of sine and cosine."""
        return f"{self.scalar.name('noslip_angle_ok')}({angle})"

    def step_given(self, node: Node) -> str | None:
        """Return the C of a node that an entry point need not compute; None if it must."""
        if node in self.program.constants:
            return f"self->{self.program.constants[node]}"
        if not isinstance(node, Leaf) or node.group is Group.STEP:
            return None
        array = self.array(node)
        return f"{array[0]}[{[q.name for q in array[1]].index(node.name)}]" if array else init_given(node)

    def _head(
        self, file_name: str, includes: Sequence[str] = (), own: bool = False, quick: bool = False
    ) -> str:
        lines = [comment([f"{file_name} - {self.title}, {self.scalar.real}", *self.banner])]
        lines += ["#define NOSLIP_OWN"] if own else []  # what is NOSLIP_HOT is inlined
        lines += ["#define NOSLIP_QUICK"] if quick else []  # a step is compiled for speed at -Os, too
        return "\n".join([*lines, *(f'#include "{name}.h"' for name in includes)])


def init_given(node: Node) -> str | None:
    """Return a leaf as the member of its struct."""
    return f"{node.group}->{in_c(node.name)}" if isinstance(node, Leaf) else None
