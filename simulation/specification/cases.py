"""Reads files of CASES and writes OUT: the JSON of `noslip evaluate`."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...model.errors import ModelError
from ...model.law import GAINS, SHORT_GAINS, ControlLaw
from ...model.mechanism import Mechanism, Quantity
from ...model.names import INTEGRAL, OBSERVER, TYPES, LawName
from ...model.paths import PATHS
from ...readers.errors import BadInput, check_named, naming
from ...readers.files import file_or_shipped, read_input, write_whole
from ...readers.reading import DRAFT, Schema, ref
from ...readers.robots import beside, find_robot, law_of
from ..controllers.controller import MODEL_QUANTITIES, QUANTITIES, Evaluation

DEFAULT_ROBOT = "labmate"
MOST = 256  # MB, limit of a file of cases
FILE_KEYS = ("cases", "robot", "about", "seed", "$schema")
CASE_KEYS = ("params", "output", "q", "nu", "reference", "gains", "extension", "expect", "about")
NEEDED = CASE_KEYS[:6]
INTERMEDIATE = ("Sdot", "v")  # results that no backend returns
EXPECTED = (*QUANTITIES, "extension_rate", *MODEL_QUANTITIES, *INTERMEDIATE)
DERIVATIVES = tuple("y" + "d" * order for order in range(len(GAINS) + 1))  # y, yd, ydd, ...
REFERENCE = DERIVATIVES[:3]
MEANING = {  # of the keys, for the schema
    "cases": "evaluations, each for itself",
    "robot": "name of a shipped robot, or path/to/file.py:name",
    "about": "what these numbers are and where they come from; not read",
    "seed": "with which random numbers were drawn; not read",
    "$schema": "the schema of this file, for editors",
    "params": "every parameter of the robot by name, in SI units",
    "output": "the law: its type and its parameters by name, in SI units",
    "type": f"{', '.join(TYPES)}, or the name of a law",
    "path": "the curve of type IV and its parameters by name, in SI units",
    "kind": f"of curve: {', '.join(PATHS)}",
    "q": "every coordinate, in m or rad",
    "nu": "every quasi-velocity, in m/s or rad/s",
    "reference": "desired outputs and their rates",
    "y": "desired outputs, in m, rad or m/s",
    "yd": "their first derivatives, in m/s or rad/s; of outputs of relative degree 1 or 0 not used, 0",
    "ydd": "of outputs of relative degree 2 the second derivatives, of degree 1 the first, in m/s^2, "
    "rad/s^2, m/s or rad/s",
    **{
        name: f"their derivatives of order {order}, in SI units"
        for order, name in enumerate(DERIVATIVES)
        if order > 2
    },
    "extension": "every state of the law's dynamic extension, in SI units",
    "gains": "by name, or kp, kd, kv for all of a kind, in SI units",
    "expect": "results to compare with",
    "h": "outputs (14), in m, rad or m/s",
    "ydot": "rates of the outputs, in SI units",
    "Phi": "decoupling matrix (15), in SI units",
    "Phidot": "its rate, in SI units",
    "u": "accelerations of the quasi-velocities (20), in m/s^2 or rad/s^2",
    "tau": "inputs, in N or N m",
    "M": "mass matrix (8), in SI units",
    "V": "velocity terms and forces (8), in N or N m",
    "A": "constraint matrix, in SI units",
    "S": "null-space basis of A, in SI units",
    "Mbar": "mass matrix S' M S of (10), in SI units",
    "bias": "the other terms of (10), in SI units",
    "lam": "constraint forces, in N",
    "extension_rate": "rates of the states of the dynamic extension, in SI units",
    "Sdot": "rate of S, in SI units",
    "v": "virtual input (20), in SI units",
}
FINITE = r"([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?"
DECIMAL = rf"^\s*[-+]?({FINITE}|[nN][aA][nN]|[iI][nN][fF]([iI][nN][iI][tT][yY])?)\s*$"


@dataclass(frozen=True, eq=False)
class EvaluationCase:
    """One evaluation: numbers in the order of the law's groups, SI. `where` names it in messages."""

    where: str
    law: ControlLaw
    params: tuple[float, ...]
    config: tuple[float, ...]
    gains: tuple[float, ...]
    state: np.ndarray
    reference: np.ndarray
    expect: dict[str, np.ndarray]


