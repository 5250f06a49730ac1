"""The expression graph of a law: scalar nodes, each made once, so that equal subexpressions are one node."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import frexp, isqrt

import casadi as ca

from ..model.algebra.expression import fold
from ..model.algebra.operations import NAMES, USABLE
from ..model.errors import ModelError

COMMUTATIVE = frozenset({"add", "mul"})
CONSTANT_GROUPS = frozenset({"params", "config", "gains"})  # known to init; the others change from step to step
ARITHMETIC = ("mul", "add", "sub", "neg", "div", "sqrt", "abs")
FUNCTIONS = (  # noslip_functions.h has each of them, by the same name; of NaN each makes NaN
    *("exp", "log", "pow", "sinh", "cosh", "tanh", "atan2", "atan", "asin", "acos"),
    *("sign", "min", "max", "less", "not", "if"),
)
MATRIX_INVERSE, ENTRY = "inverse of a matrix", "entry"
# infinite or NaN where an argument is, but for denominators; an inverse leaves the function then
SHOWING = frozenset({*ARITHMETIC, MATRIX_INVERSE, ENTRY, "leaf", "constant"})


@dataclass(frozen=True, eq=False)
class Node:
    """One scalar: a constant (`value`), a leaf (`group` and `name`) or an operation on `arguments`.

    "inverse of a matrix" is no scalar: its arguments are the entries, row by row, and it has a meaning where the matrix's
    reciprocal condition exceeds `value`. Entry number `value` of it is an "entry".
    """

    operation: str
    arguments: tuple["Node", ...] = ()
    value: float = 0.0
    group: str = ""
    name: str = ""
    order: int = 0  # order of creation: an argument always comes before its user

    def __repr__(self) -> str:
        return f"<{self.operation} {self.name or self.value or ''}#{self.order}>"


class Graph:
    """Makes nodes, at most one of a kind; simplifies only where the value stays the same to the last bit."""

    def __init__(self) -> None:
        self._nodes: dict[tuple[object, ...], Node] = {}

    def constant(self, value: float) -> Node:
        """A number."""
        return self.make("constant", (), value=float(value) + 0.0)

    def leaf(self, group: str, name: str) -> Node:
        """An input of the law: a parameter, a gain, part of the state or the reference."""
        return self.make("leaf", (), group=group, name=name)

    def apply(self, operation: str, *arguments: Node) -> Node:
        """An operation: one of ARITHMETIC, sin, cos, or one of FUNCTIONS."""
        simpler = self._simplify(operation, arguments)
        if simpler is not None:
            return simpler
        if operation in COMMUTATIVE:
            arguments = tuple(sorted(arguments, key=lambda node: node.order))
        return self.make(operation, arguments)

    def again(self, node: Node, arguments: Sequence[Node]) -> Node:
        """The node's operation on other arguments."""
        if node.operation in (MATRIX_INVERSE, ENTRY):
            return self.make(node.operation, tuple(arguments), value=node.value)
        return self.apply(node.operation, *arguments)

    def inverse(self, matrix: Sequence[Sequence[Node]], least: float) -> list[list[Node]]:
        """The entries of a square matrix's inverse, which has a meaning where the reciprocal condition exceeds `least`."""
        whole = self.make(MATRIX_INVERSE, tuple(entry for row in matrix for entry in row), value=least)
        size = range(len(matrix))
        return [[self.make(ENTRY, (whole,), value=i * len(matrix) + j) for j in size] for i in size]

    def make(self, operation: str, arguments: tuple[Node, ...], value: float = 0.0, group: str = "", name: str = "") -> Node:
        """A node as it is asked for, made once."""
        key = (operation, arguments, value, group, name)
        if key not in self._nodes:
            self._nodes[key] = Node(operation, arguments, value, group, name, len(self._nodes))
        return self._nodes[key]

    def _simplify(self, operation: str, arguments: tuple[Node, ...]) -> Node | None:
        a, b = arguments[0], arguments[-1]  # the same where there is only one
        if operation == "mul":
            return self._simplify_product(a, b)
        if operation == "add":
            if is_constant(a, 0) or is_constant(b, 0):
                return b if is_constant(a, 0) else a
            if b.operation == "neg" or a.operation == "neg":
                return self.apply("sub", a, b.arguments[0]) if b.operation == "neg" else self.apply("sub", b, a.arguments[0])
        if operation == "sub":
            if is_constant(b, 0):
                return a
            if is_constant(a, 0):
                return self.apply("neg", b)
            if b.operation == "neg":
                return self.apply("add", a, b.arguments[0])
        if operation == "neg":
            if a.operation == "neg":
                return a.arguments[0]
            if a.operation == "constant":
                return self.constant(-a.value)
            if a.operation == "sub":
                return self.apply("sub", a.arguments[1], a.arguments[0])
        if operation == "div":
            if is_constant(b, 1):
                return a
            if _is_power_of_two(b):  # its inverse is exact
                return self.apply("mul", a, self.constant(1 / b.value))
            (above, scale), (below, divisor) = self._power_of_two(a), self._power_of_two(b)
            if scale != 1 and divisor != 1:
                power = self.constant(scale / divisor)
                if is_constant(above, 1):
                    return self.apply("div", power, below)
                return self.apply("mul", self.apply("div", above, below), power)
            if a.operation == "neg":
                return self.apply("neg", self.apply("div", a.arguments[0], b))
        if operation == "cos" and a.operation == "neg":
            return self.apply("cos", a.arguments[0])
        return None

    def _simplify_product(self, a: Node, b: Node) -> Node | None:
        for one, other in ((a, b), (b, a)):
            if is_constant(one, 1):
                return other
            if is_constant(one, -1):
                return self.apply("neg", other)
            if one.operation == "neg":
                return self.apply("neg", self.apply("mul", one.arguments[0], other))
            if one.operation == "constant" and one.value < 0:
                return self.apply("neg", self.apply("mul", self.constant(-one.value), other))
        (first, scale), (second, more) = self._power_of_two(a), self._power_of_two(b)
        if scale != 1 and more != 1:
            return self.apply("mul", self.apply("mul", first, second), self.constant(scale * more))
        return None

    def _power_of_two(self, node: Node) -> tuple[Node, float]:
        """A product with a power of two as its other factor and the power, else the node and 1.

        A multiplication by a power of two is exact, so it may be done in any order.
        """
        if _is_power_of_two(node):
            return self.constant(1), node.value
        if node.operation == "mul":
            for factor, rest in (node.arguments, node.arguments[::-1]):
                if _is_power_of_two(factor):
                    return rest, factor.value
        return node, 1.0


