"""C statements for nodes: names, parentheses, order. The C computes exactly the operations of the nodes,
in this order."""

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from itertools import count

from ...model.names import in_c
from ..graph import (
    FUNCTIONS,
    SINCOS,
    Applied,
    Constant,
    Element,
    MatrixInverse,
    Node,
    Operation,
    free_name,
    is_operation,
)
from .layout import commented
from .scalar import Scalar

WIDEST = 100  # characters; longer expressions are divided into named steps
PRECEDENCE = {Operation.ADD: 1, Operation.SUB: 1, Operation.MUL: 2, Operation.DIV: 2, Operation.NEG: 3}
SIGN = {Operation.ADD: "+", Operation.SUB: "-", Operation.MUL: "*", Operation.DIV: "/"}
TERMS, FACTORS = (Operation.ADD, Operation.SUB), (Operation.MUL, Operation.DIV)
ATOM = 4  # the precedence of names, calls and literals
Printed = tuple[str, int]  # text and precedence


class Statements:
    """Writes the C that computes a set of nodes, each at most once; `given` names nodes that need not be
    computed.

    `guard(condition)` is the line that leaves the function if a division or an angle is invalid; None: no
    such checks. `meaning(node)` is the comment of a temporary without a name of its own.
    """

    def __init__(
        self,
        scalar: Scalar,
        given: Callable[[Node], str | None],
        labels: dict[Node, str],
        guard: Callable[[str], str] | None,
        taken: Iterable[str] = (),
        meaning: Callable[[Node], str] | None = None,
    ):
        self.scalar = scalar
        self.given = given
        self.labels = labels
        self.guard = guard
        self.meaning = meaning
        self.lines: list[str] = []
        self.names: dict[Node, str] = {}
        self.uses: Counter[Node] = Counter()
        self.guarded: set[Node] = set()
        self.taken = set(taken)  # names with another meaning in the function
        self.temporaries = (f"t{number}" for number in count(1))

    def plan(self, roots: Iterable[Node]) -> None:
        """Count the uses of each node: nodes used once need no name."""
        stack = list(roots)
        self.uses.update(stack)
        visited: set[Node] = set()
        while stack:
            node = stack.pop()
            if node in visited or self.given(node) is not None:
                continue
            visited.add(node)
            self.uses.update(node.arguments)
            stack.extend(node.arguments)

    def value(self, node: Node) -> str:
        """Return an operand for the node: its name, or its text, in parentheses if needed."""
        return self._operand(node, ATOM)

    def text(self, node: Node) -> str:
        """Return the node as the right-hand side of an assignment."""
        return self._print(node)[0]

    def assign(self, place: str, node: Node) -> None:
        """Assign the node to a place. A node without other uses gets no name."""
        named = node in self.names or self.given(node) is not None or _named_otherwise(node)
        text = self._expression(node)[0] if not named and self.uses[node] <= 1 else self.text(node)
        self.lines.append(f"{place} = {text};")

    def named(self, node: Node) -> str:
        """Return a name or literal for the node; introduce a name if it has none."""
        if node not in self.names and self.given(node) is None and not _named_otherwise(node):
            self._assign(node, self._expression(node)[0])
        return self._print(node)[0]

    def keep(self, constants: Mapping[Node, str]) -> list[str]:
        """Assign nodes to the fields of the struct `self`; return the fields that are computed, as C."""
        for node, field in constants.items():
            self.uses[node] = 1  # it is the field
            self.assign(f"self->{field}", node)
            if node.arguments:
                self.names[node] = f"self->{field}"
        return [f"self->{field}" for node, field in constants.items() if node.arguments]

    def in_range(self, angle: Node, check: Callable[[str], str]) -> None:
        """Leave the function if an angle is out of range; `check` returns the statement for its name."""
        self.lines.append(check(self.named(angle)))

    def not_singular(self, measure: Node, bound: Node, margin: Node | None = None) -> None:
        """Leave the function unless `measure` is greater than `bound`, also for NaN;
        it is if `margin` is positive."""
        if self.guard is None:
            return
        left, right = self._operand(measure, 1), self._operand(bound, 1)
        unknown = "" if margin is None else f"!({self.value(margin)} > 0) && "
        self.lines.append(self.guard(f"{unknown}!({left} > {right})"))
        self.guarded.update(factors(measure))

    def _operand(self, node: Node, binding: int) -> str:
        text, precedence = self._print(node)
        return text if precedence >= binding else f"({text})"

    def _print(self, node: Node) -> Printed:
        name = self.names.get(node) or self.given(node)
        if name is not None:
            return name, ATOM
        match node:
            case Constant(value):
                return self.scalar.literal(value), PRECEDENCE[Operation.NEG] if value < 0 else ATOM
            case Applied(Operation.SIN | Operation.COS, (angle,)):
                self._sincos(angle)
                return self.names[node], ATOM
            case Element(arguments=(MatrixInverse() as whole,)):
                self._inverse(whole)
                return self.names[node], ATOM
        printed = self._expression(node)
        if node in self.labels or self.uses[node] > 1 or len(printed[0]) > WIDEST:
            self._assign(node, printed[0])
            return self.names[node], ATOM
        return printed

    def _expression(self, node: Node) -> Printed:
        assert isinstance(node, Applied), "all other nodes have a name or are literals"
        if is_operation(node, Operation.SQRT, Operation.ABS, *FUNCTIONS):
            call = self.scalar.name(f"noslip_{node.operation}")
            return f"{call}({', '.join(self.text(argument) for argument in node.arguments)})", ATOM
        binding = PRECEDENCE[node.operation]
        if node.operation is Operation.NEG:
            return f"-{self._operand(node.arguments[0], ATOM)}", binding
        first, second = node.arguments
        if node.operation is Operation.DIV:
            self._guard_division(second)
        # a * (b * c) is written as b * c * a, which has the same value
        if (
            node.operation is Operation.MUL
            and is_operation(second, *FACTORS)
            and not is_operation(first, *FACTORS)
        ):
            first, second = second, first
        if (
            node.operation is Operation.ADD
            and is_operation(second, *TERMS)
            and not is_operation(first, *TERMS)
        ):
            first, second = second, first
        return (
            f"{self._operand(first, binding)} {SIGN[node.operation]} {self._operand(second, binding + 1)}",
            binding,
        )

    def _guard_division(self, denominator: Node) -> None:
        if self.guard is None or denominator in self.guarded or isinstance(denominator, Constant):
            return
        self.guarded.update(factors(denominator))
        name = self.named(denominator)
        size = (
            name if is_operation(denominator, Operation.SQRT) else f"{self.scalar.name('noslip_abs')}({name})"
        )
        self.lines.append(self.guard(f"!({size} > 0)"))

    def _sincos(self, angle: Node) -> None:
        name = self.named(angle)
        short = re.sub(r"\W", "_", name.split(">")[-1].lstrip("-"))
        sine, cosine = free_name(f"sin_{short}", self.taken), free_name(f"cos_{short}", self.taken)
        self.lines += self.turned(name, sine, cosine)
        for node in self.uses:
            if is_operation(node, *SINCOS) and node.arguments[0] is angle:
                self.names[node] = sine if node.operation is Operation.SIN else cosine

    def turned(self, angle: str, sine: str, cosine: str) -> list[str]:
        """Return the statements that give the sine and the cosine of an angle these names."""
        call = self.scalar.name("noslip_sincos")
        return [f"{self.scalar.real} {sine}, {cosine};", f"{call}({angle}, &{sine}, &{cosine});"]

    def _inverse(self, whole: MatrixInverse) -> None:
        """Invert a matrix in an array; leave the function if it has no inverse."""
        size = whole.size
        texts = [self.text(entry) for entry in whole.arguments]
        array, order, condition = (free_name(name, self.taken) for name in ("inverse", "order", "rcond"))
        real, call = self.scalar.real, f"{self.scalar.name('noslip_invert')}({array}, {order}, {size})"
        self.lines.append(f"{real} {array}[{len(texts)}];\nint {order}[{size}];")
        self.lines += [f"{array}[{k}] = {text};" for k, text in enumerate(texts)]
        self.lines.append(f"const {real} {condition} = {call};")
        if self.guard is not None:
            self.lines.append(self.guard(f"!({condition} > {self.scalar.literal(whole.least)})"))
        for node in self.uses:
            if isinstance(node, Element) and node.arguments[0] is whole:
                self.names[node] = f"{array}[{node.number}]"

    def _assign(self, node: Node, text: str) -> None:
        label = self.labels.get(node, "")  # of a local variable: a .c file sees the macros of no board
        own = (in_c(label) if label == "I" else label) or next(
            name for name in self.temporaries if name not in self.taken
        )
        self.names[node] = free_name(own, self.taken)
        meaning = self.meaning(node) if self.meaning and node not in self.labels else ""
        self.lines.append(commented(f"const {self.scalar.real} {self.names[node]} = {text};", meaning))


def factors(node: Node) -> list[Node]:
    """Return the node and, for a product, magnitude or root, its factors:
    zero only if the node is zero or underflows."""
    inside = (
        node.arguments
        if is_operation(node, Operation.MUL, Operation.NEG, Operation.ABS, Operation.SQRT)
        else ()
    )
    return [node, *(factor for argument in inside for factor in factors(argument))]


def _named_otherwise(node: Node) -> bool:
    """Whether the node does not get a variable of its own."""
    return isinstance(node, Constant | Element) or is_operation(node, *SINCOS)
