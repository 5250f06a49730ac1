"""C of a robot's reduced dynamics, the plant of a simulation: its header and its source."""

from collections.abc import Callable, Sequence

from ...model.mechanism import per_second
from ...model.names import in_c
from ..dynamics import ENTRIES, NEGLIGIBLE_PIVOT, DynamicsProgram, Entry
from ..graph import Node, count, headers, reachable
from ..program import Matrix, fixed_nodes
from .layout import body, c_linkage, comment, fill, guard_name, version_check
from .meaning import meanings, users
from .robot_c import struct, written_once
from .scalar import Scalar
from .statements import Statements

COLUMNS = ("bias", "qdot", "nudot")  # quantities that are arrays of one dimension
NAME = "dynamics"


class DynamicsC:
    """Text of a robot's dynamics in one scalar."""

    def __init__(self, program: DynamicsProgram, scalar: Scalar, banner: Sequence[str]):
        self.program, self.scalar, self.banner = program, scalar, list(banner)
        self.system = program.system
        self.meanings = meanings(program)
        self.robot = self.system.mechanism.name
        self.prefix = f"{self.robot}_{NAME}"
        self.type = scalar.name(self.prefix)
        self.state_type = scalar.name(f"{self.robot}_state")
        self.evaluation_type = scalar.name(f"{self.prefix}_evaluation")

    def files(self) -> dict[str, str]:
        """File name -> text."""
        return {f"{self.type}.h": self.header(), f"{self.type}.c": self.source()}

    def operations(self, entry: Entry) -> dict[str, int]:
        """Operations of an entry point's mathematics, without its checks; the runtime's loop not counted."""
        roots = self.program.entries[entry].roots
        fixed = fixed_nodes(roots)
        return count(node for node in reachable(roots) if not fixed[node])

    # -- header ---------------------------------------------------------------------------------------------------

    def declarations(self) -> str:
        """Types and prototypes, without anything for the preprocessor."""
        real = self.scalar.real
        evaluate = next(entry for entry in ENTRIES if entry.name == "evaluate")
        types = [
            struct(
                self.type,
                "The dynamics: made by init, owned by the caller, not to be written to.",
                [
                    ("int ready;", "set by init"),
                    *[(f"{real} {field};", self.meanings.constant(node)) for node, field in self.program.constants.items()],
                ],
            ),
            struct(
                self.evaluation_type,
                "The reduced equations at one state.",
                [(f"{real} {q}{self._shape(q)};", self._meaning(q)) for q in evaluate.answers],
            ),
        ]
        init = [
            "Makes the constants from parameters. Nothing else is kept: calls with the same `self` may run at the same time.",
            "NOSLIP_BAD_PARAMETER: a value is not finite or has the wrong sign. NOSLIP_SINGULAR: a motion without mass.",
        ]
        return "\n\n".join(
            [
                *types,
                "\n".join([comment(init), *fill(f"{self._init_signature()};", "")]),
                *["\n".join([self._about(entry), *fill(f"{self._signature(entry)};", "")]) for entry in ENTRIES],
            ]
        )

    def header(self) -> str:
        """The whole header."""
        file_name = f"{self.type}.h"
        guard = guard_name(file_name)
        lines = [comment([f"{file_name} - reduced dynamics of {self.robot}, {self.scalar.real}", *self.banner])]
        lines += [f"#ifndef {guard}", f"#define {guard}", "", f'#include "{self.scalar.name(self.robot)}.h"', ""]
        lines += [*version_check(file_name), ""]
        lines += [*c_linkage(self.declarations()), "", "#endif", ""]
        return "\n".join(lines)

    def _shape(self, quantity: str) -> str:
        p, n, r = self.system.freedom, len(self.system.mechanism.coordinates), len(self.system.mechanism.inputs)
        bounds = {"qdot": (n,), "Mbar": (p, p), "bias": (p,), "input_map": (p, r), "nudot": (p,)}[quantity]
        return "".join(f"[{bound}]" for bound in bounds)

    def _meaning(self, quantity: str) -> str:
        mechanism, motions = self.system.mechanism, self.system.quasi_velocities
        names, inputs = ", ".join(q.name for q in motions), ", ".join(q.name for q in mechanism.inputs)
        return {
            "qdot": "S nu, rates of " + ", ".join(f"{q.name} ({per_second(q.unit)})" for q in mechanism.coordinates),
            "Mbar": f"S'MS, rows and columns: {names}",
            "bias": f"S'(M Sdot nu + V), rows: {names}",
            "input_map": f"S'E, rows: {names}; columns: {inputs}",
            "nudot": "rates of " + ", ".join(f"{q.name} ({per_second(q.unit)})" for q in motions),
        }[quantity]

    def _about(self, entry: Entry) -> str:
        cost = ", ".join(f"{number} {operation}" for operation, number in self.operations(entry).items() if number)
        given = []
        if entry.takes_inputs:
            inputs = self.system.mechanism.inputs
            given = [f"tau[{len(inputs)}]: " + ", ".join(f"{q.name} ({q.unit})" for q in inputs)]
            given.append(f"NOSLIP_SINGULAR: a pivot of S'MS is not above {NEGLIGIBLE_PIVOT:g} of its place of the diagonal.")
        answers = [f"{q}{self._shape(q)}: {self._meaning(q)}" for q in entry.answers] if entry.name != "evaluate" else []
        return comment([f"{entry.about}.", *given, *answers, f"Operations: {cost or 'none'}."])

    # -- source ---------------------------------------------------------------------------------------------------

    def source(self) -> str:
        """The whole source."""
        bodies = self.program.entries.values()
        computed = [root for body in bodies for root in body.roots] + [node for pair in self.program.regular for node in pair]
        includes = [self.type, *headers(computed), *(["noslip_solve"] if any(b.looped for b in bodies) else [])]
        parts = [
            comment([f"{self.type}.c - reduced dynamics of {self.robot}, {self.scalar.real}", *self.banner])
            + "".join(f'\n#include "{name}.h"' for name in includes),
            self._init(),
            self._admit(),
            *[part for entry in ENTRIES for part in (self._mathematics(entry), self._entry_point(entry))],
        ]
        return "\n\n".join(parts) + "\n"

    def _init(self) -> str:
        program, name = self.program, self.scalar.name
        given = lambda n: f"params->{in_c(n.name)}" if n.operation == "leaf" else None  # noqa: E731
        leave = lambda condition: self.leave(condition, "NOSLIP_SINGULAR")  # noqa: E731
        writer = Statements(self.scalar, given, {}, leave, {"self", "params", "status"}, self.meanings.constant)
        writer.plan([*program.constants, *(node for pair in program.regular for node in pair)])
        for angle in program.fixed_angles:
            writer.lines.append(self.leave(f"!{self.in_range(writer.text(angle))}", "NOSLIP_RANGE"))
        for pivot, bound in program.regular:
            writer.not_singular(pivot, bound)
        for node, field in program.constants.items():
            writer.uses[node] = 1  # its field is its name
            writer.assign(f"self->{field}", node)
            if node.operation != "leaf":
                writer.names[node] = f"self->{field}"
        constants = [f"self->{field}" for node, field in program.constants.items() if node.operation != "leaf"]
        finite = " && ".join(f"{name('noslip_is_finite')}({constant})" for constant in constants)
        lines = [
            "int status;",
            self.leave("self == NULL", "NOSLIP_NULL"),
            "self->ready = 0;",
            f"status = {name(self.robot + '_check_params')}(params);",
            self.leave("status != NOSLIP_OK", "status"),
            *writer.lines,
            *([self.leave(f"!({finite})", "NOSLIP_BAD_PARAMETER")] if constants else []),
            "self->ready = NOSLIP_READY;",
            "return status;",
        ]
        return "\n".join([*fill(self._init_signature(), ""), "{", body(lines), "}"])

    def _admit(self) -> str:
        """The checks that entry points make first."""
        state = [f"state->{q.in_c}" for q in self.system.state]
        check = f"{self.scalar.name(self.robot + '_check_state')}(state)"
        finite = f"{self.scalar.name('noslip_is_finite')}({' + '.join(state)})"
        angles = " && ".join(self.in_range(f"state->{in_c(a.name)}") for a in self.program.angles if a.operation == "leaf")
        lines = [
            self.leave("self->ready != NOSLIP_READY", "NOSLIP_NOT_READY"),
            "/* A sum is finite only if all its parts are; one that overflows is looked at part by part. */",
            self.leave(f"!{finite} && {check} != NOSLIP_OK", "NOSLIP_NONFINITE"),
            f"return {angles} ? NOSLIP_OK : NOSLIP_RANGE;" if angles else "return NOSLIP_OK;",
        ]
        head = f"static int {self._function('admit')}(const {self.type} *self, const {self.state_type} *state)"
        return "\n".join([*fill(head, ""), "{", body(lines), "}"])

    def _mathematics(self, entry: Entry) -> str:
        """The static function that computes, for arguments that have been checked."""
        made = self.program.entries[entry]
        arguments = self._parameters(entry)
        places = [
            (node, self._place(entry, quantity, i, j))
            for quantity, matrix in made.quantities.items()
            for i, row in enumerate(matrix)
            for j, node in enumerate(row)
        ]
        used = users(places, self.program.labels)
        writer = _Call(self, {*arguments, "matrix"}, lambda node: self.meanings.temporary(node, used(node)))
        writer.plan(made.roots)
        for step in made.steps:
            writer.names[step.leaf] = writer.named(step.node)
            if step.bound is not None:
                writer.not_singular(step.node, step.bound)
                writer.guarded.add(step.leaf)
        for node, place in places:
            writer.assign(place, node)
        lines = writer.lines + (self._looped(writer, *made.looped) if made.looped else [])
        unused = [f"(void){name};" for name in arguments if not any(f"{name}->" in x or f"{name}[" in x for x in lines)]
        constants = self.meanings.legend(self.program.constants, lines)
        head = f"static int {self._function(entry.name)}_law({', '.join(arguments.values())})"
        return "\n".join([*fill(head, ""), "{", body([*unused, *constants, *lines, "return NOSLIP_OK;"]), "}"])

    def _looped(self, writer: Statements, matrix: Matrix, right: Matrix) -> list[str]:
        """The equations for the runtime's L D L'; nudot is their right-hand side first."""
        begin = len(writer.lines)
        p, name = len(matrix), self.scalar.name
        for i, row in enumerate(matrix):
            for j, node in enumerate(row[: i + 1]):
                writer.assign(f"matrix[{i * p + j}]", node)
        for i, (node,) in enumerate(right):
            writer.assign(f"nudot[{i}]", node)
        lines = [f"{self.scalar.real} matrix[{p * p}];", *writer.lines[begin:]]
        del writer.lines[begin:]
        lines.append(self.leave(f"{name('noslip_ldl')}(matrix, {p}) != NOSLIP_OK", "NOSLIP_SINGULAR"))
        return [*lines, f"{name('noslip_ldl_solve')}(matrix, nudot, {p});"]

    def _entry_point(self, entry: Entry) -> str:
        """The public function: checks, mathematics, a safe answer."""
        name = self.scalar.name
        arguments = list(self._parameters(entry))
        given = [argument for argument in arguments if argument in ("self", "state", "tau")]
        answers = [argument for argument in arguments if argument not in given]
        pieces = [piece for quantity in entry.answers for piece in self._pieces(entry, quantity)]
        lines = [
            *(f"{declared};" for declared in self._locals(entry)),
            "int status = NOSLIP_NULL;",
            self.leave(" || ".join(f"{answer} == NULL" for answer in answers), "NOSLIP_NULL"),
            f"if ({' && '.join(f'{argument} != NULL' for argument in given)}) {{\n"
            f"    status = {self._function('admit')}(self, state);\n}}",
        ]
        if entry.takes_inputs:
            finite = f"{name('noslip_all_finite')}(tau, {len(self.system.mechanism.inputs)})"
            lines.append(f"if (status == NOSLIP_OK && !{finite}) {{\n    status = NOSLIP_NONFINITE;\n}}")
        made = ["all"] if entry.name == "evaluate" else [f"made_{answer}" for answer in answers]
        call = f"{self._function(entry.name)}_law({', '.join([*given, *made])})"
        lines += written_once(self.scalar, call, pieces)
        return "\n".join([*fill(self._signature(entry), ""), "{", body(lines), "}"])

    def _locals(self, entry: Entry) -> list[str]:
        """Declarations of the local arrays in which the answers are made; those of evaluate would be too large."""
        if entry.name == "evaluate":
            return []
        return [f"{self.scalar.real} made_{quantity}{self._shape(quantity)}" for quantity in entry.answers]

    # -- pieces ---------------------------------------------------------------------------------------------------

    def _function(self, name: str) -> str:
        return self.scalar.name(f"{self.prefix}_{name}")

    def _signature(self, entry: Entry) -> str:
        return f"int {self._function(entry.name)}({', '.join(self._parameters(entry).values())})"

    def _init_signature(self) -> str:
        return f"int {self._function('init')}({self.type} *self, const {self.scalar.name(self.robot + '_params')} *params)"

    def _parameters(self, entry: Entry) -> dict[str, str]:
        """Names and declarations of an entry point's arguments."""
        real = self.scalar.real
        declared = {"self": f"const {self.type} *self", "state": f"const {self.state_type} *state"}
        if entry.takes_inputs:
            declared["tau"] = f"const {real} tau[{len(self.system.mechanism.inputs)}]"
        if entry.name == "evaluate":
            return declared | {"all": f"{self.evaluation_type} *all"}
        return declared | {quantity: f"{real} {quantity}{self._shape(quantity)}" for quantity in entry.answers}

    def _root(self, entry: Entry, quantity: str) -> str:
        return f"all->{quantity}" if entry.name == "evaluate" else quantity

    def _place(self, entry: Entry, quantity: str, i: int, j: int) -> str:
        return self._root(entry, quantity) + (f"[{i}]" if quantity in COLUMNS else f"[{i}][{j}]")

    def _pieces(self, entry: Entry, quantity: str) -> list[tuple[str, str, int]]:
        """The arrays in which a quantity is answered, as made and as given by the caller, each with its length; a matrix row by
        row."""
        root, shape = self._root(entry, quantity), [int(n) for n in self._shape(quantity)[1:-1].split("][")]
        made = root if entry.name == "evaluate" else f"made_{quantity}"
        if quantity in COLUMNS:
            return [(made, root, shape[0])]
        return [(f"{made}[{i}]", f"{root}[{i}]", shape[1]) for i in range(shape[0])]

    def leave(self, condition: str, answer: str) -> str:
        """A statement that leaves the function on a condition."""
        return f"if ({condition}) {{\n    return {answer};\n}}"

    def in_range(self, angle: str) -> str:
        """The condition under which an angle has a sine and a cosine."""
        return f"{self.scalar.name('noslip_angle_ok')}({angle})"

    def given(self, node: Node) -> str | None:
        """The C that stands for a node that need not be computed."""
        if node in self.program.constants:
            return f"self->{self.program.constants[node]}"
        if node.operation != "leaf" or node.group == "step":
            return None
        if node.group == "input":
            return f"tau[{[q.name for q in self.system.mechanism.inputs].index(node.name)}]"
        return f"{node.group}->{in_c(node.name)}"


class _Call(Statements):
    """The statements of an entry point; an angle that is no part of the state is looked at where it is used."""

    def __init__(self, text: DynamicsC, taken: set[str], meaning: Callable[[Node], str]):
        leave = lambda condition: text.leave(condition, "NOSLIP_SINGULAR")  # noqa: E731
        super().__init__(text.scalar, text.given, text.program.labels, leave, {*taken, "status"}, meaning)
        self.text_of = text

    def _sincos(self, angle: Node) -> None:
        if angle.operation != "leaf":
            self.lines.append(self.text_of.leave(f"!{self.text_of.in_range(self.named(angle))}", "NOSLIP_RANGE"))
        super()._sincos(angle)
