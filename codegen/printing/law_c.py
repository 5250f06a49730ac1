"""C of a control law: header and source."""

import re
from collections.abc import Sequence

from ...model.mechanism import Quantity, per_second
from ...model.names import in_c
from ...model.outputs import FOOT
from ..costs import LONG, code_bytes
from ..derivation.grip import is_wide, wheels_by_contact
from ..derivation.stages import Result
from ..graph import Group, Leaf, Node, angles, executed, headers, reachable
from ..program import EVALUATE, GROUND, GROUND_BY_INPUTS, NULL_INPUTS, SLOPE, WHEELS, Entry, Program, hidden_inputs
from .layout import body, comment, fill
from .meaning import users
from .program_c import ProgramC, init_given
from .robot_c import fields, refuse_parameters, struct, written_once
from .scalar import Scalar
from .statements import Statements


def runtime_types(scalar: Scalar) -> str:
    """Return the types of the C runtime that occur in declarations, for cffi; enums are ints."""
    foot = struct(
        scalar.name("noslip_foot"), "Position of the vehicle relative to the foot of P_l on a path.", fields(scalar, FOOT)
    )
    parts = {
        "friction": "mu margin share height period known error coarse lag",
        "grip": "weight height",
        "earned": "mu most given weight height period pause frequency rise after error coarse lag",
        "wheel": "rate expected per_mass radius away steps",
    }
    floor = [
        struct(
            scalar.name(f"noslip_{n}"),
            "",
            [(f"{scalar.real} {p};", "") for p in each.split()],
        )
        for n, each in parts.items()
    ]
    return "\n".join(["typedef int noslip_on_error;", "typedef int noslip_on_limit;", foot, *floor])


COMMANDS = {Result.COMMAND, Result.COMMAND_OF_V}
KINEMATIC_ABOUT = {
    "step": "The controller: outer loop and nu_c = Phi^-1 (v - drift), limits, safe outputs. It does not use nu.",
    "follow": "The step for a path given by the position relative to the foot of P_l.",
    "feedback": "Kinematic feedback nu_c = Phi^-1 (v - drift): from the virtual input v to the commanded quasi-velocities.",
}


