"""C of a law's step for many states at once, written so that compilers compute several of them in one vector
instruction.

Each lane is computed by the statements of the step, which has no branches but those that leave it: here a
mask keeps whether the step is ordinary. If it is not, the step itself computes the lane again, which gives
its status and its bits. Sines and cosines of the state are computed in a loop of their own: a processor
overlaps more lanes of two short loops than of one long one.
"""

import re
from collections.abc import Iterable, Mapping
from typing import Any

from ...model.mechanism import Quantity
from ...model.names import in_c
from ..graph import Group, Leaf, Node, Operation, headers, is_operation
from ..program import STEP
from .law_c import LawC
from .layout import body, c_linkage, comment, fill, guard_name, version_check
from .statements import Printed, Statements

FOLDER = "lanes"  # of the files, in that of the law
ARRAYS = (Group.STATE, Group.REFERENCE)


class LanesC(LawC):
    """The C of a law's step over lanes in one scalar; its law is that of LawC."""

    @property
    def possible(self) -> bool:
        """Whether the law has a step of its arguments alone, which one with a dynamic extension has not."""
        return STEP in self.program.entries and not self.extends

    def files(self) -> dict[str, str]:
        """File name, in the folder of the law's files -> text."""
        name = self.function("steps")
        return (
            {f"{FOLDER}/{name}.h": self.header(), f"{FOLDER}/{name}.c": self.source()}
            if self.possible
            else {}
        )

    def header(self) -> str:
        """Return the header."""
        file_name = f"{self.function('steps')}.h"
        guard = guard_name(file_name)
        lines = [
            self._head(file_name),
            f"#ifndef {guard}",
            f"#define {guard}",
            "",
            f'#include "{self.type}.h"',
            "",
        ]
        return "\n".join(
            [*lines, *version_check(file_name), "", *c_linkage(self.declarations()), "", "#endif", ""]
        )

    def declarations(self) -> str:
        """Return the prototype."""
        about = [
            "The step of n lanes at once. Row k of an array of m rows is its entries k n to k n + n - 1, one "
            "for each lane:",
            *(
                f"{group}[{len(self.program.groups[group])}][n]: the members of {kind}"
                for group, kind in self._structs.items()
            ),
            f"tau[{self.inputs}][n]: before the call the inputs of the lane's last step, for NOSLIP_HOLD; "
            "after it, of this one",
            "status[n]: of the step of each lane",
            "Each lane has the bits and the status that the step has. The arrays must not overlap; `self` is "
            "not changed.",
            "Returns the least status of all lanes, or NOSLIP_NULL without an array.",
        ]
        return comment(about) + "\n" + "\n".join(fill(f"int {self._signature()};", ""))

    def source(self) -> str:
        """Return the source."""
        roots = self.program.entries[STEP].roots
        files = ["noslip_lanes", self.function("steps"), *headers(roots)]
        parts = [self._head(f"{self.function('steps')}.c", files), self._lane(), self._steps()]
        return "\n\n".join(parts) + "\n"

    def _signature(self) -> str:
        real = self.scalar.real
        arrays = [*(f"const {real} *{group}" for group in ARRAYS), f"{real} *tau", "int *status"]
        return f"{self.function('steps')}({', '.join([f'const {self.type} *self', 'size_t n', *arrays])})"

    def argument(self, group: Group, name: str) -> str:
        """Return the C name of an input of a lane."""
        return f"{group}_{in_c(name)}"

    def step_given(self, node: Node) -> str | None:
        """Return the C of a node that a lane need not compute; None if it must."""
        if isinstance(node, Leaf) and node.group in ARRAYS:
            return self.argument(node.group, node.name)
        return super().step_given(node)

    def leave(self, condition: str, answer: str = "NOSLIP_SINGULAR") -> str:
        """Return a statement that leaves the function on a condition,
        or one that keeps for a lane that its step would leave."""
        if answer not in ("NOSLIP_SINGULAR", "NOSLIP_RANGE", self._near(STEP)):
            return super().leave(condition, answer)
        return masked(condition)

    def _ordinary(self) -> tuple[list[str], list[str]]:
        """Return the entries whose sines and cosines a lane needs, and its statements: the inputs, if its
        step is ordinary, and whether it is.
        """
        real, held = self.scalar.real, range(self.inputs)
        read = {
            self.argument(group, q.name): _entry(group, k) for group in ARRAYS for k, q in self._rows(group)
        }
        taken = {
            *read,
            *ARRAYS,
            *"self n tau status first count i lane fine all made least inputs ordinary sine cosine".split(),
        }
        writer = _Lanes(read, self.scalar, self.step_given, self.program.labels, self.leave, taken)
        self.write(writer, STEP, [(node, place.replace("tau", "made")) for node, place in self.places(STEP)])
        before, after = (
            [self.leave(f"!({condition})") for condition in conditions] for conditions in self.ordinary(STEP)
        )
        statements = [*before, *writer.lines, *after]
        used = set(re.findall(r"\w+", " ".join(statements)))
        return writer.angles, [
            "const size_t lane = first + i;",
            f"{real} made[{self.inputs}];",
            "int fine = 1;",
            *(f"const {real} {name} = {entry};" for name, entry in read.items() if name in used),
            *statements,
            *(f"inputs[{k}][i] = fine ? made[{k}] : {_entry('tau', k)};" for k in held),
            "ordinary[i] = fine;",
            "all &= fine;",
        ]

    def _lane(self) -> str:
        """Return the function that computes a lane by the step."""
        real, held = self.scalar.real, range(self.inputs)
        lines = [f"{self.type} law;", *(f"{kind} {group}_of_lane;" for group, kind in self._structs.items())]
        lines += [f"{real} made[{self.inputs}];", "int status;", "noslip_copy(&law, self, sizeof law);"]
        for group in ARRAYS:
            lines += [f"{group}_of_lane.{q.in_c} = {_entry(group, k)};" for k, q in self._rows(group)]
        lines += [f"law.held[{k}] = {_entry('tau', k)};" for k in held]
        lines.append(
            f"status = {self.function('step')}(&law, {', '.join(f'&{group}_of_lane' for group in ARRAYS)}, "
            "made);"
        )
        lines += [f"{_entry('tau', k)} = made[{k}];" for k in held]
        given = [
            f"const {self.type} *self",
            "size_t n",
            "size_t lane",
            *(f"const {real} *{group}" for group in ARRAYS),
        ]
        head = f"static NOSLIP_COLD int {self.function('steps')}_lane({', '.join([*given, f'{real} *tau'])})"
        return "\n".join(
            ["/* The step of one lane. */", *fill(head, ""), "{", body([*lines, "return status;"]), "}"]
        )

    @property
    def _structs(self) -> dict[Group, str]:
        """Array -> the struct of which a lane's entries are the members."""
        return {Group.STATE: self.state_type, Group.REFERENCE: self.scalar.name(f"{self.prefix}_reference")}

    def _rows(self, group: Group) -> Iterable[tuple[int, Quantity]]:
        return enumerate(self.program.groups[group])

    def _steps(self) -> str:
        none = " || ".join(f"{name} == NULL" for name in ("self", *ARRAYS, "tau", "status"))
        one = f"{self.function('steps')}_lane(self, n, first + i, {', '.join([*ARRAYS, 'tau'])})"
        real, (angles, ordinary) = self.scalar.real, self._ordinary()
        turned = [f"{real} {name}[{len(angles)}][NOSLIP_LANES];" for name in ("sine", "cosine") if angles]
        call = self.scalar.name("noslip_sincos")
        calls = [f"{call}({angle}, &sine[{k}][i], &cosine[{k}][i]);" for k, angle in enumerate(angles)]
        loops = [
            "const size_t count = n - first < NOSLIP_LANES ? n - first : NOSLIP_LANES;",
            f"{real} inputs[{self.inputs}][NOSLIP_LANES];",
            *turned,
            "int ordinary[NOSLIP_LANES], all = 1;",
            *(
                f"for (i = 0; i < count; i++) {{\n    const size_t lane = first + i;\n    {call}\n}}"
                for call in calls
            ),
            "for (i = 0; i < count; i++) {",
            body(ordinary),
            "}",
            *(
                f"for (i = 0; i < count; i++) {{\n    tau[{k} * n + first + i] = inputs[{k}][i];\n}}"
                for k in range(self.inputs)
            ),
            "for (i = 0; i < count; i++) {\n    status[first + i] = NOSLIP_OK;\n}",
            "for (i = 0; i < count && !all; i++) {",
            "    if (!ordinary[i]) {",
            f"        const int one = {one};",
            "        status[first + i] = one;",
            "        least = one < least ? one : least;",
            "    }",
            "}",
        ]
        lines = ["size_t first, i;", "int least = NOSLIP_OK;", self.leave(none, "NOSLIP_NULL")]
        lines += ["for (first = 0; first < n; first += NOSLIP_LANES) {", body(loops), "}", "return least;"]
        return "\n".join([*fill(f"int {self._signature()}", ""), "{", body(lines), "}"])


