"""What options of a SPEC go together: rows of needs, exclusions and bounds, and the check of a SPEC against
them.

An option is written as a user would write it: `[sensors]`, `[limits] mode = "grip"`,
`[simulation] period > 0`. It holds where the SPEC has it. `A with B` holds where both do. WORDS are options
that follow from several keys, OF_LAW those that follow from the law, which is known in a run only.
"""

import dataclasses
import json
import operator
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from ...model.law import ControlLaw
from ...model.vehicle import steered_axle

WORDS = {  # option -> property of the SPEC
    "a run": "simulation",
    "a composite path": "output.segments",
    '[output] path = { kind = "course" }': "output.along_course",
    "an output of the robot's own": "output.own",
    '[reference] speed = "fastest"': "reference.fastest",
    "a profile of the speed": "reference.profiled",
    "a position that is no point": "reference.no_point",
    "a position of more than x, y and heading": "reference.beyond_pose",
    "a profile that leaves accelerations out": "reference.incomplete",
    "segments in reverse": "output.reverses",
    "an end of the course": "reference.stops",
    "cusps of the course": "reference.course.cusps",
    "parts of the course in reverse": "reference.course.reverses",
    "a limit of integral action or observers": "limits.of_memory",
    "integral action (gain ki)": "integral_action",
    "a disturbance observer (gain ko)": "observes_disturbances",
}


def led_units(law: ControlLaw) -> set[str]:
    """Return the units of outputs of relative degree 2, those that an approach leads besides speeds."""
    return {
        row.unit
        for row, degree in zip(law.output.rows, law.linearization.relative_degree, strict=True)
        if degree == 2
    }


