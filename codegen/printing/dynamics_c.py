"""C of the reduced dynamics of a robot, the plant of a simulation: header and source."""

from collections.abc import Callable, Sequence

from ...model.mechanism import Quantity, per_second
from ...model.names import in_c
from ..derivation.stages import Result
from ..dynamics import EVALUATE, NEGLIGIBLE_PIVOT, DynamicsProgram
from ..graph import Group, Leaf, Node, headers
from ..identity import DYNAMICS
from ..program import Entry, Matrix
from .layout import body, comment, fill
from .meaning import users
from .program_c import ProgramC, init_given
from .robot_c import struct, written_once
from .scalar import Scalar
from .statements import Statements


class DynamicsC(ProgramC[DynamicsProgram]):
    """The C of a robot's dynamics in one scalar."""

    local = "made_{}"

    def __init__(self, program: DynamicsProgram, scalar: Scalar, banner: Sequence[str]):
        super().__init__(program, program.system, DYNAMICS, scalar, banner)
        self.title = f"reduced dynamics of {self.robot}"

    # -- header ----------------------------------------------------------------------------------------------

    def declarations(self) -> str:
        """Return types and prototypes, without preprocessor directives."""
        real = self.scalar.real
        types = [
            struct(
                self.type,
                "The dynamics: initialized by init, owned by the caller, who does not write to it.",
                [
                    ("int ready;", "set by init"),
                    *[
                        (f"{real} {field};", self.meanings.constant(node))
                        for node, field in self.program.constants.items()
                    ],
                ],
            ),
            struct(
                self.evaluation_type,
                "The reduced equations at one state.",
                [(f"{real} {q}{self.shape(EVALUATE, q)};", self._meaning(q)) for q in EVALUATE.answers],
            ),
        ]
        init = [
            "Initializes the constants from parameters. There is no other state: calls with one `self` may "
            "be concurrent.",
            "NOSLIP_BAD_PARAMETER: a value is not finite or has the wrong sign. NOSLIP_SINGULAR: a motion "
            "without mass.",
        ]
        return "\n\n".join(
            [
                *types,
                "\n".join([comment(init), *fill(f"{self._init_signature()};", "")]),
                *[
                    "\n".join([self._about(entry), *fill(f"{self.signature(entry)};", "")])
                    for entry in self.entries
                ],
            ]
        )

    def shape(self, entry: Entry, quantity: Result) -> str:
        """Return the C array bounds of a quantity."""
        p, n, r = self.system.dof, len(self.system.mechanism.coordinates), self.inputs
        bounds = {
            Result.COORDINATE_RATES: (n,),
            Result.MASS: (p, p),
            Result.BIAS: (p,),
            Result.INPUT_MAP: (p, r),
            Result.VELOCITY_RATES: (p,),
        }[quantity]
        return "".join(f"[{bound}]" for bound in bounds)

    def _meaning(self, quantity: Result) -> str:
        mechanism, motions = self.system.mechanism, self.system.quasi_velocities
        names, inputs = ", ".join(q.name for q in motions), ", ".join(q.name for q in mechanism.inputs)
        return {
            Result.COORDINATE_RATES: "S nu, rates of "
            + ", ".join(f"{q.name} ({per_second(q.unit)})" for q in mechanism.coordinates),
            Result.MASS: f"S'MS, rows and columns: {names}",
            Result.BIAS: f"S'(M Sdot nu + V), rows: {names}",
            Result.INPUT_MAP: f"S'E, rows: {names}; columns: {inputs}",
            Result.VELOCITY_RATES: "rates of "
            + ", ".join(f"{q.name} ({per_second(q.unit)})" for q in motions),
        }[quantity]

    def _about(self, entry: Entry) -> str:
        lines = []
        if entry.takes:
            inputs = self.system.mechanism.inputs
            lines = [f"tau[{len(inputs)}]: " + ", ".join(f"{q.name} ({q.unit})" for q in inputs)]
            lines.append(
                f"NOSLIP_SINGULAR: a pivot of S'MS is not above {NEGLIGIBLE_PIVOT:g} of its place of the "
                "diagonal."
            )
        answers = [f"{q}{self.shape(entry, q)}: {self._meaning(q)}" for q in entry.answers if not entry.whole]
        return comment([f"{entry.about}.", *lines, *answers, self.cost(entry)])

    # -- source ----------------------------------------------------------------------------------------------

    def source(self) -> str:
        """Return the source."""
        bodies = self.program.entries.values()
        computed = [root for body in bodies for root in body.roots] + [
            node for pair in self.program.regular for node in pair
        ]
        includes = [
            self.type,
            *headers(computed),
            *(["noslip_solve"] if any(b.looped for b in bodies) else []),
        ]
        parts = [
            self._head(f"{self.type}.c", includes),
            self._init(),
            self._admit(),
            *[
                part
                for entry in self.entries
                for part in (self._mathematics(entry), self._entry_point(entry))
            ],
        ]
        return "\n\n".join(parts) + "\n"

    def _init(self) -> str:
        program, name = self.program, self.scalar.name
        taken = {"self", "params", "status"}
        writer = Statements(self.scalar, init_given, {}, self.leave, taken, self.meanings.constant)
        writer.plan([*program.constants, *(node for pair in program.regular for node in pair)])
        for angle in program.fixed_angles:
            writer.lines.append(self.leave(f"!{self.in_range(writer.text(angle))}", "NOSLIP_RANGE"))
        for pivot, bound in program.regular:
            writer.not_singular(pivot, bound)
        constants = writer.keep(program.constants)
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
        """Return the checks at the beginning of entry points."""
        state = [f"state->{q.in_c}" for q in self.system.state]
        check = f"{self.scalar.name(self.robot + '_check_state')}(state)"
        finite = f"{self.scalar.name('noslip_is_finite')}({' + '.join(state)})"
        angles = " && ".join(
            self.in_range(f"state->{in_c(a.name)}") for a in self.program.angles if isinstance(a, Leaf)
        )
        lines = [
            self.leave("self->ready != NOSLIP_READY", "NOSLIP_NOT_READY"),
            "/* A sum is finite only if all its parts are; one that overflows is looked at part by part. */",
            self.leave(f"!{finite} && {check} != NOSLIP_OK", "NOSLIP_NONFINITE"),
            f"return {angles} ? NOSLIP_OK : NOSLIP_RANGE;" if angles else "return NOSLIP_OK;",
        ]
        head = f"static int {self.function('admit')}(const {self.type} *self, const {self.state_type} *state)"
        return "\n".join([*fill(head, ""), "{", body(lines), "}"])

    def _mathematics(self, entry: Entry) -> str:
        """Return the static function that computes with checked arguments."""
        dynamics = self.program.entries[entry]
        arguments = self.parameters(entry)
        places = self.places(entry)
        used = users(places, self.program.labels)
        writer = _Call(self, {*arguments, "matrix"}, lambda node: self.meanings.temporary(node, used(node)))
        self.write(writer, entry, places)
        lines = writer.lines + (self._looped(writer, *dynamics.looped) if dynamics.looped else [])
        unused = [
            f"(void){name};"
            for name in arguments
            if not any(f"{name}->" in x or f"{name}[" in x for x in lines)
        ]
        constants = self.meanings.legend(self.program.constants, lines)
        head = f"static int {self.function(entry.name)}_law({', '.join(arguments.values())})"
        return "\n".join(
            [*fill(head, ""), "{", body([*unused, *constants, *lines, "return NOSLIP_OK;"]), "}"]
        )

    def write(self, writer: Statements, entry: Entry, places: Sequence[tuple[Node, str]]) -> None:
        """Write the statements of an entry point: its steps, and the nodes for their places."""
        dynamics = self.program.entries[entry]
        writer.plan(dynamics.roots)
        for step in dynamics.steps:
            writer.names[step.leaf] = writer.named(step.node)
            if step.bound is not None:
                writer.not_singular(step.node, step.bound)
                writer.guarded.add(step.leaf)
        for node, place in places:
            writer.assign(place, node)

    def _looped(self, writer: Statements, matrix: Matrix, right: Matrix) -> list[str]:
        """Return the equations for the runtime's L D L'; nudot initially contains their right-hand side."""
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
        """Return the public function: checks, computation, safe results."""
        name = self.scalar.name
        arguments = list(self.parameters(entry))
        inputs = [argument for argument in arguments if argument in ("self", "state", "tau")]
        answers = [argument for argument in arguments if argument not in inputs]
        lines = [
            *(f"{declared};" for declared in self._locals(entry)),
            "int status = NOSLIP_NULL;",
            self.leave(" || ".join(f"{answer} == NULL" for answer in answers), "NOSLIP_NULL"),
            f"if ({' && '.join(f'{argument} != NULL' for argument in inputs)}) {{\n"
            f"    status = {self.function('admit')}(self, state);\n}}",
        ]
        if entry.takes:
            finite = f"{name('noslip_all_finite')}(tau, {len(self.system.mechanism.inputs)})"
            lines.append(f"if (status == NOSLIP_OK && !{finite}) {{\n    status = NOSLIP_NONFINITE;\n}}")
        results = ["all"] if entry.whole else [self.local.format(answer) for answer in answers]
        call = f"{self.function(entry.name)}_law({', '.join([*inputs, *results])})"
        lines += written_once(self.scalar, call, self.pieces(entry))
        return "\n".join([*fill(self.signature(entry), ""), "{", body(lines), "}"])

    def _locals(self, entry: Entry) -> list[str]:
        """Return declarations of local arrays for the results; those of evaluate would be too large."""
        names = [] if entry.whole else entry.answers
        return [
            f"{self.scalar.real} {self.local.format(quantity)}{self.shape(entry, quantity)}"
            for quantity in names
        ]

    # -- parts -----------------------------------------------------------------------------------------------

    def _init_signature(self) -> str:
        return (
            f"int {self.function('init')}({self.type} *self, const "
            f"{self.scalar.name(self.robot + '_params')} *params)"
        )

    def parameters(self, entry: Entry, public: bool = False) -> dict[str, str]:
        """Return names and declarations of the arguments of an entry point."""
        real = self.scalar.real
        declared = {"self": f"const {self.type} *self", "state": f"const {self.state_type} *state"}
        if entry.takes:
            declared["tau"] = f"const {real} tau[{len(self.system.mechanism.inputs)}]"
        if entry.whole:
            return declared | {"all": f"{self.evaluation_type} *all"}
        return declared | {
            quantity: f"{real} {quantity}{self.shape(entry, quantity)}" for quantity in entry.answers
        }

    def array(self, leaf: Leaf) -> tuple[str, Sequence[Quantity]] | None:
        """Return the array of the inputs."""
        return ("tau", self.system.mechanism.inputs) if leaf.group is Group.INPUT else None


class _Call(Statements):
    """The statements of an entry point; an angle that is not part of the state is checked where it is
    used."""

    def __init__(self, text: DynamicsC, taken: set[str], meaning: Callable[[Node], str]):
        super().__init__(
            text.scalar, text.step_given, text.program.labels, text.leave, {*taken, "status"}, meaning
        )
        self.text_of = text

    def _sincos(self, angle: Node) -> None:
        if angle.arguments:
            self.lines.append(
                self.text_of.leave(f"!{self.text_of.in_range(self.named(angle))}", "NOSLIP_RANGE")
            )
        super()._sincos(angle)
