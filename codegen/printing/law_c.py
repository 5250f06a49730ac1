"""C of one control law: its header and its source."""

from collections.abc import Sequence

from ...model.mechanism import Quantity, per_second
from ...model.names import in_c
from ...model.outputs import FOOT
from ..graph import Node, count, headers, reachable
from ..program import ENTRIES, Entry, Program, fixed_nodes, hidden_inputs
from .layout import body, c_linkage, comment, fill, guard_name, version_check
from .meaning import meanings, users
from .robot_c import fields, refuse_parameters, struct, written_once
from .scalar import Scalar
from .statements import Statements

STEPS = {"step": "slope", "follow": "follow_slope"}  # a controller's step -> what it takes where the speed is given up
OUTPUTS = {  # quantity -> name in C
    "h": "h",
    "ydot": "ydot",
    "Phi": "Phi",
    "Phidot": "Phidot",
    "u": "u",
    "tau": "tau",
    "tau_of_demand": "tau",
    "slope": "slope",
}


def runtime_types(scalar: Scalar) -> str:
    """The C runtime's types that declarations use, for those who read them without its headers; its enums are ints."""
    foot = struct(scalar.name("noslip_foot"), "P_l and the vehicle, seen from the path.", fields(scalar, FOOT))
    return f"typedef int noslip_on_error;\ntypedef int noslip_on_limit;\n{foot}"