class _Lanes(Statements):
    """The statements of a lane, with roots that compilers can compute in vectors, and sines and cosines
    computed before.

    `entries`: name of an input of the lane -> its entry; `angles`: the entries whose sine and cosine the
    statements use, in the order of the arrays.
    """

    def __init__(self, entries: Mapping[str, str], *arguments: Any):
        super().__init__(*arguments)
        self.entries = entries
        self.angles: list[str] = []

    def not_singular(self, measure: Node, bound: Node, margin: Node | None = None) -> None:
        """Keep whether `measure` is greater than `bound`; a mask is no cheaper if it is known."""
        super().not_singular(measure, bound)

    def turned(self, angle: str, sine: str, cosine: str) -> list[str]:
        """Return the statements that give the sine and the cosine of an angle these names."""
        if angle not in self.entries:
            return super().turned(angle, sine, cosine)
        k = len(self.angles)
        self.angles.append(self.entries[angle])
        return [f"const {self.scalar.real} {sine} = sine[{k}][i], {cosine} = cosine[{k}][i];"]

    def _expression(self, node: Node) -> Printed:
        text, precedence = super()._expression(node)
        if is_operation(node, Operation.SQRT):
            text = text.replace(self.scalar.name("noslip_sqrt"), self.scalar.name("noslip_lane_sqrt"), 1)
        return text, precedence


def masked(condition: str) -> str:
    """Return the statement that clears `fine` where a condition, a negation, holds."""
    holds = condition.removeprefix("!")
    return f"fine &= {holds[1:-1] if holds.startswith('(') else holds};"


def _entry(array: str, row: int) -> str:
    """Return the C of a lane's entry of an array."""
    return f"{array}[{row} * n + lane]"
