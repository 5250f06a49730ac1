"""Repeated steps of a computation as loops, such as those of trailers in a chain: the same operations on the same values.

An iteration is a list of nodes; in the next one, each node has the same operation on arguments that are, in each case: the node
of this iteration at the same position; that of the iteration before, carried; a value that does not change; or the next one of
a column, which are values that differ by a number in the names of parameters and states, or values of an earlier loop.
"""

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property
from typing import TypeAlias

from .graph import COMMUTATIVE, SINCOS, Applied, Leaf, Node, Operation, executed, is_operation, reachable

LEAST = 4  # iterations
NEAREST = 12  # users of users looked at for the node of the next iteration
MOST_TRIED = 60  # of them
MOST_CUT = 2  # iterations that a loop may lose where it is joined with another one
STRAIGHT = (Operation.DIV,)  # a divisor is tested where it is used: these stay outside of loops

Column: TypeAlias = tuple[object, ...]  # identifies a column
Place: TypeAlias = tuple[Column, int]  # and a number in it
Key: TypeAlias = tuple[Operation, tuple[Node, ...]]
Rounds: TypeAlias = list[tuple[Node, ...]]  # by iteration: its nodes, or the arguments of one of them


class Origin(StrEnum):
    """Where an argument of an operation in a loop is from."""

    SAME = "the same value in all iterations"
    HERE = "computed by this iteration"
    BEFORE = "computed by the iteration before; the first one takes an initial value"
    COLUMN = "another value of a column in each iteration"


@dataclass(frozen=True, eq=False)
class Argument:
    """An argument of an operation in a loop: its values by iteration; for HERE and BEFORE, the position that computes it."""

    origin: Origin
    values: tuple[Node, ...]
    position: int = -1


@dataclass(frozen=True, eq=False)
class Repetition:
    """A loop: the nodes of each iteration, in the order in which they are computed, and the arguments of each in one order.

    Iteration k has the number first + k * by, by which columns are indexed; `by` is 1 or -1.
    """

    first: int
    by: int
    rounds: tuple[tuple[Node, ...], ...]
    arguments: tuple[tuple[tuple[Node, ...], ...], ...]  # by position and argument: the values by iteration

    @cached_property
    def nodes(self) -> set[Node]:
        """All nodes that the loop computes."""
        return {node for each in self.rounds for node in each}

    @cached_property
    def inputs(self) -> list[Node]:
        """What the loop takes."""
        every = (argument for each in self.rounds for node in each for argument in node.arguments)
        return [argument for argument in dict.fromkeys(every) if argument not in self.nodes]

    @cached_property
    def body(self) -> list[tuple[Node, list[Argument]]]:
        """By position: the node of the first iteration, and its arguments."""
        return [(node, [self._argument(v) for v in of]) for node, of in zip(self.rounds[0], self.arguments, strict=True)]

    @cached_property
    def initial(self) -> dict[int, Node]:
        """Positions whose value the next iteration takes -> what the first iteration takes."""
        every = (argument for _, arguments in self.body for argument in arguments)
        return {each.position: each.values[0] for each in every if each.origin is Origin.BEFORE}

    @property
    def columns(self) -> list[tuple[Node, ...]]:
        """The values of each column that the loop takes, by iteration."""
        every = (argument for _, arguments in self.body for argument in arguments)
        return [argument.values for argument in every if argument.origin is Origin.COLUMN]

    def _argument(self, values: tuple[Node, ...]) -> Argument:
        if len(set(values)) == 1 and values[0] not in self.nodes:
            return Argument(Origin.SAME, values)
        found = [self.where.get(value) for value in values]
        if found[0] and all(one == (k, found[0][1]) for k, one in enumerate(found)):
            return Argument(Origin.HERE, values, found[0][1])
        if found[1] and found[0] is None and all(one == (k, found[1][1]) for k, one in enumerate(found[1:])):
            return Argument(Origin.BEFORE, values, found[1][1])
        return Argument(Origin.COLUMN, values)

    @cached_property
    def where(self) -> dict[Node, tuple[int, int]]:
        """Iteration and position of each node."""
        return {node: (k, position) for k, each in enumerate(self.rounds) for position, node in enumerate(each)}

    def number(self, k: int) -> int:
        """The number of iteration k."""
        return self.first + k * self.by

    def between(self, first: int, count: int) -> "Repetition":
        """The loop with only as many iterations from the one with this number on."""
        skipped = (first - self.first) * self.by
        kept = slice(skipped, skipped + count)
        arguments = tuple(tuple(values[kept] for values in of) for of in self.arguments)
        return Repetition(first, self.by, self.rounds[kept], arguments)


