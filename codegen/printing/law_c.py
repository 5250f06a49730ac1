"""C of a control law: header and source."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from ...model.mechanism import Quantity, per_second
from ...model.names import in_c
from ...model.outputs import FOOT
from ...readers.templates import render
from ..costs import LONG, code_bytes
from ..derivation.grip import is_wide, wheels_by_contact
from ..derivation.stages import Result
from ..graph import Group, Leaf, Node, angles, executed, headers, reachable
from ..program import (
    EVALUATE,
    GROUND,
    GROUND_BY_INPUTS,
    NULL_INPUTS,
    SLOPE,
    WHEELS,
    Entry,
    Program,
    hidden_inputs,
)
from .layout import body, comment, fill
from .meaning import users
from .program_c import ProgramC, init_given
from .robot_c import fields, refuse_parameters, struct, written_once
from .scalar import Scalar
from .statements import Statements

FRICTION = "mu margin share height period known error coarse lag"  # members of noslip_friction


def runtime_types(scalar: Scalar) -> str:
    """Return the types of the C runtime that occur in declarations, for cffi; enums are ints."""
    foot = struct(
        scalar.name("noslip_foot"),
        "Position of the vehicle relative to the foot of P_l on a path.",
        fields(scalar, FOOT),
    )
    parts = {
        "friction": FRICTION,
        "grip": "weight height",
        "earned": "mu most given weight height period pause frequency rise after error coarse lag",
        "wheel": "rate expected per_mass rim away steps",
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
    "step": "The controller: outer loop and nu_c = Phi^-1 (v - drift), limits, safe outputs. It does not use "
    "nu.",
    "follow": "The step for a path given by the position relative to the foot of P_l.",
    "feedback": "Kinematic feedback nu_c = Phi^-1 (v - drift): from the virtual input v to the commanded "
    "quasi-velocities.",
}


@dataclass(frozen=True)
class Admission:
    """A function that checks arguments: its name, their declarations, the numbers that are `read`, the
    condition by which they are `refused` where their sum is not finite, and those by which angles are
    `in_range`; all as C.
    """

    name: str
    declared: list[str]
    read: list[str]
    refused: str
    in_range: list[str]


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

    # -- header ----------------------------------------------------------------------------------------------

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
                name(f"{self.prefix}_reference"),
                f"Desired values of the outputs {rows}.",
                fields(self.scalar, law.reference),
            ),
            struct(
                self.evaluation_type,
                "All quantities of the law at one state.",
                [
                    (f"{real} {q.in_c}{self.shape(EVALUATE, q)};", self._meaning(q))
                    for q in self.returned(EVALUATE)
                ],
            ),
            struct(
                self.type,
                "The law: initialized by init, owned by the caller, who does not write to it.",
                [
                    (f"{real} limit[{self.inputs}];", f"largest absolute values of the {what}"),
                    (f"{real} held[{self.inputs}];", f"last {what} returned"),
                    *(
                        [(f"{real} clear[{self.inputs}];", "inputs up to which nothing is left to check")]
                        if self.grips
                        else []
                    ),
                    ("noslip_on_error on_error;", "what to return on an error"),
                    *(
                        [("noslip_on_limit on_limit;", _listed(self.on_limit))]
                        if len(self.on_limit) > 1
                        else []
                    ),
                    *(
                        [(f"{name('noslip_grip')} grip;", "of the floor, with NOSLIP_GRIP")]
                        if self.grips
                        else []
                    ),
                    *([(f"{name('noslip_earned')} earned;", "what is believed of it")] if self.grips else []),
                    *(
                        [(f"{name('noslip_wheel')} wheel[{self.wheels}];", "what shows it")]
                        if self.wheels
                        else []
                    ),
                    *([(f"{real} ground[{4 * self.contacts}];", "at the last step")] if self.wheels else []),
                    *self._extension_fields(),
                    ("int ready;", "set by init"),
                    *[
                        (f"{real} {field};", self.meanings.constant(node))
                        for node, field in self.program.constants.items()
                    ],
                ],
            ),
        ]
        functions = [self._prototype(entry) for entry in self.entries if entry.public]
        prototypes = [
            self._init_prototype(),
            self._reset_prototype(),
            self._set_limits_prototype(),
            self._update_prototype(),
        ]
        return "\n\n".join([*types, *prototypes, *functions])

    def _extension_fields(self) -> list[tuple[str, str]]:
        """Return the fields of the states of the dynamic extension."""
        if not self.extends:
            return []
        states = ", ".join(f"{q.name} ({q.unit})" for q in self.law.extension)
        return [
            (f"{self.scalar.real} extension[{self.extends}];", f"states of the dynamic extension: {states}"),
            (
                f"{self.scalar.real} extension_rate[{self.extends}];",
                "their rates at the last step, 0 where it was limited",
            ),
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
        return [
            "NOSLIP_CUT",
            *(["NOSLIP_SLOW"] if self.slows else []),
            *(["NOSLIP_GRIP"] if self.grips else []),
        ]

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
            Result.ACCELERATION: "desired rates of "
            + ", ".join(f"{q.name} ({per_second(q.unit)})" for q in motions),
            Result.INPUTS: ", ".join(f"{q.name} ({q.unit})" for q in inputs),
            Result.EXTENSION_RATE: "rates of "
            + ", ".join(f"{q.name} ({per_second(q.unit)})" for q in law.extension),
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
        return self.about(entry) + "\n" + "\n".join(fill(self.signature(entry) + ";", ""))

    def about(self, entry: Entry) -> str:
        public = [
            q
            for q in self.returned(entry)
            if not entry.whole and not (entry.slope and q is Result.EXTENSION_RATE)
        ]
        answers = [f"{q.in_c}{self.shape(entry, q)}: {self._meaning(q)}" for q in public]
        outputs = ", ".join(f"{q.name} ({q.unit})" for q in self.law.virtual_input)
        virtual = (
            [f"v[{len(self.law.virtual_input)}]: {outputs}"] if entry.takes is Group.VIRTUAL_INPUT else []
        )
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
            "First the states of the extension advance by dt (s), the time since the previous step, 0 at the "
            "first. Their rates",
            "are those of that step, or 0 unless it returned NOSLIP_OK: the states are held while inputs are "
            "limited.",
        ]

    def _read(self, entry: Entry) -> list[str]:
        """Return a comment on the part of the state that is read, if not all of it."""
        if not (entry.at_foot and entry.public):
            return []
        place = ", ".join(q.name for q in self.law.config if q not in self._path_parameters())
        read = ", ".join(name for group, name in self._inputs(entry) if group is Group.STATE)
        return [
            f"Uses only {read} of the state, and only {place} of the config given to init: one law serves "
            "all segments."
        ]

    def _path_parameters(self) -> Sequence[Quantity]:
        """Return the parameters of the position of the path."""
        return self.law.output.path.parameters if self.law.output.path else ()

    def _init_prototype(self) -> str:
        large, loses = self.law.system.dof > 2, len(self.law.linearization.measures) > 1
        of_commands = (
            "`options->limit` is of the commands, in the order of the quasi-velocities; friction is not used."
        )
        lines = [
            "Initializes the law from parameters. `options` may be NULL: no limits, zeros on an error.",
            *([of_commands] if self.law.kinematic else []),
            "NOSLIP_BAD_PARAMETER: a value is not finite or has the wrong sign. NOSLIP_SINGULAR: Phi has no "
            "inverse anywhere.",
            *(
                ["At a state: 1 / (|Phi| |Phi^-1|), in the 1-norm and these units, is not above 1e-5."]
                if large
                else []
            ),
            *(
                ["At a state too where S'E, by the same measure, has no inverse: inputs lose a direction."]
                if loses
                else []
            ),
            self._on_limit(),
            *([self._on_grip()] if self.grips else []),
            *(
                ["on_limit = NOSLIP_GRIP is NOSLIP_BAD_PARAMETER too: not with a dynamic extension."]
                if self.extends
                else []
            ),
        ]
        return comment(lines) + "\n" + "\n".join(fill(self.init_signature() + ";", ""))

    def _on_limit(self) -> str:
        row = self.law.speed_row
        if row is None:
            of_speed = (
                "that depends on the quasi-velocities" if self.law.kinematic else "of relative degree 1"
            )
            return (
                "on_limit = NOSLIP_SLOW is NOSLIP_BAD_PARAMETER: it requires exactly one output "
                f"{of_speed}, a speed."
            )
        outputs = [q.name for q in self.law.virtual_input]
        given_up = outputs.pop(row)
        kept = f" and keeps {', '.join(outputs)}" if outputs else ""
        what = "commands" if self.law.kinematic else "inputs"
        return f"on_limit = NOSLIP_SLOW changes {given_up}{kept} if the {what} would exceed their limits."

    def _on_grip(self) -> str:
        wide = (
            ""
            if is_wide(self.system)
            else " friction.height must be 0: an axle has no width to carry the moment."
        )
        return (
            f"on_limit = NOSLIP_GRIP keeps {self._contact_names()} rolling, see noslip_grip.h; it "
            f"requires friction.mu.{wide}"
        )

    def _reset_prototype(self) -> str:
        too = " and the states of the dynamic extension" if self.extends else ""
        return (
            comment([f"Sets the held inputs{too} to zero."])
            + f"\nint {self.function('reset')}({self.type} *self);"
        )

    def _set_limits_prototype(self) -> str:
        lines = [
            "Changes the limits of the inputs, such as to what motors have left now. 0: no limit. Limits "
            "held inputs too.",
            "NOSLIP_BAD_PARAMETER: a limit is not finite or negative; then nothing changes.",
        ]
        return comment(lines) + f"\n{self.set_limits_signature()};"

    def set_limits_signature(self) -> str:
        """Return the signature of the function that changes the limits."""
        return (
            f"int {self.function('set_limits')}({self.type} *self, const {self.scalar.real} "
            f"limit[{self.inputs}])"
        )

    def _update_prototype(self) -> str:
        held = "Held inputs and the states of the dynamic extension" if self.extends else "Held inputs"
        held += " and friction that is earned" if self.wheels else ""
        lines = [
            "Continues with parameters, config, gains and options of `next`, a law that init has accepted, "
            "between two steps.",
            f"{held} stay, within the new limits.",
            "NOSLIP_NOT_READY: one of the two is not initialized; then nothing changes.",
        ]
        return comment(lines) + f"\n{self.update_signature()};"

    def update_signature(self) -> str:
        """Return the signature of the function that goes on with another law."""
        return f"int {self.function('update')}({self.type} *self, const {self.type} *next)"

    # -- source ----------------------------------------------------------------------------------------------

    def source(self) -> str:
        """Return the source of the law."""
        program = self.program
        roots = [
            *program.conditions,
            *program.regular,
            *(root for law in program.entries.values() for root in law.roots),
        ]
        includes = [
            self.type,
            *headers(roots),
            *(["noslip_shaping"] if self.grips and not self.plain_grip else []),
        ]
        constants, computed = self._computed()
        wheels = wheels_by_contact(self.system) if self.wheels else {}
        text = render(
            __file__,
            "law.c",
            law=self,
            head=self._head(f"{self.type}.c", includes, own=self.grips, quick=True),
            own=self.scalar.name,
            real=self.scalar.real,
            refuse=partial(refuse_parameters, self.scalar),
            wide=int(self.grips and is_wide(self.system)),
            count=self.inputs,
            by_value=self._by_value,
            made=[f"made[{k}]" for k in range(self.inputs)],
            extends=self.extends,
            extension_rate=Result.EXTENSION_RATE.in_c,
            contacts=self.contacts,
            wheels=self.wheels,
            first=min(wheels, default=0),
            driven=[(k, contact) for k, (contact, wheel) in enumerate(wheels.items()) if wheel],
            of_wheels=WHEELS,
            ground=GROUND,
            ground_by_inputs=GROUND_BY_INPUTS,
            null_inputs=NULL_INPUTS,
            computed=computed,
            constants=constants,
            arrays={
                Group.VIRTUAL_INPUT: f"v, {len(self.law.virtual_input)}",
                Group.INPUT: f"tau, {self.inputs}",
            },
            mentioned=lambda name, lines: re.search(rf"\b{name}\b", lines),
        )
        return body(text.split("\n"), "")

    def _computed(self) -> tuple[list[str], list[str]]:
        """Return the constants that init computes, as C, and the statements that compute them."""
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
        return constants, writer.lines

    def admission(self, entry: Entry) -> str:
        """Return the call that checks the arguments of an entry point, except the virtual input,
        which it checks itself."""
        return f"{self.function(self._admit_name(entry))}({', '.join(self._admitted(entry))})"

    def _admit_name(self, entry: Entry) -> str:
        if entry.at_foot:
            return "admit_foot"
        return "admit_both" if entry.takes is Group.REFERENCE else "admit"

    def _admitted(self, entry: Entry) -> dict[str, str]:
        """Return the checked arguments with their declarations, those that the entry point reads;
        `self` is const."""
        declared, read = self.parameters(entry), {"self", *(group for group, _ in self._inputs(entry))}
        return {
            name: declared[name]
            for name in ("self", "foot", "state", "reference")
            if name in declared and name in read
        }

    def admissions(self) -> list[Admission]:
        """Return the functions that check the arguments of entry points, except the virtual input,
        each once."""
        entries = {self._admit_name(entry): entry for entry in self.entries if entry.public}
        return [
            self._admit(name, entries[name])
            for name in ("admit", "admit_both", "admit_foot")
            if name in entries
        ]

    def _admit(self, name: str, entry: Entry) -> Admission:
        finite, declared = self.scalar.name("noslip_is_finite"), self._admitted(entry)
        given = [(group, one) for group, one in self._inputs(entry) if group in declared]
        whole_state = not entry.at_foot
        parts = [
            f"{finite}({group}->{in_c(one)})"
            for group, one in given
            if not (whole_state and group == "state")
        ]
        refused = (
            [f"{self.scalar.name(self.robot + '_check_state')}(state) != NOSLIP_OK"] if whole_state else []
        )
        refused += [f"!({' && '.join(parts)})"] if parts else []
        return Admission(
            name,
            list(declared.values()),
            [f"{group}->{in_c(one)}" for group, one in given],
            f"({' || '.join(refused)})" if len(refused) > 1 else refused[0],
            [self.in_range(angle) for angle in self._state_angles(entry)],
        )

    def storage(self, entry: Entry) -> str:
        """Return the storage class of the function that computes an entry point with checked arguments."""
        long = entry == GROUND and code_bytes(self.program.entries[entry].roots) > LONG
        if entry.near or long:
            return "static NOSLIP_BESIDE"
        return "NOSLIP_HOT" if entry in (GROUND, WHEELS) else "static"

    def statements_of(self, entry: Entry) -> list[str]:
        """Return the statements that compute an entry point with checked arguments."""
        program = self.program
        law = program.entries[entry]
        tested = zip(law.singular, ["the test of Phi"] * 2 + ["the test of S'E"] * 2, strict=False)
        used = users([*tested, *self.places(entry)], program.labels)
        taken, meaning = (
            {*self.arguments(entry), "status"},
            lambda node: self.meanings.temporary(node, used(node)),
        )
        writer = Statements(self.scalar, self.step_given, program.labels, self.leave, taken, meaning)
        self.write(writer, entry, self.places(entry))
        constants = self.meanings.legend(program.constants, writer.lines)
        unused = [
            f"(void){name};"
            for name in self.arguments(entry)
            if not any(_uses(line, name) for line in writer.lines)
        ]
        return [*unused, *constants, *writer.lines]

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
        return f"{self.function(entry.within.name)}_law({', '.join(self.arguments(entry))})"

    def answers(self, entry: Entry) -> list[str]:
        """Return the statements that end a public function: results in a local object,
        checked and written once."""
        *given, _ = self.arguments(entry)
        call = f"{self.function(entry.name)}_law({', '.join([*given, 'all' if entry.whole else 'made'])})"
        return written_once(self.scalar, call, self.pieces(entry))

    def local_array(self, entry: Entry) -> str:
        """Return the declaration of the local array for the results of an entry point."""
        kind, name = self.parameters(entry)[self.arguments(entry)[-1]].split(" ", 1)
        return f"{kind} made{name[name.index('[') :]}"

    def passed(self, entry: Entry) -> list[str]:
        """Return the arguments that a step hands on where its inputs are to be limited; the inputs follow by
        value, so that they stay in registers.
        """
        _, after = self.ordinary(entry)
        return [
            name
            for name in self.arguments(entry)
            if name != "reference" or any("reference->" in one for one in after)
        ]

    @property
    def _by_value(self) -> list[str]:
        """The names of the inputs that are handed on."""
        return [f"made_{k}" for k in range(self.inputs)]

    def limited_parameters(self, entry: Entry) -> list[str]:
        """Return the declarations of what is handed on."""
        declared = self.parameters(entry, public=True)
        return [
            *(declared[name] for name in self.passed(entry)),
            *(f"{self.scalar.real} {name}" for name in self._by_value),
        ]

    def finite(self, entry: Entry) -> list[str]:
        """Return the conditions that the inputs handed on are finite, and what they need not show."""
        finite = self.scalar.name("noslip_is_finite")
        return [f"{finite}({value})" for value in (*self._by_value, *self._hidden_besides_headings(entry))]

    def rates_of_wheels(self) -> list[str]:
        """Return the rates of the wheels by which friction is earned, as C;
        0 where a contact has no driven wheel."""
        wheels, motions = wheels_by_contact(self.system).values(), self.system.quasi_velocities
        return [
            self.argument(Group.STATE, motions[wheel.velocity].name) if wheel else "0" for wheel in wheels
        ]

    def ordinary(self, entry: Entry) -> tuple[list[str], list[str]]:
        """Return the C conditions before and after the law under which a step needs no further checks: of the
        result, last of inputs that it need not show."""
        hidden = self._hidden_besides_headings(entry)
        before = [
            "self->ready == NOSLIP_READY",
            *(self.in_range(angle) for angle in self._state_angles(entry)),
        ]
        seen = [f"{self.scalar.name('noslip_is_finite')}({' + '.join(hidden)})"] if hidden else []
        return before, [*self.within("clear" if self.grips else "limit"), *seen]

    def argument(self, group: Group, name: str) -> str:
        """Return the C of a member of an argument of an entry point."""
        return f"{group}->{in_c(name)}"

    def within(self, limit: str) -> list[str]:
        """Return the C conditions that the inputs made are within an array of the struct."""
        return [
            f"{self.scalar.name('noslip_within')}(made[{k}], self->{limit}[{k}])" for k in range(self.inputs)
        ]

    def _state_angles(self, entry: Entry) -> list[str]:
        """Return the entries of the state, as C, whose range an entry point checks:
        those in a sine or cosine."""
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
        bodies = [
            self.program.entries[each] for each in (entry, entry.within) if each in self.program.entries
        ]
        seen = [set(_leaves(body.roots)) - set(hidden_inputs(body)) for body in bodies]
        shown = {(leaf.group, leaf.name) for leaf in set.intersection(*seen)}
        return [
            self.argument(group, name) for group, name in self._inputs(entry) if (group, name) not in shown
        ]

    def _hidden_besides_headings(self, entry: Entry) -> list[str]:
        """Return those of `_hidden` whose range is not checked before."""
        headings = self._state_angles(entry)
        return [place for place in self._hidden(entry) if place not in headings]

    def _inputs(self, entry: Entry) -> list[tuple[Group, str]]:
        """Return the arguments of an entry point besides `self`, by group and name;
        at the foot only those that it reads."""
        groups = {
            group: [q.name for q in self.program.groups[group]] for group in (Group.STATE, Group.REFERENCE)
        }
        if entry.at_foot:
            read = {leaf.name for leaf in _leaves(self._read_by(entry)) if leaf.group is Group.STATE}
            groups[Group.STATE] = [name for name in groups[Group.STATE] if name in read]
            groups[Group.FOOT] = [q.name for q in FOOT]
        return [(group, name) for group, names in groups.items() for name in names]

    # -- parts -----------------------------------------------------------------------------------------------

    def init_signature(self) -> str:
        """Return the signature of the function that initializes the law."""
        name = self.scalar.name
        types = [
            (f"const {name(self.robot + '_params')}", "params"),
            (f"const {name(self.prefix + '_config')}", "config"),
            (f"const {name(self.prefix + '_gains')}", "gains"),
            (f"const {name(self.robot + '_options')}", "options"),
        ]
        return (
            f"int {self.function('init')}({self.type} *self, "
            f"{', '.join(f'{kind} *{argument}' for kind, argument in types)})"
        )

    def parameters(self, entry: Entry, public: bool = False) -> dict[str, str]:
        """Return names and declarations of the arguments of an entry point;
        only the public step may write to self."""
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
            declared = {
                "dt" if name == Result.EXTENSION_RATE.in_c else name: text for name, text in declared.items()
            }
            declared["dt"] = f"{real} dt"
        return declared

    def arguments(self, entry: Entry) -> list[str]:
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
