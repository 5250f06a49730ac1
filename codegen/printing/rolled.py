"""C of repeated steps as loops, over arrays of what differs from one iteration to the next.

Functions of the parameters are in an array of the law's struct, entries of the state are copied to local arrays, and values that
one loop makes for another are in a local array. Before it is written, each loop is run on the nodes themselves: each operation
must have the arguments that it has without loops.
"""

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

from ..costs import LONG, code_bytes
from ..graph import COMMUTATIVE, SINCOS, Applied, Constant, Graph, Group, Leaf, Node, free_name, is_operation, reachable
from ..loops import Argument, Column, Origin, Place, Repetition, find_loops, places_of
from ..program import Entry, Program
from .layout import body as body_of
from .scalar import Scalar
from .statements import Printed, Statements

INDEX = "k"
RECORD = "link"  # the array in the law's struct
MADE = "at"  # the local array of values that loops make


@lru_cache(maxsize=64)
def loops_of(program: Program) -> dict[Entry, list[Repetition]]:
    """The loops of each entry point whose code would be long without them."""
    return {
        entry: found
        for entry, body in program.entries.items()
        if code_bytes(body.roots) > LONG and (found := find_loops(body.roots))
    }


@lru_cache(maxsize=64)
def with_records(program: Program) -> Program:
    """The program with those constants that loops take in an array of the law's struct."""
    places = {node: place for node, place in places_of(reachable(program.constants)).items() if node in program.constants}
    columns = _taken(loops_of(program).values(), places)
    chosen = {node: place for node, place in places.items() if place[0] in columns}
    if not chosen:
        return program
    least = min(number for _, number in chosen.values())
    fields: dict[Column, str] = {}
    taken: set[str] = set()
    for node, (column, _) in chosen.items():
        if column not in fields:
            name = program.constants[node]
            fields[column] = free_name(re.sub(r"_?\d+$", "", name) if isinstance(node, Leaf) else name, taken)
    renamed = {node: f"{RECORD}[{number - least}].{fields[column]}" for node, (column, number) in chosen.items()}
    return replace(program, constants=program.constants | renamed)


def record_fields(program: Program, scalar: Scalar, meaning: Callable[[Node], str]) -> list[tuple[str, str]]:
    """The members of the law's struct for the constants, those that loops take in an array of structs."""
    records: dict[str, tuple[str, str]] = {}
    numbers: list[int] = []
    plain = []
    places = places_of(reachable(program.constants))
    for node, field in program.constants.items():
        if found := re.fullmatch(rf"{RECORD}\[(\d+)\]\.(\w+)", field):
            number = places[node][1]
            numbers.append(number)
            records.setdefault(found[2], (f"    {scalar.real} {found[2]};", numbered(meaning(node), number)))
        else:
            plain.append((f"{scalar.real} {field};", meaning(node)))
    if not records:
        return plain
    of = f"{INDEX} = {min(numbers)} .. {max(numbers)}, each at [{shifted(-min(numbers))}]"
    return [*plain, ("struct {", of), *records.values(), (f"}} {RECORD}[{max(numbers) - min(numbers) + 1}];", "")]


def write_constants(writer: Statements, constants: Mapping[Node, str], leave: Callable[[str], str]) -> list[str]:
    """Write the fields of the struct that init computes; return the C of numbers that are finite only if all of them are."""

    def assigned(fields: Mapping[Node, str]) -> list[str]:
        for node, field in fields.items():
            writer.uses[node] = 1  # it is a field of the struct
            writer.assign(f"self->{field}", node)
            if node.arguments:
                writer.names[node] = f"self->{field}"
        return [f"self->{field}" for node, field in fields.items() if node.arguments]

    records = {node: field for node, field in constants.items() if field.startswith(f"{RECORD}[")}
    computed = assigned({node: field for node, field in constants.items() if node not in records})
    if not records:
        return computed
    total = free_name("total", writer.taken)
    writer.lines.append(f"{writer.scalar.real} {total} = {' + '.join(computed) or 0};")
    written = _write_records(writer, records, leave, total)
    return [total, *assigned({node: field for node, field in records.items() if node not in written})]