def places_of(nodes: Iterable[Node]) -> dict[Node, Place]:
    """The column of each parameter, state or function of parameters with a number in the names, and the number: the largest."""
    places: dict[Node, Place] = {}
    for node in nodes:
        if isinstance(node, Leaf) and (found := re.fullmatch(r"(.*\D)(\d+)", node.name)):
            places[node] = ("leaf", node.group, found[1]), int(found[2])
        elif isinstance(node, Applied) and node.fixed:
            numbers = [places[argument][1] for argument in node.arguments if argument in places]
            if numbers:
                parts = [
                    (*places[argument][0], places[argument][1] - max(numbers)) if argument in places else (argument.order,)
                    for argument in node.arguments
                ]
                if node.operation in COMMUTATIVE:
                    parts.sort(key=repr)
                places[node] = ("fixed", node.operation, *parts), max(numbers)
    return places


def find_loops(roots: Sequence[Node]) -> list[Repetition]:
    """The loops of what a step computes, in an order in which they can run; those that follow each other are joined."""
    return _Finder(roots).run()


@dataclass
class _Match:
    """Two iterations node by node, while they are compared; `by`: how numbers of columns differ, 0: not known yet."""

    pairs: dict[Node, Node]
    by: int
    carried: dict[Node, Node]  # of the first iteration, a value that it takes -> the node of it that the second one takes instead

    def copy(self) -> "_Match":
        return _Match(dict(self.pairs), self.by, dict(self.carried))