# What is known where the law of a SPEC is -> whether a law has it
OF_LAW: dict[str, Callable[[ControlLaw], bool]] = {
    "a steered wheel": lambda law: steered_axle(law.system) is not None,
    "a robot that is no vehicle (moves_in_plane)": lambda law: law.system.mechanism.vehicle is None,
    "fewer inputs than quasi-velocities": lambda law: law.system.underactuated,
    "outputs that begin with no point": lambda law: (
        not law.output.foot and [r.unit for r in law.output.rows[:2]] != ["m", "m"]
    ),
    "an output in rad": lambda law: "rad" in led_units(law),
    "outputs without an angle": lambda law: "rad" not in led_units(law),
    "outputs in another unit than m and rad": lambda law: not led_units(law) <= {"m", "rad"},
}
USERS = {  # what runs a loop, or answers about one -> what it is
    "noslip sweep": "many loops of a SPEC",
    "the C of a sweep": "what runs the samples of a sweep fast; without it each is run by noslip simulate",
    "--engine mujoco": "a loop on a floor where wheels may slip",
    "--record": "a loop on an emulated processor, whose calls are recorded",
    "export --firmware": "the firmware of the vehicle of a SPEC: its follower in C",
    "noslip outer-loop": "gains and margins about the steady motion of a SPEC",
    "analyse --start": "whether a start avoids the singular set for certain",
    "analyse --table": "offsets from the path that do so",
}
COMPARISONS = {
    "=": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
IN_WORDS = {"<": "below", "<=": "at most", ">": "above", ">=": "at least"}
NOTATION = re.compile(
    r"(?P<key>\[+(?P<section>[\w.]+)\]+(?: (?P<name>[\w.]+))?)(?: (?P<sign>[!<>]?=|<|>) (?P<values>.+))?"
)


@dataclass(frozen=True)
class Option:
    """An option of a SPEC, or a user of one, as it is written."""

    text: str

    @cached_property
    def _parsed(self) -> tuple[str, list[str], str, list[Any]]:
        """The key as written, its path in a SPEC, the sign of a comparison, and what it is compared with."""
        if self.text in WORDS:
            return self.text, WORDS[self.text].split("."), "", []
        if (matched := NOTATION.fullmatch(self.text)) is None:
            raise ValueError(f"{self.text!r} is no option, nor one of {', '.join([*WORDS, *USERS])}")
        values = [json.loads(value) for value in matched["values"].split(" | ")] if matched["sign"] else []
        path = ".".join(filter(None, (matched["section"], matched["name"]))).split(".")
        return matched["key"], path, matched["sign"] or "", values

    @property
    def key(self) -> str:
        """The key, or the section, without a value."""
        return self._parsed[0]

    @property
    def path(self) -> list[str]:
        """The path of its value in a SPEC."""
        return self._parsed[1]

    def value(self, spec: object) -> Any:
        """Return the value in a SPEC, by default too; None where its section is not there."""
        value: Any = spec
        for name in self.path:
            value = None if value is None else getattr(value, name)
        return value

    def holds(self, spec: object, user: str = "", law: ControlLaw | None = None) -> bool:
        """Return whether a SPEC, run by a user, has the option;
        what depends on its law holds only where that is known."""
        if self.text in USERS:
            return self.text == user
        if self.text in OF_LAW:
            return law is not None and OF_LAW[self.text](law)
        _, path, sign, _ = self._parsed
        section = getattr(spec, path[0])
        if section is None or section == _default(spec, path[0]):
            return False  # a section that is not there, though it has defaults
        value = self.value(spec)
        if sign:
            return value is not None and self.compared(value)
        if self.text in WORDS or value is None:
            return bool(value)
        return len(path) == 1 or value != _default(Option(f"[{'.'.join(path[:-1])}]").value(spec), path[-1])

    def compared(self, value: Any) -> bool:
        """Return whether a value is one of those of the option; always where it has none."""
        _, _, sign, values = self._parsed
        return not sign or (all if sign == "!=" else any)(COMPARISONS[sign](value, each) for each in values)

    def shown(self, spec: object) -> str:
        """Return the option with the value that it has in a SPEC."""
        if self.text in USERS or self.text in OF_LAW or not self._parsed[2] or self._parsed[3] == [0]:
            return self.text
        return f"{self.key} = {json.dumps(self.value(spec))}"


def _default(holder: object, name: str) -> object:
    """Return the default of an entry of a section; MISSING for one without, and for a property."""
    if (entry := vars(type(holder))["__dataclass_fields__"].get(name)) is None:
        return dataclasses.MISSING
    return entry.default if entry.default_factory is dataclasses.MISSING else entry.default_factory()


@dataclass(frozen=True)
class Rule:
    """A row: where `option` holds, something is asked of the `other` options."""

    option: str
    other: str | tuple[str, ...]
    why: str
    relation = ""
    kind = ""  # of rule, in the JSON of a stage

    @cached_property
    def options(self) -> tuple[Option, ...]:
        """What the option consists of."""
        return tuple(map(Option, self.option.split(" with ")))

    @cached_property
    def others(self) -> tuple[Option, ...]:
        """The other options."""
        return tuple(map(Option, (self.other,) if isinstance(self.other, str) else self.other))

    def concerns(self, user: str) -> bool:
        """Return whether the row is about a user."""
        return any(option.text == user for option in self.options + self.others)

    def applies(self, spec: object, user: str, law: ControlLaw | None) -> bool:
        """Return whether the option, or all that it consists of, holds."""
        return all(option.holds(spec, user, law) for option in self.options)

    def broken(self, spec: object, user: str = "", law: ControlLaw | None = None) -> str:
        """Return what is wrong with a SPEC, run by a user with a law, if that is known;
        an empty text if nothing is."""
        raise NotImplementedError

    def as_json(self) -> dict[str, object]:
        """Return the row as `noslip stages --json` prints it."""
        return {"option": self.option, self.kind: [other.text for other in self.others], "why": self.why}

    def __str__(self) -> str:
        return f"{self.option} {self.relation} {' or '.join(other.text for other in self.others)}: {self.why}"


class Needs(Rule):
    """The option requires another, or one of several."""

    relation = "requires"
    kind = "needs"

    def broken(self, spec: object, user: str = "", law: ControlLaw | None = None) -> str:
        """Return that the option requires what is missing."""
        if not self.applies(spec, user, law) or any(other.holds(spec, user, law) for other in self.others):
            return ""
        shown = " with ".join(option.shown(spec) for option in self.options)
        return str(dataclasses.replace(self, option=shown))


class Excludes(Rule):
    """The option goes with none of the others."""

    relation = "does not go with"
    kind = "excludes"

    def broken(self, spec: object, user: str = "", law: ControlLaw | None = None) -> str:
        """Return with what the option does not go."""
        wrong = next(
            (o for o in self.others if self.applies(spec, user, law) and o.holds(spec, user, law)), None
        )
        if wrong is None:
            return ""
        return str(
            dataclasses.replace(
                self, option=" with ".join(o.shown(spec) for o in self.options), other=wrong.shown(spec)
            )
        )


@dataclass(frozen=True)
class Bound(Rule):
    """A number is bounded by another of the SPEC, times a `factor`. `sign` is one of IN_WORDS."""

    sign: str = "<="
    factor: float = 1.0
    kind = "bounds"

    @property
    def bound(self) -> str:
        """The bound in words."""
        (option,), (other,) = self.options, self.others
        times = "" if self.factor == 1.0 else f"{self.factor:g} times "
        return (
            f"{IN_WORDS[self.sign]} "
            f"{times}{other.path[-1] if other.path[:-1] == option.path[:-1] else other.text}"
        )

    def broken(self, spec: object, user: str = "", law: ControlLaw | None = None) -> str:
        """Return by what a number must be bounded and is not."""
        (option,), (other,) = self.options, self.others
        value, limit = option.value(spec), other.value(spec)
        if value is None or limit is None or not option.compared(value):
            return ""
        if COMPARISONS[self.sign](value, self.factor * limit):
            return ""
        return f"{option.key} = {value:g} must be {self.bound} = {limit:g}: {self.why}"

    def as_json(self) -> dict[str, object]:
        """Return the row as `noslip stages --json` prints it."""
        return {"option": self.option, "bound": self.bound, "why": self.why}

    def __str__(self) -> str:
        return f"{self.option} must be {self.bound}: {self.why}"