def _write_records(writer: Statements, records: Mapping[Node, str], leave: Callable[[str], str], total: str) -> set[Node]:
    """Write the loop that computes the array of the law's struct, and adds its entries to the variable `total`.

    The loop computes the members that all entries have: each is the same function of the parameters with the number of the entry
    in their names. Returns what it has computed.
    """
    places = places_of(reachable(records))
    fields: dict[str, dict[int, Node]] = defaultdict(dict)
    for node, field in records.items():
        fields[field.rpartition(".")[2]][places[node][1]] = node
    numbers = {number for column in fields.values() for number in column}
    fields = {
        name: column
        for name, column in fields.items()
        if column.keys() == numbers and len({places[node][0] for node in column.values()}) == 1
    }
    if not fields:
        return set()
    least = min(numbers)
    first = {name: column[least] for name, column in fields.items()}
    texts = _texts_of(writer, reachable(first.values()), places, least)
    inside = Statements(writer.scalar, texts.get, {}, leave, writer.taken, _numbered_meaning(writer, least))
    inside.plan(first.values())
    for name, column in fields.items():
        node, place = first[name], f"self->{RECORD}[{shifted(-least)}].{name}"
        inside.uses[node] = 1  # it is a field of the struct
        inside.assign(place, node)
        inside.names[node] = place
        writer.names |= {node: f"self->{RECORD}[{number - least}].{name}" for number, node in column.items()}
    inside.lines.append(f"{total} += {' + '.join(inside.names[node] for node in first.values())};")
    head = f"for (int {INDEX} = {least}; {INDEX} <= {max(numbers)}; {INDEX}++) {{"
    writer.lines.append("\n".join([head, body_of(inside.lines), "}"]))
    return {node for column in fields.values() for node in column.values()}


def _texts_of(writer: Statements, nodes: Sequence[Node], places: Mapping[Node, Place], number: int) -> dict[Node, str]:
    """Return the C of what the first iteration of a loop, of this number, takes: entries of arrays, to which parameters with a
    number are copied before the loop, and what does not change."""
    texts: dict[Node, str] = {}
    arrays: dict[Column, tuple[str, int]] = {}
    for node in nodes:
        if node in places and isinstance(node, Leaf):
            column, own = places[node]
            if column not in arrays:
                members = {n: leaf for leaf, (other, n) in places.items() if other == column}
                entries = [writer.text(members[n]) if n in members else "0" for n in range(min(members), max(members) + 1)]
                name = free_name(re.sub(r"\W+", "_", str(column[2])).strip("_") or "given", writer.taken)
                writer.lines.append(f"const {writer.scalar.real} {name}[{len(entries)}] = {{{', '.join(entries)}}};")
                arrays[column] = name, min(members)
            name, begin = arrays[column]
            texts[node] = f"{name}[{shifted(own - number - begin)}]"
        elif node in places:
            texts |= {argument: writer.named(argument) for argument in node.arguments if argument not in places}
    return texts


def _numbered_meaning(writer: Statements, number: int) -> Callable[[Node], str] | None:
    """Return the meaning of temporaries of a loop whose nodes are those of the iteration with this number."""
    meaning = writer.meaning
    return None if meaning is None else lambda node: numbered(meaning(node), number)


def _taken(loops: Iterable[Sequence[Repetition]], places: Mapping[Node, Place]) -> set[Column]:
    """The columns of constants, whose places are given, that loops take."""
    bodies = [argument for each in loops for loop in each for _, arguments in loop.body for argument in arguments]
    columns = [one for one in bodies if one.origin is Origin.COLUMN and all(value in places for value in one.values)]
    return {places[one.values[0]][0] for one in columns}


@dataclass(frozen=True)
class Cells:
    """Where the values of a column are: entry `number + offset` of an array, or of a member of its structs."""

    array: str
    offset: int
    member: str = ""

    def at(self, number: int) -> str:
        """The C of an entry."""
        return f"{self.array}[{number + self.offset}]{self.member}"

    def index(self, shift: int) -> str:
        """The C of the entry in an iteration, `shift` before or after it."""
        return f"{self.array}[{shifted(self.offset + shift)}]{self.member}"


