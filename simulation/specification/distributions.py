"""[sweep] of a SPEC: which numbers vary between samples, and their distributions."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...readers.errors import BadInput
from ...readers.reading import (
    DEFINITIONS,
    SI,
    angle,
    ascending,
    check_keys,
    each_of,
    entry,
    flag,
    number,
    of_type,
    one_of,
    reads,
    ref,
    row,
    text,
    whole,
)

# Of a sweep: the seed of a sample is that of the sweep times 2^32 plus the sample's number, below 2^53
SEEDS = 2**21
# s between calls for a SPEC with period 0 (continuous): the compiled loop of a sweep is sampled
PERIOD = 0.01
BAND = 0.05  # m, rad, m/s: an error has settled if it stays within
DESIGNS = ("random", "sobol", "latin")
KINDS = {
    "normal": row("[mean, sd]", number(), number("positive")),
    "uniform": ascending(number()),
    "log_uniform": ascending(number("positive")),
}
KEYS = {
    "normal": "mean and standard deviation",
    "uniform": "lowest and highest value",
    "log_uniform": "lowest and highest value; the logarithm is uniform",
    "within": "lowest and highest value of a normal distribution",
}
EXAMPLE = "for example { normal = [30.0, 6.0] } or { uniform = [-1.0, 1.0] }"


@dataclass(frozen=True)
class Margin:
    """The distribution of one number: normal with mean a and standard deviation b, within bounds; uniform
    between a and b, or its logarithm is uniform. `kind` "fixed": the value is a.
    """

    kind: str
    a: float
    b: float = 0.0
    within: tuple[float, float] | None = None

    def quantile(self, u: np.ndarray) -> np.ndarray:
        """Return the value below which a part u, 0 < u < 1, of the distribution lies."""
        if self.kind == "normal":
            from scipy.special import ndtr, ndtri  # slow to import, and most SPECs have no distribution

            if self.within:
                low, high = (ndtr((bound - self.a) / self.b) for bound in self.within)
                return np.clip(self.a + self.b * ndtri(low + u * (high - low)), *self.within)
            return self.a + self.b * ndtri(u)
        if self.kind == "uniform":
            return self.a + (self.b - self.a) * u
        if self.kind == "log_uniform":
            return np.clip(np.exp(np.log(self.a) + (np.log(self.b) - np.log(self.a)) * u), self.a, self.b)
        return np.full_like(u, self.a)


_PAIR = {"type": "array", "items": number().schema(), "minItems": 2, "maxItems": 2}
_OF_KIND = [
    {
        "type": "object",
        "properties": {
            key: _PAIR | {"description": f"{KEYS[key]}, {SI}"}
            for key in ((kind, "within") if kind == "normal" else (kind,))
        },
        "required": [kind],
        "additionalProperties": False,
    }
    for kind in KINDS
]
DEFINITIONS["distribution"] = {
    "anyOf": [
        *_OF_KIND,
        {"type": "array", "items": {"anyOf": [*number().schema()["anyOf"], ref("distribution")]}},
        {
            "type": "object",
            "properties": dict.fromkeys(KEYS, False),
            "additionalProperties": ref("distribution"),
        },
    ]
}
DEFINITIONS["criterion"] = {
    "type": "object",
    "properties": {"status": flag.about("whether a sample that stops early fails").schema()},
    "additionalProperties": {"anyOf": [*number("positive").schema()["anyOf"], ref("criterion")]},
}


@reads({"type": "object", "additionalProperties": ref("distribution"), "description": "by name, " + SI})
def margins(value: Any, where: str) -> dict[str, Margin]:
    """Reads a table of distributions, of tables and of lists of them: dotted name -> distribution."""
    found: dict[str, Margin] = {}
    _collect(value, "", where, found)
    return found


def _collect(value: Any, name: str, where: str, found: dict[str, Margin]) -> None:
    if isinstance(value, list) and any(isinstance(item, dict) for item in value):
        for k, item in enumerate(value):
            place = f"{where}[{k}]"
            if isinstance(item, dict):
                _collect(item, f"{name}[{k}]", place, found)
            else:
                found[f"{name}[{k}]"] = Margin("fixed", number()(item, place))
    elif isinstance(value, dict) and not _is_margin(value) and (value or not name):
        for key, item in value.items():
            _collect(item, f"{name}.{key}" if name else key, f"{where} {key}", found)
    elif name and isinstance(value, dict):
        found[name] = _margin(value, where)
    else:
        raise BadInput(f"{where} = {value!r} is no distribution, {EXAMPLE}")


def _is_margin(table: Mapping[str, Any]) -> bool:
    """Is it a distribution, if perhaps of an unknown kind? Then there are numbers in it,
    not tables or lists of them."""
    parts = (item if isinstance(item, list) else [item] for item in table.values())
    return any(not any(isinstance(part, dict) for part in items) for items in parts)


def _margin(table: Mapping[str, Any], where: str) -> Margin:
    check_keys(table, [*KINDS, "within"], where)
    kinds = [kind for kind in KINDS if kind in table]
    if len(kinds) != 1:
        raise BadInput(f"{where} must be one of {', '.join(KINDS)}, {EXAMPLE}")
    kind = kinds[0]
    a, b = KINDS[kind](table[kind], f"{where} {kind}")
    if "within" not in table:
        return Margin(kind, a, b)
    if kind != "normal":
        raise BadInput(f"{where} within applies to normal only; {kind} has bounds already")
    from scipy.special import ndtr  # slow to import

    low, high = ascending(number())(table["within"], f"{where} within")
    if not ndtr((high - a) / b) - ndtr((low - a) / b) > 1e-9:
        raise BadInput(
            f"{where} within: almost none of the normal distribution lies between {low:g} and {high:g}"
        )
    return Margin(kind, a, b, (low, high))


_rho = number(unit="1", above=-1.0, below=1.0)
_correlation = row("[name, name, correlation]", text, text, _rho, entries="entries")


@reads(
    {
        "type": "array",
        "description": "[[name, name, correlation], ...], numbers without unit between -1 and 1",
        "items": _correlation.schema(),
    }
)
def _correlations(value: Any, where: str) -> tuple[tuple[str, str, float], ...]:
    """Read a list of [name, name, correlation]."""
    return each_of(_correlation, value, where, 'a list, for example [["plant.m_c", "plant.I_c", 0.8]]')


@reads({"allOf": [ref("criterion")], "description": SI})
def _criterion(value: Any, where: str) -> dict[str, float | bool]:
    """Read the criterion of failure: status = true, and outcomes with their limits."""
    made: dict[str, float | bool] = {}
    for key, item in of_type(
        value, dict, where, "a table, for example { status = true, final = 0.05 }"
    ).items():
        if key == "status":
            made[key] = flag(item, f"{where} status")
        elif isinstance(item, dict):  # final.distance = 0.05
            made |= {f"{key}.{name}": limit for name, limit in _criterion(item, f"{where} {key}").items()}
        else:
            made[key] = number("positive")(item, f"{where} {key}")
    return made


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """What varies, and the criterion of failure: a sample fails if it stops early,
    or an outcome exceeds a limit."""

    seed: int = entry(whole(0, SEEDS - 1), 0, f"seed of the random numbers, below {SEEDS}")
    design: str = entry(one_of(*DESIGNS), "random", "how the samples fill the space")
    band: float = entry(number("positive"), BAND, "an error has settled when it stays within")
    period: float | None = entry(
        number("positive", "s"), None, "between calls of the controller, for a continuous SPEC"
    )
    fails: Mapping[str, float | bool] | None = entry(
        _criterion, None, "limits of outcomes above which a sample fails"
    )
    correlation: tuple[tuple[str, str, float], ...] = entry(
        _correlations, (), "correlations of the normal variables that underlie two numbers"
    )
    parameters: Mapping[str, Margin] = entry(
        margins, {}, "distributions of what the controller believes, and the robot has"
    )
    plant: Mapping[str, Margin] = entry(
        margins, {}, "distributions of the parameters that only the robot has"
    )
    gains: Mapping[str, Margin] = entry(margins, {}, "distributions of gains")
    output: Mapping[str, Margin] = entry(margins, {}, "distributions of numbers of [output]")
    feedback: Mapping[str, Margin] = entry(margins, {}, "distributions of numbers of [feedback]")
    reference: Mapping[str, Margin] = entry(margins, {}, "distributions of numbers of [reference]")
    initial: Mapping[str, Margin] = entry(margins, {}, "distributions of numbers of [initial]")
    limits: Mapping[str, Margin] = entry(margins, {}, "distributions of numbers of [limits]")
    contact: Mapping[str, Margin] = entry(margins, {}, "distributions of numbers of [contact]")
    sensors: Mapping[str, Margin] = entry(margins, {}, "distributions of numbers of [sensors]")
    correction: Mapping[str, Margin] = entry(margins, {}, "distributions of numbers of [correction]")
    adaptation: Mapping[str, Margin] = entry(margins, {}, "distributions of numbers of [adaptation]")
    estimator: Mapping[str, Margin] = entry(margins, {}, "distributions of numbers of [estimator]")
    simulation: Mapping[str, Margin] = entry(margins, {}, "distributions of numbers of [simulation]")

    def __post_init__(self):
        if heading := self.initial.get("heading"):
            for value in (heading.a, heading.b):
                angle(value, "[sweep.initial] heading")

    @property
    def margins(self) -> dict[str, Margin]:
        """Return all that varies: dotted name -> distribution."""
        sections = (
            *("parameters", "plant", "gains", "output", "feedback", "reference", "initial"),
            *("limits", "contact", "sensors", "correction", "adaptation", "estimator", "simulation"),
        )
        return {
            f"{where}.{name}": margin for where in sections for name, margin in getattr(self, where).items()
        }