class LawC:
    """Text of one law in one scalar."""

    def __init__(self, program: Program, scalar: Scalar, banner: Sequence[str]):
        self.program = program
        self.law = program.law
        self.scalar = scalar
        self.banner = list(banner)
        self.robot = self.law.system.mechanism.name
        self.inputs = len(self.law.system.mechanism.inputs)
        self.prefix = f"{self.robot}_{self.law.name}"
        self.type = scalar.name(self.prefix)
        self.state_type = scalar.name(f"{self.robot}_state")
        self.entries = list(program.entries)
        self.meanings = meanings(program)

    def files(self) -> dict[str, str]:
        """File name -> text."""
        return {f"{self.type}.h": self.header(), f"{self.type}.c": self.source()}

    def answered(self, entry: Entry) -> list[str]:
        """The quantities an entry point answers."""
        return list(self.program.entries[entry].quantities)

    def operations(self, entry: Entry) -> dict[str, int]:
        """Operations of an entry point's mathematics, without its checks of input and limits."""
        return count(self._executed(self.program.entries[entry].roots))

    # -- header ---------------------------------------------------------------------------------------------------

    def declarations(self) -> str:
        """Types and prototypes, without anything for the preprocessor."""
        real, name, law, entry = self.scalar.real, self.scalar.name, self.law, self.entry("evaluate")
        rows = ", ".join(f"{row.name} ({row.unit})" for row in law.output.rows)
        types = [
            struct(
                name(f"{self.prefix}_config"),
                f"Where and what: {law.output.about}.",
                fields(self.scalar, law.config),
            ),
            struct(name(f"{self.prefix}_gains"), "Gains of the outer loop.", fields(self.scalar, law.gains)),
            struct(name(f"{self.prefix}_reference"), f"What the outputs {rows} shall do.", fields(self.scalar, law.reference)),
            struct(
                name(f"{self.prefix}_evaluation"),
                "All quantities of the law at one state.",
                [(f"{real} {OUTPUTS[q]}{self.shape(entry, q)};", self._meaning(q)) for q in self.answered(entry)],
            ),
            struct(
                self.type,
                "The law: made by init, owned by the caller, not to be written to.",
                [
                    (f"{real} limit[{self.inputs}];", "largest absolute values of the inputs"),
                    (f"{real} held[{self.inputs}];", "the inputs answered last"),
                    ("noslip_on_error on_error;", "what to answer then"),
                    *([("noslip_on_limit on_limit;", "NOSLIP_CUT or NOSLIP_SLOW")] if self.slows else []),
                    ("int ready;", "set by init"),
                    *[(f"{real} {field};", self.meanings.constant(node)) for node, field in self.program.constants.items()],
                ],
            ),
        ]
        functions = [self._prototype(entry) for entry in self.entries if entry.public]
        return "\n\n".join([*types, self._init_prototype(), self._reset_prototype(), *functions])

    def header(self) -> str:
        """The whole header of the law."""
        file_name = f"{self.type}.h"
        guard = guard_name(file_name)
        lines = [comment([f"{file_name} - {self.law.output.about}, {self.robot}, {self.scalar.real}", *self.banner])]
        lines += [f"#ifndef {guard}", f"#define {guard}", "", f'#include "{self.scalar.name(self.robot)}.h"', ""]
        lines += [*version_check(file_name), ""]
        lines += [*c_linkage(self.declarations()), "", "#endif", ""]
        return "\n".join(lines)

    @property
    def slows(self) -> bool:
        """Can a step give up the wanted speed to keep the path within the limits?"""
        return any(entry.name == "slope" for entry in self.entries)

    def entry(self, name: str) -> Entry:
        """An entry point by name."""
        return next(entry for entry in ENTRIES if entry.name == name)

    def shape(self, entry: Entry, quantity: str) -> str:
        """C array bounds of a quantity: a column has one, a matrix two (row major)."""
        matrix = self.program.entries[entry].quantities[quantity]
        return (
            f"[{len(matrix)}]"
            if len(matrix[0]) == 1 and quantity not in ("Phi", "Phidot")
            else f"[{len(matrix)}][{len(matrix[0])}]"
        )

    def _meaning(self, quantity: str) -> str:
        law = self.law
        rows = law.output.rows
        second = [row for row, degree in zip(rows, law.linearization.relative_degree, strict=True) if degree == 2]
        first = [q.name for q, degree in zip(law.demand, law.linearization.relative_degree, strict=True) if degree == 1]
        inputs = law.system.mechanism.inputs
        motions = law.system.quasi_velocities
        listed = {
            "h": ", ".join(f"{row.name} ({row.unit})" for row in rows),
            "ydot": ", ".join(f"{row.name}_rate ({per_second(row.unit)})" for row in second),
            "Phi": "rows: " + ", ".join(row.name for row in rows) + "; columns: " + ", ".join(q.name for q in motions),
            "Phidot": "as Phi, per second",
            "u": "wanted rates of " + ", ".join(f"{q.name} ({per_second(q.unit)})" for q in motions),
            "tau": ", ".join(f"{q.name} ({q.unit})" for q in inputs),
            "slope": ", ".join(f"{q.name} ({q.unit})" for q in inputs) + f", by {', '.join(first)}",
        }
        return listed[OUTPUTS[quantity]]

    def _prototype(self, entry: Entry) -> str:
        return self._about(entry) + "\n" + "\n".join(fill(self._signature(entry) + ";", ""))

    def _about(self, entry: Entry) -> str:
        counted = self.operations(entry)
        cost = ", ".join(f"{number} {operation}" for operation, number in counted.items() if number)
        answers = [f"{OUTPUTS[q]}{self.shape(entry, q)}: {self._meaning(q)}" for q in self.answered(entry)]
        if entry.name == "evaluate":
            answers = []
        wanted = (
            [f"v[{len(self.law.demand)}]: " + ", ".join(f"{q.name} ({q.unit})" for q in self.law.demand)]
            if entry.takes == "demand"
            else []
        )
        return comment([entry.about + ".", *wanted, *answers, *self._read(entry), f"Operations: {cost or 'none'}."])

    def _read(self, entry: Entry) -> list[str]:
        """What is read of the state, where that is not all."""
        if not (entry.at_foot and entry.public):
            return []
        place = ", ".join(q.name for q in self.law.config if q not in self._told_path())
        read = ", ".join(name for group, name in self._inputs(entry) if group == "state")
        return [f"Of the state it reads {read}; of config, which init has had, it needs {place}: it is one for all pieces."]

    def _told_path(self) -> Sequence[Quantity]:
        """The parameters that say where the path is."""
        return self.law.output.path.parameters if self.law.output.path else ()

    def _init_prototype(self) -> str:
        large = self.law.system.freedom > 2
        lines = [
            "Makes the law's constants from parameters. `options` may be NULL: no limits, zeros on an error.",
            "NOSLIP_BAD_PARAMETER: a value is not finite or has the wrong sign. NOSLIP_SINGULAR: Phi has no inverse anywhere.",
            *(["At a state: where 1 / (|Phi| |Phi^-1|), in the 1-norm and these units, is not above 1e-5."] if large else []),
            self._on_limit(),
        ]
        return comment(lines) + "\n" + "\n".join(fill(self._init_signature() + ";", ""))

    def _on_limit(self) -> str:
        row = self.law.speed_row
        if row is None:
            return "on_limit = NOSLIP_SLOW is NOSLIP_BAD_PARAMETER: it gives up one output of relative degree 1, a speed."
        demand = [q.name for q in self.law.demand]
        given_up = demand.pop(row)
        kept = f", and keeps {', '.join(demand)}" if demand else ""
        return f"on_limit = NOSLIP_SLOW gives up {given_up}{kept}, where the inputs would be beyond their limits."

    def _reset_prototype(self) -> str:
        return comment(["Forgets the inputs that are held."]) + f"\nint {self._function('reset')}({self.type} *self);"

    # -- source ---------------------------------------------------------------------------------------------------

    def source(self) -> str:
        """The whole source of the law."""
        program = self.program
        computed = [*program.conditions, *program.regular, *(root for law in program.entries.values() for root in law.roots)]
        includes = [self.type, *headers(computed)]
        parts = [
            comment([f"{self.type}.c - {self.law.output.about}, {self.robot}, {self.scalar.real}", *self.banner])
            + "".join(f'\n#include "{name}.h"' for name in includes),
            self._init(),
            self._reset(),
            *self._admits(),
            *[self._about(entry) + "\n" + self._mathematics(entry) for entry in self.entries if not entry.public],
            *[part for entry in self.entries if entry.public for part in (self._mathematics(entry), self._entry_point(entry))],
        ]
        return "\n\n".join(parts) + "\n"

    def _init(self) -> str:
        name, law = self.scalar.name, self.law
        taken = {"self", "params", "config", "gains", "options", "status"}
        leave = lambda condition: self._leave(condition, "NOSLIP_SINGULAR")  # noqa: E731
        writer = Statements(self.scalar, self._init_given, {}, leave, taken, self.meanings.constant)
        writer.plan([*self.program.conditions, *self.program.constants, *self.program.regular])
        for node in self.program.conditions:
            writer.lines.append(self._leave(f"!({writer.text(node)} > 0)", "NOSLIP_BAD_PARAMETER"))
        for angle in self.program.fixed_angles:
            writer.lines.append(self._leave(f"!{self._in_range(writer.text(angle))}", "NOSLIP_RANGE"))
        for node, field in self.program.constants.items():
            writer.uses[node] = 1  # its field is its name
            writer.assign(f"self->{field}", node)
            if node.operation != "leaf":
                writer.names[node] = f"self->{field}"
        constants = [f"self->{field}" for node, field in self.program.constants.items() if node.operation != "leaf"]
        for node in self.program.regular:
            writer.lines.append(self._leave(f"!({writer.text(node)} > 0)", "NOSLIP_SINGULAR"))
        finite = f"{name('noslip_is_finite')}({' + '.join(constants)})"
        on_limit = ["NOSLIP_CUT", "NOSLIP_SLOW"] if self.slows else ["NOSLIP_CUT"]
        refused = " && ".join(f"options->on_limit != {choice}" for choice in on_limit)
        return "\n".join(
            [
                *fill(self._init_signature(), ""),
                "{",
                "    int status;",
                "    if (self == NULL) {",
                "        return NOSLIP_NULL;",
                "    }",
                "    self->ready = 0;",
                "    if (config == NULL || gains == NULL) {",
                "        return NOSLIP_NULL;",
                "    }",
                f"    status = {name(self.robot + '_check_params')}(params);",
                "    if (status != NOSLIP_OK) {",
                "        return status;",
                "    }",
                f"    if ({refuse_parameters(self.scalar, 'config', law.config)} ||",
                f"        {refuse_parameters(self.scalar, 'gains', law.gains)}) {{",
                "        return NOSLIP_BAD_PARAMETER;",
                "    }",
                f"    status = {self._function('reset')}(self);",
                f"    if (options != NULL && (!{name('noslip_limits_ok')}(options->limit, {self.inputs}) ||",
                "        (options->on_error != NOSLIP_ZERO && options->on_error != NOSLIP_HOLD) ||",
                f"        ({refused}))) {{",
                "        return NOSLIP_BAD_PARAMETER;",
                "    }",
                *[
                    f"    self->limit[{k}] = {name('noslip_limit')}(options != NULL ? options->limit[{k}] : 0);"
                    for k in range(self.inputs)
                ],
                "    self->on_error = options != NULL ? options->on_error : NOSLIP_ZERO;",
                *(["    self->on_limit = options != NULL ? options->on_limit : NOSLIP_CUT;"] if self.slows else []),
                body(writer.lines),
                *([body([self._leave(f"!{finite}", "NOSLIP_BAD_PARAMETER")])] if constants else []),
                "    self->ready = NOSLIP_READY;",
                "    return status;",
                "}",
            ]
        )

    def _reset(self) -> str:
        zeros = [f"    self->held[{k}] = 0;" for k in range(self.inputs)]
        head = [
            f"int {self._function('reset')}({self.type} *self)",
            "{",
            "    if (self == NULL) {",
            "        return NOSLIP_NULL;",
            "    }",
        ]
        return "\n".join([*head, *zeros, "    return NOSLIP_OK;", "}"])

    def _admission(self, entry: Entry) -> str:
        """The call of the check that an entry point makes of what it is given; of a demand it makes its own."""
        return f"{self._function(self._admit_name(entry))}({', '.join(self._admitted(entry))})"

    def _admit_name(self, entry: Entry) -> str:
        if entry.at_foot:
            return "admit_foot"
        return "admit_both" if entry.takes == "reference" else "admit"

    def _admitted(self, entry: Entry) -> dict[str, str]:
        """The arguments that are checked, with their declarations; `self` as what is read only."""
        declared = self._parameters(entry)
        return {name: declared[name] for name in ("self", "foot", "state", "reference") if name in declared}

    def _admits(self) -> list[str]:
        """The checks that entry points make first, of all they are given but a demand: each once."""
        entries = {self._admit_name(entry): entry for entry in self.entries if entry.public}
        return [self._admit(entries[name]) for name in ("admit", "admit_both", "admit_foot") if name in entries]

    def _admit(self, entry: Entry) -> str:
        finite = self.scalar.name("noslip_is_finite")
        given = [(group, name) for group, name in self._inputs(entry) if group in self._admitted(entry)]
        whole_state = not entry.at_foot
        parts = [f"{finite}({group}->{in_c(name)})" for group, name in given if not (whole_state and group == "state")]
        refused = [f"{self.scalar.name(self.robot + '_check_state')}(state) != NOSLIP_OK"] if whole_state else []
        refused += [f"!({' && '.join(parts)})"] if parts else []
        either = f"({' || '.join(refused)})" if len(refused) > 1 else refused[0]
        lines = [self._leave("self->ready != NOSLIP_READY", "NOSLIP_NOT_READY")]
        lines.append("/* A sum is finite only if all its parts are; one that overflows is looked at part by part. */")
        total = " + ".join(f"{group}->{in_c(name)}" for group, name in given)
        lines.append(self._leave(f"!{finite}({total}) && {either}", "NOSLIP_NONFINITE"))
        in_range = " && ".join(self._in_range(angle) for angle in self._state_angles(entry))
        lines.append(f"return {in_range} ? NOSLIP_OK : NOSLIP_RANGE;" if in_range else "return NOSLIP_OK;")
        head = f"static int {self._function(self._admit_name(entry))}({', '.join(self._admitted(entry).values())})"
        return "\n".join([*fill(head, ""), "{", body(lines), "}"])

    def _mathematics(self, entry: Entry) -> str:
        """The static function that computes, for arguments that have been checked."""
        program = self.program
        leave = lambda condition: self._leave(condition, "NOSLIP_SINGULAR")  # noqa: E731
        law = program.entries[entry]
        used = users([*((node, "the test of Phi") for node in law.singular), *self._places(entry)], program.labels)
        taken, meaning = {*self._arguments(entry), "status"}, lambda node: self.meanings.temporary(node, used(node))
        writer = Statements(self.scalar, self._step_given, program.labels, leave, taken, meaning)
        writer.plan(law.roots)
        executed = self._executed(law.roots)
        for angle in program.angles:
            if angle.operation != "leaf" and angle in executed:
                writer.lines.append(self._leave(f"!{self._in_range(writer.named(angle))}", "NOSLIP_RANGE"))
        if law.singular:
            writer.not_singular(*law.singular)
        for node, place in self._places(entry):
            writer.assign(place, node)
        constants = self.meanings.legend(program.constants, writer.lines)
        unused = [f"(void){name};" for name in self._arguments(entry) if not any(_uses(line, name) for line in writer.lines)]
        head = f"static int {self._function(entry.name)}_law({', '.join(self._parameters(entry).values())})"
        return "\n".join([*fill(head, ""), "{", body([*unused, *constants, *writer.lines, "return NOSLIP_OK;"]), "}"])

    def _places(self, entry: Entry) -> list[tuple[Node, str]]:
        """What an entry point computes, and where it is written."""
        return [
            (node, self._place(entry, quantity) + (f"[{i}][{j}]" if "][" in self.shape(entry, quantity) else f"[{i}]"))
            for quantity, matrix in self.program.entries[entry].quantities.items()
            for i, row in enumerate(matrix)
            for j, node in enumerate(row)
        ]

    def _entry_point(self, entry: Entry) -> str:
        """The public function: checks, mathematics into a local object, then a safe answer, written once."""
        names = self._arguments(entry)
        answer, given = names[-1], names[:-1]
        pieces = self._pieces(entry)
        if entry.name in STEPS:
            return self._step(entry)
        lines = [*self._local(entry), "int status = NOSLIP_NULL;"]
        lines.append(self._leave(f"{answer} == NULL", "NOSLIP_NULL"))
        present = " && ".join(f"{name} != NULL" for name in given)
        lines.append(f"if ({present}) {{\n    status = {self._admission(entry)};\n}}")
        if entry.takes == "demand":
            finite = f"{self.scalar.name('noslip_all_finite')}(v, {len(self.law.demand)})"
            lines.append(f"if (status == NOSLIP_OK && !{finite}) {{\n    status = NOSLIP_NONFINITE;\n}}")
        call = f"{self._function(entry.name)}_law({', '.join([*given, 'all' if entry.name == 'evaluate' else 'made'])})"
        lines += written_once(self.scalar, call, pieces)
        return "\n".join([*fill(self._signature(entry), ""), "{", body(lines), "}"])

    def _local(self, entry: Entry) -> list[str]:
        """The declaration of the local array in which an entry point's answer is made; evaluate's would be too large."""
        if entry.name == "evaluate":
            return []
        kind, name = self._parameters(entry)[self._arguments(entry)[-1]].split(" ", 1)
        return [f"{kind} made{name[name.index('[') :]};"]

    def _step(self, entry: Entry) -> str:
        """The controller: first as if nothing were wrong, with checks that only then hold; else with care."""
        name = self.scalar.name
        names = self._arguments(entry)
        angles = self._state_angles(entry)
        hidden = [place for place in self._hidden(entry) if place not in angles]
        begin = [*(f"{argument} != NULL" for argument in names), "self->ready == NOSLIP_READY"]
        begin += [self._in_range(angle) for angle in angles]
        within = (f"{name('noslip_within')}(made[{k}], self->limit[{k}])" for k in range(self.inputs))
        end = ["status == NOSLIP_OK", *within]
        if hidden:
            end.append(f"{name('noslip_is_finite')}({' + '.join(hidden)})")
        fast = [
            f"status = {self._function(entry.name)}_law({', '.join([*names[:-1], 'made'])});",
            "/* Any other input that is not finite shows in the result. */",
            f"if ({' && '.join(end)}) {{",
            *[f"    {place}[{k}] = made[{k}];" for k in range(self.inputs) for place in ("tau", "self->held")],
            "    return NOSLIP_OK;",
            "}",
        ]
        slow = self._function(entry.name) + "_with_care"
        parameters = self._parameters(entry, public=True)
        made = f"{self.scalar.real} made[{self.inputs}]"
        care = [
            self._leave("tau == NULL", "NOSLIP_NULL"),
            "if (self == NULL || self->ready != NOSLIP_READY) {",
            f"    {name('noslip_write_zeros')}(tau, {self.inputs});",
            "    return self == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;",
            "}",
            f"if ({' && '.join(f'{given} != NULL' for given in names[1:-1])}) {{",
            f"    const int admitted = {self._admission(entry)};",
            "    status = admitted == NOSLIP_OK ? status : admitted;",
            "}",
            *(self._slow(STEPS[entry.name]) if self.slows else []),
            f"return {name('noslip_apply_limits')}(status, self->on_error, self->limit, self->held, made, tau, {self.inputs});",
        ]
        # by value, so that what is made stays in registers
        asked = [f"made_{k}" for k in range(self.inputs)]
        passed = [f"status == NOSLIP_OK ? made[{k}] : 0" for k in range(self.inputs)]
        care.insert(0, f"{made} = {{{', '.join(asked)}}};")
        lines = [f"{made};", "int status = NOSLIP_NULL;"]
        lines += [f"if ({' && '.join(begin)}) {{", *(f"    {line}" for line in fast), "}"]
        lines.append(f"return {slow}({', '.join([*names, 'status', *passed])});")
        declared = [*parameters.values(), "int status", *(f"{self.scalar.real} {name}" for name in asked)]
        head = f"static NOSLIP_COLD int {slow}({', '.join(declared)})"
        return "\n".join(
            ["/* The step when something is wrong, or cut: finds out what. */", *fill(head, ""), "{", body(care), "}", ""]
            + [*fill(self._signature(entry), ""), "{", body(lines), "}"]
        )

    def _slow(self, slope: str) -> list[str]:
        """Brings tau within the limits by giving up the speed."""
        given = self._arguments(next(entry for entry in self.entries if entry.name == slope))
        return [
            "if (status == NOSLIP_OK && self->on_limit == NOSLIP_SLOW) {",
            f"    {self.scalar.real} slope[{self.inputs}];",
            f"    status = {self._function(slope)}_law({', '.join(given)});",
            "    if (status == NOSLIP_OK) {",
            f"        status = {self.scalar.name('noslip_slow')}(made, slope, self->limit, {self.inputs});",
            "    }",
            "}",
        ]

    def _state_angles(self, entry: Entry) -> list[str]:
        """The parts of the state, as C, whose sine or cosine an entry point takes; before the foot was told, any of them."""
        angles = [angle for angle in self.program.angles if angle.operation == "leaf"]
        if entry.at_foot:
            executed = self._executed(self.program.entries[entry].roots)
            taken = {node.arguments[0] for node in executed if node.operation in ("sin", "cos")}
            angles = [angle for angle in angles if angle in taken]
        return [f"state->{in_c(angle.name)}" for angle in angles]

    def _in_range(self, angle: str) -> str:
        return f"{self.scalar.name('noslip_angle_ok')}({angle})"

    def _hidden(self, entry: Entry) -> list[str]:
        """Inputs, as C, whose being finite the result does not show."""
        used = reachable(self.program.entries[entry].roots)
        shown = {(n.group, n.name) for n in used if n.operation == "leaf"}
        shown -= {(n.group, n.name) for n in hidden_inputs(self.program.entries[entry])}
        return [f"{group}->{in_c(name)}" for group, name in self._inputs(entry) if (group, name) not in shown]

    def _inputs(self, entry: Entry) -> list[tuple[str, str]]:
        """What an entry point is given beside itself, by group and name: all of it, but at the foot only what it reads."""
        groups = {group: [q.name for q in self.law.groups[group]] for group in ("state", "reference")}
        if entry.at_foot:
            read = {n.name for n in reachable(self.program.entries[entry].roots) if n.operation == "leaf" and n.group == "state"}
            groups["state"] = [name for name in groups["state"] if name in read]
            groups["foot"] = [q.name for q in FOOT]
        return [(group, name) for group, names in groups.items() for name in names]

    # -- pieces ---------------------------------------------------------------------------------------------------

    def _function(self, name: str) -> str:
        return self.scalar.name(f"{self.prefix}_{name}")

    def _signature(self, entry: Entry) -> str:
        return f"int {self._function(entry.name)}({', '.join(self._parameters(entry, public=True).values())})"

    def _init_signature(self) -> str:
        name = self.scalar.name
        types = [
            (f"const {name(self.robot + '_params')}", "params"),
            (f"const {name(self.prefix + '_config')}", "config"),
            (f"const {name(self.prefix + '_gains')}", "gains"),
            (f"const {name(self.robot + '_options')}", "options"),
        ]
        return f"int {self._function('init')}({self.type} *self, {', '.join(f'{kind} *{argument}' for kind, argument in types)})"

    def _parameters(self, entry: Entry, public: bool = False) -> dict[str, str]:
        """Names and declarations of an entry point's arguments; only the public step may write to self."""
        real = self.scalar.real
        constant = "" if public and entry.name in STEPS else "const "
        declared = {"self": f"{constant}{self.type} *self"}
        if entry.at_foot:
            declared["foot"] = f"const {self.scalar.name('noslip_foot')} *foot"
        declared["state"] = f"const {self.state_type} *state"
        if entry.takes == "reference":
            declared["reference"] = f"const {self.scalar.name(self.prefix + '_reference')} *reference"
        if entry.takes == "demand":
            declared["v"] = f"const {real} v[{len(self.law.demand)}]"
        if entry.name == "evaluate":
            declared["all"] = f"{self.scalar.name(self.prefix + '_evaluation')} *all"
        else:
            (quantity,) = self.answered(entry)
            declared[OUTPUTS[quantity]] = f"{real} {OUTPUTS[quantity]}{self.shape(entry, quantity)}"
        return declared

    def _arguments(self, entry: Entry) -> list[str]:
        return list(self._parameters(entry))

    def _place(self, entry: Entry, quantity: str) -> str:
        return f"all->{OUTPUTS[quantity]}" if entry.name == "evaluate" else OUTPUTS[quantity]

    def _pieces(self, entry: Entry) -> list[tuple[str, str, int]]:
        """The arrays an entry point answers, as made and as given by the caller, each with its length; a matrix row by row."""
        pieces = []
        for quantity in self.answered(entry):
            matrix, place = self.program.entries[entry].quantities[quantity], self._place(entry, quantity)
            made = place if entry.name == "evaluate" else "made"
            rows = [(f"{made}[{i}]", f"{place}[{i}]", len(row)) for i, row in enumerate(matrix)]
            pieces += rows if "][" in self.shape(entry, quantity) else [(made, place, len(matrix))]
        return pieces

    def _leave(self, condition: str, answer: str) -> str:
        return f"if ({condition}) {{\n    return {answer};\n}}"

    def _init_given(self, node: Node) -> str | None:
        return f"{node.group}->{in_c(node.name)}" if node.operation == "leaf" else None

    def _step_given(self, node: Node) -> str | None:
        if node in self.program.constants:
            return f"self->{self.program.constants[node]}"
        if node.operation == "leaf" and node.group == "demand":
            return f"v[{[q.name for q in self.law.demand].index(node.name)}]"
        return f"{node.group}->{in_c(node.name)}" if node.operation == "leaf" else None

    def _executed(self, roots: Sequence[Node]) -> list[Node]:
        """The nodes a step computes, constants of init left out."""
        fixed = fixed_nodes(roots)
        return [node for node in reachable(roots) if not fixed[node]]


def _uses(line: str, name: str) -> bool:
    return f"{name}->" in line or f"{name}[" in line
