"""The table of stages says what goes together: read against the keys of a SPEC, the columns of runs,
and what really happens."""

import copy
import itertools
import json
import random
import re
from dataclasses import fields
from pathlib import Path

import noslip
import numpy as np
import pytest
from noslip.cli.main import main
from noslip.codegen.loop import stages
from noslip.codegen.loop.rules import OF_LAW, USERS, WORDS, Excludes, Needs, Option
from noslip.codegen.loop.stages import RULES, SIGNALS, STAGES
from noslip.model.errors import ModelError
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot, law_of
from noslip.simulation.closed_loop import simulate
from noslip.simulation.specification.spec import Spec, spec_of_table

ROOT = Path(noslip.__file__).parent
BASE = {
    "robot": "labmate",
    "output": {"type": "IV", "L": 0.2, "path": {"kind": "line", "A": 0.0, "B": 1.0, "C": 0.0}},
    "reference": {"speed": 0.5},
    "initial": {"point": [0.0, 0.1], "heading": 0.1, "speed": 0.3},
    "limits": {"torque": 8.0},
    "simulation": {
        "duration": 0.1,
        "period": 0.01,
        "output_step": 0.05,
        "backend": "casadi",
        "tolerance": 1e-6,
    },
}
COURSE = {"speed": 0.5, "lengths": [2.0], "curvatures": [0.0, 0.1]}
ARC = [{"kind": "line", "from": [0, 0], "to": [3, 0]}, {"kind": "arc", "radius": 1.2, "angle": 1.57}]
OPTIONS = {  # an option -> entries of a SPEC that make it hold; None removes one
    "sampled": {},
    "continuous": {"simulation": {"period": 0.0}},
    "sensors": {"sensors": {"counts": 1000}},
    "noise": {"sensors": {"noise": {"sd": 0.01}, "seed": 3}},
    "true pose": {"sensors": {"pose": "true"}},
    "gyro": {"sensors": {"gyro": {"noise": 0.01}}},
    "correction": {"correction": {"rate": 20.0}},
    "estimator": {"estimator": {"noise": 0.01, "gyro_noise": 0.01}},
    "adaptation": {"adaptation": {"bounds": {"m_c": [20.0, 90.0]}, "noise": 0.1}},
    "short window": {"adaptation": {"bounds": {"m_c": [20.0, 90.0]}, "noise": 0.1, "window": 0.02}},
    "cut": {"limits": {"mode": "cut"}},
    "grip": {"limits": {"mode": "grip"}, "contact": {"mu": 0.6}},
    "no friction": {"limits": {"mode": "grip"}, "contact": None},
    "notice slip": {
        "limits": {"mode": "grip", "notice_slip": {}},
        "contact": {"mu": 0.6},
        "sensors": {"gyro": {}},
    },
    "no gyro": {
        "limits": {"mode": "grip", "notice_slip": {}},
        "contact": {"mu": 0.6},
        "sensors": {"gyro": None},
    },
    "delay": {"simulation": {"delay": 0.005}},
    "long delay": {"simulation": {"delay": 0.02}},
    "velocity": {"drive": {"kind": "velocity", "bandwidth": 5.0}},
    "kinematic": {"drive": {"kind": "kinematic", "bandwidth": 5.0}, "limits": None},
    "kinematic, limited": {"drive": {"kind": "kinematic", "bandwidth": 5.0}},
    "torque": {"drive": {"kind": "torque"}},
    "bandwidth of torque": {"drive": {"kind": "torque", "bandwidth": 5.0}},
    "ki": {"gains": {"ki_distance": 0.1}},
    "ko": {"gains": {"ko_distance": 1.0}},
    "approach": {"reference": {"approach": {"acceleration": 0.5}}},
    "damped": {"output": {"near_singular": "damped"}},
    "band": {"output": {"band": 0.2}},
    "switch": {"output": {"reversing": "switch"}},
    "extension": {"output": {"extension": True, "L": -0.3}, "limits": {"mode": "cut"}},
    "composite": {"output": {"path": {"kind": "composite", "segments": ARC}}},
    "fastest": {
        "reference": {
            "speed": "fastest",
            "lateral": 0.5,
            "acceleration": 0.5,
            "deceleration": 0.5,
            "angular": 1.0,
        }
    },
    "lateral": {"reference": {"lateral": 0.5}},
    "creep": {"reference": {"creep": 0.02, "deceleration": 0.3}},
    "course": {"output": {"path": {"kind": "course"}}, "reference": {"course": COURSE, "speed": None}},
    "course, arclength": {
        "output": {"path": {"kind": "course"}, "arclength": True, "L": -0.3},
        "reference": {"course": COURSE, "speed": None},
    },
    "arclength": {"output": {"arclength": True}},
    "poles": {"output": {"poles": [-1.0, -1.0]}},
    "point": {"output": {"type": "I", "path": None}, "reference": {"position": [0.3, 0.1], "speed": None}},
    "circle": {
        "output": {"type": "I", "path": None},
        "reference": {"position": [0.3, 0.1], "speed": None, "circle": {"radius": 1.0, "rate": 0.1}},
    },
    "velocity of a point": {"reference": {"velocity": [0.1, 0.0]}},
    "oscillation": {"reference": {"oscillation": {"amplitude": [0.1, 0.1], "rate": 1.0}}},
    "push": {"push": [{"time": 0.05, "on": "thetadot_r", "impulse": 0.5}]},
    "q": {"initial": {"q": [0.0, 0.1, 0.1, 0.0, 0.0]}},
    "start of feedback": {"initial": {"state": {"pitch": 0.1}}},
    "commands": {"reference": {"commands": [{"time": 1.0, "distance": 1.0}]}},
}


