"""The expression graph of a law: equal subexpressions are a single node."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, fields
from enum import StrEnum
from math import frexp, isqrt
from operator import attrgetter
from typing import TypeGuard, TypeVar, cast

import casadi as ca

from ..model.algebra.expression import fold
from ..model.algebra.operations import NAMES, USABLE
from ..model.errors import ModelError


class Operation(StrEnum):
    """Operation of an `Applied` node; functions of the C runtime have the same name with the prefix
    `noslip_`."""

    MUL = "mul"
    ADD = "add"
    SUB = "sub"
    NEG = "neg"
    DIV = "div"
    SQRT = "sqrt"
    ABS = "abs"
    SIN = "sin"
    COS = "cos"
    EXP = "exp"
    LOG = "log"
    POW = "pow"
    SINH = "sinh"
    COSH = "cosh"
    TANH = "tanh"
    ATAN2 = "atan2"
    ATAN = "atan"
    ASIN = "asin"
    ACOS = "acos"
    SIGN = "sign"
    MIN = "min"
    MAX = "max"
    LESS = "less"
    NOT = "not"
    IF = "if"


OPERATIONS = tuple(Operation)
SINCOS = (Operation.SIN, Operation.COS)
# Infinite or NaN if an argument is, except a denominator
ARITHMETIC = OPERATIONS[: OPERATIONS.index(Operation.SIN)]
FUNCTIONS = OPERATIONS[OPERATIONS.index(Operation.EXP) :]  # in noslip_functions.h; each returns NaN for NaN
COMMUTATIVE = (Operation.ADD, Operation.MUL)
BY_ORDER = attrgetter("order")


class Group(StrEnum):
    """The group of a leaf: a struct or an array of the C, or the steps of a program."""

    PARAMS = "params"
    CONFIG = "config"
    GAINS = "gains"
    STATE = "state"
    EXTENSION = "extension"
    REFERENCE = "reference"
    FOOT = "foot"
    VIRTUAL_INPUT = "virtual_input"
    INPUT = "input"
    ESTIMATE = "estimate"
    FACTOR = "factor"
    STEP = "step"


# Known to init; the others change from step to step
CONSTANT_GROUPS = (Group.PARAMS, Group.CONFIG, Group.GAINS)


@dataclass(frozen=True, eq=False, repr=False)
class Node:
    """A scalar, or the inverse of a matrix. A graph creates each node once:
    equal nodes are the same object."""

    order: int  # of creation: arguments come before their users
    arguments: tuple["Node", ...]
    fixed: bool = field(init=False)  # whether it depends on parameters only, so that init can compute it

    def __post_init__(self) -> None:
        object.__setattr__(self, "fixed", all(argument.fixed for argument in self.arguments))

    def __repr__(self) -> str:
        own = [str(getattr(self, each.name)) for each in fields(self)[3:]]
        arguments = [f"#{argument.order}" for argument in self.arguments]
        return f"{type(self).__name__}#{self.order}({', '.join(own + arguments)})"


@dataclass(frozen=True, eq=False, repr=False)
class Constant(Node):
    """A number."""

    __match_args__ = ("value",)
    value: float


@dataclass(frozen=True, eq=False, repr=False)
class Leaf(Node):
    """An input of the law: a parameter, a gain, part of the state or the reference."""

    group: Group
    name: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "fixed", self.group in CONSTANT_GROUPS)


@dataclass(frozen=True, eq=False, repr=False)
class Applied(Node):
    """An operation on the arguments."""

    __match_args__ = ("operation", "arguments")
    operation: Operation


@dataclass(frozen=True, eq=False, repr=False)
class MatrixInverse(Node):
    """The inverse of a square matrix, whose entries are the arguments, row by row; not a scalar.

    It is valid if the reciprocal condition number of the matrix exceeds `least`.
    """

    least: float

    @property
    def size(self) -> int:
        """Number of rows."""
        return isqrt(len(self.arguments))


@dataclass(frozen=True, eq=False, repr=False)
class Element(Node):
    """An entry of the inverse of a matrix; entries are numbered row by row."""

    number: int


AnyNode = TypeVar("AnyNode", bound=Node)


class Graph:
    """Creates nodes, each once; simplifies only if no bit of the value changes."""

    def __init__(self) -> None:
        self._nodes: dict[tuple[object, ...], Node] = {}

    def constant(self, value: float) -> Node:
        """Return the node of a number."""
        return self.make(Constant, (), float(value) + 0.0)

    def leaf(self, group: str, name: str) -> Node:
        """Return the node of an input of the law."""
        return self.make(Leaf, (), Group(group), name)

    def apply(self, operation: Operation, *arguments: Node) -> Node:
        """Return the node of an operation on arguments."""
        simpler = self._simplify(operation, arguments)
        if simpler is not None:
            return simpler
        if operation in COMMUTATIVE:
            arguments = tuple(sorted(arguments, key=lambda node: node.order))
        return self.make(Applied, arguments, operation)

    def again(self, node: Node, arguments: Sequence[Node]) -> Node:
        """Return the node with the same operation on other arguments."""
        if isinstance(node, Applied):
            return self.apply(node.operation, *arguments)
        if isinstance(node, MatrixInverse):
            return self.make(MatrixInverse, tuple(arguments), node.least)
        assert isinstance(node, Element), "no other node has arguments"
        return self.make(Element, tuple(arguments), node.number)

    def inverse(self, matrix: Sequence[Sequence[Node]], least: float) -> list[list[Node]]:
        """Return the entries of the inverse of a square matrix; it is valid if the reciprocal condition
        number exceeds `least`."""
        whole = self.make(MatrixInverse, tuple(entry for row in matrix for entry in row), least)
        size = range(len(matrix))
        return [[self.make(Element, (whole,), i * len(matrix) + j) for j in size] for i in size]

    def make(self, kind: type[AnyNode], arguments: tuple[Node, ...], *fields: object) -> AnyNode:
        """Return the node of a kind with these arguments and fields; equal ones are the same object."""
        key = (kind, arguments, *fields)
        if key not in self._nodes:
            self._nodes[key] = kind(len(self._nodes), arguments, *fields)
        return cast(AnyNode, self._nodes[key])

    def _simplify(self, operation: Operation, arguments: tuple[Node, ...]) -> Node | None:
        match operation, arguments:
            case Operation.MUL, (a, b):
                return self._simplify_product(a, b)
            case (Operation.ADD, (Constant(0), other)) | (
                Operation.ADD | Operation.SUB,
                (other, Constant(0)),
            ):
                return other
            case Operation.ADD, (a, Applied(Operation.NEG, (b,))):
                return self.apply(Operation.SUB, a, b)
            case Operation.ADD, (Applied(Operation.NEG, (a,)), b):
                return self.apply(Operation.SUB, b, a)
            case Operation.SUB, (Constant(0), b):
                return self.apply(Operation.NEG, b)
            case Operation.SUB, (a, Applied(Operation.NEG, (b,))):
                return self.apply(Operation.ADD, a, b)
            case Operation.NEG, (Applied(Operation.NEG, (a,)),):
                return a
            case Operation.NEG, (Constant(value),):
                return self.constant(-value)
            case Operation.NEG, (Applied(Operation.SUB, (a, b)),):
                return self.apply(Operation.SUB, b, a)
            case Operation.DIV, (a, b):
                return self._simplify_quotient(a, b)
            case Operation.COS, (Applied(Operation.NEG, (a,)),):
                return self.apply(Operation.COS, a)
        return None

    def _simplify_quotient(self, a: Node, b: Node) -> Node | None:
        if is_constant(b, 1):
            return a
        if _is_power_of_two(b):  # its inverse is exact
            return self.apply(Operation.MUL, a, self.constant(1 / b.value))
        (above, scale), (below, divisor) = self._power_of_two(a), self._power_of_two(b)
        if scale != 1 and divisor != 1:
            power = self.constant(scale / divisor)
            if is_constant(above, 1):
                return self.apply(Operation.DIV, power, below)
            return self.apply(Operation.MUL, self.apply(Operation.DIV, above, below), power)
        match a:
            case Applied(Operation.NEG, (opposite,)):
                return self.apply(Operation.NEG, self.apply(Operation.DIV, opposite, b))
        return None

    def _simplify_product(self, a: Node, b: Node) -> Node | None:
        for one, other in ((a, b), (b, a)):
            match one:
                case Constant(1):
                    return other
                case Constant(-1):
                    return self.apply(Operation.NEG, other)
                case Applied(Operation.NEG, (opposite,)):
                    return self.apply(Operation.NEG, self.apply(Operation.MUL, opposite, other))
                case Constant(value) if value < 0:
                    return self.apply(Operation.NEG, self.apply(Operation.MUL, self.constant(-value), other))
        (first, scale), (second, more) = self._power_of_two(a), self._power_of_two(b)
        if scale != 1 and more != 1:
            return self.apply(
                Operation.MUL, self.apply(Operation.MUL, first, second), self.constant(scale * more)
            )
        return None

    def _power_of_two(self, node: Node) -> tuple[Node, float]:
        """For a product with a power of two, return the other factor and the power, else the node and 1.

        A multiplication by a power of two is exact, so it may be done in any order.
        """
        if _is_power_of_two(node):
            return self.constant(1), node.value
        if is_operation(node, Operation.MUL):
            for factor, rest in (node.arguments, node.arguments[::-1]):
                if _is_power_of_two(factor):
                    return rest, factor.value
        return node, 1.0


def free_name(name: str, taken: set[str]) -> str:
    """Return the name, with underscores appended until it is not in `taken`, and add it to `taken`."""
    while name in taken:
        name += "_"
    taken.add(name)
    return name


def is_operation(node: Node, *operations: Operation) -> TypeGuard[Applied]:
    """Whether the node is one of these operations."""
    return isinstance(node, Applied) and node.operation in operations


def is_constant(node: Node, value: float) -> bool:
    """Whether the node is this number."""
    return isinstance(node, Constant) and node.value == value


def _is_power_of_two(node: Node) -> TypeGuard[Constant]:
    return isinstance(node, Constant) and abs(frexp(node.value)[0]) == 0.5


def reachable(roots: Iterable[Node]) -> list[Node]:
    """Return all nodes on which the roots depend, arguments before users."""
    seen: set[Node] = set()
    stack = list(roots)
    while stack:
        node = stack.pop()
        if node not in seen:
            seen.add(node)
            stack.extend(node.arguments)
    return sorted(seen, key=BY_ORDER)


def executed(roots: Iterable[Node]) -> list[Node]:
    """Return the nodes that a step computes, without those that init computes."""
    return [node for node in reachable(roots) if not node.fixed]


def angles(nodes: Iterable[Node]) -> list[Node]:
    """Return the arguments of the sines and cosines among the nodes."""
    return list({node.arguments[0]: None for node in nodes if is_operation(node, *SINCOS)})


def headers(roots: Iterable[Node]) -> list[str]:
    """Return the headers of the C runtime, without .h, that the C of these nodes needs in addition to those
    of every law."""
    nodes = reachable(roots)
    functions = any(is_operation(node, *FUNCTIONS) for node in nodes)
    inverses = any(isinstance(node, MatrixInverse) for node in nodes)
    return ["noslip_functions"] * functions + ["noslip_solve"] * inverses


def count(nodes: Iterable[Node]) -> dict[str, int]:
    """Return the number of each operation; a sine and a cosine of the same angle count as one sincos."""
    nodes = list(nodes)
    used = Counter(node.operation for node in nodes if isinstance(node, Applied))
    counted: dict[str, int] = {operation: used[operation] for operation in ARITHMETIC}
    counted["sincos"] = len(angles(nodes))
    counted.update({function: used[function] for function in FUNCTIONS if used[function]})
    inverses = Counter(
        f"inverse {node.size}x{node.size}" for node in nodes if isinstance(node, MatrixInverse)
    )
    return {**counted, **inverses}


def from_casadi(
    graph: Graph, expression: ca.SX, symbols: Sequence[ca.SX], leaves: Sequence[Node], where: str
) -> list[list[Node]]:
    """Return the entries of an SX matrix as nodes, by rows. Raises ModelError for an operation that the C
    runtime does not have."""

    def apply(code: int, arguments: tuple[Node, ...]) -> Node:
        if code not in FROM_CASADI:
            raise ModelError(
                f"{where}: {NAMES.get(code, f'operation {code}')} is not supported in generated C; {USABLE}"
            )
        try:
            return FROM_CASADI[code](graph, *arguments)
        except ModelError as error:
            raise ModelError(f"{where}: {error}") from error

    entries = fold(expression, symbols, lambda k: leaves[k], graph.constant, apply)
    rows, columns = expression.shape
    return [[entries[row + column * rows] for column in range(columns)] for row in range(rows)]


def _both(graph: Graph, a: Node, b: Node) -> Node:
    logical = is_operation(b, Operation.LESS, Operation.NOT)
    return graph.apply(Operation.IF, a, b if logical else _not(graph, _not(graph, b)))


def _not(graph: Graph, a: Node) -> Node:
    return graph.apply(Operation.NOT, a)


def _less(graph: Graph, a: Node, b: Node) -> Node:
    return graph.apply(Operation.LESS, a, b)


def _equal(graph: Graph, a: Node, b: Node) -> Node:
    return _not(graph, graph.apply(Operation.ADD, _less(graph, a, b), _less(graph, b, a)))


def _power(graph: Graph, base: Node, exponent: Node) -> Node:
    """Return base^n: for an integer or half-integer n by repeated squaring,
    else by logarithm and exponential."""
    if not isinstance(exponent, Constant):
        raise ModelError("the exponent of a power must be a constant")
    twice = exponent.value * 2
    if twice != int(twice):
        return graph.apply(Operation.POW, base, exponent)
    whole, half = divmod(int(abs(twice)), 2)
    result = graph.apply(Operation.SQRT, base) if half else graph.constant(1)
    square = base
    while whole:
        whole, odd = divmod(whole, 2)
        result = graph.apply(Operation.MUL, result, square) if odd else result
        square = graph.apply(Operation.MUL, square, square) if whole else square
    return result if twice >= 0 else graph.apply(Operation.DIV, graph.constant(1), result)


SAME = {  # operations with the same meaning in CasADi
    **{
        ca.OP_ADD: Operation.ADD,
        ca.OP_SUB: Operation.SUB,
        ca.OP_MUL: Operation.MUL,
        ca.OP_DIV: Operation.DIV,
    },
    **{ca.OP_NEG: Operation.NEG, ca.OP_SQRT: Operation.SQRT, ca.OP_FABS: Operation.ABS},
    **{
        ca.OP_SIN: Operation.SIN,
        ca.OP_COS: Operation.COS,
        ca.OP_EXP: Operation.EXP,
        ca.OP_LOG: Operation.LOG,
    },
    **{ca.OP_SINH: Operation.SINH, ca.OP_COSH: Operation.COSH, ca.OP_TANH: Operation.TANH},
    **{
        ca.OP_ASIN: Operation.ASIN,
        ca.OP_ACOS: Operation.ACOS,
        ca.OP_ATAN: Operation.ATAN,
        ca.OP_ATAN2: Operation.ATAN2,
    },
    **{ca.OP_SIGN: Operation.SIGN, ca.OP_FMIN: Operation.MIN, ca.OP_FMAX: Operation.MAX},
    **{ca.OP_LT: Operation.LESS, ca.OP_NOT: Operation.NOT, ca.OP_IF_ELSE_ZERO: Operation.IF},
}
FROM_CASADI: dict[int, Callable[..., Node]] = {
    **{code: lambda g, *arguments, o=operation: g.apply(o, *arguments) for code, operation in SAME.items()},
    ca.OP_ASSIGN: lambda g, a: a,
    ca.OP_SQ: lambda g, a: g.apply(Operation.MUL, a, a),
    ca.OP_TWICE: lambda g, a: g.apply(Operation.MUL, g.constant(2), a),
    ca.OP_INV: lambda g, a: g.apply(Operation.DIV, g.constant(1), a),
    ca.OP_TAN: lambda g, a: g.apply(Operation.DIV, g.apply(Operation.SIN, a), g.apply(Operation.COS, a)),
    ca.OP_HYPOT: lambda g, a, b: g.apply(
        Operation.SQRT, g.apply(Operation.ADD, g.apply(Operation.MUL, a, a), g.apply(Operation.MUL, b, b))
    ),
    ca.OP_POW: _power,
    ca.OP_CONSTPOW: _power,
    ca.OP_LE: lambda g, a, b: _not(g, _less(g, b, a)),
    ca.OP_EQ: _equal,
    ca.OP_NE: lambda g, a, b: _not(g, _equal(g, a, b)),
    ca.OP_AND: _both,
    ca.OP_OR: lambda g, a, b: _not(g, _both(g, _not(g, a), _not(g, b))),
}