def read_cases(path: str) -> list[EvaluationCase]:
    """Read a file of cases. Raises BadInput naming file and case for invalid entries,
    OSError if it cannot be read."""
    content = _read_json(path)
    _check_keys(content, FILE_KEYS, ("cases",), path)
    cases = content["cases"]
    if not isinstance(cases, list) or not cases:
        raise BadInput(f"{path}: `cases` must be a list of at least one case")
    name = content.get("robot", DEFAULT_ROBOT)
    if not isinstance(name, str):
        raise BadInput(f"{path}: `robot` must be a name, not {name!r}")
    robot = find_robot(beside(name, path))
    return [_case(robot, case, f"{path}: case {k}") for k, case in enumerate(cases)]


def schema() -> Schema:
    """Return the JSON Schema of a file of cases."""
    number = ref("number")
    numbers: Schema = {"type": "array", "items": number}
    named: Schema = {"type": "object", "additionalProperties": number}
    path = _object({"kind": {"type": "string"}}) | {"additionalProperties": number}
    output = _object({"type": {"type": "string"}, "path": path}, ["type"]) | {"additionalProperties": number}
    expected = {"anyOf": [numbers, {"type": "array", "items": numbers}]}
    kinds: dict[str, Schema] = {
        "params": named,
        "output": output,
        "q": numbers,
        "nu": numbers,
        "reference": _object(dict.fromkeys(DERIVATIVES, numbers), REFERENCE),
        "gains": named,
        "extension": numbers,
        "expect": _object(dict.fromkeys(EXPECTED, expected)),
    }
    case = _object({key: kinds.get(key, {}) for key in CASE_KEYS}, NEEDED)
    kinds_of_file: dict[str, Schema] = {
        "cases": {"type": "array", "minItems": 1, "items": case},
        "robot": {"type": "string", "default": DEFAULT_ROBOT},
    }
    whole = _object({key: kinds_of_file.get(key, {}) for key in FILE_KEYS}, ("cases",))
    digits = {"type": "string", "pattern": DECIMAL, "description": "a number in decimal digits"}
    return {
        "$schema": DRAFT,
        "title": "CASES.json of noslip",
        **whole,
        "definitions": {"number": {"anyOf": [{"type": "number"}, digits]}},
    }


def _object(properties: dict[str, Schema], required: Sequence[str] = ()) -> Schema:
    described = {key: {"description": MEANING[key], **schema} for key, schema in properties.items()}
    return {
        "type": "object",
        "properties": described,
        "required": list(required),
        "additionalProperties": False,
    }


def write_out(path: str, evaluations: Sequence[Evaluation]) -> None:
    """Write OUT, one case per line; every number reads back to the same bits (17 digits if needed)."""
    lines = []
    for evaluation in evaluations:
        values = {name: value.tolist() for name, value in evaluation.values.items()}
        lines.append(json.dumps({"status": evaluation.status, **values}, allow_nan=False))
    write_whole(path, '{"cases": [\n' + ",\n".join(lines) + "\n]}\n")


