"""Fewer operations for the same value: passes over a law's graph, each exact in real arithmetic.

The passes see sums of products: a term is a sign, a factor that init knows, and factors that change from step to step.
What they answer is rounded as it is then written in C; nothing is regrouped after that.
"""

from collections import Counter
from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import combinations
from math import prod

from .graph import CONSTANT_GROUPS, Graph, Node, is_constant, reachable

# n-ary operations used between the passes only: "sum" (node.name holds a sign for each argument, the first is +),
# "product", "kept" (a product that is not to be taken apart again) and "inverse"
Signed = tuple[int, Node]
Pair = tuple[Node, Node, int]  # two arguments and their relative sign


@dataclass(frozen=True)
class Term:
    """sign * factor * product of others; `factor` is known to init, None for 1."""

    sign: int
    factor: Node | None
    others: tuple[Node, ...]


class Optimizer:
    """Rewrites what a set of roots depends on. `labels` names nodes; a name follows its node's value through the passes."""

    def __init__(self, graph: Graph, labels: dict[Node, str]):
        self.graph = graph
        self.labels = labels
        self._fixed: dict[Node, bool] = {}

    def fixed(self, node: Node) -> bool:
        """Does init know the node?"""
        if node not in self._fixed:
            is_leaf = node.operation == "leaf"
            self._fixed[node] = node.group in CONSTANT_GROUPS if is_leaf else all(self.fixed(a) for a in node.arguments)
        return self._fixed[node]

    def _name(self, old: Node, sign: int, new: Node) -> Signed:
        """Carry the old node's name over to the new one, which has its value."""
        if old in self.labels and sign > 0 and new.arguments and not self.fixed(new):
            self.labels.setdefault(new, self.labels[old])
        return sign, new

    def run(self, roots: Sequence[Node]) -> list[Node]:
        """The roots after all passes."""
        *_, (_, improved) = self.passes(roots)
        return improved

    def passes(self, roots: Sequence[Node]) -> Iterator[tuple[str, list[Node]]]:
        """Name of each pass and the roots, in two-operand steps, after it."""
        signed = self.sums_of_products(roots)
        yield "sums of products", self.binary(signed)
        for name, improve in (
            ("sums in common", self.common_sums),
            ("factors in common", self.common_factors),
            ("sums in common", self.common_sums),
            ("products in common", self.common_products),
            ("signs", self.turned),
        ):
            signed = improve(signed)
            yield name, self.binary(signed)

    # -- sums of products -----------------------------------------------------------------------------------------

    def sums_of_products(self, roots: Sequence[Node]) -> list[Signed]:
        """Merge sums into sums and products into products; gather what init knows into one factor of each term."""
        uses = Counter(argument for node in reachable(roots) for argument in node.arguments)
        uses.update(roots)
        done: dict[Node, Signed] = {}

        def terms(node: Node) -> list[Term]:
            """The node as a sum; a sum that others use too stays one term."""
            sign, made = done[node]
            if made.operation == "sum" and uses[node] == 1:
                return [self._term(s * sign, argument) for s, argument in signed_arguments(made)]
            return [self._term(sign, made)]

        for node in reachable(roots):
            if self.fixed(node) or node.operation in ("leaf", "constant"):
                done[node] = self._positive(node)
            elif node.operation in ("add", "sub", "neg"):
                first, *second = node.arguments
                signs = {"add": (1, 1), "sub": (1, -1), "neg": (-1,)}[node.operation]
                both = [
                    Term(t.sign * s, t.factor, t.others) for s, a in zip(signs, (first, *second), strict=True) for t in terms(a)
                ]
                done[node] = self.sum(both)
            elif node.operation in ("mul", "div"):
                (sign, a), (other, b) = (done[argument] for argument in node.arguments)
                made = self.product(sign * other, a, b if node.operation == "mul" else self._inverse(b))
                done[node] = made if uses[node] == 1 else self._keep(*made)
            else:
                arguments = [self._plain(done[argument]) for argument in node.arguments]
                done[node] = (1, self.graph.again(node, arguments))
            self._name(node, *done[node])
        return [done[root] for root in roots]

    def sum(self, terms: Iterable[Term]) -> Signed:
        """A sum; terms with the same changing factors become one."""
        merged: dict[tuple[Node, ...], Signed | None] = {}
        for term in terms:
            factor = (term.sign, term.factor or self.graph.constant(1))
            merged[term.others] = self._add_factors(merged.get(term.others), factor)
        parts = []
        for others, signed in merged.items():
            if signed is not None and not is_constant(signed[1], 0):
                parts.append(self._signed_product(signed[0], signed[1], others))
        if not parts:
            return 1, self.graph.constant(0)
        if len(parts) == 1:
            return parts[0]
        parts.sort(key=lambda part: part[1].order)
        lead = next((sign for sign, _ in parts), 1)
        signs = "".join("+" if sign == lead else "-" for sign, _ in parts)
        return lead, self.graph.make("sum", tuple(node for _, node in parts), name=signs)

    def product(self, sign: int, *nodes: Node) -> Signed:
        """A product; factors that init knows become one."""
        factor: Node | None = None
        others: list[Node] = []
        for node in nodes:
            term = self._term(1, node)
            factor = term.factor if factor is None else self.graph.apply("mul", factor, term.factor) if term.factor else factor
            others += term.others
        return self._signed_product(sign, factor or self.graph.constant(1), tuple(sorted(others, key=lambda node: node.order)))

    def _keep(self, sign: int, node: Node) -> Signed:
        """A product that several use: its changing factors stay together."""
        term = self._term(sign, node)
        if len(term.others) < 2:
            return sign, node
        return self._signed_product(sign, term.factor or self.graph.constant(1), (self.graph.make("kept", term.others),))

    def _signed_product(self, sign: int, factor: Node, others: tuple[Node, ...]) -> Signed:
        more, factor = self._positive(factor)
        if is_constant(factor, 0):
            return 1, factor
        arguments = others if is_constant(factor, 1) and others else (factor, *others)
        return sign * more, arguments[0] if len(arguments) == 1 else self.graph.make("product", arguments)

    def _term(self, sign: int, node: Node) -> Term:
        if node.operation == "product":
            known = [argument for argument in node.arguments if self.fixed(argument)]
            return Term(sign, known[0] if known else None, tuple(a for a in node.arguments if not self.fixed(a)))
        return Term(sign, node, ()) if self.fixed(node) else Term(sign, None, (node,))

    def _add_factors(self, a: Signed | None, b: Signed) -> Signed:
        if a is None:
            return b
        if a[1] is b[1]:
            return (a[0], self.graph.apply("mul", self.graph.constant(2), a[1])) if a[0] == b[0] else (1, self.graph.constant(0))
        if a[0] == b[0]:
            return a[0], self.graph.apply("add", a[1], b[1])
        return a[0], self.graph.apply("sub", a[1], b[1])

    def _inverse(self, node: Node) -> Node:
        """1 / node; the part that init knows is inverted there."""
        term = self._term(1, node)
        parts = []
        if term.factor is not None:
            parts.append(self.graph.apply("div", self.graph.constant(1), term.factor))
        if term.others:
            changing = term.others[0] if len(term.others) == 1 else self.graph.make("product", term.others)
            parts.append(self.graph.make("inverse", (changing,)))
        return parts[0] if len(parts) == 1 else self.graph.make("product", tuple(parts))

    def _positive(self, node: Node) -> Signed:
        if node.operation == "neg":
            return -1, node.arguments[0]
        if node.operation == "constant" and node.value < 0:
            return -1, self.graph.constant(-node.value)
        return 1, node

    def _plain(self, signed: Signed) -> Node:
        if signed[0] > 0:
            return signed[1]
        if self.fixed(signed[1]):
            return self.graph.apply("neg", signed[1])
        return self.graph.make("product", (self.graph.constant(-1), signed[1]))

    # -- common factors within a sum --------------------------------------------------------------------------------

    def common_factors(self, signed: Sequence[Signed]) -> list[Signed]:
        """a x + a y = a (x + y), the factor that saves most first."""
        return self._rewrite_signed(signed, self._factored)

    def _factored(self, sign: int, node: Node) -> Signed:
        if node.operation != "sum":
            return sign, node
        terms = [self._term(s, argument) for s, argument in signed_arguments(node)]
        counted = Counter(factor for term in terms for factor in dict.fromkeys(self._factors(term)))
        shared = [factor for factor, times in counted.items() if times > 1]
        if not shared:
            return sign, node
        best = max(
            shared, key=lambda factor: (counted[factor], not self.fixed(factor), factor.operation == "inverse", -factor.order)
        )
        inside = [self._without(term, best) for term in terms if best in self._factors(term)]
        outside = [term for term in terms if best not in self._factors(term)]
        s, made = self._factored(*self.sum(inside))
        product = self.product(s, best, made)
        if not outside:
            return sign * product[0], product[1]
        s, made = self._factored(*self.sum([*outside, self._term(*product)]))
        return sign * s, made

    def _factors(self, term: Term) -> list[Node]:
        return [*([term.factor] if term.factor is not None else []), *term.others]

    def _without(self, term: Term, factor: Node) -> Term:
        if term.factor is factor:
            return Term(term.sign, None, term.others)
        place = term.others.index(factor)
        return Term(term.sign, term.factor, term.others[:place] + term.others[place + 1 :])

    # -- what sums or products have in common -----------------------------------------------------------------------

    def common_sums(self, signed: Sequence[Signed]) -> list[Signed]:
        """Pairs of terms that several sums share, up to a sign, become sums of their own."""
        return self._extract(signed, "sum")

    def common_products(self, signed: Sequence[Signed]) -> list[Signed]:
        """Pairs of factors that several products share become products of their own."""
        return self._extract(signed, "product")

    def _extract(self, roots: Sequence[Signed], operation: str) -> list[Signed]:
        signed, index = list(roots), PairIndex()
        while True:
            index.update(node for node in reachable(node for _, node in signed) if node.operation == operation)
            found = index.most_shared()
            if found is None:
                return signed
            (x, y, relative), users = found
            signs = "+-" if relative < 0 else "++"
            pair = self.graph.make("sum", (x, y), name=signs) if operation == "sum" else self.graph.make("kept", (x, y))
            self._name(self.graph.make("product", (x, y)), 1, pair)

            def replace(sign: int, node: Node, x: Node = x, y: Node = y, relative: int = relative, pair: Node = pair) -> Signed:
                if node.operation != operation or node is pair or (x, y, relative) not in index.pairs(node):
                    return sign, node
                if operation == "product":
                    rest = list(node.arguments)
                    rest.remove(x)
                    rest.remove(y)
                    return sign, self.graph.make("product", (*rest, pair)) if rest else pair
                signs = dict((argument, s) for s, argument in signed_arguments(node))
                terms = [self._atom(s, argument) for argument, s in signs.items() if argument is not x and argument is not y]
                return self._signed(sign, self.sum([*terms, self._atom(signs[x], pair)]))

            signed = self._rewrite_signed(signed, replace, users)

    @staticmethod
    def _atom(sign: int, node: Node) -> Term:
        return Term(sign, None, (node,))

    @staticmethod
    def _signed(sign: int, other: Signed) -> Signed:
        return sign * other[0], other[1]

    def _rewrite_signed(
        self, signed: Sequence[Signed], change: Callable[[int, Node], Signed], where: Container[Node] | None = None
    ) -> list[Signed]:
        rewritten = self._rewrite([node for _, node in signed], change, where)
        return [(sign * s, node) for (sign, _), (s, node) in zip(signed, rewritten, strict=True)]

    def _rewrite(
        self, roots: Sequence[Node], change: Callable[[int, Node], Signed], where: Container[Node] | None
    ) -> list[Signed]:
        """Apply `change` to every node, arguments first, signs carried along; or to those in `where` and what depends on them."""
        done: dict[Node, Signed] = {}
        nodes = reachable(roots)
        uses = Counter(argument for node in nodes for argument in node.arguments)
        uses.update(roots)
        for node in nodes:
            if self.fixed(node) or not node.arguments:
                done[node] = (1, node)
                continue
            new = [done[argument] for argument in node.arguments]
            same = all(sign > 0 and made is old for (sign, made), old in zip(new, node.arguments, strict=True))
            if same and where is not None and node not in where and node.operation not in ("kept", "product"):
                done[node] = (1, node)
                continue
            if node.operation == "sum":
                rebuilt = self.sum([self._term(s * sign, n) for s, (sign, n) in zip(signs_of(node), new, strict=True)])
            elif node.operation == "product":
                rebuilt = self.product(prod(s for s, _ in new), *[n for _, n in new])
            elif node.operation == "inverse":
                rebuilt = (new[0][0], self._inverse(new[0][1]))
            elif node.operation == "kept":
                sign, parts = prod(s for s, _ in new), tuple(n for _, n in new)
                made_here = any(self.fixed(argument) for argument in node.arguments)  # by _extract, which wants it so
                rebuilt = (sign, self.graph.make("kept", parts)) if made_here else self.product(sign, *parts)
                rebuilt = self._keep(*rebuilt) if uses[node] > 1 else rebuilt
            else:
                rebuilt = (1, self.graph.again(node, [self._plain(argument) for argument in new]))
            done[node] = self._name(node, *change(*rebuilt))
        return [done[root] for root in roots]

    # -- signs -------------------------------------------------------------------------------------------------------

    def turned(self, roots: Sequence[Signed]) -> list[Signed]:
        """-(a + (b - c)) as (c - b) - a, with c - b in place of b - c everywhere."""
        signed: list[Signed] = list(roots)
        tried: set[Node] = set()  # each is turned once, so that two roots with opposite wishes come to an end
        while (found := self._to_turn(signed, tried)) is not None:
            arguments = sorted(((-sign, argument) for sign, argument in signed_arguments(found)), key=lambda term: -term[0])
            signs = "".join("+" if sign > 0 else "-" for sign, _ in arguments)
            turned = self.graph.make("sum", tuple(argument for _, argument in arguments), name=signs)
            tried |= {found, turned}

            def change(sign: int, node: Node, found: Node = found, turned: Node = turned) -> Signed:
                return (-sign, turned) if node is found else (sign, node)

            signed = self._rewrite_signed(signed, change)
        return signed

    @staticmethod
    def _to_turn(signed: Sequence[Signed], tried: set[Node]) -> Node | None:
        for sign, root in signed:
            if sign < 0 and root.operation == "sum" and "-" not in root.name:
                for argument in root.arguments:
                    if argument.operation == "sum" and "-" in argument.name and argument not in tried:
                        return argument
        return None

    # -- back to two operands ---------------------------------------------------------------------------------------

    def binary(self, signed: Sequence[Signed]) -> list[Node]:
        """Sums and products in two-operand steps, from the left; an inverse used once becomes a division."""
        nodes = reachable(node for _, node in signed)
        uses = Counter(argument for node in nodes for argument in node.arguments)
        done: dict[Node, Node] = {}
        for node in nodes:
            done[node] = node if self.fixed(node) or not node.arguments else self._lower(node, done, uses)
            self._name(node, 1, done[node])
        return [done[node] if sign > 0 else self._negative(node, done) for sign, node in signed]

    def _negative(self, node: Node, done: dict[Node, Node]) -> Node:
        """minus the node: a difference the other way round where it is one."""
        if node.operation != "sum" or "-" not in node.name:
            return self.graph.apply("neg", done[node])
        terms = sorted(((-sign, argument) for sign, argument in signed_arguments(node)), key=lambda term: -term[0])
        return self._chain([(sign, done[argument]) for sign, argument in terms])

    def _chain(self, terms: Sequence[Signed]) -> Node:
        (_, result), *rest = terms
        for sign, argument in rest:
            result = self.graph.apply("add" if sign > 0 else "sub", result, argument)
        return result

    def _lower(self, node: Node, done: dict[Node, Node], uses: Counter[Node]) -> Node:
        apply = self.graph.apply
        if node.operation == "inverse":
            return apply("div", self.graph.constant(1), done[node.arguments[0]])
        if node.operation in ("product", "kept"):
            divisors = [a for a in node.arguments if a.operation == "inverse" and uses[a] == 1]
            factors = [done[a] for a in node.arguments if a not in divisors]
            result = factors[0] if factors else self.graph.constant(1)
            for factor in factors[1:]:
                result = apply("mul", result, factor)
            for divisor in divisors:
                result = apply("div", result, done[divisor.arguments[0]])
            return result
        if node.operation == "sum":
            return self._chain([(sign, done[argument]) for sign, argument in signed_arguments(node)])
        return self.graph.again(node, [done[argument] for argument in node.arguments])