class _Finder:
    def __init__(self, roots: Sequence[Node]):
        self.nodes = executed(roots)
        self.places = places_of(reachable(roots))
        self.at = {place: node for node, place in self.places.items()}
        self.users: dict[Node, list[Applied]] = defaultdict(list)
        self.known: dict[Key, Node] = {}
        for node in self.nodes:
            if isinstance(node, Applied):
                self.known[_key(node.operation, node.arguments)] = node
                for argument in dict.fromkeys(node.arguments):
                    self.users[argument].append(node)
        self.loops: list[Repetition] = []
        self.rolled: set[Node] = set()

    def run(self) -> list[Repetition]:
        for node in self.nodes:
            if isinstance(node, Applied) and node not in self.rolled:
                best = max(self._loops_from(node), key=_saved, default=None)
                if best is not None and self._can_run([*self.loops, best]):
                    self._add(best)
        self._join()
        self._drop()
        return self._in_order(self.loops) or []

    def _add(self, loop: Repetition) -> None:
        self.loops.append(loop)
        self.rolled |= loop.nodes
        for k, each in enumerate(loop.rounds):
            for position, node in enumerate(each):
                place: Place = (("loop", len(self.loops), position), loop.number(k))
                self.places[node], self.at[place] = place, node
        for position, initial in loop.initial.items():
            place = ("loop", len(self.loops), position), loop.number(-1)
            self.at.setdefault(place, initial)
            if not initial.fixed:
                self.places.setdefault(initial, place)

    # -- two iterations -------------------------------------------------------------------------------------------

    def _loops_from(self, node: Applied) -> Iterable[Repetition]:
        """Loops whose first iteration contains this node."""
        for other in self._later(node):
            found = self._match(node, other, _Match({}, 0, {}))
            if found and found.by:
                loop = self._extended(found)
                if loop is not None:
                    yield loop

    def _later(self, node: Applied) -> Iterable[Node]:
        """Nodes with the same operation that depend on this one."""
        seen, layer, tried = {node: None}, [node], 0
        for _ in range(NEAREST):
            layer = list(dict.fromkeys(user for one in layer for user in self.users[one] if user not in seen))
            seen |= dict.fromkeys(layer)
            for user in layer:
                if user.operation is node.operation and user not in self.rolled:
                    yield user
                    tried += 1
            if tried > MOST_TRIED:
                return

    def _match(self, one: Node, other: Node, so_far: _Match) -> _Match | None:
        """Compare a value of an iteration with that of the next one; None if they do not correspond."""
        if one is other:
            return so_far if one not in so_far.pairs else None
        if one in so_far.pairs or one in so_far.carried:
            return so_far if so_far.pairs.get(one, so_far.carried.get(one)) is other else None
        if one in self.places and other in self.places and self.places[one][0] == self.places[other][0]:
            by = self.places[other][1] - self.places[one][1]
            if by in (1, -1) and so_far.by in (0, by):
                so_far.by = by
                return so_far
            return None
        if other in so_far.pairs:
            so_far.carried[one] = other
            return so_far
        if not (isinstance(one, Applied) and isinstance(other, Applied) and one.operation is other.operation):
            return None
        free = not (one.fixed or other.fixed or one in self.rolled or other in self.rolled)
        if not free or one.operation in STRAIGHT or other in so_far.pairs.values():
            return None
        so_far.pairs[one] = other
        orders = [other.arguments, other.arguments[::-1]] if one.operation in COMMUTATIVE else [other.arguments]
        for arguments in orders:
            found: _Match | None = so_far.copy()
            for a, b in zip(one.arguments, arguments, strict=True):
                found = found and self._match(a, b, found)
            if found:
                return found
        return None

    # -- all iterations -------------------------------------------------------------------------------------------

    def _extended(self, found: _Match) -> Repetition | None:
        """The loop of these two iterations and all that follow."""
        body = self._body(found)
        if body is None:
            return None
        rounds = [tuple(body), tuple(found.pairs[node] for node in body)]
        aligned = [self._aligned(position, rounds, found.by) for position in range(len(body))]
        arguments = [each for each in aligned if each]
        if len(arguments) < len(aligned):
            return None
        while following := self._following(rounds, arguments, found.by):
            rounds.append(following)
        self._add_partners(rounds, arguments)
        loop = Repetition(0, found.by, tuple(rounds), tuple(tuple(zip(*each, strict=True)) for each in arguments))
        if any(value not in self.places for values in loop.columns for value in values):
            return None  # values that are in no column cannot be taken by number
        numbers = [self.places[values[0]][1] for values in loop.columns]
        return replace(loop, first=max(numbers)) if len(rounds) >= LEAST and numbers else None

    def _body(self, found: _Match) -> list[Node] | None:
        """The nodes of the first iteration; what the second one takes from it, the first one takes from before it. None if there
        are no such nodes."""
        carried = {one for one, other in found.pairs.items() if other in found.pairs}
        body: set[Node] = set()
        stack = [next(iter(found.pairs))]
        while stack:
            node = stack.pop()
            if node in found.pairs and node not in carried and node not in body:
                body.add(node)
                stack.extend(node.arguments)
        if not body.isdisjoint(found.pairs[node] for node in body):
            return None
        return sorted(body, key=lambda node: node.order)  # the order of creation: arguments come before their users

    def _aligned(self, position: int, rounds: Rounds, by: int) -> Rounds | None:
        """The arguments at a position in the first two iterations, in the same order."""
        one, other = (each[position] for each in rounds)
        assert isinstance(one, Applied)
        orders = [other.arguments, other.arguments[::-1]] if one.operation in COMMUTATIVE else [other.arguments]
        for order in orders:
            if all(self._correspond(a, b, rounds, by) for a, b in zip(one.arguments, order, strict=True)):
                return [one.arguments, order]
        return None

    def _correspond(self, a: Node, b: Node, rounds: Sequence[Sequence[Node]], by: int) -> bool:
        if a in rounds[0]:
            return rounds[1][rounds[0].index(a)] is b
        return a is b or b in rounds[0] or (a in self.places and self._next(a, by) is b)

    def _next(self, node: Node, by: int) -> Node | None:
        """The next value of a column."""
        column, number = self.places[node]
        return self.at.get((column, number + by))

    def _following(self, rounds: Rounds, arguments: Sequence[Rounds], by: int) -> tuple[Node, ...] | None:
        """The iteration after these, whose arguments are added; None if the graph has not all of its nodes."""
        before, last = rounds[-2:]
        taken = {node for each in rounds for node in each}
        made: list[Node] = []
        added: list[tuple[Node, ...]] = []
        for node, of in zip(last, arguments, strict=True):
            values: list[Node] = []
            for earlier, a in zip(of[-2], of[-1], strict=True):
                if a in last:
                    values.append(made[last.index(a)])
                elif a in before:
                    values.append(last[before.index(a)])
                elif a is earlier:
                    values.append(a)
                elif a in self.places and (value := self._next(a, by)) is not None:
                    values.append(value)
                else:
                    return None
            assert isinstance(node, Applied)
            found = self.known.get(_key(node.operation, values))
            if found is None or found in self.rolled or found in taken:
                return None
            made.append(found)
            added.append(tuple(values))
        for of, each in zip(arguments, added, strict=True):
            of.append(each)
        return tuple(made)

    def _add_partners(self, rounds: Rounds, arguments: list[Rounds]) -> None:
        """Add the sine beside each cosine of the same angle, or the cosine, if both are used."""
        inside = {node for each in rounds for node in each}
        for position, node in enumerate(rounds[0]):
            if is_operation(node, *SINCOS):
                other = SINCOS[1 - SINCOS.index(node.operation)]
                found = [self.known.get(_key(other, each[position].arguments)) for each in rounds]
                partners = [one for one in found if one is not None and one not in inside and one not in self.rolled]
                if len(partners) == len(rounds):
                    rounds[:] = [(*each, one) for each, one in zip(rounds, partners, strict=True)]
                    arguments.append(list(arguments[position]))

    # -- order ----------------------------------------------------------------------------------------------------

    def _can_run(self, loops: Sequence[Repetition]) -> bool:
        return self._in_order(loops) is not None

    def _in_order(self, loops: Sequence[Repetition]) -> list[Repetition] | None:
        """The loops in an order in which each takes only what was computed before; None if there is none."""
        owner = {node: loop for loop in loops for node in loop.nodes}
        done: list[Repetition] = []
        state: dict[object, int] = {}  # 1: begun, 2: done
        for target in [*loops]:
            stack: list[tuple[object, bool]] = [(target, False)]
            while stack:
                one, leaves = stack.pop()
                if leaves:
                    state[one] = 2
                    if isinstance(one, Repetition):
                        done.append(one)
                    continue
                if state.get(one) == 2:
                    continue
                if state.get(one) == 1:
                    return None
                state[one] = 1
                stack.append((one, True))
                needed = one.inputs if isinstance(one, Repetition) else one.arguments  # type: ignore[attr-defined]
                for argument in needed:
                    following = owner.get(argument, argument)
                    if state.get(following) == 1:
                        return None
                    if not argument.fixed and state.get(following) != 2:
                        stack.append((following, False))
        return done

    def _join(self) -> None:
        """Join loops over nearly the same numbers in the same direction; the later one takes nothing of later iterations."""
        joined = True
        while joined:
            joined = False
            ordered = self._in_order(self.loops) or []
            for i, one in enumerate(ordered):
                for other in ordered[i + 1 :]:
                    made = _joined(one, other)
                    rest = [loop for loop in self.loops if loop is not one and loop is not other]
                    if made and self._can_run([*rest, made]):
                        self.loops = [*rest, made]
                        joined = True
                        break
                if joined:
                    break

    def _drop(self) -> None:
        """Leave out loops that take a column of values that no loop computes any more."""
        fixed = places_of(reachable(self.nodes))
        while True:
            computed = {node for loop in self.loops for node in loop.nodes}
            kept = [
                loop
                for loop in self.loops
                if all(values[0] in fixed or not computed.isdisjoint(values) for values in loop.columns)
            ]
            if len(kept) == len(self.loops):
                return
            self.loops = kept


