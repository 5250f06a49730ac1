"""The JSON Schemas of SPEC.toml and CASES.json: current, and of one mind with the readers."""

import copy
import json
import os
import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import reduce
from operator import attrgetter
from pathlib import Path

import jsonschema
import noslip
import pytest
from noslip.cli.main import main
from noslip.readers.errors import BadInput
from noslip.readers.reading import entry, number, section, text
from noslip.simulation.specification.cases import read_cases
from noslip.simulation.specification.spec import read_spec, spec_of_table

SPECS = Path(noslip.__file__).parent / "examples/specs"
SHIPPED = sorted(SPECS.rglob("*.toml"))
SCHEMAS = {"spec": "simulate", "cases": "evaluate"}  # name -> the command that reads such files
SCHEMA = {name: json.loads((SPECS / f"{name}.schema.json").read_text()) for name in SCHEMAS}
WRONG = [
    None,
    True,
    3,
    -3.5,
    "x",
    "3 m",
    "90 deg",
    "IV",
    [],
    [1.0],
    [1.0, 2.0],
    [1.0, 2.0, 3.0],
    ["1 m", "2 m"],
    {},
    {"x": 1.0},
]


def accepted(name: str, content: object) -> bool:
    return jsonschema.Draft7Validator(SCHEMA[name]).is_valid(content)


@pytest.mark.parametrize("name", SCHEMAS)
def test_the_shipped_schemas_are_current(name, capsys):
    jsonschema.Draft7Validator.check_schema(SCHEMA[name])
    file = SPECS / f"{name}.schema.json"
    assert main([SCHEMAS[name], "--schema"]) == 0
    assert capsys.readouterr().out == file.read_text(), (
        f"run noslip {SCHEMAS[name]} --schema > examples/specs/{file.name}"
    )


@pytest.mark.parametrize("file", SHIPPED, ids=lambda file: file.stem)
def test_shipped_specs_name_their_schema_and_satisfy_it(file):
    directive, named = file.read_text().splitlines()[0].split()
    assert (
        directive == "#:schema" and (file.parent / named).resolve() == (SPECS / "spec.schema.json").resolve()
    )
    jsonschema.validate(tomllib.loads(file.read_text()), SCHEMA["spec"])


@pytest.mark.parametrize("file", sorted(SPECS.rglob("reference/*.json")), ids=lambda file: file.stem)
def test_reference_values_name_their_schema_and_satisfy_it(file):
    content = json.loads(file.read_text())
    assert (file.parent / content["$schema"]).resolve() == (SPECS / "cases.schema.json").resolve()
    jsonschema.validate(content, SCHEMA["cases"])


def defaults(schema: dict) -> dict:
    """The defaults of a section's schema by name, those of its tables too."""
    values = {}
    for name, item in schema.get("properties", {}).items():
        values |= {name: item["default"]} if "default" in item else {}
        values |= {f"{name}.{key}": value for key, value in defaults(item).items()}
    return values


def test_defaults_are_those_of_the_reader():
    stated = defaults(SCHEMA["spec"])
    assert stated["simulation.backend"] == "c" and not {"robot", "output.type"} & stated.keys()
    needed = {
        "simulation.period": 0.01,
        "limits.torque": [20.0],
        "sensors": {},
        "correction.rate": 1.0,
        "contact": {},
    }
    needed |= {"reference.approach.acceleration": 0.5, "drive.kind": "torque"}
    noticing = {"limits.mode": "grip", "sensors.gyro": {}}
    needed["floor.rough"] = {"count": 1, "x": [0, 1], "y": [0, 1], "height": 0.01, "radius": 0.1}
    on_circle = {
        "output": {"type": "I"},
        "reference": {"position": [0.0, 0.0], "circle": {"radius": 1.0, "rate": 0.1}},
    }
    course = {"position": [0.0, 0.0], "course": {"speed": 0.5, "lengths": [1.0], "curvatures": [0.0, 0.1]}}
    bases = {"reference.circle.": on_circle, "reference.course.": on_circle | {"reference": course}}
    for key, value in stated.items():
        base = next((CIRCLE | changes for start, changes in bases.items() if key.startswith(start)), CIRCLE)
        if key.startswith("estimator."):  # which does not go with a correction
            pose = {"estimator.pose.rate": 1.0, "estimator.pose.sd": 0.1, "estimator.pose.heading_sd": 0.1}
            given = (
                {name: needed[name] for name in ("simulation.period", "sensors")}
                | {"estimator.noise": 0.1}
                | pose
            )
        elif key.startswith("adaptation."):  # which does not go with drives
            learned = {"adaptation.bounds": {"m_c": [20.0, 90.0]}, "adaptation.noise": 0.1}
            given = {"simulation.period": 0.01} | learned
        else:
            given = needed
        more = (
            []
            if base is not CIRCLE
            else [*given.items(), *(noticing.items() if "notice_slip" in key else ())]
        )
        if not key.startswith(("sweep.", "simulation.period")):
            table = reduce(lambda content, item: changed(content, *item), [*more, (key, None)], base)
            assert attrgetter(key)(spec_of_table(table, SPECS / "line.toml")) == value, key