def shifted(shift: int) -> str:
    """The C of the index, shifted."""
    return f"{INDEX} {'+' if shift > 0 else '-'} {abs(shift)}" if shift else INDEX


class WrongLoop(Exception):
    """A loop that does not compute what the statements without loops do."""


class Rolled(Statements):
    """Statements with loops. `admit(angle)` is the statement that leaves the function if an angle is out of range.

    Raises WrongLoop where a loop would change an operation or its arguments.
    """

    def __init__(self, loops: Sequence[Repetition], admit: Callable[[str], str], *arguments: Any):
        super().__init__(*arguments)
        self.admit = admit
        self.loops = loops
        self.owner = {node: loop for loop in loops for node in loop.nodes}
        self.where = {node: (loop, k, p) for loop in loops for k, each in enumerate(loop.rounds) for p, node in enumerate(each)}
        self.written: set[Repetition] = set()
        self.members: dict[tuple[Repetition, int], str] = {}  # values that are kept for later, and the member of the local array
        self.results: dict[tuple[Repetition, int], str] = {}  # values of which only the last one is used, and a variable
        self.cells: dict[tuple[Node, ...], Cells] = {}
        self.copies: dict[Column, str] = {}  # column of a group -> local array
        self.memory: dict[str, Node] = {}  # what entries of arrays contain
        self.taken |= {INDEX, MADE}

    # -- where values are -----------------------------------------------------------------------------------------

    def plan(self, roots: Iterable[Node]) -> None:
        """Count the uses of each node, and choose where the values of loops are kept."""
        roots = list(roots)
        super().plan(roots)
        straight = [node for node in self.uses if node not in self.owner and self.given(node) is None]
        used = [*roots, *(argument for node in straight for argument in node.arguments)]
        columns = []
        for loop in self.loops:
            for argument in (argument for _, arguments in loop.body for argument in arguments):
                if argument.origin is Origin.COLUMN:
                    columns.append((loop, argument))
                else:
                    used += argument.values[:1] if argument.origin in (Origin.SAME, Origin.BEFORE) else ()
        for _, argument in columns:
            made = [self.where[value][::2] for value in argument.values if value in self.where]
            used += [value for value in argument.values if value in self.where and self.where[value][::2] != made[0]]
            if made:
                self._member(*made[0])
        for node in used:
            if node in self.where:
                loop, k, p = self.where[node]
                if k < len(loop.rounds) - 1:
                    self._member(loop, p)
        for node in used:
            if node in self.where and (at := self.where[node][::2]) not in self.members and at not in self.results:
                loop, p = at
                self.results[at] = free_name(self._name(loop, p), self.taken)
        self.places = places_of(reachable(roots))
        self.columns: dict[Column, dict[int, Node]] = defaultdict(dict)
        for node, (column, number) in self.places.items():
            self.columns[column][number] = node
        numbers = [loop.number(k) for loop in self.loops for k in range(-1, len(loop.rounds) + 1)]
        self.least = min(numbers, default=0)
        if self.members:
            members = "\n".join(f"    {self.scalar.real} {name};" for name in self.members.values())
            self.lines.append(f"struct {{\n{members}\n}} {MADE}[{max(numbers) - self.least + 1}];")
        for loop, argument in columns:
            self._find_cells(loop, argument.values)

    def _member(self, loop: Repetition, position: int) -> None:
        if (loop, position) not in self.members:
            names = set(self.members.values())
            self.members[loop, position] = free_name(self._name(loop, position), names)

    def _name(self, loop: Repetition, position: int) -> str:
        """A name for a value of each iteration: what its names in the iterations have in common."""
        node = loop.rounds[0][position]
        if is_operation(node, *SINCOS):
            return f"{node.operation}_{INDEX}"
        return self._label(loop, position) or next(name for name in self.temporaries if name not in self.taken)

    def _label(self, loop: Repetition, position: int) -> str:
        """What the names of a value in the iterations have in common; empty if nothing."""
        rounds = list(enumerate(loop.rounds))[1:3]
        texts = {numbered(self.labels.get(each[position], ""), loop.number(k)) for k, each in rounds}
        text = texts.pop()
        return text if not texts and re.fullmatch(r"\w+", text) else ""

    def _find_cells(self, loop: Repetition, values: tuple[Node, ...]) -> None:
        """Find where a column is kept; copy what is in a struct."""
        if values in self.cells:
            return
        made = next((self.where[value][::2] for value in values if value in self.where), None)
        if made is not None:
            maker, p = made
            k = next(k for k, value in enumerate(values) if value in self.where and self.where[value][::2] == made)
            shift = maker.number(self.where[values[k]][1]) - loop.number(k)
            self.cells[values] = Cells(MADE, shift - self.least, f".{self.members[made]}")
            return
        texts = [self.given(value) or "" for value in values]
        parts = [re.fullmatch(r"(.*)\[(\d+)\](.*)", text) for text in texts]
        if all(parts) and len({(part[1], part[3]) for part in parts if part}) == 1 and parts[0]:
            self.cells[values] = Cells(parts[0][1], int(parts[0][2]) - loop.number(0), parts[0][3])
            self.memory |= {text: value for text, value in zip(texts, values, strict=True)}
            return
        if values[0] not in self.places:
            raise WrongLoop(f"{values[0]} is in no column")
        column, number = self.places[values[0]]
        members = self.columns[column]
        first = min(members)
        if column not in self.copies:
            stem = re.sub(r"\W+", "_", str(column[2])).strip("_")
            self.copies[column] = free_name(stem or "given", self.taken)
            given = [self.given(members[n]) or "0" if n in members else "0" for n in range(first, max(members) + 1)]
            self.memory |= {f"{self.copies[column]}[{n - first}]": node for n, node in members.items()}
            self.lines.append(f"const {self.scalar.real} {self.copies[column]}[{len(given)}] = {{{', '.join(given)}}};")
        self.cells[values] = Cells(self.copies[column], number - first - loop.number(0))

    # -- statements -----------------------------------------------------------------------------------------------

    def _print(self, node: Node) -> Printed:
        self._compute(node)
        return super()._print(node)

    def named(self, node: Node) -> str:
        """Return a name or literal for the node; introduce a name if it has none."""
        self._compute(node)
        return super().named(node)

    def assign(self, place: str, node: Node) -> None:
        """Assign the node to a place. A node without other uses gets no name."""
        self._compute(node)
        super().assign(place, node)

    def in_range(self, angle: Node, check: Callable[[str], str]) -> None:
        """Leave the function if an angle is out of range; loops do so themselves."""
        loop = self.owner.get(angle)
        if loop is None:
            super().in_range(angle, check)
        else:
            self._compute(angle)

    def _compute(self, node: Node) -> None:
        """Write the loop that computes the node, unless it is written."""
        loop = self.owner.get(node)
        if loop is not None and loop not in self.written:
            self.written.add(loop)
            self._write(loop)

    def _kept(self, loop: Repetition, values: tuple[Node, ...]) -> str:
        """Return the entry of a column in an iteration, after what no loop computes of it has been written there."""
        cells = self.cells[values]
        for value in values:
            self._compute(value)
        for k, value in enumerate(values):
            place = cells.at(loop.number(k))
            if cells.array == MADE and self.memory.get(place) is not value:
                if place in self.memory:
                    raise WrongLoop(f"two values for {place}")
                self.memory[place] = value
                self.lines.append(f"{place} = {self.named(value)};")
        return cells.index(0)

    def _run(self, loop: Repetition, stored: Mapping[int, str]) -> None:
        """Run a loop on the nodes, with the local array; each operation must have the arguments that it has without loops."""
        for k, each in enumerate(loop.rounds):
            for node, (first, arguments) in zip(each, loop.body, strict=True):
                found: list[Node | None] = []
                for argument in arguments:
                    match argument.origin:
                        case Origin.SAME:
                            found.append(argument.values[0])
                        case Origin.HERE:
                            found.append(each[argument.position])
                        case Origin.BEFORE:
                            found.append(loop.rounds[k - 1][argument.position] if k else loop.initial[argument.position])
                        case Origin.COLUMN:
                            found.append(self.memory.get(self.cells[argument.values].at(loop.number(k))))
                assert isinstance(node, Applied) and isinstance(first, Applied)
                same = tuple(found) == node.arguments
                same |= node.operation in COMMUTATIVE and tuple(found[::-1]) == node.arguments
                if node.operation is not first.operation or not same:
                    raise WrongLoop(f"{node} would be computed from other values")
            for p, name in stored.items():
                self.memory[f"{MADE}[{loop.number(k) - self.least}].{name}"] = each[p]

    def _write(self, loop: Repetition) -> None:
        scratch = Graph()
        texts: dict[Node, str] = {}
        initial = {p: self.text(node) for p, node in loop.initial.items()}
        carried = {p: self.results.get((loop, p)) or free_name(self._name(loop, p), self.taken) for p in initial}

        def given(argument: Argument) -> Node:
            if argument.origin is Origin.HERE:
                return body[argument.position]
            if argument.origin is Origin.SAME and isinstance(argument.values[0], Constant):
                return argument.values[0]
            if argument.origin is Origin.SAME:
                text = self.named(argument.values[0])
            elif argument.origin is Origin.BEFORE:
                text = carried[argument.position]
            else:
                text = self._kept(loop, argument.values)
            leaf = scratch.leaf(Group.STEP, text)
            texts[leaf] = text
            return leaf

        body: list[Node] = []
        for node, arguments in loop.body:
            assert isinstance(node, Applied)
            body.append(scratch.make(Applied, tuple(given(argument) for argument in arguments), node.operation))
        self.lines += [f"{self.scalar.real} {carried[p]} = {text};" for p, text in initial.items()]
        for at, name in self.results.items():
            if at[0] is loop and at[1] not in carried:
                self.lines.append(f"{self.scalar.real} {name} = 0;")
        about = {body[p]: self._about(loop, p) for p in range(len(body))}
        inside = _Body(self.admit, self.scalar, texts.get, {}, None, (), lambda node: about.get(node, ""))
        inside.taken, inside.temporaries = self.taken, self.temporaries
        outs = {p: name for (one, p), name in self.results.items() if one is loop} | carried
        stored = {p: name for (one, p), name in self.members.items() if one is loop}
        inside.plan([*(body[p] for p in stored), *(body[p] for p in outs)])
        for p in sorted({*stored, *outs}):
            if name := self._label(loop, p):
                inside.labels[body[p]] = name
        for p, name in stored.items():
            inside.assign(f"{MADE}[{shifted(-self.least)}].{name}", body[p])
        for p in outs:
            inside.named(body[p])
        for p, name in outs.items():
            inside.assign(name, body[p])
        self._run(loop, stored)
        last = loop.number(len(loop.rounds) - 1)
        step, relation = ("++", "<=") if loop.by > 0 else ("--", ">=")
        head = f"for (int {INDEX} = {loop.first}; {INDEX} {relation} {last}; {INDEX}{step}) {{"
        self.lines.append("\n".join([head, body_of(inside.lines), "}"]))
        for k, each in enumerate(loop.rounds):
            for p, node in enumerate(each):
                if p in stored:
                    self.names[node] = f"{MADE}[{loop.number(k) - self.least}].{stored[p]}"
                elif p in outs and k == len(loop.rounds) - 1:
                    self.names[node] = outs[p]

    def _about(self, loop: Repetition, position: int) -> str:
        """What a value of each iteration is, with the number of the iteration as an index."""
        if self.meaning is None:
            return ""
        return numbered(self.meaning(loop.rounds[1][position]), loop.number(1))


class _Body(Statements):
    """The statements of an iteration."""

    def __init__(self, admit: Callable[[str], str], *arguments: Any):
        super().__init__(*arguments)
        self.admit = admit

    def _sincos(self, angle: Node) -> None:
        if angle.arguments:
            self.lines.append(self.admit(self.named(angle)))
        super()._sincos(angle)


def numbered(text: str, number: int) -> str:
    """A text of an iteration with that number, with the index in place of the numbers at the end of names."""

    def name(found: re.Match[str]) -> str:
        shift = int(found[1]) - number
        return f"_({shifted(shift).replace(' ', '')})" if shift else f"_{INDEX}"

    return re.sub(r"_(\d+)(?=\b|_)", name, text)