def free_name(name: str, taken: set[str]) -> str:
    """The name, with underscores added until nothing else has it; it is taken then."""
    while name in taken:
        name += "_"
    taken.add(name)
    return name


def is_constant(node: Node, value: float) -> bool:
    """Is the node this number?"""
    return node.operation == "constant" and node.value == value


def _is_power_of_two(node: Node) -> bool:
    return node.operation == "constant" and abs(frexp(node.value)[0]) == 0.5


def reachable(roots: Iterable[Node]) -> list[Node]:
    """Every node the roots depend on, arguments before users."""
    seen: set[Node] = set()
    stack = list(roots)
    while stack:
        node = stack.pop()
        if node not in seen:
            seen.add(node)
            stack.extend(node.arguments)
    return sorted(seen, key=lambda node: node.order)


def headers(roots: Iterable[Node]) -> list[str]:
    """The headers of the C runtime, without .h, that the C of these nodes needs beside those of every law."""
    used = {node.operation for node in reachable(roots)}
    return [
        name
        for name, operations in (("noslip_functions", FUNCTIONS), ("noslip_solve", (MATRIX_INVERSE,)))
        if not used.isdisjoint(operations)
    ]


def count(nodes: Iterable[Node]) -> dict[str, int]:
    """How many of each operation; a sine and a cosine of the same angle count as one sincos."""
    nodes = list(nodes)
    used = Counter(node.operation for node in nodes)
    counted = {operation: used[operation] for operation in ARITHMETIC}
    counted["sincos"] = len({node.arguments for node in nodes if node.operation in ("sin", "cos")})
    counted.update({function: used[function] for function in FUNCTIONS if used[function]})
    for size in (isqrt(len(node.arguments)) for node in nodes if node.operation == MATRIX_INVERSE):
        counted[f"inverse {size}x{size}"] = counted.get(f"inverse {size}x{size}", 0) + 1
    return counted


def from_casadi(
    graph: Graph, expression: ca.SX, symbols: Sequence[ca.SX], leaves: Sequence[Node], where: str
) -> list[list[Node]]:
    """The entries of an SX matrix as nodes, row by row. Raises ModelError for an operation that the C runtime has not."""

    def apply(code: int, arguments: tuple[Node, ...]) -> Node:
        if code not in FROM_CASADI:
            raise ModelError(f"{where}: {NAMES.get(code, f'operation {code}')} is not supported in generated C; {USABLE}")
        try:
            return FROM_CASADI[code](graph, *arguments)
        except ModelError as error:
            raise ModelError(f"{where}: {error}") from error

    entries = fold(expression, symbols, lambda k: leaves[k], graph.constant, apply)
    rows, columns = expression.shape
    return [[entries[row + column * rows] for column in range(columns)] for row in range(rows)]