def described(schema: object, place: str = "") -> Iterator[tuple[str, dict]]:
    """Every entry of the tables of a schema, with its place; what is refused, and conditions,
    are no entries."""
    parts = (
        schema.items() if isinstance(schema, dict) else enumerate(schema) if isinstance(schema, list) else ()
    )
    for key, part in parts:
        if key == "properties":
            yield from ((f"{place}.{name}", item) for name, item in part.items() if item is not False)
        if key != "if":
            yield from described(part, f"{place}.{key}")


def takes_numbers(item: dict) -> bool:
    """Whether an entry is a number, or a list of numbers."""
    items = item.get("items", [])
    parts = [*item.get("anyOf", ()), *(items if isinstance(items, list) else [items])]
    return (
        item.get("type") == "number"
        or item.get("$ref") == "#/definitions/number"
        or any(map(takes_numbers, parts))
    )


UNIT = re.compile(r"\b(in (SI units|[mNrsH1]\S*)|without unit)")


def undescribed(schema: dict) -> list[str]:
    """The entries without a meaning, and those with numbers without a unit."""
    return [
        place
        for place, item in described(schema)
        if not re.search(r"[a-z]{2}", UNIT.sub("", item.get("description", "")))
        or takes_numbers(item)
        and not UNIT.search(item["description"])
    ]


@pytest.mark.parametrize("name", SCHEMAS)
def test_every_entry_has_its_meaning_and_unit(name):
    assert len(list(described(SCHEMA[name]))) > 30 and undescribed(SCHEMA[name]) == []


def test_an_entry_without_meaning_or_unit_is_found():
    @dataclass(frozen=True)
    class Planted:
        said: float = entry(number(unit="m"), 0.0, "its length")
        silent: float = entry(number(unit="m"), 0.0)
        word: str = entry(text, "")

    schema = section(Planted).schema()
    assert undescribed(schema) == [".silent", ".word"]
    schema["properties"]["said"]["description"] = "its length"
    assert undescribed(schema) == [".said", ".silent", ".word"]


def changed(content: dict, key: str, value: object) -> dict:
    """A copy with an entry, by its dotted key, replaced; removed for None."""
    result = copy.deepcopy(content)
    place, *rest = result, *key.split(".")
    for name in rest[:-1]:
        place = place.setdefault(name, {})
    if value is None:
        place.pop(rest[-1], None)
    else:
        place[rest[-1]] = value
    return result


def read(table: dict) -> bool:
    try:
        spec_of_table(table, SPECS / "line.toml")
    except BadInput:
        return False
    return True


