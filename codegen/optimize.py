"""Fewer operations for the same value: passes over a law's graph, each exact in real arithmetic.

The passes see sums of products: a term is a sign, a factor that init computes, and factors that change from
step to step. The results are rounded in the order in which they are then written in C; nothing is regrouped
afterwards.
"""

from collections import Counter
from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from heapq import heapify, heappop, heappush
from itertools import combinations
from math import prod
from operator import and_

from .graph import Applied, Constant, Graph, Node, Operation, is_constant, is_operation, reachable

Signed = tuple[int, Node]
Pair = tuple[Node, Node, int]  # two arguments and their relative sign


# -- nodes with any number of arguments, used between the passes only ----------------------------------------


@dataclass(frozen=True, eq=False, repr=False)
class Sum(Node):
    """The arguments, each with its sign, +1 or -1."""

    signs: tuple[int, ...]

    @property
    def terms(self) -> list[Signed]:
        """Sign and argument of each term."""
        return list(zip(self.signs, self.arguments, strict=True))

    @property
    def opposite(self) -> list[Signed]:
        """The terms of minus the sum, those with + first."""
        return sorted(((-sign, argument) for sign, argument in self.terms), key=lambda term: -term[0])


@dataclass(frozen=True, eq=False, repr=False)
class Product(Node):
    """The product of the arguments."""


@dataclass(frozen=True, eq=False, repr=False)
class KeptProduct(Node):
    """A product that later passes do not split."""


@dataclass(frozen=True, eq=False, repr=False)
class Reciprocal(Node):
    """1 / the argument."""


@dataclass(frozen=True)
class Term:
    """sign * factor * product of others; init computes `factor`; None for 1."""

    sign: int
    factor: Node | None
    others: tuple[Node, ...]