def read_output(output: Mapping[str, Any], where: str) -> tuple[str, dict[str, Any]]:
    """Return the law's name and the entries for law.config, including those of the path, of an `output`
    table.

    `type` is I to IV, IV with the kind of its path; or the name of a law. Raises BadInput for others.
    """
    kind, path = output.get("type"), _table(output.get("path", {}), f"{where}: path")
    if not isinstance(kind, str):
        raise BadInput(f"{where}: `type` is missing: I, II, III, IV or the name of a law")
    if kind == "IV" and not isinstance(path.get("kind"), str):
        raise BadInput(f"{where}: type IV requires a `path` with a `kind`: {', '.join(PATHS)}")
    own = {key: value for key, value in output.items() if key not in ("type", "path")}
    of_path = {key: value for key, value in path.items() if key != "kind"}
    for key in own:
        if key in of_path:
            raise BadInput(f"{where}: {key!r} is given twice, once in `path`")
    law = LawName(kind, path["kind"] if kind == "IV" else "") if kind in TYPES else LawName.parse(kind)
    if "kind" in path and (law is None or law.path != path["kind"]):
        raise BadInput(
            f"{where}: type {kind!r} takes no path of kind {path['kind']!r}; types are I, II, III, IV or a "
            "law's name"
        )
    return str(law or kind), own | of_path