def signs_of(node: Node) -> list[int]:
    """The sign of each argument of a sum."""
    return [1 if sign == "+" else -1 for sign in node.name]


def signed_arguments(node: Node) -> list[Signed]:
    """Sign and argument of each term of a sum."""
    return list(zip(signs_of(node), node.arguments, strict=True))


class PairIndex:
    """The pairs of arguments of a changing set of nodes, and which nodes have each."""

    def __init__(self) -> None:
        self._nodes: set[Node] = set()
        self._users: dict[Pair, set[Node]] = {}
        self._pairs: dict[Node, frozenset[Pair]] = {}
        self._heap: list[tuple[tuple[int, ...], Pair]] = []  # the most used first; one with an old count does not count

    def pairs(self, node: Node) -> frozenset[Pair]:
        """The pairs of one node."""
        if node not in self._pairs:
            self._pairs[node] = frozenset(pairs(node))
        return self._pairs[node]

    def update(self, nodes: Iterable[Node]) -> None:
        """Take these nodes for those before."""
        new = set(nodes)
        changed: set[Pair] = set()
        for node in self._nodes - new:
            for pair in self.pairs(node):
                self._users[pair].discard(node)
                changed.add(pair)
        for node in new - self._nodes:
            for pair in self.pairs(node):
                self._users.setdefault(pair, set()).add(node)
                changed.add(pair)
        self._nodes = new
        for pair in changed:
            if len(self._users[pair]) > 1:
                heappush(self._heap, (self._rank(pair), pair))

    def most_shared(self) -> tuple[Pair, set[Node]] | None:
        """The pair that most nodes have, of those the earliest made; None when every pair has one user."""
        while self._heap:
            rank, pair = self._heap[0]
            if len(self._users[pair]) > 1 and rank == self._rank(pair):
                return pair, set(self._users[pair])
            heappop(self._heap)
        return None

    def _rank(self, pair: Pair) -> tuple[int, ...]:
        users = self._users[pair]
        return -len(users), pair[0].order, pair[1].order, min(node.order for node in users), pair[2]


def pairs(node: Node) -> list[Pair]:
    """The pairs of arguments of a sum, with their relative sign, or of a product."""
    if node.operation == "sum":
        return [(x, y, s * t) for (s, x), (t, y) in combinations(signed_arguments(node), 2)]
    return [(x, y, 1) for x, y in combinations(node.arguments, 2)]