class Optimizer:
    """Rewrites the nodes on which a set of roots depends. `labels` names nodes; the passes keep the name of a
    value. `kept`: products that stay together where they have several users; `totals`: sums that are not
    merged with those that contain them, such as those from body to body along a chain."""

    def __init__(
        self,
        graph: Graph,
        labels: dict[Node, str],
        kept: Container[Node] = (),
        totals: Container[Node] = (),
    ):
        self.graph = graph
        self.labels = labels
        self.kept = kept
        self.totals = totals
        self._terms_of: dict[Product, tuple[Node | None, tuple[Node, ...]]] = {}
        # Products that remain what they are when made again, and if shared
        self._in_order: set[tuple[Node, bool]] = set()

    def _name(self, old: Node, sign: int, new: Node) -> Signed:
        """Give the name of the old node to the new one, which has the same value."""
        if old in self.labels and sign > 0 and new.arguments and not new.fixed:
            self.labels.setdefault(new, self.labels[old])
        return sign, new

    def run(self, roots: Sequence[Node]) -> list[Node]:
        """Return the roots after all passes."""
        *_, (_, improved) = self.passes(roots)
        return improved

    def passes(self, roots: Sequence[Node]) -> Iterator[tuple[str, list[Node]]]:
        """Yield the name of each pass and the roots after it, in operations of two operands."""
        signed = self.sums_of_products(roots)
        yield "sums of products", self.binary(signed)
        for name, improve in PASSES:
            signed = improve(self, signed)
            yield name, self.binary(signed)

    # -- sums of products ------------------------------------------------------------------------------------

    def sums_of_products(self, roots: Sequence[Node]) -> list[Signed]:
        """Merge nested sums and nested products; collect in each term the factors that init computes into
        one."""
        uses = Counter(argument for node in reachable(roots) for argument in node.arguments)
        uses.update(roots)
        done: dict[Node, Signed] = {}

        def terms(node: Node) -> list[Term]:
            """Return the node as terms of a sum; a total, or a sum with other users, remains one term."""
            sign, made = done[node]
            if isinstance(made, Sum) and uses[node] == 1 and node not in self.totals:
                return [self._term(s * sign, argument) for s, argument in made.terms]
            return [self._term(sign, made)]

        for node in reachable(roots):
            if node.fixed or not node.arguments:
                done[node] = self._positive(node)
            elif is_operation(node, *SIGNS):
                both = zip(SIGNS[node.operation], node.arguments, strict=True)
                done[node] = self.sum(
                    [Term(t.sign * sign, t.factor, t.others) for sign, a in both for t in terms(a)]
                )
            elif is_operation(node, Operation.MUL, Operation.DIV):
                (sign, a), (other, b) = (done[argument] for argument in node.arguments)
                made = self.product(
                    sign * other, a, b if node.operation == Operation.MUL else self._inverse(b)
                )
                done[node] = made if uses[node] == 1 else self._keep(*made, whole=node in self.kept)
            else:
                arguments = [self._plain(done[argument]) for argument in node.arguments]
                done[node] = (1, self.graph.again(node, arguments))
            self._name(node, *done[node])
        return [done[root] for root in roots]

    def sum(self, terms: Iterable[Term]) -> Signed:
        """Return a sum; terms with the same changing factors are combined."""
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
        lead = parts[0][0]
        return lead, self._sum_of([(lead * sign, node) for sign, node in parts])

    def _sum_of(self, terms: Sequence[Signed]) -> Sum:
        return self.graph.make(Sum, tuple(node for _, node in terms), tuple(sign for sign, _ in terms))

    def product(self, sign: int, *nodes: Node) -> Signed:
        """Return a product; the factors that init computes are combined into one."""
        factor: Node | None = None
        others: list[Node] = []
        for node in nodes:
            term = self._term(1, node)
            if term.factor is not None:
                factor = (
                    term.factor if factor is None else self.graph.apply(Operation.MUL, factor, term.factor)
                )
            others += term.others
        return self._signed_product(
            sign, factor or self.graph.constant(1), tuple(sorted(others, key=lambda node: node.order))
        )

    def _keep(self, sign: int, node: Node, whole: bool = False) -> Signed:
        """Return a product with several users: its changing factors stay together,
        and that of init with them if `whole`."""
        if whole and isinstance(node, Product):
            return sign, self.graph.make(KeptProduct, node.arguments)
        term = self._term(sign, node)
        if len(term.others) < 2:
            return sign, node
        return self._signed_product(
            sign, term.factor or self.graph.constant(1), (self.graph.make(KeptProduct, term.others),)
        )

    def _signed_product(self, sign: int, factor: Node, others: tuple[Node, ...]) -> Signed:
        more, factor = self._positive(factor)
        if is_constant(factor, 0):
            return 1, factor
        arguments = others if is_constant(factor, 1) and others else (factor, *others)
        return sign * more, arguments[0] if len(arguments) == 1 else self.graph.make(Product, arguments)

    def _term(self, sign: int, node: Node) -> Term:
        if isinstance(node, Product):
            if node not in self._terms_of:
                known = next((argument for argument in node.arguments if argument.fixed), None)
                self._terms_of[node] = (
                    known,
                    tuple(argument for argument in node.arguments if not argument.fixed),
                )
            return Term(sign, *self._terms_of[node])
        return Term(sign, node, ()) if node.fixed else Term(sign, None, (node,))

    def _add_factors(self, a: Signed | None, b: Signed) -> Signed:
        if a is None:
            return b
        if a[1] is b[1]:
            twice = a[0], self.graph.apply(Operation.MUL, self.graph.constant(2), a[1])
            return twice if a[0] == b[0] else (1, self.graph.constant(0))
        return a[0], self.graph.apply(Operation.ADD if a[0] == b[0] else Operation.SUB, a[1], b[1])

    def _inverse(self, node: Node) -> Node:
        """Return 1 / node; init inverts the factor that it computes."""
        term = self._term(1, node)
        parts = []
        if term.factor is not None:
            parts.append(self.graph.apply(Operation.DIV, self.graph.constant(1), term.factor))
        if term.others:
            changing = term.others[0] if len(term.others) == 1 else self.graph.make(Product, term.others)
            parts.append(self.graph.make(Reciprocal, (changing,)))
        return parts[0] if len(parts) == 1 else self.graph.make(Product, tuple(parts))

    def _positive(self, node: Node) -> Signed:
        match node:
            case Applied(Operation.NEG, (opposite,)):
                return -1, opposite
            case Constant(value) if value < 0:
                return -1, self.graph.constant(-value)
        return 1, node

    def _plain(self, signed: Signed) -> Node:
        if signed[0] > 0:
            return signed[1]
        if signed[1].fixed:
            return self.graph.apply(Operation.NEG, signed[1])
        return self.graph.make(Product, (self.graph.constant(-1), signed[1]))

    # -- a quotient within the numerator of another ----------------------------------------------------------

    def nested_quotients(self, signed: Sequence[Signed]) -> list[Signed]:
        """Replace (a + b/c)/d by (a c + b)/(c d): a division costs as much as several products."""
        nodes = reachable(node for _, node in signed)
        uses = Counter(argument for node in nodes for argument in node.arguments)

        def only(terms: Sequence[Term]) -> list[Reciprocal]:
            """Return the reciprocals that these terms use, and nothing else uses."""
            counted = Counter(
                factor for term in terms for factor in term.others if isinstance(factor, Reciprocal)
            )
            return [each for each, times in counted.items() if times == uses[each]]

        def change(sign: int, node: Node) -> Signed:
            terms = self._terms(node)
            for outer in only(terms):
                over = [self._without(term, outer) for term in terms if outer in term.others]
                # a factor as often as each term has it
                common = reduce(and_, (Counter(self._factors(term)) for term in over))
                shared = [each for each in common.elements() if not isinstance(each, Sum)]
                inside: list[Term] = []
                for term in over:
                    for factor in shared:
                        term = self._without(term, factor)
                    whole = term.factor is None and len(term.others) == 1 and uses[term.others[0]] == 1
                    parts = self._terms(term.others[0]) if whole else [replace(term, sign=1)]
                    inside += [replace(part, sign=part.sign * term.sign) for part in parts]
                for inner in only(inside):
                    below = inner.arguments[0]
                    s, rest = self.sum([term for term in inside if inner not in term.others])
                    divided = [self._without(term, inner) for term in inside if inner in term.others]
                    numerator = self.sum([*divided, self._term(*self.product(s, below, rest))])
                    denominator = self._plain(self.product(1, below, outer.arguments[0]))
                    quotient = self.product(numerator[0], *shared, numerator[1], self._inverse(denominator))
                    others = [term for term in terms if outer not in term.others]
                    return self._signed(
                        sign, self.sum([*others, self._term(*quotient)]) if others else quotient
                    )
            return sign, node

        nested = any(change(1, node)[1] is not node for node in nodes if isinstance(node, Sum | Product))
        return self._rewrite_signed(signed, change) if nested else list(signed)

    def _terms(self, node: Node) -> list[Term]:
        """Return a sum's terms, or the node as one."""
        return (
            [self._term(s, argument) for s, argument in node.terms]
            if isinstance(node, Sum)
            else [self._term(1, node)]
        )

    # -- common factors within a sum -------------------------------------------------------------------------

    def common_factors(self, signed: Sequence[Signed]) -> list[Signed]:
        """Factor sums, a x + a y = a (x + y); the factor that saves most operations comes first."""
        return self._rewrite_signed(signed, self._factored)

    def _factored(self, sign: int, node: Node) -> Signed:
        if not isinstance(node, Sum):
            return sign, node
        terms = [self._term(s, argument) for s, argument in node.terms]
        counted = Counter(factor for term in terms for factor in dict.fromkeys(self._factors(term)))
        shared = [factor for factor, times in counted.items() if times > 1]
        if not shared:
            return sign, node
        best = max(
            shared,
            key=lambda factor: (
                counted[factor],
                not factor.fixed,
                isinstance(factor, Reciprocal),
                -factor.order,
            ),
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

    # -- common subexpressions of sums and of products -------------------------------------------------------

    def common_sums(self, signed: Sequence[Signed]) -> list[Signed]:
        """Replace pairs of terms that several sums share, up to a sign, by a common sum."""
        return self._extract(signed, Sum)

    def common_products(self, signed: Sequence[Signed]) -> list[Signed]:
        """Replace pairs of factors that several products share by a common product."""
        return self._extract(signed, Product)

    def _extract(self, roots: Sequence[Signed], kind: type[Sum] | type[Product]) -> list[Signed]:
        signed, index, live = list(roots), PairIndex(), Live()
        appeared, gone = live.move([node for _, node in signed])
        while True:
            index.update(
                *(((node for node in nodes if isinstance(node, kind))) for nodes in (appeared, gone))
            )
            found = index.most_shared()
            if found is None:
                return signed
            (x, y, relative), users = found
            pair = (
                self._sum_of([(1, x), (relative, y)]) if kind is Sum else self.graph.make(KeptProduct, (x, y))
            )
            self._name(self.graph.make(Product, (x, y)), 1, pair)

            def replace(
                sign: int, node: Node, x: Node = x, y: Node = y, relative: int = relative, pair: Node = pair
            ) -> Signed:
                if not isinstance(node, kind) or node is pair or (x, y, relative) not in index.pairs(node):
                    return sign, node
                if not isinstance(node, Sum):
                    rest = list(node.arguments)
                    rest.remove(x)
                    rest.remove(y)
                    return sign, self.graph.make(Product, (*rest, pair)) if rest else pair
                terms = [
                    self._atom(s, argument)
                    for s, argument in node.terms
                    if argument is not x and argument is not y
                ]
                lead = next(s for s, argument in node.terms if argument is x)
                return self._signed(sign, self.sum([*terms, self._atom(lead, pair)]))

            signed = self._rewrite_users(signed, replace, users, live)
            appeared, gone = live.move([node for _, node in signed])

    def _rewrite_users(
        self,
        signed: Sequence[Signed],
        change: Callable[[int, Node], Signed],
        users: Iterable[Node],
        live: "Live",
    ) -> list[Signed]:
        """As `_rewrite_signed` of all nodes, where `change` changes only these users. The others that are
        built again are those above a node that has changed, and products that are not yet in order."""
        waiting = {
            *users,
            *(node for node in live.products if (node, live.uses[node] > 1) not in self._in_order),
        }
        heap = [(node.order, node) for node in waiting]
        heapify(heap)
        done: dict[Node, Signed] = {}
        while heap:
            _, node = heappop(heap)
            shared = live.uses[node] > 1
            made = self._rebuilt(
                node, [done.get(argument, (1, argument)) for argument in node.arguments], shared
            )
            sign, new = self._name(node, *change(*made))
            if new is node and sign > 0:
                self._in_order.add((node, shared))
                continue
            done[node] = sign, new
            for above in live.above[node]:
                if above not in waiting:
                    waiting.add(above)
                    heappush(heap, (above.order, above))
        return [self._signed(sign, done.get(node, (1, node))) for sign, node in signed]

    @staticmethod
    def _atom(sign: int, node: Node) -> Term:
        return Term(sign, None, (node,))

    @staticmethod
    def _signed(sign: int, other: Signed) -> Signed:
        return sign * other[0], other[1]

    def _rewrite_signed(
        self, signed: Sequence[Signed], change: Callable[[int, Node], Signed]
    ) -> list[Signed]:
        rewritten = self._rewrite([node for _, node in signed], change)
        return [(sign * s, node) for (sign, _), (s, node) in zip(signed, rewritten, strict=True)]

    def _rewrite(self, roots: Sequence[Node], change: Callable[[int, Node], Signed]) -> list[Signed]:
        """Apply `change` to every node, arguments first, with signs."""
        done: dict[Node, Signed] = {}
        nodes = reachable(roots)
        uses = Counter(argument for node in nodes for argument in node.arguments)
        uses.update(roots)
        for node in nodes:
            if node.fixed or not node.arguments:
                done[node] = (1, node)
                continue
            rebuilt = self._rebuilt(node, [done[argument] for argument in node.arguments], uses[node] > 1)
            done[node] = self._name(node, *change(*rebuilt))
        return [done[root] for root in roots]

    def _rebuilt(self, node: Node, new: Sequence[Signed], shared: bool) -> Signed:
        """Return the node with new arguments; `shared`: it has several users."""
        if isinstance(node, Sum):
            return self.sum([self._term(s * sign, n) for s, (sign, n) in zip(node.signs, new, strict=True)])
        if isinstance(node, Product):
            return self.product(prod(s for s, _ in new), *[n for _, n in new])
        if isinstance(node, Reciprocal):
            return new[0][0], self._inverse(new[0][1])
        if isinstance(node, KeptProduct):
            sign, parts = prod(s for s, _ in new), tuple(n for _, n in new)
            made_here = any(argument.fixed for argument in node.arguments)  # by _extract; it must remain
            rebuilt = (sign, self.graph.make(KeptProduct, parts)) if made_here else self.product(sign, *parts)
            return self._keep(*rebuilt) if shared else rebuilt
        return 1, self.graph.again(node, [self._plain(argument) for argument in new])

    # -- signs -----------------------------------------------------------------------------------------------

    def turned(self, roots: Sequence[Signed]) -> list[Signed]:
        """Replace -(a + (b - c)) by (c - b) - a, and b - c by c - b everywhere."""
        signed: list[Signed] = list(roots)
        # Each is reversed once, so that two roots that need opposite signs do not alternate
        tried: set[Node] = set()
        while (found := self._to_turn(signed, tried)) is not None:
            turned = self._sum_of(found.opposite)
            tried |= {found, turned}

            def change(sign: int, node: Node, found: Node = found, turned: Node = turned) -> Signed:
                return (-sign, turned) if node is found else (sign, node)

            signed = self._rewrite_signed(signed, change)
        return signed

    @staticmethod
    def _to_turn(signed: Sequence[Signed], tried: set[Node]) -> Sum | None:
        for sign, root in signed:
            if sign < 0 and isinstance(root, Sum) and -1 not in root.signs:
                for argument in root.arguments:
                    if isinstance(argument, Sum) and -1 in argument.signs and argument not in tried:
                        return argument
        return None

    # -- back to two operands --------------------------------------------------------------------------------

    def binary(self, signed: Sequence[Signed]) -> list[Node]:
        """Return the roots with sums and products of two operands, from the left;
        a reciprocal used once becomes a division."""
        nodes = reachable(node for _, node in signed)
        uses = Counter(argument for node in nodes for argument in node.arguments)
        done: dict[Node, Node] = {}
        for node in nodes:
            done[node] = node if node.fixed or not node.arguments else self._lower(node, done, uses)
            self._name(node, 1, done[node])
        return [done[node] if sign > 0 else self._negative(node, done) for sign, node in signed]

    def _negative(self, node: Node, done: dict[Node, Node]) -> Node:
        """Return minus the node; a difference is reversed."""
        if not isinstance(node, Sum) or -1 not in node.signs:
            return self.graph.apply(Operation.NEG, done[node])
        return self._chain([(sign, done[argument]) for sign, argument in node.opposite])

    def _chain(self, terms: Sequence[Signed]) -> Node:
        (_, result), *rest = terms
        for sign, argument in rest:
            result = self.graph.apply(Operation.ADD if sign > 0 else Operation.SUB, result, argument)
        return result

    def _lower(self, node: Node, done: dict[Node, Node], uses: Counter[Node]) -> Node:
        apply = self.graph.apply
        match node:
            case Reciprocal():
                return apply(Operation.DIV, self.graph.constant(1), done[node.arguments[0]])
            case Sum():
                return self._chain([(sign, done[argument]) for sign, argument in node.terms])
            case Product() | KeptProduct():
                divisors = [a for a in node.arguments if isinstance(a, Reciprocal) and uses[a] == 1]
                factors = [done[a] for a in node.arguments if a not in divisors]
                result = factors[0] if factors else self.graph.constant(1)
                for factor in factors[1:]:
                    result = apply(Operation.MUL, result, factor)
                for divisor in divisors:
                    result = apply(Operation.DIV, result, done[divisor.arguments[0]])
                return result
        return self.graph.again(node, [done[argument] for argument in node.arguments])


SIGNS = {Operation.ADD: (1, 1), Operation.SUB: (1, -1), Operation.NEG: (-1,)}
Pass = Callable[[Optimizer, Sequence[Signed]], list[Signed]]
NamedPass = tuple[str, Pass]  # with the name that `noslip generate --explain` prints
QUOTIENTS: NamedPass = ("quotients in quotients", Optimizer.nested_quotients)
SUMS: NamedPass = ("sums in common", Optimizer.common_sums)
FACTORS: NamedPass = ("factors in common", Optimizer.common_factors)
PRODUCTS: NamedPass = ("products in common", Optimizer.common_products)
TURNED: NamedPass = ("signs", Optimizer.turned)
PASSES: tuple[NamedPass, ...] = (QUOTIENTS, SUMS, FACTORS, SUMS, PRODUCTS, TURNED)
"""The passes in their order. Add new passes here."""


class Live:
    """The nodes on which changing roots depend: how often each is used, by which nodes,
    and the products among them."""

    def __init__(self) -> None:
        self.uses: Counter[Node] = Counter()  # as argument and as root
        self.above: dict[Node, dict[Node, None]] = {}
        self.products: dict[Node, None] = {}
        self._roots: list[Node] = []

    def move(self, roots: Sequence[Node]) -> tuple[list[Node], list[Node]]:
        """Replace the roots; return the nodes that have appeared and those that are gone."""
        appeared, gone = [], []
        stack = list(roots)
        while stack:
            node = stack.pop()
            self.uses[node] += 1
            if self.uses[node] == 1:
                appeared.append(node)
                self.above[node] = {}
                if isinstance(node, Product | KeptProduct) and not node.fixed:
                    self.products[node] = None
                stack += node.arguments
        for node in appeared:
            for argument in node.arguments:
                self.above[argument][node] = None
        stack, self._roots = self._roots, list(roots)
        while stack:
            node = stack.pop()
            self.uses[node] -= 1
            if not self.uses[node]:
                gone.append(node)
                self.products.pop(node, None)
                stack += node.arguments
        for node in gone:
            for argument in node.arguments:
                self.above[argument].pop(node, None)
        for node in gone:
            del self.above[node]
        return appeared, gone


class PairIndex:
    """Index of the pairs of arguments in a changing set of nodes: the users of each pair."""

    def __init__(self) -> None:
        self._users: dict[Pair, set[Node]] = {}
        self._pairs: dict[Node, frozenset[Pair]] = {}
        self._heap: list[tuple[tuple[int, ...], Pair]] = []  # most users first; outdated entries are skipped

    def pairs(self, node: Node) -> frozenset[Pair]:
        """Return the pairs of a node."""
        if node not in self._pairs:
            self._pairs[node] = frozenset(pairs(node))
        return self._pairs[node]

    def update(self, appeared: Iterable[Node], gone: Iterable[Node]) -> None:
        """Add nodes to the set and remove others."""
        changed: set[Pair] = set()
        for node in gone:
            for pair in self.pairs(node):
                self._users[pair].discard(node)
                changed.add(pair)
        for node in appeared:
            for pair in self.pairs(node):
                self._users.setdefault(pair, set()).add(node)
                changed.add(pair)
        for pair in changed:
            if len(self._users[pair]) > 1:
                heappush(self._heap, (self._rank(pair), pair))

    def most_shared(self) -> tuple[Pair, set[Node]] | None:
        """Return the pair with the most users, the oldest among equals, and its users;
        None if every pair has one user."""
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
    """Return the pairs of arguments of a sum, with their relative sign, or of a product."""
    if isinstance(node, Sum):
        return [(x, y, s * t) for (s, x), (t, y) in combinations(node.terms, 2)]
    return [(x, y, 1) for x, y in combinations(node.arguments, 2)]