CIRCLE = tomllib.loads((SPECS / "circle.toml").read_text())
BAD = [
    ("robot", None),
    ("robot", 3),
    ("robots", "labmate"),
    ("output", None),
    ("output.type", None),
    ("output.type", ["IV"]),
    ("output.L", "ahead"),
    ("output.L", "0.1m"),
    ("output.L", "9**9**9**9 m"),
    ("output.lead", 0.1),
    ("output.reversing", "maybe"),
    ("output.path", "circle"),
    ("output.path.kind", None),
    ("output.path.R", [10.0]),
    ("output.path", {"kind": "waypoints", "points": [[0, 0], [1, 1]]}),
    ("output.path", {"kind": "waypoints", "points": [[0, 0, 0], [1, 1]], "tolerance": 0.1}),
    ("output.path", {"kind": "dubins", "from": [0, 0], "to": [4, 3, 1], "radius": 1.0}),
    ("output.path", {"kind": "dubins", "from": [0, 0, 90], "to": [4, 3, 1], "radius": 1.0}),
    ("output.path", {"kind": "dubins", "from": [0, 0, 0], "to": [4, 3, 1], "radius": 0.0}),
    ("output.path", {"kind": "dubins", "from": [0, 0, 0], "to": [4, 3, 1], "radius": 1.0, "via": [1, 1]}),
    ("output.path", {"kind": "reeds_shepp", "from": [0, 0, 0], "to": [4, 3, 1], "radius": 1.0, "closed": 1}),
    ("output.path", {"kind": "composite", "segments": []}),
    ("output.path", {"kind": "composite", "segments": [{"kind": "spiral"}]}),
    (
        "output.path",
        {"kind": "composite", "segments": [{"kind": "line", "from": [0, 0], "to": [1, 0], "radius": 1.0}]},
    ),
    ("gains.kp", True),
    ("parameters", 3.0),
    ("initial.heading", 90.0),
    ("initial.point", [1.0]),
    ("initial.point", [1.0, 2.0, 3.0]),
    ("initial.q", 3.0),
    ("contact.mu", -0.7),
    ("simulation.duration", 0.0),
    ("simulation.duration", None),
    ("simulation.period", -1.0),
    ("sensors.seed", -1),
    ("sensors.counts", 1.5),
    ("sensors.noise.sd", "loud"),
    ("correction.mode", "sometimes"),
    ("sweep.design", "grid"),
    ("sweep.band", 0.0),
    ("sweep.fails", {"status": 1}),
    ("sweep.fails", {"final": {"distance": -1.0}}),
    ("sweep.plant", {"m_c": 3.0}),
    ("sweep.plant", {"m_c": {"normal": [3.0]}}),
    ("sweep.plant", {"m_c": {"normal": [3.0, 1.0], "uniform": [1.0, 2.0]}}),
    ("sweep.plant", {"m_c": {"uniform": [1.0, 2.0], "within": [1.0, 2.0]}}),
    ("sweep.correlation", [["plant.m_c", "plant.I_c"]]),
]


@pytest.mark.parametrize(("key", "value"), BAD, ids=lambda item: item if isinstance(item, str) else None)
def test_what_the_reader_refuses_by_its_structure_the_schema_refuses(key, value):
    table = changed(changed(CIRCLE, "simulation.period", 0.01), key, value)
    assert not read(table)
    assert not accepted("spec", table)


def entries(table: dict, prefix: str = "") -> list[str]:
    keys = []
    for key, value in table.items():
        keys += [prefix + key, *(entries(value, f"{prefix}{key}.") if isinstance(value, dict) else [])]
    return keys


@pytest.mark.parametrize("name", ["line", "sweep", "figures/figure_8", "figures/limits", "robots/car"])
def test_the_schema_refuses_nothing_that_the_reader_accepts(name):
    """Every entry of a SPEC in turn is removed, and replaced by a value of every kind."""
    table = tomllib.loads((SPECS / f"{name}.toml").read_text())
    accepts = 0
    for key in entries(table):
        for value in WRONG:
            other = changed(table, key, value)
            if read(other):
                accepts += 1
                assert accepted("spec", other), (key, value)
    assert accepts > 10


CASE = json.loads((SPECS / "reference/labmate_paper.json").read_text())["cases"][0]


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("q", None),
        ("q", 3.0),
        ("q", ["x"] * 5),
        ("nu", {"x": 1.0}),
        ("output.type", None),
        ("output.type", 4),
        ("output.path", "line"),
        ("params", None),
        ("params.b", "0.7 m"),
        ("params.b", "1_0"),
        ("params.b", True),
        ("reference.y", None),
        ("reference.z", [1.0]),
        ("expect.taus", [1.0]),
        ("expect.tau", 1.0),
        ("speed", 1.0),
    ],
)
def test_cases_that_the_reader_refuses_the_schema_refuses(key, value, tmp_path):
    file = tmp_path / "cases.json"
    for case, good in ((CASE, True), (changed(CASE, key, value), False)):
        file.write_text(json.dumps({"cases": [case]}))
        assert accepted("cases", {"cases": [case]}) == good
        if good:
            assert read_cases(os.fspath(file))
        else:
            with pytest.raises(BadInput):
                read_cases(os.fspath(file))
    assert not accepted("cases", {"cases": []}) and not accepted("cases", {"cases": [CASE], "bot": "x"})


def test_a_shipped_spec_is_known_by_its_name_in_any_folder(tmp_path, monkeypatch):
    """With the files that it names, which are beside it."""
    specs = [file for file in SHIPPED if ".py:" in tomllib.loads(file.read_text())["robot"]]
    assert len(specs) > 5
    monkeypatch.chdir(tmp_path)
    for file in specs:
        spec = read_spec(file.stem)
        assert spec == read_spec(file) and Path(spec.robot.partition(":")[0]).is_file()