def _key(operation: Operation, arguments: Sequence[Node]) -> Key:
    """What identifies the node of an operation."""
    return operation, tuple(sorted(arguments, key=lambda node: node.order) if operation in COMMUTATIVE else arguments)


def _saved(loop: Repetition) -> int:
    """The operations that are not written any more."""
    return (len(loop.rounds) - 1) * len(loop.rounds[0])


def _joined(one: Repetition, other: Repetition) -> Repetition | None:
    """Both loops as one, with the iterations that both have, nearly all; None if they cannot be joined."""
    if one.by != other.by:
        return None
    both, by = (one, other), one.by
    first, last = max(by * loop.first for loop in both), min(by * loop.number(len(loop.rounds) - 1) for loop in both)
    count = last - first + 1
    if count < LEAST or max(len(loop.rounds) for loop in both) - count > MOST_CUT:
        return None
    one, other = (loop.between(by * first, count) for loop in both)
    when = {node: k for k, each in enumerate(one.rounds) for node in each}
    for k, each in enumerate(other.rounds):
        if any(when.get(argument, k) > k for node in each for argument in node.arguments):
            return None
    rounds = tuple((*a, *b) for a, b in zip(one.rounds, other.rounds, strict=True))
    return Repetition(one.first, one.by, rounds, (*one.arguments, *other.arguments))
