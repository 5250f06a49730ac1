"""C of the extended Kalman filter of a robot: header and source."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ...model.mechanism import Quantity
from ...model.vehicle import estimated_pose
from ...readers.templates import render
from ..derivation.stages import Result
from ..graph import Group, Leaf, Node, headers
from ..printing.layout import body, fill, version_check
from ..printing.meaning import users
from ..printing.program_c import ProgramC, init_given
from ..printing.robot_c import struct
from ..printing.scalar import Scalar
from ..printing.statements import Statements
from ..program import Entry
from .filter import RESULTS, WITH_GYRO, FilterProgram

NAME = "ekf"
ROOT = "rad/s/sqrt(s)"


@dataclass(frozen=True)
class FilterText:
    """The C of a filter: file name -> text, declarations without preprocessor directives,
    operations of each tick."""

    files: dict[str, str]
    declarations: str
    operations: dict[str, dict[str, int]]


class FilterC(ProgramC[FilterProgram]):
    """The C of a robot's filter in one scalar."""

    def __init__(self, program: FilterProgram, scalar: Scalar, banner: Sequence[str]):
        super().__init__(program, program.system, NAME, scalar, banner)
        self.title = f"extended Kalman filter of {self.robot}"

    def header(self) -> str:
        """Return the header."""
        return self._rendered("ekf.h")

    def source(self) -> str:
        """Return the source."""
        return self._rendered("ekf.c")

    def text(self) -> FilterText:
        """Return all of it."""
        return FilterText(
            self.files(), self.declarations(), {entry.name: self.operations(entry) for entry in self.entries}
        )

    def declarations(self) -> str:
        """Return types and prototypes, without preprocessor directives."""
        init = (
            f"int {self.function('init')}({self.type} *self, const "
            f"{self.scalar.name(f'{self.prefix}_config')} *config);"
        )
        return "\n\n".join(
            [
                self._config(),
                self._struct(),
                init,
                f"int {self.function('tick')}({', '.join(self._arguments())});",
            ]
        )

    def _pointers(self) -> dict[str, int]:
        """Return names and lengths of what is measured in each tick."""
        lengths = {"turned": len(self.program.motion.turned), "measured": len(self.program.motion.measured)}
        return {name: length for name, length in lengths.items() if length}

    def _arguments(self) -> list[str]:
        """Return the arguments of the tick."""
        real, arrays = self.scalar.real, self._pointers()
        inputs = [f"const {real} {name}[{length}]" for name, length in arrays.items()]
        return [
            f"{self.type} *self",
            *inputs,
            f"const {real} *gyro",
            f"{real} dt",
            f"{self.scalar.name('noslip_pose')} *pose",
        ]

    def _rendered(self, template: str) -> str:
        motion, vehicle = self.program.motion, estimated_pose(self.system)
        assert vehicle is not None
        real, name = self.scalar.real, self.scalar.name
        inputs = [f"{array}[{k}]" for array, length in self._pointers().items() for k in range(length)]
        estimate = self.program.groups[Group.ESTIMATE]
        roots = [root for each in self.program.entries.values() for root in each.roots]
        values = {
            "robot": self.robot,
            "own": name,
            "real": real,
            "banner": self.banner,
            "version_check": "\n".join(version_check(f"{self.type}.h")),
            "config": self._config(),
            "filter": self._struct(),
            "self_config": name(f"{self.prefix}_config"),
            "params": name(f"{self.robot}_params"),
            "place": f" ({vehicle.x}, {vehicle.y})",
            "states": [f"{q.name} ({q.unit}){f', {q.about}' if q.about else ''}" for q in estimate],
            "turned": [f"{q.about.removesuffix(' in this tick')} ({q.unit})" for q in motion.turned],
            "measured": [f"{q.name} ({q.unit})" for q in motion.measured],
            "singular": "; NOSLIP_SINGULAR" if motion.measured else "",
            "costs": [
                f"{entry.about.removeprefix('A tick ')}. {self.cost(entry)}".capitalize()
                for entry in self.entries
            ],
            "tick": ", ".join(self._arguments()),
            "call": ", ".join(["self", *self._pointers()]),
            "count": self.program.states,
            "size": len(self.program.groups[Group.FACTOR]),
            "scales": [q.in_c for q in motion.scales],
            "invalid": self._invalid(),
            "finite": f"{name('noslip_is_finite')}({' + '.join(inputs)})",
            "constants": body(self._constants()),
            "functions": [self._function(entry) for entry in self.entries],
            "headers": headers(roots),
        }
        text = render(__file__, template, **values)
        return "\n".join(part for line in text.split("\n") for part in _fitted(line))

    def _config(self) -> str:
        real, name = self.scalar.real, self.scalar.name
        config = self.program.groups[Group.CONFIG]
        about = {
            "gyro_noise": "white noise of the gyro (angle random walk); 0: no gyro",
            "bias_walk": "random walk of its bias",
        }
        noise = [
            (q, about.get(q.name, "error of the angle, which grows as a random walk"))
            for q in config
            if q.name != "bias_walk"
        ]
        members = [
            (f"{name(self.robot + '_params')} params;", f"see {name(self.robot + '_default_params')}"),
            (f"{name('noslip_ekf_options')} filter;", "start, gate, memory"),
            *((f"{real} {q.in_c};", f"{q.unit}: {text}") for q, text in noise),
            (f"{real} bias_sd;", "rad/s: standard deviation of the gyro's bias, which is 0 at first"),
            (f"{real} bias_walk;", f"{ROOT}: {about['bias_walk']}; may be 0"),
            *(
                (f"{real} {q.in_c}_sd;", f"standard deviation of {q.name}, which is 1 at first")
                for q in self.program.motion.scales
            ),
        ]
        return struct(name(f"{self.prefix}_config"), "What the filter is told.", members)

    def _struct(self) -> str:
        real = self.scalar.real
        constants = [
            (f"{real} {field};", self.meanings.constant(node))
            for node, field in self.program.constants.items()
        ]
        members = [
            (f"{self.scalar.name('noslip_ekf')} filter;", "estimate and covariance"),
            ("int has_gyro;", "whether gyro_noise is given"),
            *constants,
        ]
        return struct(
            self.type,
            "The filter: initialized by init, owned by the caller, who does not write to it.",
            members,
        )

    def _invalid(self) -> str:
        """Return the condition under which init rejects the config."""
        deviation = self.scalar.name("noslip_ekf_is_deviation")
        noise = [q.in_c for q in self.program.groups[Group.CONFIG] if q.name.startswith("noise_")]
        required = [*noise, *(f"{q.in_c}_sd" for q in self.program.motion.scales)]
        tests = [f"!{deviation}(config->{name})" for name in required]
        tests.append("!(config->gyro_noise >= 0 && config->gyro_noise <= 0) && "
                     f"!({deviation}(config->gyro_noise) && "
                     f"{deviation}(config->bias_sd))")  # fmt: skip
        tests.append("!(config->bias_walk >= 0 && config->bias_walk <= 1)")
        return " || ".join([*tests[:-2], f"({tests[-2]})", tests[-1]])

    def _constants(self) -> list[str]:
        """Return the statements of init that compute the constants."""
        finite = self.scalar.name("noslip_is_finite")
        writer = Statements(
            self.scalar,
            init_given,
            {},
            self.leave,
            {"self", "params", "config", "status"},
            self.meanings.constant,
        )
        writer.plan(self.program.constants)
        for node, field in self.program.constants.items():
            writer.uses[node] = 1
            writer.assign(f"self->{field}", node)
            if node.arguments:
                writer.names[node] = f"self->{field}"
        computed = [
            f"{finite}(self->{field})" for node, field in self.program.constants.items() if node.arguments
        ]
        return [*writer.lines, self.leave(f"!({' && '.join(computed)})", "NOSLIP_BAD_PARAMETER")]

    def _function(self, entry: Entry) -> str:
        """Return the static function of a tick with checked arguments."""
        tick = self.program.entries[entry]
        arguments = self.parameters(entry)
        places = self.places(entry)
        used = users(places, self.program.labels)
        writer = _Tick(self, set(arguments), lambda node: self.meanings.temporary(node, used(node)))
        writer.plan(tick.roots)
        for step in tick.steps:
            writer.names[step.leaf] = writer.named(step.node)
        for node, place in places:
            writer.assign(place, node)
        constants = self.meanings.legend(self.program.constants, writer.lines)
        unused = [
            f"(void){name};" for name in arguments if not any(_reads(line, name) for line in writer.lines)
        ]
        head = f"static int {self.function(entry.name)}({', '.join(arguments.values())})"
        comment = f"/* {entry.about}. */"
        return "\n".join(
            [
                comment,
                *fill(head, ""),
                "{",
                body([*unused, *constants, *writer.lines, "return NOSLIP_OK;"]),
                "}",
            ]
        )

    # -- parts -----------------------------------------------------------------------------------------------

    def shape(self, entry: Entry, quantity: Result) -> str:
        """Return the C array bounds of a quantity."""
        n = self.program.states
        bounds = (3, n - 3, len(self.program.groups[Group.FACTOR]), 2)
        return f"[{dict(zip(RESULTS, bounds, strict=True))[quantity]}]"

    def parameters(self, entry: Entry, public: bool = False) -> dict[str, str]:
        """Return names and declarations of the arguments of a tick's static function."""
        real = self.scalar.real
        declared = {"self": f"const {self.type} *self"}
        declared |= {name: f"const {real} {name}[{length}]" for name, length in self._pointers().items()}
        if entry is WITH_GYRO:
            declared["gyro"] = f"{real} gyro"
        declared["dt"] = f"{real} dt"
        return declared | {result: f"{real} {result}{self.shape(entry, result)}" for result in RESULTS}

    def array(self, leaf: Leaf) -> tuple[str, Sequence[Quantity]] | None:
        """Return the array that contains a leaf."""
        arrays = {Group.ESTIMATE: "self->filter.state", Group.FACTOR: "self->filter.factors"}
        if leaf.group in arrays:
            return arrays[leaf.group], self.program.groups[leaf.group]
        motion = self.program.motion
        names = {"turned": motion.turned, "measured": motion.measured}
        return next(
            ((name, members) for name, members in names.items() if leaf.name in {q.name for q in members}),
            None,
        )

    def step_given(self, node: Node) -> str | None:
        """Return the C of a node that a tick need not compute."""
        if isinstance(node, Leaf) and node.group is Group.INPUT and self.array(node) is None:
            return node.name
        return super().step_given(node)


class _Tick(Statements):
    """The statements of a tick: an angle is checked before its sine is taken."""

    def __init__(self, text: FilterC, taken: set[str], meaning: Callable[[Node], str]):
        super().__init__(
            text.scalar, text.step_given, text.program.labels, text.leave, {*taken, "status"}, meaning
        )
        self.text_of = text

    def _sincos(self, angle: Node) -> None:
        self.lines.append(self.text_of.leave(f"!{self.text_of.in_range(self.named(angle))}", "NOSLIP_RANGE"))
        super()._sincos(angle)


def _reads(line: str, name: str) -> bool:
    return f"{name}[" in line or f"{name}->" in line or f" {name}" in line or f"({name}" in line


def _fitted(line: str) -> list[str]:
    return [line] if len(line) <= 120 or line.lstrip().startswith(("/*", "*")) else fill(line, "")