def gain_entries(law: ControlLaw, values: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return gains by the names of law.gains: kp, kd, kv apply to all gains of that kind; a full name takes
    precedence.

    Those of integral action are left to `integral_entries`, those of observers to `observer_entries`. Raises
    BadInput for an unknown name.
    """
    names = [gain.name for gain in law.gains]
    with_memory = [f"{kind}_{row.name}" for kind in (INTEGRAL, OBSERVER) for row in law.output.rows]
    allowed = (*SHORT_GAINS, INTEGRAL, OBSERVER, *names, *with_memory)
    for name in values:
        check_named(name, allowed, f"{where}: unknown gain")
    return _in_full(names, values)


def integral_entries(law: ControlLaw, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return gains ki_distance, ... of integral action, which is not part of the law;
    ki applies to all of them."""
    return _in_full([f"{INTEGRAL}_{row.name}" for row in law.output.rows], values)


def observer_entries(law: ControlLaw, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return rates ko_distance, ... of disturbance observers, which are not part of the law;
    ko applies to all of them."""
    return _in_full([f"{OBSERVER}_{row.name}" for row in law.output.rows], values)


def _in_full(names: Sequence[str], values: Mapping[str, Any]) -> dict[str, Any]:
    short = {name: values[name[:2]] for name in names if name[:2] in values}
    return short | {name: values[name] for name in names if name in values}


def _read_json(path: str) -> Any:
    # JSON does not distinguish integers; as floats, numbers with any number of digits can be read.
    with (
        naming(f"{path}: nested too deeply for a file of cases", RecursionError),
        naming(f"{path}: not valid JSON, or truncated", json.JSONDecodeError),
        naming(f"{path}: not JSON: not UTF-8 text", UnicodeDecodeError),
    ):
        return json.loads(
            read_input(file_or_shipped(path, ".json"), MOST).decode("utf-8-sig"), parse_int=float
        )


def _case(robot: Mechanism, case: Any, where: str) -> EvaluationCase:
    _check_keys(case, CASE_KEYS, NEEDED, where)
    output = _table(case["output"], f"{where}: output")
    name, config = read_output(output, f"{where}: output")
    with naming(where, (BadInput, ModelError)):
        law = law_of(robot, name)
    params = _table(case["params"], f"{where}: params")
    gains = gain_entries(law, _table(case["gains"], f"{where}: gains"), f"{where}: gains")
    for name in case["gains"]:
        if name[:2] in (INTEGRAL, OBSERVER):
            what = "integral action is" if name[:2] == INTEGRAL else "disturbance observers are"
            why = f"a law has no memory; {what} available in `noslip simulate`"
            raise BadInput(f"{where}: gains: unknown gain {name!r}: {why}")
    q = _numbers(case["q"], len(law.system.mechanism.coordinates), f"{where}: q")
    nu = _numbers(case["nu"], law.system.dof, f"{where}: nu")
    states = ", ".join(q.name for q in law.extension)
    if law.extension and "extension" not in case:
        raise BadInput(f"{where}: extension missing: {law.name} has the states {states}")
    xi = _numbers(case.get("extension", []), len(law.extension), f"{where}: extension")
    return EvaluationCase(
        where,
        law,
        _values(law.parameters, params, f"{where}: params"),
        _values(law.config, config, f"{where}: output"),
        _values(law.gains, gains, f"{where}: gains"),
        np.array(q + nu + xi),
        _reference(law, case["reference"], f"{where}: reference"),
        _expect(case.get("expect", {}), f"{where}: expect"),
    )


def _reference(law: ControlLaw, table: Any, where: str) -> np.ndarray:
    """Return y, yd, ... by row of the output, up to the derivative of its relative degree; for degree 1 y and
    ydd, the desired rate. Raises BadInput for a rate in yd, which the law would not use.
    """
    rows, degrees = len(law.output.rows), law.linearization.relative_degree
    names = DERIVATIVES[: max(2, *degrees) + 1]
    _check_keys(table, names, names, where)
    given = np.array([_numbers(table[name], rows, f"{where}.{name}") for name in names])
    values = [given[[0, 2] if degree == 1 else range(degree + 1), row] for row, degree in enumerate(degrees)]
    if not np.all(np.isfinite(given)):  # also entries that the law does not use
        return np.full(sum(map(len, values)), np.nan)
    for k in (k for k, degree in enumerate(degrees) if degree == 1):
        rate, used = given[1:3, k]
        # Files of Type IV have had other numbers in yd
        if rate != used and rate and not (used and law.output.path):
            raise BadInput(
                f"{where}: yd[{k}] = {rate:g}: {law.output.rows[k].name} has relative degree 1, and its "
                f"desired rate is ydd[{k}]: write it there, and 0 in yd[{k}]"
            )
    return np.concatenate(values)


def _expect(table: Any, where: str) -> dict[str, np.ndarray]:
    _check_keys(table, EXPECTED, (), where)
    return {name: np.array(_array(value, f"{where}.{name}"), dtype=float) for name, value in table.items()}


def _array(value: Any, where: str) -> list:
    """Return a vector or matrix of finite numbers."""
    if isinstance(value, list) and value and all(isinstance(row, list) for row in value):
        return [_numbers(row, len(value[0]), where, finite=True) for row in value]
    return _numbers(value, None, where, finite=True)


def _values(quantities: Sequence[Quantity], table: Mapping[str, Any], where: str) -> tuple[float, ...]:
    names = [quantity.name for quantity in quantities]
    _check_keys(table, names, names, where)
    return tuple(_number(table[name], f"{where}.{name}") for name in names)


def _check_keys(table: Any, allowed: Sequence[str], needed: Sequence[str], where: str) -> None:
    for key in _table(table, where):
        check_named(key, allowed, f"{where}: unknown key")
    missing = [key for key in needed if key not in table]
    if missing:
        raise BadInput(f"{where}: {', '.join(missing)} missing")


def _table(value: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise BadInput(f"{where}: must be an object {{...}}, not {_brief(value)}")
    return value


def _numbers(values: Any, length: int | None, where: str, finite: bool = False) -> list[float]:
    if not isinstance(values, list) or length is not None and len(values) != length:
        requirement = "a list of numbers" if length is None else f"a list of {length} numbers"
        raise BadInput(f"{where}: must be {requirement}, not {_brief(values)}")
    numbers = [_number(value, where) for value in values]
    if finite and not np.all(np.isfinite(numbers)):
        raise BadInput(f"{where}: has a number that is not finite")
    return numbers


def _number(value: Any, where: str) -> float:
    if isinstance(value, float):
        return value
    try:
        if isinstance(value, str) and "_" not in value:
            return float(value)
    except ValueError:
        pass
    raise BadInput(f"{where}: {_brief(value)} is not a number")


def _brief(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