def merged(table, entries):
    """The table with entries; None removes one."""
    table = copy.deepcopy(table)
    for key, value in entries.items():
        if value is None:
            table.pop(key, None)
        elif isinstance(value, dict) and isinstance(table.get(key), dict) and key != "path":
            table[key] = merged(table[key], value)
        else:
            table[key] = copy.deepcopy(value)
    return table


# As the run would be another one than is asked for, which nothing else would tell
REFUSED_ALTHOUGH_IT_RUNS = (
    "[reference] velocity requires",
    "[reference] oscillation requires",
    "[reference] approach requires",
    "[reference] course does not go with [reference] oscillation",
    "[initial] point does not go with [initial] q",
    "[simulation] delay = ",
    "[adaptation] ",
    "[sensors] requires",
    "integral action (gain ki) with [limits] requires",
    "a disturbance observer (gain ko) does not go with [drive]",
    "[reference] approach does not go with [drive]",
    '[output] path = { kind = "course" } does not go with [reference] approach',
    "[output] extension does not go with [drive]",
    '[drive] kind = "kinematic" does not go with [limits]',
)


def happens(*options):
    """The run of BASE with the options, or the exception that it ends with."""
    table = BASE
    for option in options:
        table = merged(table, OPTIONS[option])
    try:
        return simulate(spec_of_table(table, ROOT / "examples/specs/line.toml"))
    except Exception as error:
        return error


def same(one, other):
    return (
        not isinstance(other, Exception)
        and one.t.shape == other.t.shape
        and np.array_equal(one.x, other.x)
        and np.array_equal(one.tau, other.tau)
    )


def contradiction(pair, rules, monkeypatch):
    """Where what happens contradicts the table; an empty text where it does not."""

    def with_rules(rows):
        monkeypatch.setattr(stages, "RULES", rows)
        return happens(*pair)

    result = with_rules(rules)
    if isinstance(result, Exception) and not isinstance(result, BadInput | ModelError):
        return f"accepted, but it fails: {result!r}"
    if not isinstance(result, Exception):
        return ""
    unchecked = with_rules(())
    if isinstance(unchecked, Exception) or str(result).startswith(REFUSED_ALTHOUGH_IT_RUNS):
        return ""
    alone = [happens(option) for option in pair]
    return "" if any(same(unchecked, each) for each in alone) else f"refused, but it runs: {result}"


PAIRS = random.Random(1992).sample(list(itertools.combinations(OPTIONS, 2)), 6)


@pytest.mark.parametrize(
    "pairs",
    [PAIRS, pytest.param(list(itertools.combinations(OPTIONS, 2)), marks=pytest.mark.nightly)],
    ids=["some", "all"],
)
def test_what_is_refused_and_what_runs_is_what_the_table_says(pairs, monkeypatch):
    found = {pair: contradiction(pair, RULES, monkeypatch) for pair in pairs}
    assert {pair: said for pair, said in found.items() if said} == {}