class LawC(ProgramC[Program]):
    """The C of a law in one scalar."""

    def __init__(self, program: Program, scalar: Scalar, banner: Sequence[str]):
        self.law = program.law
        super().__init__(program, self.law.system, self.law.name, scalar, banner)
        self.inputs = len(self.law.inputs)
        self.title = f"{self.law.output.about}, {self.robot}"

    def returned(self, entry: Entry) -> list[Result]:
        """Return the quantities of the law that an entry point returns."""
        return list(self.program.entries[entry].quantities)

    # -- header ---------------------------------------------------------------------------------------------------

    def declarations(self) -> str:
        """Return types and prototypes, without preprocessor directives."""
        real, name, law = self.scalar.real, self.scalar.name, self.law
        rows = ", ".join(f"{row.name} ({row.unit})" for row in law.output.rows)
        what = "commands" if law.kinematic else "inputs"
        types = [
            struct(
                name(f"{self.prefix}_config"),
                f"Parameters of the outputs: {law.output.about}.",
                fields(self.scalar, law.config),
            ),
            struct(name(f"{self.prefix}_gains"), "Gains of the outer loop.", fields(self.scalar, law.gains)),
            struct(
                name(f"{self.prefix}_reference"), f"Desired values of the outputs {rows}.", fields(self.scalar, law.reference)
            ),
            struct(
                self.evaluation_type,
                "All quantities of the law at one state.",
                [(f"{real} {q.in_c}{self.shape(EVALUATE, q)};", self._meaning(q)) for q in self.returned(EVALUATE)],
            ),
            struct(
                self.type,
                "The law: initialized by init, owned by the caller, who does not write to it.",
                [
                    (f"{real} limit[{self.inputs}];", f"largest absolute values of the {what}"),
                    (f"{real} held[{self.inputs}];", f"last {what} returned"),
                    *([(f"{real} clear[{self.inputs}];", "inputs up to which nothing is left to check")] if self.grips else []),
                    ("noslip_on_error on_error;", "what to return on an error"),
                    *([("noslip_on_limit on_limit;", _listed(self.on_limit))] if len(self.on_limit) > 1 else []),
                    *([(f"{name('noslip_grip')} grip;", "of the floor, with NOSLIP_GRIP")] if self.grips else []),
                    *([(f"{name('noslip_earned')} earned;", "what is believed of it")] if self.grips else []),
                    *([(f"{name('noslip_wheel')} wheel[{self.wheels}];", "what shows it")] if self.wheels else []),
                    *([(f"{real} ground[{4 * self.contacts}];", "at the last step")] if self.wheels else []),
                    *self._extension_fields(),
                    ("int ready;", "set by init"),
                    *[(f"{real} {field};", self.meanings.constant(node)) for node, field in self.program.constants.items()],
                ],
            ),
        ]
        functions = [self._prototype(entry) for entry in self.entries if entry.public]
        prototypes = [self._init_prototype(), self._reset_prototype(), self._set_limits_prototype(), self._update_prototype()]
        return "\n\n".join([*types, *prototypes, *functions])

    def _extension_fields(self) -> list[tuple[str, str]]:
        """Return the fields of the states of the dynamic extension."""
        if not self.extends:
            return []
        states = ", ".join(f"{q.name} ({q.unit})" for q in self.law.extension)
        return [
            (f"{self.scalar.real} extension[{self.extends}];", f"states of the dynamic extension: {states}"),
            (f"{self.scalar.real} extension_rate[{self.extends}];", "their rates at the last step, 0 where it was limited"),
        ]

    @property
    def extends(self) -> int:
        """The number of states of the dynamic extension."""
        return len(self.law.extension)

    @property
    def slows(self) -> bool:
        """Whether a step can reduce the desired acceleration to keep the path within the limits."""
        return SLOPE in self.program.entries

    @property
    def grips(self) -> bool:
        """Whether a step can keep the wheels rolling."""
        return GROUND in self.program.entries

    @property
    def wheels(self) -> int:
        """The number of wheels by which friction is earned."""
        return len(wheels_by_contact(self.system)) if WHEELS in self.program.entries else 0

    @property
    def plain_grip(self) -> bool:
        """Whether the limiter of friction is that for two inputs, in closed form."""
        return self.inputs == 2 and not self.shapes

    @property
    def on_limit(self) -> list[str]:
        """The choices of on_limit."""
        return ["NOSLIP_CUT", *(["NOSLIP_SLOW"] if self.slows else []), *(["NOSLIP_GRIP"] if self.grips else [])]

    @property
    def contacts(self) -> int:
        """The number of contacts with the ground, supports included."""
        return len(self.system.mechanism.standing)

    @property
    def shapes(self) -> bool:
        """Whether inputs that do not change the motion shape the forces of the ground."""
        return NULL_INPUTS in self.program.entries

    def shape(self, entry: Entry, quantity: Result) -> str:
        """Return the C array bounds of a quantity: a column has one, a matrix two (row major)."""
        matrix = self.program.entries[entry].quantities[quantity]
        rows, columns = len(matrix), len(matrix[0])
        square = quantity in (Result.DECOUPLING, Result.DECOUPLING_RATE)
        return f"[{rows}][{columns}]" if columns > 1 or square else f"[{rows}]"

    def _meaning(self, quantity: Result) -> str:
        law = self.law
        rows = law.output.rows
        speed = "" if law.speed_row is None else law.virtual_input[law.speed_row].name
        inputs = law.inputs
        motions = law.system.quasi_velocities
        return {
            Result.OUTPUTS: ", ".join(f"{row.name} ({row.unit})" for row in rows),
            Result.RATES: ", ".join(f"{q.name} ({q.unit})" for q in law.rates),
            Result.DECOUPLING: "rows: "
            + ", ".join(law.linearization.row_names)
            + "; columns: "
            + ", ".join(law.linearization.inputs),
            Result.DECOUPLING_RATE: "as Phi, per second",
            Result.ACCELERATION: "desired rates of " + ", ".join(f"{q.name} ({per_second(q.unit)})" for q in motions),
            Result.INPUTS: ", ".join(f"{q.name} ({q.unit})" for q in inputs),
            Result.EXTENSION_RATE: "rates of " + ", ".join(f"{q.name} ({per_second(q.unit)})" for q in law.extension),
            Result.INPUTS_OF_V: ", ".join(f"{q.name} ({q.unit})" for q in inputs),
            Result.COMMAND: ", ".join(f"{q.name} ({q.unit})" for q in motions),
            Result.COMMAND_OF_V: ", ".join(f"{q.name} ({q.unit})" for q in motions),
            Result.GROUND: "along (N), across (N), shift (N/m), mass (kg) of " + self._contact_names(),
            Result.GROUND_BY_INPUTS: "along, across, shift of "
            + self._contact_names()
            + " by "
            + ", ".join(q.name for q in inputs),
            Result.WHEELS: "force (N), mass (kg) and radius (m) of each",
            Result.NULL_INPUTS: "rows of " + ", ".join(f"{q.name} ({q.unit})" for q in inputs),
            Result.SLOPE: ", ".join(f"{q.name} ({q.unit})" for q in inputs) + f", by {speed}",
        }[quantity]

    def _contact_names(self) -> str:
        return ", ".join(contact.name for contact in self.system.mechanism.standing)

    def _prototype(self, entry: Entry) -> str:
        return self._about(entry) + "\n" + "\n".join(fill(self.signature(entry) + ";", ""))

    def _about(self, entry: Entry) -> str:
        public = [q for q in self.returned(entry) if not entry.whole and not (entry.slope and q is Result.EXTENSION_RATE)]
        answers = [f"{q.in_c}{self.shape(entry, q)}: {self._meaning(q)}" for q in public]
        outputs = ", ".join(f"{q.name} ({q.unit})" for q in self.law.virtual_input)
        virtual = [f"v[{len(self.law.virtual_input)}]: {outputs}"] if entry.takes is Group.VIRTUAL_INPUT else []
        return comment([*self._purpose(entry), *virtual, *answers, *self._read(entry), self.cost(entry)])

    def _purpose(self, entry: Entry) -> list[str]:
        if self.law.kinematic and not COMMANDS.isdisjoint(self.returned(entry)) and not entry.whole:
            return [KINEMATIC_ABOUT[entry.name]]
        if not self.extends:
            return [entry.about + "."]
        if Result.RATES in entry.answers and not entry.whole:
            return ["Derivatives of the outputs below the highest, which the virtual input is."]
        if not entry.slope:
            return [entry.about + "."]
        return [
            entry.about + ", dynamic extension.",
            "First the states of the extension advance by dt (s), the time since the previous step, 0 at the first. Their rates",
            "are those of that step, or 0 unless it returned NOSLIP_OK: the states are held while inputs are limited.",
        ]

    def _read(self, entry: Entry) -> list[str]:
        """Return a comment on the part of the state that is read, if not all of it."""
        if not (entry.at_foot and entry.public):
            return []
        place = ", ".join(q.name for q in self.law.config if q not in self._path_parameters())
        read = ", ".join(name for group, name in self._inputs(entry) if group is Group.STATE)
        return [f"Uses only {read} of the state, and only {place} of the config given to init: one law serves all segments."]

    def _path_parameters(self) -> Sequence[Quantity]:
        """Return the parameters of the position of the path."""
        return self.law.output.path.parameters if self.law.output.path else ()

    def _init_prototype(self) -> str:
        large, loses = self.law.system.dof > 2, len(self.law.linearization.measures) > 1
        of_commands = "`options->limit` is of the commands, in the order of the quasi-velocities; friction is not used."
        lines = [
            "Initializes the law from parameters. `options` may be NULL: no limits, zeros on an error.",
            *([of_commands] if self.law.kinematic else []),
            "NOSLIP_BAD_PARAMETER: a value is not finite or has the wrong sign. NOSLIP_SINGULAR: Phi has no inverse anywhere.",
            *(["At a state: 1 / (|Phi| |Phi^-1|), in the 1-norm and these units, is not above 1e-5."] if large else []),
            *(["At a state too where S'E, by the same measure, has no inverse: inputs lose a direction."] if loses else []),
            self._on_limit(),
            *([self._on_grip()] if self.grips else []),
            *(["on_limit = NOSLIP_GRIP is NOSLIP_BAD_PARAMETER too: not with a dynamic extension."] if self.extends else []),
        ]
        return comment(lines) + "\n" + "\n".join(fill(self._init_signature() + ";", ""))

    def _on_limit(self) -> str:
        row = self.law.speed_row
        if row is None:
            of_speed = "that depends on the quasi-velocities" if self.law.kinematic else "of relative degree 1"
            return f"on_limit = NOSLIP_SLOW is NOSLIP_BAD_PARAMETER: it requires exactly one output {of_speed}, a speed."
        outputs = [q.name for q in self.law.virtual_input]
        given_up = outputs.pop(row)
        kept = f" and keeps {', '.join(outputs)}" if outputs else ""
        what = "commands" if self.law.kinematic else "inputs"
        return f"on_limit = NOSLIP_SLOW changes {given_up}{kept} if the {what} would exceed their limits."

    def _on_grip(self) -> str:
        wide = "" if is_wide(self.system) else " friction.height must be 0: an axle has no width to carry the moment."
        return f"on_limit = NOSLIP_GRIP keeps {self._contact_names()} rolling, see noslip_grip.h; it requires friction.mu.{wide}"

    def _reset_prototype(self) -> str:
        too = " and the states of the dynamic extension" if self.extends else ""
        return comment([f"Sets the held inputs{too} to zero."]) + f"\nint {self.function('reset')}({self.type} *self);"

    def _set_limits_prototype(self) -> str:
        lines = [
            "Changes the limits of the inputs, such as to what motors have left now. 0: no limit. Limits held inputs too.",
            "NOSLIP_BAD_PARAMETER: a limit is not finite or negative; then nothing changes.",
        ]
        return comment(lines) + f"\n{self._set_limits_signature()};"

    def _set_limits_signature(self) -> str:
        return f"int {self.function('set_limits')}({self.type} *self, const {self.scalar.real} limit[{self.inputs}])"

    def _update_prototype(self) -> str:
        held = "Held inputs and the states of the dynamic extension" if self.extends else "Held inputs"
        held += " and friction that is earned" if self.wheels else ""
        lines = [
            "Continues with parameters, config, gains and options of `next`, a law that init has accepted, between two steps.",
            f"{held} stay, within the new limits.",
            "NOSLIP_NOT_READY: one of the two is not initialized; then nothing changes.",
        ]
        return comment(lines) + f"\n{self._update_signature()};"

    def _update_signature(self) -> str:
        return f"int {self.function('update')}({self.type} *self, const {self.type} *next)"

    # -- source ---------------------------------------------------------------------------------------------------

    def source(self) -> str:
        """Return the source of the law."""
        program = self.program
        computed = [*program.conditions, *program.regular, *(root for law in program.entries.values() for root in law.roots)]
        includes = [self.type, *headers(computed), *(["noslip_shaping"] if self.grips and not self.plain_grip else [])]
        parts = [
            self._head(f"{self.type}.c", includes, own=self.grips, quick=True),
            *[self._about(WHEELS) + "\n" + self._mathematics(WHEELS) for _ in range(self.wheels > 0)],  # init calls it
            self._init(),
            self._reset(),
            self._set_limits(),
            self._update(),
            *self._admits(),
            *[
                self._about(entry) + "\n" + self._mathematics(entry)
                for entry in self.entries
                if not (entry.public or entry == WHEELS)
            ],
            *[part for entry in self.entries if entry.public for part in (self._mathematics(entry), self._entry_point(entry))],
        ]
        return "\n\n".join(parts) + "\n"

    def _init(self) -> str:
        name, law = self.scalar.name, self.law
        taken = {"self", "params", "config", "gains", "options", "status"}
        writer = Statements(self.scalar, init_given, {}, self.leave, taken, self.meanings.constant)
        writer.plan([*self.program.conditions, *self.program.constants, *self.program.regular])
        for node in self.program.conditions:
            writer.lines.append(self.leave(f"!({writer.text(node)} > 0)", "NOSLIP_BAD_PARAMETER"))
        for angle in self.program.fixed_angles:
            writer.lines.append(self.leave(f"!{self.in_range(writer.text(angle))}", "NOSLIP_RANGE"))
        constants = writer.keep(self.program.constants)
        for node in self.program.regular:
            writer.lines.append(self.leave(f"!({writer.text(node)} > 0)", "NOSLIP_SINGULAR"))
        finite = f"{name('noslip_is_finite')}({' + '.join(constants)})"
        refused = " && ".join(f"options->on_limit != {choice}" for choice in self.on_limit)
        return "\n".join(
            [
                *fill(f"NOSLIP_SMALL {self._init_signature()}", ""),
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
                f"    status = {self.function('reset')}(self);",
                f"    if (options != NULL && (!{name('noslip_limits_ok')}(options->limit, {self.inputs}) ||",
                "        (options->on_error != NOSLIP_ZERO && options->on_error != NOSLIP_HOLD) ||",
                f"        ({refused}){self._refused_friction()})) {{",
                "        return NOSLIP_BAD_PARAMETER;",
                "    }",
                *[self._limit(k, f"options != NULL ? options->limit[{k}] : 0") for k in range(self.inputs)],
                "    self->on_error = options != NULL ? options->on_error : NOSLIP_ZERO;",
                *(["    self->on_limit = options != NULL ? options->on_limit : NOSLIP_CUT;"] if len(self.on_limit) > 1 else []),
                *(self._init_grip() if self.grips else []),
                body(writer.lines),
                *([body([self.leave(f"!{finite}", "NOSLIP_BAD_PARAMETER")])] if constants else []),
                *self._init_wheels(),
                "    self->ready = NOSLIP_READY;",
                "    return status;",
                "}",
            ]
        )

    def _init_wheels(self) -> list[str]:
        """Return the statements that initialize the wheels, with the constants that init has computed."""
        if not self.wheels:
            return []
        init, real, zeros = self.scalar.name("noslip_wheel_init"), self.scalar.real, ", ".join(["0"] * self.inputs)
        lines = [f"    static const {real} none[{self.inputs}] = {{{zeros}}};", f"    {real} drive[{3 * self.wheels}];"]
        lines.append(f"    status = {self.function(WHEELS.name)}_law(self, NULL, none, drive);")
        lines += [f"    {init}(&self->wheel[{k}], &drive[{3 * k}]);" for k in range(self.wheels)]
        zero = f"{self.scalar.name('noslip_write_zeros')}(self->ground, {4 * self.contacts});"
        return ["    if (status == NOSLIP_OK) {", *(f"    {line}" for line in lines), "    }", f"    {zero}"]

    def _refused_friction(self) -> str:
        if not self.grips:
            return ""
        friction_ok, wide = self.scalar.name("noslip_friction_ok"), int(is_wide(self.system))
        return f" ||\n        (options->on_limit == NOSLIP_GRIP && !{friction_ok}(&options->friction, {wide}))"

    def _init_grip(self) -> list[str]:
        given = f"self->on_limit == NOSLIP_GRIP ? &options->friction : NULL, {self.wheels}"
        init = f"{self.scalar.name('noslip_grip_init')}(&self->earned, &self->grip, {given});"
        return [*self._clear(), *(f"    {line}" for line in fill(init, ""))]

    def _limit(self, k: int, value: str) -> str:
        return f"    self->limit[{k}] = {self.scalar.name('noslip_limit')}({value});"

    def _clear(self) -> list[str]:
        return [f"    self->clear[{k}] = self->on_limit == NOSLIP_GRIP ? -1 : self->limit[{k}];" for k in range(self.inputs)]

    def _keep_held(self, held: str) -> list[str]:
        """Return the statements that set the held inputs to an array, within the limits."""
        clip = self.scalar.name("noslip_clip")
        return [f"    self->held[{k}] = {clip}({held}[{k}], self->limit[{k}]);" for k in range(self.inputs)]

    def _set_limits(self) -> str:
        lines = [
            *fill(f"NOSLIP_SMALL {self._set_limits_signature()}", ""),
            "{",
            body([self.leave("self == NULL || limit == NULL", "NOSLIP_NULL")]),
            body([self.leave("self->ready != NOSLIP_READY", "NOSLIP_NOT_READY")]),
            body([self.leave(f"!{self.scalar.name('noslip_limits_ok')}(limit, {self.inputs})", "NOSLIP_BAD_PARAMETER")]),
            *[self._limit(k, f"limit[{k}]") for k in range(self.inputs)],
            *(self._clear() if self.grips else []),
            *self._keep_held("self->held"),
            "    return NOSLIP_OK;",
            "}",
        ]
        return "\n".join(lines)

    def _update(self) -> str:
        real = self.scalar.real
        kept = {"held": self.inputs} | ({"extension": self.extends, "extension_rate": self.extends} if self.extends else {})
        name = self.scalar.name
        arrays = f"{real} mu, pause, ground[{4 * self.contacts}];"
        earned = [f"{name('noslip_wheel')} wheel[{self.wheels}];", arrays] if self.wheels else []
        copies = [f"noslip_copy({member}, self->{member}, sizeof {member});" for member in ("wheel", "ground")]
        before = ["mu = self->earned.mu;", "pause = self->earned.pause;", *copies]
        after = [
            f"{name('noslip_believe')}(&self->earned, &self->grip, self->earned.period > 0 ? mu : self->earned.most);",
            "self->earned.pause = pause;",
            *(f"{name('noslip_wheel_continue')}(&self->wheel[{k}], &wheel[{k}]);" for k in range(self.wheels)),
            "noslip_copy(self->ground, ground, sizeof ground);",
        ]
        lines = [
            *(f"    {real} {name}[{count}];" for name, count in kept.items()),
            *(f"    {line}" for line in earned),
            body([self.leave("self == NULL || next == NULL", "NOSLIP_NULL")]),
            body([self.leave("self->ready != NOSLIP_READY || next->ready != NOSLIP_READY", "NOSLIP_NOT_READY")]),
            *(f"    {name}[{k}] = self->{name}[{k}];" for name, count in kept.items() for k in range(count)),
            *(f"    {line}" for line in before if earned),
            "    noslip_copy(self, next, sizeof *self);",
            *(f"    {line}" for line in after if earned),
            *self._keep_held("held"),
            *(f"    self->{name}[{k}] = {name}[{k}];" for name, count in kept.items() if name != "held" for k in range(count)),
            "    return NOSLIP_OK;",
        ]
        return "\n".join([*fill(f"NOSLIP_SMALL {self._update_signature()}", ""), "{", *lines, "}"])

    def _reset(self) -> str:
        zeros = [f"    self->held[{k}] = 0;" for k in range(self.inputs)]
        zeros += [f"    {self.scalar.name('noslip_expect_nothing')}(&self->earned);"] if self.wheels else []
        zeros += [f"    self->{name}[{k}] = 0;" for k in range(self.extends) for name in ("extension", "extension_rate")]
        head = [
            f"NOSLIP_SMALL int {self.function('reset')}({self.type} *self)",
            "{",
            "    if (self == NULL) {",
            "        return NOSLIP_NULL;",
            "    }",
        ]
        return "\n".join([*head, *zeros, "    return NOSLIP_OK;", "}"])

    def _admission(self, entry: Entry) -> str:
        """Return the call that checks the arguments of an entry point, except the virtual input, which it checks itself."""
        return f"{self.function(self._admit_name(entry))}({', '.join(self._admitted(entry))})"

    def _admit_name(self, entry: Entry) -> str:
        if entry.at_foot:
            return "admit_foot"
        return "admit_both" if entry.takes is Group.REFERENCE else "admit"

    def _admitted(self, entry: Entry) -> dict[str, str]:
        """Return the checked arguments with their declarations, those that the entry point reads; `self` is const."""
        declared, read = self.parameters(entry), {"self", *(group for group, _ in self._inputs(entry))}
        return {name: declared[name] for name in ("self", "foot", "state", "reference") if name in declared and name in read}

    def _admits(self) -> list[str]:
        """Return the functions that check the arguments of entry points, except the virtual input, each once."""
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
        lines = [self.leave("self->ready != NOSLIP_READY", "NOSLIP_NOT_READY")]
        lines.append("/* A sum is finite only if all its parts are; one that overflows is looked at part by part. */")
        total = " + ".join(f"{group}->{in_c(name)}" for group, name in given)
        lines.append(self.leave(f"!{finite}({total}) && {either}", "NOSLIP_NONFINITE"))
        in_range = " && ".join(self.in_range(angle) for angle in self._state_angles(entry))
        lines.append(f"return {in_range} ? NOSLIP_OK : NOSLIP_RANGE;" if in_range else "return NOSLIP_OK;")
        head = f"static int {self.function(self._admit_name(entry))}({', '.join(self._admitted(entry).values())})"
        return "\n".join([*fill(head, ""), "{", body(lines), "}"])

    def _mathematics(self, entry: Entry) -> str:
        """Return the static function that computes with checked arguments."""
        program = self.program
        law = program.entries[entry]
        tested = zip(law.singular, ["the test of Phi"] * 2 + ["the test of S'E"] * 2, strict=False)
        used = users([*tested, *self.places(entry)], program.labels)
        taken, meaning = {*self._arguments(entry), "status"}, lambda node: self.meanings.temporary(node, used(node))
        writer = Statements(self.scalar, self.step_given, program.labels, self.leave, taken, meaning)
        self.write(writer, entry, self.places(entry))
        constants = self.meanings.legend(program.constants, writer.lines)
        unused = [f"(void){name};" for name in self._arguments(entry) if not any(_uses(line, name) for line in writer.lines)]
        beside = entry.near or (entry == GROUND and code_bytes(law.roots) > LONG)
        kind = "static NOSLIP_BESIDE" if beside else "NOSLIP_HOT" if entry in (GROUND, WHEELS) else "static"
        head = f"{kind} int {self.function(entry.name)}_law({', '.join(self.parameters(entry).values())})"
        return "\n".join([*fill(head, ""), "{", body([*unused, *constants, *writer.lines, "return NOSLIP_OK;"]), "}"])

    def write(self, writer: Statements, entry: Entry, places: Sequence[tuple[Node, str]]) -> None:
        """Write the statements of an entry point: its tests, and the nodes for their places."""
        law = self.program.entries[entry]
        writer.plan(law.roots)
        used = executed(law.roots)
        for angle in self.program.angles:
            if angle.arguments and angle in used:
                writer.in_range(angle, self.admit_angle)
        if law.band:
            outside, edge = (writer.text(node) for node in law.band)
            writer.lines.append("/* Within the band the inverse of Phi is damped. */")
            writer.lines.append(self.leave(f"!({outside} > {edge})", self._near(entry)))
        for k in range(0, len(law.singular), 2):
            writer.not_singular(law.singular[k], law.singular[k + 1], law.margin if k == 0 else None)
        for node, place in places:
            writer.assign(place, node)

    def admit_angle(self, angle: str) -> str:
        """Return the statement that leaves the function if an angle is out of range."""
        return self.leave(f"!{self.in_range(angle)}", "NOSLIP_RANGE")

    def _near(self, entry: Entry) -> str:
        """Return the call of what takes the place of an entry point within the band of a damped law."""
        return f"{self.function(entry.within.name)}_law({', '.join(self._arguments(entry))})"

    def _entry_point(self, entry: Entry) -> str:
        """Return the public function: checks, computation into a local object, then safe results, written once."""
        names = self._arguments(entry)
        answer, given = names[-1], names[:-1]
        pieces = self.pieces(entry)
        if entry.slope:
            return self._extended_step(entry) if self.extends else self._step(entry, entry.slope)
        lines = [*self._local(entry), "int status = NOSLIP_NULL;"]
        lines.append(self.leave(f"{answer} == NULL", "NOSLIP_NULL"))
        present = " && ".join(f"{name} != NULL" for name in given)
        lines.append(f"if ({present}) {{\n    status = {self._admission(entry)};\n}}")
        if entry.takes in (Group.VIRTUAL_INPUT, Group.INPUT):
            array = f"v, {len(self.law.virtual_input)}" if entry.takes is Group.VIRTUAL_INPUT else f"tau, {self.inputs}"
            finite = f"{self.scalar.name('noslip_all_finite')}({array})"
            lines.append(f"if (status == NOSLIP_OK && !{finite}) {{\n    status = NOSLIP_NONFINITE;\n}}")
        call = f"{self.function(entry.name)}_law({', '.join([*given, 'all' if entry.name == 'evaluate' else 'made'])})"
        lines += written_once(self.scalar, call, pieces)
        return "\n".join([*fill(f"NOSLIP_SMALL {self.signature(entry)}", ""), "{", body(lines), "}"])

    def _local(self, entry: Entry) -> list[str]:
        """Return the declaration of the local array for the results of an entry point; that of evaluate would be too large."""
        if entry.whole:
            return []
        kind, name = self.parameters(entry)[self._arguments(entry)[-1]].split(" ", 1)
        return [f"{kind} made{name[name.index('[') :]};"]

    def _step(self, entry: Entry, slope: Entry) -> str:
        """Return the controller: first the common case, with fewer checks that are sufficient there; else a function for inputs
        that are beyond a limit and one for errors."""
        names, function, count = self._arguments(entry), self.function(entry.name), self.inputs
        before, after = self.ordinary(entry)
        given = [name for name in names if name != "reference" or any("reference->" in place for place in after)]
        asked = [f"made_{k}" for k in range(count)]  # by value, so that the results stay in registers
        declared = self.parameters(entry, public=True)
        results = [*(declared[name] for name in given), *(f"{self.scalar.real} {one}" for one in asked)]
        written = [f"    {place}[{k}] = made[{k}];" for k in range(count) for place in (names[-1], "self->held")]
        written.append("    return NOSLIP_OK;")
        limited, beyond = f"{function}_limited", f"{function}_with_grip" if self.grips else f"{function}_limited"
        fast = [
            f"status = {function}_law({', '.join([*names[:-1], 'made'])});",
            "/* Any other input that is not finite shows in the result. */",
            f"if ({' && '.join(['status == NOSLIP_OK', *after])}) {{",
            *written,
            "}",
            "if (status == NOSLIP_OK) {",
            f"    return {beyond}({', '.join([*given, *(f'made[{k}]' for k in range(count))])});",
            "}",
        ]
        lines = [f"{self.scalar.real} made[{count}];", "int status = NOSLIP_NULL;"]
        lines.append(f"if ({' && '.join([*(f'{argument} != NULL' for argument in names), *before])}) {{")
        lines += [*(f"    {line}" for line in fast), "}", f"return {function}_refused({', '.join([*names, 'status'])});"]
        texts = [*self._refused(entry), *self._limited(entry, slope, given, asked)]
        if self.grips:
            rolls = [*self._within("limit"), *after[count:], self._rolls()]
            with_grip = [
                f"const {self.scalar.real} made[{count}] = {{{', '.join(asked)}}};",
                self._ground,
                *self._earn(),
                f"if ({' && '.join(rolls)}) {{",
                *(f"    {line}" for line in self._expect()),
                *written,
                "}",
                f"return {limited}({', '.join([*given, *asked])});",
            ]
            texts.append("/* The step with NOSLIP_GRIP: is each contact within friction? */")
            texts += [*fill(f"static NOSLIP_BESIDE int {beyond}({', '.join(results)})", ""), "{", body(with_grip), "}", ""]
        return "\n".join([*texts, *fill(self.signature(entry), ""), "{", body(lines), "}"])

    def _refused(self, entry: Entry) -> list[str]:
        """Return the function for a step that cannot be computed; it finds out why."""
        names = self._arguments(entry)
        zeros = f"{self.scalar.name('noslip_write_zeros')}({names[-1]}, {self.inputs})"
        lines = [
            self.leave(f"{names[-1]} == NULL", "NOSLIP_NULL"),
            "if (self == NULL || self->ready != NOSLIP_READY) {",
            f"    {zeros};",
            "    return self == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;",
            "}",
            f"if ({' && '.join(f'{given} != NULL' for given in names[1:-1])}) {{",
            f"    const int admitted = {self._admission(entry)};",
            "    status = admitted == NOSLIP_OK ? status : admitted;",
            "}",
            *([f"{self.scalar.name('noslip_expect_nothing')}(&self->earned);"] if self.wheels else []),
            f"return {self._applied('self->held', names[-1])};",
        ]
        declared = [*self.parameters(entry, public=True).values(), "int status"]
        head = f"static NOSLIP_BESIDE int {self.function(entry.name)}_refused({', '.join(declared)})"
        return ["/* The step when something is wrong: finds out what. */", *fill(head, ""), "{", body(lines), "}", ""]

    def _limited(self, entry: Entry, slope: Entry, given: Sequence[str], asked: Sequence[str]) -> list[str]:
        """Return the function for a step whose inputs are not finite, or are to be limited."""
        real, name = self.scalar.real, self.scalar.name
        finite = [f"{name('noslip_is_finite')}({one})" for one in asked]
        finite += [f"{name('noslip_is_finite')}({place})" for place in self._hidden_besides_headings(entry)]
        lines = [
            f"int status = {' && '.join(finite)} ? NOSLIP_OK : NOSLIP_NONFINITE;",
            *(self._slow(slope) if self.slows else []),
            *(self._grip(slope) if self.grips else []),
            f"return {self._applied('made', given[-1])};",
        ]
        unused = [f"(void){one};" for one in given if not re.search(rf"\b{one}\b", " ".join(lines))]
        declared = self.parameters(entry, public=True)
        parameters = [*(declared[one] for one in given), *(f"{real} {one}" for one in asked)]
        head = f"static NOSLIP_COLD int {self.function(entry.name)}_limited({', '.join(parameters)})"
        lines = [f"{real} made[{self.inputs}] = {{{', '.join(asked)}}};", *unused, *lines]
        return ["/* The step with inputs that are not finite, or beyond a limit. */", *fill(head, ""), "{", body(lines), "}", ""]

    def _applied(self, inputs: str, answer: str) -> str:
        """Return the call that ends a step with these inputs, written to `answer`."""
        given = f"status, self->on_error, self->limit, self->held, {inputs}, {answer}, {self.inputs}"
        return f"{self.scalar.name('noslip_apply_limits')}({given})"

    def ordinary(self, entry: Entry) -> tuple[list[str], list[str]]:
        """Return the C conditions before and after the law under which a step needs no further checks: of the result, last of
        inputs that it need not show."""
        hidden = self._hidden_besides_headings(entry)
        before = ["self->ready == NOSLIP_READY", *(self.in_range(angle) for angle in self._state_angles(entry))]
        seen = [f"{self.scalar.name('noslip_is_finite')}({' + '.join(hidden)})"] if hidden else []
        return before, [*self._within("clear" if self.grips else "limit"), *seen]

    def argument(self, group: Group, name: str) -> str:
        """Return the C of a member of an argument of an entry point."""
        return f"{group}->{in_c(name)}"

    def _extended_step(self, entry: Entry) -> str:
        """Return the controller with a dynamic extension: all checks, the states advanced, the law."""
        name, real, count = self.scalar.name, self.scalar.real, self.extends
        given = [argument for argument in self.parameters(entry, public=True) if argument not in ("self", "tau")]
        advanced = [f"    self->extension[{k}] += dt * self->extension_rate[{k}];" for k in range(count)]
        passed = ["rate" if argument == Result.EXTENSION_RATE.in_c else argument for argument in self._arguments(entry)]
        finite = f"{name('noslip_all_finite')}"
        lines = [
            f"{real} made[{self.inputs}] = {{{', '.join(['0'] * self.inputs)}}};",
            f"{real} rate[{count}] = {{{', '.join(['0'] * count)}}};",
            "int status = NOSLIP_NULL;",
            self.leave("tau == NULL", "NOSLIP_NULL"),
            "if (self == NULL || self->ready != NOSLIP_READY) {",
            f"    {name('noslip_write_zeros')}(tau, {self.inputs});",
            "    return self == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;",
            "}",
            f"if ({' && '.join(f'{one} != NULL' for one in given if one != 'dt')}) {{",
            f"    status = {self._admission(entry)};",
            "}",
            f"if (status == NOSLIP_OK && !{name('noslip_is_finite')}(dt)) {{",
            "    status = NOSLIP_NONFINITE;",
            "}",
            "if (status == NOSLIP_OK && dt < 0) {",
            "    status = NOSLIP_BAD_PARAMETER;",
            "}",
            "if (status == NOSLIP_OK) {",
            *advanced,
            f"    status = {self.function(entry.name)}_law({', '.join([*passed[:-1], 'made'])});",
            "}",
            f"if (status == NOSLIP_OK && !({finite}(rate, {count}) && {finite}(self->extension, {count}))) {{",
            "    status = NOSLIP_NONFINITE;",
            "}",
            f"status = {name('noslip_apply_limits')}(status, self->on_error, self->limit, self->held, made, tau, {self.inputs});",
            *[f"self->extension_rate[{k}] = status == NOSLIP_OK ? rate[{k}] : 0;" for k in range(count)],
            "return status;",
        ]
        return "\n".join([*fill(self.signature(entry), ""), "{", body(lines), "}"])

    def _slow(self, slope: Entry) -> list[str]:
        """Return the statements that bring tau within the limits by reducing the speed."""
        given = self._arguments(slope)
        return [
            "if (status == NOSLIP_OK && self->on_limit == NOSLIP_SLOW) {",
            f"    {self.scalar.real} slope[{self.inputs}];",
            f"    status = {self.function(slope.name)}_law({', '.join(given)});",
            "    if (status == NOSLIP_OK) {",
            f"        status = {self.scalar.name('noslip_slow')}(made, slope, self->limit, {self.inputs});",
            "    }",
            "}",
        ]

    def _within(self, limit: str) -> list[str]:
        """Return the C conditions that the inputs made are within an array of the struct."""
        return [f"{self.scalar.name('noslip_within')}(made[{k}], self->{limit}[{k}])" for k in range(self.inputs)]

    def _rolls(self) -> str:
        """Return the C condition that the inputs made keep every contact within friction; computes `ground`."""
        holds = self.scalar.name("noslip_holds")
        parts = [f"{self.function(GROUND.name)}_law(self, state, made, ground) == NOSLIP_OK"]
        places = [f"&ground[{4 * k}]" if k else "ground" for k in range(self.contacts)]
        return " && ".join(parts + [f"{holds}({place}, &self->grip)" for place in places])

    @property
    def _ground(self) -> str:
        """The declaration of the memory for the forces of a step; it is in the law where wheels are compared with them."""
        real = self.scalar.real
        return f"{real} *const ground = self->ground;" if self.wheels else f"{real} ground[{4 * self.contacts}];"

    def _earn(self) -> list[str]:
        """Return the statements that compare the rates of the wheels with what the last step expects."""
        if not self.wheels:
            return []
        name, wheels = self.scalar.name, wheels_by_contact(self.system)
        names = [wheel and self.system.quasi_velocities[wheel.velocity].name for wheel in wheels.values()]
        rates = ", ".join(self.argument(Group.STATE, name) if name else "0" for name in names)
        ground = f"&self->ground[{4 * first}]" if (first := min(wheels)) else "self->ground"
        return [
            "if (self->earned.period > 0) {",
            f"    const {self.scalar.real} rates[{self.wheels}] = {{{rates}}};",
            f"    {name('noslip_earn')}(&self->earned, &self->grip, self->wheel, {ground}, rates, {self.wheels});",
            "}",
        ]

    def _expect(self, memory: str = "drive") -> list[str]:
        """Return the statements that keep what the inputs made, with the forces `ground`, let the wheels do; `memory`: an array
        for 3 numbers for each wheel, of their own or one that is there.
        """
        if not self.wheels:
            return []
        expect = self.scalar.name("noslip_expect")
        kept = [
            f"{expect}(&self->wheel[{k}], &ground[{4 * contact}], &{memory}[{3 * k}]);"
            for k, (contact, wheel) in enumerate(wheels_by_contact(self.system).items())
            if wheel
        ]
        law = f"{self.function(WHEELS.name)}_law(self, state, made, {memory}) == NOSLIP_OK"
        return [
            "if (self->earned.period > 0) {",
            *([f"    {self.scalar.real} drive[{3 * self.wheels}];"] if memory == "drive" else []),
            f"    if ({law}) {{",
            *(f"        {line}" for line in kept),
            "    }",
            "}",
        ]

    def _grip(self, slope: Entry) -> list[str]:
        """Return the statements that change tau so that the wheels keep rolling, within the limits."""
        real, name, count = self.scalar.real, self.scalar.name, self.inputs
        arrays = {"by_inputs": f"[{3 * self.contacts}][{count}]"}
        calls = [f"{self.function(GROUND.name)}_law(self, state, made, ground)"]
        calls.append(f"{self.function(GROUND_BY_INPUTS.name)}_law(self, state, by_inputs)")
        if self.slows:
            arrays["slope"] = f"[{count}]"
            calls.append(f"{self.function(slope.name)}_law({', '.join(self._arguments(slope))})")
        along, rest = "slope" if self.slows else "NULL", f"ground, by_inputs[0], &self->grip, self->limit, {self.contacts}"
        keep_grip = f"{name('noslip_keep_grip')}(made, {along}, {rest}, work)"
        arrays["work"] = f"[{3 * self.contacts + (0 if self.plain_grip else count * (count + 3))}]"
        if self.shapes:
            arrays["null_inputs"] = f"[{count}][{count}]"
            calls.append(f"{self.function(NULL_INPUTS.name)}_law(self, state, null_inputs)")
        if not self.plain_grip:
            free = "null_inputs[0]" if self.shapes else "NULL"
            keep_grip = f"{name('noslip_keep_grip_of')}(made, {along}, {free}, {rest}, {count}, work)"
        return [
            "if (status == NOSLIP_OK && self->on_limit == NOSLIP_GRIP) {",
            f"    {self._ground}",
            *(f"    {real} {array}{shape};" for array, shape in arrays.items()),
            f"    status = {calls[0]};",
            *(f"    status = status == NOSLIP_OK ? {call} : status;" for call in calls[1:]),
            "    if (status == NOSLIP_OK) {",
            f"        status = {keep_grip} && {self._rolls()} ? NOSLIP_GRIP_LIMITED : NOSLIP_WILL_SLIP;",
            *(f"        {line}" for line in self._expect("work")),
            "    }",
            "}",
        ]

    def _state_angles(self, entry: Entry) -> list[str]:
        """Return the entries of the state, as C, whose range an entry point checks: those in a sine or cosine."""
        taken = angles(executed(self._read_by(entry))) if entry.at_foot else self.program.angles
        leaves = [angle for angle in self.program.angles if isinstance(angle, Leaf) and angle in taken]
        return [self.argument(leaf.group, leaf.name) for leaf in leaves]

    def _read_by(self, entry: Entry) -> list[Node]:
        """Return what an entry point computes; for a step the forces at the contacts too."""
        too = [GROUND, GROUND_BY_INPUTS, *([NULL_INPUTS] if self.shapes else [])]
        entries = [entry, *too] if entry.slope and self.grips else [entry]
        entries += [entry.within] if entry.within in self.program.entries else []
        return [root for each in entries for root in self.program.entries[each].roots]

    def _hidden(self, entry: Entry) -> list[str]:
        """Return inputs, as C, that may be infinite or NaN although the result is finite."""
        bodies = [self.program.entries[each] for each in (entry, entry.within) if each in self.program.entries]
        seen = [set(_leaves(body.roots)) - set(hidden_inputs(body)) for body in bodies]
        shown = {(leaf.group, leaf.name) for leaf in set.intersection(*seen)}
        return [self.argument(group, name) for group, name in self._inputs(entry) if (group, name) not in shown]

    def _hidden_besides_headings(self, entry: Entry) -> list[str]:
        """Return those of `_hidden` whose range is not checked before."""
        headings = self._state_angles(entry)
        return [place for place in self._hidden(entry) if place not in headings]

    def _inputs(self, entry: Entry) -> list[tuple[Group, str]]:
        """Return the arguments of an entry point besides `self`, by group and name; at the foot only those that it reads."""
        groups = {group: [q.name for q in self.program.groups[group]] for group in (Group.STATE, Group.REFERENCE)}
        if entry.at_foot:
            read = {leaf.name for leaf in _leaves(self._read_by(entry)) if leaf.group is Group.STATE}
            groups[Group.STATE] = [name for name in groups[Group.STATE] if name in read]
            groups[Group.FOOT] = [q.name for q in FOOT]
        return [(group, name) for group, names in groups.items() for name in names]

    # -- parts ---------------------------------------------------------------------------------------------------

    def _init_signature(self) -> str:
        name = self.scalar.name
        types = [
            (f"const {name(self.robot + '_params')}", "params"),
            (f"const {name(self.prefix + '_config')}", "config"),
            (f"const {name(self.prefix + '_gains')}", "gains"),
            (f"const {name(self.robot + '_options')}", "options"),
        ]
        return f"int {self.function('init')}({self.type} *self, {', '.join(f'{kind} *{argument}' for kind, argument in types)})"

    def parameters(self, entry: Entry, public: bool = False) -> dict[str, str]:
        """Return names and declarations of the arguments of an entry point; only the public step may write to self."""
        real = self.scalar.real
        constant = "" if public and entry.slope else "const "
        declared = {"self": f"{constant}{self.type} *self"}
        if entry.at_foot:
            declared["foot"] = f"const {self.scalar.name('noslip_foot')} *foot"
        declared["state"] = f"const {self.state_type} *state"
        if entry.takes is Group.REFERENCE:
            declared["reference"] = f"const {self.scalar.name(self.prefix + '_reference')} *reference"
        if entry.takes is Group.VIRTUAL_INPUT:
            declared["v"] = f"const {real} v[{len(self.law.virtual_input)}]"
        if entry.takes is Group.INPUT:
            declared["tau"] = f"const {real} tau[{self.inputs}]"
        if entry.whole:
            declared["all"] = f"{self.evaluation_type} *all"
        else:
            for quantity in self.returned(entry):
                declared[quantity.in_c] = f"{real} {quantity.in_c}{self.shape(entry, quantity)}"
        if public and entry.slope and self.extends:
            declared = {"dt" if name == Result.EXTENSION_RATE.in_c else name: text for name, text in declared.items()}
            declared["dt"] = f"{real} dt"
        return declared

    def _arguments(self, entry: Entry) -> list[str]:
        return list(self.parameters(entry))

    def array(self, leaf: Leaf) -> tuple[str, Sequence[Quantity]] | None:
        """Return the array of the virtual input, or of the inputs."""
        arrays = {
            Group.VIRTUAL_INPUT: ("v", self.law.virtual_input),
            Group.INPUT: ("tau", self.system.mechanism.inputs),
            Group.EXTENSION: ("self->extension", self.law.extension),
        }
        return arrays.get(leaf.group)


def _leaves(roots: Sequence[Node]) -> list[Leaf]:
    return [node for node in reachable(roots) if isinstance(node, Leaf)]


def _listed(names: Sequence[str]) -> str:
    return f"{', '.join(names[:-1])} or {names[-1]}" if len(names) > 1 else names[0]


def _uses(line: str, name: str) -> bool:
    return f"{name}->" in line or f"{name}[" in line