def _less(graph: Graph, a: Node, b: Node) -> Node:
    return graph.apply("less", a, b)


def _not(graph: Graph, a: Node) -> Node:
    return graph.apply("not", a)


def _both(graph: Graph, a: Node, b: Node) -> Node:
    return graph.apply("if", a, b if b.operation in ("less", "not") else _not(graph, _not(graph, b)))


def _equal(graph: Graph, a: Node, b: Node) -> Node:
    return _not(graph, graph.apply("add", _less(graph, a, b), _less(graph, b, a)))


FROM_CASADI: dict[int, Callable[..., Node]] = {
    ca.OP_ASSIGN: lambda g, a: a,
    ca.OP_ADD: lambda g, a, b: g.apply("add", a, b),
    ca.OP_SUB: lambda g, a, b: g.apply("sub", a, b),
    ca.OP_MUL: lambda g, a, b: g.apply("mul", a, b),
    ca.OP_DIV: lambda g, a, b: g.apply("div", a, b),
    ca.OP_NEG: lambda g, a: g.apply("neg", a),
    ca.OP_SQ: lambda g, a: g.apply("mul", a, a),
    ca.OP_TWICE: lambda g, a: g.apply("mul", g.constant(2), a),
    ca.OP_INV: lambda g, a: g.apply("div", g.constant(1), a),
    ca.OP_SQRT: lambda g, a: g.apply("sqrt", a),
    ca.OP_FABS: lambda g, a: g.apply("abs", a),
    ca.OP_SIN: lambda g, a: g.apply("sin", a),
    ca.OP_COS: lambda g, a: g.apply("cos", a),
    ca.OP_TAN: lambda g, a: g.apply("div", g.apply("sin", a), g.apply("cos", a)),
    ca.OP_HYPOT: lambda g, a, b: g.apply("sqrt", g.apply("add", g.apply("mul", a, a), g.apply("mul", b, b))),
    ca.OP_POW: lambda g, a, b: _power(g, a, b),
    ca.OP_CONSTPOW: lambda g, a, b: _power(g, a, b),
    ca.OP_EXP: lambda g, a: g.apply("exp", a),
    ca.OP_LOG: lambda g, a: g.apply("log", a),
    ca.OP_SINH: lambda g, a: g.apply("sinh", a),
    ca.OP_COSH: lambda g, a: g.apply("cosh", a),
    ca.OP_TANH: lambda g, a: g.apply("tanh", a),
    ca.OP_ASIN: lambda g, a: g.apply("asin", a),
    ca.OP_ACOS: lambda g, a: g.apply("acos", a),
    ca.OP_ATAN: lambda g, a: g.apply("atan", a),
    ca.OP_ATAN2: lambda g, a, b: g.apply("atan2", a, b),
    ca.OP_SIGN: lambda g, a: g.apply("sign", a),
    ca.OP_FMIN: lambda g, a, b: g.apply("min", a, b),
    ca.OP_FMAX: lambda g, a, b: g.apply("max", a, b),
    ca.OP_LT: _less,
    ca.OP_LE: lambda g, a, b: _not(g, _less(g, b, a)),
    ca.OP_EQ: _equal,
    ca.OP_NE: lambda g, a, b: _not(g, _equal(g, a, b)),
    ca.OP_NOT: _not,
    ca.OP_AND: _both,
    ca.OP_OR: lambda g, a, b: _not(g, _both(g, _not(g, a), _not(g, b))),
    ca.OP_IF_ELSE_ZERO: lambda g, a, b: g.apply("if", a, b),
}


def _power(graph: Graph, base: Node, exponent: Node) -> Node:
    """base^n: for a whole or half n by repeated squaring, for another constant by logarithm and exponential."""
    if exponent.operation != "constant":
        raise ModelError("the exponent of a power must be a constant")
    twice = exponent.value * 2
    if twice != int(twice):
        return graph.apply("pow", base, exponent)
    whole, half = divmod(int(abs(twice)), 2)
    result = graph.apply("sqrt", base) if half else graph.constant(1)
    square = base
    while whole:
        whole, odd = divmod(whole, 2)
        result = graph.apply("mul", result, square) if odd else result
        square = graph.apply("mul", square, square) if whole else square
    return result if twice >= 0 else graph.apply("div", graph.constant(1), result)