def test_a_planted_row_and_a_missing_one_are_found(monkeypatch):
    planted = (*RULES, Excludes("[sensors]", "[reference] approach", "planted"))
    assert "refused, but it runs" in contradiction(("noise", "approach"), planted, monkeypatch)
    missing = tuple(rule for rule in RULES if not (rule.option == "[sensors]" and isinstance(rule, Needs)))
    assert len(missing) == len(RULES) - 1 and not contradiction(("continuous", "sensors"), RULES, monkeypatch)
    assert "accepted, but it fails" in contradiction(("continuous", "notice slip"), missing, monkeypatch)


def keys(kind):
    """The entries of a section, and its properties."""
    return {e.name for e in fields(kind)} | {
        name for name in dir(kind) if isinstance(getattr(kind, name, None), property)
    }


def section_of(kind, name):
    """The dataclass of an entry; None for another one."""
    return next((e.metadata["read"].kind for e in fields(kind) if e.name == name), None)


def test_options_name_keys_of_a_spec():
    """Each option, and each word, is a path of keys or properties,
    and each stage names signals and modules that there are."""
    options = {Option(text) for stage in STAGES for text in stage.where} | {Option(word) for word in WORDS}
    options |= {option for rule in RULES for option in (*rule.options, *rule.others)}
    for option in options:
        kind = Spec
        for name in option.path if option.text not in (*USERS, *OF_LAW) else ():
            assert kind is None or name in keys(kind), option
            kind = kind and section_of(kind, name)
    written = {signal for stage in STAGES for signal in stage.writes}
    for stage in STAGES:
        assert set(stage.reads) <= written | {"measured pose"} and written <= set(SIGNALS), stage.name
        assert not stage.module or (ROOT / "runtime_c" / stage.module).is_file(), stage.name
    assert len({stage.name for stage in STAGES}) == len(STAGES) >= 12
    with pytest.raises(ValueError, match="is no option"):
        Option("[limits] mode is grip").path  # noqa: B018


OF_LAWS = {
    ("labmate", "type_i"): {"outputs without an angle"},
    ("labmate", "type_ii"): {"outputs that begin with no point", "an output in rad"},
    ("labmate", "type_iv_course"): {"outputs without an angle"},
    ("tricycle", "type_iv_line"): {
        *("a steered wheel", "outputs that begin with no point", "outputs without an angle"),
    },
    ("balancer", "upright"): {
        "fewer inputs than quasi-velocities",
        "outputs that begin with no point",
        "an output in rad",
    },
}


@pytest.mark.parametrize("robot, law", OF_LAWS)
def test_what_follows_from_a_law(robot, law):
    made = law_of(find_robot(robot), law)
    assert {option for option in OF_LAW if Option(option).holds(None, law=made)} == OF_LAWS[robot, law]
    assert not any(Option(option).holds(None) for option in OF_LAW)


COLUMNS = (
    ("sampled",),
    ("noise", "correction"),
    ("estimator", "noise"),
    ("notice slip",),
    ("adaptation",),
    ("velocity",),
)
COLUMNS += (("ki", "ko"), ("composite",), ("course",), ("extension", "ki"))


@pytest.mark.parametrize("options", COLUMNS, ids=" ".join)
def test_columns_are_those_of_the_stages(options):
    run = happens(*options)
    stages_here = [stage for stage in STAGES if any(Option(text).holds(run.spec) for text in stage.where)]
    patterns = {re.sub("<[A-Z]+>", ".+", column) for stage in stages_here for column in stage.columns}
    assert [
        name for name in run.columns if not any(re.fullmatch(pattern, name) for pattern in patterns)
    ] == []
    assert [
        pattern for pattern in patterns if not any(re.fullmatch(pattern, name) for name in run.columns)
    ] == []
    assert all(line.count(",") == len(run.columns) - 1 for line in run.csv().splitlines())
    others = {
        column
        for stage in STAGES
        if stage not in stages_here
        for column in stage.columns
        if "<" not in column
    }
    assert not (others - patterns) & set(run.columns)


def test_the_table_is_printed(capsys):
    assert main(["stages"]) == 0
    text = capsys.readouterr().out
    assert all(str(rule) in text for rule in RULES)
    assert main(["stages", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [row["name"] for row in rows] == [stage.name for stage in STAGES]
    assert sum(len(row[kind]) for row in rows for kind in ("needs", "excludes", "bounds")) == len(RULES)
